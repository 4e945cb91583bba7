"""The table of the IK benchmark: its rows, its Markdown page and its plot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from pinproof.benchmarks.ik_methods import PARTS, TOLERANCE, Part
from pinproof.benchmarks.tables import (
    BenchmarkTable,
    log_panel,
    new_figure,
    provenance_text,
    row_table,
    save_figure,
    wrapped,
)

MARKERS = "osD^vP*X<>ph"


@dataclass(frozen=True)
class IkRow:
    """The figures of a method in one part of the table; times in ms, errors in m and rad, shares from 0 to 1.

    Times are those of single calls from Python; ``batch_ms`` is the mean time per target of one batch on one thread.
    ``success`` is the share of targets whose answers are inside the limits and within ``tolerance`` by Pinocchio's
    forward kinematics, the lower one of single calls and batch. ``position_error`` and ``rotation_error`` are the
    largest of all reported answers; ``false_positives`` counts answers that are reported as solutions and fail this
    check. ``largest_step`` is the largest joint motion (rad or m) between consecutive answers on the trajectory.
    ``ratio``, for another library, is its mean time divided by that of our method ``compared_with``.
    """

    robot: str
    method: str
    label: str
    problem: str
    task: str
    restarts: bool
    samples: int
    mean_ms: float
    median_ms: float
    p999_ms: float
    batch_ms: float | None
    success: float
    position_error: float | None
    rotation_error: float | None
    false_positives: int
    largest_step: float | None
    tolerance: float
    textbook_ms: float | None = None
    textbook_success: float | None = None
    compared_with: str | None = None
    ratio: float | None = None

    @property
    def robot_and_part(self) -> tuple[str, str, str, bool]:
        """The robot and its part of the table, which identify the targets of the row."""
        return self.robot, self.problem, self.task, self.restarts


@dataclass(frozen=True)
class IkTable(BenchmarkTable):
    """The rows of every robot, part and method, and for each robot why methods could not be run."""

    rows: tuple[IkRow, ...]
    left_out: dict[str, dict[str, str]]

    topic: ClassVar[str] = "inverse kinematics"
    row_types: ClassVar[dict[str, type]] = {"rows": IkRow}

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots in the order of the run."""
        return tuple(self.settings["robots"])

    def part(self, robot: str, part: Part) -> tuple[IkRow, ...]:
        """Return the rows of a robot in one part."""
        return tuple(row for row in self.rows if row.robot_and_part == (robot, part.problem, part.task, part.restarts))


def write_ik_table(table: IkTable, folder: str | Path, *, appendix: str = "") -> list[Path]:
    """Write ``ik.json``, ``ik.md``, which ends with ``appendix``, and ``ik_latency.png``; return these files."""
    written = table.write(folder, "ik", "# Inverse kinematics benchmark\n\n" + ik_markdown(table) + appendix)
    return [*written, save_figure(_latency_plot(table), Path(folder) / "ik_latency.png")]


# -- Markdown ----------------------------------------------------------------------------------------------------------


def ik_markdown(table: IkTable) -> str:
    """Return the table as Markdown, without a title."""
    lines = [*_introduction(table), ""]
    for robot in table.robots:
        lines += [f"## {robot}", "", *_limits(table, robot), ""]
        for part in PARTS:
            rows = table.part(robot, part)
            if rows:
                columns = {"method": partial(_name, table), **COLUMNS}
                lines += [f"### {robot}: {part}", "", *row_table(columns, rows), ""]
        reasons = table.left_out.get(robot, {})
        if reasons:
            lines += ["Left out:", "", *(f"- {name}: {reason}" for name, reason in reasons.items()), ""]
    return "\n".join(lines).rstrip() + "\n"


def _introduction(table: IkTable) -> list[str]:
    settings = table.settings
    targets = (
        f"{settings['points']:,} targets per part, joint limits enforced, {settings['limits']}. Random targets are the "
        "poses of configurations drawn uniformly within the limits; each solve starts from the middle of the joint "
        f"ranges. Methods with restarts may restart up to {settings['restarts']} times."
    )
    check = (
        "A target counts as solved if the answer is inside the limits and within "
        f"{settings['tolerance']:g} m and {settings['tolerance']:g} rad (or the tolerance given in the row) by "
        "Pinocchio's forward kinematics, independent of the status that the method reports. A false positive is "
        "reported as solved but fails this independent check."
    )
    times = (
        "Times are in ms, for single calls from Python including all overhead; the batch mean is the time per target "
        f"of one batch on one thread. p99.9 is the 99.9th percentile of {settings['points']:,} calls (with fewer than "
        "1,000 calls it is the maximum). For other libraries, the relative time is their mean time divided by that of "
        "our method for the same problem."
    )
    textbook = (
        "The textbook columns are figures from the textbook: mean time and success over 10,000 points, position only, "
        "one seed, on an unknown machine."
    )
    return [*wrapped(targets, check, times), "", *wrapped(provenance_text(table), textbook)]


