"""LS files of FANUC (the ASCII form of TP programs): joint moves, linear moves, ``DO`` and ``WAIT``."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pinproof.errors import InputError, TrajectoryError
from pinproof.motion.curve import Array
from pinproof.motion.dialects.dialect import NUMBER, Body, Dialect, LineReader, in_degrees
from pinproof.motion.program_steps import Blend, JointMove, LinearMove, SetOutput, Step, Wait

CONTINUOUS = 50
"""The CNT value of a blended point; its blend may use at most half of each of the two moves."""


class Fanuc(Dialect):
    """LS files; positions are joint representations, which most arms measure with joint 3 from the horizontal."""

    name = "fanuc"
    endings = (".ls",)
    comment_mark = "!pp"
    comment_width = 28
    outputs = "1"
    blend = Blend(share=0.5)
    deviation = 0.002

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        positions: list[str] = []
        lines = [":  UFRAME_NUM=0 ;", ":  UTOOL_NUM=1 ;"]
        for step in steps:
            lines.append(_written(step, len(positions) + 1))
            if isinstance(step, JointMove | LinearMove) and step.q is not None:
                positions.append(_position(len(positions) + 1, step.q))
        before = [f"/PROG  {name.upper()[:32]}", "/ATTR", 'COMMENT = "pinproof";', "DEFAULT_GROUP = 1,*,*,*,*;", "/MN"]
        after = ["/POS", *(line for position in positions for line in position.splitlines()), "/END"]
        return before, lines, after

    def comment(self, words: str) -> str:
        """See :meth:`Dialect.comment`."""
        return f":  {self.comment_mark} {words} ;"

    def comment_of(self, line: str) -> str | None:
        """See :meth:`Dialect.comment_of`."""
        found = re.fullmatch(rf"\s*\d*\s*:\s*{self.comment_mark} (.*?) ;", line)
        return None if found is None else found[1]

    def numbered(self, text: str) -> str:
        """See :meth:`Dialect.numbered`."""
        number, lines = 0, []
        for line in text.splitlines():
            number += line.startswith(":")
            lines.append(f"{number:4d}{line}" if line.startswith(":") else line)
        return "\n".join(lines) + "\n"

    def read(self, source: str, body: Body, joints: int) -> list[Step]:
        """See :meth:`Dialect.read`."""
        places = [k for k, (_, line) in enumerate(body) if line.strip() == "/POS"]
        if len(places) != 1:
            raise TrajectoryError(source, "has no section /POS, or several")
        positions, lines = _positions(source, body[places[0] + 1 :], joints), body[: places[0]]

        def move(found: re.Match[str], line: int) -> Step:
            if found[1] not in positions:
                raise ValueError(f"position P[{found[1]}] is not defined")
            duration = None if found[2].endswith("%") else float(found[2].removesuffix("msec")) / 1000
            blend = None if found[3] == "FINE" else Blend(share=0.5)
            return JointMove(positions[found[1]], duration, blend, line)

        def line_to(found: re.Match[str], line: int) -> Step:
            if found[1] not in positions:
                raise ValueError(f"position P[{found[1]}] is not defined")
            return LinearMove(positions[found[1]], None, float(found[2]) / 1000, line)

        number = r"\d*\s*:\s*"
        rules = [
            (r"/PROG\s+\w+|/ATTR|/MN|COMMENT = \"\w*\";|DEFAULT_GROUP = [\d,*]+;", lambda _, __: None),
            (rf"{number}(?:UFRAME_NUM|UTOOL_NUM)=\d+ ;", lambda _, __: None),
            (rf"{number}J P\[(\d+)\] (\d+%|[1-9]\d*msec) (FINE|CNT\d+) ;", move),
            (rf"{number}L P\[(\d+)\] ([1-9]\d*)msec FINE ;", line_to),
            (rf"{number}DO\[(\d+)\]=(ON|OFF) ;", lambda found, line: SetOutput(found[1], found[2] == "ON", line)),
            (rf"{number}WAIT\s+({NUMBER})\(sec\) ;", lambda found, line: Wait(float(found[1]), line)),
        ]
        return LineReader(source, rules, "J P[n] .. FINE or CNTn, L P[n] ..msec FINE, DO[n]=ON/OFF, WAIT n(sec)").read(
            lines
        )


def _written(step: Step, number: int) -> str:
    if isinstance(step, JointMove):
        timing = "5%" if step.duration is None else f"{max(round(step.duration * 1000), 1)}msec"
        return f":J P[{number}] {timing} {'FINE' if step.blend is None else f'CNT{CONTINUOUS}'} ;"
    if isinstance(step, LinearMove) and step.q is not None:
        return f":L P[{number}] {max(round((step.duration or 1.0) * 1000), 1)}msec FINE ;"
    if isinstance(step, SetOutput):
        if not step.output.isdigit() or int(step.output) < 1:
            raise InputError(f"output {step.output!r}: fanuc has digital outputs with numbers from 1")
        return f":  DO[{step.output}]={'ON' if step.on else 'OFF'} ;"
    if isinstance(step, Wait):
        return f":  WAIT {step.seconds:.2f}(sec) ;"
    raise InputError("fanuc programs of pinproof contain moves, outputs and waiting times")


def _position(number: int, q: Array) -> str:
    values = ", ".join(f"J{i} = {value} deg" for i, value in enumerate(in_degrees(q, 3), 1))
    return f"P[{number}]{{\n   GP1:\n    UF : 0, UT : 1,\n    {values}\n}};"


def _positions(source: str, body: Body, joints: int) -> dict[str, Array]:
    """The positions (rad) of the section /POS, by number."""
    found: dict[str, Array] = {}
    name = ""
    for line, words in body:
        text = words.strip()
        if start := re.fullmatch(r"P\[(\d+)\]\{", text):
            name = start[1]
        elif text in ("GP1:", "};", "/END") or re.fullmatch(r"UF : \d+, UT : \d+,", text):
            continue
        elif re.fullmatch(rf"J\d+ = {NUMBER} deg(, J\d+ = {NUMBER} deg)*", text) and name not in found:
            axes = dict(re.findall(rf"J(\d+) = ({NUMBER}) deg", text))
            if list(axes) != [str(i) for i in range(1, joints + 1)]:
                raise TrajectoryError(source, f"{text!r}: needed are J1 to J{joints}, in order", f"line {line}")
            found[name] = np.deg2rad([float(value) for value in axes.values()])
        else:
            raise TrajectoryError(source, f"{text!r} is not supported in the section /POS", f"line {line}")
    return found
