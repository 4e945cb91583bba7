"""The robot itself and bodies to be picked, which are removed from depth images and grids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, overload

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.checking.checker import CollisionChecker
from pinproof.collision.geometry.bodies import Body, CellsBody, shape_bodies
from pinproof.collision.geometry.depth_image import DepthPiece, DepthView, RemovedBody
from pinproof.collision.geometry.inner_shapes import extremes
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.shapes import Obstacle
from pinproof.common.validation import require_positive
from pinproof.errors import InputError
from pinproof.spatial import Array, matrix

SEEN_THROUGH = 0.5
"""Largest share of the pixels on a body that may measure surfaces behind it; more show that the body is elsewhere."""

JOINED = 1e-6
"""Metres between two convex pieces of a body up to which a ray that leaves one enters the other."""


class _RayCrossing(NamedTuple):
    """Where the rays through the pixels of a window of the image cross a convex piece."""

    window: tuple[slice, slice]
    enter: Array  # the smallest depth at which a ray through a corner of the pixel enters it; inf where none does
    leave: Array  # the smallest depth at which such a ray leaves it
    # The largest depth at which a pixel that measures the piece may do so; -inf where no ray meets it. It is half the
    # depth of the piece, because its pose is not exact; what is measured behind it may be its support.
    last: Array
    whole: npt.NDArray[np.bool_]  # whether all rays cross it: it covers the pixel, because both are convex


def remove_robot(
    grid: OccupancyGrid, checker: CollisionChecker, q: npt.ArrayLike, *, padding: float | None = None
) -> OccupancyGrid:
    """Return a grid without the robot itself, which the camera sees and which hides the space behind it.

    Cells that are entirely within ``padding`` of a link or attached object become free. Anything else in them is no
    longer an obstacle; the record states the number of cells.

    Parameters
    ----------
    grid
        The grid, in the frame of the robot's root.
    checker
        The robot with its attached objects; its scene is not used.
    q
        (n,) its configuration when the image was taken.
    padding
        Metres. Default: the margin of the checker and the diagonal of a cell, so that the robot is not in contact with
        the grid at q.

    Raises
    ------
    InputError
        If a link is an exact mesh, or the padding is negative.
    """
    if not isinstance(grid, OccupancyGrid):
        raise InputError(f"remove_robot takes an OccupancyGrid, not {type(grid).__name__}")
    if padding is None:
        padding = float(checker.margins.max(initial=checker.margin)) + math.sqrt(3) * grid.voxel + checker.rounding
    placed = checker._placed(checker.group.configuration(q))
    moving = [(i, body) for i, body in enumerate(checker.bodies) if body.link is not None]
    pieces = [_piece(body, placed.root_from_body(i)) for i, body in moving]
    require_positive("padding", padding, zero=True)
    return grid.cleared(pieces, padding, f"within {padding * 1e3:.4g} mm of {checker.group.robot.name}")


@overload
def remove_body(sensed: DepthView, body: Obstacle) -> DepthView: ...
@overload
def remove_body(sensed: OccupancyGrid, body: Obstacle) -> OccupancyGrid: ...
def remove_body(sensed: DepthView | OccupancyGrid, body: Obstacle) -> DepthView | OccupancyGrid:
    """Return a view or a grid without a body, such as the one to be picked, which is then not an obstacle.

    In a grid, the cells that are entirely in the body become free. Cells that it covers only in part stay, because they
    may also hold its support or another body.

    A view also shows which of these hold nothing else: a pixel that the body covers, and that measures it, now looks
    through it, and everything else in this pixel is behind the place where the ray leaves the body. A pixel that the
    body covers only in part keeps its bound: what is beside the outline of the body, or hidden behind it, may be in it.
    So cells around the visible faces of the body become free. Those that it hides, that it shares with its support, or
    that are at its outline stay; another view may show them.

    Parameters
    ----------
    sensed
        The view or the grid.
    body
        The body at its pose in the frame of the robot's root.

    Raises
    ------
    InputError
        If the body is not covered by convex pieces, the camera is inside it, or the view shows that it is not at its
        pose.
    """
    if not isinstance(body, Obstacle) or not isinstance(sensed, DepthView | OccupancyGrid):
        given = f"{type(sensed).__name__} and {type(body).__name__}"
        raise InputError(f"remove_body takes a DepthView or an OccupancyGrid and an Obstacle, not {given}")
    parts = shape_bodies(body.name, None, body.shape, body.pose)
    if parts and isinstance(parts[0], CellsBody):
        parts = parts[0].as_boxes()
    pieces = tuple(_piece(part, matrix(part.link_from_body)) for part in parts)
    if isinstance(sensed, OccupancyGrid):
        return sensed.cleared(pieces, 0.0, f"in {body.name}")
    nearest, farthest = sensed.nearest.copy(), sensed.farthest.copy()
    count = _look_through(sensed, body.name, parts, nearest, farthest)
    return replace(
        sensed,
        nearest=nearest,
        farthest=farthest,
        removed=(*sensed.removed, RemovedBody(body.name, pieces)),
        record=(*sensed.record, f"{body.name} is removed from the image: {count} pixels show it"),
    )


def _piece(body: Body, root_from_body: Array) -> DepthPiece:
    if body.support is None:
        raise InputError(
            f"{body.name} is not convex and bounded; use link_meshes='hull' for links, a Box or Mesh(hull=True) for "
            "other bodies"
        )
    return DepthPiece(body.core_shape, np.asarray(np.linalg.inv(root_from_body), dtype=float))


def _look_through(view: DepthView, name: str, parts: Sequence[Body], nearest: Array, farthest: Array) -> int:
    """Change the bounds of depths (height, width) where they show a body; return the number of pixels."""
    camera_from_root = view.root_from_camera.inverse()
    crossings = [_crossing(view, part, camera_from_root) for part in parts]
    # Pixels that measure the body, those that it covers in part, and those that measure what is behind it.
    tolerance = np.broadcast_to(view.uncertainty, view.depth.shape)
    first, last = view.depth - tolerance, view.depth + tolerance
    shown, partly = np.zeros(view.depth.shape, dtype=bool), np.zeros(view.depth.shape, dtype=bool)
    behind = np.zeros(view.depth.shape, dtype=bool)
    for crossing in crossings:
        at = crossing.window
        measured = view.depth[at] > 0
        inside = measured & (last[at] >= crossing.enter) & (first[at] <= crossing.last)
        shown[at] |= inside & crossing.whole
        partly[at] |= inside & ~crossing.whole
        behind[at] |= measured & crossing.whole & (first[at] > crossing.last)
        nearest[at] = np.where(inside & crossing.whole, np.maximum(nearest[at], crossing.leave), nearest[at])
    for _ in crossings[1:]:  # a ray that leaves one piece may enter the next
        for crossing in crossings:
            at = crossing.window
            enters = shown[at] & crossing.whole & (nearest[at] >= crossing.enter - JOINED)
            nearest[at] = np.where(enters, np.maximum(nearest[at], crossing.leave), nearest[at])
    behind &= ~shown
    # Where most pixels see through the body, it is not there.
    if np.count_nonzero(behind) > SEEN_THROUGH * np.count_nonzero(behind | shown):
        raise InputError(
            f"{name!r} is not where it is stated to be: {np.count_nonzero(behind)} pixels measure surfaces "
            f"behind it, {np.count_nonzero(shown)} its own; check its pose and camera_pose"
        )
    partly &= ~shown
    farthest[shown | partly] = 0.0
    return int(np.count_nonzero(shown | partly))


def _crossing(view: DepthView, body: Body, camera_from_root: pin.SE3) -> _RayCrossing:
    """Return where rays cross a convex body, by the planes of a polytope inside it in the frame of the camera."""
    from scipy.spatial import ConvexHull

    camera_from_body = camera_from_root * body.link_from_body
    points = extremes(body.support, with_ball=True) if body.support is not None else body.witnesses
    hull = ConvexHull(points @ camera_from_body.rotation.T + camera_from_body.translation)
    corners = hull.points[hull.vertices]
    if (hull.equations[:, 3] <= 0).all():
        raise InputError(f"the camera is inside {body.owner!r}; check camera_pose and the pose of the body")
    # The window of the image that can show the body.
    camera = view.intrinsics
    rows, columns = slice(0, camera.height), slice(0, camera.width)
    if (corners[:, 2] > 0).all():
        u, v = (
            focal * corners[:, axis] / corners[:, 2] + center
            for axis, focal, center in ((0, camera.fx, camera.cx), (1, camera.fy, camera.cy))
        )
        columns, rows = (
            slice(*np.clip([np.floor(x.min()) - 1, np.ceil(x.max()) + 2], 0, size).astype(int).tolist())
            for x, size in ((u, camera.width), (v, camera.height))
        )
    x, y = np.meshgrid(
        (np.arange(columns.start, columns.stop + 1) - 0.5 - camera.cx) / camera.fx,
        (np.arange(rows.start, rows.stop + 1) - 0.5 - camera.cy) / camera.fy,
    )
    enter, leave = ray_depths(hull.equations, np.stack([x, y, np.ones_like(x)], axis=-1))
    hit = (enter <= leave) & (leave > 0)
    ends = [slice(None, -1), slice(1, None)]
    four = [(i, j) for i in ends for j in ends]
    return _RayCrossing(
        (rows, columns),
        np.minimum.reduce([np.where(hit, enter, np.inf)[at] for at in four]),
        np.minimum.reduce([np.where(hit, leave, np.inf)[at] for at in four]),
        np.maximum.reduce([(np.where(hit, enter, -np.inf) / 2 + np.where(hit, leave, -np.inf) / 2)[at] for at in four]),
        np.logical_and.reduce([hit[at] for at in four]),
    )


def ray_depths(planes: Array, rays: Array) -> tuple[Array, Array]:
    """Return the depths (...) at which rays (..., 3) with z = 1 enter and leave a polytope of planes (P, 4).

    A ray misses the polytope if it would enter it behind the depth at which it leaves it.
    """
    slope, offset = rays @ planes[:, :3].T, planes[:, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = -offset / slope
    beside = ((slope == 0) & (offset > 0)).any(axis=-1)
    enter = np.where(slope < 0, depth, -np.inf).max(axis=-1)
    leave = np.where(slope > 0, depth, np.inf).min(axis=-1)
    return np.where(beside, np.inf, enter), np.where(beside, -np.inf, leave)
