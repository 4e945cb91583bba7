"""A hand as maps: how far it reaches along its approach, and what its fingers pass over while they close.

All maps are in the frame of the hand: its origin is the tip, z the approach direction, and y the closing direction of
the first finger. ``front`` is the largest z of the open hand by (x, y): a part that is nowhere behind it is free of the
hand at the grasp and on a straight approach of any length. For several widths, ``swept`` are the smallest and largest y
that each side of the fingers has had at (x, z) since it was open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision import LineSurface
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.picks.judging.grip import MovingFinger, PlacedSurface, fingers_of
from pinproof.picks.judging.hand import FACE, hand_bodies
from pinproof.spatial import SE3, Array

LEVELS = 25
"""Number of widths, from the open to the closed hand, for which the fingers are mapped."""

CELLS, FINEST = 96, 1e-3
"""Largest number of cells along a side of a map, and their smallest side (m)."""

LEAST_PAD = 0.1
"""Least area of the pads as a share of the largest area of equal distance: behind the tips of stepped fingers, such as
those of the Panda, the inner faces are larger and farther apart; behind those of a linkage, they may be closer."""

PAD_FLATNESS = 2e-4
"""Metres: the inner face of a finger belongs to its pad where it is recessed by no more than this."""

Y = np.array([0.0, 1.0, 0.0])


class Grid(NamedTuple):
    """A grid of square cells in a plane: the middle of the first cell, the side of a cell, and their numbers."""

    low: Array
    step: float
    shape: tuple[int, int]

    @classmethod
    def around(cls, points: Array) -> Grid:
        """The grid around points (N, 2)."""
        middle, sides = (points.min(axis=0) + points.max(axis=0)) / 2, np.ptp(points, axis=0)
        step = max(FINEST, float(sides.max()) / CELLS)
        columns, rows = (max(int(np.ceil(side / step)), 1) for side in sides)
        return cls(middle - step / 2 * np.array([columns - 1, rows - 1]), step, (columns, rows))

    def middles(self) -> Array:
        """(cells, 2) the middles of all cells."""
        return np.asarray(self.low + self.step * np.indices(self.shape).reshape(2, -1).T)

    def cells(self, points: Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        """The numbers (N,) of the cells that contain points (N, 2), and whether the points are inside of the grid."""
        cell = np.rint((points - self.low) / self.step).astype(np.int64)
        inside = (cell[..., 0] >= 0) & (cell[..., 0] < self.shape[0])
        inside &= (cell[..., 1] >= 0) & (cell[..., 1] < self.shape[1])
        return np.where(inside, cell[..., 0] * self.shape[1] + cell[..., 1], 0), inside

    def lookup(self, values: Array, points: Array, outside: float) -> Array:
        """(N,) the values of the cells that contain points (N, 2), and ``outside`` beyond the grid."""
        cell, inside = self.cells(points)
        return np.where(inside, values.reshape(-1)[cell], outside)


@dataclass(frozen=True, eq=False)
class FingerMaps:
    """The closing fingers; arrays have one entry for each of K widths, from open to closed.

    ``shares`` of the closing motion are from 0 to 1, ``widths`` (m) are the distances of the pads, ``middles`` (m) the
    y between them, and ``pads`` (K, 4) the smallest and largest x and z of the pads. ``swept`` (K, 2, 2, X, Z) is, by
    width and side, the smallest and largest y of the fingers until then; the first side closes in the direction of y.
    ``symmetric`` hands are the same after half a rotation about the approach.
    """

    grid: Grid
    shares: Array
    widths: Array
    middles: Array
    pads: Array
    swept: Array
    symmetric: bool

    def widened(self, by: float) -> FingerMaps:
        """Fingers that are larger by a distance (m) along x and z."""
        from scipy.ndimage import maximum_filter, minimum_filter

        size = (1, 1, _cells(by, self.grid), _cells(by, self.grid))
        least = minimum_filter(self.swept[:, :, 0], size=size)
        most = maximum_filter(self.swept[:, :, 1], size=size)
        return replace(self, swept=np.stack([least, most], axis=2))

    def share(self, width: float) -> float:
        """The share of the closing motion at a width."""
        return float(np.interp(-width, -self.widths, self.shares))

    def at(self, width: float | Array) -> tuple[Array, Array]:
        """Middles (N,) and pads (N, 4) of widths (N,)."""
        order, wanted = slice(None, None, -1), np.atleast_1d(width)
        columns = np.column_stack([self.middles, self.pads])[order]
        found = np.column_stack([np.interp(wanted, self.widths[order], column) for column in columns.T])
        return found[:, 0], found[:, 1:]


@dataclass(frozen=True, eq=False)
class HandMaps:
    """A hand: ``tcp_from_hand``, the map of its front, and its fingers, if it has any.

    ``palm`` are its bodies that do not move while it closes, in the frame of the hand, and ``closing`` the fingers.
    """

    tcp_from_hand: SE3
    grid: Grid
    front: Array
    fingers: FingerMaps | None
    palm: tuple[PlacedSurface, ...] = ()
    closing: tuple[MovingFinger, ...] = ()

    @classmethod
    def of(cls, tool: Any, arm: Arm | None) -> HandMaps:
        """The maps of a tool; ``arm`` is needed for fingers and palms that are links of a robot.

        InputError if the fingers of the tool do not close towards each other across the approach direction.
        """
        fingers = None if tool.fingers is None else replace(tool.fingers, grip=0.0)
        closing = fingers_of(arm, fingers, {} if arm is None else closed_completely(tool, arm))
        axes = np.array(tool.tip.rotation)
        if closing:
            # y is the direction in which the first finger closes, across the approach
            across = np.array([body.direction - (body.direction @ axes[:, 2]) * axes[:, 2] for body in closing])
            lengths = np.linalg.norm(across, axis=1)
            y = across[lengths.argmax()] / max(float(lengths.max()), 1e-12)
            if not (lengths.max() > 0.5 and (across @ y).min() < -0.5):
                names = ", ".join(dict.fromkeys(body.name for body in closing))
                raise InputError(
                    f"the fingers {names} do not close towards each other across the z axis of the tip; grasps are "
                    "proposed for two fingers that do, for a cup, and for a plain tip"
                )
            axes = np.column_stack([np.cross(y, axes[:, 2]), y, axes[:, 2]])
        tcp_from_hand = SE3(axes, np.array(tool.tip.translation))
        # The bodies that do not move, and the open fingers
        palm = [PlacedSurface(LineSurface.of_obstacle(body), body.pose) for body in tool.tool]
        if arm is not None:
            palm = [body.placed for body in hand_bodies(arm, tool, tool.gripper) if body.name != FACE]
        palm = [body.moved(tcp_from_hand.inverse()) for body in palm]
        if not (placed := [*palm, *_placed(closing, 0.0, tcp_from_hand)]):
            return cls(tcp_from_hand, Grid(np.zeros(2), FINEST, (1, 1)), np.full((1, 1), -np.inf), None)
        grid = Grid.around(np.concatenate([body.points[:, :2] for body in placed]))
        front = -_first_met(placed, grid, (0, 1), np.array([0.0, 0.0, -1.0]))
        maps = _finger_maps(closing, tcp_from_hand) if closing else None
        return cls(tcp_from_hand, grid, front, maps, tuple(palm), closing)

    def fingers_at(self, share: float) -> list[PlacedSurface]:
        """The bodies of the fingers at a share of the closing motion, in the frame of the hand."""
        return _placed(self.closing, share, self.tcp_from_hand)

    def widened(self, by: float) -> HandMaps:
        """A hand whose front is larger by a distance (m) along x, y and z."""
        from scipy.ndimage import maximum_filter

        return replace(self, front=maximum_filter(self.front, size=_cells(by, self.grid)) + by)


def closed_completely(tool: Any, arm: Arm) -> dict[str, float]:
    """The limits of the gripping joints towards which they close."""
    closed = dict[str, float]()
    for name, value in tool.grip.items():
        joint, start = arm.robot.urdf.joints[name], arm.held[name]
        limits = [limit for limit in (joint.lower, joint.upper) if limit is not None]
        if value is not None:  # the limit beyond the stated value
            limits = [limit for limit in limits if (limit - value) * (value - start) >= 0.0] or [value]
        if not limits:
            raise InputError(f"{name} has no limit up to which it could close; state its grip")
        closed[name] = max((abs(limit - start), limit) for limit in limits)[1]
    return closed


def _placed(fingers: Sequence[MovingFinger], share: float, tcp_from_hand: SE3) -> list[PlacedSurface]:
    """The bodies of fingers at a share of the closing motion, in the frame of the hand."""
    return [body.moved(tcp_from_hand.actInv(finger.at(share))) for finger in fingers for body in finger.surfaces]


def _finger_maps(closing: Sequence[MovingFinger], tcp_from_hand: SE3) -> FingerMaps:
    """The maps of the fingers for widths from open to closed."""
    y = np.array(tcp_from_hand.rotation[:, 1])
    shares = np.linspace(0.0, 1.0, LEVELS)
    levels = [_placed(closing, share, tcp_from_hand) for share in shares]
    grid = Grid.around(np.concatenate([body.points[:, [0, 2]] for level in levels for body in level]))
    first = [bool(finger.direction @ y > 0.0) for finger in closing for _ in finger.surfaces]
    widths, middles = list[float](), list[float]()
    pads, passed = list[Array](), list[list[list[Array]]]()
    for level in levels:
        # The smallest and the largest y of both sides
        both = []
        for side in (True, False):
            own = [body for body, is_first in zip(level, first, strict=True) if is_first is side]
            both.append([_first_met(own, grid, (0, 2), Y), -_first_met(own, grid, (0, 2), -Y)])
        low, high = both[0][1], both[1][0]
        # The pads are the faces that reach farthest ahead: an area over which the distance is equal, not a small one
        gaps = np.where(np.isfinite(low) & np.isfinite(high), high - low, np.inf)
        order = np.argsort(gaps, axis=None)[: int(np.isfinite(gaps).sum())]
        inside, ahead = gaps.reshape(-1)[order], grid.middles()[order, 1]
        if not len(inside):
            raise InputError("the fingers do not face each other: no line across the approach meets both")
        equal = np.searchsorted(inside, inside + PAD_FLATNESS, side="right") - np.arange(len(inside))
        width, farthest, k = float(inside[0]), -np.inf, 0
        while k < len(inside):
            large = equal[k] >= LEAST_PAD * equal.max()
            if large and (end := float(ahead[k : k + equal[k]].max())) > farthest + grid.step / 2:
                width, farthest = float(inside[k]), end
            k += int(equal[k]) if large else 1
        if width < -PAD_FLATNESS and widths:
            break
        on_pad = (gaps >= width) & (gaps <= width + PAD_FLATNESS)
        near = grid.middles().reshape(*grid.shape, 2)[on_pad]
        ends = np.array([near.min(axis=0) - grid.step / 2, near.max(axis=0) + grid.step / 2])
        widths.append(max(width, 0.0))  # the pads touch each other where they are closed
        middles.append(float((low[on_pad] + high[on_pad]).mean() / 2))
        pads.append(ends.T.reshape(-1))
        passed.append(both)
    faces = np.array(passed)
    least, most = np.minimum.accumulate(faces[:, :, 0]), np.maximum.accumulate(faces[:, :, 1])
    # The same after half a rotation about the approach: the second side is the first one, mirrored
    first_open, second_open = faces[0, 0, 1], -faces[0, 1, 0][::-1]
    same = np.isclose(first_open, second_open, atol=PAD_FLATNESS) | (first_open == second_open)
    off = [abs(2 * grid.low[0] + grid.step * (grid.shape[0] - 1)), np.abs(middles).max()]
    symmetric = bool(same.all() and max(off) < PAD_FLATNESS)
    swept = np.stack([least, most], axis=2)
    return FingerMaps(
        grid, shares[: len(widths)], np.array(widths), np.array(middles), np.array(pads), swept, symmetric
    )


def _first_met(bodies: Sequence[PlacedSurface], grid: Grid, plane: tuple[int, int], direction: Array) -> Array:
    """The depth at which lines from the cells of a grid first meet any of the bodies, inf without."""
    lines = np.zeros((grid.shape[0] * grid.shape[1], 3))
    lines[:, plane] = grid.middles()
    depth = np.full(len(lines), np.inf)
    for body in bodies:
        # Only lines within the box of the body can meet it
        ends, across = body.points[:, plane], lines[:, plane]
        near = ((across >= ends.min(axis=0)) & (across <= ends.max(axis=0))).all(axis=1)
        depth[near] = np.minimum(depth[near], body.enter(lines[near], direction).depth)
    return depth.reshape(grid.shape)


def _cells(by: float, grid: Grid) -> int:
    """The size of a filter that widens a map by a distance."""
    return 2 * int(np.ceil(by / grid.step)) + 1
