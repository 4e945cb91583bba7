"""Motions whose samples are free or in contact while the motion is not: the sampled and the correct result."""

from __future__ import annotations

import numpy as np
import pytest

from pinproof import (
    Box,
    CertificateStatus,
    CollisionChecker,
    Cylinder,
    Obstacle,
    Scene,
    Sphere,
    certify,
    load_robot,
    pose,
)

FREE, COLLIDING, UNDECIDED = CertificateStatus.FREE, CertificateStatus.COLLIDING, CertificateStatus.UNDECIDED

STEP = 0.02
"""rad: how finely planners commonly sample an edge."""


def sampled_free(checker, curve, step=STEP) -> bool:
    """The result of a planner that samples the curve every ``step`` rad or m, including both ends."""
    longest = np.abs(np.diff(curve.q, axis=0)).max()
    count = max(int(np.ceil(longest / step)) * (len(curve.q) - 1), 1)
    return bool(checker.is_free_batch(curve(np.linspace(*curve.domain, count + 1))).all())


def assert_first_contact(certificate, checker, curve, bodies):
    assert certificate.status is COLLIDING, str(certificate)
    assert set(certificate.first_contact.bodies) == set(bodies)
    assert checker.clearance(certificate.first_contact.q) <= checker.margin
    before = curve(np.linspace(curve.domain[0], certificate.first_contact.proven_free_until, 60, endpoint=False))
    assert checker.is_free_batch(before).all()


TOOL = Obstacle("tool", Cylinder(0.002, 0.5), pose((0, 0, 0.255)))
"""Half a metre long, 4 mm thick."""


