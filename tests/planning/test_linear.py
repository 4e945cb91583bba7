"""Straight moves: on the lines, inside limits, proven; or where they stop and why."""

import numpy as np
import pytest

import pinproof as pp
from pinproof.ik import IkTask
from pinproof.planning import LinearStatus, Route, RouteFollower, cartesian
from pinproof.spatial import interpolate, twist_size

from .arms import assert_free

READY = np.array([0.0, -1.3, 1.9, -2.17, -1.57, 0.0])
"""A UR5 with its tool above the table, pointing down."""


def moved(arm, q, xyz=(0, 0, 0), rpy=(0, 0, 0)):
    """The tcp's pose at q, shifted in the base's axes and turned in its own."""
    pose = arm.forward_kinematics(q) * pp.pose((0, 0, 0), rpy)
    pose.translation = pose.translation + np.array(xyz)
    return pose


def off_the_line(arm, start, target, path, shares=997):
    """(N, 2) distances (m) and angles (rad) of the tcp from the line at equal shares."""
    first, s = arm.forward_kinematics(start), np.linspace(0, 1, shares)
    return np.array([twist_size(interpolate(first, target, x), arm.forward_kinematics(path(x))) for x in s])


def assert_follows(move, checker, start, target, metres=1e-3, radians=1e-2):
    arm, path = checker.arm, move.or_raise().path
    assert np.array_equal(path.start, start)
    assert max(twist_size(arm.forward_kinematics(path.end), target)) < 2e-6
    assert (move.status, move.fraction) == (LinearStatus.COMPLETE, 1.0)
    assert move.certificate.matches(path, arm, checker.scene)
    assert_free(path, checker)
    assert (off_the_line(arm, start, target, path).max(axis=0) <= [metres, radians]).all()
    assert (move.deviation <= metres, move.rotation_deviation <= radians) == (True, True)


@pytest.mark.parametrize(
    ("xyz", "rpy"),
    [
        ((0, 0, 0.15), (0, 0, 0)), ((0.1, -0.1, -0.05), (0, 0, 0)), ((-0.15, 0.2, 0.0), (0, 0, 0)),
        ((0, 0, 0), (0, 0, 1.0)), ((0, 0, 0), (0.4, 0, 0)), ((0, 0, 0), (0.2, -0.3, 0.5)), ((0, 0, 0), (0, 0, np.pi)),
        ((-0.75, 0.05, 0.0), (0, 0, 0)),  # the wrist passes outside the shoulder's offset
    ],
)  # fmt: skip
def test_translations_rotations_and_lines_past_the_shoulder_are_followed_without_a_jump(ur5, free, xyz, rpy):
    target = moved(ur5, READY, xyz, rpy)
    move = pp.plan_linear(free, READY, target)
    assert_follows(move, free, READY, target)
    if rpy[2] == np.pi:
        assert abs(move.path.end - move.path.start).max() == pytest.approx(np.pi, abs=1e-5)
    assert np.abs(np.diff(move.path(np.linspace(0, 1, 20_001)), axis=0)).max() < 1e-3
    again = pp.plan_linear(free, READY, target)
    assert again.path.q.tobytes() == move.path.q.tobytes()


@pytest.mark.parametrize(
    ("name", "change", "xyz", "rpy"),
    [
        ("panda", {}, (0.1, 0.1, -0.2), (0, 0, 0)),
        ("stanford", {4: 0.8}, (0.03, 0.05, 0.02), (0, 0.1, 0.2)),  # away from the wrist's singularity
        ("scara", {0: 0.2, 1: 0.2, 2: 0.2, 3: 0.2}, (-0.05, 0.05, 0.03), (0, 0, 0.4)),
    ],
)
def test_other_arms_follow_lines(name, change, xyz, rpy):
    arm = pp.load_robot(name).arm()
    checker, start = pp.CollisionChecker(arm), arm.home.copy()
    for joint, value in change.items():
        start[joint] = value + (arm.home[joint] if name == "scara" else 0.0)
    target = moved(arm, start, xyz, rpy)
    assert_follows(pp.plan_linear(checker, start, target), checker, start, target)
    if name == "scara":  # which has no tilt to give
        assert not pp.plan_linear(checker, start, moved(arm, start, (0, 0, 0), (0.3, 0, 0))).ok


