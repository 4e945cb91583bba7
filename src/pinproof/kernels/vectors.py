"""Vectors of three numbers as tuples, and the motions of a joint about its line, for the closed forms.

Tuples are kept in registers: nothing here allocates. A line is a row of an array: direction (3), a point of it (3), and
whether the joint is prismatic (1.0) or revolute (0.0). The state of a joint is (cos q, sin q), or (q, q^2).
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import inlined

__all__ = [
    "SLIDING",
    "across",
    "along",
    "cross",
    "curve",
    "direction",
    "dot",
    "minus",
    "moved",
    "perpendicular",
    "place",
    "turned",
    "turning_curve",
    "unturned",
]

SLIDING = 6
"""The entry of a line that is 1.0 for a prismatic joint."""


@inlined
def dot(a: Any, b: Any) -> Any:
    """The scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Any, b: Any) -> Any:
    """A x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def minus(a: Any, b: Any) -> Any:
    """A - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def along(a: Any, s: float, b: Any) -> Any:
    """A + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@inlined
def across(a: Any, h: Any) -> Any:
    """The component of a that is perpendicular to the unit vector h."""
    return along(a, -dot(h, a), h)


@inlined
def perpendicular(h: Any) -> Any:
    """A unit vector perpendicular to the unit vector h."""
    if abs(h[0]) <= abs(h[1]) and abs(h[0]) <= abs(h[2]):
        size = 1.0 / math.sqrt(h[1] * h[1] + h[2] * h[2])
        return 0.0, -h[2] * size, h[1] * size
    if abs(h[1]) <= abs(h[2]):
        size = 1.0 / math.sqrt(h[0] * h[0] + h[2] * h[2])
        return h[2] * size, 0.0, -h[0] * size
    size = 1.0 / math.sqrt(h[0] * h[0] + h[1] * h[1])
    return -h[1] * size, h[0] * size, 0.0


@inlined
def direction(lines: Any, i: int) -> Any:
    """The unit direction of line i."""
    return lines[i, 0], lines[i, 1], lines[i, 2]


@inlined
def place(lines: Any, i: int) -> Any:
    """The stored point of line i."""
    return lines[i, 3], lines[i, 4], lines[i, 5]


@inlined
def turned(h: Any, c: float, s: float, v: Any) -> Any:
    """V rotated about the unit vector h by the angle of cosine c and sine s (Rodrigues)."""
    k = (1.0 - c) * dot(h, v)
    return (
        c * v[0] + k * h[0] + s * (h[1] * v[2] - h[2] * v[1]),
        c * v[1] + k * h[1] + s * (h[2] * v[0] - h[0] * v[2]),
        c * v[2] + k * h[2] + s * (h[0] * v[1] - h[1] * v[0]),
    )


@inlined
def moved(h: Any, o: Any, slides: Any, state: Any, way: float, p: Any) -> Any:
    """The point p moved by a joint on the line (h, o): forward (``way`` 1) or backward (-1)."""
    if slides:
        return along(p, way * state[0], h)
    v = turned(h, state[0], way * state[1], minus(p, o))
    return o[0] + v[0], o[1] + v[1], o[2] + v[2]


@inlined
def unturned(h: Any, slides: Any, state: Any, way: float, v: Any) -> Any:
    """The direction v rotated by a joint about h: forward (``way`` 1) or backward (-1); a prismatic joint keeps it."""
    if slides:
        return v
    return turned(h, state[0], way * state[1], v)


@inlined
def curve(h: Any, o: Any, slides: Any, way: float, p: Any) -> Any:
    """The curve of a point p that a joint moves: A + u b_1 + w b_2, with (b_1, b_2) the state of the joint.

    A circle about the line, or a straight line parallel to it (w = 0).
    """
    if slides:
        return p, (way * h[0], way * h[1], way * h[2]), (0.0, 0.0, 0.0)
    v = minus(p, o)
    centre = along(o, dot(h, v), h)
    w = cross(h, v)
    return centre, minus(p, centre), (way * w[0], way * w[1], way * w[2])


@inlined
def turning_curve(h: Any, slides: Any, way: float, v: Any) -> Any:
    """:func:`curve` for a direction v, which only a revolute joint changes."""
    if slides:
        return v, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    centre = (dot(h, v) * h[0], dot(h, v) * h[1], dot(h, v) * h[2])
    w = cross(h, v)
    return centre, minus(v, centre), (way * w[0], way * w[1], way * w[2])
