"""DH table -> URDF: equal at every frame, refused where it is not, the same bytes each time."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from hypothesis import given
from hypothesis import strategies as st

from pinproof.description import DhRow, DhTable, urdf_of_table
from pinproof.description.xml_reader import rpy_of
from pinproof.errors import ConversionError, FileError, InputError
from pinproof.model import dh_to_urdf, load_robot, write_urdf
from pinproof.spatial import pose

from ..examples import examples

GENERIC = Path(__file__).parents[2] / "robots" / "generic_6dof"
HALF = math.pi / 2
QUARTERS = [0.0, math.pi / 2, -math.pi / 2, math.pi, math.pi / 2 + 1e-9, math.pi / 2 - 1e-6]

angles = st.one_of(st.sampled_from(QUARTERS), st.floats(-7, 7))
lengths = st.one_of(st.just(0.0), st.floats(-1, 1))
placements = st.builds(
    lambda xyz, rpy: pose(xyz, rpy), st.tuples(lengths, lengths, lengths), st.tuples(angles, angles, angles)
)


@st.composite
def tables(draw: st.DrawFn) -> DhTable:
    rows = []
    for i in range(draw(st.integers(1, 6))):
        kind = draw(st.sampled_from(["revolute", "revolute", "prismatic", "continuous"]))
        limits = sorted([draw(st.floats(-2, 2)), draw(st.floats(-2, 2))]) if kind != "continuous" else []
        rows.append(DhRow(f"j{i}", draw(angles), draw(lengths), draw(lengths), draw(angles), kind, *limits))
    convention = draw(st.sampled_from(["standard", "modified"]))
    return DhTable(rows, convention=convention, base=draw(placements), tool=draw(placements))


@pytest.fixture(scope="module")
def generic() -> DhTable:
    return DhTable.load(GENERIC / "dh.yaml")


def pinocchio_frames(urdf: str, q: np.ndarray) -> dict[str, np.ndarray]:
    """Every frame by Pinocchio alone, without pinproof.model; a continuous joint is a cosine and a sine there."""
    model = pin.buildModelFromXML(urdf)
    values = []
    for joint, value in zip(model.joints[1:], q, strict=True):
        values += [math.cos(value), math.sin(value)] if joint.nq == 2 else [value]
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array(values))
    return {frame.name: data.oMf[i].homogeneous.copy() for i, frame in enumerate(model.frames)}


@examples(60)
@given(table=tables(), seed=st.integers(0, 2**32 - 1))
def test_every_frame_equals_the_dh_product(table, seed):
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, len(table))
    found = pinocchio_frames(dh_to_urdf(table), q)
    for i, expected in enumerate(table.frames(q)):
        np.testing.assert_allclose(found[f"dh_{i}"], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["tool0"], table.forward_kinematics(q), rtol=0, atol=1e-12)


def test_another_reader_finds_the_same_robot(generic):
    """yourdfpy computes the same poses and reads the same limits from the URDF of a table."""
    q = np.random.default_rng(0).uniform(generic.lower, generic.upper)
    robot = yourdfpy.URDF.load(io.BytesIO(dh_to_urdf(generic).encode()), load_meshes=False)
    robot.update_cfg(q)
    assert tuple(robot.actuated_joint_names) == generic.joint_names
    np.testing.assert_allclose(robot.get_transform("tool0"), generic.forward_kinematics(q), rtol=0, atol=1e-12)
    limits = [robot.joint_map[name].limit for name in generic.joint_names]
    np.testing.assert_array_equal([limit.lower for limit in limits], generic.lower)
    np.testing.assert_array_equal([limit.upper for limit in limits], generic.upper)
    np.testing.assert_array_equal([limit.velocity for limit in limits], generic.velocity)


@given(roll=angles, pitch=angles, yaw=angles)
def test_rpy_reproduces_the_rotation_at_every_pitch(roll, pitch, yaw):
    rotation = pin.rpy.rpyToMatrix(roll, pitch, yaw)
    np.testing.assert_allclose(pin.rpy.rpyToMatrix(*rpy_of(rotation)), rotation, rtol=0, atol=4e-15)


def test_origins_with_a_pitch_of_90_degrees_are_exact():
    """A sweep through pitch = pi/2, where only the difference of roll and yaw is determined."""
    for off in (0.0, 1e-15, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 1e-4):
        for sign in (-1, 1):
            tool = pose((0, 0, 0), (0.3, sign * (math.pi / 2 - off), -1.1))
            table = DhTable([DhRow("j", 0.4, 0.1, 0.2, 0.7)], convention="standard", tool=tool)
            found = pinocchio_frames(dh_to_urdf(table), np.zeros(1))["tool0"]
            np.testing.assert_allclose(found, table.forward_kinematics([0.0]), rtol=0, atol=1e-14)


def test_the_generic_arm_has_the_textbook_position(generic):
    arm = load_robot("generic_6dof").arm(tcp="tool0")
    np.testing.assert_allclose(arm.forward_kinematics(np.zeros(6)).translation, [0.65, -0.30, 0.33], atol=1e-15)
    np.testing.assert_array_equal(arm.limits.lower, generic.lower)
    np.testing.assert_array_equal(arm.limits.upper, generic.upper)
    np.testing.assert_array_equal(arm.limits.velocity, generic.velocity)
    assert arm.joint_names == generic.joint_names


def test_standard_lengths_are_behind_their_joint_and_offsets_before_it():
    rows = [DhRow("j1", 0.3, 0.5, 0.2, 0.4), DhRow("j2", 0.6, 0.1, 0.7, 0.9)]
    model = pin.buildModelFromXML(dh_to_urdf(DhTable(rows, convention="standard")))
    first, second = model.jointPlacements[1:]
    np.testing.assert_allclose(first.homogeneous, pose(rpy=(0, 0, 0.3)).homogeneous, atol=1e-15)
    expected = pose((0.2, 0, 0.5), (0.4, 0, 0)) * pose(rpy=(0, 0, 0.6))
    np.testing.assert_allclose(second.homogeneous, expected.homogeneous, atol=1e-15)


def test_the_theta_of_a_prismatic_row_is_behind_its_joint():
    rows = [DhRow("j1", 0.3, 0.5, 0.2, 0.4, "prismatic", 0, 1), DhRow("j2", 0, 0, 0.1, 0)]
    model = pin.buildModelFromXML(dh_to_urdf(DhTable(rows, convention="standard")))
    np.testing.assert_array_equal(model.jointPlacements[1].homogeneous, np.eye(4))
    expected = pose(rpy=(0, 0, 0.3)) * pose((0.2, 0, 0.5), (0.4, 0, 0))
    np.testing.assert_allclose(model.jointPlacements[2].homogeneous, expected.homogeneous, atol=1e-15)


def test_modified_rows_have_a_and_alpha_of_the_preceding_joint():
    rows = [DhRow("j1", 0.3, 0.5, 0.2, 0.4), DhRow("j2", 0.6, 0.1, 0.7, 0.9)]
    model = pin.buildModelFromXML(dh_to_urdf(DhTable(rows, convention="modified")))
    columns = [pose(), pose((0, 0, rows[0].d))]  # what the row before leaves behind its joint
    for row, column, placement in zip(rows, columns, model.jointPlacements[1:], strict=True):
        expected = column * pose((row.a, 0, 0), (row.alpha, 0, 0)) * pose(rpy=(0, 0, row.theta))
        np.testing.assert_allclose(placement.homogeneous, expected.homogeneous, atol=1e-15)


def test_a_prismatic_modified_row_is_entirely_before_its_joint():
    rows = [DhRow("j1", 0.3, 0.5, 0.2, 0.4, "prismatic", 0, 1), DhRow("j2", 0, 0, 0, 0)]
    model = pin.buildModelFromXML(dh_to_urdf(DhTable(rows, convention="modified")))
    expected = pose((0.2, 0, 0), (0.4, 0, 0)) * pose((0, 0, 0.5), (0, 0, 0.3))
    np.testing.assert_allclose(model.jointPlacements[1].homogeneous, expected.homogeneous, atol=1e-15)
    np.testing.assert_allclose(model.jointPlacements[2].homogeneous, np.eye(4), atol=1e-15)


def test_joints_of_a_shoulder_are_at_one_point_in_both_conventions():
    """Where axes meet, so do the joints; only then may the links on both sides of a link without a body touch."""
    standard = [DhRow("j1", 0, 0.3, 0, -HALF), DhRow("j2", 0, 0, 0, HALF), DhRow("j3", 0, 0.4, 0, 0)]
    modified = [DhRow("j1", 0, 0.3, 0, 0), DhRow("j2", 0, 0, 0, -HALF), DhRow("j3", 0, 0.4, 0, HALF)]
    for rows, convention in ((standard, "standard"), (modified, "modified")):
        model = pin.buildModelFromXML(dh_to_urdf(DhTable(rows, convention=convention)))
        np.testing.assert_allclose(model.jointPlacements[2].translation, [0, 0, 0.3], atol=1e-15)
        np.testing.assert_allclose(model.jointPlacements[3].translation, 0, atol=1e-15)


def test_the_same_table_gives_the_same_bytes(generic, tmp_path):
    for name in ("a.urdf", "b.urdf"):
        write_urdf(generic, tmp_path / name)
    assert (tmp_path / "a.urdf").read_bytes() == (tmp_path / "b.urdf").read_bytes() == dh_to_urdf(generic).encode()


def test_names_outside_ascii_and_xml_signs_survive(tmp_path):
    table = DhTable([DhRow("Gelenk <ä> & 1", 0, 0.1, 0.2, 0)], convention="standard", name="Prüf--arm")
    write_urdf(table, tmp_path / "arm.urdf")
    robot = load_robot(tmp_path / "arm.urdf")
    assert (robot.name, robot.arm(tcp="tool0").joint_names) == (table.name, table.joint_names)


TAMPERED = {
    "a digit of a length": (r'xyz="0.3 0.0 0.0"', 'xyz="0.30000000001 0.0 0.0"', "frame dh_2 is off by 1e-11 m"),
    "a digit of an angle": (r'rpy="1.5707963267948966 0.0 0.0"', 'rpy="1.5707963 0.0 0.0"', "rad"),
    "a missing frame": (r'"dh_3"', '"dh_x"', "dh_3"),
    "the sense of an axis": (r'axis xyz="0.0 0.0 1.0"', 'axis xyz="0.0 0.0 -1.0"', "frame dh_1 is off"),
    "a limit": (r'upper="3.141592653589793"', 'upper="3.1415926"', "upper limits"),
    "a speed": (r'velocity="3.141592653589793"', 'velocity="3.1"', "velocity limits"),
    "a joint's name": (r'"joint_2"', '"joint_two"', "joint names"),
    "a joint's type": (r'"joint_6" type="revolute"', '"joint_6" type="prismatic"', "frame dh_6 is off"),
    "broken XML": (r"</robot>", "", "is not usable"),
}


@pytest.mark.parametrize("change", TAMPERED)
def test_a_urdf_that_is_not_its_table_is_refused_and_not_written(change, generic, tmp_path, monkeypatch):
    old, new, words = TAMPERED[change]

    def tampered(table):
        text = urdf_of_table(table)
        assert re.search(old, text), "the tampering must find its place"
        return re.sub(old, new, text)

    monkeypatch.setattr("pinproof.model.dh_tables.urdf_of_table", tampered)
    path = tmp_path / "arm.urdf"
    path.write_text("the content before", encoding="utf-8")
    with pytest.raises(ConversionError, match=words):
        write_urdf(generic, path)
    assert path.read_text(encoding="utf-8") == "the content before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "name", ["dh_0", "dh_1", "link_1", "base_link", "tool0", "tool_joint", "dh_1_joint", "universe"]
)
def test_a_row_may_not_have_the_name_of_a_frame(name):
    with pytest.raises(InputError, match=f"'{name}' has a name"):
        dh_to_urdf(DhTable([DhRow(name, 0, 0, 1, 0)], convention="standard"))


def test_a_table_too_long_for_a_urdf_is_refused_and_named():
    table = DhTable([DhRow(f"j{i}", 0, 0, 0.01, 0) for i in range(600)], convention="standard", name="snake")
    with pytest.raises(ConversionError, match=r"'snake' is not usable: .* links"):
        dh_to_urdf(table)


def test_a_missing_folder_is_named(generic, tmp_path):
    with pytest.raises(FileError, match=r"nowhere/arm\.urdf: cannot be written"):
        write_urdf(generic, tmp_path / "nowhere" / "arm.urdf")


def test_base_and_tool_are_fixed_frames_of_the_urdf():
    base, tool = pose((0, 0, 0.5), (0, math.pi, 0)), pose((0, 0, 0.1))
    table = DhTable([DhRow("j", 0, 0.2, 0.3, 0)], convention="modified", base=base, tool=tool)
    arm = load_robot(dh_to_urdf(table)).arm(tcp="tool0")
    np.testing.assert_allclose(arm.frame_placement([0.0], "dh_0").homogeneous, base.homogeneous, atol=1e-15)
    assert arm.base == "base_link"
