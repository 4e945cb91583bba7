"""Judge a list of picks, in this process or with any executor, or one after the other from a conveyor."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy.typing as npt

from pinproof.collision import Scene
from pinproof.common.results import Shown, View
from pinproof.common.validation import Rng, require_type, seed_sequence
from pinproof.errors import CampaignError, InputError, RunInterrupted
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.picks.input.pick import Pick
from pinproof.picks.input.picks import Picks
from pinproof.picks.input.settings import PickBudget, PickWeights
from pinproof.picks.input.sources import PickList
from pinproof.picks.judging.conveyor import judge_on_conveyor, on_conveyor
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.task import PickCell
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
    # Each pick has its own stream of random numbers
    setup = PickSetup.make(arm, scene, picks, home=home, rng=rng, weights=weights, budget=budget)
    seed_sequence(rng).spawn(len(picks))  # so that the next call with this Generator uses other streams
    if executor is None and workers is None:
        judged = ((index, setup.judge(index, pick)) for index, pick in enumerate(picks.picks))
    else:
        judged = _by_workers(setup, picks, executor=executor, workers=workers, in_flight=in_flight)
    # The verdicts as they come, also if the run is interrupted
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


def _verdicts(setup: PickSetup, start: int, part: Iterable[Pick]) -> list[PickVerdict]:
    return [setup.judge(index, pick) for index, pick in enumerate(part, start)]


def _by_workers(setup: PickSetup, picks: Picks, **where: Any) -> Generator[tuple[int, PickVerdict], None, None]:
    for outcome in do_chunks(partial(_verdicts, setup), lambda i, j: picks.picks[i:j], [(0, len(picks))], **where):
        if outcome.crashed:
            name = picks.picks[outcome.start].name
            raise CampaignError(f"every worker process that judged pick {name!r} alone died")
        yield from enumerate(outcome.result, outcome.start)


@dataclass(frozen=True, eq=False)
class BeltSequence(Shown):
    """The picks that an arm takes from a conveyor one after the other; result of :func:`pick_from_belt`.

    Parameters
    ----------
    verdicts
        One for each pick, in order. Each good pick starts where and when the one before it ended.
    end_time
        Seconds on the clock of the conveyor at which the last motion ends.
    """

    verdicts: tuple[PickVerdict, ...]
    end_time: float

    @property
    def taken(self) -> tuple[PickVerdict, ...]:
        """The good picks."""
        return tuple(verdict for verdict in self.verdicts if verdict.ok)

    @property
    def trajectory(self) -> Trajectory | None:
        """The complete motion from time 0; None if nothing is taken."""
        parts = [verdict.trajectory for verdict in self.taken if verdict.trajectory is not None]
        return Trajectory.join(*parts) if parts else None

    @property
    def cycle_times(self) -> tuple[float, ...]:
        """Seconds from the release of each part to that of the next one, or from the start to the first release."""
        ends = [
            verdict.intercept.start_time + (verdict.release_time or verdict.trajectory.duration)
            for verdict in self.taken
            if verdict.intercept is not None and verdict.trajectory is not None
        ]
        return tuple(later - sooner for sooner, later in zip([0.0, *ends], ends, strict=False))

    @property
    def summary(self) -> str:
        """One line."""
        cycles = self.cycle_times
        mean = f", {sum(cycles) / len(cycles):.2f} s for each" if cycles else ""
        return f"{len(self.taken)} of {len(self.verdicts)} parts taken in {self.end_time:.1f} s{mean}"

    def _view(self) -> View:
        rows = (f"{each.pick.name}: {each.status.value}: {each.reason}" for each in self.verdicts)
        return View(self.summary, lines=rows, total=len(self.verdicts))


def pick_from_belt(setup: PickSetup, picks: Iterable[Pick]) -> BeltSequence:
    """Take parts from a conveyor one after the other, in the given order.

    The arm takes each part as early as it can after the one before. A part that cannot be taken passes and stays on the
    belt, where all later motions are certified against it, as they are against the parts at their places. The arm
    starts at its home at time 0, and each pick starts where the one before ended.

    Parameters
    ----------
    setup
        The cell, the gripper and the conveyor.
    picks
        The picks, whose objects are parts of the conveyor.

    Raises
    ------
    InputError
        If there is no conveyor, or the object of a pick is not on it.
    """
    cell, now, verdicts = setup.cell, 0.0, list[PickVerdict]()
    for index, pick in enumerate(picks):
        if not on_conveyor(pick, setup.cell):
            raise InputError(f"the object of pick {pick.name!r} is not a part of the conveyor")
        seeds = setup.rng(index).integers(2**31, size=4).tolist()
        verdict = judge_on_conveyor(pick, cell, seeds, now)
        verdicts.append(verdict)
        if verdict.trajectory is not None:
            now += verdict.trajectory.duration
            cell = _after(cell, verdict)
    return BeltSequence(tuple(verdicts), now)


def _after(cell: PickCell, verdict: PickVerdict) -> PickCell:
    """The cell after a pick: the arm at the end of its motion, and the part at its place or gone."""
    name, last, belt = str(verdict.pick.carried), verdict.motions[-1], cell.shared.conveyor
    if belt is None or verdict.trajectory is None:
        raise InputError("a pick without a motion does not change the cell")
    rest = tuple(part for part in belt.parts if part != name)
    shared = replace(cell.shared, conveyor=replace(belt, parts=rest) if rest else None)
    placed = verdict.release_time is not None and name in last.scene
    scene = last.scene if placed else cell.checker.scene.remove(name)
    return replace(cell, checker=cell.checker.with_scene(scene), shared=shared, home=verdict.trajectory.end)
