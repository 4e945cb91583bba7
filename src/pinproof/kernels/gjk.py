r"""Lower and upper bounds of the distance of two convex bodies, which are valid even without convergence.

The algorithm of Gilbert, Johnson and Keerthi moves to the point v of B - A that is closest to the origin, using support
points only. Two bounds are known at every iteration:

* along a unit direction u no point of B - A is below :math:`\min_B u \cdot y - \max_A u \cdot x`, so that this support
  gap is a **lower** bound of the distance for any u;
* v is a convex combination of points of B - A, so that :math:`|v|` is an **upper** bound, 0 if the bodies overlap.

Balls are omitted in the iteration and subtracted from both bounds: a sphere is a point, a capsule a segment.

Sources: E. Gilbert, D. Johnson, S. Keerthi (1988), "A fast procedure for computing the distance between complex objects
in three-dimensional space", IEEE Journal of Robotics and Automation 4(2); C. Ericson (2005), "Real-time collision
detection", sections 5.1.5 and 5.1.6 (nearest points of triangle and tetrahedron), 9.5.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.compiled import compiled
from pinproof.kernels.world import CONVEX, DISCS, FIRST, HALF_SPACE, LAST, RADIUS, SEMI

__all__ = ["SIMPLEX", "between", "relative"]

SIMPLEX = (4, 8)
"""Shape of the scratch of :func:`between`: per row a point of B - A (3), its point of A (3), and its weight."""

WEIGHT, SHARE = 6, 7

ITERATIONS = 64
"""Maximum number of iterations, after which the current bounds are returned; polytopes need 4 to 8, discs edge on
edge up to 30."""

STILL = 1e-15
"""Fraction of |v|^2 by which an iteration must improve; smaller improvements are rounding errors."""

FLAT = 1e-12
"""The height of a tetrahedron below this fraction of the size of its sides is a rounding error."""

WHOLE = 1e-9
"""Largest deviation of the sum of the weights from 1; for a simplex so flat that it is exceeded, the iteration ends."""

OVERLAP = 1e-12
"""Metres. A point of B - A this close to the origin is evidence of overlap: placements are not known more
accurately."""


@compiled
def relative(at: Any, a: int, b: int, rel: Any) -> None:
    """a_from_b into ``rel`` (12,), rotation by rows, then translation; ``at`` (B, 15) contains root_from_body."""
    d0, d1, d2 = at[b, 9] - at[a, 9], at[b, 10] - at[a, 10], at[b, 11] - at[a, 11]
    for i in range(3):
        x, y, z = at[a, i], at[a, 3 + i], at[a, 6 + i]
        for j in range(3):
            rel[3 * i + j] = x * at[b, j] + y * at[b, 3 + j] + z * at[b, 6 + j]
        rel[9 + i] = x * d0 + y * d1 + z * d2


@compiled
def _support(bodies: Any, vertices: Any, body: int, x: float, y: float, z: float) -> Any:
    """The point of a body, without its ball, that is farthest along (x, y, z), in the body's frame."""
    first, last = int(bodies[body, FIRST]), int(bodies[body, LAST])
    best, index = -np.inf, first
    flat = math.sqrt(x * x + y * y) if bodies[body, DISCS] != 0.0 else 0.0
    if flat == 0.0:
        for i in range(first, last):
            reach = vertices[0, i] * x + vertices[1, i] * y + vertices[2, i] * z
            if reach > best:
                best, index = reach, i
    else:
        for i in range(first, last):
            reach = vertices[0, i] * x + vertices[1, i] * y + vertices[2, i] * z + vertices[3, i] * flat
            if reach > best:
                best, index = reach, i
    px, py, pz = vertices[0, index], vertices[1, index], vertices[2, index]
    if flat > 0.0:
        out = vertices[3, index] / flat
        px, py = px + out * x, py + out * y
    if bodies[body, SEMI] > 0.0:
        sx, sy, sz = bodies[body, SEMI], bodies[body, SEMI + 1], bodies[body, SEMI + 2]
        out = math.sqrt(sx * sx * x * x + sy * sy * y * y + sz * sz * z * z)
        if out > 0.0:
            px, py, pz = px + sx * sx * x / out, py + sy * sy * y / out, pz + sz * sz * z / out
    return px, py, pz


