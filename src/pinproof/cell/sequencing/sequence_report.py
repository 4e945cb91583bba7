"""The report on a sequence as JSON, as a table for spreadsheets and as Markdown."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from pinproof.cell.sequencing.cycle_time import cycle_time
from pinproof.cell.sequencing.sequence_keys import SCHEMA
from pinproof.cell.sequencing.sequence_page import write_sequence_page
from pinproof.cell.sequencing.sequence_result import PHASES, SequenceResult, SequenceStep
from pinproof.common.files import csv_text, json_text, save_as

COLUMNS = ("position", "pick", "start", "duration", *PHASES, "shortest", "clearance_proven", "limited_by", "left_out")
"""The columns of the table; times in seconds, the clearance in metres."""


def save_sequence(result: SequenceResult, path: str | Path) -> None:
    """Write a sequence as ``.json``, ``.csv``, ``.md`` or ``.html``.

    Raises
    ------
    InputError
        If the suffix is unknown.
    FileError
        If the file cannot be written.
    """
    page = partial(write_sequence_page, result, path)
    save_as(path, {**{suffix: partial(text, result) for suffix, text in _TEXTS.items()}, ".html": page})


def sequence_dict(result: SequenceResult) -> dict[str, Any]:
    """The sequence as plain values for JSON; see the manual page of the format."""
    times = cycle_time(result)
    arm = result.setup.checker.arm
    names = result.precedence.names
    with_object = {step.pick.carried is not None for step in result.steps}
    return {
        "schema": SCHEMA,
        "robot": arm.robot.name,
        "summary": result.message,
        "ok": result.ok,
        "interrupted": result.interrupted,
        "acceleration_source": arm.limits.acceleration_source,
        "notes": list(result.setup.not_covered(with_object)),
        "duration": result.duration,
        "moving": result.moving,
        "lower_bound": number_or_none(result.lower_bound),
        "gap": number_or_none(result.gap),
        "file_order": number_or_none(result.file_order),
        "nearest_neighbour": number_or_none(result.nearest_neighbour),
        "parts_per_minute": number_or_none(result.parts_per_minute),
        "clearance_proven": number_or_none(result.clearance),
        "by_phase": times.by_phase,
        "closing": times.closing,
        "steps": [
            {
                "name": step.pick.name,
                "start": step.start,
                "duration": step.duration,
                "shortest": time.shortest,
                "limited_by": time.limited_by,
                "member": step.verdict.member,
                "q_grasp": [] if step.verdict.q_grasp is None else step.verdict.q_grasp.tolist(),
                "phases": _phases(step),
            }
            for step, time in zip(result.steps, times.picks, strict=True)
        ],
        "left_out": [{"name": each.name, "reason": each.reason} for each in result.left_out],
        "precedence": [
            {"before": names[a], "after": names[b], "reason": why} for (a, b), why in result.precedence.reasons.items()
        ],
    }


def _phases(step: SequenceStep) -> list[dict[str, Any]]:
    certificates = {motion.name: motion.certificate for motion in step.verdict.motions}
    rows = []
    for phase in step.phases:
        proof = certificates.get(phase.name)
        rows.append(
            {
                "name": phase.name,
                "start": phase.start,
                "duration": phase.duration,
                "clearance_proven": None if proof is None else number_or_none(proof.clearance),
                "pairs_proven": None if proof is None else proof.pairs,
            }
        )
    return rows


def sequence_csv(result: SequenceResult) -> str:
    """One row for each pick in order, then one for each that is left out, with the columns :data:`COLUMNS`."""
    rows: list[tuple[object, ...]] = []
    for number, (step, time) in enumerate(zip(result.steps, cycle_time(result).picks, strict=True), start=1):
        phases = (time.phases.get(name, "") for name in PHASES)
        clearance = number_or_none(step.verdict.clearance)
        rows.append(
            (number, time.name, time.start, time.duration, *phases, time.shortest, clearance, time.limited_by, "")
        )
    blank = [""] * (len(COLUMNS) - 3)
    rows += [("", pick.name, *blank, pick.reason) for pick in result.left_out]
    return csv_text(COLUMNS, rows)


def sequence_markdown(result: SequenceResult) -> str:
    """The sequence as a table in Markdown."""
    lines = [f"# Sequence of {result.setup.checker.arm.robot.name}", "", result.message, ""]
    lines += ["| | pick | start | duration | limited by |", "|--:|---|--:|--:|---|"]
    for number, time in enumerate(cycle_time(result).picks, start=1):
        lines.append(f"| {number} | {time.name} | {time.start:.2f} s | {time.duration:.2f} s | {time.limited_by} |")
    reasons = {pick.name: pick.reason.replace("|", "\\|") for pick in result.left_out}
    lines += [f"| | {name} | | | left out: {reason} |" for name, reason in reasons.items()]
    return "\n".join(lines) + "\n"


def number_or_none(value: float) -> float | None:
    """The value, or None if it is not finite, which JSON cannot hold."""
    return value if math.isfinite(value) else None


def _json(result: SequenceResult) -> str:
    return json_text(sequence_dict(result), indent=2)


_TEXTS: dict[str, Callable[[SequenceResult], str]] = {".json": _json, ".csv": sequence_csv, ".md": sequence_markdown}

SEQUENCE_SUFFIXES = (*_TEXTS, ".html")
"""The file types of :func:`save_sequence`."""
