"""The separate process that expands one xacro file with limits for memory and time.

It reads the job as JSON from standard input and writes the result as JSON to standard output.
"""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pinproof.description.packages import find_package

MOST_MEMORY = 4 * 2**30
"""Bytes of address space; the largest robots need about a twentieth of it."""


def main() -> None:
    """Expand the file of the job; errors are returned in the result."""
    job = json.load(sys.stdin)
    _bound_memory()
    answer: dict[str, Any]
    arguments = _Arguments(job["arguments"])
    with contextlib.redirect_stdout(sys.stderr):  # xacro prints warnings
        try:
            text = _expand(Path(job["path"]), arguments, [Path(d) for d in job["package_dirs"]])
            answer = {"text": text, "known": sorted(arguments.known)}
        except Exception as error:  # noqa: BLE001 - xacro raises whatever the expressions in the file raise
            answer = {
                "error": _reason(error),
                "known": sorted(arguments.known),
            }
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
        if stack[-1:] and stack.count(stack[-1]) > 1:
            first = len(stack) - 2 - stack[-2::-1].index(stack[-1])
            place = f", in {files[-1]}" if stack is names else ""
            return f"{what} without end: {' -> '.join(stack[first:])}{place}"
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


def _expand(path: Path, arguments: dict[str, str], package_dirs: list[Path]) -> str:
    import xacro
    from xacro import substitution_args

    def find(package: str) -> str:
        folder = find_package(package, path.resolve().parent, package_dirs)
        if folder is None:
            raise _PackageNotFound(
                f"package {package!r} was not found in package_dirs, above the file, in ROS_PACKAGE_PATH or "
                "AMENT_PREFIX_PATH; add the folder that contains it to package_dirs (--package-dir)"
            )
        return str(folder)

    parts: Any = substitution_args
    parts._eval_find = find  # xacro would use ament_index_python, a part of ROS, and has no setting for this
    document = xacro.process_file(str(path), mappings=arguments)
    return str(document.toprettyxml(indent="  "))


def _bound_memory() -> None:
    import resource

    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    most = MOST_MEMORY if hard == resource.RLIM_INFINITY else min(MOST_MEMORY, hard)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))
