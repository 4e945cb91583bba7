"""KRL of KUKA: ``PTP``, ``LIN``, ``$TOOL``, ``$BASE``, ``$LOAD``, ``$OUT``, ``WAIT FOR`` and ``WAIT SEC``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
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
    Move,
    SetLoad,
    Setting,
    Step,
    ToolData,
    UserFrame,
    constant,
    numbers,
    positive,
    rounded_down,
    tool_load,
)
from pinproof.spatial import SE3, pose, xyz_rpy

# Per cent of half a move that a blend may use (`$APO.CPTP`), if no step states less. Between a joint and a linear move,
# and between linear moves, it begins at a distance (mm, `$APO.CDIS`), at most in the middle of the move.
APPROXIMATION, DISTANCE = 100, 10
# m/s of linear moves, and the largest value of `BAS(#VEL_CP,..)`.
LINE_SPEED, FASTEST_LINE = 0.1, 3.0
# Per cent of the axis velocities; KRL states no durations of moves.
SPEED = 30
# The text of a load: its mass, and its centre of mass in millimetres.
LOAD = "{M #,CM {X #,Y #,Z #,A 0,B 0,C 0},J {X 0,Y 0,Z 0}}"
FRAME = "{X #,Y #,Z #,A #,B #,C #}"


class Krl(Dialect):
    """KRL; ``C_PTP`` blends a point within ``$APO.CPTP`` per cent of half a move."""

    name = "krl"
    endings = (".src",)
    longest = 24
    external = 6
    comment_mark = "; pinproof:"
    outputs = "1"
    blend = Blend(share=APPROXIMATION / 200)
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
        # The first instruction resets base, tool and approximation. The advance run forbids later approximations.
        shares = [step.blend.share for step in steps if isinstance(step, JointMove) and step.blend is not None]
        percent = max(int(200 * min(shares, default=APPROXIMATION / 200) + 1e-9), 1)
        items = ["  BAS(#INITMOV,0)", *super().arranged(heading, ()), f"  $APO.CPTP={percent}"]
        if any(isinstance(step, LinearMove) for step in steps):
            items.append(f"  $APO.CDIS={DISTANCE}")
        axes, line = 0, 0.0
        for step, after in zip(steps, _followers(steps), strict=True):
            if isinstance(step, JointMove) and (step.percent or SPEED) != axes:
                axes = step.percent or SPEED
                items.append(f"  BAS(#VEL_PTP,{axes})")
            if isinstance(step, LinearMove) and (speed := min(step.speed or LINE_SPEED, FASTEST_LINE)) != line:
                line = speed
                items.append(f"  BAS(#VEL_CP,{rounded_down(line)})")
            if isinstance(step, JointMove) and step.blend is not None and isinstance(after, LinearMove):
                items.append(replace(step, blend=Blend(radius=DISTANCE / 1e3)))
            else:
                items.append(step)
        return items

    def completed(self, source: str, items: Sequence[Any]) -> list[Step]:
        """See :meth:`Dialect.completed`."""
        steps, values = list[Step](), {"share": Blend().share, "percent": 0.0, "speed": 0.0}
        for item, after in zip(items, _followers(items), strict=True):
            where = f"line {item.line}"
            if isinstance(item, Setting):
                # Whether it holds for a blend that is not executed yet depends on the advance run.
                if item.name in ("share", "distance") and any(isinstance(step, Move) for step in steps):
                    raise TrajectoryError(source, "$APO must be before the first move", where)
                values[item.name] = item.value
            elif isinstance(item, JointMove):
                blend = item.blend and Blend(share=Blend().share if isinstance(after, LinearMove) else values["share"])
                steps.append(replace(item, blend=blend, percent=int(values["percent"]) or None))
            elif isinstance(item, LinearMove):
                if not values["speed"]:
                    raise TrajectoryError(source, "BAS(#VEL_CP,..) must be before a linear move", where)
                steps.append(replace(item, speed=values["speed"]))
            else:
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
            return [*_xyzabc(base), *(heading.external_of(step) if heading.external else ())]

        def reached(values: Sequence[float]) -> dict[str, Any]:
            place = _frame_of(values[:6])
            place = place if heading.frame is None else heading.frame.pose * place
            return {"pose": place, "external": heading.external_from(values[6:]) if heading.external else None}

        tcp = numbers("tcp", FRAME, lambda step: _xyzabc(step.tcp), _frame_of, 6)
        base = numbers("pose", FRAME, lambda step: _xyzabc(step.pose), _frame_of, 6)
        declared = [
            (heading.tool_name, ToolData, "$TOOL=@@@", (tcp, tool_load(f"\n$LOAD={LOAD}", 1e3, 6))),
            (heading.frame_name, UserFrame, "$BASE=@@", (base,)),
        ]
        return [
            Form(Setting, "BAS(#INITMOV,0)", (), 0),
            *(
                Form(kind, text, (*fields, constant("name", name)), slot)
                for slot, (name, kind, text, fields) in enumerate(declared, 1)
                if name
            ),
            Form(JointMove, "PTP @@", (axes, BLENDED)),
            Form(LinearMove, "LIN @@", (numbers("", FRAME[:-1] + outer + "}", target, reached, 5), ROUNDED)),
            Form(Setting, "BAS(#VEL_PTP,@)", (_setting("percent", 100.0, 1.0, r"[1-9]\d*"),)),
            Form(Setting, "BAS(#VEL_CP,@)", (_setting("speed", FASTEST_LINE, 1.0),)),
            Form(Setting, "$APO.CPTP=@", (_setting("share", 100.0, 200.0),)),
            Form(Setting, "$APO.CDIS=@", (_setting("distance", 1e3, 1.0),)),
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


def _xyzabc(transform: SE3) -> list[float]:
    """Millimetres and degrees about Z, Y and X."""
    x, y, z, *rpy = xyz_rpy(transform)
    return [1e3 * x, 1e3 * y, 1e3 * z, *np.rad2deg(rpy[::-1])]


def _frame_of(values: Sequence[float]) -> SE3:
    return pose(np.array(values[:3]) / 1e3, np.deg2rad(values[5:2:-1]))


def _setting(name: str, largest: float, unit: float, pattern: str = NUMBER) -> Field:
    """The field of a setting that applies to the moves after it."""
    return Field(pattern, str, lambda text: {"name": name, "value": positive(text, largest=largest) / unit})


def _blended(step: JointMove) -> str:
    if step.blend is None:
        return ""
    return " C_PTP" if step.blend.radius is None else " C_PTP C_DIS"


def _followers(items: Sequence[Any]) -> list[Any]:
    """For each step the next move; None at the end."""
    found: list[Any] = [None]
    for item in reversed(items[1:]):
        found.append(item if isinstance(item, Move) else found[-1])
    return found[::-1]


BLENDED = Field("(?: C_PTP(?: C_DIS)?)?", _blended, lambda text: {"blend": Blend() if text else None})
ROUNDED = Field(
    "(?: C_DIS)?",
    lambda step: "" if step.blend is None else " C_DIS",
    lambda text: {"blend": Blend() if text else None},
)
