"""An arm with its solvers for the core as WebAssembly, by which pages compute."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

from pinproof._core import CellArm
from pinproof.errors import NoClosedForm
from pinproof.ik.analytic_ik import AnalyticIk
from pinproof.ik.jacobian_methods import Clik
from pinproof.ik.loop import seeds_of
from pinproof.model import Arm


def web_arm(arm: Arm, base: int, joints: Sequence[int]) -> CellArm:
    """Return an arm with :class:`Clik` for poses, and its closed form if it has one, both with their default settings.

    Parameters
    ----------
    arm
        The arm.
    base
        The number of its base among the frames of the cell.
    joints
        The indices of its joints in the configuration of the cell.
    """
    clik, plan = Clik(), None
    solver = clik._compiled(arm, clik._task(arm, "pose"), None)
    with suppress(NoClosedForm):
        plan = AnalyticIk()._plan(arm).core.plan
    seeds, attempts = seeds_of(arm, 0).q, clik.restarts + 1
    return CellArm(solver, seeds, plan, attempts=attempts, base=base, joints=list(joints))  # type: ignore[arg-type]
