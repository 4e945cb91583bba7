"""RRT-Connect between a start and a set of goals, whose answer is always certified.

Two trees grow towards each other; samples steer the search. When they meet, the whole way is proven; an edge that fails
is cut out of its tree with all that hangs on it, and the search goes on (:mod:`pinproof.planning.search`).

Source: J. Kuffner, S. LaValle (2000), "RRT-Connect: an efficient approach to single-query path planning", ICRA.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.errors import InputError
from pinproof.planning.ends import read_ends
from pinproof.planning.portfolio import best_of
from pinproof.planning.result import PlanResult, Progress
from pinproof.planning.search import Search

__all__ = ["RrtConnect"]


@dataclass(frozen=True, kw_only=True)
class RrtConnect:
    """The planner.

    Parameters
    ----------
    step
        Longest edge (Euclidean, in rad or m).
    resolution
        Metres that bodies move between two samples that steer the search; the proof does not depend on it.
    max_nodes
        Configurations in both trees after which the search ends.
    max_samples
        Random samples after which the search ends: trees that are walled in gain no nodes. A TIAGo's 8 joints in narrow
        shelves took 900 in the median and up to 45,000 in 400 searches, which is why the default is far above that.
    time_limit
        Seconds after which the search ends. Answers that were found before do not depend on it, and it never decides
        where one of the other two budgets ends the search first.

    Raises
    ------
    InputError
        If a setting is not above 0.
    """

    step: float = 0.7
    resolution: float = 0.08
    max_nodes: int = 20_000
    max_samples: int = 200_000
    time_limit: float = 20.0

    def __post_init__(self) -> None:
        for name in ("step", "resolution", "max_nodes", "max_samples", "time_limit"):
            if not getattr(self, name) > 0:
                raise InputError(f"RrtConnect.{name} = {getattr(self, name)}; it must be above 0")

    def plan(
        self,
        checker: CollisionChecker,
        start: npt.ArrayLike,
        goals: npt.ArrayLike,
        *,
        turns: bool = False,
        rng: int | np.random.Generator = 0,
        progress: Progress | None = None,
        portfolio: int = 1,
        executor: Executor | None = None,
    ) -> PlanResult:
        """Plan from ``start`` (n,) to one goal (n,) or to any of several (g, n).

        The same ``rng`` gives the same path. A failure is a result: it says what touches, or which budget ran out and
        how near the search came.

        Parameters
        ----------
        checker
            What the path must be free of. Where the start, or every goal, touches by coarse bodies alone, those pairs
            are judged more finely; ``PlanResult.checker`` is the checker the path is proven with.
        start, goals
            The ends, inside the arm's limits.
        turns
            Take a goal also where joints stand whole turns away from it, inside the limits: the same pose of every
            link, and often the only one that can be reached. The path then ends there; ``goal`` is the index it equals.
        rng
            Seed or Generator of the samples.
        progress
            Called many times a second with a :class:`PlanProgress`; where it returns False, the plan is CANCELLED.
        portfolio
            How many searches there are, each with samples of its own; the shortest of their paths is the answer.
        executor
            Where the searches of a portfolio run; without one, one after the other here. The answer is the same.

        Raises
        ------
        InputError
            If a shape is wrong, a number is not finite or there is no search in the portfolio.
        """
        if portfolio < 1:
            raise InputError(f"portfolio = {portfolio}; it is the number of searches, at least 1")
        ends = read_ends(checker, start, goals, turns=turns)
        if isinstance(ends, PlanResult):
            return ends
        generator = np.random.default_rng(rng)
        if portfolio == 1 and executor is None:
            return Search(self, ends, generator, progress).run()
        return best_of(self, ends, portfolio, generator, executor, progress)
