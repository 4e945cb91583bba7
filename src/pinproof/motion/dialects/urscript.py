"""URScript of Universal Robots: ``movej``, ``movel``, ``servoj``, digital outputs and ``sleep``."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pinproof.errors import InputError
from pinproof.motion.dialects.dialect import NUMBER, Dialect, Rule, numbers_of, positive
from pinproof.motion.program_steps import Blend, JointMove, LinearMove, Step, StreamedPoint
from pinproof.spatial import Array

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
    output_line, output_states = "set_standard_digital_out({}, {})", ("False", "True")
    output_names, output_kind = "[0-9]+", "numbers, such as 0"
    wait_line = "sleep({:.6f})"
    opening, closing = (r"def \w+\(\):",), ("end",)
    ignored = r"stopj\(10\)"
    supported = "movej, movel to joint values, servoj, set_standard_digital_out, sleep, stopj(10)"
    contents = "moves, set points, outputs and waiting times"

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        streaming = False
        lines = []
        for step in steps:
            if streaming and not isinstance(step, StreamedPoint):
                lines.append("  stopj(10)")
            streaming = isinstance(step, StreamedPoint)
            lines.append(f"  {self.line_of(step)}")
        if streaming:
            lines.append("  stopj(10)")
        return [f"def {name}():"], lines, ["end"]

    def move(self, step: Step) -> str | None:
        """See :meth:`Dialect.move`."""
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
        return None

    def move_rules(self, joints: int) -> list[Rule]:
        """See :meth:`Dialect.move_rules`."""

        def move(found: re.Match[str], line: int) -> Step:
            duration, radius = positive(found[2]) if found[2] else None, float(found[3] or 0.0)
            if radius < 0:
                raise ValueError("r must be 0 or more")
            return JointMove(numbers_of(found[1], joints), duration, Blend(radius) if radius else None, line)

        def line_to(found: re.Match[str], line: int) -> Step:
            return LinearMove(numbers_of(found[1], joints), None, positive(found[2]), line)

        def point(found: re.Match[str], line: int) -> Step:
            return StreamedPoint(numbers_of(found[1], joints), positive(found[2]), line)

        q, number = r"\[([^\]]*)\]", f"({NUMBER})"
        return [
            (rf"movej\({q}, (?:a={NUMBER}, v={NUMBER}|t={number})(?:, r={number})?\)", move),
            (rf"movel\({q}, t={number}\)", line_to),
            (rf"servoj\({q}, t={number}, lookahead_time={NUMBER}, gain={NUMBER}\)", point),
        ]


def _list(q: Array) -> str:
    return "[" + ", ".join(f"{value + 0.0:.6f}" for value in q) + "]"
