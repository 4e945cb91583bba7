"""The trees: nearest nodes, branches, and what a cut takes away."""

from __future__ import annotations

import numpy as np

import pinproof as pp
from pinproof import _core
from pinproof.planning import Edges


def _search(arm: pp.Arm, start: np.ndarray, goals: np.ndarray) -> _core.RrtSearch:
    edges = Edges(pp.CollisionChecker(arm), 0.1, start[None])
    box = np.array([[-9.0] * arm.dof, [9.0] * arm.dof])
    return _core.RrtSearch(edges.core, start, goals, box, step=0.7, max_nodes=1000, max_samples=1000)


def test_a_cut_removes_the_subtree_and_nothing_else(gantry: pp.Arm) -> None:
    search = _search(gantry, np.array([5.0, 5.0]), np.array([[0.0, 0.0], [10.0, 0.0]]))
    a = search.add(1, np.array([1.0, 0.0]), 0)
    b = search.add(1, np.array([2.0, 0.0]), a)
    c = search.add(1, np.array([0.0, 1.0]), 0)
    d = search.add(1, np.array([3.0, 0.0]), b)
    assert search.branch(1, d) == [d, b, a, 0]
    search.cut(1, a)
    assert sorted(map(tuple, search.nodes(1))) == [(0.0, 0.0), (0.0, 1.0), (10.0, 0.0)]
    assert search.nodes(0).tolist() == [[5.0, 5.0]]
    assert search.nearest(1, np.array([3.0, 0.1])) == 0
    assert search.nearest(1, np.array([0.1, 2.0])) == c
    assert search.size(0) + search.size(1) == 7  # what was ever added: cutting gives no budget back


def test_nearest_is_the_nearest_of_all(ur5: pp.Arm) -> None:
    rng = np.random.default_rng(0)
    search = _search(ur5, np.zeros(6), rng.uniform(-1, 1, (1, 6)))
    for _ in range(600):
        search.add(1, rng.uniform(-1, 1, 6), search.size(1) - 1)
    for target in rng.uniform(-1, 1, (20, 6)):
        assert search.nearest(1, target) == np.linalg.norm(search.nodes(1) - target, axis=1).argmin()
