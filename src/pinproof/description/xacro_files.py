"""xacro files, expanded by ROS's own ``xacro`` (the extra ``xacro``), which is plain Python and needs no ROS."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from pinproof.description.xml_reader import parse_file
from pinproof.errors import InputError, UrdfError

__all__ = ["expand_xacro"]

TIME_LIMIT = 60.0
"""Seconds; the robots of MoveIt's and the vendors' packages take one or two."""

PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from pinproof.description import xacro_worker; xacro_worker.main()"
)


def expand_xacro(
    path: Path, arguments: Mapping[str, str], package_dirs: Sequence[Path], *, time_limit: float = TIME_LIMIT
) -> str:
    """The XML text that a xacro file expands to; ``$(find P)`` is looked for as ``package://P`` is.

    A xacro file is a program: it evaluates Python expressions (without builtins) and reads the files it includes. It
    runs in a process of its own, with a bound of memory, for at most ``time_limit`` (s).

    Raises
    ------
    InputError
        If xacro is not installed.
    UrdfError
        If the file cannot be expanded, with xacro's reason.
    """
    try:
        importlib.import_module("xacro")
    except ImportError as error:
        raise InputError(
            f"{path} needs xacro to be expanded; install it with: pip install 'pinproof[xacro]'"
        ) from error
    parse_file(path)  # for its checks: a file, of a size, well-formed, without entities
    job = {
        "path": str(path),
        "arguments": {key: str(value) for key, value in arguments.items()},
        "package_dirs": [str(folder) for folder in package_dirs],
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
            f"xacro did not come to an end within {time_limit:g} s; does an expression or a macro grow without end?",
        ) from error
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise UrdfError(path, f"xacro cannot expand it: its process ended with {done.returncode}: {last}")
    answer = json.loads(done.stdout)
    if "error" in answer:
        raise UrdfError(path, f"xacro cannot expand it: {answer['error']}")
    return str(answer["text"])
