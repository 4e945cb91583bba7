"""Torque and tool limits of the parts of a pick's motion."""

from __future__ import annotations

from collections.abc import Sequence

from pinproof.collision import CollisionChecker
from pinproof.errors import InputError
from pinproof.model import Arm, Payload
from pinproof.motion import RateConstraint, TorqueLimits, TorquePeak, Trajectory
from pinproof.picks.input.pick import Member, Pick
from pinproof.picks.input.picks import Picks
from pinproof.picks.judging.task import PickTask
from pinproof.spatial import Array

CARRYING = ("retreat", "transfer", "place")
"""The parts of the motion with the object in the hand."""


def limits_torque(shared: Picks, pick: Pick | None = None) -> bool:
    """Whether the torque limits apply: a payload is stated, or the picks demand it."""
    return shared.torque_limits or bool(shared.payload) or (pick is not None and pick.payload is not None)


def torque_limits_of_tool(arm: Arm, shared: Picks) -> TorqueLimits | None:
    """The torque limits with the empty tool; None if torque is not limited.

    Raises
    ------
    InputError
        If the arm has no torque limits or no masses, or a payload is fixed to a link that the arm does not move.
    """
    try:
        return TorqueLimits(arm, shared.payload) if limits_torque(shared) else None
    except InputError as error:
        raise InputError(f"the picks limit torques: {error}") from error


def carries(task: PickTask, member: Member, part: str) -> tuple[Payload, ...]:
    """The payloads during a part of the motion, the object in the frame of the tcp."""
    shared, payload = task.cell.shared.payload, task.pick.payload
    if payload is None or part not in CARRYING:
        return shared
    return (*shared, payload.placed(task.holding(member).pose))


def torque_limits(task: PickTask, member: Member, part: str, arm: Arm) -> TorqueLimits | None:
    """The limits of torque during a part of the motion; None if torque is not limited."""
    return TorqueLimits(arm, carries(task, member, part)) if limits_torque(task.cell.shared, task.pick) else None


def rate_limits(task: PickTask, member: Member, part: str, checker: CollisionChecker) -> list[RateConstraint]:
    """The limits of torque and of the tool during a part of the motion, beside those of the joints."""
    torques = torque_limits(task, member, part, checker.arm)
    constraints: list[RateConstraint] = [] if torques is None else [torques]
    if (speed := task.pick.speed.get(part)) is not None:
        constraints.append(speed.limits(checker.arm))
    return constraints


def at_rest(task: PickTask, members: Sequence[Member], q: Array) -> list[str]:
    """Why the arm cannot hold the object at rest at each configuration of the grasp (k, n); empty texts if it can."""
    if not limits_torque(task.cell.shared, task.pick):
        return [""] * len(q)
    limits: dict[str, TorqueLimits] = {}
    reasons = []
    for member, each in zip(members, q, strict=True):
        if member.words not in limits:
            limits[member.words] = TorqueLimits(task.arm, carries(task, member, "retreat"))
        reasons.append(limits[member.words].standstill(each))
    return reasons


def peaks_of(constraints: list[RateConstraint], trajectory: Trajectory) -> tuple[TorquePeak, ...]:
    """The largest torques of a trajectory; empty if torque is not limited."""
    return next((each.peaks(trajectory) for each in constraints if isinstance(each, TorqueLimits)), ())
