"""Pages in which grasps and the base are moved, in a real browser with a real mouse, against the stages in Python."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import Scene
from pinproof.description import robots_folder
from pinproof.picks import (
    LivePicks,
    NamedFrame,
    PickBudget,
    PickReport,
    PickSetup,
    PickStatus,
    PickVerdict,
    Stage,
    StageResult,
    root_from_frame,
)
from pinproof.spatial import SE3, matrix, pose

from .test_live_page import PLACE

AT_THE_GRASP = ("reach", "limits", "self-collision", "grasp")
MOVE = """(() => {
  const again = pinproof.again, found = [];
  for (const [row, shift] of %s) {
    pinproof.choose(row);
    again.moveTo(again.matrixOf(shift).multiply(again.poseNow()), true);
    found.push(again.now().verdicts[row].stage);
    document.getElementById("live-undo").click();
  }
  return found;
})()"""
CHOOSE_BASE = (
    """{ const s = document.getElementById("live-thing"); s.value = "base"; s.dispatchEvent(new Event("change")); }"""
)


class Cell:
    """The picks of a file, with what they are judged in."""

    def __init__(self, robot: str, name: str, /, **changes: Any) -> None:
        self.picks = replace(pp.read_picks(robots_folder() / robot / name), **changes)
        self.arm, self.scene = self.picks.load_arm(), self.picks.load_scene()

    def report(self, picks: pp.Picks | None = None, scene: Scene | None = None) -> PickReport:
        budget = PickBudget(compared=1, remedies=0, motion=0)
        return pp.validate_picks(self.arm, scene or self.scene, picks or self.picks, rng=0, budget=budget)

    def placed(self, k: int) -> SE3:
        pick = self.picks.picks[k]
        return root_from_frame(pick.frame, self.picks.frames, self.scene, self.arm) * pick.pose

    def moved(self, k: int, shift: SE3) -> str | None:
        """The stage at the grasp at which a pick fails in Python, if it and its object are moved."""
        pick, scene = self.picks.picks[k], self.scene
        if isinstance(pick.carried, str):
            things = (replace(t, pose=shift * t.pose) if t.name == pick.carried else t for t in scene.obstacles)
            scene = replace(scene, obstacles=tuple(things))
        changed = replace(pick, pose=shift * self.placed(k), frame="", place=None)
        return stage_of(self.report(replace(self.picks, picks=(changed,)), scene).verdicts[0])


def stage_of(verdict: PickVerdict) -> str | None:
    failed = None if verdict.failed is None else verdict.failed.value
    return failed if failed in AT_THE_GRASP else None


def opened(visit, name, *size):
    page = visit(name, *size)
    page.click("#live summary")
    wait_for_frame(page)
    return page


def wait_for_frame(page) -> None:
    page.wait_for("pinproof.again.now().loaded && pinproof.again.now().judged === pinproof.again.now().verdicts.length")


@pytest.fixture(scope="module")
def bolts(pages) -> Cell:
    cell = Cell("ur5", "picks.yaml")
    cell.report().save(pages("bolts"))
    return cell


@pytest.mark.parametrize(("robot", "name"), [("ur5", "picks.yaml"), ("ur5", "carry.yaml")])
def test_moved_grasps_have_the_stages_of_python(visit, pages, robot, name):
    cell, rng = Cell(robot, name), np.random.default_rng(3)
    report = cell.report()
    report.save(pages(name))
    page = opened(visit, name, 800, 600)
    unmoved = [verdict and verdict["stage"] for verdict in page.evaluate("pinproof.again.now().verdicts")]
    known = [k for k, verdict in enumerate(report.verdicts) if verdict.stages[0].ok]
    assert [unmoved[k] for k in known] == [stage_of(report.verdicts[k]) for k in known]
    shifts = []
    for _ in range(12):
        k, size = int(rng.choice(known)), rng.choice([0.02, 0.1, 0.3])
        at = cell.placed(k)
        turned = SE3(pose(rpy=rng.uniform(-0.4, 0.4, 3)).rotation @ at.rotation, at.translation)
        shifts.append((k, pose(xyz=rng.uniform(-size, size, 3)) * turned * at.inverse()))
    found = page.evaluate(MOVE % json.dumps([[k, matrix(shift).ravel().tolist()] for k, shift in shifts]))
    assert found == [cell.moved(k, shift) for k, shift in shifts]
    assert {None, "grasp"} <= set(found)


@pytest.mark.parametrize("frame", ["bolt_1", "on_the_bolt"])
def test_picks_in_the_frame_of_an_object_move_with_it(visit, pages, frame):
    cell = Cell("ur5", "carry.yaml")
    first, other = cell.picks.picks[:2]
    picks = (replace(first, place=None), replace(other, frame=frame, carried="bolt_1"))
    frames = {**cell.picks.frames, "on_the_bolt": NamedFrame(SE3.Identity(), "bolt_1")}
    cell.picks = replace(cell.picks, picks=picks, frames=frames)
    name = f"carried in {frame}"
    cell.report().save(pages(name))
    page = opened(visit, name, 800, 600)
    shift = pose(xyz=(0.6, 0.3, 0.0))  # out of reach
    rows = json.dumps(matrix(shift).ravel().tolist())
    again = "pinproof.again"
    page.evaluate(f"pinproof.choose(0); {again}.moveTo({again}.matrixOf({rows}).multiply({again}.poseNow()), true)")
    wait_for_frame(page)
    things = (replace(t, pose=shift * t.pose) if t.name == "bolt_1" else t for t in cell.scene.obstacles)
    changed = replace(picks[0], pose=shift * cell.placed(0), frame="")
    scene = replace(cell.scene, obstacles=tuple(things))
    verdicts = cell.report(replace(cell.picks, picks=(changed, picks[1])), scene).verdicts
    assert [stage_of(verdict) for verdict in verdicts] == ["reach", "reach"]
    assert [verdict["stage"] for verdict in page.evaluate("pinproof.again.now().verdicts")] == ["reach", "reach"]
    page.click("#live-yaml")
    assert page.evaluate("document.getElementById('live-text').value").count("bolt_1, xyz") == 1


def test_a_moved_base_has_the_stages_of_python_for_all_picks(visit, bolts):
    page = opened(visit, "bolts", 800, 600)
    page.evaluate(CHOOSE_BASE)
    for x, y, yaw in ((0.1, -0.35, 0.0), (-0.1, -0.15, 0.7), (-0.25, 0.2, -2.0)):
        root_from_base = pose(xyz=(x, y, 0.0), rpy=(0.0, 0.0, yaw))
        target = json.dumps(matrix(root_from_base).ravel().tolist())
        page.evaluate(f"pinproof.again.moveTo(pinproof.again.matrixOf({target}), true)")
        wait_for_frame(page)
        back = root_from_base.inverse()
        scene, picks = bolts.scene.transformed(back), bolts.picks.transformed(back)
        expected = [stage_of(verdict) for verdict in bolts.report(picks, scene).verdicts]
        assert [verdict["stage"] for verdict in page.evaluate("pinproof.again.now().verdicts")] == expected
        assert page.text("#live-count").startswith(f"{expected.count(None)} of 7 picks pass the grasp")
        assert [text.startswith("Here: passes") for text in page.texts(".here")] == [s is None for s in expected]
    assert "home" not in page.text("#live-count")
    page.click("#live-command")
    words = page.evaluate("document.getElementById('live-text').value")
    assert words == "pinproof pick picks.yaml --place '-0.25 0.2 0 -2'  # from the base of this page"
    inside_the_bin = "[1, 0, 0, 0.3, 0, 1, 0, -0.1, 0, 0, 1, 0, 0, 0, 0, 1]"
    page.evaluate(f"pinproof.again.moveTo(pinproof.again.matrixOf({inside_the_bin}), true)")
    wait_for_frame(page)
    assert page.text("#live-count").endswith("The home configuration is in contact.")


def test_the_base_is_dragged_on_the_floor_in_steps(visit, bolts):
    page = opened(visit, "bolts", 1000, 700)
    page.evaluate(CHOOSE_BASE)
    page.evaluate("document.getElementById('snap-positions').value = '10'")
    for _ in range(5):  # a press that comes while the page is laid out again turns the camera instead
        start = page.evaluate(PLACE % (0.0, 0.0, 0.0))
        page.drag(start, (start[0] - 50, start[1] + 20))
        if page.evaluate("pinproof.again.now().showing"):
            break
    x, y, z = page.evaluate("pinproof.again.now().base")[3::4][:3]
    assert np.hypot(x, y) > 0.03
    assert z == 0.0
    assert np.allclose(100 * np.array([x, y]) % 1, 0.0, atol=1e-9) or np.allclose(np.round([x, y], 2), [x, y])
    page.wait_for(f"Math.abs(pinproof.viewer.scene_tree.find(['robot', 'base_link']).object.position.x - {x}) < 1e-9")
    # What was proven is not shown as the verdict on the changed cell, until the motion is played
    assert "No motion is proven" in page.text("#live-state")
    assert page.evaluate("document.getElementById('caption').hidden")
    page.click("#play")
    page.wait_for("!pinproof.again.now().showing")
    assert page.text("#live-state").startswith("Proven: the motions")
    assert not page.evaluate("document.getElementById('caption').hidden")


def test_links_that_touch_only_as_convex_hulls_are_checked_with_their_meshes(visit, bolts):
    target = pose(xyz=(-0.07747741, 0.07348915, 0.28067897), rpy=(-0.97401345, -0.1525376, -0.60117802))
    page = opened(visit, "bolts", 800, 600)
    page.evaluate("pinproof.choose(6)")
    rows = json.dumps(matrix(target).ravel().tolist())
    page.evaluate(f"pinproof.again.moveTo(pinproof.again.matrixOf({rows}), true)")
    assert bolts.moved(6, target * bolts.placed(6).inverse()) is None
    assert page.evaluate("pinproof.again.now().verdicts[6].stage") is None
    assert page.text("#live-pair") == "Convex hulls of meshes touch, the meshes do not."


def test_the_grasp_is_dragged_by_the_mouse(visit, bolts):
    page = opened(visit, "bolts", 1000, 700)
    page.evaluate("pinproof.choose(0)")
    before = bolts.placed(0)
    for _ in range(5):  # a press that comes while the page is laid out again turns the camera instead
        start = page.evaluate(PLACE % tuple(before.translation))
        page.drag(start, (start[0] + 40, start[1] - 30))
        if page.evaluate("pinproof.again.now().showing"):
            break
    after = np.array(page.evaluate("pinproof.again.poseNow().clone().transpose().toArray()")).reshape(4, 4)
    shift = SE3(after) * before.inverse()
    assert np.linalg.norm(shift.translation) > 0.02
    assert np.allclose(shift.rotation, np.eye(3), atol=1e-6)
    assert page.evaluate("pinproof.again.now().verdicts[0].stage") == bolts.moved(0, shift)


@pytest.mark.parametrize(("robot", "name"), [("panda", "bin_picks.yaml"), ("ur5", "mixed_picks.yaml")])
def test_the_hand_of_each_pick_may_touch_the_part_that_it_grasps(visit, pages, robot, name):
    """Also an arm of seven joints, of which the page knows solutions at some values of one joint."""
    picks = pp.read_picks(robots_folder() / robot / name)
    arm, scene = picks.load_arm(), picks.load_scene()
    setup = PickSetup.make(arm, scene, picks, home=None, rng=0)
    reach = StageResult(Stage.REACH, False, "not judged")
    verdicts = tuple(PickVerdict(pick, PickStatus.NOT_FOUND, (reach,), 0) for pick in picks.picks)
    PickReport(robot, verdicts, (), "none", (), setup).save(pages(name))
    page = opened(visit, name, 800, 600)
    found = [verdict["stage"] is None for verdict in page.evaluate("pinproof.again.now().verdicts")]
    expected = pp.screen_picks(arm, scene, picks).free.tolist()
    assert found == expected
    assert expected.count(True) > 4


def test_the_object_moves_with_its_grasp_and_both_are_copied(visit, pages):
    cell = Cell("ur5", "carry.yaml")
    cell.report().save(pages("carry"))
    page = opened(visit, "carry", 1000, 700)
    k = next(
        k for k, pick in enumerate(cell.picks.picks) if isinstance(pick.carried, str) and pick.carried in cell.scene
    )
    pick = cell.picks.picks[k]
    page.evaluate(f"pinproof.choose({k})")
    enter = "{ const e = document.querySelectorAll('#live .place input')[0]; e.value = Number(e.value) + 40;"
    page.evaluate(enter + " e.dispatchEvent(new Event('change')); }")
    wait_for_frame(page)
    x = cell.scene[pick.carried].pose.translation[0] + 0.04
    drawn = f"pinproof.viewer.scene_tree.find(['scene', {json.dumps(pick.carried)}]).object.position.x"
    page.wait_for(f"Math.abs({drawn} - {x}) < 1e-4")
    assert f"{pick.carried} moves with the grasp" in page.text("#live-scope")
    assert "approach, retreat, transit" in page.text("#live-scope")
    page.click("#live-yaml")
    entry, thing = page.evaluate("document.getElementById('live-text').value").splitlines()
    assert entry.startswith(f"- {{name: {pick.name}, ")
    assert thing.startswith(f"- {{name: {pick.carried}, xyz: [{x:.6g}")


def test_pages_of_sequences_move_the_base_and_pages_without_are_smaller(visit, pages, bolts):
    chosen = tuple(pick for pick in bolts.picks.picks if pick.name in ("bolt_1", "bolt_5"))
    setup = PickSetup.make(bolts.arm, bolts.scene, bolts.picks, home=None, rng=0)
    sequence = pp.cell.sequence(setup, chosen)
    sequence.save(pages("sequence"))
    sequence.save(pages("still"), live=False)
    grown = pages("sequence").stat().st_size - pages("still").stat().st_size
    assert 1e5 < grown < 1e6
    assert "wasm-unsafe-eval" not in pages("still").read_text(encoding="utf-8")
    page = opened(visit, "sequence", 1000, 700)
    assert "the scene at the start of the sequence" in page.text("#live-scope")
    page.evaluate(CHOOSE_BASE)
    page.evaluate("pinproof.again.moveTo(pinproof.again.matrixOf([1,0,0,0.2,0,1,0,-0.1,0,0,1,0,0,0,0,1]), true)")
    wait_for_frame(page)
    assert page.text("#live-count").startswith("2 of 2 picks pass the grasp")
    page.click("#live-command")
    words = page.evaluate("document.getElementById('live-text').value")
    assert words == "pinproof cell sequence picks.yaml --place '0.2 -0.1 0 0'  # from the base of this page"


def judged_for_a_page(setup: PickSetup, index: int, pick: pp.Pick) -> dict[str, object]:
    return {"name": pick.name, "verdict": "good", "failed_at": None}


def test_pages_of_campaigns_judge_their_rows_again(visit, pages, bolts, tmp_path):
    campaign = pp.Campaign(bolts.arm, bolts.scene, bolts.picks, judge=judged_for_a_page)
    campaign.write_page(campaign.run(tmp_path), pages("campaign"))
    page = opened(visit, "campaign", 900, 600)
    expected = [stage_of(verdict) for verdict in bolts.report().verdicts]
    assert [verdict["stage"] for verdict in page.evaluate("pinproof.again.now().verdicts")] == expected


def test_picks_on_a_conveyor_are_not_judged_again():
    picks = pp.read_picks(robots_folder() / "ur5" / "conveyor_picks.yaml")
    setup = PickSetup.make(picks.load_arm(), picks.load_scene(), picks, home=None, rng=0)
    assert LivePicks.of([(setup, pick) for pick in picks.picks], (), None).texts is None
    with pytest.raises(pp.InputError, match="conveyor"):
        LivePicks.of([(setup, pick) for pick in picks.picks], (), True)


def test_pages_of_two_arms_judge_each_pick_with_its_arm(visit, pages):
    picks = pp.read_picks(robots_folder() / "two_ur5" / "picks.yaml")
    chosen = tuple(pick for pick in picks.picks if pick.name in ("part_3_2", "part_4_2"))
    allocated = pp.cell.allocate(
        picks.load_cell(), picks.load_scene(), replace(picks, picks=chosen), compare=False, rng=0
    )
    allocated.save(pages("allocated"))
    page = opened(visit, "allocated", 1000, 700)
    assert page.evaluate("[...document.getElementById('live-thing').options].map((one) => one.value)") == ["grasp"]
    rows = page.evaluate("pinproof.settings.livePicks.rows")
    setups = {step.pick.name: one.setup for one in allocated.sequences.values() for step in one.steps}
    assert len({id(setup) for setup in setups.values()}) == 2
    rng, found, expected = np.random.default_rng(5), [], []
    for k, row in [*enumerate(rows)] * 5:
        setup, pick = setups[row["name"]], next(pick for pick in chosen if pick.name == row["name"])
        grasp = SE3(np.reshape(row["grasps"][0]["pose"], (4, 4)))
        shift = pose(xyz=rng.uniform(-0.4, 0.4, 3)) if len(found) > 1 else SE3.Identity()
        page.evaluate(f"document.querySelectorAll('#rows tr')[{k}].click()")
        rows_of_pose = json.dumps(matrix(shift * grasp).ravel().tolist())
        page.evaluate(f"pinproof.again.moveTo(pinproof.again.matrixOf({rows_of_pose}), true)")
        found.append(page.evaluate(f"pinproof.again.now().verdicts[{k}].stage"))
        page.click("#live-undo")
        changed = replace(pick, pose=shift * grasp, frame="", place=None)
        things = [
            replace(t, pose=shift * t.pose) if t.name == row["object"] else t for t in setup.checker.scene.obstacles
        ]
        budget = PickBudget(compared=1, remedies=0, motion=0)
        scene, shared = replace(setup.checker.scene, obstacles=tuple(things)), replace(setup.shared, picks=(changed,))
        report = pp.validate_picks(setup.checker.arm, scene, shared, home=setup.home, rng=0, budget=budget)
        expected.append(stage_of(report.verdicts[0]))
    assert found == expected
    assert {None, "grasp"} <= set(found)
    assert "with the other arms at home" in page.text("#live-scope")


def test_an_arm_on_a_rail_that_is_too_short_fails_at_its_limits_as_in_python(visit, pages, tmp_path, bolts):
    """The joint at whose values the closed form is evaluated is the one that is outside its limits."""
    rail = """<link name="rail"/><joint name="along" type="prismatic"><parent link="rail"/><child link="base_link"/>
    <axis xyz="0 1 0"/><limit lower="-0.3" upper="0.3" velocity="1" effort="100"/></joint>"""
    text = (robots_folder() / "ur5" / "ur5.urdf").read_text(encoding="utf-8")
    (tmp_path / "rail.urdf").write_text(text.replace("</robot>", rail + "</robot>"), encoding="utf-8")
    home = dict(zip(bolts.arm.joint_names, bolts.arm.home.tolist(), strict=True))
    cell = Cell("ur5", "picks.yaml", robot=str(tmp_path / "rail.urdf"), home={"along": 0.0, **home})
    cell.report().save(pages("rail"))
    page = opened(visit, "rail", 800, 600)
    page.evaluate(CHOOSE_BASE)
    root_from_base = pose(xyz=(0.2, 1.1, 0.0), rpy=(0.0, 0.0, 0.5))
    target = json.dumps(matrix(root_from_base).ravel().tolist())
    page.evaluate(f"pinproof.again.moveTo(pinproof.again.matrixOf({target}), true)")
    wait_for_frame(page)
    back = root_from_base.inverse()
    verdicts = cell.report(cell.picks.transformed(back), cell.scene.transformed(back)).verdicts
    expected = [stage_of(verdict) for verdict in verdicts]
    assert [verdict["stage"] for verdict in page.evaluate("pinproof.again.now().verdicts")] == expected
    assert {None, "limits", "grasp"} <= set(expected)
