"""Which pairs of bodies are near at one configuration: those that touch, or the nearest of all.

Far pairs are settled by balls and boxes, obstacles many at once by a tree of boxes; :mod:`pinproof.kernels.gjk` judges
the rest. Pairs with a body that has no support function are handed back, for coal to judge.
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
    "EVERY",
    "FIRST_ONLY",
    "NEAREST",
    "PRECISION",
    "TALLY",
    "apart",
    "ball_to_node",
    "judge",
    "measure",
    "near",
    "near_many",
    "place_bodies",
]

FIRST_ONLY, EVERY, NEAREST = 0, 1, 2
"""What is asked: whether there is a contact; which pairs are in contact; which is nearest, and which overlap."""

PRECISION = 1e-9
"""Metres between the two bounds of a distance at which the walk between two bodies is content."""

CONTACTS, LEFT, LOWER, UPPER, PAIR = 0, 1, 2, 3, 4
"""The tally of one question: pairs in contact, pairs left to coal, and what is asked as ``NEAREST``."""
TALLY = 5


@compiled
def near(numbers: Any, indices: Any, at: Any, q: Any, question: int, pairs: Any) -> Any:
    """``(contacts, left to coal, lower, upper, nearest)`` at q (n,); -1 contacts where q is not finite.

    A pair is in contact unless it is proven farther apart than its margin; for ``NEAREST``, than 0. The pairs in
    contact go to ``pairs[0]``, those left to coal to ``pairs[1]``, each (P,). ``lower`` and ``upper`` bound the least
    distance (m) over all pairs but these, ``nearest`` is the pair of ``upper``; only ``NEAREST`` looks for them.
    ``numbers`` and ``indices`` are a flattened :class:`~pinproof.kernels.world.World`, ``at`` the placements that
    :func:`place` writes.
    """
    world = world_of(numbers, indices)
    if not place(world, q, np.empty((world.joints.shape[0], 12)), at):
        return -1, 0, 0.0, 0.0, -1
    found, asked = pairs[0], pairs[1]
    tally, rel, direction, simplex = np.zeros(TALLY), np.empty(12), np.empty(3), np.empty(SIMPLEX)
    tally[LOWER], tally[UPPER], tally[PAIR] = np.inf, np.inf, -1.0
    bodies, tree, robot = world.bodies, world.tree, world.outer.shape[0]
    for i in range(robot):
        body = robot - 1 - i  # from the hand inwards: it is the likeliest to touch
        row = 0
        while row < tree.shape[0]:
            limit = world.widest[0] + world.widest[1] if question != NEAREST else tally[UPPER]
            if ball_to_node(at, body, bodies[body, BALL], tree, row) > limit:
                row = int(tree[row, SKIP])
                continue
            leaf = int(tree[row, LEAF])
            row += 1
            if leaf < 0 or apart(bodies, at, body, leaf, limit) > limit:
                continue
            k = world.outer[body, leaf - robot]
            if k >= 0 and judge(world, at, k, question, found, asked, tally, rel, direction, simplex):
                return 1, 0, 0.0, 0.0, -1
    for k in world.own:
        limit = world.pairs[k, MARGIN] + world.widest[1] if question != NEAREST else tally[UPPER]
        if apart(bodies, at, int(world.pairs[k, A]), int(world.pairs[k, B]), limit) > limit:
            continue
        if judge(world, at, k, question, found, asked, tally, rel, direction, simplex):
            return 1, 0, 0.0, 0.0, -1
    return int(tally[CONTACTS]), int(tally[LEFT]), tally[LOWER], tally[UPPER], int(tally[PAIR])


@compiled
def judge(
    world: Any,
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
    """Judge pair k, which balls and boxes did not settle; whether the question is answered."""
    a, b, margin = int(world.pairs[k, A]), int(world.pairs[k, B]), world.pairs[k, MARGIN]
    limit = margin + world.widest[1] if question != NEAREST else tally[UPPER]
    if world.bodies[a, CONVEX] == 0.0 or world.bodies[b, CONVEX] == 0.0:
        asked[int(tally[LEFT])] = k
        tally[LEFT] += 1
        return False
    relative(at, a, b, rel)
    for c in range(3):
        direction[c] = world.pairs[k, BEGIN + c]
    below = margin if question != NEAREST else -1.0
    lower, upper = between(world.bodies, world.vertices, a, b, rel, direction, simplex, limit, below, PRECISION)
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
    """From the box of a body to a point at (x, y, z) from its centre."""
    total = 0.0
    for i in range(3):
        out = abs(at[body, i] * x + at[body, 3 + i] * y + at[body, 6 + i] * z) - bodies[body, HALF + i]
        if out > 0.0:
            total += out * out
    return math.sqrt(total)


@compiled
def ball_to_node(at: Any, body: int, radius: float, tree: Any, row: int) -> float:
    """From a ball about the centre of a body to a box of the tree; 0 or less where they meet."""
    total = 0.0
    for i in range(3):
        x = at[body, MIDDLE + i]
        out = max(tree[row, LOW + i] - x, x - tree[row, HIGH + i])
        if out > 0.0:
            total += out * out
    return math.sqrt(total) - radius


@compiled
def near_many(numbers: Any, indices: Any, at: Any, Q: Any, question: int, pairs: Any, out: Any) -> None:
    """The answer of :func:`near` at each row of Q (N, n) into ``out`` (N, 5)."""
    for row in range(Q.shape[0]):
        out[row, 0], out[row, 1], out[row, 2], out[row, 3], out[row, 4] = near(
            numbers, indices, at, Q[row], question, pairs
        )


@compiled
def place_bodies(numbers: Any, indices: Any, q: Any, at: Any) -> None:
    """Place the moving bodies at q (n,), see :func:`place`."""
    world = world_of(numbers, indices)
    place(world, q, np.empty((world.joints.shape[0], 12)), at)


@compiled
def measure(numbers: Any, indices: Any, at: Any, k: int, points: Any, normal: Any) -> Any:
    """``(lower, upper)`` bounds of the distance of the convex pair k where its bodies stand.

    Writes the nearest points of both in the root frame, ``points`` (2, 3), and the unit vector ``normal`` (3,) from the
    first to the second, along which their supports are ``lower`` apart.
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
