"""Expansion of xacro files by the package ``xacro`` of ROS (the extra ``xacro``), which does not require ROS.

The expansion runs in a separate process, with limits for memory and time.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pinproof.description.packages import find_package
from pinproof.description.xml_reader import parse_file
from pinproof.errors import InputError, UnknownNameError, UrdfError

TIME_LIMIT = 60.0
"""Seconds; robots from MoveIt and vendor packages take one or two seconds."""

PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from pinproof.description import xacro_files; xacro_files.expand_job()"
)

MOST_MEMORY = 4 * 2**30
"""Bytes of address space; the largest robots need about a twentieth of it."""


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


# -- the separate process ---------------------------------------------------------------------------------------------


def expand_job() -> None:
    """Expand the file of the job, read as JSON from standard input; the result, or the error, is written as JSON."""
    import resource

    import xacro
    from xacro import substitution_args

    job = json.load(sys.stdin)
    path, arguments = Path(job["path"]), _Arguments(job["arguments"])
    # A file may build texts without end, so the process has a limit of memory.
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    most = MOST_MEMORY if hard == resource.RLIM_INFINITY else min(MOST_MEMORY, hard)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))

    def find(package: str) -> str:
        folder = find_package(package, path.resolve().parent, [Path(folder) for folder in job["package_dirs"]])
        if folder is None:
            raise _PackageNotFound(
                f"package {package!r} was not found in package_dirs, above the file, in ROS_PACKAGE_PATH or "
                "AMENT_PREFIX_PATH; add the folder that contains it to package_dirs (--package-dir)"
            )
        return str(folder)

    parts: Any = substitution_args
    parts._eval_find = find  # xacro would use ament_index_python, a part of ROS, and has no setting for this
    answer: dict[str, Any]
    with contextlib.redirect_stdout(sys.stderr):  # xacro prints warnings
        try:
            text = str(xacro.process_file(str(path), mappings=arguments).toprettyxml(indent="  "))
            answer = {"text": text, "known": sorted(arguments.known)}
        except Exception as error:  # noqa: BLE001 - xacro raises whatever the expressions in the file raise
            answer = {"error": _reason(error), "known": sorted(arguments.known)}
    json.dump(answer, sys.stdout)


class _PackageNotFound(LookupError):
    """A package of ``$(find ...)`` that does not exist."""


def _reason(error: Exception) -> str:
    cause: BaseException | None = error
    while cause is not None:  # xacro wraps the errors of the expressions in a file
        if isinstance(cause, _PackageNotFound):
            return str(cause)
        if isinstance(cause, RecursionError) and (endless := _endless()):
            return endless
        cause = cause.__cause__ or cause.__context__
    return " ".join(str(error).split()) or type(error).__name__


def _endless() -> str:
    """What includes or calls itself, by the stacks of xacro; empty if nothing is on them twice."""
    import xacro

    files = [str(file) for file in xacro.filestack or []]
    names = [macro.body.getAttribute("name") for macro in xacro.macrostack or []]
    for what, stack in (("the file includes itself", files), ("the macro calls itself", names)):
        # the first that is on the stack again; where the stack ends depends on the limit of recursion
        again = next((end for end, name in enumerate(stack) if name in stack[:end]), None)
        if again is not None:
            place = f", in {files[-1]}" if stack is names else ""
            return f"{what} without end: {' -> '.join(stack[stack.index(stack[again]) : again + 1])}{place}"
    return ""


class _Arguments(dict[str, str]):
    """The values of the xacro arguments, with the names of all arguments that the file declares or uses."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.known: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.known.add(str(name))  # xacro tests this for each <xacro:arg>
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        value = super().__getitem__(name)
        self.known.add(name)
        return value
