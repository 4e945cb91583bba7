"""The keys of picks files, and the columns of tables of picks."""

from __future__ import annotations

from typing import Any

from pinproof.collision.scenes.scene_keys import BODY, OBSTACLE, ONE_ORIENTATION, POSE, POSE_KEYS, VECTOR
from pinproof.common.file_keys import (
    ANGLE,
    ANY_TEXT,
    BOOLEAN,
    COUNT,
    INTEGER,
    NUMBER,
    TEXT,
    FileKey,
    KeyTable,
    any_of,
    default_of,
    list_of,
    mapping_to,
    numbers,
    required,
)
from pinproof.picks.input.conveyor import Conveyor
from pinproof.picks.input.pick import (
    LONGEST_MOVE,
    MOST_STEPS,
    PARTS,
    ROOT,
    STEPS,
    TIP,
    GripperFingers,
    Pick,
    Picks,
    PlaceTarget,
    SuctionCup,
)
from pinproof.picks.input.settings import GripLimits, PickBudget

POSITIVE = {"$ref": NUMBER, "minimum": 0}
ABOVE_ZERO = {"$ref": NUMBER, "exclusiveMinimum": 0}

POSITION = FileKey("xyz", VECTOR, "position of the tool's tip at the grasp, in `frame`", "m")
ORIENTATION = (
    FileKey(
        "rpy",
        numbers(3, ANGLE),
        "orientation of the tip: angles about fixed axes, R = Rz(yaw) Ry(pitch) Rx(roll)",
        "rad",
    ),
    FileKey("quat_xyzw", numbers(4), "the orientation as a quaternion, scalar last, instead of `rpy`"),
)
SUPPORT = any_of(TEXT, {**list_of(TEXT, 1), "uniqueItems": True})


def _field(owner: type, name: str, value: Any, text: str, unit: str = "") -> FileKey:
    """A key with the name and the default of a field of a dataclass."""
    return FileKey(name, value, text, unit, default_of(owner, name))


def _line_keys(owner: type, begin: str, end: str) -> tuple[FileKey, ...]:
    """The keys of the straight lines of a pick or a place."""
    keys: list[FileKey] = []
    length = {**POSITIVE, "maximum": LONGEST_MOVE}
    for move, text in (("approach", begin), ("retreat", end)):
        keys += (
            _field(owner, move, length, f"length of the straight line {text}; 0 for none", "m"),
            _field(owner, f"{move}_direction", VECTOR, f"direction of the {move}; it is normalised"),
            _field(
                owner,
                f"{move}_frame",
                {"enum": [TIP, ROOT]},
                f"the frame of `{move}_direction`: the tip of the tool or the root link of the robot",
            ),
        )
    return tuple(keys)


SPIN_RANGE = KeyTable(
    "spin_range",
    "A range of rotations about the approach direction.",
    required("range", numbers(2), "first and last rotation", "rad"),
    FileKey("steps", {**INTEGER, "minimum": 1, "maximum": MOST_STEPS}, "number of steps between them", "", STEPS),
)

TOLERANCE = KeyTable(
    "tolerance",
    "How far a grasp may be moved along and about the axes of the tip if the nominal one fails.",
    FileKey("position", any_of(POSITIVE, numbers(3, POSITIVE)), "along x, y, z, in both directions", "m", [0, 0, 0]),
    FileKey("tilt", POSITIVE, "about x and y, in both directions", "rad", 0),
)

PLACE = KeyTable(
    "place",
    "Where the object is put down: the pose of the tool's tip at the release (`xyz` with `rpy` or `quat_xyzw`), or "
    "that of the object (`object_pose`). For a family of grasps the pose of the tip is that of the nominal grasp; the "
    "object has the same final pose for every grasp of the family.",
    FileKey("xyz", VECTOR, "position of the tip at the release, in `frame`", "m"),
    *ORIENTATION,
    FileKey(
        "object_pose",
        POSE,
        "the final pose of the object, in `frame`, instead of the pose of the tip: frame_from_object, with the "
        "pose that the object has in the scene file, or in `object`, as its own frame",
    ),
    FileKey("frame", TEXT, "the frame of the pose, as for a pick; by default the root link of the robot"),
    *_line_keys(PlaceTarget, "to the release", "of the empty tool after the release"),
    FileKey(
        "support",
        SUPPORT,
        "the obstacle, or a list of obstacles, that the object is put onto; by default those within 1 mm below it",
    ),
    rules={
        "oneOf": [
            {
                "required": ["object_pose"],
                "not": {"anyOf": [{"required": [key]} for key in ("xyz", "rpy", "quat_xyzw")]},
            },
            {"required": ["xyz", "rpy"]},
            {"required": ["xyz", "quat_xyzw"]},
        ]
    },
)

