r"""Forward kinematics and Jacobians of a chain of single axes.

A chain of m joints is an array (m + 1, 16). Row k < m: the entries of the (3, 4) matrix C_k row by row (12), then
whether the joint is prismatic, its index in q, and the multiplier and offset of its value ``multiplier * q + offset``
(1 and 0 except for mimic joints). Row m: C_tool, the rest unused. With every joint about or along its own z,

.. math:: {}^{base}T_{tcp}(q) = C_1 X_1 C_2 X_2 \cdots C_m X_m C_{tool}, \qquad X_k = R_z(q_k)\ \text{or}\ T_z(q_k).

The chain may start at any transform: from target_from_base, all results are in the axes of the target.
"""

from __future__ import annotations

from typing import Any

from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.trigonometry import sincos

__all__ = ["LEADER", "MULTIPLIER", "OFFSET", "SLIDES", "jacobian_of", "walk", "whole_vectors"]

SLIDES, LEADER, MULTIPLIER, OFFSET = 12, 13, 14, 15


@compiled
def whole_vectors(m: int) -> int:
    """The width of an array for m numbers, rounded up to whole vector registers of 8."""
    return (m + 7) // 8 * 8


@inlined
def walk(chain: Any, start: Any, q: Any, turns: Any, axes: Any, end: Any) -> None:
    """Evaluate the chain from ``start`` (3, 4) at q (n,).

    Writes the origin and direction of each joint into ``axes`` (m, 6) and the pose of the tcp into ``end`` (3, 4).
    ``turns`` (3, m or more) is scratch: values, sines and cosines of the joints. A width rounded up to whole vectors
    (:func:`whole_vectors`) is faster; the array must have been initialised with finite numbers.
    """
    m = chain.shape[0] - 1
    for k in range(m):
        turns[0, k] = chain[k, MULTIPLIER] * q[int(chain[k, LEADER])] + chain[k, OFFSET]
    for k in range(turns.shape[1]):  # A separate loop, so that it is vectorised.
        turns[1, k], turns[2, k] = sincos(turns[0, k])
    r00, r01, r02, p0 = start[0, 0], start[0, 1], start[0, 2], start[0, 3]
    r10, r11, r12, p1 = start[1, 0], start[1, 1], start[1, 2], start[1, 3]
    r20, r21, r22, p2 = start[2, 0], start[2, 1], start[2, 2], start[2, 3]
    for k in range(m + 1):
        p0 += r00 * chain[k, 3] + r01 * chain[k, 7] + r02 * chain[k, 11]
        p1 += r10 * chain[k, 3] + r11 * chain[k, 7] + r12 * chain[k, 11]
        p2 += r20 * chain[k, 3] + r21 * chain[k, 7] + r22 * chain[k, 11]
        a00 = r00 * chain[k, 0] + r01 * chain[k, 4] + r02 * chain[k, 8]
        a01 = r00 * chain[k, 1] + r01 * chain[k, 5] + r02 * chain[k, 9]
        r02 = r00 * chain[k, 2] + r01 * chain[k, 6] + r02 * chain[k, 10]
        a10 = r10 * chain[k, 0] + r11 * chain[k, 4] + r12 * chain[k, 8]
        a11 = r10 * chain[k, 1] + r11 * chain[k, 5] + r12 * chain[k, 9]
        r12 = r10 * chain[k, 2] + r11 * chain[k, 6] + r12 * chain[k, 10]
        a20 = r20 * chain[k, 0] + r21 * chain[k, 4] + r22 * chain[k, 8]
        a21 = r20 * chain[k, 1] + r21 * chain[k, 5] + r22 * chain[k, 9]
        r22 = r20 * chain[k, 2] + r21 * chain[k, 6] + r22 * chain[k, 10]
        if k < m:
            axes[k, 0], axes[k, 1], axes[k, 2] = p0, p1, p2
            axes[k, 3], axes[k, 4], axes[k, 5] = r02, r12, r22
            if chain[k, SLIDES] == 0.0:
                sine, cosine = turns[1, k], turns[2, k]
                r00, r01 = a00 * cosine + a01 * sine, a01 * cosine - a00 * sine
                r10, r11 = a10 * cosine + a11 * sine, a11 * cosine - a10 * sine
                r20, r21 = a20 * cosine + a21 * sine, a21 * cosine - a20 * sine
                continue
            p0 += turns[0, k] * r02
            p1 += turns[0, k] * r12
            p2 += turns[0, k] * r22
        r00, r01, r10, r11, r20, r21 = a00, a01, a10, a11, a20, a21
    end[0, 0], end[0, 1], end[0, 2], end[0, 3] = r00, r01, r02, p0
    end[1, 0], end[1, 1], end[1, 2], end[1, 3] = r10, r11, r12, p1
    end[2, 0], end[2, 1], end[2, 2], end[2, 3] = r20, r21, r22, p2


@inlined
def jacobian_of(chain: Any, axes: Any, end: Any, jacobian: Any) -> None:
    """The tcp's twist per rate of q into ``jacobian`` (6, n), linear first, in the axes of :func:`walk`."""
    jacobian[:] = 0.0
    for k in range(chain.shape[0] - 1):
        j, share = int(chain[k, LEADER]), chain[k, MULTIPLIER]
        w0, w1, w2 = share * axes[k, 3], share * axes[k, 4], share * axes[k, 5]
        if chain[k, SLIDES] != 0.0:
            jacobian[0, j] += w0
            jacobian[1, j] += w1
            jacobian[2, j] += w2
            continue
        d0, d1, d2 = end[0, 3] - axes[k, 0], end[1, 3] - axes[k, 1], end[2, 3] - axes[k, 2]
        jacobian[0, j] += w1 * d2 - w2 * d1
        jacobian[1, j] += w2 * d0 - w0 * d2
        jacobian[2, j] += w0 * d1 - w1 * d0
        jacobian[3, j] += w0
        jacobian[4, j] += w1
        jacobian[5, j] += w2
