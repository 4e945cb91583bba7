"""Where a reach map looks: a grid of points over a box or a face of one, or points of one's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.spatial import finite

__all__ = ["MOST_POINTS", "ReachRegion"]

Array = npt.NDArray[np.float64]

MOST_POINTS = 5_000_000
"""A grid of more is taken for a step given in millimetres."""


@dataclass(frozen=True, eq=False)
class ReachRegion:
    """Points in the frame of the robot's root link.

    Parameters
    ----------
    points
        (N, 3) in metres.
    axes
        The coordinates of a grid along x, y and z, whose points come with z running fastest; None for single points.

    Raises
    ------
    InputError
        If there is no point, or a number is not finite.
    """

    points: Array
    axes: tuple[Array, Array, Array] | None = field(default=None)

    def __post_init__(self) -> None:
        points = finite("points", self.points, (None, 3))
        if not len(points):
            raise InputError("points is empty; a region needs at least one")
        points.flags.writeable = False
        object.__setattr__(self, "points", points)

    @classmethod
    def box(cls, lower: npt.ArrayLike, upper: npt.ArrayLike, step: float) -> ReachRegion:
        """A grid over the box from ``lower`` to ``upper`` (3,), both included.

        Equal coordinates make it a surface, a line or a point. The points are evenly spread, ``step`` (m) apart at
        most.

        Raises
        ------
        InputError
            If an upper corner lies below a lower one, the step is not above 0, or the points are too many.
        """
        low, high = finite("lower", lower, (3,)), finite("upper", upper, (3,))
        for name, a, b in zip("xyz", low, high, strict=True):
            if b < a:
                raise InputError(f"the region's upper {name} = {b} lies below its lower {name} = {a}")
        if not 0.0 < step < np.inf:
            raise InputError(f"step = {step}; it is a distance in metres, above 0")
        # a side that is a multiple of the step but for rounding gets no further point
        counts = [int(np.ceil((b - a) / step * (1.0 - 1e-12))) + 1 for a, b in zip(low, high, strict=True)]
        if np.prod([float(count) for count in counts]) > MOST_POINTS:
            raise InputError(
                f"a step of {step} m makes {' x '.join(map(str, counts))} points, above {MOST_POINTS}; "
                "take a larger one"
            )
        x, y, z = (np.linspace(a, b, count) for a, b, count in zip(low, high, counts, strict=True))
        grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
        return cls(grid.reshape(-1, 3), (x, y, z))

    @property
    def shape(self) -> tuple[int, ...]:
        """The numbers of points along x, y and z of a grid; (N,) of single points."""
        return (len(self.points),) if self.axes is None else tuple(len(axis) for axis in self.axes)

    def equals(self, other: ReachRegion) -> bool:
        """Whether both hold the same points in the same order."""
        return bool(np.array_equal(self.points, other.points))

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"Region({' x '.join(map(str, self.shape))} points)"

    @staticmethod
    def along(values: Sequence[Array]) -> tuple[Array, Array, Array]:
        """Three axes out of a file."""
        x, y, z = (np.array(axis, dtype=float) for axis in values)
        return x, y, z
