"""Shorter motions: a planner's path becomes a timed and certified motion that is locally time-optimal.

The search works on timed motions, in the space of positions, velocities and accelerations. It replaces parts of the
motion by the fastest move between the states at two times, directly (time-optimal shortcuts) or through a modified
state between them. A replacement is accepted if it is shorter, within all limits, and free at its samples; the motion
is proven collision-free after each phase of the search, and otherwise the last proven motion is restored.

Source: K. Hauser, V. Ng-Thow-Hing, "Fast smoothing of manipulator trajectories using optimal bounded-acceleration
shortcuts", ICRA 2010. Jerk-limited moves and modified states are additions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.collision.certify import is_proven_free
from pinproof.errors import InputError
from pinproof.motion import Curve, JointPath, MotionLimits, Trajectory, time_parametrise
from pinproof.motion.limits import POSITION_TOLERANCE, Bounds
from pinproof.motion.steering import Move, MoveSequence, State, Steering, rest_to_rest_times
from pinproof.planning.edges import Edges
from pinproof.planning.rrt_connect import RrtConnect
from pinproof.planning.simplification import shortcut
from pinproof.spatial import finite

__all__ = ["BUDGET", "OptimiseResult", "optimise"]

Array = npt.NDArray[np.float64]

BUDGET = 600
"""Default number of evaluations: about 20 ms for an arm of seven joints between shelves."""

RESOLUTION = 0.06
"""Metres that bodies move between two samples of a motion that is considered. Motions are proven later."""

SAMPLE_TIME = 0.06
"""Seconds between two samples of a motion, in which acceleration bends it by few millimetres."""

MIN_GAIN = 1e-3
"""A replacement is accepted if it saves this share of the duration, or seconds of a motion shorter than one second."""

CLOSE_ENOUGH = 1e-3
"""The search ends when the motion is longer than the lower bound by this share at most."""

GOALS = 12
"""Number of goals that are considered, those with the lowest bounds of the duration."""

DISTINCT = 0.15
"""Goals that differ by at most this (rad or m) in each joint count as one: their motions are similar."""

PLANS = 3
"""Number of paths to different goals that are compared, with the given one."""

PLAN_SAMPLES = 2000
"""Random samples of each further path after which it is not searched for any more."""

SLOWER = (1.0, 0.7, 0.45)
"""Shares of the acceleration and jerk limits that are tried for a move if further limits apply, such as torques."""

CONNECT, DETOUR = 0.35, 0.35
"""Shares of the budget for shortening the first motions, and for detours from the direct motion to a goal; the rest is
for the best motion."""

SLOW_ROUNDS = 8
"""Number of attempts to satisfy all limits by slowing down the complete motion, usually by less than 0.1 %."""


@dataclass(frozen=True, eq=False)
class OptimiseResult:
    """A timed and certified motion.

    Parameters
    ----------
    trajectory
        The motion.
    certificate
        Its certificate. It is FREE, unless not even the given path could be certified.
    goal
        The index of the goal at which the motion ends; 0 if no goals were given.
    duration_before
        Duration (s) of the given path with time-optimal timing.
    lower_bound
        A lower bound (s) of the duration of every motion from the start to one of the goals, without obstacles.
    evaluations
        Number of moves that were computed.
    message
        The outcome as text.
    """

    trajectory: Trajectory
    certificate: Certificate
    goal: int
    duration_before: float
    lower_bound: float
    evaluations: int
    message: str

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return self.trajectory.duration


def optimise(
    path: Curve,
    checker: CollisionChecker,
    *,
    limits: MotionLimits | None = None,
    jerk: npt.ArrayLike | Literal["limits"] | None = None,
    goals: npt.ArrayLike | None = None,
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
        As for :func:`~pinproof.time_parametrise`; ``limits`` are those of the arm by default. Without a jerk limit the
        result is a cubic, with one a quintic.
    goals
        (n,) or (g, n) configurations, at any of which the motion may end, such as all IK solutions of the goal pose.
        By default, the end of the path. Goals that are not free are ignored.
    rng
        Seed or Generator of the random replacements.
    budget
        Number of evaluations, each the computation of a move between two states and its check. With 0, the path is
        timed and certified only.

    Raises
    ------
    InputError
        If the joints of the path are not those of the arm, or a limit, a goal or the budget is invalid.
    TimingError
        If the path cannot be timed within the limits.
    """
    arm = checker.arm
    if tuple(path.joint_names) != arm.joint_names:
        raise InputError(f"the path has the joints {path.joint_names}, the arm {arm.joint_names}")
    if isinstance(budget, bool) or not isinstance(budget, (int, np.integer)) or budget < 0:
        raise InputError(f"budget = {budget!r}; it must be a number of evaluations, 0 or more")
    bounds = Bounds.of(arm.limits if limits is None else limits, arm.joint_names, jerk)
    ends = _goals(goals, path.end, bounds, checker)
    before = time_parametrise(path, arm.limits if limits is None else limits, jerk=jerk)
    lower_bound = float(rest_to_rest_times(ends - path.start, bounds).max(axis=1).min())
    search = _Search(checker, bounds, path, before, ends, np.random.default_rng(rng), int(budget))
    if before.duration > 0.0 or len(ends) > 1:
        search.run()
    for motion, goal in reversed(search.proven):
        trajectory = _timed(motion, bounds, path.joint_names)
        if trajectory is None or trajectory.duration >= before.duration:
            continue
        certificate = certify(trajectory, checker)
        if certificate.free:
            break
    else:
        trajectory, certificate, goal = before, certify(before, checker), _nearest(ends, path.end)
    index = 0 if goals is None else _nearest(np.atleast_2d(np.asarray(goals, dtype=float)), ends[goal])
    message = (
        f"duration reduced from {before.duration:.3g} s to {trajectory.duration:.3g} s, lower bound without obstacles "
        f"{lower_bound:.3g} s; {certificate.message}"
    )
    return OptimiseResult(
        trajectory, certificate, index, before.duration, lower_bound, search.evaluations, message
    )


