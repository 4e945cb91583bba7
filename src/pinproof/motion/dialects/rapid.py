"""RAPID of ABB: ``MoveAbsJ``, ``MoveL``, ``AccSet``, tool, work object and load data, ``SetDO`` and waiting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinproof.errors import InputError, TrajectoryError
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

# The radii (mm) of the predefined zones by their numbers.
RADII = {number: max(number, 0.3) for number in (0, 1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)}
ZONES = "z(?:" + "|".join(map(str, RADII)) + ")"
# By which factor of its radius a zone is covered: that of orientations and external axes is 1.5 times as large, and
# between joint moves a zone "may differ somewhat" from its radius.
LARGER = 2.0
# kg: the least mass of a tool.
LEAST_MASS = 0.001
# The text of a load: its mass and its centre of mass in millimetres.
LOAD = "[#,[#,#,#],[1,0,0,0],0,0,0]"
# The order of the declarations.
TOOL, OBJECT, LOADS, ROUTINE, FLAG, USUAL = range(6)
# A routine that ran before may have set other accelerations; durations and limits are judged with the usual ones.
ACCELERATIONS = "AccSet 100, 100;"


class Rapid(Dialect):
    """RAPID; a zone has a radius, and uses at most half of the move to its point and half of the move after it."""

    name = "rapid"
    endings = (".mod", ".modx", ".prg")
    longest = 30  # of 32, without the prefix of the module
    external = 6
    comment_mark = "! pinproof:"
    outputs = "do_gripper"
    zones = tuple(Blend(LARGER * radius / 1e3, 0.5, 1.0 / LARGER) for radius in reversed(RADII.values()))
    deviation = 0.002
    signals, signal_kind = NAME, "names, such as do_gripper or di_part"
    remark = ("! ", "")
    required = (ROUTINE, USUAL)
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
        return [*declared, *loads, f"  PROC {heading.name}()", *flag, f"    {ACCELERATIONS}", *steps]

    def completed(self, source: str, items: Sequence[Any]) -> list[Step]:
        """See :meth:`Dialect.completed`."""
        for item in [each for each in items if isinstance(each, JointMove)][1:]:
            if item.duration is None:
                reason = r"a joint move after the first one must state its time, such as v1000\T:=1.5"
                raise TrajectoryError(source, reason, f"line {item.line}")
        return list(items)

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
            Form(Setting, ACCELERATIONS, (), USUAL),
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
    """The field of a pose: millimetres and a unit quaternion."""

    def made(v: Sequence[float]) -> SE3:
        if abs(np.linalg.norm(v[3:]) - 1.0) > 1e-6:
            raise ValueError("a quaternion must have the length 1")
        return pose(np.array(v[:3]) / 1e3, quat_xyzw=[*v[4:], v[3]])

    def values(step: ToolData | UserFrame) -> list[float]:
        return [*(1e3 * getattr(step, name).translation), *quaternion(getattr(step, name))]

    return numbers(name, "[[#,#,#],[#,#,#,#]]", values, made, 9)


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
        raise InputError("a blend in rapid needs a radius in metres")
    stated = 1e3 * step.blend.radius * step.blend.stated
    return f"z{max((number for number, radius in RADII.items() if radius <= stated + 1e-6), default=0)}"


def _blend(text: str) -> Mapping[str, Blend | None]:
    if text == "fine":
        return {"blend": None}
    return {"blend": Blend(LARGER * RADII[int(text[1:])] / 1e3, 0.5, 1.0 / LARGER)}


# The speed of a move of a stated time has no effect; the first move has the slow one, others must state a time.
ANY_TIME = Field(rf"v100|v1000\\T:={NUMBER}", _timed, _time)
LINE_TIME = Field(rf"v1000\\T:={NUMBER}|\[{NUMBER},500,5000,1000\]", _timed, _time)
ZONE = Field(f"fine|{ZONES}", _zone, _blend)
