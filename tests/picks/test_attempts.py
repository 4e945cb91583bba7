"""Attempts of a pick at full rotations of their joints, compared with all rotations within the limits."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import pinproof as pp
from pinproof.model import JointLimits
from pinproof.motion import CubicPath
from pinproof.picks.judging import grasp
from pinproof.picks.judging.configurations import at_full_speed, least_seconds
from pinproof.picks.judging.grasp import GraspCandidate
from pinproof.picks.judging.lines import Attempt, full_rotations, shifted, span
from pinproof.picks.judging.suggest import Change, ShiftSuggestion, _Trials
from pinproof.picks.judging.task import PickTask
from pinproof.picks.judging.verdict import Stage, StageResult

TURN = 2 * np.pi


def attempt_of(arm: pp.Arm, rng: np.random.Generator) -> Attempt:
    """A grasp between two curved lines of random extent."""
    q, names = rng.uniform(-2.5, 2.5, arm.dof), arm.joint_names
    ends, tangents = q + rng.normal(0, 0.4, (2, arm.dof)), rng.normal(0, 0.5, (2, 2, arm.dof))
    lines = [CubicPath(np.array([q, ends[k]]), tangents[k], [0.0, 1.0], names) for k in range(2)]
    return Attempt(GraspCandidate(q, None, 0.0, 0.0), q, approach=lines[0], retreat=lines[1])


@pytest.mark.parametrize("seed", range(4))
def test_full_rotations_are_all_that_keep_both_lines_within_the_limits(arms, seed: int) -> None:
    rng = np.random.default_rng(seed)
    ur5 = arms["ur5"]
    wide = JointLimits(
        -rng.uniform(3.0, 5.5, 6), rng.uniform(3.0, 5.5, 6), ur5.limits.velocity, ur5.limits.acceleration
    )
    arm = ur5.with_limits(wide)
    attempt = attempt_of(arm, rng)
    shifts = full_rotations(arm, arm.home, attempt)
    assert not shifts[0].any()
    dense = np.linspace(0.0, 1.0, 200)
    points = np.vstack([attempt.q, attempt.approach(dense), attempt.retreat(dense)])
    low, high = points.min(axis=0), points.max(axis=0)
    fits = {
        turns
        for turns in product((-2, -1, 0, 1, 2), repeat=6)
        if (low + TURN * np.array(turns) >= wide.lower).all() and (high + TURN * np.array(turns) <= wide.upper).all()
    }
    # The control points bound the lines, so that rotations are left out only where a line nearly reaches a limit.
    given = {tuple(np.round(shift / TURN).astype(int).tolist()) for shift in shifts}
    assert given - fits <= {(0,) * 6}
    bounds = span(attempt.q, attempt.approach, attempt.retreat)
    kept = {
        turns
        for turns in fits
        if (bounds[0] + TURN * np.array(turns) >= wide.lower).all()
        and (bounds[1] + TURN * np.array(turns) <= wide.upper).all()
    }
    assert given == kept | {(0,) * 6}
    assert (bounds[0] <= low + 1e-12).all()
    assert (bounds[1] >= high - 1e-12).all()


def test_an_attempt_at_full_rotations_has_the_same_poses_at_its_ends(arms) -> None:
    arm, rng = arms["ur5"], np.random.default_rng(5)
    for _ in range(5):
        attempt, by = attempt_of(arm, rng), TURN * rng.integers(-1, 2, arm.dof)
        turned = attempt.turned(by)
        assert turned.candidate is attempt.candidate
        for line, before, end in (
            (turned.approach, attempt.approach, turned.entrance),
            (turned.retreat, attempt.retreat, turned.exit),
        ):
            for share in np.linspace(0.0, 1.0, 11):
                np.testing.assert_allclose(line(share) - before(share), by, atol=1e-12)
            np.testing.assert_allclose(line.end, end, atol=1e-12)
            np.testing.assert_allclose(line.start, turned.q, atol=1e-12)
    alone = Attempt(attempt.candidate, attempt.q).turned(by)
    assert (alone.approach, alone.retreat) == (None, None)
    for q in (alone.entrance, alone.exit):
        np.testing.assert_array_equal(q, attempt.q + by)
    assert shifted(None, by) is None


def test_the_time_at_full_speed_is_the_same_in_both_directions_and_no_less_than_any_bound(arms) -> None:
    rng = np.random.default_rng(0)
    for arm in arms.values():
        for _ in range(20):
            points = rng.uniform(-3.0, 3.0, (rng.integers(1, 6), arm.dof))
            slowest = [
                max(abs(step[j]) / arm.limits.velocity[j] for j in range(arm.dof)) for step in np.diff(points, axis=0)
            ]
            assert at_full_speed(arm, points) == pytest.approx(sum(slowest))
            assert at_full_speed(arm, points[::-1]) == pytest.approx(sum(slowest))
            assert at_full_speed(arm, points) >= least_seconds(arm, points[:1], points[-1:])[0, 0] - 1e-12


def test_ranked_configurations_reach_the_grasps_that_they_belong_to(arms, cells, monkeypatch) -> None:
    """Also if there are more than are ranked; those with the shortest time from home are kept."""
    monkeypatch.setattr(grasp, "RANKED", 5)
    arm, (scene, picks) = arms["ur5"], cells["ur5"]
    made = pp.picks.PickSetup.make(arm, scene, picks, home=None, rng=0)
    tolerance = pp.picks.GraspTolerance(position=(0.005, 0.005, 0.0), tilt=0.1)
    task = PickTask(pp.Pick("bolt", picks.picks[0].pose, tolerance=tolerance), made.cell)
    members = [member for group in task.groups() for member in group]
    reached = grasp.reach(task, members, 0)
    assert len(reached.q) > 20
    ranked = grasp.rank(task, reached.q, [members[i] for i in reached.member])
    assert len(ranked) == 5
    times = (np.abs(reached.q - task.cell.home) / arm.limits.velocity).max(axis=1)
    slowest = max((np.abs(each.q - task.cell.home) / arm.limits.velocity).max() for each in ranked)
    assert slowest == pytest.approx(np.sort(times)[4])
    for each in ranked:
        reached_tip = arm.root_from_base * arm.forward_kinematics(each.q) * picks.tip
        np.testing.assert_allclose(reached_tip.homogeneous, task.grasp(each.member).homogeneous, atol=1e-5)
    assert len({each.member.words for each in ranked}) > 1


def test_a_change_that_cannot_be_good_is_not_judged_and_not_good_when_it_is_tried_again() -> None:
    judged: list[str] = []
    trials = _Trials(lambda pick: judged.append(pick), Stage.GRASP, 3, lambda pick: False)
    change = Change(ShiftSuggestion(by=(0, 0, 10)), pp.Pick("a", pp.pose((0.4, 0, 0.3))), 10.0)
    assert [trials.good(change), trials.good(change)] == [False, False]
    assert judged == []
    assert (trials.best, trials.left) == (None, 3)


def test_an_attempt_passed_if_its_last_stage_did() -> None:
    first, last = (StageResult(Stage.APPROACH, True, ""), StageResult(Stage.RETREAT, True, ""))
    candidate = GraspCandidate(np.zeros(6), None, 0.0, 0.0)
    for stages, passed in (((first,), True), ((first, last), True), ((first, replace(last, ok=False)), False)):
        assert Attempt(candidate, np.zeros(6), stages).passed is passed


LINKAGE = """<robot name="linkage"><link name="base"/><link name="slide"/>
<link name="hand"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="rod"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<joint name="a" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="b" type="prismatic"><parent link="slide"/><child link="hand"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="c" type="prismatic"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="a"/></joint></robot>"""
"""The hand does not move if one slide moves by as much as the other moves back, and the rod does."""


def test_contact_with_a_link_that_moves_while_the_tcp_rests_is_not_one_at_every_configuration() -> None:
    arm = pp.load_robot(LINKAGE).arm(tcp="hand")
    stone = pp.Obstacle("stone", pp.Sphere(0.02), pp.pose((0.0, 0.0, 0.06)))
    checker = pp.CollisionChecker(arm, pp.Scene([stone]))
    here, there = np.zeros(2), np.array([0.5, -0.5])
    np.testing.assert_allclose(arm.forward_kinematics(here).homogeneous, arm.forward_kinematics(there).homogeneous)
    met, left = ({frozenset(each.bodies) for each in checker.check(q).contacts} for q in (here, there))
    assert {frozenset(("hand", "rod")), frozenset(("hand", "stone"))} <= met
    assert left == {frozenset(("hand", "stone"))}
    for q in (here, there):
        (words,) = grasp.contacts_everywhere(checker, q)
        assert "hand" in words
        assert "stone" in words
