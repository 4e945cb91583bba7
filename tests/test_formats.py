"""File formats: readers, JSON Schemas and pages of the manual agree on the keys, and the schemas on the files."""

from __future__ import annotations

import copy
import json
import os
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import format_tables
import jsonschema
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision import Attachments
from pinproof.collision.geometry.shapes import SHAPES_BY_KEY
from pinproof.common.files import parse_number, read_yaml
from pinproof.errors import FileError
from pinproof.formats import FORMATS
from pinproof.model import JointLimits
from pinproof.picks.input.picks import CELL_ROBOT
from pinproof.picks.input.sources import COLUMNS
from pinproof.verifier import proof as verifier_proof
from pinproof.verifier.parts import Body, Curve, Joint

from .fuzz import samples
from .fuzz.mutations import worse_tree
from .motion.test_motion_program import program
from .pages import ROOT

PAGES = ROOT / "docs" / "formats"


def picks(path: Path) -> None:
    """Read a picks file; a row with a problem is an error here."""
    if problems := pp.read_picks(path).problems:
        raise FileError(path, problems[0].reason)


READERS: dict[str, Callable[[Path], object]] = {
    "scene": pp.Scene.load,
    "attached": Attachments.load,
    "picks": picks,
    "tool": pp.picks.Tool.load,
    "tool_paths": pp.tool_paths.read_tool_paths,
    "dh": pp.DhTable.load,
    "limits": JointLimits.load,
    "motion": pp.Trajectory.load,
    "program": pp.motion.MotionProgram.load,
}

WRITTEN_AS_JSON = (
    "motion",
    "library",
    "program",
    "proof",
    "report",
    "sequence",
    "allocation",
    "placement",
    "comparison",
    "tolerance",
)

