"""Obstacles that are objects of other libraries contain what these describe, or are refused by name."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial import ConvexHull, Delaunay

import pinproof as pp

BALL = 0.05
POSE = pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.7, 0.3), np.array([0.2, -0.1, 0.1]))


@pytest.fixture(scope="module")
def gantry() -> pp.Arm:
    """Three prismatic joints that carry a ball: its centre is q."""
    model, geometry, joint = pin.Model(), pin.GeometryModel(), 0
    for name, kind in (("x", pin.JointModelPX), ("y", pin.JointModelPY), ("z", pin.JointModelPZ)):
        limits = [np.full(1, value) for value in (1.0, 1.0, -2.0, 2.0)]
        joint = model.addJoint(joint, kind(), pin.SE3.Identity(), name, *limits)
    model.addBodyFrame("tool", joint, pin.SE3.Identity(), 0)
    geometry.addGeometryObject(pin.GeometryObject("ball", joint, pin.SE3.Identity(), coal.Sphere(BALL)))
    return pp.load_robot(model, geometry_model=geometry).arm("tool")


def gaps(gantry: pp.Arm, scene: pp.Scene, shape: Any, pose: pin.SE3) -> npt.NDArray[np.float64]:
    """The distances by coal, of those that are not small, less the clearances that are found here."""
    checker = pp.CollisionChecker(gantry, scene)
    found = []
    for q in np.random.default_rng(0).uniform(-0.6, 0.6, (400, 3)):
        at, there = coal.Transform3s(pose.rotation, pose.translation), coal.Transform3s(np.eye(3), q)
        by_coal = coal.distance(shape, at, coal.Sphere(BALL), there, coal.DistanceRequest(), coal.DistanceResult())
        assert checker.is_free(q) <= (by_coal > 0)
        if by_coal > 0.05:
            found.append(by_coal - checker.clearance(q))
    assert len(found) > 20
    return np.array(found)


def rounded(shape: Any, radius: float) -> Any:
    shape.setSweptSphereRadius(radius)
    return shape


def convex() -> Any:
    points = coal.StdVec_Vec3s()
    points.extend(list(np.random.default_rng(3).uniform(-0.2, 0.2, (30, 3))))
    return coal.Convex.convexHull(points, True, "Qt")


def triangles() -> Any:
    mesh, made = trimesh.creation.annulus(0.1, 0.2, 0.15), coal.BVHModelOBBRSS()
    made.beginModel(len(mesh.faces), len(mesh.vertices))
    made.addVertices(mesh.vertices)
    made.addTriangles(mesh.faces)
    made.endModel()
    return made


GEOMETRIES = {
    "box": coal.Box(0.3, 0.2, 0.1), "sphere": rounded(coal.Sphere(0.2), 0.05), "cone": coal.Cone(0.15, 0.3),
    "cylinder": coal.Cylinder(0.1, 0.3), "capsule": rounded(coal.Capsule(0.1, 0.2), 0.03),
    "ellipsoid": coal.Ellipsoid(0.1, 0.2, 0.3), "half_space": coal.Halfspace(np.array([1.0, 2.0, 2.0]), -0.3),
    "convex": convex(), "triangles": triangles(),
}  # fmt: skip


@pytest.mark.parametrize("kind", GEOMETRIES)
def test_a_geometry_of_coal_is_the_same_obstacle(gantry, kind):
    scene = pp.Scene([pp.Obstacle("thing", GEOMETRIES[kind], POSE)])
    found = gaps(gantry, scene, GEOMETRIES[kind], POSE)
    assert found.min() > -1e-5  # GJK
    assert found.max() < (1e-3 if kind == "triangles" else 1e-5)  # a mesh is covered by convex pieces


@pytest.mark.parametrize("shape", [coal.Box(0.3, 0.2, 0.1), coal.Cylinder(0.1, 0.3)])
def test_an_obstacle_with_rounded_edges_is_contained_in_one_with_sharp_edges(gantry, shape):
    shape = rounded(shape.clone(), 0.04)
    found = gaps(gantry, pp.Scene([pp.Obstacle("thing", shape, POSE)]), shape, POSE)
    assert found.min() > -1e-5
    assert 1e-3 < found.max() < 0.04 * (3**0.5 - 1) + 1e-5


@pytest.mark.parametrize(
    "shape",
    [
        coal.Plane(), coal.TriangleP(*np.eye(3)), coal.BVHModelOBBRSS(), rounded(coal.Cone(0.1, 0.2), 0.01),
        trimesh.primitives.Sphere(), trimesh.primitives.Cylinder(), trimesh.Scene(), 3, "box", None, [[0, 0, 0]],
        np.zeros((4, 2)), np.zeros((0, 3)), np.array([[0.0, 0, 0]]), np.array([[0.0, 0, 0], [0, 0, 0.5]]),
    ],
)  # fmt: skip
def test_another_object_is_refused_as_a_shape(shape):
    with pytest.raises(pp.InputError):
        pp.Obstacle("thing", shape)


def test_the_error_names_the_object_and_what_is_accepted():
    with pytest.raises(pp.InputError, match=r"'thing'.*coal Plane.*Box.*Convex"):
        pp.Obstacle("thing", coal.Plane())
    with pytest.raises(pp.InputError, match=r"'thing'.*trimesh.*Open3D"):
        pp.Obstacle("thing", {"box": 1})


def test_meshes_of_trimesh_and_open3d_are_meshes():
    mesh = trimesh.creation.annulus(0.1, 0.2, 0.15)
    of_open3d = SimpleNamespace(vertices=list(mesh.vertices), triangles=list(mesh.faces))
    expected = pp.Mesh.from_arrays(mesh.vertices, mesh.faces)
    assert pp.Obstacle("ring", mesh).shape == expected
    assert pp.Obstacle("ring", of_open3d).shape == expected
    box = trimesh.primitives.Box((0.1, 0.2, 0.3))
    assert pp.Obstacle("box", box).shape == pp.Mesh.from_arrays(box.vertices, box.faces)


def test_point_clouds_have_cells_of_two_centimetres():
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (5000, 3))
    expected = pp.PointCloud(points, resolution=0.02)
    of_open3d = type("PointCloud", (), {"points": list(points)})()
    for cloud in (points, trimesh.PointCloud(points), of_open3d):
        assert pp.Obstacle("cloud", cloud).shape == expected
    assert pp.PointCloud(SimpleNamespace(points=points), resolution=0.02) == expected


def test_an_object_that_is_more_than_its_points_is_no_point_cloud():
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (300, 3))
    lines = trimesh.load_path(np.array([[[0, 0, 0], [0.01, 0, 0]], [[0.01, 0, 0], [0.01, 0.015, 0]]]))
    voxels = trimesh.voxel.creation.voxelize(trimesh.creation.box((0.1, 0.1, 0.1)), 0.019)
    tetrahedra = SimpleNamespace(vertices=points, tetras=[[0, 1, 2, 3]])
    for thing in (ConvexHull(points), Delaunay(points), lines, voxels, tetrahedra, SimpleNamespace(points=points)):
        with pytest.raises(pp.InputError, match=r"(?s)'thing'.*points \(N, 3\)"):
            pp.Obstacle("thing", thing)


def test_a_sparse_point_cloud_needs_the_size_of_its_cells():
    with pytest.raises(pp.InputError, match=r"0\.05 m apart.*resolution"):
        pp.Obstacle("cloud", 0.05 * np.argwhere(np.ones((5, 5, 5))))


# -- geometry models ---------------------------------------------------------------------------------------------------


def test_a_geometry_model_is_a_scene_at_a_configuration(gantry):
    model, geometry = pin.Model(), pin.GeometryModel()
    joint = model.addJoint(0, pin.JointModelRZ(), POSE, "turn")
    geometry.addGeometryObject(pin.GeometryObject("table", 0, POSE, coal.Box(0.3, 0.2, 0.1)))
    geometry.addGeometryObject(pin.GeometryObject("wall", joint, POSE, coal.Halfspace(np.array([0.0, 0.6, 0.8]), -0.2)))
    data, placed = model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, placed, np.array([0.7]))
    scene = pp.Scene.from_geometry_model(geometry, placed)
    assert scene.is_close(pp.Scene.from_geometry_model(geometry, model=model, q=[0.7]))
    assert scene.names == ("table", "wall")
    for name, thing, pose in zip(scene, geometry.geometryObjects, placed.oMg, strict=True):
        found = gaps(gantry, pp.Scene([scene[name]]), thing.geometry, pose)
        assert np.abs(found).max() < 1e-5
    with pytest.raises(pp.InputError, match="'wall' moves"):
        pp.Scene.from_geometry_model(geometry)
    geometry.removeGeometryObject("wall")
    assert pp.Scene.from_geometry_model(geometry).is_close(scene.remove("wall"))


def test_placements_of_a_geometry_model_are_given_once_and_completely():
    model, geometry = pin.Model(), pin.GeometryModel()
    joint = model.addJoint(0, pin.JointModelRZ(), POSE, "turn")
    geometry.addGeometryObject(pin.GeometryObject("wall", joint, POSE, coal.Box(0.3, 0.2, 0.1)))
    placed = geometry.createData()
    pin.updateGeometryPlacements(model, model.createData(), geometry, placed, np.array([0.7]))
    with pytest.raises(pp.InputError, match="one of them"):  # those of data may be of another configuration
        pp.Scene.from_geometry_model(geometry, placed, model=model, q=[0.2])
    for data in (model.createData(), pin.GeometryModel().createData()):
        with pytest.raises(pp.InputError, match=r"GeometryData.*1 objects"):
            pp.Scene.from_geometry_model(geometry, data)
    for q in ([0.2, 0.3], "home", [np.nan]):
        with pytest.raises(pp.InputError, match="q "):
            pp.Scene.from_geometry_model(geometry, model=model, q=q)
    with pytest.raises(pp.InputError, match="geometry_model"):
        pp.Scene.from_geometry_model(model, model=model, q=[0.2])
    with pytest.raises(pp.InputError, match="model"):
        pp.Scene.from_geometry_model(geometry, model="ur5", q=[0.2])
