"""MoveIt planning scenes: what each part of the message means here, and what is refused."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import trimesh
import yaml

from pinproof import Box, CollisionChecker, Cylinder, HalfSpace, InputError, Scene, Sphere, pose
from pinproof.collision import Cone
from pinproof.errors import SceneError
from pinproof.spatial import matrix

QUARTER = [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]
"""A quarter turn about z, x y z w."""


@pytest.fixture
def read(tmp_path):
    """Reads a planning scene from Python's own lists and mappings, as a YAML file."""

    def reader(objects, **more) -> Scene:
        path = tmp_path / "cell.yaml"
        # JSON is YAML, and unlike safe_dump it writes no anchors
        path.write_text(json.dumps({"name": "", "world": {"collision_objects": objects}, **more}))
        return Scene.load(path)

    return reader


def box(name="box", **more):
    return {"id": name, "primitives": [{"type": "box", "dimensions": [1, 2, 3]}], "primitive_poses": [{}], **more}


def test_primitives_by_name_and_by_number_with_the_height_before_the_radius(read):
    wanted = {
        ("box", 1): ([0.1, 0.2, 0.3], Box(0.1, 0.2, 0.3)),
        ("sphere", 2): ([0.1], Sphere(0.1)),
        ("cylinder", 3): ([0.4, 0.1], Cylinder(radius=0.1, length=0.4)),
        ("CONE", 4): ([0.4, 0.1], Cone(radius=0.1, length=0.4)),
    }
    for kinds, (dimensions, shape) in wanted.items():
        for kind in kinds:
            scene = read([{"id": "thing", "primitives": [{"type": kind, "dimensions": dimensions}]}])
            assert scene["thing"].shape == shape


def test_poses_as_lists_and_as_mappings_and_composed(read):
    """root_from_shape = root_from_object object_from_shape."""
    lists = box(
        pose={"position": [1, 0, 0], "orientation": QUARTER},
        primitive_poses=[{"position": [0, 2, 0], "orientation": QUARTER}],
    )
    words = json.loads(json.dumps(lists))
    for part in (words["pose"], words["primitive_poses"][0]):
        part["position"] = dict(zip("xyz", part["position"], strict=True))
        part["orientation"] = dict(zip("xyzw", part["orientation"], strict=True))
    for stated in (lists, words):
        np.testing.assert_allclose(
            matrix(read([stated])["box"].pose), matrix(pose((-1, 0, 0), (0, 0, math.pi))), atol=1e-15
        )
    unturned = box(pose={"position": {"z": 1}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 0}})
    np.testing.assert_array_equal(matrix(read([unturned])["box"].pose), matrix(pose((0, 0, 1))))


def test_an_object_of_several_shapes_becomes_several_obstacles_with_its_name(read):
    thing = {
        "id": "rack",
        "primitives": [{"type": "box", "dimensions": [1, 1, 1]}, {"type": "sphere", "dimensions": [0.1]}],
        "primitive_poses": [{"position": [1, 0, 0]}, {"position": [2, 0, 0]}],
        "planes": [{"coef": [0, 0, 2, 1]}],
    }
    scene = read([thing], allowed_collision_matrix=entries(["rack", "base"], [("rack", "base")]))
    assert scene.names == ("rack/1", "rack/2", "rack/3")
    assert [o.pose.translation[0] for o in scene.obstacles] == [1, 2, 0]
    assert scene.allowed == (("base", "rack/1"), ("base", "rack/2"), ("base", "rack/3"))


@pytest.mark.parametrize("coef", [(0, 0, 1, 0.5), (0, 0, -1, 0.5), (1, 2, -3, 4), (-2, 0, 0, 0)])
def test_a_plane_becomes_the_half_space_behind_it(read, coef):
    scene = read([{"id": "plane", "planes": [{"coef": list(coef)}]}])
    assert scene["plane"].shape == HalfSpace()
    assert "plane" in scene.notes[0]
    for point in np.random.default_rng(0).uniform(-3, 3, (20, 3)):
        behind = np.dot(coef[:3], point) + coef[3] <= 0
        assert (scene["plane"].pose.actInv(point)[2] <= 0) == behind


