"""Grids of cells that sensors prove to be free: everything else is an obstacle.

A cell of a grid is free only if it is entirely in the view of a camera and in front of every surface that was measured
in its image; ``src/core/collision/occupancy.h`` states the rule, docs/tutorials/depth_image.md what it assumes. Cells
that no view proves free are obstacles, whether a surface was measured in them or they were not seen at all.
"""

from __future__ import annotations

import base64
import binascii
import itertools
import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import carve, clear_within
from pinproof.collision.geometry.depth_image import (
    DEPTH_UNCERTAINTY,
    PIXEL_MARGIN,
    VIEW,
    DepthPiece,
    DepthView,
    Intrinsics,
)
from pinproof.collision.geometry.octomap_file import THRESHOLD, OctomapLeaves, read_octomap
from pinproof.collision.geometry.shape_values import COORDINATE, LARGEST_SIZE, LENGTH, ByContent, Size, checked_size
from pinproof.common import structs as st
from pinproof.common.validation import named_arguments, require_integer, require_positive
from pinproof.errors import InputError, UnknownNameError
from pinproof.spatial import Array, finite, matrix

Cells = npt.NDArray[np.uint8]
Bounds = Sequence[Sequence[float]] | Array

FREE, SEEN, UNKNOWN, CLEARED = 0, 1, 2, 3
"""The states of a cell: proven free; a surface was measured in it or directly beside it; unknown; free because a body
was removed, which another view may contradict."""

MOST_CELLS = 2**26
"""Largest number of cells of a grid: 64 MB."""

POLICIES = ("occupied", "free")
"""The valid states of cells that were not seen."""


def _states(name: str, value: Any) -> Cells:
    try:
        cells = np.array(value)
    except ValueError as error:
        raise InputError(f"{name} must have the shape (nx, ny, nz); its rows differ in length") from error
    shaped = cells.ndim == 3 and cells.size > 0 and cells.dtype.kind in "biu"
    if not shaped or cells.min() < 0 or cells.max() > CLEARED:
        what = f"they are {cells.dtype} of the shape {cells.shape}"
        raise InputError(f"{name} must be states 0 to 3 of the shape (nx, ny, nz); {what}")
    cells = np.ascontiguousarray(cells, dtype=np.uint8)
    cells.setflags(write=False)
    return cells


def _first_cell(name: str, value: Any) -> tuple[int, int, int]:
    x, y, z = low = finite(name, value, (3,)).tolist()
    if not all(map(float.is_integer, low)):
        raise InputError(f"{name} = {value}; it must be three integers")
    return int(x), int(y), int(z)


