"""Taking arms from robots: tcp, base, limits, and the catalogue."""

from __future__ import annotations

import json
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.errors import ConversionError, DhTableError
from pinproof.model import kinematic_class, load_robot

LIMIT = '<limit lower="-2" upper="2" velocity="1" effort="1"/>'


def two_tips(kinds=("revolute", "fixed", "fixed")):
    ends = [("base", "arm"), ("arm", "left"), ("arm", "right")]
    joints = "".join(
        f'<link name="{child}"/><joint name="{child}_joint" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/>{LIMIT}</joint>'
        for (parent, child), kind in zip(ends, kinds, strict=False)
    )
    return load_robot(f'<robot name="two"><link name="base"/>{joints}</robot>')


def test_tcp_is_the_only_leaf_on_a_fixed_joint():
    assert two_tips(("revolute", "fixed")).arm().tcp == "left"


def test_frames_of_a_dh_table_are_not_tools(tmp_path):
    pp.write_urdf(pp.DhTable.load(robots_folder() / "generic_6dof" / "dh.yaml"), tmp_path / "r.urdf")
    assert pp.load_robot(tmp_path / "r.urdf").arm().tcp == "tool0"


@pytest.mark.parametrize(
    ("kinds", "ends", "named"),
    [
        (("revolute", "fixed", "fixed"), {}, r"tcp=.*left"),  # a tcp is never guessed
        (("revolute", "revolute"), {}, r"tcp=.*left"),
        (("revolute", "fixed", "fixed"), {"tcp": "left", "base": "arm"}, "no joint moves"),
        (("revolute", "fixed", "fixed"), {"tcp": "left", "base": "right"}, "is not on the path"),
        (("floating", "revolute"), {"tcp": "left"}, "floating"),
    ],
)
def test_ends_of_no_arm_are_refused(kinds, ends, named):
    with pytest.raises(pp.InputError, match=named):
        two_tips(kinds).arm(**ends)


def test_base_that_the_arm_itself_moves_through_a_mimic_joint_is_refused():
    text = (
        '<robot name="r"><link name="root"/><link name="base"/><link name="tip"/>'
        f'<joint name="b" type="revolute"><parent link="root"/><child link="base"/>{LIMIT}<mimic joint="t"/></joint>'
        f'<joint name="t" type="revolute"><parent link="base"/><child link="tip"/>{LIMIT}</joint></robot>'
    )
    with pytest.raises(pp.InputError, match="mimic"):
        load_robot(text).arm(tcp="tip", base="base")


def test_limits_can_be_tightened_by_name_and_replaced():
    robot = pp.load_robot("ur5")
    tight = robot.arm(limits={"elbow_joint": (0.0, 3.0)})
    assert tight.limits.lower[2] == 0.0
    assert tight.limits.lower[1] == robot.arm().limits.lower[1]
    assert robot.arm(limits=tight.limits).limits.upper[2] == 3.0
    with pytest.raises(pp.UnknownNameError, match="elbow_joint"):
        robot.arm(limits={"elbow": (0.0, 1.0)})
    with pytest.raises(pp.InputError, match=r"at most limits\.upper"):
        robot.arm(limits={"elbow_joint": (1.0, 0.0)})
    for wrong in (3.0, ("a", "b"), (0.0, 1.0, 2.0), "12", {-1.0: 0, 2.0: 0}, {1.0, 2.0}):
        with pytest.raises(pp.InputError, match=r"elbow_joint.*\(lower, upper\)"):
            robot.arm(limits={"elbow_joint": wrong})
    with pytest.raises(pp.InputError, match="limits must be of type"):
        robot.arm(limits=[(-1.0, 1.0)] * 6)
    with pytest.raises(pp.InputError, match="6"):
        robot.arm(limits=pp.JointLimits(np.zeros(2), np.ones(2), np.ones(2)))


def test_panda_joint_6_keeps_its_limits():
    limits = pp.load_robot("panda").arm().limits
    assert limits.lower[5] == pytest.approx(-0.0175)
    assert limits.upper[5] == pytest.approx(3.7525)


def test_panda_arm_is_a_chain_without_its_fingers():
    assert pp.load_robot("panda").arm().dof == 7


