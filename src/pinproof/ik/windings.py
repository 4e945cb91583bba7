"""Whole turns: which of the angles q + 2 pi k a joint should be told.

A joint with a range of more than one turn (the UR5's have two) reaches the same pose at several angles. None is wrapped
to (-pi, pi]: that throws valid answers away, as the Panda's sixth joint, [-0.018, 3.752], shows. Turns are chosen
inside the limits, nearest to where the arm is.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm

__all__ = ["difference", "nearest_winding", "turning"]

Array = npt.NDArray[np.float64]

TURN = 2 * np.pi

WHOLE_TURN_GAP = 1e-3
"""Rad. A range that lacks no more of a whole turn counts as one for a descent: files write pi as 3.1416 or 3.14159."""


def turning(arm: Arm) -> npt.NDArray[np.bool_]:
    """(n,) the joints that can make a whole turn: beyond one limit a descent goes on a turn away, at the same pose."""
    return np.asarray(arm.periodic & (arm.limits.upper - arm.limits.lower >= TURN - WHOLE_TURN_GAP))


def nearest_winding(arm: Arm, q: Array, reference: Array) -> Array:
    """The configuration with the same poses as q, inside the limits, whose joints lie nearest to a reference.

    Parameters
    ----------
    arm
        Its periodic joints are shifted by whole turns, the others never.
    q
        (n,) or (N, n) inside the limits.
    reference
        (n,) in or outside the limits.
    """
    lower, upper = arm.limits.lower, arm.limits.upper
    elsewhere = (np.abs(reference - q) > np.pi) | (q < lower) | (q > upper)
    if not np.count_nonzero(elsewhere & arm.periodic):  # nothing to turn: the common case, and quicker
        return q
    fewest, most = np.ceil((lower - q) / TURN), np.floor((upper - q) / TURN)
    turns = np.clip(np.round((reference - q) / TURN), fewest, most)
    # Only rounding is clipped here: a turn may end one bit beyond a limit that is a multiple of 2 pi.
    return np.where(arm.periodic & (turns != 0), np.clip(q + turns * TURN, lower, upper), q)


def difference(arm: Arm, a: Array, b: Array) -> Array:
    """``a - b`` with whole turns of periodic joints taken out; broadcasts over (..., n)."""
    plain = a - b
    return np.where(arm.periodic, plain - TURN * np.round(plain / TURN), plain)
