"""The keys of the results of base placement, comparisons and tolerance studies in JSON."""

from __future__ import annotations

from pinproof.common.file_keys import (
    ANY_TEXT,
    BOOLEAN,
    COUNT,
    NOT_NEGATIVE,
    OPTIONAL_NUMBER,
    PLAIN_NUMBER,
    TEXT,
    any_of,
    list_of,
    mapping_to,
    numbers,
    report_table,
    required,
)

PLACEMENT_SCHEMA = "pinproof/placement/1"
COMPARISON_SCHEMA = "pinproof/comparison/1"
TOLERANCE_SCHEMA = "pinproof/tolerance/1"
"""The versions of the JSON formats, raised by breaking changes."""

SHARE = {**PLAIN_NUMBER, "minimum": 0, "maximum": 1}
RANGE = numbers(2, PLAIN_NUMBER)
FOUR = numbers(4, PLAIN_NUMBER)
GRID = list_of(list_of(OPTIONAL_NUMBER))


POSE = report_table(
    "placed_pose",
    "The pose of the root link of the robot in the cell.",
    required("xyz", numbers(3, PLAIN_NUMBER), "position", "m"),
    required("rpy", numbers(3, PLAIN_NUMBER), "orientation about fixed axes: R = Rz Ry Rx", "rad"),
)

PLACED = report_table(
    "placed",
    "A placement at which all picks were judged.",
    required("x", PLAIN_NUMBER, "position of the base", "m"),
    required("y", PLAIN_NUMBER, "position of the base", "m"),
    required("z", PLAIN_NUMBER, "position of the base", "m"),
    required("yaw", PLAIN_NUMBER, "rotation of the base about z", "rad"),
    required("choice", ANY_TEXT, "name of the discrete choice; empty if there is only one"),
    required("cell_from_root", POSE, "the pose with the mounting"),
    required("good", COUNT, "number of good picks"),
    required("picks", COUNT, "number of picks"),
    required("cycle_time", NOT_NEGATIVE, "sum of the times of all good picks", "s"),
    required("clearance_proven", OPTIONAL_NUMBER, "smallest proven clearance of all motions", "m"),
    required("estimate", OPTIONAL_NUMBER, "the value of the objective that the screening estimated"),
    required("score", OPTIONAL_NUMBER, "the certified value of the objective, which is minimised"),
)

SENSITIVITY = report_table(
    "sensitivity",
    "How far the base may be off along one axis, the others being exact, if the robot plans again. What is between the "
    "judged deviations is not proven.",
    required("axis", {"enum": ["x", "y", "z", "yaw"]}, "the axis"),
    required(
        "below", NOT_NEGATIVE, "lower values up to which all picks are good at every judged deviation", "m or rad"
    ),
    required("above", NOT_NEGATIVE, "the same to higher values", "m or rad"),
    required("first_below", ANY_TEXT, "what fails first at lower values: a pick, or the base; empty if nothing does"),
    required("first_above", ANY_TEXT, "what fails first at higher values"),
    required("why_below", ANY_TEXT, "the stage that fails there, or why the screening is not passed"),
    required("why_above", ANY_TEXT, "the same at higher values"),
    required("searched", NOT_NEGATIVE, "the largest deviation that was tried", "m or rad"),
    required("judged_below", COUNT, "the number of lower values at which all picks were judged good"),
    required("judged_above", COUNT, "the number of higher values at which all picks were judged good"),
)

FLOOR = report_table(
    "floor_map",
    "The best values over z and yaw at each x and y, for one choice; null where no value exists.",
    required("choice", ANY_TEXT, "name of the discrete choice"),
    required("share", GRID, "share of the picks that pass the screening, for each x a list over y"),
    required("seconds", GRID, "estimated cycle time", "s"),
)

MAP = report_table(
    "placement_map",
    "The heat map over the floor.",
    required("x", list_of(PLAIN_NUMBER), "the x of the grid", "m"),
    required("y", list_of(PLAIN_NUMBER), "the y of the grid", "m"),
    required("choices", list_of(FLOOR), "the maps of all choices"),
)

