"""Answers in words; a "no" names what stood in the way and what to do."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm

__all__ = ["found", "not_found", "refused", "sampled"]

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
