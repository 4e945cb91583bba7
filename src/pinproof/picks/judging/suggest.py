"""Suggestions: the smallest changes of a failed pick that help, each judged as a complete pick before it is made.

The kinds of change are a shorter line, a vertical retreat, a larger force or friction of the grip, a turn about the
approach direction, a tilt, a shift of the pick, and a shift of its place. The candidates of each kind are ordered by
size. A candidate is a :class:`Suggestion` with every number as its text states it; it is applied to the pick, and the
result is judged through all stages, so the printed text is exactly what was judged. The suggestion is the smallest
judged candidate of its kind with a good verdict. If none is good, it is the smallest candidate that passes the stage
that failed, and the text states the later stage at which it fails.

If a pick takes an obstacle of the scene and places it, the grasp and the place move together, so that the object is put
down at the same pose. An object that the pick itself describes is attached to the tip and moves with the pick alone.

The budget is a number of judged picks (:attr:`pinproof.picks.PickBudget.remedies`), not a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import product
from typing import Literal, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from pinproof.common.steps import SUGGESTIONS, step
from pinproof.ik import Clik
from pinproof.motion import read_only
from pinproof.picks.input.pick import ROOT, TIP, Pick
from pinproof.picks.judging.configurations import configurations, has_closed_form
from pinproof.picks.judging.lines import Attempt, line_in, line_out
from pinproof.picks.judging.task import PickTask
from pinproof.picks.judging.verdict import PickVerdict, Stage, StageResult, Suggestion
from pinproof.planning import RouteFollower
from pinproof.spatial import SE3, Array, rotation_about, translated

Vector = tuple[float, float, float]

Indices = npt.NDArray[np.int64]

Flags = npt.NDArray[np.bool_]

UP: Vector = (0.0, 0.0, 1.0)

RESOLUTION = 0.01
"""Millimetres: lengths and components of vectors are multiples of this."""


@dataclass(frozen=True, kw_only=True)
class ShiftSuggestion(Suggestion):
    """Move the pick, its place, or both.

    Parameters
    ----------
    by, place_by
        (3,) millimetres in the frame in which the pick, or its place, is stated; None if it is not moved.
    frame, place_frame
        These frames; empty for the root link of the robot, the base frame.
    """

    by: Vector | None = None
    frame: str = ""
    place_by: Vector | None = None
    place_frame: str = ""

    @property
    def text(self) -> str:
        """The change in one line."""
        moves = []
        for what, by, frame in self._moves():
            axes = [axis for axis in range(3) if by[axis]]
            words = f"by ({', '.join(('+' if value > 0 else '') + _digits(value) for value in by)}) mm"
            if len(axes) == 1:
                along = by[axes[0]]
                words = f"{_digits(abs(along))} mm along {'+' if along > 0 else '-'}{'xyz'[axes[0]]}"
            moves.append(f"the {what} {words} ({_frame_words(frame)})")
        return f"move {' and '.join(moves)}"

    def _changed(self, pick: Pick) -> Pick:
        for what, by, frame in self._moves():
            thing = pick if what == "pick" else pick.place
            if thing is None or thing.frame != frame:
                own = "" if thing is None else f"its {what} is stated in the {_frame_words(thing.frame)}"
                raise self.does_not_fit(pick, own or "no place")
            moved = replace(thing, pose=translated(thing.pose, np.array(by) / 1e3))
            pick = moved if isinstance(moved, Pick) else replace(pick, place=moved)
        return pick

    def _moves(self) -> list[tuple[str, Vector, str]]:
        stated = ("pick", self.by, self.frame), ("place", self.place_by, self.place_frame)
        return [(what, by, frame) for what, by, frame in stated if by is not None]


def _digits(value: float) -> str:
    return f"{value + 0.0:.2f}".rstrip("0").rstrip(".")


def _frame_words(frame: str) -> str:
    return f"frame '{frame}'" if frame else "base frame"


@dataclass(frozen=True, kw_only=True)
class TurnSuggestion(Suggestion):
    """Turn the pick, and perhaps its place, by an angle in degrees about an axis (3,) of the tip."""

    degrees: float
    axis: Vector
    with_place: bool

    @classmethod
    def about(cls, axis: Array, degrees: float, *, with_place: bool) -> TurnSuggestion:
        """The turn about a unit vector (3,), which is rounded to six digits; its largest component is positive."""
        main = int(np.argmax(np.abs(axis)))
        sign = -1.0 if axis[main] < 0 else 1.0
        x, y, z = (np.round(sign * axis, 6) if abs(axis[main]) <= 1 - 1e-12 else np.eye(3)[main]).tolist()
        return cls(degrees=sign * degrees, axis=(x, y, z), with_place=with_place)

    @property
    def text(self) -> str:
        """The change in one line."""
        about = f"({', '.join(f'{value:.6f}' for value in self.axis)})"
        if sorted(self.axis) == [0.0, 0.0, 1.0]:
            about = f"the {'xyz'[self.axis.index(1.0)]} axis"
        what = "the pick and the place" if self.with_place else "the pick"
        return f"turn {what} by {self.degrees:+g} deg about {about} of the tip"

    def _changed(self, pick: Pick) -> Pick:
        axis = np.array(self.axis)
        turn = SE3(rotation_about(axis / np.linalg.norm(axis), np.radians(self.degrees)), np.zeros(3))
        if not self.with_place:
            return replace(pick, pose=pick.pose * turn)
        if pick.place is None or pick.place.pose_of != TIP:
            what = "it has no place" if pick.place is None else "its place is stated as the pose of the object"
            raise self.does_not_fit(pick, what)
        return replace(pick, pose=pick.pose * turn, place=replace(pick.place, pose=pick.place.pose * turn))


@dataclass(frozen=True, kw_only=True)
class LengthSuggestion(Suggestion):
    """Shorten the ``approach`` or the ``retreat``; the lengths are in millimetres."""

    line: Literal["approach", "retreat"]
    before: float
    after: float

    @property
    def text(self) -> str:
        """The change in one line."""
        return f"shorten the {self.line} from {self.before:.10g} mm to {self.after:.10g} mm"

    def _changed(self, pick: Pick) -> Pick:
        stated = getattr(pick, self.line)
        if abs(stated - self.before / 1e3) > RESOLUTION / 1e3:
            raise self.does_not_fit(pick, f"its {self.line} is {stated * 1e3:g} mm")
        after = self.after / 1e3
        return replace(pick, approach=after) if self.line == "approach" else replace(pick, retreat=after)


@dataclass(frozen=True, kw_only=True)
class RetreatSuggestion(Suggestion):
    """Retreat along the z axis of the root link of the robot."""

    @property
    def text(self) -> str:
        """The change in one line."""
        return "retreat straight up, along +z (base frame)"

    def _changed(self, pick: Pick) -> Pick:
        return replace(pick, retreat_direction=UP, retreat_frame=ROOT)


@dataclass(frozen=True, kw_only=True)
class GripSuggestion(Suggestion):
    """Grip with a larger force (N) or more friction; ``value`` is the key of a pick, such as ``grip_limits.force``."""

    value: str
    before: float
    after: float

    @property
    def text(self) -> str:
        """The change in one line."""
        unit = " N" if self.value.endswith("force") else ""
        return f"raise `{self.value}` from {self.before:.4g}{unit} to {self.after:.10g}{unit}"

    def _changed(self, pick: Pick) -> Pick:
        hand, name = self.value.split(".")
        own = pick.cup if hand == "cup" else pick.grip_limits
        if own.get(name, self.before) != self.before:
            raise self.does_not_fit(pick, f"its {name} is {own[name]:g}")
        changed = {**own, name: self.after}
        return replace(pick, cup=changed) if hand == "cup" else replace(pick, grip_limits=changed)


# -- candidates -------------------------------------------------------------------------------------------------------

DISTANCES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100)
"""Millimetres by which a pick is moved."""

FEW_DISTANCES = (1, 2, 5, 10, 20, 50, 100)
"""Those of them that are tried if all of them exceed the budget of the screening."""

FIRST_DISTANCES, FIRST_STRETCHES, FIRST_TURNS, FIRST_TILTS = (5, 20, 50, 100), (1.1, 1.5), (45, 90, 135, 180), (10, 30)
"""Sizes that are tried first if not all can be judged, or if the screening does not decide which help."""

DIRECTIONS = sorted((d for d in product((0, 1, -1), repeat=3) if any(d)), key=lambda d: sum(map(abs, d)))
"""Directions along the axes of the frame of the pick, between two axes, and between all three."""

AXES = 6
"""Number of the directions that are axes; they are first."""

STRETCHES = (1.0, 1.01, 1.02, 1.04, 1.06, 1.08, 1.1, 1.15, 1.2, 1.25, 1.35, 1.5, 1.75, 2.0)
"""Shifts of a pose that is out of reach, as multiples of the gap to the nearest pose found by inverse kinematics."""

TURNS = tuple(range(15, 181, 15))
"""Degrees about the approach direction, to either side."""

TILTS = (5, 10, 15, 20, 30)
"""Degrees about the axes across the approach direction, to either side."""

STRONGER = (1.05, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0)
"""Forces and frictions, as multiples of those that carry the part at rest."""

MOST_FRICTION = 1.0
"""Largest friction that is suggested, that of rubber on dry parts."""

POSES = 6000
"""Poses of the tip, weighted by the cost of their inverse kinematics, that are screened before any pick is judged."""

SWEPT, SEARCHED = 8, 40
"""The weight of a pose where a redundant joint is swept, and where a numerical method searches; 1 in closed form."""


class Shift(NamedTuple):
    """A shift by (3,) mm and its length; those along an axis of the frame, or between axes, have a direction."""

    by: Array
    size: float
    direction: tuple[int, ...] = ()
    is_first: bool = False


@dataclass(eq=False)  # frozen ones take three times as long to make, and a pick has 500
class Change:
    """A candidate for a pick: its size (mm, degrees, or metres of lost length) and, of a shift, its direction.

    Most candidates are never judged, so ``make`` states the suggestion when it is asked for. If only positions change,
    ``moves`` are the displacements (2, 3) of the tip in the root frame (m), at the grasp and at the release, and they
    are screened without the changed pick.
    """

    stated: Pick
    make: Callable[[], Suggestion]
    size: float
    direction: tuple[int, ...] = ()
    moves: Array | None = None

    @cached_property
    def suggestion(self) -> Suggestion:
        """The change as it is stated."""
        return self.make()

    @cached_property
    def pick(self) -> Pick:
        """The changed pick."""
        return self.suggestion.apply(self.stated)


def _keeps_place(task: PickTask, pick: Pick) -> bool:
    """Whether the place moves with the grasp, so that the object is still put down at the requested pose."""
    return pick.place is not None and pick.place.pose_of == TIP and task.from_scene


def _shift_changes(task: PickTask, pick: Pick, shifts: Iterable[Shift], *, of_place: bool) -> list[Change]:
    """The pick, and its place with it if it keeps it, or its place alone, moved by shifts, by length."""
    ordered, place = sorted(shifts, key=lambda shift: shift.size), pick.place
    # Millimetres, as printed, by which the pick and its place are moved, each in the frame in which it is stated
    by = np.array([shift.by for shift in ordered]).reshape(-1, 3)
    own, other = None if of_place else np.round(by, 2) + 0.0, None
    if place is not None and (of_place or _keeps_place(task, pick)):
        turned = np.eye(3) if of_place else place.pose.rotation @ pick.pose.rotation.T
        other = np.round(by @ turned.T, 2) + 0.0

    def moved(k: int) -> Suggestion:
        pick_by, place_by = (None if each is None else cast(Vector, tuple(each[k].tolist())) for each in (own, other))
        frames = "" if pick_by is None else pick.frame, "" if place is None or place_by is None else place.frame
        return ShiftSuggestion(by=pick_by, frame=frames[0], place_by=place_by, place_frame=frames[1])

    # The displacements of the tip. At a release that is stated as a pose of the object, it changes with the grasp
    moves = np.zeros((len(ordered), 2, 3))
    for at, (each, thing) in enumerate(((own, pick), (other, place))):
        if each is not None and thing is not None:
            moves[:, at] = each / 1e3 @ task.root_from(thing.frame).rotation.T
    known = place is None or other is not None or place.pose_of == TIP
    return [
        Change(pick, partial(moved, k), each.size, each.direction, moves[k] if known else None)
        for k, each in enumerate(ordered)
    ]


@cache
def _vectors(distances: tuple[int, ...], directions: int) -> tuple[Shift, ...]:
    """Shifts by whole millimetres along the axes and between them."""
    shifts = []
    for distance, direction in product(distances, DIRECTIONS[:directions]):
        along = np.array(direction, dtype=float)
        by = along * max(1.0, np.round(distance / np.linalg.norm(along)))
        shifts.append(Shift(read_only(by), float(np.linalg.norm(by)), direction, distance in FIRST_DISTANCES))
    return tuple(shifts)


# -- trials -----------------------------------------------------------------------------------------------------------

SCREENED_TOGETHER = 32
"""Number of candidates that are screened in one call where they are judged by size."""

CHECKS = 4
"""Number of cheap checks of candidates for each candidate that is judged."""

STEP = 1e-3
"""Metres: suggested lengths are multiples of this."""

SCREENED = (Stage.REACH, Stage.LIMITS, Stage.SELF, Stage.GRASP, Stage.APPROACH)
"""Stages that the screening of candidates decides, except for rare cases."""

NO_SUGGESTION = (Stage.INPUT, Stage.TRANSIT, Stage.TIMING)
"""Stages whose failure a small change of the pick cannot systematically correct: invalid input, or a limited search."""

LAST = list(Stage)[-1]
"""The last stage: only good verdicts count if its failures do not."""


class _Trials:
    """Judges candidates, each at most once, within a budget; keeps the smallest good one and the smallest that helps.

    ``possible`` is a cheap check that a candidate may be good; it has a separate, larger budget. ``screen`` returns
    those of many candidates that may be good.
    """

    def __init__(
        self,
        judge: Callable[[Pick, Stage], PickVerdict],
        failed: Stage,
        budget: int,
        possible: Callable[[Pick], bool],
        screen: Callable[[list[Change]], list[Change]],
    ) -> None:
        self._judge, self._failed, self.left = judge, failed, budget
        self._possible, self._checks, self.screen = possible, CHECKS * budget, screen
        self._seen: dict[Suggestion, bool] = {}
        self.best: Change | None = None
        """The smallest good change so far."""
        self._helps: tuple[Change, Stage] | None = None

    def good(self, candidate: Change) -> bool:
        """Whether the changed pick is good; also False if the budget is exhausted."""
        suggestion = candidate.suggestion
        if suggestion in self._seen:
            return self._seen[suggestion]
        if self.left <= 0:
            return False
        if self._checks > 0 and not self._possible(candidate.pick):
            self._checks -= 1
            self._seen[suggestion] = False
            return False
        self.left -= 1
        # A failure at a later stage only matters as long as no smaller change is known to help
        may_help = self.best is None and (self._helps is None or candidate.size < self._helps[0].size)
        verdict = self._judge(candidate.pick, self._failed if may_help else LAST)
        self._seen[suggestion] = verdict.ok
        if verdict.ok and (self.best is None or candidate.size < self.best.size):
            self.best = candidate
        if may_help and verdict.failed is not None and verdict.failed.is_later_than(self._failed):
            self._helps = candidate, verdict.failed
        return verdict.ok

    def suggestion(self) -> Suggestion | None:
        """The smallest good candidate, otherwise the smallest that helps; None if there is none."""
        if self.best is not None:
            return self.best.suggestion
        if self._helps is None:
            return None
        candidate, stage = self._helps
        effect = f"passes the {self._failed.value} stage and fails at the {stage.value} stage"
        return replace(candidate.suggestion, effect=effect)

    def nearest(
        self, candidates: list[Change], finer: Callable[[Change], list[Change]] = lambda _: []
    ) -> Suggestion | None:
        """The suggestion of the first good candidate of those, ordered by size, that pass the screening.

        They are screened in groups as the search proceeds, until one is good or the budget is exhausted. Before each,
        those that ``finer`` gives for it are judged, which pass the screening and are smaller.
        """
        for first in range(0, len(candidates), SCREENED_TOGETHER):
            for change in self.screen(candidates[first : first + SCREENED_TOGETHER]) if self.left > 0 else ():
                if any(map(self.good, (*finer(change), change))):
                    return self.suggestion()
        return self.suggestion()


@step(SUGGESTIONS)
def suggest(
    task: PickTask,
    pick: Pick,
    failed: StageResult,
    attempt: Attempt | None,
    judge: Callable[[Pick, Stage], PickVerdict],
) -> tuple[Suggestion, ...]:
    """Suggestions for a pick as it was stated, one for each kind of change; empty if nothing was found.

    If a line failed, ``attempt`` is the one that passed the most stages. ``judge`` gives the verdict on a changed pick,
    without suggestions, if only good verdicts and failures after a stage count.
    """
    # Only stages whose failure a small change can correct
    budget, stage = task.cell.budget.remedies, failed.stage
    if not budget or stage in NO_SUGGESTION or (stage is Stage.GRIP and task.cell.closed_contact is not None):
        return ()

    def possible(other: Pick) -> bool:
        """Whether a free configuration was found at the end of a retreat that failed, with the object in the hand."""
        changed = PickTask(other, task.cell) if stage is Stage.RETREAT else task
        grasps = changed.nearest_group
        if changed is task or len(grasps) > 1:  # each grasp needs a separate checker
            return True
        end = changed.pick.after(changed.grasp(grasps[0]))
        q = configurations(task.arm, task.targets([end]), task.cell.home, 0)[1]
        return bool(changed.carrying(grasps[0]).is_free_batch(q).any())

    def trials(*, of_place: bool = False) -> _Trials:
        return _Trials(judge, stage, budget, possible, partial(_screened, task, of_place=of_place))

    def rotated(axes: Iterable[Array], sizes: Iterable[int], first: tuple[int, ...]) -> Suggestion | None:
        """The smallest good rotation, to either side; a few are first if the screening does not decide the stage."""
        turned = partial(TurnSuggestion.about, with_place=_keeps_place(task, pick))
        turns = [(size, axis, sign * size) for size, axis, sign in product(sizes, axes, (1, -1)) if sign * size != -180]
        changes = [Change(pick, partial(turned, axis, float(turn)), float(size)) for size, axis, turn in turns]
        tried = trials()
        if stage not in SCREENED:
            tried.nearest([change for change in changes if change.size in first])
        best = tried.best
        return tried.nearest([change for change in changes if best is None or change.size < best.size])

    # A shorter line, or a retreat in another direction, if a line failed
    found: list[Suggestion | None] = []
    if attempt is not None and stage in (Stage.APPROACH, Stage.RETREAT):
        found.append(_shorter(task, pick, stage, attempt, trials()))
    if attempt is not None and stage is Stage.RETREAT and (pick.retreat_frame, pick.retreat_direction) != (ROOT, UP):
        upwards = trials()
        upwards.good(Change(pick, RetreatSuggestion, 0.0))
        found.append(upwards.suggestion())
    # A stronger grip if the part slips
    if stage is Stage.HOLD:
        found += [_stronger(task, pick, failed, name, trials()) for name in ("force", "friction")]
    # Another place, another rotation, another tilt, another position
    if stage is Stage.PLACE and pick.place is not None:
        found.append(_nearest_shift(task, pick, stage, trials(of_place=True), of_place=True))
    axis = task.pick.axis_in(task.pick.pose)
    if not task.pick.spin.sampled:
        found.append(rotated([axis], TURNS, FIRST_TURNS))
    across = np.delete(np.eye(3), int(np.argmax(np.abs(axis))), axis=0)
    found.append(rotated(across, TILTS, FIRST_TILTS))
    found.append(_nearest_shift(task, pick, stage, trials(), of_place=False))
    return tuple(suggestion for suggestion in found if suggestion is not None)


def _shorter(task: PickTask, pick: Pick, stage: Stage, attempt: Attempt, trials: _Trials) -> Suggestion | None:
    """The longest good approach or retreat of those tried, with a resolution of one millimetre."""
    key: Literal["approach", "retreat"] = "approach" if stage is Stage.APPROACH else "retreat"
    stated = float(getattr(pick, key))
    length = np.floor(attempt.fraction * stated / STEP) * STEP
    for _ in range(trials.left):  # the line alone costs much less than a judged pick
        if not 0 < length < stated:
            return None
        shorter = PickTask(replace(task.pick, **{key: float(length)}), task.cell)  # type: ignore[arg-type]
        candidate = attempt.candidate
        line = line_in(shorter, candidate) if stage is Stage.APPROACH else line_out(shorter, candidate)[0]
        if line.result.ok:
            break
        length = np.floor(min(line.fraction * length, length - STEP) / STEP) * STEP

    def to_length(steps: int) -> Change:
        before, after = round(stated * 1e3, 2), round(steps * STEP * 1e3, 2)
        return Change(pick, partial(LengthSuggestion, line=key, before=before, after=after), stated - steps * STEP)

    # The shortened line alone is possible; now the complete pick, and longer lines
    low, high = round(length / STEP), int(np.ceil(stated / STEP - 1e-9))
    if low <= 0 or not trials.good(to_length(low)):
        return trials.suggestion()
    step = 1  # other configurations may allow more
    while low + step < high and trials.good(to_length(low + step)):
        low, step = low + step, 2 * step
    return trials.suggestion()


def _stronger(
    task: PickTask, pick: Pick, failed: StageResult, name: Literal["force", "friction"], trials: _Trials
) -> Suggestion | None:
    """The smallest good force or friction of those tried, each a multiple of what carries the part at rest."""
    limits, cup = task.cell.shared.grip_limits, task.cell.shared.cup
    value = getattr(limits, name) if cup is None or getattr(cup, name) is None else getattr(cup, name)
    value = float(np.tan(limits.angle)) if value is None else value
    share = 1.0 - failed.figures.get("reserve", 0.0)  # slipping during a motion states none
    if not np.isfinite(share):  # at an edge, where no force helps
        share = np.nan if name == "force" else 1.0
    key = f"{'grip_limits' if cup is None else 'cup'}.{name}"
    values = [float(np.ceil(100.0 * share * factor * value) / 100.0) for factor in STRONGER]
    changes = [
        Change(pick, partial(GripSuggestion, value=key, before=value, after=after), after)
        for after in values
        if after > value and (name == "force" or after <= MOST_FRICTION)
    ]
    any(map(trials.good, changes))
    return trials.suggestion()


def _screened(task: PickTask, candidates: list[Change], *, of_place: bool = False) -> list[Change]:
    """The candidates that may be good.

    They have a grasp with a free configuration, from which the line of the approach can be followed to a free one, and
    a release in reach; if only the place is changed (``of_place``), the grasp is not checked.
    """
    home, arm, checker = task.cell.home, task.arm, task.at_grasp
    tasks = {change: PickTask(change.pick, task.cell) if change.moves is None else task for change in candidates}
    if not of_place:
        # Is a configuration at the grasp free, and one before the approach? That costs a tenth of following a line
        owner, targets = _poses_of(task, tasks, "grasp")
        left = np.arange(len(owner))

        def free_at(share: float) -> Indices:
            row, q = configurations(arm, targets(share)[left], home, 0)
            return left[_rows_that_pass(row, lambda tried: checker.is_free_batch(q[tried]))]

        for share in (0.0, 1.0) if task.pick.approach > 0 else (0.0,):
            left = free_at(share) if len(left) else left
        # Does a line connect two of them? How far the curve deviates between the solved poses is not bounded here
        if len(left) and task.pick.approach > 0:
            row, q = configurations(arm, targets(0.0)[left], home, 0)
            follower = RouteFollower(arm=arm, deviation=np.inf, rotation_deviation=np.inf, least=1.0)
            before = targets(1.0)[left]

            def passes(tried: Indices) -> Flags:
                free = checker.is_free_batch(q[tried])
                ends = follower.ends_of_lines(q[tried[free]], before[row[tried[free]]])
                followed = np.isfinite(ends[:, 0])
                followed[followed] = checker.is_free_batch(ends[followed])
                free[free] = followed
                return free

            left = left[_rows_that_pass(row, passes)]
        kept = set(owner[left].tolist())
        tasks = {change: other for i, (change, other) in enumerate(tasks.items()) if i in kept}
    if task.place is None or not tasks:
        return list(tasks)
    owner, targets = _poses_of(task, tasks, "release")
    row, _ = configurations(arm, targets(0.0), home, 0)
    kept = set(owner[row].tolist())
    return [candidate for i, candidate in enumerate(tasks) if i in kept]


def _rows_that_pass(row: Indices, passes: Callable[[Indices], Flags]) -> Indices:
    """The values in the ascending ``row`` (k,) of which an entry passes; of each, few entries are tried at first."""
    rows, start, count = np.unique(row, return_index=True, return_counts=True)
    group, place = np.repeat(np.arange(len(rows)), count), np.arange(len(row)) - np.repeat(start, count)
    passed, begin, size = np.zeros(len(rows), dtype=bool), 0, 1
    while (left := ~passed[group] & (place >= begin)).any():
        tried = np.flatnonzero(left & (place < begin + size))
        passed[group[tried[passes(tried)]]] = True
        begin, size = begin + size, 2 * size
    return np.asarray(rows[passed])


def _poses_of(
    task: PickTask, changed: dict[Change, PickTask], which: Literal["grasp", "release"]
) -> tuple[Indices, Callable[[float], Array]]:
    """The poses of the tip at the grasps or releases of candidates, each with its task, or the stated one if it shifts.

    Returns the index (N,) of the candidate of each pose, and a function that gives (N, 4, 4) ``base_from_tcp`` at a
    share of the approach before each of them.
    """
    owner = np.repeat(np.arange(len(changed)), [len(other.nearest_group) for other in changed.values()])
    still = np.zeros((2, 3))
    moves = np.array([still if change.moves is None else change.moves for change in changed]).reshape(-1, 2, 3)
    by = (moves[:, int(which == "release")] @ task.arm.root_from_base.rotation)[owner]

    def targets(share: float) -> Array:
        stated: dict[PickTask, Array] = {}
        for other in dict.fromkeys(changed.values()):
            tip = other.grasp if which == "grasp" else other.release
            poses = [other.pick.before(tip(member), share) for member in other.nearest_group]
            stated[other] = other.targets(poses)
        found = np.concatenate([np.empty((0, 4, 4)), *(stated[other] for other in changed.values())])
        found[:, :3, 3] += by
        return found

    return owner, targets


def _nearest_shift(task: PickTask, pick: Pick, stage: Stage, trials: _Trials, *, of_place: bool) -> Suggestion | None:
    """The nearest good shift of the pick, or of its place, along the axes of its frame and between.

    Whole millimetres below the best one are tried along its direction. A pose that is out of reach, and a
    place, is also moved towards the nearest pose that is reached.
    """
    # The directions and distances that the budget of the screening allows
    members = 1 if of_place else len(task.nearest_group)
    weight = 1 if task.cell.closed_form else SWEPT if has_closed_form(task.arm, most=7) else SEARCHED
    cost = len(DISTANCES) * members * weight
    directions = next((number for number in (len(DIRECTIONS), AXES) if cost * number <= POSES), None)
    shifts = [*_vectors(FEW_DISTANCES if directions is None else DISTANCES, directions or AXES)]
    stated = pick.place if of_place else pick
    target = (task.place or task.pick).pose if of_place else task.pick.pose
    if stated is not None and (of_place or stage is Stage.REACH):
        # Towards the nearest pose that inverse kinematics finds: all of the gap, in the axes of the frame, its part
        # across their z axis, and its largest component; rounded away from the pose
        here = task.target(target)
        nearest = Clik().solve(task.arm, here, task.cell.home, rng=0)
        gap = task.arm.forward_kinematics(nearest.q).translation - here.translation
        gap = task.root_from(stated.frame).rotation.T @ (task.arm.root_from_base.rotation @ gap) * 1e3
        largest = np.where(np.arange(3) == np.argmax(np.abs(gap)), gap, 0.0)
        known = {tuple(shift.by.tolist()) for shift in shifts}
        for part, stretch in product((gap, gap * [1, 1, 0], largest), STRETCHES):
            by = np.sign(part) * np.ceil(np.abs(stretch * part) - 1e-6)
            if by.any() and tuple(by.tolist()) not in known:
                known.add(tuple(by.tolist()))
                shifts.append(Shift(by, float(np.linalg.norm(by)), is_first=stretch in FIRST_STRETCHES))
    # All in order of size if the budget allows, otherwise few distances first, along the axes before between them
    changes, done = partial(_shift_changes, task, pick, of_place=of_place), set[int]()
    every = len(shifts) <= trials.left

    def finer(change: Change) -> list[Change]:
        """The distances from the next smaller first one and, below the first that passes, whole millimetres."""
        between: list[Change] = []
        if not every:
            smaller = max((d - 1 for d in FIRST_DISTANCES if d < change.size - 1), default=0)
            if smaller in done:
                return []
            done.add(smaller)
            between = trials.screen(changes(shift for shift in shifts if smaller < shift.size < change.size))
        first = between[0] if between else change
        along = np.array(first.direction, dtype=float)
        if not along.size:
            return between
        unit = float(np.linalg.norm(along))
        least = max((s.size for s in shifts if s.direction == first.direction and s.size < first.size), default=0.0)
        steps = range(round(least / unit) + 1, round(first.size / unit))
        finest = [*trials.screen(changes(Shift(k * along, k * unit, first.direction) for k in steps)), *between]
        return finest[:: 1 + 2 * len(finest) // max(trials.left, 1)]  # at most half of the budget

    axes = [shift for shift in shifts if shift.is_first and (not shift.direction or shift.direction.count(0) == 2)]
    others = [shift for shift in shifts if shift.is_first and shift.direction and shift.direction.count(0) < 2]
    ordered = changes(shifts) if every else [*changes(axes), *changes(others)]
    # Smaller ones are judged before a change if the screening decides whether it passes the stage that failed
    if stage in SCREENED:
        return trials.nearest(ordered, finer)
    trials.nearest(ordered)
    if trials.best is not None:
        any(map(trials.good, finer(trials.best)))
    return trials.suggestion()
