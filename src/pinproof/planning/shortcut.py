"""Shorten a path by straight edges between points of it; an edge is taken only if it is proven free.

Random shortcuts find the long ways round and leave corners behind; taking waypoints out, and pulling those that stay
towards the straight line between their neighbours, leaves few. Where the one gains nothing more the other often does.

Sources: R. Geraerts, M. Overmars, "Creating high-quality paths for motion planning", IJRR 26(8), 2007 (random
shortcuts); S. Sekhavat, P. Svestka, J.-P. Laumond, M. Overmars, "Multilevel path planning for nonholonomic robots using
semiholonomic subsystems", IJRR 17(8), 1998 (waypoints taken out).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, is_proven_free
from pinproof.errors import InputError
from pinproof.motion import JointPath
from pinproof.planning.edges import Edges

__all__ = ["shortcut"]

Array = npt.NDArray[np.float64]

WORTH_IT = 1e-3
"""Share of the path's length (Euclidean). A change that saves less is not worth its proof."""

PATIENCE = 12
"""Random shortcuts in a row that gain nothing, after which no more are tried."""

PULLS = 5
"""Times that each waypoint is pulled at most."""

NOT_AT_THE_END = 0.1
"""Share of the way between its neighbours that a waypoint keeps from either: no edge becomes a hairline."""

FAINTEST = 0.2
"""A waypoint that cannot be pulled by this share of the way to the straight line is left where it is."""


def shortcut(
    path: JointPath,
    checker: CollisionChecker,
    *,
    rng: int | np.random.Generator = 0,
    attempts: int = 60,
    resolution: float = 0.05,
) -> JointPath:
    """A path with the same ends, at most as long and mostly of few waypoints, whose new edges are each proven free.

    The edges that are kept are as good as they were: a certified path stays certifiable. The work ends with its
    budget, or where it gains nothing more, and never by a clock: the same input gives the same path.

    Parameters
    ----------
    path
        The path to shorten.
    checker
        What new edges must be free of.
    rng
        Where the ends of the random shortcuts come from; the same gives the same path.
    attempts
        How many random shortcuts are tried at most. With 0, waypoints are taken out and nothing else.
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
    work = _Work(checker, Edges(checker, resolution, path.q[[0, -1]]), np.random.default_rng(rng))
    q = work.skip(_without_repeats(np.array(path.q)))
    if attempts:
        q = work.pull(work.drop(work.cut(q, attempts)))
        q = work.drop(q)
    return JointPath(_without_repeats(q), path.joint_names)


class _Work:
    """The ways to change a path q (m, n); each gives a path with the same ends that is not longer."""

    def __init__(self, checker: CollisionChecker, edges: Edges, rng: np.random.Generator) -> None:
        self._checker, self._edges, self._rng = checker, edges, rng

    def skip(self, q: Array) -> Array:
        """From each kept waypoint go straight to the farthest one that can be reached."""
        kept, here, last = [q[0]], 0, len(q) - 1
        while here < last:
            there = next((k for k in range(last, here + 1, -1) if self._free(q[here], q[k])), here + 1)
            kept.append(q[there])
            here = there
        return np.array(kept)

    def drop(self, q: Array) -> Array:
        """Take out one waypoint after another, where the straight edge between its neighbours is free."""
        i = 1
        while i < len(q) - 1:
            if self._free(q[i - 1], q[i + 1]):
                q = np.delete(q, i, axis=0)
                i = max(i - 1, 1)  # its neighbour now has another one
            else:
                i += 1
        return q

    def cut(self, q: Array, attempts: int) -> Array:
        """Random shortcuts between points of different edges, until they no longer gain."""
        fruitless = 0
        for _ in range(attempts):
            if len(q) < 3 or fruitless == PATIENCE:
                break
            shorter = self._random_shortcut(q)
            fruitless = fruitless + 1 if shorter is q else 0
            q = shorter
        return q

    def _random_shortcut(self, q: Array) -> Array:
        lengths = np.linalg.norm(np.diff(q, axis=0), axis=1)
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        first, last = np.sort(self._rng.uniform(0.0, at[-1], 2))
        i, k = (min(int(np.searchsorted(at, s, side="right")) - 1, len(lengths) - 1) for s in (first, last))
        if i == k:
            return q
        a = q[i] + (q[i + 1] - q[i]) * ((first - at[i]) / lengths[i])
        b = q[k] + (q[k + 1] - q[k]) * ((last - at[k]) / lengths[k])
        gain = (last - first) - float(np.linalg.norm(b - a))
        if gain <= WORTH_IT * at[-1] or not self._free(a, b):
            return q
        return np.vstack([q[: i + 1], a, b, q[k + 1 :]])

    def pull(self, q: Array) -> Array:
        """Move each waypoint towards the straight line between its neighbours: all the way, half of it, ..."""
        q = q.copy()
        share = np.ones(len(q))
        least = WORTH_IT * float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())
        for _ in range(PULLS):
            gained = False
            for i in range(1, len(q) - 1):
                before, here, behind = q[i - 1 : i + 2]
                chord = behind - before
                along = float((here - before) @ chord / max(chord @ chord, np.finfo(float).tiny))
                foot = before + chord * min(max(along, NOT_AT_THE_END), 1.0 - NOT_AT_THE_END)
                there = here + (foot - here) * share[i]
                legs = [
                    float(np.linalg.norm(step))
                    for step in (here - before, behind - here, there - before, behind - there)
                ]
                if share[i] < FAINTEST or legs[0] + legs[1] - legs[2] - legs[3] <= least:
                    continue
                if self._free(before, there) and self._free(there, behind):
                    q[i], gained = there, True
                else:
                    share[i] /= 2
                    gained = gained or share[i] >= FAINTEST
            if not gained:
                break
        return q

    def _free(self, a: Array, b: Array) -> bool:
        names = self._checker.arm.joint_names
        return self._edges.looks_free(a, b) and is_proven_free(JointPath([a, b], names), self._checker)


def _without_repeats(q: Array) -> Array:
    """The waypoints without those that equal their predecessor: a segment of no length has no point to cut at."""
    moves = (np.diff(q, axis=0) != 0).any(axis=1)
    return q[np.concatenate([[True], moves])]
