"""The choice among the joint angles q + 2 pi k that have the same pose.

A revolute joint with a range of more than 2 pi (those of the UR5 have 4 pi) reaches the same pose at several angles.
Angles are not wrapped to (-pi, pi], which would discard valid solutions (the sixth joint of the Panda has the range
[-0.018, 3.752]). Among the angles within the limits, the one closest to a reference configuration is chosen.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.model import AT_LIMIT, Arm
from pinproof.spatial import Array

TURN = 2 * np.pi

FULL_ROTATION_GAP = 1e-3
"""Rad. A range shorter than 2 pi by at most this counts as 2 pi, because files write pi as 3.1416 or 3.14159."""


def wraps(arm: Arm) -> npt.NDArray[np.bool_]:
    """(n,) the joints with a range of at least 2 pi; beyond a limit, a descent continues 2 pi away at the same pose."""
    return np.asarray(arm.periodic & (arm.limits.upper - arm.limits.lower >= TURN - FULL_ROTATION_GAP))


def stops(arm: Arm) -> tuple[Array, Array]:
    """(n,) lower and upper limits at which a descent stops a joint; infinite for the joints of :func:`wraps`."""
    wrapping = wraps(arm)
    return np.where(wrapping, -np.inf, arm.limits.lower), np.where(wrapping, np.inf, arm.limits.upper)


def nearest_winding(arm: Arm, q: Array, reference: Array) -> Array:
    """Shift the joints of q by multiples of 2 pi within the limits such that each is closest to a reference.

    Parameters
    ----------
    arm
        Only its periodic joints are shifted.
    q
        (n,) or (N, n) within the limits.
    reference
        (n,) within or outside the limits.
    """
    lower, upper = arm.limits.lower, arm.limits.upper
    elsewhere = (np.abs(reference - q) > np.pi) | (q < lower) | (q > upper)
    if not np.count_nonzero(elsewhere & arm.periodic):  # nothing to shift: the common case, and faster
        return q
    fewest, most = np.ceil((lower - AT_LIMIT - q) / TURN), np.floor((upper + AT_LIMIT - q) / TURN)
    turns = np.clip(np.round((reference - q) / TURN), fewest, most)
    # Only rounding is clipped here: a shifted angle may exceed a limit that is a multiple of 2 pi by one bit.
    return np.where(arm.periodic & (turns != 0), np.clip(q + turns * TURN, lower, upper), q)


def difference(arm: Arm, a: Array, b: Array) -> Array:
    """``a - b`` with periodic joints reduced to [-pi, pi]; broadcasts over (..., n)."""
    plain = a - b
    return np.where(arm.periodic, plain - TURN * np.round(plain / TURN), plain)