@pytest.mark.parametrize(
    ("source", "settings", "error", "named"),
    [
        ("ur55", {}, pp.UnknownNameError, "valid: ur5"),
        (Path("robot.sdf"), {}, pp.errors.UrdfError, "ends in"),
        (Path(), {}, pp.errors.UrdfError, "is a folder"),
        ("ur5", {"package_dirs": Path()}, pp.InputError, "package_dirs must be a list"),
        ("ur5", {"package_dirs": "."}, pp.InputError, "package_dirs must be a list"),
        ("ur5", {"package_dirs": [Path("pakages")]}, pp.FileError, "pakages: is not a folder"),
    ],
)
def test_what_is_no_robot_or_no_folder_of_packages_is_refused(source, settings, error, named):
    with pytest.raises(error, match=named):
        pp.load_robot(source, **settings)


# Loading robots from DH tables, and saving their URDF.


GENERIC = robots_folder() / "generic_6dof"


@pytest.mark.parametrize("suffix", [".yaml", ".csv"])
def test_a_dh_table_file_is_a_robot(suffix, tmp_path):
    table = pp.DhTable.load(GENERIC / "dh.yaml")
    table = pp.DhTable(table.rows, convention=table.convention, name="mine")  # a CSV file holds no tool
    path = tmp_path / f"mine{suffix}"
    table.save(path)
    robot = pp.load_robot(path)
    arm = robot.arm()
    assert (robot.name, robot.urdf.path, arm.tcp, arm.joint_names) == ("mine", path, "tool0", table.joint_names)
    for q in np.random.default_rng(0).uniform(table.lower, table.upper, (20, len(table))):
        np.testing.assert_allclose(arm.forward_kinematics(q).homogeneous, table.forward_kinematics(q), atol=1e-12)
    assert robot.urdf.collisions


def test_a_table_in_memory_is_a_robot_and_survives_pickling():
    table = pp.DhTable([pp.DhRow("j1", 0, 0.3, 0, np.pi / 2), pp.DhRow("j2", 0, 0, 0.4, 0)], convention="standard")
    robot = pickle.loads(pickle.dumps(pp.load_robot(table)))
    assert robot.urdf.path is None
    q = [0.3, -0.7]
    np.testing.assert_allclose(
        robot.arm().forward_kinematics(q).homogeneous, table.forward_kinematics(q), rtol=0, atol=1e-12
    )


