"""From a path to a trajectory, with the limits verified on the result."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError, TimingError
from pinproof.motion.curve import Array, Curve
from pinproof.motion.curve_timing import time_track
from pinproof.motion.limits import POSITION_TOLERANCE, RATE_TOLERANCE, Bounds, MotionLimits
from pinproof.motion.track import Track
from pinproof.motion.trajectory import Trajectory
from pinproof.spatial import finite

__all__ = ["MotionLimits", "time_parametrise"]

TANGENT_TOLERANCE = 1e-9
"""Relative to its size: how far a velocity may lie off the path's tangent, for rounding."""


def time_parametrise(
    curve: Curve,
    limits: MotionLimits,
    *,
    jerk: npt.ArrayLike | Literal["limits"] | None = None,
    start_velocity: npt.ArrayLike | None = None,
    end_velocity: npt.ArrayLike | None = None,
) -> Trajectory:
    """Time a path as fast as the limits allow, without changing its image.

    The motion stops at the corners of a :class:`~pinproof.JointPath` (each straight stretch gets the time-optimal
    profile in closed form) and runs through all else: a :class:`~pinproof.CubicPath`, and a
    :class:`~pinproof.BlendedPath` but for the corners that are left. Straight lines are kept to rounding, bends to
    :data:`~pinproof.motion.curve_timing.IMAGE_TOLERANCE`. All limits hold for the exact extremes of the result (to a
    relative :data:`~pinproof.motion.limits.RATE_TOLERANCE`), not for samples of it; what exceeds them is slowed down
    until it does not.

    Parameters
    ----------
    curve
        What to time. Start = goal gives a single point of duration 0.
    limits
        ``velocity`` (n,) in rad/s or m/s and ``acceleration`` (n,) in rad/s^2 or m/s^2, such as ``arm.limits``. Where
        there are ``lower`` and ``upper`` (n,), the result is checked against them; ``acceleration_source``, a text, is
        handed on in the result's ``limits_note``.
    jerk
        Limits of jerk, (n,) in rad/s^3 or m/s^3 or one for all joints; ``"limits"`` takes ``limits.jerk``. The result
        is then a quintic, whose accelerations do not jump, from no acceleration at rest. By default jerk does not
        count, and the result is a cubic.
    start_velocity, end_velocity
        (n,) in rad/s or m/s, along the path's tangent and forward; by default rest. Note that ros2_control's
        joint_trajectory_controller refuses motions that do not end at rest, unless told otherwise.

    Raises
    ------
    InputError
        For limits of a wrong shape, or that are not known (NaN) or not positive and finite, names the joint; for a
        velocity that does not lie along the path.
    TimingError
        If the path leaves the joint limits, or no timing within the limits was found.

    Notes
    -----
    With a jerk limit straight stretches between two stops are time-optimal. What runs through bends is the fastest
    motion with softer accelerations, averaged over a window of time: it has no proof of being the fastest.
    """
    if not callable(getattr(curve, "bezier", None)) or isinstance(curve, Trajectory):
        raise InputError(f"only a path can be timed, such as a JointPath, not a {type(curve).__name__}")
    bounds = Bounds.of(limits, curve.joint_names, jerk)
    ends = [
        np.zeros(len(curve.joint_names)) if velocity is None else finite(name, velocity, (len(curve.joint_names),))
        for name, velocity in (("start_velocity", start_velocity), ("end_velocity", end_velocity))
    ]
    if not np.ptp(curve.bezier()[1], axis=(0, 1)).any():
        if ends[0].any() or ends[1].any():
            raise InputError("the path stands still; a velocity at its ends leads away from it")
        still = np.zeros((1, len(curve.start)))
        point = Trajectory(
            [0.0], [curve.start], still, curve.joint_names, bounds.note, accelerations=None if jerk is None else still
        )
        return _verified(point, bounds)
    track = Track(curve, bounds)
    for end, place, velocity in ((0, "start", ends[0]), (-1, "end", ends[1])):
        _check_velocity(place, velocity, track.control[1][end, end], bounds, curve.joint_names)
    return _verified(time_track(track, bounds, (ends[0], ends[1])), bounds)


def _check_velocity(place: str, velocity: Array, tangent: Array, bounds: Bounds, names: tuple[str, ...]) -> None:
    if not velocity.any():
        return
    along = float(velocity @ tangent) * tangent / max(float(tangent @ tangent), np.finfo(float).tiny)
    # A velocity below the smallest normal number has lost its direction.
    if np.abs(velocity - along).max() > TANGENT_TOLERANCE * np.abs(velocity).max() + np.finfo(float).tiny:
        raise InputError(
            f"{place}_velocity {velocity} does not lie along the path, whose tangent there is {tangent}: the arm would "
            "leave it"
        )
    if velocity @ tangent < 0.0:
        raise InputError(f"{place}_velocity {velocity} leads backward; the path's tangent there is {tangent}")
    over = np.abs(velocity) / bounds.velocity
    if over.max() > 1.0 + RATE_TOLERANCE:
        name, limit = names[int(over.argmax())], bounds.velocity[int(over.argmax())]
        raise InputError(f"{place}_velocity is above the velocity limit {limit:g} of joint {name!r}")


def _verified(trajectory: Trajectory, bounds: Bounds) -> Trajectory:
    """The trajectory itself, if every limit holds on it."""
    control = trajectory.bezier()[1]
    outside = (control.min(axis=(0, 1)) < bounds.lower) | (control.max(axis=(0, 1)) > bounds.upper)
    low, high = trajectory.range() if outside.any() else (bounds.lower, bounds.upper)  # within, if its hull is
    for name, a, b, lower, upper in zip(trajectory.joint_names, low, high, bounds.lower, bounds.upper, strict=True):
        if a < lower - POSITION_TOLERANCE or b > upper + POSITION_TOLERANCE:
            raise TimingError(
                f"the path leaves the limits of joint {name!r}: it spans [{a:.9g}, {b:.9g}], allowed is "
                f"[{lower:.9g}, {upper:.9g}]; plan it inside the limits"
            )
    excess = bounds.excess(trajectory)
    if bounds.too_fast(excess).any():
        raise TimingError(
            f"no timing within the limits was found: still {excess.max() - 1.0:.3g} above them after slowing down; are "
            "two waypoints closer than rounding, or are velocities at the ends too high?"
        )
    return trajectory
