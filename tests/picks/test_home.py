"""Programs that return to home after the part is put down."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError
from pinproof.motion import JointMove, MotionProgram, Remark, RobotProgram
from pinproof.picks import PickReport, certify_picks_program, export_picks, recertify_program
from pinproof.picks.report.program_details import with_return

from .conftest import cell_of

OUTPUTS = {"urscript": "0", "rapid": "grip", "krl": "3", "fanuc": "3"}


@pytest.fixture(scope="module")
def report() -> PickReport:
    report = pp.validate_picks(*cell_of("ur5", "carry.yaml", "over_the_wall"))
    assert report.ok, report.summary
    return report


@pytest.fixture(scope="module")
def returning(report) -> MotionProgram:
    program, reason = with_return(report.setup, report.good[0].pick, report.programs(grip_dwell=0.5)[0])
    assert not reason
    return program


def test_the_return_is_certified_with_the_part_at_its_place_and_ends_at_home(report, returning) -> None:
    pick, segment = report.good[0].pick, returning.segments[-1]
    np.testing.assert_allclose(segment.trajectory.end, report.setup.home, atol=1e-12)
    proofs = report.setup.recertify(returning, pick)
    assert [proof.free for proof in proofs] == [True] * 7
    assert pick.object_name in proofs[-1].obstacles
    assert not any(body.name == pick.object_name for body in proofs[-1].attached)
    # Dense samples with coal and exact meshes
    exact = pp.CollisionChecker(
        report.setup.checker.arm, report.setup.made_by(pick, "")[0].returning(next_member(report)).scene,
        attached=proofs[-1].attached, link_meshes="mesh",
    )  # fmt: skip
    samples = segment.trajectory(np.linspace(0.0, segment.trajectory.duration, 300))
    assert min(exact.clearance(q) for q in samples) >= proofs[-1].clearance - 1e-6


def next_member(report: PickReport):
    """The grasp of the pick."""
    return report.setup.made_by(report.good[0].pick, report.programs()[0].member)[1]


@pytest.mark.parametrize("dialect", ["rapid", "krl"])
def test_a_program_leads_from_home_to_home_in_few_moves(report, returning, dialect) -> None:
    pick, home = report.good[0].pick, report.setup.home
    made = export_picks(report.setup, [(pick, returning)], dialect, output=OUTPUTS[dialect])
    assert made.free
    assert len(made.program.moves) <= 12
    assert made.duration <= 1.1 * made.motion_duration == 1.1 * returning.duration
    for move in (made.program.moves[0], made.program.moves[-1]):
        np.testing.assert_allclose(move.q, home, atol=1e-5)
    words = [step.words for step in made.program.steps if isinstance(step, Remark)]
    assert words[-1] == f"pick {pick.name}: return home"
    # The text is certified again, also if it ends elsewhere
    read = RobotProgram.parse(made.program.text, dialect=dialect)
    ((*proofs,),) = certify_picks_program(report.setup, [pick], read)[0]
    assert all(proof.free for proof in proofs)
    last = max(k for k, step in enumerate(read.steps) if isinstance(step, JointMove))
    moved = replace(read.steps[last], q=home + 0.01 * np.eye(6)[0])
    ((*_, back),) = certify_picks_program(
        report.setup, [pick], replace(read, steps=(*read.steps[:last], moved, *read.steps[last + 1 :]))
    )[0]
    assert (back.status, "from home" in back.message) == (pp.CertificateStatus.VIOLATED, True)


def test_a_return_through_an_obstacle_is_not_free(report, returning) -> None:
    """An obstacle that only the return meets: the text is certified in the scene in which it is run."""
    pick, setup = report.good[0].pick, report.setup
    trajectory = returning.segments[-1].trajectory
    on_the_way = setup.checker.arm.forward_kinematics(trajectory(0.5 * trajectory.duration))
    post = pp.Obstacle("post", pp.Sphere(radius=0.03), setup.checker.arm.root_from_base * on_the_way)
    blocked = replace(setup, checker=setup.checker.with_scene(setup.checker.scene.add(post)))
    proofs = blocked.recertify(returning, pick)
    assert proofs[-1].status is pp.CertificateStatus.COLLIDING


def test_programs_return_unless_the_picks_file_states_otherwise(report, tmp_path: Path) -> None:
    lengths = []
    for home in (True, False):
        shared = replace(report.setup.shared, program=replace(report.setup.shared.program, home=home))
        own = replace(report, setup=replace(report.setup, shared=shared))
        (made,), notes = own.export_programs(tmp_path, "rapid")[0].exported, own.export_programs(tmp_path, "rapid")[1]
        assert not any("return" in note for note in notes)
        lengths.append(made.moves)
        check = recertify_program(own.setup, [report.good[0].pick], tmp_path / "over_the_wall.mod")
        assert check.ok
        assert (check.motions[-1][1] == "return") is home
    assert lengths[0] > lengths[1]


def test_a_program_that_ends_with_the_part_in_the_hand_does_not_return(report) -> None:
    verdict = report.good[0]
    program = report.programs()[0]
    kept = replace(program, segments=program.segments[:-1])
    same, reason = with_return(report.setup, verdict.pick, kept)
    assert same is kept
    assert "part" in reason


def test_a_file_of_another_kind_is_refused_with_the_endings_of_programs(report, tmp_path: Path) -> None:
    (tmp_path / "program.txt").write_text("MOVE A1\n")
    with pytest.raises(InputError, match=r"\.mod .*\.json"):
        recertify_program(report.setup, [report.good[0].pick], tmp_path / "program.txt")
