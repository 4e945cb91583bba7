"""More silences of coal and Pinocchio: each is shown there, then the right answer here."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest

from pinproof import Box, CertificateStatus, CollisionChecker, InputError, Mesh, Obstacle, Scene, Sphere, certify, pose
from pinproof.collision.geometry.hulls import bvh
from pinproof.errors import UrdfError
from pinproof.model import load_robot

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
    post = Scene([Obstacle("post", Sphere(0.1), pose((0.15, 0, 0)))])
    assert not CollisionChecker(arm, post).is_free([0.0])
    with pytest.raises(UrdfError, match="cone"):
        load_robot(one_joint(moving='<cone radius="0.1" length="0.5"/>'))


def test_invalid_poses_are_refused():
    placement = pin.SE3(np.full((3, 3), np.nan), np.zeros(3))
    assert np.isnan(placement.rotation).all()  # the trap: no error
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
    walls = [Obstacle(f"wall_{i}", Box(0.1, 1, 1), pose((0.3 + 0.5 * i, 0, 0))) for i in range(6)]
    checker = CollisionChecker(slider, Scene(walls), margin=0.1)
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
