"""A tree of configurations that grows in place and can lose a branch."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Tree"]

Array = npt.NDArray[np.float64]


class Tree:
    """Configurations (m, n) with their parents; roots are their own parent, ``label`` is the index of a node's root."""

    def __init__(self, roots: Array) -> None:
        count, dof = roots.shape
        self.q = np.empty((max(64, 2 * count), dof))
        self.q[:count] = roots
        self.parent = list(range(count))
        self.alive = np.ones(len(self.q), dtype=bool)
        self.proven = [True] * count  # the edge to the parent; a root has none

    def __len__(self) -> int:
        return len(self.parent)

    def add(self, q: Array, parent: int) -> int:
        """Hang a configuration on a node; its index."""
        index = len(self.parent)
        if index == len(self.q):
            self.q = np.concatenate([self.q, np.empty_like(self.q)])
            self.alive = np.concatenate([self.alive, np.ones(index, dtype=bool)])
        self.q[index], self.alive[index] = q, True
        self.parent.append(parent)
        self.proven.append(False)
        return index

    def nearest(self, q: Array) -> int:
        """The living node nearest to q (n,), by the Euclidean distance in joint space."""
        count = len(self.parent)
        gaps = self.q[:count] - q
        squared = np.einsum("ij,ij->i", gaps, gaps)
        squared[~self.alive[:count]] = np.inf
        return int(squared.argmin())

    def branch(self, index: int) -> list[int]:
        """Node indices from ``index`` up to its root."""
        way = [index]
        while self.parent[way[-1]] != way[-1]:
            way.append(self.parent[way[-1]])
        return way

    def cut(self, index: int) -> None:
        """Take a node and all that hangs on it out of the tree."""
        self.alive[index] = False
        for child in range(index + 1, len(self.parent)):  # children come after their parents
            if not self.alive[self.parent[child]]:
                self.alive[child] = False
