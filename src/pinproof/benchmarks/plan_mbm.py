"""Reader for MotionBenchMaker problems: folders of planning scenes and motion plan requests as YAML.

A set is a folder of ``sceneNNNN.yaml`` (moveit_msgs/PlanningScene) with ``requestNNNN.yaml``
(moveit_msgs/MotionPlanRequest) beside them; its name is ``<set>``, or ``<set>_<robot>`` as in the original data. Other
files (``scene_sensedNNNN.yaml``, ``pathNNNN.yaml``, ``config.yaml``) are ignored. A path may also be a single set.

Source: C. Chamzas and others (2022), "MotionBenchMaker: a tool to generate and benchmark motion planning datasets",
RA-L; the layout is that of KavrakiLab/motion_bench_maker, ``src/setup.cpp``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.benchmarks.plan_problems import PlanProblem
from pinproof.collision import Scene
from pinproof.common.yaml_file import read_yaml
from pinproof.description.catalogue import catalogue_names
from pinproof.errors import FileError
from pinproof.model import JointGroup, Robot, load_robot
from pinproof.model.chain import link_path

COLLECTION = "mbm"

FILE_NAME = re.compile(r"(scene|request)(\d+)\.ya?ml")

ROUNDING = 1e-4
"""Rad or m by which a joint value of a file may exceed its limit; it is then set to the limit. The files round limits
to about this precision."""


@dataclass(frozen=True)
class MbmSet:
    """A set: its name without the robot, the scene and request files of its problems by number, and its robot."""

    name: str
    files: dict[int, tuple[Path, Path]]
    robot: str
    srdf: str | None

    @property
    def full_set(self) -> str:
        """``"mbm/shelf"``."""
        return f"{COLLECTION}/{self.name}"


def find_sets(path: str | Path, robot: str | None = None) -> list[MbmSet]:
    """Find the sets in a folder of sets, or a single set; FileError if no set is found, or one without a robot.

    ``robot`` is a catalogue name or a robot file. By default, it is the URDF (with its SRDF) in a folder ``robot``
    beside the sets, otherwise the catalogue robot that the folder or its scenes name.
    """
    path = Path(path)
    if not path.is_dir():
        raise FileError(path, "is not a folder")
    sets = []
    for folder in (path, *sorted(p for p in path.iterdir() if p.is_dir())):
        files = _problem_files(folder)
        if not files:
            continue
        name, named = _split(folder, next(iter(files.values()))[0])
        source, srdf = (robot, None) if robot is not None else _robot_beside(folder) or (named, None)
        if source is None:
            raise FileError(folder, f"names no catalogue robot, and {folder.parent / 'robot'} contains no URDF")
        sets.append(MbmSet(name, files, source, srdf))
    if not sets:
        raise FileError(path, "contains no sceneNNNN.yaml with a requestNNNN.yaml, also not in its subfolders")
    return sets


def read_problems(found: MbmSet, most: int | None = None, *, as_stated: bool = False) -> Iterator[PlanProblem]:
    """Read the problems of a set in the order of their numbers, at most ``most``.

    Joints that are not planned, such as fingers, are held at the values of the files; beyond their limits only if
    ``as_stated``, otherwise at the limits. FileError is raised if a file cannot be read or does not fit the robot.
    """
    robot = load_robot(found.robot, srdf=found.srdf)
    for number, (scene, request) in islice(found.files.items(), most):
        yield _problem(found, number, robot, Scene.load(scene), request, as_stated)


def _problem(found: MbmSet, number: int, robot: Robot, scene: Scene, path: Path, as_stated: bool) -> PlanProblem:
    request = read_yaml(path, ("start_state", "goal_constraints"), FileError)
    try:
        state = request["start_state"]
        start = _by_name(state["joint_state"]["name"], state["joint_state"]["position"])
        goals = [_goal(path, goal) for goal in request["goal_constraints"]]
        placed = (state.get("multi_dof_joint_state") or {}).get("transforms") or []
        floating = [x for each in placed for part in ("translation", "rotation") for x in _vector_part(each[part])]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileError(path, f"is not a moveit_msgs/MotionPlanRequest: {error}") from error
    if any(floating):
        raise FileError(path, "moves the base of the robot by a floating joint, which is not supported", "start_state")
    if not goals:
        raise FileError(path, "has no goal", "goal_constraints")
    unknown = sorted({name for goal in goals for name in goal} - set(robot.urdf.joints))
    if unknown:
        raise FileError(path, f"names the joints {', '.join(unknown)}, which {robot.name!r} does not have")
    group, notes = _group(robot, str(request.get("group_name", "")), start, goals[0], as_stated)
    limits = group.limits
    rows = []
    for where, values in (("start_state", start), *(("goal_constraints", goal) for goal in goals)):
        missing = [name for name in group.joint_names if name not in values]
        if missing:
            raise FileError(path, f"does not state the joints {', '.join(missing)} of {robot.name!r}", where)
        q = np.array([values[name] for name in group.joint_names])
        inside = limits.clip(q)
        rows.append(np.where(np.abs(inside - q) <= ROUNDING, inside, q))
    return PlanProblem(COLLECTION, found.name, number, group, scene, rows[0], np.array(rows[1:]), notes)


def _goal(path: Path, stated: Mapping[str, Any]) -> dict[str, float]:
    others = [key for key, value in stated.items() if key.endswith("_constraints") and value]
    if others != ["joint_constraints"]:
        raise FileError(path, f"states goals as {', '.join(others) or 'nothing'}; only joint_constraints are supported")
    joints = stated["joint_constraints"]
    return _by_name([joint["joint_name"] for joint in joints], [joint["position"] for joint in joints])


def _by_name(names: Sequence[str], values: Sequence[float]) -> dict[str, float]:
    return {str(name): float(value) for name, value in zip(names, values, strict=True)}


def _vector_part(stated: Any) -> list[float]:
    """x, y and z of a vector or quaternion, given as a list or by key; all are 0 for the identity."""
    return [float(stated[key]) for key in ("xyz" if isinstance(stated, Mapping) else range(3))]


def _group(
    robot: Robot, group: str, start: Mapping[str, float], goal: Mapping[str, float], as_stated: bool
) -> tuple[JointGroup, tuple[str, ...]]:
    """The joints of a request, with the other joints of the robot held at the start state, and notes on changed values.

    They are the arm of the group of the request; if the SRDF does not define it, or it is not a chain, an arm ends at
    each joint of the goal below which no joint of the goal is.
    """
    urdf = robot.urdf
    above = {each.name for name in goal for each in link_path(urdf, urdf.root, urdf.joints[name].parent)}
    tips = [urdf.joints[name].child for name in goal if name not in above]
    if len(tips) > 1:
        free: JointGroup = robot.arms(*tips)
    else:
        free = robot.arm(group=group) if group in robot.srdf.groups else robot.arm(tips[0])
    held, notes = {}, []
    for name, value in start.items():
        joint = urdf.joints.get(name)
        if joint is None or joint.type == "fixed" or joint.mimic or name in (*free.joint_names, *free.followers):
            continue
        lower = -np.inf if joint.lower is None else joint.lower
        upper = np.inf if joint.upper is None else joint.upper
        inside = float(np.clip(value, lower, upper))
        beyond = abs(inside - value) > ROUNDING
        held[name] = value if beyond and as_stated else inside
        if beyond and as_stated:
            notes.append(f"{name} is held at {value:g}, as the file states, beyond its limit {inside:g}")
        elif beyond:
            notes.append(f"{name} is held at its limit {inside:g} instead of {value:g}")
    return free.with_held(held), tuple(notes)


def _problem_files(folder: Path) -> dict[int, tuple[Path, Path]]:
    """The scene and the request of each problem in a folder, in the order of the numbers."""
    kinds: dict[str, dict[int, Path]] = {"scene": {}, "request": {}}
    for file in sorted(folder.iterdir()):
        if match := FILE_NAME.fullmatch(file.name):
            kinds[match[1]].setdefault(int(match[2]), file)
    scenes, requests = kinds.values()
    return {number: (scenes[number], requests[number]) for number in sorted(scenes.keys() & requests.keys())}


def _split(folder: Path, scene: Path) -> tuple[str, str | None]:
    """The name of a set, and the catalogue robot that its folder or one of its scenes names, if any."""
    whole = folder.resolve().name
    name, _, last = whole.rpartition("_")
    model = str(read_yaml(scene, ("world",), FileError).get("robot_model_name", ""))
    in_name = bool(name and last) and last in (*catalogue_names(), model)
    stated = last if in_name else model
    # A robot with two arms has an entry for each of them.
    robot = next((entry for entry in (stated, f"{stated}_left") if entry in catalogue_names()), None)
    return name if in_name else whole, robot


def _robot_beside(folder: Path) -> tuple[str, str | None] | None:
    """The URDF, and the SRDF if there is exactly one, in a folder ``robot`` in a set or beside it."""
    for place in (folder / "robot", folder.resolve().parent / "robot"):
        urdfs, srdfs = sorted(place.glob("*.urdf")), sorted(place.glob("*.srdf"))
        if len(urdfs) > 1:
            names = ", ".join(file.name for file in urdfs)
            raise FileError(place, f"contains several robots ({names}); select one with robot")
        if urdfs:
            return str(urdfs[0]), str(srdfs[0]) if len(srdfs) == 1 else None
    return None
