"""The report on picks of several arms as JSON, as Markdown, and as a page in one offline file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pinproof.cell.allocation.allocation_result import AllocationResult
from pinproof.cell.sequencing.sequence_page import MOST_FRAMES, RATE, CellPage, CellRow
from pinproof.cell.sequencing.sequence_result import cycle_time
from pinproof.collision import proven_millimetres
from pinproof.common.files import json_text, save_as
from pinproof.common.results import Rows, markdown
from pinproof.errors import InputError
from pinproof.model import PART, guess_mark
from pinproof.spatial import Array, matrix
from pinproof.viewer import Bar, Drawing, Film, set_stage, simplified

ALLOCATION_SUFFIXES = (".json", ".md", ".html")
"""The file types of :func:`save_allocation`."""

SAME_TIME = 1e-9
"""Seconds: differences are rounding."""


def write_allocation_page(result: AllocationResult, path: str | Path, *, title: str | None = None) -> None:
    """Write the page of several arms; it opens offline in any browser.

    Raises
    ------
    InputError
        If no pick is executed.
    ViewerError
        If the robots have nothing to draw, or the page cannot be written.
    """
    if not result.programs:
        raise InputError("no pick is executed that a page could show")
    stage = simplified(set_stage(result.group, result.scene, result.tools))
    # The rows of the table, and the bars of the chart
    rows, bars = [], []
    for arm, pieces in result.programs.items():
        sequence = result.sequences[arm]
        limits = {time.name: time.limited_by for time in cycle_time(sequence).picks}
        for piece in pieces:
            label = ", ".join(filter(None, (piece.pick, piece.name)))
            bars.append(Bar(arm, piece.name, piece.start, piece.duration, f"{arm}: {label}"))
        for step in sequence.steps:
            name, own = step.pick.name, [piece for piece in pieces if piece.pick == step.pick.name]
            limited_by = limits[name].replace(f"{arm}{PART}", "")
            start, duration = own[0].start, own[-1].end - own[0].start
            rows.append(CellRow(f"{name} ({arm})", start, duration, step.verdict.clearance, limited_by))
    figures = [(f"makespan{guess_mark(result.group.limits.acceleration_source)}", f"{result.makespan:.1f} s")]
    if np.isfinite(result.ratio):
        figures.append(("of the time of one arm", f"{100 * result.ratio:.0f} %"))
    figures += [(f"utilisation of {load.arm}", f"{100 * load.utilisation:.0f} %") for load in result.arms]
    verdict = "FREE" if result.free else "NOT PROVEN"
    figures.append((f"smallest proven clearance {proven_millimetres(result.clearance)}", verdict))
    page = CellPage(
        title or f"Cell of {', '.join(result.group.ends)}",
        result.message,
        figures,
        [*([f"Not proven: {result.reason}"] if result.reason else []), *(f"Not covered: {n}" for n in result.notes)],
        result.makespan,
        sorted(rows, key=lambda row: row.start),
        [(pick.name, pick.reason) for pick in result.missing],
        sorted(bars, key=lambda bar: list(result.group.ends).index(bar.lane)),
        list(result.group.ends),
        several=True,
    )
    page.write(path, stage, _film(stage, result), result.group.limits.acceleration_source)


def _film(stage: Drawing, result: AllocationResult) -> Film:
    """Key frames of all arms and of the parts, which rest before and after they are carried."""
    whole, arms = result.trajectory, list(result.group.ends)
    times = np.linspace(0.0, whole.duration, min(int(np.ceil(whole.duration * RATE)) + 1, MOST_FRAMES))
    events = [time for state in result.parts.values() for time in (state.gripped, state.released)]
    times = np.unique(np.concatenate([times, events]))
    configurations = np.asarray(whole(times))
    tcps = np.stack([stage.tcp_poses(q) for q in configurations])
    # where the parts are in the key frames in which they are carried, and before and after
    held: dict[str, dict[int, Array]] = {}
    for number, arm in enumerate(arms):
        for piece in result.programs.get(arm, []):
            frames = np.flatnonzero((times >= piece.start - SAME_TIME) & (times <= piece.end + SAME_TIME)).tolist()
            for thing in piece.carries:
                if thing.name in result.parts:
                    placed = held.setdefault(thing.name, {})
                    placed |= {k: tcps[k, number] @ matrix(thing.pose) for k in frames if k not in placed}
    riders = {}
    for name, placed in held.items():
        carried = sorted(placed)
        latest = np.searchsorted(carried, np.arange(len(times)), side="right") - 1
        riders[name] = np.stack([placed[carried[k]] for k in latest.clip(0)])
    poses = np.stack([stage.link_poses(q) for q in configurations])
    return Film(times, poses, tcps[:, :, :3, 3], riders)


def save_allocation(result: AllocationResult, path: str | Path) -> None:
    """Write an allocation as ``.json``, ``.md`` or ``.html``.

    Raises
    ------
    InputError
        If the suffix is unknown.
    FileError
        If the file cannot be written.
    """
    formats = {
        ".json": lambda: json_text(result.to_dict(), indent=2),
        ".md": lambda: allocation_markdown(result),
        ".html": lambda: write_allocation_page(result, path),
    }
    save_as(path, formats)


def allocation_markdown(result: AllocationResult) -> str:
    """The programs of all arms as tables in Markdown."""
    parts: list[object] = [f"# Picks of {result.group.robot.name}", result.message]
    for arm in result.arms:
        rows = [(f"{part.start:.2f} s", f"{part.duration:.2f} s", part.pick, part.name) for part in arm.phases]
        table = Rows(("start", "duration", "pick", "phase"), rows, numbers={"start", "duration"})
        parts += [f"## {arm.arm}", table]
    return markdown(*parts, *(f"left out: {pick.name}: {pick.reason}" for pick in result.missing))
