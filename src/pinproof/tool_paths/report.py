"""The report on a job of tool paths: its strokes with reasons and suggestions, its motion, its page and its program."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pinproof.collision import CollisionChecker, proven_millimetres
from pinproof.common.files import csv_text
from pinproof.common.results import Rows, Saved, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer
from pinproof.model import guess_note
from pinproof.picks import Proofs, WorkProfile, controller_tool, profile_work
from pinproof.tool_paths.files import ToolJob
from pinproof.tool_paths.following import TRANSIT
from pinproof.tool_paths.ordering import StrokesPlan, follow_all
from pinproof.tool_paths.pictures import pictured
from pinproof.tool_paths.program import ProgramMotion, ToolPathProgram, export_motions
from pinproof.tool_paths.result import FollowPlan
from pinproof.tool_paths.strokes import Stroke
from pinproof.tool_paths.suggestions import PathSuggestion, suggest_changes

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
class FollowReport(Saved):
    """The report on a job of tool paths; result of :func:`follow_job`."""

    job: ToolJob = key("the job", hidden=True)
    strokes: tuple[StrokeReport, ...] = key("the strokes in the order in which they are followed")
    motion: StrokesPlan = key("the motion over all strokes, or why there is none", hidden=True)
    colour: Literal["clearance", "speed"] = key("what the colours of the paths on the page show", default="clearance")

    formats = (".json", ".md", ".csv", ".html")
    indent = 2

    @property
    def ok(self) -> bool:
        """Whether every stroke is followed, by one certified motion."""
        return self.motion.ok

    @property
    def good(self) -> tuple[StrokeReport, ...]:
        """The strokes that are followed, each by itself."""
        return tuple(own for own in self.strokes if own.plan.ok)

    @property
    def judged(self) -> int:
        """Number of strokes."""
        return len(self.strokes)

    @property
    def total_time(self) -> float:
        """Seconds: the time of the motion; without one, the sum of those along the strokes that are followed."""
        return self.motion.duration if self.ok else sum(own.plan.duration for own in self.good)

    @property
    def clearance(self) -> float:
        """Metres: the proven clearance of the motion; without one, the smallest of those along strokes, or NaN."""
        if self.ok:
            return self.motion.certificate.clearance
        return min((own.plan.certificate.clearance for own in self.good), default=math.nan)

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
        return str(self.checker.group.limits.acceleration_source)

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
        found: dict[str, Any] = {"ok": self.ok, "summary": self.summary, "robot": self.checker.group.robot.name}
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
        self,
        dialect: str,
        *,
        output: str | None = None,
        deviation: float | None = None,
        dwell: float = 0.0,
        name: str = "",
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
        # The motions of the strokes, with the transits before, between and after them
        transits = iter(self.motion.transits)
        motions = list[ProgramMotion]()
        for number, own in enumerate(self.strokes):
            if number or job.settings.home:
                motions.append(ProgramMotion(TRANSIT, next(transits).trajectory))
            pieces = iter(own.plan.pieces)
            for part, trajectory in own.plan.motions:
                path, piece = (own.plan.path, next(pieces)) if part == "path" else (None, None)
                motions.append(ProgramMotion(part, trajectory, path, piece, own.stroke.process))
        motions += [ProgramMotion(TRANSIT, last.trajectory) for last in transits]
        return export_motions(
            self.checker, motions, dialect, output=settings.program.output if output is None else output,
            name=name or (job.source.stem if job.source else "paths"), deviation=deviation,
            allowed=(job.deviation, job.rotation_deviation),
            least_share=0.0 if job.speed_tolerance is None else 1.0 - job.speed_tolerance,
            free=job.free_rotation is not False, tool=controller_tool(self.checker.arm, settings), dwell=dwell,
        )  # fmt: skip

    def _write_page(self, path: str | Path) -> None:
        from pinproof.viewer import write_html

        checker, motion = self.checker, self.motion
        content = pictured({own.stroke.name: own.plan for own in self.strokes}, self.colour)
        if self.ok:
            content["certificate"] = motion.certificate
        title = self.job.source.stem if self.job.source else ""
        shown = motion.trajectory if self.ok else None
        write_html(path, checker.group, checker.scene, shown, title=title, checker=checker, **content)

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
    suggestions: int = 12,
    rng: int = 0,
    colour: Literal["clearance", "speed"] = "clearance",
) -> FollowReport:
    """Follow all strokes of a job by one certified motion, or state why that is not possible.

    The motion starts and ends at the home configuration if the job states one, otherwise at the first and last stroke.

    Parameters
    ----------
    job
        The job.
    checker
        The arm in its scene with the tool; by default as :meth:`ToolJob.load_checker` loads it.
    suggestions
        Largest number of changed paths that are followed for each stroke without a motion, to suggest changes.
    rng
        The seed.
    colour
        What the colours of the paths on the page show.

    Raises
    ------
    InputError
        If a setting of the job is out of its range, or the home is not a configuration of the arm.
    """
    require_integer("suggestions", suggestions, 0)
    checker = job.load_checker() if checker is None else checker
    arm, home = checker.group, None
    if job.settings.home:
        home = np.array(job.settings.home_configuration(arm.joint_names, arm.home))
    placed = job.placed(checker)
    motion = follow_all(checker, placed, home=home, rng=rng, **job.options)
    # Those with a motion in their order, and changes that help the others
    strokes = [StrokeReport(own.stroke, own.plan) for own in motion.steps]
    part = [job.frame] if job.frame in checker.scene else []
    for name, plan in motion.failed:
        changes = suggest_changes(plan, {**job.options, "rng": rng}, part=part, budget=suggestions)
        strokes.append(StrokeReport(next(own for own in placed if own.name == name), plan, changes))
    return FollowReport(job, tuple(strokes), motion, colour)


def profile_job(follow: Callable[[], FollowReport]) -> WorkProfile:
    """Run a call of :func:`follow_job` in this process, and measure its stages and the bodies of its cell.

    Parameters
    ----------
    follow
        The call, for example ``lambda: pp.tool_paths.follow_job(job)``.
    """

    def proofs(report: FollowReport) -> Proofs:
        curves = [own.plan.trajectory for own in report.good]
        points = np.concatenate([own.stroke.path.poses[:, :3, 3] for own in report.strokes])
        return Proofs(report.checker, curves, report.checker.group.home, points)

    return profile_work(follow, proofs)