GRID = KeyTable(
    "grid",
    "The grid of a pattern, along the axes of the pick's frame.",
    required("counts", list_of({**INTEGER, "minimum": 1}, 3, 3), "number of picks along x, y, z"),
    required("step", VECTOR, "distance of neighbours along x, y, z", "m"),
)

PATTERN = KeyTable(
    "pattern",
    "Copies of a pick; they are named `part[0,0]`, `part[0,1]`, ..., or with three indices if there are layers.",
    required("grid", GRID, "a regular grid"),
)

_MASS_KEYS = (
    required("mass", ABOVE_ZERO, "mass, above 0", "kg"),
    FileKey("center_of_mass", VECTOR, "centre of mass", "m", [0, 0, 0]),
    FileKey(
        "inertia",
        any_of(numbers(3), list_of(numbers(3), 3, 3)),
        "inertia about the centre of mass: the diagonal, or three rows; by default that of a point mass",
        "kg m²",
    ),
)

OBJECT_PAYLOAD = KeyTable("object_payload", "The mass of a grasped object, in the frame of the object.", *_MASS_KEYS)

PAYLOAD = KeyTable(
    "payload",
    "The mass of a tool.",
    *_MASS_KEYS,
    FileKey("frame", TEXT, "the link that it is fixed to, in whose frame it is stated; by default the tcp"),
)

SPEED = KeyTable(
    "tool_speed",
    "Limits of the tcp, relative to the base. At least one is stated.",
    FileKey("linear_speed", ABOVE_ZERO, "largest speed of the tcp, above 0", "m/s"),
    FileKey("angular_speed", ABOVE_ZERO, "largest angular speed, above 0", "rad/s"),
    FileKey("linear_acceleration", ABOVE_ZERO, "largest acceleration of the tcp, above 0", "m/s²"),
    FileKey("angular_acceleration", ABOVE_ZERO, "largest angular acceleration, above 0", "rad/s²"),
    rules={"minProperties": 1},
)

STAGE_SPEEDS = KeyTable(
    "stage_speeds",
    "Limits of the tcp on parts of the motion of a pick. A number is a linear speed in m/s.",
    *(
        FileKey(part, any_of(ABOVE_ZERO, SPEED), text)
        for part, text in zip(
            PARTS,
            (
                "from home to the start of the approach",
                "the straight line before the grasp",
                "the straight line after the grasp",
                "with the object to the start of the line to its place",
                "the straight line to the release",
                "the straight line of the empty tool after the release",
            ),
            strict=True,
        )
    ),
)

_PICK_KEYS = (
    POSITION,
    *ORIENTATION,
    FileKey(
        "frame",
        TEXT,
        "the frame of the pose: one of `frames`, an obstacle, or a link that does not move; by default the root link "
        "of the robot",
    ),
    *_line_keys(Pick, "before the grasp", "after the grasp"),
    FileKey(
        "spin",
        any_of({"const": "free"}, NUMBER, list_of(NUMBER, 1), SPIN_RANGE),
        f"equivalent rotations about the approach direction: one, a list, a range, or `free` for any ({STEPS} are "
        "tried)",
        "rad",
        0,
    ),
    FileKey("tolerance", TOLERANCE, "how far the grasp may be moved if the nominal one fails"),
    FileKey(
        "object",
        any_of(TEXT, BODY),
        "the grasped object: the name of an obstacle of the scene, or a shape. It moves with the tool after the grasp; "
        "without it, the tool is empty there. In a pattern, `{i}`, `{j}` and `{k}` are replaced by the indices",
    ),
    FileKey(
        "support",
        SUPPORT,
        "the obstacle, or a list of obstacles, that the object may touch until it is lifted; by default those within 1 "
        "mm below it",
    ),
    FileKey("place", PLACE, "where the object is put down; by default the pick ends with the retreat"),
    FileKey(
        "upright",
        any_of({"$ref": NUMBER, "minimum": 0}, {"type": "string", "pattern": r"^[-+0-9.eE]+ *(deg|rad)$"}),
        "while the object is carried, the axis of the tip that is vertical at the grasp stays within this angle of the "
        "vertical, such as `5 deg`; by default any orientation is allowed",
        "rad",
    ),
    FileKey("upright_axis", VECTOR, "another axis for `upright`, in the frame of the tip"),
    FileKey("payload", OBJECT_PAYLOAD, "the mass of the object; the torque limits of the joints then apply"),
    FileKey(
        "speed",
        any_of(ABOVE_ZERO, STAGE_SPEEDS),
        "limits of the tcp by part of the motion; a number is the largest linear speed (m/s) of all parts",
    ),
    FileKey("arm", TEXT, "in a file with `robots`, the one that executes the pick; by default any may"),
)

DEFAULTS = KeyTable(
    "defaults", "Keys of a pick that apply where a pick does not state them.", *_PICK_KEYS, rules=ONE_ORIENTATION
)

