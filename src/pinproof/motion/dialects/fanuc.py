"""LS files of FANUC (the ASCII form of TP programs): joint moves, linear moves, ``DO`` and ``WAIT``."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pinproof.errors import TrajectoryError
from pinproof.motion.dialects.dialect import (
    NUMBER,
    Blend,
    Body,
    Dialect,
    JointMove,
    LinearMove,
    Step,
    in_degrees,
    numbers_of,
    positive,
    rounded_up,
)
from pinproof.spatial import Array

# The CNT value of a blended point; its blend may use at most half of each of the two moves.
CONTINUOUS = 50
# A regular expression for the number of a position; with leading zeros one position would have several names.
INDEX = r"([1-9]\d*)"
# Replaces the number of the position of a move until it is known.
NEXT = "NEXT"


class Fanuc(Dialect):
    """LS files; positions are joint representations, which most arms measure with joint 3 from the horizontal."""

    name = "fanuc"
    endings = (".ls",)
    comment_mark = "!pp"
    comment_width = 28
    outputs = "1"
    blend = Blend(share=0.5)
    deviation = 0.002
    output_line, output_states = "DO[{}]={} ;", ("OFF", "ON")
    wait_line = "WAIT {:.2f}(sec) ;"
    opening = (r"/PROG\s+\w+", "/ATTR", r"COMMENT = \"\w*\";", r"DEFAULT_GROUP = 1,\*,\*,\*,\*;", "/MN")
    settings = ("UFRAME_NUM=0 ;", "UTOOL_NUM=1 ;")
    prefix = r"\d*\s*:\s*"
    supported = "J P[n] .. FINE or CNTn, L P[n] ..msec FINE, DO[n]=ON/OFF, WAIT n(sec)"

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        positions: list[str] = []
        lines = [":  UFRAME_NUM=0 ;", ":  UTOOL_NUM=1 ;"]
        for step in steps:
            moves = isinstance(step, JointMove | LinearMove)
            lines.append(f"{':' if moves else ':  '}{self.line_of(step)}".replace(NEXT, str(len(positions) + 1)))
            if isinstance(step, JointMove | LinearMove) and step.q is not None:
                values = ", ".join(f"J{i} = {value} deg" for i, value in enumerate(in_degrees(step.q, 3), 1))
                number = len(positions) + 1
                positions.append(f"P[{number}]{{\n   GP1:\n    UF : 0, UT : 1,\n    {values}\n}};")
        before = [f"/PROG  {name.upper()[:32]}", "/ATTR", 'COMMENT = "pinproof";', "DEFAULT_GROUP = 1,*,*,*,*;", "/MN"]
        after = ["/POS", *(line for position in positions for line in position.splitlines()), "/END"]
        return before, lines, after

    def comment(self, words: str) -> str:
        """See :meth:`Dialect.comment`."""
        return f":  {self.comment_mark} {words} ;"

    def comment_of(self, line: str) -> str | None:
        """See :meth:`Dialect.comment_of`."""
        found = re.fullmatch(rf"[ \t]*[0-9]*[ \t]*:[ \t]*{self.comment_mark} ([^;]*) ;[ \t]*", line)
        return None if found is None else found[1]

    def numbered(self, text: str) -> str:
        """See :meth:`Dialect.numbered`."""
        number, lines = 0, []
        for line in text.split("\n")[:-1]:
            number += line.startswith(":")
            lines.append(f"{number:4d}{line}" if line.startswith(":") else line)
        return "\n".join(lines) + "\n"

    def read(self, source: str, body: Body, joints: int) -> list[Step]:
        """See :meth:`Dialect.read`."""
        places = [k for k, (_, line) in enumerate(body) if line.strip() == "/POS"]
        if len(places) != 1:
            raise TrajectoryError(source, "has no section /POS, or several")
        positions, lines = _positions(source, body[places[0] + 1 :], joints), body[: places[0]]

        def at(number: str) -> Array:
            if number not in positions:
                raise ValueError(f"position P[{number}] is not defined")
            return positions[number]

        def move(found: re.Match[str], line: int) -> Step:
            duration = None if found[2].endswith("%") else positive(found[2].removesuffix("msec")) / 1000
            return JointMove(at(found[1]), duration, None if found[3] == "FINE" else Blend(share=0.5), line)

        def line_to(found: re.Match[str], line: int) -> Step:
            return LinearMove(at(found[1]), None, positive(found[2]) / 1000, line)

        rules = [
            (rf"J P\[{INDEX}\] ((?:100|[1-9]\d?)%|[1-9]\d*msec) (FINE|CNT(?:100|\d\d?)) ;", move),
            (rf"L P\[{INDEX}\] ([1-9]\d*)msec FINE ;", line_to),
        ]
        return self.read_lines(source, lines, rules)

    def move(self, step: Step) -> str | None:
        """See :meth:`Dialect.move`; the position has the number :data:`NEXT`."""
        if isinstance(step, JointMove):
            timing = "5%" if step.duration is None else f"{_milliseconds(step.duration)}msec"
            return f"J P[{NEXT}] {timing} {'FINE' if step.blend is None else f'CNT{CONTINUOUS}'} ;"
        if isinstance(step, LinearMove) and step.q is not None:
            return f"L P[{NEXT}] {_milliseconds(step.duration or 1.0)}msec FINE ;"
        return None


def _milliseconds(seconds: float) -> int:
    return round(rounded_up(seconds * 1000, 1.0, 1.0))


def _positions(source: str, body: Body, joints: int) -> dict[str, Array]:
    """The positions (rad) of the section /POS, by number."""
    found: dict[str, Array] = {}
    name = ""
    axes = ", ".join(rf"J{i} = ({NUMBER}) deg" for i in range(1, joints + 1))
    entry = (rf"P\[{INDEX}\]\{{", "GP1:", "UF : 0, UT : 1,", axes, r"\};")
    if not body or body[-1][1].strip() != "/END":
        raise TrajectoryError(source, "must end with /END")
    for k, (line, words) in enumerate(body[:-1]):
        text, part = words.strip(), k % len(entry)
        read = re.fullmatch(entry[part], text)
        if read is None or (part == 0 and read[1] in found):
            needed = "a position P[n] with UF : 0, UT : 1 and its joints J1 to J" + str(joints)
            raise TrajectoryError(
                source, f"{text!r} is not supported in /POS; needed is {needed}, once", f"line {line}"
            )
        if part == 0:
            name = read[1]
        elif entry[part] == axes:
            found[name] = np.deg2rad(numbers_of(",".join(read.groups()), joints))
    if (len(body) - 1) % len(entry):
        raise TrajectoryError(source, "the last position of /POS is not complete", f"line {body[-1][0]}")
    return found
