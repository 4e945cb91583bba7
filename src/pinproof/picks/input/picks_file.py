"""Picks files in YAML or JSON, and tables of picks in CSV.

The keys are in :mod:`pinproof.picks.input.picks_keys`, and docs/formats/picks.md describes them with an example. An
invalid row is reported as a problem and the others are kept; invalid shared settings are an error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from pinproof.collision import Mesh, Obstacle
from pinproof.collision.scenes.scene_file import numbers_of, pose_of, read_obstacle
from pinproof.collision.scenes.scene_keys import POSE
from pinproof.common.files import is_file
from pinproof.common.validation import require_integer
from pinproof.common.yaml_file import YAML_SUFFIXES, LinedMapping, read_yaml, refuse_unknown, require_list
from pinproof.description.meshes import COLOURED_SUFFIXES
from pinproof.errors import FileError, InputError, PicksError, UnknownNameError
from pinproof.model import Payload
from pinproof.picks.input.conveyor import Conveyor
from pinproof.picks.input.pick import CellRobot, GripperFingers, NamedFrame, Pick, PickProblem, Picks, SuctionCup
from pinproof.picks.input.pick_row import is_turned, make_pick, mapping_of, payload_of, picks_of_row
from pinproof.picks.input.picks_keys import (
    CELL_ROBOT,
    CONVEYOR,
    CUP,
    DEFAULTS,
    FINGERS,
    FRAME,
    GRIP_LIMITS,
    HELD,
    PAYLOAD,
    PICK,
    PICKS,
)
from pinproof.picks.input.settings import GripLimits
from pinproof.picks.input.sources import TABLE_SUFFIX, PickList, PickSource, PickTable
from pinproof.spatial import SE3, finite
from pinproof.units import MOST_MARGIN, MOST_REACH, refuse_millimetres, warn_of_millimetres

Value = TypeVar("Value")

SUFFIXES = (*YAML_SUFFIXES, ".json", TABLE_SUFFIX)


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
        The file: YAML or JSON with the keys of :data:`~pinproof.picks.input.picks_keys.PICKS`, or a table (CSV) with
        the columns of :data:`~pinproof.picks.input.picks_keys.COLUMNS`.

    Raises
    ------
    PicksError
        If the file or its shared settings are invalid; the message names file, line and key.
    """
    path = Path(path)
    if path.suffix.lower() == TABLE_SUFFIX:
        return PickTable(path)
    content = read_yaml(path, PICKS.names, PicksError, suffixes=SUFFIXES)
    refuse_unknown(PicksError, path, "key", content, PICKS.names, "")
    stated = content.get("picks", [])
    table = isinstance(stated, str) and Path(stated).suffix.lower() == TABLE_SUFFIX
    rows = [] if table else require_list(PicksError, path, "picks", stated)
    if not rows and not table:
        raise PicksError(path, "contains no picks; add a list under 'picks:'")
    defaults = _shared(path, content, "defaults", {}, lambda stated: _defaults(stated, path))
    shared = Picks(
        (),
        **_robot_settings(path, content),
        conveyor=_shared(path, content, "conveyor", None, _conveyor),
        grip_limits=_shared(path, content, "grip_limits", {}, _grip_limits),
        optimise=_shared(path, content, "optimise", None, _evaluations),
        straight=_shared(path, content, "straight", Picks.straight, _straight),
        frames=_shared(path, content, "frames", {}, _frames),
        margin=_shared(path, content, "margin", 0.0, _margin),
        torque_limits=_shared(path, content, "torque_limits", False, _torque_limits),
        scene=path.parent / scene if (scene := _text(path, content, "scene")) else None,
        source=path,
        places=_places(content),
    )
    shared = replace(shared, robots=_robots(path, content, shared))
    return (
        PickTable(path.parent / stated, shared=shared, defaults=defaults)
        if table
        else _list(path, rows, shared, defaults)
    )


