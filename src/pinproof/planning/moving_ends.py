"""Motions that pass the states at their ends instead of resting there.

The fastest move between the two states is tried first. Otherwise, parts of a given motion at its ends are replaced by
the fastest moves from or to these states. Moves are checked at samples; the caller certifies the result.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
from pinproof.planning.constrained import manifold_of
from pinproof.planning.edges import Edges
from pinproof.planning.gentle_moves import GentleMoves
from pinproof.spatial import Array

RESOLUTION = 0.06
"""Metres that bodies move between two samples of an edge; samples of motions are taken in time."""

SAMPLE_TIME = 0.04
"""Seconds between two samples of a motion, in which acceleration bends it by few millimetres."""

SHARE = 0.999
"""Share of the acceleration limits that moves use, because motions with moving ends cannot be slowed down."""

FRACTIONS = (0.15, 0.3, 0.5, 0.7, 0.9)
"""Fractions of a motion that are replaced at one of its ends."""


class MovingEnds:
    """Computes motions of an arm between states with velocities, without a jerk limit.

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
        torques = next((each for each in rate_limits if isinstance(each, TorqueLimits)), None)
        self._edges = Edges(checker, RESOLUTION, ends, torque_limits=torques)
        self._steering = Steering(bounds, SHARE)
        self._gentle = GentleMoves(self._steering, bounds, rate_limits)
        self._manifold = manifold_of(checker.arm, constraints) if constraints else None
        self._tolerances = np.array([each.tolerance for each in constraints])

    def direct(self, start: State, end: State, longest: float) -> Trajectory | None:
        """The fastest move between two states; None if it takes longer (s), or is not free at samples."""
        moves = self._connect(start, end, longest)
        return None if moves is None else self._trajectory(MoveSequence(moves), start, end, longest)

    def changed(self, trajectory: Trajectory, start: State, end: State, longest: float) -> Trajectory | None:
        """A motion from rest to rest with other states at its ends; None if none was found that is short enough (s).

        A trajectory of a single point has no part that could be replaced.
        """
        if len(trajectory.q) == 1:
            return None
        slower = trajectory.slowed(SHARE**-0.5)  # as its parts begin at rounded times, it must not use all of a limit
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
            moves = self._connect(*((state, other) if first else (other, state)), high - low + spare)
            if moves is not None:
                best = motion.replaced(low, high, moves)
        return best

    def _connect(self, first: State, last: State, longest: float) -> list[Move] | None:
        """The fastest allowed move between two states, if it is shorter (s) and free at samples."""
        move = self._steering.move(first, last)
        if move is None or move.duration >= longest or not self._acceptable(first, [move]):
            return None
        moves = self._gentle.connect([first, last], [move], longest)
        return moves if moves is None or moves[0] is move or self._acceptable(first, moves) else None

    def _acceptable(self, first: State, moves: Sequence[Move]) -> bool:
        """Whether moves are inside the position limits, and samples are free and satisfy the constraints of the tcp."""
        if not all(self._steering.inside(move) for move in moves):
            return False
        points = np.array([first[0], *(state[0] for move in moves for state in move.states(SAMPLE_TIME))])
        if self._manifold is not None:
            errors = np.array([self._manifold.errors(q) for q in points])
            if (errors > np.maximum(self._tolerances, errors[[0, -1]].max(axis=0))).any():
                return False
        return bool(self._edges.core.points_free(points))

    def _trajectory(self, motion: MoveSequence, start: State, end: State, longest: float) -> Trajectory | None:
        """The motion as a trajectory, if it is within all limits."""
        timed = motion.trajectory(self._names, self._bounds.note, start, end, smooth=False)
        try:
            excess = np.max(
                [*rate_excess(timed, self._bounds), *(e for r in self._rate_limits for e in r.excess(timed))]
            )
        except TimingError:  # a constraint is violated even at rest
            return None
        # An acceleration changes with the square of the factor.
        allowed = timed.duration < longest and excess <= 1.0 + RATE_TOLERANCE / 2
        return timed if allowed and inside_position_limits(timed, self._bounds) else None
