r"""A bound on how much closer two bodies can come while the joints stay in a box about a configuration.

**Simple bound.** Let q be a configuration, and let every joint i between bodies a and b stay within delta_i of q_i. Fix
any link L between a and b and consider the joints from L to b. Move these joints one after another, the one closest to
L first: the motion of joint i carries everything beyond it, b and the later axes, as one rigid body, which still has
the shape that it has at q. The points of b therefore move by at most the chord :math:`2 \rho_i \sin(\delta_i / 2)`,
where rho_i is the largest distance at q of a point of b from axis i (for a prismatic joint: delta_i). The same holds
for a, from L to a. Together, at every configuration in the box,

.. math:: d(q') \ge d(q) - \sum_{a \leftarrow L} 2 \rho^a_i \sin(\delta_i / 2)
    - \sum_{L \to b} 2 \rho^b_i \sin(\delta_i / 2) .

L is chosen such that the sum is smallest; for an obstacle it is the root. Exchanging a and b for single joints, without
a link that separates them, or using the smallest radius in place of the largest, would be wrong.

**Tight bound.** The gap of the supports along a unit vector u that is fixed in L is a lower bound of the distance, at q
and at q', so that only motion along u counts. With the joints as rotations R_1 .. R_m about their axes at q, closest to
L first, a point y of b moves to R_1 R_2 .. R_m y, and

.. math:: R_1 \cdots R_m y - y = \sum_i \bar R_1 \cdots \bar R_{i-1} (R_i y - y) ,

where the bar denotes the rotation without translation. Each term is the first-order term :math:`\theta_i w_i \times (y
- p_i)` and a remainder. The remainder has two parts: the effect of the inner rotations, at most :math:`\sum_{l<i} 2
\sin(\delta_l / 2)` times the chord, and the curvature of the arc, at most :math:`\rho_i (\delta_i - \sin \delta_i + 1 -
\cos \delta_i)`. The first-order terms are summed over the joints before the maximum over the body is taken, so that
opposite motions cancel; the sum is convex in the joints, so that its maximum on a curve is at a control point.

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
"""Columns of the joint motions for a half width delta: the chord of a point at radius 1, 2 sin(delta / 2); its
deviation from the first-order motion, delta - sin(delta) + 1 - cos(delta); delta; the factor of the joint's value in
q; the chord without the tolerance that was added to every joint."""
TURN_COLUMNS = 5

MORE = 0.05
"""rad or m. The growth of the tight bound with the box is valid for boxes that are larger by at most this."""


@compiled
def swings(joints: Any, delta: Any, extra: Any, turns: Any) -> None:
    """The joint motions (m, 5), in the columns above, for q within ``delta + extra`` (n,)."""
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
    """The distance of the centre of a body's bounding ball from the axis, and the radius of the ball."""
    if joints[k, SLIDES] != 0.0:
        return 1.0
    x, y, z = at[body, MIDDLE] - axes[k, 9], at[body, MIDDLE + 1] - axes[k, 10], at[body, MIDDLE + 2] - axes[k, 11]
    wx, wy, wz = axes[k, 2], axes[k, 5], axes[k, 8]
    cx, cy, cz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
    return math.sqrt(cx * cx + cy * cy + cz * cz) + bodies[body, BALL]


@compiled
def way(joints: Any, a: int, b: int, path: Any) -> Any:
    """``(count, up)`` of the joints between the body on joint a and the body on joint b.

    They are the first ``count`` entries of ``path`` (m,) in that order; the first ``up`` of them carry a, the others b.
    """
    up, down, size = 0, 0, path.shape[0]
    while a != b:  # Parents have smaller numbers.
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

    The distance by which they can approach each other; its growth per rad or m of every joint; the part that is due to
    the curve alone, without tolerances; and the number of joints, from a, that are assigned to the points of a, the
    others to b.
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
    for i in range(count - 1, -1, -1):  # Reassign joints one by one, beginning at b, from a to b.
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

    For a single piece (degree + 1, n) of the curve about its ``middle`` (n,). The growth is valid for up to
    :data:`MORE`.
    """
    last = piece.shape[0] - 1
    first = 0.0
    for r in range(last + 1 if last > 1 else 1):  # A straight piece is symmetric about its middle.
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
