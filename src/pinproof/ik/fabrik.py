"""FABRIK: forward and backward reaching inverse kinematics, for links that are rigid bodies with hinges."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from pinproof._core import ClikStep, FabrikStep
from pinproof.common.structs import key, struct
from pinproof.errors import InputError
from pinproof.ik.iterative import IterativeIk
from pinproof.ik.jacobian_methods import Clik
from pinproof.ik.loop import CompiledRule, DescentState, ObservingRule, Stall, StepRule
from pinproof.ik.result import TURN, stops
from pinproof.ik.task import GoalLike, Task
from pinproof.model import Arm
from pinproof.spatial import Array, inverse_matrix, matrix, rotation_about_line

WeightedEnds = Iterable[tuple[float, Array]]

HANDOVER = 1e-2
"""Norm of the residual (m and rad together) below which ``polish`` uses the steps of Clik: they converge
quadratically, FABRIK's passes linearly."""


@struct(kw_only=True)
class Fabrik(IterativeIk):
    """Forward and backward reaching inverse kinematics, without a Jacobian.

    A step is one pass over the links from the target to the base and one pass back. In the backward pass, the last link
    is placed on the target, and each previous link follows its hinge within the limits and stays as close as possible
    to its previous pose. In the forward pass, starting from the fixed base, each link moves as close as possible to its
    pose of the backward pass. Every step is therefore within the limits.

    The original FABRIK moves points, which does not apply to robot arms: the joint centres of a wrist coincide, and a
    hinge rotates about one axis only. Here, links are rigid bodies with a hinge at both ends, and every optimal angle
    has a closed form (``src/core/ik/fabrik_step.h``). Three further changes make it reliable:

    - The distance of a link from its desired pose is also measured at the end of the remaining arm. With hinges alone
      most arms converge very slowly.
    - Passes that preserve the shape of the arm alternate with passes that reach for the target.
    - An arm in deadlock (straight or at a limit) is bent, by an increasing amount.

    Convergence is linear, hence the larger default tolerances. Complete poses need more steps than positions. The
    supported tasks are a position, an orientation, both, and those with one free rotation. Goals and mimic joints are
    not supported.

    References
    ----------
    Aristidou, Lasenby (2011), "FABRIK: A fast, iterative solver for the inverse kinematics problem"; Aristidou,
    Chrysanthou, Lasenby (2016), "Extending FABRIK with model constraints": hinges, limits, and the bending of a chain
    in deadlock.
    """

    position_tolerance: float = 1e-4
    orientation_tolerance: float = 1e-4
    max_iterations: int = 300
    max_step: float = TURN
    polish: bool = key(
        "whether the last centimetre is solved by the steps of :class:`~pinproof.Clik`, which meet tolerances of 1e-6",
        default=False,
    )

    stall: ClassVar[Stall] = Stall(patience=100)

    def check(self, arm: Arm, task: Task, goal: GoalLike | None) -> None:
        """Reject tasks, goals and arms that the passes do not support."""
        positions, angles = int(task.mask[:3].sum()), int(task.mask[3:].sum())
        if positions not in (0, 3) or angles == 1:
            raise InputError(
                "Fabrik supports the tasks 'position', 'orientation', 'pose', 'spin_x', 'spin_y', 'spin_z' and an "
                "orientation with one free rotation; use pp.Clik for other tasks"
            )
        if goal is not None:
            raise InputError("Fabrik does not support goal=; use pp.Clik")
        if arm.chain.has_mimic_joints:
            raise InputError(
                f"Fabrik does not support mimic joints, and a joint between {arm.base!r} and {arm.tcp!r} is one; "
                "use pp.Clik"
            )

    def step_rule(self) -> StepRule:
        """The two passes, and the step of Clik below the handover residual."""
        return _Passes(Clik(max_step=self.max_step).step_rule(), HANDOVER if self.polish else 0.0)

    def compiled_rule(self) -> CompiledRule:
        """The compiled form of :meth:`step_rule`."""
        return FabrikStep(ClikStep(Clik.damping), HANDOVER**2 if self.polish else 0.0)


