"""Results of the commands: correct figures, and exit codes that distinguish negative results from errors."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import catalogue_names, robots_folder
from pinproof.ik.methods import IK_METHODS

from ..pages import Run

Q = (0.3, -1.2, 1.4, -0.5, 0.7, 0.2)
TEXT = " ".join(map(str, Q))


def test_fk_prints_the_pose_of_the_arm(run: Run) -> None:
    code, out, _ = run("fk", "ur5", "--q", TEXT, "--json")
    assert code == 0
    expected = pp.load_robot("ur5").arm().forward_kinematics(Q)
    np.testing.assert_allclose(json.loads(out)["matrix"], expected.homogeneous, atol=1e-15)


def test_fk_notes_joints_outside_their_limits(run: Run) -> None:
    code, out, err = run("fk", "ur5", "--q", "0 0 0 0 0 6.4", "--json")
    assert code == 0
    assert "wrist_3_joint = 6.4 is outside" in err
    assert "wrist_3_joint = 6.4" not in out


def test_ik_finds_a_configuration_that_fk_confirms(run: Run) -> None:
    code, out, _ = run("ik", "ur5", "--xyz", "0.4 0.1 0.3", "--rpy", "pi 0 0", "--json")
    assert code == 0
    q = list(json.loads(out)["q"].values())
    reached = pp.load_robot("ur5").arm().forward_kinematics(q)
    np.testing.assert_allclose(reached.translation, [0.4, 0.1, 0.3], atol=1e-6)


def test_ik_keeps_a_margin_without_a_scene_too(run: Run) -> None:
    code, out, _ = run("ik", "ur5", "--xyz", "0.4 0.1 0.3", "--margin", "5", "--json")
    assert code == 1
    assert json.loads(out)["ok"] is False


@pytest.mark.parametrize("method", IK_METHODS)
def test_every_ik_method_agrees_with_fk(run: Run, method: str) -> None:
    code, out, _ = run("ik", "ur5", "--xyz", "0.4 0.1 0.3", "--rpy", "pi 0 0", "--method", method, "--json")
    q = " ".join(str(value) for value in json.loads(out)["q"].values())
    assert code == 0
    _, place, _ = run("fk", "ur5", "--q", q, "--json")
    assert json.loads(place)["xyz"] == pytest.approx([0.4, 0.1, 0.3], abs=1.1e-4)


def test_ik_lists_every_branch(run: Run) -> None:
    code, out, _ = run("ik", "puma560", "--xyz", "0.4 0.1 0.3", "--rpy", "pi 0 0", "--all", "--json")
    answer = json.loads(out)
    assert code == 0
    assert 1 <= len(answer["branches"]) <= 8
    assert answer["with_full_rotations"] >= len(answer["branches"])
    code, out, _ = run("ik", "puma560", "--xyz", "0.4 0.1 3", "--all")
    assert code == 1
    assert "out of reach" in out


def test_ik_proves_that_a_redundant_arm_cannot_reach_a_target(run: Run) -> None:
    code, out, _ = run("ik", "panda", "--xyz", "0.9 0 0.4", "--json")
    found = json.loads(out)
    assert (code, found["ok"], found["status"]) == (1, False, "IMPOSSIBLE")
    assert 0.01 < found["position_error"] < 0.3


def test_ik_out_of_reach_is_exit_code_1(run: Run) -> None:
    code, out, _ = run("ik", "ur5", "--xyz", "2 0 0", "--json")
    assert code == 1
    assert json.loads(out)["ok"] is False


def test_check_names_the_bodies_in_contact(run: Run, tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    pp.Scene([pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose((0.49, 0.11, 0.5)))]).save(scene)
    code, out, _ = run("check", "ur5", "--scene", str(scene), "--json")
    assert code == 1
    assert any("post" in contact["bodies"] for contact in json.loads(out)["contacts"])


def test_check_outside_the_limits_is_exit_code_1(run: Run) -> None:
    code, out, _ = run("check", "ur5", "--q", "0 -1.5 3.3 0 0 0")
    assert code == 1
    assert "elbow_joint = 3.3 is outside" in out


def test_check_within_rounding_of_a_limit_is_inside(run: Run) -> None:
    code, out, _ = run("check", "ur5", "--q", f"0 -1.5 {np.pi + 5e-10!r} 0 0 0", "--json")
    assert json.loads(out)["outside_limits"] == []
    code, out, _ = run("check", "ur5", "--q", f"0 -1.5 {np.pi + 2e-8!r} 0 0 0")
    assert code == 1
    text = next(line for line in out.splitlines() if "elbow_joint" in line and "is outside" in line)
    assert float(text.split()[2]) > float(text.split()[-1].rstrip("]"))


def test_plan_into_an_obstacle_names_it(run: Run, tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    pp.Scene([pp.Obstacle("floor", pp.Box(3, 3, 0.1), pp.pose((0, 0, -0.06)))], allowed=[("base_link", "floor")]).save(
        scene
    )
    code, out, _ = run("plan", "ur5", "--goal", "0 0.5 0 0 0 0", "--scene", str(scene))
    assert code == 1
    assert "floor" in out


@pytest.mark.slow
def test_plan_and_certify_keep_the_tool_upright(run: Run) -> None:
    goal, start = "1 -1.2 1.6 -1.97 -1.57 0.5", "-1 -1.2 1.6 -1.97 -1.57 0"
    request = ("plan", "ur5", "--start", start, "--goal", goal, "--upright", "5 deg", "-o", "motion.json", "--json")
    code, out, _ = run(*request)
    (kept,) = json.loads(out)["constraints"]
    assert (code, kept["tolerance"]) == (0, pytest.approx(np.radians(5)))
    assert kept["largest_observed"] <= kept["largest_proven"] <= kept["tolerance"]
    code, out, _ = run("certify", "ur5", "motion.json", "--upright", "1 deg", "--upright-axis", "1 0 0", "--json")
    answer = json.loads(out)
    assert (code, answer["status"]) == (1, "VIOLATED")
    assert answer["violation"]["time"] == 0.0
    code, out, _ = run("certify", "ur5", "motion.json", "--upright", "5deg", "--save-proof", "proof.json")
    assert code == 0
    assert run("certify", "ur5", "motion.json", "--upright", "5 deg", "--verify", "proof.json")[0] == 0
    assert run("certify", "ur5", "motion.json", "--upright", "1 deg", "--verify", "proof.json")[0] == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--upright", "5 grad"), "5 grad"),
        (("--upright", "5"), "286"),
        (("--upright-axis", "0 0 1"), "--upright"),
        (("--upright", "5 deg", "--upright-axis", "0 1"), 'must be "x y z"'),
        (("--upright", "5 deg", "--upright-axis", "0 0 0"), "zero"),
    ],
)
def test_a_wrong_constraint_is_a_wrong_use(run: Run, options: tuple[str, ...], words: str) -> None:
    code, _, err = run("plan", "ur5", "--goal", "1 -1.2 1.6 -1.97 -1.57 0.5", *options)
    assert code == 2
    assert words in err


def test_plan_keeps_limits_of_a_file_and_of_jerk(run: Run, tmp_path: Path) -> None:
    limits, motion = tmp_path / "joint_limits.yaml", tmp_path / "motion.json"
    limits.write_text("joint_limits:\n  shoulder_pan_joint: {has_velocity_limits: true, max_velocity: 0.25}\n")
    goal = " ".join(str(value) for value in pp.load_robot("ur5").arm().home + np.array([0.5, 0, 0, 0, 0, 0]))
    request = ("plan", "ur5", "--goal", goal, "--limits", str(limits), "-o", str(motion))
    code, _, _ = run(*request, "--jerk", "30")
    assert code == 0
    written = pp.Trajectory.load(motion)
    assert written.interpolant == "quintic"
    assert written.max_velocity().max() <= 0.25 * (1 + 1e-9)
    assert written.max_jerk().max() <= 30 * (1 + 1e-9)
    code, _, expected = run(*request, "--jerk", "gentle")
    assert code == 2
    assert "--jerk" in expected


def test_certify_reports_the_first_contact_of_a_motion(run: Run, tmp_path: Path) -> None:
    arm = pp.load_robot("ur5").arm()
    motion, scene = tmp_path / "motion.csv", tmp_path / "scene.yaml"
    turned = arm.home + np.array([np.pi / 2, 0, 0, 0, 0, 0])
    pp.time_parametrise(pp.JointPath([arm.home, turned], arm.joint_names), arm.limits).save(motion)
    pp.Scene([pp.Obstacle("thin", pp.Box(0.5, 0.001, 0.5), pp.pose((0.6, 0.3, 0.4)))]).save(scene)
    code, out, _ = run("certify", "ur5", str(motion), "--scene", str(scene), "--json")
    verdict = json.loads(out)
    assert code == 1
    assert verdict["status"] == "COLLIDING"
    assert "thin" in verdict["first_contact"]["bodies"]


def test_a_free_motion_beyond_the_limits_is_exit_code_1(run: Run, tmp_path: Path) -> None:
    arm, motion = pp.load_robot("ur5").arm(), tmp_path / "motion.json"
    fast = arm.home + np.array([0.5, 0, 0, 0, 0, 0])
    pp.Trajectory([0.0, 0.01], [arm.home, fast], np.zeros((2, 6)), arm.joint_names).save(motion)
    code, out, _ = run("certify", "ur5", str(motion), "--json")
    data = json.loads(out)
    assert code == 1
    assert data["status"] == "VIOLATED"
    violation = data["violation"]
    assert (violation["joint"], violation["quantity"]) == ("shoulder_pan_joint", "velocity")
    assert (violation["value"], violation["limit"]) == pytest.approx((75.0, arm.limits.velocity[0]))
    assert (violation["time"], violation["q"][0]) == pytest.approx((0.005, arm.home[0] + 0.25))
    assert len(data["outside_limits"]) == 1
    turned = arm.home + np.array([0, 0, np.pi, 0, 0, 0])
    pp.Trajectory([0.0, 9.0], [arm.home, turned], np.zeros((2, 6)), arm.joint_names).save(motion)
    code, out, _ = run("certify", "ur5", str(motion))
    assert code == 1
    assert "outside the limits: elbow_joint reaches a position of" in out


def test_a_recovered_table_becomes_the_same_arm(run: Run, tmp_path: Path) -> None:
    table, urdf = tmp_path / "ur5.yaml", tmp_path / "ur5.urdf"
    assert run("urdf2dh", "ur5", "-o", str(table))[0] == 0
    assert run("dh2urdf", str(table), "-o", str(urdf))[0] == 0
    ours = pp.load_robot(urdf).arm("tool0").forward_kinematics(Q)
    theirs = pp.load_robot("ur5").arm().forward_kinematics(Q)
    np.testing.assert_allclose(ours.homogeneous, theirs.homogeneous, atol=1e-9)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("fk", "ur55"), "ur5"),
        (("fk", "ur5", "--q", "0 1"), "shoulder_pan_joint"),
        (("fk", "ur5", "--q", "0 0 0 0 0 x"), "--q"),
        (("fk", "ur5", "--frame", "tol0"), "tool0"),
        (("fk", "nowhere.urdf"), "nowhere.urdf"),
        (("ik", "ur5"), "--xyz"),
        (("check", "ur5", "--scene", "nowhere.yaml"), "nowhere.yaml"),
        (("certify", "ur5", "nowhere.json"), "nowhere.json"),
        (("dh2urdf", "nowhere.csv", "-o", "x.urdf"), "nowhere.csv"),
    ],
)
def test_a_usage_error_is_one_line_and_exit_code_2(run: Run, words: tuple[str, ...], expected: str) -> None:
    code, out, err = run(*words)
    assert code == 2
    assert out == ""
    assert expected in err
    assert "Traceback" not in err


def test_the_catalogue_is_listed_without_a_robot(run: Run) -> None:
    code, out, _ = run("info")
    listed = tuple(out.replace("\n", " ").strip().split(", "))
    assert code == 0
    assert listed == catalogue_names()
    assert json.loads(run("info", "--json")[1]) == {"robots": list(listed)}
    assert run("info", "--tcp", "tool0")[0] == run("info", "--overlaps")[0] == 2


def test_missing_data_of_a_robot_is_listed(run: Run) -> None:
    code, out, _ = run("info", "ur5", "--json")
    data = json.loads(out)
    assert code == 0
    assert data["dof"] == 6
    assert data["pairs"]["checked"] > 0
    assert any("acceleration" in sentence for sentence in data["missing"])


@pytest.mark.parametrize(
    "words",
    [
        ("dh2urdf", "dh.yaml", "-o", "dh.yaml"),
        ("view", "arm.urdf", "--html", "arm.urdf"),
        ("view", "arm.urdf", "--html", "link_to_arm"),
        ("view", "arm.urdf", "motion.json", "--html", "motion.json"),
        ("certify", "arm.urdf", "motion.json", "--html", "motion.json"),
        ("certify", "arm.urdf", "motion.json", "--scene", "scene.yaml", "--html", "scene.yaml"),
        ("plan", "arm.urdf", "--goal", "home", "--scene", "scene.yaml", "--html", "scene.yaml"),
        ("plan", "arm.urdf", "--goal", "home", "-o", "new.json", "--html", "new.json"),
        ("plan", "arm.urdf", "--goal", "home", "-o", "new.json", "--html", "nowhere/new.html"),
        ("plan", "arm.urdf", "--goal", "home", "-o", "new.json", "--html", "folder"),
        ("demo", "-o", "new.json", "--html", "nowhere/new.html"),
    ],
    ids=" ".join,
)
def test_no_command_overwrites_its_input_or_writes_only_some_outputs(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    files = {
        "dh.yaml": (robots_folder() / "generic_6dof" / "dh.yaml").read_bytes(),
        "arm.urdf": (robots_folder() / "generic_6dof" / "generic_6dof.urdf").read_bytes(),
        "motion.json": b"{}",
        "scene.yaml": b"obstacles: []",
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "link_to_arm").symlink_to("arm.urdf")
    code, _, text = run(*words)
    assert code == 2
    assert text.startswith(f"pinproof: {words[-1]}: ")
    assert text.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {*files, "folder", "link_to_arm"}
    assert {name: (tmp_path / name).read_bytes() for name in files} == files


@pytest.mark.parametrize("robot", ["ur5", "generic_6dof"])
def test_the_table_of_ik_solutions_fits_into_80_columns(run: Run, robot: str) -> None:
    code, out, _ = run("ik", robot, "--xyz", "0.4 0.1 0.3", "--rpy", "pi 0 0", "--all")
    names, header, *rows = out.splitlines()
    arm = pp.load_robot(robot).arm()
    assert names == ", ".join(f"q{k} = {name}" for k, name in enumerate(arm.joint_names, start=1))
    assert header.split() == [f"q{k}" for k in range(1, 7)]
    assert code == 0
    assert len(rows) > 1
    assert max(map(len, [header, *rows[:-1]])) <= 80
    target = pp.pose((0.4, 0.1, 0.3), (math.pi, 0, 0))
    for row in rows[:-1]:
        found = arm.forward_kinematics([float(value) for value in row.split()])
        assert found.isApprox(target, 1e-4)


def test_a_missing_mesh_is_not_taken_for_a_file_in_a_folder(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "m.urdf"
    geometry = '<collision><geometry><mesh filename="package://parts/a.stl"/></geometry></collision>'
    file.write_text(
        f'<robot name="m"><link name="a">{geometry}</link><link name="b"/><joint name="j" type="revolute">'
        '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
        "</joint></robot>"
    )
    code, _, err = run("check", str(file), "--tcp", "b", "--q", "home")
    assert code == 2
    assert "package://parts/a.stl: the mesh of link 'a' was not found" in err
    assert "does not exist" not in err


@pytest.mark.parametrize("name", ["a.txt", "a"])
def test_every_reader_names_the_suffixes_in_the_same_words(name: str) -> None:
    readers = (pp.Scene.load, pp.read_picks, pp.DhTable.load, pp.Trajectory.load, pp.JointLimits.load)
    reports = []
    for read in readers:
        with pytest.raises(pp.FileError) as error:
            read(name)
        reports.append(str(error.value).partition("; valid: "))
    assert len({problem for problem, _, _ in reports}) == 1
    assert all(".yaml" in valid for _, _, valid in reports)


def test_an_output_in_a_missing_folder_is_refused_with_one_reason(run: Run, tmp_path: Path) -> None:
    code, _, err = run("plan", "ur5", "--goal", "home", "-o", str(tmp_path / "missing" / "x.json"))
    assert code == 2
    assert err.count("does not exist") == 1
    (tmp_path / "file").write_text("")
    code, _, err = run("plan", "ur5", "--goal", "home", "-o", str(tmp_path / "file" / "x.json"))
    assert code == 2
    assert err.count("is not a folder") == 1


@pytest.mark.parametrize("words", [("pick", "--workers", "0"), ("cell", "sequence", "--workers", "-1")])
def test_a_number_of_workers_below_one_is_refused_with_the_smallest_number(run: Run, words: tuple[str, ...]) -> None:
    *command, option, value = words
    code, _, err = run(*command, str(robots_folder() / "ur5" / "picks.yaml"), option, value)
    assert code == 2
    assert "'--workers'" in err
    assert "at least 1" in err
