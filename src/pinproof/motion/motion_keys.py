"""The keys of motion files (trajectory_msgs/JointTrajectory with metadata of pinproof) and of motion programs."""

from __future__ import annotations

from typing import Any

from pinproof.common.file_keys import (
    ANY_TEXT,
    COUNT,
    INTEGER,
    NOT_NEGATIVE,
    OPTIONAL_NUMBER,
    PLAIN_NUMBER,
    FileKey,
    KeyTable,
    any_of,
    list_of,
    mapping_to,
    required,
)
from pinproof.common.yaml_file import YAML_SUFFIXES

INTERPOLANTS = {"cubic": "cubic Hermite between points", "quintic": "quintic Hermite between points"}
"""The names of the interpolants in the metadata of a file."""

UNITS = {
    "positions": "rad or m",
    "velocities": "rad/s or m/s",
    "time_from_start": "s and ns",
    "accelerations": "rad/s^2 or m/s^2",
}
"""The units in the metadata of a file."""

CUBIC_UNITS = {key: unit for key, unit in UNITS.items() if key != "accelerations"}
"""The units of a cubic, which has no accelerations."""

WRITTEN, READ = (".json", ".csv"), (".json", ".csv", *YAML_SUFFIXES)
"""The suffixes of motion files that are written and read."""


def _time(seconds: str, nanoseconds: str, of: str) -> KeyTable:
    return KeyTable(
        f"time_of_{of}",
        f"A time as in {of.upper().replace('ROS', 'ROS ')}.",
        required(seconds, COUNT, "whole seconds", "s"),
        required(nanoseconds, {**COUNT, "exclusiveMaximum": 10**9}, "nanoseconds", "ns"),
    )


POINT = KeyTable(
    "point",
    "The state of all joints at one time. Either all points have accelerations, or none has.",
    required("positions", list_of(PLAIN_NUMBER, 1), "one for each joint", "rad or m"),
    required("velocities", list_of(PLAIN_NUMBER, 1), "one for each joint", "rad/s or m/s"),
    FileKey(
        "accelerations",
        list_of(PLAIN_NUMBER),
        "one for each joint, for quintic interpolation; by default none",
        "rad/s² or m/s²",
    ),
    FileKey("effort", list_of(PLAIN_NUMBER, 0, 0), "not supported; must be empty"),
    required(
        "time_from_start",
        any_of(NOT_NEGATIVE, _time("sec", "nanosec", "ros2"), _time("secs", "nsecs", "ros1")),
        "time from the start of the motion; 0 for the first point, then strictly increasing",
        "s",
    ),
)

RECORD = KeyTable(
    "record",
    "The setup with which a part of the motion was certified. A record is not a proof.",
    required("name", ANY_TEXT, "name of the part, such as `transit`; `motion` if there is only one"),
    required("start", PLAIN_NUMBER, "start of the part from the start of the motion", "s"),
    required("end", PLAIN_NUMBER, "end of the part", "s"),
    required("status", ANY_TEXT, "status of the certificate: `FREE`, `COLLIDING`, `VIOLATED` or `UNDECIDED`"),
    required("clearance", OPTIONAL_NUMBER, "proven clearance; null if none was proven or no obstacle exists", "m"),
    required("margin", PLAIN_NUMBER, "required distance between any two bodies", "m"),
    required("pairs", INTEGER, "number of pairs of bodies that were checked"),
    required("curve", ANY_TEXT, "hash of the certified curve"),
    required("setup", ANY_TEXT, "hash of the arm, the scene and the attached bodies"),
    required("attached", mapping_to(ANY_TEXT), "the bodies attached to the tcp: a hash of shape and pose by name"),
    required("held", mapping_to(PLAIN_NUMBER), "values of joints outside the arm, by name", "rad or m"),
    required("obstacles", list_of(ANY_TEXT), "names of the obstacles of the scene"),
    FileKey("constraints", list_of(ANY_TEXT), "the certified constraints of the tcp, with all their numbers", "", []),
)

META = KeyTable(
    "metadata",
    "What a message does not state. The values are checked, because another interpolation is another motion.",
    required("version", {"const": 1}, "version of this format"),
    required(
        "interpolant",
        {"enum": list(INTERPOLANTS.values())},
        "the curve between points; quintic with accelerations, otherwise cubic",
    ),
    required(
        "units",
        {"enum": [CUBIC_UNITS, UNITS]},
        "the units of the points: " + ", ".join(f"`{key}`: {unit}" for key, unit in UNITS.items()),
    ),
    FileKey("limits_note", ANY_TEXT, "where the limits of the timing come from", "", ""),
    FileKey("certified", list_of(RECORD), "how the motion was certified", "", []),
)