class _Passes:
    """The step rule of :class:`Fabrik`, equal to the compiled one, with (4, 4) matrices in the axes of the target."""

    def __init__(self, end: ObservingRule, handover: float) -> None:
        self._constants = FabrikStep
        self._end, self._handover = end, handover

    def observe(self, here: DescentState) -> None:
        """Compute the step by the two passes."""
        self._end.observe(here)
        self._step: Array | None = None
        if here.squared_residual <= self._handover**2:
            return
        # poses and hinges in the axes of the target
        chain, limits = here.arm.chain, here.arm.limits
        self._lower, self._upper = limits.lower, limits.upper
        self._low, self._high = stops(here.arm)
        joints = chain.joints
        self._links, self._prismatic = [*(joint.before for joint in joints), chain.tool], [j.prismatic for j in joints]
        self._start = matrix(here.target.inverse())
        self._position_weight, self._rotation_mask = here.task.mask[0], here.task.mask[3:]
        self._step = self._pass(here.q, here.iteration)
        deadlock = here.waited > 0 and here.waited % self._constants.WAIT == 0
        if deadlock or np.abs(self._step).max() <= self._constants.STILL:
            # bend every joint towards the middle of its range, or of the circle, the more the longer it has waited
            width = self._upper - self._lower
            share = self._constants.BEND * (1 + here.waited // self._constants.WAIT)
            bend = share * np.minimum(width, TURN)
            with np.errstate(invalid="ignore"):
                above = np.isfinite(width) & (here.q > 0.5 * (self._lower + self._upper))
            bent = np.clip(here.q + np.where(above, -bend, bend), self._low, self._high)
            self._step = np.asarray(bent - here.q)

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        """The step of the passes, or that of Clik below the handover residual."""
        return self._end(residual, jacobian) if self._step is None else self._step

    def _pass(self, q: Array, iteration: int) -> Array:
        known, n, angles = self._constants, len(q), int(self._rotation_mask.sum())
        # passes that preserve the shape alternate with passes that reach for the target
        weight, relax = known.REACH, known.RELAX_REACH
        if iteration % 2 == 0:
            weight, relax = known.HOLD if angles == 0 else known.HOLD_POSED, known.RELAX_HOLD
        # the origin and direction (2, 3) of each hinge, and the pose (4, 4) of the tcp
        end, hinges = self._start, list[Array]()
        for k, link in enumerate(self._links):
            end = end @ link
            if k < n:
                hinges.append(np.vstack([end[:3, 3], end[:3, 2]]))
                end = self._motion(k, hinges[k], q[k]) @ end
        # backwards: the last link on the target, and each link below as close as possible to where it was
        moved = [np.eye(4)] * n + [self._last(hinges[-1], end)]
        for k in range(n - 1, 0, -1):
            ends = [(weight, hinges[k - 1])] + [(known.BASE, hinges[0])] * (k > 1)
            by = self._best(k, hinges[k], inverse_matrix(moved[k + 1]), ends)
            # The link below moves opposite to the joint.
            moved[k] = moved[k + 1] @ self._motion(k, hinges[k], -self._allowed(k, q[k], -by))
        # forwards from the fixed base: each link as close as possible to where the pass back placed it
        forward, step = np.eye(4), np.zeros(n)
        for k in range(n):
            tcp = inverse_matrix(moved[k + 1])
            axes = {0: np.zeros((0, 3)), 2: np.eye(3)[self._rotation_mask == 0], 3: np.eye(3)}[angles] @ tcp[:3, :3].T
            ends = [(1.0, np.vstack([tcp[:3, 3], axes]))] + [(weight, hinges[k + 1]) for _ in range(k < n - 1)]
            by = self._allowed(k, q[k], self._best(k, hinges[k], inverse_matrix(forward) @ moved[k + 1], ends))
            forward = forward @ self._motion(k, hinges[k], by)
            step[k] = np.clip(q[k] + relax * by, self._low[k], self._high[k]) - q[k]
        return step

    def _last(self, hinge: Array, end: Array) -> Array:
        """The motion (4, 4) of the last link that brings the tcp to the target."""
        if self._rotation_mask.any():
            spin = np.eye(4)
            if not self._rotation_mask.all():
                axis = np.vstack([np.zeros(3), np.eye(3)[self._rotation_mask == 0]])
                back = inverse_matrix(end)
                brought = np.vstack([_at(back, hinge[0]), back[:3, :3] @ hinge[1]])
                spin = rotation_about_line(axis[0], axis[1], self._angle(axis, end, [(1.0, brought)]))
            return np.asarray(spin @ inverse_matrix(end))
        # a position only: rotate the last link so that it points from its hinge to the target
        before, after = hinge[0] - end[:3, 3], hinge[0]
        normal = np.cross(before, after)
        size = float(np.linalg.norm(normal))
        turn = np.eye(4)
        if size > self._constants.TINY:
            angle = self._constants.AIM * np.arctan2(size, before @ after)
            turn = rotation_about_line(np.zeros(3), normal / size, angle)
        turn[:3, 3] = -turn[:3, :3] @ end[:3, 3]
        return turn

    def _best(self, k: int, hinge: Array, wanted: Array, ends: WeightedEnds) -> float:
        """The motion of hinge k that is closest to the wanted motion (4, 4), measured at the ends."""
        if not self._prismatic[k]:
            return self._angle(hinge, wanted, ends)
        shares = [(w, self._position_weight * float(hinge[1] @ (_at(wanted, one[0]) - one[0]))) for w, one in ends]
        return sum(w * along for w, along in shares) / sum(w for w, _ in shares)

    def _angle(self, hinge: Array, wanted: Array, ends: WeightedEnds) -> float:
        """:meth:`_best` for a revolute joint. An end is a point and directions (1 + i, 3), with its weight."""
        origin, d = hinge
        c = s = 0.0
        for weight, one in ends:
            pairs = [(self._position_weight, one[0] - origin, _at(wanted, one[0]) - origin)]
            pairs += [(self._constants.HINGE_HALF_LENGTH**2, e, wanted[:3, :3] @ e) for e in one[1:]]
            for share, a, z in pairs:
                c += weight * share * (a @ z - (d @ a) * (d @ z))
                s += weight * share * float(d @ np.cross(a, z))
        return float(np.arctan2(s, c)) if c * c + s * s > self._constants.TINY**2 else 0.0

    def _allowed(self, k: int, value: float, change: float) -> float:
        """The change closest to this one (on the circle, for a revolute joint) that keeps joint k within its limits."""
        low, high = self._low[k] - value, self._high[k] - value
        if low <= change <= high:
            return change
        if self._prismatic[k]:
            return float(np.clip(change, low, high))
        around = change + TURN if change < low else change - TURN
        if low <= around <= high:
            return around
        return float(low if np.cos(change - low) >= np.cos(change - high) else high)

    def _motion(self, k: int, hinge: Array, by: float) -> Array:
        if not self._prismatic[k]:
            return rotation_about_line(hinge[0], hinge[1], by)
        slid = np.eye(4)
        slid[:3, 3] = by * hinge[1]
        return slid


def _at(pose: Array, point: Array) -> Array:
    return np.asarray(pose[:3, :3] @ point + pose[:3, 3])
