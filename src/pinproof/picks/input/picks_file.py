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
from pinproof.common.file_keys import KeyTable
from pinproof.common.files import is_file
from pinproof.common.validation import require_integer
from pinproof.common.yaml_file import YAML_SUFFIXES, LinedMapping, read_yaml, refuse_unknown, require_list
from pinproof.description.meshes import COLOURED_SUFFIXES
from pinproof.errors import FileError, InputError, PicksError, UnknownNameError
from pinproof.picks.input.conveyor import Conveyor
from pinproof.picks.input.pick import CellRobot, GripperFingers, NamedFrame, Pick, PickProblem, Picks, SuctionCup
from pinproof.picks.input.pick_row import is_turned, make_pick, mapping_of, payload_of, picks_of_row, text_of
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
    defaults = _read(path, content, "defaults", _defaults) if "defaults" in content else {}
    settings = _settings(path, content, {**ROBOT_SETTINGS, **CELL_SETTINGS})
    try:
        shared = Picks((), **settings, source=path, places=_places(content))
    except InputError as error:
        raise PicksError(path, str(error)) from error
    shared = replace(shared, robots=_robots(path, content, shared))
    for each in [robot.settings for robot in shared.robots.values()] or [shared]:
        if each.xacro_args and not (each.robot or "").endswith(".xacro"):
            raise PicksError(
                path, "is valid only if the robot is a file that ends in .xacro", each.places["xacro_args"]
            )
    if table:
        return PickTable(path.parent / stated, shared=shared, defaults=defaults)
    return _list(path, rows, shared, defaults)


def _settings(path: Path, content: LinedMapping, readers: Mapping[str, Reader]) -> dict[str, Any]:
    """The settings that a mapping states, by the name of their field of :class:`Picks`."""
    key_of = {name: "held" if name == "grip" else name for name in readers}
    return {name: _read(path, content, key_of[name], readers[name]) for name in readers if key_of[name] in content}


def _read(path: Path, content: LinedMapping, key: str, reader: Callable[[Any, Path], Value]) -> Value:
    """The value of a key; an error names the key, and its line if it is known."""
    try:
        return reader(content[key], path)
    except InputError as error:
        raise PicksError(path, str(error), content.place(key)) from error


def _robots(path: Path, content: LinedMapping, shared: Picks) -> dict[str, CellRobot]:
    """The robots of a cell; settings that a robot does not state are those of the file."""
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
        base = _read(path, each, "base", _pose)
        own = _settings(path, each, ROBOT_SETTINGS)
        try:
            found[str(name)] = CellRobot(base, replace(shared, **own, places={**shared.places, **_places(each)}))
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
            made = _picks(path, row, defaults, taken)
            _check_arms(made, shared)
            picks += made
        except (InputError, FileError) as error:
            where = f"line {row.line}: " if isinstance(row, LinedMapping) else ""
            reason = error.reason if isinstance(error, FileError) else str(error)
            problems.append(PickProblem(number, str(name or f"row {number}"), where + reason))
    return PickList(replace(shared, picks=tuple(picks), problems=tuple(problems)))


def _places(content: LinedMapping) -> dict[str, str]:
    """The positions of what can be checked only together with the robot."""
    found = {key: content.place(key) for key in ("robot", "tcp", "xacro_args") if key in content}
    for key in ("xacro_args", "held"):
        inner = content.get(key)
        if isinstance(inner, LinedMapping):
            found.update({f"{key}.{name}": inner.place(name, f"key {key},") for name in inner})
    return found


def _defaults(stated: object, path: Path) -> dict[str, Any]:
    """The defaults, validated with a pick made from them, because an error would recur in every row."""
    settings = mapping_of("", stated, DEFAULTS)
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


def _check_arms(picks: list[Pick], shared: Picks) -> None:
    for pick in picks:
        if pick.arm is not None and not shared.robots:
            raise InputError(f"states the arm {pick.arm!r}, but the file has no robots")
        if pick.arm is not None and pick.arm not in shared.robots:
            raise UnknownNameError("arm", pick.arm, shared.robots, "the robots of the file")


# -- readers of settings: the value of a key and the path of the file; InputError if the value is invalid -------------

Reader = Callable[[Any, Path], Any]

MOST_TOOL = 5.0
"""Metres. A longer tool is stated in millimetres."""

TOOL_GREY = (0.30, 0.32, 0.36, 1.0)
"""The colour of tools and fingers without ``rgba``, so that they differ from obstacles in pictures."""


def _mapping(stated: object, what: str) -> dict[str, Any]:
    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping of {what}")
    return {str(name): value for name, value in stated.items()}


def _number(name: str, stated: object) -> float:
    return float(finite(name, [numbers_of(name, stated)], (1,))[0])


def _numbers(stated: object, table: KeyTable) -> dict[str, float]:
    return {key: _number(key, value) for key, value in mapping_of("", stated, table).items()}


def _pose(stated: object, _: Path, most: float = MOST_REACH) -> SE3:
    placed = pose_of(mapping_of("", stated, POSE))
    refuse_millimetres("xyz", placed.translation.tolist(), most=most)
    return placed


def _frames(stated: object, path: Path) -> dict[str, NamedFrame]:
    found = {}
    for name, frame in _mapping(stated, "names to frames").items():
        settings = mapping_of(name, frame, FRAME)
        parent = settings.pop("frame", "")
        if not isinstance(parent, str):
            raise InputError(f"{name}: its frame {parent!r} is not a name")
        found[name] = NamedFrame(_pose(settings, path), parent)
    return found


