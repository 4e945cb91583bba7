"""The configurations of an arm for many poses at a time: every branch where there is a closed form, else a sample."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.errors import NoClosedForm
from pinproof.ik import AnalyticIk, Clik
from pinproof.model import Arm

__all__ = ["configurations", "has_closed_form", "manipulability"]

Array = npt.NDArray[np.float64]

SWEEP = AnalyticIk(redundant_steps=24)
"""Of an arm of seven: values of the redundant joint; every 15 degrees of a whole turn."""

SAMPLES, STARTS = 8, 64
"""Different configurations that are looked for where there is no closed form, and from how many starts."""


def has_closed_form(arm: Arm, most: int = 6) -> bool:
    """Whether every branch is told. Arms of seven are swept (``most=7``): that gives many, never all."""
    if arm.dof > most:
        return False
    try:
        AnalyticIk().solve_all_batch(arm, arm.forward_kinematics_batch(arm.home[None]))
    except NoClosedForm:
        return False
    return True


def configurations(arm: Arm, targets: Array, q0: Array, rng: int) -> tuple[npt.NDArray[np.int64], Array]:
    """Configurations inside the limits, each with the whole turns nearest to q0.

    Parameters
    ----------
    arm
        The arm.
    targets
        (N, 4, 4) ``base_from_tcp``.
    q0
        (n,) where to choose from.
    rng
        Seed of the search, where there is no closed form.

    Returns
    -------
    (k,) which target each is for, in order; and (k, n) the configurations.
    """
    if has_closed_form(arm, most=7):
        found = SWEEP.solve_all_batch(arm, targets, q0)
        row, column = np.nonzero(np.isfinite(found.q[:, :, 0]))
        return row, np.ascontiguousarray(found.q[row, column])
    many = [Clik().solve_many(arm, T, q0, rng=rng, count=SAMPLES, attempts=STARTS).q for T in targets]
    row = np.repeat(np.arange(len(many)), [len(q) for q in many])
    return row, np.concatenate([*many, np.empty((0, arm.dof))])


def manipulability(arm: Arm, Q: Array) -> Array:
    """(N,) Yoshikawa's measure at Q (N, n)."""
    from pinproof.kernels.manipulability import manipulability_many

    out = np.empty(len(Q))
    manipulability_many(arm.packed, np.ascontiguousarray(Q), out)
    return out
