"""Trajectory files: JSON and YAML with the structure of trajectory_msgs/JointTrajectory, and CSV.

Numbers are written by ``repr``, the shortest text that is read back as the same double; times are integers of
nanoseconds. Hence a file defines exactly the curve that was in memory. The YAML output of ``ros2 topic echo`` and
``rostopic echo`` can be read. Times have the form {sec, nanosec} of ROS 2, {secs, nsecs} of ROS 1, or are numbers of
seconds. A CSV file has a first line that names the interpolant, a header with joint names, and one row per point.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, NamedTuple, NoReturn, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from pinproof.common import structs as st
from pinproof.common.files import (
    YAML_SUFFIXES,
    csv_text,
    other_separator,
    parse_json,
    read_text,
    read_yaml,
    unknown_suffix,
    write_text_whole,
)
from pinproof.common.results import Written
from pinproof.description import Calibration
from pinproof.errors import InputError, TrajectoryError
from pinproof.spatial import Array

NANO = 1_000_000_000
"""Nanoseconds in a second."""

# Longest duration (s, 13 days), up to which `whole_nanoseconds(seconds(k)) == k`: the rounding errors of k / NANO and
# of its product with NANO are each half a unit of a 53-bit mantissa at most, together less than half a nanosecond.
LONGEST = 2.0**50 / NANO
# The names of the interpolants in the metadata of a file.
INTERPOLANTS = {"cubic": "cubic Hermite between points", "quintic": "quintic Hermite between points"}
# The units in the metadata of a file.
UNITS = {
    "positions": "rad or m",
    "velocities": "rad/s or m/s",
    "time_from_start": "s and ns",
    "accelerations": "rad/s^2 or m/s^2",
}
# The units of a cubic, which has no accelerations.
CUBIC_UNITS = {key: unit for key, unit in UNITS.items() if key != "accelerations"}
# The suffixes of motion files that are written and read.
WRITTEN, READ = (".json", ".csv"), (".json", ".csv", *YAML_SUFFIXES)

RATES = ("velocities", "accelerations")
_TIME_KEYS = (("sec", "nanosec"), ("secs", "nsecs"))
_MARK = "# pinproof: "
_KINDS = ("position", "velocity", "acceleration")
_TIME = re.compile(r"(\d{1,10})\.(\d{9})", re.ASCII)

Codec = TypeVar("Codec")


@st.struct("record")
class MotionRecord(Written):
    """The setup with which a motion, or a part of it, was certified. A record is not a proof.

    Notes
    -----
    It allows a later certification to detect differences of the setup. A proof that can be verified independently is
    written by :meth:`pinproof.Certificate.save`.
    """

    name: str = st.key("name of the part, such as `transit`; `motion` if there is only one", kind=st.ANY_TEXT)
    start: float = st.key("start of the part from the start of the motion", "s", kind=st.PLAIN_NUMBER)
    end: float = st.key("end of the part", "s", kind=st.PLAIN_NUMBER)
    status: str = st.key("status of the certificate: `FREE`, `COLLIDING`, `VIOLATED` or `UNDECIDED`", kind=st.ANY_TEXT)
    clearance: Annotated[float | None, st.OPTIONAL_NUMBER] = st.key(
        "proven clearance; null if none was proven or no obstacle exists", "m"
    )
    margin: float = st.key("required distance between any two bodies", "m", kind=st.PLAIN_NUMBER)
    pairs: int = st.key("number of pairs of bodies that were checked")
    curve: str = st.key("hash of the certified curve", kind=st.ANY_TEXT)
    setup: str = st.key("hash of the arm, the scene and the attached bodies", kind=st.ANY_TEXT)
    attached: Mapping[str, str] = st.key(
        "the bodies attached to the tcp: a hash of shape and pose by name",
        default_factory=dict,
        required=True,
        kind=st.mapping_to(st.ANY_TEXT),
    )
    held: Mapping[str, float] = st.key(
        "values of joints outside the arm, by name",
        "rad or m",
        default_factory=dict,
        required=True,
        kind=st.mapping_to(st.PLAIN_NUMBER),
    )
    obstacles: tuple[str, ...] = st.key(
        "names of the obstacles of the scene", default=(), required=True, kind=st.list_of(st.ANY_TEXT)
    )
    constraints: tuple[str, ...] = st.key(
        "the certified constraints of the tcp, with all their numbers", default=(), kind=st.list_of(st.ANY_TEXT)
    )
    calibrations: Mapping[str, Calibration] = st.key(
        "the calibration of each calibrated arm, by the name of its robot", default_factory=dict
    )

    def same_setup(self, other: MotionRecord) -> bool:
        """Whether both were made with the same attached bodies, held joints, scene and margin."""
        return all(getattr(self, kind) == getattr(other, kind) for kind in ("setup", "attached", "held", "margin"))


class Certified(Protocol):
    """The attributes of a certificate that :meth:`pinproof.Trajectory.save` requires."""

    @property
    def curve(self) -> str:
        """The hash of the certified curve."""

    def motion_record(self, name: str = "motion", start: float = 0.0, end: float = 0.0) -> MotionRecord:
        """The record of the setup."""


def checked_nanoseconds(sec: int, nanosec: int) -> int:
    """The time in nanoseconds; InputError if doubles do not represent it exactly."""
    if not 0 <= sec <= LONGEST or not 0 <= nanosec < NANO:
        valid = f"sec must be from 0 to {LONGEST:.0f} and nanosec from 0 to {NANO - 1}"
        raise InputError(f"{sec} s and {nanosec} ns: {valid}")
    return sec * NANO + nanosec


def stamp(nanoseconds: int) -> dict[str, int]:
    """A time as in ROS 2."""
    return {"sec": nanoseconds // NANO, "nanosec": nanoseconds % NANO}


def _time_of(seconds: str, nanoseconds: str, of: str) -> st.Table:
    return st.Table(
        f"time_of_{of}",
        f"A time as in {of.upper().replace('ROS', 'ROS ')}.",
        st.required(seconds, st.COUNT, "whole seconds", "s"),
        st.required(nanoseconds, st.integer(0, NANO - 1), "nanoseconds", "ns"),
        make=lambda **stated: checked_nanoseconds(*stated.values()),
    )


TIME = _time_of(*_TIME_KEYS[0], "ros2")

# A time in nanoseconds, which files state as in ROS 2.
CLOCK = st.Kind(TIME, lambda _, clock: clock, TIME.parse, stamp)
# The keys of points that motions and programs share.
STATE_KEYS = (
    st.required("positions", st.list_of(st.PLAIN_NUMBER, 1), "one for each joint", "rad or m"),
    st.required("velocities", st.list_of(st.PLAIN_NUMBER, 1), "one for each joint", "rad/s or m/s"),
)

POINT = st.Table(
    "point",
    "The state of all joints at one time. Either all points have accelerations, or none has.",
    *STATE_KEYS,
    st.Key(
        "accelerations",
        st.list_of(st.PLAIN_NUMBER),
        "one for each joint, for quintic interpolation; by default none",
        "rad/s² or m/s²",
    ),
    st.Key("effort", st.list_of(st.PLAIN_NUMBER, 0, 0), "not supported; must be empty"),
    st.required(
        "time_from_start",
        st.any_of(st.NOT_NEGATIVE, TIME, _time_of(*_TIME_KEYS[1], "ros1")),
        "time from the start of the motion; 0 for the first point, then strictly increasing",
        "s",
    ),
)

RECORDS = st.list_of(st.table_of(MotionRecord))

META = st.Table(
    "metadata",
    "What a message does not state. The values are checked, because another interpolation is another motion.",
    st.required("version", st.choice(1), "version of this format"),
    st.required(
        "interpolant",
        st.choice(*INTERPOLANTS.values()),
        "the curve between points; quintic with accelerations, otherwise cubic",
    ),
    st.required(
        "units",
        st.choice(CUBIC_UNITS, UNITS),
        "the units of the points: " + ", ".join(f"`{key}`: {unit}" for key, unit in UNITS.items()),
    ),
    st.Key("limits_note", st.ANY_TEXT, "where the limits of the timing come from", "", ""),
    st.Key("certified", RECORDS, "how the motion was certified", "", []),
)


def _metadata_of(kind: str, units: dict[str, str]) -> dict[str, Any]:
    stated = {"interpolant": {"const": INTERPOLANTS[kind]}, "units": {"const": units}}
    return {"properties": {"pinproof": {"properties": stated}}}


MOTION = st.Table(
    "motion",
    "A timed motion: a message trajectory_msgs/JointTrajectory, with metadata of pinproof.",
    st.Key("header", st.ANYTHING, "header of the message; ignored"),
    st.required("joint_names", st.list_of(st.ANY_TEXT, 1), "names of the joints"),
    st.required("points", st.list_of(POINT, 1), "the points in the order of time"),
    st.Key("pinproof", META, "metadata; a message of another program has none"),
    rules={
        "if": {
            "properties": {
                "points": {
                    "contains": {"required": ["accelerations"], "properties": {"accelerations": {"minItems": 1}}}
                }
            }
        },
        "then": _metadata_of("quintic", UNITS),
        "else": _metadata_of("cubic", CUBIC_UNITS),
    },
)


def whole_nanoseconds(times: Array) -> npt.NDArray[np.int64]:
    """The times in seconds, rounded to integers of nanoseconds."""
    return np.rint(times * NANO).astype(np.int64)


def seconds(nanoseconds: npt.NDArray[np.int64] | Array) -> Array:
    """The integers of nanoseconds as times in seconds."""
    result: Array = nanoseconds / NANO
    return result


@dataclass(frozen=True, eq=False)
class Record:
    """The contents of a file: names (n,), times (m,) in nanoseconds, arrays (m, n); a quintic has accelerations."""

    joint_names: tuple[str, ...]
    nanoseconds: npt.NDArray[np.int64]
    q: Array
    velocities: Array
    accelerations: Array | None
    limits_note: str
    certified: tuple[MotionRecord, ...] = ()

    @property
    def rates(self) -> tuple[Array, ...]:
        """The velocities, and the accelerations if there are any."""
        return (self.velocities,) if self.accelerations is None else (self.velocities, self.accelerations)

    def columns(self, index: Any, joint_names: tuple[str, ...]) -> Record:
        """The same points with the columns at these indices only, which are given these names."""
        rates = [values[:, index] for values in self.rates]
        second = rates[1] if len(rates) > 1 else None
        return replace(self, joint_names=joint_names, q=self.q[:, index], velocities=rates[0], accelerations=second)

    def rows(self) -> Iterator[list[Any]]:
        """The time in nanoseconds, the positions and the rates of each point, as plain numbers and lists."""
        arrays = (self.nanoseconds, self.q, *self.rates)
        return map(list, zip(*(array.tolist() for array in arrays), strict=True))

    def meta(self) -> dict[str, object]:
        """The metadata: the key ``pinproof`` of JSON files, the first line of CSV files."""
        kind, units = ("cubic", CUBIC_UNITS) if self.accelerations is None else ("quintic", UNITS)
        meta = {"version": 1, "interpolant": INTERPOLANTS[kind], "units": units, "limits_note": self.limits_note}
        return {**meta, "certified": [record.to_dict() for record in self.certified]} if self.certified else meta


class _Point(NamedTuple):
    """A point of a file, with its location for error messages; without accelerations in a cubic."""

    place: str
    nanoseconds: int
    q: list[float]
    velocities: list[float]
    accelerations: list[float] | None


class Reader:
    """Validation of the contents of a file. Every error names the file and the location."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, reason: str, place: str = "") -> NoReturn:
        """Raise a TrajectoryError."""
        raise TrajectoryError(self.path, reason, place)

    def known_keys(self, data: dict[str, Any], table: st.Table, place: str) -> None:
        """Check that all required keys and no unknown keys exist."""
        if missing := [key for key in table.required if key not in data]:
            self.fail(f"lacks {', '.join(missing)}", place)
        if unknown := sorted(str(key) for key in data if key not in table.names):
            self.fail(f"has unknown keys {', '.join(unknown)}; valid: {', '.join(table.names)}", place)

    def json(self, text: str, place: str = "") -> Any:
        """Parse JSON; numbers that are not finite and duplicate keys are refused."""
        try:
            return parse_json(text)
        except ValueError as error:
            self.fail(str(error), place)

    def numbers(self, values: Any, count: int, place: str) -> list[float]:
        """Check a list of ``count`` finite numbers."""
        if not isinstance(values, list) or len(values) != count:
            found = f"{len(values)} values" if isinstance(values, list) else repr(values)
            self.fail(f"must be a list of {count} numbers, one per joint; found {found}", place)
        for value in values:
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                self.fail(f"{value!r} is not a number", place)
            if not abs(value) < np.inf:  # this includes NaN
                self.fail(f"holds {value}; all numbers must be finite", place)
        try:
            return [float(value) for value in values]
        except OverflowError:
            self.fail("holds an integer too large for a double", place)

    def nanoseconds(self, sec: int, nanosec: int, place: str) -> int:
        """The time in nanoseconds, if doubles represent it exactly."""
        try:
            return checked_nanoseconds(sec, nanosec)
        except InputError as error:
            self.fail(str(error), place)

    def record(self, names: list[str], points: Sequence[_Point], meta: Any, place: str, time: str = "") -> Record:
        """Create a record, after checking the order of the points and the metadata, if there are any.

        ``place`` is the location of the metadata, ``time`` that of the time within a point.
        """
        # The times begin at 0 and increase.
        if points[0].nanoseconds != 0:
            self.fail("the first point must be at time 0", points[0].place + time)
        for before, point in pairwise(points):
            if point.nanoseconds <= before.nanoseconds:
                self.fail("times must increase strictly", point.place + time)
        # A message of another program has no metadata.
        if meta is not None and not isinstance(meta, dict):
            self.fail("must be an object", place)
        stated = meta or {}
        note = stated.get("limits_note", "")
        if not isinstance(note, str):
            self.fail("limits_note must be a string", place)
        where = f"{place}.certified" if place == "pinproof" else f"{place}, certified"
        try:
            certified = tuple(st.step(where, "", RECORDS.read, "certified", stated.get("certified", []), self.path))
        except st.Misread as error:
            self.fail(error.reason, error.place.removeprefix("key "))
        _, clock, q, velocities, accelerations = zip(*points, strict=True)
        shape = len(points), len(names)
        second = None if accelerations[0] is None else np.reshape(accelerations, shape)
        rows = np.reshape(q, shape), np.reshape(velocities, shape), second
        record = Record(tuple(names), np.array(clock, np.int64), *rows, note, certified)
        # What the metadata state must be what follows from the points.
        if meta is not None:
            for key, expected in record.meta().items():
                if key not in ("limits_note", "certified") and meta.get(key) != expected:
                    self.fail(f"{key} must be {expected!r}, not {meta.get(key)!r}", place)
            self.known_keys(meta, META, place)
        return record


