"""Bodies that separate from obstacles in contact: how each pair separates, and the facets of meshes as obstacles.

The compiled core chooses the directions of separation (``src/core/certificate/separation.h``) and proves that a body
never approaches an obstacle along one of them (``src/core/certificate/departure.h``). Where bodies overlap, coal
measures further directions.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof._core import PairSeparation, SeparationSettings, facet_directions, separate
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.collision.checking.placed_bodies import MeasureByCoal
from pinproof.collision.geometry.bodies import Body
from pinproof.collision.geometry.hulls import Surface, bvh
from pinproof.motion import Bezier
from pinproof.spatial import Array, matrix

Indices = npt.NDArray[np.int64]

FACETS_KEPT = 256
"""Number of groups of facets whose geometry is kept."""

MOST_KEPT = 5000
"""Facets in a group; the geometry of a larger one is not kept, because it takes 1 kB a facet."""

ONE_TRIANGLE = np.array([[0, 1, 2]])

NO_DIRECTIONS = np.empty((0, 3))


def separations(
    checker: CollisionChecker, pairs: Indices, curve: Bezier, settings: SeparationSettings
) -> list[PairSeparation]:
    """Return how the bodies of pairs, each of the robot and an obstacle, separate along a curve."""
    found = separate(checker.world, pairs, curve.knots, curve.control, settings, NO_DIRECTIONS)
    for i, each in enumerate(found):
        if each.overlaps or len(each.unclear):
            # Where the bodies overlap, the core knows no nearest points.
            more = _measured(checker, int(pairs[i]), curve.control[0, 0], each)
            own = pairs[i : i + 1]
            found[i] = separate(checker.world, own, curve.knots, curve.control, settings, more)[0]
    return found


def _measured(checker: CollisionChecker, pair: int, q: Array, separation: PairSeparation) -> Array:
    """Return (m, 3) the directions from an obstacle and from its facets to a body at q (n,), computed by coal."""
    space, (a, b) = checker._placed(q), checker.indices_of(pair)
    normals = [space.measure(pair).normal] if separation.overlaps else []
    if len(separation.unclear):
        measure, at, still = MeasureByCoal(), space.root_from_body(a), matrix(checker.bodies[b].link_from_body)
        for facet in checker.bodies[b].core_shape.triangles[separation.unclear]:
            normals.append(measure.of(checker.bodies[a].geometry, at, bvh(facet, ONE_TRIANGLE), still).normal)
    return -np.array(normals)


def facet_body(body: Body, name: str, facets: Indices) -> Body:
    """Return an obstacle of some facets of an exact mesh, by their numbers in the core: a surface of the same owner."""
    make = _facet_geometry if len(facets) <= MOST_KEPT else _facet_geometry.__wrapped__
    geometry, box, surface = make(body, facets.tobytes())
    return Body(name, body.owner, body.link, geometry, body.link_from_body, box, None, surface)


@lru_cache(maxsize=FACETS_KEPT)
def _facet_geometry(body: Body, facets: bytes) -> tuple[Any, Array, Surface]:
    """Return geometry, box and surface of some facets: the pieces of a part leave the same ones in many motions."""
    corners = body.core_shape.triangles[np.frombuffer(facets, dtype=np.int64)].reshape(-1, 3)
    points, index = np.unique(corners, axis=0, return_inverse=True)
    geometry = bvh(points, index.reshape(-1, 3))
    return geometry, np.array([points.min(axis=0), points.max(axis=0)]), Surface(corners.reshape(-1, 3, 3))


def directions_to_facets(checker: CollisionChecker, pair: int, q: Array, reach: float) -> Array:
    """Return (k, 3) unit vectors from a body of the robot at q (n,) to the facets of a mesh within ``reach`` (m).

    Each is opposite to the direction along which body and facet are farthest apart, or overlap least. Empty for a mesh
    that is farther away, and for an obstacle without facets.
    """
    if checker.bodies[checker.indices_of(pair)[1]].link is not None:
        return NO_DIRECTIONS
    return np.asarray(facet_directions(checker.world, pair, q, reach))
