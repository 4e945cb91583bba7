"""``pinproof certify``: proofs, audits, limits and programs, and motions judged with what the arm carries."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp

from .conftest import HOME, MOVED, Cli, save_motion, save_scene, text_of

ROD = "{name: rod, cylinder: {radius: 0.02, length: 0.2}, xyz: [0, 0, 0.1]}"
PICKS = f"""robot: ur5
tcp: tool0
margin: 0.001
tip: {{xyz: [0, 0, 0.2]}}
tool: [{ROD}]
picks: [{{name: one, xyz: [0.4, 0.1, 0.3], rpy: [pi, 0, 0]}}]
"""
UR5 = ("certify", "ur5", "motion.json")
FAR = ("--scene", "far.yaml")
PLAN = ("plan", "ur5", "--start", text_of(HOME), "--goal", text_of(MOVED))


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return pp.load_robot("ur5").arm()


@pytest.fixture
def run(run: Cli, arm: pp.Arm, tmp_path: Path) -> Cli:
    """A folder with a motion, scenes, and a tool; only the tool touches the plate at home."""
    save_motion(tmp_path / "motion.json")
    at = arm.forward_kinematics(HOME)
    across = arm.forward_kinematics((HOME + MOVED) / 2).translation
    save_scene(tmp_path / "plate.yaml", "plate", pp.Sphere(radius=0.01), at.translation + 0.15 * at.rotation[:, 2])
    save_scene(tmp_path / "far.yaml", "far", pp.Sphere(radius=0.1), (0, 0, 3))
    save_scene(tmp_path / "scene.yaml", "box", pp.Box(0.2, 0.2, 0.2), (0.9, 0.3, 0.4))
    save_scene(tmp_path / "moved.yaml", "box", pp.Box(0.2, 0.2, 0.2), (0.9, 0.3, 0.3))
    save_scene(tmp_path / "wall.yaml", "wall", pp.Box(0.02, 1.0, 1.0), across)
    (tmp_path / "picks.yaml").write_text(PICKS)
    (tmp_path / "rod.yaml").write_text(f"attached: [{ROD}]\n")
    (tmp_path / "thick.yaml").write_text(f"attached: [{ROD.replace('0.02', '0.03')}]\n")
    return run


# -- proofs and audits ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_proof_is_saved_and_verified_by_the_same_command(run: Cli) -> None:
    words = (*UR5, "--scene", "scene.yaml", "--margin", "0.002")
    out = run.prints(*words, "--obstacle-tolerance", "0.003", "--save-proof", "proof.json.gz")
    assert "obstacles may deviate by up to 3 mm" in out
    assert "wrote proof.json.gz" in out
    out = run.prints(*words, "--verify", "proof.json.gz")
    assert "compared with your files: the robot, the scene, the joint limits, the motion" in out
    assert "not checked: base_link and shoulder_link" in out
    answer = run.json("certify", "--verify", "proof.json.gz")
    assert (answer["ok"], answer["margin"], answer["obstacle_tolerance"]) == (True, 0.002, 0.003)
    assert answer["not_compared"] == ["the robot", "the scene", "the motion"]


@pytest.mark.slow
def test_a_proof_for_something_else_is_rejected(run: Cli) -> None:
    run.prints(*UR5, "--scene", "scene.yaml", "--save-proof", "proof.json")
    out = run.prints(*UR5, "--scene", "moved.yaml", "--verify", "proof.json", code=1)
    assert "REFUSED: bodies" in out
    assert "your box" in out
    proof = Path("proof.json")
    proof.write_text(proof.read_text().replace('"obstacle_tolerance":0.0', '"obstacle_tolerance":1.0'))
    assert "larger than 1 m" in run.prints("certify", "--verify", "proof.json", code=1)
    # The bare arm and the arm with a tool
    run.prints(*UR5, *FAR, "--save-proof", "bare.json")
    run.prints(*UR5, *FAR, "--verify", "bare.json")
    run.prints(*UR5, *FAR, "--attached", "rod.yaml", "--verify", "bare.json", code=1)
    run.prints(*UR5, *FAR, "--attached", "rod.yaml", "--save-proof", "held.json")
    run.prints(*UR5, *FAR, "--attached", "rod.yaml", "--verify", "held.json")
    run.prints(*UR5, *FAR, "--attached", "thick.yaml", "--verify", "held.json", code=1)


def test_neither_proof_nor_program_is_written_for_a_motion_in_contact(run: Cli) -> None:
    answer = run.json(*UR5, "--scene", "wall.yaml", code=1)
    assert answer["status"] == "COLLIDING"
    assert "wall" in answer["first_contact"]["bodies"]
    out = run.prints(*UR5, "--scene", "wall.yaml", "--save-proof", "proof.json", code=1)
    assert "proof.json is not written" in out
    export = ("export", "ur5", "motion.json", "--scene", "wall.yaml", "-o", "into.src", "--ignore-record")
    assert run.prints(*export, code=1).startswith("COLLIDING:")
    assert not list(Path().glob("proof.json")) + list(Path().glob("into.src"))


@pytest.mark.slow
def test_the_audit_states_its_samples_and_the_contact(run: Cli) -> None:
    out = run.prints(*UR5, "--scene", "scene.yaml", "--audit", "--audit-step", "0.01")
    assert "triangle meshes" in out
    assert "smallest distance is" in out
    audit = run.json(*UR5, "--scene", "wall.yaml", "--audit", "--audit-step", "0.01", code=1)["audit"]
    assert "touches wall" in audit["message"]
    assert audit["samples"] > 20


# -- limits -----------------------------------------------------------------------------------------------------------


def test_a_free_motion_beyond_the_limits_is_exit_code_1(run: Cli, arm: pp.Arm) -> None:
    fast = arm.home + np.array([0.5, 0, 0, 0, 0, 0])
    pp.Trajectory([0.0, 0.01], [arm.home, fast], np.zeros((2, 6)), arm.joint_names).save("motion.json")
    data = run.json(*UR5, code=1)
    violation = data["violation"]
    assert (data["status"], len(data["outside_limits"])) == ("VIOLATED", 1)
    assert (violation["joint"], violation["quantity"]) == ("shoulder_pan_joint", "velocity")
    assert (violation["value"], violation["limit"]) == pytest.approx((75.0, arm.limits.velocity[0]))
    assert (violation["time"], violation["q"][0]) == pytest.approx((0.005, arm.home[0] + 0.25))
    turned = arm.home + np.array([0, 0, np.pi, 0, 0, 0])
    pp.Trajectory([0.0, 9.0], [arm.home, turned], np.zeros((2, 6)), arm.joint_names).save("motion.json")
    assert "outside the limits: elbow_joint reaches a position of" in run.prints(*UR5, code=1)


def test_torque_and_tool_speed_are_checked_between_samples(run: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    out = run.prints(*UR5, "--payload", "2 0 0 0.1")
    assert re.search(r"largest torque: shoulder_lift_joint: \d+\.?\d* N m, \d+ % of its limit at", out)
    answer = run.json(*UR5, "--payload", "60", "--tool-speed", "0.05", code=1)
    assert answer["status"] == "FREE"
    assert "'shoulder_lift_joint' needs" in answer["outside_limits"][0]
    assert "limit is 0.05 m/s" in answer["outside_limits"][1]
    assert [each["limit"] for each in answer["torques"]] == [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]
    # Torques that are not proven to be within their limits are not passed
    monkeypatch.setattr(pp.motion.TorqueLimits, "excess", lambda *_: np.array([1.0 + 1e-4]))
    answer = run.json(*UR5, "--torque", code=1)
    assert all(abs(peak["torque"]) < peak["limit"] for peak in answer["torques"])
    assert len(answer["outside_limits"]) == 1


# -- programs ---------------------------------------------------------------------------------------------------------


def test_an_exported_program_is_certified_from_its_text_and_refused_if_edited(run: Cli) -> None:
    out = run.prints("export", "ur5", "motion.json", "--scene", "scene.yaml", "-o", "motion.script")
    assert "wrote motion.script" in out
    words, script = ("certify", "ur5", "motion.script"), Path("motion.script")
    found = run.json(*words, "--scene", "scene.yaml")
    assert (found["status"], found["same_certificate"], found["moves"]) == ("FREE", True, 2)
    assert run.json(*words, "--scene", "moved.yaml")["same_certificate"] is False
    text = script.read_text(encoding="utf-8")
    line = next(i for i, each in enumerate(text.splitlines(), 1) if "-1.470000" in each)
    script.write_text(text.replace("-1.470000", "-1.370000"), encoding="utf-8")
    run.refuses(*words, named=f"line {line}")
    assert run.prints(*words, "--allow-changes").startswith("FREE:")


# -- with what the arm carries ----------------------------------------------------------------------------------------

TOOLS = pytest.mark.parametrize("tool", [("--tool-of", "picks.yaml"), ("--attached", "rod.yaml")])


@pytest.mark.slow
@TOOLS
def test_every_command_judges_the_arm_with_its_tool(run: Cli, tool: tuple[str, str]) -> None:
    around = ("--scene", "plate.yaml")
    run.prints("check", "ur5", "--q", text_of(HOME), *around)
    out = run.prints("check", "ur5", "--q", text_of(HOME), *around, *tool, code=1)
    assert "plate" in out
    assert "rod" in out
    run.prints(*UR5, *around)
    answer = run.json(*UR5, *around, *tool, "--audit", code=1)
    assert answer["attached"] == ["rod"]
    assert set(answer["first_contact"]["bodies"]) == {"rod", "plate"}
    assert "rod" in answer["audit"]["message"]
    run.prints(*PLAN, *around)
    run.prints(*PLAN, *around, *tool, code=1)
    run.prints("view", "ur5", "--q", text_of(HOME), *around, *tool, "--html", "held.html")
    assert "rod" in Path("held.html").read_text()
    # The tool's tip is 0.2 m in front of the tcp
    xyz = "0.4 0.1 0.3" if tool[0] == "--attached" else "0.4 0.1 0.1"
    words = ("ik", "ur5", "--rpy", "pi 0 0", "--all")
    save_scene(Path("ball.yaml"), "ball", pp.Sphere(radius=0.01), (0.4, 0.1, 0.15))
    run.prints(*words, "--xyz", xyz, *tool)
    run.prints(*words, "--xyz", "0.4 0.1 0.3", "--scene", "ball.yaml")
    run.prints(*words, "--xyz", xyz, "--scene", "ball.yaml", *tool, code=1)


def test_ik_brings_the_tip_of_the_tool_to_the_pose(run: Cli, arm: pp.Arm) -> None:
    q = run.json("ik", "ur5", "--xyz", "0.4 0.1 0.1", "--rpy", "pi 0 0", "--tool-of", "picks.yaml")["q"]
    reached = arm.forward_kinematics(list(q.values())) * pp.pose((0, 0, 0.2))
    np.testing.assert_allclose(reached.translation, [0.4, 0.1, 0.1], atol=1e-5)


@pytest.mark.slow
@TOOLS
def test_a_motion_planned_with_a_tool_is_not_certified_without_it(run: Cli, tool: tuple[str, str]) -> None:
    run.prints(*PLAN, *FAR, *tool, "-o", "motion.json", "--html", "motion.html")
    assert "NOT VALIDATED" not in Path("motion.html").read_text()
    (record,) = pp.Trajectory.load("motion.json").certified
    assert (list(record.attached), record.obstacles, record.status) == (["rod"], ("far",), "FREE")
    for command in ((*UR5, *FAR), ("view", "ur5", "motion.json", *FAR, "--html", "again.html")):
        run.refuses(*command, named=("rod", "--tool-of", "--attached", "--ignore-record"))
    assert not Path("again.html").exists()
    answer = run.json(*UR5, *FAR, *tool)
    assert (answer["status"], answer["clearance_proven"]) == ("FREE", record.clearance)
    assert any("rod" in note for note in run.json(*UR5, *FAR, "--ignore-record")["notes"])
    # Neither with another tool nor without its scene
    run.refuses(*UR5, *FAR, "--attached", "thick.yaml", named="another shape or pose")
    run.refuses(*UR5, *tool, named="obstacles far")


def test_a_recorded_motion_as_a_table_is_refused_without_its_scene(run: Cli) -> None:
    run.prints(*PLAN, *FAR, "--attached", "rod.yaml", "-o", "motion.csv")
    words = ("certify", "ur5", "motion.csv", "--attached", "rod.yaml")
    run.refuses(*words, named="obstacles far")
    run.prints(*words, *FAR)


def test_a_recorded_motion_is_refused_with_fingers_held_elsewhere(run: Cli) -> None:
    arm = pp.load_robot("panda").arm(held={"panda_finger_joint1": 0.04})
    moved = arm.home + 0.1 * np.eye(arm.dof)[0]
    motion = pp.time_parametrise(pp.JointPath([arm.home, moved], arm.joint_names), arm.limits)
    motion.save("open.json", certificate=pp.certify(motion, pp.CollisionChecker(arm)))
    run.refuses("certify", "panda", "open.json", named="panda_finger_joint1 held at 0.04, now at 0")
    Path("open.yaml").write_text("attached: []\nheld: {panda_finger_joint1: 0.04}\n")
    run.prints("certify", "panda", "open.json", "--attached", "open.yaml")


def test_changes_that_weaken_nothing_are_noted(run: Cli) -> None:
    run.prints(*PLAN, *FAR, "--margin", "0.01", "-o", "motion.json")
    notes = run.json(*UR5, *FAR, "--margin", "0.01")["notes"]
    assert [note for note in notes if "certified" in note] == []
    assert "margin of 10 mm" in run.prints(*UR5, *FAR)
    edited = json.loads(Path("motion.json").read_text())
    edited["points"][1]["positions"][0] += 1e-6
    Path("motion.json").write_text(json.dumps(edited))
    assert "changed after it was certified" in run(*UR5, *FAR, "--margin", "0.01")[1]


@pytest.mark.slow
def test_motions_of_picks_record_their_tool_and_what_they_carry(run: Cli) -> None:
    carried = "object: {name: cube, box: [0.02, 0.02, 0.02], xyz: [0, 0, 0.01]}, rpy:"
    Path("carry.yaml").write_text(PICKS.replace("rpy:", carried))
    run.prints("pick", "picks.yaml", "-o", ".")
    run.refuses("certify", "ur5", "one.json", named="rod")
    answer = run.json("certify", "ur5", "one.json", "--tool-of", "picks.yaml")
    (record,) = pp.Trajectory.load("one.json").certified
    assert (answer["status"], answer["clearance_proven"]) == ("FREE", record.clearance)
    run.prints("pick", "carry.yaml", "-o", ".")
    parts = pp.Trajectory.load("one.json").certified
    assert [part.name for part in parts] == ["transit", "approach", "retreat"]
    assert [list(part.attached) for part in parts] == [["rod"], ["rod"], ["rod", "cube"]]
    assert parts[-1].end == pytest.approx(pp.Trajectory.load("one.json").duration)
    run.refuses("certify", "ur5", "one.json", "--tool-of", "carry.yaml", named="transit, approach, retreat")


def test_two_files_add_up_and_contradictions_are_refused(run: Cli) -> None:
    Path("part.yaml").write_text("attached: [{name: part, box: [0.02, 0.02, 0.02], xyz: [0, 0, 0.22]}]\n")
    tools = ("--tool-of", "picks.yaml", "--attached")
    assert run.json(*UR5, *tools, "part.yaml")["attached"] == ["rod", "part"]
    for content, named in {
        "attached: []\ntip: {xyz: [0, 0, 1]}\n": "tip",
        f"attached: [{ROD}]\n": "'rod'",
        "attached: []\nheld: {nowhere: 1}\n": "nowhere",
        "attached: []\nallowed_contacts: [[rod, nothing]]\n": "nothing",
    }.items():
        Path("wrong.yaml").write_text(content)
        run.refuses("check", "ur5", *tools, "wrong.yaml", named=named)
    run.refuses("check", "ur5", "--tcp", "wrist_3_link", "--tool-of", "picks.yaml", named="tool0")
    # Allowed contacts of an attached body are listed as not checked
    Path("meant.yaml").write_text(f"attached: [{ROD}]\nallowed_contacts: [[rod, plate]]\n")
    answer = run.json(*UR5, "--scene", "plate.yaml", "--attached", "meant.yaml")
    assert any(set(pair[:2]) == {"rod", "plate"} for pair in answer["excluded"])
