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


def test_a_new_cell_keeps_the_calibration(run: Cli, file: str) -> None:
    trimesh.creation.box((0.05, 0.03, 0.03)).export("block.stl")
    run.prints("new", "cell", "ur5e", "block.stl", "--calibration", file, "-o", "cell", "--no-run")
    arm = pp.read_picks("cell/picks.yaml").load_arm()
    q = np.array([0.3, -1.2, 1.5, -0.4, 0.8, 0.1])
    np.testing.assert_allclose(arm.forward_kinematics(q).homogeneous, calibrations.forward(TABLE, q), atol=1e-12)
