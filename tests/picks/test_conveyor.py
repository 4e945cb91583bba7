"""Picks from a conveyor, against forward kinematics and dense samples in space and time on exact meshes."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import audit
from pinproof.errors import PicksError
from pinproof.picks import Conveyor, PickSetup, PickStatus, Stage, pick_from_belt
from pinproof.picks.judging import conveyor
from pinproof.picks.judging.configurations import configurations
from pinproof.picks.judging.conveyor import _Phases
from pinproof.picks.judging.hand import OpenHand
from pinproof.picks.judging.task import PickTask
from pinproof.spatial import translated

from .conftest import cell_of

STEP = 0.01
"""rad or m between the samples of an audit."""


@cache
def cell():
    return cell_of("ur5", "conveyor_picks.yaml")


@cache
def setup():
    return PickSetup.make(*cell(), home=None, rng=0)


def task_of(pick: int = 0, arm: pp.Arm | None = None, **changes) -> PickTask:
    """A pick from the conveyor with another arm or other keys."""
    ours, scene, picks = cell()
    made = setup() if arm is None else PickSetup.make(arm or ours, scene, picks, home=None, rng=0)
    return PickTask(replace(picks.picks[pick], **changes), made.cell)


def at_grasp(task: PickTask, there: PickTask, member) -> np.ndarray:
    """(n,) the configuration at the grasp that is nearest to home."""
    many = configurations(task.arm, task.targets([there.grasp(member)]), task.cell.home, 0)[1]
    return many[np.abs(many - task.cell.home).max(axis=1).argmin()]


@cache
def first():
    """The verdict on the first pick, and the bodies on the belt against which the open hand is proven, by its stage."""
    seen, prove = {}, OpenHand.prove

    def recorded(hand: OpenHand, curve: object, grasp: object, **settings: object) -> object:
        if "part_at" in settings:
            seen[settings["closing"]] = {name for each in settings["movers"] for name in each.obstacles}
        return prove(hand, curve, grasp, **settings)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(OpenHand, "prove", recorded)
        return setup().judge(0, cell()[2].picks[0]), seen


def motion_named(name: str):
    return next(motion for motion in first()[0].motions if motion.name == name)


def touching(motion):
    """The pairs that may touch in a motion: the hand and the block, and the block and what it stands on at one end."""
    hand = [each.name for each in cell()[2].open_tool]
    block = "block_1"
    pairs = [(name, block) for name in hand] if motion.name != "transit" else []
    support = {"retreat": "belt", "place": "tray", "release": "tray"}.get(motion.name)
    return pairs + ([(block, support)] if support else [])


@pytest.mark.slow
def test_pick_from_a_moving_belt_is_free_at_dense_samples_on_exact_meshes() -> None:
    arm, (verdict, proven) = cell()[0], first()
    assert verdict.status is PickStatus.GOOD
    assert proven == {False: {"block_1"}, True: {"block_1"}}
    assert [motion.name for motion in verdict.motions] == [
        "transit", "approach", "tracking", "retreat", "transfer", "place", "release", "leave",
    ]  # fmt: skip
    for motion in verdict.motions:
        exact = pp.CollisionChecker(arm, motion.scene, attached=motion.attached, link_meshes="surface")
        exact = exact.allowing(*touching(motion))
        found = audit(motion.trajectory, exact, movers=motion.movers, step=STEP, measure=False)
        assert found.clean, (motion.name, found.message)
        on_belt = {name for mover in motion.movers for name in mover.obstacles}
        assert ("block_1" in on_belt) == (motion.name in ("transit", "approach", "tracking"))
        assert "block_2" in on_belt
        assert motion.certificate.free
        # Its certificate matches the motion only with its movers
        around = motion.trajectory, arm.with_held(motion.held), motion.scene, motion.attached
        assert motion.certificate.matches(*around, movers=motion.movers)
        assert not motion.certificate.matches(*around)
        assert not motion.certificate.matches(*around, movers=[mover.after(0.1) for mover in motion.movers])


@pytest.mark.slow
def test_tool_follows_the_block_within_the_reported_deviation_and_the_limits_of_the_joints() -> None:
    (arm, _, picks), (verdict, _) = cell(), first()
    tracking, belt, met = motion_named("tracking"), picks.conveyor, verdict.intercept
    assert tracking.trajectory.duration == pytest.approx(belt.dwell)
    for t in np.linspace(0.0, belt.dwell, 41):
        tip = arm.root_from_base * arm.forward_kinematics(tracking.trajectory(t)) * picks.tip
        expected = picks.picks[0].pose.translation + belt.travel(met.time + t)
        assert np.linalg.norm(tip.translation - expected) <= met.position_deviation + 1e-9
    assert met.position_deviation < 1e-5
    motion = verdict.trajectory
    assert (motion.max_velocity() <= arm.limits.velocity * (1 + 1e-6)).all()
    assert (motion.max_acceleration() <= arm.limits.acceleration * (1 + 1e-6)).all()
    assert not motion.velocities[[0, -1]].any()
    assert verdict.grasp_time == pytest.approx(met.time + belt.dwell - met.start_time)


@pytest.mark.slow
def test_lifted_block_does_not_sink_into_the_belt() -> None:
    arm, retreat = cell()[0], motion_named("retreat")
    (block,) = [thing for thing in retreat.attached if thing.name == "block_1"]
    corners = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.025, 0.025) for z in (-0.03, 0.03)])
    lowest = [
        min((arm.root_from_base * arm.forward_kinematics(q) * block.pose * corner)[2] for corner in corners)
        for q in retreat.trajectory(np.linspace(0.0, retreat.trajectory.duration, 200))
    ]
    assert min(lowest) > 0.1 - 2e-4
    assert lowest[-1] > 0.19


@pytest.mark.slow
def test_picks_one_after_the_other_are_on_the_clock_of_the_belt() -> None:
    belt, picks = cell()[2].conveyor, cell()[2].picks
    result = pick_from_belt(setup(), [*picks[:3], replace(picks[0], name="again")])
    assert len(result.taken) == 3
    assert len(result.cycle_times) == 3
    # A part that is taken is no longer on the belt
    assert [each.status for each in result.verdicts] == [PickStatus.GOOD] * 3 + [PickStatus.UNREADABLE]
    assert "block_1" in result.verdicts[3].reason
    placed, now = set(), 0.0
    for verdict in result.taken:
        assert verdict.intercept.start_time == pytest.approx(now)
        for motion in verdict.motions:
            for mover in motion.movers:
                for t, placement in zip((0.0, 1.0), mover.placements(np.array([0.0, 1.0])), strict=True):
                    assert placement[:3, 3] == pytest.approx(belt.travel(now + t), abs=1e-8)
                assert not placed & set(mover.obstacles)
            assert placed <= set(motion.scene.names)
            now += motion.trajectory.duration
        placed.add(verdict.pick.carried)
    assert result.end_time == pytest.approx(now)
    assert result.trajectory.duration == pytest.approx(now)
    for name, pick in zip(sorted(placed), picks, strict=False):
        block = result.taken[-1].motions[-1].scene[name].pose.translation
        assert block == pytest.approx(np.array([0.15, -0.5, 0.015]) + pick.place.pose.translation, abs=1e-6)


@pytest.mark.slow
def test_other_searches_refuse_picks_from_a_conveyor() -> None:
    bare = replace(cell()[2].picks[0], carried=None, place=None)
    for refused in (
        lambda: first()[0].program(),
        lambda: pp.screen_picks(*cell()),
        lambda: pp.sequence(setup(), cell()[2]),
        lambda: pick_from_belt(setup(), [bare]),
    ):
        with pytest.raises(pp.InputError, match="conveyor"):
            refused()


def changed(**changes):
    arm, scene, picks = cell()
    picks = replace(picks, conveyor=replace(picks.conveyor, **changes))
    return PickSetup.make(arm, scene, picks, home=None, rng=0).judge(0, picks.picks[0])


def judged_on_a_pallet(wall):
    """The verdict on a block on a moving pallet, with a wall of so many cells of 20 mm behind the block."""
    arm, scene, picks = cell()
    cells = np.zeros((6, 40, 12), np.uint8)
    cells[:, :, 0] = cells[:, 16:18, :wall] = 1
    pallet = pp.Obstacle("pallet", pp.OccupancyGrid(cells, 0.02, low=(-3, -20, 0)), pp.pose((0.62, -0.9, 0.1001)))
    others = [name for name in scene.names if name.startswith("block_")]
    scene = scene.remove(*others).add(replace(scene["block_1"], pose=pp.pose((0.62, -0.9, 0.15))), pallet)
    belt = replace(picks.conveyor, parts=("block_1", "pallet"), speed=0.3)
    pick = replace(picks.picks[0], pose=pp.pose((0.62, -0.9, 0.15), (np.pi, 0, 0)), place=None, support="pallet")
    picks = replace(picks, conveyor=belt, picks=(pick,))
    return PickSetup.make(arm, scene, picks, home=None, rng=0).judge(0, pick)


@pytest.mark.slow
def test_lifted_block_is_checked_against_the_support_that_moves_on_below_it() -> None:
    assert judged_on_a_pallet(wall=1).status is PickStatus.GOOD
    hit = judged_on_a_pallet(wall=9)  # the wall reaches the block while the tool gives up the speed of the belt
    assert hit.status is PickStatus.NOT_FOUND
    assert hit.failed is Stage.RETREAT
    assert "pallet" in hit.reason


@pytest.mark.slow
def test_pick_that_outlasts_the_belt_is_not_found_and_keeps_those_before() -> None:
    arm, scene, picks = cell()
    short = replace(picks, conveyor=replace(picks.conveyor, duration=8.0))
    result = pick_from_belt(PickSetup.make(arm, scene, short, home=None, rng=0), picks.picks[:2])
    assert [each.status for each in result.verdicts] == [PickStatus.GOOD, PickStatus.NOT_FOUND]
    assert "8 s" in result.verdicts[1].reason


@pytest.mark.slow
def test_reasons_of_picks_that_cannot_be_taken_from_the_belt() -> None:
    fast = changed(speed=3.0, duration=2.0)
    assert fast.status is PickStatus.NOT_FOUND
    away = changed(direction=(0, -1, 0))
    assert (away.status, away.failed) == (PickStatus.NOT_FOUND, Stage.REACH)
    assert "belt" in away.reason
    unknown = changed(parts=("block_1", "blok_2"))
    assert (unknown.status, unknown.failed) == (PickStatus.UNREADABLE, Stage.INPUT)
    assert "blok_2" in unknown.reason


def test_invalid_conveyors_are_refused(tmp_path) -> None:
    for changes, named in (
        ({"speed": 0.0}, "speed"),
        ({"speed": -0.2}, "speed"),
        ({"speed": float("nan")}, "speed"),
        ({"dwell": -0.1}, "dwell"),
        ({"duration": 0.0}, "duration"),
        ({"duration": 1000.0}, "travels"),
        ({"direction": (0, 0, 0)}, "direction"),
        ({"parts": ()}, "parts"),
        ({"parts": ("a", "a")}, "twice"),
        ({"tolerance": -1.0}, "tolerance"),
    ):
        with pytest.raises(pp.InputError, match=named):
            Conveyor(**{"speed": 0.2, "parts": ("block_1",), **changes})
    for stated, named in (("{speed: 0.2}", "conveyor.*parts"), ("{sped: 0.2, parts: [a]}", "conveyor.*sped")):
        path = tmp_path / "picks.yaml"
        path.write_text(f"robot: ur5\nconveyor: {stated}\npicks:\n  - {{name: a, xyz: [0, 0, 0], rpy: [0, 0, 0]}}\n")
        with pytest.raises(PicksError, match=named):
            pp.read_picks(path)


def test_velocity_of_the_tool_is_the_derivative_of_its_place_which_is_that_of_the_belt_and_its_lines() -> None:
    belt = replace(cell()[2].conveyor, direction=(0.6, 0.8, 0.0), speed=0.3, dwell=0.25)
    approach, retreat = np.array([0.01, -0.02, 0.1]), np.array([0.03, 0.01, 0.15])
    phases = _Phases(None, None, belt, approach, retreat, take_up=0.3, into=0.4, out=0.5, give_up=0.7)
    start, begin, meets, held, lifted, end = phases.times
    np.testing.assert_allclose(np.diff(phases.times), [0.3, 0.4, 0.25, 0.5, 0.7], atol=1e-12)
    assert meets == 0.0
    step = 1e-5
    for t in np.linspace(start + step, end - step, 301):
        ahead, behind = (phases.offset(t + by)[0] for by in (step, -step))
        np.testing.assert_allclose((ahead - behind) / (2 * step), phases.offset(t)[1], atol=1e-7)
        line = phases.offset(t)[0] - 0.3 * t * np.array(belt.direction)
        if held >= t >= meets:
            np.testing.assert_allclose(line, 0.0, atol=1e-12)
    # At rest at both ends; half of the time in which the speed changes is lost. The lines are complete.
    for t, moved, line in ((start, begin - 0.15, approach), (end, lifted + 0.35, retreat)):
        place, velocity = phases.offset(t)
        np.testing.assert_allclose(place, 0.3 * moved * np.array(belt.direction) + line, atol=1e-12)
        np.testing.assert_allclose(velocity, 0.0, atol=1e-12)
    np.testing.assert_allclose(phases.offset(begin)[0] - 0.3 * begin * np.array(belt.direction), approach, atol=1e-12)
    np.testing.assert_allclose(phases.offset(lifted)[0] - 0.3 * lifted * np.array(belt.direction), retreat, atol=1e-12)


@pytest.mark.parametrize(("slower", "speed", "line"), [(1.0, 0.05, 0.1), (0.25, 0.05, 0.1), (0.5, 0.2, 0.002)])
def test_phases_are_as_short_as_the_limits_allow_and_follow_the_exact_motion(monkeypatch, slower, speed, line) -> None:
    """Every phase has its shortest duration or reaches a limit of a joint; the tool is where the belt takes it."""
    arm, _, picks = cell()
    limits = replace(arm.limits, velocity=slower * arm.limits.velocity, acceleration=slower * arm.limits.acceleration)
    arm = arm.with_limits(limits)
    belt = replace(picks.conveyor, speed=speed, dwell=0.25)
    task = task_of(arm=arm, approach=line, retreat=line)
    there = conveyor._at_time(task, replace(belt, speed=0.2), 3.5)
    member = task.nearest_group[0]
    q = at_grasp(task, there, member)
    tried, original = [], conveyor._followed
    monkeypatch.setattr(conveyor, "_followed", lambda phases, q: tried.append(phases) or original(phases, q))
    found = conveyor.follow_belt(there, member, q, belt)
    assert not isinstance(found, str)
    phases = tried[-1]
    assert [found.approach.duration, found.tracking.duration, found.retreat.duration] == pytest.approx(
        [phases.take_up + phases.into, belt.dwell, phases.out + phases.give_up], abs=1e-6
    )
    assert found.before == pytest.approx(found.approach.duration, abs=1e-9)
    whole = pp.Trajectory.join(found.approach, found.tracking, found.retreat)
    assert not whole.velocities[[0, -1]].any()
    for t in np.linspace(0.0, whole.duration, 300):
        place = (arm.root_from_base * arm.forward_kinematics(whole(t)) * picks.tip).translation
        exact = there.grasp(member).translation + phases.offset(phases.times[0] + t)[0]
        assert np.linalg.norm(place - exact) < 2e-4
    first = (conveyor.SHORTEST, max(line / conveyor.LINE_SPEED, conveyor.SHORTEST)) * 2
    durations = (phases.take_up, phases.into, phases.give_up, phases.out)
    ends = np.cumsum([0.0, phases.take_up, phases.into, belt.dwell, phases.out, phases.give_up])
    for duration, shortest, k in zip(durations, first, (0, 1, 4, 3), strict=True):
        times = np.linspace(ends[k], ends[k + 1], 500)[1:-1]
        share = max(
            (np.abs(whole.velocity(times)) / limits.velocity).max(),
            np.sqrt((np.abs(whole.acceleration(times)) / limits.acceleration).max()),
        )
        assert share <= 1.0 + 1e-6
        assert duration == pytest.approx(shortest, abs=1e-6) or share > 0.85
    if slower < 1.0:
        assert len(tried) > 1


@pytest.mark.parametrize("start", [0.0, 2.37])
def test_meeting_times_are_those_at_which_the_nearest_reachable_grasp_can_be_reached_in_time(start: float) -> None:
    arm, _, picks = cell()
    sideways = replace(picks.picks[0], tolerance=pp.picks.GraspTolerance(position=(0.0, 0.04, 0.0)))
    for pick, duration in ((picks.picks[0], 20.0), (sideways, 20.0), (picks.picks[2], 6.0)):
        belt, task = replace(picks.conveyor, duration=duration), PickTask(pick, setup().cell)
        offered = list(conveyor._meeting_times(task, belt, start, 0))
        expected: list[tuple[float, str]] = []
        for group in task.groups():
            for time in start + conveyor.TIME_STEP * np.arange(1, 1000):
                if time >= belt.duration - belt.dwell - 1e-9:
                    break
                for member in group:
                    target = task.target(translated(task.grasp(member), belt.travel(time)))
                    branches = pp.AnalyticIk().solve_all(arm, target, task.cell.home).q
                    far = np.abs((branches - task.cell.home + np.pi) % (2 * np.pi) - np.pi)
                    if len(far) and (far / arm.limits.velocity).max(axis=1).min() <= time - start:
                        expected.append((time, member.words))
            if expected:
                break
        assert bool(offered) == bool(expected)
        assert len(offered) <= conveyor.TRIED
        if offered:
            assert (offered[0][0], offered[0][1].words) == pytest.approx(expected[0])
            times = [time for time, _ in offered]
            assert np.diff(times).min() >= conveyor.SPACING - 1e-6
            known = {(round(time, 6), words) for time, words in expected}
            assert {(round(time, 6), member.words) for time, member in offered} <= known


def test_a_lowered_support_touches_what_the_support_may_touch() -> None:
    arm, scene, _ = cell()
    scene = replace(scene, allowed=(*scene.allowed, ("belt", "block_1"), ("block_2", "belt"), ("tray", "block_1")))
    part = pp.Obstacle("part", pp.Box(0.02, 0.02, 0.02), pp.pose((0, 0, 0.2)))
    checker = pp.CollisionChecker(arm, scene, margin=0.002, attached=(part,))
    lowered = conveyor._with_lowered(checker, (("part", "belt"), ("part", "tray")))
    named = {frozenset(pair) for pair in lowered.scene.allowed}
    assert {frozenset(pair) for pair in scene.allowed} <= named
    for name in ("belt", "tray"):
        copy = lowered.scene[f"{name} (lowered)"]
        np.testing.assert_allclose(
            scene[name].pose.translation - copy.pose.translation, [0.0, 0.0, 0.002 + conveyor.SINK], atol=1e-12
        )
        assert not lowered.pairs_of_owners("part", name)
        assert lowered.pairs_of_owners("part", copy.name)
        for pair in scene.allowed:
            if name in pair:
                assert frozenset(copy.name if each == name else each for each in pair) in named
    assert conveyor._with_lowered(checker, ()) is checker


def test_a_motion_after_the_known_end_of_the_belt_is_not_proven_while_parts_are_on_it() -> None:
    arm, _, picks = cell()
    task = task_of()
    still = pp.Trajectory.at_rest(task.cell.home, arm.joint_names, 1.0)
    for start, raises in ((3.9, False), (4.1, True)):
        belt = replace(picks.conveyor, duration=5.0)
        moment = conveyor._Moment(task, belt, start, task.nearest_group[0], [0, 0, 0, 0], start)
        if raises:
            with pytest.raises(conveyor._InterceptRefused) as refused:
                moment._prove(still, task.outside)
            assert refused.value.stages[-1].stage is Stage.TIMING
        else:
            assert moment._prove(still, task.outside).free


def test_the_depth_of_the_palm_in_a_part_on_the_belt_is_that_where_the_part_is() -> None:
    """The hand rests 10 mm too low, and the belt brings the part to it."""
    arm, _, picks = cell()
    belt, task = picks.conveyor, task_of()
    there = conveyor._at_time(task, belt, 3.5)
    member = task.nearest_group[0]
    low = translated(there.grasp(member), belt.travel(1.0) + np.array((0.0, 0.0, -0.05)))
    many = configurations(arm, task.targets([low]), task.cell.home, 0)[1]
    still = pp.Trajectory.at_rest(many[0], arm.joint_names, 2.0)
    hand = there.passing(member)
    movers = (replace(belt, parts=("block_1",)).mover(("block_1",)),)
    part_at = lambda time: translated(hand.part.pose, belt.travel(time))  # noqa: E731
    failure = hand.prove(still, None, movers=movers, part_at=part_at, closing=True)
    assert failure is not None
    assert failure.depth == pytest.approx(0.01, abs=1e-3)
    assert "hand" in failure.reason


def test_a_belt_on_which_tracking_exceeds_a_limit_is_refused_with_the_joint_after_one_attempt(monkeypatch) -> None:
    """Longer phases do not help, because the speed of the belt is given."""
    arm, _, picks = cell()
    arm = arm.with_limits(replace(arm.limits, velocity=0.05 * arm.limits.velocity))
    belt, task = replace(picks.conveyor, speed=0.2, dwell=0.25), task_of(arm=arm)
    there = conveyor._at_time(task, belt, 3.5)
    member = task.nearest_group[0]
    q = at_grasp(task, there, member)
    attempts, original = [], conveyor._followed
    monkeypatch.setattr(conveyor, "_followed", lambda phases, q: attempts.append(phases) or original(phases, q))
    reason = conveyor.follow_belt(there, member, q, belt)
    assert isinstance(reason, str)
    assert len(attempts) == 1
    exceeded = re.search(r"the speed of (\w+) is ([\d.]+) rad/s; its limit is ([\d.]+) rad/s$", reason)
    joint = arm.joint_names.index(exceeded[1])
    assert float(exceeded[3]) == pytest.approx(arm.limits.velocity[joint], rel=5e-3)
    # The speed of the joint while the tip moves with the belt, from inverse kinematics at both ends of short steps
    times = np.linspace(0.0, belt.dwell, 26)
    targets = [task.target(translated(there.grasp(member), belt.travel(t))) for t in times]
    moved = pp.ik.track(arm, targets, q, dt=1.0, velocity=1e3).q
    speeds = np.abs(np.diff(moved, axis=0)).max(axis=0) / np.diff(times)[0]
    assert float(exceeded[2]) == pytest.approx(speeds[joint], rel=0.02)
    assert (speeds / arm.limits.velocity).max() == pytest.approx(speeds[joint] / arm.limits.velocity[joint])


@pytest.mark.parametrize("stage", [Stage.APPROACH, Stage.GRIP])
def test_a_hand_that_enters_the_moving_part_is_refused_at_the_stage_at_which_it_does(monkeypatch, stage) -> None:
    """The hand rests 10 mm too low while the belt brings the part to it, before or while the gripper closes."""
    arm, _, picks = cell()
    belt, task = picks.conveyor, task_of()
    member, start = task.nearest_group[0], 3.5

    def at_rest(by: float) -> pp.Trajectory:
        pose = translated(task.grasp(member), belt.travel(start + 1.0) + np.array((0.0, 0.0, by)))
        q = configurations(arm, task.targets([pose]), task.cell.home, 0)[1][0]
        return pp.Trajectory.at_rest(q, arm.joint_names, 2.0)

    low, high = at_rest(-0.05), at_rest(0.3)
    approach, tracking = (low, high) if stage is Stage.APPROACH else (high, low)
    free = pp.collision.certify(high, pp.CollisionChecker(arm, pp.Scene()))
    assert free.free
    monkeypatch.setattr(conveyor, "certify", lambda *_, **__: free)  # the hand alone is of interest
    monkeypatch.setattr(conveyor._Moment, "_add", lambda line, *_: setattr(line, "now", line.now + 2.0))
    begin = start if stage is Stage.APPROACH else start - 2.0
    moment = conveyor._Moment(task, belt, start, member, [0, 0, 0, 0], begin)
    attempt = conveyor.along(moment.then, conveyor.GraspCandidate(high.start, member, 0.0, 0.0))
    with pytest.raises(conveyor._InterceptRefused) as refused:
        moment._take(conveyor.Following(approach, tracking, high, 2.0, 0.0, 0.0), attempt)
    (failed,) = refused.value.stages
    assert failed.stage is stage
    assert float(re.search(r"([\d.]+) mm", failed.message)[1]) == pytest.approx(10.0, abs=1.0)


def test_at_a_time_every_part_on_the_belt_is_ahead_by_its_travel_and_nothing_else_is() -> None:
    belt, task = cell()[2].conveyor, task_of()
    there = conveyor._at_time(task, belt, 3.5)
    by = 3.5 * 0.2 * np.array([0.0, 1.0, 0.0])
    assert set(task.scene) > set(belt.parts)
    for name in task.scene:
        pose, moved = task.scene[name].pose, there.scene[name].pose
        expected = pose.translation + (by if name in belt.parts else 0.0)
        np.testing.assert_allclose(moved.translation, expected, atol=1e-12, err_msg=name)
        np.testing.assert_array_equal(moved.rotation, pose.rotation)
    np.testing.assert_allclose(there.pick.pose.translation, task.pick.pose.translation + by, atol=1e-12)
