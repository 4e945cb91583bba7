"""Replanning: another motion for an arm that moves, when the scene has changed.

The rest of the running motion is kept if it is proven free in the new scene. Otherwise a new motion takes over from its
state (position, velocity and acceleration). From this state the arm can brake to rest, and from there a path to a goal
is planned. The motion along both is shortened by the fastest moves between its states, which mostly removes the stop.
If no such motion is proven, the result is a stop that is. Limits are verified on the result, and its certificate is one
of the new scene. No step depends on a clock: the same input gives the same motion.

The new motion has a continuous acceleration, which begins with that of the running motion. An arm that accelerates
towards its velocity limit may not be able to leave the running motion in time, because its acceleration must become
zero first. The new motion then takes over when the running one has ceased to accelerate, a few milliseconds later.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import chain
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, PathConstraint, certify, check_constraints, require_curve
from pinproof.common.results import Answer, Solution, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer, require_positive
from pinproof.errors import PlanFailed
from pinproof.motion import (
    LIMIT_TOLERANCE,
    Bounds,
    CurvePart,
    MotionLimits,
    Move,
    MoveSequence,
    RateConstraint,
    State,
    TorqueLimits,
    Trajectory,
    checked_constraints,
    inside_position_limits,
    least_times,
    rate_excess,
    rest,
)
from pinproof.planning.moves import FreeMoves, trajectory_within
from pinproof.planning.planners import Planner, planner_of
from pinproof.planning.rrt_connect import RrtConnect
from pinproof.planning.simplification import shortcut
from pinproof.spatial import Array, finite

DEVIATION = 0.01
"""rad or m: default deviation of the measured position of each joint from the running motion."""

RAMP = 0.02
"""Seconds in which an acceleration changes from zero to its limit, if no jerk limit is given."""

BUDGET = 45
"""Default number of moves that are computed to shorten a motion, which take about 2 ms."""

# Random samples after which the default planner ends, about 25 ms.
SAMPLES = 4000
# Seconds within which, and at which steps, a state is searched that the limits permit to leave.
LATEST, STEP = 0.25, 0.001
# Share of the velocity limits that an arm that still accelerates must leave, and share that rounding errors may be.
LEAVING, ROUNDING = 1e-6, 1e-10
# Share of the limits of acceleration and jerk that moves use; a motion that begins in motion cannot be slowed down.
SHARE = 0.99
# Seconds between two samples of a motion.
SAMPLE_TIME = 0.04
# Number of stops at random positions, standard deviations (rad or m) of their distances from the end of the fastest
# stop, and share of the joints that differ.
EVASIONS, SPREADS, EVADING = 96, (0.1, 0.3, 0.6, 1.0), 0.6
# Share of the replaced parts that are anywhere; the others are about the end of a move, and extend by these shares of
# the duration before and after it.
ANYWHERE, LEAST_PART, MOST_PART = 0.15, 0.05, 0.4
# Seconds that a replacement must save.
MIN_GAIN = 2e-3
# Number of the shortest motions that are certified before the one that stops.
TRIED = 4
# Share of a velocity limit, and rad or m, that are rounding errors of a speed at rest and of a goal.
AT_REST, SAME_GOAL = 1e-7, 1e-6

Certified = tuple[Trajectory, Certificate]


class ReplanStatus(Enum):
    """The outcome of replanning."""

    KEPT = "the rest of the running motion is proven free and keeps the given limits"
    CHANGED = "a new motion takes over, which does not stop before its goal"
    CHANGED_WITH_STOP = "a new motion takes over, which stops before the goal"
    STOP = "no motion to a goal was found; a stop is proven free"
    UNPROVEN_STOP = "no motion to a goal was found, and no stop is proven free"
    OFF_MOTION = "the measured position deviates from the running motion by more than the tolerance"


@described(eq=False)
class Replan(Answer):
    """The motion that continues a running one, or the reason why none is proven.

    Where there is no motion, reading it raises :class:`pinproof.errors.PlanFailed`.
    """

    failure = PlanFailed
    not_pickled = ("checker",)

    status: ReplanStatus = key("KEPT, CHANGED or CHANGED_WITH_STOP if the motion ends at a goal, else the reason")
    message: str = key("the outcome; if no motion is proven, with the contact and its time on the clock of `running`")
    takeover: float = key("where `trajectory` begins on the clock of `running`, which continues until then", "s")
    goals: Array = key("(g, n) the goals")
    checker: CollisionChecker = key("that of the certificate, with finer bodies if ends touch only coarse ones")
    settings: Mapping[str, Any] = key("the keywords of the call, which :meth:`replan` repeats")
    trajectory: Solution[Trajectory] = key("the motion; if UNPROVEN_STOP, the fastest stop, if any", default=Solution())
    certificate: Solution[Certificate] = key("its certificate, FREE except for that stop", default=Solution())

    @property
    def ok(self) -> bool:
        """Whether the motion ends at a goal and is proven free."""
        return self.status in (ReplanStatus.KEPT, ReplanStatus.CHANGED, ReplanStatus.CHANGED_WITH_STOP)

    @property
    def proven(self) -> bool:
        """Whether the motion is proven free; it ends at a goal or is a stop."""
        return self.ok or self.status is ReplanStatus.STOP

    def replan(self, checker: CollisionChecker, q_now: npt.ArrayLike, t_now: float, **settings: Any) -> Replan:
        """Replan this motion as :func:`replan` does, to the same goals and with the same settings unless given."""
        return replan(self.trajectory, checker, q_now, t_now, **{**self.settings, "goals": self.goals, **settings})

    def _view(self) -> View:
        return View(f"{self.status.name}: {self.message}", [vars(self)["trajectory"], vars(self)["certificate"]])


def replan(
    running: Trajectory,
    checker: CollisionChecker,
    q_now: npt.ArrayLike,
    t_now: float,
    *,
    goals: npt.ArrayLike | None = None,
    delay: float = 0.0,
    tolerance: npt.ArrayLike = DEVIATION,
    limits: MotionLimits | None = None,
    jerk: npt.ArrayLike | Literal["limits"] | None = None,
    rate_limits: Sequence[RateConstraint] = (),
    constraints: Sequence[PathConstraint] = (),
    planner: Planner | str | None = None,
    rng: int = 0,
    budget: int = BUDGET,
) -> Replan:
    """Continue a running motion in a scene that has changed: keep it, replace it from its present state, or stop.

    The new motion begins with the position, velocity and acceleration of the running one, and keeps the limits.

    Parameters
    ----------
    running
        The motion that the robot executes; it ends at rest.
    checker
        The arm in the new scene. Its margin must cover the deviations of the robot from its motion.
    q_now, t_now
        (n,) the measured position (rad or m), and the time (s) since the start of the motion.
    goals
        (n,) or (g, n) configurations, at any of which the motion may end; by default, the end of ``running``.
    delay
        Seconds from ``t_now`` until the controller can take over a new motion. Until then it follows ``running``, which
        must be proven free so far.
    tolerance
        rad or m, one number or (n,): the largest deviation of ``q_now`` from ``running``. The new motion begins on
        ``running``, not at ``q_now``.
    limits, jerk
        As for :func:`pinproof.time_parametrise`. Without a jerk limit, an acceleration changes from zero to its limit
        in :data:`~pinproof.planning.replanning.RAMP` seconds.
    rate_limits, constraints
        As for :func:`pinproof.optimise`.
    planner
        Finds the path; by default :class:`pinproof.RrtConnect` with a small budget of samples.
    rng
        The seed.
    budget
        Number of moves that are computed to shorten the motion.

    Raises
    ------
    InputError
        If the joints differ, the time is negative, or after the end of a motion that does not end at rest, or a number
        or setting is invalid.
    """
    settings = {
        "delay": delay, "tolerance": tolerance, "limits": limits, "jerk": jerk, "rate_limits": rate_limits,
        "constraints": constraints, "planner": planner, "rng": rng, "budget": budget,
    }  # fmt: skip
    require_curve(running, checker, "running motion")
    require_positive("delay (s)", delay, zero=True)
    require_integer("budget", budget, 0)
    names, n = checker.group.joint_names, checker.group.dof
    remaining, now, duration = running.after(t_now), float(t_now), running.duration
    aims = finite("goals", np.atleast_2d(running.end if goals is None else np.asarray(goals)), (None, n))
    allowed = finite("tolerance", np.full(n, tolerance) if np.ndim(tolerance) == 0 else tolerance, (n,))

    def result(status: ReplanStatus, message: str, begin: float, motion: Certified | None = None) -> Replan:
        return Replan(status, message, begin, aims, checker, settings, *(motion or ()))

    # The measurement must fit the running motion, which is kept if its rest is free. Ends that are in contact only with
    # coarse bodies need finer ones.
    deviation = np.abs(finite("q_now", q_now, (n,)) - remaining.start)
    if (deviation > allowed).any():
        j = int((deviation - allowed).argmax())
        message = f"{names[j]} deviates by {deviation[j]:.4g} rad or m from the running motion at t = {now:.4g} s; "
        return result(ReplanStatus.OFF_MOTION, f"{message}the tolerance is {allowed[j]:.4g}", now)
    for end in (remaining.start, remaining.end):
        checker = checker if checker.is_free(end) else checker.finer_at(end)
    kept, further = check_constraints(constraints), checked_constraints(rate_limits)
    proof = certify(remaining, checker, constraints=kept)
    bounds = Bounds.of(checker.group.limits if limits is None else limits, names, jerk)
    compared = bounds if limits is not None else replace(bounds, acceleration=np.full(n, np.inf))
    within = _keeps(running, now, compared, further)
    if proof.free and within and (np.abs(aims - running.end) <= SAME_GOAL).all(axis=1).any():
        return result(ReplanStatus.KEPT, f"the running motion is kept: {proof.message}", now, (remaining, proof))
    elsewhere = "the running motion ends elsewhere" if within else "the running motion exceeds the given limits"
    reason = elsewhere if proof.free else f"of the running motion, {_why(proof, now)}"
    # The state in which a new motion takes over; the running motion must be free until then.
    if bounds.jerk is None:
        note = f"{bounds.note}; accelerations change within {RAMP:g} s"
        bounds = replace(bounds, jerk=bounds.acceleration / RAMP, note=note)
    takeover, state = _takeover(running, now + delay, bounds)
    search = _Continuation(checker, state, aims, bounds, further, kept, rng)
    if not proof.free and takeover > now:
        before = certify(
            CurvePart.of(running, min(now, duration), min(takeover, duration)), checker, constraints=kept, limits=None
        )
        if not before.free:
            message = f"no new motion can take over before t = {takeover:.4g} s: {_why(before)}"
            return result(ReplanStatus.UNPROVEN_STOP, message, takeover, search.stop())
    # A motion to a goal, or a stop.
    found, failure = search.motion_to(planner, budget)
    checker = search.checker
    if found is not None:
        moving = np.abs(found[0].velocities[1:-1]) > AT_REST * bounds.velocity
        status = ReplanStatus.CHANGED if moving.any(axis=1).all() else ReplanStatus.CHANGED_WITH_STOP
        message = f"a new motion of {found[0].duration:.3g} s takes over at t = {takeover:.4g} s: {found[1].message}"
        return result(status, f"{message}; {reason}", takeover, found)
    stop, failure = search.stop(), f"no motion to a goal was found: {failure}; {reason}"
    if stop is not None and stop[1].free:
        message = f"a stop of {stop[0].duration:.3g} s takes over at t = {takeover:.4g} s: {stop[1].message}"
        return result(ReplanStatus.STOP, f"{message}; {failure}", takeover, stop)
    contact = "the limits permit none" if stop is None else _why(stop[1], takeover)
    return result(ReplanStatus.UNPROVEN_STOP, f"no stop is proven free: {contact}; {failure}", takeover, stop)


def _why(proof: Certificate, begin: float = 0.0) -> str:
    """Why a motion that begins at ``begin`` (s) is not proven, with the time on that clock."""
    if (met := proof.first_contact) is None:
        return proof.message
    return f"{' and '.join(met.bodies)} are in contact at t = {begin + met.time:.3f} s"


def _keeps(running: Trajectory, now: float, bounds: Bounds, rate_limits: Sequence[RateConstraint]) -> bool:
    """Whether a motion keeps limits from a time on: of the joints, torques and the tool."""
    left = running.bezier()[0][1:] > now
    if left.any() and bounds.jerk is not None and running.interpolant == "cubic":  # its acceleration jumps
        return False
    largest = rate_excess(running, bounds, rate_limits)[left].max(initial=0.0)
    return bool(largest <= 1.0 + LIMIT_TOLERANCE) and inside_position_limits(running.after(now), bounds)


def _takeover(running: Trajectory, earliest: float, bounds: Bounds) -> tuple[float, State]:
    """The first time at which the limits permit to leave a motion, and the state there; the earliest time if none."""
    jerk, first = SHARE * np.asarray(bounds.jerk), None
    for time in np.arange(earliest, earliest + LATEST, STEP).tolist():
        at = min(time, running.duration)
        q, velocity, acceleration = running(at), running.velocity(at), running.acceleration(at)
        if at == running.duration:
            acceleration = np.zeros_like(q)  # the arm rests afterwards
        state = q.tolist(), velocity.tolist(), acceleration.tolist()
        first = first or (time, state)
        # The velocity when the acceleration has become zero: below the limit, or not above the present one.
        then = np.abs(velocity + acceleration * np.abs(acceleration) / (2.0 * jerk))
        most = np.maximum(np.abs(velocity), (1.0 - LEAVING) * bounds.velocity) + ROUNDING * bounds.velocity
        if (then <= most).all() and (np.abs(acceleration) <= (1.0 + ROUNDING) * bounds.acceleration).all():
            return time, state
    return first  # type: ignore[return-value]  # there is at least one time


@dataclass
class _Continuation:
    """Motions and stops from a state of the running motion; ``checker`` certifies them."""

    checker: CollisionChecker
    state: State
    aims: Array
    bounds: Bounds
    rate_limits: Sequence[RateConstraint]
    constraints: Sequence[PathConstraint]
    seed: int

    def __post_init__(self) -> None:
        of_motion = np.array([self.state[0]]), self.rate_limits, self.constraints
        self._moves = FreeMoves(self.checker, self.bounds, *of_motion, share=SHARE, step=SAMPLE_TIME, moving=self.state)
        self._fastest = self._moves.steering.stop(self.state)
        self._untried, self._tried = self._stops(), list[Move]()

    def motion_to(self, planner: Planner | str | None, budget: int) -> tuple[Certified | None, str]:
        """A certified motion to one of the goals; or None, and why."""
        # A path from the end of a stop.
        if (stop := next(self._untried, None)) is None:
            return None, "no stop is free at samples"
        self._tried.append(stop)
        torques = next((limit for limit in self.rate_limits if isinstance(limit, TorqueLimits)), None)
        keeping: Any = {"constraints": self.constraints, "torque_limits": torques, "rng": self.seed}
        default = RrtConnect(max_samples=SAMPLES, time_limit=math.inf)
        start = stop.state(stop.duration)[0] if stop.duration > 0.0 else self.state[0]
        planned = planner_of(planner or default).plan(self.checker, start, self.aims, **keeping)
        if not planned.ok:
            return None, planned.message
        # The motion along it, which stops at its waypoints, is shortened. The shortest motion that is proven counts.
        path = shortcut(planned.path, planned.checker, attempts=0, **keeping)
        edges = [self._moves.gentle.straight(*edge) for edge in zip(path.q[:-1], path.q[1:], strict=True)]
        moves = [move for move in (stop, *edges) if move is not None and move.duration > 0.0]
        if None in edges or not moves:
            return None, "the limits permit no move along the path"
        stopping = MoveSequence(moves)
        self.checker = planned.checker
        for motion in (*self._shortened(stopping, budget)[: -TRIED - 1 : -1], stopping):
            if (certified := self._certified(motion)) is not None and certified[1].free:
                return certified, ""
        return None, "the motion along the path is not proven free within the limits"

    def stop(self) -> Certified | None:
        """The first stop that is proven free; otherwise the fastest one, or None if the limits do not permit it."""
        if self._fastest is None:
            return None
        stops = (self._certified(MoveSequence([stop])) for stop in chain(self._tried, self._untried))
        proven = (stop for stop in stops if stop is not None and stop[1].free)
        return next(proven, None) or self._certified(MoveSequence([self._fastest]))

    def _stops(self) -> Iterator[Move]:
        """Stops that are free at samples: the fastest one, and others at random positions near its end."""
        if (fastest := self._fastest) is None:
            return
        # Not by the extremes of ruckig: those of a stop contain 0, which may be outside the limits
        q = np.array([fastest.state(0.0)[0], *(state[0] for state in fastest.states(SAMPLE_TIME))])
        low, high = self.bounds.lower - LIMIT_TOLERANCE, self.bounds.upper + LIMIT_TOLERANCE
        if ((low <= q) & (q <= high)).all() and self._moves.free(q):
            yield fastest
        rng, end = np.random.default_rng(self.seed), q[-1]
        for spread in np.resize(SPREADS, EVASIONS if fastest.duration > 0.0 else 0):
            away = spread * rng.standard_normal(len(end)) * (rng.random(len(end)) < EVADING)
            target = (end + away).clip(self.bounds.lower, self.bounds.upper)
            yield from self._moves.connect([self.state, rest(target)], math.inf) or ()

    def _shortened(self, motion: MoveSequence, budget: int) -> list[MoveSequence]:
        """Motions that follow from a motion by the fastest moves between its states, each shorter than the previous."""
        moves, rng, found = self._moves, np.random.default_rng(self.seed), [motion]

        def connect(start: float, end: float, target: State | None = None) -> bool:
            last = found[-1]
            states = [last.state(start) if start > 0.0 else self.state, target or last.state(end)]
            new = moves.connect(states, end - start - MIN_GAIN)
            found.extend([] if new is None else [last.replaced(start, end, new)])
            return new is not None

        # The direct move to the nearest goal is the optimum. Then random parts are replaced, mostly about the ends of
        # moves, where the arm is slow. A motion that still stops gets twice the budget.
        until = moves.computed + budget
        nearest = self.aims[least_times(self.aims - self.state[0], self.bounds, full_speed=True).argmin()]
        direct = budget > 0 and connect(0.0, motion.duration, rest(nearest))
        while not direct and len((motion := found[-1]).moves) > 1:
            stops = any(not any(motion.state(time)[1]) for time in motion.times[1:-1])
            if moves.computed >= until + (budget if stops else 0):
                break
            kind, *draws = rng.random(3).tolist()
            if kind < ANYWHERE:
                start, end = sorted(draw * motion.duration for draw in draws)
            else:
                middle = motion.times[int(rng.integers(1, len(motion.moves)))]
                before, after = ((LEAST_PART + (MOST_PART - LEAST_PART) * draw) * motion.duration for draw in draws)
                start, end = max(middle - before, 0.0), min(middle + after, motion.duration)
            connect(start, end)
        return found[1:]

    def _certified(self, motion: MoveSequence) -> Certified | None:
        """The motion as a trajectory with its certificate; None if it exceeds a limit."""
        end = np.array(motion.state(motion.duration)[0])
        off = np.abs(self.aims - end).max(axis=1)
        if off.min() <= SAME_GOAL:  # by rounding errors
            end = self.aims[off.argmin()]
        names = self.checker.group.joint_names
        timed = trajectory_within(motion, names, self.state, rest(end), self.bounds, self.rate_limits, smooth=True)
        return None if timed is None else (timed, certify(timed, self.checker, constraints=self.constraints))
