"""The result of :func:`pinproof.sequence`: the steps with their motions, the total time and what limits it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from operator import itemgetter
from pathlib import Path

from pinproof.cell.pages import MOST_FRAMES, RATE, CellRow, write_cell_page
from pinproof.cell.sequencing.precedence import Precedence
from pinproof.cell.sequencing.windings import CableTwist, home_of_budgeted, twists, unwound
from pinproof.collision import Certificate, Obstacle, Scene, proven_millimetres
from pinproof.common import structs as st
from pinproof.common.files import csv_text
from pinproof.common.results import Answer, Rows, Saved, View, Written, markdown
from pinproof.errors import InputError
from pinproof.model import guess_mark
from pinproof.motion import Bounds, MotionProgram, find_dialect, least_times
from pinproof.picks import (
    ExportedProgram,
    Pick,
    PickMotion,
    PickSetup,
    PickVerdict,
    check_export,
    with_motion,
    write_programs,
)
from pinproof.viewer import Bar, ColouredPoints, FilmPhase, film, set_stage, simplified

CHANGE = ("return", "change")
"""The phases of a change of the tool: the motion to home, and the change there."""

UNWIND = "unwind"
"""The phase of a transit that turns a joint with a budget of rotation back by full rotations."""

PHASES = (*CHANGE, UNWIND, "transit", "approach", "grip", "retreat", "transfer", "place", "release", "leave")
"""The phases of a step in order: motions, the change of the tool, and the dwell times grip and release."""


@st.struct("left_out", written=True)
class LeftOut:
    """A pick that is not part of the sequence."""

    name: str = st.key("name of the pick", kind=st.TEXT)
    reason: str = st.key("why it cannot be executed", kind=st.TEXT)


@st.struct("sequence_phase", written=True)
class SequencePhase:
    """A motion or a dwell time."""

    name: str = st.key(
        f"one of {', '.join(f'`{name}`' for name in PHASES)}; `change` of the tool, `grip` and `release` are "
        "dwell times; `unwind` is a transit that turns a joint with a budget of rotation back by full rotations",
        kind=st.choice(*PHASES),
    )
    start: float = st.key("from the start of the sequence", "s", minimum=0)
    duration: float = st.key("duration", "s", minimum=0)
    motion: PickMotion | None = st.key("the certified motion; None for a dwell time", hidden=True)

    @property
    def certificate(self) -> Certificate | None:
        """The certificate of a motion; None for a dwell time."""
        return None if self.motion is None else self.motion.certificate

    @st.reported("m", kind=st.OPTIONAL_NUMBER)
    def clearance_proven(self) -> float | None:
        """Proven lower bound of every distance; null for a dwell time."""
        return None if self.certificate is None else self.certificate.clearance

    @st.reported(kind=st.optional(st.INTEGER))
    def pairs_proven(self) -> int | None:
        """Pairs of bodies proven; null for a dwell time."""
        return None if self.certificate is None else self.certificate.pairs


DETOUR = 1.1
"""A motion that takes this multiple of the slowest joint's shortest time is limited by its detour around obstacles."""

STRAIGHT = ("approach", "retreat", "place", "leave")
"""The motions along straight lines, which cannot be shorter than the line permits."""