def _goals(goals: npt.ArrayLike | None, end: Array, bounds: Bounds, checker: CollisionChecker) -> Array:
    """(g, n) the free goals inside the limits, or the end of the path."""
    if goals is None:
        return end[None]
    rows = finite("goals", np.atleast_2d(np.asarray(goals, dtype=float)), (None, len(end)))
    inside = ((rows >= bounds.lower) & (rows <= bounds.upper)).all(axis=1)
    free = rows[inside]
    free = free[checker.is_free_batch(free)] if len(free) else free
    return free if len(free) and np.abs(free - end).max(axis=1).min() == 0.0 else np.vstack([end, free])


def _nearest(rows: Array, q: Array) -> int:
    return int(np.abs(rows - q).max(axis=1).argmin())


def _timed(motion: MoveSequence, bounds: Bounds, names: tuple[str, ...]) -> Trajectory | None:
    """The motion as a trajectory within all limits, or None if there is none."""
    trajectory = motion.trajectory(names, bounds.note, smooth=bounds.jerk is not None)
    for _ in range(SLOW_ROUNDS):
        excess = bounds.excess(trajectory)
        if not bounds.too_fast(excess).any():
            break
        trajectory = trajectory.slowed(float(excess.max()) * (1.0 + 1e-9))
    else:
        return None
    low, high = trajectory.range()
    inside = (low >= bounds.lower - POSITION_TOLERANCE) & (high <= bounds.upper + POSITION_TOLERANCE)
    return trajectory if inside.all() else None


