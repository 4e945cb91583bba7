"""Picks files in YAML or JSON, and the sources of picks: a list in memory, a grid, and a table on disk.

docs/formats/picks.md describes the files with an example. An invalid row is reported as a problem and the others are
kept; invalid shared settings are an error. A table is a CSV file of any length. It is indexed once, and its rows are
read on demand::

    name,x,y,z,roll,pitch,yaw,approach
    bolt_1,0.46,0.15,0.035,pi,0,0,0.1
    bolt_2,0.48,0.15,0.035,pi,0,0,

Each line is a pick. An empty cell or a missing column counts as not stated. Empty lines and lines that start with ``#``
are skipped. A pick without a name is named after its row. The columns are in :data:`COLUMNS`.
"""

from __future__ import annotations

import csv
import os
from abc import ABC, abstractmethod
from array import array
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.common import structs as st
from pinproof.common.content_hash import digest, digest_many
from pinproof.common.files import YAML_SUFFIXES, os_errors, other_separator, read_yaml, refuse_unreadable
from pinproof.errors import FileError, InputError, PicksError, UnknownNameError
from pinproof.picks.input.pick import DEFAULTS, PICK, Pick, completed, picks_of_row
from pinproof.picks.input.picks import CELL_ROBOT, SETTINGS, PickProblem, Picks, read_settings
from pinproof.spatial import SE3, finite, frozen, rigid, translated

COLUMNS = {
    "name": ("name",),
    "xyz": ("x", "y", "z"),
    "rpy": ("roll", "pitch", "yaw"),
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "frame": ("frame",),
    "approach": ("approach",),
    "approach_direction": ("approach_x", "approach_y", "approach_z"),
    "approach_frame": ("approach_frame",),
    "retreat": ("retreat",),
    "retreat_direction": ("retreat_x", "retreat_y", "retreat_z"),
    "retreat_frame": ("retreat_frame",),
    "spin": ("spin",),
    "part": ("part",),
    "grasp": ("grasp",),
    "tool": ("tool",),
    "object": ("object",),
    "support": ("support",),
    "place.xyz": ("place_x", "place_y", "place_z"),
    "place.rpy": ("place_roll", "place_pitch", "place_yaw"),
    "place.object_pose.xyz": ("place_object_x", "place_object_y", "place_object_z"),
    "place.object_pose.rpy": ("place_object_roll", "place_object_pitch", "place_object_yaw"),
    "place.frame": ("place_frame",),
    "place.approach": ("place_approach",),
    "place.retreat": ("place_retreat",),
    "place.support": ("place_support",),
    "upright": ("upright",),
    "payload.mass": ("mass",),
    "payload.center_of_mass": ("center_x", "center_y", "center_z"),
    "speed": ("speed",),
    "arm": ("arm",),
}
"""The keys that a row of a table can state, and their columns."""

# -- sources ----------------------------------------------------------------------------------------------------------


class PickSource(ABC):
    """An ordered source of picks. An invalid row is a :class:`PickProblem` at its index."""

    shared: Picks
    """Shared settings: tip, tool, margin, home, and robot and scene if they are stated. Its list of picks is empty."""

    with_object: frozenset[bool]
    """Which of True and False occur: picks that state an object, and picks that do not."""

    @abstractmethod
    def __len__(self) -> int:
        """The number of picks and problems."""

    @abstractmethod
    def part(self, start: int, stop: int) -> Iterable[Pick | PickProblem]:
        """The picks from index ``start`` to ``stop`` (exclusive); the result can be pickled."""

    @abstractmethod
    def digest(self) -> str:
        """A hash of all picks."""

    def transformed(self, root_from_picks: SE3) -> PickSource:
        """The same picks, transformed as by :meth:`Picks.transformed`."""
        return _TransformedSource(self, frozen(rigid("root_from_picks", root_from_picks)))

    def load(self) -> Picks:
        """All picks in memory."""
        items = list(self.part(0, len(self)))
        picks = tuple(item for item in items if isinstance(item, Pick))
        return replace(
            self.shared, picks=picks, problems=tuple(item for item in items if isinstance(item, PickProblem))
        )


@dataclass(frozen=True, eq=False)
class _Part:
    """Picks that a function makes of its arguments when they are iterated, in the process that judges them."""

    make: Callable[..., Iterable[Pick | PickProblem]]
    arguments: tuple[Any, ...]

    def __iter__(self) -> Iterator[Pick | PickProblem]:
        return iter(self.make(*self.arguments))


