"""The keys of reports on picks in JSON."""

from __future__ import annotations

from pinproof.common.file_keys import (
    ANY_TEXT,
    BOOLEAN,
    COUNT,
    INTEGER,
    NOT_NEGATIVE,
    OPTIONAL_NUMBER,
    PLAIN_NUMBER,
    TEXT,
    FileKey,
    any_of,
    list_of,
    mapping_to,
    numbers,
    report_table,
    required,
)

SCHEMA = "pinproof/picks/2"
"""The version of the JSON format, raised by breaking changes.

Version 2 adds ``member``, ``refuted``, ``release_time``, ``score`` and ``motions`` to each pick.
"""

THREE = numbers(3, PLAIN_NUMBER)

CLEARANCES = (
    required(
        "clearance_proven",
        OPTIONAL_NUMBER,
        "proven lower bound of every distance; null together with a number under `pairs_proven` if no pair of bodies "
        "can touch",
        "m",
    ),
    required("clearance_observed", OPTIONAL_NUMBER, "smallest distance found while proving", "m"),
    required("pairs_proven", {"type": ["integer", "null"]}, "number of pairs of bodies proven"),
)


STAGE = report_table(
    "stage",
    "The result of one stage of a pick.",
    required("stage", ANY_TEXT, "name of the stage"),
    required("ok", BOOLEAN, "whether it succeeded"),
    required("message", ANY_TEXT, "what was found"),
    required("figures", mapping_to(OPTIONAL_NUMBER), "numbers by name, in m, rad and s"),
)

TORQUE = report_table(
    "torque",
    "The largest torque of a joint during a part of the motion.",
    required("joint", ANY_TEXT, "name of the joint"),
    required("torque", NOT_NEGATIVE, "upper bound of its magnitude, which holds between samples", "N m or N"),
    required("limit", OPTIONAL_NUMBER, "the limit; null if none is known", "N m or N"),
    required("time", PLAIN_NUMBER, "when it occurs, from the start of the part", "s"),
    required("unit", {"enum": ["N m", "N"]}, "the unit of both, `N` for a prismatic joint"),
)

MOTION = report_table(
    "motion",
    "A part of the motion of a good pick, with its own proof. The parts follow each other.",
    required("name", ANY_TEXT, "`pick`, or `transit`, `approach`, `retreat`, `transfer`, `place`, `leave`"),
    required("duration", PLAIN_NUMBER, "duration", "s"),
    *CLEARANCES,
    required("attached", list_of(ANY_TEXT), "names of the bodies that move with the tcp"),
    required("backwards", BOOLEAN, "whether the reversed motion was proven"),
    required(
        "partings",
        list_of(ANY_TEXT),
        "pairs that may touch at the start (at the end if `backwards`), and how they were proven to separate",
    ),
    required("constraints", list_of(ANY_TEXT), "constraints of the tcp, each with its proven largest error"),
    FileKey("torques", list_of(TORQUE), "the largest torques, if torque is limited"),
)

CONTACT = report_table(
    "contact",
    "The contact of a closed finger.",
    required("finger", ANY_TEXT, "name of the finger"),
    required("closing_direction", THREE, "unit vector in the frame of the tcp"),
    required("contact_area", NOT_NEGATIVE, "area of contact", "m²"),
    required("overlap", NOT_NEGATIVE, "extent of the contact along the finger", "m"),
    required("gap", OPTIONAL_NUMBER, "distance of the closed finger from the part; negative if it is pressed in", "m"),
    required("open_distance", PLAIN_NUMBER, "distance from the open finger to the part", "m"),
    required(
        "closed_distance", PLAIN_NUMBER, "distance from the closed finger to the part; negative for an overlap", "m"
    ),
)

CUP = report_table(
    "cup",
    "The contact of a suction cup.",
    required("contact_area", NOT_NEGATIVE, "area of its face near the surface", "m²"),
    required("gap", PLAIN_NUMBER, "largest distance of the rim; negative if the rim is inside the part", "m"),
    required("tilt", NOT_NEGATIVE, "angle between face and surface", "rad"),
)

GRIP = report_table(
    "grip",
    "How the part is held.",
    required("contacts", list_of(CONTACT), "the fingers that touch it"),
    required(
        "tip_distance",
        OPTIONAL_NUMBER,
        "for a tool without fingers or cup: distance from its tip to the surface of the part",
        "m",
    ),
    required("cup", any_of(CUP, {"type": "null"}), "the contact of a suction cup"),
)

