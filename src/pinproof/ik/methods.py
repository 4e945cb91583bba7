"""The IK methods by name, from which the command line selects."""

from __future__ import annotations

from pinproof.errors import UnknownNameError
from pinproof.ik.analytic.analytic_ik import AnalyticIk
from pinproof.ik.fabrik import Fabrik
from pinproof.ik.iterative import IterativeIk
from pinproof.ik.jacobian_methods import Clik, DampedLeastSquares, PseudoInverse

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
