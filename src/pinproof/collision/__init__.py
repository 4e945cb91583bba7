"""Collision: shapes, scenes, the checker, and certificates that hold between samples (coal)."""

from pinproof.collision.certificates.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    MotionTube,
    Parting,
    Setup,
    UndecidedSpan,
    curve_hash,
    missing_since,
    proven_millimetres,
    setup_of,
)
from pinproof.collision.certificates.certify import certify, is_proven_free
from pinproof.collision.certificates.path_constraints import (
    SMALLEST,
    ConstraintProof,
    ConstraintViolation,
    LookAt,
    PathConstraint,
    UndecidedConstraint,
    Upright,
    Within,
    amount,
    check_constraints,
)
from pinproof.collision.certificates.program_proof import (
    ProgramCertificate,
    ProgramPart,
    certify_program,
    export_program,
    feasible,
    speed_violations,
    unknown_speeds,
)
from pinproof.collision.certificates.proof_file import verify_proof
from pinproof.collision.certificates.reuse import SetupChange, StoredProof
from pinproof.collision.checking.assembly import only_arm
from pinproof.collision.checking.audit import AuditResult, audit
from pinproof.collision.checking.checker import (
    CheckResult,
    CollisionChecker,
    Contact,
    overlap_hint,
    require_curve,
)
from pinproof.collision.checking.line_surface import (
    MOST_ADVANCES,
    TOUCH,
    LineSurface,
    SurfacePoints,
    body_distance,
    depth_along,
    outer_points,
    point_distance,
    travel_to_touch,
)
from pinproof.collision.checking.links import KINDS, LinkOverlap, OverlapReport, link_bodies, sample_overlaps
from pinproof.collision.checking.movers import Mover, TimedScene, with_movers
from pinproof.collision.checking.pairs import ExcludedPair
from pinproof.collision.checking.penetration import penetration
from pinproof.collision.checking.placed_bodies import GJK_SLACK, MeasureByCoal
from pinproof.collision.checking.sensor_removal import remove_body, remove_robot
from pinproof.collision.checking.separation import directions_to_facets
from pinproof.collision.checking.spec import CheckerSpec, checked_margin, files_examined_once
from pinproof.collision.geometry.bodies import Body, triangles_of
from pinproof.collision.geometry.depth_image import DepthView, Intrinsics, read_points
from pinproof.collision.geometry.hulls import connected_parts, hull_triangles, rounded_corners, spiral_directions
from pinproof.collision.geometry.inner_shapes import inner_shapes
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.shapes import (
    Box,
    Capsule,
    Cone,
    ConvexShape,
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
from pinproof.collision.geometry.surfaces import cell_faces, ground_surface
from pinproof.collision.moveit import moveit_message, read_moveit_message
from pinproof.collision.scene import Attachments, Scene

__all__ = [
    "GJK_SLACK",
    "KINDS",
    "MOST_ADVANCES",
    "SMALLEST",
    "TOUCH",
    "Attachments",
    "AuditResult",
    "Body",
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
    "ConvexShape",
    "Cylinder",
    "DepthView",
    "Ellipsoid",
    "ExcludedPair",
    "FirstContact",
    "HalfSpace",
    "HeightMap",
    "Intrinsics",
    "LineSurface",
    "LinkOverlap",
    "LookAt",
    "MeasureByCoal",
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
    "Setup",
    "SetupChange",
    "Shape",
    "Sphere",
    "StoredProof",
    "SurfacePoints",
    "TimedScene",
    "UndecidedConstraint",
    "UndecidedSpan",
    "Upright",
    "Within",
    "amount",
    "audit",
    "body_distance",
    "cell_faces",
    "certify",
    "certify_program",
    "check_constraints",
    "checked_margin",
    "connected_parts",
    "curve_hash",
    "depth_along",
    "directions_to_facets",
    "export_program",
    "feasible",
    "files_examined_once",
    "ground_surface",
    "hull_triangles",
    "inner_shapes",
    "is_proven_free",
    "link_bodies",
    "missing_since",
    "moveit_message",
    "only_arm",
    "outer_points",
    "overlap_hint",
    "penetration",
    "point_distance",
    "proven_millimetres",
    "read_moveit_message",
    "read_points",
    "remove_body",
    "remove_robot",
    "require_curve",
    "rounded_corners",
    "sample_overlaps",
    "setup_of",
    "speed_violations",
    "spiral_directions",
    "travel_to_touch",
    "triangles_of",
    "unknown_speeds",
    "verify_proof",
    "with_movers",
]
