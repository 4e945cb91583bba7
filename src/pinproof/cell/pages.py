"""The page of a cell in one offline file: its motions as an animation, a Gantt chart and a table of picks."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pinproof import viewer
from pinproof.collision import proven_millimetres
from pinproof.common import theme
from pinproof.common.files import os_errors
from pinproof.common.results import Rows
from pinproof.errors import FileError, ViewerError
from pinproof.model import guess_note
from pinproof.picks import LivePicks, Pick, PickSetup
from pinproof.spatial import SE3

RATE = 15.0
"""Key frames per second; the viewer interpolates between them."""

MOST_FRAMES = 6000
"""Largest number of key frames; longer sequences have fewer per second."""

LAST = 1e-3
"""Seconds after the last key frame at which the film ends at the earliest."""

FRAMED = 200
"""Number of poses of the arm that the camera frames."""

BASE_AXIS = 0.25
"""Metres: length of the axes of the base that are drawn with a heat map."""

COLUMNS = ("#", "Pick", "Start", "Duration", "Clearance", "Limited by")


class CellRow(NamedTuple):
    """A pick of the table: its times (s), its proven clearance (m), and what limits its duration.

    The page may judge it again in its ``setup``.
    """

    name: str
    pick: Pick
    start: float
    duration: float
    clearance: float
    limited_by: str
    setup: PickSetup | None = None


def write_cell_page(
    path: str | Path,
    stage: viewer.Drawing,
    shown: viewer.Film,
    *,
    title: str,
    summary: str,
    figures: Sequence[tuple[str, str]],
    notes: Sequence[str],
    duration: float,
    rows: Sequence[CellRow],
    left_out: Sequence[tuple[str, str]],
    parts: Mapping[str, str | None],
    bars: Sequence[viewer.Bar],
    lanes: Sequence[str],
    acceleration_source: str,
    several: bool = False,
    heat_map: viewer.ColouredPoints | None = None,
    live: bool | None = None,
) -> None:
    """Write the page of a film of ``duration`` (s), whose carried parts are obstacles of the stage.

    ``rows`` are the picks in order, ``parts`` what picks carry by their names, ``bars`` and ``lanes`` the Gantt chart,
    of which each lane is an arm if there are ``several``, otherwise a phase. The page computes with the setups of
    the rows if that is wanted (``live``, see :meth:`pinproof.picks.PickReport.save`). ViewerError if the robot has
    nothing to draw, or the page cannot be written.
    """
    if not any(link.surfaces for link in stage.links):
        raise ViewerError(f"robot {stage.arm.robot.name!r} has nothing to draw: no link has geometry")
    # The camera frames the arms, the carried parts where they are picked and placed, and the points on the floor
    few = shown.poses[:: -(-len(shown.times) // FRAMED)]
    extra = [np.empty((0, 3)) if heat_map is None else heat_map.xyz]
    carried = [thing for thing in stage.obstacles if thing.name in shown.riders and thing.surfaces]
    extra += [
        viewer.placed_points(viewer.box_corners(thing.surfaces), shown.riders[thing.name][[0, -1]]) for thing in carried
    ]
    points = np.concatenate([*shown.tcps.swapaxes(0, 1), *extra])
    view = viewer.choose_view(stage, few, points, tool=viewer.tool_points(stage, few))
    commands = viewer.stage_commands(stage, viewer.Film(np.zeros(1), shown.poses[:1], shown.tcps[:1]), view)
    if heat_map is not None:
        heat_map.draw(commands)
        # The base from which the placements of the map are read
        for axis, colour in enumerate(theme.AXES):
            ends = np.array([np.zeros(3), BASE_AXIS * np.eye(3)[axis]])
            commands.set_lines(f"/base/{axis}", ends, (*theme.rgb(colour), 1.0), depthTest=False, linewidth=3)
    places = {thing.name: viewer.node_path("scene", thing.name) for thing in stage.obstacles}
    rest = max(duration - float(shown.times[-1]), LAST)
    commands.set_animation(viewer.tracks(commands, stage, shown, places, rest=rest))
    # The table of the picks
    cells: list[tuple[object, ...]] = []
    for number, row in enumerate(rows, start=1):
        figured = f"{row.start:.2f} s", f"{row.duration:.2f} s", proven_millimetres(row.clearance)
        cells.append((number, row.name, *figured, row.limited_by))
    cells += [("", name, "left out", "", "", reason) for name, reason in left_out]
    notes = [
        "Motions are resampled for display; the proofs hold for the original motions.",
        *notes,
        guess_note(acceleration_source) or f"Acceleration limits: {acceleration_source}",
        *stage.notes,
    ]
    colours = [theme.VERDICTS["good"]] * len(rows) + [theme.COLOURS["bad"]] * len(left_out)
    listed = Rows(COLUMNS, cells, numbers=("#", "Start", "Duration", "Clearance"), colours=colours)
    table = viewer.panels.table("side", listed, notes)
    names = [row.pick.name for row in rows] + [name for name, _ in left_out]
    picks = viewer.panels.linked(names, colours, stage.nodes(parts.get(name) for name in names))
    moments = [[row.start, row.start + row.duration] for row in rows]
    computing = LivePicks.of(
        [*((row.setup, row.pick) if row.setup else None for row in rows), *[None] * len(left_out)], stage.links, live
    )
    text = viewer.panels.page(
        title,
        "cell",
        viewer.panels.gantt(bars, lanes, duration, named=several) + table,
        {
            **view.settings(),
            "duration": duration,
            "moments": moments,
            "tools": stage.tools,
            "picks": picks,
            **computing.settings,
        },
        commands,
        label="The robot in its cell",
        summary=escape(summary),
        head=viewer.panels.figures(figures),
        colours=() if heat_map is None else heat_map.legend,
        script=computing.script,
        texts=computing.texts,
    )
    viewer.panels.write_page(path, text)


def write_comparison_page(path: str | Path, title: str, summary: str, table: str, content: Mapping[str, Any]) -> None:
    """Write the page of two set-ups; ``table`` is HTML, and ``content`` what ``comparison.js`` reads."""
    values = {
        "policy": viewer.panels.POLICY.format(compute=" 'wasm-unsafe-eval'", connect="'none'"),
        "title": escape(title),
        "summary": escape(summary),
        "style": theme.css() + viewer.panels.part("page.css"),
        "table": table,
        "pages": viewer.panels.script_json(content),
        "script": viewer.panels.part("comparison.js", __package__),
    }
    shell = viewer.panels.part("comparison.html", __package__)
    viewer.panels.write_page(path, re.sub(r"\{\{(\w+)\}\}", lambda place: values[place[1]], shell))


def read_heat_map(path: str | Path, root_from_cell: SE3 | None = None) -> viewer.ColouredPoints:
    """Points on the floor from the table of a placement search: for each x and y the largest share of picks that pass.

    Parameters
    ----------
    path
        A CSV file with the columns ``x``, ``y`` (m) and ``share`` (0 to 1), and optionally ``z``.
    root_from_cell
        The pose of the frame of the table in the frame of the robot's root; by default they are the same.

    Raises
    ------
    FileError
        If the file cannot be read, lacks a column, or has a value that is not a number.
    """
    with os_errors(path, "cannot be read"), Path(path).open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        missing = [name for name in ("x", "y", "share") if name not in (table.fieldnames or ())]
        if missing:
            raise FileError(path, f"lacks the column {missing[0]!r}; a heat map has x, y and share")
        best: dict[tuple[float, float, float], float] = {}
        for number, row in enumerate(table, start=2):
            try:
                x, y, z, share = (float(row.get(name) or 0.0) for name in ("x", "y", "z", "share"))
            except ValueError as error:
                raise FileError(path, f"line {number}: {error}") from error
            best[x, y, z] = max(best.get((x, y, z), 0.0), share)
    if not best:
        raise FileError(path, "has no row")
    points = np.array(list(best))
    steps = [np.diff(np.unique(points[:, axis])) for axis in (0, 1)]
    size = 0.5 * min((float(step.min()) for step in steps if len(step)), default=0.05)
    placed = points if root_from_cell is None else np.array([root_from_cell.act(point) for point in points])
    return viewer.ColouredPoints.of_values(placed, list(best.values()), label="share of picks:", size=min(size, 0.05))