def test_watertight_meshes_are_solid_and_others_hulls_with_a_note(read, tmp_path):
    cube = trimesh.creation.box((0.2, 0.2, 0.2))
    inline = {
        "vertices": [dict(zip("xyz", v, strict=True)) for v in cube.vertices.tolist()],
        "triangles": [{"vertex_indices": t} for t in cube.faces.tolist()],
    }
    plain = {"vertices": cube.vertices.tolist(), "triangles": cube.faces.tolist()}
    opened = {**plain, "triangles": plain["triangles"][1:]}
    cube.export(tmp_path / "cube.stl")
    file = {"resource": "cube.stl", "dimensions": [1, 1, 2]}
    things = {"inline": inline, "plain": plain, "opened": opened, "file": file}
    scene = read([{"id": n, "meshes": [m], "mesh_poses": [{"position": [0, 0, 1]}]} for n, m in things.items()])
    assert [scene[name].shape.hull for name in things] == [None, None, True, None]
    assert scene["inline"].shape == scene["plain"].shape
    assert scene["file"].shape.scale == (1, 1, 2)
    assert [note for note in scene.notes if "opened" in note and "not watertight" in note] == list(scene.notes)


def entries(names, allowed, wrapped=False):
    rows = [[a != b and ((a, b) in allowed or (b, a) in allowed) for b in names] for a in names]
    return {"entry_names": names, "entry_values": [{"enabled": row} for row in rows] if wrapped else rows}


@pytest.mark.parametrize("wrapped", [False, True])
def test_the_matrix_allows_links_against_objects_and_disables_links_against_links(read, wrapped):
    names = ["base", "hand", "table", "cup", "<octomap>"]
    allowed = [("base", "table"), ("hand", "base"), ("table", "cup"), ("hand", "<octomap>")]
    scene = read([box("table"), box("cup")], allowed_collision_matrix=entries(names, allowed, wrapped))
    assert scene.allowed == (("base", "table"),)
    assert scene.disabled == (("base", "hand"),)


def test_an_entry_overrides_a_default_and_two_defaults_must_agree(read):
    matrix = entries(["base", "table"], [])
    matrix |= {"default_entry_names": ["base", "hand", "tip", "cup"], "default_entry_values": [True, True, False, True]}
    with pytest.raises(SceneError, match="'cup' touch anything by default, but not tip"):
        read([box("table"), box("cup")], allowed_collision_matrix=matrix)
    scene = read([box("table"), box("can")], allowed_collision_matrix=matrix)
    # base against table: an entry says no; against can there is only the default of base
    assert set(scene.allowed) == {("cup", "table"), ("cup", "can"), ("base", "can"), ("hand", "table"), ("hand", "can")}
    assert ("base", "tip") not in scene.disabled
    assert ("base", "hand") in scene.disabled
    matrix = {"default_entry_names": ["can"], "default_entry_values": [True]}
    assert read([box("can")], allowed_collision_matrix=matrix).allowed == (("*", "can"),)


def test_an_entry_that_only_one_side_states_allows_nothing(read):
    matrix = {"entry_names": ["base", "table"], "entry_values": [[False, True], [False, False]]}
    assert read([box("table")], allowed_collision_matrix=matrix).allowed == ()


def test_frames_of_the_file_are_undone(read):
    world = {"child_frame_id": "pallet", "header": {"frame_id": "world"}, "transform": {"translation": [0, 0, 2]}}
    floating = {"transforms": [{"translation": [1, 0, 0], "rotation": QUARTER}], "joint_names": ["virtual"]}
    scene = read(
        [box("on_pallet", header={"frame_id": "pallet"}), box("in_world", header={"frame_id": "world"}), box("plain")],
        fixed_frame_transforms=[world],
        robot_state={"multi_dof_joint_state": floating},
    )
    root_from_world = pose((1, 0, 0), (0, 0, math.pi / 2)).inverse()
    for name, at in (("on_pallet", (0, 0, 2)), ("in_world", (0, 0, 0)), ("plain", (0, 0, 0))):
        np.testing.assert_allclose(matrix(scene[name].pose), matrix(root_from_world * pose(at)), atol=1e-15)
    assert scene.frame == ""


