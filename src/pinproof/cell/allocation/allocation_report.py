"""The report on picks of several arms as JSON, as Markdown and as a page."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from pinproof.cell.allocation.allocation_page import write_allocation_page
from pinproof.cell.allocation.allocation_result import AllocationResult
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


def allocation_markdown(result: AllocationResult) -> str:
    """The programs of all arms as tables in Markdown."""
    lines = [f"# Picks of {result.group.robot.name}", "", result.message, ""]
    for each in result.arms:
        lines += [f"## {each.arm}", "", "| start | duration | pick | phase |", "|--:|--:|---|---|"]
        lines += [
            f"| {piece.start:.2f} s | {piece.duration:.2f} s | {piece.pick} | {piece.name} |" for piece in each.phases
        ]
        lines.append("")
    lines += [f"left out: {each.name}: {each.reason}" for each in result.missing]
    return "\n".join(lines).rstrip() + "\n"


_TEXTS: dict[str, Callable[[AllocationResult], str]] = {
    ".json": lambda result: json_text(result.to_dict(), indent=2),
    ".md": allocation_markdown,
}

ALLOCATION_SUFFIXES = (*_TEXTS, ".html")
"""The file types of :func:`save_allocation`."""
