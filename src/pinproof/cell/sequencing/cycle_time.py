"""Cycle time: phases of every pick, utilisation, and what limits the slowest picks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinproof.cell.sequencing.sequence_result import PHASES, SequenceResult, SequenceStep
from pinproof.model import Arm
from pinproof.motion.limits import Bounds
from pinproof.motion.steering import rest_to_rest_times
from pinproof.picks import PickMotion

DETOUR = 1.1
"""A motion that takes this multiple of the slowest joint's shortest time is limited by its detour around obstacles."""

STRAIGHT = ("approach", "retreat", "place", "leave")
"""The motions along straight lines, which cannot be shorter than the line permits."""


@dataclass(frozen=True)
class PickTime:
    """The time of one pick.

    Parameters
    ----------
    name
        The name of the pick.
    start, duration
        Seconds from the start of the sequence, and of all phases.
    phases
        Seconds by phase: those of ``transit``, ``approach``, ``grip``, ``retreat``, ``transfer``, ``place``,
        ``release`` and ``leave`` that occur.
    shortest
        Lower bound (s) of the duration: of transit and transfer the time of the slowest joint without obstacles.
    limited_by
        What limits the longest motion: a joint, a detour around obstacles, or the speed of the tool.
    """

    name: str
    start: float
    duration: float
    phases: dict[str, float]
    shortest: float
    limited_by: str


@dataclass(frozen=True)
class CycleTime:
    """The cycle time of a sequence.

    Parameters
    ----------
    picks
        The times of the picks in order.
    closing
        Seconds of the motion to the end.
    duration
        Seconds of the cycle.
    """

    picks: tuple[PickTime, ...]
    closing: float
    duration: float

    @property
    def by_phase(self) -> dict[str, float]:
        """Seconds of all picks by phase, in the order of the phases; the closing motion counts as transit."""
        total = dict.fromkeys(PHASES, 0.0)
        total["transit"] += self.closing
        for pick in self.picks:
            for name, seconds in pick.phases.items():
                total[name] += seconds
        return {name: seconds for name, seconds in total.items() if seconds > 0.0}

    @property
    def utilisation(self) -> dict[str, float]:
        """The share of the cycle of each phase."""
        return {name: seconds / self.duration for name, seconds in self.by_phase.items()} if self.duration else {}

    @property
    def parts_per_minute(self) -> float:
        """Number of picks in a minute."""
        return 60.0 * len(self.picks) / self.duration if self.duration else float("nan")

    def slowest(self, count: int = 5) -> tuple[PickTime, ...]:
        """The picks with the longest durations, the slowest first."""
        return tuple(sorted(self.picks, key=lambda pick: -pick.duration)[:count])


def cycle_time(result: SequenceResult) -> CycleTime:
    """The cycle time of a sequence, pick by pick."""
    closing = 0.0 if result.closing is None else result.closing.trajectory.duration
    arm = result.setup.checker.arm
    return CycleTime(tuple(_pick_time(arm, step) for step in result.steps), closing, result.duration)


def _pick_time(arm: Arm, step: SequenceStep) -> PickTime:
    bounds = Bounds.of(arm.limits, arm.joint_names)
    phases: dict[str, float] = {}
    for phase in step.phases:
        phases[phase.name] = phases.get(phase.name, 0.0) + phase.duration
    shortest = phases.get("grip", 0.0) + phases.get("release", 0.0)
    reasons: list[tuple[float, str]] = []
    for motion in step.verdict.motions:
        least, reason = _limit(arm, motion, bounds, stated=motion.name in step.pick.speed)
        shortest += least
        reasons.append((motion.trajectory.duration, reason))
    return PickTime(step.pick.name, step.start, step.duration, phases, shortest, max(reasons)[1])


def _limit(arm: Arm, motion: PickMotion, bounds: Bounds, *, stated: bool) -> tuple[float, str]:
    """The shortest time (s) of a motion, and what limits it."""
    moved = motion.trajectory
    times = rest_to_rest_times(np.abs(moved.end - moved.start), bounds)
    least, slowest = float(times.max()), arm.joint_names[int(times.argmax())]
    if motion.torques and max(peak.share for peak in motion.torques) > 1 / DETOUR:
        worst = max(motion.torques, key=lambda peak: peak.share)
        return least, f"{motion.name}: torque of {worst.joint}"
    if motion.name in STRAIGHT:
        return moved.duration, f"{motion.name}: " + ("tool speed" if stated else f"{slowest} on the straight line")
    if moved.duration <= DETOUR * least:
        return least, f"{motion.name}: {slowest}"
    if stated:
        return least, f"{motion.name}: tool speed"
    return least, f"{motion.name}: detour of {moved.duration - least:.2f} s around obstacles"
