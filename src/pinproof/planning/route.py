"""The way of the tcp in space: straight legs between poses, and corners rounded between them.

On every piece, with a local parameter u from 0 to 1, the pose is

    position     c - a(u) t + b(u) t'
    orientation  C exp(-a(u) w) exp(b(u) w')

where (c, C) is a pose, (t, w) the direction of the leg into it and (t', w') that of the leg out of it: translation in
the base's axes, rotation vector in the tcp's. On a leg a = 0 and b grows evenly. In the rounding of a corner a falls
from the reach d to 0 and b rises from 0 to d, with the Bernstein coefficients of :mod:`pinproof.motion.corner`: then
legs and roundings together are twice differentiable.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.motion import bezier, corner
from pinproof.spatial import SE3, log6, matrix

__all__ = ["Leg", "Route", "sections"]

Array = npt.NDArray[np.float64]

LEVER = 0.25
"""Metres per radian: what turning counts for in the length of a leg. About a hand's size; it only spaces the poses."""


NOTHING = 1e-7
"""Metres: a leg or a rounding that is shorter is none. A tenth of the precision that poses are reached with."""


@dataclass(frozen=True, eq=False)
class Leg:
    """The straight way from one pose to another.

    ``size`` (m) is its length, turning included; ``translation`` and ``rotation`` (3,) are per metre of it.
    """

    start: Array
    end: Array
    translation: Array
    rotation: Array
    size: float

    @classmethod
    def between(cls, first: SE3, last: SE3) -> Leg:
        """The leg whose orientation turns about one fixed axis."""
        translation, rotation = last.translation - first.translation, log6(first.inverse() * last)[3:]
        size = float(np.hypot(np.linalg.norm(translation), LEVER * np.linalg.norm(rotation)))
        size = size if size > NOTHING else 0.0
        per = 1.0 / size if size > 0.0 else 0.0
        return cls(matrix(first), matrix(last), translation * per, rotation * per, size)

    def pieces(self, translation_step: float, rotation_step: float) -> int:
        """Into how many pieces it is cut for none to be longer."""
        distance = self.size * float(np.linalg.norm(self.translation))
        angle = self.size * float(np.linalg.norm(self.rotation))
        return int(np.ceil(max(distance / translation_step, angle / rotation_step)))

    @property
    def way(self) -> Array:
        """(6,) its direction as a unit vector, turning times :data:`LEVER`."""
        return np.concatenate([self.translation, LEVER * self.rotation])


@dataclass(frozen=True, eq=False)
class _Piece:
    """See the module: the pose (c, C), the legs in and out, and the coefficients (6,) of a and b (m)."""

    pose: Array
    into: Leg
    out: Leg
    a: Array
    b: Array
    width: float

    def poses(self, u: Array) -> Array:
        """(N, 4, 4) at the local parameters (N,)."""
        both = bezier.evaluate(np.array([0.0, 1.0]), np.stack([self.a, self.b], axis=1)[None], u)
        a, b = both[:, 0], both[:, 1]
        out = np.tile(np.eye(4), (len(u), 1, 1))
        turned = _turns(self.into.rotation, -a) @ _turns(self.out.rotation, b)
        out[:, :3, :3] = self.pose[:3, :3] @ turned
        out[:, :3, 3] = self.pose[:3, 3] - a[:, None] * self.into.translation + b[:, None] * self.out.translation
        return out

    def derivatives(self) -> tuple[float, float, float]:
        """Bounds of |p''|, |w| and |w'|, for the position p and the angular velocity w by the local parameter."""
        first, second = 5.0 * np.diff([self.a, self.b], axis=1), 20.0 * np.diff([self.a, self.b], 2, axis=1)
        speed, acceleration = np.abs(first).max(axis=1), np.abs(second).max(axis=1)
        moves = np.array([np.linalg.norm(self.into.translation), np.linalg.norm(self.out.translation)])
        turns = np.array([np.linalg.norm(self.into.rotation), np.linalg.norm(self.out.rotation)])
        return (
            float(acceleration @ moves),
            float(speed @ turns),
            float(acceleration @ turns + speed[0] * turns[0] * speed[1] * turns[1]),
        )


