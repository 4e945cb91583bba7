"""Scenes as values; files of scenes and attached bodies: reading, errors with their location, and writing."""

from __future__ import annotations

import math
import pickle
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof import Box, CollisionChecker, InputError, Obstacle, Scene, Sphere, UnknownNameError, pose
from pinproof.collision import Cone, ConvexShape, Ellipsoid, HeightMap, Shape
from pinproof.collision.certificates.certificate import body_digest
from pinproof.description import robots_folder
from pinproof.errors import SceneError
from pinproof.spatial import matrix

from ..examples import examples

EVERY_SHAPE = """
obstacles:
  - {name: table, box: [1.2, 0.8, 0.04], xyz: [0.5, 0, -0.02], rpy: [0, 0, pi/2], rgba: [1, 0.5, 0, 1]}
  - {name: ball, sphere: {radius: 1e-1}}
  - name: bolt
    cylinder: {radius: 0.008, length: 0.03}
    quat_xyzw: [1, 0, 0, 1]
  - {name: pipe, capsule: {radius: 0.02, length: 0.3}}
  - {name: part, mesh: {path: part.stl, scale: 0.001, hull: false}}
  - {name: sheet, mesh: {path: part.stl, hull: false, hollow: true}}
  - {name: tip, cone: {radius: 0.02, length: 0.05}}
  - {name: egg, ellipsoid: {rx: 0.02, ry: 0.03, rz: 0.04}}
  - {name: floor, half_space: {}, xyz: [0, 0, -0.1]}
  - {name: stone, convex_shape: {points: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, pi/4]]}}
  - {name: rounded, convex_shape: {points: [[0, 0, 0], [0, 0, 0.1]], radius: 0.02}}
  - {name: wedge, mesh: {vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], triangles: [[0, 2, 1], [0, 1, 3]]}}
  - {name: scan, point_cloud: {points: [[0, 0, 0.123456789012345], [1, 0, 0]], resolution: 0.01}}
  - {name: ground, height_map: {heights: [[0, 0.1, 0], [0, 0.2, 0]], x: 2, y: 1}}
  - {name: camera, occupancy_grid: {voxel: 0.1, low: [-1, 0, 2], count: [1, 1, 3], cells: eNpjYGQCAAAHAAQ=}}
allowed_contacts:
  - [base_link, table]
margins:
  - {between: [tool0, ball], margin: 5e-3}
disabled_pairs:
  - [wrist_1_link, wrist_3_link]
frame: base_link
"""


@pytest.fixture
def scene_text(tmp_path: Path):
    """Reads a scene from text, as a file in a folder with a mesh ``part.stl``."""
    (tmp_path / "part.stl").write_bytes(b"solid")

    def read(text: str) -> pp.Scene:
        path = tmp_path / "scene.yaml"
        path.write_text(text, encoding="utf-8")
        return pp.Scene.load(path)

    return read


def test_every_shape_is_read(scene_text, tmp_path):
    scene = scene_text(EVERY_SHAPE)
    assert [o.shape for o in scene.obstacles] == [
        pp.Box(1.2, 0.8, 0.04),
        pp.Sphere(0.1),
        pp.Cylinder(0.008, 0.03),
        pp.Capsule(0.02, 0.3),
        pp.Mesh(tmp_path / "part.stl", 0.001, hull=False),
        pp.Mesh(tmp_path / "part.stl", hull=False, hollow=True),
        Cone(0.02, 0.05),
        Ellipsoid(0.02, 0.03, 0.04),
        pp.HalfSpace(),
        ConvexShape([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, math.pi / 4]]),
        ConvexShape([[0, 0, 0], [0, 0, 0.1]], 0.02),
        pp.Mesh.from_arrays([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3]]),
        pp.PointCloud([[0, 0, 0.123456789012345], [1, 0, 0]], 0.01),
        HeightMap([[0, 0.1, 0], [0, 0.2, 0]], 2, 1),
        pp.OccupancyGrid([[[0, 1, 2]]], 0.1, (-1, 0, 2)),
    ]
    assert {type(o.shape) for o in scene.obstacles} == set(get_args(Shape))
    assert scene.allowed == (("base_link", "table"),)
    assert [(each.between, each.margin) for each in scene.margins] == [(("tool0", "ball"), 0.005)]
    assert (scene.disabled, scene.frame) == ((("wrist_1_link", "wrist_3_link"),), "base_link")
    assert scene["table"].rgba == (1.0, 0.5, 0.0, 1.0)
    np.testing.assert_array_equal(matrix(scene["ball"].pose), np.eye(4))
    np.testing.assert_allclose(matrix(scene["table"].pose), matrix(pp.pose((0.5, 0, -0.02), (0, 0, math.pi / 2))))
    np.testing.assert_allclose(scene["bolt"].pose.rotation, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)


