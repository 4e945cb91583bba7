"""Joint limits: refused where they make no sense, and never writable."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import UrdfError
from pinproof.model import load_robot

ONE = np.ones(2)


def test_default_acceleration_is_stated():
    limits = pp.JointLimits(-ONE, ONE, 2 * ONE)
    assert limits.acceleration.tolist() == [4.0, 4.0]
    assert "0.5 s" in limits.acceleration_source
    assert "caller" in pp.JointLimits(-ONE, ONE, ONE, ONE).acceleration_source


def test_which_accelerations_are_guessed_is_known_for_each_joint():
    guess, known = pp.JointLimits(-ONE, ONE, ONE), pp.JointLimits(-ONE, ONE, ONE, 2 * ONE)  # the same numbers
    assert guess.guessed.tolist() == [True, True]
    assert known.guessed.tolist() == [False, False]
    both = pp.JointLimits.join([known, guess])
    assert both.guessed.tolist() == [False, False, True, True]
    assert both.select([2, 0]).guessed.tolist() == [True, False]
    assert pickle.loads(pickle.dumps(both)).guessed.tolist() == both.guessed.tolist()
    # A value that was replaced is one that the caller states.
    assert dataclasses.replace(guess, acceleration=np.array([2.0, 3.0])).guessed.tolist() == [True, False]
    with pytest.raises(ValueError, match="read-only"):
        both.guessed[0] = True
    with pytest.raises(pp.InputError, match="guessed"):
        pp.JointLimits(-ONE, ONE, ONE, guessed=[True])


@pytest.mark.parametrize(
    "arguments",
    [
        (ONE, -ONE, ONE),
        (-ONE, np.array([1, np.nan]), ONE),
        (-ONE, ONE, np.array([1.0, 0.0])),
        (-ONE, ONE, -ONE),
        (-ONE, ONE, ONE, 0 * ONE),
        (-ONE, np.ones(3), ONE),
    ],
)
def test_invalid_limits_are_refused(arguments):
    with pytest.raises(pp.InputError, match="limits"):
        pp.JointLimits(*arguments)


def test_arrays_are_read_only_copies():
    lower = -ONE
    limits = pp.JointLimits(lower, ONE, ONE)
    lower[0] = -9
    assert limits.lower[0] == -1
    with pytest.raises(ValueError, match="read-only"):
        limits.lower[0] = 0


def test_joints_are_selected_by_index_or_mask():
    limits = pp.JointLimits(-np.arange(3.0), np.arange(3.0), np.ones(3))
    assert limits.select([2, 0]).upper.tolist() == [2.0, 0.0]
    assert limits.select([True, False, True]).upper.tolist() == [0.0, 2.0]
    assert len(limits.select([])) == 0
    for wrong in (3, 1, True, [1.0], [3], [True], "a", "", None, {}, [[0]]):
        with pytest.raises(pp.InputError):
            limits.select(wrong)


def test_violations_name_joint_and_range():
    limits = pp.JointLimits(-ONE, ONE, ONE)
    (sentence,) = limits.violations(np.array([0.0, 1.5]), ["a", "b"])
    assert sentence == "b = 1.5 is outside [-1, 1]"
    assert not limits.contains(np.array([0.0, 1.5]))
    assert limits.contains(np.array([0.0, 1.0]))
    assert not limits.contains(np.array([0.0, np.nan]))


def test_sampling_range_of_open_limits_is_one_rotation():
    infinite = np.array([np.inf, np.inf, 1.0])
    lower, upper = pp.JointLimits(np.array([-np.inf, 0.5, -np.inf]), infinite, np.ones(3)).sampling_range()
    assert lower == pytest.approx([-np.pi, 0.5, 1 - 2 * np.pi])
    assert upper == pytest.approx([np.pi, 0.5 + 2 * np.pi, 1.0])


def test_a_violation_is_printed_with_digits_that_show_it():
    limits = pp.JointLimits(-np.pi * ONE, np.pi * ONE, ONE)
    (sentence,) = limits.violations(np.array([0.0, -np.pi - 1e-8]), ["a", "b"])
    text, lowest = float(sentence.split()[2]), float(sentence.split("[")[1].split(",")[0])
    assert text < lowest
    for off in 10.0 ** np.arange(-15, 1):
        (sentence,) = limits.violations(np.array([0.0, np.pi + off]), ["a", "b"])
        assert float(sentence.split()[2]) > float(sentence.split()[-1].rstrip("]"))


def test_values_within_rounding_of_a_limit_become_the_limit():
    limits = pp.JointLimits(-ONE, ONE, ONE)
    snapped = limits.snap(np.array([[1 + 1e-10, -1 - 9e-10], [1 + 2e-9, 0.5], [1 - 1e-12, np.nan]]))
    assert snapped[0].tolist() == [1.0, -1.0]
    assert snapped[1].tolist() == [1 + 2e-9, 0.5]
    assert snapped[2, 0] == 1 - 1e-12
    assert np.isnan(snapped[2, 1])
    endless = pp.JointLimits(np.full(2, -np.inf), np.full(2, np.inf), ONE)
    assert endless.snap(np.array([1e3, -1e3])).tolist() == [1e3, -1e3]


def test_all_limits_can_be_passed_by_position():
    limits = pp.JointLimits(-ONE, ONE, 2 * ONE, 3 * ONE, 4 * ONE, 5 * ONE)
    assert limits.acceleration.tolist() == [3.0, 3.0]
    assert limits.jerk.tolist() == [4.0, 4.0]
    assert limits.torque.tolist() == [5.0, 5.0]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((-ONE, ONE), "velocity"),
        ((-ONE, ONE, "fast"), "limits.velocity"),
        ((-ONE, ONE, ONE, [[1], [1, 2]]), "limits.acceleration"),
        ((-ONE, ONE, ONE, ONE, "a source"), "limits.jerk"),
        ((-ONE, ONE, ONE, ONE, ONE, 0 * ONE), "torque"),
        ((-ONE, ONE, ONE, ONE, ONE, ONE, "source"), "acceleration_source"),
    ],
)
def test_wrong_arguments_are_named(arguments, named: str):
    with pytest.raises(pp.InputError, match=named):
        pp.JointLimits(*arguments)


URDF = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<joint name="one" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="{}"/></joint>
<joint name="two" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="0"/></joint></robot>"""