def test_an_srdf_applies_to_a_table(tmp_path):
    (tmp_path / "arm.srdf").write_text(
        '<robot name="x"><group_state name="up" group="arm">'
        + "".join(f'<joint name="joint_{i}" value="0.{i}"/>' for i in range(1, 7))
        + "</group_state></robot>"
    )
    arm = pp.load_robot(GENERIC / "dh.yaml", srdf=tmp_path / "arm.srdf").arm()
    np.testing.assert_allclose(arm.state("up"), [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


def test_a_bad_table_names_its_row(tmp_path):
    (tmp_path / "t.csv").write_text("# convention: standard\nname,theta,d,a,alpha\nj1,0,zero,0,0\n")
    with pytest.raises(DhTableError, match=r"t\.csv: line 3, row 1.*column d"):
        pp.load_robot(tmp_path / "t.csv")


def test_a_table_whose_urdf_differs_is_refused(monkeypatch):
    from pinproof.description import urdf_of_table

    def tampered(table):
        return urdf_of_table(table).replace('xyz="0.3 0.0 0.0"', 'xyz="0.31 0.0 0.0"')

    monkeypatch.setattr("pinproof.model.dh_tables.urdf_of_table", tampered)
    with pytest.raises(ConversionError, match="off by"):
        pp.load_robot(GENERIC / "dh.yaml")


def test_xacro_arguments_for_a_table_are_refused():
    with pytest.raises(pp.InputError, match=r"\.xacro files only"):
        pp.load_robot(GENERIC / "dh.yaml", xacro_args={"a": "1"})


def test_a_saved_urdf_finds_its_meshes_from_another_folder(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    mesh = next(g.mesh.path for g in pp.load_robot("ur5").urdf.collisions if g.mesh is not None)
    shutil.copy(mesh, source / f"part{mesh.suffix}")
    (source / "r.urdf").write_text(
        f'<robot name="r"><link name="a"><collision><geometry><mesh filename="part{mesh.suffix}"/></geometry>'
        "</collision></link></robot>"
    )
    (tmp_path / "target").mkdir()
    pp.load_robot(source / "r.urdf").save_urdf(tmp_path / "target" / "r.urdf")
    (found,) = pp.load_robot(tmp_path / "target" / "r.urdf").urdf.collisions
    assert found.mesh.path == source / f"part{mesh.suffix}"


def test_a_saved_urdf_keeps_uris_that_are_still_found(tmp_path):
    robot = pp.load_robot("ur5")
    robot.save_urdf(tmp_path / "ur5.urdf")
    again = pp.load_robot(tmp_path / "ur5.urdf")
    assert next(g.mesh for g in again.urdf.visuals if g.mesh).uri.startswith("package://")
    assert [g.mesh and (g.mesh.uri, g.mesh.path) for g in again.urdf.collisions] == [
        g.mesh and (g.mesh.uri, g.mesh.path) for g in robot.urdf.collisions
    ]


def test_the_text_of_a_urdf_is_a_robot(tmp_path):
    file = pp.load_robot("ur5").urdf.path
    for text in (file.read_text(), "\ufeff" + file.read_text(), "\n" + file.read_text().partition("?>")[2]):
        robot = pp.load_robot(text, srdf=None, package_dirs=[file.parents[3]])
        arm, same = robot.arm(tcp="tool0"), pp.load_robot(file).arm(tcp="tool0")
        assert arm.forward_kinematics(same.home).isApprox(same.forward_kinematics(same.home), 1e-12)
        assert len(pp.CollisionChecker(arm).bodies) == len(pp.CollisionChecker(same).bodies)
    assert pickle.loads(pickle.dumps(robot.arm(tcp="tool0"))).joint_names == same.joint_names


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco/>", "root element is <mujoco>"),
        ("<robot", "line 1.*well-formed"),
        ("\n\n<robot", "line 3.*well-formed"),
        ('<?xml version="1.0"?>\n<robot name="r"/>', "no links"),
        ("<ur5.urdf", "well-formed"),
    ],
)
def test_text_that_is_no_urdf_is_refused_with_its_line(text, message):
    with pytest.raises(pp.errors.UrdfError, match=message):
        pp.load_robot(text)
    with pytest.raises(pp.InputError, match="xacro_args"):
        pp.load_robot(text, xacro_args={"a": "b"})


# The description of a robot is complete, has plain values, and lists what is missing.


@pytest.fixture(scope="module")
def zoo(zoo_text):
    robot = load_robot(zoo_text)
    return robot.info(robot.arm("tool", held={"finger": 0.02}))


def test_joints_have_their_roles(zoo):
    roles = {joint.name: joint.role for joint in zoo.joints}
    assert roles == {
        "slide": "arm", "turn": "arm", "lift": "arm", "lift_follower": "follower", "wrist": "arm",
        "tool_joint": "fixed", "rod": "follower", "finger": "held", "thumb": "held",
    }  # fmt: skip
    joints = {joint.name: joint for joint in zoo.joints}
    assert (joints["finger"].held_at, joints["thumb"].held_at) == (0.02, 0.02)
    assert joints["lift_follower"].mimic == "-0.5 * lift + 0.3"
    assert joints["turn"].lower is None


def test_limits_are_those_in_use():
    robot = pp.load_robot("ur5")
    info = robot.info(robot.arm(limits={"elbow_joint": (-1, 1)}))
    (elbow,) = [joint for joint in info.joints if joint.name == "elbow_joint"]
    assert (elbow.lower, elbow.upper, elbow.velocity, elbow.acceleration) == (-1, 1, 3.15, 6.3)


def test_dictionary_is_json_without_nan(zoo):
    for info in (zoo, pp.load_robot("baxter_left").info()):
        words = json.loads(json.dumps(info.to_dict(), allow_nan=False))
        assert words["dof"] == info.dof
        assert [joint["name"] for joint in words["joints"]] == [joint.name for joint in info.joints]
        assert len(words["disabled_pairs"]) == len(info.disabled_pairs)


def test_geometries_and_pairs_are_counted():
    robot = pp.load_robot("panda")
    info = robot.info(robot.arm())
    assert sum(info.collisions.values()) == len(robot.urdf.collisions) == 17
    assert len(info.disabled_pairs) == len(robot.srdf.disabled) == 35
    assert (info.groups, info.states) == (("arm", "hand", "arm_and_hand"), ("default",))


def test_missing_parts_are_named(zoo):
    missing = "\n".join(zoo.missing)
    for words in ("no SRDF", "no collision geometry", "no velocity limit: turn", "(continuous): turn", "no home"):
        assert words in missing
    assert any("no acceleration limits" in words for words in zoo.missing)


def test_links_with_visual_geometry_only_are_named():
    robot = pp.load_robot("z1")
    assert any("only visual: link01, link05" in note for note in robot.info(robot.arm()).missing)


@pytest.mark.parametrize("name", ["so100", "z1"])
def test_links_with_visual_geometry_only_are_checked_on_request(name, tmp_path):
    unchecked, checked = (pp.load_robot(name, visual_bodies=wanted) for wanted in (False, True))
    links = unchecked.urdf.visual_only
    assert links
    assert not checked.urdf.visual_only
    # a small box in the middle of a link that is only drawn
    arm = checked.arm()
    geometry = next(each for each in checked.urdf.visuals if each.link == links[-1])
    points = pp.description.read_mesh(geometry.mesh.path, geometry.size).vertices
    middle = geometry.origin[:3, :3] @ (points.min(axis=0) + points.max(axis=0)) / 2 + geometry.origin[:3, 3]
    place = arm.root_from_frame(arm.home, geometry.link).act(middle)
    scene = pp.Scene([pp.Obstacle("box", pp.Box(0.01, 0.01, 0.01), pp.pose(place))])
    pairs = [set(contact.bodies) for contact in pp.CollisionChecker(arm, scene).check(arm.home).contacts]
    assert {geometry.link, "box"} in pairs
    pairs = [set(c.bodies) for c in pp.CollisionChecker(unchecked.arm(), scene).check(arm.home).contacts]
    assert {geometry.link, "box"} not in pairs
    # the description that is written has these bodies as well
    written = tmp_path / "robot.urdf"
    written.write_text(checked.urdf.text_for(written))
    assert len(pp.load_robot(written).urdf.collisions) == len(checked.urdf.collisions)


def test_missing_meshes_are_named(tmp_path):
    file = tmp_path / "r.urdf"
    file.write_text(
        '<robot name="r"><link name="a"/><link name="b"><collision><geometry><mesh filename="package://p/gone.stl"/>'
        '</geometry></collision></link><joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
        '<limit lower="-1" upper="1"/></joint></robot>'
    )
    robot = pp.load_robot(file)
    assert robot.notes == ("1 collision mesh was not found: package://p/gone.stl",)
    assert robot.notes[0] in robot.info(robot.arm("b")).missing
    with pytest.raises(pp.errors.MeshError, match=r"the mesh of link 'b' was not found; .*contains 'p'.*; tried:\n"):
        pp.CollisionChecker(robot.arm("b"))


# The class of a chain: spherical wrists, parallel axes, prismatic joints, and near misses of these.


def arm(joints):
    """A chain of (type, origin xyz, axis) joints."""
    text = '<link name="l0"/>'
    for i, (kind, xyz, axis) in enumerate(joints, start=1):
        text += (
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{xyz}" rpy="0.1 0.2 0.3"/><axis xyz="{axis}"/><limit lower="-2" upper="2"/></joint>'
        )
    return load_robot(f'<robot name="r">{text}</robot>').arm(f"l{len(joints)}")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("ur5", "6 revolute joints (RRRRRR): three parallel axes (joints 2, 3, 4)"),
        ("kinova", "6 revolute joints (RRRRRR): spherical wrist (joints 4, 5, 6)"),
        ("xarm7", "7 revolute joints (RRRRRRR): spherical shoulder (joints 1, 2, 3); redundant by 1"),
        ("talos_left", "7 revolute joints (RRRRRRR): spherical wrist (joints 5, 6, 7); redundant by 1"),
    ],
)
def test_known_arms(name, text):
    assert kinematic_class(pp.load_robot(name).arm()) == text


