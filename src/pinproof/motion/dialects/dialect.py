"""The steps of a robot program, and what a language of robot programs defines: the writing and reading of its lines."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pinproof.common.structs import described, key
from pinproof.errors import InputError, TrajectoryError, UnknownNameError
from pinproof.model import Arm, Payload
from pinproof.motion.trajectory_files import Record
from pinproof.spatial import SE3, Array

# -- steps -------------------------------------------------------------------------------------------------------------


@described()
class Blend:
    """The part of the two moves at a point in which the controller may leave their straight lines."""

    radius: float | None = key(
        "between the tcp and its position at the point; None if the controller does not use a radius", "m", default=None
    )
    share: float = key("largest share of each of the two moves that the blend may use", default=0.5)


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


@described(eq=False)
class LinearMove:
    """A move of the tcp on a straight line, with a stop at its end."""

    q: Array | None = key("(n,) rad, the configuration at the end; None if the text states the pose", default=None)
    pose: SE3 | None = key("``base_from_tcp`` at the end; None if the text states joint values", default=None)
    duration: float | None = key("None if the text states a speed instead", "s", default=None)
    line: int = key("the line number in the text, from 1", default=0)
    speed: float | None = key("m/s of the tcp; None if the text states none", default=None)
    external: Array | None = key(
        "rad or m, the values of the external joints at the end, if the text states the pose; None if there are none",
        default=None,
    )


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
    """The part that the hand carries from here on; None for the hand alone.

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
            raise UnknownNameError("joint", name, units)
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
# A regular expression for the name that a program gives itself.
NAME = r"([A-Za-z]\w*)"
# A regular expression of a complete line, and the function that makes its step of the match and the line number.
Rule = tuple[str, Callable[[re.Match[str], int], Step | None]]


