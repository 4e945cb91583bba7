"""Time parametrisation: convert a path to a trajectory, with the limits verified on the result.

The core (``src/core/timing``) computes the motion and verifies it between its points: by the exact extremes of its
derivatives, and by a bound of its deviation from the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof._core import RateLimits, corners, time_path
from pinproof.errors import InputError, TimingError
from pinproof.motion.curve import Curve
from pinproof.motion.limits import POSITION_TOLERANCE, RATE_TOLERANCE, Bounds, MotionLimits, inside_position_limits
from pinproof.motion.paths import JointPath
from pinproof.motion.rate_limits import RateConstraint, checked_constraints, constraint_rows
from pinproof.motion.trajectory import Trajectory
from pinproof.motion.trajectory_files import LONGEST
from pinproof.spatial import Array, finite

# Maximum deviation (rad or m, in any joint) of the timed curve from the path: 0.01 mm at a reach of 1 m, which is less
# than the repeatability of arms and 1 % of usual clearances. The certificate is for the timed curve.
IMAGE_TOLERANCE = 1e-5
# Maximum deviation of an end velocity from the tangent of the path, relative to its size: rounding errors.
TANGENT_TOLERANCE = 1e-9


def time_parametrise(
    curve: Curve,
    limits: MotionLimits,
    *,
    jerk: npt.ArrayLike | Literal["limits"] | None = None,
    start_velocity: npt.ArrayLike | None = None,
    end_velocity: npt.ArrayLike | None = None,
    rate_limits: Sequence[RateConstraint] = (),
) -> Trajectory:
    """Time a path as fast as the limits permit, without changing its geometry.

    The motion stops at the corners of a :class:`~pinproof.JointPath`; each straight segment gets the time-optimal
    profile in closed form. It passes a :class:`~pinproof.motion.CubicPath` without stopping, and a
    :class:`~pinproof.motion.BlendedPath` except for its remaining corners. Straight lines are followed to rounding,
    bends to :data:`~pinproof.motion.timing.IMAGE_TOLERANCE`. All limits are verified on the exact extremes of the
    result (to a relative :data:`~pinproof.motion.limits.RATE_TOLERANCE`), not on samples.

    Parameters
    ----------
    curve
        The path. If its start equals its end, the result is a single point of duration 0.
    limits
        ``velocity`` (n,) in rad/s or m/s and ``acceleration`` (n,) in rad/s^2 or m/s^2, such as ``arm.limits``. If
        there are ``lower`` and ``upper`` (n,), the result is checked against them. The text ``acceleration_source`` is
        included in the ``limits_note`` of the result.
    jerk
        Jerk limits, (n,) in rad/s^3 or m/s^3 or one number for all joints; ``"limits"`` uses ``limits.jerk``. The
        result is then a quintic with continuous acceleration, which is zero at rest. By default, there is no jerk limit
        and the result is a cubic.
    start_velocity, end_velocity
        (n,) in rad/s or m/s, along the tangent of the path and forward; zero by default. By default, the
        joint_trajectory_controller of ros2_control refuses motions that do not end at rest.
    rate_limits
        Further limits, such as torques or tool speeds, see :class:`~pinproof.motion.RateConstraint`.

    Raises
    ------
    InputError
        If the limits have a wrong shape, are unknown (NaN) or are not positive and finite (the message names the
        joint), or if a velocity is not along the path.
    TimingError
        If the path leaves the joint limits, a constraint is violated at standstill (the message names it and the
        configuration), or no timing within the limits was found.

    Notes
    -----
    The motion is time-optimal on a grid: by reachability analysis without a jerk limit, and by an interior-point method
    with one. The page "Timing and trajectory files" describes both and compares them with other solvers.
    """
    if not callable(getattr(curve, "bezier", None)) or isinstance(curve, Trajectory):
        raise InputError(f"time_parametrise requires a path, such as a JointPath, not a {type(curve).__name__}")
    names = curve.joint_names
    bounds, further = Bounds.of(limits, names, jerk), checked_constraints(rate_limits)
    still = np.zeros(len(names))
    start, end = (
        still if velocity is None else finite(name, velocity, still.shape)
        for name, velocity in (("start_velocity", start_velocity), ("end_velocity", end_velocity))
    )
    # The pieces, and where the motion stops: None if where the tangent jumps.
    stops: Array | None = None
    if isinstance(curve, JointPath) and len(q := corners(curve.q)) > 1:
        knots, control, stops = np.arange(len(q), dtype=float), np.stack([q[:-1], q[1:]], axis=1), np.ones(len(q))
    else:
        knots, control = (np.ascontiguousarray(values, dtype=float) for values in curve.bezier())
        if hasattr(curve, "corners"):
            stops = np.isin(knots, np.asarray(curve.corners, dtype=float)).astype(float)
    if np.ptp(control, axis=(0, 1)).any():
        tangents = control[0, 1] - control[0, 0], control[-1, -1] - control[-1, -2]
        for place, velocity, tangent in zip(("start", "end"), (start, end), tangents, strict=True):
            _check_velocity(place, velocity, tangent, bounds, names)
        trajectory = _timed(names, (knots, control, stops), bounds, (start, end), further)
    else:
        if start.any() or end.any():
            raise InputError("the path has length 0; start_velocity and end_velocity must be zero")
        constraint_rows(further, control[0, :1], still[None], still[None])  # raises if it is violated at standstill
        rest = None if jerk is None else still[None]
        trajectory = Trajectory([0.0], control[0, :1], still[None], names, bounds.note, accelerations=rest)
    if not inside_position_limits(trajectory, bounds):
        low, high = trajectory.range()
        j = int(((low < bounds.lower - POSITION_TOLERANCE) | (high > bounds.upper + POSITION_TOLERANCE)).argmax())
        raise TimingError(
            f"the path exceeds the limits of joint {names[j]!r}: its range is [{low[j]:.9g}, {high[j]:.9g}], the "
            f"limits are [{bounds.lower[j]:.9g}, {bounds.upper[j]:.9g}]; plan it inside the limits"
        )
    return trajectory


def _timed(
    names: Sequence[str],
    pieces: tuple[Array, Array, Array | None],
    bounds: Bounds,
    ends: tuple[Array, Array],
    further: Sequence[RateConstraint],
) -> Trajectory:
    """Time the pieces of a path, whose motion has the velocities ``ends`` at its start and end."""

    def trajectory_of(times: Array, q: Array, velocities: Array, accelerations: Array | None) -> Trajectory:
        return Trajectory(times, q, velocities, names, bounds.note, accelerations=accelerations)

    def rows(q: Array, slope: Array, curvature: Array) -> tuple[Array, ...]:
        return tuple(np.ascontiguousarray(row) for row in constraint_rows(further, q, slope, curvature))

    def excess(*points: Array) -> Array:
        trajectory = trajectory_of(*points)
        return np.max([np.asarray(limit.excess(trajectory), dtype=float) for limit in further], axis=0)

    knots, control, stops = pieces
    limits = RateLimits(bounds.velocity, bounds.acceleration, np.empty(0) if bounds.jerk is None else bounds.jerk)
    task = knots, control, stops, limits, *ends, IMAGE_TOLERANCE, RATE_TOLERANCE, LONGEST
    status, *points, deviation, over = time_path(*task, None, None)
    # Without the constraints, straight segments have a closed form; often its motion satisfies the constraints too.
    if further and (status != "timed" or float(excess(*points).max()) > 1.0 + RATE_TOLERANCE):
        status, *points, deviation, over = time_path(*task, rows, excess)
    if status != "timed":
        raise TimingError(
            _FAILURES[status].format(longest=LONGEST, deviation=deviation, points=len(points[0]), over=over)
        )
    return trajectory_of(*points)


# The messages for the results of the core that are not a motion.
_FAILURES = {
    "end too fast": "end_velocity exceeds the limits at the end of the path; reduce it",
    "ends unreachable": (
        "start_velocity or end_velocity is not possible within the limits on this path; reduce it or use a longer path"
    ),
    "not smooth": "no timing within the limits was found: the path is not smooth enough; resample it more evenly",
    "too long": (
        "the path takes longer than {longest:.0f} s, which is the maximum; check that its units are radians and metres"
    ),
    "deviates": (
        "the timed curve deviates from the path by {deviation:.3g} (rad or m) with {points} points: the path bends "
        "too sharply, or its curvature jumps, which a jerk limit does not permit. Use a larger rounding or resample it"
    ),
    "exceeds": (
        "no timing within the limits was found: after slowing down, they are exceeded by a factor of {over:.6g}. Check "
        "whether waypoints are almost equal or velocities at the ends are too high"
    ),
}


def _check_velocity(place: str, velocity: Array, tangent: Array, bounds: Bounds, names: tuple[str, ...]) -> None:
    if not velocity.any():
        return
    along = float(velocity @ tangent) * tangent / max(float(tangent @ tangent), np.finfo(float).tiny)
    # A velocity below the smallest normal number has no accurate direction.
    if np.abs(velocity - along).max() > TANGENT_TOLERANCE * np.abs(velocity).max() + np.finfo(float).tiny:
        raise InputError(
            f"{place}_velocity {velocity} is not parallel to the path, whose tangent there is {tangent}; a motion with "
            "this velocity leaves the path"
        )
    if velocity @ tangent < 0.0:
        raise InputError(f"{place}_velocity {velocity} is directed backward; the tangent of the path is {tangent}")
    over = np.abs(velocity) / bounds.velocity
    if over.max() > 1.0 + RATE_TOLERANCE:
        name, limit = names[int(over.argmax())], bounds.velocity[int(over.argmax())]
        raise InputError(f"{place}_velocity exceeds the velocity limit {limit:g} of joint {name!r}")
