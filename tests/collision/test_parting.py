"""Motions that begin in contact: free only if what is carried leaves its support and never approaches it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof._core import Departure, SeparationSettings, separate
from pinproof.collision import Cone, ConvexShape, Ellipsoid, HeightMap
from pinproof.collision.certificates.certificate import Parting
from pinproof.collision.checking.placed_bodies import MeasureByCoal
from pinproof.collision.checking.separation import NO_DIRECTIONS, directions_to_facets
from pinproof.motion import Bezier, CubicPath

from ..examples import examples

FREE, COLLIDING, UNDECIDED = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING, pp.CertificateStatus.UNDECIDED

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


TABLE = pp.Obstacle("table", pp.Box(1.0, 1.0, 0.1), pp.pose((0, 0, -0.05)))
PART = pp.Obstacle("part", pp.Box(0.2, 0.1, 0.1), pp.pose((0, 0, 0.05)))
"""Stands on the table where q is 0."""


def verdict(gantry, *waypoints, sink=0.0, support=TABLE, part=PART, scene=(), **settings):
    checker = pp.CollisionChecker(gantry, pp.Scene([support, *scene]), attached=[part], margin=MARGIN)
    q = np.array(waypoints, dtype=float) - [0, sink, 0]
    return pp.certify(pp.JointPath(q, gantry.joint_names), checker, parting=[("part", "table")], **settings)


@pytest.mark.parametrize("sink", [-0.001, 0.0, 0.0005, 0.00099])
def test_a_vertical_lift_is_free_and_names_its_proof(gantry, sink):
    certificate = verdict(gantry, [0, 0, 0], [0, 0.3, 0], sink=sink)
    assert certificate.status is FREE
    (parting,) = certificate.partings
    assert parting.bodies == ("part", "table")
    assert parting.gap == pytest.approx(-sink, abs=1e-12)
    assert parting.until == pytest.approx((sink + MARGIN) / 0.3, abs=1e-3)
    np.testing.assert_allclose(parting.normal, [0, 0, 1])
    assert "part may touch table until" in str(certificate)
    assert "not to approach along (0, 0, 1)" in str(certificate)
    assert certificate.tube.largest_joints == 0.0
    checker = pp.CollisionChecker(gantry, pp.Scene([TABLE]), attached=[PART], margin=MARGIN)
    lift = pp.JointPath([[0, -sink, 0], [0, 0.3 - sink, 0]], gantry.joint_names)
    assert pp.certify(lift, checker).status is COLLIDING  # without leave to touch


def test_a_lift_that_returns_to_its_support_is_detected(gantry):
    """Two cubic lifts to the same height; one dips below its start."""
    checker = pp.CollisionChecker(gantry, pp.Scene([TABLE]), attached=[PART], margin=MARGIN)
    ends = np.array([[0, 0, 0], [0.05, 0.1, 0.0]])
    for slope, status in ((0.0, FREE), (0.2, FREE), (-0.02, COLLIDING)):
        tangents = np.array([[0, slope, 0], [0, 0, 0]])
        curve = CubicPath(ends, tangents, [0.0, 1.0], gantry.joint_names)
        assert pp.certify(curve, checker, parting=[("part", "table")]).status is status


def test_a_plate_in_the_path_is_detected_on_the_complete_curve(gantry):
    for height, first in ((0.11, 0), (0.2, 0), (0.35, 1)):
        beam = pp.Obstacle("beam", pp.Box(0.02, 1, 0.02), pp.pose((0 if first == 0 else 0.5, 0, height + 0.02)))
        certificate = verdict(gantry, [0, 0, 0], [0, 0.3, 0], [0.6, 0.3, 0], scene=[beam])
        assert certificate.status is COLLIDING
        assert certificate.first_contact.bodies == ("part", "beam")
        assert first <= certificate.first_contact.time < first + 1
    assert verdict(gantry, [0, 0, 0], [0, 0.3, 0], [0.6, 0.3, 0]).status is FREE


def cuboid(x, y, z, hull):
    box = trimesh.creation.box((x, y, z))
    return pp.Mesh.from_arrays(box.vertices, box.faces, hull=hull)


SUPPORTS = {
    "half-space": pp.Obstacle("table", pp.HalfSpace()),
    "cylinder": pp.Obstacle("table", pp.Cylinder(0.5, 0.2), pp.pose((0, 0, -0.1))),
    "hull": pp.Obstacle("table", cuboid(1, 1, 0.2, True), pp.pose((0, 0, -0.1))),
    "mesh": pp.Obstacle("table", cuboid(1, 1, 0.2, False), pp.pose((0, 0, -0.1))),
    "ball": pp.Obstacle("table", pp.Sphere(0.5), pp.pose((0, 0, -0.5))),
}
PARTS = {
    "box": PART,
    "capsule": pp.Obstacle("part", pp.Capsule(0.05, 0.1), pp.pose((0, 0, 0.05), (0, np.pi / 2, 0))),
    "mesh": pp.Obstacle("part", cuboid(0.2, 0.1, 0.1, False), pp.pose((0, 0, 0.05))),
}


@pytest.mark.parametrize("support", SUPPORTS.values(), ids=SUPPORTS)
@pytest.mark.parametrize("part", PARTS.values(), ids=PARTS)
def test_supports_and_parts_of_every_kind(gantry, support, part):
    """Where meshes overlap, the measured normal may be zero or denormal: along it nothing ever approaches."""

    def at(*waypoints, **settings):
        return verdict(gantry, *waypoints, support=support, part=part, **settings).status

    assert at([0, 0, 0], [0, 0.3, 0], sink=0.0002) is FREE
    assert at([0, 0, 0], [0, -0.01, 0], [0, 0.3, 0]) is COLLIDING
    assert at([0, 0, 0], [0.02, 0, 0], sink=0.0002) is not FREE
    for down in (0.0005, 0.01):
        assert at([0, 0, 0], [0, -down, 0], [0, 0.3, 0], sink=0.0002) is not FREE


def test_a_part_that_leaves_sideways_leaves_a_wall(gantry):
    """The direction is that of the contact, not up."""
    wall = pp.Obstacle("table", pp.Box(0.1, 1, 1), pp.pose((-0.15, 0, 0)))
    certificate = verdict(gantry, [0, 0, 0], [0.2, 0, 0], support=wall)
    assert certificate.status is FREE
    np.testing.assert_allclose(certificate.partings[0].normal, [1, 0, 0], atol=1e-12)
    assert verdict(gantry, [0, 0, 0], [0, 0.2, 0], support=wall).status is not FREE
    assert verdict(gantry, [0, 0, 0], [-0.01, 0, 0], [0.3, 0, 0], support=wall).status is COLLIDING


def test_two_supports_are_left_each_in_its_own_direction(gantry):
    """A part in a corner: straight up slides along the wall and never leaves it, aslant leaves both."""
    wall = pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((-0.15, 0, 0)))
    checker = pp.CollisionChecker(gantry, pp.Scene([TABLE, wall]), attached=[PART], margin=MARGIN)
    both = [("part", "table"), ("wall", "part")]
    up, aslant = ([[0, 0, 0], end] for end in ([0, 0.2, 0], [0.2, 0.3, 0]))
    assert pp.certify(pp.JointPath(up, gantry.joint_names), checker, parting=both).status is not FREE
    certificate = pp.certify(pp.JointPath(aslant, gantry.joint_names), checker, parting=both)
    assert certificate.status is FREE
    assert [parting.bodies for parting in certificate.partings] == [("part", "table"), ("part", "wall")]
    assert pp.certify(pp.JointPath(aslant, gantry.joint_names), checker, parting=both[:1]).status is COLLIDING


@pytest.mark.parametrize("tolerance", [0.0, 0.0009])
def test_the_support_is_left_by_the_margin_and_its_tolerance_in_a_lift_of_small_steps(gantry, tolerance):
    ceiling = pp.Obstacle("ceiling", pp.Box(1, 1, 0.02), pp.pose((0, 0, 0.141)))
    steps = np.linspace(0.0, 0.025, 51)
    certificate = verdict(gantry, *([0, z, 0] for z in steps), obstacle_tolerance=tolerance, scene=[ceiling])
    assert certificate.status is FREE
    (parting,) = certificate.partings
    assert parting.until == pytest.approx((MARGIN + tolerance) / 0.0005, abs=1.0)
    nearest = 0.131 - 0.1 - 0.025
    assert nearest - tolerance - 1e-4 <= certificate.clearance <= nearest - tolerance
    assert certificate.clearance <= certificate.observed
    assert certificate.observed == pytest.approx(nearest, abs=1e-6)
    assert certificate.tube.largest_obstacles <= 0.001 - tolerance + 1e-9
    assert verdict(gantry, [0, 0, 0], [0, 0.3, 0], obstacle_tolerance=0.0011).status is COLLIDING


def test_the_observed_distance_is_that_of_all_parts_of_the_motion(gantry):
    """The part is nearest to a wall at the end, after it has been lowered beside its support."""
    wall = pp.Obstacle("wall", pp.Box(0.02, 1, 1), pp.pose((1.015, 0, 0)))
    certificate = verdict(gantry, [0, 0, 0], [0, 0.1, 0], [0.898, 0.1, 0], [0.9, 0.05, 0], scene=[wall])
    assert certificate.status is FREE
    assert MARGIN < certificate.clearance <= certificate.observed == pytest.approx(0.005, abs=1e-6)


def test_invalid_partings_are_refused(gantry):
    checker = pp.CollisionChecker(
        gantry, pp.Scene([TABLE]), attached=[PART, pp.Obstacle("other", pp.Sphere(0.01), pp.pose((0, 0, 1)))]
    )
    move = pp.JointPath([[0, 0, 0], [0, 0.3, 0]], gantry.joint_names)
    with pytest.raises(pp.UnknownNameError, match="cup"):
        pp.certify(move, checker, parting=[("cup", "table")])
    with pytest.raises(pp.InputError, match="one must be an obstacle"):
        pp.certify(move, checker, parting=[("part", "other")])
    with pytest.raises(pp.InputError, match="pair of names"):
        pp.certify(move, checker, parting=("part", "table"))
    with pytest.raises(pp.InputError, match="not checked"):
        pp.certify(move, checker.allowing(("part", "table")), parting=[("part", "table")])
    for setting in ({"joint_tolerance": 1e-3}, {"record": True}):
        with pytest.raises(pp.InputError, match="parting"):
            pp.certify(move, checker, parting=[("part", "table")], **setting)


def test_an_arm_lifts_a_part_off_a_table(ur5):
    """As planned, and timed, from rest; then pressed down by a tenth of a millimetre first."""
    part = pp.Obstacle("part", pp.Box(0.06, 0.06, 0.1), pp.pose((0, 0, 0.05)))
    scene = pp.Scene([pp.Obstacle("table", pp.Box(0.5, 0.5, 0.05), pp.pose((0.65, 0.1, 0.175)))])
    checker = pp.CollisionChecker(ur5, scene, margin=MARGIN, attached=[part], allowed=[("part", "wrist_3_link")])
    leave = checker.allowing(("part", "table"))
    grasp, above, below = (pp.pose((0.45, 0.1, z), (np.pi, 0, 0)) for z in (0.3, 0.4, 0.2999))
    q = next(q for q in pp.AnalyticIk().solve_all(ur5, grasp).q if leave.is_free(q))
    path = pp.plan_linear(leave, q, above).path
    for curve in (path, pp.time_parametrise(path, ur5.limits)):
        certificate = pp.certify(curve, checker, parting=[("part", "table")])
        assert certificate.status is FREE, str(certificate)
        assert certificate.matches(curve, ur5, scene, [part])
        (parting,) = certificate.partings
        assert parting.until < 0.2 * curve.domain[1]
    pressed = pp.plan_linear(leave, q, below).path
    onwards = pp.plan_linear(leave, pressed.end, above).path
    both = CubicPath(
        np.concatenate([pressed.q, onwards.q[1:]]), np.concatenate([pressed.tangents, onwards.tangents[1:]]),
        np.concatenate([pressed.knots, pressed.knots[-1] + onwards.knots[1:]]), ur5.joint_names,
    )  # fmt: skip
    certificate = pp.certify(both, checker, parting=[("part", "table")])
    assert certificate.status is not FREE
    assert certificate.first_contact is None or certificate.first_contact.time < both.domain[1]


@pytest.mark.parametrize("name", ["ur5", "panda"])
@examples(25)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_gap_never_decreases_by_more_than_the_bound(request, name, seed):
    """Along random pieces of every degree, and for a part of any shape: the sampled decrease is at most the bound."""
    arm, rng = request.getfixturevalue(name), np.random.default_rng(seed)
    part = pp.Obstacle(
        "part",
        [pp.Box(0.1, 0.05, 0.2), pp.Cylinder(0.05, 0.3), pp.Capsule(0.02, 0.3)][rng.integers(3)],
        pp.pose((0, 0, 0.2)),
    )
    checker = pp.CollisionChecker(
        arm, pp.Scene([pp.Obstacle("thing", pp.Sphere(0.1), pp.pose(rng.uniform(-1, 1, 3)))]), attached=[part]
    )
    pair = next(
        k
        for k, (i, j) in enumerate(checker.pairs)
        if (checker.bodies[i].owner, checker.bodies[j].owner) == ("part", "thing")
    )
    q = rng.uniform(-2, 2, arm.dof)
    body, _ = checker.pairs[pair]
    normal = rng.normal(size=3)
    departure = Departure(checker.world, body, normal / np.linalg.norm(normal), float(rng.normal()))
    piece = q + rng.choice([0.002, 0.05, 0.5]) * rng.normal(size=(rng.integers(2, 6), arm.dof))
    decrease, motion = departure.decrease(piece)
    gaps = np.array([departure.gap(p) for p in Bezier(np.array([0.0, 1.0]), piece[None]).at(np.linspace(0, 1, 80))])
    assert (np.maximum.accumulate(gaps) - gaps).max() <= decrease + 1e-9
    assert np.ptp(gaps) <= 2 * motion + 1e-9
    if len(piece) == 2 and motion < 0.02:  # and it is no idle bound: it tells a short piece from the same one backwards
        assert min(decrease, departure.decrease(np.ascontiguousarray(piece[::-1]))[0]) < motion


@examples(40)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_free_motion_ever_approaches(gantry, seed):
    """Random curves from the table: a free part rises until it is clear, and stays clear."""
    rng = np.random.default_rng(seed)
    checker = pp.CollisionChecker(gantry, pp.Scene([TABLE]), attached=[PART], margin=MARGIN)
    points = np.cumsum([[0, 0, 0], *(rng.normal(size=(3, 3)) * [0.05, 0.03, 0.05] + [0, 0.02, 0])], axis=0)
    curve = (
        pp.JointPath(points, gantry.joint_names)
        if rng.random() < 0.5
        else CubicPath.through(points, gantry.joint_names)
    )
    certificate = pp.certify(curve, checker, parting=[("part", "table")])
    times = np.linspace(*curve.domain, 1000)
    lowest = np.array([q[1] + min(s * 0.1 * np.sin(q[2]) for s in (1, -1)) for q in curve(times)])  # its bottom corners
    if certificate.status is FREE:
        (parting,) = certificate.partings
        departure = lowest[times <= parting.end]
        assert (np.diff(departure) >= -2e-9).all()
        assert (lowest[times >= parting.until] > MARGIN).all()
    elif certificate.status is COLLIDING:
        assert lowest.min() <= MARGIN
        assert checker.clearance(certificate.first_contact.q) <= MARGIN


# -- several bodies of one owner ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tilter(arm_from_links):
    """Slides along z and tilts about y, with the given bodies of the hand."""

    def build(hand):
        return arm_from_links(
            {"root": "", "mast": "", "hand": hand},
            [
                ("z", "prismatic", "root", "mast", "0 0 0", "0 0 1"),
                ("tilt", "revolute", "mast", "hand", "0 0 0", "0 1 0"),
            ],
        ).arm(tcp="hand")

    return build


PADS = '<box size="0.05 0.05 0.02"/>@-0.2 0 0.01;<box size="0.05 0.05 0.02"/>@0.2 0 0.01'


def hand_over_table(arm, waypoints, support=TABLE, **settings):
    checker = pp.CollisionChecker(arm, pp.Scene([support]), margin=0.001, **settings)
    path = pp.JointPath(waypoints, arm.joint_names)
    return pp.certify(path, checker, parting=[("hand", support.name)]), path, checker


@pytest.mark.parametrize("link_meshes", ["hull", "decomposed"])
def test_the_rise_of_one_body_does_not_excuse_another_of_the_same_link(tilter, mesh_file, link_meshes):
    """One leg of a fork keeps departing while the other is pressed 36 mm into the table; also as parts of one mesh."""
    arm = tilter(PADS)
    if link_meshes == "decomposed":
        legs = [trimesh.creation.box((0.05, 0.05, 0.05)).apply_translation((x, 0, 0.025)) for x in (-0.2, 0.2)]
        bridge = trimesh.creation.box((0.42, 0.04, 0.02)).apply_translation((0, 0, 0.039))
        arm = tilter(f'<mesh filename="{mesh_file(trimesh.util.concatenate([*legs, bridge]))}"/>')
    path = [[0, 0], [0.01, 0], [0.02, 0.25], [0.08, 0.26]]
    certificate, curve, checker = hand_over_table(arm, path, link_meshes=link_meshes)
    assert len(checker.pairs) > 1
    assert certificate.status is COLLIDING, str(certificate)
    assert certificate.first_contact.bodies == ("hand", "table")
    before = curve(np.linspace(1.0, certificate.first_contact.proven_free_until, 200))
    assert checker.clearance_batch(before).min() > 0.001
    assert checker.clearance(certificate.first_contact.q) <= 0.001
    for high in ([[0, 0], [0.1, 0]], [[0, 0], [0.08, 0], [0.16, 0.25]]):
        assert hand_over_table(arm, high, link_meshes=link_meshes)[0].status is FREE
    # The second body begins 0.3 m above the table, and is lowered onto it while the first rises.
    arm = tilter('<box size="0.05 0.05 0.02"/>@-0.02 0 0.01;<box size="0.05 0.05 0.02"/>@0.4 0 0.31')
    assert hand_over_table(arm, [[0, 0], [0.1, 0], [0.2, 1.4]])[0].status is COLLIDING


def test_a_planned_line_is_not_free_because_one_body_of_two_rises(arm_from_links):
    """The hand turns over as it rises: the pad on the table leaves it, a second one sweeps through the table."""
    arm = arm_from_links(
        {
            "root": "",
            "lift": "",
            "slide": "",
            "hand": '<box size="0.05 0.05 0.02"/>@-0.02 0 0.01;<box size="0.05 0.05 0.02"/>@0.4 0 0.05',
            "tip": "",
        },
        [
            ("z", "prismatic", "root", "lift", "0 0 0", "0 0 1"),
            ("x", "prismatic", "lift", "slide", "0 0 0", "1 0 0"),
            ("tilt", "revolute", "slide", "hand", "0 0 0", "0 1 0"),
            ("end", "fixed", "hand", "tip", "0 0 0.1", "0 0 1"),
        ],
    ).arm(tcp="tip")
    checker = pp.CollisionChecker(arm, pp.Scene([TABLE]), margin=0.001)
    above = pp.pose((0, 0, 0.1))
    for target, ok in ((pp.pose((0, 0, 0.03)) * above, True), (pp.pose((0, 0, 0.6), (0, 3.0, 0)) * above, False)):
        move = pp.plan_linear(checker, np.zeros(3), target, parting=[("hand", "table")])
        assert move.ok == ok, move.message
        assert move.certificate is not None
        assert move.certificate.status is (FREE if ok else COLLIDING)


# -- exact meshes that are not convex ----------------------------------------------------------------------------------


def tray(finely=0, hull=False, wall=0.01, floor=0.01):
    """An open bin whose floor is z = 0 and whose rim is at 0.2, with every facet cut in four ``finely`` times."""
    x, y = 0.3, 0.2
    levels = ((x, y, -floor), (x, y, 0.2), (x - wall, y - wall, 0.2), (x - wall, y - wall, 0.0))
    rings = [np.array([[-a, -b, z], [a, -b, z], [a, b, z], [-a, b, z]]) for a, b, z in levels]
    faces = [[0, 2, 1], [0, 3, 2], [12, 13, 14], [12, 14, 15]]
    for k in range(3):
        for i in range(4):
            a, b = 4 * k + i, 4 * k + (i + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    mesh = trimesh.Trimesh(np.concatenate(rings), faces, process=False)
    for _ in range(finely):
        mesh = mesh.subdivide()
    return pp.Mesh.from_arrays(mesh.vertices, mesh.faces, hull=hull)


CUBE = pp.Obstacle("part", pp.Box(0.1, 0.1, 0.1), pp.pose((0, 0, 0.05)))
NEXT_TO_WALL = 0.24
"""Where the cube touches the wall of the tray."""

LIFTS = {  # waypoints, verdict, words of the message, and first and last time of the contact
    "straight up": ([[0, 0, 0], [0, 0.3, 0], [0.6, 0.3, 0]], FREE, "may touch", 0, 0),
    "from 0.3 mm deep": ([[0, -0.0003, 0], [0, 0.3, 0]], FREE, "may touch", 0, 0),
    "from 0.5 mm above": ([[0, 0.0005, 0], [0, 0.3, 0]], FREE, "may touch", 0, 0),
    "from 1.1 mm deep": ([[0, -0.0011, 0], [0, 0.3, 0]], COLLIDING, "part penetrates table by 1.10 mm", 0, 0),
    "from 2 mm deep": ([[0, -0.002, 0], [0, 0.3, 0]], COLLIDING, "part penetrates table by 2.00 mm", 0, 0),
    "tilted as it rises": ([[0, 0, 0], [0, 0.1, 0.3], [0, 0.3, 0.3]], FREE, "may touch", 0, 0),
    "dragged, then up": ([[0, 0, 0], [0.1, 0, 0], [0.1, 0.3, 0]], FREE, "may touch", 0, 0),
    "not by the margin": ([[0, 0, 0], [0, 0.9 * MARGIN, 0]], COLLIDING, "does not depart before the end", 0, 1),
    "by a little more": ([[0, 0, 0], [0, 1.1 * MARGIN, 0]], FREE, "may touch", 0, 0),
    "pressed down 1 um": ([[0, 0, 0], [0, -1e-6, 0], [0, 0.3, 0]], COLLIDING, "approaches again", 0, 1),
    "pressed down 0.1 mm": ([[0, 0, 0], [0, -1e-4, 0], [0, 0.3, 0]], COLLIDING, "approaches again", 0, 1),
    "pressed down": ([[0, 0, 0], [0, -0.01, 0], [0, 0.3, 0]], COLLIDING, "approaches again", 0, 1),
    "an edge tilted down": ([[0, 0, 0], [0, 0.01, 0.3], [0, 0.3, 0.3]], COLLIDING, "", 0, 1),
    "an edge tilted down at last": ([[0, 0.0005, 0], [0, 0.0105, 0.3]], COLLIDING, "", 0, 1),
    "dragged": ([[0, 0, 0], [0.1, 0, 0]], COLLIDING, "does not depart before the end", 0, 1),
    "set down again": ([[0, 0, 0], [0, 0.1, 0], [0.1, 0.0005, 0]], COLLIDING, "", 1.9, 2),
}
IN_A_BIN = {
    "aslant off the wall": ([[NEXT_TO_WALL, 0, 0], [0.2, 0.3, 0]], FREE, "may touch", 0, 0),
    "up along the wall": (
        [[NEXT_TO_WALL - 0.005, 0, 0], [NEXT_TO_WALL - 0.005, 0.3, 0]], FREE, "may touch", 0, 0,
    ),
    "against the rim": ([[0, 0, 0], [0, 0.3, 0], [0.6, 0.1, 0]], COLLIDING, "", 1, 2),
    "into the wall": ([[0, 0, 0], [0.1, 0.02, 0], [0.3, 0.03, 0]], COLLIDING, "", 1, 2),
}  # fmt: skip
BINS = {"box": TABLE, "bin": pp.Obstacle("table", tray()), "bin of small facets": pp.Obstacle("table", tray(2))}
CASES = {
    f"{lift}, {kind}": (row, bin_)
    for kind, bin_ in BINS.items()
    for lift, row in (LIFTS if kind == "box" else LIFTS | IN_A_BIN).items()
}


@pytest.mark.parametrize(("lift", "support"), CASES.values(), ids=CASES)
def test_a_part_is_lifted_off_a_table_and_out_of_a_bin_of_any_facets(gantry, lift, support):
    """Too deep in a bin, its depth is reported, not that in the bin's hull."""
    waypoints, expected, words, first, last = lift
    certificate = verdict(gantry, *waypoints, support=support, part=CUBE)
    assert certificate.status is expected, str(certificate)
    assert words in str(certificate)
    if expected is FREE:
        shown = certificate.partings[0]
        assert shown.bodies == ("part", "table")
        assert shown.until < 1.1
        alone = pp.CollisionChecker(gantry, pp.Scene([support]), attached=[CUBE])
        curve = pp.JointPath(np.array(waypoints, dtype=float), gantry.joint_names)
        after = curve(np.linspace(max(each.until for each in certificate.partings), curve.domain[1], 300))
        assert alone.clearance_batch(after).min() > MARGIN
        return
    contact = certificate.first_contact
    assert contact.bodies == ("part", "table")
    assert first <= contact.time <= last
    assert contact.distance < MARGIN
    if "penetrates" in words:
        assert contact.distance == pytest.approx(waypoints[0][1], abs=1e-6)


