"""The goals of a plan: checked numbers, and the same poses whole turns away."""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.spatial import finite

__all__ = ["read_goals", "with_turns"]

Array = npt.NDArray[np.float64]

TURN = 2 * np.pi

MOST_TURNED = 512
"""Goals with their turns; of more, those nearest to the start are kept. A UR5 has 32 for each branch."""


def read_goals(arm: Arm, goals: npt.ArrayLike) -> Array:
    """One goal (n,) or several (g, n) as (g, n).

    Raises
    ------
    InputError
        If there is none, a shape is wrong or a number is not finite.
    """
    try:
        dimensions, size = np.ndim(goals), np.size(goals)
    except ValueError as error:  # rows of different lengths
        raise InputError(f"goals must have the shape ({arm.dof},) or (g, {arm.dof}): {error}") from error
    if size == 0:
        raise InputError("goals is empty; give at least one configuration")
    return arm.configuration(goals, "goals")[None] if dimensions == 1 else finite("goals", goals, (None, arm.dof))


def with_turns(arm: Arm, start: Array, goals: Array) -> tuple[Array, list[int]]:
    """The goals and all their equals: the same poses, periodic joints whole turns away inside the limits.

    Where limits leave a joint unbounded, only the two angles on either side of the start's.

    Parameters
    ----------
    arm
        Says which joints are periodic.
    start
        (n,) where the plan begins.
    goals
        (g, n), kept as they are.

    Returns
    -------
    (k, n) goals, the given ones first, then by the largest joint step from the start; and, for each, the index of the
    given goal it equals.
    """
    turned: list[tuple[float, int, Array]] = []
    for index, goal in enumerate(goals):
        for turns in product(*(_turns(arm, joint, start[joint], goal[joint]) for joint in range(arm.dof))):
            if any(turns):
                shift = TURN * np.array(turns)
                # only rounding is clipped: a turn may end one bit beyond a limit that is a multiple of 2 pi
                q = np.where(shift != 0, np.clip(goal + shift, arm.limits.lower, arm.limits.upper), goal)
                turned.append((float(np.abs(q - start).max()), index, q))
    turned.sort(key=lambda entry: entry[:2])
    turned = turned[: max(MOST_TURNED - len(goals), 0)]
    return np.vstack([goals, *(q for _, _, q in turned)]), [*range(len(goals)), *(index for _, index, _ in turned)]


def _turns(arm: Arm, joint: int, start: float, goal: float) -> list[int]:
    """By how many turns a joint may be moved; 0 is always among them."""
    if not arm.periodic[joint]:
        return [0]
    below = int(np.floor((start - goal) / TURN))
    low, high = arm.limits.lower[joint], arm.limits.upper[joint]
    fewest = below if np.isinf(low) else int(np.ceil((low - goal) / TURN))
    most = below + 1 if np.isinf(high) else int(np.floor((high - goal) / TURN))
    return sorted({0, *range(fewest, most + 1)})
