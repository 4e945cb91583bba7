"""What a run of the table of collision checks leaves in a folder."""

from __future__ import annotations

from pathlib import Path

from pinproof.benchmarks.collision_markdown import collision_markdown
from pinproof.benchmarks.collision_table import CollisionTable
from pinproof.benchmarks.ik_plots import new_figure
from pinproof.common.files import write_text_whole

__all__ = ["write_collision_table", "write_growth_plot"]

LINES = (
    ("is_free", "pinproof, is_free", "C0"),
    ("coal", "coal through Pinocchio, every pair", "C3"),
    ("coal_tree", "coal through Pinocchio, its tree of boxes", "C1"),
)


def write_collision_table(table: CollisionTable, folder: str | Path) -> list[Path]:
    """Write ``collision.json``, ``collision.md`` and, where boxes were counted, ``collision.png``.

    Returns the files written. The folder must exist.
    """
    folder = Path(folder)
    data, page, picture = folder / "collision.json", folder / "collision.md", folder / "collision.png"
    table.save(data)
    write_text_whole(page, "# Collision checks and proofs: the table\n\n" + collision_markdown(table))
    if not table.growth:
        return [data, page]
    write_growth_plot(table, picture)
    return [data, page, picture]


def write_growth_plot(table: CollisionTable, path: str | Path) -> None:
    """The time of a check against the number of boxes as PNG: at free configurations, and at those in contact."""
    figure, ((panel,),) = new_figure(1, 1, width=7.2, height=4.6)
    counts = [int(row.scene.partition(": ")[2].replace(",", "")) for row in table.growth]
    for name, label, colour in LINES:
        times = [getattr(row, name) for row in table.growth]
        panel.plot(counts, [each.free for each in times], "o-", color=colour, label=f"{label}: free")
        panel.plot(
            counts, [each.colliding for each in times], "s--", color=colour, fillstyle="none", label="... in contact"
        )
    first = table.growth[0].is_free.free
    if first is not None:
        panel.plot(counts, [first * count / counts[0] for count in counts], ":", color="grey", label="in proportion")
        panel.set_ylim(first / 3, None)
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xticks(counts, [f"{count:,}" for count in counts])
    panel.set_xlabel("boxes around the arm")
    panel.set_ylabel("mean of a single check, us")
    panel.set_title(f"{table.growth[0].robot}: the cost of a check among more and more boxes", fontsize=10)
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8, loc="upper left")
    figure.savefig(path, dpi=110, format="png")