class _TransformedSource(PickSource):
    """The picks of another source in the frame of a robot that is placed in their cell."""

    def __init__(self, source: PickSource, placement: SE3) -> None:
        self._source, self._placement = source, placement
        self.shared, self.with_object = source.shared.transformed(placement), source.with_object

    def __len__(self) -> int:
        return len(self._source)

    def part(self, start: int, stop: int) -> Iterable[Pick | PickProblem]:
        return _Part(_transformed, (self._source.part(start, stop), self._placement))

    def digest(self) -> str:
        return digest((self._source.digest(), self._placement))


def _transformed(part: Iterable[Pick | PickProblem], placement: SE3) -> Iterator[Pick | PickProblem]:
    return (item.transformed(placement) if isinstance(item, Pick) else item for item in part)


class PickList(PickSource):
    """Picks in memory, followed by the rows that could not be read."""

    def __init__(self, picks: Picks) -> None:
        self.shared = replace(picks, picks=(), problems=())
        self._items: tuple[Pick | PickProblem, ...] = (*picks.picks, *picks.problems)
        self.with_object = frozenset(pick.carried is not None for pick in picks.picks)

    def __len__(self) -> int:
        return len(self._items)

    def part(self, start: int, stop: int) -> Iterable[Pick | PickProblem]:
        """The picks from index ``start`` to ``stop`` (exclusive)."""
        return self._items[start:stop]

    def digest(self) -> str:
        """A hash of all picks."""
        return digest_many(self._items)


def as_source(picks: Picks | PickSource) -> PickSource:
    """A list of picks as a source; a source is returned unchanged."""
    return PickList(picks) if isinstance(picks, Picks) else picks


@dataclass(frozen=True, eq=False)
class PickGrid(PickSource):
    """Copies of one pick on a grid along the axes of the robot's root link.

    The names consist of the first name and the indices: ``bolt_0_2_1``. The last axis varies fastest.

    Parameters
    ----------
    first
        The pick at the corner of the grid.
    counts
        Number of picks along x, y and z; at least 1 each.
    step
        (3,) metres between neighbours along x, y and z.
    shared
        The settings that the picks share.
    """

    first: Pick
    counts: tuple[int, int, int]
    step: tuple[float, float, float]
    shared: Picks = field(default_factory=lambda: Picks(()))

    def __post_init__(self) -> None:
        counts = tuple(self.counts)
        if len(counts) != 3 or not all(isinstance(n, int) and not isinstance(n, bool) and n > 0 for n in counts):
            raise InputError(f"counts of a grid must be three integers above 0, not {self.counts!r}")
        object.__setattr__(self, "counts", counts)
        object.__setattr__(self, "step", tuple(finite("step of a grid", self.step, (3,)).tolist()))
        object.__setattr__(self, "shared", replace(self.shared, picks=(), problems=()))
        object.__setattr__(self, "with_object", frozenset([self.first.carried is not None]))

    def __len__(self) -> int:
        return prod(self.counts)

    def part(self, start: int, stop: int) -> Iterable[Pick | PickProblem]:
        """The picks from index ``start`` to ``stop`` (exclusive)."""
        return _Part(_grid_picks, (self.first, self.counts, self.step, range(start, min(stop, len(self)))))

    def digest(self) -> str:
        """A hash of all picks."""
        return digest((self.first, self.counts, self.step))


def _grid_picks(
    first: Pick, counts: tuple[int, int, int], step: tuple[float, float, float], numbers: range
) -> Iterator[Pick]:
    for number in numbers:
        index = np.array(np.unravel_index(number, counts))
        name = "_".join([first.name, *map(str, index)])
        yield replace(first, name=name, pose=translated(first.pose, index * step))


# -- tables -----------------------------------------------------------------------------------------------------------

TABLE_SUFFIX = ".csv"

LONGEST_LINE = 2**20
"""Bytes: limits the memory for a file without line feeds."""

SEPARATOR = ";"
"""Between the names in a cell that holds several."""


