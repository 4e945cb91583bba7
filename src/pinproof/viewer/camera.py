"""The camera: the direction that shows most of the robot, and the points that the picture must contain.

The page computes the distance of the camera, because it depends on the aspect ratio of the canvas. :func:`fit` and the
page use the same closed form. With the axes of the camera fixed, each point p = (x, y, z) (right, up, towards the
camera) must satisfy |x - c_x| <= (c_z - z) t, where t is the tangent of half the angle of view. Hence c_x is between
max(x + z t) - c_z t and min(x - z t) + c_z t. The interval is not empty if c_z >= (max(x + z t) - min(x - z t)) / 2t.
The same holds for y, and the larger c_z satisfies both. So does every larger one: the camera also keeps
:data:`LEAST_DISTANCE` from the points, because a long arm that points towards it would hide itself behind its own tool.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import spiral_directions
from pinproof.common.structs import described, key
from pinproof.spatial import Array
from pinproof.viewer.stage import Drawing, DrawnObstacle, box_corners
from pinproof.viewer.surfaces import Surface

FIELD_OF_VIEW = 30.0
"""Vertical angle of view in degrees. A small angle limits the perspective distortion of near links."""

ASPECT = 4 / 3
"""Aspect ratio (width / height) for which directions are compared."""

DIRECTIONS_COMPARED = [
    np.array([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)])
    for up in np.deg2rad((24.0, 12.0, 38.0, 58.0))
    for azimuth in np.deg2rad((-45, 45, -30, 30, -60, 60, -15, 15, -90, 90, -120, 120, -150, 150, 180))
]
"""Three-quarter views in order of preference; the first is from the front right and above."""

GRID = (60, 45)
"""Cells of the picture for which directions are compared."""

SAMPLES = 400
"""Sample points on the surface of each link."""

COMPARED_INSTANTS = 3
"""Instants of the motion at which directions are compared."""

SEEN_CELLS = 2
"""A link is visible if it is in front in at least this number of cells."""

MIN_OCCLUSION = 1e-3
"""Fraction of the line of sight that must be inside a box to count as occluded."""

ENOUGH_TOOL = 0.4
"""Fraction of the largest visible area of the tool that a direction must show at every compared instant."""

FEW_INSTANTS = 20
"""Number of key frames up to which the slowest instant of the robot is not searched."""

ENOUGH_SHARE = 0.20
"""Fraction of the picture that the robot should fill; directions that exceed it are not preferred."""

SIMILAR_MERIT = 0.985
"""The first direction in order of preference whose merit is at least this fraction of the best is used."""

LEAST_DISTANCE = 1.25
"""Least distance of the camera from the nearest point, relative to the depth of the points: the nearest link appears at
most 1.8 times as large as the farthest."""

MARGIN = 0.05
"""Fraction of half the canvas that is left free at its border."""

MOVING_MARGIN = 0.03
"""The same for a motion. It is smaller, because all positions of the robot over the motion must fit."""

NEAR_SHARE = 0.18
"""Obstacles within this fraction of the radius of the robot's motion from the tool are in the picture."""

NEAR_SAMPLES = 200
"""Sample points on the surface of each obstacle; the picture contains the ones near the tool."""

MOST_TOOL_POINTS = 200
"""Largest number of points of the tool to which the distance of obstacles is computed."""

BOX_TRIANGLES, PARTS, MOST_BOXES = 12, 4, 300
"""For what is hidden, an obstacle with more triangles than a box is divided by a grid of so many cells along each axis,
those with the most triangles first, until there are so many boxes."""

DIRECTIONS = 200
"""Directions in which the extreme points of a set are found; the others are in their hull but for 1 % of its size."""

OUTLINE = 26
"""The same for the outline of each link, which is placed at many instants."""

MOST_INSTANTS = 120
"""Largest number of instants at which all links are framed; the tool is framed at every key frame."""

CHUNK = 500
"""Number of points whose extremes are computed at a time: the products fit into the cache of a processor."""


