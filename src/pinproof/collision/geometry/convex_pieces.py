"""Covers of meshes by several convex hulls that together contain the mesh.

:func:`clusters` is for the links of robots, which are round, and for meshes that are not closed. Space is divided by
planes across x, y or z into cells C. The body S is covered, cell by cell, by the hull of the triangles of its surface,
clipped to C, and of the corners of C that are inside S.

Proof. S and C are closed and bounded, so the intersection of S and C is contained in the hull of its extreme points
(Minkowski; Rockafellar, 1970, "Convex analysis", corollary 18.5.1). An extreme point x on the surface of S is on a
triangle clipped to C. If x is not on the surface, a ball around x is inside S, so x is also extreme in C: a corner of C
inside S. All triangles of the surface are covered because the cells cover space, also for meshes that are not closed.

The choice of the planes only determines how closely the hulls fit. The measure of a cell is the volume between its
surface and its hull: the integral over the surface of the distance to the hull along the outward normal. Unlike the
volume of the hull, it decreases with every wall that is separated from a hollow body.

:func:`convex_pieces` is for watertight meshes with flat faces, beyond which the pieces hardly extend. Space is divided
by planes through the faces at the reflex edges of the mesh, such as the inner walls of a bin or the shoulder of a
bracket (B. Chazelle, 1984, "Convex partitions of polyhedra", section 3: each reflex edge is removed by one cut). The
corners of C that are used are those next to which C is filled by S.

Proof. Let K be the closure of the common interior of S and C, and x an extreme point of K. If points of the surface in
C are arbitrarily near to x, a triangle clipped to C contains x. If not, C is filled by S next to x, so x is extreme in
C too, and such a corner is used. Planes are :data:`SNAP` thick, so a gap of that width may remain uncovered inside S
between two pieces; every triangle of the surface is covered. Hence a body that touches S touches the cover, unless it
is thinner than that gap and entirely inside S.

A plane is ``[normal, offset]`` (4,): the points x with ``normal . x + offset = 0``. Points within ``snap`` metres of it
count as in the plane.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import coal
import numpy as np
import numpy.typing as npt

from pinproof._core import Shape as CoreShape
from pinproof.collision.geometry import hulls
from pinproof.collision.geometry.hulls import PointHull, Solid, box_of, bvh, cut_crossing, with_area
from pinproof.common.content_hash import cached, content_digest
from pinproof.spatial import Array

if TYPE_CHECKING:
    from collections.abc import Callable

PIECES = 12
"""Maximum number of hulls: more hulls increase the number of pairs more than they improve the fit."""

CELLS = 20
"""Maximum number of cells; some of their hulls are merged again."""

WORTH = 0.02
"""A cell is divided while its volume between surface and hull exceeds this share of the box around the mesh."""

IDLE = 0.01
"""Hulls are merged if that adds less than this share of the volume of the whole hull."""

SNUG = 1.1
"""A hull of at most this multiple of the body's volume is not divided."""

CLOSE = 1.15
"""A cover by halving of at most this multiple of the body's volume is accepted; otherwise better cuts are searched."""

SHARES = (0.15, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85)
"""Relative positions of tried cuts along a cell; as many of the largest faces across the axis are tried too."""

AROUND = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if d > (0.0, 0.0, 0.0)])
"""(13, 3) directions along which, in both senses, the extent of a surface is computed."""

ACROSS = 0.999
"""A face is across an axis if that component of its unit normal is at least this."""

FEW = 400
"""Number of triangles, spread evenly by area, that are used to choose a cut; the cover contains all triangles."""

SPACE_SAMPLES = 400
"""Number of points on the surface, spread evenly by area, at which the distance to the hull is measured."""