PLACEMENT = report_table(
    "placement",
    "The result of a search for a placement. Readers must accept unknown keys: they are additions of the same version.",
    required("schema", {"const": PLACEMENT_SCHEMA}, "version of the format"),
    required("ok", BOOLEAN, "whether a placement was found at which every pick is good"),
    required("objective", {"enum": ["cycle_time", "clearance", "manipulability"]}, "what was optimised"),
    required("message", ANY_TEXT, "the result in one line"),
    required("interrupted", BOOLEAN, "whether the search was interrupted"),
    required("evaluations", COUNT, "number of placements that were screened"),
    required("region", mapping_to(RANGE), "the ranges of x, y, z (m) and yaw (rad)"),
    required("forbidden", list_of(ANY_TEXT), "the names of the forbidden zones"),
    required("placements", list_of(PLACED), "the judged placements, the best first"),
    required("sensitivity", list_of(SENSITIVITY), "how far the base may be off at the best placement"),
    required("tolerance", NOT_NEGATIVE, "displacement of the base for which the unchanged motions are proven", "m"),
    required("failing", mapping_to(ANY_TEXT), "the reason for each pick that is good nowhere"),
    required("map", any_of(MAP, {"type": "null"}), "the heat map; null if the search was interrupted before"),
)

CHANGES = ("won", "lost", "faster", "slower", "same", "failing")

SIDE = report_table(
    "compared_verdict",
    "The verdict on a pick in one set-up.",
    required("verdict", {"enum": ["good", "impossible", "not found", "unreadable", "crashed"]}, "the verdict"),
    required("failed_at", {"type": ["string", "null"]}, "the stage that failed; null for a good pick"),
    required("duration", OPTIONAL_NUMBER, "duration of the motion", "s"),
    required("reason", ANY_TEXT, "why it failed"),
)

DIFFERENCE = report_table(
    "difference",
    "One pick in both set-ups.",
    required("name", TEXT, "name of the pick"),
    required("change", {"enum": list(CHANGES)}, "how the verdict changes"),
    required("before", SIDE, "in the first set-up"),
    required("after", SIDE, "in the second set-up"),
)

COMPARISON = report_table(
    "comparison",
    "Two set-ups compared pick by pick. Readers must accept unknown keys: they are additions of the same version.",
    required("schema", {"const": COMPARISON_SCHEMA}, "version of the format"),
    required("ok", BOOLEAN, "whether no pick is lost"),
    required("summary", ANY_TEXT, "the result in one line"),
    required("counts", mapping_to(COUNT), "number of picks by kind of change"),
    required("seconds_before", NOT_NEGATIVE, "sum of the times of the picks that are good in both, in the first", "s"),
    required("seconds_after", NOT_NEGATIVE, "the same in the second", "s"),
    required("cycle_time_before", NOT_NEGATIVE, "sum of the times of all good picks of the first", "s"),
    required("cycle_time_after", NOT_NEGATIVE, "sum of the times of all good picks of the second", "s"),
    required("picks", list_of(DIFFERENCE), "the picks"),
)

PICK_TOLERANCE = report_table(
    "pick_tolerance",
    "How inaccurate the pose of the part of one pick may be.",
    required("name", TEXT, "name of the pick"),
    required("good", BOOLEAN, "whether the pick is good at its stated pose"),
    required("proven", BOOLEAN, "whether the unchanged motions are certified for the whole tolerance"),
    required("factor", NOT_NEGATIVE, "the largest multiple of the tolerance that is certified"),
    required("displacement", NOT_NEGATIVE, "the displacement of any point of the part that the tolerance allows", "m"),
    required("limited_by", ANY_TEXT, "what cannot be certified beyond the factor"),
    required("share", OPTIONAL_NUMBER, "share of the sampled poses at which the grasp is free; null without samples"),
    required("largest_position", NOT_NEGATIVE, "the factor times the position tolerance", "m"),
    required("largest_rotation", NOT_NEGATIVE, "the factor times the rotation tolerance", "rad"),
)

TOLERANCE = report_table(
    "tolerance",
    "A study of the tolerance of picks. Readers must accept unknown keys: they are additions of the same version.",
    required("schema", {"const": TOLERANCE_SCHEMA}, "version of the format"),
    required("ok", BOOLEAN, "whether every pick is certified for the whole tolerance"),
    required("summary", ANY_TEXT, "the result in one line"),
    required("position", NOT_NEGATIVE, "tolerance of the position along each axis", "m"),
    required("rotation", NOT_NEGATIVE, "tolerance of the rotation about any axis", "rad"),
    required("distribution", {"enum": ["uniform", "normal"]}, "of the sampled poses"),
    required("samples", COUNT, "number of sampled poses for each pick"),
    required("largest", NOT_NEGATIVE, "the largest multiple of the tolerance that was tried"),
    required("proven_share", SHARE, "share of the picks that are certified for the whole tolerance"),
    required("sampled_share", SHARE, "share of the picks whose grasp is free at every sampled pose"),
    required("notes", list_of(ANY_TEXT), "what is not covered"),
    required("picks", list_of(PICK_TOLERANCE), "the picks"),
)
