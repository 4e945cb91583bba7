"""Screening agrees with the stages of the judge and with brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.model import JointLimits
from pinproof.picks.input.picks import PickProblem
from pinproof.picks.judging.configurations import joint_margins, limit_margin
from pinproof.picks.judging.grasp import reach, screen
from pinproof.picks.judging.task import PickCell, PickTask
from pinproof.spatial import SE3, matrix

from .conftest import ROBOTS


def _random_picks(arm: pp.Arm, cell: tuple[pp.Scene, pp.Picks], count: int) -> pp.Picks:
    """Half of them anywhere around the arm, half where some configuration of it is."""
    rng = np.random.default_rng(3)
    frames = pp.picks.tool_orientations(pp.picks.approach_directions(half_angle=0.9, count=20), 8)
    low, high = arm.limits.sampling_range()
    poses = [
        SE3(frames[rng.integers(len(frames))], rng.uniform((-1.0, -1.0, 0.0), (1.0, 1.0, 0.7)))
        if i % 2
        else arm.root_from_base * arm.forward_kinematics(rng.uniform(low, high)) * cell[1].tip
        for i in range(count)
    ]
    return replace(cell[1], picks=tuple(pp.Pick(f"p{i}", T) for i, T in enumerate(poses)), problems=())


def _failed_stage(pick: pp.Pick, cell: PickCell) -> object:
    """The failed stage up to the grasp according to the judge, or None."""
    task = PickTask(pick, cell)
    stages = []
    for ring in task.groups():
        reached = reach(task, ring, 0)
        text = (*reached.stages, *(screen(task, ring, reached).stages if len(reached.q) else ()))
        if text[-1].ok:
            return None
        stages = max(stages, text, key=len)
    return stages[-1].stage


def _cell(arm: pp.Arm, scene: pp.Scene, picks: pp.Picks) -> PickCell:
    checker = pp.CollisionChecker(arm, scene, margin=picks.margin, attached=picks.open_tool)
    return PickCell(checker, picks, arm.configuration(picks.home_configuration(arm.joint_names, arm.home)))


@pytest.mark.parametrize("name", ROBOTS)
def test_the_screen_agrees_with_the_stages_for_random_picks(name, arms, cells) -> None:
    picks = _random_picks(arms[name], cells[name], 100)
    arm, scene = arms[name], cells[name][0]
    found, cell = pp.screen_picks(arm, scene, picks, clearance=True), _cell(arm, scene, picks)
    stages = [_failed_stage(pick, cell) for pick in picks]
    odd = [(a, b) for a, b in zip([s.stage for s in found.status], stages, strict=True) if a is not b]
    assert not odd
    assert len(set(stages)) >= 3
    assert found.complete == (name != "panda")
    # Free poses are reached and collision-free
    checker = cell.checker
    assert found.free.any()
    for i in np.flatnonzero(found.free):
        at = arm.root_from_base * arm.forward_kinematics(found.q[i]) * picks.tip
        np.testing.assert_allclose(matrix(at), matrix(picks.picks[i].pose), atol=2e-6)
        assert not arm.limits.violations(found.q[i], arm.joint_names)
        assert checker.is_free(found.q[i])
        assert found.clearance[i] == pytest.approx(checker.clearance(found.q[i]))
    np.testing.assert_allclose(found.limit_margin[found.free], limit_margin(arm, found.q[found.free]), atol=1e-12)
    assert np.isnan(found.manipulability[~found.free]).all()
    assert np.isnan(found.clearance[~found.free]).all()


def test_brute_force_finds_the_same(arms, cells) -> None:
    arm, (scene, picks) = arms["ur5"], cells["ur5"]
    checker = _cell(arm, scene, picks).checker
    rng = np.random.default_rng(0)
    q = rng.uniform(-np.pi, np.pi, (300, 6))
    targets = arm.forward_kinematics_batch(q)
    found = pp.screen_picks(arm, scene, matrix(arm.root_from_base) @ targets @ matrix(picks.tip), **_given(picks))
    for i, target in enumerate(targets):
        branches = pp.AnalyticIk().solve_all(arm, target).branches
        free = [q for q in branches if checker.is_free(q)]
        assert found.free[i] == bool(free)
        if free:
            best = max(np.sqrt(np.linalg.det(J @ J.T)) for J in map(arm.jacobian, free))
            assert found.manipulability[i] == pytest.approx(best, rel=1e-6)
        else:
            alone = checker.with_scene(pp.Scene())
            itself = not any(alone.is_free(q) for q in branches)
            assert found.status[i] is (pp.picks.ScreenStatus.SELF if itself else pp.picks.ScreenStatus.CONTACT)
            assert np.isfinite(found.q[i]).all()
    assert found.counts[pp.picks.ScreenStatus.SELF] > 0
    assert found.counts[pp.picks.ScreenStatus.CONTACT] > 0


def _given(picks: pp.Picks) -> dict[str, object]:
    return {"tip": picks.tip, "tool": picks.open_tool, "margin": picks.margin}


def test_poses_and_picks_are_the_same_question_for_any_number_of_threads(arms, cells) -> None:
    arm, scene = arms["panda"], cells["panda"][0]
    picks = _random_picks(arms["panda"], cells["panda"], 100)
    of_picks = pp.screen_picks(arm, scene, picks)
    poses = np.array([matrix(pick.pose) for pick in picks])
    of_poses = pp.screen_picks(arm, scene, poses, home=list(picks.home.values()) or None, threads=3, **_given(picks))
    np.testing.assert_array_equal(of_picks.codes, of_poses.codes)
    np.testing.assert_array_equal(of_picks.q, of_poses.q)
    assert of_poses.names[3] == "pose_3"
    assert of_picks.names[3] == "p3"


def test_limit_violations_are_distinguished_from_reach(arms) -> None:
    arm = arms["ur5"]
    q = np.array([2.5, -1.2, 1.5, -1.8, -1.5, 0.3])
    elbow = np.array([2 * np.pi, 2 * np.pi, 0.1, 2 * np.pi, 2 * np.pi, 2 * np.pi])
    narrow = arm.with_limits(JointLimits(-elbow, elbow, arm.limits.velocity))
    near, far = np.array(arm.forward_kinematics(q).homogeneous), np.eye(4)
    far[0, 3] = 3.0
    root = matrix(arm.root_from_base)
    found = pp.screen_picks(narrow, pp.Scene(), root @ np.array([near, far]))
    assert found.status == (pp.picks.ScreenStatus.LIMITS, pp.picks.ScreenStatus.REACH)
    assert "outside the joint limits" in found.reason(0)
    assert "out of reach" in found.reason(1)
    assert pp.screen_picks(arm, pp.Scene(), root @ near[None]).status == (pp.picks.ScreenStatus.FREE,)


def test_results_of_a_search_are_classified_like_closed_forms(arms, monkeypatch) -> None:
    monkeypatch.setattr("pinproof.picks.batch.screening.has_closed_form", lambda arm, most=6: False)
    arm = arms["generic_6dof"]
    low, high = arm.limits.sampling_range()
    middle = JointLimits(low / 2, high / 2, arm.limits.velocity)
    narrow = arm.with_limits(middle)
    q = np.random.default_rng(1).uniform(low, high, (60, 6))
    targets = matrix(arm.root_from_base) @ arm.forward_kinematics_batch(q)
    searched = pp.screen_picks(narrow, pp.Scene(), targets)
    monkeypatch.undo()
    closed = pp.screen_picks(narrow, pp.Scene(), targets)
    assert not searched.complete
    assert closed.complete
    assert (searched.codes == closed.codes).mean() > 0.95
    assert {pp.picks.ScreenStatus.FREE, pp.picks.ScreenStatus.LIMITS} <= set(searched.status)


def test_of_a_family_the_first_ring_with_a_free_grasp_counts(arms) -> None:
    arm = arms["ur5"]
    tool = pp.Obstacle("bar", pp.Box(0.3, 0.02, 0.02), pp.pose(xyz=(0.13, 0.0, 0.05)))
    wall = pp.Obstacle("wall", pp.Box(0.02, 1.0, 1.0), pp.pose(xyz=(0.6, 0.2, 0.3)))
    spun = pp.Pick("spun", pp.pose(xyz=(0.5, 0.2, 0.3), rpy=(np.pi, 0, 0)), spin=pp.picks.GraspSpin.free())
    picks = pp.Picks((replace(spun, name="plain", spin=pp.picks.GraspSpin()), spun), tool=(tool,))
    found = pp.screen_picks(arm, pp.Scene([wall]), picks)
    assert found.status == (pp.picks.ScreenStatus.CONTACT, pp.picks.ScreenStatus.FREE)
    assert found.member[1] > 0
    assert "bar" in found.reason(0)
    cell = _cell(arm, pp.Scene([wall]), picks)
    member = next(PickTask(spun, cell).groups())[found.member[1]]
    at = arm.root_from_base * arm.forward_kinematics(found.q[1])
    np.testing.assert_allclose(matrix(at), matrix(spun.pose * member.nominal_from_tip), atol=1e-8)


def test_the_hand_may_touch_what_is_picked_and_nothing_else(arms) -> None:
    arm = arms["ur5"]
    tool = pp.Obstacle("rod", pp.Cylinder(radius=0.01, length=0.1), pp.pose(xyz=(0, 0, 0.05)))
    can = pp.Obstacle("can", pp.Cylinder(radius=0.03, length=0.1), pp.pose(xyz=(0.5, 0.2, 0.2)))
    other = pp.Obstacle("other", pp.Cylinder(radius=0.03, length=0.1), pp.pose(xyz=(0.5, -0.2, 0.2)))
    above = pp.pose(xyz=(0.0, 0.0, 0.05), rpy=(np.pi, 0, 0))
    tip = pp.pose(xyz=(0, 0, 0.1))
    stated = {"held": ("can", "can"), "touched": ("other", None), "wrong": ("other", "can")}
    given = tuple(pp.Pick(name, above, frame=frame, carried=carried) for name, (frame, carried) in stated.items())
    picks = pp.Picks(given, tool=(tool,), tip=tip)
    scene = pp.Scene([can, other])
    found = pp.screen_picks(arm, scene, picks)
    free, contact = pp.picks.ScreenStatus.FREE, pp.picks.ScreenStatus.CONTACT
    assert found.status == (free, contact, contact)
    cell = _cell(arm, scene, picks)
    assert [_failed_stage(pick, cell) for pick in picks] == [status.stage for status in found.status]
    assert "other" in found.reason(2)


def test_unusable_entries_are_ignored(arms) -> None:
    fine = pp.Pick("fine", pp.pose(xyz=(0.5, 0.2, 0.3), rpy=(np.pi, 0, 0)))
    picks = pp.Picks((replace(fine, name="lost", frame="nowhere"), fine), (PickProblem(7, "torn", "no xyz"),))
    found = pp.screen_picks(arms["ur5"], pp.Scene(), picks)
    unreadable = pp.picks.ScreenStatus.UNREADABLE
    assert found.status == (unreadable, pp.picks.ScreenStatus.FREE, unreadable)
    assert "nowhere" in found.reason(0)
    assert found.reason(2) == "no xyz"
    assert found.names == ("lost", "fine", "torn")
    assert found.summary.startswith("3 screened: 1 free, 2 unreadable")


def test_nothing_to_screen_is_an_answer_too_and_poses_that_are_none_are_refused(arms) -> None:
    found = pp.screen_picks(arms["ur5"], pp.Scene(), np.empty((0, 4, 4)))
    assert (len(found), found.q.shape) == (0, (0, 6))
    for poses in (np.eye(4), np.full((1, 4, 4), np.nan), np.diag([1.0, 1.0, -1.0, 1.0])[None]):
        with pytest.raises(pp.InputError, match="poses"):
            pp.screen_picks(arms["ur5"], pp.Scene(), poses)


def test_all_shipped_picks_are_reported_as_judged(reports, arms, cells) -> None:
    for name in ROBOTS:
        found = pp.screen_picks(arms[name], *cells[name])
        for status, verdict in zip(found.status, reports[name].verdicts, strict=True):
            if status is pp.picks.ScreenStatus.FREE:
                assert verdict.failed not in {s.stage for s in pp.picks.ScreenStatus if s.stage}
            else:
                assert verdict.failed is status.stage


def test_a_grid_is_screened_without_being_held(arms) -> None:
    first = pp.Pick("bolt", pp.pose(xyz=(0.3, -0.3, 0.2), rpy=(np.pi, 0, 0)))
    grid = pp.picks.PickGrid(first, (4, 3, 2), (0.1, 0.1, 0.1))
    data = []
    found = pp.screen_picks(arms["ur5"], pp.Scene(), grid, progress=lambda *at: data.append(at))
    assert len(found) == 24
    assert data == [(24, 24)]
    np.testing.assert_array_equal(found.codes, pp.screen_picks(arms["ur5"], pp.Scene(), grid.load()).codes)


def test_the_limit_margin_is_that_of_the_joint_nearest_to_a_limit(arms) -> None:
    """1 in the middle of a range, 0 at a limit and beyond; joints without limits do not count."""
    arm = arms["ur5"]
    lower, upper = np.array([-1.0, -np.inf, 0.5, -3.0, -2.0, -6.0]), np.array([1.0, np.inf, 2.0, 1.0, 2.5, 6.0])
    arm = arm.with_limits(JointLimits(lower, upper, arm.limits.velocity, arm.limits.acceleration))
    rng = np.random.default_rng(1)
    low = rng.uniform(np.maximum(lower, -9.0) - 0.1, np.minimum(upper, 9.0) + 0.1, (200, 6))
    high = low + rng.uniform(0.0, 0.3, (200, 6))
    for ends, margins, least in (
        ((low, low), joint_margins(arm, low, low), limit_margin(arm, low)),
        ((low, high), joint_margins(arm, low, high), limit_margin(arm, low, high)),
    ):
        for row, (first, last) in enumerate(zip(*ends, strict=True)):
            expected = [
                1.0 if np.isinf(b - a) else max(0.0, 1.0 - 2 * max(abs(x - (a + b) / 2) for x in (p, q)) / (b - a))
                for a, b, p, q in zip(lower, upper, first, last, strict=True)
            ]
            np.testing.assert_allclose(margins[row], expected, atol=1e-12)
            assert least[row] == pytest.approx(min(expected), abs=1e-12)
    middle = np.where(np.isfinite(lower), (lower + np.where(np.isfinite(upper), upper, 0.0)) / 2, 0.0)
    assert limit_margin(arm, middle) == 1.0
