"""Straight edges in joint space, looked at in samples: what steers a search, and proves nothing.

Samples are as far apart as the bodies move, not as the joints do: a wrist may turn a long way between two looks. The
end comes first, then the middle, the quarters, ...: where an edge is blocked, that is met early. The pair that touched
last is asked first: nearby configurations touch with the same bodies.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pinproof.kernels.approach import speed
from pinproof.kernels.compiled import compiled
from pinproof.kernels.gjk import SIMPLEX
from pinproof.kernels.near import CONTACTS, FIRST_ONLY, LEFT, TALLY, look_around
from pinproof.kernels.placing import place
from pinproof.kernels.world import (
    JOINT,
    LEADER,
    MULTIPLIER,
    PARENT,
    world_of,
)

__all__ = ["ASK", "BLOCKED", "FREE", "MOST_LOOKS", "Room", "look", "look_along", "room_of"]

FREE, BLOCKED, ASK = 0, 1, 2
"""What is said of an edge: its samples are free; one is not; they are if coal finds those in ``asked`` free."""

MOST_LOOKS = 1024
"""Samples of an edge at most: beyond it the edge is looked at more coarsely, and left to the proof."""


class Room(NamedTuple):
    """The arrays that looks work in, made once so that no look allocates."""

    at: Any  # (B, 15) placements of the bodies
    axes: Any  # (m, 12) placements of the joints
    q: Any  # (n,) the sample
    pairs: Any  # (2, P) the pairs in contact, and those left to coal
    tally: Any  # (TALLY,)
    rel: Any  # (12,)
    direction: Any  # (3,)
    simplex: Any  # SIMPLEX
    asked: Any  # (MOST_LOOKS, n) samples for coal to judge
    counts: Any  # (3,) see below


ASKED, LOOKS, CULPRIT = 0, 1, 2
"""Of the counts: samples for coal; samples looked at, ever; the pair that touched last, or -1."""


@compiled
def room_of(world: Any, at: Any, asked: Any, counts: Any) -> Any:
    """A :class:`Room` around the arrays that outlive one call: placements, samples for coal, counts."""
    return Room(
        at,
        np.empty((world.joints.shape[0], 12)),
        np.empty(asked.shape[1]),
        np.empty((2, max(world.pairs.shape[0], 1)), np.int64),
        np.empty(TALLY),
        np.empty(12),
        np.empty(3),
        np.empty(SIMPLEX),
        asked,
        counts,
    )


@compiled
def look(numbers: Any, indices: Any, at: Any, edge: Any, resolution: float, asked: Any, counts: Any) -> int:
    """:func:`look_along` one edge (2, n) in a flattened world."""
    world = world_of(numbers, indices)
    return look_along(world, edge[0], edge[1], resolution, room_of(world, at, asked, counts))


@compiled
def look_along(world: Any, a: Any, b: Any, resolution: float, room: Any) -> int:
    """Look at the samples after a (n,) up to and with b (n,); FREE, BLOCKED or ASK.

    Parameters
    ----------
    world
        The checker's :class:`~pinproof.kernels.world.World`.
    resolution
        Metres that bodies move between two samples, as far as can be told from b.
    room
        A :class:`Room`. The samples that only coal can judge are the first ``counts[ASKED]`` of ``asked``.
    """
    q, counts = room.q, room.counts
    counts[ASKED] = 0
    for j in range(q.shape[0]):
        q[j] = b[j]
    if _look(world, room):
        return BLOCKED
    looks = _motion(world, a, b, room.at, room.axes) / resolution
    steps = max(math.ceil(looks), 1) if looks < MOST_LOOKS else MOST_LOOKS
    stride = 1
    while stride < steps:
        stride *= 2
    stride //= 2
    while stride >= 1:
        for index in range(stride, steps, 2 * stride):
            share = index / steps
            for j in range(q.shape[0]):
                q[j] = a[j] + (b[j] - a[j]) * share
            if _look(world, room):
                return BLOCKED
        stride //= 2
    return ASK if counts[ASKED] > 0 else FREE


@compiled
def _look(world: Any, room: Any) -> bool:
    """Whether the sample ``room.q`` is in contact; if only coal can tell, it is put down among the asked."""
    tally, counts = room.tally, room.counts
    counts[LOOKS] += 1
    if not place(world, room.q, room.axes, room.at):
        return True
    tally[CONTACTS] = tally[LEFT] = 0.0
    if look_around(
        world.bodies, world.vertices, world.pairs, world.own, world.around, world.outer, world.tree, world.widest,
        room.at, FIRST_ONLY, room.pairs[0], room.pairs[1], counts[CULPRIT:], tally,
        room.rel, room.direction, room.simplex,
    ):  # fmt: skip
        return True
    if tally[LEFT] > 0.0:
        asked, row = room.asked, counts[ASKED]
        for j in range(room.q.shape[0]):
            asked[row, j] = room.q[j]
        counts[ASKED] = row + 1
    return False


@compiled
def _motion(world: Any, a: Any, b: Any, at: Any, axes: Any) -> float:
    """How far (m) a point of a body moves at most between a and b (n,), where the arm stands at b.

    The speeds are those at b: a good guess for the whole edge, and no bound.
    """
    joints, bodies, most = world.joints, world.bodies, 0.0
    for body in range(world.outer.shape[0]):
        way, k = 0.0, int(bodies[body, JOINT])
        while k >= 0:
            leader = int(joints[k, LEADER])
            way += abs(joints[k, MULTIPLIER] * (b[leader] - a[leader])) * speed(joints, bodies, at, axes, body, k)
            k = int(joints[k, PARENT])
        most = max(most, way)
    return most
