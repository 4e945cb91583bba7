"""Areas, cuts and parts of triangles, and the space between points and a hull, each against a plain computation."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from pinproof.collision import hull_triangles
from pinproof.collision.geometry import hulls
from pinproof.collision.geometry.hulls import PointHull, connected_parts, cut_crossing, with_area


def test_areas_and_normals_are_those_of_trimesh_without_triangles_of_no_area() -> None:
    mesh = trimesh.creation.icosphere(1, 0.3)
    flat = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    corners, normals, areas = with_area(np.concatenate([flat, mesh.triangles, flat]))
    assert corners == pytest.approx(np.array(mesh.triangles))
    assert normals == pytest.approx(np.array(mesh.face_normals))
    assert areas == pytest.approx(np.array(mesh.area_faces))


@pytest.mark.parametrize("seed", range(5))
def test_a_cut_keeps_areas_orientation_and_sides(seed: int) -> None:
    """Some corners are in the plane."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(40, 3, 3))
    corners[rng.random((40, 3)) < 0.2, 2] = 0.0
    heights = corners[:, :, 2]
    crossing = (heights.min(axis=1) < 0) & (heights.max(axis=1) > 0)
    below, above = cut_crossing(corners, heights)
    assert (below[:, :, 2] <= 1e-12).all()
    assert (above[:, :, 2] >= -1e-12).all()

    def moments(part: np.ndarray) -> np.ndarray:
        area = np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]) / 2  # with the sign of the orientation
        return np.concatenate([area.sum(axis=0), (area[:, :, None] * part.mean(axis=1)[:, None]).sum(axis=0).ravel()])

    assert moments(np.concatenate([below, above])) == pytest.approx(moments(corners[crossing]), abs=1e-9)
    expected = with_area(corners[crossing])[2].sum()
    assert with_area(below)[2].sum() + with_area(above)[2].sum() == pytest.approx(expected)


def test_parts_are_numbered_by_their_first_nodes() -> None:
    assert connected_parts(6, np.array([4, 1]), np.array([2, 5])).tolist() == [0, 1, 2, 3, 2, 1]


@pytest.mark.parametrize("products", [1, 100, 2**20])
def test_the_space_to_a_hull_is_the_distance_along_the_normal_in_blocks_of_any_size(products, monkeypatch) -> None:
    monkeypatch.setattr(hulls, "PRODUCTS", products)
    rng = np.random.default_rng(0)
    cloud = rng.normal(size=(30, 3))
    hull, planes = PointHull(cloud), ConvexHull(cloud).equations
    assert hull.volume == pytest.approx(ConvexHull(cloud).volume)
    assert hull.box == pytest.approx(np.array([cloud.min(axis=0), cloud.max(axis=0)]))
    points, normals = rng.normal(size=(50, 3)) * 0.4, rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inside = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1) < 0
    points, normals = points[inside], normals[inside]
    expected = []
    for point, normal in zip(points, normals, strict=True):
        rates = planes[:, :3] @ normal
        ends = -(planes[:, :3] @ point + planes[:, 3])[rates > 0] / rates[rates > 0]
        expected.append(ends.min())
    space = hull.space(points, normals)
    assert len(space) > 10
    assert space == pytest.approx(expected)
    order = np.argsort(space)
    assert hull.has_space(points[order], normals[order], space.max() * 0.999)
    assert hull.has_space(points[order[::-1]], normals[order[::-1]], space.max() * 0.999)
    assert not hull.has_space(points, normals, space.max() * 1.001)


def test_flat_points_have_no_faces_and_no_space() -> None:
    hull = PointHull(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    assert (hull.volume, len(hull.planes), len(hull.triangles), len(hull.points)) == (0.0, 0, 0, 4)
    assert hull.space(np.zeros((2, 3)), np.eye(3)[:2]).tolist() == [0.0, 0.0]
    assert not hull.has_space(np.zeros((2, 3)), np.eye(3)[:2], 0.0)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 100.0])
def test_triangles_of_a_hull_are_counterclockwise_from_outside_and_enclose_its_volume(scale: float) -> None:
    rng = np.random.default_rng(1)
    points = scale * (rng.normal(size=(30, 3)) + np.array([5.0, -3.0, 1.0]))
    corners, middle = points[hull_triangles(points)], points.mean(axis=0)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights = np.einsum("ij,ij->i", normals, corners[:, 0] - middle)
    assert (heights > 0).all()
    assert heights.sum() / 6 == pytest.approx(ConvexHull(points).volume)
