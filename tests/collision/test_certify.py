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


def wall_at(x, side=1.0):
    return pp.Scene([pp.Obstacle("wall", pp.Box(0.1, side, side), pp.pose((x, 0, 0)))])


def test_a_body_inside_thin_walls_is_free_and_inside_a_solid_collides(ur5, mesh_file, path):
    move = path(ur5, ur5.home, ur5.home + np.array([0.5, 0.1, 0.1, 0, 0, 0]))
    walls = [
        pp.Obstacle(f"wall_{k}_{at}", pp.Box(*np.where(np.eye(3)[k], 1e-3, 2.4)), pp.pose(at * np.eye(3)[k]))
        for k in range(3)
        for at in (-1.2, 1.2)
    ]
    assert pp.certify(move, pp.CollisionChecker(ur5, pp.Scene(walls))).status is FREE
    solid = pp.Mesh(mesh_file(trimesh.creation.box((2.4, 2.4, 2.4))), hull=False)
    certificate = pp.certify(move, pp.CollisionChecker(ur5, pp.Scene([pp.Obstacle("room", solid)])))
    assert certificate.status is COLLIDING
    assert (certificate.first_contact.time, certificate.first_contact.penetrating) == (0.0, True)


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


def test_a_contact_that_begins_exactly_at_a_knot_is_reported(slider, path):
    """The intervals shrink at the wall from the left; the contact behind it must still be found."""
    certificate = pp.certify(path(slider, [0.0], [0.1], [0.3]), pp.CollisionChecker(slider, wall_at(0.16)))
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies == ("ball", "wall")
    assert certificate.first_contact.time == pytest.approx(1.0, abs=0.02)
    assert certificate.first_contact.proven_free_until <= certificate.first_contact.time


# -- curves ------------------------------------------------------------------------------------------------------------


def test_a_full_rotation_with_equal_ends_is_checked(planar_2r, path, first_touch):
    peg = pp.Scene([pp.Obstacle("peg", pp.Sphere(0.02), pp.pose((-0.9, 0, 0.03)))])
    checker = pp.CollisionChecker(planar_2r, peg)
    long_way = path(planar_2r, [0, 0], [2 * np.pi, 0])
    certificate = pp.certify(long_way, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(checker, long_way), abs=1e-3)
    assert pp.certify(path(planar_2r, [0, 0], [0, 0]), checker).status is FREE


@pytest.mark.parametrize(("end", "walls"), [(-2.0, (0.4, 0.55)), (2.0, (-0.15, 0.25)), (2.0, (0.15, 0.25))])
def test_a_cubic_that_swings_out_and_returns_is_not_judged_by_its_ends_or_its_middle(slider, first_touch, end, walls):
    """It reaches 0.5 in the middle, or 0.19 m on either side while ends and middle are the same configuration."""
    swing = CubicPath(np.zeros((2, 1)), [[2.0], [end]], [0.0, 1.0], slider.joint_names)
    assert (swing(0.0)[0], swing(0.5)[0], swing(1.0)[0]) == pytest.approx((0.0, 0.5 if end < 0 else 0.0, 0.0))
    near, far = (
        pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("wall", pp.Box(0.01, 1, 1), pp.pose((x, 0, 0)))]))
        for x in walls
    )
    certificate = pp.certify(swing, near)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(near, swing), abs=1e-3)
    free = pp.certify(swing, far)
    assert free.status is FREE
    assert free.clearance <= 0.04


@pytest.mark.parametrize("count", [1, 2])
def test_a_path_of_length_zero_is_checked_at_its_configuration(slider, count, path):
    checker = pp.CollisionChecker(slider, wall_at(0.3))
    free, touching = (pp.certify(path(slider, *[[x]] * count), checker) for x in (0.0, 0.3))
    assert (free.status, free.intervals) == (FREE, 1)
    assert 0.12 <= free.clearance <= 0.24 + 1e-9
    assert (touching.status, touching.first_contact.time) == (COLLIDING, 0.0)


def test_a_start_and_an_end_in_contact_are_shown(slider, path):
    start = pp.certify(path(slider, [0.3], [0.0]), pp.CollisionChecker(slider, wall_at(0.3)))
    assert (start.status, start.first_contact.time, start.first_contact.proven_free_until) == (COLLIDING, 0.0, 0.0)
    end = pp.certify(path(slider, [0.0], [0.24 - 1e-9]), pp.CollisionChecker(slider, wall_at(0.3), margin=1e-6))
    assert (end.status, end.first_contact.time) == (COLLIDING, pytest.approx(1.0, abs=1e-3))
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


