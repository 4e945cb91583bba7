"""Motion programs: a sequence of certified segments with events, such as grip and release, on one common clock.

The file is JSON. Its times are integers of nanoseconds from the start of the program and its numbers are written
exactly, so a file defines the same curves as the value in memory. Every segment names its certificate by a hash of the
certificate's record. The record contains the hash of the certified curve, so a changed number is detected.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
import numpy.typing as npt

from pinproof.common.display import html_block, html_table, outline
from pinproof.common.files import read_text, write_text_whole
from pinproof.errors import InputError, TrajectoryError
from pinproof.motion.curve import Array, ends_meet
from pinproof.motion.motion_keys import INTERPOLANTS
from pinproof.motion.motion_record import MotionRecord, read_records
from pinproof.motion.trajectory import Trajectory
from pinproof.motion.trajectory_files import NANO, whole_nanoseconds

__all__ = ["SCHEMA", "EventKind", "MotionProgram", "ProgramEvent", "ProgramSegment", "certificate_id"]

SCHEMA = "pinproof/program/1"
"""The version of the file format, raised by breaking changes."""

EventKind = Literal["grip", "release"]


@dataclass(frozen=True, eq=False)
class ProgramSegment:
    """A motion between two events or certificates.

    Parameters
    ----------
    name
        The name, such as ``"transit"``.
    start
        Seconds from the start of the program to the start of this segment.
    trajectory
        The motion; its own times start at 0.
    certificate
        The hash of the certificate's record, a key of :attr:`MotionProgram.certificates`.
    """

    name: str
    start: float
    trajectory: Trajectory
    certificate: str

    @property
    def end(self) -> float:
        """Seconds from the start of the program to the end of this segment."""
        return (_clock(self.start) + _clock(self.trajectory.duration)) / NANO


@dataclass(frozen=True)
class ProgramEvent:
    """What happens while the arm rests between two segments.

    Parameters
    ----------
    kind
        ``"grip"`` or ``"release"``.
    time
        Seconds from the start of the program, at the end of a segment.
    dwell
        Seconds that the arm then rests; the next segment starts at ``time + dwell``.
    object
        The name of the object that is gripped or released; empty if the pick states none.
    joints
        Values (rad or m) of the gripper joints after the event, by name; empty for a gripper that is not a joint.
    """

    kind: EventKind
    time: float
    dwell: float = 0.0
    object: str = ""
    joints: Mapping[str, float] = field(default_factory=dict)

    @property
    def end(self) -> float:
        """Seconds from the start of the program to the end of the dwell time."""
        return (_clock(self.time) + _clock(self.dwell)) / NANO


@dataclass(frozen=True, eq=False)
class MotionProgram:
    """Segments and events on one clock, which starts at 0.

    Parameters
    ----------
    name
        The name of the program, such as that of its pick.
    segments
        The motions in order. Each starts where the previous one ends, and when the dwell time between them has passed.
    events
        The events in order, each at the end of a segment.
    certificates
        The records of the certificates by :func:`certificate_id`. Consecutive segments with the same certificate form
        one certified motion.
    robot, tcp
        The robot and its tcp frame; empty if they are not known.
    member
        How the chosen grasp differs from the nominal one, as in :attr:`pinproof.PickVerdict.member`.

    Raises
    ------
    InputError
        If times have a gap or overlap, joint values jump, the arm does not rest between segments, an event is not at
        the end of a segment, or a certificate is missing.
    """

    name: str
    segments: tuple[ProgramSegment, ...]
    events: tuple[ProgramEvent, ...]
    certificates: Mapping[str, MotionRecord]
    robot: str = ""
    tcp: str = ""
    member: str = ""

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
        self._check_events()
        for before, after in pairwise(self.segments):
            self._check_joint(before, after)

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
        return {name: Trajectory.join(*each) for name, each in parts.items()}

    @property
    def changed(self) -> tuple[str, ...]:
        """The names of the certified motions whose curve is not the one that was certified."""
        found = self.motions.items()
        return tuple(self.certificates[key].name for key, m in found if m.digest() != self.certificates[key].curve)

    def __call__(self, t: float) -> Array:
        """The configuration (n,) at time ``t`` in [0, duration]; InputError outside."""
        if not 0.0 <= t <= self.duration:
            raise InputError(f"t = {t} s is outside the program, which lasts {self.duration:.9g} s")
        segment = next(each for each in reversed(self.segments) if each.start <= t)
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
        try:
            data = json.loads(read_text(source, TrajectoryError), parse_constant=_not_finite)
            program = _from_dict(data)
        except TrajectoryError:
            raise
        except KeyError as error:
            raise TrajectoryError(source, f"lacks the key {error}") from error
        except (TypeError, ValueError, RecursionError, OverflowError) as error:
            raise TrajectoryError(source, f"is not a motion program: {error}") from error
        if program.changed and not allow_changes:
            names = ", ".join(program.changed)
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
        first = self.segments[0].trajectory
        head = {
            "schema": SCHEMA,
            "name": self.name,
            "robot": self.robot,
            "tcp": self.tcp,
            "member": self.member,
            "units": {"time": "s and ns", "positions": "rad or m", "velocities": "rad/s or m/s"},
            "interpolant": INTERPOLANTS[first.interpolant],
            "limits_note": first.limits_note,
            "joint_names": list(self.joint_names),
            "duration": _time(_clock(self.duration)),
            "events": [_event_dict(event) for event in self.events],
            "certificates": {name: record.to_dict() for name, record in self.certificates.items()},
        }
        segments = ",\n".join(_segment_json(segment) for segment in self.segments)
        return f'{json.dumps(head, indent=1, allow_nan=False)[:-2]},\n "segments": [\n{segments}\n ]\n}}\n'

    def __repr__(self) -> str:
        return outline(f"MotionProgram({self.name!r}, {self.duration:.4g} s)", (row[-1] for row in self._rows()))

    def _repr_html_(self) -> str:
        rows = [row[:-1] for row in self._rows()]
        title = f"Program {self.name}: {self.duration:.4g} s"
        return html_block(title, html_table(("start [s]", "end [s]", "what"), rows))

    def _rows(self) -> list[tuple[float, float, str, str]]:
        rows = [(each.start, each.end, f"segment {each.name}") for each in self.segments]
        rows += [(e.time, e.end, f"event {e.kind}{e.object and f' {e.object}'}") for e in self.events]
        rows.sort(key=lambda row: row[:2])
        return [(start, end, what, f"{start:.4f} to {end:.4f} s: {what}") for start, end, what in rows]

    def _check_events(self) -> None:
        ends = {_clock(segment.end) for segment in self.segments}
        for event in self.events:
            if event.kind not in get_args(EventKind):
                raise InputError(f"event {event.kind!r} is unknown; valid: {', '.join(get_args(EventKind))}")
            if event.dwell < 0:
                raise InputError(f"event {event.kind!r} has a dwell time of {event.dwell} s; it must be 0 or more")
            if _clock(event.time) not in ends:
                raise InputError(f"event {event.kind!r} at {event.time} s is not at the end of a segment")
        if len({_clock(event.time) for event in self.events}) < len(self.events):
            raise InputError("two events have the same time")

    def _check_joint(self, before: ProgramSegment, after: ProgramSegment) -> None:
        between = f"segments {before.name!r} and {after.name!r}"
        rest = sum(_clock(event.dwell) for event in self.events if _clock(event.time) == _clock(before.end))
        if _clock(before.end) + rest != _clock(after.start):
            raise InputError(
                f"{between}: the first ends at {before.end} s, {rest / NANO:g} s of dwell time follow, but the second "
                f"starts at {after.start} s"
            )
        one, other = before.trajectory, after.trajectory
        if one.interpolant != other.interpolant:
            raise InputError(f"{between} are a {one.interpolant} and a {other.interpolant} curve")
        ends_meet(one, other, between)
        if one.velocities[-1].any() or other.velocities[0].any():
            raise InputError(f"{between}: the arm does not rest between them")


def certificate_id(record: MotionRecord) -> str:
    """The hash (SHA-256, hexadecimal) of a record, which names its certificate."""
    text = json.dumps(record.to_dict(), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def _clock(seconds: float) -> int:
    return round(seconds * NANO)


def _time(clock: int) -> dict[str, int]:
    return {"sec": clock // NANO, "nanosec": clock % NANO}


def _event_dict(event: ProgramEvent) -> dict[str, Any]:
    times = {"time": _time(_clock(event.time)), "dwell": _time(_clock(event.dwell))}
    return {"kind": event.kind, **times, "object": event.object, "joints": dict(event.joints)}


def _segment_json(segment: ProgramSegment) -> str:
    motion, start = segment.trajectory, _clock(segment.start)
    head = {
        "name": segment.name,
        "certificate": segment.certificate,
        "start": _time(start),
        "end": _time(_clock(segment.end)),
    }
    rates = {"velocities": motion.velocities.tolist()}
    if motion.accelerations is not None:
        rates["accelerations"] = motion.accelerations.tolist()
    points = [
        {"time": _time(start + clock), "positions": q, **{kind: values[k] for kind, values in rates.items()}}
        for k, (clock, q) in enumerate(zip(whole_nanoseconds(motion.times).tolist(), motion.q.tolist(), strict=True))
    ]
    lines = ",\n    ".join(json.dumps(point, allow_nan=False) for point in points)
    return f'  {json.dumps(head)[:-1]}, "points": [\n    {lines}\n  ]}}'


def _from_dict(data: Any) -> MotionProgram:
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        found = data.get("schema") if isinstance(data, dict) else None
        raise InputError(f"its schema is {found!r}, not {SCHEMA!r}")
    names, note = tuple(data["joint_names"]), str(data["limits_note"])
    quintic = data["interpolant"] == INTERPOLANTS["quintic"]
    if not quintic and data["interpolant"] != INTERPOLANTS["cubic"]:
        raise InputError(f"its interpolant is {data['interpolant']!r}; valid: {', '.join(INTERPOLANTS.values())}")
    segments = tuple(_segment(each, names, note, quintic) for each in data["segments"])
    for stated, segment in zip(data["segments"], segments, strict=True):
        if _read_time(stated["end"]) != _clock(segment.end):
            raise InputError(f"segment {segment.name!r} states another end than that of its points")
    events = tuple(_event(each) for each in data["events"])
    stated_records = data["certificates"]
    records = dict(zip(stated_records, read_records(list(stated_records.values())), strict=True))
    program = MotionProgram(
        str(data["name"]), segments, events, records, str(data["robot"]), str(data["tcp"]), str(data["member"])
    )
    if _read_time(data["duration"]) != _clock(program.duration):
        raise InputError("its duration is not that of its segments and events")
    return program


def _segment(stated: Mapping[str, Any], names: Sequence[str], note: str, quintic: bool) -> ProgramSegment:
    start, points = _read_time(stated["start"]), stated["points"]
    kinds = ("positions", "velocities", *(("accelerations",) if quintic else ()))
    columns: list[npt.ArrayLike] = [[point[kind] for point in points] for kind in kinds]
    times = np.array([_read_time(point["time"]) - start for point in points]) / NANO
    curvature = columns[2] if quintic else None
    motion = Trajectory(times, columns[0], columns[1], names, note, accelerations=curvature)
    return ProgramSegment(str(stated["name"]), start / NANO, motion, str(stated["certificate"]))


def _event(stated: Mapping[str, Any]) -> ProgramEvent:
    joints = {str(name): float(value) for name, value in stated["joints"].items()}
    time, dwell = _read_time(stated["time"]) / NANO, _read_time(stated["dwell"]) / NANO
    return ProgramEvent(cast(EventKind, stated["kind"]), time, dwell, str(stated["object"]), joints)


def _read_time(stated: Mapping[str, int]) -> int:
    if type(stated["sec"]) is not int or type(stated["nanosec"]) is not int:
        raise InputError(f"a time is {stated!r}; it must have integers sec and nanosec")
    return stated["sec"] * NANO + stated["nanosec"]


def _not_finite(token: str) -> None:
    raise InputError(f"it contains {token}; all numbers must be finite")
