"""No body of the hand is deeper in the part than allowed: at the grasp, on the lines, and on a belt."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.picks import PickSetup, PickStatus, Stage, SuctionCup
from pinproof.picks.judging.configurations import configurations
from pinproof.picks.judging.grasp import GraspCandidate, reach, screen
from pinproof.picks.judging.hand import FACE, BodyDepth
from pinproof.picks.judging.lines import line_in
from pinproof.picks.judging.task import PickTask
from pinproof.planning import plan_linear
from pinproof.spatial import SE3

from . import depth_oracle as oracle
from .conftest import cell_of, figures, judge_in


@pytest.fixture(scope="module")
def arm(arms) -> pp.Arm:
    return arms["ur5"]


STILL = pp.picks.PickBudget(compared=1, remedies=0, motion=0)


def depth_of(verdict: pp.picks.PickVerdict) -> float:
    return verdict.stages[-1].figures["depth"]


# -- random grasps ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("tool", ["fingers", "cup", "rod"])
def test_no_random_grasp_with_a_body_too_deep_in_the_part_is_good(arm, tool: str) -> None:
    good, kinds = [], Counter()
    for grasp in oracle.random_grasps(tool, True, 9, seed=1):
        verdict = grasp.judge(arm)
        kinds[grasp.kind] += 1
        if verdict.ok:
            good.append((grasp.kind, grasp.settings))
        elif verdict.failed is Stage.GRIP and "depth" in verdict.stages[-1].figures:
            rng = np.random.default_rng(0)
            assert depth_of(verdict) >= oracle.deepest(grasp.hands, grasp.mesh, grasp.tcp_from_part, rng) - 1e-4
    assert good == []
    assert len(kinds) >= 4


@pytest.mark.slow
@pytest.mark.parametrize("tool", ["fingers", "cup", "rod"])
def test_random_grasps_within_the_depth_are_good(arm, tool: str) -> None:
    refused = [
        (grasp.kind, verdict.failed, verdict.reason)
        for grasp in oracle.random_grasps(tool, False, 9, seed=2)
        if not (verdict := grasp.judge(arm)).ok
    ]
    assert refused == []


# -- at the grasp -----------------------------------------------------------------------------------------------------


BOX, BLOCK = pp.Box(0.04, 0.03, 0.12), oracle.box(0.04, 0.03, 0.12)
PLATE = oracle.box(0.05, 0.05, 0.02)


def fingers_on(palm: float, shape: pp.Shape = BOX, top: float = 0.06, gap: float = 0.01):
    """Pads whose tips are 80 mm below the top of a part of 30 mm, and a palm of 30 x 30 x 20 mm at a height."""
    at = {"finger_1": 0.004, "finger_2": -0.004}
    pads = (pp.Obstacle(k, pp.Box(0.016, 0.008, 0.1), pp.pose((0, y, oracle.TIP - 0.05))) for k, y in at.items())
    hand = pp.picks.GripperFingers(tuple(pads), opening=0.03 + gap, grip=0.03)
    at = SE3(oracle.DOWN, np.array([0, 0, oracle.TIP - 0.08 + top]))
    tool = (pp.Obstacle("palm", pp.Box(0.03, 0.03, 0.02), pp.pose((0, 0, palm))),)
    return oracle.Grasp("", shape, BLOCK, at, [], {"fingers": hand, "tool": tool})


@pytest.mark.parametrize("as_mesh", [False, True])
@pytest.mark.parametrize(
    ("inside", "ok"), [(-0.002, True), (0.0, True), (0.0009, True), (0.0011, False), (0.07, False)]
)
def test_a_palm_between_correct_fingers_is_in_the_part_by_at_most_the_limit(arm, inside, ok, as_mesh) -> None:
    shape = oracle.shape_of(BLOCK) if as_mesh else BOX
    verdict = fingers_on(oracle.TIP - 0.08 - 0.01 + inside, shape).judge(arm)
    assert verdict.ok is ok, verdict.reason
    if ok:
        assert verdict.grip.depth == pytest.approx(max(inside, 0.0), abs=3e-5)
    else:
        assert verdict.failed is Stage.GRIP
        assert verdict.reason.startswith("palm is ")
        assert depth_of(verdict) == pytest.approx(min(inside, 0.03), abs=3e-5)  # or 30 mm to a side
        assert verdict.status is (PickStatus.NOT_FOUND if as_mesh else PickStatus.IMPOSSIBLE)


def test_the_limit_of_the_depth_is_that_of_the_file(arm) -> None:
    grasp = fingers_on(oracle.TIP - 0.087)
    for depth, ok in ((None, False), (0.0031, True), (0.0029, False)):
        grasp.settings["grip_limits"] = pp.picks.GripLimits() if depth is None else pp.picks.GripLimits(depth=depth)
        assert grasp.judge(arm).failed is (None if ok else Stage.GRIP)
    # A limit of zero allows contact
    cup = on_cup(pp.Box(0.05, 0.05, 0.02), PLATE, 0.01, SuctionCup(radius=0.01))
    for each in (fingers_on(oracle.TIP - 0.09), cup):
        each.settings["grip_limits"] = pp.picks.GripLimits(depth=0.0)
        assert each.judge(arm).ok


def on_cup(shape: pp.Shape, mesh: trimesh.Trimesh, top: float, cup: SuctionCup, *more, press: float = 0.0):
    """A cup of 20 mm on a lance, pressed onto the surface at the height ``top`` of a part."""
    tool = (
        pp.Obstacle("bellows", pp.Cylinder(cup.radius, 0.03), pp.pose((0, 0, oracle.TIP - 0.015))),
        pp.Obstacle("lance", pp.Cylinder(0.005, 0.13), pp.pose((0, 0, 0.065))),
        *more,
    )
    at = SE3(oracle.DOWN, np.array([0, 0, oracle.TIP + top - press]))
    return oracle.Grasp("", shape, mesh, at, [], {"cup": cup, "tool": tool})


@pytest.mark.parametrize(("height", "rise", "ok"), [(0.025, None, False), (0.0009, None, True), (0.0012, None, False)])
@pytest.mark.parametrize("radius", [0.0004, 0.003])
def test_a_pin_may_protrude_into_a_cup_by_at_most_its_gap(arm, height, rise, ok, radius) -> None:
    mesh = oracle.union(
        oracle.box(0.05, 0.05, 0.02), oracle.cylinder(radius, height + 0.005, (0.003, 0, 0.0075 + height / 2), 12)
    )
    verdict = on_cup(oracle.shape_of(mesh), mesh, 0.01, SuctionCup(radius=0.01, rise=rise)).judge(arm)
    assert verdict.ok is ok, verdict.reason
    if not ok:
        assert verdict.failed is Stage.GRIP
        assert depth_of(verdict) == pytest.approx(height, abs=3e-5)


@pytest.mark.parametrize(("rise", "ok"), [(0.009, True), (0.007, False)])
def test_the_stated_rise_of_a_cup_holds_for_its_body_too(arm, rise: float, ok: bool) -> None:
    mesh = oracle.union(oracle.box(0.05, 0.05, 0.02), oracle.cylinder(0.003, 0.013, (0.0, 0, 0.0115)))
    grasp = on_cup(oracle.shape_of(mesh), mesh, 0.01, SuctionCup(radius=0.01, rise=rise))
    assert grasp.judge(arm).ok is ok
    wide = pp.Obstacle("flange", pp.Cylinder(0.02, 0.005), pp.pose((0, 0, oracle.TIP - 0.0025)))
    grasp.settings["tool"] = (*grasp.settings["tool"], wide)
    assert grasp.judge(arm).failed is Stage.GRIP  # its depth is that of any body


def test_bellows_are_pressed_in_by_their_gap_and_a_flange_is_not(arm) -> None:
    def pressed(*more: pp.Obstacle) -> pp.picks.PickVerdict:
        cup = SuctionCup(radius=0.01, gap=0.004)
        return on_cup(pp.Box(0.05, 0.05, 0.02), PLATE, 0.01, cup, *more, press=0.003).judge(arm)

    assert pressed().ok
    flange = pp.Obstacle("flange", pp.Cylinder(0.02, 0.005), pp.pose((0, 0, oracle.TIP - 0.0025)))
    verdict = pressed(flange)
    assert verdict.failed is Stage.GRIP
    assert depth_of(verdict) == pytest.approx(0.003, abs=2e-5)
    assert pressed(replace(flange, pose=pp.pose((0, 0, oracle.TIP - 0.006)))).ok


@pytest.mark.parametrize(("mount", "ok"), [(0.013, True), (0.0205, False)])
def test_a_hand_that_cuts_into_a_collar_around_the_cup_is_found(arm, mount: float, ok: bool) -> None:
    """The collar is 45 mm high and its inner radius 14 mm; the hand goes 40 mm down in it."""
    block = oracle.cylinder(0.03, 0.065, (0, 0, 0.0225))
    mesh = oracle.without(block, oracle.cylinder(0.014, 0.046, (0, 0, 0.0335)))
    hand = pp.Obstacle("hand", pp.Cylinder(mount, 0.06), pp.pose((0, 0, oracle.TIP - 0.035)))
    verdict = on_cup(oracle.shape_of(mesh), mesh, 0.0105, SuctionCup(radius=0.01), hand).judge(arm)
    assert verdict.ok is ok, verdict.reason
    if not ok:
        assert verdict.reason.startswith("hand is ")
        assert depth_of(verdict) == pytest.approx(0.04, abs=2e-3)


def with_rod(shape: pp.Shape, mesh: trimesh.Trimesh, top: float, inside: float, *, body: bool = True):
    tool = (pp.Obstacle("rod", pp.Cylinder(0.004, 0.15), pp.pose((0, 0, oracle.TIP - 0.075))),) if body else ()
    at = SE3(oracle.DOWN, np.array([0, 0, oracle.TIP + top - inside]))
    return oracle.Grasp("", shape, mesh, at, [], {"tool": tool})


@pytest.mark.parametrize("body", [True, False])
@pytest.mark.parametrize(
    ("inside", "ok"), [(0.097, False), (0.02, False), (0.0009, True), (-0.004, True), (-0.006, False)]
)
def test_a_tip_is_measured_from_the_surface_that_it_meets_first(arm, inside, ok, body) -> None:
    for shape in (pp.Box(0.1, 0.1, 0.1), oracle.shape_of(oracle.box(0.1, 0.1, 0.1))):
        verdict = with_rod(shape, oracle.box(0.1, 0.1, 0.1), 0.05, inside, body=body).judge(arm)
        assert verdict.ok is ok, verdict.reason
        assert figures(verdict, Stage.GRIP)["tip_distance"] == pytest.approx(abs(inside), abs=2e-6)


@pytest.mark.parametrize("body", [True, False])
def test_a_rod_through_the_lid_of_a_closed_box_is_refused(arm, body: bool) -> None:
    """Its tip is 2 mm above the bottom, whose surface is the nearest."""
    mesh = oracle.without(oracle.box(0.08, 0.08, 0.05), oracle.box(0.077, 0.077, 0.047))
    for hull in (None, False):
        verdict = with_rod(oracle.shape_of(mesh, hull), mesh, 0.025, 0.0465, body=body).judge(arm)
        assert verdict.failed is Stage.GRIP
    opened = oracle.without(mesh, oracle.box(0.02, 0.02, 0.03, (0, 0, 0.025)))
    assert with_rod(oracle.shape_of(opened), opened, 0.025, 0.0465, body=body).judge(arm).ok


def test_the_tip_of_a_line_that_starts_below_an_overhang_is_at_the_surface(arm) -> None:
    """The approach of 20 mm starts under the upper arm of a C; a longer one would begin above it."""
    mesh = oracle.without(oracle.box(0.1, 0.06, 0.1), oracle.box(0.1, 0.07, 0.06, (0.02, 0, 0)))
    grasp = with_rod(oracle.shape_of(mesh), mesh, -0.03, 0.0, body=False)
    assert grasp.judge(arm, approach=0.02).failed is not Stage.GRIP
    verdict = grasp.judge(arm, approach=0.1)
    assert verdict.failed is Stage.GRIP
    assert verdict.stages[-1].figures["tip_distance"] == pytest.approx(0.08, abs=1e-6)


def test_links_of_the_robot_that_may_touch_the_part_have_a_depth_too() -> None:
    """The palm of the Panda's own hand, a mesh that its picks name in `gripper`."""
    arm = pp.load_robot("panda").arm(held={"panda_finger_joint1": 0.04})
    at, found = pp.pose((0.5, 0.1, 0.25), (np.pi, 0, 0)), {}
    shared = {"held": {"panda_finger_joint1": 0.04}, "grip": {"panda_finger_joint1": 0.0149}}
    for inside in (-0.001, 0.0007, 0.004):  # the lower end of the palm is 37.4 mm above the tcp
        block = pp.Obstacle("part", pp.Box(0.02, 0.03, 0.09), pp.pose(at.act(np.array([0, 0, 0.0076 - inside]))))
        pick = pp.Pick("part", at, carried="part", approach=0.15, retreat=0.02)
        found[inside] = judge_in(arm, pp.Scene([block]), pick, budget=STILL, gripper=("panda_hand",), **shared)
    assert found[-0.001].ok, found[-0.001].reason
    assert found[0.0007].ok, found[0.0007].reason
    assert found[0.004].failed is Stage.GRIP
    assert found[0.004].reason.startswith("panda_hand is ")
    assert depth_of(found[0.004]) == pytest.approx(0.004, abs=5e-4)


