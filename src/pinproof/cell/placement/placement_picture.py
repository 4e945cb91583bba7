"""The heat map of a search for a placement as a picture."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placement.heat_map import EmptyCell, PlacementMap, SlowCell
from pinproof.cell.placement.region import Placement, PlacementRegion
from pinproof.spatial import Array

Mask = npt.NDArray[np.bool_]

RED, BLACK, GREY = "#b3191f", "#1c1c1c", "#d9d9d9"


def heat_map_picture(
    grid: PlacementMap,
    region: PlacementRegion,
    empty_cells: Sequence[EmptyCell],
    slow_cells: Sequence[SlowCell],
    judged: Sequence[Placement],
    *,
    best: bool,
) -> bytes:
    """A PNG with the share of picks that work and the estimated cycle time over the floor, one row per choice.

    A cell of the floor is hatched if what is proven holds for all its z and yaw. ``best`` states whether every pick is
    good at the first of the ``judged`` placements.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 4.2 * len(grid.choices) + 0.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(grid.choices), 2, squeeze=False)
    bounds = zip(grid.axes[:2], (region.x, region.y), strict=True)
    x, y = (_edges(axis, ends) for axis, ends in bounds)
    empty = _columns(grid, grid.within(empty_cells))
    slower = _columns(grid, grid.within((*empty_cells, *slow_cells))) & ~empty
    for number, name in enumerate(grid.choices):
        share = grid.over_floor(grid.share, number)
        seconds = grid.over_floor(grid.seconds, number, np.nanmin)
        for panel, values, label, colours, limits in (
            (panels[number][0], share, "share of picks that work", "viridis", (0.0, 1.0)),
            (panels[number][1], seconds, "estimated cycle time [s]", "viridis_r", (None, None)),
        ):
            if np.isfinite(values).any():
                image = panel.pcolormesh(x, y, values.T, cmap=colours, vmin=limits[0], vmax=limits[1])
                figure.colorbar(image, ax=panel, label=label, shrink=0.85)
            else:
                panel.text(0.5, 0.5, f"no {label.split(' [')[0]}", transform=panel.transAxes, ha="center", zorder=3,
                           bbox={"facecolor": "white", "edgecolor": GREY})  # fmt: skip
            _hatch(panel, x, y, empty[number], "//", RED)
            _hatch(panel, x, y, slower[number], "..", BLACK)
            _mark(panel, [at for at in judged if at.choice == name], judged[0] if best else None)
            panel.set(
                xlim=(x[0], x[-1]), ylim=(y[0], y[-1]), aspect="equal", facecolor=GREY,
                xlabel="x of the base [m]", ylabel="y of the base [m]",
            )  # fmt: skip
            panel.set_title(name or "best over z and yaw", fontsize=10)
    proven = "; lines: proven to have no placement" if empty.any() else ""
    proven += "; dots: proven to have none that is faster" if slower.any() else ""
    star = "star, best certified; " if best else ""
    circle = "circle, judged; " if len(judged) > best else ""
    figure.suptitle(f"Placements of the base: {star}{circle}grey, no placement{proven}", fontsize=11)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()


def _columns(grid: PlacementMap, mask: Mask) -> Mask:
    """(choices, nx, ny) whether a mask (N,) holds for every z and yaw."""
    columns = mask.reshape(len(grid.choices), len(grid.axes[0]), len(grid.axes[1]), -1)
    return np.asarray(columns.all(axis=3))


def _hatch(panel: Any, x: Array, y: Array, cells: Mask, hatch: str, colour: str) -> None:
    from matplotlib.patches import Rectangle

    for i, j in np.argwhere(cells):
        width, depth = x[i + 1] - x[i], y[j + 1] - y[j]
        panel.add_patch(Rectangle((x[i], y[j]), width, depth, fill=False, hatch=hatch, edgecolor=colour, lw=0))


def _mark(panel: Any, judged: Sequence[Placement], best: Placement | None) -> None:
    for at in judged:
        star = at is best
        panel.plot(
            at.x, at.y, "*" if star else "o", color=RED if star else "white", markeredgecolor="black",
            markersize=15 if star else 6, clip_on=False, zorder=3 if star else 2,
        )  # fmt: skip


def _edges(centres: Array, bounds: Sequence[float]) -> Array:
    """The edges of cells with these centres; a single cell without extent is drawn 1 cm wide."""
    low, high = bounds
    if high <= low:
        return np.array([low - 0.005, low + 0.005])
    return np.linspace(low, high, len(centres) + 1)
