"""Picks as files, in YAML.

::

    robot: ur5                             # a catalogue name, or a URDF relative to this file
    tcp: tool0                             # optional: the arm's tcp frame
    scene: scene.yaml                      # relative to this file
    margin: 0.002                          # metres that must stay between any two bodies
    home: {shoulder_pan_joint: 0, ...}     # optional: where transits start; by default the robot's own
    tip: {xyz: [0, 0, 0.105]}              # tcp_from_tip: what is put onto the pick poses
    tool:                                  # bodies that move with the tcp; poses are tcp_from_body
      - {name: picker, cylinder: {radius: 0.02, length: 0.1}, xyz: [0, 0, 0.05]}
    defaults: {rpy: [pi, 0, 0], approach: 0.1, retreat: 0.1}
    picks:
      - {name: bolt_1, xyz: [0.46, 0.15, 0.035]}

Each pick has ``xyz`` and ``rpy`` (or ``quat_xyzw``) in the frame of the robot's root link, and may have ``approach``
and ``retreat`` (metres) and ``retreat_direction``. ``defaults`` fill in what a pick does not state. A row that makes no
sense is reported and the others are kept; what all rows share must make sense.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pinproof.collision import Obstacle
from pinproof.collision.scene_file import numbers_of, read_obstacle
from pinproof.description.lined_yaml import LinedMapping, listed, read_yaml, refuse_unknown
from pinproof.errors import FileError, InputError, PicksError
from pinproof.picks.pick import Pick, PickProblem, Picks
from pinproof.spatial import SE3, finite, pose

__all__ = ["read_picks"]

POSE_KEYS = ("xyz", "rpy", "quat_xyzw")
DEFAULT_KEYS = (*POSE_KEYS, "approach", "retreat", "retreat_direction")
PICK_KEYS = ("name", *DEFAULT_KEYS)
FILE_KEYS = ("robot", "tcp", "scene", "margin", "home", "tip", "tool", "defaults", "picks")


def read_picks(path: str | Path) -> Picks:
    """Read a picks file.

    Parameters
    ----------
    path
        The file (YAML); its keys are described in :mod:`pinproof.picks.picks_file`.

    Returns
    -------
    Picks
        The picks, and in ``problems`` the rows that could not be read.

    Raises
    ------
    PicksError
        If the file, or what all rows share, cannot be used; names file, line and key.
    """
    path = Path(path)
    content = read_yaml(path, FILE_KEYS, PicksError)
    refuse_unknown(PicksError, path, "key", content, FILE_KEYS, "")
    if "picks" not in content:
        raise PicksError(path, "holds no picks; a list of them stands under 'picks:'")
    rows = listed(PicksError, path, "picks", content["picks"])
    defaults = _defaults(path, content)
    picks: list[Pick] = []
    problems: list[PickProblem] = []
    for number, row in enumerate(rows, start=1):
        name = row.get("name") if isinstance(row, dict) else None
        try:
            picks.append(_pick(path, row, defaults, {pick.name for pick in picks}))
        except (InputError, FileError) as error:
            where = f"line {row.line}: " if isinstance(row, LinedMapping) else ""
            reason = error.reason if isinstance(error, FileError) else str(error)
            problems.append(PickProblem(number, str(name or f"row {number}"), where + reason))
    try:
        return Picks(
            tuple(picks),
            tuple(problems),
            tip=_pose("tip", content.get("tip", {}), path),
            tool=_tool(path, content),
            margin=_margin(content),
            robot=_robot(path, content),
            tcp=_text(path, content, "tcp"),
            scene=path.parent / scene if (scene := _text(path, content, "scene")) else None,
            home=_home(content),
            source=path,
        )
    except InputError as error:
        raise PicksError(path, str(error)) from error


def _defaults(path: Path, content: LinedMapping) -> dict[str, Any]:
    stated = content.get("defaults", {})
    if not isinstance(stated, dict):
        raise PicksError(path, f"holds {stated!r}, not a mapping", "key defaults")
    refuse_unknown(PicksError, path, "key", stated, DEFAULT_KEYS, "key defaults")
    return dict(stated)


def _pick(path: Path, row: object, defaults: dict[str, Any], taken: set[str]) -> Pick:
    if not isinstance(row, LinedMapping):
        raise InputError(f"{row!r} is no pick; valid keys: {', '.join(PICK_KEYS)}")
    refuse_unknown(PicksError, path, "key", row, PICK_KEYS, "")
    name = row.get("name")
    if not isinstance(name, str) or not name:
        raise InputError(f"has the name {name!r}; a pick needs a name (text, in quotes if it is a number)")
    if name in taken:
        raise InputError(f"a second pick is named {name!r}")
    stated = {**defaults, **row}
    if "rpy" in row:
        stated.pop("quat_xyzw", None)
    elif "quat_xyzw" in row:
        stated.pop("rpy", None)
    if "xyz" not in stated:
        raise InputError("does not state its xyz")
    settings = {key: numbers_of(key, stated[key]) for key in ("approach", "retreat") if key in stated}
    if "retreat_direction" in stated:
        settings["retreat_direction"] = numbers_of("retreat_direction", stated["retreat_direction"])
    return Pick(name, pose(**{key: numbers_of(key, stated[key]) for key in POSE_KEYS if key in stated}), **settings)


def _pose(key: str, stated: object, path: Path) -> SE3:
    if not isinstance(stated, dict):
        raise InputError(f"{key}: {stated!r} is no mapping of {', '.join(POSE_KEYS)}")
    refuse_unknown(PicksError, path, "key", stated, POSE_KEYS, f"key {key}")
    return pose(**{name: numbers_of(f"{key}.{name}", value) for name, value in stated.items()})


def _tool(path: Path, content: LinedMapping) -> tuple[Obstacle, ...]:
    bodies = []
    for number, stated in enumerate(listed(PicksError, path, "tool", content.get("tool", [])), start=1):
        if not isinstance(stated, LinedMapping):
            raise PicksError(path, f"{stated!r} is no body", f"key tool, #{number}")
        try:
            bodies.append(read_obstacle(path, number, stated))
        except FileError as error:
            raise PicksError(path, error.reason, error.place) from error
    return tuple(bodies)


def _margin(content: LinedMapping) -> float:
    margin = float(finite("margin", [numbers_of("margin", content.get("margin", 0.0))], (1,))[0])
    if margin < 0:
        raise InputError(f"margin: {margin} m; it is 0 or more")
    return margin


def _home(content: LinedMapping) -> dict[str, float]:
    stated = content.get("home", {})
    if not isinstance(stated, dict):
        raise InputError(f"home: {stated!r} is no mapping of joint names to values")
    return {str(name): float(finite(f"home.{name}", [numbers_of(str(name), v)], (1,))[0]) for name, v in stated.items()}


def _robot(path: Path, content: LinedMapping) -> str | None:
    """A catalogue name as it stands; a file relative to the picks file."""
    name = _text(path, content, "robot")
    if name is None or not (name.endswith((".urdf", ".xml")) or "/" in name):
        return name
    return str(path.parent / name)


def _text(path: Path, content: LinedMapping, key: str) -> str | None:
    value = content.get(key)
    if value is not None and (not isinstance(value, str) or not value):
        raise PicksError(path, f"holds {value!r}, not a name", f"key {key}")
    return value
