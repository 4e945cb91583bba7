"""xacro files, expanded by ROS's own ``xacro`` (the extra ``xacro``), which is plain Python and needs no ROS."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pinproof.description.packages import find_package
from pinproof.description.xml_reader import parse_file
from pinproof.errors import InputError, UrdfError

__all__ = ["expand_xacro"]

_ONE_AT_A_TIME = threading.Lock()
"""xacro keeps its file stack and its ``$(find)`` in globals."""


def expand_xacro(path: Path, arguments: Mapping[str, str], package_dirs: Sequence[Path]) -> str:
    """The XML text that a xacro file expands to; ``$(find P)`` is looked for as ``package://P`` is.

    A xacro file is a program: it evaluates Python expressions (without builtins) and reads the files it includes.

    Raises
    ------
    InputError
        If xacro is not installed.
    UrdfError
        If the file cannot be expanded, with xacro's reason.
    """
    try:
        import xacro
        from xacro import substitution_args
    except ImportError as error:
        raise InputError(
            f"{path} needs xacro to be expanded; install it with: pip install 'pinproof[xacro]'"
        ) from error
    parse_file(path)  # for its checks: a file, of a size, well-formed, without entities

    def find(package: str) -> str:
        folder = find_package(package, path.resolve().parent, package_dirs)
        if folder is None:
            raise LookupError(
                f"package {package!r} was not found in package_dirs, above the file, in ROS_PACKAGE_PATH or "
                "AMENT_PREFIX_PATH"
            )
        return str(folder)

    parts: Any = substitution_args
    with _ONE_AT_A_TIME:
        # xacro asks ament_index_python, a part of ROS, where packages lie; it has no other seam for that.
        before, parts._eval_find = getattr(parts, "_eval_find", None), find
        try:
            document = xacro.process_file(str(path), mappings={k: str(v) for k, v in arguments.items()})
            return str(document.toprettyxml(indent="  "))
        except Exception as error:  # xacro raises whatever the expressions in the file raise
            raise UrdfError(path, f"xacro cannot expand it: {error or type(error).__name__}") from error
        finally:
            parts._eval_find = before
