"""LS files of FANUC (the ASCII form of TP programs): moves, ``PAYLOAD``, ``DO``, ``WAIT DI`` and ``WAIT``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinproof.errors import InputError, TrajectoryError
from pinproof.motion.dialects.dialect import (
    NUMBER,
    Blend,
    Body,
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
    from_degrees,
    in_degrees,
    numbers,
    plain,
    positive,
    rounded_up,
    tool_load,
)

# A regular expression for the number of a position; with leading zeros one position would have several names.
INDEX = r"[1-9]\d*"
# Per cent of the axis velocities of a move whose duration is not stated.
SPEED = 5
# A pose in three remarks, and a load in the remarks before it: a TP program cannot state their values otherwise.
POSE = "X # Y # ;\n!Z # W # ;\n!P # R # ;"
LOAD = "#kg ;\n!X # Y # Z # ;"
# The order of the declarations.
FRAME, TOOL = range(2)


class Fanuc(Dialect):
    """LS files; positions are joint representations, which most arms measure with joint 3 from the horizontal."""

    name = "fanuc"
    endings = (".ls",)
    external = 6
    cruises = True
    comment_mark = "!pp"
    comment_width = 28
    outputs = "1"
    zones = (Blend(share=0.5),)
    deviation = 0.002
    remark = ("!", " ;")
    required = (FRAME, TOOL)
    indent = ":  "
    prefix = r"\d*\s*:\s*"
    call = "CALL @ ;"

    def frame(self, heading: Heading) -> tuple[list[str], list[str]]:
        """See :meth:`Dialect.frame`."""
        group = f"DEFAULT_GROUP = 1,{'1' if heading.external else '*'},*,*,*;"
        return [f"/PROG  {heading.name.upper()}", "/ATTR", 'COMMENT = "pinproof";', group, "/MN"], []

    opened = 5

    def main(self, programs: Sequence[str]) -> str:
        """See :meth:`Dialect.main`."""
        return super().main([name.upper() for name in programs]) + "/POS\n/END\n"

    def arranged(self, heading: Heading, steps: Sequence[Step]) -> list[Any]:
        """See :meth:`Dialect.arranged`."""
        for step in steps:
            if isinstance(step, SetLoad) and step.payload is not None and step.payload not in heading.loads:
                heading.loads.append(step.payload)
        return [heading.frame or ":  UFRAME_NUM=0 ;", heading.tool or ":  UTOOL_NUM=1 ;", *steps]

    def lines_of(self, step: Any, form: Form) -> list[str]:
        """See :meth:`Dialect.lines_of`."""
        return [f"{':' if isinstance(step, Move) else self.indent}{line}" for line in form.write(step)]

    def write(self, heading: Heading, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """See :meth:`Dialect.write`."""
        before, lines, _ = super().write(heading, steps)
        rows = _entry(heading)
        after = ["/POS"]
        for number, q in heading.positions.items():
            values = [*np.rad2deg(q[heading.robot]), *heading.external_of(JointMove(q))]
            first, *rest = "\n".join(rows).replace("@", str(number), 1).split("#")
            after += (first + "".join(plain(x, 3) + text for x, text in zip(values, rest, strict=True))).split("\n")
        return before, lines, [*after, "/END"]

    def comment(self, words: str) -> str:
        """See :meth:`Dialect.comment`."""
        return f":  {self.comment_mark} {words} ;"

    def comment_of(self, line: str) -> str | None:
        """See :meth:`Dialect.comment_of`."""
        found = re.fullmatch(rf"[ \t]*[0-9]*[ \t]*:[ \t]*{self.comment_mark} ([^;]*) ;[ \t]*", line)
        return None if found is None else found[1]

    def remark_of(self, step: Any) -> str:
        """See :meth:`Dialect.remark_of`; a remark has at most 32 characters."""
        words = super().remark_of(step)
        return f"- {words}"[:32].rstrip() if words.startswith("pp") else words[:32].rstrip()

    def names_itself(self, heading: Heading, lines: Sequence[str]) -> bool:
        """See :meth:`Dialect.names_itself`."""
        return any(re.search(rf"\bCALL\s+{heading.name}\b", line, re.IGNORECASE) for line in lines)

    def numbered(self, text: str) -> str:
        """See :meth:`Dialect.numbered`."""
        number, lines = 0, []
        for line in text.split("\n")[:-1]:
            number += line.startswith(":")
            lines.append(f"{number:4d}{line}" if line.startswith(":") else line)
        return "\n".join(lines) + "\n"

    def read(self, source: str, body: Body, heading: Heading) -> list[Step]:
        """See :meth:`Dialect.read`."""
        places = [k for k, (_, line) in enumerate(body) if line.strip() == "/POS"]
        if len(places) != 1:
            raise TrajectoryError(source, "has no section /POS, or several")
        _read_positions(source, body[places[0] + 1 :], heading)
        return super().read(source, body[: places[0]], heading)

    def forms(self, heading: Heading) -> list[Form]:
        """See :meth:`Dialect.forms`."""

        def place(step: JointMove | LinearMove) -> str:
            if step.q is None:
                raise InputError("a linear move in fanuc needs the joint values at its end")
            heading.positions[len(heading.positions) + 1] = step.q
            return str(len(heading.positions))

        def placed(text: str) -> Mapping[str, Any]:
            if int(text) not in heading.positions:
                raise ValueError(f"position P[{text}] is not defined")
            return {"q": heading.positions[int(text)]}

        def label(more: int) -> Field:
            """The label of a check: two are counted for each."""

            def write(_: Any) -> str:
                heading.labels += more
                return str(heading.labels)

            def read(text: str) -> Mapping[str, Any]:
                heading.labels += more
                if int(text) != heading.labels:
                    raise ValueError(f"its label must be LBL[{heading.labels}]")
                return {}

            return Field(INDEX, write, read)

        def schedule(step: SetLoad) -> str:
            return "1" if step.payload is None else str(heading.loads.index(step.payload) + 2)

        load, schedules, read_last = heading.carried(LOAD, 1e3, 3), dict[str, str](), [""]

        def numbered(text: str) -> Mapping[str, Any]:
            read_last[0] = text
            return {}

        def scheduled(text: str) -> Mapping[str, Any]:
            """The load of a schedule, of which the pendant holds one: 1 is the tool alone, the others have a part."""
            read, number = load.read(text), read_last[0]
            if (number == "1") is not (read["payload"] is None) or schedules.setdefault(number, text) != text:
                raise ValueError(f"PAYLOAD[{number}] has another load: 1 is that of the tool, and others have one each")
            return read

        number = Field(INDEX, schedule, numbered)
        again = Field(r"\1", schedule, lambda _: {})
        at = Field(INDEX, place, placed)
        tool = (
            _pose("tcp"),
            tool_load(f"\n!PAYLOAD 1 {LOAD}\nPAYLOAD[1] ;", 1e3, 3),
            constant("name", heading.tool_name),
        )
        user = (_pose("pose"), constant("name", heading.frame_name))
        if heading.frame_name:
            declared = [Form(UserFrame, "!UFRAME 1 @\nUFRAME_NUM=1 ;@", user, FRAME)]
        else:
            declared = [Form(Setting, "UFRAME_NUM=0 ;", (), FRAME)]
        if heading.tool_name:
            declared.append(Form(ToolData, "!UTOOL 1 @\nUTOOL_NUM=1 ;@@", tool, TOOL))
        else:
            declared.append(Form(Setting, "UTOOL_NUM=1 ;", (), TOOL))
        return [
            *declared,
            Form(JointMove, "J P[@] @ @ ;", (at, Field(rf"(?:100|[1-9]\d?)%|{INDEX}msec", _timed, _time), TERMINATION)),
            Form(LinearMove, "L P[@] @ @ ;", (at, Field(f"{INDEX}(?:msec|mm/sec)", _timed, _time), TERMINATION)),
            Form(SetLoad, "!PAYLOAD @ @\nPAYLOAD[@] ;", (number, load._replace(read=scheduled), again)),
            *self.common_forms(
                "DO[@]=@ ;",
                "WAIT @(sec) ;",
                "$WAITTMOUT=@T ;\nWAIT DI[@I]=@S TIMEOUT,LBL[@A] ;\nJMP LBL[@A] ;\nLBL[@B] ;\n@EABORT ;\nLBL[@A] ;",
                ("OFF", "ON"),
                2,
                "CALL @ ;",
                1e-2,
                {"A": label(1), "B": label(-1)},
            ),
        ]


def _timed(step: JointMove | LinearMove) -> str:
    if step.duration is not None or (isinstance(step, LinearMove) and step.speed is None):
        return f"{round(rounded_up((step.duration or 1.0) * 1000, 1.0, 1.0))}msec"
    if isinstance(step, LinearMove):
        return f"{max(int(1e3 * (step.speed or 0.0) + 1e-6), 1)}mm/sec"
    return f"{step.percent or SPEED}%"


def _time(text: str) -> Mapping[str, float]:
    value = positive(text.rstrip("%/cems"))
    if text.endswith("%"):
        return {"percent": int(value)}
    return {"speed": value / 1e3} if text.endswith("/sec") else {"duration": value / 1e3}


def _pose(name: str) -> Field:
    """The field of a pose: millimetres, and degrees about the fixed axes X, Y and Z."""
    return numbers(name, POSE, lambda step: in_degrees(getattr(step, name)), from_degrees, 3)


def _termination(step: JointMove | LinearMove) -> str:
    if step.blend is None:
        return "FINE"
    if step.blend.radius is not None:
        raise InputError("a blend in fanuc has no radius, but uses a share of the two moves")
    return f"CNT{min(int(100 * step.blend.stated + 1e-9), 100)}"


def _blend(text: str) -> Mapping[str, Blend | None]:
    return {"blend": None if text == "FINE" else Blend(share=0.5, stated=int(text.removeprefix("CNT")) / 100)}


# A blend may use half of each move with every CNT value, because the manual states no extent for less than 100.
TERMINATION = Field(r"FINE|CNT(?:100|[1-9]?\d)", _termination, _blend)


def _entry(heading: Heading) -> list[str]:
    """The lines of a position, with ``@`` for its number and ``#`` for the values of its joints."""
    frame = f"    UF : {1 if heading.frame_name else 0}, UT : 1,"
    own = ", ".join(f"J{k} = # deg" for k in range(1, 7))
    outer = ", ".join(f"J{k} = # {unit}" for k, unit in enumerate(heading.external.values(), 1))
    second = ["   GP2:", frame, f"    {outer}"] if outer else []
    return ["P[@]{", "   GP1:", frame, f"    {own}", *second, "};"]


