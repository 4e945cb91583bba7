"""Motions that pass the ends of the straight lines of a pick without a stop."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError
from pinproof.motion import Bounds, MotionProgram
from pinproof.picks import PickBudget, PickSetup, PickVerdict
from pinproof.picks.judging.timing import GAIN, SPEEDS, LineEnd, join_lines

from .conftest import cell_of


@pytest.fixture(scope="module")
def carry() -> pp.Picks:
    """A pick of a UR5 with an object and a place."""
    return cell_of("ur5", "carry.yaml", "over_the_wall")[2]


def judged(picks: pp.Picks, *, motion: int = 100, home=None) -> tuple[PickSetup, PickVerdict]:
    arm, scene = picks.load_arm(), pp.Scene.load(picks.scene)
    setup = PickSetup.make(arm, scene, picks, home=home, rng=0, budget=PickBudget(motion=motion))
    verdict = setup.judge(0, picks.picks[0])
    assert verdict.ok
    return setup, verdict


def excess(verdict: PickVerdict, arm: pp.Arm) -> float:
    """The largest share of a limit, on a dense grid that includes both sides of every point."""
    motion = verdict.trajectory
    times = np.unique(np.concatenate([np.linspace(0.0, motion.duration, 10_001), motion.times]))
    speed = np.abs(motion.velocity(times)) / arm.limits.velocity
    acceleration = np.abs(motion.acceleration(times)) / arm.limits.acceleration
    return float(max(speed.max(), acceleration.max()))


def test_the_arm_rests_only_at_the_ends_at_the_grasp_and_at_the_release(carry) -> None:
    setup, verdict = judged(carry)
    motion = verdict.trajectory
    resting = motion.times[~motion.velocities.any(axis=1)]
    np.testing.assert_allclose(resting, [0.0, verdict.grasp_time, verdict.release_time, motion.duration], atol=1e-12)
    assert excess(verdict, setup.checker.arm) <= 1.0 + 1e-9
    for each in verdict.motions:
        around = each.certificate
        arm = setup.checker.arm.with_held(each.held)
        assert around.free
        assert around.matches(each.trajectory, arm, each.scene, each.attached)
    stopping = judged(carry, motion=0)[1]
    assert motion.duration < 0.9 * stopping.trajectory.duration


@pytest.mark.parametrize("straight", [0.25, 0.5, 1.0])
def test_the_stated_share_of_each_line_is_straight(carry, straight: float) -> None:
    setup, verdict = judged(replace(carry, straight=straight))
    arm, pick = setup.checker.arm, verdict.pick
    parts = {each.name: each.trajectory for each in verdict.motions}
    for name, length, inner in (("approach", pick.approach, -1), ("retreat", pick.retreat, 0), ("place", None, -1)):
        q = parts[name](np.linspace(0.0, parts[name].duration, 200))
        poses = [arm.root_from_base * arm.forward_kinematics(each) * carry.tip for each in q]
        length = pick.place.approach if length is None else length
        along = np.array([each.translation - poses[inner].translation for each in poses])
        far = np.linalg.norm(along, axis=1).max()
        assert straight * length - 1e-4 <= far <= length + 1e-4
        direction = along[np.linalg.norm(along, axis=1).argmax()] / far
        assert np.linalg.norm(along - np.outer(along @ direction, direction), axis=1).max() < 1.01e-3
        assert max(np.linalg.norm(each.rotation - poses[inner].rotation) for each in poses) < 5e-3
        assert parts[name].velocities[-1 - inner].any() or straight == 1.0  # no stop at the outer end
    if straight == 0.5:
        assert verdict.trajectory.duration > judged(replace(carry, straight=0.25))[1].trajectory.duration


def test_a_stated_speed_holds_on_the_complete_line(carry) -> None:
    pick = replace(carry.picks[0], speed={"approach": pp.picks.ToolSpeed(linear_speed=0.2)})
    setup, verdict = judged(replace(carry, picks=(pick,)))
    arm = setup.checker.arm
    approach = next(each.trajectory for each in verdict.motions if each.name == "approach")
    travelled = arm.forward_kinematics(approach.end).translation - arm.forward_kinematics(approach.start).translation
    assert np.linalg.norm(travelled) == pytest.approx(pick.approach, abs=1e-4)
    assert pp.motion.ToolLimits(arm, linear_speed=0.2).excess(approach).max() <= 1.0 + 1e-9
    assert approach.velocities[0].any()


def test_a_program_of_a_motion_without_stops_is_read_back_and_certified_again(carry, tmp_path) -> None:
    setup, verdict = judged(carry)
    program = verdict.program(grip_dwell=0.3, release_dwell=0.2)
    for before, after in pairwise(program.segments):
        np.testing.assert_array_equal(before.trajectory.velocities[-1], after.trajectory.velocities[0])
    program.save(tmp_path / "program.json")
    again = MotionProgram.load(tmp_path / "program.json")
    assert all(each.free for each in setup.recertify(again, verdict.pick))
    verdict.save_motion(tmp_path / "motion.json")
    loaded = pp.Trajectory.load(tmp_path / "motion.json")
    assert [each.name for each in loaded.certified] == [each.name for each in verdict.motions]
    assert loaded.digest() == verdict.trajectory.digest()
    first = program.segments[0]
    moved = first.trajectory
    faster = pp.Trajectory(moved.times, moved.q, 1.01 * moved.velocities, program.joint_names)
    with pytest.raises(InputError, match="different velocities"):
        replace(program, segments=(replace(first, trajectory=faster), *program.segments[1:]))
    # It must not end with an event while the arm moves
    first = next(each for each in program.segments if each.trajectory.velocities[-1].any())
    last = replace(program.events[0], time=first.trajectory.duration)
    with pytest.raises(InputError, match="moves at the event"):
        replace(program, segments=(replace(first, start=0.0),), events=(last,))


def test_the_arm_may_start_where_the_approach_begins(carry) -> None:
    _, verdict = judged(carry, motion=0)
    home = next(each.trajectory for each in verdict.motions if each.name == "approach").start
    np.testing.assert_array_equal(judged(carry, home=home)[1].trajectory.start, home)
    # Home at the start of the approach leaves nothing to join
    judged(carry, home=verdict.motions[0].trajectory.end)


@pytest.mark.parametrize("wrong", [0.0, -0.5, 1.5])
def test_a_wrong_straight_share_is_refused(wrong: float) -> None:
    with pytest.raises(InputError, match="straight"):
        pp.Picks((), straight=wrong)


class Records:
    """Moving ends that make no motion but record the longest time that it may take."""

    def __init__(self) -> None:
        self.longest: list[float] = []

    def direct(self, _start: object, _end: object, longest: float) -> None:
        self.longest.append(longest)

    def changed(self, _stopping: object, _start: object, _end: object, longest: float) -> None:
        self.longest.append(longest)


def line_end(arm: pp.Arm, *, arrives: bool, straight: float = 0.5) -> LineEnd:
    """A vertical line of 100 mm at a pose of a UR5."""
    q = np.array([0.3, -1.4, 1.7, -1.9, -1.57, 0.2])
    here = arm.forward_kinematics(q)
    line = pp.plan_linear(pp.CollisionChecker(arm, pp.Scene()), q, pp.pose((0, 0, 0.1)) * here).path
    path = line.reversed() if arrives else line
    return LineEnd(arm, path, pp.time_parametrise(path, arm.limits), arrives, straight, ())


def test_a_motion_without_a_stop_must_be_shorter_than_the_one_with_stops_by_what_the_lines_save() -> None:
    arm = pp.load_robot("ur5").arm()
    before, after = line_end(arm, arrives=False), line_end(arm, arrives=True)
    stops = np.array([before.path.end, after.path.start + 0.4])
    stopping = pp.time_parametrise(pp.JointPath(stops, arm.joint_names), arm.limits)
    bounds = Bounds.of(arm.limits, arm.joint_names)
    far, v, a = np.abs(stops[1] - stops[0]), arm.limits.velocity, arm.limits.acceleration
    least = np.where(far >= v**2 / a, far / v + v / a, 2.0 * np.sqrt(far / a)).max()  # of any motion from rest to rest
    for lines in ((before, after), (before, None), (None, after)):
        ends = Records()
        assert join_lines(ends, bounds, lines, stops, lambda: stopping, lambda *_: None) is None
        expected = []
        for number in range(4):
            for use in ((True, True), (False, True), (True, False)) if None not in lines else ((True, True),):
                parts = [line.option(number) if line and used else None for line, used in zip(lines, use, strict=True)]
                if any(line and used and part is None for line, used, part in zip(lines, use, parts, strict=True)):
                    continue
                saved = sum(
                    line.stopping.duration - part.duration for line, part in zip(lines, parts, strict=True) if part
                )
                expected += [least + saved - GAIN] if not expected else []
                expected.append(stopping.duration + saved - GAIN)
        np.testing.assert_allclose(ends.longest, expected, atol=1e-6)
        assert len(expected) > 3


@pytest.mark.parametrize("arrives", [False, True])
def test_a_line_with_a_moving_end_has_a_share_of_its_largest_speed_along_its_tangent(arrives) -> None:
    arm = pp.load_robot("ur5").arm()
    end = line_end(arm, arrives=arrives)
    outer, inner = (0, -1) if arrives else (-1, 0)
    peak = np.linalg.norm(end.stopping.velocities, axis=1).max()
    points = end.path.bezier()[1]
    tangent = points[0, 1] - points[0, 0] if arrives else points[-1, -1] - points[-1, -2]
    whole = [end.option(number) for number in (1, 2, 3)]
    assert sum(each is not None for each in whole) >= 2
    for motion, share in zip(whole, SPEEDS, strict=True):
        if motion is None:
            continue
        assert motion.velocities[outer] == pytest.approx(share * peak * tangent / np.linalg.norm(tangent), rel=1e-6)
        assert not motion.velocities[inner].any()
        np.testing.assert_allclose(motion.start, end.path.start, atol=1e-12)
        np.testing.assert_allclose(motion.end, end.path.end, atol=1e-12)
        assert motion.duration < end.stopping.duration
    short = end.option(0)
    full, left = (
        np.linalg.norm(arm.forward_kinematics(each.start).translation - arm.forward_kinematics(each.end).translation)
        for each in (end.stopping, short)
    )
    assert 0.5 * full <= left < 0.6 * full
    assert short.velocities[outer].any()
    np.testing.assert_allclose((short.end if arrives else short.start), end.stopping.q[inner], atol=1e-12)
    assert line_end(arm, arrives=arrives, straight=0.8).option(0) is None
