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
from pinproof.common.files import read_text, unknown_suffix, write_text_whole
from pinproof.common.structs import (
    ANY_TEXT,
    NOT_NEGATIVE,
    PLAIN_NUMBER,
    Kind,
    Table,
    errors_of,
    list_of,
    required,
    schema_version,
)
from pinproof.errors import FileError
from pinproof.motion import MOTION, Reader, Trajectory, from_message, to_message

SCHEMA = "pinproof/library/1"
"""The version of the format, raised by breaking changes."""

STORED = Table(
    "stored_motion",
    "A motion of the library.",
    required("name", ANY_TEXT, "name of the motion"),
    required("sha256", ANY_TEXT, "hash (SHA-256, hexadecimal) of its curve"),
    required(
        "motion",
        Kind(MOTION, lambda _, motion: motion, lambda _, message, path: from_message(Reader(path), message)),
        "the motion, as in a motion file",
    ),
)

LIBRARY = Table(
    "library",
    "A library of motions. A file contains no proofs: the motions are certified again when it is read.",
    schema_version(SCHEMA),
    required("made_by", ANY_TEXT, "the program that wrote the file"),
    required("robot", ANY_TEXT, "name of the robot"),
    required("robot_sha256", ANY_TEXT, "hash of kinematics, joints, held joints and link geometry"),
    required("tool_sha256", ANY_TEXT, "hash of the attached objects"),
    required("margin", PLAIN_NUMBER, "required distance between any two bodies", "m"),
    required("joint_tolerance", list_of(NOT_NEGATIVE, 1), "deviation of each joint that is covered", "rad or m"),
    required("obstacle_tolerance", NOT_NEGATIVE, "displacement of obstacles that is covered", "m"),
    required("motions", list_of(STORED), "the motions"),
)


class LibraryContent(NamedTuple):
    """The content of a file."""

    joint_tolerance: tuple[float, ...]
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
    content = Reader(path).json(read_text(path, FileError))
    with errors_of(path, FileError):
        data = LIBRARY.parse("the file", content, path)
    _refuse_other_setup(path, data, checker)
    motions: dict[str, Trajectory] = {}
    for i, row in enumerate(data["motions"]):
        place = f"motions[{i}]"
        if row["name"] in motions:
            _fail(path, f"has two motions named {row['name']!r}", place)
        trajectory = Trajectory.of_record(row["motion"])
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
    if len(data["joint_tolerance"]) != checker.group.dof:
        _fail(path, f"must have {checker.group.dof} numbers, one for each joint", "joint_tolerance")


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
