"""More silences of coal and Pinocchio: each is shown there, then the right answer here."""

from __future__ import annotations

import threading

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from pinproof import Box, CertificateStatus, CollisionChecker, InputError, Mesh, Obstacle, Scene, Sphere, certify, pose
from pinproof.collision.hulls import bvh
from pinproof.errors import UrdfError
from pinproof.model.robot import load_robot_from_text

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
    arm = load_robot_from_text(text).arm(tcp="tip")
    post = Scene([Obstacle("post", Sphere(0.1), pose((0.15, 0, 0)))])
    assert not CollisionChecker(arm, post).is_free([0.0])
    with pytest.raises(UrdfError, match="cone"):
        load_robot_from_text(one_joint(moving='<cone radius="0.1" length="0.5"/>'))


@pytest.mark.parametrize("radius", ["-1", "nan"])
def test_a_ball_that_never_collides_is_refused(radius):
    sphere = coal.Sphere(float(radius))
    places = [coal.Transform3s(np.eye(3), np.array([x, 0, 0])) for x in (0.0, 0.1)]
    touch = coal.collide(
        sphere, places[0], coal.Box(1, 1, 1), places[1], coal.CollisionRequest(), coal.CollisionResult()
    )
    assert not touch  # the trap: in the middle of a box of a metre
    with pytest.raises(UrdfError):
        load_robot_from_text(one_joint(moving=f'<sphere radius="{radius}"/>'))


def test_places_that_are_none_are_refused():
    placement = pin.SE3(np.full((3, 3), np.nan), np.zeros(3))
    assert np.isnan(placement.rotation).all()  # the trap: nothing was said
    skewed = pin.SE3(np.diag([1.0, 2.0, 1.0]), np.zeros(3))
    for pose_of in (placement, skewed):
        with pytest.raises(InputError, match="pose of obstacle 'b'"):
            Obstacle("b", Box(1, 1, 1), pose_of)


def test_an_axis_of_no_length_is_refused():
    text = one_joint(moving='<sphere radius="0.1"/>', axis="0 0 0")
    model = pin.buildModelFromXML(text)
    data = model.createData()
    pin.forwardKinematics(model, data, np.array([0.7]))
    assert np.linalg.det(data.oMi[1].rotation) != pytest.approx(1.0, abs=0.1)  # the trap: no rotation at all
    with pytest.raises(UrdfError, match="axis"):
        load_robot_from_text(text)


def test_the_base_is_checked_against_the_scene():
    """``addAllCollisionPairs`` leaves out what hangs on the same joint: the base and the world are one to it."""
    text = one_joint('<box size="0.2 0.2 0.2"/>', '<sphere radius="0.01"/>')
    _, geometry = in_pinocchio(text)
    table = pin.GeometryObject("table", 0, 0, pin.SE3.Identity(), coal.Box(1, 1, 0.1))
    geometry.addGeometryObject(table)
    geometry.addAllCollisionPairs()
    names = [
        {geometry.geometryObjects[p.first].name, geometry.geometryObjects[p.second].name}
        for p in geometry.collisionPairs
    ]
    assert {"base_0", "table"} not in names  # the trap
    assert {"arm_0", "table"} in names
    checker = CollisionChecker(
        load_robot_from_text(text).arm(tcp="tip"), Scene([Obstacle("table", Box(1, 1, 0.1), pose((0, 0, -0.1)))])
    )
    assert [contact.bodies for contact in checker.check([0.0]).contacts] == [("base", "table")]
    assert not checker.is_free([0.0])


def test_a_mimic_joint_is_not_a_free_joint():
    """By default Pinocchio treats a mimic joint as a free joint: it does not follow its leader."""
    ball = '<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.05"/></geometry></collision>'
    follower = (
        f'<link name="follower">{ball}</link><joint name="f" type="revolute"><parent link="base"/>'
        f'<child link="follower"/><axis xyz="0 0 1"/>{LIMIT}<mimic joint="q" multiplier="2"/></joint>'
    )
    text = one_joint(moving='<sphere radius="0.01"/>', extra=follower)
    assert pin.buildModelFromXML(text).nq == 2  # the trap
    arm = load_robot_from_text(text).arm(tcp="tip")
    assert arm.dof == 1
    post = Scene([Obstacle("post", Sphere(0.05), pose((0, 0.5, 0)))])  # where the follower is for q = pi / 4
    assert not CollisionChecker(arm, post).is_free([np.pi / 4])
    assert CollisionChecker(arm, post).is_free([0.0])


