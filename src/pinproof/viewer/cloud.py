"""Coloured points in the picture: a reach map, a scan, the places of many picks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.spatial import finite
from pinproof.viewer.wire import Commands

__all__ = ["ColouredPoints"]

Array = npt.NDArray[np.float64]

LEGEND_STEPS = 5
"""Colours that the legend names."""


@dataclass(frozen=True, eq=False)
class ColouredPoints:
    """Points and their colours.

    Parameters
    ----------
    xyz
        (N, 3) metres, in the frame of the robot's root link.
    rgb
        (N, 3) in [0, 1].
    size
        Metres: the diameter they are drawn with.
    legend
        (text, (r, g, b)) pairs that say what the colours mean.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or the size is not above 0.
    """

    xyz: Array
    rgb: Array
    size: float = 0.02
    legend: tuple[tuple[str, tuple[float, float, float]], ...] = ()

    def __post_init__(self) -> None:
        xyz = finite("xyz", self.xyz, (None, 3))
        rgb = finite("rgb", self.rgb, (len(xyz), 3))
        if len(rgb) and (rgb.min() < 0.0 or rgb.max() > 1.0):
            raise InputError("rgb holds numbers outside [0, 1]")
        if not self.size > 0:
            raise InputError(f"size = {self.size}; it is a diameter in metres, above 0")
        object.__setattr__(self, "xyz", xyz)
        object.__setattr__(self, "rgb", rgb)
        object.__setattr__(self, "legend", tuple((str(text), tuple(colour)) for text, colour in self.legend))

    @classmethod
    def of_values(
        cls, xyz: npt.ArrayLike, values: npt.ArrayLike, *, label: str, low: float = 0.0, high: float = 1.0,
        colours: str = "viridis", size: float = 0.02,
    ) -> ColouredPoints:  # fmt: skip
        """Points coloured by ``values`` (N,) between ``low`` and ``high``; ``colours`` names a map of matplotlib."""
        from matplotlib import colormaps

        map_of = colormaps[colours]
        share = (finite("values", values, (None,)) - low) / (high - low)
        steps = np.linspace(0.0, 1.0, LEGEND_STEPS)
        legend = [(f"{label} {low + (high - low) * step:.3g}", tuple(map_of(step)[:3])) for step in steps]
        return cls(np.asarray(xyz, dtype=float), map_of(share.clip(0.0, 1.0))[:, :3], size, tuple(legend))

    def draw(self, commands: Commands) -> None:
        """Add the points to a picture."""
        if len(self.xyz):
            commands.set_points("/points", self.xyz, self.rgb, self.size)
            commands.set_property("/points/<object>", "castShadow", False)
