"""The IK methods by name, and the textbook's table: the methods on the same random poses, checked by Pinocchio."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from pinproof.common.validation import Rng, require_integer
from pinproof.errors import InputError, UnknownNameError
from pinproof.ik.analytic_ik import AnalyticIk
from pinproof.ik.fabrik import Fabrik
from pinproof.ik.iterative import IterativeIk
from pinproof.ik.jacobian_methods import Clik, DampedLeastSquares, PseudoInverse
from pinproof.ik.task import TaskName
from pinproof.model import Arm
from pinproof.spatial import rigid, twist_size

IK_METHODS: dict[str, type[IterativeIk | AnalyticIk]] = {
    "clik": Clik,
    "analytic": AnalyticIk,
    "damped_least_squares": DampedLeastSquares,
    "pseudo_inverse": PseudoInverse,
    "fabrik": Fabrik,
}
"""Solver classes by name; each of them can be created without arguments."""


def make_ik(name: str) -> IterativeIk | AnalyticIk:
    """Return a solver of :data:`IK_METHODS` with its default settings.

    Raises
    ------
    UnknownNameError
        If there is no method with this name.
    """
    if name not in IK_METHODS:
        raise UnknownNameError("IK method", name, IK_METHODS)
    return IK_METHODS[name]()


TEXTBOOK = {"pseudo_inverse": (1.20, 0.85), "damped_least_squares": (1.45, 0.95), "fabrik": (0.40, 0.98)}
TEXTBOOK["analytic"] = (0.002, 1.0)
"""The textbook's mean time in ms (on an unknown machine) and success as a share: 10,000 positions, one seed."""

TOLERANCES = {"fabrik": 1e-4}
"""Largest accepted error (m and rad), by default 1e-6; FABRIK converges linearly, not quadratically."""

PARTS: tuple[tuple[TaskName, int], ...] = (("position", 0), ("position", 50), ("pose", 0), ("pose", 50))
"""Task and restarts of each part of the table."""

WARM_UP = 20
"""Calls before the measurement, which load code and fill caches."""


@dataclass(frozen=True)
class BenchRow:
    """A method in one part of the table; single calls from Python in ms, errors in m and rad.

    ``success`` is the share of poses with an answer within the limits and ``tolerance``; ``false_positives`` counts the
    other answers that were reported as solutions.
    """

    method: str
    task: str
    restarts: int
    mean_ms: float
    median_ms: float
    success: float
    false_positives: int
    position_error: float
    orientation_error: float
    tolerance: float
    textbook_ms: float | None
    textbook_success: float | None


def bench(
    arm: Arm,
    *,
    points: int = 10_000,
    methods: Sequence[str] = tuple(IK_METHODS),
    rng: Rng = 0,
    on_progress: Callable[[str], None] = lambda _: None,
) -> tuple[list[BenchRow], dict[str, str]]:
    """Measure IK methods on the poses of ``points`` configurations drawn uniformly within the limits of an arm.

    Each solve starts at the middle of the joint ranges (+-pi without limits). Returns the rows, and the reason for each
    method that does not apply to the arm. UnknownNameError is raised for an unknown method.
    """
    # the poses, which are reachable because they are those of configurations
    require_integer("points", points, 1)
    solvers = {name: make_ik(name) for name in methods}
    lower, upper = arm.limits.sampling_range()
    q, q0 = np.random.default_rng(rng).uniform(lower, upper, (points, arm.dof)), (lower + upper) / 2
    targets = [rigid("target", pose) for pose in arm.forward_kinematics_batch(q)]
    rows: list[BenchRow] = []
    left_out: dict[str, str] = {}
    for name, solver in solvers.items():
        on_progress(name)
        tolerance = TOLERANCES.get(name, 1e-6)
        # The closed form returns every branch of a full pose, and has nothing to restart.
        for task, restarts in PARTS if isinstance(solver, IterativeIk) else (("pose", 0),):
            used = replace(solver, restarts=restarts) if isinstance(solver, IterativeIk) else solver
            try:
                for target in targets[:WARM_UP]:
                    used.solve(arm, target, q0, task=task)
            except InputError as error:
                left_out[name] = str(error)
                break
            # the time of each call, and the errors of each answer
            times, errors, correct = [], [], 0
            for target in targets:
                begin = perf_counter()
                result = used.solve(arm, target, q0, task=task)
                times.append(1e3 * (perf_counter() - begin))
                if result.ok:
                    # The status is not trusted: the pose is computed again, and the limits are compared.
                    position, orientation = twist_size(target, arm.forward_kinematics(result.q))
                    errors.append((position, orientation if task == "pose" else 0.0))
                    inside = bool(((arm.limits.lower <= result.q) & (result.q <= arm.limits.upper)).all())
                    correct += inside and max(errors[-1]) <= tolerance
            # the textbook states positions without restarts only
            figures = float(np.mean(times)), float(np.median(times)), correct / points, len(errors) - correct
            position, orientation = np.max([(0.0, 0.0), *errors], axis=0).tolist()
            comparable = restarts == 0 and (task == "position" or name == "analytic")
            textbook = TEXTBOOK.get(name, (None, None)) if comparable else (None, None)
            rows.append(BenchRow(name, task, restarts, *figures, position, orientation, tolerance, *textbook))
    return rows, left_out
