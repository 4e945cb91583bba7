"""Programs of picks switch the gripper at the grasp and are certified as the text is executed."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError
from pinproof.motion.program_steps import JointMove, SetOutput, Wait
from pinproof.picks import PickReport, export_picks

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def report() -> PickReport:
    picks = pp.read_picks(ROOT / "robots" / "ur5" / "carry.yaml")
    arm, scene = picks.load_arm(), pp.Scene.load(picks.scene)
    chosen = tuple(pick for pick in picks if pick.name == "over_the_wall")
    return pp.validate_picks(arm, scene, replace(picks, picks=chosen))


@pytest.mark.parametrize(("dialect", "output"), [("urscript", "0"), ("rapid", "grip"), ("krl", "3"), ("fanuc", "3")])
def test_a_carried_part_is_gripped_at_the_grasp_and_released_at_the_place(
    report: PickReport, dialect: str, output: str
) -> None:
    (verdict,) = report.good
    (program,) = report.programs(grip_dwell=0.5, release_dwell=0.25)
    made = export_picks(report.setup, [(verdict.pick, program)], dialect, output=output)
    assert made.free
    steps = made.program.steps
    switched = [(k, step.on) for k, step in enumerate(steps) if isinstance(step, SetOutput)]
    assert [on for _, on in switched] == [True, False]
    assert [step.seconds for step in steps if isinstance(step, Wait)] == [0.5, 0.25]
    ends = [segment.trajectory.end for segment in program.segments if segment.name in ("approach", "place")]
    for (k, _), q in zip(switched, ends, strict=True):
        assert np.abs(steps[k - 1].q - q).max() < 1e-5
    assert all(step.blend is None for step in steps if isinstance(step, JointMove))


def test_moves_between_stops_take_as_long_as_the_limits_require(report: PickReport) -> None:
    (verdict,) = report.good
    arm = report.setup.checker.arm
    made = export_picks(report.setup, [(verdict.pick, report.programs()[0])], "urscript", output="0")
    for before, after in pairwise(made.program.moves):
        needed = pp.time_parametrise(pp.JointPath([before.q, after.q], arm.joint_names), arm.limits).duration
        # The text rounds joints to 1e-6 rad; a time grows at most in proportion to the relative change of a distance.
        rounding = 1e-6 / np.abs(after.q - before.q).max()
        assert after.duration >= needed * (1.0 - rounding) - 2e-6


def test_a_deviation_of_the_controller_is_covered_where_the_part_is_on_no_support(report: PickReport) -> None:
    (verdict,) = report.good
    program = report.programs()[0]
    exact, wide = (
        export_picks(report.setup, [(verdict.pick, program)], "urscript", output="0", deviation=deviation)
        for deviation in (0.0, 0.0005)
    )
    assert wide.free
    assert (exact.program.deviation, wide.program.deviation) == (0.0, 0.0005)
    assert exact.notes == ()
    (note,) = wide.notes
    for motion, narrow, tube in zip(verdict.motions, exact.certificates[0], wide.certificates[0], strict=True):
        assert (motion.name in note) == bool(tube.partings)
        if tube.partings:
            assert not tube.tube.joints.any()
        else:
            assert np.all(np.asarray(tube.tube.joints) >= 0.0005)
            assert tube.clearance <= narrow.clearance
    assert any(tube.partings for tube in wide.certificates[0])
    far = export_picks(report.setup, [(verdict.pick, program)], "urscript", output="0", deviation=0.2)
    assert not far.free
    assert far.program.certificate == ""


def test_programs_that_do_not_meet_are_refused(report: PickReport) -> None:
    (verdict,) = report.good
    both = [(verdict.pick, report.programs()[0])] * 2
    with pytest.raises(InputError, match="does not start where"):
        export_picks(report.setup, both, "urscript", output="0")
