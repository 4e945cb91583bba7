"""The page of a cell in one offline file: its sequence as an animation, a Gantt chart and a table of picks."""

from __future__ import annotations

import csv
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pinproof.cell.sequencing.cycle_time import cycle_time
from pinproof.cell.sequencing.sequence_result import PHASES, SequenceResult
from pinproof.collision.certificates.certificate import proven_millimetres
from pinproof.common import theme
from pinproof.common.files import os_errors, write_text_whole
from pinproof.errors import FileError, InputError, ViewerError
from pinproof.model import guess_mark, guess_note
from pinproof.spatial import SE3, Array, matrix
from pinproof.viewer.animation import Film, pose_tracks, tracks
from pinproof.viewer.camera import choose_view, placed_points, tool_points
from pinproof.viewer.overlays import ColouredPoints
from pinproof.viewer.page import assemble, fill, part
from pinproof.viewer.picture import stage_commands
from pinproof.viewer.stage import Stage, box_corners, set_stage, simplified
from pinproof.viewer.wire import Commands, node_path

Riders = dict[str, list[tuple[float, Array]]]
"""Key frames (time, ``root_from_object``) of carried parts by name."""

RATE = 15.0
"""Key frames per second; the viewer interpolates between them."""

MOST_FRAMES = 6000
"""Largest number of key frames; longer sequences have fewer per second."""

LAST = 1e-3
"""Seconds after the last key frame at which a clip ends at the earliest."""

FRAMED = 200
"""Number of poses of the arm that the camera frames."""


def write_sequence_page(
    result: SequenceResult, path: str | Path, *, heat_map: ColouredPoints | None = None, title: str | None = None
) -> None:
    """Write the page of a sequence; it opens offline in any browser.

    Parameters
    ----------
    result
        The sequence.
    path
        The file to write.
    heat_map
        Points to draw on the floor, such as the result of a search for the base placement.
    title
        The title of the page. Default: the name of the robot.

    Raises
    ------
    InputError
        If the sequence has no step.
    ViewerError
        If the robot has nothing to draw, or the page cannot be written.
    """
    if not result.steps:
        raise InputError("the sequence has no step that a page could show")
    setup = result.setup
    arm, scene = setup.checker.arm, setup.checker.scene
    stage = simplified(set_stage(arm, scene, setup.shared.open_tool))
    texts = PageTexts(title or f"Cell of {arm.robot.name}", result.message, _figures(result), _notes(result, stage))
    write_page(stage, *_film(stage, result), texts, {"duration": result.duration, **_content(result)}, path, heat_map)


class PageTexts(NamedTuple):
    """The texts of a page."""

    title: str
    summary: str
    figures: list[tuple[str, str]]
    """Pairs of a label and a figure."""
    notes: list[str]