def test_a_tighter_deviation_holds_and_the_reported_one_is_a_bound(ur5, free):
    target = moved(ur5, READY, (0.1, 0.15, 0.1), (0, 0, 0.5))
    wide = {"translation_step": 0.2, "rotation_step": 1.0}
    loose = pp.plan_linear(free, READY, target, **wide, deviation=1e-2)
    tight = pp.plan_linear(free, READY, target, **wide, deviation=2e-6)
    assert len(tight.path.knots) > len(loose.path.knots)
    assert_follows(tight, free, READY, target, 2.5e-6)
    target = moved(ur5, READY, (0.1, 0.15, 0.1), (0.2, -0.3, 0.5))
    coarse = {"translation_step": 1.0, "rotation_step": 1.0, "deviation": 1.0, "max_joint_step": 1.0}
    loose = pp.plan_linear(free, READY, target, **coarse, rotation_deviation=1.0)
    assert loose.or_raise().rotation_deviation > 1e-3
    tight = pp.plan_linear(free, READY, target, **coarse, rotation_deviation=1e-4)
    assert_follows(tight, free, READY, target, 1.0, 1.2e-4 + 1e-6)
    target = moved(ur5, READY, (0.1, 0.25, 0.1), (0, 0.4, 0.3))
    for deviation in (1e-2, 1e-3, 1e-5):
        move = pp.plan_linear(free, READY, target, deviation=deviation).or_raise()
        assert off_the_line(ur5, READY, target, move.path, 701)[:, 0].max() <= move.deviation <= deviation


def test_start_is_target(ur5, free):
    move = pp.plan_linear(free, READY, ur5.forward_kinematics(READY)).or_raise()
    assert (move.status, move.fraction) == (LinearStatus.COMPLETE, 1.0)
    assert np.abs(move.path(np.linspace(0, 1, 50)) - READY).max() < 1e-6


@pytest.mark.parametrize("bound", [0.05, 0.3, np.inf])
def test_joint_steps_between_solved_poses_are_bounded_unless_the_bound_is_infinite(ur5, free, bound):
    target = moved(ur5, READY, (0.1, 0.25, 0.1))
    without = {"deviation": np.inf, "rotation_deviation": np.inf} if np.isinf(bound) else {}
    move = pp.plan_linear(free, READY, target, max_joint_step=bound, **without).or_raise()
    assert np.abs(np.diff(move.path.q, axis=0)).max() <= bound
    assert len(move.path.q) <= len(pp.plan_linear(free, READY, target).or_raise().path.q) or bound < 0.3


# -- where a move stops ------------------------------------------------------------------------------------------------


def test_what_is_out_of_reach_is_reported_with_fraction_and_reason(ur5, free, generic):
    move = pp.plan_linear(free, READY, moved(ur5, READY, (1.0, 0, 0)))
    assert (move.status, move.ok) == (LinearStatus.UNREACHABLE, False)
    assert 0.2 < move.fraction < 0.6
    for words in ("mm", "short", "singular value"):
        assert words in move.message
    with pytest.raises(pp.errors.PlanFailed, match="of the line"):
        move.or_raise()
    # The wrist cannot come nearer to the shoulder's axis than the arm's offset: the line ends at a singularity.
    move = pp.plan_linear(free, READY, moved(ur5, READY, (-0.75, -0.2, 0.2)))
    assert (move.status, "singular value" in move.message) == (LinearStatus.UNREACHABLE, True)
    assert 0.5 < move.fraction < 0.6
    stretched = np.array([0, 0, 0, 0, 0.7, 0])  # the wrist bent, shoulder and elbow in one line
    move = pp.plan_linear(pp.CollisionChecker(generic), stretched, moved(generic, stretched, (0.1, 0, 0)))
    assert (move.status, move.fraction) == (LinearStatus.UNREACHABLE, 0.0)
    assert "stops at 0 %" in move.message


