"""What a method in the planning benchmark is, and the method of this package."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, field
from functools import partial
from itertools import combinations
from time import process_time_ns
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from benchmarks.plain_coal import PlainCoal
from benchmarks.planning_problems import PlanProblem
from benchmarks.tables import NotApplicableError
from pinproof.collision import Box, CollisionChecker, Cylinder, Obstacle, Sphere, certify
from pinproof.errors import TimingError
from pinproof.motion import Curve, JointPath, time_parametrise
from pinproof.planning import DEFAULT_PLANNER, RrtConnect, planner_of, sampling_box, simplify
from pinproof.spatial import matrix

STEPS = ("plan", "simplify", "time", "certify")
"""The timed steps, in their order."""

TIME_LIMIT = RrtConnect().time_limit
"""Limit of the processor time of every search in s: the default of ours."""

ELAPSED_LIMIT = 10 * TIME_LIMIT
"""Limit in s of the elapsed time that other planners are given, because they measure no processor time: on a computer
with other work, that of a search is a part of it."""

OURS = "pinproof"
"""Key of our method with the default planner."""

NANOSECONDS_PER_MS = 1e6


@dataclass(frozen=True, eq=False)
class PlanAnswer:
    """The answer of a method to a problem; None for what it does not have.

    ``ms`` maps each of :data:`STEPS` that was carried out to its time. ``certified`` states whether the motion has a
    FREE certificate with this ``clearance`` (m), ``rejected_edges`` counts edges that were free at their samples but
    failed the proof, and ``message`` states why there is no motion, or no certificate. The ``duration`` is in s.
    """

    curve: Curve | None
    ms: dict[str, float] = field(default_factory=dict)
    certified: bool | None = None
    clearance: float | None = None
    duration: float | None = None
    rejected_edges: int | None = None
    message: str = ""


Solve = Callable[[int], PlanAnswer]
"""Solves the problem that it was prepared for with a seed."""


@dataclass(frozen=True, eq=False)
class PlanMethod:
    """A method of the table: its identifier, its name in the table, and the distribution that installs it (None: ours).

    ``python`` is the Python that has the distribution, if it is not this one.

    ``prepare`` takes a problem and the checker with convex hulls; its time does not count. It raises ImportError if the
    method is not installed, and NotApplicableError if it cannot solve such problems.
    """

    key: str
    label: str
    prepare: Callable[[PlanProblem, CollisionChecker], Solve]
    distribution: str | None = None
    python: str | None = None


class Stopwatch:
    """Measures consecutive steps in milliseconds of processor time."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}
        self._last = process_time_ns()

    def lap(self, step: str) -> None:
        """Record the time since the last lap under the name of a step."""
        now = process_time_ns()
        self.ms[step] = (now - self._last) / NANOSECONDS_PER_MS
        self._last = process_time_ns()


def _prepare(planner_name: str, problem: PlanProblem, checker: CollisionChecker) -> Solve:
    planner = planner_of(planner_name, time_limit=TIME_LIMIT)

    def solve(seed: int) -> PlanAnswer:
        watch = Stopwatch()
        plan = planner.plan(checker, problem.start, problem.goals, rng=seed)
        watch.lap("plan")
        answer = partial(PlanAnswer, ms=watch.ms, rejected_edges=plan.cut)
        if not plan.ok:
            return answer(None, certified=False, message=plan.message)
        used = plan.checker or checker  # with finer link shapes if start or goal collides by its hulls only
        simple = simplify(plan.path, used, rng=seed)
        watch.lap("simplify")
        try:
            trajectory = time_parametrise(simple.path, problem.group.limits)
        except TimingError as error:
            return answer(None, certified=False, message=str(error))
        watch.lap("time")
        certificate = certify(trajectory, used)
        watch.lap("certify")
        if not certificate.free:
            return answer(trajectory, certified=False, duration=trajectory.duration, message=certificate.message)
        return answer(trajectory, certified=True, clearance=certificate.clearance, duration=trajectory.duration)

    return solve


def own_method(planner: str) -> PlanMethod:
    """Return the method of this package with a planner: plan, simplify, time, and certify what would be saved.

    Raises
    ------
    UnknownNameError
        If there is no planner with this name.
    InputError
        If the library of the planner is not installed.
    """
    planner_of(planner)
    names = (OURS, OURS) if planner == DEFAULT_PLANNER else (f"{OURS}_{planner}", f"{OURS}, {planner}")
    return PlanMethod(*names, partial(_prepare, planner))