def test_a_held_body_that_does_not_move_is_checked_and_a_contact_outweighs_an_undecided_pair(arm_from_links, path):
    """A second branch, outside the arm, is in an obstacle: no joint of the arm moves it."""
    ball = '<sphere radius="0.05"/>'
    robot = arm_from_links(
        {"root": "", "arm": ball, "tip": "", "other": ball},
        [
            ("go", "prismatic", "root", "arm", "0 0 0", "1 0 0"),
            ("end", "fixed", "arm", "tip", "0 0 0.1", "0 0 1"),
            ("aside", "prismatic", "root", "other", "0 1 0", "0 1 0"),
        ],
    )
    post = pp.Scene([pp.Obstacle("post", pp.Sphere(0.05), pp.pose((0, 1.5, 0)))])
    for held, status in ((0.0, FREE), (0.41, COLLIDING), (0.4 - 1e-9, UNDECIDED)):
        arm = robot.arm(tcp="tip", held={"aside": held})
        checker, edge = pp.CollisionChecker(arm, post), path(arm, [0.0], [1.0])
        assert pp.certify(edge, checker).status is status
    wall = pp.Obstacle("wall", pp.Sphere(0.1), pp.pose((1, 0, 0)))
    certificate = pp.certify(edge, checker.with_scene(post.add(wall)))
    assert (certificate.status, certificate.first_contact.bodies) == (COLLIDING, ("arm", "wall"))


# -- the certificate ---------------------------------------------------------------------------------------------------


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


def test_a_certificate_matches_only_its_own_motion_and_setup(ur5, arm_from_links, path):
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
    slide = [("slide", "prismatic", "root", "ball", "0 0 0", "1 0 0")]
    small, large = (
        arm_from_links({"root": "", "ball": f'<sphere radius="{radius}"/>'}, slide).arm(tcp="ball")
        for radius in (0.01, 0.02)
    )
    move = path(small, [0.0], [1.0])
    certificate = pp.certify(move, pp.CollisionChecker(small))
    assert certificate.matches(move, small, pp.Scene())
    assert not certificate.matches(move, large, pp.Scene())


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


@pytest.mark.parametrize(
    ("gap", "settings", "status", "used"),
    [
        (1.5e-4, {}, FREE, 1e-4),  # less than the share of the clearance that is aimed at, and proven all the same
        (3e-6, {"tolerance": 1e-4}, UNDECIDED, 1e-4),
        (3e-6, {}, FREE, 1e-5),
        (3e-6, {"max_intervals": 3}, UNDECIDED, 1e-4),
        (2e-8, {"tolerance": 1e-3}, UNDECIDED, 1e-3),
        (2e-8, {"tolerance": 1e-8}, FREE, 1e-8),
        (1e-9, {}, UNDECIDED, 1e-6),
    ],
)
def test_a_graze_is_proven_more_finely_than_by_default_as_far_as_the_settings_allow(
    slider, path, gap, settings, status, used
):
    beside = pp.Scene([pp.Obstacle("other", pp.Sphere(0.05), pp.pose((0.123, 0.06 + gap, 0)))])
    certificate = pp.certify(path(slider, [0.0], [0.5]), pp.CollisionChecker(slider, beside), **settings)
    assert certificate.status is status
    assert certificate.tolerance <= used
    assert certificate.tolerance == used or status is FREE
    assert status is UNDECIDED or 0 < certificate.clearance <= gap
    assert ("max_intervals" in certificate.message) is ("max_intervals" in settings)


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


@pytest.mark.parametrize("bodies", [0, 1])
def test_a_certificate_without_pairs_has_an_unbounded_clearance(slider, arm_from_links, path, bodies):
    slide = [("slide", "prismatic", "root", "carried", "0 0 0", "1 0 0")]
    arm = slider if bodies else arm_from_links({"root": "", "carried": ""}, slide).arm(tcp="carried")
    certificate = pp.certify(path(arm, [0.0], [0.2]), pp.CollisionChecker(arm))
    assert (certificate.status, certificate.clearance, certificate.pairs) == (FREE, np.inf, 0)
    assert "unbounded" in str(certificate) or "no pair" in str(certificate)
    record = certificate.motion_record()
    assert (record.start, record.end) == (0.0, 0.0)


def bulge(arm, speed, acceleration=None):
    """One piece of 1 s from 0 to 0 that swings out to the right between its ends."""
    a = None if acceleration is None else [[acceleration], [acceleration]]
    return pp.Trajectory([0, 1], [[0.0], [0.0]], [[speed], [-speed]], arm.joint_names, accelerations=a)


