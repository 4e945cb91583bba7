"""The geometry of a link on paper: what a URDF says is drawn, and what is to be collided with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof.description.packages import MeshFile

__all__ = ["LinkGeometry"]


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """One ``<visual>`` or ``<collision>`` element.

    Parameters
    ----------
    name
        Unique in the robot: ``LINK_0``, ``LINK_1``, ... in the file's order.
    link
        The link it belongs to.
    kind
        What it is; ``size`` holds, in metres: box (x, y, z) full sides; sphere (radius,); cylinder and capsule
        (radius, length), along z, a capsule's length without its caps; mesh: the scale (x, y, z).
    origin
        (4, 4) link_from_geometry.
    mesh
        The file of a mesh.
    rgba
        The colour a URDF material gives, 0 to 1.
    """

    name: str
    link: str
    kind: Literal["box", "sphere", "cylinder", "capsule", "mesh"]
    size: tuple[float, ...]
    origin: npt.NDArray[np.float64]
    mesh: MeshFile | None = None
    rgba: tuple[float, float, float, float] | None = None