def test_prismatic_joints_are_counted_beside_a_wrist():
    text = kinematic_class(pp.load_robot("stanford").arm())
    assert text == "5 revolute and 1 prismatic joints (RRPRRR): spherical wrist (joints 4, 5, 6)"


def test_all_axes_of_a_scara_are_parallel():
    assert "RRPR): all axes parallel; fewer than six joints" in kinematic_class(pp.load_robot("scara").arm())


@pytest.mark.parametrize(("offset", "found"), [(0.0, True), (1e-7, True), (1e-3, False)])
def test_an_offset_wrist_is_not_spherical(offset, found):
    wrist = [("revolute", "0 0 0", "0 0 1"), ("revolute", f"{offset} 0 0", "0 1 0"), ("revolute", "0 0 0", "0 0 1")]
    joints = [("revolute", "0.3 0.1 0.4", axis) for axis in ("0 0 1", "0 1 0", "1 0 0")] + wrist
    assert ("spherical wrist (joints 4, 5, 6)" in kinematic_class(arm(joints))) is found


@pytest.mark.parametrize(("lean", "found"), [(0.0, True), (4e-6, True), (1e-2, False)])
def test_tilted_axes_are_not_parallel(lean, found):
    joints = [("revolute", "0.3 0 0", "0 0 1")] * 4
    plain = '<origin xyz="0.3 0 0" rpy="0 0 0.3"/>'
    text = '<link name="l0"/>'
    for i, (kind, _, _) in enumerate(joints, start=1):
        origin = plain if i < 3 else plain.replace('rpy="0', f'rpy="{lean}')
        text += (
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'{origin}<axis xyz="0 0 1"/><limit lower="-2" upper="2"/></joint>'
        )
    chain = load_robot(f'<robot name="r">{text}</robot>').arm("l4")
    assert ("all axes parallel" in kinematic_class(chain)) is found