def test_effort_limits_are_those_of_the_urdf_and_0_is_unknown():
    arm = load_robot(URDF.format(87)).arm(tcp="c")
    np.testing.assert_array_equal(arm.limits.torque, [87.0, np.nan])
    assert arm.robot.model.effortLimit[0] == 87.0
    assert arm.model.effortLimit[0] == 87.0
    assert [joint.effort for joint in arm.robot.info(arm).joints] == [87.0, None]
    assert load_robot(URDF.format(0)).arm(tcp="c").limits.torque is None
    with pytest.raises(UrdfError, match="'one' has the negative effort limit"):
        load_robot(URDF.format(-1))


@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof"])
def test_effort_limits_are_those_of_pinocchio(name: str):
    arm = pp.load_robot(name).arm()
    known = ~np.isnan(arm.limits.torque)
    index = [arm.robot.model.joints[arm.robot.model.getJointId(joint)].idx_v for joint in arm.joint_names]
    np.testing.assert_array_equal(arm.limits.torque[known], arm.robot.model.effortLimit[index][known])
    assert known.any()


@pytest.mark.parametrize("suffix", ["yaml", "csv"])
def test_effort_limits_survive_both_conversions_and_files(suffix: str, tmp_path):
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    table = pp.urdf_to_dh(arm)
    table.save(tmp_path / f"table.{suffix}")
    again = pp.DhTable.load(tmp_path / f"table.{suffix}")
    pp.write_urdf(again, tmp_path / "again.urdf")
    there = pp.load_robot(tmp_path / "again.urdf").arm()
    assert there.limits.torque.tolist() == again.effort.tolist() == table.effort.tolist() == arm.limits.torque.tolist()
    assert set(table.effort) == {150.0, 28.0}


def test_inside_counts_values_beyond_a_limit_by_rounding_as_the_limit():
    limits = pp.JointLimits(-ONE, ONE, ONE)
    many = np.array([[1.0, -1.0], [1.0 + 9e-10, -1.0 - 9e-10], [1.0 + 2e-9, 0.0], [0.0, np.nan]])
    assert limits.inside(many).tolist() == [True, True, False, False]
    assert limits.inside(many[:, None]).shape == (4, 1)
