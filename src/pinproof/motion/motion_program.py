"""Motion programs: a sequence of certified segments with events, such as grip and release, on one common clock.

The file is JSON. Its times are integers of nanoseconds from the start of the program and its numbers are written
exactly, so a file defines the same curves as the value in memory. Every segment names its certificate by a hash of the
certificate's record. The record contains the hash of the certified curve, so a changed number is detected.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pinproof.common import structs as st
from pinproof.common.files import read_json, write_text_whole
from pinproof.common.results import Rows, Shown, View
from pinproof.common.validation import require_number
from pinproof.errors import InputError, TrajectoryError
from pinproof.motion.curve import MEET_TOLERANCE
from pinproof.motion.trajectory import Trajectory
from pinproof.motion.trajectory_files import (
    CLOCK,
    INTERPOLANTS,
    NANO,
    RATES,
    ROW,
    STATE_KEYS,
    TIME,
    UNITS,
    MotionRecord,
    stamp,
)
from pinproof.spatial import Array

EventKind = Literal["grip", "release"]

# The units that a program states.
PROGRAM_UNITS = {**{key: unit for key, unit in UNITS.items() if key != "time_from_start"}, "time": "s and ns"}
# The version of the format of programs, raised by breaking changes.
PROGRAM_SCHEMA = "pinproof/program/1"


@st.described(eq=False)
class ProgramSegment:
    """A motion between two events or certificates."""

    name: str = st.key('the name, such as ``"transit"``')
    start: float = st.key("from the start of the program to the start of this segment", "s")
    trajectory: Trajectory = st.key("the motion; its own times start at 0")
    certificate: str = st.key("the hash of the certificate's record, a key of :attr:`MotionProgram.certificates`")

    @property
    def end(self) -> float:
        """Seconds from the start of the program to the end of this segment."""
        return (_clock(self.start) + _clock(self.trajectory.duration)) / NANO


# A time in seconds, which files state in nanoseconds.
TIMED = st.Kind(
    TIME,
    lambda name, value: require_number(name, value, "s", minimum=0.0),
    lambda name, stated, path: TIME.parse(name, stated, path) / NANO,
    lambda seconds: stamp(_clock(seconds)),
)


@st.struct("event")
class ProgramEvent:
    """What happens while the arm rests at the end of a segment."""

    kind: EventKind = st.key("what the gripper does")
    time: float = st.key("time of the event from the start of the program", kind=TIMED)
    dwell: float = st.key("how long the arm then rests", default=0.0, required=True, kind=TIMED)
    object: str = st.key(
        "object that is gripped or released; empty if the pick states none", default="", required=True, kind=st.ANY_TEXT
    )
    joints: Mapping[str, float] = st.key(
        "values of the gripper joints after the event, by name; empty for a gripper that is not a joint",
        "rad or m",
        default_factory=dict,
        required=True,
        kind=st.mapping_to(st.PLAIN_NUMBER),
    )

    @property
    def end(self) -> float:
        """Seconds from the start of the program to the end of the dwell time."""
        return (_clock(self.time) + _clock(self.dwell)) / NANO


@st.described(eq=False)
class MotionProgram(Shown):
    """Segments and events on one clock, which starts at 0.

    Raises
    ------
    InputError
        If times have a gap or overlap, joint values or velocities jump, the arm moves at an event, an event is not at
        the end of a segment, or a certificate is missing.
    """

    name: str = st.key("the name of the program, such as the name of its pick")
    segments: tuple[ProgramSegment, ...] = st.key(
        "the motions in order. Each starts where the previous one ends, and when the dwell time between them has passed"
    )
    events: tuple[ProgramEvent, ...] = st.key("the events in order, each at the end of a segment")
    certificates: Mapping[str, MotionRecord] = st.key(
        "the records of the certificates by :func:`certificate_id`. Consecutive segments with the same certificate "
        "form one certified motion"
    )
    robot: str = st.key("the robot; empty if it is not known", default="")
    tcp: str = st.key("its tcp frame; empty if it is not known", default="")
    member: str = st.key(
        "the name of the grasp, if it is one of a part type, and how it differs from the nominal one "
        "(:attr:`pinproof.picks.PickVerdict.member`)",
        default="",
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", tuple(self.segments))
        object.__setattr__(self, "events", tuple(self.events))
        if not self.segments:
            raise InputError("a program needs at least one segment")
        if _clock(self.segments[0].start) != 0:
            raise InputError(f"segment {self.segments[0].name!r} starts at {self.segments[0].start} s, not at 0")
        for segment in self.segments:
            if segment.certificate not in self.certificates:
                raise InputError(f"the certificate {segment.certificate!r} of segment {segment.name!r} does not exist")
        for name, record in self.certificates.items():
            if certificate_id(record) != name:
                raise InputError(f"the record of certificate {name!r} was changed: its hash is another")
        # Each event is at the end of a segment, where the arm rests.
        ends, last = {_clock(segment.end) for segment in self.segments}, self.segments[-1]
        dwells: dict[int, int] = {}
        for event in self.events:
            if _clock(event.time) not in ends:
                raise InputError(f"event {event.kind!r} at {event.time} s is not at the end of a segment")
            if _clock(event.time) == _clock(last.end) and last.trajectory.velocities[-1].any():
                raise InputError(f"the arm moves at the event {event.kind!r} at the end of the program")
            dwells[_clock(event.time)] = _clock(event.dwell)
        if len(dwells) < len(self.events):
            raise InputError("two events have the same time")
        # Each segment begins where and when the previous one ends, after the dwell time of the event between them.
        for before, after in pairwise(self.segments):
            between, end = f"segments {before.name!r} and {after.name!r}", _clock(before.end)
            rest = dwells.get(end, 0)
            if end + rest != _clock(after.start):
                raise InputError(
                    f"{between}: the first ends at {before.end} s, {rest / NANO:g} s of dwell time follow, but the "
                    f"second starts at {after.start} s"
                )
            one, other = before.trajectory, after.trajectory
            if end in dwells and (one.velocities[-1].any() or other.velocities[0].any()):
                raise InputError(f"{between}: the arm does not rest at the event between them")
            other.refuse_gap_after(one, between)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints, in the order of the columns."""
        return self.segments[0].trajectory.joint_names

    @property
    def duration(self) -> float:
        """Seconds from the start of the program to its end, with all dwell times."""
        return max([self.segments[-1].end, *(event.end for event in self.events)])

    @property
    def motions(self) -> dict[str, Trajectory]:
        """The certified motions by certificate: its segments joined without dwell times, exactly as certified."""
        parts: dict[str, list[Trajectory]] = {}
        for segment in self.segments:
            parts.setdefault(segment.certificate, []).append(segment.trajectory)
        return {name: Trajectory.join(*segments) for name, segments in parts.items()}

    @property
    def changed(self) -> tuple[str, ...]:
        """The names of the certified motions whose curve differs from the certified one."""
        found = self.motions.items()
        return tuple(self.certificates[key].name for key, m in found if m.digest() != self.certificates[key].curve)

    def leads_to(self, following: MotionProgram) -> bool:
        """Whether another program starts where this one ends."""
        gap = self.segments[-1].trajectory.end - following.segments[0].trajectory.start
        return bool(np.abs(gap).max() <= MEET_TOLERANCE)

    def __call__(self, t: float) -> Array:
        """The configuration (n,) at time ``t`` in [0, duration]; InputError outside."""
        if not 0.0 <= t <= self.duration:
            raise InputError(f"t = {t} s is outside the program, which lasts {self.duration:.9g} s")
        segment = next(segment for segment in reversed(self.segments) if segment.start <= t)
        return segment.trajectory(min(t - segment.start, segment.trajectory.duration))

    @classmethod
    def load(cls, path: str | Path, *, allow_changes: bool = False) -> MotionProgram:
        """Read a file written by :meth:`save`.

        Parameters
        ----------
        path
            The file.
        allow_changes
            Whether to accept motions that differ from the certified ones; :attr:`changed` names them.

        Raises
        ------
        TrajectoryError
            If the file cannot be read, is not a program, contradicts itself, or contains a motion that differs from the
            one that was certified.
        """
        source = Path(path)
        data = read_json(source, TrajectoryError)
        if isinstance(data, dict) and data.get("schema", PROGRAM_SCHEMA) != PROGRAM_SCHEMA:
            raise TrajectoryError(source, f"is {data['schema']!r}; this version reads {PROGRAM_SCHEMA!r}", "schema")
        with st.errors_of(source, TrajectoryError):
            program: MotionProgram = PROGRAM.parse("the file", data, source)
            with np.errstate(over="ignore", invalid="ignore"):  # numbers near the largest double; never certified
                changed = program.changed
        if changed and not allow_changes:
            names = ", ".join(changed)
            raise TrajectoryError(source, f"differs from the motion that was certified: {names}; certify it again")
        return program

    def save(self, path: str | Path) -> None:
        """Write the program as JSON; :meth:`load` restores every number exactly.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        write_text_whole(Path(path), self.to_json())

    def to_json(self) -> str:
        """The text of the file, with one point per line."""
        segments = []
        for segment in self.segments:
            start, rows = _clock(segment.start), segment.trajectory.record().rows()
            points = [
                {"time": stamp(start + clock), "positions": q, **dict(zip(RATES, rates, strict=False))}
                for clock, q, *rates in rows
            ]
            lines = ",\n    ".join(json.dumps(point, allow_nan=False) for point in points)
            head = json.dumps(SEGMENT_HEAD.write(segment))
            segments.append(f'  {head[:-1]}, "points": [\n    {lines}\n  ]}}')
        head, lines = json.dumps(PROGRAM_HEAD.write(self), indent=1, allow_nan=False), ",\n".join(segments)
        return f'{head[:-2]},\n "segments": [\n{lines}\n ]\n}}\n'

    def _view(self) -> View:
        rows = [(segment.start, segment.end, f"segment {segment.name}") for segment in self.segments]
        rows += [(e.time, e.end, f"event {e.kind}{e.object and f' {e.object}'}") for e in self.events]
        rows.sort(key=lambda row: row[:2])
        lines = (f"{start:.4f} to {end:.4f} s: {what}" for start, end, what in rows)
        title = f"Program {self.name}: {self.duration:.4g} s"
        table = Rows(("start [s]", "end [s]", "what"), rows)
        return View(f"{self.name!r}, {self.duration:.4g} s", [table], lines, title=title)


def certificate_id(record: MotionRecord) -> str:
    """The hash (SHA-256, hexadecimal) of a record, which names its certificate."""
    text = json.dumps(record.to_dict(), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def _clock(seconds: float) -> int:
    return round(seconds * NANO)


def _time(name: str, text: str) -> st.Key:
    """A key with a time in seconds of a program, which files state in nanoseconds from its start."""
    return st.required(name, CLOCK, text, get=lambda timed: _clock(getattr(timed, name)))


def _program(
    *,
    schema: str,  # noqa: ARG001  # checked, as are the units
    units: Mapping[str, str],  # noqa: ARG001
    joint_names: tuple[str, ...],
    interpolant: str,
    limits_note: str,
    duration: int,
    segments: Sequence[Mapping[str, Any]],
    **stated: Any,
) -> MotionProgram:
    """The program of the values of a file, whose times are in nanoseconds from its start."""
    quintic = interpolant == INTERPOLANTS["quintic"]
    made = []
    for number, segment in enumerate(segments):
        points, start = segment["points"], segment["start"]
        columns: list[list[Any]] = []
        for kind in ("positions", *RATES[: 1 + quintic]):
            columns.append([point.get(kind, ()) for point in points])
            for k, row in enumerate(columns[-1]):
                if len(row) != len(joint_names) and kind in points[k]:
                    reason = f"must be a list of {len(joint_names)} numbers, one per joint; it has {len(row)}"
                    raise st.Misread(reason, (".segments", number, ".points", k, f".{kind}"))
        for k, point in enumerate(points):
            if ("accelerations" in point) is not quintic:
                reason = "accelerations are required in a quintic program and refused in a cubic one"
                raise st.Misread(reason, (".segments", number, ".points", k))
        if points[0]["time"] != start:
            raise st.Misread("is not the start of the segment", (".segments", number, ".points", 0, ".time"))
        times = np.array([point["time"] - start for point in points]) / NANO
        q, velocities, *rest = columns
        try:
            motion = Trajectory(times, q, velocities, joint_names, limits_note, accelerations=rest[0] if rest else None)
        except InputError as error:
            raise st.Misread(str(error), (".segments", number)) from error
        made.append(ProgramSegment(segment["name"], start / NANO, motion, segment["certificate"]))
        if segment["end"] != _clock(made[-1].end):
            raise st.Misread("is not the time of the last point", (".segments", number, ".end"))
    program = MotionProgram(segments=tuple(made), **stated)
    if duration != _clock(program.duration):
        raise st.Misread("is not the end of the segments and events", (".duration",))
    return program


PROGRAM_POINT = st.Table(
    "program_point",
    "The state of all joints at one time.",
    st.required("time", CLOCK, "time from the start of the program; strictly increasing"),
    *STATE_KEYS,
    st.Key(
        "accelerations",
        ROW,
        "one for each joint; required in quintic programs, refused in cubic ones",
        "rad/s² or m/s²",
    ),
)

# The keys of a segment before its points, which are written one per line.
SEGMENT_HEAD = st.Table(
    "segment",
    "A motion between two events or certificates. The arm rests at events; at other ends it may move, with the "
    "velocity of the next segment.",
    st.required("name", st.ANY_TEXT, "name, such as `transit`"),
    st.required("certificate", st.ANY_TEXT, "hash that names the certificate under `certificates`"),
    _time("start", "time of the first point: the end of the previous segment and of the dwell time after it"),
    _time("end", "time of the last point"),
)

SEGMENT = st.Table(
    SEGMENT_HEAD.title,
    SEGMENT_HEAD.text,
    *SEGMENT_HEAD.keys,
    st.required("points", st.list_of(PROGRAM_POINT, 1), "the points in the order of time"),
)

# The keys of a program before its segments.
PROGRAM_HEAD = st.Table(
    "program",
    "A motion program: certified segments with events, on one clock.",
    st.schema_version(PROGRAM_SCHEMA),
    st.required("name", st.ANY_TEXT, "name of the program, such as the name of its pick"),
    st.required("robot", st.ANY_TEXT, "the robot; empty if it is not known"),
    st.required("tcp", st.ANY_TEXT, "the tcp frame; empty if it is not known"),
    st.required(
        "member", st.ANY_TEXT, "the grasp of the part and how it differs from the nominal one; empty if it does not"
    ),
    st.required(
        "units",
        st.choice(PROGRAM_UNITS),
        "the units of the points: " + ", ".join(f"`{key}`: {unit}" for key, unit in PROGRAM_UNITS.items()),
        get=lambda _: PROGRAM_UNITS,
    ),
    st.required(
        "interpolant",
        st.choice(*INTERPOLANTS.values()),
        "the curve between points",
        get=lambda program: INTERPOLANTS[program.segments[0].trajectory.interpolant],
    ),
    st.required(
        "limits_note",
        st.ANY_TEXT,
        "where the limits of the timing come from",
        get=lambda program: program.segments[0].trajectory.limits_note,
    ),
    st.required("joint_names", st.list_of(st.ANY_TEXT, 1), "names of the joints"),
    _time("duration", "time of the end of the program, with all dwell times"),
    st.required("events", st.list_of(st.table_of(ProgramEvent)), "the events in the order of time"),
    st.required(
        "certificates",
        st.mapping_to(st.table_of(MotionRecord)),
        "the records of the certificates by their hash (SHA-256, hexadecimal)",
    ),
)

PROGRAM = st.Table(
    PROGRAM_HEAD.title,
    PROGRAM_HEAD.text,
    *PROGRAM_HEAD.keys,
    st.required("segments", st.list_of(SEGMENT, 1), "the motions in order"),
    make=_program,
)
