"""Trajectories as CSV: a first line that names the curve, a header with joint names, a row a point."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Sequence

from pinproof.motion.clock import NANO
from pinproof.motion.trajectory_reader import Points, Reader, Record

__all__ = ["from_csv", "to_csv"]

_MARK = "# pinproof: "
_KINDS = ("position", "velocity", "acceleration")
_TIME = re.compile(r"(\d{1,10})\.(\d{9})", re.ASCII)


def to_csv(record: Record) -> str:
    """The text of a file."""
    out = io.StringIO()
    out.write(f"{_MARK}{json.dumps(record.meta())}\n")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_columns(record.joint_names, 1 + len(record.rates)))
    for t, *rows in zip(*(rows.tolist() for rows in (record.nanoseconds, record.q, *record.rates)), strict=True):
        writer.writerow([f"{t // NANO}.{t % NANO:09d}", *(repr(value) for row in rows for value in row)])
    return out.getvalue()


def _columns(names: Sequence[str], kinds: int) -> list[str]:
    return ["time_from_start", *(f"{kind} {name}" for kind in _KINDS[:kinds] for name in names)]


def from_csv(reader: Reader, text: str) -> Record:
    """Read what :func:`to_csv` wrote."""
    first, _, body = text.partition("\n")
    if not first.startswith(_MARK):
        reader.fail(f"must start with '{_MARK}{{...}}', the line that names the interpolant", "line 1")
    try:
        meta = json.loads(first[len(_MARK) :], parse_constant=reader.not_finite)
    except (ValueError, RecursionError) as error:
        reader.fail(f"is no JSON: {error}", "line 1")
    rows = csv.reader(io.StringIO(body, newline=""), strict=True)
    points = Points()
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
                reader.fail(f"has {len(row)} cells, the header has {len(header)}", place)
            time = _TIME.fullmatch(row[0])
            if time is None:
                reader.fail(f"time_from_start must read like 0.125000000, not {row[0]!r}", place)
            numbers = reader.numbers([reader.number(cell, place) for cell in row[1:]], kinds * n, place)
            points.places.append(place)
            points.clock.append(reader.nanoseconds(int(time[1]), int(time[2]), place))
            points.q.append(numbers[:n])
            points.velocities.append(numbers[n : 2 * n])
            if kinds == 3:
                points.accelerations.append(numbers[2 * n :])
    except csv.Error as error:
        reader.fail(f"is no CSV: {error}", f"line {rows.line_num + 1}")
    if not points.clock:
        reader.fail("has no point", "line 3")
    return reader.record(names, points, meta, "line 1")
