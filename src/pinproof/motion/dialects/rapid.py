"""RAPID of ABB: ``MoveAbsJ``, ``MoveL``, tool, work object and load data, ``SetDO``, ``WaitDI`` and ``WaitTime``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinproof.model import Payload
from pinproof.motion.dialects.dialect import (
    NAME,
    NUMBER,
    Blend,
    CheckInput,
    Dialect,
    Field,
    Form,
    Heading,
    JointMove,
    LinearMove,
    LoadData,
    SetLoad,
    Setting,
    Step,
    ToolData,
    UserFrame,
    constant,
    numbers,
    positive,
    quaternion,
    rounded_up,
    tool_load,
)
from pinproof.spatial import SE3, pose

# Regular expressions of the speeds and zones that RAPID predefines; others may be defined elsewhere, as anything.
SPEEDS = "v(?:5|[1-68]0|[1-68]00|1500|[1-7]000|2500|150)"
ZONES = "z(?:[015]|[1-6]0|15|80|1[05]0|200)"
# The radii (mm) of predefined zones; that of z0 is 0.3 mm.
RADII = (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)
# kg: the least mass of a tool.
LEAST_MASS = 0.001
# The text of a load: its mass and its centre of mass in millimetres.
LOAD = "[#,[#,#,#],[1,0,0,0],0,0,0]"
# The order of the declarations.
TOOL, OBJECT, LOADS, ROUTINE, FLAG = range(5)


class Rapid(Dialect):
    """RAPID; a fly-by point may use at most half of the move to it and half of the move after it."""

    name = "rapid"
    endings = (".mod", ".modx", ".prg")
    longest = 30  # of 32, without the prefix of the module
    external = 6
    comment_mark = "! pinproof:"
    outputs = "do_gripper"
    blend = Blend(share=0.5)
    deviation = 0.002
    signals, signal_kind = NAME, "names, such as do_gripper"
    remark = ("! ", "")
    required = (ROUTINE,)
    indent = "    "
    call = "@;"
    hint = "; set points need EGM"

    def frame(self, heading: Heading) -> tuple[list[str], list[str]]:
        """See :meth:`Dialect.frame`."""
        return [f"MODULE m_{heading.name}"], ["  ENDPROC", "ENDMODULE"]

    def main(self, programs: Sequence[str]) -> str:
        """See :meth:`Dialect.main`."""
        return super().main(programs).replace("MODULE m_main\n", "MODULE m_main\n  PROC main()\n")

    def arranged(self, heading: Heading, steps: Sequence[Step]) -> list[Any]:
        """See :meth:`Dialect.arranged`."""
        for step in steps:
            if isinstance(step, SetLoad) and step.payload is not None and step.payload not in heading.loads:
                heading.loads.append(step.payload)
        declared = [each for each in (heading.tool, heading.frame) if each is not None]
        loads = [LoadData(number, payload) for number, payload in enumerate(heading.loads, 1)]
        flag = ["    VAR bool timed_out;"] if any(isinstance(step, CheckInput) for step in steps) else []
        return [*declared, *loads, f"  PROC {heading.name}()", *flag, *steps]

    def lines_of(self, step: Any, form: Form) -> list[str]:
        """See :meth:`Dialect.lines_of`."""
        return [f"{'  ' if form.slot is not None else self.indent}{line}" for line in form.write(step)]

    def forms(self, heading: Heading) -> list[Form]:
        """See :meth:`Dialect.forms`."""
        tool = f"t_{heading.tool_name}" if heading.tool_name else "tool0"
        object_ = rf"\WObj:=w_{heading.frame_name}" if heading.frame_name else ""
        axes = ",".join(["#"] * len(heading.external) + ["9E9"] * (6 - len(heading.external)))
        target = numbers(
            "",
            f"[[#,#,#,#,#,#],[{axes}]]",
            lambda step: [*np.rad2deg(step.q[heading.robot]), *heading.external_of(step)],
            heading.configuration,
            4,
        )

        def grip(step: SetLoad) -> str:
            return "load0" if step.payload is None else f"load_{heading.loads.index(step.payload) + 1}"

        def gripped(text: str) -> dict[str, Payload | None]:
            number = 0 if text == "load0" else int(text.removeprefix("load_"))
            if number > len(heading.loads):
                raise ValueError(f"{text} is not declared")
            return {"payload": heading.loads[number - 1] if number else None}

        def tcp() -> SE3:
            return pose() if heading.tool is None else heading.tool.tcp

        def declared(text: str) -> dict[str, int]:
            if int(text) != len(heading.loads) + 1:
                raise ValueError("loads are declared once, with the numbers 1, 2, ..")
            return {"number": int(text)}

        def part(step: LoadData) -> list[float]:
            return [step.payload.mass, *(1e3 * (tcp().inverse() * np.array(step.payload.center_of_mass)))]

        def parted(values: Sequence[float]) -> dict[str, Payload]:
            return {"payload": Payload(values[0], tcp() * (np.array(values[1:]) / 1e3))}

        declarations = [
            Form(
                UserFrame,
                f'LOCAL PERS wobjdata w_{heading.frame_name}:=[FALSE,TRUE,"",@,[[0,0,0],[1,0,0,0]]];@',
                (_pose("pose"), constant("name", heading.frame_name)),
                OBJECT,
            ),
            Form(
                ToolData,
                f"LOCAL PERS tooldata {tool}:=[TRUE,@,@];@",
                (
                    _pose("tcp"),
                    tool_load(LOAD, 1e3, 4, least=LEAST_MASS),
                    constant("name", heading.tool_name),
                ),
                TOOL,
            ),
        ]  # fmt: skip
        used = {ToolData: heading.tool_name, UserFrame: heading.frame_name}
        return [
            *(form for form in declarations if used[form.kind]),
            Form(
                LoadData,
                "LOCAL PERS loaddata load_@:=@;",
                (
                    Field("[1-9][0-9]*", lambda step: str(step.number), declared),
                    numbers("", LOAD, part, parted, 4),
                ),
                LOADS,
            ),
            Form(Setting, f"PROC {heading.name}()", (), ROUTINE),
            Form(Setting, "VAR bool timed_out;", (), FLAG),
            Form(JointMove, rf"MoveAbsJ @\NoEOffs, @, @, {tool}{object_};", (target, ANY_TIME, ZONE)),
            Form(LinearMove, f"MoveL CalcRobT(@, {tool}{object_}), @, @, {tool}{object_};", (target, LINE_TIME, ZONE)),
            Form(SetLoad, "GripLoad @;", (Field(r"load(?:0|_[1-9]\d*)", grip, gripped),)),
            *self.common_forms(
                "SetDO @, @;",
                "WaitTime @;",
                "WaitDI @I, @S \\MaxTime:=@T \\TimeFlag:=timed_out;\nIF timed_out THEN\n  @EEXIT;\nENDIF",
                ("0", "1"),
                4,
                "@;",
            ),
        ]


def _pose(name: str) -> Field:
    """The field of a pose: millimetres and a quaternion."""
    return numbers(
        name,
        "[[#,#,#],[#,#,#,#]]",
        lambda step: [*(1e3 * getattr(step, name).translation), *quaternion(getattr(step, name))],
        lambda v: pose(np.array(v[:3]) / 1e3, quat_xyzw=[*v[4:], v[3]]),
        9,
    )


def _timed(step: JointMove | LinearMove) -> str:
    if step.duration is None and isinstance(step, LinearMove) and step.speed is not None:
        return f"[{1e3 * step.speed:.4f},500,5000,1000]"
    if step.duration is None and isinstance(step, JointMove):
        return "v100"
    return rf"v1000\T:={rounded_up(step.duration or 1.0, 1e-4, 0.01):.4f}"


def _time(text: str) -> Mapping[str, float]:
    if text.startswith("["):
        return {"speed": positive(text[1:].split(",")[0]) / 1e3}
    _, stated, duration = text.partition("\\T:=")
    return {"duration": positive(duration)} if stated else {}


def _zone(step: JointMove | LinearMove) -> str:
    if step.blend is None:
        return "fine"
    if step.blend.radius is None:
        return "z10"
    return f"z{max((radius for radius in RADII if radius <= 1e3 * step.blend.radius + 1e-6), default=0)}"


ANY_TIME = Field(rf"{SPEEDS}(?:\\T:={NUMBER})?", _timed, _time)
LINE_TIME = Field(rf"{SPEEDS}\\T:={NUMBER}|\[{NUMBER},500,5000,1000\]", _timed, _time)
ZONE = Field(f"fine|{ZONES}", _zone, lambda text: {"blend": None if text == "fine" else Blend(share=0.5)})
