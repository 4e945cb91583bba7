"""pinproof: can this arm make this pick, and how? Answered with proof.

Names are loaded at first use, so ``import pinproof`` is quick and pulls in only what a program touches.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

_HOME = {
    "pinproof.errors": (
        "CampaignError",
        "ConversionError",
        "DhTableError",
        "FileError",
        "IkFailed",
        "InputError",
        "MeshError",
        "NoAnswer",
        "NoClosedForm",
        "NotProvenFree",
        "PicksError",
        "PinproofError",
        "PlanFailed",
        "SceneError",
        "TimingError",
        "TrajectoryError",
        "UnknownNameError",
        "UrdfError",
        "ViewerError",
    ),
    "pinproof.verifier": ("ProofVerdict",),
    "pinproof.spatial": ("pose", "xyz_rpy"),
    "pinproof.description": ("DhRow", "DhTable"),
    "pinproof.model": (
        "Arm",
        "JointLimits",
        "LimitsFile",
        "Robot",
        "RobotInfo",
        "describe",
        "load_limits",
        "load_robot",
    ),
    "pinproof.conversion": ("dh_to_urdf", "urdf_to_dh", "write_urdf"),
    "pinproof.motion": ("BlendedPath", "CubicPath", "JointPath", "MotionRecord", "Trajectory", "time_parametrise"),
    "pinproof.ik": (
        "AnalyticIk",
        "Clik",
        "DampedLeastSquares",
        "Fabrik",
        "IkBatch",
        "IkBranches",
        "IkFamily",
        "IkGoal",
        "IkResult",
        "IkStatus",
        "IkTask",
        "PseudoInverse",
        "Track",
        "Tracker",
        "track",
    ),
    "pinproof.collision": (
        "Attachments",
        "Audit",
        "Box",
        "Capsule",
        "Certificate",
        "CertificateStatus",
        "CheckResult",
        "CollisionChecker",
        "Cone",
        "ConvexHull",
        "Cylinder",
        "Ellipsoid",
        "HalfSpace",
        "HeightMap",
        "Mesh",
        "Obstacle",
        "PointCloud",
        "Scene",
        "Sphere",
        "Tube",
        "audit",
        "certify",
        "verify_proof",
    ),
    "pinproof.planning": (
        "LinearMove",
        "OmplPlanner",
        "PlanProgress",
        "PlanResult",
        "PlanStatus",
        "PosesMove",
        "RrtConnect",
        "Simplified",
        "blend",
        "ompl_planners",
        "plan_linear",
        "plan_poses",
        "shortcut",
        "simplify",
    ),
    "pinproof.viewer": ("ColouredPoints", "show", "write_html", "write_png"),
    "pinproof.picks": (
        "Campaign",
        "CampaignResult",
        "FingerContact",
        "Fingers",
        "GripLimits",
        "GripResult",
        "NamedFrame",
        "Pick",
        "PickBudget",
        "PickGrid",
        "PickMotion",
        "PickReport",
        "PickScreen",
        "PickSetup",
        "PickTable",
        "PickVerdict",
        "PickWeights",
        "Picks",
        "Place",
        "ReachChange",
        "ReachMap",
        "Region",
        "ScreenStatus",
        "Spin",
        "Tolerance",
        "approach_directions",
        "open_picks",
        "reach_map",
        "read_picks",
        "screen_picks",
        "tool_orientations",
        "validate_picks",
        "write_report_page",
    ),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = sorted([*_MODULE_OF, "__version__"])

if TYPE_CHECKING:
    from pinproof.collision import *  # noqa: F403
    from pinproof.conversion import *  # noqa: F403
    from pinproof.description import *  # noqa: F403
    from pinproof.errors import *  # noqa: F403
    from pinproof.ik import *  # noqa: F403
    from pinproof.model import *  # noqa: F403
    from pinproof.motion import *  # noqa: F403
    from pinproof.picks import *  # noqa: F403
    from pinproof.planning import *  # noqa: F403
    from pinproof.spatial import *  # noqa: F403
    from pinproof.verifier import *  # noqa: F403
    from pinproof.viewer import *  # noqa: F403


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("pinproof")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'pinproof' has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