INTERCEPT = report_table(
    "intercept",
    "Where and when the part is taken from a conveyor.",
    required("start_time", PLAIN_NUMBER, "start of the motion on the clock of the conveyor", "s"),
    required("time", PLAIN_NUMBER, "time on that clock at which the tool is at the part", "s"),
    required("travel", PLAIN_NUMBER, "distance that the part has moved until then", "m"),
    required(
        "position_deviation", NOT_NEGATIVE, "upper bound of the deviation of the tcp while the gripper closes", "m"
    ),
    required("rotation_deviation", NOT_NEGATIVE, "upper bound of the deviation of its orientation", "rad"),
)

VERDICT = report_table(
    "verdict",
    "The verdict on one pick.",
    required("name", TEXT, "name of the pick"),
    required(
        "verdict",
        {"enum": ["good", "impossible", "not found", "unreadable", "crashed"]},
        "the verdict; `impossible` is proven, `not found` is not",
    ),
    required("failed_at", {"type": ["string", "null"]}, "the stage that failed; null for a good pick"),
    required("reason", ANY_TEXT, "why it failed"),
    required("remedy", ANY_TEXT, "a suggestion, with its effect; empty if none was found"),
    required("frame", ANY_TEXT, "the frame of the pose; empty for the root link of the robot"),
    required("xyz", THREE, "position of the tip at the nominal grasp", "m"),
    required("rpy", THREE, "its orientation about fixed axes: R = Rz Ry Rx", "rad"),
    required(
        "member", ANY_TEXT, "how the grasp differs from the nominal one, such as its spin; empty for the nominal one"
    ),
    required("configurations_tried", COUNT, "number of configurations at the grasp that were tried"),
    FileKey("grip", any_of(GRIP, {"type": "null"}), "how the part of a good pick is held"),
    required("stages", list_of(STAGE), "the stages in order"),
    required(
        "refuted", list_of(ANY_TEXT), "for an impossible pick: each configuration with the reason why it is excluded"
    ),
    required("q_grasp", {"type": ["array", "null"], "items": PLAIN_NUMBER}, "configuration at the grasp", "rad or m"),
    required("grasp_time", OPTIONAL_NUMBER, "time of the grasp", "s"),
    required("release_time", OPTIONAL_NUMBER, "time of the release; null without a place", "s"),
    FileKey("intercept", any_of(INTERCEPT, {"type": "null"}), "where and when a part is taken from a conveyor"),
    required("duration", OPTIONAL_NUMBER, "duration of the motion", "s"),
    required(
        "score",
        mapping_to(OPTIONAL_NUMBER),
        "the parts of the score, from 0 to 1, and under `score` their weighted sum",
    ),
    *CLEARANCES,
    required("margin", OPTIONAL_NUMBER, "required distance between any two bodies", "m"),
    required("motions", list_of(MOTION), "the parts of the motion of a good pick"),
    required("excluded_pairs", list_of(list_of(ANY_TEXT, 3, 3)), "pairs that no proof covers: name, name, reason"),
    rules={
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

PROBLEM = report_table(
    "problem",
    "A row of the picks file that could not be read.",
    required("row", INTEGER, "number of the row"),
    required("name", ANY_TEXT, "name of the pick, if it is known"),
    required("reason", TEXT, "why it could not be read"),
)

REPORT = report_table(
    "report",
    "A report on picks. Readers must accept unknown keys: they are additions of the same version.",
    required("schema", {"const": SCHEMA}, "version of the format"),
    required("robot", ANY_TEXT, "name of the robot"),
    required("summary", ANY_TEXT, "one line: the number of good picks, and the stages at which others fail"),
    required("ok", BOOLEAN, "whether there is a pick, every pick is good, and every row was read"),
    required("acceleration_source", ANY_TEXT, "source of the acceleration limits"),
    required("notes", list_of(ANY_TEXT), "what the verdicts do not cover, and what occupancy grids assume"),
    required("picks", list_of(VERDICT), "the verdicts in the order of the file"),
    required("problems", list_of(PROBLEM), "rows that could not be read"),
    FileKey("not_judged", COUNT, "number of picks without a verdict, because the run was interrupted"),
)
