"""Limits that depend on the configuration, such as torques and tool speeds, for time parametrisation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from pinproof.errors import InputError, TimingError
from pinproof.motion.limit_check import LIMIT_TOLERANCE
from pinproof.motion.trajectory import Trajectory
from pinproof.spatial import Array


@runtime_checkable
class RateConstraint(Protocol):
    """A limit of :func:`~pinproof.motion.time_parametrise` on a motion q(s(t)) along a path q(s).

    The timing uses :meth:`coefficients` to find the fastest motion. They are evaluated at nodes of the path, and their
    accuracy affects the duration only. The result is verified with :meth:`excess`, which decides what is returned.
    """

    @property
    def name(self) -> str:
        """The name for messages, such as ``"torque"``."""

    def coefficients(self, q: Array, slope: Array, curvature: Array) -> tuple[Array, Array, Array, Array]:
        """The limit at points of the path: ``|alpha * s'' + beta * s'^2 + gamma| <= bound``.

        Parameters
        ----------
        q, slope, curvature
            (N, n) configurations, and the first and the second derivative of the path with respect to s.

        Returns
        -------
        ``alpha``, ``beta``, ``gamma`` and ``bound``, (N, m) each, for m scalar limits. ``alpha = 0`` and ``gamma = 0``
        limit the speed s' to ``sqrt(bound / |beta|)``. ``bound`` is not negative. The limit must permit a standstill,
        ``|gamma| <= bound``; otherwise :func:`~pinproof.motion.time_parametrise` raises
        :class:`~pinproof.errors.TimingError`.
        """

    def excess(self, trajectory: Trajectory) -> Array:
        """(k,) for each piece, a proven upper bound of the factor by which its duration must be multiplied.

        The bound covers the whole piece, not only samples. It is 1 or less if the piece satisfies the limit. For
        limits without ``gamma`` on speed it is speed / limit, on acceleration sqrt(acceleration / limit).
        """


def checked_constraints(constraints: Sequence[RateConstraint]) -> tuple[RateConstraint, ...]:
    """The constraints as a tuple; InputError if one is not a :class:`RateConstraint`."""
    if not isinstance(constraints, list | tuple) and isinstance(constraints, RateConstraint):
        raise InputError("rate_limits must be a sequence, such as a list with this one limit")
    for constraint in constraints:
        if not isinstance(constraint, RateConstraint):
            raise InputError(
                f"rate_limits must hold objects with name, coefficients and excess, not a {type(constraint).__name__}"
            )
    return tuple(constraints)


def constraint_rows(
    constraints: Sequence[RateConstraint], q: Array, slope: Array, curvature: Array
) -> tuple[Array, Array, Array, Array]:
    """``alpha``, ``beta``, ``gamma`` and ``bound`` (N, m) of all constraints at points (N, n) of a path.

    Raises
    ------
    InputError
        If a constraint returns arrays with wrong shapes or numbers that are not finite.
    TimingError
        If a constraint is violated at standstill; the message names the constraint and the configuration.
    """
    parts: list[list[Array]] = [[np.zeros((len(q), 0))] for _ in range(4)]
    for constraint in constraints:
        rows = [np.asarray(values, dtype=float) for values in constraint.coefficients(q, slope, curvature)]
        if len(rows) != 4 or any(row.ndim != 2 or row.shape != (len(q), rows[0].shape[1]) for row in rows):
            raise InputError(f"the coefficients of {constraint.name!r} must be four arrays of the same shape (N, m)")
        if not all(np.isfinite(row).all() for row in rows):
            raise InputError(f"the coefficients of {constraint.name!r} hold a number that is not finite")
        over = np.abs(rows[2]) - rows[3]
        if over.max(initial=-np.inf) > 0.0:
            i, k = np.unravel_index(over.argmax(), over.shape)
            raise TimingError(
                f"the constraint {constraint.name!r} is violated at standstill at q = {np.round(q[i], 4).tolist()}: "
                f"component {k} is {rows[2][i, k]:.6g}, the limit is {rows[3][i, k]:.6g}; no timing can satisfy it"
            )
        for part, row in zip(parts, rows, strict=True):
            part.append(row)
    alpha, beta, gamma, bound = (np.concatenate(part, axis=1) for part in parts)
    return alpha, beta, gamma, bound


def rate_violations(constraints: Sequence[RateConstraint], trajectory: Trajectory) -> list[str]:
    """A sentence for each limit that a motion exceeds by more than rounding, between samples too."""
    sentences: list[str] = []
    for constraint in constraints:
        try:
            if float(constraint.excess(trajectory).max()) > 1.0 + LIMIT_TOLERANCE:
                describe = getattr(constraint, "exceeded", None)
                sentences += [f"{constraint.name} is exceeded"] if describe is None else describe(trajectory)
        except TimingError as error:  # no timing satisfies the limit
            sentences.append(str(error))
    return sentences
