"""A tree of configurations that grows in place and can lose a branch."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Tree"]

Array = npt.NDArray[np.float64]


class Tree:
    """Configurations with their parents; the roots come first and are their own parents.

    A node that was cut is at infinity: it keeps its index and is never the nearest to anything.

    Parameters
    ----------
    roots
        (k, n) configurations, k >= 1.
    """

    def __init__(self, roots: Array) -> None:
        count, dof = roots.shape
        self.q = np.empty((max(64, 2 * count), dof))
        self.q[:count] = roots
        self.parent = list(range(count))

    def __len__(self) -> int:
        """The number of nodes that were ever added."""
        return len(self.parent)

    def add(self, q: Array, parent: int) -> int:
        """Hang a configuration on a node; its index."""
        index = len(self.parent)
        if index == len(self.q):
            self.q = np.concatenate([self.q, np.empty_like(self.q)])
        self.q[index] = q
        self.parent.append(parent)
        return index

    def nearest(self, q: Array) -> int:
        """The living node nearest to q (n,), by the Euclidean distance in joint space; the oldest of equals."""
        gaps = self.q[: len(self.parent)] - q
        return int(np.einsum("ij,ij->i", gaps, gaps).argmin())

    def branch(self, index: int) -> list[int]:
        """Node indices from ``index`` up to its root."""
        way = [index]
        while self.parent[way[-1]] != way[-1]:
            way.append(self.parent[way[-1]])
        return way

    def cut(self, index: int) -> None:
        """Take a node that is no root, and all that hangs on it, out of the tree."""
        dead = {index}
        for child in range(index + 1, len(self.parent)):  # children come after their parents
            if self.parent[child] in dead:
                dead.add(child)
        self.q[list(dead)] = np.inf

    def living(self) -> Array:
        """(m, n) the configurations that were not cut."""
        q = self.q[: len(self.parent)]
        return q[np.isfinite(q[:, 0])]
