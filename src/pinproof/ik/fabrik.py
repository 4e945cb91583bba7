"""FABRIK: forward and backward reaching inverse kinematics, for links that are rigid bodies with hinges."""

from __future__ import annotations

from typing import ClassVar

from pinproof._core import ClikStep, FabrikStep
from pinproof.common.structs import key, struct
from pinproof.errors import InputError
from pinproof.ik.iterative import IterativeIk
from pinproof.ik.jacobian_methods import Clik
from pinproof.ik.loop import CompiledRule, DescentState, ObservingRule, Stall, StepRule
from pinproof.ik.result import TURN, joint_ranges
from pinproof.ik.task import GoalLike, Task
from pinproof.model import Arm
from pinproof.spatial import Array, matrix

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
    """The step rule of :class:`Fabrik`: the two passes, and the step of Clik below the handover residual."""

    def __init__(self, end: ObservingRule, handover: float) -> None:
        self._end, self._handover = end, handover

    def observe(self, here: DescentState) -> None:
        """Compute the step by the two passes, which do not use the Jacobian."""
        self._end.observe(here)
        arm = here.arm
        self._step: Array | None = None
        if here.squared_residual > self._handover**2:
            settings = arm.chain, joint_ranges(arm), here.task.compiled, matrix(here.target.inverse())
            self._step = FabrikStep.passes(*settings, here.q, here.iteration, here.waited)

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        """The step of the passes, or that of Clik."""
        return self._end(residual, jacobian) if self._step is None else self._step
