"""The keys of reports on sequences in JSON."""

from __future__ import annotations

from pinproof.cell.sequencing.sequence_result import PHASES
from pinproof.common.file_keys import (
    ANY_TEXT,
    BOOLEAN,
    NOT_NEGATIVE,
    OPTIONAL_NUMBER,
    PLAIN_NUMBER,
    TEXT,
    list_of,
    mapping_to,
    report_table,
    required,
)

SCHEMA = "pinproof/sequence/1"
"""The version of the JSON format, raised by breaking changes."""

NAMES = ", ".join(f"`{name}`" for name in PHASES)

PHASE = report_table(
    "sequence_phase",
    "A motion or a dwell time.",
    required("name", {"enum": list(PHASES)}, f"one of {NAMES}; `grip` and `release` are dwell times"),
    required("start", NOT_NEGATIVE, "from the start of the sequence", "s"),
    required("duration", NOT_NEGATIVE, "duration", "s"),
    required("clearance_proven", OPTIONAL_NUMBER, "proven lower bound of every distance; null for a dwell time", "m"),
    required("pairs_proven", {"type": ["integer", "null"]}, "pairs of bodies proven; null for a dwell time"),
)

STEP = report_table(
    "sequence_step",
    "One pick of the sequence.",
    required("name", TEXT, "name of the pick"),
    required("start", NOT_NEGATIVE, "from the start of the sequence", "s"),
    required("duration", NOT_NEGATIVE, "transit, all motions and dwell times", "s"),
    required("shortest", NOT_NEGATIVE, "lower bound of the duration, without obstacles", "s"),
    required("limited_by", ANY_TEXT, "what limits its longest motion"),
    required("member", ANY_TEXT, "how the grasp differs from the nominal one"),
    required("q_grasp", {"type": "array", "items": PLAIN_NUMBER}, "configuration at the grasp", "rad or m"),
    required("phases", list_of(PHASE), "the motions and dwell times in order"),
)

LEFT_OUT = report_table(
    "left_out",
    "A pick that is not part of the sequence.",
    required("name", TEXT, "name of the pick"),
    required("reason", TEXT, "why it cannot be executed"),
)

PRECEDENCE = report_table(
    "precedence",
    "A pair of picks in a fixed order.",
    required("before", TEXT, "name of the pick that is executed first"),
    required("after", TEXT, "name of the other pick"),
    required("reason", TEXT, "`stated`, or what geometry demands"),
)

SEQUENCE = report_table(
    "sequence",
    "A sequence of picks. Readers must accept unknown keys: they are additions of the same version.",
    required("schema", {"const": SCHEMA}, "version of the format"),
    required("robot", ANY_TEXT, "name of the robot"),
    required("summary", ANY_TEXT, "the result in one line"),
    required("ok", BOOLEAN, "whether every pick is part of the sequence, and every motion is certified"),
    required("interrupted", BOOLEAN, "whether the search was interrupted"),
    required("acceleration_source", ANY_TEXT, "source of the acceleration limits"),
    required("notes", list_of(ANY_TEXT), "what the certificates do not cover"),
    required("duration", NOT_NEGATIVE, "all motions and dwell times", "s"),
    required("moving", NOT_NEGATIVE, "all motions", "s"),
    required("lower_bound", OPTIONAL_NUMBER, "lower bound of the time of all motions", "s"),
    required("gap", OPTIONAL_NUMBER, "`moving` divided by `lower_bound`, minus 1"),
    required("file_order", OPTIONAL_NUMBER, "lower bound of the time of all motions in the given order", "s"),
    required("nearest_neighbour", OPTIONAL_NUMBER, "the same in the order of the nearest neighbour", "s"),
    required("parts_per_minute", OPTIONAL_NUMBER, "number of picks in a minute"),
    required("clearance_proven", OPTIONAL_NUMBER, "smallest proven clearance of all motions", "m"),
    required("by_phase", mapping_to(NOT_NEGATIVE), "time of all picks by phase", "s"),
    required("closing", NOT_NEGATIVE, "the motion to the end", "s"),
    required("steps", list_of(STEP), "the picks in order"),
    required("left_out", list_of(LEFT_OUT), "picks that cannot be executed"),
    required("precedence", list_of(PRECEDENCE), "pairs of picks in a fixed order"),
)
