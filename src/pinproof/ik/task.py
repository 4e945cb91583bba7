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
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations
from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from pinproof._core import Goal as CompiledGoal
from pinproof._core import Task as CompiledTask
from pinproof.common.structs import described, key
from pinproof.common.validation import require_positive, require_type
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm
from pinproof.spatial import Array, finite, unit_vector

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


SHORT_ARM = 3e-5
"""rad: the orientation tolerance of arms with fewer than six joints, if none is stated. They reach few poses exactly,
and none of those that they should if the numbers of their description are rounded, such as 1.57079 for pi/2."""


def orientation_tolerance_of(arm: Arm, stated: float | None, usual: float) -> float:
    """The stated orientation tolerance (rad); without one the usual one, or :data:`SHORT_ARM` for such an arm."""
    require_type("arm", arm, Arm)
    if stated is not None:
        return stated
    return usual if arm.dof >= len(COORDINATES) else max(usual, SHORT_ARM)


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


GoalName = Literal["centre", "near", "manipulability"]

TINY = 1e-14
"""Added to the squares of the singular values, so that the logarithm is finite at singularities."""

NULL_SHARE = 1e-9
"""A singular value of a Jacobian up to this share of the largest one is zero: rounding errors only."""

LONGEST_GOAL_STEP = 0.2
"""Rad or m: the largest motion of a joint for a goal in one step, so that the task remains nearly satisfied."""


@described()
class IkGoal:
    """A null-space objective, for redundant arms and for tasks with free coordinates.

    The solution is moved in the null space of the task until the objective does not improve any more.

    References
    ----------
    Liegeois (1977), "Automatic supervisory control of the configuration and behavior of multibody mechanisms": the
    gradient of the goal projected into the null space of the Jacobian.
    """

    kind: GoalName = key(
        '``"centre"``: move the joints to the middle of their limits, weighted by their ranges. ``"near"``: move them '
        'towards q0. ``"manipulability"``: maximise the logarithm of sqrt(det(J J^T)) (Yoshikawa 1985)'
    )
    gain: float | None = key(
        'for ``"centre"`` and ``"near"``, the fraction of the remaining distance that each step covers (default 1); '
        'for ``"manipulability"``, the length of a step (rad or m) per unit of the gradient (default 0.2)',
        default=None,
    )

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

    def step(self, arm: Arm, q: Array, jacobian: Array) -> Array:  # noqa: ARG002 - it is projected by the rule
        """The step (n,) at q before its projection into the null space."""
        return self.compiled.step(arm.chain, q)


Cost: TypeAlias = Callable[[Array], float]
"""An objective: a number for a configuration (n,), which is made small; twice differentiable where it is used."""

GoalLike: TypeAlias = "GoalName | IkGoal | Cost | Sequence[tuple[float, Cost]]"
"""What ``goal=`` accepts: a name, an :class:`IkGoal`, a cost, or weighted costs of which the sum is made small."""

COST_STEP = 1e-4
"""Rad or m, for central differences of costs: errors of about 1e-8 of a cost in slopes and in curvatures."""

FLATTEST = 1e-6
"""Smallest curvature, relative to the largest, that a step for a cost assumes."""

MOST_HALVINGS = 8
"""Number of times by which a step is halved that would increase a cost."""


def null_space(rows: Array) -> Array:
    """Return an orthonormal basis (n, k) of the motions that do not change what has the derivatives ``rows`` (m, n)."""
    values, right = np.linalg.svd(rows)[1:]
    rank = int((values > NULL_SHARE * max(float(values[0]), NULL_SHARE)).sum())
    return np.asarray(right[rank:].T)