@pytest.mark.parametrize("finely", [0, 2])
@pytest.mark.parametrize("top", [0.0, -0.0005, -0.003])
@pytest.mark.parametrize("end", [[0, -0.2, 0], [0, -0.01, 0], [0.2, 0, 0], [0, 0.5, 0], [0, -0.5, 0]])
def test_a_part_inside_the_solid_never_leaves_it(gantry, finely, top, end):
    """Its top face is at the surface, from below: what it moves away from is the outside."""
    block = pp.Obstacle("table", tray(finely, floor=0.4))
    inside = verdict(gantry, [0, top - 0.1, 0], np.add([0, top - 0.1, 0], end), support=block, part=CUBE)
    assert inside.status is not FREE, str(inside)


def test_a_part_leaves_both_sides_of_a_groove(gantry):
    """A cylinder in a V of 90 degrees touches both flanks, each is left along its own normal."""
    outline = np.array([[-0.2, -0.1], [0.2, -0.1], [0.2, 0.1], [0.1, 0.1], [0.0, 0.0], [-0.1, 0.1], [-0.2, 0.1]])
    around = [(i, (i + 1) % 7) for i in range(7)]
    ends = [[0, 1, 4], [1, 2, 3], [1, 3, 4], [0, 4, 5], [0, 5, 6]]
    vertices = np.concatenate([np.column_stack([outline[:, 0], np.full(7, y), outline[:, 1]]) for y in (-0.2, 0.2)])
    faces = [*ends, *([c + 7, b + 7, a + 7] for a, b, c in ends)]
    for a, b in around:
        faces += [[b, a, a + 7], [b, a + 7, b + 7]]
    groove = pp.Obstacle("table", pp.Mesh.from_arrays(vertices, np.array(faces), hull=False))
    radius = 0.04
    rod = pp.Obstacle("part", pp.Cylinder(radius, 0.2), pp.pose((0, 0, np.sqrt(2) * radius), (np.pi / 2, 0, 0)))
    up = verdict(gantry, [0, 0, 0], [0, 0.3, 0], support=groove, part=rod)
    assert up.status is FREE, str(up)
    normals = sorted(tuple(np.round(each.normal, 6)) for each in up.partings)
    assert normals == [(-0.707107, 0.0, 0.707107), (0.707107, 0.0, 0.707107)]
    assert verdict(gantry, [0, 0, 0], [0.1, 0.05, 0], support=groove, part=rod).status is COLLIDING
    along_a_flank = [[0, 0, 0], [0.15, 0.15, 0], [0.15, 0.3, 0]]
    assert verdict(gantry, *along_a_flank, support=groove, part=rod).status is FREE


