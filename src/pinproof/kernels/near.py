"""The bodies that are in contact, or closest, at one configuration.

Far pairs are decided by balls and boxes, obstacles many at once by a tree of boxes, and the others by
:mod:`pinproof.kernels.gjk`. Pairs with a body without a support function are returned to the caller for coal.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.compiled import compiled
from pinproof.kernels.gjk import SIMPLEX, WEIGHT, between, relative
from pinproof.kernels.placing import place
from pinproof.kernels.world import (
    BALL,
    BEGIN,
    CONVEX,
    HALF,
    HIGH,
    LEAF,
    LOW,
    MARGIN,
    MIDDLE,
    RADIUS,
    SKIP,
    A,
    B,
    world_of,
)

__all__ = [
    "CONTACT",
    "EVERY",
    "FIRST_ONLY",
    "LIKELY",
    "NEAREST",
    "NOT_FINITE",
    "PRECISION",
    "TALLY",
    "apart",
    "ball_to_node",
    "look_around",
    "measure",
    "near",
    "near_many",
    "place_bodies",
    "touching",
]

FIRST_ONLY, EVERY, NEAREST = 0, 1, 2
"""The question: whether there is a contact; which pairs are in contact; or which pair is closest, and which overlap."""

PRECISION = 1e-9
"""Metres between the two bounds of a distance at which the iteration between two bodies ends."""

CONTACTS, LEFT, LOWER, UPPER, PAIR = 0, 1, 2, 3, 4
"""The counters of one question: pairs in contact, pairs left to coal, and the results of ``NEAREST``."""
TALLY = 5


LIKELY = 8
"""Number of pairs that were recently in contact and are checked first, because they are often in contact again. The
result does not depend on the order."""

CONTACT, NOT_FINITE = -1, -2
"""Other return values of :func:`touching` than the number of pairs left to coal."""


@compiled
def touching(numbers: Any, indices: Any, at: Any, q: Any, pairs: Any) -> int:
    """The number of pairs left to coal at q (n,), CONTACT if another pair is in contact, NOT_FINITE if q is not finite.

    ``pairs`` (3, max(P, LIKELY)) are those in contact, those left to coal, and those that are likely to be in contact,
    which are kept from one question to the next; see :func:`near`.
    """
    world = world_of(numbers, indices)
    if not place(world, q, np.empty((world.joints.shape[0], 12)), at):
        return NOT_FINITE
    tally, rel, direction, simplex = np.zeros(TALLY), np.empty(12), np.empty(3), np.empty(SIMPLEX)
    if look_around(
        world.bodies, world.vertices, world.pairs, world.own, world.around, world.outer, world.tree, world.widest,
        at, FIRST_ONLY, pairs[0], pairs[1], pairs[2, :LIKELY], tally, rel, direction, simplex,
    ):  # fmt: skip
        return CONTACT
    return int(tally[LEFT])


@compiled
def near(numbers: Any, indices: Any, at: Any, q: Any, question: int, pairs: Any) -> Any:
    """``(contacts, left to coal, lower, upper, nearest)`` at q (n,); -1 contacts if q is not finite.

    A pair is in contact unless it is proven farther apart than its margin; for ``NEAREST``, than 0. The pairs in
    contact are written to ``pairs[0]``, those left to coal to ``pairs[1]``. ``lower`` and ``upper`` bound the smallest
    distance (m) over all other pairs, ``nearest`` is the pair of ``upper``; only ``NEAREST`` computes them. ``numbers``
    and ``indices`` are a flattened :class:`~pinproof.kernels.world.World`, ``at`` the placements that :func:`place`
    writes.
    """
    world = world_of(numbers, indices)
    if not place(world, q, np.empty((world.joints.shape[0], 12)), at):
        return -1, 0, 0.0, 0.0, -1
    tally, rel, direction, simplex = np.zeros(TALLY), np.empty(12), np.empty(3), np.empty(SIMPLEX)
    tally[LOWER], tally[UPPER], tally[PAIR] = np.inf, np.inf, -1.0
    look_around(
        world.bodies, world.vertices, world.pairs, world.own, world.around, world.outer, world.tree, world.widest,
        at, question, pairs[0], pairs[1], pairs[2, :LIKELY], tally, rel, direction, simplex,
    )  # fmt: skip
    return int(tally[CONTACTS]), int(tally[LEFT]), tally[LOWER], tally[UPPER], int(tally[PAIR])


@compiled
def look_around(
    bodies: Any,
    vertices: Any,
    table: Any,
    own: Any,
    around: Any,
    outer: Any,
    tree: Any,
    widest: Any,
    at: Any,
    question: int,
    found: Any,
    asked: Any,
    likely: Any,
    tally: Any,
    rel: Any,
    direction: Any,
    simplex: Any,
) -> bool:
    """Judge all pairs at the placements of the bodies; returns whether there is a contact, for ``FIRST_ONLY``.

    The arrays of the world are passed one by one, because passing the tuple costs more than a distance. ``likely`` are
    pairs to begin with, -1 if empty; the pair in contact is stored there. ``tally`` starts with zero contacts and zero
    pairs left to coal.
    """
    rounding, robot = widest[1], outer.shape[0]
    if question == FIRST_ONLY:
        for i in range(likely.shape[0]):
            k = likely[i]
            if k < 0:
                continue
            limit = table[k, MARGIN] + rounding
            if apart(bodies, at, int(table[k, A]), int(table[k, B]), limit) > limit:
                continue
            if _judge(bodies, vertices, table, rounding, at, k, question, found, asked, tally, rel, direction, simplex):
                if i > 0:  # Pairs that are often in contact move to the front.
                    likely[i], likely[i - 1] = likely[i - 1], k
                return True
    limit = widest[0] + rounding
    for i in range(around.shape[0]):
        body, row = around[i], 0
        while row < tree.shape[0]:
            if question == NEAREST:
                limit = tally[UPPER]
            if ball_to_node(at, body, bodies[body, BALL], tree, row) > limit:
                row = int(tree[row, SKIP])
                continue
            leaf = int(tree[row, LEAF])
            row += 1
            if leaf < 0 or apart(bodies, at, body, leaf, limit) > limit:
                continue
            k = outer[body, leaf - robot]
            if k >= 0 and _judge(
                bodies, vertices, table, rounding, at, k, question, found, asked, tally, rel, direction, simplex
            ):
                likely[likely.shape[0] - 1] = k
                return True
    for i in range(own.shape[0]):
        k = own[i]
        limit = table[k, MARGIN] + rounding if question != NEAREST else tally[UPPER]
        if apart(bodies, at, int(table[k, A]), int(table[k, B]), limit) > limit:
            continue
        if _judge(bodies, vertices, table, rounding, at, k, question, found, asked, tally, rel, direction, simplex):
            likely[likely.shape[0] - 1] = k
            return True
    return False


@compiled
def _judge(
    bodies: Any,
    vertices: Any,
    table: Any,
    rounding: float,
    at: Any,
    k: int,
    question: int,
    found: Any,
    asked: Any,
    tally: Any,
    rel: Any,
    direction: Any,
    simplex: Any,
) -> bool:
    """Judge pair k, which balls and boxes did not decide; returns whether the question is answered."""
    a, b, margin = int(table[k, A]), int(table[k, B]), table[k, MARGIN]
    limit = margin + rounding if question != NEAREST else tally[UPPER]
    if bodies[a, CONVEX] == 0.0 or bodies[b, CONVEX] == 0.0:
        asked[int(tally[LEFT])] = k
        tally[LEFT] += 1
        return False
    relative(at, a, b, rel)
    for c in range(3):
        direction[c] = table[k, BEGIN + c]
    below = margin if question != NEAREST else -1.0
    lower, upper = between(bodies, vertices, a, b, rel, direction, simplex, limit, below, PRECISION)
    if lower > limit:
        return False
    if question == NEAREST:
        if upper < tally[UPPER]:
            tally[UPPER], tally[PAIR] = upper, k
        if lower > 0.0:
            tally[LOWER] = min(tally[LOWER], lower)
            return False
    found[int(tally[CONTACTS])] = k
    tally[CONTACTS] += 1
    return question == FIRST_ONLY


@compiled
def apart(bodies: Any, at: Any, a: int, b: int, enough: float) -> float:
    """A lower bound (m) of the distance of two bodies: by their balls and, if not ``enough``, by ball and box."""
    x, y, z = (
        at[b, MIDDLE] - at[a, MIDDLE],
        at[b, MIDDLE + 1] - at[a, MIDDLE + 1],
        at[b, MIDDLE + 2] - at[a, MIDDLE + 2],
    )
    gap = math.sqrt(x * x + y * y + z * z) - bodies[a, BALL] - bodies[b, BALL]
    if gap > enough:
        return gap
    gap = max(gap, _point_to_box(bodies, at, a, x, y, z) - bodies[b, BALL])
    if gap > enough:
        return gap
    return max(gap, _point_to_box(bodies, at, b, -x, -y, -z) - bodies[a, BALL])


@compiled
def _point_to_box(bodies: Any, at: Any, body: int, x: float, y: float, z: float) -> float:
    """Distance from the box of a body to a point at (x, y, z) from its centre."""
    total = 0.0
    for i in range(3):
        out = abs(at[body, i] * x + at[body, 3 + i] * y + at[body, 6 + i] * z) - bodies[body, HALF + i]
        if out > 0.0:
            total += out * out
    return math.sqrt(total)


@compiled
def ball_to_node(at: Any, body: int, radius: float, tree: Any, row: int) -> float:
    """Distance from a ball about the centre of a body to a box of the tree; 0 or less if they intersect."""
    total = 0.0
    for i in range(3):
        x = at[body, MIDDLE + i]
        out = max(tree[row, LOW + i] - x, x - tree[row, HIGH + i])
        if out > 0.0:
            total += out * out
    return math.sqrt(total) - radius


@compiled
def near_many(numbers: Any, indices: Any, at: Any, Q: Any, question: int, pairs: Any, out: Any) -> None:
    """The result of :func:`near` at each row of Q (N, n) into ``out`` (N, 5)."""
    for row in range(Q.shape[0]):
        out[row, 0], out[row, 1], out[row, 2], out[row, 3], out[row, 4] = near(
            numbers, indices, at, Q[row], question, pairs
        )


@compiled
def place_bodies(numbers: Any, indices: Any, q: Any, at: Any) -> None:
    """Place the moving bodies at q (n,); see :func:`place`."""
    world = world_of(numbers, indices)
    place(world, q, np.empty((world.joints.shape[0], 12)), at)


@compiled
def measure(numbers: Any, indices: Any, at: Any, k: int, points: Any, normal: Any) -> Any:
    """``(lower, upper)`` bounds of the distance of the convex pair k at the placements of the bodies.

    Writes the closest points of both in the root frame, ``points`` (2, 3), and the unit vector ``normal`` (3,) from the
    first to the second along which their supports are ``lower`` apart.
    """
    world = world_of(numbers, indices)
    bodies, a, b = world.bodies, int(world.pairs[k, A]), int(world.pairs[k, B])
    rel, direction, simplex, local = np.empty(12), np.empty(3), np.empty(SIMPLEX), np.zeros((2, 3))
    relative(at, a, b, rel)
    for c in range(3):
        direction[c] = world.pairs[k, BEGIN + c]
    lower, upper = between(bodies, world.vertices, a, b, rel, direction, simplex, np.inf, -1.0, PRECISION)
    for i in range(4):
        if simplex[i, WEIGHT] > 0.0:
            for c in range(3):
                local[0, c] += simplex[i, WEIGHT] * simplex[i, 3 + c]
                local[1, c] += simplex[i, WEIGHT] * (simplex[i, c] + simplex[i, 3 + c])
    for c in range(3):
        local[0, c] += bodies[a, RADIUS] * direction[c]
        local[1, c] -= bodies[b, RADIUS] * direction[c]
    for r in range(3):
        x, y, z = at[a, 3 * r], at[a, 3 * r + 1], at[a, 3 * r + 2]
        normal[r] = x * direction[0] + y * direction[1] + z * direction[2]
        for side in range(2):
            points[side, r] = x * local[side, 0] + y * local[side, 1] + z * local[side, 2] + at[a, 9 + r]
    return lower, upper
