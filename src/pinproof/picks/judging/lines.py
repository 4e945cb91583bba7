"""The approach and retreat stages, which are straight lines, and the transit stage from home to the approach."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify, proven_millimetres
from pinproof.common.steps import step
from pinproof.model import Arm
from pinproof.motion import CubicPath, Curve, JointPath, TorqueLimits
from pinproof.picks.judging.grasp import GraspCandidate
from pinproof.picks.judging.hand import OpenHand
from pinproof.picks.judging.task import PickTask, torque_limits
from pinproof.picks.judging.verdict import LINES, Stage, StageResult
from pinproof.planning import LinearStatus, PlanResult, RouteFollower, plan_linear, planner_of, shortcut, with_turns
from pinproof.spatial import SE3, Array

Pairs = tuple[tuple[str, str], ...]


@dataclass(frozen=True, eq=False)
class Attempt:
    """A configuration at the grasp with its approach and retreat, as far as they are possible.

    ``q`` (n,) is that of the candidate, perhaps with full rotations. Both lines start there. ``parting`` are the pairs
    of the object and its supports, ``fraction`` is the possible part of the line that failed, and ``clearance`` the
    smallest observed clearance (m) of both lines.
    """

    candidate: GraspCandidate
    q: Array
    stages: tuple[StageResult, ...] = ()
    approach: CubicPath | None = None
    retreat: CubicPath | None = None
    parting: Pairs = ()
    fraction: float = 0.0
    clearance: float = np.inf

    @property
    def passed(self) -> bool:
        """Whether every stage so far passed."""
        return self.stages[-1].ok

    @property
    def entrance(self) -> Array:
        """(n,) the end of the transit: the start of the approach, or the grasp without an approach."""
        return self.q if self.approach is None else self.approach.end

    @property
    def exit(self) -> Array:
        """(n,) the end of the retreat, or the grasp without a retreat."""
        return self.q if self.retreat is None else self.retreat.end

    @property
    def span(self) -> tuple[Array, Array]:
        """Bounds (n,) of every joint on both lines."""
        return span(self.q, self.approach, self.retreat)

    def turned(self, by: Array) -> Attempt:
        """The same with full rotations (n,) added to all configurations."""
        approach, retreat = shifted(self.approach, by), shifted(self.retreat, by)
        return replace(self, q=self.q + by, approach=approach, retreat=retreat)


def shifted(path: CubicPath | None, by: Array) -> CubicPath | None:
    """The path with an offset (n,) added to the joints."""
    if path is None or not by.any():
        return path
    return CubicPath(path.q + by, path.tangents, path.knots, path.joint_names)


class ToolLine(NamedTuple):
    """A straight line: the result of the stage, the curve, the possible fraction, and the observed clearance (m)."""

    result: StageResult
    path: CubicPath | None = None
    fraction: float = 1.0
    clearance: float = np.inf


def control_points(dof: int, *curves: Curve | None) -> Iterator[Array]:
    """(k, n) the Bezier control points of each curve that is not None."""
    return (curve.bezier()[1].reshape(-1, dof) for curve in curves if curve is not None)


def span(q: Array, *paths: CubicPath | None) -> tuple[Array, Array]:
    """Bounds (n,) of every joint on the paths and at q (n,), from the Bezier control points."""
    points = np.vstack([q, *control_points(len(q), *paths)])
    return points.min(axis=0), points.max(axis=0)


@step(LINES)
def along(task: PickTask, candidate: GraspCandidate, best: tuple[int, float] = (1, 0.0)) -> Attempt:
    """The approach and the retreat of a configuration.

    ``best`` is the number of lines that were tried of the best attempt so far, and the possible fraction of the last.
    Of lines that do not get farther, the reason is not wanted.
    """
    lines, fraction = best if task.cell.trial is None else (2, 1.0)
    # In a trial for a failed retreat, an approach is only needed if the retreat is possible
    first = line_out(task, candidate, fraction) if task.cell.trial is Stage.RETREAT else None
    if first is not None and not first[0].result.ok:
        return Attempt(candidate, candidate.q, (first[0].result,), fraction=first[0].fraction)
    into = line_in(task, candidate, fraction if lines == 1 else 1.0)
    if not into.result.ok:
        return Attempt(candidate, candidate.q, (into.result,), fraction=into.fraction)
    out, parting = first or line_out(task, candidate, fraction if lines == 2 else 0.0)
    stages, clearance = (into.result, out.result), min(into.clearance, out.clearance)
    return Attempt(candidate, candidate.q, stages, into.path, out.path, parting, out.fraction, clearance)


def may_approach(task: PickTask, candidates: Sequence[GraspCandidate]) -> npt.NDArray[np.bool_]:
    """Whether the straight approach of each candidate (k,) is possible without regard to contacts."""
    if not task.pick.approach or not candidates:
        return np.ones(len(candidates), dtype=bool)
    members = {each.member.words: each.member for each in candidates}
    ends = dict(
        zip(members, task.targets([task.pick.before(task.grasp(each)) for each in members.values()]), strict=True)
    )
    every = np.array([ends[each.member.words] for each in candidates])
    follower = RouteFollower(arm=task.arm, least=1.0)
    return np.isfinite(follower.ends_of_lines(np.array([each.q for each in candidates]), every)[:, 0])


def line_in(task: PickTask, candidate: GraspCandidate, least: float = 0.0) -> ToolLine:
    """The approach, planned from the grasp outwards, so that both lines share exactly the same configuration."""
    member, end = candidate.member, task.pick.before(task.grasp(candidate.member))
    around, hand = task.before(member, touching=True), task.passing(member)
    return line(Stage.APPROACH, task, around, candidate.q, end, task.pick.approach, hand=hand, least=least)


def line_out(task: PickTask, candidate: GraspCandidate, least: float = 0.0) -> tuple[ToolLine, Pairs]:
    """The retreat, and the pairs of the object and its supports."""
    member, q = candidate.member, candidate.q
    carrying = task.carrying(member)
    parting = task.supports(carrying, q, task.pick.support)
    end = task.pick.after(task.grasp(member))
    return line(Stage.RETREAT, task, carrying, q, end, task.pick.retreat, parting, least=least), parting


TOUCH_DEPTH = 1e-4
"""Largest penetration (m) of the object into an obstacle that is taken for contact: rounding of stated positions."""


def line(
    stage: Stage,
    task: PickTask,
    checker: CollisionChecker,
    q: Array,
    end: SE3,
    length: float,
    parting: Pairs = (),
    *,
    start: str = "the grasp",
    hand: OpenHand | None = None,
    least: float = 0.0,
) -> ToolLine:
    """A straight line from q (n,), at ``start`` in messages, to a pose of the tip.

    It fails if the open ``hand`` enters the object by more than is allowed. The reason of a failure is only complete if
    a share above ``least`` is possible.
    """
    if length == 0:
        return ToolLine(StageResult(stage, True, "none requested"))
    # A support that is not checked against the object needs no permission for contact
    parting = tuple(pair for pair in parting if checker.pairs_of_owners(*pair))
    # The line, and the reason if only a part of it is possible
    move = plan_linear(checker, q, task.target(end), parting=parting, least=least)
    if not move.ok:
        message = f"{length * 1e3:.0f} mm path, planned outwards from {start}, {move.message}"
        at_start = move.fraction == 0 and move.status in (LinearStatus.CONTACT, LinearStatus.UNDECIDED) and least < 1
        contacts = checker.allowing(*parting).check(q).contacts if at_start else ()
        # If the held object only touches obstacles at the start, a key of the picks file allows that
        touched = [name for contact in contacts for name in contact.bodies if name != task.name]
        only_touch = all(contact.distance >= -TOUCH_DEPTH and task.name in contact.bodies for contact in contacts)
        if touched and only_touch and all(name in checker.scene for name in touched):
            names = ", ".join(dict.fromkeys((*(name for _, name in parting), *touched)))
            there, key = ", ".join(dict.fromkeys(touched)), "place.support" if stage is Stage.PLACE else "support"
            message += f"; if {task.name} may touch {there} at the start of this line, state {key}: [{names}]"
        figures = {"distance": length, "possible": move.fraction * length}
        return ToolLine(StageResult(stage, False, message, figures), fraction=move.fraction)
    leaving = dict.fromkeys(parting.bodies for parting in move.certificate.partings)  # a mesh has one for each facet
    parted = "".join(f", {body} leaves {left}" for body, left in leaving)
    proven = f"{proven_millimetres(move.certificate.clearance)} clearance proven{parted}"
    message = f"{length * 1e3:.0f} mm straight line, {proven}"
    figures = {"distance": length, "clearance": move.certificate.clearance}
    if hand is not None and (failure := hand.prove(move.path, q)) is not None:
        depth = {} if np.isnan(failure.depth) else {"depth": failure.depth}
        return ToolLine(StageResult(stage, False, failure.reason, {**figures, **depth}), fraction=0.0)
    return ToolLine(StageResult(stage, True, message, figures), move.path, clearance=move.certificate.observed)


STRAIGHT = 2
"""Number of waypoints of a straight path, which cannot be shortened."""


class Crossing(NamedTuple):
    """A transit: the result of the stage, the attempt it leads to, the path, and its observed clearance (m)."""

    result: StageResult
    attempt: Attempt | None = None
    path: JointPath | None = None
    clearance: float = np.inf


@step(Stage.TRANSIT.value)
def transit(task: PickTask, attempts: list[Attempt], nodes: int, seeds: list[int]) -> Crossing:
    """A path from home to the entrance of one of the attempts."""
    # An object that the pick states itself is elsewhere for another grasp, so each grasp is planned on its own
    groups: dict[CollisionChecker, list[Attempt]] = {}
    for attempt in attempts:
        groups.setdefault(task.before(attempt.candidate.member), []).append(attempt)
    planner = planner_of(task.cell.budget.planner).limited_to(nodes)
    for checker, group in groups.items():
        goals = np.array([attempt.entrance for attempt in group])
        torques = torque_limits(task, group[0].candidate.member, "transit", task.outside.arm)
        plan = planner.plan(checker, task.cell.home, goals, torque_limits=torques, rng=seeds[0])
        if plan.ok:
            path, proof = shortened(task, plan, checker, seeds[1], torques)
            message = f"{path.length:.2f} rad, {len(path)} waypoints"
            figures = {"length": path.length, "waypoints": float(len(path)), "nodes": float(plan.nodes)}
            clearance = np.inf if proof is None else proof.observed
            return Crossing(StageResult(Stage.TRANSIT, True, message, figures), group[plan.goal], path, clearance)
    figures = {"nodes": float(plan.nodes), "goals": float(len(group))}
    return Crossing(StageResult(Stage.TRANSIT, False, f"from home: {plan.message}", figures))


def shortened(
    task: PickTask, plan: PlanResult, checker: CollisionChecker, seed: int, torques: TorqueLimits | None
) -> tuple[JointPath, Certificate | None]:
    """The shortened path of a successful plan, and its certificate; None in a trial, whose motions have no scores."""
    straight, path = len(plan.path) <= STRAIGHT, plan.path
    if not straight:
        path = shortcut(path, checker, rng=seed, torque_limits=torques)
    if task.cell.trial is not None:
        return path, None
    return path, plan.certificate if straight else certify(path, checker)


def full_rotations(arm: Arm, home: Array, attempt: Attempt) -> Array:
    """(k, n) full rotations (rad) that can be added to an attempt within the limits; zero is the first."""
    entrances, _ = with_turns(arm, home, attempt.entrance[None])
    shifts = entrances - attempt.entrance
    inside = arm.limits.inside(np.array(attempt.span)[:, None] + shifts).all(axis=0)
    return np.asarray(shifts[inside | (np.arange(len(shifts)) == 0)])
