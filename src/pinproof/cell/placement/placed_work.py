"""What a base is placed for: picks, or other work that states the poses it needs and how it is judged at a placement.

The search (:mod:`pinproof.cell.placement.place_base`) screens the table of poses at many placements, and judges the
items of the work at the best few.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, runtime_checkable

from pinproof.cell.placement.screening import OBJECTIVES, GraspTable
from pinproof.collision import Scene
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.picks import PickBudget, PickCell, PickReport, Picks, PickSetup, PickVerdict, PickWeights
from pinproof.spatial import Array


@runtime_checkable
class PlacedWork(Protocol):
    """A work for which a base is placed, such as :class:`PickWork`."""

    parts: str
    """What its parts are called in sentences."""

    poses: str
    """What the screened items are called in sentences."""

    success: str
    """What is true of all parts where the work can be done."""

    @property
    def settings(self) -> Picks:
        """The tool, the margin, the frames and the home."""

    @property
    def names(self) -> Sequence[str]:
        """The items that are judged one by one."""

    def changed(self, settings: Picks) -> PlacedWork:
        """The work with other settings."""

    def frames(self) -> Iterator[tuple[str, str]]:
        """What is stated in which frame: the part as text, and the name of the frame."""

    def table(self, cell: PickCell) -> GraspTable:
        """The poses in the cell, whose frame is that of the placements."""

    def at(self, arm: Arm, scene: Scene, home: Array, rng: int, weights: PickWeights, budget: PickBudget) -> PlacedWork:
        """The work with the arm at a placement; :meth:`judge` and :meth:`report` are for such a work."""

    def fresh(self) -> PlacedWork:
        """The same without what it has kept of items that it judged."""

    def judge(self, index: int) -> Any:
        """The verdict on an item."""

    def row(self, verdict: Any) -> dict[str, Any]:
        """Plain values of a verdict: whether it is ``ok``, where it ``failed_at``, and its ``duration`` (s)."""

    def report(self, verdicts: Sequence[Any]) -> Any:
        """The report on items: whether it is ``ok``, ``good`` parts of ``judged``, ``total_time``, ``clearance``."""

    def score(self, report: Any, objective: str) -> float:
        """The value of an objective, which is minimised."""

    def reason(self, report: Any, index: int) -> str | None:
        """Why a screened item fails in a report; None if it does not."""


@dataclass(frozen=True, eq=False)
class PickWork:
    """Picks as the work of a robot whose base is placed."""

    picks: Picks
    setup: PickSetup | None = None

    parts, poses, success = "picks", "picks", "good in all stages"

    def __post_init__(self) -> None:
        if not len(self.picks):
            raise InputError("there are no picks; a placement is searched for at least one pick")
        if self.picks.problems:
            first, count = self.picks.problems[0], len(self.picks.problems)
            raise InputError(f"{count} picks could not be read; the first is {first.name!r}: {first.reason}")

    @property
    def settings(self) -> Picks:
        """The picks, which have the settings."""
        return self.picks

    @property
    def names(self) -> Sequence[str]:
        """The names of the picks."""
        return tuple(pick.name for pick in self.picks)

    def changed(self, settings: Picks) -> PickWork:
        """The picks with other settings."""
        return PickWork(settings)

    def frames(self) -> Iterator[tuple[str, str]]:
        """The frames of the picks and of their places."""
        for pick in self.picks:
            for frame in (pick.frame, "" if pick.place is None else pick.place.frame):
                yield f"pick {pick.name!r}", frame

    def table(self, cell: PickCell) -> GraspTable:
        """The grasps, the ends of their lines and the releases."""
        self.picks.refuse_conveyor("base placement")
        table = GraspTable.of(self.picks, cell)
        if table.problems:
            index, reason = next(iter(table.problems.items()))
            raise InputError(f"pick {self.names[index]!r} is invalid: {reason}")
        return table

    def at(self, arm: Arm, scene: Scene, home: Array, rng: int, weights: PickWeights, budget: PickBudget) -> PickWork:
        """The picks with the arm at a placement."""
        setup = PickSetup.make(arm, scene, self.picks, home=home, rng=rng, weights=weights, budget=budget)
        return PickWork(self.picks, setup)

    def fresh(self) -> PickWork:
        """With a setup that has no caches."""
        return PickWork(self.picks, replace(self._placed))

    def judge(self, index: int) -> PickVerdict:
        """The verdict of all stages."""
        return self._placed.judge(index, self.picks.picks[index])

    def row(self, verdict: PickVerdict) -> dict[str, Any]:
        """The outcome of a verdict, with the stage at which it failed."""
        failed_at = "" if verdict.failed is None else verdict.failed.value
        duration = None if verdict.trajectory is None else verdict.trajectory.duration
        return {"ok": verdict.ok, "failed_at": failed_at, "duration": duration}

    def report(self, verdicts: Sequence[PickVerdict]) -> PickReport:
        """The report on picks."""
        arm = self._placed.checker.arm
        return PickReport(
            arm.robot.name, tuple(verdicts), self.picks.problems, arm.limits.acceleration_source,
            self._placed.not_covered({pick.carried is not None for pick in self.picks}), self._placed,
        )  # fmt: skip

    @property
    def _placed(self) -> PickSetup:
        if self.setup is None:
            raise InputError("the work has no placement")
        return self.setup

    def score(self, report: PickReport, objective: str) -> float:
        """The certified value of the objective."""
        return OBJECTIVES[objective].certified(report)

    def reason(self, report: PickReport, index: int) -> str | None:
        """The reason of a verdict that is not good."""
        verdict = report.verdicts[index]
        return None if verdict.ok else verdict.reason


@dataclass(frozen=True, eq=False)
class CertifyTask:
    """Judges items of a work, given as (number of the candidate, index of the item)."""

    works: tuple[PlacedWork, ...]
    keep: bool = True
    _current: list[tuple[int, PlacedWork]] = field(default_factory=list, init=False)

    def __call__(self, start: int, part: Sequence[tuple[int, int]]) -> list[dict[str, Any]]:
        """The rows of consecutive items; with ``keep`` each keeps its verdict in memory."""
        del start
        rows = []
        for candidate, index in part:
            # what has judged a pick keeps large caches in cycles, so only that of the current candidate is kept
            if not self._current or self._current[0][0] != candidate:
                self._current.clear()
                gc.collect()
                self._current.append((candidate, self.works[candidate].fresh()))
            work = self._current[0][1]
            verdict = work.judge(index)
            row = work.row(verdict)
            rows.append({**row, "keep": verdict} if self.keep else row)
        return rows
