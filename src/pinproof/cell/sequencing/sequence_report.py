"""The report on a sequence as JSON, as a table for spreadsheets and as Markdown."""

from __future__ import annotations

from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any

from pinproof.cell.sequencing.sequence_page import write_sequence_page
from pinproof.cell.sequencing.sequence_result import PHASES, LeftOut, SequenceResult, cycle_time
from pinproof.common.files import csv_text, json_text, save_as
from pinproof.common.results import Rows, markdown
from pinproof.common.structs import (
    ANY_TEXT,
    BOOLEAN,
    INTEGER,
    NOT_NEGATIVE,
    OPTIONAL_NUMBER,
    PLAIN_NUMBER,
    TEXT,
    choice,
    list_of,
    mapping_to,
    optional,
    report_table,
    required,
    schema_version,
    table_of,
)

COLUMNS = ("position", "pick", "start", "duration", *PHASES, "shortest", "clearance_proven", "limited_by", "left_out")
"""The columns of the table; times in seconds, the clearance in metres."""


SEQUENCE_SUFFIXES = (".json", ".csv", ".md", ".html")
"""The file types of :func:`save_sequence`."""


def save_sequence(result: SequenceResult, path: str | Path) -> None:
    """Write a sequence as ``.json``, ``.csv``, ``.md`` or ``.html``.

    Raises
    ------
    InputError
        If the suffix is unknown.
    FileError
        If the file cannot be written.
    """
    formats = {
        ".json": lambda: json_text(sequence_dict(result), indent=2),
        ".csv": lambda: _csv(result),
        ".md": lambda: _markdown(result),
        ".html": lambda: write_sequence_page(result, path),
    }
    save_as(path, formats)


PHASE = report_table(
    "sequence_phase",
    "A motion or a dwell time.",
    required(
        "name",
        choice(*PHASES),
        f"one of {', '.join(f'`{name}`' for name in PHASES)}; `grip` and `release` are dwell times",
    ),
    required("start", NOT_NEGATIVE, "from the start of the sequence", "s"),
    required("duration", NOT_NEGATIVE, "duration", "s"),
    required(
        "clearance_proven",
        OPTIONAL_NUMBER,
        "proven lower bound of every distance; null for a dwell time",
        "m",
        lambda phase: None if phase.certificate is None else phase.certificate.clearance,
    ),
    required(
        "pairs_proven",
        optional(INTEGER),
        "pairs of bodies proven; null for a dwell time",
        get=lambda phase: None if phase.certificate is None else phase.certificate.pairs,
    ),
)

STEP = report_table(
    "sequence_step",
    "One pick of the sequence.",
    required("name", TEXT, "name of the pick", get=lambda row: row[1].name),
    required("start", NOT_NEGATIVE, "from the start of the sequence", "s", lambda row: row[1].start),
    required("duration", NOT_NEGATIVE, "transit, all motions and dwell times", "s", lambda row: row[1].duration),
    required(
        "shortest", NOT_NEGATIVE, "lower bound of the duration, without obstacles", "s", lambda row: row[1].shortest
    ),
    required("limited_by", ANY_TEXT, "what limits its longest motion", get=lambda row: row[1].limited_by),
    required("member", ANY_TEXT, "how the grasp differs from the nominal one", get=lambda row: row[0].verdict.member),
    required(
        "q_grasp",
        list_of(PLAIN_NUMBER),
        "configuration at the grasp",
        "rad or m",
        lambda row: () if row[0].verdict.q_grasp is None else row[0].verdict.q_grasp,
    ),
    required("phases", list_of(PHASE), "the motions and dwell times in order", get=lambda row: row[0].phases),
)
"""Of a step and its time."""

PRECEDENCE = report_table(
    "precedence",
    "A pair of picks in a fixed order.",
    required("before", TEXT, "name of the pick that is executed first", get=itemgetter(0)),
    required("after", TEXT, "name of the other pick", get=itemgetter(1)),
    required("reason", TEXT, "`stated`, or what geometry demands", get=itemgetter(2)),
)

