from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pinproof.collision import Capsule, CollisionChecker, Cylinder, Mesh, Obstacle, Scene, Sphere
from pinproof.description.meshes import read_mesh
from pinproof.errors import InputError, ViewerError
from pinproof.motion import JointPath
from pinproof.spatial import matrix, pose
from pinproof.viewer.overlays import marks_of
from pinproof.viewer.page import render_page
from pinproof.viewer.picture import Picture
from pinproof.viewer.stage import FRAME_RATE, FilmPhase, checked_motion, film, set_stage
from pinproof.viewer.wire import Commands

from .conftest import UPPER, small_arm, swing

MESH = '<visual><geometry><mesh filename="{file}"/></geometry></visual>'


def extents(surfaces) -> np.ndarray:
    return np.ptp(np.concatenate([s.vertices for s in surfaces]), axis=0)


def test_every_link_of_the_ur5_with_a_visual_is_drawn(ur5) -> None:
    stage = set_stage(ur5, None)
    assert [link.name for link in stage.links] == list(dict.fromkeys(g.link for g in ur5.robot.urdf.visuals))
    assert len(stage.links) == 7
    assert stage.notes == ()


def test_a_missing_visual_mesh_is_replaced_by_the_collision_geometry_and_named(tmp_path) -> None:
    upper = MESH.format(file=tmp_path / "gone.stl") + UPPER.format(kind="collision")
    stage = set_stage(small_arm(upper=upper), None)
    assert np.allclose(extents(stage.links[1].surfaces), (0.5, 0.08, 0.08))
    assert len(stage.notes) == 1
    assert "upper is drawn with its collision geometry" in stage.notes[0]
    assert "gone.stl" in stage.notes[0]


def test_a_link_that_cannot_be_drawn_at_all_is_named_in_the_caption(tmp_path) -> None:
    page = render_page(Picture(small_arm(upper=MESH.format(file=tmp_path / "gone.stl")), None, None))
    assert "upper is not drawn: " in page.text


def test_a_robot_without_visuals_is_drawn_by_its_collision_geometry() -> None:
    stage = set_stage(small_arm(base="", upper=UPPER.format(kind="collision")), None)
    assert [link.name for link in stage.links] == ["upper"]


def test_a_robot_without_any_geometry_is_refused() -> None:
    with pytest.raises(ViewerError, match="cannot be drawn"):
        render_page(Picture(small_arm(base="", upper=""), None, None))


@pytest.mark.slow
def test_links_are_drawn_at_their_forward_kinematics_in_the_root_frame(panda) -> None:
    arm = panda.robot.arm(tcp="panda_hand_tcp", base="panda_link2")
    stage, q = set_stage(arm, None), arm.home + 0.1
    for link, root_from_link in zip(stage.links, stage.link_poses(q), strict=True):
        assert np.allclose(root_from_link, matrix(arm.root_from_base * arm.frame_placement(q, link.name)), atol=1e-14)
    assert np.allclose(stage.tcp_poses(q)[0, :3, 3], (arm.root_from_base * arm.forward_kinematics(q)).translation)


def test_obstacles_are_drawn_at_their_pose_with_the_floor_below() -> None:
    can = Obstacle("can", Capsule(radius=0.05, length=0.2), pose(xyz=(1, 2, -0.5)), (0.1, 0.2, 0.3, 1.0))
    arm = small_arm()
    stage = set_stage(arm, Scene([can]))
    surface = stage.obstacles[0].surfaces[0]
    assert np.allclose(surface.vertices.max(axis=0), (0.05, 0.05, 0.15), atol=1e-3)
    assert np.allclose(surface.vertices.min(axis=0), (-0.05, -0.05, -0.15), atol=1e-3)
    assert np.allclose(stage.obstacles[0].pose[:3, 3], (1, 2, -0.5))
    assert surface.rgba == (0.1, 0.2, 0.3, 1.0)
    assert stage.floor(stage.link_poses(arm.home)[None]) == pytest.approx(-0.65, abs=1e-3)


def test_a_mesh_obstacle_is_scaled(tmp_path) -> None:
    trimesh.creation.box(extents=(1, 1, 1)).export(tmp_path / "cube.stl")
    stage = set_stage(small_arm(), Scene([Obstacle("cube", Mesh(tmp_path / "cube.stl", scale=(0.1, 0.2, 0.3)))]))
    assert np.allclose(extents(stage.obstacles[0].surfaces), (0.1, 0.2, 0.3))


