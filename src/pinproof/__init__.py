"""pinproof: kinematics, collision checking, planning and pick validation for robot arms, with verifiable results.

Names are imported at first use, so ``import pinproof`` is fast and loads only the packages that a program needs.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

_HOME = {  # package: the names that the top level exports
    "pinproof.errors": (
        "FileError",
        "InputError",
        "NoAnswer",
        "PinproofError",
        "UnknownNameError",
    ),
    "pinproof.spatial": ("pose", "xyz_rpy"),
    "pinproof.description": ("DhRow", "DhTable"),
    "pinproof.model": (
        "Arm",
        "JointLimits",
        "Robot",
        "load_robot",
    ),
    "pinproof.conversion": ("dh_to_urdf", "urdf_to_dh", "write_urdf"),
    "pinproof.motion": ("JointPath", "Trajectory", "time_parametrise"),
    "pinproof.ik": (
        "AnalyticIk",
        "Clik",
        "DampedLeastSquares",
        "Fabrik",
        "IkBatch",
        "IkBranches",
        "IkGoal",
        "IkResult",
        "IkStatus",
        "IkTask",
        "PseudoInverse",
        "TrackResult",
        "Tracker",
        "track",
    ),
    "pinproof.collision": (
        "Box",
        "Capsule",
        "Certificate",
        "CertificateStatus",
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
        "audit",
        "certify",
        "verify_proof",
    ),
    "pinproof.planning": (
        "OmplPlanner",
        "PlanResult",
        "PlanStatus",
        "RrtConnect",
        "blend",
        "plan_linear",
        "plan_poses",
        "shortcut",
        "simplify",
    ),
    "pinproof.viewer": ("show", "write_html", "write_png"),
    "pinproof.picks": (
        "Campaign",
        "Pick",
        "PickReport",
        "PickVerdict",
        "Picks",
        "ReachMap",
        "reach_map",
        "read_picks",
        "screen_picks",
        "validate_picks",
    ),
    "pinproof.formats": ("file_schema",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = sorted([*_MODULE_OF, "__version__"])

_PACKAGES = ("collision", "errors", "formats", "ik", "model", "motion", "picks", "planning", "verifier", "viewer")
"""Packages with further names, imported at first use: ``pp.picks.PickBudget``."""

if TYPE_CHECKING:
    from pinproof.collision import (
        Box as Box,
    )
    from pinproof.collision import (
        Capsule as Capsule,
    )
    from pinproof.collision import (
        Certificate as Certificate,
    )
    from pinproof.collision import (
        CertificateStatus as CertificateStatus,
    )
    from pinproof.collision import (
        CollisionChecker as CollisionChecker,
    )
    from pinproof.collision import (
        Cone as Cone,
    )
    from pinproof.collision import (
        ConvexHull as ConvexHull,
    )
    from pinproof.collision import (
        Cylinder as Cylinder,
    )
    from pinproof.collision import (
        Ellipsoid as Ellipsoid,
    )
    from pinproof.collision import (
        HalfSpace as HalfSpace,
    )
    from pinproof.collision import (
        HeightMap as HeightMap,
    )
    from pinproof.collision import (
        Mesh as Mesh,
    )
    from pinproof.collision import (
        Obstacle as Obstacle,
    )
    from pinproof.collision import (
        PointCloud as PointCloud,
    )
    from pinproof.collision import (
        Scene as Scene,
    )
    from pinproof.collision import (
        Sphere as Sphere,
    )
    from pinproof.collision import (
        audit as audit,
    )
    from pinproof.collision import (
        certify as certify,
    )
    from pinproof.collision import (
        verify_proof as verify_proof,
    )
    from pinproof.conversion import dh_to_urdf as dh_to_urdf
    from pinproof.conversion import urdf_to_dh as urdf_to_dh
    from pinproof.conversion import write_urdf as write_urdf
    from pinproof.description import DhRow as DhRow
    from pinproof.description import DhTable as DhTable
    from pinproof.errors import (
        FileError as FileError,
    )
    from pinproof.errors import (
        InputError as InputError,
    )
    from pinproof.errors import (
        NoAnswer as NoAnswer,
    )
    from pinproof.errors import (
        PinproofError as PinproofError,
    )
    from pinproof.errors import (
        UnknownNameError as UnknownNameError,
    )
    from pinproof.formats import (
        file_schema as file_schema,
    )
    from pinproof.ik import (
        AnalyticIk as AnalyticIk,
    )
    from pinproof.ik import (
        Clik as Clik,
    )
    from pinproof.ik import (
        DampedLeastSquares as DampedLeastSquares,
    )
    from pinproof.ik import (
        Fabrik as Fabrik,
    )
    from pinproof.ik import (
        IkBatch as IkBatch,
    )
    from pinproof.ik import (
        IkBranches as IkBranches,
    )
    from pinproof.ik import (
        IkGoal as IkGoal,
    )
    from pinproof.ik import (
        IkResult as IkResult,
    )
    from pinproof.ik import (
        IkStatus as IkStatus,
    )
    from pinproof.ik import (
        IkTask as IkTask,
    )
    from pinproof.ik import (
        PseudoInverse as PseudoInverse,
    )
    from pinproof.ik import (
        Tracker as Tracker,
    )
    from pinproof.ik import (
        TrackResult as TrackResult,
    )
    from pinproof.ik import (
        track as track,
    )
    from pinproof.model import Arm as Arm
    from pinproof.model import JointLimits as JointLimits
    from pinproof.model import Robot as Robot
    from pinproof.model import load_robot as load_robot
    from pinproof.motion import JointPath as JointPath
    from pinproof.motion import Trajectory as Trajectory
    from pinproof.motion import time_parametrise as time_parametrise
    from pinproof.picks import (
        Campaign as Campaign,
    )
    from pinproof.picks import (
        Pick as Pick,
    )
    from pinproof.picks import (
        PickReport as PickReport,
    )
    from pinproof.picks import (
        Picks as Picks,
    )
    from pinproof.picks import (
        PickVerdict as PickVerdict,
    )
    from pinproof.picks import (
        ReachMap as ReachMap,
    )
    from pinproof.picks import (
        reach_map as reach_map,
    )
    from pinproof.picks import (
        read_picks as read_picks,
    )
    from pinproof.picks import (
        screen_picks as screen_picks,
    )
    from pinproof.picks import (
        validate_picks as validate_picks,
    )
    from pinproof.planning import (
        OmplPlanner as OmplPlanner,
    )
    from pinproof.planning import (
        PlanResult as PlanResult,
    )
    from pinproof.planning import (
        PlanStatus as PlanStatus,
    )
    from pinproof.planning import (
        RrtConnect as RrtConnect,
    )
    from pinproof.planning import (
        blend as blend,
    )
    from pinproof.planning import (
        plan_linear as plan_linear,
    )
    from pinproof.planning import (
        plan_poses as plan_poses,
    )
    from pinproof.planning import (
        shortcut as shortcut,
    )
    from pinproof.planning import (
        simplify as simplify,
    )
    from pinproof.spatial import pose as pose
    from pinproof.spatial import xyz_rpy as xyz_rpy
    from pinproof.viewer import show as show
    from pinproof.viewer import write_html as write_html
    from pinproof.viewer import write_png as write_png


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("pinproof")
    if name in _PACKAGES:
        return importlib.import_module(f"pinproof.{name}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'pinproof' has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