GROUP = "arm"

NODES = 100_000
"""Largest size of roboplan's trees; its default of 1,000 ends searches before the time limit."""

FINE = 0.02
"""Rad between roboplan's samples on an edge in the row with finer samples; its default is 0.05."""

OMPL_RESOLUTION = 0.01
"""Distance of OMPL's samples on an edge as a share of the extent of the joint space: its default."""

COLOUR = np.array([0.5, 0.5, 0.5, 1.0])


def _roboplan(shorten: bool, step: float | None) -> Callable[[PlanProblem, CollisionChecker], Solve]:
    """Roboplan (Castro and others): RRT-Connect in C++, with or without its shortcuts, sampled at ``step`` rad."""

    def prepare(problem: PlanProblem, checker: CollisionChecker) -> Solve:
        from roboplan.core import JointConfiguration, PathShortcutter, PathShortcuttingOptions
        from roboplan.rrt import RRT, RRTOptions

        scene, names = _scene(problem, checker), list(problem.arm.joint_names)
        if len(problem.goals) > 1:
            raise NotApplicableError("roboplan accepts a single goal")
        options = RRTOptions(group_name=GROUP, max_nodes=NODES, max_planning_time=ELAPSED_LIMIT, rrt_connect=True)
        shortening = PathShortcuttingOptions(group_name=GROUP)
        if step is not None:
            options.collision_check_step_size = shortening.max_step_size = step

        def solve(seed: int) -> PlanAnswer:
            shortening.seed = seed
            planner = RRT(scene, options)
            planner.setRngSeed(seed)
            start, goal = (JointConfiguration(names, q) for q in (problem.start, problem.goals[0]))
            watch = Stopwatch()
            try:
                path = planner.plan(start, goal)
            except RuntimeError as error:
                watch.lap("plan")
                return PlanAnswer(None, watch.ms, message=str(error))
            watch.lap("plan")
            if path is not None and shorten:
                path = PathShortcutter(scene, shortening).shortcut(path)
                watch.lap("simplify")
            if path is None:
                return PlanAnswer(None, watch.ms, message="no path")
            order = list(map(list(path.joint_names).index, names))
            return PlanAnswer(JointPath(np.array(path.positions)[:, order], names), watch.ms)

        return solve

    return prepare


def _scene(problem: PlanProblem, checker: CollisionChecker) -> Any:
    """Roboplan's scene: the URDF of the robot, the obstacles, and the pairs that may be in contact."""
    from roboplan import core

    arm, root = problem.arm, problem.arm.robot.urdf.root
    scene = core.Scene(problem.full_set, core.loadUrdfSceneDescriptionFromXml(robot_urdf(problem)))
    scene.importSrdf(robot_srdf(problem, checker))
    if len(scene.getCurrentJointPositions()) != len(scene.getJointNames()):
        raise NotApplicableError("roboplan represents joints without limits by two numbers")
    q = np.array(scene.getCurrentJointPositions())
    for index, name in enumerate(scene.getJointNames()):
        q[index] = arm.held.get(name, q[index])
    scene.setJointPositions(q)
    for obstacle in problem.scene.obstacles:
        kind, sizes = simple_shape(obstacle)
        add, shape = getattr(scene, f"add{kind}Geometry"), getattr(core, kind)(*sizes)
        add(obstacle.name, root, shape, np.asfortranarray(matrix(obstacle.pose)), COLOUR)
    # Roboplan would report cans on a shelf as collisions.
    scene.setCollisions(list(combinations(problem.scene.names, 2)), False)
    for pair in checker.excluded:
        if set(pair.owners) & set(problem.scene.names):
            scene.setCollisions(*pair.owners, False)
    return scene


