"""Arms with given motions wait for each other; the motion of all is certified and audited."""

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import audit
from pinproof.motion import JointPath, separate
from pinproof.planning import coordinate, plan_arms


@pytest.fixture(scope="module")
def cell(ur5):
    return pp.assemble({"a": (ur5, np.eye(4)), "b": (ur5, pp.pose((1.1, 0, 0), (0, 0, np.pi)))})


def visit(cell, name, *, jerk=None):
    """The arm moves from the side to the middle between the robots and back."""
    arm = cell.arms[name]
    target = arm.root_from_base.inverse() * pp.pose((0.55, 0.0, 0.4), (np.pi, 0, 0))
    there = pp.AnalyticIk().solve_all(arm, target).q
    there = there[np.abs(there - arm.home).max(axis=1).argmin()]
    start = there.copy()
    start[0] += 1.2
    return pp.time_parametrise(JointPath(np.array([start, there, start]), arm.joint_names), arm.limits, jerk=jerk)


@pytest.mark.slow
@pytest.mark.parametrize("jerk", [None, 100.0])
def test_arm_waits_until_the_other_has_left_the_shared_place(cell, jerk):
    checker = pp.CollisionChecker(cell)
    motions = {name: visit(cell, name, jerk=jerk) for name in ("a", "b")}
    together = pp.certify(pp.motion.synchronise(motions, cell, wait=True), checker)
    assert together.status is pp.CertificateStatus.COLLIDING
    result = coordinate(checker, motions)
    assert result.ok
    assert result.delays["a"] == 0.0
    assert 0.0 < result.delays["b"] < motions["a"].duration
    assert result.certificate.matches(result.trajectory, cell, checker.scene)
    assert audit(result.trajectory, checker, step=0.01, measure=False).clean
    parts, late = separate(result.trajectory, cell), result.delays["b"]
    assert result.slowdowns == {"a": 1.0, "b": 1.0}
    t = np.linspace(0.0, motions["b"].duration, 100)
    assert np.allclose(parts["a"](t), motions["a"](t), atol=1e-9)
    assert np.allclose(parts["b"](np.minimum(t + late, parts["b"].duration)), motions["b"](t), atol=1e-6)


FORK = """<robot name="rails"><link name="root"/>
<link name="fork"><collision><origin xyz="0.3 0 0"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
<collision><origin xyz="-0.3 0 0"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="puck"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<joint name="fork_rail" type="prismatic"><parent link="root"/><child link="fork"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="3" velocity="0.3" effort="1"/></joint>
<joint name="puck_rail" type="prismatic"><parent link="root"/><child link="puck"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="3" velocity="1" effort="1"/></joint></robot>"""


@pytest.mark.slow
def test_arm_between_the_fingers_of_another_moves_slower_along_its_path():
    """At full speed, the puck meets the finger ahead of it or the one behind, whenever it starts."""
    group = pp.model.load_robot(FORK).arms("fork", "puck")
    names = {name: list(arm.joint_names) for name, arm in group.arms.items()}
    motions = {
        name: pp.time_parametrise(JointPath(np.array([[0.0], [2.0]]), names[name]), group.arms[name].limits)
        for name in ("fork", "puck")
    }
    checker = pp.CollisionChecker(group)
    result = coordinate(checker, motions)
    assert result.ok
    assert result.slowdowns["fork"] == 1.0
    assert result.slowdowns["puck"] > 1.0
    assert audit(result.trajectory, checker, step=0.002, measure=False).clean
    ends = separate(result.trajectory, group)
    assert np.allclose(ends["puck"].q[[0, -1]], [[0.0], [2.0]])
    assert (np.abs(ends["puck"].velocities) <= 1.0 + 1e-9).all()


def test_motions_that_never_fit_are_reported_with_the_bodies(cell):
    checker = pp.CollisionChecker(cell)
    motions = {name: visit(cell, name) for name in ("a", "b")}
    stays = separate_half(motions["a"])
    result = coordinate(checker, {"a": stays, "b": motions["b"]}, step=0.5)
    assert not result.ok
    assert "'b'" in result.message
    assert any(name.startswith("a/") for name in result.certificate.first_contact.bodies)


def separate_half(motion):
    """The first half: the arm stays in the middle."""
    rests = np.flatnonzero(~motion.velocities.any(axis=1))[1]
    return motion.split(float(motion.times[rests]))[0]


def test_motion_that_does_not_rest_at_its_ends_is_refused(cell):
    names = cell.arms["a"].joint_names
    moving = pp.Trajectory([0.0, 0.1], np.zeros((2, 6)), np.array([np.zeros(6), np.ones(6)]), names)
    with pytest.raises(pp.InputError, match="'a' does not rest"):
        coordinate(pp.CollisionChecker(cell), {"a": moving, "b": visit(cell, "b")})


@pytest.mark.slow
def test_arms_that_swap_sides_get_the_shorter_of_two_certified_motions(cell):
    checker = pp.CollisionChecker(cell)
    ends = {}
    for name in ("a", "b"):
        motion = visit(cell, name)
        ends[name] = motion.start, motion.start * np.array([-1, 1, 1, 1, 1, 1])
    start, goal = (np.concatenate([ends[name][k] for name in ("a", "b")]) for k in (0, 1))
    result = plan_arms(checker, start, goal)
    assert result.ok
    assert np.allclose(result.trajectory.start, start)
    assert np.allclose(result.trajectory.end, goal)
    assert result.certificate.matches(result.trajectory, cell, checker.scene)
    assert audit(result.trajectory, checker, step=0.01, measure=False).clean
    seed = int(np.random.default_rng(0).integers(2**31))
    joint = pp.RrtConnect().plan(checker, start, goal, rng=seed).or_raise()
    together = pp.time_parametrise(pp.shortcut(joint.path, checker, rng=seed), cell.limits)
    assert result.trajectory.duration <= together.duration + 1e-9


def test_goal_in_collision_is_refused_with_the_reason_of_both_methods(cell):
    checker = pp.CollisionChecker(cell)
    middle = np.concatenate([separate_half(visit(cell, name)).end for name in ("a", "b")])
    start = np.concatenate([visit(cell, name).start for name in ("a", "b")])
    with pytest.raises(pp.PinproofError, match=r"a/.*b/"):
        plan_arms(checker, start, middle)