@named_arguments
@st.struct(eq=False, repr=False)
class OccupancyGrid(ByContent):
    """Cubic cells of a box of space, each free, occupied or unknown.

    :meth:`from_depth` makes one from a depth image, :meth:`from_points` from a point cloud and its camera, and
    :meth:`from_octomap` from a map of OctoMap. As the shape of an
    :class:`~pinproof.Obstacle`, the occupied cells are joined to boxes. Space outside the grid is free; certificates
    note this.
    """

    cells: st.Accepting[Cells, npt.ArrayLike] = st.key(
        "(nx, ny, nz) the states of the cells: :data:`~pinproof.collision.geometry.occupancy.FREE` 0, "
        ":data:`~pinproof.collision.geometry.occupancy.SEEN` 1, :data:`~pinproof.collision.geometry.occupancy.UNKNOWN` "
        "2, :data:`~pinproof.collision.geometry.occupancy.CLEARED` 3 (free, because a body was removed)",
        kind=st.simple({}, _states),
    )
    voxel: Size = st.key("the side of a cell", "m")
    low: tuple[int, int, int] = st.key(
        "(3,) the indices of the first cell: cell c is the cube from c to c + 1, times the side, in the frame of the "
        "obstacle",
        default=(0, 0, 0),
        kind=st.simple({}, _first_cell),
    )
    unknown: str = st.key(
        '``"occupied"``: cells that were not seen are obstacles. ``"free"``: they are not, and certificates note this',
        default="occupied",
    )
    record: tuple[str, ...] = st.key(
        "how the grid was made, in sentences; certificates list them", default=(), kind=st.list_of(st.ANY_TEXT)
    )

    def __post_init__(self) -> None:
        if self.unknown not in POLICIES:
            raise InputError(f"OccupancyGrid.unknown = {self.unknown!r}; valid: {', '.join(map(repr, POLICIES))}")
        if float(np.abs(self.bounds).max()) > LARGEST_SIZE:
            raise InputError(f"OccupancyGrid reaches {np.abs(self.bounds).max():g} m; limit: {LARGEST_SIZE:g} m")

    def __repr__(self) -> str:
        free, seen, hidden = self.counts
        count = " x ".join(map(str, self.cells.shape))
        return f"OccupancyGrid({count} cells of {self.voxel:g} m: {free} free, {seen} seen, {hidden} unknown)"

    @property
    def bounds(self) -> Array:
        """(2, 3) lower and upper corner of the grid (m)."""
        low = np.array(self.low)
        return np.array([low, low + self.cells.shape]) * self.voxel

    @property
    def counts(self) -> tuple[int, int, int]:
        """The number of free (with cleared ones), seen and unknown cells."""
        free, seen, hidden, cleared = np.bincount(self.cells.ravel(), minlength=4).tolist()
        return free + cleared, seen, hidden

    @property
    def occupied(self) -> npt.NDArray[np.bool_]:
        """(nx, ny, nz) whether a cell is an obstacle."""
        return (self.cells == SEEN) | (self.cells == UNKNOWN) if self.unknown == "occupied" else self.cells == SEEN

    @property
    def remark(self) -> str:
        """The note of certificates about the grid."""
        low, high = (", ".join(f"{x:g}" for x in corner) for corner in np.round(self.bounds, 6))
        policy = {"occupied": "space that was not seen is an obstacle", "free": "space that was not seen is free"}
        head = f"occupancy grid of cells of {self.voxel:g} m; {policy[self.unknown]}; space outside of ({low}) to "
        return "; ".join([f"{head}({high}) is free", *self.record])

    # -- from sensors -------------------------------------------------------------------------------------------------

    @classmethod
    def from_depth(
        cls,
        image: npt.ArrayLike | str | Path,
        intrinsics: Intrinsics | npt.ArrayLike,
        camera_pose: pin.SE3 | npt.ArrayLike,
        *,
        voxel: float,
        bounds: Bounds,
        unknown: str = "occupied",
        depth_scale: float | None = None,
        depth_uncertainty: float | npt.ArrayLike = DEPTH_UNCERTAINTY,
        pixel_margin: int = PIXEL_MARGIN,
    ) -> OccupancyGrid:
        """Return the cells that one depth image proves free.

        No surface is in a free cell if every surface in a pixel is at least as far away as the smallest measured depth
        among this pixel and those within ``pixel_margin`` of it, minus ``depth_uncertainty``. Certificates cannot cover
        what violates this, such as transparent bodies or wires thinner than a pixel.

        Parameters
        ----------
        image
            (height, width) depth along the optical axis, or a file (``.npy``, ``.png``, ``.exr``). Pixels that are 0,
            not finite, masked, saturated (65535) or beyond 100 m have no measurement; the space behind
            them is unknown. Lens distortion must be removed already.
        intrinsics
            The camera: :class:`~pinproof.collision.Intrinsics`, or its matrix (3, 3).
        camera_pose
            ``root_from_camera``: pose of the camera in the frame of the grid, which is that of the robot's root; x to
            the right, y downwards, z forward along the optical axis.
        voxel
            The side (m) of a cell.
        bounds
            (2, 3) lower and upper corner (m) of the box of space that the grid covers, which is widened to whole cells.
        unknown
            Whether unseen cells are ``"occupied"`` or ``"free"``.
        depth_scale
            Metres per unit of the image: 0.001 for millimetres. Default: 1 for floating-point numbers; integers need a
            stated scale.
        depth_uncertainty
            Largest error (m) of a measured depth, one number or one for each pixel (height, width).
        pixel_margin
            Number of pixels around the image of a cell that must be farther than the cell too.

        Raises
        ------
        InputError
            If the image is not in metres, has another size than the intrinsics, or holds no measurement; if the pose
            is not rigid, the bounds are empty, or no cell of them is in the view of the camera.
        FileError
            If the file of the image cannot be read.
        """
        view = DepthView.read(
            image, intrinsics, camera_pose, depth_scale=depth_scale, depth_uncertainty=depth_uncertainty
        )
        return cls.from_view(view, voxel=voxel, bounds=bounds, unknown=unknown, pixel_margin=pixel_margin)

    @classmethod
    def from_view(
        cls,
        view: DepthView,
        *,
        voxel: float,
        bounds: Bounds,
        unknown: str = "occupied",
        pixel_margin: int = PIXEL_MARGIN,
    ) -> OccupancyGrid:
        """Return the cells that one depth image proves free, as :meth:`from_depth` does.

        Cells that are entirely in a body that was removed from the view are free too.
        """
        low, count, side = _lattice(bounds, voxel)
        camera, camera_from_root = view.intrinsics, view.root_from_camera.inverse()
        require_integer("pixel_margin", pixel_margin, 0)
        if pixel_margin >= max(camera.width, camera.height):
            raise InputError(
                f"pixel_margin = {pixel_margin} is larger than the image: {camera.width} x {camera.height}"
            )
        if float(view.nearest.max()) <= side:  # nothing can be free
            raise InputError(
                f"every measured surface is within {float(view.depth.max()):.3g} m of the camera: it is covered or "
                "inside an obstacle"
            )
        # The core carves the cells that the image proves free.
        cells = np.empty(count, dtype=np.uint8)
        intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        carve(cells, low, side, matrix(camera_from_root), intrinsics, view.nearest, view.farthest, pixel_margin)
        # Cells within the error of points outside the image are occupied too; lengths in cells from the first one.
        beside, error = view.beside / side - low, float(view.uncertainty.max()) / side
        steps = np.linspace(-error, error, max(2, math.ceil(2 * error) + 1))
        for offset in itertools.product(steps, repeat=3) if len(beside) else ():
            at = np.floor(beside + offset)
            at = at[((at >= 0) & (at < cells.shape)).all(axis=1)].astype(np.int64)
            cells[tuple(at.T)] = SEEN
        if (cells == UNKNOWN).all():
            center = camera_from_root.act((low + np.array(count) / 2) * side)
            place = ", ".join(f"{x:.3g}" for x in center)
            raise InputError(
                f"the image shows no cell of the bounds: their center is at ({place}) in the frame of the camera, "
                "whose x axis points right, y down and z forward, or it is hidden; check camera_pose and bounds"
            )
        free = int(np.count_nonzero(cells == FREE))
        place = ", ".join(f"{x:.4g}" for x in view.root_from_camera.translation)
        least, most = float(view.uncertainty.min()) * 1e3, float(view.uncertainty.max()) * 1e3
        trusted = f"{most:g} mm" if least == most else f"{least:g} to {most:g} mm"
        sentence = (
            f"depth image of {camera.width} x {camera.height} pixels from ({place}): {free} cells free; depths are "
            f"trusted to {trusted}, bodies that the camera does not measure are not covered"
        )
        # Cells in a removed body hold nothing else where the view looks through it.
        grid = cls(cells, side, tuple(low.tolist()), unknown, (sentence, *view.record))
        for part in view.removed:
            grid = grid.cleared(part.pieces, 0.0, f"in {part.name}")
        return grid

    @classmethod
    def from_points(
        cls,
        points: npt.ArrayLike | str | Path,
        intrinsics: Intrinsics,
        camera_pose: pin.SE3 | npt.ArrayLike,
        *,
        voxel: float,
        bounds: Bounds,
        cloud_pose: pin.SE3 | npt.ArrayLike | None = None,
        unknown: str = "occupied",
        depth_uncertainty: float = DEPTH_UNCERTAINTY,
        pixel_margin: int = PIXEL_MARGIN,
    ) -> OccupancyGrid:
        """Return the cells that a point cloud proves free: those that its camera saw in front of its points.

        Points alone prove nothing free, so the cloud needs the camera that measured it. Its points become a depth image
        in which each pixel shows the nearest point, and :meth:`from_depth` states the rule and what it assumes. Pixels
        without a point prove nothing: for a sparse cloud, such as of a laser scanner, state a camera at the sensor
        with pixels that are larger than the spacing of the points. Points outside the image are occupied cells too.
        :class:`~pinproof.PointCloud` is the shape for points whose surroundings are assumed to be free.

        Parameters
        ----------
        points
            (N, 3) points (m), or a file (``.npy``, ``.ply``, ``.pcd``). Masked points and those that are not finite are
            dropped, and the record states how many.
        intrinsics
            The camera.
        camera_pose
            ``root_from_camera``, as for :meth:`from_depth`.
        voxel, bounds
            As for :meth:`from_depth`.
        cloud_pose
            ``root_from_cloud``: the pose of the frame of the points in the frame of the grid; for points in the frame
            of the camera it is ``camera_pose``. Default: the points are in the frame of the grid.
        unknown, pixel_margin
            As for :meth:`from_depth`.
        depth_uncertainty
            Largest error (m) of a point along the optical axis.

        Raises
        ------
        InputError
            If the cloud is empty, is not in metres, or has no point in the view; or as for :meth:`from_depth`.
        FileError
            If the file cannot be read.
        """
        view = DepthView.from_points(
            points, intrinsics, camera_pose, cloud_pose=cloud_pose, depth_uncertainty=depth_uncertainty
        )
        return cls.from_view(view, voxel=voxel, bounds=bounds, unknown=unknown, pixel_margin=pixel_margin)

    @classmethod
    def from_octomap(
        cls,
        path: str | Path | OctomapLeaves,
        *,
        unknown: str = "occupied",
        bounds: Bounds | None = None,
        threshold: float = THRESHOLD,
    ) -> OccupancyGrid:
        """Return the cells of a map of OctoMap, at its resolution and in its frame.

        The map is trusted: certificates do not cover bodies in cells that it states to be free.

        Parameters
        ----------
        path
            The file: ``.bt`` (occupied and free leaves) or ``.ot`` (probabilities; OcTree or ColorOcTree). The scene
            of a MoveIt planning scene contains the grid of its octomap already.
        unknown
            Whether cells that are unknown in the map are ``"occupied"`` or ``"free"``.
        bounds
            (2, 3) lower and upper corner (m) of the box of space that the grid covers, which is widened to whole
            cells. Default: the smallest box that contains all known leaves.
        threshold
            Leaves of a ``.ot`` file are occupied if their occupancy is this or more. The leaves of a ``.bt`` file are
            already divided.

        Raises
        ------
        FileError
            If the file cannot be read, is truncated or damaged, holds another kind of tree, or has no known leaf.
        InputError
            If the bounds are empty, contain no known leaf, or have too many cells; if a threshold is given for a
            ``.bt`` file.
        """
        # The lattice is that of the map, so that every leaf consists of whole cells.
        leaves = path if isinstance(path, OctomapLeaves) else read_octomap(path, threshold)
        known: Array = np.asarray(leaves.bounds * leaves.resolution, dtype=np.float64)
        lattice = f"the resolution of the {leaves.source}"
        low, count, side = _lattice(known if bounds is None else bounds, leaves.resolution, lattice)
        cells = np.full(count, UNKNOWN, dtype=np.uint8)
        leaves.fill(cells, low, FREE, SEEN)
        if (cells == UNKNOWN).all():
            box = known.tolist()
            raise InputError(f"bounds contain no known leaf of the {leaves.source}; its known leaves are within {box}")
        judged = "" if leaves.threshold is None else f" (occupied from an occupancy of {leaves.threshold:g})"
        sentence = (
            f"{leaves.source} of {len(leaves.places)} known leaves{judged}; the map is trusted, bodies "
            "that it does not show are not covered"
        )
        return cls(cells, side, tuple(low.tolist()), unknown, (sentence,))

    # -- combination and removal --------------------------------------------------------------------------------------

    def cleared(self, pieces: Iterable[DepthPiece], padding: float, where: str) -> OccupancyGrid:
        """Return the grid in which cells entirely within ``padding`` (m) of a convex piece are free.

        :func:`pinproof.collision.remove_robot` and :func:`pinproof.collision.remove_body` call this; ``where`` is a
        phrase for the record.
        """
        require_positive("padding", padding, zero=True)
        cells = self.cells.copy()
        count = sum(
            clear_within(cells, np.array(self.low), self.voxel, piece.shape, piece.shape_from_root, padding)
            for piece in pieces
        )
        cells[(cells == FREE) & (self.cells != FREE)] = CLEARED
        return replace(self, cells=cells, record=(*self.record, f"{count} cells {where} are cleared"))

    def fuse(self, *others: OccupancyGrid) -> OccupancyGrid:
        """Return the grid of several views: a cell is free if one of them proves it free.

        Of a cell that none proves free, it is known that a surface was measured if one of the views shows it. The
        views must be of the same state of the scene. ``a | b`` is the same as ``a.fuse(b)``.

        Cells that were cleared in one grid are free in the result unless another grid shows a surface in them. A robot
        that is at the same place in several views is removed from each of them, or from the result.

        Raises
        ------
        InputError
            If the grids differ in their cells, their bounds, or in what unknown cells are.
        """
        for other in others:
            if not isinstance(other, OccupancyGrid):
                raise InputError(f"fuse() takes grids, not {type(other).__name__}")
            mine = (self.voxel, self.low, self.cells.shape, self.unknown)
            if mine != (other.voxel, other.low, other.cells.shape, other.unknown):
                raise InputError(
                    f"grids must have the same voxel, bounds and unknown to be fused; one is {self!r} from "
                    f"{self.bounds[0].tolist()} with unknown={self.unknown!r}, the other {other!r} from "
                    f"{other.bounds[0].tolist()} with unknown={other.unknown!r}"
                )
        grids = (self, *others)
        cells = _ranked(np.minimum.reduce([_ranked(grid.cells) for grid in grids]))
        return replace(self, cells=cells, record=tuple(dict.fromkeys(line for grid in grids for line in grid.record)))

    def __or__(self, other: OccupancyGrid) -> OccupancyGrid:
        return self.fuse(other)


