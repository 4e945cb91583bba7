"""The tasks of a search for a placement: screening, refinement by CMA-ES, judging, and the sensitivity of the result.

Source of CMA-ES: N. Hansen, A. Ostermeier (2001), "Completely derandomized self-adaptation in evolution strategies",
Evolutionary Computation 9(2).
"""

from __future__ import annotations

import gc
import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placement.placement_result import total_time
from pinproof.cell.placement.region import METRES_PER_RADIAN, PlacementRegion
from pinproof.cell.placement.screening import FREE, REACH, PlacementScores, PlacementScreening
from pinproof.errors import InputError
from pinproof.picks import PickReport, Picks, PickSetup, PickWeights, manipulability
from pinproof.spatial import Array

FAILS = 1e4
"""Value of the objective for each pick that fails, larger than any cycle time of one pick (s)."""

SEARCHED = 0.2
"""Metres (or, divided by METRES_PER_RADIAN, rad): the largest deviation of the base that is judged."""

LADDER = SEARCHED * (np.arange(101) / 100) ** 2
"""The deviations (m) in either direction at which the picks are screened, and from which those that are judged are
chosen; denser where they are small."""


@dataclass(frozen=True)
class _Objective:
    """What is minimised: from estimates (m, P) per pick, and from a report; and the weights for judging the picks."""

    estimate: Callable[[PlacementScores], Array]
    certified: Callable[[PickReport], float]
    weights: PickWeights


def _least_manipulability(report: PickReport) -> float:
    q = [verdict.q_grasp for verdict in report.good if verdict.q_grasp is not None]
    if not q or report.setup is None:
        return np.nan
    return -float(manipulability(report.setup.checker.arm, np.array(q)).min())


_NO_WEIGHTS = {weight.name: 0.0 for weight in fields(PickWeights)}

OBJECTIVES: Mapping[str, _Objective] = {
    "cycle_time": _Objective(
        lambda scores: scores.seconds.sum(axis=1), total_time, PickWeights(**{**_NO_WEIGHTS, "duration": 1.0})
    ),
    "clearance": _Objective(
        lambda scores: -scores.clearance.mean(axis=1),
        lambda report: -float(np.mean([verdict.clearance for verdict in report.good])) if report.good else np.nan,
        PickWeights(**{**_NO_WEIGHTS, "clearance": 1.0}),
    ),
    "manipulability": _Objective(
        lambda scores: -scores.manipulability.min(axis=1),
        _least_manipulability,
        PickWeights(**{**_NO_WEIGHTS, "manipulability": 1.0}),
    ),
}
"""The objectives by name: the sum of the times of all picks, the mean over the picks of the smallest clearance of the
motion, and the smallest manipulability at a grasp."""


@dataclass(frozen=True, eq=False)
class GridTask:
    """Screens placements, given as (choice, x, y, z, yaw)."""

    screenings: tuple[PlacementScreening, ...]
    objective: str

    def __call__(self, start: int, part: Sequence[tuple[int, Array]]) -> list[dict[str, Any]]:
        """The rows of consecutive placements."""
        del start
        rows: list[dict[str, Any]] = [{} for _ in part]
        for choice, screening in enumerate(self.screenings):
            own = [k for k, (number, _) in enumerate(part) if number == choice]
            if own:
                scores = screening.screen(np.array([part[k][1] for k in own]))
                for k, row in zip(own, score_rows(scores, self.objective), strict=True):
                    rows[k] = row
        return rows


def score_rows(scores: PlacementScores, objective: str) -> list[dict[str, Any]]:
    """The scores of placements as plain values; estimates are None where a pick fails."""
    with np.errstate(invalid="ignore"):
        values, seconds = OBJECTIVES[objective].estimate(scores), scores.seconds.sum(axis=1)
    total = scores.codes.shape[1]
    rows = []
    for k, working in enumerate(scores.working.tolist()):
        passes = working == total
        rows.append(
            {
                "base": bool(scores.base[k]),
                "codes": "".join(map(str, scores.codes[k].tolist())),
                "working": working,
                "seconds": float(seconds[k]) if passes else None,
                "estimate": float(values[k]) if passes else None,
            }
        )
    return rows


