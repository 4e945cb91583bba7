"""What a method in the IK benchmark is, and the methods of this package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from pinproof.errors import InputError
from pinproof.ik import AnalyticIk, Fabrik, IkResult, IterativeIk, Tracker, track
from pinproof.ik.methods import IK_METHODS
from pinproof.ik.task import GoalName
from pinproof.model import Arm
from pinproof.spatial import SE3, Array, rigid

TOLERANCE = 1e-6
"""Largest accepted error of an answer, in m and rad."""

FABRIK_TOLERANCE = 1e-4
"""The same for FABRIK without polishing, in m and rad: it converges linearly, not quadratically."""

RESTARTS = 50
"""Attempts after the first in the parts with restarts; the default of the solvers."""

PERIOD = 0.001
"""Seconds between two targets of the trajectory: a control loop of 1 kHz."""


@dataclass(frozen=True)
class Part:
    """One part of the table: the kind of targets, the task, and whether methods may restart."""

    problem: Literal["random", "trajectory"]
    task: Literal["position", "pose"]
    restarts: bool

    def __str__(self) -> str:
        if self.problem == "trajectory":
            return "smooth trajectory, each call starts from the last answer"
        task = {"position": "position only", "pose": "full poses"}[self.task]
        return f"random targets, {task}, {'with restarts' if self.restarts else 'one seed'}"


PARTS: tuple[Part, ...] = (
    Part("random", "position", False),
    Part("random", "position", True),
    Part("random", "pose", False),
    Part("random", "pose", True),
    Part("trajectory", "pose", True),
)
"""The parts of the table, in its order."""


def _as_se3(pose: Array) -> SE3:
    return rigid("target", pose)


@dataclass(frozen=True)
class PreparedMethod:
    """A method, prepared for one arm and one part of the table.

    ``convert_target`` makes the argument of ``solve`` of a target (4, 4); only ``solve`` is timed, called with it and a
    start q0 (n,). ``read`` returns the answers (k, n) in its result, none if it reported a failure. ``solve_batch``
    solves all targets (N, 4, 4) from q0 on one thread: (N, k, n), NaN for no answer. A method that keeps a state has
    ``reset``, called with the start.
    """

    solve: Callable[[Any, Array], Any]
    read: Callable[[Any], Array]
    convert_target: Callable[[Array], Any] = _as_se3
    solve_batch: Callable[[Array, Array], Array] | None = None
    reset: Callable[[Array], None] | None = None


def any_part(_: Part) -> bool:
    """Return True: for methods that apply to every part of the table."""
    return True


def poses_only(part: Part) -> bool:
    """Return whether a part requires full poses."""
    return part.task == "pose"


@dataclass(frozen=True)
class IkMethod:
    """A method of the table: its name on the command line, and its label in the table.

    ``prepare`` returns the method prepared for an arm and a part of the table, to which it ``applies``, or raises
    NotApplicableError, ImportError or an error of the library. ``tolerance`` (m and rad) is the largest accepted error,
    ``textbook`` the mean time in ms and the success that the textbook states. Another library has the key of ours that
    solves the same problem, the number of targets after which a slow one stops, and the distribution that installs it.
    """

    key: str
    label: str
    prepare: Callable[[Arm, Part], PreparedMethod]
    applies: Callable[[Part], bool] = any_part
    tolerance: float = TOLERANCE
    textbook: tuple[float, float] | None = None
    compared_with: str | None = None
    max_targets: int | None = None
    distribution: str | None = None


def select_methods(keys: Sequence[str] | None, methods: tuple[IkMethod, ...]) -> tuple[IkMethod, ...]:
    """Return the methods with these keys in the order of the table, or all of them for None; refuse unknown keys."""
    known = [method.key for method in methods]
    unknown = [key for key in keys or () if key not in known]
    if unknown:
        raise InputError(f"unknown IK method {', '.join(unknown)}; choose from {', '.join(known)}")
    return tuple(method for method in methods if keys is None or method.key in keys)


def _reader(arm: Arm) -> Callable[[IkResult], Array]:
    return lambda result: result.q[None] if result.ok else np.empty((0, arm.dof))


def _iterative(solver: Callable[..., IterativeIk], arm: Arm, part: Part) -> PreparedMethod:
    ik = solver(restarts=RESTARTS if part.restarts else 0)

    def solve_batch(targets: Array, q0: Array) -> Array:
        batch = ik.solve_batch(arm, targets, q0, task=part.task)
        return np.where(batch.ok[:, None], batch.q, np.nan)[:, None]

    return PreparedMethod(
        solve=lambda target, q0: ik.solve(arm, target, q0, task=part.task),
        read=_reader(arm),
        # A batch starts at the same q0 for all targets, which does not follow a trajectory.
        solve_batch=solve_batch if part.problem == "random" else None,
    )


def _closed_form(solver: Callable[[], AnalyticIk], arm: Arm, part: Part) -> PreparedMethod:
    """All branches for up to six joints; for seven joints and along the trajectory, the branch nearest to q0."""
    ik = solver()
    ik.solve_all(arm, arm.forward_kinematics(arm.home))  # raises if the arm has no closed form
    if arm.dof > 6 or part.problem == "trajectory":
        return PreparedMethod(solve=lambda target, q0: ik.solve(arm, target, q0), read=_reader(arm))
    return PreparedMethod(
        solve=lambda target, _: ik.solve_all(arm, target).branches,
        read=lambda branches: branches,
        convert_target=np.ascontiguousarray,
        solve_batch=lambda targets, q0: ik.solve_all_batch(arm, targets, q0).q,
    )


def _tracking(arm: Arm, part: Part) -> PreparedMethod:
    """One sample per call, and the whole sequence in one call; samples that were not reached are not answers.

    A redundant arm keeps its joints centred; without this goal it drifts to its limits and misses later samples.
    """
    goal: GoalName | None = "centre" if arm.dof > 6 else None
    trackers: list[Tracker] = []

    def reset(start: Array) -> None:
        trackers[:] = [Tracker(arm, PERIOD, start, task=part.task, goal=goal)]

    def solve_batch(poses: Array, start: Array) -> Array:
        result = track(arm, poses, start, dt=PERIOD, task=part.task, goal=goal)
        return np.where(result.reached[:, None], result.q, np.nan)[:, None]

    return PreparedMethod(
        solve=lambda target, _: trackers[0].step(target),
        read=lambda q: q[None] if trackers[0].ok else np.empty((0, arm.dof)),
        solve_batch=solve_batch,
        reset=reset,
    )


TEXTBOOK = {
    "pseudo_inverse": (1.20, 0.85),
    "damped_least_squares": (1.45, 0.95),
    "fabrik": (0.40, 0.98),
    "analytic": (0.002, 1.0),
}
"""The textbook's figures by method: position only, one seed, 10,000 points."""


def _own_method(key: str, solver: Any) -> IkMethod:
    iterative = issubclass(solver, IterativeIk)
    return IkMethod(
        key,
        solver.__name__,
        partial(_iterative if iterative else _closed_form, solver),
        any_part if iterative else poses_only,
        FABRIK_TOLERANCE if solver is Fabrik else TOLERANCE,
        TEXTBOOK.get(key),
    )


_POLISHED = partial(Fabrik, polish=True, position_tolerance=TOLERANCE, orientation_tolerance=TOLERANCE)

OWN_METHODS: tuple[IkMethod, ...] = (
    *(_own_method(key, solver) for key, solver in IK_METHODS.items()),
    IkMethod("fabrik_polished", "Fabrik, polished", partial(_iterative, _POLISHED)),
    IkMethod("tracking", "Tracker", _tracking, lambda part: part.problem == "trajectory"),
)
"""The methods of this package: those of :data:`pinproof.ik.methods.IK_METHODS`, and two variants of use."""
