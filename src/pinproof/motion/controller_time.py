"""The motion of a controller that executes moves, by the rules that its manual documents.

All joints of a joint move begin and end together: the share of its line that is passed has a trapezoidal speed, as fast
as the limits of all joints permit. A linear move has a trapezoidal speed of the tcp, for which the joints stay within
their limits on the complete line. Where a point is blended, the moves pass its zone at speeds to which they accelerate
or decelerate before and behind it: while the speed of one move decreases to 0 there, that of the next one increases
from 0, both linearly and in the same time, and the displacements of both add up. The time is as short as the
accelerations of the joints permit. Therefore the arm is within both zones while two moves are superposed, no joint is
faster than on one of the moves, and the motion of joint moves is piecewise quadratic. The speeds at the zones are those
with which the motion is the shortest among those compared.

Manuals: Universal Robots, *URScript*, ``movej`` and ``movel``: trapezoidal speed profiles; KUKA, *KSS System Software,
Operating and Programming Instructions for System Integrators*: synchronous PTP, approximate positioning; FANUC,
*HandlingTool Setup and Operations Manual*: a motion with CNT begins while the one before decelerates; ABB, *RAPID
Overview*, interpolation of corner paths.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import pairwise
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
# Ratios of the speeds behind and before a zone that are compared, as factors of the usual one, and shares of the
# largest speeds with each of them; first widely, then near the best ones.
RATIOS = np.geomspace(0.2, 5.0, 9), np.geomspace(0.75, 1.33, 7)
SPEED_SHARES = np.array([1.0, 0.8, 0.6, 0.4, 0.2]), np.geomspace(0.85, 1.18, 5)
# Speeds at which a linear move is passed between zones, as shares of the largest that its bend permits there; the rest
# of the accelerations is for changes of the speed.
PASSING = (0.5, 0.7, 0.85, 0.97)
# Equal parts of a linear move between which limits of its places are compared, and the samples in each.
PLACES, IN_PLACE = 8, 16
# Samples of the part of a linear move in a zone, whose joint accelerations are compared.
IN_ZONE = 17
# s: a move of a single point, and a piece of a motion.
SHORTEST, SHORTEST_PIECE = 1e-4, 1e-6


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
    alike: bool = key("whether it is also slowed down with this acceleration, or with the shortest one", default=False)


@dataclass(frozen=True)
class Profile:
    """A speed that is linear between ``times`` (s): ``speeds`` in shares of the move per second, and 0 at both ends.

    For the seconds ``entry`` it increases in the zone at the start of the move, for ``exit`` it decreases in that at
    the end.
    """

    times: tuple[float, ...]
    speeds: tuple[float, ...]
    entry: float = 0.0
    exit: float = 0.0

    @property
    def peak(self) -> float:
        """The largest speed that is reached."""
        return max(self.speeds)

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""
        return self.times[-1]

    @property
    def gains(self) -> Array:
        """The accelerations and decelerations between zones, in shares of the move per second^2."""
        times, speeds = np.array(self.times), np.array(self.speeds)
        inner = (times[1:] > self.entry + 1e-9) & (times[:-1] < self.duration - self.exit - 1e-9)
        changes = np.abs(np.diff(speeds)[inner] / np.diff(times)[inner])
        return np.asarray(changes[changes > 1e-9])

    def lasting(self, duration: float) -> Profile:
        """The profile of the same form with another duration."""
        longer = duration / self.duration
        times, speeds = np.array(self.times) * longer, np.array(self.speeds) / longer
        return Profile(tuple(times.tolist()), tuple(speeds.tolist()), self.entry * longer, self.exit * longer)

    def at(self, times: Array) -> tuple[Array, Array]:
        """The shares passed, and their rates, at times from the start; constant before and after the move."""
        knots, speeds = np.array(self.times), np.array(self.speeds)
        passed = np.concatenate([[0.0], np.cumsum(np.diff(knots) * (speeds[1:] + speeds[:-1]) / 2.0)])
        t = np.clip(times, 0.0, self.duration)
        before = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        rates = np.interp(t, knots, speeds)
        shares = passed[before] + (t - knots[before]) * (speeds[before] + rates) / 2.0
        return shares, np.where((times < 0.0) | (times > self.duration), 0.0, rates)


@dataclass(frozen=True, eq=False)
class _Rates:
    """What the limits permit on a move, in shares of it per second (^2).

    ``gain`` and ``loss`` are the accelerations from rest and to rest up to the speed ``top``. If an end of the move is
    in a zone, one of several speeds is used (first axis): ``tops`` with the accelerations ``gains`` and ``losses`` have
    one for each number of ``PLACES`` at the start and at the end of the move that are in zones. ``rests`` has, for each
    speed, the acceleration from rest, that to rest, and the numbers of places in which it is reached from rest and
    left to rest. With ``alike`` a move has one acceleration, with which its speed both increases and decreases.
    """

    top: float
    gain: float
    loss: float
    tops: Array
    gains: Array
    losses: Array
    rests: Array
    alike: bool = False

    @classmethod
    def even(cls, top: float, gain: float) -> _Rates:
        """The rates of a move whose joints keep the limits alike at all of its places."""
        alike = np.full((1, 1, 1), gain)
        return cls(top, gain, gain, np.full((1, 1, 1), top), alike, alike, np.array([[gain], [gain], [0.0], [0.0]]))

    def at_most(self, top: float, gain: float) -> _Rates:
        """The rates with a stated speed and acceleration."""
        gains, losses = np.minimum(self.gains, gain), np.minimum(self.losses, gain)
        # With a lower acceleration a speed is reached later, at places where a limit may be lower
        tops, rests = np.minimum(self.tops, top), self.rests.copy()
        rests[:2] = np.minimum(rests[:2], gain)
        if tops.shape[1] > 1 and gain < self.rests[:2].max():
            rests[2:] = 0.0
        top, rising, falling = (min(own, most) for own, most in ((self.top, top), (self.gain, gain), (self.loss, gain)))
        return _Rates(top, rising, falling, tops, gains, losses, rests, self.alike)

    def _best(self, first: Array, last: Array) -> tuple[Array, Array, Array, Array]:
        """The speeds between zones, the accelerations to and from them, and the durations, as for ``durations``."""
        (enter, entry), (leave, leaving) = first.T[:, :, None], last.T[:, None, :]
        cells, level = self.tops.shape[1] - 1, np.arange(len(self.tops))[:, None, None]
        rising, falling, reached, left_at = self.rests[:, :, None, None]
        places = [
            np.where(speed > 0.0, np.minimum(speed * time / 2.0, 1.0) * cells, rest).astype(int)
            for speed, time, rest in ((enter, entry, reached), (leave, leaving, left_at))
        ]
        begin, end = np.broadcast_arrays(*places)
        stops = (enter == 0.0) & (leave == 0.0)
        top = np.where(stops, self.top, self.tops[level, begin, end])
        gain = np.where(stops, self.gain, np.where(enter > 0.0, self.gains[level, begin, end], rising))
        loss = np.where(stops, self.loss, np.where(leave > 0.0, self.losses[level, begin, end], falling))
        if self.alike:  # or the speed only decreases from that at a zone, or only increases to it
            rows = np.broadcast_arrays(np.minimum(gain, loss), loss, gain, begin, end, top)
            gain = loss = np.concatenate(rows[:3])
            begin, end = (np.concatenate([each] * 3) for each in rows[3:5])
            top = np.concatenate([rows[5], np.minimum(rows[5], enter), np.minimum(rows[5], leave)])
        left = 1.0 - (enter * entry + leave * leaving) / 2.0
        most = (2.0 * left + enter**2 / gain + leave**2 / loss) / (1.0 / gain + 1.0 / loss)
        peak = np.minimum(top, np.sqrt(np.maximum(most, 0.0)))
        ramps = (peak**2 - enter**2) / (2.0 * gain) + (peak**2 - leave**2) / (2.0 * loss)
        with np.errstate(divide="ignore", invalid="ignore"):
            cruise = np.maximum(left - ramps, 0.0) / peak
        seconds = entry + leaving + (peak - enter) / gain + (peak - leave) / loss + cruise
        possible = (left >= 0.0) & (peak > 0.0) & (peak >= np.maximum(enter, leave) - 1e-12)
        # From or to rest, the other change of the speed is in the places that its acceleration is for
        braking = 1.0 - leave * leaving / 2.0 - (peak**2 - leave**2) / (2.0 * loss)
        reaching = enter * entry / 2.0 + (peak**2 - enter**2) / (2.0 * gain)
        possible &= stops | (enter > 0.0) | (braking >= begin / max(cells, 1) - 1e-12)
        possible &= stops | (leave > 0.0) | (reaching <= 1.0 - end / max(cells, 1) + 1e-12)
        seconds = np.where(possible, seconds, np.inf)
        best = seconds.argmin(axis=0)[None]
        peak, gain, loss, seconds = (np.take_along_axis(each, best, axis=0)[0] for each in (peak, gain, loss, seconds))
        return peak, gain, loss, seconds

    def durations(self, first: Array, last: Array) -> Array:
        """Seconds of the move; ``first`` and ``last`` are rows of (speed, time) in zones.

        The result has a row for each row of ``first`` and a column for each of ``last``; impossible durations are
        infinite.
        """
        return self._best(first, last)[3]

    def profile(self, first: Array, last: Array) -> Profile:
        """The profile between a row of (speed, time) in the zone at the start, and one at the end."""
        ((peak,),), ((gain,),), ((loss,),), ((duration,),) = self._best(first[None], last[None])
        (enter, entry), (leave, leaving) = first, last
        rising, falling = (peak - enter) / gain, (peak - leave) / loss
        times = np.array([0.0, entry, entry + rising, duration - leaving - falling, duration - leaving, duration])
        speeds, kept = np.array([0.0, enter, peak, peak, leave, 0.0]), np.append(np.diff(times) > 1e-12, True)
        kept[0] = True
        return Profile(tuple(times[kept].tolist()), tuple(speeds[kept].tolist()), float(entry), float(leaving))


REST = np.zeros(2)
"""The speed and the time in a zone where a move begins or ends at rest."""


def fastest(path: JointPath, limits: JointLimits, *, alike: bool = False) -> Profile:
    """The fastest trapezoidal profile from rest to rest at which every joint is within its limits on a move."""
    return _rates(path, limits, 1.0, alike).profile(REST, REST)


@lru_cache(maxsize=256)
def _rates(path: JointPath, limits: JointLimits, speed: float, alike: bool) -> _Rates:
    velocity = speed * np.where(np.isnan(limits.velocity), UNLIMITED, limits.velocity)
    acceleration = np.where(np.isnan(limits.acceleration), UNLIMITED, limits.acceleration)
    if not np.ptp(path.q, axis=0).any():
        return _Rates.even(2.0 / SHORTEST, 4.0 / SHORTEST**2)
    if len(path.q) == 2:
        travel = np.maximum(np.abs(path.q[1] - path.q[0]), 1e-12)
        return _Rates.even(float((velocity / travel).min()), float((acceleration / travel).min()))
    # While it accelerates from rest at the rate g, the squared rate of the share s is 2 g s, so that a joint needs
    # g |q' + 2 s q''|; on the part up to s, g is at most the least of what the joints permit. The same holds from the
    # end backwards, where the slope has the other sign.
    shares = np.linspace(0.0, 1.0, PLACES * IN_PLACE + 1)
    slope, bend = (spline_of(path)(shares, order) for order in (1, 2))
    permitted = SAMPLED * acceleration
    # The squared speed that a place permits
    cruise = (permitted / np.maximum(np.abs(bend), 1e-12)).min(axis=1)
    cruise = np.minimum(cruise, (SAMPLED * velocity / np.maximum(np.abs(slope), 1e-12)).min(axis=1) ** 2)
    reached, rising = list[Array](), list[Array]()
    for along, turned, most in ((slope, bend, cruise), (-slope[::-1], bend[::-1], cruise[::-1])):
        rates = (permitted / np.maximum(np.abs(along + 2.0 * shares[:, None] * turned), 1e-12)).min(axis=1)
        rates[1:] = np.minimum(rates[1:], most[1:] / (2.0 * shares[1:]))
        rising.append(np.minimum.accumulate(rates))
        reached.append(2.0 * rising[-1] * shares)
    # Between zones: the largest speed on each part of the line, shares of it, and what they leave for changes of it
    size, count = PLACES + 1, len(PASSING)
    tops, gains, losses = (np.empty((count, size, size)) for _ in range(3))
    for begin in range(size):
        for end in range(size):
            left, right = begin, PLACES - end
            if right <= left:  # the zones meet
                left, right = max(right - 1, 0), min(left + 1, PLACES)
            part = slice(left * IN_PLACE, right * IN_PLACE + 1)
            largest = float(np.sqrt(cruise[part].min()))
            steep, needed = np.maximum(np.abs(slope[part]), 1e-12), np.sign(slope[part]) * bend[part]
            for k, share in enumerate(PASSING):
                tops[k, begin, end] = share * largest
                used = tops[k, begin, end] ** 2 * needed
                gains[k, begin, end] = ((permitted - np.maximum(used, 0.0)) / steep).min()
                losses[k, begin, end] = ((permitted + np.minimum(used, 0.0)) / steep).min()
    rests = np.empty((4, count))
    for k, share in enumerate(PASSING):
        for side, (squares, rates) in enumerate(zip(reached, rising, strict=True)):
            at = np.searchsorted(np.maximum.accumulate(squares), share**2 * cruise.max())
            rests[side, k] = rates[min(int(at), len(shares) - 1)]
            rests[side + 2, k] = min(int(at) // IN_PLACE, PLACES)
    # Short moves also brake in the first places, and accelerate in the last ones
    tops, gains, losses = (np.concatenate([each, each]) for each in (tops, gains, losses))
    rests = np.hstack([rests, rests])
    rests[2:, count:] = 0.0
    own = partial(_Rates, tops=tops, gains=gains, losses=losses, rests=rests, alike=alike)
    speeds = SPEEDS * SAMPLED * float((velocity / np.maximum(np.abs(slope), 1e-12)).min())
    first, last = (np.searchsorted(np.maximum.accumulate(squares), speeds**2) for squares in reached)
    speeds = speeds[(first < len(shares)) & (last < len(shares))]
    best, shortest = own(float(SPEEDS[0]) * 1e-2, UNLIMITED, UNLIMITED), np.inf
    for top, begin, left in zip(speeds.tolist(), first.tolist(), last.tolist(), strict=False):
        end = len(shares) - 1 - left
        if begin <= end and cruise[begin : end + 1].min() >= top**2:
            gain, loss = top**2 / (2.0 * float(shares[begin])), top**2 / (2.0 * (1.0 - float(shares[end])))
            if alike:
                gain = loss = min(gain, loss)
            peak = min(top, math.sqrt(2.0 / (1.0 / gain + 1.0 / loss)))
            seconds = 1.0 / peak + peak * (1.0 / gain + 1.0 / loss) / 2.0
            if seconds < shortest:
                best, shortest = own(top, gain, loss), seconds
    return best


@lru_cache(maxsize=256)
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

    @cached_property
    def trajectory(self) -> Trajectory:
        """The sum of the displacements of all moves."""
        return _trajectory(self.moves, self.profiles, self.starts)

    @property
    def duration(self) -> float:
        """Seconds from rest to rest."""
        return self.starts[-1] + self.profiles[-1].duration


def controller_motion(
    moves: Sequence[ControllerMove], limits: JointLimits, *, optional: bool = False, roughly: bool = False
) -> ControllerMotion:
    """The motion of moves; with ``optional`` a zone that saves no time becomes a stop, as where both moves reverse.

    ``roughly`` compares fewer speeds at the zones, for a duration that is compared with others.
    """
    moves = list(moves)
    rates = [_rates(move.path, limits, move.speed, move.alike) for move in moves]
    for k, (move, own) in enumerate(zip(moves, rates, strict=True)):
        if (move.top, move.gain) != (None, None):
            rates[k] = own.at_most(*(UNLIMITED if stated is None else stated for stated in (move.top, move.gain)))
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

    # What each joint needs in a zone, and the ratio of the speeds for which the change of the velocities is small
    zones = dict[int, tuple[tuple[float, float], tuple[Array, Array], tuple[Array, Array]]]()
    usual = dict[int, tuple[Array, Array]]()
    for k, move in enumerate(moves[:-1]):
        if move.zone is not None:
            falling, rising = ramp(k, move.zone[0], ending=True), ramp(k + 1, move.zone[1], ending=False)
            zones[k] = (move.zone, falling, rising)
            one, other = (sum(both) / (2.0 * acceleration) for both in (falling, rising))
            across = float(other @ other)
            along = max(float(one @ other), 0.5 * float(np.sqrt((one @ one) * across)))
            usual[k] = np.atleast_1d(along / max(across, 1e-24)), np.ones(1)
    # The best speeds at all zones, first of many, then of those near them
    chosen = list[Array]()
    for ratios, shares in zip(RATIOS[: 2 - roughly], SPEED_SHARES[: 2 - roughly], strict=True):
        options = list[Array]()
        for k in range(len(moves) - 1):
            rows = np.zeros((1, 5))  # the speed before the zone, that behind it, the time in it, ratio, and share
            if k in zones:
                ratio = np.repeat(usual[k][0] * ratios, len(shares))
                share = np.minimum(np.tile(usual[k][1] * shares, len(ratios)), 1.0)
                made = _zone_speeds(zones[k], (rates[k], rates[k + 1]), acceleration, ratio, share)
                rows = np.vstack([rows, made]) if optional else made
            options.append(rows)
        chosen = _shortest(rates, options)
        usual = {k: (chosen[k][3:4], chosen[k][4:5]) if chosen[k][3] else usual[k] for k in usual}
    ends = [(REST, REST)] + [(row[[0, 2]], row[[1, 2]]) for row in chosen] + [(REST, REST)]
    profiles = [own.profile(ends[k][1], ends[k + 1][0]) for k, own in enumerate(rates)]
    profiles = [p if m.duration is None else p.lasting(m.duration) for m, p in zip(moves, profiles, strict=True)]
    # Each move begins when the one before enters the zone, so that both are in it until that one ends
    starts = [0.0]
    for before, after in pairwise(profiles):
        starts.append(starts[-1] + before.duration - min(before.exit, after.entry))
    planned = tuple(
        replace(move, zone=None) if optional and k in zones and not chosen[k][2] else move
        for k, move in enumerate(moves)
    )
    return ControllerMotion(planned, tuple(profiles), tuple(starts))


def _zone_speeds(
    zone: tuple[tuple[float, float], tuple[Array, Array], tuple[Array, Array]],
    rates: tuple[_Rates, _Rates],
    acceleration: Array,
    ratio: Array,
    share: Array,
) -> Array:
    """Rows of the speeds before and behind a zone, the time in it, and the ratio and the share that they are for."""
    (before, behind), falling, rising = zone
    # |ratio rising - falling| / time, with a speed of 1 before the zone, is within the accelerations
    above = (ratio[:, None] * rising[1] - falling[0]) / acceleration
    below = (falling[1] - ratio[:, None] * rising[0]) / acceleration
    change = np.maximum(np.maximum(above, below).max(axis=1), 1e-12)
    # While the speed changes linearly from or to 0, half of speed * time is passed
    tops = [float(own.tops.max()) for own in rates]
    ratio = np.maximum(ratio, 1e-9)
    most = np.minimum(tops[0], tops[1] / ratio)
    most = np.minimum(most, np.minimum(np.sqrt(2.0 * before / change), np.sqrt(2.0 * behind / (ratio * change))))
    speed = share * most
    return np.stack([speed, ratio * speed, np.maximum(speed * change, SHORTEST), ratio, share], axis=1)


def _shortest(rates: Sequence[_Rates], options: Sequence[Array]) -> list[Array]:
    """The row of ``options`` at the end of each move but the last, with which the motion is the shortest."""
    rest = np.zeros((1, 5))
    before, cost, via = rest, np.zeros(1), list[Array]()
    for own, rows in zip(rates, [*options, rest], strict=True):
        costs = cost[:, None] + own.durations(before[:, [1, 2]], rows[:, [0, 2]]) - rows[:, 2]
        via.append(costs.argmin(axis=0))
        before, cost = rows, costs.min(axis=0)
    number, chosen = 0, list[Array]()
    for rows, best in zip(options[::-1], via[:0:-1], strict=True):
        number = int(best[number])
        chosen.append(rows[number])
    return chosen[::-1]


def _trajectory(moves: Sequence[ControllerMove], profiles: Sequence[Profile], starts: Sequence[float]) -> Trajectory:
    # Between these times the speed of every move is linear in time
    knots = [0.0]
    for move, profile, start in zip(moves, profiles, starts, strict=True):
        end = start + profile.duration
        knots += [start + at for at in profile.times]
        if len(move.path.q) > 2:
            knots += np.linspace(start, end, 2 * len(move.path.q)).tolist()
    times = np.unique(np.round(knots, 9))
    # In a shorter piece, rounding errors of the joint values are large accelerations
    times = times[np.append(True, np.append(np.diff(times)[1:] > SHORTEST_PIECE, True))]
    q = np.tile(moves[0].path.q[0], (len(times), 1))
    rates = np.zeros_like(q)
    for move, profile, start in zip(moves, profiles, starts, strict=True):
        shares, speeds = profile.at(times - start)
        if len(move.path.q) == 2:
            travel = move.path.q[1] - move.path.q[0]
            q += shares[:, None] * travel
            rates += speeds[:, None] * travel
        else:
            curve = spline_of(move.path)
            q += curve(shares) - move.path.q[0]
            rates += speeds[:, None] * curve(shares, 1)
    rates[[0, -1]] = 0.0
    return Trajectory(times, q, rates, moves[0].path.joint_names)


# -- few moves ---------------------------------------------------------------------------------------------------------

# Numbers of points before and after a point at which the tangents meet in a corner beside it.
TANGENTS = (1, 2, 3, 5)


def meeting(ends: Array, slopes: Array, number: int) -> Array | None:
    """The corner (n,) in which the tangents of a motion at two points meet, ``number`` samples apart; or None."""
    steps = np.linalg.lstsq(slopes.T, ends[1] - ends[0], rcond=None)[0]
    if not ((steps > 0.0).all() and (steps < 2.0 * number).all()):
        return None
    return np.asarray((ends[0] + steps[0] * slopes[0] + ends[1] - steps[1] * slopes[1]) / 2.0)


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
            both = [k - number, k + number]
            corner = meeting(points[both], tangents[both], 2 * number)
            if corner is not None:
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
