"""Picks from a conveyor one after the other, on the clock of the belt."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from pinproof.common.results import Shown, View
from pinproof.errors import InputError
from pinproof.motion import Trajectory
from pinproof.picks.input.pick import Pick
from pinproof.picks.judging.intercept import judge_on_conveyor, on_conveyor
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.task import PickCell
from pinproof.picks.judging.verdict import PickVerdict


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
