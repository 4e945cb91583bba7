"""Results of the commands: correct figures, and exit codes that distinguish negative results from errors."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.common.files import file_stems
from pinproof.description import catalogue_names
from pinproof.ik.methods import IK_METHODS, bench

from .conftest import Cli, save_scene

Q = (0.3, -1.2, 1.4, -0.5, 0.7, 0.2)
DOWN = ("--xyz", "0.4 0.1 0.3", "--rpy", "pi 0 0")


@pytest.fixture(scope="module")
def ur5() -> pp.Arm:
    return pp.load_robot("ur5").arm()


def test_fk_prints_the_pose_of_the_arm_and_notes_joints_outside_their_limits(run: Cli, ur5: pp.Arm) -> None:
    matrix = run.json("fk", "ur5", "--q", " ".join(map(str, Q)))["matrix"]
    np.testing.assert_allclose(matrix, ur5.forward_kinematics(Q).homogeneous, atol=1e-15)
    code, out, err = run("fk", "ur5", "--q", "0 0 0 0 0 6.4", "--json")
    assert (code, "wrist_3_joint = 6.4 is outside" in err, "wrist_3_joint = 6.4" in out) == (0, True, False)


@pytest.mark.parametrize("method", IK_METHODS)
def test_every_ik_method_agrees_with_fk(run: Cli, ur5: pp.Arm, method: str) -> None:
    q = list(run.json("ik", "ur5", *DOWN, "--method", method)["q"].values())
    atol = 1e-6 if method == "clik" else 1.1e-4
    np.testing.assert_allclose(ur5.forward_kinematics(q).translation, [0.4, 0.1, 0.3], atol=atol)


def test_ik_lists_every_branch(run: Cli) -> None:
    answer = run.json("ik", "puma560", *DOWN, "--all")
    assert 1 <= len(answer["branches"]) <= 8
    assert answer["with_full_rotations"] >= len(answer["branches"])
    assert "out of reach" in run.prints("ik", "puma560", "--xyz", "0.4 0.1 3", "--all", code=1)


@pytest.mark.parametrize("robot", ["ur5", "generic_6dof"])
def test_the_table_of_ik_solutions_fits_into_80_columns(run: Cli, robot: str) -> None:
    names, header, *rows = run.prints("ik", robot, *DOWN, "--all").splitlines()
    arm = pp.load_robot(robot).arm()
    assert names == ", ".join(f"q{k} = {name}" for k, name in enumerate(arm.joint_names, start=1))
    assert header.split() == [f"q{k}" for k in range(1, 7)]
    assert len(rows) > 1
    assert max(map(len, [header, *rows[:-1]])) <= 80
    target = pp.pose((0.4, 0.1, 0.3), (math.pi, 0, 0))
    for row in rows[:-1]:
        assert arm.forward_kinematics([float(value) for value in row.split()]).isApprox(target, 1e-4)


def test_ik_out_of_reach_or_within_the_margin_is_exit_code_1(run: Cli) -> None:
    assert run.json("ik", "ur5", "--xyz", "2 0 0", code=1)["ok"] is False
    assert run.json("ik", "ur5", "--xyz", "0.4 0.1 0.3", "--margin", "5", code=1)["ok"] is False  # without a scene too
    found = run.json("ik", "panda", "--xyz", "0.9 0 0.4", code=1)  # proven for a redundant arm
    assert (found["ok"], found["status"]) == (False, "IMPOSSIBLE")
    assert 0.01 < found["position_error"] < 0.3


def test_check_names_the_bodies_in_contact_and_joints_beyond_their_limits(run: Cli) -> None:
    save_scene(Path("scene.yaml"), "post", pp.Box(0.1, 0.1, 1.0), (0.49, 0.11, 0.5))
    contacts = run.json("check", "ur5", "--scene", "scene.yaml", code=1)["contacts"]
    assert any("post" in contact["bodies"] for contact in contacts)
    assert "elbow_joint = 3.3 is outside" in run.prints("check", "ur5", "--q", "0 -1.5 3.3 0 0 0", code=1)


def test_check_within_rounding_of_a_limit_is_inside(run: Cli) -> None:
    _, out, _ = run("check", "ur5", "--q", f"0 -1.5 {np.pi + 5e-10!r} 0 0 0", "--json")
    assert '"outside_limits": []' in out
    out = run.prints("check", "ur5", "--q", f"0 -1.5 {np.pi + 2e-8!r} 0 0 0", code=1)
    text = next(line for line in out.splitlines() if "elbow_joint" in line and "is outside" in line)
    assert float(text.split()[2]) > float(text.split()[-1].rstrip("]"))


def test_plan_into_an_obstacle_names_it(run: Cli) -> None:
    save_scene(Path("scene.yaml"), "floor", pp.Box(3, 3, 0.1), (0, 0, -0.06), allowed=[("base_link", "floor")])
    assert "floor" in run.prints("plan", "ur5", "--goal", "0 0.5 0 0 0 0", "--scene", "scene.yaml", code=1)


def test_plan_writes_the_proof_beside_its_motion(run: Cli) -> None:
    out = run.prints("plan", "ur5", "--goal", "0 -1.2 1 0 0 0", "-o", "motion.json")
    assert "wrote motion.json and motion.proof.json" in out
    out = run.prints("certify", "ur5", "motion.json", "--verify", "motion.proof.json")
    assert "compared with your files: the robot, the scene (without obstacles), the joint limits, the motion" in out


@pytest.mark.slow
def test_plan_and_certify_keep_the_tool_upright(run: Cli) -> None:
    goal, start = "1 -1.2 1.6 -1.97 -1.57 0.5", "-1 -1.2 1.6 -1.97 -1.57 0"
    made = run.json("plan", "ur5", "--start", start, "--goal", goal, "--upright", "5 deg", "-o", "motion.json")
    (kept,) = made["certificate"]["constraints"]
    assert kept["tolerance"] == pytest.approx(np.radians(5))
    assert kept["largest_observed"] <= kept["largest_proven"] <= kept["tolerance"]
    certify = ("certify", "ur5", "motion.json", "--upright")
    answer = run.json(*certify, "1 deg", "--upright-axis", "1 0 0", code=1)
    assert (answer["status"], answer["violation"]["time"]) == ("VIOLATED", 0.0)
    run.prints(*certify, "5deg", "--save-proof", "proof.json")
    run.prints(*certify, "5 deg", "--verify", "proof.json")
    run.prints(*certify, "1 deg", "--verify", "proof.json", code=1)


def test_plan_keeps_limits_of_a_file_and_of_jerk(run: Cli, ur5: pp.Arm) -> None:
    limits = "joint_limits:\n  shoulder_pan_joint: {has_velocity_limits: true, max_velocity: 0.25}\n"
    Path("joint_limits.yaml").write_text(limits)
    goal = " ".join(str(value) for value in ur5.home + np.array([0.5, 0, 0, 0, 0, 0]))
    run.prints("plan", "ur5", "--goal", goal, "--limits", "joint_limits.yaml", "-o", "motion.json", "--jerk", "30")
    written = pp.Trajectory.load("motion.json")
    assert written.interpolant == "quintic"
    assert written.max_velocity().max() <= 0.25 * (1 + 1e-9)
    assert written.max_jerk().max() <= 30 * (1 + 1e-9)


def test_a_recovered_table_becomes_the_same_arm(run: Cli, ur5: pp.Arm) -> None:
    run.prints("urdf2dh", "ur5", "-o", "ur5.yaml")
    run.prints("dh2urdf", "ur5.yaml", "-o", "ur5.urdf")
    ours, theirs = (arm.forward_kinematics(Q) for arm in (pp.load_robot("ur5.urdf").arm("tool0"), ur5))
    np.testing.assert_allclose(ours.homogeneous, theirs.homogeneous, atol=1e-9)


def test_info_lists_the_catalogue_and_the_missing_data_of_a_robot(run: Cli) -> None:
    listed = tuple(run.prints("info").replace("\n", " ").strip().split(", "))
    assert listed == catalogue_names()
    assert run.json("info") == {"robots": list(listed)}
    data = run.json("info", "ur5")
    assert data["dof"] == 6
    assert data["pairs"]["checked"] > 0
    assert any("acceleration" in sentence for sentence in data["missing"])


def test_a_missing_mesh_is_not_taken_for_a_file_in_a_folder(run: Cli) -> None:
    geometry = '<collision><geometry><mesh filename="package://parts/a.stl"/></geometry></collision>'
    Path("m.urdf").write_text(
        f'<robot name="m"><link name="a">{geometry}</link><link name="b"/><joint name="j" type="revolute">'
        '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
        "</joint></robot>"
    )
    code, _, err = run("check", "m.urdf", "--tcp", "b", "--q", "home")
    assert code == 2
    assert "package://parts/a.stl: the mesh of link 'a' was not found" in err
    assert "does not exist" not in err


def test_file_names_differ_and_stay_in_their_folder() -> None:
    names = ["a", "A", "a/b", "a b", "..", "", "report", "Schraube_ö", "a_2", "a.program"]
    stems = ["a", "A_2", "a_b", "a_b_2", "pick", "pick_2", "report_2", "Schraube_ö", "a_2_2", "a_program"]
    assert file_stems(names) == stems


# -- bench: the textbook's table for any arm --------------------------------------------------------------------------


def test_the_table_of_methods_is_markdown_or_json(run: Cli) -> None:
    out = run.prints("bench", "ur5", "--points", "3", "--methods", "clik, fabrik")
    assert [line.split("|")[1].strip() for line in out.splitlines()[2:]] == ["clik"] * 4 + ["fabrik"] * 4
    assert "0.4 ms, 98 %" in out
    table = run.json("bench", "ur5", "--points", "3", "--seed", "4")
    assert (table["seed"], table["left_out"]) == (4, {})
    assert [row["method"] for row in table["rows"]].count("clik") == 4
    assert [(row["task"], row["success"]) for row in table["rows"] if row["method"] == "analytic"] == [("pose", 1.0)]
    out = run.prints("bench", "talos_left", "--base", "base_link", "--points", "1", "--methods", "analytic")
    assert "not applicable: analytic: " in out


@pytest.mark.parametrize("change", [1e-4, 4 * np.pi], ids=["wrong pose", "outside the limits"])
def test_answers_are_checked_by_forward_kinematics_and_the_limits(
    ur5: pp.Arm, monkeypatch: pytest.MonkeyPatch, change: float
) -> None:
    """Not by the status that a method reports: these are false positives."""
    solve = pp.Clik.solve

    def changed(self, *args, **settings):
        result = solve(self, *args, **settings)
        return type(result)(**{**vars(result), "q": result.q + change * np.eye(6)[0]})

    monkeypatch.setattr(pp.Clik, "solve", changed)
    rows = bench(ur5, points=4, methods=["clik"])[0]
    assert [(row.success, row.false_positives) for row in rows if row.restarts] == [(0.0, 4)] * 2
