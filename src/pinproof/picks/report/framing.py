"""Where to look at many picks from: robot and grasps are in the picture, and neither hides the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.viewer.camera import View, choose_view
from pinproof.viewer.overlays import LONGEST, arrow
from pinproof.viewer.stage import DrawnLink, Stage
from pinproof.viewer.surfaces import merge_by_colour

__all__ = ["frame_picks"]

Array = npt.NDArray[np.float64]

FRAMED = 1.3
"""Grasps within so many times the robot's own extent about its root are framed; one far away would shrink the rest."""

GROUPS, A_GROUP = 6, 30
"""Groups of neighbouring grasps that should be seen as well as the links, and how many grasps stand for each."""


def frame_picks(stage: Stage, poses: Array, tcp: Array, grasps: Array) -> View:
    """The view of a stage, of its links at poses (F, L, 4, 4), of the tcp's ways (N, 3), and of grasps (G, 4, 4)."""
    near = grasps[np.linalg.norm(grasps[:, :3, 3], axis=1) <= FRAMED * _extent(stage, poses)]
    tails = near[:, :3, 3] - LONGEST * near[:, :3, 2]
    groups = _groups(near)
    standing = np.broadcast_to(np.eye(4), (len(poses), len(groups), 4, 4))
    seen = replace(stage, links=(*stage.links, *groups))
    return choose_view(seen, np.concatenate([poses, standing], axis=1), np.concatenate([tcp, near[:, :3, 3], tails]))


def _extent(stage: Stage, poses: Array) -> float:
    """Metres from the root to the farthest point that the robot may have."""
    sizes = [max(float(np.linalg.norm(each.vertices, axis=1).max()) for each in link.surfaces) for link in stage.links]
    return float((np.linalg.norm(poses[:, :, :3, 3], axis=2) + sizes).max())


def _groups(grasps: Array) -> list[DrawnLink]:
    """Arrows at grasps as bodies that the choice of a view takes for links: what is seen of them counts."""
    order = np.argsort(np.arctan2(grasps[:, 1, 3], grasps[:, 0, 3]), kind="stable")  # neighbours, about the root
    parts = [part for part in np.array_split(grasps[order], GROUPS) if len(part)]
    bodies = []
    for number, part in enumerate(parts):
        few = part[:: -(-len(part) // A_GROUP)]
        surfaces = merge_by_colour([arrow(LONGEST).moved(each) for each in few])
        bodies.append(DrawnLink(f"grasps {number}", tuple(surfaces)))
    return bodies
