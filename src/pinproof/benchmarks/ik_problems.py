"""Targets of the IK benchmark, and the independent check of the answers by Pinocchio's forward kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.ik_methods import PERIOD
from pinproof.model import Arm, JointLimits
from pinproof.spatial import rigid, twist_size

__all__ = [
    "CheckedAnswers",
    "Targets",
    "check_answers",
    "random_targets",
    "smooth_targets",
    "with_reduced_ranges",
]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

CYCLE = 10.0
"""Seconds in which the slowest joint of the trajectory completes one cycle."""

SHARE_OF_RANGE, SHARE_OF_SPEED = 0.45, 0.3
"""Amplitude of the joint motions along the trajectory as a share of the range, and their largest speed as a share of
the velocity limit. A redundant arm may use other joints for the same poses, which needs a reserve of speed."""


@dataclass(frozen=True, eq=False)
class Targets:
    """Reachable targets.

    Parameters
    ----------
    poses
        (N, 4, 4) base_from_target.
    q
        (N, n) configurations inside the limits that generated them, unknown to the methods.
    start
        (n,) where a method starts: the middle of the ranges, or the beginning of the trajectory.
    """

    poses: Array
    q: Array
    start: Array


def with_reduced_ranges(arm: Arm) -> Arm:
    """Return the arm with each finite range wider than 2 pi reduced to +-pi about its centre, as for the UR5."""
    lower, upper = arm.limits.lower.copy(), arm.limits.upper.copy()
    wide = arm.periodic & np.isfinite(upper - lower) & (upper - lower > 2 * np.pi)
    centre = (lower[wide] + upper[wide]) / 2
    lower[wide], upper[wide] = centre - np.pi, centre + np.pi
    limits = arm.limits
    return arm.with_limits(
        JointLimits(lower, upper, limits.velocity, limits.acceleration, acceleration_source=limits.acceleration_source)
    )


def random_targets(arm: Arm, points: int, seed: int) -> Targets:
    """Return the poses of configurations drawn uniformly within the limits (+-pi for a joint without limits)."""
    lower, upper = arm.limits.sampling_range()
    q = np.random.default_rng(seed).uniform(lower, upper, (points, arm.dof))
    return Targets(arm.forward_kinematics_batch(q), q, (lower + upper) / 2)


def smooth_targets(arm: Arm, points: int, seed: int) -> Targets:
    """Return poses along a smooth curve within the position and velocity limits, :data:`PERIOD` apart.

    Each joint follows a sine about the middle of its range with one to three periods per cycle. The poses may pass
    singularities; the configurations that generated them prove that they can be followed without a jump.
    """
    lower, upper = arm.limits.sampling_range()
    speed = 2 * np.pi * (1.0 + np.arange(arm.dof) % 3) / CYCLE
    largest = np.where(np.isnan(arm.limits.velocity), np.inf, arm.limits.velocity)
    amplitude = np.minimum(SHARE_OF_RANGE * (upper - lower), SHARE_OF_SPEED * largest / speed)
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, arm.dof)
    time = PERIOD * np.arange(points)[:, None]
    q = (lower + upper) / 2 + amplitude * np.sin(speed * time + phase)
    return Targets(arm.forward_kinematics_batch(q), q, q[0].copy())


# -- check of the answers ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CheckedAnswers:
    """The check of the answers to N targets.

    Parameters
    ----------
    answered
        (N,) whether the method reports an answer.
    correct
        (N,) whether all answers that it reports are inside the limits and within the tolerance.
    position_error, rotation_error
        (N,) of the worst answer, in m and rad; infinite if it is not finite, 0 without an answer and for what the task
        leaves free.
    """

    answered: Flags
    correct: Flags
    position_error: Array
    rotation_error: Array

    @property
    def success(self) -> float:
        """Share of targets that were solved."""
        return float(self.correct.mean())

    @property
    def false_positives(self) -> int:
        """Number of targets reported as solved whose answers fail the check."""
        return int((self.answered & ~self.correct).sum())


def check_answers(arm: Arm, targets: Array, answers: Array, task: str, tolerance: float) -> CheckedAnswers:
    """Check answers (N, k, n) to targets (N, 4, 4); a row of NaN means no answer.

    ``tolerance`` is in m and rad; ``task`` is ``"pose"`` or ``"position"``. Answers are neither wrapped nor clipped.
    """
    reported: Flags = np.asarray(~np.isnan(answers).all(axis=2))
    inside: Flags = np.asarray(((arm.limits.lower <= answers) & (answers <= arm.limits.upper)).all(axis=2))
    correct = np.ones(reported.shape, dtype=bool)
    errors = np.zeros((*reported.shape, 2))
    for row, column in np.argwhere(reported):
        q = answers[row, column]
        if np.isfinite(q).all():
            errors[row, column] = twist_size(rigid("target", targets[row]), arm.forward_kinematics(q))
        else:
            errors[row, column] = np.inf
        if task == "position":
            errors[row, column, 1] = 0.0
        correct[row, column] = inside[row, column] and bool((errors[row, column] <= tolerance).all())
    answered = np.asarray(reported.any(axis=1))
    worst = errors.max(axis=1, initial=0.0)
    return CheckedAnswers(answered, np.asarray(answered & correct.all(axis=1)), worst[:, 0], worst[:, 1])
