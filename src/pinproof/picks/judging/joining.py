"""Motions of a pick that pass the ends of its straight lines without a stop.

With stops, the transit ends at rest where the approach begins, and the approach starts from rest. Here the transit ends
on the line instead, with the velocity of the line there, and only the part of the line next to the part is followed.
The same holds for the end of the retreat, and for the start of the approach to a place. The result is never slower than
the motion with stops, and is certified; if that fails, the arm stops.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pinproof.collision import Certificate
from pinproof.errors import InputError, TimingError
from pinproof.model import Arm
from pinproof.motion import Bounds, CubicPath, RateConstraint, State, Trajectory, least_times, rest, time_parametrise
from pinproof.planning import MovingEnds
from pinproof.spatial import Array

SPEEDS = (1.2, 0.95, 0.7)
"""Speeds at the outer end of a line that are tried, as shares of its largest speed between two stops. The largest
possible share is 1.41, for a line on which the acceleration is constant."""

MOST_SHORTENED = 0.75
"""Largest straight share for which the rest of a line is left out. With a larger one, the motion between two stops has
little speed there, and the complete line with a moving end is faster."""

SAMPLES = 64
"""Number of points of a line among which the end of its straight part is chosen."""

GAIN = 1e-3
"""Seconds that a motion without a stop must save."""


@dataclass(eq=False)
class LineEnd:
    """A straight line between a grasp or a release and its outer end, at which the arm need not stop.

    ``path`` is the line in the direction of motion, which ``arrives`` at the grasp or the release or leaves it, and
    ``stopping`` its motion from rest to rest. The share ``straight``, next to the grasp or the release, must be
    followed. ``rates`` are further limits on the line.
    """

    arm: Arm
    path: CubicPath
    stopping: Trajectory
    arrives: bool
    straight: float
    rates: Sequence[RateConstraint]
    _known: dict[int, Trajectory | None] = field(default_factory=dict)

    def option(self, number: int) -> Trajectory | None:
        """A motion on the line with a moving outer end: 0 leaves out a part of it, the others have decreasing speeds.

        None if it does not exist.
        """
        if number not in self._known:
            self._known[number] = self._shortened() if number == 0 else self._complete(SPEEDS[number - 1])
        return self._known[number]

    def _shortened(self) -> Trajectory | None:
        """The motion from rest to rest without its part beyond the straight share; None if that is most of the line."""
        into = self.stopping if self.arrives else backwards(self.stopping)
        if self.straight > MOST_SHORTENED or len(into.q) == 1:
            return None
        times = np.linspace(0.0, into.duration, SAMPLES)
        positions = self.arm.forward_kinematics_batch(into(times))[:, :3, 3]
        left = np.linalg.norm(positions - positions[-1], axis=1)
        kept = into.after(float(times[np.flatnonzero(left >= self.straight * left[0])[-1]]))
        return kept if self.arrives else backwards(kept)

    def _complete(self, share: float) -> Trajectory | None:
        """The complete line with a share of its largest speed at the outer end; None if that is too fast."""
        points = self.path.bezier()[1]
        tangent = points[0, 1] - points[0, 0] if self.arrives else points[-1, -1] - points[-1, -2]
        if not tangent.any():
            return None
        peak = np.linalg.norm(self.stopping.velocities, axis=1).max() / np.linalg.norm(tangent)
        moving = {"start_velocity" if self.arrives else "end_velocity": share * peak * tangent}
        try:
            return time_parametrise(self.path, self.arm.limits, rate_limits=self.rates, **moving)
        except (InputError, TimingError):  # too fast for the line or for a limit
            return None


Chosen = tuple[Trajectory | None, Trajectory | None]
"""The line before a motion and the line after it, with a moving end; None for a stop, or if there is no line."""


@dataclass(frozen=True, eq=False)
class JoinedMotion:
    """A transit or a transfer between two lines, which it joins without stops if possible.

    A line ``before`` or ``after`` is None where the arm rests. ``stops`` (2, n) are the configurations at which it
    rests otherwise, ``stopping`` computes the motion between them, and ``prove`` gives the certificate of a motion
    between two chosen lines.
    """

    ends: MovingEnds
    bounds: Bounds
    before: LineEnd | None
    after: LineEnd | None
    stops: Array
    stopping: Callable[[], Trajectory]
    prove: Callable[[Trajectory, Chosen], Certificate]

    def find(self) -> tuple[Trajectory, Chosen, Certificate] | None:
        """The motion, the lines that it joins, and the certificate; None if the arm has to stop at both ends."""
        stopping: Trajectory | None = None
        # The options of both lines, of which not all exist; -1 is a stop.
        for numbers in [each for n in range(len(SPEEDS) + 1) for each in ((n, n), (-1, n), (n, -1))]:
            chosen = self._lines(numbers)
            if chosen is None:
                continue
            states = self._states(chosen)
            saved = sum(
                line.stopping.duration - moving.duration
                for line, moving in zip((self.before, self.after), chosen, strict=True)
                if line is not None and moving is not None
            )
            if stopping is None:  # the fastest move is certainly an improvement if it is faster than any with stops
                least = float(least_times(self.stops[1] - self.stops[0], self.bounds))
                found = self._proven(partial(self.ends.direct, *states), least + saved, chosen)
                if found is not None:
                    return found
                stopping = self.stopping()
            found = self._proven(partial(self.ends.changed, stopping, *states), stopping.duration + saved, chosen)
            if found is not None:
                return found
        return None

    def _proven(
        self, make: Callable[[float], Trajectory | None], longest: float, chosen: Chosen
    ) -> tuple[Trajectory, Chosen, Certificate] | None:
        motion = make(longest - GAIN)
        if motion is None:
            return None
        certificate = self.prove(motion, chosen)
        return (motion, chosen, certificate) if certificate.free else None

    def _lines(self, numbers: tuple[int, int]) -> Chosen | None:
        """The chosen options; None if one of them does not exist."""
        found = [
            None if line is None or number < 0 else line.option(number)
            for line, number in zip((self.before, self.after), numbers, strict=True)
        ]
        wanted = [number >= 0 for number in numbers]
        return (found[0], found[1]) if [each is not None for each in found] == wanted else None

    def _states(self, chosen: Chosen) -> tuple[State, State]:
        """The states between which the motion has to move."""
        before, after = chosen
        return (
            rest(self.stops[0]) if before is None else _state(before, -1),
            rest(self.stops[1]) if after is None else _state(after, 0),
        )


def _state(trajectory: Trajectory, index: int) -> State:
    q, velocity = trajectory.q[index].tolist(), trajectory.velocities[index].tolist()
    return q, velocity, [0.0] * len(q)


def backwards(trajectory: Trajectory) -> Trajectory:
    """The reversed trajectory."""
    times = trajectory.times[-1] - trajectory.times[::-1]
    curvature = None if trajectory.accelerations is None else trajectory.accelerations[::-1]
    return Trajectory(
        times - times[0],
        trajectory.q[::-1],
        -np.asarray(trajectory.velocities[::-1]),
        trajectory.joint_names,
        trajectory.limits_note,
        accelerations=curvature,
    )
