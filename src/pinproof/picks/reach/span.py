"""How far an arm stretches."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm

__all__ = ["Span"]

Array = npt.NDArray[np.float64]

FINEST_SPAN = 1e-6
"""Metres: more than a solved pose may be off."""


class Span:
    """How far an arm stretches: a search for what lies beyond costs all its restarts, this two products.

    A rotation about an axis keeps the points of the axis. So the origin of the first joint is fixed in the base, that
    of the last one in the target, and between them lie the lengths from joint to joint at most.
    """

    def __init__(self, arm: Arm) -> None:
        from pinproof.kernels.chain import LEADER, MULTIPLIER, OFFSET, SLIDES

        chain, limits = arm.packed, arm.limits
        rows, slides = chain[:-1], chain[:-1, SLIDES] != 0.0
        reach = np.maximum(np.abs(limits.lower), np.abs(limits.upper))[rows[:, LEADER].astype(int)]
        travel = np.where(slides, np.abs(rows[:, MULTIPLIER]) * reach + np.abs(rows[:, OFFSET]), 0.0)
        self._longest = np.linalg.norm(rows[1:, [3, 7, 11]], axis=1).sum() + travel.sum()
        self._first = rows[0, [3, 7, 11]]
        tool = np.vstack([chain[-1, :12].reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
        self._last = np.linalg.inv(tool)[:, 3]

    def may_reach(self, targets: Array) -> npt.NDArray[np.bool_]:
        """(N,) whether targets (N, 4, 4) are near enough; those that are not cannot be reached."""
        away = (targets @ self._last)[:, :3] - self._first
        return np.asarray(np.linalg.norm(away, axis=1) <= self._longest + FINEST_SPAN)
