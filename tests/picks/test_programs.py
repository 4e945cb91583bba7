"""Programs of judged picks: events at the right times, continuous segments, and certification in the cell again."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.certificates.certificate import curve_hash
from pinproof.description import robots_folder
from pinproof.errors import InputError
from pinproof.motion import MotionProgram
from pinproof.picks import REPORT_SUFFIXES, write_motion_pages


@pytest.fixture(scope="module")
def carried() -> tuple[pp.picks.PickReport, pp.Picks]:
    """The first picks with an object and a place of the UR5 example."""
    file = robots_folder() / "ur5" / "carry.yaml"
    picks = pp.read_picks(file)
    picks = replace(picks, picks=tuple(each for each in picks.picks if each.place is not None)[:1])
    arm = pp.load_robot("ur5").arm(picks.tcp, held=picks.held)
    report = pp.validate_picks(arm, pp.Scene.load(picks.scene), picks)
    assert report.ok, report.summary
    return report, picks


@pytest.fixture(scope="module")
def empty() -> tuple[pp.picks.PickReport, pp.Picks]:
    """The first pick of the UR5 example, which states no object."""
    file = robots_folder() / "ur5" / "picks.yaml"
    picks = replace(pp.read_picks(file), picks=pp.read_picks(file).picks[:1])
    report = pp.validate_picks(pp.load_robot("ur5").arm(), pp.Scene.load(picks.scene), picks)
    assert report.ok, report.summary
    return report, picks


def test_segments_and_events_share_one_continuous_clock(carried) -> None:
    verdict = carried[0].good[0]
    program = verdict.program(grip_dwell=0.4, release_dwell=0.2)
    assert [segment.name for segment in program.segments] == [motion.name for motion in verdict.motions]
    rest = {event.time: event.dwell for event in program.events}
    for one, other in pairwise(program.segments):
        assert other.start == pytest.approx(one.end + rest.get(one.end, 0.0), abs=1e-9)
        np.testing.assert_array_equal(one.trajectory.end, other.trajectory.start)
    assert program.duration == pytest.approx(verdict.trajectory.duration + 0.6, abs=1e-9)
    assert verdict.program().duration == pytest.approx(verdict.trajectory.duration, abs=1e-9)


def test_events_are_at_the_grasp_and_at_the_release(carried) -> None:
    report, picks = carried
    verdict, arm = report.good[0], report.setup.checker.arm
    grip, release = verdict.program(grip_dwell=0.4).events
    assert (grip.kind, grip.time, grip.dwell) == ("grip", verdict.grasp_time, 0.4)
    assert (release.kind, release.dwell) == ("release", 0.0)
    assert release.time == pytest.approx(verdict.release_time + 0.4, abs=1e-9)
    assert grip.object == release.object == verdict.motions[2].attached[-1].name
    program = verdict.program(grip_dwell=0.4)
    np.testing.assert_array_equal(program(grip.time), verdict.q_grasp)
    tip = arm.root_from_base * arm.forward_kinematics(program(grip.time + 0.2)) * picks.tip
    assert np.linalg.norm(tip.translation - verdict.pick.pose.translation) < 1e-5


def test_pick_without_object_is_split_at_the_grasp_under_one_certificate(empty) -> None:
    verdict = empty[0].good[0]
    program = verdict.program(grip_dwell=0.5)
    assert [event.kind for event in program.events] == ["grip"]
    assert len(program.segments) == 2
    assert len(program.certificates) == 1
    assert program.segments[0].end == verdict.grasp_time
    (whole,) = program.motions.values()
    assert curve_hash(whole) == verdict.motions[0].certificate.curve == next(iter(program.certificates.values())).curve


def test_saved_programs_name_their_certificates_and_are_read_back(carried, tmp_path: Path) -> None:
    report = carried[0]
    (path,) = report.save_programs(tmp_path, release_dwell=0.1)
    program = MotionProgram.load(path)
    (made,) = report.programs(release_dwell=0.1)
    assert program.to_json() == made.to_json()
    assert (program.robot, program.tcp) == ("ur5", "tool0")
    curves = [motion.certificate.curve for motion in report.good[0].motions]
    assert [program.certificates[segment.certificate].curve for segment in program.segments] == curves


def test_a_folder_has_all_reports_and_the_motion_and_program_of_each_good_pick(carried, tmp_path: Path) -> None:
    report = carried[0]
    (stem,) = report.save_folder(tmp_path, grip_dwell=0.2)
    assert {path.name for path in tmp_path.iterdir()} == {
        *(f"report{kind}" for kind in REPORT_SUFFIXES),
        f"{stem}.json",
        f"{stem}.program.json",
    }
    assert (
        MotionProgram.load(tmp_path / f"{stem}.program.json").to_json() == report.programs(grip_dwell=0.2)[0].to_json()
    )
    pages = write_motion_pages(report.good[0], report.setup.checker.arm, tmp_path / "motion.html")
    assert [page.stem for page in pages] == [
        f"motion_{number}_{motion.name}" for number, motion in enumerate(report.good[0].motions, start=1)
    ]
    assert all(page.is_file() for page in pages)


@pytest.mark.parametrize("cell", ["carried", "empty"])
def test_program_is_certified_again_in_its_cell(cell, request) -> None:
    report, picks = request.getfixturevalue(cell)
    verdict = report.good[0]
    proofs = report.setup.recertify(verdict.program(grip_dwell=0.3), picks.picks[0])
    assert [proof.status for proof in proofs] == [pp.CertificateStatus.FREE] * len(verdict.motions)
    for proof, motion in zip(proofs, verdict.motions, strict=True):
        assert (proof.curve, proof.setup) == (motion.certificate.curve, motion.certificate.setup)
        assert proof.clearance == pytest.approx(motion.certificate.clearance, abs=1e-6)


def test_changed_number_is_noticed_by_certifying_again(carried, tmp_path: Path) -> None:
    report, picks = carried
    (path,) = report.save_programs(tmp_path)
    data = json.loads(path.read_text())
    points = data["segments"][0]["points"]
    points[len(points) // 2]["positions"][1] += 1.0  # the shoulder lowers the arm into the table
    path.write_text(json.dumps(data))
    program = MotionProgram.load(path, allow_changes=True)
    assert program.changed == (program.segments[0].name,)
    proofs = report.setup.recertify(program, picks.picks[0])
    assert not proofs[0].free
    assert all(proof.free for proof in proofs[1:])


def test_program_that_puts_the_part_down_is_refused_for_a_pick_without_a_place(carried) -> None:
    report, picks = carried  # without a place, the part would be where it was grasped while the hand leaves
    with pytest.raises(InputError, match=r"'transfer', which does not exist in a pick without a place"):
        report.setup.recertify(report.good[0].program(), replace(picks.picks[0], place=None))


def test_program_of_another_pick_is_refused(carried, empty) -> None:
    report, picks = carried
    with pytest.raises(InputError, match=r"'pick'"):
        report.setup.recertify(empty[0].good[0].program(), picks.picks[0])
    with pytest.raises(InputError, match=r"no motion"):
        replace(report.good[0], trajectory=None, status=pp.picks.PickStatus.NOT_FOUND).program()
