"""From a path to a trajectory, with the limits verified on the result."""

from __future__ import annotations

import numpy as np

from pinproof.errors import InputError, TimingError
from pinproof.motion.cubic_path import CubicPath
from pinproof.motion.joint_path import JointPath
from pinproof.motion.limits import POSITION_TOLERANCE, Bounds, MotionLimits
from pinproof.motion.smooth_timing import time_smooth
from pinproof.motion.straight_timing import time_straight
from pinproof.motion.trajectory import Trajectory

__all__ = ["MotionLimits", "time_parametrise"]


def time_parametrise(curve: JointPath | CubicPath, limits: MotionLimits, *, grid: int = 2) -> Trajectory:
    """Time a path as fast as the limits allow, from rest to rest, without changing its image.

    A :class:`JointPath` stops at its corners and keeps its image to rounding: each straight stretch gets the
    time-optimal profile in closed form. A :class:`CubicPath` runs through, timed by toppra, and keeps its image to
    :data:`~pinproof.motion.smooth_timing.IMAGE_TOLERANCE`. Velocity and acceleration limits hold for the exact
    extremes of the result (to a relative :data:`~pinproof.motion.limits.RATE_TOLERANCE`), not for samples of it; what
    exceeds them is slowed down until it does not.

    Parameters
    ----------
    curve
        What to time. Start = goal gives a single point of duration 0.
    limits
        ``velocity`` (n,) in rad/s or m/s and ``acceleration`` (n,) in rad/s^2 or m/s^2, such as ``arm.limits``. Where
        there are ``lower`` and ``upper`` (n,), the result is checked against them; ``acceleration_source``, a text, is
        handed on in the result's ``limits_note``.
    grid
        toppra's steps a piece of a CubicPath at first; steps whose curve misses the path are refined until none does.

    Raises
    ------
    InputError
        For limits of a wrong shape, or that are not known (NaN) or not positive and finite; names the joint.
    TimingError
        If the path leaves the joint limits, or no timing within the limits was found.
    """
    if not isinstance(curve, (JointPath, CubicPath)):
        raise InputError(f"only a JointPath or a CubicPath can be timed, not a {type(curve).__name__}")
    if grid < 1 or grid != int(grid):
        raise InputError(f"grid must be a whole number of at least 1, not {grid!r}")
    bounds = Bounds.of(limits, curve.joint_names)
    if not np.ptp(curve.bezier()[1], axis=(0, 1)).any():
        return _verified(
            Trajectory([0.0], [curve.start], np.zeros((1, len(curve.start))), curve.joint_names, bounds.note), bounds
        )
    timed = time_straight(curve, bounds) if isinstance(curve, JointPath) else time_smooth(curve, bounds, grid)
    return _verified(timed, bounds)


def _verified(trajectory: Trajectory, bounds: Bounds) -> Trajectory:
    """The trajectory itself, if every limit holds on it."""
    low, high = trajectory.range()
    for name, a, b, lower, upper in zip(trajectory.joint_names, low, high, bounds.lower, bounds.upper, strict=True):
        if a < lower - POSITION_TOLERANCE or b > upper + POSITION_TOLERANCE:
            raise TimingError(
                f"the path leaves the limits of joint {name!r}: it spans [{a:.9g}, {b:.9g}], allowed is "
                f"[{lower:.9g}, {upper:.9g}]; plan it inside the limits"
            )
    excess = bounds.excess(trajectory)
    if bounds.too_fast(excess).any():
        raise TimingError(
            f"no timing within the velocity and acceleration limits was found: still {excess.max() - 1.0:.3g} above "
            "them after slowing down; are two waypoints closer than rounding?"
        )
    return trajectory
