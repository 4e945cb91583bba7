"""The keys of reports on picks in JSON."""

from __future__ import annotations

from typing import Any

from pinproof.common.file_keys import (
    BOOLEAN,
    INTEGER,
    PLAIN_NUMBER,
    TEXT,
    FileKey,
    KeyTable,
    any_of,
    list_of,
    mapping_to,
    numbers,
)

__all__ = ["REPORT", "SCHEMA"]

SCHEMA = "pinproof/picks/2"
"""The version of the JSON format, raised by breaking changes.

Version 2 adds ``member``, ``refuted``, ``release_time``, ``score`` and ``motions`` to each pick.
"""

WORDS: dict[str, Any] = {"type": "string"}
OPTIONAL = {"type": ["number", "null"]}
COUNT = {**INTEGER, "minimum": 0}
LENGTH = {**PLAIN_NUMBER, "minimum": 0}
THREE = numbers(3, PLAIN_NUMBER)

CLEARANCES = (
    FileKey(
        "clearance_proven",
        OPTIONAL,
        "proven lower bound of every distance; null together with a number under `pairs_proven` if no pair of bodies "
        "can touch",
        "m",
        required=True,
    ),
    FileKey("clearance_observed", OPTIONAL, "smallest distance found while proving", "m", required=True),
    FileKey("pairs_proven", {"type": ["integer", "null"]}, "number of pairs of bodies proven", required=True),
)


def _table(title: str, text: str, *keys: FileKey, **rules: Any) -> KeyTable:
    return KeyTable(title, text, keys, rules, more=True)


STAGE = _table(
    "stage",
    "The result of one stage of a pick.",
    FileKey("stage", WORDS, "name of the stage", required=True),
    FileKey("ok", BOOLEAN, "whether it succeeded", required=True),
    FileKey("message", WORDS, "what was found", required=True),
    FileKey("figures", mapping_to(OPTIONAL), "numbers by name, in m, rad and s", required=True),
)

TORQUE = _table(
    "torque",
    "The largest torque of a joint during a part of the motion.",
    FileKey("joint", WORDS, "name of the joint", required=True),
    FileKey("torque", LENGTH, "upper bound of its magnitude, which holds between samples", "N m or N", required=True),
    FileKey("limit", OPTIONAL, "the limit; null if none is known", "N m or N", required=True),
    FileKey("time", PLAIN_NUMBER, "when it occurs, from the start of the part", "s", required=True),
)

MOTION = _table(
    "motion",
    "A part of the motion of a good pick, with its own proof. The parts follow each other.",
    FileKey("name", WORDS, "`pick`, or `transit`, `approach`, `retreat`, `transfer`, `place`, `leave`", required=True),
    FileKey("duration", PLAIN_NUMBER, "duration", "s", required=True),
    *CLEARANCES,
    FileKey("attached", list_of(WORDS), "names of the bodies that move with the tcp", required=True),
    FileKey("backwards", BOOLEAN, "whether the reversed motion was proven", required=True),
    FileKey(
        "partings",
        list_of(WORDS),
        "pairs that may touch at the start (at the end if `backwards`), and how they were proven to separate",
        required=True,
    ),
    FileKey("torques", list_of(TORQUE), "the largest torques, if torque is limited"),
)

CONTACT = _table(
    "contact",
    "The contact of a closed finger.",
    FileKey("finger", WORDS, "name of the finger", required=True),
    FileKey("closing_direction", THREE, "unit vector in the frame of the tcp", required=True),
    FileKey("contact_area", LENGTH, "area of contact", "m²", required=True),
    FileKey("overlap", LENGTH, "extent of the contact along the finger", "m", required=True),
    FileKey(
        "gap", OPTIONAL, "distance of the closed finger from the part; negative if it is pressed in", "m", required=True
    ),
    FileKey("open_distance", PLAIN_NUMBER, "distance from the open finger to the part", "m", required=True),
    FileKey(
        "closed_distance",
        PLAIN_NUMBER,
        "distance from the closed finger to the part; negative for an overlap",
        "m",
        required=True,
    ),
)

CUP = _table(
    "cup",
    "The contact of a suction cup.",
    FileKey("contact_area", LENGTH, "area of its face near the surface", "m²", required=True),
    FileKey(
        "gap", PLAIN_NUMBER, "largest distance of the rim; negative if the rim is inside the part", "m", required=True
    ),
    FileKey("tilt", LENGTH, "angle between face and surface", "rad", required=True),
)

