"""The route of the tcp in space: straight segments between poses, with optionally rounded corners.

On every piece, with a local parameter u from 0 to 1, the pose is

    position     c - a(u) t + b(u) t'
    orientation  C exp(-a(u) w) exp(b(u) w')

where (c, C) is a pose, (t, w) the direction of the incoming and (t', w') of the outgoing segment, each a
translation in the base frame and a rotation vector in the tcp frame. On a segment, a = 0 and b is linear. In the
rounding of a corner, a decreases from the reach d to 0 and b increases from 0 to d, with the Bernstein coefficients of
:func:`pinproof.motion.round_corner`, so that segments and roundings together are twice differentiable.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from pinproof._core import Route as CompiledRoute
from pinproof.motion import REVERSAL, corner_spacing
from pinproof.spatial import SE3, Array, log6, matrix

LEVER = 0.25
"""Weight of rotations (m/rad) in the length of a segment, about the size of a gripper. It affects the spacing of poses
only."""

MIN_LENGTH = 1e-7
"""Length (m) below which a segment or a rounding is omitted: a tenth of the tolerance with which poses are reached."""


@dataclass(frozen=True, eq=False)
class PoseSegment:
    """The straight segment from one pose to another.

    ``length`` (m) is its length including the weighted rotation; ``translation`` and ``rotation`` (3,) are per metre.
    """

    start: Array
    end: Array
    translation: Array
    rotation: Array
    length: float

    @classmethod
    def between(cls, first: SE3, last: SE3) -> PoseSegment:
        """The segment on which the orientation rotates about one fixed axis."""
        translation, rotation = last.translation - first.translation, log6(first.inverse() * last)[3:]
        length = float(np.hypot(np.linalg.norm(translation), LEVER * np.linalg.norm(rotation)))
        length = length if length > MIN_LENGTH else 0.0
        per = 1.0 / length if length > 0.0 else 0.0
        return cls(matrix(first), matrix(last), translation * per, rotation * per, length)

    def piece_count(self, translation_step: float, rotation_step: float) -> int:
        """The number of equal pieces that do not exceed the steps (m, rad)."""
        distance = self.length * float(np.linalg.norm(self.translation))
        angle = self.length * float(np.linalg.norm(self.rotation))
        return int(np.ceil(max(distance / translation_step, angle / rotation_step)))

    @property
    def vectors(self) -> Array:
        """(2, 3) the translation and the rotation per metre."""
        return np.stack([self.translation, self.rotation])

    @property
    def direction(self) -> Array:
        """(6,) the direction as a unit vector, with the rotation weighted by :data:`LEVER`."""
        return np.concatenate([self.translation, LEVER * self.rotation])


@dataclass(frozen=True, eq=False)
class _RoutePiece:
    """The pose (c, C), the incoming and outgoing segments, and the coefficients (6,) of a and b (m); see the module."""

    pose: Array
    into: PoseSegment
    out: PoseSegment
    a: Array
    b: Array
    width: float

    def derivatives(self) -> tuple[float, float, float]:
        """Bounds of ``|p''|``, ``|w|`` and ``|w'|`` for position p and angular velocity w by the local parameter."""
        first, second = 5.0 * np.diff([self.a, self.b], axis=1), 20.0 * np.diff([self.a, self.b], 2, axis=1)
        speed, acceleration = np.abs(first).max(axis=1), np.abs(second).max(axis=1)
        translation = np.array([np.linalg.norm(self.into.translation), np.linalg.norm(self.out.translation)])
        rotation = np.array([np.linalg.norm(self.into.rotation), np.linalg.norm(self.out.rotation)])
        return (
            float(acceleration @ translation),
            float(speed @ rotation),
            float(acceleration @ rotation + speed[0] * rotation[0] * speed[1] * rotation[1]),
        )


