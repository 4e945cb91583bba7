"""Traps of coal and Pinocchio: each is shown in the library, then the correct result of this package."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

import pinproof as pp
from pinproof.collision.checking.links import link_bodies
from pinproof.collision.checking.placed_bodies import GJK_SLACK, GJK_TOLERANCE
from pinproof.collision.geometry.bodies import shape_bodies, shape_body
from pinproof.collision.geometry.hulls import bvh
from pinproof.description import read_urdf
from pinproof.description.ros_files import example_robot_data
from pinproof.errors import MeshError, UrdfError
from pinproof.model import load_robot


def overlap(a, at_a, b, at_b) -> bool:
    places = [coal.Transform3s(p.rotation, p.translation) for p in (at_a, at_b)]
    return bool(coal.collide(a, places[0], b, places[1], coal.CollisionRequest(), coal.CollisionResult()))


def test_build_convex_representation_is_not_a_hull_but_ours_is(mesh_file):
    """A torus as an STL has it, each triangle with its own corners; its hull fills the hole."""
    torus = trimesh.creation.torus(0.2, 0.05)
    torus.unmerge_vertices()
    relabelled = bvh(np.array(torus.vertices), np.array(torus.faces))
    relabelled.buildConvexRepresentation(False)
    ours = shape_body("torus", "torus", None, pp.Mesh(mesh_file(torus), hull=True), pin.SE3.Identity())
    hull = torus.convex_hull
    points = np.random.default_rng(0).uniform((-0.25, -0.25, -0.05), (0.25, 0.25, 0.05), (400, 3))
    offsets = np.einsum("ij,ij->i", hull.face_normals, hull.triangles[:, 0])
    inside = points[(points @ hull.face_normals.T < offsets).all(axis=1)]
    assert len(inside) > 100
    probe, here = coal.Sphere(1e-3), pin.SE3.Identity()
    places = [pin.SE3(np.eye(3), point) for point in inside]
    assert all(overlap(ours.geometry, here, probe, at) for at in places)
    assert not all(overlap(relabelled.convex, here, probe, at) for at in places)  # the trap


def test_a_ball_wholly_inside_a_closed_mesh_does_not_touch_it_for_coal():
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    hollow = bvh(np.array(box.vertices), np.array(box.faces))
    assert not overlap(hollow, pin.SE3.Identity(), coal.Sphere(0.01), pin.SE3.Identity())  # the trap


def test_a_cavity_between_walls_is_free_space(slider, mesh_file):
    outer, inner = trimesh.creation.box((0.4, 0.4, 0.4)), trimesh.creation.box((0.3, 0.3, 0.3))
    inner.invert()
    walls = trimesh.util.concatenate([outer, inner])
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("safe", pp.Mesh(mesh_file(walls), hull=False))]))
    assert checker.is_free([0.0])
    assert checker.clearance([0.0]) == pytest.approx(0.14, abs=1e-6)
    assert not checker.is_free([0.145])  # in the wall's surface
    assert checker.hollow_meshes == ()


def test_a_mesh_with_a_hole_is_refused_or_named_as_hollow(slider, mesh_file):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    open_box = trimesh.Trimesh(box.vertices, box.faces[1:], process=False)
    path = mesh_file(open_box)
    with pytest.raises(MeshError, match="not watertight"):
        pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("open", pp.Mesh(path, hull=False))]))
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("open", pp.Mesh(path, hull=False, hollow=True))]))
    assert checker.is_free([0.0])
    assert checker.hollow_meshes == ("open",)


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
        shape_body("flat", "flat", None, pp.Mesh(path, hull=True), pin.SE3.Identity())
    with pytest.raises(MeshError, match="is flat"):
        shape_bodies("flat", None, pp.Mesh(path), pin.SE3.Identity())


def test_an_exact_flat_mesh_is_a_surface(slider, mesh_file):
    sheet = mesh_file(np.array([[0.2, -1, -1], [0.2, 1, -1], [0.2, 0, 1.0]]), np.array([[0, 1, 2]]))
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("sheet", pp.Mesh(sheet, hull=False, hollow=True))]))
    assert not checker.is_free([0.2])
    assert checker.clearance([0.1]) == pytest.approx(0.09, abs=1e-6)


@pytest.mark.parametrize("margin", [0.0, 1e-3, 0.05])
@pytest.mark.parametrize("obstacle", [pp.Box(0.2, 1, 1), pp.Cylinder(0.1, 1), pp.Sphere(0.1), "hull", "exact"])
def test_the_margin_is_honoured_on_both_sides(slider, mesh_file, margin, obstacle):
    if isinstance(obstacle, str):
        obstacle = pp.Mesh(mesh_file(trimesh.creation.box((0.2, 1, 1))), hull=obstacle == "hull")
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("wall", obstacle, pp.pose((1, 0, 0)))]), margin=margin)
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

    def among(hull: bool) -> pp.CollisionChecker:
        mesh = pp.Mesh.from_arrays(np.asarray(ball.vertices), np.asarray(ball.faces), hull=hull)
        return pp.CollisionChecker(
            arm, pp.Scene([pp.Obstacle(f"ball{k}", mesh, pp.pose(at)) for k, at in enumerate(places)])
        )

    meshes, hulls = among(False), among(True)
    assert hulls.convex.all()
    assert not meshes.convex.any()
    for q in np.random.default_rng(0).uniform(-3, 3, (60, 2)):
        exact = hulls.clearance(q)
        assert exact - 1e-9 <= meshes.clearance(q) <= exact + GJK_TOLERANCE * (1 + exact)
        assert not meshes.with_margin(exact).is_free(q)
        assert meshes.with_margin(exact - 2 * GJK_SLACK).is_free(q)


LIMIT = '<limit lower="-3" upper="3" velocity="1" effort="1"/>'


def one_joint(base="", moving="", *, extra="", axis="0 0 1"):
    """A base and a link that turns about z; the words of their collision shapes."""
    shapes = (
        "".join(f"<collision><geometry>{s}</geometry></collision>" for s in text.split(";") if s)
        for text in (base, moving)
    )
    links = "".join(f'<link name="{name}">{text}</link>' for name, text in zip(("base", "arm"), shapes, strict=True))
    return (
        f'<robot name="r">{links}<link name="tip"/><joint name="q" type="revolute"><parent link="base"/>'
        f'<child link="arm"/><axis xyz="{axis}"/>{LIMIT}</joint><joint name="end" type="fixed"><parent link="arm"/>'
        f'<child link="tip"/></joint>{extra}</robot>'
    )


def in_pinocchio(text):
    model = pin.buildModelFromXML(text)
    return model, pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)


def test_a_shape_pinocchio_does_not_know_is_dropped_there_and_kept_here(capfd):
    text = one_joint(moving='<capsule radius="0.1" length="0.5"/>')
    assert in_pinocchio(text)[1].ngeoms == 0  # the trap: a link that collides with nothing
    capfd.readouterr()
    arm = load_robot(text).arm(tcp="tip")
    post = pp.Scene([pp.Obstacle("post", pp.Sphere(0.1), pp.pose((0.15, 0, 0)))])
    assert not pp.CollisionChecker(arm, post).is_free([0.0])
    with pytest.raises(UrdfError, match="cone"):
        load_robot(one_joint(moving='<cone radius="0.1" length="0.5"/>'))


def test_invalid_poses_are_refused():
    placement = pin.SE3(np.full((3, 3), np.nan), np.zeros(3))
    assert np.isnan(placement.rotation).all()  # the trap: no error
    skewed = pin.SE3(np.diag([1.0, 2.0, 1.0]), np.zeros(3))
    for pose_of in (placement, skewed):
        with pytest.raises(pp.InputError, match="pose of obstacle 'b'"):
            pp.Obstacle("b", pp.Box(1, 1, 1), pose_of)


def test_an_axis_of_no_length_is_refused():
    text = one_joint(moving='<sphere radius="0.1"/>', axis="0 0 0")
    model = pin.buildModelFromXML(text)
    data = model.createData()
    pin.forwardKinematics(model, data, np.array([0.7]))
    assert np.linalg.det(data.oMi[1].rotation) != pytest.approx(1.0, abs=0.1)  # the trap: no rotation at all
    with pytest.raises(UrdfError, match="axis"):
        load_robot(text)


def test_broadphase_managers_of_coal_ignore_margins_and_ours_do_not(slider):
    manager, request = coal.DynamicAABBTreeCollisionManager(), coal.CollisionRequest()
    request.security_margin = 0.1
    here, there = (coal.CollisionObject(coal.Sphere(0.1), np.eye(3), np.array([x, 0, 0])) for x in (0.0, 0.25))
    manager.registerObject(there)
    manager.setup()
    callback = coal.CollisionCallBackDefault()
    callback.data.request = request
    manager.collide(here, callback)
    assert not callback.data.result.isCollision()  # the trap: they are 0.05 apart
    walls = [pp.Obstacle(f"wall_{i}", pp.Box(0.1, 1, 1), pp.pose((0.3 + 0.5 * i, 0, 0))) for i in range(6)]
    checker = pp.CollisionChecker(slider, pp.Scene(walls), margin=0.1)
    assert [contact.bodies for contact in checker.check([0.15]).contacts] == [("ball", "wall_0")]
    assert checker.clearance([0.15]) == pytest.approx(0.09, abs=1e-8)
    assert checker.is_free([0.13])


def test_needle_triangles_of_a_hollow_mesh_are_detected(slider):
    """Triangles without area: coal's collide lets some pass through another mesh, though their distance is 0."""
    sheet = np.array([[-1.0, -1, 0], [1.0, -1, 0], [0, 1.5, 0]])
    passed, rng = 0, np.random.default_rng(0)
    for _ in range(20):
        one, other = np.array([[0.1, 0.05, -1], [0, 0, 1]]) + 0.1 * rng.normal(size=(2, 3))
        needle = np.array([one, other, one + rng.uniform() * (other - one)])
        meshes, here = [bvh(points, np.array([[0, 1, 2]])) for points in (needle, sheet)], coal.Transform3s.Identity()
        seen = coal.collide(meshes[0], here, meshes[1], here, coal.CollisionRequest(), coal.CollisionResult())
        passed += not seen
        tool, thing = (pp.Mesh.from_arrays(points, [[0, 1, 2]], hull=False, hollow=True) for points in (needle, sheet))
        checker = pp.CollisionChecker(
            slider,
            pp.Scene([pp.Obstacle("sheet", thing)]),
            attached=[pp.Obstacle("needle", tool)],
            allowed=[("ball", "sheet")],
        )
        assert not checker.is_free([0.0])
        assert checker.is_free([3.0])
    assert passed > 0  # the trap