@dataclass(frozen=True, eq=False)
class CostGoal:
    """The sum of weighted costs, which Newton's method makes small in the null space of the task."""

    costs: tuple[tuple[float, Cost], ...]

    @property
    def compiled(self) -> CompiledGoal:
        """Refused, because the compiled core cannot call Python."""
        raise InputError("a cost as goal= needs the loop on Pinocchio; use engine='auto', and solve in place of track")

    def cost(self, q: Array) -> float:
        """The sum at a configuration (n,); InputError if a cost returns no finite number."""
        total = 0.0
        for weight, cost in self.costs:
            value = cost(q.copy())
            if np.ndim(value) or not np.isfinite(value):
                raise InputError(f"a cost of goal= must return a finite number, not {value!r:.80} at q = {q.tolist()}")
            total += weight * float(value)
        return total

    def step(self, arm: Arm, q: Array, jacobian: Array) -> Array:
        """The step (n,) at q, along which the task with this Jacobian (6, n) does not change to first order.

        Slopes and curvatures along a basis of the null space are central differences.
        """
        basis, now = null_space(jacobian), self.cost(q)
        k = basis.shape[1]
        if k == 0:
            return np.zeros(arm.dof)
        shifts = COST_STEP * basis.T
        ahead, behind = (np.array([self.cost(q + sign * shift) for shift in shifts]) for sign in (1.0, -1.0))
        slope, curvature = (ahead - behind) / (2 * COST_STEP), np.diag(ahead + behind - 2 * now)
        for i, j in combinations(range(k), 2):
            both = self.cost(q + shifts[i] + shifts[j]) + self.cost(q - shifts[i] - shifts[j])
            curvature[i, j] = curvature[j, i] = (both - ahead[i] - ahead[j] - behind[i] - behind[j] + 2 * now) / 2
        # Newton's step, with the curvatures made positive so that it leads downwards.
        values, axes = np.linalg.eigh(curvature / COST_STEP**2)
        values = np.maximum(np.abs(values), max(FLATTEST * float(np.abs(values).max()), TINY))
        step = -basis @ (axes @ ((axes.T @ slope) / values))
        step *= min(1.0, LONGEST_GOAL_STEP / max(float(np.abs(step).max()), TINY))
        for _ in range(MOST_HALVINGS):
            if self.cost(q + step) < now:
                return np.asarray(step)
            step = step / 2
        return np.zeros(arm.dof)


def posture(q: npt.ArrayLike, weights: npt.ArrayLike = 1.0) -> Cost:
    """Return half the squared distance from a configuration (n,), with a weight for all joints or for each (n,).

    With the start of a motion as ``q``, it is the damping of a controller: the joints move as little as possible.
    """
    wanted, scale = np.array(q, dtype=float), np.array(weights, dtype=float)
    return lambda at: 0.5 * float((scale * (at - wanted) ** 2).sum())


def look_at(arm: Arm, point: npt.ArrayLike, axis_in_tcp: npt.ArrayLike = (0.0, 0.0, 1.0)) -> Cost:
    """Return 1 - cos of the angle between an axis of the tcp and the direction from the tcp to a point (m) of the base.

    For tasks that leave the orientation free; the same condition over a whole motion is
    :class:`~pinproof.collision.LookAt`.
    """
    target, axis = finite("point", point, (3,)), np.array(unit_vector("axis_in_tcp", axis_in_tcp))

    def cost(q: Array) -> float:
        local = arm.forward_kinematics(q).actInv(target)
        return 1.0 - float(axis @ local) / max(float(np.linalg.norm(local)), TINY)

    return cost


def make_goal(goal: GoalLike | None, arm: Arm, q0: Array) -> Goal | CostGoal | None:
    """Make the goal of an arm and a start q0 (n,)."""
    if goal is None:
        return None
    if callable(goal):
        return CostGoal(((1.0, goal),))
    if isinstance(goal, (list, tuple)):
        if not goal or not all(isinstance(pair, tuple) and len(pair) == 2 and callable(pair[1]) for pair in goal):
            raise InputError(f"goal must be pairs of a weight and a function of q, not {goal!r:.80}")
        for weight, _ in goal:
            require_positive("a weight of goal", weight, zero=True)
        return CostGoal(tuple(goal))
    if not isinstance(goal, IkGoal):
        goal = IkGoal(goal)  # type: ignore[arg-type]  # refused there if it is no name
    gain = 1.0 if goal.gain is None else goal.gain
    if goal.kind != "centre":
        return Goal(goal.kind, gain, q0, np.ones(arm.dof))
    # long ranges weigh less, and joints without limits nothing
    lower, upper = arm.limits.sampling_range()
    share = (upper - lower).min() / np.maximum(upper - lower, 1e-9)
    weight = np.where(np.isfinite(arm.limits.upper - arm.limits.lower), share**2, 0.0)
    return Goal("posture", gain, (lower + upper) / 2, weight)