def test_a_scene_that_changes_is_a_new_model(slider):
    """Geometry added after the data were made has no place there; coal reads beyond their end."""
    geometry, model = pin.GeometryModel(), pin.Model()
    data = geometry.createData()
    geometry.addGeometryObject(pin.GeometryObject("late", 0, 0, pin.SE3.Identity(), coal.Sphere(0.1)))
    assert len(data.oMg) == 0 < geometry.ngeoms  # the trap
    assert model.nq == 0
    checker = CollisionChecker(slider, Scene())
    for x in (0.5, 0.2, 0.8):
        assert checker.is_free([x])
        checker = checker.with_scene(checker.scene.add(Obstacle(f"at_{x}", Sphere(0.05), pose((x, 0, 0)))))
        assert not checker.is_free([x])
        assert [contact.bodies[1] for contact in checker.check([x]).contacts] == [f"at_{x}"]
    emptied = checker.with_scene(checker.scene.remove("at_0.5"))
    assert emptied.is_free([0.5])
    assert not checker.is_free([0.5])


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
    walls = [Obstacle(f"wall_{i}", Box(0.1, 1, 1), pose((0.3 + 0.5 * i, 0, 0))) for i in range(6)]
    checker = CollisionChecker(slider, Scene(walls), margin=0.1)
    assert [contact.bodies for contact in checker.check([0.15]).contacts] == [("ball", "wall_0")]
    assert checker.clearance([0.15]) == pytest.approx(0.09, abs=1e-8)
    assert checker.is_free([0.13])


def test_sides_are_full_sides_and_lengths_full_lengths(slider):
    """A box of 0.2 m reaches 0.1 m from its middle; in other libraries the same number means half a side."""
    checker = CollisionChecker(slider, Scene([Obstacle("box", Box(0.2, 1, 1), pose((1, 0, 0)))]))
    assert checker.clearance([0.5]) == pytest.approx(1 - 0.1 - 0.01 - 0.5, abs=1e-9)


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
        tool, thing = (Mesh.from_arrays(points, [[0, 1, 2]], hull=False, hollow=True) for points in (needle, sheet))
        checker = CollisionChecker(
            slider, Scene([Obstacle("sheet", thing)]), attached=[Obstacle("needle", tool)], allowed=[("ball", "sheet")]
        )
        assert not checker.is_free([0.0])
        assert checker.is_free([3.0])
    assert passed > 0  # the trap


def test_no_continuous_check_in_coal_is_relied_on(slider, path):
    """A ball of 1 cm jumps over a sheet of a micrometre between any two samples that are no nearer than itself."""
    sheet = Scene([Obstacle("sheet", Box(1e-6, 1, 1), pose((0.5, 0, 0)))])
    checker, move = CollisionChecker(slider, sheet), path(slider, [0.0], [1.0])
    assert checker.is_free_batch(move(np.linspace(0, 1, 36))).all()  # the trap
    certificate = certify(move, checker)
    assert certificate.status is CertificateStatus.COLLIDING
    assert certificate.first_contact.proven_free_until == pytest.approx(0.49, abs=1e-3)


@pytest.mark.slow
def test_one_checker_serves_threads_where_one_data_does_not(ur5, mesh_file):
    """Pinocchio's data are one configuration's; shared by threads they are the last one. Here each has its own."""
    model, data = ur5.model, ur5.model.createData()
    first, second = np.zeros(6), np.ones(6)
    pin.forwardKinematics(model, data, first)
    placement = data.oMi[6]
    before = placement.translation.copy()
    pin.forwardKinematics(model, data, second)
    assert not np.allclose(placement.translation, before)  # the trap: what was handed out has changed
    thing = Mesh(mesh_file(trimesh.creation.torus(0.2, 0.05)), hull=False)
    checker = CollisionChecker(ur5, Scene([Obstacle("ring", thing, pose((0.5, 0.1, 0.4)))]))
    Q = np.random.default_rng(0).uniform(-2, 2, (120, 6))
    alone = [checker.clearance(q) for q in Q]
    answers = [[] for _ in range(4)]
    threads = [threading.Thread(target=lambda out=out: out.extend(checker.clearance(q) for q in Q)) for out in answers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(out == alone for out in answers)
