"""Programs of the steps of a sequence: each begins where the one before ends, proven in the scene of its moment."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell import SequenceResult
from pinproof.errors import InputError
from pinproof.motion import RobotProgram
from pinproof.picks import certify_picks_program

from .test_sequence import FLOOR, SIDE, tray_cell

BEFORE = [(0.45, 0.25, FLOOR), (0.45, 0.25, FLOOR + SIDE)]
AFTER = [(0.45, -0.25, FLOOR + SIDE), (0.45, -0.25, FLOOR)]


@pytest.fixture(scope="module")
def ordered() -> SequenceResult:
    """box_1 is on box_0, and then below it."""
    setup, picks = tray_cell(BEFORE, AFTER)
    return pp.sequence(setup, picks, grip_dwell=0.2, release_dwell=0.1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("programs")


@pytest.fixture(scope="module")
def exported(ordered, folder) -> SequenceResult:
    result, notes = ordered.export_programs(folder, "krl")
    assert all("no deviation" in note for note in notes)
    return result


def programs(result: SequenceResult, folder: Path) -> list[RobotProgram]:
    """The programs as read from their files, in order."""
    return [RobotProgram.load(folder / f"{step.name}.src") for step in result.steps]


@pytest.mark.slow
def test_programs_follow_each_other_from_home_to_home(exported, folder) -> None:
    read, home = programs(exported, folder), exported.setup.home
    assert exported.order == ("pick_1", "pick_0")
    arm = exported.setup.checker.arm

    def reached(move) -> np.ndarray:
        return (arm.forward_kinematics(move.q) if move.q is not None else move.pose).homogeneous

    for before, after in pairwise(read):
        np.testing.assert_allclose(reached(before.moves[-1]), reached(after.moves[0]), atol=1e-5)
    for move in (read[0].moves[0], read[-1].moves[-1]):
        np.testing.assert_allclose(move.q, home, atol=1e-5)
    called = (folder / "main.src").read_text()
    assert called.index("\n  pick_1()") < called.index("\n  pick_0()")


@pytest.mark.slow
def test_programs_are_proven_in_the_scenes_of_their_moments_only(exported, folder) -> None:
    for read, step in zip(programs(exported, folder), exported.steps, strict=True):
        now = replace(exported.setup, checker=exported.setup.checker.with_scene(step.scene))
        ((*proofs,),) = certify_picks_program(now, [step.verdict.pick], read)[0]
        assert all(proof.free for proof in proofs)
    # The box below is blocked by the other one before the sequence
    ((*proofs,),) = certify_picks_program(exported.setup, [step.verdict.pick], read)[0]
    assert not all(proof.free for proof in proofs)


@pytest.mark.slow
def test_the_cycle_time_of_the_programs_is_stated_beside_the_certified_one(ordered, exported, tmp_path) -> None:
    assert (ordered.exported, np.isnan(ordered.program_duration)) == ((), True)
    assert exported.duration == ordered.duration
    assert exported.program_duration == pytest.approx(sum(own.duration for own in exported.exported), abs=1e-12)
    assert 0.7 * exported.duration < exported.program_duration < 1.1 * exported.duration
    assert exported.program_duration > 2 * (0.2 + 0.1)
    assert exported.to_dict()["program_duration"] == pytest.approx(exported.program_duration)
    stated = f"cycle of the krl programs: {exported.program_duration:.1f} s"
    assert stated in exported.to_text()
    assert stated in exported.to_markdown()
    exported.save(tmp_path / "sequence.html")
    assert "cycle of the krl programs" in (tmp_path / "sequence.html").read_text()
    part = replace(exported, exported=exported.exported[:1])
    assert part.to_dict()["program_duration"] is None
    assert "only 1 of 2 are proven" in part.to_text()


@pytest.mark.slow
def test_a_language_that_does_not_fit_is_refused(ordered, tmp_path) -> None:
    with pytest.raises(InputError, match="digital outputs"):
        ordered.export_programs(tmp_path, "ros2")
    ordered.export_programs(tmp_path, "urscript")  # has no routines in other files
    assert not (tmp_path / "main.script").exists()