def clusters(corners: Array, contains: Callable[[Array], bool], pieces: int = PIECES) -> list[Array]:
    """Return the points of each hull of a cover of triangles (F, 3, 3), from 1 to ``pieces`` arrays (V_i, 3).

    ``contains`` states whether any of the points (N, 3) is inside the body; always false for a surface without one.
    """
    flat = corners.reshape(-1, 3)
    # Cells share corners, and the test whether a corner is inside the body is slow.
    known = cache(lambda *corner: contains(np.array([corner])))
    mesh_cell = _MeshCell(corners, np.array([flat.min(axis=0), flat.max(axis=0)]), known)
    enclosed = abs(float(np.linalg.det(corners - mesh_cell.box.mean(axis=0)).sum())) / 6
    if 0 < mesh_cell.hull.volume <= SNUG * enclosed:
        return [mesh_cell.hull.points]
    halves = _merged_hulls(_cut_up(mesh_cell, False, pieces), pieces)
    if sum(hull.volume for hull in halves) > CLOSE * enclosed:
        covers = [halves, _merged_hulls(_cut_up(mesh_cell, True, pieces), pieces)]
        halves = min(covers, key=lambda hulls: sum(hull.volume for hull in hulls))
    return [hull.points for hull in halves]


def _cut_up(mesh_cell: _MeshCell, closely: bool, pieces: int) -> list[PointHull]:
    """Return the hulls of the cells: cut at the best plane, or in halves, which suits round and hollow bodies."""
    # The cell with the largest volume between surface and hull is divided first.
    least = WORTH * float(np.prod(np.ptp(mesh_cell.box, axis=0)))
    number = 0
    queue = [(-mesh_cell.space, number, mesh_cell)]
    done: list[PointHull] = []
    while queue:
        cell = heapq.heappop(queue)[2]
        if len(queue) + len(done) + 1 >= max(CELLS, pieces) or cell.space <= least:
            done.append(cell.hull)
            continue
        for half in cell.cut(*(cell.best_cut if closely else cell.middle)):
            if len(half.corners) or len(half.inner):
                number += 1
                heapq.heappush(queue, (-half.space, number, half))
    return done


def _merged_hulls(hulls: list[PointHull], pieces: int) -> list[PointHull]:
    """Merge hulls whose common hull is hardly larger; it contains both."""
    idle = IDLE * PointHull(np.concatenate([hull.points for hull in hulls])).volume
    both: dict[tuple[int, int], tuple[float, PointHull]] = {}
    alive = dict(enumerate(hulls))
    while len(alive) > 1:
        pairs = list(combinations(alive, 2))
        # Hulls are near if the boxes around them meet.
        boxes = {i: hull.box for i, hull in alive.items()}
        near = [(i, j) for i, j in pairs if (boxes[i][0] <= boxes[j][1]).all() and (boxes[j][0] <= boxes[i][1]).all()]
        if not near and len(alive) <= pieces:
            break
        for i, j in near or pairs:
            if (i, j) not in both:
                hull = PointHull(np.concatenate([alive[i].points, alive[j].points]))
                both[i, j] = hull.volume - alive[i].volume - alive[j].volume, hull
        # The two hulls that add the least volume when they are joined.
        i, j = min(near or pairs, key=lambda pair: both[pair][0])
        more, hull = both[i, j]
        if more > idle and len(alive) <= pieces:
            break
        del alive[i], alive[j]
        alive[max(i, j, *alive, *map(max, both)) + 1] = hull
    return list(alive.values())


