"""IK solutions for many poses in one call, their ranking figures, and lower bounds of motion times.

Arms with a closed form give every IK branch; for other arms a numerical search gives a sample.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.errors import NoClosedForm
from pinproof.ik import AnalyticIk, Clik
from pinproof.model import Arm, JointLimits

__all__ = [
    "TURN",
    "at_full_speed",
    "configurations",
    "has_closed_form",
    "least_seconds",
    "limit_margins",
    "manipulability",
    "turned_inside",
    "widened",
]

Array = npt.NDArray[np.float64]

SWEEP = AnalyticIk(redundant_steps=24)
"""Of an arm of seven: values of the redundant joint; every 15 degrees of a whole turn."""

BEYOND = 2 * np.pi, 0.5
"""rad and m by which limits are widened to tell whether they alone stand in the way."""

TURN = 2 * np.pi

SAMPLES, STARTS = 8, 64
"""Different configurations that are looked for where there is no closed form, and from how many starts."""


def has_closed_form(arm: Arm, most: int = 6) -> bool:
    """Whether every branch is told. Arms of seven are swept (``most=7``): that gives many, never all."""
    if arm.dof > most:
        return False
    try:
        AnalyticIk().solve_all_batch(arm, arm.forward_kinematics_batch(arm.home[None]))
    except NoClosedForm:
        return False
    return True


def configurations(arm: Arm, targets: Array, q0: Array, rng: int) -> tuple[npt.NDArray[np.int64], Array]:
    """Configurations inside the limits, each with the whole turns nearest to q0.

    Parameters
    ----------
    arm
        The arm.
    targets
        (N, 4, 4) ``base_from_tcp``.
    q0
        (n,) where to choose from.
    rng
        Seed of the search, where there is no closed form.

    Returns
    -------
    (k,) which target each is for, in order; and (k, n) the configurations.
    """
    if has_closed_form(arm, most=7):
        found = SWEEP.solve_all_batch(arm, targets, q0)
        row, column = np.nonzero(np.isfinite(found.q[:, :, 0]))
        return row, np.ascontiguousarray(found.q[row, column])
    many = [Clik().solve_many(arm, T, q0, rng=rng, count=SAMPLES, attempts=STARTS).q for T in targets]
    row = np.repeat(np.arange(len(many)), [len(q) for q in many])
    return row, np.concatenate([*many, np.empty((0, arm.dof))])


def manipulability(arm: Arm, Q: Array) -> Array:
    """(N,) Yoshikawa's measure at Q (N, n)."""
    from pinproof.kernels.manipulability import manipulability_many

    out = np.empty(len(Q))
    manipulability_many(arm.packed, np.ascontiguousarray(Q), out)
    return out


def limit_margins(arm: Arm, q: Array) -> Array:
    """(N,) how far (share of half its range) the joint nearest to a limit is from it at q (N, n): at most 1."""
    lower, upper = arm.limits.lower, arm.limits.upper
    half = (upper - lower) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.minimum(q - lower, upper - q) / half
    return np.asarray(np.where(np.isfinite(share), share, 1.0).min(axis=1, initial=1.0))


def widened(arm: Arm) -> Arm:
    """The arm under limits that are a turn, or half a metre, wider on either side."""
    limits, beyond = arm.limits, BEYOND[0] * arm.angular + BEYOND[1] * ~arm.angular
    wider = JointLimits(limits.lower - beyond, limits.upper + beyond, limits.velocity, limits.acceleration)
    return arm.with_limits(wider)


def turned_inside(arm: Arm, q: Array) -> Array:
    """The same poses, with each joint that is outside its limits inside them where whole turns do it; q (..., n)."""
    lower, upper = arm.limits.lower, arm.limits.upper
    turned = q + np.ceil((lower - q) / TURN) * TURN
    return np.where(arm.periodic & ((q < lower) | (q > upper)) & (turned <= upper), turned, q)


def at_full_speed(arm: Arm, points: Array) -> float:
    """Seconds from each of some points (k, n) to the next at full speed, corners without a stop.

    Of the control points of a curve it is a bound of what the curve takes at full speed, and never less than
    :func:`least_seconds` from end to end.
    """
    return float((np.abs(np.diff(points, axis=0)) / arm.limits.velocity).max(axis=1, initial=0.0).sum())


def least_seconds(arm: Arm, here: Array, there: Array) -> Array:
    """(k, m) seconds from each of (k, n) to each of (m, n), or to any whole turn of it, that no motion undercuts."""
    way = np.abs(here[:, None, :] - there[None, :, :])
    nearest = np.abs(way - TURN * np.round(way / TURN))
    return np.asarray((np.where(arm.periodic, nearest, way) / arm.limits.velocity).max(axis=2))