def test_a_general_chain_is_reported_as_such():
    joints = [("revolute", "0.3 0.1 0.4", axis) for axis in ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "1 0 0")]
    assert kinematic_class(arm(joints)).endswith("no three neighbouring axes intersect in a point or are parallel")


def test_mimic_joint_on_the_chain_is_named(zoo_text):
    zoo = load_robot(zoo_text).arm("tool")
    assert kinematic_class(zoo).endswith("coupled by mimic joints on the chain")


# Input that crashes the interpreter inside other libraries: a separate process must survive all of it.


CHILD = """
import json
import sys
import numpy as np
import pinproof as pp
from pinproof.model import load_robot
for text in json.load(sys.stdin):
    try:
        robot = load_robot(text)
        arm = robot.arm(robot.urdf.links[-1])
        assert np.isfinite(arm.forward_kinematics(arm.home).homogeneous).all()
        assert np.isfinite(arm.jacobian(arm.home)).all()
        robot.info(arm).to_dict()
        pp.CollisionChecker(arm).check(arm.home)
        print("works", flush=True)
    except pp.PinproofError as error:
        print("refused", flush=True)
"""


def chain(count, body="", fork=False):
    links = [f'<link name="l{i}">{body}</link>' for i in range(count + 1)]
    joints = [
        f'<joint name="j{i}" type="revolute"><parent link="l{0 if fork else i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0 0 0.01"/><axis xyz="0 {i % 2} {1 - i % 2}"/><limit lower="-1" upper="1"/></joint>'
        for i in range(count)
    ]
    return f'<robot name="r">{"".join(links)}{"".join(joints)}</robot>'


def shape(text):
    return f"<collision><geometry>{text}</geometry></collision>"


CASES = [
    (chain(200), "works"),
    (chain(900), "refused"),
    (chain(5000), "refused"),
    (chain(900, fork=True), "works"),
    (chain(1, shape('<sphere radius="1e-9"/>')), "refused"),
    (chain(1, shape('<box size="1e-8 1 1"/>')), "refused"),
    (chain(1).replace('xyz="0 0 1"', 'xyz="0 0 0"'), "refused"),
    (chain(2).replace('child link="l2"', 'child link="l1"'), "refused"),
    (chain(2).replace('child link="l2"', 'child link="l0"'), "refused"),
    (chain(2).replace('name="j1"', 'name="j0"'), "refused"),
    (chain(1).replace("l1", "é" * 50_000), "works"),
    ("<robot>" + "<link>" * 100_000, "refused"),
    ('<robot name="r">' + '<link name="' + "x" * 20_000_000 + '"/></robot>', "refused"),
]


@pytest.mark.slow
def test_interpreter_survives():
    texts = json.dumps([text for text, _ in CASES]).encode()
    done = subprocess.run([sys.executable, "-c", CHILD], input=texts, capture_output=True, check=False)
    assert done.stdout.decode().split() == [outcome for _, outcome in CASES], done.stderr.decode()[-2000:]
    assert done.returncode == 0
