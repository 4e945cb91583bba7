"""The judge of every answer: errors measured by forward kinematics, apart from the loop that claims to have arrived."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.ik.task import Task
from pinproof.ik.windings import nearest_winding
from pinproof.model import Arm
from pinproof.spatial import SE3

__all__ = ["Candidate", "judge"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A configuration (n,) with its errors in m and rad, and whether it fulfils the task inside the limits."""

    q: Array
    errors: tuple[float, float]
    fulfils: bool


def judge(arm: Arm, target: SE3, task: Task, q: Array, reference: Array) -> Candidate:
    """What q (n,) is worth, with the whole turns nearest to ``reference`` (n,)."""
    q = nearest_winding(arm, q, reference)
    errors = _errors(arm.forward_kinematics(q), target)
    return Candidate(q, errors, task.fulfilled(*errors) and arm.limits.contains(q))


def _errors(base_from_tcp: SE3, base_from_target: SE3) -> tuple[float, float]:
    """Distance (m) and angle (rad) between two poses.

    The angle is taken from sine and cosine together, which is exact to rounding for small angles and near pi alike; the
    arccosine of the trace alone would lose everything below 1e-8.
    """
    off = base_from_tcp.translation - base_from_target.translation
    r = base_from_target.rotation.T @ base_from_tcp.rotation
    two_sines = np.sqrt((r[2, 1] - r[1, 2]) ** 2 + (r[0, 2] - r[2, 0]) ** 2 + (r[1, 0] - r[0, 1]) ** 2)
    angle = np.arctan2(two_sines, r[0, 0] + r[1, 1] + r[2, 2] - 1.0)
    return float(np.sqrt(off.dot(off))), float(angle)