PICK = KeyTable(
    "pick",
    "One grasp, or a family of them. `xyz` and an orientation (`rpy` or `quat_xyzw`) are required, here or in "
    "`defaults`; an `object` is required for `support`, `place` and `upright`.",
    required("name", TEXT, "unique in the file"),
    *_PICK_KEYS,
    FileKey("pattern", PATTERN, "copies of this pick on a grid"),
    rules=ONE_ORIENTATION,
)

FRAME = KeyTable(
    "frame",
    "A named frame in which picks can be stated: parent_from_frame.",
    *POSE_KEYS,
    FileKey("frame", ANY_TEXT, "the parent: another frame, an obstacle, or a link that does not move", "", ""),
    rules=ONE_ORIENTATION,
)

HELD = KeyTable(
    "open_and_grip",
    "Two values of a finger joint of the robot.",
    required("open", NUMBER, "before the grasp and after the release", "rad or m"),
    required("grip", NUMBER, "from the grasp to the release", "rad or m"),
)

FINGERS = KeyTable(
    "fingers",
    "Two fingers of a parallel gripper that are not part of the robot.",
    required("opening", POSITIVE, "distance between their faces before the grasp", "m"),
    required("grip", POSITIVE, "distance between their faces on the object", "m"),
    _field(
        GripperFingers,
        "axis",
        VECTOR,
        "opening direction of the first finger, in the tcp frame; the second moves in the opposite direction",
    ),
    required("bodies", list_of(OBSTACLE, 2, 2), "the two fingers, fully closed; poses are tcp_from_body"),
)


CUP = KeyTable(
    "cup",
    "The face of a suction cup: a disc centred at the tip, which faces along the z axis of the tip.",
    required("radius", ABOVE_ZERO, "radius of the face, above 0", "m"),
    _field(
        SuctionCup,
        "gap",
        ABOVE_ZERO,
        "largest distance of any point of the rim from the surface of the object along the axis; bellows allow "
        "more than a flat cup",
        "m",
    ),
    _field(SuctionCup, "tilt", ABOVE_ZERO, "largest angle between the face and the surface at its rim", "rad"),
)


CONVEYOR = KeyTable(
    "conveyor",
    "A belt of constant speed. A pick whose `object` is one of `parts` is judged on the moving belt; its pose, and "
    "those of the parts in the scene file, are at time 0.",
    required("speed", ABOVE_ZERO, "speed of the belt, above 0", "m/s"),
    required("parts", list_of(TEXT, 1), "the obstacles that move"),
    _field(Conveyor, "direction", VECTOR, "direction of the motion in the frame of the root link; it is normalised"),
    _field(Conveyor, "dwell", POSITIVE, "time for which the tool follows the part while the gripper closes", "s"),
    _field(Conveyor, "duration", ABOVE_ZERO, "time for which the belt runs", "s"),
    _field(
        Conveyor,
        "tolerance",
        POSITIVE,
        "how far a part may be ahead or behind on the belt; the certificates include it",
        "m",
    ),
)


GRIP_LIMITS = KeyTable(
    "grip_limits",
    "The criteria for holding an object.",
    _field(GripLimits, "area", POSITIVE, "smallest contact area of each finger", "m²"),
    _field(GripLimits, "overlap", POSITIVE, "smallest extent of each contact along the finger", "m"),
    _field(
        GripLimits,
        "angle",
        POSITIVE,
        "largest angle between a contact normal and the closing direction, and half angle of the friction cones",
        "rad",
    ),
    _field(GripLimits, "gap", POSITIVE, "largest distance of a closed finger from the object", "m"),
    _field(GripLimits, "depth", POSITIVE, "largest penetration of a closed finger into the object", "m"),
    _field(GripLimits, "compliance", POSITIVE, "compliance of pads and object; above 0", "m"),
    _field(
        GripLimits,
        "tip",
        POSITIVE,
        "largest distance of the tip of a tool without fingers from the surface of the object",
        "m",
    ),
)

_ROBOT_KEYS = (
    FileKey("robot", TEXT, "a name of the catalogue, or a robot file (URDF, xacro, MJCF, DH table)"),
    FileKey("srdf", TEXT, "an SRDF file of the robot"),
    FileKey(
        "package_dirs",
        any_of(TEXT, list_of(TEXT)),
        "a folder, or a list of folders, that contain ROS packages",
        "",
        [],
    ),
    FileKey(
        "xacro_args",
        mapping_to({"type": ["string", "number", "boolean"]}),
        "values of the arguments of a xacro file",
        "",
        {},
    ),
    FileKey("limits", TEXT, "a file of [joint limits](limits.md)"),
    FileKey("tcp", TEXT, "the tcp frame of the arm; by default that of the robot"),
    FileKey(
        "held",
        mapping_to(any_of(NUMBER, HELD)),
        "values of joints outside the arm, by name; two values for finger joints of the robot, whose links may "
        "touch the object",
        "rad or m",
        {},
    ),
)

