"""Suggestions: the smallest changes of a failed pick that help, each judged as a complete pick before it is printed.

The kinds of change are a shorter line, a vertical retreat, a turn about the approach direction, a tilt, a shift of the
pick, and a shift of its place. The candidates of each kind are ordered by size. A candidate is written as text, the
text is applied to the pick (:func:`pinproof.picks.apply_suggestion`), and the result is judged through all stages, so
the printed text is exactly what was judged. The suggestion is the smallest judged candidate of its kind with a good
verdict. If none is good, it is the smallest candidate that passes the stage that failed, and the text states the later
stage at which it fails.

If a pick takes an obstacle of the scene and places it, the grasp and the place move together, so that the object is put
down at the same pose. An object that the pick itself describes is attached to the tip and moves with the pick alone.

The budget is a number of judged picks (:attr:`pinproof.picks.PickBudget.remedies`), not a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof.picks.input.pick import ROOT, Pick
from pinproof.picks.judging.changes import (
    REMARK,
    UPWARDS,
    Change,
    ChangesOf,
    Shift,
    place_shifts,
    shifts_of,
    shorten_words,
    tilts,
    turns,
)
from pinproof.picks.judging.configurations import configurations
from pinproof.picks.judging.lines import Attempt, line_in, line_out
from pinproof.picks.judging.task import PickTask
from pinproof.picks.judging.verdict import PickVerdict, Stage, StageResult
from pinproof.spatial import Array

Judge = Callable[[Pick], PickVerdict]

FRACTIONS = (0.25, 0.5, 0.75, 1.0)
"""Fractions of the approach at which the screening requires a free configuration."""

CHECKS = 4
"""Number of cheap checks of candidates for each candidate that is judged."""

REFINEMENTS = 5
"""Number of picks judged between two distances of which the larger is good; enough to bisect 20 mm."""

UP = (0.0, 0.0, 1.0)

STEP = 1e-3
"""Metres: suggested lengths are multiples of this."""

NO_SUGGESTION = (Stage.INPUT, Stage.TRANSIT, Stage.TIMING)
"""Stages whose failure a small change of the pick cannot systematically correct: invalid input, or a limited search."""

ORDER = list(Stage)


class _Trials:
    """Judges candidates, each at most once, within a budget; keeps the smallest good one and the smallest that helps.

    ``possible`` is a cheap check that a candidate may be good; it has a separate, larger budget.
    """

    def __init__(self, judge: Judge, failed: Stage, budget: int, possible: Callable[[Pick], bool]) -> None:
        self._judge, self._failed, self.left = judge, ORDER.index(failed), budget
        self._possible, self._checks = possible, CHECKS * budget
        self._seen: dict[str, bool] = {}
        self.best: Change | None = None
        """The smallest good change so far."""
        self._helps: tuple[Change, str] | None = None

    def good(self, candidate: Change) -> bool:
        """Whether the changed pick is good; also False if the budget is exhausted."""
        if candidate.words in self._seen:
            return self._seen[candidate.words]
        if self.left <= 0:
            return False
        if self._checks > 0 and not self._possible(candidate.pick):
            self._checks -= 1
            self._seen[candidate.words] = False
            return False
        self.left -= 1
        verdict = self._judge(candidate.pick)
        self._seen[candidate.words] = verdict.ok
        if verdict.ok and (self.best is None or candidate.size < self.best.size):
            self.best = candidate
        helps = verdict.failed is not None and ORDER.index(verdict.failed) > self._failed
        if verdict.failed is not None and helps and (self._helps is None or candidate.size < self._helps[0].size):
            self._helps = candidate, verdict.failed.value
        return verdict.ok

    def words(self) -> str:
        """The suggestion; empty if no candidate helps."""
        if self.best is not None:
            return self.best.words
        if self._helps is None:
            return ""
        candidate, stage = self._helps
        return f"{candidate.words}{REMARK}passes the {ORDER[self._failed].value} stage and fails at the {stage} stage"


def suggest(task: PickTask, pick: Pick, failed: StageResult, attempt: Attempt | None, judge: Judge) -> tuple[str, ...]:
    """Suggestions for a pick as it was stated, one line for each kind of change; empty if nothing was found.

    If a line failed, ``attempt`` is the one that passed the most stages. ``judge`` gives the verdict on a changed pick,
    without suggestions.
    """
    budget, stage = task.cell.budget.remedies, failed.stage
    if not budget or stage in NO_SUGGESTION:
        return ()

    def trials() -> _Trials:
        return _Trials(
            judge, stage, budget, lambda other: stage is not Stage.RETREAT or _retreat_ends_free(task, other)
        )

    found = []
    if attempt is not None and stage in (Stage.APPROACH, Stage.RETREAT):
        found.append(_shorter(task, pick, stage, attempt, trials()))
    if attempt is not None and stage is Stage.RETREAT and (pick.retreat_frame, pick.retreat_direction) != (ROOT, UP):
        upwards = trials()
        upwards.good(Change(UPWARDS, pick, 0.0))
        found.append(upwards.words())
    if stage is Stage.PLACE and pick.place is not None:
        found.append(_nearest_shift(*place_shifts(task, pick), partial(_screened_places, task), trials()))
    if not task.pick.spin.sampled:
        found.append(_nearest(_screened(task, turns(task, pick)), trials()))
    found.append(_nearest(_screened(task, tilts(task, pick)), trials()))
    found.append(_nearest_shift(*shifts_of(task, pick, stage), partial(_screened, task), trials()))
    return tuple(filter(None, found))


# -- lengths ----------------------------------------------------------------------------------------------------------


def _shorter(task: PickTask, pick: Pick, stage: Stage, attempt: Attempt, trials: _Trials) -> str:
    """The longest good approach or retreat of those tried, with a resolution of one millimetre."""
    key = stage.value
    stated = float(getattr(pick, key))
    length = np.floor(attempt.fraction * stated / STEP) * STEP
    for _ in range(trials.left):  # the line alone costs much less than a judged pick
        if not 0 < length < stated:
            return ""
        shorter = PickTask(replace(task.pick, **{key: float(length)}), task.cell)  # type: ignore[arg-type]
        line = (
            line_in(shorter, attempt.candidate) if stage is Stage.APPROACH else line_out(shorter, attempt.candidate)[0]
        )
        if line.result.ok:
            break
        length = np.floor(min(line.fraction * length, length - STEP) / STEP) * STEP

    def to_length(steps: int) -> Change:
        return Change(shorten_words(key, stated, steps * STEP), pick, stated - steps * STEP)

    low, high = round(length / STEP), int(np.ceil(stated / STEP - 1e-9))
    if low <= 0 or not trials.good(to_length(low)):
        return trials.words()
    step = 1  # other configurations may allow more
    while low + step < high and trials.good(to_length(low + step)):
        low, step = low + step, 2 * step
    return trials.words()


# -- screening --------------------------------------------------------------------------------------------------------


def _screened(task: PickTask, candidates: list[Change]) -> list[Change]:
    """The candidates with a grasp that has a free configuration, also on its approach; the others are not good."""
    changed, pick = _ChangedPoses(task, candidates, "grasp"), task.pick
    fractions = FRACTIONS if task.cell.closed_form and pick.approach > 0 else ()
    at = np.arange(len(changed.owner))
    for fraction in (0.0, *fractions):
        at = at[_has_free(task, changed.targets(fraction)[at])]
    left = [candidates[i] for i in sorted(set(changed.owner[at].tolist()))]
    return left if task.place is None else _screened_places(task, left)


def _screened_places(task: PickTask, candidates: list[Change]) -> list[Change]:
    """The candidates whose place is in reach."""
    changed = _ChangedPoses(task, candidates, "release")
    row, _ = configurations(task.arm, changed.targets(), task.cell.home, 0)
    return [candidates[i] for i in sorted(set(changed.owner[row].tolist()))]


class _ChangedPoses:
    """The poses of the tip at the grasps or releases of candidates; ``owner`` (N,) is the candidate of each.

    The changed pick is only made where more than the position changes.
    """

    def __init__(self, task: PickTask, candidates: list[Change], which: Literal["grasp", "release"]) -> None:
        self._task, self._which, self._count = task, which, len(candidates)
        self._changed = {
            i: PickTask(each.pick, task.cell) for i, each in enumerate(candidates) if not each.displacement
        }
        counts = [len(self._changed.get(i, task).nearest_group) for i in range(len(candidates))]
        self.owner = np.repeat(np.arange(len(candidates)), counts)
        rotation, still = task.arm.root_from_base.rotation.T, np.zeros(3)
        shifts = [rotation @ getattr(each.displacement, which) if each.displacement else still for each in candidates]
        self._shifts = np.array(shifts).reshape(-1, 3)[self.owner]

    def targets(self, share: float = 0.0) -> Array:
        """(N, 4, 4) ``base_from_tcp`` at each of them, or at a share of the approach before it."""
        stated = self._of(self._task, share)
        each = (self._of(self._changed[i], share) if i in self._changed else stated for i in range(self._count))
        found = np.concatenate([*each, np.empty((0, 4, 4))])
        found[:, :3, 3] += self._shifts
        return found

    def _of(self, task: PickTask, share: float) -> Array:
        at = task.grasp if self._which == "grasp" else task.release
        return task.targets([task.pick.before(at(member), share) for member in task.nearest_group])


def _retreat_ends_free(task: PickTask, pick: Pick) -> bool:
    """Whether a free configuration was found at the end of the retreat, with the object in the hand."""
    changed = PickTask(pick, task.cell)
    grasps = changed.nearest_group
    if len(grasps) > 1:  # each needs a separate checker
        return True
    _, q = configurations(task.arm, task.targets([changed.pick.after(changed.grasp(grasps[0]))]), task.cell.home, 0)
    return bool(changed.carrying(grasps[0]).is_free_batch(q).any())


def _has_free(task: PickTask, targets: Array) -> npt.NDArray[np.bool_]:
    """(N,) whether a configuration that is free at the grasp was found for each target (N, 4, 4)."""
    found = np.zeros(len(targets), dtype=bool)
    if len(targets):
        row, q = configurations(task.arm, targets, task.cell.home, 0)
        found[row[task.at_grasp.is_free_batch(q)]] = True
    return found


# -- search -----------------------------------------------------------------------------------------------------------


def _nearest(candidates: list[Change], trials: _Trials) -> str:
    """The suggestion of the smallest good candidate of those that the budget allows to judge.

    All are judged in order of size if the budget allows. Otherwise a few distances along the axes come first; then each
    direction is bisected below the best change found, and the rest of the budget is spent on the others by size.
    """
    if len(candidates) > trials.left:
        for each in candidates:
            if each.early and trials.good(each):
                break
        directions = dict.fromkeys(each.direction for each in candidates)
        first = [] if trials.best is None else [trials.best.direction]
        for direction in [*first, *directions] if trials.best is not None else ():
            _bisect([each for each in candidates if each.direction == direction], trials)
    for each in candidates:
        if trials.best is not None and each.size >= trials.best.size:
            break
        trials.good(each)
    return trials.words()


def _nearest_shift(
    shifts: list[Shift],
    changes_of: ChangesOf,
    screened: Callable[[list[Change]], list[Change]],
    trials: _Trials,
) -> str:
    """The result of :func:`_nearest` for shifts, bisected to whole millimetres along the direction of the best one."""
    _nearest(screened(changes_of(shifts)), trials)
    best = trials.best
    if best is not None and len(best.direction) == len(best.pick.pose.translation):
        along = np.array(best.direction, dtype=float)
        steps = [round(float(each.by @ along / (along @ along))) for each in shifts if each.direction == best.direction]
        last = round(best.size / float(np.linalg.norm(along)))
        first = max((step for step in steps if step < last), default=0) + 1
        trials.left = max(trials.left, REFINEMENTS)
        between = [Shift(step * along, best.direction, early=False) for step in range(first, last)]
        _bisect(changes_of(between), trials)
    return trials.words()


def _bisect(line: list[Change], trials: _Trials) -> None:
    """Look for a smaller good candidate along one direction, where the larger ones are more likely to be good."""
    best = trials.best
    line = [each for each in line if best is None or each.size < best.size]
    if not line or (best is not None and best.direction != line[0].direction and not trials.good(line[-1])):
        return
    low, high = -1, len(line) - 1 if best is not None and best.direction != line[0].direction else len(line)
    while high - low > 1:
        middle = (low + high) // 2
        if trials.good(line[middle]):
            high = middle
        else:
            low = middle
