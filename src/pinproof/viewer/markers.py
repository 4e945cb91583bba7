"""Arrows that mark poses, each in the colour of its kind: where many picks grasp, and which of them are good."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.viewer.surfaces import Surface, shade
from pinproof.viewer.wire import Commands

__all__ = ["LONGEST", "PoseMarkers", "arrow"]

Array = npt.NDArray[np.float64]
Rgb = tuple[float, float, float]

LONGEST, SHORTEST = 0.07, 0.015
"""Metres: an arrow, alone or in a crowd."""

SHARE = 0.9
"""An arrow is at most this share of the usual distance between neighbours long: beside each other, not a thicket."""

SIDES = 10
"""Sides of an arrow, which is drawn up to some thousand times."""


@dataclass(frozen=True, eq=False)
class PoseMarkers:
    """Poses and their kinds.

    Parameters
    ----------
    poses
        (N, 4, 4) ``root_from_tip``. The arrow ends at the tip and points along its z axis, the way it comes; the bar
        across its tail lies along the tip's x axis.
    kinds
        (N,) which of ``colours`` each has.
    colours
        0 to 1 each.
    """

    poses: Array
    kinds: npt.NDArray[np.int64]
    colours: tuple[Rgb, ...]

    def settings(self, commands: Commands) -> dict[str, Any]:
        """What the page's script draws them from; arrays go to ``commands``."""
        shape = arrow(self._length())
        columns = np.swapaxes(self.poses, 1, 2).astype(np.float32)  # three.js reads matrices by columns
        rgb = np.array(self.colours, dtype=float).reshape(-1, 3)[self.kinds]
        return {
            "length": round(self._length(), 4),
            "vertices": commands.array(shape.vertices.astype(np.float32).ravel()),
            "normals": commands.array(shape.normals.astype(np.float32).ravel()),
            "triangles": commands.array(shape.triangles.astype(np.uint16).ravel()),
            "poses": commands.array(columns.ravel()),
            "rgb": commands.array(rgb.astype(np.float32).ravel()),
        }

    def _length(self) -> float:
        from scipy.spatial import cKDTree

        places = np.unique(np.round(self.poses[:, :3, 3], 4), axis=0)
        if len(places) < 2:
            return LONGEST
        gaps = cKDTree(places).query(places, k=2)[0][:, 1]
        return float(np.clip(SHARE * np.median(gaps), SHORTEST, LONGEST))


@lru_cache(maxsize=4)
def arrow(length: float) -> Surface:
    """An arrow of a length (m) along z that ends at the origin."""
    from trimesh import creation, util

    head, thick = 0.42 * length, 0.05 * length
    cone = creation.cone(radius=0.17 * length, height=head, sections=SIDES)  # its disc lies at z = 0, its point above
    cone.apply_translation((0, 0, -head))
    shaft = creation.cylinder(radius=thick, height=length - head, sections=SIDES)
    shaft.apply_translation((0, 0, -(length + head) / 2))
    bar = creation.box(extents=(0.5 * length, 2 * thick, 2 * thick))
    bar.apply_translation((0, 0, -length))
    whole = util.concatenate([cone, shaft, bar])
    return shade(np.array(whole.vertices, dtype=float), np.array(whole.faces, dtype=np.int64), (1, 1, 1, 1))
