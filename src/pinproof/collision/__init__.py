"""Collision: shapes, scenes, the checker, and certificates that hold between samples (coal)."""

from pinproof.collision.certificates.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    MotionTube,
    Parting,
    UndecidedSpan,
)
from pinproof.collision.certificates.certify import certify, is_proven_free
from pinproof.collision.certificates.identity import missing_since, notes_of
from pinproof.collision.certificates.path_constraints import (
    ConstraintProof,
    ConstraintViolation,
    LookAt,
    PathConstraint,
    UndecidedConstraint,
    Upright,
    Within,
)
from pinproof.collision.certificates.program_proof import (
    ProgramCertificate,
    ProgramPart,
    certify_program,
    export_program,
)
from pinproof.collision.certificates.proof_comparison import verify_proof
from pinproof.collision.checking.audit import AuditResult, audit
from pinproof.collision.checking.checker import CheckResult, CollisionChecker, Contact, overlap_hint
from pinproof.collision.checking.movers import Mover, TimedScene, with_movers
from pinproof.collision.checking.overlaps import LinkOverlap, OverlapReport, sample_overlaps
from pinproof.collision.checking.pairs import ExcludedPair
from pinproof.collision.checking.sensor_removal import remove_body, remove_robot
from pinproof.collision.checking.spec import CheckerSpec
from pinproof.collision.geometry.depth_image import DepthView, Intrinsics
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.sensor_files import read_points
from pinproof.collision.geometry.shapes import (
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
from pinproof.collision.scenes.scene import Attachments, Scene

__all__ = [
    "Attachments",
    "AuditResult",
    "Box",
    "Capsule",
    "Certificate",
    "CertificateStatus",
    "CheckResult",
    "CheckerSpec",
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
    "missing_since",
    "notes_of",
    "overlap_hint",
    "read_points",
    "remove_body",
    "remove_robot",
    "sample_overlaps",
    "verify_proof",
    "with_movers",
]
