"""``--calibration``, ``--like`` and what ``info`` prints of a calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

import pinproof as pp

from ..model import calibrations
from .conftest import Cli

TABLE = calibrations.perturbed("ur5e", 3)


@pytest.fixture
def file(tmp_path: Path) -> str:
    return str(calibrations.write(tmp_path, "ur5e", TABLE, "conf"))


def test_info_prints_what_a_calibration_changes(run: Cli, file: str) -> None:
    effect = run.json("info", "ur5e", "--calibration", file)["calibration"]
    text = run.prints("info", "ur5e", "--calibration", file)
    assert f"calibrated by {file}, which moves the tcp by {1e3 * effect['mean_shift']:.3g} mm" in text
    assert f"{1e3 * effect['largest_rotation']:.3g} mrad" in text
    assert 1e-4 < effect["mean_shift"] < effect["largest_shift"] < 0.02
    assert run.json("info", "ur5e")["calibration"] is None


def test_fk_and_ik_are_those_of_the_calibrated_arm(run: Cli, file: str) -> None:
    q = [0.3, -1.2, 1.5, -0.4, 0.8, 0.1]
    matrix = run.json("fk", "ur5e", "--calibration", file, "--q", " ".join(map(str, q)))["matrix"]
    np.testing.assert_allclose(matrix, calibrations.forward(TABLE, q), rtol=0, atol=1e-12)
    xyz, rpy = ("0.4 0.1 0.3", "pi 0 0")
    found = run.json("ik", "ur5e", "--calibration", file, "--xyz", xyz, "--rpy", rpy, "--all")["branches"][0]
    target = pp.pose((0.4, 0.1, 0.3), (np.pi, 0, 0)).homogeneous
    np.testing.assert_allclose(calibrations.forward(TABLE, found.values()), target, rtol=0, atol=1e-8)


def test_the_tool_of_a_picks_file_is_carried_by_its_calibrated_arm(run: Cli, file: str) -> None:
    tool = "tcp: tool0\ntool: [{name: rod, cylinder: {radius: 0.01, length: 0.1}, xyz: [0, 0, 0.05]}]"
    Path("picks.yaml").write_text(
        f"robot: ur5e\ncalibration: {file}\n{tool}\npicks: [{{name: a, xyz: [0.4, 0.1, 0.3]}}]"
    )
    pose = ("--xyz", "0.4 0.1 0.3", "--rpy", "pi 0 0")
    found = run.json("ik", "ur5e", "--tool-of", "picks.yaml", *pose, "--all")["branches"][0]
    target = pp.pose((0.4, 0.1, 0.3), (np.pi, 0, 0)).homogeneous
    np.testing.assert_allclose(calibrations.forward(TABLE, found.values()), target, rtol=0, atol=1e-8)


def test_a_calibration_alone_is_named_with_the_hint_how_to_use_it(run: Cli, file: str) -> None:
    run.refuses("info", file, named=("calibration.conf of a Universal Robots", "--calibration"))


def test_a_calibration_of_another_robot_is_refused(run: Cli, file: str) -> None:
    run.refuses("fk", "panda", "--calibration", file, named=("panda_joint7", "Universal Robots"))
    run.refuses("fk", "ur10", "--calibration", file, named=("calibration.conf", "mm"))


COMMANDS = (
    "bench", "cell compare", "cell place", "cell sequence", "cell tolerance", "certify", "check", "export", "fk", "ik",
    "info", "new cell", "pick", "plan", "reach", "urdf2dh", "view",
)  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_with_the_files_of_a_robot_takes_a_calibration(run: Cli, command: str) -> None:
    assert "--calibration" in run.prints(*command.split(), "--help")


def test_the_table_of_the_make_is_written(run: Cli) -> None:
    run.prints("urdf2dh", "ur5e", "--like", "ur", "-o", "ur5e.yaml")
    rows = yaml.safe_load(Path("ur5e.yaml").read_text())["rows"]
    numbers = [[row[name] for name in ("theta", "d", "a", "alpha")] for row in rows]
    np.testing.assert_array_equal(numbers, calibrations.published("ur5e"))


def test_far_common_normals_are_explained(run: Cli, file: str) -> None:
    text = run.prints("urdf2dh", "ur5e", "--calibration", file, "-o", "far.yaml")
    assert "'shoulder_lift_joint' and 'elbow_joint' are nearly parallel" in text
    assert len(run.json("dh2urdf", "far.yaml", "-o", "far.urdf")["notes"]) == 2


def test_a_new_cell_keeps_the_calibration(run: Cli, file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pinproof.cell.starting.new_cell.PROPOSED", 100)
    trimesh.creation.box((0.05, 0.03, 0.03)).export("block.stl")
    run.prints("new", "cell", "ur5e", "block.stl", "--calibration", file, "-o", "cell", "--no-run")
    arm = pp.read_picks("cell/picks.yaml").load_arm()
    q = np.array([0.3, -1.2, 1.5, -0.4, 0.8, 0.1])
    np.testing.assert_allclose(arm.forward_kinematics(q).homogeneous, calibrations.forward(TABLE, q), atol=1e-12)


def test_a_motion_file_states_the_calibration_with_which_it_is_certified_again(run: Cli, file: str) -> None:
    run.prints("plan", "ur5e", "--calibration", file, "--goal", "0.5 -1.2 1.2 -1.5 -1.5 0", "-o", "motion.json")
    kept = pp.Trajectory.load("motion.json").certified[0].calibrations
    stated = pp.load_robot("ur5e", calibration=file)
    again = pp.load_robot("ur5e", calibration=kept["ur5e"])
    assert again.urdf.text == stated.urdf.text
    assert kept == {"ur5e": stated.calibration}
    # Without the option, the arm is that of the file
    certificates = [run.json("certify", "ur5e", "motion.json", *more) for more in ((), ("--calibration", file))]
    assert not any("motion states" in note for each in certificates for note in each["notes"])
    # Another calibration is refused
    other = calibrations.perturbed("ur5e", 4)
    Path("other").mkdir()
    elsewhere = str(calibrations.write(Path("other"), "ur5e", other, "csv"))
    run.refuses("certify", "ur5e", "motion.json", "--calibration", elsewhere, named=("calibration.conf", elsewhere))
    ignored = run.json("certify", "ur5e", "motion.json", "--calibration", elsewhere, "--ignore-record")
    assert any(f"calibrated by {elsewhere}" in note for note in ignored["notes"])


@pytest.mark.parametrize("kind", ["conf", "yaml", "csv"])
def test_the_numbers_of_every_kind_of_calibration_are_restored_from_a_motion_file(tmp_path: Path, kind: str) -> None:
    robot = pp.load_robot("ur5e", calibration=calibrations.write(tmp_path, "ur5e", TABLE, kind))
    arm = robot.arm()
    motion = pp.time_parametrise(pp.JointPath([arm.home, arm.home + 0.1], arm.joint_names), arm.limits)
    for suffix in (".json", ".csv"):
        motion.save(tmp_path / f"m{suffix}", certificate=pp.certify(motion, pp.CollisionChecker(arm)))
        (kept,) = pp.Trajectory.load(tmp_path / f"m{suffix}").certified[0].calibrations.values()
        assert pp.load_robot("ur5e", calibration=kept).urdf.text == robot.urdf.text
