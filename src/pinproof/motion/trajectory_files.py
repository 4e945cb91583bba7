"""Trajectories on disk: JSON in the shape of trajectory_msgs/JointTrajectory, and CSV.

Numbers are written by ``repr``, the shortest text that reads back to the same double; times as integers of
nanoseconds. So a file holds the very curve that was in memory.
"""

from __future__ import annotations

import csv
import io
import json
import re
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from pinproof.errors import TrajectoryError
from pinproof.motion.clock import LONGEST, NANO

__all__ = ["INTERPOLANT", "Record", "read", "write"]

Array = npt.NDArray[np.float64]

INTERPOLANT = "cubic Hermite between points"
UNITS = {"positions": "rad or m", "velocities": "rad/s or m/s", "time_from_start": "s and ns"}
_TOP_KEYS = {"header", "joint_names", "points", "pinproof"}
_POINT_KEYS = {"positions", "velocities", "accelerations", "effort", "time_from_start"}
_TIME = re.compile(r"(\d{1,10})\.(\d{9})", re.ASCII)


@dataclass(frozen=True, eq=False)
class Record:
    """What a file holds: names (n,), times (m,) in nanoseconds, positions and velocities (m, n)."""

    joint_names: tuple[str, ...]
    nanoseconds: npt.NDArray[np.int64]
    q: Array
    velocities: Array
    limits_note: str


def write(path: str | Path, record: Record) -> None:
    """Write ``record`` as its file's ending says, whole or not at all: beside the target first, then moved over it."""
    target = Path(path)
    text = _codec(target)[0](record)
    beside = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    try:
        try:
            with beside.open("x", encoding="utf-8", newline="") as file:
                file.write(text)
            beside.replace(target)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise TrajectoryError(target, f"cannot be written: {error.strerror or error}") from error


