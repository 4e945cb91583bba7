"""Traps of coal and Pinocchio: each is shown in the library, then the correct result of this package."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from pinproof import Box, CollisionChecker, Cylinder, Mesh, Obstacle, Scene, Sphere, pose
from pinproof.collision.checking.links import link_bodies
from pinproof.collision.checking.placed_bodies import GJK_SLACK, GJK_TOLERANCE
from pinproof.collision.geometry.bodies import shape_bodies, shape_body
from pinproof.collision.geometry.hulls import bvh
from pinproof.description import read_urdf
from pinproof.description.ros_files import example_robot_data
from pinproof.errors import MeshError


def overlap(a, at_a, b, at_b) -> bool:
    places = [coal.Transform3s(p.rotation, p.translation) for p in (at_a, at_b)]
    return bool(coal.collide(a, places[0], b, places[1], coal.CollisionRequest(), coal.CollisionResult()))


def test_build_convex_representation_is_not_a_hull_but_ours_is(mesh_file):
    """A torus as an STL has it, each triangle with its own corners; its hull fills the hole."""
    torus = trimesh.creation.torus(0.2, 0.05)
    torus.unmerge_vertices()
    relabelled = bvh(np.array(torus.vertices), np.array(torus.faces))
    relabelled.buildConvexRepresentation(False)
    ours = shape_body("torus", "torus", None, Mesh(mesh_file(torus), hull=True), pin.SE3.Identity())
    hull = torus.convex_hull
    points = np.random.default_rng(0).uniform((-0.25, -0.25, -0.05), (0.25, 0.25, 0.05), (400, 3))
    offsets = np.einsum("ij,ij->i", hull.face_normals, hull.triangles[:, 0])
    inside = points[(points @ hull.face_normals.T < offsets).all(axis=1)]
    assert len(inside) > 100
    probe, here = coal.Sphere(1e-3), pin.SE3.Identity()
    places = [pin.SE3(np.eye(3), point) for point in inside]
    assert all(overlap(ours.geometry, here, probe, at) for at in places)
    assert not all(overlap(relabelled.convex, here, probe, at) for at in places)  # the trap


@pytest.mark.parametrize("hull", [True, False])
def test_a_ball_wholly_inside_a_closed_mesh_touches_it(slider, mesh_file, hull):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    hollow = bvh(np.array(box.vertices), np.array(box.faces))
    assert not overlap(hollow, pin.SE3.Identity(), coal.Sphere(0.01), pin.SE3.Identity())  # the trap
    checker = CollisionChecker(slider, Scene([Obstacle("box", Mesh(mesh_file(box), hull=hull))]))
    assert not checker.is_free([0.0])
    assert checker.clearance([0.0]) < 0
    assert [c.bodies for c in checker.check([0.0]).contacts] == [("ball", "box")]
    assert checker.is_free([0.3])
    assert checker.clearance([0.3]) == pytest.approx(0.09, abs=1e-6)


def test_a_mesh_inside_a_body_and_a_body_inside_a_mesh_collide(slider, mesh_file):
    small = Mesh(mesh_file(trimesh.creation.box((0.02, 0.02, 0.02))), hull=False)
    big = Mesh(mesh_file(trimesh.creation.icosphere(radius=0.3)), hull=False)
    for tool, thing in ((small, big), (big, small)):
        checker = CollisionChecker(
            slider,
            Scene([Obstacle("thing", thing, pose((0, 0, 0.1)))]),
            attached=[Obstacle("tool", tool, pose((0, 0, 0.1)))],
            allowed=[("ball", "thing")],
        )
        assert not checker.is_free([0.0])
        assert checker.clearance([0.0]) < 0
        assert checker.is_free([0.5])


def test_a_cavity_between_walls_is_free_space(slider, mesh_file):
    outer, inner = trimesh.creation.box((0.4, 0.4, 0.4)), trimesh.creation.box((0.3, 0.3, 0.3))
    inner.invert()
    walls = trimesh.util.concatenate([outer, inner])
    checker = CollisionChecker(slider, Scene([Obstacle("safe", Mesh(mesh_file(walls), hull=False))]))
    assert checker.is_free([0.0])
    assert checker.clearance([0.0]) == pytest.approx(0.14, abs=1e-6)
    assert not checker.is_free([0.145])  # in the wall's surface
    assert checker.hollow == ()


def test_a_mesh_with_a_hole_is_refused_or_named_as_hollow(slider, mesh_file):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    open_box = trimesh.Trimesh(box.vertices, box.faces[1:], process=False)
    path = mesh_file(open_box)
    with pytest.raises(MeshError, match="not watertight"):
        CollisionChecker(slider, Scene([Obstacle("open", Mesh(path, hull=False))]))
    checker = CollisionChecker(slider, Scene([Obstacle("open", Mesh(path, hull=False, hollow=True))]))
    assert checker.is_free([0.0])
    assert checker.hollow == ("open",)


FLAT_MESHES = {
    "a square": ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]),
    "a tilted square": ([[0, 0, 0], [1, 0, 1], [1, 1, 1], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]),
    "three points": ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
    "a line": ([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], [[0, 1, 2], [1, 2, 3]]),
    "a point": ([[1, 1, 1]], [[0, 0, 0]]),
    "a box 1e-8 thick": (trimesh.creation.box((1, 1, 1e-8)).vertices, trimesh.creation.box().faces),
    "100 m by a micrometre": (trimesh.creation.box((100, 70, 1.1e-6)).vertices, trimesh.creation.box().faces),
}


@pytest.mark.parametrize("name", FLAT_MESHES)
def test_the_hull_of_a_flat_mesh_is_refused(mesh_file, name):
    vertices, triangles = FLAT_MESHES[name]
    path = mesh_file(np.array(vertices, dtype=float), np.array(triangles))
    with pytest.raises(MeshError, match="is flat"):
        shape_body("flat", "flat", None, Mesh(path, hull=True), pin.SE3.Identity())
    with pytest.raises(MeshError, match="is flat"):
        shape_bodies("flat", None, Mesh(path), pin.SE3.Identity())


def test_an_exact_flat_mesh_is_a_surface(slider, mesh_file):
    sheet = mesh_file(np.array([[0.2, -1, -1], [0.2, 1, -1], [0.2, 0, 1.0]]), np.array([[0, 1, 2]]))
    checker = CollisionChecker(slider, Scene([Obstacle("sheet", Mesh(sheet, hull=False, hollow=True))]))
    assert not checker.is_free([0.2])
    assert checker.clearance([0.1]) == pytest.approx(0.09, abs=1e-6)


def test_a_distance_result_kept_by_coal_goes_stale_but_ours_does_not(slider):
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    mesh = trimesh.creation.icosphere(radius=0.1)
    ball, places = (
        bvh(np.array(mesh.vertices), np.array(mesh.faces)),
        [coal.Transform3s(np.eye(3), np.array([x, 0, 0])) for x in (0.0, 1.0, 3.0)],
    )
    near = coal.distance(ball, places[0], ball, places[1], request, result)
    coal.distance(ball, places[0], ball, places[2], request, result)
    assert result.min_distance == pytest.approx(near)  # the trap: 0.8, though the balls are 2.8 apart
    checker = CollisionChecker(slider, Scene([Obstacle("wall", Box(0.1, 1, 1), pose((1, 0, 0)))]))
    for x in (0.9, 0.0, 0.5, -1.0):
        assert checker.clearance([x]) == pytest.approx(0.94 - x, abs=1e-7)


@pytest.mark.parametrize("margin", [0.0, 1e-3, 0.05])
@pytest.mark.parametrize("obstacle", [Box(0.2, 1, 1), Cylinder(0.1, 1), Sphere(0.1), "hull", "exact"])
def test_the_margin_is_honoured_on_both_sides(slider, mesh_file, margin, obstacle):
    if isinstance(obstacle, str):
        obstacle = Mesh(mesh_file(trimesh.creation.box((0.2, 1, 1))), hull=obstacle == "hull")
    checker = CollisionChecker(slider, Scene([Obstacle("wall", obstacle, pose((1, 0, 0)))]), margin=margin)
    touching = 1 - 0.1 - 0.01 - margin
    for inside in (touching + 1e-6, touching + 1e-3, touching):
        assert not checker.is_free([inside])
        assert not checker.check([inside]).free
    for outside in (touching - GJK_SLACK - 1e-6, touching - 1e-3):
        assert checker.is_free([outside])
        assert checker.check([outside]).free
        assert checker.clearance([outside]) > margin


def test_gjk_distances_are_within_the_slack():
    """A cylinder against triangles: the distance of a point to a cylinder is known, and convex over the triangle."""
    rng = np.random.default_rng(3)
    request = coal.DistanceRequest()
    request.gjk_tolerance, request.gjk_max_iterations = GJK_TOLERANCE, 1000
    cylinder, worst = coal.Cylinder(0.05, 0.3), 0.0
    for _ in range(60):
        corners = rng.normal(size=(3, 3)) * rng.choice([0.02, 0.3, 3.0]) + rng.uniform(-1, 1, 3)
        distance = coal.distance(
            bvh(corners, np.array([[0, 1, 2]])),
            coal.Transform3s(),
            cylinder,
            coal.Transform3s(),
            request,
            coal.DistanceResult(),
        )
        if distance > 0:
            worst = max(worst, distance - _triangle_to_cylinder(corners, 0.05, 0.3))
    assert worst < GJK_SLACK / 10


def _triangle_to_cylinder(corners, radius, length) -> float:
    """By narrowing a grid over the triangle; never below the true distance."""
    centre, width, best = np.full(2, 1 / 3), 2.0, np.inf
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 31)] * 2), axis=-1).reshape(-1, 2)
    while width > 1e-9:
        s = np.clip(centre[0] + width * grid[:, 0], 0, 1)
        t = np.clip(centre[1] + width * grid[:, 1], 0, 1 - s)
        points = corners[0] + s[:, None] * (corners[1] - corners[0]) + t[:, None] * (corners[2] - corners[0])
        off_axis = np.maximum(np.hypot(points[:, 0], points[:, 1]) - radius, 0)
        distances = np.hypot(off_axis, np.maximum(np.abs(points[:, 2]) - length / 2, 0))
        k = int(distances.argmin())
        best, centre, width = min(best, float(distances[k])), np.array([s[k], t[k]]), width * 0.4
    return best


SUPPORTED = {
    "box": Box(0.2, 0.1, 0.3),
    "plate": Box(0.4, 0.3, 1e-4),
    "cylinder": Cylinder(0.05, 0.3),
    "disc": Cylinder(0.3, 1e-3),
    "sphere": Sphere(0.1),
}


@pytest.mark.parametrize("kind", SUPPORTED)
def test_the_support_gap_never_exceeds_the_true_distance(kind):
    """Points of a body can only be farther apart than the gap of the supports, in any direction."""
    rng = np.random.default_rng(1)
    body = shape_body(kind, kind, None, SUPPORTED[kind], pin.SE3.Identity())
    samples = _surface(SUPPORTED[kind], rng)
    for _ in range(50):
        u = rng.normal(size=3)
        u /= np.linalg.norm(u)
        reach = body.support.reach(u)
        assert (samples @ u).max() <= reach + 1e-12
        assert (samples @ u).max() >= reach - 0.1 * np.ptp(samples @ u)  # and it is no idle bound
        assert (np.abs(samples) <= body.box[1] + 1e-12).all()


def _surface(shape, rng):
    if isinstance(shape, Sphere):
        points = rng.normal(size=(2000, 3))
        return shape.radius * points / np.linalg.norm(points, axis=1)[:, None]
    if isinstance(shape, Box):
        return rng.choice([-0.5, 0.5], size=(200, 3)) * [shape.x, shape.y, shape.z]
    angle = rng.uniform(0, 2 * np.pi, 2000)
    z = rng.choice([-0.5, 0.5], 2000) * shape.length
    return np.stack([shape.radius * np.cos(angle), shape.radius * np.sin(angle), z], axis=1)


@pytest.mark.slow
def test_a_mesh_on_which_qhull_gives_up_is_refused_by_name():
    """Some meshes of this humanoid have no hull that coal can use; each is refused as a mesh."""
    robots = example_robot_data() / "example-robot-data" / "robots"
    refused = []
    for geometry in read_urdf(robots / "centauro_description" / "urdf" / "centauro.urdf").collisions:
        try:
            link_bodies(geometry, "hull")
        except MeshError as error:
            refused.append(str(error))
    assert refused
    assert all("hull=False" in expected for expected in refused)


def test_distances_of_triangles_are_as_accurate_as_the_allowance_for_coal_assumes(arm_from_links):
    """A cylinder and a box at metres from round meshes, whose hulls the compiled core measures exactly."""
    arm = arm_from_links(
        {"base": "", "drum": '<cylinder radius="0.3" length="1.0"/>', "block": '<box size="0.4 0.5 0.2"/>'},
        [
            ("q1", "revolute", "base", "drum", "0 0 0.3", "0.27 0.89 0.36"),
            ("q2", "revolute", "drum", "block", "0.2 0 0.2", "0.91 0.09 0.4"),
        ],
    ).arm(tcp="block")
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.4)
    places = [(3, 2, 1), (-2, 3, 1), (0, 0, 4), (1, -2, -2)]

    def among(hull: bool) -> CollisionChecker:
        mesh = Mesh.from_arrays(np.asarray(ball.vertices), np.asarray(ball.faces), hull=hull)
        return CollisionChecker(arm, Scene([Obstacle(f"ball{k}", mesh, pose(at)) for k, at in enumerate(places)]))

    meshes, hulls = among(False), among(True)
    assert hulls.convex.all()
    assert not meshes.convex.any()
    for q in np.random.default_rng(0).uniform(-3, 3, (60, 2)):
        exact = hulls.clearance(q)
        assert exact - 1e-9 <= meshes.clearance(q) <= exact + GJK_TOLERANCE * (1 + exact)
        assert not meshes.with_margin(exact).is_free(q)
        assert meshes.with_margin(exact - 2 * GJK_SLACK).is_free(q)