def _metadata_of(kind: str, units: dict[str, str]) -> dict[str, Any]:
    stated = {"interpolant": {"const": INTERPOLANTS[kind]}, "units": {"const": units}}
    return {"properties": {"pinproof": {"properties": stated}}}


MOTION = KeyTable(
    "motion",
    "A timed motion: a message trajectory_msgs/JointTrajectory, with metadata of pinproof.",
    FileKey("header", {}, "header of the message; ignored"),
    required("joint_names", list_of(ANY_TEXT, 1), "names of the joints"),
    required("points", list_of(POINT, 1), "the points in the order of time"),
    FileKey("pinproof", META, "metadata; a message of another program has none"),
    rules={
        "if": {
            "properties": {
                "points": {
                    "contains": {"required": ["accelerations"], "properties": {"accelerations": {"minItems": 1}}}
                }
            }
        },
        "then": _metadata_of("quintic", UNITS),
        "else": _metadata_of("cubic", CUBIC_UNITS),
    },
)

PROGRAM_SCHEMA = "pinproof/program/1"
"""The version of the format of programs, raised by breaking changes."""

PROGRAM_UNITS = {**{key: unit for key, unit in UNITS.items() if key != "time_from_start"}, "time": "s and ns"}
"""The units that a program states."""

EVENT_KINDS = ("grip", "release")

TIME = _time("sec", "nanosec", "ros2")

PROGRAM_POINT = KeyTable(
    "program_point",
    "The state of all joints at one time.",
    required("time", TIME, "time from the start of the program; strictly increasing"),
    required("positions", list_of(PLAIN_NUMBER, 1), "one for each joint", "rad or m"),
    required("velocities", list_of(PLAIN_NUMBER, 1), "one for each joint", "rad/s or m/s"),
    FileKey(
        "accelerations",
        list_of(PLAIN_NUMBER, 1),
        "one for each joint; required in quintic programs, refused in cubic ones",
        "rad/s² or m/s²",
    ),
)

SEGMENT = KeyTable(
    "segment",
    "A motion between two events or certificates. The arm rests at events; at other ends it may move, with the "
    "velocity of the next segment.",
    required("name", ANY_TEXT, "name, such as `transit`"),
    required("certificate", ANY_TEXT, "hash that names the certificate under `certificates`"),
    required("start", TIME, "time of the first point: the end of the previous segment and of the dwell time after it"),
    required("end", TIME, "time of the last point"),
    required("points", list_of(PROGRAM_POINT, 1), "the points in the order of time"),
)

EVENT = KeyTable(
    "event",
    "What happens while the arm rests at the end of a segment.",
    required("kind", {"enum": list(EVENT_KINDS)}, "what the gripper does"),
    required("time", TIME, "time of the event from the start of the program"),
    required("dwell", TIME, "how long the arm then rests"),
    required("object", ANY_TEXT, "object that is gripped or released; empty if the pick states none"),
    required(
        "joints",
        mapping_to(PLAIN_NUMBER),
        "values of the gripper joints after the event, by name; empty for a gripper that is not a joint",
        "rad or m",
    ),
)

PROGRAM = KeyTable(
    "program",
    "A motion program: certified segments with events, on one clock.",
    required("schema", {"const": PROGRAM_SCHEMA}, "name and version of this format"),
    required("name", ANY_TEXT, "name of the program, such as the name of its pick"),
    required("robot", ANY_TEXT, "the robot; empty if it is not known"),
    required("tcp", ANY_TEXT, "the tcp frame; empty if it is not known"),
    required("member", ANY_TEXT, "how the grasp differs from the nominal one; empty if it does not"),
    required(
        "units",
        {"enum": [PROGRAM_UNITS]},
        "the units of the points: " + ", ".join(f"`{key}`: {unit}" for key, unit in PROGRAM_UNITS.items()),
    ),
    required("interpolant", {"enum": list(INTERPOLANTS.values())}, "the curve between points"),
    required("limits_note", ANY_TEXT, "where the limits of the timing come from"),
    required("joint_names", list_of(ANY_TEXT, 1), "names of the joints"),
    required("duration", TIME, "time of the end of the program, with all dwell times"),
    required("events", list_of(EVENT), "the events in the order of time"),
    required(
        "certificates", mapping_to(RECORD), "the records of the certificates by their hash (SHA-256, hexadecimal)"
    ),
    required("segments", list_of(SEGMENT, 1), "the motions in order"),
)
