"""The choice of the branch: motions away from a saddle, and back across a singularity."""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import compiled
from pinproof.kernels.track_descent import (
    BEGAN,
    CEILING,
    FLOOR,
    clamped,
    copy,
    look_closely,
    lost_motion,
    settle,
    square_of,
    wander,
)
from pinproof.kernels.workspace import ASKED, BEST, DRIFT

__all__ = ["BACK", "SLACK", "escape", "side_of", "stay"]

# Row of ``joints``: the singular motion at the start of the cycle.
BACK = 12

NO_SIDE = 2.0

SLACK = 1e-7
"""m and rad: by how much an error may increase to keep the branch. An extended arm remains bent by about 1e-4."""

WORTH = 1.5
"""The factor by which an error may increase to keep the branch, while the target returns."""

MOST_BEND, BENDS = 0.1, 16
"""Rad or m: the largest motion tried across a singularity, and the number of its halvings."""

ESCAPE = 1e-9
"""m and rad: the smallest improvement that a motion away from a saddle must bring."""


@compiled
def escape(chain: Any, q: Any, trial: Any, squared: float, work: Any) -> float:
    """Move q away from a saddle within the box, if that reduces the residual; returns the squared residual."""
    joints = work.joints
    n = q.shape[0]
    for i in range(n):
        joints[BEST, i] = q[i]
        if q[i] == joints[FLOOR, i] or q[i] == joints[CEILING, i]:
            return squared
    for way in (1.0, -1.0):
        for i in range(n):
            q[i] = joints[BEST, i]
            joints[DRIFT, i] = way * (joints[CEILING, i] - joints[FLOOR, i])
        other = wander(chain, q, trial, work)
        if math.sqrt(other) < math.sqrt(squared) - ESCAPE:
            return other
    for i in range(n):
        q[i] = joints[BEST, i]
    return squared


@compiled
def side_of(chain: Any, q: Any, work: Any) -> float:
    """The sign, 1 or -1, of the determinant of the task's Jacobian at q; :data:`NO_SIDE` where it is not square."""
    _, _, _, _, jacobian, _, square, _, _, errors = work
    n, count = q.shape[0], 0
    look_closely(chain, q, work)
    for k in range(6):
        if errors[ASKED, k] != 0.0:
            if count < n:
                for i in range(min(n, 6)):
                    square[count, i] = jacobian[k, i]
            count += 1
    if count != n:
        return NO_SIDE
    side = 1.0
    for c in range(n):  # Gaussian elimination with partial pivoting.
        pivot = c
        for r in range(c + 1, n):
            if abs(square[r, c]) > abs(square[pivot, c]):
                pivot = r
        if square[pivot, c] == 0.0:
            return side
        if pivot != c:
            side = -side
            for i in range(c, n):
                square[c, i], square[pivot, i] = square[pivot, i], square[c, i]
        if square[c, c] < 0.0:
            side = -side
        for r in range(c + 1, n):
            share = square[r, c] / square[c, c]
            for i in range(c + 1, n):
                square[r, i] -= share * square[c, i]
    return side


@compiled
def stay(side: float, chain: Any, q: Any, trial: Any, squared: float, work: Any) -> float:
    """Move q back to a side of a singularity, if the residual permits; returns the squared residual.

    First along the singular motion, as far as it increases the error by at most SLACK. If it costs more, the cycle is
    repeated from a start as deep on that side as possible, or from the start of the cycle.
    """
    joints, errors = work.joints, work.errors
    n = q.shape[0]
    for i in range(n):
        joints[BEST, i] = q[i]
    _lost_direction(chain, q, work)
    bend = MOST_BEND
    for _ in range(2 * BENDS):
        for i in range(n):
            trial[i] = clamped(joints, i, q[i] + bend * joints[DRIFT, i])
        if side_of(chain, trial, work) == side:
            there = square_of(errors)
            if math.sqrt(there) <= math.sqrt(squared) + SLACK:
                copy(trial, q)
                return there
        bend = -bend if bend > 0.0 else -0.5 * bend

    for i in range(n):
        q[i] = joints[BEGAN, i]
    _lost_direction(chain, q, work)
    for i in range(n):
        joints[BACK, i] = joints[DRIFT, i]
    for bend in (MOST_BEND, -MOST_BEND, 0.0):
        for i in range(n):
            q[i] = clamped(joints, i, joints[BEGAN, i] + bend * joints[BACK, i])
        if side_of(chain, q, work) != side:
            continue
        there = settle(chain, q, trial, work)
        if math.sqrt(there) <= WORTH * math.sqrt(squared) + SLACK and side_of(chain, q, work) == side:
            return there
    for i in range(n):
        q[i] = joints[BEST, i]
    return squared


@compiled
def _lost_direction(chain: Any, q: Any, work: Any) -> None:
    """The singular motion at q, into the row DRIFT, its largest entry 1; 0 if it does not exist."""
    joints = work.joints
    n, size = q.shape[0], 0.0
    for i in range(n):
        joints[DRIFT, i] = joints[CEILING, i] - joints[FLOOR, i]
    lost_motion(chain, q, work)
    for i in range(n):
        size = max(size, abs(joints[DRIFT, i]))
    for i in range(n):
        joints[DRIFT, i] = joints[DRIFT, i] / size if size > 0.0 else 0.0