EVERY_WAY = {
    "approach": 0.1,
    "approach_direction": [0, 0, 1],
    "approach_frame": "tip",
    "retreat": 0.1,
    "retreat_direction": [0, 0, "1"],
    "retreat_frame": "root",
}
SHAPES = [
    *samples.SCENE["obstacles"],
    {"name": "tip", "cone": {"radius": 0.1, "length": 0.2}, "quat_xyzw": [0, 0, 0, 1]},
]
EVERY_PICK = {
    "xyz": [0, 0, 0.02],
    "rpy": ["pi", 0, 0],
    "frame": "tray",
    **EVERY_WAY,
    "spin": {"range": ["-pi", "pi"], "steps": 12},
    "tolerance": {"position": [0.005, 0.005, 0], "tilt": 0.1},
    "object": "part_{i}_{j}",
    "support": ["tray_floor", "bin"],
    "place": {"frame": "tray", "xyz": [0, 0.3, 0.02], "rpy": ["pi", 0, 0], **EVERY_WAY, "support": "bin"},
    "upright": "5 deg",
    "upright_axis": [0, 0, -1],
    "payload": {"mass": 1.5, "center_of_mass": [0, 0, 0.01], "inertia": [0.01, 0.01, 0.01]},
    "speed": {
        "transit": 1,
        "approach": 0.1,
        "retreat": 0.5,
        "transfer": {
            "linear_speed": 0.5,
            "angular_speed": 1,
            "linear_acceleration": 2,
            "angular_acceleration": 5,
        },
        "place": 0.1,
        "leave": 0.1,
    },
    "arm": "left",
}
GRASP_KEYS = {key: EVERY_PICK[key] for key in ("xyz", "rpy", *EVERY_WAY, "spin", "tolerance")}
TURNED = {**EVERY_PICK, "quat_xyzw": [1, 0, 0, 0], "spin": "free", "support": "bin", "speed": 0.25}
TURNED.pop("rpy")
LIMITED = {f"has_{kind}_limits": True for kind in ("position", "velocity", "acceleration", "deceleration", "jerk")}
EVERYTHING: dict[str, Any] = {
    "scene": {
        **samples.SCENE,
        "obstacles": SHAPES,
        "margins": [{"between": ["picker", "table"], "margin": 0.01}],
    },
    "attached": {
        "attached": SHAPES,
        "allowed_contacts": [["picker", "part"]],
        "held": {"rail": 0.5},
        "tip": {"quat_xyzw": [0, 0, 0, 1]},
    },
    "picks": {
        **samples.PICKS,
        "held": {"finger": 0.04, "thumb": {"open": 0.04, "grip": 0.02}},
        "grip_limits": {"area": 4e-6, "overlap": 0.002, "angle": 0.4, "gap": 0.001, "depth": 0.001, "compliance": 2e-4,
                        "force": 40, "force_limit": 80, "friction": 0.4, "hold": True,
                        "tip": 0.005},
        "payload": {"mass": 0.8, "center_of_mass": [0, 0, 0.05], "inertia": [0.01, 0.01, 0.01], "frame": "flange"},
        "torque_limits": True,
        "windings": {"wrist_3_joint": "400 deg"},
        "margins": [{"between": ["picker", "table"], "margin": 0}],
        "optimise": 20,
        "straight": 0.75,
        "program": {"tool": "picker", "flange": "flange", "frame": "tray", "output": "1", "input": "2", "timeout": 0.5,
                    "error": "recover", "main": True,
            "home": False, "external_axes": ["rail"]},
        "frames": {
            "tray": {"xyz": [0.4, 0, 0], "rpy": [0, 0, "pi/2"], "frame": "table"},
            "box": {"quat_xyzw": [0, 0, 0, 1]},
        },
        "tip": {"xyz": [0, 0, 0.1], "quat_xyzw": [0, 0, 0, 1]},
        "defaults": {key: value for key, value in EVERY_PICK.items() if key != "object"},
        "picks": [
            {"name": "all", **EVERY_PICK, "pattern": {"grid": {"counts": [2, 1, 1], "step": [0.05, 0.05, 0]}}},
            {"name": "turned", **TURNED, "place": {"xyz": [0, 0, 0], "quat_xyzw": [1, 0, 0, 0]}},
            {
                "name": "shape",
                **EVERY_PICK,
                "object": {**SHAPES[0], "name": "held"},
                "place": {"object_pose": {"xyz": [0, 0, 0], "rpy": [0, 0, "pi/2"]}},
            },
            *(
                {"name": f"held {k}", **EVERY_PICK, "object": {key: shape[key] for key in shape if key != "name"}}
                for k, shape in enumerate(SHAPES)
            ),
        ],
    },
    "dh": {
        **samples.DH,
        "base": {"matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.1], [0, 0, 0, 1]]},
        "rows": [
            *samples.DH["rows"],
            {"name": "j4", "type": "continuous", "theta": 0, "d": 0, "a": 0, "alpha": 0, "effort": 50},
        ],
    },
    "limits": {
        "joint_limits": {
            **samples.LIMITS["joint_limits"],
            "all": {
                **LIMITED,
                "min_position": -1,
                "max_position": 1,
                "max_velocity": 1,
                "max_acceleration": 1,
                "max_deceleration": -1,
                "max_jerk": 1,
                "has_effort_limits": True,
                "max_effort": 1,
                "angle_wraparound": False,
            },
        },
        "default_velocity_scaling_factor": 0.1,
        "default_acceleration_scaling_factor": 0.1,
    },
    "motion": {
        **samples.MESSAGE,
        "header": {"frame_id": ""},
        "points": [
            *samples.MESSAGE["points"],
            {
                "positions": [1, 2],
                "velocities": [0, 0],
                "accelerations": [0, 0],
                "effort": [],
                "time_from_start": {"secs": 3, "nsecs": 0},
            },
        ],
        "pinproof": {
            "version": 1,
            "interpolant": "quintic Hermite between points",
            "units": {
                "positions": "rad or m",
                "velocities": "rad/s or m/s",
                "time_from_start": "s and ns",
                "accelerations": "rad/s^2 or m/s^2",
            },
            "limits_note": "stated",
            "certified": [
                {
                    "name": "motion",
                    "start": 0.0,
                    "end": 3.0,
                    "status": "FREE",
                    "clearance": None,
                    "margin": 0.0,
                    "pairs": 3,
                    "curve": "c",
                    "setup": "s",
                    "attached": {"tool": "t"},
                    "held": {"rail": 0.5},
                    "obstacles": ["table"],
                    "constraints": ["upright"],
                    "calibrations": {
                        "ur5": {
                            "path": "calibration.csv",
                            "format": "differences",
                            "like": None,
                            "convention": "modified",
                            "joints": ["a"],
                            "deltas": [[0.0, 0.0, 0.001, 0.0]],
                            "origins": None,
                        }
                    },
                }
            ],
        },
    },
    "program": json.loads(program(quintic=True).to_json()),
}  # fmt: skip
"""For each format that is read a file in which nearly every key occurs."""

OTHER_PICKS = {
    **{key: value for key, value in EVERYTHING["picks"].items() if key != "fingers"},
    "robot": "arm.urdf.xacro",
    "srdf": "arm.srdf",
    "package_dirs": ["."],
    "xacro_args": {"length": 0.5, "name": "arm", "long": True},
    "calibration": "calibration.conf",
    "visual_bodies": False,
    "limits": "joint_limits.yaml",
    "held": {"finger": 0.04},
    "payload": [{"mass": 1}, {"mass": 2, "inertia": [[0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]]}],
    "cup": {"radius": 0.015, "gap": 0.001, "tilt": 0.1, "rise": 0.002, "force": 30, "friction": 0.5},
    "conveyor": {
        "speed": 0.2,
        "parts": ["bolt"],
        "direction": [0, 1, 0],
        "dwell": 0.2,
        "duration": 50,
        "tolerance": 0.001,
    },
    "defaults": TURNED,
    "tip": {"rpy": [0, 0, 0]},
    "picks": [
        {
            "name": "shape",
            **TURNED,
            "object": {"name": "held", "sphere": {"radius": 0.1}, "rpy": [0, 0, 0], "quat_xyzw": [0, 0, 0, 1]},
        }
    ],
}
OTHER_PICKS["picks"][0]["object"].pop("rpy")
ROBOT_KEYS = ("robot", "srdf", "package_dirs", "xacro_args", "calibration", "visual_bodies", "limits", "tcp")
HAND = {
    key: EVERYTHING["picks"][key] for key in ("tip", "tool", "fingers", "gripper", "held", "payload", "grip_limits")
}
CUP = {
    **{key: value for key, value in HAND.items() if key != "fingers"},
    "held": {},
    "cup": OTHER_PICKS["cup"],
    "tool": SHAPES,
}
EVERYTHING["tool"] = {**{key: OTHER_PICKS[key] for key in ROBOT_KEYS}, **HAND}
OF_STROKE = {"unit": "m", "speed": 0.1, "process": False, "reversible": False, "closed": False}
EVERYTHING["tool_paths"] = {
    **{key: OTHER_PICKS[key] for key in (*ROBOT_KEYS, "scene", "margin", "margins", "home")},
    **{key: EVERYTHING["picks"][key] for key in ("held", "tip", "program", "frames")},
    "tool": SHAPES,
    "frame": "tray",
    "part": SHAPES[:1],
    "speed": 0.2,
    "free_rotation": [-0.5, "pi/4"],
    "rotations": 12,
    "tilts": 4,
    "redundant": {"table": [0, "pi/2"]},
    "deviation": 0.002,
    "rotation_deviation": 0.02,
    "speed_tolerance": 0.1,
    "approach": 0.05,
    "departure": 0.1,
    "lifts": 1,
    "cost": {"time": 1, "travel": 0.1, "effort": 1, "limits": 1, "singularity": 1, "clearance": 1},
    "strokes": [
        {"name": "seam", "points": [[0, 0, 0], [0.1, 0, 0]], "normals": [0, 0, 1], **OF_STROKE},
        {"name": "curve", "points": [[0, 0, 0], [0.1, 0, 0]], "normals": [[0, 0, 1], [0, 0.1, 1]]},
        {"name": "poses", "poses": [{"rpy": ["pi", 0, 0]}, {"xyz": [0.1, 0, 0], "quat_xyzw": [1, 0, 0, 0]}]},
        {"file": "path.json"},
        {"file": "part.stl", "contour": {"normal": [0, 0, 1], "point": [0, 0, 0.01], "offset": 0.01}},
        {"name": "face", "file": "part.stl", "contour": {"face": 0, "bend": 0.01, "inset": 0.001}},
        {
            "name": "strips",
            "file": "part.stl",
            "raster": {
                "direction": [1, 0, 0],
                "spacing": 0.02,
                "normal": [0, 0, 1],
                "margin": 0.01,
                "joined": True,
                "offset": 0.01,
                "face": 4,
            },
        },
    ],
}
VALUES = {
    "held": {"thumb": HAND["held"]["thumb"]},
    "fingers": {"opening": 0.05, "grip": 0.02},
    "grip_limits": HAND["grip_limits"],
}
OF_CUP = {"cup": OTHER_PICKS["cup"]}
MIXED_PICKS = {
    "robot": "ur5",
    "tools": {"jaws": HAND, "cup": CUP, "other": "tool.yaml"},
    "tool_change": 8,
    "parts": {
        "bolt": {
            **{key: value for key, value in SHAPES[0].items() if key in ("box", "mesh")},
            **VALUES,
            "mass": 0.1,
            "center_of_mass": [0, 0, 0.01],
            "inertia": [0.01, 0.01, 0.01],
            "friction": 0.4,
            "tool": "jaws",
            "grasps": [
                {"name": "head", **GRASP_KEYS, **VALUES, "tool": "jaws"},
                {"xyz": [0, 0, 0], "quat_xyzw": [1, 0, 0, 0], "tool": "jaws"},
            ],
        },
        "sheet": {
            "sphere": {"radius": 0.05},
            "tool": "cup",
            **OF_CUP,
            "grasps": [{"xyz": [0, 0, 0], "rpy": [0, 0, 0], **OF_CUP}],
        },
        **{f"part {k}": {key: shape[key] for key in shape if key in SHAPES_BY_KEY} for k, shape in enumerate(SHAPES)},
    },
    "defaults": {"part": "bolt", "grasp": "head", "object": "bolt_1", "tool": "jaws", **VALUES},
    "picks": [
        {"name": "one", "part": "bolt", "grasp": "head", "object": "bolt_1", "tool": "jaws", **VALUES},
        {"name": "same"},
    ],
}
MIXED_PICKS["parts"] |= {
    name: {**part, "tool": "jaws"} for name, part in MIXED_PICKS["parts"].items() if "tool" not in part
}
CUP_PICKS = {
    "robot": "ur5",
    "tools": {"cup": CUP},
    "parts": {
        "sheet": {"sphere": {"radius": 0.05}, **OF_CUP, "grasps": [{"xyz": [0, 0, 0], "rpy": [0, 0, 0], **OF_CUP}]}
    },
    "defaults": {"part": "sheet", **OF_CUP},
    "picks": [{"name": "one", "object": "sheet_1", **OF_CUP}],
}
for tree in (EVERYTHING["picks"], OTHER_PICKS, MIXED_PICKS):
    own = {key: value for key, value in tree.items() if key in CELL_ROBOT.names}
    tree["robots"] = {"left": {"base": {"xyz": [-0.5, 0, 0]}, **own}, "right": {"base": {"rpy": [0, 0, "pi"]}}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("formats")
    samples.write_parts(folder)
    for name in ("arm.srdf", "joint_limits.yaml", "calibration.conf"):
        (folder / name).touch()
    (folder / "tool.yaml").write_text("tip: {xyz: [0, 0, 0.1]}")
    (folder / "path.json").write_text('{"points": [[0, 0, 0], [50, 0, 0]], "normals": [0, 0, 1]}')
    return folder


def file_of(name: str, folder: Path) -> Path:
    return folder / f"{name}.{'json' if name == 'program' else 'yaml'}"


def refused(name: str, tree: Any, folder: Path) -> str | None:
    """The reason for which the reader refuses a file; None if it accepts it."""
    file = file_of(name, folder)
    file.write_text(json.dumps(tree) if file.suffix == ".json" else samples.yaml_text(tree), encoding="utf-8")
    try:
        READERS[name](file)
    except pp.PinproofError as error:
        return str(error)
    return None


@cache
def validator(name: str) -> Any:
    return jsonschema.Draft202012Validator(pp.formats.file_schema(name))


def invalid(name: str, tree: Any) -> list[str]:
    """What the schema of a format refuses in a file."""
    return [f"{error.json_path}: {error.message}" for error in validator(name).iter_errors(tree)]


def valid(name: str, tree: Any) -> bool:
    """Whether the schema of a format accepts a file; this stops at the first error."""
    accepted: bool = validator(name).is_valid(tree)
    return accepted


def tables(name: str) -> dict[str, dict[str, Any]]:
    """The mappings of a format by title; that of the file is ``""``."""
    schema = pp.formats.file_schema(name)
    return {"": schema, **{title: each for title, each in schema["$defs"].items() if "properties" in each}}


def places(name: str, tree: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each mapping of a file that a table describes, with the title of the table."""
    schema = pp.formats.file_schema(name)

    def walk(value: Any, described: dict[str, Any], title: str | None) -> Iterator[tuple[str, dict[str, Any]]]:
        if "$ref" in described:
            title = described["$ref"].removeprefix("#/$defs/")
            described = schema["$defs"][title]
        for each in described.get("anyOf", ()):
            if not list(validator_of(each).iter_errors(value)):
                yield from walk(value, each, None)
                return
        if isinstance(value, dict) and "properties" in described:
            yield title or "", value
            for key, part in value.items():
                if key in described["properties"]:
                    yield from walk(part, described["properties"][key], None)
        elif isinstance(value, dict) and isinstance(described.get("additionalProperties"), dict):
            for part in value.values():
                yield from walk(part, described["additionalProperties"], None)
        elif isinstance(value, list) and "items" in described:
            for part in value:
                yield from walk(part, described["items"], None)

    def validator_of(part: dict[str, Any]) -> Any:
        return jsonschema.Draft202012Validator({"$defs": schema["$defs"], **part})

    yield from walk(tree, schema, None)


@pytest.mark.parametrize("name", FORMATS)
def test_each_schema_is_a_schema_without_unused_definitions(name: str) -> None:
    schema = pp.formats.file_schema(name)
    jsonschema.Draft202012Validator.check_schema(schema)
    text = json.dumps(schema)
    assert [title for title in schema["$defs"] if f'"#/$defs/{title}"' not in text] == []


def test_an_unknown_format_is_named_with_the_valid_ones() -> None:
    with pytest.raises(pp.UnknownNameError, match="unknown file format 'pick'; valid: picks"):
        pp.formats.file_schema("pick")


def test_the_readers_accept_every_key_of_the_schemas(folder: Path) -> None:
    used: dict[str, set[str]] = {}
    for name, tree in [
        *EVERYTHING.items(),
        ("dh", samples.DH),
        ("tool", CUP),
        ("picks", OTHER_PICKS),
        ("picks", MIXED_PICKS),
        ("picks", CUP_PICKS),
    ]:
        assert refused(name, tree, folder) is None
        assert invalid(name, tree) == []
        for title, mapping in places(name, tree):
            used.setdefault(title or name, set()).update(mapping)
    described = {title or name: set(table["properties"]) for name in READERS for title, table in tables(name).items()}
    assert used == described


def files_of(name: str) -> list[Any]:
    """Files of a format in which together every key occurs."""
    return copy.deepcopy(
        [EVERYTHING[name], *{"picks": [OTHER_PICKS, MIXED_PICKS, CUP_PICKS], "tool": [CUP]}.get(name, [])]
    )


@pytest.mark.parametrize("name", READERS)
@pytest.mark.slow
def test_reader_and_schema_refuse_an_unknown_key_wherever_it_is(name: str, folder: Path) -> None:
    seen = set()
    for tree in files_of(name):
        for title, mapping in list(places(name, tree)):
            if title in seen:
                continue
            seen.add(title)
            mapping["zzz"] = 1
            reason = refused(name, tree, folder)
            assert reason is not None, title
            assert "zzz" in reason or title in ("time_of_ros1", "time_of_ros2"), reason
            assert not valid(name, tree), title
            del mapping["zzz"]
    assert seen == set(tables(name))


@pytest.mark.parametrize("name", READERS)
@pytest.mark.slow
def test_reader_and_schema_refuse_a_mapping_without_a_required_key(name: str, folder: Path) -> None:
    described, lost = tables(name), set()
    for tree in files_of(name):
        for title, mapping in list(places(name, tree)):
            for key in described[title].get("required", ()):
                if (title, key) in lost:
                    continue
                lost.add((title, key))
                order = dict(mapping)
                del mapping[key]
                assert refused(name, tree, folder) is not None, (title, key)
                assert not valid(name, tree), (title, key)
                mapping.clear()
                mapping.update(order)
    assert {(title, key) for title, table in described.items() for key in table.get("required", ())} == lost


BEYOND_A_SCHEMA = re.compile(
    # not finite; ragged; the names of two things are equal; a key is not a text
    r"finite|inf|nan\b|too large for a double"
    r"|inhomogeneous|a second|already named|named .* twice|is not a name|joint \S+ must be a name"
    # related numbers
    r"|smaller angle first"
    r"|no hull|Mesh\.triangles|PointCloud\.resolution|must lie below|not a rigid|quaternion of length"
    r"|no body has the inertia"
    # grids and their depth images
    r"|no cell of the bounds|far off the center|the image has|are empty|gives .* cells|median depth|inside an obstacle"
    r"|in the view of the camera|to below 90 deg"
    r"|with at most|no known leaf|cannot be decoded|does not hold the states|OccupancyGrid reaches|bounds reach"
    r"|the first angle must not exceed|required: 0 <= grip|is above|one per joint"
    r"|either all points|at time 0|increase strictly"
    # texts and units
    r"|is not a valid name|is not a valid robot name|full rotations|is too long"
    r"|coordinates are limited|number of seconds|must be an integer|sizes are from|larger than the image"
    # the parts of a program
    r"|differs from the motion|its hash is another|the certificate .* does not exist|the time of the last point"
    r"|the start of the segment|times must increase|joint_names contains|do not meet|at the connection"
    r"|sec must be from 0 to|the end of the segments|at the end of a segment|two events|starts at"
    r"|the arm does not rest|the arm moves at|accelerations are required"
    # the points of a tool path
    r"|the tool path extends over"
    r"|normals for \d+ points|normal \d+ has length 0|the first and the last pose|looks like mm/s"
    r"|the triangle with the number|the plane does not meet|inset|twice the margin|larger than the surface"
    r"|of a raster must"
    r"|does not face|a section needs|state the normal of the face|no planar face|closed surface|faces the direction"
    # the number of picks, the files
    r"|pattern\.grid has|there is no (file|folder)|only if the robot is|a cup and fingers"
)
"""Reasons for which a reader refuses a file that its schema accepts, because a schema cannot state them."""


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("grip_limits", {"compliance": 0}),
        ("grip_limits", {"angle": 2}),
        ("cup", {"radius": 0.01, "tilt": 2}),
        ("cup", {"radius": 0.01, "rise": 0}),
        ("cup", {"radius": 0.01, "force": 0}),
        ("grip_limits", {"friction": 0}),
        ("fingers", {**EVERYTHING["picks"]["fingers"], "axis": [0, 0, 0]}),
        ("conveyor", {**OTHER_PICKS["conveyor"], "direction": [0, 0.0, "0"]}),
        ("defaults", {"rpy": [0, 0, 0], "upright": 5}),
        ("defaults", {"rpy": [0, 0, 0], "upright": 0}),
        ("defaults", {"rpy": [0, 0, 0], "upright": 0.1, "upright_axis": [0, 0, 0]}),
        ("defaults", {"rpy": [0, 0, 0], "approach_direction": [0, 0, 0]}),
        ("defaults", {"rpy": [0, 0, 0], "approach": 21}),
        ("defaults", {"rpy": [0, 0, 0], "speed": 0}),
    ],
)
def test_reader_and_schema_refuse_numbers_out_of_range(key: str, value: Any, folder: Path) -> None:
    tree = {"picks": [{"name": "a", "xyz": [0, 0, 0], "rpy": [0, 0, 0]}], key: value}
    reason = refused("picks", tree, folder)
    assert reason is not None
    assert f"key {key}." in reason
    assert not valid("picks", tree)


EXAMPLES = int(os.environ.get("PINPROOF_FUZZ_EXAMPLES", "40"))


@pytest.mark.parametrize("name", READERS)
@settings(
    max_examples=EXAMPLES, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck)
)
@given(data=st.data())
@pytest.mark.slow
def test_reader_and_schema_agree_on_changed_files(name: str, folder: Path, data: st.DataObject) -> None:
    tree = data.draw(worse_tree(EVERYTHING[name], most=1))
    reason = refused(name, tree, folder)
    try:
        file = file_of(name, folder)
        tree = json.loads(file.read_text()) if file.suffix == ".json" else read_yaml(file, (), FileError)
    except FileError:
        assert reason is not None
        return
    if reason is None:
        found = invalid(name, tree)
        # The reader drops points of a cloud that are not finite, which JSON cannot contain.
        assert [each for each in found if "point_cloud.points" not in each or "inf is" not in each] == [], tree
    elif valid(name, tree):
        assert BEYOND_A_SCHEMA.search(reason), reason


def described_by(file: Path) -> str:
    """The format of a YAML file in robots/."""
    endings = {"dh.yaml": "dh", "scene.yaml": "scene", "seam.yaml": "tool_paths"}
    return next((name for ending, name in endings.items() if file.name.endswith(ending)), "picks")


@pytest.mark.parametrize(
    "file", sorted(ROOT.glob("robots/*/*.yaml")), ids=lambda file: f"{file.parent.name}/{file.name}"
)
def test_the_shipped_files_agree_with_their_schemas(file: Path) -> None:
    name = described_by(file)
    assert invalid(name, yaml.safe_load(file.read_text(encoding="utf-8"))) == []
    READERS[name](file) if name != "picks" else pp.read_picks(file)


def closed(schema: Any) -> Any:
    """The schema without additional keys, which other programs must accept and pinproof does not write."""
    if isinstance(schema, list):
        return [closed(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    found = {key: closed(value) for key, value in schema.items() if key not in ("if", "then", "else")}
    return {**found, "additionalProperties": False} if "required" in found and "properties" in found else found


@pytest.mark.slow
def test_written_files_agree_with_their_schemas(folder: Path) -> None:
    arm = pp.load_robot("generic_6dof").arm()
    table = pp.Obstacle("table", pp.Box(1, 1, 0.1), pp.pose((0, 0, -2), (0, 0, 1)), (0, 0, 1, 1))
    scene = pp.Scene([table], allowed=[(arm.base, "table")])
    checker = pp.CollisionChecker(arm, scene, attached=[pp.Obstacle("tool", pp.Sphere(0.001))])
    motion = pp.time_parametrise(pp.JointPath([arm.home, arm.home + 0.1], arm.joint_names), arm.limits)
    certificate = pp.certify(motion, checker, record=True).or_raise()
    motion.save(folder / "motion.json", certificate=certificate)
    program().save(folder / "program.json")
    certificate.save(folder / "proof.json")
    pp.MotionLibrary(checker).save(folder / "library.json")
    scene.save(folder / "written_scene.yaml")
    Attachments(tuple(checker.attached), (("tool", "table"),), {"rail": 0.5}, pp.pose((0, 0, 1))).save(
        folder / "written_attached.yaml"
    )
    pp.DhTable.load(ROOT / "robots" / "scara" / "dh.yaml").save(folder / "written_dh.yaml")
    report = pp.validate_picks(arm, scene, [pp.Pick("far", pp.pose((9, 0, 0)))])
    report.save(folder / "report.json")
    above = pp.Pick("above", arm.forward_kinematics(arm.home), approach=0.0, retreat=0.0)
    setup = pp.picks.PickSetup.make(arm, scene, pp.Picks([above]), home=None, rng=0)
    pp.sequence(setup, [above]).save(folder / "sequence.json")
    two = pp.assemble({"a": (arm, np.eye(4)), "b": (arm, pp.pose((2.5, 0, 0)))})
    far_apart = pp.cell.allocate(two, pp.Scene(), pp.Picks([above]))
    far_apart.save(folder / "allocation.json")
    region = pp.cell.PlacementRegion(x=(8, 9), y=(0, 1))
    few = pp.cell.PlacementBudget(grid=4, runs=0, certified=1)
    both = [above, pp.Pick("far", pp.pose((9, 0, 0)))]
    pp.place_base(arm, scene, both, region, placement_budget=few).save(folder / "placement.json")
    pp.cell.compare(report, report).save(folder / "comparison.json")
    pp.cell.tolerance_study(report, samples=0).save(folder / "tolerance.json")
    for name in FORMATS:
        if name in ("picks", "tool", "tool_paths", "limits"):
            continue  # pinproof does not write them
        file = folder / (f"{name}.json" if name in WRITTEN_AS_JSON else f"written_{name}.yaml")
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))
        errors = jsonschema.Draft202012Validator(closed(pp.formats.file_schema(name))).iter_errors(tree)
        assert [(error.json_path, error.message) for error in errors] == [], name


def test_the_schema_of_proofs_has_the_fields_of_the_verifier() -> None:
    described = tables("proof")
    known = {
        "": verifier_proof.FIELDS,
        "curve": Curve.FIELDS,
        "joint": Joint.FIELDS,
        "body": Body.FIELDS,
        "convex_shape": Body.SHAPE,
    }
    assert {title: set(fields) for title, fields in known.items()} == {
        title: set(described[title]["properties"]) for title in known
    }


@pytest.mark.parametrize("title", ["claim", "settings", "pair", "hashes"])
def test_the_verifier_refuses_a_proof_without_a_required_key_and_with_an_unknown_one(title: str, folder: Path) -> None:
    arm = pp.load_robot("generic_6dof").arm()
    pp.certify(pp.JointPath([arm.home], arm.joint_names), pp.CollisionChecker(arm), record=True).save(folder / "p.json")
    text = (folder / "p.json").read_text(encoding="utf-8")
    table = tables("proof")[title]

    def changed(change: Callable[[dict[str, Any]], object]) -> bool:
        proof = json.loads(text)
        change(proof["pairs"][0] if title == "pair" else proof[title])
        return verifier_proof.verify(proof).ok

    assert changed(lambda _: None)
    for key in table["required"]:
        assert not changed(lambda part, key=key: part.pop(key)), key
    assert changed(lambda part: part.update(zzz=1)) is table.get("additionalProperties", True)


def test_each_column_of_a_table_of_picks_is_a_key_of_a_pick() -> None:
    described = tables("picks")
    for path in COLUMNS:
        table = "pick"
        for key in path.split("."):
            assert key in described[table]["properties"], path
            table = {"place": "place", "object_pose": "pose", "payload": "object_payload"}.get(key, "")


def test_every_column_of_a_table_of_picks_is_read(folder: Path) -> None:
    values = {"name": "a", "frame": "tray", "approach_frame": "tip", "retreat_frame": "root", "spin": "free"}
    values |= {"object": "part", "support": "bin;tray", "place_frame": "tray", "place_support": "bin", "arm": "left"}
    robots = {"left": {"base": {}}}
    (folder / "many.json").write_text(json.dumps({"robots": robots, "picks": "many.csv"}), encoding="utf-8")
    one = {name: values.get(name, "0.1") for names in COLUMNS.values() for name in names}
    for left_out in (
        ("grasp", "quat_xyzw", "place.object_pose.xyz", "place.object_pose.rpy"),
        ("xyz", "frame", "quat_xyzw", "rpy", "place.xyz", "place.rpy"),
    ):
        gone = {name for key in left_out for name in COLUMNS[key]}
        row = {name: value for name, value in one.items() if name not in gone}
        (folder / "many.csv").write_text(",".join(row) + "\n" + ",".join(row.values()) + "\n", encoding="utf-8")
        found = pp.read_picks(folder / "many.json")
        assert found.problems == ()
        (pick,) = found
        assert pick.place is not None
        assert (pick.arm, pick.part, pick.tool) == ("left", "0.1", "0.1")
        assert pick.by_part is ("xyz" in left_out)
        assert pick.place.pose_of == ("object" if "place.xyz" in left_out else "tip")


@pytest.mark.parametrize("name", FORMATS)
def test_the_page_of_a_format_is_up_to_date(name: str) -> None:
    text = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    assert format_tables.page(name) == text, "run scripts/format_tables.py"


SECTION = re.compile(r"^### (\S+)\n\n(.*?)(?=^### |^<!-- end)", re.MULTILINE | re.DOTALL)
SAME = re.compile(r"It has the keys of \[(\w+)\]\(.*?\)(?: except (.*?))?\.$", re.MULTILINE)


def test_the_pages_name_every_key_of_the_schemas_and_no_other() -> None:
    found: dict[str, dict[str, set[str]]] = {}
    for name in FORMATS:
        text = (PAGES / f"{name}.md").read_text(encoding="utf-8").partition("<!-- begin: keys")[2]
        for title, content in SECTION.findall(text):
            keys = set(re.findall(r"^\| `(\w+)` \|", content, re.MULTILINE))
            if same := SAME.search(content):
                other = tables(name)[same[1]]["properties"]
                keys |= set(other) - set(re.findall(r"`(\w+)`", same[2] or ""))
            found.setdefault(name, {})["" if title == "File" else title] = keys
    everywhere = {title: keys for page in [*found.values()][::-1] for title, keys in page.items() if title}
    for name in FORMATS:
        described = {title: set(table["properties"]) for title, table in tables(name).items()}
        assert found[name][""] == described[""]
        assert {title: found[name].get(title, everywhere.get(title)) for title in described} == described


def test_a_number_of_the_schema_is_one_that_the_reader_accepts() -> None:
    pattern = re.compile(pp.formats.file_schema("picks")["$defs"]["number"]["pattern"])
    for text in ("1", "-1.5e-3", "pi", "-pi/2", "3*pi/4", " 2 * pi ", "+.5", "1.", "1e5"):
        assert pattern.search(text)
        parse_number(text)
    for text in ("", "abc", "1,5", "pi pi", "1_0", "nan", "inf", "2pi", "pi*2", "0x10", "\u0663"):
        assert not pattern.search(text)
        with pytest.raises(ValueError, match="is not a number"):
            parse_number(text)


@given(st.from_regex(re.compile(r"[-+ .0-9epi*/]{0,12}"), fullmatch=True))
def test_texts_of_numbers_are_the_same_in_schema_and_reader(text: str) -> None:
    accepted = True
    try:
        parse_number(text)
    except ValueError:
        accepted = False
    pattern = re.compile(pp.formats.file_schema("picks")["$defs"]["number"]["pattern"])
    zero = re.search(r"/\s*[0.]+\s*$", text)  # a schema cannot state that the divisor is not zero
    assert accepted == (bool(pattern.search(text)) and not zero)
