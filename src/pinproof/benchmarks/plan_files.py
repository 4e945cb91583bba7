"""What a run of the table of planning leaves in a folder."""

from __future__ import annotations

from pathlib import Path

from pinproof.benchmarks.plan_markdown import plan_markdown
from pinproof.benchmarks.plan_plots import write_time_plot
from pinproof.benchmarks.plan_table import PlanTable
from pinproof.common.files import write_text_whole

__all__ = ["write_plan_table"]


def write_plan_table(table: PlanTable, folder: str | Path) -> list[Path]:
    """Write ``planning.json``, ``planning.md`` and, if there are answers, ``planning.png``.

    Returns the files written. The folder must exist.
    """
    folder = Path(folder)
    data, page, picture = folder / "planning.json", folder / "planning.md", folder / "planning.png"
    table.save(data)
    write_text_whole(page, "# Planning: the table\n\n" + plan_markdown(table))
    if not table.rows:
        return [data, page]
    write_time_plot(table, picture)
    return [data, page, picture]
