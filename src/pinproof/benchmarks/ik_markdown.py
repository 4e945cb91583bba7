"""The table of inverse kinematics as Markdown."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from pinproof.benchmarks.ik_measure import IkRow
from pinproof.benchmarks.ik_methods import TOLERANCE, Asked
from pinproof.benchmarks.ik_success import SuccessRow
from pinproof.benchmarks.ik_table import PARTS, TEXTBOOK, IkTable

__all__ = ["COLUMNS", "ik_markdown", "success_markdown"]

COLUMNS = (
    "method",
    "mean",
    "median",
    "p99.9",
    "batch mean",
    "success",
    "worst position",
    "worst rotation",
    "false yes",
    "largest step",
    "textbook mean",
    "textbook success",
    "times ours",
)

WIDTH = 120
"""Characters of a line of text."""


def ik_markdown(table: IkTable) -> str:
    """The whole table."""
    lines = [*_preamble(table), ""]
    for robot in table.robots:
        lines += [f"## {robot}", "", *_limits(table, robot), ""]
        for asked in PARTS:
            rows = table.part(robot, asked)
            if rows:
                lines += [f"### {robot}: {_title(asked)}", "", *_rows(rows, table.settings["points"]), ""]
        lines += [*_left_out(table, robot), ""]
    if table.success:
        lines += ["## The big check", "", success_markdown(table.success)]
    return "\n".join(lines).rstrip() + "\n"


def _preamble(table: IkTable) -> list[str]:
    origin, settings = table.provenance, table.settings
    versions = ", ".join(f"{name} {version}" for name, version in origin["versions"].items())
    peers = ", ".join(f"{name} {number}" for name, number in settings["peer_versions"].items() if number is not None)
    asked = (
        f"{settings['points']:,} targets a part, seed {origin['seed']}; limits on, {settings['limits']}. Random "
        "targets are poses of configurations uniform in the limits, and each starts in the middle of the ranges; "
        f"with restarts, it may start anew {settings['restarts']} times."
    )
    judged = (
        f"Solved means inside the limits and within {settings['tolerance']:g} m and {settings['tolerance']:g} rad (or "
        "what the row says) by Pinocchio's forward kinematics, whatever the method says of itself; a false yes is an "
        "answer that is none."
    )
    timed = (
        "Times are in ms: single calls from Python with everything included, and the mean a target of one batch on "
        f"one thread. p99.9 is of {settings['points']:,} calls (of fewer than 1,000 it is the longest). Of a peer, the "
        "last column is its mean in units of ours that answers the same question."
    )
    where = (
        f"{versions}{'; peers: ' + peers if peers else ''}; {origin['cpu']}, {origin['cores']} cores, load "
        f"{origin['load']}; commit {origin['commit']}; {origin['date']}. {TEXTBOOK}"
    )
    return [textwrap.fill(f"{asked} {judged} {timed}", WIDTH), "", textwrap.fill(where, WIDTH)]


def _limits(table: IkTable, robot: str) -> list[str]:
    chain = table.settings["chains"][robot]
    ranges = [
        f"{name} {_bound(low)} to {_bound(high)}"
        for name, low, high in zip(chain["joints"], chain["lower"], chain["upper"], strict=True)
    ]
    return [f"tcp {chain['tcp']}; limits: {', '.join(ranges)}."]


def _title(asked: Asked) -> str:
    if asked.problem == "trajectory":
        return "a smooth trajectory, each call from the last answer"
    task = {"position": "position only", "pose": "whole poses"}[asked.task]
    return f"random targets, {task}, {'with restarts' if asked.restarts else 'one seed'}"


def _rows(rows: Sequence[IkRow], points: int) -> list[str]:
    """The rows under those of the columns that are not left out and say anything."""
    cells = [_cells(row, points) for row in rows]
    shown = [name for name in COLUMNS if any(cell[name] for cell in cells)]
    return [
        f"| {' | '.join(shown)} |",
        f"|---{'|--:' * (len(shown) - 1)}|",
        *(f"| {' | '.join(cell[name] for name in shown)} |" for cell in cells),
    ]


def _cells(row: IkRow, points: int) -> dict[str, str]:
    label = row.label if row.tolerance == TOLERANCE else f"{row.label} (within {row.tolerance:g})"
    fewer = "" if row.samples == points else f" ({row.samples:,} targets)"
    return {
        "method": label + fewer,
        "mean": _ms(row.mean_ms),
        "median": _ms(row.median_ms),
        "p99.9": _ms(row.p999_ms),
        "batch mean": _ms(row.batch_ms),
        "success": _share(row.success),
        "worst position": _error(row.position_error, "m"),
        "worst rotation": _error(row.rotation_error, "rad"),
        "false yes": str(row.false_yes),
        "largest step": "" if row.largest_step is None else f"{row.largest_step:.3g}",
        "textbook mean": "" if row.textbook_ms is None else f"{row.textbook_ms:g}",
        "textbook success": "" if row.textbook_success is None else f"{100 * row.textbook_success:g} %",
        "times ours": "" if row.ratio is None else f"{row.ratio:.3g}",
    }


def success_markdown(rows: Sequence[SuccessRow]) -> str:
    """The big check."""
    every = f"{rows[0].samples:,} random configurations an arm, whole poses, one thread:"
    again = any(row.found_again is not None for row in rows)
    head = [
        "arm",
        "method",
        "success",
        "false yes",
        "batch mean, us",
        *(["its own q among the answers"] if again else []),
    ]
    lines = [every, "", f"| {' | '.join(head)} |", f"|---|---{'|--:' * (len(head) - 2)}|"]
    for row in rows:
        cells = [row.robot, row.label, _share(row.success), str(row.false_yes), f"{row.batch_us:.2f}"]
        if again:
            cells.append("" if row.found_again is None else _share(row.found_again))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _left_out(table: IkTable, robot: str) -> list[str]:
    reasons = table.left_out.get(robot, {})
    return ["Left out:", "", *(f"- {name}: {reason}" for name, reason in reasons.items())] if reasons else []


def _ms(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"


def _share(value: float) -> str:
    """Never rounded up to 100 %: five digits of what failed."""
    return "100 %" if value == 1.0 else f"{min(100 * value, 99.999):.3f}".rstrip("0").rstrip(".") + " %"


def _error(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:.1e} {unit}"


def _bound(value: float | None) -> str:
    return "unbounded" if value is None else f"{value:.4g}"
