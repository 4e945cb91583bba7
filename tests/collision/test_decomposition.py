"""Several hulls that hold all of a mesh: proven on points of its surface and of its inside."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull as Hull

from pinproof import CollisionChecker, Obstacle, Scene, Sphere, load_robot, pose
from pinproof.collision.geometry.bodies import hull_body
from pinproof.collision.geometry.convex_pieces import PIECES, clusters
from pinproof.collision.geometry.hulls import Solid
from pinproof.description.meshes import read_mesh
from pinproof.spatial import pose as placed

from ..examples import examples

ROUNDING = 1e-9


def cover(mesh: trimesh.Trimesh, pieces: int = PIECES) -> list[np.ndarray]:
    solid = Solid(np.array(mesh.vertices), np.array(mesh.faces))
    return clusters(np.array(mesh.triangles), solid.contains, pieces)


def held(points, parts) -> np.ndarray:
    """Whether each point lies in one of the bodies that are made of the parts: by the faces of their coal shapes."""
    inside = np.zeros(len(points), dtype=bool)
    for part in parts:
        faces = Hull(hull_body("part", "link", part, placed()).support.points).equations
        inside |= (points @ faces[:, :3].T + faces[:, 3] <= ROUNDING).all(axis=1)
    return inside


def tray(t: float) -> trimesh.Trimesh:
    """An open box with walls of ``t`` metres: squares from the floor up, over the rim, and down inside."""
    rings = [
        np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])
        for x, y, z in ((0.3, 0.2, -0.1), (0.3, 0.2, 0.1), (0.3 - t, 0.2 - t, 0.1), (0.3 - t, 0.2 - t, t - 0.1))
    ]
    faces = [[0, 2, 1], [0, 3, 2]]
    for k in range(3):
        for i in range(4):
            a, b = 4 * k + i, 4 * k + (i + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    faces += [[12, 13, 14], [12, 14, 15]]
    return trimesh.Trimesh(np.concatenate(rings), faces, process=False)


SHAPES = {
    "box": lambda: trimesh.creation.box((0.3, 0.2, 0.1)),
    "ring": lambda: trimesh.creation.torus(0.2, 0.05, 24, 12),
    "tray": lambda: tray(0.01),
    "foil tray": lambda: tray(1e-5),
    "two balls": lambda: trimesh.util.concatenate(
        [trimesh.creation.icosphere(2, 0.1), trimesh.creation.icosphere(2, 0.1).apply_translation((0.5, 0.1, 0.2))]
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_every_point_of_surface_and_inside_is_contained(name):
    mesh = SHAPES[name]()
    assert mesh.is_watertight
    parts = cover(mesh)
    rng = np.random.default_rng(0)
    assert held(trimesh.sample.sample_surface(mesh, 3000, seed=0)[0], parts).all()
    points = rng.uniform(*mesh.bounds, (1500, 3))
    inside = mesh.contains(points)
    assert held(points[inside], parts).all()
    assert len(parts) <= PIECES


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most"), [("ring", 1.2), ("tray", 1.4), ("two balls", 1.05)])
def test_a_concave_mesh_is_covered_closely(name, most):
    mesh = SHAPES[name]()
    volume = sum(Hull(part).volume for part in cover(mesh))
    assert mesh.volume * (1 - 1e-9) <= volume <= most * mesh.volume
    assert mesh.convex_hull.volume > 1.5 * mesh.volume


@pytest.mark.parametrize("axis", range(3))
def test_plates_at_an_angle_are_covered_closely(axis):
    """The plane between them is not in the middle of the mesh."""
    sizes, places = [(0.5, 0.3, 0.04), (0.03, 0.3, 0.2)], [(0.25, 0, 0.02), (0.015, 0, 0.14)]
    plates = [
        trimesh.creation.box(np.roll(s, axis)).apply_translation(np.roll(p, axis))
        for s, p in zip(sizes, places, strict=True)
    ]
    mesh = trimesh.boolean.union(plates, engine="manifold")
    parts = cover(mesh)
    assert 1 < len(parts) <= PIECES
    assert mesh.volume * (1 - 1e-9) <= sum(Hull(part).volume for part in parts) <= 1.15 * mesh.volume
    assert held(np.asarray(mesh.vertices), parts).all()


def test_balls_far_apart_are_covered_by_at_least_one_hull_each():
    mesh = trimesh.util.concatenate([trimesh.creation.icosphere(1, 0.1).apply_translation((x, 0, 0)) for x in (0, 1)])
    parts = cover(mesh)
    assert mesh.volume * (1 - 1e-9) <= sum(Hull(part).volume for part in parts) <= 1.05 * mesh.volume
    assert held(np.asarray(mesh.vertices), parts).all()


def test_a_convex_mesh_remains_one_body():
    for mesh in (SHAPES["box"](), trimesh.creation.icosphere(2, 0.1)):
        assert len(cover(mesh)) == 1
        mesh.invert()
        assert len(cover(mesh)) == 1


@pytest.mark.slow
def test_a_fine_mesh_is_contained_in_its_decomposition():
    """More triangles than are used to choose a cut."""
    mesh = trimesh.creation.torus(0.2, 0.05, 21, 10)
    parts = cover(mesh, 4)
    assert 1 < len(parts) <= 4
    assert held(mesh.triangles.reshape(-1, 3), parts).all()
    assert held(trimesh.sample.sample_surface(mesh, 500, seed=0)[0], parts).all()


@pytest.mark.slow
@given(st.integers(0, 10_000), st.integers(1, 8))
@examples(25)
def test_random_triangles_are_inside_their_decomposition(seed, pieces):
    """Triangles that enclose nothing, thin and flat ones among them, large ones across many cells."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(12, 1, 3)) + rng.normal(size=(12, 3, 3)) * rng.choice([0.01, 0.5, 3.0], (12, 1, 1))
    corners[:4, :, 2] = 0.5
    parts = clusters(corners, lambda _: False, pieces)
    assert 1 <= len(parts) <= pieces
    shares = rng.dirichlet((1, 1, 1), (12, 50))
    points = np.einsum("fsk,fkx->fsx", shares, corners).reshape(-1, 3)
    assert held(np.concatenate([points, corners.reshape(-1, 3)]), parts).all()


