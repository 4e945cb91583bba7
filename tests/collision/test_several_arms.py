"""Collision checks and certificates of joint groups, against placements and distances that do not use the group."""

from __future__ import annotations

from functools import cache

import coal
import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import audit, is_proven_free

MOUNT = pp.pose(xyz=(0.75, 0.1, 0.0), rpy=(0.0, 0.0, np.pi))
SLACK = 1e-5
"""Metres: distances of coal are compared up to this."""


@cache
def two_ur5():
    arm = pp.load_robot("ur5").arm()
    return pp.assemble({"a": (arm, np.eye(4)), "b": (arm, MOUNT)})


@cache
def cell_checker():
    table = pp.Scene([pp.Obstacle("post", pp.Box(0.05, 0.05, 0.6), pp.pose(xyz=(0.37, 0.4, 0.3)))])
    return pp.CollisionChecker(two_ur5(), table)


class Oracle:
    """Distances by coal of the bodies of two robots, each placed by its own model, and of the obstacles."""

    def __init__(self) -> None:
        self.arm = pp.load_robot("ur5").arm()
        scene = cell_checker().scene
        self.checker = pp.CollisionChecker(self.arm, scene)
        self.links = [body for body in self.checker.bodies if body.link is not None]
        self.obstacles = [body for body in self.checker.bodies if body.link is None]
        bodies = self.checker.bodies
        self.own = [(bodies[i].name, bodies[j].name) for i, j in self.checker.pairs if bodies[j].link is not None]

    def distance(self, q) -> float:
        placed = []
        for mount, part in ((pp.pose(), q[:6]), (MOUNT, q[6:])):
            at = {body.link: mount * self.arm.frame_placement(part, body.link) for body in self.links}
            placed.append({body.name: (body, at[body.link] * body.link_from_body) for body in self.links})
        pairs = [(placed[0][a], placed[1][b]) for a in placed[0] for b in placed[1]]
        pairs += [(robot[a], robot[b]) for robot in placed for a, b in self.own]
        pairs += [(one, (body, body.link_from_body)) for r in placed for one in r.values() for body in self.obstacles]
        return min(_distance(*one, *other) for one, other in pairs)


def _distance(a, at_a, b, at_b) -> float:
    first, second = (coal.Transform3s(at.rotation, at.translation) for at in (at_a, at_b))
    return float(coal.distance(a.geometry, first, b.geometry, second, coal.DistanceRequest(), coal.DistanceResult()))


@pytest.mark.slow
def test_clearance_of_a_cell_is_that_of_two_separate_robots() -> None:
    checker, oracle = cell_checker(), Oracle()
    rng = np.random.default_rng(0)
    seen = set()
    for q in rng.uniform(-2.5, 2.5, (80, 12)):
        true = oracle.distance(q)
        seen.add(true > 0)
        if true > SLACK:
            assert abs(checker.clearance(q) - true) < SLACK
        assert checker.is_free(q) == (true > 0) or abs(true) < SLACK
    assert seen == {True, False}


@pytest.mark.slow
def test_edges_of_two_arms_are_free_or_colliding_as_dense_samples_show() -> None:
    checker, oracle = cell_checker(), Oracle()
    rng = np.random.default_rng(1)
    verdicts = {pp.CertificateStatus.FREE: 0, pp.CertificateStatus.COLLIDING: 0}
    for _ in range(20):
        start = rng.uniform(-2.5, 2.5, 12)
        end = start + rng.uniform(-0.6, 0.6, 12)
        edge = pp.JointPath(np.array([start, end]), two_ur5().joint_names)
        certificate = pp.certify(edge, checker)
        assert certificate.status in verdicts
        verdicts[certificate.status] += 1
        assert is_proven_free(edge, checker) == (certificate.status is pp.CertificateStatus.FREE)
        if certificate.status is pp.CertificateStatus.FREE:
            samples = [oracle.distance(q) for q in edge(np.linspace(0, 1, 20))]
            assert min(samples) > certificate.clearance - SLACK
        else:
            assert oracle.distance(certificate.first_contact.q) < SLACK
    assert min(verdicts.values()) > 3