def _robot_settings(path: Path, content: LinedMapping) -> dict[str, Any]:
    """The settings of a robot and its hand, which a file for several robots may state for each of them."""
    return {
        "tip": _shared(path, content, "tip", {}, lambda stated: _tip(stated, MOST_TOOL)),
        "tool": _bodies(path, content, "tool"),
        "fingers": _fingers(path, content),
        "cup": _shared(path, content, "cup", None, _cup),
        "gripper": tuple(_names(path, content, "gripper")),
        "held": _shared(path, content, "held", {}, lambda stated: _held(stated, "open")),
        "grip": _shared(path, content, "held", {}, lambda stated: _held(stated, "grip")),
        "payload": _shared(path, content, "payload", [], _payloads),
        "robot": _robot(path, content),
        "srdf": _file(path, content, "srdf"),
        "package_dirs": _folders(path, content),
        "xacro_args": _xacro_args(path, content),
        "limits": _file(path, content, "limits"),
        "tcp": _text(path, content, "tcp"),
        "home": _shared(path, content, "home", {}, _home),
    }


KEY_OF = {"grip": "held"}
"""The keys of settings that have another name than their key."""


def _robots(path: Path, content: LinedMapping, shared: Picks) -> dict[str, CellRobot]:
    """The robots of a cell. What one does not state is that of the file."""
    stated = content.get("robots", {})
    if not isinstance(stated, LinedMapping):
        if stated == {}:
            return {}
        raise PicksError(path, f"holds {stated!r}, not a mapping of names to robots", content.place("robots"))
    found = {}
    for name, each in stated.items():
        place = stated.place(name, "robot")
        if not isinstance(each, LinedMapping):
            raise PicksError(path, f"holds {each!r}, not a mapping; valid keys: {', '.join(CELL_ROBOT.names)}", place)
        refuse_unknown(PicksError, path, f"key of robot {name!r}", each, CELL_ROBOT.names, "")
        if "base" not in each:
            raise PicksError(path, "states no base, the pose of the robot in the cell", place)
        base = _shared(path, each, "base", {}, _tip)
        own = {key: value for key, value in _robot_settings(path, each).items() if KEY_OF.get(key, key) in each}
        places = {**shared.places, **_places(each)}
        try:
            found[str(name)] = CellRobot(base, replace(shared, **own, places=places))
        except InputError as error:
            raise PicksError(path, str(error), place) from error
    return found


def _list(path: Path, rows: list[Any], shared: Picks, defaults: dict[str, Any]) -> PickList:
    picks: list[Pick] = []
    problems: list[PickProblem] = []
    taken: set[str] = set()
    for number, row in enumerate(rows, start=1):
        name = row.get("name") if isinstance(row, dict) else None
        try:
            picks += _of_robots(_picks(path, row, defaults, taken), shared)
        except (InputError, FileError) as error:
            where = f"line {row.line}: " if isinstance(row, LinedMapping) else ""
            reason = error.reason if isinstance(error, FileError) else str(error)
            problems.append(PickProblem(number, str(name or f"row {number}"), where + reason))
    return PickList(replace(shared, picks=tuple(picks), problems=tuple(problems)))


def _shared(path: Path, content: LinedMapping, key: str, default: object, read: Callable[[Any], Value]) -> Value:
    """Read the shared setting ``key``; an error names the key, and the line if it is known."""
    stated = content.get(key, default)
    try:
        return read(stated)
    except InputError as error:
        raise PicksError(path, str(error), content.place(key)) from error


def _places(content: LinedMapping) -> dict[str, str]:
    """The positions of the names that are looked up when the robot is loaded."""
    found = {key: content.place(key) for key in ("robot", "tcp") if key in content}
    for key in ("xacro_args", "held"):
        inner = content.get(key)
        if isinstance(inner, LinedMapping):
            found.update({f"{key}.{name}": inner.place(name, f"key {key},") for name in inner})
    return found


def _defaults(stated: object, path: Path) -> dict[str, Any]:
    """The defaults, validated with a pick made from them, because an error would recur in every row."""
    settings = dict(mapping_of("", stated, DEFAULTS))
    turned = {} if is_turned(settings) else {"rpy": [0, 0, 0]}
    make_pick("defaults", {"xyz": [0, 0, 0], "object": "any", **turned, **settings}, path)
    return settings


