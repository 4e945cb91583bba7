"""The best joint motion along a whole tool path: the ladder graph, the curve between its rungs, timing and proofs.

1. Rungs: all IK branches of each pose, with each rotation of the tool, tilt and redundant value of a grid
   (:mod:`pinproof.tool_paths.rungs`). The best sequence of nodes is optimal over the grid.
2. A spline through the nodes of the optimum, with a bound of its deviation from the path at every instant
   (:mod:`pinproof.tool_paths.curves`), and the certificate that it is free of contact.
3. Where an edge of the optimum has no such curve, a rung is added in its middle, and below a least distance the edge is
   removed. Then the optimum is computed again, so that it is the optimum over all edges that were not removed.
4. The speed of the tool is a limit of the timing; a lower bound follows from samples and the largest acceleration.

If the last rung cannot be reached, the farthest one ends a piece and begins the next one. No other division has fewer
pieces: a piece that begins later reaches no farther.
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise, product
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.common.validation import require_integer, require_number, require_positive, require_type
from pinproof.errors import InputError, NoClosedForm, TimingError
from pinproof.ik import AnalyticIk, Clik, IkTask, track
from pinproof.model import Arm
from pinproof.motion import CubicPath, ToolLimits, Trajectory, time_parametrise
from pinproof.planning import Route, nearest_target, plan, plan_linear, routes_through
from pinproof.spatial import SE3, Array, matrix, pose, rotation_about
from pinproof.tool_paths.curves import CurveMaker, NoCurve, RouteCurve, image_deviation
from pinproof.tool_paths.path import ToolPath
from pinproof.tool_paths.result import SHOWN, BlockedPose, FollowPlan, FollowStatus, Obstruction, PathPiece
from pinproof.tool_paths.rungs import (
    COSTS,
    Course,
    Flags,
    FollowCosts,
    Grid,
    LadderSettings,
    Rung,
    RungLadder,
    fill,
    rates_of,
    rungs_of,
)

SPIN = IkTask(rz=False)
"""All coordinates of the tcp except for the rotation about its z axis."""

# Share of the allowed deviation by which corners of the path are rounded, so that the tool need not stop there.
ROUNDED = 0.3
# M: rungs are not added closer than this to each other.
CLOSEST = 5e-4
# rad and m: largest step of a joint from rung to rung, unless a step of the grid is larger.
JUMP, JUMP_METRES = 0.5, 0.1
# Factor by which joints may move more than the tool rotates, for steps of the grid.
GRID_STEP = 1.2
# m/s and rad/s: speed of the tool for which the costs are computed if none is stated.
NOMINAL, NOMINAL_ROTATION = 0.25, 1.0
# The least share of the tool speed to which the tool may slow down from rung to rung, if no tolerance is stated.
SLOWEST = 0.1
# Share of the speed that counts as reached, if no tolerance is stated.
REACHED = 0.9
# Numbers of samples of the speed of the tool.
FEWEST_SAMPLES, MOST_SAMPLES = 200, 40_000
# Number of configurations that are moved from rung to rung where the grid ends, over how many rungs, and the accuracy (m
# and rad) of their poses; and the number of random ones at the first rung.
MOVED, EXTENDED, EXACT, SAMPLED = 48, 40, 1e-9, 20
# Rounds in which finer values around the optimum are compared, and the share by which a round must improve the cost to be
# repeated with values of the same size, and for there to be another one.
ROUNDS, IMPROVED, ENOUGH = 12, 0.01, 1e-4
# rad or m: rungs are added where the joints must move by at most this, as close to singular configurations.
FARTHEST = 2.0
# Length of the window over which steps are smoothed, in steps of the grid.
WINDOW = 2.0
# Shares of the speed with which the tool passes from one speed to another, tried in turn.
PASSING = (0.95, 0.7, 0.4, 0.2, 0.0)
# Number of configurations of a blocked pose whose contacts are counted.
CHECKED = 64
# Smallest singular value below which a jump is reported as singular.
SINGULAR = 0.05


def follow(
    checker: CollisionChecker,
    path: ToolPath | npt.ArrayLike | Sequence[SE3],
    *,
    free_rotation: bool | tuple[float, float] = True,
    rotations: int = 24,
    tilts: int = 0,
    redundant: int | None = None,
    deviation: float = 1e-3,
    rotation_deviation: float = math.radians(1.0),
    speed_tolerance: float | None = None,
    approach: float = 0.0,
    departure: float | None = None,
    start: npt.ArrayLike | None = None,
    lifts: int = 0,
    cost: FollowCosts | Literal["balanced", "time", "travel", "limits", "singularity", "clearance"] = "balanced",
    step: float = 0.02,
    angle_step: float = 0.2,
    budget: int = 200,
    rng: int = 0,
) -> FollowPlan:
    """Find the best joint motion along a whole tool path, and certify it.

    The motion is optimal over a grid: all branches and windings of the inverse kinematics at every pose, combined with
    the rotations of the tool about its axis, its tilts and the values of a redundant joint. Between the poses, it is a
    smooth curve that is proven to be free of contact, inside the limits and close to the path at every instant.

    Parameters
    ----------
    checker
        The arm in its scene, with its tool.
    path
        The path, or its poses ``base_from_tcp``. The z axis of the tcp is the axis of the tool.
    free_rotation
        Whether the tool may rotate about its axis, or the range (rad) of its rotation away from the pose of the path.
    rotations
        Number of rotations on the grid, evenly over a full revolution or over the range.
    tilts
        Number of directions in which the grid tilts the tool by half of ``rotation_deviation``, in addition to none.
    redundant
        Number of values of the redundant joint of an arm of seven joints, such as a rail; by default 24, and 72 if the
        rotation is not free.
    deviation, rotation_deviation
        Allowed distance (m) of the tool from the path and angle (rad) from its orientation, at every instant. If the
        rotation is free, the angle is that of the tool axis. Corners are rounded by less; the tool stops where the path
        reverses its direction.
    speed_tolerance
        Share by which the tool may be slower than the speed of the path, for example 0.1, except where it starts and
        stops. By default, it may be slower where a joint does not permit the speed, and the result states the speed.
    approach, departure
        Length (m) of straight moves along the tool axis to the first pose and away from the last one; by default, the
        departure is as long as the approach.
    start
        (n,) the configuration from which a straight line leads to the first pose, instead of an approach.
    lifts
        Largest number of lifts of the tool, with motions planned to where it continues, if the path cannot be followed
        in one piece.
    cost
        The weights of the cost, or their name: ``balanced``, ``time``, ``travel``, ``limits``, ``singularity``,
        ``clearance``.
    step, angle_step
        Largest distance (m) and angle (rad) between poses of the grid; poses are added where the path has larger ones.
    budget
        Largest number of edges at which the grid is refined.
    rng
        Seed of the search for IK solutions of an arm without a closed form, and of motions between pieces.

    Returns
    -------
    FollowPlan
        With ``trajectory`` and ``certificate``; or with the poses that are blocked and the reasons, and with the fewest
        lifts by which the path can be followed in pieces.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or a setting is out of its range.

    Notes
    -----
    S. Edwards, J. Meyer (2014), "Descartes: a path planning library for semi-constrained trajectories", ROSCon. The page
    "Tool paths" describes the method and its figures.
    """
    require_type("checker", checker, CollisionChecker)
    given = path if isinstance(path, ToolPath) else ToolPath(path)
    redundant = (72 if free_rotation is False else 24) if redundant is None else redundant
    for name, value, least in (
        ("rotations", rotations, 1), ("tilts", tilts, 0), ("redundant", redundant, 2), ("lifts", lifts, 0),
        ("budget", budget, 0),
    ):  # fmt: skip
        require_integer(name, value, least)
    for name, length in (("rotation_deviation", rotation_deviation), ("step", step), ("angle_step", angle_step)):
        require_positive(name, length)
    approach = require_number("approach", approach, "m", minimum=0)
    departure = approach if departure is None else require_number("departure", departure, "m", minimum=0)
    if speed_tolerance is not None:
        require_number("speed_tolerance", speed_tolerance, minimum=0.01, below=1)
    if isinstance(cost, str):
        if cost not in COSTS:
            raise InputError(f"cost is {cost!r}; it must be FollowCosts, or one of {', '.join(COSTS)}")
        cost = COSTS[cost]
    require_type("cost", cost, FollowCosts)
    arm, spin = checker.arm, None
    image, image_rotation = image_deviation(arm)
    if not deviation > 2.0 * image or not rotation_deviation > 2.0 * image_rotation:
        raise InputError(
            f"deviation = {deviation:g} m and rotation_deviation = {rotation_deviation:g} rad must be above "
            f"{2.0 * image:.2g} m and {2.0 * image_rotation:.2g} rad, twice the accuracy of timed curves of this arm"
        )
    # The grid, and what the tool keeps to
    if free_rotation is True:
        angles = 2.0 * np.pi * np.arange(rotations) / rotations
    elif free_rotation is False:
        angles = np.zeros(1)
    else:
        low, high = (require_number("free_rotation", each, "rad") for each in free_rotation)
        if not low <= high or high - low > 2.0 * np.pi:
            raise InputError(f"free_rotation = ({low:g}, {high:g}) rad must be a range of at most a full revolution")
        spin, angles = (
            (low, high),
            np.linspace(low, high, rotations) if rotations > 1 else np.array([0.5 * (low + high)]),
        )
    around = 2.0 * np.pi * np.arange(tilts) / max(tilts, 1)
    leans = [rotation_about(np.array([np.cos(a), np.sin(a), 0.0]), 0.5 * rotation_deviation) for a in around]
    swept = None
    if arm.dof > 6:
        with contextlib.suppress(NoClosedForm):
            swept = AnalyticIk(redundant_steps=redundant).redundant_grid(arm)
    grid = Grid(angles, np.array([np.eye(3), *leans]), None if swept is None else swept[1])
    # The least time of a step: the slowest joint makes a step of the grid
    speed = np.where(np.isfinite(arm.limits.velocity), arm.limits.velocity, 1.0)
    jump = np.where(arm.angular, JUMP, JUMP_METRES)
    finest = 0.0 if len(angles) < 2 else GRID_STEP * float(angles[1] - angles[0])
    steps = finest / float(speed[arm.angular].min(initial=np.inf))
    if swept is not None:
        width = GRID_STEP * float(np.diff(swept[1]).max())
        steps = max(steps, width / float(speed[swept[0]]))
        jump[swept[0]] = max(jump[swept[0]], width)
        finest = max(finest, width * arm.angular[swept[0]])
    jump = np.where(arm.angular, np.maximum(jump, finest), jump)
    slowest = SLOWEST if speed_tolerance is None else 1.0 - speed_tolerance
    search = _Search(
        checker=checker, path=given, grid=grid, free=free_rotation is not False, whole=free_rotation is True, spin=spin,
        deviation=(deviation, rotation_deviation), image=(image, image_rotation), speed_tolerance=speed_tolerance,
        approach=approach, departure=departure, settings=LadderSettings(cost, steps, slowest, jump, finest),
        spacing=(step, angle_step), budget=budget, rng=rng,
        start=None if start is None else arm.limits.snap(arm.configuration(start, "start")),
    )  # fmt: skip
    return search.run(lifts)


@dataclass(frozen=True, eq=False)
class _Followed:
    """A part of the path from one rung to another one, with the curve along each route or part of a route."""

    first: int
    last: int
    course: Course
    grid_cost: float
    curves: list[RouteCurve]
    groups: list[list[tuple[int, CubicPath]]]  # of the approach, the path and the departure, with the route
    rotations: Array


@dataclass(kw_only=True, eq=False)
class _Search:
    """The state of :func:`follow`."""

    checker: CollisionChecker
    path: ToolPath
    grid: Grid
    free: bool
    whole: bool
    spin: tuple[float, float] | None
    deviation: tuple[float, float]
    image: tuple[float, float]
    speed_tolerance: float | None
    approach: float
    departure: float
    settings: LadderSettings
    spacing: tuple[float, float]
    budget: int
    rng: int
    start: Array | None
    routes: list[Route] = field(default_factory=list)
    rungs: list[Rung] = field(default_factory=list)
    extended: list[Rung] = field(default_factory=list)
    refined: int = 0
    removed: int = 0
    unproven: str = ""

    def run(self, lifts: int) -> FollowPlan:
        """The plan with at most this many lifts."""
        self._make_rungs()
        followed, blocked, at, last = [], [], 0, len(self.rungs) - 1
        pieces: list[_Followed] = followed
        while True:
            piece = self._piece(at)
            last = len(self.rungs) - 1  # rungs may have been added
            if piece is not None and (piece.last > at or last == 0):
                pieces.append(piece)
            if piece is not None and piece.last == last:
                break
            end = at if piece is None else piece.last
            # The next rung with nodes: the tool is lifted, or a part of the path cannot be done
            following = next((k for k in range(end + 1, last + 1) if len(self.rungs[k].rates)), None)
            if piece is None or following != end + 1:
                gap = range(end if piece is None else end + 1, last + 1 if following is None else following)
                empty = [k for k in gap if not len(self.rungs[k].rates)]
                blocked += [self._blocked(list(rows)) for _, rows in groupby(empty, self._obstruction)]
            elif end == at:
                blocked.append(self._jump(piece))
            if following is None:
                break
            at = end if following == end + 1 and end > at else following
        return self._result(pieces, blocked, lifts)

    # -- the grid --------------------------------------------------------------------------------------------------

    def _make_rungs(self) -> None:
        """The routes of the tool and their rungs with all nodes."""
        arm, path = self.checker.arm, self.path
        frames = [SE3(each[:3, :3], each[:3, 3]) for each in path.poses]
        if self.whole:  # the rotation is free, so that the reference rotates as little as possible
            for index in range(1, len(frames)):
                frames[index] = nearest_target(frames[index - 1], frames[index], SPIN)
        lines = [(0.0, frames)]
        if self.start is not None:
            here = arm.forward_kinematics(self.start)
            if self.whole:
                here = SE3(nearest_target(frames[0], here, SPIN))
            lines.insert(0, (-1.0, [here, frames[0]]))
        elif self.approach > 0.0:
            lines.insert(0, (-1.0, [frames[0] * pose((0.0, 0.0, -self.approach)), frames[0]]))
        if self.departure > 0.0:
            lines.append((len(frames) - 1.0, [frames[-1], frames[-1] * pose((0.0, 0.0, -self.departure))]))
        rounding = [ROUNDED * (total - image) for total, image in zip(self.deviation, self.image, strict=True)]
        first = lines[0][0]
        for _, line in lines:
            self.routes += [route for route in routes_through(line, *rounding) if route.length > 0.0]
        if self.routes:
            self.rungs = rungs_of(self.routes, first, *self.spacing)
        else:
            self.rungs = [Rung(0, 0.0, matrix(frames[0]), 0.0)]
        self._fill(self.rungs)
        if self.start is not None:  # the only node of the first rung
            one = self.start[None]
            self.rungs[0].q, self.rungs[0].free = one, self.checker.is_free_batch(one)
            self.rungs[0].rates = np.zeros(int(self.rungs[0].free.sum()))
        self._connect()

    def _fill(self, rungs: list[Rung]) -> None:
        task = SPIN if self.free else IkTask()
        fill(rungs, self.checker, self.grid, task, self.settings.costs, self.rng)

    def _connect(self) -> None:
        """The ladder graph over the rungs."""
        places = np.array([rung.place for rung in self.rungs])
        length = np.linalg.norm(np.diff(places[:, :3, 3], axis=0), axis=1)
        turned = np.linalg.norm(np.diff(places[:, :3, :3], axis=0), axis=(1, 2)) / np.sqrt(2.0)
        speed = self._speeds(0.5 * np.array([a.at + b.at for a, b in pairwise(self.rungs)]))
        timed = np.isfinite(speed)
        duration = np.where(timed, length / speed, np.maximum(length / NOMINAL, turned / NOMINAL_ROTATION))
        self._ladder = RungLadder(self.checker.arm, self.rungs, np.maximum(duration, 1e-6), timed, self.settings)

    def _speeds(self, at: Array) -> Array:
        """(k,) the speed (m/s) of the tool at places of the path; infinite without one, and where it only rotates."""
        if self.path.speed is None or not len(self.path.speed):
            return np.full(len(at), np.inf)
        piece = np.clip(np.floor(at).astype(int), 0, len(self.path.speed) - 1)
        moves = (self.path.lengths[piece] > CLOSEST) | (at < 0.0) | (at > len(self.path) - 1)
        return np.where(moves, self.path.speed[piece], np.inf)

    # -- a piece without lifts -------------------------------------------------------------------------------------

    def _piece(self, first: int) -> _Followed | None:
        """The best certified curves from a rung to the farthest one; None if the rung has no nodes."""
        while True:
            course = self._ladder.solve(first, len(self.rungs) - 1)
            if not len(course.nodes):
                return None
            last = first + len(course.nodes) - 1
            if last < len(self.rungs) - 1 and self._continue(last, course.reachable):
                continue
            # Without the finer values, and without smoothing, if the curve fails
            polished = self._polished(first, course)
            for tried, width in ((polished, WINDOW), (polished, 0.0), (course, 0.0)):
                made = self._curves(first, tried, width if self.settings.steps > 0.0 else 0.0, course.cost)
                if isinstance(made, _Followed):
                    return made
                if self.settings.steps <= 0.0:
                    break
            index, self.unproven = made
            if self.refined >= self.budget:
                return None
            self._refine(index, course.nodes[index - first : index - first + 2])

    def _continue(self, last: int, reachable: Array) -> bool:
        """Whether nodes or a rung were added where the farthest rung is not the last one."""
        end = self.rungs[last]
        if self.settings.steps > 0.0 and not self.extended:
            # The branch on which the path goes on may have ended before, and between the values of the grid: all rungs
            # get the solutions that follow from those of the first rung, and from random ones there
            self.extended.append(self.rungs[0])
            many = Clik(restarts=SAMPLED).solve_many(
                self.checker.arm, self.rungs[0].place, rng=self.rng, count=SAMPLED, task=SPIN if self.free else IkTask()
            )
            if self.start is None:
                self._add(self.rungs[0], many.q[self._allowed(many.q, [self.rungs[0]] * len(many.q))])
            self._extend(0, self.rungs[0].nodes, len(self.rungs))
            self._connect()
            return True
        if self.settings.steps > 0.0 and end not in self.extended:
            self.extended.append(end)
            if self._extend(last, reachable, EXTENDED):
                self._connect()
                return True
        step = self._smallest_step(reachable, self.rungs[last + 1].nodes)
        if (
            step is None
            or self.refined >= self.budget
            or np.abs(step[2]).max() > FARTHEST
            or self._gap(last) <= CLOSEST
        ):
            return False
        self._refine(last, np.empty(0, dtype=np.int64))
        return True

    def _smallest_step(self, here: Array, there: Array) -> tuple[int, int, Array] | None:
        """The rows of the configurations that are closest to each other, and the step (n,) between them."""
        if not len(here) or not len(there):
            return None
        step = there[None] - here[:, None]
        step -= np.where(self.checker.arm.periodic, 2.0 * np.pi * np.round(step / (2.0 * np.pi)), 0.0)
        row, column = np.unravel_index(int(np.abs(step).max(axis=2).argmin()), step.shape[:2])
        return int(row), int(column), step[row, column]

    def _gap(self, index: int) -> float:
        """M: length of the route between a rung and the next one."""
        before, after = self.rungs[index], self.rungs[index + 1]
        begin = before.s if before.route == after.route else 0.0
        return (after.s - begin) * self.routes[after.route].length

    def _curves(self, first: int, course: Course, width: float, grid_cost: float) -> _Followed | tuple[int, str]:
        """Curves through the nodes of a course, or the index of the edge along which none was found, and why."""
        last = first + len(course.nodes) - 1
        rungs, arm = self.rungs[first : last + 1], self.checker.arm
        image, image_rotation = self.image
        share = 1.0 - ROUNDED - 1e-9
        task = SPIN if self.free else IkTask()
        maker = CurveMaker(
            arm, task, share * (self.deviation[0] - image), share * (self.deviation[1] - image_rotation), self.spin,
            IkTask(rx=False, ry=False, rz=False) if len(self.grid.tilts) > 1 else task,
        )  # fmt: skip
        curves, groups, begin = [], [[], [], []], 0
        while begin < len(rungs) - 1:
            number = rungs[begin + 1].route
            end = begin + 1
            while end + 1 < len(rungs) and rungs[end + 1].route == number:
                end += 1
            s = np.array([rung.s for rung in rungs[begin : end + 1]])
            s[0] = rungs[begin].s if rungs[begin].route == number else 0.0
            seconds = float(self._ladder.durations[first + begin : first + end].sum())
            window = width * self.settings.steps * (s[-1] - s[0]) / max(seconds, 1e-9)
            made = maker.curve(self.routes[number], s, course.q[begin : end + 1], window)
            if isinstance(made, NoCurve):
                where, reason = made.s, made.reason
            else:
                certificate = certify(made.path, self.checker)
                where, reason = _stop(certificate), certificate.message
                if certificate.free:
                    curves.append(made)
                    middle = 0.5 * (rungs[begin].at + rungs[end].at)
                    groups[0 if middle < 0.0 else 1 if middle < len(self.path) - 1 else 2].append((number, made.path))
                    begin = end
                    continue
            edge = begin + int(np.clip(np.searchsorted(s, where, side="right") - 1, 0, end - begin - 1))
            return first + edge, reason
        return _Followed(first, last, course, grid_cost, curves, groups, self._rotations(course.q, rungs))

    def _rotations(self, q: Array, rungs: list[Rung]) -> Array:
        """(k,) the rotation (rad) of the tool about its axis from the pose of each rung, in the range if there is one."""
        places = np.array([rung.place for rung in rungs])[:, :3, :3]
        turn = np.swapaxes(places, 1, 2) @ self.checker.arm.forward_kinematics_batch(q)[:, :3, :3]
        angle = np.arctan2(turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1])
        middle = 0.0 if self.spin is None else 0.5 * sum(self.spin)
        return np.asarray(middle + np.remainder(angle - middle + np.pi, 2.0 * np.pi) - np.pi)

    def _extend(self, index: int, q: Array, count: int) -> bool:
        """Add nodes between the values of the grid to ``count`` rungs after one, and whether there are any.

        The configurations q (k, n) of that rung are moved from rung to rung by the smallest steps of the joints, as far
        as they have no contact. They reach places where solutions exist only between values of the grid.
        """
        ahead = self.rungs[index + 1 :][:count]
        places, added = np.array([rung.place for rung in ahead]), [[np.empty((0, q.shape[1]))] for _ in ahead]
        for start in q[:: 1 + len(q) // MOVED]:
            moved = track(
                self.checker.arm, places, start, dt=1.0, velocity=self.settings.jump, position_tolerance=EXACT,
                orientation_tolerance=EXACT, task=SPIN if self.free else IkTask(),
            )  # fmt: skip
            reached = (
                (moved.position_error <= EXACT) & (moved.orientation_error <= EXACT) & self._allowed(moved.q, ahead)
            )
            for number in range(len(ahead) if reached.all() else int(reached.argmin())):
                added[number].append(moved.q[number : number + 1])
        for rung, rows in zip(ahead, added, strict=True):
            self._add(rung, np.concatenate(rows))
        return len(added[0]) > 1

    def _allowed(self, q: Array, rungs: list[Rung]) -> Flags:
        """(k,) whether configurations q (k, n) at rungs have no contact and the rotation of the tool is in its range."""
        allowed = self.checker.is_free_batch(q) if len(q) else np.empty(0, dtype=bool)
        if self.spin is not None and len(q):
            angle = self._rotations(q, rungs)
            allowed &= (angle >= self.spin[0]) & (angle <= self.spin[1])
        return allowed

    def _add(self, rung: Rung, q: Array) -> None:
        """Add nodes q (k, n) without contact to a rung."""
        rung.q, rung.free = (
            np.concatenate([rung.q.reshape(-1, q.shape[1]), q]),
            np.append(rung.free, np.full(len(q), True)),
        )
        rung.rates = np.append(rung.rates, rates_of(self.checker, q, self.settings.costs))

    def _polished(self, first: int, course: Course) -> Course:
        """The optimum over finer and finer values around those of a course, which move the tool only about its axis.

        The motions of the joints that keep the tool on the path, apart from its free rotation, are the null space of
        its Jacobian. Each round compares steps of half the size of the round before, to both sides of each rung.
        """
        arm, checker, count = self.checker.arm, self.checker, len(course.nodes)
        free = arm.dof - (5 if self.free else 6)
        if free < 1 or count < 2 or self.settings.finest <= 0.0 or len(self.grid.tilts) > 1:
            return course
        rungs, task = self.rungs[first : first + count], SPIN if self.free else IkTask()
        places = np.array([rung.place for rung in rungs])
        solver = Clik(position_tolerance=EXACT, orientation_tolerance=EXACT, restarts=0)
        sides = np.array(list(product((0.0, -1.0, 1.0), repeat=free)))[1:]
        best, size = course, 0.5 * self.settings.finest
        for _ in range(ROUNDS):
            jacobian = np.swapaxes(places[:, :3, :3], 1, 2)[:, None] @ arm.jacobian_batch(best.q).reshape(
                count, 2, 3, -1
            )
            rows = jacobian.reshape(count, 6, -1)[:, : 5 if self.free else 6]
            null = np.linalg.svd(rows)[2][:, -free:]
            guesses = best.q[:, None] + size * np.einsum("sf,kfn->ksn", sides, null)
            many = np.repeat(places, len(sides), axis=0)
            found = solver.solve_batch(arm, many, arm.limits.clip(guesses.reshape(-1, arm.dof)), task=task)
            kept = found.ok & (np.abs(found.q - guesses.reshape(-1, arm.dof)).max(axis=1) < size)
            kept[kept] = self._allowed(found.q[kept], [rungs[row // len(sides)] for row in np.flatnonzero(kept)])
            kept = kept.reshape(count, -1)
            kept[0] &= self.start is None or first > 0
            q = found.q.reshape(count, len(sides), -1)
            around = []
            for k, rung in enumerate(rungs):
                nodes = np.concatenate([best.q[k : k + 1], q[k][kept[k]]])
                around.append(Rung(rung.route, rung.s, rung.place, rung.at, nodes, np.ones(len(nodes), dtype=bool)))
            rates, start = rates_of(checker, np.concatenate([each.q for each in around]), self.settings.costs), 0
            for each in around:
                each.rates = rates[start : start + len(each.q)]
                start += len(each.q)
            span = slice(first, first + count - 1)
            ladder = RungLadder(
                arm, around, self._ladder.durations[span], self._ladder.timed[span], self.settings, windings=False
            )
            better = ladder.solve(0, count - 1)
            if len(better.nodes) < count:
                break
            gained = 1.0 - better.cost / max(best.cost, 1e-300)
            best = Course(better.q, course.nodes, better.cost, course.reachable)
            if gained < IMPROVED:
                size *= 0.5
                if gained < ENOUGH and size < self.settings.finest / 8.0:
                    break
        return best

    def _refine(self, index: int, nodes: npt.NDArray[np.int64]) -> None:
        """Add a rung in the middle of an edge, or remove the edge if its rungs are close to each other."""
        before, after = self.rungs[index], self.rungs[index + 1]
        self.refined += 1
        if self._gap(index) > CLOSEST:
            begin = before.s if before.route == after.route else 0.0
            middle = 0.5 * (begin + after.s)
            place = self.routes[after.route].poses(np.array([middle]))[0]
            rung = Rung(after.route, middle, place, 0.5 * (before.at + after.at))
            self._fill([rung])
            before.removed.clear()
            self.rungs.insert(index + 1, rung)
        else:
            before.removed.append((int(nodes[0]), int(nodes[1])))
            self.removed += 1
        self._connect()

    # -- why a rung cannot be passed -------------------------------------------------------------------------------

    def _obstruction(self, index: int) -> Obstruction:
        """Why a rung has no nodes."""
        rung = self.rungs[index]
        if len(rung.q):
            return Obstruction.CONTACT
        return Obstruction.LIMIT if rung.outside else Obstruction.OUT_OF_REACH

    def _blocked(self, indices: list[int]) -> BlockedPose:
        """Why consecutive rungs have no nodes, all for the same reason."""
        rungs, checker, turns = [self.rungs[index] for index in indices], self.checker, len(self.grid.turns)
        first, last = rungs[0], rungs[-1]
        where = self._name(first) if first is last else f"{self._name(first)} to {self._name(last)}"
        over = f"at all {turns} rotations" if turns > 1 else "at the rotation of the path"
        kind, proven = self._obstruction(indices[0]), all(rung.complete for rung in rungs)
        if kind is not Obstruction.CONTACT:
            outside = f", {sum(rung.outside for rung in rungs)} solutions" if kind is Obstruction.LIMIT else ""
            return BlockedPose(first.at, last.at, kind, f"{where}: {kind.value}{outside} {over}", proven, first.place)
        # The pairs of bodies in contact, and the configuration with the least penetration
        contacts: Counter[tuple[str, str]] = Counter()
        q = np.concatenate([rung.q for rung in rungs])
        count = len(q)
        q = q[:: math.ceil(count / CHECKED)]
        least, shown = -math.inf, q[0]
        for one in q:
            found = checker.check(one).contacts
            contacts.update({contact.bodies for contact in found})
            depth = min((contact.distance for contact in found), default=0.0)
            if depth > least:
                least, shown = depth, one
        pairs = ", ".join(f"{one} and {other} ({number})" for (one, other), number in contacts.most_common(3))
        of = f"{len(q)} of the {count}" if len(q) < count else f"all {count}"
        message = f"{where}: {kind.value} {over}; in contact in {of} configurations checked: {pairs}"
        return BlockedPose(first.at, last.at, kind, message, proven, first.place, dict(contacts), shown)

    def _jump(self, piece: _Followed) -> BlockedPose:
        """Why no node of the next rung is within reach of the last rung of a piece."""
        arm, rung, following = self.checker.arm, self.rungs[piece.last], self.rungs[piece.last + 1]
        here, found = piece.course.reachable, self._smallest_step(piece.course.reachable, following.nodes)
        row, _, step = (0, 0, np.zeros(arm.dof)) if found is None else found
        joint = int(np.abs(step).argmax())
        least = float(np.linalg.svd(arm.jacobian(here[row]), compute_uv=False)[-1])
        singular = f", smallest singular value {least:.2g}" if least < SINGULAR else ""
        unit = "rad" if arm.angular[joint] else "m"
        moved = f"{arm.joint_names[joint]} would jump by {abs(step[joint]):.2g} {unit} at least{singular}"
        why = f"; {self.unproven}" if self.unproven and self.removed else ""
        message = f"{self._name(rung)} to {self._name(following)}: {moved}{why}"
        kind, shown = Obstruction.JUMP, np.array(here[row])
        return BlockedPose(rung.at, following.at, kind, message, False, following.place, q=shown)

    def _name(self, rung: Rung) -> str:
        """The name of the pose of a rung, or of the place between two poses."""
        at, names = rung.at, self.path.names
        if at < 0.0:
            return "the approach"
        if at > len(names) - 1:
            return "the departure"
        before = names[int(at)]
        return (
            before
            if at == int(at)
            else f"{100.0 * (at - int(at)):.0f} % of the way from {before} to {names[int(at) + 1]}"
        )

    # -- timing and the whole motion -------------------------------------------------------------------------------

    def _result(self, followed: list[_Followed], blocked: list[BlockedPose], lifts: int) -> FollowPlan:
        """The timed pieces, with transits between them, and the certificate of the whole motion."""
        arm, checker = self.checker.arm, self.checker
        pieces, parts, untimed = [], [], False
        for piece in followed:
            timed = [self._timed(group, piece) if group else None for group in piece.groups]
            untimed |= any(group and part is None for group, part in zip(piece.groups, timed, strict=True))
            parts.append([part.trajectory for part in timed if part is not None])
            pieces.append(self._report(piece, timed[1]))
        cuts = tuple(piece.first for piece in pieces[1:])
        nodes = sum(len(rung.rates) for rung in self.rungs)
        figures: dict[str, Any] = {
            "path": self.path, "pieces": tuple(pieces), "blocked": tuple(blocked), "cuts": cuts, "nodes": nodes,
            "removed": self.removed, "rungs": len(self.rungs), "checker": checker,
        }  # fmt: skip
        # Poses that cannot be passed in any way, or more lifts than permitted
        if blocked or not pieces:
            shown = "; ".join(each.message for each in blocked[:SHOWN])
            more = f"; and {len(blocked) - SHOWN} more" if len(blocked) > SHOWN else ""
            if not blocked:
                shown = f"the budget of {self.budget} refinements was used up: {self.unproven}"
            status = FollowStatus.BLOCKED if blocked else FollowStatus.NOT_PROVEN
            return FollowPlan(status, f"{shown}{more}", **figures)
        if len(cuts) > lifts:
            names = ", ".join(self._name(self.rungs[piece.first]) for piece in followed[1:])
            why = self._jump(followed[0]).message
            message = (
                f"{len(cuts)} lift{'s' if len(cuts) > 1 else ''} of the tool needed, at {names}, and {lifts} permitted: "
                f"{why}; set lifts={len(cuts)}"
            )
            return FollowPlan(FollowStatus.LIFTS_NEEDED, message, **figures)
        if untimed:
            return FollowPlan(FollowStatus.NOT_PROVEN, f"the motion cannot be timed: {self.unproven}", **figures)
        # Transits from piece to piece
        motion, transits = [*parts[0]], []
        for index, (before, after) in enumerate(pairwise(followed)):
            leave = self._line(before.course.q[-1], self.departure, away=True)
            enter = self._line(after.course.q[0], self.approach, away=False)
            begin, end = (
                before.course.q[-1] if leave is None else leave.end,
                after.course.q[0] if enter is None else enter.start,
            )
            transit = plan(checker, begin, end, rng=self.rng)
            transits.append(transit)
            if not transit.ok:
                message = f"no transit from {self._name(self.rungs[before.last])}: {transit.message}"
                return FollowPlan(FollowStatus.NO_TRANSIT, message, transits=tuple(transits), **figures)
            motion += [*(part for part in (leave, transit.trajectory, enter) if part is not None), *parts[index + 1]]
        whole = Trajectory.join(*motion) if motion else Trajectory.at_rest(followed[0].course.q[0], arm.joint_names)
        certificate = certify(whole, checker)
        figures |= {"transits": tuple(transits)}
        if not certificate.free:
            return FollowPlan(FollowStatus.NOT_PROVEN, certificate.message, certificate=certificate, **figures)
        slow = self._slow(pieces)
        bound = max(piece.deviation for piece in pieces)
        lifted = f" with {len(cuts)} lift{'s' if len(cuts) != 1 else ''}" if cuts else ""
        text = (
            f"follows {len(self.path)} poses{lifted} in {whole.duration:.2f} s, within {bound * 1e3:.3f} mm of the path"
        )
        if slow:
            text += f"; {slow}"
        if slow and self.speed_tolerance is not None:
            return FollowPlan(FollowStatus.TOO_SLOW, slow, **figures)
        message = f"{text}; {certificate.message}"
        return FollowPlan(FollowStatus.FOUND, message, trajectory=whole, certificate=certificate, **figures)

    def _slow(self, pieces: list[PathPiece]) -> str:
        """A sentence about the piece on which the tool is slowest; empty if it keeps its speed within the tolerance."""
        tolerance = 1.0 - REACHED if self.speed_tolerance is None else self.speed_tolerance
        least = min((piece.speed_share for piece in pieces if piece.speed_share < 1.0 - tolerance), default=None)
        return "" if least is None else f"the tool slows down to {100.0 * least:.0f} % of the speed of the path"

    def _timed(self, paths: list[tuple[int, CubicPath]], piece: _Followed) -> _TimedPart | None:
        """The motion along curves between two stops of the tool each, at the speed of the path; None without timing."""
        arm, parts, shares, speeds, ramps = self.checker.arm, [], [], [], []
        tolerance = 1.0 - REACHED if self.speed_tolerance is None else self.speed_tolerance
        for number, path in paths:
            # The parts between changes of the speed
            known = [(rung.s, rung.at) for rung in self.rungs[piece.first : piece.last + 1] if rung.route == number]
            if known[0][0] > path.knots[0]:
                known.insert(0, (0.0, float(np.floor(known[0][1] - 1e-9))))
            at = np.interp(0.5 * (path.knots[1:] + path.knots[:-1]), *np.array(known).T)
            speed = self._speeds(at)
            ends = [0, *(1 + np.flatnonzero(speed[1:] != speed[:-1])).tolist(), len(speed)]
            subs = [
                CubicPath(path.q[a : b + 1], path.tangents[a : b + 1], path.knots[a : b + 1], path.joint_names)
                for a, b in pairwise(ends)
            ]
            wanted = speed[ends[:-1]]
            timed = None
            for share in PASSING:
                still = np.zeros(arm.dof)
                through = [
                    path.tangents[k] * share * self._rate(path.q[k], path.tangents[k], float(min(wanted[j : j + 2])))
                    for j, k in enumerate(ends[1:-1])
                ]
                velocities = [still, *through, still]
                try:
                    timed = [
                        time_parametrise(
                            sub, arm.limits, start_velocity=velocities[j], end_velocity=velocities[j + 1],
                            rate_limits=[ToolLimits(arm, linear_speed=wanted[j])] if np.isfinite(wanted[j]) else [],
                        )
                        for j, sub in enumerate(subs)
                    ]  # fmt: skip
                    break
                except (TimingError, InputError) as error:
                    self.unproven = str(error)
                    if not through:
                        break
            if timed is None:
                return None
            parts += timed
            for motion, limit in zip(timed, wanted, strict=True):
                low, high, before, after = tool_speed(arm, motion, float(limit), tolerance)
                speeds.append((low, high))
                ramps.append((before, after))
                shares.append(float(low / limit) if np.isfinite(limit) else 1.0)
        low, high = min(low for low, _ in speeds), max(high for _, high in speeds)
        return _TimedPart(Trajectory.join(*parts), (low, high), min(shares), (ramps[0][0], ramps[-1][1]))

    def _rate(self, q: Array, tangent: Array, speed: float) -> float:
        """The rate of the parameter at which the tool has a speed (m/s), and no joint exceeds its velocity."""
        arm = self.checker.arm
        per_rate = float(np.linalg.norm((arm.jacobian(q) @ tangent)[:3]))
        joints = float((np.abs(tangent) / arm.limits.velocity).max())
        return min(speed / max(per_rate, 1e-12), 1.0 / max(joints, 1e-12))

    def _line(self, q: Array, length: float, *, away: bool) -> Trajectory | None:
        """A straight motion along the tool axis away from q (n,), or towards it; None if there is none."""
        if length <= 0.0:
            return None
        arm = self.checker.arm
        line = plan_linear(self.checker, q, arm.forward_kinematics(q) * pose((0.0, 0.0, -length)), least=1.0)
        return time_parametrise(line.path if away else line.path.reversed(), arm.limits) if line.ok else None

    def _report(self, piece: _Followed, timed: _TimedPart | None) -> PathPiece:
        """What the result states of a piece."""
        first, last = self.rungs[piece.first].at, self.rungs[piece.last].at
        rounding = [ROUNDED * (total - image) for total, image in zip(self.deviation, self.image, strict=True)]
        bounds = (
            max((getattr(curve, name) for curve in piece.curves), default=0.0) + rounded + image
            for name, rounded, image in zip(("deviation", "rotation_deviation"), rounding, self.image, strict=True)
        )
        ats = np.array([rung.at for rung in self.rungs[piece.first : piece.last + 1]])
        own = {} if timed is None else {"speed": timed.speed, "speed_share": timed.share, "ramps": timed.ramps}
        return PathPiece(
            max(first, 0.0), min(last, len(self.path) - 1.0), piece.course.q, piece.rotations, ats, piece.course.cost, piece.grid_cost,
            None if timed is None else timed.trajectory, *bounds, **own,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _TimedPart:
    """A motion along the path, with bounds of the speed of the tool; see :class:`PathPiece`."""

    trajectory: Trajectory
    speed: tuple[float, float]
    share: float
    ramps: tuple[float, float]


def tool_speed(arm: Arm, motion: Trajectory, wanted: float, tolerance: float) -> tuple[float, float, float, float]:
    """Bounds (m/s) of the speed of the tool between its ramps, and the length (m) of the ramps at the start and the end.

    A ramp ends at the first instant, and begins at the last, at which the speed is above ``1 - tolerance`` of the wanted
    one. If that is never reached, or is infinite, the lower bound is the highest speed that was seen, or that of all.
    Between samples, the speed is lower by at most the largest acceleration times half of their distance in time.
    """
    if motion.duration == 0.0:
        return (wanted if np.isfinite(wanted) else 0.0), 0.0, 0.0, 0.0
    peaks = ToolLimits(arm, linear_speed=1.0).peaks(motion)
    top, acceleration = peaks["linear_speed"], peaks["linear_acceleration"]
    finest = 0.01 * (wanted if np.isfinite(wanted) else max(top, 1e-9))
    count = int(np.clip(np.ceil(motion.duration * acceleration / finest), FEWEST_SAMPLES, MOST_SAMPLES))
    times = np.linspace(0.0, motion.duration, count + 1)
    jacobians = arm.jacobian_batch(motion(times))[:, :3]
    speed = np.linalg.norm((jacobians @ motion.velocity(times)[:, :, None])[:, :, 0], axis=1)
    lower = speed - 0.5 * acceleration * motion.duration / count
    if not np.isfinite(wanted):
        return max(0.0, float(lower.min())), top, 0.0, 0.0
    reached = np.flatnonzero(lower >= (1.0 - tolerance) * wanted)
    if not len(reached):
        return float(lower.max(initial=0.0)), top, 0.0, 0.0
    width = motion.duration / count
    ramps = float(speed[: reached[0]].sum() * width), float(speed[reached[-1] + 1 :].sum() * width)
    return float(lower[reached[0] : reached[-1] + 1].min()), top, *ramps


def _stop(certificate: Certificate) -> float:
    """The parameter at which a certificate that is not FREE stops."""
    if certificate.first_contact is not None:
        return float(certificate.first_contact.time)
    if certificate.undecided is not None:
        return float(certificate.undecided.start)
    return 0.0 if certificate.violation is None else float(certificate.violation.time)
