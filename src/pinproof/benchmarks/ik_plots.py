"""The pictures beside the table: latency against success, and the size of steps near a singularity."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pinproof.benchmarks.ik_table import PARTS, IkTable
from pinproof.benchmarks.step_sizes import ASKED, METHODS, StepSizes

__all__ = ["new_figure", "write_latency_plot", "write_step_plot"]

MARKS = "osD^vP*X<>ph"


def write_latency_plot(table: IkTable, path: str | Path) -> None:
    """Mean latency against success as PNG: a row of panels a robot, single calls filled, batches hollow.

    Crosses are the textbook's cells, joined to our row of the same method.
    """
    methods = list(dict.fromkeys((row.method, row.label) for row in table.rows))
    figure, panels = new_figure(len(table.robots), len(PARTS))
    for robot, line in zip(table.robots, panels, strict=True):
        for asked, panel in zip(PARTS, line, strict=True):
            panel.set_title(
                f"{robot}: {asked.problem}, {asked.task}"
                + ("" if asked.problem == "trajectory" else f", {'restarts' if asked.restarts else 'one seed'}"),
                fontsize=9,
            )
            for row in table.part(robot, asked):
                index = [key for key, _ in methods].index(row.method)
                colour, mark = f"C{index % 10}", MARKS[index % len(MARKS)]
                if row.textbook_ms is not None and row.textbook_success is not None:
                    there = (row.textbook_ms, row.mean_ms), (100 * row.textbook_success, 100 * row.success)
                    panel.plot(*there, ":", color=colour, linewidth=0.8)
                    panel.plot(row.textbook_ms, 100 * row.textbook_success, "x", color=colour)
                if row.batch_ms is not None:
                    panel.plot(row.batch_ms, 100 * row.success, mark, color=colour, fillstyle="none")
                panel.plot(row.mean_ms, 100 * row.success, mark, color=colour)
            panel.set_xscale("log")
            panel.set_ylim(-4, 104)
            panel.set_xlabel("mean, ms")
            panel.set_ylabel("solved, %")
            panel.grid(alpha=0.3)
    for index, (_, label) in enumerate(methods):
        panels[0][0].plot([], [], MARKS[index % len(MARKS)], color=f"C{index % 10}", label=label)
    panels[0][0].plot([], [], "x", color="grey", label="the textbook")
    panels[0][0].plot([], [], "o", color="grey", fillstyle="none", label="hollow: batch")
    figure.legend(loc="outside lower center", ncols=6, fontsize=8)
    figure.savefig(path, dpi=110, format="png")


def write_step_plot(steps: StepSizes, title: str, path: str | Path) -> None:
    """Step lengths against the smallest singular value as PNG."""
    figure, ((panel,),) = new_figure(1, 1, width=6.4, height=4.4)
    styles = dict(zip(METHODS, ("k:", "C0-", "C1-", "C2-"), strict=True))
    for name, lengths in steps.steps.items():
        panel.plot(steps.smallest, lengths, styles[name], label=name)
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.invert_xaxis()
    panel.set_xlabel("smallest singular value of the Jacobian")
    panel.set_ylabel(f"|dq| for a motion of {ASKED:g} (m, rad)")
    panel.set_title(f"{title}: {steps.joint} moves into a singularity", fontsize=10)
    panel.grid(alpha=0.3)
    panel.legend()
    figure.savefig(path, dpi=110, format="png")


def new_figure(rows: int, columns: int, *, width: float = 3.4, height: float = 3.0) -> tuple[Any, Any]:
    """A figure that needs no screen and no global state of matplotlib, and its panels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)