@compiled
def between(
    bodies: Any,
    vertices: Any,
    a: int,
    b: int,
    rel: Any,
    direction: Any,
    simplex: Any,
    above: float,
    below: float,
    precision: float,
) -> Any:
    """``(lower, upper)`` bounds (m) of the distance of bodies a and b, b placed in a by ``rel``; upper 0: they overlap.

    Ends early if lower > ``above`` or upper <= ``below``. Otherwise the bounds differ by at most ``precision``, or by
    the limit of floating point. ``direction`` (3,) is the initial direction (zeros: any), and on return the unit
    vector, in a's frame, whose support gap is ``lower``. The last four columns of ``simplex``, points and weights, give
    the witness points.
    """
    if bodies[b, CONVEX] == HALF_SPACE:
        return _above_plane(bodies, vertices, a, rel, direction, simplex)
    grown = bodies[a, RADIUS] + bodies[b, RADIUS]
    vx, vy, vz = direction[0], direction[1], direction[2]
    if not vx * vx + vy * vy + vz * vz > 0.0:
        vx, vy, vz = rel[9], rel[10], rel[11]
    if not vx * vx + vy * vy + vz * vz > 0.0:
        vx = 1.0
    size, vv, lower = 0, np.inf, -np.inf
    for _ in range(ITERATIONS):
        length = math.sqrt(vx * vx + vy * vy + vz * vz)
        ux, uy, uz = vx / length, vy / length, vz / length
        ax, ay, az = _support(bodies, vertices, a, ux, uy, uz)
        bx = -(rel[0] * ux + rel[3] * uy + rel[6] * uz)
        by = -(rel[1] * ux + rel[4] * uy + rel[7] * uz)
        bz = -(rel[2] * ux + rel[5] * uy + rel[8] * uz)
        bx, by, bz = _support(bodies, vertices, b, bx, by, bz)
        wx = rel[0] * bx + rel[1] * by + rel[2] * bz + rel[9] - ax
        wy = rel[3] * bx + rel[4] * by + rel[5] * bz + rel[10] - ay
        wz = rel[6] * bx + rel[7] * by + rel[8] * bz + rel[11] - az
        gap = ux * wx + uy * wy + uz * wz
        if gap > lower:
            lower = gap
            direction[0], direction[1], direction[2] = ux, uy, uz
            if lower - grown > above:
                break
        if size > 0 and math.sqrt(vv) - lower <= precision:
            break
        again = False
        for i in range(size):
            if simplex[i, 0] == wx and simplex[i, 1] == wy and simplex[i, 2] == wz:
                again = True
        if again:  # No point is closer in that direction: the iteration has converged.
            break
        simplex[size, 0], simplex[size, 1], simplex[size, 2] = wx, wy, wz
        simplex[size, 3], simplex[size, 4], simplex[size, 5] = ax, ay, az
        before = vv
        size = _nearest(simplex, size + 1)
        total = 0.0
        for i in range(size):
            total += simplex[i, WEIGHT]
        lost = not abs(total - 1.0) <= WHOLE
        if lost:  # A single point is a convex combination too.
            size, simplex[0, WEIGHT] = 1, 1.0
        vx = vy = vz = 0.0
        for i in range(size):
            vx += simplex[i, WEIGHT] * simplex[i, 0]
            vy += simplex[i, WEIGHT] * simplex[i, 1]
            vz += simplex[i, WEIGHT] * simplex[i, 2]
        vv = vx * vx + vy * vy + vz * vz
        if (
            lost
            or size == 4
            or math.sqrt(vv) - grown <= below
            or not vv < before * (1.0 - STILL)
            or not vv > OVERLAP * OVERLAP
        ):
            break
    for i in range(size, 4):
        simplex[i, WEIGHT] = 0.0
    upper = math.sqrt(vv) - grown
    if np.isnan(upper):
        return -np.inf, np.inf  # Overflow: the bounds carry no information.
    return lower - grown, upper if upper > OVERLAP else 0.0


@compiled
def _above_plane(bodies: Any, vertices: Any, a: int, rel: Any, direction: Any, simplex: Any) -> Any:
    """:func:`between` body a and the half-space below the plane through b's x and y, from one support point."""
    ux, uy, uz = -rel[2], -rel[5], -rel[8]
    ax, ay, az = _support(bodies, vertices, a, ux, uy, uz)
    gap = ux * (rel[9] - ax) + uy * (rel[10] - ay) + uz * (rel[11] - az)
    direction[0], direction[1], direction[2] = ux, uy, uz
    simplex[:, WEIGHT] = 0.0
    simplex[0, 0], simplex[0, 1], simplex[0, 2] = gap * ux, gap * uy, gap * uz
    simplex[0, 3], simplex[0, 4], simplex[0, 5], simplex[0, WEIGHT] = ax, ay, az, 1.0
    gap -= bodies[a, RADIUS]
    if np.isnan(gap):
        return -np.inf, np.inf
    return gap, gap if gap > OVERLAP else 0.0


