"""The compiled loop, that on Pinocchio and rules in NumPy have the same iterates; results do not depend on threads."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.ik import IterativeIk
from pinproof.ik.task import IkGoal, make_goal
from pinproof.model import load_robot

from ..examples import examples
from .plain_rules import goal_step, plain

METHODS = [pp.Clik(), pp.DampedLeastSquares(), pp.PseudoInverse()]
ROBOTS = ["ur5", "panda", "stanford", "so100"]


@pytest.fixture(scope="module")
def arms():
    return {name: pp.load_robot(name).arm() for name in ROBOTS}


def with_engine(solver, engine, **settings):
    return replace(solver, engine=engine, **settings)


def random_targets(arm, count, seed):
    rng = np.random.default_rng(seed)
    return arm.forward_kinematics_batch(rng.uniform(*arm.limits.sampling_range(), (count, arm.dof)))


@pytest.mark.parametrize("solver", METHODS, ids=lambda solver: type(solver).__name__)
@examples(25)
@given(
    name=st.sampled_from(ROBOTS),
    seed=st.integers(0, 10**6),
    task=st.sampled_from(["pose", "position", "orientation", "spin_z"]),
)
def test_both_engines_take_the_same_steps(arms, solver, name, seed, task):
    """After k steps both have the same q, for every k until rounding is amplified at a singularity."""
    arm = arms[name]
    target = random_targets(arm, 1, seed)[0]
    q0 = np.random.default_rng(seed + 1).uniform(*arm.limits.sampling_range())
    watched: list[np.ndarray] = []
    slow = with_engine(solver, "pinocchio", restarts=0)
    end = slow.solve(arm, target, q0, task=task, on_step=lambda step: watched.append(step.q))
    for steps in range(1, min(len(watched), 6)):
        own = {"restarts": 0, "max_iterations": steps}
        short = [with_engine(solver, "compiled", **own), with_engine(solver, "pinocchio", **own), plain(solver, **own)]
        a, b, c = (one.solve(arm, target, q0, task=task) for one in short)
        assert (a.engine, b.engine) == ("compiled", "pinocchio")
        assert a.q == pytest.approx(b.q, abs=1e-6)
        assert a.q == pytest.approx(c.q, abs=1e-6)
    assert arm.limits.contains(end.q)


@pytest.mark.parametrize("goal", ["centre", "near", "manipulability"])
@examples(20)
@given(name=st.sampled_from(ROBOTS), seed=st.integers(0, 10**6))
def test_the_steps_of_goals_are_those_of_numpy(arms, goal, name, seed):
    arm = arms[name]
    q, q0 = np.random.default_rng(seed).uniform(*arm.limits.sampling_range(), (2, arm.dof))
    null_space = make_goal(goal, arm, q0)
    assert null_space.step(arm, q, np.zeros((6, arm.dof))) == pytest.approx(goal_step(null_space, arm, q), abs=1e-5)


@pytest.mark.parametrize("name", ROBOTS)
def test_both_engines_give_the_same_answer_after_restarts(arms, name):
    arm = arms[name]
    for target in random_targets(arm, 8, seed=3):
        fast, slow = (pp.Clik(engine=engine).solve(arm, target, np.zeros(arm.dof)) for engine in ("auto", "pinocchio"))
        assert fast.engine == "compiled"
        assert (fast.status, fast.restarts) == (slow.status, slow.restarts)
        assert fast.q == pytest.approx(slow.q, abs=1e-4)  # at a singular target 1e-6 of pose is 1e-4 of joints


@pytest.mark.parametrize("solver", [*METHODS, pp.Fabrik()], ids=lambda solver: type(solver).__name__)
@pytest.mark.parametrize("threads", [2, 3])
def test_results_are_bit_identical_for_any_number_of_threads(arms, solver, threads):
    targets = random_targets(arms["panda"], 101, seed=4)
    one = solver.solve_batch(arms["panda"], targets, rng=7)
    many = solver.solve_batch(arms["panda"], targets, rng=7, threads=threads)
    assert (one.q == many.q).all()
    assert (one.iterations == many.iterations).all()
    assert one.status == many.status


@pytest.mark.parametrize("task", ["pose", "position", "spin_x"])
def test_a_batch_equals_its_single_results(arms, task):
    arm = arms["ur5"]
    targets = random_targets(arm, 20, seed=5)
    starts = np.random.default_rng(6).uniform(-3, 3, (20, 6))
    batch = pp.Clik().solve_batch(arm, targets, starts, task=task, goal="near")
    for target, q0, result in zip(targets, starts, batch, strict=True):
        single = pp.Clik().solve(arm, target, q0, task=task, goal="near")
        assert (single.q == result.q).all()
        assert (single.status, single.restarts) == (result.status, result.restarts)
        assert single.message.split(",")[0] == result.message.split(",")[0]
        assert single.position_error == pytest.approx(result.position_error, abs=1e-12)


def test_the_seed_shifts_the_starts(arms):
    targets = random_targets(arms["panda"], 60, seed=9)
    a, b = (pp.Clik().solve_batch(arms["panda"], targets, rng=rng) for rng in (0, 1))
    restarted = a.restarts > 0
    assert restarted.any()
    assert (a.q[~restarted] == b.q[~restarted]).all()
    assert (a.q[restarted] != b.q[restarted]).any()


def test_a_method_without_a_compiled_rule_runs_on_pinocchio(arms):
    class Gradient(IterativeIk):
        def step_rule(self):
            class Rule:
                def observe(self, here):
                    pass

                def __call__(self, residual, jacobian):
                    return -0.5 * jacobian.T @ residual

            return Rule()

    arm = arms["ur5"]
    q0 = arm.home
    target = arm.forward_kinematics(q0 + 0.01)
    found = Gradient(position_tolerance=1e-2, orientation_tolerance=1e-1, restarts=0).solve(arm, target, q0)
    assert found.ok
    assert found.engine == "pinocchio"
    with pytest.raises(pp.InputError, match="no compiled rule"):
        Gradient(engine="compiled").solve(arm, target)


def test_an_unknown_engine_names_the_valid_ones():
    with pytest.raises(pp.UnknownNameError, match=r"auto.*compiled.*pinocchio"):
        pp.Clik(engine="gpu")


def test_on_step_with_the_compiled_engine_is_refused(arms):
    with pytest.raises(pp.InputError, match="on_step"):
        pp.Clik(engine="compiled").solve(arms["ur5"], pp.pose((0.4, 0, 0.3)), on_step=print)


def test_mimic_joints_on_the_chain_are_solved(planar_with_follower):
    arm, target = planar_with_follower
    found = pp.Clik().solve(arm, target, task="position").or_raise()
    assert found.engine == "compiled"
    assert arm.forward_kinematics(found.q).translation == pytest.approx(target.translation, abs=1e-6)


@pytest.fixture
def planar_with_follower():
    limit = '<limit lower="-3" upper="3" velocity="1" effort="1"/>'
    joints = "".join(
        f'<link name="l{i}"/><joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
        f'<origin xyz="{0.0 if i == 1 else 0.5} 0 0"/><axis xyz="0 0 1"/>{limit}'
        + ('<mimic joint="j1" multiplier="-0.5" offset="0.2"/>' if i == 2 else "")
        + "</joint>"
        for i in (1, 2, 3)
    )
    tool = (
        '<link name="tool"/><joint name="t" type="fixed"><parent link="l3"/><child link="tool"/>'
        '<origin xyz="0.4 0 0"/></joint>'
    )
    arm = load_robot(f'<robot name="r"><link name="l0"/>{joints}{tool}</robot>').arm(tcp="tool")
    return arm, arm.forward_kinematics([0.7, -0.9])


def test_goal_settings_are_checked():
    with pytest.raises(pp.UnknownNameError, match="valid: centre, manipulability, near"):
        IkGoal("center")
    with pytest.raises(pp.InputError, match="gain"):
        IkGoal("centre", gain=0.0)


def test_a_function_is_a_step_rule_and_what_is_none_is_refused(arms):
    class Own(IterativeIk):
        rule: ClassVar[object] = None

        def step_rule(self):
            return type(self).rule

    arm = arms["ur5"]
    target = arm.forward_kinematics(arm.home + 0.01)
    solver = Own(position_tolerance=1e-2, orientation_tolerance=1e-1, restarts=0)
    Own.rule = staticmethod(lambda residual, jacobian: -0.5 * jacobian.T @ residual)
    assert solver.solve(arm, target, arm.home).ok
    for wrong, message in ((None, "step_rule"), (lambda r, J: r[:2], r"\(6,\)"), (lambda r, J: None, r"\(6,\)")):
        Own.rule = None if wrong is None else staticmethod(wrong)
        with pytest.raises(pp.InputError, match=message):
            solver.solve(arm, target, arm.home)
