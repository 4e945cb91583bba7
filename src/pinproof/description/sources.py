"""A robot description of any kind, told apart by its suffix and by its root element."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinproof.description.mjcf import mjcf_of
from pinproof.description.srdf import Srdf
from pinproof.description.urdf import Urdf, read_urdf
from pinproof.description.xml_reader import parse_file

__all__ = ["read_description"]


def read_description(
    path: Path, *, package_dirs: Sequence[str | Path] = (), xacro_args: Mapping[str, str] | None = None
) -> tuple[Urdf, Srdf]:
    """A URDF, xacro or MJCF file on paper, and what an MJCF says that would stand in an SRDF (else an empty one).

    Raises
    ------
    UrdfError
        For a file that cannot be used, with its line.
    InputError
        For a xacro file where the extra ``xacro`` is not installed.
    """
    if path.suffix in (".xml", ".mjcf"):
        root = parse_file(path)
        if root.tag == "mujoco":
            return mjcf_of(root, path)
    return read_urdf(path, package_dirs=package_dirs, xacro_args=xacro_args), Srdf()
