"""Edited programs against interpreters of the four languages that share no code with the readers.

An interpreter follows the rules of its language: a comment ends with its line, LF or CRLF end a line, only the first
routine is executed, from its first instruction to its end, and words are read whole. It raises ``Ambiguous`` where the
manual does not state what a controller does. A reader must refuse such a text, and read every other one that it accepts
as the interpreter does.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import TrajectoryError
from pinproof.motion.dialects import DIALECTS
from pinproof.motion.program_steps import JointMove, LinearMove, SetOutput, Step, Wait
from pinproof.motion.robot_program import RobotProgram, make_program

NAMES = tuple(f"joint_{i}" for i in range(1, 7))
OUTPUT = {"urscript": "0", "rapid": "do_gripper", "krl": "1", "fanuc": "1"}
EDITS = 500
"""Edited programs of each language."""


class Ambiguous(Exception):
    """The text is no program, or one whose execution is not stated by the manual."""


# -- interpreters --------------------------------------------------------------------------------------------------


def code_lines(text: str, comment: str) -> list[str]:
    """The lines without comments; a character that may or may not end a line is ambiguous."""
    found = []
    for line in text.split("\n"):
        code = line.split(comment)[0] if comment else line
        if re.search(r"[^\x20-\x7e\t]", code.rstrip("\r")):
            raise Ambiguous(line)
        if re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029]", line.rstrip("\r")):
            raise Ambiguous(line)  # inside a comment, which may end here
        found.append(code.strip())
    return [line for line in found if line]


def number(text: str) -> float:
    if not re.fullmatch(r"[-+]?[0-9]+(\.[0-9]*)?([eE][-+]?[0-9]+)?|[-+]?\.[0-9]+", text.strip()):
        raise Ambiguous(text)
    return float(text)


def six(text: str, scale: float = 1.0) -> tuple[float, ...]:
    words = text.split(",")
    if len(words) != 6:
        raise Ambiguous(text)
    return tuple(scale * number(word) for word in words)


def body_of(lines: list[str], opening: list[str], closing: list[str]) -> list[str]:
    """What stands in the only routine of a text."""
    if len(lines) < len(opening) + len(closing):
        raise Ambiguous("not complete")
    for pattern, line in [
        *zip(opening, lines, strict=False),
        *zip(closing, lines[len(lines) - len(closing) :], strict=True),
    ]:
        if not re.fullmatch(pattern, line):
            raise Ambiguous(line)
    inner = lines[len(opening) : len(lines) - len(closing)]
    for line in inner:
        if any(re.fullmatch(pattern, line) for pattern in (*opening, *closing)):
            raise Ambiguous(line)  # another routine, or code behind the end
    return inner


def arguments(line: str, name: str) -> tuple[str, dict[str, str]]:
    """The list of joint values of a call, and its named arguments."""
    found = re.fullmatch(rf"{name}\(\[([^\[\]]*)\]((?:, [a-z_]+=[^,()]+)*)\)", line)
    if found is None:
        raise Ambiguous(line)
    pairs = [pair.split("=") for pair in found[2].split(", ")[1:]]
    if len({key for key, _ in pairs}) < len(pairs):
        raise Ambiguous(line)
    return found[1], dict(pairs)


def run_urscript(text: str) -> list[tuple]:
    done = []
    for line in body_of(code_lines(text, "#"), [r"def [A-Za-z_]\w*\(\):"], ["end"]):
        if line.startswith(("movej", "movel")):
            q, given = arguments(line, line[:5])
            time = number(given["t"]) if "t" in given else None
            if (time is None) != ({"a", "v"} <= given.keys()) or (time is not None and time <= 0):
                raise Ambiguous(line)
            kind = "joint" if line[4] == "j" else "line"
            done.append((kind, six(q), time, number(given.get("r", "0")) > 0))
        elif line.startswith("sleep"):
            done.append(("wait", number(line[6:-1])))
        elif found := re.fullmatch(r"set_standard_digital_out\((\d+),\s+(True|False)\)", line):
            done.append(("output", found[1], found[2] == "True"))
        elif line != "stopj(10)":
            raise Ambiguous(line)
    return done


def run_rapid(text: str) -> list[tuple]:
    done = []
    lines = code_lines(text, "!")
    for line in body_of(lines, [r"MODULE \w+", r"PROC \w+\(\)"], ["ENDPROC", "ENDMODULE"]):
        if line.count(";") != 1 or not line.endswith(";"):
            raise Ambiguous(line)
        place = r"\[\[([^\[\]]*)\],\[9E9,9E9,9E9,9E9,9E9,9E9\]\]"
        if found := re.fullmatch(rf"MoveAbsJ {place}\\NoEOffs, v\d+(\\T:=([^,]+))?, (fine|z\d+), tool0;", line):
            time = number(found[3]) if found[3] else None
            done.append(("joint", six(found[1], np.pi / 180), time, found[4] != "fine"))
        elif found := re.fullmatch(rf"MoveL CalcRobT\({place}, tool0\), v\d+\\T:=([^,]+), fine, tool0;", line):
            done.append(("line", six(found[1], np.pi / 180), number(found[2]), False))
        elif found := re.fullmatch(r"WaitTime\s+(\S+);", line):
            done.append(("wait", number(found[1])))
        elif found := re.fullmatch(r"SetDO\s+([A-Za-z]\w*),\s+([01]);", line):
            done.append(("output", found[1], found[2] == "1"))
        else:
            raise Ambiguous(line)
    return done


def run_krl(text: str) -> list[tuple]:
    done = []
    for line in body_of(code_lines(text, ";"), [r"DEF \w+\(\)"], ["END"]):
        if found := re.fullmatch(r"PTP \{(.*)\}( C_PTP)?", line):
            axes = [part.split() for part in found[1].split(",")]
            if [axis[0] for axis in axes if len(axis) == 2] != [f"A{k}" for k in range(1, 7)] or len(axes) != 6:
                raise Ambiguous(line)
            done.append(("joint", tuple(np.deg2rad(number(value)) for _, value in axes), None, found[2] is not None))
        elif found := re.fullmatch(r"LIN \{X (\S+),Y (\S+),Z (\S+),A (\S+),B (\S+),C (\S+)\}", line):
            x, y, z, a, b, c = (number(word) for word in found.groups())
            place = pp.pose((x / 1000, y / 1000, z / 1000), tuple(np.deg2rad([c, b, a]).tolist()))
            done.append(("line", tuple(place.homogeneous.ravel().tolist()), None, False))
        elif found := re.fullmatch(r"WAIT\s+SEC\s+(\S+)", line):
            done.append(("wait", number(found[1])))
        elif found := re.fullmatch(r"\$OUT\[0*([1-9]\d*)\]=(TRUE|FALSE)", line):
            done.append(("output", found[1], found[2] == "TRUE"))
        elif not re.fullmatch(r"BAS\(#INITMOV,0\)|BAS\(#VEL_PTP,\d+\)|BAS\(#VEL_CP,[\d.]+\)|\$APO\.CPTP=[\d.]+", line):
            raise Ambiguous(line)
    return done


def run_fanuc(text: str) -> list[tuple]:
    lines = []
    for line in code_lines(text, ""):
        instruction = re.sub(r"^\d*\s*:\s*", "", line)
        if instruction.startswith("!"):
            if instruction.count(";") != 1 or not instruction.endswith(";"):
                raise Ambiguous(line)
        else:
            lines.append(instruction if line.startswith(tuple("0123456789:")) else line)
    if lines.count("/POS") != 1 or lines.count("/MN") != 1 or lines[-1] != "/END":
        raise Ambiguous("sections")
    head, code = lines[: lines.index("/MN")], lines[lines.index("/MN") + 1 : lines.index("/POS")]
    if len(head) != 4 or not head[0].startswith("/PROG") or head[1] != "/ATTR":
        raise Ambiguous("header")
    positions: dict[str, tuple[float, ...]] = {}
    rest = lines[lines.index("/POS") + 1 : -1]
    for k in range(0, len(rest), 5):
        start, group, frame, values, end = rest[k : k + 5] if k + 5 <= len(rest) else ("",) * 5
        name = re.fullmatch(r"P\[(\d+)\]\{", start)
        if name is None or group != "GP1:" or frame != "UF : 0, UT : 1," or end != "};" or name[1] in positions:
            raise Ambiguous(start)
        words = [re.fullmatch(rf"J{j} = (\S+) deg", part) for j, part in enumerate(values.split(", "), 1)]
        if len(words) != 6 or None in words:
            raise Ambiguous(values)
        positions[name[1]] = tuple(np.deg2rad(number(word[1])) for word in words)
    done = []
    for line in code:
        if found := re.fullmatch(r"J P\[(\d+)\] (\d+)(msec|%) (FINE|CNT\d+) ;", line):
            time = int(found[2]) / 1000 if found[3] == "msec" else None
            if found[1] not in positions or time == 0:
                raise Ambiguous(line)
            done.append(("joint", positions[found[1]], time, found[4] != "FINE"))
        elif found := re.fullmatch(r"L P\[(\d+)\] (\d+)msec FINE ;", line):
            if found[1] not in positions or int(found[2]) == 0:
                raise Ambiguous(line)
            done.append(("line", positions[found[1]], int(found[2]) / 1000, False))
        elif found := re.fullmatch(r"WAIT\s+(\S+)\(sec\)\s+;", line):
            done.append(("wait", number(found[1])))
        elif found := re.fullmatch(r"DO\[0*([1-9]\d*)\]=(ON|OFF)\s+;", line):
            done.append(("output", found[1], found[2] == "ON"))
        elif line not in ("UFRAME_NUM=0 ;", "UTOOL_NUM=1 ;"):
            raise Ambiguous(line)
    return done


INTERPRETERS = {"urscript": run_urscript, "rapid": run_rapid, "krl": run_krl, "fanuc": run_fanuc}


# -- what the readers say ------------------------------------------------------------------------------------------


def read_steps(steps: tuple[Step, ...]) -> list[tuple]:
    """The steps of a reader in the form of the interpreters."""
    found = []
    for step in steps:
        if isinstance(step, JointMove):
            found.append(("joint", tuple(step.q), step.duration, step.blend is not None))
        elif isinstance(step, LinearMove):
            values = step.q if step.q is not None else step.pose.homogeneous.ravel()
            found.append(("line", tuple(values), step.duration, False))
        elif isinstance(step, SetOutput):
            found.append(("output", step.output.lstrip("0") or step.output, step.on))
        elif isinstance(step, Wait):
            found.append(("wait", step.seconds))
    return found


def same(read: list[tuple], executed: list[tuple]) -> bool:
    def flat(rows: list[tuple]) -> list:
        return [part for row in rows for cell in row for part in (cell if isinstance(cell, tuple) else (cell,))]

    a, b = flat(read), flat(executed)
    return len(a) == len(b) and all(
        abs(x - y) <= 1e-12 if isinstance(x, float) and isinstance(y, float) else x == y
        for x, y in zip(a, b, strict=True)
    )


# -- edits ---------------------------------------------------------------------------------------------------------

ENDINGS = ("\r", "\x0b", "\x0c", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029", "\x00")
STRUCTURE = {
    "urscript": ["def more():", "end", "if True:", "thread t():"],
    "rapid": ["PROC more()", "ENDPROC", "MODULE more", "ENDMODULE", "TRAP t", "FUNC num f()"],
    "krl": ["DEF more()", "END", "DEFFCT INT f()", "ENDFCT"],
    "fanuc": ["/POS", "/MN", "/END", "/PROG  MORE", ":  END ;", ":  UTOOL_NUM=2 ;", ":  UFRAME_NUM=3 ;"],
}


def program_text(dialect: str, rng: np.random.Generator) -> str:
    q, blend = rng.uniform(-1, 1, (5, 6)), DIALECTS[dialect].blend
    moves = [JointMove(row, None if k == 0 else 2.0, blend if k == 1 else None) for k, row in enumerate(q)]
    line = LinearMove(q[2] - 0.01, pp.pose((0.1, -0.2, 0.5), (0.3, -0.4, 2.5)), 1.25)
    steps = [*moves[:3], line, SetOutput(OUTPUT[dialect], True), Wait(0.25), *moves[3:]]
    return make_program(steps, NAMES, dialect=dialect).text


def edited(text: str, dialect: str, rng: np.random.Generator) -> str:
    """The text after one to three random edits."""
    for _ in range(rng.integers(1, 4)):
        lines = text.split("\n")
        k = int(rng.integers(len(lines)))
        at = int(rng.integers(len(lines[k]) + 1))
        instructions = [line for line in lines if re.search(r"move|MoveAbsJ|MoveL|PTP|LIN|J P|L P", line)]
        another = str(rng.choice(instructions)) if instructions else ""
        kind = int(rng.integers(14))
        if kind == 0:
            lines[k] += str(rng.choice(ENDINGS)) + another
        elif kind == 1:
            lines.insert(k, str(rng.choice(STRUCTURE[dialect])))
        elif kind == 2:
            lines.insert(k, another)
        elif kind == 3:
            del lines[k]
        elif kind == 4 and k + 1 < len(lines):
            lines[k], lines[k + 1] = lines[k + 1], lines[k]
        elif kind == 5:
            lines[k] = lines[k][:at] + str(rng.integers(10)) + lines[k][at:]
        elif kind == 6:
            lines[k] = (
                lines[k][:at] + str(rng.choice(["\t", "  ", "\u00a0", "\u0663", ";", "#", "!", ","])) + lines[k][at:]
            )
        elif kind == 7:
            lines[k] = lines[k][:at] + lines[k][at + 1 :]
        elif kind == 8:
            lines[k] = lines[k].swapcase()
        elif kind == 9 and k + 1 < len(lines):
            lines[k : k + 2] = [lines[k] + " " + lines[k + 1]]
        elif kind == 10:
            lines = [line + "\r" for line in lines]
        elif kind == 11:
            lines += [str(rng.choice(STRUCTURE[dialect])), another, str(rng.choice(STRUCTURE[dialect]))]
        elif kind == 12:
            lines = [str(rng.choice(STRUCTURE[dialect])), another, *lines]
        else:
            lines[k] = lines[k][:at] + str(rng.choice(ENDINGS)) + lines[k][at:]
        text = "\n".join(lines)
    return text


@pytest.mark.slow
@pytest.mark.parametrize("dialect", INTERPRETERS)
def test_no_edited_program_is_read_otherwise_than_it_is_executed(dialect: str) -> None:
    rng, interpret = np.random.default_rng(1), INTERPRETERS[dialect]
    counts = {"unedited": 0, "changed": 0, "refused": 0}
    for _ in range(EDITS):
        original = program_text(dialect, rng)
        wanted = interpret(original)
        assert same(read_steps(RobotProgram.parse(original, dialect=dialect).steps), wanted)
        text = edited(original, dialect, rng)
        for allowed in (False, True):
            try:
                steps = read_steps(RobotProgram.parse(text, dialect=dialect, allow_changes=allowed).steps)
            except TrajectoryError:
                counts["refused"] += 1
                continue
            executed = interpret(text)  # raises Ambiguous for what should have been refused
            assert same(steps, executed), text
            if not allowed:
                assert same(executed, wanted), text
            counts["changed" if allowed else "unedited"] += 1
    # The edits must reach both sides: harmless ones are accepted, and others are read as changed programs.
    assert min(counts.values()) > 20, counts
