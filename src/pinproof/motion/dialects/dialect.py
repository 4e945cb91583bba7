"""The steps of a robot program, and what a language of robot programs defines: the writing and reading of its lines."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from pinproof.common.structs import described, key
from pinproof.errors import InputError, TrajectoryError, UnknownNameError
from pinproof.model import Arm, Payload
from pinproof.motion.trajectory_files import Record
from pinproof.spatial import SE3, Array, log6, pose, xyz_rpy

# -- steps -------------------------------------------------------------------------------------------------------------


@described()
class Blend:
    """The part of the two moves at a point in which the controller may leave their straight lines."""

    radius: float | None = key(
        "the blend may use the part of the moves on which the tcp is this close to its position at the point; None if "
        "the language states no distance",
        "m",
        default=None,
    )
    share: float = key("largest share of each of the two moves that the blend may use", default=1.0)
    stated: float = key(
        "share of the radius, or else of the share, that the text states and the duration is computed with; less than "
        "1 where the manual permits the controller a larger blend",
        default=1.0,
    )


@described(eq=False)
class JointMove:
    """A move on a straight line in joint space: all joints start and end at the same time, in constant proportion."""

    q: Array = key("(n,) rad, the end of the move")
    duration: float | None = key("None if the text states a speed instead", "s", default=None)
    blend: Blend | None = key("None for a stop at the end", default=None)
    line: int = key("the line number in the text, from 1", default=0)
    speed: float | None = key("rad/s of the joint that moves farthest; None if the text states none", default=None)
    percent: int | None = key(
        "per cent of the velocity limits of the joints, for languages that state neither; None if the text states none",
        default=None,
    )
    acceleration: float | None = key(
        "rad/s^2 of the joint that moves farthest; None if the text states none", default=None
    )
    gain: int | None = key("as ``percent``, of the acceleration limits of the joints", default=None)


@described(eq=False)
class LinearMove:
    """A move of the tcp on a straight line."""

    q: Array | None = key("(n,) rad, the configuration at the end; None if the text states the pose", default=None)
    pose: SE3 | None = key("``base_from_tcp`` at the end; None if the text states joint values", default=None)
    duration: float | None = key("None if the text states a speed instead", "s", default=None)
    line: int = key("the line number in the text, from 1", default=0)
    speed: float | None = key("m/s of the tcp; None if the text states none", default=None)
    blend: Blend | None = key("None for a stop at the end", default=None)
    external: Array | None = key(
        "rad or m, the values of the external joints at the end, if the text states the pose; None without them",
        default=None,
    )
    acceleration: float | None = key("m/s^2 of the tcp; None if the text states none", default=None)


@dataclass(frozen=True, eq=False)
class StreamedPoint:
    """A set point that the program sends every ``period`` seconds; the arm does not stop."""

    q: Array
    period: float
    line: int = 0


@dataclass(frozen=True, eq=False)
class StreamedTrajectory:
    """The points of a trajectory that the controller interpolates exactly as :class:`~pinproof.Trajectory` does."""

    record: Record
    line: int = 0


@dataclass(frozen=True)
class SetOutput:
    """A digital output, such as that of a gripper, switched while the arm rests."""

    output: str
    on: bool
    line: int = 0


@dataclass(frozen=True)
class Wait:
    """A waiting time in seconds, while the arm rests."""

    seconds: float
    line: int = 0


@dataclass(frozen=True)
class CheckInput:
    """A wait for a digital input, such as the sensor of a gripper.

    If it does not have the state within ``seconds``, the routine ``error`` of the controller is called, if one is
    stated, and the program ends.
    """

    input: str
    on: bool
    seconds: float
    line: int = 0
    error: str = ""


@dataclass(frozen=True, eq=False)
class SetLoad:
    """The part that the hand carries after this step; None for the hand alone.

    Mass and centre of mass of the payload are stated in the axes of the flange. Programs state no inertia.
    """

    payload: Payload | None
    line: int = 0


@dataclass(frozen=True)
class Remark:
    """A comment that a person reads."""

    words: str
    line: int = 0


Move = JointMove | LinearMove | StreamedPoint | StreamedTrajectory
Step = Move | SetOutput | CheckInput | SetLoad | Wait | Remark


@described(eq=False)
class ToolData:
    """The tool of a program, which its linear moves and its blends refer to."""

    name: str = key("the name of the tool")
    tcp: SE3 = key("``flange_from_tcp``")
    mass: float = key("mass of the tool", "kg", default=0.0)
    center_of_mass: Array = key("(3,) m, its centre of mass in the axes of the flange", default=(0.0, 0.0, 0.0))


@described(eq=False)
class UserFrame:
    """The frame in which a program states its poses: a work object, a base or a user frame."""

    name: str = key("the name of the frame")
    pose: SE3 = key("``base_from_frame``")


def external_joints(arm: Arm, stated: Iterable[str] | None = None) -> dict[str, str]:
    """The joints of an arm that a controller moves as external axes, each with its unit: ``"mm"`` or ``"deg"``.

    They are those that are stated; by default the prismatic joints before the last six joints, such as a rail.

    Raises
    ------
    InputError
        If six joints do not remain for the robot, or one of them is prismatic.
    UnknownNameError
        If a stated joint does not exist.
    """
    units = dict(zip(arm.joint_names, ("deg" if angular else "mm" for angular in arm.angular), strict=True))
    chosen = [name for name in arm.joint_names[:-6] if units[name] == "mm"] if stated is None else list(stated)
    for name in chosen:
        if name not in units:
            raise UnknownNameError("joint", name, units, "external_axes")
    own = [name for name in units if name not in chosen]
    if len(own) != 6 or any(units[name] == "mm" for name in own):
        raise InputError(
            f"a program of a controller needs six revolute joints of the robot; beside the external joints "
            f"({', '.join(chosen) or 'none'}) the arm has {', '.join(own)}. State the others as external_axes"
        )
    return {name: units[name] for name in units if name in chosen}


# -- languages ---------------------------------------------------------------------------------------------------------

# The lines of a program without the comments of pinproof, each with its number.
Body = Sequence[tuple[int, str]]
# A regular expression for a decimal number in the form that all languages share, without sign + and exponent.
NUMBER = r"-?\d+(?:\.\d+)?"
# The radii (m) of zones that are compared in languages in which they may be any number.
RADII = (0.2, 0.15, 0.1, 0.08, 0.06, 0.05, 0.04, 0.03, 0.025, 0.02, 0.015, 0.01, 0.005, 0.003, 0.002, 0.001, 0.0005)
# A regular expression for the name of a routine.
NAME = r"[A-Za-z]\w*"
# Words that a program, a tool or a frame cannot have as its name, because a language uses them.
RESERVED = frozenset(
    re.findall(
        r"\w+",
        """abort alias and backward bool bas break call case char circ connect const continue ctool data decl def
        default deffct div do dn else elseif elif end enddat endfct endfor endfold endfunc endif endloop
        endmodule endproc endrecord endspline endswitch endtest endtrap endwhile enum error exit ext false fold
        for from func global goto halt if import in inout int interrupt j jmp jointtarget lbl lin local loop main
        mod module movec movej movel movep moveabsj not noview num off on or orient out pause pers pos
        pose proc ptp pulse raise readonly real record repeat resume retry return robtarget rpos run sec select
        set signal sleep speeddata step stop stopj stopl string struct switch sysmodule task test then thread
        timed_out to tool0 tooldata trap true trynext undo until var viewonly wait waited waittime while wobj0
        wobjdata with xor zonedata""",
    )
)


class Field(NamedTuple):
    """A part of a line: its regular expression, its text for a step, and the values of a step that a text states."""

    pattern: str
    write: Callable[[Any], str]
    read: Callable[[str], Mapping[str, Any]]


class Form(NamedTuple):
    """An instruction: the kind of its steps and its text, of one or several lines, in which ``@`` marks the fields.

    A form with a ``slot`` is a declaration before the steps; the slots of a program increase.
    """

    kind: type
    text: str
    fields: tuple[Field, ...] = ()
    slot: int | None = None

    def write(self, step: Any) -> list[str]:
        """The lines of a step."""
        first, *rest = self.text.split("@")
        return (first + "".join(f.write(step) + text for f, text in zip(self.fields, rest, strict=True))).split("\n")

    @property
    def pattern(self) -> str:
        """The regular expression of the lines without their indents; spaces inside a line may be longer."""
        parts = [re.escape(re.sub(r"\n +", "\n", text)).replace(r"\ ", "[ \t]+") for text in self.text.split("@")]
        inner = zip(self.fields, parts[1:], strict=True)
        return parts[0] + "".join(f"({f.pattern}){part}" for f, part in inner) + r"(?=\n|\Z)"

    def read(self, found: re.Match[str], line: int) -> Any:
        """The step of a match; ValueError if its values are not possible or contradict each other."""
        values: dict[str, Any] = {}
        for f, text in zip(self.fields, found.groups(), strict=True):
            for name, value in f.read(text).items():
                if name in values and values[name] != value:
                    raise ValueError(f"it states {name} = {values[name]} and {value}")
                values[name] = value
        return self.kind(**values) if self.kind in DECLARED else self.kind(**values, line=line)


@dataclass(frozen=True)
class Setting:
    """A line that is no step, and the value that it states for the steps after it."""

    name: str = ""
    value: float = 0.0
    line: int = 0


@dataclass(frozen=True)
class LoadData:
    """The declaration of a part that is carried, with its number."""

    number: int
    payload: Payload


# The kinds of declarations.
DECLARED = (ToolData, UserFrame, LoadData)


@dataclass
class Heading:
    """What a program states before its steps, and what its fields refer to."""

    name: str
    joints: tuple[str, ...] = ()
    external: Mapping[str, str] = field(default_factory=dict)
    tool_name: str = ""  # empty if the program declares no tool
    frame_name: str = ""
    tool: ToolData | None = None
    frame: UserFrame | None = None
    loads: list[Payload] = field(default_factory=list)
    positions: dict[int, Array] = field(default_factory=dict)
    labels: int = 0

    @property
    def robot(self) -> list[int]:
        """The indices of the joints of the robot."""
        return [k for k, name in enumerate(self.joints) if name not in self.external]

    def external_of(self, step: JointMove | LinearMove) -> list[float]:
        """The values of the external joints at the end of a move, in mm and degrees."""
        values = step.external if isinstance(step, LinearMove) and step.q is None else None
        if values is None and step.q is not None:
            values = step.q[[self.joints.index(name) for name in self.external]]
        if values is None or len(values) != len(self.external):
            raise InputError(f"a linear move to a pose must state the external joints {', '.join(self.external)}")
        units = self.external.values()
        return [1e3 * x if unit == "mm" else math.degrees(x) for x, unit in zip(values, units, strict=True)]

    def external_from(self, values: Iterable[float]) -> Array:
        """The values of the external joints (m and rad) that a text states in mm and degrees."""
        units = self.external.values()
        return np.array([x / 1e3 if unit == "mm" else math.radians(x) for x, unit in zip(values, units, strict=True)])

    def configuration(self, values: Sequence[float]) -> dict[str, Array]:
        """The configuration of which a text states the joints of the robot in degrees, then the external ones."""
        q = np.zeros(len(self.joints))
        q[self.robot] = np.deg2rad(values[:6])
        q[[self.joints.index(name) for name in self.external]] = self.external_from(values[6:])
        return {"q": q}

    def carried(self, shape: str, unit: float, digits: int) -> Field:
        """The field of a load that contains the tool: mass and centre of mass at the flange, in so many units a metre.

        The part is what remains of them beside the tool.
        """

        def own() -> tuple[float, Array]:
            tool = ToolData("", pose()) if self.tool is None else self.tool
            return tool.mass, tool.mass * np.array(tool.center_of_mass)

        def write(step: SetLoad) -> Array:
            total, moment = own()
            if step.payload is not None:
                total += step.payload.mass
                moment = moment + step.payload.mass * np.array(step.payload.center_of_mass)
            return np.hstack([total, unit * moment / (total or 1.0)])

        def read(values: Sequence[float]) -> dict[str, Payload | None]:
            mass, moment = own()
            rest = round(values[0] - mass, digits)
            apart = np.abs(values[0] * np.array(values[1:]) - unit * moment).max()
            if rest < 0.0 or (rest == 0.0 and apart > (1.0 + mass) * 10.0**-digits):
                raise ValueError("a load is that of the tool and of a part, but this one is neither")
            center = (values[0] * np.array(values[1:]) / unit - moment) / (rest or 1.0)
            return {"payload": Payload(rest, center) if rest > 0 else None}

        return numbers("", shape, write, read, digits)


class Dialect:
    """A language of robot programs."""

    name = ""
    endings: tuple[str, ...] = ()
    joints: int | None = 6  # of the robot, beside external axes; None for any number
    external = 0  # the largest number of external axes
    longest = 32  # characters of a name
    comment_mark = ""
    comment_width = 110
    times = True  # whether moves can state their durations
    cruises = False  # whether joint moves can state a speed at which they accelerate as usual
    exact = False  # whether the controller interpolates a trajectory exactly as pinproof does
    streams = False  # whether the language can send set points at a fixed period
    outputs = ""  # the digital output that closes a gripper by default; empty if the language has no outputs
    zones: tuple[Blend, ...] = ()  # the blends that the language can state, from the largest to the smallest
    alike = False  # whether a linear move states one acceleration, with which it is also slowed down
    common_zone = False  # whether all blends between two stops have one size
    deviation = 0.0  # rad: the assumed deviation of each joint from the straight lines of the moves, by default
    # A regular expression of the names of inputs and outputs, and a description for messages.
    signals, signal_kind = "0*[1-9][0-9]*", "numbers from 1"
    remark = ("", "")  # the text before and after the words of a remark
    opened = 1  # the number of lines before the comments
    required: tuple[int, ...] = ()  # the slots of declarations that every program has
    indent = "  "
    prefix = ""  # a regular expression of the text before the instruction of a line, such as its number
    call = ""  # the line that calls a program of another file; empty if the language has no such line
    begin: tuple[str, ...] = ()  # lines for each called program before the first call
    hint = ""  # what to use for the steps that the language does not have, for messages

    def frame(self, heading: Heading) -> tuple[list[str], list[str]]:
        """The lines before the comments, and those at the end; each occurs once, there."""
        raise NotImplementedError

    def forms(self, heading: Heading) -> list[Form]:
        """The instructions."""
        raise NotImplementedError

    def arranged(self, heading: Heading, steps: Sequence[Step]) -> list[Any]:
        """The steps with the declarations before them, and with the lines that the language needs between them."""
        return [*(each for each in (heading.tool, heading.frame) if each is not None), *steps]

    def completed(self, source: str, items: Sequence[Any]) -> list[Step]:  # noqa: ARG002
        """The steps of a text without the settings, which apply to the steps after them."""
        return list(items)

    def refuses(self, arm: Arm, external: Mapping[str, str]) -> str:
        """Why programs of an arm with these external joints cannot be written, in a sentence; empty if they can."""
        return self.refuses_joints(arm.joint_names, external)

    def refuses_joints(self, names: Sequence[str], external: Mapping[str, str]) -> str:
        """As :meth:`refuses`, for the names of joints."""
        if len(external) > self.external and self.joints is not None:
            at_most = f"at most {self.external}" if self.external else "no"
            use = "" if self.external else "; use rapid, krl or fanuc, or hold the joints"
            return f"programs in {self.name} have {at_most} external axes, but the arm has {', '.join(external)}{use}"
        own = len(names) - len(external)
        if self.joints is not None and own != self.joints:
            more = f" beside {', '.join(external)}" if external else "; state external axes if some are"
            return f"a program in {self.name} needs {self.joints} joints of the robot; the arm has {own}{more}"
        return ""

    def identifier(self, name: str, taken: Iterable[str] = ()) -> str:
        """A name that the language permits: ASCII, not too long, none of its words, and unlike those that are taken."""
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = plain if plain[:1].isalpha() else f"p{plain}"
        others = {each.lower() for each in taken} | RESERVED
        for number in range(1, 10_000):
            suffix = "" if number == 1 else f"_{number}"
            made = plain[: self.longest - len(suffix)] + suffix
            if made.lower() not in others and not re.fullmatch(r"[avz]\d+", made.lower()):
                return made
        raise InputError(f"no name like {name!r} is left for a program in {self.name}")

    def lines_of(self, step: Any, form: Form) -> list[str]:
        """The lines of a step with their indent."""
        return [f"{self.indent}{line}" for line in form.write(step)]

    def write(self, heading: Heading, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """The lines before the comments, of the steps, and after them, in the joint values of the controller."""
        items, forms, lines = self.arranged(heading, steps), self.forms(heading), list[str]()
        for item in items:
            if isinstance(item, str):
                lines.append(item)
                continue
            form = next((form for form in forms if isinstance(item, form.kind)), None)
            if form is None:
                raise InputError(f"a program in {self.name} cannot contain a {type(item).__name__}{self.hint}")
            lines += self.lines_of(item, form)
        before, after = self.frame(heading)
        return before, lines, after

    def read(self, source: str, body: Body, heading: Heading) -> list[Step]:
        """The steps of a program, whose declarations are added to the heading.

        TrajectoryError names the line and text of an instruction that is not supported.
        """
        inner = self.instructions(source, body, heading)
        rows = [(line, re.fullmatch(f"{self.prefix}(.*)", words.strip())) for line, words in inner]
        texts, forms = [found[1] if found else "?" for _, found in rows], self.forms(heading)
        known = [(form, re.compile(form.pattern)) for form in forms]
        items, slots, k = list[Any](), list[int](), 0
        while k < len(rows):
            line, rest = rows[k][0], "\n".join(texts[k : k + 16])
            form, found = next(((form, m) for form, pattern in known if (m := pattern.match(rest))), (None, None))
            if form is None or found is None:
                few = "; ".join(dict.fromkeys(each.text.split("\n")[0].replace("@", "..") for each in forms))
                raise TrajectoryError(
                    source, f"{inner[k][1].strip()!r} is not supported; supported: {few}", f"line {line}"
                )
            try:
                if form.slot is not None and (items or form.slot < max(slots, default=0)):
                    raise ValueError("a declaration is at the beginning, in the order of the manual")
                if form.slot in slots and form.kind is not LoadData:
                    raise ValueError("it is stated twice")
                step = form.read(found, line)
            except ValueError as error:
                raise TrajectoryError(source, f"{inner[k][1].strip()!r}: {error}", f"line {line}") from error
            k += found[0].count("\n") + 1
            if form.slot is None:
                items.append(step)
                continue
            slots.append(form.slot)
            if isinstance(step, ToolData):
                heading.tool = step
            elif isinstance(step, UserFrame):
                heading.frame = step
            elif isinstance(step, LoadData):
                heading.loads.append(step.payload)
        needed = [form for form in forms if form.slot in self.required or form.kind in (ToolData, UserFrame)]
        if missing := [form.text.split("\n")[0] for form in needed if form.slot not in slots]:
            line = rows[0][0] if rows else 1
            raise TrajectoryError(source, f"{missing[0]!r} must be before the first step", f"line {line}")
        return self.completed(source, items)

    def instructions(self, source: str, body: Body, heading: Heading) -> Body:
        """The lines between those that open and close the program: what the controller executes, from top to bottom."""
        # A second declaration, and anything before the first or after the end, is refused: a controller would not
        # execute it, or not in this order.
        before, after = self.frame(heading)
        first, last = len(before), len(body) - len(after)
        if last < first:
            raise TrajectoryError(source, "is not complete: lines that begin or end the program are missing")
        framing = [*zip(before, body[:first], strict=True), *zip(after, body[last:], strict=True)]
        for expected, (number, line) in framing:
            if line.split() != expected.split():
                reason = (
                    f"{line.strip()!r} is where {expected.strip()!r} must be: a program has one beginning and one end"
                )
                raise TrajectoryError(source, reason, f"line {number}")
        # A program that calls a routine of its own name would call itself.
        if self.names_itself(heading, [line for _, line in body]):
            reason = f"the name {heading.name!r} occurs in the program again; rename the program"
            raise TrajectoryError(source, reason, f"line {body[0][0]}")
        return body[first:last]

    def names_itself(self, heading: Heading, lines: Sequence[str]) -> bool:
        """Whether the name of a program is another word of its instructions too."""
        code = [line for line in lines if not line.strip().startswith(self.remark[0].strip() or "\n")]
        words = [word.lower() for line in code for word in re.findall(r"[A-Za-z_]\w*", line)]
        return words.count(heading.name.lower()) > 1

    def comment(self, words: str) -> str:
        """A line with a comment of pinproof."""
        return f"  {self.comment_mark} {words}"

    def comment_of(self, line: str) -> str | None:
        """The words of a comment of pinproof; None if the line is another."""
        bare = line.strip(" \t")
        return bare[len(self.comment_mark) + 1 :] if bare.startswith(f"{self.comment_mark} ") else None

    def numbered(self, text: str) -> str:
        """The text with numbers of lines, if the language has them."""
        return text

    def main(self, programs: Sequence[str]) -> str:
        """The text of a routine ``main`` that calls programs in their order; InputError if the language has none."""
        if not self.call:
            raise InputError(f"{self.name} has no routine that calls the programs of other files; remove main: true")
        before, after = self.frame(Heading("main"))
        begin = [f"{self.indent}{line.replace('@', name)}" for line in self.begin for name in programs]
        calls = [f"{self.indent}{self.call.replace('@', name)}" for name in programs]
        return self.numbered("\n".join([*before, *begin, *calls, *after]) + "\n")

    # The parts that all languages have, with their own texts.

    def signal(self, name: str) -> Field:
        """The field of an input or output with the name of the value."""
        return Field(
            self.signals, lambda step: self.checked_signal(name, getattr(step, name)), lambda text: {name: text}
        )

    def checked_signal(self, name: str, value: str, kind: str = "") -> str:
        """The value of an input or output; InputError with its name if the language does not have it."""
        if not re.fullmatch(self.signals, value):
            raise InputError(f"{name} {value!r}: {self.name} has digital {kind or name}s with {self.signal_kind}")
        return value

    def common_forms(
        self,
        output: str,
        wait: str,
        check: str,
        states: tuple[str, str],
        decimals: int,
        call: str,
        unit: float = 1.0,
        more: Mapping[str, Field] | None = None,
    ) -> list[Form]:
        """The forms of outputs, waiting times, checks of inputs and remarks.

        In the text of a check, ``@I``, ``@S``, ``@T`` and ``@E`` are the input, its state, the time in ``unit`` seconds
        and the call of the error routine; ``more`` are further fields by their letters.
        """
        off, on = states
        state = Field(f"{off}|{on}", lambda step: states[step.on], lambda text: {"on": text == on})
        inset = check[: check.index("@E")].rpartition("\n")[2]
        routine = Field(
            "(?:" + re.escape(call).replace("@", NAME) + "\n)?",
            lambda step: f"{call.replace('@', step.error)}\n{inset}" if step.error else "",
            lambda text: {"error": re.findall(NAME, text.removeprefix("CALL "))[0] if text else ""},
        )
        limit = seconds("seconds", decimals if unit == 1.0 else 0, unit, zero=False)
        parts = {"I": self.signal("input"), "S": state, "T": limit, "E": routine, **(more or {})}
        before, after = self.remark
        return [
            Form(SetOutput, output, (self.signal("output"), state)),
            Form(Wait, wait, (seconds("seconds", decimals),)),
            Form(CheckInput, re.sub("@[A-Z]", "@", check), tuple(parts[k] for k in re.findall("@([A-Z])", check))),
            Form(Remark, f"{before}@{after}", (Field(r"[ -:<-~]*?", self.remark_of, lambda t: {"words": t.strip()}),)),
        ]

    def remark_of(self, step: Remark) -> str:
        """The words of a remark in the characters that all languages permit, which is no comment of pinproof."""
        words = " ".join(re.sub(r"[^ -~]", "?", step.words).replace(";", ",").split()) or "-"
        return f"- {words}" if words.startswith(self.comment_mark[1:].strip()) else words


def seconds(name: str, decimals: int, unit: float = 1.0, *, zero: bool = True) -> Field:
    """The field of a time, which the text states in a unit of so many seconds; it is rounded up."""
    step = unit * 10.0**-decimals
    return Field(
        NUMBER,
        lambda item: f"{rounded_up(getattr(item, name), step, 0.0 if zero else step) / unit:.{decimals}f}",
        lambda text: {name: round(positive(text, zero=zero) * unit, 9)},
    )


def constant(name: str, value: Any) -> Field:
    """A field without text, for a value that is known otherwise."""
    return Field("", lambda _: "", lambda _: {name: value})


def numbers(
    name: str, shape: str, write: Callable[[Any], Iterable[float]], read: Callable[..., Any], digits: int
) -> Field:
    """The field of values whose text has the form of ``shape``, in which each ``#`` is a number."""

    def text_of(item: Any) -> str:
        first, *rest = shape.split("#")
        values = write(item)
        return first + "".join(f"{plain(x, digits)}{text}" for x, text in zip(values, rest, strict=True))

    pattern = re.escape(shape).replace(r"\ ", "[ \t]+").replace(r"\#", NUMBER).replace("#", NUMBER)
    take = re.compile(re.escape(shape).replace(r"\ ", "[ \t]+").replace(r"\#", "#").replace("#", f"({NUMBER})"))

    def read_text(text: str) -> Mapping[str, Any]:
        found = take.fullmatch(text)
        values = [float(word) for word in found.groups()] if found else []
        if not np.isfinite(values).all():
            raise ValueError("a number is not finite")
        made = read(values)
        return made if name == "" else {name: made}

    return Field(pattern, text_of, read_text)


