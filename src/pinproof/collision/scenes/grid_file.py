"""Occupancy grids in scene files: the states of their cells, the depth images of which they are made, or a map."""

from __future__ import annotations

import base64
import binascii
import math
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision.geometry.depth_image import DepthView, Intrinsics
from pinproof.collision.geometry.occupancy import MOST_CELLS, OccupancyGrid
from pinproof.collision.scenes.scene_keys import INTRINSICS, POSE, VIEW
from pinproof.common.files import is_file
from pinproof.common.yaml_file import refuse_unknown
from pinproof.errors import InputError, SceneError
from pinproof.spatial import SE3, finite

SOURCES = ("cells", "views", "octomap")
"""The keys of which a grid has exactly one."""


def stated_grid(grid: OccupancyGrid) -> dict[str, Any]:
    """Return a grid as a mapping for a file; it has about one byte for every twenty cells."""
    packed = base64.b64encode(zlib.compress(grid.cells.tobytes(), 9)).decode("ascii")
    return {
        "voxel": grid.voxel,
        "unknown": grid.unknown,
        "low": list(grid.low),
        "count": list(grid.cells.shape),
        "cells": packed,
        "record": list(grid.record),
    }


def read_grid(
    path: Path,
    stated: Mapping[str, Any],
    where: str,
    numbers_of: Callable[[str, object], Any],
    pose_of: Callable[[Mapping[str, Any]], SE3],
) -> OccupancyGrid:
    """Return the grid of a mapping in the scene file ``path``; the functions read numbers and poses of such files.

    SceneError, InputError or FileError if the mapping, or an image that it names, is invalid.
    """
    source = [key for key in SOURCES if key in stated]
    if len(source) != 1:
        raise InputError(
            f"occupancy_grid has {' and '.join(source) or 'no source of its cells'}; it needs one of "
            f"{', '.join(SOURCES)}"
        )
    required = {"cells": ("voxel", "low", "count"), "views": ("voxel", "bounds"), "octomap": ()}[source[0]]
    optional = {"cells": ("record",), "views": (), "octomap": ("bounds", "threshold")}[source[0]]
    valid = (source[0], "unknown", *required, *optional)
    refuse_unknown(SceneError, path, f"key of occupancy_grid with {source[0]}", stated, valid, where)
    missing = [key for key in required if key not in stated]
    if missing:
        raise InputError(f"occupancy_grid does not state its {' and '.join(missing)}")

    def number(key: str, shape: tuple[int, ...] = ()) -> np.ndarray:
        return finite(f"occupancy_grid.{key}", numbers_of(f"occupancy_grid.{key}", stated[key]), shape)

    unknown = stated.get("unknown", "occupied")
    if "octomap" in stated:
        threshold = {"threshold": float(number("threshold"))} if "threshold" in stated else {}
        box = number("bounds", (2, 3)) if "bounds" in stated else None
        file = _existing(path, "occupancy_grid.octomap", stated["octomap"])
        return OccupancyGrid.from_octomap(file, unknown=unknown, bounds=box, **threshold)
    voxel = float(number("voxel"))
    if "cells" in stated:
        low, count = (number(key, (3,)) for key in ("low", "count"))
        record = stated.get("record", [])
        if not isinstance(record, list) or not all(isinstance(line, str) for line in record):
            raise InputError("occupancy_grid.record: must be a list of texts")
        return OccupancyGrid(
            _cells(stated["cells"], count.tolist()), voxel, tuple(low.tolist()), unknown, tuple(record)
        )
    views = stated["views"]
    if not isinstance(views, list) or not views:
        raise InputError(f"occupancy_grid.views: {views!r} is not a list of views")
    bounds = number("bounds", (2, 3))
    grids = []
    for view in views:
        if not isinstance(view, dict):
            raise InputError(f"occupancy_grid.views: {view!r} is not a view; valid keys: {', '.join(VIEW.names)}")
        refuse_unknown(SceneError, path, "key of a view", view, VIEW.names, where)
        seen, margin = _view(path, view, where, numbers_of, pose_of)
        grids.append(OccupancyGrid.from_view(seen, voxel=voxel, bounds=bounds, unknown=unknown, **margin))
    return grids[0].fuse(*grids[1:])


def _existing(path: Path, key: str, stated: object) -> Path:
    """Return the file that a key of the scene file ``path`` names."""
    if not isinstance(stated, str) or not is_file(path.parent / stated):
        raise InputError(f"{key}: there is no file {stated!r}; paths are relative to the scene file")
    return path.parent / stated


def _cells(stated: object, count: list[float]) -> np.ndarray:
    """Return the states of cells (nx, ny, nz) of their text."""
    shape = tuple(int(side) for side in count)
    size = math.prod(shape)
    if list(shape) != count or min(shape) < 1 or size > MOST_CELLS:
        raise InputError(f"occupancy_grid.count: {count} must be three integers, with at most {MOST_CELLS} cells")
    try:
        unpacked = zlib.decompressobj()
        data = unpacked.decompress(base64.b64decode(str(stated), validate=True), size + 1)
    except (binascii.Error, ValueError, zlib.error) as error:
        raise InputError(f"occupancy_grid.cells: cannot be decoded ({error}); Scene.save writes it") from error
    if len(data) != size:
        raise InputError(f"occupancy_grid.cells: does not hold the states of {size} cells")
    return np.frombuffer(data, dtype=np.uint8).reshape(shape)


def _view(
    path: Path,
    stated: Mapping[str, Any],
    where: str,
    numbers_of: Callable[[str, object], Any],
    pose_of: Callable[[Mapping[str, Any]], SE3],
) -> tuple[DepthView, dict[str, int]]:
    missing = [key for key in VIEW.required if key not in stated]
    if missing:
        raise InputError(f"a view of occupancy_grid does not state its {' and '.join(missing)}")
    source = [key for key in ("image", "points") if key in stated]
    if len(source) != 1 or ("points" in stated and "depth_scale" in stated):
        raise InputError("a view of occupancy_grid needs one of image and points; points have no depth_scale")
    file = _existing(path, f"view.{source[0]}", stated[source[0]])
    for key, table in (("intrinsics", INTRINSICS), ("camera", POSE)):
        if not isinstance(stated[key], dict):
            raise InputError(f"view.{key}: {stated[key]!r} is not a mapping of {', '.join(table.names)}")
        refuse_unknown(SceneError, path, f"key of {key}", stated[key], table.names, where)
    lens = {key: numbers_of(f"intrinsics.{key}", value) for key, value in stated["intrinsics"].items()}
    settings = {
        key: float(finite(f"view.{key}", numbers_of(f"view.{key}", stated[key]), ()))
        for key in ("depth_scale", "depth_uncertainty")
        if key in stated
    }
    for key in ("width", "height"):
        if key in lens and lens[key] == int(lens[key]):
            lens[key] = int(lens[key])
    read = DepthView.read if source == ["image"] else DepthView.from_points
    seen = read(file, Intrinsics(**lens), pose_of(stated["camera"]), **settings)
    return seen, {key: stated[key] for key in ("pixel_margin",) if key in stated}
