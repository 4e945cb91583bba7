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
from typing import Annotated, Any, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.common import structs as st
from pinproof.common.files import (
    YAML_SUFFIXES,
    csv_text,
    other_separator,
    parse_json,
    read_json,
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


def _numbers(_: str, values: Any) -> list[float]:
    """A list of finite numbers; a motion has thousands, so they are not read one by one."""
    if not isinstance(values, list):
        raise InputError(f"must be a list of numbers, one per joint, not {st.short(values)}")
    for value in values:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InputError(f"{value!r} is not a number")
        if not abs(value) < np.inf:  # this includes NaN
            raise InputError(f"holds {value}; all numbers must be finite")
    try:
        return [float(value) for value in values]
    except OverflowError:
        raise InputError("holds an integer too large for a double") from None


def _stated_clock(_: str, stated: Any, __: Path) -> int:
    """A time in nanoseconds; a number of seconds is rounded to them, as the times of a trajectory are."""
    keys = next((keys for keys in _TIME_KEYS if isinstance(stated, dict) and stated.keys() == set(keys)), None)
    if type(stated) in (int, float) and 0 <= stated <= LONGEST:  # type, not isinstance: bool is refused
        return round(stated * NANO)
    if keys and all(type(stated[key]) is int for key in keys):
        return checked_nanoseconds(*(stated[key] for key in keys))
    raise InputError('must be {"sec": integer, "nanosec": integer}, or a non-negative number of seconds')


# The numbers of all joints at one time, and a time as messages of ROS 2 or ROS 1 state it, or in seconds.
ROW = st.Kind(st.list_of(st.PLAIN_NUMBER, 1).schema, _numbers)
STATED_CLOCK = st.Kind(
    st.any_of(st.NOT_NEGATIVE, TIME, _time_of(*_TIME_KEYS[1], "ros1")).schema, lambda _, clock: clock, _stated_clock
)
# The keys of points that motions and programs share.
STATE_KEYS = (
    st.required("positions", ROW, "one for each joint", "rad or m"),
    st.required("velocities", ROW, "one for each joint", "rad/s or m/s"),
)

POINT = st.Table(
    "point",
    "The state of all joints at one time. Either all points have accelerations, or none has.",
    *STATE_KEYS,
    st.Key(
        "accelerations",
        st.Kind(st.list_of(st.PLAIN_NUMBER).schema, _numbers),
        "one for each joint, for quintic interpolation; by default none",
        "rad/s² or m/s²",
    ),
    st.Key("effort", st.list_of(st.PLAIN_NUMBER, 0, 0), "not supported; must be empty"),
    st.required(
        "time_from_start",
        STATED_CLOCK,
        "time from the start of the motion; 0 for the first point, then strictly increasing",
        "s",
    ),
)

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
    st.Key("certified", st.list_of(st.table_of(MotionRecord)), "how the motion was certified", "", []),
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


def _checked_record(
    names: Sequence[str],
    clock: Sequence[int],
    rows: Sequence[Sequence[Sequence[float]]],
    meta: Mapping[str, Any] | None,
    failed: Callable[[str, int | None], st.Misread],
) -> Record:
    """The record of positions and rates; ``failed`` makes the error about a point, or None for the metadata.

    The times must begin at 0 and increase, and what the metadata state must be what follows from the points.
    """
    if clock[0] != 0:
        raise failed("the first point must be at time 0", 0)
    for k, (before, here) in enumerate(pairwise(clock), 1):
        if here <= before:
            raise failed("times must increase strictly", k)
    # A message of another program has no metadata.
    q, velocities, *second = (np.reshape(values, (len(clock), len(names))) for values in rows)
    stated = meta or {}
    own = stated.get("limits_note", ""), tuple(stated.get("certified", ()))
    record = Record(tuple(names), np.array(clock, np.int64), q, velocities, second[0] if second else None, *own)
    for key, expected in record.meta().items():
        if meta is not None and key in ("interpolant", "units") and meta[key] != expected:
            raise failed(f"{key} must be {expected!r}, not {meta[key]!r}", None)
    return record


def _message_record(
    *, joint_names: Sequence[str], points: Sequence[Mapping[str, Any]], pinproof: Any = None, **_: Any
) -> Record:
    """The record of the values of a message."""
    for k, point in enumerate(points):
        for kind in ("positions", *RATES):
            row = point.get(kind, ())
            if len(row) != len(joint_names) and (row or kind != "accelerations"):
                wanted = f"must be a list of {len(joint_names)} numbers, one per joint; found {len(row)} values"
                raise st.Misread(wanted, (".points", k, f".{kind}"))
    quintic = {bool(point.get("accelerations")) for point in points}
    if len(quintic) > 1:
        mixed = "either all points or no point must have accelerations; a controller would mix quintics and cubics"
        raise st.Misread(mixed, (".points",))

    def failed(reason: str, k: int | None) -> st.Misread:
        return st.Misread(reason, (".pinproof",) if k is None else (".points", k, ".time_from_start"))

    clock = [point["time_from_start"] for point in points]
    rows = [[point[kind] for point in points] for kind in ("positions", *RATES[: 1 + quintic.pop()])]
    return _checked_record(joint_names, clock, rows, pinproof, failed)


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
    make=_message_record,
)


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


