"""The residual of a task and its Jacobian; the same as in :mod:`pinproof.ik.task`, compiled.

A task is the row ASKED of ``errors``: ones and zeros for x, y, z, rx, ry, rz in the target's axes. ``end`` is
target_from_tcp.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.workspace import ASKED, RESIDUAL

__all__ = ["error_jacobian", "measure_many", "residual_of", "rotation_vector"]

SMALL_ANGLE = 1e-6
"""Rad. Below it the sine equals the angle up to rounding."""

NEAR_HALF_TURN = -0.99
"""For a cosine below this the axis is computed from the symmetric part of the rotation, because the sine is
inaccurate."""


@inlined
def rotation_vector(end: Any) -> Any:
    """The rotation vector (axis times angle, 0 to pi) of the rotation in ``end``: three numbers."""
    x = 0.5 * (end[2, 1] - end[1, 2])
    y = 0.5 * (end[0, 2] - end[2, 0])
    z = 0.5 * (end[1, 0] - end[0, 1])
    cosine = 0.5 * (end[0, 0] + end[1, 1] + end[2, 2] - 1.0)
    sine = math.sqrt(x * x + y * y + z * z)
    if cosine >= NEAR_HALF_TURN:
        factor = math.atan2(sine, cosine) / sine if sine > SMALL_ANGLE else 1.0
        return factor * x, factor * y, factor * z
    # R + R^T = 2 cosine I + 2 (1 - cosine) u u^T: the column of the largest entry of u is the best conditioned.
    i = 0
    if end[1, 1] > end[0, 0]:
        i = 1
    if end[2, 2] > end[i, i]:
        i = 2
    u0, u1, u2 = end[0, i] + end[i, 0], end[1, i] + end[i, 1], end[2, i] + end[i, 2]
    if i == 0:
        u0 -= 2.0 * cosine
    elif i == 1:
        u1 -= 2.0 * cosine
    else:
        u2 -= 2.0 * cosine
    angle = math.atan2(sine, cosine) / math.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
    if u0 * x + u1 * y + u2 * z < 0.0:
        angle = -angle
    return angle * u0, angle * u1, angle * u2


@inlined
def residual_of(end: Any, errors: Any) -> None:
    """The translation and the rotation vector of target_from_tcp; zero in coordinates that the task does not select."""
    x, y, z = rotation_vector(end)
    errors[RESIDUAL, 0] = errors[ASKED, 0] * end[0, 3]
    errors[RESIDUAL, 1] = errors[ASKED, 1] * end[1, 3]
    errors[RESIDUAL, 2] = errors[ASKED, 2] * end[2, 3]
    errors[RESIDUAL, 3] = errors[ASKED, 3] * x
    errors[RESIDUAL, 4] = errors[ASKED, 4] * y
    errors[RESIDUAL, 5] = errors[ASKED, 5] * z


@inlined
def error_jacobian(end: Any, errors: Any, jacobian: Any) -> None:
    """Transform the tcp's Jacobian in the target's axes (6, n) into that of the residual, in place.

    If the task selects all three angles, it does not change: d(rotation vector) = Jl^-1 w, and Jl e = e for the
    rotation vector e, so that the step and the gradient are the same without the factor. If the task selects one or
    two, it is needed.
    """
    asked = errors[ASKED, 3] + errors[ASKED, 4] + errors[ASKED, 5]
    if 0.0 < asked < 3.0:
        x, y, z = rotation_vector(end)
        square = x * x + y * y + z * z
        angle = math.sqrt(square)
        # Jl^-1(v) = I - [v]/2 + c [v]^2, c = 1/t^2 - (1 + cos t) / (2 t sin t), with (1 + cos) / sin = 1 / tan(t/2)
        c = 1.0 / 12.0 if angle < 1e-3 else (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / square
        for j in range(jacobian.shape[1]):
            a, b, d = jacobian[3, j], jacobian[4, j], jacobian[5, j]
            dot = x * a + y * b + z * d
            jacobian[3, j] = a - 0.5 * (y * d - z * b) + c * (x * dot - square * a)
            jacobian[4, j] = b - 0.5 * (z * a - x * d) + c * (y * dot - square * b)
            jacobian[5, j] = d - 0.5 * (x * b - y * a) + c * (z * dot - square * d)
    for i in range(6):
        if errors[ASKED, i] == 0.0:
            for j in range(jacobian.shape[1]):
                jacobian[i, j] = 0.0


@compiled
def measure_many(targets: Any, poses: Any, asked: Any, out: Any) -> None:
    """Distance (m) and angle (rad) of each pose (N, 4, 4) from its target, into ``out`` (N, 2).

    Only coordinates that the task (6,) selects count; if it selects no position or no orientation, all three do.
    """
    relative, counted = np.empty((3, 4)), np.ones(6)
    for first in (0, 3):
        if asked[first] + asked[first + 1] + asked[first + 2] > 0.0:
            for i in range(first, first + 3):
                counted[i] = asked[i]
    for row in range(len(targets)):
        for i in range(3):
            relative[i, 3] = 0.0
            for k in range(3):
                relative[i, 3] += targets[row, k, i] * (poses[row, k, 3] - targets[row, k, 3])
            for j in range(3):
                relative[i, j] = 0.0
                for k in range(3):
                    relative[i, j] += targets[row, k, i] * poses[row, k, j]
        x, y, z = rotation_vector(relative)
        distance = angle = 0.0
        for i in range(3):
            distance += counted[i] * relative[i, 3] * relative[i, 3]
        angle = counted[3] * x * x + counted[4] * y * y + counted[5] * z * z
        out[row, 0], out[row, 1] = math.sqrt(distance), math.sqrt(angle)
