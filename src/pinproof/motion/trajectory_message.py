"""trajectory_msgs/JointTrajectory as text: JSON, and YAML as ``ros2 topic echo`` and ``rostopic echo`` print it.

Times are read as ROS 2 spells them, {sec, nanosec}, as ROS 1 does, {secs, nsecs}, and as a number of seconds.
"""

from __future__ import annotations

import json
from typing import Any

from pinproof.description.lined_yaml import read_yaml
from pinproof.errors import TrajectoryError
from pinproof.motion.clock import LONGEST, NANO
from pinproof.motion.trajectory_reader import Points, Reader, Record

__all__ = ["from_json", "from_yaml", "to_json"]

_TOP_KEYS = {"header", "joint_names", "points", "pinproof"}
_RATES = ("velocities", "accelerations")
_POINT_KEYS = {"positions", *_RATES, "effort", "time_from_start"}
_TIME_KEYS = (("sec", "nanosec"), ("secs", "nsecs"))


def to_json(record: Record) -> str:
    """The message with one key more, ``pinproof``, and one point a line: readable diffs."""
    points = []
    for t, q, *rates in zip(*(rows.tolist() for rows in (record.nanoseconds, record.q, *record.rates)), strict=True):
        time = {"sec": t // NANO, "nanosec": t % NANO}
        points.append({"positions": q, **dict(zip(_RATES, rates, strict=False)), "time_from_start": time})
    lines = ",\n  ".join(json.dumps(point, allow_nan=False) for point in points)
    return (
        f'{{"pinproof": {json.dumps(record.meta())},\n "joint_names": {json.dumps(list(record.joint_names))},\n'
        f' "points": [\n  {lines}\n ]}}\n'
    )


def from_json(reader: Reader, text: str) -> Record:
    """Read what :func:`to_json` wrote, or a message without our key."""

    def object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        if twice := next((key for key in keys if keys.count(key) > 1), None):  # JSON would keep the last
            reader.fail(f"gives the key {twice!r} twice")
        return dict(pairs)

    try:
        data = json.loads(text, parse_constant=reader.not_finite, object_pairs_hook=object_of)
    except (ValueError, RecursionError) as error:
        reader.fail(f"is no JSON: {error}")
    return _from_message(reader, data)


def from_yaml(reader: Reader, _text: str) -> Record:
    """Read a message in YAML."""
    return _from_message(reader, read_yaml(reader.path, sorted(_TOP_KEYS), TrajectoryError))


def _from_message(reader: Reader, data: Any) -> Record:
    if not isinstance(data, dict):
        reader.fail("must be an object with joint_names and points")
    reader.known_keys(data, _TOP_KEYS, required={"joint_names", "points"}, place="")
    names = data["joint_names"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        reader.fail("must be a list of texts", "joint_names")
    stated = data["points"]
    if not isinstance(stated, list) or not stated:
        reader.fail("must be a list of at least one point", "points")
    points = Points()
    for i, point in enumerate(stated):
        _read_point(reader, point, f"points[{i}]", len(names), points)
    if points.accelerations and len(points.accelerations) != len(stated):
        reader.fail(
            "some points bear accelerations and some none; a controller would mix quintics and cubics", "points"
        )
    return reader.record(names, points, data.get("pinproof"), "pinproof", ".time_from_start")


def _read_point(reader: Reader, point: Any, place: str, count: int, points: Points) -> None:
    if not isinstance(point, dict):
        reader.fail("must be an object", place)
    reader.known_keys(point, _POINT_KEYS, required={"positions", "time_from_start"}, place=place)
    if not point.get("velocities"):
        reader.fail(
            "lacks velocities: through positions alone a controller goes in straight lines, with a jump of the speed "
            "at every point; make a JointPath of them and time it with time_parametrise",
            place,
        )
    if point.get("effort"):
        reader.fail("efforts are not kept; remove them", f"{place}.effort")
    points.places.append(place)
    points.clock.append(_time(reader, point["time_from_start"], f"{place}.time_from_start"))
    points.q.append(reader.numbers(point["positions"], count, f"{place}.positions"))
    points.velocities.append(reader.numbers(point["velocities"], count, f"{place}.velocities"))
    if point.get("accelerations"):
        points.accelerations.append(reader.numbers(point["accelerations"], count, f"{place}.accelerations"))


def _time(reader: Reader, value: Any, place: str) -> int:
    """Whole nanoseconds; a number of seconds is rounded to them."""
    if type(value) in (int, float) and 0 <= value <= LONGEST:  # not isinstance: true is no second
        return round(value * NANO)
    for sec, nanosec in _TIME_KEYS:
        known = isinstance(value, dict) and value.keys() == {sec, nanosec}
        if known and type(value[sec]) is int and type(value[nanosec]) is int:
            return reader.nanoseconds(value[sec], value[nanosec], place)
    reader.fail('must be {"sec": integer, "nanosec": integer}, or a number of seconds from 0 on', place)