@pytest.mark.parametrize("gap", [0.0, 1e-9])
def test_open_fingers_that_just_touch_the_part_have_no_negative_depth(arm, gap: float) -> None:
    verdict = fingers_on(0.03, gap=gap).judge(arm)
    assert not verdict.ok
    assert "-0.00" not in " ".join(stage.message for stage in verdict.stages)


# -- along lines ------------------------------------------------------------------------------------------------------


def upright() -> tuple[pp.Shape, trimesh.Trimesh]:
    """A plate of 20 mm with a wall of 50 mm height, 20 mm from its middle."""
    mesh = oracle.union(oracle.box(0.12, 0.12, 0.02, (0, 0, -0.01)), oracle.box(0.006, 0.1, 0.051, (0.023, 0, 0.0245)))
    return oracle.shape_of(mesh), mesh


@pytest.mark.parametrize("aside", [-1, 1])
@pytest.mark.parametrize("tool", ["cup", "fingers"])
def test_a_hand_that_passes_through_the_part_on_its_approach_is_found(arm, tool: str, aside: int) -> None:
    if tool == "cup":
        grasp = on_cup(*upright(), 0.0, SuctionCup(radius=0.008))
    else:  # a part between the pads, the wall is beside the palm
        mesh = oracle.union(
            oracle.box(0.02, 0.03, 0.1, (0, 0, -0.05)),
            oracle.box(0.006, 0.03, 0.09, (0.023, 0, 0.0)),
            oracle.box(0.04, 0.03, 0.01, (0.013, 0, -0.05)),
        )
        grasp = fingers_on(oracle.TIP - 0.091, oracle.shape_of(mesh), 0.0)
        palm = pp.Obstacle("palm", pp.Box(0.02, 0.02, 0.06), pp.pose((0, 0, oracle.TIP - 0.08 - 0.031)))
        grasp.settings["tool"] = (palm,)
    direction = (-0.8 * aside, 0.0, 0.6)  # from the wall's side, or from the free side
    verdict = grasp.judge(arm, approach_direction=direction, approach=0.05)
    if aside < 0:
        assert verdict.ok, verdict.reason
    else:
        assert verdict.failed is Stage.APPROACH
        assert "inside part" in verdict.reason
        assert depth_of(verdict) > 1e-3