@dataclass
class _MeshCell:
    """A box (2, 3) of space and the triangles (F, 3, 3) clipped to it."""

    corners: Array
    box: Array
    contains: Callable[[float, float, float], bool] = field(repr=False)

    @cached_property
    def inner(self) -> Array:
        """The corners of the cell that are inside the body."""
        inside = [corner for corner in product(*self.box.T.tolist()) if self.contains(*corner)]
        return np.array(inside).reshape(-1, 3)

    @cached_property
    def points(self) -> Array:
        """The points whose hull is computed."""
        return np.unique(np.concatenate([self.corners.reshape(-1, 3), self.inner]), axis=0)

    @cached_property
    def hull(self) -> PointHull:
        """The hull that covers the body in this cell."""
        return PointHull(self.points)

    @property
    def middle(self) -> tuple[int, float]:
        """The axis of the longest side, and the position of its middle."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        axis = int((high - low).argmax())
        return axis, float(low[axis] + high[axis]) / 2

    @cached_property
    def best_cut(self) -> tuple[int, float]:
        """The axis and position of the cut with the smallest remaining volume; the middle if no cut is better."""
        # A subset of the triangles is sufficient: spread by area, and those of largest extent.
        corners, _, areas = with_area(self.corners)
        if len(corners) > FEW:
            extent = corners.reshape(-1, 3) @ AROUND.T
            farthest = np.concatenate([extent.argmax(axis=0), extent.argmin(axis=0)]) // 3
            corners = corners[np.union1d(_spread(areas, FEW), farthest)]
        few = _MeshCell(corners, self.box, lambda *_: False)
        best, least = self.middle, self.space * (1 - 1e-9)
        for axis in range(3):
            for place in _places(self.corners, axis):
                left = sum(half.space for half in few.cut(axis, place))
                if left < least:
                    best, least = (axis, place), left * (1 - 1e-9)
        return best

    @cached_property
    def space(self) -> float:
        """The volume (m^3) between surface and hull, as defined above; 0 if the hull is flat."""
        corners, normals, areas = with_area(self.corners)
        # A face in a wall of the cell with its normal inward belongs to the part of the body in the next cell.
        for axis in range(3):
            low, high = ((corners[:, :, axis] == wall).all(axis=1) for wall in self.box[:, axis])
            areas = np.where((low & (normals[:, axis] > 0)) | (high & (normals[:, axis] < 0)), 0.0, areas)
        total = float(areas.sum())
        if total == 0 or len(self.hull.planes) == 0:
            return 0.0
        chosen, times = np.unique(_spread(areas, SPACE_SAMPLES), return_counts=True)
        distance = self.hull.space(corners[chosen].mean(axis=1), normals[chosen])
        return float(np.minimum(distance, np.linalg.norm(np.ptp(self.points, axis=0))) @ times) * total / SPACE_SAMPLES

    def cut(self, axis: int, place: float) -> tuple[_MeshCell, _MeshCell]:
        """Return the two cells on both sides of a plane."""
        below, above = self.box.copy(), self.box.copy()
        below[1, axis] = above[0, axis] = place
        lower, upper = _split(self.corners, axis, place)
        return _MeshCell(lower, below, self.contains), _MeshCell(upper, above, self.contains)


def _spread(areas: Array, count: int) -> npt.NDArray[np.int64]:
    """Return the faces at ``count`` points that are spread evenly over the areas (F,)."""
    ends = np.cumsum(areas)
    here = np.searchsorted(ends, (np.arange(count) + 0.5) * ends[-1] / count)
    return np.minimum(here, len(areas) - 1)


def _places(corners: Array, axis: int) -> list[float]:
    """Return the positions of cuts to try along an axis."""
    low, high = float(corners[:, :, axis].min()), float(corners[:, :, axis].max())
    faces, normals, areas = with_area(corners)
    across = np.abs(normals[:, axis]) > ACROSS
    planes, index = np.unique(faces[across, 0, axis], return_inverse=True)
    largest = np.argsort(-np.bincount(index.ravel(), areas[across], len(planes)), kind="stable")
    tried = {*(low + share * (high - low) for share in SHARES), *planes[largest[: len(SHARES)]].tolist()}
    return sorted(place for place in tried if low < place < high)


def _split(corners: Array, axis: int, place: float) -> tuple[Array, Array]:
    """Return the triangles below and above a plane, cut where they cross it; those in it belong to both."""
    heights = corners[:, :, axis] - place
    lower, upper = cut_crossing(corners, heights)
    # Rounding must not move a corner beyond the plane.
    lower[:, :, axis], upper[:, :, axis] = np.minimum(lower[:, :, axis], place), np.maximum(upper[:, :, axis], place)
    below, above = (heights <= 0).all(axis=1), (heights >= 0).all(axis=1)
    return np.concatenate([corners[below], lower]), np.concatenate([corners[above], upper])


def _heights(points: Array, plane: Array, snap: float) -> Array:
    heights = points @ plane[:3] + plane[3]
    return np.where(np.abs(heights) <= snap, 0.0, heights)


def split_triangles(corners: Array, plane: Array, snap: float) -> tuple[Array, Array]:
    """Return the triangles below and above a plane, cut where they cross it; those in it, where the material is."""
    h = _heights(corners, plane, snap)
    below, above = (h <= 0).all(axis=1), (h >= 0).all(axis=1)
    inside_plane = below & above
    if inside_plane.any():
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        up = normals @ plane[:3] > 0  # outward normal up: the material is below
        below, above = below & ~(inside_plane & ~up), above & ~(inside_plane & up)
    # Triangles on one side are kept whole, and the others are cut.
    lower, upper = corners[below & (~above | inside_plane)], corners[above & (~below | inside_plane)]
    cut_lower, cut_upper = cut_crossing(corners, h)
    return _different_corners(np.concatenate([lower, cut_lower])), _different_corners(
        np.concatenate([upper, cut_upper])
    )


def _different_corners(corners: Array) -> Array:
    """Return the triangles with three different corners; a corner in the plane of a cut gives others."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return corners[(a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1)]


