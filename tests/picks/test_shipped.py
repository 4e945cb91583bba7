"""The cells of the package: each pick has the expected verdict, and good ones pass an independent check."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.motion import JointPath
from pinproof.picks import PickBudget, PickStatus, Stage

from .conftest import cell_of, named, recheck

GOOD = (PickStatus.GOOD, None, "")
IMPOSSIBLE, NOT_FOUND = PickStatus.IMPOSSIBLE, PickStatus.NOT_FOUND

PLAIN = {
    "ur5": {"bolt_3": Stage.GRASP, "bolt_4": Stage.GRASP, "bolt_6": Stage.REACH},
    "generic_6dof": {"pin_3": Stage.GRASP, "pin_4": Stage.REACH},
    "panda": {"cube_5": Stage.REACH},
}
"""The picks without objects that fail."""

CARRY, PLATE, BIN, MACHINE = "ur5/carry", "ur5/plate_picks", "panda/bin_picks", "generic_6dof/machine_picks"
EXPECTED = {
    CARRY: {
        "over_the_wall": GOOD,
        "any_turn": GOOD,
        "dragged": (IMPOSSIBLE, Stage.RETREAT, "bolt_1 is not proven to leave table"),
        "too_high": (IMPOSSIBLE, Stage.APPROACH, "900 mm path, planned outwards from the grasp, stops at "),
        "in_the_corner": (NOT_FOUND, Stage.GRASP, "picker penetrates bin_"),
        "too_far": (IMPOSSIBLE, Stage.PLACE, "release is out of reach"),
        "missing": (PickStatus.UNREADABLE, Stage.INPUT, "unknown object 'bolt_9'"),
    },
    PLATE: {
        **{f"bolts[{i},{j}]": GOOD for i in range(4) for j in range(3)},
        "bolts[0,2]": (NOT_FOUND, Stage.GRASP, "picker penetrates clamp_jaw"),
        "unturned": (IMPOSSIBLE, Stage.GRASP, "camera penetrates stop"),
        "moved": GOOD,
    },
    BIN: {
        "standing": GOOD,
        "lying": GOOD,
        "round": GOOD,
        "leaning": GOOD,
        "on_the_wall": (NOT_FOUND, Stage.RETREAT, "on_the_wall is near bin_far (0.2 mm apart)"),
        "cornered": (IMPOSSIBLE, Stage.GRASP, "panda_hand penetrates bin_far"),
        "fallen": (IMPOSSIBLE, Stage.GRASP, "panda_hand penetrates guard"),
        "far_off": (IMPOSSIBLE, Stage.REACH, "out of reach"),
        "onto_the_crate": (IMPOSSIBLE, Stage.PLACE, "penetrates crate"),
    },
    MACHINE: {
        "unload": GOOD,
        **{f"blank[{i},0]": GOOD for i in range(3)},
        "sideways": (IMPOSSIBLE, Stage.RETREAT, "turned is not proven to leave chuck"),
        "from_afar": (IMPOSSIBLE, Stage.APPROACH, "1200 mm path, planned outwards from the grasp, stops at "),
        "shadowed": (IMPOSSIBLE, Stage.GRASP, "tube penetrates post_right"),
        "remote": (IMPOSSIBLE, Stage.REACH, "out of reach"),
        "near_by": (IMPOSSIBLE, Stage.LIMITS, "joint_3"),
        "gauged": (NOT_FOUND, Stage.TRANSIT, "no path within"),
        "onto_a_blank": (NOT_FOUND, Stage.PLACE, "turned penetrates blank_1"),
    },
}


# -- picks without objects --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLAIN)
def test_each_pick_fails_at_the_expected_stage_and_good_ones_pass_an_independent_check(
    reports, arms, cells, name: str
) -> None:
    report = reports[name]
    assert {v.pick.name: v.failed for v in report.verdicts if not v.ok} == PLAIN[name]
    assert len(report.good) == len(report.verdicts) - len(PLAIN[name]) >= 2
    assert not report.ok
    for verdict in report.good:
        recheck(verdict, arms[name], *cells[name])


def test_a_failure_names_the_bodies_in_collision(reports) -> None:
    reasons = {verdict.pick.name: verdict.reason for verdict in reports["ur5"].verdicts}
    assert "picker penetrates bin_far" in reasons["bolt_3"]
    assert "picker penetrates bin_right" in reasons["bolt_4"]
    assert "picker penetrates bin_near" in reasons["bolt_4"]
    assert re.match(r"out of reach: .* [1-9][\d.]* mm", reasons["bolt_6"])


def test_the_same_seed_gives_the_same_bytes(arms, cells, reports) -> None:
    again = pp.validate_picks(arms["ur5"], *cells["ur5"], rng=0)
    assert again.to_dict() == reports["ur5"].to_dict()
    for one, other in zip(again.good, reports["ur5"].good, strict=True):
        assert one.trajectory.q.tobytes() == other.trajectory.q.tobytes()
        assert one.trajectory.times.tobytes() == other.trajectory.times.tobytes()
        assert one.certificate.curve == other.certificate.curve
    arm, (scene, picks), expected = arms["generic_6dof"], cells["generic_6dof"], reports["generic_6dof"]
    assert pp.validate_picks(arm, scene, picks, rng=np.random.default_rng(0)).to_dict() == expected.to_dict()
    for rng in (-1, 0.5, "seed"):
        with pytest.raises(pp.InputError, match="rng must be"):
            pp.validate_picks(arm, scene, picks, rng=rng)
    # A verdict does not depend on other picks
    alone = pp.Picks(picks.picks[:1], tip=picks.tip, margin=picks.margin)
    (verdict,) = pp.validate_picks(arm, scene, alone).verdicts
    assert verdict.certificate.curve == expected.verdicts[0].certificate.curve


def test_the_report_as_values(reports) -> None:
    report = reports["ur5"]
    data = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert (data["summary"], data["ok"]) == ("4 of 7 picks good; failed: 2 at grasp, 1 at reach", False)
    assert data["notes"] == list(report.notes)
    assert any("empty gripper" in note for note in data["notes"])
    good, bad = data["picks"][0], data["picks"][2]
    assert [stage["stage"] for stage in good["stages"]] == [
        stage.value
        for stage in Stage
        if stage not in (Stage.CHECK, Stage.HOLD)  # no check of a program and no mass were given
    ]
    assert good["clearance_proven"] == report.verdicts[0].certificate.clearance
    assert good["pairs_proven"] == report.verdicts[0].certificate.pairs > 100
    assert ["base_link", "table", "allowed by the scene"] in good["excluded_pairs"]
    assert 0 < good["grasp_time"] < good["duration"]
    assert (bad["verdict"], bad["failed_at"], bad["q_grasp"], bad["clearance_proven"]) == (
        "impossible", "grasp", None, None,
    )  # fmt: skip
    assert [stage["ok"] for stage in bad["stages"]] == [True, True, True, True, False]
    with pytest.raises(ValueError, match="read-only"):
        report.good[0].q_grasp[0] = 0.0


def test_a_report_is_saved_in_the_format_of_its_suffix(reports, tmp_path) -> None:
    report = reports["ur5"]
    text = report.to_markdown()
    rows = [line for line in text.splitlines() if line.startswith("| bolt_")]
    assert [row.count("|") for row in rows] == [8] * 7
    assert "no acceleration limit is known" in text
    assert all(f"- {note}" in text for note in report.notes)
    report.save(tmp_path / "a.json")
    report.save(tmp_path / "a.MD")
    assert json.loads((tmp_path / "a.json").read_text()) == report.to_dict()
    assert (tmp_path / "a.MD").read_text() == text
    with pytest.raises(pp.InputError, match=r"\.json, \.md, \.csv"):
        report.save(tmp_path / "a.txt")
    with pytest.raises(pp.errors.FileError, match="cannot be written"):
        report.save(tmp_path / "no" / "a.json")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.MD", "a.json"]


# -- picks with objects -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Example:
    arm: pp.Arm
    scene: pp.Scene
    picks: pp.Picks
    report: pp.picks.PickReport

    def judge(self, pick: pp.Pick, remedies: int = 0) -> pp.picks.PickVerdict:
        picks = replace(self.picks, picks=(pick,))
        return pp.validate_picks(self.arm, self.scene, picks, budget=PickBudget(remedies=remedies)).verdicts[0]


@pytest.fixture(scope="module")
def examples() -> Callable[[str], Example]:
    found: dict[str, Example] = {}

    def example(name: str) -> Example:
        if name not in found:
            cell = cell_of(*f"{name}.yaml".split("/"))
            assert cell[2].problems == ()
            # The bolts of the plate are alike: the paths of their transits need not be optimised
            budget = PickBudget(remedies=1, motion=0) if name == PLATE else PickBudget(remedies=1)
            found[name] = Example(*cell, pp.validate_picks(*cell, budget=budget))
        return found[name]

    return example


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPECTED)
def test_each_pick_with_an_object_has_the_expected_verdict(examples, name: str) -> None:
    expected, example = EXPECTED[name], examples(name)
    report = example.report
    assert {v.pick.name: (v.status, v.failed) for v in report.verdicts} == {k: e[:2] for k, e in expected.items()}
    reasons = {v.pick.name: v.reason for v in report.verdicts if not v.ok}
    assert {k: expected[k][2] for k, why in reasons.items() if expected[k][2] not in why} == {}
    # Impossible picks are refuted for every branch
    assert all(bool(verdict.refuted) == (verdict.status is IMPOSSIBLE) for verdict in report.verdicts)
    # Good ones are free in dense samples, with a new checker for the scene and the held part of each motion
    hand = {*(thing.name for thing in example.picks.open_tool), "panda_leftfinger", "panda_rightfinger"}
    for verdict in report.good:
        assert verdict.certificate is None
        assert verdict.motions[0].scene is example.scene
        q = verdict.motions[0].trajectory.start
        for motion in verdict.motions:
            arm, proof = example.arm.with_held(motion.held), motion.certificate
            assert proof.free
            assert proof.matches(motion.trajectory, arm, motion.scene, motion.attached)
            assert proof.clearance > example.picks.margin
            np.testing.assert_allclose(motion.trajectory.start, q, atol=1e-12)
            q = motion.trajectory.end
            meant = {frozenset((verdict.pick.carried, each)) for each in hand}
            meant |= {frozenset(parting.bodies) for parting in proof.partings}
            checker = pp.CollisionChecker(arm, motion.scene, attached=motion.attached)
            for at in motion.trajectory(np.linspace(0.0, motion.trajectory.duration, 40)):
                assert {frozenset(contact.bodies) for contact in checker.check(at).contacts} <= meant


@pytest.mark.slow
def test_a_carried_pick_has_its_motions_in_order(examples) -> None:
    report = examples(CARRY).report
    verdict, row = report.verdicts[0], report.to_dict()["picks"][0]
    names = [motion.name for motion in verdict.motions]
    assert names == ["transit", "approach", "retreat", "transfer", "place", "leave"]
    touching = {motion["name"]: motion["backwards"] for motion in row["motions"] if motion["partings"]}
    assert touching == {"retreat": False, "place": True}  # leaves what it stands on; comes to stand
    assert 0 < row["grasp_time"] < verdict.release_time < row["duration"]
    assert row["clearance_proven"] == verdict.clearance
    # The robot's own fingers close on the part and open again
    held = [each.held["panda_finger_joint1"] for each in named(examples(BIN).report.verdicts, "round").motions]
    assert held == [0.04, 0.04, 0.02, 0.02, 0.02, 0.04]


@pytest.mark.slow
def test_an_approach_too_long_reports_the_longest_that_works(examples) -> None:
    example = examples(CARRY)
    verdict = named(example.report.verdicts, "too_high")
    assert re.search(r"stops at \d+ % of the line: [\d.]+ mm and [\d.]+ rad short", verdict.reason)
    assert verdict.refuted == ("no IK solution within the limits reaches the end of the approach",)
    assert verdict.remedy.startswith("shorten the approach from 900 mm to ")
    assert example.report.to_dict()["picks"][3]["remedy"] == verdict.remedy
    length = verdict.suggestions[0].apply(verdict.pick).approach
    assert example.judge(replace(verdict.pick, approach=length)).failed is None
    assert example.judge(replace(verdict.pick, approach=length + 0.02)).failed is Stage.APPROACH


@pytest.mark.slow
def test_a_retreat_that_drags_the_part_names_the_support_and_a_free_direction(examples) -> None:
    verdict = named(examples(CARRY).report.verdicts, "dragged")
    assert len(verdict.refuted) == 8
    dragged = r"at the end of the retreat: .*bolt_1 (penetrates|is [\d.]+ mm from) table"
    assert all(re.match(dragged, text) for text in verdict.refuted)
    assert verdict.remedy.startswith("retreat straight up, along +z (base frame)")
    assert examples(CARRY).judge(verdict.suggestions[0].apply(verdict.pick)).ok


@pytest.mark.slow
def test_a_place_out_of_reach_reports_the_residual_and_a_reachable_shift(examples) -> None:
    far = named(examples(CARRY).report.verdicts, "too_far").pick
    verdict = examples(CARRY).judge(far, remedies=12)
    short = float(re.search(r"found is ([\d.]+) mm", verdict.reason)[1])
    there = next(each for each in verdict.suggestions if each.text.startswith("move the place")).apply(far)
    assert 200 < short < 1e3 * np.linalg.norm(there.place.pose.translation - far.place.pose.translation) < 2 * short
    assert examples(CARRY).judge(there).ok


@pytest.mark.slow
def test_the_guard_blocks_the_straight_path_from_tray_to_bin(examples) -> None:
    example = examples(BIN)
    checker = pp.CollisionChecker(example.arm, example.scene)
    for verdict in example.report.good:
        transit = verdict.motions[0].trajectory
        straight = pp.certify(JointPath([transit.start, transit.end], example.arm.joint_names), checker)
        assert straight.status is pp.CertificateStatus.COLLIDING
        assert "guard" in straight.first_contact.bodies
        over = [example.arm.forward_kinematics(q).translation for q in transit(np.linspace(0, transit.duration, 300))]
        crossing = next(at for at in over if at[0] > 0.35)
        assert crossing[2] > 0.30 or abs(crossing[1]) > 0.45


@pytest.mark.slow
def test_the_long_tool_goes_in_and_out_through_the_door_straight(examples) -> None:
    example = examples(MACHINE)
    tips = {}
    for motion in named(example.report.verdicts, "unload").motions:
        q = motion.trajectory(np.linspace(0.0, motion.trajectory.duration, 50))
        placed = [example.arm.root_from_base * example.arm.forward_kinematics(each) * example.picks.tip for each in q]
        tips[motion.name] = np.array([at.translation for at in placed])
    for name in ("approach", "retreat"):
        np.testing.assert_allclose(tips[name][:, 1:], [[-0.20, 0.50]] * 50, atol=1.01e-3)  # along the spindle
        assert example.picks.straight * 0.2 - 1e-3 <= np.ptp(tips[name][:, 0]) <= 0.2 + 1e-3
    assert tips["retreat"][0, 0] == pytest.approx(1.075, abs=1e-5)
    assert tips["place"][-1] == pytest.approx([0.14, 0.33, 0.12], abs=1e-5)
    assert max(np.linalg.norm(thing.pose.translation) for thing in example.picks.tool) < 0.5


@pytest.mark.slow
def test_picks_of_the_plate_are_good_with_a_rotated_camera(examples) -> None:
    verdicts = examples(PLATE).report.verdicts
    assert named(verdicts, "bolts[3,1]").member.startswith("spun by ")
    assert "mm along the tip's" in named(verdicts, "moved").member
    judged = examples(PLATE).judge(named(verdicts, "unturned").pick, remedies=PickBudget().remedies)
    assert any(each.text.startswith("turn the pick by ") for each in judged.suggestions)
