"""The motion of a controller that executes moves, by the rules that its manual documents.

All joints of a joint move begin and end together: the share of its line that is passed has a trapezoidal speed, as fast
as the limits of all joints permit. A linear move has a trapezoidal speed of the tcp, for which the joints stay within
their limits on the complete line. Where a point is blended, the next move begins while the one before decelerates,
when the arm enters the zone of the point, and the displacements of both add up; both accelerate there only as much as
the joints permit for the sum. Therefore the arm is within both zones while two moves are superposed, no joint is faster
than on one of the moves, and the motion of joint moves is piecewise quadratic.

Manuals: Universal Robots, *URScript*, ``movej`` and ``movel``: trapezoidal speed profiles; KUKA, *KSS System Software,
Operating and Programming Instructions for System Integrators*: synchronous PTP, approximate positioning; FANUC,
*HandlingTool Setup and Operations Manual*: a motion with CNT begins while the one before decelerates; ABB, *RAPID
Overview*, interpolation of corner paths.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import TYPE_CHECKING

import numpy as np

from pinproof.common.structs import described, key
from pinproof.model import JointLimits
from pinproof.motion.paths import JointPath
from pinproof.motion.trajectory import Trajectory
from pinproof.spatial import Array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Speeds of a linear move that are compared, as shares of the largest that the velocities of the joints permit.
SPEEDS = np.geomspace(0.02, 1.0, 160)
# Share of the limits that linear moves use, whose rates are compared at samples.
SAMPLED = 0.995
# rad/s and rad/s^2: in place of limits that are not known.
UNLIMITED = 1e6
# Shares of the deceleration before a blend that are compared.
SHARES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2)
# Shares of the speeds of two moves that are compared, between which a zone changes the speed.
CORNER_SPEEDS = np.linspace(1.0, 0.4, 7)
# Samples of the part of a linear move in a zone, whose joint accelerations are compared.
IN_ZONE = 17
# s: a move of a single point.
SHORTEST = 1e-4


@described(eq=False)
class ControllerMove:
    """A move of a controller: its path, and the zone of its end if it is blended."""

    path: JointPath = key(
        "the line in joint space of a joint move, or points (k, n) at equal distances on the line of the tcp"
    )
    duration: float | None = key("as stated, or None for the shortest", "s", default=None)
    zone: tuple[float, float] | None = key(
        "the shares of this move and of the next one that are in the zone of the end; None for a stop", default=None
    )
    speed: float = key("share of the velocities of the joints that the move uses", default=1.0)
    top: float | None = key("largest share of the move that is passed in a second, as stated", default=None)
    gain: float | None = key("largest acceleration in shares of the move per second^2, as stated", default=None)


@dataclass(frozen=True)
class Profile:
    """A trapezoidal speed: shares per second at its top, and per second^2 at its beginning and its end."""

    top: float
    gain: float
    loss: float

    @property
    def peak(self) -> float:
        """The largest speed that is reached."""
        return min(self.top, float(np.sqrt(2.0 / (1.0 / self.gain + 1.0 / self.loss))))

    @property
    def ramps(self) -> tuple[float, float]:
        """Seconds of acceleration and of deceleration."""
        return self.peak / self.gain, self.peak / self.loss

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""
        return 1.0 / self.peak + sum(self.ramps) / 2.0

    def lasting(self, duration: float) -> Profile:
        """The profile of the same form with another duration."""
        slower = self.duration / duration
        return Profile(self.top * slower, self.gain * slower**2, self.loss * slower**2)

    def seconds_from_start(self, share: float) -> float:
        """Seconds in which the first ``share``, at most that of the acceleration, is passed."""
        return min(float(np.sqrt(2.0 * share / self.gain)), self.ramps[0])

    def seconds_to_end(self, share: float) -> float:
        """Seconds in which the last ``share``, at most that of the deceleration, is passed."""
        return min(float(np.sqrt(2.0 * share / self.loss)), self.ramps[1])

    def at(self, times: Array) -> tuple[Array, Array]:
        """The shares passed, and their rates, at times from the start; constant before and after the move."""
        first, last = self.ramps
        t = np.clip(times, 0.0, self.duration)
        left = self.duration - t
        middle = self.peak * (t - first / 2.0)
        shares = np.where(
            t < first, self.gain * t**2 / 2.0, np.where(left < last, 1.0 - self.loss * left**2 / 2.0, middle)
        )
        rates = np.where(t < first, self.gain * t, np.where(left < last, self.loss * left, self.peak))
        return shares, np.where((times < 0.0) | (times > self.duration), 0.0, rates)


def fastest(path: JointPath, limits: JointLimits, speed: float = 1.0) -> Profile:
    """The fastest trapezoidal profile at which every joint is within its limits on a move."""
    velocity = speed * np.where(np.isnan(limits.velocity), UNLIMITED, limits.velocity)
    acceleration = np.where(np.isnan(limits.acceleration), UNLIMITED, limits.acceleration)
    if not np.ptp(path.q, axis=0).any():
        return Profile(2.0 / SHORTEST, 4.0 / SHORTEST**2, 4.0 / SHORTEST**2)
    if len(path.q) == 2:
        travel = np.maximum(np.abs(path.q[1] - path.q[0]), 1e-12)
        gain = float((acceleration / travel).min())
        return Profile(float((velocity / travel).min()), gain, gain)
    # While it accelerates from rest at the rate g, the squared rate of the share s is 2 g s, so that a joint needs
    # g |q' + 2 s q''|; on the part up to s, g is at most the least of what the joints permit. The same holds from the
    # end backwards, where the slope has the other sign.
    shares = np.linspace(0.0, 1.0, 2 * len(path.q) - 1)
    slope, bend = (spline_of(path)(shares, order) for order in (1, 2))
    permitted = SAMPLED * acceleration
    reached = []
    for along, turned in ((slope, bend), (-slope[::-1], bend[::-1])):
        rates = (permitted / np.maximum(np.abs(along + 2.0 * shares[:, None] * turned), 1e-12)).min(axis=1)
        reached.append(2.0 * np.minimum.accumulate(rates) * shares)
    best: Profile | None = None
    cruise = np.sqrt((permitted / np.maximum(np.abs(bend), 1e-12)).min(axis=1))
    for top in SPEEDS * SAMPLED * float((velocity / np.maximum(np.abs(slope), 1e-12)).min()):
        if not all((squares >= top**2).any() for squares in reached):
            break
        first, last = (int(np.argmax(squares >= top**2)) for squares in reached)
        last = len(shares) - 1 - last
        if first <= last and (cruise[first : last + 1] >= top).all():
            made = Profile(
                float(top), float(top**2 / (2.0 * shares[first])), float(top**2 / (2.0 * (1.0 - shares[last])))
            )
            best = made if best is None or made.duration < best.duration else best
    return best or Profile(float(SPEEDS[0]) * 1e-2, UNLIMITED, UNLIMITED)


def _largest_passing(curve: CubicSpline, acceleration: Array) -> float:
    """Shares per second at which a linear move may be passed completely, without an acceleration along it."""
    bend = np.abs(curve(np.linspace(0.0, 1.0, 2 * len(curve.x)), 2))
    return float(np.sqrt(SAMPLED * (acceleration / np.maximum(bend, 1e-12)).min()))


def together(one: Profile, other: Profile, zone: tuple[float, float]) -> float:
    """Seconds for which two moves with a zone between them are superposed."""
    return min(one.seconds_to_end(zone[0]), other.seconds_from_start(zone[1]))


def spline_of(path: JointPath) -> CubicSpline:
    """The curve through the points of a move, by the share of it that is passed."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(np.linspace(0.0, 1.0, len(path.q)), path.q)


