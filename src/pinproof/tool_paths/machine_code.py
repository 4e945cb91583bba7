"""Paths of G-code for dispensing and printing (RS-274).

A path is a run of feed moves between two rapid moves. Words that state something else than a path of the tool and its
process, such as offsets and canned cycles, are refused with the number of their line.

Sources: T. Kramer, F. Proctor, E. Messina (2000), "The NIST RS274NGC Interpreter", version 3, NISTIR 6556.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.common.files import read_text
from pinproof.common.structs import errors_of, step
from pinproof.errors import InputError, ToolPathError
from pinproof.spatial import Array
from pinproof.tool_paths.path import ToolPath
from pinproof.tool_paths.path_files import PathPoints
from pinproof.units import LENGTH_UNITS

WORD = re.compile(r"([A-Z])\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*")
COMMENT = re.compile(r"\([^()]*\)|;.*")
PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
"""The axes of the plane of arcs, and the axis across it, by the number of the G word."""

WITHOUT_EFFECT = {
    "G": {40.0, 49.0, 54.0, 61.0, 64.0, 80.0, 94.0},
    "M": {84.0, 104.0, 105.0, 106.0, 107.0, 109.0, 117.0, 140.0, 190.0},
}
"""G and M words that cancel what is not supported, or set temperatures and fans."""

SUPPORTED = "G0 to G3, G17 to G21, G90, G91, G90.1, G91.1, G92 with E, M2 to M5, M30, M82, M83"

# M: largest distance of the chords of an arc from it, and relative difference of the two radii of an arc.
CHORD, ROUND = 2e-5, 2e-3
# Largest number of points of an arc.
MOST_POINTS = 10_000


@dataclass(frozen=True, eq=False)
class FeedMove:
    """A move of the tool on lines through ``points`` (k, 3) in metres, at a speed (m/s), None where none is stated.

    ``process`` states whether the process is on, None where nothing is stated of it, and ``rapid`` that the tool is
    lifted.
    """

    points: Array
    speed: float | None
    process: bool | None
    rapid: bool = False


def paths_of(moves: list[FeedMove], normal: Array, speed: float | None, name: str) -> list[tuple[ToolPath, bool]]:
    """The paths of runs of feed moves between rapid moves and changes of the process, which is on if never stated."""
    stated = any(move.process is not None for move in moves)
    # The tool is at the origin before the first move
    begin, paths = np.zeros(3), []
    for (rapid, process), run in groupby(moves, lambda move: (move.rapid, bool(move.process))):
        points, speeds = [begin], list[float | None]()
        for move in run:
            points += list(move.points)
            speeds += [move.speed if speed is None else speed] * len(move.points)
        begin = points[-1]
        if rapid or np.ptp(points, axis=0).max() == 0.0:
            continue
        if None in speeds and any(speeds):
            raise InputError("states no feed (F) before the first moves of a path, only later; add it, or speed")
        timed: Any = None if None in speeds else speeds
        paths.append((ToolPath.through(points, normal, speed=timed, name=name), process or not stated))
    if not paths:
        raise InputError("has no feed move (G1, G2, G3) along which the tool moves")
    return paths


# -- G-code -----------------------------------------------------------------------------------------------------------


@dataclass(eq=False)
class _Machine:
    """The state of a controller that reads G-code: modes, unit, position (in the unit of the file) and extruder."""

    motion: int | None = None
    plane: int = 17
    given: str | None = None
    unit: float = LENGTH_UNITS["mm"]
    ended: bool = False
    absolute: bool = True
    absolute_arcs: bool = False
    absolute_extruder: bool = True
    at: Array = field(default_factory=lambda: np.zeros(3))
    feed: float | None = None
    on: bool | None = None
    extruded: float = 0.0

    def line(self, line: str) -> FeedMove | None:
        """Execute the words of a line, and return its move if it has one; lines behind the end have no effect."""
        if self.ended:
            return None
        text = COMMENT.sub("", line).strip().upper().strip("%")
        if rest := WORD.sub("", text).strip():
            raise InputError(f"{rest[:40]!r} is not a word of G-code, such as X12.5")
        words = [(letter, float(value)) for letter, value in WORD.findall(text)]
        values: dict[str, float] = {}
        reset = False
        for letter, value in words:
            if letter == "G" and value in (0.0, 1.0, 2.0, 3.0):
                self.motion = int(value)
            elif letter == "G" and value in PLANES:
                self.plane = int(value)
            elif letter == "G" and value in (20.0, 21.0):
                scale = self.unit / (unit := _unit("in" if value == 20.0 else "mm", self.given))
                self.unit, self.at, self.extruded = unit, self.at * scale, self.extruded * scale
                self.feed = None if self.feed is None else self.feed * scale
            elif letter == "G" and value in (90.0, 91.0):
                self.absolute = value == 90.0
            elif letter == "G" and value in (90.1, 91.1):
                self.absolute_arcs = value == 90.1
            elif letter == "M" and value in (82.0, 83.0):
                self.absolute_extruder = value == 82.0
            elif letter == "M" and value in (3.0, 4.0, 5.0):
                self.on = value < 5.0
            elif letter == "M" and value in (2.0, 30.0):
                self.ended = True
            elif letter == "G" and value == 92.0:
                reset = True
            elif letter in "XYZIJKREF":
                if letter in values:
                    raise InputError(f"states {letter} twice")
                values[letter] = value
            elif value not in WITHOUT_EFFECT.get(letter, ()) and letter not in "NOS":
                raise InputError(f"the word {letter}{value:g} is not supported; valid: {SUPPORTED}")
        # A new origin is supported for the extruder only, because a path would otherwise move without a trace
        if reset:
            if not values or set(values) - {"E"}:
                raise InputError("G92 is supported for E only; state the origin of the path as a frame")
            self.extruded = values["E"]
            return None
        if (feed := values.pop("F", None)) is not None:
            if feed <= 0.0:
                raise InputError(f"the feed F{feed:g} must be above 0")
            self.feed = feed
        return self._move(values) if values else None

    def _move(self, values: dict[str, float]) -> FeedMove | None:
        """The move to the position that a line states, None if it only moves the extruder."""
        process = self.on
        if (extruded := values.pop("E", None)) is not None:
            relative = not (self.absolute and self.absolute_extruder)
            more = extruded if relative else extruded - self.extruded
            # Most controllers read E as the positions after G91, others as M82 and M83 state
            unclear = relative and self.absolute_extruder and (extruded > self.extruded) != (extruded > 0.0)
            if unclear and values.keys() & set("XYZIJKR"):
                raise InputError(f"E{extruded:g} after G91 is relative for some controllers only; add M83 behind G91")
            self.extruded += more
            process = more > 0.0
        target = self.at.copy() if self.absolute else np.zeros(3)
        for axis, letter in enumerate("XYZ"):
            target[axis] = values.pop(letter, target[axis])
        target = target if self.absolute else self.at + target
        if self.motion is None:
            raise InputError("states a position before one of G0, G1, G2 and G3")
        if self.motion < 2 and values:
            raise InputError(f"states {next(iter(values))} without an arc (G2, G3)")
        if self.motion > 1 and not values:
            raise InputError("states an arc without its centre (I, J, K) or radius (R)")
        if self.motion < 2 and (target == self.at).all():
            return None
        points = self._arc(target, values) if self.motion > 1 else target[None]
        self.at = target
        speed = None if self.feed is None else self.feed * self.unit / 60.0
        return FeedMove(points * self.unit, speed, process, self.motion == 0)

    def _arc(self, target: Array, values: dict[str, float]) -> Array:
        """Points of the arc to a target, about its centre or with its radius, so that chords are within CHORD of it."""
        first, second, across = PLANES[self.plane]
        begin, end = self.at[[first, second]], target[[first, second]]
        sense = 1.0 if self.motion == 3 else -1.0
        if "R" in values:
            if len(values) > 1:
                raise InputError("states an arc by R and by its centre; state one of them")
            radius, chord = values["R"], end - begin
            half = 0.5 * float(np.linalg.norm(chord))
            if half == 0.0 or abs(radius) < half * (1.0 - ROUND):
                raise InputError(f"the arc of radius R{radius:g} cannot reach its end, which is {2.0 * half:g} away")
            # The arc of less than half a circle for R > 0 has its centre to the left of the chord if it turns left
            rise = np.sqrt(max(radius**2 - half**2, 0.0)) * np.sign(radius) * sense
            centre = 0.5 * (begin + end) + rise * np.array([-chord[1], chord[0]]) / (2.0 * half)
        else:
            letters = ["IJK"[first], "IJK"[second]]
            if unknown := set(values) - set(letters):
                raise InputError(f"{min(unknown)} is across the plane G{self.plane} of the arc")
            offset = np.array([values.get(letter, begin[k] * self.absolute_arcs) for k, letter in enumerate(letters)])
            centre = offset if self.absolute_arcs else begin + offset
        out, back = begin - centre, end - centre
        radius, other = float(np.linalg.norm(out)), float(np.linalg.norm(back))
        if not radius > 0.0 or abs(radius - other) > max(ROUND * radius, CHORD / self.unit):
            raise InputError(f"the start of the arc is {radius:g} from its centre, its end {other:g}")
        # A full circle if it ends where it begins
        swept = sense * (np.arctan2(back[1], back[0]) - np.arctan2(out[1], out[0]))
        swept = swept % (2.0 * np.pi) or 2.0 * np.pi
        if np.allclose(begin, end, rtol=0.0, atol=1e-9 * radius):
            swept = 2.0 * np.pi
        sagitta = min(CHORD / self.unit / radius, 1.0)
        count = min(int(np.ceil(swept / (2.0 * np.arccos(1.0 - sagitta)))) if sagitta < 1.0 else 4, MOST_POINTS)
        share = np.linspace(0.0, 1.0, max(count, 2) + 1)[1:]
        angle = np.arctan2(out[1], out[0]) + sense * swept * share
        radii = radius + (other - radius) * share
        points = np.empty((len(share), 3))
        points[:, first], points[:, second] = centre[0] + radii * np.cos(angle), centre[1] + radii * np.sin(angle)
        points[:, across] = self.at[across] + (target[across] - self.at[across]) * share
        points[-1] = target
        return points


def read_gcode(file: Path, source: PathPoints, name: str) -> list[tuple[ToolPath, bool]]:
    """The paths of a G-code file, with whether the process is on; by default, the tool points along -z."""
    machine = _Machine(given=source.unit, unit=LENGTH_UNITS[source.unit or "mm"])
    normal = np.array([0.0, 0.0, 1.0]) if source.normals is None else source.normals
    with errors_of(file, ToolPathError):
        lines = enumerate(read_text(file, ToolPathError).splitlines(), 1)
        moves = [step("", f"line {number}", machine.line, line) for number, line in lines]
        return paths_of([move for move in moves if move is not None], normal, source.speed, name)


def _unit(name: str, given: str | None) -> float:
    """Metres of a unit that a file states; refused if it is not the given one."""
    if given not in (None, name):
        raise InputError(f"states lengths in {name}, but unit is {given}; remove unit")
    return LENGTH_UNITS[name]
