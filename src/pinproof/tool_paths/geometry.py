"""Tool paths on triangle meshes: the edges of a face, the section with a plane, and zigzags along a surface.

The tool points against the normals of the surface. The winding of the triangles states which side is outside.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision import Mesh, Obstacle
from pinproof.common import structs as st
from pinproof.description import read_mesh
from pinproof.errors import InputError
from pinproof.spatial import Array
from pinproof.tool_paths.path import ToolPath
from pinproof.tool_paths.rungs import Flags
from pinproof.tool_paths.strokes import Stroke, strokes_of
from pinproof.units import FAR, LENGTH_UNITS

# rad: largest angle between triangles of a planar face, and of those beyond its edges that belong to a curved one.
FLAT, CURVED = 1e-3, 0.5
# rad: largest angle between the normal of a raster and the normals of the surface on which it is.
FACING = np.radians(75.0)
# M: largest distance from an edge at which its normal differs from that of the facet, and of points that are one.
BLENDED, CLOSE = 0.01, 1e-9
# Largest number of lines of a raster; more follow from a spacing in other units.
MOST_LINES = 5000

Chain = tuple[Array, Array]
"""Points (k, 3) of a line on a surface in order, and the normals (k, 3) there."""


class Surface:
    """A mesh as a surface with an outer side.

    Raises
    ------
    InputError
        If an edge belongs to more than two triangles, or neighbours have opposite orientations.
    MeshError
        If the file cannot be read.
    """

    def __init__(self, mesh: Any, unit: str | None = None) -> None:
        from trimesh import Trimesh

        # The triangles in metres; equal vertices become one, and triangles without an area are dropped
        self.remark, scale = "", LENGTH_UNITS[unit or "m"]
        if isinstance(mesh, str | Path):
            read: Any = read_mesh(mesh)
            if unit is None and (size := float(np.ptp(read.vertices, axis=0).max())) > FAR:
                scale = LENGTH_UNITS["mm"]
                self.remark = f"{Path(mesh).name} is {size:.4g} long and read as millimetres; state the unit"
        else:
            read = Obstacle("mesh", mesh).shape
            if not isinstance(read, Mesh):
                raise InputError(f"mesh is a {type(read).__name__}; it must be a file or a mesh")
            read = read if read.path is None else read_mesh(read.path, read.scale)  # type: ignore[arg-type]
        made = Trimesh(scale * read.vertices, read.triangles, process=False)
        made.merge_vertices(digits_vertex=9)
        kept = made.nondegenerate_faces()
        made.update_faces(kept)
        if not len(made.faces):
            raise InputError("the mesh has no triangle with an area")
        _, counts = np.unique(made.edges_unique_inverse, return_counts=True)
        if counts.max() > 2 or not made.is_winding_consistent:
            raise InputError(
                "the mesh is not a surface with an outer side: an edge has more than two triangles, or neighbours of "
                "opposite orientation; repair the mesh"
            )
        if made.is_watertight and made.volume < 0.0:
            inward = "the normals of the closed mesh point inwards: the tool is on its inner side"
            self.remark = "; ".join(filter(None, (self.remark, inward)))
        self.vertices, self.triangles = np.array(made.vertices), np.array(made.faces)
        self.normals, self.numbers = np.array(made.face_normals), np.flatnonzero(kept)
        # The edges as pairs of vertices, and those of each triangle by their numbers; pairs of neighbours with angles
        self.edges, self.own_edges = np.array(made.edges_unique), np.array(made.faces_unique_edges)
        self.pairs, self.angles = np.array(made.face_adjacency).reshape(-1, 2), np.array(made.face_adjacency_angles)

    def part(self, start: int, bend: float, allowed: Flags) -> Flags:
        """(F,) the allowed triangles that are connected to one of them across edges with at most an angle ``bend``."""
        from trimesh.graph import connected_component_labels

        (row,) = np.flatnonzero(self.numbers == start)[:1] if start in self.numbers else (-1,)
        if row < 0 or not allowed[row]:
            what = "does not exist, or has no area" if row < 0 else "does not face the direction"
            raise InputError(f"the triangle with the number {start} {what}")
        pairs = self.pairs[(self.angles <= bend) & allowed[self.pairs].all(axis=1)]
        labels = connected_component_labels(pairs, len(allowed))
        return np.asarray(allowed & (labels == labels[row]))

    def section(self, point: Array, normal: Array, inside: Flags) -> list[Chain]:
        """The lines in which a plane meets the triangles ``inside`` (F,); a closed one ends at its first point."""
        heights = (self.vertices - point) @ normal
        above = heights >= 0.0
        first, second = self.edges.T
        crossed = above[first] != above[second]
        share = np.zeros(len(self.edges))
        share[crossed] = heights[first[crossed]] / (heights[first[crossed]] - heights[second[crossed]])
        # Each triangle that the plane meets joins the two of its edges that it crosses
        numbers = np.flatnonzero(inside & crossed[self.own_edges].any(axis=1))
        ends_of = {
            number: self.own_edges[number][crossed[self.own_edges[number]]].tolist() for number in numbers.tolist()
        }
        joined: dict[int, list[int]] = defaultdict(list)
        for number, ends in ends_of.items():
            for edge in ends:
                joined[edge].append(number)
        chains = []
        for start in [*(edge for edge, both in joined.items() if len(both) == 1), *joined]:
            line, triangles = [start], list[int]()
            while ahead := [number for number in joined[line[-1]] if number in ends_of]:
                line.append(next(edge for edge in ends_of.pop(ahead[0]) if edge != line[-1]))
                triangles.append(ahead[0])
            if triangles:
                a, b = self.vertices[first[line]], self.vertices[second[line]]
                chains.append(self._chain(a + share[line][:, None] * (b - a), triangles, straight=True))
        return chains

    def _chain(self, points: Array, triangles: list[int], *, straight: bool) -> Chain:
        """A line through points (k + 1, 3) on k triangles, with its normals.

        Neighbouring triangles in one plane are a facet. In its middle, the normal is that of the facet; at an edge to
        another facet it is the mean of both, and it changes evenly within half of the shorter facet, but at most
        :data:`BLENDED`, from the edge. So it does not depend on how facets are cut into triangles. Facets of section
        lines are ``straight``: their points within a facet are left out.
        """
        own, at = self.normals[triangles], _lengths(points)
        differs = np.linalg.norm(own - np.roll(own, 1, axis=0), axis=1) > FLAT
        edges = np.concatenate([[0], 1 + np.flatnonzero(differs[1:]), [len(own)]])
        flat, length = own[edges[:-1]], np.diff(at[edges])
        width = np.minimum(0.5 * np.minimum(length, np.roll(length, 1)), BLENDED)
        width[0] *= differs[0] and (points[0] == points[-1]).all()
        # At the start of each facet the mean, then its own normal up to where it changes to the next one
        mean = flat + np.roll(flat, 1, axis=0) * (width > 0.0)[:, None]
        mean /= np.linalg.norm(mean, axis=1, keepdims=True).clip(1e-12)
        places = np.column_stack([at[edges[:-1]], at[edges[:-1]] + width, at[edges[1:]] - np.roll(width, -1)])
        normals = np.stack([mean, flat, flat], axis=1).reshape(-1, 3)
        places = np.append(places.ravel(), at[-1])
        normals = np.concatenate([normals, mean[:1] if width[0] else flat[-1:]])
        rows = np.union1d(places, at[edges] if straight else at)
        rows = rows[(rows > CLOSE) & (rows < at[-1] - CLOSE)]
        rows = np.concatenate([[0.0], rows[np.diff(rows, append=np.inf) > CLOSE], at[-1:]])
        return _at(rows, at, points), _at(rows, places, normals)

    def boundary(self, inside: Flags) -> list[Chain]:
        """The closed lines around the triangles ``inside`` (F,), which are to the left; holes are lines too."""
        counts = np.bincount(self.own_edges[inside].ravel(), minlength=len(self.edges))
        following: dict[int, tuple[int, int]] = {}
        for number in np.flatnonzero(inside & (counts[self.own_edges] == 1).any(axis=1)).tolist():
            corners = self.triangles[number].tolist()
            for k, edge in enumerate(self.own_edges[number].tolist()):
                if counts[edge] == 1:
                    if corners[k] in following:
                        raise InputError(
                            f"the face touches itself at {np.round(self.vertices[corners[k]], 4).tolist()}"
                        )
                    following[corners[k]] = corners[(k + 1) % 3], number
        chains = []
        while following:
            line, triangles = [min(following)], list[int]()
            while line[-1] in following:
                vertex, number = following.pop(line[-1])
                line.append(vertex)
                triangles.append(number)
            chains.append(self._chain(self.vertices[line], triangles, straight=False))
        return chains


# -- contours ---------------------------------------------------------------------------------------------------------


@st.struct("contour", kw_only=True)
class Contour:
    """The edges of a face of a mesh, or the lines in which a plane meets it. Each closed line is a stroke.

    A face are the triangles that are connected to one of them without an edge in between.
    """

    normal: st.Direction | None = st.key(
        "the outward normal of the face, which is the farthest one in this direction; with `point`, that of a plane",
        default=None,
    )
    point: tuple[float, float, float] | None = st.key(
        "a point of a plane, whose section with the mesh is the contour", "m", default=None
    )
    face: int | None = st.key("the number of a triangle of the face, instead of `normal`", default=None, minimum=0)
    bend: float = st.key(
        "largest angle between neighbouring triangles of a curved face; by default the face is planar", "rad",
        default=FLAT, above=0, below=np.pi,
    )  # fmt: skip
    inset: float = st.key(
        "distance from the edges of a planar face to the inside; negative to the outside", "m", default=0.0
    )
    offset: float = st.key("distance of the tip from the surface", "m", default=0.0)

    def chains(self, surface: Surface) -> list[Chain]:
        """The lines on the surface, before the offset along the normals."""
        every = np.ones(len(surface.triangles), dtype=bool)
        if self.point is not None:
            if self.normal is None or self.face is not None or self.inset:
                raise InputError("a section needs point and normal, without face and inset")
            chains = surface.section(np.array(self.point), np.array(self.normal), every)
            if not chains:
                raise InputError("the plane does not meet the mesh")
            return chains
        if (self.normal is None) == (self.face is None):
            raise InputError("state the normal of the face, or the number of one of its triangles (face)")
        start = self.face
        if start is None:  # the farthest triangle with this normal
            facing = surface.normals @ np.array(self.normal) > np.cos(FLAT)
            if not facing.any():
                raise InputError(f"the mesh has no planar face with the normal {list(self.normal or ())}")
            heights = (surface.vertices[surface.triangles] @ np.array(self.normal)).max(axis=1)
            start = int(surface.numbers[np.where(facing, heights, -np.inf).argmax()])
        inside = surface.part(start, self.bend, every)
        # A face without a sharp edge is part of a curved one
        leaving = inside[surface.pairs].sum(axis=1) == 1
        if (angle := float(surface.angles[leaving].min(initial=np.pi))) < CURVED:
            raise InputError(
                f"the face is not planar: a neighbour is inclined by {np.degrees(angle):.2g} deg; "
                f"state bend above {angle:.3g} rad for a curved face"
            )
        chains = surface.boundary(inside)
        if not chains:
            raise InputError(
                "the face has no edges: it is a closed surface; state a smaller bend, or a point of a plane"
            )
        if self.inset:
            if np.ptp(surface.normals[inside], axis=0).max() > FLAT:
                raise InputError("inset is for planar faces; this one is curved")
            chains = [_inset(points, normals, self.inset, chains) for points, normals in chains]
        return chains


def _inset(points: Array, normals: Array, inset: float, edges: list[Chain]) -> Chain:
    """A closed line in a plane moved to its left by a distance, which it keeps from all edges of the face."""
    normal = normals[0] / np.linalg.norm(normals[0])
    steps = np.diff(points, axis=0)
    along = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    aside = np.cross(normal, along)
    before = np.roll(aside, 1, axis=0)
    # The corner of the moved lines: both have the distance from it
    cosine = np.einsum("ki,ki->k", before, aside)
    if (cosine < -0.9).any():
        raise InputError("inset is not possible at a corner of less than 26 deg")
    moved = points[:-1] + inset * (before + aside) / (1.0 + cosine)[:, None]
    moved = np.concatenate([moved, moved[:1]])
    if (np.einsum("ki,ki->k", np.diff(moved, axis=0), along) <= 0.0).any():
        raise InputError(f"inset = {inset:g} m is too large for the shortest edges of the face")
    # Points closer to each other than the inset, so that none is close to an edge only if the line crosses no edge
    counts = np.ceil(np.linalg.norm(np.diff(moved, axis=0), axis=1) / abs(inset)).astype(int) + 1
    samples = np.concatenate([np.linspace(*ends, count) for ends, count in zip(pairwise(moved), counts, strict=True)])
    for line, _ in edges:
        for a, b in pairwise(line):
            share = ((samples - a) @ (b - a) / ((b - a) @ (b - a))).clip(0.0, 1.0)
            apart = np.linalg.norm(samples - a - share[:, None] * (b - a), axis=1)
            if apart.min() < (1.0 - 1e-6) * abs(inset):
                raise InputError(
                    f"inset = {inset:g} m is too large: the line comes closer to another edge of the face, "
                    f"{apart.min():.4g} m at {np.round(samples[apart.argmin()], 4).tolist()}"
                )
    return moved, normals


# -- rasters ----------------------------------------------------------------------------------------------------------


@st.struct("raster", kw_only=True)
class Raster:
    """Parallel lines along a surface, each in the direction opposite to the one before, joined to a zigzag.

    Holes and edges divide it into several strokes. What other parts of the surface cover, seen along ``normal``, does
    not belong to it; state ``face`` for a part that is covered.
    """

    direction: st.Direction = st.key("the direction of the lines")
    spacing: float = st.key("distance of the lines, seen along `normal`", "m", above=0)
    normal: st.Direction = st.key(
        "the direction from which the surface is seen: triangles with normals up to 75 deg away from it belong to it",
        default=(0.0, 0.0, 1.0),
    )
    face: int | None = st.key(
        "the number of a triangle; only what is connected to it belongs to the surface", default=None, minimum=0
    )
    margin: float | None = st.key(
        "length by which lines end before edges; by default half of `spacing`", "m", default=None, minimum=0
    )
    joined: bool = st.key("whether lines are joined along the surface, where it has no hole between them", default=True)
    offset: float = st.key("distance of the tip from the surface", "m", default=0.0)

    def chains(self, surface: Surface) -> list[Chain]:
        """The lines on the surface, before the offset along the normals."""
        normal = np.array(self.normal)
        along = np.array(self.direction) - (normal @ self.direction) * normal
        if np.linalg.norm(along) < 1e-6:
            raise InputError("direction and normal of a raster must not be parallel")
        along /= np.linalg.norm(along)
        aside, margin = np.cross(normal, along), 0.5 * self.spacing if self.margin is None else self.margin
        inside = surface.normals @ normal > np.cos(FACING)
        if self.face is not None:
            inside = surface.part(self.face, np.pi, inside)
        if not inside.any():
            raise InputError(f"no triangle of the mesh faces the direction {normal.tolist()}; state another normal")
        extent = surface.vertices[np.unique(surface.triangles[inside])] @ aside
        count = int((np.ptp(extent) + 1e-9) / self.spacing)
        if count < 1:
            width = f"{np.ptp(extent):.4g} m"
            raise InputError(f"spacing = {self.spacing:g} m is larger than the surface, which is {width} wide")
        if count > MOST_LINES:
            raise InputError(
                f"spacing = {self.spacing:g} m makes {count:,} lines, more than {MOST_LINES:,}; spacing is in metres"
            )
        places = extent.min() + 0.5 * (np.ptp(extent) - (count - 1) * self.spacing) + self.spacing * np.arange(count)
        # Lines with their ends cut off, alternately in both directions
        found: list[Chain] = []
        follows: list[bool] = []
        for row, place in enumerate(places):
            sign = -1.0 if row % 2 else 1.0
            lines = []
            for points, normals in _seen(surface.section(place * aside, aside, inside), along, normal):
                forward = sign > 0.0
                cut = _shortened(points if forward else points[::-1], normals if forward else normals[::-1], margin)
                if cut is not None:
                    lines.append(cut)
            lines.sort(key=lambda line: sign * float(line[0][0] @ along))
            found += lines
            follows += [False] * len(lines)
            if lines and len(found) > len(lines):
                follows[-len(lines)] = True
        if not found:
            raise InputError(f"no line of the surface is longer than twice the margin of {margin:g} m")
        # A line is joined to the one before if the section through both ends leads from one to the other
        strokes = found[:1]
        for (points, normals), follow in zip(found[1:], follows[1:], strict=True):
            before, link = strokes[-1], None
            if self.joined and follow:
                link = _link(surface, before[0][-1], points[0], before[1][-1] + normals[0], inside)
            if link is None:
                strokes.append((points, normals))
            else:
                strokes[-1] = tuple(np.concatenate(each) for each in zip(before, link, (points, normals), strict=True))  # type: ignore[assignment]
        return strokes


def _lengths(points: Array) -> Array:
    """(k,) the length of a line up to each of its points (k, 3)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def _at(rows: Array, places: Array, values: Array) -> Array:
    """(m, 3) values (k, 3) at places (k,) of a line, between them at others (m,)."""
    return np.column_stack([np.interp(rows, places, column) for column in values.T])


