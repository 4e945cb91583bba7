r"""How much nearer two bodies can come while the joints stay in a box about a configuration.

**Roughly.** Let q be a configuration and let every joint i between bodies a and b stay within delta_i of q_i. Fix any
link L between a and b and walk outward from it to b. Move these joints one after another, the one nearest to L first:
moving joint i carries all that lies beyond it, b and the later axes alike, as one rigid thing, and that thing still has
the shape it has at q. So the points of b move by at most the chord :math:`2 \rho_i \sin(\delta_i / 2)`, where rho_i is
the largest distance at q of a point of b from axis i (a joint that slides: delta_i). The same holds for a, walking from
L to a. Altogether, at every configuration in the box,

.. math:: d(q') \ge d(q) - \sum_{a \leftarrow L} 2 \rho^a_i \sin(\delta_i / 2)
    - \sum_{L \to b} 2 \rho^b_i \sin(\delta_i / 2) .

L is chosen where the sum is least; for an obstacle it is the root. Exchanging the roles joint by joint, with no link
that parts them, or a smallest radius in place of the largest, would be wrong.

**Closely.** The gap of the supports along a unit vector u that is fixed in L bounds the distance from below, at q and
at q' alike, so only motion along u counts. With the joints as rotations R_1 .. R_m about their axes at q, nearest to L
first, a point y of b goes to R_1 R_2 .. R_m y, and

.. math:: R_1 \cdots R_m y - y = \sum_i \bar R_1 \cdots \bar R_{i-1} (R_i y - y) ,

the bar for the turn alone. Each term is the first-order :math:`\theta_i w_i \times (y - p_i)` and a rest. The rest is
of two parts: what the inner turns make of it, at most :math:`\sum_{l<i} 2 \sin(\delta_l / 2)` times the chord, and
the bend of the arc, at most :math:`\rho_i (\delta_i - \sin \delta_i + 1 - \cos \delta_i)`. The first-order terms
are summed over the joints before the largest over the body is taken, so that motions that cancel do cancel; that is
convex in the joints, so on a curve it is largest at a control point.

Sources: F. Schwarzer, M. Saha, J.-C. Latombe (2005), "Adaptive dynamic collision checking for single and multiple
articulated robots in complex environments", IEEE Transactions on Robotics 21(3), section III; S. Quinlan (1994),
"Real-time modification of collision-free paths", PhD thesis, Stanford, chapter 3.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import compiled
from pinproof.kernels.world import BALL, HALF, LEADER, MIDDLE, MULTIPLIER, PARENT, SLIDES

__all__ = ["CHORD", "CURVE", "MORE", "TURN_COLUMNS", "closely", "roughly", "speed", "speeds", "swings", "way"]

CHORD, BEND, ANGLE, SHARE, CURVE = 0, 1, 2, 3, 4
"""Columns of the swings of joints, for a half width delta: how far a point at radius 1 moves, 2 sin(delta / 2); how far
that is from its first velocity times the angle, delta - sin(delta) + 1 - cos(delta); delta; how much of a joint of q
the joint takes; the chord without what was added to every joint as a tolerance."""
TURN_COLUMNS = 5

MORE = 0.05
"""rad or m. The close bound says how it would grow with the box for boxes at most this much larger."""


@compiled
def swings(joints: Any, delta: Any, extra: Any, turns: Any) -> None:
    """The swings (m, 5) of joints whose q stays within ``delta + extra`` (n,)."""
    for k in range(joints.shape[0]):
        leader, share = int(joints[k, LEADER]), abs(joints[k, MULTIPLIER])
        angle, bare = share * (delta[leader] + extra[leader]), share * delta[leader]
        turns[k, SHARE] = share
        turns[k, ANGLE] = angle
        if joints[k, SLIDES] != 0.0:
            turns[k, CHORD], turns[k, BEND], turns[k, CURVE] = angle, 0.0, bare
            continue
        turns[k, CHORD] = 2.0 * math.sin(0.5 * min(angle, math.pi))
        turns[k, BEND] = angle - math.sin(angle) + 1.0 - math.cos(min(angle, math.pi))
        turns[k, CURVE] = 2.0 * math.sin(0.5 * min(bare, math.pi))


@compiled
def speeds(joints: Any, bodies: Any, at: Any, axes: Any, rho: Any) -> None:
    """The largest speed of a point of each body of the robot per rate of each joint, into ``rho`` (R, m)."""
    for body in range(rho.shape[0]):
        for k in range(rho.shape[1]):
            rho[body, k] = speed(joints, bodies, at, axes, body, k)


@compiled
def speed(joints: Any, bodies: Any, at: Any, axes: Any, body: int, k: int) -> float:
    """Of the ball about a body: the distance of its centre from the axis, and its radius."""
    if joints[k, SLIDES] != 0.0:
        return 1.0
    x, y, z = at[body, MIDDLE] - axes[k, 9], at[body, MIDDLE + 1] - axes[k, 10], at[body, MIDDLE + 2] - axes[k, 11]
    wx, wy, wz = axes[k, 2], axes[k, 5], axes[k, 8]
    cx, cy, cz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
    return math.sqrt(cx * cx + cy * cy + cz * cz) + bodies[body, BALL]


@compiled
def way(joints: Any, a: int, b: int, path: Any) -> Any:
    """``(count, up)`` of the joints between what hangs on joint a and what hangs on joint b.

    In that order they are the first ``count`` of ``path`` (m,); the first ``up`` of them carry a, the others b.
    """
    up, down, size = 0, 0, path.shape[0]
    while a != b:  # parents have smaller numbers
        if a > b:
            path[up] = a
            up += 1
            a = int(joints[a, PARENT])
        else:
            down += 1
            path[size - down] = b
            b = int(joints[b, PARENT])
    for i in range(down):
        path[up + i] = path[size - down + i]
    return up + down, up


@compiled
def roughly(rho: Any, turns: Any, path: Any, count: int, a: int, b: int) -> Any:
    """``(approach, growth, curve, split)`` of bodies a and b, which may be an obstacle.

    How much nearer they can come; that per rad or m more for every joint; how much of it is the curve's own, without
    tolerances; and how many joints, from a on, were taken by a's points, the others by b's.
    """
    near = more = bare = 0.0
    for i in range(count):
        k = path[i]
        near += rho[a, k] * turns[k, CHORD]
        more += rho[a, k] * turns[k, SHARE]
        bare += rho[a, k] * turns[k, CURVE]
    if b >= rho.shape[0]:
        return near, more, bare, count
    best, growth, curve, split = near, more, bare, count
    for i in range(count - 1, -1, -1):  # hand over one joint after the other, from b's end, from a's points to b's
        k = path[i]
        less = rho[b, k] - rho[a, k]
        near, more, bare = near + less * turns[k, CHORD], more + less * turns[k, SHARE], bare + less * turns[k, CURVE]
        if near < best:
            best, growth, curve, split = near, more, bare, i
    return best, growth, curve, split


@compiled
def closely(
    joints: Any,
    bodies: Any,
    at: Any,
    axes: Any,
    rho: Any,
    turns: Any,
    extra: Any,
    path: Any,
    count: int,
    up: int,
    split: int,
    a: int,
    b: int,
    u: Any,
    piece: Any,
    middle: Any,
) -> Any:
    """``(approach, growth)`` of the support gap along the unit vector u (3,), from a to b, in the root frame.

    On a single piece (degree + 1, n) of the curve about its ``middle`` (n,). The growth holds for up to :data:`MORE`
    more.
    """
    last = piece.shape[0] - 1
    first = 0.0
    for r in range(last + 1 if last > 1 else 1):  # a straight piece is the same on both sides of its middle
        along = 0.0
        ax = ay = az = bx = by = bz = 0.0
        for i in range(count):
            k = path[i]
            leader = int(joints[k, LEADER])
            angle = joints[k, MULTIPLIER] * (piece[r, leader] - middle[leader])
            if i < up:
                angle = -angle
            wx, wy, wz = axes[k, 2], axes[k, 5], axes[k, 8]
            if joints[k, SLIDES] != 0.0:
                along += angle * (u[0] * wx + u[1] * wy + u[2] * wz)
                continue
            gx, gy, gz = u[1] * wz - u[2] * wy, u[2] * wx - u[0] * wz, u[0] * wy - u[1] * wx
            body = a if i < split else b
            x, y, z = (
                at[body, MIDDLE] - axes[k, 9],
                at[body, MIDDLE + 1] - axes[k, 10],
                at[body, MIDDLE + 2] - axes[k, 11],
            )
            along += angle * (gx * x + gy * y + gz * z)
            if i < split:
                ax, ay, az = ax + angle * gx, ay + angle * gy, az + angle * gz
            else:
                bx, by, bz = bx + angle * gx, by + angle * gy, bz + angle * gz
        towards = abs(along) if last <= 1 else -along
        if split > 0:
            towards += _extent(bodies, at, a, ax, ay, az)
        if split < count:
            towards += _extent(bodies, at, b, bx, by, bz)
        first = max(first, towards)
    near, growth = first, 0.0
    for side in range(2):
        body = a if side == 0 else b
        turned = shares = 0.0
        i = split - 1 if side == 0 else split
        while (i >= 0) if side == 0 else (i < count):
            k = path[i]
            chord, share = turns[k, CHORD], turns[k, SHARE]
            rate = rho[body, k] if body < rho.shape[0] else speed(joints, bodies, at, axes, body, k)
            outward = _along(joints, bodies, at, axes, body, k, u)
            near += outward * share * extra[int(joints[k, LEADER])] + rate * (turns[k, BEND] + turned * chord)
            growth += outward * share + rate * (shares * (chord + MORE * share) + (turned + MORE * shares) * share)
            if joints[k, SLIDES] == 0.0:
                growth += rate * share * min(2.0 * (turns[k, ANGLE] + MORE * share), 2.42)  # 1 - cos x + sin x
                turned += chord
                shares += share
            i += -1 if side == 0 else 1
    return near, growth


@compiled
def _extent(bodies: Any, at: Any, body: int, gx: float, gy: float, gz: float) -> float:
    """The largest (g . x) of a body about its centre, by its box or by its ball."""
    box = 0.0
    for i in range(3):
        box += abs(gx * at[body, i] + gy * at[body, 3 + i] + gz * at[body, 6 + i]) * bodies[body, HALF + i]
    ball = math.sqrt(gx * gx + gy * gy + gz * gz) * bodies[body, BALL]
    return box if box < ball else ball


@compiled
def _along(joints: Any, bodies: Any, at: Any, axes: Any, body: int, k: int, u: Any) -> float:
    """The largest speed along u of a point of the body's box, or of its ball, per rate of joint k."""
    wx, wy, wz = axes[k, 2], axes[k, 5], axes[k, 8]
    if joints[k, SLIDES] != 0.0:
        return abs(u[0] * wx + u[1] * wy + u[2] * wz)
    gx, gy, gz = u[1] * wz - u[2] * wy, u[2] * wx - u[0] * wz, u[0] * wy - u[1] * wx
    x, y, z = at[body, MIDDLE] - axes[k, 9], at[body, MIDDLE + 1] - axes[k, 10], at[body, MIDDLE + 2] - axes[k, 11]
    return abs(gx * x + gy * y + gz * z) + _extent(bodies, at, body, gx, gy, gz)
