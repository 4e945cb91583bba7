"""What a certificate takes for granted is said in it."""

from __future__ import annotations

import numpy as np
import trimesh

from pinproof import Box, CollisionChecker, Mesh, Obstacle, PointCloud, Scene, certify, load_robot, pose
from pinproof.collision.certificate import CertificateStatus
from pinproof.model.robot import load_robot_from_text


def notes(path, arm, *obstacles, **settings):
    certificate = certify(path(arm, arm.home), CollisionChecker(arm, Scene(obstacles, **settings)))
    assert all(f"\nnote: {note}" in str(certificate) for note in certificate.notes)
    return certificate.notes


def test_hulled_links_are_named_and_counted(ur5, path):
    said, closer = notes(path, ur5)
    assert said.startswith("base_link, shoulder_link, ")
    assert said.endswith("(7 in all): taken as the convex hull of the mesh")
    assert "base_link and upper_arm_link" in closer
    assert "judged by several hulls, since the SRDF disables them without a reason" in closer


def test_joints_that_stand_still_are_named_with_where(panda, path):
    assert "joints outside the arm stand still: panda_finger_joint1 = 0, panda_finger_joint2 = 0" in notes(path, panda)


def test_what_is_hollow_is_named(slider, mesh_file, path):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    open_box = mesh_file(trimesh.Trimesh(box.vertices, box.faces[1:], process=False))
    sheet = Obstacle("open", Mesh(open_box, hull=False, hollow=True))
    (said,) = notes(path, slider, sheet)
    assert said == "open: not watertight, so hollow: being wholly inside is not seen"


def test_an_open_mesh_of_a_link_is_hulled_and_the_certificate_says_so(tmp_path, path):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    trimesh.Trimesh(box.vertices, box.faces[1:], process=False).export(tmp_path / "open.stl")
    arm = load_robot_from_text(
        f'<robot name="r"><link name="base"/><link name="box"><collision><geometry><mesh filename="{tmp_path}/open.stl"'
        '/></geometry></collision></link><link name="tip"/><joint name="q" type="continuous"><parent link="base"/>'
        '<child link="box"/><limit velocity="1" effort="1"/></joint><joint name="end" type="fixed">'
        '<parent link="box"/><child link="tip"/></joint></robot>'
    ).arm(tcp="tip")
    certificate = certify(path(arm, [0.0]), CollisionChecker(arm, link_meshes="mesh"))
    assert certificate.notes == ("box: open.stl is not watertight: its hull is taken",)


def test_a_cloud_says_what_it_takes_for_free(slider, path):
    (said,) = notes(path, slider, Obstacle("seen", PointCloud(np.array([[0.5, 0.5, 0.5]]), 0.01)))
    assert said == "seen: points of a sensor in cells of 0.01 m; what no point told of is free"


def test_what_was_made_of_a_scene_file_is_repeated(slider, path):
    assert notes(path, slider, notes=["a mesh of 'rack' is not watertight: its hull is taken"]) == (
        "a mesh of 'rack' is not watertight: its hull is taken",
    )


def test_links_that_are_drawn_only_are_named(path):
    link = '<link name="{}"><visual><geometry><sphere radius="0.1"/></geometry></visual>{}</link>'
    body = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    joints = (
        '<joint name="q" type="continuous"><parent link="base"/><child link="arm"/>'
        '<limit velocity="1" effort="1"/></joint>'
        '<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/></joint>'
    )
    for solid, said in (
        (body, "tip: drawn, but without collision geometry, so touching nothing"),
        ("", "the robot has no collision geometry: its links touch nothing"),
    ):
        parts = link.format("base", solid) + link.format("arm", solid) + link.format("tip", "")
        arm = load_robot_from_text(f'<robot name="r">{parts}{joints}</robot>').arm(tcp="tip")
        assert notes(path, arm) == (said,)


def test_where_nothing_is_taken_for_granted_nothing_is_said(slider, path):
    certificate = certify(
        path(slider, [0.0]), CollisionChecker(slider, Scene([Obstacle("b", Box(1, 1, 1), pose((2, 0, 0)))]))
    )
    assert certificate.notes == ()
    assert "\n" not in str(certificate)


def test_other_verdicts_tell_it_too(path):
    arm = load_robot("ur5").arm()
    certificate = certify(
        path(arm, arm.home), CollisionChecker(arm, Scene([Obstacle("b", Box(2, 2, 2), pose((0, 0, 0)))]))
    )
    assert certificate.status is CertificateStatus.COLLIDING
    assert certificate.notes