@described(eq=False)
class View:
    """The view of the camera."""

    direction: Array = key("(3,) unit vector from the centre of the picture to the camera, in the root frame")
    points: Array = key(
        "(K, 3) points that the picture must contain: extreme points of the robot over the motion, and of the tcp path"
    )
    margin: float = key("fraction of half the canvas that is left free around them", default=MARGIN)

    @property
    def radius(self) -> float:
        """Half the diagonal of the bounding box of the points, in metres."""
        return float(np.linalg.norm(self.points.max(axis=0) - self.points.min(axis=0))) / 2

    def settings(self) -> dict[str, Any]:
        """Return the settings from which the page computes the position of the camera for its canvas."""
        return {
            "direction": [round(float(v), 6) for v in self.direction],
            "points": [[round(float(v), 4) for v in point] for point in self.points],
            "fieldOfView": FIELD_OF_VIEW,
            "leastDistance": LEAST_DISTANCE,
            "margin": self.margin,
        }


def choose_view(
    stage: Drawing, poses: Array, points: Array, *, also: Array | None = None, tool: Array | None = None
) -> View:
    """Choose the view of a motion with poses (F, L, 4, 4) ``root_from_link`` of the links of the stage.

    The picture also contains ``points`` (N, 3), such as the tcp path and contacts, further poses ``also`` (k, L, 4, 4)
    of the links, which do not affect the direction, and the points ``tool`` (M, 3) of the tool and of carried parts
    over the motion, with the obstacles near them.
    """
    rng = np.random.default_rng(0)
    drawn = [k for k, link in enumerate(stage.links) if link.surfaces]
    poses, count = poses[:, drawn], len(poses)
    # What the picture must contain: the outlines of all links over the motion, the tool and what is near it
    framed = poses[:: -(-count // MOST_INSTANTS)]
    framed = np.concatenate([framed, poses[-1:], *([] if also is None else [also[:, drawn]])])
    swept = []
    samples = [_samples(stage.links[k].surfaces, SAMPLES, rng) for k in drawn]
    for number, k in enumerate(drawn):
        outline = extremes(np.concatenate([surface.vertices for surface in stage.links[k].surfaces]), OUTLINE)
        swept.append(extremes(placed_points(outline, framed[:, number])))
    points = extremes(np.concatenate([points, *swept]))
    if tool is not None and len(tool):
        radius = float(np.linalg.norm(np.ptp(points, axis=0))) / 2
        points = extremes(np.concatenate([points, tool, near_obstacles(stage, tool, NEAR_SHARE * radius)]))
    # Directions are compared at the start, the middle and the end, and where the robot is slowest in between
    instants = {round(i) for i in np.linspace(0, count - 1, COMPARED_INSTANTS)}
    if count > FEW_INSTANTS:
        inner = slice(count // 10, count - count // 10)
        speed = np.abs(np.diff(poses[inner, :, :3, 3], axis=0)).sum(axis=(1, 2))
        instants.add(inner.start + int(speed.argmin()))
    shown = [
        np.concatenate([placed_points(sample, poses[i, number, None]) for number, sample in enumerate(samples)])
        for i in sorted(instants)
    ]
    # The cells in which each link is in front, for each direction and instant
    owner, boxes, is_tool = np.repeat(np.arange(len(drawn)), SAMPLES), _Boxes.around(stage.obstacles), stage.tool[drawn]
    cells = np.array(
        [
            [_cells_of_links(placed, owner, boxes, *camera) for placed in shown]
            for camera in (fit(points, direction, ASPECT) for direction in DIRECTIONS_COMPARED)
        ]
    )
    seen = (cells >= SEEN_CELLS).sum(axis=2).min(axis=1)
    # Every link of the tool counts: a large one must not make up for a hidden one.
    tool_seen = cells[:, :, is_tool].min(axis=2, initial=np.inf).min(axis=1)
    share = np.minimum(cells.sum(axis=2).min(axis=1) / (GRID[0] * GRID[1]), ENOUGH_SHARE).round(2)
    # Square roots favour a view that shows every link well over one that shows a single link very large.
    merit = np.sqrt(cells).sum(axis=(1, 2))
    good = tool_seen >= ENOUGH_TOOL * tool_seen.max()
    for figure, least in ((seen, 1.0), (share, 1.0), (merit, SIMILAR_MERIT)):
        good &= figure >= least * figure[good].max()
    direction = DIRECTIONS_COMPARED[int(np.flatnonzero(good)[0])]
    return View(direction, points, MARGIN if count == 1 else MOVING_MARGIN)


def fit(points: Array, direction: Array, aspect: float, margin: float = MARGIN) -> tuple[Array, Array, Array]:
    """Axes (3, 3) (rows right, up, towards the camera), tangents (2,) and camera position (3,) in those axes."""
    # The axes of the camera, with z up in the picture
    right = np.cross((0.0, 0.0, 1.0), direction)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(direction, right), direction])
    tangent = np.tan(np.deg2rad(FIELD_OF_VIEW / 2)) * np.array([aspect, 1.0])
    x = points @ axes.T
    reach = tangent * (1 - margin)
    high, low = (x[:, :2] + x[:, 2:] * reach).max(axis=0), (x[:, :2] - x[:, 2:] * reach).min(axis=0)
    depth = max(((high - low) / (2 * reach)).max(), x[:, 2].max() + LEAST_DISTANCE * np.ptp(x[:, 2]))
    return axes, tangent, np.array([*((high + low) / 2), depth])


def _cells_of_links(
    samples: Array, owner: npt.NDArray[np.int64], boxes: _Boxes, axes: Array, tangent: Array, camera: Array
) -> Array:
    """(L,) number of cells of the picture in which each link is in front, from samples and a depth buffer."""
    x = samples @ axes.T - camera
    picture = x[:, :2] / (-x[:, 2:] * tangent)
    inside = np.flatnonzero((np.abs(picture) < 1).all(axis=1) & (x[:, 2] < 0))
    column, row = ((picture[inside] + 1) / 2 * GRID).astype(np.int64).T
    # Written in order of decreasing distance, so that the nearest sample of each cell remains.
    order = np.argsort(x[inside, 2])
    buffer = np.full(GRID[0] * GRID[1], -1)
    buffer[(row * GRID[0] + column)[order]] = inside[order]
    front = buffer[buffer >= 0]
    front = front[~boxes.hide(samples[front], x[front], axes, camera)]
    return np.bincount(owner[front], minlength=int(owner[-1]) + 1).astype(float)


@dataclass(frozen=True, eq=False)
class _Boxes:
    """The B bounding boxes of obstacles or of their parts, each in the frame of its obstacle."""

    rotation: Array
    shift: Array
    low: Array
    high: Array

    @classmethod
    def around(cls, obstacles: Sequence[DrawnObstacle]) -> _Boxes:
        corners: list[Array] = []
        poses: list[Any] = []
        # A single box around a scan or a bin would hide the robot in it; those of its parts do not
        drawn = [(np.concatenate([s.vertices[s.triangles] for s in o.surfaces]), o) for o in obstacles if o.surfaces]
        for triangles, obstacle in sorted(drawn, key=lambda pair: -len(pair[0])):
            middles = triangles.mean(axis=1)
            cells = np.floor(PARTS * (middles - middles.min(axis=0)) / (np.ptp(middles, axis=0) + 1e-9))
            if len(triangles) <= BOX_TRIANGLES or len(corners) > MOST_BOXES:
                cells[:] = 0
            part_of = np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)
            parts = [triangles[part_of == k].reshape(-1, 3) for k in range(part_of.max() + 1)]
            corners += [np.stack([part.min(axis=0), part.max(axis=0)]) for part in parts]
            poses += [np.linalg.inv(obstacle.pose)] * len(parts)
        obstacle_from_root = np.array(poses).reshape(-1, 4, 4)
        bounds = np.array(corners).reshape(-1, 2, 3)
        return cls(obstacle_from_root[:, :3, :3], obstacle_from_root[:, :3, 3], bounds.min(axis=1), bounds.max(axis=1))

    def hide(self, points: Array, seen: Array, axes: Array, camera: Array) -> npt.NDArray[np.bool_]:
        """Which points (N, 3) a box hides from the camera; points on the surface of a box are not hidden.

        ``seen`` are the points along the axes of the camera, from the camera, which is at ``camera`` in these axes.
        """
        if not len(self.low):
            return np.zeros(len(points), dtype=bool)
        # Only points in the rectangle that the ball around a box has in the picture may be behind it
        centre = np.einsum("bi,bij->bj", 0.5 * (self.low + self.high) - self.shift, self.rotation) @ axes.T - camera
        radius = 0.5 * np.linalg.norm(self.high - self.low, axis=1)[:, None]
        nearest, farthest = -centre[:, 2:] - radius, -centre[:, 2:] + radius
        low, high = centre[:, :2] - radius, centre[:, :2] + radius
        with np.errstate(divide="ignore", invalid="ignore"):
            low = np.where(nearest > 0, np.minimum(low / nearest, low / farthest), -np.inf)
            high = np.where(
                nearest > 0, np.maximum(high / nearest, high / farthest), np.where(farthest > 0, np.inf, -np.inf)
            )
        depth = -seen[:, 2]
        across, upward = seen[:, :2].T / depth
        order = np.argsort(across)
        first, last = (np.searchsorted(across[order], end[:, 0]) for end in (low, high))
        counts = last - first
        box = np.repeat(np.arange(len(counts)), counts)
        point = order[np.arange(len(box)) + np.repeat(first - np.cumsum(counts) + counts, counts)]
        above, below = upward[point] >= low[box, 1], upward[point] <= high[box, 1]
        likely = above & below & (depth[point] > nearest[box, 0])
        box, point = box[likely], point[likely]
        # Where the line of sight is inside the box
        start = (np.einsum("kij,kj->ki", self.rotation[box], points[point]) + self.shift[box]).T
        end = (self.rotation @ (camera @ axes) + self.shift)[box].T
        with np.errstate(divide="ignore", invalid="ignore"):  # a ray along a face gives 0 / 0, which is not hidden
            scale = 1.0 / (end - start)
            ends = (self.low[box].T - start) * scale, (self.high[box].T - start) * scale
        enter, leave = np.minimum(*ends).max(axis=0), np.maximum(*ends).min(axis=0)
        hidden = np.zeros(len(points), dtype=bool)
        hidden[point[np.maximum(enter, 0.0) + MIN_OCCLUSION < np.minimum(leave, 1.0)]] = True
        return hidden


