"""Proposed grasps: what they claim by independent means, their order, their files, and picks that use them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import pinproof as pp
from pinproof.common.files import read_yaml
from pinproof.errors import InputError, PicksError
from pinproof.picks import Tool, propose_grasps
from pinproof.picks.grasps.hand_maps import HandMaps
from pinproof.picks.judging.grip import PlacedSurface, fingers_of, grip_by_cup, grip_by_fingers
from pinproof.picks.judging.hand import depths_at_grasp, hand_bodies
from pinproof.spatial import SE3

from ..test_grip_depth import PINCER
from . import own_parts as own

SHAPES = own.shapes()
ANGLE = pp.picks.GripLimits().angle


@pytest.fixture(scope="module")
def found() -> dict[str, pp.picks.ProposedGrasps]:
    """Proposals for every part, at random orientations."""
    rng = np.random.default_rng(0)
    meshes = {name: own.turned(mesh, rng) for name, mesh in SHAPES.items()}
    return {name: propose_grasps(mesh, own.jaws(), count=24) for name, mesh in meshes.items()}


@pytest.fixture(scope="module")
def meshes(found) -> dict[str, trimesh.Trimesh]:
    return {
        name: trimesh.Trimesh(
            each.part.triangles.reshape(-1, 3), np.arange(len(each.part.triangles) * 3).reshape(-1, 3)
        )
        for name, each in found.items()
    }


# -- fingers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHAPES)
def test_every_proposal_passes_the_grip_stage(found, arms, name: str) -> None:
    tool, proposals = own.jaws(), found[name]
    palm = hand_bodies(arms["ur5"], tool, ())
    assert len(proposals) == 24
    for each in proposals:
        grip = each.grasp.fingers["grip"]
        closed = pp.picks.GripperFingers(tool.fingers.bodies, opening=own.OPENING, grip=grip)
        moving = fingers_of(arms["ur5"], closed, {})
        part = PlacedSurface(proposals.part.surface, each.grasp.pose.inverse())
        result = grip_by_fingers(moving, part, np.array([0.0, 0.0, 1.0]), tool.grip_limits)
        assert result.held, (each.words, result.message)
        depths = depths_at_grasp(palm, moving, part, np.array([0.0, 0.0, -1.0]), tool.grip_limits.depth)
        assert all(body.within for body in depths), each.words


@pytest.mark.parametrize("thickness", [5e-4, 2e-3])
def test_sheet_is_grasped_by_fingers_that_close_completely(arms, thickness: float) -> None:
    tool = own.jaws()
    proposals = propose_grasps(pp.Box(0.06, 0.05, thickness), tool, count=12)
    assert min(each.width for each in proposals) == pytest.approx(thickness, abs=1e-5)
    for each in proposals:
        moving = fingers_of(arms["ur5"], replace(tool.fingers, grip=each.grasp.fingers["grip"]), {})
        part = PlacedSurface(proposals.part.surface, each.grasp.pose.inverse())
        assert grip_by_fingers(moving, part, np.array([0.0, 0.0, 1.0]), tool.grip_limits).held


@pytest.mark.parametrize("name", SHAPES)
def test_oracle_of_the_grip_holds_every_proposal(found, meshes, name: str) -> None:
    rng = np.random.default_rng(1)
    for each in list(found[name])[::3]:
        verdict, margin = own.oracle_judges(meshes[name], each, rng)
        assert verdict == "held" or margin < 0.05, (each.words, verdict, margin)


@pytest.mark.parametrize("name", SHAPES)
def test_lines_find_both_contacts_a_width_apart_within_the_cones(found, meshes, name: str) -> None:
    good = [own.is_pair(meshes[name], each, ANGLE) for each in found[name]]
    # the centre of the patches of a hollow part may be beside the material
    assert np.mean(good) > (0.7 if name in ("tube", "bracket", "tee") else 0.95)


def test_nothing_of_the_hand_is_in_the_part_on_the_approach(found) -> None:
    tool = own.jaws()
    bodies = [*tool.tool, *tool.fingers.apart()]
    for proposals in found.values():
        points = trimesh.sample.sample_surface(
            trimesh.Trimesh(**trimesh.triangles.to_kwargs(proposals.part.triangles)), 4000, seed=0
        )[0]
        for each in proposals:
            own_points = (points - each.grasp.pose.translation) @ each.grasp.pose.rotation
            for back in np.linspace(0.0, 0.1, 21):
                for body in bodies:
                    inner = own_points - body.pose.translation + [0, 0, back]
                    half = np.array([body.shape.x, body.shape.y, body.shape.z]) / 2 - 1e-6
                    assert not (np.abs(inner) < half).all(axis=1).any(), (each.words, body.name, back)


def test_force_that_fingers_resist_is_within_the_bounds_of_linear_programs(found) -> None:
    for name in ("bracket", "cone", "bolt"):
        for each in list(found[name])[::8]:
            inner, outer = own.resists_by_program(found[name], each, own.FRICTION, own.oracle_directions(40))
            # a lower bound, less than 2 % below the least force, of which the program has some directions only
            assert 0.95 * inner < each.resists < outer, (name, each.words)


@pytest.mark.parametrize("friction", [0.5, 3.0])
def test_force_that_a_cup_resists_is_a_lower_bound_by_linear_programs(friction: float) -> None:
    """Tilt limits a cup only where friction is large: its torsion has the same lever."""
    mesh = own.turned(SHAPES["block"], np.random.default_rng(5))
    found = propose_grasps(mesh, Tool(cup=replace(CUP, friction=friction), tool=vacuum().tool), count=20)
    for each in list(found)[::6]:
        forces = own.oracle_directions(80)
        least = min(own.cup_resists_by_program(found, each, CUP.radius, friction, force) for force in forces)
        assert 0.9 * least < each.resists < least, each.words


def test_fingers_on_an_arc_are_mapped_where_they_reach_farthest() -> None:
    arm = pp.load_robot(PINCER).arm(tcp="hand", held={"left_joint": -0.6})
    hand = HandMaps.of(Tool(grip={"left_joint": 0.5}), arm)
    shares = np.linspace(0.0, 1.0, 12)
    ends = [max(body.points[:, 2].max() for body in hand.fingers_at(share)) for share in shares]
    assert max(ends) > max(ends[0], ends[-1]) + 5e-3
    assert hand.fingers.grid.middles()[:, 1].max() + hand.fingers.grid.step > max(ends)


def test_proposals_are_in_the_order_of_what_they_resist(found) -> None:
    for proposals in found.values():
        resists = [each.resists for each in proposals]
        assert resists == sorted(resists, reverse=True)
        assert min(resists) > 0.0


def test_proposals_are_spread_over_directions_and_places(found) -> None:
    block = found["sphere"]
    axes = np.array([each.normals[0] for each in block])
    approaches = np.array([each.grasp.pose.rotation[:, 2] for each in block])
    assert np.linalg.svd(axes)[1].min() > 1.0
    assert np.linalg.svd(approaches)[1].min() > 1.0
    bolt = found["bolt"]
    places = np.array([each.contacts.mean(axis=0) for each in bolt])
    assert np.linalg.norm(np.ptp(places, axis=0)) > 0.03


def test_equal_seeds_give_equal_grasps() -> None:
    one, other = (propose_grasps(SHAPES["bracket"], own.jaws(), count=10, rng=4) for _ in range(2))
    assert one.grasps == other.grasps


@settings(max_examples=12)
@given(st.floats(0.01, 0.05), st.floats(0.01, 0.05), st.floats(0.02, 0.1), st.integers(0, 100))
def test_box_is_best_held_by_opposite_faces(x: float, y: float, z: float, seed: int) -> None:
    found = propose_grasps(pp.Box(x, y, z), own.jaws(), count=8, rng=seed)
    assert len(found)
    assert min(abs(found[0].width - side) for side in (x, y, z)) < 1e-6


@settings(max_examples=12)
@given(st.floats(0.008, 0.03), st.floats(0.02, 0.1), st.integers(0, 100))
def test_cylinder_is_best_held_across_its_diameter_or_length(radius: float, length: float, seed: int) -> None:
    found = propose_grasps(pp.Cylinder(radius, length), own.jaws(), count=8, rng=seed)
    assert len(found)
    assert min(abs(found[0].width - size) for size in (2 * radius, length)) < 0.05 * radius + 1e-6


# -- cups and tips ----------------------------------------------------------------------------------------------------

CUP = pp.picks.SuctionCup(radius=0.008)


def vacuum(**stated) -> Tool:
    return Tool(cup=CUP, tool=(pp.Obstacle("cup", pp.Cylinder(0.009, 0.04), pp.pose((0, 0, -0.02))),), **stated)


@pytest.mark.parametrize("name", ["bracket", "block", "bolt"])
def test_every_cup_seals_away_from_edges(name: str) -> None:
    mesh = own.turned(SHAPES[name], np.random.default_rng(5))
    if name == "bolt":
        with pytest.raises(InputError, match=r"radius of 8\.0 mm.*about \d\.\d mm"):
            propose_grasps(mesh, vacuum())
        return
    found = propose_grasps(mesh, vacuum(), count=20)
    for each in found:
        part = PlacedSurface(found.part.surface, each.grasp.pose.inverse())
        assert grip_by_cup(CUP, SE3.Identity(), part).held
        # by trimesh: the surface continues beyond the rim, in its plane
        angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        rim = (CUP.radius + 4e-4) * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(24)])
        z = each.grasp.pose.rotation[:, 2]
        start = rim @ each.grasp.pose.rotation.T + each.grasp.pose.translation - 0.01 * z
        places, rays, _ = mesh.ray.intersects_location(start, np.tile(z, (24, 1)), multiple_hits=False)
        assert len(rays) == 24
        assert np.abs((places - each.grasp.pose.translation) @ z).max() < CUP.gap
    assert [each.resists for each in found] == sorted((each.resists for each in found), reverse=True)


def test_cups_near_the_centre_of_mass_come_first() -> None:
    found = propose_grasps(pp.Box(0.1, 0.1, 0.01), vacuum(), count=60)
    levers = np.array([each.lever for each in found if abs(each.grasp.pose.rotation[2, 2]) > 0.9])
    assert levers[:10].mean() < levers[-10:].mean() / 2


def test_plain_tip_is_put_on_the_surface() -> None:
    magnet = Tool(tool=(pp.Obstacle("magnet", pp.Cylinder(0.005, 0.03), pp.pose((0, 0, -0.0151))),))
    found = propose_grasps(SHAPES["bracket"], magnet, count=12)
    assert {each.kind for each in found} == {"tip"}
    distances = trimesh.proximity.closest_point(SHAPES["bracket"], [each.contacts[0] for each in found])[1]
    assert distances.max() < 1e-6


# -- what is refused --------------------------------------------------------------------------------------------------


def test_refusals_state_the_reason_and_what_to_do() -> None:
    wide, jaws = pp.Box(0.2, 0.15, 0.12), own.jaws()
    open_mesh = trimesh.Trimesh(SHAPES["block"].vertices, SHAPES["block"].faces[:-2], process=False)
    slippery = own.jaws(grip_limits=pp.picks.GripLimits(angle=0.0))
    for part, tool, reason in (
        (wide, jaws, r"at least 120\.0 mm wide.*open to 70\.0 mm"),
        (open_mesh, jaws, "not closed"),
        (SHAPES["block"], slippery, "friction above 0"),
        (SHAPES["block"], Tool(), "neither fingers nor a cup"),
        (pp.HalfSpace(), jaws, "bounded"),
        (SHAPES["block"], Tool(grip={"finger_joint": 0.5}), "robot"),
    ):
        with pytest.raises(InputError, match=reason):
            propose_grasps(part, tool)


def test_file_in_millimetres_is_recognised_and_stated(tmp_path: Path) -> None:
    SHAPES["bracket"].copy().apply_scale(1000).export(tmp_path / "large.stl")
    SHAPES["bracket"].export(tmp_path / "small.stl")
    large, small = (propose_grasps(tmp_path / f"{name}.stl", own.jaws(), count=5) for name in ("large", "small"))
    assert "millimetres" in large.message
    assert "millimetres" not in small.message
    np.testing.assert_allclose(large.part.size, small.part.size, rtol=1e-5)
    large.save(tmp_path / "large.yaml")
    part = read_yaml(tmp_path / "large.yaml", ["parts"], PicksError)["parts"]["large"]
    assert part["mesh"] == {"path": "large.stl", "scale": 0.001}


# -- files and picks --------------------------------------------------------------------------------------------------

PICKS = """\
robot: ur5
tcp: tool0
tip: {xyz: [0, 0, 0.12]}
scene: scene.yaml
home: {shoulder_pan_joint: 0, shoulder_lift_joint: -1.57, elbow_joint: 1.57, wrist_1_joint: -1.57, wrist_2_joint: -1.57,
       wrist_3_joint: 0}
