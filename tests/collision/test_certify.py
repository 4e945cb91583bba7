"""Certificates: FREE is proven, COLLIDING has a first contact, UNDECIDED an interval; unsound shortcuts have tests."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.errors import NotProvenFree
from pinproof.motion import CubicPath

FREE, COLLIDING, UNDECIDED = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING, pp.CertificateStatus.UNDECIDED


# -- where a body is ---------------------------------------------------------------------------------------------------


def hollow_box(mesh_file, kind):
    if kind == "walls":
        walls = []
        for axis in range(3):
            for side in (-0.5, 0.5):
                size, at = [2.4, 2.4, 2.4], [0.0, 0.0, 0.0]
                size[axis], at[axis] = 1e-3, 2.4 * side
                walls.append(pp.Obstacle(f"wall_{axis}_{side}", pp.Box(*size), pp.pose(at)))
        return pp.Scene(walls)
    return pp.Scene([pp.Obstacle("room", pp.Mesh(mesh_file(trimesh.creation.box((2.4, 2.4, 2.4))), hull=False))])


def test_a_body_inside_thin_walls_is_free_and_inside_a_solid_collides(ur5, mesh_file, path):
    move = path(ur5, ur5.home, ur5.home + np.array([0.5, 0.1, 0.1, 0, 0, 0]))
    assert pp.certify(move, pp.CollisionChecker(ur5, hollow_box(mesh_file, "walls"))).status is FREE
    certificate = pp.certify(move, pp.CollisionChecker(ur5, hollow_box(mesh_file, "solid")))
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == 0.0
    assert certificate.first_contact.penetrating


# -- grazes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [-1e-3, -1e-4, -1e-6, 0.0, 1e-7, 1e-6, 1e-5, 1e-4, 5e-4])
@pytest.mark.parametrize("margin", [0.0, 0.002])
def test_a_graze_is_never_judged_wrongly(slider, gap, margin, path):
    """A ball of 1 cm slides past another at a known least distance of margin + gap."""
    beside = pp.Obstacle("other", pp.Sphere(0.05), pp.pose((0.123, 0.06 + margin + gap, 0)))
    certificate = pp.certify(path(slider, [0.0], [0.5]), pp.CollisionChecker(slider, pp.Scene([beside]), margin=margin))
    assert certificate.status is not (FREE if gap <= 0 else COLLIDING)
    if gap >= 1.2e-4:
        assert certificate.status is FREE
        assert margin < certificate.clearance <= margin + gap
    if gap <= -1e-4:
        assert certificate.status is COLLIDING
    if certificate.status is UNDECIDED:
        assert certificate.undecided.bodies == ("ball", "other")
        assert certificate.undecided.start <= 0.246 + 0.02
        assert certificate.undecided.end >= 0.246 - 0.02
        with pytest.raises(NotProvenFree, match="tolerance"):
            certificate.or_raise()


def test_a_contact_that_begins_exactly_at_a_knot_is_reported(slider):
    """The intervals shrink at the wall from the left; the contact behind it must still be found."""
    wall = pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((0.1 + 0.01 + 0.05, 0, 0)))])
    certificate = pp.certify(pp.JointPath([[0.0], [0.1], [0.3]], slider.joint_names), pp.CollisionChecker(slider, wall))
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies == ("ball", "wall")
    assert certificate.first_contact.time == pytest.approx(1.0, abs=0.02)
    assert certificate.first_contact.proven_free_until <= certificate.first_contact.time


def test_a_smaller_tolerance_decides_a_graze(slider, path):
    beside = pp.Scene([pp.Obstacle("other", pp.Sphere(0.05), pp.pose((0.123, 0.06 + 2e-8, 0)))])
    checker = pp.CollisionChecker(slider, beside)
    move = path(slider, [0.0], [0.5])
    assert pp.certify(move, checker, tolerance=1e-3).status is UNDECIDED
    assert pp.certify(move, checker, tolerance=1e-8).status is FREE


def test_a_result_proven_at_the_tolerance_is_accepted(slider, path):
    """Free by 1.5 tolerances: less than the share of the clearance that is aimed at, and proven all the same."""
    beside = pp.Scene([pp.Obstacle("wall", pp.Box(2, 0.1, 0.1), pp.pose((0, 0.06 + 1.5e-4, 0)))])
    certificate = pp.certify(path(slider, [0.0], [0.3]), pp.CollisionChecker(slider, beside))
    assert certificate.status is FREE
    assert 0 < certificate.clearance <= 1.5e-4


# -- curves ------------------------------------------------------------------------------------------------------------


def test_a_full_rotation_with_equal_ends_is_checked(planar_2r, path, first_touch):
    peg = pp.Scene([pp.Obstacle("peg", pp.Sphere(0.02), pp.pose((-0.9, 0, 0.03)))])
    checker = pp.CollisionChecker(planar_2r, peg)
    long_way = path(planar_2r, [0, 0], [2 * np.pi, 0])
    certificate = pp.certify(long_way, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(checker, long_way), abs=1e-3)
    assert pp.certify(path(planar_2r, [0, 0], [0, 0]), checker).status is FREE


def test_a_cubic_that_swings_out_and_returns_is_not_judged_by_its_ends(slider, first_touch):
    knots, rest = [0.0, 1.0], np.zeros((2, 1))
    swing = CubicPath(rest, [[2.0], [-2.0]], knots, slider.joint_names)  # reaches 0.5 at the middle
    assert swing(0.5)[0] == pytest.approx(0.5)
    wall = [pp.Obstacle("wall", pp.Box(0.01, 1, 1), pp.pose((x, 0, 0))) for x in (0.4, 0.55)]
    near, far = (pp.CollisionChecker(slider, pp.Scene([w])) for w in wall)
    certificate = pp.certify(swing, near)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(near, swing), abs=1e-3)
    assert pp.certify(swing, far).status is FREE
    assert pp.certify(swing, far).clearance <= 0.035


def test_a_cubic_is_not_judged_by_its_ends_and_middle_only(slider, first_touch):
    """Ends and middle are the same configuration; between them the slide goes 0.19 m out on either side."""
    swing = CubicPath(np.zeros((2, 1)), [[2.0], [2.0]], [0.0, 1.0], slider.joint_names)
    assert swing(0.0) == swing(0.5) == swing(1.0) == 0.0
    for x in (-0.15, 0.15):
        checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("wall", pp.Box(0.01, 1, 1), pp.pose((x, 0, 0)))]))
        certificate = pp.certify(swing, checker)
        assert certificate.status is COLLIDING
        assert certificate.first_contact.time == pytest.approx(first_touch(checker, swing), abs=1e-3)


@pytest.mark.parametrize("count", [1, 2])
def test_a_path_of_length_zero_is_checked_at_its_configuration(slider, count, path):
    wall = pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((0.3, 0, 0)))])
    checker = pp.CollisionChecker(slider, wall)
    free = pp.certify(path(slider, *[[0.0]] * count), checker)
    assert free.status is FREE
    assert 0.12 <= free.clearance <= 0.24 + 1e-9
    assert free.intervals == 1
    touching = pp.certify(path(slider, *[[0.3]] * count), checker)
    assert touching.status is COLLIDING
    assert touching.first_contact.time == 0.0


def test_a_start_and_an_end_in_contact_are_shown(slider, path):
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((0.3, 0, 0)))]))
    start = pp.certify(path(slider, [0.3], [0.0]), checker)
    assert (start.status, start.first_contact.time, start.first_contact.proven_free_until) == (COLLIDING, 0.0, 0.0)
    end = pp.certify(path(slider, [0.0], [0.24 - 1e-9]), pp.CollisionChecker(slider, checker.scene, margin=1e-6))
    assert end.status is COLLIDING
    assert end.first_contact.time == pytest.approx(1.0, abs=1e-3)
    assert end.first_contact.proven_free_until > 0.99


def test_the_first_contact_is_the_first(ur5, path, first_touch, assert_free_until):
    """Two pegs on the path; also on the same motion as a timed trajectory, whose parameter is seconds."""
    pan, start = np.eye(6)[0], ur5.home
    end = start + 1.6 * pan
    on_the_way = [ur5.forward_kinematics(start + angle * pan) for angle in (1.2, 0.7)]
    pegs = [pp.Obstacle(f"peg_{i}", pp.Sphere(0.01), at * pp.pose((0, 0, 0.03))) for i, at in enumerate(on_the_way)]
    tool = pp.Obstacle("tool", pp.Cylinder(0.01, 0.08), pp.pose((0, 0, 0.041)))
    checker = pp.CollisionChecker(ur5, pp.Scene(pegs), margin=0.002, attached=[tool])
    straight = path(ur5, start, end)
    timed = pp.Trajectory([0.0, 2.0], np.stack([start, end]), np.zeros((2, 6)), ur5.joint_names)
    for curve in (straight, timed):
        certificate = pp.certify(curve, checker)
        contact = certificate.first_contact
        assert certificate.status is COLLIDING
        assert contact.bodies[1] == "peg_1"
        expected = first_touch(checker, curve)
        assert contact.time == pytest.approx(expected, abs=2e-3)
        assert contact.proven_free_until <= expected + 1e-9
        assert expected - contact.proven_free_until < 2e-3
        np.testing.assert_allclose(contact.q, curve(contact.time), atol=1e-12)
        assert contact.distance <= checker.margin
        assert checker.clearance(contact.q) == pytest.approx(contact.distance, abs=1e-9)
        assert_free_until(checker, curve, contact.proven_free_until, 200)


def test_prismatic_and_revolute_joints_together(arm_from_links, path, first_touch):
    robot = arm_from_links(
        {
            "rail": '<box size="2 0.1 0.1"/>@0 0 -0.2',
            "cart": '<box size="0.1 0.1 0.1"/>',
            "arm": '<capsule radius="0.02" length="0.4"/>@0 0 0.25',
            "tip": "",
        },
        [
            ("slide", "prismatic", "rail", "cart", "0 0 0", "1 0 0"),
            ("turn", "revolute", "cart", "arm", "0 0 0.05", "0 1 0"),
            ("end", "fixed", "arm", "tip", "0 0 0.5", "0 0 1"),
        ],
    )
    arm = robot.arm(tcp="tip")
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("post", pp.Box(0.01, 0.01, 1), pp.pose((0.9, 0, 0.4)))]))
    upright, tilting = path(arm, [0, 0], [0.7, 0]), path(arm, [0, 0], [0.7, 0.9])
    free = pp.certify(upright, checker)
    assert free.status is FREE
    assert free.clearance <= checker.clearance(upright.end)
    colliding = pp.certify(tilting, checker)
    assert colliding.status is COLLIDING
    assert colliding.first_contact.bodies == ("arm", "post")
    assert colliding.first_contact.time == pytest.approx(first_touch(checker, tilting), abs=1e-3)


def test_the_arm_against_itself(ur5, path, first_touch):
    """The elbow folds until the wrist meets the upper arm."""
    folding = path(ur5, ur5.home, [0, -1.5, 3.1, -1.5, -1.5, 0])
    certificate = pp.certify(folding, pp.CollisionChecker(ur5))
    assert certificate.status is COLLIDING
    assert "upper_arm_link" in certificate.first_contact.bodies
    assert certificate.first_contact.time == pytest.approx(first_touch(pp.CollisionChecker(ur5), folding), abs=1e-3)


def test_a_mimic_follower_sweeps(arm_from_links, path):
    """The follower turns three times as far as its leader, past a peg that samples at the ends miss."""
    bar = '<box size="0.02 0.02 0.3"/>@0 0 0.15'
    robot = arm_from_links(
        {"root": "", "a": '<sphere radius="0.01"/>', "b": bar, "tip": ""},
        [("lead", "revolute", "root", "a", "0 0 0", "1 0 0"), ("end", "fixed", "a", "tip", "0 0 0.1", "1 0 0")],
        '<joint name="follow" type="revolute"><parent link="root"/><child link="b"/><origin xyz="0.5 0 0"/>'
        '<axis xyz="1 0 0"/><limit lower="-7" upper="7" velocity="1" effort="1"/>'
        '<mimic joint="lead" multiplier="3"/></joint>',
    )
    arm = robot.arm(tcp="tip")
    angle = 1.62  # of the follower: the bar is 0.9 rad in the middle, 1.8 rad at the end of the edge
    peg = pp.Obstacle("peg", pp.Sphere(0.01), pp.pose((0.5, -0.25 * np.sin(angle), 0.25 * np.cos(angle))))
    checker = pp.CollisionChecker(arm, pp.Scene([peg]))
    for lead in (0.0, 0.3, 0.6):
        assert checker.clearance([lead]) > 0.02
    assert pp.certify(path(arm, [0.0], [0.6]), checker).status is COLLIDING
    assert pp.certify(path(arm, [0.0], [0.5]), checker).status is FREE


def test_a_held_body_that_does_not_move_is_checked(arm_from_links, path):
    """A second branch, outside the arm, is in an obstacle: no joint of the arm moves it."""
    ball = '<sphere radius="0.05"/>'
    robot = arm_from_links(
        {"root": "", "arm": ball, "tip": "", "other": ball},
        [
            ("turn", "revolute", "root", "arm", "0 0 0", "0 0 1"),
            ("end", "fixed", "arm", "tip", "0 0 0.1", "0 0 1"),
            ("aside", "prismatic", "root", "other", "0 1 0", "0 1 0"),
        ],
    )
    post = pp.Scene([pp.Obstacle("post", pp.Sphere(0.05), pp.pose((0, 1.5, 0)))])
    for held, status in ((0.0, FREE), (0.41, COLLIDING), (0.4 - 1e-9, UNDECIDED)):
        arm = robot.arm(tcp="tip", held={"aside": held})
        certificate = pp.certify(path(arm, [0.0], [1.0]), pp.CollisionChecker(arm, post))
        assert certificate.status is status, str(certificate)


def test_a_contact_outweighs_a_pair_that_stays_undecided(arm_from_links, path):
    ball = '<sphere radius="0.05"/>'
    robot = arm_from_links(
        {"root": "", "arm": ball, "tip": "", "other": ball},
        [
            ("go", "prismatic", "root", "arm", "0 0 0", "1 0 0"),
            ("end", "fixed", "arm", "tip", "0 0 0.1", "0 0 1"),
            ("aside", "prismatic", "root", "other", "0 1 0", "0 1 0"),
        ],
    )
    things = [
        pp.Obstacle("post", pp.Sphere(0.05), pp.pose((0, 1.1 + 1e-9, 0))),
        pp.Obstacle("wall", pp.Sphere(0.1), pp.pose((1, 0, 0))),
    ]
    arm = robot.arm(tcp="tip")
    certificate = pp.certify(path(arm, [0.0], [1.0]), pp.CollisionChecker(arm, pp.Scene(things)))
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies == ("arm", "wall")


# -- the certificate ---------------------------------------------------------------------------------------------------


def test_a_spent_budget_is_undecided_and_reported(ur5, path):
    certificate = pp.certify(path(ur5, ur5.home, ur5.home + 0.5), pp.CollisionChecker(ur5), max_intervals=1)
    assert certificate.status is UNDECIDED
    assert "max_intervals" in certificate.message


def test_an_arm_without_any_body_is_free_at_any_distance(arm_from_links, path):
    links = {"root": "", "carried": "", "tip": ""}
    slide, end = (
        ("slide", "prismatic", "root", "carried", "0 0 0", "1 0 0"),
        ("end", "fixed", "carried", "tip", "0 0 0", "1 0 0"),
    )
    arm = arm_from_links(links, [slide, end]).arm(tcp="tip")
    certificate = pp.certify(path(arm, [0.0], [0.5]), pp.CollisionChecker(arm))
    assert certificate.status is FREE
    assert certificate.clearance == np.inf
    assert certificate.pairs == 0


def test_nothing_to_check_is_free_at_any_distance(slider, path):
    certificate = pp.certify(path(slider, [0.0], [1.0]), pp.CollisionChecker(slider))
    assert certificate.status is FREE
    assert certificate.clearance == np.inf
    assert certificate.pairs == 0


def test_excluded_pairs_are_listed_with_the_reason(panda, path):
    scene = pp.Scene(
        [pp.Obstacle("table", pp.Box(1, 1, 0.1), pp.pose((0, 0, -0.05)))], allowed=[("panda_link0", "table")]
    )
    certificate = pp.certify(path(panda, panda.home, panda.home), pp.CollisionChecker(panda, scene, margin=0.001))
    listed = {frozenset(pair.owners): pair.reason for pair in certificate.excluded}
    assert listed[frozenset(("panda_link0", "table"))] == "allowed by the scene"
    assert listed[frozenset(("panda_link5", "panda_link6"))] == "adjacent: joined by a joint"
    assert frozenset(("panda_link5", "panda_link7")) not in listed
    assert certificate.margin == 0.001


def test_a_certificate_matches_only_its_own_motion_and_setup(ur5, slider, path):
    scene, move = (
        pp.Scene([pp.Obstacle("ball", pp.Sphere(0.1), pp.pose((2, 0, 0)))]),
        path(ur5, ur5.home, ur5.home + 0.1),
    )
    certificate = pp.certify(move, pp.CollisionChecker(ur5, scene))
    assert certificate.matches(move, ur5, scene)
    assert certificate.matches(path(ur5, *move.q), ur5, pp.Scene(scene.obstacles))
    assert not certificate.matches(move.reversed(), ur5, scene)
    assert not certificate.matches(move, ur5, pp.Scene())
    assert not certificate.matches(move, ur5, pp.Scene(scene.obstacles, allowed=[("base_link", "ball")]))
    assert not certificate.matches(move, ur5.robot.arm(tcp="ee_link"), scene)


def test_other_collision_geometry_is_another_setup(arm_from_links, path):
    certificates, arms = [], []
    for radius in (0.01, 0.02):
        robot = arm_from_links(
            {"root": "", "ball": f'<sphere radius="{radius}"/>', "tip": ""},
            [
                ("slide", "prismatic", "root", "ball", "0 0 0", "1 0 0"),
                ("end", "fixed", "ball", "tip", "0 0 0", "1 0 0"),
            ],
        )
        arms.append(robot.arm(tcp="tip"))
        certificates.append(pp.certify(path(arms[-1], [0.0], [1.0]), pp.CollisionChecker(arms[-1])))
    move = path(arms[0], [0.0], [1.0])
    assert certificates[0].matches(move, arms[0], pp.Scene())
    assert not certificates[0].matches(move, arms[1], pp.Scene())


def test_other_joints_and_settings_that_make_no_sense_are_refused(ur5, slider, path):
    checker = pp.CollisionChecker(ur5)
    with pytest.raises(pp.InputError, match="joints"):
        pp.certify(path(slider, [0.0]), checker)
    with pytest.raises(pp.InputError, match="joints"):
        pp.certify(pp.JointPath(np.zeros((1, 6)), ur5.joint_names[::-1]), checker)
    for setting in ({"tolerance": 0.0}, {"tolerance": float("nan")}, {"max_intervals": 0}):
        with pytest.raises(pp.InputError, match="tolerance"):
            pp.certify(path(ur5, ur5.home), checker, **setting)


def test_an_overflowing_pair_is_not_proven_by_the_next_pair(arm_from_links, path):
    # Three of the four pairs get NaN for a bound, the last one a number; bodies of the first pair touch on the way.
    cube = '<box size="0.2 0.2 0.2"/>'
    arm = arm_from_links(
        {
            "root": "",
            "one": f"{cube}@3 0 0;{cube}@0.2 0 0",
            "two": f"{cube}@0.3 0 20",
            "three": f"{cube}@3 0 0;{cube}@0.2 0 1.26",
            "tip": "",
        },
        [
            ("turn", "continuous", "root", "one", "0 0 0", "0 0 1"),
            ("across", "prismatic", "one", "two", "0 0 0", "0 1 0"),
            ("along", "prismatic", "two", "three", "0 0 0", "0 1 0"),
            ("end", "fixed", "three", "tip", "0 0 0", "1 0 0"),
        ],
    ).arm(tcp="tip")
    move = path(arm, [-1.7e308, 0.0, -0.5], [1.7e308, 0.0, 1.5])
    checker = pp.CollisionChecker(arm)
    assert not checker.is_free(move(0.25))
    with np.errstate(over="ignore", invalid="ignore"):
        assert pp.certify(move, checker, max_intervals=1).status is UNDECIDED
        assert pp.certify(move, checker).status is COLLIDING


def test_the_same_question_gets_the_same_certificate(panda, path):
    scene = pp.Scene([pp.Obstacle("box", pp.Box(0.2, 0.2, 0.2), pp.pose((0.5, 0, 0.3)))])
    move = path(panda, panda.home, panda.home + 0.3)
    checker = pp.CollisionChecker(panda, scene)
    first, again = pp.certify(move, checker), pp.certify(move, checker)
    fresh = pp.certify(move, pp.CollisionChecker(panda, scene))
    for other in (again, fresh):
        assert (other.status, other.clearance, other.intervals) == (first.status, first.clearance, first.intervals)


def test_a_graze_that_the_default_tolerance_leaves_open_is_proven_more_finely(slider, path):
    """Between 1e-4 and 1e-6 m; what is stated is taken as it is, and a budget that is spent ends it."""
    beside = pp.Scene([pp.Obstacle("other", pp.Sphere(0.05), pp.pose((0.123, 0.06 + 3e-6, 0)))])
    checker, move = pp.CollisionChecker(slider, beside), path(slider, [0.0], [0.5])
    assert pp.certify(move, checker, tolerance=1e-4).status is UNDECIDED
    finer = pp.certify(move, checker)
    assert finer.status is FREE
    assert finer.tolerance < 1e-4
    assert pp.certify(move, checker, max_intervals=3).status is UNDECIDED
    nearer = pp.Scene([pp.Obstacle("other", pp.Sphere(0.05), pp.pose((0.123, 0.06 + 1e-9, 0)))])
    grazing = pp.certify(move, pp.CollisionChecker(slider, nearer))
    assert grazing.status is UNDECIDED
    assert grazing.tolerance == 1e-6


def test_the_dictionary_states_the_verdict_with_its_figures(slider, path):
    blocked = pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((0.5, 0, 0)))])
    checker, curve = pp.CollisionChecker(slider, blocked, margin=0.002), path(slider, [0.0], [0.2])
    line = pp.Within(tolerance=0.01, base_from_region=pp.pose(), low=(-1, -1, -1), high=(1, 1, 1))
    free, hit = pp.certify(curve, checker, constraints=[line]), pp.certify(path(slider, [0.0], [0.7]), checker)
    out = pp.certify(path(slider, [0.0], [-8.0]), checker)
    off = pp.certify(path(slider, [0.0], [-1.1]), checker, constraints=[line])
    assert [each.status.name for each in (free, hit, out, off)] == ["FREE", "COLLIDING", "VIOLATED", "VIOLATED"]
    for each in (free, hit, out, off):
        data = each.to_dict()
        assert (data["status"], data["message"], data["margin"]) == (each.status.name, each.message, 0.002)
        assert data["clearance_observed"] == each.observed
        assert data["clearance_proven"] == (each.clearance if each is free else None)
        assert (data["first_contact"] is None) is (each.first_contact is None)
        assert (data["violation"] is None) is (each.violation is None)
        assert data["limits_compared"] == ["position"]
        assert [row["largest_proven"] is None for row in data["constraints"]] == [each is off] * len(each.constraints)
        for row, proof in zip(data["constraints"], each.constraints, strict=True):
            assert (row["tolerance"], row["largest_observed"]) == (0.01, proof.observed)
    assert free.to_dict()["constraints"][0]["largest_proven"] == free.constraints[0].largest
    first = hit.to_dict()["first_contact"]
    for name in ("time", "q", "bodies", "distance", "points", "proven_free_until"):
        assert np.array_equal(first[name], getattr(hit.first_contact, name))
    for data, names in (
        (out, ("joint", "quantity", "value", "limit", "time", "q")),
        (off, ("error", "satisfied_until", "time", "q")),
    ):
        for name in names:
            assert np.array_equal(data.to_dict()["violation"][name], getattr(data.violation, name))
    assert off.to_dict()["violation"]["constraint"] == str(line)


def test_finer_tolerances_are_used_only_while_the_verdict_is_undecided(planar_2r, path):
    """The tip of the outer bar passes a wall at a distance of ``gap``."""
    curve, used = path(planar_2r, [-0.3, 0.0], [0.3, 0.0]), []
    for gap in (0.05, 3e-5, 3e-6, -0.001):
        wall = pp.Obstacle("wall", pp.Box(0.1, 2.0, 0.1), pp.pose((float(np.hypot(1.0, 0.01)) + 0.05 + gap, 0, 0.03)))
        checker = pp.CollisionChecker(planar_2r, pp.Scene([wall]))
        certificate = pp.certify(curve, checker)
        assert certificate.status is (COLLIDING if gap < 0 else FREE)
        alone = {t: pp.certify(curve, checker, tolerance=t).status is not UNDECIDED for t in (1e-4, 1e-5, 1e-6)}
        assert certificate.tolerance == next(t for t, decided in alone.items() if decided)
        assert pp.certify(curve, checker, max_intervals=1).tolerance == 1e-4
        if gap > 0:
            assert f"at least {np.floor(certificate.clearance * 1e4) / 10:.1f} mm" in certificate.message
        used.append(certificate.tolerance)
    assert used[0] == used[-1] == 1e-4
    assert min(used) < 1e-4


def test_a_certificate_without_pairs_has_an_unbounded_clearance(slider, path):
    certificate = pp.certify(path(slider, [0.0], [0.2]), pp.CollisionChecker(slider))
    assert (certificate.free, certificate.clearance, certificate.pairs) == (True, np.inf, 0)
    assert "unbounded" in str(certificate) or "no pair" in str(certificate)
    record = certificate.motion_record()
    assert (record.start, record.end) == (0.0, 0.0)
