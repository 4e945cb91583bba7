"""Files of motion libraries: motions with hashes of themselves and of the setup for which they were certified."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.common.file_keys import PLAIN_NUMBER, KeyTable, fault_in, list_of, required
from pinproof.common.files import read_text, unknown_suffix, write_text_whole
from pinproof.errors import FileError
from pinproof.motion import Trajectory
from pinproof.motion.motion_keys import MOTION
from pinproof.motion.trajectory_files import Reader, from_message, to_message

SCHEMA = "pinproof/library/1"
"""The version of the format, raised by breaking changes."""

NAME: dict[str, Any] = {"type": "string"}

STORED = KeyTable(
    "stored_motion",
    "A motion of the library.",
    required("name", NAME, "name of the motion"),
    required("sha256", NAME, "hash (SHA-256, hexadecimal) of its curve"),
    required("motion", MOTION, "the motion, as in a motion file"),
)

LIBRARY = KeyTable(
    "library",
    "A library of motions. A file contains no proofs: the motions are certified again when it is read.",
    required("schema", {"const": SCHEMA}, "name and version of this format"),
    required("made_by", NAME, "the program that wrote the file"),
    required("robot", NAME, "name of the robot"),
    required("robot_sha256", NAME, "hash of kinematics, joints, held joints and link geometry"),
    required("tool_sha256", NAME, "hash of the attached objects"),
    required("margin", PLAIN_NUMBER, "required distance between any two bodies", "m"),
    required("joint_tolerance", list_of(PLAIN_NUMBER, 1), "deviation of each joint that is covered", "rad or m"),
    required("obstacle_tolerance", PLAIN_NUMBER, "displacement of obstacles that is covered", "m"),
    required("motions", list_of(STORED), "the motions"),
)


class LibraryContent(NamedTuple):
    """The content of a file."""

    joint_tolerance: list[float]
    """The deviation (rad or m) of each joint that certificates cover."""
    obstacle_tolerance: float
    """The displacement (m) of obstacles that they cover."""
    motions: dict[str, Trajectory]
    """The motions by name."""


def write(
    path: Path,
    checker: CollisionChecker,
    tolerances: tuple[npt.ArrayLike, float],
    motions: Mapping[str, Trajectory],
) -> None:
    """Write motions that were certified with a checker, atomically.

    Raises
    ------
    FileError
        If it has another suffix than ``.json``, or cannot be written.
    """
    if path.suffix != ".json":
        raise FileError(path, unknown_suffix(path, [".json"]))
    joints = np.broadcast_to(np.asarray(tolerances[0], dtype=float), checker.group.dof)
    head = {
        "schema": SCHEMA,
        "made_by": f"pinproof {version('pinproof')}",
        **_setup(checker),
        "joint_tolerance": joints.tolist(),
        "obstacle_tolerance": tolerances[1],
    }
    rows = [
        {"name": name, "sha256": motion.digest(), "motion": to_message(motion.record(motion.certified))}
        for name, motion in motions.items()
    ]
    text = json.dumps(head, allow_nan=False)[:-1] + ',\n "motions": [\n  '
    write_text_whole(path, text + ",\n  ".join(json.dumps(row, allow_nan=False) for row in rows) + "\n ]}\n")


def read(path: Path, checker: CollisionChecker) -> LibraryContent:
    """Read a file for a checker.

    Raises
    ------
    FileError
        If it cannot be read, is not structured as described by :data:`LIBRARY`, was changed, or is for another setup.
    """
    reader = Reader(path)
    data = reader.json(read_text(path, FileError))
    if fault := fault_in(LIBRARY, data):
        _fail(path, fault[1], fault[0])
    _refuse_other_setup(path, data, checker)
    motions: dict[str, Trajectory] = {}
    for i, row in enumerate(data["motions"]):
        place = f"motions[{i}]"
        if row["name"] in motions:
            _fail(path, f"has two motions named {row['name']!r}", place)
        trajectory = Trajectory.of_record(from_message(reader, row["motion"]))
        if trajectory.digest() != row["sha256"]:
            _fail(path, f"the motion {row['name']!r} was changed: its hash differs from sha256", place)
        if trajectory.joint_names != checker.group.joint_names:
            _fail(path, f"the motion {row['name']!r} has the joints {', '.join(trajectory.joint_names)}", place)
        motions[row["name"]] = trajectory
    return LibraryContent(data["joint_tolerance"], data["obstacle_tolerance"], motions)


def _refuse_other_setup(path: Path, data: Mapping[str, Any], checker: CollisionChecker) -> None:
    own = _setup(checker)
    what = {
        "robot_sha256": f"the robot {data['robot']!r} with other kinematics, link geometry or held joints than yours",
        "tool_sha256": "other attached objects than your checker has",
        "margin": f"a margin of {data['margin'] * 1e3:.9g} mm; your checker has {checker.margin * 1e3:.9g} mm",
    }
    for key, text in what.items():
        if data[key] != own[key]:
            _fail(path, f"its motions were certified for {text}; certify and store them again", key)
    if len(data["joint_tolerance"]) != checker.group.dof or min(data["joint_tolerance"]) < 0:
        _fail(path, f"must have {checker.group.dof} numbers, 0 or more", "joint_tolerance")
    if data["obstacle_tolerance"] < 0:
        _fail(path, "must be 0 or more", "obstacle_tolerance")


def _setup(checker: CollisionChecker) -> dict[str, Any]:
    """What must agree between the checkers that write and read a library."""
    group = checker.group
    robot, tool = hashlib.sha256(), hashlib.sha256()
    robot.update(repr((group.robot.urdf.kinematics, dict(group.ends), group.joint_names, dict(group.held))).encode())
    for body in checker.bodies:
        if body.link is not None:
            (robot if body.owner == body.link else tool).update(body.content())
    return {
        "robot": group.robot.name,
        "robot_sha256": robot.hexdigest(),
        "tool_sha256": tool.hexdigest(),
        "margin": checker.margin,
    }


def _fail(path: Path, reason: str, place: str) -> NoReturn:
    raise FileError(path, reason, place)