def split_edges(edges: Array, planes: Array, plane: Array, snap: float) -> list[tuple[Array, Array]]:
    """Return the edges below and above a plane, cut where they cross it; edges in the plane are not reflex any more."""
    h = _heights(edges, plane, snap)
    halves = []
    for sign in (-1.0, 1.0):
        g = h * sign
        some = (g > 0).any(axis=1)
        kept, g = edges[some].copy(), g[some]
        for end, other in ((0, 1), (1, 0)):
            out = g[:, end] < 0
            share = (g[out, other] / (g[out, other] - g[out, end]))[:, None]
            kept[out, end] = kept[out, other] + share * (kept[out, end] - kept[out, other])
        halves.append((kept, planes[some]))
    return halves


def split_cell(faces: list[Array], plane: Array, snap: float) -> tuple[list[Array], list[Array]]:
    """Return the faces of a convex cell below and above a plane; the cross section is a face of both."""
    halves: tuple[list[Array], list[Array]] = ([], [])
    cap: list[Array] = []
    for polygon in faces:
        h = _heights(polygon, plane, snap)
        cap += list(polygon[h == 0])
        parts: tuple[list[Array], list[Array]] = ([], [])
        for i in range(len(polygon)):
            a, b, ha, hb = polygon[i - 1], polygon[i], h[i - 1], h[i]
            if ha * hb < 0:
                crossing = a + ha / (ha - hb) * (b - a)
                cap.append(crossing)
                parts[0].append(crossing)
                parts[1].append(crossing)
            if hb <= 0:
                parts[0].append(b)
            if hb >= 0:
                parts[1].append(b)
        for half, part, there in zip(halves, parts, ((h < 0).any(), (h > 0).any()), strict=True):
            if there and len(part) > 2:
                half.append(np.array(part))
    if len(cap) > 2 and all(halves):
        # The corners of the cross section, in their order around it.
        points = np.unique(cap, axis=0)
        off = points - points.mean(axis=0)
        one = off[np.linalg.norm(off, axis=1).argmax()]
        points = points[np.argsort(np.arctan2(off @ np.cross(plane[:3], one), off @ one))]
        halves[0].append(points)
        halves[1].append(points)
    return halves


SNAP = 2e-7
"""Share of the mesh's diagonal within which a point lies in a plane: files such as STL hold single precision."""

NUDGE = 1e-6
"""Share of the mesh's diagonal by which a corner is moved into its cell to see whether the cell is filled there."""

REFLEX = 1e-3
"""An edge is reflex where the sine of the angle between its faces is larger than this (0.06 degrees)."""

PLANES_TRIED = 8
"""Planes through faces that are tried for each cut: those with the longest reflex edges."""

AT = (
    np.array([(1, 1, 1), (18, 1, 1), (1, 18, 1), (1, 1, 18), (9, 9, 2), (9, 2, 9), (2, 9, 9)])
    / np.array([3, 20, 20, 20, 20, 20, 20])[:, None]
)
"""(7, 3) the barycentric coordinates of the samples of a triangle."""

Samples = tuple[Array, Array]
"""Points (N, 3) of a surface and the outward unit normals (N, 3) there."""

SAMPLES = 4000
"""Points on the surface of the cover at which its excess is measured."""


@dataclass(frozen=True, eq=False)
class ConvexPieces:
    """A cover of a mesh: the points (V_i, 3) of each piece, and by how much (m) it extends beyond the mesh at most."""

    points: tuple[Array, ...]
    excess: float


