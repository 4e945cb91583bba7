"""The facts in a reason: joint, pair, distance or residual, and a suggestion that works."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.ik import Clik
from pinproof.picks import PickSetup, PickStatus, Stage, Suggestion
from pinproof.picks.input.pick import family
from pinproof.picks.judging import grasp
from pinproof.picks.judging.configurations import along_families, configurations
from pinproof.picks.judging.grasp import every_branch_is_known, prove_blocked
from pinproof.picks.judging.task import PickTask

from .conftest import DOWN, cell_of, named

SUGGESTIONS = pp.picks.PickBudget().remedies


@pytest.fixture(scope="module")
def cell() -> tuple[pp.Arm, pp.Scene, pp.Picks]:
    return cell_of("ur5", "carry.yaml")


@pytest.fixture(scope="module")
def ur5(arms) -> pp.Arm:
    return arms["ur5"]


def judge(cell, pick: pp.Pick, *obstacles: pp.Obstacle, remedies: int = 0, **shared) -> pp.picks.PickVerdict:
    """The verdict on a pick in a cell with more obstacles."""
    arm, scene, picks = cell
    picks = replace(picks, picks=(pick,), **shared)
    budget = pp.picks.PickBudget(compared=1, remedies=remedies)
    return pp.validate_picks(arm, scene.add(*obstacles) if obstacles else scene, picks, budget=budget).verdicts[0]


def alone(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, remedies: int = 0, **shared) -> pp.picks.PickVerdict:
    """The verdict on a pick without a tool, among these obstacles."""
    return judge((arm, pp.Scene(), pp.Picks((), margin=0.002)), pick, *obstacles, remedies=remedies, **shared)


def suggested(verdict: pp.picks.PickVerdict, start: str) -> Suggestion:
    return next(suggestion for suggestion in verdict.suggestions if suggestion.text.startswith(start))


def outcome(verdict: pp.picks.PickVerdict) -> tuple[PickStatus, Stage | None]:
    return verdict.status, verdict.failed


IMPOSSIBLE, NOT_FOUND = PickStatus.IMPOSSIBLE, PickStatus.NOT_FOUND
PICK = pp.Pick("part", pp.pose((0.45, 0.1, 0.2), DOWN), approach=0.05, retreat=0.05)
STONE = pp.Obstacle("stone", pp.Sphere(0.02), pp.pose((0.45, 0.1 + 0.055, 0.2)))


def test_out_of_reach_reports_the_residual_and_a_reachable_shift(cell) -> None:
    far = pp.Pick("far", pp.pose((1.1, 0.0, 0.035), DOWN))
    verdict = judge(cell, far, remedies=SUGGESTIONS)
    assert outcome(verdict) == (IMPOSSIBLE, Stage.REACH)
    short = float(re.search(r"([\d.]+) mm and", verdict.reason)[1])
    assert short == pytest.approx(verdict.stages[-1].figures["position_error"] * 1e3, abs=0.06)
    suggestion = suggested(verdict, "move the pick")
    there = suggestion.apply(far)
    assert short <= 1e3 * np.linalg.norm(there.pose.translation - far.pose.translation) < 2.1 * short + 1
    found = judge(cell, there)
    assert found.ok or f"fails at the {found.failed.value} stage" in str(suggestion)


def test_limit_violations_name_the_joint_and_the_excess(arms) -> None:
    arm = arms["generic_6dof"]
    around = {name: (float(q) - 0.3, float(q) + 0.3) for name, q in zip(arm.joint_names, arm.home, strict=True)}
    tight = arm.with_limits(arm.limits.replace(arm.joint_names, around))
    pose = pp.pose(rpy=(0, 0, 0.8)) * (arm.root_from_base * arm.forward_kinematics(arm.home))
    verdict = alone(tight, pp.Pick("part", pose, approach=0, retreat=0), margin=0.0)
    assert verdict.failed is Stage.LIMITS
    assert "joint_1 = 0.8 is outside [-0.3, 0.3]" in verdict.reason
    assert "joint_1 by 0.5" in verdict.reason
    assert verdict.stages[-1].figures["outside"] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("name", ["scara", "stanford"])
@pytest.mark.parametrize("side", [1, -1])
def test_a_prismatic_joint_beyond_its_limit_is_named_with_the_excess(name, side) -> None:
    arm = pp.load_robot(name).arm()
    (j,) = np.flatnonzero(~arm.angular)
    limit = (arm.limits.upper if side > 0 else arm.limits.lower)[j]
    q = np.where(np.arange(arm.dof) == j, limit + 0.1 * side, arm.home)
    verdict = alone(arm, pp.Pick("part", arm.root_from_base * arm.forward_kinematics(q), approach=0.01, retreat=0.01))
    assert outcome(verdict) == (IMPOSSIBLE, Stage.LIMITS)
    assert f"{arm.joint_names[j]} by 0.1" in verdict.reason
    assert verdict.stages[-1].figures["outside"] == pytest.approx(0.1, abs=1e-6)


def test_a_colliding_grasp_reports_pair_depth_and_a_free_shift(cell) -> None:
    corner = replace(named(cell[2], "in_the_corner"), spin=pp.picks.GraspSpin())
    bare = replace(corner, carried=None)
    verdict = judge(cell, bare, remedies=SUGGESTIONS)
    assert outcome(verdict) == (IMPOSSIBLE, Stage.GRASP)
    assert "picker penetrates bin_right by 8.0 mm" in verdict.reason
    assert verdict.stages[-1].figures["distance"] == pytest.approx(-0.008, abs=1e-4)
    assert len(verdict.refuted) == verdict.configurations
    assert all("picker penetrates" in words for words in verdict.refuted)
    assert judge(cell, suggested(verdict, "move the pick").apply(bare)).ok
    # A shift that would miss the part is not suggested: free of the walls, the tip is more than 5 mm off the bolt
    verdict = judge(cell, corner, remedies=SUGGESTIONS)
    assert outcome(verdict) == (IMPOSSIBLE, Stage.GRASP)
    assert not any(each.text.startswith("move the pick") and not each.effect for each in verdict.suggestions)


@pytest.mark.slow
def test_an_occupied_place_names_the_obstacle(cell) -> None:
    stone = pp.Obstacle("stone", pp.Box(0.06, 0.06, 0.06), pp.pose((0.42, -0.35, 0.03)))
    verdict = judge(cell, named(cell[2], "over_the_wall"), stone)
    assert verdict.failed is Stage.PLACE
    assert "stone" in verdict.reason
    assert "bolt_1" in verdict.reason or "picker" in verdict.reason
    assert re.search(r"\d+ of \d+ IK solutions at the release were tried", verdict.reason)


def test_a_family_of_which_every_member_is_refuted_is_impossible(cell) -> None:
    verdict = judge(cell, replace(named(cell[2], "in_the_corner"), spin=pp.picks.GraspSpin((0.0, 0.4, -0.4))))
    assert verdict.status is PickStatus.IMPOSSIBLE
    assert len(verdict.refuted) == verdict.configurations == 24
    for words in ("spun by +23 deg: ", "spun by -23 deg: "):
        assert sum(each.startswith(words) for each in verdict.refuted) == 8
    assert all(re.search(r"\w+ (penetrates \w+ by [\d.]+ mm|is [\d.]+ mm from \w+)", each) for each in verdict.refuted)


def test_members_may_be_refuted_at_different_stages(cell) -> None:
    # A post beside the bolt: a broad tool meets it at the grasp, or only on its retreat, as it is rotated.
    bar = pp.Obstacle("bar", pp.Box(0.16, 0.01, 0.01), pp.pose((0, 0, 0.09)))
    post = pp.Obstacle("post", pp.Box(0.03, 0.03, 0.08), pp.pose((0.42 + 0.06, -0.25, 0.035)))
    shelf = pp.Obstacle("shelf", pp.Box(0.05, 0.3, 0.02), pp.pose((0.42, -0.25, 0.4)))
    spin = pp.picks.GraspSpin((0.0, np.pi / 2))
    pick = pp.Pick("b", pp.pose((0.42, -0.25, 0.035), DOWN), spin=spin, approach=0.2, retreat=0.0)
    verdict = judge(cell, pick, post, shelf, tool=(*cell[2].tool, bar))
    assert verdict.status is PickStatus.IMPOSSIBLE, verdict.reason
    straight = [each for each in verdict.refuted if not each.startswith("spun")]
    spun = [each for each in verdict.refuted if each.startswith("spun by +90 deg: ")]
    assert len(straight) + len(spun) == len(verdict.refuted)
    assert straight
    assert spun
    assert all("at the grasp: " in each and "bar" in each for each in straight)
    assert all("at the end of the approach: " in each for each in spun)


BELOW = pp.pose((0.6, 0.0, 0.1), DOWN)


def wall_at(height: float) -> pp.Obstacle:
    """A horizontal wall over the pose ``BELOW``."""
    return pp.Obstacle("wall", pp.Box(0.3, 1.6, 0.02), pp.pose((0.5, 0.0, height)))


def task_of(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle) -> PickTask:
    return PickTask(pick, PickSetup.make(arm, pp.Scene(obstacles), pp.Picks((pick,)), home=None, rng=0).cell)


FRAME = trimesh.creation.annulus(r_min=0.05, r_max=0.2, height=0.001)
"""A thin plate with a hole."""


@pytest.mark.parametrize(
    ("shape", "at"),
    [
        (pp.Sphere(0.05), (0.5, 0.0, 0.3)),
        (pp.Mesh.from_arrays(FRAME.vertices, FRAME.faces, hull=False), (0.5, 0.1, 0.36)),
    ],
)
def test_contact_of_the_hand_excludes_every_solution_of_seven_joints(arms, shape, at) -> None:
    """Of two exact meshes, the hand and the plate, edges cross triangles."""
    arm = arms["panda"]
    stone = pp.Obstacle("stone", shape, pp.pose(at))
    target = pp.pose((0.5, 0.0, 0.3), DOWN)
    verdict = alone(arm, pp.Pick("p", target), stone, margin=0.0)
    assert outcome(verdict) == (IMPOSSIBLE, Stage.GRASP)
    (reason,) = verdict.refuted
    assert "panda_hand" in reason or "finger" in reason
    checker = pp.CollisionChecker(arm, pp.Scene([stone]))
    found = pp.AnalyticIk().solve_all(arm, target).branches
    assert len(found) > 50
    for q in found[::10]:
        contacts = checker.check(q).contacts
        assert any("stone" in one.bodies and one.bodies[0] in reason for one in contacts)


def test_links_that_the_self_motion_moves_exclude_every_solution_of_seven_joints(arms) -> None:
    arm = arms["panda"]
    wall = wall_at(0.4)
    verdict = alone(arm, pp.Pick("p", BELOW), wall, margin=0.0)
    assert outcome(verdict) == (IMPOSSIBLE, Stage.GRASP), verdict.reason
    (reason,) = verdict.refuted
    assert "panda_link6 collides with wall" in reason
    meshes = pp.CollisionChecker(arm, pp.Scene([wall]), link_meshes="mesh")
    family = pp.AnalyticIk().self_motion(arm, BELOW)
    assert len(family) > 1
    assert not any(meshes.is_free_batch(curve.q).any() for curve in family)


def test_margin_alone_does_not_exclude_every_solution_of_seven_joints(arms) -> None:
    """The wall is nearer to links than the margin, without contact; further solutions are not excluded."""
    arm = arms["panda"]
    margins = {("panda_link5", "wall"): 0.2, ("panda_link6", "wall"): 0.2}
    task = task_of(arm, pp.Pick("p", BELOW), wall_at(0.47))
    checker = task.at_grasp.with_margin(0.0, margins)
    q = along_families(arm, task.targets([BELOW]), arm.home)[1]
    assert not checker.is_free_batch(q).any()
    assert task.at_grasp.with_margin(0.0).is_free_batch(q).any()
    assert prove_blocked(checker, task.target(BELOW), q) is None


def test_an_elbow_between_the_values_of_the_sweep_is_found(arms) -> None:
    """Below a wall, only a narrow range of the elbow is free."""
    arm = arms["panda"]
    verdict = alone(arm, pp.Pick("p", BELOW, approach=0.02, retreat=0.02), wall_at(0.45), margin=0.0)
    row, q = configurations(arm, np.array([BELOW.homogeneous]), arm.home, 0)
    assert len(row) > 5
    assert not pp.CollisionChecker(arm, pp.Scene([wall_at(0.45)]), margin=0.002).is_free_batch(q).any()
    assert verdict.ok, verdict.reason


def test_a_pose_on_a_line_that_is_out_of_reach_excludes_the_pick(arms) -> None:
    """Both ends of the line have solutions, and no configuration reaches the poses between them."""
    pick = pp.Pick("p", pp.pose((0.4, 0.0, 0.4), DOWN), approach=0.05, retreat=1.0, retreat_direction=(-1.0, 0.0, 0.0))
    verdict = alone(arms["panda"], pick, margin=0.0)
    assert outcome(verdict) == (IMPOSSIBLE, Stage.RETREAT), verdict.reason
    assert "reaches the retreat" in verdict.refuted[0]


@pytest.mark.parametrize("first", [True, False])
def test_targets_with_families_of_solutions_leave_branches_unknown(arms, first: bool) -> None:
    """With the wrist in line, two joints of the UR5 turn about parallel axes and one of them is free."""
    arm = arms["ur5"]
    known, free = (arm.forward_kinematics(np.array([0.3, -1.2, 1.5, -0.4, bend, 0.2])) for bend in (1.0, 0.0))
    task = task_of(arm, pp.Pick("p", known))
    assert pp.AnalyticIk().solve_all(arm, free, arm.home).families
    assert every_branch_is_known(task, [known])
    assert every_branch_is_known(task, [known, known])
    assert not every_branch_is_known(task, [free])
    assert not every_branch_is_known(task, [free, known] if first else [known, free])


@pytest.mark.parametrize("count", [1, 3, 20])
def test_every_pair_in_contact_at_the_examined_configurations_is_given_to_the_proof(arms, monkeypatch, count) -> None:
    arm = arms["panda"]
    wall = wall_at(0.4)
    checker = pp.CollisionChecker(arm, pp.Scene([wall]))
    q = along_families(arm, np.array([BELOW.homogeneous]), arm.home)[1]
    q = q[~checker.is_free_batch(q)][:: len(q) // count][:count]
    given, prove = [], grasp.prove_unreachable
    monkeypatch.setattr(grasp, "prove_unreachable", lambda *a, **k: given.extend(k["overlaps"]) or prove(*a, **k))
    proof = prove_blocked(checker, BELOW, q)
    meshes = pp.CollisionChecker(arm, pp.Scene([wall]), link_meshes="mesh")
    touching = {frozenset(contact.bodies) for each in q for contact in meshes.check(each).contacts}
    assert len(q) == count
    assert {frozenset(overlap.names) for overlap in given} == touching
    assert len(touching) == 1 or count > 1
    assert proof is not None
    assert {frozenset(pair) for pair in proof.bodies} <= touching


@pytest.mark.parametrize("name", ["ur5", "panda", "scara"])
def test_bodies_are_placed_on_the_link_that_carries_them(name) -> None:
    """Links of the chain, and bodies on them, have at any configuration the pose of forward kinematics."""
    arm = pp.load_robot(name).arm()
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("box", pp.Box(0.1, 0.2, 0.3), pp.pose((0.5, 0.1, 0.2)))]))
    rest = grasp._chain_at(arm, arm.home)
    rng, moved = np.random.default_rng(0), 0
    for body in checker.bodies:
        found = grasp._carrier(arm, rest, body)
        if found is None:
            continue
        number, link_from_body = found
        moved += not np.allclose(body.link_from_body.homogeneous, np.eye(4))
        for q in rng.uniform(*arm.limits.sampling_range(), (3, arm.dof)):
            base_from_link = arm.root_from_base.inverse() if body.link is None else arm.frame_placement(q, body.link)
            np.testing.assert_allclose(
                grasp._chain_at(arm, q)[number] @ link_from_body,
                (base_from_link * body.link_from_body).homogeneous,
                atol=1e-9,
            )
    assert moved


# -- families of grasps ------------------------------------------------------------------------------------------------


def test_members_go_from_the_nominal_one_outwards() -> None:
    axis = np.array([0.0, 0.0, 1.0])
    rings = list(family(pp.picks.GraspSpin((0.0, 0.5)), pp.picks.GraspTolerance((0.01, 0, 0), tilt=0.1), axis))
    assert [len(ring) for ring in rings] == [2, 12, 12]
    assert rings[0][0].words == ""
    far = [max(float(np.linalg.norm(m.nominal_from_tip.translation)) for m in ring) for ring in rings]
    np.testing.assert_allclose(far, [0, 0.005, 0.01], atol=1e-12)
    angles = sorted(pp.picks.GraspSpin.free().angles)
    np.testing.assert_allclose(np.diff(angles), 2 * np.pi / 24, atol=1e-12)
    assert abs(pp.picks.GraspSpin.free().angles[0]) == 0.0


def test_a_spin_keeps_the_tip_and_the_approach(ur5) -> None:
    verdict = alone(ur5, replace(PICK, spin=pp.picks.GraspSpin((2.0,))))
    assert verdict.ok
    assert "spun by +115 deg" in verdict.member
    there = ur5.root_from_base * ur5.forward_kinematics(verdict.q_grasp)
    np.testing.assert_allclose(there.translation, PICK.pose.translation, atol=1e-6)
    np.testing.assert_allclose(there.rotation[:, 2], PICK.pose.rotation[:, 2], atol=1e-9)
    assert there.rotation[0, 0] == pytest.approx(np.cos(2.0), abs=1e-6)


def test_a_tolerance_moves_the_grasp_only_where_the_nominal_one_fails(ur5) -> None:
    moved = replace(PICK, tolerance=pp.picks.GraspTolerance((0.0, 0.03, 0.0)))
    assert alone(ur5, moved).member == ""
    assert alone(ur5, PICK, STONE).failed is Stage.GRASP
    verdict = alone(ur5, moved, STONE)
    assert verdict.ok
    assert "mm along the tip's y" in verdict.member


def test_impossible_is_reported_only_if_no_seed_finds_a_path(arms) -> None:
    # By another method: descents from many seeds, none of which may end free at the grasp.
    arm = arms["generic_6dof"]
    stone = pp.Obstacle("stone", pp.Sphere(0.06), pp.pose((0.4, -0.3, 0.15)))
    pick = pp.Pick("part", pp.pose((0.4, -0.3, 0.15), DOWN), approach=0, retreat=0)
    verdict = alone(arm, pick, stone)
    assert outcome(verdict) == (IMPOSSIBLE, Stage.GRASP)
    assert len(verdict.refuted) == verdict.configurations
    assert all("stone" in line for line in verdict.refuted)
    checker = pp.CollisionChecker(arm, pp.Scene([stone]), margin=0.002)
    found = Clik().solve_many(arm, arm.root_from_base.actInv(pick.pose), arm.home, rng=5, count=60, attempts=200)
    assert len(found) >= 4
    assert not checker.is_free_batch(found.q).any()


def test_a_target_out_of_reach_is_refuted_but_a_sample_of_a_family_proves_nothing(ur5, arms) -> None:
    far = replace(PICK, pose=pp.pose((3, 0, 0.2), DOWN))
    assert outcome(alone(arms["panda"], far)) == (IMPOSSIBLE, Stage.REACH)  # also of seven joints
    for change in ({"spin": pp.picks.GraspSpin.free()}, {"tolerance": pp.picks.GraspTolerance((0.005, 0.0, 0.0))}):
        verdict = alone(ur5, replace(far, **change))
        assert (*outcome(verdict), verdict.refuted) == (NOT_FOUND, Stage.REACH, ())
        assert "grasps were tried" in verdict.reason


def test_weights_choose_among_complete_motions(ur5) -> None:
    def best(**weights) -> pp.picks.PickVerdict:
        none = {"clearance": 0.0, "limit_margin": 0.0, "manipulability": 0.0, "duration": 0.0}
        picks = pp.Picks((PICK,), margin=0.002)
        given = pp.picks.PickWeights(**{**none, **weights})
        return pp.validate_picks(ur5, pp.Scene(), picks, weights=given).verdicts[0]

    quick, ample = best(duration=1.0), best(limit_margin=1.0)
    assert quick.trajectory.duration <= ample.trajectory.duration + 1e-9
    assert ample.score["limit_margin"] >= quick.score["limit_margin"] - 1e-9
    assert quick.score["score"] == pytest.approx(quick.score["duration"])