def from_message(message: Any, path: str | Path) -> Record:
    """Read a message that was parsed before: an output of :func:`to_json`, or one without the key ``pinproof``.

    TrajectoryError, with the place in the message and ``path`` as its file, if something is missing or invalid.
    """
    with st.errors_of(Path(path), TrajectoryError):
        points = message.get("points") if isinstance(message, dict) else ()
        for k, point in enumerate(points if isinstance(points, list) else ()):
            if isinstance(point, dict) and not point.get("velocities"):
                remedy = "create a JointPath from the positions and time it with time_parametrise"
                linear = "a controller interpolates positions linearly, with a velocity jump at every point"
                raise st.Misread(f"lacks velocities: {linear}; {remedy}", (".points", k))
        record: Record = MOTION.read("the message", message, Path(path))
    return record


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


def from_csv(text: str, path: Path) -> Record:
    """Read the output of :func:`to_csv`; TrajectoryError with the line."""
    for number, words in enumerate(text.splitlines()[:3], start=1):
        if words.lstrip('"').startswith("time_from_start") and (other := other_separator(words.split(","))):
            raise TrajectoryError(path, other, f"line {number}")
    first, _, body = text.partition("\n")
    if not first.startswith(_MARK):
        raise TrajectoryError(path, f"must start with '{_MARK}{{...}}', which names the interpolant", "line 1")
    rows = csv.reader(io.StringIO(body, newline=""), strict=True)
    line, clock, points = 1, list[int](), list[list[float]]()
    try:
        meta = META.read("the metadata", parse_json(first[len(_MARK) :]), path)
        line, header = 2, next(rows, [])
        kinds = 3 if header and header[-1].startswith(f"{_KINDS[2]} ") else 2
        n = len(header) // kinds
        names = [column[len(_KINDS[0]) + 1 :] for column in header[1 : 1 + n]]
        if not names or header != _columns(names, kinds):
            raise InputError(
                "columns must be time_from_start, then 'position <joint>', then 'velocity <joint>', and for a quintic "
                "'acceleration <joint>'"
            )
        for row in rows:
            line = rows.line_num + 1
            if len(row) != len(header):
                raise InputError(f"has {len(row)} cells, but the header has {len(header)}")
            time = _TIME.fullmatch(row[0])
            if time is None:
                raise InputError(f"time_from_start must have nine decimals, as 0.125000000, not {row[0]!r}")
            clock.append(checked_nanoseconds(int(time[1]), int(time[2])))
            points.append(_numbers("", [_cell(cell) for cell in row[1:]]))
        line = 3
        if not points:
            raise InputError("has no point")
        columns = [[point[k * n : (k + 1) * n] for point in points] for k in range(kinds)]

        def failed(reason: str, k: int | None) -> st.Misread:
            return st.Misread(reason, (), "line 1" if k is None else f"line {k + 3}")

        return _checked_record(names, clock, columns, meta, failed)
    except csv.Error as error:
        raise TrajectoryError(path, f"is not valid CSV: {error}", f"line {rows.line_num + 1}") from error
    except ValueError as error:  # InputError is one
        place = getattr(error, "position", "") or f"line {line}"
        raise TrajectoryError(path, getattr(error, "reason", str(error)), place) from error


def _cell(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{text!r} is not a number") from None


def write(path: str | Path, record: Record) -> None:
    """Write ``record`` in the format of the file extension; the complete file replaces the target."""
    target = Path(path)
    if target.suffix.lower() not in WRITTEN:
        raise TrajectoryError(target, unknown_suffix(target, WRITTEN))
    write_text_whole(target, to_csv(record) if target.suffix.lower() == ".csv" else to_json(record), TrajectoryError)


def read(path: str | Path) -> Record:
    """Read an output of :func:`write`, or a JointTrajectory message with positions and velocities."""
    source = Path(path)
    kind = source.suffix.lower()
    if kind not in READ:
        raise TrajectoryError(source, unknown_suffix(source, READ))
    if kind == ".csv":
        return from_csv(read_text(source, TrajectoryError), source)
    yaml = kind in YAML_SUFFIXES
    return from_message(
        read_yaml(source, MOTION.names, TrajectoryError) if yaml else read_json(source, TrajectoryError), source
    )
