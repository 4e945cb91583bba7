"""URDF to DH table: exact for every kind of axis pair, an error that names what DH cannot express, and back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof.description import DhRow, DhTable
from pinproof.errors import ConversionError, UnknownNameError
from pinproof.model import Arm, load_robot
from pinproof.model.dh_tables import (
    COINCIDENT,
    FARTHEST,
    PARALLEL,
    DhAxis,
    dh_to_urdf,
    frame_on,
    prove_table_equals_arm,
    urdf_to_dh,
)
from pinproof.spatial import pose

from ..examples import examples

HALF = math.pi / 2
ROBOTS = Path(__file__).parents[2] / "robots"
BOTH = pytest.mark.parametrize("convention", ["standard", "modified"])

# Right angles and parallels, meeting axes, and what is clearly neither; what lies between has tests of its own below.
twists = st.one_of(st.sampled_from([0.0, HALF, -HALF, math.pi]), st.floats(0.05, 3.09), st.floats(-3.09, -0.05))
turns = st.one_of(st.sampled_from([0.0, HALF, -HALF, math.pi]), st.floats(-3.1, 3.1))
lengths = st.one_of(st.just(0.0), st.floats(1e-6, 1), st.floats(-1, -1e-6))
placements = st.builds(pose, st.tuples(lengths, lengths, lengths), st.tuples(turns, turns, turns))


@st.composite
def tables(draw: st.DrawFn) -> DhTable:
    rows = []
    for i in range(draw(st.integers(1, 7))):
        kind = draw(st.sampled_from(["revolute", "revolute", "prismatic", "continuous"]))
        limits = sorted([draw(st.floats(-2, 2)), draw(st.floats(-2, 2))]) if kind != "continuous" else []
        speed = draw(st.floats(0.1, 10))
        row = DhRow(f"j{i}", draw(turns), draw(lengths), draw(lengths), draw(twists), kind, *limits)
        rows.append(DhRow(row.name, row.theta, row.d, row.a, row.alpha, kind, *limits, velocity=speed))
    convention = draw(st.sampled_from(["standard", "modified"]))
    return DhTable(rows, convention=convention, base=draw(placements), tool=draw(placements))


def arm_of(table: DhTable) -> Arm:
    return load_robot(dh_to_urdf(table)).arm(tcp="tool0")


def difference(table: DhTable, arm: Arm, seed: int = 0, configurations: int = 20) -> float:
    """Largest entry by which the tcp's matrices differ, at zero and at random."""
    random = np.random.default_rng(seed).uniform(-3, 3, (configurations, arm.dof))
    return max(
        float(np.abs(table.forward_kinematics(q) - arm.forward_kinematics(q).homogeneous).max())
        for q in (np.zeros(arm.dof), *random)
    )