def test_a_support_that_is_hollow_or_made_of_points_is_left_too(gantry):
    cloud = pp.PointCloud(np.stack(np.meshgrid(*[np.linspace(-0.2, 0.2, 81)] * 2, [-0.0025]), -1).reshape(-1, 3), 0.005)
    for support in (pp.Obstacle("table", cloud), pp.Obstacle("table", HeightMap(np.zeros((9, 9)), 0.8, 0.8))):
        up = verdict(gantry, [0, 0, 0], [0, 0.3, 0], support=support, part=CUBE)
        assert up.status is FREE, str(up)
        assert verdict(gantry, [0, 0, 0], [0, -0.01, 0], [0, 0.3, 0], support=support, part=CUBE).status is COLLIDING


def test_several_supports_at_once(gantry):
    """Across two rails, one an exact mesh, against a stop that is a bin's wall."""
    rails = [pp.Obstacle("left", pp.Box(0.02, 0.3, 0.1), pp.pose((-0.04, 0, -0.05)))]
    rails.append(pp.Obstacle("right", cuboid(0.02, 0.3, 0.1, False), pp.pose((0.04, 0, -0.05))))
    stop = pp.Obstacle("stop", tray(1), pp.pose((-0.29 + 0.05, 0, -0.1)))
    checker = pp.CollisionChecker(gantry, pp.Scene([*rails, stop]), attached=[CUBE], margin=MARGIN)
    names = [("part", "left"), ("right", "part"), ("part", "stop")]
    aslant = pp.JointPath([[0, 0, 0], [-0.05, 0.3, 0]], gantry.joint_names)
    free = pp.certify(aslant, checker, parting=names)
    assert free.status is FREE, str(free)
    assert {each.bodies[1] for each in free.partings} == {"left", "right", "stop"}
    assert pp.certify(aslant, checker, parting=names[:2]).status is COLLIDING


