"""The screened grid of a search for a placement."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placement.region import AXES
from pinproof.common.files import csv_text, figure
from pinproof.common.structs import OPTIONAL_NUMBER, PLAIN_NUMBER, Written, key, list_of, reported, struct
from pinproof.common.validation import freeze_arrays
from pinproof.spatial import Array
from pinproof.viewer import ColouredPoints

Mask = npt.NDArray[np.bool_]


GRID = list_of(list_of(OPTIONAL_NUMBER))


@struct("floor_map", more=True, written=True, eq=False)
class FloorMap:
    """The best values over z and yaw at each x and y, for one choice; null where no value exists."""

    choice: str = key("name of the discrete choice")
    share: Array = key("share of the picks that pass the screening, for each x a list over y", kind=GRID)
    seconds: Array = key("estimated cycle time", "s", kind=GRID)


@struct("placement_map", more=True, written=True, eq=False)
class PlacementMap(Written):
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

    def __repr__(self) -> str:
        return f"PlacementMap({len(self):,} placements, all picks pass the screening at {self.feasible.sum():,})"

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
