"""Payloads, torque limits, speeds and upright objects of picks: files, timing, reports, and reasons."""

from __future__ import annotations

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

import pinproof as pp
from pinproof import InputError
from pinproof.description.catalogue import robots_folder
from pinproof.errors import PicksError
from pinproof.motion import JointPath, ToolLimits
from pinproof.picks import PickSetup, PickStatus, Stage
from pinproof.picks.input.pick import PARTS, ToolSpeed
from pinproof.picks.judging.grasp import reach, screen
from pinproof.picks.judging.task import PickTask, at_rest
from pinproof.picks.judging.timing import MotionPart, timed_curve

from .conftest import DOWN, judge_in

FOLDER = robots_folder() / "ur5"
LEVEL = np.radians(5.0)
ROW = "{name: bolt, xyz: [0.460, 0.150, 0.035], object: bolt_1, place: {frame: drop, xyz: [0, 0, 0], rpy: [pi, 0, 0]}}"


@pytest.fixture
def file(tmp_path):
    """Write carry.yaml with one pick, more shared settings and more defaults."""

    def write(shared="", defaults="", row=ROW):
        text = (FOLDER / "carry.yaml").read_text().split("picks:\n")[0]
        text = "\n".join(line for line in text.split("\n") if not line.startswith("payload:"))
        text = text.replace("scene: scene.yaml", f"scene: {FOLDER / 'scene.yaml'}\n{shared}")
        text = text.replace("defaults: {", f"defaults: {{{defaults}")
        (tmp_path / "picks.yaml").write_text(f"{text}picks:\n  - {row}\n")
        return tmp_path / "picks.yaml"

    return write


@pytest.fixture
def judge(file):
    def judged(**stated):
        picks = pp.read_picks(file(**stated))
        arm = picks.load_arm()
        report = pp.validate_picks(arm, pp.Scene.load(picks.scene), picks, budget=pp.picks.PickBudget(compared=1))
        return arm, report, report.verdicts[0]

    return judged


def test_torques_of_a_pick_are_limited_and_reported(judge):
    arm, report, verdict = judge(
        shared="payload: {mass: 1.5, center_of_mass: [0, 0, 0.05], inertia: [0.001, 0.001, 0.0005]}",
        defaults="payload: {mass: 2, center_of_mass: [0, 0, 0.01]}, ",
    )
    assert verdict.ok
    shares = {motion.name: max(peak.share for peak in motion.torques) for motion in verdict.motions}
    assert list(shares) == list(PARTS)
    assert verdict.stages[-1].figures["torque_share"] == max(shares.values()) <= 1.0
    assert "of its limit, in transfer" in verdict.stages[-1].message
    rows = report.to_dict()["picks"][0]["motions"][0]["torques"]
    assert [row["joint"] for row in rows] == list(arm.joint_names)
    assert any("friction" in note for note in report.notes)
    # The object is carried from the grasp to the release, at its own centre of mass.
    tool = pp.Payload(1.5, (0, 0, 0.05), (0.001, 0.001, 0.0005))
    for motion in verdict.motions:
        carried = [body for body in motion.attached if body.name == "bolt_1"]
        loads = [tool, *(pp.Payload(2.0, body.pose * np.array([0, 0, 0.01])) for body in carried)]
        assert bool(carried) is (motion.name in ("retreat", "transfer", "place"))
        largest = np.abs(pp.motion.TorqueLimits(arm, loads).peaks(motion.trajectory)[1].torque)
        assert motion.torques[1].torque == pytest.approx(largest, rel=1e-9)


