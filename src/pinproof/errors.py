"""The exceptions of pinproof.

::

    PinproofError
    ├── InputError (also a ValueError)   invalid argument: wrong shape, NaN, matrix that is not a rigid transform
    │   ├── NoClosedForm                 arm that AnalyticIk does not support
    │   └── UnknownNameError (a KeyError) unknown frame, joint, robot or option; the message lists the valid names
    ├── FileError                        input file that cannot be used; the message states file and line
    │   ├── UrdfError                    URDF, xacro, MJCF or SRDF file
    │   ├── DhTableError                 Denavit-Hartenberg table
    │   ├── CalibrationError             calibration file of an arm
    │   ├── MeshError                    mesh that is missing or invalid
    │   ├── SceneError                   scene file
    │   ├── PicksError                   picks file
    │   ├── ToolPathError                file of tool paths, or one that it names
    │   └── TrajectoryError              trajectory file
    ├── ConversionError                  converted robot that differs from its source
    ├── TimingError                      path that cannot be timed within the limits
    │   └── SlipError                    path on which a carried part slips in the hand at rest
    ├── CampaignError                    campaign that cannot continue: folder of another campaign, workers do not start
    ├── ViewerError                      page or live view that cannot be created
    ├── CoreError (also an ImportError)  compiled core that is missing or older than its sources
    └── NoAnswer                         computation without a solution, raised only by ``.or_raise()``
        ├── IkFailed
        ├── PlanFailed
        └── NotProvenFree

An expected failure (unreachable, in collision, not found) is a result with a status; ``.or_raise()`` turns it into an
exception. ``RunInterrupted`` (a KeyboardInterrupt, not a PinproofError) is raised after Ctrl-C during long work.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

__all__ = [
    "CalibrationError",
    "CampaignError",
    "ConversionError",
    "CoreError",
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
    "RunInterrupted",
    "SceneError",
    "SlipError",
    "TimingError",
    "ToolPathError",
    "TrajectoryError",
    "UnitWarning",
    "UnknownNameError",
    "UrdfError",
    "ViewerError",
]


LONGEST_WORD = 400
"""Characters without white space. Longer words are contents of a file, not paths, and are abbreviated in messages."""

LONGEST_MESSAGE = 3000
"""Characters. Messages may quote a file, so their length is limited."""


class PinproofError(Exception):
    """Base class of all exceptions of pinproof.

    Messages longer than :data:`LONGEST_MESSAGE` are shortened in the middle; non-printable characters are escaped.
    """

    def __init__(self, *args: object) -> None:
        super().__init__(*(_readable(each) if isinstance(each, str) else each for each in args))


class InputError(PinproofError, ValueError):
    """An invalid argument; the message states the argument and the valid values."""

    argument: str = ""
    """The name of the field of a class that is wrong, where readers of files look for its key."""


LISTED = 16
"""Largest number of valid names that a message lists."""


class UnknownNameError(InputError, KeyError):
    """A name that does not exist.

    Parameters
    ----------
    kind
        Kind of the name, in the singular: ``"frame"``, ``"joint"``, ``"robot"``.
    name
        The unknown name.
    valid
        The valid names; the most similar ones are listed first.
    where
        Where the name was looked up, for the message.
    """

    def __init__(self, kind: str, name: object, valid: Iterable[str], where: str = "") -> None:
        self.kind, self.name = kind, name
        self.valid = _nearest_first(str(name), valid)
        place = f" in {where}" if where else ""
        more = f", ... ({len(self.valid)} in all)" if len(self.valid) > LISTED else ""
        choices = ", ".join(self.valid[:LISTED]) + more
        thing, of, whole = kind.partition(" of ")
        super().__init__(f"unknown {thing} {name!r}{of}{whole}{place}; valid: {choices or 'none'}")

    __str__ = Exception.__str__  # that of a KeyError would put the message in quotes

    def __reduce__(self) -> tuple[object, ...]:
        return (_rebuild, (type(self), self.args, self.__dict__))


class NoClosedForm(InputError):
    """An arm that :class:`pinproof.AnalyticIk` does not support; the message states the reason and an alternative."""


class UnitWarning(UserWarning):
    """A number that is plausible only in another unit: degrees instead of radians, millimetres instead of metres."""


class FileError(PinproofError):
    """An input file that cannot be used.

    Parameters
    ----------
    path
        The file.
    reason
        What is wrong and what is valid.
    place
        Position in the file: ``"line 12"``, ``"row 3, column a"``.
    """

    def __init__(self, path: str | Path, reason: str, place: str = "") -> None:
        self.path, self.reason, self.place = str(path), _readable(reason), place
        super().__init__(": ".join(part for part in (self.path, place, reason) if part))

    def __reduce__(self) -> tuple[object, ...]:
        return (_rebuild, (type(self), self.args, self.__dict__))


class UrdfError(FileError):
    """A URDF, xacro, MJCF or SRDF file that cannot be used."""


class DhTableError(FileError):
    """A Denavit-Hartenberg table that cannot be used."""


class CalibrationError(FileError):
    """A calibration file that cannot be used, or that belongs to another robot."""


class MeshError(FileError):
    """A mesh that is missing or invalid."""


class SceneError(FileError):
    """A scene file that cannot be used."""


class PicksError(FileError):
    """A picks file that cannot be used."""


class ToolPathError(FileError):
    """A file of tool paths that cannot be used."""


class TrajectoryError(FileError):
    """A trajectory file that cannot be used."""


class ConversionError(PinproofError):
    """A converted robot that differs from its source; no file was written."""


class TimingError(PinproofError):
    """A path that cannot be timed within the limits."""


class SlipError(TimingError):
    """A path on which gravity alone exceeds what the grip on a carried part transmits."""


class CampaignError(PinproofError):
    """A campaign that cannot continue; the results so far are kept."""


class ViewerError(PinproofError):
    """A page or a live view that cannot be created."""


class CoreError(PinproofError, ImportError):
    """The compiled core is missing or older than its sources; the message names the command that provides it."""


class NoAnswer(PinproofError):
    """A computation without a solution, raised only by ``.or_raise()``; ``result`` is the result object."""

    def __init__(self, message: str, result: Any = None) -> None:
        self.result = result
        super().__init__(message)


class IkFailed(NoAnswer):
    """No joint configuration was found for the target."""


class PlanFailed(NoAnswer):
    """No path was found."""


class NotProvenFree(NoAnswer):
    """The certificate is not FREE."""


COMPARED = 64
"""Characters of a name that are compared; the time grows with their square."""


ALIKE = 0.5
"""Similarity (``difflib`` ratio) above which a valid name is listed first."""


def _readable(message: str) -> str:
    message = re.sub(rf"\S{{{LONGEST_WORD},}}", lambda word: f"{word[0][:100]}[...]{word[0][-40:]}", message)
    if len(message) > LONGEST_MESSAGE:
        message = f"{message[: LONGEST_MESSAGE * 2 // 3]} [...] {message[-LONGEST_MESSAGE // 3 :]}"
    if message.isprintable():
        return message
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in message)


def _nearest_first(name: str, valid: Iterable[str]) -> list[str]:
    """Sort ``valid``: names similar to ``name`` first, then the others in alphabetical order."""

    def sort_key(candidate: str) -> float:
        similarity = difflib.SequenceMatcher(None, name[:COMPARED].lower(), candidate[:COMPARED].lower()).ratio()
        return -similarity if similarity > ALIKE else 0.0

    return sorted(sorted(valid), key=sort_key)


def _rebuild(cls: type[PinproofError], args: tuple[object, ...], state: dict[str, object]) -> PinproofError:
    """Unpickle an error whose ``__init__`` does not take its own ``args``."""
    error = cls.__new__(cls)
    Exception.__init__(error, *args)
    error.__dict__.update(state)
    return error


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C during long work.

    Parameters
    ----------
    message
        What was finished before.
    result
        The result as far as it is known, of the type that the interrupted function returns; None if nothing is.
    """

    def __init__(self, message: str, result: Any = None) -> None:
        super().__init__(message)
        self.result = result