GRIP = _table(
    "grip",
    "How the part is held.",
    FileKey("contacts", list_of(CONTACT), "the fingers that touch it", required=True),
    FileKey(
        "tip_distance",
        OPTIONAL,
        "for a tool without fingers or cup: distance from its tip to the surface of the part",
        "m",
        required=True,
    ),
    FileKey("cup", any_of(CUP, {"type": "null"}), "the contact of a suction cup", required=True),
)

VERDICT = _table(
    "verdict",
    "The verdict on one pick.",
    FileKey("name", TEXT, "name of the pick", required=True),
    FileKey(
        "verdict",
        {"enum": ["good", "impossible", "not found", "unreadable", "crashed"]},
        "the verdict; `impossible` is proven, `not found` is not",
        required=True,
    ),
    FileKey("failed_at", {"type": ["string", "null"]}, "the stage that failed; null for a good pick", required=True),
    FileKey("reason", WORDS, "why it failed", required=True),
    FileKey("remedy", WORDS, "a suggestion, with its effect; empty if none was found", required=True),
    FileKey("frame", WORDS, "the frame of the pose; empty for the root link of the robot", required=True),
    FileKey("xyz", THREE, "position of the tip at the nominal grasp", "m", required=True),
    FileKey("rpy", THREE, "its orientation about fixed axes: R = Rz Ry Rx", "rad", required=True),
    FileKey(
        "member",
        WORDS,
        "how the grasp differs from the nominal one, such as its spin; empty for the nominal one",
        required=True,
    ),
    FileKey("configurations_tried", COUNT, "number of configurations at the grasp that were tried", required=True),
    FileKey("grip", any_of(GRIP, {"type": "null"}), "how the part of a good pick is held"),
    FileKey("stages", list_of(STAGE), "the stages in order", required=True),
    FileKey(
        "refuted",
        list_of(WORDS),
        "for an impossible pick: each configuration with the reason why it is excluded",
        required=True,
    ),
    FileKey(
        "q_grasp",
        {"type": ["array", "null"], "items": PLAIN_NUMBER},
        "configuration at the grasp",
        "rad or m",
        required=True,
    ),
    FileKey("grasp_time", OPTIONAL, "time of the grasp", "s", required=True),
    FileKey("release_time", OPTIONAL, "time of the release; null without a place", "s", required=True),
    FileKey("duration", OPTIONAL, "duration of the motion", "s", required=True),
    FileKey(
        "score",
        mapping_to(OPTIONAL),
        "the parts of the score, from 0 to 1, and under `score` their weighted sum",
        required=True,
    ),
    *CLEARANCES,
    FileKey("margin", OPTIONAL, "required distance between any two bodies", "m", required=True),
    FileKey("motions", list_of(MOTION), "the parts of the motion of a good pick", required=True),
    FileKey(
        "excluded_pairs", list_of(list_of(WORDS, 3, 3)), "pairs that no proof covers: name, name, reason", required=True
    ),
    **{
        "if": {"properties": {"verdict": {"const": "good"}}},
        "then": {
            "properties": {
                "failed_at": {"type": "null"},
                "q_grasp": {"type": "array"},
                "grasp_time": {"type": "number"},
                "duration": {"type": "number"},
                "pairs_proven": {"type": "integer"},
                "motions": {"minItems": 1},
                "refuted": {"maxItems": 0},
            }
        },
        "else": {"properties": {"reason": {"minLength": 1}, "duration": {"type": "null"}, "motions": {"maxItems": 0}}},
    },
)

PROBLEM = _table(
    "problem",
    "A row of the picks file that could not be read.",
    FileKey("row", INTEGER, "number of the row", required=True),
    FileKey("name", WORDS, "name of the pick, if it is known", required=True),
    FileKey("reason", TEXT, "why it could not be read", required=True),
)

REPORT = _table(
    "report",
    "A report on picks. Readers must accept unknown keys: they are additions of the same version.",
    FileKey("schema", {"const": SCHEMA}, "version of the format", required=True),
    FileKey("robot", WORDS, "name of the robot", required=True),
    FileKey("summary", WORDS, "one line: the number of good picks, and the stages at which others fail", required=True),
    FileKey("ok", BOOLEAN, "whether there is a pick, every pick is good, and every row was read", required=True),
    FileKey("acceleration_source", WORDS, "source of the acceleration limits", required=True),
    FileKey("notes", list_of(WORDS), "what the verdicts do not cover", required=True),
    FileKey("picks", list_of(VERDICT), "the verdicts in the order of the file", required=True),
    FileKey("problems", list_of(PROBLEM), "rows that could not be read", required=True),
    FileKey("not_judged", COUNT, "number of picks without a verdict, because the run was interrupted"),
)