def test_a_hand_that_passes_through_the_part_after_its_release_is_found(arm) -> None:
    grasp = on_cup(*upright(), 0.0, SuctionCup(radius=0.008))
    there = pp.pose((0.3, 0.4, 0.3), (np.pi, 0, 0.3))

    def place(*direction: float) -> pp.picks.PickVerdict:
        lines = {"approach": 0.02, "retreat": 0.05, "retreat_direction": direction, "retreat_frame": "tip"}
        return grasp.judge(arm, place=pp.picks.PlaceTarget(there, **lines))

    assert place(-0.8, 0.0, -0.6).ok
    verdict = place(0.8, 0.0, -0.6)
    assert verdict.failed is Stage.PLACE
    assert "inside part" in verdict.reason or "part protrudes" in verdict.reason  # of the rod or of the face of the cup


@pytest.mark.parametrize(("overlap", "ok"), [(-0.0005, True), (0.0004, True), (0.002, False)])
def test_an_oblique_approach_may_graze_the_edge_of_another_wall(arm, overlap: float, ok: bool) -> None:
    """The displacement that takes the rod out of the plate, at the grasp, does not take it out of the wall."""
    slope, beside = 0.75, 0.02 - 0.004
    edge = beside * slope + overlap  # the rod passes the edge of the wall at this height, less the overlap
    mesh = oracle.union(
        oracle.box(0.12, 0.12, 0.02, (0, 0, -0.01)), oracle.box(0.006, 0.06, edge, (0.023, 0, edge / 2))
    )
    grasp = with_rod(oracle.shape_of(mesh), mesh, 0.0, 0.0)
    verdict = grasp.judge(arm, approach_direction=(-0.8, 0.0, 0.6), approach=0.05)
    assert verdict.ok is ok, verdict.reason
    if not ok:
        assert verdict.failed is Stage.APPROACH
        assert depth_of(verdict) > 1e-3


