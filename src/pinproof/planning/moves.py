"""Moves between states that keep all limits of a motion: of the joints, of torques and of the tool.

A move at full acceleration that exceeds a limit of torques or of the tool is computed again with smaller rates: the
joints whose accelerations cause the excess, in the direction in which they cause it, accelerate only as much as the
limit permits at the sample with the largest excess. Other joints, and accelerations in the other direction, such as
braking with the help of gravity, keep their limits. Samples decide; the complete motion is verified later, and the
caller certifies it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, PathConstraint
from pinproof.errors import TimingError
from pinproof.motion import (
    RATE_TOLERANCE,
    Bounds,
    Move,
    MoveSequence,
    RateConstraint,
    State,
    Steering,
    TorqueLimits,
    Trajectory,
    inside_position_limits,
    rate_excess,
)
from pinproof.planning.problem import Edges, manifold_of
from pinproof.spatial import Array

# Metres that bodies move between two samples of an edge; samples of motions are taken in time.
RESOLUTION = 0.06
# Seconds between two samples of a motion with moving ends, in which acceleration bends it by few millimetres.
SAMPLE_TIME = 0.04
# Share of the acceleration limits that moves use, because motions with moving ends cannot be slowed down.
MOVING_SHARE = 0.999
# Fractions of a motion that are replaced at one of its ends.
FRACTIONS = (0.15, 0.3, 0.5, 0.7, 0.9)
# Share of the bound of a constraint that samples may use, because the constraint holds between samples too.
SHARE = 0.998
# Share of the permitted acceleration to which it is reduced, so that few attempts suffice.
AIM = 0.95
# Seconds between samples: first coarse ones, which reject most moves, then finer ones. The ends of the phases of
# constant jerk follow, between which accelerations are linear.
STEPS = (0.045, 0.015)
# Seconds between samples of a complete motion.
TRAJECTORY_STEP = 0.005
# Number of times that a move is computed with smaller rates.
ATTEMPTS = 6
# Smallest factor of the rates in one attempt, and smallest share of the limits of the rates of a joint.
LARGEST_STEP, SMALLEST = 0.3, 0.03
# Relative difference up to which a constraint is a sum of the parts of single joints, such as torques are.
LINEAR = 1e-6


# -- limits of torques and of the tool ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Excess:
    """The sample of a move at which one row of a constraint is exceeded most; with |beta + gamma| > bound there."""

    constraint: RateConstraint
    row: int
    state: Array
    beta: float
    gamma: float
    bound: float
    limits_speed: bool

    @property
    def factor(self) -> float:
        """The factor of ``beta`` at which the row is satisfied; 0 or less if no such factor exists."""
        return (SHARE * self.bound - math.copysign(1.0, self.beta) * self.gamma) / abs(self.beta)


class GentleMoves:
    """Moves that satisfy rate constraints at samples; ``computed`` counts those that were computed here."""

    def __init__(self, steering: Steering, bounds: Bounds, constraints: Sequence[RateConstraint]) -> None:
        self._steering, self._bounds, self._constraints = steering, bounds, tuple(constraints)
        self.computed = 0

    def connect(self, states: Sequence[State], moves: list[Move], duration: float) -> list[Move] | None:
        """The given fastest moves if they are allowed, or somewhat longer ones of less than ``duration`` (s)."""
        if not self._constraints:
            return moves
        spare = duration - sum(move.duration for move in moves)
        found = []
        for (first, last), move in zip(pairwise(states), moves, strict=True):
            allowed = self._allowed(first, last, move, move.duration + spare)
            if allowed is None:
                return None
            spare -= allowed.duration - move.duration
            found.append(allowed)
        return moves if all(new is old for new, old in zip(found, moves, strict=True)) else found

    def straight(self, first: Sequence[float], last: Sequence[float]) -> Move | None:
        """An allowed move on the straight line between two configurations, from rest to rest."""
        share = 1.0
        for _ in range(ATTEMPTS):
            move = self._steering.straight(first, last, share)
            if move is None or not self._constraints:
                return move
            excesses = self._excesses(move)
            if excesses is None:
                return None
            if not excesses:
                return move
            share *= AIM * max(min(excess.factor for excess in excesses), LARGEST_STEP)
        return None

    def slowdown(self, trajectory: Trajectory) -> float:
        """The factor by which a motion must be slowed down to be allowed at samples; infinite if none suffices."""
        if not self._constraints:
            return 1.0
        times = np.linspace(0.0, trajectory.duration, max(math.ceil(trajectory.duration / TRAJECTORY_STEP), 2))
        rates = trajectory(times), trajectory.velocity(times), trajectory.acceleration(times)
        square = 1.0
        for constraint in self._constraints:
            try:
                _, beta, gamma, bound = constraint.coefficients(*rates)
            except TimingError:  # violated even at rest
                return math.inf
            needed = np.abs(beta) > 0.0
            spare = SHARE * bound - np.where(beta > 0.0, gamma, -gamma)
            if (spare[needed] <= 0.0).any():
                return math.inf
            square = max(square, float((np.abs(beta[needed]) / spare[needed]).max(initial=0.0)))
        return math.sqrt(square)

    def _allowed(self, first: State, last: State, move: Move, duration: float) -> Move | None:
        """The move itself, or one with smaller rates, shorter than ``duration`` (s)."""
        rates = None
        for _ in range(ATTEMPTS):
            excesses = self._excesses(move)
            if excesses is None:
                return None
            if not excesses:
                return move
            if rates is None:
                # Velocities, and accelerations in both directions, with which each joint takes as long as the move. The
                # distance that a joint moves in a time grows at least with its acceleration, so that a joint that alone
                # would take half of the time needs about a quarter of the acceleration.
                alone = np.array(move.source.independent_min_durations)  # type: ignore[attr-defined]
                share = (alone / move.duration).clip(math.sqrt(SMALLEST), 1.0) ** 2
                rates = np.stack([self._bounds.velocity, *[share * self._bounds.acceleration] * 2])
            for excess in excesses:
                self._reduce(rates, excess)
            self.computed += 1
            slower = self._steering.gentler(first, last, *rates)
            if slower is None or slower.duration >= duration:
                return None
            move = slower
        return None

    def _excesses(self, move: Move) -> list[_Excess] | None:
        """The rows of constraints that samples of a move exceed; None if one is exceeded even at rest."""
        for states in (*(move.states(step) for step in STEPS), [move.state(at) for at in move.phase_ends().tolist()]):
            if not states:
                continue
            rates = np.array(states)
            found = []
            for constraint in self._constraints:  # with the time as the path parameter, s' = 1 and s'' = 0
                try:
                    alpha, beta, gamma, bound = constraint.coefficients(rates[:, 0], rates[:, 1], rates[:, 2])
                except TimingError:  # violated even at rest
                    return None
                over = np.abs(beta + gamma) - SHARE * bound
                for row in np.flatnonzero(over.max(axis=0) > 0.0).tolist():
                    i = int(over[:, row].argmax())
                    speed = not (alpha[:, row].any() or gamma[:, row].any())
                    values = float(beta[i, row]), float(gamma[i, row]), float(bound[i, row])
                    found.append(_Excess(constraint, row, rates[i], *values, speed))
            if found:
                return found
        return []

    def _reduce(self, rates: Array, excess: _Excess) -> None:
        """Reduce the rates such that a row is satisfied at its sample."""
        factor = max(AIM * excess.factor, LARGEST_STEP)
        acceleration = excess.state[2]
        if excess.limits_speed:
            rates[0] *= math.sqrt(max(excess.factor, LARGEST_STEP))
        elif (parts := self._parts(excess)) is None:
            rates[0] *= math.sqrt(factor)
            rates[1:] *= factor
        else:
            side = math.copysign(1.0, excess.beta + excess.gamma)
            adding = side * parts > 0.0
            total = float(np.abs(parts[adding]).sum())
            if total > 0.0:
                over = side * (excess.beta + excess.gamma) - SHARE * excess.bound
                factor = max(AIM * (total - over) / total, LARGEST_STEP)
            for joint in np.flatnonzero(adding).tolist():
                direction = 1 if acceleration[joint] > 0.0 else 2
                rates[direction, joint] = min(rates[direction, joint], factor * abs(acceleration[joint]))
        np.maximum(rates, SMALLEST * np.stack([self._bounds.velocity, *[self._bounds.acceleration] * 2]), out=rates)

    def _parts(self, excess: _Excess) -> Array | None:
        """(n,) the parts of the row that the acceleration of each joint causes; None if it is not their sum."""
        q, velocity, acceleration = excess.state
        n = len(q)
        still = np.zeros((n + 1, n))
        alpha, beta, _, _ = excess.constraint.coefficients(
            np.tile(q, (n + 1, 1)), np.vstack([np.eye(n), velocity]), still
        )
        parts = np.asarray(alpha[:n, excess.row] * acceleration)
        total = float(parts.sum() + beta[n, excess.row])
        return parts if abs(total - excess.beta) <= LINEAR * excess.bound else None


# -- free moves --------------------------------------------------------------------------------------------------------


class FreeMoves:
    """Moves between states that are inside all limits, free, and satisfy constraints of the tcp, at samples.

    They use a ``share`` of the acceleration limits. Samples are ``step`` seconds apart, and may use the share
    ``tolerance`` of the tolerance of a constraint. With ``middle_first``, the middle of the longest move is checked
    first: most moves that are not free are not free there. From the state ``moving``, moves begin as for
    :class:`Steering`. ``computed`` is the number of moves that were computed.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        bounds: Bounds,
        ends: Array,
        rate_limits: Sequence[RateConstraint],
        constraints: Sequence[PathConstraint],
        *,
        share: float,
        step: float,
        tolerance: float = 1.0,
        middle_first: bool = False,
        moving: State | None = None,
    ) -> None:
        torques = next((limit for limit in rate_limits if isinstance(limit, TorqueLimits)), None)
        self.edges = Edges(checker, RESOLUTION, ends, torque_limits=torques)
        self.steering = Steering(bounds, share, moving=moving)
        self.gentle = GentleMoves(self.steering, bounds, rate_limits)
        self.manifold = manifold_of(checker.group, constraints) if constraints else None
        self.step, self.computed, self._middle_first = step, 0, middle_first
        self._tolerances = tolerance * np.array([constraint.tolerance for constraint in constraints])

    def connect(self, states: Sequence[State], duration: float) -> list[Move] | None:
        """The fastest allowed moves from state to state, if they are shorter than a duration (s); otherwise None."""
        # States whose fastest moves are too long or not free are given up, which rejects most at little cost.
        connected: list[Move] = []
        left = duration
        for first, last in pairwise(states):
            self.computed += 1
            move = self.steering.move(first, last)
            if move is None or move.duration >= left:
                return None
            connected.append(move)
            left -= move.duration
        if not self._acceptable(states[0], connected):
            return None
        # The same moves with the accelerations that torques and the tool permit.
        computed = self.gentle.computed
        moves = self.gentle.connect(states, connected, duration)
        self.computed += self.gentle.computed - computed
        if moves is None or moves is connected:
            return moves
        return moves if self._acceptable(states[0], moves) else None

    def free(self, points: npt.ArrayLike) -> bool:
        """Whether samples (m, n) are free and satisfy the constraints of the tcp, except near two ends that do not."""
        q = np.array(points)
        if self.manifold is not None:
            errors = np.array([self.manifold.errors(row) for row in q])
            if (errors > np.maximum(self._tolerances, errors[[0, -1]].max(axis=0))).any():
                return False
        return bool(self.edges.core.points_free(q))

    def _acceptable(self, first: State, moves: Sequence[Move]) -> bool:
        """Whether moves are inside the position limits, and their samples are free."""
        if not all(self.steering.inside(move) for move in moves):
            return False
        if self._middle_first:
            longest = max(moves, key=attrgetter("duration"))
            if not self.edges.core.points_free(np.array([longest.state(0.5 * longest.duration)[0]])):
                return False
        return self.free([first[0], *(state[0] for move in moves for state in move.states(self.step))])


