"""The visual and collision elements of a URDF's links, each checked; unknown geometry is refused, never dropped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof.description.geometry import LinkGeometry
from pinproof.description.packages import climbs_out, locate
from pinproof.description.xml_reader import Element, number, numbers, only, place, required, spelt
from pinproof.errors import UnknownNameError, UrdfError

__all__ = ["origin", "read_links", "rpy_matrix"]

FARTHEST = 1e4
"""Metres. An origin or a size beyond this is a mistake of units; far beyond it, sums of squares overflow."""

SHAPES = ("box", "capsule", "cylinder", "mesh", "sphere")


def read_links(
    root: Element, source: str | Path, folder: Path | None, package_dirs: Sequence[Path]
) -> tuple[tuple[LinkGeometry, ...], tuple[LinkGeometry, ...]]:
    """All visuals, then all collisions, of a ``<robot>``, in the file's order."""
    colours = {m.get("name"): _rgba(m, source) for m in root.findall("material") if m.get("name")}
    found: dict[str, list[LinkGeometry]] = {"visual": [], "collision": []}
    for link in root.findall("link"):
        spelt(link, ("collision", "inertial", "visual"), source)
        for tag, collected in found.items():
            for index, element in enumerate(link.findall(tag)):
                name = f"{link.get('name').strip()}_{index}"
                collected.append(_geometry(element, name, colours, source, folder, package_dirs))
    return tuple(found["visual"]), tuple(found["collision"])


def rpy_matrix(roll: float, pitch: float, yaw: float) -> npt.NDArray[np.float64]:
    """(3, 3) rotation Rz(yaw) Ry(pitch) Rx(roll), angles in radians about fixed axes."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _geometry(
    element: Element,
    name: str,
    colours: dict[str, tuple[float, float, float, float] | None],
    source: str | Path,
    folder: Path | None,
    package_dirs: Sequence[Path],
) -> LinkGeometry:
    link = name.rpartition("_")[0]
    spelt(element, ("geometry", "material", "name", "origin"), source)
    shapes = [] if (geometry := element.find("geometry")) is None else list(geometry)
    if len(shapes) != 1:
        raise UrdfError(
            source, f"a <{element.tag}> of link {link!r} must hold one shape, not {len(shapes)}", place(element)
        )
    shape = shapes[0]
    kind, size = _shape(shape, link, source)
    material = element.find("material")
    rgba = None
    if material is not None:
        rgba = _rgba(material, source) or colours.get(material.get("name"))
    mesh = None
    if kind == "mesh":
        uri = required(shape, "filename", source)
        if climbs_out(uri):
            raise UrdfError(source, f"{uri} climbs out of its package by way of '..'", place(shape))
        mesh = locate(uri, folder, package_dirs)
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = origin(element, source)
    placement.setflags(write=False)
    return LinkGeometry(name, link, kind, size, placement, mesh, rgba)


def _shape(
    shape: Element, link: str, source: str | Path
) -> tuple[Literal["box", "sphere", "cylinder", "capsule", "mesh"], tuple[float, ...]]:
    tag = shape.tag
    size: tuple[float, ...]
    if tag == "mesh":
        size = numbers(shape, "scale", 3, source, "1 1 1")
        if 0.0 in size:
            raise UrdfError(source, f"a mesh of link {link!r} is scaled to nothing: {list(size)}", place(shape))
        return "mesh", size
    if tag == "box":
        kind: Literal["box", "sphere", "cylinder", "capsule"] = "box"
        size = numbers(shape, "size", 3, source)
    elif tag == "sphere":
        kind, size = "sphere", (number(shape, "radius", source),)
    elif tag in ("cylinder", "capsule"):
        kind = "cylinder" if tag == "cylinder" else "capsule"
        size = (number(shape, "radius", source), number(shape, "length", source))
    else:
        raise UrdfError(source, str(UnknownNameError("geometry", tag, SHAPES, f"link {link!r}")), place(shape))
    if min(size) <= 0 or max(size) > FARTHEST:
        raise UrdfError(
            source,
            f"a {tag} of link {link!r} has the size {list(size)}; sizes are above 0 and at most {FARTHEST:g} m",
            place(shape),
        )
    return kind, size


def origin(element: Element, source: str | Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """The rotation (3, 3) and the translation (3,) in metres of an element's ``<origin>``."""
    found = element.find("origin")
    if found is None:
        return np.eye(3), np.zeros(3)
    only(found, ("xyz", "rpy"), source)
    xyz = np.array(numbers(found, "xyz", 3, source, "0 0 0"))
    if np.abs(xyz).max() > FARTHEST:
        raise UrdfError(source, f"<origin xyz={found.get('xyz')!r}> is more than {FARTHEST:g} m away", place(found))
    return rpy_matrix(*numbers(found, "rpy", 3, source, "0 0 0")), xyz


def _rgba(material: Element, source: str | Path) -> tuple[float, float, float, float] | None:
    colour = material.find("color")
    if colour is None:
        return None
    r, g, b, a = (min(max(v, 0.0), 1.0) for v in numbers(colour, "rgba", 4, source))
    return (r, g, b, a) if math.isfinite(a) else None
