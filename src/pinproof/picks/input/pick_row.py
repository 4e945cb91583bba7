"""One row of a picks file or table, completed with the defaults, as one or several picks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from pinproof.collision import Obstacle
from pinproof.collision.scenes.scene_file import numbers_of, pose_of, read_obstacle
from pinproof.collision.scenes.scene_keys import POSE
from pinproof.common.file_keys import KeyTable
from pinproof.common.validation import require_integer
from pinproof.common.yaml_file import LinedMapping
from pinproof.errors import FileError, InputError, UnknownNameError
from pinproof.model import Payload
from pinproof.picks.input.pick import (
    MOVES,
    OBJECT,
    PARTS,
    STEPS,
    GraspSpin,
    GraspTolerance,
    Pick,
    PlaceTarget,
    ToolSpeed,
    support_names,
)
from pinproof.picks.input.picks_keys import (
    GRID,
    OBJECT_PAYLOAD,
    PATTERN,
    PLACE,
    SPEED,
    SPIN_RANGE,
    STAGE_SPEEDS,
    TOLERANCE,
)
from pinproof.spatial import finite, translated
from pinproof.units import ANGLE_UNITS, parse_angle, refuse_degrees, refuse_millimetres

MOVE_KEYS = tuple(f"{move}{part}" for move in MOVES for part in ("", "_direction", "_frame"))

LARGEST_PATTERN = 100_000
"""Largest number of picks of one row; :class:`pinproof.picks.PickGrid` generates more on demand."""


def picks_of_row(name: str, row: Mapping[str, Any], defaults: Mapping[str, Any], path: Path) -> list[Pick]:
    """The pick of a row, or the picks of its pattern.

    Raises
    ------
    InputError
        If the row is invalid; the message states the reason.
    """
    # The orientation of the row replaces that of the defaults, in either notation; two in one row are refused.
    given = {key: value for key, value in defaults.items() if not (is_turned(row) and key in ("rpy", "quat_xyzw"))}
    stated = {**given, **row}
    if "xyz" not in stated:
        raise InputError("does not state its xyz")
    if not is_turned(stated):
        raise InputError("states no orientation; add rpy or quat_xyzw to the pick or to the defaults")
    if "pattern" not in stated:
        return [make_pick(name, stated, path)]
    first = make_pick(name, stated, path)
    return [_shifted(first, index, shift) for index, shift in _pattern(stated["pattern"])]


def is_turned(stated: Mapping[str, Any]) -> bool:
    """Whether an orientation is stated."""
    return "rpy" in stated or "quat_xyzw" in stated


def make_pick(name: str, stated: Mapping[str, Any], path: Path) -> Pick:
    """The pick that is stated with the keys of ``DEFAULTS``; mesh paths are relative to the file at ``path``."""
    read: dict[str, Callable[[Any], Any]] = {
        "spin": _spin,
        "tolerance": _tolerance,
        "object": lambda value: _object(value, path),
        "support": _support,
        "place": _place,
        "upright": _upright,
        "upright_axis": lambda value: tuple(finite("upright_axis", numbers_of("upright_axis", value), (3,)).tolist()),
        "payload": lambda value: payload_of("payload", value, OBJECT_PAYLOAD),
        "speed": _speed,
        "arm": lambda value: text_of(value, "arm"),
    }
    settings = {("carried" if key == "object" else key): read[key](stated[key]) for key in read if key in stated}
    return Pick(name, **_moves(stated), **settings)


def text_of(stated: object, key: str = "") -> str:
    """Check that a value is a text that is not empty, and return it."""
    if not isinstance(stated, str) or not stated:
        raise InputError(f"{f'{key}: ' if key else ''}{stated!r} is not a name")
    return stated


def mapping_of(key: str, stated: object, table: KeyTable) -> dict[str, Any]:
    """Check that a value is a mapping with known keys and all required ones, and return a copy."""
    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping of {', '.join(table.names)}")
    for each in stated:
        if each not in table.names:
            raise UnknownNameError(f"key of {key}" if key else "key", each, table.names)
    if missing := [each for each in table.required if each not in stated]:
        raise InputError(f"{f'{key} ' if key else ''}does not state {' and '.join(missing)}")
    return dict(stated)


def _moves(stated: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that picks and places share: pose, frame, approach and retreat."""
    settings: dict[str, Any] = {}
    for key in (*POSE.names, "frame", *MOVE_KEYS):
        if key in stated:
            settings[key] = text_of(stated[key], key) if key.endswith("frame") else numbers_of(key, stated[key])
    placed = pose_of({key: settings.pop(key) for key in POSE.names if key in settings})
    refuse_millimetres("xyz", placed.translation.tolist())
    return {"pose": placed, **settings}


def _spin(stated: object) -> GraspSpin:
    """``free``, one angle, a list of angles, or ``{range: [first, last], steps: n}``."""
    if stated == "free":
        return GraspSpin.free()
    if isinstance(stated, dict):
        settings = mapping_of("spin", stated, SPIN_RANGE)
        first, last = finite("spin.range", numbers_of("spin.range", settings["range"]), (2,)).tolist()
        refuse_degrees("spin.range", (first, last))
        require_integer("spin.steps", steps := settings.get("steps", STEPS), 1)
        return GraspSpin.between(first, last, steps)
    try:
        angles = numbers_of("spin", stated)
    except InputError as error:
        raise InputError(f"{error}; or write spin: free") from error
    angles = angles if isinstance(angles, list) else [angles]
    refuse_degrees("spin", angles)
    return GraspSpin(tuple(angles))


