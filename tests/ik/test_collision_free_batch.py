"""Batches whose solutions a collision checker accepts in the compiled core: the same results as by calls of Python."""

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import Box, CollisionChecker, Obstacle, Scene, Sphere
from pinproof.ik import IkStatus

FIELDS = ("q", "codes", "position_error", "orientation_error", "iterations", "restarts")


@pytest.fixture(scope="module")
def shelf(panda) -> CollisionChecker:
    """Two boards and a ball in the workspace of the arm."""
    boards = [Obstacle(f"board_{k}", Box(0.5, 0.9, 0.02), pp.pose((0.5, 0.0, z))) for k, z in enumerate((0.2, 0.65))]
    return CollisionChecker(panda, Scene([*boards, Obstacle("ball", Sphere(0.15), pp.pose((-0.4, 0.3, 0.5)))]))


@pytest.fixture(scope="module")
def targets(panda, shelf):
    """Poses of free configurations, of configurations in contact, and one out of reach."""
    lower, upper = panda.limits.sampling_range()
    q = np.random.default_rng(5).uniform(lower, upper, (600, panda.dof))
    free = shelf.is_free_batch(q)
    poses = panda.forward_kinematics_batch(np.concatenate([q[free][:60], q[~free][:40]]))
    poses[-1, :3, 3] = 5.0
    return poses


@pytest.mark.parametrize(
    ("solver", "goal"),
    [
        (pp.Clik(), None),
        (pp.Clik(restarts=1), "centre"),
        (pp.DampedLeastSquares(restarts=4), "near"),
        (pp.Fabrik(restarts=2), None),
    ],
    ids=["clik", "clik_to_the_centre", "damped", "fabrik"],
)
def test_the_core_and_calls_of_python_give_the_same_results(panda, shelf, targets, solver, goal):
    many = targets if isinstance(solver, pp.Clik) else targets[4::5]
    inside = solver.solve_batch(panda, many, rng=3, goal=goal, accept=shelf.is_free)
    called = solver.solve_batch(panda, many, rng=3, goal=goal, accept=lambda q: shelf.is_free(q))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(inside, name), getattr(called, name), err_msg=name)
    assert inside.messages == called.messages


def test_every_solution_is_free_and_rejected_ones_are_in_contact(panda, shelf, targets):
    batch = pp.Clik(restarts=1).solve_batch(panda, targets, accept=shelf.is_free)
    assert set(batch.status) == {IkStatus.FOUND, IkStatus.NOT_FOUND, IkStatus.REFUSED}
    for result, target in zip(batch, targets, strict=True):
        if result.status is not IkStatus.NOT_FOUND:
            assert panda.forward_kinematics(result.q).homogeneous == pytest.approx(target, abs=3e-6)
            assert bool(shelf.check(result.q).contacts) == (result.status is IkStatus.REFUSED)


def test_poses_of_free_configurations_are_all_solved(panda, shelf, targets):
    assert pp.Clik().solve_batch(panda, targets[:60], accept=shelf.is_free).ok.all()


@pytest.mark.parametrize("solver", [pp.Clik(), pp.PseudoInverse(restarts=3)], ids=["clik", "pseudo_inverse"])
def test_threads_do_not_change_the_results(panda, shelf, targets, solver):
    one, four = (solver.solve_batch(panda, targets, accept=shelf.is_free, threads=threads) for threads in (1, 4))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(four, name), err_msg=name)


def test_a_margin_is_kept(panda, shelf, targets):
    wide = shelf.padded(0.02)
    batch = pp.Clik().solve_batch(panda, targets, accept=wide.is_free)
    assert all(shelf.clearance(q) > 0.02 for q in batch.q[batch.ok])
    assert shelf.clearance_batch(pp.Clik().solve_batch(panda, targets, accept=shelf.is_free).q[batch.ok]).min() < 0.02


def test_the_core_decides_only_for_the_method_of_a_checker_of_these_joints(panda, ur5, shelf):
    assert shelf.world_for(shelf.is_free, panda) is shelf.world
    other = shelf.padded(0.01)
    for accept in (lambda q: shelf.is_free(q), other.is_free, shelf.is_free_unchecked, None):
        assert shelf.world_for(accept, panda) is None
    assert shelf.world_for(shelf.is_free, ur5) is None


def test_contacts_that_no_joint_moves_reject_every_solution(panda, targets):
    checker = CollisionChecker(panda, Scene([Obstacle("post", Sphere(0.1))]))
    assert checker.fixed_contacts
    batch = pp.Clik(restarts=3).solve_batch(panda, targets[:5], accept=checker.is_free)
    assert set(batch.status) == {IkStatus.REFUSED}
