"""The camera: the direction that shows most of the robot, and the points that the picture must contain.

The page computes the distance of the camera, because it depends on the aspect ratio of the canvas. :func:`fit` and the
page use the same closed form. With the axes of the camera fixed, each point p = (x, y, z) (right, up, towards the
camera) must satisfy |x - c_x| <= (c_z - z) t, where t is the tangent of half the angle of view. Hence c_x is between
max(x + z t) - c_z t and min(x - z t) + c_z t. The interval is not empty if c_z >= (max(x + z t) - min(x - z t)) / 2t.
The same holds for y, and the larger c_z satisfies both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.viewer.stage import DrawnObstacle, Stage
from pinproof.viewer.surfaces import Surface

__all__ = ["FIELD_OF_VIEW", "MARGIN", "View", "choose_view", "fit"]

Array = npt.NDArray[np.float64]

FIELD_OF_VIEW = 30.0
"""Vertical angle of view in degrees. A small angle limits the perspective distortion of near links."""

ASPECT = 4 / 3
"""Aspect ratio (width / height) for which directions are compared."""

GRID = (80, 60)
"""Cells of the picture for which directions are compared."""

SAMPLES = 1500
"""Sample points on the surface of each link; their spacing is smaller than a cell of GRID."""

COMPARED_INSTANTS = 3
"""Instants of the motion at which directions are compared."""

SEEN_CELLS = 2
"""A link is visible if it is in front in at least this number of cells."""

MIN_OCCLUSION = 1e-3
"""Fraction of the line of sight that must be inside a box to count as occluded."""

ENOUGH_SHARE = 0.20
"""Fraction of the picture that the robot should fill; directions that exceed it are not preferred."""

SIMILAR_MERIT = 0.985
"""The first direction in order of preference whose merit is at least this fraction of the best is used."""

MARGIN = 0.05
"""Fraction of half the canvas that is left free at its border."""

MOVING_MARGIN = 0.01
"""The same for a motion. It is smaller, because all positions of the robot over the motion must fit."""


@dataclass(frozen=True, eq=False)
class View:
    """The view of the camera.

    Parameters
    ----------
    direction
        (3,) unit vector from the centre of the picture to the camera, in the root frame.
    points
        (K, 3) points that the picture must contain: extreme points of the robot over the motion, and of the tcp path.
    margin
        Fraction of half the canvas that is left free around them.
    """

    direction: Array
    points: Array
    margin: float = MARGIN

    @property
    def radius(self) -> float:
        """Half the diagonal of the bounding box of the points, in metres."""
        return float(np.linalg.norm(self.points.max(axis=0) - self.points.min(axis=0))) / 2


def choose_view(stage: Stage, poses: Array, points: Array, *, also: Array | None = None) -> View:
    """Choose the view of a motion.

    Parameters
    ----------
    poses
        (F, L, 4, 4) ``root_from_link`` of the stage's links over the motion.
    points
        (N, 3) further points that the picture must contain, such as the tcp path and contacts.
    also
        (k, L, 4, 4) further poses of the links that the picture must contain, but that do not affect the direction.
    """
    rng = np.random.default_rng(0)
    drawn = [k for k, link in enumerate(stage.links) if link.surfaces]
    poses = poses[:, drawn]
    links = [_samples(stage.links[k].surfaces, rng) for k in drawn]
    owner = np.repeat(np.arange(len(links)), SAMPLES)
    instants = sorted({round(i) for i in np.linspace(0, len(poses) - 1, 24)})
    outlines = [_extremes(np.concatenate([s.vertices for s in stage.links[k].surfaces])) for k in drawn]
    framed = [poses[i] for i in instants] + ([] if also is None else list(also[:, drawn]))
    points = _extremes(np.concatenate([points, *(_placed(outlines, each) for each in framed)]))
    compared = sorted({round(i) for i in np.linspace(0, len(poses) - 1, COMPARED_INSTANTS)})
    shown = [_placed(links, poses[i]) for i in compared]
    boxes = [_Box.around(obstacle) for obstacle in stage.obstacles]

    def merit(direction: Array) -> tuple[int, float, float]:
        cells = np.array([_cells_of_links(p, owner, boxes, direction, points) for p in shown])
        seen = int((cells >= SEEN_CELLS).sum(axis=1).min())
        share = float(cells.sum(axis=1).min()) / (GRID[0] * GRID[1])
        # Square roots favour a view that shows every link well over one that shows a single link very large.
        return seen, round(min(share, ENOUGH_SHARE), 2), float(np.sqrt(cells).sum())

    merits = [(merit(direction), direction) for direction in _directions()]
    seen, share, most = max(each[0] for each in merits)
    margin = MARGIN if len(instants) == 1 else MOVING_MARGIN
    good = (d for m, d in merits if m[0] == seen and m[1] >= share and m[2] >= SIMILAR_MERIT * most)
    return View(next(good), points, margin)


def fit(points: Array, direction: Array, aspect: float, margin: float = MARGIN) -> tuple[Array, Array, Array]:
    """Axes (3, 3) (rows right, up, towards the camera), tangents (2,) and camera position (3,) in those axes."""
    axes = _axes(direction)
    tangent = np.tan(np.deg2rad(FIELD_OF_VIEW / 2)) * np.array([aspect, 1.0])
    x = points @ axes.T
    reach = tangent * (1 - margin)
    high, low = (x[:, :2] + x[:, 2:] * reach).max(axis=0), (x[:, :2] - x[:, 2:] * reach).min(axis=0)
    depth = ((high - low) / (2 * reach)).max()
    return axes, tangent, np.array([*((high + low) / 2), depth])


def _axes(direction: Array) -> Array:
    right = np.cross((0.0, 0.0, 1.0), direction)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(direction, right), direction])


def _directions() -> list[Array]:
    """Three-quarter views in order of preference; the first is from the front right and above."""
    choices = []
    for elevation in np.deg2rad((24.0, 12.0, 38.0)):
        for azimuth in np.deg2rad((-45, 45, -30, 30, -60, 60, -15, 15, -90, 90, -120, 120, -150, 150, 180)):
            level = np.cos(elevation)
            choices.append(np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]))
    return choices


def _cells_of_links(
    samples: Array, owner: npt.NDArray[np.int64], boxes: Sequence[_Box], direction: Array, framed: Array
) -> Array:
    """(L,) number of cells of the picture in which each link is in front, from samples and a depth buffer."""
    axes, tangent, camera = fit(framed, direction, ASPECT)
    x = samples @ axes.T - camera
    picture = x[:, :2] / (-x[:, 2:] * tangent)
    inside = np.flatnonzero((np.abs(picture) < 1).all(axis=1) & (x[:, 2] < 0))
    column, row = ((picture[inside] + 1) / 2 * GRID).astype(np.int64).T
    cell = row * GRID[0] + column
    nearest = np.lexsort((-x[inside, 2], cell))
    first = np.unique(cell[nearest], return_index=True)[1]
    front = inside[nearest[first]]
    for box in boxes:
        front = front[~box.hides(samples[front], camera @ axes)]
    return np.bincount(owner[front], minlength=int(owner[-1]) + 1).astype(float)


@dataclass(frozen=True, eq=False)
class _Box:
    """The bounding box of an obstacle in the frame of the obstacle."""

    obstacle_from_root: Array
    low: Array
    high: Array

    @classmethod
    def around(cls, obstacle: DrawnObstacle) -> _Box:
        corners = np.concatenate([s.vertices for s in obstacle.surfaces])
        obstacle_from_root = np.asarray(np.linalg.inv(obstacle.pose), dtype=np.float64)
        return cls(obstacle_from_root, corners.min(axis=0), corners.max(axis=0))

    def hides(self, points: Array, camera: Array) -> npt.NDArray[np.bool_]:
        """Which points (N, 3) the box hides from the camera (3,); points on the surface of the box are not hidden."""
        rotation, shift = self.obstacle_from_root[:3, :3], self.obstacle_from_root[:3, 3]
        start, end = points @ rotation.T + shift, rotation @ camera + shift
        with np.errstate(
            divide="ignore", invalid="ignore"
        ):  # a ray along a face gives 0 / 0, which counts as not hidden
            at = np.stack([(self.low - start) / (end - start), (self.high - start) / (end - start)])
        enter, leave = at.min(axis=0).max(axis=1), at.max(axis=0).min(axis=1)
        return np.maximum(enter, 0.0) + MIN_OCCLUSION < np.minimum(leave, 1.0)


def _placed(links: Sequence[Array], poses: Array) -> Array:
    return np.concatenate([p @ t[:3, :3].T + t[:3, 3] for p, t in zip(links, poses, strict=True)])


def _samples(surfaces: Sequence[Surface], rng: np.random.Generator) -> Array:
    """(SAMPLES, 3) points distributed uniformly over surfaces."""
    corners = np.concatenate([s.vertices[s.triangles] for s in surfaces])
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(ab, ac), axis=1)
    chosen = rng.choice(len(area), size=SAMPLES, p=area / area.sum())
    u, v = rng.random((2, SAMPLES, 1))
    folded = u + v > 1
    u, v = np.where(folded, 1 - u, u), np.where(folded, 1 - v, v)
    return np.asarray(a[chosen] + u * ab[chosen] + v * ac[chosen])


def _extremes(points: Array) -> Array:
    """The extreme points in 400 directions, which are distributed over the sphere by a Fibonacci spiral."""
    k = np.arange(400) + 0.5
    z, turn = 1 - k / 200, np.pi * (1 + 5**0.5) * k
    level = np.sqrt(1 - z * z)
    outward = np.column_stack([level * np.cos(turn), level * np.sin(turn), z])
    return points[np.unique((points @ outward.T).argmax(axis=0))]