def test_flat_parts_are_thickened_a_little():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    body = hull_body("sheet", "link", square, placed())
    assert (body.box[0] <= [0, 0, -4e-6]).all()
    assert (body.box[1] - [1, 1, 0] <= 1e-5).all()
    line = hull_body("line", "link", square[:2], placed())
    assert np.ptp(line.support.points, axis=0) == pytest.approx([1, 1e-5, 1e-5], abs=1e-9)


def test_a_decomposed_robot_touches_whatever_its_meshes_touch():
    arm = load_robot("ur5").arm()
    at = pose((0.35, 0.15, 0.4))
    scene = Scene([Obstacle("ball", Sphere(0.08), at)])
    bent = ("upper_arm_link", "forearm_link")  # the links that are far from convex
    hows = ("hull", "mesh", "decomposed")
    kinds = {how: CollisionChecker(arm, scene, link_meshes=dict.fromkeys(bent, how)) for how in hows}
    touched = dict.fromkeys(kinds, 0)
    for q in np.random.default_rng(4).uniform(*arm.limits.sampling_range(), (150, 6)):
        expected = {how: {frozenset(c.bodies) for c in checker.check(q).contacts} for how, checker in kinds.items()}
        assert expected["mesh"] <= expected["decomposed"] <= expected["hull"]
        for how, contacts in expected.items():
            touched[how] += len(contacts)
    assert touched["mesh"] <= touched["decomposed"] < touched["hull"]


def test_a_body_inside_a_decomposed_link_collides():
    arm = load_robot("ur5").arm()
    geometry = next(g for g in arm.robot.urdf.collisions if g.link == "forearm_link")
    mesh = read_mesh(geometry.mesh.path, geometry.size)
    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles)
    deep = [
        p
        for p in trimesh.sample.volume_mesh(solid, 400)
        if abs(trimesh.proximity.signed_distance(solid, [p])[0]) > 0.02
    ]
    assert len(deep) > 5
    q = np.zeros(6)
    root_from_link = arm.frame_placement(q, "forearm_link")
    for point in deep[:8]:
        where = root_from_link.act(geometry.origin[:3, :3] @ point + geometry.origin[:3, 3])
        scene = Scene([Obstacle("bead", Sphere(1e-3), pose(where))])
        checker = CollisionChecker(arm, scene, link_meshes={"forearm_link": "decomposed"})
        assert ("forearm_link", "bead") in [c.bodies for c in checker.check(q).contacts]
