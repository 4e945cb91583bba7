"""Results of inverse kinematics: status, configuration, errors, and message.

The errors of every result are computed by forward kinematics after the solver's loop, independently of it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from pinproof.common.results import Answer, Rows, Shown, View
from pinproof.common.validation import freeze_arrays
from pinproof.errors import IkFailed
from pinproof.ik.task import Task
from pinproof.ik.windings import nearest_winding
from pinproof.model import Arm
from pinproof.spatial import Array
from pinproof.units import far_hint

Errors = tuple[float, float]
Counted = tuple[bool, bool]

AT_LIMIT = 1e-6
"""A joint within this distance of a limit (rad or m) is reported as being at the limit."""

SMALL_RESIDUAL = (1e-2, 1e-1)
"""Residuals (m, rad) below which a failed search may have ended close to a solution; farther away, the target is
probably out of reach."""


class IkAnswer(Answer):
    """The part that the results of inverse kinematics share."""

    failure = IkFailed


def found(errors: Errors, counted: Counted, iterations: int, attempt: int) -> str:
    """The message of a solution, with the errors that the task counts."""
    return (
        f"found: error {_errors(errors, counted)} after {_count(iterations, 'step')} and {_count(attempt, 'restart')}"
    )


def not_found(
    arm: Arm, counted: Counted, q: npt.NDArray[np.float64], errors: Errors, iterations: int, attempts: int
) -> str:
    """The message if no attempt reached the target; q (n,) is the configuration with the smallest residual.

    ``counted`` states whether the task selects any coordinates of the position, and of the orientation.
    """
    at_limit = [
        f"joint {name} is at its {'lower' if value - low <= AT_LIMIT else 'upper'} limit"
        for name, value, low, high in zip(arm.joint_names, q, arm.limits.lower, arm.limits.upper, strict=True)
        if min(value - low, high - value) <= AT_LIMIT
    ]
    limits = "".join(f"; {text}" for text in at_limit)
    residual = [error if counts else 0.0 for error, counts in zip(errors, counted, strict=True)]
    remedy = f"{_remedy(arm, residual, counted)}{far_hint(residual[0], arm.robot.size)}"
    return (
        f"not reached: residual {_errors(errors, counted)} after {_count(attempts, 'attempt')} "
        f"({_count(iterations, 'step')}){limits}. {remedy}"
    )


def _remedy(arm: Arm, residual: Sequence[float], counted: Counted) -> str:
    """What to change, for the task and the residual (m, rad) of a failed search."""
    if all(error < limit for error, limit in zip(residual, SMALL_RESIDUAL, strict=True)):
        return "The residual is small: try another seed, more restarts or larger tolerances"
    frame = f"check the tcp frame ({arm.tcp} in {arm.base})"
    if not all(counted):
        what = "move the target or the base" if counted[0] else "rotate the target"
        return f"The target is probably out of reach: {what}, or {frame}"
    what = f"move the target or the base, {frame}, or leave the orientation free (task position)"
    return f"The target is probably out of reach: {what}"


def refused(refusals: int, attempts: int) -> str:
    """The message if ``accept`` rejected every solution."""
    return (
        f"rejected: accept returned False for all {_count(refusals, 'solution')} of {_count(attempts, 'attempt')}; "
        "check why it rejects q (for example a collision), increase restarts, or move the target"
    )


def sampled(solutions: int, attempts: int, refusals: int) -> str:
    """The message of a sample of solutions."""
    rejected = f", {_count(refusals, 'solution')} rejected by accept" if refusals else ""
    remedy = "" if solutions else "; increase attempts, or call solve() for the residual of the closest configuration"
    return (
        f"{_count(solutions, 'distinct solution')} from {_count(attempts, 'attempt')}{rejected}; "
        f"this is a sample, and further solutions may exist{remedy}"
    )


def _errors(errors: Errors, counted: Counted) -> str:
    """Distance and angle, those of them that count; the distance in m from 1 m and in mm below."""
    distance = f"{errors[0]:.3g} m" if errors[0] >= 1.0 else f"{1000.0 * errors[0]:.3g} mm"
    texts = (distance, f"{errors[1]:.3g} rad")
    return ", ".join(text for text, counts in zip(texts, counted, strict=True) if counts)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


@dataclass(frozen=True, eq=False)
class Candidate:
    """A configuration (n,) of a search, its errors in m and rad, and whether it satisfies the task within the limits.

    ``iterations`` and ``attempts`` are those of the search.
    """

    q: Array
    position_error: float
    orientation_error: float
    fulfils: bool
    iterations: int = 0
    attempts: int = 0


def judge(
    arm: Arm, target: Array, task: Task, q: Array, reference: Array, iterations: int = 0, attempts: int = 0
) -> Candidate:
    """Shift q (n,) by 2 pi to be closest to ``reference`` (n,), and measure its errors for the target by Pinocchio."""
    q = nearest_winding(arm, q, reference)
    base_from_tcp, _ = arm.local_jacobian(q)  # skips the validation of q, which comes from the solver
    errors = task.compiled.measure_batch(np.ascontiguousarray(target[None]), base_from_tcp.homogeneous[None].copy())
    fulfils = bool(task.fulfilled(errors)[0]) and arm.limits.contains(q)
    position_error, orientation_error = errors[0].tolist()
    return Candidate(q, position_error, orientation_error, fulfils, iterations, attempts)


class IkStatus(Enum):
    """The outcomes of a solution attempt."""

    FOUND = "found"
    """``q`` satisfies the task within the tolerances and the limits, and ``accept`` returned True."""
    NOT_FOUND = "not found"
    """All attempts were used; ``q`` is the configuration with the smallest residual, with its errors."""
    REFUSED = "refused"
    """Configurations that satisfy the task were found, and ``accept`` rejected each; ``q`` is the first of them."""
    IMPOSSIBLE = "impossible"
    """No configuration within the limits reaches the target: the closed form enumerated all solutions, or
    :func:`pinproof.prove_unreachable` excluded all joint values. Iterative methods never return this status."""


@dataclass(frozen=True, eq=False)
class IkResult(IkAnswer):
    """The result of inverse kinematics for one target.

    Parameters
    ----------
    status
        The outcome; :attr:`ok` is True if it is FOUND.
    q
        (n,) a configuration within the limits; a solution if :attr:`ok`, else see
        :class:`~pinproof.ik.IkStatus`. Read-only.
    position_error
        Distance in m from the tcp to the target at ``q``, by forward kinematics.
    orientation_error
        Angle in rad between the orientations of tcp and target. Both errors count only the coordinates that the task
        selects; if a task selects no position or no orientation, the complete error is reported.
    iterations
        Steps over all attempts.
    restarts
        Attempts after the first.
    engine
        ``"compiled"``, ``"pinocchio"`` or ``"analytic"``.
    words
        The message; by default it is composed from the other fields of a solution.
    counted
        Whether the task selects any coordinates of the position, and of the orientation.
    """

    status: IkStatus
    q: Array
    position_error: float
    orientation_error: float
    iterations: int
    restarts: int
    engine: str
    words: str | None = None
    counted: Counted = (True, True)

    def __post_init__(self) -> None:
        if self.q.flags.writeable:
            freeze_arrays(self, "q")

    @property
    def message(self) -> str:
        """Status, errors and reason as text, with a suggestion if there is no solution."""
        if self.words is not None:
            return self.words
        return found((self.position_error, self.orientation_error), self.counted, self.iterations, self.restarts)

    def _view(self) -> View:
        table = Rows([f"q{number}" for number in range(1, len(self.q) + 1)], [self.q.tolist()])
        q = ", ".join(f"{value:.6g}" for value in self.q)
        return View(self.message, [table], (f"q = [{q}]",), title=f"{self.message} (rad or m)")

    @property
    def ok(self) -> bool:
        """Whether ``q`` is a solution."""
        return self.status is IkStatus.FOUND


STATUSES = tuple(IkStatus)
"""The statuses in the order of the codes in batches."""


@dataclass(frozen=True, eq=False)
class IkBatch(Shown):
    """The results for N targets, in the order of the targets; indexing returns an :class:`IkResult`.

    Parameters
    ----------
    q
        (N, n), as in :class:`IkResult`.
    codes
        (N,) the statuses as indices into ``IkStatus``; see :attr:`status`.
    position_error, orientation_error
        (N,) in m and rad.
    iterations, restarts
        (N,) integers.
    engine
        As in :class:`IkResult`.
    arm
        The arm, which provides the joint names of :attr:`messages`.
    words
        N messages; by default they are composed from the other fields.
    counted
        Whether the task selects any coordinates of the position, and of the orientation.
    """

    q: Array
    codes: npt.NDArray[np.int8]
    position_error: Array
    orientation_error: Array
    iterations: npt.NDArray[np.int64]
    restarts: npt.NDArray[np.int64]
    engine: str
    arm: Arm
    words: tuple[str, ...] | None = None
    counted: Counted = (True, True)

    def __post_init__(self) -> None:
        freeze_arrays(self, "q", "codes", "position_error", "orientation_error", "iterations", "restarts")

    def _view(self) -> View:
        counts = Counter(STATUSES[code].value for code in self.codes.tolist())
        found = ", ".join(f"{count:,} {status}" for status, count in counts.most_common())
        columns = ("target", "status", *self.arm.joint_names, "position error [m]", "orientation error [rad]")
        rows = (
            (k, STATUSES[code].value, *self.q[k].tolist(), self.position_error[k], self.orientation_error[k])
            for k, code in enumerate(self.codes.tolist())
        )
        head = f"{len(self.codes):,} targets{': ' if found else ''}{found}"
        return View(head, [Rows(columns, rows, len(self.codes))], title=f"IkBatch({head})")

    @classmethod
    def of(cls, results: Sequence[IkResult], arm: Arm, engine: str) -> IkBatch:
        """Combine single results (possibly none) for an arm."""
        return cls(
            q=np.array([result.q for result in results], dtype=float).reshape(len(results), arm.dof),
            codes=np.array([STATUSES.index(result.status) for result in results], dtype=np.int8),
            position_error=np.array([result.position_error for result in results], dtype=float),
            orientation_error=np.array([result.orientation_error for result in results], dtype=float),
            iterations=np.array([result.iterations for result in results], dtype=np.int64),
            restarts=np.array([result.restarts for result in results], dtype=np.int64),
            engine=engine,
            arm=arm,
            words=tuple(result.message for result in results),
        )

    @property
    def ok(self) -> npt.NDArray[np.bool_]:
        """(N,) which targets have a solution."""
        return np.asarray(self.codes == STATUSES.index(IkStatus.FOUND))

    @property
    def status(self) -> tuple[IkStatus, ...]:
        """N statuses."""
        return tuple(STATUSES[code] for code in self.codes.tolist())

    @property
    def messages(self) -> tuple[str, ...]:
        """N messages, as in :class:`IkResult`."""
        return tuple(result.message for result in self)

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, index: int) -> IkResult:
        return IkResult(
            STATUSES[int(self.codes[index])],
            self.q[index],
            float(self.position_error[index]),
            float(self.orientation_error[index]),
            int(self.iterations[index]),
            int(self.restarts[index]),
            self.engine,
            self._words(index),
            self.counted,
        )

    def __iter__(self) -> Iterator[IkResult]:
        return (self[index] for index in range(len(self)))

    def _words(self, index: int) -> str | None:
        if self.words is not None or STATUSES[int(self.codes[index])] is IkStatus.FOUND:
            return None if self.words is None else self.words[index]
        errors = float(self.position_error[index]), float(self.orientation_error[index])
        iterations, attempts = int(self.iterations[index]), int(self.restarts[index]) + 1
        return not_found(self.arm, self.counted, self.q[index], errors, iterations, attempts)


@dataclass(frozen=True, eq=False)
class IkSolutions(IkAnswer):
    """Several distinct solutions for one target: a sample, which is not known to be complete.

    Parameters
    ----------
    q
        (k, n) solutions within the limits, sorted by the largest joint difference to q0. Read-only.
    position_error, orientation_error
        (k,) in m and rad, by forward kinematics.
    attempts, iterations
        Number of attempts and steps of the search.
    engine
        As in :class:`IkResult`.
    message
        A summary as text.
    """

    q: Array
    position_error: Array
    orientation_error: Array
    attempts: int
    iterations: int
    engine: str
    message: str

    def __post_init__(self) -> None:
        freeze_arrays(self, "q", "position_error", "orientation_error")

    @property
    def ok(self) -> bool:
        """Whether there is a solution."""
        return len(self.q) > 0

    def __len__(self) -> int:
        return len(self.q)
