"""Finding ROS packages and the files of mesh URIs."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from pinproof.common.files import is_file

WORKSPACE_DEPTH = 4
"""Search depth for packages below an entry of ROS_PACKAGE_PATH (workspace/src/repository/stack/package)."""


@dataclass(frozen=True)
class MeshFile:
    """The URI of a mesh in a URDF, its file (None if it was not found), and the paths that were tried."""

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
    if scheme in ("package", "model"):
        # package:///P/rest is also common; without this the rest would be an absolute path.
        package, inside = _inside(rest)
        candidates = [folder / inside for folder in _package_folders(package, urdf_folder, package_dirs)]
    elif scheme == "file" and rest:
        candidates = [Path(unquote(rest))]
    elif Path(uri).is_absolute():
        candidates = [Path(uri)]
    else:
        candidates = [root / uri for root in [*([] if urdf_folder is None else [urdf_folder]), *package_dirs]]
    for candidate in candidates:
        if is_file(candidate):
            return MeshFile(uri, candidate, tuple(candidates))
    if scheme in ("package", "model"):
        for folder in _workspace_packages(package):
            candidates.append(folder / inside)
            if is_file(candidates[-1]):
                return MeshFile(uri, candidates[-1], tuple(candidates))
    return MeshFile(uri, None, tuple(candidates))


def find_package(package: str, near: Path | None, package_dirs: Sequence[Path]) -> Path | None:
    """Return the folder of a ROS package, searched as by :func:`locate`, or None."""
    for folder in _package_folders(package, near, package_dirs):
        if folder.is_dir():
            return folder
    return next(_workspace_packages(package), None)


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


def _package_folders(package: str, near: Path | None, package_dirs: Sequence[Path]) -> list[Path]:
    """Return the candidate folders of a package in order of preference, without searching in subfolders."""
    roots = [*package_dirs, *([] if near is None else [near, *near.parents])]
    folders = [root / package for root in roots]
    if near is not None:  # the folder of a package may have another name
        folders += [parent for parent in (near, *near.parents) if _is_package(parent, package)]
    for entry in _paths("ROS_PACKAGE_PATH"):
        folders += [entry / package, *([entry] if entry.name == package or _is_package(entry, package) else [])]
    folders += [prefix / "share" / package for prefix in _paths("AMENT_PREFIX_PATH")]
    share = example_robot_data()
    return [*folders, *([] if share is None else [share / package])]


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