def test_a_part_that_is_stated_with_the_pick_is_there_on_the_approach(arm) -> None:
    """It is no obstacle of the scene, but the hand meets it all the same."""
    grasp = on_cup(*upright(), 0.0, SuctionCup(radius=0.008))
    part = replace(grasp.part, pose=oracle.GRASP.actInv(grasp.part.pose))
    for aside, failed in ((-1, None), (1, Stage.APPROACH)):
        pick = pp.Pick("part", oracle.GRASP, carried=part, approach=0.05, approach_direction=(-0.8 * aside, 0.0, 0.6))
        verdict = grasp.judge_pick(arm, pick, pp.Scene())
        assert verdict.failed is failed, verdict.reason


@pytest.mark.parametrize("approach", [0.0, 0.03, 0.12])
@pytest.mark.parametrize("stated", [True, False])
def test_the_transit_does_not_lead_through_a_part_that_the_pick_states_itself(arm, stated, approach) -> None:
    """At home the cup is beside a wall of the part, on the other side of which it grasps."""
    grasp = on_cup(*upright(), 0.0, SuctionCup(radius=0.008))
    part = replace(grasp.part, pose=oracle.GRASP.actInv(grasp.part.pose))
    beside = oracle.GRASP * pp.pose((0.05, 0, -0.015 - oracle.TIP))
    home = configurations(arm, np.array([(arm.root_from_base.inverse() * beside).homogeneous]), oracle.HOME, 0)[1]
    pick = pp.Pick("part", oracle.GRASP, carried=part if stated else "part", approach=approach, retreat=0.02)
    alone = pp.CollisionChecker(arm, pp.Scene([grasp.part]), attached=grasp.settings["tool"])
    start = next(q for q in home if alone.is_free(q))
    scene = pp.Scene() if stated else pp.Scene([grasp.part])
    verdict = judge_in(arm, scene, pick, home=start, budget=STILL, **grasp.shared)
    assert verdict.ok is (approach > 0), verdict.reason
    if verdict.ok:
        transit = verdict.motions[0].trajectory
        assert all(alone.is_free_batch(transit(np.linspace(0, transit.duration, 200))))
    elif stated:
        assert verdict.failed is Stage.TIMING
        assert "into the cup" in verdict.reason


