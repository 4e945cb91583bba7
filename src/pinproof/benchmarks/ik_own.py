"""The methods of this package, as the table of inverse kinematics asks them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.ik_methods import RESTARTS, TOLERANCE, Asked, IkMethod, Solvers
from pinproof.benchmarks.ik_problems import PERIOD
from pinproof.ik import AnalyticIk, Clik, DampedLeastSquares, Fabrik, IterativeIk, PseudoInverse, Tracker, track
from pinproof.ik.task import GoalName
from pinproof.model import Arm

__all__ = ["OWN"]

Array = npt.NDArray[np.float64]

ROUGH = 1e-4
"""In m and rad: the same for FABRIK without a polish, which closes in steadily and not quadratically."""


def _iterative(solver: Callable[..., IterativeIk], arm: Arm, asked: Asked) -> Solvers:
    ik = solver(restarts=RESTARTS if asked.restarts else 0)

    def many(targets: Array, q0: Array) -> Array:
        batch = ik.solve_batch(arm, targets, q0, task=asked.task)
        return np.where(batch.ok[:, None], batch.q, np.nan)[:, None]

    return Solvers(
        one=lambda target, q0: ik.solve(arm, target, q0, task=asked.task),
        read=lambda result: result.q[None] if result.ok else np.empty((0, arm.dof)),
        many=many if asked.problem == "random" else None,  # a batch starts all targets at one place
    )


def _analytic(arm: Arm, asked: Asked) -> Solvers | None:
    """All branches of up to six joints; of seven, and along the trajectory, the one nearest to where the arm is."""
    if asked.task != "pose":
        return None
    ik = AnalyticIk()
    ik.solve_all(arm, arm.forward_kinematics(arm.home))  # refuses an arm that has no closed form
    if arm.dof > 6 or asked.problem == "trajectory":
        return Solvers(
            one=lambda target, q0: ik.solve(arm, target, q0),
            read=lambda result: result.q[None] if result.ok else np.empty((0, arm.dof)),
        )
    return Solvers(
        one=lambda target, _: ik.solve_all(arm, target).branches,  # a closed form needs no start
        read=lambda branches: branches,
        target=np.ascontiguousarray,
        many=lambda targets, q0: ik.solve_all_batch(arm, targets, q0).q,
    )


def _tracking(arm: Arm, asked: Asked) -> Solvers | None:
    """Tick by tick, and the whole sequence in one call; a sample that slipped is no answer.

    A redundant arm is told to keep its joints centred: where it drifts to its limits, it slips later on.
    """
    if asked.problem != "trajectory":
        return None
    goal: GoalName | None = "centre" if arm.dof > 6 else None
    trackers: list[Tracker] = []

    def begin(start: Array) -> None:
        trackers[:] = [Tracker(arm, PERIOD, start, task=asked.task, goal=goal)]

    def many(poses: Array, start: Array) -> Array:
        followed = track(arm, poses, start, dt=PERIOD, task=asked.task, goal=goal)
        return np.where(followed.reached[:, None], followed.q, np.nan)[:, None]

    return Solvers(
        one=lambda target, _: trackers[0].step(target),
        read=lambda q: q[None] if trackers[0].ok else np.empty((0, arm.dof)),
        many=many,
        begin=begin,
    )


OWN: tuple[IkMethod, ...] = (
    IkMethod("pseudo_inverse", "pseudo-inverse", partial(_iterative, PseudoInverse), textbook=(1.20, 0.85)),
    IkMethod(
        "damped_least_squares", "damped least squares", partial(_iterative, DampedLeastSquares), textbook=(1.45, 0.95)
    ),
    IkMethod("clik", "CLIK", partial(_iterative, Clik)),
    IkMethod("fabrik", "FABRIK", partial(_iterative, Fabrik), tolerance=ROUGH, textbook=(0.40, 0.98)),
    IkMethod(
        "fabrik_polished",
        "FABRIK, polished",
        partial(
            _iterative, partial(Fabrik, polish=True, position_tolerance=TOLERANCE, orientation_tolerance=TOLERANCE)
        ),
    ),
    IkMethod("analytic", "analytic", _analytic, textbook=(0.002, 1.0)),
    IkMethod("tracking", "tracking", _tracking),
)
"""The methods of this package. The textbook's cells: position only, one seed, 10,000 points."""
