"""The keys of files with a Denavit-Hartenberg table; the columns of CSV files are the keys of a row."""

from __future__ import annotations

from pinproof.common.file_keys import ANGLE, NUMBER, TEXT, FileKey, KeyTable, any_of, list_of, numbers, required

CONVENTIONS = ("standard", "modified")
JOINT_TYPES = ("revolute", "prismatic", "continuous")

LARGEST = 1e6
"""Metres, radians, m/s, rad/s. Larger numbers are typing errors; sines would lose digits and products overflow."""

DEFAULT_EFFORT = 100.0
"""N m or N. Default effort limit, because a URDF must state one; a typical value for small arms."""

VALUE = {"$ref": NUMBER, "minimum": -LARGEST, "maximum": LARGEST}

TRANSFORM = KeyTable(
    "transform",
    "A rigid transform: a position and an orientation, or a matrix.",
    FileKey("xyz", numbers(3), "position x, y, z", "m", [0, 0, 0]),
    FileKey(
        "rpy", numbers(3, ANGLE), "roll, pitch, yaw about fixed axes: R = Rz(yaw) Ry(pitch) Rx(roll)", "rad", [0, 0, 0]
    ),
    FileKey("quat_xyzw", numbers(4), "a quaternion, scalar last, instead of `rpy`; it is normalised"),
    FileKey("matrix", list_of(numbers(4), 4, 4), "four rows of four numbers, instead of the other keys"),
    rules={"not": {"required": ["rpy", "quat_xyzw"]}, "if": {"required": ["matrix"]}, "then": {"maxProperties": 1}},
)

ROW = KeyTable(
    "row",
    "One joint and the link that it moves. The joint variable q is added to `theta` (revolute, continuous) or to `d` "
    "(prismatic).",
    required("name", {**TEXT, "pattern": r"^\S(.*\S)?$"}, "name of the joint, unique in the table"),
    FileKey(
        "type",
        {"enum": list(JOINT_TYPES)},
        "type of the joint; `continuous` is revolute without limits",
        "",
        "revolute",
    ),
    required("theta", ANGLE, "angle about z; for a revolute or continuous joint the offset added to q", "rad"),
    required("d", VALUE, "distance along z; for a prismatic joint the offset added to q", "m"),
    required("a", VALUE, "distance along x", "m"),
    required("alpha", ANGLE, "angle about x", "rad"),
    FileKey(
        "lower",
        any_of(VALUE, {"type": "null"}),
        "lower limit of q; by default -pi for a revolute joint. A prismatic joint must state it, a continuous "
        "joint must not",
        "rad or m",
    ),
    FileKey(
        "upper",
        any_of(VALUE, {"type": "null"}),
        "upper limit of q; by default pi for a revolute joint, otherwise as `lower`",
        "rad or m",
    ),
    FileKey(
        "velocity",
        any_of({**VALUE, "exclusiveMinimum": 0}, {"type": "null"}),
        "velocity limit; by default pi rad/s or 1 m/s",
        "rad/s or m/s",
    ),
    FileKey(
        "effort",
        any_of({**VALUE, "exclusiveMinimum": 0}, {"type": "null"}),
        "largest torque or force, used where torques are limited; the default is not that of a real robot",
        "N m or N",
        DEFAULT_EFFORT,
    ),
    rules={
        "allOf": [
            {
                "if": {"required": ["type"], "properties": {"type": {"const": "prismatic"}}},
                "then": {"required": ["lower", "upper"], "properties": {"lower": NUMBER, "upper": NUMBER}},
            },
            {
                "if": {"required": ["type"], "properties": {"type": {"const": "continuous"}}},
                "then": {"properties": {"lower": {"type": "null"}, "upper": {"type": "null"}}},
            },
        ]
    },
)

TABLE = KeyTable(
    "dh",
    "A serial arm as a Denavit-Hartenberg table: frame dh_(i-1) is transformed to frame dh_i by row i.",
    FileKey("name", {**TEXT, "pattern": r"\S"}, "name of the robot; by default the name of the file"),
    required(
        "convention",
        {"enum": list(CONVENTIONS)},
        "`standard`: Rz(theta) Tz(d) Tx(a) Rx(alpha); `modified` (Craig): Rx(alpha) Tx(a) Rz(theta) Tz(d), where "
        "row i holds a and alpha of link i - 1",
    ),
    FileKey("base", TRANSFORM, "base_from_dh_0: the pose of frame dh_0 in the base frame", "", {}),
    FileKey("tool", TRANSFORM, "dh_n_from_tool: the pose of the tool in the last frame", "", {}),
    required("rows", list_of(ROW, 1), "the joints, base first"),
)
