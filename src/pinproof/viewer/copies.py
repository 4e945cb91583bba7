"""Faint copies of links: every branch of an IK answer as a ghost, and the tool at steps of its motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.viewer.animation import Film
from pinproof.viewer.stage import Stage
from pinproof.viewer.wire import Commands

__all__ = ["GHOST_HUES", "copies", "ghosts_at", "swept"]

Array = npt.NDArray[np.float64]

SWEEP_TURN, SWEEP_SHARE, MOST_STEPS = np.deg2rad(25.0), 0.07, 40
"""The tool is drawn anew after this turn (rad), or a way of this share of the picture's radius; this often at most."""

GHOST_HUES = ((0.12, 0.47, 0.80), (0.90, 0.45, 0.10), (0.16, 0.58, 0.28), (0.72, 0.22, 0.55), (0.45, 0.36, 0.75),
              (0.75, 0.62, 0.10), (0.10, 0.60, 0.62), (0.78, 0.25, 0.22))  # fmt: skip
"""Colours that tell ghosts apart; they repeat."""
SAME_LOOK = 1e-4
"""Copies that differ by about this much (m, or matrix entries) are one: joints often differ by whole turns alone."""

SAME_PLACE = 1e-6
"""Links whose pose in the tcp frame changes by less (m, or matrix entries) move with the tool."""


def ghosts_at(stage: Stage, q: Array) -> Array:
    """(k, L, 4, 4) ``root_from_link`` at each of the configurations q (k, n), those once that look the same."""
    poses = np.array([stage.link_poses(each) for each in q]).reshape(-1, len(stage.links), 4, 4)
    return poses[_different(poses)] if len(poses) else poses


def copies(
    commands: Commands,
    stage: Stage,
    poses: Array,
    into: str,
    *,
    opacity: float,
    hues: Sequence[Any] = (),
    own: Array | None = None,
) -> list[dict[str, Any]]:
    """Faint copies of links, for the page's script.

    Parameters
    ----------
    commands
        Takes the arrays.
    poses
        (k, L, 4, 4) ``root_from_link`` of the drawn links; NaN where a link is not copied.
    into
        The node that holds them.
    hues
        A colour for each of the k, in turn; without, each mesh keeps its own.
    own
        (L, 4, 4) where the links themselves are: a copy on the same place is left out, as is one on another copy.
    """
    found = []
    rgb = np.array([hues[k % len(hues)] for k in range(len(poses))], dtype=np.float32) if hues else None
    for number, link in enumerate(stage.links):
        placed = poses[:, number]
        if not link.surfaces or not len(placed) or np.isnan(placed).any():
            continue
        kept = _different(placed)
        if own is not None:
            kept = kept[(np.abs(placed[kept] - own[number]) > SAME_LOOK).any(axis=(1, 2))]
        columns = np.swapaxes(placed[kept], 1, 2).astype(np.float32)  # three.js reads matrices by columns
        entry = {"into": into, "of": ["robot", link.name, "visual"], "count": len(kept), "opacity": opacity}
        entry["matrices"] = commands.array(columns.ravel())
        if rgb is not None:
            entry["rgb"] = commands.array(rgb[kept].ravel())
        if len(kept):
            found.append(entry)
    return found


def _different(poses: Array) -> npt.NDArray[np.int64]:
    """Which of poses (k, ...) are the first of their kind, in order."""
    same = np.round(poses.reshape(len(poses), -1) / SAME_LOOK).astype(np.int64)
    return np.sort(np.unique(same, axis=0, return_index=True)[1])


def _tool(stage: Stage) -> npt.NDArray[np.bool_]:
    """(L,) which drawn links are the tool: those that stand still in the tcp frame, else the last one before it."""
    rng = np.random.default_rng(0)
    arm, drawn = stage.arm, np.array([bool(link.surfaces) for link in stage.links])
    low, high = np.maximum(arm.limits.lower, arm.home - 1.0), np.minimum(arm.limits.upper, arm.home + 1.0)
    tried = [arm.home, *(low + rng.random((2, arm.dof)) * (high - low))]
    seen = np.stack([np.linalg.inv(stage.tcp_pose(q)) @ stage.link_poses(q) for q in tried])
    still = np.asarray((np.abs(seen - seen[0]) < SAME_PLACE).all(axis=(0, 2, 3))) & drawn
    names, at = [link.name for link in stage.links], arm.robot.urdf.parent_joint(arm.tcp)
    while not still.any() and at is not None:
        still = np.array([name == at.parent for name in names]) & drawn
        at = arm.robot.urdf.parent_joint(at.parent)
    return still


def swept(stage: Stage, shown: Film, reach: float) -> Array:
    """(k, L, 4, 4) the tool at steps of a motion, NaN for the links that are no part of it."""
    tool = _tool(stage)
    if len(shown.times) < 2 or not tool.any():
        return np.empty((0, len(stage.links), 4, 4))
    turning = shown.poses[:, int(np.flatnonzero(tool)[0]), :3, :3]
    cosine = np.clip((np.einsum("fij,fij->f", turning[:-1], turning[1:]) - 1) / 2, -1.0, 1.0)
    way = np.linalg.norm(np.diff(shown.tcp, axis=0), axis=1) / (SWEEP_SHARE * reach) + np.arccos(cosine) / SWEEP_TURN
    total = np.concatenate([[0.0], np.cumsum(way)])
    steps = int(np.clip(np.ceil(total[-1]), 1, MOST_STEPS)) + 1
    frames = np.unique(np.searchsorted(total, np.linspace(0.0, total[-1], steps)).clip(max=len(total) - 1))
    poses = shown.poses[frames].copy()
    poses[:, ~tool] = np.nan
    return poses