def convex_pieces(solid: Solid, *, most: int, tolerance: float) -> ConvexPieces | None:
    """Cover a watertight mesh by at most ``most`` convex pieces.

    A cell is not cut further if its hull is nowhere farther than ``tolerance`` (m) from its surface. Returns None for a
    mesh with more faces at reflex edges than 1.5 times ``most``, such as a bowl, which would need many more pieces.
    """
    # Overlapping bodies are covered one by one, because no edges exist where their surfaces intersect.
    corners = solid.corners
    size = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    cells = []
    for part in solid.solids if len(solid.solids) <= most else (corners,):
        core = CoreShape.mesh(part.reshape(-1, 9), np.empty((0, 3)), solid.watertight, box_of(part))
        space = _Space(core.contains, SNAP * size, NUDGE * size, size)
        cells.append(_ConvexCell(space, part, _box(part), *_reflex_edges(part, SNAP * size)))
    # The space of a hull takes seconds for a mesh of 100,000 triangles, so the planes are counted first.
    if sum(len(cell.reflex_planes()) for cell in cells) > 1.5 * most and (
        sum(len(each.reflex_planes()) for each in cells if each.hull.has_space(*each.samples, tolerance)) > 1.5 * most
    ):
        return None
    hulls = _joined(_cells(cells, most, tolerance), tolerance)
    return ConvexPieces(tuple(hull.points for hull in hulls), _excess(hulls, corners, solid.contains))


def kept_convex_pieces(solid: Solid, *, most: int, tolerance: float) -> ConvexPieces | None:
    """:func:`convex_pieces` from the cache on disk: they take a second for a bin, the entry takes a millisecond."""

    def make() -> dict[str, npt.NDArray[Any]]:
        cover = convex_pieces(solid, most=most, tolerance=tolerance)
        if cover is None:
            return {}
        return {"excess": np.array(cover.excess), **{f"{k:04d}": points for k, points in enumerate(cover.points)}}

    key, code = content_digest(solid.content(), float(most), tolerance), (__file__, hulls.__file__)
    found = dict(cached("convex pieces", key, make, code=code, libraries=("scipy", "coal")))
    excess = found.pop("excess", None)
    return None if excess is None else ConvexPieces(tuple(found[name] for name in sorted(found)), float(excess))


@dataclass(frozen=True, eq=False)
class _Space:
    contains: Callable[[Array], npt.NDArray[np.bool_]]
    snap: float
    nudge: float
    size: float


def _cells(given: Sequence[_ConvexCell], most: int, tolerance: float) -> list[tuple[PointHull, Samples]]:
    """Return the hulls of the cells, each with samples of its surface; the cell of the largest cost is cut first."""
    number = len(given)
    queue = [(-cell.cost, k, cell) for k, cell in enumerate(given)]
    heapq.heapify(queue)
    done: list[_ConvexCell] = []
    while queue:
        cell = heapq.heappop(queue)[2]
        if cell.deepest <= tolerance:
            done.append(cell)
            continue
        if len(queue) + len(done) + 1 >= most:
            done += [cell, *(other for _, _, other in queue)]
            break
        # A half without surface and without filled corners is empty space.
        for half in cell.best_cut():
            if not half.empty:
                number += 1
                heapq.heappush(queue, (-half.cost, number, half))
    return [(cell.hull, cell.samples) for cell in done]