@pytest.mark.parametrize(
    ("stated", "limited"),
    [
        ({}, False),
        ({"shared": "payload: {mass: 1.5}"}, True),
        ({"shared": "torque_limits: true"}, True),
        ({"defaults": "payload: {mass: 2}, "}, True),
        ({"shared": "payload: {mass: 1.5}", "defaults": "speed: 0.4, "}, True),
    ],
)
def test_torques_are_limited_if_a_payload_or_the_limits_are_stated(judge, stated, limited):
    arm, _, verdict = judge(**stated)
    assert verdict.ok
    assert ("torque_share" in verdict.stages[-1].figures) == limited
    for motion in verdict.motions:
        assert bool(motion.torques) == limited
        if limited and stated.get("shared"):
            tool = [pp.Payload(1.5)] if "payload" in stated["shared"] else []
            expected = pp.motion.TorqueLimits(arm, tool).peaks(motion.trajectory)
            assert [peak.torque for peak in motion.torques] == pytest.approx([peak.torque for peak in expected])


NEEDS = r"joint '\w+' needs \d+\.?\d* N m to hold the arm at rest at q = \[.*limit is (150|28) N m \(payload {} kg\)"


@pytest.mark.slow
def test_a_transfer_that_fails_only_because_of_torque_names_joint_torque_and_part(judge):
    _, _, verdict = judge(defaults="payload: {mass: 25}, ")
    assert (verdict.status, verdict.failed) == (PickStatus.NOT_FOUND, Stage.PLACE)
    assert re.search("^transfer: .*" + NEEDS.format(25), verdict.reason)


@pytest.mark.slow
def test_an_object_too_heavy_for_every_configuration_at_the_grasp_is_refuted(judge):
    arm, _, verdict = judge(defaults="payload: {mass: 60}, ")
    assert (verdict.status, verdict.failed) == (PickStatus.IMPOSSIBLE, Stage.GRASP)
    assert re.search("^" + NEEDS.format(60), verdict.reason)
    assert len(verdict.refuted) == 8
    assert sum(bool(re.search(NEEDS.format(60), each)) for each in verdict.refuted) == 4
    # The named configuration is an IK solution of the grasp, and cannot hold the object.
    q = [float(x) for x in re.search(r"q = \[(.*?)\]", verdict.reason)[1].split(",")]
    object_at_tip = pp.Payload(60.0, (arm.forward_kinematics(q).inverse() * np.array([0.46, 0.15, 0.015])))
    assert (np.abs(arm.torques(q, payload=object_at_tip)) > arm.limits.torque).any()


def test_parts_keep_their_speeds(judge):
    speed = "speed: {approach: 0.05, transfer: {linear_speed: 0.5, angular_speed: 2}, place: 0.08}, "
    arm, _, verdict = judge(defaults=speed)
    assert verdict.ok
    tool = ToolLimits(arm, linear_speed=1.0)
    found = {motion.name: tool.peaks(motion.trajectory) for motion in verdict.motions}
    for part, limit in {"approach": 0.05, "transfer": 0.5, "place": 0.08}.items():
        assert 0.9 * limit < found[part]["linear_speed"] <= limit * (1 + 2e-4 + 1e-9)  # the slack of the peak
    assert found["transfer"]["angular_speed"] <= 2.0 * (1 + 2e-4 + 1e-9)
    assert found["retreat"]["linear_speed"] > 0.2
    assert not verdict.motions[0].torques


def test_one_number_is_the_speed_of_all_parts_of_a_pick_without_an_object(judge):
    arm, _, verdict = judge(defaults="speed: 0.25, ", row="{name: bolt, xyz: [0.460, 0.150, 0.035]}")
    assert verdict.ok
    peaks = ToolLimits(arm, linear_speed=1.0).peaks(verdict.trajectory)
    assert 0.2 < peaks["linear_speed"] <= 0.25 * (1 + 2e-4 + 1e-9)


def test_a_table_states_mass_and_speed(tmp_path):
    (tmp_path / "table.csv").write_text(
        "name,x,y,z,roll,pitch,yaw,object,mass,center_x,center_y,center_z,speed\n"
        "a,0.46,0.15,0.035,pi,0,0,bolt_1,1.5,0,0,0.02,0.25\nb,0.46,0.15,0.035,pi,0,0,bolt_1,,,,,\n"
    )
    first, second = pp.read_picks(tmp_path / "table.csv")
    assert (first.payload.mass, first.payload.center_of_mass.tolist()) == (1.5, [0, 0, 0.02])
    assert first.speed == dict.fromkeys(PARTS, ToolSpeed(linear_speed=0.25))
    assert second.payload is None
    assert not second.speed