optimise: 0
fingers:
  opening: 0.07
  grip: 0.0
  bodies: [{name: left, box: [0.016, 0.008, 0.05], xyz: [0, 0.004, 0.095]},
           {name: right, box: [0.016, 0.008, 0.05], xyz: [0, -0.004, 0.095]}]
tool: [{name: palm, box: [0.06, 0.12, 0.03], xyz: [0, 0, 0.055]}]
parts:
  block: {box: [0.03, 0.04, 0.06]
picks:
  - {name: first, part: block, object: block_1}
"""
SCENE = "obstacles: [{name: block_1, box: [0.03, 0.04, 0.06], xyz: [0.45, 0.1, 0.2]}]\n"


def test_saved_grasps_are_read_as_those_of_a_part_type(tmp_path: Path) -> None:
    found = propose_grasps(pp.Box(0.03, 0.04, 0.06), own.jaws(), count=6)
    found.save(tmp_path / "grasps.yaml")
    stated = (tmp_path / "grasps.yaml").read_text(encoding="utf-8").split("grasps:\n")[1]
    head = PICKS.replace("0.06]\n", "0.06]\n    grasps:\n").replace(
        "block: {box: [0.03, 0.04, 0.06]", "block:\n    box: [0.03, 0.04, 0.06]"
    )
    (tmp_path / "picks.yaml").write_text(head.replace("    grasps:\n", "    grasps:\n" + stated), encoding="utf-8")
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    read = pp.read_picks(tmp_path / "picks.yaml").parts["block"].grasps
    assert [each.name for each in read] == [each.name for each in found.grasps]
    for one, other in zip(read, found.grasps, strict=True):
        assert dict(one.fingers) == dict(other.fingers)
        np.testing.assert_allclose(one.spin.angles, other.spin.angles, atol=1e-6)
        np.testing.assert_allclose(one.pose.homogeneous, other.pose.homogeneous, atol=1e-6)


def test_pick_without_a_grasp_uses_a_proposed_one(tmp_path: Path) -> None:
    (tmp_path / "picks.yaml").write_text(PICKS.replace("0.06]\n", "0.06]}\n"), encoding="utf-8")
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    picks = pp.read_picks(tmp_path / "picks.yaml")
    (verdict,) = pp.validate_picks(picks.load_arm(), picks.load_scene(), picks).verdicts
    assert verdict.ok, verdict.reason
    assert verdict.grasp.startswith("proposed grasp ")
    assert "mm wide" in verdict.grasp


def test_failure_of_all_proposals_proves_nothing(tmp_path: Path) -> None:
    (tmp_path / "picks.yaml").write_text(PICKS.replace("0.06]\n", "0.06]}\n"), encoding="utf-8")
    (tmp_path / "scene.yaml").write_text(SCENE.replace("0.45", "3.0"), encoding="utf-8")
    picks = pp.read_picks(tmp_path / "picks.yaml")
    (verdict,) = pp.validate_picks(picks.load_arm(), picks.load_scene(), picks).verdicts
    assert verdict.status is pp.picks.PickStatus.NOT_FOUND
    assert not verdict.refuted


def test_part_type_that_no_hand_holds_is_refused(tmp_path: Path) -> None:
    large = PICKS.replace("[0.03, 0.04, 0.06]\n", "[0.3, 0.3, 0.3]}\n")
    (tmp_path / "picks.yaml").write_text(large, encoding="utf-8")
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    picks = pp.read_picks(tmp_path / "picks.yaml")
    with pytest.raises(InputError, match=r"part 'block'.*300\.0 mm wide"):
        pp.validate_picks(picks.load_arm(), picks.load_scene(), picks)


def test_page_shows_part_hand_and_contacts(found, tmp_path: Path) -> None:
    found["bracket"].save(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert all(word in text for word in ("finger 0", "finger 1", "palm 0", "contact 0", "contact 1"))
    assert text.count("<tr>") >= len(found["bracket"])


def test_click_on_a_row_shows_the_hand_at_this_grasp(found, browser, tmp_path: Path) -> None:
    found["bracket"].save(tmp_path / "page.html")
    page = browser.open((tmp_path / "page.html").as_uri())
    page.click("tbody tr:nth-child(7)")
    page.wait_for("document.querySelector('#now').textContent.startsWith('grasp 7:')")
    grasp = found["bracket"][6].grasp.pose
    np.testing.assert_allclose(
        page.node("scene", "palm 0"), grasp.act(np.array([0, 0, -own.PAD[2] - 0.015])), atol=1e-6
    )
    page.close()


def test_the_pads_of_stepped_fingers_are_at_their_tips() -> None:
    joint = "panda_finger_joint1"
    hand = Tool(robot="panda", tcp="panda_hand_tcp", held={joint: 0.04}, grip={joint: None}, gripper=("panda_hand",))
    found = propose_grasps(pp.Box(0.05, 0.03, 0.03), hand, count=20)
    assert len(found) == 20
    assert {round(proposal.width, 3) for proposal in found} <= {0.03, 0.05}


def test_pads_are_ahead_of_closer_faces_near_the_palm() -> None:
    pad, knuckle = trimesh.creation.box((0.016, 0.008, 0.03)), trimesh.creation.box((0.016, 0.004, 0.01))
    knuckle.apply_translation((0, -0.006, -0.03))
    finger = trimesh.util.concatenate([pad, knuckle])
    bodies = [
        pp.Obstacle(f"finger_{number}", finger, pp.pose((0, sign * 0.008, -0.015), rpy=(0, 0, turn)))
        for number, sign, turn in ((1, 1, 0.0), (2, -1, np.pi))
    ]
    fingers = pp.picks.GripperFingers(tuple(bodies), opening=0.06, grip=0.0)
    found = propose_grasps(pp.Box(0.03, 0.04, 0.02), Tool(fingers=fingers), count=5)
    assert found.hand.fingers.pads[0, 3] > -1e-3
    assert found.hand.fingers.pads[0, 2] > -0.035