def test_a_scene_without_obstacles_is_legal(scene_text):
    assert scene_text("obstacles: []").obstacles == ()


BALL = "obstacles:\n  - {name: ball, sphere: {radius: 0.1}"


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("", ["is empty", "obstacles"]),
        ("[1, 2]", ["a list", "obstacles"]),
        ("obstacle: []", ["'obstacle'", "valid: obstacles"]),
        ("allowed_contacts: []", ["does not state obstacles"]),
        ("obstacles: 3", ["key obstacles", "not a list"]),
        ("obstacles: [3]", ["line 1, column 1", "obstacles[0]"]),
        ("obstacles:\n  - {sphere: {radius: 1}}", ["line 2, column 5", "obstacles[0] does not state name"]),
        ("obstacles:\n  - {name: 7, sphere: {radius: 1}}", ["line 2", "7", "quotes"]),
        ("obstacles:\n\n  - {name: a}", ["line 3", "'a'", "no shape", "box, sphere"]),
        ("obstacles:\n  - {name: a, box: [1, 1, 1], sphere: {radius: 1}}", ["box and sphere"]),
        ("obstacles:\n  - {name: a, sphear: {radius: 1}}", ["line 2", "'a'", "'sphear'", "valid: sphere"]),
        ("obstacles:\n  - {name: a, sphere: {radus: 1}}", ["line 2, column 24", "sphere.radus", "valid: radius"]),
        ("obstacles:\n  - {name: a, sphere: 1}", ["'a'", "write sphere: {radius: ...}"]),
        ("obstacles:\n  - {name: a, cylinder: {radius: 1}}", ["'a'", "length"]),
        ("obstacles:\n  - {name: a, box: [1, 1]}", ["'a'", "box must have 3 numbers"]),
        ("obstacles:\n  - {name: a, box: [1, 1, 0]}", ["'a'", "Box.z = 0"]),
        ("obstacles:\n  - {name: a, box: [1, 1, wide]}", ["'a'", "box", "'wide'"]),
        ("obstacles:\n  - {name: a, sphere: {radius: -1}}", ["'a'", "Sphere.radius = -1"]),
        ("obstacles:\n  - {name: a, sphere: {radius: .nan}}", ["'a'", "nan"]),
        ("obstacles:\n  - {name: a, sphere: {radius: true}}", ["'a'", "sphere.radius", "True"]),
        ("obstacles:\n  - {name: a, sphere: {radius: }}", ["'a'", "sphere.radius", "None"]),
        ("obstacles:\n  - {name: a, mesh: {scale: 1}}", ["'a'", "needs a path"]),
        ("obstacles:\n  - {name: a, mesh: {path: none.stl}}", ["'a'", "none.stl", "relative to this file"]),
        ("obstacles:\n  - {name: a, mesh: {path: part.stl, scale: [1, 0, 1]}}", ["'a'", "Mesh.scale"]),
        ("obstacles:\n  - {name: a, mesh: {path: part.stl, hull: maybe}}", ["'a'", "mesh.hull"]),
        ("obstacles:\n  - {name: a, half_space: 3}", ["'a'", "write half_space: {}"]),
        ("obstacles:\n  - {name: a, half_space: {z: 1}}", ["'a'", "half_space", "'z'"]),
        ("obstacles:\n  - {name: a, mesh: {path: part.stl, vertices: [[0, 0, 0]]}}", ["'a'", "not both"]),
        ("obstacles:\n  - {name: a, mesh: {vertices: [[0, 0, 0]], triangles: [[0, 0, 0.5]]}}", ["integers"]),
        ("obstacles:\n  - {name: a, point_cloud: {points: [[0, 0, 0]]}}", ["'a'", "resolution"]),
        ("obstacles:\n  - {name: a, convex_shape: {points: [[0, 0, 0]]}}", ["'a'", "flat"]),
        ("obstacles:\n  - {name: a, height_map: {heights: [[0, 0], [0]], x: 1, y: 1}}", ["'a'", "heights"]),
        ("obstacles: []\nframe: 3", ["frame", "3"]),
        ("obstacles: []\ndisabled_pairs: [[a]]", ["disabled_pairs", "pair"]),
        ("obstacles: []\ndisabled_pairs: [[a, a]]", ["disabled_pairs", "twice"]),
        ("obstacles: []\nmargins: [{between: [a, b], margn: 1}]", ["line 2", "margins[0].margn", "valid: margin"]),
        ("obstacles: []\nmargins: [{between: [a, b], margin: -1}]", ["line 2", "margins[0].margin", "at least 0"]),
        ("obstacles: []\nmargins: [{between: [a, a], margin: 1}]", ["line 2", "margins[0]", "twice"]),
        ("obstacles: []\nmargins: [{between: a, margin: 1}]", ["line 2", "margins[0]", "pair of names"]),
        (
            "obstacles: []\nmargins:\n- {between: [a, b], margin: 0}\n- {between: [b, a], margin: 0.1}",
            ["line 2", "margins", "a and b twice"],
        ),
        (BALL + "}\nallowed_contacts: [[ball, ball]]", ["allowed_contacts", "twice"]),
        (BALL + ", xyz: [0, 0]}", ["'ball'", "xyz must have 3 numbers"]),
        (BALL + ", xyz: [0, 0, .inf]}", ["'ball'", "xyz", "inf"]),
        (BALL + ", rpy: [0, 0, 0], quat_xyzw: [0, 0, 0, 1]}", ["'ball'", "not both"]),
        (BALL + ", quat_xyzw: [0, 0, 0, 0]}", ["'ball'", "quat_xyzw"]),
        (BALL + ", rgba: [0, 0, 0, 255]}", ["'ball'", "rgba", "255"]),
        (BALL + "}\n  - {name: ball, box: [1, 1, 1]}", ["line 3", "second", "'ball'"]),
        (BALL + "}\nallowed_contacts: [[base_link, bal]]", ["allowed_contacts", "'bal'", "valid: ball"]),
        (BALL + "}\nallowed_contacts: [base_link]", ["allowed_contacts", "pair"]),
        (BALL + ", name: again}", ["line 2", "duplicate key 'name'"]),
        ("obstacles:\n  - name: [", ["line", "YAML"]),
        ("obstacles: [!!python/object/apply:os.system [ls]]", ["YAML"]),
    ],
)
def test_nonsense_is_refused_by_name_and_place(scene_text, text, wanted):
    with pytest.raises(SceneError) as caught:
        scene_text(text)
    missing = [word for word in wanted if word not in str(caught.value)]
    assert not missing, f"{missing} not in: {caught.value}"
    assert "scene.yaml" in str(caught.value)


