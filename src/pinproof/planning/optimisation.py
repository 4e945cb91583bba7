"""Shorter motions: a planner's path becomes a timed and certified motion that is locally time-optimal.

The search works on timed motions, in the space of positions, velocities and accelerations. It replaces parts of the
motion by the fastest move between the states at two times, directly (time-optimal shortcuts) or through a modified
state between them. A replacement is accepted if it is shorter, within all limits, and free at its samples; the motion
is proven collision-free after each phase of the search, and otherwise the last proven motion is restored.

Source: K. Hauser, V. Ng-Thow-Hing, "Fast smoothing of manipulator trajectories using optimal bounded-acceleration
shortcuts", ICRA 2010. Jerk-limited moves and modified states are additions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import mul
from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof._core import Manifold, RrtSearch
from pinproof.collision import (
    Certificate,
    CollisionChecker,
    PathConstraint,
    certify,
    check_constraints,
    is_proven_free,
    require_curve,
)
from pinproof.common.results import Shown, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer
from pinproof.model import guess_mark
from pinproof.motion import (
    RATE_TOLERANCE,
    Bounds,
    Curve,
    JointPath,
    MotionLimits,
    Move,
    MoveSequence,
    RateConstraint,
    State,
    Trajectory,
    checked_constraints,
    inside_position_limits,
    least_times,
    rate_excess,
    rest,
    time_parametrise,
)
from pinproof.planning.moves import FreeMoves
from pinproof.planning.problem import manifold_of, sampling_box
from pinproof.spatial import Array, finite

# Default number of evaluations: about 25 ms for an arm of seven joints between shelves.
BUDGET = 500
# Seconds between two samples of a motion, in which acceleration bends it by few millimetres.
SAMPLE_TIME = 0.06
# A replacement is accepted if it saves this share of the duration, or this time (s) for motions of less than 1 s.
MIN_GAIN = 2e-3
# The search ends when the motion is longer than the lower bound by this share at most.
CLOSE_ENOUGH = 1e-3
# Number of goals that are considered, those with the lowest bounds of the duration.
GOALS = 6
# Goals that differ by at most this (rad or m) in each joint count as one: their motions are similar.
DISTINCT = 0.15
# Number of staggered moves that are tried in addition for each evaluation of the budget, in a tenth of its time.
STAGGERED = 4
# As above for staggered moves, few of which are free: number of goals, and their smallest difference (rad or m).
STAGGERED_GOALS, STAGGERED_DISTINCT = 80, 0.05
# Number of further paths that are compared with the given one, at most one for so many evaluations.
PLANS, PER_PLAN = 10, 33
# Length of an edge (rad or m), numbers of random samples and of collision checks of the search for each further path,
# after which it ends, and number of random samples that are drawn at a time.
PLAN_STEP, PLAN_SAMPLES, PLAN_CHECKS, PLAN_DRAWS = 0.7, 2000, 5000, 64
# Share of the replaced parts that are between two random times; the others are around a slow state.
ANY_WINDOW = 0.3
# Shares of the duration that a replaced part extends before and after a slow state.
LEAST_WINDOW, MOST_WINDOW = 0.05, 0.4
# Share of the replacements of a motion that are shortcuts; the others pass a modified state.
SHORTCUTS = 0.85
# Share of the limits of velocity and acceleration within which a modified state remains.
INSIDE = 0.9999
# With rate constraints such as torques, share of the budget for a motion without them, which is then slowed down.
FREE_SEARCH = 0.3
# Share of the acceleration and jerk limits that this motion uses, so that it needs little slowing down.
GENTLE_SHARE = 0.75
# Largest factor by which the given motion is slowed down for the search.
MAX_SLOWDOWN = 1.1
# Share of the tolerance of a constraint of the tcp that samples may use, because it holds between samples too.
TOLERANCE_SHARE = 0.99
# Number of earlier motions of a phase that are tried if its result is not proven.
BACKTRACKS = 4
# Share of the budget for shortening the first motions; the rest is for the best motion.
CONNECT = 0.75
# Number of attempts to satisfy all limits by slowing down the complete motion, usually by less than 0.1 %.
SLOW_ROUNDS = 8


@described(eq=False)
class OptimiseResult(Shown):
    """A timed and certified motion."""

    trajectory: Trajectory = key("the motion")
    certificate: Certificate = key("its certificate. It is FREE, unless not even the given path could be certified")
    goal: int | None = key(
        "the index of the goal at which the motion ends; None if it is the end of the path and not one of the goals"
    )
    duration_before: float = key("duration of the given path with time-optimal timing", "s")
    lower_bound: float = key(
        "a lower bound of the duration of every motion from the start to one of the goals, without obstacles", "s"
    )
    evaluations: int = key("number of moves that were computed")
    message: str = key("the outcome as text")

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return self.trajectory.duration

    def _view(self) -> View:
        lines = (repr(self.trajectory), f"{self.evaluations} evaluations")
        return View(self.message, [self.trajectory, self.certificate], lines)


def optimise(
    path: Curve,
    checker: CollisionChecker,
    *,
    limits: MotionLimits | None = None,
    jerk: npt.ArrayLike | Literal["limits"] | None = None,
    goals: npt.ArrayLike | None = None,
    rate_limits: Sequence[RateConstraint] = (),
    constraints: Sequence[PathConstraint] = (),
    rng: int | np.random.Generator = 0,
    budget: int = BUDGET,
) -> OptimiseResult:
    """Make a motion as short as the robot allows: a timed trajectory that is locally time-optimal and certified.

    The result has another geometry than the path, and is never slower than the path with time-optimal timing. It does
    not depend on a clock: the same input gives the same trajectory.

    Parameters
    ----------
    path
        The path of a planner, or a shortened or rounded one.
    checker
        Defines the bodies and margins, such as :attr:`PlanResult.checker`.
    limits, jerk
        As for :func:`~pinproof.time_parametrise`; by default, ``limits`` are the limits of the arm. Without a jerk
        limit the result is a cubic, with a jerk limit a quintic.
    goals
        (n,) or (g, n) configurations, at any of which the motion may end, such as all IK solutions of the goal pose.
        By default, the end of the path, which is always a goal. Goals that are not free are ignored.
    rate_limits
        Further limits on the motion, such as torques, as for :func:`~pinproof.time_parametrise`.
    constraints
        Constraints of the tcp, such as :class:`~pinproof.collision.Upright`, that the path satisfies. The certificate
        covers them. Goals that violate them are ignored.
    rng
        Seed or Generator of the random replacements.
    budget
        Number of evaluations, each the computation of a move between two states and its check; four staggered moves,
        which take less time, are tried in addition for each. With 0, the path is timed and certified only.

    Raises
    ------
    InputError
        If the path does not move the joints of the arm, or a limit, a goal or the budget is invalid.
    TimingError
        If the path cannot be timed within the limits.
    """
    arm = checker.group
    require_curve(path, checker, "path")
    require_integer("budget, the number of evaluations,", budget, 0)
    further = checked_constraints(rate_limits)
    bounds = Bounds.of(arm.limits if limits is None else limits, arm.joint_names, jerk)
    kept = check_constraints(constraints)
    manifold, tolerances = (
        manifold_of(checker.group, kept) if kept else None,
        np.array([constraint.tolerance for constraint in kept]),
    )
    ends = _goals(goals, path.end, bounds, checker, manifold, tolerances)
    before = time_parametrise(path, arm.limits if limits is None else limits, jerk=jerk, rate_limits=further)
    lower_bound = float(least_times(ends - path.start, bounds).min())
    task = _MotionTask(checker, bounds, path, before, ends, further, kept, manifold)
    # The shortest motion of the search that keeps all limits, if necessary slower, and is certified; otherwise the path
    # with its timing.
    trajectory, certificate, evaluations = before, None, 0
    if budget and (further or before.duration > lower_bound * (1.0 + CLOSE_ENOUGH)):
        search = _MotionSearch(task, np.random.default_rng(rng), int(budget))
        if search.worthwhile:
            search.run()
        evaluations = search.evaluations
        for proven in reversed(search.proven):
            faster = _timed(search.trajectory(*proven), bounds, further)
            if faster is not None and faster.duration < before.duration:
                proof = certify(faster, checker, constraints=kept)
                if proof.free:
                    trajectory, certificate = faster, proof
                    break
    if certificate is None:
        certificate = certify(before, checker, constraints=kept)
    given = ends if goals is None else np.atleast_2d(np.asarray(goals, dtype=float))
    index = next(iter(np.flatnonzero((given == trajectory.end).all(axis=1)).tolist()), None)
    message = (
        f"duration reduced from {before.duration:.3g} s to {trajectory.duration:.3g} s"
        f"{guess_mark(trajectory.limits_note)}, lower bound without obstacles {lower_bound:.3g} s; "
        f"{certificate.message}"
    )
    return OptimiseResult(trajectory, certificate, index, before.duration, lower_bound, evaluations, message)


def _goals(
    goals: npt.ArrayLike | None,
    end: Array,
    bounds: Bounds,
    checker: CollisionChecker,
    manifold: Manifold | None,
    tolerances: Array,
) -> Array:
    """(g, n) the free goals inside the limits that satisfy the constraints, or the end of the path."""
    if goals is None:
        return end[None]
    rows = finite("goals", np.atleast_2d(np.asarray(goals, dtype=float)), (None, len(end)))
    inside = ((rows >= bounds.lower) & (rows <= bounds.upper)).all(axis=1)
    free = rows[inside]
    free = free[checker.is_free_batch(free)] if len(free) else free
    if manifold is not None:
        free = free[[bool((manifold.errors(q) <= tolerances).all()) for q in free]]
    return free if len(free) and np.abs(free - end).max(axis=1).min() == 0.0 else np.vstack([end, free])


def _timed(trajectory: Trajectory, bounds: Bounds, constraints: Sequence[RateConstraint]) -> Trajectory | None:
    """The motion within all limits, if necessary slower; None if this is not possible."""
    for _ in range(SLOW_ROUNDS):
        excess = float(rate_excess(trajectory, bounds, constraints).max())
        # A jerk changes with the third power of the factor, so that a third of the tolerance is that of a jerk.
        if excess <= 1.0 + RATE_TOLERANCE / 3.0:
            return trajectory if inside_position_limits(trajectory, bounds) else None
        if not math.isfinite(excess):
            return None
        trajectory = trajectory.slowed(excess * (1.0 + 1e-9))
    return None


@dataclass(frozen=True, eq=False)
class _MotionTask:
    """What is searched for: the shortest motion from the start of ``path`` to one of ``goals`` (g, n).

    ``before`` is the path with time-optimal timing; ``manifold`` are the ``constraints`` in the compiled core.
    """

    checker: CollisionChecker
    bounds: Bounds
    path: Curve
    before: Trajectory
    goals: Array
    rate_limits: tuple[RateConstraint, ...] = ()
    constraints: tuple[PathConstraint, ...] = ()
    manifold: Manifold | None = None


class _MotionSearch:
    """The search for the shortest motion.

    ``proven`` are the motions that were proven free, each shorter than the previous one, with the index of their goal;
    ``evaluations`` is the number of moves that were computed.
    """

    def __init__(self, task: _MotionTask, rng: np.random.Generator, budget: int, *, share: float = 1.0) -> None:
        self._task, self._bounds, self._path = task, task.bounds, task.path
        self._rng, self._goals, self._start = rng, task.goals, np.asarray(task.path.start)
        self._moves = FreeMoves(
            task.checker, task.bounds, np.array([task.path.start, task.path.end]), task.rate_limits, task.constraints,
            share=share, step=SAMPLE_TIME, tolerance=TOLERANCE_SHARE, middle_first=True,
        )  # fmt: skip
        self._edges = self._moves.edges
        self._left, self.evaluations, self._staggered = budget, 0, STAGGERED * budget
        self._best, self._goal = self._given()
        self._found: list[tuple[MoveSequence, int]] = []
        self.proven: list[tuple[MoveSequence, int]] = []
        self._bound_of = least_times(task.goals - task.path.start, task.bounds)
        self._enough = float(self._bound_of.min()) * (1.0 + CLOSE_ENOUGH)
        self._per_velocity = (1.0 / task.bounds.velocity).tolist()

    @property
    def worthwhile(self) -> bool:
        """Whether the given motion is longer than the lower bound."""
        return self._best.duration > self._enough

    def run(self) -> None:
        """Search until the budget is used up or the motion is as short as its lower bound."""
        budget = self._left
        if self._task.rate_limits:
            # A motion without rate constraints, slowed down until it satisfies them at samples.
            search = _MotionSearch(
                replace(self._task, rate_limits=()), self._rng, int(FREE_SEARCH * budget), share=GENTLE_SHARE
            )
            search._staggered = self._staggered
            search.run()
            self._spend(search.evaluations)
            if search.proven:
                motion, goal = search.proven[-1]
                trajectory = search.trajectory(motion, goal)
                slowdown = self._moves.gentle.slowdown(trajectory)
                if slowdown == 1.0 and motion.duration < self._best.duration:
                    self._best, self._goal = motion, goal
                    self.proven.append((motion, goal))
                if math.isfinite(slowdown):
                    slower = trajectory.slowed(slowdown) if slowdown > 1.0 else trajectory
                    self._found.append((MoveSequence.of(slower, self._bounds), goal))
        # The fastest move to a goal is the optimum where no obstacle is; the goals in the order of their bounds.
        for goal in self._promising(GOALS):
            moves = self._connect([rest(self._start), rest(self._goals[goal])], self._best.duration)
            if moves is not None:
                self._best, self._goal = MoveSequence(moves), goal
                self._prove()
                break
        # Moves whose joints choose when they move pass obstacles as fast as direct moves, or little slower.
        if self._best.duration > self._enough and self._task.manifold is None and not self._task.rate_limits:
            goals = self._promising(STAGGERED_GOALS, STAGGERED_DISTINCT)
            if goals:
                steering, step = self._moves.steering, self._moves.step
                staggered = steering.staggered(self._edges.core, self._start, self._goals[goals], step)
                draws = self._rng.random((self._staggered, staggered.draws_per_motion))
                found = staggered.run(self._limit(self._best.duration), draws)
                if found is not None:
                    self._best, self._goal = MoveSequence([Move(found)]), goals[found.goal]
                    self._prove()
        # The given motion and motions along further paths are shortened, then the best one alone.
        if self._best.duration > self._enough:
            self._shorten_first_motions(int(CONNECT * self._left))
            self._prove()
        for last in (False, True):
            self._best = self._improve(self._best, self._goal, self._left if last else self._left // 2)
            self._prove()

    def trajectory(self, motion: MoveSequence, goal: int) -> Trajectory:
        """A motion to a goal as a trajectory."""
        names, bounds = self._path.joint_names, self._bounds
        ends = rest(self._start), rest(self._goals[goal])
        return motion.trajectory(names, bounds.note, *ends, smooth=bounds.jerk is not None)

    def _shorten_first_motions(self, budget: int) -> None:
        """Shorten the given motion, and motions along further paths; the shortest becomes the best one."""
        given = self._given()
        if isinstance(self._path, JointPath) and (stopping := self._stopping(self._path.q)) is not None:
            given = stopping, given[1]
        found = [given, *self._found[-1:]]
        if self.proven:
            found.append((self._best, self._goal))
        # Motions along further paths, if possible to different goals whose bounds are below the duration so far.
        used = {self._goal}
        for _ in range(min(PLANS, budget // PER_PLAN + 1 - len(found))):
            promising = self._promising(GOALS)
            plan = self._plan([goal for goal in promising if goal not in used] or promising) if promising else None
            if plan is None:
                break
            path, goal = plan
            used.add(goal)
            if (motion := self._stopping(path)) is not None:
                found.append((motion, goal))
        # All are shortened in turn, and the better half continues.
        rounds = max(math.ceil(math.log2(len(found))), 1)
        for _ in range(rounds):
            share = budget // (rounds * len(found))
            found = [(self._improve(motion, goal, share), goal) for motion, goal in found]
            found = sorted(found, key=lambda known: known[0].duration)[: (len(found) + 1) // 2]
        self._best, self._goal = min([*found, (self._best, self._goal)], key=lambda known: known[0].duration)

    def _plan(self, goals: list[int]) -> tuple[Array, int] | None:
        """A path (m, n) to one of the goals, with edges that are free at their samples."""
        ends, bounds = np.ascontiguousarray(self._goals[goals]), self._bounds
        search = RrtSearch(
            self._edges.core,
            np.ascontiguousarray(self._start),
            ends,
            sampling_box(self._task.checker.group, np.vstack([self._start, ends])).clip(bounds.lower, bounds.upper),
            step=PLAN_STEP,
            max_nodes=PLAN_SAMPLES,
            max_samples=PLAN_SAMPLES,
            manifold=self._task.manifold,
        )
        event = search.grow(PLAN_CHECKS + self._edges.samples)
        while event is RrtSearch.Event.NEEDS_DRAWS:
            search.add_draws(self._rng.random((PLAN_DRAWS, len(self._start) + 2)))
            event = search.grow(PLAN_CHECKS + self._edges.samples)
        if event is not RrtSearch.Event.MET:
            return None
        forward, backward = search.branch(0, search.meeting(0))[::-1], search.branch(1, search.meeting(1))
        q = np.concatenate([search.configurations(0, forward), search.configurations(1, backward[1:])])
        manifold = self._task.manifold

        def edge_free(a: Array, b: Array) -> bool:
            return (manifold is None or bool(manifold.edge_proven(a, b))) and self._edges.samples_free(a, b)

        kept, first = [0], 0
        while first < len(q) - 1:  # connect each kept waypoint to the farthest one that a free edge reaches
            first = next(
                last for last in range(len(q) - 1, first, -1) if last == first + 1 or edge_free(q[first], q[last])
            )
            kept.append(first)
        return q[kept], goals[backward[-1]]

    def _improve(self, motion: MoveSequence, goal: int, budget: int) -> MoveSequence:
        """Replace random parts of a motion by shortcuts and by moves through modified states."""
        until, bounds = self._left - budget, self._bounds
        fastest, hardest = INSIDE * bounds.velocity, INSIDE * bounds.acceleration
        while self._left > until and motion.duration > self._enough:
            start, end = self._window(motion)
            if end <= start:
                continue
            states = [motion.state(start), motion.state(end)]
            if self._rng.random() >= SHORTCUTS:
                # A state of the part with noise in half of its joints, inside the limits, and often at its position.
                known = motion.state(float(self._rng.uniform(start, end)))
                share = self._rng.random(len(self._start)) < 0.5
                size = 0.3 * self._rng.random() ** 2 * share
                moves_away = self._rng.random() < 0.5
                noise = size * self._rng.standard_normal((3, len(self._start)))
                q = np.array(known[0]) + noise[0] * moves_away
                velocity = np.array(known[1]) + noise[1] * bounds.velocity
                acceleration = np.array(known[2]) + noise[2] * bounds.acceleration
                modified = (
                    q.clip(bounds.lower, bounds.upper).tolist(),
                    velocity.clip(-fastest, fastest).tolist(),
                    acceleration.clip(-hardest, hardest).tolist(),
                )
                states.insert(1, modified)
            moves = self._connect(states, end - start)
            if moves is not None:
                motion = motion.replaced(start, end, moves)
                self._found.append((motion, goal))
        return motion

    def _window(self, motion: MoveSequence) -> tuple[float, float]:
        """The times between which a part of the motion is to be replaced, most often around a slow part."""
        duration = motion.duration
        kind, *shares, before, after = self._rng.random(5).tolist()
        first, second = (share * duration for share in shares)
        if kind < ANY_WINDOW:
            return min(first, second), max(first, second)
        middle = first if self._speed(motion, first) <= self._speed(motion, second) else second
        low, high = (LEAST_WINDOW + (MOST_WINDOW - LEAST_WINDOW) * share for share in (before, after))
        return max(middle - low * duration, 0.0), min(middle + high * duration, duration)

    def _speed(self, motion: MoveSequence, time: float) -> float:
        """The largest share of its velocity limit that a joint uses at a time (s)."""
        return max(map(abs, map(mul, motion.state(time)[1], self._per_velocity)))

    def _stopping(self, path: Array) -> MoveSequence | None:
        """The motion along the edges of a path (m, n) that stops at each waypoint; None if it does not exist."""
        moves = []
        for first, last in pairwise(path.tolist()):
            if first != last:
                move = self._moves.gentle.straight(first, last)
                if move is None:
                    return None
                moves.append(move)
        return MoveSequence(moves) if moves else None

    def _connect(self, states: Sequence[State], duration: float) -> list[Move] | None:
        """The fastest allowed moves from state to state, if they are shorter than a duration; they cost budget."""
        computed = self._moves.computed
        moves = self._moves.connect(states, self._limit(duration))
        self._spend(self._moves.computed - computed)
        return moves

    def _spend(self, evaluations: int) -> None:
        self._left, self.evaluations = self._left - evaluations, self.evaluations + evaluations

    @staticmethod
    def _limit(duration: float) -> float:
        """The duration that a replacement must not reach."""
        return duration - MIN_GAIN * min(duration, 1.0)

    def _promising(self, count: int, distinct: float = DISTINCT) -> list[int]:
        """Goals whose bounds are below the duration of the best motion, the lowest first; no two are similar."""
        chosen: list[int] = []
        for goal in np.argsort(self._bound_of, kind="stable").tolist():
            if len(chosen) == count or self._bound_of[goal] >= self._limit(self._best.duration):
                break
            near = np.abs(self._goals[chosen] - self._goals[goal]).max(axis=1) <= distinct
            if not near.any():
                chosen.append(goal)
        return chosen

    def _prove(self) -> None:
        """Prove the best motion, or return to an earlier one that is proven, and take samples closer to each other."""
        constraints = self._task.constraints

        def is_proven(trajectory: Trajectory) -> bool:
            if not constraints:
                return is_proven_free(trajectory, self._task.checker)
            return certify(trajectory, self._task.checker, constraints=constraints).free

        def free_at_samples(motion: MoveSequence) -> bool:
            count = max(math.ceil(motion.duration / self._moves.step), 2)
            return self._moves.free([motion.state(float(t))[0] for t in np.linspace(0.0, motion.duration, count)])

        found = sorted(self._found, key=lambda known: known[0].duration)
        self._found = []
        tried = (self._best, self._goal)
        for _ in range(BACKTRACKS):
            if self.proven and tried[0].duration >= self.proven[-1][0].duration:
                break
            if is_proven(self.trajectory(*tried)):
                self.proven.append(tried)
                break
            self._moves.step /= 2.0
            self._edges.refine()
            longest = tried[0].duration
            following = (known for known in found if known[0].duration > longest and free_at_samples(known[0]))
            if (next_tried := next(following, None)) is None:
                break
            tried = next_tried
        self._best, self._goal = self.proven[-1] if self.proven else self._given()

    def _given(self) -> tuple[MoveSequence, int]:
        """The given path with its time-optimal timing, and the index of its end.

        It is slowed down somewhat if it uses all of the torque, because moves between its states would not be allowed.
        """
        before = self._task.before
        slowdown = self._moves.gentle.slowdown(before)
        if 1.0 < slowdown < MAX_SLOWDOWN:
            before = before.slowed(slowdown)
        goal = int(np.abs(self._goals - np.asarray(self._path.end)).max(axis=1).argmin())
        return MoveSequence.of(before, self._bounds), goal
