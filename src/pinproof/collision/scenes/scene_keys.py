"""The keys of scene files, of files of attached bodies, and of the shapes and poses in other files."""

from __future__ import annotations

from typing import Any

from pinproof.collision.geometry.depth_image import DEPTH_UNCERTAINTY
from pinproof.collision.geometry.occupancy import PIXEL_MARGIN, POLICIES
from pinproof.collision.geometry.octomap_file import THRESHOLD
from pinproof.collision.geometry.shape_values import LARGEST_SIZE, SMALLEST_SIZE
from pinproof.collision.geometry.shapes import BELOW_LOWEST
from pinproof.common.file_keys import (
    ANGLE,
    ANY_TEXT,
    BOOLEAN,
    COUNT,
    INTEGER,
    NUMBER,
    TEXT,
    Definition,
    FileKey,
    KeyTable,
    any_of,
    list_of,
    mapping_to,
    numbers,
    required,
)

VECTOR = numbers(3)

SIZE = Definition("size", {"$ref": NUMBER, "minimum": SMALLEST_SIZE, "maximum": LARGEST_SIZE})
"""A length of a shape."""

COORDINATE = {"$ref": NUMBER, "minimum": -LARGEST_SIZE, "maximum": LARGEST_SIZE}
POINT = numbers(3, COORDINATE)

POSE_KEYS = (
    FileKey("xyz", VECTOR, "position x, y, z", "m", [0, 0, 0]),
    FileKey(
        "rpy", numbers(3, ANGLE), "roll, pitch, yaw about fixed axes: R = Rz(yaw) Ry(pitch) Rx(roll)", "rad", [0, 0, 0]
    ),
    FileKey("quat_xyzw", numbers(4), "a quaternion, scalar last, instead of `rpy`; it is normalised"),
)

ONE_ORIENTATION = {"not": {"required": ["rpy", "quat_xyzw"]}}

POSE = KeyTable("pose", "A position and an orientation.", *POSE_KEYS, rules=ONE_ORIENTATION)


def _shape(name: str, text: str, *keys: FileKey, about: str = "", **sizes: str) -> FileKey:
    """Return the key of a shape, whose table has ``keys`` and lengths, and the text ``about`` if it differs."""
    lengths = (required(key, SIZE, words, "m") for key, words in sizes.items())
    return FileKey(name, KeyTable(name, about or f"{text[0].upper()}{text[1:]}.", *keys, *lengths), text)


MESH = KeyTable(
    "mesh",
    "A triangle mesh, from a file or from vertices and triangles.",
    FileKey("path", TEXT, "the mesh (STL, OBJ, DAE, PLY, GLB or glTF), relative to the folder of this file"),
    FileKey("scale", any_of(NUMBER, VECTOR), "a factor, or one each for x, y, z; only with `path`", "", 1.0),
    FileKey("vertices", list_of(POINT, 3), "the vertices of a mesh without a file", "m"),
    FileKey("triangles", list_of(list_of(COUNT, 3, 3), 1), "three indices of vertices for each triangle"),
    FileKey(
        "hull",
        BOOLEAN,
        "`true`: the convex hull, which fills a bin; `false`: the triangles, which must be watertight. By default "
        "a watertight mesh is a solid of its own shape, and any other is replaced by its convex hull",
    ),
    FileKey("hollow", BOOLEAN, "`true`: only the surface, watertight or not", "", False),
    rules={
        "oneOf": [
            {"required": ["path"], "not": {"anyOf": [{"required": ["vertices"]}, {"required": ["triangles"]}]}},
            {"required": ["vertices", "triangles"], "not": {"required": ["scale"]}},
        ],
        "not": {"properties": {"hull": {"const": True}, "hollow": {"const": True}}, "required": ["hull", "hollow"]},
    },
)

POSITIVE = {"$ref": NUMBER, "exclusiveMinimum": 0}