@pytest.mark.parametrize(("speed", "acceleration"), [(1.0, None), (1.0, 0.5), (0.0, 8.0)])
def test_the_swing_between_two_points_is_proven_to_its_top(slider, speed, acceleration):
    """A ball of 1 cm swings to a wall that it misses, or meets, by less than a millimetre."""
    motion = bulge(slider, speed, acceleration)
    top = float(motion(np.linspace(0, 1, 10_001)).max())
    assert top > 0.02
    for gap, status in ((5e-4, FREE), (-5e-4, COLLIDING)):
        wall = pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((top + 0.01 + gap + 0.05, 0, 0)))])
        certificate = pp.certify(motion, pp.CollisionChecker(slider, wall), limits=None)
        assert certificate.status is status
        if status is FREE:
            assert 0 < certificate.clearance <= gap + 1e-9
        else:
            assert motion(certificate.first_contact.time)[0] >= top + gap - 1e-9


@pytest.mark.parametrize("ending", [".json", ".csv"])
@pytest.mark.parametrize("acceleration", [None, 0.5])
def test_a_motion_file_has_the_certificate_of_its_motion(slider, tmp_path, ending, acceleration):
    motion = bulge(slider, 1 / 3, acceleration)
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((0.4, 0, 0)))]))
    motion.save(tmp_path / f"motion{ending}")
    again = pp.Trajectory.load(tmp_path / f"motion{ending}", slider.joint_names)
    before, after = pp.certify(motion, checker), pp.certify(again, checker)
    assert before.matches(again, slider, checker.scene)
    assert (after.status, after.clearance, after.intervals) == (before.status, before.clearance, before.intervals)
    other = bulge(slider, 1 / 3, None if acceleration else 0.0)  # the same points, the other interpolant
    assert not before.matches(other, slider, checker.scene)


def test_an_undecided_interval_reports_the_distance_of_its_bodies():
    """A rod swings 0.2 mm above a plate, and the proof may not cut finely enough."""
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    rod = pp.Obstacle("rod", pp.Cylinder(radius=0.004, length=0.2), pp.pose((0, 0, 0.1)))
    tip = (arm.forward_kinematics(arm.home) * pp.pose((0, 0, 0.2))).translation
    plate = pp.Obstacle("plate", pp.Box(0.5, 0.5, 0.2), pp.pose(tip - [0, 0, 0.1002]))
    turn = np.array([0.5, 0, 0, 0, 0, 0])
    swing = pp.JointPath([arm.home - turn, arm.home + turn], arm.joint_names)
    undecided = pp.certify(swing, pp.CollisionChecker(arm, pp.Scene([plate]), attached=[rod]), tolerance=0.01).undecided
    assert undecided.bodies == ("rod", "plate")
    assert undecided.distance == pytest.approx(2e-4, abs=1e-6)


GAP = 0.05
"""Metres between the slider's ball of 1 cm, on its path along x, and the obstacle beside it."""


def beside(slider, **settings):
    return pp.CollisionChecker(
        slider, pp.Scene([pp.Obstacle("post", pp.Sphere(0.04), pp.pose((0.2, 0.05 + GAP, 0)))]), **settings
    )


@pytest.mark.parametrize("margin", [0.0, 0.01])
def test_a_displaced_obstacle_in_contact_is_reported_with_its_distance(slider, path, margin):
    curve, checker = path(slider, [0.0], [0.4]), beside(slider, margin=margin)
    moved = GAP - margin + 1e-3
    certificate = pp.certify(curve, checker, obstacle_tolerance=moved)
    assert certificate.status is COLLIDING
    contact = certificate.first_contact
    bare = np.hypot(contact.q[0] - 0.2, 0.05 + GAP) - 0.05
    assert contact.distance == pytest.approx(bare - moved, abs=1e-6)
    assert contact.distance <= margin
    assert contact.penetrating == (contact.distance < 0)


def test_tolerances_are_those_of_obstacles_and_of_each_joint(planar_2r, path):
    """Distances between links are unchanged; only obstacles may be displaced."""
    curve, checker = path(planar_2r, [0.0, 0.5], [0.3, 1.0]), pp.CollisionChecker(planar_2r)
    alone = pp.certify(curve, checker)
    with_tolerance = pp.certify(curve, checker, obstacle_tolerance=1.0)
    assert alone.status is with_tolerance.status is FREE
    assert with_tolerance.clearance == alone.clearance
    assert with_tolerance.tube.largest_obstacles == np.inf
    own, equal = (pp.certify(curve, checker, joint_tolerance=off) for off in ([0.1, 0.0], [0.1, 0.1]))
    assert own.tube.joints.tolist() == [0.1, 0.0]
    assert "joints may deviate by up to their tolerances, 0" in own.message
    assert "joints may deviate by up to 0.1 rad" in equal.message


