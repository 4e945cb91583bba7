"""Tasks (the coordinates of the target pose that count, with residual and Jacobian) and null-space goals.

The residual is computed from ``target_from_tcp = E``, which is the identity at a solution of the complete pose::

    r = (translation of E, rotation vector of E),   rows that the task does not select are zero
    dr/dq = (v, Jl^-1 w) with the Jacobian of the tcp (v, w) in the axes of the target

``Jl`` is the left Jacobian of SO(3). Since Jl e = e for its own rotation vector e, the Newton step and the gradient of
|r|^2 do not change without this factor if all three angles are selected; it is then omitted.

Source: Sola, Deray, Atchuthan (2018), "A micro Lie theory for state estimation in robotics", eqs. 132, 146.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from pinproof._core import Goal as CompiledGoal
from pinproof._core import Task as CompiledTask
from pinproof.common.validation import require_positive
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm
from pinproof.spatial import Array

TaskName = Literal["pose", "position", "orientation", "spin_x", "spin_y", "spin_z"]
TaskLike: TypeAlias = "TaskName | IkTask | Sequence[bool]"

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class IkTask:
    """The coordinates of the target pose that a solution must match, in the axes of the target.

    ``x``, ``y``, ``z`` are the position, ``rx``, ``ry``, ``rz`` the rotation vector from target to tcp. For example,
    ``IkTask(rz=False)``, also called ``"spin_z"``, is the pose with a free rotation about the z axis of the target, and
    ``IkTask(rx=False, ry=False, rz=False)`` is ``"position"``.
    """

    x: bool = True
    y: bool = True
    z: bool = True
    rx: bool = True
    ry: bool = True
    rz: bool = True

    def __post_init__(self) -> None:
        flags = [getattr(self, name) for name in COORDINATES]
        if not all(isinstance(one, (bool, np.bool_)) for one in flags):
            raise InputError(f"the fields of IkTask ({', '.join(COORDINATES)}) must be True or False, not {flags}")
        if not any(flags):
            raise InputError(f"IkTask must select at least one coordinate of {', '.join(COORDINATES)}")


TASKS: dict[str, IkTask] = {
    "pose": IkTask(),
    "position": IkTask(rx=False, ry=False, rz=False),
    "orientation": IkTask(x=False, y=False, z=False),
    "spin_x": IkTask(rx=False),
    "spin_y": IkTask(ry=False),
    "spin_z": IkTask(rz=False),
}


@dataclass(frozen=True, eq=False)
class Task:
    """A task with its tolerances (m, rad); ``mask`` (6,) is 1 for coordinates that count. 1 m weighs as 1 rad."""

    mask: Array
    position_tolerance: float
    orientation_tolerance: float

    def residual(self, target_from_tcp: Array) -> Array:
        """(6,) the residual at the pose E (4, 4); zero at a solution."""
        e = np.concatenate([target_from_tcp[:3, 3], rotation_vector(target_from_tcp[:3, :3])])
        return np.asarray(e * self.mask)

    def jacobian(self, target_from_tcp: Array, in_target_axes: Array) -> Array:
        """(6, n) the derivative of :meth:`residual`, from the Jacobian of the tcp (6, n) in the axes of the target."""
        rows = in_target_axes * self.mask[:, None]
        if 0 < self.mask[3:].sum() < 3:
            inverse = left_jacobian_inverse(rotation_vector(target_from_tcp[:3, :3]))
            rows[3:] = (inverse @ in_target_axes[3:]) * self.mask[3:, None]
        return np.asarray(rows)

    def reached(self, residual: Array) -> bool:
        """Whether a residual (6,) is within the tolerances."""
        linear, angular = residual[:3], residual[3:]
        return bool(
            linear.dot(linear) <= self.position_tolerance**2 and angular.dot(angular) <= self.orientation_tolerance**2
        )

    @cached_property
    def compiled(self) -> CompiledTask:
        """The task for the compiled core."""
        return CompiledTask((self.mask > 0).tolist(), self.position_tolerance, self.orientation_tolerance)

    def fulfilled(self, errors: Array) -> npt.NDArray[np.bool_]:
        """(N,) whether distances and angles (N, 2) are within the tolerances."""
        return np.asarray((errors[:, 0] <= self.bounds[0]) & (errors[:, 1] <= self.bounds[1]))

    @cached_property
    def counted(self) -> tuple[bool, bool]:
        """Whether the task selects any coordinates of the position, and of the orientation."""
        return bool(self.mask[:3].any()), bool(self.mask[3:].any())

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """The largest errors (m, rad) of a solution; infinite if the task selects no position or no orientation."""
        tolerances = self.position_tolerance, self.orientation_tolerance
        position, orientation = (
            tolerance if counts else math.inf for tolerance, counts in zip(tolerances, self.counted, strict=True)
        )
        return position, orientation


def make_task(task: TaskLike, position_tolerance: float, orientation_tolerance: float) -> Task:
    """Make a task from its name or coordinates, with tolerances in m and rad.

    Raises
    ------
    UnknownNameError
        If the name is unknown.
    InputError
        If the task is not six booleans, or selects no coordinate.
    """
    if not isinstance(task, (str, IkTask)):
        try:
            coordinates = list(task)
        except TypeError:
            coordinates = []
        if len(coordinates) != len(COORDINATES):
            raise InputError(
                f"task must be a name, an IkTask or six booleans for {', '.join(COORDINATES)}, not {task!r}"
            )
        task = IkTask(*coordinates)
    return _made(task, position_tolerance, orientation_tolerance)


@lru_cache(maxsize=64)
def _made(task: str | IkTask, position_tolerance: float, orientation_tolerance: float) -> Task:
    if isinstance(task, str):
        if task not in TASKS:
            raise UnknownNameError("task", task, get_args(TaskName))
        task = TASKS[task]
    flags = np.array([getattr(task, name) for name in COORDINATES], dtype=float)
    return Task(flags, position_tolerance, orientation_tolerance)


def rotation_vector(r: Array) -> Array:
    """The rotation vector (3,), axis times angle from 0 to pi, of a rotation (3, 3).

    The angle is computed from sine and cosine together, which is accurate to rounding both for small angles and near
    pi; the arccosine of the trace alone is inaccurate below 1e-8. Near pi the axis is computed from R + R^T.
    """
    # the axis times twice the sine of the angle
    twice = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine, cosine = float(np.linalg.norm(twice)) / 2, (float(np.trace(r)) - 1) / 2
    angle = np.arctan2(sine, cosine)
    if cosine >= -0.99:
        return np.asarray(twice / 2 * (angle / sine if sine > 1e-6 else 1.0))
    # the largest diagonal entry of R + R^T belongs to the largest component of the axis
    column = int(np.diag(r).argmax())
    axis = r[:, column] + r[column] - 2 * cosine * np.eye(3)[column]
    axis *= angle / np.linalg.norm(axis)
    return np.asarray(-axis if axis @ twice < 0 else axis)


def left_jacobian_inverse(v: Array) -> Array:
    """The inverse (3, 3) of the left Jacobian of SO(3) at a rotation vector (3,) shorter than 2 pi."""
    square = float(v @ v)
    angle = np.sqrt(square)
    c = 1 / 12 if angle < 1e-3 else (1 - 0.5 * angle / np.tan(0.5 * angle)) / square
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray(np.eye(3) - 0.5 * cross + c * (cross @ cross))


GoalName = Literal["centre", "near", "manipulability"]

FINITE_STEP = 1e-5
"""Rad or m, for central differences of the manipulability."""

TINY = 1e-14
"""Added to the squares of the singular values, so that the logarithm is finite at singularities."""

LONGEST_GOAL_STEP = 0.2
"""Rad or m: the largest motion of a joint for a goal in one step, so that the task remains nearly satisfied."""


@dataclass(frozen=True)
class IkGoal:
    """A null-space objective, for redundant arms and for tasks with free coordinates.

    The solution is moved in the null space of the task until the objective does not improve any more.

    Parameters
    ----------
    kind
        ``"centre"``: move the joints to the middle of their limits, weighted by their ranges. ``"near"``: move them
        towards q0. ``"manipulability"``: maximise the logarithm of sqrt(det(J J^T)) (Yoshikawa 1985).
    gain
        For ``"centre"`` and ``"near"``, the fraction of the remaining distance that each step covers (default 1); for
        ``"manipulability"``, the length of a step (rad or m) per unit of the gradient (default 0.2).

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
        require_positive("gain", self.gain)  # type: ignore[arg-type]  # set above


