"""What every trajectory file must hold, whatever its format; each refusal names the file and the place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError, TrajectoryError
from pinproof.motion.clock import LONGEST, NANO
from pinproof.motion.motion_record import MotionRecord, read_records

__all__ = ["INTERPOLANTS", "UNITS", "Points", "Reader", "Record"]

Array = npt.NDArray[np.float64]

INTERPOLANTS = {"cubic": "cubic Hermite between points", "quintic": "quintic Hermite between points"}
"""How our own files name the curve that their points stand for."""

UNITS = {"positions": "rad or m", "velocities": "rad/s or m/s", "time_from_start": "s and ns"}


@dataclass(frozen=True, eq=False)
class Record:
    """What a file holds: names (n,), times (m,) in nanoseconds, the rest (m, n); a quintic has accelerations."""

    joint_names: tuple[str, ...]
    nanoseconds: npt.NDArray[np.int64]
    q: Array
    velocities: Array
    accelerations: Array | None
    limits_note: str
    certified: tuple[MotionRecord, ...] = ()

    @property
    def rates(self) -> tuple[Array, ...]:
        """What stands beside the positions: velocities, and accelerations if there are any."""
        return (self.velocities,) if self.accelerations is None else (self.velocities, self.accelerations)

    def meta(self) -> dict[str, object]:
        """What our own header says."""
        units, kind = dict(UNITS), "cubic"
        if self.accelerations is not None:
            units["accelerations"], kind = "rad/s^2 or m/s^2", "quintic"
        said = {"version": 1, "interpolant": INTERPOLANTS[kind], "units": units, "limits_note": self.limits_note}
        return {**said, "certified": [each.to_dict() for each in self.certified]} if self.certified else said


class Points:
    """The points of a file as they are read, each with its place for what is found wrong later."""

    def __init__(self) -> None:
        self.places: list[str] = []
        self.clock: list[int] = []
        self.q: list[list[float]] = []
        self.velocities: list[list[float]] = []
        self.accelerations: list[list[float]] = []


class Reader:
    """Checks on what a file says."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, reason: str, place: str = "") -> NoReturn:
        """Refuse the file."""
        raise TrajectoryError(self.path, reason, place)

    def not_finite(self, token: str) -> NoReturn:
        """Refuse what JSON calls NaN or Infinity."""
        self.fail(f"holds {token}; only finite numbers make a motion")

    def known_keys(self, data: dict[str, Any], known: set[str], required: set[str], place: str) -> None:
        """Check that all required keys are there, and no unknown ones."""
        if missing := sorted(required - data.keys()):
            self.fail(f"lacks {', '.join(missing)}", place)
        if unknown := sorted(map(str, data.keys() - known)):
            self.fail(f"has unknown keys {', '.join(unknown)}; valid: {', '.join(sorted(known))}", place)

    def number(self, cell: str, place: str) -> float:
        """The number a text states."""
        try:
            return float(cell)
        except ValueError:
            self.fail(f"{cell!r} is no number", place)

    def numbers(self, values: Any, count: int, place: str) -> list[float]:
        """Finite numbers, ``count`` of them."""
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

    def nanoseconds(self, sec: int, nanosec: int, place: str) -> int:
        """Whole nanoseconds, as long as doubles can count them."""
        if not 0 <= sec <= LONGEST or not 0 <= nanosec < NANO:
            self.fail(
                f"{sec} s and {nanosec} ns: sec must lie in 0 to {LONGEST:.0f} and nanosec in 0 to {NANO - 1}", place
            )
        return sec * NANO + nanosec

    def record(self, names: list[str], points: Points, meta: Any, meta_place: str, time: str = "") -> Record:
        """Make a record, if the points are in order and stand for the curve that our own header (if any) names.

        ``time`` is where in a point its time stands.
        """
        if points.clock[0] != 0:
            self.fail("the first point must be at time 0", points.places[0] + time)
        for i in range(1, len(points.clock)):
            if points.clock[i] <= points.clock[i - 1]:
                self.fail("times must increase strictly", points.places[i] + time)
        shape = len(points.clock), len(names)
        record = Record(
            tuple(names),
            np.array(points.clock, np.int64),
            np.reshape(points.q, shape),
            np.reshape(points.velocities, shape),
            np.reshape(points.accelerations, shape) if points.accelerations else None,
            self._note(meta, meta_place),
            self._certified(meta, meta_place),
        )
        for key, ours in record.meta().items() if meta is not None else ():
            if key not in ("limits_note", "certified") and meta.get(key) != ours:
                self.fail(f"{key} must be {ours!r}, not {meta.get(key)!r}", meta_place)
        return record

    def _note(self, meta: Any, place: str) -> str:
        if meta is None:
            return ""
        if not isinstance(meta, dict):
            self.fail("must be an object", place)
        note = meta.get("limits_note", "")
        if not isinstance(note, str):
            self.fail("limits_note must be a text", place)
        return note

    def _certified(self, meta: Any, place: str) -> tuple[MotionRecord, ...]:
        try:
            return () if meta is None else read_records(meta.get("certified", []))
        except InputError as error:
            self.fail(str(error), place)