SEQUENCE = report_table(
    "sequence",
    "A sequence of picks. Readers must accept unknown keys: they are additions of the same version.",
    schema_version("pinproof/sequence/1"),
    required("robot", ANY_TEXT, "name of the robot", get=attrgetter("setup.checker.arm.robot.name")),
    required("summary", ANY_TEXT, "the result in one line", get=attrgetter("message")),
    required("ok", BOOLEAN, "whether every pick is part of the sequence, and every motion is certified"),
    required("interrupted", BOOLEAN, "whether the search was interrupted"),
    required(
        "acceleration_source",
        ANY_TEXT,
        "source of the acceleration limits",
        get=attrgetter("setup.checker.arm.limits.acceleration_source"),
    ),
    required(
        "notes",
        list_of(ANY_TEXT),
        "what the certificates do not cover",
        get=lambda result: result.setup.not_covered({step.pick.carried is not None for step in result.steps}),
    ),
    required("duration", NOT_NEGATIVE, "all motions and dwell times", "s"),
    required("moving", NOT_NEGATIVE, "all motions", "s"),
    required("lower_bound", OPTIONAL_NUMBER, "lower bound of the time of all motions", "s"),
    required("gap", OPTIONAL_NUMBER, "`moving` divided by `lower_bound`, minus 1"),
    required("file_order", OPTIONAL_NUMBER, "lower bound of the time of all motions in the given order", "s"),
    required("nearest_neighbour", OPTIONAL_NUMBER, "the same in the order of the nearest neighbour", "s"),
    required("parts_per_minute", OPTIONAL_NUMBER, "number of picks in a minute"),
    required(
        "clearance_proven", OPTIONAL_NUMBER, "smallest proven clearance of all motions", "m", attrgetter("clearance")
    ),
    required(
        "by_phase",
        mapping_to(NOT_NEGATIVE),
        "time of all picks by phase",
        "s",
        lambda result: cycle_time(result).by_phase,
    ),
    required("closing", NOT_NEGATIVE, "the motion to the end", "s", lambda result: cycle_time(result).closing),
    required(
        "steps",
        list_of(STEP),
        "the picks in order",
        get=lambda result: zip(result.steps, cycle_time(result).picks, strict=True),
    ),
    required("left_out", list_of(table_of(LeftOut)), "picks that cannot be executed"),
    required("precedence", list_of(PRECEDENCE), "pairs of picks in a fixed order", get=attrgetter("precedence.rows")),
)


def sequence_dict(result: SequenceResult) -> dict[str, Any]:
    """The sequence as plain values for JSON; see the manual page of the format."""
    return SEQUENCE.write(result)


def _csv(result: SequenceResult) -> str:
    """One row for each pick in order, then one for each that is left out, with the columns :data:`COLUMNS`."""
    rows: list[tuple[object, ...]] = []
    for number, (step, time) in enumerate(zip(result.steps, cycle_time(result).picks, strict=True), start=1):
        phases = (time.phases.get(name, "") for name in PHASES)
        clearance = OPTIONAL_NUMBER.write(step.verdict.clearance)
        limits = time.shortest, clearance, time.limited_by
        rows.append((number, time.name, time.start, time.duration, *phases, *limits, ""))
    blank = [""] * (len(COLUMNS) - 3)
    rows += [("", pick.name, *blank, pick.reason) for pick in result.left_out]
    return csv_text(COLUMNS, rows)


def _markdown(result: SequenceResult) -> str:
    """The sequence as a table in Markdown."""
    rows: list[tuple[object, ...]] = [
        (number, time.name, f"{time.start:.2f} s", f"{time.duration:.2f} s", time.limited_by)
        for number, time in enumerate(cycle_time(result).picks, start=1)
    ]
    rows += [("", pick.name, "", "", f"left out: {pick.reason}") for pick in result.left_out]
    table = Rows(("", "pick", "start", "duration", "limited by"), rows, numbers={"", "start", "duration"})
    return markdown(f"# Sequence of {result.setup.checker.arm.robot.name}", result.message, table)
