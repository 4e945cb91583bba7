"""The picture beside the table of planning: how many problems have a safe answer within a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pinproof.benchmarks.ik_plots import new_figure
from pinproof.benchmarks.plan_table import PlanTable

__all__ = ["write_time_plot"]

COLUMNS = 2

STYLES = ("C0-", "C1--", "C1-", "C3-", "C2-", "C4-")


def write_time_plot(table: PlanTable, path: str | Path) -> None:
    """The share of problems with a safe motion against the total time as PNG, a panel a collection.

    A line ends below 100 % where a method found nothing, or what it found hits something.
    """
    rows = -(-len(table.collections) // COLUMNS)
    columns = min(COLUMNS, len(table.collections))
    figure, panels = new_figure(rows, columns, width=5.2, height=3.8)
    for index, panel in enumerate(panels.flat):
        if index >= len(table.collections):
            panel.set_axis_off()
            continue
        collection = table.collections[index]
        asked = max((f.asked for m in table.methods if (f := table.figures(m, collection)) is not None), default=0)
        panel.set_title(f"{collection}: {asked} problems", fontsize=10)
        for style, method in zip(STYLES, table.methods, strict=False):
            answered = [row for row in table.rows if (row.collection, row.method) == (collection, method)]
            if not answered:
                continue
            times = np.sort([row.total for row in answered if row.safe])
            unsafe = sum(bool(row.faults) for row in answered)
            share = 100 * np.arange(1, len(times) + 1) / len(answered)
            label = f"{answered[0].label} ({unsafe} unsafe)"
            panel.step(times, share, style, where="post", label=label, linewidth=1.6)
        panel.set_xscale("log")
        panel.set_ylim(0, 104)
        panel.set_xlabel("total time, ms")
        panel.set_ylabel("safe motions, % of problems")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.17))
    figure.savefig(path, dpi=110, format="png")
