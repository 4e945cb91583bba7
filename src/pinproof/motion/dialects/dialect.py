"""What a language of robot programs defines, and helpers to read and write its lines."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from pinproof.errors import TrajectoryError
from pinproof.motion.curve import Array
from pinproof.motion.program_steps import Blend, Step

Body = Sequence[tuple[int, str]]
"""The lines of a program without the comments of pinproof, each with its number."""

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
"""A regular expression for a decimal number."""


class Dialect:
    """A language of robot programs."""

    name = ""
    endings: tuple[str, ...] = ()
    joints: int | None = 6
    comment_mark = ""
    comment_width = 110
    exact = False
    """Whether the controller interpolates a trajectory exactly as pinproof does."""
    streams = False
    """Whether the language can send set points at a fixed period."""
    outputs = ""
    """The digital output that closes a gripper by default; empty if the language has no outputs."""
    blend: Blend | None = None
    """The blend of an inner point by default; None if the language has none."""
    deviation = 0.0
    """rad: the assumed deviation of each joint from the straight lines of the moves, by default."""

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """The lines before the comments, those of the steps, and those after them; joint values are the controller's.

        Raises
        ------
        InputError
            If the language cannot express a step.
        """
        raise NotImplementedError

    def read(self, source: str, body: Body, joints: int) -> list[Step]:
        """The steps of a program.

        Raises
        ------
        TrajectoryError
            If an instruction is not supported, with its line and text.
        """
        raise NotImplementedError

    def comment(self, words: str) -> str:
        """A line with a comment of pinproof."""
        return f"  {self.comment_mark} {words}"

    def comment_of(self, line: str) -> str | None:
        """The words of a comment of pinproof; None if the line is another."""
        bare = line.strip()
        return bare[len(self.comment_mark) + 1 :] if bare.startswith(f"{self.comment_mark} ") else None

    def numbered(self, text: str) -> str:
        """The text with numbers of lines, if the language has them."""
        return text

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"


class LineReader:
    """Reads the lines of a program one by one by regular expressions.

    Parameters
    ----------
    source
        The name of the file, for messages.
    rules
        A regular expression of a complete line, and what makes the step of a match; the latter may return None.
    supported
        The supported instructions, for messages.
    """

    def __init__(
        self,
        source: str,
        rules: Sequence[tuple[str, Callable[[re.Match[str], int], Step | None]]],
        supported: str,
    ) -> None:
        self.source, self.supported = source, supported
        self._rules = [(re.compile(pattern), make) for pattern, make in rules]

    def read(self, body: Body) -> list[Step]:
        """The steps of the lines."""
        steps = []
        for number, line in body:
            steps.append(self._step(number, line.strip()))
        return [step for step in steps if step is not None]

    def _step(self, number: int, line: str) -> Step | None:
        for pattern, make in self._rules:
            found = pattern.fullmatch(line)
            if found is None:
                continue
            try:
                return make(found, number)
            except ValueError as error:
                raise TrajectoryError(self.source, f"{line!r}: {error}", f"line {number}") from error
        reason = f"{line!r} is not supported; supported: {self.supported}"
        raise TrajectoryError(self.source, reason, f"line {number}")


def numbers_of(text: str, count: int) -> Array:
    """The numbers of a list separated by commas.

    Raises
    ------
    ValueError
        If there are not ``count`` finite numbers.
    """
    words = [word.strip() for word in text.split(",")]
    if not all(re.fullmatch(NUMBER, word) for word in words):
        raise ValueError(f"{text.strip()!r} is not a list of numbers")
    values = np.array([float(word) for word in words])
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"has {len(values)} joint values; the program has {count} joints")
    return values


def in_degrees(q: Array, digits: int) -> list[str]:
    """The values of joints in degrees, rounded to decimals."""
    return [f"{value + 0.0:.{digits}f}" for value in np.rad2deg(q).round(digits)]
