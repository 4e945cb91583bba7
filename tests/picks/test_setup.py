"""The setup in which all picks of a list are judged: its random streams and its budget."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.picks import PickBudget, PickSetup


def setup(rng: object, *, optimise: int | None = None, budget: PickBudget | None = None) -> PickSetup:
    arm = pp.load_robot("ur5").arm()
    picks = pp.Picks((pp.Pick("p", pp.pose((0.4, 0.0, 0.4))),), optimise=optimise)
    return PickSetup.make(arm, pp.Scene(), picks, home=None, rng=rng, budget=budget)


@pytest.mark.parametrize("size", [4, 8])
def test_each_pick_has_its_own_stream_which_is_a_child_of_the_seed(size: int) -> None:
    """Children that the seed had before are not used again."""
    for before in (0, 3):
        seed, same = (np.random.SeedSequence(7, spawn_key=(2,), pool_size=size) for _ in range(2))
        seed.spawn(before)
        made = setup(seed)
        children = same.spawn(before + 4)[before:]
        for index, child in enumerate(children):
            expected = np.random.default_rng(child).integers(2**32, size=4)
            assert (made.rng(index).integers(2**32, size=4) == expected).all()


def test_the_budget_is_the_given_one_else_that_of_the_picks() -> None:
    assert setup(0).budget == PickBudget()
    assert setup(0, optimise=17).budget == PickBudget(motion=17)
    assert setup(0, optimise=17, budget=PickBudget(motion=3)).budget == PickBudget(motion=3)
