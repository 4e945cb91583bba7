"""What is grasped is carried: it leaves its support, sweeps through the scene, is put down; each motion is proven."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.errors import InputError
from pinproof.picks import PickSetup, PickStatus, Stage
from pinproof.picks.judging import setup as judging_setup
from pinproof.picks.judging.task import PickTask

from .conftest import DOWN, QUICK, figures, judge_in

TIP = 0.105
PICKER = pp.Obstacle("picker", pp.Cylinder(radius=0.02, length=0.1), pp.pose((0, 0, 0.05)))
SHARED = {"tip": pp.pose((0, 0, TIP)), "tool": (PICKER,), "margin": 0.002}
TABLE = pp.Obstacle("table", pp.Box(1.6, 1.2, 0.04), pp.pose((0.35, 0, -0.025)))
BOLT = pp.Obstacle("bolt", pp.Cylinder(radius=0.008, length=0.04), pp.pose((0.45, 0.15, 0.015)))
PICK = pp.Pick("bolt", pp.pose((0.45, 0.15, 0.035), DOWN), carried="bolt")


@pytest.fixture(scope="module")
def arm(arms) -> pp.Arm:
    return arms["ur5"]


def scene_with(*obstacles: pp.Obstacle) -> pp.Scene:
    return pp.Scene([TABLE, *obstacles], allowed=[("base_link", "table")])


def judge(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, **shared) -> pp.picks.PickVerdict:
    return judge_in(arm, scene_with(BOLT, *obstacles), pick, **{**SHARED, **shared})


def setup_of(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle) -> tuple[PickSetup, pp.picks.PickVerdict]:
    """A set-up, and its verdict on a pick."""
    picks = pp.Picks((pick,), **SHARED)
    setup = PickSetup.make(arm, scene_with(*obstacles), picks, home=None, rng=0, budget=QUICK)
    verdict = setup.judge(0, pick)
    assert verdict.ok, verdict.reason
    return setup, verdict


def recheck(verdict: pp.picks.PickVerdict, arm: pp.Arm) -> None:
    """Each motion by a fresh checker at dense samples, and that they join."""
    assert verdict.ok, verdict.reason
    assert verdict.certificate is None
    ends = [motion.trajectory.end for motion in verdict.motions]
    for motion, before in zip(verdict.motions[1:], ends, strict=False):
        np.testing.assert_allclose(motion.trajectory.start, before, atol=1e-9)
    for motion in verdict.motions:
        assert motion.certificate.free
        assert motion.certificate.matches(motion.trajectory, arm, motion.scene, motion.attached)
        allowed = [parting.bodies for parting in motion.certificate.partings]
        hand = [("picker", "bolt")] if any(each.name == "bolt" for each in motion.attached) else []
        checker = pp.CollisionChecker(arm, motion.scene, attached=motion.attached, allowed=[*allowed, *hand])
        assert all(checker.is_free_batch(motion.trajectory(np.linspace(0.0, motion.trajectory.duration, 120))))
    least = min(motion.certificate.clearance for motion in verdict.motions)
    assert figures(verdict, Stage.TIMING)["clearance"] == least
    complete = sum(motion.trajectory.duration for motion in verdict.motions)
    assert verdict.trajectory.duration == pytest.approx(complete, abs=1e-6)


def test_an_object_is_lifted_off_its_support(arm) -> None:
    verdict = judge(arm, PICK)
    recheck(verdict, arm)
    assert [motion.name for motion in verdict.motions] == ["transit", "approach", "retreat"]
    transit, approach, retreat = verdict.motions
    assert ["bolt" in motion.scene.names for motion in verdict.motions] == [True, True, False]
    assert [parting.bodies for parting in retreat.certificate.partings] == [("bolt", "table")]
    held = next(each for each in retreat.attached if each.name == "bolt")
    at = arm.root_from_base * arm.forward_kinematics(verdict.q_grasp) * held.pose
    np.testing.assert_allclose(at.translation, (0.45, 0.15, 0.015), atol=1e-6)
    assert verdict.grasp_time == pytest.approx(transit.trajectory.duration + approach.trajectory.duration, abs=1e-6)


def test_an_object_is_placed_at_the_stated_pose(arm) -> None:
    place = pp.picks.PlaceTarget(pp.pose((0.42, -0.35, 0.035), DOWN))
    verdict = judge(arm, replace(PICK, place=place))
    recheck(verdict, arm)
    assert [motion.name for motion in verdict.motions][3:] == ["transfer", "place", "leave"]
    leave = verdict.motions[-1]
    np.testing.assert_allclose(leave.scene["bolt"].pose.translation, (0.42, -0.35, 0.015), atol=1e-6)
    at = arm.root_from_base * arm.forward_kinematics(verdict.trajectory(verdict.release_time)) * pp.pose((0, 0, TIP))
    np.testing.assert_allclose(at.translation, (0.42, -0.35, 0.035), atol=1e-5)
    assert [parting.bodies for parting in verdict.motions[4].certificate.partings] == [("bolt", "table")]


def test_the_swept_volume_contains_the_carried_part(arm) -> None:
    # A lintel over the bolt, beside the tool's path upwards: only a wide object meets it.
    wide = pp.Obstacle("plate", pp.Box(0.02, 0.2, 0.01), pp.pose((0, 0.0, 0.006)))
    lintel = pp.Obstacle("lintel", pp.Box(0.02, 0.02, 0.02), pp.pose((0.45, -0.1 + 0.16, 0.12)))
    here = pp.Pick("plate", pp.pose((0.45, -0.02, 0.06), DOWN), carried=None)
    assert judge(arm, here, lintel).ok
    verdict = judge(arm, replace(here, carried=wide), lintel)
    assert verdict.failed is Stage.RETREAT
    assert "plate" in verdict.reason
    assert "lintel" in verdict.reason


def test_an_object_may_touch_the_hand_from_the_approach_on_and_no_sooner(arm) -> None:
    # The tip inside the picker: at the grasp the bolt's head is pressed into its end by 1 mm.
    pressed = {"tip": pp.pose((0, 0, 0.099))}
    assert judge(arm, PICK, **pressed).ok
    without = judge(arm, replace(PICK, carried=None), **pressed)
    assert without.failed is Stage.GRASP
    assert "picker penetrates bolt" in without.reason


def test_fingers_are_open_before_the_grasp_and_at_the_object_after_it(arm) -> None:
    at = {"left": 0.005, "right": -0.005}
    pair = tuple(pp.Obstacle(name, pp.Box(0.02, 0.01, 0.06), pp.pose((0, y, 0.13))) for name, y in at.items())
    hand = {"fingers": pp.picks.GripperFingers(pair, opening=0.06, grip=0.016), "tip": pp.pose((0, 0, 0.15))}
    low = replace(PICK, pose=pp.pose((0.45, 0.15, 0.03), DOWN))
    verdict = judge(arm, low, **hand)
    assert verdict.ok, verdict.reason

    def gap(motion: pp.picks.PickMotion) -> float:
        left, right = (next(each for each in motion.attached if each.name == name) for name in ("left", "right"))
        return float(left.pose.translation[1] - right.pose.translation[1]) - 0.01

    assert [round(gap(motion), 9) for motion in verdict.motions] == [0.06, 0.06, 0.016]
    wall = pp.Obstacle("wall", pp.Box(0.2, 0.01, 0.06), pp.pose((0.45, 0.19, 0.03)))
    assert judge(arm, low, wall, **hand).failed is Stage.GRASP


def bin_mesh(finely: int) -> pp.Mesh:
    """An open bin, 0.2 m wide and 0.06 m high, whose floor is z = 0."""
    levels = ((0.1, -0.005), (0.1, 0.06), (0.095, 0.06), (0.095, 0.0))
    vertices = np.concatenate([np.array([[-a, -a, z], [a, -a, z], [a, a, z], [-a, a, z]]) for a, z in levels])
    faces = [[0, 2, 1], [0, 3, 2], [12, 13, 14], [12, 14, 15]]
    for k in range(0, 12, 4):
        for i in range(4):
            a, b = k + i, k + (i + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    for _ in range(finely):
        mesh = mesh.subdivide()
    return pp.Mesh.from_arrays(mesh.vertices, mesh.faces, hull=False)


@pytest.mark.parametrize("finely", [0, 2])
def test_an_object_is_lifted_out_of_a_bin_given_as_an_exact_mesh(arm, finely: int) -> None:
    # The floor of the bin is where the table's top is, and the table is elsewhere.
    bin_ = pp.Obstacle("bin", bin_mesh(finely), pp.pose((0.45, 0.15, -0.005), (0, 0, 0.3)))
    scene = pp.Scene([bin_, BOLT])
    verdict = judge_in(arm, scene, PICK, **SHARED)
    recheck(verdict, arm)
    retreat = verdict.motions[-1].certificate
    assert {parting.bodies for parting in retreat.partings} == {("bolt", "bin")}
    exact = pp.CollisionChecker(arm, scene.remove("bolt"), attached=verdict.motions[-1].attached)
    lifting = verdict.motions[-1].trajectory
    lifted = lifting(np.linspace(0, lifting.duration, 200))
    apart = exact.allowing(("picker", "bolt"))
    assert apart.clearance(lifted[-1]) > 0.002
    depths = [min([c.distance for c in apart.check(q).contacts if "bin" in c.bodies], default=0.0) for q in lifted]
    assert min(depths) > depths[0] - 1e-6


def test_a_bin_supports_an_object_above_its_floor_and_not_one_beside_its_wall(stick) -> None:
    """Of a robot without bodies: the only pair is object and bin."""
    for height, near_wall, supported in ((0.0005, 0.0002, True), (0.02, 0.0002, False), (0.0005, 0.05, True)):
        held = pp.Obstacle("part", pp.Box(0.02, 0.02, 0.02), pp.pose((0.085 - near_wall, 0, height + 0.01)))
        checker = pp.CollisionChecker(stick, pp.Scene([pp.Obstacle("bin", bin_mesh(0))]), attached=[held])
        assert len(checker.pairs) == 1
        found = PickTask.supports(SimpleNamespace(name="part"), checker, np.zeros(1), None)
        assert found == ((("part", "bin"),) if supported else ())


def test_an_object_may_have_several_supports(arm) -> None:
    at = {"rail_0": 0.445, "rail_1": 0.455}
    rails = (pp.Obstacle(name, pp.Box(0.004, 0.1, 0.02), pp.pose((x, 0.15, -0.015))) for name, x in at.items())
    scene = pp.Scene([*rails, BOLT])

    def lifted(support) -> pp.picks.PickVerdict:
        return judge_in(arm, scene, replace(PICK, support=support), **SHARED)

    for support in (["rail_0", "rail_1"], None):
        verdict = lifted(support)
        recheck(verdict, arm)
        partings = verdict.motions[-1].certificate.partings
        assert {parting.bodies for parting in partings} == {("bolt", "rail_0"), ("bolt", "rail_1")}
    one = lifted("rail_0")
    assert one.failed is Stage.RETREAT
    assert "rail_1" in one.reason


@pytest.mark.parametrize(("depth", "named"), [(0.0, True), (0.003, False)])
def test_an_obstacle_that_the_object_only_touches_is_proposed_as_a_support(arm, depth: float, named: bool) -> None:
    wall = pp.Obstacle("wall", pp.Box(0.02, 0.02, 0.03), pp.pose((0.468 - depth, 0.15, 0.01)))
    verdict = judge(arm, PICK, wall)
    assert verdict.failed is Stage.RETREAT
    assert "wall" in verdict.reason
    assert ("support: [table, wall]" in verdict.reason) is named


def test_supports_are_kept_as_names() -> None:
    assert replace(PICK, support="table").support == ("table",)
    assert replace(PICK, support=["table", "rail"]).support == ("table", "rail")
    for wrong in ([], "", ["table", ""], ["table", "table"], 3, {"table": 1}):
        with pytest.raises(InputError, match="support"):
            replace(PICK, support=wrong)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"support": ["table", "shelf"]}, "unknown support 'shelf'"),
        ({"carried": "screw"}, "unknown object 'screw'"),
        ({"carried": BOLT}, "the object's name 'bolt' is taken"),
        ({"support": "shelf"}, "unknown support 'shelf'"),
        ({"frame": "pallet"}, "unknown frame 'pallet'"),
        ({"frame": "wrist_3_link"}, "moves; picks need a fixed frame"),
    ],
)
def test_an_invalid_cell_is_a_verdict_at_the_input_stage(arm, change, expected: str) -> None:
    verdict = judge(arm, replace(PICK, **change))
    assert (verdict.status, verdict.failed) == (PickStatus.UNREADABLE, Stage.INPUT)
    assert expected in verdict.reason


def test_a_pose_in_the_frame_of_an_obstacle_is_the_same_pick(arm) -> None:
    one, other = judge(arm, PICK), judge(arm, replace(PICK, frame="bolt", pose=pp.pose((0, 0, 0.02), DOWN)))
    assert one.ok
    np.testing.assert_allclose(one.q_grasp, other.q_grasp, atol=1e-9)
    # Frames hang on each other, but not in circles
    frames = {
        "tray": pp.picks.NamedFrame(pp.pose((0.45, 0.15, 0)), "rack"),
        "rack": pp.picks.NamedFrame(pp.pose((0, 0, 0.035))),
    }
    there = replace(PICK, frame="tray", pose=pp.pose((0, 0, 0), DOWN))
    np.testing.assert_allclose(judge(arm, there, frames=frames).q_grasp, one.q_grasp, atol=1e-9)
    circle = {"tray": pp.picks.NamedFrame(pp.pose(), "rack"), "rack": pp.picks.NamedFrame(pp.pose(), "tray")}
    reason = judge(arm, there, frames=circle).reason
    assert all(word in reason for word in ("cycle", "tray", "rack"))


FINAL = pp.pose((0.40, -0.33, 0.015), (0, 0, 0.7))
"""The requested final pose of the bolt."""


@pytest.mark.parametrize(("turn", "aside"), [(0.0, (0.0, 0.0, 0.0)), (1.1, (0.002, -0.001, 0.003))])
def test_a_place_stated_as_the_pose_of_the_object_puts_it_there(arm, turn: float, aside) -> None:
    grasp = pp.pose((0.45, 0.15, 0.035), DOWN) * pp.pose(aside, (0, 0, turn))
    place = pp.picks.PlaceTarget(FINAL, pose_of="object")
    verdict = judge(arm, replace(PICK, pose=grasp, place=place))
    recheck(verdict, arm)
    final = verdict.motions[-1].scene["bolt"].pose
    np.testing.assert_allclose(final.homogeneous, FINAL.homogeneous, atol=1e-6)
    # The independent product: the tip at the release is final object * (grasp^-1 * object at the grasp)^-1.
    tip_from_object = np.linalg.inv(grasp.homogeneous) @ BOLT.pose.homogeneous
    released = arm.root_from_base * arm.forward_kinematics(verdict.trajectory(verdict.release_time))
    tip = released.homogeneous @ pp.pose((0, 0, TIP)).homogeneous
    np.testing.assert_allclose(tip, FINAL.homogeneous @ np.linalg.inv(tip_from_object), atol=1e-5)


def test_a_place_stated_as_the_pose_of_a_shape_uses_the_pose_that_it_is_held_with(arm) -> None:
    held = pp.Obstacle("part", pp.Box(0.02, 0.02, 0.03), pp.pose((0.001, 0, 0.016), (0, 0, 0.4)))
    frames = {"tray": pp.picks.NamedFrame(pp.pose((0.42, -0.35, 0), (0, 0, 0.3)))}
    wanted = pp.pose((0.01, 0, 0.02), DOWN)
    by_object = pp.picks.PlaceTarget(wanted, "tray", pose_of="object")
    by_tip = pp.picks.PlaceTarget(wanted * held.pose.inverse(), "tray")
    pick = replace(PICK, pose=pp.pose((0.45, -0.05, 0.06), DOWN), carried=held)
    verdicts = [judge(arm, replace(pick, place=place), frames=frames) for place in (by_object, by_tip)]
    for verdict in verdicts:
        recheck(verdict, arm)
        final = verdict.motions[-1].scene["part"].pose
        np.testing.assert_allclose(final.homogeneous, (frames["tray"].pose * wanted).homogeneous, atol=1e-6)
    assert verdicts[0].trajectory.duration == pytest.approx(verdicts[1].trajectory.duration, abs=1e-6)
    # Every grasp of a family puts the object at the same pose
    spun = replace(PICK, spin=pp.picks.GraspSpin((2.0,)), place=pp.picks.PlaceTarget(FINAL, pose_of="object"))
    verdict = judge(arm, spun)
    recheck(verdict, arm)
    np.testing.assert_allclose(verdict.motions[-1].scene["bolt"].pose.homogeneous, FINAL.homogeneous, atol=1e-6)


def test_suggestions_for_a_place_of_the_object_hold(arm) -> None:
    far = pp.pose((0.95, 0, 0.015), (0, 0, 0.7))
    pick = replace(PICK, place=pp.picks.PlaceTarget(far, pose_of="object"))
    budget = pp.picks.PickBudget(compared=1, remedies=4)
    verdict = judge_in(arm, scene_with(BOLT), pick, budget=budget, **SHARED)
    assert (verdict.status, verdict.failed) == (PickStatus.IMPOSSIBLE, Stage.PLACE)
    assert "release is out of reach" in verdict.reason
    assert verdict.suggestions
    for suggestion in verdict.suggestions:
        changed = suggestion.apply(pick)
        assert changed.place.pose_of == "object"
        recheck(judge(arm, changed), arm)


def test_a_shift_of_a_place_moves_the_object_and_a_rotation_of_pick_and_place_does_not_fit() -> None:
    pick = replace(PICK, place=pp.picks.PlaceTarget(FINAL, pose_of="object"))
    moved = pp.picks.ShiftSuggestion(place_by=(-20, 0, 0)).apply(pick).place.pose
    np.testing.assert_allclose(moved.translation, FINAL.translation - [0.02, 0, 0], atol=1e-15)
    with pytest.raises(InputError, match="pose of the object"):
        pp.picks.TurnSuggestion(degrees=15, axis=(0, 0, 1), with_place=True).apply(pick)
    with pytest.raises(pp.UnknownNameError, match="valid: object, tip"):
        pp.picks.PlaceTarget(FINAL, pose_of="part")


def test_motions_hold_for_a_part_that_is_displaced_by_less_than_the_room_around_it(arm) -> None:
    """A low bar is 12 mm beside the bolt, below the picker, and the margin is 2 mm: up to 10 mm are free.

    The table, on which the bolt still rests, and the picker, which grasps it, are not in its way, although the bolt is
    lifted by less than it may be displaced.
    """
    pick = replace(PICK, retreat=0.009)
    bar = pp.Obstacle("bar", pp.Box(0.01, 0.2, 0.02), pp.pose((0.45 + 0.008 + 0.012 + 0.005, 0.15, 0.005)))
    setup, verdict = setup_of(arm, pick, BOLT, bar)
    recheck(verdict, arm)
    for by, free in ((0.0, True), (0.0099, True), (0.0101, False)):
        certificates = setup.certify_displaced(verdict, by)
        assert certificates[-1].free is free
        if free:
            assert len(certificates) == len(verdict.motions)
            assert [parting.bodies for parting in certificates[-1].partings] == [("bolt", "table")]
        else:
            assert len(certificates) == 3
            assert {"bolt", "bar"} == set(certificates[-1].first_contact.bodies)
    with pytest.raises(InputError, match="by"):
        setup.certify_displaced(verdict, -1e-3)


def test_the_motions_for_a_displaced_part_are_those_of_the_grasp_of_the_verdict(arm, monkeypatch) -> None:
    pick = replace(PICK, tolerance=pp.picks.GraspTolerance(position=(0.006, 0.0, 0.0)))
    low = pp.Obstacle("bar", pp.Box(0.002, 0.2, 0.02), pp.pose((0.45 + 0.02 + 0.0015, 0.15, 0.05)))
    setup, verdict = setup_of(arm, pick, BOLT, low)
    assert verdict.member
    grasps, original = [], judging_setup.certify_displaced

    def certify(task: object, member: object, *rest: object) -> object:
        grasps.append(member.words)
        return original(task, member, *rest)

    monkeypatch.setattr(judging_setup, "certify_displaced", certify)
    assert all(each.free for each in setup.certify_displaced(verdict, 0.0))
    assert set(grasps) == {verdict.member}


def test_every_obstacle_may_be_displaced_if_a_pick_names_no_object(arm) -> None:
    post = pp.Obstacle("post", pp.Box(0.02, 0.02, 0.1), pp.pose((0.45 + 0.02 + 0.012 + 0.01, 0.15, 0.05)))
    setup, verdict = setup_of(arm, pp.Pick("bolt", pp.pose((0.45, 0.15, 0.045), DOWN)), post)
    assert [each.free for each in setup.certify_displaced(verdict, 0.0099)] == [True]
    (refuted,) = setup.certify_displaced(verdict, 0.0101)
    assert not refuted.free
    assert set(refuted.first_contact.bodies) == {"picker", "post"}