def _joined(cells: list[tuple[PointHull, Samples]], tolerance: float) -> list[PointHull]:
    """Join two pieces while their common hull is nowhere farther than ``tolerance`` (m) from the surface."""
    alive = dict(enumerate(cells))
    number = len(cells)
    common: dict[tuple[int, int], tuple[float, PointHull] | None] = {}  # volume that is added; None: does not fit
    while True:
        for i, j in combinations(alive, 2):
            if (i, j) in common:
                continue
            (one, samples_one), (other, samples_other) = alive[i], alive[j]
            hull = PointHull(np.concatenate([one.points, other.points]))
            more = hull.volume - one.volume - other.volume
            # Two flat pieces apart may have no surface between them, so the volume has to agree as well.
            area = max(float(np.prod(np.ptp(hull.points, axis=0))) ** (2 / 3), 1e-12)
            fits = more <= tolerance * area
            fits = fits and not any(hull.has_space(*samples, tolerance) for samples in (samples_one, samples_other))
            common[i, j] = (more, hull) if fits else None
        fitting = [(found[0], pair) for pair, found in common.items() if found is not None]
        if not fitting:
            return [hull for hull, _ in alive.values()]
        i, j = min(fitting)[1]
        hull = common[i, j][1]  # type: ignore[index]  # it fits
        (points, normals), (more_points, more_normals) = alive.pop(i)[1], alive.pop(j)[1]
        common = {pair: found for pair, found in common.items() if not {i, j} & {*pair}}
        number += 1
        alive[number] = hull, (np.concatenate([points, more_points]), np.concatenate([normals, more_normals]))


@dataclass(eq=False)
class _ConvexCell:
    """A convex cell, the triangles (F, 3, 3) cut to it, and the reflex edges (E, 2, 3) in it."""

    space: _Space = field(repr=False)
    corners: Array
    faces: list[Array]
    edges: Array
    planes: Array
    """(E, 2, 4) the planes of the two faces at each reflex edge."""

    @cached_property
    def filled(self) -> Array:
        """The corners of the cell next to which it is filled."""
        corners = np.unique(np.concatenate([np.empty((0, 3)), *self.faces]), axis=0)
        inward = corners.mean(axis=0) - corners
        lengths = np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-300)
        nudged = corners + inward / lengths * np.minimum(self.space.nudge, lengths / 2)
        return np.asarray(corners[self.space.contains(nudged)])

    @property
    def empty(self) -> bool:
        return len(self.corners) == 0 and len(self.filled) == 0

    @cached_property
    def hull(self) -> PointHull:
        return PointHull(np.unique(np.concatenate([self.corners.reshape(-1, 3), self.filled]), axis=0))

    @cached_property
    def samples(self) -> Samples:
        """Points of the surface, seven a triangle, and the outward normals there."""
        corners, normals, _ = with_area(self.corners)
        points = np.einsum("ks,fsx->kfx", AT, corners)
        return points.reshape(-1, 3), np.tile(normals, (len(AT), 1))

    @cached_property
    def _space(self) -> Array:
        return self.hull.space(*self.samples)

    @cached_property
    def deepest(self) -> float:
        """The largest distance (m) between surface and hull."""
        return float(self._space.max(initial=0.0))

    @cached_property
    def cost(self) -> float:
        """The integral over the surface of the distance to the hull (m^3)."""
        areas = np.tile(with_area(self.corners)[2], len(AT)) / len(AT)
        return float(areas @ np.minimum(self._space, self.space.size))

    def best_cut(self) -> tuple[_ConvexCell, _ConvexCell]:
        """Return the two halves of the cut with the smallest remaining cost."""
        best: tuple[float, tuple[_ConvexCell, _ConvexCell]] | None = None
        # Planes through the faces with the longest reflex edges are tried; without one, middles.
        for plane in self.reflex_planes()[:PLANES_TRIED] or self._middles():
            halves = self._cut(plane)
            if any(half.hull.volume >= self.hull.volume * (1 - 1e-9) for half in halves):
                continue  # nothing is cut off
            cost = sum(half.cost for half in halves)
            if best is None or cost < best[0]:
                best = cost, halves
        return best[1] if best is not None else self._cut(self._middles()[0])

    def reflex_planes(self) -> list[Array]:
        """Return the planes of the faces at reflex edges, in decreasing order of the length of their edges."""
        if len(self.edges) == 0:
            return []
        lengths = np.linalg.norm(self.edges[:, 1] - self.edges[:, 0], axis=1)
        planes, weights = self.planes.reshape(-1, 4), np.repeat(lengths, 2)
        scale = np.array([1e3, 1e3, 1e3, 1e5])
        _, first, group = np.unique(np.round(planes * scale), axis=0, return_index=True, return_inverse=True)
        order = np.argsort(-np.bincount(group.ravel(), weights), kind="stable")
        return [planes[first[k]] for k in order]

    def _middles(self) -> list[Array]:
        """Return planes across the axes through the middle of the hull, across its longest side first."""
        low, high = self.hull.points.min(axis=0), self.hull.points.max(axis=0)
        made = []
        for axis in np.argsort(low - high):
            normal = np.zeros(3)
            normal[axis] = 1.0
            made.append(np.append(normal, -(low[axis] + high[axis]) / 2))
        return made

    def _cut(self, plane: Array) -> tuple[_ConvexCell, _ConvexCell]:
        """Return the cells below and above a plane."""
        snap = self.space.snap
        lower, upper = split_triangles(self.corners, plane, snap)
        faces = split_cell(self.faces, plane, snap)
        edges = split_edges(self.edges, self.planes, plane, snap)
        return _ConvexCell(self.space, lower, faces[0], *edges[0]), _ConvexCell(self.space, upper, faces[1], *edges[1])


