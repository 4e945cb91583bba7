"""The languages of robot controllers in which programs can be written and read; docs/programs.md states the sources."""

from __future__ import annotations

from pathlib import Path

from pinproof.errors import InputError, UnknownNameError
from pinproof.motion.dialects.dialect import Dialect
from pinproof.motion.dialects.fanuc import Fanuc
from pinproof.motion.dialects.krl import Krl
from pinproof.motion.dialects.rapid import Rapid
from pinproof.motion.dialects.ros2 import Ros2
from pinproof.motion.dialects.urscript import UrScript

__all__ = ["DIALECTS", "Dialect", "dialect_of_file", "find_dialect", "is_program_file"]

# The languages by name.
DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (UrScript(), Rapid(), Krl(), Fanuc(), Ros2())}


def find_dialect(name: str) -> Dialect:
    """The language of a name; UnknownNameError lists the valid ones."""
    if name not in DIALECTS:
        raise UnknownNameError("dialect", name, DIALECTS)
    return DIALECTS[name]


def dialect_of_file(path: Path) -> str:
    """The name of the language of a file, from its ending.

    Raises
    ------
    InputError
        If no language has this ending.
    """
    for dialect in DIALECTS.values():
        if path.name.lower().endswith(dialect.endings):
            return dialect.name
    valid = ", ".join(f"{ending} ({dialect.name})" for dialect in DIALECTS.values() for ending in dialect.endings)
    raise InputError(f"{path}: no language of robot programs has this ending; valid: {valid}")


def is_program_file(path: Path) -> bool:
    """Whether a file has the ending of a robot program."""
    return any(path.name.lower().endswith(dialect.endings) for dialect in DIALECTS.values())
