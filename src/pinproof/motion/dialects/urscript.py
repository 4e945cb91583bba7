"""URScript of Universal Robots: ``movej``, ``movel``, ``servoj``, tool and payload, digital signals and ``sleep``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinproof.errors import InputError, TrajectoryError
from pinproof.motion.dialects.dialect import (
    NUMBER,
    Blend,
    Dialect,
    Field,
    Form,
    Heading,
    JointMove,
    LinearMove,
    SetLoad,
    Setting,
    Step,
    StreamedPoint,
    ToolData,
    constant,
    numbers,
    positive,
    rounded_down,
    rounded_up,
    tool_load,
    turned,
)
from pinproof.spatial import log6

# rad/s^2 and rad/s of the move to the first point.
START_ACCELERATION, START_SPEED = 0.5, 0.3
# m/s^2 of linear moves of a stated speed.
LINE_ACCELERATION = 1.2
# Seconds and gain of `servoj`: the shortest filter and the highest gain, which follow the set points most closely. With
# others the arm may leave the assumed deviation.
LOOKAHEAD, GAIN = "0.03", "2000"
# The text of a load: its mass and its centre of mass in metres.
LOAD = "#, [#, #, #]"


class UrScript(Dialect):
    """URScript; ``movej`` is a straight line in joint space, and ``r`` the radius of its blend in metres."""

    name = "urscript"
    endings = (".script", ".urscript")
    longest = 64
    comment_mark = "# pinproof:"
    outputs = "0"
    zones = tuple(
        map(Blend, (0.2, 0.15, 0.1, 0.08, 0.06, 0.05, 0.04, 0.03, 0.025, 0.02, 0.015, 0.01, 0.005, 0.002, 0.001))
    )
    deviation = 0.002
    streams = True
    cruises = True
    alike = True
    signals, signal_kind = "[0-7]", "numbers from 0 to 7"
    remark = ("# ", "")

    def frame(self, heading: Heading) -> tuple[list[str], list[str]]:
        """See :meth:`Dialect.frame`."""
        return [f"def {heading.name}():"], ["end"]

    def arranged(self, heading: Heading, steps: Sequence[Step]) -> list[Any]:
        """See :meth:`Dialect.arranged`."""
        if heading.frame is not None:
            raise InputError("urscript states joint values, not poses in a user frame; remove the frame")
        items: list[Any] = [] if heading.tool is None else [heading.tool]
        # The arm stops behind the last of consecutive set points.
        for step, following in zip(steps, [*steps[1:], None], strict=True):
            items.append(step)
            if isinstance(step, StreamedPoint) and not isinstance(following, StreamedPoint):
                items.append("  stopj(10)")
        return items

    def completed(self, source: str, items: Sequence[Any]) -> list[Step]:
        """See :meth:`Dialect.completed`."""
        moving: Any = None
        for item in items:
            # After a move with a blend the arm would stop before the point, and the next move begin there.
            if isinstance(item, Setting) and not isinstance(moving, StreamedPoint):
                reason = "'stopj(10)': it stops the arm on its way; it is supported after servoj only"
                raise TrajectoryError(source, reason, f"line {item.line}")
            moving = item if isinstance(item, JointMove | LinearMove | StreamedPoint) else moving
        return [item for item in items if not isinstance(item, Setting)]

    def forms(self, heading: Heading) -> list[Form]:
        """See :meth:`Dialect.forms`."""
        q = numbers("", "[#, #, #, #, #, #]", lambda step: step.q, lambda v: {"q": np.array(v)}, 6)
        tcp = numbers(
            "tcp",
            "p[#, #, #, #, #, #]",
            lambda step: [*step.tcp.translation, *log6(step.tcp)[3:]],
            lambda v: turned(v[:3], v[3:]),
            9,
        )
        tool = (tcp, tool_load(f"\nset_target_payload({LOAD})", 1.0, 6), constant("name", heading.tool_name))
        declared = [Form(ToolData, "set_tcp(@)@@", tool, 0)] if heading.tool_name else []
        period = Field(NUMBER, _period, lambda text: {"period": positive(text, largest=float(LOOKAHEAD))})
        return [
            *declared,
            Form(JointMove, "movej(@, @@)", (q, TIMING, RADIUS)),
            Form(LinearMove, "movel(@, @@)", (q, TIMING, RADIUS)),
            Form(StreamedPoint, f"servoj(@, t=@, lookahead_time={LOOKAHEAD}, gain={GAIN})", (q, period)),
            Form(Setting, "stopj(10)"),
            Form(SetLoad, "set_target_payload(@)", (heading.carried(LOAD, 1.0, 6),)),
            *self.common_forms(
                "set_standard_digital_out(@, @)",
                "sleep(@)",
                "waited = 0\nwhile get_standard_digital_in(@I) != @S:\n  sync()\n  waited = waited + get_steptime()\n"
                "  if waited > @T:\n    @Ehalt\n  end\nend",
                ("False", "True"),
                6,
                "@()",
            ),
        ]


def _period(step: StreamedPoint) -> str:
    if step.period > float(LOOKAHEAD):
        raise InputError(f"the period of set points is {step.period:g} s; servoj needs at most {LOOKAHEAD} s")
    return f"{step.period:.6f}"


def _timed(step: JointMove | LinearMove) -> str:
    straight = isinstance(step, LinearMove)
    if step.duration is not None or (straight and step.speed is None):
        return f"t={rounded_up(step.duration or 1.0, 1e-6, 0.002):.6f}"
    acceleration = step.acceleration or (LINE_ACCELERATION if straight else START_ACCELERATION)
    return f"a={rounded_down(acceleration)}, v={rounded_down(step.speed or START_SPEED)}"


def _time(text: str) -> Mapping[str, float]:
    stated = {key: positive(value) for key, _, value in (part.partition("=") for part in text.split(", "))}
    return {"duration": stated["t"]} if "t" in stated else {"speed": stated["v"], "acceleration": stated["a"]}


def _radius(step: JointMove | LinearMove) -> str:
    if step.blend is None:
        return ""
    if step.blend.radius is None:
        raise InputError("a blend in urscript needs a radius in metres")
    return f", r={step.blend.radius:.6f}"


def _blend(text: str) -> Mapping[str, Blend | None]:
    radius = positive(text.removeprefix(", r=") or "0", zero=True)
    return {"blend": Blend(radius) if radius else None}


TIMING = Field(f"a={NUMBER}, v={NUMBER}|t={NUMBER}", _timed, _time)
RADIUS = Field(f"(?:, r={NUMBER})?", _radius, _blend)
