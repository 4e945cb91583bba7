"""The result of :func:`pinproof.sequence`: the steps with their motions, the total time and its lower bound."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from pinproof.cell.sequencing.precedence import Precedence
from pinproof.collision import Certificate, Scene
from pinproof.common.display import html_block, html_table, outline
from pinproof.common.structs import TEXT, key, struct
from pinproof.errors import NoAnswer
from pinproof.model import guess_mark
from pinproof.motion import MotionProgram
from pinproof.picks import Pick, PickMotion, PickSetup, PickVerdict

PHASES = ("transit", "approach", "grip", "retreat", "transfer", "place", "release", "leave")
"""The phases of a step in order: motions, and the dwell times grip and release."""


@struct("left_out", more=True, written=True)
class LeftOut:
    """A pick that is not part of the sequence."""

    name: str = key("name of the pick", kind=TEXT)
    reason: str = key("why it cannot be executed", kind=TEXT)


@dataclass(frozen=True)
class Phase:
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
    def phases(self) -> tuple[Phase, ...]:
        """The motions and dwell times in order."""
        found: list[Phase] = []
        now = self.start
        motions = self.verdict.motions
        grip_after = max(k for k, motion in enumerate(motions) if motion.name in ("transit", "approach"))
        released = [k for k, motion in enumerate(motions) if motion.name in ("transfer", "place")]
        for k, motion in enumerate(motions):
            parts = [Phase(motion.name, now, motion.trajectory.duration, motion.certificate)]
            if k == grip_after:
                parts.append(Phase("grip", 0.0, self.grip_dwell, None))
            if released and k == released[-1]:
                parts.append(Phase("release", 0.0, self.release_dwell, None))
            for phase in parts:
                if phase.certificate is not None or phase.duration > 0.0:
                    found.append(replace(phase, start=now))
                    now += phase.duration
        return tuple(found)

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
class SequenceResult:
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

    def __repr__(self) -> str:
        return outline(
            f"SequenceResult({self.message})",
            (f"{step.start:.2f} s {step.pick.name}: {step.duration:.2f} s" for step in self.steps),
            total=len(self.steps),
        )

    def _repr_html_(self) -> str:
        columns = ("pick", "start [s]", "duration [s]", "phases")
        rows: list[tuple[object, ...]] = [
            (
                step.pick.name,
                step.start,
                step.duration,
                ", ".join(f"{phase.name} {phase.duration:.2f} s" for phase in step.phases),
            )
            for step in self.steps
        ]
        rows += [(pick.name, "", "", f"left out: {pick.reason}") for pick in self.left_out]
        return html_block(self.message, html_table(columns, rows))

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
        every = [motion.certificate.clearance for motion in self.motions]
        return min(every, default=float("nan"))

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
        reasons = "; ".join(f"{each.name}: {each.reason}" for each in self.left_out) or "the search was interrupted"
        raise NoAnswer(f"the sequence lacks picks: {reasons}")