def _bodies(stated: object, path: Path, key: str = "tool") -> tuple[Obstacle, ...]:
    bodies: list[Obstacle] = []
    for number, each in enumerate(require_list(PicksError, path, key, stated), start=1):
        if not isinstance(each, LinedMapping):
            raise PicksError(path, f"{each!r} is not a body", f"key {key}, #{number}")
        try:
            body = read_obstacle(path, number, each)
        except FileError as error:
            raise PicksError(path, error.reason, error.place) from error
        if any(body.name == other.name for other in bodies):
            place = f"line {each.line}, key {key}, #{number}"
            raise PicksError(path, f"a second body is named {body.name!r}", place)
        own_colours = isinstance(body.shape, Mesh) and str(body.shape.path).lower().endswith(COLOURED_SUFFIXES)
        bodies.append(body if body.rgba or own_colours else replace(body, rgba=TOOL_GREY))
    return tuple(bodies)


def _fingers(stated: object, path: Path) -> GripperFingers:
    settings = mapping_of("", stated, FINGERS)
    bodies = _bodies(settings.pop("bodies"), path, "bodies")
    return GripperFingers(bodies, **{key: numbers_of(key, value) for key, value in settings.items()})  # type: ignore[arg-type]


def _conveyor(stated: object, _: Path) -> Conveyor:
    settings = mapping_of("", stated, CONVEYOR)
    return Conveyor(parts=settings.pop("parts"), **{key: numbers_of(key, value) for key, value in settings.items()})


def _gripper(stated: object, path: Path) -> tuple[str, ...]:
    return tuple(text_of(name) for name in require_list(PicksError, path, "gripper", stated))


def _evaluations(stated: Any, _: Path) -> int:
    require_integer("optimise", stated, 0)
    return int(stated)


def _straight(stated: object, _: Path) -> float:
    share = _number("straight", stated)
    if not 0.0 < share <= 1.0:
        raise InputError(f"straight = {share:g}; it is a share of each line, above 0 and at most 1")
    return share


def _torque_limits(stated: object, _: Path) -> bool:
    if not isinstance(stated, bool):
        raise InputError(f"is {stated!r}; it must be true or false")
    return stated


def _margin(stated: object, _: Path) -> float:
    margin = _number("margin", stated)
    if margin < 0:
        raise InputError(f"is {margin} m; it must be 0 or more")
    warn_of_millimetres("margin", [margin], most=MOST_MARGIN)
    return margin


def _home(stated: object, _: Path) -> dict[str, float]:
    return {name: _number(name, value) for name, value in _mapping(stated, "joint names to values").items()}


def _held(stated: object, when: str) -> dict[str, float]:
    """The joint values of the open or of the gripping hand; for the latter only joints that state one."""
    found: dict[str, float] = {}
    for name, value in _mapping(stated, f"joint names to values, or to {' and '.join(HELD.names)}").items():
        if isinstance(value, dict):
            found[name] = _number(f"{name}.{when}", mapping_of(name, value, HELD)[when])
        elif when == "open":
            found[name] = _number(name, value)
    return found


def _robot(stated: object, path: Path) -> str:
    """A catalogue name, or a path relative to the picks file."""
    name = text_of(stated)
    return str(path.parent / name) if Path(name).suffix or "/" in name else name


def _file(stated: object, path: Path) -> Path:
    """An existing file, relative to the picks file."""
    file = path.parent / text_of(stated)
    if not is_file(file):
        raise InputError(f"there is no file {file}; paths are relative to this file")
    return file


def _folders(stated: object, path: Path) -> tuple[Path, ...]:
    """The package folders, relative to the picks file."""
    names = [stated] if isinstance(stated, str) else stated
    if not isinstance(names, list) or not all(isinstance(name, str) and name for name in names):
        raise InputError(f"holds {stated!r}, not a list of folders")
    folders = tuple(path.parent / name for name in names)
    if missing := [folder for folder in folders if not folder.is_dir()]:
        raise InputError(f"there is no folder {missing[0]}; paths are relative to this file")
    return folders


def _xacro_args(stated: object, _: Path) -> dict[str, str]:
    found = _mapping(stated, "argument names to values")
    for name, value in found.items():
        if isinstance(value, (dict, list)) or value is None:
            raise InputError(f"argument {name!r} is {value!r}; it must be a number or a text")
    return {name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in found.items()}


ROBOT_SETTINGS: dict[str, Reader] = {
    "tip": lambda stated, path: _pose(stated, path, MOST_TOOL),
    "tool": _bodies,
    "fingers": _fingers,
    "cup": lambda stated, _: SuctionCup(**_numbers(stated, CUP)),
    "gripper": _gripper,
    "held": lambda stated, _: _held(stated, "open"),
    "grip": lambda stated, _: _held(stated, "grip"),
    "payload": lambda stated, _: tuple(
        payload_of("", each, PAYLOAD) for each in (stated if isinstance(stated, list) else [stated])
    ),
    "robot": _robot,
    "srdf": _file,
    "package_dirs": _folders,
    "xacro_args": _xacro_args,
    "limits": _file,
    "tcp": lambda stated, _: text_of(stated),
    "home": _home,
}
"""The settings of a robot and its hand, which a file for several robots may state for each of them."""

CELL_SETTINGS: dict[str, Reader] = {
    "conveyor": _conveyor,
    "grip_limits": lambda stated, _: GripLimits(**_numbers(stated, GRIP_LIMITS)),
    "optimise": _evaluations,
    "straight": _straight,
    "frames": _frames,
    "margin": _margin,
    "torque_limits": _torque_limits,
    "scene": lambda stated, path: path.parent / text_of(stated),
}
"""The settings that all robots of a file share."""