def _ranked(cells: Cells) -> Cells:
    """The ranks of states in the order FREE, SEEN, CLEARED, UNKNOWN in which views are fused; its own inverse."""
    return np.bitwise_xor(cells, cells >> np.uint8(1), dtype=np.uint8)  # exchanges 2 and 3


def _lattice(
    bounds: Bounds, voxel: float, source: str = ""
) -> tuple[npt.NDArray[np.int64], tuple[int, int, int], float]:
    """Return the first cell (3,), the numbers of cells and their side, which ``source`` states if not the caller."""
    side = checked_size(source or "voxel", voxel)
    box = finite("bounds", bounds, (2, 3))
    if not (box[0] < box[1]).all():
        raise InputError(f"bounds = {box.tolist()} are empty; they are the lower and the upper corner of a box")
    if np.abs(box).max() > LARGEST_SIZE:
        raise InputError(f"bounds reach {np.abs(box).max():g} m; they are limited to {LARGEST_SIZE:g} m")
    # A bound at a multiple of the side, up to rounding, adds no cell.
    low = np.floor(box[0] / side + 1e-9).astype(np.int64)
    nx, ny, nz = (np.ceil(box[1] / side - 1e-9).astype(np.int64) - low).clip(min=1).tolist()
    # A grid that would not fit into memory is refused before it is made.
    if nx * ny * nz > MOST_CELLS:
        least = float((np.prod(box[1] - box[0]) / MOST_CELLS) ** (1 / 3))
        remedy = "state smaller bounds" if source else f"use {least:.2g} m or more, or smaller bounds"
        raise InputError(
            f"{source or 'voxel'} = {side:g} gives {nx} x {ny} x {nz} cells, more than {MOST_CELLS}; {remedy}"
        )
    return low, (nx, ny, nz), side


