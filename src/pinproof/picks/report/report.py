"""A report on picks: as a table, as Markdown, as CSV and as JSON."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pinproof.collision.certificate import proven_millimetres
from pinproof.common.files import write_text_whole
from pinproof.errors import InputError
from pinproof.picks.pick import PickProblem
from pinproof.picks.report.rows import problem_row, proofs, verdict_row
from pinproof.picks.verdict import PickVerdict

__all__ = ["COLUMNS", "CSV_COLUMNS", "SCHEMA", "SUFFIXES", "PickReport"]

COLUMNS = ("pick", "verdict", "failed at", "clearance", "duration", "reason", "remedy")

POSE_COLUMNS = ("x", "y", "z", "roll", "pitch", "yaw")
SCORE_COLUMNS = ("score", "clearance_part", "limit_margin_part", "manipulability_part", "duration_part")

CSV_COLUMNS = (
    "name", "verdict", "failed_at", "clearance_proven", "duration", "grasp_time", "release_time", "frame",
    *POSE_COLUMNS, "member", *SCORE_COLUMNS, "motions", "reason", "remedy", "refuted",
)  # fmt: skip
"""Plain numbers in metres, seconds and radians; empty where there is none.

``motions`` are the names of the parts in order. Of ``refuted``, each configuration stands on a line of the cell.
"""

SUFFIXES = (".json", ".md", ".csv")

SCHEMA = "pinproof/picks/2"
"""The form of the JSON; ``schema.json`` beside this file is its JSON Schema. The number counts breaking changes.

2: a pick also tells its ``member``, ``refuted``, ``release_time``, ``score`` and ``motions``.
"""


@dataclass(frozen=True, eq=False)
class PickReport:
    """Verdicts on a list of picks.

    Parameters
    ----------
    robot
        The robot's name.
    verdicts
        One a pick, in the order of the list.
    problems
        Rows of the picks file that could not be read.
    acceleration_source
        Where the acceleration limits of the timing came from.
    notes
        What no verdict covers, in sentences.
    """

    robot: str
    verdicts: tuple[PickVerdict, ...]
    problems: tuple[PickProblem, ...]
    acceleration_source: str
    notes: tuple[str, ...] = ()

    @property
    def good(self) -> tuple[PickVerdict, ...]:
        """The good picks, in order."""
        return tuple(verdict for verdict in self.verdicts if verdict.ok)

    @property
    def ok(self) -> bool:
        """Whether every row is a good pick; without any there is nothing to say yes to."""
        return 0 < len(self.good) == len(self.verdicts) and not self.problems

    @property
    def summary(self) -> str:
        """One line: how many are good, and where the others fail."""
        total = len(self.verdicts) + len(self.problems)
        stages: dict[str, int] = {}
        for verdict in self.verdicts:
            if verdict.failed is not None:
                stages[verdict.failed.value] = stages.get(verdict.failed.value, 0) + 1
        if self.problems:
            stages["input"] = stages.get("input", 0) + len(self.problems)
        failed = ", ".join(f"{count} at {stage}" for stage, count in stages.items())
        return f"{len(self.good)} of {total} picks good" + (f"; failed: {failed}" if failed else "")

    def rows(self) -> list[tuple[str, ...]]:
        """The table, row by row, in the columns :data:`COLUMNS`; unreadable rows last."""
        table: list[tuple[str, ...]] = []
        for verdict in self.verdicts:
            clearances = [certificate.clearance for certificate in proofs(verdict)]
            clearance = proven_millimetres(min(clearances)) if clearances else ""
            duration = "" if verdict.trajectory is None else f"{verdict.trajectory.duration:.2f} s"
            stage = "" if verdict.failed is None else verdict.failed.value
            first = (verdict.pick.name, verdict.status.value, stage, clearance, duration)
            table.append((*first, verdict.reason, verdict.remedy))
        table.extend((problem.name, "unreadable", "input", "", "", problem.reason, "") for problem in self.problems)
        return table

    def to_markdown(self) -> str:
        """The summary and the table in Markdown."""
        lines = [f"**{self.robot}**: {self.summary}", "", _line(COLUMNS), _line(("---",) * len(COLUMNS))]
        lines += [_line(row) for row in self.rows()]
        lines += ["", f"Acceleration limits: {self.acceleration_source}"]
        lines += ["", "Not covered:", "", *(f"- {note}" for note in self.notes)] if self.notes else []
        return "\n".join(lines) + "\n"

    def to_csv(self) -> str:
        """The table with plain numbers in the columns :data:`CSV_COLUMNS`, for spreadsheets and data frames."""
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(CSV_COLUMNS)
        for row in (*map(verdict_row, self.verdicts), *map(problem_row, self.problems)):
            cells = _cells(row)
            lines.writerow("" if cells.get(column) is None else cells[column] for column in CSV_COLUMNS)
        return text.getvalue()

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain values for JSON; lengths in metres, angles in radians, times in seconds.

        A clearance of None beside a certificate's ``pairs_proven`` is unbounded: nothing there can touch.
        """
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "summary": self.summary,
            "ok": self.ok,
            "acceleration_source": self.acceleration_source,
            "notes": list(self.notes),
            "picks": [verdict_row(verdict) for verdict in self.verdicts],
            "problems": [{"row": p.row, "name": p.name, "reason": p.reason} for p in self.problems],
        }

    def save(self, path: str | Path) -> None:
        """Write the report, whole or not at all: JSON, Markdown or CSV by the ending of its name.

        Raises
        ------
        InputError
            For another ending.
        FileError
            For a place that cannot be written to.
        """
        kind = Path(path).suffix.lower()
        if kind not in SUFFIXES:
            raise InputError(f"{path}: a report is a file of {', '.join(SUFFIXES)}, not {kind or 'without ending'}")
        if kind == ".json":
            text = json.dumps(self.to_dict(), indent=2, allow_nan=False) + "\n"
        else:
            text = self.to_markdown() if kind == ".md" else self.to_csv()
        write_text_whole(path, text)


def _cells(row: dict[str, Any]) -> dict[str, Any]:
    """A row as one value a column."""
    placed = zip(POSE_COLUMNS, (*row.get("xyz", ()), *row.get("rpy", ())), strict=False)
    score = {name if name == "score" else f"{name}_part": value for name, value in row.get("score", {}).items()}
    motions = " ".join(motion["name"] for motion in row.get("motions", ()))
    return {
        **row,
        **dict(placed),
        "score": None,
        **score,
        "motions": motions,
        "refuted": "\n".join(row.get("refuted", ())),
    }


def _line(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"
