"""Limits from a file: what MoveIt's joint_limits.yaml states, over those of the URDF."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import FileError
from pinproof.model import load_robot

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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joints: {}", "unknown key 'joints'.*joint_limits"),
        ("joint_limits: []", "key joint_limits"),
        ("joint_limits:\n  j: 3", "key joint_limits.j: j holds 3, not a mapping"),
        (
            "joint_limits:\n  j: {max_velocty: 3}",
            "line 2, column 7, key joint_limits.j.max_velocty: unknown key 'max_velocty'",
        ),
        (
            "joint_limits:\n  j: {max_velocity: 3}",
            "line 2, column 3, key joint_limits.j: max_velocity requires has_velocity_limits",
        ),
        ("joint_limits:\n  j: {has_velocity_limits: 1, max_velocity: 3}", "is 1; it must be true or false"),
        ("joint_limits:\n  j: {has_velocity_limits: true}", "has_velocity_limits: true requires max_velocity"),
        ("joint_limits:\n  j: {has_velocity_limits: true, max_velocity: .inf}", "finite number, not inf"),
        ("joint_limits:\n  j: {has_jerk_limits: true, max_jerk: 0}", "max_jerk must be above 0"),
        (
            "joint_limits:\n  j: {has_position_limits: true, min_position: 2, max_position: 1}",
            "min_position 2.0 is above",
        ),
        ("joint_limits:\n  j: {has_deceleration_limits: true, max_deceleration: 2}", "no acceleration limit"),
        ("joint_limits:\n  j: {has_velocity_limits: false, has_velocity_limits: true}", "duplicate"),
    ],
)
def test_invalid_files_are_refused_with_their_line(tmp_path, text, message):
    with pytest.raises(pp.FileError, match=message) as caught:
        pp.JointLimits.load(written(tmp_path, text))
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


@pytest.mark.parametrize(
    ("value", "reason"),
    [("!deg 90", "!degrees, !radians"), ("!degrees far", "'far' is not a number"), ("!degrees [1]", "")],
)
def test_other_tags_and_values_are_refused_with_their_line(value: str, reason: str, tmp_path):
    text = f"joint_limits:\n  j: {{has_velocity_limits: true, max_velocity: {value}}}"
    with pytest.raises(pp.FileError, match=rf"line 2: .*{reason}"):
        pp.JointLimits.load(written(tmp_path, text))


def test_an_effort_limit_replaces_that_of_the_urdf(robot, tmp_path):
    text = "joint_limits: {elbow_joint: {has_effort_limits: true, max_effort: 12}}"
    limits = robot.arm(tcp="tool0", limits=pp.JointLimits.load(written(tmp_path, text))).limits
    assert limits.torque.tolist() == [150.0, 150.0, 12.0, 28.0, 28.0, 28.0]
