"""Plans among moving obstacles: each is certified, and audited at dense samples in space and time."""

from functools import cache

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import audit
from pinproof.errors import PlanFailed
from pinproof.planning import PlanStatus, plan_among_movers

STEP = 0.01
"""rad or m between the samples of an audit."""


@cache
def ur5():
    return pp.load_robot("ur5").arm(tcp="tool0")


def reaching(arm, *poses):
    """For each pose the solution nearest to the one before, beginning with the first of the first pose."""
    found = [pp.AnalyticIk().solve_all(arm, poses[0]).q[0]]
    for pose in poses[1:]:
        many = pp.AnalyticIk().solve_all(arm, pose).q
        found.append(many[np.abs(many - found[-1]).max(axis=1).argmin()])
    return found


def down(x, y, z):
    return pp.pose((x, y, z), (np.pi, 0, 0))


def checked(result, checker, movers, start=0.0):
    """The motion of a plan, after independent checks of its certificate, its limits and its contacts."""
    motion = result.or_raise().trajectory
    seen = [mover.after(start) for mover in movers]
    assert pp.certify(motion, checker, movers=seen).status is pp.CertificateStatus.FREE
    assert audit(motion, checker, step=STEP, measure=False, movers=seen).clean
    limits = checker.group.limits
    assert (motion.max_velocity() <= limits.velocity * (1 + 1e-9)).all()
    assert (motion.max_acceleration() <= limits.acceleration * (1 + 1e-6)).all()
    assert not motion.velocities[[0, -1]].any()
    return motion


def opening(name, obstacle, begins, travel=0.8):
    """A door that opens upwards from a time on, within a second."""
    rest = pp.Trajectory([0.0, begins, begins + 1.0], [[0.0], [0.0], [travel]], np.zeros((3, 1)), [name])
    return pp.Mover(name, (obstacle,), rest, axis=(0, 0, 1), rests=True)


def behind_a_door():
    boxes = {
        "wall_left": ((0.04, 1.0, 1.4), (0.35, 0.75, 0.4)),
        "wall_right": ((0.04, 1.0, 1.4), (0.35, -0.75, 0.4)),
        "lintel": ((0.04, 2.5, 0.8), (0.35, 0, 1.4)),
        "sill": ((0.04, 2.5, 0.2), (0.35, 0, 0.0)),
        "door": ((0.02, 0.6, 0.9), (0.38, 0, 0.55)),
    }
    scene = pp.Scene([pp.Obstacle(name, pp.Box(*sides), pp.pose(at)) for name, (sides, at) in boxes.items()])
    arm = ur5()
    forward = pp.pose((0.6, 0.1, 0.5), (0, np.pi / 2, 0))
    still = pp.CollisionChecker(arm, scene.remove("door"), margin=0.002)
    goals = pp.AnalyticIk().solve_all(arm, forward).q
    return pp.CollisionChecker(arm, scene, margin=0.002), goals[still.is_free_batch(goals)]


@pytest.mark.slow
def test_arm_waits_until_a_door_opens_and_reaches_its_goal_within_the_window():
    checker, goals = behind_a_door()
    start = np.array([0.0, -2.2, 2.2, -1.57, -1.57, 0.0])
    door = opening("opening", "door", 3.0)
    result = plan_among_movers(checker, start, goals, [door])
    motion = checked(result, checker, [door])
    assert 3.0 < motion.duration < 7.0
    assert result.waiting > 1.0
    assert 0 <= result.goal < len(goals)
    # the same seed gives the same motion, and a later start waits less by the difference
    assert plan_among_movers(checker, start, goals, [door]).trajectory.digest() == motion.digest()
    later = plan_among_movers(checker, start, goals, [door], start_time=2.0)
    assert checked(later, checker, [door], 2.0).duration < motion.duration - 1.5

    # the goal is reached within its window, or the reason is given
    late = plan_among_movers(checker, start, goals, [door], window=(8.0, 9.0))
    assert checked(late, checker, [door]).duration == pytest.approx(8.0)
    early = plan_among_movers(checker, start, goals, [door], window=(0.0, 2.5), samples=40)
    assert early.status in (PlanStatus.OUT_OF_BUDGET, PlanStatus.GOAL_INVALID)
    assert not early.ok


