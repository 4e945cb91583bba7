"""URScript of Universal Robots: ``movej``, ``movel``, ``servoj``, digital outputs and ``sleep``."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pinproof.errors import InputError
from pinproof.motion.curve import Array
from pinproof.motion.dialects.dialect import NUMBER, Body, Dialect, LineReader, numbers_of
from pinproof.motion.program_steps import Blend, JointMove, LinearMove, SetOutput, Step, StreamedPoint, Wait

START_SPEED = "a=0.5, v=0.3"
"""rad/s^2 and rad/s of the move to the first point."""


class UrScript(Dialect):
    """URScript; ``movej`` is a straight line in joint space, and ``r`` the radius of its blend in metres."""

    name = "urscript"
    endings = (".script", ".urscript")
    comment_mark = "# pinproof:"
    outputs = "0"
    blend = Blend(radius=0.01)
    deviation = 0.002
    streams = True

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        streaming = False
        lines = []
        for step in steps:
            if streaming and not isinstance(step, StreamedPoint):
                lines.append("  stopj(10)")
            streaming = isinstance(step, StreamedPoint)
            lines.append(f"  {_written(step)}")
        if streaming:
            lines.append("  stopj(10)")
        return [f"def {name}():"], lines, ["end"]

    def read(self, source: str, body: Body, joints: int) -> list[Step]:
        """See :meth:`Dialect.read`."""
        q, number = r"\[([^\]]*)\]", f"({NUMBER})"

        def move(found: re.Match[str], line: int) -> Step:
            duration = None if found[2] is None else float(found[2])
            radius = 0.0 if found[3] is None else float(found[3])
            if (duration is not None and duration <= 0) or radius < 0:
                raise ValueError("t must be above 0, and r 0 or more")
            return JointMove(numbers_of(found[1], joints), duration, Blend(radius) if radius else None, line)

        def line_to(found: re.Match[str], line: int) -> Step:
            if float(found[2]) <= 0:
                raise ValueError("t must be above 0")
            return LinearMove(numbers_of(found[1], joints), None, float(found[2]), line)

        def point(found: re.Match[str], line: int) -> Step:
            if float(found[2]) <= 0:
                raise ValueError("t must be above 0")
            return StreamedPoint(numbers_of(found[1], joints), float(found[2]), line)

        rules = [
            (r"def \w+\(\):|end|stopj\(10\)", lambda _, __: None),
            (rf"movej\({q}, (?:a={number[1:-1]}, v={number[1:-1]}|t={number})(?:, r={number})?\)", move),
            (rf"movel\({q}, t={number}\)", line_to),
            (rf"servoj\({q}, t={number}, lookahead_time={NUMBER}, gain={NUMBER}\)", point),
            (
                r"set_standard_digital_out\((\d+), (True|False)\)",
                lambda found, line: SetOutput(found[1], found[2] == "True", line),
            ),
            (rf"sleep\({number}\)", lambda found, line: Wait(float(found[1]), line)),
        ]
        return LineReader(
            source, rules, "movej, movel to joint values, servoj, set_standard_digital_out, sleep, stopj(10)"
        ).read(body)


def _written(step: Step) -> str:
    if isinstance(step, JointMove):
        blend = ""
        if step.blend is not None:
            if step.blend.radius is None:
                raise InputError("a blend in urscript needs a radius in metres")
            blend = f", r={step.blend.radius:.6f}"
        timing = START_SPEED if step.duration is None else f"t={max(step.duration, 0.002):.6f}"
        return f"movej({_list(step.q)}, {timing}{blend})"
    if isinstance(step, LinearMove) and step.q is not None:
        return f"movel({_list(step.q)}, t={max(step.duration or 1.0, 0.002):.6f})"
    if isinstance(step, StreamedPoint):
        return f"servoj({_list(step.q)}, t={step.period:.6f}, lookahead_time=0.03, gain=2000)"
    if isinstance(step, SetOutput):
        if not step.output.isdigit():
            raise InputError(f"output {step.output!r}: urscript has digital outputs with numbers, such as 0")
        return f"set_standard_digital_out({step.output}, {step.on})"
    if isinstance(step, Wait):
        return f"sleep({step.seconds:.6f})"
    raise InputError("urscript has no instruction for a complete trajectory; use moves or set points")


def _list(q: Array) -> str:
    return "[" + ", ".join(f"{value + 0.0:.6f}" for value in q) + "]"
