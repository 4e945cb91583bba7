"""Files of depth images and of point clouds."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common.files import refuse_unreadable, unknown_suffix
from pinproof.description import positions, read_elements
from pinproof.errors import FileError, InputError

LARGEST_FILE = 2**30
"""Bytes: a cloud of about 70 million points."""

Numbers = npt.NDArray[Any]
Reader = Callable[[Path], Numbers]


def read_image(path: str | Path) -> Numbers:
    """Return the numbers of an image file: ``.npy``, ``.png``, or ``.exr`` with the extra ``sensor``.

    FileError if it has another suffix or cannot be read; InputError if an extra is missing.
    """
    return _read(path, "depth image", {".npy": _read_npy, ".png": _read_png, ".exr": _read_exr})


def read_points(path: str | Path) -> npt.NDArray[np.float64]:
    """Return the points (N, 3) of a file: ``.npy``, ``.ply``, or ``.pcd`` with the extra ``sensor``.

    The points are returned in the frame of the file, including those that are not finite. The viewpoint that a PCD
    file may state is not applied.

    Raises
    ------
    FileError
        If it has another suffix, cannot be read, or has no points of three coordinates.
    InputError
        If an extra is missing.
    """
    points = _read(path, "point cloud", {".npy": _read_npy, ".ply": _read_ply, ".pcd": _read_pcd})
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "iuf":
        raise FileError(Path(path), f"holds {points.dtype} of the shape {points.shape}, not points (N, 3)")
    return points.astype(float)


def _read(path: str | Path, what: str, readers: dict[str, Reader]) -> Numbers:
    file = Path(path)
    reader = readers.get(file.suffix.lower())
    if reader is None:
        raise FileError(file, f"is not a {what}: {unknown_suffix(file, readers)}")
    refuse_unreadable(file, FileError, largest=LARGEST_FILE)
    try:
        return reader(file)
    # Pillow raises SyntaxError, OpenEXR RuntimeError, and readers of clouds others for damaged files.
    except (OSError, ValueError, SyntaxError, RuntimeError, KeyError, IndexError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        raise FileError(file, f"cannot be read as a {what}: {str(error).splitlines()[0]}") from error


def _library(name: str, suffix: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise InputError(f"{suffix} files need the extra 'sensor': pip install 'pinproof[sensor]'") from error


def _read_npy(path: Path) -> Numbers:
    return np.asarray(np.load(path, allow_pickle=False))


def _read_png(path: Path) -> Numbers:
    from PIL import Image as PngImage

    with PngImage.open(path) as image:
        if image.mode not in ("I;16", "I;16B", "I", "F"):
            raise ValueError(f"it has the mode {image.mode}; depth images have one channel of 16 bits")
        return np.asarray(image)


def _read_exr(path: Path) -> Numbers:
    """The channel Z, as renderers name depth, or the only channel of an EXR file."""
    channels = _library("OpenEXR", ".exr").File(str(path), separate_channels=True).channels()
    names = [name for name in channels if name.rpartition(".")[2] == "Z"] or list(channels)
    if len(names) != 1:
        raise ValueError(f"it has the channels {', '.join(channels)}; needed is one channel, or one named Z")
    return np.asarray(channels[names[0]].pixels)


def _read_ply(path: Path) -> Numbers:
    return positions(read_elements(path.read_bytes()).get("vertex", {}))


def _read_pcd(path: Path) -> Numbers:
    cloud = _library("pypcd4", ".pcd").PointCloud.from_path(path)
    points = np.asarray(cloud.numpy(("x", "y", "z")))
    if len(points) != cloud.metadata.points:
        raise ValueError(f"it holds {len(points)} points, but its header states {cloud.metadata.points}")
    return points
