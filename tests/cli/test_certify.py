"""``pinproof certify`` with a proof to save, a proof to verify, and an audit by sampling."""

from __future__ import annotations

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp

from ..pages import Run

HOME = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])


@pytest.fixture
def run(run: Run, tmp_path: Path) -> Run:
    """Run ``certify`` in a folder with a motion and a scene: exit code, stdout, stderr."""
    arm = pp.load_robot("ur5").arm()
    q = HOME + np.array([[0, 0, 0, 0, 0, 0], [0.3, 0.1, 0, 0, 0, 0.2]])
    pp.time_parametrise(pp.JointPath(q, arm.joint_names), arm.limits).save(tmp_path / "motion.json")
    pp.Scene([pp.Obstacle("box", pp.Box(0.2, 0.2, 0.2), pp.pose((0.9, 0.3, 0.4)))]).save(tmp_path / "scene.yaml")
    pp.Scene([pp.Obstacle("box", pp.Box(0.2, 0.2, 0.2), pp.pose((0.9, 0.3, 0.3)))]).save(tmp_path / "moved.yaml")
    wall = pp.Box(0.02, 1.0, 1.0)
    across = arm.forward_kinematics(q.mean(axis=0)).translation
    pp.Scene([pp.Obstacle("wall", wall, pp.pose(across))]).save(tmp_path / "wall.yaml")
    return partial(run, "certify")


@pytest.mark.slow
def test_a_proof_is_saved_and_verified_by_the_same_command(run: Run) -> None:
    words = ("ur5", "motion.json", "--scene", "scene.yaml", "--margin", "0.002")
    code, out, _ = run(*words, "--obstacle-tolerance", "0.003", "--save-proof", "proof.json.gz")
    assert code == 0
    assert "obstacles may deviate by up to 3 mm" in out
    assert "wrote proof.json.gz" in out
    code, out, _ = run(*words, "--verify", "proof.json.gz")
    assert code == 0
    assert "compared with your files: the robot, the scene, the joint limits, the motion" in out
    assert "not checked: base_link and shoulder_link" in out
    code, out, _ = run("--verify", "proof.json.gz", "--json")
    answer = json.loads(out)
    assert code == 0
    assert answer["ok"] is True
    assert answer["margin"] == 0.002
    assert answer["obstacle_tolerance"] == 0.003
    assert answer["not_compared"] == ["the robot", "the scene", "the motion"]


@pytest.mark.slow
def test_a_proof_for_something_else_is_rejected(run: Run) -> None:
    assert run("ur5", "motion.json", "--scene", "scene.yaml", "--save-proof", "proof.json")[0] == 0
    code, out, _ = run("ur5", "motion.json", "--scene", "moved.yaml", "--verify", "proof.json")
    assert code == 1
    assert "REFUSED: bodies" in out
    assert "your box" in out
    Path("proof.json").write_text(
        Path("proof.json").read_text().replace('"obstacle_tolerance":0.0', '"obstacle_tolerance":1.0')
    )
    code, out, _ = run("--verify", "proof.json")
    assert code == 1
    assert "larger than 1 m" in out


def test_no_proof_is_written_for_a_motion_in_contact(run: Run) -> None:
    code, out, _ = run("ur5", "motion.json", "--scene", "wall.yaml", "--save-proof", "proof.json")
    assert code == 1
    assert "proof.json is not written" in out
    assert not Path("proof.json").exists()


