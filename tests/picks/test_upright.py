"""Picks that state upright: the object stays upright while it is carried, proven over its whole motion."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.motion import JointPath
from pinproof.picks import Stage
from pinproof.picks.judging.timing import MotionPart, timed_curve

LEVEL = math.radians(5.0)
QUICK = pp.picks.PickBudget(remedies=0, compared=1)
FILE = """\
defaults: {rpy: [pi, 0, 0], approach: 0.1, retreat: 0.1}
tip: {xyz: [0, 0, 0.105]}
picks:
  - name: level
    xyz: [0.46, 0.15, 0.035]
    object: bolt_1
    upright: UPRIGHT
    place: {xyz: [0.42, -0.35, 0.035], rpy: [pi, 0, 0]}
"""


def read(tmp_path, upright: str) -> pp.Picks:
    file = tmp_path / "picks.yaml"
    file.write_text(FILE.replace("UPRIGHT", upright), encoding="utf-8")
    return pp.read_picks(file)


def judge(picks: pp.Picks, **changes: object) -> pp.picks.PickVerdict:
    scene = pp.Scene.load(robots_folder() / "ur5" / "scene.yaml")
    picks = replace(picks, picks=(replace(picks.picks[0], **changes),), margin=0.002)
    return pp.validate_picks(pp.load_robot("ur5").arm(), scene, picks, budget=QUICK).verdicts[0]


def tilts(verdict: pp.picks.PickVerdict, name: str) -> np.ndarray:
    """The angles between the tool axis and the vertical along one motion, at samples of 0.002 rad."""
    arm, motion = pp.load_robot("ur5").arm(), next(each for each in verdict.motions if each.name == name)
    rough = motion.trajectory(np.linspace(*motion.trajectory.domain, 500))
    count = int(np.abs(np.diff(rough, axis=0)).max(axis=1).sum() / 0.002) + 2
    axes = arm.forward_kinematics_batch(motion.trajectory(np.linspace(*motion.trajectory.domain, count)))[:, 2, 2]
    return np.arccos(np.clip(-axes, -1.0, 1.0))


@pytest.mark.parametrize(("text", "angle"), [("5 deg", LEVEL), ("0.1", 0.1), ("pi/36", LEVEL), ("0.1 rad", 0.1)])
def test_the_angle_is_read_in_degrees_or_radians(tmp_path, text: str, angle: float) -> None:
    assert read(tmp_path, text).picks[0].upright == pytest.approx(angle, rel=1e-12)


@pytest.mark.parametrize("text", ["5 grad", "100 deg", "-5 deg", "0", "[5, deg]", "level"])
def test_what_is_no_angle_is_a_problem_of_its_pick(tmp_path, text: str) -> None:
    picks = read(tmp_path, text)
    assert picks.picks == ()
    assert "upright" in picks.problems[0].reason.lower()


@pytest.mark.slow
def test_the_object_stays_upright_from_the_grasp_to_the_release(tmp_path) -> None:
    verdict = judge(read(tmp_path, "5 deg"))
    assert verdict.ok
    for motion in verdict.motions:
        carried = motion.name in ("retreat", "transfer", "place")
        assert len(motion.certificate.constraints) == carried
        if carried:
            assert tilts(verdict, motion.name).max() <= motion.certificate.constraints[0].largest <= LEVEL
    transfer = next(each.trajectory for each in verdict.motions if each.name == "transfer")
    resting = np.flatnonzero(~transfer.velocities.any(axis=1))
    assert set(resting) <= {0, len(transfer.times) - 1}  # no stop on the way


@pytest.mark.slow
def test_a_release_with_a_tilted_object_fails_with_the_excess(tmp_path) -> None:
    picks = read(tmp_path, "5 deg")
    place = replace(picks.picks[0].place, pose=pp.pose((0.42, -0.35, 0.15), (np.pi, 0.3, 0.0)), approach=0.02)
    verdict = judge(picks, place=place)
    assert verdict.failed is Stage.PLACE
    reason = verdict.stages[-1].message
    assert "upright" in reason
    assert "17.19 deg, 12.19 deg too much" in reason  # 0.3 rad


@pytest.mark.slow
def test_an_axis_that_does_not_point_up_at_the_grasp_fails(tmp_path) -> None:
    verdict = judge(read(tmp_path, "5 deg"), upright_axis=(0.0, 0.2, -1.0))
    assert verdict.failed is Stage.PLACE
    assert "upright" in verdict.stages[-1].message


def test_upright_needs_an_object() -> None:
    with pytest.raises(pp.InputError, match="object"):
        pp.Pick("part", pp.pose((0.4, 0, 0.1)), upright=LEVEL)
    with pytest.raises(pp.InputError, match="upright"):
        pp.Pick("part", pp.pose((0.4, 0, 0.1)), upright_axis=(0, 0, 1))


def test_a_shortened_transfer_is_proven_to_be_upright() -> None:
    arm = pp.load_robot("ur5").arm()
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