@st.struct(
    "sequence_step",
    first=("name", "start", "duration", "shortest", "limited_by", "member", "grasp", "tool", "q_grasp", "phases"),
    written=True,
    eq=False,
)
class SequenceStep:
    """One pick of the sequence."""

    pick: Pick = st.key("the pick as given", hidden=True)
    verdict: PickVerdict = st.key(
        "the verdict with the certified motions; its pick has its poses in the root frame. The first motion is the "
        "transit from the end of the step before",
        hidden=True,
    )
    scene: Scene = st.key("the scene before the step. The motions have their own scenes", hidden=True)
    start: float = st.key("from the start of the sequence", "s", minimum=0)
    bounds: Bounds = st.key("the limits for which the motions are timed", hidden=True)
    grip_dwell: float = st.key("the rest at the grasp", "s", default=0.0, hidden=True)
    release_dwell: float = st.key("the rest at the release", "s", default=0.0, hidden=True)
    tool_change: float = st.key("the change of the tool at home, if it is changed", "s", default=0.0, hidden=True)
    budgeted: Mapping[str, float] = st.key(
        "the values at home of the joints with a budget of rotation", default_factory=dict, hidden=True
    )

    @st.reported(kind=st.TEXT)
    def name(self) -> str:
        """Name of the pick."""
        return self.pick.name

    @st.reported()
    def phases(self) -> tuple[SequencePhase, ...]:
        """The motions and dwell times in order."""
        return self._phases

    @cached_property
    def _phases(self) -> tuple[SequencePhase, ...]:
        phases: list[SequencePhase] = []
        now = self.start
        motions = self.verdict.motions
        grip_after = max(k for k, motion in enumerate(motions) if motion.name in ("transit", "approach"))
        released = [k for k, motion in enumerate(motions) if motion.name in ("transfer", "place")]
        for k, motion in enumerate(motions):
            parts = [SequencePhase(_phase_of(motion, self.budgeted), now, motion.trajectory.duration, motion)]
            if motion.name == "return":
                parts.append(SequencePhase("change", 0.0, self.tool_change, None))
            if k == grip_after:
                parts.append(SequencePhase("grip", 0.0, self.grip_dwell, None))
            if released and k == released[-1]:
                parts.append(SequencePhase("release", 0.0, self.release_dwell, None))
            for phase in parts:
                if phase.motion is not None or phase.duration > 0.0:
                    phases.append(replace(phase, start=now))
                    now += phase.duration
        return tuple(phases)

    @property
    def end(self) -> float:
        """Seconds from the start of the sequence to the end of the step."""
        return self.phases[-1].start + self.phases[-1].duration

    @st.reported("s", minimum=0)
    def duration(self) -> float:
        """Transit, all motions and dwell times."""
        return self.end - self.start

    @property
    def by_phase(self) -> dict[str, float]:
        """Seconds by phase, of those that occur."""
        return _by_phase(self.phases)

    @st.reported("s", minimum=0)
    def shortest(self) -> float:
        """Lower bound of the duration, without obstacles."""
        dwell = sum(phase.duration for phase in self.phases if phase.motion is None)
        return dwell + sum(least for _, least, _ in self._limits)

    @st.reported()
    def limited_by(self) -> str:
        """What limits its longest motion: a joint, a torque, a detour around obstacles, or the speed of the tool."""
        return max((duration, limit) for duration, _, limit in self._limits)[1]

    @st.reported()
    def member(self) -> str:
        """How the grasp differs from the nominal one."""
        return self.verdict.member

    @st.reported(kind=st.optional(st.TEXT))
    def grasp(self) -> str | None:
        """The grasp of its part; null for a pick with a pose of its own."""
        return self.verdict.grasp

    @st.reported(kind=st.optional(st.TEXT))
    def tool(self) -> str | None:
        """The tool; null if the picks have no tools."""
        return self.verdict.tool

    @st.reported("rad or m", kind=st.list_of(st.PLAIN_NUMBER))
    def q_grasp(self) -> Sequence[float]:
        """Configuration at the grasp."""
        return () if self.verdict.q_grasp is None else self.verdict.q_grasp.tolist()

    @cached_property
    def _limits(self) -> list[tuple[float, float, str]]:
        """For each motion its duration, its shortest time (s) without obstacles, and what limits it."""
        limits = []
        for motion in self.verdict.motions:
            moved, name, tool_speed = motion.trajectory, motion.name, motion.name in self.pick.speed
            times = least_times(moved.end - moved.start, self.bounds, by_joint=True)
            least, slowest = float(times.max()), moved.joint_names[int(times.argmax())]
            worst = max(motion.torques, key=lambda peak: peak.share, default=None)
            if worst is not None and worst.share > 1 / DETOUR:
                limit = f"torque of {worst.joint}"
            elif name in STRAIGHT:
                limit, least = "tool speed" if tool_speed else f"{slowest} on the straight line", moved.duration
            elif moved.duration <= DETOUR * least:
                limit = slowest
            elif tool_speed:
                limit = "tool speed"
            else:
                limit = f"detour of {moved.duration - least:.2f} s around obstacles"
            limits.append((moved.duration, least, f"{name}: {limit}"))
        return limits

    def program(self, *, names: bool = True) -> MotionProgram:
        """The step as a motion program with the events grip and release.

        With ``names``, the name of a transit that turns joints back by full rotations states them.

        Raises
        ------
        InputError
            If the step begins with a change of the tool, which a program does not state.
        """
        if self.verdict.motions[0].name == "return":
            reason = "begins with a change of the tool, which a program does not state; export its motions instead"
            raise InputError(f"the step of pick {self.name!r} {reason}")
        program = self.verdict.program(grip_dwell=self.grip_dwell, release_dwell=self.release_dwell)
        # the name of a first motion that unwinds states which joints, and by how much
        first = program.segments[0]
        turned = unwound(first.trajectory, self.budgeted)
        if not names or not turned or first.name != "transit":
            return program
        text = ", ".join(f"{joint} by {360 * turns} deg" for joint, turns in turned.items())
        return replace(program, segments=(replace(first, name=f"{UNWIND} {text}"), *program.segments[1:]))