def _box(corners: Array) -> list[Array]:
    """Return the faces of the box around triangles, as polygons."""
    (low, high), faces = box_of(corners), []
    around = [(False, False), (True, False), (True, True), (False, True)]
    for axis, end in product(range(3), (False, True)):
        at_high = np.full((4, 3), end)
        at_high[:, [(axis + 1) % 3, (axis + 2) % 3]] = around
        faces.append(np.where(at_high, high, low))
    return faces


def _reflex_edges(corners: Array, snap: float) -> tuple[Array, Array]:
    """Return the edges (E, 2, 3) at which the surface is not convex, and the planes (E, 2, 4) of their faces."""
    corners, normals, _ = with_area(corners)
    planes = np.column_stack([normals, -np.einsum("fi,fi->f", normals, corners[:, 0])])
    places, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    # Half-edge 3 f + k starts at corner k of triangle f; its twin runs the other way in the neighbouring triangle.
    start = index.reshape(-1, 3)
    end = np.roll(start, -1, axis=1)
    key, twin = (start * len(places) + end).ravel(), (end * len(places) + start).ravel()
    keys, last = np.unique(key[::-1], return_index=True)
    half = len(key) - 1 - last  # where triangles overlap, the last of them counts
    place = np.minimum(np.searchsorted(keys, twin[half]), len(keys) - 1)
    half, back = np.compress((keys[place] == twin[half]) & (key[half] < twin[half]), [half, half[place]], axis=1)
    order = np.argsort(half)
    (f, k), (g, m) = np.divmod(half[order], 3), np.divmod(back[order], 3)
    ends = np.stack([corners[f, k], corners[f, (k + 1) % 3]], axis=1)
    along = ends[:, 1] - ends[:, 0]
    sine = np.einsum("ei,ei->e", normals[g], np.cross(normals[f], along)) / np.linalg.norm(along, axis=1)
    height = np.einsum("ei,ei->e", planes[f, :3], corners[g, (m + 2) % 3]) + planes[f, 3]
    reflex = (sine > REFLEX) & (height > snap)
    return ends[reflex], np.stack([planes[f], planes[g]], axis=1)[reflex]


def _excess(hulls: list[PointHull], corners: Array, contains: Callable[[Array], bool]) -> float:
    """Return how far (m) the hulls extend beyond the mesh, at points spread evenly over their surfaces."""
    triangles, _, areas = with_area(np.concatenate([np.empty((0, 3, 3)), *(hull.triangles for hull in hulls)]))
    if len(triangles) == 0:
        return 0.0
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(triangles), SAMPLES, p=areas / areas.sum())
    shares = rng.dirichlet(np.ones(3), SAMPLES)
    points = np.concatenate([np.einsum("nk,nkd->nd", shares, triangles[chosen]), triangles.mean(axis=1)])
    # The distance of each point from the mesh; a point inside of it is no excess.
    surface = bvh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    point, here = coal.Sphere(1e-9), coal.Transform3s.Identity()
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    distances = np.zeros(len(points))
    for i, at in enumerate(points):
        result.clear()
        distances[i] = coal.distance(point, coal.Transform3s(np.eye(3), at), surface, here, request, result)
    for i in np.argsort(-distances).tolist():
        if distances[i] <= 1e-6 or not contains(points[i][None]):
            return max(float(distances[i]), 0.0)
    return 0.0
