"""Every error that pinproof raises on purpose, in one tree.

::

    PinproofError
    ├── InputError (also a ValueError)   an argument that makes no sense: shape, NaN, a non-rigid matrix
    │   ├── NoClosedForm                 an arm that AnalyticIk cannot solve; names the reason and what to use instead
    │   └── UnknownNameError             a frame, joint, robot or option that does not exist; names the valid ones
    ├── FileError                        an input file that cannot be used; names file and place
    │   ├── UrdfError                    a URDF or SRDF
    │   ├── DhTableError                 a Denavit-Hartenberg table
    │   ├── MeshError                    a mesh that is missing or unusable
    │   ├── SceneError                   a scene file
    │   ├── PicksError                   a picks file
    │   └── TrajectoryError              a trajectory file
    ├── ConversionError                  a converted robot that does not equal its source
    ├── TimingError                      a path for which no timing within the limits was found
    ├── CampaignError                    a campaign that cannot go on: another one's folder, workers that do not start
    ├── ViewerError                      a page or a live view that cannot be made
    └── NoAnswer                         an honest "no", raised only by ``.or_raise()``
        ├── IkFailed
        ├── PlanFailed
        └── NotProvenFree

An expected "no" (unreachable, in collision, not found) is a value with a status, never an exception, unless the caller
asks for one with ``.or_raise()``.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path

__all__ = [
    "CampaignError",
    "ConversionError",
    "DhTableError",
    "FileError",
    "IkFailed",
    "InputError",
    "MeshError",
    "NoAnswer",
    "NoClosedForm",
    "NotProvenFree",
    "PicksError",
    "PinproofError",
    "PlanFailed",
    "SceneError",
    "TimingError",
    "TrajectoryError",
    "UnknownNameError",
    "UrdfError",
    "ViewerError",
]


LONGEST_WORD = 400
"""Characters without a blank: longer than any path, so part of a file."""

LONGEST_MESSAGE = 3000
"""Characters. What a file holds may stand in a message, and may be of any length; nobody reads on beyond this."""


class PinproofError(Exception):
    """Root of every error that pinproof raises on purpose.

    Messages are cut in the middle beyond :data:`LONGEST_MESSAGE`, and what cannot be printed is escaped.
    """

    def __init__(self, *args: object) -> None:
        super().__init__(*(_readable(each) if isinstance(each, str) else each for each in args))


class InputError(PinproofError, ValueError):
    """An argument that makes no sense; the message names it and what would."""


LISTED = 16
"""Valid names that a message lists before it only counts."""


class UnknownNameError(InputError):
    """A name that does not exist where it was looked up.

    Parameters
    ----------
    kind
        What was looked up, in the singular: ``"frame"``, ``"joint"``, ``"robot"``.
    name
        The name that was asked for.
    valid
        The names that exist; the nearest ones are listed first.
    where
        Where it was looked up, for the message.
    """

    def __init__(self, kind: str, name: object, valid: Iterable[str], where: str = "") -> None:
        self.kind, self.name = kind, name
        self.valid = _nearest_first(str(name), valid)
        place = f" in {where}" if where else ""
        more = f", ... ({len(self.valid)} in all)" if len(self.valid) > LISTED else ""
        choices = ", ".join(self.valid[:LISTED]) + more
        super().__init__(f"unknown {kind} {name!r}{place}; valid: {choices or 'none'}")

    def __reduce__(self) -> tuple[object, ...]:
        return (_rebuild, (type(self), self.args, self.__dict__))


class NoClosedForm(InputError):
    """An arm whose inverse kinematics has no closed form; the message names the reason and what to use instead."""


class FileError(PinproofError):
    """An input file that cannot be used.

    Parameters
    ----------
    path
        The file.
    reason
        What is wrong and what would be right.
    place
        Where in the file: ``"line 12"``, ``"row 3, column a"``.
    """

    def __init__(self, path: str | Path, reason: str, place: str = "") -> None:
        self.path, self.reason, self.place = str(path), _readable(reason), place
        super().__init__(": ".join(part for part in (self.path, place, reason) if part))

    def __reduce__(self) -> tuple[object, ...]:
        return (_rebuild, (type(self), self.args, self.__dict__))


class UrdfError(FileError):
    """A URDF or SRDF that cannot be used."""


class DhTableError(FileError):
    """A Denavit-Hartenberg table that cannot be used."""


class MeshError(FileError):
    """A mesh that is missing or unusable."""


class SceneError(FileError):
    """A scene file that cannot be used."""


class PicksError(FileError):
    """A picks file that cannot be used."""


class TrajectoryError(FileError):
    """A trajectory file that cannot be used."""


class ConversionError(PinproofError):
    """A converted robot that does not equal its source; nothing was written."""


class TimingError(PinproofError):
    """A path for which no timing within the limits was found."""


class CampaignError(PinproofError):
    """A campaign that cannot go on; what it has judged until then is kept."""


class ViewerError(PinproofError):
    """A page or a live view that cannot be made."""


class NoAnswer(PinproofError):
    """An honest "no", raised only by ``.or_raise()``; ``result`` is the value that said it."""

    def __init__(self, message: str, result: object = None) -> None:
        self.result = result
        super().__init__(message)


class IkFailed(NoAnswer):
    """No joint configuration was found for the target."""


class PlanFailed(NoAnswer):
    """No path was found."""


class NotProvenFree(NoAnswer):
    """The certificate is not FREE."""


COMPARED = 64
"""Characters of a name that count for its likeness to others."""


ALIKE = 0.5
"""Likeness (difflib's ratio) from which a name may be meant."""


def _readable(message: str) -> str:
    message = re.sub(rf"\S{{{LONGEST_WORD},}}", lambda word: f"{word[0][:100]}[...]{word[0][-40:]}", message)
    if len(message) > LONGEST_MESSAGE:
        message = f"{message[: LONGEST_MESSAGE * 2 // 3]} [...] {message[-LONGEST_MESSAGE // 3 :]}"
    if message.isprintable():
        return message
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in message)


def _nearest_first(name: str, valid: Iterable[str]) -> list[str]:
    """``valid`` in alphabetical order, but for what is much like ``name``: that first, the most alike foremost."""

    def unlike(candidate: str) -> float:
        # Cut: the time grows with the product of both lengths.
        likeness = difflib.SequenceMatcher(None, name[:COMPARED].lower(), candidate[:COMPARED].lower()).ratio()
        return -likeness if likeness > ALIKE else 0.0

    return sorted(sorted(valid), key=unlike)


def _rebuild(cls: type[PinproofError], args: tuple[object, ...], state: dict[str, object]) -> PinproofError:
    """Unpickle an error whose ``__init__`` does not take its own ``args``."""
    error = cls.__new__(cls)
    Exception.__init__(error, *args)
    error.__dict__.update(state)
    return error