def test_a_missing_file_and_another_ending_are_refused(tmp_path):
    with pytest.raises(SceneError, match="cannot be read"):
        pp.Scene.load(tmp_path / "none.yaml")
    with pytest.raises(SceneError, match=r"valid: \.yaml"):
        pp.Scene.load(tmp_path / "scene.stl")
    with pytest.raises(SceneError, match=r"valid: \.yaml"):
        pp.Scene().save(tmp_path / "scene.stl")


def test_a_written_scene_reads_back(scene_text, tmp_path):
    scene = scene_text(EVERY_SHAPE)
    scene.save(tmp_path / "copy.yaml")
    copy = pp.Scene.load(tmp_path / "copy.yaml")
    assert copy.is_close(scene, 1e-15)
    assert [o.rgba for o in copy.obstacles] == [o.rgba for o in scene.obstacles]
    assert str(tmp_path) not in (tmp_path / "copy.yaml").read_text()  # the mesh moves with its folder


def test_a_written_scene_in_another_folder_still_finds_its_mesh(scene_text, tmp_path):
    scene = scene_text(EVERY_SHAPE)
    (tmp_path / "sub").mkdir()
    scene.save(tmp_path / "sub" / "copy.yaml")
    assert pp.Scene.load(tmp_path / "sub" / "copy.yaml").is_close(scene)