def _ompl(problem: PlanProblem, checker: CollisionChecker) -> Solve:
    """OMPL (Sucan, Moll, Kavraki): RRT-Connect and its simplification, states checked by Pinocchio and coal."""
    from ompl import base, geometric, util

    arm, allowed = problem.arm, [pair.owners for pair in checker.excluded]
    coal = PlainCoal(CollisionChecker(arm, problem.scene, link_meshes="surface", allowed=allowed))
    box, joints = sampling_box(arm, np.vstack([problem.start, problem.goals])), range(arm.dof)

    def solve(seed: int) -> PlanAnswer:
        util.setLogLevel(util.LOG_NONE)
        util.RNG.setSeed(seed + 1)  # OMPL ignores the seed 0
        space, bounds = base.RealVectorStateSpace(arm.dof), base.RealVectorBounds(arm.dof)
        for joint, (low, high) in enumerate(box.T.tolist()):
            bounds.setLow(joint, low)
            bounds.setHigh(joint, high)
        space.setBounds(bounds)

        def configuration(state: Any) -> Any:
            return np.array([state[joint] for joint in joints])

        def state_at(q: Any) -> Any:
            state = space.allocState()
            for joint in joints:
                state[joint] = float(q[joint])
            return state

        setup = geometric.SimpleSetup(space)
        information = setup.getSpaceInformation()
        information.setStateValidityCheckingResolution(OMPL_RESOLUTION)
        setup.setStateValidityChecker(lambda state: coal.is_free(arm.model_configuration(configuration(state))))
        setup.addStartState(state_at(problem.start))
        goals = base.GoalStates(information)
        for goal in problem.goals:
            goals.addState(state_at(goal))
        setup.setGoal(goals)
        setup.setPlanner(geometric.RRTConnect(information))
        watch = Stopwatch()
        setup.solve(ELAPSED_LIMIT)
        watch.lap("plan")
        if not setup.haveExactSolutionPath():
            return PlanAnswer(None, watch.ms, message="no path within the time limit")
        setup.simplifySolution()
        watch.lap("simplify")
        q = np.array([configuration(state) for state in setup.getSolutionPath().getStates()])
        return PlanAnswer(JointPath(without_repetitions(q), arm.joint_names), watch.ms)

    return solve


def simple_shape(obstacle: Obstacle) -> tuple[str, tuple[float, ...]]:
    """The name of a shape and its sizes, which roboplan and FCL name and order as we do."""
    if not isinstance(obstacle.shape, Box | Cylinder | Sphere):
        kind = type(obstacle.shape).__name__
        raise NotApplicableError(f"obstacle {obstacle.name}: {kind} is not supported for other planners")
    return type(obstacle.shape).__name__, astuple(obstacle.shape)


def without_repetitions(q: Any) -> Any:
    """The waypoints (m, n) without repetitions."""
    return q[np.concatenate([[True], np.abs(np.diff(q, axis=0)).max(axis=1) > 0.0])] if len(q) > 1 else q


def robot_urdf(problem: PlanProblem, mesh_path: Callable[[str], str] = str) -> str:
    """The URDF of the robot with the paths of its collision meshes, or what ``mesh_path`` returns for each."""
    urdf = problem.arm.robot.urdf
    if urdf.path is None or urdf.path.suffix != ".urdf":
        raise NotApplicableError("the planner reads URDF files only")
    text = urdf.path.read_text(encoding="utf-8")
    for geometry in urdf.collisions:
        if geometry.mesh is not None and geometry.mesh.path is not None:
            text = text.replace(quoteattr(geometry.mesh.uri), quoteattr(mesh_path(str(geometry.mesh.path))))
    return text


def robot_srdf(problem: PlanProblem, checker: CollisionChecker) -> str:
    """An SRDF with the chain and the pairs of links that are always in contact."""
    arm = problem.arm
    links = set(arm.robot.urdf.links)
    pairs = [pair.owners for pair in checker.excluded if set(pair.owners) <= links]
    disabled = [f'<disable_collisions link1={quoteattr(a)} link2={quoteattr(b)} reason="User"/>' for a, b in pairs]
    chain = f"<chain base_link={quoteattr(arm.base)} tip_link={quoteattr(arm.tcp)}/>"
    name = quoteattr(arm.robot.name)
    return f'<robot name={name}><group name="{GROUP}">{chain}</group>{"".join(disabled)}</robot>'


PEERS: tuple[PlanMethod, ...] = (
    PlanMethod("roboplan_plan", "roboplan, no shortcuts", _roboplan(False, None), "roboplan"),
    PlanMethod("roboplan", "roboplan", _roboplan(True, None), "roboplan"),
    PlanMethod("roboplan_fine", f"roboplan, sampled at {FINE:g} rad", _roboplan(True, FINE), "roboplan"),
    PlanMethod("ompl", "OMPL RRTConnect with coal", _ompl, "ompl"),
)
"""Roboplan with its default settings with and without shortcuts, and with finer samples; OMPL."""
