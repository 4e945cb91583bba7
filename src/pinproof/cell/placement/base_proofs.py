r"""Proofs that the base is in contact at every placement of a cell.

The base with the bodies that move with it, and the scene, are rigid. Let a placement have the position t and the yaw
:math:`\psi`. A point m of the base is in the frame of the cell at :math:`t + R(\psi) m`, and a point c of the scene is
in the frame of the base at :math:`R(-\psi) (c - t)`. For placements with positions in a box with half sides h and yaws
within w of that of its centre, the first is in a box with half sides

.. math:: h + s \, (1, 1, 0), \qquad s = 2 \sin(w / 2) \, \|m_{xy}\|

around its value at the centre. The second is in a box with half sides :math:`|R(-\psi)| h + s \, (1, 1, 0)`, where s
has the largest length of :math:`c - t` along the floor instead of :math:`\|m_{xy}\|`. If this box lies in a body on the
other side, grown by the radius of a ball around the point, the two bodies overlap at each of these placements. Boxes
and balls inside the bodies are those of :mod:`pinproof.collision.geometry.inner_shapes`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pinproof.cell.placement.placed_robot import PlacedRobot
from pinproof.collision import CollisionChecker
from pinproof.collision.geometry.bodies import Body
from pinproof.collision.geometry.inner_shapes import ROUNDING, InnerShapes, inner_shapes
from pinproof.spatial import Array, matrix

INSIDE = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0)
"""Points of a box that are tried along each axis, as multiples of its half side."""

THIN = 0.02
"""Metres: along axes with a smaller half side only the middle is tried."""


@dataclass(frozen=True, eq=False)
class _Solid:
    """The shapes inside a body, and the pose (4, 4) of the body in the placement frame or in that of the cell."""

    shapes: InnerShapes
    pose: Array

    @cached_property
    def points(self) -> tuple[Array, Array]:
        """(k, 3) centres of balls inside the body, in the frame of ``pose``, and their radii (k,)."""
        shapes = self.shapes
        centres, radii = [shapes.balls[:, :3]], [shapes.balls[:, 3]]
        if shapes.box_half is not None:
            half = np.minimum(shapes.box_half, 10.0)  # that of a half-space is very large
            along = [INSIDE if side > THIN else (0.0,) for side in half]
            steps = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 3)
            centres.append(shapes.box_centre + steps * half)
            radii.append(np.full(len(steps), shapes.box_radius))
        return np.vstack(centres) @ self.pose[:3, :3].T + self.pose[:3, 3], np.concatenate(radii)

    def contains(self, centres: Array, halves: Array, radii: Array) -> bool:
        """Whether one of the boxes (k, 3), grown by balls with these radii (k,), overlaps the body at each point."""
        shapes = self.shapes
        turn = self.pose[:3, :3].T
        local = (centres - self.pose[:3, 3]) @ turn.T
        extent = halves @ np.abs(turn).T
        boxes = [(ball[:3], np.zeros(3), float(ball[3])) for ball in shapes.balls]
        if shapes.box_half is not None:
            boxes.append((shapes.box_centre, shapes.box_half, shapes.box_radius))
        least, most = extent.min(axis=0, initial=np.inf), radii.max(initial=0.0)
        for centre, half, radius in boxes:
            if np.linalg.norm(np.maximum(least - half, 0.0)) > radius + most:
                continue  # no box is small enough
            outside = np.maximum(np.abs(local - centre) + extent - half, 0.0)
            if (np.linalg.norm(outside, axis=1) <= radius + radii - ROUNDING).any():
                return True
        return False


class BaseContacts:
    """The pairs of bodies of the base and of the scene that may be in contact at all placements of a cell.

    Parameters
    ----------
    placed
        The robot.
    checkers
        The checkers whose pairs count; only overlap counts, not the margin.
    """

    def __init__(self, placed: PlacedRobot, *checkers: CollisionChecker) -> None:
        self._checkers: list[CollisionChecker] = []
        self._home = placed.original.home
        self._pairs: list[tuple[tuple[str, str], _Solid, _Solid]] = []
        still = np.concatenate([np.zeros(4), self._home])
        solids: dict[int, _Solid] = {}

        def solid(body: Body) -> _Solid:
            if id(body) not in solids:
                on = np.eye(4) if body.link is None else matrix(placed.wide_arm.frame_placement(still, body.link))
                solids[id(body)] = _Solid(inner_shapes(body), on @ matrix(body.link_from_body))
            return solids[id(body)]

        for checker in checkers:
            arm_pairs = []
            for number, pair in enumerate(checker.pairs):
                base, other = (checker.bodies[k] for k in pair)
                if base.link is None:
                    base, other = other, base
                if base.link in placed.base_links and other.link is None and checker.margins[number] >= 0.0:
                    self._pairs.append(((base.owner, other.owner), solid(base), solid(other)))
                else:
                    arm_pairs.append(number)
            self._checkers.append(checker.without_pairs(arm_pairs))

    def within(self, lower: Array, upper: Array) -> tuple[str, str] | None:
        """Two bodies that overlap at every placement between ``lower`` and ``upper`` (4,); None if none are found."""
        centre, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        c, s = np.cos(centre[3]), np.sin(centre[3])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        spread = 2.0 * np.sin(min(half[3], np.pi) / 2.0)
        q = np.concatenate([centre, self._home])
        touching = {frozenset(contact.bodies) for checker in self._checkers for contact in checker.check(q).contacts}
        for names, base, other in self._pairs:
            if frozenset(names) not in touching:
                continue
            points, radii = base.points
            wide = half[:3] + spread * _along_floor(points)
            if other.contains(points @ turn.T + centre[:3], wide, radii):
                return names
            points, radii = other.points
            away = points - centre[:3]
            wide = half[:3] @ np.abs(turn) + spread * _along_floor(np.abs(away) + half[:3])
            if base.contains(away @ turn, wide, radii):
                return names
        return None


def _along_floor(points: Array) -> Array:
    """(k, 3) the distance of points from the vertical axis, as extents along x and y."""
    return np.linalg.norm(points[:, :2], axis=1)[:, None] * np.array([1.0, 1.0, 0.0])
