"""Which pixels of a depth image show a removed body, against dense rays."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from pinproof import Box, Obstacle, pose
from pinproof.collision import DepthView, Intrinsics, remove_body
from pinproof.collision.checking.sensor_removal import _Polytope
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
    enter, leave = _Polytope(points, hull.equations).crossed(rays)
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
    frame = pose((0.5, 0.0, 0.08), rng.uniform(-0.5, 0.5, 3))
    table = Solid(pose((0.5, 0.0, -0.05)).homogeneous, np.array([0.4, 0.4, 0.05]))
    part = Solid(frame.homogeneous, np.array([0.08, 0.06, 0.08]))
    image = depth_image(CAMERA, eye, [table, part])
    image[rng.random(image.shape) < 0.02] = 0.0
    before = DepthView.read(image, CAMERA, eye, depth_uncertainty=UNCERTAINTY)
    after = remove_body(before, Obstacle("part", Box(0.16, 0.12, 0.16), frame))

    steps = np.linspace(-0.5, 0.5, 7)
    v, u, dv, du = np.meshgrid(np.arange(48), np.arange(64), steps, steps, indexing="ij")
    rays = np.stack([(u + du - CAMERA.cx) / CAMERA.fx, (v + dv - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    enter = part.depth(eye[:3, 3], rays @ eye[:3, :3].T)
    hit = np.isfinite(enter)
    some, whole = hit.any(axis=(2, 3)), hit.all(axis=(2, 3))
    corners = hit[:, :, ::6, ::6].any(axis=(2, 3))
    shows = (image > 0) & hit[:, :, 3, 3] & corners  # the ray through the middle of the pixel measures it
    # At the outline, rays leave the body after so short a way that what is measured may be behind it.
    assert (after.farthest[shows & whole] == 0).mean() > 0.97
    assert (after.farthest[shows & ~whole] == 0).mean() > 0.5
    assert shows.sum() > 50
    assert (shows & ~whole).sum() > 10
    untouched = ~some | (image == 0)
    edge = np.zeros_like(some)
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        edge |= np.roll(some, step, axis)
    assert (after.farthest[untouched & ~edge] == before.farthest[untouched & ~edge]).all()
    assert (after.nearest[~whole & ~edge] == before.nearest[~whole & ~edge]).all()
    # Where it looks through, what is measured is behind the place at which the nearest ray of the pixel leaves.
    inner = shows & whole & (after.nearest > before.nearest)
    assert inner.sum() > 0.5 * (shows & whole).sum()
    for row, column in np.argwhere(inner)[::9]:
        back = [eye[:3, :3] @ ray for ray in rays[row, column].reshape(-1, 3)]
        leave = min(10.0 - float(part.depth(eye[:3, 3] + 10.0 * ray, -ray)) for ray in back)
        assert leave - 0.05 <= after.nearest[row, column] <= leave + 1e-6
