"""A corner between two straight segments, rounded by one quintic piece.

Seen from the corner p, with unit directions u into it and v out of it, a rounding of reach d has the control points

    p - d u,  p - (d - h) u,  p - (d - 2 h) u,  p + (d - 2 h) v,  p + (d - h) v,  p + d v

Three of them on each leg, h apart: at both ends the curve has the direction of the leg and no second derivative, so
that straight stretch, corner and straight stretch together are twice differentiable by the parameter. Over a parameter
of width 5 h the speed there is 1, as on the straight stretches. h = c d is chosen such that the speed in the middle,

    |u + v| (6 / c - 7) / 16,

is 1 as well, for a parameter close to the arc length: c = 6 / (7 + 16 / |u + v|), from 0.4 straight on to 0 turning
back. By symmetry the middle is the point nearest to p, and it misses p by d |v - u| (16 - 25 c) / 32.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError

__all__ = ["TURNS_BACK", "miss", "round_off", "rounding", "spacing"]

Array = npt.NDArray[np.float64]

TURNS_BACK = 0.1
"""|u + v| below which a corner is not rounded: the path turns back on itself to within 6 degrees, and the arm all but
stops whatever is done there."""

MEETS = 1e-12
"""rad or m: a straight stretch shorter than this between two roundings is none."""


def spacing(into: Array, out: Array) -> Array:
    """(k,) h / d, for unit directions (k, n) into and out of corners."""
    result: Array = 6.0 / (7.0 + 16.0 / np.linalg.norm(into + out, axis=-1))
    return result


def miss(into: Array, out: Array) -> Array:
    """(k,) by how far roundings of reach 1 miss their corners, for unit directions (k, n) into and out of them."""
    result: Array = np.linalg.norm(out - into, axis=-1) * (16.0 - 25.0 * spacing(into, out)) / 32.0
    return result


def rounding(at: Array, into: Array, out: Array, reach: float) -> tuple[float, Array]:
    """The width of its parameter, and the control points (6, n), of the rounding of a corner ``at`` (n,)."""
    h = reach * float(spacing(into, out))
    before, behind = reach - h * np.arange(3.0)[:, None], reach - h * np.arange(2.0, -1.0, -1.0)[:, None]
    return 5.0 * h, np.concatenate([at - before * into, at + behind * out])


def round_off(q: Array, reach: Array) -> tuple[Array, Array]:
    """Knots (k+1,) and control points (k, 6, n) of straight segments through q (m, n), corners rounded by reach (m,).

    Raises
    ------
    InputError
        See :meth:`pinproof.motion.BlendedPath.rounded`.
    """
    if (reach < 0).any() or reach[0] != 0 or reach[-1] != 0:
        raise InputError(f"reach = {reach}; it must be 0 or more, and 0 at both ends")
    if len(q) == 1:
        return np.zeros(2), np.repeat(q[:, None], 6, axis=1)
    steps = np.diff(q, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if not (lengths > 0).all():
        i = int(np.flatnonzero(lengths <= 0)[0])
        raise InputError(f"the waypoints {i} and {i + 1} are equal: drop one")
    way = steps / lengths[:, None]
    rest = lengths - reach[:-1] - reach[1:]
    if (rest < -MEETS).any():
        i = int(np.flatnonzero(rest < -MEETS)[0])
        raise InputError(f"the roundings {reach[i]} and {reach[i + 1]} overlap on a segment of {lengths[i]}")
    widths, pieces, here = [], [], q[0]
    for i, towards in enumerate(way):
        there = q[i + 1] - reach[i + 1] * towards if reach[i + 1] else q[i + 1]
        if rest[i] > MEETS:
            share = np.linspace(0.0, 1.0, 6)[:, None]
            pieces.append(here * (1.0 - share) + there * share)
            widths.append(rest[i])
        if reach[i + 1]:
            away = way[i + 1]
            if np.linalg.norm(towards + away) < TURNS_BACK:
                raise InputError(f"the path turns back on itself at waypoint {i + 1}; it cannot be rounded there")
            width, piece = rounding(q[i + 1], towards, away, reach[i + 1])
            piece[0] = pieces[-1][-1] if pieces else q[0]  # bit for bit
            pieces.append(piece)
            widths.append(width)
            there = piece[-1]
        here = there
    pieces[-1][-1] = q[-1]
    return np.concatenate([[0.0], np.cumsum(widths)]), np.array(pieces)