@dataclass(frozen=True, eq=False)
class ControllerMotion:
    """The motion between two stops: ``moves`` from ``starts`` (s) with their ``profiles``, and the ``trajectory``."""

    moves: tuple[ControllerMove, ...]
    profiles: tuple[Profile, ...]
    starts: tuple[float, ...]
    trajectory: Trajectory

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""
        return self.starts[-1] + self.profiles[-1].duration


def controller_motion(
    moves: Sequence[ControllerMove], limits: JointLimits, *, optional: bool = False
) -> ControllerMotion:
    """The motion of moves; with ``optional`` a zone that saves no time becomes a stop, as where both moves reverse."""
    moves = list(moves)
    planned = list(moves)
    profiles = [fastest(move.path, limits, move.speed) for move in moves]
    for k, (move, profile) in enumerate(zip(moves, profiles, strict=True)):
        top, gain = (UNLIMITED if stated is None else stated for stated in (move.top, move.gain))
        profiles[k] = Profile(min(profile.top, top), min(profile.gain, gain), min(profile.loss, gain))
    curves = [None if len(move.path.q) == 2 else spline_of(move.path) for move in moves]
    acceleration = np.where(np.isnan(limits.acceleration), UNLIMITED, limits.acceleration)

    def ramp(number: int, zone: float, *, ending: bool) -> tuple[Array, Array]:
        """The least and the largest of what each joint needs at a rate of 1, on the part of a ramp in a zone."""
        curve, q = curves[number], moves[number].path.q
        if curve is None:
            return q[1] - q[0], q[1] - q[0]
        passed = np.linspace(0.0, zone, IN_ZONE)[:, None]
        at = 1.0 - passed[:, 0] if ending else passed[:, 0]
        needed = curve(at, 1) + (-2.0 if ending else 2.0) * passed * curve(at, 2)
        return needed.min(axis=0), needed.max(axis=0)

    # Where the sum of the accelerations of a joint exceeds its limit, one or both of the moves accelerate less. Where
    # the moves have similar directions, both keep their speeds until the zone, and change it there in the same time.
    passing = [np.inf if curve is None else _largest_passing(curve, acceleration) for curve in curves]
    kept = [False] * len(moves)
    for k, move in enumerate(moves[:-1]):
        if move.zone is None:
            continue
        one, other = profiles[k], profiles[k + 1]
        slowing = [one.loss * needed for needed in ramp(k, move.zone[0], ending=True)]
        rising = [other.gain * needed for needed in ramp(k + 1, move.zone[1], ending=False)]
        best = one.duration + other.duration if optional else np.inf
        planned[k] = replace(move, zone=None) if optional else move
        for share in SHARES:
            # |rising m - slowing share| <= acceleration for the largest m in [0, 1]
            above = (acceleration + share * slowing[0]) / np.maximum(rising[1], 1e-12)
            below = (acceleration - share * slowing[1]) / np.maximum(-rising[0], 1e-12)
            most = min(1.0, float(above.min()), float(below.min()))
            if most < SHARES[-1]:
                continue
            pair = replace(one, loss=share * one.loss), replace(other, gain=most * other.gain)
            seconds = pair[0].duration + pair[1].duration - together(*pair, move.zone)
            if seconds < best and not (kept[k] and pair[0].peak < one.peak):
                best, (profiles[k], profiles[k + 1]), planned[k] = seconds, pair, move
        # Speeds before and after the zone; the first one is known if the zone at its beginning depends on it
        first, last = (min(p.top, float(np.sqrt(2.0 * rate))) for p, rate in ((one, one.gain), (other, other.loss)))
        first, last = (
            min(peak, p.peak, most) if np.isfinite(most) else peak
            for peak, p, most in ((first, one, passing[k]), (last, other, passing[k + 1]))
        )
        for before, after in product([one.peak] if kept[k] else first * CORNER_SPEEDS, last * CORNER_SPEEDS):
            falling = [before * needed / max(one.loss, 1e-12) for needed in slowing]
            growing = [after * needed / max(other.gain, 1e-12) for needed in rising]
            needed = np.maximum(growing[1] - falling[0], falling[1] - growing[0]) / acceleration
            both = max(float(needed.max()), SHORTEST)
            before, after = float(before), float(after)
            pair = Profile(before, one.gain, before / both), Profile(after, after / both, other.loss)
            inside = before * both / 2.0 <= move.zone[0] and after * both / 2.0 <= move.zone[1]
            seconds = pair[0].duration + pair[1].duration - both
            if inside and seconds < best and pair[0].peak == before and pair[1].peak == after:
                best, (profiles[k], profiles[k + 1]), planned[k], kept[k + 1] = seconds, pair, move, True
    profiles = [p if m.duration is None else p.lasting(m.duration) for m, p in zip(moves, profiles, strict=True)]
    # Each move begins when the one before enters the zone, so that both are in it until that one ends
    starts = [0.0]
    for k, move in enumerate(planned[:-1]):
        both = 0.0 if move.zone is None else together(profiles[k], profiles[k + 1], move.zone)
        starts.append(starts[-1] + profiles[k].duration - both)
    return ControllerMotion(
        tuple(planned), tuple(profiles), tuple(starts), _trajectory(moves, profiles, starts, curves)
    )


