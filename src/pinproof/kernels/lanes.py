"""Forward kinematics of several configurations at once, one per lane, so that every step is a vector instruction.

It verifies the closed forms: it evaluates the arm's own chain (:mod:`pinproof.kernels.chain`) and shares no code with
them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.arctangent import angle_of
from pinproof.kernels.chain import LEADER, MULTIPLIER, OFFSET, SLIDES
from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.trigonometry import sincos

__all__ = ["ANGLE", "DISTANCE", "LANES", "ROOM", "lane_errors", "wind"]

LANES = 16

# The offsets of the rows in the scratch array.
POSE, WAY, DISTANCE, ANGLE = 0, 12 * LANES, 13 * LANES, 14 * LANES
ROOM = 15 * LANES

TURN = 2.0 * math.pi


@compiled
def lane_errors(plan: Any, top: int, n: int, target: Any, Q: Any, width: int, room: Any) -> None:
    """Distance (m) and angle (rad) between the tcp and ``target`` (3, 4) at the columns of Q (n, LANES).

    The chain is stored in ``plan`` from row ``top``. The scratch array (ROOM,) contains rows of LANES numbers; the
    results are written to those at DISTANCE and ANGLE. With one array and constant offsets the compiler knows that rows
    do not overlap; checks at run time would cost more than the eight lanes save.
    """
    for b in range(width):
        room[POSE + b] = room[POSE + 4 * LANES + b] = room[POSE + 8 * LANES + b] = 1.0
        room[POSE + LANES + b] = room[POSE + 2 * LANES + b] = room[POSE + 3 * LANES + b] = 0.0
        room[POSE + 5 * LANES + b] = room[POSE + 6 * LANES + b] = room[POSE + 7 * LANES + b] = 0.0
        room[POSE + 9 * LANES + b] = room[POSE + 10 * LANES + b] = room[POSE + 11 * LANES + b] = 0.0
    for k in range(n + 1):
        row = top + k
        c0, c1, c2, c3 = plan[row, 0], plan[row, 1], plan[row, 2], plan[row, 3]
        c4, c5, c6, c7 = plan[row, 4], plan[row, 5], plan[row, 6], plan[row, 7]
        c8, c9, c10, c11 = plan[row, 8], plan[row, 9], plan[row, 10], plan[row, 11]
        moves = 1.0 if k < n else 0.0
        turns = moves if plan[row, SLIDES] == 0.0 else 0.0
        slides = moves - turns
        share, offset, leader = plan[row, MULTIPLIER], plan[row, OFFSET], int(plan[row, LEADER])
        for b in range(width):
            room[WAY + b] = Q[leader, b]
        for b in range(width):
            value = share * room[WAY + b] + offset
            s, c = sincos(turns * value)
            way = slides * value
            r0, r1, r2 = room[POSE + b], room[POSE + LANES + b], room[POSE + 2 * LANES + b]
            a0, a1, a2 = r0 * c0 + r1 * c4 + r2 * c8, r0 * c1 + r1 * c5 + r2 * c9, r0 * c2 + r1 * c6 + r2 * c10
            room[POSE + 9 * LANES + b] += r0 * c3 + r1 * c7 + r2 * c11 + way * a2
            room[POSE + b], room[POSE + LANES + b] = a0 * c + a1 * s, a1 * c - a0 * s
            room[POSE + 2 * LANES + b] = a2
            r0, r1, r2 = room[POSE + 3 * LANES + b], room[POSE + 4 * LANES + b], room[POSE + 5 * LANES + b]
            a0, a1, a2 = r0 * c0 + r1 * c4 + r2 * c8, r0 * c1 + r1 * c5 + r2 * c9, r0 * c2 + r1 * c6 + r2 * c10
            room[POSE + 10 * LANES + b] += r0 * c3 + r1 * c7 + r2 * c11 + way * a2
            room[POSE + 3 * LANES + b], room[POSE + 4 * LANES + b] = a0 * c + a1 * s, a1 * c - a0 * s
            room[POSE + 5 * LANES + b] = a2
            r0, r1, r2 = room[POSE + 6 * LANES + b], room[POSE + 7 * LANES + b], room[POSE + 8 * LANES + b]
            a0, a1, a2 = r0 * c0 + r1 * c4 + r2 * c8, r0 * c1 + r1 * c5 + r2 * c9, r0 * c2 + r1 * c6 + r2 * c10
            room[POSE + 11 * LANES + b] += r0 * c3 + r1 * c7 + r2 * c11 + way * a2
            room[POSE + 6 * LANES + b], room[POSE + 7 * LANES + b] = a0 * c + a1 * s, a1 * c - a0 * s
            room[POSE + 8 * LANES + b] = a2
    t00, t01, t02, t03 = target[0, 0], target[0, 1], target[0, 2], target[0, 3]
    t10, t11, t12, t13 = target[1, 0], target[1, 1], target[1, 2], target[1, 3]
    t20, t21, t22, t23 = target[2, 0], target[2, 1], target[2, 2], target[2, 3]
    for b in range(width):
        x, y, z = room[POSE + 9 * LANES + b] - t03, room[POSE + 10 * LANES + b] - t13, room[POSE + 11 * LANES + b] - t23
        room[DISTANCE + b] = math.sqrt(x * x + y * y + z * z)
        p0, p1, p2 = room[POSE + b], room[POSE + LANES + b], room[POSE + 2 * LANES + b]
        p3, p4, p5 = room[POSE + 3 * LANES + b], room[POSE + 4 * LANES + b], room[POSE + 5 * LANES + b]
        p6, p7, p8 = room[POSE + 6 * LANES + b], room[POSE + 7 * LANES + b], room[POSE + 8 * LANES + b]
        # target^T R: its trace, and twice the sine of its angle about its axis
        cosine = t00 * p0 + t10 * p3 + t20 * p6 + t01 * p1 + t11 * p4 + t21 * p7 + t02 * p2 + t12 * p5 + t22 * p8 - 1.0
        x = t02 * p1 + t12 * p4 + t22 * p7 - (t01 * p2 + t11 * p5 + t21 * p8)
        y = t00 * p2 + t10 * p5 + t20 * p8 - (t02 * p0 + t12 * p3 + t22 * p6)
        z = t01 * p0 + t11 * p3 + t21 * p6 - (t00 * p1 + t10 * p4 + t20 * p7)
        room[ANGLE + b] = angle_of(math.sqrt(x * x + y * y + z * z), cosine)


@inlined
def wind(value: float, lower: float, upper: float, slack: float, reference: float) -> Any:
    """``value + 2 pi k`` closest to the reference, within [lower - slack, upper + slack] if possible."""
    # numpy's floor returns a float, as infinite limits require; that of math returns an integer.
    fewest, most = np.ceil((lower - slack - value) / TURN), np.floor((upper + slack - value) / TURN)
    turns = min(max(np.floor((reference - value) / TURN + 0.5), fewest), most)
    above, below = value + fewest * TURN - upper, lower - value - most * TURN
    return value + (fewest if fewest > most and above < below else turns) * TURN
