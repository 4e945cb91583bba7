"""The table of picks as Markdown, and what a run leaves in a folder."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path

from pinproof.benchmarks.picks_campaign import ENDING, SETTLED, CampaignRow
from pinproof.benchmarks.picks_measure import REPEATS, ScreenRow, VerdictRow
from pinproof.benchmarks.picks_table import PicksTable
from pinproof.common.files import write_text_whole

__all__ = ["picks_markdown", "write_picks_table"]

WIDTH = 120
"""Characters of a line of text."""


def write_picks_table(table: PicksTable, folder: str | Path) -> list[Path]:
    """Write ``picks.json`` and ``picks.md``; the files written. The folder must exist."""
    data, page = Path(folder) / "picks.json", Path(folder) / "picks.md"
    table.save(data)
    write_text_whole(page, "# Picks: the table\n\n" + picks_markdown(table))
    return [data, page]


def picks_markdown(table: PicksTable) -> str:
    """The whole table."""
    origin = table.provenance
    versions = ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    where = (
        f"{versions}; {origin['cpu']}, {origin['cores']} cores, load {origin['load']}; seed {origin['seed']}; commit "
        f"{origin['commit']}; {origin['date']}. Everything is on one core unless more are told of."
    )
    lines = [*_text(where), ""]
    if table.verdicts:
        lines += ["## A pick through all stages", "", *_verdicts(table.verdicts), ""]
    if table.screening:
        lines += ["## Screening", "", *_screening(table.screening), ""]
    if table.campaigns or table.machinery:
        lines += ["## Campaigns", "", *_campaigns(table.campaigns, table.machinery), ""]
    return "\n".join(lines).rstrip() + "\n"


def _verdicts(rows: Sequence[VerdictRow]) -> list[str]:
    text = (
        "Random picks in the cells that come with the package: the tip looks down within 30 degrees, anywhere before "
        "the arm, from its foot to a little out of reach. Those of the carried cell are bolts that stand on the table, "
        "are lifted, carried and put down elsewhere: six certified motions each. Times in ms from the pick to its "
        "verdict, with every branch, line, transit, timing and certificate, and with the remedy where it fails."
    )
    table = _table(
        ("cell", "verdict", "picks", "median", "p95", "largest", "mean"),
        2,
        (
            (r.cell, r.verdict, str(r.picks), *(f"{ms:.1f}" for ms in (r.median_ms, r.p95_ms, r.largest_ms, r.mean_ms)))
            for r in rows
        ),
    )
    return [*_text(text), "", *table]


def _screening(rows: Sequence[ScreenRow]) -> list[str]:
    text = (
        "Poses a second: reached inside the limits, free of contact with the arm itself and the scene at the grasp, or "
        "why not. Of picks as above; and anywhere the arm can be, in any orientation, which is the most work, since "
        f"nothing is out of reach. The quickest of {REPEATS} runs. Reach alone leaves contact aside; with clearance, "
        "that of what is free is measured, too; as picks, they come as Pick objects in place of an array."
    )
    table = _table(
        ("cell", "poses", "free", "a second", "reach alone", "with clearance", "as picks", "2 threads"),
        2,
        (
            (
                r.cell,
                f"{r.count:,} {r.poses}",
                f"{100 * r.free:.0f} %",
                *("-" if x is None else f"{x:,.0f}" for x in (r.rate, r.reach_only, r.with_clearance, r.as_picks)),
                f"{r.two_threads:,.0f}",
            )
            for r in rows
        ),
    )
    return [*_text(text), "", *table]


def _campaigns(rows: Sequence[CampaignRow], idle: Sequence[CampaignRow]) -> list[str]:
    text = (
        "Picks as above, judged in processes, their rows on disk. The whole is from the call to the ordered file, with "
        f"the start of the processes; steady is from {100 * SETTLED:.0f} to {100 * ENDING:.0f} % of the picks."
    )
    lines = _table(
        ("cell", "workers", "picks", "whole, s", "picks a second", "times one", "steady", "times one"),
        2,
        (
            (
                r.cell,
                r.workers,
                f"{r.picks:,}",
                f"{r.wall_s:.1f}",
                f"{r.whole:.1f}",
                f"{r.whole / rows[0].whole:.2f}",
                f"{r.steady:.1f}",
                f"{r.steady / rows[0].steady:.2f}",
            )
            for r in rows
        ),
    )
    said = [*_text(text), "", *lines] if rows else []
    for r in idle:
        costs = (
            f"With a judge that does nothing, {r.picks:,} picks take {r.wall_s:.1f} s in one process, and "
            f"{1e6 / r.steady:.0f} us a pick once it is at work: what the machinery costs, picks made and rows written."
        )
        said += ["", *_text(costs)] if said else _text(costs)
    return said


def _text(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH)


def _table(columns: Sequence[str], words: int, rows: Iterable[Sequence[str]]) -> list[str]:
    """A table whose first ``words`` columns are text, the others numbers."""
    lines = [columns, ["---"] * words + ["--:"] * (len(columns) - words), *rows]
    return [f"| {' | '.join(cells)} |" for cells in lines]
