"""What the table of inverse kinematics asks: random reachable targets, and a smooth trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm, JointLimits

__all__ = ["Targets", "narrowed", "random_targets", "smooth_targets"]

Array = npt.NDArray[np.float64]

PERIOD = 0.001
"""Seconds between two targets of the trajectory: a control loop of 1 kHz."""

ROUND = 10.0
"""Seconds in which the slowest joint of the trajectory comes back to where it was."""

SHARE_OF_RANGE, SHARE_OF_SPEED = 0.45, 0.3
"""How far from the middle of its range (in ranges), and how fast (in velocity limits), the trajectory moves a joint.
A redundant arm may take other joints for the same poses, and needs speed to spare for that."""


@dataclass(frozen=True, eq=False)
class Targets:
    """Reachable targets.

    Parameters
    ----------
    poses
        (N, 4, 4) base_from_target.
    q
        (N, n) the configurations inside the limits that they were made from; no method sees them.
    start
        (n,) where a method starts: for random targets the middle of the ranges, for a trajectory its beginning.
    """

    poses: Array
    q: Array
    start: Array


def narrowed(arm: Arm) -> Arm:
    """The arm with each finite range of more than one turn narrowed to the turn in its middle (the UR5's to +-pi)."""
    lower, upper = arm.limits.lower.copy(), arm.limits.upper.copy()
    wide = arm.periodic & np.isfinite(upper - lower) & (upper - lower > 2 * np.pi)
    middle = (lower[wide] + upper[wide]) / 2
    lower[wide], upper[wide] = middle - np.pi, middle + np.pi
    limits = arm.limits
    return arm.with_limits(JointLimits(lower, upper, limits.velocity, limits.acceleration, limits.acceleration_source))


def random_targets(arm: Arm, points: int, seed: int) -> Targets:
    """Targets of configurations uniform inside the limits (one turn about 0 where a joint has none)."""
    lower, upper = arm.limits.sampling_range()
    q = np.random.default_rng(seed).uniform(lower, upper, (points, arm.dof))
    return Targets(arm.forward_kinematics_batch(q), q, (lower + upper) / 2)


def smooth_targets(arm: Arm, points: int, seed: int) -> Targets:
    """Targets along a smooth curve inside the limits of position and speed, :data:`PERIOD` apart.

    Each joint swings as a sine about the middle of its range, one to three times a round. So the arm meets its
    singularities on the way, and the configurations that made the targets prove that no jump is needed there.
    """
    lower, upper = arm.limits.sampling_range()
    turns = 1.0 + np.arange(arm.dof) % 3
    speed = 2 * np.pi * turns / ROUND
    fastest = np.where(np.isnan(arm.limits.velocity), np.inf, arm.limits.velocity)
    swing = np.minimum(SHARE_OF_RANGE * (upper - lower), SHARE_OF_SPEED * fastest / speed)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, arm.dof)
    time = PERIOD * np.arange(points)[:, None]
    q = (lower + upper) / 2 + swing * np.sin(speed * time + phase)
    return Targets(arm.forward_kinematics_batch(q), q, q[0].copy())