@pytest.mark.parametrize(
    ("shared", "named"),
    [
        ("payload: {mass: -1}", "key payload.*mass"),
        ("payload: {weight: 1}", "key payload.*'weight'.*mass"),
        ("payload: {mass: 1, inertia: [0.01, 0.01, 0.5]}", "key payload.*sum of the others"),
        ("payload: {mass: 1, frame: [a]}", "key payload.*frame"),
        ("torque_limits: 87", "key torque_limits.*true or false"),
    ],
)
def test_a_wrong_shared_payload_is_refused_with_its_key(file, shared, named):
    with pytest.raises(PicksError, match=named):
        pp.read_picks(file(shared=shared))


@pytest.mark.parametrize(
    ("stated", "named"),
    [
        ("payload: {mass: 1}", "payload and no object"),
        ("object: bolt_1, payload: {mass: 0}", "mass"),
        ("object: bolt_1, payload: {mass: 1, frame: tool0}", "frame"),
        ("speed: {aproach: 0.1}", "approach"),
        ("speed: 0", "speed must be a finite number above 0"),
        ("speed: {approach: {linear_sped: 0.1}}", "linear_speed"),
        ("speed: {approach: {}}", "linear_speed"),
        *((f"object: bolt_1, upright: {angle}", "pright") for angle in ("5 grad", "100 deg", "-5 deg", "0", "level")),
        ("object: bolt_1, upright: [5, deg]", "pright"),
    ],
)
def test_a_wrong_payload_speed_or_angle_of_a_pick_is_a_problem_of_its_row(file, stated, named):
    picks = pp.read_picks(file(row=f"{{name: a, xyz: [0, 0, 0], {stated}}}"))
    assert not picks.picks
    assert named in picks.problems[0].reason


def test_limits_that_cannot_be_kept_are_refused(file):
    picks = pp.read_picks(file(shared="torque_limits: true"))
    arm = picks.load_arm()
    bare = arm.with_limits(dataclasses.replace(arm.limits, torque=None))
    with pytest.raises(InputError, match=r"limit torques.*max_effort"):
        pp.validate_picks(bare, pp.Scene.load(picks.scene), picks)
    for stated, named in (({"upright": LEVEL}, "object"), ({"upright_axis": (0, 0, 1)}, "upright")):
        with pytest.raises(InputError, match=named):
            pp.Pick("part", pp.pose((0.4, 0, 0.1)), **stated)


def test_configurations_that_cannot_hold_the_object_at_rest_are_not_candidates(file):
    picks = pp.read_picks(file(defaults="payload: {mass: 20, center_of_mass: [0.1, 0, 0]}, "))
    arm, scene = picks.load_arm(), pp.Scene.load(picks.scene)
    task = PickTask(picks.picks[0], PickSetup.make(arm, scene, picks, home=None, rng=0).cell)
    group = task.nearest_group
    reached = reach(task, group, 0)
    centre = scene["bolt_1"].pose * np.array([0.1, 0, 0])

    def too_heavy(q):
        load = pp.Payload(20.0, (arm.root_from_base * arm.forward_kinematics(q)).inverse() * centre)
        return bool((np.abs(arm.torques(q, payload=load)) > arm.limits.torque).any())

    heavy = [too_heavy(q) for q in reached.q]
    reasons = at_rest(task, [group[i] for i in reached.member], reached.q)
    assert [bool(each) for each in reasons] == heavy
    free = [task.at_grasp.is_free(q) for q in reached.q]
    kept = {tuple(q) for q, good, bad in zip(reached.q, free, heavy, strict=True) if good and not bad}
    excluded = sum(good and bad for good, bad in zip(free, heavy, strict=True))
    assert 0 < excluded < sum(free)
    screened = screen(task, group, reached)
    assert {tuple(each.q) for each in screened.candidates} == kept
    assert f"{excluded} of them excluded by torque limits" in screened.stages[1].message


