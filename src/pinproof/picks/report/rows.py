"""A verdict as plain values: the row that JSON, CSV, campaigns and the page share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.collision import Certificate
from pinproof.picks.grip import GripResult
from pinproof.picks.pick import PickProblem
from pinproof.picks.verdict import PickMotion, PickVerdict, StageResult
from pinproof.spatial import xyz_rpy

__all__ = ["problem_row", "proofs", "verdict_row"]


def proofs(verdict: PickVerdict) -> tuple[Certificate, ...]:
    """The certificates of a verdict, one for each part of its motion; none unless good."""
    return tuple(motion.certificate for motion in verdict.motions)


def verdict_row(verdict: PickVerdict) -> dict[str, Any]:
    """A verdict as plain values for JSON; lengths in metres, angles in radians, times in seconds.

    A clearance of None beside ``pairs_proven`` is unbounded: nothing there can touch.
    """
    certificates, trajectory, pick = proofs(verdict), verdict.trajectory, verdict.pick
    placed = [float(value) + 0.0 for value in xyz_rpy(pick.pose)]  # + 0.0: no negative zeros
    left_out = dict.fromkeys((*pair.owners, pair.reason) for each in certificates for pair in each.excluded)
    return {
        "name": pick.name,
        "verdict": verdict.status.value,
        "failed_at": None if verdict.failed is None else verdict.failed.value,
        "reason": verdict.reason,
        "remedy": verdict.remedy,
        "frame": pick.frame,
        "xyz": placed[:3],
        "rpy": placed[3:],
        "member": verdict.member,
        "configurations_tried": verdict.configurations,
        "grip": None if verdict.grip is None else _grip(verdict.grip),
        "stages": [_stage(stage) for stage in verdict.stages],
        "refuted": list(verdict.refuted),
        "q_grasp": None if verdict.q_grasp is None else [float(value) for value in verdict.q_grasp],
        "grasp_time": verdict.grasp_time,
        "release_time": verdict.release_time,
        "duration": None if trajectory is None else trajectory.duration,
        "score": {name: _finite(float(value)) for name, value in verdict.score.items()},
        **_proven(certificates),
        "margin": min((each.margin for each in certificates), default=None),
        "motions": [_motion(motion) for motion in verdict.motions],
        "excluded_pairs": [list(each) for each in left_out],
    }


def problem_row(problem: PickProblem) -> dict[str, Any]:
    """A row of the file that could not be read."""
    row = {"name": problem.name, "verdict": "unreadable", "failed_at": "input", "reason": problem.reason}
    return {**row, "row": problem.row}


def _stage(result: StageResult) -> dict[str, Any]:
    figures = {name: _finite(float(value)) for name, value in result.figures.items()}
    return {"stage": result.stage.value, "ok": result.ok, "message": result.message, "figures": figures}


def _grip(grip: GripResult) -> dict[str, Any]:
    """How a part is held; lengths in metres, areas in square metres."""
    contacts = [
        {
            "finger": each.finger,
            "closing_direction": list(each.closing_direction),
            "contact_area": each.contact_area,
            "overlap": each.overlap,
            "gap": _finite(each.gap),
            "open_distance": each.open_distance,
            "closed_distance": each.closed_distance,
        }
        for each in grip.contacts
    ]
    return {"contacts": contacts, "tip_distance": grip.tip_distance}


def _motion(motion: PickMotion) -> dict[str, Any]:
    return {
        "name": motion.name,
        "duration": motion.trajectory.duration,
        **_proven((motion.certificate,)),
        "attached": [thing.name for thing in motion.attached],
        "backwards": motion.certificate.backwards,
        "partings": [str(parting) for parting in motion.certificate.partings],
    }


def _proven(certificates: tuple[Certificate, ...]) -> dict[str, Any]:
    """What certificates prove together."""
    return {
        "clearance_proven": _least([each.clearance for each in certificates]),
        "clearance_observed": _least([each.observed for each in certificates]),
        "pairs_proven": max((each.pairs for each in certificates), default=None),
    }


def _least(values: list[float]) -> float | None:
    return _finite(float(np.min(values))) if values else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
