"""Straight moves: on the line, on the branch, inside limits, proven free; or where they stop and why."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.ik import IkTask
from pinproof.planning import LinearStatus, Route, RouteFollower, cartesian
from pinproof.spatial import interpolate, twist_size

from .arms import assert_free, ball_arm

READY = np.array([0.0, -1.3, 1.9, -2.17, -1.57, 0.0])
"""A UR5 with its tool above the table, pointing down."""


@pytest.fixture(scope="module")
def free(ur5: pp.Arm) -> pp.CollisionChecker:
    return pp.CollisionChecker(ur5)


def _moved(arm: pp.Arm, q: np.ndarray, xyz: tuple[float, ...] = (0, 0, 0), rpy: tuple[float, ...] = (0, 0, 0)):
    """The tcp's pose at q, shifted in the base's axes and turned in its own."""
    here = arm.forward_kinematics(q)
    turned = here * pp.pose((0, 0, 0), rpy)
    turned.translation = here.translation + np.array(xyz)
    return turned


def _assert_follows(
    move: pp.planning.LinearPlanResult,
    checker: pp.CollisionChecker,
    start: np.ndarray,
    target,
    metres: float,
    radians: float,
) -> None:
    arm, path = checker.arm, move.or_raise().path
    first = arm.forward_kinematics(start)
    assert np.array_equal(path.start, start)
    assert max(twist_size(arm.forward_kinematics(path.end), target)) < 2e-6
    assert move.fraction == 1.0
    assert move.certificate.matches(path, arm, checker.scene)
    assert_free(path, checker)
    off = np.array(
        [twist_size(interpolate(first, target, s), arm.forward_kinematics(path(s))) for s in np.linspace(0, 1, 997)]
    )
    assert off[:, 0].max() <= metres
    assert off[:, 1].max() <= radians
    assert move.deviation <= metres
    assert move.rotation_deviation <= radians


@pytest.mark.parametrize("xyz", [(0, 0, 0.15), (0.1, -0.1, -0.05), (-0.15, 0.2, 0.0)])
def test_a_translation(ur5: pp.Arm, free: pp.CollisionChecker, xyz: tuple[float, ...]) -> None:
    target = _moved(ur5, READY, xyz)
    _assert_follows(pp.plan_linear(free, READY, target), free, READY, target, 1e-3, 1e-2)


@pytest.mark.parametrize("rpy", [(0, 0, 1.0), (0.4, 0, 0), (0.2, -0.3, 0.5)])
def test_a_pure_rotation_keeps_the_point(ur5: pp.Arm, free: pp.CollisionChecker, rpy: tuple[float, ...]) -> None:
    target = _moved(ur5, READY, rpy=rpy)
    move = pp.plan_linear(free, READY, target)
    _assert_follows(move, free, READY, target, 1e-3, 1e-2)
    here = ur5.forward_kinematics(READY).translation
    for s in np.linspace(0, 1, 101):
        assert np.linalg.norm(ur5.forward_kinematics(move.path(s)).translation - here) < 1e-3


def test_half_a_turn(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    target = _moved(ur5, READY, rpy=(0, 0, np.pi))
    move = pp.plan_linear(free, READY, target)
    _assert_follows(move, free, READY, target, 1e-3, 1e-2)
    assert abs(move.path.end - move.path.start).max() == pytest.approx(np.pi, abs=1e-5)


def test_a_tighter_deviation_holds(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    target = _moved(ur5, READY, (0.1, 0.15, 0.1), (0, 0, 0.5))
    loose = pp.plan_linear(free, READY, target, translation_step=0.2, rotation_step=1.0, deviation=1e-2)
    tight = pp.plan_linear(free, READY, target, translation_step=0.2, rotation_step=1.0, deviation=2e-6)
    assert len(tight.path.knots) > len(loose.path.knots)
    _assert_follows(tight, free, READY, target, 2.5e-6, 1e-2)


def test_a_tighter_rotation_deviation_holds(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    target = _moved(ur5, READY, (0.1, 0.15, 0.1), (0.2, -0.3, 0.5))
    coarse = {"translation_step": 1.0, "rotation_step": 1.0, "deviation": 1.0, "max_joint_step": 1.0}
    loose = pp.plan_linear(free, READY, target, **coarse, rotation_deviation=1.0)
    tight = pp.plan_linear(free, READY, target, **coarse, rotation_deviation=1e-4)
    assert loose.or_raise().rotation_deviation > 1e-3
    _assert_follows(tight, free, READY, target, 1.0, 1.2e-4 + 1e-6)


def test_start_is_target(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    move = pp.plan_linear(free, READY, ur5.forward_kinematics(READY)).or_raise()
    assert move.status is LinearStatus.COMPLETE
    assert move.fraction == 1.0
    assert np.abs(move.path(np.linspace(0, 1, 50)) - READY).max() < 1e-6


def test_panda(panda: pp.Arm) -> None:
    checker = pp.CollisionChecker(panda)
    target = _moved(panda, panda.home, (0.1, 0.1, -0.2))
    _assert_follows(pp.plan_linear(checker, panda.home, target), checker, panda.home, target, 1e-3, 1e-2)


def test_out_of_reach_reports_distance_and_reason(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    move = pp.plan_linear(free, READY, _moved(ur5, READY, (1.0, 0, 0)))
    assert move.status is LinearStatus.UNREACHABLE
    assert not move.ok
    assert not move.ok
    assert 0.2 < move.fraction < 0.6
    assert "mm" in move.message
    assert "short" in move.message
    assert "singular value" in move.message
    with pytest.raises(pp.errors.PlanFailed, match="of the line"):
        move.or_raise()


def test_a_stretched_arm_with_a_target_further_out(generic: pp.Arm) -> None:
    stretched = np.zeros(6)
    stretched[4] = 0.7  # the wrist bent, shoulder and elbow in one line
    checker = pp.CollisionChecker(generic)
    move = pp.plan_linear(checker, stretched, _moved(generic, stretched, (0.1, 0, 0)))
    assert move.status is LinearStatus.UNREACHABLE
    assert move.fraction == 0.0
    assert "stops at 0 %" in move.message


def test_a_joint_at_its_limit_is_named() -> None:
    arm = ball_arm(("x", "y"))
    target = pp.pose((0.5, 1.4, 0.0))
    move = pp.plan_linear(pp.CollisionChecker(arm), (0.5, 0.0), target)
    assert move.status is LinearStatus.LIMIT
    assert move.joints == ("y",)
    assert move.fraction == pytest.approx(1.0 / 1.4, abs=0.02)
    assert "y at the limit" in move.message


def test_a_joint_that_would_have_to_go_round_is_at_its_limit(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    # One joint more than this it may not turn; the same pose is reached a whole turn back.
    start = READY.copy()
    start[5] = ur5.limits.upper[5] - 0.3
    move = pp.plan_linear(free, start, _moved(ur5, start, rpy=(0, 0, 1.0)))
    assert move.status is LinearStatus.LIMIT
    assert move.joints == ("wrist_3_joint",)
    assert 0.1 < move.fraction < 0.31
    assert "wrist_3_joint" in move.message
    assert "limit" in move.message


def test_the_curve_keeps_the_limits_between_the_solved_poses(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    target, coarse = _moved(ur5, READY, (0.0, -0.5, 0.0)), {"translation_step": 1.0, "deviation": 0.2}
    path = pp.plan_linear(free, READY, target, **coarse, max_joint_step=2.0).or_raise().path
    seen, between = path.q.max(axis=0), path(np.linspace(0, 1, 1001)).max(axis=0)
    joint = int((between - seen).argmax())
    assert between[joint] > seen[joint] + 1e-3  # the joint turns back between two solved poses
    upper = (between[joint] + seen[joint]) / 2
    limits = ur5.limits.replace(ur5.joint_names, {ur5.joint_names[joint]: (ur5.limits.lower[joint], upper)})
    checker = pp.CollisionChecker(ur5.with_limits(limits))
    move = pp.plan_linear(checker, READY, target, **coarse, max_joint_step=2.0)
    assert move.status is LinearStatus.LIMIT
    assert move.joints == (ur5.joint_names[joint],)
    assert ur5.joint_names[joint] in move.message


def test_a_start_outside_its_limits() -> None:
    arm = ball_arm(("x", "y"))
    move = pp.plan_linear(pp.CollisionChecker(arm), (1.5, 0.0), pp.pose((0.5, 0.0, 0.0)))
    assert move.status is LinearStatus.LIMIT
    assert move.joints == ("x",)
    assert move.fraction == 0.0
    assert "x = 1.5" in move.message


def test_a_start_within_rounding_of_its_limit_starts_at_the_limit() -> None:
    arm = ball_arm(("x", "y"))
    move = pp.plan_linear(pp.CollisionChecker(arm), (1 + 5e-10, 0.0), pp.pose((0.5, 0.0, 0.0)))
    assert move.status is LinearStatus.COMPLETE
    assert move.path.q[0].tolist() == [1.0, 0.0]


def test_a_contact_on_the_path_is_reported_with_bodies_and_parameter() -> None:
    arm = ball_arm(("x", "y"))
    wall = pp.Obstacle("wall", pp.Box(0.1, 1.0, 1.0), pp.pose((0.407, 0.0, 0.0)))
    move = pp.plan_linear(pp.CollisionChecker(arm, pp.Scene([wall])), (-0.6, 0.0), pp.pose((0.9, 0.0, 0.0)))
    assert move.status is LinearStatus.CONTACT
    assert not move.ok
    assert "wall" in move.message
    assert move.fraction == pytest.approx((0.6 + 0.407 - 0.05 - 0.05) / 1.5, abs=1e-3)  # the ball's face at the wall's
    assert move.fraction <= (0.6 + 0.307) / 1.5
    assert move.certificate.status is pp.CertificateStatus.COLLIDING


def test_a_contact_before_the_limit_is_what_stops_it() -> None:
    arm = ball_arm(("x", "y"))
    wall = pp.Obstacle("wall", pp.Box(1.0, 0.1, 1.0), pp.pose((0.0, 0.507, 0.0)))
    move = pp.plan_linear(pp.CollisionChecker(arm, pp.Scene([wall])), (0.0, 0.0), pp.pose((0.0, 1.4, 0.0)))
    assert move.status is LinearStatus.CONTACT
    assert "wall" in move.message
    assert move.fraction == pytest.approx(0.407 / 1.4, abs=1e-3)


def test_a_start_in_contact() -> None:
    arm = ball_arm(("x", "y"))
    wall = pp.Obstacle("wall", pp.Box(0.1, 1.0, 1.0), pp.pose((0.4, 0.0, 0.0)))
    move = pp.plan_linear(pp.CollisionChecker(arm, pp.Scene([wall])), (0.4, 0.0), pp.pose((-0.9, 0.0, 0.0)))
    assert move.status is LinearStatus.CONTACT
    assert move.fraction == 0.0


def test_a_thin_plate_across_the_line_is_not_missed() -> None:
    arm = ball_arm(("x", "y"))
    plate = pp.Obstacle("plate", pp.Box(0.0005, 1.0, 1.0), pp.pose((0.013, 0.0, 0.0)))
    move = pp.plan_linear(pp.CollisionChecker(arm, pp.Scene([plate])), (-0.6, 0.0), pp.pose((0.9, 0.0, 0.0)))
    assert move.status is LinearStatus.CONTACT


@pytest.mark.parametrize("bound", [0.05, 0.3])
def test_joint_steps_between_solved_poses_are_bounded(ur5: pp.Arm, free: pp.CollisionChecker, bound: float) -> None:
    target = _moved(ur5, READY, (0.1, 0.25, 0.1))
    move = pp.plan_linear(free, READY, target, max_joint_step=bound).or_raise()
    assert np.abs(np.diff(move.path.q, axis=0)).max() <= bound


def test_past_the_shoulder_axis_without_a_jump(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    # The wrist passes outside the shoulder's offset.
    target = _moved(ur5, READY, (-0.75, 0.05, 0.0))
    move = pp.plan_linear(free, READY, target)
    _assert_follows(move, free, READY, target, 1e-3, 1e-2)
    assert np.abs(np.diff(move.path(np.linspace(0, 1, 20_001)), axis=0)).max() < 1e-3


def test_through_the_shoulder_axis_is_an_honest_no(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    # The wrist cannot come nearer to the shoulder's axis than the arm's offset: the line ends at a singularity.
    move = pp.plan_linear(free, READY, _moved(ur5, READY, (-0.75, -0.2, 0.2)))
    assert move.status is LinearStatus.UNREACHABLE
    assert 0.5 < move.fraction < 0.6
    assert "singular value" in move.message


def test_same_question_same_answer(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    target = _moved(ur5, READY, (0.1, -0.1, -0.05))
    one, other = (pp.plan_linear(free, READY, target) for _ in range(2))
    assert one.path.q.tobytes() == other.path.q.tobytes()


@pytest.mark.parametrize(
    "name", ["deviation", "rotation_deviation", "translation_step", "rotation_step", "max_joint_step"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_settings_that_make_no_sense(ur5: pp.Arm, free: pp.CollisionChecker, name: str, value: float) -> None:
    with pytest.raises(pp.InputError, match=name):
        pp.plan_linear(free, READY, ur5.forward_kinematics(READY), **{name: value})


def test_infinite_settings_remove_their_limits(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    target = _moved(ur5, READY, (0.1, 0.25, 0.1))
    settings = dict.fromkeys(("deviation", "rotation_deviation", "max_joint_step"), np.inf)
    move = pp.plan_linear(free, READY, target, **settings).or_raise()
    assert len(move.path.q) <= len(pp.plan_linear(free, READY, target).or_raise().path.q)


def test_a_target_that_is_not_rigid(free: pp.CollisionChecker) -> None:
    with pytest.raises(pp.InputError, match="target"):
        pp.plan_linear(free, READY, np.zeros((4, 4)))


# -- other tasks, other arms ------------------------------------------------------------------------------------------


def test_the_reported_deviation_is_a_bound(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    target = _moved(ur5, READY, (0.1, 0.25, 0.1), (0, 0.4, 0.3))
    for deviation in (1e-2, 1e-3, 1e-5):
        move = pp.plan_linear(free, READY, target, deviation=deviation).or_raise()
        first = ur5.forward_kinematics(READY)
        off = [twist_size(interpolate(first, target, s), ur5.forward_kinematics(move.path(s)))[0]
               for s in np.linspace(0, 1, 1501)]  # fmt: skip
        assert max(off) <= move.deviation <= deviation


def test_an_arm_of_few_joints_keeps_its_tip_on_the_line() -> None:
    arm = pp.load_robot("ur5").arm(tcp="wrist_1_link")
    checker = pp.CollisionChecker(arm)
    start = READY[:4]
    target = _moved(arm, start, (0.05, 0.1, 0.1))
    assert not pp.plan_linear(checker, start, target).ok  # it cannot keep its orientation
    move = pp.plan_linear(checker, start, target, task="position").or_raise()
    a, b = arm.forward_kinematics(start).translation, target.translation
    for s in np.linspace(0, 1, 301):
        assert np.linalg.norm(arm.forward_kinematics(move.path(s)).translation - (a + s * (b - a))) <= move.deviation


def test_a_free_spin_rotates_the_axis_by_the_smallest_angle(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    target = _moved(ur5, READY, (0.05, 0.1, 0.0), (0.3, 0.0, 2.9))
    move = pp.plan_linear(free, READY, target, task="spin_z").or_raise()
    first, last = (ur5.forward_kinematics(q) for q in (READY, move.path.end))
    assert np.linalg.norm(last.translation - target.translation) < 2e-6
    assert np.linalg.norm(last.rotation[:, 2] - target.rotation[:, 2]) < 2e-6
    a, b = first.rotation[:, 2], target.rotation[:, 2]
    normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    for s in np.linspace(0, 1, 201):
        axis = ur5.forward_kinematics(move.path(s)).rotation[:, 2]
        assert abs(axis @ normal) <= move.rotation_deviation + 1e-9  # in the plane of both
    assert np.abs(move.path.end - move.path.start).max() < 1.0  # no need to spin by 2.9


def test_orientation_alone_may_go_anywhere(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    target = _moved(ur5, READY, (5.0, 5.0, 5.0), (0.3, 0.2, 0.5))  # far out of reach, but who asks
    move = pp.plan_linear(free, READY, target, task="orientation").or_raise()
    assert twist_size(ur5.forward_kinematics(move.path.end), target)[1] < 2e-6


def test_a_scara_has_no_tilt_to_give() -> None:
    arm = pp.load_robot("scara").arm()
    checker = pp.CollisionChecker(arm)
    start = arm.home + 0.2
    target = _moved(arm, start, (-0.05, 0.05, 0.03), (0, 0, 0.4))
    _assert_follows(pp.plan_linear(checker, start, target), checker, start, target, 1e-3, 1e-2)
    assert not pp.plan_linear(checker, start, _moved(arm, start, (0, 0, 0), (0.3, 0, 0))).ok


def test_a_prismatic_arm() -> None:
    arm = pp.load_robot("stanford").arm()
    checker = pp.CollisionChecker(arm)
    start = arm.home.copy()
    start[4] = 0.8  # away from the wrist's singularity
    target = _moved(arm, start, (0.03, 0.05, 0.02), (0, 0.1, 0.2))
    _assert_follows(pp.plan_linear(checker, start, target), checker, start, target, 1e-3, 1e-2)


def test_a_redundant_arm_moves_smoothly_all_along(panda: pp.Arm) -> None:
    checker = pp.CollisionChecker(panda)
    move = pp.plan_linear(checker, panda.home, _moved(panda, panda.home, (0.1, 0.25, 0.05), (0, 0, 0.5))).or_raise()
    rate = np.diff(move.path(np.linspace(0, 1, 2001)), axis=0) * 2000
    assert np.abs(np.diff(rate, axis=0)).max() < 0.02 * np.abs(rate).max()  # no kink
    assert np.abs(np.diff(rate, axis=0)).sum(axis=0).max() < 6 * np.abs(rate).max()  # and no wobble


def test_a_redundant_arm_moves_along_a_joint_limit() -> None:
    # The shortest path of the seven joints leads the second one to its limit; there is another.
    arm = pp.load_robot("iiwa14").arm()
    start = np.array([0.07, 1.887, -2.112, 1.879, -1.117, -0.321, 2.002])
    target = pp.pose((0.123, 0.53, -0.146), (-2.727, 0.912, -0.141))
    checker = pp.CollisionChecker(arm)
    move = pp.plan_linear(checker, start, target)
    _assert_follows(move, checker, start, target, 1e-3, 1e-2)
    assert arm.limits.upper[1] - move.path(np.linspace(0, 1, 500))[:, 1].max() < 3e-3


def test_inward_from_a_stretched_arm() -> None:
    # Elbow straight: a singularity that hides the very direction asked for.
    arm = pp.load_robot("ur5").arm(tcp="wrist_1_link")
    start = np.array([0.0, -0.7, 0.0, 0.0])
    checker = pp.CollisionChecker(arm)
    assert np.linalg.svd(arm.jacobian(start)[:3], compute_uv=False)[-1] < 1e-6
    here = arm.forward_kinematics(start).translation
    shoulder = arm.forward_kinematics(np.array([0.0, -0.7, np.pi, 0.0])).translation
    target = pp.pose(here + 0.1 * (shoulder - here) / np.linalg.norm(shoulder - here))
    move = pp.plan_linear(checker, start, target, task="position", deviation=2e-3)
    assert np.linalg.norm(arm.forward_kinematics(move.or_raise().path.end).translation - target.translation) < 2e-6


def test_a_continuous_joint_moves_beyond_pi() -> None:
    arm = pp.load_robot("kinova").arm()
    assert np.isinf(arm.limits.upper).any()
    start = arm.home.copy()
    start[-1] = 3.0
    checker = pp.CollisionChecker(arm)
    ends = []
    for turn in (0.6, -0.6):
        move = pp.plan_linear(checker, start, _moved(arm, start, rpy=(0, 0, turn))).or_raise()
        assert np.abs(np.diff(move.path.q, axis=0)).max() <= 0.3
        ends.append(move.path.end[-1])
    assert max(ends) > np.pi


@pytest.mark.parametrize("task", [pp.ik.IkTask(x=False), pp.ik.IkTask(rx=False, ry=False), "nonsense"])
def test_a_task_that_no_line_leads_to_is_refused(ur5: pp.Arm, free: pp.CollisionChecker, task: object) -> None:
    with pytest.raises(pp.PinproofError):
        pp.plan_linear(free, READY, ur5.forward_kinematics(READY), task=task)


@pytest.mark.parametrize("gap", [1e-7, -1e-4])
def test_a_line_stops_where_it_is_no_longer_proven(gantry: pp.Arm, gap: float) -> None:
    """A small ball is beside the line; whether it is touched is not decided at 0.1 um."""
    post = pp.Obstacle("post", pp.Sphere(0.01), pp.pose((0.09, 0.06 + gap, 0)))
    checker = pp.CollisionChecker(gantry, pp.Scene([post]))
    path = pp.JointPath([(-0.4, 0.0), (0.4, 0.0)], gantry.joint_names)
    certificate = pp.certify(path, checker)
    status, until = cartesian._stop(certificate)
    if gap > 0:
        assert (status, until) == (LinearStatus.UNDECIDED, certificate.undecided.start)
    else:
        assert (status, until) == (LinearStatus.CONTACT, certificate.first_contact.proven_free_until)
    assert 0.45 < until < 0.49 / 0.8
    assert checker.is_free_batch(path(np.linspace(0.0, until, 500))).all()


def test_the_reason_of_a_stop_is_that_of_the_task() -> None:
    """Four joints reach the next position with a larger step, but not the next pose."""
    arm = pp.load_robot("ur5").arm(tcp="wrist_1_link")
    start = READY[:4]
    route = Route.straight(arm.forward_kinematics(start), _moved(arm, start, (0.05, 0.1, 0.1)))
    settings = {"deviation": 1e-3, "rotation_deviation": 1e-2, "translation_step": 0.05, "rotation_step": 0.2}
    statuses = []
    for task in (IkTask(rx=False, ry=False, rz=False), IkTask()):
        follower = RouteFollower(arm=arm, task=task, max_joint_step=0.3, **settings)
        statuses.append(follower._reason(route, 0.0, 0.3, start, np.zeros(4, dtype=bool))[0])
    assert statuses == [LinearStatus.JUMP, LinearStatus.UNREACHABLE]
