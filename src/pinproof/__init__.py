"""pinproof: kinematics, collision checking, planning and pick validation for robot arms, with verifiable results.

Names are imported at first use, so ``import pinproof`` is fast and loads only the packages that a program needs.
"""

from __future__ import annotations

import gc
import importlib
from typing import TYPE_CHECKING, Any

from pinproof import core_import

_HOME = {  # package: the names that the top level exports
    "pinproof.errors": "FileError InputError NoAnswer PinproofError UnknownNameError",
    "pinproof.spatial": "pose xyz_rpy",
    "pinproof.description": "DhRow DhTable",
    "pinproof.model": "Arm JointLimits Payload Robot assemble dh_to_urdf load_robot urdf_to_dh write_urdf",
    "pinproof.motion": "JointPath Trajectory time_parametrise",
    "pinproof.ik": "AnalyticIk Clik DampedLeastSquares Fabrik IkBatch IkResult PseudoInverse prove_unreachable track",
    "pinproof.collision": (
        "Box Capsule Certificate CertificateStatus CollisionChecker ConvexShape Cylinder HalfSpace Mesh "
        "Mover Obstacle OccupancyGrid PointCloud Scene Sphere Upright Within audit certify verify_proof"
    ),
    "pinproof.planning": ("MotionPlan PlanResult RrtConnect blend optimise plan plan_linear replan shortcut simplify"),
    "pinproof.tool_paths": "ToolPath follow",
    "pinproof.viewer": "show write_html write_png",
    "pinproof.execution": "Monitor MotionLibrary",
    "pinproof.picks": "Campaign Pick Picks reach_map read_picks screen_picks validate_picks",
    "pinproof.cell": "place_base sequence",
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names.split()}

__all__ = sorted([*_MODULE_OF, "__version__"])

_PACKAGES = (
    "cell",
    "collision",
    "description",
    "errors",
    "execution",
    "formats",
    "ik",
    "model",
    "motion",
    "picks",
    "planning",
    "spatial",
    "tool_paths",
    "verifier",
    "viewer",
)
"""Packages with further names, imported at first use: ``pp.picks.PickBudget``."""

if TYPE_CHECKING:
    from pinproof.cell import (
        place_base as place_base,
        sequence as sequence,
    )
    from pinproof.collision import (
        Box as Box,
        Capsule as Capsule,
        Certificate as Certificate,
        CertificateStatus as CertificateStatus,
        CollisionChecker as CollisionChecker,
        ConvexShape as ConvexShape,
        Cylinder as Cylinder,
        HalfSpace as HalfSpace,
        Mesh as Mesh,
        Mover as Mover,
        Obstacle as Obstacle,
        OccupancyGrid as OccupancyGrid,
        PointCloud as PointCloud,
        Scene as Scene,
        Sphere as Sphere,
        Upright as Upright,
        Within as Within,
        audit as audit,
        certify as certify,
        verify_proof as verify_proof,
    )
    from pinproof.description import DhRow as DhRow, DhTable as DhTable
    from pinproof.errors import (
        FileError as FileError,
        InputError as InputError,
        NoAnswer as NoAnswer,
        PinproofError as PinproofError,
        UnknownNameError as UnknownNameError,
    )
    from pinproof.execution import Monitor as Monitor, MotionLibrary as MotionLibrary
    from pinproof.ik import (
        AnalyticIk as AnalyticIk,
        Clik as Clik,
        DampedLeastSquares as DampedLeastSquares,
        Fabrik as Fabrik,
        IkBatch as IkBatch,
        IkResult as IkResult,
        PseudoInverse as PseudoInverse,
        prove_unreachable as prove_unreachable,
        track as track,
    )
    from pinproof.model import (
        Arm as Arm,
        JointLimits as JointLimits,
        Payload as Payload,
        Robot as Robot,
        assemble as assemble,
        dh_to_urdf as dh_to_urdf,
        load_robot as load_robot,
        urdf_to_dh as urdf_to_dh,
        write_urdf as write_urdf,
    )
    from pinproof.motion import JointPath as JointPath, Trajectory as Trajectory, time_parametrise as time_parametrise
    from pinproof.picks import (
        Campaign as Campaign,
        Pick as Pick,
        Picks as Picks,
        reach_map as reach_map,
        read_picks as read_picks,
        screen_picks as screen_picks,
        validate_picks as validate_picks,
    )
    from pinproof.planning import (
        MotionPlan as MotionPlan,
        PlanResult as PlanResult,
        RrtConnect as RrtConnect,
        blend as blend,
        optimise as optimise,
        plan as plan,
        plan_linear as plan_linear,
        replan as replan,
        shortcut as shortcut,
        simplify as simplify,
    )
    from pinproof.spatial import pose as pose, xyz_rpy as xyz_rpy
    from pinproof.tool_paths import ToolPath as ToolPath, follow as follow
    from pinproof.viewer import show as show, write_html as write_html, write_png as write_png


core_import.install()


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("pinproof")
    if name not in _PACKAGES and name not in _MODULE_OF:
        place = "" if name.startswith("_") else _where(name)
        raise AttributeError(f"module 'pinproof' has no attribute {name!r}{place}")
    # Modules keep what they create: garbage collections during the imports take a tenth of the time and free nothing.
    collecting = gc.isenabled()
    gc.disable()
    try:
        module = importlib.import_module(_MODULE_OF.get(name, f"pinproof.{name}"))
    finally:
        if collecting:
            gc.enable()
    if name in _PACKAGES:
        return module
    globals()[name] = value = getattr(module, name)
    return value


def _where(name: str) -> str:
    """The package that exports the name, or the most similar public names, as the end of a message."""
    import difflib

    places = {each: f"pp.{each}" for each in __all__}
    for package in _PACKAGES:
        for each in importlib.import_module(f"pinproof.{package}").__all__:
            places.setdefault(each, f"pp.{package}.{each}")
    similar = [name] if name in places else difflib.get_close_matches(name, places, 3)
    return f"; did you mean {' or '.join(places[each] for each in similar)}?" if similar else ""


def __dir__() -> list[str]:
    return sorted([*__all__, *_PACKAGES])