@pytest.mark.slow
def test_the_audit_states_its_samples_and_the_contact(run: Run) -> None:
    code, out, _ = run("ur5", "motion.json", "--scene", "scene.yaml", "--audit", "--audit-step", "0.01")
    assert code == 0
    assert "triangle meshes" in out
    assert "smallest distance is" in out
    code, out, _ = run("ur5", "motion.json", "--scene", "wall.yaml", "--audit", "--audit-step", "0.01", "--json")
    answer = json.loads(out)
    assert code == 1
    assert "touches wall" in answer["audit"]["message"]
    assert answer["audit"]["samples"] > 20


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ((), "ROBOT or MOTION"),
        (("ur5",), "ROBOT or MOTION"),
        (("--verify", "nowhere.json"), "nowhere.json"),
        (("--verify", "scene.yaml"), "scene.yaml"),
        (("--verify", "motion.json", "--scene", "scene.yaml"), "ROBOT"),
        (("--verify", "motion.json", "--audit"), "--verify"),
        (("ur5", "motion.json", "--save-proof", "motion.json"), "motion.json"),
        (("ur5", "motion.json", "--save-proof", "proof.yaml"), "proof.yaml"),
    ],
)
def test_wrong_usage_differs_from_a_negative_result(run: Run, words: tuple[str, ...], named: str) -> None:
    code, _, err = run(*words)
    assert code == 2
    assert named in err


def test_torque_and_tool_speed_are_checked_between_samples(run: Run) -> None:
    code, out, _ = run("ur5", "motion.json", "--payload", "2 0 0 0.1")
    assert code == 0
    assert re.search(r"largest torque: shoulder_lift_joint: \d+\.?\d* N m, \d+ % of its limit at", out)
    code, out, _ = run("ur5", "motion.json", "--payload", "60", "--tool-speed", "0.05", "--json")
    assert code == 1
    answer = json.loads(out)
    assert answer["status"] == "FREE"
    assert "'shoulder_lift_joint' needs" in answer["outside_limits"][0]
    assert "limit is 0.05 m/s" in answer["outside_limits"][1]
    assert [each["limit"] for each in answer["torques"]] == [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]


def test_torques_that_are_not_proven_to_be_within_their_limits_are_not_passed(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pp.motion.TorqueLimits, "excess", lambda *_: np.array([1.0 + 1e-4]))
    code, out, _ = run("ur5", "motion.json", "--torque", "--json")
    answer = json.loads(out)
    assert code == 1
    assert all(abs(peak["torque"]) < peak["limit"] for peak in answer["torques"])
    assert len(answer["outside_limits"]) == 1


@pytest.mark.parametrize(
    ("option", "value"), [("--payload", "-1"), ("--payload", "1 2"), ("--payload", "a"), ("--tool-speed", "0")]
)
def test_a_wrong_payload_or_speed_is_refused(run: Run, option: str, value: str) -> None:
    code, _, error = run("ur5", "motion.json", f"{option}={value}")
    assert code == 2
    assert error.startswith("pinproof: ")


@pytest.fixture
def script(run: Run, tmp_path: Path) -> Path:
    """A program of the motion, as ``pinproof export`` writes it."""
    code, out, err = run.func("export", "ur5", "motion.json", "--scene", "scene.yaml", "-o", "motion.script")
    assert code == 0, err
    assert "wrote motion.script" in out
    return tmp_path / "motion.script"


def test_an_exported_program_is_certified_from_its_text(run: Run, script: Path) -> None:
    code, out, _ = run("ur5", script.name, "--scene", "scene.yaml", "--json")
    found = json.loads(out)
    assert (code, found["status"], found["same_certificate"], found["moves"]) == (0, "FREE", True, 2)
    code, out, _ = run("ur5", script.name, "--scene", "moved.yaml", "--json")
    assert (code, json.loads(out)["same_certificate"]) == (0, False)


def test_a_program_edited_by_hand_is_refused_with_its_line(run: Run, script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    line = next(i for i, each in enumerate(text.splitlines(), 1) if "-1.470000" in each)
    script.write_text(text.replace("-1.470000", "-1.370000"), encoding="utf-8")
    code, _, err = run("ur5", script.name)
    assert code == 2
    assert f"line {line}" in err
    code, out, _ = run("ur5", script.name, "--allow-changes")
    assert (code, out.partition(":")[0]) == (0, "FREE")


def test_a_program_into_a_wall_is_not_written(run: Run, tmp_path: Path) -> None:
    code, out, _ = run.func("export", "ur5", "motion.json", "--scene", "wall.yaml", "-o", "into.src", "--ignore-record")
    assert (code, out.partition(":")[0]) == (1, "COLLIDING")
    assert not (tmp_path / "into.src").exists()
