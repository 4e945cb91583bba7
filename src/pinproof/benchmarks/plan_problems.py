"""Planning problems, and those in our scenes: table top, shelf, bins, cage and narrow slot.

Our scenes are generated at random around an arm. All lengths are multiples of its reach r, all positions are in its
base frame with z up and x to the front. The floor is just below the base. Each scene defines poses of the TCP up to a
rotation about its z axis; starts and goals are free IK solutions for these poses, whose straight connection is in
collision. No planner takes part in the generation, so none has an advantage; a problem may have no solution.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass
from functools import partial

import numpy as np

from pinproof.benchmarks.tables import NotApplicableError
from pinproof.collision import Box, CollisionChecker, Cylinder, Obstacle, Scene
from pinproof.errors import InputError, UnknownNameError
from pinproof.ik import Clik
from pinproof.model import Arm, JointGroup, load_robot
from pinproof.spatial import SE3, Array, pose

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
class ProblemName:
    """The origin of a problem: ``"ur5"``, ``"shelf"``, 3."""

    collection: str
    set_name: str
    number: int

    @property
    def origin(self) -> tuple[str, str, int]:
        """The collection, the set and the number."""
        return self.collection, self.set_name, self.number

    @property
    def full_set(self) -> str:
        """``"ur5/shelf"``."""
        return f"{self.collection}/{self.set_name}"

    @property
    def name(self) -> str:
        """``"ur5/shelf/3"``."""
        return f"{self.full_set}/{self.number}"


@dataclass(frozen=True, eq=False)
class PlanProblem(ProblemName):
    """A problem of the joints of one or several arms, from ``start`` (n,) to any of the ``goals`` (g, n).

    ``notes`` are sentences that state how the problem was adapted to the robot.
    """

    group: JointGroup
    scene: Scene
    start: Array
    goals: Array
    notes: tuple[str, ...] = ()

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
