"""The timing of curves along a tool path, and proven bounds of the speed of the tool."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pinproof.errors import InputError, TimingError
from pinproof.model import Arm
from pinproof.motion import CubicPath, ToolLimits, Trajectory, time_parametrise
from pinproof.spatial import Array

# Shares of the speed with which the tool passes from one speed to another, tried in turn.
PASSING = (0.95, 0.7, 0.4, 0.2, 0.0)
# Numbers of samples of the speed of the tool.
FEWEST_SAMPLES, MOST_SAMPLES = 200, 40_000


@dataclass(frozen=True, eq=False)
class TimedPath:
    """A motion along the path, with bounds of the speed of the tool; see :class:`PathPiece`."""

    trajectory: Trajectory
    speed: tuple[float, float]
    speed_share: float
    ramps: tuple[float, float]


def timed_along(arm: Arm, curves: list[tuple[CubicPath, Array]], tolerance: float) -> TimedPath:
    """The motion along curves at whose ends the tool stops, each with the speed (m/s) of its pieces.

    The speed is infinite where none is stated. A share of it that ``tolerance`` does not permit ends a ramp.

    Raises
    ------
    TimingError, InputError
        If no timing within the limits was found.
    """
    parts: list[Trajectory] = []
    bounds: list[tuple[float, float, float, float]] = []
    shares: list[float] = []
    for path, speed in curves:
        # The parts between changes of the speed, which the tool passes with less than the lower one
        ends = [0, *(1 + np.flatnonzero(speed[1:] != speed[:-1])).tolist(), len(speed)]
        wanted = speed[ends[:-1]].tolist()
        subs = [
            CubicPath(path.q[a : b + 1], path.tangents[a : b + 1], path.knots[a : b + 1], path.joint_names)
            for a, b in pairwise(ends)
        ]
        rates = []
        for k, slower in zip(ends[1:-1], map(min, pairwise(wanted)), strict=True):
            tangent = path.tangents[k]
            per_rate = max(float(np.linalg.norm((arm.jacobian(path.q[k]) @ tangent)[:3])), 1e-12)
            rates.append(min(slower / per_rate, 1.0 / max(float((np.abs(tangent) / arm.limits.velocity).max()), 1e-12)))
        still = np.zeros(arm.dof)
        for share in PASSING if rates else PASSING[-1:]:
            through = [share * rate * path.tangents[k] for k, rate in zip(ends[1:-1], rates, strict=True)]
            try:
                timed = [
                    time_parametrise(
                        sub, arm.limits, start_velocity=first, end_velocity=last,
                        rate_limits=[ToolLimits(arm, linear_speed=limit)] if np.isfinite(limit) else [],
                    )
                    for sub, limit, (first, last) in zip(subs, wanted, pairwise([still, *through, still]), strict=True)
                ]  # fmt: skip
                break
            except (TimingError, InputError):
                if share == PASSING[-1]:
                    raise
        parts += timed
        bounds += [tool_speed(arm, motion, limit, tolerance) for motion, limit in zip(timed, wanted, strict=True)]
        shares += wanted
    ratios = [low / limit for (low, *_), limit in zip(bounds, shares, strict=True) if np.isfinite(limit)]
    low, high = min(each[0] for each in bounds), max(each[1] for each in bounds)
    ramps = bounds[0][2], bounds[-1][3]
    return TimedPath(Trajectory.join(*parts), (low, high), min(ratios, default=1.0), ramps)


def tool_speed(arm: Arm, motion: Trajectory, wanted: float, tolerance: float) -> tuple[float, float, float, float]:
    """Bounds (m/s) of the speed of the tool between its ramps, and the length (m) of the ramps at both ends.

    A ramp ends at the first instant, and begins at the last, at which the speed is above ``1 - tolerance`` of the
    wanted one. If that is never reached, the lower bound is the highest speed that was seen. Without a wanted speed,
    there is no ramp. Between samples, the speed is lower by at most the largest acceleration times half of their
    distance in time.
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
