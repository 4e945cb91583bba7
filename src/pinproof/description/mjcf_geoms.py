"""The geoms of an MJCF body as the ``<collision>`` and ``<visual>`` elements of a URDF link."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.description.mjcf_defaults import Words, z_to
from pinproof.description.xml_reader import Element, place, required
from pinproof.errors import UnknownNameError, UrdfError
from pinproof.spatial import xyz_rpy

__all__ = ["add_geom"]

Array = npt.NDArray[np.float64]

HIDDEN_GROUP = 3
"""MuJoCo draws geoms of the groups 0 to 2; what only collides stands in a later one by custom."""

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3}


def add_geom(words: Words, meshes: Mapping[str, Element], link: Element, geom: Element, inherited: str | None) -> None:
    """Enter a geom into a link: as collision unless it can touch nothing, as visual where it is drawn.

    Raises
    ------
    UrdfError
        With the line, for a kind that has no counterpart: it would collide with nothing.
    """
    said = words.attributes(geom, inherited)
    collides = said.get("contype", "1") != "0" or said.get("conaffinity", "1") != "0"
    drawn = not collides or int(words.numbers(geom, said, "group", 1, "0")[0]) < HIDDEN_GROUP
    kind = said.get("type", "sphere")
    pose = words.pose(geom, said)
    if kind == "mesh":
        shape = {"tag": "mesh", **_mesh(words, meshes, said, geom)}
    elif kind in SIZES and "mesh" not in said:
        shape, pose = _primitive(words, said, geom, kind, pose)
    else:
        what = f"a {kind} fitted to a mesh" if "mesh" in said else f"a {kind}"
        reason = f"holds {what}; read are {', '.join(SIZES)} and mesh: it would collide with nothing"
        raise UrdfError(words.path, reason, place(geom))
    for tag, wanted in (("collision", collides), ("visual", drawn)):
        if wanted:
            _add(link, tag, shape, pose, said.get("rgba"), geom)


def _primitive(
    words: Words, said: Mapping[str, str], geom: Element, kind: str, pose: Array
) -> tuple[dict[str, str], Array]:
    """Shape and pose; MuJoCo gives half sides and half lengths, and ``fromto`` gives the ends of the axis."""
    count = SIZES[kind]
    if "fromto" in said and kind != "sphere":
        ends = words.numbers(geom, said, "fromto", 6)
        along = ends[3:] - ends[:3]
        length = float(np.linalg.norm(along))
        if length < 1e-9:
            raise UrdfError(words.path, "<geom fromto> has its two ends in one place", place(geom))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = z_to(along), (ends[:3] + ends[3:]) / 2
        # MuJoCo's z axis points from the second end to the first; no shape here can tell.
        given = max(len(said.get("size", "").split()), 1)
        half = [*words.numbers(geom, said, "size", given)[: count - 1], length / 2]
        if kind == "box" and given < 2:
            half = [half[0], half[0], length / 2]
    else:
        # More numbers than a kind needs are allowed, for classes that serve several kinds.
        given = max(len(said.get("size", "").split()), count)
        half = list(words.numbers(geom, said, "size", given)[:count])
    full = [repr(2 * float(value)) for value in half]
    if kind == "box":
        return {"tag": "box", "size": " ".join(full)}, pose
    if kind == "sphere":
        return {"tag": "sphere", "radius": repr(float(half[0]))}, pose
    return {"tag": kind, "radius": repr(float(half[0])), "length": full[1]}, pose


def _mesh(words: Words, meshes: Mapping[str, Element], said: Mapping[str, str], geom: Element) -> dict[str, str]:
    name = said.get("mesh", "")
    if name not in meshes:
        raise UrdfError(words.path, str(UnknownNameError("mesh", name, meshes, "a <geom>")), place(geom))
    asset = words.attributes(meshes[name], None)
    for odd in ("refpos", "refquat", "vertex", "builtin"):
        if odd in asset:
            raise UrdfError(words.path, f"mesh {name!r} has {odd}, which is not read", place(meshes[name]))
    file = Path(required(meshes[name], "file", words.path))
    return {"filename": str(words.mesh_folder / file), "scale": asset.get("scale", "1 1 1")}


def _add(link: Element, tag: str, shape: Mapping[str, str], pose: Array, rgba: str | None, geom: Element) -> None:
    made = [link.makeelement(tag)]
    values = [repr(float(value)) for value in xyz_rpy(pose)]
    made.append(link.makeelement("origin", {"xyz": " ".join(values[:3]), "rpy": " ".join(values[3:])}))
    made.append(link.makeelement("geometry"))
    made.append(link.makeelement(shape["tag"], {name: text for name, text in shape.items() if name != "tag"}))
    made[0].extend(made[1:3])
    made[2].append(made[3])
    if rgba is not None:
        made.append(link.makeelement("material"))
        made.append(link.makeelement("color", {"rgba": rgba}))
        made[0].append(made[4])
        made[4].append(made[5])
    for element in made:
        element.sourceline = geom.sourceline
    link.append(made[0])
