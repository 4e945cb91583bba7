"""The stage hold: the grip carries the part at rest and on the motions, and limits how fast these are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision.checking.line_surface import LineSurface
from pinproof.picks import GripLimits, GripSuggestion, PickStatus, Stage, SuctionCup
from pinproof.picks.judging.grip import FingerContact, GripPatch, GripResult, PlacedSurface, grip_by_cup
from pinproof.picks.judging.hold import RESERVE, hold_limits, with_inertia

from .conftest import DOWN, QUICK, cell_of, figures, judge_in
from .test_grip import CUBE, HAND, TABLE, fingers, grasp

MASS = 0.3


@pytest.fixture(scope="module")
def bin_cell() -> tuple[pp.Arm, pp.Scene, pp.Picks]:
    return cell_of("panda", "bin_picks.yaml", "standing", "leaning")


def judged(cell, name: str, mass: float | None = MASS, budget: pp.picks.PickBudget = QUICK, **limits):
    """The verdict on a pick of the bin with a mass and values of the grip."""
    arm, scene, picks = cell
    (pick,) = (pick for pick in picks if pick.name == name)
    payload = None if mass is None else pp.Payload(mass, (0, 0, 0), (2e-4, 2e-4, 2e-4))
    picks = replace(picks, picks=(replace(pick, payload=payload),), grip_limits=GripLimits(**limits))
    return pp.validate_picks(arm, scene, picks, budget=budget)


def test_reserve_and_instant_are_those_of_the_motions_with_the_part(bin_cell) -> None:
    (verdict,) = judged(bin_cell, "standing", force=30.0).verdicts
    assert verdict.ok
    assert [stage.stage for stage in verdict.stages[-2:]] == [Stage.HOLD, Stage.TIMING]
    found = figures(verdict, Stage.HOLD)
    starts = np.cumsum([0.0, *(motion.duration for motion in verdict.motions)])
    (part,) = (
        motion for t, motion in zip(starts, verdict.motions, strict=False) if t <= found["time"] <= t + motion.duration
    )
    assert part.name in ("retreat", "transfer", "place")
    assert 0.0 < found["reserve"] < 1.0
    assert found["force"] >= 9.81 * MASS * 0.9
    assert f"reserve of {100 * found['reserve']:.0f} %, least at {found['time']:.2f} s" in verdict.reason


def test_weak_grip_slows_the_motions_with_the_part_and_uses_its_reserve(bin_cell) -> None:
    strong, weak = (judged(bin_cell, "leaning", force=force).verdicts[0] for force in (300.0, 11.3))
    carried = [sum(part.duration for part in verdict.motions if part.name == "retreat") for verdict in (strong, weak)]
    assert carried[1] > 1.02 * carried[0]
    assert 0.0 <= figures(weak, Stage.HOLD)["reserve"] < 0.02
    assert figures(strong, Stage.HOLD)["reserve"] > 0.5


def test_part_that_slips_at_rest_makes_the_pick_impossible_before_planning(bin_cell) -> None:
    (verdict,) = judged(bin_cell, "leaning", force=5.0).verdicts
    assert verdict.status is PickStatus.IMPOSSIBLE
    assert verdict.failed is Stage.HOLD
    assert not {Stage.APPROACH, Stage.TRANSIT} & {stage.stage for stage in verdict.stages}
    assert "leaning slips at rest at the grasp: 2.94 N and" in verdict.reason
    assert len(verdict.refuted) == 2  # each spin


def test_more_friction_or_force_holds_what_slips(bin_cell) -> None:
    assert not judged(bin_cell, "leaning", force=9.0).verdicts[0].ok
    assert judged(bin_cell, "leaning", force=9.0, friction=0.9).verdicts[0].ok


def test_force_and_friction_that_carry_a_part_that_slips_are_suggested(bin_cell) -> None:
    arm, scene, picks = bin_cell
    (verdict,) = judged(bin_cell, "leaning", force=9.0, budget=replace(QUICK, remedies=12)).verdicts
    assert verdict.failed is Stage.HOLD
    force, friction = (each for each in verdict.suggestions if isinstance(each, GripSuggestion))
    assert (force.value, friction.value) == ("grip_limits.force", "grip_limits.friction")
    assert 9.0 < force.after < 15.0
    assert "from 9 N to" in str(force)
    assert friction.before < friction.after <= 1.0
    limits = {"grip_limits": GripLimits(force=9.0)}
    for each in (force, friction):
        changed = replace(picks, picks=(each.apply(verdict.pick),), **limits)
        assert pp.validate_picks(arm, scene, changed, budget=QUICK).verdicts[0].ok
    with pytest.raises(pp.InputError, match="its force is"):
        force.apply(replace(force.apply(verdict.pick)))


def test_force_beyond_what_the_part_withstands_fails_the_grip(bin_cell) -> None:
    (verdict,) = judged(bin_cell, "standing", force=60.0, force_limit=40.0).verdicts
    assert verdict.failed is Stage.GRIP
    assert "60 N" in verdict.reason
    assert "40 N" in verdict.reason


def test_missing_data_are_named_where_the_hold_is_required(bin_cell) -> None:
    (no_mass,) = judged(bin_cell, "standing", mass=None, force=30.0, hold=True).verdicts
    assert no_mass.status is PickStatus.UNREADABLE
    assert "`payload` of the pick" in no_mass.reason
    (nothing,) = judged(bin_cell, "standing", mass=None, hold=True).verdicts
    assert "`payload` of the pick" in nothing.reason
    assert "`grip_limits.force`" in nothing.reason


def test_hold_is_judged_only_with_mass_and_force(bin_cell) -> None:
    for mass, force in ((MASS, None), (None, 30.0)):
        report = judged(bin_cell, "standing", mass=mass, force=force)
        assert report.verdicts[0].ok
        assert Stage.HOLD not in {stage.stage for stage in report.verdicts[0].stages}
        assert any("slip of" in note for note in report.notes)


def tapered(arms, taper: float, friction: float):
    """A pick of a part whose sides are inclined by ``taper`` (rad) across the parallel pads, which touch its edges."""
    half, step = 0.015, 0.015 * np.tan(taper)
    corners = [(x, side * (half + np.sign(x) * step), z)
               for x in (-half, half) for side in (-1, 1) for z in (-half, half)]  # fmt: skip
    part = pp.Obstacle("cube", pp.ConvexShape(np.array(corners)), CUBE.pose)
    pick = grasp(payload=pp.Payload(0.1, (0, 0, 0), (1e-5, 1e-5, 1e-5)), retreat=0.05)
    limits = GripLimits(force=40.0, friction=friction)
    settings = {"tip": pp.pose((0, 0, 0.16)), "tool": (HAND,), "fingers": fingers(0.06, None), "grip_limits": limits}
    return judge_in(arms["ur5"], pp.Scene([TABLE, part], allowed=[("base_link", "table")]), pick, **settings)


@pytest.mark.parametrize(("degrees", "friction"), [(6.5, 0.1), (17.5, 0.3)])
def test_part_whose_taper_exceeds_the_friction_angle_is_pressed_out_of_parallel_fingers(
    arms, degrees, friction
) -> None:
    verdict = tapered(arms, np.radians(degrees), friction)
    assert verdict.failed is Stage.HOLD
    # Between an edge of the part and a face of a finger, the same normals would hold
    assert verdict.status is PickStatus.NOT_FOUND


def test_taper_below_the_friction_angle_holds_with_a_smaller_reserve(arms) -> None:
    reserves = [figures(tapered(arms, np.radians(taper), 0.3), Stage.HOLD)["reserve"] for taper in (0.0, 8.0, 12.0)]
    assert reserves == sorted(reserves, reverse=True)
    assert reserves[-1] > 0.5


def test_links_of_one_finger_share_its_force(arms) -> None:
    """Two pads, of which one is divided into two bodies that are moved together."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.005, 0.005, (60, 3)) * (1, 0, 1)
    contact = FingerContact("pad", (0.0, 1.0, 0.0), 1e-4, 0.01, 0.0, 0.01, 0.0)

    def patch(side: float, branch: str) -> GripPatch:
        normal = np.array([0.0, side, 0.0])
        own = replace(contact, closing_direction=(0.0, side, 0.0))
        return GripPatch(own, points - [0, side * 0.02, 0], normal, normal, branch)

    pick = pp.Pick("cube", pp.pose((0, 0, 0)), carried="cube", payload=pp.Payload(0.1))
    shared = pp.Picks((), fingers=fingers(), grip_limits=GripLimits(force=10.0))
    share = []
    for patches in ((patch(1, "a"), patch(-1, "b")), (patch(1, "a"), patch(-1, "b"), patch(-1, "b"))):
        grip = GripResult(True, "", patches=patches)
        limits = hold_limits(pick, shared, grip, pp.pose((0, 0, 0)), arms["ur5"], LineSurface.of_obstacle(CUBE))
        share.append(limits.shares([[0, 0, 1.0, 0, 0, 0], [0, 1.0, 0, 0, 0, 0]]))
    np.testing.assert_allclose(share[1], share[0], rtol=1e-3)


