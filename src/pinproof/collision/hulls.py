"""Convex hulls for coal, without the ways in which asking for one ends the interpreter."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError

__all__ = ["bvh", "convex_hull", "hull_of_any", "refuse_flat"]

Array = npt.NDArray[np.float64]

FLAT = 1e-6
"""Metres. Points thinner than this in some direction have no hull: Qhull ends the interpreter on them."""

FLAT_SHARE = 1e-7
"""The same as a share of the longest side: Qhull was seen to crash at 1e-8 of it (1 um of 100 m), to work at 1e-7."""

THICKENING = 10.0
"""How many times the least thickness that has a hull flat points are thickened to: 1e-5 m for all below 10 m."""


def convex_hull(points: Array, what: str) -> Any:
    """The coal shape of the hull of ``points`` (V, 3); ``what`` names them in errors.

    Raises
    ------
    InputError
        If they are flat, or Qhull or coal gives up on them.
    """
    refuse_flat(points, what)
    # buildConvexRepresentation would only re-label a mesh as convex and miss collisions; this is the hull (Qhull).
    surface = bvh(points, np.array([[0, 1, 2]]))
    try:
        surface.buildConvexHull(True, "Qt")
    except RuntimeError as error:
        raise InputError(f"{what} has no hull that coal can use ({error})") from error
    return surface.convex


def hull_of_any(points: Array) -> Any:
    """The coal shape of a convex body that holds all ``points`` (V, 3), flat or not.

    Their hull; where they are flat that of the box around them along their principal axes, thickened to
    :data:`THICKENING` times what has a hull; that box too where Qhull gives up.
    """
    try:
        return convex_hull(points, "a cluster")
    except InputError:
        centre, axes, low, high = _principal_box(points)
    least = THICKENING * max(FLAT, FLAT_SHARE * float((high - low).max()))
    grow = np.maximum(least - (high - low), 0.0) / 2
    corners = np.array(np.meshgrid(*zip(low - grow, high + grow, strict=True))).reshape(3, 8).T
    return convex_hull(centre + corners @ axes, "a cluster")


def refuse_flat(points: Array, what: str) -> None:
    """Refuse points (V, 3) that have no hull.

    Raises
    ------
    InputError
        If they lie in a plane, nearly so, or are too few.
    """
    if len(points) == 0:
        raise InputError(f"{what} is empty, so it has no hull")
    _, _, low, high = _principal_box(points)
    sides = high - low
    if len(points) < 4 or sides.min() < max(FLAT, FLAT_SHARE * float(sides.max())):
        raise InputError(f"{what} is flat ({sides.min():.1g} m thick), so it has no hull")


def bvh(vertices: Array, triangles: npt.NDArray[np.int64]) -> Any:
    """A coal mesh of triangles."""
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(vertices))
    model.addVertices(np.ascontiguousarray(vertices))
    model.addTriangles(np.ascontiguousarray(triangles, dtype=np.int64))
    model.endModel()
    return model


def _principal_box(points: Array) -> tuple[Array, Array, Array, Array]:
    """Centre (3,), axes as rows (3, 3), and the lowest and highest coordinates along them: the points' own box."""
    centre = points.mean(axis=0)
    # The right singular vectors of the centred points are the eigenvectors of their 3 x 3 scatter; QR keeps accuracy.
    triangle = np.linalg.qr(np.concatenate([points - centre, np.zeros((3, 3))]), mode="r")
    axes = np.linalg.svd(triangle)[2]
    along = (points - centre) @ axes.T
    return centre, axes, along.min(axis=0), along.max(axis=0)