def box(name, sides, at):
    return pp.Obstacle(name, pp.Box(*sides), pp.pose((*at, 0.0)))


@pytest.mark.parametrize(
    ("obstacle", "start", "goal", "status", "fraction", "words"),
    [
        (None, (0.5, 0.0), (0.5, 1.4), "LIMIT", 1.0 / 1.4, "y at the limit"),
        (None, (1.5, 0.0), (0.5, 0.0), "LIMIT", 0.0, "x = 1.5"),
        # the ball's face at the wall's
        (box("wall", (0.1, 1.0, 1.0), (0.407, 0.0)), (-0.6, 0.0), (0.9, 0.0), "CONTACT", 0.907 / 1.5, "wall"),
        # before the limit
        (box("wall", (1.0, 0.1, 1.0), (0.0, 0.507)), (0.0, 0.0), (0.0, 1.4), "CONTACT", 0.407 / 1.4, "wall"),
        (box("wall", (0.1, 1.0, 1.0), (0.4, 0.0)), (0.4, 0.0), (-0.9, 0.0), "CONTACT", 0.0, "wall"),
        (box("plate", (0.0005, 1.0, 1.0), (0.013, 0.0)), (-0.6, 0.0), (0.9, 0.0), "CONTACT", 0.56275 / 1.5, "plate"),
    ],
)
def test_limits_and_contacts_are_named_where_they_stop_a_move(gantry, obstacle, start, goal, status, fraction, words):
    checker = pp.CollisionChecker(gantry, pp.Scene([] if obstacle is None else [obstacle]))
    move = pp.plan_linear(checker, start, pp.pose((*goal, 0.0)))
    assert (move.status.name, move.ok) == (status, False)
    assert words in move.message
    assert move.fraction == pytest.approx(fraction, abs=0.02 if status == "LIMIT" else 1e-3)
    if status == "LIMIT":
        assert move.joints == (words[0],)
    else:
        assert move.fraction <= fraction
        assert move.certificate is None or move.certificate.status is pp.CertificateStatus.COLLIDING


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_a_line_of_which_a_share_is_wanted_has_the_same_outcome_without_the_work_for_less(robot):
    """The lines of random lengths from random configurations: those that are wanted are the same to the last bit."""
    arm, rng, failed = pp.load_robot(robot).arm(), np.random.default_rng(3), 0
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("wall", pp.Box(2.0, 0.02, 2.0), pp.pose((0, 0.5, 0)))]))
    starts = rng.uniform(*arm.limits.sampling_range(), (400, arm.dof))
    for start in starts[checker.is_free_batch(starts)][:120]:
        target = moved(arm, start, rng.normal(0, 0.15, 3), rng.normal(0, 0.3, 3))
        complete = pp.plan_linear(checker, start, target)
        for least in (0.3, 1.0):
            quick = pp.plan_linear(checker, start, target, least=least)
            assert quick.ok is complete.ok
            if complete.ok:
                assert quick.path.q.tobytes() == complete.path.q.tobytes()
            elif complete.fraction >= least:
                assert (quick.fraction, quick.message) == (complete.fraction, complete.message)
            else:
                failed += 1
                assert quick.fraction <= least
    assert failed > 20


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_ends_of_many_lines_are_those_of_each_line(robot):
    arm, rng = pp.load_robot(robot).arm(), np.random.default_rng(5)
    follower = RouteFollower(arm=arm)
    starts = rng.uniform(*arm.limits.sampling_range(), (80, arm.dof))
    targets = [moved(arm, start, rng.normal(0, 0.15, 3), rng.normal(0, 0.3, 3)) for start in starts]
    ends = follower.ends_of_lines(starts, np.array([target.homogeneous for target in targets]))
    complete = 0
    for start, target, end in zip(starts, targets, ends, strict=True):
        followed = follower.follow(Route.straight(arm.forward_kinematics(start), target), start)
        assert (followed.fraction == 1.0) == np.isfinite(end).all()
        if followed.fraction == 1.0:
            assert np.allclose(end, followed.path.end, atol=1e-7)
            complete += 1
    assert 10 < complete < 70


