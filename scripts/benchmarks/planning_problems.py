"""Reader for MotionBenchMaker problems: folders of planning scenes and motion plan requests as YAML.

A set is a folder of ``sceneNNNN.yaml`` (moveit_msgs/PlanningScene) with ``requestNNNN.yaml``
(moveit_msgs/MotionPlanRequest) beside them; its name is ``<set>``, or ``<set>_<robot>`` as in the original data. Other
files (``scene_sensedNNNN.yaml``, ``pathNNNN.yaml``, ``config.yaml``) are ignored. A path may also be a single set.

Source: C. Chamzas and others (2022), "MotionBenchMaker: a tool to generate and benchmark motion planning datasets",
RA-L; the layout is that of KavrakiLab/motion_bench_maker, ``src/setup.cpp``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tables import NotApplicableError
from pinproof.collision import Box, CollisionChecker, Cylinder, Obstacle, Scene
from pinproof.common.files import read_yaml
from pinproof.description.catalogue import catalogue_names
from pinproof.errors import FileError, InputError, UnknownNameError
from pinproof.ik import Clik
from pinproof.model import Arm, JointGroup, Robot, load_robot
from pinproof.model.chain import link_path
from pinproof.spatial import SE3, Array, pose

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


Rng = np.random.Generator
PoseSampler = Callable[[Rng], SE3]

FLOOR = -0.02
"""Height of the floor, below the base."""

DOWN = np.pi
"""Pitch of a TCP that points down; at pi / 2 it points outwards."""

OWN_ROBOTS = ("ur5", "panda", "generic_6dof")

MARGIN = 0.005
"""Clearance of starts and goals in m, by the convex hulls, so that no motion begins or ends in contact."""

POSES = 30
"""Poses of the TCP to try for a start or goal before another scene is generated."""

SCENES = 20
"""Scenes to try for a problem before the arm is reported as unsuitable."""

AROUND_HOME = 0.5
"""Distance in rad or m from home within which IK starts."""

STRAIGHT_STEP = 0.02
"""Largest joint motion in rad or m between samples of the straight connection."""

SAMPLES, SHARE = 2_000, 0.95
"""The reach is the distance within which this share of random configurations has the TCP."""


@dataclass(frozen=True, eq=False)
class PlanProblem:
    """A problem of the joints of one or several arms, from ``start`` (n,) to any of the ``goals`` (g, n).

    Its origin is a collection, a set and a number: ``"ur5"``, ``"shelf"``, 3. ``notes`` are sentences that state how
    the problem was adapted to the robot.
    """

    collection: str
    set_name: str
    number: int
    group: JointGroup
    scene: Scene
    start: Array
    goals: Array
    notes: tuple[str, ...] = ()

    @property
    def origin(self) -> dict[str, Any]:
        """The collection, the set and the number, as in a row of results."""
        return {"collection": self.collection, "set_name": self.set_name, "number": self.number}

    @property
    def full_set(self) -> str:
        """``"ur5/shelf"``."""
        return f"{self.collection}/{self.set_name}"

    @property
    def name(self) -> str:
        """``"ur5/shelf/3"``."""
        return f"{self.full_set}/{self.number}"

    @property
    def arm(self) -> Arm:
        """The arm; NotApplicableError if the problem is one of several arms."""
        if not isinstance(self.group, Arm):
            raise NotApplicableError("it plans for one arm")
        return self.group


def end_faults(problem: PlanProblem, checker: CollisionChecker) -> tuple[str, ...]:
    """Return the contacts and violated limits of the start, and those of the goals if no goal is free."""
    start = _fault(problem, checker, problem.start)
    goals = [_fault(problem, checker, goal) for goal in problem.goals]
    found = [f"start: {start}"] if start else []
    if all(goals):
        found += [f"goal: {fault}" for fault in dict.fromkeys(goals)]
    return tuple(found)


def _fault(problem: PlanProblem, checker: CollisionChecker, q: Array) -> str:
    outside = problem.group.limits.violations(q, problem.group.joint_names)
    touching = checker.check(q)
    return "; ".join([*outside, *([] if touching.free else [str(touching)])])


def select_sets(sets: list[str], names: tuple[str, ...]) -> list[str]:
    """Return the sets with one of these names, or all sets without names; UnknownNameError if no set has a name.

    A set ``"ur5/shelf"`` also has the names ``"ur5"`` and ``"shelf"``.
    """
    names_of = {full_set: {full_set, *full_set.split("/")} for full_set in sets}
    known = set().union(*names_of.values())
    for name in names:
        if name not in known:
            raise UnknownNameError("set of problems", name, known)
    return [full_set for full_set in sets if not names or names_of[full_set].intersection(names)]


# -- problems in our scenes --------------------------------------------------------------------------------------------


def own_reach(arm: Arm) -> float:
    """Return the reach of an arm in m: the 95 % quantile of the distance of the TCP from the base z axis."""
    lower, upper = arm.limits.sampling_range()
    poses = arm.forward_kinematics_batch(np.random.default_rng(0).uniform(lower, upper, (SAMPLES, arm.dof)))
    return float(np.quantile(np.hypot(poses[:, 0, 3], poses[:, 1, 3]), SHARE))


def own_problems(robot: str, scene: str, count: int, seed: int = 0) -> Iterator[PlanProblem]:
    """Generate problems of a robot in one of :data:`OWN_SCENES`; each depends only on the seed and its number.

    InputError is raised if no problem is found for this arm in this scene.
    """
    arm = load_robot(robot).arm()
    empty = CollisionChecker(arm, margin=MARGIN)
    reach, index = own_reach(arm), list(OWN_SCENES).index(scene)
    for number in range(1, count + 1):
        rng = np.random.default_rng([seed, index, number])
        tried = (_generate(empty, OWN_SCENES[scene](rng), reach, rng) for _ in range(SCENES))
        found = next((each for each in tried if each is not None), None)
        if found is None:
            raise InputError(f"no start and goal for {robot!r} found in {SCENES} scenes of type {scene!r}")
        generated, start, goal = found
        yield PlanProblem(robot, scene, number, arm, generated, start, goal[None])


def _generate(
    empty: CollisionChecker, layout: SceneLayout, reach: float, rng: Rng
) -> tuple[Scene, Array, Array] | None:
    """The scene in m with a start and a goal whose straight connection is in collision; None if none is found."""
    obstacles = []
    for each in layout.obstacles:
        shape = type(each.shape)(*(reach * size for size in astuple(each.shape)))
        obstacles.append(Obstacle(each.name, shape, empty.arm.root_from_base * _scaled(each.pose, reach)))
    checker = empty.with_scene(Scene(obstacles))
    start = _free_configuration(checker, layout.start, reach, rng)
    goal = None if start is None else _free_configuration(checker, layout.goal, reach, rng)
    if start is None or goal is None:
        return None
    steps = max(2, int(np.ceil(np.abs(goal - start).max() / STRAIGHT_STEP)))
    straight = start + np.linspace(0, 1, steps)[:, None] * (goal - start)
    return None if checker.is_free_batch(straight).all() else (checker.scene, start, goal)


def _scaled(at: SE3, reach: float) -> SE3:
    return SE3(at.rotation, reach * at.translation)


def _free_configuration(checker: CollisionChecker, sample_pose: PoseSampler, reach: float, rng: Rng) -> Array | None:
    """A free configuration with the TCP at a sampled pose up to a rotation about its z axis.

    IK starts near home, which gives common postures; start and goal then rarely need a change of the elbow or wrist
    branch.
    """
    arm, solver = checker.arm, Clik(restarts=0)
    for _ in range(POSES):
        near_home = arm.limits.clip(arm.home + rng.uniform(-AROUND_HOME, AROUND_HOME, arm.dof))
        at = _scaled(sample_pose(rng), reach)
        found = solver.solve(arm, at, near_home, rng=rng, task="spin_z", accept=checker.is_free)
        if found.ok:
            return np.asarray(found.q)
    return None


# -- our scenes, in units of the reach ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SceneLayout:
    """The obstacles of a scene (base_from_obstacle), and samplers of start and goal poses (base_from_tcp)."""

    obstacles: list[Obstacle]
    start: PoseSampler
    goal: PoseSampler


def table_top(rng: Rng) -> SceneLayout:
    """Ten boxes and cylinders of up to 0.45 r on a table; the tool moves between them from the left to the right."""
    obstacles = [_floor()]
    for number in range(1, 11):
        radius, height = rng.uniform(0.035, 0.07), rng.uniform(0.12, 0.45)
        distance, azimuth = rng.uniform(0.4, 0.85), rng.uniform(-1.7, 1.7)
        at = pose(_polar(distance, azimuth, FLOOR + height / 2), (0, 0, rng.uniform(-np.pi, np.pi)))
        if rng.random() < 0.5:
            obstacles.append(Obstacle(f"can_{number}", Cylinder(radius, height), at))
        else:
            obstacles.append(Obstacle(f"box_{number}", Box(1.8 * radius, 1.4 * radius, height), at))

    def tool(side: float, g: Rng) -> SE3:
        distance, azimuth = g.uniform(0.45, 0.75), side * g.uniform(0.4, 1.4)
        return _tool(distance, azimuth, g.uniform(0.05, 0.15), DOWN - g.uniform(0, 0.3))

    return SceneLayout(obstacles, partial(tool, 1.0), partial(tool, -1.0))


def shelf(rng: Rng) -> SceneLayout:
    """Three levels of two compartments, each 0.36 r high; the tool moves from one compartment into another."""
    front, depth, width, level = rng.uniform(0.5, 0.55), 0.35, 1.3, 0.36
    middle, tall = front + depth / 2, 3 * level
    obstacles = [_floor(), _box("back", (0.02, width, tall), (front + depth, 0, FLOOR + tall / 2))]
    for k in (1, 2, 3):  # the floor is the bottom of the lowest level
        obstacles.append(_box(f"board_{k}", (depth, width, 0.02), (middle, 0, FLOOR + k * level)))
    for name, y in (("left", width / 2), ("middle", rng.uniform(-0.1, 0.1)), ("right", -width / 2)):
        obstacles.append(_box(name, (depth, 0.02, tall), (middle, y, FLOOR + tall / 2)))
    first, second = rng.permutation(6)[:2].tolist()

    def tool(place: int, g: Rng) -> SE3:
        side, floor = (1.0 if place % 2 else -1.0), FLOOR + (place // 2) * level
        at = front + g.uniform(0.05, 0.15), side * g.uniform(0.2, 0.45), floor + g.uniform(0.12, 0.22)
        return pose(at, (0, DOWN / 2 + g.uniform(-0.1, 0.3), 0))

    return SceneLayout(obstacles, partial(tool, first), partial(tool, second))


def bins(rng: Rng) -> SceneLayout:
    """Two open bins, 0.5 r wide and up to 0.3 r deep; the tool moves out of one bin into the other."""
    inside, wall, tall = 0.5, 0.02, rng.uniform(0.2, 0.3)
    away = (inside + wall) / 2
    obstacles, centres = [_floor()], []
    for side, name in ((1.0, "left"), (-1.0, "right")):
        distance, azimuth = rng.uniform(0.62, 0.67), side * rng.uniform(0.5, 0.8)
        centres.append((distance, azimuth))
        at = pose(_polar(distance, azimuth, FLOOR + tall / 2), (0, 0, azimuth + rng.uniform(-0.2, 0.2)))
        for number, (x, y) in enumerate(((away, 0), (-away, 0), (0, away), (0, -away)), 1):
            shape = Box(wall, inside, tall) if x else Box(inside + 2 * wall, wall, tall)
            obstacles.append(Obstacle(f"{name}_wall_{number}", shape, at * pose((x, y, 0))))

    def tool(centre: tuple[float, float], g: Rng) -> SE3:
        distance, azimuth = (value + g.uniform(-0.06, 0.06) for value in centre)
        return _tool(distance, azimuth, FLOOR + g.uniform(0.05, 0.2), DOWN - g.uniform(0, 0.2))

    return SceneLayout(obstacles, *(partial(tool, centre) for centre in centres))


def cage(rng: Rng) -> SceneLayout:
    """Seven posts, 0.43 r apart, and a roof around the arm; the tool moves from one gap between posts to another."""
    posts, radius, height = 7, 0.5, 1.25
    apart = 2 * np.pi / posts
    phase = rng.uniform(0, apart)
    obstacles = [_floor(), _box("roof", (1.1, 1.1, 0.02), (0, 0, height))]
    for number in range(posts):
        at = pose(_polar(radius, phase + number * apart, (FLOOR + height) / 2))
        obstacles.append(Obstacle(f"post_{number + 1}", Cylinder(0.02, height - FLOOR), at))
    gaps = [phase + (number + 0.5) * apart for number in range(posts)]
    front = sorted(((gap + np.pi) % (2 * np.pi) - np.pi for gap in gaps), key=abs)[:4]
    first, second = rng.permutation(sorted(front))[:2].tolist()

    def tool(azimuth: float, g: Rng) -> SE3:
        return _tool(g.uniform(0.62, 0.75), azimuth, g.uniform(0.25, 0.6), DOWN / 2 + g.uniform(-0.2, 0.3))

    return SceneLayout(obstacles, partial(tool, first), partial(tool, second))


def narrow_slot(rng: Rng) -> SceneLayout:
    """A wall with a window of 0.45 r by 0.28 r; the tool moves from the side of the arm through the window."""
    near, thick, tall, half = rng.uniform(0.45, 0.5), 0.04, 1.3, 0.9
    wide, high = 0.45, 0.28
    y, z = rng.uniform(-0.15, 0.15), rng.uniform(0.35, 0.5)
    x = near + thick / 2
    bottom, top, left, right = z - high / 2, z + high / 2, y + wide / 2, y - wide / 2
    obstacles = [
        _floor(),
        _box("below", (thick, 2 * half, bottom - FLOOR), (x, 0, (bottom + FLOOR) / 2)),
        _box("above", (thick, 2 * half, tall - top), (x, 0, (tall + top) / 2)),
        _box("left", (thick, half - left, high), (x, (half + left) / 2, z)),
        _box("right", (thick, half + right, high), (x, (right - half) / 2, z)),
    ]
    side = rng.choice([-1.0, 1.0])

    def start(g: Rng) -> SE3:
        return _tool(g.uniform(0.4, 0.6), side * g.uniform(1.3, 2.0), g.uniform(0.1, 0.5), DOWN - g.uniform(0, 0.6))

    def goal(g: Rng) -> SE3:
        place = (near + thick + g.uniform(0.06, 0.18), y + g.uniform(-0.1, 0.1), z + g.uniform(-0.05, 0.05))
        return pose(place, (0, DOWN / 2 + g.uniform(-0.1, 0.1), g.uniform(-0.2, 0.2)))

    return SceneLayout(obstacles, start, goal)


OWN_SCENES: dict[str, Callable[[Rng], SceneLayout]] = {
    "table_top": table_top,
    "shelf": shelf,
    "bin": bins,
    "cage": cage,
    "narrow_slot": narrow_slot,
}
"""Our scenes: a function by name that generates a scene in units of the reach."""


def _floor() -> Obstacle:
    return _box("floor", (2.6, 2.6, 0.04), (0, 0, FLOOR - 0.02))


def _box(name: str, sides: tuple[float, float, float], at: tuple[float, float, float]) -> Obstacle:
    return Obstacle(name, Box(*sides), pose(at))


def _polar(distance: float, azimuth: float, z: float) -> tuple[float, float, float]:
    return distance * float(np.cos(azimuth)), distance * float(np.sin(azimuth)), z


def _tool(distance: float, azimuth: float, z: float, pitch: float) -> SE3:
    """base_from_tcp whose z axis has this pitch and points away from the base."""
    return pose(_polar(distance, azimuth, z), (0, pitch, azimuth))
