"""The bodies of robot links: what a URDF says is to be collided with, its meshes as the caller wants them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.bodies import PART, Body, hull_body, shape_body, triangles_of
from pinproof.collision.decomposition import clusters
from pinproof.collision.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from pinproof.collision.solid import Solid
from pinproof.description import LinkGeometry
from pinproof.description.meshes import read_mesh, resolved
from pinproof.errors import InputError, MeshError, UnknownNameError

__all__ = ["LinkMeshes", "detail_bodies", "link_bodies", "meshes_of"]

LinkMeshes = Literal["hull", "mesh", "decomposed"]
"""How a link's mesh is collided with: as its convex hull, as its triangles, or as several hulls that cover it."""

KINDS: dict[str, type[Box] | type[Sphere] | type[Cylinder] | type[Capsule]] = {
    "box": Box,
    "sphere": Sphere,
    "cylinder": Cylinder,
    "capsule": Capsule,
}

COVERS_KEPT = 64
"""Meshes whose decomposition is kept: a robot's, for the next checker of the same robot."""

DEFAULT = "*"
"""The key of a mapping that speaks for every link without a key of its own."""


def meshes_of(links: Iterable[str], link_meshes: LinkMeshes | Mapping[str, LinkMeshes]) -> dict[str, LinkMeshes]:
    """How each link's meshes are collided with, from one word for all or a mapping of links; ``"*"`` is the others.

    Raises
    ------
    UnknownNameError
        For a word or a link that does not exist.
    """
    links = tuple(links)
    told: Mapping[str, LinkMeshes] = {DEFAULT: link_meshes} if isinstance(link_meshes, str) else link_meshes
    if not isinstance(told, Mapping):
        raise InputError(f"link_meshes = {link_meshes!r} is neither a word nor a mapping of links to words")
    for link, how in told.items():
        if how not in get_args(LinkMeshes):
            raise UnknownNameError("kind of link meshes", how, get_args(LinkMeshes))
        if link != DEFAULT and link not in links:
            raise UnknownNameError("link", link, links, "link_meshes")
    return {link: told.get(link, told.get(DEFAULT, "hull")) for link in links}


def link_bodies(geometry: LinkGeometry, how: LinkMeshes) -> list[Body]:
    """The bodies of one collision geometry of a link: several where its mesh is ``decomposed``, else one.

    A mesh that is not watertight has no inside, in which nothing could hide: its hull is taken, and the body says so.

    Raises
    ------
    MeshError
        If the mesh is missing or cannot be collided with in that way.
    """
    at = pin.SE3(np.array(geometry.origin))
    if geometry.kind != "mesh":
        return [shape_body(geometry.name, geometry.link, geometry.link, KINDS[geometry.kind](*geometry.size), at)]
    if geometry.mesh is None:
        raise MeshError(geometry.name, f"the mesh of link {geometry.link!r} has no file")
    shape = Mesh(resolved(geometry.mesh, geometry.link), geometry.size)  # type: ignore[arg-type]  # three factors
    if how == "hull":
        return [shape_body(geometry.name, geometry.link, geometry.link, shape, at)]
    mesh = triangles_of(shape)
    solid = Solid(mesh.vertices, mesh.triangles)
    if not solid.watertight:
        body = shape_body(geometry.name, geometry.link, geometry.link, shape, at)
        return [replace(body, remark=f"{shape.path.name} is not watertight: its hull is taken")]  # type: ignore[union-attr]
    if how == "mesh":
        return [shape_body(geometry.name, geometry.link, geometry.link, replace(shape, hull=False), at)]
    path = Path(shape.path)  # type: ignore[arg-type]  # resolved gave a path
    parts = _cover(path, path.stat().st_mtime_ns, shape.scale)
    return [hull_body(f"{geometry.name}{PART}{i}", geometry.link, part, at) for i, part in enumerate(parts)]


def detail_bodies(geometry: LinkGeometry) -> list[Body]:
    """The parts of a link's mesh that stand for its hull where that is too coarse; none where it fits closely.

    Raises
    ------
    MeshError
        If the mesh is missing or cannot be read.
    """
    if geometry.kind != "mesh":
        return []
    bodies = link_bodies(geometry, "decomposed")
    return [replace(body, detail=True) for body in bodies] if len(bodies) > 1 else []


@lru_cache(maxsize=COVERS_KEPT)
def _cover(path: Path, _changed: int, scale: tuple[float, float, float]) -> list[npt.NDArray[np.float64]]:
    """The clusters of a watertight mesh; finding them takes some tenths of a second."""
    mesh = read_mesh(path, scale)
    solid = Solid(mesh.vertices, mesh.triangles)
    return clusters(solid.corners, solid.contains)