_HAND_KEYS = (
    FileKey(
        "home",
        mapping_to(NUMBER),
        "joint values, by name, where motions start; by default the robot's own",
        "rad or m",
    ),
    FileKey("tip", POSE, "tcp_from_tip: the frame that is moved to the poses of picks", "", {}),
    FileKey(
        "tool",
        list_of(OBSTACLE),
        "bodies that move with the tcp, grey without `rgba`; poses are tcp_from_body",
        "",
        [],
    ),
    FileKey("fingers", FINGERS, "two moving fingers that are not part of the robot"),
    FileKey("cup", CUP, "a suction cup at the tip, instead of fingers; its body is one of `tool`"),
    FileKey(
        "gripper",
        list_of(ANY_TEXT),
        "more links of the robot that may touch the object, as `tool` and `fingers` may",
        "",
        [],
    ),
    FileKey(
        "payload",
        any_of(PAYLOAD, list_of(PAYLOAD)),
        "the mass of the tool, or of several bodies; the torque limits of the joints then apply",
    ),
)

CELL_ROBOT = KeyTable(
    "cell_robot",
    "One of several robots. A key that it does not state is that of the file.",
    required("base", POSE, "the pose of the base link of its arm in the frame `world`"),
    *_ROBOT_KEYS,
    *_HAND_KEYS,
)

PICKS = KeyTable(
    "picks",
    "A picks file: the picks, and the robot, scene and gripper that they share. Files that it names are relative to "
    "its folder.",
    *_ROBOT_KEYS,
    FileKey("scene", TEXT, "a [scene file](scene.md); by default an empty scene"),
    FileKey("margin", POSITIVE, "smallest allowed distance between any two bodies", "m", 0.0),
    *_HAND_KEYS,
    FileKey(
        "torque_limits",
        BOOLEAN,
        "whether the torque limits of the joints (effort in the URDF, or in `limits`) apply without a payload too",
        "",
        False,
    ),
    FileKey("conveyor", CONVEYOR, "a belt that moves objects of picks"),
    FileKey("grip_limits", GRIP_LIMITS, "the criteria for holding an object", "", {}),
    FileKey(
        "optimise",
        COUNT,
        "number of evaluations to shorten each transit and each transfer; 0 to follow the planned paths",
        "",
        default_of(PickBudget, "motion"),
    ),
    _field(
        Picks,
        "straight",
        {"$ref": NUMBER, "exclusiveMinimum": 0, "maximum": 1},
        "share of each approach and retreat, next to the part, that is a straight line; the arm may leave out the rest "
        "to pass without a stop. All of it is straight where `speed` limits the stage",
    ),
    FileKey(
        "robots",
        mapping_to(CELL_ROBOT),
        "several robots by name: all poses are then in the frame `world`, and links and joints have the prefix "
        "`NAME/` in the scene",
        "",
        {},
    ),
    FileKey("frames", mapping_to(FRAME), "named frames for the poses of picks and places", "", {}),
    FileKey("defaults", DEFAULTS, "keys of picks that apply where a pick does not state them", "", {}),
    required(
        "picks",
        any_of(
            list_of(PICK, 1),
            {"title": "name of a table (`.csv`)", "type": "string", "pattern": r"[^/.]\.[cC][sS][vV]$"},
        ),
        "the picks, or a table of them in a CSV file",
    ),
)

COLUMNS = {
    "name": ("name",),
    "xyz": ("x", "y", "z"),
    "rpy": ("roll", "pitch", "yaw"),
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "frame": ("frame",),
    "approach": ("approach",),
    "approach_direction": ("approach_x", "approach_y", "approach_z"),
    "approach_frame": ("approach_frame",),
    "retreat": ("retreat",),
    "retreat_direction": ("retreat_x", "retreat_y", "retreat_z"),
    "retreat_frame": ("retreat_frame",),
    "spin": ("spin",),
    "object": ("object",),
    "support": ("support",),
    "place.xyz": ("place_x", "place_y", "place_z"),
    "place.rpy": ("place_roll", "place_pitch", "place_yaw"),
    "place.object_pose.xyz": ("place_object_x", "place_object_y", "place_object_z"),
    "place.object_pose.rpy": ("place_object_roll", "place_object_pitch", "place_object_yaw"),
    "place.frame": ("place_frame",),
    "place.approach": ("place_approach",),
    "place.retreat": ("place_retreat",),
    "place.support": ("place_support",),
    "upright": ("upright",),
    "payload.mass": ("mass",),
    "payload.center_of_mass": ("center_x", "center_y", "center_z"),
    "speed": ("speed",),
    "arm": ("arm",),
}
"""The keys that a row of a table can state, and their columns."""
