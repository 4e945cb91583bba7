"""Words for what went wrong: what the parser refuses, files that are nearly there, and what to report."""

from __future__ import annotations

import difflib
import platform
import re
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import typer

from pinproof.errors import FileError, PinproofError

__all__ = ["asked_for_help", "remedy", "usage_fault", "versions"]

# What the parser raises: its classes have no public name, those above BadParameter least of all.
_UsageError = typer.BadParameter.__mro__[1]
_ParserError = _UsageError.__mro__[1]

DECISIVE = ("pin", "coal", "numba", "numpy", "typer")
"""Libraries whose version a report of a defect should name."""


def asked_for_help(error: Exception) -> bool:
    """Whether a group was called without a command, which is answered by its help; prints that."""
    if type(error).__name__ != "NoArgsIsHelpError":
        return False
    error.show()  # type: ignore[attr-defined]  # untyped: typer.BadParameter's family
    return True


def usage_fault(error: Exception) -> str | None:
    """What the parser found wrong with the line, in one line; None for an error that is not the parser's."""
    if not isinstance(error, _ParserError):
        return None
    message = " ".join(error.format_message().split()).rstrip(".")  # type: ignore[attr-defined]
    message = message.replace("Value error, ", "").replace("(Possible options: ", "(did you mean ")
    message = re.sub(r"\. Did you mean (.*)\?$", r" (did you mean \1)", message)
    if re.search(r"No such option: -[\dp.]$|unexpected extra argument", message):
        message += '; several numbers go between quotes, as in --q "0 -pi/2 0"'
    context = getattr(error, "ctx", None)
    where = "pinproof" if context is None else context.command_path
    return f"{message[:1].lower()}{message[1:]}; '{where} --help' shows what can be said"


def remedy(error: PinproofError) -> str:
    """A few more words on an error of ours, where the file system knows them."""
    if not isinstance(error, FileError):
        return ""
    path = Path(error.path)
    try:
        if path.exists():
            return ""
        if not path.parent.exists():
            return f"; there is no folder {path.parent}"
        if not path.parent.is_dir():
            return ""
        near = difflib.get_close_matches(path.name, [file.name for file in path.parent.iterdir()], n=1)
    except OSError:
        return ""
    return f"; did you mean {path.parent / near[0]}?" if near else ""


def versions() -> str:
    """What runs here."""
    told = [f"pinproof {version('pinproof')}", f"Python {platform.python_version()} on {sys.platform}"]
    for name in DECISIVE:
        try:
            told.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            told.append(f"no {name}")
    return ", ".join(told)
