"""A motion file records what its motion was certified with, and refuses a record that makes no sense."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import pinproof as pp
from pinproof.errors import InputError, TrajectoryError


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return pp.load_robot("generic_6dof").arm()


@pytest.fixture(scope="module")
def motion(arm: pp.Arm) -> pp.Trajectory:
    return pp.time_parametrise(pp.JointPath([arm.home, arm.home + 0.05], arm.joint_names), arm.limits)


@pytest.fixture(scope="module")
def certificate(arm: pp.Arm, motion: pp.Trajectory) -> pp.Certificate:
    ball = pp.Obstacle("ball", pp.Sphere(radius=0.02), pp.pose((0, 0, 0.1)))
    scene = pp.Scene([pp.Obstacle("post", pp.Sphere(radius=0.02), pp.pose((0, 0, 5)))])
    return pp.certify(motion, pp.CollisionChecker(arm, scene, attached=[ball], allowed=[]))


@pytest.mark.parametrize("name", ["motion.json", "motion.csv"])
def test_the_record_comes_back(tmp_path: Path, motion: pp.Trajectory, certificate: pp.Certificate, name: str) -> None:
    motion.save(tmp_path / name, certificate=certificate)
    found = pp.Trajectory.load(tmp_path / name)
    assert found.certified == (certificate.motion_record(end=motion.duration),)
    (record,) = found.certified
    assert (record.status, record.pairs, record.setup) == (
        certificate.status.name,
        certificate.pairs,
        certificate.setup,
    )
    assert (tuple(record.attached), record.obstacles) == (("ball",), ("post",))
    assert record.curve == found.digest() == certificate.curve
    found.save(tmp_path / f"again_{name}")
    assert pp.Trajectory.load(tmp_path / f"again_{name}").certified == found.certified
    assert pickle.loads(pickle.dumps(found)).certified == found.certified


def test_joints_in_another_order_keep_the_record_of_the_same_motion(
    tmp_path: Path, motion: pp.Trajectory, certificate: pp.Certificate
) -> None:
    motion.save(tmp_path / "motion.json", certificate=certificate)
    turned = pp.Trajectory.load(tmp_path / "motion.json", motion.joint_names[::-1])
    assert turned.digest() != motion.digest()
    assert turned.certified[0].curve == turned.digest()


def test_another_motion_has_no_record(motion: pp.Trajectory, certificate: pp.Certificate, tmp_path: Path) -> None:
    slower = motion.slowed(2.0)
    assert slower.certified == ()
    with pytest.raises(InputError, match="another motion"):
        slower.save(tmp_path / "motion.json", certificate=certificate)
    assert not (tmp_path / "motion.json").exists()
    motion.save(tmp_path / "motion.json", certificate=certificate)
    found = pp.Trajectory.load(tmp_path / "motion.json")
    assert found.slowed(2.0).certified == ()
    assert pp.Trajectory.join(found).certified == ()


def test_a_checker_without_the_recorded_body_is_noted_in_the_certificate(
    tmp_path: Path, arm: pp.Arm, motion: pp.Trajectory, certificate: pp.Certificate
) -> None:
    motion.save(tmp_path / "motion.json", certificate=certificate)
    bare = pp.certify(pp.Trajectory.load(tmp_path / "motion.json"), pp.CollisionChecker(arm))
    assert any("ball" in note for note in bare.notes)
    assert any("post" in note for note in bare.notes)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda r: r.clear(), "does not state name and start"),
        (lambda r: r.update(extra=1), "extra"),
        (lambda r: r.update(margin=True), "margin"),
        (lambda r: r.update(margin=None), "margin"),
        (lambda r: r.update(end=10**400), "end"),
        (lambda r: r.update(pairs=1.5), "pairs"),
        (lambda r: r.update(status=1), "status"),
        (lambda r: r.update(attached=["ball"]), "attached"),
        (lambda r: r.update(attached={"ball": 1}), "1"),
        (lambda r: r.update(held={"joint": "far"}), "held.joint"),
        (lambda r: r.update(obstacles="post"), "obstacles"),
        (lambda r: r.update(obstacles=[1]), "1"),
    ],
)
def test_a_record_that_makes_no_sense_is_refused(
    tmp_path: Path, motion: pp.Trajectory, certificate: pp.Certificate, change: Any, named: str
) -> None:
    file = tmp_path / "motion.json"
    motion.save(file, certificate=certificate)
    data = json.loads(file.read_text())
    change(data["pinproof"]["certified"][0])
    file.write_text(json.dumps(data))
    with pytest.raises(TrajectoryError, match="certified") as caught:
        pp.Trajectory.load(file)
    assert named in str(caught.value)


def test_records_must_be_a_list(tmp_path: Path, motion: pp.Trajectory) -> None:
    file = tmp_path / "motion.json"
    motion.save(file)
    assert "certified" not in json.loads(file.read_text())["pinproof"]
    data = json.loads(file.read_text())
    data["pinproof"]["certified"] = {"status": "FREE"}
    file.write_text(json.dumps(data))
    with pytest.raises(TrajectoryError, match="certified"):
        pp.Trajectory.load(file)


def test_each_difference_from_the_recorded_certification_is_noted(tmp_path: Path, arm: pp.Arm, motion) -> None:
    """The same setup has no such note; one of a smaller margin, without a constraint, or with other bodies has."""
    ball = pp.Obstacle("ball", pp.Sphere(radius=0.02), pp.pose((0, 0, 0.1)))
    scene = pp.Scene([pp.Obstacle("post", pp.Sphere(radius=0.02), pp.pose((0, 0, 5)))])
    checker = pp.CollisionChecker(arm, scene, attached=[ball], margin=0.002)
    tilt = pp.Upright.keeping(arm, motion.start, tolerance=1.0)
    motion.save(tmp_path / "motion.json", certificate=pp.certify(motion, checker, constraints=[tilt]))
    found = pp.Trajectory.load(tmp_path / "motion.json")

    def notes(other: pp.CollisionChecker, constraints=(tilt,), curve=found) -> list[str]:
        certificate = pp.certify(curve, other, constraints=constraints)
        return [note for note in certificate.notes if note.startswith("the file of the motion")]

    assert notes(checker) == []
    assert notes(checker.with_margin(0.003)) == []
    (smaller,) = notes(checker.with_margin(0.001))
    assert "margin of 2 mm" in smaller
    (lost,) = notes(checker, constraints=())
    assert "Upright" in lost
    (another,) = notes(checker.with_scene(scene.move("post", pp.pose((0, 0, 4)))))
    assert "another scene" in another
    (moved,) = notes(
        pp.CollisionChecker(arm, scene, attached=[replace(ball, pose=pp.pose((0, 0, 0.101)))], margin=0.002)
    )
    assert "ball" in moved
    (empty,) = notes(checker.with_scene(pp.Scene()))
    assert "post" in empty
    assert notes(pp.CollisionChecker(arm, scene, margin=0.002))[0].count("ball") == 1
