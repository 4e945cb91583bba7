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

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinproof.common.files import is_file, read_text, read_yaml
from pinproof.common.structs import errors_of, key, parsed, simple, step, struct, table_of
from pinproof.description.dh import MAKES, NAME, VALUE, csv_content
from pinproof.description.urdf import Urdf, UrdfJoint, origin, rpy_matrix
from pinproof.description.xml_reader import origin_attributes, parse_text
from pinproof.errors import CalibrationError, FileError, InputError, UnknownNameError
from pinproof.spatial import Array

CONF, KINEMATICS, DELTAS = (
    "the calibration.conf of a Universal Robots controller",
    "the kinematics of a Universal Robots arm, as their ROS driver writes it",
    "differences of a Denavit-Hartenberg table",
)
SUFFIXES = (".conf", ".yaml", ".yml", ".csv")
COLUMNS = ("delta_theta", "delta_d", "delta_a", "delta_alpha")
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
"""The links of a Universal Robots arm, each moved by one joint."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """The content of a calibration file: either ``deltas`` of a DH table, or the ``origins`` of the joints."""

    path: Path
    format: str
    like: str | None
    """The make whose nominal table the deltas refer to; None for a table of ``convention``."""
    convention: str
    joints: tuple[str, ...]
    """Names of the joints in order; empty for the last six joints before the flange."""
    deltas: Array | None = None
    """(n, 4) theta, d, a, alpha."""
    origins: Array | None = None
    """(n, 4, 4) previous_joint_from_joint at 0, the z axes on the joint axes."""

    def __len__(self) -> int:
        return len(self.joints) or len(LINKS)


@struct("delta")
class DhDelta:
    """What is added to one row of a nominal table."""

    name: str = key("name of the joint", kind=NAME)
    delta_theta: float = key("added to theta", "rad", default=0.0, kind=simple({}, VALUE.check, parsed))
    delta_d: float = key("added to d", "m", default=0.0, kind=VALUE)
    delta_a: float = key("added to a", "m", default=0.0, kind=VALUE)
    delta_alpha: float = key("added to alpha", "rad", default=0.0, kind=simple({}, VALUE.check, parsed))


@struct("origin", kw_only=True)
class JointOrigin:
    """The origin of a joint in the frame of the previous one."""

    x: float = key("position", "m", kind=VALUE)
    y: float = key("position", "m", kind=VALUE)
    z: float = key("position", "m", kind=VALUE)
    roll: float = key("rotation about x", "rad", kind=VALUE)
    pitch: float = key("rotation about the moved y", "rad", kind=VALUE)
    yaw: float = key("rotation about the moved z", "rad", kind=VALUE)


def calibration_format(path: str | Path) -> str:
    """What a file contains, if it is a calibration; else an empty text."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES or not is_file(path):
        return ""
    try:
        text = read_text(path, CalibrationError)
    except FileError:
        return ""
    if path.suffix.lower() == ".conf":
        return CONF
    if path.suffix.lower() == ".csv":
        return DELTAS if any(column in text for column in COLUMNS) else ""
    return KINEMATICS if re.search(r"^kinematics\s*:", text, re.MULTILINE) else ""


def read_calibration(path: str | Path) -> Calibration:
    """Read a calibration file of one of the formats in the module docstring.

    Raises
    ------
    CalibrationError
        If it is of another format, or a number is missing, not finite, or in other units; the message states the line.
    """
    path, found = Path(path), calibration_format(path)
    if found == CONF:
        return Calibration(path, CONF, "ur", "standard", (), deltas=_conf(path))
    if found == KINEMATICS:
        return Calibration(path, KINEMATICS, "ur", "standard", (), origins=_kinematics(path))
    if found == DELTAS:
        return _deltas(path)
    read_text(path, CalibrationError)  # a file that cannot be read is reported as that
    raise CalibrationError(path, f"is not a calibration file; valid: {CONF}, {KINEMATICS} (YAML), {DELTAS} (CSV)")


