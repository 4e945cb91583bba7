"""Round the corners of a path so that the arm need not stop there; a rounding is taken only if it is proven free."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, is_proven_free
from pinproof.errors import InputError
from pinproof.motion import BlendedPath, JointPath, corner

__all__ = ["blend"]

Array = npt.NDArray[np.float64]

SHRINKINGS = 5
"""How often a rounding that is not free is halved. A thirty-second of it would save less time than its proof takes."""


SMALLEST = 1e-6
"""rad or m: a rounding that reaches less far is none."""

STRAIGHT = 1e-9
"""Two directions that differ by less are one: there is no corner to round."""


def blend(path: JointPath, checker: CollisionChecker, *, deviation: float = 0.1) -> BlendedPath:
    """A path that runs through the corners of ``path`` on quintic pieces, twice differentiable there.

    Each rounding stays within the triangle of its corner, so inside the joint limits if the path is, and is proven
    free, or halved until it is. Where none is, and where the path turns back on itself, the arm stops: these are the
    ``corners`` of the result. Its straight stretches are those of the path, and as free as they were.

    Parameters
    ----------
    path
        The path, such as :func:`shortcut` makes it.
    checker
        What the roundings must be free of.
    deviation
        By how much (rad or m, Euclidean in joint space) a corner may be missed. No rounding goes farther than half way
        to the next corner that is rounded as much.

    Raises
    ------
    InputError
        If the path's joints are not the arm's, or ``deviation`` is not above 0.
    """
    if path.joint_names != checker.arm.joint_names:
        raise InputError(f"the path has the joints {path.joint_names}, the arm {checker.arm.joint_names}")
    if not deviation > 0:
        raise InputError(f"deviation = {deviation}; it is a distance in joint space, above 0")
    turning = JointPath(_turning(path.q), path.joint_names)
    reach = np.zeros(len(turning))
    for i, (at, into, out, widest) in _corners(turning.q, deviation).items():
        tried = widest
        for _ in range(SHRINKINGS + 1):
            if tried < SMALLEST:
                break
            width, piece = corner.rounding(at, into, out, tried)
            if is_proven_free(BlendedPath([0.0, width], piece[None], path.joint_names), checker):
                reach[i] = tried
                break
            tried /= 2
    return BlendedPath.rounded(turning, reach)


def _turning(q: Array) -> Array:
    """The waypoints without those that equal their predecessor."""
    moves = (np.diff(q, axis=0) != 0.0).any(axis=1)
    return np.asarray(q[np.concatenate([[True], moves])])


def _corners(q: Array, deviation: float) -> dict[int, tuple[Array, Array, Array, float]]:
    """Of each waypoint that can be rounded: where it is, the directions into and out of it, and the widest reach."""
    steps = np.diff(q, axis=0)
    legs = np.linalg.norm(steps, axis=1)
    way = steps / legs[:, None]
    into, out = way[:-1], way[1:]
    turns = np.linalg.norm(out - into, axis=1) > STRAIGHT
    turns &= np.linalg.norm(out + into, axis=1) > corner.TURNS_BACK
    wanted = np.zeros(len(q))
    inner = np.flatnonzero(turns) + 1
    wanted[inner] = deviation / corner.miss(into[turns], out[turns])
    # A leg is shared by halves; what one end leaves of its half is the other's.
    allowed = np.minimum(
        legs[:-1] - np.minimum(wanted[:-2], legs[:-1] / 2), legs[1:] - np.minimum(wanted[2:], legs[1:] / 2)
    )
    return {int(i): (q[i], into[i - 1], out[i - 1], float(min(wanted[i], allowed[i - 1]))) for i in inner}