class Route:
    """A twice differentiable sequence of segments and roundings; the parameter, 0 to 1, is proportional to the length.

    ``passes`` are the parameters at which the route passes poses: the middle of each rounding, and the end.
    """

    def __init__(self, pieces: list[_RoutePiece]) -> None:
        self._pieces = pieces
        ends = np.cumsum([piece.width for piece in pieces])
        self.length = float(ends[-1])
        share = ends / self.length if self.length > 0.0 else np.arange(1.0, len(pieces) + 1) / len(pieces)
        self.borders: Array = np.concatenate([[0.0], share[:-1], [1.0]])
        rounded = [k for k, piece in enumerate(pieces) if piece.into is not piece.out]
        self.passes = (*((self.borders[k] + self.borders[k + 1]) / 2 for k in rounded), 1.0)

    @classmethod
    def straight(cls, first: SE3, last: SE3) -> Route:
        """The route of a single segment."""
        segment = PoseSegment.between(first, last)
        return cls([_straight_piece(segment, 0.0, segment.length)])

    @cached_property
    def compiled(self) -> CompiledRoute:
        """The route as the compiled core uses it."""
        pieces = self._pieces
        return CompiledRoute(
            np.array([piece.pose for piece in pieces]),
            np.array([[each.into.vectors, each.out.vectors] for each in pieces]).reshape(-1, 4, 3),
            np.array([[piece.a, piece.b] for piece in pieces]),
            self.borders,
            self._derivatives,
        )

    def poses(self, s: Array) -> Array:
        """(N, 4, 4) ``base_from_tcp`` at parameters (N,)."""
        return np.asarray(self.compiled.poses(s))

    @cached_property
    def _derivatives(self) -> Array:
        """(k, 3) bounds of ``|p''|``, ``|w|`` and ``|w'|`` on each piece."""
        width = np.diff(self.borders)
        return np.array([piece.derivatives() for piece in self._pieces]) / np.stack([width**2, width, width**2], 1)

    def derivatives(self, knots: Array) -> Array:
        """(k, 3) bounds of ``|p''|``, ``|w|`` and ``|w'|`` between knots (k+1,), which must include all borders."""
        middle = 0.5 * (knots[1:] + knots[:-1])
        piece = np.clip(np.searchsorted(self.borders, middle, side="right") - 1, 0, len(self._pieces) - 1)
        result: Array = self._derivatives[piece]
        return result

    def knots(self, translation_step: float, rotation_step: float, min_pieces: int) -> Array:
        """The borders and parameters between them, such that no piece exceeds the steps (m, rad)."""
        parts = []
        for piece, low, high in zip(self._pieces, self.borders[:-1], self.borders[1:], strict=True):
            share = piece.width / max(piece.out.length, np.finfo(float).tiny)
            count = piece.out.piece_count(translation_step, rotation_step) * share
            count = max(count, min_pieces / len(self._pieces), 1)
            parts.append(np.linspace(low, high, int(np.ceil(count)), endpoint=False))
        return np.concatenate([*parts, [1.0]])


def routes_through(poses: list[SE3], rounding: float, rotation_rounding: float) -> list[Route]:
    """The routes through poses, divided where the tcp stops.

    A corner is rounded if its pose is missed by at most ``rounding`` (m) and ``rotation_rounding`` (rad). With 0, no
    corner is rounded. A corner at which the direction is reversed is never rounded.
    """
    segments = [PoseSegment.between(first, last) for first, last in pairwise(poses)]
    reach = np.zeros(len(poses))
    tiny = np.finfo(float).tiny
    for i, (into, out) in enumerate(pairwise(segments), 1):
        # The distance before and after a pose at which its rounding begins and ends.
        reversed_there = np.linalg.norm(into.direction + out.direction) < REVERSAL
        if min(into.length, out.length, rounding, rotation_rounding) <= 0.0 or reversed_there:
            continue
        share = (16.0 - 25.0 * float(corner_spacing(into.direction, out.direction))) / 32.0  # of it, in the middle
        distance = share * float(np.linalg.norm(out.translation - into.translation))
        angle = share * float(np.linalg.norm(into.rotation) + np.linalg.norm(out.rotation))
        allowed = rounding / max(distance, tiny), rotation_rounding / max(angle, tiny)
        longest = min(*allowed, into.length / 2, out.length / 2)
        reach[i] = longest if longest > MIN_LENGTH else 0.0
    routes: list[Route] = []
    pieces: list[_RoutePiece] = []
    for i, segment in enumerate(segments):
        low, high = reach[i], segment.length - reach[i + 1]
        if high - low > MIN_LENGTH or segment.length == 0.0:
            pieces.append(_straight_piece(segment, low, high))
        if reach[i + 1] > 0.0:
            pieces.append(_rounding(segment, segments[i + 1], reach[i + 1]))
        else:
            routes.append(Route(pieces))
            pieces = []
    return routes


def _straight_piece(segment: PoseSegment, low: float, high: float) -> _RoutePiece:
    return _RoutePiece(segment.start, segment, segment, np.zeros(6), np.linspace(low, high, 6), high - low)


def _rounding(into: PoseSegment, out: PoseSegment, reach: float) -> _RoutePiece:
    h = reach * float(corner_spacing(into.direction, out.direction))
    increasing = np.array([0.0, 0.0, 0.0, reach - 2 * h, reach - h, reach])
    return _RoutePiece(out.start, into, out, increasing[::-1], increasing, 5.0 * h)
