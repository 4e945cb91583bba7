"""KRL of KUKA: ``PTP``, ``LIN``, ``$TOOL``, ``$BASE``, ``$LOAD``, ``$OUT``, ``WAIT FOR`` and ``WAIT SEC``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pinproof.errors import InputError, TrajectoryError
from pinproof.motion.dialects.dialect import (
    NUMBER,
    RADII,
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
    ToolData,
    UserFrame,
    constant,
    from_degrees,
    in_degrees,
    numbers,
    positive,
    rounded_down,
    tool_load,
)

# m/s of linear moves, and the largest value of `BAS(#VEL_CP,..)`.
LINE_SPEED, FASTEST_LINE = 0.1, 3.0
# m/s^2 of linear moves, and the largest value of `BAS(#ACC_CP,..)`.
LINE_GAIN, LARGEST_GAIN = 1.0, 10.0
# Per cent of the axis velocities; KRL states no durations of moves.
SPEED = 30
# The text of a load: its mass, and its centre of mass in millimetres.
LOAD = "{M #,CM {X #,Y #,Z #,A 0,B 0,C 0},J {X 0,Y 0,Z 0}}"
FRAME = "{X #,Y #,Z #,A #,B #,C #}"


class Krl(Dialect):
    """KRL; ``C_DIS`` blends a point from the distance ``$APO.CDIS`` of the tcp, in at most half of each move."""

    name = "krl"
    endings = (".src",)
    longest = 24
    external = 6
    times = False
    cruises = True
    alike = True
    comment_mark = "; pinproof:"
    outputs = "1"
    zones = tuple(Blend(radius, 0.5) for radius in RADII)
    common_zone = True
    deviation = 0.002
    remark = ("; ", "")
    required = (0,)
    call, begin = "@()", ("EXT @()",)
    hint = "; set points need RSI"

    def frame(self, heading: Heading) -> tuple[list[str], list[str]]:
        """See :meth:`Dialect.frame`."""
        return [f"DEF {heading.name}()"], ["END"]

    def arranged(self, heading: Heading, steps: Sequence[Step]) -> list[Any]:
        """See :meth:`Dialect.arranged`."""
        # The first instruction resets base, tool and approximation
        items = ["  BAS(#INITMOV,0)", *super().arranged(heading, ())]
        radii, distance = _common_radii(steps), 0.0
        stated = dict[str, str]()
        for step, radius in zip(steps, radii, strict=True):
            values = dict[str, str]()
            if radius is not None and radius != distance:
                distance = radius
                items.append(f"  $APO.CDIS={rounded_down(1e3 * radius)}")
            if isinstance(step, JointMove):
                values = {"VEL_PTP": str(step.percent or SPEED), "ACC_PTP": str(step.gain or 100)}
            elif isinstance(step, LinearMove):
                speed, gain = step.speed or LINE_SPEED, step.acceleration or LINE_GAIN
                values = {"VEL_CP": rounded_down(min(speed, FASTEST_LINE))}
                values["ACC_CP"] = rounded_down(min(gain, LARGEST_GAIN))
            items += [f"  BAS(#{what},{value})" for what, value in values.items() if stated.get(what) != value]
            stated |= values
            items.append(step)
        return items

    def completed(self, source: str, items: Sequence[Any]) -> list[Step]:
        """See :meth:`Dialect.completed`."""
        steps, values, passing = list[Step](), dict[str, float](), False
        for item in items:
            where = f"line {item.line}"
            if isinstance(item, Setting):
                # Whether it applies to a blend that is not executed yet depends on the advance run
                if item.name == "distance" and passing:
                    raise TrajectoryError(source, "$APO.CDIS may change only where the arm stops", where)
                values[item.name] = item.value
                continue
            if isinstance(item, JointMove | LinearMove):
                passing = item.blend is not None
                if passing and "distance" not in values:
                    raise TrajectoryError(source, "$APO.CDIS must be stated before a blend", where)
                item = replace(item, blend=Blend(values["distance"], 0.5) if passing else None)
            if isinstance(item, JointMove):
                percent, gain = (int(values.get(name, 0)) or None for name in ("percent", "gain"))
                item = replace(item, percent=percent, gain=gain)
            elif isinstance(item, LinearMove):
                if not {"speed", "acceleration"} <= set(values):
                    reason = "BAS(#VEL_CP,..) and BAS(#ACC_CP,..) must be before a linear move"
                    raise TrajectoryError(source, reason, where)
                item = replace(item, speed=values["speed"], acceleration=values["acceleration"])
            steps.append(item)
        return steps

    def forms(self, heading: Heading) -> list[Form]:
        """See :meth:`Dialect.forms`."""
        outer = "".join(f",E{k} #" for k in range(1, len(heading.external) + 1))
        axes = numbers(
            "",
            "{" + ",".join(f"A{k} #" for k in range(1, 7)) + outer + "}",
            lambda step: [*np.rad2deg(step.q[heading.robot]), *heading.external_of(step)],
            heading.configuration,
            4,
        )

        def target(step: LinearMove) -> list[float]:
            if step.pose is None:
                raise InputError("a linear move in krl needs the pose at its end")
            base = step.pose if heading.frame is None else heading.frame.pose.inverse() * step.pose
            # External axes have the digits of `PTP`: a turntable that rests has the same text
            outer = np.round(heading.external_of(step), 4) if heading.external else ()
            return [*_xyzabc(in_degrees(base)), *outer]

        def reached(values: Sequence[float]) -> dict[str, Any]:
            place = from_degrees(_xyzabc(values[:6]))
            place = place if heading.frame is None else heading.frame.pose * place
            return {"pose": place, "external": heading.external_from(values[6:]) if heading.external else None}

        declared = [
            (heading.tool_name, ToolData, "$TOOL=@@@", (_frame("tcp"), tool_load(f"\n$LOAD={LOAD}", 1e3, 6))),
            (heading.frame_name, UserFrame, "$BASE=@@", (_frame("pose"),)),
        ]
        return [
            Form(Setting, "BAS(#INITMOV,0)", (), 0),
            *(
                Form(kind, text, (*fields, constant("name", name)), slot)
                for slot, (name, kind, text, fields) in enumerate(declared, 1)
                if name
            ),
            Form(JointMove, "PTP @@", (axes, BLENDED)),
            Form(LinearMove, "LIN @@", (numbers("", FRAME[:-1] + outer + "}", target, reached, 5), BLENDED)),
            Form(Setting, "BAS(#VEL_PTP,@)", (_setting("percent", 100.0, 1.0, r"[1-9]\d*"),)),
            Form(Setting, "BAS(#ACC_PTP,@)", (_setting("gain", 100.0, 1.0, r"[1-9]\d*"),)),
            Form(Setting, "BAS(#VEL_CP,@)", (_setting("speed", FASTEST_LINE, 1.0),)),
            Form(Setting, "BAS(#ACC_CP,@)", (_setting("acceleration", LARGEST_GAIN, 1.0),)),
            Form(Setting, "$APO.CDIS=@", (_setting("distance", 1e3, 1e3),)),
            Form(SetLoad, "$LOAD=@", (heading.carried(LOAD, 1e3, 6),)),
            *self.common_forms(
                "$OUT[@]=@",
                "WAIT SEC @",
                "$TIMER_STOP[1]=TRUE\n$TIMER[1]=-@T\n$TIMER_STOP[1]=FALSE\nWAIT FOR ($IN[@I]==@S) OR $TIMER_FLAG[1]\n"
                "$TIMER_STOP[1]=TRUE\nIF $IN[@I]<>@S THEN\n  @ELOOP\n    HALT\n  ENDLOOP\nENDIF",
                ("FALSE", "TRUE"),
                4,
                "@()",
                1e-3,
            ),
        ]


def _xyzabc(values: Sequence[float]) -> Sequence[float]:
    """Millimetres, and degrees about Z, Y and X in the order of X, Y and Z; and back."""
    return [*values[:3], *values[5:2:-1]]


def _frame(name: str) -> Field:
    """The field of a pose."""

    def values(step: ToolData | UserFrame) -> Sequence[float]:
        return _xyzabc(in_degrees(getattr(step, name)))

    return numbers(name, FRAME, values, lambda v: from_degrees(_xyzabc(v)), 6)


def _setting(name: str, largest: float, unit: float, pattern: str = NUMBER) -> Field:
    """The field of a setting that applies to the moves after it."""
    return Field(pattern, str, lambda text: {"name": name, "value": positive(text, largest=largest) / unit})


def _common_radii(steps: Sequence[Step]) -> list[float | None]:
    """The radius that applies from a step on; None where it does not change, because the arm passes without a stop.

    Between two stops it is the least one, because a change there may apply to an earlier or a later point.
    """
    radii, least, first = list[float | None]([None] * len(steps)), math.inf, 0
    for k, step in enumerate(steps):
        if not isinstance(step, JointMove | LinearMove):
            continue
        if step.blend is None:
            least = math.inf
            continue
        if step.blend.radius is None:
            raise InputError("a blend in krl needs a radius in metres")
        first = k if least == math.inf else first
        least = radii[first] = min(least, step.blend.radius)
    return radii


BLENDED = Field(
    "(?: C_DIS)?",
    lambda step: "" if step.blend is None else " C_DIS",
    lambda text: {"blend": Blend() if text else None},
)