def test_a_scene_that_cannot_be_written_is_an_error_and_leaves_no_file(tmp_path):
    with pytest.raises(SceneError, match="cannot be written"):
        pp.Scene().save(tmp_path / "none" / "scene.yaml")
    assert list(tmp_path.iterdir()) == []


@examples(25)
@given(
    sides=st.tuples(*[st.floats(1e-6, 1e4)] * 3),
    xyz=st.tuples(*[st.floats(-1e4, 1e4)] * 3),
    rpy=st.tuples(*[st.floats(-7, 7)] * 3),
    name=st.text(st.characters(codec="utf-8", categories=["L", "N", "P", "S", "Zs"]), min_size=1),
)
def test_any_box_reads_back(tmp_path_factory, sides, xyz, rpy, name):
    path = tmp_path_factory.mktemp("scene") / "scene.yaml"
    scene = pp.Scene([pp.Obstacle(name, pp.Box(*sides), pp.pose(xyz, rpy))], allowed=[("link", name)])
    scene.save(path)
    copy = pp.Scene.load(path)
    assert copy.is_close(scene, 1e-14)
    np.testing.assert_array_equal(copy[name].pose.translation, scene[name].pose.translation)


def test_the_scene_of_the_ur5_agrees_with_its_comments():
    scene = pp.Scene.load(robots_folder() / "ur5" / "scene.yaml")
    bolts = [name for name in scene.names if name.startswith("bolt_")]
    assert len(bolts) >= 6
    table = scene["table"]
    top = table.pose.translation[2] + table.shape.z / 2
    for bolt in (scene[name] for name in bolts):
        assert bolt.pose.translation[2] - bolt.shape.length / 2 == pytest.approx(top, abs=1e-12)
    assert math.hypot(*scene["bolt_6"].pose.translation[:2]) > 0.95  # out of the UR5's reach
    assert {link for link, _ in scene.allowed} <= set(pp.load_robot("ur5").urdf.links)


@pytest.mark.parametrize(
    "line", ["{name: far, sphere: {radius: 1}, xyz: [1e300, 0, 0]}", "{name: far, box: [1, 1e300, 1]}"]
)
def test_a_number_beyond_the_range_of_a_cell_is_refused(tmp_path, line):
    path = tmp_path / "scene.yaml"
    path.write_text(f"obstacles:\n  - {line}\n")
    with pytest.raises(SceneError, match=r"far.*10000 m"):
        pp.Scene.load(path)


def test_errors_found_by_a_checker_name_the_file(scene_text, ur5):
    with pytest.raises(pp.UnknownNameError, match=r"'bse_link'.*scene\.yaml"):
        pp.CollisionChecker(ur5, scene_text(BALL + "}\nallowed_contacts: [[bse_link, ball]]"))
    with pytest.raises(pp.InputError, match=r"scene\.yaml is placed from 'panda_link0'; the root of the robot is"):
        pp.CollisionChecker(ur5, scene_text(BALL + "}\nframe: panda_link0"))


def test_a_link_without_geometry_may_be_in_allowed_pairs(scene_text, ur5):
    assert pp.CollisionChecker(ur5, scene_text(BALL + "}\nallowed_contacts: [[tool0, ball]]")).pairs


