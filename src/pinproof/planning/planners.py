"""The planners by name. The command line, the planning benchmark and the picks select planners from this table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, PathConstraint
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import TorqueLimits
from pinproof.planning.ompl_adapter import OmplPlanner
from pinproof.planning.result import PlanResult
from pinproof.planning.rrt_connect import RrtConnect


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

        A planner that does not support constraints raises InputError if there are any.
        """
        ...

    def limited_to(self, nodes: int) -> Planner:
        """Return the planner with a budget of work instead of time, so that its result does not depend on the clock."""
        ...


PLANNERS: dict[str, Callable[..., Planner]] = {"rrt_connect": RrtConnect, "ompl": OmplPlanner}
"""Planner classes by name; each can be created without arguments and accepts ``time_limit`` in seconds."""

DEFAULT_PLANNER = "rrt_connect"

CONSTRAINED_PLANNERS = ("rrt_connect",)
"""The planners that support constraints of the tcp."""


def make_planner(name: str = DEFAULT_PLANNER, **settings: Any) -> Planner:
    """Return a planner of :data:`PLANNERS`, with its default settings except for those given.

    Raises
    ------
    UnknownNameError
        If there is no planner with this name.
    InputError
        If a setting is invalid, or the library of the planner is not installed.
    """
    if name not in PLANNERS:
        raise UnknownNameError("planner", name, PLANNERS)
    return PLANNERS[name](**settings)


def planner_of(given: Planner | None) -> Planner:
    """Return the given planner, or the default one for None; refuse anything else, such as the name of a planner."""
    if given is not None and not callable(getattr(given, "plan", None)):
        raise InputError(
            f"planner must be make_planner(NAME), with NAME one of {', '.join(PLANNERS)}, not {given!r:.80}"
        )
    return make_planner() if given is None else given