def _picks(path: Path, row: object, defaults: dict[str, Any], taken: set[str]) -> list[Pick]:
    """The picks of a row; their names are added to ``taken``."""
    if not isinstance(row, LinedMapping):
        raise InputError(f"{row!r} is not a pick; valid keys: {', '.join(PICK.names)}")
    refuse_unknown(PicksError, path, "key", row, PICK.names, "")
    name = row.get("name")
    if name is None:
        raise InputError("states no name; a pick needs a name")
    if not isinstance(name, str) or not name:
        raise InputError(f"has the name {name!r}; a pick needs a name (text, in quotes if it is a number)")
    made = picks_of_row(name, row, defaults, path)
    if doubled := next((pick.name for pick in made if pick.name in taken), ""):
        raise InputError(f"a second pick is named {doubled!r}")
    taken.update(pick.name for pick in made)
    return made


def _of_robots(picks: list[Pick], shared: Picks) -> list[Pick]:
    """The picks, if the arms that they name exist."""
    for pick in picks:
        if pick.arm is not None and not shared.robots:
            raise InputError(f"states the arm {pick.arm!r}, but the file has no robots")
        if pick.arm is not None and pick.arm not in shared.robots:
            raise UnknownNameError("arm", pick.arm, shared.robots, "the robots of the file")
    return picks


def _frames(stated: object) -> dict[str, NamedFrame]:
    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping of names to frames")
    found = {}
    for name, frame in stated.items():
        settings = dict(mapping_of(str(name), frame, FRAME))
        parent = settings.pop("frame", "")
        if not isinstance(parent, str):
            raise InputError(f"{name}: its frame {parent!r} is not a name")
        found[str(name)] = NamedFrame(_tip(settings), parent)
    return found


def _fingers(path: Path, content: LinedMapping) -> GripperFingers | None:
    if "fingers" not in content:
        return None
    settings = _shared(path, content, "fingers", {}, lambda stated: mapping_of("", stated, FINGERS))
    bodies = _bodies(path, settings, "bodies")
    numbers = {key: value for key, value in settings.items() if key != "bodies"}

    def made(_: object) -> GripperFingers:
        return GripperFingers(bodies, **{key: numbers_of(key, value) for key, value in numbers.items()})  # type: ignore[arg-type]

    return _shared(path, content, "fingers", {}, made)


def _names(path: Path, content: LinedMapping, key: str) -> list[str]:
    names = require_list(PicksError, path, key, content.get(key, []))
    for name in names:
        if not isinstance(name, str):
            raise PicksError(path, f"{name!r} is not a name", f"key {key}")
    return names


def _cup(stated: object) -> SuctionCup | None:
    if stated is None:
        return None
    settings = mapping_of("", stated, CUP)
    return SuctionCup(**{key: _number(key, value) for key, value in settings.items()})


def _conveyor(stated: object) -> Conveyor | None:
    if stated is None:
        return None
    settings = dict(mapping_of("", stated, CONVEYOR))
    parts = settings.pop("parts")
    names = tuple(parts) if isinstance(parts, list) else parts
    return Conveyor(parts=names, **{key: numbers_of(key, value) for key, value in settings.items()})


def _grip_limits(stated: object) -> GripLimits:
    settings = mapping_of("", stated, GRIP_LIMITS)
    return GripLimits(**{key: _number(key, value) for key, value in settings.items()})


def _tip(stated: object, most: float = MOST_REACH) -> SE3:
    tip = pose_of(mapping_of("", stated, POSE))
    refuse_millimetres("xyz", tip.translation.tolist(), most=most)
    return tip


def _evaluations(stated: Any) -> int | None:
    if stated is None:
        return None
    require_integer("optimise", stated, 0)
    return int(stated)


def _straight(stated: object) -> float:
    share = _number("straight", stated)
    if not 0.0 < share <= 1.0:
        raise InputError(f"straight = {share:g}; it is a share of each line, above 0 and at most 1")
    return share


MOST_TOOL = 5.0
"""Metres. A longer tool is stated in millimetres."""

TOOL_GREY = (0.30, 0.32, 0.36, 1.0)
"""The colour of tools and fingers without ``rgba``, so that they differ from obstacles in pictures."""


