r"""The best motion of a pick by branch and bound, and the score by which motions are compared.

The score of a complete motion is the weighted sum of four parts from 0 to 1: the smallest clearance observed on the
motion, the smallest distance of a joint from its limits, the manipulability at the grasp, and the duration part

.. math:: \frac{T_0 + c}{T + c}

where T is the time of the motion at full speed, without stops at corners, and c is a constant. T_0 is a lower bound of
that time over all configurations at the grasp, so the score of one does not depend on which others were planned.

A part of the motion bounds the score from above: its clearance and its distance from limits are at least those of the
complete motion, and a motion takes at least the time of the joint with the longest travel, from home to the start of
the approach, to the grasp, to the end of the retreat, and to the release. Where the closed form gives every
configuration at these poses, the motion passes through one of them; otherwise only the grasp is used.

The search expands the candidate with the highest bound: first the configuration at the grasp, then its two lines at
each of their full rotations, then the transit, then the place. It stops when no bound exceeds the best score of a
complete motion, so that the result is the same as if all candidates had been planned.

Source of the search: A. Land, A. Doig (1960), "An automatic method of solving discrete programming problems",
Econometrica 28(3).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.motion import CubicPath, JointPath
from pinproof.picks.input.pick import Member
from pinproof.picks.judging.configurations import TURN, at_full_speed, least_seconds
from pinproof.picks.judging.grasp import AMPLE, Candidate, every_branch, limit_margin
from pinproof.picks.judging.lines import Crossing, Way, along, transit, whole_turns
from pinproof.picks.judging.place import Placer, Placing, Release
from pinproof.picks.judging.task import Task
from pinproof.picks.judging.verdict import Stage, StageResult

__all__ = ["BestFirst", "Scoring", "Whole"]

Array = npt.NDArray[np.float64]

INSTANT = 0.1
"""Seconds that are added to durations before they are compared: what differs by less is as good."""

TURNS = range(-2, 3)
"""Whole turns at which a joint is looked for inside its limits; limits that are wider bound nothing anyway."""

MANY = 64
"""Grasps of a family up to which the poses at the ends of their lines are solved, to bound the time more closely."""


@dataclass(frozen=True, eq=False)
class Scoring:
    """How the whole picks from some configurations are scored.

    Parameters
    ----------
    bounds
        (k,) the score that a whole pick from each configuration has at most, at whichever whole turns.
    least
        T_0, in seconds.
    """

    task: Task
    bounds: Array
    least: float

    @classmethod
    def of(cls, task: Task, candidates: tuple[Candidate, ...], rest: Callable[[Member, Array, bool], Array]) -> Scoring:
        """The scoring of picks from some configurations; ``rest`` is :meth:`Placer.rest`."""
        seconds = np.empty(len(candidates))
        members: dict[str, list[int]] = {}
        for i, candidate in enumerate(candidates):
            members.setdefault(candidate.member.words, []).append(i)
        exact = len(members) <= MANY and task.cell.closed_form
        for own in members.values():
            q, member = np.array([candidates[i].q for i in own]), candidates[own[0]].member
            seconds[own] = _least(task, q, member, rest, exact)
        least = float(seconds.min(initial=np.inf))
        margins = _widest(task.arm, np.array([candidate.q for candidate in candidates]).reshape(-1, task.arm.dof))
        clearances = np.array([candidate.clearance for candidate in candidates])
        volumes = np.array([candidate.parts["manipulability"] for candidate in candidates])
        return cls(task, _sum(_parts(least, clearances, margins, volumes, seconds), task), least)

    def scores(self, clearance: float, margins: Array, manipulability: float, seconds: Array) -> Array:
        """(k,) the weighted sums of the parts."""
        return _sum(_parts(self.least, np.array(clearance), margins, np.array(manipulability), seconds), self.task)

    def parts(self, clearance: float, margin: float, manipulability: float, seconds: float) -> dict[str, float]:
        """The four parts (0 to 1), and their weighted sum as ``score``."""
        told = (np.array(each) for each in (clearance, margin, manipulability, seconds))
        parts = _parts(self.least, *told)
        return {**{name: float(part) for name, part in parts.items()}, "score": float(_sum(parts, self.task))}


def _parts(least: float, clearance: Array, margin: Array, manipulability: Array, seconds: Array) -> dict[str, Array]:
    return {
        "clearance": np.clip(clearance, 0.0, AMPLE) / AMPLE,
        "limit_margin": margin,
        "manipulability": manipulability,
        "duration": (least + INSTANT) / (seconds + INSTANT),
    }


def _sum(parts: dict[str, Array], task: Task) -> Array:
    weights = task.cell.weights
    return np.asarray(sum(getattr(weights, name) * part for name, part in parts.items()))


def _least(task: Task, q: Array, member: Member, rest: Callable[[Member, Array, bool], Array], exact: bool) -> Array:
    """(k,) seconds that a whole pick takes at least that grasps at q (k, n)."""
    arm, home, grasp = task.arm, task.cell.home[None], task.grasp(member)
    ends = (task.approach_end(grasp), task.pick.approach), (task.retreat_end(grasp), task.pick.retreat)
    before, after = (every_branch(task, pose, exact and length > 0) for pose, length in ends)
    into = least_seconds(arm, home, q)[0]
    if len(before):
        into = (least_seconds(arm, home, before) + least_seconds(arm, q, before)).min(axis=1)
    if len(after):
        return np.asarray(into + (least_seconds(arm, q, after) + rest(member, after, exact)).min(axis=1))
    return np.asarray(into + rest(member, q, exact))


def _widest(arm: Arm, q: Array) -> Array:
    """(k,) what :func:`limit_margin` says of each of q (k, n) at most, at any whole turns inside the limits."""
    limits = arm.limits
    half = (limits.upper - limits.lower) / 2
    best = np.full(q.shape, -np.inf)
    for turns in TURNS:
        at = q + turns * TURN * arm.periodic
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.minimum(at - limits.lower, limits.upper - at) / half
        best = np.maximum(best, np.where(np.isfinite(share), share, 1.0))
    return np.asarray(np.clip(best.min(axis=1, initial=1.0), 0.0, 1.0))


Key = tuple[float, int, int]
"""What is taken first: minus its bound, then the place of its configuration, then of its whole turns."""


@dataclass(frozen=True, eq=False)
class Whole:
    """A pick that passed every stage but the timing, with the parts of its score."""

    way: Way
    stages: tuple[StageResult, ...]
    path: JointPath
    placing: Placing | None
    parts: dict[str, float]
    key: Key


@dataclass(order=True)
class _Open:
    """A way that may become a whole pick, at the whole turns it has."""

    key: Key
    way: Way = field(compare=False)
    shift: Array = field(compare=False)
    crossing: Crossing | None = field(default=None, compare=False)

    def moved(self) -> Way:
        """The way at its whole turns."""
        return replace(self.way, shift=self.shift)


class BestFirst:
    """The search.

    Parameters
    ----------
    task
        The pick.
    candidates
        Free configurations at the grasp.
    seeds
        Two: of plans, and of what shortens them.
    bounded
        Whether it ends where no bound is above the best score; else all are made, within the budget.
    """

    def __init__(
        self, task: Task, candidates: tuple[Candidate, ...], seeds: list[int], *, bounded: bool = True
    ) -> None:
        self._task, self._budget, self._seeds, self._bounded = task, task.cell.budget, seeds, bounded
        self._candidates = candidates
        self._placer = Placer(task, seeds[0])
        self._scoring = Scoring.of(task, candidates, self._placer.rest)
        self._order = np.argsort(-self._scoring.bounds, kind="stable").tolist()
        self._next = 0
        self._open: list[_Open] = []
        self._stuck: set[int] = set()
        self.ways: list[Way] = []
        """As far as each configuration came whose lines were tried."""
        self.wholes: list[Whole] = []
        """Those that were made and not given up."""
        self.made = 0
        """How many there were in all."""
        self.failed: list[tuple[StageResult, ...]] = []
        """What was said of ways whose lines are possible, and which are not whole."""

    # -- what is known ------------------------------------------------------------------------------------------------

    @property
    def best(self) -> Whole | None:
        """The best of those made."""
        return min(self.wholes, key=lambda whole: whole.key, default=None)

    @property
    def excluded(self) -> int:
        """How many cannot be better than the best by their bounds: configurations, and whole turns of those tried."""
        best = self.best
        if best is None:
            return 0
        bounds = self._scoring.bounds
        left = sum((-float(bounds[i]), i, 0) > best.key for i in self._order[self._next :])
        return left + sum(each.key > best.key and each.key[1] not in self._stuck for each in self._open)

    @property
    def untried(self) -> int:
        """How many could be better, and were not tried because a budget ran out."""
        left = len(self._order) - self._next
        return left + sum(each.key[1] not in self._stuck for each in self._open) - self.excluded

    # -- the search ---------------------------------------------------------------------------------------------------

    def run(self) -> Whole | None:
        """The best whole pick; None if none was found within the budget."""
        while self.made < self._budget.compared:
            best, key = self.best, self._first()
            if key is None or (self._bounded and best is not None and key > best.key):
                break
            self._step()
        return self.best

    def give_up(self, whole: Whole, told: tuple[StageResult, ...]) -> None:
        """It came out that a whole pick is none."""
        self.wholes.remove(whole)
        self.failed.append(told)

    def anyhow(self) -> Whole | None:
        """One of the ways that have lines, by trees with the larger budget; None if there is none."""
        while self._next < len(self._order) and len(self.ways) < self._budget.configurations:
            self._lines()
        passed = [way for way in self.ways if way.passed]
        if not passed or any(told[-1].stage is not Stage.TRANSIT for told in self.failed):
            return None
        home = self._task.cell.home
        every = [replace(way, shift=shift) for way in passed for shift in whole_turns(self._task.arm, home, way)]
        crossing = transit(self._task, every, self._budget.nodes, self._seeds)
        if crossing.way is None:
            self.failed.append((*passed[0].stages, crossing.result))
            return None
        self._place((0.0, 0, 0), crossing)
        return self.best

    def _first(self) -> Key | None:
        """The key of what is next: the first of the open ways, or a configuration that was not looked at yet."""
        while self._open and self._open[0].key[1] in self._stuck:
            heapq.heappop(self._open)
        keys = [self._open[0].key] if self._open else []
        if self._next < len(self._order) and len(self.ways) < self._budget.configurations:
            keys.append(self._unseen())
        return min(keys, default=None)

    def _unseen(self) -> Key:
        index = self._order[self._next]
        return -float(self._scoring.bounds[index]), index, -1

    def _step(self) -> None:
        """Take what is first a step further."""
        if not self._open or self._first() != self._open[0].key:
            self._lines()
            return
        here = heapq.heappop(self._open)
        if here.crossing is not None:
            self._place(here.key, here.crossing)
            return
        crossing = transit(self._task, [here.moved()], self._budget.quick_nodes, self._seeds)
        if crossing.way is None:
            self._stop(here.key, (*here.way.stages, crossing.result))
        elif self._task.place is None:
            self._place(here.key, crossing)
        else:
            score = self._parts(crossing, None)["score"]
            heapq.heappush(self._open, _Open((-score, *here.key[1:]), here.way, here.shift, crossing))

    def _lines(self) -> None:
        """The lines of the next configuration, and with them its whole turns."""
        index = self._order[self._next]
        self._next += 1
        way = along(self._task, self._candidates[index])
        self.ways.append(way)
        if not way.passed:
            return
        shifts = whole_turns(self._task.arm, self._task.cell.home, way)
        for k, (score, shift) in enumerate(zip(self._bounds(way, shifts).tolist(), shifts, strict=True)):
            heapq.heappush(self._open, _Open((-score, index, k), way, shift))

    def _place(self, key: Key, crossing: Crossing) -> None:
        """The last step: down it goes, and the pick is whole."""
        way, path = crossing.way, crossing.path
        if way is None or path is None:
            return
        placed, placing = self._placer.place(
            way, self._seeds, lambda placing, seconds: self._parts(crossing, placing, seconds)["score"]
        )
        told = (*way.stages, crossing.result, placed)
        if not placed.ok:
            self._stop(key, told)
            return
        parts = self._parts(crossing, placing)
        self.wholes.append(Whole(way, told, path, placing, parts, (-parts["score"], *key[1:])))
        self.made += 1

    def _stop(self, key: Key, told: tuple[StageResult, ...]) -> None:
        """What stopped one way stops its other whole turns, as far as this search goes."""
        self._stuck.add(key[1])
        self.failed.append(told)

    # -- scores -------------------------------------------------------------------------------------------------------

    def _bounds(self, way: Way, shifts: Array) -> Array:
        """(k,) what the score is at most of whole picks with the lines of a way, at whole turns (k, n)."""
        arm, (low, high) = self._task.arm, way.span()
        far = np.abs(way.entrance + shifts - self._task.cell.home)
        seconds = (far / arm.limits.velocity).max(axis=1) + self._rest(way)
        seconds += sum(at_full_speed(arm, each) for each in _points([way.approach, way.retreat], arm.dof))
        margins = limit_margin(self._task, low + shifts, high + shifts)
        clearance = min(way.candidate.clearance, way.clearance)
        return self._scoring.scores(clearance, margins, way.candidate.parts["manipulability"], seconds)

    def _rest(self, way: Way) -> float:
        """Seconds that it takes at least from the end of the retreat on."""
        return float(self._placer.rest(way.candidate.member, way.exit[None])[0])

    def _parts(self, crossing: Crossing, placing: Placing | Release | None, more: float = 0.0) -> dict[str, float]:
        """The parts of the score of a whole pick; of one without a placing, or with a release alone, upper bounds.

        ``more`` are seconds to add: the least that the transfer to the release takes.
        """
        way, arm = crossing.way, self._task.arm
        if way is None:
            raise InputError("a transit that leads nowhere has no score")
        curves: list[CubicPath | JointPath | None] = [crossing.path, way.line_in(), way.line_out()]
        clearances = [way.candidate.clearance, way.clearance, crossing.clearance]
        seconds = more
        if isinstance(placing, Placing):
            curves += [placing.transfer, placing.lift, placing.leave]
        elif placing is not None:
            seconds += sum(at_full_speed(arm, each) for each in _points([placing.lift, placing.leave], arm.dof))
        if placing is not None:
            clearances.append(placing.clearance)
        else:
            seconds += self._rest(way)
        points = [way.q[None], *_points(curves, arm.dof)]
        every = np.vstack(points)
        seconds += sum(at_full_speed(arm, each) for each in points)
        margin = float(limit_margin(self._task, every.min(axis=0), every.max(axis=0)))
        return self._scoring.parts(min(clearances), margin, way.candidate.parts["manipulability"], seconds)


def _points(curves: list[CubicPath | JointPath | None], n: int) -> Iterator[Array]:
    """(k, n) the control points of each curve there is."""
    for curve in curves:
        if curve is not None:
            yield curve.bezier()[1].reshape(-1, n)
