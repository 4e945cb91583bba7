"""Screening of many placements: which picks can work, and an estimate of the time of each pick.

All configurations of all picks at all placements of a chunk are checked in one call, because the placement is a part of
the configuration of :attr:`PlacedRobot.wide_arm`. A pick passes the screening if it has configurations without contact
at the grasp, at the ends of the straight lines and at the release, on the same IK branch for each line. This is
necessary for a good pick, but not sufficient: the motions between them are not checked. The time of such a pick is
estimated: a joint that moves by d from rest to rest within its limits v and a takes at least d / v + v / a, or
2 sqrt(d / a) if it does not reach v.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placement.region import METRES_PER_RADIAN, PlacedRobot, PlacementRegion
from pinproof.collision import CollisionChecker, Obstacle
from pinproof.common.structs import described, key
from pinproof.common.validation import optional_module
from pinproof.errors import NoClosedForm
from pinproof.ik import AnalyticIk, Clik
from pinproof.model import Arm
from pinproof.motion import Bounds, least_times
from pinproof.picks import TURN, PickCell, PickReport, Picks, PickTask, PickWeights, ScreenStatus, code_of
from pinproof.spatial import Array, matrix

Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

REACH, CONTACT, FREE = map(code_of, (ScreenStatus.REACH, ScreenStatus.CONTACT, ScreenStatus.FREE))

FIRST_GRASPS = 6
"""Number of grasps of a family that are screened at every placement; the others only for picks that fail with these."""

REDUNDANT_STEPS = 8
"""Values of the redundant joint of an arm of seven joints."""

STARTS = 3
"""Start configurations of the search, for arms without a closed form."""

DETOUR = 1.3
"""Factor of the estimated time of a motion whose straight line in joint space is in collision: a planned path around an
obstacle is longer."""

ALONG = 6
"""Number of configurations that are checked on that line."""

LINE_JUMP = 1.2
"""rad or m: two configurations at the ends of a straight line of the tcp are taken to be on different IK branches if a
joint differs by more."""

ROWS = 8192
"""Number of poses that are screened at a time."""


@described(eq=False)
class GraspTable:
    """The poses of all grasps of all picks in the frame of the cell."""

    names: tuple[str, ...] = key("the P picks")
    pick: Indices = key("(R,) the pick of each grasp")
    stations: Array = key(
        "(6, R, 4, 4) ``cell_from_tcp`` at the start of the approach, the grasp, the end of the retreat, the start "
        "of the line to the place, the release, and the end of the line after it; NaN for picks without a place"
    )
    later: Mask = key("(R,) whether the grasp is screened only if the first ones fail")
    nominal: Array = key("(P, 4, 4) ``cell_from_tip`` of the nominal grasp of each pick")
    problems: dict[int, str] = key("the reason for each pick that is invalid in this cell, by its index")
    share: float = key("the share of the times of all picks that counts", default=1.0)
    seconds: float = key("time that is needed at any placement", "s", default=0.0)

    @classmethod
    def of(cls, picks: Picks, cell: PickCell) -> GraspTable:
        """The table of all picks; ``cell`` has the frame of the placements as its root."""
        rows: list[tuple[int, bool, list[Array]]] = []
        problems: dict[int, str] = {}
        nominal = np.full((len(picks), 4, 4), np.nan)
        for index, pick in enumerate(picks):
            try:
                tasks = [PickTask(grasp, cell) for grasp in picks.grasps_of(pick)]
            except ValueError as error:
                problems[index] = str(error)
                continue
            nominal[index] = matrix(tasks[0].pick.pose)
            # the tcp at all stations of each grasp; a part of the grasps is screened only if the first ones fail
            grasps = [(task, member) for task in tasks for group in task.groups() for member in group]
            step = max(1, -(-len(grasps) // FIRST_GRASPS))
            for k, (task, member) in enumerate(grasps):
                tip, place, grasp = task.cell.shared.tip.inverse(), task.place, task.grasp(member)
                poses = [task.pick.before(grasp), grasp, task.pick.after(grasp)]
                if place is not None:
                    release = task.release(member)
                    poses += [place.before(release), release, place.after(release)]
                tcps = [matrix(pose * tip) for pose in poses]
                rows.append((index, k % step != 0, [*tcps, *[np.full((4, 4), np.nan)] * (6 - len(tcps))]))
        stations = np.array([poses for _, _, poses in rows]).reshape(-1, 6, 4, 4).swapaxes(0, 1)
        return cls(
            tuple(pick.name for pick in picks),
            np.array([index for index, _, _ in rows], dtype=np.int64),
            np.ascontiguousarray(stations),
            np.array([later for _, later, _ in rows], dtype=bool),
            nominal,
            problems,
        )

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, eq=False)
class PlacementScores:
    """The screening results of m placements and P picks."""

    # (m,) whether the base and the arm at home are free.
    base: Mask
    # (m, P) codes of :class:`~pinproof.picks.ScreenStatus`: FREE where the pick passes at all poses, CONTACT where
    # all of them are in reach, else REACH; REACH where the base is not free.
    codes: npt.NDArray[np.int8]
    # (m, P) estimated time of each pick that passes; otherwise NaN.
    seconds: Array
    # (m, P) at the grasp with the least estimated time; NaN where not estimated.
    clearance: Array
    manipulability: Array

    @property
    def working(self) -> Indices:
        """(m,) number of picks that pass the screening."""
        return np.asarray((self.codes == FREE).sum(axis=1))


class PlacementScreening:
    """Screens placements of one robot in one cell; pickles without its checkers' workspaces.

    The motions start at ``home`` (n,); ``table`` has the grasps, and ``zones`` are forbidden.
    """

    def __init__(
        self, placed: PlacedRobot, picks: Picks, home: Array, table: GraspTable, zones: Sequence[Obstacle] = ()
    ) -> None:
        self.placed, self.picks, self.home, self.table = placed, picks, home, table
        carried = [part if isinstance(part, str) else part.name for pick in picks if (part := pick.carried) is not None]
        objects = [name for name in dict.fromkeys(carried) if name in placed.scene.names]
        self.checker = placed.checker(picks, hand_may_touch=objects)
        self.zones: CollisionChecker | None = placed.zone_checker(zones, picks)
        self.branches = BranchSolver(placed.original, home)

    def base_free(self, placements: Array) -> Mask:
        """(m,) whether the base is free of the scene and of forbidden zones, with the arm at home."""
        at_home = np.hstack([placements, np.tile(self.home, (len(placements), 1))])
        free = self.checker.is_free_batch(at_home)
        return free if self.zones is None else free & self.zones.is_free_batch(at_home)

    def base_contacts(self, placement: Array) -> str:
        """The contacts of the base and of the arm at home at one placement (4,), as text; empty if it is free."""
        q = np.concatenate([placement, self.home])
        contacts = [*self.checker.check(q).contacts, *(() if self.zones is None else self.zones.check(q).contacts)]
        return "; ".join(map(str, contacts[:3]))

    def screen(self, placements: Array) -> PlacementScores:
        """Screen placements (m, 4)."""
        count, total = len(placements), len(self.table)
        scores = PlacementScores(
            self.base_free(placements),
            np.full((count, total), REACH, dtype=np.int8),
            *(np.full((count, total), np.nan) for _ in range(3)),
        )
        rows = np.flatnonzero(scores.base)
        # the seeds of a numerical search depend on the other poses of a call, so each placement has its own calls
        size = max(1, ROWS // max(len(self.table.pick), 1)) if self.branches.closed else 1
        for start in range(0, len(rows), size):
            for later in (False, True):
                grasps = np.flatnonzero(self.table.later == later)
                place, grasp = (part.ravel() for part in np.meshgrid(rows[start : start + size], grasps, indexing="ij"))
                left = scores.codes[place, self.table.pick[grasp]] != FREE
                if left.any():
                    self._screen(placements, place[left], grasp[left], scores)
        scores.seconds[:] = self.table.share * scores.seconds + self.table.seconds / total
        return scores

    def _screen(self, placements: Array, place: Indices, grasp: Indices, scores: PlacementScores) -> None:
        """Screen grasps (N,) at placements (N,): at the grasp, and where that is free at the other poses too."""
        # the best status of the solutions at the grasp
        q = self._solve(placements, place, self.table.stations[1][grasp])
        known = np.isfinite(q[:, :, 0])
        codes = np.where(known.any(axis=1), CONTACT, REACH).astype(np.int8)
        for branch in range(q.shape[1]):
            rows = np.flatnonzero(known[:, branch] & (codes != FREE))
            if len(rows):
                codes[rows[self._is_free(placements, place[rows], q[rows, branch])]] = FREE
        # where that is free, the other poses too, with an estimate of the time
        seconds, clearance, volume = (np.full(len(place), np.nan) for _ in range(3))
        placing = np.isfinite(self.table.stations[3][grasp, 0, 0])
        for stations in (3, 6):
            rows = np.flatnonzero((codes == FREE) & (placing == (stations == 6)))
            if len(rows):
                times = self._times(placements, place[rows], grasp[rows], q[rows], stations)
                codes[rows], seconds[rows], clearance[rows], volume[rows] = times
        # the figures of a pick are those of the grasp that takes the least time
        key = place, self.table.pick[grasp]
        np.maximum.at(scores.codes, key, codes)
        best = np.full(scores.seconds.shape, np.inf)
        passes = np.flatnonzero(codes == FREE)
        np.minimum.at(best, (key[0][passes], key[1][passes]), seconds[passes])
        chosen = passes[seconds[passes] == best[key[0][passes], key[1][passes]]]
        for scored, values in (
            (scores.seconds, seconds),
            (scores.clearance, clearance),
            (scores.manipulability, volume),
        ):
            scored[key[0][chosen], key[1][chosen]] = values[chosen]

    def _solve(self, placements: Array, place: Indices, cell_from_tcp: Array) -> Array:
        """(N, k, n) the IK solutions at poses (N, 4, 4) of the tcp in the cell, for the placements ``place`` (N,)."""
        base_from_cell = self.placed.base_from_cell(placements)
        return self.branches(base_from_cell[place] @ cell_from_tcp)

    def _is_free(self, placements: Array, place: Indices, q: Array) -> Mask:
        return self.checker.is_free_batch(np.hstack([placements[place], q]))

    def _times(
        self, placements: Array, place: Indices, grasp: Indices, at_grasp: Array, stations: int
    ) -> tuple[npt.NDArray[np.int8], Array, Array, Array]:
        """(N,) the status at all poses, the estimated time, and clearance and manipulability at the grasp.

        ``at_grasp`` (N, k, n) are the solutions at the grasp; figures are NaN where the status is not FREE.
        """
        # the approach and the retreat, on the branches of the solutions at the grasp
        q = [at_grasp] * stations
        for k in {*range(stations)} - {1}:
            q[k] = self._solve(placements, place, self.table.stations[k][grasp])
        before, after = self._matched(q[1], q[0]), self._matched(q[1], q[2])
        cost = self._move(self.home, before) + self._move(before, q[1]) + self._move(q[1], after)
        in_reach = np.isfinite(cost).any(axis=1)
        if stations == 6:
            # the place, on the branches of the solutions at the release
            there, leave = self._matched(q[4], q[3]), self._matched(q[4], q[5])
            down = self._move(there, q[4]) + self._move(q[4], leave)
            in_reach &= np.isfinite(down).any(axis=1)
            # Any free branch will do at the release, so contact is checked before the nearest is chosen.
            for station in (q[4], there, leave):
                rows, branches = np.nonzero(np.isfinite(down))
                free = self._is_free(placements, place[rows], station[rows, branches])
                down[rows[~free], branches[~free]] = np.inf
            across = self._move(after[:, :, None], there[:, None]) + down[:, None]
            cost = cost + np.where(np.isfinite(across), across, np.inf).min(axis=2)
        # the fastest branch at the grasp that is free at its stations
        cost = np.where(np.isfinite(cost), cost, np.inf)
        seconds, clearance, volume = self._first_free(placements, place, cost, [before, q[1], after])
        codes = np.where(np.isfinite(seconds), FREE, np.where(in_reach, CONTACT, REACH)).astype(np.int8)
        return codes, seconds, clearance, volume

    def _first_free(
        self, placements: Array, place: Indices, cost: Array, points: list[Array]
    ) -> tuple[Array, Array, Array]:
        """The least cost of each row (N, k) whose configurations, (N, k, n) for each station, are free, else NaN."""
        order, count = np.argsort(cost, axis=1, kind="stable"), len(cost)
        seconds, q = np.full(count, np.nan), np.full((count, self.home.size), np.nan)
        for rank in range(cost.shape[1]):
            branch = order[:, rank]
            rows = np.flatnonzero(np.isnan(seconds) & np.isfinite(cost[np.arange(count), branch]))
            for station in points:
                rows = rows[self._is_free(placements, place[rows], station[rows, branch[rows]])]
            seconds[rows], q[rows] = cost[rows, branch[rows]], points[1][rows, branch[rows]]
            if len(rows):
                # the transit takes longer where the straight line in joint space from home is in contact
                entrance, clear = points[0][rows, branch[rows]], np.ones(len(rows), dtype=bool)
                for share in (np.arange(ALONG) + 0.5) / ALONG:
                    left = np.flatnonzero(clear)
                    between = self.home + share * (entrance[left] - self.home)
                    clear[left] = self._is_free(placements, place[rows[left]], between)
                seconds[rows] += np.where(clear, 0.0, (DETOUR - 1.0) * self._move(self.home, entrance))
        clearance, volume = np.full(count, np.nan), np.full(count, np.nan)
        done = np.flatnonzero(np.isfinite(seconds))
        if len(done):
            volume[done] = self.placed.original.manipulability_batch(q[done])
            clearance[done] = self.checker.clearance_batch(np.hstack([placements[place[done]], q[done]]))
        return seconds, clearance, volume

    def _move(self, here: Array, there: Array) -> Array:
        arm, distance = self.placed.original, here - there
        distance = np.where(arm.periodic, distance - TURN * np.round(distance / TURN), distance)
        return least_times(distance, Bounds.of(arm.limits, arm.joint_names))

    def _matched(self, q: Array, end: Array) -> Array:
        """(N, k, n) for each solution q (N, k, n) the nearest of the solutions ``end`` (N, m, n) on the same branch."""
        far = np.abs(q[:, :, None] - end[:, None])
        far = np.where(self.placed.original.periodic, np.abs(far - TURN * np.round(far / TURN)), far).max(axis=3)
        far = np.where(np.isfinite(far), far, np.inf)
        which = far.argmin(axis=2)
        nearest = np.take_along_axis(end, which[:, :, None], axis=1)
        same = np.take_along_axis(far, which[:, :, None], axis=2)[:, :, 0] < LINE_JUMP
        return np.where(same[:, :, None], nearest, np.nan)


class BranchSolver:
    """The IK solutions of many targets: all branches with a closed form, otherwise some."""

    def __init__(self, arm: Arm, home: Array) -> None:
        self._arm, self._home, self._solver = arm, home, AnalyticIk(redundant_steps=REDUNDANT_STEPS)
        self.closed = True
        try:
            self._solver.solve_all_batch(arm, arm.forward_kinematics_batch(home[None]), home)
        except NoClosedForm:
            self.closed = False
        low, high = arm.limits.sampling_range()
        self._starts = np.vstack([home, np.random.default_rng(0).uniform(low, high, (STARTS - 1, arm.dof))])

    def __call__(self, targets: Array) -> Array:
        """(N, k, n) solutions within the limits for targets (N, 4, 4), NaN where no solution exists."""
        targets = np.ascontiguousarray(targets)
        if self.closed:
            return np.asarray(self._solver.solve_all_batch(self._arm, targets, self._home).q)
        results = (
            Clik(restarts=2).solve_batch(self._arm, targets, start, rng=number)
            for number, start in enumerate(self._starts)
        )
        return np.stack([np.where(result.ok[:, None], result.q, np.nan) for result in results], axis=1)


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
    return -float(report.setup.checker.arm.manipulability_batch(q).min()) if q and report.setup is not None else np.nan


_NO_WEIGHTS = {weight.name: 0.0 for weight in fields(PickWeights)}

OBJECTIVES: Mapping[str, _Objective] = {
    "cycle_time": _Objective(
        lambda scores: scores.seconds.sum(axis=1),
        lambda report: report.total_time,
        PickWeights(**{**_NO_WEIGHTS, "duration": 1.0}),
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
            generator = np.random.default_rng(self.rng + index + 1)
            ends = (
                [None if k == 3 and full_turn else float(x) for k, x in zip(free, e, strict=True)] for e in (low, high)
            )
            settings = {
                "seed": np.nan,  # the global generator of NumPy is left alone
                "randn": lambda *shape: generator.standard_normal(shape),
                "bounds": list(ends),
                "CMA_stds": self.steps[free],
                "maxfevals": self.evaluations,
                "verbose": -9,
                "verb_log": 0,
                "verb_disp": 0,
            }
            strategy = evolution_strategy().CMAEvolutionStrategy(start[free], 0.5, settings)
            while not strategy.stop() and strategy.countevals < self.evaluations:
                points = strategy.ask()
                strategy.tell(points, costs_of(np.array(points)))
        screened.sort(key=lambda candidate: candidate[:2])
        best = [{"values": values, **row} for _, values, row in screened[: self.KEPT]]
        return {"choice": choice, "evaluations": len(screened), "best": best}


def evolution_strategy() -> Any:
    """The module ``cma``; InputError if it is not installed."""
    return optional_module("cma", "refining a placement", "cell")


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