@pytest.mark.parametrize("finely", [0, 2])
@pytest.mark.parametrize("sink", [0.0, 0.0005, -0.0005])
def test_directions_to_facets_are_the_normals_of_floor_and_wall(gantry, finely, sink):
    checker = pp.CollisionChecker(gantry, pp.Scene([pp.Obstacle("table", tray(finely))]), attached=[CUBE])
    (pair,) = (k for k, (i, j) in enumerate(checker.pairs) if checker.bodies[j].owner == "table")

    def directions(x, z):
        found = directions_to_facets(checker, pair, np.array([x, z, 0.0]), 0.001)
        return {tuple(np.round(direction, 9) + 0.0) for direction in found}

    assert directions(NEXT_TO_WALL - 0.0003, -sink) >= {(0, 0, -1), (1, 0, 0)}
    assert directions(0, -sink) == {(0, 0, -1)}
    assert directions(0, 0.01) == set()


@pytest.mark.parametrize("sink", [0.0, 0.0005])
def test_a_ball_between_two_edges_leaves_each_in_its_own_direction(gantry, sink):
    """A ball rests on the edges of two bars, farther below their upper sides than a contact may be deep."""
    bars = [trimesh.creation.box((0.1, 1.0, 0.1)).apply_translation((x, 0, -0.05)) for x in (-0.08, 0.08)]
    both = trimesh.util.concatenate(bars)
    support = pp.Obstacle("table", pp.Mesh.from_arrays(np.asarray(both.vertices), np.asarray(both.faces), hull=False))
    ball = pp.Obstacle("part", pp.Sphere(0.05), pp.pose((0, 0, 0.04)))
    assert verdict(gantry, [0, 0, 0], [0, 0.1, 0], sink=sink, support=support, part=ball).status is FREE
    assert verdict(gantry, [0, 0, 0], [0.03, 0.015, 0], sink=sink, support=support, part=ball).status is not FREE


