"""The tree: nearest nodes, branches, and what a cut takes away."""

from __future__ import annotations

import numpy as np

from pinproof.planning.tree import Tree


def test_a_cut_takes_all_that_hangs_on_it_and_no_more() -> None:
    tree = Tree(np.array([[0.0, 0.0], [10.0, 0.0]]))
    a = tree.add(np.array([1.0, 0.0]), 0)
    b = tree.add(np.array([2.0, 0.0]), a)
    c = tree.add(np.array([0.0, 1.0]), 0)
    d = tree.add(np.array([3.0, 0.0]), b)
    assert tree.branch(d) == [d, b, a, 0]
    tree.cut(a)
    assert sorted(map(tuple, tree.living())) == [(0.0, 0.0), (0.0, 1.0), (10.0, 0.0)]
    assert tree.nearest(np.array([3.0, 0.1])) == 0
    assert tree.nearest(np.array([0.1, 2.0])) == c
    assert len(tree) == 6  # what was ever added: cutting gives no budget back


def test_nearest_is_the_nearest_of_all_beyond_the_first_allocation() -> None:
    rng = np.random.default_rng(0)
    tree = Tree(rng.uniform(-1, 1, (1, 3)))
    for _ in range(300):
        tree.add(rng.uniform(-1, 1, 3), len(tree) - 1)
    for target in rng.uniform(-1, 1, (20, 3)):
        assert tree.nearest(target) == np.linalg.norm(tree.living() - target, axis=1).argmin()
