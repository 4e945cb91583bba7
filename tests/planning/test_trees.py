"""The trees: nearest nodes, branches, and what a cut takes away."""

from __future__ import annotations

import numpy as np

from pinproof.kernels.rrt import nearest
from pinproof.planning.rrt_connect import Trees


def _add(trees: Trees, sizes: np.ndarray, tree: int, q: np.ndarray, parent: int) -> int:
    """Add a node, as the compiled loop does."""
    index = int(sizes[tree])
    if index == trees.q.shape[1]:
        trees.enlarge()
    trees.q[tree, index], trees.parents[tree, index] = q, parent
    sizes[tree] += 1
    return index


def test_a_cut_removes_the_subtree_and_nothing_else() -> None:
    sizes = np.zeros(2, dtype=np.int64)
    trees = Trees(np.array([5.0, 5.0]), np.array([[0.0, 0.0], [10.0, 0.0]]), sizes)
    a = _add(trees, sizes, 1, np.array([1.0, 0.0]), 0)
    b = _add(trees, sizes, 1, np.array([2.0, 0.0]), a)
    c = _add(trees, sizes, 1, np.array([0.0, 1.0]), 0)
    d = _add(trees, sizes, 1, np.array([3.0, 0.0]), b)
    assert trees.branch(1, d) == [d, b, a, 0]
    trees.cut(1, a)
    assert sorted(map(tuple, trees.nodes(1))) == [(0.0, 0.0), (0.0, 1.0), (10.0, 0.0)]
    assert trees.nodes(0).tolist() == [[5.0, 5.0]]
    assert nearest(trees.q[1], sizes[1], np.array([3.0, 0.1])) == 0
    assert nearest(trees.q[1], sizes[1], np.array([0.1, 2.0])) == c
    assert len(trees) == 7  # what was ever added: cutting gives no budget back


def test_the_nearest_node_is_found_beyond_the_first_capacity() -> None:
    rng = np.random.default_rng(0)
    sizes = np.zeros(2, dtype=np.int64)
    trees = Trees(np.zeros(3), rng.uniform(-1, 1, (1, 3)), sizes)
    for _ in range(600):
        _add(trees, sizes, 1, rng.uniform(-1, 1, 3), int(sizes[1]) - 1)
    for target in rng.uniform(-1, 1, (20, 3)):
        assert nearest(trees.q[1], sizes[1], target) == np.linalg.norm(trees.nodes(1) - target, axis=1).argmin()
