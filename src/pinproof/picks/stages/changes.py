"""Candidates for suggestions: the changes of a pick that are tried, in words, by size."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.ik import Clik
from pinproof.picks.configurations import has_closed_form
from pinproof.picks.family import Member
from pinproof.picks.pick import TIP, Pick
from pinproof.picks.stages.task import Task
from pinproof.picks.suggestion import apply_suggestion, move_place_words, move_words, turn_words
from pinproof.picks.verdict import Stage
from pinproof.spatial import SE3

__all__ = [
    "DIRECTIONS",
    "DISTANCES",
    "Candidate",
    "Shift",
    "Words",
    "members",
    "place_shifts",
    "shifted",
    "shifts_of",
    "tilts",
    "turns",
]

Array = npt.NDArray[np.float64]
Words = Callable[[Array], str]
"""Puts a shift by (3,) mm in words."""

DISTANCES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100)
"""Millimetres by which a pick is moved."""

EARLY_DISTANCES, EARLY_STRETCHES, EARLY_TURNS, EARLY_TILTS = (5, 20, 50, 100), (1.1, 1.5), (45, 90, 135, 180), (10, 30)
"""Sizes that are judged first where the budget is less than the number of candidates."""

DIRECTIONS = sorted((d for d in product((0, 1, -1), repeat=3) if any(d)), key=lambda d: sum(map(abs, d)))
"""Along the axes of the pick's frame, between two of them, and between all three."""

AXES = 6
"""How many of the directions are axes; they come first."""

STRETCHES = (1.0, 1.01, 1.02, 1.04, 1.06, 1.08, 1.1, 1.15, 1.2, 1.25, 1.35, 1.5, 1.75, 2.0)
"""Times the gap to the nearest pose found by inverse kinematics: shifts of a pose that is out of reach."""

TURNS = tuple(range(15, 181, 15))
"""Degrees about the approach direction, to either side."""

TILTS = (5, 10, 15, 20, 30)
"""Degrees about the axes across the approach direction, to either side."""

POSES = 6000
"""Poses of the tip, weighted by the cost of their inverse kinematics, that are screened before any pick is judged."""

SWEPT, SEARCHED = 8, 40
"""The weight of a pose where a redundant joint is swept, and where a numerical method searches; 1 in closed form."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A change in words, the pick that it makes, its size (mm, degrees or metres of length lost), and its direction.

    ``early``: it is among the few that are judged first where the budget is less than the number of candidates.
    """

    words: str
    pick: Pick
    size: float
    direction: tuple[int, ...] = ()
    early: bool = False


class Shift(NamedTuple):
    """A shift by (3,) mm; those along one line share a direction."""

    by: Array
    direction: tuple[int, ...]
    early: bool


def shifted(pick: Pick, shifts: Iterable[Shift], words: Words) -> list[Candidate]:
    """Candidates by length, each vector once."""
    made: dict[str, Candidate] = {}
    for by, direction, early in shifts:
        if (text := words(by)) not in made:
            made[text] = Candidate(text, apply_suggestion(pick, text), float(np.linalg.norm(by)), direction, early)
    return sorted(made.values(), key=lambda each: each.size)


def _keeps_place(task: Task, pick: Pick) -> bool:
    """Whether the place moves with the grasp, so that the object comes to stand where it was to stand."""
    return pick.place is not None and task.from_scene


def turns(task: Task, pick: Pick) -> list[Candidate]:
    """The pick turned about its approach direction."""
    return [
        _turned(task, pick, sign * degrees, _approach_axis(task), (sign,), degrees in EARLY_TURNS)
        for degrees in TURNS
        for sign in (1, -1)
        if sign * degrees != -180
    ]


def tilts(task: Task, pick: Pick) -> list[Candidate]:
    """The pick tilted about the axes of the tip that are most nearly across its approach direction."""
    across = np.delete(np.arange(3), int(np.argmax(np.abs(_approach_axis(task)))))
    return [
        _turned(task, pick, sign * degrees, np.eye(3)[axis], (sign, int(axis)), degrees in EARLY_TILTS)
        for degrees in TILTS
        for axis in across
        for sign in (1, -1)
    ]