def _seen(lines: list[Chain], along: Array, up: Array) -> list[Chain]:
    """The parts of lines in one plane that no other one covers, as seen from above, in the direction ``along``.

    The height of each line is a function of the place along it, because the surface is not steep.
    """
    lines = [line if (line[0][-1] - line[0][0]) @ along > 0.0 else (line[0][::-1], line[1][::-1]) for line in lines]
    if len(lines) < 2:
        return lines
    graphs = [(points @ along, points @ up) for points, _ in lines]
    seen = []
    for (points, normals), (own, heights) in zip(lines, graphs, strict=True):
        # Between the places of the points of all lines, each one is straight
        cuts = np.unique(np.concatenate([at for at, _ in graphs]).clip(own[0], own[-1]))
        middles = 0.5 * (cuts[1:] + cuts[:-1])
        height = np.interp(middles, own, heights)
        others = [np.interp(middles, at, other, left=-np.inf, right=-np.inf) for at, other in graphs]
        visible = np.max(others, axis=0) <= height + CLOSE
        ends = np.flatnonzero(np.diff(np.concatenate([[False], visible, [False]]).astype(int)))
        for low, high in cuts[ends].reshape(-1, 2):
            rows = np.concatenate([[low], own[(own > low + CLOSE) & (own < high - CLOSE)], [high]])
            seen.append((_at(rows, own, points), _at(rows, own, normals)))
    return seen


