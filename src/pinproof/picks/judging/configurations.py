"""IK solutions for many poses in one call, their ranking figures, and lower bounds of motion times.

Arms with a closed form give every IK branch; for other arms a numerical search gives a sample.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from pinproof.errors import NoClosedForm
from pinproof.ik import AnalyticIk, Clik
from pinproof.model import AT_LIMIT, Arm, JointLimits
from pinproof.motion import least_times
from pinproof.spatial import Array

SWEPT = 24
"""Number of values of a revolute redundant joint: 15 degrees apart for a full rotation."""

ALONG_RAIL, FEWEST = 0.18, 8
"""M: distance of the values of a rail, and their least number."""

REDUNDANT = 7
"""Number of joints of an arm whose IK solutions for a pose are curves."""

FAMILY = AnalyticIk(redundant_steps=64)
"""The solver for curves of IK solutions of arms of seven joints."""

MOST_FAMILIES = 6
"""Largest number of targets whose curves are followed, which takes 3 to 10 ms each."""

BEYOND = 2 * np.pi, 0.5
"""rad and m by which limits are widened to determine whether only the limits prevent a solution."""

TURN = 2 * np.pi

TURNS = range(-2, 3)
"""Numbers of full rotations at which a joint is searched within its limits."""

SAMPLES, STARTS = 8, 64
"""Number of different configurations that the numerical search returns, and its number of starts."""


@lru_cache(maxsize=16)
def has_closed_form(arm: Arm, most: int = 6) -> bool:
    """Whether the closed form applies to an arm with at most ``most`` joints.

    For seven joints the redundant joint is swept, which gives many solutions but not all.
    """
    if arm.dof > most:
        return False
    try:
        AnalyticIk().redundant_grid(arm)
    except NoClosedForm:
        return False
    return True


@lru_cache(maxsize=16)
def sweep(arm: Arm) -> AnalyticIk:
    """The solver for an arm of seven joints, with the number of values of its redundant joint."""
    grid = AnalyticIk().redundant_grid(arm)
    if grid is None or arm.angular[grid[0]]:
        return AnalyticIk(redundant_steps=SWEPT)
    return AnalyticIk(redundant_steps=max(round(float(np.ptp(grid[1])) / ALONG_RAIL) + 1, FEWEST))


def configurations(arm: Arm, targets: Array, q0: Array, rng: int) -> tuple[npt.NDArray[np.int64], Array]:
    """Configurations within the limits at targets ``base_from_tcp`` (N, 4, 4).

    Returns the index (k,) of the target of each configuration, ascending, and the configurations (k, n), each with the
    full rotations nearest to q0 (n,). ``rng`` is the seed of the search for arms without a closed form.
    """
    if has_closed_form(arm, most=7):
        found = sweep(arm).solve_all_batch(arm, targets, q0)
        row, column = np.nonzero(np.isfinite(found.q[:, :, 0]))
        return row, np.ascontiguousarray(found.q[row, column])
    many = [Clik().solve_many(arm, T, q0, rng=rng, count=SAMPLES, attempts=STARTS).q for T in targets]
    row = np.repeat(np.arange(len(many)), [len(q) for q in many])
    return row, np.concatenate([*many, np.empty((0, arm.dof))])


def along_families(arm: Arm, targets: Array, q0: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """As :func:`configurations`, along the curves of IK solutions of an arm of seven joints for the first targets.

    The curves contain every solution at 64 values of the redundant joint, and are sampled more finely where joints move
    fast and at their ends. Empty for arms whose solutions are not curves.
    """
    samples: list[Array] = []
    if arm.dof == REDUNDANT and has_closed_form(arm, REDUNDANT):
        samples = [
            np.concatenate([np.empty((0, arm.dof)), *(curve.q for curve in FAMILY.self_motion(arm, target, q0))])
            for target in targets[:MOST_FAMILIES]
        ]
    row = np.repeat(np.arange(len(samples)), [len(q) for q in samples])
    return row, np.concatenate([np.empty((0, arm.dof)), *samples])


def limit_margin(arm: Arm, low: Array, high: Array | None = None) -> Array:
    """Distance of joint ranges low to high (..., n) from the limits: 1 in the middle of all ranges, 0 at a limit."""
    return np.asarray(joint_margins(arm, low, low if high is None else high).min(axis=-1, initial=1.0))


def joint_margins(arm: Arm, low: Array, high: Array) -> Array:
    """The result of :func:`limit_margin` for each joint (..., n); 1 for a joint without limits."""
    lower, upper = arm.limits.lower, arm.limits.upper
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.minimum(low - lower, upper - high) / ((upper - lower) / 2)
    return np.asarray(np.clip(np.where(np.isfinite(share), share, 1.0), 0.0, 1.0))


def best_margins(arm: Arm, q: Array) -> Array:
    """(k,) upper bounds of the margin from the limits at q (k, n) with any full rotations, joint by joint."""
    turned = (q + turns * TURN * arm.periodic for turns in TURNS)
    return np.asarray(np.max([joint_margins(arm, each, each) for each in turned], axis=0).min(axis=1, initial=1.0))


def widened(arm: Arm) -> Arm:
    """The arm with limits that are one rotation, or half a metre, wider on both sides."""
    limits, beyond = arm.limits, BEYOND[0] * arm.angular + BEYOND[1] * ~arm.angular
    wider = JointLimits(limits.lower - beyond, limits.upper + beyond, limits.velocity, limits.acceleration)
    return arm.with_limits(wider)


def turned_inside(arm: Arm, q: Array) -> Array:
    """The same poses with joints of q (..., n) outside their limits moved inside by full rotations where possible.

    Values beyond a limit by rounding are set to the limit.
    """
    lower, upper, q = arm.limits.lower, arm.limits.upper, arm.limits.snap(q)
    outside = arm.periodic & ((q < lower) | (q > upper)) & np.isfinite(lower)
    turned = arm.limits.snap(q + np.where(outside, np.ceil((lower - AT_LIMIT - q) / TURN), 0.0) * TURN)
    return np.where(turned <= upper, turned, q)


def at_full_speed(arm: Arm, points: Array) -> float:
    """Seconds along points (k, n) at full speed, without stops at corners.

    For the control points of a curve this is an upper bound of the time of the curve at full speed, and at least
    :func:`least_seconds` between its ends.
    """
    return float(least_times(np.diff(points, axis=0), arm.limits, full_speed=True).sum())


def least_seconds(arm: Arm, here: Array, there: Array) -> Array:
    """(k, m) lower bound (s) of the time of any motion from each of (k, n) to each of (m, n) modulo full rotations."""
    distance = here[:, None, :] - there[None, :, :]
    turned = np.where(arm.periodic, distance - TURN * np.round(distance / TURN), distance)
    return least_times(turned, arm.limits, full_speed=True)
