"""The screened grid of a search for a placement, as a table and as a picture."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placement.region import AXES, Placement, PlacementRegion
from pinproof.common import theme
from pinproof.common.files import csv_text, figure
from pinproof.common.results import Shown, View, Written
from pinproof.common.structs import OPTIONAL_NUMBER, PLAIN_NUMBER, key, list_of, reported, struct
from pinproof.common.validation import freeze_arrays
from pinproof.spatial import Array
from pinproof.viewer import ColouredPoints

RED, GREY, WHITE, INK = (theme.COLOURS[name] for name in ("bad", "line", "paper", "ink"))

Mask = npt.NDArray[np.bool_]


GRID = list_of(list_of(OPTIONAL_NUMBER))


@struct("floor_map", more=True, written=True, eq=False)
class FloorMap:
    """The best values over z and yaw at each x and y, for one choice; null where no value exists."""

    choice: str = key("name of the discrete choice")
    share: Array = key("share of the picks that pass the screening, for each x a list over y", kind=GRID)
    seconds: Array = key("estimated cycle time", "s", kind=GRID)


@struct("placement_map", more=True, written=True, eq=False)
class PlacementMap(Shown, Written):
    """The heat map over the floor: the screened grid of placements."""

    placements: Array = key("(N, 4) x, y, z, yaw", hidden=True)
    choices: tuple[str, ...] = key("the names of the discrete choices", hidden=True)
    choice: npt.NDArray[np.int64] = key("(N,) index of the choice of each placement", hidden=True)
    axes: tuple[Array, Array, Array, Array] = key(
        "the values of x, y, z and yaw of the grid, in which yaw varies fastest", hidden=True
    )
    base: Mask = key("(N,) whether the base and the arm at home are free", hidden=True)
    codes: npt.NDArray[np.int8] = key(
        "(N, P) codes of :class:`~pinproof.picks.ScreenStatus` of each pick at its worst pose: grasp, release, and the "
        "ends of the straight lines",
        hidden=True,
    )
    share: Array = key("(N,) share of the picks that pass the screening, from 0 to 1", hidden=True)
    seconds: Array = key("(N,) estimated cycle time; NaN where a pick does not pass", "s", hidden=True)
    estimate: Array = key("(N,) estimated value of the objective; NaN where a pick does not pass", hidden=True)

    def __post_init__(self) -> None:
        freeze_arrays(self, "placements", "choice", "base", "codes", "share", "seconds", "estimate")

    def __len__(self) -> int:
        return len(self.placements)

    def _view(self) -> View:
        return View(f"{len(self):,} placements, all picks pass the screening at {self.feasible.sum():,}")

    @property
    @reported("m", kind=list_of(PLAIN_NUMBER))
    def x(self) -> Array:
        """The x of the grid."""
        return self.axes[0]

    @property
    @reported("m", kind=list_of(PLAIN_NUMBER))
    def y(self) -> Array:
        """The y of the grid."""
        return self.axes[1]

    @property
    @reported(name="choices")
    def floors(self) -> tuple[FloorMap, ...]:
        """The maps of all choices."""
        return tuple(
            FloorMap(name, self.over_floor(self.share, number), self.over_floor(self.seconds, number, np.nanmin))
            for number, name in enumerate(self.choices)
        )

    @property
    def feasible(self) -> Mask:
        """(N,) placements at which every pick passes the screening."""
        return np.asarray(np.isfinite(self.estimate))

    def over_floor(self, values: Array, choice: int, best: Any = np.nanmax) -> Array:
        """(nx, ny) the best of values (N,) over z and yaw at each x and y; NaN where no value exists."""
        grid = values[self.choice == choice].reshape(*(len(axis) for axis in self.axes))
        flat = grid.reshape(*grid.shape[:2], -1)
        known = np.isfinite(flat).any(axis=2)
        out = np.full(known.shape, np.nan)
        out[known] = best(flat[known], axis=1)
        return out

    def floor_points(self, *, choice: int = 0, seconds: bool = False, height: float = 0.0) -> ColouredPoints:
        """The map as points on the floor of the cell, for the page of a sequence.

        Parameters
        ----------
        choice
            The index of the discrete choice.
        seconds
            Whether to show the estimated cycle time instead of the share of the picks that pass.
        height
            The z of the points in the frame of the cell, in metres.
        """
        values = self.over_floor(self.seconds if seconds else self.share, choice, np.nanmin if seconds else np.nanmax)
        x, y = np.meshgrid(self.axes[0], self.axes[1], indexing="ij")
        known = np.isfinite(values)
        xyz = np.column_stack([x[known], y[known], np.full(int(known.sum()), height)])
        steps = [float(axis[1] - axis[0]) for axis in self.axes[:2] if len(axis) > 1]
        label = "estimated cycle time [s]:" if seconds else "share of picks that pass the screening:"
        shown, size = values[known], 0.4 * min(steps, default=0.05)
        low, high = (float(shown.min(initial=np.inf)), float(shown.max(initial=-np.inf))) if seconds else (0.0, 1.0)
        if not low < high:  # none or one value
            low, high = 0.0, max(high, 1.0)
        return ColouredPoints.of_values(xyz, shown, label=label, low=low, high=high, size=size)

    def to_csv(self) -> str:
        """One row per placement: its values, whether the base is free, the share of picks, and the estimates."""
        figures = np.column_stack([self.share, self.seconds, self.estimate])
        columns = (self.choice.tolist(), self.placements.tolist(), self.base.tolist(), figures.tolist())
        rows = (
            (self.choices[number], *map(figure, values), int(base), *map(figure, row))
            for number, values, base, row in zip(*columns, strict=True)
        )
        return csv_text(("choice", *AXES, "base_free", "share", "estimated_seconds", "estimate"), rows)


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
    # the edges of the cells; a single cell without extent is drawn 1 cm wide
    x, y = (
        np.linspace(low, high, len(centres) + 1) if high > low else np.array([low - 0.005, low + 0.005])
        for centres, (low, high) in zip(grid.axes[:2], (region.x, region.y), strict=True)
    )
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
            for placement in judged:
                if placement.choice == name:
                    star = best and placement is judged[0]
                    panel.plot(
                        placement.x, placement.y, "*" if star else "o", color=RED if star else WHITE,
                        markeredgecolor=INK, markersize=15 if star else 6, clip_on=False, zorder=3 if star else 2,
                    )  # fmt: skip
            panel.set(
                xlim=(x[0], x[-1]), ylim=(y[0], y[-1]), aspect="equal", facecolor=GREY,
                xlabel="x of the base [m]", ylabel="y of the base [m]",
            )  # fmt: skip
            panel.set_title(name or "best over z and yaw", fontsize=10)
    legend = "star, best certified; " if best else ""
    legend += "circle, judged; " if len(judged) > best else ""
    figure.suptitle(f"Placements of the base: {legend}grey, no placement", fontsize=11)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()