def to_message(record: Record) -> dict[str, Any]:
    """The message as a dictionary, with the additional key ``pinproof``."""
    points = [
        {"positions": q, **dict(zip(RATES, rates, strict=False)), "time_from_start": stamp(clock)}
        for clock, q, *rates in record.rows()
    ]
    return {"pinproof": record.meta(), "joint_names": list(record.joint_names), "points": points}


def to_json(record: Record) -> str:
    """The message with the additional key ``pinproof``, and one point per line."""
    message = to_message(record)
    lines = ",\n  ".join(json.dumps(point, allow_nan=False) for point in message["points"])
    return (
        f'{{"pinproof": {json.dumps(message["pinproof"])},\n "joint_names": {json.dumps(message["joint_names"])},\n'
        f' "points": [\n  {lines}\n ]}}\n'
    )


def from_message(reader: Reader, data: Any) -> Record:
    """Read a message that was parsed before: an output of :func:`to_json`, or one without the key ``pinproof``."""
    if not isinstance(data, dict):
        reader.fail("must be an object with joint_names and points")
    reader.known_keys(data, MOTION, "")
    names = data["joint_names"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        reader.fail("must be a list of strings", "joint_names")
    stated = data["points"]
    if not isinstance(stated, list) or not stated:
        reader.fail("must be a list of at least one point", "points")
    points = []
    for i, point in enumerate(stated):
        place = f"points[{i}]"
        if not isinstance(point, dict):
            reader.fail("must be an object", place)
        if not point.get("velocities"):
            reader.fail(
                "lacks velocities: a controller interpolates positions linearly, with a velocity jump at every point; "
                "create a JointPath from the positions and time it with time_parametrise",
                place,
            )
        reader.known_keys(point, POINT, place)
        if point.get("effort"):
            reader.fail("efforts are not supported; remove them", f"{place}.effort")
        # A number of seconds is rounded to nanoseconds, as the times of a trajectory are.
        time, where = point["time_from_start"], f"{place}.time_from_start"
        keys = next((keys for keys in _TIME_KEYS if isinstance(time, dict) and time.keys() == set(keys)), None)
        if type(time) in (int, float) and 0 <= time <= LONGEST:  # type, not isinstance: bool is refused
            clock = round(time * NANO)
        elif keys and all(type(time[key]) is int for key in keys):
            clock = reader.nanoseconds(time[keys[0]], time[keys[1]], where)
        else:
            reader.fail('must be {"sec": integer, "nanosec": integer}, or a non-negative number of seconds', where)
        read = {
            kind: reader.numbers(point[kind], len(names), f"{place}.{kind}")
            for kind in ("positions", *RATES)
            if kind != "accelerations" or point.get(kind)
        }
        points.append(_Point(place, clock, read["positions"], read["velocities"], read.get("accelerations")))
    if len({point.accelerations is None for point in points}) > 1:
        reader.fail(
            "either all points or no point must have accelerations; a controller would mix quintics and cubics",
            "points",
        )
    return reader.record(names, points, data.get("pinproof"), "pinproof", ".time_from_start")


def to_csv(record: Record) -> str:
    """The text of a CSV file."""
    columns = _columns(record.joint_names, 1 + len(record.rates))
    cells = (
        [f"{clock // NANO}.{clock % NANO:09d}", *(repr(value) for row in rows for value in row)]
        for clock, *rows in record.rows()
    )
    return csv_text(columns, cells, comment=f"{_MARK}{json.dumps(record.meta())}")


def _columns(names: Sequence[str], kinds: int) -> list[str]:
    return ["time_from_start", *(f"{kind} {name}" for kind in _KINDS[:kinds] for name in names)]


def from_csv(reader: Reader, text: str) -> Record:
    """Read the output of :func:`to_csv`."""
    for number, line in enumerate(text.splitlines()[:3], start=1):
        if line.lstrip('"').startswith("time_from_start") and (other := other_separator(line.split(","))):
            reader.fail(other, f"line {number}")
    first, _, body = text.partition("\n")
    if not first.startswith(_MARK):
        reader.fail(f"must start with '{_MARK}{{...}}', which names the interpolant", "line 1")
    meta = reader.json(first[len(_MARK) :], "line 1")
    rows = csv.reader(io.StringIO(body, newline=""), strict=True)
    points = []
    try:
        header = next(rows, [])
        kinds = 3 if header and header[-1].startswith(f"{_KINDS[2]} ") else 2
        n = len(header) // kinds
        names = [column[len(_KINDS[0]) + 1 :] for column in header[1 : 1 + n]]
        if not names or header != _columns(names, kinds):
            reader.fail(
                "columns must be time_from_start, then 'position <joint>', then 'velocity <joint>', and for a quintic "
                "'acceleration <joint>'",
                "line 2",
            )
        for row in rows:
            place = f"line {rows.line_num + 1}"
            if len(row) != len(header):
                reader.fail(f"has {len(row)} cells, but the header has {len(header)}", place)
            time = _TIME.fullmatch(row[0])
            if time is None:
                reader.fail(f"time_from_start must have nine decimals, as 0.125000000, not {row[0]!r}", place)
            values = []
            for cell in row[1:]:
                try:
                    values.append(float(cell))
                except ValueError:
                    reader.fail(f"{cell!r} is not a number", place)
            numbers = reader.numbers(values, kinds * n, place)
            clock = reader.nanoseconds(int(time[1]), int(time[2]), place)
            second = numbers[2 * n :] if kinds == 3 else None
            points.append(_Point(place, clock, numbers[:n], numbers[n : 2 * n], second))
    except csv.Error as error:
        reader.fail(f"is not valid CSV: {error}", f"line {rows.line_num + 1}")
    if not points:
        reader.fail("has no point", "line 3")
    return reader.record(names, points, meta, "line 1")


_WRITERS: dict[str, Callable[[Record], str]] = {".json": to_json, ".csv": to_csv}
_READERS: dict[str, Callable[[Reader, str], Record]] = {
    ".json": lambda reader, text: from_message(reader, reader.json(text)),
    ".csv": from_csv,
    **dict.fromkeys(
        YAML_SUFFIXES, lambda reader, _: from_message(reader, read_yaml(reader.path, MOTION.names, TrajectoryError))
    ),
}


def write(path: str | Path, record: Record) -> None:
    """Write ``record`` in the format of the file extension; the complete file replaces the target."""
    target = Path(path)
    text = _by_extension(target, _WRITERS, WRITTEN)(record)
    write_text_whole(target, text, TrajectoryError)


def read(path: str | Path) -> Record:
    """Read an output of :func:`write`, or a JointTrajectory message with positions and velocities."""
    source = Path(path)
    parse = _by_extension(source, _READERS, READ)
    return parse(Reader(source), read_text(source, TrajectoryError))


def _by_extension(path: Path, codecs: dict[str, Codec], valid: tuple[str, ...]) -> Codec:
    if path.suffix.lower() not in codecs:
        raise TrajectoryError(path, unknown_suffix(path, valid))
    return codecs[path.suffix.lower()]