@pytest.mark.slow
@examples(40)
@given(table=tables(), convention=st.sampled_from(["standard", "modified"]), seed=st.integers(0, 2**32 - 1))
def test_table_to_urdf_to_table_to_urdf_is_the_same_arm(table, convention, seed):
    there = arm_of(table)
    back = urdf_to_dh(there, convention=convention)
    again = arm_of(back)
    for q in np.random.default_rng(seed).uniform(-np.pi, np.pi, (5, len(table))):
        expected = table.forward_kinematics(q)
        np.testing.assert_allclose(there.forward_kinematics(q).homogeneous, expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(again.forward_kinematics(q).homogeneous, expected, rtol=0, atol=1e-9)
    assert difference(back, there, seed) < 5e-12
    assert back.convention == convention
    assert back.name == table.name
    for row, original in zip(back.rows, table.rows, strict=True):
        for column in ("name", "joint_type", "lower", "upper", "velocity"):
            assert getattr(row, column) == getattr(original, column)


@examples(30)
@given(data=st.data(), convention=st.sampled_from(["standard", "modified"]))
def test_a_table_without_free_choices_is_reproduced_exactly(data, convention):
    """No axes parallel, every |theta| < pi/2, neither base nor tool: then DH leaves nothing to choose."""
    rows = []
    for i in range(data.draw(st.integers(1, 6))):
        twist = data.draw(st.sampled_from([-1, 1])) * data.draw(st.floats(0.1, 3.0))
        kind = data.draw(st.sampled_from(["revolute", "prismatic"]))
        theta, d, a = data.draw(st.floats(-1.5, 1.5)), data.draw(st.floats(-1, 1)), data.draw(st.floats(-1, 1))
        rows.append(DhRow(f"j{i}", theta, d, a, twist, kind, -1, 1))
    table = DhTable(rows, convention=convention)
    assert urdf_to_dh(arm_of(table), convention=convention).is_close(table, tolerance=1e-12)


@pytest.mark.parametrize("name", ["generic_6dof", "puma560", "scara", "panda", "iiwa14", "irb120"])
def test_published_tables_are_reproduced(name):
    table = DhTable.load(ROBOTS / name / "dh.yaml")
    arm = load_robot(ROBOTS / name / f"{name}.urdf").arm(tcp="tool0")
    assert urdf_to_dh(arm, convention=table.convention).is_close(table, tolerance=1e-15)


@pytest.mark.parametrize("name", ["stanford", "ur3", "ur5", "ur10"])
def test_with_an_opposite_published_x_axis_only_signs_differ(name):
    table = DhTable.load(ROBOTS / name / "dh.yaml")
    arm = load_robot(ROBOTS / name / f"{name}.urdf").arm(tcp="tool0")
    back = urdf_to_dh(arm)
    for row, original in zip(back.rows, table.rows, strict=True):
        assert row.d == pytest.approx(original.d, abs=1e-15)
        assert abs(row.a) == pytest.approx(abs(original.a), abs=1e-15)
        assert abs(row.alpha) == pytest.approx(abs(original.alpha), abs=1e-15)
        assert math.remainder(row.theta - original.theta, HALF) == pytest.approx(0, abs=1e-15)
    assert difference(back, arm) < 2e-15


@BOTH
def test_the_ur5_of_example_robot_data_gives_the_manufacturers_lengths(convention):
    table = urdf_to_dh(load_robot("ur5").arm(tcp="tool0"), convention=convention)
    assert sorted(abs(row.d) for row in table.rows) == [0, 0, 0.0823, 0.089159, 0.09465, 0.10915]
    assert sorted(abs(row.a) for row in table.rows) == [0, 0, 0, 0, 0.39225, 0.425]


# Two joints, the second 0.3 m to the side and 0.5 m along y; a tilt about x makes their normal run off along the axes.
TWO = """<robot name="two"><link name="base"/><link name="upper"/><link name="lower"/><link name="tip"/>
<joint name="first" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="second" type="{kind}"><parent link="upper"/><child link="lower"/>
<origin xyz="0.3 {y} 0.1" rpy="{tilt!r} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/>{extra}</joint>
<joint name="fixed" type="fixed"><parent link="lower"/><child link="tip"/>
<origin xyz="0.4 0.1 0.2" rpy="0.3 0.2 0.1"/></joint></robot>"""


def two(tilt: float, y: float = 0.5, kind: str = "revolute", extra: str = "") -> Arm:
    return load_robot(TWO.format(tilt=tilt, y=y, kind=kind, extra=extra)).arm(tcp="tip")


@BOTH
@pytest.mark.parametrize("tilt", [0.0, 1e-15, 2e-13, 0.9 * PARALLEL, math.pi, math.pi - 2e-13])
def test_axes_parallel_up_to_rounding_are_treated_as_parallel(tilt, convention):
    arm = two(tilt)
    table = urdf_to_dh(arm, convention=convention)
    assert max(abs(row.d) for row in table.rows) < 1
    assert difference(table, arm) < 1e-9


@BOTH
@pytest.mark.parametrize("tilt", [1.1 * PARALLEL, 1e-8, 1e-6, 4e-6, math.pi - 1e-6])
def test_axes_too_near_parallel_are_refused_and_named(tilt, convention):
    with pytest.raises(ConversionError, match="axes of joint 'first' and joint 'second' are"):
        urdf_to_dh(two(tilt), convention=convention)


@BOTH
@pytest.mark.parametrize("tilt", [6e-6, 1e-4, 1e-3, -1e-3, math.pi - 1e-4])
def test_nearly_parallel_calibrated_axes_are_exact_with_long_rows(tilt, convention):
    """A calibrated arm: 1e-3 rad between axes half a metre apart put their normal 500 m away."""
    arm = two(tilt)
    table = urdf_to_dh(arm, convention=convention)
    expected = 0.5 / abs(math.sin(tilt))
    assert max(abs(row.d) for row in table.rows) == pytest.approx(expected, rel=1e-3, abs=1)
    assert expected < FARTHEST
    assert difference(table, arm) < 1e-9


@BOTH
@pytest.mark.parametrize("tilt", [1e-7, 1e-5])
def test_nearly_parallel_axes_with_a_close_common_normal_are_converted(tilt, convention):
    arm = two(tilt, y=0.0)
    table = urdf_to_dh(arm, convention=convention)
    assert max(abs(row.d) for row in table.rows) < 1
    assert difference(table, arm) < 1e-12


@BOTH
@pytest.mark.parametrize("x", [1e-13, 1e-11, 0.9e-10, 1.1e-10, 1e-6])
def test_parallel_axes_that_nearly_coincide_hold_the_tolerance(x, convention):
    text = TWO.format(tilt=0.0, y=0.0, kind="revolute", extra="").replace('xyz="0.3 0.0 0.1"', f'xyz="{x!r} 0.0 0.1"')
    arm = load_robot(text).arm(tcp="tip")
    assert difference(urdf_to_dh(arm, convention=convention), arm) <= (x if x < COINCIDENT else 1e-15) + 1e-15


@BOTH
def test_a_tool_slightly_off_its_joint_remains_in_the_tool(convention):
    """Its tilt belongs to no joint, so it is in the table's tool and base; rows are short."""
    text = TWO.format(tilt=HALF, y=0.5, kind="revolute", extra="").replace("0.3 0.2 0.1", "1e-7 0 0")
    arm = load_robot(text).arm(tcp="tip")
    table = urdf_to_dh(arm, convention=convention)
    assert max(abs(number) for row in table.rows for number in (row.d, row.a)) < 1.0
    assert difference(table, arm) < 1e-14


@BOTH
def test_axes_rounded_to_1_5708_are_kept_as_they_are(convention):
    """The xArm7's file states 1.5708 for pi/2; its table does too, and is exact."""
    table = urdf_to_dh(two(1.5708), convention=convention)
    assert 1.5708 in [pytest.approx(abs(row.alpha), abs=1e-15) for row in table.rows]
    assert difference(table, two(1.5708)) < 1e-14


@BOTH
def test_a_prismatic_joint_keeps_its_kind_and_stroke(convention):
    table = urdf_to_dh(two(0.7, kind="prismatic"), convention=convention)
    assert [(row.joint_type, row.lower, row.upper) for row in table.rows] == [("revolute", -1, 1), ("prismatic", -1, 1)]
    assert difference(table, two(0.7, kind="prismatic")) < 1e-14


def test_a_joint_that_follows_another_is_refused_by_name():
    arm = two(0.7, extra='<mimic joint="first" multiplier="2"/>')
    with pytest.raises(ConversionError, match="joint 'second' is a mimic joint of 'first'"):
        urdf_to_dh(arm)


def test_a_mimic_joint_outside_the_chain_is_allowed():
    arm = load_robot("panda").arm(tcp="panda_hand_tcp")
    assert difference(urdf_to_dh(arm, convention="modified"), arm) < 1e-14


def test_a_floating_joint_is_refused_by_name_before_there_is_an_arm():
    text = TWO.format(tilt=0.7, y=0.5, kind="floating", extra="")
    with pytest.raises(ValueError, match=r"'second' .*floating"):
        urdf_to_dh(load_robot(text).arm(tcp="tip"))


def test_an_unknown_convention_is_refused_with_the_valid_ones():
    with pytest.raises(UnknownNameError, match="standard"):
        urdf_to_dh(two(0.7), convention="classic")


def test_the_arms_own_limits_count_and_a_name_may_be_given():
    arm = load_robot(TWO.format(tilt=0.7, y=0.5, kind="revolute", extra="")).arm(
        tcp="tip", limits={"first": (-0.2, 0.3), "second": (-math.inf, math.inf)}
    )
    table = urdf_to_dh(arm, name="mine")
    assert table.name == "mine"
    assert (table.rows[0].lower, table.rows[0].upper) == (-0.2, 0.3)
    assert table.rows[1].joint_type == "continuous"


def test_a_prismatic_joint_without_limits_is_refused_with_the_remedy():
    arm = load_robot(TWO.format(tilt=0.7, y=0.5, kind="prismatic", extra="")).arm(
        tcp="tip", limits={"second": (-math.inf, 1.0)}
    )
    with pytest.raises(ConversionError, match=r"'second' has no finite limits.*limits="):
        urdf_to_dh(arm)


def test_the_table_begins_at_another_base():
    robot = load_robot(ROBOTS / "irb120" / "irb120.urdf")
    arm = robot.arm(base="link_2", tcp="dh_5")
    table = urdf_to_dh(arm)
    assert table.joint_names == ("joint_3", "joint_4", "joint_5")
    assert difference(table, arm) < 1e-14


def test_a_table_that_is_not_the_arm_is_refused():
    """The proof at the end can fail: a millionth of a millimetre in one length."""
    table = DhTable.load(ROBOTS / "irb120" / "dh.yaml")
    rows = list(table.rows)
    rows[3] = DhRow(rows[3].name, rows[3].theta, rows[3].d + 2e-9, rows[3].a, rows[3].alpha)
    with pytest.raises(ConversionError, match="does not equal it: the tcp is off by 2e-09 m"):
        prove_table_equals_arm(DhTable(rows, convention="standard"), arm_of(table))


def test_a_frame_on_an_axis_along_the_base_x_takes_the_base_y():
    frame = frame_on(DhAxis("x", np.array([5.0, 1.0, 2.0]), np.array([1.0, 0.0, 0.0])), np.eye(4))
    np.testing.assert_array_equal(frame[:3, 0], [0, 1, 0])
    np.testing.assert_array_equal(frame[:3, 3], [0, 1, 2])
