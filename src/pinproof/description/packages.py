"""Where a mesh URI of a URDF lies on this machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

__all__ = ["MeshFile", "example_robot_data", "locate"]


@dataclass(frozen=True)
class MeshFile:
    """A mesh as a URDF names it, and where it was found (``path`` is None when nowhere)."""

    uri: str
    path: Path | None
    looked_in: tuple[Path, ...]


def locate(uri: str, urdf_folder: Path | None, package_dirs: Sequence[Path]) -> MeshFile:
    """Find the file behind ``package://``, ``file://``, absolute and relative URIs.

    ``package://P/rest`` is looked for as ``D/P/rest`` in each package folder D, in each parent of the URDF, and then in
    example-robot-data; a relative path beside the URDF and in each package folder.
    """
    parents = [] if urdf_folder is None else [urdf_folder, *urdf_folder.parents]
    if uri.startswith("package://"):
        rest = unquote(uri.removeprefix("package://"))
        roots = [*package_dirs, *parents, *_shared_folder()]
        candidates = [root / rest for root in roots]
    elif uri.startswith("file://"):
        candidates = [Path(unquote(uri.removeprefix("file://")))]
    elif Path(uri).is_absolute():
        candidates = [Path(uri)]
    else:
        candidates = [root / uri for root in [*parents[:1], *package_dirs]]
    for candidate in candidates:
        if candidate.is_file():
            return MeshFile(uri, candidate, tuple(candidates))
    return MeshFile(uri, None, tuple(candidates))


def example_robot_data() -> Path | None:
    """The share folder of the installed example-robot-data, or None; there is data in it and no importable module."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        share = Path(str(distribution("example-robot-data").locate_file("cmeel.prefix/share")))
    except PackageNotFoundError:
        return None
    return share if share.is_dir() else None


def _shared_folder() -> list[Path]:
    share = example_robot_data()
    return [] if share is None else [share]
