"""Certificates: FREE is proven, COLLIDING shows where, UNDECIDED says so; each unsound shortcut has its test."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pinproof import (
    Box,
    CertificateStatus,
    CollisionChecker,
    CubicPath,
    Cylinder,
    InputError,
    JointPath,
    Mesh,
    NotProvenFree,
    Obstacle,
    Scene,
    Sphere,
    Trajectory,
    certify,
    pose,
)
from pinproof.collision.motion_bounds import MotionBounds

FREE, COLLIDING, UNDECIDED = CertificateStatus.FREE, CertificateStatus.COLLIDING, CertificateStatus.UNDECIDED


def path(arm, *waypoints) -> JointPath:
    return JointPath(np.array(waypoints, dtype=float), arm.joint_names)


def first_touch(checker, curve, samples=4000) -> float:
    """The first parameter at which the clearance falls to the margin, by sampling and then by bisection."""
    times = np.linspace(*curve.domain, samples)
    touching = [checker.clearance(q) <= checker.margin for q in curve(times)]
    k = touching.index(True)
    low, high = times[k - 1], times[k]
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if checker.clearance(curve(middle)) <= checker.margin else (middle, high)
    return float(high)


def assert_free_until(checker, curve, end, samples=400):
    start = curve.domain[0]
    assert all(checker.clearance(q) > checker.margin for q in curve(np.linspace(start, end, samples, endpoint=False)))


# -- the motion bound ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof", "planar_2r"])
def test_no_pair_comes_nearer_than_its_bound_allows(request, oracle, name):
    arm = request.getfixturevalue(name)
    scene = Scene([Obstacle("box", Box(0.2, 0.2, 0.2), pose((0.5, 0.3, 0.4)))])
    checker = CollisionChecker(arm, scene, attached=[Obstacle("tool", Box(0.02, 0.02, 0.2), pose((0, 0, 0.1)))])
    bounds, independent, rng = MotionBounds(checker), oracle(checker), np.random.default_rng(2)
    everything = np.arange(len(checker.pairs))
    for _ in range(6):
        q = rng.uniform(-2, 2, arm.dof)
        delta = rng.uniform(0, rng.choice([0.01, 0.1, 0.5]), arm.dof)
        frame = bounds.at(q, checker.placed(q))
        allowed, coarse, before = frame.approach(delta, everything), frame.coarse_distance(everything), None
        before = np.maximum(independent.distances(q), 0)
        assert (coarse <= before + 1e-9).all()
        for corner in rng.choice([-1.0, 1.0], size=(12, arm.dof)):
            after = np.maximum(independent.distances(q + corner * delta), 0)
            assert (before - after <= allowed + 1e-9).all()


def test_a_folded_planar_arm_is_not_judged_by_the_least_radius_or_by_exchanged_roles(planar_2r):
    """The second link is folded back onto the first, its tip at the shoulder, a peg beside it near the shoulder.

    The tip is 0 away from the first axis: a least radius, or joint 1 judged by another body than the one that is walked
    to, says that nothing can come nearer. In fact the far end of the folded link sweeps past.
    """
    folded = np.array([0.0, np.pi])
    peg = Obstacle("peg", Sphere(0.02), pose((0.5 * np.cos(0.35), 0.5 * np.sin(0.35), 0.03)))
    checker = CollisionChecker(planar_2r, Scene([peg]))
    assert checker.is_free(folded)
    moving = path(planar_2r, folded, folded + np.array([0.7, 0.0]))
    assert checker.is_free(moving.end)
    certificate = certify(moving, checker)
    assert certificate.status is COLLIDING
    assert "peg" in certificate.first_contact.bodies
    frame = MotionBounds(checker).at(folded, checker.placed(folded))
    names = [tuple(checker.bodies[i].owner for i in pair) for pair in checker.pairs]
    k = names.index(("fore", "peg"))
    by_hand = np.hypot(0.5, 0.01) * 0.35  # the farthest corner of the folded link from the first axis
    assert frame.approach(np.array([0.35, 0.0]), np.array([k]))[0] == pytest.approx(by_hand, rel=1e-2)


def test_a_folded_planar_arm_is_not_judged_with_roles_exchanged_joint_by_joint(arm_from_links):
    """The tip is folded back onto the shoulder, a peg stands at the elbow, both small.

    The tip is near the first axis and the peg near the second: taking joint 1 by the tip and joint 2 by the peg bounds
    the approach by 3 cm. In fact the tip runs into the peg, 0.5 m away, when each joint has turned by 60 degrees; a
    little farther it is free again, so that neither end of this edge nor its middle touches.
    """
    arm = arm_from_links(
        {"base": "", "upper": "", "fore": '<sphere radius="0.01"/>@0.5 0 0', "tip": ""},
        [
            ("q1", "continuous", "base", "upper", "0 0 0", "0 0 1"),
            ("q2", "continuous", "upper", "fore", "0.5 0 0", "0 0 1"),
            ("end", "fixed", "fore", "tip", "0.5 0 0", "0 0 1"),
        ],
    ).arm(tcp="tip")
    checker = CollisionChecker(arm, Scene([Obstacle("peg", Sphere(0.01), pose((0.5, 0, 0)))]))
    folded, turn = np.array([0.0, np.pi]), np.full(2, 1.3 * np.pi / 3)
    edge = path(arm, folded - turn, folded + turn)
    for q in (edge.start, folded, edge.end):
        assert checker.clearance(q) > 0.2
    certificate = certify(edge, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(checker, edge), abs=1e-3)


def test_the_proven_clearance_is_never_above_the_true_one(slider):
    """Straight at a cylinder that is 0.1 m away in the end; its bounding box is turned so that it settles nothing."""
    post = Obstacle("post", Cylinder(0.3, 1), pose((0.71, 0, 0), (0, 0, np.pi / 4)))
    certificate = certify(path(slider, [0.0], [0.3]), CollisionChecker(slider, Scene([post])))
    assert certificate.status is FREE
    assert 0.05 < certificate.clearance <= 0.1


@pytest.mark.parametrize("thickness", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("kind", ["box", "disc", "hull", "exact"])
def test_a_thin_plate_across_a_fast_wrist_is_never_jumped_over(ur5, mesh_file, thickness, kind):
    """A tool of 0.5 m swings through half a turn in one edge; both ends are free."""
    shape = {
        "box": lambda: Box(0.3, 0.3, thickness),
        "disc": lambda: Cylinder(0.15, thickness),
        "hull": lambda: Mesh(mesh_file(trimesh.creation.box((0.3, 0.3, thickness)))),
        "exact": lambda: Mesh(mesh_file(trimesh.creation.box((0.3, 0.3, thickness))), hull=False),
    }[kind]()
    tool = Obstacle("tool", Cylinder(0.003, 0.5), pose((0, 0, 0.25)))
    start, end = ur5.home.copy(), ur5.home.copy()
    start[3] -= 1.2
    end[3] += 0.8
    middle = (start + end) / 2
    turned = ur5.forward_kinematics(middle) * pose((0, 0, 0.45), (0, np.pi / 2, 0))  # its plane holds the tool
    across = turned * pose(rpy=(0, 0, 0))
    scene = Scene([Obstacle("plate", shape, across)])
    checker = CollisionChecker(ur5, scene, attached=[tool], allowed=[("tool", f) for f in ("wrist_2_link",)])
    swing = path(ur5, start, end)
    assert checker.is_free(start)
    assert checker.is_free(end)
    certificate = certify(swing, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies == ("tool", "plate")
    assert_free_until(checker, swing, certificate.first_contact.proven_free_until, 100)


# -- where a body is ---------------------------------------------------------------------------------------------------


def hollow_box(mesh_file, kind):
    if kind == "walls":
        walls = []
        for axis in range(3):
            for side in (-0.5, 0.5):
                size, at = [2.4, 2.4, 2.4], [0.0, 0.0, 0.0]
                size[axis], at[axis] = 1e-3, 2.4 * side
                walls.append(Obstacle(f"wall_{axis}_{side}", Box(*size), pose(at)))
        return Scene(walls)
    return Scene([Obstacle("room", Mesh(mesh_file(trimesh.creation.box((2.4, 2.4, 2.4))), hull=False))])


def test_inside_a_room_of_thin_walls_is_free_and_inside_a_solid_is_not(ur5, mesh_file):
    move = path(ur5, ur5.home, ur5.home + np.array([0.5, 0.1, 0.1, 0, 0, 0]))
    assert certify(move, CollisionChecker(ur5, hollow_box(mesh_file, "walls"))).status is FREE
    certificate = certify(move, CollisionChecker(ur5, hollow_box(mesh_file, "solid")))
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == 0.0
    assert certificate.first_contact.penetrating


def test_what_is_hollow_is_said_in_the_certificate(slider, mesh_file):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    open_box = mesh_file(trimesh.Trimesh(box.vertices, box.faces[1:], process=False))
    checker = CollisionChecker(slider, Scene([Obstacle("open", Mesh(open_box, hull=False))]))
    certificate = certify(path(slider, [-0.05], [0.05]), checker)
    assert certificate.hollow == ("open",)
    assert "open" in certificate.message


# -- grazes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [-1e-3, -1e-4, -1e-6, 0.0, 1e-7, 1e-6, 1e-5, 1e-4, 5e-4])
@pytest.mark.parametrize("margin", [0.0, 0.002])
def test_a_graze_is_never_judged_wrongly(slider, gap, margin):
    """A ball of 1 cm slides past another at a known least distance of margin + gap."""
    beside = Obstacle("other", Sphere(0.05), pose((0.123, 0.06 + margin + gap, 0)))
    certificate = certify(path(slider, [0.0], [0.5]), CollisionChecker(slider, Scene([beside]), margin=margin))
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


def test_a_smaller_tolerance_decides_a_graze(slider):
    beside = Scene([Obstacle("other", Sphere(0.05), pose((0.123, 0.06 + 2e-5, 0)))])
    checker = CollisionChecker(slider, beside)
    move = path(slider, [0.0], [0.5])
    assert certify(move, checker).status is UNDECIDED
    assert certify(move, checker, tolerance=1e-6).status is FREE


def test_what_is_proven_at_the_tolerance_is_taken(slider):
    """Free by 1.5 tolerances: less than the share of the clearance that is aimed at, and proven all the same."""
    beside = Scene([Obstacle("wall", Box(2, 0.1, 0.1), pose((0, 0.06 + 1.5e-4, 0)))])
    certificate = certify(path(slider, [0.0], [0.3]), CollisionChecker(slider, beside))
    assert certificate.status is FREE
    assert 0 < certificate.clearance <= 1.5e-4


# -- curves ------------------------------------------------------------------------------------------------------------


def test_a_whole_turn_whose_ends_are_equal_is_looked_at(planar_2r):
    peg = Scene([Obstacle("peg", Sphere(0.02), pose((-0.9, 0, 0.03)))])
    checker = CollisionChecker(planar_2r, peg)
    long_way = path(planar_2r, [0, 0], [2 * np.pi, 0])
    certificate = certify(long_way, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(checker, long_way), abs=1e-3)
    assert certify(path(planar_2r, [0, 0], [0, 0]), checker).status is FREE


def test_a_cubic_that_swings_out_and_returns_is_not_judged_by_its_ends(slider):
    knots, rest = [0.0, 1.0], np.zeros((2, 1))
    swing = CubicPath(rest, [[2.0], [-2.0]], knots, slider.joint_names)  # reaches 0.5 at the middle
    assert swing(0.5)[0] == pytest.approx(0.5)
    wall = [Obstacle("wall", Box(0.01, 1, 1), pose((x, 0, 0))) for x in (0.4, 0.55)]
    near, far = (CollisionChecker(slider, Scene([w])) for w in wall)
    certificate = certify(swing, near)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(near, swing), abs=1e-3)
    assert certify(swing, far).status is FREE
    assert certify(swing, far).clearance <= 0.035


def test_a_cubic_that_swings_both_ways_is_not_judged_by_its_ends_and_middle(slider):
    """Ends and middle are the same configuration; between them the slide goes 0.19 m out on either side."""
    swing = CubicPath(np.zeros((2, 1)), [[2.0], [2.0]], [0.0, 1.0], slider.joint_names)
    assert swing(0.0) == swing(0.5) == swing(1.0) == 0.0
    for x in (-0.15, 0.15):
        checker = CollisionChecker(slider, Scene([Obstacle("wall", Box(0.01, 1, 1), pose((x, 0, 0)))]))
        certificate = certify(swing, checker)
        assert certificate.status is COLLIDING
        assert certificate.first_contact.time == pytest.approx(first_touch(checker, swing), abs=1e-3)


@pytest.mark.parametrize("count", [1, 2])
def test_a_path_of_no_length_is_judged_where_it_stands(slider, count):
    wall = Scene([Obstacle("wall", Box(0.1, 1, 1), pose((0.3, 0, 0)))])
    checker = CollisionChecker(slider, wall)
    free = certify(path(slider, *[[0.0]] * count), checker)
    assert free.status is FREE
    assert 0.12 < free.clearance <= 0.24 + 1e-9
    assert free.intervals == 1
    touching = certify(path(slider, *[[0.3]] * count), checker)
    assert touching.status is COLLIDING
    assert touching.first_contact.time == 0.0


def test_a_start_and_an_end_in_contact_are_shown(slider):
    checker = CollisionChecker(slider, Scene([Obstacle("wall", Box(0.1, 1, 1), pose((0.3, 0, 0)))]))
    start = certify(path(slider, [0.3], [0.0]), checker)
    assert (start.status, start.first_contact.time, start.first_contact.proven_free_until) == (COLLIDING, 0.0, 0.0)
    end = certify(path(slider, [0.0], [0.24 - 1e-9]), CollisionChecker(slider, checker.scene, margin=1e-6))
    assert end.status is COLLIDING
    assert end.first_contact.time == pytest.approx(1.0, abs=1e-3)
    assert end.first_contact.proven_free_until > 0.99


def test_the_first_contact_is_the_first(ur5):
    """Two pegs in the way; also on the same motion as a timed trajectory, whose parameter is seconds."""
    pan, start = np.eye(6)[0], ur5.home
    end = start + 1.6 * pan
    on_the_way = [ur5.forward_kinematics(start + angle * pan) for angle in (1.2, 0.7)]
    pegs = [Obstacle(f"peg_{i}", Sphere(0.01), at * pose((0, 0, 0.03))) for i, at in enumerate(on_the_way)]
    tool = Obstacle("tool", Cylinder(0.01, 0.08), pose((0, 0, 0.041)))
    checker = CollisionChecker(ur5, Scene(pegs), margin=0.002, attached=[tool])
    straight = path(ur5, start, end)
    timed = Trajectory([0.0, 2.0], np.stack([start, end]), np.zeros((2, 6)), ur5.joint_names)
    for curve in (straight, timed):
        certificate = certify(curve, checker)
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


def test_prismatic_and_revolute_joints_together(arm_from_links):
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
    checker = CollisionChecker(arm, Scene([Obstacle("post", Box(0.01, 0.01, 1), pose((0.9, 0, 0.4)))]))
    upright, tilting = path(arm, [0, 0], [0.7, 0]), path(arm, [0, 0], [0.7, 0.9])
    free = certify(upright, checker)
    assert free.status is FREE
    assert free.clearance <= checker.clearance(upright.end)
    colliding = certify(tilting, checker)
    assert colliding.status is COLLIDING
    assert colliding.first_contact.bodies == ("arm", "post")
    assert colliding.first_contact.time == pytest.approx(first_touch(checker, tilting), abs=1e-3)


def test_the_arm_against_itself(ur5):
    """The elbow folds until the wrist meets the upper arm."""
    folding = path(ur5, ur5.home, [0, -1.5, 3.1, -1.5, -1.5, 0])
    certificate = certify(folding, CollisionChecker(ur5))
    assert certificate.status is COLLIDING
    assert "upper_arm_link" in certificate.first_contact.bodies
    assert certificate.first_contact.time == pytest.approx(first_touch(CollisionChecker(ur5), folding), abs=1e-3)


def test_a_mimic_follower_sweeps(arm_from_links):
    """The follower turns three times as far as its leader, past a peg that no sample at the ends sees."""
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
    peg = Obstacle("peg", Sphere(0.01), pose((0.5, -0.25 * np.sin(angle), 0.25 * np.cos(angle))))
    checker = CollisionChecker(arm, Scene([peg]))
    for lead in (0.0, 0.3, 0.6):
        assert checker.clearance([lead]) > 0.02
    assert certify(path(arm, [0.0], [0.6]), checker).status is COLLIDING
    assert certify(path(arm, [0.0], [0.5]), checker).status is FREE


def test_a_held_body_that_does_not_move_is_judged_too(arm_from_links):
    """A second branch, outside the arm, stands in an obstacle: no joint of the arm moves it."""
    ball = '<sphere radius="0.05"/>'
    robot = arm_from_links(
        {"root": "", "arm": ball, "tip": "", "other": ball},
        [
            ("turn", "revolute", "root", "arm", "0 0 0", "0 0 1"),
            ("end", "fixed", "arm", "tip", "0 0 0.1", "0 0 1"),
            ("aside", "prismatic", "root", "other", "0 1 0", "0 1 0"),
        ],
    )
    post = Scene([Obstacle("post", Sphere(0.05), pose((0, 1.5, 0)))])
    for held, status in ((0.0, FREE), (0.41, COLLIDING), (0.4 - 1e-9, UNDECIDED)):
        arm = robot.arm(tcp="tip", held={"aside": held})
        certificate = certify(path(arm, [0.0], [1.0]), CollisionChecker(arm, post))
        assert certificate.status is status, str(certificate)


def test_a_contact_outweighs_a_pair_that_stays_undecided(arm_from_links):
    ball = '<sphere radius="0.05"/>'
    robot = arm_from_links(
        {"root": "", "arm": ball, "tip": "", "other": ball},
        [
            ("go", "prismatic", "root", "arm", "0 0 0", "1 0 0"),
            ("end", "fixed", "arm", "tip", "0 0 0.1", "0 0 1"),
            ("aside", "prismatic", "root", "other", "0 1 0", "0 1 0"),
        ],
    )
    things = [Obstacle("post", Sphere(0.05), pose((0, 1.1 + 1e-9, 0))), Obstacle("wall", Sphere(0.1), pose((1, 0, 0)))]
    arm = robot.arm(tcp="tip")
    certificate = certify(path(arm, [0.0], [1.0]), CollisionChecker(arm, Scene(things)))
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies == ("arm", "wall")


# -- the certificate ---------------------------------------------------------------------------------------------------


def test_a_spent_budget_is_undecided_and_says_so(ur5):
    certificate = certify(path(ur5, ur5.home, ur5.home + 0.5), CollisionChecker(ur5), max_intervals=1)
    assert certificate.status is UNDECIDED
    assert "budget" in certificate.message


def test_nothing_to_check_is_free_at_any_distance(slider):
    certificate = certify(path(slider, [0.0], [1.0]), CollisionChecker(slider))
    assert certificate.status is FREE
    assert certificate.clearance == np.inf
    assert certificate.pairs == 0


def test_what_was_left_out_is_listed(panda):
    scene = Scene([Obstacle("table", Box(1, 1, 0.1), pose((0, 0, -0.05)))], allowed=[("panda_link0", "table")])
    certificate = certify(path(panda, panda.home, panda.home), CollisionChecker(panda, scene, margin=0.001))
    listed = {frozenset(pair.owners): pair.reason for pair in certificate.excluded}
    assert listed[frozenset(("panda_link0", "table"))] == "allowed by the scene"
    assert listed[frozenset(("panda_link5", "panda_link7"))] == "SRDF: Default"
    assert certificate.margin == 0.001


def test_a_certificate_matches_only_what_it_was_made_for(ur5, slider):
    scene, move = Scene([Obstacle("ball", Sphere(0.1), pose((2, 0, 0)))]), path(ur5, ur5.home, ur5.home + 0.1)
    certificate = certify(move, CollisionChecker(ur5, scene))
    assert certificate.matches(move, ur5, scene)
    assert certificate.matches(path(ur5, *move.q), ur5, Scene(scene.obstacles))
    assert not certificate.matches(move.reversed(), ur5, scene)
    assert not certificate.matches(move, ur5, Scene())
    assert not certificate.matches(move, ur5, Scene(scene.obstacles, allowed=[("base_link", "ball")]))
    assert not certificate.matches(move, ur5.robot.arm(tcp="ee_link"), scene)


def test_other_collision_geometry_is_another_setup(arm_from_links):
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
        certificates.append(certify(path(arms[-1], [0.0], [1.0]), CollisionChecker(arms[-1])))
    move = path(arms[0], [0.0], [1.0])
    assert certificates[0].matches(move, arms[0], Scene())
    assert not certificates[0].matches(move, arms[1], Scene())


def test_other_joints_and_settings_that_make_no_sense_are_refused(ur5, slider):
    checker = CollisionChecker(ur5)
    with pytest.raises(InputError, match="joints"):
        certify(path(slider, [0.0]), checker)
    with pytest.raises(InputError, match="joints"):
        certify(JointPath(np.zeros((1, 6)), ur5.joint_names[::-1]), checker)
    for setting in ({"tolerance": 0.0}, {"tolerance": float("nan")}, {"max_intervals": 0}):
        with pytest.raises(InputError, match="tolerance"):
            certify(path(ur5, ur5.home), checker, **setting)


def test_the_same_question_gets_the_same_certificate(panda):
    scene = Scene([Obstacle("box", Box(0.2, 0.2, 0.2), pose((0.5, 0, 0.3)))])
    move = path(panda, panda.home, panda.home + 0.3)
    checker = CollisionChecker(panda, scene)
    first, again = certify(move, checker), certify(move, checker)
    fresh = certify(move, CollisionChecker(panda, scene))
    for other in (again, fresh):
        assert (other.status, other.clearance, other.intervals) == (first.status, first.clearance, first.intervals)