SOURCES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "views": (("voxel", "bounds"), ()),
    "octomap": ((), ("bounds", "threshold")),
    "cells": (("voxel", "low", "count"), ("record",)),
}
"""The keys of which a grid in a file has exactly one, each with the keys that it needs and those that it may have."""

_KEYS = (
    st.Key("voxel", LENGTH, "with `views` or `cells`: side of a cell", "m"),
    st.Key("unknown", st.choice(*POLICIES), "the state of cells that were not seen", "", POLICIES[0]),
    st.Key("views", st.list_of(VIEW, 1), "the depth images; a cell is free if one of them proves it free"),
    st.Key(
        "octomap", st.file_of(), "a map of OctoMap (BT or OT), relative to the folder of this file, instead of `views`"
    ),
    st.Key(
        "bounds",
        st.list_of(st.vector(3, COORDINATE), 2, 2),
        "lower and upper corner of the grid: required with `views`; with `octomap`, by default those of known space",
        "m",
    ),
    st.Key(
        "threshold",
        st.number(above=0, below=1),
        "with `octomap`: occupancy from which the leaves of an OT file are occupied",
        "",
        THRESHOLD,
    ),
    st.Key("cells", st.TEXT, "the states of the cells instead of `views`: base64 of zlib, as `Scene.save` writes it"),
    st.Key("low", st.list_of(st.INTEGER, 3, 3), "with `cells`: indices of the first cell"),
    st.Key("count", st.list_of(st.integer(1), 3, 3), "with `cells`: numbers of cells along x, y, z"),
    st.Key("record", st.list_of(st.ANY_TEXT), "with `cells`: how the grid was made"),
)