def test_a_gltf_mesh_is_drawn_as_it_collides_with_z_up(tmp_path) -> None:
    box = trimesh.creation.box(extents=(0.1, 0.2, 0.3))  # y is up in glTF
    box.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[1, 0, 0, 1])
    )
    box.export(tmp_path / "box.glb")
    stage = set_stage(small_arm(), Scene([Obstacle("box", Mesh(tmp_path / "box.glb"))]))
    assert np.allclose(extents(stage.obstacles[0].surfaces), (0.1, 0.3, 0.2))
    assert np.allclose(np.ptp(read_mesh(tmp_path / "box.glb").vertices, axis=0), (0.1, 0.3, 0.2))


def test_an_obstacle_whose_mesh_is_missing_is_named(tmp_path) -> None:
    stage = set_stage(small_arm(), Scene([Obstacle("part", Mesh(tmp_path / "gone.stl"))]))
    assert stage.obstacles == ()
    assert stage.notes[0].startswith("obstacle part is not drawn: ")


def test_a_mesh_keeps_the_colours_of_its_file(ur5) -> None:
    shoulder = next(link for link in set_stage(ur5, None).links if link.name == "shoulder_link")
    assert len(shoulder.surfaces) == 3
    assert min(max(surface.rgba[:3]) for surface in shoulder.surfaces) > 0.2  # none is black


def test_the_film_runs_from_start_to_end_in_true_time() -> None:
    arm = small_arm()
    motion, stage = swing(arm, 0.0, 1.0, duration=2.0), set_stage(arm, None)
    shown = film(stage, [FilmPhase(motion)])
    assert shown.times[0] == 0.0
    assert shown.times[-1] == 2.0
    assert np.diff(shown.times).max() <= 1 / FRAME_RATE + 1e-12
    middle = len(shown.times) // 2
    assert np.allclose(shown.poses[middle, 1], stage.link_poses(motion(shown.times[middle]))[1])
    assert np.allclose(shown.tcps[-1, 0], (0.5 * np.cos(1), 0.5 * np.sin(1), 0.1))


def test_a_motion_of_other_joints_is_refused(ur5) -> None:
    with pytest.raises(InputError, match=r"turn, roll.*shoulder_pan_joint"):
        checked_motion(ur5, swing(small_arm()))


def test_a_path_without_timing_is_refused() -> None:
    arm = small_arm()
    with pytest.raises(InputError, match="time_parametrise"):
        checked_motion(arm, JointPath([[0.0, 0.0], [1.0, 0.0]], arm.joint_names))


def test_coloured_points_are_drawn_where_they_are_with_their_legend() -> None:
    from pinproof.viewer import ColouredPoints
    from pinproof.viewer.wire import Commands

    points = ColouredPoints.of_values([[0.0, 0.0, 0.5], [0.2, 0.0, 0.5]], [0.0, 1.0], label="share")
    commands = Commands()
    points.draw(commands)
    assert commands.items[0]["object"]["object"]["type"] == "Points"
    assert points.rgb[0] == pytest.approx([0.267, 0.005, 0.329], abs=1e-3)  # viridis' ends, as matplotlib lists them
    assert points.rgb[1] == pytest.approx([0.993, 0.906, 0.144], abs=1e-3)
    assert [text for text, _ in points.legend] == ["share 0", "share 0.25", "share 0.5", "share 0.75", "share 1"]


def test_a_contact_without_a_normal_is_marked_without_an_arrow() -> None:
    arm = small_arm()
    rod = Obstacle("rod", Cylinder(radius=0.05, length=0.4), pose((0.2, 0.0, 0.0), (0.0, np.pi / 2, 0.0)))
    scene = Scene([Obstacle("bead", Sphere(radius=0.01), arm.forward_kinematics(arm.home) * rod.pose)])
    check = CollisionChecker(arm, scene, attached=[rod]).check(arm.home)
    (contact,) = check.contacts
    assert np.linalg.norm(contact.normal) == 0.0  # the centre of the bead is on the axis of the rod
    (mark,) = marks_of(check)
    assert mark.normal is None
    mark.draw(Commands(), 0, 0.01)  # warnings are errors, those of undefined numbers too
