"""Sampled checks of straight edges in joint space: they guide the search and prove nothing.

The distance between samples depends on the motion of the bodies and not of the joints: a wrist may rotate far between
two samples. The end is checked first, then the middle, the quarters, and so on, so that contacts are found early. The
pair of the last contact is checked first, because nearby configurations touch with the same bodies.
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
"""The result for an edge: its samples are free; one is not; or they are free if coal finds those in ``asked`` free."""

MOST_LOOKS = 1024
"""Maximum number of samples of an edge; longer edges are sampled more coarsely, and left to the proof."""


class Room(NamedTuple):
    """The working arrays of the checks, created once so that no check allocates."""

    at: Any  # (B, 15) placements of the bodies
    axes: Any  # (m, 12) placements of the joints
    q: Any  # (n,) the sample
    pairs: Any  # (2, P) the pairs in contact, and those left to coal
    tally: Any  # (TALLY,)
    rel: Any  # (12,)
    direction: Any  # (3,)
    simplex: Any  # SIMPLEX
    asked: Any  # (MOST_LOOKS, n) samples that coal must judge
    counts: Any  # (3,) see below


ASKED, LOOKS, CULPRIT = 0, 1, 2
"""The counts: samples for coal; total number of checked samples; the pair of the last contact, or -1."""


@compiled
def room_of(world: Any, at: Any, asked: Any, counts: Any) -> Any:
    """A :class:`Room` around the arrays that persist between calls: placements, samples for coal, counts."""
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
    """Check the samples after a (n,) up to and including b (n,); FREE, BLOCKED or ASK.

    Parameters
    ----------
    world
        The checker's :class:`~pinproof.kernels.world.World`.
    resolution
        Metres that bodies move between two samples, estimated at b.
    room
        A :class:`Room`. The samples that coal must judge are the first ``counts[ASKED]`` of ``asked``.
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
    """Whether the sample ``room.q`` is in contact; a sample that coal must judge is added to ``room.asked``."""
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
    """The largest motion (m) of a point of a body between a and b (n,), with the placements at b.

    It uses the speeds at b: a good estimate for the whole edge, but not a bound.
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
