"""The drawn bodies, their film, and the camera that frames them."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import pinproof as pp
from pinproof.collision import Box, Capsule, CollisionChecker, Cylinder, Mesh, Obstacle, Scene, Sphere
from pinproof.common import theme
from pinproof.description.meshes import read_mesh
from pinproof.errors import InputError, ViewerError
from pinproof.model import load_robot
from pinproof.motion import JointPath
from pinproof.spatial import matrix, pose
from pinproof.viewer import (
    ColouredPoints,
    Commands,
    FilmPhase,
    choose_view,
    film,
    set_stage,
    simplified,
    still,
    tool_points,
    write_html,
)
from pinproof.viewer import stage as stage_module
from pinproof.viewer.camera import LEAST_DISTANCE, fit
from pinproof.viewer.overlays import marks_of, swept
from pinproof.viewer.page import render_page
from pinproof.viewer.picture import Picture
from pinproof.viewer.stage import FRAME_RATE, MAX_BYTES, checked_motion, quaternions

from .conftest import UPPER, small_arm, swing

MESH = '<visual><geometry><mesh filename="{file}"/></geometry></visual>'


def extents(surfaces):
    return np.ptp(np.concatenate([s.vertices for s in surfaces]), axis=0)


def test_every_link_of_the_ur5_with_a_visual_is_drawn(ur5):
    stage = set_stage(ur5, None)
    assert [link.name for link in stage.links] == list(dict.fromkeys(g.link for g in ur5.robot.urdf.visuals))
    assert len(stage.links) == 7
    assert stage.notes == ()


def test_a_missing_visual_mesh_is_replaced_by_the_collision_geometry_and_named(tmp_path):
    upper = MESH.format(file=tmp_path / "gone.stl") + UPPER.format(kind="collision")
    stage = set_stage(small_arm(upper=upper), None)
    assert np.allclose(extents(stage.links[1].surfaces), (0.5, 0.08, 0.08))
    assert len(stage.notes) == 1
    assert "upper is drawn with its collision geometry" in stage.notes[0]
    assert "gone.stl" in stage.notes[0]


def test_what_cannot_be_drawn_is_named_and_a_robot_without_any_geometry_is_refused(tmp_path):
    gone = small_arm(upper=MESH.format(file=tmp_path / "gone.stl"))
    assert "upper is not drawn: " in render_page(Picture(gone, None, None)).text
    stage = set_stage(small_arm(), Scene([Obstacle("part", Mesh(tmp_path / "gone.stl"))]))
    assert stage.obstacles == ()
    assert stage.notes[0].startswith("obstacle part is not drawn: ")
    stage = set_stage(small_arm(base="", upper=UPPER.format(kind="collision")), None)
    assert [link.name for link in stage.links] == ["upper"]  # without visuals, by its collision geometry
    with pytest.raises(ViewerError, match="cannot be drawn"):
        render_page(Picture(small_arm(base="", upper=""), None, None))


@pytest.mark.slow
def test_what_has_no_area_is_named_instead_of_drawn(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", encoding="utf-8")
    flat = f'<visual><geometry><mesh filename="{tmp_path}/flat.obj"/></geometry></visual>'
    dot = Obstacle("dot", Sphere(1e-6))
    stage = set_stage(small_arm(base=flat), Scene([dot]))
    assert [link.name for link in stage.links] == ["upper"]
    assert not stage.obstacles
    assert stage.notes == (
        "base is not drawn: it has no triangle of more than 5e-15 m^2",
        "obstacle dot is not drawn: it has no triangle of more than 5e-15 m^2",
    )
    with pytest.raises(ViewerError, match="upper is not drawn: it has no triangle"):
        write_html(tmp_path / "page.html", small_arm(base=flat, upper=flat))


def test_links_are_drawn_at_their_forward_kinematics_in_the_root_frame(panda):
    arm = panda.robot.arm(tcp="panda_hand_tcp", base="panda_link2")
    stage, q = set_stage(arm, None), arm.home + 0.1
    for link, root_from_link in zip(stage.links, stage.link_poses(q), strict=True):
        assert np.allclose(root_from_link, matrix(arm.root_from_base * arm.frame_placement(q, link.name)), atol=1e-14)
    assert np.allclose(stage.tcp_poses(q)[0, :3, 3], (arm.root_from_base * arm.forward_kinematics(q)).translation)


def test_obstacles_are_drawn_at_their_pose_with_the_floor_below():
    can = Obstacle("can", Capsule(radius=0.05, length=0.2), pose(xyz=(1, 2, -0.5)), (0.1, 0.2, 0.3, 1.0))
    arm = small_arm()
    stage = set_stage(arm, Scene([can]))
    surface = stage.obstacles[0].surfaces[0]
    assert np.allclose(surface.vertices.max(axis=0), (0.05, 0.05, 0.15), atol=1e-3)
    assert np.allclose(surface.vertices.min(axis=0), (-0.05, -0.05, -0.15), atol=1e-3)
    assert np.allclose(stage.obstacles[0].pose[:3, 3], (1, 2, -0.5))
    assert surface.rgba == (0.1, 0.2, 0.3, 1.0)
    assert stage.floor(stage.link_poses(arm.home)[None]) == pytest.approx(-0.65, abs=1e-3)


def test_a_mesh_obstacle_is_scaled(tmp_path):
    trimesh.creation.box(extents=(1, 1, 1)).export(tmp_path / "cube.stl")
    stage = set_stage(small_arm(), Scene([Obstacle("cube", Mesh(tmp_path / "cube.stl", scale=(0.1, 0.2, 0.3)))]))
    assert np.allclose(extents(stage.obstacles[0].surfaces), (0.1, 0.2, 0.3))


def test_a_gltf_mesh_is_drawn_as_it_collides_with_z_up(tmp_path):
    box = trimesh.creation.box(extents=(0.1, 0.2, 0.3))  # y is up in glTF
    box.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[1, 0, 0, 1])
    )
    box.export(tmp_path / "box.glb")
    stage = set_stage(small_arm(), Scene([Obstacle("box", Mesh(tmp_path / "box.glb"))]))
    assert np.allclose(extents(stage.obstacles[0].surfaces), (0.1, 0.3, 0.2))
    assert np.allclose(np.ptp(read_mesh(tmp_path / "box.glb").vertices, axis=0), (0.1, 0.3, 0.2))


def test_a_mesh_keeps_the_colours_of_its_file(ur5):
    shoulder = next(link for link in set_stage(ur5, None).links if link.name == "shoulder_link")
    assert len(shoulder.surfaces) == 3
    assert min(max(surface.rgba[:3]) for surface in shoulder.surfaces) > 0.2  # none is black


def test_the_film_runs_from_start_to_end_in_true_time():
    arm = small_arm()
    motion, stage = swing(arm, 0.0, 1.0, duration=2.0), set_stage(arm, None)
    shown = film(stage, [FilmPhase(motion)])
    assert shown.times[0] == 0.0
    assert shown.times[-1] == 2.0
    assert np.diff(shown.times).max() <= 1 / FRAME_RATE + 1e-12
    middle = len(shown.times) // 2
    assert np.allclose(shown.poses[middle, 1], stage.link_poses(motion(shown.times[middle]))[1])
    assert np.allclose(shown.tcps[-1, 0], (0.5 * np.cos(1), 0.5 * np.sin(1), 0.1))


@pytest.mark.slow
def test_the_swept_volume_contains_bodies_attached_to_the_tcp(ur5):
    stage, q = set_stage(ur5, None), ur5.home + np.outer([0, 1], [1.0, 0, 0, 1.0, 0, 0])
    shown = film(stage, [FilmPhase(pp.Trajectory([0.0, 1.0], q, np.zeros((2, 6)), ur5.joint_names))])
    steps, names = swept(stage, shown, 0.6), [link.name for link in stage.links]
    assert [name for k, name in enumerate(names) if not np.isnan(steps[:, k]).any()] == ["wrist_3_link"]
    last = names.index("wrist_3_link")
    assert np.array_equal(steps[[0, -1], last], shown.poses[[0, -1], last])
    assert np.linalg.norm(np.diff(steps[:, last, :3, 3], axis=0), axis=1).max() < 0.1


def test_a_motion_of_other_joints_or_without_timing_is_refused(ur5):
    arm = small_arm()
    path = JointPath([[0.0, 0.0], [1.0, 0.0]], arm.joint_names)
    for who, curve, message in ((ur5, swing(arm), r"turn, roll.*shoulder_pan_joint"), (arm, path, "time_parametrise")):
        with pytest.raises(InputError, match=message):
            checked_motion(who, curve)


def test_coloured_points_are_drawn_where_they_are_with_their_legend():
    points = ColouredPoints.of_values([[0.0, 0.0, 0.5], [0.2, 0.0, 0.5]], [0.0, 1.0], label="share")
    commands = Commands()
    points.draw(commands)
    assert commands.items[0]["object"]["object"]["type"] == "Points"
    assert points.rgb[0] == pytest.approx(theme.rgb("#440154"), abs=1e-12)  # viridis' ends, in matplotlib's 8 bits
    assert points.rgb[1] == pytest.approx(theme.rgb("#fde725"), abs=1e-12)
    assert [text for text, _ in points.legend] == ["share 0", "share 0.25", "share 0.5", "share 0.75", "share 1"]


@pytest.mark.parametrize("name", sorted(theme.COLOUR_MAPS))
def test_colour_maps_are_those_of_matplotlib(name):
    from matplotlib import colormaps

    values = np.linspace(0.0, 1.0, 301)
    points = ColouredPoints.of_values(np.zeros((301, 3)), values, label="share", colours=name)
    assert points.rgb == pytest.approx(colormaps[name](values)[:, :3], abs=0.025)


def test_a_contact_without_a_normal_is_marked_without_an_arrow():
    arm = small_arm()
    rod = Obstacle("rod", Cylinder(radius=0.05, length=0.4), pose((0.2, 0.0, 0.0), (0.0, np.pi / 2, 0.0)))
    scene = Scene([Obstacle("bead", Sphere(radius=0.01), arm.forward_kinematics(arm.home) * rod.pose)])
    check = CollisionChecker(arm, scene, attached=[rod]).check(arm.home)
    (contact,) = check.contacts
    assert np.linalg.norm(contact.normal) == 0.0  # the centre of the bead is on the axis of the rod
    (mark,) = marks_of(check)
    assert mark.normal is None
    mark.draw(Commands(), 0, 0.01)  # warnings are errors, those of undefined numbers too


def test_quaternions_equal_those_of_scipy_up_to_the_sign():
    rotations = [np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])]
    matrices = np.concatenate([rotations, Rotation.random(2000, random_state=0).as_matrix()])
    found, expected = quaternions(matrices), Rotation.from_matrix(matrices).as_quat()
    same = np.sign(np.einsum("ij,ij->i", found, expected))[:, None]
    np.testing.assert_allclose(found * same, expected, atol=1e-12)


def test_neighbouring_quaternions_have_the_same_sign():
    angles = np.linspace(0, 6 * np.pi, 500)
    matrices = Rotation.from_rotvec(angles[:, None] * np.array([0.6, 0.0, 0.8])).as_matrix()
    found = quaternions(matrices)
    assert np.abs(np.diff(found, axis=0)).max() < 0.05


# -- simplification of meshes ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def globe():
    made = trimesh.creation.icosphere(subdivisions=5, radius=0.2)  # 20,480 triangles
    mesh = Mesh.from_arrays(np.array(made.vertices), np.array(made.faces))
    return Scene([Obstacle("globe", mesh, pose(xyz=(0.8, 0, 0.2)))])


def drawn(scene, max_bytes):
    stage = simplified(set_stage(small_arm(), scene), max_bytes)
    return stage, stage.obstacles[0].surfaces[0]


def test_a_mesh_that_fits_is_not_simplified(globe):
    stage, surface = drawn(globe, MAX_BYTES)
    assert stage.notes == ()
    assert len(surface.triangles) == 20480


@pytest.mark.parametrize("max_bytes", [300e3, 60e3])
def test_a_mesh_that_is_too_large_is_simplified_until_it_fits_and_keeps_its_shape(globe, max_bytes):
    stage, surface = drawn(globe, max_bytes)
    assert stage_module.size_in_bytes(stage) <= max_bytes
    cell = float(stage.notes[0].split("details of ")[1].split()[0]) * 1e-3
    assert np.abs(np.linalg.norm(surface.vertices, axis=1) - 0.2).max() < cell
    assert np.linalg.norm(surface.vertices.max(axis=0) - surface.vertices.min(axis=0)) == pytest.approx(
        0.4 * 3**0.5, abs=2 * cell
    )
    solid = trimesh.Trimesh(surface.vertices, surface.triangles, process=True)
    assert solid.volume == pytest.approx(4 / 3 * np.pi * 0.2**3, rel=0.1)  # closed, and turned outwards as before
    along = np.einsum("ij,ij->i", surface.normals, surface.vertices / 0.2)
    assert np.median(along) > 0.9


def test_the_page_of_a_large_mesh_is_small_and_notes_the_simplification(globe, monkeypatch):
    monkeypatch.setattr(stage_module.simplified, "__defaults__", (100e3,))
    page = render_page(Picture(small_arm(), globe))
    assert "Meshes are simplified" in page.text


# -- the camera --------------------------------------------------------------------------------------------------------

numbers = st.floats(-2, 2)


@given(
    points=st.lists(st.tuples(numbers, numbers, numbers), min_size=2, max_size=20, unique=True),
    azimuth=st.floats(-np.pi, np.pi),
    elevation=st.floats(-1.2, 1.2),
    aspect=st.floats(0.4, 3),
)
def test_the_picture_shows_every_point_from_the_smallest_distance(points, azimuth, elevation, aspect):
    cloud = np.array(points)
    level = np.cos(elevation)
    direction = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    axes, tangent, camera = fit(cloud, direction, aspect, margin=0.0)
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert axes[0, 2] == pytest.approx(0)  # the horizon is level
    seen = cloud @ axes.T - camera
    # in units of the half picture; a point may lie in the camera itself, so nothing is divided
    sides = np.concatenate([(tangent * -seen[:, 2:] - seen[:, :2]), (tangent * -seen[:, 2:] + seen[:, :2])], axis=1)
    assert sides.min() > -1e-9
    tight = sides.min(axis=0).reshape(2, 2).max(axis=0)
    nearest, farthest = seen[:, 2].max(), seen[:, 2].min()
    assert -nearest >= LEAST_DISTANCE * (nearest - farthest) - 1e-9
    at_least = -nearest <= LEAST_DISTANCE * (nearest - farthest) + 1e-9
    assert at_least or tight.min() < 1e-9  # opposite sides both touch, in width or in height


def test_a_planar_arm_is_not_hidden_behind_its_own_tip():
    rows = [pp.DhRow(f"j{k}", 0, 0, a, 0) for k, a in enumerate((1.0, 0.8, 0.3))]
    arm = pp.load_robot(pp.DhTable(rows, convention="standard", name="planar")).arm()
    stage = set_stage(arm, Scene())
    shown = still(stage, np.array([np.pi / 6, np.pi / 4, 0.3]))
    view = choose_view(stage, shown.poses, shown.tcps[:, 0], tool=tool_points(stage, shown.poses))
    axes, tangent, camera = fit(view.points, view.direction, 1.6)
    seen = np.array([[0, 0, 0], [0.866, 0.5, 0], [1.073, 1.273, 0], [1.049, 1.572, 0]]) @ axes.T - camera
    across = seen[:, :2] / (-seen[:, 2:] * tangent)
    steps = np.linalg.norm(np.diff(across, axis=0), axis=1)  # halves of the picture
    assert (steps > 0.2).all()


def test_a_wall_does_not_hide_a_later_contact():
    arm = small_arm()
    free = _direction(arm, Scene())
    wall = Obstacle("wall", Box(0.02, 3, 3), pose(xyz=0.4 * free, rpy=(0, 0, np.arctan2(free[1], free[0]))))
    past = _direction(arm, Scene([wall]))
    assert past @ free < 0.9


def test_the_view_is_the_same_each_time():
    arm = small_arm()
    assert np.array_equal(_direction(arm, Scene()), _direction(arm, Scene()))


def _direction(arm, scene):
    stage = set_stage(arm, scene)
    shown = still(stage, arm.home)
    return choose_view(stage, shown.poses, shown.tcps[:, 0]).direction


# -- the tool, the carried part and the obstacles near them are in the picture at every key frame of a motion ----------

ASPECTS = (0.6, 4 / 3, 980 / 750, 2.2)
"""Width by height of the canvas: a telephone, the default, the page in a window of 1280 x 800, a wide window."""

REACH = 0.05
"""Metres: obstacles this close to the tool must be visible in all tests, whatever the size of the arm."""

GRIPPER = [
    pp.Obstacle("palm", pp.Box(0.1, 0.06, 0.08), pp.pose(xyz=(0, 0, 0.04))),
    pp.Obstacle("finger", pp.Box(0.015, 0.03, 0.08), pp.pose(xyz=(0.035, 0, 0.12))),
]


def outside(view, points, aspect):
    """By how much of half the picture the farthest point is outside; negative if all are inside."""
    axes, tangent, camera = fit(view.points, view.direction, aspect, view.margin)
    x = points @ axes.T - camera
    if (x[:, 2] >= 0).any():  # behind the camera
        return np.inf
    return float((np.abs(x[:, :2]) / (-x[:, 2:] * tangent)).max() - 1)


def motion(arm, *points):
    return pp.time_parametrise(pp.JointPath([np.asarray(q, float) for q in points], arm.joint_names), arm.limits)


def planar():
    """A planar arm with two links of a DH table, whose joint housings reach below its base frame."""
    rows = [pp.DhRow("one", 0, 0, 0.5, 0), pp.DhRow("two", 0, 0, 0.4, 0)]
    return load_robot(pp.dh_to_urdf(pp.DhTable(rows, convention="standard"))).arm("tool0")


def above_and_down(arm, at):
    """From home over a point 0.2 m above a tcp position to the position itself, with the tool down."""
    solver = pp.AnalyticIk()
    down = pp.pose(xyz=at, rpy=(np.pi, 0, 0))
    over = pp.pose(xyz=(*at[:2], at[2] + 0.2), rpy=(np.pi, 0, 0))
    q = solver.solve_all(arm, down).nearest(arm.home)
    return motion(arm, arm.home, solver.solve_all(arm, over).nearest(q), q)


CASES = {
    "planar": (planar, (), (), [[0.2, 0.6], [1.5, -1.0]]),
    "scara": (lambda: pp.load_robot("scara").arm(), (), (), [[-1.0, 1.5, 0.0, 0.0], [1.0, -1.0, 0.2, 1.0]]),
    "ur10 with gripper": (
        lambda: pp.load_robot("ur10").arm(),
        GRIPPER,
        [
            pp.Obstacle("table", pp.Box(1.6, 1.6, 0.05), pp.pose(xyz=(0.6, 0, -0.03))),
            pp.Obstacle("part", pp.Cylinder(radius=0.02, length=0.08), pp.pose(xyz=(0.7, 0.3, 0.04))),
        ],
        (0.7, 0.3, 0.2),
    ),
    "ur5 at a bin": (
        lambda: pp.load_robot("ur5").arm(),
        [pp.Obstacle("rod", pp.Cylinder(radius=0.02, length=0.16), pp.pose(xyz=(0, 0, 0.08)))],
        [
            pp.Obstacle("table", pp.Box(1.6, 1.2, 0.04), pp.pose(xyz=(0.4, 0, -0.02))),
            pp.Obstacle("near wall", pp.Box(0.4, 0.01, 0.1), pp.pose(xyz=(0.5, -0.18, 0.05))),
            pp.Obstacle("bolt", pp.Cylinder(radius=0.01, length=0.05), pp.pose(xyz=(0.5, -0.1, 0.025))),
        ],
        (0.5, -0.1, 0.22),
    ),
    "panda": (
        lambda: pp.load_robot("panda").arm(),
        (),
        (),
        [[0, -0.5, 0, -2.2, 0, 1.8, 0.8], [1.2, 0.6, 0.3, -1.4, 0, 2.2, 0]],
    ),
}


@pytest.fixture(scope="module", params=list(CASES))
def case(request):
    make, attached, obstacles, move = CASES[request.param]
    arm = make()
    trajectory = above_and_down(arm, move) if isinstance(move, tuple) else motion(arm, *move)
    stage = set_stage(arm, pp.Scene(obstacles), attached)
    shown = film(stage, [FilmPhase(trajectory)])
    view = choose_view(stage, shown.poses, shown.tcps[:, 0], tool=tool_points(stage, shown.poses))
    return stage, shown, view


def placed(surfaces, at):
    return np.concatenate([surface.vertices for surface in surfaces]) @ at[:3, :3].T + at[:3, 3]


def test_the_tool_is_in_the_picture_at_every_key_frame(case):
    stage, shown, view = case
    tool = np.flatnonzero(stage.tool)
    assert len(tool)
    for k in tool:
        points = np.concatenate([surface.vertices for surface in stage.links[k].surfaces])
        corners = points[ConvexHull(points).vertices]  # the others are between them
        swept = (corners @ np.swapaxes(shown.poses[:, k, :3, :3], 1, 2) + shown.poses[:, k, None, :3, 3]).reshape(-1, 3)
        assert max(outside(view, swept, aspect) for aspect in ASPECTS) < 0
    assert all(outside(view, shown.tcps[:, 0], aspect) < 0 for aspect in ASPECTS)


def test_all_links_are_in_the_picture_at_every_key_frame(case):
    stage, shown, view = case
    for poses in shown.poses[::3]:
        for link, at in zip(stage.links, poses, strict=True):
            assert not link.surfaces or outside(view, placed(link.surfaces, at), 4 / 3) < 0.01, link.name


def test_obstacles_near_the_tool_are_in_the_picture(case):
    stage, shown, view = case
    tool = tool_points(stage, shown.poses)
    for obstacle in stage.obstacles:
        points = placed(obstacle.surfaces, obstacle.pose)
        near = np.array([np.linalg.norm(tool - point, axis=1).min() <= REACH for point in points])
        if near.any():
            assert all(outside(view, points[near], aspect) < 0 for aspect in ASPECTS), obstacle.name
    if "bolt" in {obstacle.name for obstacle in stage.obstacles}:
        bolt = next(each for each in stage.obstacles if each.name == "bolt")
        assert outside(view, placed(bolt.surfaces, bolt.pose), 4 / 3) < 0


def test_a_view_that_ignores_the_tool_fails_the_same_check(case):
    stage, shown, view = case
    blind = replace(view, points=placed(stage.links[0].surfaces, shown.poses[0, 0]))
    assert max(outside(blind, shown.tcps[:, 0], aspect) for aspect in ASPECTS) > 0


def test_the_robot_is_not_sunk_in_the_floor(case):
    stage, shown, _ = case
    floor = stage.floor(shown.poses)
    lowest = min(
        placed(link.surfaces, at)[:, 2].min()
        for poses in shown.poses[:: max(1, len(shown.poses) // 20)]
        for link, at in zip(stage.links, poses, strict=True)
        if link.surfaces
    )
    assert floor <= lowest + 1e-9
    assert floor <= 0


def test_tcp_path_of_a_small_arm_is_thin():
    rows = [pp.DhRow("one", 0, 0, 0.05, 0), pp.DhRow("two", 0, 0, 0.04, 0)]
    arm = load_robot(pp.dh_to_urdf(pp.DhTable(rows, convention="standard"))).arm("tool0")
    picture = Picture(arm, None, motion(arm, [0, 0.5], [1, -0.5])).render()
    balls = [each for each in picture.commands.items if each.get("path") == "/tcp path/0/start"]
    assert balls
    blob, reference = picture.commands._blob, balls[0]["object"]["geometries"][0]["data"]["attributes"]["position"]
    _, offset, count = reference["array"]["$buffer"]
    points = np.frombuffer(bytes(blob[offset : offset + 4 * count]), dtype=np.float32).reshape(-1, 3)
    assert np.ptp(points, axis=0).max() < 0.005
