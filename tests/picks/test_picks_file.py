"""Picks files: a bad row is reported and the others are kept; what all rows share must make sense."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

import pinproof as pp
from pinproof.common.content_hash import digest
from pinproof.description import robots_folder
from pinproof.errors import FileError, InputError, PicksError, UnknownNameError
from pinproof.picks import NamedFrame, PickSetup, PlaceTarget, open_picks

GOOD_ROW = "{name: fine, xyz: [0.4, 0.1, 0.2]}"
PAD = "{name: a, box: [1, 1, 1]}"


@pytest.fixture
def write(tmp_path: Path):
    def write(*rows: str, shared: str = "defaults: {rpy: [pi, 0, 0]}") -> Path:
        path = tmp_path / "picks.yaml"
        path.write_text("\n".join([shared, "picks:", *(f"  - {row}" for row in rows)]), encoding="utf-8")
        return path

    return write


def test_everything_that_is_stated_is_read(write) -> None:
    shared = """
robot: ur5
tcp: tool0
scene: cells/scene.yaml
margin: 2e-3
home: {b: pi/2, a: -1}
tip: {xyz: [0, 0, 0.105], rpy: [0, 0, pi]}
tool: [{name: picker, cylinder: {radius: 0.02, length: 0.1}, xyz: [0, 0, 0.05]}]
defaults: {rpy: [pi, 0, 0], approach: 0.2}"""
    path = write(
        "{name: one, xyz: [0.46, 0.15, 0.035], retreat: 0}",
        "{name: two, xyz: [0, 0, 1], quat_xyzw: [0, 0, 2, 0], approach: 0.05, retreat_direction: [0, 3, 4]}",
        shared=shared,
    )
    picks = pp.read_picks(path)
    assert (picks.robot, picks.tcp, picks.margin, picks.source) == ("ur5", "tool0", 0.002, path)
    assert picks.scene == path.parent / "cells/scene.yaml"  # relative to the file, not to where one stands
    assert picks.home == {"a": -1.0, "b": np.pi / 2}
    np.testing.assert_allclose(pp.xyz_rpy(picks.tip), [0, 0, 0.105, 0, 0, np.pi], atol=1e-15)
    assert [body.name for body in picks.tool] == ["picker"]
    assert picks.tool[0].rgba is not None
    one, two = picks
    assert (one.name, one.approach, one.retreat, one.retreat_direction) == ("one", 0.2, 0.0, (0.0, 0.0, 1.0))
    np.testing.assert_allclose(pp.xyz_rpy(one.pose), [0.46, 0.15, 0.035, np.pi, 0, 0], atol=1e-15)
    assert (two.name, two.approach, two.retreat, two.retreat_direction) == ("two", 0.05, 0.1, (0.0, 0.6, 0.8))
    # Its own quaternion goes before the default rpy: half a turn about z.
    np.testing.assert_allclose(two.pose.rotation, np.diag([-1.0, -1.0, 1.0]), atol=1e-15)
    assert picks.problems == ()


def test_a_support_is_a_name_or_several(write) -> None:
    place = "{name: put, xyz: [0, 0, 1], object: part, place: {xyz: [1, 0, 1], rpy: [pi, 0, 0], support: [a, b]}}"
    single, double = (f"{{name: {key}, xyz: [0, 0, 1], object: part, support: {key}}}" for key in ("rail", "two"))
    one, put, several = pp.read_picks(write(single, place, double.replace("support: two", "support: [left, right]")))
    assert one.support == ("rail",)
    assert several.support == ("left", "right")
    assert (put.support, put.place.support) == (None, ("a", "b"))


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("{name: bad, xyz: [0.4, .nan, 0.2]}", "xyz holds nan at index 1"),
        ("{name: bad, xyz: [0.4, .inf, 0.2]}", "xyz holds inf"),
        ("{name: bad, xyz: [0.4, 0.2]}", "xyz must have 3 numbers, not 2"),
        ("{name: bad, xyz: 0.4}", "xyz must have 3 numbers, not 1"),
        ("{name: bad, xyz: [0.4, near, 0.2]}", "key xyz: 'near' is not a number"),
        ("{name: bad, xyz: [0.4, true, 0.2]}", "key xyz: True is not a number"),
        ("{name: bad, xyz: }", "key xyz: None is not a number"),
        ("{name: bad}", "does not state its xyz"),
        ("{xyz: [0.4, 0.1, 0.2]}", "states no name"),
        ("{xyz: [0.4, 0.1, 0.2]}", "a pick needs a name"),
        ("{name: 7, xyz: [0.4, 0.1, 0.2]}", "put it in quotes"),
        ("{name: fine, xyz: [0.4, 0.1, 0.2]}", "a second pick is named 'fine'"),
        ("{name: bad, xyz: [0.4, 0.1, 0.2], aproach: 0.1}", "unknown key 'aproach'; valid: approach"),
        ("{name: bad, xyz: [0.4, 0.1, 0.2], approach: -0.1}", "approach of pick 'bad' must be a finite number"),
        ("{name: bad, xyz: [0.4, 0.1, 0.2], approach: [0.1, 0.2]}", "approach of pick 'bad'"),
        ("{name: bad, xyz: [0.4, 0.1, 0.2], retreat: .nan}", "retreat of pick 'bad' must be a finite number"),
        ("{name: bad, xyz: [0.4, 0.1, 0.2], retreat_direction: [0, 0, 0]}", "retreat_direction of pick 'bad' is zero"),
        ("{name: bad, xyz: [0.4, 0.1, 0.2], rpy: [0, 0, 0], quat_xyzw: [0, 0, 0, 1]}", "rpy or quat_xyzw, not both"),
        ("{name: bad, xyz: [0.4, 0.1, 0.2], quat_xyzw: [0, 0, 0, 0]}", "a rotation needs a quaternion of length 1"),
        ("bolt_1", "'bolt_1' is not a pick; valid keys: name, xyz"),
        ("{name: bad, xyz: [0, 0, 0], spin: fast}", "'fast' is not a number"),
        ("{name: bad, xyz: [0, 0, 0], spin: {range: [1, 0]}}", "must not exceed the last"),
        ("{name: bad, xyz: [0, 0, 0], tolerance: {tilt: -1}}", "at least 0"),
        ("{name: bad, xyz: [0, 0, 0], retreat_frame: base}", "unknown retreat_frame 'base'"),
        ("{name: bad, xyz: [0, 0, 0], place: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}", "a place or a support but no object"),
        ("{name: bad, xyz: [0, 0, 0], object: a, place: {xyz: [0, 0, 0]}}", "place does not state"),
        ("{name: bad, xyz: [0, 0, 0], object: {box: [1, 1]}}", "box must have 3 numbers, not 2"),
        ("{name: bad, xyz: [0, 0, 0], pattern: {grid: {counts: [2, 0, 1], step: [1, 1, 1]}}}", "integer of at least 1"),
        ("{name: bad, xyz: [0, 0, 0], pattern: {ring: 3}}", "key pattern.ring: unknown key 'ring'"),
        *(
            (f"{{name: bad, xyz: [0, 0, 1], object: part, support: {wrong}}}", "support")
            for wrong in ("[]", "", "[left, left]", "3")
        ),
    ],
)
def test_a_bad_row_is_reported_with_its_reason_and_the_others_are_kept(write, row: str, reason: str) -> None:
    picks = pp.read_picks(write(GOOD_ROW, row, "{name: also fine, xyz: [0, 0, 1]}"))
    assert [pick.name for pick in picks] == ["fine", "also fine"]
    (problem,) = picks.problems
    assert problem.row == 2
    assert reason in problem.reason
    if row.startswith("{"):
        assert problem.reason.startswith("line 4, column ")


@pytest.mark.parametrize(
    ("row", "key"),
    [
        ("retreat: 0, retreat_direction: [0, 0, 1]", "retreat_direction"),
        ("retreat: 0, retreat_frame: tip", "retreat_frame"),
        ("approach_frame: root", "approach_frame"),
        ("object: bolt, place: {object_pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}, approach: 0, approach_frame: root}",
         "place.approach_frame"),
        ("object: bolt, place: {object_pose: {xyz: [0, 0, 0], rpy: [0, 0, 0]}, retreat_frame: root}",
         "place.retreat_frame"),
    ],
)  # fmt: skip
def test_a_direction_or_a_frame_without_its_line_is_refused_at_its_key(write, row, key) -> None:
    stated = f"{{name: a, xyz: [0.4, 0.1, 0.2], {row}}}"
    (problem,) = pp.read_picks(write(GOOD_ROW, stated)).problems
    column = 5 + stated.index(key.rpartition(".")[2])
    assert problem.reason.startswith(f"line 4, column {column}, key {key}: ")


def test_the_direction_of_a_line_without_length_may_be_a_default(write) -> None:
    lines = "retreat: 0, retreat_direction: [1, 0, 0], approach: 0, approach_direction: [0, 1, 0]"
    loaded = pp.read_picks(
        write("{name: a, xyz: [0, 0, 0], retreat: 0.1}", shared=f"defaults: {{rpy: [0, 0, 0], {lines}}}")
    )
    assert not loaded.problems
    assert loaded.picks[0].after(loaded.picks[0].pose).translation == pytest.approx([0.1, 0, 0])


def test_an_orientation_is_required(write) -> None:
    picks = pp.read_picks(write(GOOD_ROW, "{name: turned, xyz: [0, 0, 1], rpy: [0, 0, 0]}", shared="margin: 0"))
    assert [pick.name for pick in picks] == ["turned"]
    assert "states no orientation" in picks.problems[0].reason


@pytest.mark.parametrize(
    ("shared", "where", "reason"),
    [
        ("margin: -0.001", "key margin", "at least 0, not -0.001"),
        ("margin: .nan", "key margin", "nan"),
        ("margin: wide", "key margin", "'wide' is not a number"),
        ("margin: ", "key margin", "None is not a number"),
        ("tip: {xyz: [0, 0, .nan]}", "line 1, column 7, key tip.xyz", "xyz holds nan"),
        ("tip: {xyz: [0, 0]}", "line 1, column 7, key tip.xyz", "xyz must have 3 numbers, not 2"),
        ("tip: {z: 0.1}", "line 1, column 7, key tip.z", "unknown key 'z'"),
        ("tip: 0.1", "key tip", "not a mapping"),
        ("home: [0, 0]", "key home", "not a mapping of joint names"),
        ("home: {a: up}", "line 1, column 8, key home.a", "'up' is not a number"),
        ("home: {a: .inf}", "line 1, column 8, key home.a", "a must be a finite number"),
        ("defaults: {rpy: [pi, 0]}", "line 1, column 12, key defaults.rpy", "rpy must have 3 numbers, not 2"),
        ("defaults: {rpy: [0, 0, 0], quat_xyzw: [0, 0, 0, 1]}", "key defaults", "rpy or quat_xyzw, not both"),
        ("defaults: {approach: -1}", "line 1, column 12, key defaults.approach", "at least 0"),
        ("defaults: {name: x}", "line 1, column 12, key defaults.name", "unknown key 'name'"),
        ("defaults: [1]", "key defaults", "not a mapping"),
        ("robot: 5", "key robot", "5, which is not a name"),
        ("scene: [a]", "key scene", "is not a name"),
        ("cup: ", "key cup", "holds None, not a mapping"),
        ("cup: {radius: 0.01}\nheld: {a: {open: 0, grip: 1}}", "", "a cup and fingers"),
        ("conveyor: {speed: 0.1, parts: 5}", "key conveyor.parts", "parts is 5"),
        ("conveyor: {speed: 0.1, parts: [a, a]}", "key conveyor.parts", "names an obstacle twice"),
        ("tool: {name: x}", "key tool", "not a list"),
        ("tool: [{name: x, box: [1, 1]}]", "line 1, column 18, key tool['x'].box", "box must have 3 numbers, not 2"),
        ("tool: [{name: x, box: [1, 1, 1]}, {name: x, box: [2, 2, 2]}]",
         "line 1, column 35, key tool['x']", "a second body is named 'x'"),
        ("scen: scene.yaml", "line 1, column 1, key scen", "unknown key 'scen'; valid: scene"),
        ("picks: []", "line 2", "duplicate key 'picks'"),
        ("robot: [", "line", "is not valid YAML"),
        ("robot: ur5\nframes: {a: [0, 0, 1}", "line 2", "is not valid YAML"),
        ("tip: {xyz: [0, 0, 105]}", "key tip", "105 mm = 0.105 m"),
        ("defaults: {spin: {range: [0, 360]}}", "key defaults.spin", "360 degrees = 6.28319 rad"),
        ("defaults: {spin: fre}", "key defaults.spin", "write spin: free"),
        ("margin: 2mm", "key margin", "'2mm' is not a number"),
        ("margin: 2mm", "key margin", "-pi/2"),
        ("held: {finger: {grip: 0.04}}", "key held.finger", "finger does not state open"),
        ("grip_limits: {width: 1}", "key grip_limits.width", "unknown key"),
        ("grip_limits: {area: -1}", "key grip_limits.area", "at least 0"),
        ("grip_limits: {compliance: 0}", "key grip_limits.compliance", "above 0"),
        *((f"optimise: {wrong}", "key optimise", "must be an integer") for wrong in ("-1", "1.5", "much", "true")),
        *((f"straight: {wrong}", "key straight", "straight") for wrong in ("0", "-0.5", "1.5")),
        ("straight: half", "key straight", "'half'"),
        ("srdf: none.srdf", "line 1, column 1, key srdf", "there is no file "),
        ("limits: none.yaml", "line 1, column 1, key limits", "there is no file "),
        ("limits: 5", "line 1, column 1, key limits", "5, which is not a name"),
        ("package_dirs: [nowhere]", "key package_dirs", "there is no folder "),
        ("package_dirs: 5", "line 1, column 1, key package_dirs", "not a name"),
        ("xacro_args: {a: 1}", "line 1, column 1, key xacro_args", "ends in .xacro"),
        ("xacro_args: [a]", "line 1, column 1, key xacro_args", "not a mapping"),
        # In a mapping, the line is that of its own key
        ("defaults:\n  rpy: [pi, 0, 0]\n  approach: -1", "line 3, column 3, key defaults.approach", ""),
        ("defaults:\n  rpy: [pi, 0, 0]\n  place:\n    xyz: [0, 0]", "line 4, column 5, key defaults.place.xyz", ""),
        (f"fingers:\n  opening: 0.1\n  grip: 0.2\n  bodies: [{PAD}, {{name: b, box: [1, 1, 1]}}]",
         "line 3, column 3, key fingers.grip", ""),
        (f"fingers:\n  opening: 0.1\n  grip: 0.01\n  bodies:\n  - {PAD}\n  - {{name: b, ball: 1}}",
         "line 6, column 15, key fingers.bodies['b'].ball", ""),
        ("grip_limits:\n  gap: 0.001\n  compliance: 0", "line 3, column 3, key grip_limits.compliance", ""),
        ("cup:\n  radius: 0.01\n  tilt: 2", "line 3, column 3, key cup.tilt", ""),
        ("frames:\n  tray:\n    xyz: [1, 2]", "line 3, column 5, key frames.tray.xyz", ""),
        ("robots:\n  a:\n    base: {}\n    cup:\n      radius: -1", "line 5, column 7, key robots.a.cup.radius", ""),
    ],
)  # fmt: skip
def test_invalid_shared_settings_are_refused_with_line_and_key(write, shared: str, where: str, reason: str) -> None:
    with pytest.raises(PicksError) as caught:
        pp.read_picks(write(GOOD_ROW, shared=shared))
    assert where in caught.value.place
    assert reason in caught.value.reason
    assert str(caught.value.path).endswith("picks.yaml")
    place = caught.value.place
    assert "\n  " not in shared or place == where  # the complete place


def test_a_list_without_picks_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "picks.yaml"
    with pytest.raises(FileError, match="cannot be read"):
        pp.read_picks(path)
    for text in ("robot: ur5\n", "picks: []\n", "picks:\n", ""):
        path.write_text(text)
        with pytest.raises(PicksError):
            pp.read_picks(path)


def test_a_robot_file_is_relative_to_the_picks_file(write) -> None:
    for stated, read in (
        ("ur5", "ur5"), ("arm.urdf", "{}/arm.urdf"), ("../arms/arm.urdf", "{}/../arms/arm.urdf"), ("urr5", "urr5"),
    ):  # fmt: skip
        path = write(GOOD_ROW, shared=f"robot: {stated}\ndefaults: {{rpy: [pi, 0, 0]}}")
        assert pp.read_picks(path).robot == read.format(path.parent)
    with pytest.raises(UnknownNameError, match=r"unknown robot 'urr5'.*valid: ur5"):
        pp.load_robot("urr5")


def test_home_goes_by_joint_name() -> None:
    picks = pp.Picks((), home={"b": 2.0, "a": 1.0})
    assert picks.home_configuration(["a", "b"], np.zeros(2)) == [1.0, 2.0]
    with pytest.raises(InputError, match="lacks c"):
        picks.home_configuration(["a", "b", "c"], np.zeros(3))
    with pytest.raises(InputError, match="names b"):
        picks.home_configuration(["a"], np.zeros(1))
    assert pp.Picks(()).home_configuration(["a"], np.array([0.5])) == [0.5]


def test_picks_are_kept_when_given_by_a_generator() -> None:
    picks = pp.Picks(pp.Pick(name, pp.pose()) for name in "ab")
    assert [pick.name for pick in picks] == ["a", "b"]
    with pytest.raises(InputError, match=r"repeated: a$"):
        pp.Picks(pp.Pick("a", pp.pose()) for _ in range(2))


def test_approach_and_retreat_are_measured_from_the_grasp() -> None:
    pick = pp.Pick("a", pp.pose((1, 2, 3), (np.pi / 2, 0, 0)), approach=0.2, retreat=0.3, retreat_direction=(0, 0, 9))
    np.testing.assert_allclose(pick.before(pick.pose).translation, [1, 2.2, 3], atol=1e-15)  # its z is -y of the root
    np.testing.assert_allclose(pick.after(pick.pose).translation, [1, 2, 3.3], atol=1e-15)
    for pose in (pick.before(pick.pose), pick.after(pick.pose)):
        np.testing.assert_array_equal(pose.rotation, pick.pose.rotation)


def test_yaml_json_and_csv_state_the_same_picks(tmp_path: Path) -> None:
    one = {"name": "a", "xyz": [0.4, 0.1, 0.2], "rpy": [0, 0, 1], "frame": "tray", "spin": "free", "object": "bolt"}
    two = {"name": "b", "xyz": [0.4, 0.2, 0.2], "rpy": [0, 0, 0], "approach_direction": [0, 1, 0], "object": "nut"}
    two["place"] = {"xyz": [0, 0.3, 0.1], "rpy": [0, 0, 0], "frame": "tray", "approach": 0.05}
    (tmp_path / "picks.json").write_text(json.dumps({"picks": [one, two]}))
    (tmp_path / "picks.yaml").write_text(yaml.safe_dump({"picks": [one, two]}))
    (tmp_path / "picks.csv").write_text(
        "name,x,y,z,roll,pitch,yaw,frame,spin,object,approach_x,approach_y,approach_z,"
        "place_x,place_y,place_z,place_roll,place_pitch,place_yaw,place_frame,place_approach\n"
        "a,0.4,0.1,0.2,0,0,1,tray,free,bolt,,,,,,,,,,,\n"
        "b,0.4,0.2,0.2,0,0,0,,,nut,0,1,0,0,0.3,0.1,0,0,0,tray,0.05\n"
    )
    read = [pp.read_picks(tmp_path / f"picks.{kind}") for kind in ("yaml", "json", "csv")]
    assert [picks.problems for picks in read] == [()] * 3
    assert [pick.name for pick in read[0]] == ["a", "b"]
    assert len({digest(picks.picks) for picks in read}) == 1


def test_a_pattern_makes_many_picks_each_with_its_own_object(write) -> None:
    grid = "pattern: {grid: {counts: [2, 3, 1], step: [0.1, 0.05, 0]}}"
    picks = pp.read_picks(write(f"{{name: bolt, xyz: [0.4, 0.1, 0.2], object: 'bolt_{{i}}_{{j}}', {grid}}}"))
    assert picks.problems == ()
    assert [pick.name for pick in picks] == [f"bolt[{i},{j}]" for i in range(2) for j in range(3)]
    assert picks.picks[5].carried == "bolt_1_2"
    np.testing.assert_allclose(picks.picks[5].pose.translation, [0.5, 0.2, 0.2], atol=1e-15)


def test_hand_and_frames_are_read(write) -> None:
    jaw = "box: [0.02, 0.01, 0.06]"
    shared = f"""
