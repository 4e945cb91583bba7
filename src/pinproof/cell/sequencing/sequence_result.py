"""The result of :func:`pinproof.sequence`: the steps with their motions, the total time and what limits it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pinproof.cell.sequencing.precedence import Precedence
from pinproof.collision import Certificate, Scene
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import TEXT, key, struct
from pinproof.errors import NoAnswer
from pinproof.model import Arm, guess_mark
from pinproof.motion import Bounds, MotionProgram, rest_to_rest_times
from pinproof.picks import Pick, PickMotion, PickSetup, PickVerdict

PHASES = ("transit", "approach", "grip", "retreat", "transfer", "place", "release", "leave")
"""The phases of a step in order: motions, and the dwell times grip and release."""


@struct("left_out", more=True, written=True)
class LeftOut:
    """A pick that is not part of the sequence."""

    name: str = key("name of the pick", kind=TEXT)
    reason: str = key("why it cannot be executed", kind=TEXT)


@dataclass(frozen=True)
class SequencePhase:
    """A part of the cycle: a motion with its certificate, or a dwell time, with its start and its duration (s)."""

    name: str
    start: float
    duration: float
    certificate: Certificate | None


@dataclass(frozen=True, eq=False)
class SequenceStep:
    """One pick of the sequence.

    Parameters
    ----------
    pick
        The pick as given.
    verdict
        The verdict with the certified motions; its pick has its poses in the root frame. The first motion is the
        transit from the end of the step before.
    scene
        The scene before the step. The motions have their own scenes.
    start
        Seconds from the start of the sequence.
    grip_dwell, release_dwell
        Seconds at the grasp and at the release.
    """

    pick: Pick
    verdict: PickVerdict
    scene: Scene
    start: float
    grip_dwell: float = 0.0
    release_dwell: float = 0.0

    @cached_property
    def phases(self) -> tuple[SequencePhase, ...]:
        """The motions and dwell times in order."""
        phases: list[SequencePhase] = []
        now = self.start
        motions = self.verdict.motions
        grip_after = max(k for k, motion in enumerate(motions) if motion.name in ("transit", "approach"))
        released = [k for k, motion in enumerate(motions) if motion.name in ("transfer", "place")]
        for k, motion in enumerate(motions):
            parts = [SequencePhase(motion.name, now, motion.trajectory.duration, motion.certificate)]
            if k == grip_after:
                parts.append(SequencePhase("grip", 0.0, self.grip_dwell, None))
            if released and k == released[-1]:
                parts.append(SequencePhase("release", 0.0, self.release_dwell, None))
            for phase in parts:
                if phase.certificate is not None or phase.duration > 0.0:
                    phases.append(replace(phase, start=now))
                    now += phase.duration
        return tuple(phases)

    @property
    def end(self) -> float:
        """Seconds from the start of the sequence to the end of the step."""
        return self.phases[-1].start + self.phases[-1].duration

    @property
    def duration(self) -> float:
        """Seconds of the step with its transit and dwell times."""
        return self.end - self.start

    def program(self) -> MotionProgram:
        """The step as a program for a robot controller, with the events grip and release."""
        arm = self.verdict
        return arm.program(grip_dwell=self.grip_dwell, release_dwell=self.release_dwell)


@dataclass(frozen=True, eq=False)
class SequenceResult(Shown):
    """A sequence of picks with certified motions.

    Parameters
    ----------
    setup
        The cell before the sequence.
    steps
        The picks in order.
    closing
        The motion to the end; None if the end is free.
    left_out
        The picks that cannot be executed.
    precedence
        The pairs of picks in a fixed order, stated or demanded by geometry.
    lower_bound
        Seconds without dwell times: no sequence of these picks with the grasps and IK branches considered takes less,
        for motions that rest between their parts.
    file_order, nearest_neighbour
        Lower bounds (s), without dwell times, of the sequence in the given order (changed where it violates the
        precedence) and in the order of the nearest neighbour, each with its best grasps and IK branches.
    wanted
        Number of picks that can be executed.
    interrupted
        Whether the search was interrupted.
    """

    setup: PickSetup
    steps: tuple[SequenceStep, ...]
    closing: PickMotion | None
    left_out: tuple[LeftOut, ...]
    precedence: Precedence
    lower_bound: float
    file_order: float
    nearest_neighbour: float
    wanted: int
    interrupted: bool = False

    def _view(self) -> View:
        rows: list[tuple[object, ...]] = []
        for step in self.steps:
            phases = ", ".join(f"{phase.name} {phase.duration:.2f} s" for phase in step.phases)
            rows.append((step.pick.name, step.start, step.duration, phases))
        rows += [(pick.name, "", "", f"left out: {pick.reason}") for pick in self.left_out]
        lines = (f"{step.start:.2f} s {step.pick.name}: {step.duration:.2f} s" for step in self.steps)
        table = Rows(("pick", "start [s]", "duration [s]", "phases"), rows)
        return View(self.message, [table], lines, len(self.steps))

    def to_text(self, *, most: int = 20) -> str:
        """The first picks with their times, those left out, what the order is worth, and the slowest picks."""
        times = cycle_time(self)
        lines = [
            f"{number:4} {time.name:20} at {time.start:8.2f} s, {time.duration:6.2f} s"
            for number, time in enumerate(times.picks[:most], start=1)
        ]
        if len(times.picks) > most:
            lines.append(f"     and {len(times.picks) - most} more picks")
        lines += [f"   - {pick.name:20} left out: {pick.reason}" for pick in self.left_out]
        lines.append(self.message)
        if self.steps:
            shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in times.utilisation.items())
            orders = f"{self.file_order:.2f} s and of the nearest neighbour {self.nearest_neighbour:.2f} s"
            bounds = f"lower bound {self.lower_bound:.2f} s, motions {self.moving:.2f} s"
            lines += [f"{bounds}; bounds of the file order {orders}", f"utilisation: {shares}"]
            for time in times.slowest(SLOWEST):
                lines.append(f"slow: {time.name}, {time.duration:.2f} s, limited by {time.limited_by}")
        return "\n".join(lines)

    def __iter__(self) -> Iterator[SequenceStep]:
        return iter(self.steps)

    @property
    def ok(self) -> bool:
        """Whether every pick is part of the sequence, and every motion is certified."""
        return self.complete and not self.left_out

    @property
    def complete(self) -> bool:
        """Whether all picks that can be executed are part of the sequence."""
        return bool(self.steps) and len(self.steps) == self.wanted

    @property
    def order(self) -> tuple[str, ...]:
        """The names of the picks in order."""
        return tuple(step.pick.name for step in self.steps)

    @property
    def duration(self) -> float:
        """Seconds of all motions and dwell times."""
        closing = 0.0 if self.closing is None else self.closing.trajectory.duration
        return (self.steps[-1].end if self.steps else 0.0) + closing

    @property
    def dwell(self) -> float:
        """Seconds of all dwell times."""
        return sum(phase.duration for step in self.steps for phase in step.phases if phase.name in ("grip", "release"))

    @property
    def moving(self) -> float:
        """Seconds of all motions."""
        return self.duration - self.dwell

    @property
    def gap(self) -> float:
        """The share by which the time of all motions exceeds the lower bound."""
        return self.moving / self.lower_bound - 1.0 if self.lower_bound > 0 else float("nan")

    @property
    def parts_per_minute(self) -> float:
        """Number of picks in a minute."""
        return 60.0 * len(self.steps) / self.duration if self.duration > 0 else float("nan")

    @property
    def clearance(self) -> float:
        """Metres: the smallest proven clearance of all motions."""
        return min((motion.certificate.clearance for motion in self.motions), default=float("nan"))

    @property
    def motions(self) -> tuple[PickMotion, ...]:
        """All motions in order."""
        closing = () if self.closing is None else (self.closing,)
        return (*(motion for step in self.steps for motion in step.verdict.motions), *closing)

    @property
    def message(self) -> str:
        """The result in one line."""
        if not self.steps:
            return "no pick can be executed"
        left = f"; {len(self.left_out)} left out" if self.left_out else ""
        guess = guess_mark(self.setup.checker.arm.limits.acceleration_source)
        part = "" if self.complete else f" of {self.wanted}, interrupted"
        return (
            f"{len(self.steps)}{part} picks in {self.duration:.1f} s{guess}, {self.parts_per_minute:.1f} per minute; "
            f"motions {100 * self.gap:.1f} % above the lower bound{left}"
        )

    def or_raise(self) -> SequenceResult:
        """Return the result if every pick is part of the sequence.

        Raises
        ------
        NoAnswer
            If a pick is left out, or the search was interrupted.
        """
        if self.ok:
            return self
        reasons = "; ".join(f"{pick.name}: {pick.reason}" for pick in self.left_out) or "the search was interrupted"
        raise NoAnswer(f"the sequence lacks picks: {reasons}")


SLOWEST = 3
"""Number of slowest picks that the text names."""

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
    bounds = Bounds.of(arm.limits, arm.joint_names)
    picks = []
    for step in result.steps:
        phases: dict[str, float] = {}
        for phase in step.phases:
            phases[phase.name] = phases.get(phase.name, 0.0) + phase.duration
        shortest = phases.get("grip", 0.0) + phases.get("release", 0.0)
        limits: list[tuple[float, str]] = []
        for motion in step.verdict.motions:
            least, limit = _limit(arm, motion, bounds, tool_speed=motion.name in step.pick.speed)
            shortest += least
            limits.append((motion.trajectory.duration, limit))
        picks.append(PickTime(step.pick.name, step.start, step.duration, phases, shortest, max(limits)[1]))
    return CycleTime(tuple(picks), closing, result.duration)


def _limit(arm: Arm, motion: PickMotion, bounds: Bounds, *, tool_speed: bool) -> tuple[float, str]:
    """The shortest time (s) of a motion, and what limits it."""
    moved = motion.trajectory
    times = rest_to_rest_times(np.abs(moved.end - moved.start), bounds)
    least, slowest = float(times.max()), arm.joint_names[int(times.argmax())]
    if motion.torques and max(peak.share for peak in motion.torques) > 1 / DETOUR:
        worst = max(motion.torques, key=lambda peak: peak.share)
        return least, f"{motion.name}: torque of {worst.joint}"
    if motion.name in STRAIGHT:
        return moved.duration, f"{motion.name}: " + ("tool speed" if tool_speed else f"{slowest} on the straight line")
    if moved.duration <= DETOUR * least:
        return least, f"{motion.name}: {slowest}"
    if tool_speed:
        return least, f"{motion.name}: tool speed"
    return least, f"{motion.name}: detour of {moved.duration - least:.2f} s around obstacles"
