"""Slices of a grid as one picture, from the lowest to the highest."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.picks.reach.region import ReachRegion

__all__ = ["SHARE", "WON_AND_LOST", "slices"]

MOST_SLICES = 12
"""More would be stamps; of more heights these many are picked, evenly."""

SHARE = ("viridis", 0.0, 1.0)
WON_AND_LOST = ("RdBu", -1.0, 1.0)
"""Colour map and the values at its ends."""


def slices(
    region: ReachRegion,
    values: npt.NDArray[np.float64],
    title: str,
    label: str,
    colours: tuple[str, float, float] = SHARE,
) -> bytes:
    """A PNG of ``values`` (N,) over a grid: one panel for each place along the axis with the fewest.

    Raises
    ------
    InputError
        If the region is no grid, or only a line or a point of one.
    """
    if region.axes is None:
        raise InputError("a picture shows slices of a grid, such as Region.box makes; these are single points")
    counts = [len(axis) for axis in region.axes]
    through = min((counts[k], -k) for k in range(3))[1] * -1  # of equals z, so that slices are heights
    across = [k for k in range(3) if k != through]
    if any(counts[k] < 2 for k in across):
        raise InputError("a picture needs a region that extends along two axes at least")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    grid = np.moveaxis(values.reshape(counts), through, 0)
    places = np.unique(np.linspace(0, counts[through] - 1, min(counts[through], MOST_SLICES)).round().astype(int))
    wide = int(np.ceil(np.sqrt(len(places))))
    tall = int(np.ceil(len(places) / wide))
    a, b = (region.axes[k] for k in across)
    figure = Figure(figsize=(3.4 * wide + 1.6, 3.2 * tall + 1.0), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(tall, wide, squeeze=False, sharex=True, sharey=True).ravel()
    half = [0.5 * (axis[1] - axis[0]) for axis in (a, b)]
    extent = (a[0] - half[0], a[-1] + half[0], b[0] - half[1], b[-1] + half[1])
    names = "xyz"
    for panel, place in zip(panels, places, strict=False):
        image = panel.imshow(
            grid[place].T, origin="lower", extent=extent, cmap=colours[0], vmin=colours[1], vmax=colours[2]
        )
        panel.set_title(f"{names[through]} = {region.axes[through][place]:.3f} m", fontsize=10)
        panel.plot(0.0, 0.0, "+", color="black", markersize=9) if through == 2 else None
    for panel in panels[len(places) :]:
        panel.set_visible(False)
    figure.supxlabel(f"{names[across[0]]} [m]")
    figure.supylabel(f"{names[across[1]]} [m]")
    figure.suptitle(title, fontsize=11)
    figure.colorbar(image, ax=panels.tolist(), label=label, shrink=0.8)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()