class Dialect:
    """A language of robot programs."""

    name = ""
    endings: tuple[str, ...] = ()
    joints: int | None = 6
    comment_mark = ""
    comment_width = 110
    exact = False  # whether the controller interpolates a trajectory exactly as pinproof does
    streams = False  # whether the language can send set points at a fixed period
    outputs = ""  # the digital output that closes a gripper by default; empty if the language has no outputs
    blend: Blend | None = None  # the blend of an inner point by default; None if the language has none
    deviation = 0.0  # rad: the assumed deviation of each joint from the straight lines of the moves, by default
    # The line that switches an output, with its name and its state, and the words for off and on.
    output_line, output_states = "", ("", "")
    # A regular expression of the names of outputs, and a description for messages.
    output_names, output_kind = "0*[1-9][0-9]*", "numbers from 1"
    wait_line = ""  # the line of a waiting time in seconds
    # The lines before and after the steps, with the name of the program in place of `{}`, and the indent of steps.
    frame: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    indent = "  "
    # Regular expressions of the lines before the comments of pinproof, directly after them, and at the end, in this
    # order. Each occurs once, there; the settings hold for all instructions.
    opening: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    closing: tuple[str, ...] = ()
    ignored = "(?!)"  # a regular expression of instructions that are not a step, such as one that sets the speed
    prefix = ""  # a regular expression of the text before the instruction of a line, such as its number
    supported = ""  # the supported instructions, for messages
    contents = "moves, outputs and waiting times"  # the steps that a program can contain, for messages

    def move(self, step: Step) -> str | None:
        """The line of a move; None if the language cannot express the step."""
        raise NotImplementedError

    def move_rules(self, joints: int) -> list[Rule]:
        """The rules that read the lines of moves."""
        raise NotImplementedError

    def line_of(self, step: Step) -> str:
        """The line of a step; InputError if the language cannot express it."""
        if isinstance(step, SetOutput):
            if not re.fullmatch(self.output_names, step.output):
                raise InputError(f"output {step.output!r}: {self.name} has digital outputs with {self.output_kind}")
            return self.output_line.format(step.output, self.output_states[step.on])
        line = self.wait_line.format(step.seconds) if isinstance(step, Wait) else self.move(step)
        if line is None:
            raise InputError(f"programs of pinproof in {self.name} contain {self.contents}")
        return line

    def write(self, name: str, steps: Sequence[Step]) -> tuple[list[str], list[str], list[str]]:
        """The lines before the comments, of the steps, and after them, in the joint values of the controller."""
        before, after = ([line.format(name) for line in lines] for lines in self.frame)
        return before, [f"{self.indent}{self.line_of(step)}" for step in steps], after

    def read(self, source: str, body: Body, joints: int) -> list[Step]:
        """The steps of a program; TrajectoryError names the line and text of an instruction that is not supported."""
        return self.read_lines(source, body, self.move_rules(joints))

    def read_lines(self, source: str, body: Body, moves: Sequence[Rule]) -> list[Step]:
        """The steps of lines, with these rules for moves."""
        body = self.instructions(source, body)
        # The lines of outputs and waiting times are read as they are written; spaces may be longer.
        off, on = self.output_states
        wait = re.sub(r"\{.*?\}", "{}", self.wait_line)
        rules: list[Rule] = [
            (_pattern(self.output_line, self.output_names, f"{off}|{on}"), lambda m, k: SetOutput(m[1], m[2] == on, k)),
            (_pattern(wait, NUMBER), lambda m, k: Wait(positive(m[1], zero=True), k)),
        ]
        known = [(re.compile(self.prefix + rule), step_of) for rule, step_of in (*moves, *rules)]
        steps = []
        for number, line in body:
            words = line.strip()
            if re.fullmatch(self.ignored, words):
                continue
            found = next(((step_of, m) for rule, step_of in known if (m := rule.fullmatch(words))), None)
            if found is None:
                reason = f"{words!r} is not supported; supported: {self.supported}"
                raise TrajectoryError(source, reason, f"line {number}")
            try:
                steps.append(found[0](found[1], number))
            except ValueError as error:
                raise TrajectoryError(source, f"{words!r}: {error}", f"line {number}") from error
        return [step for step in steps if step is not None]

    def instructions(self, source: str, body: Body) -> Body:
        """The lines between those that open and close the program: what the controller executes, from top to bottom."""
        # A second declaration, and anything before the first or after the end, is refused: a controller would not
        # execute it, or not in this order.
        begin = (*self.opening, *(self.prefix + setting for setting in self.settings))
        first, last = len(begin), len(body) - len(self.closing)
        if last < first:
            raise TrajectoryError(source, "is not complete: lines that begin or end the program are missing")
        framing = [*zip(begin, body[:first], strict=True), *zip(self.closing, body[last:], strict=True)]
        for pattern, (number, line) in framing:
            if not re.fullmatch(pattern, line.strip()):
                expected = re.sub(r"\\(.)", r"\1", pattern.removeprefix(self.prefix).replace(NAME, "NAME"))
                reason = f"{line.strip()!r} is where {expected!r} must be: a program has one beginning and one end"
                raise TrajectoryError(source, reason, f"line {number}")
        # A program with the name of one of its instructions would call itself.
        if name := self.ambiguous_name([line for _, line in body]):
            reason = f"the name {name!r} occurs in the program again; rename the program"
            raise TrajectoryError(source, reason, f"line {body[0][0]}")
        return body[first:last]

    def ambiguous_name(self, lines: Sequence[str]) -> str:
        """The name that a program gives itself, if it is another word of the program too; otherwise empty."""
        words = [word.lower() for line in lines for word in re.findall(r"[A-Za-z_]\w*", line)]
        stated = [m[1] for p, line in zip(self.opening, lines, strict=False) if NAME in p and (m := re.search(p, line))]
        return next((name for name in stated if words.count(name.lower()) > 1), "")

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

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"


def _pattern(template: str, *values: str) -> str:
    """The regular expression of a line with values in place of ``{}``; spaces may be longer."""
    parts = [re.escape(part).replace(r"\ ", r"\s+") for part in template.split("{}")]
    return parts[0] + "".join(f"({value}){part}" for value, part in zip(values, parts[1:], strict=True))


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


def numbers_of(text: str, count: int) -> Array:
    """The numbers of a list separated by commas; ValueError if there are not ``count`` finite ones."""
    words = [word.strip() for word in text.split(",")]
    if not all(re.fullmatch(NUMBER, word) for word in words):
        raise ValueError(f"{text.strip()!r} is not a list of numbers")
    values = np.array([float(word) for word in words])
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"has {len(values)} joint values; the program has {count} joints")
    return values


def in_degrees(q: Array, digits: int) -> list[str]:
    """The values of joints in degrees, rounded to decimals."""
    return [f"{value + 0.0:.{digits}f}" for value in np.rad2deg(q).round(digits)]