def _shortened(points: Array, normals: Array, margin: float) -> Chain | None:
    """A line without a length at both ends; None if nothing is left."""
    lengths = _lengths(points)
    low, high = margin, lengths[-1] - margin
    if high - low <= 1e-6:
        return None
    rows = np.concatenate([[low], lengths[(lengths > low) & (lengths < high)], [high]])
    return _at(rows, lengths, points), _at(rows, lengths, normals)


def _link(surface: Surface, begin: Array, end: Array, up: Array, inside: Flags) -> Chain | None:
    """The line along the surface between two of its points, without both; None if there is none."""
    across = np.cross(end - begin, up)
    if (size := np.linalg.norm(across)) < 1e-12:
        return None
    # A section through an edge at the end of the surface exists for one of the two directions of its normal
    sections = (chain for sign in (1.0, -1.0) for chain in surface.section(begin, sign * across / size, inside))
    for points, normals in sections:
        # The places of both points on the line
        places = []
        for point in (begin, end):
            steps = np.diff(points, axis=0)
            share = np.einsum("ki,ki->k", point - points[:-1], steps) / np.maximum(
                np.einsum("ki,ki->k", steps, steps), 1e-30
            )
            share = share.clip(0.0, 1.0)
            away = np.linalg.norm(points[:-1] + share[:, None] * steps - point, axis=1)
            if away.min() < 1e-7:
                places.append(int(away.argmin()) + float(share[away.argmin()]))
        if len(places) == 2:
            low, high = sorted(places)
            rows = np.arange(int(np.floor(low)) + 1, int(np.ceil(high)))[:: 1 if places[0] < places[1] else -1]
            return points[rows], normals[rows]
    return None


