"""The placements of joints and bodies at a configuration, in the root frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.compiled import compiled
from pinproof.kernels.trigonometry import sincos
from pinproof.kernels.world import CENTRE, JOINT, LEADER, MIDDLE, MULTIPLIER, OFFSET, PARENT, PLACE, SLIDES

__all__ = ["place"]

LARGE = 5e5
"""rad. Beyond it, the sine of this package begins to lose digits."""


@compiled
def place(world: Any, q: Any, axes: Any, at: Any) -> bool:
    """Place the joints and the moving bodies at q (n,); False if q is not finite.

    Writes root_from_joint into ``axes`` (m, 12) and root_from_body into ``at`` (B, 15), each as the rotation row by row
    and the translation, ``at`` followed by the centre of the box. The axis of a joint is therefore entries 2, 5, 8,
    through the point 9, 10, 11.
    """
    joints, bodies = world.joints, world.bodies
    for j in range(q.shape[0]):
        if not np.isfinite(q[j]):
            axes[:] = np.nan  # so that no previous value is used as a result
            for i in range(world.outer.shape[0]):
                if bodies[i, JOINT] >= 0.0:
                    at[i] = np.nan
            return False
    for k in range(joints.shape[0]):
        value = joints[k, MULTIPLIER] * q[int(joints[k, LEADER])] + joints[k, OFFSET]
        parent = int(joints[k, PARENT])
        if parent < 0:
            for c in range(12):
                axes[k, c] = joints[k, c]
        else:
            _times(axes, parent, joints, k, 0, axes, k)
        if joints[k, SLIDES] != 0.0:
            for i in range(3):
                axes[k, 9 + i] += value * axes[k, 3 * i + 2]
            continue
        sine, cosine = sincos(value) if abs(value) < LARGE else (math.sin(value), math.cos(value))
        for i in range(3):
            x, y = axes[k, 3 * i], axes[k, 3 * i + 1]
            axes[k, 3 * i], axes[k, 3 * i + 1] = x * cosine + y * sine, y * cosine - x * sine
    for i in range(world.outer.shape[0]):
        joint = int(bodies[i, JOINT])
        if joint >= 0:
            _times(axes, joint, bodies, i, PLACE, at, i)
            x, y, z = bodies[i, CENTRE], bodies[i, CENTRE + 1], bodies[i, CENTRE + 2]
            for r in range(3):
                at[i, MIDDLE + r] = at[i, 3 * r] * x + at[i, 3 * r + 1] * y + at[i, 3 * r + 2] * z + at[i, 9 + r]
    return True


@compiled
def _times(left: Any, i: int, right: Any, j: int, column: int, out: Any, k: int) -> None:
    """out[k] = left[i] * right[j, column:], all rigid transforms of 12 numbers."""
    for r in range(3):
        x, y, z = left[i, 3 * r], left[i, 3 * r + 1], left[i, 3 * r + 2]
        for c in range(3):
            out[k, 3 * r + c] = x * right[j, column + c] + y * right[j, column + 3 + c] + z * right[j, column + 6 + c]
        t = x * right[j, column + 9] + y * right[j, column + 10] + z * right[j, column + 11]
        out[k, 9 + r] = t + left[i, 9 + r]