@compiled
def _nearest(s: Any, size: int) -> int:
    """Compute the weights of the point of the simplex closest to the origin; keep the vertices with nonzero weights."""
    if size == 1:
        s[0, WEIGHT] = 1.0
        return 1
    if size == 2:
        s[0, WEIGHT], s[1, WEIGHT] = _segment(s)
    elif size == 3:
        s[0, WEIGHT], s[1, WEIGHT], s[2, WEIGHT] = _triangle(s, 0, 1, 2)
    else:
        _tetrahedron(s)
    kept = 0
    for i in range(size):
        if s[i, WEIGHT] > 0.0:
            if kept < i:
                for c in range(7):
                    s[kept, c] = s[i, c]
            kept += 1
    return kept


@compiled
def _segment(s: Any) -> Any:
    ex, ey, ez = s[1, 0] - s[0, 0], s[1, 1] - s[0, 1], s[1, 2] - s[0, 2]
    t = -(s[0, 0] * ex + s[0, 1] * ey + s[0, 2] * ez) / (ex * ex + ey * ey + ez * ez)
    t = min(max(t, 0.0), 1.0)
    return 1.0 - t, t


@compiled
def _triangle(s: Any, i: int, j: int, k: int) -> Any:
    """Weights of the point of triangle i, j, k closest to the origin (Ericson, 5.1.5)."""
    ax, ay, az, bx, by, bz = s[i, 0], s[i, 1], s[i, 2], s[j, 0], s[j, 1], s[j, 2]
    cx, cy, cz = s[k, 0], s[k, 1], s[k, 2]
    ex, ey, ez, fx, fy, fz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    d1, d2 = -(ex * ax + ey * ay + ez * az), -(fx * ax + fy * ay + fz * az)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    d3, d4 = -(ex * bx + ey * by + ez * bz), -(fx * bx + fy * by + fz * bz)
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        return 1.0 - v, v, 0.0
    d5, d6 = -(ex * cx + ey * cy + ez * cz), -(fx * cx + fy * cy + fz * cz)
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        return 1.0 - w, 0.0, w
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 0.0, 1.0 - w, w
    total = va + vb + vc
    return va / total, vb / total, vc / total


@compiled
def _tetrahedron(s: Any) -> None:
    """Weights of the point of a tetrahedron closest to the origin: on the closest face that it is beyond, or inside.

    For a flat tetrahedron every face is tried, so that a volume that is due to rounding decides nothing.
    """
    best, inside = np.inf, True
    for m in range(4):  # The face opposite to point m.
        i, j, k = (m + 1) % 4, (m + 2) % 4, (m + 3) % 4
        ax, ay, az = s[i, 0], s[i, 1], s[i, 2]
        ex, ey, ez = s[j, 0] - ax, s[j, 1] - ay, s[j, 2] - az
        fx, fy, fz = s[k, 0] - ax, s[k, 1] - ay, s[k, 2] - az
        nx, ny, nz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
        origin = -(nx * ax + ny * ay + nz * az)
        height = nx * (s[m, 0] - ax) + ny * (s[m, 1] - ay) + nz * (s[m, 2] - az)
        s[m, SHARE] = origin / height
        size = abs(ex) + abs(ey) + abs(ez) + abs(fx) + abs(fy) + abs(fz)
        if origin * height > 0.0 and abs(height) > FLAT * size * (abs(nx) + abs(ny) + abs(nz)):
            continue
        inside = False
        p, q, r = _triangle(s, i, j, k)
        x = p * ax + q * s[j, 0] + r * s[k, 0]
        y = p * ay + q * s[j, 1] + r * s[k, 1]
        z = p * az + q * s[j, 2] + r * s[k, 2]
        if x * x + y * y + z * z < best:
            best = x * x + y * y + z * z
            s[m, WEIGHT], s[i, WEIGHT], s[j, WEIGHT], s[k, WEIGHT] = 0.0, p, q, r
    if inside:
        total = s[0, SHARE] + s[1, SHARE] + s[2, SHARE] + s[3, SHARE]
        for m in range(4):
            s[m, WEIGHT] = s[m, SHARE] / total
