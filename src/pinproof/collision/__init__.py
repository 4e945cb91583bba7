"""Collision: shapes, scenes, the checker, and certificates that hold between samples (coal)."""

from pinproof.collision.attachments import Attachments
from pinproof.collision.audit import Audit, audit
from pinproof.collision.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    Parting,
    Tube,
    UndecidedSpan,
)
from pinproof.collision.certify import certify, is_proven_free
from pinproof.collision.checker import CollisionChecker
from pinproof.collision.contact import CheckResult, Contact
from pinproof.collision.pairs import ExcludedPair
from pinproof.collision.proof_check import verify_proof
from pinproof.collision.scene import Obstacle, Scene
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
    PointCloud,
    Shape,
    Sphere,
)

__all__ = [
    "Attachments",
    "Audit",
    "Box",
    "Capsule",
    "Certificate",
    "CertificateStatus",
    "CheckResult",
    "CollisionChecker",
    "Cone",
    "Contact",
    "ConvexHull",
    "Cylinder",
    "Ellipsoid",
    "ExcludedPair",
    "FirstContact",
    "HalfSpace",
    "HeightMap",
    "Mesh",
    "Obstacle",
    "Parting",
    "PointCloud",
    "Scene",
    "Shape",
    "Sphere",
    "Tube",
    "UndecidedSpan",
    "audit",
    "certify",
    "is_proven_free",
    "verify_proof",
]
