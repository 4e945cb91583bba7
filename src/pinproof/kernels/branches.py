r"""All configurations of an arm for a pose in closed form: the combination of the parts.

An arm is given as a ``plan``, an array of rows of 16 (made by :mod:`pinproof.ik.analytic.plan`):

====================  ==============================================================================================
row 0                 settings, see the constants below
rows 1 ... n + 1      the true chain of the arm (:mod:`pinproof.kernels.chain`), for the verification
row n + 2             the tool of the ideal arm at q = 0, with lengths relative to the size of the arm
row n + 3 and later   the lines of the ideal arm at q = 0 (:mod:`pinproof.kernels.vectors`): six, or seven with one
                      locked joint; then, at OWN, the index of the joint in q (-1: virtual, must be zero), and limits
====================  ==============================================================================================

The axes of the ideal arm meet or are parallel exactly. If those of the true arm do not, the solutions of the ideal arm
are the starts of Newton's method on the true chain. Every result is verified by forward kinematics of that chain and is
within the limits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.arctangent import angle_of
from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.lanes import ANGLE, DISTANCE, LANES, ROOM, TURN, lane_errors, wind
from pinproof.kernels.refinement import AT_LIMIT, refined
from pinproof.kernels.trigonometry import sincos
from pinproof.kernels.triple import STATES, triple
from pinproof.kernels.twins import WAYS, weakest_motion
from pinproof.kernels.two_curves import (
    BY_QUARTIC,
    CANDIDATES,
    COLUMNS,
    DOUBTFUL,
    FREED,
    NEAR,
    REFERENCE,
    UNDECIDED,
    WHICH,
    two_curves,
)
from pinproof.kernels.vectors import SLIDING, direction, dot, place, turned

__all__ = ["BAD_TARGET", "ELSEWHERE", "ROWS", "branches_of_many", "branches_of_one"]

# Row 0 of a plan. COUNT: n. FIRST_OF_TRIPLE: 0 to 3. NORMAL: the revolute line of the triple. LOCKED: a line, or -1.
COUNT, FIRST_OF_TRIPLE, PLANAR, REVERSED, NORMAL, LOCKED, SIZE = range(7)
BORDER, SPREAD, POSITION_TOLERANCE, ORIENTATION_TOLERANCE, MADE_UP_TOLERANCE, TOLERANCE, ROUNDING = range(7, 14)
OWN, LOWER, UPPER = 8, 9, 10
SOURCE = 8

# Columns after the n numbers of q in a row of the output, and columns of the row after the last solution.
POSITION_ERROR, ORIENTATION_ERROR, FREE_JOINTS, SIGNATURE = range(4)
ALL_FREE_JOINTS, FAILED, OUTSIDE, QUARTIC, IN_DOUBT = range(5)
# The last of these: bit 0 is set if a case was omitted; the other bits mark solutions with a free joint that have no
# row for the given value of that joint (see family.py for the order of the bits).

ROWS = 24
"""Rows for the solutions of one pose. Most poses have up to 8; if rounding does not decide whether a joint is free,
both cases are included."""

RIGID = 1e-6
"""As :data:`pinproof.spatial.RIGID_TOLERANCE`."""

GOOD_ENOUGH = 1e-10
"""M or rad. A branch with a larger error by forward kinematics is refined on the true chain."""

LIMIT_SLACK = 1e-9
"""Rad or m. A joint that exceeds its limit by at most this, due to rounding, is moved to the limit."""

NEAR_LIMITS = 0.5
"""Rad or m. A branch of an arm that deviates from the ideal is not refined if it is further outside; else AT_LIMIT."""

SAME_BRANCH = 1e-6
"""Rad or m. Branches that differ by less in every joint are the same, separated by rounding of a double root."""

NEARLY_SINGULAR = 0.5
"""Of the smallest singular value of the Jacobian, relative to the arm's size and the square root of SPREAD: below,
the deviation from the ideal may have moved two branches far apart, or removed one of them."""

ASTRAY = 0.05
"""M. A branch with a larger error after refinement is not close to any solution."""

BAD_TARGET = -1

ELSEWHERE = -2
"""Negative counts: joints are free at this target and there may be branches at other values of them, or there are
more branches than rows."""


@inlined
def workroom() -> Any:
    """The working arrays for one pose.

    Lines, candidates, states; one lane per branch, of q, of scratch and of errors; the target.
    """
    return (
        np.empty((6, 9)), np.zeros((CANDIDATES + 1, COLUMNS)), np.zeros((STATES, LANES)), np.zeros((7, LANES)),
        np.zeros((3, LANES)), np.zeros(ROOM), np.empty((3, 4)),
    )  # fmt: skip


@compiled
def branches_of_pose(plan: Any, target: Any, reference: Any, locked_at: float, room: Any, out: Any) -> int:
    """The distinct branches for ``target`` (4, 4) into ``out`` (k + 1, n + 4); their number, or BAD_TARGET."""
    lines, chosen, states, Q, scratch, lanes, pose = room
    n, size, s = int(plan[0, COUNT]), plan[0, SIZE], int(plan[0, FIRST_OF_TRIPLE])
    planar, reverse, locked = plan[0, PLANAR] != 0.0, plan[0, REVERSED] != 0.0, int(plan[0, LOCKED])
    tool, top = n + 2, n + 3

    # The target, orthonormalised (Newton's iteration for the polar factor: each step squares the error).
    R0, R1, R2 = (
        (target[0, 0], target[0, 1], target[0, 2]),
        (target[1, 0], target[1, 1], target[1, 2]),
        (target[2, 0], target[2, 1], target[2, 2]),
    )
    for step in range(3):
        g00, g11, g22, g01, g02, g12 = dot(R0, R0), dot(R1, R1), dot(R2, R2), dot(R0, R1), dot(R0, R2), dot(R1, R2)
        off = max(max(max(abs(g00 - 1.0), abs(g11 - 1.0)), abs(g22 - 1.0)), max(max(abs(g01), abs(g02)), abs(g12)))
        if step == 0:
            last_row = max(max(abs(target[3, 0]), abs(target[3, 1])), max(abs(target[3, 2]), abs(target[3, 3] - 1.0)))
            d = (
                R0[0] * (R1[1] * R2[2] - R1[2] * R2[1])
                + R0[1] * (R1[2] * R2[0] - R1[0] * R2[2])
                + R0[2] * (R1[0] * R2[1] - R1[1] * R2[0])
            )
            where = abs(target[0, 3]) + abs(target[1, 3]) + abs(target[2, 3])
            if not (off <= RIGID and last_row <= RIGID and d > 0.0 and where < math.inf):
                return BAD_TARGET
        if off <= 1e-14:
            break
        h0, h1, h2 = 1.5 - 0.5 * g00, 1.5 - 0.5 * g11, 1.5 - 0.5 * g22
        g01, g02, g12 = -0.5 * g01, -0.5 * g02, -0.5 * g12
        R0, R1, R2 = (
            (h0 * R0[0] + g01 * R1[0] + g02 * R2[0], h0 * R0[1] + g01 * R1[1] + g02 * R2[1],
             h0 * R0[2] + g01 * R1[2] + g02 * R2[2]),
            (g01 * R0[0] + h1 * R1[0] + g12 * R2[0], g01 * R0[1] + h1 * R1[1] + g12 * R2[1],
             g01 * R0[2] + h1 * R1[2] + g12 * R2[2]),
            (g02 * R0[0] + g12 * R1[0] + h2 * R2[0], g02 * R0[1] + g12 * R1[1] + h2 * R2[1],
             g02 * R0[2] + g12 * R1[2] + h2 * R2[2]),
        )  # fmt: skip
    for i in range(3):
        turn = R0 if i == 0 else R1 if i == 1 else R2
        pose[i, 0], pose[i, 1], pose[i, 2], pose[i, 3] = turn[0], turn[1], turn[2], target[i, 3]

    # The tool at zero, and G = target times its inverse; a locked joint moves the part of the chain after it.
    T0, T1, T2 = (
        (plan[tool, 0], plan[tool, 1], plan[tool, 2]),
        (plan[tool, 4], plan[tool, 5], plan[tool, 6]),
        (plan[tool, 8], plan[tool, 9], plan[tool, 10]),
    )
    t = (plan[tool, 3], plan[tool, 7], plan[tool, 11])
    lock_h, lock_o, lock_slides = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), True
    lock_s, lock_c = 0.0, 1.0
    if locked >= 0:
        lock_h, lock_o = direction(plan, top + locked), place(plan, top + locked)
        lock_slides = plan[top + locked, SLIDING] != 0.0
        if lock_slides:
            t = (
                t[0] + locked_at / size * lock_h[0],
                t[1] + locked_at / size * lock_h[1],
                t[2] + locked_at / size * lock_h[2],
            )
        else:
            lock_s, lock_c = sincos(locked_at)
            x = turned(lock_h, lock_c, lock_s, (T0[0], T1[0], T2[0]))
            y = turned(lock_h, lock_c, lock_s, (T0[1], T1[1], T2[1]))
            z = turned(lock_h, lock_c, lock_s, (T0[2], T1[2], T2[2]))
            T0, T1, T2 = (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])
            v = turned(lock_h, lock_c, lock_s, (t[0] - lock_o[0], t[1] - lock_o[1], t[2] - lock_o[2]))
            t = (v[0] + lock_o[0], v[1] + lock_o[1], v[2] + lock_o[2])
    G0 = (dot(R0, T0), dot(R0, T1), dot(R0, T2))
    G1 = (dot(R1, T0), dot(R1, T1), dot(R1, T2))
    G2 = (dot(R2, T0), dot(R2, T1), dot(R2, T2))
    shift = (target[0, 3] / size - dot(G0, t), target[1, 3] / size - dot(G1, t), target[2, 3] / size - dot(G2, t))
    C0, C1, C2 = (G0[0], G1[0], G2[0]), (G0[1], G1[1], G2[1]), (G0[2], G1[2], G2[2])

    # The six lines: the triple, then a, b, c; those before the triple are transformed by G^-1.
    normal, p0 = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(6):
        k = i if locked < 0 or i < locked else i + 1
        h, o = direction(plan, top + k), place(plan, top + k)
        if 0 <= locked < k:
            if lock_slides:
                o = (
                    o[0] + locked_at / size * lock_h[0],
                    o[1] + locked_at / size * lock_h[1],
                    o[2] + locked_at / size * lock_h[2],
                )
            else:
                h = turned(lock_h, lock_c, lock_s, h)
                v = turned(lock_h, lock_c, lock_s, (o[0] - lock_o[0], o[1] - lock_o[1], o[2] - lock_o[2]))
                o = (v[0] + lock_o[0], v[1] + lock_o[1], v[2] + lock_o[2])
        row = (i - s) % 6
        if i - s == int(plan[0, NORMAL]):
            normal, p0 = h, o
        if i < s:
            v = (o[0] - shift[0], o[1] - shift[1], o[2] - shift[2])
            h, o = (dot(C0, h), dot(C1, h), dot(C2, h)), (dot(C0, v), dot(C1, v), dot(C2, v))
        elif reverse and row < 3:
            row = 2 - row
            h = (-h[0], -h[1], -h[2])
        lines[row, 0], lines[row, 1], lines[row, 2], lines[row, 3], lines[row, 4], lines[row, 5] = (
            h[0], h[1], h[2], o[0], o[1], o[2])  # fmt: skip
        own, slides = int(plan[top + k, OWN]), plan[top + k, SLIDING]
        lines[row, SLIDING] = slides
        lines[row, REFERENCE] = 0.0 if own < 0 else reference[own] / (size if slides != 0.0 else 1.0)
        lines[row, SOURCE] = top + k
    v = (p0[0] - shift[0], p0[1] - shift[1], p0[2] - shift[2])
    p, n1 = (dot(C0, v), dot(C1, v), dot(C2, v)), (dot(C0, normal), dot(C1, normal), dot(C2, normal))

    border, spread = plan[0, BORDER], plan[0, SPREAD]
    kept = failed = outside = freed = by_quartic = doubtful = free_ones = with_members = 0
    # First without free joints; then, if rounding does not decide whether joints are free, with them free (bit 0:
    # outside
    # the triple, bit 1: inside). The latter count only if forward kinematics confirms them.
    undecided = 0
    for attempt in range(5):
        snap = 0
        if attempt > 0:
            if undecided == 0:
                break
            snap = 4 - attempt
            if (
                (snap == 3 and undecided & 1 == 0)
                or (snap == 2 and undecided & 2 == 0)
                or (snap == 1 and undecided & 3 != 3)
            ):
                continue
            if undecided & 8 == 0:  # Families come first: other rows may be members of them.
                undecided |= 8
                kept = 0
        curves = two_curves(
            lines, planar, p, p0, normal, n1, border, spread, plan[0, ROUNDING], plan[0, TOLERANCE], snap & 1, chosen
        )
        if curves >= BY_QUARTIC:
            by_quartic = 1
        curves %= BY_QUARTIC
        count = curves - curves  # Typed as a number and not as the literal 0, so that the triple is compiled only once.
        for i in range(curves):
            freed |= int(chosen[i, FREED])
            if count > LANES - 2:
                doubtful = 1
                break
            before = count
            count = triple(
                lines,
                planar,
                normal,
                reverse,
                (G0, G1, G2),
                shift,
                chosen,
                i,
                border,
                spread,
                snap >> 1 & 1,
                states,
                count,
            )
            if count == before and chosen[i, FREED] != 0.0:
                free_ones |= 3 << _number(2.0 * chosen[i, WHICH])
        undecided |= int(chosen[CANDIDATES, UNDECIDED])
        if chosen[CANDIDATES, DOUBTFUL] != 0.0:
            doubtful = 1

        # States to values, one solution per lane.
        width = 8 if count <= 8 else LANES
        for b in range(width):
            scratch[1, b] = 1.0 if b < count else 0.0
            scratch[2, b] = 0.0
        for row in range(6):
            line = int(lines[row, SOURCE])
            own, lower, upper = int(plan[line, OWN]), plan[line, LOWER], plan[line, UPPER]
            if lines[row, SLIDING] != 0.0:
                for b in range(width):
                    scratch[0, b] = size * states[2 * row, b]
            else:
                for b in range(width):
                    scratch[0, b] = angle_of(states[2 * row + 1, b], states[2 * row, b])
                if own >= 0:
                    for b in range(width):
                        scratch[0, b] = wind(scratch[0, b], lower, upper, LIMIT_SLACK, reference[own])
            if own >= 0:
                for b in range(width):
                    Q[own, b] = scratch[0, b]
                    scratch[2, b] = max(scratch[2, b], max(lower - scratch[0, b], scratch[0, b] - upper))
            else:
                for b in range(width):
                    if not abs(scratch[0, b]) <= plan[0, MADE_UP_TOLERANCE] + NEAR * states[15, b]:
                        scratch[1, b] = 0.0
        if locked >= 0:
            own = int(plan[top + locked, OWN])
            outside_by = max(plan[top + locked, LOWER] - locked_at, locked_at - plan[top + locked, UPPER])
            for b in range(width):
                Q[own, b] = locked_at
                scratch[2, b] = max(scratch[2, b], outside_by)
        lane_errors(plan, 1, n, pose, Q, width, lanes)

        failed_here = outside_here = 0
        for b in range(count):
            mask = still = 0
            for row in range(6):
                if int(states[12, b]) & 1 << row:
                    freed |= 1 << row
                    own = int(plan[int(lines[row, SOURCE]), OWN])
                    if own >= 0:
                        mask |= 1 << own
                        if int(states[14, b]) & 1 << row:
                            still |= 1 << own
            if int(states[12, b]) != 0:
                free_ones |= 1 << _number(states[13, b])
            if mask & (mask - 1) != 0:
                doubtful = 1  # A family with two parameters; those that are reported have one.
            if scratch[1, b] == 0.0:
                continue
            beyond = scratch[2, b]
            at_limit = min(max(AT_LIMIT, NEAR * states[15, b] * max(size, 1.0)), NEAR_LIMITS)
            near_limits = NEAR_LIMITS if spread > 0.0 else at_limit
            if beyond > near_limits:
                outside_here += 1
                continue
            distance, angle = lanes[DISTANCE + b], lanes[ANGLE + b]
            if distance > GOOD_ENOUGH or angle > GOOD_ENOUGH or not beyond <= 0.0:
                distance, angle, beyond = refined(
                    plan, n, top, locked, pose, reference, Q, b, LIMIT_SLACK, at_limit, still
                )
            before = kept
            if beyond > 0.0:
                if beyond <= at_limit:
                    failed_here += 1  # a configuration within the tolerances may satisfy the limits
                else:
                    outside_here += 1
            elif not (distance <= plan[0, POSITION_TOLERANCE] and angle <= plan[0, ORIENTATION_TOLERANCE]):
                failed_here += 1
            elif still == 0 or max(distance, angle) <= GOOD_ENOUGH:
                kept = _keep(Q, b, n, distance, angle, mask, states[13, b], out, kept)
                if kept < 0:
                    kept, doubtful = out.shape[0] - 1, 1
                elif mask != 0:
                    with_members |= 1 << _number(states[13, b])
            if spread > 0.0 and locked < 0 and (kept > before or beyond > 0.0 or distance < ASTRAY):
                kept = _twins(plan, n, top, locked, pose, reference, Q, b, states[13, b], out, kept)
        if snap == 0:
            failed = failed_here
        outside = max(outside, outside_here)
    mask = 0
    for row in range(6):
        own = int(plan[int(lines[row, SOURCE]), OWN])
        if freed & 1 << row and own >= 0:
            mask |= 1 << own
    last = out.shape[0] - 1
    out[last, ALL_FREE_JOINTS], out[last, FAILED], out[last, OUTSIDE], out[last, QUARTIC], out[last, IN_DOUBT] = (
        mask,
        failed,
        outside,
        by_quartic,
        doubtful + 2 * (free_ones & ~with_members),
    )
    return kept


@inlined
def _number(name: float) -> int:
    """The bit of a solution in IN_DOUBT, from its number."""
    return int(name) % 1000 % 200 + (16 if name >= 200.0 else 0)


@inlined
def _keep(Q: Any, b: int, n: int, distance: float, angle: float, mask: int, which: float, out: Any, kept: int) -> int:
    """Append column b of Q to the ``kept`` rows of ``out``, unless it is one of them.

    Returns the new number of rows, or -1 if there is no space.
    """
    for i in range(kept):
        same = True
        for j in range(n):
            gap = abs(Q[j, b] - out[i, j])
            if gap > SAME_BRANCH and abs(gap - TURN * math.floor(gap / TURN + 0.5)) > SAME_BRANCH:
                same = False
                break
        if same:
            return kept
    if kept == out.shape[0] - 1:
        return -1
    for j in range(n):
        out[kept, j] = Q[j, b]
    out[kept, n], out[kept, n + 1], out[kept, n + 2], out[kept, n + 3] = distance, angle, mask, which
    return kept + 1


@compiled
def _twins(
    plan: Any, n: int, top: int, locked: int, pose: Any, reference: Any, Q: Any, b: int,
    which: float, out: Any, kept: int,
) -> int:  # fmt: skip
    """Solutions of an arm that deviates from the ideal, close to column b of Q; see :mod:`pinproof.kernels.twins`."""
    q, motion = np.empty(n), np.zeros(n)
    for j in range(n):
        q[j] = Q[j, b]
    fixed = -1 if locked < 0 else int(plan[top + locked, OWN])
    if weakest_motion(plan, n, fixed, q, motion) > NEARLY_SINGULAR * math.sqrt(plan[0, SPREAD]) * plan[0, SIZE]:
        return kept
    for way in WAYS:
        for j in range(n):
            Q[j, b] = q[j] + way * motion[j]
        distance, angle, beyond = refined(plan, n, top, locked, pose, reference, Q, b, LIMIT_SLACK, AT_LIMIT, 0)
        if beyond <= 0.0 and distance <= plan[0, POSITION_TOLERANCE] and angle <= plan[0, ORIENTATION_TOLERANCE]:
            more = _keep(Q, b, n, distance, angle, 0, which, out, kept)
            if more > kept:  # Completeness is not claimed for arms that need this.
                kept = more
    return kept


@compiled
def branches_of_one(plan: Any, target: Any, reference: Any, locked_at: float, out: Any) -> int:
    """The branches for one pose; see :func:`branches_of_pose`."""
    room = workroom()
    return branches_of_pose(plan, target, reference, locked_at, room, out)


@compiled
def branches_of_many(
    plan: Any, targets: Any, references: Any, values: Any, start: int, stop: int,
    q: Any, errors: Any, counts: Any, outside: Any, known: Any,
) -> None:  # fmt: skip
    """The branches for the targets (N, 4, 4) at each value of the locked joint, into the rows of the other arrays.

    Row ``i * v + j`` is for target i and value j; rows from ``start`` to ``stop`` are computed. ``references`` (1, n)
    or (N, n); ``values`` (1, v) or (N, v), with v = 1 and ignored if no joint is locked; ``q`` (N v, k, n) and
    ``errors`` (N v, k, 2), NaN after the last branch; ``counts`` (N v,), BAD_TARGET if the target is not rigid, or
    ELSEWHERE; ``outside`` (N v,) number of branches that only violate the limits; ``known`` (N v,) whether no case is
    unresolved and no joint is free.
    """
    n, v = q.shape[2], values.shape[1]
    room, out = workroom(), np.empty((ROWS + 1, n + 4))
    last = out.shape[0] - 1
    for row in range(start, stop):
        i = row // v
        reference, value = references[i if references.shape[0] > 1 else 0], values[i if values.shape[0] > 1 else 0]
        count = branches_of_pose(plan, targets[i], reference, value[row - i * v], room, out)
        doubts = out[last, ALL_FREE_JOINTS] + out[last, FAILED] + out[last, IN_DOUBT] if count >= 0 else 0.0
        known[row] = doubts == 0.0
        outside[row] = 0 if count < 0 else int(out[last, OUTSIDE])
        if count > q.shape[1]:
            count = q.shape[1] if plan[0, LOCKED] >= 0 else ELSEWHERE
        counts[row] = ELSEWHERE if count == 0 and out[last, ALL_FREE_JOINTS] != 0.0 else count
        for b in range(q.shape[1]):
            for j in range(n):
                q[row, b, j] = out[b, j] if b < count else math.nan
            errors[row, b, 0] = out[b, n] if b < count else math.nan
            errors[row, b, 1] = out[b, n + 1] if b < count else math.nan