class MovingEnds:
    """Computes motions of an arm that pass states with velocities at their ends, without a jerk limit.

    The fastest move between the two states is tried first. Otherwise, parts of a given motion at its ends are replaced
    by the fastest moves from or to these states.

    Parameters
    ----------
    checker
        Defines the bodies and margins.
    bounds
        The limits of the joints.
    ends
        (e, n) free configurations at which motions begin and end.
    rate_limits, constraints
        As for :func:`pinproof.optimise`.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        bounds: Bounds,
        ends: Array,
        rate_limits: Sequence[RateConstraint] = (),
        constraints: Sequence[PathConstraint] = (),
    ) -> None:
        self._bounds, self._names, self._rate_limits = bounds, checker.group.joint_names, tuple(rate_limits)
        self._moves = FreeMoves(checker, bounds, ends, rate_limits, constraints, share=MOVING_SHARE, step=SAMPLE_TIME)

    def direct(self, start: State, end: State, longest: float) -> Trajectory | None:
        """The fastest move between two states; None if it takes longer (s), or is not free at samples."""
        moves = self._moves.connect((start, end), longest)
        return None if moves is None else self._trajectory(MoveSequence(moves), start, end, longest)

    def changed(self, trajectory: Trajectory, start: State, end: State, longest: float) -> Trajectory | None:
        """A motion from rest to rest with other states at its ends; None if none was found that is short enough (s).

        A trajectory of a single point has no part that could be replaced.
        """
        if len(trajectory.q) == 1:
            return None
        # Its parts begin at rounded times, so that it must not use all of a limit.
        slower = trajectory.slowed(MOVING_SHARE**-0.5)
        motion: MoveSequence | None = MoveSequence.of(slower, self._bounds)
        for first, state in ((True, start), (False, end)):
            if motion is not None and any(state[1]):
                motion = self._with_end(motion, state, longest, first=first)
        return None if motion is None else self._trajectory(motion, start, end, longest)

    def _with_end(self, motion: MoveSequence, state: State, longest: float, *, first: bool) -> MoveSequence | None:
        """The shortest motion with another state at its start or at its end."""
        total, best = motion.duration, None
        for fraction in FRACTIONS:
            low, high = (0.0, fraction * total) if first else ((1.0 - fraction) * total, total)
            other = motion.state(high if first else low)
            # The other end may still become shorter or longer, so that this one may use all of the time.
            spare = longest - total if best is None else best.duration - total
            moves = self._moves.connect((state, other) if first else (other, state), high - low + spare)
            if moves is not None:
                best = motion.replaced(low, high, moves)
        return best

    def _trajectory(self, motion: MoveSequence, start: State, end: State, longest: float) -> Trajectory | None:
        """The motion as a trajectory, if it is within all limits and short enough."""
        timed = trajectory_within(motion, self._names, start, end, self._bounds, self._rate_limits, smooth=False)
        return timed if timed is not None and timed.duration < longest else None


def trajectory_within(
    motion: MoveSequence,
    joint_names: tuple[str, ...],
    start: State,
    end: State,
    bounds: Bounds,
    rate_limits: Sequence[RateConstraint],
    *,
    smooth: bool,
) -> Trajectory | None:
    """A motion between two states as a trajectory, see :meth:`MoveSequence.trajectory`; None if it exceeds a limit."""
    timed = motion.trajectory(joint_names, bounds.note, start, end, smooth=smooth)
    # An acceleration changes with the square of the factor, a jerk with the third power.
    allowed = rate_excess(timed, bounds, rate_limits).max() <= 1.0 + RATE_TOLERANCE / (3 if smooth else 2)
    return timed if allowed and inside_position_limits(timed, bounds) else None
