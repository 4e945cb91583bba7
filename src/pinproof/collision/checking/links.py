"""The bodies of robot links: the collision geometry of the URDF, with meshes represented as the caller requests."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.geometry import decomposition, hulls, triangles
from pinproof.collision.geometry.bodies import MESHES_KEPT, Body, FileStamp, hull_body, shape_body
from pinproof.collision.geometry.decomposition import clusters
from pinproof.collision.geometry.hulls import Solid
from pinproof.collision.geometry.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from pinproof.common.content_hash import cached, content_digest
from pinproof.description import LinkGeometry, read_mesh, resolved
from pinproof.errors import InputError, MeshError, UnknownNameError

LinkMeshes = Literal["hull", "mesh", "surface", "decomposed"]
"""Representation of a link's mesh: its convex hull, its triangles if watertight, its triangles in any case, or several
convex hulls that cover it."""

AS_REQUESTED, DECOMPOSED, EXACT, SURFACES = 0, 1, 2, 3
"""Levels of detail: the representation that the caller requests, several hulls, the triangles of watertight meshes, the
triangles of all meshes. A body inside a mesh that is not watertight is not detected, so only pairs whose hulls would
tell nothing are checked by surfaces."""

GEOMETRY_NAMES = {DECOMPOSED: "several hulls", EXACT: "exact meshes", SURFACES: "surfaces of meshes"}
"""The geometry of each level of detail, for messages."""

FINER: dict[int, LinkMeshes] = {DECOMPOSED: "decomposed", EXACT: "mesh", SURFACES: "surface"}
"""The representation of each finer level."""

COARSER: dict[int, tuple[LinkMeshes, ...]] = {
    DECOMPOSED: ("hull",),
    EXACT: ("hull", "decomposed"),
    SURFACES: ("hull", "decomposed", "mesh"),
}
"""The requested representations that are coarser than each level."""

KINDS: dict[str, type[Box] | type[Sphere] | type[Cylinder] | type[Capsule]] = {
    "box": Box,
    "sphere": Sphere,
    "cylinder": Cylinder,
    "capsule": Capsule,
}
"""The shapes of the kinds of collision geometry that a URDF has besides meshes."""

DEFAULT = "*"
"""The key of a mapping for every link without an own key."""


def meshes_of(links: Iterable[str], link_meshes: LinkMeshes | Mapping[str, LinkMeshes]) -> dict[str, LinkMeshes]:
    """Return the mesh representation of each link, from one value for all or a mapping; ``"*"`` is all other links.

    UnknownNameError for an unknown representation or link.
    """
    links = tuple(links)
    stated: Mapping[str, LinkMeshes] = {DEFAULT: link_meshes} if isinstance(link_meshes, str) else link_meshes
    if not isinstance(stated, Mapping):
        raise InputError(f"link_meshes = {link_meshes!r} must be a representation or a mapping of links to them")
    for link, how in stated.items():
        if how not in get_args(LinkMeshes):
            raise UnknownNameError("kind of link meshes", how, get_args(LinkMeshes))
        if link != DEFAULT and link not in links:
            raise UnknownNameError("link", link, links, "link_meshes")
    return {link: stated.get(link, stated.get(DEFAULT, "hull")) for link in links}


def link_bodies(geometry: LinkGeometry, how: LinkMeshes) -> list[Body]:
    """Return the bodies of one collision geometry of a link: several if its mesh is ``decomposed``, else one.

    A mesh that is not watertight has no inside. Its hull is used, or its ``surface`` if requested, and the remark of
    the body states it. MeshError if the mesh is missing or cannot be represented as requested.
    """
    name, link, at = geometry.name, geometry.link, pin.SE3(np.array(geometry.origin))

    def body_of(shape: Shape) -> Body:
        return shape_body(name, link, link, shape, at)

    if geometry.kind != "mesh":
        return [body_of(KINDS[geometry.kind](*geometry.size))]
    if geometry.mesh is None:
        raise MeshError(name, f"the mesh of link {link!r} has no file")
    path = resolved(geometry.mesh, link)
    shape = Mesh(path, geometry.size, hull=True)  # type: ignore[arg-type]  # three
    if how == "hull":
        return [body_of(shape)]
    file = FileStamp.of(path)
    mesh_file = path.absolute(), file, shape.scale
    watertight = _is_watertight(*mesh_file)
    if how == "surface":
        return [body_of(replace(shape, hull=False, hollow=not watertight))]
    if not watertight:
        return [replace(body_of(shape), remark=f"{path.name} is not watertight, so its convex hull is used")]
    if how == "mesh":
        return [body_of(replace(shape, hull=False))]
    return [
        replace(part, name=f"{name}_part_{i}", owner=link, link=link, link_from_body=at, file=file)
        for i, part in enumerate(_parts(*mesh_file))
    ]


SOLID_CODE = (hulls.__file__, triangles.__file__)
"""The modules that decide whether a mesh is watertight, for entries of the cache on disk."""

GEOMETRIES_KEPT = 512
"""Number of collision geometries of links whose hulls and primitive shapes are kept."""


def _kept_bodies(geometry: LinkGeometry, how: LinkMeshes) -> Sequence[Body]:
    """Return :func:`link_bodies` with their source; checkers of one robot share all bodies that are convex."""
    if geometry.kind == "mesh" and how in ("mesh", "surface"):
        return [replace(body, source=geometry.name) for body in link_bodies(geometry, how)]
    stamp = None if geometry.mesh is None else FileStamp.of(resolved(geometry.mesh, geometry.link))
    return _convex_bodies(geometry, how, stamp)


@lru_cache(maxsize=GEOMETRIES_KEPT)
def _convex_bodies(geometry: LinkGeometry, how: LinkMeshes, _stamp: FileStamp | None) -> tuple[Body, ...]:
    return tuple(replace(body, source=geometry.name) for body in link_bodies(geometry, how))


class LinkBodies:
    """The bodies of a robot's links, in the requested representation and, for some pairs, in finer ones.

    Derived checkers share the bodies. ``meshes`` is the representation of the meshes of each link. MeshError if a mesh
    is missing or cannot be represented as requested.
    """

    def __init__(self, geometries: Sequence[LinkGeometry], meshes: Mapping[str, LinkMeshes]) -> None:
        self._geometries, self._meshes = tuple(geometries), dict(meshes)
        self._finer: dict[tuple[str, int], tuple[Body, ...]] = {}
        self._requested = tuple(
            body for geometry in self._geometries for body in _kept_bodies(geometry, self._meshes[geometry.link])
        )

    def of(self, levels: Mapping[frozenset[str], int]) -> tuple[Body, ...]:
        """Return all bodies for these levels of pairs of owners, those of the requested representation first."""
        wanted = {(owner, level) for pair, level in levels.items() for owner in pair}
        return self._requested + tuple(
            body
            for geometry in self._geometries
            for level in FINER
            if (geometry.link, level) in wanted
            for body in self._more_finely(geometry, level)
        )

    def on_level(self, link: str, level: int) -> tuple[Body, ...]:
        """Return the bodies of a link on a level; the requested ones where there are no finer ones."""
        bodies: list[Body] = []
        for geometry in self._geometries:
            if geometry.link == link:
                requested = [body for body in self._requested if body.source == geometry.name]
                bodies += (level and self._more_finely(geometry, level)) or requested
        return tuple(bodies)

    def meshes_of(self, link: str) -> LinkMeshes:
        """Return the representation of a link's meshes."""
        return self._meshes[link]

    def can_be_finer(self, owner: str, level: int = EXACT) -> bool:
        """Whether it is a link with a mesh whose requested representation is coarser than that of a level."""
        return any(
            geometry.link == owner and geometry.kind == "mesh" and self._meshes[owner] in COARSER[level]
            for geometry in self._geometries
        )

    def _more_finely(self, geometry: LinkGeometry, level: int) -> tuple[Body, ...]:
        """Return the bodies of a geometry on a level; none if the requested representation is as fine."""
        key = geometry.name, level
        if key not in self._finer:
            self._finer[key] = tuple(_finer_bodies(geometry, self._meshes[geometry.link], level))
        return self._finer[key]

    def __repr__(self) -> str:
        return f"LinkBodies({sorted(self._meshes.items())!r})"


