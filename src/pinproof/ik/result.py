"""Answers in words; a "no" names what stood in the way and what to do.

The judge of every answer: errors measured by forward kinematics, apart from the loop that claims to have arrived.

What a solver answers: a status, the configuration, and errors measured on it by forward kinematics.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from pinproof.errors import IkFailed
from pinproof.ik.task import Task
from pinproof.ik.windings import nearest_winding
from pinproof.model import Arm

__all__ = [
    "Candidate",
    "IkBatch",
    "IkResult",
    "IkSolutions",
    "IkStatus",
    "found",
    "judge",
    "judge_many",
    "not_found",
    "refused",
    "sampled",
]

Errors = tuple[float, float]

AT_LIMIT = 1e-6
"""A joint this near a limit (rad or m) is named as standing at it."""


def found(errors: Errors, iterations: int, attempt: int) -> str:
    """A solution."""
    return f"found in {_count(iterations, 'step')} and {_count(attempt, 'restart')}, {_off(errors)}"


def not_found(arm: Arm, q: npt.NDArray[np.float64], errors: Errors, iterations: int, attempts: int) -> str:
    """Nothing within the budget; q is the nearest miss."""
    lower, upper = arm.limits.lower, arm.limits.upper
    at_limit = [
        name
        for name, value, low, high in zip(arm.joint_names, q, lower, upper, strict=True)
        if min(value - low, high - value) <= AT_LIMIT
    ]
    limits = f" with {', '.join(at_limit)} at the limit" if at_limit else ""
    return (
        f"not found in {_count(attempts, 'attempt')} ({_count(iterations, 'step')}); "
        f"the nearest is {_off(errors)}{limits}. "
        "A miss this size at every restart means out of reach: move the target or the base, check the tcp "
        f"({arm.tcp}, in {arm.base}), or ask for task='position'; a small miss: raise restarts or the tolerances"
    )


def refused(refusals: int, attempts: int) -> str:
    """Solutions, but accept took none."""
    return (
        f"reached {_count(refusals, 'time')} in {_count(attempts, 'attempt')}, but accept refused each solution; "
        "see what it objects to at q (a collision?), raise restarts, or move the target"
    )


def sampled(solutions: int, attempts: int, refusals: int) -> str:
    """A sample of solutions."""
    taken = f", {_count(refusals, 'solution')} refused by accept" if refusals else ""
    remedy = "" if solutions else "; raise attempts, or ask solve() how far the nearest miss is"
    return (
        f"{_count(solutions, 'different solution')} from {_count(attempts, 'attempt')}{taken}: a sample, "
        f"there may be others{remedy}"
    )


def _off(errors: Errors) -> str:
    return f"{errors[0]:.3g} m and {errors[1]:.3g} rad off"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A configuration (n,) with its errors in m and rad, and whether it fulfils the task inside the limits."""

    q: Array
    errors: tuple[float, float]
    fulfils: bool


def judge(arm: Arm, target: Array, task: Task, q: Array, reference: Array) -> Candidate:
    """What q (n,) is worth for the target (4, 4), with the whole turns nearest to ``reference`` (n,), by Pinocchio."""
    q = nearest_winding(arm, q, reference)
    base_from_tcp, _ = arm.local_jacobian(q)  # q is ours: the way that does not check it again
    errors = _measured(target[None], base_from_tcp.homogeneous[None], task)
    fulfils = bool(task.fulfilled(errors)[0]) and arm.limits.contains(q)
    return Candidate(q, (float(errors[0, 0]), float(errors[0, 1])), fulfils)


