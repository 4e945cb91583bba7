from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision import Box, Obstacle, Scene
from pinproof.spatial import pose
from pinproof.viewer.camera import LEAST_DISTANCE, choose_view, fit, tool_points
from pinproof.viewer.stage import set_stage, still

from .conftest import small_arm

numbers = st.floats(-2, 2)


@given(
    points=st.lists(st.tuples(numbers, numbers, numbers), min_size=2, max_size=20, unique=True),
    azimuth=st.floats(-np.pi, np.pi),
    elevation=st.floats(-1.2, 1.2),
    aspect=st.floats(0.4, 3),
)
def test_the_picture_shows_every_point_from_the_smallest_distance(points, azimuth, elevation, aspect) -> None:
    cloud = np.array(points)
    level = np.cos(elevation)
    direction = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    axes, tangent, camera = fit(cloud, direction, aspect, margin=0.0)
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert axes[0, 2] == pytest.approx(0)  # the horizon is level
    seen = cloud @ axes.T - camera
    # in units of the half picture; a point may lie in the camera itself, so nothing is divided
    sides = np.concatenate([(tangent * -seen[:, 2:] - seen[:, :2]), (tangent * -seen[:, 2:] + seen[:, :2])], axis=1)
    assert sides.min() > -1e-9
    tight = sides.min(axis=0).reshape(2, 2).max(axis=0)
    nearest, farthest = seen[:, 2].max(), seen[:, 2].min()
    assert -nearest >= LEAST_DISTANCE * (nearest - farthest) - 1e-9
    at_least = -nearest <= LEAST_DISTANCE * (nearest - farthest) + 1e-9
    assert at_least or tight.min() < 1e-9  # opposite sides both touch, in width or in height


def test_a_planar_arm_is_not_hidden_behind_its_own_tip() -> None:
    rows = [pp.DhRow(f"j{k}", 0, 0, a, 0) for k, a in enumerate((1.0, 0.8, 0.3))]
    arm = pp.load_robot(pp.DhTable(rows, convention="standard", name="planar")).arm()
    stage = set_stage(arm, Scene())
    shown = still(stage, np.array([np.pi / 6, np.pi / 4, 0.3]))
    view = choose_view(stage, shown.poses, shown.tcps[:, 0], tool=tool_points(stage, shown.poses))
    axes, tangent, camera = fit(view.points, view.direction, 1.6)
    seen = np.array([[0, 0, 0], [0.866, 0.5, 0], [1.073, 1.273, 0], [1.049, 1.572, 0]]) @ axes.T - camera
    across = seen[:, :2] / (-seen[:, 2:] * tangent)
    steps = np.linalg.norm(np.diff(across, axis=0), axis=1)  # halves of the picture
    assert (steps > 0.2).all()


def test_a_wall_does_not_hide_a_later_contact() -> None:
    arm = small_arm()
    free = _direction(arm, Scene())
    wall = Obstacle("wall", Box(0.02, 3, 3), pose(xyz=0.4 * free, rpy=(0, 0, np.arctan2(free[1], free[0]))))
    past = _direction(arm, Scene([wall]))
    assert past @ free < 0.9


def test_the_view_is_the_same_each_time() -> None:
    arm = small_arm()
    assert np.array_equal(_direction(arm, Scene()), _direction(arm, Scene()))


def _direction(arm, scene) -> np.ndarray:
    stage = set_stage(arm, scene)
    shown = still(stage, arm.home)
    return choose_view(stage, shown.poses, shown.tcps[:, 0]).direction
