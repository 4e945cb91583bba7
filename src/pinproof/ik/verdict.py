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
    position, orientation = task.errors(_seen_from(target, arm.forward_kinematics(q).homogeneous)[None])
    fulfils = bool(task.fulfilled(position, orientation)[0]) and arm.limits.contains(q)
    return Candidate(q, (float(position[0]), float(orientation[0])), fulfils)


def judge_many(
    arm: Arm, targets: Array, task: Task, Q: Array, references: Array
) -> tuple[Array, Array, Array, npt.NDArray[np.bool_]]:
    """The same for N targets (N, 4, 4) by the compiled chain: Q, distances, angles, and which fulfil the task."""
    from pinproof.kernels.chain import forward_many

    Q = np.ascontiguousarray(nearest_winding(arm, Q, references))
    poses = np.empty((len(Q), 4, 4))
    forward_many(arm.packed, Q, poses)
    position, orientation = task.errors(_seen_from(targets, poses))
    inside = ((arm.limits.lower <= Q) & (arm.limits.upper >= Q)).all(axis=1)
    return Q, position, orientation, task.fulfilled(position, orientation) & inside


def _seen_from(targets: Array, poses: Array) -> Array:
    """target_from_tcp (..., 4, 4)."""
    out = np.zeros(poses.shape)
    turned = np.swapaxes(targets[..., :3, :3], -1, -2)
    out[..., :3, :3] = turned @ poses[..., :3, :3]
    out[..., :3, 3] = np.einsum("...ij,...j->...i", turned, poses[..., :3, 3] - targets[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out
