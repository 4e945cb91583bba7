"""The audit: it finds what a proof must not miss, and nothing where there is nothing."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.checking.audit import audit

HOME = np.array([0.0, -1.2, 1.4, -1.7, -1.57, 0.0])


@pytest.fixture(scope="module")
def arm():
    return pp.load_robot("ur5").arm()


def swing(arm):
    return pp.JointPath([HOME, HOME + np.array([1.5, 0, 0, 0, 0, 0])], arm.joint_names)


@pytest.mark.slow
@pytest.mark.parametrize("thickness", [5e-3, 0.1])
def test_a_plate_across_the_path_is_detected(arm, thickness):
    half_way = arm.forward_kinematics(HOME + np.array([0.75, 0, 0, 0, 0, 0])).translation
    plate = pp.Obstacle("plate", pp.Box(0.4, thickness, 0.4), pp.pose(half_way, (0, 0, 0.75)))
    checker = pp.CollisionChecker(arm, pp.Scene([plate]), link_meshes="mesh")
    seen = audit(swing(arm), checker)
    assert not seen.clean
    assert any("plate" in pair for _, pair in seen.contacts)
    assert "plate" in seen.message
    first = seen.contacts[0][0]
    assert not checker.is_free(swing(arm)(first))


def test_a_free_swing_is_clean_and_dense(arm):
    checker = pp.CollisionChecker(arm, link_meshes="mesh")
    seen = audit(swing(arm), checker, step=0.01)
    assert seen.clean
    assert seen.samples >= 151
    assert "no contact" in seen.message
    assert seen.geometry.startswith("7 triangle meshes, 1 simple shapes (")
    least = min(checker.clearance(q) for q in swing(arm)(np.linspace(0, 1, 16)))
    assert seen.distance == pytest.approx(least, abs=2e-3)
    assert f"{seen.distance * 1e3:.1f} mm" in seen.message


def test_meshes_are_their_triangles_whatever_the_checker_uses(arm):
    """The hulls of the links, and the convex pieces of an angle bracket, are not what is audited."""
    import trimesh

    plates = [trimesh.creation.box((0.4, 0.4, 0.02)), trimesh.creation.box((0.4, 0.02, 0.4))]
    bracket = trimesh.boolean.union([plates[0], plates[1].apply_translation((0, 0.19, 0.19))], engine="manifold")
    shape = pp.Mesh.from_arrays(np.asarray(bracket.vertices), np.asarray(bracket.faces))
    scene = pp.Scene(
        [
            pp.Obstacle("post", pp.Box(0.1, 0.1, 1), pp.pose((-0.6, 0, 0.5))),
            pp.Obstacle("bracket", shape, pp.pose((0.2, -0.8, 0.2))),
        ]
    )
    checker = pp.CollisionChecker(arm, scene)
    assert sum(body.owner == "bracket" for body in checker.bodies) > 1
    exact = checker.exact()
    assert all(body.is_exact or body.owner in ("ee_link", "post") for body in exact.bodies)

    def owners(judge):
        return {frozenset((judge.bodies[i].owner, judge.bodies[j].owner)) for i, j in judge.pairs}

    assert owners(exact) == owners(checker)
    assert {pair.owners for pair in exact.excluded} == {pair.owners for pair in checker.excluded}
    assert audit(swing(arm), checker, step=0.2).geometry.startswith("8 triangle meshes, 2 simple shapes (")
    # A ball in the hollow of a link, which its hull fills.
    near, rng = arm.frame_placement(HOME, "upper_arm_link").translation, np.random.default_rng(0)
    for point in near + rng.uniform(-0.12, 0.12, (500, 3)):
        judge = checker.with_scene(pp.Scene([pp.Obstacle("ball", pp.Sphere(0.002), pp.pose(point))]))
        if not judge.is_free(HOME) and judge.exact().clearance(HOME) > 0.002:
            break
    still = pp.JointPath([HOME], arm.joint_names)
    assert audit(still, judge).clean
    assert not audit(still, judge, exact=False).clean


def test_a_start_inside_a_closed_box_mesh_is_detected(arm):
    import trimesh

    hull = trimesh.creation.box((6, 6, 6))
    room = pp.Mesh.from_arrays(np.asarray(hull.vertices), np.asarray(hull.faces), hull=False)
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("room", room)]), link_meshes="mesh")
    assert not audit(swing(arm), checker, step=0.5).clean


@pytest.mark.parametrize("floor", [False, True])
def test_every_pair_in_contact_is_listed_in_the_order_of_time(slider, floor):
    """The ball of 1 cm passes two obstacles at the same place, after one that the scene lists last."""
    late = [pp.Obstacle(name, pp.Sphere(0.02), pp.pose((0.3, 0.0, 0.0))) for name in ("late", "twin")]
    early = pp.Obstacle("very_early", pp.Box(0.02, 0.02, 0.02), pp.pose((0.1, 0.0, 0.0)))
    # It touches the end of the path only; its box is infinite.
    wall = [pp.Obstacle("wall", pp.HalfSpace(), pp.pose((0.51, 0, 0), (0, -np.pi / 2, 0)))] if floor else []
    checker = pp.CollisionChecker(slider, pp.Scene([*late, *wall, early]))
    curve = pp.JointPath([[0.0], [0.505]], slider.joint_names)
    seen = audit(curve, checker, step=1e-3)
    assert set(seen.contacts[0][1]) == {"ball", "very_early"}
    assert {frozenset(pair) for _, pair in seen.contacts} == {
        frozenset({"ball", name}) for name in ["very_early", "late", "twin", *(["wall"] if floor else [])]
    }
    assert np.diff([t for t, _ in seen.contacts]).min() >= 0
    assert seen.contacts[0][0] * 0.505 == pytest.approx(0.08, abs=2e-3)
    assert seen.samples >= 506
    free = audit(pp.JointPath([[0.0], [0.07]], slider.joint_names), checker, step=1e-3)
    assert free.clean
    assert free.distance == pytest.approx(0.01, abs=1e-4)


def test_joints_of_another_arm_are_refused(arm):
    path = pp.JointPath([[0.0], [1.0]], ["j"])
    with pytest.raises(pp.InputError, match="joints"):
        audit(path, pp.CollisionChecker(arm))
    with pytest.raises(pp.InputError, match="step"):
        audit(swing(arm), pp.CollisionChecker(arm), step=0.0)