@pytest.mark.slow
def test_no_random_approach_on_which_a_body_is_too_deep_is_good(arm) -> None:
    """Approaches in random directions to a plate with two walls, judged by samples at 15 places of the line."""
    seen, wrong = Counter(), []
    for index in range(14):
        rng = np.random.default_rng([31, index])
        heights = zip((0.02, -0.03), rng.uniform(0.01, 0.06, 2), strict=True)
        walls = (oracle.box(0.006, 0.06, h, (q, 0, h / 2 - 0.001)) for q, h in heights)
        mesh = oracle.union(oracle.box(0.12, 0.12, 0.02, (0, 0, -0.01)), *walls)
        radius = rng.uniform(0.004, 0.009)
        grasp = on_cup(oracle.shape_of(mesh), mesh, 0.0, SuctionCup(radius=radius), press=rng.uniform(-3e-4, 6e-4))
        hands = [oracle.placed(oracle.cylinder(radius, 0.03), grasp.settings["tool"][0].pose)]
        hands.append(oracle.placed(oracle.cylinder(0.005, 0.13), grasp.settings["tool"][1].pose))
        grasp = replace(grasp, hands=hands)
        tilt, turn = rng.uniform(0.0, 1.4), rng.uniform(0, 2 * np.pi)
        direction = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
        depth = oracle.along(grasp, direction, 0.05, rng)
        if abs(depth - oracle.LIMIT) < oracle.NEAR:
            continue
        verdict = grasp.judge(arm, approach=0.05, approach_direction=tuple(direction.tolist()))
        deep = depth > oracle.LIMIT
        seen[deep, verdict.failed] += 1
        if verdict.ok == deep and (deep or (verdict.failed is Stage.APPROACH and "inside" in verdict.reason)):
            wrong.append((index, depth, verdict.failed, verdict.reason))
    assert wrong == []
    assert seen[True, Stage.APPROACH] > 2
    assert seen[False, None] > 2