def tool_load(shape: str, unit: float, digits: int, *, least: float = 0.0) -> Field:
    """The field of the mass of a tool and its centre of mass in so many units a metre.

    Without a stated mass the mass is ``least``; if that is 0, nothing is written, and the controller keeps its own.
    """
    stated = numbers(
        "",
        shape,
        lambda step: [max(step.mass, least), *(unit * np.array(step.center_of_mass))],
        lambda v: {"mass": v[0], "center_of_mass": np.array(v[1:]) / unit},
        digits,
    )
    if least:
        return stated
    return Field(
        f"(?:{stated.pattern})?",
        lambda step: stated.write(step) if step.mass else "",
        lambda text: stated.read(text) if text else {},
    )


def plain(value: float, digits: int) -> str:
    """A number with decimals, without a negative zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def rounded_down(value: float) -> str:
    """A number above 0 with at most six decimals, which is not larger than the value."""
    text = f"{max(math.floor(1e6 * value + 1e-6), 1) / 1e6:.6f}".rstrip("0")
    return f"{text}0" if text.endswith(".") else text


def quaternion(transform: SE3) -> Array:
    """The unit quaternion (4,) of a rotation, scalar first."""
    turn = log6(transform)[3:]
    angle = float(np.linalg.norm(turn))
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) / angle * turn if angle else turn)])


def in_degrees(transform: SE3) -> list[float]:
    """Millimetres, and degrees about the fixed axes X, Y and Z."""
    x, y, z, *rpy = xyz_rpy(transform)
    return [1e3 * x, 1e3 * y, 1e3 * z, *np.rad2deg(rpy)]


def from_degrees(values: Sequence[float]) -> SE3:
    """The pose of :func:`in_degrees`; ValueError for angles of more than a rotation."""
    if np.abs(values[3:]).max() > 360.0:
        raise ValueError("an angle is beyond 360 degrees")
    return pose(np.array(values[:3]) / 1e3, np.deg2rad(values[3:]))


def turned(xyz: Sequence[float], turn: Sequence[float]) -> SE3:
    """The pose at a position (m) with a rotation vector (rad)."""
    angle = float(np.linalg.norm(turn))
    axis = np.array(turn) / angle if angle else np.zeros(3)
    return pose(xyz, quat_xyzw=[*(math.sin(angle / 2) * axis), math.cos(angle / 2)])


def positive(text: str, *, zero: bool = False, largest: float = math.inf) -> float:
    """A finite number above 0, such as a time, or also 0, and at most ``largest``; ValueError otherwise."""
    value = float(text)
    if value < 0.0 or (value == 0.0 and not zero) or value > largest or math.isinf(value):
        most = f" and at most {largest:g}" if math.isfinite(largest) else ", and finite"
        raise ValueError(f"{text} must be {'0 or more' if zero else 'above 0'}{most}")
    return value


def rounded_up(seconds: float, unit: float, least: float) -> float:
    """The time as a multiple of a unit that is not shorter, beyond rounding errors, and at least ``least``."""
    return max(math.ceil(seconds / unit - 1e-6) * unit, least)