@pytest.mark.parametrize("kind", ["box", "closed mesh", "open mesh", "stated"])
def test_part_without_inertia_has_that_of_a_uniform_density(kind: str) -> None:
    sides, mesh = np.array([0.3, 0.02, 0.04]), trimesh.creation.box((0.3, 0.02, 0.04))
    if kind == "open mesh":
        mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    shape = pp.Box(*sides) if kind == "box" else pp.Mesh(vertices=mesh.vertices, triangles=mesh.faces)
    stated = (1e-3, 2e-3, 3e-3) if kind == "stated" else None
    found = with_inertia(pp.Payload(0.3, (0.1, 0, 0), stated), LineSurface.of_obstacle(pp.Obstacle("bar", shape)))
    expected = np.diag(0.3 / 12 * (np.square(sides).sum() - np.square(sides)) if stated is None else stated)
    np.testing.assert_allclose(found.inertia, expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 0.09, -0.09])
def test_vacuum_of_a_tilted_cup_pulls_along_the_normal_of_the_surface(arms, tilt: float) -> None:
    cup, turn = SuctionCup(radius=0.01, gap=2e-3, force=20.0, friction=0.3), pp.pose((0, 0, 0), (tilt, 0, 0))
    block = LineSurface.of_obstacle(pp.Obstacle("block", pp.Box(0.1, 0.1, 0.04)))
    at = turn * pp.pose((0, 0, 0.02))
    grip = grip_by_cup(cup, pp.pose((0, 0, 0)), PlacedSurface(block, at))
    assert grip.held
    pick = pp.Pick("block", pp.pose((0, 0, 0)), carried="block", payload=pp.Payload(0.1))
    limits = hold_limits(pick, pp.Picks((), cup=cup), grip, at, arms["ur5"], block)
    out, aside = -turn.rotation[:, 2], turn.rotation[:, 1]
    loads = np.array([20.0 * out, 10.0 * out + 3.0 * aside, 10.0 * out - 3.0 * aside])
    np.testing.assert_allclose(limits.shares(np.hstack([loads, np.zeros((3, 3))])), 1.0 / (1.0 - RESERVE), rtol=1e-3)


