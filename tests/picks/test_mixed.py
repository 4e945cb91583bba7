"""Mixed parts and several tools: verdicts, programs, screening, sequences and pages of one picks file."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError
from pinproof.picks import PickSetup, PickStatus, PickTask, Stage

from .conftest import QUICK, cell_of, named

OPEN_AT_REST = {"jaws": {"palm", "finger_1", "finger_2"}, "cup": {"tube"}}


@pytest.fixture(scope="module")
def cell() -> tuple[pp.Arm, pp.Scene, pp.Picks]:
    return cell_of("ur5", "mixed_picks.yaml")


@pytest.fixture(scope="module")
def report(cell) -> pp.picks.PickReport:
    return pp.validate_picks(*cell, budget=QUICK)


def test_each_pick_is_judged_with_the_hand_of_its_tool(report) -> None:
    assert report.ok
    for verdict in report.verdicts:
        tool = "cup" if verdict.name.startswith("plate") else "jaws"
        assert verdict.tool == verdict.pick.tool == tool
        assert {body.name for body in verdict.motions[0].attached} == OPEN_AT_REST[tool]
        carried = {body.name for body in verdict.motions[2].attached}
        assert carried == {*OPEN_AT_REST[tool], verdict.name}
        assert verdict.motions[0].torques


def test_the_closed_width_of_each_part_follows_from_contact(report) -> None:
    width = {"bolt": 0.016, "block": 0.03}
    for verdict in report.verdicts:
        part = verdict.name.partition("_")[0]
        if part in width:
            y = {body.name: body.pose.translation[1] for body in verdict.motions[2].attached}
            assert y["finger_1"] - y["finger_2"] - 0.01 == pytest.approx(width[part], abs=5e-5)


def test_the_grasps_of_a_part_are_tried_in_their_order_and_failures_are_named(cell, report) -> None:
    block = named(report.verdicts, "block_1")
    assert block.grasp == "across"
    (failed,) = block.grasps_failed
    assert failed.startswith("along: grip: the open finger")
    assert named(report.verdicts, "bolt_1").grasps_failed == ()
    arm, scene, picks = cell
    alone = replace(picks, picks=[replace(named(picks, "block_1"), grasp="along")])
    (verdict,) = pp.validate_picks(arm, scene, alone, budget=QUICK).verdicts
    assert (verdict.status, verdict.failed) == (PickStatus.IMPOSSIBLE, Stage.GRIP)


def test_a_pick_is_impossible_only_if_every_grasp_is(cell) -> None:
    arm, scene, picks = cell
    block, far = named(picks, "block_1"), pp.pose((3.0, 0, 0.03))
    scene = scene.move("block_1", far)
    (verdict,) = pp.validate_picks(arm, scene, replace(picks, picks=[block]), budget=QUICK).verdicts
    assert (verdict.status, verdict.failed) == (PickStatus.IMPOSSIBLE, Stage.REACH)
    assert len(verdict.grasps_failed) == 1
    # the samples of a tolerance prove nothing about the grasps between them
    part = picks.parts["block"]
    wide = replace(part, grasps=(part.grasps[0], replace(part.grasps[1], tolerance=pp.picks.GraspTolerance(0.01))))
    loose = replace(picks, picks=[block], parts={**picks.parts, "block": wide})
    (verdict,) = pp.validate_picks(arm, scene, loose, budget=QUICK).verdicts
    assert verdict.status is PickStatus.NOT_FOUND
    # nor does a grasp that cannot be judged: its fingers would close beyond their opening
    wrong = replace(part, grasps=(part.grasps[0], replace(part.grasps[1], fingers={"opening": 0.04, "grip": 0.045})))
    unread = replace(picks, picks=[block], parts={**picks.parts, "block": wrong})
    (verdict,) = pp.validate_picks(arm, scene, unread, budget=QUICK).verdicts
    assert (verdict.status, verdict.refuted) == (PickStatus.NOT_FOUND, ())
    assert verdict.grasps_failed[0].startswith("across: input: ")


def test_a_program_of_a_pick_with_several_grasps_is_certified_again_with_its_grasp(cell, report) -> None:
    arm, scene, picks = cell
    setup = PickSetup.make(arm, scene, picks, home=None, rng=0)
    for name in ("block_1", "plate_1"):
        program = named(report.verdicts, name).program()
        assert all(proof.free for proof in setup.recertify(program, named(picks, name)))


def test_screening_and_certificates_for_displaced_parts_use_the_hand_of_the_pick(cell, report) -> None:
    arm, scene, picks = cell
    assert pp.picks.screen_picks(arm, scene, picks).free.all()
    away = scene.move("plate_1", pp.pose((3.0, 0, 0)))
    screened = pp.picks.screen_picks(arm, away, picks)
    assert screened.free.tolist() == [True, False, True, True, True]
    setup = PickSetup.make(arm, scene, picks, home=None, rng=0)
    for name in ("bolt_1", "plate_1"):
        assert all(proof.free for proof in setup.certify_displaced(named(report.verdicts, name), 1e-4))


def test_the_identity_of_a_setup_depends_on_tools_and_parts(cell) -> None:
    arm, scene, picks = cell

    def identity(changed: pp.Picks) -> dict:
        return PickSetup.make(arm, scene, changed, home=None, rng=0).identity()

    tools, parts = dict(picks.tools), dict(picks.parts)
    tools["cup"] = replace(tools["cup"], tip=pp.pose((0, 0, 0.121)))
    parts["bolt"] = replace(parts["bolt"], mass=0.07)
    found = [identity(each) for each in (picks, replace(picks, tools=tools), replace(picks, parts=parts))]
    assert all(a != b for a, b in pairwise([*found, found[0]]))
    assert identity(picks) == found[0]


def test_a_tool_that_is_in_contact_at_home_is_named(cell) -> None:
    arm, scene, picks = cell
    long = replace(picks.tools["cup"], tool=(pp.Obstacle("tube", pp.Cylinder(0.01, 2.0), pp.pose((0, 0, 1.0))),))
    with pytest.raises(InputError, match="home is not a valid start with tool 'cup'"):
        PickSetup.make(arm, scene, replace(picks, tools={**picks.tools, "cup": long}), home=None, rng=0)


def test_the_notes_name_what_is_not_covered_for_each_kind_of_hand(report) -> None:
    text = " ".join(report.notes)
    assert "gripping force" in text
    assert "suction cup" in text
    assert "tool without fingers" not in text


def test_a_pick_without_a_choice_of_its_grasp_is_refused_where_one_grasp_is_needed(cell) -> None:
    arm, scene, picks = cell
    setup = PickSetup.make(arm, scene, picks, home=None, rng=0)
    with pytest.raises(InputError, match="describes several grasps"):
        PickTask(named(picks, "block_1"), setup.cell)


@pytest.fixture(scope="module")
def sequence(cell) -> pp.cell.SequenceResult:
    arm, scene, picks = cell
    setup = PickSetup.make(arm, scene, picks, home=None, rng=0)
    budget = pp.cell.SequenceBudget(options=2, search=500, refinements=0, motion=0)
    return pp.sequence(setup, picks, budget=budget, grip_dwell=0.5)


@pytest.mark.slow
def test_a_sequence_changes_the_tool_once_at_home_and_states_it(cell, sequence) -> None:
    arm, _, picks = cell
    assert sequence.ok
    tools = [step.tool for step in sequence]
    assert sum(a != b for a, b in pairwise(tools)) == 1 == sequence.tool_changes
    (change,) = [phase for step in sequence for phase in step.phases if phase.name == "change"]
    assert change.duration == picks.tool_change == 6.0
    assert sequence.by_phase["change"] == 6.0
    # The motions of the whole sequence follow each other, the return with the old tool ends at home
    motions = [motion for step in sequence for motion in step.verdict.motions]
    for before, after in pairwise(motions):
        np.testing.assert_allclose(before.trajectory.end, after.trajectory.start, atol=1e-9)
    back = next(motion for motion in motions if motion.name == "return")
    step = next(step for step in sequence if step.verdict.motions[0] is back)
    np.testing.assert_allclose(back.trajectory.end, sequence.setup.home, atol=1e-9)
    old = tools[tools.index(step.tool) - 1]
    assert {body.name for body in back.attached} == OPEN_AT_REST[old]
    assert {body.name for body in step.verdict.motions[1].attached} == OPEN_AT_REST[step.tool]
    # Each is free for its bodies, by samples of a new checker
    for motion in motions:
        checker = pp.CollisionChecker(arm, motion.scene, attached=motion.attached)
        allowed = {frozenset(pair.owners) for pair in motion.certificate.excluded}
        names = {name for pair in allowed for name in pair} & {*checker.obstacles_and_links}
        pairs = [tuple(pair) for pair in allowed if pair <= names and len(pair) == 2]
        loose = checker.allowing(*pairs)
        for time in np.linspace(0.0, motion.trajectory.duration, 40)[1:-1]:
            contacts = loose.check(motion.trajectory(time)).contacts
            assert all(contact.distance > -1e-6 for contact in contacts), (motion.name, contacts)


@pytest.mark.slow
def test_without_a_long_change_the_order_may_change_the_tool_more_often(cell, sequence) -> None:
    arm, scene, picks = cell
    mounted = replace(picks, tool_change="mounted", tools={**picks.tools, "cup": _beside(picks.tools["cup"])})
    setup = PickSetup.make(arm, scene, mounted, home=None, rng=0)
    budget = pp.cell.SequenceBudget(options=2, search=500, refinements=0, motion=0)
    found = pp.sequence(setup, [named(picks, name) for name in ("bolt_1", "plate_2")], budget=budget)
    assert found.tool_changes == 0
    assert found.ok, found.left_out
    motion = found.steps[0].verdict.motions[0]
    assert {body.name for body in motion.attached} == {"palm", "finger_1", "finger_2", "tube"}


def _beside(cup: pp.picks.Tool) -> pp.picks.Tool:
    """The cup beside the jaws, at the side of the hand: 60 mm across, turned outwards by a right angle."""
    aside = pp.pose((0.0, 0.03, 0.05), (-np.pi / 2, 0, 0))
    (tube,) = cup.tool
    return replace(cup, tip=aside * cup.tip, tool=(replace(tube, pose=aside * tube.pose),))


def test_a_suggestion_for_a_grasp_is_applied_to_the_pick_of_the_verdict(cell, report) -> None:
    move = pp.picks.ShiftSuggestion(by=(0, 10, 0), frame="bolt_1")
    with pytest.raises(InputError, match="apply it to the pick of the verdict"):
        move.apply(named(cell[2], "bolt_1"))
    pick = named(report.verdicts, "bolt_1").pick
    moved = move.apply(pick).pose.translation - pick.pose.translation
    np.testing.assert_allclose(moved, [0, 0.01, 0], atol=1e-12)


def test_parts_on_a_conveyor_are_taken_with_the_first_grasp_that_succeeds(cell) -> None:
    arm, scene, picks = cell
    belt = pp.picks.Conveyor(speed=0.05, parts=["block_1"], direction=(0, 1, 0))
    jaws = replace(picks.tools["jaws"], payload=())
    block = replace(picks.parts["block"], mass=None)
    pick = replace(named(picks, "block_1"), place=None)
    shared = replace(picks, picks=[pick], tools={"jaws": jaws}, parts={"block": block}, conveyor=belt, tool_change=None)
    setup = PickSetup.make(arm, scene, shared, home=None, rng=0, budget=QUICK)
    (verdict,) = pp.picks.pick_from_belt(setup, [pick]).verdicts
    assert (verdict.ok, verdict.grasp) == (True, "across"), verdict
    (judged,) = pp.validate_picks(arm, scene, shared, budget=QUICK).verdicts
    assert (judged.ok, judged.grasp, len(judged.grasps_failed)) == (True, "across", 1)
    heavy = replace(shared, tools={"jaws": picks.tools["jaws"]})
    (refused,) = pp.validate_picks(arm, scene, heavy, budget=QUICK).verdicts
    assert "torques are not supported" in refused.reason
    two = replace(shared, tools={"jaws": jaws, "cup": replace(picks.tools["cup"], payload=())}, tool_change=5.0)
    with pytest.raises(InputError, match="does not wait for a change of the tools jaws, cup"):
        pp.picks.pick_from_belt(PickSetup.make(arm, scene, two, home=None, rng=0), [pick])


def test_the_page_shows_the_tool_and_the_grasps_of_each_pick_with_its_proof(report, tmp_path) -> None:
    report.save(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert text.count("FREE") >= len(report.verdicts)
    assert "NOT VALIDATED" not in text
    assert "1 other grasps that failed" in text
    assert "along: grip: the open finger" in text
    assert "across" in text


def test_an_object_of_another_size_or_frame_than_its_part_type_is_refused(cell) -> None:
    arm, scene, picks = cell
    pick = named(picks, "block_1")
    for shape, reason in (
        (pp.Box(0.005, 0.003, 0.003), "its extents are 50.0 x 30.0 x 30.0 mm, the part 5.0 x 3.0 x 3.0 mm"),
        (pp.Box(0.03, 0.05, 0.03), "the part 30.0 x 50.0 x 30.0 mm"),
    ):
        part = replace(picks.parts["block"], shape=shape)
        other = replace(picks, picks=[pick], parts={**picks.parts, "block": part})
        (verdict,) = pp.validate_picks(arm, scene, other, budget=QUICK).verdicts
        assert verdict.status is PickStatus.UNREADABLE
        assert "'block_1' of the scene is no block" in verdict.reason
        assert reason in verdict.reason


def test_a_program_is_certified_again_with_the_hand_of_its_grasp(cell) -> None:
    # Two grasps at one pose, of which one opens the hand wider; posts beside the block leave space for the narrow one
    arm, scene, picks = cell
    part, block = picks.parts["block"], named(picks, "block_1")
    wide, narrow = (
        replace(part.grasps[1], name=name, fingers={"opening": opening})
        for name, opening in (("wide", 0.12), ("narrow", 0.04))
    )
    posts = (
        pp.Obstacle(f"post {y}", pp.Box(0.02, 0.02, 0.06), scene["block_1"].pose * pp.pose((0, y, 0.012)))
        for y in (0.058, -0.058)
    )
    barred = scene.add(*posts)

    def setup(around: pp.Scene, *grasps: pp.picks.PartGrasp) -> PickSetup:
        own = replace(picks, picks=[block], parts={**picks.parts, "block": replace(part, grasps=grasps)})
        return PickSetup.make(arm, around, own, home=None, rng=0, budget=QUICK)

    verdict = setup(barred, wide, narrow).judge(0, block)
    assert verdict.grasp == "narrow"
    assert all(proof.free for proof in setup(barred, wide, narrow).recertify(verdict.program(), block))
    program = setup(scene, narrow, wide).judge(0, replace(block, grasp="wide")).program()
    assert all(proof.free for proof in setup(scene, narrow, wide).recertify(program, block))
    assert not all(proof.free for proof in setup(barred, narrow, wide).recertify(program, block))
    with pytest.raises(InputError, match="has no grasp 'wide"):
        setup(scene, narrow).recertify(program, block)
