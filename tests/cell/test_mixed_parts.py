"""Cells with part types and several tools: allocation to the arms that have the tool, and placement of the base."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.errors import InputError

SCENE = """\
obstacles:
  - {name: block_1, box: [0.05, 0.03, 0.03], xyz: [0.45, 0.35, 0.03], rpy: [0, 0, -0.5]}
  - {name: plate_1, box: [0.08, 0.06, 0.006], xyz: [0.45, -0.35, 0.018], rpy: [0, 0, 0.4]}
"""
PICKS = """\
robot: ur5
tcp: tool0
scene: scene.yaml
margin: 0.002
home: {shoulder_pan_joint: 0, shoulder_lift_joint: -2.0, elbow_joint: 2.0, wrist_1_joint: -pi/2, wrist_2_joint: -pi/2,
  wrist_3_joint: 0}
robots:
  left:
    base: {xyz: [0, 0.6, 0]}
    tools:
      jaws:
        tip: {xyz: [0, 0, 0.16]}
        fingers:
          opening: 0.05
          bodies: [{name: finger_1, box: [0.02, 0.01, 0.06], xyz: [0, 0.005, 0.13]},
                   {name: finger_2, box: [0.02, 0.01, 0.06], xyz: [0, -0.005, 0.13]}]
  right:
    base: {xyz: [0, -0.6, 0]}
    tools: {cup: {tip: {xyz: [0, 0, 0.12]}, cup: {radius: 0.012}, tool: [{name: tube, sphere: {radius: 0.01}}]}}
parts:
  block: {box: [0.05, 0.03, 0.03], tool: jaws, grasps: [{xyz: [0, 0, 0], rpy: [pi, 0, 0], spin: [0, pi]}]}
  plate: {box: [0.08, 0.06, 0.006], tool: cup, grasps: [{xyz: [0, 0, 0.003], rpy: [pi, 0, 0], spin: free}]}
picks:
  - {name: block_1, part: block, object: block_1, place: {object_pose: {xyz: [0.3, 0.75, 0.03]}}}
  - {name: plate_1, part: plate, object: plate_1, place: {object_pose: {xyz: [0.3, -0.75, 0.018]}}}
"""
FEW = pp.cell.SequenceBudget(options=1, search=100, refinements=0, motion=0)


def read(folder: Path, text: str = PICKS) -> tuple[pp.Picks, pp.Scene]:
    (folder / "scene.yaml").write_text(SCENE)
    (folder / "picks.yaml").write_text(text)
    picks = pp.read_picks(folder / "picks.yaml")
    assert picks.problems == ()
    return picks, picks.load_scene()


@pytest.mark.slow
def test_each_part_is_allocated_to_the_arm_that_has_its_tool(tmp_path: Path) -> None:
    picks, scene = read(tmp_path)
    result = pp.cell.allocate(picks.load_cell(), scene, picks, budget=FEW)
    assert result.ok, result
    assert {arm: [step.name for step in found] for arm, found in result.sequences.items()} == {
        "left": ["block_1"],
        "right": ["plate_1"],
    }
    attached = {body.name for motion in result.sequences["left"].motions for body in motion.attached}
    assert attached == {"left/finger_1", "left/finger_2", "block_1"}
    assert "unknown part 'block'" in next(each.reason for each in result.alone if each.arm == "right")


def test_a_tool_that_no_robot_has_and_a_change_of_tools_are_refused(tmp_path: Path) -> None:
    with pytest.raises(pp.PinproofError, match="unknown tool 'hook'; valid: "):
        read(tmp_path, PICKS.replace("tool: cup,", "tool: hook,"))
    picks, scene = read(tmp_path)
    left = picks.robots["left"]
    two = replace(left.settings, tools={**left.settings.tools, **picks.robots["right"].settings.tools}, tool_change=5.0)
    changing = replace(picks, robots={**picks.robots, "left": replace(left, settings=two)})
    with pytest.raises(InputError, match="arm 'left' changes the tools jaws, cup"):
        pp.cell.allocate(picks.load_cell(), scene, changing, budget=FEW)


@pytest.mark.slow
def test_a_base_is_placed_for_mixed_parts() -> None:
    picks = pp.read_picks(robots_folder() / "ur5" / "mixed_picks.yaml")
    some = replace(picks, picks=[pick for pick in picks if pick.name in ("block_1", "plate_1")])
    region = pp.cell.PlacementRegion(x=(-0.05, 0.05), y=(0.0, 0.0))
    few = pp.cell.PlacementBudget(grid=3, runs=0, certified=1, deviations=0)
    budget = pp.picks.PickBudget(compared=1, remedies=0, motion=0)
    found = pp.place_base(picks.load_arm(), picks.load_scene(), some, region, placement_budget=few, budget=budget)
    assert found.ok, found
    assert {verdict.tool for verdict in found.best.report.verdicts} == {"jaws", "cup"}


@pytest.mark.slow
@pytest.mark.parametrize(("opening", "stated"), [(0.05, False), (0.04, True)])
def test_a_sequence_states_that_a_change_of_the_opening_is_not_covered(opening: float, stated: bool) -> None:
    picks = pp.read_picks(robots_folder() / "ur5" / "mixed_picks.yaml")
    some = [replace(pick, fingers={"opening": opening}) for pick in picks if pick.name == "bolt_1"]
    some += [pick for pick in picks if pick.name == "block_1"]
    setup = pp.picks.PickSetup.make(picks.load_arm(), picks.load_scene(), picks, home=None, rng=0)
    result = pp.cell.sequence(setup, some, budget=FEW)
    assert len(result.steps) == 2
    assert any("another opening of the hand" in note for note in result.notes) == stated


def test_parts_of_types_stay_in_the_scene() -> None:
    picks = pp.read_picks(robots_folder() / "ur5" / "mixed_picks.yaml")
    with pytest.raises(InputError, match="names a part type"):
        pp.cell.without_parts(picks.load_arm(), picks.load_scene(), picks)
