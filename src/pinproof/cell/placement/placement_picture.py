"""The heat map of a search for a placement as a picture."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from pinproof.cell.placement.heat_map import PlacementMap
from pinproof.cell.placement.region import Placement, PlacementRegion
from pinproof.common import theme
from pinproof.spatial import Array

RED, GREY, WHITE, INK = (theme.COLOURS[name] for name in ("bad", "line", "paper", "ink"))


def heat_map_picture(
    grid: PlacementMap,
    region: PlacementRegion,
    judged: Sequence[Placement],
    *,
    best: bool,
) -> bytes:
    """A PNG with the share of picks that pass the screening and the estimated cycle time, one row per choice.

    ``best`` states whether every pick is good at the first of the ``judged`` placements.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 4.2 * len(grid.choices) + 0.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(grid.choices), 2, squeeze=False)
    bounds = zip(grid.axes[:2], (region.x, region.y), strict=True)
    x, y = (_edges(axis, ends) for axis, ends in bounds)
    for number, name in enumerate(grid.choices):
        share = grid.over_floor(grid.share, number)
        seconds = grid.over_floor(grid.seconds, number, np.nanmin)
        for panel, values, label, colours, limits in (
            (panels[number][0], share, "share of picks that pass screening", "viridis", (0.0, 1.0)),
            (panels[number][1], seconds, "estimated cycle time [s]", "viridis_r", (None, None)),
        ):
            if np.isfinite(values).any():
                image = panel.pcolormesh(x, y, values.T, cmap=colours, vmin=limits[0], vmax=limits[1])
                figure.colorbar(image, ax=panel, label=label, shrink=0.85)
            else:
                panel.text(0.5, 0.5, f"no {label.split(' [')[0]}", transform=panel.transAxes, ha="center", zorder=3,
                           bbox={"facecolor": WHITE, "edgecolor": GREY})  # fmt: skip
            _mark(panel, [at for at in judged if at.choice == name], judged[0] if best else None)
            panel.set(
                xlim=(x[0], x[-1]), ylim=(y[0], y[-1]), aspect="equal", facecolor=GREY,
                xlabel="x of the base [m]", ylabel="y of the base [m]",
            )  # fmt: skip
            panel.set_title(name or "best over z and yaw", fontsize=10)
    star = "star, best certified; " if best else ""
    circle = "circle, judged; " if len(judged) > best else ""
    figure.suptitle(f"Placements of the base: {star}{circle}grey, no placement", fontsize=11)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()


def _mark(panel: Any, judged: Sequence[Placement], best: Placement | None) -> None:
    for at in judged:
        star = at is best
        panel.plot(
            at.x, at.y, "*" if star else "o", color=RED if star else WHITE, markeredgecolor=INK,
            markersize=15 if star else 6, clip_on=False, zorder=3 if star else 2,
        )  # fmt: skip


def _edges(centres: Array, bounds: Sequence[float]) -> Array:
    """The edges of cells with these centres; a single cell without extent is drawn 1 cm wide."""
    low, high = bounds
    if high <= low:
        return np.array([low - 0.005, low + 0.005])
    return np.linspace(low, high, len(centres) + 1)
