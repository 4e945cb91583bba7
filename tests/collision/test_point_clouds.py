"""Point clouds: their cells joined to boxes, points that are not finite, proofs of motions beside them."""

from __future__ import annotations

import itertools
import pickle

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision.certificates.certificate import notes_of
from pinproof.collision.geometry.bodies import shape_bodies, shape_body
from pinproof.collision.geometry.surfaces import merged_cells
from pinproof.errors import SceneError

HERE = pp.pose((0.2, -0.1, 0.3), (0.3, -0.4, 0.5))


def noisy_table(noise: float, resolution: float = 0.02) -> pp.PointCloud:
    """A table top and a wall behind it as a depth camera measures them."""
    rng = np.random.default_rng(0)
    x, y = (side.ravel() for side in np.meshgrid(np.arange(0.3, 1.0, 0.01), np.arange(-0.6, 0.6, 0.01)))
    table = np.stack([x, y, np.full_like(x, -0.05)], axis=1)
    wall = np.stack([np.full_like(x, 1.0), y, x - 0.3], axis=1)
    points = np.concatenate([table, wall])
    return pp.PointCloud(points + rng.normal(0, noise, points.shape), resolution)


cells_of_any_shape = st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=1, max_size=60, unique=True).map(
    lambda cells: np.array(cells, dtype=np.int64)
)


@given(cells_of_any_shape)
def test_boxes_contain_each_cell_once_and_no_other_space(cells):
    low, high = merged_cells(cells)
    held = [
        cell
        for first, last in zip(low.tolist(), high.tolist(), strict=True)
        for cell in itertools.product(*(range(a, b) for a, b in zip(first, last, strict=True)))
    ]
    assert sorted(held) == sorted(map(tuple, cells.tolist()))


def test_a_plane_of_cells_is_one_box():
    low, high = merged_cells(np.array(list(itertools.product(range(20), range(30), [4]))))
    assert (low.tolist(), high.tolist()) == ([[0, 0, 4]], [[20, 30, 5]])


def test_the_boxes_are_where_the_cells_are():
    cloud = pp.PointCloud(np.random.default_rng(1).uniform(-0.2, 0.2, (200, 3)), 0.05)
    bodies = shape_bodies("cloud", None, cloud, HERE)
    assert {body.owner for body in bodies} == {"cloud"}
    assert all(body.support is not None for body in bodies)
    inside = np.random.default_rng(2).uniform(-0.25, 0.25, (500, 3))
    cells = set(map(tuple, cloud.cells.tolist()))
    for point in inside:
        there = tuple(np.floor(point / 0.05).astype(int).tolist()) in cells
        place = HERE.act(point)
        boxed = any(
            (body.box[0] <= local).all() and (local <= body.box[1]).all()
            for body in bodies
            for local in [body.link_from_body.actInv(place)]
        )
        assert boxed == there


def test_distances_equal_those_of_the_surface_of_the_cells():
    """The distance of a ball from the boxes is that from one mesh of the outer faces of all cells."""
    cloud, ball = noisy_table(0.005), coal.Sphere(0.02)
    bodies = [*shape_bodies("cloud", None, cloud, pp.pose()), shape_body("cloud", "cloud", None, cloud, pp.pose())]
    for center in np.random.default_rng(3).uniform([0.3, -0.6, 0.05], [0.9, 0.6, 0.5], (10, 3)):
        *boxes, surface = (
            coal.distance(
                body.geometry,
                coal.Transform3s(body.link_from_body.rotation, body.link_from_body.translation),
                ball,
                coal.Transform3s(np.eye(3), center),
                coal.DistanceRequest(),
                coal.DistanceResult(),
            )
            for body in bodies
        )
        assert min(boxes) == pytest.approx(surface, abs=2e-6)


def test_a_motion_beside_a_cloud_is_proven_and_the_proof_is_verified(tmp_path):
    arm = pp.load_robot("ur5").arm()
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("cloud", noisy_table(0.01, 0.06))]), margin=0.002)
    path = pp.JointPath(np.array([arm.home, arm.home + 0.3 * np.eye(6)[0]]), arm.joint_names)
    certificate = pp.certify(path, checker, record=True)
    assert certificate.free
    certificate.save(tmp_path / "proof.json.gz")
    assert pp.verify_proof(tmp_path / "proof.json.gz", checker, path).ok


def test_points_that_are_not_finite_are_dropped_and_counted():
    measured = [[0.1, 0.2, 0.3], [np.nan, 0, 0], [0, np.inf, 0], [0.5, 0.5, 0.5]]
    cloud = pp.PointCloud(measured, 0.01)
    assert (len(cloud.points), cloud.dropped) == (2, 2)
    assert pickle.loads(pickle.dumps(cloud)).dropped == 2
    checker = pp.CollisionChecker(pp.load_robot("ur5").arm(), pp.Scene([pp.Obstacle("seen", cloud)]))
    assert any("2 points that are not finite are dropped" in note for note in notes_of(checker))


def test_a_cloud_without_a_finite_point_is_refused():
    with pytest.raises(pp.InputError, match="3 points, of which none is finite"):
        pp.PointCloud(np.full((3, 3), np.nan), 0.01)


def test_points_of_a_scene_file_may_be_not_finite(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("obstacles:\n  - {name: a, point_cloud: {points: [[0, 0, 1], [.nan, 0, 0]], resolution: 0.1}}")
    assert pp.Scene.load(path)["a"].shape.dropped == 1
    path.write_text("obstacles:\n  - {name: a, point_cloud: {points: [[.nan, 0, 0]], resolution: 0.1}}")
    with pytest.raises(SceneError, match="none is finite"):
        pp.Scene.load(path)
