"""The keys of reports on sequences in JSON."""

from __future__ import annotations

from typing import Any

from pinproof.cell.sequence_result import PHASES
from pinproof.common.file_keys import (
    BOOLEAN,
    INTEGER,
    PLAIN_NUMBER,
    TEXT,
    KeyTable,
    list_of,
    mapping_to,
    required,
)

__all__ = ["SCHEMA", "SEQUENCE"]

SCHEMA = "pinproof/sequence/1"
"""The version of the JSON format, raised by breaking changes."""

WORDS: dict[str, Any] = {"type": "string"}
OPTIONAL = {"type": ["number", "null"]}
COUNT = {**INTEGER, "minimum": 0}
SECONDS = {**PLAIN_NUMBER, "minimum": 0}
NAMES = ", ".join(f"`{name}`" for name in PHASES)

PHASE = KeyTable(
    "sequence_phase",
    "A motion or a dwell time.",
    (
        required("name", {"enum": list(PHASES)}, f"one of {NAMES}; `grip` and `release` are dwell times"),
        required("start", SECONDS, "from the start of the sequence", "s"),
        required("duration", SECONDS, "duration", "s"),
        required("clearance_proven", OPTIONAL, "proven lower bound of every distance; null for a dwell time", "m"),
        required("pairs_proven", {"type": ["integer", "null"]}, "pairs of bodies proven; null for a dwell time"),
    ),
    more=True,
)

STEP = KeyTable(
    "sequence_step",
    "One pick of the sequence.",
    (
        required("name", TEXT, "name of the pick"),
        required("start", SECONDS, "from the start of the sequence", "s"),
        required("duration", SECONDS, "transit, all motions and dwell times", "s"),
        required("shortest", SECONDS, "lower bound of the duration, without obstacles", "s"),
        required("limited_by", WORDS, "what limits its longest motion"),
        required("member", WORDS, "how the grasp differs from the nominal one"),
        required("q_grasp", {"type": "array", "items": PLAIN_NUMBER}, "configuration at the grasp", "rad or m"),
        required("phases", list_of(PHASE), "the motions and dwell times in order"),
    ),
    more=True,
)

LEFT_OUT = KeyTable(
    "left_out",
    "A pick that is not part of the sequence.",
    (required("name", TEXT, "name of the pick"), required("reason", TEXT, "why it cannot be executed")),
    more=True,
)

PRECEDENCE = KeyTable(
    "precedence",
    "A pair of picks in a fixed order.",
    (
        required("before", TEXT, "name of the pick that is executed first"),
        required("after", TEXT, "name of the other pick"),
        required("reason", TEXT, "`stated`, or what geometry demands"),
    ),
    more=True,
)

SEQUENCE = KeyTable(
    "sequence",
    "A sequence of picks. Readers must accept unknown keys: they are additions of the same version.",
    (
        required("schema", {"const": SCHEMA}, "version of the format"),
        required("robot", WORDS, "name of the robot"),
        required("summary", WORDS, "the result in one line"),
        required("ok", BOOLEAN, "whether every pick is part of the sequence, and every motion is certified"),
        required("interrupted", BOOLEAN, "whether the search was interrupted"),
        required("acceleration_source", WORDS, "source of the acceleration limits"),
        required("notes", list_of(WORDS), "what the certificates do not cover"),
        required("duration", SECONDS, "all motions and dwell times", "s"),
        required("moving", SECONDS, "all motions", "s"),
        required("lower_bound", OPTIONAL, "lower bound of the time of all motions", "s"),
        required("gap", OPTIONAL, "`moving` divided by `lower_bound`, minus 1"),
        required("file_order", OPTIONAL, "lower bound of the time of all motions in the given order", "s"),
        required("nearest_neighbour", OPTIONAL, "the same in the order of the nearest neighbour", "s"),
        required("parts_per_minute", OPTIONAL, "number of picks in a minute"),
        required("clearance_proven", OPTIONAL, "smallest proven clearance of all motions", "m"),
        required("by_phase", mapping_to(SECONDS), "time of all picks by phase", "s"),
        required("closing", SECONDS, "the motion to the end", "s"),
        required("steps", list_of(STEP), "the picks in order"),
        required("left_out", list_of(LEFT_OUT), "picks that cannot be executed"),
        required("precedence", list_of(PRECEDENCE), "pairs of picks in a fixed order"),
    ),
    more=True,
)