INTRINSICS = KeyTable(
    "intrinsics",
    "A pinhole camera without distortion; the center of the first pixel is (0, 0).",
    required("fx", POSITIVE, "focal length along the rows", "pixels"),
    required("fy", POSITIVE, "focal length along the columns", "pixels"),
    required("cx", NUMBER, "column of the principal point", "pixels"),
    required("cy", NUMBER, "row of the principal point", "pixels"),
    required("width", {**INTEGER, "minimum": 1}, "columns of the image", "pixels"),
    required("height", {**INTEGER, "minimum": 1}, "rows of the image", "pixels"),
)


def _without(*keys: str) -> dict[str, Any]:
    """Return the rule of a schema that excludes some keys."""
    return {"not": {"anyOf": [{"required": [key]} for key in keys]}}


VIEW = KeyTable(
    "view",
    "A depth image and its camera.",
    FileKey("image", TEXT, "the image (NPY, PNG or EXR), relative to the folder of this file"),
    FileKey("points", TEXT, "instead of `image`: a point cloud (NPY, PLY or PCD) in the frame of the obstacle"),
    required("intrinsics", INTRINSICS, "the camera"),
    required("camera", POSE, "root_from_camera: x to the right, y downwards, z forward"),
    FileKey("depth_scale", POSITIVE, "metres per unit of the image, which images of integers need", "m"),
    FileKey(
        "depth_uncertainty", {"$ref": NUMBER, "minimum": 0}, "largest error of a measured depth", "m", DEPTH_UNCERTAINTY
    ),
    FileKey(
        "pixel_margin",
        COUNT,
        "pixels around the image of a cell that must be farther than the cell too",
        "",
        PIXEL_MARGIN,
    ),
    rules={
        "oneOf": [
            {"required": ["image"], **_without("points")},
            {"required": ["points"], **_without("image", "depth_scale")},
        ]
    },
)

_CELL_KEYS = ("low", "count", "record")


GRID = KeyTable(
    "occupancy_grid",
    "Space that depth images prove free, or that a map of OctoMap states free; everything else is an obstacle.",
    FileKey("voxel", SIZE, "with `views` or `cells`: side of a cell", "m"),
    FileKey("unknown", {"enum": list(POLICIES)}, "the state of cells that were not seen", "", POLICIES[0]),
    FileKey("views", list_of(VIEW, 1), "the depth images; a cell is free if one of them proves it free"),
    FileKey("octomap", TEXT, "a map of OctoMap (BT or OT), relative to the folder of this file, instead of `views`"),
    FileKey(
        "bounds",
        list_of(POINT, 2, 2),
        "lower and upper corner of the grid: required with `views`; with `octomap`, by default those of known space",
        "m",
    ),
    FileKey(
        "threshold",
        {"$ref": NUMBER, "exclusiveMinimum": 0, "exclusiveMaximum": 1},
        "with `octomap`: occupancy from which the leaves of an OT file are occupied",
        "",
        THRESHOLD,
    ),
    FileKey("cells", TEXT, "the states of the cells instead of `views`: base64 of zlib, as `Scene.save` writes it"),
    FileKey("low", list_of(INTEGER, 3, 3), "with `cells`: indices of the first cell"),
    FileKey("count", list_of({**INTEGER, "minimum": 1}, 3, 3), "with `cells`: numbers of cells along x, y, z"),
    FileKey("record", list_of({"type": "string"}), "with `cells`: how the grid was made"),
    rules={
        "oneOf": [
            {"required": ["voxel", "views", "bounds"], **_without("octomap", "threshold", "cells", *_CELL_KEYS)},
            {"required": ["octomap"], **_without("voxel", "views", "cells", *_CELL_KEYS)},
            {"required": ["voxel", "cells", "low", "count"], **_without("views", "octomap", "threshold", "bounds")},
        ]
    },
)