@pytest.mark.slow
def test_arm_passes_between_the_posts_of_a_rotary_table():
    arm = ur5()
    angles = np.arange(4) * np.pi / 2
    posts = [
        pp.Obstacle(f"post{k}", pp.Box(0.08, 0.08, 0.5), pp.pose((0.55 + 0.2 * np.cos(a), 0.2 * np.sin(a), 0.25)))
        for k, a in enumerate(angles)
    ]
    checker = pp.CollisionChecker(arm, pp.Scene(posts), margin=0.002)
    start, goal = reaching(arm, down(0.5, -0.5, 0.15), down(0.5, 0.5, 0.15))
    table = pp.Mover.constant(
        "table", [post.name for post in posts], 0.6, 60.0, type="revolute", axis=(0, 0, 1), point=(0.55, 0, 0)
    )
    direct = pp.time_parametrise(pp.JointPath(np.array([start, goal]), arm.joint_names), arm.limits)
    assert pp.certify(direct, checker, movers=[table]).status is pp.CertificateStatus.COLLIDING
    checked(plan_among_movers(checker, start, goal, [table], rng=1), checker, [table])


@pytest.mark.slow
def test_arm_keeps_clear_of_another_arm_on_its_trajectory():
    facing = pp.pose((0.9, 0, 0), (0, 0, np.pi))
    cell = pp.assemble({"a": (ur5(), np.eye(4)), "b": (ur5(), facing)})
    names = [f"b/{name}" for name in ur5().joint_names]
    over, aside = reaching(ur5(), down(0.45, 0.0, 0.3), down(0.45, 0.4, 0.3))
    # where it is held otherwise does not matter, and is at the goal here
    arm = cell.arms["a"].with_held(dict(zip(names, over.tolist(), strict=True)))
    checker = pp.CollisionChecker(arm, margin=0.005)
    # the other arm is over the middle for two seconds, and then moves aside
    there = pp.time_parametrise(pp.JointPath(np.array([over, aside]), names), ur5().limits)
    parts = [rest(over, 2.0, names), there, rest(aside, 30.0, names)]
    crossing = pp.Trajectory.join(*parts)
    start, goal = reaching(ur5(), down(0.45, -0.4, 0.3), down(0.45, 0.0, 0.3))
    direct = pp.time_parametrise(pp.JointPath(np.array([start, goal]), cell.arms["a"].joint_names), ur5().limits)
    assert pp.certify(direct, checker, movers=[crossing]).status is pp.CertificateStatus.COLLIDING
    motion = checked(plan_among_movers(checker, start, goal, [crossing]), checker, [crossing])
    assert motion.duration > 2.0


def rest(q, duration, names):
    return pp.Trajectory([0.0, duration], np.array([q, q]), np.zeros((2, len(q))), names)


def wall_of(speed, duration=60.0):
    wall = pp.Obstacle("wall", pp.Box(3.0, 0.05, 3.0), pp.pose((0, -1.5, 0)))
    checker = pp.CollisionChecker(ur5(), pp.Scene([wall]))
    return checker, pp.Mover.constant("wall_drive", ["wall"], speed, duration, axis=(0, 1, 0))


@pytest.mark.slow
def test_reason_names_what_drives_the_arm_from_its_start_if_no_waiting_place_is_free():
    checker, drive = wall_of(0.5)
    (start,) = reaching(ur5(), down(0.1, -0.5, 0.3))
    (goal,) = reaching(ur5(), down(0.1, 0.6, 0.3))
    result = plan_among_movers(checker, start, goal, [drive], window=(8.0, 10.0), samples=80)
    assert result.status in (PlanStatus.GOAL_INVALID, PlanStatus.OUT_OF_BUDGET)
    assert "wall" in result.message
    with pytest.raises(PlanFailed):
        result.or_raise()


def test_start_in_the_path_of_a_mover_is_invalid_at_that_time_only():
    checker, drive = wall_of(0.5)
    start, goal = reaching(ur5(), down(0.1, -0.5, 0.3), down(0.1, -0.45, 0.3))
    assert plan_among_movers(checker, start, goal, [drive]).ok
    blocked = plan_among_movers(checker, start, goal, [drive], start_time=2.0)
    assert blocked.status is PlanStatus.START_INVALID
    assert "wall" in blocked.message


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"window": (0.0, 8.0)}, "wall_drive"),
        ({"window": (3.0, 2.0)}, "window"),
        ({"start_time": 9.0}, "wall_drive ends at 5 s"),
        ({"start_time": -1.0}, "start_time"),
        ({"samples": -1}, "samples"),
        ({"movers": []}, "mover"),
        ({"movers": [3]}, "not int"),
        ({"movers": rest([0.0], 60.0, ["other"])}, "list"),
        ({"window": 3.0}, "window"),
        ({"samples": "few"}, "samples"),
    ],
)
def test_invalid_times_and_movers_are_refused(changes, named):
    checker, drive = wall_of(0.1, duration=5.0)
    (start,) = reaching(ur5(), down(0.1, 0.5, 0.3))
    with pytest.raises(pp.InputError, match=named):
        plan_among_movers(checker, start, start, **{"movers": [drive], **changes})