def test_a_start_within_rounding_of_its_limit_starts_at_the_limit(gantry):
    move = pp.plan_linear(pp.CollisionChecker(gantry), (1 + 5e-10, 0.0), pp.pose((0.5, 0.0, 0.0)))
    assert move.status is LinearStatus.COMPLETE
    assert move.path.q[0].tolist() == [1.0, 0.0]


def test_a_joint_that_would_have_to_go_round_is_at_its_limit(ur5, free):
    # One joint more than this it may not turn; the same pose is reached a whole turn back.
    start = READY.copy()
    start[5] = ur5.limits.upper[5] - 0.3
    move = pp.plan_linear(free, start, moved(ur5, start, rpy=(0, 0, 1.0)))
    assert (move.status, move.joints) == (LinearStatus.LIMIT, ("wrist_3_joint",))
    assert 0.1 < move.fraction < 0.31
    assert ("wrist_3_joint" in move.message, "limit" in move.message) == (True, True)


def test_the_curve_keeps_the_limits_between_the_solved_poses(ur5, free):
    target = moved(ur5, READY, (0.0, -0.5, 0.0))
    coarse = {"translation_step": 1.0, "deviation": 0.2, "max_joint_step": 2.0}
    path = pp.plan_linear(free, READY, target, **coarse).or_raise().path
    seen, between = path.q.max(axis=0), path(np.linspace(0, 1, 1001)).max(axis=0)
    joint = int((between - seen).argmax())
    assert between[joint] > seen[joint] + 1e-3  # the joint turns back between two solved poses
    name, upper = ur5.joint_names[joint], (between[joint] + seen[joint]) / 2
    limits = ur5.limits.replace(ur5.joint_names, {name: (ur5.limits.lower[joint], upper)})
    move = pp.plan_linear(pp.CollisionChecker(ur5.with_limits(limits)), READY, target, **coarse)
    assert (move.status, move.joints) == (LinearStatus.LIMIT, (name,))
    assert name in move.message


@pytest.mark.parametrize("gap", [1e-7, -1e-4])
def test_a_line_stops_where_it_is_no_longer_proven(gantry, gap):
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


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        *(
            ({name: value}, name)
            for name in ("deviation", "rotation_deviation", "translation_step", "rotation_step", "max_joint_step")
            for value in (0.0, -1.0, float("nan"))
        ),
        ({"target": np.zeros((4, 4))}, "target"),
        *(({"task": task}, "task|Task|select") for task in (IkTask(x=False), IkTask(rx=False, ry=False), "nonsense")),
    ],
)
def test_settings_that_make_no_sense(ur5, free, settings, named):
    here = ur5.forward_kinematics(READY)
    with pytest.raises(pp.InputError, match=named):
        pp.plan_linear(free, READY, **{"target": here, **settings})


# -- other tasks, other arms -------------------------------------------------------------------------------------------


def test_an_arm_of_few_joints_keeps_its_tip_on_the_line_and_the_reason_of_a_stop_is_that_of_the_task():
    arm = pp.load_robot("ur5").arm(tcp="wrist_1_link")
    checker, start = pp.CollisionChecker(arm), READY[:4]
    target = moved(arm, start, (0.05, 0.1, 0.1))
    assert not pp.plan_linear(checker, start, target).ok  # it cannot keep its orientation
    move = pp.plan_linear(checker, start, target, task="position").or_raise()
    a, b, s = arm.forward_kinematics(start).translation, target.translation, np.linspace(0, 1, 301)
    places = arm.forward_kinematics_batch(move.path(s))[:, :3, 3]
    assert np.linalg.norm(places - (a + s[:, None] * (b - a)), axis=1).max() <= move.deviation
    # The four joints reach the next position with a larger step, but not the next pose.
    route = Route.straight(arm.forward_kinematics(start), target)
    for task, status in (
        (IkTask(rx=False, ry=False, rz=False), LinearStatus.JUMP),
        (IkTask(), LinearStatus.UNREACHABLE),
    ):
        follower = RouteFollower(arm=arm, task=task)
        assert follower._reason(route, 0.0, 0.3, start, np.zeros(4, dtype=bool))[0] is status


