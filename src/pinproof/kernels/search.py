"""Starts and restarts of descents for any number of targets; the same search as in :mod:`pinproof.ik.loop`.

The first attempt starts at the caller's configuration. Each other attempt starts at the configuration closest in pose
to the target that has not been tried: once among the seeds and the flips of the first result (one joint mirrored about
the middle of its range: the other elbow or wrist), then among the seeds alone. Seeds are a low-discrepancy set of
configurations (T, n) with the poses of their tcp (12, T), the rows of the (3, 4) matrix. A Newton-like descent that
starts close to its target usually converges to it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.chain import walk
from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.descent import descend
from pinproof.kernels.goals import NEAR
from pinproof.kernels.limits import LOWER, UPPER
from pinproof.kernels.workspace import ASKED, ENDED, workspace

__all__ = ["search"]

POLISH_PROGRESS, POLISH_PATIENCE = 1 - 1e-6, 20
"""The best failed attempt is continued until its squared residual decreases by less than 1e-6 of it in 20 steps."""

USED = np.float32(1e30)
"""The distance of a seed that has been tried."""


@compiled
def search(
    rule: int,
    settings: Any,
    chain: Any,
    box: Any,
    tolerances: Any,
    asked: Any,
    goal: Any,
    limits: Any,
    seeds: Any,
    poses: Any,
    weights: Any,
    first: int,
    targets: Any,
    q: Any,
    iterations: Any,
    attempts: Any,
) -> None:
    """For each target (N, 4, 4), run the attempts from number ``first`` until one satisfies the task.

    The rows of q (N, n) are the starts, within the limits, and become the results: a solution, or the configuration
    with the smallest residual. ``limits`` are the maximum number of steps of an attempt, the largest motion of a joint
    in a step, the number of attempts, whether the best attempt is refined if none satisfies the task, and the progress
    and patience of an attempt. Writes the total numbers of steps and of attempts, including those before ``first``;
    without a solution this is the number of all attempts.
    """
    n = q.shape[1]
    most, longest, count = int(limits[0]), limits[1], int(limits[2])
    work, moved = workspace(chain.shape[0] - 1, n), np.empty((chain.shape[0] + 1, 12))
    joints, errors = work.joints, work.errors
    distances, goal, here = np.empty(len(seeds), np.float32), goal.copy(), np.empty(n)
    for i in range(6):
        errors[ASKED, i] = asked[i]
    for row in range(len(targets)):
        for i in range(n):
            here[i] = q[row, i]
            if goal[0, 0] == NEAR:
                goal[1, i] = here[i]
        _start_from_target(targets, row, work.start)
        nearest, total, attempt, progress, patience = math.inf, 0, 0, limits[4], int(limits[5])
        while True:
            if attempt == count:
                if nearest < math.inf:
                    for i in range(n):
                        here[i] = joints[ENDED, i]
                if limits[3] == 0.0:
                    break
                progress, patience = POLISH_PROGRESS, POLISH_PATIENCE
            elif attempt == 1:
                _measure_seeds(poses, weights, targets, row, distances)
                _flip_or_seed(chain, box, weights, seeds, distances, here, work.start, work.turns, work.axes, work.end)
            elif attempt > 1:
                _take_seed(seeds, distances, here)
            if 0 < attempt < first:  # The first attempt is repeated, because the flips start from its result.
                attempt += 1
                continue
            done, steps, squared = descend(
                rule, settings, chain, box, tolerances, goal, most, longest, progress, patience, here, work, moved
            )
            attempt += 1
            if attempt <= first:
                continue
            total += steps
            if done or attempt > count:
                break
            if squared < nearest:
                nearest = squared
                for i in range(n):
                    joints[ENDED, i] = here[i]
        for i in range(n):
            q[row, i] = here[i]
        iterations[row], attempts[row] = total, min(attempt, count)


@inlined
def _start_from_target(targets: Any, row: int, start: Any) -> None:
    """The inverse of base_from_target into ``start`` (3, 4)."""
    for i in range(3):
        for j in range(3):
            start[i, j] = targets[row, j, i]
        start[i, 3] = 0.0
        for k in range(3):
            start[i, 3] -= targets[row, k, i] * targets[row, k, 3]


@compiled
def _measure_seeds(poses: Any, weights: Any, targets: Any, row: int, distances: Any) -> None:
    """The distance of each seed from the target: weighted squares of the distance and of the rotation chord."""
    w, v = np.float32(weights[0]), np.float32(weights[1])
    r00, r01, r02 = np.float32(targets[row, 0, 0]), np.float32(targets[row, 0, 1]), np.float32(targets[row, 0, 2])
    r10, r11, r12 = np.float32(targets[row, 1, 0]), np.float32(targets[row, 1, 1]), np.float32(targets[row, 1, 2])
    r20, r21, r22 = np.float32(targets[row, 2, 0]), np.float32(targets[row, 2, 1]), np.float32(targets[row, 2, 2])
    x, y, z = np.float32(targets[row, 0, 3]), np.float32(targets[row, 1, 3]), np.float32(targets[row, 2, 3])
    for k in range(poses.shape[1]):
        dx, dy, dz = poses[3, k] - x, poses[7, k] - y, poses[11, k] - z
        trace = (
            poses[0, k] * r00 + poses[1, k] * r01 + poses[2, k] * r02
            + poses[4, k] * r10 + poses[5, k] * r11 + poses[6, k] * r12
            + poses[8, k] * r20 + poses[9, k] * r21 + poses[10, k] * r22
        )  # fmt: skip
        distances[k] = w * (dx * dx + dy * dy + dz * dz) - v * trace


@compiled
def _nearest(distances: Any) -> int:
    best = 0
    for k in range(1, len(distances)):
        if distances[k] < distances[best]:
            best = k
    return best


@inlined
def _take_seed(seeds: Any, distances: Any, q: Any) -> None:
    """The closest seed that has not been tried, into q."""
    best = _nearest(distances)
    distances[best] = USED
    for i in range(q.shape[0]):
        q[i] = seeds[best, i]


@compiled
def _flip_or_seed(
    chain: Any,
    box: Any,
    weights: Any,
    seeds: Any,
    distances: Any,
    q: Any,
    start: Any,
    turns: Any,
    axes: Any,
    end: Any,
) -> None:
    """The closest of the flips of q and of the seeds, into q; a joint without a range is mirrored about zero."""
    best, least = -1, float(distances[_nearest(distances)])
    for i in range(q.shape[0]):
        kept = q[i]
        q[i] = _mirrored(box, i, kept)
        walk(chain, start, q, turns, axes, end)
        square = end[0, 3] * end[0, 3] + end[1, 3] * end[1, 3] + end[2, 3] * end[2, 3]
        distance = weights[0] * square - weights[1] * (end[0, 0] + end[1, 1] + end[2, 2])
        if distance < least:
            best, least = i, distance
        q[i] = kept
    if best < 0:
        _take_seed(seeds, distances, q)
    else:
        q[best] = _mirrored(box, best, q[best])


@inlined
def _mirrored(box: Any, i: int, value: float) -> float:
    if box[UPPER, i] - box[LOWER, i] < math.inf:
        return box[LOWER, i] + box[UPPER, i] - value
    return -value