def test_mover_seen_from_a_later_start_is_the_same_motion():
    lift = opening("lift", "wall", 1.5)
    for time in (0.0, 1.0, 1.9, 4.0):
        seen = lift.after(time)
        assert seen.trajectory.duration == pytest.approx(max(lift.trajectory.duration - time, 0.0))
        at = np.linspace(0.0, seen.trajectory.duration, 7)
        expected = lift.trajectory(np.minimum(at + time, lift.trajectory.duration))
        assert np.abs(seen.trajectory(at) - expected).max() < 1e-12


def test_window_that_is_shorter_than_the_joints_need_is_reported():
    checker, drive = wall_of(0.1)
    start, goal = reaching(ur5(), down(0.1, 0.5, 0.3), down(0.1, 0.3, 0.3))
    result = plan_among_movers(checker, start, goal, [drive], window=(0.0, 0.01))
    assert result.status is PlanStatus.OUT_OF_BUDGET
    assert "window" in result.message


@pytest.mark.parametrize(
    ("gap", "status"),
    [(1e-4, "FREE"), (1e-7, "UNDECIDED"), (-1e-4, "COLLIDING")],
)
def test_a_motion_that_is_not_proven_is_not_returned(gantry, gap, status):
    """The straight motion passes a small ball between two samples; whether it touches it is not decided at 0.1 um."""
    start, goal = np.array([-0.4, 0.0]), np.array([0.4, 0.0])
    post = pp.Obstacle("post", pp.Sphere(0.01), pp.pose((0.09, 0.06 + gap, 0)))
    checker = pp.CollisionChecker(gantry, pp.Scene([post]))
    resting = pp.Mover("rest", ("post",), pp.Trajectory.at_rest([0.0], ["rest"], 30.0))
    direct = pp.time_parametrise(pp.JointPath([start, goal], gantry.joint_names), gantry.limits)
    assert pp.certify(direct, checker, movers=[resting]).status.name == status
    result = plan_among_movers(checker, start, goal, [resting], window=(0.0, 1.4), samples=40)
    assert result.ok == (status == "FREE")
    if result.ok:
        checked(result, checker, [resting])
    else:
        assert result.status is PlanStatus.OUT_OF_BUDGET


@pytest.mark.parametrize("slotted_door", [1, 2])
def test_a_ball_waits_before_a_slot_until_its_doors_are_open(gantry, slotted, slotted_door):
    """As early as the doors and the roadmap allow, with either order of the movers, and never through a door."""
    doors = [pp.Obstacle(f"door {k}", pp.Box(0.02, 0.3, 0.9), pp.pose((0.0, 0.6, 0.0))) for k in (1, 2)]
    checker = pp.CollisionChecker(gantry, slotted.add(*doors))
    start, goal = np.array([-0.5, 0.5]), np.array([0.5, 0.5])
    times = {f"door {k}": 6.0 if k == slotted_door else 3.0 for k in (1, 2)}
    movers = [opening(f"drive {name}", name, begins, travel=1.2) for name, begins in times.items()]
    result = plan_among_movers(checker, start, goal, movers, window=(0.0, 20.0), samples=80)
    motion = checked(result, checker, movers)
    # The door has to rise by the half of its height and the radius of the ball, which takes most of its second.
    times = np.linspace(0, motion.duration, 4000)
    crossing = float(np.interp(-0.06, motion(times)[:, 0], times))
    assert 6.4 < crossing < 7.5
    assert 6.4 < motion.duration < 9.0
    assert result.goal == 0
    assert result.waiting == pytest.approx(resting_time(motion), abs=0.02)
    goals = [[0.0, 0.6], goal]  # the first one is in a door until it opens
    assert plan_among_movers(checker, start, goals, movers, window=(0.0, 5.0), samples=40).ok is False
    later = plan_among_movers(checker, start, goals, movers, start_time=4.0, window=(9.0, 20.0), samples=80)
    assert checked(later, checker, movers, 4.0).duration == pytest.approx(5.0, abs=0.01)
    assert later.goal in (0, 1)


def resting_time(motion):
    """The time (s) at which a motion rests, from samples."""
    times = np.linspace(0.0, motion.duration, 20_001)
    return float((np.abs(motion.velocity(times)).max(axis=1) < 1e-6).mean() * motion.duration)
