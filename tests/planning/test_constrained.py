"""Plans along constraints of the tcp: certified, kept between samples, smooth, and refused where they cannot hold."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import pinproof as pp
from pinproof._core import Manifold
from pinproof.planning import Edges
from pinproof.planning.problem import manifold_of

START, GOAL = np.array([-1.0, -1.2, 1.6, -1.97, -1.57, 0.0]), np.array([1.0, -1.2, 1.6, -1.97, -1.57, 0.5])
TILT = np.array([0, 0, 0, 0.3, 0, 0])
TABLE = pp.Obstacle("table", pp.Box(1.4, 1.6, 0.05), pp.pose((0.6, 0.0, -0.1)))
POST = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.2), pp.pose((0.6, 0.0, 0.3)))


@pytest.fixture(scope="module")
def checker(ur5):
    return pp.CollisionChecker(ur5, pp.Scene([TABLE, POST]), margin=0.002)


def sampled_error(constraint, arm, curve):
    """The largest error at samples between which no joint moves by more than 0.002 rad, by Pinocchio."""
    rough = curve(np.linspace(*curve.domain, 2000))
    count = int(np.abs(np.diff(rough, axis=0)).max(axis=1).sum() / 0.002) + 2
    return max(constraint.error(arm, q) for q in curve(np.linspace(*curve.domain, 2 * count)))


@pytest.mark.parametrize("degrees", [5.0, 1.0, 0.1])
def test_an_upright_motion_is_certified_and_never_leaves_the_cone(ur5, checker, degrees):
    upright = pp.Upright.keeping(ur5, START, tolerance=math.radians(degrees))
    plan = pp.RrtConnect().plan(checker, START, GOAL, constraints=[upright], rng=1).or_raise()
    assert plan.certificate.constraints[0].largest <= upright.tolerance
    np.testing.assert_array_equal(plan.path.q[[0, -1]], [START, GOAL])
    simple = pp.simplify(plan.path, checker, constraints=[upright])
    trajectory = pp.time_parametrise(simple.path, ur5.limits)
    certificate = pp.certify(trajectory, checker, constraints=[upright])
    assert certificate.free
    assert simple.stops == 0
    assert simple.path.length < plan.path.length
    assert sampled_error(upright, ur5, trajectory) <= certificate.constraints[0].largest <= upright.tolerance


@pytest.mark.slow
def test_several_constraints_hold_together_on_a_redundant_arm(panda):
    """A line of 0.8 m, within 1 mm, with the tool upright."""
    first, last = (
        pp.Clik().solve(panda, pp.pose((0.45, y, 0.4), (np.pi, 0, turn)), panda.home, rng=0).or_raise().q
        for y, turn in ((-0.4, 0.0), (0.4, 1.0))
    )
    line = pp.Within.line((0.45, 0.0, 0.4), (0, 1, 0), tolerance=1e-3)
    upright = pp.Upright(tolerance=math.radians(2), axis_in_tcp=(0, 0, -1))
    checker = pp.CollisionChecker(panda, pp.Scene([TABLE]))
    plan = pp.RrtConnect().plan(checker, first, last, constraints=[line, upright], rng=0).or_raise()
    simple = pp.simplify(plan.path, checker, constraints=[line, upright])
    trajectory = pp.time_parametrise(simple.path, panda.limits)
    certificate = pp.certify(trajectory, checker, constraints=[line, upright]).or_raise()
    for proof in certificate.constraints:
        assert sampled_error(proof.constraint, panda, trajectory) <= proof.largest <= proof.constraint.tolerance


def test_the_same_seed_gives_the_same_constrained_path(ur5, checker):
    upright = pp.Upright.keeping(ur5, START, tolerance=0.05)
    first, second = (
        pp.RrtConnect().limited_to(2000).plan(checker, START, GOAL, constraints=[upright], rng=3).or_raise()
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.path.q, second.path.q)


@pytest.mark.parametrize(("start", "goal", "status"), [
    (START + TILT, GOAL, pp.planning.PlanStatus.START_INVALID),
    (START, GOAL + TILT, pp.planning.PlanStatus.GOAL_INVALID),
])  # fmt: skip
def test_an_end_that_violates_a_constraint_is_reported_with_its_excess(ur5, checker, start, goal, status):
    upright = pp.Upright.keeping(ur5, START, tolerance=0.1)
    plan = pp.RrtConnect().plan(checker, start, goal, constraints=[upright])
    assert plan.status is status
    excess = math.degrees(upright.error(ur5, start if status is pp.planning.PlanStatus.START_INVALID else goal) - 0.1)
    assert f"{math.ceil(excess * 100) / 100:.2f} deg too much" in plan.message


def test_a_goal_on_the_other_side_of_an_impossible_region_is_not_found(ur5):
    """Upright and in a plane behind a wall: the search ends with its budget, and without a path."""
    wall = pp.Obstacle("wall", pp.Box(3.0, 0.05, 3.0), pp.pose((0.0, 0.0, 0.5)))
    checker = pp.CollisionChecker(ur5, pp.Scene([wall])).allowing(
        *(("wall", name) for name in ("base_link", "shoulder_link", "upper_arm_link"))
    )
    upright = pp.Upright.keeping(ur5, START, tolerance=0.05)
    plan = pp.RrtConnect().limited_to(200).plan(checker, START, GOAL, constraints=[upright])
    assert plan.status is pp.planning.PlanStatus.OUT_OF_BUDGET
    assert not plan.ok


def test_projection_ends_inside_the_tolerance_and_the_limits(panda):
    rng = np.random.default_rng(0)
    low, high = panda.limits.lower, panda.limits.upper
    upright = pp.Upright(tolerance=0.02, axis_in_tcp=(0, 0, -1))
    plane = pp.Within.plane((0, 0, 0.4), (0, 0, 1), tolerance=1e-4)
    manifold: Manifold = manifold_of(panda, [upright, plane])
    solved = 0
    for _ in range(200):
        q = manifold.project(rng.uniform(low, high), 0.5)
        if q is None:
            continue
        solved += 1
        assert ((q >= low) & (q <= high)).all()
        assert upright.error(panda, q) <= 0.01 + 1e-9
        assert plane.error(panda, q) <= 5e-5 + 1e-9
    assert solved > 150


def test_the_smooth_curve_stays_inside_the_joint_limits(ur5):
    """The limits are the range of the path, which a spline through its points may leave."""
    upright = pp.Upright.keeping(ur5, START, tolerance=0.3)
    scene = pp.Scene([TABLE, POST])
    wide = pp.CollisionChecker(ur5, scene)
    plan = pp.RrtConnect().plan(wide, START, GOAL, constraints=[upright], rng=0).or_raise()
    short = pp.shortcut(plan.path, wide, constraints=[upright])
    low, high = short.q.min(axis=0), short.q.max(axis=0)
    narrow = ur5.with_limits(replace(ur5.limits, lower=low, upper=high))
    simple = pp.simplify(short, pp.CollisionChecker(narrow, scene), constraints=[upright])
    assert simple.ok
    q = simple.path(np.linspace(*simple.path.domain, 5000))
    assert (q.min(axis=0) >= low - 1e-9).all()
    assert (q.max(axis=0) <= high + 1e-9).all()
    assert pp.time_parametrise(simple.path, narrow.limits).duration > 0


@pytest.mark.parametrize("name", ["upright", "line", "both"])
def test_projections_and_proven_edges_keep_the_constraints_at_dense_samples(ur5, name):
    """Also where a joint is at its limit: what cannot be projected is refused, and edges that leave are not proven."""
    upright = pp.Upright.keeping(ur5, START, tolerance=0.05)
    here = ur5.forward_kinematics(START).translation
    line = pp.Within.line(tuple(here), (0, 1, 0), tolerance=0.02)
    constraints = {"upright": [upright], "line": [line], "both": [upright, line]}[name]
    limits, rng = ur5.limits, np.random.default_rng(0)
    tilted = START + np.array([0, 0.5, 0.5, 0.5, 0, 0])
    boxes = [(limits.lower, limits.upper), (START - 0.4, START + 0.4), (tilted - 0.1, tilted + 0.1)]
    points, outcomes = [], []
    for low, high in boxes:
        arm = ur5.with_limits(replace(limits, lower=low, upper=high))
        manifold = manifold_of(arm, constraints)
        for _ in range(30):
            q = START + rng.uniform(-1.5, 1.5, 6)
            found = manifold.project(q, 0.5)
            outcomes.append(found is None)
            if found is not None:
                assert arm.limits.contains(found)
                errors = [each.error(arm, found) for each in constraints]
                np.testing.assert_allclose(manifold.errors(found), errors, atol=1e-9)
                assert all(
                    error <= 0.5 * each.tolerance + 1e-9 for each, error in zip(constraints, errors, strict=True)
                )
                points.append(found)
    assert set(outcomes) == {False, True}
    proven = []
    for a in points[:40]:
        b = a + rng.uniform(-1, 1, 6) * 10.0 ** rng.uniform(-3, 0)
        edge = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
        inside = all(each.error(ur5, q) <= each.tolerance for each in constraints for q in edge)
        assert not manifold.edge_proven(a, b) or inside
        proven.append(bool(manifold.edge_proven(a, b)))
    assert set(proven) == {False, True}


def test_steps_along_the_constraints_are_proven_and_end_at_the_target(ur5):
    upright = pp.Upright.keeping(ur5, START, tolerance=0.01)
    manifold, edges = manifold_of(ur5, [upright]), Edges(pp.CollisionChecker(ur5), 0.05, np.array([START, GOAL]))
    rng, reached = np.random.default_rng(1), 0
    for _ in range(20):
        a, b = (manifold.project(START + rng.uniform(-0.8, 0.8, 6), 0.9) for _ in range(2))
        if a is None or b is None:
            continue
        path = manifold.connect(edges.core, a, b, 0.3, 20.0)
        if path is None:
            continue
        reached += 1
        np.testing.assert_array_equal(path[[0, -1]], [a, b])
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        assert manifold.connect(edges.core, a, b, 0.3, 0.99 * steps.sum()) is None
        for first, last in pairwise(path):
            dense = first + np.linspace(0.0, 1.0, 40)[:, None] * (last - first)
            assert max(upright.error(ur5, q) for q in dense) <= upright.tolerance
    assert reached > 5


def test_a_configuration_whose_joints_cannot_move_is_not_projected(ur5):
    upright = pp.Upright.keeping(ur5, START, tolerance=0.05)
    for tilt in (0.0, 0.2):
        q = START + np.array([0, 0, 0, tilt, 0, 0])
        arm = ur5.with_limits(replace(ur5.limits, lower=q, upper=q))
        found = manifold_of(arm, [upright]).project(q, 0.5)
        assert (found is None) == (tilt > 0)
