"""How two trees stayed apart, in words: what a user of a failed search can act on."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm

__all__ = ["gap_between", "how_far_apart"]

Array = npt.NDArray[np.float64]

NEVER_SHARED = 0.05
"""Rad or m. A joint is named if the values one tree took are at least this far from all that the other took."""


def gap_between(from_start: Array, from_goal: Array) -> float:
    """The smallest distance (Euclidean, in rad or m) between two trees (a, n) and (b, n)."""
    from scipy.spatial import cKDTree

    return float(cKDTree(from_start).query(from_goal)[0].min())


def how_far_apart(arm: Arm, from_start: Array, from_goal: Array, gap: float, *, turns: bool) -> str:
    """The ``gap`` between two trees (a, n) and (b, n) in words, and the joints in which they never met.

    ``turns`` says whether all goals whole turns away were roots; if not, a parted periodic joint suggests them.
    """
    words = f"the trees came within {gap:.3g} (rad or m) of each other in joint space"
    parted = {joint: text for joint in range(arm.dof) if (text := _parted(arm, joint, from_start, from_goal))}
    hint = "a whole turn may lead round it: plan with turns=True"
    hints = [hint] if not turns and any(arm.periodic[joint] for joint in parted) else []
    return "; ".join([words, *parted.values(), *hints])


def _parted(arm: Arm, joint: int, from_start: Array, from_goal: Array) -> str:
    """What keeps the trees apart in one joint; empty if their ranges overlap."""
    one, other = from_start[:, joint], from_goal[:, joint]
    if max(one.min() - other.max(), other.min() - one.max()) < NEVER_SHARED:
        return ""
    return (
        f"{arm.joint_names[joint]} stayed in [{one.min():.2f}, {one.max():.2f}] from the start "
        f"and in [{other.min():.2f}, {other.max():.2f}] from the goal"
    )