# -- upright objects, proven over their whole motion ------------------------------------------------------------------


@pytest.mark.parametrize(("text", "angle"), [("5 deg", LEVEL), ("0.1", 0.1), ("pi/36", LEVEL), ("0.1 rad", 0.1)])
def test_the_angle_is_read_in_degrees_or_radians(file, text: str, angle: float) -> None:
    (pick,) = pp.read_picks(file(row=f"{{name: a, xyz: [0, 0, 0], object: bolt_1, upright: {text}}}"))
    assert pick.upright == pytest.approx(angle, rel=1e-12)


@pytest.fixture
def upright(arms, cells):
    """Judge a pick whose object stays upright."""
    place = pp.picks.PlaceTarget(pp.pose((0.42, -0.35, 0.035), DOWN))
    pick = pp.Pick("level", pp.pose((0.46, 0.15, 0.035), DOWN), carried="bolt_1", upright=LEVEL, place=place)

    def judge(**changes: object) -> pp.picks.PickVerdict:
        changed = dataclasses.replace(pick, **changes)
        return judge_in(arms["ur5"], cells["ur5"][0], changed, tip=pp.pose((0, 0, 0.105)), margin=0.002)

    return judge


@pytest.mark.slow
def test_the_object_stays_upright_from_the_grasp_to_the_release(arms, upright) -> None:
    verdict = upright()
    assert verdict.ok
    for motion in verdict.motions:
        carried = motion.name in ("retreat", "transfer", "place")
        assert len(motion.certificate.constraints) == carried
        if carried:  # the angle between the tool axis and the vertical, at samples of 0.002 rad
            rough = motion.trajectory(np.linspace(*motion.trajectory.domain, 500))
            count = int(np.abs(np.diff(rough, axis=0)).max(axis=1).sum() / 0.002) + 2
            q = motion.trajectory(np.linspace(*motion.trajectory.domain, count))
            tilts = np.arccos(np.clip(-arms["ur5"].forward_kinematics_batch(q)[:, 2, 2], -1.0, 1.0))
            assert tilts.max() <= motion.certificate.constraints[0].largest <= LEVEL
    transfer = next(each.trajectory for each in verdict.motions if each.name == "transfer")
    resting = np.flatnonzero(~transfer.velocities.any(axis=1))
    assert set(resting) <= {0, len(transfer.times) - 1}  # no stop on the way


@pytest.mark.slow
def test_a_release_or_a_grasp_with_a_tilted_object_fails(upright) -> None:
    place = pp.picks.PlaceTarget(pp.pose((0.42, -0.35, 0.15), (np.pi, 0.3, 0.0)), approach=0.02)
    tilted, leaning = upright(place=place), upright(upright_axis=(0.0, 0.2, -1.0))
    assert tilted.failed is leaning.failed is Stage.PLACE
    assert "upright" in leaning.stages[-1].message
    assert "upright" in tilted.stages[-1].message
    assert "17.19 deg, 12.19 deg too much" in tilted.stages[-1].message  # 0.3 rad


def test_a_shortened_transfer_is_proven_to_be_upright(arms) -> None:
    arm = arms["ur5"]
    start = np.array([0.0, -1.2, 1.6, -1.97, -np.pi / 2, 0.0])
    middle, end = start + np.array([0.6, 0, 0, 0, 0, 0]), start + np.array([1.2, 0, 0, 0, 0, 0.4])
    upright = pp.Upright.keeping(arm, start, tolerance=LEVEL)
    task = SimpleNamespace(arm=arm, cell=SimpleNamespace(budget=pp.picks.PickBudget(motion=20)))
    path = JointPath([start, middle, end], arm.joint_names)
    part = MotionPart("transfer", (path,), pp.CollisionChecker(arm, pp.Scene()), constraints=(upright,))
    trajectory, certificate = timed_curve(task, part, path, [])
    assert certificate.free
    (kept,) = certificate.constraints
    assert kept.largest <= LEVEL
    np.testing.assert_array_equal(trajectory.end, end)
