"""Judge a list of picks, in this process or with any executor, and return a report in memory."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from functools import partial
from typing import Any

import numpy.typing as npt

from pinproof.collision import Scene
from pinproof.common.validation import Rng, require_type, seed_sequence
from pinproof.errors import CampaignError, RunInterrupted
from pinproof.model import Arm
from pinproof.picks.input.pick import Pick
from pinproof.picks.input.picks import Picks
from pinproof.picks.input.settings import PickBudget, PickWeights
from pinproof.picks.input.sources import PickList
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.verdict import PickVerdict
from pinproof.picks.report.report import PickReport
from pinproof.work import IN_FLIGHT, Workers, do_chunks

Progress = Callable[[int, int], object]


def validate_picks(
    arm: Arm,
    scene: Scene,
    picks: Picks | Sequence[Pick],
    *,
    home: npt.ArrayLike | None = None,
    rng: Rng = 0,
    executor: Workers | None = None,
    workers: int | None = None,
    in_flight: int = IN_FLIGHT,
    weights: PickWeights | None = None,
    budget: PickBudget | None = None,
    progress: Progress | None = None,
) -> PickReport:
    """Judge every pick in all stages, from reach to the timed and certified motion.

    For many thousands of picks, use :class:`pinproof.Campaign`, which keeps neither picks nor verdicts in memory.

    Parameters
    ----------
    arm
        The arm.
    scene
        The obstacles around the arm.
    picks
        The picks. The tool of a :class:`Picks` is attached to the tcp, and its margin is kept; a sequence of
        :class:`Pick` has neither.
    home
        (n,) the configuration in which each transit starts. The default is the home of the picks if they define one,
        otherwise that of the arm.
    rng
        Seed or Generator. Each pick has its own random stream, which depends on its index in the list, so the result
        does not depend on the number of workers.
    executor
        The executor that judges the picks, or a function that creates it. By default the picks are judged in this
        process, one after another.
    workers
        The number of local processes, if no executor is given.
    in_flight
        The number of chunks pending in ``executor`` at a time.
    weights
        The weights of the score by which complete motions are compared.
    budget
        The limits of the search for each pick.
    progress
        Called after each pick or chunk of picks with the number of picks that are judged, and the number of all picks.

    Raises
    ------
    InputError
        If ``picks`` contains anything but picks, and for the same reasons as in :meth:`PickSetup.make`.
    CampaignError
        If the workers cannot start, or a pick kills every worker that judges it.
    RunInterrupted
        After Ctrl-C (a KeyboardInterrupt); its ``result`` is the report on the picks that were judged before.
    """
    if not isinstance(picks, Picks):
        require_type("picks", picks, Picks, Iterable)
        for index, pick in enumerate(picks):
            require_type(f"picks[{index}]", pick, Pick)
        picks = Picks(tuple(picks))
    setup = PickSetup.make(arm, scene, picks, home=home, rng=rng, weights=weights, budget=budget)
    seed_sequence(rng).spawn(len(picks))  # so that the next call with this Generator uses other streams
    if executor is None and workers is None:
        judged = _one_by_one(setup, picks)
    else:
        judged = _by_workers(setup, picks, executor=executor, workers=workers, in_flight=in_flight)
    found: dict[int, PickVerdict] = {}
    try:
        with closing(judged):
            for index, verdict in judged:
                found[index] = verdict
                if progress is not None:
                    progress(len(found), len(picks))
    except KeyboardInterrupt:
        message = f"interrupted after {len(found):,} of {len(picks):,} picks"
        raise RunInterrupted(message, _report(setup, picks, found)) from None
    return _report(setup, picks, found)


def _report(setup: PickSetup, picks: Picks, found: Mapping[int, PickVerdict]) -> PickReport:
    arm = setup.checker.arm
    return PickReport(
        arm.robot.name,
        tuple(found[index] for index in sorted(found)),
        picks.problems,
        arm.limits.acceleration_source,
        setup.not_covered(PickList(picks).with_object),
        setup,
        not_judged=len(picks.picks) - len(found),
    )


def _one_by_one(setup: PickSetup, picks: Picks) -> Generator[tuple[int, PickVerdict], None, None]:
    for index, pick in enumerate(picks.picks):
        yield index, setup.judge(index, pick)


def _verdicts(setup: PickSetup, start: int, part: Iterable[Pick]) -> list[PickVerdict]:
    return [setup.judge(index, pick) for index, pick in enumerate(part, start)]


def _by_workers(setup: PickSetup, picks: Picks, **where: Any) -> Generator[tuple[int, PickVerdict], None, None]:
    for outcome in do_chunks(partial(_verdicts, setup), lambda i, j: picks.picks[i:j], [(0, len(picks))], **where):
        if outcome.crashed:
            name = picks.picks[outcome.start].name
            raise CampaignError(f"every worker process that judged pick {name!r} alone died")
        yield from enumerate(outcome.result, outcome.start)
