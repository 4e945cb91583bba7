"""What the joints shall do besides the task, where they are free to: goals of the null space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from pinproof.errors import UnknownNameError
from pinproof.ik.settings import positive
from pinproof.model import Arm

__all__ = ["GoalName", "IkGoal", "drift", "packed_goal"]

Array = npt.NDArray[np.float64]
GoalName = Literal["centre", "near", "manipulability"]

FINITE_STEP = 1e-5
"""Rad or m, for central differences of the manipulability."""

TINY = 1e-14
"""Added to the squares of the singular values, so that the logarithm of a vanishing volume exists."""

LONGEST_DRIFT = 0.2
"""Rad or m: the most a goal moves a joint in one step, so that the task stays nearly fulfilled."""


@dataclass(frozen=True)
class IkGoal:
    """A wish for the freedom that the task leaves: of a redundant arm, or of a task with free coordinates.

    The solution is then moved, without leaving the task, until the goal pulls along no free direction any more.

    Parameters
    ----------
    kind
        ``"centre"``: the joints to the middle of their limits, each weighed by its range. ``"near"``: near q0.
        ``"manipulability"``: away from singularities, up the logarithm of sqrt(det(J J^T)) (Yoshikawa 1985).
    gain
        The share of the way that each step goes, for a posture; for the manipulability the length of a step (rad or m)
        per unit of its gradient. By default 1 and 0.2.

    References
    ----------
    Liegeois (1977), "Automatic supervisory control of the configuration and behavior of multibody mechanisms": the
    gradient of the goal projected into the null space of the Jacobian.
    """

    kind: GoalName
    gain: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in get_args(GoalName):
            raise UnknownNameError("goal", self.kind, get_args(GoalName))
        if self.gain is None:
            object.__setattr__(self, "gain", 0.2 if self.kind == "manipulability" else 1.0)
        positive("gain", self.gain)  # type: ignore[arg-type]  # set above


def packed_goal(goal: IkGoal | GoalName | None, arm: Arm, q0: Array) -> Array:
    """The goal as kernels read it, (3, max(n, 2)): see :mod:`pinproof.kernels.goals`."""
    packed = np.zeros((3, max(arm.dof, 2)))
    if goal is None:
        return packed
    if not isinstance(goal, IkGoal):
        goal = IkGoal(goal)
    packed[0, :2] = {"centre": 1.0, "manipulability": 2.0, "near": 3.0}[goal.kind], goal.gain
    packed[1, : arm.dof], packed[2, : arm.dof] = q0, 1.0
    if goal.kind == "centre":
        lower, upper = arm.limits.sampling_range()
        packed[1, : arm.dof] = (lower + upper) / 2
        share = (upper - lower).min() / np.maximum(upper - lower, 1e-9)
        packed[2, : arm.dof] = np.where(np.isfinite(arm.limits.upper - arm.limits.lower), share**2, 0.0)
    return packed


def drift(packed: Array, arm: Arm, q: Array) -> Array:
    """The step (n,) that the goal alone would take at q; not yet projected. The twin of the kernel's."""
    kind, gain = packed[0, :2]
    if kind == 0.0:
        return np.zeros(arm.dof)
    if kind != 2.0:
        step = gain * packed[2, : arm.dof] * (packed[1, : arm.dof] - q)
    else:
        shifts = FINITE_STEP * np.eye(arm.dof)
        rises = [_log_manipulability(arm, q + shift) - _log_manipulability(arm, q - shift) for shift in shifts]
        step = gain * np.array(rises) / (2 * FINITE_STEP)
    largest = float(np.abs(step).max())
    return np.asarray(step * (LONGEST_DRIFT / largest) if largest > LONGEST_DRIFT else step)


def _log_manipulability(arm: Arm, q: Array) -> float:
    jacobian = arm.local_jacobian(q)[1]
    square = jacobian.T @ jacobian if arm.dof < 6 else jacobian @ jacobian.T
    return 0.5 * float(np.linalg.slogdet(square + TINY * np.eye(len(square)))[1])