held: {{panda_finger_joint1: 0.04}}
gripper: [panda_leftfinger]
fingers: {{opening: 0.08, grip: 0.02, bodies: [{{name: l, {jaw}}}, {{name: r, {jaw}}}]}}
frames: {{tray: {{xyz: [0.4, 0, 0], frame: table}}}}
defaults: {{rpy: [pi, 0, 0]}}"""
    row = "{name: a, frame: tray, xyz: [0, 0, 0], object: {box: [0.02, 0.02, 0.02]}, tolerance: {tilt: 0.1}}"
    picks = pp.read_picks(write(row, shared=shared))
    assert picks.problems == ()
    assert (dict(picks.held), picks.gripper) == ({"panda_finger_joint1": 0.04}, ("panda_leftfinger",))
    assert [float(body.pose.translation[1]) for body in picks.open_tool] == [0.04, -0.04]
    assert picks.frames["tray"].frame == "table"
    (pick,) = picks
    assert pick.carried.shape == pp.Box(0.02, 0.02, 0.02)
    assert pick.tolerance.tilt == 0.1

    row = "{name: a, xyz: [0, 0, 0], rpy: [0, 0, 0]}"
    picks = pp.read_picks(write(row, shared="held: {finger: {open: 0.04, grip: 0.02}, rail: 0.5}"))
    assert (dict(picks.held), dict(picks.grip)) == ({"finger": 0.04, "rail": 0.5}, {"finger": 0.02})
    picks = pp.read_picks(write(row, shared="grip_limits: {area: 1.0e-5, angle: pi/6, tip: 0.01}"))
    assert picks.grip_limits == pp.picks.GripLimits(area=1e-5, angle=np.pi / 6, tip=0.01)
    assert pp.read_picks(write(row)).grip_limits == pp.picks.GripLimits()


def test_the_file_states_how_far_motions_are_optimised(write) -> None:
    row = "{name: a, xyz: [0.4, 0.1, 0.3], rpy: [pi, 0, 0], approach: 0.05}"
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    durations = {}
    for stated in (None, 0, 200):
        picks = pp.read_picks(write(row, shared="" if stated is None else f"optimise: {stated}"))
        assert picks.optimise == stated
        setup = PickSetup.make(arm, pp.Scene(), picks, home=arm.home, rng=0)
        assert setup.budget.motion == (100 if stated is None else stated)
        durations[stated] = setup.judge(0, picks.picks[0]).trajectory.duration
    assert durations[200] <= durations[None] < durations[0]


def test_a_tool_as_an_stl_file_is_grey_and_one_that_can_state_colours_keeps_them(tmp_path):
    for suffix in ("stl", "ply"):
        trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / f"body.{suffix}")
    file = tmp_path / "picks.yaml"
    file.write_text(
        "tool: [{name: a, mesh: {path: body.stl}}, {name: b, mesh: {path: body.ply}}]\n"
        "picks: [{name: one, xyz: [0.4, 0, 0.2]}]\n"
    )
    from_stl, from_ply = pp.read_picks(file).tool
    assert from_stl.rgba is not None
    assert from_ply.rgba is None


def test_a_robot_of_a_cell_states_arguments_for_the_xacro_file_of_all(write):
    robots = "robot: arm.xacro\nrobots: {left: {base: {xyz: [0, 0, 0]}, xacro_args: {length: 1}}}"
    settings = pp.read_picks(write("{name: a, xyz: [0, 0, 1], rpy: [0, 0, 0]}", shared=robots)).robots["left"].settings
    assert settings.xacro_args == {"length": "1"}
    with pytest.raises(PicksError, match=r"ends in \.xacro"):
        pp.read_picks(write(GOOD_ROW, shared=robots.replace("arm.xacro", "ur5")))


# -- the files of an own robot ----------------------------------------------------------------------------------------

LIMITS = "joint_limits:\n  joint_1: {has_velocity_limits: true, max_velocity: 0.25}\n"
XACRO = """<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.3"/>
  <xacro:include filename="$(find pkg)/link.xacro"/>
  <link name="a"/><link name="b"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="end" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="$(arg length) 0 0"/></joint>
