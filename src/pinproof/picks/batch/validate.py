"""Judge a list of picks, in this process or with any executor, and return a report in memory."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from pinproof.collision import Scene
from pinproof.common.validation import Rng, seed_sequence
from pinproof.errors import CampaignError
from pinproof.model import Arm
from pinproof.picks.batch.workers import IN_FLIGHT, Workers, do_chunks
from pinproof.picks.input.pick import Pick, Picks
from pinproof.picks.input.settings import PickBudget, PickWeights
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.verdict import PickVerdict
from pinproof.picks.report.report import PickReport

__all__ = ["validate_picks"]


def validate_picks(
    arm: Arm,
    scene: Scene,
    picks: Picks,
    *,
    home: npt.ArrayLike | None = None,
    rng: Rng = 0,
    executor: Workers | None = None,
    workers: int | None = None,
    in_flight: int = IN_FLIGHT,
    weights: PickWeights | None = None,
    budget: PickBudget | None = None,
) -> PickReport:
    """Judge every pick through all stages, from reach to the timed and certified motion.

    For many thousands of picks there is :class:`pinproof.Campaign`, which holds neither picks nor verdicts in memory.

    Parameters
    ----------
    arm
        The arm.
    scene
        What stands around it.
    picks
        The picks; their tool is attached to the tcp, their margin is kept.
    home
        (n,) where each transit starts; by default the one of the picks, else the arm's.
    rng
        Seed or Generator. Each pick has a stream of its own by its place in the list, so the answer does not depend on
        the number of workers.
    executor
        Where the picks are judged, or a function that makes that; by default here, one after another.
    workers
        Judge them in so many processes of this machine, without an executor.
    in_flight
        How many chunks of picks are handed to ``executor`` at a time.
    weights
        How whole picks are compared.
    budget
        How much is tried for each pick.

    Raises
    ------
    InputError
        As :meth:`PickSetup.make`.
    CampaignError
        If the workers of the executor cannot work, or die of a pick.
    """
    setup = PickSetup.make(arm, scene, picks, home=home, rng=rng, weights=weights, budget=budget)
    seed_sequence(rng).spawn(len(picks))  # the streams that are used here; a Generator gives the next call others
    task = _VerdictTask(setup)
    if executor is None and workers is None:
        verdicts = task(0, picks.picks)
    else:
        verdicts = _by_workers(task, picks, executor=executor, workers=workers, in_flight=in_flight)
    return PickReport(
        arm.robot.name, tuple(verdicts), picks.problems, arm.limits.acceleration_source, setup.not_covered(), setup
    )


@dataclass(frozen=True, eq=False)
class _VerdictTask:
    setup: PickSetup

    def __call__(self, start: int, part: Iterable[Pick]) -> list[PickVerdict]:
        return [self.setup.judge(index, pick) for index, pick in enumerate(part, start)]


def _by_workers(task: _VerdictTask, picks: Picks, **where: Any) -> list[PickVerdict]:
    found: dict[int, list[PickVerdict]] = {}
    for outcome in do_chunks(task, lambda i, j: picks.picks[i:j], [(0, len(picks))], **where):
        if outcome.crashed:
            name = picks.picks[outcome.start].name
            raise CampaignError(f"every worker process that judged pick {name!r} alone died")
        found[outcome.start] = outcome.result
    return [verdict for start in sorted(found) for verdict in found[start]]