def _read_positions(source: str, body: Body, heading: Heading) -> None:
    """Read the positions of the section /POS."""
    if not body or body[-1][1].strip() != "/END":
        raise TrajectoryError(source, "must end with /END")
    entry = [
        re.escape(row.strip()).replace(r"\ ", "[ \t]+").replace(r"\#", f"({NUMBER})").replace("@", f"({INDEX})")
        for row in _entry(heading)
    ]
    number, values = 0, list[float]()
    for k, (line, words) in enumerate(body[:-1]):
        part = k % len(entry)
        found = re.fullmatch(entry[part], words.strip())
        if found is None or (part == 0 and int(found[1]) in heading.positions):
            needed = f"{' '.join(row.strip() for row in _entry(heading))!r}, each number n once"
            raise TrajectoryError(
                source, f"{words.strip()!r} is not supported in /POS; needed is {needed}", f"line {line}"
            )
        if part == 0:
            number, values = int(found[1]), []
            continue
        values += [float(each) for each in found.groups()]
        if not np.isfinite(values).all():
            raise TrajectoryError(source, f"{words.strip()!r}: a number is not finite", f"line {line}")
        if part == len(entry) - 1:
            heading.positions[number] = heading.configuration(values)["q"]
    if (len(body) - 1) % len(entry):
        raise TrajectoryError(source, "the last position of /POS is not complete", f"line {body[-1][0]}")
