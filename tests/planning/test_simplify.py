"""Simplified paths: shorter, rounder, with the certificate of exactly the curve that comes out."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

import pinproof as pp

from .arms import assert_free


@pytest.fixture
def checker(gantry: pp.Arm, slotted: pp.Scene) -> pp.CollisionChecker:
    return pp.CollisionChecker(gantry, slotted, margin=0.005)


@pytest.fixture
def detour(checker: pp.CollisionChecker) -> pp.JointPath:
    """Round by the slot, with corners to spare."""
    q = [(-0.8, -0.8), (-0.8, 0.0), (-0.4, 0.2), (-0.8, 0.6), (0.8, 0.6), (0.4, 0.2), (0.8, 0.0), (0.8, -0.8)]
    return pp.JointPath(q, checker.arm.joint_names)


@pytest.mark.parametrize("blend", [True, False])
def test_shorter_and_proven_with_figures_before_and_after(
    checker: pp.CollisionChecker, detour: pp.JointPath, blend: bool
) -> None:
    found = pp.simplify(detour, checker, blend=blend).or_raise()
    assert isinstance(found.path, pp.motion.BlendedPath if blend else pp.JointPath)
    assert found.certificate.matches(found.path, checker.arm, checker.scene)
    assert found.before.matches(detour, checker.arm, checker.scene)
    assert found.length_before == detour.length
    assert found.length_after == found.path.length < 0.9 * detour.length
    assert found.clearance_after >= checker.margin
    assert found.clearance_before <= found.observed_before
    assert found.clearance_after <= found.observed_after
    assert np.array_equal(found.path.start, detour.start)
    assert np.array_equal(found.path.end, detour.end)
    assert f"{found.length_after:.3g}" in found.message
    assert_free(found.path, checker)


def test_rounded_is_shorter_than_not(checker: pp.CollisionChecker, detour: pp.JointPath) -> None:
    rounded, straight = (pp.simplify(detour, checker, blend=blend) for blend in (True, False))
    assert rounded.length_after < straight.length_after
    assert rounded.path.corners == ()
    assert rounded.stops == 0
    assert straight.stops == len(straight.path) - 2 > 0


def test_same_rng_same_curve(checker: pp.CollisionChecker, detour: pp.JointPath) -> None:
    curves = [pp.simplify(detour, checker, rng=seed).path.control.tobytes() for seed in (3, 3, 4)]
    assert curves[0] == curves[1] != curves[2]


def test_the_planner_s_certificate_is_taken_if_it_is_for_this_path(
    checker: pp.CollisionChecker, detour: pp.JointPath
) -> None:
    proof = pp.certify(detour, checker)
    assert pp.simplify(detour, checker, certificate=proof).before is proof
    other = pp.certify(detour.reversed(), checker)
    assert pp.simplify(detour, checker, certificate=other).before is not other
    wider = pp.certify(detour, checker.with_margin(0.01))
    assert pp.simplify(detour, checker, certificate=wider).before is not wider


def test_a_curve_that_fails_its_last_proof_is_given_up_for_the_one_before(
    checker: pp.CollisionChecker, detour: pp.JointPath, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = importlib.import_module("pinproof.planning.simplification")
    through_the_wall = pp.motion.BlendedPath.join(pp.JointPath(detour.q[[0, -1]], detour.joint_names))
    monkeypatch.setattr(home, "blend", lambda *args, **settings: through_the_wall)
    found = pp.simplify(detour, checker).or_raise()
    assert isinstance(found.path, pp.JointPath)
    assert "rejected" in found.message
    monkeypatch.setattr(home, "shortcut", lambda *args, **settings: pp.JointPath(detour.q[[0, -1]], detour.joint_names))
    found = pp.simplify(detour, checker).or_raise()
    assert found.path is detour
    assert found.certificate.matches(detour, checker.arm, checker.scene)


def test_a_path_that_is_not_free_is_not_proven(checker: pp.CollisionChecker, detour: pp.JointPath) -> None:
    through = pp.JointPath(detour.q[[0, -1]], detour.joint_names)
    found = pp.simplify(through, checker)
    assert not found.ok
    assert not found.before.free
    with pytest.raises(pp.errors.NotProvenFree):
        found.or_raise()


def test_a_panda_s_plan(panda: pp.Arm) -> None:
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose((0.5, 0.0, 0.5)))
    checker = pp.CollisionChecker(panda, pp.Scene([post]), margin=0.002)
    start, goal = panda.home.copy(), panda.home.copy()
    start[0], goal[0] = -0.8, 0.8
    plan = pp.RrtConnect(time_limit=600.0).plan(checker, start, goal, rng=1).or_raise()
    found = pp.simplify(plan.path, checker, certificate=plan.certificate).or_raise()
    assert found.before is plan.certificate
    assert found.length_after <= found.length_before
    assert_free(found.path, checker)


def test_a_path_along_a_line_is_shortened_along_it_and_one_that_leaves_it_is_not_proven(ur5: pp.Arm) -> None:
    start = np.array([0.3, -1.4, 1.7, -1.9, -1.57, 0.2])
    here = ur5.forward_kinematics(start)
    checker = pp.CollisionChecker(ur5, pp.Scene())
    line = pp.plan_linear(checker, start, pp.pose((0, 0.35, 0)) * here).path
    within = [pp.Within.line(tuple(here.translation), (0, 1, 0), tolerance=0.002)]
    shares = np.concatenate([np.linspace(0, 0.6, 13), np.linspace(0.55, 0.2, 8), np.linspace(0.25, 1, 16)])
    path = pp.JointPath(line(shares), ur5.joint_names)
    found = pp.simplify(path, checker, blend=False, constraints=within).or_raise()
    assert found.length_after < 0.7 * found.length_before
    away = [np.linalg.norm((ur5.forward_kinematics(found.path(t)).translation - here.translation)[[0, 2]]) for t in
            np.linspace(*found.path.domain, 400)]  # fmt: skip
    assert max(away) <= 0.002
    straight = pp.JointPath(path.q[[0, -1]], ur5.joint_names)
    assert pp.certify(straight, checker).free
    refused = pp.simplify(straight, checker, blend=False, constraints=within)
    assert not refused.ok
    assert refused.certificate.violation is not None
