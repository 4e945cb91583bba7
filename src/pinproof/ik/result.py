"""Results of inverse kinematics: status, configuration, errors, and message, and the choice of full rotations.

The errors of every result are computed by forward kinematics after the solver's loop, independently of it.

A revolute joint with a range of more than 2 pi (those of the UR5 have 4 pi) reaches the same pose at several angles
q + 2 pi k. Angles are not wrapped to (-pi, pi], which would discard valid solutions (the sixth joint of the Panda has
the range [-0.018, 3.752]). Among the angles within the limits, the one closest to a reference configuration is chosen.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof._core import JointRange
from pinproof.common.results import Answer, Rows, Shown, View
from pinproof.common.structs import described, key
from pinproof.common.validation import freeze_arrays
from pinproof.errors import IkFailed
from pinproof.ik.task import Task
from pinproof.model import AT_LIMIT, Arm
from pinproof.spatial import Array
from pinproof.units import far_hint

TURN = 2 * np.pi

FULL_ROTATION_GAP = 1e-3
"""Rad. A range shorter than 2 pi by at most this counts as 2 pi, because files write pi as 3.1416 or 3.14159."""


def wraps(arm: Arm) -> npt.NDArray[np.bool_]:
    """(n,) the joints with a range of at least 2 pi; beyond a limit, a descent continues 2 pi away at the same pose."""
    return np.asarray(arm.periodic & (arm.limits.upper - arm.limits.lower >= TURN - FULL_ROTATION_GAP))


def stops(arm: Arm) -> tuple[Array, Array]:
    """(n,) lower and upper limits at which a descent stops a joint; infinite for the joints of :func:`wraps`."""
    wrapping = wraps(arm)
    return np.where(wrapping, -np.inf, arm.limits.lower), np.where(wrapping, np.inf, arm.limits.upper)


def joint_ranges(arm: Arm) -> list[JointRange]:
    """The limits of the n joints for the compiled core."""
    limits = arm.limits
    ranges = zip(limits.lower, limits.upper, arm.periodic.tolist(), wraps(arm).tolist(), strict=True)
    return [JointRange(*each) for each in ranges]


def nearest_winding(arm: Arm, q: Array, reference: Array) -> Array:
    """The periodic joints of q (n,) or (N, n) shifted by multiples of 2 pi within the limits, closest to a reference.

    The reference (n,) may be outside the limits.
    """
    lower, upper = arm.limits.lower, arm.limits.upper
    elsewhere = (np.abs(reference - q) > np.pi) | (q < lower) | (q > upper)
    if not np.count_nonzero(elsewhere & arm.periodic):  # nothing to shift: the common case, and faster
        return q
    fewest, most = np.ceil((lower - AT_LIMIT - q) / TURN), np.floor((upper + AT_LIMIT - q) / TURN)
    turns = np.clip(np.round((reference - q) / TURN), fewest, most)
    # Only rounding is clipped here: a shifted angle may exceed a limit that is a multiple of 2 pi by one bit.
    return np.where(arm.periodic & (turns != 0), np.clip(q + turns * TURN, lower, upper), q)


def difference(arm: Arm, a: Array, b: Array) -> Array:
    """``a - b`` with periodic joints reduced to [-pi, pi]; broadcasts over (..., n)."""
    plain = a - b
    return np.where(arm.periodic, plain - TURN * np.round(plain / TURN), plain)


Errors = tuple[float, float]
Counted = tuple[bool, bool]
"""Whether a task selects any coordinates of the position, and of the orientation."""

NEAR_LIMIT = 1e-6
"""A joint within this distance of a limit (rad or m) is reported as being at the limit."""

SMALL_RESIDUAL = (1e-2, 1e-1)
"""Residuals (m, rad) below which a failed search may have ended close to a solution; farther away, the target is
probably out of reach."""


class IkAnswer(Answer):
    """The part that the results of inverse kinematics share."""

    failure = IkFailed


def refused(refusals: int, attempts: int) -> str:
    """The message if ``accept`` rejected every solution."""
    return (
        f"rejected: accept returned False for all {plural(refusals, 'solution')} of {plural(attempts, 'attempt')}; "
        "check why it rejects q (for example a collision), increase restarts, or move the target"
    )


def not_found(
    arm: Arm, counts: Counted, q: npt.NDArray[np.float64], errors: Errors, iterations: int, attempts: int
) -> str:
    """The message if no attempt reached the target; q (n,) is the configuration with the smallest residual."""
    # joints that a limit stops are often the reason
    lower, upper = arm.limits.lower, arm.limits.upper
    limits = "".join(
        f"; joint {name} is at its {'lower' if value - low <= NEAR_LIMIT else 'upper'} limit"
        for name, value, low, high in zip(arm.joint_names, q, lower, upper, strict=True)
        if min(value - low, high - value) <= NEAR_LIMIT
    )
    # What to change depends on the task, and on whether the search ended close to the target.
    residual = [error if selected else 0.0 for error, selected in zip(errors, counts, strict=True)]
    frame = f"check the tcp frame ({arm.tcp} in {arm.base})"
    if all(error < limit for error, limit in zip(residual, SMALL_RESIDUAL, strict=True)):
        remedy = "The residual is small: try another seed, more restarts or larger tolerances"
    elif all(counts):
        remedy = f"move the target or the base, {frame}, or leave the orientation free (task position)"
        remedy = f"The target is probably out of reach: {remedy}"
    else:
        remedy = f"{'move the target or the base' if counts[0] else 'rotate the target'}, or {frame}"
        remedy = f"The target is probably out of reach: {remedy}"
    return (
        f"not reached: residual {_errors(errors, counts)} after {plural(attempts, 'attempt')} "
        f"({plural(iterations, 'step')}){limits}. {remedy}{far_hint(residual[0], arm.robot.size)}"
    )


def _errors(errors: Errors, counts: Counted) -> str:
    """Distance and angle, those of them that count; the distance in m from 1 m and in mm below."""
    distance = f"{errors[0]:.3g} m" if errors[0] >= 1.0 else f"{1000.0 * errors[0]:.3g} mm"
    texts = (distance, f"{errors[1]:.3g} rad")
    return ", ".join(text for text, selected in zip(texts, counts, strict=True) if selected)


def plural(number: int, noun: str) -> str:
    """A number with its noun in the singular or plural."""
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


@described(eq=False)
class IkResult(IkAnswer):
    """The result of inverse kinematics for one target."""

    status: IkStatus = key("the outcome; :attr:`ok` is True if it is FOUND")
    q: Array = key(
        "(n,) a configuration within the limits; a solution if :attr:`ok`, else see :class:`~pinproof.ik.IkStatus`. "
        "Read-only"
    )
    position_error: float = key("distance in m from the tcp to the target at ``q``, by forward kinematics")
    orientation_error: float = key(
        "angle in rad between the orientations of tcp and target. Both errors count only the coordinates that the "
        "task selects; if a task selects no position or no orientation, the complete error is reported"
    )
    iterations: int = key("steps over all attempts")
    restarts: int = key("attempts after the first")
    engine: str = key('``"compiled"``, ``"pinocchio"`` or ``"analytic"``')
    words: str | None = key("the message; by default it is composed from the other fields of a solution", default=None)
    counted: Counted = key(
        "whether the task selects any coordinates of the position, and of the orientation", default=(True, True)
    )

    def __post_init__(self) -> None:
        if self.q.flags.writeable:
            freeze_arrays(self, "q")

    @property
    def message(self) -> str:
        """Status, errors and reason as text, with a suggestion if there is no solution."""
        if self.words is not None:
            return self.words
        errors = _errors((self.position_error, self.orientation_error), self.counted)
        return f"found: error {errors} after {plural(self.iterations, 'step')} and {plural(self.restarts, 'restart')}"

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


@described(eq=False)
class IkBatch(Shown):
    """The results for N targets, in the order of the targets; indexing returns an :class:`IkResult`."""

    q: Array = key("(N, n), as in :class:`IkResult`")
    codes: npt.NDArray[np.int8] = key("(N,) the statuses as indices into ``IkStatus``; see :attr:`status`")
    position_error: Array = key("(N,) as in :class:`IkResult`", "m")
    orientation_error: Array = key("(N,) as in :class:`IkResult`", "rad")
    iterations: npt.NDArray[np.int64] = key("(N,) steps over all attempts")
    restarts: npt.NDArray[np.int64] = key("(N,) attempts after the first")
    engine: str = key("as in :class:`IkResult`")
    arm: Arm = key("the arm, which provides the joint names of :attr:`messages`")
    words: tuple[str | None, ...] | None = key(
        "N messages; those that are None, and by default all, are composed from the other fields", default=None
    )
    counted: Counted = key(
        "whether the task selects any coordinates of the position, and of the orientation", default=(True, True)
    )

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

        def column(name: str, dtype: type) -> npt.NDArray[Any]:
            return np.array([getattr(result, name) for result in results], dtype=dtype)

        return cls(
            np.array([result.q for result in results], dtype=float).reshape(len(results), arm.dof),
            np.array([STATUSES.index(result.status) for result in results], dtype=np.int8),
            column("position_error", float),
            column("orientation_error", float),
            column("iterations", np.int64),
            column("restarts", np.int64),
            engine,
            arm,
            tuple(result.message for result in results),
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
        status, q = STATUSES[int(self.codes[index])], self.q[index]
        errors = float(self.position_error[index]), float(self.orientation_error[index])
        iterations, restarts = int(self.iterations[index]), int(self.restarts[index])
        words = None if self.words is None else self.words[index]
        if words is None and status is not IkStatus.FOUND:
            words = not_found(self.arm, self.counted, q, errors, iterations, restarts + 1)
        return IkResult(status, q, *errors, iterations, restarts, self.engine, words, self.counted)

    def __iter__(self) -> Iterator[IkResult]:
        return (self[index] for index in range(len(self)))


@described(eq=False)
class IkSolutions(IkAnswer):
    """Several distinct solutions for one target: a sample, which is not known to be complete."""

    q: Array = key("(k, n) solutions within the limits, sorted by the largest joint difference to q0. Read-only")
    position_error: Array = key("(k,) by forward kinematics", "m")
    orientation_error: Array = key("(k,) by forward kinematics", "rad")
    attempts: int = key("number of attempts of the search")
    iterations: int = key("number of its steps")
    engine: str = key("as in :class:`IkResult`")
    message: str = key("a summary as text")

    def __post_init__(self) -> None:
        freeze_arrays(self, "q", "position_error", "orientation_error")

    @property
    def ok(self) -> bool:
        """Whether there is a solution."""
        return len(self.q) > 0

    def __len__(self) -> int:
        return len(self.q)