def _trajectory(
    moves: Sequence[ControllerMove],
    profiles: Sequence[Profile],
    starts: Sequence[float],
    curves: Sequence[CubicSpline | None],
) -> Trajectory:
    """The sum of the displacements of all moves."""
    # Between these times the speed of every move is linear in time
    knots = [0.0]
    for move, profile, start in zip(moves, profiles, starts, strict=True):
        end = start + profile.duration
        knots += [start, start + profile.ramps[0], end - profile.ramps[1], end]
        if len(move.path.q) > 2:
            knots += np.linspace(start, end, 2 * len(move.path.q)).tolist()
    times = np.unique(np.round(knots, 9))
    q = np.tile(moves[0].path.q[0], (len(times), 1))
    rates = np.zeros_like(q)
    for move, profile, start, curve in zip(moves, profiles, starts, curves, strict=True):
        shares, speeds = profile.at(times - start)
        if curve is None:
            travel = move.path.q[1] - move.path.q[0]
            q += shares[:, None] * travel
            rates += speeds[:, None] * travel
        else:
            q += curve(shares) - move.path.q[0]
            rates += speeds[:, None] * curve(shares, 1)
    rates[[0, -1]] = 0.0
    return Trajectory(times, q, rates, moves[0].path.joint_names)


# -- few moves ---------------------------------------------------------------------------------------------------------

