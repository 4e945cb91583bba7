"""The keys of motion files: trajectory_msgs/JointTrajectory, and the metadata that pinproof adds."""

from __future__ import annotations

from typing import Any

from pinproof.common.file_keys import INTEGER, PLAIN_NUMBER, FileKey, KeyTable, any_of, list_of, mapping_to
from pinproof.common.yaml_file import YAML_SUFFIXES

__all__ = ["INTERPOLANTS", "META", "MOTION", "POINT", "READ", "RECORD", "UNITS", "WRITTEN"]

INTERPOLANTS = {"cubic": "cubic Hermite between points", "quintic": "quintic Hermite between points"}
"""The names of the interpolants in the metadata of a file."""

UNITS = {
    "positions": "rad or m",
    "velocities": "rad/s or m/s",
    "time_from_start": "s and ns",
    "accelerations": "rad/s^2 or m/s^2",
}
"""The units in the metadata of a file; a cubic has no accelerations."""

WRITTEN, READ = (".json", ".csv"), (".json", ".csv", *YAML_SUFFIXES)
"""The suffixes of motion files that are written and read."""

NAME: dict[str, Any] = {"type": "string"}
COUNT = {**INTEGER, "minimum": 0}


def _time(seconds: str, nanoseconds: str, of: str) -> KeyTable:
    return KeyTable(
        f"time_of_{of}",
        f"A time as in {of.upper().replace('ROS', 'ROS ')}.",
        (
            FileKey(seconds, COUNT, "whole seconds", "s", required=True),
            FileKey(nanoseconds, {**COUNT, "exclusiveMaximum": 10**9}, "nanoseconds", "ns", required=True),
        ),
    )


POINT = KeyTable(
    "point",
    "The state of all joints at one time. Either all points have accelerations, or none has.",
    (
        FileKey("positions", list_of(PLAIN_NUMBER, 1), "one for each joint", "rad or m", required=True),
        FileKey("velocities", list_of(PLAIN_NUMBER, 1), "one for each joint", "rad/s or m/s", required=True),
        FileKey(
            "accelerations",
            list_of(PLAIN_NUMBER),
            "one for each joint, for quintic interpolation; by default none",
            "rad/s² or m/s²",
        ),
        FileKey("effort", list_of(PLAIN_NUMBER, 0, 0), "not supported; must be empty"),
        FileKey(
            "time_from_start",
            any_of({**PLAIN_NUMBER, "minimum": 0}, _time("sec", "nanosec", "ros2"), _time("secs", "nsecs", "ros1")),
            "time from the start of the motion; 0 for the first point, then strictly increasing",
            "s",
            required=True,
        ),
    ),
)

RECORD = KeyTable(
    "record",
    "The setup with which a part of the motion was certified. A record is not a proof.",
    (
        FileKey("name", NAME, "name of the part, such as `transit`; `motion` if there is only one", required=True),
        FileKey("start", PLAIN_NUMBER, "start of the part from the start of the motion", "s", required=True),
        FileKey("end", PLAIN_NUMBER, "end of the part", "s", required=True),
        FileKey(
            "status", NAME, "status of the certificate: `FREE`, `COLLIDING`, `VIOLATED` or `UNDECIDED`", required=True
        ),
        FileKey(
            "clearance",
            {"type": ["number", "null"]},
            "proven clearance; null if none was proven or no obstacle exists",
            "m",
            required=True,
        ),
        FileKey("margin", PLAIN_NUMBER, "required distance between any two bodies", "m", required=True),
        FileKey("pairs", INTEGER, "number of pairs of bodies that were checked", required=True),
        FileKey("curve", NAME, "hash of the certified curve", required=True),
        FileKey("setup", NAME, "hash of the arm, the scene and the attached bodies", required=True),
        FileKey(
            "attached",
            mapping_to(NAME),
            "the bodies attached to the tcp: a hash of shape and pose by name",
            required=True,
        ),
        FileKey(
            "held", mapping_to(PLAIN_NUMBER), "values of joints outside the arm, by name", "rad or m", required=True
        ),
        FileKey("obstacles", list_of(NAME), "names of the obstacles of the scene", required=True),
        FileKey("constraints", list_of(NAME), "the certified constraints of the tcp, with all their numbers", "", []),
    ),
)

META = KeyTable(
    "metadata",
    "What a message does not state. The values are checked, because another interpolation is another motion.",
    (
        FileKey("version", {"const": 1}, "version of this format", required=True),
        FileKey(
            "interpolant",
            {"enum": list(INTERPOLANTS.values())},
            "the curve between points; quintic with accelerations, otherwise cubic",
            required=True,
        ),
        FileKey(
            "units",
            {"enum": [{k: v for k, v in UNITS.items() if k != "accelerations"}, UNITS]},
            "the units of the points: " + ", ".join(f"`{key}`: {unit}" for key, unit in UNITS.items()),
            required=True,
        ),
        FileKey("limits_note", NAME, "where the limits of the timing come from", "", ""),
        FileKey("certified", list_of(RECORD), "how the motion was certified", "", []),
    ),
)

MOTION = KeyTable(
    "motion",
    "A timed motion: a message trajectory_msgs/JointTrajectory, with metadata of pinproof.",
    (
        FileKey("header", {}, "header of the message; ignored"),
        FileKey("joint_names", list_of(NAME, 1), "names of the joints", required=True),
        FileKey("points", list_of(POINT, 1), "the points in the order of time", required=True),
        FileKey("pinproof", META, "metadata; a message of another program has none"),
    ),
)
