"""The two trees of a search: configurations, each with its parent, in the arrays that compiled loops grow."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Trees"]

Array = npt.NDArray[np.float64]

ROOM = 256
"""Nodes there is room for in either tree at first."""


class Trees:
    """The tree of the start (0) and the tree of the goals (1).

    Parameters
    ----------
    start
        (n,) the root of the first.
    goals
        (g, n) the roots of the second.
    sizes
        (2,) how many nodes each has; written here, and by the loop that grows them.

    Attributes
    ----------
    q
        (2, N, n) the nodes, those of either tree in the order they were added; those that were cut stand at infinity.
    parents
        (2, N) the index of each node's parent, its own for a root.
    """

    def __init__(self, start: Array, goals: Array, sizes: npt.NDArray[np.int64]) -> None:
        room = max(ROOM, len(goals) + 1)
        self.q = np.empty((2, room, len(start)))
        self.parents = np.zeros((2, room), dtype=np.int64)
        self._sizes = sizes
        self.q[0, 0], self.q[1, : len(goals)] = start, goals
        self.parents[1, : len(goals)] = np.arange(len(goals))
        sizes[:] = 1, len(goals)

    def __len__(self) -> int:
        """Nodes that were ever added to either."""
        return int(self._sizes.sum())

    def make_room(self) -> None:
        """Twice the room for nodes."""
        self.q = np.concatenate([self.q, np.empty_like(self.q)], axis=1)
        self.parents = np.concatenate([self.parents, np.empty_like(self.parents)], axis=1)

    def branch(self, tree: int, index: int) -> list[int]:
        """Nodes of a tree from ``index`` up to its root."""
        way = [index]
        while (parent := int(self.parents[tree, way[-1]])) != way[-1]:
            way.append(parent)
        return way

    def cut(self, tree: int, index: int) -> None:
        """Take a node that is no root, and all that hangs on it, out of a tree."""
        dead = np.zeros(self._sizes[tree], dtype=bool)
        dead[index] = True
        for child in range(index + 1, len(dead)):  # children come after their parents
            dead[child] = dead[self.parents[tree, child]]
        self.q[tree, : len(dead)][dead] = np.inf

    def living(self, tree: int) -> Array:
        """(m, n) the nodes of a tree that were not cut."""
        q = self.q[tree, : self._sizes[tree]]
        return q[np.isfinite(q[:, 0])]