def _upright(stated: object) -> float:
    """An angle: ``5 deg``, ``0.1 rad``, or a number in radians."""
    if isinstance(stated, list):
        raise InputError(f"upright is {stated!r}; it must be an angle, such as 5 deg")
    if not isinstance(stated, str) or not stated.strip().endswith(tuple(ANGLE_UNITS)):
        return float(numbers_of("upright", stated))
    try:
        return parse_angle(stated)
    except ValueError as error:
        raise InputError(f"upright: {error}") from None


def _tolerance(stated: object) -> GraspTolerance:
    settings = mapping_of("tolerance", stated, TOLERANCE)
    return GraspTolerance(**{key: numbers_of(f"tolerance.{key}", value) for key, value in settings.items()})


def _object(stated: object, path: Path) -> Obstacle | str:
    """The name of an obstacle, or a shape with its pose in the tip's frame."""
    if not isinstance(stated, dict):
        return text_of(stated, "object")
    named = LinedMapping({"name": "object", **stated})
    named.line = getattr(stated, "line", 0)
    try:
        return read_obstacle(path, 1, named)
    except FileError as error:
        raise InputError(f"object: {error.reason}") from error


def _place(stated: object) -> PlaceTarget:
    settings = mapping_of("place", stated, PLACE)
    support = _support(settings.pop("support"), "place") if "support" in settings else None
    tip = [key for key in POSE.names if key in settings]
    if "object_pose" not in settings:
        if "xyz" not in tip or len(tip) < 2:
            raise InputError("place does not state its xyz and rpy or quat_xyzw, or its object_pose")
        return PlaceTarget(**_moves(settings), support=support)
    if tip:
        raise InputError(
            f"place states {' and '.join(tip)} of the tip, and object_pose; only one or the other is possible"
        )
    final = mapping_of("place.object_pose", settings.pop("object_pose"), POSE)
    return PlaceTarget(**_moves({**settings, **final}), support=support, pose_of=OBJECT)


def payload_of(key: str, stated: object, table: KeyTable) -> Payload:
    """The mass that a mapping states with the keys of a table."""
    settings = mapping_of(key, stated, table)
    frame, inertia = settings.get("frame"), settings.get("inertia")
    return Payload(
        numbers_of(f"{key}.mass".lstrip("."), settings["mass"]),
        numbers_of(f"{key}.center_of_mass", settings.get("center_of_mass", [0.0, 0.0, 0.0])),
        None if inertia is None else numbers_of(f"{key}.inertia", inertia),
        None if frame is None else text_of(frame, f"{key}.frame"),
    )


def _speed(stated: object) -> dict[str, ToolSpeed]:
    """One linear speed for all parts of the motion, or the limits by part."""
    if not isinstance(stated, dict):
        return dict.fromkeys(PARTS, ToolSpeed(linear_speed=numbers_of("speed", stated)))
    found = {}
    for part, value in mapping_of("speed", stated, STAGE_SPEEDS).items():
        limits = mapping_of(f"speed.{part}", value, SPEED) if isinstance(value, dict) else {"linear_speed": value}
        found[part] = ToolSpeed(**{name: numbers_of(f"speed.{part}.{name}", each) for name, each in limits.items()})
    return found


def _support(stated: object, of: str = "") -> tuple[str, ...] | None:
    """One name or several; an empty value is not a name."""
    return support_names("" if stated is None else stated, of)


def _pattern(stated: object) -> Iterator[tuple[tuple[int, ...], list[float]]]:
    """The indices of a grid and the offset (m) of each from the first, along the axes of the pick's frame."""
    grid = mapping_of("pattern.grid", mapping_of("pattern", stated, PATTERN)["grid"], GRID)
    counts = grid["counts"]
    if not isinstance(counts, list) or len(counts) != 3:
        raise InputError(f"pattern.grid.counts is {counts!r}; it must have three numbers")
    for count in counts:
        require_integer("pattern.grid.counts", count, 1)
    step = finite("pattern.grid.step", numbers_of("pattern.grid.step", grid["step"]), (3,)).tolist()
    if prod(counts) > LARGEST_PATTERN:  # math.prod, because that of NumPy overflows
        raise InputError(f"pattern.grid has {prod(counts)} picks; at most {LARGEST_PATTERN} are allowed")
    for index in product(*map(range, counts)):
        yield index if counts[2] > 1 else index[:2], [k * d for k, d in zip(index, step, strict=True)]


def _shifted(first: Pick, index: tuple[int, ...], shift: list[float]) -> Pick:
    """One pick of a pattern; ``{i} {j} {k}`` in the name of the object are replaced by its indices."""
    carried = first.carried
    if isinstance(carried, str):
        for letter, place in zip("ijk", index, strict=False):
            carried = carried.replace(f"{{{letter}}}", str(place))
    name = f"{first.name}[{','.join(map(str, index))}]"
    return replace(first, name=name, pose=translated(first.pose, shift), carried=carried)
