"""Files of ROS: packages, the meshes that URIs name, and xacro files (the extra ``xacro``, which does not require ROS).

xacro files are expanded in a separate process, with limits for memory and time.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from pinproof.common.files import is_file
from pinproof.common.validation import optional_module
from pinproof.description.xml_reader import parse_file
from pinproof.errors import UnknownNameError, UrdfError

WORKSPACE_DEPTH = 4
"""Search depth for packages below an entry of ROS_PACKAGE_PATH (workspace/src/repository/stack/package)."""


@dataclass(frozen=True)
class MeshFile:
    """The URI of a mesh in a URDF, its file (None if it was not found), and the paths that were tried until then."""

    uri: str
    path: Path | None
    searched: tuple[Path, ...]


def locate(uri: str, urdf_folder: Path | None, package_dirs: Sequence[Path]) -> MeshFile:
    """Find the file of a ``package://``, ``model://`` or ``file://`` URI or of a path.

    ``package://P/rest`` is searched as ``D/P/rest`` in each package folder D, in each parent folder of the URDF, in
    ``ROS_PACKAGE_PATH`` (D/P, D itself if it is the package P, or a package P below D), in ``PREFIX/share`` for each
    prefix in ``AMENT_PREFIX_PATH``, and in example-robot-data. A relative path is searched in the folder of the URDF
    and in each package folder.
    """
    scheme, _, rest = uri.partition("://")
    places: Iterable[Path]
    if scheme in ("package", "model"):
        # package:///P/rest is also common; without this the rest would be an absolute path.
        package, inside = _inside(rest)
        places = (folder / inside for folder in _package_folders(package, urdf_folder, package_dirs))
    elif scheme == "file" and rest:
        places = [Path(unquote(rest))]
    elif Path(uri).is_absolute():
        places = [Path(uri)]
    else:
        places = [root / uri for root in [*([] if urdf_folder is None else [urdf_folder]), *package_dirs]]
    tried = []
    for place in places:
        tried.append(place)
        if is_file(place):
            return MeshFile(uri, place, tuple(tried))
    return MeshFile(uri, None, tuple(tried))


def find_package(package: str, near: Path | None, package_dirs: Sequence[Path]) -> Path | None:
    """Return the folder of a ROS package, searched as by :func:`locate`, or None."""
    return next((folder for folder in _package_folders(package, near, package_dirs) if folder.is_dir()), None)


def leaves_package(uri: str) -> bool:
    """Whether a ``package://`` URI leaves its package through ``..``."""
    scheme, _, rest = uri.partition("://")
    if scheme not in ("package", "model"):
        return False
    package, inside = _inside(rest)
    if package in ("", ".", ".."):
        return True
    depth = 0
    for part in inside.split("/"):
        depth += -1 if part == ".." else part not in ("", ".")
        if depth < 0:
            return True
    return False


def example_robot_data() -> Path | None:
    """Return the share folder of the installed distribution example-robot-data (which has no modules), or None."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        share = Path(str(distribution("example-robot-data").locate_file("cmeel.prefix/share")))
    except PackageNotFoundError:
        return None
    return share if share.is_dir() else None


def _inside(rest: str) -> tuple[str, str]:
    """Split into the package and the path in it; repeated slashes are removed, as they would start an absolute path."""
    package, _, inside = unquote(rest).lstrip("/").partition("/")
    return package, inside.lstrip("/")


def _package_folders(package: str, near: Path | None, package_dirs: Sequence[Path]) -> Iterator[Path]:
    """Return the candidate folders of a package in order of preference; the slower searches come last."""
    above = [] if near is None else [near, *near.parents]
    yield from (root / package for root in (*package_dirs, *above))
    # the folder of a package may have another name
    yield from (parent for parent in above if _is_package(parent, package))
    for entry in _paths("ROS_PACKAGE_PATH"):
        yield from (entry / package, *([entry] if entry.name == package or _is_package(entry, package) else []))
    yield from (prefix / "share" / package for prefix in _paths("AMENT_PREFIX_PATH"))
    share = example_robot_data()
    yield from ([] if share is None else [share / package])
    yield from _workspace_packages(package)


def _workspace_packages(package: str) -> Iterator[Path]:
    """Search for the package below ROS_PACKAGE_PATH; packages are not nested."""
    for entry in _paths("ROS_PACKAGE_PATH"):
        for folder, below, files in os.walk(entry):
            if "package.xml" in files:
                below.clear()
                if _is_package(Path(folder), package):
                    yield Path(folder)
            elif len(Path(folder).relative_to(entry).parts) >= WORKSPACE_DEPTH:
                below.clear()
            else:
                below[:] = sorted(name for name in below if not name.startswith("."))


def _is_package(folder: Path, package: str) -> bool:
    try:
        manifest = (folder / "package.xml").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return re.search(rf"<name>\s*{re.escape(package)}\s*</name>", manifest) is not None


def _paths(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


TIME_LIMIT = 60.0
"""Seconds; robots from MoveIt and vendor packages take one or two seconds."""

PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from pinproof.description import ros_files; ros_files.expand_job()"
)

MOST_MEMORY = 4 * 2**30
"""Bytes of address space; the largest robots need about a twentieth of it."""


def expand_xacro(
    path: Path, arguments: Mapping[str, str], package_dirs: Sequence[Path], *, time_limit: float = TIME_LIMIT
) -> str:
    """Expand a xacro file to XML text; ``$(find P)`` is searched like ``package://P``.

    A xacro file is a program: it evaluates Python expressions (without builtins) and reads included files. It runs in
    a separate process with a memory limit, for at most ``time_limit`` (s).

    InputError if xacro is not installed. UnknownNameError if the file neither declares nor uses one of the arguments.
    UrdfError if the file cannot be expanded; the message contains the reason given by xacro.
    """
    optional_module("xacro", f"{path} is a xacro file, which", "xacro")
    parse_file(path)  # checks the size, that the XML is well-formed, and that it has no entities
    # expansion in a process of its own, which is ended when it takes too long
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
            path, f"xacro did not finish within {time_limit:g} s; check for macros or expressions without termination"
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
