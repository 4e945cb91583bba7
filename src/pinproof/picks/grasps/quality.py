r"""The largest force at the centre of mass that contacts resist in every direction.

The quality of a grasp is the largest force q such that a disturbance q u at the centre of mass is resisted for every
direction u: gravity in every orientation, and every acceleration. It is the radius of the largest ball in the forces
without torque that the contacts exert, as in C. Ferrari, J. Canny (1992), "Planning optimal grasps", ICRA, for the task
of Z. Li, S. Sastry (1988), "Task-oriented optimal grasping by multifingered robot hands", IEEE Journal of Robotics and
Automation 4(1). Each contact is limited on its own: the normal force N is at most 1, and for the tangential force
:math:`F_t` and the torque m about the normal,

.. math:: |F_t|^2 + (m / r)^2 \le (\mu N)^2

with the lever r of friction about the normal: the ellipsoidal limit surface of a soft finger (R. Howe, M. Cutkosky,
1996, "Practical force-motion models for sliding manipulation", IJRR 15(6)).

These forces are a convex set, and how far it reaches in one direction is known in closed form for two fingers and for a
cup. The largest ball in the convex hull of these points for fixed directions is a proven lower bound of the quality,
and the least of their distances an upper bound.
"""

from __future__ import annotations

import numpy as np

from pinproof.collision import spiral_directions
from pinproof.spatial import Array

DIRECTIONS = 128
"""Number of directions of force, for which the lower bound is within 2 % of the upper one."""

HALVINGS = 24
"""Number of halvings of the interval of the force: to 1e-7 of the force of a finger."""

LEAST = 1e-4
"""Smaller forces, and coefficients of friction, count as zero."""


def resisted_by_fingers(points: Array, axes: Array, levers: Array, friction: float) -> Array:
    """(N,) lower bounds of the quality of two fingers, in multiples of the force of one.

    ``points`` (N, 2, 3) are relative to the centre of mass; the first finger presses along ``axes`` (N, 3), the second
    one against it. ``levers`` (N,) are the r of both. 0 if the line between the points is not in both cones.
    """
    # The equilibrium of a force u: forces a and u - a at the points, and a torque about the axis. The torque about the
    # line between the points has to vanish, and a is unique up to a force along the line, with which the fingers press
    directions = spiral_directions(DIRECTIONS)
    line = points[:, 1] - points[:, 0]  # (N, 3)
    width = np.einsum("ni,ni->n", line, axes)
    moment = np.cross(points[:, 1, None], directions)  # (N, K, 3)
    turn = -np.einsum("nki,ni->nk", moment, line) / width[:, None]
    square = np.einsum("ni,ni->n", line, line)[:, None, None]
    at_first = np.cross(moment + turn[..., None] * axes[:, None], line[:, None]) / square
    # The normal force, for a force of 1 and beyond that of pressing, and the tangential forces of both
    pulls = np.stack([at_first, directions - at_first], axis=1)  # (N, 2, K, 3)
    signs = np.array([1.0, -1.0])[:, None]
    normal = signs * np.einsum("nski,ni->nsk", pulls, axes)
    aside = pulls - (signs * normal)[..., None] * axes[:, None, None]
    aslant = (line / width[:, None] - axes)[:, None, None] * signs[..., None]  # of pressing with 1
    # Pressing more is better up to the limit, because the line is within the cones; the largest force by halvings
    within = (width > 0.0) & (np.linalg.norm(aslant[:, 0, 0], axis=1) < friction)
    best, step = np.zeros(turn.shape), 2.0 * max(1.0, friction)
    sum_aside, cross = (aside**2).sum(axis=-1), 2 * (aside * aslant).sum(axis=-1)
    slant = (aslant**2).sum(axis=-1)
    for _ in range(HALVINGS):
        step /= 2
        force = (best + step)[:, None]
        press = 1.0 - force * normal.max(axis=1, keepdims=True)
        slip = force**2 * sum_aside + force * press * cross + press**2 * slant
        load = force * normal + press
        spare = (friction * load) ** 2 - slip
        held = ((load >= 0.0) & (spare >= 0.0)).all(axis=1)
        torque = levers[:, None] * np.sqrt(np.maximum(spare, 0.0)).sum(axis=1)
        best += step * (held & (torque >= force[:, 0] * np.abs(turn)))
    return _ball(directions, np.where(within[:, None], best, 0.0))


def resisted_by_cup(points: Array, normals: Array, radius: float, friction: float) -> Array:
    """(N,) lower bounds of the quality of a cup, in multiples of its force, at points (N, 3) with inward normals.

    The cup pulls with up to 1 and may be pressed on with as much; tilt is resisted by the pressure on its rim.
    """
    # A force s u in the plane of the rim needs the pressure 1 + s u . n, at least that of its friction and its tilt
    directions = spiral_directions(DIRECTIONS)
    along = normals @ directions.T
    moment = np.cross(points[:, None], directions)
    spin = np.einsum("nki,ni->nk", moment, normals)
    slip = np.sqrt(np.maximum(1.0 - along**2, 0.0) + (spin / radius) ** 2) / max(friction, LEAST)
    tilt = np.linalg.norm(moment - spin[..., None] * normals[:, None], axis=-1) / radius
    need = np.maximum(np.maximum(slip, tilt) - along, np.maximum(np.abs(along), LEAST))
    return _ball(directions, 1.0 / need)


def _ball(directions: Array, reach: Array) -> Array:
    """(N,) the radius of the largest ball about the origin in the hulls of points at distances (N, K)."""
    from scipy.spatial import ConvexHull

    found = np.zeros(len(reach))
    for row in np.flatnonzero(reach.min(axis=1) > LEAST):
        found[row] = -ConvexHull(reach[row][:, None] * directions).equations[:, 3].max()
    return found
