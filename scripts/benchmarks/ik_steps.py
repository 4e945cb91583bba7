"""Step lengths of the IK methods near a singularity, which show in docs/ik.md why steps are damped."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.tables import log_panel, new_figure
from pinproof.ik import Clik, DampedLeastSquares, IkStep, IterativeIk, PseudoInverse
from pinproof.model import Arm
from pinproof.spatial import SE3, pose

Array = npt.NDArray[np.float64]

METHODS = ("inverse", "pseudo-inverse", "damped least squares", "CLIK")
"""The plain inverse of the textbook, and the first steps of the solvers. These have their default settings, except that
the pseudo-inverse has no bound on its step, which would hide its behaviour."""

MOTION = 0.01
"""Requested motion of the TCP, in m and rad: the six coordinates are equal."""

NEAREST, FARTHEST, STEPS = 1e-9, 1.0, 181
"""Range of the distances of the joint from its singular value, in rad or m, and their number."""

UNBOUNDED = 1e6
"""A bound on the step in rad that is never reached."""

SINGULAR = 1e-7
"""Smallest singular value of the Jacobian below which a configuration is singular."""


@dataclass(frozen=True, eq=False)
class StepSizes:
    """Step lengths when ``joint`` moves into a singularity with the others at home.

    ``smallest`` (m,) are the smallest singular values of the Jacobian, decreasing, and ``steps`` maps each method to
    the (m,) lengths |dq| of its step in rad (or m).
    """

    joint: str
    smallest: Array
    steps: dict[str, Array]


def step_sizes(arm: Arm) -> StepSizes | None:
    """Return the steps of an arm with six joints that has a singularity at home up to one joint; else None."""
    if arm.dof != 6:
        return None
    for joint in reversed(range(arm.dof)):  # wrist singularities first
        singular = _singular_value_of_joint(arm, joint)
        if singular is not None:
            return _towards(arm, joint, singular)
    return None


def step_plot(steps: StepSizes, title: str) -> Any:
    """Plot step lengths against the smallest singular value."""
    figure, ((panel,),) = new_figure(1, 1, width=6.4, height=4.4)
    for (name, lengths), style in zip(steps.steps.items(), ("k:", "C0-", "C1-", "C2-"), strict=True):
        panel.plot(steps.smallest, lengths, style, label=name)
    title, y_label = f"{title}: {steps.joint} moves into a singularity", f"|dq| for a motion of {MOTION:g} (m, rad)"
    log_panel(panel, title, "smallest singular value of the Jacobian", y_label, percent=False)
    panel.set_yscale("log")
    panel.invert_xaxis()
    panel.legend()
    return figure


def _towards(arm: Arm, joint: int, singular: float) -> StepSizes:
    """Steps at configurations that approach the singular value of the joint."""
    unlimited = arm.with_limits(replace(arm.limits, lower=np.full(6, -np.inf), upper=np.full(6, np.inf)))
    solvers = {
        "pseudo-inverse": PseudoInverse(max_iterations=1, restarts=0, max_step=UNBOUNDED),
        "damped least squares": DampedLeastSquares(max_iterations=1, restarts=0),
        "CLIK": Clik(max_iterations=1, restarts=0),
    }
    smallest: list[float] = []
    steps: dict[str, list[float]] = {name: [] for name in METHODS}
    for distance in np.geomspace(FARTHEST, NEAREST, STEPS):
        q = _home_with(arm, joint, singular + distance)
        base_from_target = arm.forward_kinematics(q) * _target_from_tcp().inverse()
        jacobian = np.kron(np.eye(2), base_from_target.rotation.T) @ arm.jacobian(q)  # in the axes of the target
        smallest.append(_smallest_singular_value(arm, joint, singular + distance))
        inverse_step = np.nan
        with suppress(np.linalg.LinAlgError):
            inverse_step = float(np.linalg.norm(np.linalg.inv(jacobian) @ np.full(6, MOTION / np.sqrt(6))))
        steps["inverse"].append(inverse_step)
        for name, solver in solvers.items():
            steps[name].append(_first_step(solver, unlimited, base_from_target, q))
    order = np.argsort(smallest)[::-1]
    return StepSizes(
        arm.joint_names[joint],
        np.array(smallest)[order],
        {name: np.array(lengths)[order] for name, lengths in steps.items()},
    )


def _target_from_tcp() -> SE3:
    """The pose before the step, whose six coordinates are equal."""
    share, angle = MOTION / np.sqrt(6), MOTION / np.sqrt(2)
    return pose((share,) * 3, quat_xyzw=(*(np.sin(angle / 2) / np.sqrt(3),) * 3, np.cos(angle / 2)))


def _first_step(solver: IterativeIk, arm: Arm, target: SE3, q: Array) -> float:
    """The length of the first step of a solver, from its public callback."""
    taken: list[IkStep] = []
    solver.solve(arm, target, q, on_step=taken.append)
    return float(np.linalg.norm(taken[0].step))


def _singular_value_of_joint(arm: Arm, joint: int) -> float | None:
    """The value of a joint at which the arm, otherwise at home, is singular; None without such a value.

    A ternary search refines the lowest of many samples of the smallest singular value.
    """

    def smallest(value: float) -> float:
        return _smallest_singular_value(arm, joint, value)

    lower, upper = arm.limits.sampling_range()
    values = np.linspace(lower[joint], upper[joint], 362)[1:-1]
    lowest, step = min(values, key=smallest), values[1] - values[0]
    low, high = lowest - step, lowest + step
    for _ in range(80):
        a, b = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, b) if smallest(a) < smallest(b) else (a, high)
    value = float((low + high) / 2)
    # An arm that is singular at every value of the joint has its singularity elsewhere.
    return value if smallest(value) <= SINGULAR and smallest(value + FARTHEST) > 1e3 * SINGULAR else None


def _smallest_singular_value(arm: Arm, joint: int, value: float) -> float:
    return float(np.linalg.svd(arm.jacobian(_home_with(arm, joint, value)), compute_uv=False)[-1])


def _home_with(arm: Arm, joint: int, value: float) -> Array:
    q = arm.home
    q[joint] = value
    return q
