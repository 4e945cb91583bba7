"""The search for a tool path: rungs, the best sequence of configurations, and curves, refined where none is proven.

1. Rungs: all IK branches of each pose, with each rotation of the tool, tilt and redundant value of a grid
   (:mod:`pinproof.tool_paths.rungs`). The best sequence of nodes is optimal over the grid; finer values follow.
2. A spline through the nodes of the optimum, with a bound of its deviation from the path at every instant
   (:mod:`pinproof.tool_paths.curves`), and the certificate that it is free of contact.
3. Where an edge of the optimum has no such curve, a rung is added in its middle, and below a least distance the edge is
   removed. Then the optimum is computed again, so that it is the optimum over all edges that were not removed.

If the last rung cannot be reached, the farthest one ends a piece and begins the next one. No other division has fewer
pieces: a piece that begins later reaches no farther.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations_with_replacement, groupby, pairwise, product
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.common.steps import step
from pinproof.ik import Clik, IkTask, track
from pinproof.model import Arm
from pinproof.motion import CubicPath
from pinproof.planning import Route, nearest_target, routes_through
from pinproof.spatial import SE3, Array, matrix, pose
from pinproof.tool_paths.curves import CurveMaker, NoCurve, RouteCurve
from pinproof.tool_paths.path import SAME_POSITION, ToolPath
from pinproof.tool_paths.reasons import blocked_rungs, jump, obstruction, smallest_step
from pinproof.tool_paths.result import BlockedPose, Obstruction
from pinproof.tool_paths.rungs import (
    Course,
    Flags,
    Grid,
    LadderSettings,
    PathArm,
    Rung,
    RungLadder,
    fill,
    ladder_of,
    rates_of,
    rungs_of,
)

SPIN = IkTask(rz=False)
"""All coordinates of the tcp except for the rotation about its z axis."""

# Share of the allowed deviation by which corners of the path are rounded, so that the tool need not stop there.
ROUNDED = 0.3
# M: rungs are not added closer than this to each other.
CLOSEST = 5e-4
# Rad/m: steps of at most CLOSEST with a larger rotation for their length count as rotations without a stated speed.
ROTATING = 100.0
# Number of rungs whose nodes are computed at a time, which bounds the memory.
BLOCK = 64
# rad: larger changes of the direction of travel are sharp corners.
SHARP = 0.5
# m/s and rad/s: speed of the tool for which the costs are computed if none is stated.
NOMINAL, NOMINAL_ROTATION = 0.25, 1.0
# Number of configurations that are moved from rung to rung where the grid ends, over how many rungs, and the accuracy
# (m and rad) of their poses; and the number of random ones at the first rung.
MOVED, EXTENDED, EXACT, SAMPLED = 96, 40, 1e-9, 60
# Rounds in which finer values around the optimum are compared, and the shares by which a round must improve the cost to
# be repeated with values of the same size, and for there to be another one.
ROUNDS, IMPROVED, ENOUGH = 12, 0.01, 1e-4
# Number of other sequences that are compared with the optimum over the grid after so many rounds, and by how much (rad
# or m) their ends differ in two joints.
OTHERS, COMPARED, APART = 6, 2, 0.5
# Largest number of times that finer values are compared, without those within so many rungs of an edge where they fail.
ATTEMPTS, KEPT = 3, 2
# rad and m: a motion that starts within this of another one in every joint does not start elsewhere.
NEAR, NEAR_METRES = 1.0, 0.1
# Number of free directions up to which all combinations of their steps are compared.
MOST_SIDES = 3
# rad or m: rungs are added where the joints must move by at most this, as close to singular configurations.
FARTHEST = 2.0
# Largest number of refinements of the parts of a path that cannot be passed as a whole, and of a finer grid.
HOPELESS = 20
# Shares of the step to the least quadratic cost that are compared, its largest size (rad or m), and the least share of
# its speed with which a joint counts.
EVEN, FARTHEST_EVEN, SLOW = np.array([1.0, 0.5, 0.2]), 0.5, 1e-3
# Largest number of times that joints which would leave their limits are held, and how far (rad or m) inside of them.
LEAVING, INSIDE = 4, 2e-3
# Largest number of poses without a node at which a finer grid is compared first, and its distance of poses as a share.
SCREENED, CLOSER = 8, 0.25
# Length of the window over which steps are smoothed, in steps of the grid.
WINDOW = 1.0


@dataclass(frozen=True, eq=False)
class FollowedPiece:
    """A part of the path from one rung to another one, with the curve along each route or part of a route.

    ``q`` (k, n) are the configurations of the curves at the rungs. ``groups`` are the curves of approach, path and
    departure, each with the speed of its pieces at most, and where it is also the speed that is wanted.
    """

    first: int
    last: int
    course: Course
    q: Array
    grid_cost: float
    curves: list[RouteCurve]
    groups: list[list[tuple[CubicPath, Array, Flags]]]
    rotations: Array


@dataclass(kw_only=True, eq=False)
class Search:
    """The state of :func:`follow`; with ``stops``, the tool stops at sharp corners of the path.

    Values between those of the grid are inside ``bounds`` (n,), the limits or less.
    """

    checker: CollisionChecker
    path_arm: PathArm
    path: ToolPath
    grid: Grid
    free: bool
    whole: bool
    spin: tuple[float, float] | None
    deviation: tuple[float, float]
    image: tuple[float, float]
    approach: float
    departure: float
    settings: LadderSettings
    bounds: tuple[Array, Array]
    spacing: tuple[float, float]
    budget: int
    rng: int
    start: Array | None
    avoided: Array
    stops: bool = False
    routes: list[Route] = field(default_factory=list)
    rungs: list[Rung] = field(default_factory=list)
    extended: list[Rung] = field(default_factory=list)
    refined: int = 0
    removed: int = 0
    unproven: str = ""
    exhausted: bool = False

    def run(self) -> tuple[list[FollowedPiece], list[BlockedPose]]:
        """The pieces that can be followed, and the parts of the path between them that cannot be passed.

        If nothing is blocked, each piece begins where the one before ends, and they cover the path, unless the budget
        was used up, which ``exhausted`` states.
        """
        self._make_rungs()
        pieces: list[FollowedPiece] = []
        blocked: list[BlockedPose] = []
        at = 0
        if not all(len(rung.rates) for rung in self.rungs):
            self.budget = min(self.budget, HOPELESS)
        while True:
            piece = self._piece(at)
            last = len(self.rungs) - 1  # rungs may have been added
            if self.exhausted:  # the poses that cannot be passed are the answer, whatever is possible between them
                blocked += self._blocked(self.rungs[at:])
                break
            if piece is not None and (piece.last > at or last == 0):
                pieces.append(piece)
            if piece is not None and piece.last == last:
                break
            end = at if piece is None else piece.last
            # The next rung with nodes: the tool is lifted, or a part of the path cannot be done
            following = next((k for k in range(end + 1, last + 1) if len(self.rungs[k].rates)), None)
            if piece is None or following != end + 1:
                blocked += self._blocked(
                    self.rungs[end if piece is None else end + 1 : last + 1 if following is None else following]
                )
            elif end == at:
                blocked.append(self.jump(piece))
            if following is None:
                break
            at = end if following == end + 1 and end > at else following
        return pieces, blocked

    def again(self, **changed: Any) -> Search:
        """The search before its run, with other settings."""
        return replace(self, routes=[], rungs=[], extended=[], refined=0, removed=0, exhausted=False, **changed)

    def finer(self, blocked: Sequence[BlockedPose]) -> Search | None:
        """The search on a finer grid: of more values if poses are blocked, and of more poses if every step is a jump.

        None if the poses without a node have none there either.
        """
        if all(each.obstruction is Obstruction.JUMP for each in blocked):
            spacing = CLOSER * self.spacing[0], CLOSER * self.spacing[1]
            return self.again(spacing=spacing, budget=min(self.budget, HOPELESS))
        empty = [replace(rung) for rung in self.rungs if not len(rung.rates)]
        if (grid := self.grid.finer()) is None or any(rung.given or rung.avoided for rung in empty):
            return None
        finer, shown = self.again(grid=grid, budget=min(self.budget, HOPELESS)), empty[:: 1 + len(empty) // SCREENED]
        finer._fill(shown)
        return finer if all(len(rung.rates) for rung in shown) else None

    def _blocked(self, rungs: list[Rung]) -> list[BlockedPose]:
        """Why those of consecutive rungs that have no nodes cannot be passed."""
        turns = 0 if self.grid.any_rotation else len(self.grid.turns)
        kinds = groupby(rungs, lambda rung: None if len(rung.rates) else obstruction(rung))
        return [
            blocked_rungs(self.checker, list(rows), turns, self.path.names) for kind, rows in kinds if kind is not None
        ]

    def jump(self, piece: FollowedPiece) -> BlockedPose:
        """Why no node of the next rung is within reach of the last rung of a piece."""
        rungs = self.rungs[piece.last], self.rungs[piece.last + 1]
        failed = f"; {self.unproven}" if self.unproven and self.removed else ""
        return jump(self.arm, piece.course.reachable, rungs, self.path.names, failed)

    @property
    def arm(self) -> Arm:
        """The arm as seen from the frame of the path."""
        return self.path_arm.arm

    @property
    def task(self) -> IkTask:
        """The coordinates of the tcp that the path states."""
        return SPIN if self.free else IkTask()

    @property
    def rounding(self) -> tuple[float, float]:
        """By how much (m, rad) the corners of the path are rounded at most."""
        one, other = (ROUNDED * (total - image) for total, image in zip(self.deviation, self.image, strict=True))
        return one, other

    # -- the grid --------------------------------------------------------------------------------------------------

    def _make_rungs(self) -> None:
        """The routes of the tool and their rungs with all nodes."""
        arm, path = self.arm, self.path
        frames = [SE3(each[:3, :3], each[:3, 3]) for each in path.poses]
        if self.whole:  # the rotation is free, so that the reference rotates as little as possible
            for index in range(1, len(frames)):
                frames[index] = nearest_target(frames[index - 1], frames[index], SPIN)
        corners = [0, *self._sharp(), len(frames) - 1] if self.stops else [0, len(frames) - 1]
        lines = [(float(a), frames[a : b + 1]) for a, b in pairwise(corners)]
        if self.start is not None:
            here = arm.forward_kinematics(self.start)
            if self.whole:
                here = SE3(nearest_target(frames[0], here, SPIN))
            lines.insert(0, (-1.0, [here, frames[0]]))
        elif self.approach > 0.0:
            lines.insert(0, (-1.0, [frames[0] * pose((0.0, 0.0, -self.approach)), frames[0]]))
        if self.departure > 0.0:
            lines.append((len(frames) - 1.0, [frames[-1], frames[-1] * pose((0.0, 0.0, -self.departure))]))
        first, rounding = 0.0, self.rounding
        for at, line in lines:
            routes = [route for route in routes_through(line, *rounding) if route.length > 0.0]
            first = first if self.routes or not routes else at  # without a line from the first pose to itself
            self.routes += routes
        if self.routes:
            self.rungs = rungs_of(self.routes, first, *self.spacing)
        else:
            self.rungs = [Rung(0, 0.0, matrix(frames[0]), 0.0)]
        self._fill(self.rungs)
        if len(self.avoided):  # the motion starts elsewhere
            rung = self.rungs[0]
            elsewhere = self._elsewhere(rung.nodes)
            rung.avoided = not elsewhere.all()
            rung.rates, rung.free[rung.free] = rung.rates[elsewhere], elsewhere
        if self.start is not None:  # the only node of the first rung
            outside = bool(arm.limits.violations(self.start, arm.joint_names))
            one = self.start[None][int(outside) :]
            self.rungs[0].q, self.rungs[0].free, self.rungs[0].outside = (
                one,
                self._allowed(one, self.rungs[:1] * len(one)),
                int(outside),
            )
            self.rungs[0].rates, self.rungs[0].given = np.zeros(int(self.rungs[0].free.sum())), True
        # The grid of two and more free values is coarse: the best motions of an arm with seven joints may be possible
        # only between its values
        if self.settings.steps > 0.0 and arm.dof - (5 if self.free else 6) > 1 and len(self.rungs[0].rates):
            self._extend_all()
        self._connect()

    def _elsewhere(self, q: Array) -> Flags:
        """(k,) whether configurations q (k, n) are not near one of those that the motion avoids as its start."""
        step = q.reshape(-1, 1, self.arm.dof) - self.avoided
        step -= np.where(self.arm.periodic, 2.0 * np.pi * np.round(step / (2.0 * np.pi)), 0.0)
        near = np.all(np.abs(step) <= np.where(self.arm.angular, NEAR, NEAR_METRES), axis=2)
        return np.asarray(~near.any(axis=1))

    def _sharp(self) -> list[int]:
        """The poses at which the direction of travel changes by more than :data:`SHARP`."""
        lengths = self.path.lengths[:, None]
        steps = np.diff(self.path.poses[:, :3, 3], axis=0) / np.maximum(lengths, 1e-300)
        return (1 + np.flatnonzero((steps[1:] * steps[:-1]).sum(axis=1) < np.cos(SHARP))).tolist()

    @step("configurations")
    def _fill(self, rungs: list[Rung]) -> None:
        for first in range(0, len(rungs), BLOCK):
            block = rungs[first : first + BLOCK]
            fill(
                block, self.checker, self.path_arm, self.grid, self.task, self.settings.costs, self.rng,
                ranged=self.spin is not None,
            )  # fmt: skip

    @step("optimum")
    def _connect(self) -> None:
        """The ladder graph over the rungs."""
        places = np.array([rung.place for rung in self.rungs])
        length = np.linalg.norm(np.diff(places[:, :3, 3], axis=0), axis=1)
        turned = np.linalg.norm(np.diff(places[:, :3, :3], axis=0), axis=(1, 2)) / np.sqrt(2.0)
        speed, timed = self._speeds(0.5 * np.array([a.at + b.at for a, b in pairwise(self.rungs)]))
        duration = np.where(timed, length / speed, np.maximum(length / NOMINAL, turned / NOMINAL_ROTATION))
        self._ladder = RungLadder(self.arm, self.rungs, np.maximum(duration, 1e-6), timed, self.settings)

    def _speeds(self, at: Array) -> tuple[Array, Flags]:
        """(k,) the largest speed (m/s) of the tool at places of the path, and where it is the one that is wanted.

        Without a stated speed it is infinite. Where the tool only rotates, no speed is wanted.
        """
        path = self.path
        if path.speed is None or not len(path.speed):
            return np.full(len(at), np.inf), np.zeros(len(at), dtype=bool)
        piece = np.clip(np.floor(at).astype(int), 0, len(path.speed) - 1)
        beyond = (at < 0.0) | (at > len(path) - 1)
        return path.speed[piece], self._moving[piece] | beyond

    @cached_property
    def _moving(self) -> Flags:
        """(N - 1,) on which lines of the path the tool moves, and does not only rotate."""
        columns = slice(2, 3) if self.whole else slice(0, 3)
        change = np.diff(self.path.poses[:, :3, columns], axis=0)
        turned = np.linalg.norm(change, axis=(1, 2)) / (1.0 if self.whole else np.sqrt(2.0))
        moved = (self.path.lengths > SAME_POSITION) & (turned <= ROTATING * self.path.lengths)
        return np.asarray((self.path.lengths > CLOSEST) | moved)

    # -- a piece without lifts -------------------------------------------------------------------------------------

    def _piece(self, first: int) -> FollowedPiece | None:
        """The best certified curves from a rung to the farthest one; None if the rung has no nodes."""
        while True:
            course = self._ladder.solve(first, len(self.rungs) - 1, OTHERS, APART)
            if not len(course.nodes):
                return None
            last = first + len(course.nodes) - 1
            if last < len(self.rungs) - 1 and self._continue(last, course.reachable):
                continue
            # The optimum over finer values may be close to another sequence than that over the grid: that one first.
            # With smoothing; without it if the curve fails; without finer values where it does
            failed, attempts = (first, ""), ATTEMPTS if self.refined < ATTEMPTS else 1
            widths = (WINDOW, 0.0) if self.settings.steps > 0.0 else (0.0,)
            courses = (course, *(course.others if attempts > 1 else ()))
            kept = np.zeros(len(course.nodes), dtype=bool)
            coarse = [self._polished(first, own, kept, COMPARED) for own in courses]
            # Rungs that are far apart hide what a course costs between them, as beside a singular configuration
            full = dict[int, float]()
            for number in sorted(range(len(coarse)), key=lambda k: coarse[k].cost):
                if full and coarse[number].cost >= min(full.values()):
                    break
                full[number] = self._full_cost(first, coarse[number])
            best = min(full, key=lambda number: full[number])
            for own, start in {best: coarse[best], 0: coarse[0]}.items():
                kept[:] = False
                for attempt in range(attempts):
                    polished = self._polished(first, courses[own] if attempt else start, kept)
                    for width in widths:
                        made = self._curves(first, polished, width, course.cost)
                        if isinstance(made, FollowedPiece):
                            return made
                        failed = made
                        kept[max(made[0] - first - KEPT, 0) : made[0] - first + KEPT + 2] = True
                    if polished is courses[own]:  # there are no finer values
                        break
            index, self.unproven = failed
            if self.refined >= self.budget:
                self.exhausted = True
                return None
            self._refine(index, course.nodes[index - first : index - first + 2])

    def _full_cost(self, first: int, course: Course) -> float:
        """The cost of a course with the configurations between its rungs that are closest to straight lines."""
        rungs = self.rungs[first : first + len(course.nodes)]
        gaps = np.array([self._gap(first + k) for k in range(len(rungs) - 1)])
        parts = np.clip(np.ceil(gaps / (CLOSER * self.spacing[0])), 1, 1.0 / CLOSER).astype(int)
        if len(rungs) < 2 or parts.max() == 1:
            return course.cost
        places, guesses = [rungs[0].place[None]], [course.q[:1]]
        for before, after, q, count in zip(rungs, rungs[1:], pairwise(course.q), parts.tolist(), strict=False):
            share, begin = np.arange(1, count + 1) / count, before.s if before.route == after.route else 0.0
            places.append(self.routes[after.route].poses(begin + share * (after.s - begin)))
            guesses.append(q[0] + share[:, None] * (q[1] - q[0]))
        solver = Clik(position_tolerance=EXACT, orientation_tolerance=EXACT, restarts=0)
        found = solver.solve_batch(self.arm, np.concatenate(places), np.concatenate(guesses), task=self.task)
        span = slice(first, first + len(parts))
        ladder = ladder_of(
            self.arm, np.ones(len(found.q), dtype=np.int64), found.q,
            rates_of(self.checker, self.arm, found.q, self.settings.costs), np.zeros(self.arm.dof),
            np.repeat(self._ladder.durations[span] / parts, parts), np.repeat(self._ladder.timed[span], parts),
            self.settings,
        )  # fmt: skip
        whole = ladder.solve(0, len(found.q) - 1)
        return float(whole.cost) if found.ok.all() and len(whole.nodes) == len(found.q) else np.inf

    def _continue(self, last: int, reachable: Array) -> bool:
        """Whether nodes or a rung were added where the farthest rung is not the last one."""
        end = self.rungs[last]
        if self.settings.steps > 0.0 and not self.extended:
            # The branch that continues the path may have ended before, and between the values of the grid
            self._extend_all()
            self._connect()
            return True
        if self.settings.steps > 0.0 and end not in self.extended:
            self.extended.append(end)
            if self._extend(last, reachable, EXTENDED):
                self._connect()
                return True
        step = smallest_step(self.arm, reachable, self.rungs[last + 1].nodes)
        if (
            step is None
            or self.refined >= self.budget
            or np.abs(step[1]).max() > FARTHEST
            or self._gap(last) <= CLOSEST
        ):
            return False
        self._refine(last, np.empty(0, dtype=np.int64))
        return True

    def _extend_all(self) -> None:
        """Add the solutions to all rungs that follow from those of the first rung, and from random ones there."""
        rung = self.rungs[0]
        self.extended.append(rung)
        many = Clik(restarts=SAMPLED).solve_many(self.arm, rung.place, rng=self.rng, count=SAMPLED, task=self.task)
        if self.start is None:
            allowed = self._allowed(many.q, [rung] * len(many.q)) & self._elsewhere(many.q) & self._bounded(many.q)
            self._add(rung, many.q[allowed])
        self._extend(0, rung.nodes, len(self.rungs))

    def _gap(self, index: int) -> float:
        """M: length of the route between a rung and the next one."""
        before, after = self.rungs[index], self.rungs[index + 1]
        begin = before.s if before.route == after.route else 0.0
        return (after.s - begin) * self.routes[after.route].length

    @step("curves")
    def _curves(self, first: int, course: Course, width: float, grid_cost: float) -> FollowedPiece | tuple[int, str]:
        """Curves through the nodes of a course, or the index of the edge along which none was found, and why."""
        last = first + len(course.nodes) - 1
        rungs = self.rungs[first : last + 1]
        allowed = [
            (1.0 - 1e-9) * (total - image - rounding)
            for total, image, rounding in zip(self.deviation, self.image, self.rounding, strict=True)
        ]
        projection = IkTask(rx=False, ry=False, rz=False) if len(self.grid.tilts) > 1 else self.task
        # Between the nodes, joints stay within the bounds too; a given start may be outside
        low, high = np.minimum(self.bounds[0], course.q.min(axis=0)), np.maximum(self.bounds[1], course.q.max(axis=0))
        limits = self.arm.limits
        arm = self.arm.with_limits(replace(limits, lower=limits.clip(low), upper=limits.clip(high)))
        maker = CurveMaker(arm, self.task, allowed[0], allowed[1], self.spin, projection)
        curves: list[RouteCurve] = []
        groups: list[list[tuple[CubicPath, Array, Flags]]] = [[], [], []]
        begin, q = 0, course.q.copy()
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
                    q[begin : end + 1] = made.path(s)
                    knots, ats = made.path.knots, np.array([rung.at for rung in rungs[begin : end + 1]])
                    group = 0 if ats[-1] <= 0.0 else 1 if ats[0] < len(self.path) - 1 else 2
                    groups[group].append((made.path, *self._speeds(np.interp(0.5 * (knots[1:] + knots[:-1]), s, ats))))
                    begin = end
                    continue
            edge = begin + int(np.clip(np.searchsorted(s, where, side="right") - 1, 0, end - begin - 1))
            return first + edge, reason
        return FollowedPiece(first, last, course, q, grid_cost, curves, groups, self._rotations(q, rungs))

    def _rotations(self, q: Array, rungs: list[Rung]) -> Array:
        """(k,) the rotation (rad) of the tool about its axis from the pose of each rung, in its range."""
        places = np.array([rung.place for rung in rungs])[:, :3, :3]
        turn = np.swapaxes(places, 1, 2) @ self.arm.forward_kinematics_batch(q)[:, :3, :3]
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
                self.arm, places, start, dt=1.0, velocity=self.settings.jump, position_tolerance=EXACT,
                orientation_tolerance=EXACT, task=self.task,
            )  # fmt: skip
            reached = (
                (moved.position_error <= EXACT) & (moved.orientation_error <= EXACT) & self._allowed(moved.q, ahead)
            ) & self._bounded(moved.q)
            for number in range(len(ahead) if reached.all() else int(reached.argmin())):
                added[number].append(moved.q[number : number + 1])
        for rung, rows in zip(ahead, added, strict=True):
            self._add(rung, np.concatenate(rows))
        return len(added[0]) > 1

    def _allowed(self, q: Array, rungs: list[Rung]) -> Flags:
        """(k,) whether configurations q (k, n) at rungs have no contact, with the rotation of the tool in its range."""
        allowed = self.checker.is_free_batch(q) if len(q) else np.empty(0, dtype=bool)
        if self.spin is not None and len(q):
            angle = self._rotations(q, rungs)
            allowed &= (angle >= self.spin[0]) & (angle <= self.spin[1])
        return allowed

    def _bounded(self, q: Array) -> Flags:
        """(k,) whether configurations q (k, n) are inside the bounds of values between those of the grid."""
        return np.asarray(((q >= self.bounds[0]) & (q <= self.bounds[1])).all(axis=1))

    def _add(self, rung: Rung, q: Array) -> None:
        """Add nodes q (k, n) without contact to a rung."""
        rung.q = np.concatenate([rung.q.reshape(-1, q.shape[1]), q])
        rung.free = np.append(rung.free, np.ones(len(q), dtype=bool))
        rung.rates = np.append(rung.rates, rates_of(self.checker, self.arm, q, self.settings.costs))

    @step("finer values")
    def _polished(self, first: int, course: Course, kept: Flags, rounds: int = ROUNDS) -> Course:
        """The optimum over finer and finer values around those of a course, which move the tool only about its axis.

        Those at rungs that are ``kept`` (k,) remain. The motions of the joints that keep the tool on the path, apart
        from its free rotation, are the null space of its Jacobian. Each round compares steps to both sides of each
        rung, and shares of the step to the least cost of all rungs together.
        """
        arm, checker, count = self.arm, self.checker, len(course.nodes)
        free = arm.dof - (5 if self.free else 6)
        if free < 1 or count < 2 or self.settings.finest <= 0.0 or len(self.grid.tilts) > 1:
            return course
        rungs, task = self.rungs[first : first + count], self.task
        places = np.array([rung.place for rung in rungs])
        solver = Clik(position_tolerance=EXACT, orientation_tolerance=EXACT, restarts=0)
        # A curve through a value at a limit leaves the limit beside it
        margin = np.minimum(INSIDE, 0.01 * (arm.limits.upper - arm.limits.lower))
        low, high = self.bounds[0] + margin, self.bounds[1] - margin
        sides = np.array(list(product((0.0, -1.0, 1.0), repeat=free)))[1:]
        if free > MOST_SIDES:  # one direction at a time
            sides = np.concatenate([np.eye(free), -np.eye(free)])
        best, size, span = course, 0.5 * self.settings.finest, slice(first, first + count - 1)
        fixed = kept.copy()
        fixed[0] |= first == 0 and (self.start is not None or len(self.avoided) > 0)
        for _ in range(rounds):
            jacobian = np.swapaxes(places[:, :3, :3], 1, 2)[:, None] @ arm.jacobian_batch(best.q).reshape(
                count, 2, 3, -1
            )
            rows = jacobian.reshape(count, 6, -1)[:, : 5 if self.free else 6]
            null = np.linalg.svd(rows)[2][:, -free:]
            even = self._even(first, best.q, null, fixed, low, high)
            moves = [size * np.einsum("sf,kfn->ksn", sides, null), even[:, None] * EVEN[:, None]]
            guesses = (best.q[:, None] + np.concatenate(moves, axis=1)).reshape(-1, arm.dof)
            many = np.repeat(places, width := len(sides) + len(EVEN), axis=0)
            found = solver.solve_batch(arm, many, np.clip(guesses, low, high), task=task)
            near = found.ok & (np.abs(found.q - guesses).max(axis=1) < self.settings.finest)
            near[near] = self._allowed(found.q[near], [rungs[row // width] for row in np.flatnonzero(near)])
            near &= (found.q >= low - 0.5 * margin).all(axis=1) & (found.q <= high + 0.5 * margin).all(axis=1)
            near = near.reshape(count, -1) & ~fixed[:, None]
            at_limit = ((best.q < low - 0.5 * margin) | (best.q > high + 0.5 * margin)).any(axis=1)
            kept_rows = np.column_stack([~at_limit | ~near.any(axis=1), near])
            q = np.concatenate([best.q[:, None], found.q.reshape(count, width, -1)], axis=1)[kept_rows]
            ladder = ladder_of(
                arm, kept_rows.sum(axis=1), q, rates_of(checker, arm, q, self.settings.costs), np.zeros(arm.dof),
                self._ladder.durations[span], self._ladder.timed[span], self.settings,
            )  # fmt: skip
            better = ladder.solve(0, count - 1)
            if len(better.nodes) < count:
                break
            gained = 1.0 - better.cost / max(best.cost, 1e-300)
            best = Course(q[better.nodes], course.nodes, better.cost, course.reachable)
            if gained < IMPROVED:
                size *= 0.5
                if gained < ENOUGH and size < self.settings.finest / 8.0:
                    break
        return best

    def _even(self, first: int, q: Array, null: Array, fixed: Flags, low: Array, high: Array) -> Array:
        """(k, n) the steps of configurations q (k, n) in their null spaces (k, f, n) towards the least cost.

        The effort is quadratic in the steps from rung to rung; the travel and the time are replaced by squares with the
        same slope at the present steps (iteratively reweighted least squares). The minimum solves linear equations that
        are tridiagonal in blocks of f. Joints are kept from ``low`` to ``high``.
        """
        from scipy.linalg import solveh_banded

        count, free, _ = null.shape
        costs, velocity = self.settings.costs, self.arm.limits.velocity
        speed = np.where(np.isfinite(velocity), velocity, 1.0)
        duration = self._ladder.durations[first : first + count - 1, None]
        step = np.diff(q, axis=0)
        r = np.abs(step) / speed
        most = r.max(axis=1, keepdims=True)
        late = (r == most) & (most > np.where(self._ladder.timed[first : first + count - 1, None], duration, 0.0))
        weight = costs.effort / duration + (0.5 * costs.travel + 0.5 * costs.time * late) / np.maximum(
            r, SLOW * duration
        )
        weight /= speed**2
        # The blocks on the diagonal and beside it, and the gradient; configurations that are fixed do not move
        sums = np.zeros_like(q)
        sums[:-1] += weight
        sums[1:] += weight
        pull = np.zeros_like(q)
        pull[:-1] += weight * step
        pull[1:] -= weight * step
        null = np.where(fixed[:, None, None], 0.0, null)
        own = np.einsum("kan,kn,kbn->kab", null, sums, null)
        beside = -np.einsum("kan,kn,kbn->kab", null[:-1], weight, null[1:])
        own += (1e-9 * np.abs(own).max() + 1e-12 + fixed[:, None, None]) * np.eye(free)
        band = np.zeros((2 * free, count, free))
        for a, b in product(range(free), repeat=2):
            band[free - 1 + a - b, 1:, b] = beside[:, a, b]
        # Joints that would leave their limits are drawn to them
        held, stop = np.zeros_like(q), np.zeros_like(q)
        for _ in range(LEAVING):
            block = own + np.einsum("kan,kn,kbn->kab", null, held, null)
            for a, b in combinations_with_replacement(range(free), 2):
                band[2 * free - 1 + a - b, :, b] = block[:, a, b]
            wanted = np.einsum("kan,kn->ka", null, pull + held * stop)
            moved = solveh_banded(band.reshape(2 * free, -1), wanted.ravel()).reshape(count, free)
            moves = np.einsum("ka,kan->kn", moved, null)
            inside = np.clip(q + moves, low, high)
            leaving = (inside != q + moves) & (held == 0.0)
            if not leaving.any():
                break
            held[leaving], stop[leaving] = 1e3 * np.abs(own).max(), (inside - q)[leaving]
        return moves * min(1.0, FARTHEST_EVEN / max(float(np.abs(moves).max()), 1e-12))

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


def _stop(certificate: Certificate) -> float:
    """The parameter at which a certificate that is not FREE stops."""
    if certificate.first_contact is not None:
        return float(certificate.first_contact.time)
    if certificate.undecided is not None:
        return float(certificate.undecided.start)
    return 0.0 if certificate.violation is None else float(certificate.violation.time)
