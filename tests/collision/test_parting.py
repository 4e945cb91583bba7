"""Motions that begin in contact: free only if what is carried leaves its support and never approaches it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from pinproof import (
    AnalyticIk,
    Box,
    Capsule,
    CertificateStatus,
    CollisionChecker,
    CubicPath,
    Cylinder,
    HalfSpace,
    InputError,
    JointPath,
    Mesh,
    Obstacle,
    Scene,
    Sphere,
    UnknownNameError,
    certify,
    plan_linear,
    pose,
    time_parametrise,
)
from pinproof.collision.rising import Rising
from pinproof.motion import bezier

FREE, COLLIDING, UNDECIDED = CertificateStatus.FREE, CertificateStatus.COLLIDING, CertificateStatus.UNDECIDED

MARGIN = 0.002


@pytest.fixture(scope="module")
def gantry(arm_from_links):
    """Slides along x and z, then turns about y; nothing of it can touch."""
    return arm_from_links(
        {"root": "", "cart": "", "mast": "", "hand": ""},
        [
            ("x", "prismatic", "root", "cart", "0 0 0", "1 0 0"),
            ("z", "prismatic", "cart", "mast", "0 0 0", "0 0 1"),
            ("tilt", "revolute", "mast", "hand", "0 0 0", "0 1 0"),
        ],
    ).arm(tcp="hand")


TABLE = Obstacle("table", Box(1.0, 1.0, 0.1), pose((0, 0, -0.05)))
PART = Obstacle("part", Box(0.2, 0.1, 0.1), pose((0, 0, 0.05)))
"""Stands on the table where q is 0."""


def verdict(gantry, *waypoints, sink=0.0, support=TABLE, part=PART, scene=(), **settings):
    checker = CollisionChecker(gantry, Scene([support, *scene]), attached=[part], margin=MARGIN)
    q = np.array(waypoints, dtype=float) - [0, sink, 0]
    return certify(JointPath(q, gantry.joint_names), checker, parting=[("part", "table")], **settings)


@pytest.mark.parametrize("sink", [-0.001, 0.0, 0.0005, 0.00099])
def test_straight_up_is_free_and_says_by_what_proof(gantry, sink):
    certificate = verdict(gantry, [0, 0, 0], [0, 0.3, 0], sink=sink)
    assert certificate.status is FREE
    (parting,) = certificate.partings
    assert parting.bodies == ("part", "table")
    assert parting.gap == pytest.approx(-sink, abs=1e-12)
    assert parting.until == pytest.approx((sink + MARGIN) / 0.3, abs=1e-3)
    np.testing.assert_allclose(parting.normal, [0, 0, 1])
    assert "part may touch table until" in str(certificate)
    assert "never to approach it along (0, 0, 1)" in str(certificate)
    assert certificate.tube.largest_joints == 0.0


def test_without_leave_the_same_motion_begins_with_a_contact(gantry):
    checker = CollisionChecker(gantry, Scene([TABLE]), attached=[PART], margin=MARGIN)
    assert certify(JointPath([[0, 0, 0], [0, 0.3, 0]], gantry.joint_names), checker).status is COLLIDING


def test_deeper_than_a_millimetre_is_refused(gantry):
    certificate = verdict(gantry, [0, 0, 0], [0, 0.3, 0], sink=0.0011)
    assert certificate.status is COLLIDING
    assert "1.10 mm deep in table" in certificate.message
    assert certificate.first_contact.time == 0.0


def test_dragged_along_it_is_not_free(gantry):
    certificate = verdict(gantry, [0, 0, 0], [0.2, 0, 0])
    assert certificate.status is COLLIDING
    assert "has not left by the end" in certificate.message


def test_lifted_by_less_than_the_margin_is_not_free(gantry):
    certificate = verdict(gantry, [0, 0, 0], [0, 0.9 * MARGIN, 0])
    assert certificate.status is COLLIDING
    assert "has not left by the end" in certificate.message
    assert verdict(gantry, [0, 0, 0], [0, 1.1 * MARGIN, 0]).status is FREE


@pytest.mark.parametrize("down", [1e-6, 1e-4, 0.01])
def test_pressed_down_first_is_a_contact_with_its_reason(gantry, down):
    certificate = verdict(gantry, [0, 0, 0], [0, -down, 0], [0, 0.3, 0])
    assert certificate.status is COLLIDING
    assert "comes nearer again" in certificate.message
    assert certificate.first_contact.bodies == ("part", "table")
    assert certificate.first_contact.time <= 1.0


def test_set_down_again_is_a_contact(gantry):
    certificate = verdict(gantry, [0, 0, 0], [0, 0.1, 0], [0.05, 0.0005, 0])
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time > 1.9


@pytest.mark.parametrize("start", [0.0, 0.0005])
def test_an_edge_tilted_down_is_refused(gantry, start):
    """The middle rises by 1 cm while the far edge goes down by 2."""
    certificate = verdict(gantry, [0, start, 0], [0, start + 0.01, 0.3])
    assert certificate.status is COLLIDING
    assert certificate.first_contact.distance < MARGIN


def test_a_tilt_that_lets_no_edge_down_is_free(gantry):
    """Up by 10 cm while it tilts: the edge that turns down rises all the same."""
    assert verdict(gantry, [0, 0, 0], [0, 0.1, 0.3]).status is FREE


def test_a_lift_that_arcs_back_is_told_from_one_that_does_not(gantry):
    """Two cubic lifts to the same height; one dips below its start on the way."""
    checker = CollisionChecker(gantry, Scene([TABLE]), attached=[PART], margin=MARGIN)
    ends = np.array([[0, 0, 0], [0.05, 0.1, 0.0]])
    for slope, status in ((0.0, FREE), (0.2, FREE), (-0.02, COLLIDING)):
        tangents = np.array([[0, slope, 0], [0, 0, 0]])
        curve = CubicPath(ends, tangents, [0.0, 1.0], gantry.joint_names)
        assert certify(curve, checker, parting=[("part", "table")]).status is status


def test_what_is_in_the_way_is_still_seen_on_all_of_the_curve(gantry):
    for height, first in ((0.11, 0), (0.2, 0), (0.35, 1)):
        beam = Obstacle("beam", Box(0.02, 1, 0.02), pose((0 if first == 0 else 0.5, 0, height + 0.02)))
        certificate = verdict(gantry, [0, 0, 0], [0, 0.3, 0], [0.6, 0.3, 0], scene=[beam])
        assert certificate.status is COLLIDING
        assert certificate.first_contact.bodies == ("part", "beam")
        assert first <= certificate.first_contact.time < first + 1
    assert verdict(gantry, [0, 0, 0], [0, 0.3, 0], [0.6, 0.3, 0]).status is FREE


def cuboid(x, y, z, hull):
    box = trimesh.creation.box((x, y, z))
    return Mesh.from_arrays(box.vertices, box.faces, hull=hull)


SUPPORTS = {
    "half-space": Obstacle("table", HalfSpace()),
    "cylinder": Obstacle("table", Cylinder(0.5, 0.2), pose((0, 0, -0.1))),
    "hull": Obstacle("table", cuboid(1, 1, 0.2, True), pose((0, 0, -0.1))),
    "mesh": Obstacle("table", cuboid(1, 1, 0.2, False), pose((0, 0, -0.1))),
    "ball": Obstacle("table", Sphere(0.5), pose((0, 0, -0.5))),
}
PARTS = {
    "box": PART,
    "capsule": Obstacle("part", Capsule(0.05, 0.1), pose((0, 0, 0.05), (0, np.pi / 2, 0))),
    "mesh": Obstacle("part", cuboid(0.2, 0.1, 0.1, False), pose((0, 0, 0.05))),
}


@pytest.mark.parametrize("support", SUPPORTS.values(), ids=SUPPORTS)
@pytest.mark.parametrize("part", PARTS.values(), ids=PARTS)
def test_supports_and_parts_of_every_kind(gantry, support, part):
    up = verdict(gantry, [0, 0, 0], [0, 0.3, 0], sink=0.0002, support=support, part=part)
    assert up.status is FREE, str(up)
    assert verdict(gantry, [0, 0, 0], [0, -0.01, 0], [0, 0.3, 0], support=support, part=part).status is COLLIDING
    assert verdict(gantry, [0, 0, 0], [0.02, 0, 0], support=support, part=part, sink=0.0002).status is not FREE


def test_a_part_that_leaves_sideways_leaves_a_wall(gantry):
    """The direction is that of the contact, not up."""
    wall = Obstacle("table", Box(0.1, 1, 1), pose((-0.15, 0, 0)))
    certificate = verdict(gantry, [0, 0, 0], [0.2, 0, 0], support=wall)
    assert certificate.status is FREE
    np.testing.assert_allclose(certificate.partings[0].normal, [1, 0, 0], atol=1e-12)
    assert verdict(gantry, [0, 0, 0], [0, 0.2, 0], support=wall).status is not FREE
    assert verdict(gantry, [0, 0, 0], [-0.01, 0, 0], [0.3, 0, 0], support=wall).status is COLLIDING


def test_two_supports_are_left_each_in_its_own_direction(gantry):
    """A part in a corner: straight up slides along the wall and never leaves it, aslant leaves both."""
    wall = Obstacle("wall", Box(0.1, 1, 1), pose((-0.15, 0, 0)))
    checker = CollisionChecker(gantry, Scene([TABLE, wall]), attached=[PART], margin=MARGIN)
    both = [("part", "table"), ("wall", "part")]
    up, aslant = ([[0, 0, 0], end] for end in ([0, 0.2, 0], [0.2, 0.3, 0]))
    assert certify(JointPath(up, gantry.joint_names), checker, parting=both).status is not FREE
    certificate = certify(JointPath(aslant, gantry.joint_names), checker, parting=both)
    assert certificate.status is FREE
    assert [parting.bodies for parting in certificate.partings] == [("part", "table"), ("part", "wall")]
    assert certify(JointPath(aslant, gantry.joint_names), checker, parting=both[:1]).status is COLLIDING


def test_a_support_that_may_stand_elsewhere(gantry):
    moved = verdict(gantry, [0, 0, 0], [0, 0.3, 0], obstacle_tolerance=0.0005)
    assert moved.status is FREE
    assert moved.tube.largest_obstacles <= 0.0005 + 1e-9
    assert verdict(gantry, [0, 0, 0], [0, 0.3, 0], obstacle_tolerance=0.0011).status is COLLIDING


def test_what_makes_no_sense_is_refused(gantry):
    checker = CollisionChecker(
        gantry, Scene([TABLE]), attached=[PART, Obstacle("other", Sphere(0.01), pose((0, 0, 1)))]
    )
    move = JointPath([[0, 0, 0], [0, 0.3, 0]], gantry.joint_names)
    with pytest.raises(UnknownNameError, match="cup"):
        certify(move, checker, parting=[("cup", "table")])
    with pytest.raises(InputError, match="one must be an obstacle"):
        certify(move, checker, parting=[("part", "other")])
    with pytest.raises(InputError, match="no pair of names"):
        certify(move, checker, parting=("part", "table"))
    with pytest.raises(InputError, match="not checked"):
        certify(move, checker.allowing(("part", "table")), parting=[("part", "table")])
    for setting in ({"joint_tolerance": 1e-3}, {"record": True}):
        with pytest.raises(InputError, match="parting"):
            certify(move, checker, parting=[("part", "table")], **setting)


def test_an_arm_lifts_a_part_off_a_table(ur5):
    """As planned, and timed, from rest; then pressed down by a tenth of a millimetre first."""
    part = Obstacle("part", Box(0.06, 0.06, 0.1), pose((0, 0, 0.05)))
    scene = Scene([Obstacle("table", Box(0.5, 0.5, 0.05), pose((0.65, 0.1, 0.175)))])
    checker = CollisionChecker(ur5, scene, margin=MARGIN, attached=[part], allowed=[("part", "wrist_3_link")])
    leave = checker.allowing(("part", "table"))
    grasp, above, below = (pose((0.45, 0.1, z), (np.pi, 0, 0)) for z in (0.3, 0.4, 0.2999))
    q = next(q for q in AnalyticIk().solve_all(ur5, grasp).q if leave.is_free(q))
    path = plan_linear(leave, q, above).path
    for curve in (path, time_parametrise(path, ur5.limits)):
        certificate = certify(curve, checker, parting=[("part", "table")])
        assert certificate.status is FREE, str(certificate)
        assert certificate.matches(curve, ur5, scene, [part])
        (parting,) = certificate.partings
        assert parting.until < 0.2 * curve.domain[1]
    pressed = plan_linear(leave, q, below).path
    onwards = plan_linear(leave, pressed.end, above).path
    both = CubicPath(
        np.concatenate([pressed.q, onwards.q[1:]]), np.concatenate([pressed.tangents, onwards.tangents[1:]]),
        np.concatenate([pressed.knots, pressed.knots[-1] + onwards.knots[1:]]), ur5.joint_names,
    )  # fmt: skip
    certificate = certify(both, checker, parting=[("part", "table")])
    assert certificate.status is not FREE
    assert certificate.first_contact is None or certificate.first_contact.time < both.domain[1]


@pytest.mark.parametrize("name", ["ur5", "panda"])
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_gap_never_falls_by_more_than_is_said(request, name, seed):
    """Along random pieces of every degree, and for a part of any shape: the fall seen is at most the bound."""
    arm, rng = request.getfixturevalue(name), np.random.default_rng(seed)
    part = Obstacle(
        "part", [Box(0.1, 0.05, 0.2), Cylinder(0.05, 0.3), Capsule(0.02, 0.3)][rng.integers(3)], pose((0, 0, 0.2))
    )
    checker = CollisionChecker(
        arm, Scene([Obstacle("thing", Sphere(0.1), pose(rng.uniform(-1, 1, 3)))]), attached=[part]
    )
    pair = next(
        k
        for k, (i, j) in enumerate(checker.pairs)
        if (checker.bodies[i].owner, checker.bodies[j].owner) == ("part", "thing")
    )
    q = rng.uniform(-2, 2, arm.dof)
    rising = Rising(checker, pair, q)
    piece = q + rng.choice([0.002, 0.05, 0.5]) * rng.normal(size=(rng.integers(2, 6), arm.dof))
    falls, motion = rising._falls(piece)
    gaps = np.array([rising.gap(p) for p in bezier.evaluate(np.array([0.0, 1.0]), piece[None], np.linspace(0, 1, 80))])
    assert (np.maximum.accumulate(gaps) - gaps).max() <= falls + 1e-9
    assert np.ptp(gaps) <= 2 * motion + 1e-9
    if len(piece) == 2 and motion < 0.02:  # and it is no idle bound: it tells a short piece from the same one backwards
        assert min(falls, rising._falls(piece[::-1])[0]) < motion


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_free_motion_ever_approaches(gantry, seed):
    """Random curves from the table: what is called free is seen to rise until it is clear, and to stay clear."""
    rng = np.random.default_rng(seed)
    checker = CollisionChecker(gantry, Scene([TABLE]), attached=[PART], margin=MARGIN)
    points = np.cumsum([[0, 0, 0], *(rng.normal(size=(3, 3)) * [0.05, 0.03, 0.05] + [0, 0.02, 0])], axis=0)
    curve = (
        JointPath(points, gantry.joint_names) if rng.random() < 0.5 else CubicPath.through(points, gantry.joint_names)
    )
    certificate = certify(curve, checker, parting=[("part", "table")])
    times = np.linspace(*curve.domain, 1000)
    lowest = np.array([q[1] + min(s * 0.1 * np.sin(q[2]) for s in (1, -1)) for q in curve(times)])  # its bottom corners
    if certificate.status is FREE:
        (parting,) = certificate.partings
        rising = lowest[times <= parting.end]
        assert (np.diff(rising) >= -2e-9).all()
        assert (lowest[times >= parting.until] > MARGIN).all()
    elif certificate.status is COLLIDING:
        assert lowest.min() <= MARGIN
        assert checker.clearance(certificate.first_contact.q) <= MARGIN
