"""URScript of Universal Robots: ``movej``, ``movel``, ``servoj``, digital outputs and ``sleep``."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pinproof.errors import InputError
from pinproof.motion.dialects.dialect import (
    NAME,
    NUMBER,
    Blend,
    Dialect,
    JointMove,
    LinearMove,
    Rule,
    Step,
    StreamedPoint,
    numbers_of,
    positive,
    rounded_up,
)
from pinproof.spatial import Array

# rad/s^2 and rad/s of the move to the first point.
START_ACCELERATION, START_SPEED = 0.5, 0.3
# Seconds and gain of `servoj`: the shortest filter and the highest gain, which follow the set points most closely. With
# others the arm may leave the assumed deviation.
LOOKAHEAD, GAIN = "0.03", "2000"


class UrScript(Dialect):
    """URScript; ``movej`` is a straight line in joint space, and ``r`` the radius of its blend in metres."""

    name = "urscript"
    endings = (".script", ".urscript")
    comment_mark = "# pinproof:"
    outputs = "0"
    blend = Blend(radius=0.01)
    deviation = 0.002
    streams = True
    output_line, output_states = "set_standard_digital_out({}, {})", ("False", "True")
    output_names, output_kind = "[0-7]", "numbers from 0 to 7"
    wait_line = "sleep({:.6f})"
    opening, closing = (rf"def {NAME}\(\):",), ("end",)
    supported = "movej, movel to joint values, servoj, set_standard_digital_out, sleep, stopj(10)"
    contents = "moves, set points, outputs and waiting times"
    frame = ("def {}():",), ("end",)

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        before, steps_lines, after = super().write(name, steps)
        lines = []
        # The arm stops behind the last of consecutive set points.
        for step, following, line in zip(steps, [*steps[1:], None], steps_lines, strict=True):
            lines.append(line)
            if isinstance(step, StreamedPoint) and not isinstance(following, StreamedPoint):
                lines.append("  stopj(10)")
        return before, lines, after

    def move(self, step: Step) -> str | None:
        """See :meth:`Dialect.move`."""
        if isinstance(step, JointMove):
            blend = ""
            if step.blend is not None:
                if step.blend.radius is None:
                    raise InputError("a blend in urscript needs a radius in metres")
                blend = f", r={step.blend.radius:.6f}"
            timing = f"a={START_ACCELERATION}, v={step.speed or START_SPEED}"
            if step.duration is not None:
                timing = f"t={rounded_up(step.duration, 1e-6, 0.002):.6f}"
            return f"movej({_list(step.q)}, {timing}{blend})"
        if isinstance(step, LinearMove) and step.q is not None:
            return f"movel({_list(step.q)}, t={rounded_up(step.duration or 1.0, 1e-6, 0.002):.6f})"
        if isinstance(step, StreamedPoint):
            if step.period > float(LOOKAHEAD):
                raise InputError(f"the period of set points is {step.period:g} s; servoj needs at most {LOOKAHEAD} s")
            return f"servoj({_list(step.q)}, t={step.period:.6f}, lookahead_time={LOOKAHEAD}, gain={GAIN})"
        return None

    def move_rules(self, joints: int) -> list[Rule]:
        """See :meth:`Dialect.move_rules`."""
        streaming = False

        def move(found: re.Match[str], line: int) -> Step:
            nonlocal streaming
            streaming = False
            duration, radius = positive(found[4]) if found[4] else None, positive(found[5] or "0", zero=True)
            speed = positive(found[3]) if found[2] and positive(found[2]) else None
            return JointMove(numbers_of(found[1], joints), duration, Blend(radius) if radius else None, line, speed)

        def line_to(found: re.Match[str], line: int) -> Step:
            nonlocal streaming
            streaming = False
            return LinearMove(numbers_of(found[1], joints), None, positive(found[2]), line)

        def point(found: re.Match[str], line: int) -> Step:
            # A set point farther away in time is not approached within its period, but as fast as the arm can.
            nonlocal streaming
            streaming = True
            return StreamedPoint(numbers_of(found[1], joints), positive(found[2], largest=float(LOOKAHEAD)), line)

        def stop(_: re.Match[str], __: int) -> None:
            # After a move with a blend the arm would stop before the point, and the next move begin there.
            if not streaming:
                raise ValueError("it stops the arm on its way; it is supported after servoj only")

        q, number = r"\[([^\]]*)\]", f"({NUMBER})"
        return [
            (rf"movej\({q}, (?:a={number}, v={number}|t={number})(?:, r={number})?\)", move),
            (rf"movel\({q}, t={number}\)", line_to),
            (rf"servoj\({q}, t={number}, lookahead_time={re.escape(LOOKAHEAD)}, gain={GAIN}\)", point),
            (r"stopj\(10\)", stop),
        ]


def _list(q: Array) -> str:
    return "[" + ", ".join(f"{value + 0.0:.6f}" for value in q) + "]"