</robot>"""


def picks_file(folder: Path, *lines: str) -> Path:
    path = folder / "picks.yaml"
    path.write_text("\n".join([*lines, "picks: [{name: p, xyz: [0.4, 0, 0.2], rpy: [pi, 0, 0]}]"]))
    return path


def test_the_files_of_the_robot_are_relative_to_the_picks_file(tmp_path):
    shutil.copy(robots_folder() / "generic_6dof" / "dh.yaml", tmp_path / "arm.yaml")
    (tmp_path / "limits.yaml").write_text(LIMITS)
    (tmp_path / "arm.srdf").write_text(
        '<robot name="x"><group_state name="up" group="g"><joint name="joint_1" value="0.5"/></group_state></robot>'
    )
    picks = pp.read_picks(picks_file(tmp_path, "robot: arm.yaml", "srdf: arm.srdf", "limits: limits.yaml"))
    arm = picks.load_arm()
    assert arm.limits.velocity[0] == 0.25
    assert arm.robot.state("up") == {"joint_1": 0.5}
    assert arm.robot.urdf.path == tmp_path / "arm.yaml"


@pytest.mark.slow
def test_xacro_arguments_and_package_folders_are_read(tmp_path):
    pytest.importorskip("xacro")
    (tmp_path / "ros" / "pkg").mkdir(parents=True)
    (tmp_path / "ros" / "pkg" / "link.xacro").write_text('<robot><link name="tip"/></robot>')
    (tmp_path / "arm.urdf.xacro").write_text(XACRO)
    stated = ("robot: arm.urdf.xacro", "package_dirs: [ros]", "xacro_args: {length: 0.75}")
    arm = pp.read_picks(picks_file(tmp_path, *stated)).load_arm()
    np.testing.assert_allclose(arm.forward_kinematics([0.0]).translation, [0.75, 0, 0], atol=1e-15)
    path = picks_file(tmp_path, *stated[:2], "xacro_args: {length: 0.75, lenght: 0.75}")
    with pytest.raises(PicksError, match=r"'lenght'.*length") as caught:
        pp.read_picks(path).load_arm()
    assert (caught.value.path, caught.value.place) == (str(path), "line 3, column 28, key xacro_args, lenght")


@pytest.mark.parametrize(
    ("lines", "place", "reason"),
    [
        (["robot: ur55"], "line 1, column 1, key robot", "'ur55'.*valid: ur5"),
        (["robot: ur5", "tcp: tol0"], "line 2, column 1, key tcp", "'tol0'.*valid: tool0"),
        (["robot: ur5", "held: {finger: 0.1}"], "line 2, column 8, key held, finger", "'finger'"),
    ],
)
def test_a_name_that_the_robot_lacks_is_refused_with_its_position(tmp_path, lines, place, reason):
    path = picks_file(tmp_path, *lines)
    with pytest.raises(PicksError, match=reason) as caught:
        pp.read_picks(path).load_arm()
    assert (caught.value.path, caught.value.place) == (str(path), place)


def test_a_limits_file_with_an_unknown_joint_is_refused_with_its_line(tmp_path):
    limits = tmp_path / "limits.yaml"
    limits.write_text(LIMITS.replace("joint_1", "joint_9"))
    picks = pp.read_picks(picks_file(tmp_path, "robot: generic_6dof", "limits: limits.yaml"))
    with pytest.raises(FileError, match=r"'joint_9'; valid: .*joint_1") as caught:
        picks.load_arm()
    assert (caught.value.path, caught.value.place) == (str(limits), "line 2, column 3, joint joint_9")


# -- cells in which the robot is placed -------------------------------------------------------------------------------


def test_a_transformed_scene_keeps_the_obstacles_relative_to_each_other(cells):
    scene, _ = cells["generic_6dof"]
    place = pp.pose((0.3, -0.2, 0.1), (0.1, 0.2, 0.3))
    moved = scene.transformed(place)
    assert moved.names == scene.names
    assert moved.allowed == scene.allowed
    for a, b in zip(scene.obstacles, moved.obstacles, strict=True):
        assert b.pose.isApprox(place * a.pose, 1e-12)
        assert b.shape == a.shape


def test_transformed_picks_follow_their_cell():
    place = pp.pose((0.3, -0.2, 0.1), (0.1, 0.2, 0.3))
    target = PlaceTarget(pp.pose((0, 0.5, 0)))
    pick = pp.Pick("p", pp.pose((0.4, 0, 0.2)), carried="part", place=target)
    framed = pp.Pick("f", pp.pose((0.4, 0, 0.2)), frame="tray")
    picks = pp.Picks((pick, framed), frames={"tray": NamedFrame(pp.pose((1, 0, 0))), "in": NamedFrame(place, "tray")})
    moved = picks.transformed(place)
    assert moved.picks[0].pose.isApprox(place * pick.pose, 1e-12)
    np.testing.assert_allclose(moved.picks[0].retreat_direction, place.rotation[:, 2], atol=1e-15)
    assert moved.picks[0].approach_direction == (0.0, 0.0, 1.0)  # in the frame of the tip
    assert moved.picks[0].place.pose.isApprox(place * target.pose, 1e-12)
    np.testing.assert_allclose(moved.picks[0].place.approach_direction, -place.rotation[:, 2], atol=1e-15)
    assert moved.picks[1].pose.isApprox(framed.pose, 1e-15)
    assert moved.frames["tray"].pose.isApprox(place * pp.pose((1, 0, 0)), 1e-12)
    assert moved.frames["in"].pose.isApprox(place, 1e-15)


def test_a_table_of_picks_is_transformed_row_by_row(tmp_path):
    table = tmp_path / "many.csv"
    table.write_text("name,x,y,z,roll,pitch,yaw\n" + "".join(f"p{i},0.{i},0,0.2,pi,0,0\n" for i in range(1, 5)))
    place = pp.pose((0, 0, 1))
    source = open_picks(table)
    moved = source.transformed(place)
    assert len(moved) == 4
    assert moved.digest() != source.digest()
    heights = [pick.pose.translation[2] for pick in moved.load()]
    np.testing.assert_allclose(heights, 1.2)


def test_a_cell_and_a_robot_that_move_together_give_the_same_verdicts(arms, cells):
    arm, (scene, picks) = arms["generic_6dof"], cells["generic_6dof"]
    world_from_root = pp.pose((0.5, -0.3, 0.2), (0, 0, 0.7))
    cell, stated = scene.transformed(world_from_root), picks.transformed(world_from_root)
    back = world_from_root.inverse()
    settings = {"tip": picks.tip, "tool": picks.tool, "margin": picks.margin}
    first = pp.validate_picks(arm, scene, pp.Picks(picks.picks[:2], **settings))
    restored = pp.Picks(stated.transformed(back).picks[:2], **settings)
    again = pp.validate_picks(arm, cell.transformed(back), restored)
    assert [v.ok for v in first.verdicts] == [v.ok for v in again.verdicts]