@pytest.mark.parametrize("thickness", [1e-4, 5e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_thin_plate_across_a_fast_wrist(request, path, name, thickness):
    """The wrist swings a tool of 0.5 m by 1.5 rad in one edge; the plate is between two samples."""
    arm = request.getfixturevalue(name)
    joint, middle = {"ur5": (3, 0.0), "panda": (5, 0.55)}[name]
    touching = {"ur5": ("wrist_3_link",), "panda": ("panda_hand", "panda_leftfinger", "panda_rightfinger")}[name]
    start, end = arm.home.copy(), arm.home.copy()
    start[joint] += middle - 0.75
    end[joint] += middle + 0.75
    swing = path(arm, start, end)
    samples = int(np.ceil(1.5 / STEP))
    between = swing((samples // 2 + 0.5) / samples)  # half a step, 4.7 mm, from the samples beside it
    jacobian = arm.jacobian(between)[:, joint]
    placement = arm.forward_kinematics(between) * pose((0, 0, 0.47))
    lever = placement.translation - arm.forward_kinematics(between).translation
    along = jacobian[:3] + np.cross(jacobian[3:], lever)
    along -= (along @ placement.rotation[:, 2]) * placement.rotation[:, 2]
    along /= np.linalg.norm(along)
    across = np.cross(along, placement.rotation[:, 2])
    frame = np.column_stack([placement.rotation[:, 2], across, along])
    plate = np.eye(4)
    plate[:3, :3], plate[:3, 3] = frame, placement.translation
    scene = Scene([Obstacle("plate", Box(0.02, 0.02, thickness), plate)])
    checker = CollisionChecker(arm, scene, attached=[TOOL], allowed=[("tool", link) for link in touching])
    assert sampled_free(checker, swing)  # the trap
    assert_first_contact(certify(swing, checker), checker, swing, ("tool", "plate"))


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_graze_of_a_tenth_of_a_millimetre(ur5, path, sign):
    """A peg inside the ring a tool's tip sweeps about the first axis, or 0.1 mm beside the tool's reach."""
    tip = Obstacle("tip", Sphere(0.01), pose((0, 0, 0.05)))
    start = ur5.home - 0.8 * np.eye(6)[0]
    swing = path(ur5, start, start + 1.6 * np.eye(6)[0])
    at = (ur5.forward_kinematics(ur5.home) * pose((0, 0, 0.05))).translation
    radius = np.hypot(at[0], at[1])
    stands = np.append(at[:2] * (radius + 0.02 + sign * 1e-4) / radius, at[2])
    checker = CollisionChecker(ur5, Scene([Obstacle("peg", Sphere(0.01), pose(stands))]), attached=[tip])
    certificate = certify(swing, checker)
    if sign < 0:
        assert certificate.status is COLLIDING
        assert set(certificate.first_contact.bodies) == {"tip", "peg"}
        assert -1.1e-4 < certificate.first_contact.distance <= 0
        return
    assert certificate.status is not COLLIDING
    finer = certify(swing, checker, tolerance=1e-5)
    assert finer.status is FREE
    assert 0 < finer.clearance <= 1e-4 + 1e-9


def test_an_obstacle_behind_a_wrap_of_the_angle(planar_2r, path):
    """From 170 to -170 degrees: the shorter rotation passes 180, the straight edge in q leads through 0."""
    goal = np.radians([-170, 0])
    edge = path(planar_2r, np.radians([170, 0]), goal)
    behind, before = (Scene([Obstacle("post", Sphere(0.05), pose((x, 0, 0)))]) for x in (-0.8, 0.8))
    assert certify(edge, CollisionChecker(planar_2r, behind)).status is FREE  # it never goes there
    certificate = certify(edge, CollisionChecker(planar_2r, before))
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(0.5, abs=0.05)
    short = path(planar_2r, np.radians([170, 0]), goal + np.array([2 * np.pi, 0]))
    assert certify(short, CollisionChecker(planar_2r, behind)).status is COLLIDING
    assert certify(short, CollisionChecker(planar_2r, before)).status is FREE


@pytest.mark.parametrize("turns", [1, 2, -3])
def test_a_continuous_joint_that_rotates_by_more_than_pi(planar_2r, path, turns):
    """Both ends are the same configuration, and so is the middle of an even number of turns; a post is opposite."""
    checker = CollisionChecker(planar_2r, Scene([Obstacle("post", Sphere(0.05), pose((-0.8, 0, 0)))]))
    long_way = path(planar_2r, [0, 0], [2 * np.pi * turns, 0])
    assert checker.is_free_batch(long_way([0.0, 1.0])).all()  # the trap: compared modulo a turn, nothing moves
    certificate = certify(long_way, checker)
    assert certificate.status is COLLIDING
    met = np.arcsin(0.06 / 0.8)  # about where the bar's flank meets the ball
    assert abs(certificate.first_contact.q[0]) == pytest.approx(np.pi - met, abs=0.03)
    assert certify(path(planar_2r, [0, 0], [0, 0]), checker).status is FREE


def test_a_prismatic_arm_that_reaches_through_a_sheet(path):
    """The Stanford arm extends and retracts its hand; a sheet of 0.1 mm is between the samples."""
    arm = load_robot("stanford").arm()
    near, far = arm.home.copy(), arm.home.copy()
    near[2], far[2] = 0.35, 1.2
    reach = path(arm, near, far, near)
    direction = arm.jacobian(arm.home)[:3, 2]
    samples = int(np.ceil(0.85 / 0.05))
    hidden = reach((samples // 2 + 0.5) / samples)
    centre = arm.forward_kinematics(hidden).translation + 0.035 * direction
    sheet = np.eye(4)
    u = np.cross(direction, [0, 0, 1.0])
    sheet[:3, :3] = np.column_stack([u, np.cross(direction, u), direction])
    sheet[:3, 3] = centre
    checker = CollisionChecker(
        arm, Scene([Obstacle("sheet", Box(0.05, 0.05, 1e-4), sheet)]),
        attached=[Obstacle("pin", Cylinder(0.002, 0.03), pose((0, 0, 0.02)))],
    )  # fmt: skip
    assert sampled_free(checker, reach, 0.05)  # the trap
    certificate = certify(reach, checker)
    assert_first_contact(certificate, checker, reach, ("pin", "sheet"))
    assert certificate.first_contact.time < 1.0  # on the way out, not on the way back


def test_half_a_metre_of_tool_counts(ur5, path):
    """The same swing without the tool is free; the radius about each axis is that of what is carried."""
    post = Scene([Obstacle("post", Sphere(0.02), ur5.forward_kinematics(ur5.home) * pose((0, 0, 0.48)))])
    tool = Obstacle("tool", Cylinder(0.01, 0.5), pose((0, 0, 0.255)))
    swing = path(ur5, ur5.home - 0.5 * np.eye(6)[3], ur5.home + 0.5 * np.eye(6)[3])
    assert certify(swing, CollisionChecker(ur5, post)).status is FREE
    checker = CollisionChecker(ur5, post, attached=[tool], allowed=[("tool", "wrist_3_link")])
    assert checker.is_free_batch(swing([0.0, 1.0])).all()
    assert_first_contact(certify(swing, checker), checker, swing, ("tool", "post"))


def test_the_elbow_of_an_arm_meets_its_own_base(panda, path):
    """The elbow passes the foot of the arm between samples; nine of them, the ends among them, are free."""
    fold = path(panda, [0, 1.7, -1.4, -1.8, -0.6, 0.7, 0], [0, 1.3, 1.2, -2.7, -1.6, 2.7, 0])
    checker = CollisionChecker(panda)
    assert checker.is_free_batch(fold(np.linspace(0, 1, 9))).all()  # the trap
    assert_first_contact(certify(fold, checker), checker, fold, ("panda_link5", "panda_link0"))


def test_a_carried_part_collides_with_obstacles(panda, path):
    """The hand passes over a peg, free at every instant; the can it holds does not, between two free samples."""
    can = Obstacle("can", Cylinder(0.03, 0.16), pose((0, 0, 0.06)))
    held = [("can", link) for link in ("panda_hand", "panda_leftfinger", "panda_rightfinger")]
    turn = path(panda, panda.home - 0.25 * np.eye(7)[0], panda.home + 0.55 * np.eye(7)[0])
    under = panda.forward_kinematics(panda.home).translation - [0, 0, 0.12]
    scene = Scene([Obstacle("peg", Sphere(0.005), pose(under))])
    assert certify(turn, CollisionChecker(panda, scene)).status is FREE
    checker = CollisionChecker(panda, scene, attached=[can], allowed=held)
    assert sampled_free(checker, turn, 0.5)  # the trap
    assert_first_contact(certify(turn, checker), checker, turn, ("can", "peg"))