# -- strokes ----------------------------------------------------------------------------------------------------------


def paths_on(mesh: Any, kind: Contour | Raster, unit: str | None = None) -> list[ToolPath]:
    """The paths of a contour or a raster on a mesh."""
    surface = Surface(mesh, unit)
    paths = []
    for points, normals in kind.chains(surface):
        upright = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        path = ToolPath.through(points + kind.offset * upright, upright)
        paths.append(replace(path, notes=(*path.notes, surface.remark)) if surface.remark else path)
    return paths


def contour(mesh: Any, *, speed: float | None = None, name: str = "contour", **settings: Any) -> tuple[Stroke, ...]:
    """The edges of a face of a mesh, or the section of a mesh with a plane, as closed strokes.

    Parameters
    ----------
    mesh
        A file in metres (or in millimetres if it is longer than 10, which a note states), a :class:`pinproof.Mesh`, or
        a mesh of trimesh.
    speed, name
        The speed of the tool (m/s), and the name of the strokes; several have numbers behind it.
    **settings
        The fields of :class:`Contour`, such as ``normal=(0, 0, 1), inset=0.005``.

    Raises
    ------
    InputError
        If the face or the section does not exist, the face is not planar, or the mesh is not a surface.
    MeshError
        If the file cannot be read.
    """
    return strokes_of(name, [(path, True) for path in paths_on(mesh, Contour(**settings))], speed)


def raster(mesh: Any, *, speed: float | None = None, name: str = "raster", **settings: Any) -> tuple[Stroke, ...]:
    """Zigzag strokes along the surface of a mesh, which may be curved.

    Parameters
    ----------
    mesh, speed, name
        As for :func:`contour`.
    **settings
        The fields of :class:`Raster`, such as ``direction=(1, 0, 0), spacing=0.02``.

    Raises
    ------
    InputError
        If the mesh has no surface in the direction, it is smaller than the spacing, or it is not a surface.
    MeshError
        If the file cannot be read.
    """
    return strokes_of(name, [(path, True) for path in paths_on(mesh, Raster(**settings))], speed)
