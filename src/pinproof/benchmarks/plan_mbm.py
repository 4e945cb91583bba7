"""The problems of MotionBenchMaker: folders of planning scenes and motion plan requests as YAML.

A set is a folder of ``sceneNNNN.yaml`` (moveit_msgs/PlanningScene) with ``requestNNNN.yaml``
(moveit_msgs/MotionPlanRequest) beside them; it is called ``<set>``, or ``<set>_<robot>`` as its makers call it. What
else they put there (``scene_sensedNNNN.yaml``, ``pathNNNN.yaml``, ``config.yaml``) is left alone. A path may also be a
single set.

Source: C. Chamzas and others (2022), "MotionBenchMaker: a tool to generate and benchmark motion planning datasets",
RA-L; the layout is that of KavrakiLab/motion_bench_maker, ``src/setup.cpp``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.plan_problem import PlanProblem
from pinproof.collision import Scene
from pinproof.common.yaml_file import read_yaml
from pinproof.description.catalogue import catalogue_names
from pinproof.errors import FileError
from pinproof.model import Arm, Robot, load_robot

__all__ = ["COLLECTION", "MbmSet", "find_sets", "read_problems"]

Array = npt.NDArray[np.float64]

COLLECTION = "mbm"

SCENE = re.compile(r"scene(\d+)\.ya?ml")

ROUNDING = 1e-4
"""Rad or m by which a joint value of a file may be outside its limit, and is then put at it: files state limits to
about so many digits."""


@dataclass(frozen=True)
class MbmSet:
    """A set: its name without the robot's, its folder, the numbers of its problems, and the robot it is asked of."""

    name: str
    folder: Path
    numbers: tuple[int, ...]
    robot: str
    srdf: str | None

    @property
    def full_set(self) -> str:
        """``"mbm/shelf"``."""
        return f"{COLLECTION}/{self.name}"


def find_sets(path: str | Path, robot: str | None = None) -> list[MbmSet]:
    """The sets under a path, by name.

    Parameters
    ----------
    path
        A folder of sets, or a set.
    robot
        A catalogue name or a robot file. By default the URDF of a folder ``robot`` beside the sets, with the SRDF there
        is; without one, the catalogue's robot that the folder or its scenes name.

    Raises
    ------
    FileError
        If there is no set, or no robot for one.
    """
    path = Path(path)
    if not path.is_dir():
        raise FileError(path, "is no folder of MotionBenchMaker problems")
    folders = {folder: _numbers(folder) for folder in (path, *sorted(p for p in path.iterdir() if p.is_dir()))}
    folders = {folder: numbers for folder, numbers in folders.items() if numbers}
    if not folders:
        raise FileError(path, "holds no sceneNNNN.yaml with a requestNNNN.yaml, neither itself nor a folder in it")
    sets = []
    for folder, numbers in folders.items():
        name, named = _split(folder, numbers[0])
        source, srdf = (robot, None) if robot is not None else _robot_beside(folder) or (named, None)
        if source is None:
            raise FileError(folder, f"names no robot of the catalogue, and no URDF stands in {folder.parent / 'robot'}")
        sets.append(MbmSet(name, folder, numbers, source, srdf))
    return sets


def read_problems(found: MbmSet, most: int | None = None) -> Iterator[PlanProblem]:
    """The problems of a set in the order of their numbers, at most so many.

    Raises
    ------
    FileError
        For a file that cannot be used, or asks for what cannot be asked of the robot.
    """
    robot = load_robot(found.robot, srdf=found.srdf)
    for number in found.numbers[:most]:
        scene, request = _file(found.folder, "scene", number), _file(found.folder, "request", number)
        yield _problem(found, number, robot, Scene.load(scene), request)


def _problem(found: MbmSet, number: int, robot: Robot, scene: Scene, path: Path) -> PlanProblem:
    request = read_yaml(path, ("start_state", "goal_constraints"), FileError)
    try:
        state = request["start_state"]
        start = _by_name(state["joint_state"]["name"], state["joint_state"]["position"])
        goals = [_goal(path, goal) for goal in request["goal_constraints"]]
        floating = [
            value
            for placed in (state.get("multi_dof_joint_state") or {}).get("transforms") or []
            for value in (*_numbers_of(placed["translation"], "xyz"), *_numbers_of(placed["rotation"], "xyz"))
        ]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileError(path, f"is not laid out as moveit_msgs/MotionPlanRequest: {error}") from error
    if any(floating):
        raise FileError(path, "moves the robot's base by a floating joint, which is not read", "start_state")
    if not goals:
        raise FileError(path, "has no goal", "goal_constraints")
    unknown = sorted({name for goal in goals for name in goal} - set(robot.urdf.joints))
    if unknown:
        raise FileError(path, f"asks for the joints {', '.join(unknown)}, which {robot.name!r} does not have")
    arm, notes = _arm(robot, str(request.get("group_name", "")), start, goals[0])
    limits = arm.limits
    rows = []
    for where, values in (("start_state", start), *(("goal_constraints", goal) for goal in goals)):
        missing = [name for name in arm.joint_names if name not in values]
        if missing:
            raise FileError(path, f"says nothing about the joints {', '.join(missing)} of {robot.name!r}", where)
        q = np.array([values[name] for name in arm.joint_names])
        inside = limits.clip(q)
        rows.append(np.where(np.abs(inside - q) <= ROUNDING, inside, q))
    return PlanProblem(COLLECTION, found.name, number, arm, scene, rows[0], np.array(rows[1:]), notes)