def _grid(unknown: str = POLICIES[0], **stated: Any) -> OccupancyGrid:
    """The grid that a file states: by depth images of which it is made, by a map, or by the states of its cells."""
    # A grid has one source, and the keys that belong to it.
    sources = [key for key in SOURCES if key in stated]
    if len(sources) != 1:
        what = " and ".join(sources) or "no source of its cells"
        raise InputError(f"occupancy_grid has {what}; it needs one of {', '.join(SOURCES)}")
    needed, possible = SOURCES[sources[0]]
    for name in stated:
        if name not in (*sources, *needed, *possible):
            kind = f"key of occupancy_grid with {sources[0]}"
            raise UnknownNameError(kind, name, [*sources, "unknown", *needed, *possible])
    if missing := [key for key in needed if key not in stated]:
        raise InputError(f"occupancy_grid does not state {' and '.join(missing)}")
    if "octomap" in stated:
        return OccupancyGrid.from_octomap(stated.pop("octomap"), unknown=unknown, **stated)
    if "views" in stated:
        voxel, bounds = stated["voxel"], stated["bounds"]
        grids = [
            OccupancyGrid.from_view(view, voxel=voxel, bounds=bounds, unknown=unknown, **margin)
            for view, margin in stated["views"]
        ]
        return grids[0].fuse(*grids[1:])
    # The states of the cells are zlib in base64, of exactly the stated size.
    size = math.prod(stated["count"])
    if size > MOST_CELLS:
        raise InputError(f"occupancy_grid.count: {stated['count']} are more than {MOST_CELLS} cells")
    try:
        data = zlib.decompressobj().decompress(base64.b64decode(stated["cells"], validate=True), size + 1)
    except (binascii.Error, ValueError, zlib.error) as error:
        raise InputError(f"occupancy_grid.cells: cannot be decoded ({error}); Scene.save writes it") from error
    if len(data) != size:
        raise InputError(f"occupancy_grid.cells: does not hold the states of {size} cells")
    cells = np.frombuffer(data, dtype=np.uint8).reshape(stated["count"])
    return OccupancyGrid(cells, stated["voxel"], stated["low"], unknown, stated.get("record", ()))


def stated_grid(grid: OccupancyGrid) -> dict[str, Any]:
    """Return a grid as a mapping for a file; it has about one byte for every twenty cells."""
    packed = base64.b64encode(zlib.compress(grid.cells.tobytes(), 9)).decode("ascii")
    head = {"voxel": grid.voxel, "unknown": grid.unknown, "low": list(grid.low), "count": list(grid.cells.shape)}
    return {**head, "cells": packed, "record": list(grid.record)}


GRID = st.Table(
    "occupancy_grid",
    "Space that depth images prove free, or that a map of OctoMap states free; everything else is an obstacle.",
    *_KEYS,
    rules={
        "oneOf": [
            {
                "required": [*needed, source],
                **st.without(*(key.name for key in _KEYS if key.name not in (source, "unknown", *needed, *possible))),
            }
            for source, (needed, possible) in SOURCES.items()
        ]
    },
    make=_grid,
)
