"""The bodies of robot links: what a URDF says is to be collided with, its meshes as the caller wants them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pinocchio as pin

from pinproof.collision.bodies import MESHES_KEPT, Body, FileStamp, hull_body, shape_body
from pinproof.collision.decomposition import clusters
from pinproof.collision.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from pinproof.collision.solid import Solid
from pinproof.description import LinkGeometry
from pinproof.description.meshes import read_mesh, resolved
from pinproof.errors import InputError, MeshError, UnknownNameError

__all__ = ["AS_TOLD", "DECOMPOSED", "EXACT", "LinkBodies", "LinkMeshes", "link_bodies", "meshes_of"]

LinkMeshes = Literal["hull", "mesh", "surface", "decomposed"]
"""How a link's mesh is collided with: as its convex hull, as its triangles where these enclose it, as its triangles
whether they do or not, or as several hulls that cover it."""

AS_TOLD, DECOMPOSED, EXACT = 0, 1, 2
"""How finely a pair of bodies is judged: by the meshes as the caller wants them, by several hulls, by the triangles."""

COARSER: dict[int, tuple[LinkMeshes, ...]] = {DECOMPOSED: ("hull",), EXACT: ("hull", "decomposed")}
"""Which ways of meeting a mesh each level is finer than."""

KINDS: dict[str, type[Box] | type[Sphere] | type[Cylinder] | type[Capsule]] = {
    "box": Box,
    "sphere": Sphere,
    "cylinder": Cylinder,
    "capsule": Capsule,
}

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

    A mesh that is not watertight has no inside, in which nothing could hide: its hull is taken, or its bare ``surface``
    where that is asked for, and the body says so.

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
    shape = Mesh(resolved(geometry.mesh, geometry.link), geometry.size, hull=True)  # type: ignore[arg-type]  # three
    if how == "hull":
        return [shape_body(geometry.name, geometry.link, geometry.link, shape, at)]
    file = _file(shape)
    watertight = _solid(*file).watertight
    if how == "surface":
        surface = replace(shape, hull=False, hollow=not watertight)
        return [shape_body(geometry.name, geometry.link, geometry.link, surface, at)]
    if not watertight:
        body = shape_body(geometry.name, geometry.link, geometry.link, shape, at)
        return [replace(body, remark=f"{shape.path.name} is not watertight: its hull is taken")]  # type: ignore[union-attr]
    if how == "mesh":
        return [shape_body(geometry.name, geometry.link, geometry.link, replace(shape, hull=False), at)]
    read = FileStamp.of(shape.path)  # type: ignore[arg-type]  # meshes of links have one
    return [
        replace(
            part,
            name=f"{geometry.name}_part_{i}",
            owner=geometry.link,
            link=geometry.link,
            link_from_body=at,
            file=read,
        )
        for i, part in enumerate(_parts(*file))
    ]


class LinkBodies:
    """The bodies of a robot's links: of each geometry as told and, for pairs that call for it, more finely.

    What was made is kept, for all checkers that are derived from one.

    Parameters
    ----------
    geometries
        The collision geometries of all links.
    meshes
        How each link's meshes are met.

    Raises
    ------
    MeshError
        If a mesh is missing or cannot be collided with as told.
    """

    def __init__(self, geometries: Sequence[LinkGeometry], meshes: Mapping[str, LinkMeshes]) -> None:
        self._geometries, self._meshes = tuple(geometries), dict(meshes)
        self._finer: dict[tuple[str, int], tuple[Body, ...]] = {}
        self._told = tuple(
            replace(body, source=geometry.name)
            for geometry in self._geometries
            for body in link_bodies(geometry, self._meshes[geometry.link])
        )

    def of(self, levels: Mapping[frozenset[str], int]) -> tuple[Body, ...]:
        """All bodies that are needed where pairs of owners are judged on these levels, those as told first."""
        wanted = {(owner, level) for pair, level in levels.items() for owner in pair}
        return self._told + tuple(
            body
            for geometry in self._geometries
            for level in (DECOMPOSED, EXACT)
            if (geometry.link, level) in wanted
            for body in self._more_finely(geometry, level)
        )

    def on_level(self, link: str, level: int) -> tuple[Body, ...]:
        """The bodies that judge a link on a level: as told where there are no closer ones."""
        bodies: list[Body] = []
        for geometry in self._geometries:
            if geometry.link == link:
                told = [body for body in self._told if body.source == geometry.name]
                bodies += (level and self._more_finely(geometry, level)) or told
        return tuple(bodies)

    def meshes_of(self, link: str) -> LinkMeshes:
        """How the meshes of a link are collided with."""
        return self._meshes[link]

    @property
    def solid_links(self) -> frozenset[str]:
        """The links that have collision geometry."""
        return frozenset(geometry.link for geometry in self._geometries)

    def can_be_finer(self, owner: str) -> bool:
        """Whether it is a link with a mesh that is not met as its triangles already."""
        return any(
            geometry.link == owner and geometry.kind == "mesh" and self._meshes[owner] in COARSER[EXACT]
            for geometry in self._geometries
        )

    def _more_finely(self, geometry: LinkGeometry, level: int) -> tuple[Body, ...]:
        """What stands for a geometry on a level; nothing where the bodies as told are as fine as that."""
        key = geometry.name, level
        if key not in self._finer:
            self._finer[key] = tuple(_finer_bodies(geometry, self._meshes[geometry.link], level))
        return self._finer[key]

    def __repr__(self) -> str:
        return f"LinkBodies({sorted(self._meshes.items())!r})"


def _finer_bodies(geometry: LinkGeometry, told: LinkMeshes, level: int) -> list[Body]:
    if geometry.kind != "mesh" or told not in COARSER[level]:
        return []
    bodies = link_bodies(geometry, "decomposed" if level == DECOMPOSED else "mesh")
    if level == DECOMPOSED and len(bodies) == 1:  # its hull fits closely, or it is not watertight
        return []
    if level == EXACT and bodies[0].support is not None:  # not watertight
        return []
    name = f"{geometry.name}_exact"
    return [
        replace(body, name=body.name if level == DECOMPOSED else name, source=geometry.name, level=level)
        for body in bodies
    ]


def _file(shape: Mesh) -> tuple[Path, int, tuple[float, float, float]]:
    """What tells one mesh from another, and a file from what it was before somebody changed it."""
    path = Path(shape.path).absolute()  # type: ignore[arg-type]  # meshes of links have one
    return path, path.stat().st_mtime_ns, shape.scale  # type: ignore[return-value]  # made three numbers by Mesh


@lru_cache(maxsize=MESHES_KEPT)
def _solid(path: Path, _changed: int, scale: tuple[float, float, float]) -> Solid:
    mesh = read_mesh(path, scale)
    return Solid(mesh.vertices, mesh.triangles)


@lru_cache(maxsize=MESHES_KEPT)
def _parts(path: Path, changed: int, scale: tuple[float, float, float]) -> tuple[Body, ...]:
    """The hulls that cover a watertight mesh, of no link yet; to find them takes 0.05 s to some seconds."""
    solid = _solid(path, changed, scale)
    return tuple(hull_body("", "", part, pin.SE3.Identity()) for part in clusters(solid.corners, solid.contains))
