"""Commands judge the arm with what it carries, and refuse a recorded motion without it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp

from ..pages import Run

HOME = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])
MOVED = HOME + np.array([0.3, 0.1, 0.0, 0.0, 0.0, 0.2])
ROD = "{name: rod, cylinder: {radius: 0.02, length: 0.2}, xyz: [0, 0, 0.1]}"
PICKS = f"""robot: ur5
tcp: tool0
margin: 0.001
tip: {{xyz: [0, 0, 0.2]}}
tool: [{ROD}]
picks: [{{name: one, xyz: [0.4, 0.1, 0.3], rpy: [pi, 0, 0]}}]
"""


@pytest.fixture
def run(run: Run, tmp_path: Path) -> Run:
    """Run a command in a folder with a tool, and a plate that only the tool touches at home: exit code and texts."""
    arm = pp.load_robot("ur5").arm()
    at = arm.forward_kinematics(HOME)
    plate = at.translation + 0.15 * at.rotation[:, 2]
    pp.Scene([pp.Obstacle("plate", pp.Sphere(radius=0.01), pp.pose(plate))]).save(tmp_path / "plate.yaml")
    pp.Scene([pp.Obstacle("far", pp.Sphere(radius=0.1), pp.pose((0, 0, 3)))]).save(tmp_path / "far.yaml")
    (tmp_path / "picks.yaml").write_text(PICKS)
    (tmp_path / "rod.yaml").write_text(f"attached: [{ROD}]\n")
    (tmp_path / "thick.yaml").write_text(f"attached: [{ROD.replace('0.02', '0.03')}]\n")
    pp.time_parametrise(pp.JointPath([HOME, MOVED], arm.joint_names), arm.limits).save(tmp_path / "bare.json")
    return run


def text(q: np.ndarray) -> str:
    return " ".join(map(repr, q.tolist()))


TOOLS = pytest.mark.parametrize("tool", [("--tool-of", "picks.yaml"), ("--attached", "rod.yaml")])


@pytest.mark.slow
@TOOLS
def test_every_command_judges_the_arm_with_its_tool(run: Run, tool: tuple[str, str]) -> None:
    around = ("--scene", "plate.yaml")
    assert run("check", "ur5", "--q", text(HOME), *around)[0] == 0
    code, out, _ = run("check", "ur5", "--q", text(HOME), *around, *tool)
    assert (code, "plate" in out, "rod" in out) == (1, True, True)
    assert run("certify", "ur5", "bare.json", *around)[0] == 0
    code, out, _ = run("certify", "ur5", "bare.json", *around, *tool, "--audit", "--json")
    answer = json.loads(out)
    assert code == 1
    assert answer["attached"] == ["rod"]
    assert set(answer["first_contact"]["bodies"]) == {"rod", "plate"}
    assert "rod" in answer["audit"]["message"]
    assert run("plan", "ur5", "--start", text(HOME), "--goal", text(MOVED), *around)[0] == 0
    assert run("plan", "ur5", "--start", text(HOME), "--goal", text(MOVED), *around, *tool)[0] == 1
    assert run("view", "ur5", "--q", text(HOME), *around, *tool, "--html", "held.html")[0] == 0
    assert "rod" in Path("held.html").read_text()


@TOOLS
def test_ik_refuses_configurations_in_which_the_tool_touches(run: Run, tool: tuple[str, str]) -> None:
    xyz = "0.4 0.1 0.3" if tool[0] == "--attached" else "0.4 0.1 0.1"  # the tool's tip is 0.2 m in front of the tcp
    words = ("ik", "ur5", "--rpy", "pi 0 0", "--all", "--json")
    pp.Scene([pp.Obstacle("ball", pp.Sphere(radius=0.01), pp.pose((0.4, 0.1, 0.15)))]).save("ball.yaml")
    assert run(*words, "--xyz", xyz, *tool)[0] == 0
    assert run(*words, "--xyz", "0.4 0.1 0.3", "--scene", "ball.yaml")[0] == 0
    assert run(*words, "--xyz", xyz, "--scene", "ball.yaml", *tool)[0] == 1


def test_ik_brings_the_tip_of_the_tool_to_the_pose(run: Run) -> None:
    code, out, _ = run("ik", "ur5", "--xyz", "0.4 0.1 0.1", "--rpy", "pi 0 0", "--tool-of", "picks.yaml", "--json")
    assert code == 0
    reached = pp.load_robot("ur5").arm().forward_kinematics(list(json.loads(out)["q"].values()))
    np.testing.assert_allclose((reached * pp.pose((0, 0, 0.2))).translation, [0.4, 0.1, 0.1], atol=1e-5)
    code, _, err = run("ik", "ur5", "--xyz", "0.4 0.1 0.1", "--task", "position", "--tool-of", "picks.yaml")
    assert (code, "--task" in err) == (2, True)


@pytest.mark.slow
@TOOLS
def test_a_motion_planned_with_a_tool_is_not_certified_without_it(run: Run, tool: tuple[str, str]) -> None:
    ends = ("--start", text(HOME), "--goal", text(MOVED), "--scene", "far.yaml")
    assert run("plan", "ur5", *ends, *tool, "-o", "motion.json", "--html", "motion.html")[0] == 0
    assert "NOT VALIDATED" not in Path("motion.html").read_text()
    (record,) = pp.Trajectory.load("motion.json").certified
    assert (list(record.attached), record.obstacles, record.status) == (["rod"], ("far",), "FREE")
    motion = ("ur5", "motion.json", "--scene", "far.yaml")
    for command in (("certify", *motion), ("view", "ur5", *motion[1:], "--html", "again.html")):
        code, out, err = run(*command)
        assert (code, out) == (2, "")
        assert all(word in err for word in ("rod", "--tool-of", "--attached", "--ignore-record"))
    assert not Path("again.html").exists()
    code, out, _ = run("certify", *motion, *tool, "--json")
    answer = json.loads(out)
    assert (code, answer["status"], answer["clearance_proven"]) == (0, "FREE", record.clearance)
    code, out, _ = run("certify", *motion, "--ignore-record", "--json")
    answer = json.loads(out)
    assert code == 0
    assert any("rod" in note for note in answer["notes"])


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--scene", "far.yaml", "--attached", "thick.yaml"), "another shape or pose"),
        (("--attached", "rod.yaml"), "obstacles far"),
    ],
)
def test_a_recorded_motion_is_refused_with_another_tool_or_without_its_scene(
    run: Run, words: tuple[str, ...], named: str
) -> None:
    ends = ("--start", text(HOME), "--goal", text(MOVED), "--scene", "far.yaml")
    assert run("plan", "ur5", *ends, "--attached", "rod.yaml", "-o", "motion.csv")[0] == 0
    code, out, err = run("certify", "ur5", "motion.csv", *words)
    assert (code, out) == (2, "")
    assert named in err
    assert run("certify", "ur5", "motion.csv", "--scene", "far.yaml", "--attached", "rod.yaml")[0] == 0


def test_a_recorded_motion_is_refused_with_fingers_held_elsewhere(run: Run) -> None:
    arm = pp.load_robot("panda").arm(held={"panda_finger_joint1": 0.04})
    moved = arm.home + 0.1 * np.eye(arm.dof)[0]
    motion = pp.time_parametrise(pp.JointPath([arm.home, moved], arm.joint_names), arm.limits)
    motion.save("open.json", certificate=pp.certify(motion, pp.CollisionChecker(arm)))
    code, _, err = run("certify", "panda", "open.json")
    assert code == 2
    assert "panda_finger_joint1 held at 0.04, now at 0" in err
    Path("open.yaml").write_text("attached: []\nheld: {panda_finger_joint1: 0.04}\n")
    assert run("certify", "panda", "open.json", "--attached", "open.yaml")[0] == 0


def test_changes_that_weaken_nothing_are_noted(run: Run) -> None:
    ends = ("--start", text(HOME), "--goal", text(MOVED), "--scene", "far.yaml")
    assert run("plan", "ur5", *ends, "--margin", "0.01", "-o", "motion.json")[0] == 0
    code, out, _ = run("certify", "ur5", "motion.json", "--scene", "far.yaml", "--margin", "0.01", "--json")
    assert (code, [note for note in json.loads(out)["notes"] if "certified" in note]) == (0, [])
    code, out, _ = run("certify", "ur5", "motion.json", "--scene", "far.yaml")
    assert (code, "margin of 10 mm" in out) == (0, True)
    edited = json.loads(Path("motion.json").read_text())
    edited["points"][1]["positions"][0] += 1e-6
    Path("motion.json").write_text(json.dumps(edited))
    code, out, _ = run("certify", "ur5", "motion.json", "--scene", "far.yaml", "--margin", "0.01")
    assert "changed after it was certified" in out


@pytest.mark.slow
def test_a_proof_of_the_bare_arm_is_refused_for_the_arm_with_a_tool(run: Run) -> None:
    words = ("certify", "ur5", "bare.json", "--scene", "far.yaml")
    assert run(*words, "--save-proof", "bare_proof.json")[0] == 0
    assert run(*words, "--verify", "bare_proof.json")[0] == 0
    assert run(*words, "--attached", "rod.yaml", "--verify", "bare_proof.json")[0] == 1
    assert run(*words, "--attached", "rod.yaml", "--save-proof", "proof.json")[0] == 0
    assert run(*words, "--attached", "rod.yaml", "--verify", "proof.json")[0] == 0
    assert run(*words, "--attached", "thick.yaml", "--verify", "proof.json")[0] == 1
    code, _, err = run("certify", "--verify", "proof.json", "--attached", "rod.yaml")
    assert (code, "ROBOT" in err) == (2, True)


@pytest.mark.slow
def test_motions_of_picks_record_their_tool_and_what_they_carry(run: Run, tmp_path: Path) -> None:
    Path("carry.yaml").write_text(
        PICKS.replace("rpy:", "object: {name: cube, box: [0.02, 0.02, 0.02], xyz: [0, 0, 0.01]}, rpy:")
    )
    assert run("pick", "picks.yaml", "-o", str(tmp_path))[0] == 0
    code, out, err = run("certify", "ur5", "one.json")
    assert (code, out, "rod" in err) == (2, "", True)
    code, out, _ = run("certify", "ur5", "one.json", "--tool-of", "picks.yaml", "--json")
    (record,) = pp.Trajectory.load("one.json").certified
    answer = json.loads(out)
    assert (code, answer["status"], answer["clearance_proven"]) == (0, "FREE", record.clearance)
    assert run("pick", "carry.yaml", "-o", str(tmp_path))[0] == 0
    parts = pp.Trajectory.load("one.json").certified
    assert [part.name for part in parts] == ["transit", "approach", "retreat"]
    assert [list(part.attached) for part in parts] == [["rod"], ["rod"], ["rod", "cube"]]
    assert parts[-1].end == pytest.approx(pp.Trajectory.load("one.json").duration)
    code, out, err = run("certify", "ur5", "one.json", "--tool-of", "carry.yaml")
    assert (code, out) == (2, "")
    assert "transit, approach, retreat" in err


def test_two_files_add_up_and_contradictions_are_refused(run: Run) -> None:
    Path("part.yaml").write_text("attached: [{name: part, box: [0.02, 0.02, 0.02], xyz: [0, 0, 0.22]}]\n")
    code, out, _ = run("certify", "ur5", "bare.json", "--tool-of", "picks.yaml", "--attached", "part.yaml", "--json")
    assert (code, json.loads(out)["attached"]) == (0, ["rod", "part"])
    for content, named in {
        "attached: []\ntip: {xyz: [0, 0, 1]}\n": "tip",
        f"attached: [{ROD}]\n": "'rod'",
        "attached: []\nheld: {nowhere: 1}\n": "nowhere",
        "attached: []\nallowed_contacts: [[rod, nothing]]\n": "nothing",
    }.items():
        Path("wrong.yaml").write_text(content)
        code, _, err = run("check", "ur5", "--tool-of", "picks.yaml", "--attached", "wrong.yaml")
        assert (code, named in err) == (2, True), err
    code, _, err = run("check", "ur5", "--tcp", "wrist_3_link", "--tool-of", "picks.yaml")
    assert (code, "tool0" in err) == (2, True)


def test_allowed_contacts_of_an_attached_body_are_listed_as_not_checked(run: Run) -> None:
    Path("meant.yaml").write_text(f"attached: [{ROD}]\nallowed_contacts: [[rod, plate]]\n")
    code, out, _ = run("certify", "ur5", "bare.json", "--scene", "plate.yaml", "--attached", "meant.yaml", "--json")
    assert code == 0
    assert any(set(pair[:2]) == {"rod", "plate"} for pair in json.loads(out)["excluded"])
