"""Calibration files: the measured kinematics of one arm, as it differs from the nominal model of its type.

Three formats are read; lengths are in metres, angles in radians.

``calibration.conf`` of Universal Robots
    The section ``[mounting]`` of the file on the controller: ``delta_theta``, ``delta_d``, ``delta_a`` and
    ``delta_alpha``, one number for each joint, which are added to the manufacturer's nominal table (standard
    convention). The axes of the joints 2, 3 and 4 are nearly parallel, so their common normals can be hundreds of
    metres away, and the deltas of d as large. How the checksums of the file are computed
    is not published, so they are not verified.

``kinematics`` of their ROS driver (YAML)
    The origins of the six joints that its package ``ur_calibration`` computes from such a table:
    joint i is placed in the frame of joint i - 1, whose z axis is the joint axis. The angles are those about the moving
    axes x, y, z, Rx(roll) Ry(pitch) Rz(yaw): the driver obtains them by ``eulerAngles(0, 1, 2)`` of Eigen
    (Universal_Robots_ROS2_Driver, ``ur_calibration/src/calibration.cpp``, ``Calibration::toYaml``). A URDF reads them
    about the fixed axes, which differs by products of two angles. The key ``hash`` is that of the table, which the
    file does not contain.

Differences of a Denavit-Hartenberg table (CSV)
    Any serial arm. The columns ``name``, ``delta_theta``, ``delta_d``, ``delta_a`` and ``delta_alpha``; empty cells are
    0. A comment states the table to which they are added: ``# convention: standard`` or ``modified`` for the table that
    ``pinproof urdf2dh`` writes in this convention, ``# like: ur`` or ``franka`` for the table of the make.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml

from pinproof.common import structs as st
from pinproof.common.files import is_file, read_text, read_yaml
from pinproof.description.dh import CONVENTIONS, MAKES, NAME, VALUE, CsvRow, csv_content
from pinproof.description.urdf import Urdf, UrdfJoint, origin, rpy_matrix
from pinproof.description.xml_reader import origin_attributes, parse_text
from pinproof.errors import CalibrationError, FileError, InputError, UnknownNameError
from pinproof.spatial import Array

CONF, KINEMATICS, DELTAS = (
    "the calibration.conf of a Universal Robots controller",
    "the kinematics of a Universal Robots arm, as their ROS driver writes it",
    "differences of a Denavit-Hartenberg table",
)
COLUMNS = ("delta_theta", "delta_d", "delta_a", "delta_alpha")
JOINTS_OF_UR = 6
UR_LIST = st.list_of(VALUE, JOINTS_OF_UR, JOINTS_OF_UR)

MOUNTING = st.Table(
    "mounting",
    "The section [mounting] of a calibration.conf; its other keys are not used.",
    *(st.required(name, UR_LIST, "one number for each joint", "rad or m") for name in COLUMNS),
    st.Key("calibration_status", st.INTEGER, "0: not calibrated, 1 and 2: calibrated"),
    more=True,
)
ORIGIN = st.Table(
    "origin",
    "The origin of a joint in the frame of the previous one.",
    *(st.required(name, VALUE, "position", "m") for name in "xyz"),
    *(st.required(name, VALUE, "angle about the moved axis", "rad") for name in ("roll", "pitch", "yaw")),
)
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
KINEMATICS_FILE = st.Table(
    "kinematics",
    "The origins of the joints that move the links.",
    *(st.required(link, ORIGIN, "the joint that moves it") for link in LINKS),
    st.Key("hash", st.ANYTHING, "a hash of the table that they were computed from"),
)
DELTA = st.Table(
    "delta",
    "What is added to one row of a table.",
    st.required("name", NAME, "name of the joint"),
    *(st.Key(name, VALUE, "what is added", "rad or m") for name in COLUMNS),
)


def _matrices(shape: tuple[int | None, ...]) -> st.Kind:
    rows: dict[str, Any] = {"type": "number"}
    for _ in shape:
        rows = {"type": "array", "items": rows}
    return st.optional(st.array_of(st.simple(rows), shape))


@st.struct("calibration", eq=False)
class Calibration:
    """The content of a calibration file: either ``deltas`` of a DH table, or the ``origins`` of the joints."""

    path: Path = st.key("the file", kind=st.simple({"type": "string"}, lambda _, value: Path(value)))
    format: str = st.key("what the file is")
    like: Annotated[str | None, st.optional(st.choice(*MAKES))] = st.key(
        "the make whose nominal table the deltas refer to; null for a table of `convention`", default="ur"
    )
    convention: str = st.key("that of the table", default="standard", kind=st.choice(*CONVENTIONS))
    joints: tuple[str, ...] = st.key(
        "names of the joints in order; empty for the six joints of a Universal Robots arm", default=()
    )
    deltas: Annotated[Array | None, _matrices((None, 4))] = st.key(
        "(n, 4) theta, d, a, alpha of each joint", "rad or m", default=None
    )
    origins: Annotated[Array | None, _matrices((None, 4, 4))] = st.key(
        "(n, 4, 4) previous_joint_from_joint at 0, the z axes on the joint axes", "m", default=None
    )

    def __eq__(self, other: object) -> bool:
        """Whether the numbers, and what they refer to, are the same; the file may be another."""
        return isinstance(other, Calibration) and self.numbers == other.numbers

    def __hash__(self) -> int:
        return hash(self.numbers)

    @property
    def numbers(self) -> str:
        """The numbers, and what they refer to, as JSON."""
        return json.dumps(st.plain((self.like, self.convention, self.joints, self.deltas, self.origins)))


def calibration_format(path: Path) -> str:
    """What a file contains, if it is a calibration; else an empty text."""
    suffix = path.suffix.lower()
    patterns = {".conf": ("", CONF), ".yaml": (r"^kinematics\s*:", KINEMATICS), ".csv": (r"\bdelta_[a-z]", DELTAS)}
    pattern, found = patterns.get(".yaml" if suffix == ".yml" else suffix, ("", ""))
    if not found or not is_file(path):
        return ""
    try:
        return found if re.search(pattern, read_text(path, CalibrationError), re.MULTILINE) else ""
    except FileError:
        return ""


def read_calibration(path: str | Path) -> Calibration:
    """Read a calibration file of one of the formats in the module docstring.

    Raises
    ------
    CalibrationError
        If it is of another format, or a number is missing, not finite, or in other units; the message states the line.
    """
    path = Path(path)
    readers = {CONF: _conf, KINEMATICS: _kinematics, DELTAS: _deltas}
    if found := calibration_format(path):
        with st.errors_of(path, CalibrationError):
            return readers[found](path)
    # A file that cannot be read is reported as that
    read_text(path, CalibrationError)
    if path.suffix.lower() in (".yaml", ".yml"):
        read_yaml(path, ("kinematics",), CalibrationError)
    raise CalibrationError(path, f"is not a calibration file; valid: {CONF}, {KINEMATICS} (YAML), {DELTAS} (CSV)")


class _Lines(dict[str, Any]):
    """The keys of a section, with their lines for messages."""

    lines: Mapping[str, int]

    def at(self, key: object = None) -> str:
        return f"line {self.lines[str(key)]}" if key in self.lines else ""


def _conf(path: Path) -> Calibration:
    """The deltas of the section [mounting]."""
    section, stated, lines = "", _Lines(), dict[str, int]()
    for number, line in enumerate(read_text(path, CalibrationError).splitlines(), 1):
        text = line.partition("#")[0].strip()
        name, equals, value = (part.strip() for part in text.partition("="))
        if text.startswith("[") and not equals:
            section = text.strip("[] ")
        elif section == "mounting" and name in (*COLUMNS, "calibration_status"):
            if name in stated:
                raise st.Misread(f"states {name} twice, first in line {lines[name]}", (), f"line {number}")
            try:
                stated[name], lines[name] = yaml.safe_load(value), number
            except yaml.YAMLError as error:
                raise st.Misread(f"{name} is not a list of numbers", (), f"line {number}") from error
    stated.lines = lines
    values = MOUNTING.parse("section [mounting]", stated, path)
    if values.get("calibration_status") == 0:
        raise st.Misread("the arm is not calibrated: calibration_status is 0", (), stated.at("calibration_status"))
    return Calibration(path, CONF, deltas=np.array([values[name] for name in COLUMNS]).T)


def _kinematics(path: Path) -> Calibration:
    """The origins of the joints of the ROS driver."""
    content, origins = read_yaml(path, ("kinematics",), CalibrationError), []
    where = st.position(content, "kinematics")
    read = st.step(".kinematics", where, KINEMATICS_FILE.parse, "kinematics", content["kinematics"], path)
    for at in (read[link] for link in LINKS):
        pose = np.eye(4)
        pose[:3, :3] = rpy_matrix(at["roll"], 0, 0) @ rpy_matrix(0, at["pitch"], 0) @ rpy_matrix(0, 0, at["yaw"])
        pose[:3, 3] = [at[name] for name in "xyz"]
        origins.append(pose)
    return Calibration(path, KINEMATICS, origins=np.array(origins))


def _deltas(path: Path) -> Calibration:
    """The deltas of a CSV file, and the table that they refer to."""
    content = csv_content(path, DELTA.names, CalibrationError, ("convention", "like"))
    like, convention = content.get("like"), content.get("convention")
    if like is not None and like not in MAKES:
        raise InputError(str(UnknownNameError("make", like, MAKES, "'# like:'")))
    if like is None and convention not in CONVENTIONS:
        makes = ", ".join(f"'# like: {make}'" for make in MAKES)
        raise InputError(
            f"states no table; add '# convention: standard' or '# convention: modified' for that of pinproof urdf2dh, "
            f"or {makes} for that of the make"
        )
    if like is not None and convention not in (None, MAKES[like].convention):
        raise InputError(
            f"states '# like: {like}' and '# convention: {convention}', but the table of {MAKES[like].name} has the "
            f"convention {MAKES[like].convention}; remove one of them"
        )
    stated: list[CsvRow] = content["rows"]
    rows = [st.step(number, row.at(), DELTA.parse, "row", row, path) for number, row in enumerate(stated)]
    if not rows:
        raise InputError("has no rows; state the joints of the arm, base first")
    deltas = np.array([[row.get(name, 0.0) for name in COLUMNS] for row in rows])
    names = tuple(row["name"] for row in rows)
    return Calibration(path, DELTAS, like, MAKES[like].convention if like else str(convention), names, deltas)


def with_origins(urdf: Urdf, moved: Callable[[UrdfJoint, Array], Array]) -> Urdf:
    """A description whose joints have other origins; all else is the same.

    Parameters
    ----------
    urdf
        The robot.
    moved
        Returns the origin (4, 4) of a joint from the joint and its origin; the same array leaves it unchanged.
    """
    from lxml import etree

    def text_of(text: str, names: dict[str, UrdfJoint]) -> str:
        root = parse_text(text, urdf.name)
        for element in root.findall("joint"):
            before = np.eye(4)
            before[:3, :3], before[:3, 3] = origin(element, urdf.name)
            after = moved(names[element.get("name").strip()], before)
            if after is not before:
                where = element.find("origin")
                where = etree.SubElement(element, "origin") if where is None else where
                where.attrib.update(origin_attributes(after))
        return str(etree.tostring(root, encoding="unicode"))

    in_model = {urdf.model_joint(name): joint for name, joint in urdf.joints.items()}
    return replace(urdf, text=text_of(urdf.text, dict(urdf.joints)), kinematics=text_of(urdf.kinematics, in_model))
