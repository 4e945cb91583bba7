"""FABRIK: limits in every iterate, verified solutions, and equality of the two loops."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.ik import jacobian_methods
from pinproof.model import load_robot
from pinproof.spatial import matrix

from ..examples import examples
from .plain_rules import FABRIK, Passes, plain

TASKS = ["position", "pose", "orientation", "spin_z", "spin_x"]
ARMS = ["ur5", "panda", "stanford", "scara", "so100"]
LIMIT = '<limit lower="{}" upper="{}" velocity="1" effort="1"/>'


@pytest.fixture(scope="module")
def arms():
    return {name: pp.load_robot(name).arm() for name in [*ARMS, "generic_6dof", "puma560", "iiwa14"]}


def reachable(arm, count, seed):
    lower, upper = arm.limits.sampling_range()
    return arm.forward_kinematics_batch(np.random.default_rng(seed).uniform(lower, upper, (count, arm.dof)))


def all_engines(solver, **settings):
    """The compiled core, the loop on Pinocchio with the compiled passes, and that with passes in NumPy."""
    return [
        *(replace(solver, engine=name, **settings) for name in ("compiled", "pinocchio")),
        plain(solver, **settings),
    ]


def middle(arm):
    return np.mean(arm.limits.sampling_range(), axis=0)


def test_one_link_reaches_its_target_in_one_full_pass(planar):
    """The compiled rule scales steps by alternating factors; the angle of a pass is exact."""
    steps = []
    pp.Fabrik(restarts=0).solve(planar("-3 3"), pp.pose((0.0, 1.0, 0.0)), [0.0], task="position", on_step=steps.append)
    assert steps[0].step == pytest.approx([FABRIK.RELAX_HOLD * np.pi / 2], abs=1e-12)


def test_two_planar_links_match_the_analytic_solution(planar):
    """Elbow up or down: cos q2 = (r^2 - 2) / 2."""
    x, y = 0.9, 1.1
    found = pp.Fabrik().solve(planar("-3 3", "-3 3"), pp.pose((x, y, 0)), [0.3, 0.4], task="position").or_raise()
    assert np.cos(found.q[1]) == pytest.approx((x * x + y * y - 2) / 2, abs=3e-4)


def test_a_straight_arm_is_bent_to_reach_a_point_on_its_own_line(planar):
    """The deadlock of FABRIK: base, links and target on one line."""
    found = pp.Fabrik(restarts=0).solve(planar("-3 3", "-3 3"), pp.pose((1.2, 0, 0)), [0.0, 0.0], task="position")
    assert found.ok
    assert abs(found.q[1]) > 1.0


@pytest.mark.parametrize(("x", "y"), [(3.0, 0.0), (-2.0, 2.0), (0.0, -5.0)])
def test_an_unreachable_target_ends_stretched_and_is_reported(planar, x, y):
    found = pp.Fabrik(restarts=2).solve(planar("-3.1 3.1", "-3 3"), pp.pose((x, y, 0)), [0.5, 0.5], task="position")
    assert not found.ok
    assert found.position_error == pytest.approx(np.hypot(x, y) - 2, abs=1e-3)
    assert found.status is pp.ik.IkStatus.NOT_FOUND


def test_prismatic_joints_reach_the_target():
    """A gantry: three perpendicular prismatic joints, each equal to a coordinate of the target."""
    axes = ["1 0 0", "0 1 0", "0 0 1"]
    joints = "".join(
        f'<link name="l{i}"/><joint name="j{i}" type="prismatic"><parent link="l{i - 1}"/><child link="l{i}"/>'
        f'<axis xyz="{axis}"/>{LIMIT.format(-2, 2)}</joint>'
        for i, axis in enumerate(axes, 1)
    )
    arm = load_robot(f'<robot name="r"><link name="l0"/>{joints}</robot>').arm(tcp="l3")
    found = pp.Fabrik().solve(arm, pp.pose((0.3, -1.4, 1.9)), task="position").or_raise()
    assert found.q == pytest.approx([0.3, -1.4, 1.9], abs=1e-4)


@pytest.mark.parametrize("name", ["ur5", "panda", "iiwa14", "puma560", "generic_6dof", "stanford"])
def test_positions_are_found_from_the_middle_without_restarts(arms, name):
    arm = arms[name]
    targets = reachable(arm, 300, seed=5)
    batch = pp.Fabrik(restarts=0).solve_batch(arm, targets, middle(arm), task="position")
    assert batch.ok.mean() >= 0.98
    ends = arm.forward_kinematics_batch(batch.q)[batch.ok, :3, 3]
    assert np.linalg.norm(ends - targets[batch.ok, :3, 3], axis=1).max() <= 1e-4
    assert all(arm.limits.contains(q) for q in batch.q)


@pytest.mark.slow
@examples(30)
@given(
    name=st.sampled_from(ARMS),
    task=st.sampled_from(TASKS),
    seed=st.integers(0, 10**6),
    scale=st.sampled_from([0.2, 1.0, 1.5]),
    polish=st.booleans(),
)
def test_every_iterate_is_within_limits_and_solutions_are_verified(arms, name, task, seed, scale, polish):
    arm = arms[name]
    target = reachable(arm, 1, seed)[0]
    target[:3, 3] *= scale
    q0 = np.random.default_rng(seed).uniform(*arm.limits.sampling_range())
    seen = []
    solver = pp.Fabrik(restarts=0, max_iterations=40, polish=polish)
    found = solver.solve(arm, target, q0, task=task, on_step=seen.append)
    assert all(arm.limits.contains(step.q) for step in seen)
    assert arm.limits.contains(found.q)
    offset = np.linalg.inv(target) @ arm.forward_kinematics(found.q).homogeneous
    if found.ok and task != "orientation":
        assert np.linalg.norm(offset[:3, 3]) <= 1e-4
    if found.ok and task in ("pose", "orientation"):
        assert np.linalg.norm(offset[:3, :3] - np.eye(3)) / np.sqrt(2) <= 1e-4
    if found.ok and task == "spin_z":
        assert np.arccos(min(offset[2, 2], 1.0)) <= 1.01e-4


@pytest.mark.slow
@examples(30)
@given(name=st.sampled_from(ARMS), task=st.sampled_from(TASKS), seed=st.integers(0, 10**6), polish=st.booleans())
def test_both_engines_take_the_same_steps(arms, name, task, seed, polish):
    arm = arms[name]
    target = reachable(arm, 1, seed)[0]
    q0 = np.random.default_rng(seed + 1).uniform(*arm.limits.sampling_range())
    watched = []
    solver = pp.Fabrik(restarts=0, polish=polish, max_iterations=8)
    solver.solve(arm, target, q0, task=task, on_step=watched.append)
    for steps in {1, 3, min(len(watched), 8) - 1}:
        if 0 < steps < len(watched):
            fast, slow, numpy = (
                each.solve(arm, target, q0, task=task) for each in all_engines(solver, max_iterations=steps)
            )
            assert fast.q == pytest.approx(slow.q, abs=1e-7)
            assert fast.q == pytest.approx(numpy.q, abs=1e-7)


def test_both_engines_bend_an_arm_in_deadlock_equally(planar):
    arm = planar("-3 3", "-3 3", "-1 2")
    target = pp.pose((4.0, 0, 0))  # straight towards it, and out of reach: every pass stands still
    ends = []
    for solver in all_engines(pp.Fabrik(restarts=0, max_iterations=37)):
        ends.append(solver.solve(arm, target, [0.4, 0.3, 0.2], task="position"))
    assert ends[0].iterations == ends[1].iterations == ends[2].iterations
    assert ends[0].q == pytest.approx(ends[1].q, abs=1e-6)
    assert ends[0].q == pytest.approx(ends[2].q, abs=1e-6)


@pytest.mark.parametrize("task", ["position", "pose"])
def test_polish_reaches_what_passes_alone_do_not(arms, task):
    arm = arms["ur5"]
    targets = reachable(arm, 60, seed=9)
    fine = pp.Fabrik(position_tolerance=1e-9, orientation_tolerance=1e-9, restarts=3)
    polished = replace(fine, polish=True).solve_batch(arm, targets, task=task)
    assert polished.ok.mean() >= 0.9
    assert polished.position_error[polished.ok].max() <= 1e-9
    assert polished.iterations.sum() < fine.solve_batch(arm, targets, task=task).iterations.sum() / 2


def test_passes_do_not_use_the_jacobian(arms, monkeypatch):
    """Without polish the step of Clik is not used: the results do not change if it fails."""
    arm, target = arms["panda"], reachable(arms["panda"], 1, seed=2)[0]
    solver = pp.Fabrik(engine="pinocchio", restarts=0)
    before = solver.solve(arm, target, task="position")

    def broken(*_):
        raise AssertionError

    monkeypatch.setattr(jacobian_methods._DampedStep, "__call__", broken)
    assert (solver.solve(arm, target, task="position").q == before.q).all()


@pytest.mark.parametrize("task", [(True, True, False, False, False, False), (True, True, True, True, False, False)])
def test_unsupported_tasks_and_goals_are_refused_with_the_valid_ones(arms, task):
    with pytest.raises(pp.InputError, match=r"'position'.*'spin_x'.*Clik"):
        pp.Fabrik().solve(arms["ur5"], pp.pose((0.4, 0, 0.3)), task=task)
    with pytest.raises(pp.InputError, match="Clik"):
        pp.Fabrik().solve_batch(arms["ur5"], np.eye(4)[None], task=task)
    with pytest.raises(pp.InputError, match=r"goal.*Clik"):
        pp.Fabrik().solve(arms["panda"], pp.pose((0.4, 0, 0.3)), goal="centre")
    with pytest.raises(pp.InputError, match="polish"):
        pp.Fabrik(polish=1)


def test_an_axis_can_be_pointed_without_a_position(arms):
    """rx and ry alone: the tcp's z along the target's z."""
    target = pp.pose(rpy=(0.4, 1.1, 0.0))
    found = pp.Fabrik().solve(arms["ur5"], target, task=(False, False, False, True, True, False)).or_raise()
    axis = arms["ur5"].forward_kinematics(found.q).rotation[:, 2]
    assert axis @ target.rotation[:, 2] == pytest.approx(1.0, abs=1e-8)


def test_mimic_joints_are_refused_on_the_chain_only(planar):
    arm = planar("-3 3", "-3 3", mimic="j1 0.5")
    assert pp.Fabrik().solve(arm, pp.pose((1.0, 1.0, 0)), task="position").ok
    joints = "".join(
        f'<link name="l{i}"/><joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
        f'<origin xyz="{i - 1} 0 0"/><axis xyz="0 0 1"/>{LIMIT.format(-3, 3)}{mimic}</joint>'
        for i, mimic in ((1, ""), (2, '<mimic joint="j1" multiplier="2"/>'))
    )
    coupled = load_robot(f'<robot name="r"><link name="l0"/>{joints}</robot>').arm(tcp="l2")
    with pytest.raises(pp.InputError, match=r"mimic.*Clik"):
        pp.Fabrik().solve(coupled, pp.pose((1.0, 0, 0)), task="position")


# -- the parts of a pass: the compiled passes are equal to these -------------------------------------------------------

TURN = 2 * np.pi


def passes(prismatic=False, low=-np.inf, high=np.inf):
    """The step of an arm with one joint, whose changes stop at these limits."""
    step = Passes(None, 0.0)
    step._prismatic, step._position_weight = [prismatic], 1.0
    step._low, step._high = np.array([low]), np.array([high])
    return step


def random_hinge(rng):
    direction = rng.normal(size=3)
    return np.array([rng.normal(size=3), direction / np.linalg.norm(direction)])


@examples(60)
@given(seed=st.integers(0, 10**6))
def test_the_chosen_angle_and_translation_are_optimal(seed):
    """No other angle or translation has the points and the direction closer to their targets."""
    rng = np.random.default_rng(seed)
    hinge, end, other_end = (random_hinge(rng) for _ in range(3))
    heavy, light = rng.uniform(0.1, 2, 2)
    wanted = pp.pose(rng.normal(size=3), rng.normal(size=3)).homogeneous
    weight = FABRIK.HINGE_HALF_LENGTH**2
    ends = [(heavy, end), (light, other_end[:1])]

    def miss(kind, value):
        off = passes(kind)._motion(0, hinge, value) - wanted
        points = sum(share * np.sum((off @ [*one[0], 1.0])[:3] ** 2) for share, one in ends)
        return float(points + heavy * weight * np.sum((off[:3, :3] @ end[1]) ** 2))

    for kind, others in ((False, np.linspace(-np.pi, np.pi, 200)), (True, np.linspace(-6, 6, 200))):
        best = miss(kind, passes(kind)._best(0, hinge, wanted, ends))
        assert all(best <= miss(kind, other) + 1e-9 for other in others)


@examples(100)
@given(
    low=st.floats(-4, 3.9),
    width=st.floats(0.01, 6.2),
    share=st.floats(0, 1),
    change=st.floats(-np.pi, np.pi),
)
def test_the_allowed_change_is_within_limits_and_closest_on_the_circle(low, width, share, change):
    value = low + share * width
    got = passes(False, low, low + width)._allowed(0, value, change)
    assert low - 1e-12 <= value + got <= low + width + 1e-12

    def away(other):
        return abs((other - change + np.pi) % TURN - np.pi)

    inside = np.linspace(low, low + width, 300) - value
    assert away(got) <= away(inside).min() + 1e-6


def test_a_joint_that_is_not_stopped_has_every_change():
    assert passes()._allowed(0, 3.0, 2.0) == 2.0


@examples(30)
@given(seed=st.integers(0, 10**6), prismatic=st.booleans(), value=st.floats(-7, 7))
def test_a_hinge_moves_points_about_its_axis(seed, prismatic, value):
    o, d = hinge = random_hinge(np.random.default_rng(seed))
    quaternion = [*(np.sin(value / 2) * d), np.cos(value / 2)]
    there = pp.pose(value * d) if prismatic else pp.pose(o) * pp.pose(quat_xyzw=quaternion) * pp.pose(-o)
    motion = passes(prismatic)._motion(0, hinge, value)
    assert motion == pytest.approx(matrix(there), abs=1e-12)
    assert motion @ passes(prismatic)._motion(0, hinge, -value) == pytest.approx(np.eye(4), abs=1e-12)