def tool_points(stage: Drawing, poses: Array) -> Array:
    """(N, 3) points around the tool at all poses (F, L, 4, 4) of the links: the corners of the boxes of its links."""
    tool = np.flatnonzero(stage.tool)
    corners = [placed_points(box_corners(stage.links[k].surfaces), poses[:, k]) for k in tool]
    return np.concatenate([np.empty((0, 3)), *corners])


def placed_points(points: Array, poses: Array) -> Array:
    """(F N, 3) points (N, 3) of a body at poses (F, 4, 4)."""
    return np.asarray((points @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3]).reshape(-1, 3))


def near_obstacles(stage: Drawing, tool: Array, reach: float) -> Array:
    """(N, 3) points of the obstacles within ``reach`` (m) of points of the tool (M, 3).

    An obstacle of at most this size is contained as a whole, a larger one by the part of its surface that is near.
    """
    rng = np.random.default_rng(0)
    kept = tool[:: -(-len(tool) // MOST_TOOL_POINTS)]
    found = [np.empty((0, 3))]
    for obstacle in stage.obstacles:
        if not obstacle.surfaces:
            continue
        corners = placed_points(box_corners(obstacle.surfaces), obstacle.pose[None])
        samples = placed_points(_samples(obstacle.surfaces, NEAR_SAMPLES, rng), obstacle.pose[None])
        # Squared distances of all pairs of points, without the differences in memory
        squares = (samples**2).sum(axis=1)[:, None] + (kept**2).sum(axis=1) - 2 * samples @ kept.T
        close = squares.min(axis=1) <= reach**2
        if close.any():
            small = np.linalg.norm(np.ptp(corners, axis=0)) <= 2 * reach
            found.append(corners if small else samples[close])
    return np.concatenate(found)


def _samples(surfaces: Sequence[Surface], count: int, rng: np.random.Generator) -> Array:
    """(count, 3) points distributed uniformly over surfaces."""
    corners = np.concatenate([s.vertices[s.triangles] for s in surfaces])
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(ab, ac), axis=1)
    chosen = rng.choice(len(area), size=count, p=area / area.sum())
    # Points of the parallelogram outside the triangle are folded into it
    u, v = rng.random((2, count, 1))
    folded = u + v > 1
    u, v = np.where(folded, 1 - u, u), np.where(folded, 1 - v, v)
    return np.asarray(a[chosen] + u * ab[chosen] + v * ac[chosen])


def extremes(points: Array, directions: int = DIRECTIONS) -> Array:
    """The extreme points in some directions, which are distributed over the sphere by a Fibonacci spiral."""
    outward = spiral_directions(directions)
    while len(points) > CHUNK:
        parts = (points[start : start + CHUNK] for start in range(0, len(points), CHUNK))
        points = np.concatenate([part[np.unique((outward @ part.T).argmax(axis=1))] for part in parts])
    return points[np.unique((outward @ points.T).argmax(axis=1))]
