"""Two trees in joint space that grow towards each other, until they meet or something is needed.

All that the search knows lies in arrays of the caller's. So the loop can stop between any two edges, for coal to judge
samples or for the caller to look at the clock, and go on from there: how often it stops changes nothing.

Source: J. Kuffner, S. LaValle (2000), "RRT-Connect: an efficient approach to single-query path planning", ICRA.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import compiled
from pinproof.kernels.rrt_edge import ASK, BLOCKED, FREE, LOOKS, look_along, room_of
from pinproof.kernels.world import world_of

__all__ = ["ASK", "BLOCKED", "FREE", "STATE_SIZE", "grow", "nearest"]

MET, COAL, DRAWS, NODES, SPENT, PAUSED = range(6)
"""Why the loop stopped: two nodes coincide; coal is to judge the samples in ``asked``; the numbers drawn are used up;
a tree needs more room; one of the budgets is spent; as many samples were looked at as was told."""

# Of the state:
SIZE, DRAWN, SAMPLES, PHASE, TREE, NEAR, HALVINGS, TOLD = 0, 2, 3, 4, 5, 6, 7, 8
"""Nodes of either tree (2); rows of ``draws`` used; random samples, ever; what is being done, in which tree, from which
node, after how many halvings; what coal said of the edge: FREE, BLOCKED, or ASK: nothing yet."""
MOST_NODES, MOST_SAMPLES, UNTIL = 9, 10, 11
"""The budgets, and the looks at which to stop."""
AT_START, AT_GOAL = 12, 13
"""The nodes that met."""
STATE_SIZE = 14

SAMPLE, EXTEND, CONNECT = 0, 1, 2

# Of the settings:
STEP, RESOLUTION, NEAR_SHARE = 0, 1, 2

SHORTENINGS = 3
"""How often a blocked step is halved before a tree gives a sample up."""


@compiled
def grow(
    numbers: Any,
    indices: Any,
    at: Any,
    settings: Any,
    boxes: Any,
    draws: Any,
    nodes: Any,
    parents: Any,
    state: Any,
    ends: Any,
    asked: Any,
    counts: Any,
) -> int:
    """Go on until the trees meet, a budget is spent or something is needed.

    Parameters
    ----------
    numbers, indices, at
        The flattened world and the placements of its bodies, as for :func:`pinproof.kernels.near.near`.
    settings
        The longest edge (rad or m); the metres between two samples of an edge; the share of random samples that lie in
        one of the first boxes.
    boxes
        (k, 2, n) lower and upper corners in which random samples lie; the last is for those that lie anywhere.
    draws
        (N, n + 2) numbers in [0, 1).
    nodes, parents
        (2, N, n) and (2, N): the tree of the start and that of the goals. A root is its own parent.
    state
        See the names above.
    ends
        (2, n) where the tree is to grow to, and the end of the edge that is being looked at.
    asked, counts
        As for :func:`pinproof.kernels.rrt_edge.room_of`.
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
            _draw(draws[state[DRAWN]], settings[NEAR_SHARE], boxes, target)
            state[DRAWN] += 1
            state[SAMPLES] += 1
            state[TREE] = 0 if state[SIZE] <= state[SIZE + 1] else 1  # the smaller one
            state[PHASE], state[HALVINGS] = EXTEND, 0
            state[NEAR] = nearest(nodes[state[TREE]], state[SIZE + state[TREE]], target)
        tree = state[TREE]
        size = state[SIZE + tree]
        if size == nodes.shape[1]:
            return NODES
        start = nodes[tree, state[NEAR]]
        gap = 0.0
        for j in range(n):
            gap += (target[j] - start[j]) ** 2
        gap = math.sqrt(gap)
        if gap == 0.0:  # a sample that is a node, or a root of the one tree that the other has come to
            met, state[PHASE] = state[PHASE] == CONNECT, SAMPLE
            state[AT_START + tree] = state[NEAR]
            if met:
                return MET
            continue
        share = min(settings[STEP] / gap, 1.0) * 0.5 ** state[HALVINGS]
        for j in range(n):
            end[j] = target[j] if share == 1.0 else start[j] + (target[j] - start[j]) * share
        said = state[TOLD]
        state[TOLD] = ASK
        if said == ASK:
            said = look_along(world, start, end, settings[RESOLUTION], room)
            if said == ASK:
                return COAL
        if said != FREE:
            state[HALVINGS] += 1
            if state[PHASE] == CONNECT or state[HALVINGS] > SHORTENINGS:
                state[PHASE] = SAMPLE
            continue
        for j in range(n):
            nodes[tree, size, j] = end[j]
        parents[tree, size] = state[NEAR]
        state[SIZE + tree] = size + 1
        if state[PHASE] == EXTEND:  # now the other tree comes to this node
            for j in range(n):
                target[j] = end[j]
            state[TREE], state[PHASE], state[HALVINGS] = 1 - tree, CONNECT, 0
            state[NEAR] = nearest(nodes[1 - tree], state[SIZE + 1 - tree], target)
            state[AT_START + tree] = size
        else:
            state[NEAR] = size
            if share == 1.0:
                state[AT_START + tree], state[PHASE] = size, SAMPLE
                return MET
    return PAUSED


@compiled
def _draw(numbers: Any, near_share: float, boxes: Any, target: Any) -> None:
    """A random sample (n,) from n + 2 numbers in [0, 1)."""
    last = boxes.shape[0] - 1
    box = int(numbers[1] * last) if numbers[0] < near_share else last
    for j in range(target.shape[0]):
        target[j] = boxes[box, 0, j] + numbers[2 + j] * (boxes[box, 1, j] - boxes[box, 0, j])


@compiled
def nearest(nodes: Any, size: int, q: Any) -> int:
    """The first of the nodes (size, n) nearest to q (n,), by the Euclidean distance in joint space."""
    best, index = math.inf, 0
    for i in range(size):
        gap = 0.0
        for j in range(q.shape[0]):
            gap += (nodes[i, j] - q[j]) ** 2
        if gap < best:
            best, index = gap, i
    return index
