"""Which pixels of a depth image show a removed body, against dense rays."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import pinproof as pp
from pinproof.collision import DepthView, Intrinsics, remove_body
from pinproof.collision.checking.sensor_removal import ray_depths
from pinproof.spatial import SE3
from tests.collision.depth_camera import Solid, depth_image, look_at

CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)
UNCERTAINTY = 0.003


@pytest.mark.parametrize("seed", range(6))
def test_rays_cross_a_polytope_where_dense_points_do(seed: int) -> None:
    """Some rays are parallel to faces, inside and outside of them."""
    rng = np.random.default_rng(seed)
    points = np.array(np.meshgrid(*[(-0.2, 0.2)] * 3)).reshape(3, 8).T + np.array([rng.uniform(-0.4, 0.4), 0.1, 1.0])
    if seed > 2:
        points = rng.normal(size=(12, 3)) * 0.2 + [0, 0, 1]
    hull = ConvexHull(points)
    rays = np.column_stack([rng.uniform(-0.6, 0.6, (60, 2)), np.ones(60)])
    rays[:20, 0] = 0.0
    rays[10:25, 1] = 0.0
    enter, leave = ray_depths(hull.equations, rays)
    depths = np.linspace(-1, 3, 8001)
    crossed = 0
    for ray, first, last in zip(rays, enter, leave, strict=True):
        inside = (depths[:, None] * ray @ hull.equations[:, :3].T + hull.equations[:, 3] <= 0).all(axis=1)
        if inside.sum() > 2:
            crossed += 1
            assert first == pytest.approx(depths[inside][0], abs=6e-4)
            assert last == pytest.approx(depths[inside][-1], abs=6e-4)
        elif not inside.any():
            assert first > last or last - first < 2e-3
    assert crossed > 5


@pytest.mark.parametrize("seed", range(4))
def test_pixels_that_may_show_the_removed_body_bound_nothing_else(seed: int) -> None:
    """A pixel that the body covers entirely looks through it; one that it covers in part proves no space to be free."""
    rng = np.random.default_rng(seed)
    eye = look_at(np.array([0.5, 0, 0.9]) + rng.uniform(-0.4, 0.4, 3) * [1, 1, 0.3], np.array([0.5, 0, 0.0]))
    frame, size = pp.pose((0.5, 0.0, 0.08), rng.uniform(-0.5, 0.5, 3)), np.array([0.16, 0.12, 0.16])
    if seed == 3:  # a beam past the camera, both in front of it and behind it
        beam = eye @ pp.pose((0.2, 0.02, 0.0), (0.02, -0.03, 0.3)).homogeneous
        frame, size = SE3(beam[:3, :3], beam[:3, 3]), np.array([0.1, 0.12, 1.0])
    table = Solid(pp.pose((0.5, 0.0, -0.05)).homogeneous, np.array([0.4, 0.4, 0.05]))
    part = Solid(frame.homogeneous, size / 2)
    image = depth_image(CAMERA, eye, [table, part])
    image[rng.random(image.shape) < 0.02] = 0.0
    before = DepthView.read(image, CAMERA, eye, depth_uncertainty=UNCERTAINTY)
    after = remove_body(before, pp.Obstacle("part", pp.Box(*size), frame))

    # Depths (2, 2, 48, 64) at which the rays through the corners of each pixel enter and leave the box, by its slabs.
    v, u = np.meshgrid(np.arange(48), np.arange(64), indexing="ij")
    at = np.array([[(u + i - CAMERA.cx, v + j - CAMERA.cy) for i in (-0.5, 0.5)] for j in (-0.5, 0.5)])
    rays = np.stack([at[:, :, 0] / CAMERA.fx, at[:, :, 1] / CAMERA.fy, np.ones(at[:, :, 0].shape)], axis=-1)
    part_from_camera = np.linalg.inv(part.pose) @ eye
    origin, rays = part_from_camera[:3, 3], rays @ part_from_camera[:3, :3].T
    slabs = np.stack([(-part.half - origin) / rays, (part.half - origin) / rays])
    enter, leave = slabs.min(axis=0).max(axis=-1), slabs.max(axis=0).min(axis=-1)
    hit = (enter <= leave) & (leave > 0)
    some, whole = hit.any(axis=(0, 1)), hit.all(axis=(0, 1))
    # A pixel measures the box if its depth is between where a ray enters and half the way to where it leaves.
    first = np.where(hit, enter, np.inf).min(axis=(0, 1))
    half = np.where(hit, (enter + leave) / 2, -np.inf).max(axis=(0, 1))
    shows = (image > 0) & some & (image + UNCERTAINTY >= first) & (image - UNCERTAINTY <= half)
    assert (shows & whole).sum() > 40
    assert (shows & ~whole).sum() > 10
    assert (some & ~shows & (image > 0)).any()
    behind = np.where(shows & whole, np.where(hit, leave, np.inf).min(axis=(0, 1)), 0.0)
    assert after.nearest == pytest.approx(np.maximum(before.nearest, behind), abs=1e-9)
    assert (after.farthest == np.where(shows, 0.0, before.farthest)).all()
    assert f"{shows.sum()} pixels" in after.record[-1]


@pytest.mark.parametrize("factor", [0.5, 1.7, 3.0])
def test_a_scaled_image_shows_each_point_at_the_same_share_of_its_sides(factor: float) -> None:
    scaled = CAMERA.scaled(factor)
    assert (scaled.width, scaled.height) == (round(64 * factor), round(48 * factor))
    for x, y, z in np.random.default_rng(0).uniform([-0.4, -0.3, 0.8], [0.4, 0.3, 2.0], (20, 3)):
        pixels = [(c.fx * x / z + c.cx + 0.5, c.fy * y / z + c.cy + 0.5) for c in (CAMERA, scaled)]
        assert pixels[1] == pytest.approx(factor * np.array(pixels[0]))