@pytest.mark.parametrize(
    "settings",
    [
        {"joint_tolerance": -1e-9},
        {"joint_tolerance": float("nan")},
        {"joint_tolerance": [0.0, 0.1]},
        {"obstacle_tolerance": -1e-9},
        {"obstacle_tolerance": float("nan")},
        {"obstacle_tolerance": float("inf")},
    ],
)
def test_a_tube_that_makes_no_sense_is_refused(slider, path, settings):
    with pytest.raises(pp.InputError):
        pp.certify(path(slider, [0.0], [0.4]), beside(slider), **settings)


WALL = pp.Obstacle("wall", pp.HalfSpace(), pp.pose((0.5, 0, 0), (0, -np.pi / 2, 0)))
"""Solid for x >= 0.5."""


@pytest.mark.parametrize("margin", [0.0, 0.02])
@pytest.mark.parametrize("others", [0, 5])
def test_a_ball_before_a_wall_without_end(slider, path, margin, others):
    """Alone, and in a tree of obstacles with ends."""
    far = [pp.Obstacle(f"far_{i}", pp.Box(0.1, 0.1, 0.1), pp.pose((0, 3 + i, 0))) for i in range(others)]
    checker = pp.CollisionChecker(slider, pp.Scene([*far, WALL]), margin=margin)
    free = pp.certify(path(slider, [-2.0], [0.4]), checker)
    assert free.status is FREE
    assert margin < free.clearance <= 0.09
    touching = pp.certify(path(slider, [-2.0], [0.6]), checker)
    assert touching.status is COLLIDING
    assert touching.first_contact.bodies == ("ball", "wall")
    at = path(slider, [-2.0], [0.6])(touching.first_contact.proven_free_until)[0]
    assert 0.49 - margin - 1e-3 <= at <= 0.49 - margin
    for depth in (0.3, 1000.0):
        behind = pp.certify(path(slider, [0.5 + depth], [0.5 + 2 * depth]), checker)
        assert (behind.status, behind.first_contact.time) == (COLLIDING, 0.0)
        assert behind.first_contact.distance == pytest.approx(-(depth + 0.01), rel=1e-9)
    moved = pp.certify(path(slider, [-2.0], [0.4]), checker, obstacle_tolerance=0.04)
    assert moved.status is FREE
    assert moved.tube.largest_obstacles <= 0.05 - margin + 1e-9
    assert pp.certify(path(slider, [-2.0], [0.4]), checker, obstacle_tolerance=0.091 - margin).status is COLLIDING


@pytest.mark.parametrize("angle", [0.3, 1.2, 2.9])
def test_contact_with_a_tilted_wall_is_found_at_its_surface(slider, path, angle):
    """Its plane passes through x = 0.5, leaning by an angle from the floor's."""
    normal = np.array([-np.sin(angle), 0, np.cos(angle)])
    leaning = pp.Obstacle("wall", pp.HalfSpace(), pp.pose((0.5, 0, 0), (0, -angle, 0)))
    checker, move = pp.CollisionChecker(slider, pp.Scene([leaning])), path(slider, [-1.0], [1.0])
    certificate = pp.certify(move, checker)
    assert certificate.status is COLLIDING
    met = 0.5 + 0.01 / normal[0]  # where the ball's centre is one radius before the plane
    assert move(certificate.first_contact.proven_free_until)[0] == pytest.approx(met, abs=1e-3)


