"""The result of :func:`pinproof.cell.allocate`: the program of each arm on a common clock, and the certificates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path

import numpy as np

from pinproof.cell.allocation.common_clock import WAIT, ArmPiece, CommonInterval, Timing
from pinproof.cell.pages import MOST_FRAMES, RATE, CellRow, write_cell_page
from pinproof.cell.sequencing.precedence import AT_PLACE
from pinproof.cell.sequencing.sequence_result import LeftOut, SequenceResult
from pinproof.collision import Obstacle, Scene, proven_millimetres
from pinproof.common.results import Answer, Rows, Saved, View, Written, markdown
from pinproof.common.structs import OPTIONAL_NUMBER, TEXT, described, key, reported, struct
from pinproof.errors import InputError
from pinproof.model import PART, JointGroup, guess_mark
from pinproof.motion import Trajectory
from pinproof.picks import Picks
from pinproof.spatial import SE3, Array, matrix
from pinproof.viewer import Bar, Film, set_stage, simplified

SAME_PLACE = 1e-6
"""Relative difference of poses below which a part is where it was assumed to be."""

SAME_TIME = 1e-9
"""Seconds: differences are rounding."""


@struct("one_arm", written=True)
class OneArm:
    """All picks executed by one arm, with the others at home."""

    arm: str = key("name of the arm", kind=TEXT)
    duration: float | None = key("duration; null if it cannot execute all picks", "s")
    reason: str = key("why it cannot")


@struct("arm_program", written=True)
class ArmTime:
    """The program of one arm."""

    arm: str = key("name of the arm", name="name", kind=TEXT)
    picks: tuple[str, ...] = key("its picks in order")
    duration: float = key("until it is at home again", "s", minimum=0)
    waiting: float = key("waiting for other arms", "s", minimum=0)
    utilisation: float = key("share of the makespan in which it executes its sequence", minimum=0)
    phases: tuple[ArmPiece, ...] = key("motions, dwell times and waits in order")


@described()
class PartState:
    """A part that an arm grips, carries and releases."""

    arm: str = key("the arm")
    before: Obstacle | None = key("the part in the scene until the grip; None if the scene does not contain it")
    after: Obstacle = key("the part in the scene after the release")
    gripped: float = key("on the common clock", "s")
    released: float = key("on the common clock", "s")


@struct(
    "allocation",
    first=("robot", "summary", "ok", "free", "reason", "makespan", "clearance_proven", "ratio", "arms", "intervals",
           "alone", "left_out", "notes"),
    written=True,
    version="pinproof/allocation/1",
    eq=False,
)  # fmt: skip
class AllocationResult(Answer, Saved, Written):
    """Picks of several arms on a common clock.

    Readers must accept unknown keys: they are additions of the same version.
    """

    formats = (".json", ".md", ".html")
    indent = 2

    group: JointGroup = key("the arms", hidden=True)
    scene: Scene = key("the obstacles before the first pick", hidden=True)
    picks: Picks = key("the picks as given", hidden=True)
    timing: Timing = key(
        "the pieces of each arm on the common clock, the motion of the group, and the certificates of the arms "
        "against each other",
        hidden=True,
    )
    sequences: Mapping[str, SequenceResult] = key(
        "the sequence of each arm that has a pick, on its own clock", hidden=True
    )
    left_out: tuple[LeftOut, ...] = key("the picks that no arm can execute", hidden=True)
    alone: tuple[OneArm, ...] = key("the time of each arm alone, if it was computed", default=())
    tools: tuple[Obstacle, ...] = key("the open tools of all arms; each names its arm", default=(), hidden=True)

    def _view(self) -> View:
        lines = (
            f"{arm.arm}: {len(arm.picks)} picks in {arm.duration:.2f} s, including {arm.waiting:.2f} s of waiting"
            for arm in self.arms
        )
        return View(self.message, lines=lines)

    def to_text(self) -> str:
        """What each arm does, the result, the time of each arm alone, and what is left out or not covered."""
        lines = [
            f"{load.arm}: {', '.join(load.picks) or 'no pick'}; {load.duration:.2f} s, of which it waits "
            f"{load.waiting:.2f} s"
            for load in self.arms
        ]
        lines.append(self.message)
        for alone in self.alone:
            lines.append(f"{alone.arm} alone: {alone.reason if alone.duration is None else f'{alone.duration:.2f} s'}")
        lines += [f"left out: {pick.name}: {pick.reason}" for pick in self.missing]
        return "\n".join([*lines, *(f"not covered: {note}" for note in self.notes)])

    def to_markdown(self) -> str:
        """The programs of all arms as tables, and the picks that are left out."""
        parts: list[object] = [f"# Picks of {self.robot}", self.message]
        for arm in self.arms:
            rows = [(f"{part.start:.2f} s", f"{part.duration:.2f} s", part.pick, part.name) for part in arm.phases]
            table = Rows(("start", "duration", "pick", "phase"), rows, numbers={"start", "duration"})
            parts += [f"## {arm.arm}", table]
        return markdown(*parts, *(f"left out: {pick.name}: {pick.reason}" for pick in self.missing))

    @reported()
    def robot(self) -> str:
        """Name of the cell."""
        return self.group.robot.name

    @property
    def programs(self) -> Mapping[str, list[ArmPiece]]:
        """The pieces of each arm that has a pick, with waits, on the common clock."""
        return self.timing.programs

    @property
    def trajectory(self) -> Trajectory:
        """The motion of all joints of the group; :func:`pinproof.motion.separate` divides it into one for each arm."""
        return self.timing.trajectory

    @reported()
    def intervals(self) -> tuple[CommonInterval, ...]:
        """The certificates of the arms against each other."""
        return self.timing.intervals

    @reported("s", minimum=0)
    def makespan(self) -> float:
        """Until all arms are at home again."""
        return self.trajectory.duration

    @reported()
    def arms(self) -> tuple[ArmTime, ...]:
        """The program of each arm."""
        times = []
        for name in self.group.ends:
            pieces = self.programs.get(name, [])
            sequence = self.sequences.get(name)
            waiting = sum(piece.duration for piece in pieces if piece.name == WAIT)
            duration = pieces[-1].end if pieces else 0.0
            share = (duration - waiting) / self.makespan if self.makespan else 0.0
            order = () if sequence is None else sequence.order
            times.append(ArmTime(name, order, duration, waiting, share, tuple(pieces)))
        return tuple(times)

    @reported(name="left_out")
    def missing(self) -> tuple[LeftOut, ...]:
        """Picks that are not executed, with the reasons: those that no arm can do, and those left out later."""
        more = (
            LeftOut(pick.name, f"{arm}: {pick.reason}")
            for arm, sequence in self.sequences.items()
            for pick in sequence.left_out
        )
        return (*self.left_out, *more)

    @property
    def one_arm(self) -> OneArm | None:
        """The arm that alone takes the shortest time for all picks; None if no arm can or none was tried."""
        able = [one for one in self.alone if one.duration is not None]
        return min(able, key=lambda one: one.duration or 0.0, default=None)

    @reported(kind=OPTIONAL_NUMBER)
    def ratio(self) -> float:
        """The makespan divided by the time of the fastest single arm for all picks; not finite if it is not known."""
        one = self.one_arm
        return float("nan") if one is None or not one.duration else self.makespan / one.duration

    @reported()
    def free(self) -> bool:
        """Whether every motion is certified, and the arms are proven not to meet."""
        own = all(motion.certificate.free for sequence in self.sequences.values() for motion in sequence.motions)
        return own and self.timing.free and not self.misplaced

    @reported()
    def ok(self) -> bool:
        """Whether every pick is executed and everything is certified."""
        return self.free and not self.missing

    @reported("m", name="clearance_proven", kind=OPTIONAL_NUMBER)
    def clearance(self) -> float:
        """Smallest proven clearance, between the arms and of each of them."""
        own = (motion.certificate for sequence in self.sequences.values() for motion in sequence.motions)
        common = (interval.certificate for interval in self.intervals)
        return min((proof.clearance for proof in (*own, *common)), default=float("nan"))

    @reported(name="summary")
    def message(self) -> str:
        """The result in one line."""
        count = sum(len(arm.picks) for arm in self.arms)
        if not count:
            return "no pick can be executed"
        guess = guess_mark(self.group.limits.acceleration_source)
        shares = ", ".join(f"{arm.arm} {100 * arm.utilisation:.0f} %" for arm in self.arms)
        text = f"{count} picks of {len(self.arms)} arms in {self.makespan:.1f} s{guess}; utilisation {shares}"
        if self.one_arm is not None:
            text += f"; {self.one_arm.arm} alone takes {self.one_arm.duration:.1f} s, ratio {self.ratio:.2f}"
        if self.missing:
            text += f"; {len(self.missing)} left out"
        return text if self.free else f"{text}; NOT PROVEN: {self.reason}"

    @reported()
    def reason(self) -> str:
        """Why not everything is certified; empty if it is."""
        if self.timing.problem or self.misplaced:
            return self.timing.problem or self.misplaced
        failed = next((interval for interval in self.intervals if not interval.certificate.free), None)
        if failed is not None:
            return f"{failed.start:.2f} s to {failed.end:.2f} s: {failed.certificate.message}"
        motion = next((m for s in self.sequences.values() for m in s.motions if not m.certificate.free), None)
        return "" if motion is None else motion.certificate.message

    @reported()
    def notes(self) -> tuple[str, ...]:
        """What the certificates do not cover, one sentence each."""
        with_object = {pick.carried is not None for pick in self.picks}
        notes = (note for sequence in self.sequences.values() for note in sequence.setup.not_covered(with_object))
        return tuple(dict.fromkeys(notes))

    def _why_not(self) -> str:
        reasons = [f"{pick.name}: {pick.reason}" for pick in self.missing] or [self.reason]
        return f"the picks cannot all be executed: {'; '.join(reasons)}"

    @cached_property
    def parts(self) -> Mapping[str, PartState]:
        """For each part when and where it is gripped and released."""
        states = {}
        for name, pieces in self.programs.items():
            tools = {body.name for body in self.sequences[name].setup.shared.always_mounted.open_tool}
            own = self.sequences[name].setup.checker.arm
            carrying: dict[str, list[ArmPiece]] = {}
            for piece in pieces:
                for thing in piece.carries:
                    if thing.name not in tools:
                        carrying.setdefault(thing.name, []).append(piece)
            for part, held in carrying.items():
                thing = next(thing for thing in held[-1].carries if thing.name == part)
                tcp = own.root_from_frame(held[-1].trajectory.end, own.tcp)
                before = self.scene.get(part)
                after = Obstacle(part, thing.shape, tcp * SE3(thing.pose), thing.rgba)
                states[part] = PartState(name, before, after, held[0].start, held[-1].end)
        return states

    @cached_property
    def misplaced(self) -> str:
        """The first part that is put where the motions of another arm are not certified with it; empty without one.

        An object that is stated in the tcp rotates with the grasp, so that its place depends on the chosen option.
        """
        for part, state in self.parts.items():
            for name, sequence in self.sequences.items():
                scene = sequence.setup.checker.scene
                known = [body.pose for body in scene.obstacles if body.name.startswith(part + AT_PLACE)]
                if name != state.arm and not any(pose.isApprox(state.after.pose, SAME_PLACE) for pose in known):
                    return f"{name} is not certified with {part} where {state.arm} places it"
        return ""

    def scene_at(self, time: float) -> Scene:
        """The scene at a time (s) of the common clock, without the parts that are carried then."""
        scene = self.scene
        for part, state in self.parts.items():
            if part in scene and time >= state.gripped:
                scene = scene.remove(part)
            if time >= state.released:
                scene = scene.add(state.after)
        return scene

    def __iter__(self) -> Iterator[ArmTime]:
        return iter(self.arms)

    def save(self, path: str | Path, *, live: bool | None = None) -> None:
        """Write the result as JSON, Markdown, or as a page (.html); ``live`` is that of :meth:`PickReport.save`."""
        self._save(path, live=live)

    def _write_page(self, path: str | Path, *, live: bool | None) -> None:
        """Write the page of all arms; ViewerError if the robots have nothing to draw, or it cannot be written."""
        if not self.programs:
            raise InputError("no pick is executed that a page could show")
        stage = simplified(set_stage(self.group, self.scene, self.tools))
        # The rows of the table, and the bars of the chart
        rows, bars = [], []
        for arm, pieces in self.programs.items():
            sequence = self.sequences[arm]
            setup = sequence.setup if self.free else None
            for piece in pieces:
                label = ", ".join(filter(None, (piece.pick, piece.name)))
                bars.append(Bar(arm, piece.name, piece.start, piece.duration, f"{arm}: {label}"))
            for step in sequence.steps:
                name, own = step.pick.name, [piece for piece in pieces if piece.pick == step.pick.name]
                limited_by = step.limited_by.replace(f"{arm}{PART}", "")
                start, duration = own[0].start, own[-1].end - own[0].start
                rows.append(
                    CellRow(f"{name} ({arm})", step.pick, start, duration, step.verdict.clearance, limited_by, setup)
                )
        figures = [(f"makespan{guess_mark(self.group.limits.acceleration_source)}", f"{self.makespan:.1f} s")]
        if np.isfinite(self.ratio):
            figures.append(("of the time of one arm", f"{100 * self.ratio:.0f} %"))
        figures += [(f"utilisation of {load.arm}", f"{100 * load.utilisation:.0f} %") for load in self.arms]
        verdict = "FREE" if self.free else "NOT PROVEN"
        figures.append((f"smallest proven clearance {proven_millimetres(self.clearance)}", verdict))
        # Key frames of all arms and of the parts, which rest before and after they are carried
        whole, arms = self.trajectory, list(self.group.ends)
        times = np.linspace(0.0, whole.duration, min(int(np.ceil(whole.duration * RATE)) + 1, MOST_FRAMES))
        events = [time for state in self.parts.values() for time in (state.gripped, state.released)]
        times = np.unique(np.concatenate([times, events]))
        configurations = np.asarray(whole(times))
        tcps = np.stack([stage.tcp_poses(q) for q in configurations])
        # where the parts are in the key frames in which they are carried, and before and after
        held: dict[str, dict[int, Array]] = {}
        for number, arm in enumerate(arms):
            for piece in self.programs.get(arm, []):
                frames = np.flatnonzero((times >= piece.start - SAME_TIME) & (times <= piece.end + SAME_TIME)).tolist()
                for thing in piece.carries:
                    if thing.name in self.parts:
                        placed = held.setdefault(thing.name, {})
                        placed |= {k: tcps[k, number] @ matrix(thing.pose) for k in frames if k not in placed}
        riders = {}
        for name, placed in held.items():
            carried = sorted(placed)
            latest = np.searchsorted(carried, np.arange(len(times)), side="right") - 1
            riders[name] = np.stack([placed[carried[k]] for k in latest.clip(0)])
        poses = np.stack([stage.link_poses(q) for q in configurations])
        write_cell_page(
            path,
            stage,
            Film(times, poses, tcps[:, :, :3, 3], riders),
            title=f"Cell of {', '.join(arms)}",
            summary=self.message,
            figures=figures,
            notes=[f"Not proven: {self.reason}"] * bool(self.reason) + [f"Not covered: {n}" for n in self.notes],
            duration=self.makespan,
            rows=sorted(rows, key=lambda row: row.start),
            left_out=[(pick.name, pick.reason) for pick in self.missing],
            parts={pick.name: pick.object_name for pick in self.picks.picks},
            bars=sorted(bars, key=lambda bar: arms.index(bar.lane)),
            lanes=arms,
            acceleration_source=self.group.limits.acceleration_source,
            several=True,
            live=live,
        )