def test_anything_may_touch_what_is_allowed_to_touch_anything(scene_text, ur5):
    checker = pp.CollisionChecker(ur5, scene_text(BALL + '}\nallowed_contacts: [["*", ball]]'))
    assert not [
        pair for pair in checker.pairs if "ball" in (checker.bodies[pair[0]].owner, checker.bodies[pair[1]].owner)
    ]
    assert {pair.reason for pair in checker.excluded if "ball" in pair.owners} == {"allowed by the scene"}


@pytest.fixture
def scene() -> Scene:
    return Scene(
        [Obstacle("table", Box(1, 1, 0.1)), Obstacle("ball", Sphere(0.1), pose((1, 0, 0)), (1, 0, 0, 1))],
        allowed=[("base", "table"), ("tool", "ball")],
        disabled=[("upper", "fore")],
    )


def test_moving_keeps_all_but_the_place_of_one(scene):
    moved = scene.move("ball", pose((0, 2, 0)))
    assert moved.names == scene.names
    assert (moved.allowed, moved.disabled) == (scene.allowed, scene.disabled)
    assert (moved["ball"].shape, moved["ball"].rgba) == (scene["ball"].shape, scene["ball"].rgba)
    np.testing.assert_array_equal(moved["ball"].pose.translation, [0, 2, 0])
    np.testing.assert_array_equal(scene["ball"].pose.translation, [1, 0, 0])
    assert moved.is_close(scene.move("ball", np.array([[1, 0, 0, 0], [0, 1, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])))
    assert not moved.is_close(scene)


def test_adding_and_removing(scene):
    more = scene.add(Obstacle("can", Sphere(0.05)))
    assert more.names == ("table", "ball", "can")
    assert more.allowed == scene.allowed
    fewer = more.remove("ball")
    assert fewer.names == ("table", "can")
    assert fewer.allowed == (("base", "table"),)
    assert fewer.disabled == scene.disabled
    assert scene.names == ("table", "ball")


def test_names_that_are_not_there_are_refused(scene):
    for change in (lambda: scene.move("bal", pose()), lambda: scene.remove("bal"), lambda: scene["bal"]):
        with pytest.raises(UnknownNameError, match="'bal'"):
            change()
    with pytest.raises(InputError, match="named 'ball'"):
        scene.add(Obstacle("ball", Sphere(1)))


def test_a_scene_is_a_mapping_of_names_to_obstacles(scene):
    same = dict(zip(scene.names, scene.obstacles, strict=True))
    assert dict(scene) == dict(scene.items()) == same
    assert (list(scene), len(scene), list(scene.values())) == (list(same), 2, list(same.values()))
    assert isinstance(scene, Mapping)
    assert not Scene()
    for name in ("ball", "bal", None, 3):
        assert (name in scene, scene.get(name), scene.get(name, 5)) == (name in same, same.get(name), same.get(name, 5))
    with pytest.raises(KeyError):
        scene["bal"]
    again = pickle.loads(pickle.dumps(scene))
    assert list(again) == list(scene)
    assert again.is_close(scene)
    assert again == scene
    assert len({scene: 1, again: 2}) == 1


class _Name(str):
    """A name that counts how often it is compared with another name."""

    compared = 0
    __hash__ = str.__hash__

    def __eq__(self, other: object) -> bool:
        _Name.compared += 1
        return str.__eq__(self, other)


def test_the_work_for_a_large_scene_grows_with_its_number_of_obstacles(generic_6dof):
    """Comparisons of names, and calls in Python, for 200 and for 800 boxes: 4 times as many, where n^2 has 16."""

    def work(count: int) -> tuple[int, int]:
        names = [_Name(f"box {i}") for i in range(count)]
        boxes = [Obstacle(name, Box(0.01, 0.01, 0.01), pose((2 + i / count, 0, 0))) for i, name in enumerate(names)]
        calls, _Name.compared = [0], 0

        def count_call(*_: object) -> None:
            calls[0] += 1

        sys.setprofile(count_call)
        try:
            scene = Scene(boxes, allowed=[(generic_6dof.base, name) for name in names])
            more = scene.add(Obstacle("ball", Sphere(0.1))).move("ball", pose((3, 0, 0)))
            left = more.remove(*names[::2])
            placed = [left[name] for name in names[1::2] if name in left and left.get(name)]
            checker = CollisionChecker(generic_6dof, scene).with_scene(left)
        finally:
            sys.setprofile(None)
        assert placed == boxes[1::2]
        assert list(checker.scene) == [*names[1::2], "ball"]
        return calls[0], _Name.compared

    work(10)  # imports and caches
    (few_calls, few_compared), (calls, compared) = work(200), work(800)
    assert calls < 6 * few_calls
    assert compared < 6 * max(few_compared, 200)


@pytest.mark.parametrize("pair", [("base", "base"), "ab", ("a", "b", "c"), ("a", 3)])
def test_an_invalid_pair_is_refused(scene, pair):
    with pytest.raises(InputError):
        Scene(scene.obstacles, disabled=[pair])


ROD = pp.Obstacle("rod", pp.Cylinder(radius=0.02, length=0.1), pp.pose((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)))


def test_a_saved_file_is_read_back(tmp_path: Path) -> None:
    corners = np.vstack([np.zeros(3), np.eye(3)])
    block = pp.Obstacle("block", pp.Mesh.from_arrays(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    given = pp.collision.Attachments(
        (ROD, block), (("rod", "block"),), {"rail": 0.5}, pp.pose((0, 0, 0.1), (0.1, 0.2, 0.3))
    )
    given.save(tmp_path / "tool.yaml")
    found = pp.collision.Attachments.load(tmp_path / "tool.yaml")
    assert [(b.name, b.shape) for b in found.bodies] == [(b.name, b.shape) for b in given.bodies]
    for one, other in zip(found.bodies, given.bodies, strict=True):
        np.testing.assert_allclose(one.pose.homogeneous, other.pose.homogeneous, atol=1e-15)
        assert body_digest(one) == body_digest(other)
    assert (found.allowed, found.held) == (given.allowed, given.held)
    np.testing.assert_allclose(found.tip.homogeneous, given.tip.homogeneous, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tool: []", ("'tool'", "allowed_contacts, attached, held, tip")),
        ("held: {}", ("does not state attached",)),
        ("attached: {}", ("key attached", "list")),
        ("attached: [rod]", ("attached[0]", "'rod'")),
        ("attached:\n  - {name: rod, sphere: {radius: 0.1}, colour: red}", ("line 2", "'colour'", "rgba")),
        ("attached:\n  - {name: rod, sphere: {radius: -1}}", ("line 2", "radius")),
        ("attached:\n  - {name: a, sphere: {radius: 1}}\n  - {name: a, sphere: {radius: 1}}", ("line 3", "'a'")),
        ("attached: []\nallowed_contacts: [[a]]", ("key allowed_contacts",)),
        ("attached: []\nheld: [1]", ("key held",)),
        ("attached: []\nheld: {rail: fast}", ("line 2", "key held", "rail")),
        ("attached: []\nheld: {rail: .nan}", ("line 2", "key held", "rail")),
        ("attached: []\ntip: {xyz: [0, 0, 0], spin: 1}", ("line 2", "key tip", "'spin'")),
        ("attached: []\ntip: [0, 0, 0]", ("key tip",)),
        ("attached: []\ntip: {xyz: [0, 0]}", ("line 2", "key tip")),
    ],
)
def test_meaningless_values_are_refused_with_their_location(tmp_path: Path, text: str, words: tuple[str, ...]) -> None:
    file = tmp_path / "tool.yaml"
    file.write_text(text)
    with pytest.raises(SceneError) as caught:
        pp.collision.Attachments.load(file)
    assert str(caught.value).startswith(str(file))
    for word in words:
        assert word in str(caught.value)
