"""The rounding of a corner between two straight segments by one quintic piece.

For a corner p with the incoming unit direction u and the outgoing unit direction v, a rounding of reach d has the
control points

    p - d u,  p - (d - h) u,  p - (d - 2 h) u,  p + (d - 2 h) v,  p + (d - h) v,  p + d v

Three of them are on each segment, at a distance h. Hence the curve has the direction of the segment and no second
derivative at both ends, and segment, rounding and segment together are twice differentiable with respect to the
parameter. Over a parameter interval of width 5 h, the speed at the ends is 1, as on the segments. h = c d is chosen
such that the speed in the middle,

    |u + v| (6 / c - 7) / 16,

is 1 as well, so that the parameter is close to the arc length: c = 6 / (7 + 16 / |u + v|), from 0.4 for a straight
line to 0 for a reversal. By symmetry the middle is the point nearest to p, at the distance d |v - u| (16 - 25 c) / 32.
"""

from __future__ import annotations

import numpy as np

from pinproof.errors import InputError
from pinproof.spatial import Array

REVERSAL = 0.1
"""|u + v| below which a corner is not rounded: the direction is reversed to within 6 degrees, and the arm would almost
stop in a rounding."""

MIN_SEGMENT = 1e-12
"""Length (rad or m) below which the segment between two roundings is omitted."""


def spacing(into: Array, out: Array) -> Array:
    """(k,) h / d, for unit directions (k, n) into and out of corners."""
    result: Array = 6.0 / (7.0 + 16.0 / np.linalg.norm(into + out, axis=-1))
    return result


def distance_to_corner(into: Array, out: Array) -> Array:
    """(k,) distance between a corner and its rounding of reach 1, for unit directions (k, n) into and out of it."""
    result: Array = np.linalg.norm(out - into, axis=-1) * (16.0 - 25.0 * spacing(into, out)) / 32.0
    return result


def rounding(at: Array, into: Array, out: Array, reach: float) -> tuple[float, Array]:
    """The parameter width and the control points (6, n) of the rounding of a corner ``at`` (n,)."""
    h = reach * float(spacing(into, out))
    before, after = reach - h * np.arange(3.0)[:, None], reach - h * np.arange(2.0, -1.0, -1.0)[:, None]
    return 5.0 * h, np.concatenate([at - before * into, at + after * out])


def round_off(q: Array, reach: Array) -> tuple[Array, Array]:
    """Knots (k+1,) and control points (k, 6, n) of segments through q (m, n) with corners rounded by reach (m,).

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
        raise InputError(f"the waypoints {i} and {i + 1} are equal; remove one")
    directions = steps / lengths[:, None]
    rest = lengths - reach[:-1] - reach[1:]
    if (rest < -MIN_SEGMENT).any():
        i = int(np.flatnonzero(rest < -MIN_SEGMENT)[0])
        raise InputError(f"the reaches {reach[i]} and {reach[i + 1]} overlap on a segment of length {lengths[i]}")
    widths, pieces, here = [], [], q[0]
    for i, towards in enumerate(directions):
        there = q[i + 1] - reach[i + 1] * towards if reach[i + 1] else q[i + 1]
        if rest[i] > MIN_SEGMENT:
            share = np.linspace(0.0, 1.0, 6)[:, None]
            pieces.append(here * (1.0 - share) + there * share)
            widths.append(rest[i])
        if reach[i + 1]:
            away = directions[i + 1]
            if np.linalg.norm(towards + away) < REVERSAL:
                raise InputError(f"the path reverses its direction at waypoint {i + 1}; set its reach to 0")
            width, piece = rounding(q[i + 1], towards, away, reach[i + 1])
            piece[0] = pieces[-1][-1] if pieces else q[0]  # exactly equal
            pieces.append(piece)
            widths.append(width)
            there = piece[-1]
        here = there
    pieces[-1][-1] = q[-1]
    return np.concatenate([[0.0], np.cumsum(widths)]), np.array(pieces)
