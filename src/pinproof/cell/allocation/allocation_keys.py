"""The keys of reports on picks of several arms in JSON."""

from __future__ import annotations

from pinproof.cell.allocation.arm_program import WAIT
from pinproof.cell.sequencing.sequence_keys import LEFT_OUT
from pinproof.cell.sequencing.sequence_result import PHASES
from pinproof.common.file_keys import (
    ANY_TEXT,
    BOOLEAN,
    COUNT,
    NOT_NEGATIVE,
    OPTIONAL_NUMBER,
    TEXT,
    list_of,
    report_table,
    required,
)

SCHEMA = "pinproof/allocation/1"
"""The version of the JSON format, raised by breaking changes."""

ARM_PHASE = report_table(
    "arm_phase",
    "A motion, a dwell time or a wait of an arm.",
    required("name", {"enum": [*PHASES, WAIT]}, f"a phase of a [sequence](sequence.md), or `{WAIT}`"),
    required("pick", ANY_TEXT, "name of the pick; empty for the motion to home"),
    required("start", NOT_NEGATIVE, "from the start of the common clock", "s"),
    required("duration", NOT_NEGATIVE, "duration", "s"),
)

ARM = report_table(
    "arm_program",
    "The program of one arm.",
    required("name", TEXT, "name of the arm"),
    required("picks", list_of(ANY_TEXT), "its picks in order"),
    required("duration", NOT_NEGATIVE, "until it is at home again", "s"),
    required("waiting", NOT_NEGATIVE, "waiting for other arms", "s"),
    required("utilisation", NOT_NEGATIVE, "share of the makespan in which it executes its sequence"),
    required("phases", list_of(ARM_PHASE), "motions, dwell times and waits in order"),
)

INTERVAL = report_table(
    "common_interval",
    "The certificate of the arms against each other in an interval in which no part is gripped or released.",
    required("start", NOT_NEGATIVE, "from the start of the common clock", "s"),
    required("duration", NOT_NEGATIVE, "duration", "s"),
    required("status", ANY_TEXT, "`FREE`, or why it is not"),
    required("clearance_proven", OPTIONAL_NUMBER, "proven lower bound of the distance of the arms", "m"),
    required("pairs_proven", COUNT, "pairs of bodies proven"),
)

ALONE = report_table(
    "one_arm",
    "All picks executed by one arm, with the others at home.",
    required("arm", TEXT, "name of the arm"),
    required("duration", OPTIONAL_NUMBER, "duration; null if it cannot execute all picks", "s"),
    required("reason", ANY_TEXT, "why it cannot"),
)

ALLOCATION = report_table(
    "allocation",
    "Picks of several arms on a common clock. Readers must accept unknown keys: they are additions of the same "
    "version.",
    required("schema", {"const": SCHEMA}, "version of the format"),
    required("robot", ANY_TEXT, "name of the cell"),
    required("summary", ANY_TEXT, "the result in one line"),
    required("ok", BOOLEAN, "whether every pick is executed and everything is certified"),
    required("free", BOOLEAN, "whether everything is certified"),
    required("reason", ANY_TEXT, "why not everything is certified"),
    required("makespan", NOT_NEGATIVE, "until all arms are at home again", "s"),
    required("clearance_proven", OPTIONAL_NUMBER, "smallest proven clearance", "m"),
    required("ratio", OPTIONAL_NUMBER, "`makespan` divided by the time of the fastest single arm"),
    required("arms", list_of(ARM), "the program of each arm"),
    required("intervals", list_of(INTERVAL), "the certificates of the arms against each other"),
    required("alone", list_of(ALONE), "the time of each arm alone, if it was computed"),
    required("left_out", list_of(LEFT_OUT), "picks that are not executed"),
    required("notes", list_of(ANY_TEXT), "what the certificates do not cover"),
)
