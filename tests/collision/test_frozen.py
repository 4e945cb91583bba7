"""What a verdict depends on cannot be changed after the checker was made."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision import files_examined_once


def test_the_inputs_of_a_checker_cannot_be_changed_afterwards(panda):
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 0.1), pp.pose((1.0, 0.0, 1.5)))
    tool, scene = pp.Obstacle("tool", pp.Sphere(0.01), pp.pose((0.0, 0.0, 0.12))), pp.Scene([post])
    checker = pp.CollisionChecker(panda, scene, attached=[tool])
    for what in (scene["post"].pose, checker.attached[0].pose, checker.bodies[0].link_from_body, panda.root_from_base):
        for array, index in ((what.translation, 2), (what.rotation, (0, 0))):
            with pytest.raises(ValueError, match="read-only"):
                array[index] -= 1.0
        for change in (
            lambda what=what: setattr(what, "translation", np.zeros(3)),
            lambda what=what: setattr(what, "rotation", np.eye(3)),
            what.setIdentity,
            what.setRandom,
        ):
            with pytest.raises(AttributeError, match="read-only"):
                change()
    body = checker.bodies[0]
    arrays = (checker.margins, body.box, body.support.points, panda.scale, panda.offset, checker.convex)
    for array in (*arrays, checker.still_pairs):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    for name in ("arm", "scene", "attached", "margin", "bodies", "pairs", "margins", "world", "rounding", "excluded"):
        with pytest.raises(AttributeError):
            setattr(checker, name, None)
    for listed in (checker.pairs, checker.excluded, checker.finer, checker.bodies):
        assert isinstance(listed, tuple)


def test_the_held_joints_of_an_arm_cannot_be_changed_in_place(panda):
    before = dict(panda.held)
    for change in (
        lambda held: held.__setitem__("panda_finger_joint1", 0.04),
        lambda held: held.update(panda_finger_joint1=0.04),
        lambda held: held.pop("panda_finger_joint1"),
        lambda held: held.clear(),
    ):
        with pytest.raises(TypeError, match="with_held"):
            change(panda.held)
    assert panda.held == before
    again = pickle.loads(pickle.dumps(panda))
    assert again.held == before
    with pytest.raises(TypeError, match="with_held"):
        again.held["panda_finger_joint1"] = 0.04


@pytest.mark.parametrize("robot_name", ["panda", "ur5"])
@pytest.mark.slow
def test_the_pinocchio_models_of_an_arm_and_its_robot_are_copies(robot_name):
    arm = pp.load_robot(robot_name).arm()
    scene = pp.Scene([pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose((0.0, 0.0, 4.0)))])
    checker = pp.CollisionChecker(arm, scene, link_meshes="mesh")
    move = pp.JointPath(np.array([arm.home, arm.home + 0.01]), arm.joint_names)
    before, at_home = pp.certify(move, checker), arm.forward_kinematics(arm.home)
    for model in (arm.model, arm.robot.model):
        for joint in range(1, model.njoints):
            model.jointPlacements[joint].translation += 0.3
        model.frames[model.nframes - 1].placement = pp.pose((0.0, 0.0, 9.0))
    geometry = checker.geometry_model
    for body in geometry.geometryObjects:
        body.placement = pp.pose((0.0, 0.0, 9.0))
    geometry.removeAllCollisionPairs()
    assert arm.forward_kinematics(arm.home) == at_home
    assert arm.robot.arm(arm.tcp, base=arm.base).forward_kinematics(arm.home) == at_home
    for again in (checker, pp.CollisionChecker(arm, scene, link_meshes="mesh")):
        after = pp.certify(move, again)
        assert (after.status, after.clearance, after.pairs) == (before.status, before.clearance, before.pairs)
        assert again.clearance(arm.home) == checker.clearance(arm.home)
        assert after.matches(move, arm, scene)


def test_an_arm_and_its_robot_are_read_only(panda):
    for name in ("robot", "base", "tcp", "joint_names", "limits", "held", "scale", "offset", "root_from_base", "model"):
        with pytest.raises(AttributeError):
            setattr(panda, name, None)
    for mapping in (panda.robot.home, panda.robot.urdf.joints, panda.robot.srdf.groups):
        with pytest.raises(TypeError, match="read-only"):
            mapping.clear()
    again = pickle.loads(pickle.dumps(panda))
    assert again.robot.home == panda.robot.home
    assert again.forward_kinematics(panda.home) == panda.forward_kinematics(panda.home)
    narrow = panda.with_limits(panda.limits)
    with pytest.raises(AttributeError, match="with_limits"):
        narrow.limits = panda.limits


def test_a_mesh_that_was_modified_in_place_is_refused_and_read_again_by_a_new_checker(panda, tmp_path):
    torus = trimesh.creation.torus(0.1, 0.03, 12, 8)
    torus.export(tmp_path / "torus.stl")
    arrays = torus.vertices, torus.faces
    file = pp.Mesh(tmp_path / "torus.stl", hull=False)
    shapes = [pp.Mesh.from_arrays(*arrays, hull=False), pp.Mesh.from_arrays(*arrays), file]
    scene = pp.Scene([pp.Obstacle(f"ring{k}", shape, pp.pose((0.1 * k, 0.0, 3.0))) for k, shape in enumerate(shapes)])
    move = pp.JointPath(np.array([panda.home, panda.home + 0.05]), panda.joint_names)
    link = panda.robot.urdf.collisions[0].link
    for name in ("ring0", "ring1", "ring2", link):
        checker = pp.CollisionChecker(panda, scene, link_meshes={link: "mesh"})
        index = next(i for i, body in enumerate(checker.bodies) if body.owner == name)
        vertices = checker.bodies[index].geometry.vertices()
        before = vertices.copy()
        vertices += 1.0
        with pytest.raises(pp.InputError, match=checker.bodies[index].name):
            pp.certify(move, checker)
        again = pp.CollisionChecker(panda, scene, link_meshes={link: "mesh"})
        assert pp.certify(move, again).free
        np.testing.assert_array_equal(again.bodies[index].geometry.vertices(), before)


def test_a_pose_given_to_an_obstacle_is_copied():
    given = pp.pose((1.0, 0.0, 0.5))
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 0.1), given)
    given.translation[2] = 9.0
    assert post.pose.translation[2] == 0.5
    copied = post.pose.copy()
    copied.translation[2] = 9.0
    assert post.pose.translation[2] == 0.5
    assert (post.pose * pp.pose((0.0, 0.0, 1.0))).translation[2] == 1.5
    again = pickle.loads(pickle.dumps(post))
    assert again.pose == post.pose
    with pytest.raises(ValueError, match="read-only"):
        again.pose.translation[2] = 9.0


def test_an_obstacle_changed_in_place_never_leaves_a_certificate_that_matches(panda):
    scene = pp.Scene([pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose((0.3, 0.0, 2.5)))])
    checker = pp.CollisionChecker(panda, scene)
    move = pp.JointPath(np.array([panda.home, panda.home + 0.05]), panda.joint_names)
    with pytest.raises(ValueError, match="read-only"):
        scene["post"].pose.translation[2] -= 2.0
    assert pp.certify(move, checker).matches(move, panda, scene)
    lowered = scene.move("post", pp.pose((0.3, 0.0, 0.5)))
    assert not pp.certify(move, checker).matches(move, panda, lowered)
    assert pp.certify(move, checker.with_scene(lowered)).status.name == "COLLIDING"


def test_a_mesh_file_changed_later_matches_no_certificate(panda, tmp_path):
    file = tmp_path / "post.stl"
    trimesh.creation.box((0.1, 0.1, 0.1)).export(file)
    scene = pp.Scene([pp.Obstacle("post", pp.Mesh(file), pp.pose((0.3, 0.0, 2.5)))])
    checker = pp.CollisionChecker(panda, scene)
    move = pp.JointPath(np.array([panda.home, panda.home + 0.05]), panda.joint_names)
    before = pp.certify(move, checker)
    assert before.matches(move, panda, scene)
    trimesh.creation.box((0.1, 0.1, 4.5)).export(file)
    assert not before.matches(move, panda, scene)
    stale = pp.certify(move, checker)  # of the box that was read
    assert not stale.matches(move, panda, scene)
    assert any("post.stl" in note for note in stale.notes)
    again = pp.certify(move, pp.CollisionChecker(panda, scene))
    assert again.status.name == "COLLIDING"
    assert again.matches(move, panda, scene)


def test_a_search_states_the_mesh_files_at_its_start_and_the_next_one_examines_them_again(panda, tmp_path):
    file = tmp_path / "post.stl"
    trimesh.creation.box((0.1, 0.1, 0.1)).export(file)
    scene = pp.Scene([pp.Obstacle("post", pp.Mesh(file), pp.pose((0.3, 0.0, 2.5)))])
    checker = pp.CollisionChecker(panda, scene)
    move = pp.JointPath(np.array([panda.home, panda.home + 0.05]), panda.joint_names)
    with files_examined_once():
        before = pp.certify(move, checker)
        trimesh.creation.box((0.1, 0.1, 4.5)).export(file)
        with files_examined_once():
            during = pp.certify(move, checker)
    with files_examined_once():
        after = pp.certify(move, checker)
    assert (during.setup, during.notes) == (before.setup, before.notes)
    assert after.setup != before.setup
    assert any("post.stl" in note for note in after.notes)


def test_a_certificate_does_not_match_a_scene_that_disables_other_pairs(panda):
    move = pp.JointPath(np.array([panda.home, panda.home + 0.05]), panda.joint_names)
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose((0.3, 0.0, 2.5)))
    scene = pp.Scene([post], disabled=[("panda_link0", "panda_link5")])
    certificate = pp.certify(move, pp.CollisionChecker(panda, scene, trust_disabled=True))
    assert certificate.matches(move, panda, scene)
    assert not certificate.matches(move, panda, pp.Scene([post]))
