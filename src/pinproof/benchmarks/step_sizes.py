"""How long a step each method takes as a singularity comes near: why steps are damped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.ik import Clik, DampedLeastSquares, IkStep, IterativeIk, PseudoInverse
from pinproof.model import Arm, JointLimits
from pinproof.spatial import SE3, pose

__all__ = ["METHODS", "StepSizes", "step_sizes"]

Array = npt.NDArray[np.float64]

METHODS = ("inverse", "pseudo-inverse", "damped least squares", "CLIK")
"""The plain inverse is the textbook's; the others are the solvers' own first steps, with their default settings but
for the pseudo-inverse's bound on a step, which would hide what it does."""

ASKED = 0.01
"""The size of the motion asked of the tcp, in m and rad: equal parts of all six coordinates."""

NEAREST, FARTHEST, STEPS = 1e-9, 1.0, 181
"""Rad or m between the singular value of the joint and where the step is taken."""

UNBOUNDED = 1e6
"""Rad: a bound that no step here meets."""

SINGULAR = 1e-7
"""The smallest singular value at which a configuration counts as singular."""


@dataclass(frozen=True, eq=False)
class StepSizes:
    """Steps on the way into a singularity.

    Parameters
    ----------
    joint
        The joint that leads there; the others stand at the arm's home.
    smallest
        (m,) smallest singular values of the Jacobian, falling.
    steps
        Method of :data:`METHODS` to (m,) lengths |dq| of its step, in rad (or m).
    """

    joint: str
    smallest: Array
    steps: dict[str, Array]


def step_sizes(arm: Arm) -> StepSizes | None:
    """The steps of an arm of six joints whose home becomes singular by moving one of them; None for any other."""
    if arm.dof != 6:
        return None
    for joint in reversed(range(arm.dof)):  # the wrist first
        at = _singular_value_of(arm, joint)
        if at is not None:
            return _along(arm, joint, at)
    return None


def _along(arm: Arm, joint: int, at: float) -> StepSizes:
    free = arm.with_limits(
        JointLimits(np.full(6, -np.inf), np.full(6, np.inf), arm.limits.velocity, arm.limits.acceleration)
    )
    rules = {
        "pseudo-inverse": PseudoInverse(max_iterations=1, restarts=0, max_step=UNBOUNDED),
        "damped least squares": DampedLeastSquares(max_iterations=1, restarts=0),
        "CLIK": Clik(max_iterations=1, restarts=0),
    }
    smallest: list[float] = []
    steps: dict[str, list[float]] = {name: [] for name in METHODS}
    for away in np.geomspace(FARTHEST, NEAREST, STEPS):
        q = _moved(arm, joint, at + away)
        base_from_target = arm.forward_kinematics(q) * _asked().inverse()
        in_target_axes = np.kron(np.eye(2), base_from_target.rotation.T) @ arm.jacobian(q)
        smallest.append(_smallest(arm, joint, at + away))
        try:
            plain = float(np.linalg.norm(np.linalg.inv(in_target_axes) @ np.full(6, ASKED / np.sqrt(6))))
        except np.linalg.LinAlgError:
            plain = np.nan
        steps["inverse"].append(plain)
        for name, solver in rules.items():
            steps[name].append(_first_step(solver, free, base_from_target, q))
    order = np.argsort(smallest)[::-1]
    return StepSizes(
        arm.joint_names[joint],
        np.array(smallest)[order],
        {name: np.array(lengths)[order] for name, lengths in steps.items()},
    )


def _asked() -> SE3:
    """target_from_tcp before the step: each of its six coordinates is the same share of :data:`ASKED`."""
    share, angle = ASKED / np.sqrt(6), ASKED / np.sqrt(2)
    return pose((share,) * 3, quat_xyzw=(*(np.sin(angle / 2) / np.sqrt(3),) * 3, np.cos(angle / 2)))


def _first_step(solver: IterativeIk, arm: Arm, target: SE3, q: Array) -> float:
    """The length of the first step that a solver takes, seen as anybody can see it."""
    taken: list[IkStep] = []
    solver.solve(arm, target, q, on_step=taken.append)
    return float(np.linalg.norm(taken[0].step))


def _singular_value_of(arm: Arm, joint: int) -> float | None:
    """The value of a joint at which the arm, else at home, is singular: by ternary search around the lowest of many."""
    lower, upper = arm.limits.sampling_range()
    values = np.linspace(lower[joint], upper[joint], 362)[1:-1]
    lowest = values[int(np.argmin([_smallest(arm, joint, value) for value in values]))]
    low, high = lowest - (values[1] - values[0]), lowest + (values[1] - values[0])
    for _ in range(80):
        a, b = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, b) if _smallest(arm, joint, a) < _smallest(arm, joint, b) else (a, high)
    middle = (low + high) / 2
    if _smallest(arm, joint, middle) > SINGULAR:
        return None
    # Where nothing else makes it singular: not an axis that never matters.
    return float(middle) if _smallest(arm, joint, middle + FARTHEST) > 1e3 * SINGULAR else None


def _smallest(arm: Arm, joint: int, value: float) -> float:
    return float(np.linalg.svd(arm.jacobian(_moved(arm, joint, value)), compute_uv=False)[-1])


def _moved(arm: Arm, joint: int, value: float) -> Array:
    q = arm.home
    q[joint] = value
    return q
