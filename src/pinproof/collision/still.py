"""The pairs between which no joint moves: judged once, for every configuration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision.by_coal import Distance
from pinproof.collision.placed import NEAREST, Placed

__all__ = ["Still", "judge_still"]

Array = npt.NDArray[np.float64]


class Still(NamedTuple):
    """The verdict on them."""

    touching: tuple[tuple[int, Distance], ...]
    """Those in contact."""
    lower: float
    """The smallest signed distance (m) of them, as :meth:`pinproof.CollisionChecker.clearance` has it."""
    upper: float
    """An upper bound of it."""


def judge_still(space: Placed, q: Array) -> Still:
    """Judge the pairs of a workspace that has no others, at any q (n,)."""
    touching = tuple(space.touching(q))
    near = space.near(q, NEAREST)
    judged = [space.measure(k) for k in (*near.contacts, *near.left_to_coal)]
    lower = min((near.lower, *(measured.distance for measured in judged)))
    return Still(touching, lower, min((near.upper, *(measured.attained for measured in judged))))