def _goal(path: Path, stated: Mapping[str, Any]) -> dict[str, float]:
    others = [key for key, value in stated.items() if key.endswith("_constraints") and value]
    if others != ["joint_constraints"]:
        raise FileError(path, f"has goals as {', '.join(others) or 'nothing'}; read are joint_constraints only")
    joints = stated["joint_constraints"]
    return _by_name([joint["joint_name"] for joint in joints], [joint["position"] for joint in joints])


def _by_name(names: Sequence[str], values: Sequence[float]) -> dict[str, float]:
    return {str(name): float(value) for name, value in zip(names, values, strict=True)}


def _numbers_of(stated: Any, keys: str) -> list[float]:
    """The first numbers of a vector or quaternion, written as a list or by key."""
    values = [stated[key] for key in keys] if isinstance(stated, Mapping) else list(stated)[: len(keys)]
    return [float(value) for value in values]


def _arm(
    robot: Robot, group: str, start: Mapping[str, float], goal: Mapping[str, float]
) -> tuple[Arm, tuple[str, ...]]:
    """The arm that a request is about, its other joints held where the request starts, and what that changed.

    The arm is the group; where the SRDF knows none of that name, it ends with the last joint of the goal.
    """
    if group in robot.srdf.groups:
        free = robot.arm(group=group)
    else:
        links = [robot.urdf.joints[name].child for name in goal]
        free = robot.arm(max(links, key=lambda link: _joints_above(robot, link)))
    held, notes = {}, []
    for name, value in start.items():
        joint = robot.urdf.joints.get(name)
        if joint is None or name in free.joint_names or name in free.followers:
            continue
        if joint.type == "fixed" or joint.mimic is not None:
            continue
        lower = -np.inf if joint.lower is None else joint.lower
        upper = np.inf if joint.upper is None else joint.upper
        held[name] = float(np.clip(value, lower, upper))
        if abs(held[name] - value) > ROUNDING:
            notes.append(f"{name} is held at {held[name]:g}, its limit, not at {value:g}")
    return robot.arm(free.tcp, base=free.base, held=held), tuple(notes)


def _joints_above(robot: Robot, link: str) -> int:
    count = 0
    while (joint := robot.urdf.parent_joint(link)) is not None:
        link, count = joint.parent, count + 1
    return count


def _numbers(folder: Path) -> tuple[int, ...]:
    """The numbers of the problems in a folder: those that have a scene and a request."""
    found = [match for file in folder.iterdir() if (match := SCENE.fullmatch(file.name))]
    return tuple(sorted(int(match[1]) for match in found if _exists(folder, "request", match[1])))


def _exists(folder: Path, kind: str, digits: str) -> bool:
    return any((folder / f"{kind}{digits}{suffix}").is_file() for suffix in (".yaml", ".yml"))


def _file(folder: Path, kind: str, number: int) -> Path:
    """The file of a problem, whatever its number of zeros."""
    same = re.compile(rf"{kind}0*{number}\.ya?ml")
    return next(file for file in sorted(folder.iterdir()) if same.fullmatch(file.name))


def _split(folder: Path, number: int) -> tuple[str, str | None]:
    """The name of a set, and the catalogue's robot that its folder or its first scene names, if any."""
    name, _, last = folder.resolve().name.rpartition("_")
    content = read_yaml(_file(folder, "scene", number), ("world",), FileError)
    model = str(content.get("robot_model_name", ""))
    if name and last and last in (*catalogue_names(), model):
        return name, last if last in catalogue_names() else None
    return folder.resolve().name, model if model in catalogue_names() else None


def _robot_beside(folder: Path) -> tuple[str, str | None] | None:
    """The URDF, and the SRDF if any, of a folder ``robot`` beside a set or in it."""
    for place in (folder / "robot", folder.resolve().parent / "robot"):
        urdfs = sorted(place.glob("*.urdf")) if place.is_dir() else []
        if len(urdfs) > 1:
            raise FileError(place, f"holds several robots ({', '.join(file.name for file in urdfs)}); name one")
        if urdfs:
            srdfs = sorted(place.glob("*.srdf"))
            return str(urdfs[0]), str(srdfs[0]) if len(srdfs) == 1 else None
    return None
