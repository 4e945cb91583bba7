"""Jobs: all strokes of a file followed one after another, with the motions between them, and the report on them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pinproof.collision import Certificate, CollisionChecker, certify, proven_millimetres
from pinproof.common.files import csv_text
from pinproof.common.results import Rows, Saved, Solution, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer
from pinproof.errors import NoClosedForm
from pinproof.model import guess_note
from pinproof.motion import Trajectory
from pinproof.picks import controller_tool
from pinproof.planning import PlannedMotion, plan
from pinproof.spatial import Array
from pinproof.tool_paths.files import ToolJob
from pinproof.tool_paths.following import TRANSIT, follow
from pinproof.tool_paths.pictures import coloured_path, rotation_strip, strip_panel
from pinproof.tool_paths.program import ProgramMotion, ToolPathProgram, export_motions
from pinproof.tool_paths.result import FollowPlan
from pinproof.tool_paths.strokes import Stroke
from pinproof.tool_paths.suggestions import PathSuggestion, suggest_changes
from pinproof.work import Progress

# Largest number of strips on a page.
STRIPS = 12
COLUMNS = ("stroke", "result", "duration", "clearance", "deviation", "speed", "reason", "suggestions")
CSV_COLUMNS = (
    "stroke", "status", "poses", "length", "duration", "clearance_proven", "deviation", "rotation_deviation",
    "speed_share", "lifts", "reason", "suggestions",
)  # fmt: skip
"""The columns of the CSV, in metres, seconds and radians; cells without a value are empty."""


@described(eq=False)
class StrokeReport:
    """A stroke with its plan, and the changes that help if it has none."""

    stroke: Stroke = key("the stroke in the base frame of the arm, as it is followed")
    plan: FollowPlan = key("the plan")
    suggestions: tuple[PathSuggestion, ...] = key("changes with which the stroke is followed", default=())

    @property
    def speed_share(self) -> float:
        """The least share of the stated speed at which the tool is proven to move, ramps excepted."""
        return min((piece.speed_share for piece in self.plan.pieces), default=math.nan)


@described(eq=False)
class WholeMotion(PlannedMotion):
    """The motion of a job over all its strokes, with one certificate, or why there is none."""

    not_pickled = ("checker",)

    message: str = key("the outcome as text")
    checker: CollisionChecker = key("the checker of the certificate")
    strokes: tuple[StrokeReport, ...] = key("the strokes")
    motions: tuple[ProgramMotion, ...] = key("the parts of the motion in order", default=(), hidden=True)
    trajectory: Solution[Trajectory] = key("the motion, if every stroke has one", default=Solution())
    certificate: Solution[Certificate] = key("its certificate", default=Solution())
    title: str = key("title of the page", default="")
    colour: Literal["clearance", "speed"] = key("what the colours of the paths show", default="clearance")

    @property
    def ok(self) -> bool:
        """Whether there is a motion that is proven."""
        certificate = vars(self)["certificate"]
        return certificate is not None and bool(certificate.free)

    def _pictured(self) -> tuple[Trajectory | None, dict[str, Any]]:
        plans = [own.plan for own in self.strokes]
        shown: dict[str, Any] = {"attached": self.checker.attached, "points": coloured_path(plans, self.colour)}
        shown |= {"title": self.title}
        with contextlib.suppress(NoClosedForm):
            some = self.strokes[:STRIPS]
            strips = {own.stroke.name: rotation_strip(self.checker, own.plan.path, own.plan) for own in some}
            names = {own.stroke.name: own.plan.path.names for own in some}
            shown |= {"panel": strip_panel(strips, names)}
        if self.ok:
            return self.trajectory, shown | {"certificate": self.certificate}
        # The first configuration that shows a reason
        q = next((each.q for plan_ in plans for each in plan_.blocked if each.q is not None), None)
        return None, shown if q is None else {**shown, "q": q, "check": self.checker.check(q)}


@described(eq=False)
class FollowReport(Saved):
    """The report on a job of tool paths; result of :func:`follow_job`."""

    job: ToolJob = key("the job", hidden=True)
    strokes: tuple[StrokeReport, ...] = key("the strokes in the order in which they are followed")
    motion: WholeMotion = key("the motion over all strokes, or why there is none", hidden=True)

    formats = (".json", ".md", ".csv", ".html")
    indent = 2

    @property
    def ok(self) -> bool:
        """Whether every stroke is followed, by one certified motion."""
        return self.motion.ok

    @property
    def checker(self) -> CollisionChecker:
        """The arm in its scene."""
        return self.motion.checker

    @property
    def summary(self) -> str:
        """The outcome in one sentence."""
        return self.motion.message

    @property
    def notes(self) -> tuple[str, ...]:
        """What was changed of the paths as given, and what the certificate does not cover."""
        own = [f"{each.stroke.name}: {note}" for each in self.strokes for note in each.plan.path.notes]
        covered = [*self.motion.certificate.notes] if self.ok else []
        return tuple(dict.fromkeys([*own, *covered, *filter(None, [guess_note(self._limits)])]))

    @property
    def _limits(self) -> str:
        return str(self.checker.arm.limits.acceleration_source)

    def rows(self) -> Iterator[tuple[str, ...]]:
        """The cells of :data:`COLUMNS` for each stroke."""
        for own in self.strokes:
            plan_, ok = own.plan, own.plan.ok
            yield (
                own.stroke.name, plan_.status.name, f"{plan_.duration:.2f} s" if ok else "",
                proven_millimetres(plan_.certificate.clearance) if ok else "",
                f"{plan_.deviation * 1e3:.3f} mm" if ok else "", f"{100.0 * own.speed_share:.0f} %" if ok else "",
                "" if ok else plan_.message, "; ".join(each.text for each in own.suggestions),
            )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """The report as plain values for JSON."""
        strokes = [
            {"name": own.stroke.name, "process": own.stroke.process, **own.plan.to_dict()}
            | {"suggestions": [{"change": each.text, "size": each.size} for each in own.suggestions]}
            for own in self.strokes
        ]
        found: dict[str, Any] = {"ok": self.ok, "summary": self.summary, "robot": self.checker.arm.robot.name}
        found |= {"strokes": strokes, "notes": list(self.notes)}
        if self.ok:
            found |= {"duration": self.motion.duration, "certificate": self.motion.certificate.to_dict()}
        return found

    def to_csv(self) -> str:
        """The strokes as a table with plain numbers."""
        rows = []
        for own in self.strokes:
            plan_, ok = own.plan, own.plan.ok
            figures = [plan_.duration, plan_.certificate.clearance, plan_.deviation, plan_.rotation_deviation,
                       own.speed_share, len(plan_.cuts)] if ok else [""] * 6  # fmt: skip
            reason = "" if ok else plan_.message
            texts = [reason, "\n".join(each.text for each in own.suggestions)]
            rows.append([own.stroke.name, plan_.status.name, len(plan_.path), plan_.path.length, *figures, *texts])
        return csv_text(CSV_COLUMNS, rows)

    def export_program(
        self, dialect: str, *, output: str | None = None, deviation: float | None = None, name: str = ""
    ) -> ToolPathProgram:
        """Write the whole motion as a program of a robot controller, and certify it; see :func:`export_motions`.

        Raises
        ------
        PlanFailed
            Without a motion.
        InputError
            If the language cannot express the program.
        """
        self.motion.or_raise()
        job, settings = self.job, self.job.settings
        return export_motions(
            self.checker, self.motion.motions, dialect, output=settings.program.output if output is None else output,
            name=name or (job.source.stem if job.source else "paths"), deviation=deviation,
            allowed=(job.deviation, job.rotation_deviation), free=job.free_rotation is not False,
            tool=controller_tool(self.checker.arm, settings),
        )  # fmt: skip

    def _write_page(self, path: str | Path) -> None:
        self.motion.to_html(path)

    def _view(self) -> View:
        table = Rows(COLUMNS, list(self.rows()), len(self.strokes), numbers=COLUMNS[2:6])
        lines = list[str]()
        for own, (name, result, duration, clearance, deviation, speed, *_) in zip(
            self.strokes, self.rows(), strict=True
        ):
            figures = f"{duration}, clearance {clearance}, within {deviation}, {speed} of the speed"
            lines.append(f"{name}: {result}, {figures if own.plan.ok else own.plan.message}")
            lines += [f"  suggestion: {each.text}" for each in own.suggestions]
        return View(self.summary, [table, self.notes], lines, title=self.summary)


def follow_job(
    job: ToolJob,
    *,
    checker: CollisionChecker | None = None,
    strokes: Sequence[Stroke] | None = None,
    suggestions: int = 12,
    rng: int = 0,
    colour: Literal["clearance", "speed"] = "clearance",
    progress: Progress | None = None,
) -> FollowReport:
    """Follow all strokes of a job one after another by one certified motion, or state why that is not possible.

    The motion starts and ends at the home configuration if the job states one, otherwise at the first and last stroke.

    Parameters
    ----------
    job
        The job.
    checker
        The arm in its scene with the tool; by default as :meth:`ToolJob.load_checker` loads it.
    strokes
        The strokes in the base frame of the arm, in the order in which they are followed; by default those of the job.
    suggestions
        Largest number of changed paths that are followed for each stroke without a motion, to suggest changes.
    rng
        The seed.
    colour
        What the colours of the paths on the page show.
    progress
        Called with the number of finished strokes, and of all.

    Raises
    ------
    InputError
        If a setting of the job is out of its range, or the home is not a configuration of the arm.
    """
    require_integer("suggestions", suggestions, 0)
    checker = job.load_checker() if checker is None else checker
    strokes = job.placed(checker) if strokes is None else tuple(strokes)
    arm, settings = checker.arm, {**job.options, "rng": rng}
    home: Array | None = None
    if job.settings.home:
        home = arm.limits.snap(np.array(job.settings.home_configuration(arm.joint_names, arm.home)))
    part = [job.frame] if job.frame in checker.scene else []
    # Each stroke alone, with suggestions for those that have no motion
    made = list[StrokeReport]()
    for number, stroke in enumerate(strokes):
        found = follow(checker, stroke.path, **settings)
        made.append(StrokeReport(stroke, found, suggest_changes(found, settings, part=part, budget=suggestions)))
        if progress is not None:
            progress("strokes", number + 1, len(strokes))
    whole = partial(
        WholeMotion, checker=checker, strokes=tuple(made), title=job.source.stem if job.source else "", colour=colour
    )
    failed = [own for own in made if not own.plan.ok]
    if failed:
        count = f"{len(failed)} of {len(made)} strokes cannot be followed" if len(made) > 1 else "it cannot be followed"
        message = f"{count}: {failed[0].stroke.name}: {failed[0].plan.message}"
        return FollowReport(job, tuple(made), whole(message))
    # The motions between them, and from and to the home
    motions = list[ProgramMotion]()
    stops: list[StrokeReport | None] = [*made] if home is None else [*made, None]
    here, left = home, "home"
    for own in stops:
        there, reached = (home, "home") if own is None else (own.plan.trajectory.start, own.stroke.name)
        if here is not None and there is not None:
            transit = plan(checker, here, there, rng=rng)
            if not transit.ok:
                message = f"no motion from {left} to {reached}: {transit.message}"
                return FollowReport(job, tuple(made), whole(message))
            motions.append(ProgramMotion(TRANSIT, transit.trajectory))
        if own is None:
            break
        pieces = iter(own.plan.pieces)
        for name, trajectory in own.plan.motions:
            on, piece = (own.plan.path, next(pieces)) if name == "path" else (None, None)
            motions.append(ProgramMotion(name, trajectory, on, piece, own.stroke.process))
        here, left = own.plan.trajectory.end, reached
    parts = [own.trajectory for own in motions]
    trajectory = Trajectory.join(*parts) if parts else made[0].plan.trajectory
    certificate = certify(trajectory, checker)
    count = f"{len(made)} strokes" if len(made) > 1 else f"stroke {made[0].stroke.name}"
    within = max(own.plan.deviation for own in made) * 1e3
    message = f"follows {count} in {trajectory.duration:.2f} s, within {within:.3f} mm; {certificate.message}"
    motion = whole(message, motions=tuple(motions), trajectory=trajectory, certificate=certificate)
    return FollowReport(job, tuple(made), motion)