@dataclass(frozen=True, eq=False)
class Goal:
    """An :class:`IkGoal` for an arm: the posture (n,) that it moves to, and the weight (n,) of each joint."""

    kind: Literal["posture", "near", "manipulability"]
    gain: float
    posture: Array
    weight: Array

    @cached_property
    def compiled(self) -> CompiledGoal:
        """The goal for the compiled core."""
        return CompiledGoal(self.kind, self.gain, self.posture, self.weight)

    def step(self, arm: Arm, q: Array) -> Array:
        """The step (n,) at q before its projection into the null space; equal to that of :attr:`compiled`."""
        if self.kind == "manipulability":
            shifts = FINITE_STEP * np.eye(arm.dof)
            rises = [_log_manipulability(arm, q + shift) - _log_manipulability(arm, q - shift) for shift in shifts]
            step = self.gain * np.array(rises) / (2 * FINITE_STEP)
        else:
            step = self.gain * self.weight * (self.posture - q)
        largest = float(np.abs(step).max())
        return np.asarray(step * (LONGEST_GOAL_STEP / largest) if largest > LONGEST_GOAL_STEP else step)


def make_goal(goal: IkGoal | GoalName | None, arm: Arm, q0: Array) -> Goal | None:
    """Make the goal of an arm and a start q0 (n,)."""
    if goal is None:
        return None
    if not isinstance(goal, IkGoal):
        goal = IkGoal(goal)
    gain = 1.0 if goal.gain is None else goal.gain
    if goal.kind != "centre":
        return Goal(goal.kind, gain, q0, np.ones(arm.dof))
    # long ranges weigh less, and joints without limits nothing
    lower, upper = arm.limits.sampling_range()
    share = (upper - lower).min() / np.maximum(upper - lower, 1e-9)
    weight = np.where(np.isfinite(arm.limits.upper - arm.limits.lower), share**2, 0.0)
    return Goal("posture", gain, (lower + upper) / 2, weight)


def _log_manipulability(arm: Arm, q: Array) -> float:
    jacobian = arm.local_jacobian(q)[1]
    square = jacobian.T @ jacobian if arm.dof < 6 else jacobian @ jacobian.T
    return 0.5 * float(np.linalg.slogdet(square + TINY * np.eye(len(square)))[1])
