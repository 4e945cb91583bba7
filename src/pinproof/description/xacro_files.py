"""Expansion of xacro files by the package ``xacro`` of ROS (the extra ``xacro``), which does not require ROS."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from pinproof.description.xml_reader import parse_file
from pinproof.errors import InputError, UnknownNameError, UrdfError

TIME_LIMIT = 60.0
"""Seconds; robots from MoveIt and vendor packages take one or two seconds."""

PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from pinproof.description import xacro_worker; xacro_worker.main()"
)


def expand_xacro(
    path: Path, arguments: Mapping[str, str], package_dirs: Sequence[Path], *, time_limit: float = TIME_LIMIT
) -> str:
    """Expand a xacro file to XML text; ``$(find P)`` is searched like ``package://P``.

    A xacro file is a program: it evaluates Python expressions (without builtins) and reads included files. It runs in
    a separate process with a memory limit, for at most ``time_limit`` (s).

    Raises
    ------
    InputError
        If xacro is not installed.
    UnknownNameError
        If the file neither declares nor uses one of the arguments.
    UrdfError
        If the file cannot be expanded; the message contains the reason given by xacro.
    """
    try:
        importlib.import_module("xacro")
    except ImportError as error:
        raise InputError(
            f"{path} is a xacro file, which requires the extra 'xacro': pip install 'pinproof[xacro]'"
        ) from error
    parse_file(path)  # checks the size, that the XML is well-formed, and that it has no entities
    job = {
        "path": str(path.absolute()),
        "arguments": {key: str(value) for key, value in arguments.items()},
        "package_dirs": [str(folder.absolute()) for folder in package_dirs],
    }
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, json.dumps(sys.path)],
            input=json.dumps(job),
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=time_limit,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise UrdfError(
            path,
            f"xacro did not finish within {time_limit:g} s; check for macros or expressions without termination",
        ) from error
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise UrdfError(path, f"xacro cannot expand it: its process ended with {done.returncode}: {last}")
    answer = json.loads(done.stdout)
    unknown = [name for name in arguments if name not in answer["known"]]
    if "error" in answer:
        # A file that fails before it declares an argument does not show that the argument is unknown.
        stated = f"; it declares no argument {', '.join(unknown)} before that" if unknown else ""
        raise UrdfError(path, f"xacro cannot expand it: {answer['error']}{stated}")
    if unknown:
        raise UnknownNameError("xacro argument", unknown[0], answer["known"], str(path))
    return str(answer["text"])
