"""The judge of every answer in the table, ours and others': Pinocchio's forward kinematics and the limits, no more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm
from pinproof.spatial import rigid, twist_size

__all__ = ["Judged", "judge_answers"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Judged:
    """What the answers to N targets are worth.

    Parameters
    ----------
    answered
        (N,) the targets for which the method claims an answer.
    right
        (N,) those of them for which everything it claims is inside the limits and within the tolerance.
    position_error, rotation_error
        (N,) of the worst answer claimed, in m and rad; infinite for one that is not finite, 0 where none is claimed.
        What the task does not ask for counts as 0.
    """

    answered: Flags
    right: Flags
    position_error: Array
    rotation_error: Array

    @property
    def success(self) -> float:
        """The share of targets that were solved."""
        return float(self.right.mean())

    @property
    def false_yes(self) -> int:
        """Answers claimed that are none."""
        return int((self.answered & ~self.right).sum())


def judge_answers(arm: Arm, targets: Array, answers: Array, task: str, tolerance: float) -> Judged:
    """Judge the answers (N, k, n) to targets (N, 4, 4); a row of NaN is an answer that was not claimed.

    ``tolerance`` is in m and rad alike; ``task`` is ``"pose"`` or ``"position"``. Nothing is wrapped or clipped before
    it is judged.
    """
    claimed: Flags = np.asarray(~np.isnan(answers).all(axis=2))
    inside: Flags = np.asarray(((arm.limits.lower <= answers) & (answers <= arm.limits.upper)).all(axis=2))
    right = np.ones(claimed.shape, dtype=bool)
    errors = np.zeros((*claimed.shape, 2))
    for row, column in np.argwhere(claimed):
        q = answers[row, column]
        if np.isfinite(q).all():
            errors[row, column] = twist_size(rigid("target", targets[row]), arm.forward_kinematics(q))
        else:
            errors[row, column] = np.inf
        if task == "position":
            errors[row, column, 1] = 0.0
        right[row, column] = inside[row, column] and bool((errors[row, column] <= tolerance).all())
    answered = np.asarray(claimed.any(axis=1))
    worst = errors.max(axis=1, initial=0.0)
    return Judged(answered, np.asarray(answered & right.all(axis=1)), worst[:, 0], worst[:, 1])
