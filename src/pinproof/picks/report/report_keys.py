"""The keys of reports on picks in JSON, and how the values are taken from the verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pinproof.collision import Certificate
from pinproof.common.structs import (
    ANY_TEXT,
    BOOLEAN,
    COUNT,
    INTEGER,
    NOT_NEGATIVE,
    OPTIONAL_NUMBER,
    PLAIN_NUMBER,
    TEXT,
    Key,
    choice,
    list_of,
    mapping_to,
    optional,
    report_table,
    required,
    schema_version,
    table_of,
)
from pinproof.motion import TorquePeak
from pinproof.picks.input.picks import PickProblem
from pinproof.picks.judging.verdict import Intercept, PickStatus, PickVerdict, StageResult
from pinproof.spatial import xyz_rpy

SCHEMA = "pinproof/picks/2"
"""The version of the JSON format, raised by breaking changes.

Version 2 adds ``member``, ``refuted``, ``release_time``, ``score`` and ``motions`` to each pick.
"""

THREE = list_of(PLAIN_NUMBER, 3, 3)


def _clearances(certificates_of: Callable[[Any], Sequence[Certificate]]) -> tuple[Key, ...]:
    """The combined values of the certificates of a result."""

    def least(name: str) -> Callable[[Any], float | None]:
        def value(result: Any) -> float | None:
            values = [getattr(certificate, name) for certificate in certificates_of(result)]
            return float(np.min(values)) if values else None

        return value

    return (
        required(
            "clearance_proven",
            OPTIONAL_NUMBER,
            "proven lower bound of every distance; null together with a number under `pairs_proven` if no pair of "
            "bodies can touch",
            "m",
            least("clearance"),
        ),
        required(
            "clearance_observed", OPTIONAL_NUMBER, "smallest distance found while proving", "m", least("observed")
        ),
        required(
            "pairs_proven",
            optional(INTEGER),
            "number of pairs of bodies proven",
            get=lambda result: max((each.pairs for each in certificates_of(result)), default=None),
        ),
    )


MOTION = report_table(
    "motion",
    "A part of the motion of a good pick, with its own proof. The parts follow each other.",
    required("name", ANY_TEXT, "`pick`, or `transit`, `approach`, `retreat`, `transfer`, `place`, `leave`"),
    required("duration", PLAIN_NUMBER, "duration", "s", lambda motion: motion.trajectory.duration),
    *_clearances(lambda motion: (motion.certificate,)),
    required(
        "attached",
        list_of(ANY_TEXT),
        "names of the bodies that move with the tcp",
        get=lambda motion: [body.name for body in motion.attached],
    ),
    required(
        "backwards",
        BOOLEAN,
        "whether the reversed motion was proven",
        get=lambda motion: motion.certificate.backwards,
    ),
    required(
        "partings",
        list_of(ANY_TEXT),
        "pairs that may touch at the start (at the end if `backwards`), and how they were proven to separate",
        get=lambda motion: map(str, motion.certificate.partings),
    ),
    required(
        "constraints",
        list_of(ANY_TEXT),
        "constraints of the tcp, each with its proven largest error",
        get=lambda motion: map(str, motion.certificate.constraints),
    ),
    Key("torques", list_of(table_of(TorquePeak)), "the largest torques, if torque is limited"),
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
    required("cup", optional(CUP), "the contact of a suction cup"),
)


def _certificates(verdict: PickVerdict) -> list[Certificate]:
    return [motion.certificate for motion in verdict.motions]


def _pose(verdict: PickVerdict) -> Any:
    return xyz_rpy(verdict.pick.pose) + 0.0  # no negative zeros


VERDICT = report_table(
    "verdict",
    "The verdict on one pick.",
    required("name", TEXT, "name of the pick", get=lambda verdict: verdict.pick.name),
    required(
        "verdict",
        choice(*(status.value for status in PickStatus)),
        "the verdict; `impossible` is proven, `not found` is not",
        get=lambda verdict: verdict.status,
    ),
    required(
        "failed_at",
        optional(ANY_TEXT),
        "the stage that failed; null for a good pick",
        get=lambda verdict: verdict.failed,
    ),
    required("reason", ANY_TEXT, "why it failed"),
    required("remedy", ANY_TEXT, "a suggestion, with its effect; empty if none was found"),
    required(
        "frame",
        ANY_TEXT,
        "the frame of the pose; empty for the root link of the robot",
        get=lambda verdict: verdict.pick.frame,
    ),
    required("xyz", THREE, "position of the tip at the nominal grasp", "m", lambda verdict: _pose(verdict)[:3]),
    required("rpy", THREE, "its orientation about fixed axes: R = Rz Ry Rx", "rad", lambda verdict: _pose(verdict)[3:]),
    required(
        "member", ANY_TEXT, "how the grasp differs from the nominal one, such as its spin; empty for the nominal one"
    ),
    required(
        "configurations_tried",
        COUNT,
        "number of configurations at the grasp that were tried",
        get=lambda verdict: verdict.configurations,
    ),
    Key("grip", optional(GRIP), "how the part of a good pick is held"),
    required("stages", list_of(table_of(StageResult)), "the stages in order"),
    required(
        "refuted", list_of(ANY_TEXT), "for an impossible pick: each configuration with the reason why it is excluded"
    ),
    required("q_grasp", optional(list_of(PLAIN_NUMBER)), "configuration at the grasp", "rad or m"),
    required("grasp_time", OPTIONAL_NUMBER, "time of the grasp", "s"),
    required("release_time", OPTIONAL_NUMBER, "time of the release; null without a place", "s"),
    Key("intercept", optional(table_of(Intercept)), "where and when a part is taken from a conveyor"),
    required(
        "duration",
        OPTIONAL_NUMBER,
        "duration of the motion",
        "s",
        lambda verdict: None if verdict.trajectory is None else verdict.trajectory.duration,
    ),
    required(
        "score",
        mapping_to(OPTIONAL_NUMBER),
        "the parts of the score, from 0 to 1, and under `score` their weighted sum",
    ),
    *_clearances(_certificates),
    required(
        "margin",
        OPTIONAL_NUMBER,
        "required distance between any two bodies",
        "m",
        lambda verdict: min((each.margin for each in _certificates(verdict)), default=None),
    ),
    required("motions", list_of(MOTION), "the parts of the motion of a good pick"),
    required(
        "excluded_pairs",
        list_of(list_of(ANY_TEXT, 3, 3)),
        "pairs that no proof covers: name, name, reason",
        get=lambda verdict: dict.fromkeys(
            (*pair.owners, pair.reason) for each in _certificates(verdict) for pair in each.excluded
        ),
    ),
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

REPORT = report_table(
    "report",
    "A report on picks. Readers must accept unknown keys: they are additions of the same version.",
    schema_version(SCHEMA),
    required("robot", ANY_TEXT, "name of the robot"),
    required("summary", ANY_TEXT, "one line: the number of good picks, and the stages at which others fail"),
    required("ok", BOOLEAN, "whether there is a pick, every pick is good, and every row was read"),
    required("acceleration_source", ANY_TEXT, "source of the acceleration limits"),
    required("notes", list_of(ANY_TEXT), "what the verdicts do not cover, and what occupancy grids assume"),
    required("picks", list_of(VERDICT), "the verdicts in the order of the file", get=lambda report: report.verdicts),
    required("problems", list_of(table_of(PickProblem)), "rows that could not be read"),
    Key("not_judged", COUNT, "number of picks without a verdict, because the run was interrupted"),
)