def test_height_fields_of_coal_know_no_distance():
    field = coal.HeightFieldOBBRSS(1.0, 1.0, np.zeros((3, 3)), -0.1)
    with pytest.raises(ValueError, match="not implemented"):
        apart(field, coal.Sphere(0.1), 1.0)


def test_octrees_of_coal_cannot_be_relied_on():
    """Two of them always touch, one order of an ellipsoid and one is unknown, and what lies far out is dropped."""
    cell = coal.makeOctree(np.array([[0.05, 0.05, 0.05]]), 0.1)
    assert touching(cell, cell, 3.0)
    assert apart(cell, cell, 3.0) == pytest.approx(2.9)
    with pytest.raises(ValueError, match="not yet supported"):
        apart(coal.Ellipsoid(0.1, 0.1, 0.1), cell, 1.0)
    wide = coal.makeOctree(np.array([[0.0, 0.0, 0.0], [40_000.5, 0.5, 0.5]]), 1.0)
    assert not touching(wide, coal.Sphere(0.1), 40_000.5)
    cloud = pp.PointCloud([[0, 0, 0], [9_000.5, 0.5, 0.5]], 0.1)
    body = shape_body("wide", "wide", None, cloud, pin.SE3.Identity())
    assert touching(body.geometry, coal.Sphere(1.0), 9_000.5)


def apart(a, b, x) -> float:
    places = coal.Transform3s(), coal.Transform3s(np.eye(3), np.array([x, 0.0, 0.0]))
    return float(coal.distance(a, places[0], b, places[1], coal.DistanceRequest(), coal.DistanceResult()))


def touching(a, b, x) -> bool:
    places = coal.Transform3s(), coal.Transform3s(np.eye(3), np.array([x, 0.0, 0.0]))
    return bool(coal.collide(a, places[0], b, places[1], coal.CollisionRequest(), coal.CollisionResult()))
