"""The report on a list of picks as a table, Markdown, CSV, JSON and HTML, and the row of values of a verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from pinproof.collision import Scene, proven_millimetres
from pinproof.common import theme
from pinproof.common.files import csv_text, file_stems
from pinproof.common.results import Rows, Saved, View, Written, markdown
from pinproof.common.structs import key, reported, struct
from pinproof.common.validation import optional_module
from pinproof.errors import InputError
from pinproof.model import Arm, guess_note
from pinproof.motion import MotionProgram
from pinproof.picks.input.pick import Pick
from pinproof.picks.input.picks import PickProblem, Picks
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.verdict import PickStatus, PickVerdict, Stage
from pinproof.picks.report.page import seconds_text, write_page
from pinproof.picks.report.program_details import with_return
from pinproof.picks.report.program_export import ExportedProgram
from pinproof.picks.report.program_files import write_programs


def problem_row(problem: PickProblem) -> dict[str, Any]:
    """A row of the picks file that could not be read, as plain values for JSON."""
    judged = {"verdict": PickStatus.UNREADABLE.value, "failed_at": Stage.INPUT.value}
    return {"name": problem.name, **judged, "reason": problem.reason, "row": problem.row}


FIGURES = (
    "clearance, duration and torque are those of the certified motion of the robot; the column of a language has the "
    "moves and the duration of the program of its controller, with the return to home, which has a certificate of its "
    "own; the percentage compares it with the same motions as certified"
)
"""Which figures of a report are of the motion, and which of programs."""

Column: TypeAlias = Callable[[PickVerdict], object]
"""A column of a report: its value for a verdict."""


COLUMNS = ("pick", "verdict", "failed at", "clearance", "duration", "reason", "remedy")

POSE_COLUMNS = ("x", "y", "z", "roll", "pitch", "yaw")
SCORE_COLUMNS = ("score", "clearance_part", "limit_margin_part", "manipulability_part", "duration_part")

CSV_COLUMNS = (
    "name", "verdict", "failed_at", "clearance_proven", "duration", "grasp_time", "release_time", "frame",
    *POSE_COLUMNS, "member", *SCORE_COLUMNS, "motions", "reason", "remedy", "refuted",
)  # fmt: skip
"""The columns of the CSV, with plain numbers in metres, seconds and radians; cells without a value are empty.

``motions`` has the names of the parts in order. ``refuted`` has one line for each configuration.
"""


SCHEMA = "pinproof/picks/2"
"""The version of the JSON format, raised by breaking changes.

