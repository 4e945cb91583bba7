"""Joint limits: refused where they make no sense, and never writable."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import FileError, UrdfError
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
        ((ONE, -ONE, ONE), "limits"),
        ((-ONE, np.array([1, np.nan]), ONE), "limits"),
        ((-ONE, ONE, np.array([1.0, 0.0])), "limits"),
        ((-ONE, ONE, -ONE), "limits"),
        ((-ONE, ONE, ONE, 0 * ONE), "limits"),
        ((-ONE, np.ones(3), ONE), "limits"),
        ((-ONE, ONE), "velocity"),
        ((-ONE, ONE, "fast"), "limits.velocity"),
        ((-ONE, ONE, ONE, [[1], [1, 2]]), "limits.acceleration"),
        ((-ONE, ONE, ONE, ONE, "a source"), "limits.jerk"),
        ((-ONE, ONE, ONE, ONE, ONE, 0 * ONE), "torque"),
        ((-ONE, ONE, ONE, ONE, ONE, ONE, "source"), "acceleration_source"),
    ],
)
def test_invalid_limits_are_refused_by_their_name(arguments, named: str):
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


# Limits from a file: what MoveIt's joint_limits.yaml states, over those of the URDF.


TEXT = """
default_velocity_scaling_factor: 0.1
default_acceleration_scaling_factor: 0.1
joint_limits:
  shoulder_pan_joint:
    has_velocity_limits: true
    max_velocity: 2.0
    has_acceleration_limits: true
    max_acceleration: 5
    has_jerk_limits: true
    max_jerk: 40.0
  elbow_joint:
    has_velocity_limits: true
    max_velocity: 1.5
    has_acceleration_limits: false
    max_acceleration: 0
    has_position_limits: true
    min_position: -1.0
    max_position: 2.0
"""


@pytest.fixture(scope="module")
def robot():
    return pp.load_robot("ur5")


def written(tmp_path, text=TEXT):
    path = tmp_path / "joint_limits.yaml"
    path.write_text(text)
    return path


def test_a_limits_file_overrides_the_urdf(robot, tmp_path):
    arm, plain = robot.arm(limits=pp.JointLimits.load(written(tmp_path))), robot.arm()
    limits, names = arm.limits, arm.joint_names
    pan, elbow, wrist = (names.index(name) for name in ("shoulder_pan_joint", "elbow_joint", "wrist_3_joint"))
    assert limits.velocity[[pan, elbow]].tolist() == [2.0, 1.5]
    assert limits.velocity[wrist] == plain.limits.velocity[wrist]
    assert limits.acceleration[[pan, elbow]].tolist() == [5.0, 3.0]  # by default the velocity limit in 0.5 s
    assert (limits.lower[elbow], limits.upper[elbow]) == (-1.0, 2.0)
    np.testing.assert_array_equal(limits.lower[[pan, wrist]], plain.limits.lower[[pan, wrist]])
    assert limits.jerk[pan] == 40.0
    assert np.isnan(limits.jerk[[elbow, wrist]]).all()
    assert limits.acceleration_source.startswith("joint_limits.yaml, but for")
    assert "elbow_joint" in limits.acceleration_source
    assert "0.5 s" in limits.acceleration_source


def test_a_stated_acceleration_of_twice_the_velocity_is_known_although_others_are_guessed(robot, tmp_path):
    """Which accelerations are guesses is not read from their values: 2 * velocity may be a limit of the robot."""
    text = "joint_limits:\n  shoulder_pan_joint: {has_velocity_limits: true, max_velocity: 2.0, "
    text += "has_acceleration_limits: true, max_acceleration: 4.0}\n"
    arm = robot.arm(limits=pp.JointLimits.load(written(tmp_path, text)))
    assert arm.limits.guessed.tolist() == [False, True, True, True, True, True]
    q = np.stack([arm.home, arm.home + 0.4 * np.eye(6)[0]])
    motion = pp.Trajectory([0.0, 0.5], q, np.zeros_like(q), arm.joint_names)  # 9.6 rad/s^2 at its ends, 1.2 rad/s
    (violation,) = pp.motion.check_limits(motion, arm.limits).violations
    assert (violation.quantity, violation.limit) == ("acceleration", 4.0)


def test_a_second_file_changes_the_guesses_that_the_first_left(robot, tmp_path):
    first = robot.arm(limits=pp.JointLimits.load(written(tmp_path))).limits
    text = "joint_limits:\n  wrist_3_joint: {has_velocity_limits: true, max_velocity: 1.0}\n"
    second = pp.JointLimits.load(written(tmp_path, text)).over(first, robot.arm().joint_names, list(robot.urdf.joints))
    assert second.acceleration[5] == 2.0
    assert second.guessed.tolist() == first.guessed.tolist() == [False, *[True] * 5]


FOLLOWED = """<robot name="follow"><link name="base"/><link name="a"/><link name="b"/>
<joint name="lead" type="revolute"><parent link="base"/><child link="a"/>
 <limit lower="-2" upper="2" velocity="2" effort="1"/></joint>
