"""Loading a robot by catalogue name, from a description file, or from a DH table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

from pinproof.common.validation import require_type
from pinproof.description import (
    OVERLAP_REASON,
    CatalogueEntry,
    DhTable,
    Srdf,
    find_robot,
    read_description,
    read_srdf,
    read_urdf_text,
)
from pinproof.description.dh import SUFFIXES as TABLE_SUFFIXES
from pinproof.description.dh_urdf import urdf_of_table
from pinproof.description.srdf import DisabledPair
from pinproof.errors import FileError, InputError, UrdfError
from pinproof.model.dh_proof import prove_urdf_equals_table
from pinproof.model.robot import Robot

ROBOT_SUFFIXES = (".urdf", ".xacro", ".xml", ".mjcf", *TABLE_SUFFIXES)
"""Suffixes of the files that describe a robot."""


def load_robot(
    source: str | Path | DhTable,
    *,
    srdf: str | Path | None = None,
    package_dirs: Sequence[str | Path] = (),
    xacro_args: Mapping[str, str] | None = None,
) -> Robot:
    """Load a robot by catalogue name, from a URDF, xacro or MJCF file, from URDF text, or from a DH table.

    Parameters
    ----------
    source
        A name such as ``"ur5"``, the text of a URDF, a DH table, or a path that ends in ``.urdf``, ``.xacro``, ``.xml``
        or ``.mjcf``, or in ``.yaml``, ``.yml`` or ``.csv`` for a DH table. The bodies of a DH table are generated
        (:func:`pinproof.dh_to_urdf`), and its forward kinematics are verified.
    srdf
        An SRDF file. Default: that of the catalogue, none for a path or a table.
    package_dirs
        Folders that contain ROS packages, searched first for ``package://`` meshes and ``$(find ...)`` in xacro.
    xacro_args
        Values for the ``<xacro:arg>`` elements of a xacro file.

    Raises
    ------
    UnknownNameError
        If the name is not in the catalogue, or the xacro file does not declare an argument of that name.
    UrdfError, DhTableError
        If the file is invalid; the message states the line.
    FileError
        If one of ``package_dirs`` is not a folder.
    InputError
        If the file is a xacro file and the extra ``xacro`` is not installed, or xacro arguments are given for another
        file.
    """
    require_type("source", source, str, PathLike, DhTable)
    entry: CatalogueEntry | None = None
    # XML begins with <, which no name of a robot or file does.
    is_text = isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<")
    if isinstance(source, str) and not is_text and not source.lower().endswith(ROBOT_SUFFIXES) and "/" not in source:
        entry = find_robot(source)
        source, srdf = entry.urdf, srdf or entry.srdf
    if isinstance(package_dirs, (str, PathLike)):
        raise InputError(f"package_dirs must be a list of folders, such as [{str(package_dirs)!r}]")
    for folder in package_dirs:
        if not Path(folder).is_dir():
            raise FileError(folder, "is not a folder; package_dirs must contain folders with ROS packages")
    folders = [Path(folder).absolute() for folder in package_dirs]
    if isinstance(source, str) and is_text:
        if xacro_args:
            raise InputError("xacro_args are valid for .xacro files only, not for the text of a URDF")
        urdf = read_urdf_text(source.lstrip("\ufeff"), name="URDF text", package_dirs=folders)
        return Robot(urdf, Srdf() if srdf is None else read_srdf(srdf))
    if isinstance(source, DhTable) or Path(source).suffix.lower() in TABLE_SUFFIXES:
        return _robot_of_table(source, srdf, xacro_args)
    path = Path(source)
    if path.suffix not in ROBOT_SUFFIXES:
        what = "is a folder" if path.is_dir() else "is not a robot description"
        raise UrdfError(path, f"{what}; the name of a robot file ends in one of {', '.join(ROBOT_SUFFIXES)}")
    urdf, semantic = read_description(path, package_dirs=folders, xacro_args=xacro_args)
    if srdf is not None:
        semantic = read_srdf(srdf)
    if entry is None:
        return Robot(urdf, semantic)
    overlaps = tuple(DisabledPair(pair, OVERLAP_REASON) for pair in entry.overlaps)
    semantic = replace(semantic, disabled=(*semantic.disabled, *overlaps))
    return Robot(urdf, semantic, entry.tcp, entry.home, entry.base, entry.arms)


def _robot_of_table(
    source: str | Path | DhTable, srdf: str | Path | None, xacro_args: Mapping[str, str] | None
) -> Robot:
    table = source if isinstance(source, DhTable) else DhTable.load(source)
    if xacro_args:
        raise InputError(f"xacro_args are valid for .xacro files only, not for the DH table {table.name!r}")
    text = urdf_of_table(table)
    prove_urdf_equals_table(table, text)
    path = None if isinstance(source, DhTable) else Path(source)
    urdf = replace(read_urdf_text(text, name=f"URDF of {table.name}"), path=path)
    return Robot(urdf, Srdf() if srdf is None else read_srdf(srdf))
