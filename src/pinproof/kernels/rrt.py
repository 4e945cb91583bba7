"""Two trees in joint space that grow towards each other until they meet or the loop needs the caller.

The complete state of the search is in arrays of the caller. The loop can therefore stop between any two edges, for coal
to judge samples or for the caller to check the time, and resume; how often it stops does not change the result.

A random sample is drawn about a random node of the growing tree and not over all joint ranges, where most samples would
extend the trees in useless directions.

Source: J. Kuffner, S. LaValle (2000), "RRT-Connect: an efficient approach to single-query path planning", ICRA.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.compiled import compiled
from pinproof.kernels.rrt_edge import ASK, BLOCKED, FREE, LOOKS, look_along, room_of
from pinproof.kernels.world import world_of

__all__ = ["ASK", "BLOCKED", "FREE", "STATE_SIZE", "grow", "nearest"]

MET, COAL, DRAWS, NODES, SPENT, PAUSED = range(6)
"""Why the loop stopped: two nodes coincide; coal must judge the samples in ``asked``; the random numbers are used
up; a tree needs more space; a budget is used up; or the given number of samples was checked."""

# Of the state:
SIZE, DRAWN, SAMPLES, PHASE, TREE, NEAR, TOLD = 0, 2, 3, 4, 5, 6, 7
"""The number of nodes of each tree (2); used rows of ``draws``; total number of random samples; the current action,
its tree, and its node; the result of coal for the edge: FREE, BLOCKED, or ASK if not known yet."""
MOST_NODES, MOST_SAMPLES, UNTIL = 8, 9, 10
"""The budgets, and the number of checked samples at which to stop."""
AT_START, AT_GOAL = 11, 12
"""The nodes that met."""
STATE_SIZE = 13

SAMPLE, EXTEND, CONNECT = 0, 1, 2

REACH = 2.5
"""rad or m. Samples are within this of a node in every joint. Among 1.5, 2.5, pi and the complete limits, this value
needed the fewest checks on arms among shelves and bars, the complete limits twice as many."""

NARROW_SHARE, NARROWEST = 0.2, 6.0
"""This fraction of the samples is within REACH / 2^x of a node, with x uniform in [0, NARROWEST]: in narrow spaces
all long steps are blocked."""


@compiled
def grow(
    numbers: Any,
    indices: Any,
    at: Any,
    step: float,
    resolution: float,
    box: Any,
    draws: Any,
    nodes: Any,
    parents: Any,
    state: Any,
    ends: Any,
    asked: Any,
    counts: Any,
    gap: Any,
) -> int:
    """Continue until the trees meet, a budget is used up, or the caller is needed.

    Parameters
    ----------
    numbers, indices, at
        The flattened world and the placements of its bodies, as for :func:`pinproof.kernels.near.near`.
    step
        The length of the longest edge (rad or m).
    resolution
        Metres that bodies move between two samples of an edge.
    box
        (2, n) lower and upper corner of the range of random samples.
    draws
        (N, n + 2) numbers in [0, 1).
    nodes, parents
        (2, N, n) and (2, N): the trees of the start and of the goals. A root is its own parent; a node at infinity
        has been removed.
    state
        See the names above.
    ends
        (2, n) the target of the growing tree, and the end of the edge that is being checked.
    asked, counts
        As for :func:`pinproof.kernels.rrt_edge.room_of`.
    gap
        (1,) the smallest distance found between a node of one tree and one of the other.
    """
    world = world_of(numbers, indices)
    room = room_of(world, at, asked, counts)
    n, target, end = ends.shape[1], ends[0], ends[1]
    while counts[LOOKS] < state[UNTIL]:
        if state[PHASE] == SAMPLE:
            if state[SIZE] + state[SIZE + 1] >= state[MOST_NODES] or state[SAMPLES] >= state[MOST_SAMPLES]:
                return SPENT
            if state[DRAWN] == draws.shape[0]:
                return DRAWS
            tree = 0 if state[SIZE] <= state[SIZE + 1] else 1  # the smaller one
            around = nodes[tree, int(draws[state[DRAWN], 1] * state[SIZE + tree])]
            _draw(draws[state[DRAWN]], around if np.isfinite(around[0]) else nodes[tree, 0], box, target)
            state[DRAWN] += 1
            state[SAMPLES] += 1
            state[TREE], state[PHASE] = tree, EXTEND
            state[NEAR] = nearest(nodes[tree], state[SIZE + tree], target)
        tree = state[TREE]
        size = state[SIZE + tree]
        if size == nodes.shape[1]:
            return NODES
        start = nodes[tree, state[NEAR]]
        left = 0.0
        for j in range(n):
            left += (target[j] - start[j]) ** 2
        left = math.sqrt(left)
        if state[PHASE] == CONNECT:
            gap[0] = min(gap[0], left)
        if left == 0.0:  # The sample is a node, or a root that the other tree has reached.
            met, state[PHASE] = state[PHASE] == CONNECT, SAMPLE
            state[AT_START + tree] = state[NEAR]
            if met:
                return MET
            continue
        share = min(step / left, 1.0)
        for j in range(n):
            end[j] = target[j] if share == 1.0 else start[j] + (target[j] - start[j]) * share
        said = state[TOLD]
        state[TOLD] = ASK
        if said == ASK:
            said = look_along(world, start, end, resolution, room)
            if said == ASK:
                return COAL
        if said != FREE:
            state[PHASE] = SAMPLE
            continue
        for j in range(n):
            nodes[tree, size, j] = end[j]
        parents[tree, size] = state[NEAR]
        state[SIZE + tree] = size + 1
        if state[PHASE] == EXTEND:  # Now the other tree grows to this node.
            for j in range(n):
                target[j] = end[j]
            state[TREE], state[PHASE] = 1 - tree, CONNECT
            state[NEAR] = nearest(nodes[1 - tree], state[SIZE + 1 - tree], target)
            state[AT_START + tree] = size
        else:
            state[NEAR] = size
            if share == 1.0:
                state[AT_START + tree], state[PHASE] = size, SAMPLE
                return MET
    return PAUSED


@compiled
def _draw(numbers: Any, around: Any, box: Any, target: Any) -> None:
    """A random sample (n,) about a node, from n + 2 numbers in [0, 1), the second of which selected the node."""
    reach = REACH
    if numbers[0] < NARROW_SHARE:
        reach *= 0.5 ** (NARROWEST * numbers[0] / NARROW_SHARE)
    for j in range(target.shape[0]):
        low, high = max(around[j] - reach, box[0, j]), min(around[j] + reach, box[1, j])
        target[j] = low + numbers[2 + j] * (high - low)


@compiled
def nearest(nodes: Any, size: int, q: Any) -> int:
    """The first of the nodes (size, n) closest to q (n,) by the Euclidean distance in joint space."""
    best, index = math.inf, 0
    for i in range(size):
        gap = 0.0
        for j in range(q.shape[0]):
            gap += (nodes[i, j] - q[j]) ** 2
        if gap < best:
            best, index = gap, i
    return index
