"""Parts and bins as meshes: their unit, the poses in which they rest, the free floor of a bin, and rows of parts."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pinproof.description import read_mesh
from pinproof.errors import InputError, MeshError, UnknownNameError
from pinproof.spatial import SE3, Array

if TYPE_CHECKING:
    import trimesh

UNITS = {"m": (1.0, "metres"), "mm": (1e-3, "millimetres"), "inch": (0.0254, "inches")}
"""Metres per unit of a mesh file, and the name of the unit."""

MOST_PART, MOST_BIN = 1.0, 3.0
"""Metres: a larger part, or bin, is in millimetres. A part of a millimetre, which it would be otherwise, is too small
to be gripped."""

SAME_HEIGHT = 4
"""Decimals of the height (m) of the centre of mass by which poses of rest are one, as on the facets of a cylinder."""

LEAST_SHARE = 0.1
"""The least probability of a pose of rest that is used."""

CELL, CELLS = 0.005, 160
"""Metres between the rays that measure the floor of a bin; at most this many along a side."""

FLAT_FLOOR, LEAST_RIM = 2e-3, 1e-2
"""Metres: the height of points of the floor of a bin above the lowest, and the least height of its rim."""


class RestingPose(NamedTuple):
    """A stable pose on a plane, with its probability; the part is within ``radius`` and ``height`` (m) of the origin.

    ``plane_from_part`` has the middle of the footprint at the origin.
    """

    plane_from_part: SE3
    share: float
    radius: float
    height: float


def relative(path: str | Path, folder: Path) -> str:
    """A path as a file in a folder states it."""
    return Path(os.path.relpath(Path(path).resolve(), folder.resolve())).as_posix()


@dataclass(frozen=True, eq=False)
class Workpiece:
    """A closed mesh in metres, read from a file with a ``scale``; ``stated`` is the mesh as a file states it."""

    name: str
    path: Path
    scale: float
    stated: Mapping[str, Any]
    mesh: trimesh.Trimesh
    described: str

    @classmethod
    def read(cls, path: str | Path, folder: Path, *, most: float, unit: str | None) -> Workpiece:
        """Read a mesh file for files in a folder; without a unit it is in millimetres if its size exceeds ``most`` (m).

        Raises
        ------
        MeshError
            If the file cannot be read, or the mesh is open.
        UnknownNameError
            If the unit is not one of :data:`UNITS`.
        """
        import trimesh

        path, read = Path(path), read_mesh(path)
        sides = np.ptp(read.vertices, axis=0)
        unit = unit or ("mm" if sides.max() > most else "m")
        if unit not in UNITS:
            raise UnknownNameError("unit", unit, UNITS)
        scale, word = UNITS[unit]
        mesh = trimesh.Trimesh(read.vertices * scale, read.triangles)
        if not mesh.is_watertight:
            single = mesh.edges_sorted[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)]
            where = f", the first at {np.round(read.vertices[single[0, 0]], 4).tolist()}" if len(single) else ""
            what = f"the mesh is open: {len(single)} edges belong to one triangle{where}"
            raise MeshError(path, f"{what}. Close it in the CAD program, so that its inside is defined")
        mesh.fix_normals()
        size = " x ".join(f"{side:.4g}" for side in sides)
        stated, name = {"path": relative(path, folder), "scale": scale}, path.stem.replace(" ", "_")
        return cls(name, path, scale, stated, mesh, f"{path.name}: {size}: taken as {word}")

    @cached_property
    def narrowest(self) -> float:
        """Metres: the smallest side of the smallest box around it."""
        return float(self.mesh.bounding_box_oriented.primitive.extents.min())

    @cached_property
    def rests(self) -> tuple[RestingPose, ...]:
        """The poses in which it rests on a plane, the most probable first."""
        # Poses on the facets of one round side are one pose
        shares: dict[float, float] = {}
        first: dict[float, Array] = {}
        for placed, share in zip(*self.mesh.compute_stable_poses(), strict=True):
            key = round(float(placed[2, :3] @ self.mesh.center_mass + placed[2, 3]), SAME_HEIGHT)
            shares[key] = shares.get(key, 0.0) + float(share)
            first.setdefault(key, placed[:3, :3])
        found = []
        for key in sorted(shares, key=lambda key: -shares[key]):
            points = self.mesh.vertices @ first[key].T
            low, high = points.min(axis=0), points.max(axis=0)
            middle = np.array([*(low + high)[:2] / 2, low[2]])
            radius = np.linalg.norm((points - middle)[:, :2], axis=1).max()
            found.append(RestingPose(SE3(first[key], -middle), shares[key], float(radius), float(high[2] - low[2])))
        return tuple(rest for rest in found if rest.share >= LEAST_SHARE) or tuple(found[:1])


def free_floor(bin: Workpiece) -> tuple[Array, Array, float]:  # noqa: A002  # as in the command
    """The largest free rectangle of the floor of a bin, parallel to its axes: two corners (2,), and the height (m).

    Rays from above meet the bin at its upper surface; the cells at the lowest level are the floor.

    InputError if the bin has no interior that is open upwards.
    """
    low, high = bin.mesh.bounds
    step = max(CELL, float((high - low)[:2].max()) / CELLS)
    x, y = (np.arange(a + step / 2, b, step) for a, b in zip(low[:2], high[:2], strict=True))
    above = np.stack([*np.meshgrid(x, y, [high[2] + 1.0], indexing="ij")], axis=-1).reshape(-1, 3)
    hits, rays, _ = bin.mesh.ray.intersects_location(above, np.tile([0.0, 0.0, -1.0], (len(above), 1)))
    surface: Array = np.full(len(above), -np.inf)
    np.maximum.at(surface, rays, hits[:, 2])
    surface = np.where(np.isfinite(surface), surface, high[2]).reshape(len(x), len(y))
    floor = float(surface.min())
    free = surface <= floor + FLAT_FLOOR
    # For each first and last row, the longest run of columns that are free in all rows between them
    best, corners = 0, (0, 0, 0, 0)
    for first in range(len(x)):
        columns = np.ones(len(y), dtype=bool)
        for last in range(first, len(x)):
            columns = columns & free[last]
            starts, ends = np.flatnonzero(np.diff(np.concatenate([[0], columns, [0]]).astype(int))).reshape(-1, 2).T
            longest = int((ends - starts).argmax()) if len(starts) else 0
            area = (last - first + 1) * int(ends[longest] - starts[longest]) if len(starts) else 0
            if area > best:
                best, corners = area, (first, last, int(starts[longest]), int(ends[longest]) - 1)
    if high[2] - floor < LEAST_RIM:
        raise InputError(
            f"{bin.path}: the bin has no interior that is open upwards (+z of its file); turn the mesh, or state no "
            "bin, so that the parts lie on a table"
        )
    a, b, c, d = corners
    return np.array([x[a], y[c]]) - step / 2, np.array([x[b], y[d]]) + step / 2, floor


def arrange(radii: Sequence[float], gap: float, length: float) -> tuple[Array, Array]:
    """Rows of circles along y with a gap (m): their centres (N, 2) about the middle, and the size (2,) of all rows.

    No row is longer than ``length`` (m), unless it is a single circle.
    """
    rows: list[list[int]] = [[]]
    for number, radius in enumerate(radii):
        if rows[-1] and sum(2 * radii[k] + gap for k in rows[-1]) + 2 * radius > length:
            rows.append([])
        rows[-1].append(number)
    lengths = [sum(2 * radii[k] + gap for k in row) - gap for row in rows]
    centres, x = np.zeros((len(radii), 2)), 0.0
    for row, own in zip(rows, lengths, strict=True):
        depth, y = 2 * max(radii[k] for k in row), -own / 2
        for k in row:
            centres[k] = x + depth / 2, y + radii[k]
            y += 2 * radii[k] + gap
        x += depth + gap
    return centres - [(x - gap) / 2, 0.0], np.array([x - gap, max(lengths)])
