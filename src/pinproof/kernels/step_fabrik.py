r"""The step of :class:`pinproof.Fabrik`: one pass over the links from the target to the base, and one back.

All quantities are in the axes of the target, with the arm at q. Link k is between hinge k - 1 and hinge k; the last one
carries the tcp. A pass computes the motion of each link: 12 numbers, a rotation row by row, then a translation.

* Backward: M of the last link brings the tcp to the target. Each previous link follows its hinge with the next one,
  M_below = M_above X with X about (or along) that hinge, chosen such that M_below is close to the identity.
* Forward: N of the base is the identity; N_above = N_below X, with X chosen such that N_above is close to M_above.

The distance of two motions is measured with a weight at two points of the link's other hinge, :data:`RHO` to both sides
of its origin, and at the end of the remaining arm (the tcp, or the base), moved as one rigid body. The best X has a
closed form: with the points a_i, their desired positions z_i, both from the hinge's origin, and its direction d,

.. math:: \tan\alpha = \frac{\sum w_i\, d \cdot (a_i \times z_i)}
    {\sum w_i\, \bigl(a_i \cdot z_i - (d \cdot a_i)(d \cdot z_i)\bigr)}.

Measured success rates for positions (to 1e-4 m, from the middle of the limits, seven arms): 0 to 76 % with hinges only;
78 to 95 % with the tcp in the forward passes; 97 to 99.9 % with alternating passes of two kinds and unequal lengths;
99.5 to 100 % with the bending of arms in deadlock.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.chain import SLIDES
from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.limits import HIGH, LOW, LOWER, TURN, UPPER
from pinproof.kernels.trigonometry import sincos
from pinproof.kernels.workspace import ASKED, STEP

__all__ = [
    "AIM",
    "BASE",
    "BEND",
    "HOLD",
    "HOLD_POSED",
    "REACH",
    "RELAX_HOLD",
    "RELAX_REACH",
    "RHO",
    "WAIT",
    "step_fabrik",
]

RHO = 0.17
"""Metres from the origin of a hinge to the two points that represent its direction: the weight of a radian."""

HOLD, HOLD_POSED, REACH = 0.03, 1.0, 0.001
"""Weight of the hinges relative to the tcp, in passes that preserve the shape of the arm (for a position, and with
an orientation) and in passes that reach for the target. The passes alternate, because each kind stalls in different
cases. All constants of this module were chosen by experiments on seven arms."""

RELAX_HOLD, RELAX_REACH = 0.8, 1.6
"""The fraction of a pass that is applied. Passes of one kind converge slowly along a valley; unequal lengths avoid
that."""

BASE = 0.1
"""The weight of the base in backward passes."""

AIM = 0.3
"""For a position, the last link is moved to the target and rotated by this fraction of the angle that would point it
at the previous position of its hinge. With 1 this is the original FABRIK; with 0 the orientation of the tcp is kept."""

WAIT, BEND = 30, 0.2
"""If the residual has not decreased enough for this number of passes, the arm is in deadlock: at a limit, or
straight. Each joint is then moved by this fraction of its range (at most of 2 pi) towards the middle of the range;
if that is not sufficient, by twice as much, and so on."""

STILL = 1e-9
"""Rad or m: a pass that moves no joint by more is a deadlock."""

TINY = 1e-12
"""Square metres; a hinge whose sums are smaller is not rotated, because the angle is undetermined."""


@compiled
def step_fabrik(
    iteration: int, waited: int, chain: Any, box: Any, q: Any, axes: Any, end: Any, moved: Any, joints: Any, errors: Any
) -> None:
    """The step from q, within the limits, into the row STEP of ``joints``.

    ``axes`` (n, 6) and ``end`` (3, 4) are the hinges and the tcp at q from :func:`pinproof.kernels.chain.walk`, for a
    chain without mimic joints; ``moved`` (n + 2, 12) is scratch. ``waited`` is the number of steps since the last
    sufficient decrease of the residual.
    """
    n = q.shape[0]
    placed, angles = errors[ASKED, 0], errors[ASKED, 3] + errors[ASKED, 4] + errors[ASKED, 5]
    weight, relax = REACH, RELAX_REACH
    if iteration % 2 == 0:
        weight, relax = HOLD if angles == 0.0 else HOLD_POSED, RELAX_HOLD
    u0 = u1 = u2 = 0.0  # The axis about which the tcp may rotate.
    if angles == 2.0:
        u0, u1, u2 = 1.0 - errors[ASKED, 3], 1.0 - errors[ASKED, 4], 1.0 - errors[ASKED, 5]

    # Backward. Row k + 1 of ``moved`` becomes M of the link above hinge k, row n + 1 the motion that X approximates.
    w = n + 1
    for i in range(3):
        for j in range(3):
            moved[w, 3 * i + j] = end[i, j]
        moved[w, 9 + i] = end[i, 3]
    _invert(moved, w, n)
    if angles == 0.0:
        _aim(axes, end, n, moved)
    elif angles == 2.0:
        last = n - 1
        x0, x1, x2 = axes[last, 0] - end[0, 3], axes[last, 1] - end[1, 3], axes[last, 2] - end[2, 3]
        o0, o1, o2 = _back(moved, w, x0, x1, x2)
        d0, d1, d2 = _back(moved, w, axes[last, 3], axes[last, 4], axes[last, 5])
        along, c, s = _fit(0.0, 0.0, 0.0, u0, u1, u2, moved, w, placed, o0, o1, o2, RHO * RHO, d0, d1, d2)
        # The rotation after E^-1 equals, before it, the same rotation about the current axis of the tcp.
        _invert(moved, w, 0)
        _move(
            moved, 0, n, end[0, 3], end[1, 3], end[2, 3], end[0, 0] * u0 + end[0, 1] * u1 + end[0, 2] * u2,
            end[1, 0] * u0 + end[1, 1] * u1 + end[1, 2] * u2, end[2, 0] * u0 + end[2, 1] * u1 + end[2, 2] * u2,
            _angle(s, c), 0.0,
        )  # fmt: skip
    for k in range(n - 1, 0, -1):
        o0, o1, o2, d0, d1, d2 = axes[k, 0], axes[k, 1], axes[k, 2], axes[k, 3], axes[k, 4], axes[k, 5]
        _invert(moved, k + 1, w)
        along, c, s = _fit(
            o0, o1, o2, d0, d1, d2, moved, w, weight * placed, axes[k - 1, 0], axes[k - 1, 1], axes[k - 1, 2],
            weight * RHO * RHO, axes[k - 1, 3], axes[k - 1, 4], axes[k - 1, 5],
        )  # fmt: skip
        total = weight
        if k > 1:
            more, a, b = _fit(
                o0, o1, o2, d0, d1, d2, moved, w, BASE * placed, axes[0, 0], axes[0, 1], axes[0, 2],
                BASE * RHO * RHO, axes[0, 3], axes[0, 4], axes[0, 5],
            )  # fmt: skip
            along, c, s, total = along + more, c + a, s + b, total + BASE
        # The link below moves opposite to the joint.
        if chain[k, SLIDES] != 0.0:
            _move(moved, k + 1, k, o0, o1, o2, d0, d1, d2, 0.0, q[k] - _cut(box, k, q[k] - along / total))
        else:
            _move(moved, k + 1, k, o0, o1, o2, d0, d1, d2, -_allowed(box, k, q[k], -_angle(s, c)), 0.0)

    # Forward. Row k + 1 becomes N of the link above hinge k, once its M has been used.
    for i in range(12):
        moved[0, i] = 0.0
    moved[0, 0] = moved[0, 4] = moved[0, 8] = 1.0
    largest = 0.0
    for k in range(n):
        o0, o1, o2, d0, d1, d2 = axes[k, 0], axes[k, 1], axes[k, 2], axes[k, 3], axes[k, 4], axes[k, 5]
        _between(moved, k, k + 1, w)
        # The tcp, and the axis about which it may rotate, on this link after the backward pass.
        x0, x1, x2 = _back(moved, k + 1, -moved[k + 1, 9], -moved[k + 1, 10], -moved[k + 1, 11])
        e0, e1, e2 = _back(moved, k + 1, u0, u1, u2)
        along, c, s = _fit(o0, o1, o2, d0, d1, d2, moved, w, placed, x0, x1, x2, RHO * RHO, e0, e1, e2)
        total = 1.0
        if angles == 3.0:  # All axes of the tcp at once: sums over an orthonormal basis are the trace and the vector.
            r0 = d0 * moved[w, 0] + d1 * moved[w, 3] + d2 * moved[w, 6]
            r1 = d0 * moved[w, 1] + d1 * moved[w, 4] + d2 * moved[w, 7]
            r2 = d0 * moved[w, 2] + d1 * moved[w, 5] + d2 * moved[w, 8]
            c += RHO * RHO * (moved[w, 0] + moved[w, 4] + moved[w, 8] - r0 * d0 - r1 * d1 - r2 * d2)
            s += RHO * RHO * d0 * (moved[w, 7] - moved[w, 5])
            s += RHO * RHO * d1 * (moved[w, 2] - moved[w, 6])
            s += RHO * RHO * d2 * (moved[w, 3] - moved[w, 1])
        if k < n - 1:
            more, a, b = _fit(
                o0, o1, o2, d0, d1, d2, moved, w, weight * placed, axes[k + 1, 0], axes[k + 1, 1], axes[k + 1, 2],
                weight * RHO * RHO, axes[k + 1, 3], axes[k + 1, 4], axes[k + 1, 5],
            )  # fmt: skip
            along, c, s, total = along + more, c + a, s + b, total + weight
        if chain[k, SLIDES] != 0.0:
            change = _cut(box, k, q[k] + along / total) - q[k]
            _move(moved, k, k + 1, o0, o1, o2, d0, d1, d2, 0.0, change)
        else:
            change = _allowed(box, k, q[k], _angle(s, c))
            _move(moved, k, k + 1, o0, o1, o2, d0, d1, d2, change, 0.0)
        joints[STEP, k] = _cut(box, k, q[k] + relax * change) - q[k]
        largest = max(largest, abs(joints[STEP, k]))
    if largest <= STILL or (waited > 0 and waited % WAIT == 0):
        _bend(BEND * (1 + waited // WAIT), n, box, q, joints)


@inlined
def _bend(share: float, n: int, box: Any, q: Any, joints: Any) -> None:
    """Move every joint by this fraction of its range towards the middle; upwards without a range, or at the middle."""
    for i in range(n):
        width = box[UPPER, i] - box[LOWER, i]
        bend = share * min(width, TURN)
        if width < math.inf and q[i] > 0.5 * (box[LOWER, i] + box[UPPER, i]):
            bend = -bend
        joints[STEP, i] = _cut(box, i, q[i] + bend) - q[i]


@inlined
def _aim(axes: Any, end: Any, n: int, moved: Any) -> None:
    """M of the last link for a position: a translation to the target, and a partial rotation towards its hinge."""
    o0, o1, o2 = axes[n - 1, 0], axes[n - 1, 1], axes[n - 1, 2]
    a0, a1, a2 = o0 - end[0, 3], o1 - end[1, 3], o2 - end[2, 3]
    v0, v1, v2 = a1 * o2 - a2 * o1, a2 * o0 - a0 * o2, a0 * o1 - a1 * o0
    size = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    for i in range(12):
        moved[n, i] = 0.0
    moved[n, 0] = moved[n, 4] = moved[n, 8] = 1.0
    if size > TINY:
        _spin(moved, n, v0 / size, v1 / size, v2 / size, AIM * math.atan2(size, a0 * o0 + a1 * o1 + a2 * o2))
    for i in range(3):
        moved[n, 9 + i] = -(
            moved[n, 3 * i] * end[0, 3] + moved[n, 3 * i + 1] * end[1, 3] + moved[n, 3 * i + 2] * end[2, 3]
        )


@inlined
def _fit(
    o0: float, o1: float, o2: float, d0: float, d1: float, d2: float, moved: Any, w: int,
    point: float, x0: float, x1: float, x2: float, direction: float, e0: float, e1: float, e2: float,
) -> Any:  # fmt: skip
    """The terms of a point x and a direction e for the motion X at the hinge (o, d) that approximates ``moved[w]``.

    With their weights ``point`` and ``direction``: the translation of X, and the two sums for the cosine and sine.
    """
    z0 = moved[w, 0] * x0 + moved[w, 1] * x1 + moved[w, 2] * x2 + moved[w, 9]
    z1 = moved[w, 3] * x0 + moved[w, 4] * x1 + moved[w, 5] * x2 + moved[w, 10]
    z2 = moved[w, 6] * x0 + moved[w, 7] * x1 + moved[w, 8] * x2 + moved[w, 11]
    along = point * (d0 * (z0 - x0) + d1 * (z1 - x1) + d2 * (z2 - x2))
    x0, x1, x2, z0, z1, z2 = x0 - o0, x1 - o1, x2 - o2, z0 - o0, z1 - o1, z2 - o2
    c = point * (x0 * z0 + x1 * z1 + x2 * z2 - (d0 * x0 + d1 * x1 + d2 * x2) * (d0 * z0 + d1 * z1 + d2 * z2))
    s = point * (d0 * (x1 * z2 - x2 * z1) + d1 * (x2 * z0 - x0 * z2) + d2 * (x0 * z1 - x1 * z0))
    z0 = moved[w, 0] * e0 + moved[w, 1] * e1 + moved[w, 2] * e2
    z1 = moved[w, 3] * e0 + moved[w, 4] * e1 + moved[w, 5] * e2
    z2 = moved[w, 6] * e0 + moved[w, 7] * e1 + moved[w, 8] * e2
    c += direction * (e0 * z0 + e1 * z1 + e2 * z2 - (d0 * e0 + d1 * e1 + d2 * e2) * (d0 * z0 + d1 * z1 + d2 * z2))
    s += direction * (d0 * (e1 * z2 - e2 * z1) + d1 * (e2 * z0 - e0 * z2) + d2 * (e0 * z1 - e1 * z0))
    return along, c, s


@inlined
def _angle(s: float, c: float) -> float:
    return math.atan2(s, c) if s * s + c * c > TINY * TINY else 0.0


@inlined
def _allowed(box: Any, i: int, value: float, change: float) -> float:
    """The change closest on the circle to ``change`` that keeps joint i within its limits."""
    there = value + change
    if there < box[LOW, i]:
        if there + TURN <= box[HIGH, i]:
            return change + TURN
    elif there > box[HIGH, i]:
        if there - TURN >= box[LOW, i]:
            return change - TURN
    else:
        return change
    return (box[LOW, i] if math.cos(there - box[LOW, i]) >= math.cos(there - box[HIGH, i]) else box[HIGH, i]) - value


@inlined
def _cut(box: Any, i: int, value: float) -> float:
    return min(max(value, box[LOW, i]), box[HIGH, i])


@inlined
def _back(moved: Any, row: int, x0: float, x1: float, x2: float) -> Any:
    """The transposed rotation of ``moved[row]`` times x."""
    return (
        moved[row, 0] * x0 + moved[row, 3] * x1 + moved[row, 6] * x2,
        moved[row, 1] * x0 + moved[row, 4] * x1 + moved[row, 7] * x2,
        moved[row, 2] * x0 + moved[row, 5] * x1 + moved[row, 8] * x2,
    )


@inlined
def _invert(moved: Any, a: int, b: int) -> None:
    """``moved[b]`` becomes the inverse of ``moved[a]``."""
    for i in range(3):
        for j in range(3):
            moved[b, 3 * i + j] = moved[a, 3 * j + i]
        moved[b, 9 + i] = -(moved[a, i] * moved[a, 9] + moved[a, 3 + i] * moved[a, 10] + moved[a, 6 + i] * moved[a, 11])


@inlined
def _between(moved: Any, a: int, b: int, out: int) -> None:
    """``moved[out]`` becomes the inverse of ``moved[a]`` times ``moved[b]``."""
    p0, p1, p2 = moved[b, 9] - moved[a, 9], moved[b, 10] - moved[a, 10], moved[b, 11] - moved[a, 11]
    for i in range(3):
        x0, x1, x2 = moved[a, i], moved[a, 3 + i], moved[a, 6 + i]
        for j in range(3):
            moved[out, 3 * i + j] = x0 * moved[b, j] + x1 * moved[b, 3 + j] + x2 * moved[b, 6 + j]
        moved[out, 9 + i] = x0 * p0 + x1 * p1 + x2 * p2


@inlined
def _move(
    moved: Any, a: int, b: int, o0: float, o1: float, o2: float, d0: float, d1: float, d2: float,
    angle: float, along: float,
) -> None:  # fmt: skip
    """``moved[b]`` becomes ``moved[a]`` times the motion about the hinge (o, d) by an angle, or along it."""
    for i in range(3):
        o = moved[a, 3 * i] * o0 + moved[a, 3 * i + 1] * o1 + moved[a, 3 * i + 2] * o2
        d = moved[a, 3 * i] * d0 + moved[a, 3 * i + 1] * d1 + moved[a, 3 * i + 2] * d2
        moved[b, 9 + i] = moved[a, 9 + i] + o + along * d
        for j in range(3):
            moved[b, 3 * i + j] = moved[a, 3 * i + j]
    if angle != 0.0:
        _spin(moved, b, d0, d1, d2, angle)
    for i in range(3):
        moved[b, 9 + i] -= moved[b, 3 * i] * o0 + moved[b, 3 * i + 1] * o1 + moved[b, 3 * i + 2] * o2


@inlined
def _spin(moved: Any, row: int, d0: float, d1: float, d2: float, angle: float) -> None:
    """The rotation R of ``moved[row]`` becomes R Rot(d, angle); a row r of it becomes Rot(d, -angle) r (Rodrigues)."""
    s, c = sincos(angle)
    for i in range(3):
        x, y, z = moved[row, 3 * i], moved[row, 3 * i + 1], moved[row, 3 * i + 2]
        e = (1.0 - c) * (d0 * x + d1 * y + d2 * z)
        moved[row, 3 * i] = c * x + e * d0 - s * (d1 * z - d2 * y)
        moved[row, 3 * i + 1] = c * y + e * d1 - s * (d2 * x - d0 * z)
        moved[row, 3 * i + 2] = c * z + e * d2 - s * (d0 * y - d1 * x)