def test_a_free_spin_rotates_the_axis_by_the_smallest_angle(ur5, free):
    target = moved(ur5, READY, (0.05, 0.1, 0.0), (0.3, 0.0, 2.9))
    move = pp.plan_linear(free, READY, target, task="spin_z").or_raise()
    first, last = (ur5.forward_kinematics(q) for q in (READY, move.path.end))
    assert np.linalg.norm(last.translation - target.translation) < 2e-6
    a, b = first.rotation[:, 2], target.rotation[:, 2]
    assert np.linalg.norm(last.rotation[:, 2] - b) < 2e-6
    normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    axes = ur5.forward_kinematics_batch(move.path(np.linspace(0, 1, 201)))[:, :3, 2]
    assert np.abs(axes @ normal).max() <= move.rotation_deviation + 1e-9  # in the plane of both
    assert np.abs(move.path.end - move.path.start).max() < 1.0  # no need to spin by 2.9


def test_orientation_alone_may_go_anywhere(ur5, free):
    target = moved(ur5, READY, (5.0, 5.0, 5.0), (0.3, 0.2, 0.5))  # far out of reach, but who asks
    move = pp.plan_linear(free, READY, target, task="orientation").or_raise()
    assert twist_size(ur5.forward_kinematics(move.path.end), target)[1] < 2e-6


def test_a_redundant_arm_moves_smoothly_all_along(panda):
    target = moved(panda, panda.home, (0.1, 0.25, 0.05), (0, 0, 0.5))
    move = pp.plan_linear(pp.CollisionChecker(panda), panda.home, target).or_raise()
    rate = np.diff(move.path(np.linspace(0, 1, 2001)), axis=0) * 2000
    assert np.abs(np.diff(rate, axis=0)).max() < 0.02 * np.abs(rate).max()  # no kink
    assert np.abs(np.diff(rate, axis=0)).sum(axis=0).max() < 6 * np.abs(rate).max()  # and no wobble


def test_a_redundant_arm_moves_along_a_joint_limit():
    # The shortest path of the seven joints leads the second one to its limit; there is another.
    arm = pp.load_robot("iiwa14").arm()
    start = np.array([0.07, 1.887, -2.112, 1.879, -1.117, -0.321, 2.002])
    target, checker = pp.pose((0.123, 0.53, -0.146), (-2.727, 0.912, -0.141)), pp.CollisionChecker(arm)
    move = pp.plan_linear(checker, start, target)
    assert_follows(move, checker, start, target)
    assert arm.limits.upper[1] - move.path(np.linspace(0, 1, 500))[:, 1].max() < 3e-3


def test_inward_from_a_stretched_arm():
    # Elbow straight: a singularity that hides the very direction asked for.
    arm, start = pp.load_robot("ur5").arm(tcp="wrist_1_link"), np.array([0.0, -0.7, 0.0, 0.0])
    assert np.linalg.svd(arm.jacobian(start)[:3], compute_uv=False)[-1] < 1e-6
    here, shoulder = (arm.forward_kinematics(q).translation for q in (start, [0, -0.7, np.pi, 0]))
    target = pp.pose(here + 0.1 * (shoulder - here) / np.linalg.norm(shoulder - here))
    move = pp.plan_linear(pp.CollisionChecker(arm), start, target, task="position", deviation=2e-3)
    assert np.linalg.norm(arm.forward_kinematics(move.or_raise().path.end).translation - target.translation) < 2e-6


def test_a_continuous_joint_moves_beyond_pi():
    arm = pp.load_robot("kinova").arm()
    assert np.isinf(arm.limits.upper).any()
    start, checker, ends = np.array([*arm.home[:-1], 3.0]), pp.CollisionChecker(arm), []
    for turn in (0.6, -0.6):
        move = pp.plan_linear(checker, start, moved(arm, start, rpy=(0, 0, turn))).or_raise()
        assert np.abs(np.diff(move.path.q, axis=0)).max() <= 0.3
        ends.append(move.path.end[-1])
    assert max(ends) > np.pi