def _limits(table: IkTable, robot: str) -> list[str]:
    def bound(value: float | None) -> str:
        return "unbounded" if value is None else f"{value:.4g}"

    chain = table.settings["chains"][robot]
    ranges = [
        f"{name} {bound(low)} to {bound(high)}"
        for name, low, high in zip(chain["joints"], chain["lower"], chain["upper"], strict=True)
    ]
    return wrapped(f"TCP: {chain['tcp']}. Limits (rad, m): {', '.join(ranges)}.")


def percent(value: float | None) -> str:
    """Return a share in percent, with at most three decimals and never rounded up to 100 %; empty for None."""
    if value is None:
        return ""
    return "100 %" if value == 1.0 else f"{min(100 * value, 99.999):.3f}".rstrip("0").rstrip(".") + " %"


def _name(table: IkTable, row: IkRow) -> str:
    label = row.label if row.tolerance == TOLERANCE else f"{row.label} (within {row.tolerance:g})"
    return label if row.samples == table.settings["points"] else f"{label} ({row.samples:,} targets)"


def _milliseconds(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"


COLUMNS: dict[str, str | Callable[[IkRow], str]] = {
    "mean": lambda row: _milliseconds(row.mean_ms),
    "median": lambda row: _milliseconds(row.median_ms),
    "p99.9": lambda row: _milliseconds(row.p999_ms),
    "batch mean": lambda row: _milliseconds(row.batch_ms),
    "success": lambda row: percent(row.success),
    "max position error": "{.position_error:.1e} m",
    "max rotation error": "{.rotation_error:.1e} rad",
    "false positives": "{.false_positives}",
    "largest step": "{.largest_step:.3g}",
    "textbook mean": "{.textbook_ms:g}",
    "textbook success": lambda row: percent(row.textbook_success),
    "relative time": "{.ratio:.3g}",
}
"""The columns after the method: their titles, and the format of a row."""


# -- plot --------------------------------------------------------------------------------------------------------------


def _latency_plot(table: IkTable) -> Any:
    """Success against mean time: one row of panels per robot; filled: single calls, hollow: batches.

    Crosses are the figures of the textbook; a dotted line connects them with our figures of the same method.
    """
    styles: dict[str, tuple[str, str]] = {}
    figure, panels = new_figure(len(table.robots), len(PARTS), width=3.4, height=3.0)
    for robot, line in zip(table.robots, panels, strict=True):
        for part, panel in zip(PARTS, line, strict=True):
            restarts = "" if part.problem == "trajectory" else ", restarts" if part.restarts else ", one seed"
            log_panel(panel, f"{robot}: {part.problem}, {part.task}{restarts}", "mean time, ms", "solved, %")
            for row in table.part(robot, part):
                k = len(styles)
                _plot_row(panel, row, *styles.setdefault(row.label, (f"C{k % 10}", MARKERS[k % len(MARKERS)])))
    first = panels[0][0]
    for label, (colour, marker) in styles.items():
        first.plot([], [], marker, color=colour, label=label)
    first.plot([], [], "x", color="grey", label="textbook")
    first.plot([], [], "o", color="grey", fillstyle="none", label="hollow: batch")
    figure.legend(loc="outside lower center", ncols=6, fontsize=8)
    return figure


def _plot_row(panel: Any, row: IkRow, colour: str, marker: str) -> None:
    solved = 100 * row.success
    if row.textbook_ms is not None and row.textbook_success is not None:
        textbook = 100 * row.textbook_success
        panel.plot((row.textbook_ms, row.mean_ms), (textbook, solved), ":", color=colour, linewidth=0.8)
        panel.plot(row.textbook_ms, textbook, "x", color=colour)
    if row.batch_ms is not None:
        panel.plot(row.batch_ms, solved, marker, color=colour, fillstyle="none")
    panel.plot(row.mean_ms, solved, marker, color=colour)
