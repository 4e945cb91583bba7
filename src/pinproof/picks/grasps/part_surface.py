"""The surface of a part as grasps need it: oriented triangles, points spread over them, and its centre of mass."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import HalfSpace, LineSurface, Mesh, Obstacle
from pinproof.description import read_mesh
from pinproof.errors import InputError
from pinproof.spatial import Array, finite
from pinproof.viewer import obstacle_surfaces

SAMPLES = 3000
"""Number of points that are spread over the surface of a part."""

LARGEST_PART = 2.0
"""Metres. A mesh file of a longer part is in millimetres: no hand holds a part of this size."""


@dataclass(frozen=True, eq=False)
class PartSurface:
    """A part in its own frame.

    ``triangles`` (F, 3, 3) are oriented outwards. ``points`` (N, 3) with outward ``normals`` (N, 3) are spread over
    them by area, about ``spacing`` (m) apart. No point of the surface is farther from ``centre`` (3,), the centre of
    mass, than ``size`` (m). ``remark`` states a unit that was recognised.
    """

    obstacle: Obstacle
    surface: LineSurface
    triangles: Array
    points: Array
    normals: Array
    spacing: float
    centre: Array
    size: float
    remark: str = ""

    @classmethod
    def of(cls, part: Any, rng: np.random.Generator, centre: npt.ArrayLike | None = None) -> PartSurface:
        """The surface of a part; ``centre`` (3,) is its centre of mass, by default that of a uniform density.

        InputError if the part is not bounded, or its mesh is not closed; also for the reasons of ``Obstacle``.
        """
        obstacle, remark = as_part(part)
        surface = LineSurface.of_obstacle(obstacle)
        # Closed triangles, oriented outwards: of a mesh, or of a shape as it is drawn
        solid = (surface.surface or surface.body).solid
        if isinstance(obstacle.shape, Mesh):
            if solid is None or not solid.watertight:
                raise InputError(
                    f"{obstacle.name}: its mesh is not closed, so it has no inside that a hand could hold; close the "
                    "holes of the mesh, or state its convex hull as a mesh"
                )
            corners = np.asarray(solid.corners)  # type: ignore[attr-defined]  # of a solid mesh
        elif surface.triangles is not None:
            corners = surface.triangles
        else:
            drawn = obstacle_surfaces(obstacle)
            corners = np.concatenate([each.vertices[each.triangles] for each in drawn])
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double = np.linalg.norm(across, axis=1)
        corners, across, double = (values[double > 0.0] for values in (corners, across, double))
        # Points at equal steps of the area, at random places of their triangles
        at = (np.arange(SAMPLES) + rng.random(SAMPLES)) / SAMPLES * double.sum()
        chosen = np.minimum(np.searchsorted(np.cumsum(double), at), len(double) - 1)
        u, v = rng.random((2, SAMPLES))
        u, v = np.where(u + v > 1.0, 1.0 - u, u)[:, None], np.where(u + v > 1.0, 1.0 - v, v)[:, None]
        first, second, third = corners[chosen].swapaxes(0, 1)
        points = first + u * (second - first) + v * (third - first)
        # The centre of the volume, which is a sum of tetrahedra from one point
        if centre is None:
            origin = corners.reshape(-1, 3).mean(axis=0)
            volumes = np.einsum("fi,fi->f", corners[:, 0] - origin, across)
            centre = origin + volumes @ (corners - origin).sum(axis=1) / 4 / volumes.sum()
        centre = finite("centre of mass", centre, (3,))
        size = float(np.linalg.norm(corners.reshape(-1, 3) - centre, axis=1).max())
        spacing = float(np.sqrt(double.sum() / 2 / SAMPLES))
        return cls(
            obstacle, surface, corners, points, (across / double[:, None])[chosen], spacing, centre, size, remark
        )

    @property
    def extents(self) -> Array:
        """(3,) the sides (m) of the box around the part along the axes of its frame."""
        return np.asarray(np.ptp(self.triangles.reshape(-1, 3), axis=0))

    @cached_property
    def cloud(self) -> Array:
        """(M, 3) the points and the corners of the triangles, by which contact with the hand is found.

        Of corners that are close to each other, compared with the spacing of the points, one is enough.
        """
        every = self.triangles.reshape(-1, 3)
        cell = np.rint((every - self.centre) / (0.25 * self.spacing)).astype(np.int64) @ [1, 1 << 20, 1 << 40]
        cloud = np.concatenate([self.points, every[np.unique(cell, return_index=True)[1]]])
        return cloud

    def flat_points(self, radius: float, gap: float) -> npt.NDArray[np.int64]:
        """Indices of points around which a disc of a radius (m) is covered by surface within ``gap`` (m) of its plane.

        This is a first selection by the points alone; holes and edges between them are not noticed.
        """
        from scipy.spatial import cKDTree

        expected = np.pi * radius**2 / self.spacing**2
        wanted, flat = expected - 2.0 * np.sqrt(expected), list[int]()
        if wanted > len(self.points):  # the disc is larger than the part
            return np.array(flat, dtype=np.int64)
        near = cKDTree(self.points).query_ball_point(self.points, radius)
        for k, others in enumerate(near):
            heights = (self.points[others] - self.points[k]) @ self.normals[k]
            if (np.abs(heights) <= gap).sum() >= wanted:
                flat.append(k)
        return np.array(flat, dtype=np.int64)


def as_part(part: Any) -> tuple[Obstacle, str]:
    """A part as a body in its own frame, and a remark on its unit if that was recognised."""
    if isinstance(part, Obstacle):
        made = Obstacle(part.name, part.shape, rgba=part.rgba)
    elif isinstance(part, (str, Path)):
        made = Obstacle(Path(part).stem, Mesh(part))
    else:
        made = Obstacle("part", part)
    if isinstance(made.shape, HalfSpace):
        raise InputError(f"{made.name}: a half-space has no bounded surface; a part is a mesh or a bounded shape")
    if not isinstance(part, (str, Path)):
        return made, ""
    length = float(np.ptp(read_mesh(part, (1.0, 1.0, 1.0)).vertices, axis=0).max())
    if length <= LARGEST_PART:
        return made, ""
    remark = f"{Path(part).name} is {length:.3g} long: it is read in millimetres, with the scale 0.001"
    return Obstacle(made.name, Mesh(part, scale=0.001)), remark


@dataclass(frozen=True, eq=False)
class Candidates:
    """N hands on a part: ``part_from_hand`` as rotations and translations, with C contacts each.

    ``contacts`` (N, C, 3) are the centres of the contacts, ``normals`` (N, C, 3) the directions in which the hand
    presses there, and ``areas`` (N,) (m^2) the smaller areas of contact. ``widths`` (N,) (m) are the distances of
    pads, and ``edges`` (N,) (m) those of the rim of a cup from edges and holes; NaN for other hands.
    """

    rotations: Array
    translations: Array
    contacts: Array
    normals: Array
    areas: Array
    widths: Array
    edges: Array

    def chosen(self, rows: npt.NDArray[np.int64]) -> Candidates:
        """Some of the hands."""
        return Candidates(*(values[rows] for values in vars(self).values()))


def spread(features: Array, first: int, rng: np.random.Generator, most: int | None = None) -> npt.NDArray[np.int64]:
    """Indices of rows (N, d), each far from those before it (T. F. Gonzalez, 1985, farthest-first traversal)."""
    count = len(features) if most is None else min(most, len(features))
    order, nearest = np.empty(count, dtype=np.int64), np.full(len(features), np.inf)
    square = np.einsum("nd,nd->n", features, features)
    shuffled = 1.0 + 1e-6 * rng.random(len(features))  # decides between equals
    for k in range(count):
        order[k] = first
        away = square - 2.0 * (features @ features[first]) + square[first]
        np.minimum(nearest, np.maximum(away, 0.0), out=nearest)
        nearest[first] = -1.0
        first = int((nearest * shuffled).argmax())
    return order