class _Search:
    """The search for the shortest motion.

    Attributes
    ----------
    proven
        The motions that were proven free, each shorter than the previous one, with the index of their goal.
    evaluations
        Number of moves that were computed.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        bounds: Bounds,
        path: Curve,
        before: Trajectory,
        goals: Array,
        rng: np.random.Generator,
        budget: int,
    ) -> None:
        self._checker, self._bounds, self._path, self._rng = checker, bounds, path, rng
        self._goals, self._start, self._before = goals, np.asarray(path.start), before
        self._edges = Edges(checker, RESOLUTION, np.array([path.start, path.end]))
        self._steering = Steering(bounds)
        self._scale = np.ones(len(path.start))  # rad or m
        self._left, self.evaluations = budget, 0
        self._best, self._goal = MoveSequence.of(before), _nearest(goals, path.end)
        self.proven: list[tuple[MoveSequence, int]] = []
        self._bound_of = rest_to_rest_times(goals - path.start, bounds).max(axis=1)
        self._step = SAMPLE_TIME

    def run(self) -> None:
        """Search until the budget is used up or the motion is as short as its lower bound."""
        budget = self._left
        self._try_direct_moves()
        if not self._near_bound():
            self._shorten_first_motions(int(CONNECT * budget))
            self._prove()
            self._try_detours(int(DETOUR * budget))
            self._prove()
        self._improve(self._left // 2)
        self._prove()
        self._improve(self._left)
        self._prove()

    # -- phases ---------------------------------------------------------------------------------------------------

    def _try_direct_moves(self) -> None:
        """The fastest move to a goal, without obstacles the optimum; the goals in the order of their bounds."""
        for goal in self._promising(GOALS):
            move = self._move(self._steering.rest(self._start), self._steering.rest(self._goals[goal]))
            if move is not None and self._accepts([move], self._best.duration):
                self._best, self._goal = MoveSequence([move]), goal
                self._prove()
                return

    def _shorten_first_motions(self, budget: int) -> None:
        """Shorten the given motion, and motions along further paths; the shortest becomes the best one."""
        first = (self._best, self._goal)
        found = []
        paths = self._plans()
        for number, (motion, goal) in enumerate([first, *paths]):
            share = budget // (len(paths) + 1)
            found.append((self._shortened(motion, share if number else budget - share * len(paths)), goal))
        self._best, self._goal = min(found, key=lambda each: each[0].duration)

    def _plans(self) -> list[tuple[MoveSequence, int]]:
        """Motions along paths to other goals whose bounds are below the duration so far."""
        used, found = {self._goal}, []
        while len(found) + 1 < PLANS:
            left = [goal for goal in self._promising(GOALS) if goal not in used]
            if not left:
                break
            planner = RrtConnect(max_samples=PLAN_SAMPLES, time_limit=np.inf)
            plan = planner.plan(self._checker, self._start, self._goals[left], rng=self._rng)
            if plan.path is None or plan.goal is None or plan.checker not in (None, self._checker):
                break
            used.add(left[plan.goal])
            path = shortcut(plan.path, self._checker, rng=self._rng)
            if (motion := self._stopping(path)) is not None:
                found.append((motion, left[plan.goal]))
        return found

    def _try_detours(self, budget: int) -> None:
        """Moves to a goal through one state beside the direct move."""
        goals = self._promising(GOALS)
        directs = {}
        until = self._left - budget
        while goals and self._left > until:
            goal = goals[int(self._rng.integers(len(goals)))]
            if self._bound_of[goal] >= self._limit(self._best.duration):
                goals.remove(goal)
                continue
            if goal not in directs:
                move = self._move(self._steering.rest(self._start), self._steering.rest(self._goals[goal]))
                directs[goal] = None if move is None else MoveSequence([move])
            direct = directs[goal]
            if direct is None:
                goals.remove(goal)
                continue
            time = self._rng.uniform(0.1, 0.9) * direct.duration
            state = self._modified(direct.state(time), 0.5 * self._rng.random(), 1.0)
            moves = self._through(direct, 0.0, state, direct.duration, self._best.duration)
            if moves is not None:
                self._best, self._goal = MoveSequence(moves), goal

    def _improve(self, budget: int) -> None:
        """Shortcuts and modified states of the best motion."""
        until = self._left - budget
        turn = 0
        while self._left > until and not self._near_bound():
            turn += 1
            if turn % 3 == 0:
                self._best = self._with_shortcut(self._best)
                continue
            duration = self._best.duration
            start, time, end = np.sort(self._rng.uniform(-0.5 * duration, 1.5 * duration, 3)).tolist()
            start, end = max(start, 0.0), min(end, duration)
            if not start < time < end:
                continue
            share = self._rng.random(len(self._start)) < 0.5
            state = self._modified(self._best.state(time), 0.3 * self._rng.random() ** 2, share)
            moves = self._through(self._best, start, state, end, end - start)
            if moves is not None:
                self._best = self._best.replaced(start, end, moves)

    # -- replacements ---------------------------------------------------------------------------------------------

    def _shortened(self, motion: MoveSequence, budget: int) -> MoveSequence:
        until = self._left - budget
        while self._left > until:
            motion = self._with_shortcut(motion)
        return motion

    def _with_shortcut(self, motion: MoveSequence) -> MoveSequence:
        """The motion with the fastest move between two times, if it is accepted."""
        duration = motion.duration
        kind = self._rng.random()
        if kind < 1 / 3:
            start, end = np.sort(self._rng.uniform(0.0, duration, 2)).tolist()
        elif kind < 2 / 3:
            length = self._rng.uniform(0.3, 1.0) * duration
            start = 0.0 if self._rng.random() < 0.5 else duration - length
            end = start + length
        else:
            length, middle = self._rng.uniform(0.1, 0.5) * duration, self._rng.uniform(0.0, duration)
            start, end = max(middle - length / 2, 0.0), min(middle + length / 2, duration)
        move = self._move(motion.state(start), motion.state(end))
        if move is None or not self._accepts([move], end - start):
            return motion
        return motion.replaced(start, end, [move])

    def _modified(self, state: State, size: float, share: npt.ArrayLike) -> State:
        """A state near another one, inside the limits."""
        bounds = self._bounds
        n = len(self._start)
        noise = size * np.asarray(share) * self._rng.standard_normal((3, n))
        q = np.array(state[0]) + noise[0]
        velocity = np.array(state[1]) + noise[1] * bounds.velocity
        acceleration = np.array(state[2]) + noise[2] * bounds.acceleration
        return (
            q.clip(bounds.lower, bounds.upper).tolist(),
            velocity.clip(-bounds.velocity, bounds.velocity).tolist(),
            (0.99 * acceleration.clip(-bounds.acceleration, bounds.acceleration)).tolist(),
        )

    def _through(
        self, motion: MoveSequence, start: float, state: State, end: float, duration: float
    ) -> list[Move] | None:
        """The fastest moves through a state from and to the states at two times, if they are accepted."""
        first = self._move(motion.state(start), state)
        if first is None or first.duration >= self._limit(duration):
            return None
        second = self._move(state, motion.state(end))
        if second is None or not self._accepts([first, second], duration):
            return None
        return [first, second]

    def _stopping(self, path: JointPath) -> MoveSequence | None:
        """The motion along the edges of a path that stops at each waypoint."""
        states = [self._steering.rest(q) for q in path.q]
        moves = [self._move(first, last) for first, last in zip(states[:-1], states[1:], strict=True)]
        kept = [move for move in moves if move is not None]
        return MoveSequence(kept) if kept and len(kept) == len(moves) else None

    def _move(self, first: State, last: State) -> Move | None:
        self._left, self.evaluations = self._left - 1, self.evaluations + 1
        return self._steering.move(first, last)

    def _accepts(self, moves: Sequence[Move], duration: float) -> bool:
        """Whether moves are shorter than a duration, inside the limits, and free at their samples."""
        if sum(move.duration for move in moves) >= self._limit(duration):
            return False
        if not all(self._steering.inside(move) for move in moves):
            return False
        points = [moves[0].state(0.0)[0]]
        for move in moves:
            points += move.points(self._step)
        return bool(self._edges.core.points_free(np.array(points)))

    @staticmethod
    def _limit(duration: float) -> float:
        """The duration that a replacement must not reach."""
        return duration - MIN_GAIN * min(duration, 1.0)

    def _promising(self, count: int) -> list[int]:
        """Goals whose bounds are below the duration of the best motion, the lowest first; no two are similar."""
        chosen: list[int] = []
        for goal in np.argsort(self._bound_of, kind="stable").tolist():
            if len(chosen) == count or self._bound_of[goal] >= self._limit(self._best.duration):
                break
            near = np.abs(self._goals[chosen] - self._goals[goal]).max(axis=1) <= DISTINCT
            if not near.any():
                chosen.append(goal)
        return chosen

    def _near_bound(self) -> bool:
        return self._best.duration <= self._bound_of.min() * (1.0 + CLOSE_ENOUGH)

    def _prove(self) -> None:
        """Prove the best motion, or return to the last proven one and take samples closer to each other."""
        if self.proven and self.proven[-1][0] is self._best:
            return
        trajectory = self._best.trajectory(self._path.joint_names, "", smooth=self._bounds.jerk is not None)
        if is_proven_free(trajectory, self._checker):
            self.proven.append((self._best, self._goal))
            return
        self._step /= 2.0
        self._edges.refine()
        self._best, self._goal = (
            self.proven[-1] if self.proven else (MoveSequence.of(self._before), _nearest(self._goals, self._path.end))
        )