class _Columns:
    """The columns of a table, and what its lines state."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names
        if other := other_separator(names):
            raise InputError(other)
        known = [name for group in COLUMNS.values() for name in group]
        for name in names:
            if name not in known:
                raise UnknownNameError("column", name, known)
        if len(set(names)) < len(names):
            raise InputError("states a column twice")
        # For each stated key the indices of its cells
        self.places: dict[str, list[int]] = {}
        for key, group in COLUMNS.items():
            there = [name for name in group if name in names]
            if there and len(there) < len(group):
                missing = next(name for name in group if name not in names)
                raise InputError(f"lacks the column {missing} beside {there[0]}")
            if there:
                self.places[key] = [names.index(name) for name in group]

    def cell(self, key: str, cells: list[str] | None) -> str:
        """The text of the first cell of a key; empty if it is not stated."""
        place = self.places.get(key, [-1])[0]
        return cells[place].strip() if cells is not None and 0 <= place < len(cells) else ""

    def name(self, cells: list[str] | None, number: int) -> str:
        """The name of a row."""
        return self.cell("name", cells) or f"row_{number}"

    def row(self, cells: list[str]) -> dict[str, Any]:
        """The settings of a row by key, as in a picks file."""
        if len(cells) != len(self.names):
            more = "; decimals have a point, not a comma" if len(cells) > len(self.names) else ""
            raise InputError(f"has {len(cells)} cells under {len(self.names)} columns{more}")
        row: dict[str, Any] = {}
        for key, places in self.places.items():
            values: list[Any] = [cells[place].strip() for place in places]
            if key == "name" or not any(values):
                continue
            if not all(values):
                raise InputError(f"states only some of {', '.join(COLUMNS[key])}")
            *outer, own = key.split(".")
            if own == "support" and SEPARATOR in values[0]:
                values = [[name.strip() for name in values[0].split(SEPARATOR)]]
            holder = row
            for into in outer:
                holder = holder.setdefault(into, {})
            holder[own] = values if len(values) > 1 else values[0]
        return row


class PickTable(PickSource):
    """The picks of a CSV file; 16 bytes per row are held in memory.

    Parameters
    ----------
    path
        The file.
    shared
        The settings that the picks share.
    defaults
        Defaults by key, as in a picks file.

    Raises
    ------
    PicksError
        If the file cannot be read, its header is invalid, or it has no rows.
    """

    def __init__(self, path: str | Path, *, shared: Picks | None = None, defaults: Mapping[str, Any] | None = None):
        self.path = Path(path)
        named = Picks((), source=self.path) if shared is None else shared
        self.shared = replace(named, picks=(), problems=())
        self._defaults = dict(defaults or {})
        # An index of the lines, with the hash of each name
        content = blake2b(digest_size=16)
        with_object: set[bool] = set()
        self._begin, names = array("q"), array("Q")
        refuse_unreadable(self.path, PicksError, largest=None)
        with os_errors(self.path, "cannot be read", PicksError), self.path.open("rb") as file:
            # The stamp shows later whether the file has changed
            self._stamp = _stamp(file)
            self._columns, begin = self._header(file, content)
            if "arm" in self._columns.names and not self.shared.robots:
                reason = "has the column arm but states no robots; a picks file with robots can name it"
                raise PicksError(self.path, reason)
            for line in self._lines(file):
                content.update(line)
                if _is_row(line):
                    cells = _cells(line)
                    self._begin.append(begin)
                    with_object.add("object" in self._defaults or bool(self._columns.cell("object", cells)))
                    name = self._columns.name(cells, len(self._begin)).encode("utf-8", "backslashreplace")
                    names.append(int.from_bytes(blake2b(name, digest_size=8).digest(), "big"))
                begin += len(line)
        if not self._begin:
            raise PicksError(self.path, "contains no picks")
        self._begin.append(begin)
        self.with_object = frozenset(with_object)
        self._digest = f"{content.hexdigest()} {digest(self._defaults)}"

        # The picks whose name an earlier pick has; equal hashes may be those of different names
        hashes = np.frombuffer(names, dtype=np.uint64)
        order = np.argsort(hashes, kind="stable")
        same = np.flatnonzero(hashes[order[1:]] == hashes[order[:-1]])
        first: dict[str, int] = {}
        repeated = set()
        for place in np.unique(np.concatenate([order[same], order[same + 1]])).tolist():
            with self.path.open("rb") as file:
                file.seek(self._begin[place])
                name_of = self._columns.name(_cells(file.readline()), place + 1)
            if first.setdefault(name_of, place) != place:
                repeated.add(place)
        self._repeated = frozenset(repeated)

    def __len__(self) -> int:
        return len(self._begin) - 1

    def digest(self) -> str:
        """A hash of all picks."""
        return digest(self._digest)

    def part(self, start: int, stop: int) -> Iterable[Pick | PickProblem]:
        """The picks from index ``start`` to ``stop`` (exclusive).

        Raises
        ------
        PicksError
            If the file has changed since it was opened.
        """
        stop = min(stop, len(self))
        with os_errors(self.path, "cannot be read", PicksError), self.path.open("rb") as file:
            if _stamp(file) != self._stamp:
                raise PicksError(self.path, "was changed while its picks were being judged")
            file.seek(self._begin[start])
            text = file.read(self._begin[stop] - self._begin[start])
        repeated = frozenset(index for index in self._repeated if start <= index < stop)
        return _Part(_table_picks, (self.path, self._columns, self._defaults, text, start, repeated))

    def _header(self, file: Any, content: Any) -> tuple[_Columns, int]:
        """The columns, and the offset of the line after them."""
        offset = 0
        for number, line in enumerate(self._lines(file), start=1):
            content.update(line)
            offset += len(line)
            if not _is_row(line):
                continue
            try:
                if line.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
                    raise InputError("is UTF-16 text; save it as UTF-8")
                cells = next(csv.reader([line.decode("utf-8-sig")], strict=True))
                return _Columns(tuple(cell.strip() for cell in cells)), offset
            except (UnicodeDecodeError, csv.Error, InputError) as error:
                raise PicksError(self.path, str(error), f"line {number}") from error
        raise PicksError(self.path, "is empty; its first line names the columns, such as name,x,y,z,roll,pitch,yaw")

    def _lines(self, file: Any) -> Iterator[bytes]:
        while line := file.readline(LONGEST_LINE):
            if len(line) == LONGEST_LINE and not line.endswith(b"\n"):
                raise PicksError(self.path, f"has a line of more than {LONGEST_LINE} bytes; this is not a table")
            yield line


def _table_picks(
    path: Path, columns: _Columns, defaults: Mapping[str, Any], text: bytes, start: int, repeated: frozenset[int]
) -> Iterator[Pick | PickProblem]:
    lines = (line for line in text.split(b"\n") if _is_row(line))  # the same splitting as in the index
    for place, line in enumerate(lines, start=start):
        cells = _cells(line)
        name = columns.name(cells, place + 1)
        try:
            if cells is None:
                raise InputError("is not a valid line of a UTF-8 CSV file")
            if place in repeated:
                raise InputError(f"a second pick is named {name!r}")
            yield from picks_of_row({**columns.row(cells), "name": name}, defaults, path)
        except InputError as error:
            yield PickProblem(place + 1, name, str(error))


def _cells(line: bytes) -> list[str] | None:
    """The cells of a line; None if it is not valid CSV."""
    try:
        return next(csv.reader([line.decode().rstrip("\r\n")], strict=True))
    except (UnicodeDecodeError, csv.Error, StopIteration):
        return None


def _is_row(line: bytes) -> bool:
    text = line.strip()
    return bool(text) and not text.startswith(b"#")


def _stamp(file: Any) -> tuple[int, int]:
    """Size and time of the last change, by which a file that was changed is recognised."""
    found = os.fstat(file.fileno())
    return found.st_size, found.st_mtime_ns


# -- files ------------------------------------------------------------------------------------------------------------

SUFFIXES = (*YAML_SUFFIXES, ".json", TABLE_SUFFIX)

PICKS = st.Table(
    "picks",
    "A picks file: the picks, and the robot, scene and gripper that they share. Files that it names are relative to "
    "its folder.",
    *(key for key in SETTINGS.keys if key.name != "frames"),
    st.Key(
        "robots",
        st.mapping_to(CELL_ROBOT),
        "several robots by name: all poses are then in the frame `world`, and links and joints have the prefix "
        "`NAME/` in the scene",
        "",
        {},
    ),
    *(key for key in SETTINGS.keys if key.name == "frames"),
    st.Key("defaults", DEFAULTS, "keys of picks that apply where a pick does not state them", "", {}),
    st.required(
        "picks",
        st.any_of(
            st.list_of(PICK, 1),
            st.simple({"title": "name of a table (`.csv`)", "type": "string", "pattern": r"[^/.]\.[cC][sS][vV]$"}),
        ),
        "the picks, or a table of them in a CSV file",
    ),
)


def read_picks(path: str | Path) -> Picks:
    """Read a complete picks file; see :func:`open_picks`.

    Returns
    -------
    Picks
        The picks; ``problems`` lists the rows that could not be read.

    Raises
    ------
    PicksError
        If the file or its shared settings are invalid; the message names file, line and key.
    """
    return open_picks(path).load()


def open_picks(path: str | Path) -> PickSource:
    """Open a picks file as a source; the rows of a table are not held in memory.

    Parameters
    ----------
    path
        The file: YAML or JSON with the keys of :data:`~pinproof.picks.input.sources.PICKS`, or a table (CSV) with
        the columns of :data:`~pinproof.picks.input.sources.COLUMNS`.

    Raises
    ------
    PicksError
        If the file or its shared settings are invalid; the message names file, line and key.
    """
    path = Path(path)
    if path.suffix.lower() == TABLE_SUFFIX:
        return PickTable(path)
    # The settings and defaults, in which errors are not those of one row
    content = read_yaml(path, PICKS.names, PicksError, suffixes=SUFFIXES)
    with st.errors_of(path, PicksError):
        PICKS.refuse_unknown(content)
        rows = content.get("picks", [])
        table = isinstance(rows, str) and Path(rows).suffix.lower() == TABLE_SUFFIX
        if not table and not isinstance(rows, list):
            raise st.Misread(f"is {rows!r}, not a list of picks", (".picks",), st.position(content, "picks"))
        if not rows:
            raise InputError("contains no picks; add a list under 'picks:'")

        def readable(stated: Any) -> Mapping[str, Any]:
            """The defaults, which are read as those of a pick, because an error in them would recur in every row."""
            if not isinstance(stated, dict):
                raise InputError(f"holds {stated!r}, not a mapping; valid keys: {', '.join(DEFAULTS.names)}")
            DEFAULTS.refuse_unknown(stated)
            turned = {} if {"rpy", "quat_xyzw"} & stated.keys() else {"rpy": [0, 0, 0]}
            posed = {"part": "any"} if {"part", "grasp"} & stated.keys() else {"xyz": [0, 0, 0], **turned}
            example = {"name": "defaults", "object": "any", **posed}
            picks_of_row(completed(example, stated), {}, path, incomplete=True)
            return stated

        defaults = st.step(".defaults", st.position(content, "defaults"), readable, content.get("defaults", {}))
        shared = read_settings(content, path)
    if table:
        return PickTable(path.parent / rows, shared=shared, defaults=defaults)
    return _list(path, rows, shared, defaults)


def _list(path: Path, rows: list[Any], shared: Picks, defaults: Mapping[str, Any]) -> PickList:
    picks: list[Pick] = []
    problems: list[PickProblem] = []
    taken: set[str] = set()
    for number, row in enumerate(rows, start=1):
        name = row.get("name") if isinstance(row, dict) else None
        try:
            made = picks_of_row(row, defaults, path)
            if doubled := next((pick.name for pick in made if pick.name in taken), ""):
                raise InputError(f"a second pick is named {doubled!r}")
            for pick in made:
                if pick.arm is not None and not shared.robots:
                    raise InputError(f"states the arm {pick.arm!r}, but the file has no robots")
                if pick.arm is not None and pick.arm not in shared.robots:
                    raise UnknownNameError("arm", pick.arm, shared.robots, "the robots of the file")
                # One of the arms has a grasp and a tool for it
                arms = [robot.settings for arm, robot in shared.robots.items() if pick.arm in (None, arm)] or [shared]
                for own in arms:
                    try:
                        own.grasps_of(pick)
                        break
                    except InputError:
                        if own is arms[-1]:
                            raise
            taken.update(pick.name for pick in made)
            picks += made
        except (InputError, FileError) as error:
            where = st.position(row)
            if isinstance(error, st.Misread) and not error.position:  # what fits no tool is known after the row is read
                key = str(error.steps[0]).removeprefix(".") if error.steps else ""
                where = st.position(row, key) if key in row else where
                error = st.Misread(error.reason, error.steps, where)
            reason = error.reason if isinstance(error, FileError) else str(error)
            reason = f"{where}: {reason}" if where and not isinstance(error, st.Misread) else reason
            problems.append(PickProblem(number, str(name or f"row {number}"), reason))
    return PickList(replace(shared, picks=tuple(picks), problems=tuple(problems)))