Version 2 adds ``member``, ``refuted``, ``release_time``, ``score`` and ``motions`` to each pick.
"""


@struct(
    "report",
    version=SCHEMA,
    first=("robot", "summary", "ok", "acceleration_source", "notes", "picks", "problems"),
    written=True,
    eq=False,
)
class PickReport(Saved, Written):
    """A report on picks. Readers must accept unknown keys: they are additions of the same version."""

    not_pickled = ("setup",)

    robot: str = key("name of the robot")
    verdicts: tuple[PickVerdict, ...] = key("the verdicts in the order of the file", name="picks")
    problems: tuple[PickProblem, ...] = key("rows that could not be read")
    acceleration_source: str = key("source of the acceleration limits")
    notes: tuple[str, ...] = key("what the verdicts do not cover, and what occupancy grids assume", default=())
    setup: PickSetup | None = key(
        "the setup that the picks were judged with, used for the HTML page; None if it is not known",
        default=None,
        hidden=True,
    )
    not_judged: int = key(
        "number of picks without a verdict, because the run was interrupted", default=0, minimum=0, added=True
    )

    exported: tuple[ExportedProgram, ...] = key(
        "the programs of controllers that :meth:`export_programs` wrote", default=(), added=True
    )

    columns: Mapping[str, Column] = key(
        "further columns of the table, of the CSV and of the page: a function of the verdict for each name",
        default_factory=dict,
        hidden=True,
    )

    formats = (".json", ".md", ".csv", ".html")
    indent = 2

    def with_columns(self, columns: Mapping[str, Column]) -> PickReport:
        """The same report with further columns, such as ``{"area": lambda verdict: ...}``.

        A cell is the value as text; it is empty where the function returns None, and for rows that could not be read.

        Raises
        ------
        InputError
            If a name is in use, or the value for it is not a function.
        """
        for name, column in columns.items():
            if name in (*COLUMNS, *CSV_COLUMNS) or not callable(column):
                reason = "is in use" if callable(column) else f"needs a function of the verdict, not {column!r:.80}"
                raise InputError(f"the name {name!r} of a column {reason}")
        return replace(self, columns={**self.columns, **columns})

    def _view(self) -> View:
        rows = self.rows()
        lines = (
            ", ".join(filter(None, (f"{name}: {verdict}{stage and f' at {stage}'}", clearance, duration, reason, *own)))
            for name, verdict, stage, clearance, duration, reason, _, *texts in rows
            for own in ([f"{column} {text}" for column, text in zip(self.columns, texts, strict=True) if text],)
        )
        notes = [f"not covered: {note}" for note in self.notes]
        if self.exported:
            notes.append(FIGURES)
        notes.append(self.guessed_accelerations or f"Acceleration limits: {self.acceleration_source}")
        table = Rows((*COLUMNS, *self.columns), rows, colours=[theme.VERDICTS[row[1]] for row in rows])
        return View(f"{self.robot}: {self.summary}", [table, notes], lines, len(rows))

    @property
    def good(self) -> tuple[PickVerdict, ...]:
        """The good picks, in order."""
        return tuple(verdict for verdict in self.verdicts if verdict.ok)

    @property
    def judged(self) -> int:
        """Number of picks with a verdict."""
        return len(self.verdicts)

    @property
    def total_time(self) -> float:
        """Seconds: the sum of the times of all good picks."""
        return float(sum(verdict.trajectory.duration for verdict in self.good if verdict.trajectory is not None))

    @property
    def clearance(self) -> float:
        """Metres: the smallest proven clearance of all motions of good picks; NaN without any."""
        return min((verdict.clearance for verdict in self.good), default=float("nan"))

    @reported()
    def ok(self) -> bool:
        """Whether there is a pick, every pick is good, and every row was read."""
        return 0 < len(self.good) == len(self.verdicts) and not self.problems and not self.not_judged

    @property
    def guessed_accelerations(self) -> str:
        """A sentence for durations that follow from guessed acceleration limits; empty if all limits are known."""
        return guess_note(self.acceleration_source)

    @reported()
    def summary(self) -> str:
        """One line: the number of good picks, and the stages at which others fail."""
        # Rows that could not be read fail at the input
        total = len(self.verdicts) + len(self.problems) + self.not_judged
        stages = Counter(verdict.failed.value for verdict in self.verdicts if verdict.failed is not None)
        stages += Counter(input=len(self.problems))
        failed = ", ".join(f"{count} at {stage}" for stage, count in stages.items())
        left = f"; {self.not_judged} not judged, because the run was interrupted" if self.not_judged else ""
        return f"{len(self.good)} of {total} picks good" + (f"; failed: {failed}" if failed else "") + left

    def _rows(self) -> list[tuple[dict[str, Any], PickVerdict | None, tuple[object, ...]]]:
        """The values for JSON of each verdict and, after them, of each unreadable row, with the cells of the user."""
        columns = self.columns.values()
        judged = [(verdict.to_dict(), verdict, tuple(own(verdict) for own in columns)) for verdict in self.verdicts]
        return [*judged, *((problem_row(problem), None, (None,) * len(columns)) for problem in self.problems)]

    def rows(self) -> list[tuple[str, ...]]:
        """The rows of the table with the columns :data:`COLUMNS` and those of the user; unreadable rows are last."""
        table: list[tuple[str, ...]] = []
        for row, verdict, own in self._rows():
            clearance = proven_millimetres(verdict.clearance) if verdict is not None and verdict.motions else ""
            first = (
                row["name"],
                row["verdict"],
                row.get("failed_at") or "",
                clearance,
                seconds_text(row.get("duration")),
            )
            texts = ("" if value is None else str(value) for value in own)
            table.append((*first, row["reason"], row.get("remedy", ""), *texts))
        return table

    def to_markdown(self) -> str:
        """The summary and the table in Markdown."""
        source = self.guessed_accelerations or f"Acceleration limits: {self.acceleration_source}"
        notes = ("Not covered:", self.notes) if self.notes else ()
        return markdown(
            f"**{self.robot}**: {self.summary}", Rows((*COLUMNS, *self.columns), self.rows()), source, *notes
        )

    def to_csv(self) -> str:
        """The table with plain numbers in the columns :data:`CSV_COLUMNS`, for spreadsheets and data frames."""
        return csv_text((*CSV_COLUMNS, *self.columns), self._cells())

    def to_pandas(self) -> Any:
        """The table of :meth:`to_csv` as a ``pandas.DataFrame`` with a row for each pick.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        pandas = optional_module("pandas", "to_pandas")
        return pandas.DataFrame(self._cells(), columns=[*CSV_COLUMNS, *self.columns])

    def _cells(self) -> list[list[Any]]:
        """The cells of the columns :data:`CSV_COLUMNS` and those of the user; None where there is no value."""
        table = []
        for row, _, own in self._rows():
            score = row.get("score", {})
            cells = {
                **row,
                **dict(zip(POSE_COLUMNS, (*row.get("xyz", ()), *row.get("rpy", ())), strict=False)),
                **{name if name == "score" else f"{name}_part": value for name, value in score.items()},
                "score": score.get("score"),
                "motions": " ".join(motion["name"] for motion in row.get("motions", ())),
                "refuted": "\n".join(row.get("refuted", ())),
            }
            table.append([*(cells.get(column) for column in CSV_COLUMNS), *own])
        return table

    def save(
        self,
        path: str | Path,
        *,
        arm: Arm | None = None,
        scene: Scene | None = None,
        picks: Picks | None = None,
        title: str | None = None,
        live: bool | None = None,
    ) -> None:
        """Write the report as JSON, Markdown, CSV or HTML, according to the suffix of the path.

        The file is written completely or not at all. The HTML page has a table, a 3D view with every grasp, and the
        motions of the good picks.

        Parameters
        ----------
        path
            The file; its suffix must be one of :data:`REPORT_SUFFIXES`: ``.json``, ``.md``, ``.csv`` or ``.html``.
        arm, scene, picks
            Only for HTML: the arm, the scene, and the picks, whose tool and home are drawn. By default those that the
            picks were judged with; a report that was not made by :func:`pinproof.validate_picks` does not have them.
        title
            Only for HTML: the title of the page; the default is the name of the robot.
        live
            Only for HTML: whether the page computes. A grasp or the base of the robot can be moved in it, and reach,
            limits, self-collision and collision at the grasp are judged again. By default it does if that enlarges it
            by 1 MB at most; picks on a conveyor are not judged again.

        Raises
        ------
        InputError
            For another suffix, or if ``arm``, ``scene`` or ``picks`` is needed and missing.
        ViewerError
            If no link of the robot has geometry to draw.
        FileError
            If the file cannot be written.
        """
        self._save(path, arm=arm, scene=scene, picks=picks, title=title, live=live)

    def _write_page(self, path: str | Path, **settings: Any) -> None:
        rows = self._rows()
        counts = Counter(values["verdict"] for values, *_ in rows)
        settings |= {"columns": {name: [own[k] for *_, own in rows] for k, name in enumerate(self.columns)}}
        write_page(path, self, ((values, verdict) for values, verdict, _ in rows), counts, **settings)

    def programs(self, *, grip_dwell: float = 0.0, release_dwell: float = 0.0) -> tuple[MotionProgram, ...]:
        """The programs of the good picks, with the dwell times of :meth:`pinproof.picks.PickVerdict.program`."""
        tcp = "" if self.setup is None else self.setup.checker.arm.tcp
        return tuple(
            verdict.program(grip_dwell=grip_dwell, release_dwell=release_dwell, robot=self.robot, tcp=tcp)
            for verdict in self.good
        )

    def save_programs(
        self, folder: str | Path, *, grip_dwell: float = 0.0, release_dwell: float = 0.0
    ) -> tuple[Path, ...]:
        """Write the program of each good pick to ``NAME.program.json`` in an existing folder; return the files.

        Raises
        ------
        InputError
            If a dwell time is negative.
        FileError
            If a file cannot be written.
        """
        programs = self.programs(grip_dwell=grip_dwell, release_dwell=release_dwell)
        stems = file_stems(program.name for program in programs)
        paths = tuple(Path(folder) / f"{stem}.program.json" for stem in stems)
        for path, program in zip(paths, programs, strict=True):
            program.save(path)
        return paths

    def export_programs(
        self,
        folder: str | Path,
        language: str,
        *,
        output: str | None = None,
        deviation: float | None = None,
        grip_dwell: float = 0.0,
        release_dwell: float = 0.0,
    ) -> tuple[PickReport, list[str]]:
        """Write each good pick as a program of a robot controller, if what its text executes is proven.

        After the part is put down, a program returns to home, unless the picks file states otherwise.

        Parameters
        ----------
        folder
            The existing folder.
        language, output, deviation
            As for :func:`pinproof.picks.export_picks`; by default the output of the language that closes a gripper.
        grip_dwell, release_dwell
            Seconds, as for :meth:`programs`.

        Returns
        -------
        tuple[PickReport, list[str]]
            The report with the programs that were written, which are a further column too, and what is not covered or
            not written, in sentences.
        """
        if self.setup is None:
            raise InputError("the report has no set-up in which a program could be certified")
        settings, notes = self.setup.shared.program, list[str]()
        picks = list[tuple[PickSetup, Pick, MotionProgram]]()
        programs = self.programs(grip_dwell=grip_dwell, release_dwell=release_dwell)
        for verdict, program in zip(self.good, programs, strict=True):
            if settings.home and verdict.pick.place is not None:
                program, reason = with_return(self.setup, verdict.pick, program)
                notes += [f"the program of {program.name} does not return to home: {reason}"] if reason else []
            picks.append((self.setup, verdict.pick, program))
        written, more = write_programs(folder, language, picks, output=output, deviation=deviation, main=settings.main)
        shown = {own.pick: str(own) for own in written}
        report = self.with_columns({language: lambda verdict: shown.get(verdict.pick.name)})
        return replace(report, exported=(*self.exported, *written)), [*notes, *more]

    def save_folder(
        self,
        folder: str | Path,
        *,
        grip_dwell: float = 0.0,
        release_dwell: float = 0.0,
        pages: bool = False,
        live: bool | None = None,
    ) -> tuple[str, ...]:
        """Write the report in all formats, and for each good pick its motion, its program and, if wanted, its pages.

        ``live`` is that of :meth:`save`, also for the pages.

        Returns
        -------
        tuple[str, ...]
            The names without suffix of the files of each good pick, in order.
        """
        folder = Path(folder)
        for kind in REPORT_SUFFIXES:
            self.save(folder / f"report{kind}", live=live)
        self.save_programs(folder, grip_dwell=grip_dwell, release_dwell=release_dwell)
        stems = file_stems(verdict.pick.name for verdict in self.good)
        for verdict, stem in zip(self.good, stems, strict=True):
            verdict.save_motion(folder / f"{stem}.json")
            if pages and self.setup is not None:
                write_motion_pages(verdict, self.setup.checker.arm, folder / f"{stem}.html", live=live)
        return tuple(stems)


def write_motion_pages(verdict: PickVerdict, arm: Arm, path: str | Path, *, live: bool | None = None) -> list[Path]:
    """Write a page of the motion of a good pick, or one for each part if the attached bodies change along it.

    The files are ``path``, or ``NAME_1_transit.html`` and so on; they are returned. ``live`` is that of
    :func:`pinproof.write_html`.
    """
    from pinproof.viewer import write_html

    path, pages, single = Path(path), [], len(verdict.motions) == 1
    for number, part in enumerate(verdict.motions, start=1):
        pages.append(path if single else path.with_name(f"{path.stem}_{number}_{part.name}{path.suffix}"))
        write_html(
            pages[-1],
            arm.with_held(part.held),
            part.scene,
            part.trajectory,
            certificate=part.certificate,
            attached=part.attached,
            live=live,
            title=f"{arm.robot.name}: {verdict.pick.name}" + ("" if single else f", {part.name}"),
        )
    return pages


REPORT_SUFFIXES = PickReport.formats
"""The suffixes of all formats; ``.html`` is the page with a 3D view."""
