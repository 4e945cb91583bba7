"""The timing of curves along a tool path, and proven bounds of the speed of the tool."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.common.steps import step
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
    slow: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class ToolSpeed:
    """Bounds (m/s) of the speed of the tool between its ramps.

    ``ramps`` are their lengths (m) at both ends, and ``times`` (s) the end of the first one and the begin of the last.
    """

    low: float
    high: float
    ramps: tuple[float, float]
    times: tuple[float, float]


@step("timing")
def timed_along(arm: Arm, curves: list[tuple[CubicPath, Array, npt.NDArray[np.bool_]]], tolerance: float) -> TimedPath:
    """The motion along curves at whose ends the tool stops, each with the largest speed (m/s) of its pieces.

    It is infinite where none is stated, and the speed that is wanted where the third value is True. A share of it that
    ``tolerance`` does not permit ends a ramp.

    Raises
    ------
    TimingError, InputError
        If no timing within the limits was found.
    """
    parts: list[Trajectory] = []
    bounds: list[ToolSpeed] = []
    ratios: list[float] = []
    for path, speed, kept in curves:
        # The parts between changes of the speed, which the tool passes with less than the lower one
        changes = (speed[1:] != speed[:-1]) | (kept[1:] != kept[:-1])
        ends = [0, *(1 + np.flatnonzero(changes)).tolist(), len(speed)]
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
        for motion, limit, wanted_there in zip(timed, wanted, kept[ends[:-1]].tolist(), strict=True):
            bounds.append(tool_speed(arm, motion, limit if wanted_there else np.inf, tolerance))
            if np.isfinite(limit) and wanted_there:
                ratios.append(bounds[-1].low / limit)
    # The ramps between the parts, as intervals of the whole motion
    begins = np.concatenate([[0.0], np.cumsum([part.duration for part in parts])]).tolist()
    between = (
        (begin + before.times[1], end + after.times[0])
        for (begin, end), (before, after) in zip(pairwise(begins[:-1]), pairwise(bounds), strict=True)
    )
    return TimedPath(
        Trajectory.join(*parts), (min(each.low for each in bounds), max(each.high for each in bounds)),
        min(ratios, default=1.0), (bounds[0].ramps[0], bounds[-1].ramps[1]),
        tuple((begin, end) for begin, end in between if end > begin),
    )  # fmt: skip


def tool_speed(arm: Arm, motion: Trajectory, wanted: float, tolerance: float) -> ToolSpeed:
    """Bounds of the speed of the tool between its ramps.

    A ramp ends at the first instant, and begins at the last, at which the speed is above ``1 - tolerance`` of the
    wanted one. If that is never reached, the two ramps meet where the tool is the fastest. Without a wanted speed,
    there is no ramp. Between samples, the speed is lower by at most the largest acceleration times half of their
    distance in time.
    """
    if motion.duration == 0.0:
        return ToolSpeed(wanted if np.isfinite(wanted) else 0.0, 0.0, (0.0, 0.0), (0.0, 0.0))
    peaks = ToolLimits(arm, linear_speed=1.0).peaks(motion)
    top, acceleration = peaks["linear_speed"], peaks["linear_acceleration"]
    finest = 0.01 * (wanted if np.isfinite(wanted) else max(top, 1e-9))
    count = int(np.clip(np.ceil(motion.duration * acceleration / finest), FEWEST_SAMPLES, MOST_SAMPLES))
    times = np.linspace(0.0, motion.duration, count + 1)
    jacobians = arm.jacobian_batch(motion(times))[:, :3]
    speed = np.linalg.norm((jacobians @ motion.velocity(times)[:, :, None])[:, :, 0], axis=1)
    lower = np.maximum(speed - 0.5 * acceleration * motion.duration / count, 0.0)
    if not np.isfinite(wanted):
        return ToolSpeed(float(lower.min()), top, (0.0, 0.0), (0.0, motion.duration))
    reached = np.flatnonzero(lower >= (1.0 - tolerance) * wanted)
    first, last = (int(reached[0]), int(reached[-1])) if len(reached) else (int(lower.argmax()),) * 2
    width = motion.duration / count
    ramps = float(speed[:first].sum() * width), float(speed[last + 1 :].sum() * width)
    return ToolSpeed(float(lower[first : last + 1].min()), top, ramps, (float(times[first]), float(times[last])))