PRECEDENCE = st.report_table(
    "precedence",
    "A pair of picks in a fixed order.",
    st.required("before", st.TEXT, "name of the pick that is executed first", get=itemgetter(0)),
    st.required("after", st.TEXT, "name of the other pick", get=itemgetter(1)),
    st.required("reason", st.TEXT, "`stated`, or what geometry demands", get=itemgetter(2)),
)

COLUMNS = ("position", "pick", "start", "duration", *PHASES, "shortest", "clearance_proven", "limited_by", "left_out")
"""The columns of the table; times in seconds, the clearance in metres."""

SLOWEST, SHOWN = 3, 20
"""Largest numbers of slowest picks and of all picks that the text names."""


@st.struct(
    "sequence",
    first=("robot", "summary", "ok", "interrupted", "acceleration_source", "notes", "duration", "moving",
           "lower_bound", "gap", "file_order", "nearest_neighbour", "tool_changes", "parts_per_minute",
           "clearance_proven", "by_phase", "closing", "program_duration", "exported", "twist", "steps", "left_out",
           "precedence"),
    written=True,
    version="pinproof/sequence/1",
    eq=False,
)  # fmt: skip
class SequenceResult(Answer, Saved, Written):
    """A sequence of picks. Readers must accept unknown keys: they are additions of the same version."""

    formats = (".json", ".csv", ".md", ".html")
    indent = 2

    setup: PickSetup = st.key("the cell before the sequence", hidden=True)
    steps: tuple[SequenceStep, ...] = st.key("the picks in order, with certified motions")
    closing: PickMotion | None = st.key("the motion to the end; None if the end is free", hidden=True)
    left_out: tuple[LeftOut, ...] = st.key("picks that cannot be executed")
    precedence: Precedence = st.key("the pairs of picks in a fixed order, stated or demanded by geometry", hidden=True)
    lower_bound: float = st.key(
        "lower bound of the time of all motions: no sequence of these picks with the grasps and IK branches considered "
        "takes less, for motions that rest between their parts. Changes of the tool are included",
        "s",
        kind=st.OPTIONAL_NUMBER,
    )
    file_order: float = st.key(
        "lower bound of the time of all motions in the given order, changed where it violates the precedence, with the "
        "best grasps and IK branches",
        "s",
        kind=st.OPTIONAL_NUMBER,
    )
    nearest_neighbour: float = st.key("the same in the order of the nearest neighbour", "s", kind=st.OPTIONAL_NUMBER)
    wanted: int = st.key("number of picks that can be executed", hidden=True)
    interrupted: bool = st.key("whether the search was interrupted", default=False)
    exported: tuple[ExportedProgram, ...] = st.key(
        "the programs of controllers that :meth:`export_programs` wrote", default=(), added=True
    )

    def export_programs(
        self, folder: str | Path, language: str, *, output: str | None = None, deviation: float | None = None
    ) -> tuple[SequenceResult, list[str]]:
        """Write each step as a program of a robot controller that begins where the one before it ends.

        The programs are certified in the scenes of their moments; the last one contains the motion to the end. A
        routine ``main`` calls them in order, if the language has routines in other files.

        Parameters
        ----------
        folder
            The existing folder.
        language, output, deviation
            As for :func:`pinproof.picks.export_picks`; by default the output of the picks file, or of the language.

        Returns
        -------
        tuple[SequenceResult, list[str]]
            The sequence with the programs that were written, and what is not covered or not written, in sentences.

        Raises
        ------
        InputError
            If the language cannot express the joints, or a step begins with a change of the tool.
        """
        check_export(self.setup.checker.arm, self.setup.shared, language)
        picks = list[tuple[PickSetup, Pick, MotionProgram]]()
        for step in self.steps:
            program = step.program(names=False)
            home, checker = self.setup.home, self.setup.checker.with_scene(step.scene)
            if step is self.steps[-1] and self.closing is not None:
                program, home = with_motion(program, self.closing), self.closing.trajectory.end
            picks.append((replace(self.setup, checker=checker, home=home), step.verdict.pick, program))
        calls = bool(find_dialect(language).call)
        written, notes = write_programs(
            folder, language, picks, output=output, deviation=deviation, main=calls and self.complete
        )
        return replace(self, exported=written), notes

    def _view(self) -> View:
        rows: list[tuple[object, ...]] = []
        for number, step in enumerate(self.steps, start=1):
            phases = ", ".join(f"{phase.name} {phase.duration:.2f} s" for phase in step.phases)
            rows.append((number, step.name, f"{step.start:.2f} s", f"{step.duration:.2f} s", phases, step.limited_by))
        rows += [("", pick.name, "", "", "", f"left out: {pick.reason}") for pick in self.left_out]
        lines = (f"{step.start:.2f} s {step.name}: {step.duration:.2f} s" for step in self.steps)
        columns = ("", "pick", "start", "duration", "phases", "limited by")
        table = Rows(columns, rows, numbers={"", "start", "duration"})
        return View(self.message, [table], lines, len(self.steps))

    def to_text(self) -> str:
        """The first picks with their times, those left out, what the order is worth, and the slowest picks."""
        lines = [
            f"{number:4} {step.name:20} at {step.start:8.2f} s, {step.duration:6.2f} s"
            for number, step in enumerate(self.steps[:SHOWN], start=1)
        ]
        if len(self.steps) > SHOWN:
            lines.append(f"     and {len(self.steps) - SHOWN} more picks")
        lines += [f"   - {pick.name:20} left out: {pick.reason}" for pick in self.left_out]
        lines.append(self.message)
        if self.steps:
            shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in self.utilisation.items())
            orders = f"{self.file_order:.2f} s and of the nearest neighbour {self.nearest_neighbour:.2f} s"
            bounds = f"lower bound {self.lower_bound:.2f} s, motions {self.moving:.2f} s"
            lines += [f"{bounds}; bounds of the file order {orders}", f"utilisation: {shares}"]
            lines += [f"{what}: {text}" for what, text in self._program_time]
            lines += [f"twist from home: {'; '.join(map(str, self._budgeted))}"] if self._budgeted else []
            for step in self.slowest(SLOWEST):
                lines.append(f"slow: {step.name}, {step.duration:.2f} s, limited by {step.limited_by}")
        return "\n".join(lines)

    def __iter__(self) -> Iterator[SequenceStep]:
        return iter(self.steps)

    @st.reported()
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

    @st.reported("s", minimum=0)
    def duration(self) -> float:
        """All motions and dwell times."""
        return (self.steps[-1].end if self.steps else 0.0) + self.closing_time

    @st.reported("s", kind=st.OPTIONAL_NUMBER)
    def program_duration(self) -> float:
        """Cycle time of the exported programs by the rules of their controller; null unless all were written."""
        complete = bool(self.steps) and len(self.exported) == len(self.steps)
        return sum(own.duration for own in self.exported) if complete else float("nan")

    @property
    def _program_time(self) -> list[tuple[str, str]]:
        """What the figures of the sequence state about its programs."""
        if not self.exported:
            return []
        what = f"cycle of the {self.exported[0].language} programs"
        if math.isnan(self.program_duration):
            return [(what, f"only {len(self.exported)} of {len(self.steps)} are proven")]
        longer = 100.0 * (self.program_duration / self.duration - 1.0)
        return [(what, f"{self.program_duration:.1f} s ({longer:+.1f} %)")]

    @property
    def dwell(self) -> float:
        """Seconds of all dwell times."""
        return sum(phase.duration for step in self.steps for phase in step.phases if phase.name in ("grip", "release"))

    @st.reported(kind=st.INTEGER)
    def tool_changes(self) -> int:
        """Number of changes of the tool."""
        return sum(phase.name == "return" for step in self.steps for phase in step.phases)

    @st.reported("s", minimum=0)
    def moving(self) -> float:
        """All motions, with the changes of the tool."""
        return self.duration - self.dwell

    @st.reported(kind=st.OPTIONAL_NUMBER)
    def gap(self) -> float:
        """``moving`` divided by ``lower_bound``, minus 1."""
        return self.moving / self.lower_bound - 1.0 if self.lower_bound > 0 else float("nan")

    @st.reported(kind=st.OPTIONAL_NUMBER)
    def parts_per_minute(self) -> float:
        """Number of picks in a minute."""
        return 60.0 * len(self.steps) / self.duration if self.duration > 0 else float("nan")

    @st.reported("m", name="clearance_proven", kind=st.OPTIONAL_NUMBER)
    def clearance(self) -> float:
        """Smallest proven clearance of all motions."""
        return min((motion.certificate.clearance for motion in self.motions), default=float("nan"))

    @property
    def motions(self) -> tuple[PickMotion, ...]:
        """All motions in order."""
        closing = () if self.closing is None else (self.closing,)
        return (*(motion for step in self.steps for motion in step.verdict.motions), *closing)

    @st.reported(name="summary")
    def message(self) -> str:
        """The result in one line."""
        if not self.steps:
            return "no pick can be executed"
        left = f"; {len(self.left_out)} left out" if self.left_out else ""
        guess = guess_mark(self.setup.checker.arm.limits.acceleration_source)
        part = "" if self.complete else f" of {self.wanted}, interrupted"
        if count := self.tool_changes:
            seconds = sum(self.by_phase.get(name, 0.0) for name in CHANGE)
            left = f", with {count} change{'' if count == 1 else 's'} of the tool ({seconds:.1f} s){left}"
        return (
            f"{len(self.steps)}{part} picks in {self.duration:.1f} s{guess}, {self.parts_per_minute:.1f} per minute; "
            f"motions {100 * self.gap:.1f} % above the lower bound{left}"
        )

    @st.reported()
    def robot(self) -> str:
        """Name of the robot."""
        return self.setup.checker.arm.robot.name

    @st.reported()
    def acceleration_source(self) -> str:
        """Source of the acceleration limits."""
        return self.setup.checker.arm.limits.acceleration_source

    @st.reported()
    def notes(self) -> tuple[str, ...]:
        """What the certificates do not cover."""
        notes = self.setup.not_covered({step.pick.carried is not None for step in self.steps})
        # Objects that picks state themselves appear with their picks
        later = [step.pick.name for step in self.steps[1:] if isinstance(step.pick.carried, Obstacle)]
        if later:
            notes = (*notes, f"the objects of {', '.join(later)} before these picks, which state them themselves")
        # The open hands of successive picks may differ
        opened = []
        for before, step in pairwise(self.steps):
            last, first = before.verdict.motions[-1], step.verdict.motions[0]
            if first.name != "return" and (last.held, last.attached) != (first.held, first.attached):
                opened.append(step.pick.name)
        if opened:
            change = (
                f"another opening of the hand before {', '.join(opened)}: it is checked before and after the change"
            )
            notes = (*notes, f"{change}, not during it")
        return notes

    @st.reported("s", kind=st.mapping_to(st.NOT_NEGATIVE))
    def by_phase(self) -> dict[str, float]:
        """Time of all picks by phase, in the order of the phases; the closing motion counts as transit."""
        name = self._closing_phase
        closing = () if self.closing is None else (SequencePhase(name, 0.0, self.closing_time, self.closing),)
        total = _by_phase([*closing, *(phase for step in self.steps for phase in step.phases)])
        return {name: total[name] for name in PHASES if total.get(name)}

    @cached_property
    def _twist(self) -> tuple[CableTwist, ...]:
        motions = [motion.trajectory for motion in self.motions]
        return twists(self.setup.checker.arm, self.setup.home, self.setup.shared.windings, motions)

    @property
    def _budgeted(self) -> list[CableTwist]:
        return [own for own in self._twist if own.budget is not None]

    @st.reported()
    def twist(self) -> tuple[CableTwist, ...]:
        """Rotation from home of each joint with a budget, and of those that can turn by more than a full rotation."""
        return self._twist

    @property
    def _closing_phase(self) -> str:
        return "transit" if self.closing is None else _phase_of(self.closing, home_of_budgeted(self.setup))

    @property
    def utilisation(self) -> dict[str, float]:
        """The share of the cycle of each phase."""
        return {name: seconds / self.duration for name, seconds in self.by_phase.items()} if self.duration else {}

    def slowest(self, count: int = 5) -> tuple[SequenceStep, ...]:
        """The picks with the longest durations, the slowest first."""
        return tuple(sorted(self.steps, key=lambda step: -step.duration)[:count])

    @st.reported(name="precedence", kind=st.list_of(PRECEDENCE))
    def ordered_pairs(self) -> list[tuple[str, str, str]]:
        """Pairs of picks in a fixed order."""
        return self.precedence.rows

    @st.reported("s", name="closing", minimum=0)
    def closing_time(self) -> float:
        """The motion to the end."""
        return 0.0 if self.closing is None else self.closing.trajectory.duration

    def to_csv(self) -> str:
        """One row for each pick in order, then one for each that is left out."""
        rows: list[tuple[object, ...]] = []
        for number, step in enumerate(self.steps, start=1):
            phases = (step.by_phase.get(name, "") for name in PHASES)
            limits = step.shortest, st.OPTIONAL_NUMBER.write(step.verdict.clearance), step.limited_by
            rows.append((number, step.name, step.start, step.duration, *phases, *limits, ""))
        blank = [""] * (len(COLUMNS) - 3)
        return csv_text(COLUMNS, [*rows, *(("", pick.name, *blank, pick.reason) for pick in self.left_out)])

    def to_markdown(self) -> str:
        """The result in one line, and the table of the picks that is shown."""
        programs = [f"{what}: {text}" for what, text in self._program_time]
        return markdown(f"# Sequence of {self.robot}", super().to_markdown().rstrip(), *programs)

    def save(
        self,
        path: str | Path,
        *,
        heat_map: ColouredPoints | None = None,
        title: str | None = None,
        live: bool | None = None,
    ) -> None:
        """Write the sequence as JSON, CSV, Markdown, or as a page (.html) that opens offline in any browser.

        Parameters
        ----------
        path
            The file to write.
        heat_map
            Points on the floor of the page, such as the result of a search for the base placement.
        title
            The title of the page. Default: the name of the robot.
        live
            Whether the page computes, as for :meth:`pinproof.picks.PickReport.save`.

        Raises
        ------
        InputError
            For another suffix, or if the sequence has no step that a page could show.
        FileError, ViewerError
            If the file cannot be written, or the robot has nothing to draw on a page.
        """
        self._save(path, heat_map=heat_map, title=title, live=live)

    def _write_page(
        self, path: str | Path, *, heat_map: ColouredPoints | None, title: str | None, live: bool | None
    ) -> None:
        if not self.steps:
            raise InputError("the sequence has no step that a page could show")
        setup = self.setup
        arm = setup.checker.arm
        stage = simplified(set_stage(arm, setup.checker.scene, setup.shared.open_tool))
        # The film of all motions, with rests at dwell times
        own = {thing.name for thing in setup.shared.open_tool}  # tools that are changed are drawn as what is carried
        timed = [(phase.start, phase.motion) for step in self.steps for phase in step.phases]
        end = self.steps[-1].end
        phases = []
        for start, motion in [*timed, (end, self.closing)]:
            if motion is not None:
                carried = tuple(thing for thing in motion.attached if thing.name not in own)
                phases.append(FilmPhase(motion.trajectory, carried, held=motion.held, start=start))
        # The rows of the table, and the bars of the chart
        is_free = all(motion.certificate.free for motion in self.motions)
        rows = [
            CellRow(
                step.name,
                step.pick,
                step.start,
                step.duration,
                step.verdict.clearance,
                step.limited_by,
                setup if is_free else None,
            )
            for step in self.steps
        ]
        bars = [
            Bar(phase.name, phase.name, phase.start, phase.duration, f"{step.pick.name}, {phase.name}")
            for step in self.steps
            for phase in step.phases
        ]
        if self.closing is not None:
            name = self._closing_phase
            bars.append(Bar(name, name, end, self.closing_time, name))
        write_cell_page(
            path,
            stage,
            film(stage, phases, rate=RATE, most=MOST_FRAMES),
            title=title or f"Cell of {arm.robot.name}",
            summary=self.message,
            figures=[
                (f"cycle{guess_mark(self.acceleration_source)}", f"{self.duration:.1f} s"),
                *self._program_time,
                ("parts per minute", f"{self.parts_per_minute:.1f}"),
                ("above the lower bound", f"{100 * self.gap:.1f} %"),
                (
                    f"motions, smallest proven clearance {proven_millimetres(self.clearance)}",
                    "FREE" if is_free else "UNPROVEN",
                ),
                *((f"twist from home of {own.joint}", str(own).removeprefix(own.joint)) for own in self._budgeted),
            ],
            notes=[f"Not covered: {note}" for note in self.notes],
            duration=self.duration,
            rows=rows,
            left_out=[(pick.name, pick.reason) for pick in self.left_out],
            parts={pick.name: pick.object_name for pick in (*setup.shared.picks, *(step.pick for step in self.steps))},
            bars=bars,
            lanes=[name for name in PHASES if name not in (*CHANGE, UNWIND) or name in self.by_phase],
            acceleration_source=self.acceleration_source,
            heat_map=heat_map,
            live=live,
        )

    def _why_not(self) -> str:
        reasons = "; ".join(f"{pick.name}: {pick.reason}" for pick in self.left_out) or "the search was interrupted"
        return f"the sequence lacks picks: {reasons}"


def _phase_of(motion: PickMotion, budgeted: Mapping[str, float]) -> str:
    """The phase of a motion: its name, or that of an unwinding move."""
    return UNWIND if motion.name == "transit" and unwound(motion.trajectory, budgeted) else motion.name


def _by_phase(phases: Iterable[SequencePhase]) -> dict[str, float]:
    """Seconds of the phases by name."""
    total: dict[str, float] = {}
    for phase in phases:
        total[phase.name] = total.get(phase.name, 0.0) + phase.duration
    return total
