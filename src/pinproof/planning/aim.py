"""What a straight move asks of the tcp, and where it is led to when part of the target's orientation is free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.ik import IkTask
from pinproof.ik.task import TaskName, make_task
from pinproof.spatial import SE3

__all__ = ["aimed", "line_task"]

Array = npt.NDArray[np.float64]

OPPOSITE = 1e-9
"""Of two unit vectors whose sum is shorter, no shortest turn leads from one to the other: the target's own is taken."""


def line_task(task: TaskName | IkTask | Sequence[bool]) -> IkTask:
    """A task by its name or coordinates.

    Raises
    ------
    UnknownNameError
        For an unknown name.
    InputError
        If it asks for part of the position, or for one turn alone: no line leads there.
    """
    asked = make_task(task, 1.0, 1.0).asked > 0.0
    if asked[:3].sum() not in (0, 3) or asked[3:].sum() == 1:
        raise InputError(
            "a straight move asks for the whole position or none of it, and leaves free all turning, one turn or none; "
            f"it was asked for {task}"
        )
    return IkTask(*asked.tolist())


def aimed(here: SE3, target: SE3, task: IkTask) -> SE3:
    """The target, but in what the task leaves free such that it is reached from ``here`` with the least motion."""
    asked = np.array([task.rx, task.ry, task.rz])
    place = target.translation if task.x else here.translation
    if asked.all():
        return SE3(target.rotation, place)
    if not asked.any():
        return SE3(here.rotation, place)
    axis = int(np.flatnonzero(~asked)[0])
    before, behind = here.rotation[:, axis], target.rotation[:, axis]
    if np.linalg.norm(before + behind) < OPPOSITE:
        return SE3(target.rotation, place)
    return SE3(_least_turn(before, behind) @ here.rotation, place)


def _least_turn(a: Array, b: Array) -> Array:
    """The rotation (3, 3) by the smallest angle that takes the unit vector a to b, which is not its opposite."""
    v, cosine = np.cross(a, b), float(a @ b)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))
