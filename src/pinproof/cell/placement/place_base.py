"""Base placement: where the robot is placed so that all picks work, with the shortest cycle time.

The search is hierarchical. A grid of placements is screened at the grasps of all picks
(:mod:`pinproof.cell.placement.screening`), with an estimate of the objective where every pick works. The best
placements are refined by the evolution strategy CMA-ES, which needs no derivatives. The best few are certified: every
pick is judged in all stages, and the placement with the best certified value is the result. This also applies to
the items of any work (:mod:`pinproof.cell.placement.placed_work`), such as a job of tool paths.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placement.placed_work import CertifyTask, PickWork, PlacedWork
from pinproof.cell.placement.placement_result import (
    CertifiedPlacement,
    PlacementMap,
    PlacementResult,
    PlacementSensitivity,
)
from pinproof.cell.placement.region import AXES, PlacedRobot, Placement, PlacementChoice, PlacementRegion
from pinproof.cell.placement.screening import (
    FREE,
    LADDER,
    OBJECTIVES,
    REACH,
    Deviations,
    GridTask,
    PlacementScreening,
    RefineTask,
    evolution_strategy,
    penalised,
)
from pinproof.collision import Scene
from pinproof.common.content_hash import code_here, digest
from pinproof.common.structs import key, struct
from pinproof.common.validation import refuse_repeated, require_integer, require_type
from pinproof.errors import InputError, RunInterrupted, UnknownNameError
from pinproof.model import Arm
from pinproof.picks import Pick, PickBudget, PickCell, Picks, PickWeights, check_held_joints, checker_of_picks
from pinproof.spatial import Array
from pinproof.work import IN_FLIGHT, Progress, Runner, Workers

SAMPLE = 24
"""Number of picks that are judged at each of many placements, before all picks are judged at the best few."""

Screened = tuple[int, Array, dict[str, Any]]
"""The choice, the placement (4,), and its row of the screening."""

MOST_ROUNDS = 4
"""Rounds of certification, each of ``certified`` placements, until one is found at which every pick is good."""


@struct(kw_only=True)
class PlacementBudget:
    """The budget of a search for a placement."""

    grid: int = key("number of placements of the grid, for each discrete choice", default=2000, minimum=1)
    runs: int = key("number of placements from which the evolution strategy starts", default=4, minimum=0)
    evaluations: int = key("number of placements that each of these runs screens", default=160, minimum=0)
    sampled: int = key(
        "number of placements at which a sample of 24 picks is judged, to choose those that are certified. Not used "
        "for 24 picks or fewer; `certified` has the same effect there",
        default=12,
        minimum=0,
    )
    certified: int = key(
        "number of placements whose picks are all judged; more if a pick fails at each of them", default=3, minimum=1
    )
    deviations: int = key(
        "number of deviations of the best placement, in both directions along each axis, at which all picks are judged "
        "to find how far the base may be off; 0 for no such study",
        default=4,
        minimum=0,
    )


def place_base(
    arm: Arm,
    scene: Scene,
    picks: Picks | Sequence[Pick] | PlacedWork,
    region: PlacementRegion,
    *,
    moves_with_base: Sequence[str] = (),
    choices: Sequence[PlacementChoice] = (),
    objective: str = "cycle_time",
    home: npt.ArrayLike | None = None,
    rng: int = 0,
    placement_budget: PlacementBudget | None = None,
    budget: PickBudget | None = None,
    weights: PickWeights | None = None,
    executor: Workers | None = None,
    workers: int | None = None,
    in_flight: int = IN_FLIGHT,
    folder: str | Path | None = None,
    progress: Progress | None = None,
) -> PlacementResult:
    """Search for the placement of the robot's base at which all picks work, with the best value of an objective.

    Parameters
    ----------
    arm
        The arm.
    scene, picks
        The obstacles and the picks in the frame of the cell; the placement is the pose of the root link in this frame.
        For a job of tool paths, see :func:`pinproof.tool_paths.place_job`.
    region
        The placements that are searched, and forbidden zones.
    moves_with_base
        Names of obstacles that keep their pose relative to the root link, such as a pedestal. They collide with the
        other obstacles, unless ``scene.allowed`` lists the pair, and with all links that move relative to them, even if
        it lists these. To move the workpiece instead, name all others.
    choices
        Discrete alternatives, such as tools or robots, each of which is searched.
    objective
        ``"cycle_time"``, ``"clearance"`` or ``"manipulability"``. A placement at which more picks work is better.
    home
        (n,) where each transit starts; by default the home of the picks if they define one, else that of the arm.
    rng
        The seed. The result is the same for any number of workers.
    placement_budget, budget, weights
        The budget of the search; that for judging a pick (by default without suggestions), and the weights by which its
        motions are compared (by default those of the objective).
    executor, workers, in_flight
        As for :func:`pinproof.validate_picks`.
    folder
        Where the results of screening and judging are kept, so that an interrupted search resumes.
    progress
        Called with the name of the stage, the number of finished items, and the number of all items.

    Raises
    ------
    InputError
        If an argument is invalid, or a name is repeated or unknown.
    RunInterrupted
        After Ctrl-C (a KeyboardInterrupt); its ``result`` has what was found before.
    """
    # the arguments are checked before any work
    if not isinstance(picks, Picks | PlacedWork):
        picks = Picks(tuple(picks))
    work = PickWork(picks) if isinstance(picks, Picks) else picks
    if objective not in OBJECTIVES:
        raise UnknownNameError("objective", objective, OBJECTIVES)
    require_integer("rng", rng, 0)
    refuse_repeated("choices", (choice.name for choice in choices))
    effort = PlacementBudget() if placement_budget is None else placement_budget
    require_type("placement_budget", effort, PlacementBudget)
    if effort.runs and effort.evaluations and len(region.free_axes) > 1:
        evolution_strategy()  # refused before the grid is screened, if it is not installed
    # one search over all alternatives
    alternatives = [
        _Alternative.make(arm, scene, work, region, moves_with_base, choice, home)
        for choice in choices or (PlacementChoice("default"),)
    ]
    if not choices:
        alternatives = [replace(alternatives[0], name="")]
    search = _PlacementSearch(
        alternatives,
        work,
        region,
        objective,
        effort,
        budget or PickBudget(remedies=0),
        weights or OBJECTIVES[objective].weights,
        rng,
    )
    with Runner(
        search.identity(), executor=executor, workers=workers, in_flight=in_flight, folder=folder, progress=progress
    ) as search.runner:
        try:
            return search.run()
        except KeyboardInterrupt:
            result = search.result(interrupted=True)
            raise RunInterrupted(f"interrupted: {result.message}", result) from None


@dataclass(frozen=True, eq=False)
class _Alternative:
    """One discrete choice, ready for screening and judging."""

    name: str
    placed: PlacedRobot
    work: PlacedWork
    home: Array
    screening: PlacementScreening

    @classmethod
    def make(
        cls,
        arm: Arm,
        scene: Scene,
        work: PlacedWork,
        region: PlacementRegion,
        moves_with_base: Sequence[str],
        choice: PlacementChoice,
        home: npt.ArrayLike | None,
    ) -> _Alternative:
        own, stated = choice.arm or arm, work.settings
        # what the choice replaces; another robot does not know the home of the picks
        changes: dict[str, Any] = {"tip": choice.tip, "tool": choice.tool}
        if choice.arm is not None and set(stated.home) - set(own.joint_names):
            changes["home"] = {}
        work = work.changed(replace(stated, **{name: value for name, value in changes.items() if value is not None}))
        shared = work.settings
        shared.check_tools()
        check_held_joints(own, shared)
        # the start of the motions, checked before any placement is screened
        start = choice.home if choice.home is not None else home
        start = shared.home_configuration(own.joint_names, own.home) if start is None else start
        start = own.limits.snap(own.configuration(start, "home"))
        if outside := own.limits.violations(start, own.joint_names):
            raise InputError(f"home is not a valid start: {'; '.join(outside)}")
        # the poses in the cell do not depend on the placement, so they are computed once, at the middle of the region
        placed = PlacedRobot.make(own, scene, choice.placement_from_root, moves_with_base)
        placed.refuse_on_base(work.frames(), shared)
        middle = (region.lower + region.upper) / 2
        checker = checker_of_picks(placed.arm_at(middle), placed.scene, shared)
        cell = PickCell(checker, replace(shared, picks=(), problems=()), start)
        screening = PlacementScreening(placed, shared, start, work.table(cell), region.forbidden)
        return cls(choice.name, placed, work, start, screening)

    def at(self, placement: Array, search: _PlacementSearch) -> PlacedWork:
        """The work with the arm at a placement (4,)."""
        arm = self.placed.arm_at(placement)
        return self.work.at(arm, self.placed.scene, self.home, search.rng, search.weights, search.pick_budget)


@dataclass(eq=False)
class _PlacementSearch:
    """The state of a search; :meth:`result` gives what is known at any time."""

    alternatives: list[_Alternative]
    work: PlacedWork
    region: PlacementRegion
    objective: str
    budget: PlacementBudget
    pick_budget: PickBudget
    weights: PickWeights
    rng: int
    runner: Runner = field(init=False)
    map: PlacementMap | None = None
    candidates: list[CertifiedPlacement] = field(default_factory=list)
    sensitivity: tuple[PlacementSensitivity, ...] = ()
    evaluations: int = 0
    _verdicts: dict[tuple[float, ...], dict[int, Any]] = field(default_factory=dict)

    def identity(self) -> dict[str, Any]:
        """What all results depend on, as plain values."""
        parts = [
            (
                choice.name,
                choice.screening.checker.fingerprint(),
                choice.placed.mounting.tobytes(),
                choice.home.tolist(),
                digest(choice.work),
                digest(choice.placed.original.limits),
            )
            for choice in self.alternatives
        ]
        return {
            "pinproof": code_here(),
            "cell": digest(parts),
            "region": digest(
                (self.region.lower.tolist(), self.region.upper.tolist(), [repr(zone) for zone in self.region.forbidden])
            ),
            "objective": self.objective,
            "budget": digest((self.budget, self.pick_budget, self.weights)),
            "seed": self.rng,
        }

    def run(self) -> PlacementResult:
        """All stages."""
        # the grid, screened at all choices, is the heat map
        axes = self.region.axes(self.budget.grid)
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
        screenings = tuple(alternative.screening for alternative in self.alternatives)
        items = [(number, values) for number in range(len(screenings)) for values in grid]
        rows = self.runner.run("grid", GridTask(screenings, self.objective), items, 64)
        self.evaluations += len(rows)
        total = len(self.alternatives[0].screening.table)
        self.map = PlacementMap(
            np.tile(grid, (len(screenings), 1)),
            tuple(alternative.name for alternative in self.alternatives),
            np.repeat(np.arange(len(screenings)), len(grid)),
            axes,
            np.array([row["base"] for row in rows]),
            np.array([list(map(int, row["codes"])) for row in rows], dtype=np.int8),
            np.array([row["working"] for row in rows]) / total,
            *(np.array([np.nan if row[key] is None else row[key] for row in rows]) for key in ("seconds", "estimate")),
        )
        # the best placements that are not neighbours are refined
        order = sorted(range(len(rows)), key=lambda k: (penalised(rows[k], total), k))
        screened = [(items[k][0], items[k][1], rows[k]) for k in order]
        steps = (self.region.upper - self.region.lower) / [len(axis) for axis in axes]
        starts = [(choice, values) for choice, values, row in _apart(screened, steps, self.budget.runs) if row["base"]]
        if starts and self.budget.evaluations and self.region.free_axes:
            task = RefineTask(screenings, self.region, steps, self.objective, self.budget.evaluations, self.rng)
            for run in self.runner.run("refine", task, starts, 1):
                self.evaluations += run["evaluations"]
                screened += [(run["choice"], np.array(row["values"]), row) for row in run["best"]]
        # the best of all are certified
        screened = [candidate for candidate in screened if candidate[2]["base"]]
        screened.sort(
            key=lambda candidate: (penalised(candidate[2], total), candidate[0], tuple(candidate[1].tolist()))
        )
        self._certify(screened, steps)
        if self.candidates and self.candidates[0].ok and self.budget.deviations:
            self._measure_sensitivity()
        return self.result()

    def _certify(self, screened: list[Screened], steps: Array) -> None:
        """Judge all items at the best placements, until one is found at which every item is good."""
        count = len(self.work.names)
        spread = _apart(screened, steps / 4, max(MOST_ROUNDS * self.budget.certified, self.budget.sampled))
        # with many picks, the best placements are sorted by a random sample of the picks that is judged there
        working = sum(row["estimate"] is not None for _, _, row in spread)
        chosen = spread[: min(self.budget.sampled, working)]
        if count > SAMPLE and len(chosen) > 1:
            sample = np.random.default_rng(self.rng).permutation(count)[:SAMPLE]
            reports = self._judge("sample", chosen, sorted(sample.tolist()))
            key = [(-len(report.good), self.work.score(report, self.objective)) for report in reports]
            spread[: len(chosen)] = [chosen[k] for k in sorted(range(len(chosen)), key=lambda k: key[k])]
        for number in range(MOST_ROUNDS):
            chosen = spread[number * self.budget.certified : (number + 1) * self.budget.certified]
            if not chosen or (number and chosen[0][2]["estimate"] is None):
                return  # placements at which picks already fail in the screening are judged only if there are no others
            reports = self._judge(f"certify_{number + 1}", chosen, range(count))
            for (choice, values, row), report in zip(chosen, reports, strict=True):
                alternative, estimate = self.alternatives[choice], row["estimate"]
                self.candidates.append(
                    CertifiedPlacement(
                        Placement.of(values, alternative.name),
                        report,
                        np.nan if estimate is None else estimate,
                        self.work.score(report, self.objective),
                        alternative.placed,
                    )
                )
            self.candidates.sort(key=lambda candidate: (-len(candidate.report.good), candidate.score))
            if self.candidates[0].ok:
                return

    def _judge(self, stage: str, chosen: list[Screened], indices: Sequence[int]) -> list[Any]:
        """The reports on the items with these indices at each placement; each item is judged once at a placement."""
        works = tuple(self.alternatives[choice].at(values, self) for choice, values, _ in chosen)
        known = [self._verdicts.setdefault((choice, *values.tolist()), {}) for choice, values, _ in chosen]
        items = [(k, index) for k in range(len(chosen)) for index in indices if index not in known[k]]
        task = CertifyTask(works)
        rows = dict(zip(items, self.runner.run(stage, task, items, 1), strict=True))
        # rows that were read from the folder have no motions, so these items are judged again
        if read := [item for item, row in rows.items() if "keep" not in row]:
            again = self.runner.run(f"{stage}_again", task, read, 1, in_memory=True)
            rows.update(zip(read, again, strict=True))
        for (k, index), row in rows.items():
            known[k][index] = row["keep"]
        return [work.report([known[k][index] for index in indices]) for k, work in enumerate(works)]

    def _measure_sensitivity(self) -> None:
        """Find how far the base may be off along each axis, by judging every pick in all stages at some deviations.

        The screening only bounds the deviations that are judged: what fails in it is not good for arms of six joints
        with a closed form, and hardly ever for others, whose configurations it samples.
        """
        best = self.candidates[0]
        alternative = next(choice for choice in self.alternatives if choice.name == best.placement.choice)
        values = best.placement.values
        directions = [
            Deviations.screened(alternative.screening, values, axis, sign)
            for axis in range(len(AXES))
            for sign in (-1.0, 1.0)
        ]
        for number in count(1):
            chosen = [
                (d, k)
                for d, direction in enumerate(directions)
                for k in direction.next_to_judge(self.budget.deviations)
            ]
            if not chosen:
                break
            # all picks at each of these deviations, in all stages
            works = tuple(alternative.at(directions[d].moved(values, k), self) for d, k in chosen)
            items = [(place, index) for place in range(len(chosen)) for index in range(len(self.work.names))]
            task = CertifyTask(works, keep=False)
            rows = self.runner.run(f"sensitivity_{number}", task, items, 1)
            # for each deviation the first pick that fails, with its stage
            judged: list[dict[int, tuple[str, str]]] = [{} for _ in directions]
            for (place, index), row in zip(items, rows, strict=True):
                d, k = chosen[place]
                if judged[d].setdefault(k, ("", ""))[0] == "" and not row["ok"]:
                    judged[d][k] = self.work.names[index], row["failed_at"]
            directions = [direction.after(judged[d]) for d, direction in enumerate(directions)]
        self.sensitivity = tuple(
            PlacementSensitivity(
                axis, below.size(below.good), above.size(above.good), below.first, above.first, below.why, above.why,
                below.size(len(LADDER) - 1), below.judged, above.judged,
            )
            for axis, below, above in zip(AXES, directions[::2], directions[1::2], strict=True)
        )  # fmt: skip

    def result(self, *, interrupted: bool = False) -> PlacementResult:
        """What is known so far."""
        best = self.candidates[0] if self.candidates and self.candidates[0].ok else None
        failing = {} if best is not None or self.map is None else self._failing(self.map)
        return PlacementResult(
            tuple(self.candidates),
            self.map,
            self.region,
            self.work,
            self.objective,
            self.sensitivity,
            0.0 if best is None else max(0.0, best.clearance - self.alternatives[0].work.settings.margin),
            failing,
            self._message(failing) + ("; interrupted" if interrupted and self.map is not None else ""),
            self.evaluations,
            interrupted,
        )

    def _failing(self, grid: PlacementMap) -> dict[str, str]:
        """Why each screened item fails that passes the screening, or is good, at no placement."""
        judged = self.candidates[0].report if self.candidates else None
        reasons = {}
        for index, name in enumerate(self.alternatives[0].screening.table.names):
            # items that pass somewhere and are good at the judged placement do not fail
            codes = grid.codes[grid.base, index]
            passes = bool((codes == FREE).any())
            reason = None if judged is None else self.work.reason(judged, index)
            if passes and reason is None:
                continue
            at_least_failing = "" if reason is None else f"at the least failing placement: {reason}"
            # the reasons at the placements whose base is free
            reach = int((codes == REACH).sum())
            counts = {"out of reach": reach, "in contact": len(codes) - reach}
            everywhere = ", ".join(f"{why} at {n} of {len(codes)} placements" for why, n in counts.items() if n)
            if not len(codes):
                reasons[name] = "the base or the arm at home is in contact at every placement"
            elif passes:
                reasons[name] = f"fails {at_least_failing}"
            else:
                reasons[name] = "; ".join(filter(None, (everywhere, at_least_failing)))
        return reasons

    def _message(self, failing: Mapping[str, str]) -> str:
        searched = f"{self.evaluations:,} placements screened"
        if self.map is None:
            return f"no result: the grid of placements is not complete ({searched})"
        feasible = int(self.map.feasible.sum())
        searched += f", all {self.work.poses} pass the screening at {feasible:,} of {len(self.map):,} of the grid"
        # no placement: the base itself, no pick judged, or some pick fails everywhere
        if not self.map.base.any():
            contacts = self.alternatives[0].screening.base_contacts(self.map.placements[len(self.map) // 2])
            return f"no placement: the base or the arm at home is in contact everywhere ({contacts}); {searched}"
        if self.candidates and self.candidates[0].ok:
            best, done = self.candidates[0], f"{self.work.parts} are {self.work.success}"
            off = ""
            if self.sensitivity:
                judged = sum(row.judged_below + row.judged_above for row in self.sensitivity)
                off = (
                    f"; if the base is off along one axis, all {done} at each of the {judged} judged "
                    f"deviations within {', '.join(row.range for row in self.sensitivity)}"
                )
            return (
                f"best placement {best.placement}: all {best.judged} {done}, cycle time {best.cycle_time:.3f} s{off}; "
                f"{searched}"
            )
        if not self.candidates:
            return f"no placement was judged yet; {searched}"
        least = self.candidates[0]
        names = list(failing)
        listed = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
        return (
            f"no placement at which all {self.work.parts} are good; the least failing one is {least.placement} with "
            f"{least.good} of {least.judged} good {self.work.parts}; failing: {listed}; {searched}"
        )


def _apart(screened: Sequence[Screened], steps: Array, count: int) -> list[Screened]:
    """The first ``count`` placements of which no two of one choice are within one and a half ``steps`` (4,)."""
    chosen: list[Screened] = []
    size = np.where(steps > 0, steps, 1.0)
    for choice, values, row in screened:
        if len(chosen) == count:
            break
        if all(choice != near[0] or (np.abs(near[1] - values) > 1.5 * size).any() for near in chosen):
            chosen.append((choice, values, row))
    return chosen