@pytest.mark.parametrize("exact", [True, False])
def test_a_tool_that_coal_must_judge_sweeps_over_a_floor(ur5, mesh_file, path, exact):
    """The arm swings a bar towards the floor; a hull and a mesh, which has no support function, have equal results."""
    bar = mesh_file(trimesh.creation.box((0.03, 0.03, 0.3)))
    tool = pp.Obstacle("bar", pp.Mesh(bar, hull=not exact), pp.pose((0, 0, 0.16)))
    floor = pp.Scene([pp.Obstacle("floor", pp.HalfSpace())], allowed=[("base_link", "floor")])
    checker = pp.CollisionChecker(ur5, floor, attached=[tool])
    down = ur5.home + np.array([0, 0.9, 0.3, 0, 0, 0])
    certificate = pp.certify(path(ur5, ur5.home, down), checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies[1] == "floor"
    samples = path(ur5, ur5.home, down)(np.linspace(0, certificate.first_contact.proven_free_until, 50, endpoint=False))
    assert checker.is_free_batch(samples).all()
    raised = pp.certify(path(ur5, ur5.home, ur5.home + np.array([0.5, -0.1, 0, 0, 0, 0])), checker)
    assert raised.status is FREE
    for q in np.linspace(ur5.home, ur5.home + np.array([0.5, -0.1, 0, 0, 0, 0]), 30):
        assert checker.clearance(q) >= raised.clearance


def test_one_of_several_floors_is_enough(slider, path):
    """Two half-spaces make a wedge; a cylinder slid into it meets the nearer one."""
    tool = pp.Obstacle("tool", pp.Cylinder(0.02, 0.4), pp.pose())
    up, down = (
        pp.Obstacle(name, pp.HalfSpace(), pp.pose((1.0, 0, 0), (0, a, 0))) for name, a in (("up", -0.6), ("down", -2.5))
    )
    certificate = pp.certify(
        path(slider, [-1.0], [1.0]), pp.CollisionChecker(slider, pp.Scene([up, down]), attached=[tool])
    )
    assert certificate.status is COLLIDING
    # the cylinder's corner (0.02, 0.2) along the first normal (-sin 0.6, cos 0.6), and so for the second
    first = 1.0 - (0.02 * np.sin(0.6) + 0.2 * np.cos(0.6)) / np.sin(0.6)
    second = 1.0 - (0.02 * np.sin(2.5) + 0.2 * -np.cos(2.5)) / np.sin(2.5)
    met = path(slider, [-1.0], [1.0])(certificate.first_contact.proven_free_until)[0]
    assert met == pytest.approx(min(first, second), abs=1e-3)


# -- tolerances along a direction --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("beyond", "status"), [(0.01, FREE), (1e-4, FREE), (-1e-4, UNDECIDED)])
def test_a_tolerance_counts_towards_each_side_of_a_mesh_by_its_direction(slider, path, beyond, status):
    """A ball slides 2 mm beside one side of a bracket towards the other, more by the tolerance than by its path."""
    tolerance, end = 0.05, 0.1 + 0.01 + 0.05 + beyond
    sides = [trimesh.creation.box(bounds=[(-0.2, 0.012, -0.1), (end + 0.02, 0.03, 0.1)])]
    sides.append(trimesh.creation.box(bounds=[(end, -0.1, -0.1), (end + 0.02, 0.012, 0.1)]))
    both = trimesh.util.concatenate(sides)
    bracket = pp.Obstacle("bracket", pp.Mesh.from_arrays(np.array(both.vertices), np.array(both.faces), hull=False))
    certificate = pp.certify(
        path(slider, [0.0], [0.1]), pp.CollisionChecker(slider, pp.Scene([bracket])), joint_tolerance=tolerance
    )
    assert certificate.status is status
    if status is FREE:
        assert certificate.clearance == pytest.approx(min(beyond, 0.002), abs=1e-6)


def test_a_path_beside_meshes_is_free_at_all_deviations_within_its_tolerance(ur5, path):
    rng, checked = np.random.default_rng(4), [0, 0]
    ring = trimesh.creation.torus(0.3, 0.06, 24, 12)
    shape = pp.Mesh.from_arrays(np.array(ring.vertices), np.array(ring.faces), hull=False)
    places = [pp.pose(np.array((0.0, 0.0, 0.5)) + rng.uniform(-0.7, 0.7, 3), rng.uniform(-3, 3, 3)) for _ in range(4)]
    checker = pp.CollisionChecker(ur5, pp.Scene([pp.Obstacle(f"ring_{k}", shape, at) for k, at in enumerate(places)]))
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T
    for q in rng.uniform(-2.5, 2.5, (2500, 6)):
        if not 0.0 < (gap := checker.clearance(q)) < 0.03:
            continue
        tolerance = gap * rng.uniform(0.0, 4.0, 6)
        near = np.concatenate([signs, rng.uniform(-1.0, 1.0, (64, 6))]) * tolerance
        curve = path(ur5, q, q + 0.003 * rng.normal(size=6))
        proof = pp.certify(curve, checker, joint_tolerance=tolerance, limits=None)
        if proof.free:
            for share in (0.0, 0.5, 1.0):
                assert checker.is_free_batch(curve.q[0] + share * (curve.q[1] - curve.q[0]) + near).all()
        checked[proof.free] += 1
    assert min(checked) > 3