def judge_many(
    arm: Arm, targets: Array, task: Task, Q: Array, references: Array
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """The same for targets (N, 4, 4) by the compiled chain: Q, errors (N, 2), and which fulfil the task."""
    from pinproof.kernels.chain import forward_many

    Q = np.ascontiguousarray(nearest_winding(arm, Q, references))
    poses = np.empty((len(Q), 4, 4))
    forward_many(arm.packed, Q, poses)
    errors = _measured(targets, poses, task)
    inside = ((arm.limits.lower <= Q) & (arm.limits.upper >= Q)).all(axis=1)
    return Q, errors, task.fulfilled(errors) & inside


def _measured(targets: Array, poses: Array, task: Task) -> Array:
    from pinproof.kernels.task import measure_many

    errors = np.empty((len(targets), 2))
    measure_many(np.ascontiguousarray(targets), np.ascontiguousarray(poses), task.asked, errors)
    return errors


class IkStatus(Enum):
    """The kinds of answer."""

    FOUND = "found"
    """``q`` fulfils the task within the tolerances and the limits, and ``accept`` took it."""
    NOT_FOUND = "not found"
    """The budget of attempts ran out; ``q`` is the nearest that was seen, with its errors."""
    REFUSED = "refused"
    """Configurations that fulfil the task were found, and ``accept`` refused each; ``q`` is the first of them."""
    IMPOSSIBLE = "impossible"
    """No configuration inside the limits reaches the target: a closed form has enumerated all. Iterative methods never
    say so, since they cannot prove it."""


@dataclass(frozen=True, eq=False)
class IkResult:
    """The answer for one target.

    Parameters
    ----------
    status
        The kind of answer; :attr:`ok` is whether it is FOUND.
    q
        (n,) inside the limits; a solution if :attr:`ok`, else as the status says. Read-only.
    position_error
        Distance in m from the tcp to the target at ``q``, by forward kinematics.
    orientation_error
        Angle in rad of the rotation that is left between them. (Of the
        coordinates that the task asks for; a task that asks for only one of the two reports the other whole.)
    iterations
        Steps taken, over all attempts.
    restarts
        Attempts after the first.
    engine
        What computed the answer: ``"compiled"`` loops, or ``"pinocchio"``.
    message
        The answer in words; a "no" comes with what to do.
    """

    status: IkStatus
    q: Array
    position_error: float
    orientation_error: float
    iterations: int
    restarts: int
    engine: str
    message: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "q", _frozen(self.q))

    @property
    def ok(self) -> bool:
        """Whether ``q`` is a solution."""
        return self.status is IkStatus.FOUND

    def or_raise(self) -> IkResult:
        """The result itself if it is a solution.

        Raises
        ------
        IkFailed
            If it is none, with the message; ``.result`` of the error is this value.
        """
        if not self.ok:
            raise IkFailed(self.message, self)
        return self


STATUSES = tuple(IkStatus)
"""The order in which batches number the statuses."""


@dataclass(frozen=True, eq=False)
class IkBatch:
    """The answers for N targets, in their order; indexing gives :class:`IkResult`.

    Parameters
    ----------
    q
        (N, n), as in :class:`IkResult`.
    codes
        (N,) the statuses, as places in ``IkStatus``; :attr:`status` are they themselves.
    position_error, orientation_error
        (N,) in m and rad.
    iterations, restarts
        (N,) whole numbers.
    engine
        What computed the kinematics.
    arm
        Whose answers these are; it names the joints in :attr:`messages`.
    words
        N messages where they are not just what the numbers say.
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

    def __post_init__(self) -> None:
        for name in ("q", "codes", "position_error", "orientation_error", "iterations", "restarts"):
            object.__setattr__(self, name, _frozen(getattr(self, name)))

    @classmethod
    def of(cls, results: Sequence[IkResult], arm: Arm, engine: str) -> IkBatch:
        """The batch of single results for an arm; there may be none."""
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
        """N answers in words."""
        return tuple(self._message(index) for index in range(len(self)))

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
            self._message(index),
        )

    def __iter__(self) -> Iterator[IkResult]:
        return (self[index] for index in range(len(self)))

    def _message(self, index: int) -> str:
        if self.words is not None:
            return self.words[index]
        errors = float(self.position_error[index]), float(self.orientation_error[index])
        iterations, restarts = int(self.iterations[index]), int(self.restarts[index])
        if STATUSES[int(self.codes[index])] is IkStatus.FOUND:
            return found(errors, iterations, restarts)
        return not_found(self.arm, self.q[index], errors, iterations, restarts + 1)


@dataclass(frozen=True, eq=False)
class IkSolutions:
    """Several different solutions for one target: a sample, never known to be all of them.

    Parameters
    ----------
    q
        (k, n) solutions inside the limits, the one nearest to q0 (largest joint difference) first. Read-only.
    position_error, orientation_error
        (k,) in m and rad, by forward kinematics.
    attempts, iterations
        What the search cost.
    engine
        What computed the kinematics.
    message
        The answer in words.
    """

    q: Array
    position_error: Array
    orientation_error: Array
    attempts: int
    iterations: int
    engine: str
    message: str

    def __post_init__(self) -> None:
        for name in ("q", "position_error", "orientation_error"):
            object.__setattr__(self, name, _frozen(getattr(self, name)))

    @property
    def ok(self) -> bool:
        """Whether there is a solution."""
        return len(self.q) > 0

    def __len__(self) -> int:
        return len(self.q)

    def or_raise(self) -> IkSolutions:
        """The result itself if it holds a solution.

        Raises
        ------
        IkFailed
            If it holds none; ``.result`` of the error is this value.
        """
        if not self.ok:
            raise IkFailed(self.message, self)
        return self


def _frozen(array: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    copy = np.array(array)
    copy.setflags(write=False)
    return copy