@pytest.mark.slow
def test_the_hand_is_not_in_a_part_that_it_follows_on_a_belt() -> None:
    """A finger gripper of the shipped belt with a palm that is lower by some millimetres."""
    arm, scene, picks = cell_of("ur5", "conveyor_picks.yaml")
    block, pick = scene["block_1"], picks.picks[0]
    top = block.pose.translation[2] + 0.03 - pick.pose.translation[2]  # above the tip
    shared, found = replace(picks, picks=(pick,)), {}
    for inside in (-0.002, 0.0006, 0.004):
        length = 0.17 - top + inside
        palm = pp.Obstacle("palm", pp.Box(0.02, 0.02, length), pp.pose((0, 0, length / 2)))
        hand = replace(shared, tool=(*shared.tool, palm))
        found[inside] = pp.validate_picks(arm, scene, hand, budget=STILL).verdicts[0]
    assert found[-0.002].ok, found[-0.002].reason
    assert found[0.0006].ok, found[0.0006].reason
    assert found[0.004].failed is Stage.GRIP
    aside = replace(pick, approach_direction=(0.0, 1.0, 0.0), approach_frame="root")
    post = pp.Obstacle("post", pp.Cylinder(0.003, 0.06), pp.pose((0, 0.022, 0.17 - 0.03)))
    ahead = replace(shared, picks=(aside,), tool=(*shared.tool, post))
    assert not pp.validate_picks(arm, scene, ahead, budget=STILL).verdicts[0].ok


def test_a_program_is_certified_with_a_deviation_although_the_hand_touches_the_part(arm) -> None:
    grasp = on_cup(pp.Box(0.05, 0.05, 0.02), PLATE, 0.01, SuctionCup(radius=0.01))
    verdict, scene = grasp.judge(arm), pp.Scene([grasp.part])
    assert verdict.ok
    picks = pp.Picks((), **grasp.shared)
    setup = PickSetup.make(arm, scene, picks, home=oracle.HOME, rng=0)
    certificates = setup.recertify(verdict.program(), verdict.pick, deviation=1e-4)
    assert all(each.free for each in certificates), [each.message for each in certificates]
    deeper = replace(picks, tool=(*picks.tool, pp.Obstacle("palm", pp.Box(0.05, 0.05, 0.02), pp.pose((0, 0, 0.17)))))
    again = PickSetup.make(arm, scene, deeper, home=oracle.HOME, rng=0)
    assert not all(each.free for each in again.recertify(verdict.program(), verdict.pick))