def test_a_part_whose_hull_contains_its_support_is_undecided(gantry):
    """A hook on a block: proven of its hull, which overlaps the block, and so not proven."""
    bar = trimesh.creation.box((0.2, 0.1, 0.03)).apply_translation((0, 0, 0.115))
    leg = trimesh.creation.box((0.03, 0.09, 0.11)).apply_translation((-0.085, 0, 0.055))
    both = trimesh.util.concatenate([bar, leg])
    hook = pp.Obstacle("part", pp.Mesh.from_arrays(both.vertices, both.faces, hull=False))
    block = pp.Obstacle("table", pp.Box(0.1, 0.2, 0.1), pp.pose((0.05, 0, 0.05)))
    certificate = verdict(gantry, [0, 0, 0], [0, 0.3, 0], support=block, part=hook)
    assert certificate.status is UNDECIDED
    assert "convex hull of part" in certificate.message
    assert certificate.undecided.bodies == ("part", "table")


@pytest.mark.parametrize("inverted", [False, True])
def test_a_part_of_overlapping_bodies_separates_from_a_body_under_its_hull(gantry, inverted):
    """A bridge over a rail: its hull contains the rail, each of its three bodies leaves the table by itself."""
    boxes = [
        trimesh.creation.box(bounds=bounds)
        for bounds in (
            [(-0.1, -0.05, 0.07), (0.1, 0.05, 0.1)],
            [(-0.1, -0.05, 0.0), (-0.07, 0.05, 0.1)],
            [(0.07, -0.04, 0.0), (0.09, 0.04, 0.09)],
        )
    ]
    if inverted:
        boxes[1].invert()
    bridge = trimesh.util.concatenate(boxes)
    part = pp.Obstacle("part", pp.Mesh.from_arrays(bridge.vertices, bridge.faces))
    rail = pp.Obstacle("rail", pp.Box(0.08, 0.5, 0.06), pp.pose((0, 0, 0.03)))
    lifted = verdict(gantry, [0, 0, 0], [0, 0.3, 0], part=part, scene=[rail])
    assert lifted.status is FREE
    assert [parting.bodies for parting in lifted.partings] == [("part", "table")] * 2  # the two legs
    assert verdict(gantry, [0, 0, 0], [0.2, 0.03, 0], part=part, scene=[rail]).status is COLLIDING


