"""The proof for a whole curve: intervals in path order, bisected until every pair of bodies is decided on them.

The question, the results and the remaining work are in arrays of the caller, so that the loop can stop at any point,
for coal to judge bodies without a support function, and resume. :mod:`pinproof.collision.certify` explains the method.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.approach import MORE, TURN_COLUMNS, closely, roughly, speeds, swings, way
from pinproof.kernels.compiled import compiled
from pinproof.kernels.gjk import SIMPLEX, between, relative
from pinproof.kernels.near import PRECISION, apart, ball_to_node
from pinproof.kernels.placing import place
from pinproof.kernels.world import BALL, CONVEX, JOINT, LEAF, MARGIN, OUTSIDE, SKIP, A, B, world_of

__all__ = ["sweep"]

DONE, ASK, GROW = 0, 1, 2
"""Why the loop stopped: it is finished; coal must judge the pairs in ``asked``; ``lists`` or ``log`` is full."""

# Of the state:
TOP, INTERVALS, OBSERVED, SPARE, PROVEN, JOINT_TUBE, OBSTACLE_TUBE = 0, 1, 2, 3, 4, 5, 6
"""Entries on the stack; number of intervals; smallest distance found; smallest difference of distance and margin;
smallest proven distance; by how much each joint, or each obstacle, could deviate with the proof still valid."""
FOUND, FOUND_TIME, FOUND_PAIR = 7, 8, 9
"""Whether a contact was found, when, and of which pair."""
OPEN, OPEN_START, OPEN_END, OPEN_PAIR, OPEN_DISTANCE, LAST = 10, 11, 12, 13, 14, 15
"""Whether a span is undecided, the first such one, and its least proven pair; the interval up to which to continue."""
ASKED, LOGGED = 16, 17
"""The number of pairs for coal; the number of rows written to the log."""
STATE_SIZE = 18

# Of the settings:
TOLERANCE, MAX_INTERVALS, OBSTACLES, GOAL_SHARE, LOOK_AHEAD = 0, 1, 2, 3, 4

HOPELESS = 4.0
"""Times their distance: the support gap is not computed if two bodies may approach each other by more."""

COARSE = 0.02
"""Fraction of the clearance that is proven: no pair is measured more accurately."""

EVERYTHING = -1
"""Length of a list of pairs that stands for all moving pairs."""

LOG_COLUMNS = 7
"""The rows of a proof: start, end, pair, proven distance, direction in the root frame (zeros: balls)."""


@compiled
def sweep(
    numbers: Any,
    indices: Any,
    knots: Any,
    control: Any,
    extra: Any,
    settings: Any,
    at: Any,
    spans: Any,
    ranges: Any,
    pieces: Any,
    lists: Any,
    directions: Any,
    seen: Any,
    asked: Any,
    told: Any,
    state: Any,
    found_q: Any,
    log: Any,
) -> int:
    """Continue the proof until it is finished or the caller is needed.

    Parameters
    ----------
    numbers, indices, at
        The flattened world and the placements of its bodies, as for :func:`pinproof.kernels.near.near`.
    knots, control
        The curve (k + 1,), (k, degree + 1, n), see :mod:`pinproof.motion.bezier`.
    extra
        (n,) the allowed deviation of each joint from the curve.
    settings
        The tolerance (m), the budget of intervals, the allowed displacement of obstacles (m; included in the margins of
        their pairs), the fraction of the clearance to prove, the number of intervals to check after an undecided span.
    spans, ranges, pieces
        The stack of intervals: (D, 2) start and end; (D, 4) first piece and the one after the last, beginning and
        length of its list of open pairs; (D, degree + 1, n) control points if it is part of a single piece.
    lists
        The concatenated lists of open pairs.
    directions
        (P, 3) the direction that last separated each pair, in the first body's frame; zeros at first.
    seen
        (P,) the distance (m) of each pair at that time; infinity at first.
    asked, told
        (P,) the pairs that coal must judge at ``found_q[1]``; (P, 3) its results: the interval, the distance, and the
        proven distance.
    state
        See the names above.
    found_q
        (2, n) the configuration of the contact, and the one being checked.
    log
        (L, 7) rows of :data:`LOG_COLUMNS`; with L = 0 nothing is written.
    """
    world = world_of(numbers, indices)
    joints, bodies, vertices, pairs = world.joints, world.bodies, world.vertices, world.pairs
    own, around, outer, tree = world.own, world.around, world.outer, world.tree
    widest, rounding = world.widest[0], world.widest[1]
    m, robot, n, last = joints.shape[0], outer.shape[0], extra.shape[0], control.shape[1] - 1
    turns, rho, path = np.empty((m, TURN_COLUMNS)), np.empty((robot, m)), np.empty(m, np.int64)
    axes, u = np.empty((m, 12)), np.empty(3)
    rel, simplex = np.empty(12), np.empty(SIMPLEX)
    middle, delta = found_q[1], np.empty(n)
    halves = np.empty((2, last + 1, n))
    while state[TOP] > 0.0:
        top = int(state[TOP]) - 1
        start, end = spans[top, 0], spans[top, 1]
        first, behind, begin, length = ranges[top, 0], ranges[top, 1], ranges[top, 2], ranges[top, 3]
        piece = pieces[top]
        if behind - first > 1:
            half = (first + behind) // 2
            time = knots[half]
            _stand(control[half], 0, middle, delta)
            for i in range(first, behind):
                _widen(control[i], middle, delta)
        else:
            half, time = first, 0.5 * (start + end)
            _halve(piece, halves)
            _stand(halves[0], last, middle, delta)
            _widen(piece, middle, delta)
        place(world, middle, axes, at)
        swings(joints, delta, extra, turns)
        speeds(joints, bodies, at, axes, rho)
        proven, joint_tube, obstacle_tube = state[PROVEN], state[JOINT_TUBE], state[OBSTACLE_TUBE]
        if length == EVERYTHING:
            if lists.shape[0] < begin + pairs.shape[0]:
                return GROW
            length = own.shape[0]
            for i in range(length):
                lists[begin + i] = own[i]
            level = widest
            if math.isfinite(state[SPARE]):
                level += settings[GOAL_SHARE] * max(state[SPARE], 0.0)
            for body in around:
                count, _ = way(joints, int(bodies[body, JOINT]), -1, path)
                near, growth, _, _ = roughly(rho, turns, path, count, body, robot)
                row, left_out = 0, False
                while row < tree.shape[0]:
                    if ball_to_node(at, body, bodies[body, BALL], tree, row) - near - rounding > level:
                        row, left_out = int(tree[row, SKIP]), True
                        continue
                    leaf = int(tree[row, LEAF])
                    row += 1
                    if leaf >= 0 and outer[body, leaf - robot] >= 0:
                        lists[begin + length] = outer[body, leaf - robot]
                        length += 1
                if left_out:
                    room = level - widest
                    proven, obstacle_tube = min(proven, level - settings[OBSTACLES]), min(obstacle_tube, room)
                    joint_tube = min(joint_tube, room / growth if growth > 0.0 else np.inf)
        here = begin + length
        if lists.shape[0] < here + length or (log.shape[0] > 0 and log.shape[0] < state[LOGGED] + length):
            return GROW
        still_open, left = 0, 0
        step = 0.0
        weakest, weakest_pair, weakest_distance, weakest_proven = np.inf, -1, np.inf, np.inf
        open_joint_tube, open_obstacle_tube = np.inf, np.inf
        contact, contact_pair = np.inf, -1
        logged = int(state[LOGGED])
        for index in range(begin, begin + length):
            k = lists[index]
            a, b, outside = int(pairs[k, A]), int(pairs[k, B]), pairs[k, OUTSIDE] != 0.0
            moved = settings[OBSTACLES] if outside else 0.0
            goal = margin = pairs[k, MARGIN]
            if math.isfinite(state[SPARE]):
                goal += settings[GOAL_SHARE] * max(state[SPARE], 0.0)
            count, up = way(joints, int(bodies[a, JOINT]), int(bodies[b, JOINT]), path)
            near, growth, bare, split = roughly(rho, turns, path, count, a, b)
            enough = goal + near + rounding
            lower, most = apart(bodies, at, a, b, enough), np.inf
            distance = np.inf
            u[:] = 0.0
            if not lower > enough:
                if bodies[a, CONVEX] == 0.0 or bodies[b, CONVEX] == 0.0:
                    if told[k, 0] != state[INTERVALS] + 1.0:
                        asked[left] = k
                        left += 1
                        continue
                    distance, lower = told[k, 1], max(lower, told[k, 2])
                else:
                    # If bodies may move by far more than their distance, nothing can be decided for the interval; only
                    # contact at this
                    # configuration is checked.
                    hopeless = behind - first > 1 or near > HOPELESS * max(seen[k], goal)
                    relative(at, a, b, rel)
                    lower, distance = between(
                        bodies,
                        vertices,
                        a,
                        b,
                        rel,
                        directions[k],
                        simplex,
                        margin if hopeless else enough,
                        margin,
                        max(PRECISION, COARSE * (goal - margin)),
                    )
                    if distance < np.inf:
                        seen[k] = distance
                    if not hopeless and not lower > enough and distance > margin:
                        for i in range(3):
                            x, y, z = at[a, 3 * i], at[a, 3 * i + 1], at[a, 3 * i + 2]
                            u[i] = x * directions[k, 0] + y * directions[k, 1] + z * directions[k, 2]
                        tighter, steeper = closely(
                            joints, bodies, at, axes, rho, turns, extra, path, count, up, split, a, b, u, piece, middle
                        )
                        if tighter < near:
                            near, growth, most = tighter, steeper, MORE
                state[OBSERVED] = min(state[OBSERVED], distance)
                state[SPARE] = min(state[SPARE], distance - margin)
            certain = lower - near - rounding
            room = certain - margin
            tube = min(most, room / growth) if growth > 0.0 else np.inf
            if log.shape[0] > 0 and room > 0.0:
                log[logged, 0], log[logged, 1], log[logged, 2], log[logged, 3] = start, end, k, certain
                log[logged, 4], log[logged, 5], log[logged, 6] = u[0], u[1], u[2]
                logged += 1
            if certain > goal:
                proven = min(proven, certain - moved)
                joint_tube = min(joint_tube, tube)
                if outside:
                    obstacle_tube = min(obstacle_tube, room)
                continue
            lists[here + still_open] = k
            still_open += 1
            step = max(step, bare)
            if distance - margin <= 0.0 and distance - margin < contact:
                contact, contact_pair = distance - margin, k
            weakest_proven = min(weakest_proven, certain - moved)
            open_joint_tube = min(open_joint_tube, tube)
            if outside:
                open_obstacle_tube = min(open_obstacle_tube, room)
            if not room >= weakest:
                weakest, weakest_pair, weakest_distance = room, k, distance
                if np.isnan(room):  # The configuration proves nothing, whichever pair comes after it.
                    weakest = -np.inf
        if left > 0:
            state[ASKED] = left
            return ASK
        state[TOP] = top
        state[INTERVALS] += 1.0
        state[LOGGED] = logged
        state[PROVEN], state[JOINT_TUBE], state[OBSTACLE_TUBE] = proven, joint_tube, obstacle_tube
        if contact_pair >= 0:
            state[FOUND], state[FOUND_TIME], state[FOUND_PAIR], state[TOP] = 1.0, time, contact_pair, 0.0
            for j in range(n):
                found_q[0, j] = middle[j]
            top = 0
        if still_open == 0:
            continue
        spent = state[INTERVALS] >= settings[MAX_INTERVALS]
        if step < settings[TOLERANCE] or spent or top + 2 > spans.shape[0]:
            if weakest > 0.0:  # Less than the fraction that was requested, but proven.
                state[PROVEN] = min(state[PROVEN], weakest_proven)
                state[JOINT_TUBE] = min(state[JOINT_TUBE], open_joint_tube)
                state[OBSTACLE_TUBE] = min(state[OBSTACLE_TUBE], open_obstacle_tube)
                continue
            fresh = state[OPEN] == 0.0
            if fresh:
                state[OPEN], state[OPEN_START], state[OPEN_END] = 1.0, start, end
                state[OPEN_PAIR], state[OPEN_DISTANCE] = weakest_pair, weakest_distance
                state[LAST] = state[INTERVALS] + settings[LOOK_AHEAD]
            if state[FOUND] != 0.0 or state[INTERVALS] >= min(state[LAST], settings[MAX_INTERVALS]):
                break
            if start < end:  # A contact that begins here is found at the end of the interval, or shortly after it.
                spans[top, 0] = spans[top, 1] = end
                ranges[top, 0], ranges[top, 1] = behind - 1, behind
                ranges[top, 2], ranges[top, 3] = here, still_open
                tip = control[behind - 1] if behind - first > 1 else piece
                for r in range(last, -1, -1):
                    for j in range(n):
                        pieces[top, r, j] = tip[last, j]
                state[TOP] = top + 1
            continue
        for side in range(2):
            if side == 0 and contact_pair >= 0:
                continue  # Only what comes before a contact matters.
            row = int(state[TOP])
            spans[row, 0], spans[row, 1] = (time, end) if side == 0 else (start, time)
            ranges[row, 0], ranges[row, 1] = first, behind
            ranges[row, 2], ranges[row, 3] = here, still_open
            if behind - first > 1:
                if side == 0:
                    ranges[row, 0] = half
                else:
                    ranges[row, 1] = half
                if ranges[row, 1] - ranges[row, 0] == 1:
                    _copy(control[ranges[row, 0]], pieces[row])
            else:
                _copy(halves[1 - side], pieces[row])
            state[TOP] = row + 1
    state[TOP] = 0.0
    return DONE


@compiled
def _copy(source: Any, target: Any) -> None:
    """Copy points (degree + 1, n) by elements, because numba takes seconds to compile an assignment of slices."""
    for r in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[r, j] = source[r, j]


@compiled
def _stand(points: Any, r: int, middle: Any, delta: Any) -> None:
    """Make point r the ``middle`` (n,), with a box of zero size around it."""
    for j in range(middle.shape[0]):
        middle[j], delta[j] = points[r, j], 0.0


@compiled
def _widen(control: Any, middle: Any, delta: Any) -> None:
    """Extend ``delta`` (n,) from ``middle`` to all control points (degree + 1, n), and so to their curve."""
    for r in range(control.shape[0]):
        for j in range(control.shape[1]):
            delta[j] = max(delta[j], abs(control[r, j] - middle[j]))


@compiled
def _halve(control: Any, halves: Any) -> None:
    """Bisect a piece (degree + 1, n) into ``halves`` (2, degree + 1, n) (de Casteljau)."""
    last = control.shape[0] - 1
    _copy(control, halves[1])
    for r in range(last + 1):
        for j in range(control.shape[1]):
            halves[0, r, j] = halves[1, 0, j]
            for i in range(last - r):
                halves[1, i, j] = 0.5 * (halves[1, i, j] + halves[1, i + 1, j])
