"""Picks of a calibrated arm are judged with its true kinematics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.picks import PickStatus, export_picks, recertify_program

from ..model import calibrations
from .conftest import named, recheck

TABLE = calibrations.perturbed("ur5", 1)


@pytest.fixture(scope="module")
def picks(tmp_path_factory: pytest.TempPathFactory) -> pp.Picks:
    """Three picks of the UR5's cell with a calibration beside them."""
    folder, cell = tmp_path_factory.mktemp("calibrated"), robots_folder() / "ur5"
    calibrations.write(folder, "ur5", TABLE, "conf")
    text = (cell / "picks.yaml").read_text().replace("robot: ur5\n", "robot: ur5\ncalibration: calibration.conf\n")
    text = text.replace("scene: scene.yaml", f"scene: {cell / 'scene.yaml'}")
    kept = [line for line in text.splitlines() if "bolt_" not in line or line.split(",")[0][-1] in "136"]
    (folder / "picks.yaml").write_text("\n".join(kept))
    return pp.read_picks(folder / "picks.yaml")


@pytest.fixture(scope="module")
def report(picks) -> pp.picks.PickReport:
    arm = picks.load_arm()
    return pp.validate_picks(arm, pp.Scene.load(picks.scene), picks, home=arm.home)


def test_good_picks_reach_their_targets_and_are_free_by_the_true_kinematics(picks, report):
    arm, scene = picks.load_arm(), pp.Scene.load(picks.scene)
    good = named(report.verdicts, "bolt_1")
    assert good.status is PickStatus.GOOD
    recheck(good, arm, scene, picks)
    tip = calibrations.forward(TABLE, good.q_grasp) @ picks.tip.homogeneous
    np.testing.assert_allclose(tip, good.pick.pose.homogeneous, rtol=0, atol=2e-6)
    nominal = pp.load_robot("ur5").arm().forward_kinematics(good.q_grasp).homogeneous @ picks.tip.homogeneous
    assert np.linalg.norm((nominal - tip)[:3, 3]) > 2e-4
    # failures keep their reasons, and the report states the calibration
    assert named(report.verdicts, "bolt_3").status is PickStatus.IMPOSSIBLE
    assert not named(report.verdicts, "bolt_6").ok
    assert "calibration.conf" in report.to_markdown()


def test_a_program_for_another_calibration_is_noted_and_does_not_reach_the_grasp(picks, report, tmp_path: Path):
    good = named(report.verdicts, "bolt_1")
    (program,) = (each for each in report.programs() if each.name == "bolt_1")
    made = export_picks(report.setup, [(good.pick, program)], "urscript", output="0")
    assert made.free
    made.program.save(tmp_path / "bolt_1.script")
    same = recertify_program(report.setup, [good.pick], tmp_path / "bolt_1.script")
    assert (same.ok, same.notes) == (True, made.notes)
    nominal = replace(picks, calibration=None).load_arm()
    setup = pp.picks.PickSetup.make(nominal, pp.Scene.load(picks.scene), picks, home=None, rng=0)
    other = recertify_program(setup, [good.pick], tmp_path / "bolt_1.script")
    assert not other.ok
    assert any("another certificate" in note for note in other.notes)


def test_each_robot_of_a_cell_has_its_own_calibration(tmp_path: Path):
    calibrations.write(tmp_path, "ur5", TABLE, "yaml")
    text = """robots:
  left: {robot: ur5, calibration: calibration.yaml, base: {xyz: [0, 0, 0]}}
  right: {robot: ur5, base: {xyz: [1.5, 0, 0]}}
picks: [{name: one, xyz: [0.4, 0.1, 0.3], rpy: [pi, 0, 0]}]
"""
    (tmp_path / "picks.yaml").write_text(text)
    robots = pp.read_picks(tmp_path / "picks.yaml").robots
    left, right = (robots[name].settings.load_arm() for name in ("left", "right"))
    q = np.array([0.3, -1.2, 1.5, -0.4, 0.8, 0.1])
    np.testing.assert_allclose(left.forward_kinematics(q).homogeneous, calibrations.forward(TABLE, q), atol=1e-12)
    assert right.robot.nominal is None