# Numbers of points before and after a point at which the tangents meet in a corner beside it.
TANGENTS = (1, 2, 3, 5)


def with_corners(points: Array, limits: JointLimits) -> Array:
    """Points (k, n) of a motion with more points beside them: the corners in which tangents of the motion meet.

    A move that leaves the motion on a tangent and one that returns on another one meet there, so that a zone of their
    corner is beside the motion.
    """
    tangents, rows = np.gradient(points, axis=0), list[Array]()
    for k, point in enumerate(points):
        rows.append(point)
        for number in TANGENTS:
            if k - number < 0 or k + number >= len(points):
                continue
            ends, slopes = points[[k - number, k + number]], tangents[[k - number, k + number]]
            steps = np.linalg.lstsq(slopes.T, ends[1] - ends[0], rcond=None)[0]
            if (steps > 0.0).all() and (steps < 4.0 * number).all():
                corner = (ends[0] + steps[0] * slopes[0] + ends[1] - steps[1] * slopes[1]) / 2.0
                rows.append(np.clip(corner, limits.lower, limits.upper))
    return np.array(rows)


def stop_times(one: Array, other: Array, limits: JointLimits) -> tuple[Array, Array]:
    """Seconds of joint moves from rest to rest, and of the acceleration in them."""
    travel = np.maximum(np.abs(other - one), 1e-12)
    gain = (np.where(np.isnan(limits.acceleration), UNLIMITED, limits.acceleration) / travel).min(axis=-1)
    top = (np.where(np.isnan(limits.velocity), UNLIMITED, limits.velocity) / travel).min(axis=-1)
    peak = np.minimum(top, np.sqrt(gain))
    return np.asarray(1.0 / peak + peak / gain), np.asarray(peak / gain)


def fewest_moves(points: Array, limits: JointLimits, proven: Callable[[Array, Array], bool]) -> list[int] | None:
    """The fastest path of joint moves with stops through some of points (k, n), from the first to the last of them.

    Returns the numbers of its points. Every line is ``proven``; None if no path is. Only lines of the fastest path that
    remains are proven, so that few proofs are needed.
    """
    last, known = len(points) - 1, set[tuple[int, int]]()
    edges = stop_times(points[:, None], points[None], limits)[0]
    while True:
        # The fastest path to each point
        cost, via = np.zeros(len(points)), np.zeros(len(points), dtype=int)
        for k in range(1, len(points)):
            costs = cost[:k] + edges[:k, k]
            via[k] = costs.argmin()
            cost[k] = costs[via[k]]
        if not np.isfinite(cost[last]):
            return None
        order = [last]
        while order[-1]:
            order.append(int(via[order[-1]]))
        steps = sorted(set(pairwise(order[::-1])) - known, key=lambda step: step[0] - step[1])
        failed = next((step for step in steps if not proven(points[step[0]], points[step[1]])), None)
        if failed is None:
            return order[::-1]
        known.update(step for step in steps[: steps.index(failed)])
        edges[failed] = np.inf
