"""Height maps as closed triangle meshes: coal's own height fields know no distance, and nothing against meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision.array_shapes import HeightMap

__all__ = ["Ground", "ground_surface"]

Array = npt.NDArray[np.float64]


def ground_surface(ground: HeightMap) -> tuple[Array, npt.NDArray[np.int64]]:
    """The closed surface of a height map: vertices (V, 3) and triangles (F, 3) that turn left seen from outside."""
    rows, columns = ground.heights.shape
    x, y = np.meshgrid(
        np.linspace(-ground.x / 2, ground.x / 2, columns), np.linspace(-ground.y / 2, ground.y / 2, rows)
    )
    top = np.stack([x, y, ground.heights], axis=-1).reshape(-1, 3)
    under = np.stack([x, y, np.full_like(x, ground.bottom)], axis=-1).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    ridge = _ridge_ac(ground.heights).ravel()[:, None]
    first = np.where(ridge, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(ridge, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    upper = np.concatenate([first, second])
    rim = np.concatenate([index[0], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]])  # round the edge, to the left
    onward, down = np.roll(rim, -1), len(top)
    walls = np.concatenate([np.stack([rim + down, onward + down, onward], 1), np.stack([rim + down, onward, rim], 1)])
    return np.concatenate([top, under]), np.concatenate([upper, upper[:, ::-1] + down, walls])


@dataclass(frozen=True, eq=False)
class Ground:
    """What lies in a height map."""

    ground: HeightMap

    @property
    def watertight(self) -> bool:
        """The ground is solid."""
        return True

    @property
    def witnesses(self) -> Array:
        """(1, 3) one corner: the surface hangs together."""
        return np.array([[-self.ground.x / 2, -self.ground.y / 2, self.ground.bottom]])

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3) lies between bottom and surface."""
        ground = self.ground
        sides = np.array([ground.x, ground.y])
        under = points[(np.abs(points[:, :2]) <= sides / 2).all(axis=1) & (points[:, 2] >= ground.bottom)]
        if len(under) == 0:
            return False
        rows, columns = ground.heights.shape
        grid = (under[:, :2] / sides + 0.5) * [columns - 1, rows - 1]
        cell = np.minimum(grid.astype(np.int64), [columns - 2, rows - 2])
        (s, t), (i, j) = (grid - cell).T, cell.T
        h = ground.heights
        a, b, c, d = h[j, i], h[j, i + 1], h[j + 1, i + 1], h[j + 1, i]
        along_ac = a + np.where(s > t, (b - a) * s + (c - b) * t, (c - d) * s + (d - a) * t)
        along_bd = np.where(s + t < 1, a + (b - a) * s + (d - a) * t, c + (d - c) * (1 - s) + (b - c) * (1 - t))
        height = np.where(_ridge_ac(h)[j, i], along_ac, along_bd)
        return bool((under[:, 2] <= height).any())

    def content(self) -> bytes:
        """The numbers it is made of."""
        ground = self.ground
        return repr((ground.heights.shape, ground.x, ground.y, ground.bottom)).encode() + ground.heights.tobytes()


def _ridge_ac(heights: Array) -> npt.NDArray[np.bool_]:
    """(ny - 1, nx - 1) whether the cut of a cell from its low-x, low-y corner is the higher one in its middle."""
    return np.asarray(heights[:-1, :-1] + heights[1:, 1:] >= heights[:-1, 1:] + heights[1:, :-1])