def _finer_bodies(geometry: LinkGeometry, requested: LinkMeshes, level: int) -> list[Body]:
    if geometry.kind != "mesh" or requested not in COARSER[level]:
        return []
    bodies = _kept_bodies(geometry, FINER[level])
    if level == DECOMPOSED:
        # A single hull fits closely, or the mesh is not watertight.
        return [replace(body, level=level) for body in bodies] if len(bodies) > 1 else []
    if bodies[0].support is not None or (requested == "mesh" and not bodies[0].is_hollow):
        return []  # not watertight, or represented by its triangles already
    name = f"{geometry.name}_{'exact' if level == EXACT else 'surface'}"
    return [replace(body, name=name, level=level) for body in bodies]


Scale = float | tuple[float, float, float]


@lru_cache(maxsize=MESHES_KEPT)
def _solid(path: Path, _file: FileStamp | None, scale: Scale) -> Solid:
    mesh = read_mesh(path, scale)  # type: ignore[arg-type]  # made three numbers by Mesh
    return Solid(mesh.vertices, mesh.triangles)


@lru_cache(maxsize=MESHES_KEPT)
def _is_watertight(path: Path, file: FileStamp | None, scale: Scale) -> bool:
    mesh = read_mesh(path, scale)  # type: ignore[arg-type]  # made three numbers by Mesh

    def make() -> dict[str, npt.NDArray[Any]]:
        return {"watertight": np.array(_solid(path, file, scale).watertight)}

    key = content_digest(mesh.vertices, mesh.triangles)
    return bool(cached("watertight", key, make, code=SOLID_CODE, libraries=["scipy"])["watertight"])


@lru_cache(maxsize=MESHES_KEPT)
def _parts(path: Path, file: FileStamp | None, scale: Scale) -> tuple[Body, ...]:
    """Return convex hulls that cover a watertight mesh, without a link; this takes 0.05 s to some seconds."""
    mesh = read_mesh(path, scale)  # type: ignore[arg-type]  # made three numbers by Mesh

    def make() -> dict[str, npt.NDArray[Any]]:
        solid = _solid(path, file, scale)
        return {f"{number:04d}": part for number, part in enumerate(clusters(solid.corners, solid.contains))}

    code = [decomposition.__file__, *SOLID_CODE]
    found = cached("hulls", content_digest(mesh.vertices, mesh.triangles), make, code=code, libraries=["scipy", "coal"])
    return tuple(hull_body("", "", found[name], pin.SE3.Identity()) for name in sorted(found))