<joint name="follow" type="revolute"><parent link="a"/><child link="b"/>
 <limit lower="-1" upper="3" velocity="3" effort="1"/>
 <mimic joint="lead" multiplier="-2" offset="1"/></joint></robot>"""


def test_limits_of_a_mimic_follower_limit_the_joint_that_it_follows_wherever_they_are_stated(tmp_path):
    def limits(text):
        path = written(tmp_path, f"joint_limits:\n  {text}\n")
        return load_robot(FOLLOWED).arm("b", limits=pp.JointLimits.load(path)).limits

    plain = load_robot(FOLLOWED).arm("b").limits  # follow = 1 - 2 lead
    assert (plain.lower[0], plain.upper[0], plain.velocity[0]) == (-1.0, 1.0, 1.5)
    # A wider range of the leader does not widen that of the follower.
    wide = limits(
        "lead: {has_position_limits: true, min_position: -9, max_position: 9, "
        "has_velocity_limits: true, max_velocity: 9}"
    )
    assert (wide.lower[0], wide.upper[0], wide.velocity[0], wide.acceleration[0]) == (-1.0, 1.0, 1.5, 3.0)
    assert load_robot(FOLLOWED).arm("b", limits={"lead": (-9, 0.5)}).limits.lower[0] == -1.0
    tight = limits(
        "follow: {has_position_limits: true, min_position: 0, max_position: 2, "
        "has_velocity_limits: true, max_velocity: 1, has_acceleration_limits: true, max_acceleration: 3}"
    )
    assert (tight.lower[0], tight.upper[0], tight.velocity[0], tight.acceleration[0]) == (-0.5, 0.5, 0.5, 1.5)
    assert not tight.guessed[0]
    with pytest.raises(pp.InputError, match="follow"):
        limits("lead: {has_position_limits: true, min_position: 1.5, max_position: 2}")


def test_joints_without_a_jerk_limit_are_named(robot, tmp_path):
    arm = robot.arm(limits=pp.JointLimits.load(written(tmp_path)))
    path = pp.JointPath([arm.home, arm.home + 0.1], arm.joint_names)
    with pytest.raises(pp.InputError, match="jerk limit of joint 'shoulder_lift_joint' is not known"):
        pp.time_parametrise(path, arm.limits, jerk="limits")
    stated = "".join(
        f"  {name}: {{has_jerk_limits: true, max_jerk: 30, has_acceleration_limits: true, max_acceleration: 4}}\n"
        for name in arm.joint_names
    )
    full = robot.arm(limits=pp.JointLimits.load(written(tmp_path, f"joint_limits:\n{stated}")))
    motion = pp.time_parametrise(path, full.limits, jerk="limits")
    assert motion.limits_note == "acceleration limits: joint_limits.yaml; jerk limits: joint_limits.yaml"
    assert (motion.max_jerk() <= 30 * (1 + 1e-9)).all()


def test_a_smaller_limit_of_deceleration_is_kept_in_both_directions(tmp_path):
    text = "joint_limits:\n  j: {has_acceleration_limits: true, max_acceleration: 5, has_deceleration_limits: true, "
    assert pp.JointLimits.load(written(tmp_path, text + "max_deceleration: -3}\n")).acceleration == {"j": 3.0}
    assert pp.JointLimits.load(written(tmp_path, text + "max_deceleration: 9}\n")).acceleration == {"j": 5.0}


def test_joints_outside_the_arm_are_ignored_and_unknown_joints_refused(tmp_path):
    panda = pp.load_robot("panda")
    finger = next(name for name in panda.urdf.joints if "finger_joint1" in name)
    text = "joint_limits:\n  {}: {{has_velocity_limits: true, max_velocity: 0.1}}\n"
    limits = panda.arm(limits=pp.JointLimits.load(written(tmp_path, text.format(finger)))).limits
    np.testing.assert_array_equal(limits.velocity, panda.arm().limits.velocity)
    with pytest.raises(FileError, match=r"'panda_joint9'.*panda_joint1"):
        panda.arm(limits=pp.JointLimits.load(written(tmp_path, text.format("panda_joint9"))))


VELOCITY = "has_velocity_limits: true, max_velocity"


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("joints: {}", "unknown key 'joints'.*joint_limits"),
        ("joint_limits: []", "key joint_limits"),
        ("3", "key joint_limits.j: j holds 3"),
        ("{max_velocty: 3}", "line 2, column 7, key joint_limits.j.max_velocty: unknown key 'max_velocty'"),
        ("{max_velocity: 3}", "line 2, column 3, key joint_limits.j: max_velocity requires has_velocity_limits"),
        ("{has_velocity_limits: 1, max_velocity: 3}", "is 1; it must be true or false"),
        ("{has_velocity_limits: true}", "has_velocity_limits: true requires max_velocity"),
        (f"{{{VELOCITY}: .inf}}", "finite number, not inf"),
        ("{has_jerk_limits: true, max_jerk: 0}", "max_jerk must be above 0"),
        ("{has_position_limits: true, min_position: 2, max_position: 1}", "min_position 2.0 is above"),
        ("{has_deceleration_limits: true, max_deceleration: 2}", "no acceleration limit"),
        ("{has_velocity_limits: false, has_velocity_limits: true}", "duplicate"),
        (f"{{{VELOCITY}: !deg 90}}", "line 2: .*!degrees, !radians"),
        (f"{{{VELOCITY}: !degrees far}}", "line 2: .*'far' is not a number"),
        (f"{{{VELOCITY}: !degrees [1]}}", "line 2: "),
    ],
)
def test_invalid_files_are_refused_with_their_line(tmp_path, text, named):
    path = written(tmp_path, text if text.startswith("joint") else f"joint_limits:\n  j: {text}")
    with pytest.raises(pp.FileError, match=named) as caught:
        pp.JointLimits.load(path)
    assert "joint_limits.yaml" in str(caught.value)


def test_limits_of_jerk_are_checked_and_kept(tmp_path):
    one = np.ones(2)
    limits = pp.JointLimits(-one, one, one, one, [5.0, 6.0], acceleration_source="cell")
    assert limits.jerk_source == "given by the caller"
    assert limits.replace(["a", "b"], {"a": (0.0, 1.0)}).jerk.tolist() == [5.0, 6.0]
    assert not limits.jerk.flags.writeable
    for jerk in ([5.0], [0.0, 1.0], [-1.0, 1.0]):
        with pytest.raises(pp.InputError, match="jerk"):
            pp.JointLimits(-one, one, one, one, jerk)


def test_degrees_are_converted_and_radians_are_not(robot, tmp_path):
    text = (
        "joint_limits: {elbow_joint: {has_position_limits: true, min_position: !degrees -90, max_position: !radians 2}}"
    )
    arm = robot.arm(tcp="tool0", limits=pp.JointLimits.load(written(tmp_path, text)))
    assert (arm.limits.lower[2], arm.limits.upper[2]) == (-np.pi / 2, 2.0)


def test_an_effort_limit_replaces_that_of_the_urdf(robot, tmp_path):
    text = "joint_limits: {elbow_joint: {has_effort_limits: true, max_effort: 12}}"
    limits = robot.arm(tcp="tool0", limits=pp.JointLimits.load(written(tmp_path, text))).limits
    assert limits.torque.tolist() == [150.0, 150.0, 12.0, 28.0, 28.0, 28.0]
