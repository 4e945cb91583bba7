"""Families of grasps, proofs of negative verdicts, and suggestions, each of which is applied."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.ik import Clik
from pinproof.picks import PickStatus, Stage
from pinproof.picks.input.pick import family

DOWN = (np.pi, 0, 0)
PICK = pp.Pick("part", pp.pose((0.45, 0.1, 0.2), DOWN), approach=0.05, retreat=0.05)


@pytest.fixture(scope="module")
def arm(arms) -> pp.Arm:
    return arms["ur5"]


def judge(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, **settings) -> pp.picks.PickVerdict:
    budget = pp.picks.PickBudget(compared=1, **settings)
    (verdict,) = pp.validate_picks(arm, pp.Scene(obstacles), pp.Picks((pick,), margin=0.002), budget=budget).verdicts
    return verdict


def test_members_go_from_the_nominal_one_outwards() -> None:
    axis = np.array([0.0, 0.0, 1.0])
    rings = list(family(pp.picks.GraspSpin((0.0, 0.5)), pp.picks.GraspTolerance((0.01, 0, 0), tilt=0.1), axis))
    assert [len(ring) for ring in rings] == [2, 12, 12]
    assert rings[0][0].words == ""
    far = [max(float(np.linalg.norm(m.nominal_from_tip.translation)) for m in ring) for ring in rings]
    np.testing.assert_allclose(far, [0, 0.005, 0.01], atol=1e-12)
    angles = sorted(pp.picks.GraspSpin.free().angles)
    np.testing.assert_allclose(np.diff(angles), 2 * np.pi / 24, atol=1e-12)
    assert abs(pp.picks.GraspSpin.free().angles[0]) == 0.0


def test_a_spin_keeps_the_tip_and_the_approach(arm) -> None:
    verdict = judge(arm, replace(PICK, spin=pp.picks.GraspSpin((2.0,))))
    assert verdict.ok
    assert "spun by +115 deg" in verdict.member
    there = arm.root_from_base * arm.forward_kinematics(verdict.q_grasp)
    np.testing.assert_allclose(there.translation, PICK.pose.translation, atol=1e-6)
    np.testing.assert_allclose(there.rotation[:, 2], PICK.pose.rotation[:, 2], atol=1e-9)
    assert there.rotation[0, 0] == pytest.approx(np.cos(2.0), abs=1e-6)


def test_a_tolerance_moves_the_grasp_only_where_the_nominal_one_fails(arm) -> None:
    stone = pp.Obstacle("stone", pp.Sphere(0.02), pp.pose((0.45, 0.1 + 0.055, 0.2)))
    moved = replace(PICK, tolerance=pp.picks.GraspTolerance((0.0, 0.03, 0.0)))
    assert judge(arm, moved).member == ""
    assert judge(arm, PICK, stone, remedies=0).failed is Stage.GRASP
    verdict = judge(arm, moved, stone)
    assert verdict.ok
    assert "mm along the tip's y" in verdict.member


def test_impossible_is_reported_only_if_no_seed_finds_a_path(arms) -> None:
    # By another method: descents from many seeds, none of which may end free at the grasp.
    arm = arms["generic_6dof"]
    stone = pp.Obstacle("stone", pp.Sphere(0.06), pp.pose((0.4, -0.3, 0.15)))
    pick = pp.Pick("part", pp.pose((0.4, -0.3, 0.15), DOWN), approach=0, retreat=0)
    verdict = judge(arm, pick, stone, remedies=0)
    assert (verdict.status, verdict.failed) == (PickStatus.IMPOSSIBLE, Stage.GRASP)
    assert len(verdict.refuted) == verdict.configurations
    assert all("stone" in line for line in verdict.refuted)
    checker = pp.CollisionChecker(arm, pp.Scene([stone]), margin=0.002)
    found = Clik().solve_many(arm, arm.root_from_base.actInv(pick.pose), arm.home, rng=5, count=60, attempts=200)
    assert len(found) >= 4
    assert not checker.is_free_batch(found.q).any()


@pytest.mark.parametrize(
    "change",
    [{"spin": pp.picks.GraspSpin.free()}, {"tolerance": pp.picks.GraspTolerance((0.005, 0.0, 0.0))}],
    ids=["spin", "tolerance"],
)
def test_a_sample_of_a_family_proves_nothing(arm, change) -> None:
    verdict = judge(arm, replace(PICK, pose=pp.pose((3, 0, 0.2), DOWN), **change), remedies=0)
    assert (verdict.status, verdict.failed, verdict.refuted) == (PickStatus.NOT_FOUND, Stage.REACH, ())
    assert "grasps were tried" in verdict.reason


def test_target_out_of_reach_of_seven_joints_is_impossible(arms) -> None:
    verdict = judge(arms["panda"], replace(PICK, pose=pp.pose((3, 0, 0.2), DOWN)), remedies=0)
    assert (verdict.status, verdict.failed) == (PickStatus.IMPOSSIBLE, Stage.REACH)


def test_a_shorter_approach_that_is_proposed_works_and_a_longer_one_does_not(arm) -> None:
    verdict = judge(arm, replace(PICK, approach=0.9))
    assert (verdict.status, verdict.failed) == (PickStatus.IMPOSSIBLE, Stage.APPROACH)
    suggestion = next(each for each in verdict.suggestions if each.text.startswith("shorten the approach"))
    proposed = suggestion.apply(replace(PICK, approach=0.9)).approach
    assert 0.3 < proposed < 0.9
    assert judge(arm, replace(PICK, approach=proposed), remedies=0).failed is not Stage.APPROACH
    assert judge(arm, replace(PICK, approach=proposed + 0.02), remedies=0).failed is Stage.APPROACH


def test_a_shift_that_is_proposed_works(arm) -> None:
    stone = pp.Obstacle("stone", pp.Sphere(0.02), pp.pose((0.45, 0.1 + 0.055, 0.2)))
    verdict = judge(arm, PICK, stone)
    suggestion = next(each for each in verdict.suggestions if each.text.startswith("move the pick"))
    assert judge(arm, suggestion.apply(PICK), stone, remedies=0).ok


def test_out_of_reach_names_the_residual_and_a_shift_that_reaches(arm) -> None:
    far = replace(PICK, pose=pp.pose((1.1, 0, 0.2), DOWN))
    verdict = judge(arm, far)
    assert (verdict.status, verdict.failed) == (PickStatus.IMPOSSIBLE, Stage.REACH)
    short = float(verdict.reason.split(" mm")[0].split()[-1])
    assert verdict.stages[-1].figures["position_error"] * 1e3 == pytest.approx(short, abs=0.06)
    suggestion = next(each for each in verdict.suggestions if each.text.startswith("move the pick"))
    there = suggestion.apply(far)
    assert short <= 1e3 * np.linalg.norm(there.pose.translation - far.pose.translation) <= 2.1 * short
    assert judge(arm, there, remedies=0).failed is not Stage.REACH


def test_weights_choose_among_complete_motions(arm) -> None:
    def best(**weights) -> pp.picks.PickVerdict:
        none = {"clearance": 0.0, "limit_margin": 0.0, "manipulability": 0.0, "duration": 0.0}
        picks = pp.Picks((PICK,), margin=0.002)
        return pp.validate_picks(arm, pp.Scene(), picks, weights=pp.picks.PickWeights(**{**none, **weights})).verdicts[
            0
        ]

    quick, ample = best(duration=1.0), best(limit_margin=1.0)
    assert quick.trajectory.duration <= ample.trajectory.duration + 1e-9
    assert ample.score["limit_margin"] >= quick.score["limit_margin"] - 1e-9
    assert quick.score["score"] == pytest.approx(quick.score["duration"])