def test_a_link_that_moves_relative_to_the_tcp_does_not_belong_to_the_hand(arm) -> None:
    """It may touch the object in all stages, but its depth in it would not be judged."""
    pick = pp.Pick("part", pp.pose((0.45, 0.15, 0.25), (np.pi, 0, 0)))
    for link in ("wrist_2_link", "base_link"):
        with pytest.raises(pp.errors.InputError, match=link):
            judge_in(arm, pp.Scene(), pick, gripper=(link,))


# -- fingers that rotate ----------------------------------------------------------------------------------------------

FINGER = """<link name="{side}"><collision><origin xyz="0 0 0.03"/><geometry><box size="0.012 0.01 0.06"/></geometry>
</collision></link><joint name="{side}_joint" type="revolute"><parent link="hand"/><child link="{side}"/>
<origin xyz="0 {y} 0.02"/><axis xyz="{axis} 0 0"/><limit lower="-2.2" upper="0.5" velocity="1" effort="1"/>{mimic}
</joint>"""

PINCER = (
    '<robot name="pincer"><link name="base"/><link name="hand"/>'
    '<joint name="lift" type="prismatic"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>'
    '<limit lower="0" upper="1" velocity="1" effort="1"/></joint>'
    + FINGER.format(side="left", y=0.03, axis=1, mimic="")
    + FINGER.format(side="right", y=-0.03, axis=-1, mimic='<mimic joint="left_joint"/>')
    + "</robot>"
)
"""Two fingers of 60 mm that rotate inwards until they are parallel, with 50 mm between them."""

OPEN = -2.0


def pincer_grasp(*bars: tuple[float, float]) -> tuple[pp.picks.PickVerdict, trimesh.Trimesh]:
    """The verdict on a block between the fingers that has bars of 4 mm at (y, z), and the part."""
    arm = pp.load_robot(PINCER).arm(tcp="hand", held={"left_joint": OPEN})
    solids = [oracle.box(0.03, 0.05, 0.03, (0, 0, 0.065)), *(oracle.box(0.03, 0.004, 0.004, (0, *bar)) for bar in bars)]
    mesh, grasp = trimesh.util.concatenate(solids), pp.pose((0, 0, 0.5))
    part = pp.Obstacle("part", oracle.shape_of(mesh), grasp)
    pick = pp.Pick("part", grasp, carried="part", approach=0.1, retreat=0.02)
    shared = {"held": {"left_joint": OPEN}, "grip": {"left_joint": 0.0}, "margin": 0.0005}
    budget = pp.picks.PickBudget(remedies=0)
    return judge_in(arm, pp.Scene([part]), pick, home=np.array([0.2]), budget=budget, **shared), mesh


@pytest.mark.parametrize(
    ("bar", "ok"),
    [
        (None, True),
        ((0.081, 0.042), False),  # neither the open nor the closed finger is near it
        ((0.081, 0.060), True),  # beyond the arc of the fingertip
        ((0.0625, 0.0775), True),
        ((0.050, 0.065), False),
    ],
)
def test_rotating_fingers_do_not_pass_through_the_part_while_they_close(bar, ok) -> None:
    verdict, _ = pincer_grasp(*([] if bar is None else [bar]))
    assert verdict.ok is ok, verdict.reason
    if not ok:
        assert verdict.failed is Stage.GRIP
        assert depth_of(verdict) >= 0.004


@pytest.mark.slow
def test_random_bars_in_the_arcs_of_rotating_fingers_are_noticed() -> None:
    """Against samples at 60 places of the motion, in the frame of the finger."""
    rng, finger, counts = np.random.default_rng(3), oracle.box(0.012, 0.01, 0.06, (0, 0, 0.03)), Counter()
    for _ in range(20):
        radius, angle = rng.uniform(0.03, 0.09), rng.uniform(0.35, 1.5)
        bar = 0.03 + radius * np.sin(angle), 0.02 + radius * np.cos(angle)
        verdict, part = pincer_grasp(bar)
        solid, depth, apart = part.split()[-1], 0.0, np.inf
        for value in np.linspace(OPEN, 0.0, 60):
            there = oracle.placed(solid, (pp.pose((0, 0.03, 0.02)) * pp.pose(rpy=(value, 0, 0))).inverse())
            depth = max(depth, oracle.below(oracle.samples(there, rng, 20), finger))
            beyond = np.maximum(np.abs(there.vertices - [0, 0, 0.03]) - [0.006, 0.005, 0.03], 0.0)[:, 1:]
            apart = min(apart, np.linalg.norm(beyond, axis=1).min())
        if depth > oracle.LIMIT + oracle.NEAR:
            counts["deep"] += 1
            assert not verdict.ok, bar
        elif apart > 2e-3:
            counts["apart"] += 1
            assert verdict.ok, (bar, verdict.reason)
    assert min(counts["deep"], counts["apart"]) >= 5, counts