def test_all_pairs_of_links_of_different_robots_are_checked() -> None:
    checker = cell_checker()
    owners = {frozenset((checker.bodies[i].owner, checker.bodies[j].owner)) for i, j in checker.pairs}
    links = pp.CollisionChecker(pp.load_robot("ur5").arm()).obstacles_and_links
    assert {frozenset((f"a/{one}", f"b/{other}")) for one in links for other in links} <= owners
    assert not [e for e in checker.excluded if e.owners[0][:2] != e.owners[1][:2]]


def test_pairs_within_each_robot_equal_the_pairs_of_the_robot_alone() -> None:
    alone = pp.CollisionChecker(pp.load_robot("panda").arm())
    panda, ur10 = pp.load_robot("panda").arm(), pp.load_robot("ur10").arm()
    cell = pp.CollisionChecker(pp.assemble({"p": (panda, np.eye(4)), "u": (ur10, pp.pose(xyz=(2, 0, 0)))}))
    excluded = {(tuple(name[2:] for name in e.owners), e.reason.partition(";")[0])
                for e in cell.excluded if e.owners[0][:2] == "p/"}  # fmt: skip
    assert excluded == {(e.owners, e.reason.partition(";")[0]) for e in alone.excluded}


def test_cell_with_overlapping_bases_is_refused_with_the_names() -> None:
    arm = pp.load_robot("ur5").arm()
    near = pp.assemble({"a": (arm, np.eye(4)), "b": (arm, pp.pose(xyz=(0.1, 0, 0)))})
    with pytest.raises(pp.InputError, match=r"a/base_link penetrates b/base_link"):
        pp.CollisionChecker(near)
    allowed = pp.CollisionChecker(near, allowed=[("a/base_link", "b/base_link")])
    assert ("a/base_link", "b/base_link") in {e.owners for e in allowed.excluded}


def test_object_is_attached_to_the_named_arm() -> None:
    checker, q = cell_checker(), two_ur5().home
    tool = pp.Obstacle("tool", pp.Sphere(0.02), pp.pose(xyz=(0, 0, 0.05)), arm="b")
    carried = checker.with_attached(tool)
    index = next(i for i, body in enumerate(carried.bodies) if body.name == "tool")
    expected = two_ur5().tcp_placements(q)["b"] * tool.pose
    assert np.allclose(carried._placed(q).root_from_body(index), expected.homogeneous, atol=1e-9)


def test_questions_to_several_arms_name_the_arm() -> None:
    checker, ball = cell_checker(), pp.Sphere(0.02)
    beams = [pp.Obstacle("beam", ball, arm=arm) for arm in ("a", "b")]
    for ask, words in (
        (lambda: checker.with_attached(pp.Obstacle("tool", ball)), "the arms a, b; name one"),
        (lambda: checker.with_attached(pp.Obstacle("tool", ball, arm="c")), "unknown arm 'c'"),
        (lambda: pp.Obstacle("beam", ball, arm=("a", "b")), "plan_carry"),
        (lambda: checker.with_attached(*beams), "'beam'"),
        (lambda: checker.arm, "the arms a, b"),
        (lambda: pp.plan_linear(checker, two_ur5().home, pp.pose()), "one arm"),
    ):
        with pytest.raises(pp.InputError, match=words):
            ask()


def test_planned_motion_of_two_arms_is_certified_saved_verified_and_audited(tmp_path) -> None:
    group, checker = two_ur5(), cell_checker()
    free = [q for q in np.random.default_rng(3).uniform(-2, 2, (60, 12)) if checker.is_free(q)]
    plan = pp.RrtConnect().plan(checker, free[0], free[1], rng=0).or_raise()
    path = pp.shortcut(plan.path, checker, rng=0)
    trajectory = pp.time_parametrise(path, group.limits)
    certificate = pp.certify(trajectory, checker, record=True)
    assert certificate.status is pp.CertificateStatus.FREE
    assert certificate.matches(trajectory, group, checker.scene)
    assert audit(trajectory, checker, step=0.01, measure=False).clean
    certificate.save(tmp_path / "proof.json")
    assert pp.verify_proof(tmp_path / "proof.json").ok
