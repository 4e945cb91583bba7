"""The page of several arms in one offline file: all arms on the common clock, a Gantt chart per arm, and the picks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pinproof.cell.allocation.allocation_result import AllocationResult
from pinproof.cell.sequencing.cycle_time import cycle_time
from pinproof.cell.sequencing.sequence_page import MOST_FRAMES, RATE, PageTexts, Riders, write_page
from pinproof.collision.certificates.certificate import proven_millimetres
from pinproof.common import theme
from pinproof.errors import InputError
from pinproof.model import guess_mark, guess_note
from pinproof.model.robot import PART
from pinproof.spatial import matrix
from pinproof.viewer.animation import Film
from pinproof.viewer.stage import Stage, set_stage, simplified

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
    texts = PageTexts(title or f"Cell of {', '.join(result.group.ends)}", result.message, _figures(result), [])
    texts.notes.extend(_notes(result, stage))
    write_page(stage, *_film(stage, result), texts, {"duration": result.makespan, **_content(result)}, path)


def _figures(result: AllocationResult) -> list[tuple[str, str]]:
    found = [(f"makespan{guess_mark(result.group.limits.acceleration_source)}", f"{result.makespan:.1f} s")]
    if np.isfinite(result.ratio):
        found.append(("of the time of one arm", f"{100 * result.ratio:.0f} %"))
    found += [(f"utilisation of {each.arm}", f"{100 * each.utilisation:.0f} %") for each in result.arms]
    verdict = "FREE" if result.free else "NOT PROVEN"
    return [*found, (f"smallest proven clearance {proven_millimetres(result.clearance)}", verdict)]


def _notes(result: AllocationResult, stage: Stage) -> list[str]:
    source = result.group.limits.acceleration_source
    return [
        "Motions are resampled for display; the proofs hold for the original motions.",
        *([f"Not proven: {result.reason}"] if result.reason else []),
        *(f"Not covered: {note}" for note in result.notes),
        guess_note(source) or f"Acceleration limits: {source}",
        *stage.notes,
    ]


def _content(result: AllocationResult) -> dict[str, Any]:
    """The rows of the table and the bars of the chart."""
    rows, closing = [], []
    for arm, pieces in result.programs.items():
        sequence = result.sequences[arm]
        limits = {time.name: time.limited_by for time in cycle_time(sequence).picks}
        bars: dict[str, list[list[Any]]] = {}
        for piece in pieces:
            bars.setdefault(piece.pick, []).append([piece.name, piece.start, piece.duration, arm, piece.pick])
        closing += bars.pop("", [])
        for step in sequence.steps:
            own = bars[step.pick.name]
            rows.append(
                {
                    "name": f"{step.pick.name} ({arm})",
                    "start": own[0][1],
                    "duration": own[-1][1] + own[-1][2] - own[0][1],
                    "phases": own,
                    "clearance": proven_millimetres(step.verdict.clearance),
                    "limit": limits[step.pick.name].replace(f"{arm}{PART}", ""),
                }
            )
    rows.sort(key=lambda row: row["start"])
    left_out = [vars(pick) for pick in result.missing]
    chart = {"closing": closing, "colours": theme.PHASES, "lanes": list(result.group.ends), "arms": True}
    return {"rows": rows, "left_out": left_out, **chart}


def _film(stage: Stage, result: AllocationResult) -> tuple[Film, Riders]:
    """Key frames of all arms, and of the parts while they are carried."""
    whole, arms = result.trajectory, list(result.group.ends)
    times = np.linspace(0.0, whole.duration, min(int(np.ceil(whole.duration * RATE)) + 1, MOST_FRAMES))
    events = [time for state in result.parts.values() for time in (state.gripped, state.released)]
    times = np.unique(np.concatenate([times, events]))
    configurations = np.asarray(whole(times))
    tcps = np.stack([stage.tcp_poses(q) for q in configurations])
    riders: Riders = {}
    for number, arm in enumerate(arms):
        for piece in result.programs.get(arm, []):
            at = np.flatnonzero((times >= piece.start - SAME_TIME) & (times <= piece.end + SAME_TIME)).tolist()
            for thing in piece.carries:
                if thing.name in result.parts:
                    frames = riders.setdefault(thing.name, [])
                    frames += [(float(times[k]), tcps[k, number] @ matrix(thing.pose)) for k in at[bool(frames) :]]
    poses = np.stack([stage.link_poses(q) for q in configurations])
    return Film(times, poses, tcps[:, :, :3, 3]), riders
