"""Evidence for each pair in each interval, in the form that the verifier can check."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision.certificate import Certificate
from pinproof.collision.checker import CollisionChecker
from pinproof.errors import NotProvenFree
from pinproof.verifier import IntervalBounds, Proof

__all__ = ["settle"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

DIGITS = 6
"""Decimals of a direction: a body of 1 m seems nearer by 1e-6 m at most, and what that unsettles is cut further."""

CONFIRMED = 1e-6
"""Metres by which the verifier may show less clearance than the certificate has."""

ROUNDS = 60
"""Of cutting intervals in two: then no two numbers are left between their ends."""


def settle(proof: Proof, certificate: Certificate, checker: CollisionChecker) -> tuple[list[Any], list[Any]]:
    """The intervals (T, 2) as a list, and a row for each pair: its bodies, which intervals, along which directions.

    Raises
    ------
    NotProvenFree
        If an interval cannot be settled by the verifier's bounds.
    """
    pair, spans, u = _leaves(certificate, checker, (proof.curve.low, proof.curve.high))
    need = np.array([proof.required(i, j) for i, j in checker.pairs])
    moved = np.array([proof.tolerance_of(j) for _, j in checker.pairs])
    need = np.maximum(need, certificate.clearance - CONFIRMED + moved)
    done: list[tuple[Indices, Array, Array]] = []
    fresh = np.zeros(len(pair), dtype=bool)  # whether the direction was found for this very interval
    for _ in range(ROUNDS):
        if not len(pair):
            break
        table, at = np.unique(spans, axis=0, return_inverse=True)
        at = at.reshape(-1)
        bounds_of_table = IntervalBounds(proof, table)
        unknown = ~u.any(axis=1)
        u[unknown] = _directions(checker, pair[unknown], bounds_of_table.q[at[unknown]])
        fresh |= unknown
        good = _bounds(checker, bounds_of_table, pair, at, u) > need[pair]
        done.append((pair[good], spans[good], u[good]))
        pair, spans, u, fresh = pair[~good], spans[~good], u[~good], fresh[~good]
        # What its own direction does not settle is cut in two; the others are given their own first.
        middle = spans[fresh].mean(axis=1)
        halves = [np.column_stack([spans[fresh, 0], middle]), np.column_stack([middle, spans[fresh, 1]])]
        spans = np.concatenate([spans[~fresh], *halves])
        pair = np.concatenate([pair[~fresh], pair[fresh], pair[fresh]])
        u, fresh = np.zeros((len(pair), 3)), np.zeros(len(pair), dtype=bool)
    if len(pair):
        a, b = (checker.bodies[i].name for i in checker.pairs[int(pair[0])])
        raise NotProvenFree(
            f"the verifier cannot confirm that {a} and {b} stay apart at {spans[0, 0]:.6g}", certificate
        )
    return _told(checker, done)


def _leaves(
    certificate: Certificate, checker: CollisionChecker, domain: tuple[float, float]
) -> tuple[Indices, Array, Array]:
    """The last word on each pair: pairs (K,), intervals (K, 2) and directions (K, 3), zeros where none is known.

    An interval that was cut in two for the sake of its pair is left out: its halves were settled too.
    """
    rows = np.empty((0, 7)) if certificate.evidence is None else np.asarray(certificate.evidence)
    rows = rows[np.lexsort([-rows[:, 1], rows[:, 0], rows[:, 2]])]
    holds_next = np.zeros(len(rows), dtype=bool)
    holds_next[:-1] = (rows[:-1, 2] == rows[1:, 2]) & (rows[1:, 1] <= rows[:-1, 1])
    rows = rows[~holds_next]
    still = checker.still_pairs
    return (
        np.concatenate([rows[:, 2].astype(np.int64), still]),
        np.concatenate([rows[:, :2], np.tile(domain, (len(still), 1))]),
        np.concatenate([np.round(rows[:, 4:], DIGITS), np.zeros((len(still), 3))]),
    )


def _directions(checker: CollisionChecker, pairs: Indices, q: Array) -> Array:
    """(K, 3) along which pairs (K,) are apart at configurations (K, n)."""
    found = np.empty((len(pairs), 3))
    for row, (pair, configuration) in enumerate(zip(pairs.tolist(), q, strict=True)):
        found[row] = checker.placed(configuration).measure(pair).normal
    return np.round(found, DIGITS)


def _bounds(checker: CollisionChecker, bounds_of_table: IntervalBounds, pairs: Indices, at: Indices, u: Array) -> Array:
    found = np.empty(len(pairs))
    unit = u / np.linalg.norm(u, axis=1, keepdims=True)
    order = np.argsort(pairs, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(pairs[order])) + 1):
        i, j = checker.pairs[int(pairs[rows[0]])]
        found[rows] = bounds_of_table.distance(i, j, at[rows], unit[rows])
    return found


def _told(checker: CollisionChecker, done: list[tuple[Indices, Array, Array]]) -> tuple[list[Any], list[Any]]:
    if not done:
        return [], []
    pair, spans, u = (np.concatenate(parts) for parts in zip(*done, strict=True))
    table, at = np.unique(spans, axis=0, return_inverse=True)
    order = np.lexsort([spans[:, 0], pair])
    groups = np.split(order, np.searchsorted(pair[order], np.arange(1, len(checker.pairs))))
    rows = [
        {"bodies": list(bodies), "intervals": at.reshape(-1)[mine].tolist(), "directions": u[mine].tolist()}
        for bodies, mine in zip(checker.pairs, groups, strict=True)
    ]
    return table.tolist(), rows