SHAPES: dict[str, FileKey] = {
    key.name: key
    for key in (
        FileKey("box", numbers(3, SIZE), "the full sides x, y, z of a box", "m"),
        _shape("sphere", "a sphere", radius="radius"),
        _shape("cylinder", "a cylinder about z", radius="radius", length="length from end to end"),
        _shape(
            "capsule",
            "a cylinder about z with two hemispherical caps",
            radius="radius",
            length="length of the cylinder, without the caps",
        ),
        _shape("cone", "a cone about z; its tip is at z = length / 2", radius="radius of the base", length="height"),
        _shape("ellipsoid", "an ellipsoid", rx="semi-axis along x", ry="semi-axis along y", rz="semi-axis along z"),
        _shape(
            "half_space",
            "all points below z = 0 of the obstacle's frame are solid, such as a floor; write `half_space: {}`",
            about="A half-space; it has no keys.",
        ),
        _shape(
            "convex_hull",
            "the convex hull of points",
            required("points", list_of(POINT, 4), "the points, which are not all in one plane", "m"),
        ),
        _shape(
            "point_cloud",
            "the points of a sensor; each cell of a grid that contains a point is solid",
            required("points", list_of(POINT, 1), "the points", "m"),
            about="The points of a sensor.",
            resolution="side of the cells of the grid; each cell that contains a point is solid",
        ),
        _shape(
            "height_map",
            "ground over a rectangle, solid from its surface down to its underside",
            required(
                "heights",
                list_of(list_of(COORDINATE, 2), 2),
                "rows of z at the points of a regular grid; row 0 is at y = -y / 2, column 0 at x = -x / 2",
                "m",
            ),
            required("x", SIZE, "full side of the rectangle along x", "m"),
            required("y", SIZE, "full side of the rectangle along y", "m"),
            FileKey("bottom", NUMBER, f"z of the underside; by default {BELOW_LOWEST} m below the lowest point", "m"),
            about="Ground over a rectangle about the origin.",
        ),
        FileKey(
            "occupancy_grid", GRID, "space that depth images prove free or a map states free; everything else is solid"
        ),
        FileKey("mesh", MESH, "a triangle mesh"),
    )
}
"""The keys of shapes; an obstacle has exactly one of them."""

_RULES = {"oneOf": [{"required": [kind]} for kind in SHAPES], **ONE_ORIENTATION}

_BODY_KEYS = (
    *SHAPES.values(),
    *POSE_KEYS,
    FileKey(
        "rgba",
        list_of({"$ref": NUMBER, "minimum": 0, "maximum": 1}, 4, 4),
        "colour and opacity in the viewer, each from 0 to 1",
    ),
)

OBSTACLE = KeyTable(
    "obstacle",
    "A body: a name, exactly one shape, a pose and a colour.",
    required("name", TEXT, "unique in its list"),
    *_BODY_KEYS,
    rules=_RULES,
)

BODY = KeyTable(
    "object",
    "The grasped object as a shape. Its pose is tip_from_object.",
    FileKey("name", TEXT, "its name in reports", "", "object"),
    *_BODY_KEYS,
    rules=_RULES,
)


def _pairs(what: str) -> FileKey:
    return FileKey("allowed_contacts", list_of(list_of(ANY_TEXT, 2, 2)), what, "", [])


SCENE = KeyTable(
    "scene",
    "A scene file of pinproof: obstacles, and contacts that are allowed. Poses are in the frame of the robot's root "
    "link.",
    required("obstacles", list_of(OBSTACLE), "the obstacles; `[]` for an empty scene"),
    _pairs("pairs of a robot link and an obstacle that may touch"),
    FileKey(
        "disabled_pairs",
        list_of(list_of(ANY_TEXT, 2, 2)),
        "pairs of robot links that a MoveIt matrix disables; they are checked unless the caller trusts them",
        "",
        [],
    ),
    FileKey("frame", ANY_TEXT, "the root link that the robot must have; by default any robot is accepted"),
)

ATTACHED = KeyTable(
    "attached",
    "Bodies that the arm carries at its tcp, for the option `--attached`. Poses are tcp_from_body.",
    required("attached", list_of(OBSTACLE), "bodies that move with the tcp"),
    _pairs("pairs of bodies (links, attached bodies, obstacles) that may touch"),
    FileKey("held", mapping_to(NUMBER), "values of joints outside the arm, by name", "rad or m", {}),
    FileKey("tip", POSE, "tcp_from_tip: the point of the tool that reaches a target", "", {}),
)