class Route:
    """A twice differentiable sequence of legs and roundings, over a parameter from 0 to 1 in proportion to the length.

    ``passes`` are the parameters at which it reaches poses: the middle of each rounding, and the end.
    """

    def __init__(self, pieces: list[_Piece]) -> None:
        self._pieces = pieces
        ends = np.cumsum([piece.width for piece in pieces])
        self.size = float(ends[-1])
        share = ends / self.size if self.size > 0.0 else np.arange(1.0, len(pieces) + 1) / len(pieces)
        self.borders: Array = np.concatenate([[0.0], share[:-1], [1.0]])
        rounded = [k for k, piece in enumerate(pieces) if piece.into is not piece.out]
        self.passes = (*((self.borders[k] + self.borders[k + 1]) / 2 for k in rounded), 1.0)

    @classmethod
    def straight(cls, first: SE3, last: SE3) -> Route:
        """A single leg."""
        return cls([_whole(Leg.between(first, last))])

    def poses(self, s: Array) -> Array:
        """(N, 4, 4) ``base_from_tcp`` at parameters (N,), not decreasing."""
        piece = self._piece_at(s)
        local = np.clip((s - self.borders[piece]) / np.diff(self.borders)[piece], 0.0, 1.0)
        parts = [self._pieces[k].poses(local[piece == k]) for k in range(len(self._pieces)) if (piece == k).any()]
        return np.concatenate(parts) if parts else np.empty((0, 4, 4))

    def derivatives(self, knots: Array) -> Array:
        """(k, 3) bounds of |p''|, |w| and |w'| by the parameter between knots (k+1,), among which all borders are."""
        width = np.diff(self.borders)
        bounds = np.array([piece.derivatives() for piece in self._pieces]) / np.stack([width**2, width, width**2], 1)
        result: Array = bounds[self._piece_at(0.5 * (knots[1:] + knots[:-1]))]
        return result

    def knots(self, translation_step: float, rotation_step: float, least: int) -> Array:
        """The borders, and parameters between them no farther apart than these steps (m, rad); ``least`` pieces."""
        cuts = []
        for piece, low, high in zip(self._pieces, self.borders[:-1], self.borders[1:], strict=True):
            share = piece.width / max(piece.out.size, np.finfo(float).tiny)
            count = max(piece.out.pieces(translation_step, rotation_step) * share, least / len(self._pieces), 1)
            cuts.append(np.linspace(low, high, int(np.ceil(count)), endpoint=False))
        return np.concatenate([*cuts, [1.0]])

    def _piece_at(self, s: Array) -> npt.NDArray[np.int_]:
        return np.clip(np.searchsorted(self.borders, s, side="right") - 1, 0, len(self._pieces) - 1)


def sections(poses: list[SE3], rounding: float, rotation_rounding: float) -> list[Route]:
    """The way through poses, cut where the tcp stops; a corner is rounded where that misses its pose by no more.

    ``rounding`` (m) and ``rotation_rounding`` (rad) of 0 keep every corner, and so does one that turns back.
    """
    legs = [Leg.between(first, last) for first, last in pairwise(poses)]
    reach = np.zeros(len(poses))
    for i in range(1, len(legs)):
        reach[i] = _reach(legs[i - 1], legs[i], rounding, rotation_rounding)
    routes: list[Route] = []
    pieces: list[_Piece] = []
    for i, leg in enumerate(legs):
        low, high = reach[i], leg.size - reach[i + 1]
        if high - low > NOTHING or leg.size == 0.0:
            pieces.append(_part(leg, low, high))
        if reach[i + 1] > 0.0:
            pieces.append(_rounding(leg, legs[i + 1], reach[i + 1]))
        else:
            routes.append(Route(pieces))
            pieces = []
    return routes


def _reach(into: Leg, out: Leg, rounding: float, rotation_rounding: float) -> float:
    """How far before and behind a pose its rounding begins and ends; 0 for none."""
    if min(into.size, out.size, rounding, rotation_rounding) <= 0.0:
        return 0.0
    if np.linalg.norm(into.way + out.way) < corner.TURNS_BACK:
        return 0.0
    share = (16.0 - 25.0 * float(corner.spacing(into.way, out.way))) / 32.0  # of the reach, in the middle
    miss = share * float(np.linalg.norm(out.translation - into.translation))
    turn = share * float(np.linalg.norm(into.rotation) + np.linalg.norm(out.rotation))
    tiny = np.finfo(float).tiny
    reach = min(rounding / max(miss, tiny), rotation_rounding / max(turn, tiny), into.size / 2, out.size / 2)
    return reach if reach > NOTHING else 0.0


def _whole(leg: Leg) -> _Piece:
    return _part(leg, 0.0, leg.size)


def _part(leg: Leg, low: float, high: float) -> _Piece:
    return _Piece(leg.start, leg, leg, np.zeros(6), np.linspace(low, high, 6), high - low)


def _rounding(into: Leg, out: Leg, reach: float) -> _Piece:
    h = reach * float(corner.spacing(into.way, out.way))
    rising = np.array([0.0, 0.0, 0.0, reach - 2 * h, reach - h, reach])
    return _Piece(out.start, into, out, rising[::-1], rising, 5.0 * h)


def _turns(vector: Array, shares: Array) -> Array:
    """(N, 3, 3) rotations by ``shares`` (N,) of a rotation vector (3,), by Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle > 0.0 else vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    by = (angle * shares)[:, None, None]
    result: Array = np.eye(3) + np.sin(by) * cross + (1.0 - np.cos(by)) * (cross @ cross)
    return result