def test_the_note_of_a_parting_states_a_gap_of_zero_without_a_sign() -> None:
    parting = Parting(("part", "table"), np.array([0.0, 0.0, 1.0]), -1e-9, 0.1, 0.2)
    assert "gap 0.00 mm" in str(parting)


def separated(checker, pairs, knots, control, *, near=np.inf, more=NO_DIRECTIONS, deepest=1.0):
    settings = SeparationSettings(near, deepest, 0.0, 1e-4, 5000)
    return separate(checker.world, np.array(pairs), knots, control, settings, more)


def test_only_unit_vectors_are_directions_of_separation(gantry) -> None:
    """Along any other, a gap would be no distance, and nothing ever approaches."""
    checker = pp.CollisionChecker(gantry, pp.Scene([TABLE]), attached=[PART])
    (pair,) = checker.pairs_of_owners("part", "table")
    control = np.array([[[0.0, 0.0, 0.0], [0.0, -0.1, 0.0]]])  # pressed down
    rows = [[0, 0, 0], [np.nan, 0, 0], [0, 2, 0], [0, 1e-160, 0], [0, 0.5, 0]]
    (found,) = separated(checker, [pair], np.array([0.0, 1.0]), control, more=np.array(rows, dtype=float))
    assert [group.proof.until for group in found.groups] == [np.inf]
    slanted = np.array([[0.6, 0.0, 0.8 + 4e-7]])
    control[0, :, 1] = -0.05, 0.1  # from below the surface, so that no axis separates them at first
    control[0, 1, 0] = 1.0
    (found,) = separated(checker, [pair], np.array([0.0, 1.0]), control, more=slanted)
    assert all(np.linalg.norm(group.normal) == pytest.approx(1.0, abs=1e-15) for group in found.groups)


