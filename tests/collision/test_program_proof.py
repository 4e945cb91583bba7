"""The certificate of a robot program covers what a controller may execute, and is withdrawn when the text differs."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof.collision import certify_program, executed_parts, export_program, traced
from pinproof.collision.certificates.linear_traces import ROUNDED, UNIT, interpolation_difference, levers, trace_line
from pinproof.collision.certificates.program_limits import shortest_durations
from pinproof.collision.certificates.program_parts import blend_cover, zone_shares
from pinproof.errors import InputError
from pinproof.motion import (
    Blend,
    ControllerMove,
    JointMove,
    LinearMove,
    RobotProgram,
    SetOutput,
    StreamedPoint,
    StreamedTrajectory,
    ToolData,
    Wait,
    controller_motion,
    make_program,
)

Cell = tuple[pp.CollisionChecker, pp.Trajectory]
MOVING = ("urscript", "rapid", "krl", "fanuc")
FREE, UNDECIDED = pp.CertificateStatus.FREE, pp.CertificateStatus.UNDECIDED
BENT, LOW = np.array([0.0, -1.0, 1.4, -2.0, -1.57, 0.0]), np.array([-0.5, -1.2, 1.6, -1.97, -1.57, 0.0])


def certified(steps, checker: pp.CollisionChecker, dialect: str = "urscript", **settings):
    """The certificate of a program of steps."""
    return certify_program(make_program(steps, checker.arm.joint_names, dialect=dialect, **settings), checker)


@pytest.fixture(scope="module")
def cell() -> Cell:
    """The UR5 beside a post, and a motion from one side of it to the other."""
    arm = pp.load_robot("ur5").arm()
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.2), pp.pose(xyz=(0.55, 0.0, 0.6)))
    checker = pp.CollisionChecker(arm, pp.Scene([post]))
    ends = [[turn, -1.0, 1.4, -2.0, -1.57, 0.0] for turn in (-0.9, 0.9)]
    path = pp.RrtConnect().plan(checker, *ends, rng=0).or_raise().path
    return checker, pp.time_parametrise(pp.simplify(path, checker, rng=0).path, arm.limits)


@pytest.mark.parametrize("dialect", [*MOVING, "ros2"])
def test_a_certified_motion_is_exported_and_the_text_certified(cell: Cell, dialect: str) -> None:
    checker, motion = cell
    assert pp.certify(motion, checker).free
    program, certificate = export_program(motion, checker, dialect)
    assert certificate.free
    assert program.certificate == certificate.hash
    again = certify_program(RobotProgram.parse(program.text, dialect=dialect), checker)
    assert (again.free, again.hash) == (True, certificate.hash)
    stated = float(re.search(r"clearance ([\d.]+) mm", again.message)[1])  # a proven bound is rounded down
    assert stated <= again.clearance * 1e3 < stated + 0.1 + 1e-9


def blend_of(dialect: str, radius: float = 0.01) -> Blend:
    """A blend that a language can state."""
    known = {"rapid": Blend(2 * radius, 0.5, 0.5), "krl": Blend(radius, 0.5), "fanuc": Blend(share=0.5)}
    return known.get(dialect, Blend(radius))


def solved(arm: pp.Arm, q: np.ndarray, pose) -> np.ndarray:
    """The joint values at a pose near to a configuration."""
    for _ in range(30):
        here = arm.forward_kinematics(q)
        turn = pp.spatial.log6(pp.spatial.SE3(pose.rotation @ here.rotation.T, np.zeros(3)))[3:]
        q = q + np.linalg.solve(arm.jacobian(q), np.concatenate([pose.translation - here.translation, turn]))
    return q


def test_the_cover_of_a_blend_contains_curves_of_joints_and_of_the_tcp_in_its_zone() -> None:
    arm, rng, count = pp.load_robot("ur5").arm(tcp="tool0"), np.random.default_rng(8), 0
    along = np.linspace(0.0, 1.0, 15)
    forms = [  # how much of either move is left at a time
        ((1 - along) ** 2, along**2),
        (1 - along, along),
        (1 - np.sin(along * np.pi / 2), 1 - np.cos(along * np.pi / 2)),
    ]
    joint_forms = [*forms, (1 - along**4, 1 - (1 - along) ** 4)]  # both moves accelerate at once
    for k in range(20):
        point = BENT + 0.3 * rng.normal(size=6)
        into, out = (pp.JointPath([point, point + 0.4 * rng.normal(size=6)], arm.joint_names) for _ in range(2))
        if k % 2:
            shift = pp.pose(0.08 * rng.normal(size=3), 0.2 * rng.normal(size=3))
            trace = trace_line(arm, point, arm.forward_kinematics(point) * shift)
            if trace.reason:
                continue
            out = trace.path
        blend = Blend(rng.uniform(0.005, 0.05), 0.5)
        ends = np.linspace(0.0, 1.0, 41)[:, None]
        covers = [
            (np.concatenate([a + ends * (b - a) for a, b in pairwise(cover.q)]), tolerance)
            for cover, tolerance in blend_cover(blend, arm, into.reversed(), out)
        ]

        def moved(path: pp.JointPath, shares: np.ndarray, blend=blend) -> np.ndarray:
            used = zone_shares(blend, arm, path.q)[0] * shares
            return np.stack([np.interp(used, np.linspace(0, 1, len(path.q)), column) for column in path.q.T], axis=1)

        curves = [moved(into, left) + moved(out, gone) - point for left, gone in joint_forms]
        here = arm.forward_kinematics(point)
        for left, gone in forms:
            curve = []
            for a, b in zip(moved(into, left), moved(out, gone), strict=True):
                one, other = arm.forward_kinematics(a), arm.forward_kinematics(b)
                place = one.translation + other.translation - here.translation
                turned = one.rotation @ here.rotation.T @ other.rotation
                curve.append(solved(arm, a + b - point, pp.spatial.SE3(turned, place)))
            curves.append(np.array(curve))
        for curve in curves:
            apart = [(np.abs(curve[:, None] - rows) / tolerance).max(axis=2).min(axis=1) for rows, tolerance in covers]
            assert np.min(apart, axis=0).max() <= 1.0 + 1e-6
            count += 1
    assert count > 90


def test_a_blend_beside_a_turntable_contains_poses_superposed_in_its_axes() -> None:
    table = (
        '<link name="floor"/><joint name="table" type="revolute"><parent link="floor"/><child link="world"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1.5" effort="100"/></joint></robot>'
    )
    arm = pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", table)).arm(tcp="tool0")
    rng = np.random.default_rng(63)
    point = np.append(0.0, np.array([0.0, -1.2, 1.6, -1.9, -1.57, 0.0]) + 0.2 * rng.normal(size=6))
    line = trace_line(arm, point, arm.forward_kinematics(point) * pp.pose(0.25 * rng.normal(size=3))).path
    change = np.concatenate([[rng.choice([-1, 1]) * rng.uniform(1, 3)], 0.5 * rng.normal(size=6)])
    covers = blend_cover(Blend(share=0.5), arm, pp.JointPath([point + change, point], arm.joint_names), line)
    still, dense = pp.load_robot("ur5").arm(tcp="tool0"), np.linspace(0.0, 1.0, 60)[:, None]
    for share in (0.25, 0.5, 0.75):
        one = point + 0.5 * (1.0 - share) * change
        other = np.array([np.interp(0.5 * share, np.linspace(0, 1, len(line.q)), column) for column in line.q.T])
        first, second = (still.forward_kinematics(q[1:]) for q in (one, other))
        middle = still.forward_kinematics(point[1:])
        place = first.translation + second.translation - middle.translation
        turned = first.rotation @ middle.rotation.T @ second.rotation
        q = solved(still, (one + other - point)[1:], pp.spatial.SE3(turned, place))
        q = np.append(one[0] + other[0], q)
        apart = [(np.abs(a + dense * (b - a) - q) / t).max(axis=1).min() for c, t in covers for a, b in pairwise(c.q)]
        assert min(apart) <= 1.0


def test_a_blend_of_a_linear_move_across_a_singularity_has_no_known_extent() -> None:
    arm = pp.load_robot("ur5").arm()
    point = np.array([-1.667, -2.745, -2.464, 1.459, -0.076, -2.179])
    target, change = arm.forward_kinematics(point), np.array([0.009, 0.071, -0.052, 0.041, -0.007, -0.06])
    target.translation = arm.forward_kinematics(point + change).translation
    line = trace_line(arm, point, target)
    assert not line.reason
    for wrist, crossed in ((0.89, True), (-0.9, False)):  # the fifth joint passes 0, or does not
        into = pp.JointPath([[-3.1, -3.1, -2.273, 1.937, wrist, -1.732], point], arm.joint_names)
        covers = blend_cover(Blend(0.1, 0.5), arm, into, line.path)
        assert (max(float(tolerance.max()) for _, tolerance in covers) >= np.pi) is crossed


def test_a_line_from_a_singular_pose_is_called_so() -> None:
    arm = pp.load_robot("ur5").arm()
    for q in ([0.0, -1.0, 1.4, -2.0, 0.0, 0.0], [0.0, -1.0, 0.0, -2.0, 1.0, 0.0]):  # wrist and elbow
        trace = trace_line(arm, np.array(q), arm.forward_kinematics(np.array(q)) * pp.pose([0.02, 0.02, -0.02]))
        assert trace.reason == "the arm is singular on it"


def test_a_side_of_a_blend_that_crosses_singularities_twice_is_noticed() -> None:
    arm = pp.load_robot("ur5").arm()
    point = np.array([0.261, -0.829, 1.369, -2.215, -0.117, -0.101])
    line = trace_line(arm, point, arm.forward_kinematics(point) * pp.pose([0.02, 0.0, 0.0]))
    for first, crossings in (([-0.115, -3.738, 1.24, -5.702, 0.227, 0.531], 2), ([0.5, -1.0, 1.5, -2.0, -0.5, 0.1], 0)):
        into = pp.JointPath([first, point], arm.joint_names)
        side = np.linspace(into.start, point, 400)[200:]  # the determinant changes its sign twice, or never
        signs = np.sign(np.linalg.det(arm.jacobian_batch(side)))
        assert np.count_nonzero(np.diff(signs)) == crossings
        covers = blend_cover(Blend(share=0.5), arm, into, line.path)
        assert (max(float(tolerance.max()) for _, tolerance in covers) >= np.pi) is bool(crossings)


def test_joint_moves_on_one_line_are_blended_on_it_and_others_are_not() -> None:
    """At any shares of both moves, also with the rounding of a text; a corner of 1 mrad is one."""
    arm, rng = pp.load_robot("ur5").arm(tcp="tool0"), np.random.default_rng(11)
    along = 0.4 * rng.normal(size=6)
    for beside, narrow in ((0.0, True), (2e-5, True), (1e-3, False)):
        middle = BENT + beside * np.eye(6)[1]
        into = pp.JointPath([BENT - along, middle], arm.joint_names)
        out = pp.JointPath([middle, BENT + 0.2 * along], arm.joint_names)
        covers = blend_cover(Blend(share=0.5), arm, into, out)
        assert all(bool(tolerance.max() < 1e-4) is narrow for _, tolerance in covers)
        dense = np.linspace(0.0, 1.0, 2001)[:, None]
        for left, gone in rng.uniform(0.0, 0.5, (40, 2)):
            q = into.end + left * (into.start - into.end) + gone * (out.end - out.start)
            apart = [
                (np.abs(a + dense * (b - a) - q) / (tolerance + 2e-4)).max(axis=1).min()
                for cover, tolerance in covers
                for a, b in pairwise(cover.q)
            ]
            assert min(apart) <= 1.0
    # One that turns back is no continuation
    back = pp.JointPath([BENT, BENT - 0.5 * along], arm.joint_names)
    covers = blend_cover(Blend(share=0.5), arm, pp.JointPath([BENT - along, BENT], arm.joint_names), back)
    assert all(tolerance.max() > 1e-3 for _, tolerance in covers)


@pytest.mark.parametrize("dialect", MOVING)
def test_blends_of_every_common_form_are_free_when_sampled(cell: Cell, dialect: str) -> None:
    checker, _ = cell
    blend = blend_of(dialect, 0.02)
    inner = BENT + np.array([[-1.1, -0.1, 0, 0, 0, 0], [-1.0, -0.15, 0.1, 0, 0.1, 0], [-0.9, 0, 0, 0, 0, 0]])
    steps = [JointMove(q, 3.0 if k else None, blend if k == 1 else None) for k, q in enumerate(inner)]
    program = make_program(steps, checker.arm.joint_names, dialect=dialect)
    certificate = certify_program(program, checker)
    points = program.moves
    blended = [i for i, move in enumerate(points) if move.blend is not None]
    assert certificate.free
    assert blended
    exact = pp.CollisionChecker(checker.arm, checker.scene, link_meshes="mesh")
    along = np.linspace(0.0, 1.0, 40)[:, None]
    for i in blended:
        at = points[i].q
        into = zone_shares(points[i].blend, checker.arm, np.stack([at, points[i - 1].q]))[0] * (points[i - 1].q - at)
        out = zone_shares(points[i].blend, checker.arm, np.stack([at, points[i + 1].q]))[0] * (points[i + 1].q - at)
        parabola = at + (1 - along) ** 2 * into + along**2 * out
        superposed = at + (1 - along) * into + along * out  # both moves at once, at constant speed
        circle = at + (1 - np.sin(along * np.pi / 2)) * into + (1 - np.cos(along * np.pi / 2)) * out
        for q in np.concatenate([parabola, superposed, circle]):
            assert exact.is_free(q)


def test_a_radius_covers_every_point_of_a_move_within_it() -> None:
    arm = pp.load_robot("ur5").arm()
    rng = np.random.default_rng(3)
    for _ in range(50):
        at, other = rng.uniform(-2, 2, (2, 6))
        radius = rng.uniform(0.001, 0.2)
        share = zone_shares(Blend(radius), arm, np.stack([at, other]))[0]
        dense = np.linspace(0, 1, 5001)
        tcp = arm.forward_kinematics_batch(at + dense[:, None] * (other - at))[:, :3, 3]
        assert dense[np.linalg.norm(tcp - tcp[0], axis=1) <= radius].max() <= share


def test_blends_that_may_overlap_are_not_free() -> None:
    arm = pp.load_robot("ur5").arm()
    checker = pp.CollisionChecker(arm)
    q = BENT + np.arange(4)[:, None] * [0.05, 0, 0, 0, 0, 0]
    tcp = arm.forward_kinematics_batch(q)[:, :3, 3]
    half = np.linalg.norm(tcp[1] - tcp[0]) / 2

    def program(radius: float) -> RobotProgram:
        inner = [JointMove(each, 0.5, Blend(radius)) for each in q[1:3]]
        return make_program([JointMove(q[0]), *inner, JointMove(q[3], 0.5)], arm.joint_names, dialect="urscript")

    assert certify_program(program(0.9 * half), checker).free
    too_large = certify_program(program(1.1 * half), checker)
    assert too_large.status is pp.CertificateStatus.UNDECIDED
    assert too_large.overlaps == (program(1.1 * half).moves[2].line,)
    with pytest.raises(pp.NoAnswer) as failed:
        too_large.or_raise()
    assert failed.value.result is too_large


@pytest.mark.parametrize("forwards", [True, False])
def test_a_radius_that_reaches_a_stop_at_the_other_end_of_a_move_is_not_free(forwards: bool) -> None:
    arm = pp.load_robot("ur5").arm()
    checker = pp.CollisionChecker(arm)
    short, long = BENT + 0.1 * np.eye(6)[0], BENT - np.array([0, 0.4, -0.4, 0, 0, 0])
    ends = (short, long) if forwards else (long, short)
    length = float(np.linalg.norm(np.diff(arm.forward_kinematics_batch([BENT, short])[:, :3, 3], axis=0)))
    for radius, status in ((0.9 * length, FREE), (1.1 * length, UNDECIDED)):
        steps = [JointMove(ends[0]), JointMove(BENT, 1.0, Blend(radius)), JointMove(ends[1], 1.0)]
        assert certified(steps, checker).status is status


@pytest.mark.parametrize("dialect", MOVING)
def test_a_blend_at_the_first_point_is_not_free(checker, dialect: str) -> None:
    blend = blend_of(dialect)
    for first, status in ((None, pp.CertificateStatus.FREE), (blend, pp.CertificateStatus.UNDECIDED)):
        steps = [JointMove(BENT, None, first), JointMove(BENT + 0.3 * np.eye(6)[0], 1.0)]
        assert certified(steps, checker, dialect).status is status


def test_exported_blends_do_not_overlap(cell: Cell) -> None:
    checker, motion = cell
    program, certificate = export_program(motion, checker, "urscript")
    assert certificate.free
    tcp = checker.arm.forward_kinematics_batch([move.q for move in program.moves])[:, :3, 3]
    radii = [0.0 if move.blend is None else move.blend.radius for move in program.moves]
    for i, distance in enumerate(np.linalg.norm(np.diff(tcp, axis=0), axis=1)):
        assert radii[i] + radii[i + 1] <= distance


@pytest.mark.parametrize("blend", [Blend(share=0.5), Blend(0.02)])
def test_every_move_and_blend_is_certified_with_the_deviations_that_it_allows(blend: Blend) -> None:
    """Before and after the inner points each joint moves by another amount, so that either side may be the larger."""
    arm, rng, deviation = pp.load_robot("ur5").arm(), np.random.default_rng(5), 0.003
    q = BENT + rng.uniform(-0.3, 0.3, (5, 6))
    steps = [JointMove(each, None if k in (0, 4) else 9.0, None if k in (0, 4) else blend) for k, each in enumerate(q)]
    dialect = "urscript" if blend.radius else "fanuc"
    program = make_program(steps, arm.joint_names, dialect=dialect, deviation=deviation)
    certificate = certify_program(program, pp.CollisionChecker(arm))
    lines, q = [step.line for step in program.moves], np.array([step.q for step in program.moves])  # as in the text
    assert list(dict.fromkeys((part.line, part.blend) for part in certificate.parts)) == [
        *((line, False) for line in lines[1:]),
        *((line, True) for line in lines[1:-1]),
    ]
    dense = np.linspace(0, 1, 2001)

    def used(at: np.ndarray, other: np.ndarray) -> float:
        """The share of a move on which the tcp is within the radius of a point."""
        if blend.radius is None:
            return blend.share
        tcp = arm.forward_kinematics_batch(at + dense[:, None] * (other - at))[:, :3, 3]
        return float(dense[np.linalg.norm(tcp - tcp[0], axis=1) <= blend.radius].max())

    certificates = [part.certificate for part in certificate.parts]
    for k, each in enumerate(certificates[:4]):
        assert each.matches(pp.JointPath(q[k : k + 2], arm.joint_names), arm, pp.Scene())
        np.testing.assert_allclose(each.tube.joints, deviation, rtol=1e-12)
    for part in certificate.parts[4:]:
        k, each = lines.index(part.line), part.certificate
        sides = np.array([used(q[k], q[k + step]) * np.abs(q[k + step] - q[k]) for step in (-1, 1)])
        # Both sides, as long as the shorter one
        alike = sides * (sides.max(axis=1).min() / sides.max(axis=1, keepdims=True))
        assert (each.tube.joints >= 0.1 * alike.max(axis=0) + deviation - 1e-12).all()
        assert (each.tube.joints <= 1.5 * sides.max(axis=0) + deviation + 0.01).all()
    assert len({(part.line, *part.certificate.tube.joints) for part in certificate.parts[4:]}) > 9


def test_a_blend_between_linear_moves_covers_the_tolerances_of_both() -> None:
    """Both changes of a superposition may be off their traces, so that their sum is off by both."""
    arm = pp.load_robot("ur5").arm()
    pose = arm.forward_kinematics(BENT)
    poses = [pose * pp.pose((0.0, 0.05 * k, 0.0), rpy=(0.0, 0.1 * k, 0.05 * k)) for k in (1, 2)]
    ends = [trace_line(arm, BENT, poses[0]).path.end]
    ends.append(trace_line(arm, ends[0], poses[1]).path.end)
    steps = [JointMove(BENT), LinearMove(ends[0], speed=0.1, blend=Blend(0.01)), LinearMove(ends[1], speed=0.1)]
    program, traces, reasons = traced(make_program(steps, arm.joint_names, dialect="urscript"), arm)
    assert not reasons
    one, other = traces.values()
    assert min(one.tolerance, other.tolerance) > 1e-5
    parts = (part for part in executed_parts(program, arm, traces) if part.blend)
    for part, (_, extent) in zip(parts, blend_cover(Blend(0.01), arm, one.path, other.path), strict=True):
        assert (part.tolerance >= extent + one.tolerance + other.tolerance - 1e-12).all()


def test_an_edit_that_leads_into_an_obstacle_is_not_free(cell: Cell) -> None:
    checker, motion = cell
    program, _ = export_program(motion, checker, "urscript")
    down = replace(program.moves[-1], q=BENT)
    edited = make_program([*program.steps[:-1], down], program.joint_names, dialect="urscript")
    assert not checker.is_free(down.q)
    certificate = certify_program(edited, checker)
    assert certificate.status is pp.CertificateStatus.COLLIDING
    assert f"line {edited.moves[-1].line}" in certificate.message


def test_a_larger_deviation_of_the_controller_needs_more_room(cell: Cell) -> None:
    checker, motion = cell
    exact = export_program(motion, checker, "urscript", deviation=0.0)[1]
    wide = export_program(motion, checker, "urscript", deviation=0.3)[1]
    assert exact.free
    assert not wide.free


def test_a_certificate_names_the_scene(cell: Cell) -> None:
    checker, motion = cell
    program, certificate = export_program(motion, checker, "krl")
    empty = certify_program(program, pp.CollisionChecker(checker.arm))
    assert empty.free
    assert empty.hash != certificate.hash


def test_points_outside_the_limits_are_reported(checker) -> None:
    steps = [JointMove(np.zeros(6)), JointMove(np.array([0, 0, 3.3, 0, 0, 0]), 2.0)]
    (sentence,) = certified(steps, checker, "rapid").outside_limits
    assert "elbow_joint" in sentence


def test_a_stream_of_set_points_is_certified_with_the_deviation_of_its_interpolation(cell: Cell) -> None:
    checker, motion = cell
    program, certificate = export_program(motion, checker, "urscript", period=0.008, deviation=0.0005)
    assert certificate.free
    assert len(program.moves) == int(np.ceil(round(motion.duration / 0.008, 6))) + 1


@pytest.fixture(scope="module")
def line() -> Cell:
    """The UR5 and a motion: a joint move, then 150 mm straight down beside a box."""
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    box = pp.Obstacle("box", pp.Box(0.1, 0.1, 0.2), pp.pose((0.5, 0.25, 0.1)))
    checker = pp.CollisionChecker(arm, pp.Scene([box]), margin=0.001)
    above = pp.AnalyticIk().solve_all(arm, pp.pose((0.5, 0.1, 0.35), (np.pi, 0, 0))).q
    start = next(q for q in above if checker.is_free(q))
    there = pp.plan_linear(checker, start, pp.pose((0.5, 0.1, 0.2), (np.pi, 0, 0))).or_raise().path
    down = pp.time_parametrise(there, arm.limits)
    first = pp.time_parametrise(pp.JointPath([start + 0.1, start], arm.joint_names), arm.limits)
    return checker, pp.Trajectory.join(first, down)


@pytest.mark.parametrize("dialect", MOVING)
@pytest.mark.slow
def test_a_straight_line_of_the_tcp_becomes_a_certified_linear_move(line: Cell, dialect: str) -> None:
    checker, motion = line
    program, certificate = export_program(motion, checker, dialect, linear=True)
    lines = [step for step in program.moves if isinstance(step, LinearMove)]
    assert certificate.free
    assert len(lines) == 1
    again = certify_program(RobotProgram.parse(program.text, dialect=dialect), checker)
    assert (again.free, again.hash) == (True, program.certificate)
    (part,) = [part for part in certificate.parts if part.name.startswith("linear")]
    assert part.line == lines[0].line
    start = program.moves[program.moves.index(lines[0]) - 1].q
    target = lines[0].pose if lines[0].q is None else checker.arm.forward_kinematics(lines[0].q)
    trace = trace_line(checker.arm, start, target)
    assert part.certificate.matches(trace.path, checker.arm, checker.scene)
    np.testing.assert_allclose(part.certificate.tube.joints, trace.tolerance + program.deviation, rtol=1e-9)


@pytest.mark.parametrize(("margin", "listed"), [(1e-5, True), (1e-3, False)])
@pytest.mark.slow
def test_a_linear_move_closer_to_a_limit_than_its_trace_is_exact_is_listed(
    line: Cell, margin: float, listed: bool
) -> None:
    checker, motion = line
    program, _ = export_program(motion, checker, "rapid", linear=True)
    target = checker.arm.forward_kinematics(program.moves[2].q)
    assert 1e-5 < trace_line(checker.arm, program.moves[1].q, target).tolerance < 1e-3
    tight = checker.arm.robot.arm(tcp="tool0", limits={"elbow_joint": (-6.0, program.moves[2].q[2] + margin)})
    near = pp.CollisionChecker(tight, checker.scene, margin=0.001)
    assert bool(certify_program(program, near).outside_limits) is listed


def test_motions_that_a_language_cannot_express_are_refused(line: Cell) -> None:
    checker, motion = line
    prismatic = pp.load_robot("stanford").arm()
    path = pp.JointPath([prismatic.home, prismatic.home + 0.01], prismatic.joint_names)
    for curve, judge, dialect, settings, words in (
        (motion, checker, "ros2", {"linear": True}, "linear moves need"),
        (motion, checker, "urscript", {"linear": True, "period": 0.008}, "linear moves need"),
        (motion, checker, "krl", {"period": 0.008}, "stream"),
        (path, pp.CollisionChecker(prismatic), "rapid", {}, "revolute"),
    ):
        with pytest.raises(InputError, match=words):
            export_program(curve, judge, dialect, **settings)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [3e-4, 0.02, 0.2])
def test_the_trace_covers_every_documented_interpolation_of_the_orientation(angle) -> None:
    """One rotation at a constant rate, or two angles: an axis of the tool swings, and the tool rotates about it."""
    arm, rng = pp.load_robot("ur5").arm(tcp="tool0"), np.random.default_rng(0)
    covered = 0
    while covered < 120:
        start = BENT + rng.uniform(-0.4, 0.4, 6)
        first = arm.forward_kinematics(start)
        end = pp.pose(first.translation + rng.uniform(-0.03, 0.03, 3))
        end.rotation = first.rotation @ turned(rng.normal(size=3), angle)
        trace = trace_line(arm, start, end)
        assert not trace.reason
        whole = first.rotation.T @ end.rotation
        for tool in np.eye(3):
            across = np.cross(tool, whole @ tool)
            swing = across * np.arctan2(np.linalg.norm(across), tool @ whole @ tool) / np.linalg.norm(across)
            spin = tool * (tool @ pin.log3(pin.exp3(swing).T @ whole))
            assert np.abs(pin.exp3(swing) @ pin.exp3(spin) - whole).max() < 1e-9
            for share in rng.uniform(0, 1, 10):
                wanted = pp.pose(first.translation + share * (end.translation - first.translation))
                wanted.rotation = first.rotation @ pin.exp3(share * swing) @ pin.exp3(share * spin)
                at = trace.path(share * trace.path.domain[1])
                found = pp.Clik(position_tolerance=1e-9, orientation_tolerance=1e-9).solve(arm, wanted, q0=at)
                assert np.abs(found.q - at).max() <= trace.tolerance + 1e-7
                covered += 1


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    """A rotation (3, 3) by a small angle about an axis."""
    x, y, z = angle * axis / np.linalg.norm(axis)
    return pp.pose((0, 0, 0), (x, y, z)).rotation


@pytest.fixture(scope="module")
def on_rail() -> pp.Arm:
    """The UR5 on a rail."""
    rail = (
        '<link name="rail"/><joint name="rail" type="prismatic"><parent link="rail"/><child link="world"/>'
        '<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" velocity="1" effort="1"/></joint></robot>'
    )
    return pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", rail)).arm(tcp="tool0")


@pytest.mark.parametrize(("dialect", "stated"), [("rapid", "[500.0000,9E9"), ("krl", "E1 500.0"), ("fanuc", "GP2")])
def test_a_motion_along_a_rail_is_exported_with_an_external_axis(on_rail: pp.Arm, dialect: str, stated: str) -> None:
    path = pp.JointPath([[0.3, *BENT], [0.5, *(BENT + 0.1)]], on_rail.joint_names)
    motion, checker = pp.time_parametrise(path, on_rail.limits), pp.CollisionChecker(on_rail)
    program, certificate = export_program(motion, checker, dialect)
    assert certificate.free
    assert (program.external_joints, stated in program.text) == ({"rail": "mm"}, True)
    with pytest.raises(InputError, match="external axes"):
        export_program(motion, checker, "urscript")


@pytest.mark.parametrize("dialect", ["rapid", "krl", "fanuc"])
def test_a_rail_moves_in_proportion_to_a_linear_move(on_rail: pp.Arm, dialect: str) -> None:
    """The tcp stays on the line of the base frame, as a stepped solution shows, within the stated tolerance."""
    arm, start = on_rail, np.array([0.3, *BENT])
    end = arm.forward_kinematics(start) * pp.pose((0.02, -0.01, 0.06), (0.0, 0.1, 0.05))
    there = trace_line(arm, start, end, np.array([0.38])).path.end
    steps = [JointMove(start), LinearMove(there, end, duration=4.0, speed=0.02)]
    program = make_program(steps, arm.joint_names, dialect=dialect, external_joints={"rail": "mm"}, deviation=0.0005)
    certificate = certify_program(program, pp.CollisionChecker(arm))
    assert certificate.free, certificate.message
    read, traces, _ = traced(program, arm)
    (trace,), q = traces.values(), np.array(read.moves[0].q)
    first, target = arm.forward_kinematics(q), arm.forward_kinematics(read.moves[1].q)
    turn, rows = pin.log3(first.rotation.T @ target.rotation), np.linspace(0.0, 1.0, len(trace.path.q))
    shares = np.linspace(0.0, 1.0, 1501)
    for share in shares:  # another solution: Newton's method on the six joints of the robot, in small steps
        q[0] = program.moves[0].q[0] + share * (read.moves[1].q[0] - program.moves[0].q[0])
        place = first.translation + share * (target.translation - first.translation)
        wanted = pin.SE3(first.rotation @ pin.exp3(share * turn), place)
        for _ in range(3):
            error = pin.log6(arm.forward_kinematics(q).actInv(wanted)).vector
            q[1:] += np.linalg.solve(arm.jacobian(q, reference="LOCAL")[:, 1:], error)
        nearest = [np.interp(share, rows, column) for column in trace.path.q.T]
        assert np.abs(q - nearest).max() <= trace.tolerance
    assert np.abs(q - read.moves[1].q).max() < 1e-6


def test_a_linear_move_that_rotates_an_external_axis_is_not_traced() -> None:
    """Also one that would rotate by full turns, and end at the same pose."""
    table = (
        '<link name="table"/><joint name="table" type="continuous"><parent link="table"/><child link="world"/>'
        '<axis xyz="0 0 1"/><limit velocity="1" effort="1"/></joint></robot>'
    )
    arm = pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", table)).arm(tcp="tool0")
    start = np.array([0.3, *BENT])
    end = arm.forward_kinematics(start) * pp.pose((0.0, 0.0, 0.05))
    assert not trace_line(arm, start, end, start[:1]).reason
    for by in (0.1, 2.0 * np.pi):
        assert "external axis" in trace_line(arm, start, end, start[:1] + by).reason


@pytest.mark.parametrize("dialect", ["rapid", "krl", "fanuc"])
def test_a_rail_may_be_at_its_end_and_a_turntable_at_any_angle_on_a_linear_move(dialect: str) -> None:
    outer = (
        '<link name="ground"/><link name="table"/><joint name="rail" type="prismatic"><parent link="ground"/>'
        '<child link="table"/><axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" velocity="1" effort="1"/></joint>'
        '<joint name="table" type="revolute"><parent link="table"/><child link="world"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>'
    )
    arm = pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", outer)).arm(tcp="tool0")
    start = np.array([1.4, 0.3012345, *BENT])
    end = arm.forward_kinematics(start) * pp.pose((0.02, -0.01, 0.06), (0.0, 0.1, 0.05))
    there = trace_line(arm, start, end, np.array([1.5, start[1]])).path.end
    steps = [JointMove(start), LinearMove(there, end, duration=4.0, speed=0.02)]
    axes = {"rail": "mm", "table": "deg"}
    certificate = certified(steps, pp.CollisionChecker(arm), dialect, external_joints=axes, deviation=0.0005)
    assert certificate.free, certificate.message


def test_a_rail_that_is_moved_in_a_text_is_traced_again(on_rail: pp.Arm) -> None:
    arm = on_rail
    start = np.array([0.3, *BENT])
    end = arm.forward_kinematics(start) * pp.pose((0.0, 0.0, 0.05))
    steps = [JointMove(start), LinearMove(pose=end, speed=0.02, external=start[:1])]
    program = make_program(steps, arm.joint_names, dialect="krl", external_joints={"rail": "mm"}, deviation=0.0005)
    assert certify_program(program, pp.CollisionChecker(arm)).free
    for value, status in (("350.00000", FREE), ("-1200.00000", UNDECIDED)):
        edited = re.sub("(LIN .*)E1 300.00000", rf"\1E1 {value}", program.text)
        moved = RobotProgram.parse(edited, dialect="krl", allow_changes=True)
        assert certify_program(moved, pp.CollisionChecker(arm)).status is status
        if status is FREE:
            assert traced(moved, arm)[0].moves[1].q[0] == pytest.approx(0.35)


@pytest.mark.parametrize("dialect", MOVING)
def test_linear_moves_with_another_tool_than_that_of_the_arm_are_undecided(dialect: str) -> None:
    tip = (
        '<link name="tip"/><joint name="tip_joint" type="fixed"><parent link="tool0"/><child link="tip"/>'
        '<origin xyz="0 0.01 0.1" rpy="0 0.3 0"/></joint></robot>'
    )
    tcp = pp.pose((0.0, 0.01, 0.1), (0.0, 0.3, 0.0))
    arm = pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", tip)).arm(tcp="tip")
    end = arm.forward_kinematics(BENT) * pp.pose((0.0, 0.0, 0.03), (0.0, 0.0, 0.1))
    there = trace_line(arm, BENT, end).path.end
    for tool, status in ((tcp, FREE), (tcp * pp.pose((0.0, 0.0, 0.2)), UNDECIDED)):
        steps = [JointMove(BENT), LinearMove(there, end, duration=4.0, speed=0.01)]
        certificate = certified(steps, pp.CollisionChecker(arm), dialect, tool=ToolData("g", tool), deviation=0.0005)
        assert certificate.status is status, certificate.message
        # Without linear moves and radii, the tool does not matter
        assert certified(steps[:1], pp.CollisionChecker(arm), dialect, tool=ToolData("g", tool)).free


def test_a_blend_beside_a_linear_move_that_cannot_be_followed_is_undecided() -> None:
    checker = pp.CollisionChecker(pp.load_robot("ur5").arm(tcp="tool0"))
    behind = BENT + np.pi * np.eye(6)[0]  # the line leads through the base
    steps = [JointMove(BENT - 0.3), JointMove(BENT, 3.0, Blend(0.02)), LinearMove(behind, duration=9.0)]
    certificate = certified(steps, checker)
    assert certificate.status is UNDECIDED
    assert "linear move at line" in certificate.message


def test_a_contact_on_a_linear_move_is_found(line: Cell) -> None:
    checker, motion = line
    arm = checker.arm
    beside, behind = (motion.end, pp.AnalyticIk().solve_all(arm, pp.pose((0.5, 0.45, 0.2), (np.pi, 0, 0))).q)
    target = behind[np.abs(behind - beside).max(axis=1).argmin()]
    steps = [JointMove(beside), LinearMove(target, duration=2.0)]
    certificate = certified(steps, checker, deviation=0.001)
    assert certificate.status is pp.CertificateStatus.COLLIDING
    assert "box" in certificate.message
    assert f"linear move at line {certificate.parts[-1].line}" in certificate.message


def test_a_linear_move_whose_joint_values_are_not_known_is_undecided(line: Cell) -> None:
    checker, motion = line
    arm, q = checker.arm, motion.end
    above = pp.AnalyticIk().solve_all(arm, pp.pose((0.5, 0.1, 0.35), (np.pi, 0, 0))).q
    branch = above[np.abs(above - q).max(axis=1).argmax()]
    turned = q + np.array([0.0, 0.0, 0.0, 1.2, 1.0, 2.5])
    for steps, words in (
        ([LinearMove(q), JointMove(motion.start)], "first move"),
        ([JointMove(q), LinearMove(turned)], "interpolations of the orientation differ"),
        ([JointMove(q), LinearMove(branch)], "another configuration"),
    ):
        certificate = certified(steps, checker)
        assert certificate.status is pp.CertificateStatus.UNDECIDED
        assert re.search(words, certificate.message)


def test_a_linear_move_takes_the_time_of_the_motion_or_longer_if_a_joint_needs_it(line: Cell) -> None:
    checker, motion = line
    motion = motion.slowed(4.0)
    program, certificate = export_program(motion, checker, "urscript", linear=True)
    assert certificate.free
    (move,) = [step for step in program.moves if isinstance(step, LinearMove)]
    before = program.moves[program.moves.index(move) - 1].q
    trace = trace_line(checker.arm, before, checker.arm.forward_kinematics(move.q))
    rates = np.abs(np.diff(trace.path.q, axis=0)).max(axis=0) * (len(trace.path.q) - 1) / checker.arm.limits.velocity
    times = motion.times[np.abs(motion(motion.times) - before).max(axis=1).argmin() :]
    assert move.duration == pytest.approx(max(times[-1] - times[0], rates.max()), abs=1e-2)


def test_a_linear_move_begins_at_the_last_set_point(line: Cell) -> None:
    checker, motion = line
    arm = checker.arm
    shift = 2e-3 * np.linspace(0.0, 1.0, 4)[:, None] * np.eye(6)[0]
    points = [StreamedPoint(q, 0.02) for q in motion.start + shift[1:]]
    target = pp.pose(arm.forward_kinematics(motion.start).translation + 0.05 * np.eye(3)[2])
    target.rotation = arm.forward_kinematics(points[-1].q).rotation
    end = trace_line(arm, points[-1].q, target).path.end
    steps = [JointMove(motion.start), *points, LinearMove(end, target, 2.0)]
    program = make_program(steps, arm.joint_names, dialect="urscript")
    certificate = certify_program(program, checker)
    assert certificate.free, certificate.message
    trace = trace_line(arm, program.moves[-2].q, arm.forward_kinematics(program.moves[-1].q))
    (part,) = [part for part in certificate.parts if part.line == program.moves[-1].line]
    assert part.certificate.matches(trace.path, arm, checker.scene)


@pytest.fixture(scope="module")
def checker() -> pp.CollisionChecker:
    return pp.CollisionChecker(pp.load_robot("ur5").arm())


class TestSpeeds:
    """FREE includes that the joints can follow: stated durations, and the set points of a stream."""

    PERIOD = 0.008

    def streamed(self, checker: pp.CollisionChecker, positions: np.ndarray) -> RobotProgram:
        """The first joint follows ``positions`` (rad from home), one set point a period."""
        home, along = checker.arm.home, np.eye(6)[0]
        points = [StreamedPoint(home + x * along, self.PERIOD) for x in positions]
        return make_program([JointMove(home), *points], checker.arm.joint_names, dialect="urscript")

    def ramp(self, checker: pp.CollisionChecker) -> np.ndarray:
        """A motion of 1 rad from rest to rest within the limits, at the period."""
        arm = checker.arm
        path = pp.JointPath([arm.home, arm.home + np.eye(6)[0]], arm.joint_names)
        motion = pp.time_parametrise(path, arm.limits)
        times = np.append(np.arange(self.PERIOD, motion.duration, self.PERIOD), motion.duration)
        return motion(times)[:, 0] - arm.home[0]

    def test_a_stream_is_free_only_from_rest_to_rest_and_without_a_jump(self, checker) -> None:
        ramp = self.ramp(checker)
        half = len(ramp) // 2
        for positions, words in (
            (ramp, []),
            (ramp[:half], ["acceleration"]),
            (ramp[half:] - ramp[half - 1], ["acceleration"]),
            (np.concatenate([ramp, np.full(20, 2.0)]), ["velocity", "acceleration"]),
        ):
            certificate = certify_program(self.streamed(checker, positions), checker)
            assert certificate.status is (pp.CertificateStatus.VIOLATED if words else pp.CertificateStatus.FREE)
            found = [
                rate for text in certificate.outside_limits for rate in ("velocity", "acceleration") if rate in text
            ]
            assert found == words

    @pytest.mark.parametrize("dialect", ["urscript", "rapid", "fanuc"])
    @pytest.mark.parametrize(("duration", "free"), [(0.01, False), (0.37, False), (0.4, True)])
    def test_a_move_is_free_only_if_its_duration_is_possible(self, checker, dialect, duration, free) -> None:
        """The first joint moves by 69 degrees; at its speed limit of pi rad/s that takes 0.38 s."""
        q = checker.arm.home + np.deg2rad(69.0) * np.eye(6)[0]
        steps = [JointMove(checker.arm.home), JointMove(q, duration)]
        certificate = certified(steps, checker, dialect)
        assert certificate.free is free
        assert bool(certificate.outside_limits) is not free

    @pytest.mark.parametrize(("speed", "free"), [(0.3, True), (3.1, True), (3.25, False), (300.0, False)])
    def test_a_move_is_free_only_if_its_speed_is_possible(self, checker, speed, free) -> None:
        """The limits are 3.15 and 3.2 rad/s. A speed in place of a duration is that of the fastest joint."""
        q = checker.arm.home + np.deg2rad(69.0) * np.array([0.5, 0, 0, 1, 0, 0])
        steps = [JointMove(checker.arm.home), JointMove(q, speed=speed)]
        program = make_program(steps, checker.arm.joint_names, dialect="urscript")
        assert program.moves[1].speed == speed
        assert certify_program(program, checker).free is free

    @pytest.mark.parametrize(("speed", "free"), [(0.1, True), (3.0, False)])
    def test_a_linear_move_is_free_only_if_its_speed_is_possible(self, checker, speed, free) -> None:
        arm = checker.arm
        start = LOW
        first = arm.forward_kinematics(start)
        end = pp.pose(first.translation + 0.2 * np.eye(3)[1], pp.xyz_rpy(first)[3:])
        steps = [JointMove(start), LinearMove(None, end)]
        text = make_program(steps, arm.joint_names, dialect="krl").text.replace("#VEL_CP,0.1", f"#VEL_CP,{speed}")
        certificate = certify_program(RobotProgram.parse(text, dialect="krl", allow_changes=True), checker)
        assert certificate.free is free, certificate.message
        there = pp.plan_linear(checker, start, end).or_raise().path.end
        steps = [JointMove(start), LinearMove(there, None, 0.3 / speed)]
        assert certified(steps, checker).free is free

    @pytest.mark.parametrize("dialect", ["urscript", "rapid", "fanuc"])
    def test_known_accelerations_are_compared_too(self, dialect) -> None:
        """From rest to rest, 0.5 rad take 2 sqrt(0.5 / 2) = 1 s at 2 rad/s^2, but 0.16 s at the largest velocity."""
        arm = pp.load_robot("ur5").arm()
        known = arm.with_limits(replace(arm.limits, acceleration=np.full(6, 2.0), acceleration_source="measured"))
        for duration, limits, free in ((0.99, known, False), (1.01, known, True), (0.3, arm, True)):
            q = arm.home + 0.5 * np.eye(6)[3]
            program = make_program([JointMove(arm.home), JointMove(q, duration)], arm.joint_names, dialect=dialect)
            assert certify_program(program, pp.CollisionChecker(limits)).free is free

    def test_known_accelerations_are_compared_on_linear_moves(self) -> None:
        """Between two stops, each joint must be able to move from one end to the other in the stated duration."""
        arm = pp.load_robot("ur5").arm()
        arm = arm.with_limits(replace(arm.limits, acceleration=np.full(6, 2.0), acceleration_source="measured"))
        start = arm.forward_kinematics(BENT)
        trace = trace_line(arm, BENT, pin.SE3(start.rotation, start.translation - 0.05 * np.eye(3)[2]))
        shortest = 2.0 * np.sqrt(np.abs(trace.path.end - BENT).max() / 2.0)
        for duration, free in ((0.98 * shortest, False), (1.05 * shortest, True)):
            steps = [JointMove(BENT), LinearMove(trace.path.end, None, duration)]
            assert certified(steps, pp.CollisionChecker(arm)).free is free

    def test_an_arm_that_does_not_stop_needs_one_ramp_less(self) -> None:
        """0.5 rad from or to rest at 2 rad/s^2 take 0.71 s, from rest to rest 1 s; a speed is stated without ramps."""
        arm = pp.load_robot("ur5").arm()
        arm = arm.with_limits(replace(arm.limits, acceleration=np.full(6, 2.0), acceleration_source="measured"))
        q = arm.home + np.array([0.0, 0.5, 1.0])[:, None] * np.eye(6)[3]
        blend = blend_of("rapid")
        for durations, blends, violations in (
            ((0.75, 0.75), (blend, None), 0), ((0.75, 0.75), (None, None), 2), ((0.7, 0.75), (blend, None), 1),
            ((0.75, 0.7), (blend, None), 1), ((1.01, 1.01), (None, None), 0),
        ):  # fmt: skip
            moves = [JointMove(at, *step) for at, step in zip(q[1:], zip(durations, blends, strict=True), strict=True)]
            program = make_program([JointMove(q[0]), *moves], arm.joint_names, dialect="rapid")
            assert len(certify_program(program, pp.CollisionChecker(arm)).outside_limits) == violations
        steps = [JointMove(q[0]), JointMove(q[1], speed=3.0)]
        program = make_program(steps, arm.joint_names, dialect="urscript")
        assert certify_program(program, pp.CollisionChecker(arm)).free

    def test_the_shortest_duration_is_that_of_a_simulated_profile(self) -> None:
        """The largest velocity profile from or to rest, integrated, covers the distance in the shortest duration."""
        rng = np.random.default_rng(4)
        arm = pp.load_robot("ur5").arm()
        for stops in (0, 1, 2):
            travel, velocity, acceleration = (rng.uniform(0.01, 3.0, 6) for _ in range(3))
            limits = replace(arm.limits, velocity=velocity, acceleration=acceleration, acceleration_source="measured")
            shortest = shortest_durations(travel, limits, stops)
            for j in range(6):
                t = np.linspace(0, shortest[j], 20001)
                rate = np.full(len(t), velocity[j])
                rate = np.minimum(rate, acceleration[j] * t) if stops > 0 else rate
                rate = np.minimum(rate, acceleration[j] * (shortest[j] - t)) if stops > 1 else rate
                assert np.trapezoid(rate, t) == pytest.approx(travel[j], rel=1e-6)
        unknown = replace(arm.limits, velocity=np.full(6, np.nan), acceleration=np.full(6, np.nan))
        assert (shortest_durations(np.ones(6), unknown, 2) < 1e-6).all()

    @pytest.mark.parametrize("dialect", MOVING)
    def test_the_shortest_durations_are_possible_after_rounding(self, dialect: str) -> None:
        """The texts round joint values and times."""
        rng, arm = np.random.default_rng(3), pp.load_robot("ur5").arm()
        arm = arm.with_limits(replace(arm.limits, acceleration=rng.uniform(2, 30, 6), acceleration_source="measured"))
        checker = pp.CollisionChecker(arm)
        for _ in range(15):
            q = arm.home + rng.normal(size=6) * rng.choice([0.003, 0.03, 0.3])
            lines = [pp.JointPath(pair, arm.joint_names) for pair in ([arm.home, q], [q, arm.home])]
            durations = [controller_motion([ControllerMove(line)], arm.limits).duration for line in lines]
            ends = zip((q, arm.home), durations, strict=True)
            steps = [JointMove(arm.home), *(JointMove(end, duration) for end, duration in ends)]
            program = make_program(steps, arm.joint_names, dialect=dialect)
            assert certify_program(program, checker).outside_limits == ()

    @pytest.mark.parametrize("dialect", MOVING)
    @pytest.mark.parametrize("following", ["wait", "output", "nothing"])
    def test_a_blend_that_no_move_follows_is_undecided(self, checker, dialect, following) -> None:
        arm = checker.arm
        q = arm.home + np.linspace(0.0, 0.1, 3)[:, None] * np.eye(6)[0]
        blend = blend_of(dialect, 0.001)
        output = SetOutput("do" if dialect == "rapid" else "1", True)
        between = {"wait": [Wait(0.5)], "output": [output], "nothing": []}[following]
        last = [] if following == "nothing" else [JointMove(q[2], 1.0)]
        for blended in (blend, None):
            steps = [JointMove(q[0]), JointMove(q[1], 1.0, blended), *between, *last]
            certificate = certified(steps, checker, dialect)
            assert bool(certificate.overlaps) is (blended is not None)
            assert certificate.status is not pp.CertificateStatus.FREE or blended is None

    def test_a_blend_before_set_points_is_undecided(self, checker) -> None:
        home = checker.arm.home
        steps = [JointMove(home - 0.1), JointMove(home, 1.0, Blend(0.01)), StreamedPoint(home + 1e-6, self.PERIOD)]
        certificate = certified(steps, checker)
        assert certificate.overlaps == (certificate.parts[1].line - 1,)
        assert certificate.status is pp.CertificateStatus.UNDECIDED

    def test_the_time_of_the_move_to_the_first_point_is_undecided(self, checker) -> None:
        home = checker.arm.home
        for first in (JointMove(home, 0.01), StreamedPoint(home, self.PERIOD)):
            certificate = certified([first, JointMove(home + 0.1, 1.0)], checker)
            assert certificate.status is pp.CertificateStatus.UNDECIDED

    def test_set_points_need_velocity_limits(self, checker) -> None:
        arm = checker.arm
        velocity = np.where(np.arange(6) == 2, np.nan, arm.limits.velocity)
        unknown = pp.CollisionChecker(arm.with_limits(replace(arm.limits, velocity=velocity)))
        certificate = certify_program(self.streamed(checker, self.ramp(checker)), unknown)
        assert certificate.status is pp.CertificateStatus.UNDECIDED
        assert "elbow_joint" in certificate.message
        steps = [JointMove(arm.home), JointMove(arm.home + 0.1, 1.0)]
        moves = certified(steps, unknown)
        assert moves.free
        assert any("elbow_joint" in note for note in moves.notes)

    def test_a_goal_of_ros_that_is_cut_at_speed_is_not_free(self, checker) -> None:
        arm = checker.arm
        path = pp.JointPath([arm.home, arm.home + 0.2], arm.joint_names)
        motion = pp.time_parametrise(path, arm.limits)

        def goal(curve: pp.Trajectory) -> RobotProgram:
            return make_program([StreamedTrajectory(curve.record())], arm.joint_names, dialect="ros2")

        assert certify_program(goal(motion), checker).free
        record = motion.record()
        for kept in (slice(0, 2), slice(1, None)):
            cut = pp.Trajectory(
                motion.times[kept] - motion.times[kept][0], record.q[kept], record.velocities[kept], arm.joint_names
            )
            certificate = certify_program(goal(cut), checker)
            assert certificate.status is pp.CertificateStatus.VIOLATED


@pytest.fixture(scope="module", params=["ur5", "generic_6dof"])
def arm(request) -> pp.Arm:
    return pp.load_robot(request.param).arm()


def scaled_jacobian(arm: pp.Arm, q: np.ndarray) -> np.ndarray:
    """The Jacobian (6, n) with lengths in units of UNIT."""
    return np.array([1.0 / UNIT] * 3 + [1.0] * 3)[:, None] * arm.jacobian(q)


def change(arm: pp.Arm) -> float:
    """The bound of the change of the Jacobian per unit change of the joint values."""
    return float(np.sqrt(arm.dof * (1.0 + (levers(arm) / UNIT) ** 2).sum()))


def test_levers_bound_the_distance_of_the_tcp_from_each_axis(arm) -> None:
    rng = np.random.default_rng(0)
    speeds = np.array([np.linalg.norm(arm.jacobian(q)[:3], axis=0) for q in rng.uniform(-3, 3, (300, arm.dof))])
    assert (speeds.max(axis=0) <= levers(arm) + 1e-12).all()
    assert (levers(arm) <= 2.0 * speeds.max(axis=0) + 0.2).all()


def test_levers_contain_the_travel_of_prismatic_joints() -> None:
    links = "".join(f'<link name="l{k}"/>' for k in range(4))
    joints = "".join(
        f'<joint name="j{k}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="0.1 0 0.2"/>'
        f'<axis xyz="{axis}"/><limit lower="-0.2" upper="0.7" velocity="1" effort="1"/></joint>'
        for k, (kind, axis) in enumerate([("revolute", "0 0 1"), ("prismatic", "1 0 0"), ("revolute", "0 1 0")])
    )
    sliding = pp.load_robot(f'<robot name="sliding">{links}{joints}</robot>').arm(tcp="l3")
    samples = np.random.default_rng(0).uniform(*sliding.limits.sampling_range(), (2000, 3))
    speeds = np.array([np.linalg.norm(sliding.jacobian(q)[:3], axis=0) for q in samples])
    assert (speeds.max(axis=0) <= levers(sliding) + 1e-12).all()
    assert (levers(sliding) <= speeds.max(axis=0) + 0.8).all()


def test_the_jacobian_changes_by_no_more_than_its_bound(arm) -> None:
    rng = np.random.default_rng(1)
    for q in rng.uniform(-3, 3, (50, arm.dof)):
        step = rng.normal(size=arm.dof)
        step *= 10.0 ** rng.uniform(-4, -1) / np.linalg.norm(step)
        moved = np.linalg.norm(scaled_jacobian(arm, q + step) - scaled_jacobian(arm, q), 2)
        assert moved <= change(arm) * np.linalg.norm(step)


def test_the_tolerance_is_the_derived_bound(arm) -> None:
    """The chord between samples, and the turn of the orientation by its share, with the inverse at the samples."""
    rng, traced = np.random.default_rng(2), 0
    while traced < 4:
        start = rng.uniform(-2, 2, arm.dof)
        first = arm.forward_kinematics(start)
        axis, angle = rng.normal(size=3), float(rng.choice([0.0, 1e-4, 5e-4]))
        turn = pin.exp3(angle * axis / np.linalg.norm(axis))
        target = pin.SE3(first.rotation @ turn, first.translation + rng.uniform(-0.025, 0.025, 3))
        trace = trace_line(arm, start, target)
        if trace.reason:
            continue
        traced += 1
        q = trace.path.q
        ends = [arm.forward_kinematics(each) for each in (q[0], q[-1])]
        assert np.abs(ends[1].homogeneous - target.homogeneous).max() < 1e-9
        bound, moved = change(arm), np.linalg.norm(np.diff(q, axis=0), axis=1)
        inverse = np.array([np.linalg.norm(np.linalg.inv(scaled_jacobian(arm, each)), 2) for each in q])
        least = 1.0 / np.maximum(inverse[1:], inverse[:-1]) - bound * moved / 2.0
        apart = 0.3 * bound * moved**2 + interpolation_difference(pin.log3(turn))
        tube = ((least - np.sqrt(least**2 - 2.0 * bound * apart)) / bound).max()
        assert tube <= trace.tolerance <= (1 + 1e-6) * tube + 1.01 * ROUNDED
        # The samples are on the line, in equal steps, and on one branch.
        for share, each in zip(np.linspace(0, 1, len(q)), q, strict=True):
            at = arm.forward_kinematics(each).translation
            np.testing.assert_allclose(
                at, first.translation + share * (target.translation - first.translation), atol=1e-9
            )


def test_the_pose_on_a_chord_is_as_near_to_the_line_as_the_bound_of_traces_states(arm) -> None:
    """Poses of random chords, whose ends are joined by lines with one rotation."""
    rng, seen = np.random.default_rng(4), 0.0
    for _ in range(60):
        ends = rng.uniform(-2, 2, arm.dof) + np.array([[0.0], [1.0]]) * rng.normal(size=arm.dof) * rng.uniform(
            0.01, 0.1
        )
        first, last = (arm.forward_kinematics(q) for q in ends)
        turn, most = pin.log3(first.rotation.T @ last.rotation), change(arm) * np.linalg.norm(ends[1] - ends[0]) ** 2
        for share in np.linspace(0.0, 1.0, 21):
            here = arm.forward_kinematics(ends[0] + share * (ends[1] - ends[0]))
            place = first.translation + share * (last.translation - first.translation) - here.translation
            rotation = pin.log3(here.rotation.T @ first.rotation @ pin.exp3(share * turn))
            seen = max(seen, np.hypot(np.linalg.norm(place) / UNIT, np.linalg.norm(rotation)) / most)
    assert 0.01 < seen < 0.3


def test_a_line_close_to_a_singularity_is_not_traced() -> None:
    """The elbow of the UR5 is nearly stretched at the end; at the start it is bent."""
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    bent, stretched = np.array([0.3, -1.2, 1.0, -1.4, -1.5, 0.2]), np.array([0.3, -1.2, 1e-4, -0.4, -1.5, 0.2])
    end = arm.forward_kinematics(bent)
    end.translation = arm.forward_kinematics(stretched).translation
    assert trace_line(arm, bent, end).reason