def _conf(path: Path) -> Array:
    """The deltas (6, 4) of a calibration.conf."""
    # The lines of the section, without comments
    section, lines = "", dict[str, tuple[int, str]]()
    for number, line in enumerate(read_text(path, CalibrationError).splitlines(), 1):
        text = line.partition("#")[0].strip()
        if text.startswith("[") and "=" not in text:
            section = text.strip("[] \t").lower()
        elif section == "mounting" and "=" in text:
            name, _, value = text.partition("=")
            lines[name.strip().lower()] = number, value.strip().strip("[]")
    if missing := [name for name in COLUMNS if name not in lines]:
        raise CalibrationError(path, f"does not state {' and '.join(missing)} in a section [mounting]")
    # Six finite numbers in each column
    columns = []
    for name in COLUMNS:
        number, text = lines[name]
        parts = text.replace(",", " ").split()
        if len(parts) != len(LINKS):
            reason = f"{name} has {len(parts)} numbers; a Universal Robots arm has {len(LINKS)} joints"
            raise CalibrationError(path, reason, f"line {number}")
        for joint, part in enumerate(parts, 1):
            try:
                finite = math.isfinite(float(part))
            except ValueError:
                finite = False
            if not finite:
                raise CalibrationError(path, f"{name} of joint {joint} is {part}, no finite number", f"line {number}")
        columns.append([VALUE.check(name, float(part)) for part in parts])
    # The controller states whether it measured the arm
    number, status = lines.get("calibration_status", (0, ""))
    if status == "0":
        raise CalibrationError(path, "calibration_status is 0: the arm is not calibrated", f"line {number}")
    return np.array(columns).T


def _kinematics(path: Path) -> Array:
    """The origins (6, 4, 4) of the ``kinematics`` of the ROS driver."""
    content, table, origins = read_yaml(path, ("kinematics",), CalibrationError), table_of(JointOrigin), []
    with errors_of(path, CalibrationError):
        stated = content["kinematics"]
        if not isinstance(stated, dict) or (missing := [link for link in LINKS if link not in stated]):
            what = "" if not isinstance(stated, dict) else f" and does not state {', '.join(missing)}"
            raise InputError(f"kinematics must state the links {', '.join(LINKS)}{what}")
        if odd := [link for link in stated if link not in (*LINKS, "hash")]:
            raise InputError(str(UnknownNameError("link", odd[0], LINKS, "kinematics")))
        for link in LINKS:
            where = stated.at(link) if hasattr(stated, "at") else ""
            at = step(f".kinematics.{link}", where, table.parse, link, stated[link], path)
            pose = np.eye(4)
            pose[:3, :3] = rpy_matrix(at.roll, 0, 0) @ rpy_matrix(0, at.pitch, 0) @ rpy_matrix(0, 0, at.yaw)
            pose[:3, 3] = at.x, at.y, at.z
            origins.append(pose)
    return np.array(origins)


def _deltas(path: Path) -> Calibration:
    """The deltas of a CSV file, and the table that they refer to."""
    table = table_of(DhDelta)
    content = csv_content(path, table.names, CalibrationError, ("convention", "like"))
    like, convention = content.get("like"), content.get("convention")
    with errors_of(path, CalibrationError, keys=False):
        if like is not None and like not in MAKES:
            raise InputError(str(UnknownNameError("make", like, MAKES, "'# like:'")))
        if like is None and convention not in ("standard", "modified"):
            makes = ", ".join(f"'# like: {make}'" for make in MAKES)
            raise InputError(
                f"states no table; add '# convention: standard' or '# convention: modified' for that of pinproof "
                f"urdf2dh, or {makes} for that of the make, before the header"
            )
        rows: list[DhDelta] = [
            step(number, row.at(), table.parse, "row", row, path) for number, row in enumerate(content["rows"])
        ]
        if not rows:
            raise InputError("has no rows; state the joints of the arm, base first")
    deltas = np.array([[getattr(row, name) for name in COLUMNS] for row in rows])
    names = tuple(row.name for row in rows)
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
    from dataclasses import replace

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