def test_a_frame_the_file_does_not_place_must_be_the_root_of_the_robot(read, ur5, panda):
    scene = read([box(header={"frame_id": "base_link"}, pose={"position": [5, 0, 0]})])
    assert scene.frame == "base_link"
    assert CollisionChecker(ur5, scene)  # its root is a link "world" in which base_link stands unmoved
    with pytest.raises(InputError, match="placed from 'tool0'"):
        CollisionChecker(ur5, read([box(header={"frame_id": "tool0"}, pose={"position": [5, 0, 0]})]))
    with pytest.raises(InputError, match=r"cell\.yaml is placed from 'base_link'"):
        CollisionChecker(panda, scene)
    with pytest.raises(SceneError, match=r"'camera'.*known: .*'base_link'"):
        read([box("a", header={"frame_id": "base_link"}), box("b", header={"frame_id": "camera"})])


@pytest.mark.parametrize(
    ("objects", "more", "expected"),
    [
        ([box(operation=1)], {}, "operation 1"),
        ([box(colour="red")], {}, "'colour'"),
        ([box(), box()], {}, "second object is named 'box'"),
        ([box("")], {}, "id ''"),
        ([{"id": "none"}], {}, "no primitives"),
        ([{"id": "p", "primitives": [{"type": "prism", "dimensions": [1, 1]}]}], {}, "prism"),
        ([{"id": "p", "primitives": [{"type": "box", "dimensions": [1, 1]}]}], {}, "dimensions of a box"),
        ([{"id": "p", "primitives": [{"type": "sphere", "dimensions": [-1]}]}], {}, "Sphere.radius = -1"),
        ([{"id": "p", "primitives": ["box"]}], {}, "'p'"),
        ([box(primitive_poses=[{}, {}])], {}, "2 poses"),
        ([box(pose={"position": [0, 0]})], {}, "'box'.*position"),
        ([box(pose={"orientation": [0, [0], 0, 1]})], {}, "'box'.*orientation"),
        ([{"id": "m", "meshes": [{"resource": "package://none/cup.stl"}]}], {}, "was not found"),
        ([{"id": "m", "planes": [{"coef": [0, 0, 0, 1]}]}], {}, "no length"),
        (
            [],
            {"robot_state": {"attached_collision_objects": [{"link_name": "hand", "object": box("cup")}]}},
            "'cup' on 'hand'",
        ),
        ([], {"allowed_collision_matrix": {"entry_names": ["a"], "entry_values": []}}, "not square"),
        ([], {"worlds": {}}, "'worlds'"),
        ([], {"robot_state": 3}, "robot_state"),
        ([], {"world": {"collision_objects": [], "octomap": {"octomap": {"data": [1]}}}}, "octomap"),
        ([], {"world": {"collision_objects": 3}}, "not a list"),
        ([], {"fixed_frame_transforms": [3]}, "PlanningScene"),
    ],
)
def test_unsupported_objects_of_a_moveit_scene_are_refused_by_name(read, objects, more, expected):
    with pytest.raises(SceneError, match=expected) as caught:
        read(objects, **more)
    assert "cell.yaml" in str(caught.value)


def test_colours_and_paddings(read):
    scene = read(
        [box("a"), box("b")],
        object_colors=[{"id": "a", "color": {"r": 1, "g": 0.5, "b": 0, "a": 1}}],
        link_padding=[{"link_name": "hand", "padding": 0.01}],
        link_scale=[{"link_name": "hand", "scale": 1.0}],
    )
    assert scene["a"].rgba == (1, 0.5, 0, 1)
    assert scene["b"].rgba is None
    assert [note.split()[0] for note in scene.notes] == ["link_padding"]


def test_a_planning_scene_is_saved_as_one_of_ours(read, tmp_path):
    scene = read(
        [box("table", header={"frame_id": "base_link"})],
        allowed_collision_matrix=entries(
            ["base_link", "hand", "table"], [("base_link", "table"), ("base_link", "hand")]
        ),
    )
    scene.save(tmp_path / "ours.yaml")
    assert "obstacles" in yaml.safe_load((tmp_path / "ours.yaml").read_text())
    assert Scene.load(tmp_path / "ours.yaml").is_close(scene)
