"""The judge of every answer, ours and others': dense samples, the links' own meshes, coal; no proof has a say here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.plan_problem import PlanProblem
from pinproof.collision import CollisionChecker
from pinproof.collision.audit import STEP, audit
from pinproof.motion import Curve

__all__ = ["Judged", "curve_length", "judge"]

Array = npt.NDArray[np.float64]

CLOSE = 1e-6
"""Rad or m: how far a motion may end from where it was asked to, and be outside a limit, by rounding."""

PIECE = 64
"""Chords in which a curved piece is measured: too short by less than 1 in 5,000 of one that turns a right angle."""


@dataclass(frozen=True, eq=False)
class Judged:
    """What a motion is worth.

    Parameters
    ----------
    faults
        What is wrong with it, in sentences; empty if it is safe. A contact names the bodies and where.
    samples
        How many of its configurations were looked at.
    length
        Euclidean, in joint space: rad and m count alike.
    """

    faults: tuple[str, ...]
    samples: int
    length: float


def judge(curve: Curve, problem: PlanProblem, exact: CollisionChecker, *, step: float = STEP) -> Judged:
    """Judge a motion; ``exact`` has the links' own meshes, and no joint moves farther than ``step`` between samples."""
    first, last = curve.domain
    faults = []
    if np.abs(curve(first) - problem.start).max() > CLOSE:
        faults.append("does not begin at the start")
    if np.abs(curve(last) - problem.goals).max(axis=1).min() > CLOSE:
        faults.append("does not end at a goal")
    limits = problem.arm.limits
    sampled = np.concatenate(_pieces(curve))
    beyond = np.maximum(limits.lower - sampled, sampled - limits.upper).max(axis=0)
    faults += [
        f"{name} is {far:.2g} outside its limits"
        for name, far in zip(problem.arm.joint_names, beyond, strict=True)
        if far > CLOSE
    ]
    seen = audit(curve, exact, step=step, measure=False)
    faults += [
        f"{a} touches {b} at {(t - first) / (last - first or 1.0):.3f} of the way" for t, (a, b) in seen.contacts
    ]
    return Judged(tuple(faults), seen.samples, curve_length(curve))


def curve_length(curve: Curve) -> float:
    """The Euclidean length in joint space, exact for straight pieces."""
    return float(sum(np.linalg.norm(np.diff(piece, axis=0), axis=1).sum() for piece in _pieces(curve)))


def _pieces(curve: Curve) -> list[Array]:
    """Samples of each piece; the ends of a straight one."""
    knots, control = curve.bezier()
    straight = control.shape[1] == 2
    return [
        np.asarray(points if straight else curve(np.linspace(a, b, PIECE + 1)))
        for a, b, points in zip(knots[:-1], knots[1:], control, strict=True)
    ]
