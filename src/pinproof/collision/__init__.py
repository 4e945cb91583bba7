"""Collision: shapes, scenes, the checker, and certificates that hold between samples (coal)."""

from pinproof.collision.audit import AuditResult, audit
from pinproof.collision.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    MotionTube,
    Parting,
    UndecidedSpan,
)
from pinproof.collision.certify import certify, is_proven_free
from pinproof.collision.checker import CheckResult, CollisionChecker, Contact
from pinproof.collision.depth_image import DepthView, Intrinsics
from pinproof.collision.movers import Mover, TimedScene, with_movers
from pinproof.collision.occupancy import OccupancyGrid
from pinproof.collision.overlaps import LinkOverlap, OverlapReport, sample_overlaps
from pinproof.collision.pairs import ExcludedPair
from pinproof.collision.path_constraints import (
    ConstraintProof,
    ConstraintViolation,
    LookAt,
    PathConstraint,
    UndecidedConstraint,
    Upright,
    Within,
)
from pinproof.collision.program_proof import ProgramCertificate, ProgramPart, certify_program, export_program
from pinproof.collision.proof_file import verify_proof
from pinproof.collision.scene import Attachments, Scene
from pinproof.collision.sensor_files import read_points
from pinproof.collision.sensor_removal import remove_body, remove_robot
from pinproof.collision.shapes import (
    Box,
    Capsule,
    Cone,
    ConvexHull,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    HeightMap,
    Mesh,
    Obstacle,
    PointCloud,
    Shape,
    Sphere,
)

__all__ = [
    "Attachments",
    "AuditResult",
    "Box",
    "Capsule",
    "Certificate",
    "CertificateStatus",
    "CheckResult",
    "CollisionChecker",
    "Cone",
    "ConstraintProof",
    "ConstraintViolation",
    "Contact",
    "ConvexHull",
    "Cylinder",
    "DepthView",
    "Ellipsoid",
    "ExcludedPair",
    "FirstContact",
    "HalfSpace",
    "HeightMap",
    "Intrinsics",
    "LinkOverlap",
    "LookAt",
    "Mesh",
    "MotionTube",
    "Mover",
    "Obstacle",
    "OccupancyGrid",
    "OverlapReport",
    "Parting",
    "PathConstraint",
    "PointCloud",
    "ProgramCertificate",
    "ProgramPart",
    "Scene",
    "Shape",
    "Sphere",
    "TimedScene",
    "UndecidedConstraint",
    "UndecidedSpan",
    "Upright",
    "Within",
    "audit",
    "certify",
    "certify_program",
    "export_program",
    "is_proven_free",
    "read_points",
    "remove_body",
    "remove_robot",
    "sample_overlaps",
    "verify_proof",
    "with_movers",
]
