"""Collision: shapes, scenes, the checker, and certificates that hold between samples (coal)."""

from pinproof.collision.certificates.certificate import (
    Certificate as Certificate,
    CertificateStatus as CertificateStatus,
    FirstContact as FirstContact,
    MotionTube as MotionTube,
    Parting as Parting,
    Setup as Setup,
    UndecidedSpan as UndecidedSpan,
    curve_hash as curve_hash,
    missing_since as missing_since,
    proven_millimetres as proven_millimetres,
    setup_of as setup_of,
)
from pinproof.collision.certificates.certify import certify as certify, is_proven_free as is_proven_free
from pinproof.collision.certificates.path_constraints import (
    SMALLEST as SMALLEST,
    ConstraintProof as ConstraintProof,
    ConstraintViolation as ConstraintViolation,
    LookAt as LookAt,
    PathConstraint as PathConstraint,
    UndecidedConstraint as UndecidedConstraint,
    Upright as Upright,
    Within as Within,
    amount as amount,
    check_constraints as check_constraints,
    held_together as held_together,
)
from pinproof.collision.certificates.linear_traces import (
    LineTrace as LineTrace,
    interpolation_difference as interpolation_difference,
    trace_line as trace_line,
)
from pinproof.collision.certificates.program_limits import (
    arm_faults as arm_faults,
    outside_limits as outside_limits,
    overlaps as overlaps,
    shortest_durations as shortest_durations,
    speed_violations as speed_violations,
    unknown_speeds as unknown_speeds,
)
from pinproof.collision.certificates.program_moves import (
    COVERED as COVERED,
    SAMPLES as SAMPLES,
    BlendedMoves as BlendedMoves,
    EndLine as EndLine,
    blended_moves as blended_moves,
    moves_between_rests as moves_between_rests,
    timed_step as timed_step,
    zone_proven as zone_proven,
)
from pinproof.collision.certificates.program_parts import (
    ExecutedPart as ExecutedPart,
    executed_parts as executed_parts,
    program_motions as program_motions,
    traced as traced,
)
from pinproof.collision.certificates.program_proof import (
    ProgramCertificate as ProgramCertificate,
    ProgramPart as ProgramPart,
    certify_program as certify_program,
    export_program as export_program,
)
from pinproof.collision.certificates.proof_file import verify_proof as verify_proof
from pinproof.collision.certificates.reuse import SetupChange as SetupChange, StoredProof as StoredProof
from pinproof.collision.checking.assembly import only_arm as only_arm
from pinproof.collision.checking.audit import AuditResult as AuditResult, audit as audit
from pinproof.collision.checking.checker import (
    CheckResult as CheckResult,
    CollisionChecker as CollisionChecker,
    Contact as Contact,
    overlap_hint as overlap_hint,
    require_curve as require_curve,
)
from pinproof.collision.checking.line_surface import (
    MOST_ADVANCES as MOST_ADVANCES,
    TOUCH as TOUCH,
    LineSurface as LineSurface,
    SurfacePoints as SurfacePoints,
    body_distance as body_distance,
    depth_along as depth_along,
    outer_points as outer_points,
    point_distance as point_distance,
    travel_to_touch as travel_to_touch,
)
from pinproof.collision.checking.links import (
    KINDS as KINDS,
    LinkOverlap as LinkOverlap,
    OverlapReport as OverlapReport,
    link_bodies as link_bodies,
    sample_overlaps as sample_overlaps,
)
from pinproof.collision.checking.movers import Mover as Mover, TimedScene as TimedScene, with_movers as with_movers
from pinproof.collision.checking.pairs import ExcludedPair as ExcludedPair
from pinproof.collision.checking.penetration import penetration as penetration
from pinproof.collision.checking.placed_bodies import GJK_SLACK as GJK_SLACK, MeasureByCoal as MeasureByCoal
from pinproof.collision.checking.sensor_removal import remove_body as remove_body, remove_robot as remove_robot
from pinproof.collision.checking.separation import directions_to_facets as directions_to_facets
from pinproof.collision.checking.spec import (
    CheckerSpec as CheckerSpec,
    checked_margin as checked_margin,
    files_examined_once as files_examined_once,
    margins_of as margins_of,
)
from pinproof.collision.geometry.bodies import Body as Body, triangles_of as triangles_of
from pinproof.collision.geometry.depth_image import (
    DepthView as DepthView,
    Intrinsics as Intrinsics,
    read_points as read_points,
)
from pinproof.collision.geometry.hulls import (
    connected_parts as connected_parts,
    hull_triangles as hull_triangles,
    rounded_corners as rounded_corners,
    spiral_directions as spiral_directions,
)
from pinproof.collision.geometry.inner_shapes import inner_shapes as inner_shapes
from pinproof.collision.geometry.occupancy import OccupancyGrid as OccupancyGrid
from pinproof.collision.geometry.shapes import (
    Box as Box,
    Capsule as Capsule,
    Cone as Cone,
    ConvexShape as ConvexShape,
    Cylinder as Cylinder,
    Ellipsoid as Ellipsoid,
    HalfSpace as HalfSpace,
    HeightMap as HeightMap,
    Mesh as Mesh,
    Obstacle as Obstacle,
    PointCloud as PointCloud,
    Shape as Shape,
    Sphere as Sphere,
)
from pinproof.collision.geometry.surfaces import cell_faces as cell_faces, ground_surface as ground_surface
from pinproof.collision.moveit import moveit_message as moveit_message, read_moveit_message as read_moveit_message
from pinproof.collision.scene import (
    MARGIN as MARGIN,
    PAIR_MARGINS as PAIR_MARGINS,
    Attachments as Attachments,
    PairMargin as PairMargin,
    Scene as Scene,
)
from pinproof.common import faces

__all__ = faces.exported(globals())