def reach_in(body, at, directions):
    """The largest extent of a convex body at a placement along directions (d, 3), by its support function."""
    return directions @ at[:3, 3] + body.support.reach(directions @ at[:3, :3])


@pytest.mark.parametrize("name", ["ur5", "panda"])
@examples(60)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_pairs_separate_as_numpy_and_coal_find(request, name, seed):
    """Parts of any shape beside obstacles of any shape, on random pieces of curves, against dense samples."""
    arm, rng = request.getfixturevalue(name), np.random.default_rng(seed)
    shapes = [pp.Box(0.1, 0.05, 0.2), pp.Cylinder(0.05, 0.3), pp.Capsule(0.02, 0.3), pp.Sphere(0.08)]
    shapes += [Ellipsoid(0.05, 0.1, 0.15), Cone(0.06, 0.2), ConvexShape(rng.normal(size=(9, 3)) * 0.08)]
    part = pp.Obstacle("part", shapes[rng.integers(len(shapes))], pp.pose((0, 0, 0.2)))
    q = rng.uniform(-2, 2, arm.dof)
    near = arm.forward_kinematics(q) * pp.pose(
        rng.uniform([-0.15, -0.15, 0.05], [0.15, 0.15, 0.35]), rng.uniform(-3, 3, 3)
    )
    ground = pp.Obstacle("ground", pp.HalfSpace(), pp.pose((0, 0, near.translation[2] - 0.15)))
    thing = pp.Obstacle("thing", shapes[rng.integers(len(shapes))], near)
    checker = pp.CollisionChecker(arm, pp.Scene([thing, ground]), attached=[part], margin=0.001)
    pairs = [*checker.pairs_of_owners("part", "thing"), *checker.pairs_of_owners("part", "ground")]
    steps = rng.choice([0.01, 0.1, 0.4]) * rng.normal(size=(3, 4, arm.dof)) * rng.choice([0.2, 1.0], size=(3, 1, 1))
    control = q + np.cumsum(steps.reshape(-1, arm.dof), axis=0).reshape(3, 4, arm.dof)
    control[0, 0] = q
    control[1:, 0] = control[:-1, -1]  # it does not jump
    knots = np.array([0.0, 1.0, 2.5, 3.0])
    coals = -rng.normal(size=(4, 3))
    coals /= np.linalg.norm(coals, axis=1)[:, None]
    required = 0.001 + 2 * checker.rounding
    for pair, found in zip(pairs, separated(checker, pairs, knots, control, more=coals), strict=True):
        a, b = checker.indices_of(pair)
        body, other = checker.bodies[a], checker.bodies[b]
        at, still = checker._placed(q).root_from_body(a), other.link_from_body.homogeneous
        measured = checker._placed(q).measure(pair)
        assert found.overlaps == (measured.proven <= 0)
        # The candidates, and their gaps by the support functions.
        axes = still[:3, :3].T
        tried = np.array([[0.0, 0.0, 1.0], *axes, *-axes, *coals])
        if not found.overlaps:
            tried = np.concatenate([tried, -measured.normal[None]])
        if other.support is None:
            tried = axes[2:]
        levels = tried @ still[:3, 3] if other.support is None else reach_in(other, still, tried)
        gaps = -reach_in(body, at, -tried) - levels
        assert found.gap == pytest.approx(gaps.max(), abs=1e-9)
        (group,) = found.groups
        chosen = int(np.abs(tried - group.normal).sum(axis=1).argmin())
        # A distance that is exact to 1e-9 determines the normal of a round body to the root of that
        measured_normal = len(tried) - 1 if not found.overlaps and other.support is not None else -1
        np.testing.assert_allclose(tried[chosen], group.normal, atol=2e-4 if chosen == measured_normal else 1e-9)
        along = group.normal[None]
        level = along @ still[:3, 3] if other.support is None else reach_in(other, still, along)
        assert group.level == pytest.approx(level[0], abs=1e-9)
        assert group.gap == pytest.approx((-reach_in(body, at, -along) - level)[0], abs=1e-9)
        assert group.gap == pytest.approx(gaps[chosen], abs=1e-8)
        assert group.gap >= min(gaps.max(), 0.0) - 2e-9
        # Until the end of the proof it does not approach; after `until`, coal finds them apart.
        curve, proof = Bezier(knots, control), group.proof
        times = np.linspace(knots[0], proof.end, 200)
        sampled = curve.at(times)
        along = []
        for each in sampled:
            placed = checker._placed(each).root_from_body(a)
            along.append(float(-reach_in(body, placed, -group.normal[None])[0] - group.level))
            if each is not sampled[0] and times[len(along) - 1] >= proof.until:
                assert along[-1] > required - 1e-9
                assert MeasureByCoal()(body, placed, other, still).distance > 0.001
        assert (np.maximum.accumulate(along) - along).max() <= 2e-9
        assert group.slack == pytest.approx(along[-1] - required, abs=1e-9)
        if proof.until == np.inf:  # then no other direction separates them either, or has a longer span
            for k in np.flatnonzero(gaps >= min(gaps.max(), 0.0)):
                alone = separated(checker, [pair], knots, control, more=tried[k : k + 1])[0].groups[0]
                assert alone.proof.until == np.inf
        # A pair that is farther apart than is close needs no direction.
        for margin in (0.999, 1.001):
            beyond = margin * (measured.proven - required)
            if measured.proven > required + 0.001:
                (near,) = separated(checker, [pair], knots, control, near=beyond, more=coals)
                assert near.far == (margin < 1)