def _bodies(path: Path, content: Mapping[str, Any], key: str) -> tuple[Obstacle, ...]:
    bodies = []
    for number, stated in enumerate(require_list(PicksError, path, key, content.get(key, [])), start=1):
        if not isinstance(stated, LinedMapping):
            raise PicksError(path, f"{stated!r} is not a body", f"key {key}, #{number}")
        try:
            body = read_obstacle(path, number, stated)
        except FileError as error:
            raise PicksError(path, error.reason, error.place) from error
        own_colours = isinstance(body.shape, Mesh) and str(body.shape.path).lower().endswith(COLOURED_SUFFIXES)
        bodies.append(body if body.rgba or own_colours else replace(body, rgba=TOOL_GREY))
        if any(bodies[-1].name == other.name for other in bodies[:-1]):
            raise PicksError(
                path, f"a second body is named {bodies[-1].name!r}", f"line {stated.line}, key {key}, #{number}"
            )
    return tuple(bodies)


def _payloads(stated: object) -> tuple[Payload, ...]:
    return tuple(payload_of("", each, PAYLOAD) for each in (stated if isinstance(stated, list) else [stated]))


def _torque_limits(stated: object) -> bool:
    if not isinstance(stated, bool):
        raise InputError(f"is {stated!r}; it must be true or false")
    return stated


def _margin(stated: object) -> float:
    margin = _number("margin", stated)
    if margin < 0:
        raise InputError(f"is {margin} m; it must be 0 or more")
    warn_of_millimetres("margin", [margin], most=MOST_MARGIN)
    return margin


def _home(stated: object) -> dict[str, float]:
    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping of joint names to values")
    return {str(name): _number(str(name), value) for name, value in stated.items()}


def _held(stated: object, when: str) -> dict[str, float]:
    """The joint values of the open or of the gripping hand; for the latter only joints that state one."""
    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping of joint names to values, or to {' and '.join(HELD.names)}")
    found: dict[str, float] = {}
    for name, value in stated.items():
        if isinstance(value, dict):
            values = mapping_of(str(name), value, HELD)
            found[str(name)] = _number(f"{name}.{when}", values[when])
        elif when == "open":
            found[str(name)] = _number(str(name), value)
    return found


def _number(name: str, stated: object) -> float:
    return float(finite(name, [numbers_of(name, stated)], (1,))[0])


def _robot(path: Path, content: LinedMapping) -> str | None:
    """A catalogue name, or a path relative to the picks file."""
    name = _text(path, content, "robot")
    if name is None or not (Path(name).suffix or "/" in name):
        return name
    return str(path.parent / name)


def _file(path: Path, content: LinedMapping, key: str) -> Path | None:
    """An existing file, relative to the picks file."""
    name = _text(path, content, key)
    if name is None:
        return None
    if not is_file(path.parent / name):
        raise PicksError(
            path, f"there is no file {path.parent / name}; paths are relative to this file", content.place(key)
        )
    return path.parent / name


def _folders(path: Path, content: LinedMapping) -> tuple[Path, ...]:
    """The package folders, relative to the picks file."""
    stated = content.get("package_dirs", [])
    names = [stated] if isinstance(stated, str) else stated
    place = content.place("package_dirs")
    if not isinstance(names, list) or not all(isinstance(name, str) and name for name in names):
        raise PicksError(path, f"holds {stated!r}, not a list of folders", place)
    for name in names:
        if not (path.parent / name).is_dir():
            raise PicksError(path, f"there is no folder {path.parent / name}; paths are relative to this file", place)
    return tuple(path.parent / name for name in names)


def _xacro_args(path: Path, content: LinedMapping) -> dict[str, str]:
    stated, place = content.get("xacro_args", {}), content.place("xacro_args")
    if not isinstance(stated, dict):
        raise PicksError(path, f"holds {stated!r}, not a mapping of argument names to values", place)
    if stated and not (content.get("robot") or "").endswith(".xacro"):
        raise PicksError(path, "is valid only if the robot is a file that ends in .xacro", place)
    found = {}
    for name, value in stated.items():
        if isinstance(value, (dict, list)) or value is None:
            raise PicksError(path, f"argument {name!r} is {value!r}; it must be a number or a text", place)
        found[str(name)] = str(value).lower() if isinstance(value, bool) else str(value)
    return found


def _text(path: Path, content: LinedMapping, key: str) -> str | None:
    value = content.get(key)
    if value is not None and (not isinstance(value, str) or not value):
        raise PicksError(path, f"holds {value!r}, not a name", content.place(key))
    return value
