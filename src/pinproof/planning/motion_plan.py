"""From a start and goals to a certified motion: a path is found, shortened and rounded, timed, and made shorter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, PathConstraint
from pinproof.common.results import Answer, View
from pinproof.errors import PlanFailed
from pinproof.motion import RateConstraint, TorqueLimits, Trajectory
from pinproof.planning.optimisation import OptimiseResult, optimise
from pinproof.planning.plan_results import PlanResult
from pinproof.planning.planners import Planner, planner_of
from pinproof.planning.simplification import SimplifyResult, simplify


@dataclass(frozen=True, eq=False)
class MotionPlan(Answer):
    """A planned and certified motion, or the reason why none was found.

    Parameters
    ----------
    planned
        The path of the planner.
    simplified
        The shortened path; None without a path.
    optimised
        The timed and certified motion; None without a path.
    torque_limits
        The torque limits that were applied, if any.
    budget
        How many changes of the motion were tried.
    """

    failure = PlanFailed
    planned: PlanResult
    simplified: SimplifyResult | None = None
    optimised: OptimiseResult | None = None
    torque_limits: TorqueLimits | None = None
    budget: int = 0

    @property
    def ok(self) -> bool:
        """Whether a motion was found that is proven FREE."""
        return self.optimised is not None and self.optimised.certificate.free

    @property
    def checker(self) -> CollisionChecker:
        """The checker of the certificate: it has tighter bodies if an end was in collision only with coarse ones."""
        return self.planned.checker

    @property
    def trajectory(self) -> Trajectory:
        """The motion; reading it raises :class:`pinproof.errors.NoAnswer` if no path was found."""
        return self._motion().trajectory

    @property
    def certificate(self) -> Certificate:
        """The certificate of the motion; reading it raises :class:`pinproof.errors.NoAnswer` as for the motion."""
        return self._motion().certificate

    @property
    def message(self) -> str:
        """The length and the durations, or why no path was found."""
        if self.simplified is None or self.optimised is None:
            return self.planned.message
        stops, best = self.simplified.stops, self.optimised
        length = f"path of length {self.simplified.path.length:.3g} rad"
        text = f"{length}, {stops} intermediate stop{'' if stops == 1 else 's'}, {best.duration_before:.2f} s"
        text += f"; optimised motion {best.duration:.2f} s" if self.budget else ""
        return f"{text}, lower bound without obstacles {best.lower_bound:.2f} s ({best.trajectory.limits_note})"

    def to_dict(self) -> dict[str, Any]:
        """The figures, the torques and the certificate as plain values for JSON."""
        if self.simplified is None or self.optimised is None:
            return {"ok": False, "status": self.planned.status.name, "message": self.message}
        figures = {
            "ok": self.ok,
            "stops": self.simplified.stops,
            "length": self.simplified.path.length,
            "duration_of_path": self.optimised.duration_before,
            "duration": self.optimised.duration,
            "lower_bound": self.optimised.lower_bound,
        }
        torques = {} if self.torque_limits is None else self.torque_limits.report(self.trajectory)
        return {**figures, **torques, **self.certificate.to_dict()}

    def _view(self) -> View:
        if self.optimised is None:
            return View(self.message)
        torques = self.torque_limits
        largest = [] if torques is None else [f"largest torque: {torques.largest(self.trajectory)}"]
        notes = () if torques is None else torques.notes
        lines = [*largest, str(self.certificate), *(f"note: {note}" for note in notes)]
        return View(self.message, [largest, self.trajectory, self.certificate], lines)

    def _motion(self) -> OptimiseResult:
        if self.optimised is None:
            raise self.failure(self.message, self)
        return self.optimised


def plan(
    checker: CollisionChecker,
    start: npt.ArrayLike,
    goals: npt.ArrayLike,
    *,
    planner: Planner | str | None = None,
    blend: bool = True,
    jerk: float | Literal["limits"] | None = None,
    rate_limits: Sequence[RateConstraint] = (),
    constraints: Sequence[PathConstraint] = (),
    rng: int = 0,
    budget: int = 600,
) -> MotionPlan:
    """Plan, shorten, time and certify a motion between configurations.

    Parameters
    ----------
    checker
        The arm in its scene, with what it carries.
    start, goals
        (n,) and (n,) or (g, n) rad or m: the motion ends at one of the goals.
    planner
        Finds the path; by default :class:`pinproof.RrtConnect`.
    blend
        Whether corners are rounded; otherwise the arm stops at each.
    jerk, rate_limits, constraints
        What the motion must keep to beside the limits of the joints, as for :func:`pinproof.optimise`.
    rng
        The seed.
    budget
        How many changes of the motion are tried to reduce its duration. With 0, the shortened path is only timed.

    Raises
    ------
    InputError
        As :meth:`pinproof.RrtConnect.plan`, :func:`pinproof.simplify` and :func:`pinproof.optimise` do.
    """
    torques = next((limit for limit in rate_limits if isinstance(limit, TorqueLimits)), None)
    planned = planner_of(planner).plan(checker, start, goals, constraints=constraints, torque_limits=torques, rng=rng)
    if not planned.ok:
        return MotionPlan(planned)
    # An end that is in collision only with coarse bodies has made the planner use tighter ones.
    checker = planned.checker
    simplified = simplify(
        planned.path,
        checker,
        rng=rng,
        blend=blend,
        constraints=constraints,
        torque_limits=torques,
        certificate=planned.certificate,
    )
    optimised = optimise(
        simplified.path,
        checker,
        limits=checker.group.limits,
        jerk=jerk,
        rate_limits=rate_limits,
        constraints=constraints,
        rng=rng,
        budget=budget,
    )
    return MotionPlan(planned, simplified, optimised, torques, budget)
