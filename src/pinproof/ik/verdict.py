"""The judge of every answer: errors measured by forward kinematics, apart from the loop that claims to have arrived."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.ik.task import Task
from pinproof.ik.windings import nearest_winding
from pinproof.model import Arm

__all__ = ["Candidate", "judge", "judge_many"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A configuration (n,) with its errors in m and rad, and whether it fulfils the task inside the limits."""

    q: Array
    errors: tuple[float, float]
    fulfils: bool


def judge(arm: Arm, target: Array, task: Task, q: Array, reference: Array) -> Candidate:
    """What q (n,) is worth for the target (4, 4), with the whole turns nearest to ``reference`` (n,), by Pinocchio."""
    q = nearest_winding(arm, q, reference)
    base_from_tcp, _ = arm.local_jacobian(q)  # q is ours: the way that does not check it again
    errors = _measured(target[None], base_from_tcp.homogeneous[None], task)
    fulfils = bool(task.fulfilled(errors)[0]) and arm.limits.contains(q)
    return Candidate(q, (float(errors[0, 0]), float(errors[0, 1])), fulfils)


def judge_many(
    arm: Arm, targets: Array, task: Task, Q: Array, references: Array
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """The same for targets (N, 4, 4) by the compiled chain: Q, errors (N, 2), and which fulfil the task."""
    from pinproof.kernels.chain import forward_many

    Q = np.ascontiguousarray(nearest_winding(arm, Q, references))
    poses = np.empty((len(Q), 4, 4))
    forward_many(arm.packed, Q, poses)
    errors = _measured(targets, poses, task)
    inside = ((arm.limits.lower <= Q) & (arm.limits.upper >= Q)).all(axis=1)
    return Q, errors, task.fulfilled(errors) & inside


def _measured(targets: Array, poses: Array, task: Task) -> Array:
    from pinproof.kernels.task import measure_many

    errors = np.empty((len(targets), 2))
    measure_many(np.ascontiguousarray(targets), np.ascontiguousarray(poses), task.asked, errors)
    return errors