def codes_of(rows: Sequence[Mapping[str, Any]]) -> npt.NDArray[np.int8]:
    """(m, P) the codes of rows of :func:`score_rows`."""
    digits = np.frombuffer("".join(row["codes"] for row in rows).encode("ascii"), dtype=np.int8)
    return (digits - ord("0")).reshape(len(rows), -1)


def penalised(row: Mapping[str, Any], total: int) -> float:
    """The value that is minimised: the estimate, or a penalty for each pick that fails."""
    if row["estimate"] is not None:
        return float(row["estimate"])
    return FAILS * (total - row["working"] + (0 if row["base"] else 1))


@dataclass(frozen=True, eq=False)
class RefineTask:
    """Runs of the evolution strategy, each from a start (choice, x, y, z, yaw); returns the best placements."""

    screenings: tuple[PlacementScreening, ...]
    region: PlacementRegion
    steps: Array
    objective: str
    evaluations: int
    rng: int

    KEPT = 5

    def __call__(self, start: int, part: Sequence[tuple[int, Array]]) -> list[dict[str, Any]]:
        """The rows of consecutive runs."""
        return [self._run(index, choice, placement) for index, (choice, placement) in enumerate(part, start)]

    def _run(self, index: int, choice: int, start: Array) -> dict[str, Any]:
        screening, free = self.screenings[choice], list(self.region.free_axes)
        low, high = self.region.lower[free], self.region.upper[free]
        yaw, full_turn = self.region.yaw[0], self.region.yaw[1] - self.region.yaw[0] >= 2 * np.pi * (1 - 1e-9)
        screened: list[tuple[float, list[float], dict[str, Any]]] = []

        def costs_of(points: Array) -> list[float]:
            values = np.tile(start, (len(points), 1))
            values[:, free] = points
            if full_turn:  # angles are moved into the range by full rotations
                values[:, 3] = yaw + np.mod(values[:, 3] - yaw, 2 * np.pi)
            rows = score_rows(screening.screen(values), self.objective)
            costs = [penalised(row, len(screening.table)) for row in rows]
            screened.extend(zip(costs, values.tolist(), rows, strict=True))
            return costs

        if len(free) == 1:  # CMA-ES needs two variables; a line is divided evenly
            around = start[free] + self.steps[free] * np.linspace(-1, 1, self.evaluations)[:, None]
            costs_of(np.clip(around, low, high))
        elif free and self.evaluations:
            ends = (
                [None if k == 3 and full_turn else float(x) for k, x in zip(free, end, strict=True)]
                for end in (low, high)
            )
            _evolve(costs_of, start[free], self.steps[free], list(ends), self.evaluations, self.rng + index + 1)
        screened.sort(key=lambda candidate: candidate[:2])
        best = [{"values": values, **row} for _, values, row in screened[: self.KEPT]]
        return {"choice": choice, "evaluations": len(screened), "best": best}


def evolution_strategy() -> Any:
    """The module ``cma``; InputError if it is not installed."""
    try:
        return importlib.import_module("cma")
    except ImportError as error:
        raise InputError("refining a placement needs the extra 'cell': pip install 'pinproof[cell]'") from error


def _evolve(
    costs_of: Callable[[Array], list[float]],
    start: Array,
    steps: Array,
    bounds: list[list[float | None]],
    evaluations: int,
    seed: int,
) -> None:
    """Minimise a function of many points (m, d) at a time by CMA-ES."""
    cma = evolution_strategy()
    generator = np.random.default_rng(seed)
    settings = {
        "seed": np.nan,  # the global generator of NumPy is left alone
        "randn": lambda *shape: generator.standard_normal(shape),
        "bounds": bounds,
        "CMA_stds": steps,
        "maxfevals": evaluations,
        "verbose": -9,
        "verb_log": 0,
        "verb_disp": 0,
    }
    strategy = cma.CMAEvolutionStrategy(start, 0.5, settings)
    while not strategy.stop() and strategy.countevals < evaluations:
        points = strategy.ask()
        strategy.tell(points, costs_of(np.array(points)))


