"""Picks files in YAML or JSON, and tables of picks in CSV; docs/formats/picks.md describes them with an example.

An invalid row is reported as a problem and the others are kept; invalid shared settings are an error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pinproof.common.structs import (
    Key,
    Misread,
    Table,
    any_of,
    errors_of,
    list_of,
    mapping_to,
    position,
    required,
    simple,
    step,
)
from pinproof.common.yaml_file import YAML_SUFFIXES, read_yaml
from pinproof.errors import FileError, InputError, PicksError, UnknownNameError
from pinproof.picks.input.pick import DEFAULTS, PICK, Pick, completed, picks_of_row
from pinproof.picks.input.picks import CELL_ROBOT, SETTINGS, PickProblem, Picks, read_settings
from pinproof.picks.input.sources import TABLE_SUFFIX, PickList, PickSource, PickTable

SUFFIXES = (*YAML_SUFFIXES, ".json", TABLE_SUFFIX)

PICKS = Table(
    "picks",
    "A picks file: the picks, and the robot, scene and gripper that they share. Files that it names are relative to "
    "its folder.",
    *(key for key in SETTINGS.keys if key.name != "frames"),
    Key(
        "robots",
        mapping_to(CELL_ROBOT),
        "several robots by name: all poses are then in the frame `world`, and links and joints have the prefix "
        "`NAME/` in the scene",
        "",
        {},
    ),
    *(key for key in SETTINGS.keys if key.name == "frames"),
    Key("defaults", DEFAULTS, "keys of picks that apply where a pick does not state them", "", {}),
    required(
        "picks",
        any_of(
            list_of(PICK, 1),
            simple({"title": "name of a table (`.csv`)", "type": "string", "pattern": r"[^/.]\.[cC][sS][vV]$"}),
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
        The file: YAML or JSON with the keys of :data:`~pinproof.picks.input.picks_file.PICKS`, or a table (CSV) with
        the columns of :data:`~pinproof.picks.input.sources.COLUMNS`.

    Raises
    ------
    PicksError
        If the file or its shared settings are invalid; the message names file, line and key.
    """
    path = Path(path)
    if path.suffix.lower() == TABLE_SUFFIX:
        return PickTable(path)
    content = read_yaml(path, PICKS.names, PicksError, suffixes=SUFFIXES)
    with errors_of(path, PicksError):
        PICKS.refuse_unknown(content)
        rows = content.get("picks", [])
        table = isinstance(rows, str) and Path(rows).suffix.lower() == TABLE_SUFFIX
        if not table and not isinstance(rows, list):
            raise Misread(f"is {rows!r}, not a list of picks", (".picks",), position(content, "picks"))
        if not rows:
            raise InputError("contains no picks; add a list under 'picks:'")
        # The defaults are read as those of a pick, because an error in them would recur in every row.
        defaults = step(".defaults", position(content, "defaults"), _defaults, content.get("defaults", {}), path)
        shared = read_settings(content, path)
    if table:
        return PickTable(path.parent / rows, shared=shared, defaults=defaults)
    return _list(path, rows, shared, defaults)


def _defaults(stated: Any, path: Path) -> Mapping[str, Any]:
    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping; valid keys: {', '.join(DEFAULTS.names)}")
    DEFAULTS.refuse_unknown(stated)
    turned = {} if {"rpy", "quat_xyzw"} & stated.keys() else {"rpy": [0, 0, 0]}
    picks_of_row(completed({"name": "defaults", "xyz": [0, 0, 0], "object": "any", **turned}, stated), {}, path)
    return stated


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
            taken.update(pick.name for pick in made)
            picks += made
        except Misread as error:
            problems.append(PickProblem(number, str(name or f"row {number}"), str(error)))
        except (InputError, FileError) as error:
            reason = error.reason if isinstance(error, FileError) else str(error)
            where = position(row)
            problems.append(
                PickProblem(number, str(name or f"row {number}"), f"{where}: {reason}" if where else reason)
            )
    return PickList(replace(shared, picks=tuple(picks), problems=tuple(problems)))