def _turned(task: Task, pick: Pick, degrees: int, axis: Array, direction: tuple[int, ...], early: bool) -> Candidate:
    words = turn_words(float(degrees), axis, with_place=_keeps_place(task, pick))
    return Candidate(words, apply_suggestion(pick, words), float(abs(degrees)), direction, early)


def shifts_of(task: Task, pick: Pick, stage: Stage) -> tuple[list[Shift], Words]:
    """Shifts of the pick along the axes of its frame and between them; if out of reach, also towards what is reached.

    With what puts a shift in words.
    """
    shifts = list(_vectors(_detail(task, len(members(task)))))
    if stage is Stage.REACH:
        rotation = _root_from_frame(task, pick).rotation
        shifts += _towards_reach(task, task.pick.pose, rotation)

    def words(by: Array) -> str:
        if not _keeps_place(task, pick) or pick.place is None:
            return move_words(pick, by)
        return move_words(pick, by, pick.place.pose.rotation @ (pick.pose.rotation.T @ by))

    return shifts, words


def place_shifts(task: Task, pick: Pick) -> tuple[list[Shift], Words]:
    """The same for the place."""
    if task.place is None or pick.place is None:
        raise InputError(f"pick {pick.name!r} has no place")
    rotation = (task.place.pose * pick.place.pose.inverse()).rotation
    shifts = [*_vectors(_detail(task, 1)), *_towards_reach(task, task.place.pose, rotation)]
    return shifts, lambda by: move_place_words(pick, by)


def _vectors(detail: tuple[Sequence[int], int]) -> Iterable[Shift]:
    """Shifts by whole millimetres along the axes and between them."""
    distances, directions = detail
    for distance in distances:
        for direction in DIRECTIONS[:directions]:
            along = np.array(direction, dtype=float)
            by = along * max(1.0, np.round(distance / np.linalg.norm(along)))
            yield Shift(by, direction, distance in EARLY_DISTANCES and np.count_nonzero(along) == 1)


def _towards_reach(task: Task, root_from_tip: SE3, root_from_frame: Array) -> Iterable[Shift]:
    """Shifts of a pose, in the axes of a frame, towards the nearest pose that inverse kinematics finds.

    All of the gap, its part across the z axis of the frame, and its largest component; rounded away from the pose.
    """
    target = task.target(root_from_tip)
    nearest = Clik().solve(task.arm, target, task.cell.home, rng=0)
    gap = task.arm.forward_kinematics(nearest.q).translation - target.translation
    whole = root_from_frame.T @ (task.arm.root_from_base.rotation @ gap) * 1e3
    along = np.where(np.arange(3) == np.argmax(np.abs(whole)), whole, 0.0)
    for line, part in enumerate((whole, whole * [1, 1, 0], along)):
        for stretch in STRETCHES:
            by = np.sign(part) * np.ceil(np.abs(stretch * part) - 1e-6)
            if by.any():
                yield Shift(by, (line,), stretch in EARLY_STRETCHES)


def _detail(task: Task, members: int) -> tuple[Sequence[int], int]:
    """As many distances and directions as the screening can afford."""
    weight = 1 if task.cell.closed_form else SWEPT if has_closed_form(task.arm, most=7) else SEARCHED
    for directions in (len(DIRECTIONS), AXES):
        if len(DISTANCES) * directions * members * weight <= POSES:
            return DISTANCES, directions
    return (1, 2, 5, 10, 20, 50, 100), AXES


def members(task: Task) -> list[Member]:
    """The grasps that are screened: those that are not moved within the tolerance."""
    return next(iter(task.rings()))


def _approach_axis(task: Task) -> Array:
    """(3,) the approach direction in the tip's axes."""
    axis = np.array(task.pick.approach_direction)
    return axis if task.pick.approach_frame == TIP else np.asarray(task.pick.pose.rotation.T @ axis)


def _root_from_frame(task: Task, pick: Pick) -> SE3:
    return task.pick.pose * pick.pose.inverse()