def test_of_several_bodies_that_are_too_deep_the_deepest_is_named(arm, monkeypatch) -> None:
    """The verdict is proven if the lower bound of any of them exceeds its limit."""
    grasp = next(each for each in oracle.random_grasps("rod", False, 12, seed=2) if each.judge(arm).ok)
    bodies = [BodyDepth(name, depth, 1e-3, least, (0, 0, 0), -1.0) for name, depth, least in (
        ("first", 2e-3, 0.5e-3), ("deepest", 5e-3, 0.8e-3), ("last", 3e-3, 0.9e-3))]  # fmt: skip
    for found, proven in ((bodies, False), ([*bodies, replace(bodies[0], least=1.5e-3)], True)):
        monkeypatch.setattr(PickTask, "depths", lambda _task, _member, found=tuple(found): found)
        verdict = grasp.judge(arm)
        assert verdict.failed is Stage.GRIP
        assert "deepest" in verdict.reason
        assert depth_of(verdict) == 5e-3
        assert (verdict.status is PickStatus.IMPOSSIBLE) == proven


def test_the_face_of_a_cup_without_any_body_is_checked_on_the_approach(arm) -> None:
    cube = pp.Obstacle("cube", pp.Box(0.03, 0.03, 0.03), pp.pose((0.45, 0.15, 0.01)))
    pick = pp.Pick("cube", pp.pose((0.45, 0.15, 0.025), (np.pi, 0, 0)), carried="cube")
    picks = pp.Picks((pick,), tip=pp.pose((0, 0, 0.1)), cup=SuctionCup(radius=0.008))
    cell = PickSetup.make(arm, pp.Scene([cube]), picks, home=None, rng=0).cell
    assert (cell.hand, [body.name for body in cell.palm_bodies]) == ((), [FACE])
    task = PickTask(pick, cell)
    member = task.nearest_group[0]
    assert task.grip(member).held
    hand, q = task.passing(member), screen(task, [member], reach(task, [member], 0)).candidates[0].q
    assert hand.prove(line_in(task, GraspCandidate(q, member, 0.0, 0.0)).path, q) is None
    through = plan_linear(task.at_grasp, q, task.target(pp.pose((0, 0, -0.02)) * task.grasp(member))).path
    assert hand.prove(through, q) is not None


def test_a_hand_beside_a_wall_is_proven_on_exact_meshes_if_the_grasp_is_not_known(arm) -> None:
    """The convex hull of a plate with a wall contains the cup on the plate, which is free."""
    mesh = upright()[1]
    grasp = on_cup(oracle.shape_of(mesh, hull=True), mesh, 0.0, SuctionCup(radius=0.008))
    pick = pp.Pick("part", oracle.GRASP, carried="part", approach=0.05)
    picks = pp.Picks((pick,), **grasp.shared)
    task = PickTask(pick, PickSetup.make(arm, pp.Scene([grasp.part]), picks, home=oracle.HOME, rng=0).cell)
    member = task.nearest_group[0]
    hand, q = task.passing(member), reach(task, [member], 0).q[0]
    assert not hand._coarse.is_free(q)
    tip_from_part = oracle.GRASP.actInv(grasp.part.pose)
    empty = task.at_grasp.with_scene(pp.Scene())
    for x, free in ((0.0, True), (0.03, False), (-0.03, True)):
        offset = pp.pose((x * np.sign(tip_from_part.rotation[0, 0]), 0.0, -0.02))
        line = plan_linear(empty, q, task.target(task.grasp(member) * offset)).path
        assert (hand.prove(line, None) is None) is free, x
