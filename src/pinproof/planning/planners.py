"""What a planner is, and how the command line and the picks name one: any object with these methods is a planner."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, PathConstraint
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import TorqueLimits
from pinproof.planning.result import PlanResult
from pinproof.planning.rrt_connect import RrtConnect

DEFAULT_PLANNER = "rrt_connect"


class Planner(Protocol):
    """What every planner provides."""

    def plan(
        self,
        checker: CollisionChecker,
        start: npt.ArrayLike,
        goals: npt.ArrayLike,
        *,
        turns: bool = False,
        constraints: Sequence[PathConstraint] = (),
        torque_limits: TorqueLimits | None = None,
        rng: int | np.random.Generator = 0,
    ) -> PlanResult:
        """Plan from ``start`` (n,) to any of ``goals`` (g, n), as :meth:`RrtConnect.plan` does.

        A planner that does not support constraints raises InputError if there are any. One that supports them has the
        attribute ``supports_constraints = True``.
        """
        ...

    def limited_to(self, nodes: int) -> Planner:
        """Return the planner with a budget of work instead of time, so that its result does not depend on the clock."""
        ...


def make_planner(name: str = DEFAULT_PLANNER, **settings: Any) -> Planner:
    """Return the planner ``"rrt_connect"``, or a planner of another package, named ``"module:Class"``.

    It has its default settings except for those given.

    Raises
    ------
    UnknownNameError
        If there is no planner with this name, or its module cannot be imported.
    InputError
        If a setting is invalid, or the class has not the methods of :class:`Planner`.
    """
    if name == DEFAULT_PLANNER:
        return RrtConnect(**settings)
    module, _, attribute = name.partition(":")
    try:
        planner = getattr(import_module(module), attribute)(**settings) if module and attribute else None
    except (ImportError, AttributeError) as error:
        raise UnknownNameError("planner", name, (DEFAULT_PLANNER, "MODULE:CLASS"), str(error)) from error
    if planner is None:
        raise UnknownNameError("planner", name, (DEFAULT_PLANNER, "MODULE:CLASS"))
    return planner_of(planner)


def planner_of(given: object | None) -> Planner:
    """Return the given planner, or the default one for None; refuse anything without the methods of a planner."""
    if given is None:
        return RrtConnect()
    if missing := [name for name in ("plan", "limited_to") if not callable(getattr(given, name, None))]:
        raise InputError(f"planner must have the methods plan and limited_to; {given!r:.80} lacks {missing[0]}")
    return cast(Planner, given)
