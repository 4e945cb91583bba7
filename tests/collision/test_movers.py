"""Certificates among obstacles that move with time, against placements that the test computes for each instant."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import coal
import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof.collision import audit, with_movers
from pinproof.motion import separate

SLACK = 1e-5
"""Metres: distances of coal are compared up to this."""

FREE, COLLIDING = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING


@cache
def ur5():
    return pp.load_robot("ur5").arm()


@cache
def checker():
    things = [pp.Obstacle(f"part{i}", pp.Box(0.06, 0.06, 0.1), pp.pose((0.45, 0.3 * i - 0.9, 0.1))) for i in range(5)]
    belt = pp.Obstacle("belt", pp.Box(0.3, 4.0, 0.04), pp.pose((0.45, 0, 0.02)))
    return pp.CollisionChecker(ur5(), pp.Scene([belt, *things], allowed=[("base_link", "belt")]))


def over_the_belt(height: float, *, jerk: float | None = None) -> pp.Trajectory:
    """The tool passes over the belt, from one side to the other."""
    ends = [pp.pose((0.45, y, height), (np.pi, 0, 0)) for y in (-0.3, 0.3)]
    first = pp.AnalyticIk().solve_all(ur5(), ends[0]).q[0]
    last = pp.AnalyticIk().solve_all(ur5(), ends[1]).q
    path = pp.JointPath(np.array([first, last[np.abs(last - first).max(axis=1).argmin()]]), ur5().joint_names)
    return pp.time_parametrise(path, ur5().limits, jerk=jerk).slowed(4.0)


def poses_at(mover: pp.Mover, value: float) -> pin.SE3:
    """``root_from_root`` that the mover applies to its obstacles, by the definition of its axis."""
    axis = np.array(mover.axis)
    if mover.type == "prismatic":
        return pin.SE3(np.eye(3), value * axis)
    rotation = pin.exp3(value * axis)
    point = np.array(mover.point)
    return pin.SE3(rotation, point - rotation @ point)


def distance_at(base: pp.CollisionChecker, movers, trajectory, t: float) -> float:
    """The smallest distance at an instant, by coal, with every body placed here."""
    arm, q = base.arm, trajectory(t)
    moved = {
        name: poses_at(m, float(m.trajectory(min(t, m.trajectory.duration))[0])) for m in movers for name in m.obstacles
    }
    placed = []
    for body in base.bodies:
        if body.link is None:
            placed.append(moved.get(body.owner, pin.SE3.Identity()) * body.link_from_body)
        else:
            placed.append(arm.root_from_base * arm.frame_placement(q, body.link) * body.link_from_body)
    found = []
    for i, j in base.pairs:
        first, second = (coal.Transform3s(placed[k].rotation, placed[k].translation) for k in (i, j))
        shapes = base.bodies[i].geometry, base.bodies[j].geometry
        found.append(coal.distance(shapes[0], first, shapes[1], second, coal.DistanceRequest(), coal.DistanceResult()))
    return min(found)


MOVERS = {
    "conveyor": pp.Mover.constant("conveyor", [f"part{i}" for i in range(5)], 0.2, 20.0, axis=(0, 1, 0)),
    "late conveyor": pp.Mover.constant("conveyor", ["part1", "part2"], -0.4, 20.0, axis=(0, 2, 0), start=2.0),
    "table": pp.Mover.constant(
        "table", ["part0", "part2", "part3"], 0.7, 20.0, type="revolute", axis=(0, 0, 1), point=(0.45, 0.1, 0)
    ),
    "lift": pp.Mover(
        "lift",
        ("part2",),
        pp.time_parametrise(pp.JointPath([[0.0], [0.1], [-0.02]], ["z"]), pp.JointLimits([-1], [1], [0.4], [1.0])),
        axis=(0, 0, 1),
        rests=True,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "jerk"),
    # the lift moves on a cubic, whose acceleration jumps, so it cannot be combined with a quintic
    [(name, jerk) for jerk in (None, 80.0) for name in MOVERS if (name, jerk) != ("lift", 80.0)],
)
def test_verdict_among_movers_agrees_with_dense_samples_in_time(name: str, jerk: float | None) -> None:
    movers, verdicts = [MOVERS[name]], set()
    for height in (0.17, 0.32):
        trajectory = over_the_belt(height, jerk=jerk)
        certificate = pp.certify(trajectory, checker(), movers=movers)
        verdicts.add(certificate.status)
        if certificate.status is FREE:
            times = np.linspace(0.0, trajectory.duration, 60)
            nearest = min(distance_at(checker(), movers, trajectory, t) for t in times)
            assert nearest > certificate.clearance - SLACK
            assert audit(trajectory, checker(), movers=movers, step=0.01, measure=False).clean
        else:
            assert certificate.status is COLLIDING
            time = certificate.first_contact.time
            assert distance_at(checker(), movers, trajectory, time) < SLACK
            before = np.linspace(0.0, certificate.first_contact.proven_free_until, 25)
            assert min(distance_at(checker(), movers, trajectory, t) for t in before) > -SLACK
    assert FREE in verdicts


@pytest.mark.parametrize("name", MOVERS)
def test_placements_of_a_mover_follow_the_definition_of_its_axis(name: str) -> None:
    mover = MOVERS[name]
    times = np.array([0.0, 0.3, 1.1, 25.0])
    for t, placement in zip(times, mover.placements(times), strict=True):
        value = float(mover.trajectory(min(t, mover.trajectory.duration))[0])
        assert np.abs(placement - poses_at(mover, value).homogeneous).max() < 1e-12


@pytest.mark.parametrize("start", [0.0, 1.5, -2.0])
def test_obstacles_of_constant_speed_are_at_their_poses_at_the_start_time(start: float) -> None:
    speed = 0.3
    slide = pp.Mover.constant("m", ["part0"], speed, 20.0, axis=(0, 3, 4), start=start)
    turn = pp.Mover.constant("m", ["part0"], speed, 20.0, type="revolute", axis=(0, 0, 2), point=(1, 0, 0), start=start)
    for t in (0.0, 0.7, 13.0):
        value = speed * (t - start)
        (slid,), (turned,) = slide.placements(np.array([t])), turn.placements(np.array([t]))
        np.testing.assert_allclose(slid, pp.pose((0, 0.6 * value, 0.8 * value)).homogeneous, atol=1e-12)
        about = pp.pose((1, 0, 0)) * pp.pose(rpy=(0, 0, value)) * pp.pose((-1, 0, 0))
        np.testing.assert_allclose(turned, about.homogeneous, atol=1e-12)


def test_verdict_depends_on_when_a_part_passes() -> None:
    """A part crosses the path of the tool at the time at which the tool is there, or long before it."""
    trajectory = over_the_belt(0.12)
    base = pp.CollisionChecker(ur5(), checker().scene.remove(*[f"part{i}" for i in range(1, 5)]))
    way = (
        ur5().forward_kinematics(trajectory(trajectory.duration / 2)).translation - base.scene["part0"].pose.translation
    )
    way[2] = 0.0
    length, speed = np.linalg.norm(way), 0.4
    meets = {
        share: pp.Mover.constant(
            "m", ["part0"], speed, 60.0, axis=way, start=trajectory.duration * share - length / speed
        )
        for share in (0.5, -1.0)
    }
    assert pp.certify(trajectory, base).status is FREE
    met = pp.certify(trajectory, base, movers=[meets[0.5]])
    assert met.status is COLLIDING
    assert "part0" in met.first_contact.bodies
    assert pp.certify(trajectory, base, movers=[meets[-1.0]]).status is FREE
    hit = audit(trajectory, base, movers=[meets[0.5]], step=0.02, measure=False)
    assert {"part0"} <= {name for _, pair in hit.contacts for name in pair}
    assert audit(trajectory, base, movers=[meets[-1.0]], step=0.02, measure=False).clean


def test_defaults_of_a_mover_add_nothing() -> None:
    """It slides along x from its pose at the value 0, has no tolerance, and does not rest at the end."""
    still = pp.Trajectory([0.0, 20.0], [[0.1], [0.3]], np.full((2, 1), 0.01), ["z"])
    for mover in (pp.Mover("m", ("part2",), still), pp.Mover.constant("m", ["part2"], 0.01, 20.0, start=-10.0)):
        np.testing.assert_allclose(mover.placements(np.array([10.0]))[0], pp.pose((0.2, 0, 0)).homogeneous, atol=1e-12)
        assert with_movers(over_the_belt(0.32), checker(), [mover]).tolerances.tolist() == [0.0] * 7
        assert mover.rests is False
    turned = pp.Mover("m", ("part2",), still, "revolute")
    about_x = pp.pose(rpy=(0.2, 0, 0)).homogeneous
    np.testing.assert_allclose(turned.placements(np.array([10.0]))[0], about_x, atol=1e-12)


def test_setups_with_other_movers_differ() -> None:
    """Each number of a mover is a part of what a motion was certified for."""
    mover, base = MOVERS["table"], checker()
    changes = {
        "name": "other", "obstacles": ("part0",), "trajectory": MOVERS["lift"].trajectory, "type": "prismatic",
        "axis": (0, 1, 1), "point": (0.4, 0.1, 0), "tolerance": 1e-3, "rests": True,
    }  # fmt: skip
    assert set(changes) == {each.name for each in fields(mover)}
    movers = [(), (mover,), (mover, MOVERS["lift"]), *((replace(mover, **{key: changes[key]}),) for key in changes)]
    hashes = [base.spec.setup_hash(each) for each in movers]
    assert len(set(hashes)) == len(hashes)
    assert base.spec.setup_hash((replace(mover),)) == hashes[1]


def test_tolerance_of_a_mover_is_covered_by_the_proof() -> None:
    trajectory = over_the_belt(0.25)

    def rising(tolerance: float) -> pp.Certificate:
        start = trajectory.duration  # the part rises and is at its pose in the scene at the end of the motion
        mover = pp.Mover.constant("lift", ["part3"], 0.05, 20.0, axis=(0, 0, 1), start=start, tolerance=tolerance)
        return pp.certify(trajectory, checker(), movers=[mover])

    assert rising(0.005).status is FREE
    assert rising(0.3).status is not FREE


def test_motion_of_another_arm_of_a_cell_is_a_moving_obstacle() -> None:
    cell = pp.assemble({"a": (ur5(), np.eye(4)), "b": (ur5(), pp.pose((0.75, 0, 0), (0, 0, np.pi)))})
    rng, both = np.random.default_rng(4), pp.CollisionChecker(cell)
    alone = pp.CollisionChecker(cell.arms["a"])
    seen = set()
    while len(seen) < 2:
        start, end = rng.uniform(-1.5, 1.5, (2, 12))
        together = pp.time_parametrise(pp.JointPath(np.array([start, end]), cell.joint_names), cell.limits)
        parts = separate(together, cell)
        parts = {
            name: pp.Trajectory(each.times, each.q, each.velocities, [f"{name}/{joint}" for joint in each.joint_names])
            for name, each in parts.items()
        }
        certificate = pp.certify(parts["a"], alone, movers=[parts["b"]])
        assert certificate.status is pp.certify(together, both).status
        seen.add(certificate.status)


def test_links_of_another_arm_are_as_fine_as_in_the_group() -> None:
    cell = pp.assemble({"a": (ur5(), np.eye(4)), "b": (ur5(), pp.pose((0.75, 0, 0), (0, 0, np.pi)))})
    names = cell.arms["b"].joint_names
    still = pp.Trajectory([0.0, 1.0], np.vstack([cell.arms["b"].home] * 2), np.zeros((2, 6)), names)
    own = pp.Trajectory([0.0, 1.0], np.vstack([cell.arms["a"].home] * 2), np.zeros((2, 6)), cell.arms["a"].joint_names)
    moving = with_movers(own, pp.CollisionChecker(cell.arms["a"]), [still]).checker
    both = pp.CollisionChecker(cell)
    assert moving.finer == both.finer
    assert moving.pairs == both.pairs


def test_certificate_among_movers_belongs_to_the_motion_of_all_and_is_verified(tmp_path) -> None:
    trajectory, movers = over_the_belt(0.32), [MOVERS["conveyor"]]
    certificate = pp.certify(trajectory, checker(), movers=movers, record=True)
    timed = with_movers(trajectory, checker(), movers)
    assert timed.trajectory.joint_names == (*ur5().joint_names, "conveyor")
    moving = timed.checker
    assert certificate.matches(timed.trajectory, moving.group, moving.scene, moving.attached)
    assert not certificate.matches(trajectory, ur5(), checker().scene)
    certificate.save(tmp_path / "proof.json")
    assert pp.verify_proof(tmp_path / "proof.json").ok


def test_movers_are_checked_against_the_base_but_not_against_other_obstacles() -> None:
    moving = with_movers(over_the_belt(0.32), checker(), [MOVERS["conveyor"]]).checker
    owners = {frozenset((moving.bodies[i].owner, moving.bodies[j].owner)) for i, j in moving.pairs}
    assert {frozenset((link, "part1")) for link in ("base_link", "shoulder_link", "ee_link")} <= owners
    assert not {frozenset(("part0", "part1")), frozenset(("part0", "belt"))} & owners
    still = {frozenset((checker().bodies[i].owner, checker().bodies[j].owner)) for i, j in checker().pairs}
    assert owners == still


def trajectory_of(*names: str) -> pp.Trajectory:
    return pp.Trajectory([0.0, 1.0], np.zeros((2, len(names))), np.zeros((2, len(names))), names)


@pytest.mark.parametrize(
    ("mover", "words"),
    [
        (lambda: pp.Mover.constant("m", ["part1"], 0.1, 0.2), "covers 0.2 s"),
        (lambda: pp.Mover.constant("m", ["prt1"], 0.1, 20.0), "prt1"),
        (lambda: pp.Mover.constant("belt", ["part1"], 0.1, 20.0), "rename it"),
        (lambda: pp.Mover.constant("m", [], 0.1, 20.0), "no obstacle"),
        (lambda: pp.Mover.constant("m", ["part1"], 0.1, 20.0, axis=(0, 0, 0)), "no direction"),
        (lambda: pp.Mover.constant("m", ["part1"], 10.0, 20.0), "more than 30 m"),
        (lambda: pp.Mover.constant("m", ["part1"], 0.1, 20.0, type="screw"), "screw"),
        (lambda: pp.Mover.constant("m", ["part1"], np.nan, 20.0), "speed"),
        (lambda: pp.Mover("m", ("part1",), trajectory_of("a", "b")), "one joint"),
        (lambda: trajectory_of("elbow_joint"), "'elbow_joint' is moved twice"),
        (lambda: trajectory_of("nothing"), "nothing"),
        (lambda: "belt", "not str"),
        (lambda: [MOVERS["conveyor"], pp.Mover.constant("other", ["part1"], 0.1, 20.0)], "moved by both"),
    ],
)
def test_wrong_movers_are_refused(mover, words: str) -> None:
    def judge(given) -> None:
        pp.certify(over_the_belt(0.32), checker(), movers=given if isinstance(given, list) else [given])

    with pytest.raises(pp.InputError, match=words):
        judge(mover())


def test_movers_need_time_and_have_tolerances_of_their_own() -> None:
    trajectory = over_the_belt(0.32)
    path = pp.JointPath(trajectory.q[[0, -1]], ur5().joint_names)
    for curve, settings, words in ((path, {}, "no timing"), (trajectory, {"obstacle_tolerance": 0.01}, "tolerance")):
        with pytest.raises(pp.InputError, match=words):
            pp.certify(curve, checker(), movers=[MOVERS["conveyor"]], **settings)


def test_tolerances_of_several_movers_are_those_of_their_joints() -> None:
    movers = [replace(MOVERS[name], obstacles=(part,), tolerance=tolerance)
              for name, part, tolerance in (("conveyor", "part1", 1e-3), ("table", "part2", 2e-3))]  # fmt: skip
    timed = with_movers(over_the_belt(0.32), checker(), movers)
    assert timed.trajectory.joint_names[6:] == ("conveyor", "table")
    assert timed.tolerances.tolist() == [0.0] * 6 + [1e-3, 2e-3]
