"""Picks of a calibrated arm are judged with its true kinematics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.motion import find_dialect
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


@pytest.mark.parametrize("dialect", ["urscript", "rapid", "krl", "fanuc"])
def test_a_program_names_its_calibration_and_is_proven_with_no_other(picks, report, tmp_path: Path, dialect):
    good = named(report.verdicts, "bolt_1")
    (program,) = (each for each in report.programs() if each.name == "bolt_1")
    made = export_picks(report.setup, [(good.pick, program)], dialect, output="grip" if dialect == "rapid" else "1")
    assert made.free
    assert made.program.calibrations["ur5"].startswith("calibration.conf:")
    file = tmp_path / f"bolt_1{find_dialect(dialect).endings[0]}"
    made.program.save(file)
    same = recertify_program(report.setup, [good.pick], file)
    assert (same.ok, same.notes) == (True, made.notes)
    # neither with the nominal arm nor with another calibration, which differs by less than the tolerance of the grasp
    first = next(iter(picks.load_arm().robot.calibrations.values()))
    for other in (None, replace(first, deltas=first.deltas + 1e-6)):
        arm = pp.load_robot("ur5", calibration=other).arm(tcp="tool0")
        setup = pp.picks.PickSetup.make(arm, pp.Scene.load(picks.scene), picks, home=None, rng=0)
        proofs = recertify_program(setup, [good.pick], file).motions
        assert not any(proof.free for _, _, proof, _ in proofs)
        assert any("the calibration of ur5" in proof.message for _, _, proof, _ in proofs)


def test_an_exported_motion_names_its_calibration_and_is_proven_with_no_other(picks, tmp_path: Path):
    arm = picks.load_arm()
    motion = pp.time_parametrise(pp.JointPath([arm.home, arm.home + 0.2], arm.joint_names), arm.limits)
    program, certificate = pp.collision.export_program(motion, pp.CollisionChecker(arm), "rapid")
    assert certificate.free
    assert "calibration: ur5=calibration.conf:" in program.text
    nominal = pp.collision.certify_program(program, pp.CollisionChecker(pp.load_robot("ur5").arm(tcp="tool0")))
    assert nominal.status is pp.CertificateStatus.UNDECIDED
    assert "the calibration of ur5" in nominal.message


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