@dataclass(frozen=True, eq=False)
class CertifyTask:
    """Judges picks, given as (number of the candidate, index of the pick)."""

    setups: tuple[PickSetup, ...]
    picks: tuple[Picks, ...]
    keep: bool = True
    _current: list[tuple[int, PickSetup]] = field(default_factory=list, init=False)

    def __call__(self, start: int, part: Sequence[tuple[int, int]]) -> list[dict[str, Any]]:
        """The rows of consecutive picks; with ``keep`` each keeps its verdict in memory."""
        del start
        rows = []
        for candidate, index in part:
            # a setup that has judged a pick keeps large caches in cycles, so only that of the current candidate is kept
            if not self._current or self._current[0][0] != candidate:
                self._current.clear()
                gc.collect()
                self._current.append((candidate, replace(self.setups[candidate])))
            verdict = self._current[0][1].judge(index, self.picks[candidate].picks[index])
            duration = None if verdict.trajectory is None else verdict.trajectory.duration
            failed_at = "" if verdict.failed is None else verdict.failed.value
            row = {"ok": verdict.ok, "failed_at": failed_at, "duration": duration}
            rows.append({**row, "keep": verdict} if self.keep else row)
        return rows


@dataclass(frozen=True)
class Deviations:
    """Deviations along one axis in one direction, as indices of the ladder."""

    # The axis as an index of the placement, and the direction, 1 or -1.
    axis: int
    sign: float
    # All picks are good at every judged deviation up to this one.
    good: int
    # The smallest deviation at which something fails, past the end of the ladder if nothing does.
    bad: int
    # What fails there, and at which stage or why it does not pass the screening.
    first: str = ""
    why: str = ""
    # The number of deviations up to ``good`` at which all picks were judged.
    judged: int = 0

    @classmethod
    def screened(cls, screening: PlacementScreening, values: Array, axis: int, sign: float) -> Deviations:
        """The deviations at which all picks pass the screening, none of which is judged yet."""
        none_yet = cls(axis, sign, 0, len(LADDER))
        scores = screening.screen(np.array([none_yet.moved(values, k) for k in range(1, len(LADDER))]))
        passes = scores.base & (scores.codes == FREE).all(axis=1)
        if passes.all():
            return none_yet
        first = int(np.argmin(passes))
        codes = scores.codes[first]
        pick = int(np.argmax(codes != FREE))
        name, why = screening.table.names[pick], "out of reach" if codes[pick] == REACH else "in contact"
        if not scores.base[first]:
            name, why = "the base or the arm at home", "in contact"
        return cls(axis, sign, 0, first + 1, name, why)

    def moved(self, values: Array, index: int) -> Array:
        """The placement (4,) with its base off by a deviation of the ladder."""
        moved = np.array(values, dtype=float)
        moved[self.axis] += self.sign * self.size(index)
        return moved

    def size(self, index: int) -> float:
        """The deviation (m or rad)."""
        return float(LADDER[index]) / (METRES_PER_RADIAN if self.axis == 3 else 1.0)

    def next_to_judge(self, count: int) -> list[int]:
        """``count`` deviations at equal steps if none was judged, then the middle between good and bad."""
        most = self.bad - 1
        if not self.judged and self.good == 0 and most:
            steps = LADDER[most] * np.arange(1, count + 1) / count
            return sorted({int(k) for k in np.searchsorted(LADDER, steps - 1e-12).clip(1, most)})
        return [(self.good + self.bad) // 2] if self.bad - self.good > 1 else []

    def after(self, judged: Mapping[int, tuple[str, str]]) -> Deviations:
        """The deviations after more were judged: for each the pick that fails and its stage, empty if all are good."""
        bad = min((k for k, (pick, _) in judged.items() if pick), default=self.bad)
        good = [k for k in judged if k < bad]
        first, why = judged.get(bad, (self.first, self.why))
        return Deviations(
            self.axis, self.sign, max(good, default=self.good), bad, first, why, self.judged + len(good)
        )  # fmt: skip