def cup_pick(arms, **cup):
    """A pick of a box by a cup of 15 mm of an UR5."""
    block = pp.Obstacle("block", pp.Box(0.06, 0.06, 0.05), pp.pose((0.45, 0.1, 0.025)))
    pick = pp.Pick(
        "block", pp.pose((0.45, 0.1, 0.05), DOWN), 0.05, 0.05, carried="block", payload=pp.Payload(0.5, (0.02, 0, 0)),
        place=pp.picks.PlaceTarget(pp.pose((0.45, -0.2, 0.15), DOWN)),
    )  # fmt: skip
    stem = pp.Obstacle("stem", pp.Cylinder(radius=0.01, length=0.1), pp.pose((0, 0, 0.05)))
    scene = pp.Scene([block, pp.Obstacle("table", pp.Box(2, 2, 0.04), pp.pose((0.5, 0, -0.025)))],
                     allowed=[("base_link", "table")])  # fmt: skip
    settings = {"tip": pp.pose((0, 0, 0.1)), "tool": (stem,), "cup": SuctionCup(radius=0.015, **cup)}
    return judge_in(arms["ur5"], scene, pick, **settings)


def test_cup_holds_by_its_pull_off_force_and_slips_when_tilted_too_much(arms) -> None:
    strong = cup_pick(arms, force=60.0)
    assert strong.ok
    assert figures(strong, Stage.HOLD)["reserve"] > 0.1
    # The weight alone, 4.9 N, is carried, but not its moment of 0.1 N m about the cup, as N R / 2 = 0.02 N m
    weak = cup_pick(arms, force=10.0)
    assert weak.failed is Stage.HOLD
    assert weak.status is PickStatus.IMPOSSIBLE


def faster(motion: pp.Trajectory) -> pp.Trajectory:
    """The motion in 0.7 times its duration."""
    return pp.Trajectory(0.7 * motion.times, motion.q, motion.velocities / 0.7, motion.joint_names)


def test_program_that_is_run_faster_is_refused_where_the_part_slips(bin_cell) -> None:
    report = judged(bin_cell, "leaning", force=11.3)
    (verdict,) = report.verdicts
    program = verdict.program()
    assert all(proof.free for proof in report.setup.recertify(program, verdict.pick))
    *before, retreat = program.segments
    fast = replace(program, segments=(*before, replace(retreat, trajectory=faster(retreat.trajectory))))
    messages = [proof.message for proof in report.setup.recertify(fast, verdict.pick) if not proof.free]
    (message,) = (message for message in messages if "the part slips at" in message)
    # The factor that the message states is at least that by which the motion is too fast
    assert "it is held in 1." in message
    factor = float(message.split("it is held in ")[1].split()[0])
    assert factor <= 1.03 / 0.7
    slow = replace(
        program, segments=(*before, replace(retreat, trajectory=fast.segments[-1].trajectory.slowed(factor)))
    )
    assert not any("slips" in proof.message for proof in report.setup.recertify(slow, verdict.pick))
