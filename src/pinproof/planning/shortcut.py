"""Shorten a path by straight edges between points of it; an edge is taken only if it is proven free."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.errors import InputError
from pinproof.motion import JointPath
from pinproof.planning.edges import Edges

__all__ = ["shortcut"]

Array = npt.NDArray[np.float64]

WORTH_IT = 1e-6
"""Rad or m (Euclidean). A shortcut that saves less is not worth its proof."""


def shortcut(
    path: JointPath,
    checker: CollisionChecker,
    *,
    rng: int | np.random.Generator = 0,
    attempts: int = 100,
    resolution: float = 0.05,
) -> JointPath:
    """A path with the same ends, at most as long, whose new pieces are each proven free.

    The pieces that are kept are as good as they were: a certified path stays certifiable.

    Parameters
    ----------
    path
        The path to shorten.
    checker
        What new pieces must be free of.
    rng
        Where the ends of the random shortcuts come from; the same gives the same path.
    attempts
        How many random shortcuts are tried, after skipping waypoints wherever that is proven free.
    resolution
        Metres that bodies move between two samples looked at before a proof is begun.

    Raises
    ------
    InputError
        If the path's joints are not the arm's, or a setting makes no sense.
    """
    if path.joint_names != checker.arm.joint_names:
        raise InputError(f"the path has the joints {path.joint_names}, the arm {checker.arm.joint_names}")
    if attempts < 0:
        raise InputError(f"attempts = {attempts}; it is 0 or more")
    edges = Edges(checker, resolution, path.q[[0, -1]])
    q = _skip_waypoints(_without_repeats(np.array(path.q)), edges)
    generator = np.random.default_rng(rng)
    for _ in range(attempts):
        if len(q) < 3:
            break
        q = _random_shortcut(q, edges, generator)
    return JointPath(q, path.joint_names)


def _without_repeats(q: Array) -> Array:
    """The waypoints without those that equal their predecessor: a segment of no length has no point to cut at."""
    moves = (np.diff(q, axis=0) != 0).any(axis=1)
    return q[np.concatenate([[True], moves])]


def _skip_waypoints(q: Array, edges: Edges) -> Array:
    """From each kept waypoint go straight to the farthest one that can be reached."""
    kept, here = [q[0]], 0
    while here < len(q) - 1:
        there = next(
            (k for k in range(len(q) - 1, here + 1, -1) if _saves(q, here, k) and _free(edges, q[here], q[k])), here + 1
        )
        kept.append(q[there])
        here = there
    return np.array(kept)


def _saves(q: Array, i: int, k: int) -> bool:
    along = float(np.linalg.norm(np.diff(q[i : k + 1], axis=0), axis=1).sum())
    return along - float(np.linalg.norm(q[k] - q[i])) > WORTH_IT


def _random_shortcut(q: Array, edges: Edges, rng: np.random.Generator) -> Array:
    lengths = np.linalg.norm(np.diff(q, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    first, last = np.sort(rng.uniform(0.0, at[-1], 2))
    i, k = (min(int(np.searchsorted(at, s, side="right")) - 1, len(lengths) - 1) for s in (first, last))
    if i == k or not lengths[i] > 0 or not lengths[k] > 0:
        return q
    a = q[i] + (q[i + 1] - q[i]) * ((first - at[i]) / lengths[i])
    b = q[k] + (q[k + 1] - q[k]) * ((last - at[k]) / lengths[k])
    if (last - first) - float(np.linalg.norm(b - a)) <= WORTH_IT or not _free(edges, a, b):
        return q
    return np.vstack([q[: i + 1], a, b, q[k + 1 :]])


def _free(edges: Edges, a: Array, b: Array) -> bool:
    return edges.looks_free(a, b) and edges.prove(a, b).free
