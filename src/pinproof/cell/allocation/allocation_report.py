"""The report on picks of several arms as JSON, as Markdown and as a page."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from pinproof.cell.allocation.allocation_keys import SCHEMA
from pinproof.cell.allocation.allocation_page import write_allocation_page
from pinproof.cell.allocation.allocation_result import AllocationResult
from pinproof.cell.sequencing.sequence_report import number_or_none
from pinproof.common.files import json_text, save_as


def save_allocation(result: AllocationResult, path: str | Path) -> None:
    """Write an allocation as ``.json``, ``.md`` or ``.html``.

    Raises
    ------
    InputError
        If the suffix is unknown.
    FileError
        If the file cannot be written.
    """
    page = partial(write_allocation_page, result, path)
    save_as(path, {**{suffix: partial(text, result) for suffix, text in _TEXTS.items()}, ".html": page})


def allocation_dict(result: AllocationResult) -> dict[str, Any]:
    """The allocation as plain values for JSON; see the manual page of the format."""
    return {
        "schema": SCHEMA,
        "robot": result.group.robot.name,
        "summary": result.message,
        "ok": result.ok,
        "free": result.free,
        "reason": result.reason,
        "makespan": result.makespan,
        "clearance_proven": number_or_none(result.clearance),
        "ratio": number_or_none(result.ratio),
        "arms": [
            {
                "name": each.arm,
                "picks": list(each.picks),
                "duration": each.duration,
                "waiting": each.waiting,
                "utilisation": each.utilisation,
                "phases": [
                    {"name": piece.name, "pick": piece.pick, "start": piece.start, "duration": piece.duration}
                    for piece in result.programs.get(each.arm, [])
                ],
            }
            for each in result.arms
        ],
        "intervals": [
            {
                "start": each.start,
                "duration": each.end - each.start,
                "status": each.certificate.status.name,
                "clearance_proven": number_or_none(each.certificate.clearance),
                "pairs_proven": each.certificate.pairs,
            }
            for each in result.intervals
        ],
        "alone": [dict(vars(each)) for each in result.alone],
        "left_out": [{"name": each.name, "reason": each.reason} for each in result.missing],
        "notes": list(result.notes),
    }


def allocation_markdown(result: AllocationResult) -> str:
    """The programs of all arms as tables in Markdown."""
    lines = [f"# Picks of {result.group.robot.name}", "", result.message, ""]
    for each in result.arms:
        lines += [f"## {each.arm}", "", "| start | duration | pick | phase |", "|--:|--:|---|---|"]
        lines += [
            f"| {piece.start:.2f} s | {piece.duration:.2f} s | {piece.pick} | {piece.name} |"
            for piece in result.programs.get(each.arm, [])
        ]
        lines.append("")
    lines += [f"left out: {each.name}: {each.reason}" for each in result.missing]
    return "\n".join(lines).rstrip() + "\n"


def _json(result: AllocationResult) -> str:
    return json_text(allocation_dict(result), indent=2)


_TEXTS: dict[str, Callable[[AllocationResult], str]] = {".json": _json, ".md": allocation_markdown}

ALLOCATION_SUFFIXES = (*_TEXTS, ".html")
"""The file types of :func:`save_allocation`."""
