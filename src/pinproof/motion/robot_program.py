"""Robot programs: joint moves, gripper outputs and waiting times in the language of a robot controller.

The text is the definition of a program: it is parsed back after it is written, and :func:`pinproof.collision.
certify_program` certifies what the controller will execute according to the text, not what the writer intended. The
comments at its top state the joints, the assumed deviation of the controller, the hash of the certificate, and a hash
of every other line, so that an edited line is found when the program is read.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.common.files import read_text, write_text_whole
from pinproof.common.structs import described, key
from pinproof.common.validation import require_positive
from pinproof.description import Calibration
from pinproof.errors import InputError, TrajectoryError
from pinproof.motion.curve import checked_joint_names, read_only
from pinproof.motion.dialects import Dialect, dialect_of_file, find_dialect
from pinproof.motion.dialects.dialect import (
    NAME,
    Heading,
    JointMove,
    LinearMove,
    Move,
    Step,
    StreamedPoint,
    StreamedTrajectory,
    ToolData,
    UserFrame,
)
from pinproof.spatial import Array, finite

# The first words of the comments, with the version of the format.
FORMAT = "pinproof program 1"
# Hexadecimal digits of the hash of a line. It detects edits; it does not protect from forgery.
HASH_DIGITS = 8


@described(eq=False)
class JointMap:
    """How the joint values of a controller follow from the robot model: signs, offsets, and a coupling.

    controller = sign * q + offset, and then joint 3 is increased by ``coupling`` times joint 2 of the controller. A
    straight line in one joint space is a straight line in the other, because the map is affine.
    """

    signs: Array = key("(n,) of +1 and -1")
    offsets: Array = key("(n,) rad")
    coupling: float = key(
        "-1 for FANUC arms, whose joint 3 is measured from the horizontal, with a URDF whose joint 3 is measured "
        "from joint 2; 0 otherwise",
        default=0.0,
    )

    def __post_init__(self) -> None:
        signs, offsets = finite("signs", self.signs, (None,)), finite("offsets", self.offsets, (None,))
        if len(signs) != len(offsets) or (np.abs(signs) != 1.0).any():
            raise InputError(f"signs = {self.signs} must be +1 or -1, one per offset ({len(offsets)})")
        if self.coupling and len(signs) < 3:
            raise InputError("coupling needs at least three joints")
        if not np.isfinite(self.coupling):
            raise InputError(f"coupling = {self.coupling} must be finite")
        object.__setattr__(self, "signs", read_only(signs))
        object.__setattr__(self, "offsets", read_only(offsets))

    @classmethod
    def identity(cls, joints: int) -> JointMap:
        """The map of a controller that uses the joint values of the model."""
        return cls(np.ones(joints), np.zeros(joints))

    @property
    def is_identity(self) -> bool:
        """Whether the controller uses the joint values of the model."""
        return bool((self.signs == 1).all() and not self.offsets.any() and self.coupling == 0)

    def to_controller(self, q: npt.ArrayLike) -> Array:
        """The values (n,) of the controller, in rad."""
        values = self.signs * finite("q", q, self.signs.shape) + self.offsets
        if self.coupling:
            values[2] += self.coupling * values[1]
        return values

    def from_controller(self, values: npt.ArrayLike) -> Array:
        """The values (n,) of the model, in rad."""
        q = np.array(values, dtype=float)
        if self.coupling:
            q[2] -= self.coupling * q[1]
        return self.signs * (q - self.offsets)

    def __str__(self) -> str:
        signs, offsets = (" ".join(f"{value:.17g}" for value in values) for values in (self.signs, self.offsets))
        return f"signs {signs}, offsets {offsets}, coupling {self.coupling:.17g}"

    @classmethod
    def from_text(cls, text: str) -> JointMap:
        """The map whose text is given; ValueError if it is another text."""
        found = re.fullmatch(r"signs (.*), offsets (.*), coupling (\S+)", text)
        if found is None:
            raise ValueError(text)
        signs, offsets = (np.array([float(word) for word in found[i].split()]) for i in (1, 2))
        return cls(signs, offsets, float(found[3]))


@dataclass(frozen=True)
class ProgramPick:
    """A pick of a program: its name, its grasp (:attr:`MotionProgram.member`), and its motions.

    ``motions`` are the names of the motions with their numbers of moves, in order.
    """

    name: str
    member: str
    motions: tuple[tuple[str, int], ...]


@described(eq=False)
class RobotProgram:
    """A program of a controller, as parsed from its text; see :func:`pinproof.collision.export_program`."""

    name: str = key("the name of the program in the text")
    dialect: str = key("the language: ``urscript``, ``rapid``, ``krl``, ``fanuc`` or ``ros2``")
    joint_names: tuple[str, ...] = key("the n joints of the robot model, in the order of the values")
    steps: tuple[Step, ...] = key("what the controller executes, in order")
    deviation: float = key(
        "by how much each joint may deviate from the straight lines of the moves, as assumed for the certificate", "rad"
    )
    certificate: str = key("the hash of the certificate of the program; empty if it was not certified")
    text: str = key("the complete text")
    picks: tuple[ProgramPick, ...] = key(
        "the picks that the program executes, in order, as :func:`pinproof.picks.export_picks` states them", default=()
    )

    tool: ToolData | None = key("the tool that the text declares; None if it states none", default=None)
    frame: UserFrame | None = key("the frame that the text declares; None if it states none", default=None)
    external_joints: Mapping[str, str] = key(
        'the joints that are external axes, each with its unit, ``"mm"`` or ``"deg"``', default_factory=dict
    )
    calibrations: Mapping[str, str] = key(
        "the calibrations of the arm that it was written for, as :func:`calibration_marks` states them",
        default_factory=dict,
    )

    @property
    def moves(self) -> tuple[Move, ...]:
        """The steps that move the arm."""
        return tuple(step for step in self.steps if isinstance(step, Move))

    @classmethod
    def parse(cls, text: str, *, source: str = "program", dialect: str, allow_changes: bool = False) -> RobotProgram:
        """The program of a text.

        Parameters
        ----------
        text
            The text, with the comments that pinproof writes at its top.
        source
            The name of the file, for messages.
        dialect
            The language.
        allow_changes
            Whether to accept lines that were edited after the program was written. :attr:`certificate` is then empty.

        Raises
        ------
        TrajectoryError
            If the comments are missing, a line was edited, or an instruction is not supported; the message states the
            line and its text.
        UnknownNameError
            If the dialect is unknown.
        """
        language = find_dialect(dialect)
        header, body = _split(language, source, program_lines(source, text))
        for row, instruction in body:
            if foreign := re.search(r"[^\x00-\x7F]", instruction):
                reason = f"{foreign[0]!r} is not an ASCII character; only comments may contain others"
                raise TrajectoryError(source, reason, f"line {row}, column {foreign.start() + 1}")
        stated, hashes, mapping, declared = _read_header(source, header, dialect)
        # The index of the first line that differs from what was written.
        present = [_hash(words) for _, words in body]
        changed = next((k for k, (was, now) in enumerate(zip_longest(hashes, present)) if was != now), None)
        if changed is not None and not allow_changes:
            number = min(changed, len(body) - 1)
            line, words = body[number] if body else (1, "")
            raise TrajectoryError(
                source,
                f"{words.strip()!r} was edited after the program was written; certify the edited program again with "
                "--allow-changes, or allow_changes=True",
                f"line {line}",
            )
        heading = Heading(stated.name, stated.joint_names, stated.external_joints, *declared)
        steps = [_mapped(step, mapping.from_controller, heading) for step in language.read(source, body, heading)]
        if not any(isinstance(step, Move) for step in steps):
            raise TrajectoryError(source, "the program has no move")
        certificate = "" if changed is not None else stated.certificate
        return replace(
            stated, steps=tuple(steps), certificate=certificate, text=text, tool=heading.tool, frame=heading.frame
        )

    @classmethod
    def load(cls, path: str | Path, *, allow_changes: bool = False) -> RobotProgram:
        """Read a program; the language follows from the ending of the file name. See :meth:`parse` for the errors."""
        source = Path(path)
        dialect = dialect_of_file(source)
        text = read_text(source, TrajectoryError)
        return cls.parse(text, source=str(source), dialect=dialect, allow_changes=allow_changes)

    def save(self, path: str | Path) -> None:
        """Write the text.

        Raises
        ------
        FileError
            If the file cannot be written.
        InputError
            If the ending of the file name belongs to another language.
        """
        if dialect_of_file(Path(path)) != self.dialect:
            raise InputError(f"{path}: the ending does not belong to a program in {self.dialect}")
        write_text_whole(Path(path), self.text)

    def __repr__(self) -> str:
        return f"RobotProgram({self.name!r}, {self.dialect}, {len(self.moves)} moves)"


def make_program(
    steps: Sequence[Step],
    joint_names: Sequence[str],
    *,
    dialect: str,
    name: str = "motion",
    deviation: float = 0.0,
    certificate: str = "",
    uncovered: str = "",
    joint_map: JointMap | None = None,
    picks: Sequence[ProgramPick] = (),
    tool: ToolData | None = None,
    frame: UserFrame | None = None,
    external_joints: Mapping[str, str] | None = None,
    calibrations: Mapping[str, Calibration] | None = None,
) -> RobotProgram:
    """Write a program and parse it back; the result has the numbers of the text, with their rounding.

    ``uncovered`` states in the comments what the certificate does not cover, ``picks`` what the program executes,
    ``external_joints`` the joints that the controller moves as external axes (:func:`external_joints`), and
    ``calibrations`` those of the arm (:attr:`pinproof.Robot.calibrations`). The joint map has the joints of the robot.
    Names that the language does not permit are changed to ASCII and shortened.

    Raises
    ------
    InputError
        If the language cannot express a step, the number of joints, or external axes.
    """
    language = find_dialect(dialect)
    names = checked_joint_names(joint_names)
    external = dict(external_joints or {})
    if reason := language.refuses_joints(names, external):
        raise InputError(reason)
    if spaced := [joint for joint in names if len(joint.split()) != 1]:
        raise InputError(f"the name of joint {spaced[0]!r} has spaces, which the comments of a program cannot state")
    require_positive("deviation (rad)", deviation, zero=True)
    mapping = joint_map or JointMap.identity(len(names) - len(external))
    if len(mapping.signs) != len(names) - len(external):
        raise InputError(f"the joint map has {len(mapping.signs)} joints; the robot has {len(names) - len(external)}")
    if not mapping.is_identity and any(isinstance(step, StreamedTrajectory) for step in steps):
        raise InputError(f"a program in {dialect} uses the joint values of the model; remove the joint map")
    tool = tool and replace(tool, name=language.identifier(tool.name))
    frame = frame and replace(frame, name=language.identifier(frame.name))
    heading = Heading(language.identifier(name or "motion"), names, external)
    own = (tool.name if tool else "", frame.name if frame else "", tool, frame)
    for k in range(2):
        heading = Heading(heading.name, names, external, *own)
        before, body, after = language.write(heading, [_mapped(step, mapping.to_controller, heading) for step in steps])
        if k == 0 and language.names_itself(heading, (*before, *body, *after)):
            heading.name = language.identifier(f"{heading.name}_program")
        else:
            break
    name = heading.name
    # Remarks are numbered in some languages, so the comments are written before the hashes of the lines are known.
    hashes = [_hash(words) for words in (*before, *body, *after)]
    entries = {
        "": FORMAT,
        "dialect": dialect,
        "name": name,
        "joints": " ".join(names),
        "deviation": f"{deviation:.17g} rad",
        "certificate": certificate or "none",
        "start": "the move to the first point is not certified",
    }
    if uncovered:
        # ASCII without a semicolon, which ends a comment in some languages; so are the picks below.
        entries["not covered"] = json.dumps(uncovered)[1:-1].replace(";", ",")
    if not mapping.is_identity:
        entries["map"] = str(mapping)
    for what, values in (("external", external), ("calibration", calibration_marks(calibrations or {}))):
        if values:
            entries[what] = " ".join(f"{name}={value}" for name, value in values.items())
    entries |= {what: each.name for what, each in (("tool", tool), ("frame", frame)) if each is not None}
    if picks:
        rows = [[pick.name, pick.member, [list(motion) for motion in pick.motions]] for pick in picks]
        entries["picks"] = json.dumps(rows).replace(";", "\\u003b")
    entries["lines"] = " ".join([_hash_of_entries(entries), *hashes])
    comments = [language.comment(line) for line in _fold(entries, language.comment_width)]
    text = "\n".join([*before, *comments, *body, *after]) + "\n"
    return RobotProgram.parse(language.numbered(text), source=name, dialect=dialect)


def calibration_marks(calibrations: Mapping[str, Calibration]) -> dict[str, str]:
    """The file and a hash of the numbers of each calibration, by the name of its robot, for the text of a program."""
    words = ((robot, own.path.name, _hash(own.numbers)) for robot, own in sorted(calibrations.items()))
    plain = ([re.sub(r"[^\w.-]", "_", word, flags=re.ASCII) for word in each] for each in words)
    return {robot: f"{file}:{digest}" for robot, file, digest in plain}


def _mapped(step: Step, convert: Callable[[Array], Array], heading: Heading) -> Step:
    """The step with other values of the joints of the robot."""
    if isinstance(step, JointMove | LinearMove | StreamedPoint) and step.q is not None:
        q = finite("q", step.q, (len(heading.joints),))
        q[heading.robot] = convert(q[heading.robot])
        return replace(step, q=read_only(q))
    return step


def _hash(line: str) -> str:
    # The hash does not contain the numbers of lines, because controllers renumber them.
    return hashlib.sha256(re.sub(r"^\s*\d*\s*:", "", line).strip().encode()).hexdigest()[:HASH_DIGITS]


def _fold(entries: dict[str, str], width: int) -> Iterable[str]:
    """Comments of at most ``width`` characters; one that continues the previous one begins with ``+``."""
    for name, value in entries.items():
        rest, mark = (f"{name}: {value}" if name else value), ""
        while rest:
            end = width - len(mark)
            if len(rest) > end:
                end = (rest.rfind(" ", 1, end) + 1) or end  # keeps the space, which marks the end of a word
                while rest[end - 1] == " " and end > 1:
                    end -= 1
            yield mark + rest[:end]
            rest, mark = rest[end:], "+"


def _hash_of_entries(entries: dict[str, str]) -> str:
    """The hash of the comments, without the hashes of the lines."""
    return _hash("\n".join(f"{key}: {value}" for key, value in sorted(entries.items()) if key))


CONTROL = re.compile("[\x00-\x08\x0a-\x1f\x7f-\x9f\u2028\u2029]")
"""The control characters of Unicode, and its separators of lines and paragraphs, except the tabulator."""


def program_lines(source: str, text: str) -> list[str]:
    """The lines of a program as a controller reads them: LF or CRLF ends a line, and no other character does."""
    # Any other control character ends a line for some programs and not for others, and is refused.
    *lines, last = text.split("\n")
    lines = [*(line.removesuffix("\r") for line in lines), last]
    for number, line in enumerate(lines, 1):
        if found := CONTROL.search(line):
            reason = f"contains the control character U+{ord(found[0]):04X}; lines end with LF or CRLF only"
            raise TrajectoryError(source, reason, f"line {number}, column {found.start() + 1}")
    return lines


def _split(language: Dialect, source: str, lines: Sequence[str]) -> tuple[list[str], list[tuple[int, str]]]:
    """The comments that pinproof wrote, unfolded, and the other lines with their numbers."""
    header: list[str] = []
    body = list[tuple[int, str]]()
    for number, line in enumerate(lines, 1):
        words = language.comment_of(line)
        if words is not None and len(body) != language.opened:
            raise TrajectoryError(source, "a comment of pinproof is not at the top of the program", f"line {number}")
        if words is None:
            if line.strip(" \t"):
                body.append((number, line))
        elif words.startswith("+") and header:
            header[-1] += words[1:]
        else:
            header.append(words)
    return header, body


def _read_header(
    source: str, header: Sequence[str], dialect: str
) -> tuple[RobotProgram, list[str], JointMap, tuple[str, str]]:
    """The program without steps and text, the hashes of its lines, the joint map, and the names of tool and frame."""
    entries = [entry.partition(": ")[::2] for entry in header]
    stated = dict(entries)
    if len(stated) < len(entries):
        keys = [key for key, _ in entries]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise TrajectoryError(source, f"the comments of pinproof state {twice!r} twice")
    if FORMAT not in stated:
        raise TrajectoryError(
            source, f"the comments at the top do not contain {FORMAT!r}; only programs that pinproof wrote can be read"
        )
    missing = [key for key in ("dialect", "name", "joints", "deviation", "certificate", "lines") if key not in stated]
    if missing:
        raise TrajectoryError(source, f"the comments at the top do not state {', '.join(missing)}")
    if stated["dialect"] != dialect:
        raise TrajectoryError(source, f"is a program in {stated['dialect']}, not in {dialect}")
    try:
        names = checked_joint_names(stated["joints"].split())
        deviation = float(stated["deviation"].removesuffix(" rad"))
        if not 0 <= deviation < np.inf:
            raise ValueError(stated["deviation"])
        external, calibrations = (
            {name: value for name, _, value in (pair.rpartition("=") for pair in stated.get(what, "").split())}
            for what in ("external", "calibration")
        )
        if not set(external) <= set(names) or not set(external.values()) <= {"mm", "deg"}:
            raise ValueError(stated["external"])
        if reason := find_dialect(dialect).refuses_joints(names, external):
            raise ValueError(reason)
        own = len(names) - len(external)
        mapping = JointMap.from_text(stated["map"]) if "map" in stated else JointMap.identity(own)
        if len(mapping.signs) != own:
            raise ValueError(stated["map"])
        declared = (stated.get("tool", ""), stated.get("frame", ""))
        if wrong := [word for word in (stated["name"], *filter(None, declared)) if not re.fullmatch(NAME, word)]:
            raise ValueError(wrong[0])
        picks = tuple(
            ProgramPick(str(name), str(member), tuple((str(motion), int(count)) for motion, count in motions))
            for name, member, motions in json.loads(stated.get("picks", "[]"))
        )
    except (TypeError, ValueError) as error:
        raise TrajectoryError(source, f"the comments at the top have an invalid entry: {error}") from error
    check, *hashes = stated.pop("lines").split() or [""]
    known = {key: value for key, value in stated.items() if key != FORMAT}
    if _hash_of_entries(known) != check:
        raise TrajectoryError(source, "the comments at the top were edited after the program was written")
    certificate = "" if stated["certificate"] == "none" else stated["certificate"]
    program = RobotProgram(
        stated["name"], dialect, names, (), deviation, certificate, "", picks, external_joints=external,
        calibrations=calibrations,
    )  # fmt: skip
    return program, hashes, mapping, declared
