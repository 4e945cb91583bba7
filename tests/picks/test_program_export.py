"""Programs of picks switch the gripper at the grasp and are certified as the text is executed."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError
from pinproof.motion import Blend, JointMove, RobotProgram, SetOutput, Wait
from pinproof.picks import PickReport, certify_picks_program, export_picks

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
    assert "not covered: over_the_wall" in wide.program.text
    assert "not covered" not in exact.program.text
    assert RobotProgram.parse(wide.program.text, dialect="urscript").certificate == wide.program.certificate != ""
    assert any(tube.partings for tube in wide.certificates[0])
    far = export_picks(report.setup, [(verdict.pick, program)], "urscript", output="0", deviation=0.2)
    assert not far.free
    assert far.program.certificate == ""


def test_programs_that_do_not_meet_are_refused(report: PickReport) -> None:
    (verdict,) = report.good
    both = [(verdict.pick, report.programs()[0])] * 2
    with pytest.raises(InputError, match="does not start where"):
        export_picks(report.setup, both, "urscript", output="0")


class TestReadBack:
    """A program of picks is certified with its picks, in every language; without them it is undecided."""

    @pytest.fixture(params=["urscript", "rapid", "krl", "fanuc"])
    def text(self, report: PickReport, request: pytest.FixtureRequest) -> RobotProgram:
        (verdict,) = report.good
        output = "grip" if request.param == "rapid" else "3"
        (program,) = report.programs(grip_dwell=0.5)
        return export_picks(report.setup, [(verdict.pick, program)], request.param, output=output).program

    def test_the_text_alone_is_certified_with_the_picks(self, report: PickReport, text: RobotProgram) -> None:
        (verdict,) = report.good
        read = RobotProgram.parse(text.text, dialect=text.dialect)
        certificates, notes = certify_picks_program(report.setup, [verdict.pick], read)
        assert [[proof.status for proof in row] for row in certificates] == [
            [pp.CertificateStatus.FREE] * len(verdict.motions)
        ]
        assert len(notes) == 1
        assert read.deviation == 0.002

    def test_without_the_picks_it_is_undecided(self, report: PickReport, text: RobotProgram) -> None:
        certificate = pp.collision.certify_program(text, report.setup.checker)
        assert not certificate.free
        assert len(certificate.outputs) == 2

    @pytest.mark.parametrize("shift", [(0.0, 0.0, 0.5), (0.0, 0.003, 0.0)])
    def test_a_program_for_a_part_that_is_elsewhere_is_not_free(self, report, text, shift) -> None:
        (verdict,) = report.good
        moved = replace(verdict.pick, pose=pp.pose(shift) * verdict.pick.pose)
        ((_, approach, *_),) = certify_picks_program(report.setup, [moved], text)[0]
        assert approach.status is pp.CertificateStatus.VIOLATED
        assert "from the grasp of the pick" in approach.message

    @pytest.mark.parametrize("axis", [0, 1, 2])
    def test_a_program_that_grasps_at_another_angle_is_not_free(self, report, text, axis) -> None:
        (verdict,) = report.good
        turned = replace(verdict.pick, pose=verdict.pick.pose * pp.pose((0, 0, 0), tuple(0.001 * np.eye(3)[axis])))
        ((_, approach, *_),) = certify_picks_program(report.setup, [turned], text)[0]
        assert approach.status is pp.CertificateStatus.VIOLATED
        assert "from the grasp of the pick" in approach.message

    def test_the_parts_of_earlier_picks_are_not_covered(self, report, text) -> None:
        """Where the part was put down is no obstacle for the second pick, which a note states."""
        (verdict,), (pick,) = report.good, text.picks
        (first, count), *rest = pick.motions
        again = replace(pick, motions=((first, count + 1), *rest))
        both = replace(text, steps=(*text.steps, *text.steps), picks=(pick, again))
        certificates, notes = certify_picks_program(report.setup, [verdict.pick], both)
        single = certify_picks_program(report.setup, [verdict.pick], text)[1]
        assert [len(row) for row in certificates] == [len(pick.motions)] * 2
        assert len(notes) == 2 * len(single) + 1
        assert "where they were picked" in notes[-1]

    def test_an_unknown_pick_is_named(self, report, text) -> None:
        with pytest.raises(pp.errors.UnknownNameError, match="over_the_wall"):
            certify_picks_program(report.setup, [], text)

    def test_a_program_without_picks_is_refused(self, report, text) -> None:
        with pytest.raises(InputError, match="states no picks"):
            certify_picks_program(report.setup, [], replace(text, picks=()))

    def test_a_program_that_does_not_grip_is_not_free(self, report, text) -> None:
        (verdict,) = report.good
        silent = replace(text, steps=tuple(step for step in text.steps if not isinstance(step, SetOutput | Wait)))
        ((first, *_),) = certify_picks_program(report.setup, [verdict.pick], silent)[0]
        assert first.status is pp.CertificateStatus.VIOLATED

    def test_another_output_than_that_of_the_gripper_is_refused(self, report, text) -> None:
        (verdict,) = report.good
        last = max(k for k, step in enumerate(text.steps) if isinstance(step, SetOutput))
        other = (*text.steps[:last], replace(text.steps[last], output="do_9"), *text.steps[last + 1 :])
        with pytest.raises(InputError, match="do_9"):
            certify_picks_program(report.setup, [verdict.pick], replace(text, steps=other))

    def test_the_time_of_the_move_to_the_first_point_is_refused(self, report, text) -> None:
        (verdict,) = report.good
        timed = (replace(text.steps[0], duration=0.5), *text.steps[1:])
        with pytest.raises(InputError, match="first point"):
            certify_picks_program(report.setup, [verdict.pick], replace(text, steps=timed))

    def test_a_gripper_that_switches_elsewhere_or_the_wrong_way_is_not_free(self, report, text) -> None:
        """The outputs of the text count, not the names of the motions: later, earlier, exchanged."""
        (verdict,) = report.good
        switched = [k for k, step in enumerate(text.steps) if isinstance(step, SetOutput)]
        edits = []
        for k in switched:
            edits.append([replace(s, on=not s.on) if i == k else s for i, s in enumerate(text.steps)])
        edits.append([replace(s, on=not s.on) if i in switched else s for i, s in enumerate(text.steps)])
        (pick,) = text.picks
        without = [step for step in text.steps if not isinstance(step, SetOutput | Wait)]
        ends = np.cumsum([count for _, count in pick.motions])
        for grip, release in ((0, 4), (2, 4), (1, 3), (1, 5), (0, 5), (3, 4)):
            steps = list(without)
            for at, on in ((release, False), (grip, True)):
                steps.insert(1 + int(ends[at]), replace(text.steps[switched[0]], on=on))
            edits.append(steps)
        assert len(pick.motions) == 6
        for steps in edits:
            ((*proofs,),) = certify_picks_program(report.setup, [verdict.pick], replace(text, steps=tuple(steps)))[0]
            assert not all(proof.free for proof in proofs)

    def test_a_program_for_another_arm_is_refused(self, report, text) -> None:
        (verdict,) = report.good
        names = text.joint_names[::-1]
        with pytest.raises(InputError, match="joints"):
            certify_picks_program(report.setup, [verdict.pick], replace(text, joint_names=names))

    def test_another_number_of_moves_is_refused(self, report, text) -> None:
        (verdict,) = report.good
        for steps in (text.steps[:-1], (*text.steps, text.steps[-1])):
            with pytest.raises(InputError, match=r"moves|continues"):
                certify_picks_program(report.setup, [verdict.pick], replace(text, steps=steps))

    def test_a_blend_and_a_move_that_is_too_fast_are_not_free(self, report, text) -> None:
        (verdict,) = report.good
        at = next(k for k, step in enumerate(text.steps) if isinstance(step, JointMove)) + 1
        if text.dialect != "krl":  # which states no durations
            fast = (*text.steps[:at], replace(text.steps[at], duration=1e-3), *text.steps[at + 1 :])
            ((*proofs,),) = certify_picks_program(report.setup, [verdict.pick], replace(text, steps=fast))[0]
            assert {proof.status for proof in proofs} == {pp.CertificateStatus.VIOLATED}
        blended = (*text.steps[:at], replace(text.steps[at], blend=Blend(0.01)), *text.steps[at + 1 :])
        with pytest.raises(InputError, match="stop"):
            certify_picks_program(report.setup, [verdict.pick], replace(text, steps=blended))


def test_a_program_that_grasps_beside_the_part_is_not_free(report: PickReport) -> None:
    """The pose of the pick is reached, but the part is not there: the grip stage decides."""
    (verdict,) = report.good
    picks = pp.read_picks(ROOT / "robots" / "ur5" / "carry.yaml")
    scene = pp.Scene.load(picks.scene)
    part = scene[verdict.pick.object_name]
    aside = scene.remove(part.name).add(replace(part, pose=pp.pose((0.02, 0.02, 0.0)) * part.pose))
    setup = pp.picks.PickSetup.make(picks.load_arm(), aside, picks, home=None, rng=0)
    (program,) = report.programs()
    proofs = dict(zip((motion.name for motion in verdict.motions), setup.recertify(program, verdict.pick), strict=True))
    assert proofs["approach"].status is pp.CertificateStatus.VIOLATED
    assert np.isnan(proofs["approach"].clearance)