def write_page(
    stage: Stage,
    shown: Film,
    riders: Riders,
    texts: PageTexts,
    content: dict[str, Any],
    path: str | Path,
    heat_map: ColouredPoints | None = None,
) -> None:
    """Write the page of a film with carried parts; ``content`` has its duration, and the rows and bars of the chart.

    Raises
    ------
    ViewerError
        If the robot has nothing to draw, or the page cannot be written.
    """
    if not any(link.surfaces for link in stage.links):
        raise ViewerError(f"robot {stage.arm.robot.name!r} has nothing to draw: no link has geometry")
    few = slice(None, None, -(-len(shown.times) // FRAMED))
    floor = np.empty((0, 3)) if heat_map is None else heat_map.xyz
    points = np.concatenate([*shown.tcps.swapaxes(0, 1), _rider_points(stage, riders), floor])
    view = choose_view(stage, shown.poses[few], points, tool=tool_points(stage, shown.poses[few]))
    first = Film(np.zeros(1), shown.poses[:1], shown.tcps[:1])
    commands = stage_commands(stage, first, view)
    if heat_map is not None:
        heat_map.draw(commands)
    moving = _rider_tracks(commands, stage, riders, content["duration"])
    commands.set_animation([*tracks(commands, stage, shown, rest=0.0), *moving])
    legend = () if heat_map is None else heat_map.legend
    body = fill(
        part("sequence_page.html", __package__),
        {
            "title": escape(texts.title),
            "summary": escape(texts.summary),
            "chips": "".join(f"<li><b>{escape(text)}</b> {escape(label)}</li>" for label, text in texts.figures),
            "legend": "".join(
                f'<li><span class="swatch" style="background:rgb({r * 255:.0f},{g * 255:.0f},{b * 255:.0f})"></span>'
                f"{escape(text)}</li>"
                for text, (r, g, b) in legend
            ),
            "notes": "".join(f"<li>{escape(note)}</li>" for note in texts.notes),
        },
    )
    style = part("common.css") + part("sequence_page.css", __package__)
    settings = {**view.settings(), **content}
    text = assemble(texts.title, style, body, part("sequence_page.js", __package__), settings, commands)
    try:
        write_text_whole(path, text)
    except FileError as error:
        raise ViewerError(str(error)) from error


def read_heat_map(path: str | Path, root_from_cell: SE3 | None = None) -> ColouredPoints:
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
    return ColouredPoints.of_values(placed, list(best.values()), label="share of picks:", size=min(size, 0.05))


def _figures(result: SequenceResult) -> list[tuple[str, str]]:
    free = all(motion.certificate.free for motion in result.motions)
    return [
        (f"cycle{guess_mark(result.setup.checker.arm.limits.acceleration_source)}", f"{result.duration:.1f} s"),
        ("parts per minute", f"{result.parts_per_minute:.1f}"),
        ("above the lower bound", f"{100 * result.gap:.1f} %"),
        (
            f"motions, smallest proven clearance {proven_millimetres(result.clearance)}",
            "FREE" if free else "UNPROVEN",
        ),
    ]


def _notes(result: SequenceResult, stage: Stage) -> list[str]:
    source = result.setup.checker.arm.limits.acceleration_source
    with_object = {step.pick.carried is not None for step in result.steps}
    return [
        "Motions are resampled for display; the proofs hold for the original motions.",
        *(f"Not covered: {note}" for note in result.setup.not_covered(with_object)),
        guess_note(source) or f"Acceleration limits: {source}",
        *stage.notes,
    ]


def _content(result: SequenceResult) -> dict[str, Any]:
    """The rows of the table and the bars of the chart."""
    rows = []
    for step, time in zip(result.steps, cycle_time(result).picks, strict=True):
        rows.append(
            {
                "name": time.name,
                "start": time.start,
                "duration": time.duration,
                "phases": [[phase.name, phase.start, phase.duration] for phase in step.phases],
                "clearance": proven_millimetres(step.verdict.clearance),
                "limit": time.limited_by,
            }
        )
    end = result.steps[-1].end
    closing = [] if result.closing is None else [["transit", end, result.closing.trajectory.duration]]
    left_out = [vars(pick) for pick in result.left_out]
    chart = {"closing": closing, "colours": theme.PHASES, "lanes": list(PHASES), "arms": False}
    return {"rows": rows, "left_out": left_out, **chart}


def _film(stage: Stage, result: SequenceResult) -> tuple[Film, Riders]:
    """Key frames of all motions with rests at dwell times, and key frames (time, pose) of each carried part."""
    rate = min(RATE, MOST_FRAMES / max(result.moving, 1e-9))
    own = {thing.name for thing in result.setup.shared.open_tool}
    times: list[float] = []
    poses: list[Array] = []
    tcps: list[Array] = []
    riders: Riders = {}
    pieces = [
        (phase.start, motion)
        for step in result.steps
        for phase, motion in zip(
            [each for each in step.phases if each.name not in ("grip", "release")], step.verdict.motions, strict=True
        )
    ]
    if result.closing is not None:
        pieces.append((result.steps[-1].end, result.closing))
    for start, motion in pieces:
        placed = Stage(stage.arm.with_held(motion.held), stage.links, stage.obstacles, stage.notes)
        moved = motion.trajectory
        instants = np.linspace(0.0, moved.duration, int(np.ceil(moved.duration * rate)) + 1)
        for t, q in zip(instants.tolist(), np.asarray(moved(instants), dtype=float), strict=True):
            now = start + t
            (tcp,) = placed.tcp_poses(q)
            if not times or now > times[-1]:
                times.append(now)
                poses.append(placed.link_poses(q))
                tcps.append(tcp[None, :3, 3])
            for thing in motion.attached:
                if thing.name not in own:
                    frames = riders.setdefault(thing.name, [])
                    if not frames or now > frames[-1][0]:
                        frames.append((now, tcp @ matrix(thing.pose)))
    return Film(np.array(times), np.stack(poses), np.stack(tcps)), riders


def _rider_tracks(commands: Commands, stage: Stage, riders: Riders, duration: float) -> list[dict[str, Any]]:
    """The tracks of the carried parts. Before the first and after the last key frame, a part keeps its pose."""
    drawn = {obstacle.name for obstacle in stage.obstacles}
    found = []
    for name, frames in riders.items():
        if name not in drawn:
            continue
        # A clip is repeated after its last key frame, so all clips end at the same time.
        keys = [*frames, (max(duration, frames[-1][0] + LAST), frames[-1][1])]
        stamps = commands.array(np.array([time for time, _ in keys], dtype=np.float32))
        made = pose_tracks(commands, stamps, np.stack([pose for _, pose in keys]))
        if made:
            clip = {"fps": 1, "name": "motion", "tracks": made}
            found.append({"path": node_path("scene", name), "clip": clip})
    return found


def _rider_points(stage: Stage, riders: Riders) -> Array:
    """(N, 3) the corners of the carried parts where they are picked and placed, for the camera."""
    surfaces = {obstacle.name: obstacle.surfaces for obstacle in stage.obstacles}
    found = [np.empty((0, 3))]
    for name, frames in riders.items():
        if surfaces.get(name):
            found.append(placed_points(box_corners(surfaces[name]), np.stack([frames[0][1], frames[-1][1]])))
    return np.concatenate(found)
