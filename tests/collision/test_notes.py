"""The assumptions of a certificate are its notes."""

from __future__ import annotations

import numpy as np
import trimesh

from pinproof import Box, CollisionChecker, Mesh, Obstacle, PointCloud, Scene, certify, load_robot, pose
from pinproof.collision.certificates.certificate import CertificateStatus


def notes(path, arm, *obstacles, **settings):
    certificate = certify(path(arm, arm.home), CollisionChecker(arm, Scene(obstacles, **settings)))
    assert all(f"\nnote: {note}" in str(certificate) for note in certificate.notes)
    return certificate.notes


def test_hulled_links_are_named_and_counted(ur5, path):
    expected, closer = notes(path, ur5)
    assert expected.startswith("base_link, shoulder_link, ")
    assert "(7 in all)" in expected
    assert "convex hull" in expected
    assert "base_link and upper_arm_link" in closer
    assert "several hulls" in closer
    assert "SRDF" in closer


def test_held_joints_are_named_with_their_values(panda, path):
    assert any("panda_finger_joint1 = 0, panda_finger_joint2 = 0" in note for note in notes(path, panda))


def test_a_mesh_that_is_not_watertight_is_named(slider, mesh_file, path):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    open_box = mesh_file(trimesh.Trimesh(box.vertices, box.faces[1:], process=False))
    sheet = Obstacle("open", Mesh(open_box, hull=False, hollow=True))
    (text,) = notes(path, slider, sheet)
    assert text.startswith("open: not watertight")


def test_certificate_names_a_link_whose_open_mesh_is_replaced_by_its_hull(tmp_path, path):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    trimesh.Trimesh(box.vertices, box.faces[1:], process=False).export(tmp_path / "open.stl")
    arm = load_robot(
        f'<robot name="r"><link name="base"/><link name="box"><collision><geometry><mesh filename="{tmp_path}/open.stl"'
        '/></geometry></collision></link><link name="tip"/><joint name="q" type="continuous"><parent link="base"/>'
        '<child link="box"/><limit velocity="1" effort="1"/></joint><joint name="end" type="fixed">'
        '<parent link="box"/><child link="tip"/></joint></robot>'
    ).arm(tcp="tip")
    certificate = certify(path(arm, [0.0]), CollisionChecker(arm, link_meshes="mesh"))
    (note,) = certificate.notes
    assert "box: open.stl is not watertight" in note
    assert "convex hull" in note


def test_note_on_a_point_cloud_names_resolution_and_unobserved_space(slider, path):
    (expected,) = notes(path, slider, Obstacle("seen", PointCloud(np.array([[0.5, 0.5, 0.5]]), 0.01)))
    assert "seen: point cloud in cells of 0.01 m" in expected
    assert "unobserved" in expected


def test_notes_of_a_scene_file_are_repeated(slider, path):
    assert notes(path, slider, notes=["a mesh of 'rack' is not watertight, so its convex hull is used"]) == (
        "a mesh of 'rack' is not watertight, so its convex hull is used",
    )


def test_links_with_visual_geometry_only_are_named(path):
    link = '<link name="{}"><visual><geometry><sphere radius="0.1"/></geometry></visual>{}</link>'
    body = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    joints = (
        '<joint name="q" type="continuous"><parent link="base"/><child link="arm"/>'
        '<limit velocity="1" effort="1"/></joint>'
        '<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/></joint>'
    )
    for solid, expected in (
        (body, "tip: visible, but without collision geometry"),
        ("", "the robot has no collision geometry"),
    ):
        parts = link.format("base", solid) + link.format("arm", solid) + link.format("tip", "")
        arm = load_robot(f'<robot name="r">{parts}{joints}</robot>').arm(tcp="tip")
        (note,) = notes(path, arm)
        assert expected in note


def test_there_are_no_notes_without_assumptions(slider, path):
    certificate = certify(
        path(slider, [0.0]), CollisionChecker(slider, Scene([Obstacle("b", Box(1, 1, 1), pose((2, 0, 0)))]))
    )
    assert certificate.notes == ()
    assert "\n" not in str(certificate)


def test_colliding_certificates_have_notes_too(path):
    arm = load_robot("ur5").arm()
    certificate = certify(
        path(arm, arm.home), CollisionChecker(arm, Scene([Obstacle("b", Box(2, 2, 2), pose((0, 0, 0)))]))
    )
    assert certificate.status is CertificateStatus.COLLIDING
    assert certificate.notes
