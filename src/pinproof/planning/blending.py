"""Round the corners of a path so that the arm does not stop there; a rounding is accepted only if it is proven free."""

from __future__ import annotations

import numpy as np

from pinproof.collision import CollisionChecker, is_proven_free
from pinproof.errors import InputError
from pinproof.motion import BlendedPath, JointPath, corner
from pinproof.spatial import Array

MAX_HALVINGS = 5
"""Maximum number of times that a rounding that is not free is halved. A smaller one saves less time than its proof
takes."""

MIN_REACH = 1e-6
"""Smallest reach (rad or m) of a rounding."""

STRAIGHT = 1e-9
"""There is no corner between two unit directions that differ by less."""


def blend(path: JointPath, checker: CollisionChecker, *, deviation: float = 0.1) -> BlendedPath:
    """Replace the corners of ``path`` by quintic pieces, so that the path is twice differentiable there.

    Each rounding is inside the triangle of its corner, and therefore inside the joint limits if the path is. A rounding
    that is not proven free is halved until it is. If no rounding is free, or if the path reverses its direction, the
    arm stops at the corner; these are the ``corners`` of the result. The rest of the straight segments is not changed.

    Parameters
    ----------
    path
        The path, such as the result of :func:`shortcut`.
    checker
        Defines the bodies and margins for the roundings.
    deviation
        Maximum distance (rad or m, Euclidean in joint space) between a corner and its rounding. Two roundings on the
        same segment share its length.

    Raises
    ------
    InputError
        If the path does not move the joints of the arm, or ``deviation`` is not above 0.
    """
    if path.joint_names != checker.group.joint_names:
        raise InputError(f"the path has the joints {path.joint_names}, the arm {checker.group.joint_names}")
    if not deviation > 0:
        raise InputError(f"deviation = {deviation}; it must be a distance in joint space above 0")
    distinct = JointPath(without_repeats(path.q), path.joint_names)
    reach = np.zeros(len(distinct))
    for i, (at, into, out, max_reach) in _corners(distinct.q, deviation).items():
        tried = max_reach
        for _ in range(MAX_HALVINGS + 1):
            if tried < MIN_REACH:
                break
            width, piece = corner.rounding(at, into, out, tried)
            if is_proven_free(BlendedPath([0.0, width], piece[None], path.joint_names), checker):
                reach[i] = tried
                break
            tried /= 2
    return BlendedPath.rounded(distinct, reach)


def without_repeats(q: Array) -> Array:
    """The waypoints without those that equal their predecessor: a segment of length 0 has no direction."""
    moves = (np.diff(q, axis=0) != 0.0).any(axis=1)
    return np.asarray(q[np.concatenate([[True], moves])])


def _corners(q: Array, deviation: float) -> dict[int, tuple[Array, Array, Array, float]]:
    """For each waypoint that can be rounded: its position, the directions into and out of it, and the maximum reach."""
    steps = np.diff(q, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / lengths[:, None]
    into, out = directions[:-1], directions[1:]
    turns = np.linalg.norm(out - into, axis=1) > STRAIGHT
    turns &= np.linalg.norm(out + into, axis=1) > corner.REVERSAL
    wanted = np.zeros(len(q))
    inner = np.flatnonzero(turns) + 1
    wanted[inner] = deviation / corner.distance_to_corner(into[turns], out[turns])
    # Each end of a segment may use half of its length, and what the other end leaves of its half.
    allowed = np.minimum(
        lengths[:-1] - np.minimum(wanted[:-2], lengths[:-1] / 2), lengths[1:] - np.minimum(wanted[2:], lengths[1:] / 2)
    )
    return {int(i): (q[i], into[i - 1], out[i - 1], float(min(wanted[i], allowed[i - 1]))) for i in inner}