def read(path: str | Path) -> Record:
    """Read a file that :func:`write` wrote, or JSON of a JointTrajectory message with positions and velocities."""
    source = Path(path)
    parse = _codec(source)[1]
    try:
        text = source.read_bytes().decode("utf-8")
    except OSError as error:
        raise TrajectoryError(source, f"cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise TrajectoryError(source, f"is no UTF-8 text: {error.reason}", f"byte {error.start}") from error
    return parse(_Reader(source), text)


def _codec(path: Path) -> tuple[Callable[[Record], str], Callable[[_Reader, str], Record]]:
    codecs = {".json": (_to_json, _from_json), ".csv": (_to_csv, _from_csv)}
    if path.suffix.lower() not in codecs:
        raise TrajectoryError(
            path, f"a trajectory is a .json or a .csv file, not {path.suffix or 'one without ending'}"
        )
    return codecs[path.suffix.lower()]


def _meta(record: Record) -> dict[str, object]:
    return {"version": 1, "interpolant": INTERPOLANT, "units": UNITS, "limits_note": record.limits_note}


def _to_json(record: Record) -> str:
    points = [
        {"positions": q, "velocities": v, "time_from_start": {"sec": t // NANO, "nanosec": t % NANO}}
        for t, q, v in _rows(record)
    ]
    lines = ",\n  ".join(json.dumps(point, allow_nan=False) for point in points)  # one point a line: readable diffs
    return (
        f'{{"pinproof": {json.dumps(_meta(record))},\n "joint_names": {json.dumps(list(record.joint_names))},\n'
        f' "points": [\n  {lines}\n ]}}\n'
    )


def _to_csv(record: Record) -> str:
    out = io.StringIO()
    out.write(f"# pinproof: {json.dumps(_meta(record))}\n")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_csv_columns(record.joint_names))
    for t, q, v in _rows(record):
        writer.writerow([f"{t // NANO}.{t % NANO:09d}", *map(repr, q), *map(repr, v)])
    return out.getvalue()


def _rows(record: Record) -> list[tuple[int, list[float], list[float]]]:
    columns = record.nanoseconds.tolist(), record.q.tolist(), record.velocities.tolist()
    return list(zip(*columns, strict=True))


def _csv_columns(names: Sequence[str]) -> list[str]:
    return ["time_from_start", *(f"position {name}" for name in names), *(f"velocity {name}" for name in names)]


def _from_json(reader: _Reader, text: str) -> Record:
    try:
        data = json.loads(text, parse_constant=reader.not_finite)
    except (ValueError, RecursionError) as error:
        reader.fail(f"is no JSON: {error}")
    if not isinstance(data, dict):
        reader.fail("must be an object with joint_names and points")
    reader.known_keys(data, _TOP_KEYS, required={"joint_names", "points"}, place="")
    note = reader.meta(data.get("pinproof"), "pinproof")
    names = data["joint_names"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        reader.fail("must be a list of texts", "joint_names")
    points = data["points"]
    if not isinstance(points, list) or not points:
        reader.fail("must be a list of at least one point", "points")
    clock, q, v = [], [], []
    for i, point in enumerate(points):
        place = f"points[{i}]"
        if not isinstance(point, dict):
            reader.fail("must be an object", place)
        reader.known_keys(point, _POINT_KEYS, required={"positions", "velocities", "time_from_start"}, place=place)
        if point.get("accelerations"):
            reader.fail(f"with them a controller rebuilds a quintic, not {INTERPOLANT}", f"{place}.accelerations")
        if point.get("effort"):
            reader.fail("efforts are not kept; remove them", f"{place}.effort")
        clock.append(reader.time(point["time_from_start"], f"{place}.time_from_start"))
        q.append(reader.numbers(point["positions"], len(names), f"{place}.positions"))
        v.append(reader.numbers(point["velocities"], len(names), f"{place}.velocities"))
    return reader.record(names, clock, q, v, note, lambda i: f"points[{i}].time_from_start")


def _from_csv(reader: _Reader, text: str) -> Record:
    first, _, body = text.partition("\n")
    if not first.startswith("# pinproof: "):
        reader.fail("must start with '# pinproof: {...}', the line that names the interpolant", "line 1")
    try:
        meta = json.loads(first[len("# pinproof: ") :], parse_constant=reader.not_finite)
    except (ValueError, RecursionError) as error:
        reader.fail(f"is no JSON: {error}", "line 1")
    note = reader.meta(meta, "line 1")
    rows = csv.reader(io.StringIO(body, newline=""), strict=True)
    try:
        header = next(rows, [])
        names = [column[len("position ") :] for column in header[1 : 1 + len(header) // 2]]
        if not names or header != _csv_columns(names):
            reader.fail("columns must be time_from_start, then 'position <joint>', then 'velocity <joint>'", "line 2")
        clock, q, v, lines = [], [], [], []
        for row in rows:
            place = f"line {rows.line_num + 1}"
            if len(row) != len(header):
                reader.fail(f"has {len(row)} cells, the header has {len(header)}", place)
            time = _TIME.fullmatch(row[0])
            if time is None:
                reader.fail(f"time_from_start must read like 0.125000000, not {row[0]!r}", place)
            clock.append(reader.nanoseconds(int(time[1]), int(time[2]), place))
            numbers = reader.numbers([reader.number(cell, place) for cell in row[1:]], 2 * len(names), place)
            q.append(numbers[: len(names)])
            v.append(numbers[len(names) :])
            lines.append(place)
    except csv.Error as error:
        reader.fail(f"is no CSV: {error}", f"line {rows.line_num + 1}")
    if not clock:
        reader.fail("has no point", "line 3")
    return reader.record(names, clock, q, v, note, lambda i: lines[i])


class _Reader:
    """Checks on what a file says; every refusal names the file and the place."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, reason: str, place: str = "") -> NoReturn:
        raise TrajectoryError(self.path, reason, place)

    def not_finite(self, token: str) -> NoReturn:
        self.fail(f"holds {token}; only finite numbers make a motion")

    def known_keys(self, data: dict[str, Any], known: set[str], required: set[str], place: str) -> None:
        if missing := sorted(required - data.keys()):
            self.fail(f"lacks {', '.join(missing)}", place)
        if unknown := sorted(data.keys() - known):
            self.fail(f"has unknown keys {', '.join(unknown)}; valid: {', '.join(sorted(known))}", place)

    def meta(self, meta: Any, place: str) -> str:
        """The limits note out of our own header, if there is one and it speaks of the curve we rebuild."""
        if meta is None:
            return ""
        if not isinstance(meta, dict):
            self.fail("must be an object", place)
        for key, ours in (("version", 1), ("interpolant", INTERPOLANT), ("units", UNITS)):
            if meta.get(key) != ours:
                self.fail(f"{key} must be {ours!r}, not {meta.get(key)!r}", place)
        note = meta.get("limits_note", "")
        if not isinstance(note, str):
            self.fail("limits_note must be a text", place)
        return note

    def number(self, cell: str, place: str) -> float:
        try:
            return float(cell)
        except ValueError:
            self.fail(f"{cell!r} is no number", place)

    def numbers(self, values: Any, count: int, place: str) -> list[float]:
        if not isinstance(values, list) or len(values) != count:
            found = f"{len(values)} values" if isinstance(values, list) else repr(values)
            self.fail(f"must be a list of {count} numbers, one a joint; found {found}", place)
        for value in values:
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                self.fail(f"{value!r} is no number", place)
            if not abs(value) < np.inf:  # NaN too
                self.fail(f"holds {value}; only finite numbers make a motion", place)
        try:
            return [float(value) for value in values]
        except OverflowError:
            self.fail("holds an integer too large for a double", place)

    def time(self, value: Any, place: str) -> int:
        if isinstance(value, dict) and value.keys() == {"sec", "nanosec"}:
            sec, nanosec = value["sec"], value["nanosec"]
            if type(sec) is int and type(nanosec) is int:  # not isinstance: true is no second
                return self.nanoseconds(sec, nanosec, place)
        self.fail('must be {"sec": integer, "nanosec": integer}', place)

    def nanoseconds(self, sec: int, nanosec: int, place: str) -> int:
        if not 0 <= sec <= LONGEST or not 0 <= nanosec < NANO:
            self.fail(
                f"{sec} s and {nanosec} ns: sec must lie in 0 to {LONGEST:.0f} and nanosec in 0 to {NANO - 1}", place
            )
        return sec * NANO + nanosec

    def record(
        self,
        names: list[str],
        clock: list[int],
        q: list[list[float]],
        v: list[list[float]],
        note: str,
        place: Callable[[int], str],
    ) -> Record:
        if clock[0] != 0:
            self.fail("the first point must be at time 0", place(0))
        for i in range(1, len(clock)):
            if clock[i] <= clock[i - 1]:
                self.fail("times must increase strictly", place(i))
        shape = len(clock), len(names)
        return Record(tuple(names), np.array(clock, np.int64), np.reshape(q, shape), np.reshape(v, shape), note)
