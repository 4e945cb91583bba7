"""The bodies of robot links: what a URDF says is to be collided with, its meshes as the caller wants them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal, get_args

import numpy as np
import pinocchio as pin

from pinproof.collision.bodies import Body, shape_body
from pinproof.collision.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from pinproof.description import LinkGeometry
from pinproof.description.meshes import resolved
from pinproof.errors import InputError, MeshError, UnknownNameError

__all__ = ["LinkMeshes", "link_bodies", "meshes_of"]

LinkMeshes = Literal["hull", "mesh", "decomposed"]
"""How a link's mesh is collided with: as its convex hull, as its triangles, or as several hulls that cover it."""

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

    Raises
    ------
    MeshError
        If the mesh is missing or cannot be collided with in that way.
    """
    shape: Shape
    if geometry.kind == "mesh":
        if geometry.mesh is None:
            raise MeshError(geometry.name, f"the mesh of link {geometry.link!r} has no file")
        shape = Mesh(resolved(geometry.mesh, geometry.link), geometry.size, hull=how != "mesh")  # type: ignore[arg-type]
    elif geometry.kind == "box":
        shape = Box(*geometry.size)
    elif geometry.kind == "sphere":
        shape = Sphere(*geometry.size)
    elif geometry.kind == "cylinder":
        shape = Cylinder(*geometry.size)
    else:
        shape = Capsule(*geometry.size)
    return [shape_body(geometry.name, geometry.link, geometry.link, shape, pin.SE3(np.array(geometry.origin)))]
