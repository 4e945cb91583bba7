"""Time-optimal rest-to-rest motion along straight segments, in closed form.

Along q(s) = a + (b - a) s, s from 0 to 1, the limits of the joints become one on s' and one on s'':
V = min_j v_j / |b_j - a_j| and A = min_j a_j / |b_j - a_j|. Both are constant, so the fastest motion speeds up at A,
runs at V if it gets that far, and slows down at A: a trapezoid, or a triangle (L. Biagiotti, C. Melchiorri,
"Trajectory Planning for Automatic Machines and Robots", 2008, section 3.2). toppra finds the same on a fine grid.

s is quadratic on each phase, so cubic Hermite pieces between the switching points are this motion exactly, and all
their control points lie on the segment: the image cannot leave it.
"""

from __future__ import annotations

import numpy as np

from pinproof.errors import TimingError
from pinproof.motion.clock import LONGEST, NANO, seconds
from pinproof.motion.curve import Array
from pinproof.motion.joint_path import JointPath
from pinproof.motion.limits import RATE_TOLERANCE, Bounds
from pinproof.motion.trajectory import Trajectory

__all__ = ["ON_LINE_TOLERANCE", "time_straight"]

ON_LINE_TOLERANCE = 1e-13
"""How far (relative to a joint's largest coordinate, at least 1 rad or m) a waypoint may lie off the straight line
between its neighbours for the motion to run through it: a few roundings, so that the image does not change."""

_SHORTEST_CRUISE = 1e-5
"""Seconds below which a stretch does without a cruise: one of nanoseconds, left over by rounding, would magnify the
rounding of its end points into accelerations beyond any limit."""

_ROUNDS = 32
"""Times that stretches are slowed down against rounding before the caller is told; none or one is usual."""


def time_straight(path: JointPath, bounds: Bounds) -> Trajectory:
    """Time ``path`` (which moves) from rest to rest along each straight stretch."""
    corners = _corners(path.q)
    step = np.diff(corners, axis=0)
    slower = np.ones(len(step))
    trajectory, first_piece = _profile(path, corners, step, slower, bounds)
    for attempt in range(_ROUNDS):
        excess = np.maximum.reduceat(bounds.excess(trajectory), first_piece)
        too_fast = bounds.too_fast(excess)
        if not too_fast.any():
            break
        # Only rounding is left to correct: positions are rounded to 1e-16, and a phase of h seconds magnifies that
        # by 6 / h^2 in its acceleration. A slower stretch has a smaller h^-2, and the steps grow, so this ends.
        slower *= np.where(too_fast, excess * (1.0 + RATE_TOLERANCE * 2.0**attempt), 1.0)
        trajectory, first_piece = _profile(path, corners, step, slower, bounds)
    return trajectory


def _profile(
    path: JointPath, corners: Array, step: Array, slower: Array, bounds: Bounds
) -> tuple[Trajectory, np.ndarray[tuple[int], np.dtype[np.intp]]]:
    """The trajectory, each stretch slowed down by a factor, and the index of each stretch's first piece."""
    with np.errstate(divide="ignore", over="ignore"):  # joints that rest do not bound s, hairlines bound it at infinity
        speed = np.minimum((bounds.velocity / np.abs(step)).min(axis=1), 1e150)
        acceleration = np.minimum((bounds.acceleration / np.abs(step)).min(axis=1), 1e300)
    ramp = np.minimum(speed / acceleration, 1.0 / np.sqrt(acceleration))
    cruise = np.maximum(1.0 / speed - ramp, 0.0)
    # without a cruise it is a triangle; a cruise given up goes to the ramp, so that the peak is no higher
    triangle = cruise < _SHORTEST_CRUISE
    ramp, cruise = np.where(triangle, ramp + cruise, ramp), np.where(triangle, 0.0, cruise)
    if not float(slower @ (2.0 * ramp + cruise)) <= LONGEST:
        raise TimingError(
            f"the path takes longer than the {LONGEST:.0f} s that can be counted; are its units radians and metres?"
        )
    # phases are rounded up to whole nanoseconds and the peak recomputed, so that limits still hold: ramp and cruise
    # cover s = 1 at peak = 1 / (ramp + cruise), which is lower, and so is peak / ramp
    ramp_ns = np.maximum(np.ceil(slower * ramp * NANO), 1.0).astype(np.int64)
    cruise_ns = np.ceil(slower * cruise * NANO).astype(np.int64)
    ramp, cruise = seconds(ramp_ns), seconds(cruise_ns)
    peak = 1.0 / (ramp + cruise)
    ramp_step = step * (0.5 * peak * ramp)[:, None]

    # four points a stretch (its start, both ends of the cruise, its end); starts and empty cruises are dropped
    phases = np.stack([np.zeros_like(ramp_ns), ramp_ns, cruise_ns, ramp_ns], axis=1)
    q = np.stack([corners[:-1], corners[:-1] + ramp_step, corners[1:] - ramp_step, corners[1:]], axis=1)
    velocity = np.zeros_like(q)
    velocity[:, 1:3] = (step * peak[:, None])[:, None]
    keep = phases > 0
    keep[0, 0] = True
    pieces = np.count_nonzero(phases > 0, axis=1)
    trajectory = Trajectory(seconds(np.cumsum(phases[keep])), q[keep], velocity[keep], path.joint_names, bounds.note)
    return trajectory, np.concatenate([[0], np.cumsum(pieces)[:-1]])


def _corners(q: Array) -> Array:
    """The waypoints where the motion must stop: repeated ones and those on a straight run are left out."""
    moves = np.concatenate([[True], (np.diff(q, axis=0) != 0.0).any(axis=1)])
    q = q[moves]
    corners, first = [0], 0
    while first < len(q) - 1:
        last = first + 1
        while last + 1 < len(q) and _straight(q[first : last + 2]):
            last += 1
        corners.append(last)
        first = last
    return q[corners]


def _straight(q: Array) -> bool:
    """Whether the inner points lie on the segment from the first to the last point, in order."""
    chord = q[-1] - q[0]
    s = (q - q[0]) @ chord / max(float(chord @ chord), np.finfo(float).tiny)
    off = np.abs(q[0] + s[:, None] * chord - q)
    return bool((np.diff(s) > 0.0).all() and (off <= ON_LINE_TOLERANCE * np.maximum(1.0, np.abs(q).max(axis=0))).all())
