"""Changes of a pick: their text, their application, and the candidates that are tried for suggestions.

A suggestion is one line that states every number, so that it can be applied exactly as printed, for example::

    move the pick 20 mm along -x (base frame)
    move the pick by (+3, 0, -3) mm (frame 'bin') and the place by (+3, 0, -3) mm (base frame)
    turn the pick by +30 deg about the z axis of the tip
    turn the pick and the place by -15 deg about the z axis of the tip
    shorten the approach from 300 mm to 222 mm
    retreat straight up, along +z (base frame)

Vectors are in the frame in which the pick, or its place, is stated; the base frame is that of the robot's root link.
A remark may follow after :data:`REMARK`; it changes nothing.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import product
from typing import NamedTuple

import numpy as np

from pinproof.errors import InputError
from pinproof.ik import Clik
from pinproof.motion import read_only
from pinproof.picks.input.pick import ROOT, TIP, Pick
from pinproof.picks.judging.configurations import has_closed_form
from pinproof.picks.judging.task import PickTask
from pinproof.picks.judging.verdict import Stage
from pinproof.spatial import SE3, Array, rotation_about, translated

RESOLUTION = 0.01
"""Millimetres: printed lengths and components of vectors are multiples of this."""

REMARK = "; it then "
"""What separates a suggestion from the stages that the changed pick passes and fails."""

_NUMBER = r"[-+]?\d+(?:\.\d+)?"
_SHIFT = rf"({_NUMBER}) mm along ([-+][xyz])|by \(({_NUMBER}), ({_NUMBER}), ({_NUMBER})\) mm"
_FRAME = r"\((base frame|frame '.+?')\)"
_MOVE = re.compile(rf"move the (pick|place) (?:{_SHIFT}) {_FRAME}(?: and the (place) (?:{_SHIFT}) {_FRAME})?")
_AXIS = rf"the ([xyz]) axis|\(({_NUMBER}), ({_NUMBER}), ({_NUMBER})\)"
_TURN = re.compile(rf"turn the pick( and the place)? by ({_NUMBER}) deg about (?:{_AXIS}) of the tip")
_SHORTEN = re.compile(rf"shorten the (approach|retreat) from ({_NUMBER}) mm to ({_NUMBER}) mm")
UPWARDS = "retreat straight up, along +z (base frame)"


def apply_suggestion(pick: Pick, suggestion: str) -> Pick:
    """The pick, changed exactly as a suggestion states.

    Parameters
    ----------
    pick
        The pick that the suggestion was made for.
    suggestion
        A line of :attr:`pinproof.picks.PickVerdict.suggestions`.

    Raises
    ------
    InputError
        If the text is not a suggestion, or does not match the pick (another frame or length, or no place).
    """
    text = suggestion.partition(REMARK)[0].strip()
    if text == UPWARDS:
        return replace(pick, retreat_direction=(0.0, 0.0, 1.0), retreat_frame=ROOT)
    if found := _MOVE.fullmatch(text):
        groups = found.groups()
        for part in (groups[:7], groups[7:]):
            if part[0]:
                pick = _apply_move(pick, text, *part)
        return pick
    if found := _TURN.fullmatch(text):
        return _apply_turn(pick, text, *found.groups())
    if found := _SHORTEN.fullmatch(text):
        move, before, after = found[1], float(found[2]) / 1e3, float(found[3]) / 1e3
        if abs(getattr(pick, move) - before) > RESOLUTION / 1e3:
            raise InputError(
                f"{text!r} does not fit pick {pick.name!r}: its {move} is {getattr(pick, move) * 1e3:g} mm"
            )
        return replace(pick, approach=after) if move == "approach" else replace(pick, retreat=after)
    raise InputError(f"{suggestion!r} is not a suggestion that can be applied")


def move_words(pick: Pick, by: Array, place_by: Array | None = None) -> str:
    """The text of a shift of the pick by (3,) mm in its frame, and of its place by (3,) mm in its own frame."""
    words = f"move the pick {_shift_words(by)} {_frame_words(pick.frame)}"
    if place_by is None or pick.place is None:
        return words
    return f"{words} and the place {_shift_words(place_by)} {_frame_words(pick.place.frame)}"


def move_place_words(pick: Pick, by: Array) -> str:
    """The text of a shift of the place of the pick by (3,) mm in the frame of the place."""
    return f"move the place {_shift_words(by)} {_frame_words('' if pick.place is None else pick.place.frame)}"


def turn_words(degrees: float, axis: Array, *, with_place: bool) -> str:
    """The text of a rotation of the pick, and optionally of its place, about an axis (3,) of the tip."""
    main = int(np.argmax(np.abs(axis)))
    if axis[main] < 0:
        degrees, axis = -degrees, -axis
    about = f"({', '.join(f'{value:.6f}' for value in axis)})"
    if abs(axis[main]) > 1 - 1e-12:
        about = f"the {'xyz'[main]} axis"
    what = "the pick and the place" if with_place else "the pick"
    return f"turn {what} by {degrees:+g} deg about {about} of the tip"


def shorten_words(move: str, before: float, after: float) -> str:
    """The text of a shorter approach or retreat; lengths in metres."""
    return f"shorten the {move} from {round(before * 1e3, 2):.10g} mm to {round(after * 1e3, 2):.10g} mm"


def _shift_words(by: Array) -> str:
    stated = (np.round(np.asarray(by, dtype=float), 2) + 0.0).tolist()
    axes = [k for k in range(3) if stated[k]]
    if len(axes) == 1:
        along = stated[axes[0]]
        return f"{_digits(abs(along))} mm along {'+' if along > 0 else '-'}{'xyz'[axes[0]]}"
    return f"by ({', '.join(('+' if value > 0 else '') + _digits(value) for value in stated)}) mm"


def _digits(value: float) -> str:
    return f"{value + 0.0:.2f}".rstrip("0").rstrip(".")


def _frame_words(frame: str) -> str:
    return f"(frame '{frame}')" if frame else "(base frame)"


def _apply_move(pick: Pick, text: str, what: str, *stated: str | None) -> Pick:
    distance, axis, x, y, z, frame = stated
    thing = pick if what == "pick" else pick.place
    if thing is None or frame != _frame_words(thing.frame)[1:-1]:
        has = "no place" if thing is None else f"its {what} is stated in the {_frame_words(thing.frame)[1:-1]}"
        raise InputError(f"{text!r} does not fit pick {pick.name!r}: {has}")
    if distance is not None and axis is not None:
        by = np.array([float(distance) * (1 if axis[0] == "+" else -1) * (axis[1] == name) for name in "xyz"])
    else:
        by = np.array([float(value or "nan") for value in (x, y, z)])
    moved = replace(thing, pose=translated(thing.pose, by / 1e3))
    return moved if isinstance(moved, Pick) else replace(pick, place=moved)


def _apply_turn(
    pick: Pick, text: str, and_place: str | None, degrees: str, axis: str | None, *stated: str | None
) -> Pick:
    if axis is not None:
        about = np.array([float(axis == name) for name in "xyz"])
    else:
        about = np.array([float(value or "nan") for value in stated])
    turn = SE3(rotation_about(about / np.linalg.norm(about), np.radians(float(degrees))), np.zeros(3))
    if not and_place:
        return replace(pick, pose=pick.pose * turn)
    if pick.place is None or pick.place.pose_of != TIP:
        what = "it has no place" if pick.place is None else "its place is stated as the pose of the object"
        raise InputError(f"{text!r} does not fit pick {pick.name!r}: {what}")
    return replace(pick, pose=pick.pose * turn, place=replace(pick.place, pose=pick.place.pose * turn))


DISTANCES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100)
"""Millimetres by which a pick is moved."""

EARLY_DISTANCES, EARLY_STRETCHES, EARLY_TURNS, EARLY_TILTS = (5, 20, 50, 100), (1.1, 1.5), (45, 90, 135, 180), (10, 30)
"""Sizes that are judged first if the budget is less than the number of candidates."""

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

POSES = 6000
"""Poses of the tip, weighted by the cost of their inverse kinematics, that are screened before any pick is judged."""

SWEPT, SEARCHED = 8, 40
"""The weight of a pose where a redundant joint is swept, and where a numerical method searches; 1 in closed form."""


class Displacement(NamedTuple):
    """The displacements (3,) of the tip in the root frame, in metres, at the grasp and at the release."""

    grasp: Array
    release: Array


@dataclass(frozen=True, eq=False)
class Change:
    """A change of a pick as text, its size (mm, degrees, or metres of lost length), and its direction.

    ``early`` marks the few changes that are judged first if the budget is less than the number of changes. If only the
    positions of poses change, ``displacement`` states by how much, and they are screened without the changed pick.
    """

    words: str
    stated: Pick
    size: float
    direction: tuple[int, ...] = ()
    early: bool = False
    displacement: Displacement | None = None

    @cached_property
    def pick(self) -> Pick:
        """The changed pick."""
        return apply_suggestion(self.stated, self.words)


class Shift(NamedTuple):
    """A shift by (3,) mm; those along one line share a direction."""

    by: Array
    direction: tuple[int, ...]
    early: bool


ChangesOf = Callable[[Iterable[Shift]], list[Change]]
"""The changes of a pick by shifts."""


def _changes(
    pick: Pick,
    words: Callable[[Array], str],
    displacement: Callable[[Array], Displacement | None],
    shifts: Iterable[Shift],
) -> list[Change]:
    """Changes ordered by length, each vector once, from the text and the displacement of a shift by (3,) mm."""
    made: dict[str, Change] = {}
    for by, direction, early in shifts:
        if (text := words(by)) not in made:
            size = math.sqrt(sum(x * x for x in by.tolist()))
            made[text] = Change(text, pick, size, direction, early, displacement(by))
    return sorted(made.values(), key=lambda each: each.size)


def _keeps_place(task: PickTask, pick: Pick) -> bool:
    """Whether the place moves with the grasp, so that the object is still put down at the requested pose."""
    return pick.place is not None and pick.place.pose_of == TIP and task.from_scene


def turns(task: PickTask, pick: Pick) -> list[Change]:
    """The pick turned about its approach direction."""
    return [
        _turn_change(task, pick, sign * degrees, task.pick.axis_in(task.pick.pose), (sign,), degrees in EARLY_TURNS)
        for degrees in TURNS
        for sign in (1, -1)
        if sign * degrees != -180
    ]


def tilts(task: PickTask, pick: Pick) -> list[Change]:
    """The pick tilted about the axes of the tip that are most nearly across its approach direction."""
    across = np.delete(np.arange(3), int(np.argmax(np.abs(task.pick.axis_in(task.pick.pose)))))
    return [
        _turn_change(task, pick, sign * degrees, np.eye(3)[axis], (sign, int(axis)), degrees in EARLY_TILTS)
        for degrees in TILTS
        for axis in across
        for sign in (1, -1)
    ]


def _turn_change(
    task: PickTask, pick: Pick, degrees: int, axis: Array, direction: tuple[int, ...], early: bool
) -> Change:
    words = turn_words(float(degrees), axis, with_place=_keeps_place(task, pick))
    return Change(words, pick, float(abs(degrees)), direction, early)


def shifts_of(task: PickTask, pick: Pick, stage: Stage) -> tuple[list[Shift], ChangesOf]:
    """Shifts of the pick along the axes of its frame and between them, and how they change it.

    If the pick is out of reach, also shifts towards the nearest pose that is reached.
    """
    shifts = list(_vectors(*_detail(task, len(task.nearest_group))))
    rotation = task.root_from(pick.frame).rotation
    if stage is Stage.REACH:
        shifts += _towards_reach(task, task.pick.pose, rotation)
    place = pick.place
    if place is None or not _keeps_place(task, pick):
        # if the place states the pose of the object, the pose of the tip at the release changes with the grasp
        follows = place is not None and place.pose_of != TIP
        return shifts, partial(
            _changes,
            pick,
            lambda by: move_words(pick, by),
            lambda by: None if follows else Displacement(rotation @ _printed(by), np.zeros(3)),
        )
    place_from_pick = place.pose.rotation @ pick.pose.rotation.T
    of_place = task.root_from(place.frame).rotation
    return shifts, partial(
        _changes,
        pick,
        lambda by: move_words(pick, by, place_from_pick @ by),
        lambda by: Displacement(rotation @ _printed(by), of_place @ _printed(place_from_pick @ by)),
    )


def place_shifts(task: PickTask, pick: Pick) -> tuple[list[Shift], ChangesOf]:
    """The result of :func:`shifts_of` for the place."""
    if task.place is None or pick.place is None:
        raise InputError(f"pick {pick.name!r} has no place")
    rotation = task.root_from(pick.place.frame).rotation
    shifts = [*_vectors(*_detail(task, 1)), *_towards_reach(task, task.place.pose, rotation)]
    return shifts, partial(
        _changes,
        pick,
        lambda by: move_place_words(pick, by),
        lambda by: Displacement(np.zeros(3), rotation @ _printed(by)),
    )


def _printed(by: Array) -> Array:
    """(3,) a shift in metres as it is printed, from millimetres."""
    return np.round(by, 2) / 1e3


@cache
def _vectors(distances: tuple[int, ...], directions: int) -> tuple[Shift, ...]:
    """Shifts by whole millimetres along the axes and between them."""
    shifts = []
    for distance in distances:
        for direction in DIRECTIONS[:directions]:
            along = np.array(direction, dtype=float)
            by = along * max(1.0, np.round(distance / np.linalg.norm(along)))
            shifts.append(Shift(read_only(by), direction, distance in EARLY_DISTANCES and direction.count(0) == 2))
    return tuple(shifts)


def _towards_reach(task: PickTask, root_from_tip: SE3, root_from_frame: Array) -> Iterable[Shift]:
    """Shifts of a pose, in the axes of a frame, towards the nearest pose that inverse kinematics finds.

    All of the gap, its part across the z axis of the frame, and its largest component; rounded away from the pose.
    """
    target = task.target(root_from_tip)
    nearest = Clik().solve(task.arm, target, task.cell.home, rng=0)
    gap = task.arm.forward_kinematics(nearest.q).translation - target.translation
    shift = root_from_frame.T @ (task.arm.root_from_base.rotation @ gap) * 1e3
    along = np.where(np.arange(3) == np.argmax(np.abs(shift)), shift, 0.0)
    for line, part in enumerate((shift, shift * [1, 1, 0], along)):
        for stretch in STRETCHES:
            by = np.sign(part) * np.ceil(np.abs(stretch * part) - 1e-6)
            if by.any():
                yield Shift(by, (line,), stretch in EARLY_STRETCHES)


def _detail(task: PickTask, members: int) -> tuple[tuple[int, ...], int]:
    """The distances, and the number of directions, that the screening budget allows."""
    weight = 1 if task.cell.closed_form else SWEPT if has_closed_form(task.arm, most=7) else SEARCHED
    for directions in (len(DIRECTIONS), AXES):
        if len(DISTANCES) * directions * members * weight <= POSES:
            return DISTANCES, directions
    return (1, 2, 5, 10, 20, 50, 100), AXES
