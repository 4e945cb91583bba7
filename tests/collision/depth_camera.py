"""A depth camera for tests: rays through the centers of pixels against boxes and balls, computed exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinproof.collision import Intrinsics
from pinproof.spatial import pose as pose_of


@dataclass(frozen=True)
class Solid:
    """A box with half sides ``half`` or, if ``radius`` is not 0, a ball, at a pose (4, 4)."""

    pose: np.ndarray
    half: np.ndarray | None = None
    radius: float = 0.0

    def depth(self, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """The parameter at which rays (..., 3) from an origin enter it; inf where they miss it or begin in it."""
        o = self.pose[:3, :3].T @ (origin - self.pose[:3, 3])
        d = rays @ self.pose[:3, :3]
        with np.errstate(all="ignore"):
            if self.half is not None:
                one, other = (-self.half - o) / d, (self.half - o) / d
                enter, leave = np.minimum(one, other).max(-1), np.maximum(one, other).min(-1)
            else:
                a, b, c = (d * d).sum(-1), d @ o, o @ o - self.radius**2
                root = np.sqrt(b * b - a * c)
                enter, leave = (-b - root) / a, (-b + root) / a
        return np.where((enter <= leave) & (enter > 0), enter, np.inf)

    def surface(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, 3) random points of its surface, moved into it by a millionth: bodies in contact share some."""
        points = rng.normal(size=(count, 3))
        if self.half is not None:
            points = rng.uniform(-self.half, self.half, (count, 3))
            axis = rng.integers(3, size=count)
            points[np.arange(count), axis] = rng.choice([-1, 1], count) * self.half[axis]
        else:
            points *= self.radius / np.linalg.norm(points, axis=1, keepdims=True)
        return (1 - 1e-6) * points @ self.pose[:3, :3].T + self.pose[:3, 3]


def look_at(eye: np.ndarray, target: np.ndarray, roll: float = 0.0) -> np.ndarray:
    """root_from_camera (4, 4) of a camera at ``eye`` whose optical axis passes through ``target``."""
    z = np.asarray(target, float) - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, [np.sin(roll), 0.1, np.cos(roll)])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    pose[:3, 3] = eye
    return pose


def depth_image(camera: Intrinsics, root_from_camera: np.ndarray, solids: list[Solid]) -> np.ndarray:
    """(height, width) depth along the optical axis; 0 where a ray meets nothing."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    origin, rays = root_from_camera[:3, 3], rays @ root_from_camera[:3, :3].T
    depth = np.minimum.reduce([np.full(u.shape, np.inf), *(solid.depth(origin, rays) for solid in solids)])
    return np.where(np.isfinite(depth), depth, 0.0)


def states_by_definition(
    camera: Intrinsics,
    root_from_camera: np.ndarray,
    nearest: np.ndarray,
    farthest: np.ndarray,
    low: np.ndarray,
    count: tuple[int, int, int],
    side: float,
    margin: int,
) -> np.ndarray:
    """The states of the cells by their definition, cell by cell and pixel by pixel."""
    camera_from_root = np.linalg.inv(root_from_camera)
    states = np.empty(count, dtype=np.uint8)
    for index in np.ndindex(count):
        corners = (low + index + np.array(list(np.ndindex(2, 2, 2)))) * side
        x, y, z = camera_from_root[:3, :3] @ corners.T + camera_from_root[:3, 3:]
        states[index] = 2
        if z.min() <= 1e-6:
            continue
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        left, right = np.ceil(u.min() - 0.5 - margin), np.floor(u.max() + 0.5 + margin)
        top, bottom = np.ceil(v.min() - 0.5 - margin), np.floor(v.max() + 0.5 + margin)
        inside = left >= 0 and top >= 0 and right < camera.width and bottom < camera.height
        rows = slice(int(max(top, 0)), int(max(bottom + 1, 0)))
        columns = slice(int(max(left, 0)), int(max(right + 1, 0)))
        n, f = nearest[rows, columns], farthest[rows, columns]
        if inside and z.max() < n.min():
            states[index] = 0
        elif ((z.max() >= n) & (f > 0) & (z.min() <= f)).any():
            states[index] = 1
    return states


def at(x: float, y: float, z: float, rpy: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    return np.array(pose_of((x, y, z), rpy).homogeneous)


CAMERA = Intrinsics(150.0, 150.0, 79.5, 59.5, 160, 120)
ABOVE = look_at(np.array([0.3, -0.2, 1.2]), np.array([0.5, 0.0, 0.0]))
BOUNDS = [(0.0, -0.5, -0.1), (1.0, 0.5, 0.6)]
TABLE = Solid(at(0.5, 0.0, -0.05), np.array([0.8, 0.8, 0.05]))
PART = Solid(at(0.5, 0.0, 0.05), np.array([0.05, 0.05, 0.05]))
