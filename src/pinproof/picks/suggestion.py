"""Suggestions: changes of a pick in words that state every number, so that they can be applied exactly as printed.

A suggestion is one line, for example::

    move the pick 20 mm along -x (base frame)
    move the pick by (+3, 0, -3) mm (frame 'bin') and the place by (+3, 0, -3) mm (base frame)
    turn the pick by +30 deg about the z axis of the tip
    turn the pick and the place by -15 deg about the z axis of the tip
    shorten the approach from 300 mm to 222 mm
    retreat straight up, along +z (base frame)

Vectors are in the frame in which the pick, or its place, is stated; the base frame is that of the robot's root link.
A remark may follow, from :data:`REMARK` on; it changes nothing.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.picks.family import rotation_about
from pinproof.picks.pick import ROOT, Pick
from pinproof.spatial import SE3

__all__ = [
    "REMARK",
    "apply_suggestion",
    "move_place_words",
    "move_words",
    "shorten_words",
    "turn_words",
    "upwards_words",
]

Array = npt.NDArray[np.float64]

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
_UPWARDS = "retreat straight up, along +z (base frame)"


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
        If the text is no suggestion, or does not fit the pick: another frame, another length, no place.
    """
    text = suggestion.partition(REMARK)[0].strip()
    if text == _UPWARDS:
        return replace(pick, retreat_direction=(0.0, 0.0, 1.0), retreat_frame=ROOT)
    if found := _MOVE.fullmatch(text):
        groups = found.groups()
        for part in (groups[:7], groups[7:]):
            if part[0]:
                pick = _moved(pick, text, *part)
        return pick
    if found := _TURN.fullmatch(text):
        return _turned(pick, text, *found.groups())
    if found := _SHORTEN.fullmatch(text):
        way, before, after = found[1], float(found[2]) / 1e3, float(found[3]) / 1e3
        if abs(getattr(pick, way) - before) > RESOLUTION / 1e3:
            raise InputError(f"{text!r} does not fit pick {pick.name!r}: its {way} is {getattr(pick, way) * 1e3:g} mm")
        return replace(pick, approach=after) if way == "approach" else replace(pick, retreat=after)
    raise InputError(f"{suggestion!r} is no suggestion that can be applied")


def move_words(pick: Pick, by: Array, place_by: Array | None = None) -> str:
    """The pick moved by (3,) mm in its frame, and its place by (3,) mm in that of the place."""
    words = f"move the pick {_shift_words(by)} {_frame_words(pick.frame)}"
    if place_by is None or pick.place is None:
        return words
    return f"{words} and the place {_shift_words(place_by)} {_frame_words(pick.place.frame)}"


def move_place_words(pick: Pick, by: Array) -> str:
    """The place of the pick moved by (3,) mm in its frame."""
    return f"move the place {_shift_words(by)} {_frame_words('' if pick.place is None else pick.place.frame)}"


def turn_words(degrees: float, axis: Array, *, with_place: bool) -> str:
    """The pick turned about an axis (3,) of the tip, and its place with it."""
    main = int(np.argmax(np.abs(axis)))
    if axis[main] < 0:
        degrees, axis = -degrees, -axis
    about = f"({', '.join(f'{value:.6f}' for value in axis)})"
    if abs(axis[main]) > 1 - 1e-12:
        about = f"the {'xyz'[main]} axis"
    what = "the pick and the place" if with_place else "the pick"
    return f"turn {what} by {degrees:+g} deg about {about} of the tip"


def shorten_words(way: str, before: float, after: float) -> str:
    """The approach or the retreat shortened; lengths in metres."""
    return f"shorten the {way} from {round(before * 1e3, 2):.10g} mm to {round(after * 1e3, 2):.10g} mm"


def upwards_words() -> str:
    """The retreat along +z of the base frame."""
    return _UPWARDS


def _shift_words(by: Array) -> str:
    by = np.round(np.asarray(by, dtype=float), 2) + 0.0
    axes = np.flatnonzero(by)
    if len(axes) == 1:
        return f"{_digits(abs(by[axes[0]]))} mm along {'+' if by[axes[0]] > 0 else '-'}{'xyz'[axes[0]]}"
    return f"by ({', '.join(('+' if value > 0 else '') + _digits(value) for value in by)}) mm"


def _digits(value: float) -> str:
    return f"{value + 0.0:.2f}".rstrip("0").rstrip(".")


def _frame_words(frame: str) -> str:
    return f"(frame '{frame}')" if frame else "(base frame)"


def _moved(pick: Pick, text: str, what: str, *stated: str | None) -> Pick:
    distance, axis, x, y, z, frame = stated
    thing = pick if what == "pick" else pick.place
    if thing is None or frame != _frame_words(thing.frame)[1:-1]:
        has = "no place" if thing is None else f"its {what} is stated in the {_frame_words(thing.frame)[1:-1]}"
        raise InputError(f"{text!r} does not fit pick {pick.name!r}: {has}")
    if distance is not None and axis is not None:
        by = np.array([float(distance) * (1 if axis[0] == "+" else -1) * (axis[1] == name) for name in "xyz"])
    else:
        by = np.array([float(value or "nan") for value in (x, y, z)])
    moved = replace(thing, pose=SE3(thing.pose.rotation, thing.pose.translation + by / 1e3))
    return moved if isinstance(moved, Pick) else replace(pick, place=moved)


def _turned(pick: Pick, text: str, and_place: str | None, degrees: str, axis: str | None, *stated: str | None) -> Pick:
    if axis is not None:
        about = np.array([float(axis == name) for name in "xyz"])
    else:
        about = np.array([float(value or "nan") for value in stated])
    turn = SE3(rotation_about(about / np.linalg.norm(about), np.radians(float(degrees))), np.zeros(3))
    if not and_place:
        return replace(pick, pose=pick.pose * turn)
    if pick.place is None:
        raise InputError(f"{text!r} does not fit pick {pick.name!r}: it has no place")
    return replace(pick, pose=pick.pose * turn, place=replace(pick.place, pose=pick.place.pose * turn))
