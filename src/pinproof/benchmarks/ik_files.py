"""What a run of the table leaves in a folder."""

from __future__ import annotations

from pathlib import Path

from pinproof.benchmarks.ik_markdown import ik_markdown
from pinproof.benchmarks.ik_plots import write_latency_plot, write_step_plot
from pinproof.benchmarks.ik_table import IkTable
from pinproof.benchmarks.step_sizes import step_sizes
from pinproof.common.files import write_text_whole
from pinproof.model import load_robot

__all__ = ["write_ik_table"]


def write_ik_table(table: IkTable, folder: str | Path) -> list[Path]:
    """Write ``ik.json``, ``ik.md``, ``ik_latency.png``, and ``ik_steps.png`` of the first robot that has such a plot.

    Returns the files written. The folder must exist.
    """
    folder = Path(folder)
    data, page, latency = folder / "ik.json", folder / "ik.md", folder / "ik_latency.png"
    table.save(data)
    write_text_whole(page, "# Inverse kinematics: the table\n\n" + ik_markdown(table))
    write_latency_plot(table, latency)
    written = [data, page, latency]
    for robot in table.robots:
        steps = step_sizes(load_robot(robot).arm())
        if steps is not None:
            written.append(folder / "ik_steps.png")
            write_step_plot(steps, robot, written[-1])
            break
    return written
