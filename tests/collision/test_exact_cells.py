"""Verdicts a few micrometres above and below contact, on robots of balls whose distances are known to 1e-12 m."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import pinproof as pp
from pinproof import _core
from pinproof.collision import is_proven_free
from pinproof.motion import CubicPath
from pinproof.planning import Edges

from .exact_cells import cell

FREE, COLLIDING = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING
KINDS = ("rprpr", "rrrr", "ppp")
SLACK = 1e-4
"""Metres between a margin and the distance: a bound that is weaker by that is noticed."""


def configurations(kinds: str, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, n) random values: angles within 2 rad, lengths within 0.3 m."""
    return rng.uniform(-1, 1, (count, len(kinds))) * np.where(np.array(list(kinds)) == "r", 2.0, 0.3)


def of_pairs(pairs, values) -> dict[tuple[str, str], float]:
    """The margins of pairs of owners."""
    return {names: float(value) for names, value in zip(pairs, values, strict=True)}


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_each_pair_is_in_contact_exactly_up_to_its_own_margin(kinds: str, seed: int) -> None:
    """All margins are 1 um below the distances; then that of one pair is 1 um above it, the largest or another."""
    known, rng = cell(seed, kinds), np.random.default_rng(seed)
    at = configurations(kinds, 40, rng)
    distances = known.distances(at)
    apart = np.flatnonzero(distances.min(axis=1) > 2e-6)[:3]
    assert len(apart)
    for q, gaps in zip(at[apart], distances[apart], strict=True):
        assert known.checker.clearance(q) == pytest.approx(gaps.min(), abs=2 * known.checker.rounding)
        assert known.checker.clearance(q) <= gaps.min() + 1e-12
        assert known.checker.clearance_batch([q])[0] == known.checker.clearance(q)
        near = known.checker.with_margin(margins=of_pairs(known.owners, gaps - 1e-6))
        assert near.is_free(q)
        assert near.is_free_batch([q, q]).all()
        assert near.check(q).free
        for k in {
            int(gaps.argmax()),
            *known.checker.still_pairs[:2].tolist(),
            *rng.integers(len(gaps), size=8).tolist(),
        }:
            beyond = np.where(np.arange(len(gaps)) == k, 1e-6, -1e-6)
            touching = near.with_margin(margins=of_pairs(known.owners, gaps + beyond))
            assert not touching.is_free(q)
            assert not touching.is_free(q)  # from now on by the function that the first query prepared
            assert not touching.is_free_batch([q]).any()
            (contact,) = touching.check(q).contacts
            assert contact.bodies == known.owners[k]
            assert contact.distance == pytest.approx(gaps[k], abs=1e-8)
            lengths = np.linalg.norm(contact.points[1] - contact.points[0])
            assert lengths == pytest.approx(gaps[k], abs=1e-6)
            np.testing.assert_allclose(contact.points[0] + gaps[k] * contact.normal, contact.points[1], atol=1e-6)


@pytest.mark.parametrize("kinds", KINDS)
def test_a_base_in_an_obstacle_is_in_contact_at_every_configuration(kinds: str) -> None:
    """All other pairs are far apart, and no joint moves the base."""
    known, rng = cell(2, kinds), np.random.default_rng(3)
    at = configurations(kinds, 200, rng)
    q = at[known.distances(at).min(axis=1).argmax()]
    base = pp.Obstacle("block", pp.Sphere(0.03), pp.pose(known.balls["base"][1] + [0, 0, -0.02]))
    checker = known.checker.with_scene(pp.Scene([base]))
    depth = 0.03 + known.balls["base"][2] - 0.02
    assert not checker.is_free(q)
    assert not checker.is_free(q)
    assert not checker.is_free_batch([q]).any()
    assert checker.clearance(q) == pytest.approx(-depth, abs=1e-6)
    assert checker.clearance_batch([q])[0] == pytest.approx(-depth, abs=1e-6)
    (contact,) = checker.check(q).contacts
    assert set(contact.bodies) == {"base", "block"}
    assert contact.depth == pytest.approx(depth, abs=1e-6)
    for waypoints in ([q], [q, q + 1e-3]):
        curve = pp.JointPath(waypoints, checker.arm.joint_names)
        certificate = pp.certify(curve, checker)
        assert certificate.status is COLLIDING
        assert certificate.first_contact.time == 0.0
        assert set(certificate.first_contact.bodies) == {"base", "block"}
        assert certificate.first_contact.penetrating
        assert not is_proven_free(curve, checker)
        edges = Edges(checker, 0.02, np.array(waypoints))
        assert not edges.samples_free(waypoints[0], waypoints[-1])
        assert not edges.proven_free(waypoints[0], waypoints[-1])


def random_curve(kinds: str, rng: np.random.Generator, names: tuple[str, ...]) -> pp.JointPath | CubicPath:
    """A single configuration, a short path of lines, or a cubic."""
    at = configurations(kinds, 3, rng)
    at[1:] = at[0] + rng.choice([0.05, 0.4]) * (at[1:] - at[0])
    kind = rng.integers(4)
    if kind == 3:
        return CubicPath.through(at, names)
    return pp.JointPath(at[: kind + 1], names)


def is_edge(curve) -> bool:
    """Whether a curve is one straight edge."""
    return isinstance(curve, pp.JointPath) and len(curve.q) == 2


def edge_is_free(checker: pp.CollisionChecker, curve) -> bool:
    """Whether the compiled core proves a path of one straight edge free, for the planners."""
    edges = _core.EdgeChecker(checker.world, 1e-3)
    return bool(edges.proven_free(curve.q[0], curve.q[1]))


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_grazing_motions_are_judged_by_their_smallest_distances(kinds: str, seed: int) -> None:
    """All margins are just below what the distances on the curve allow; then that of one pair is just above it.

    The tolerances of joints and obstacles are covered, and what a certificate states beyond its verdict is true.
    """
    known, rng = cell(seed % 3, kinds), np.random.default_rng([seed, len(kinds)])
    checker, count = known.checker, len(kinds)
    obstacle = np.array([checker.bodies[j].link is None for _, j in checker.pairs])
    follower = np.array(["follower" in names for names in known.owners])
    corners = np.array(list(product([-1.0, 1.0], repeat=count)))
    judged = 0
    for _ in range(8):
        curve = random_curve(kinds, rng, checker.arm.joint_names)
        off, moved = float(rng.choice([0.0, 5e-4])), float(rng.choice([0.0, 3e-3]))
        on_curve = curve(np.linspace(*curve.domain, 401))
        distances = known.distances(on_curve)
        nearest = on_curve[np.unique(distances.argmin(axis=0))]

        def least(by: float, nearest=nearest) -> np.ndarray:
            """(P,) the smallest distances on the curve, if each joint deviates by this."""
            return known.distances((nearest[:, None] + by * corners).reshape(-1, count)).min(axis=0)

        exact = distances.min(axis=0)
        gaps = least(off) if off else exact
        slack = SLACK if not off else 4 * SLACK  # of the products of two deviations, at most 1e-5 m each
        margins = gaps - moved * obstacle - slack
        if off:  # the joint and its follower are assumed to deviate independently
            margins -= 10 * off * follower
        if margins.min() < 1e-6:
            continue
        judged += 1
        # The pairs that no joint moves may have a common margin, and the others none.
        still, style = np.isin(np.arange(len(margins)), checker.still_pairs), rng.integers(4)
        if style == 0:
            margins[still] = margins[still].min()
        elif style == 1:
            margins[~still] = 0.0
        elif style == 2:  # of all but one pair
            margins[np.arange(len(margins)) != rng.choice(np.flatnonzero(still & obstacle))] = 0.0
        settings = {"joint_tolerance": off, "obstacle_tolerance": moved, "limits": None, "max_intervals": 5000}
        near = checker.with_margin(margins=of_pairs(known.owners, margins))
        certificate = pp.certify(curve, near, record=bool(rng.integers(2)), **settings)
        assert certificate.status is FREE
        # What is proven is smaller than the distances by the allowance for rounding, and not by much more.
        assert margins.min() < certificate.clearance <= (gaps - moved * obstacle).min() - checker.rounding + 1e-12
        assert exact.min() - 5e-5 < certificate.observed
        tube = certificate.tube
        assert 0 <= tube.largest_obstacles <= (gaps - moved * obstacle - margins)[obstacle].min()
        assert (least(off + tube.largest_joints) - moved * obstacle > margins).all()
        assert tube.largest_joints > 0
        for start, end, pair, proven in (
            () if certificate.evidence is None else rng.permutation(certificate.evidence[:, :4])[:30]
        ):
            some = curve(np.linspace(start, end, 5))
            some = np.concatenate([some, some + off * corners[0], some + off * corners[-1]])
            assert proven <= known.distances(some)[:, int(pair)].min() - checker.rounding + 1e-12
        assert off or moved or is_proven_free(curve, near)
        assert off or moved or not is_edge(curve) or edge_is_free(near, curve)
        for k in {*rng.choice(len(margins), size=5, replace=False).tolist(), int(rng.choice(checker.still_pairs))}:
            if off and follower[k]:
                continue
            closer = margins.copy()
            closer[k] = gaps[k] - moved * obstacle[k] + slack
            closer = near.with_margin(margins=of_pairs(known.owners, closer))
            certificate = pp.certify(curve, closer, **settings)
            assert certificate.status is not FREE
            assert pp.certify(curve, closer, tolerance=100.0, **settings).status is not FREE
            assert off or moved or not is_proven_free(curve, closer)
            if not (off or moved or k in checker.still_pairs) and is_edge(curve):
                assert not edge_is_free(closer, curve)
            if off == 0.0:
                assert certificate.status is COLLIDING
                assert certificate.first_contact.bodies == known.owners[k]
                assert certificate.first_contact.distance <= gaps[k] - moved * obstacle[k] + slack + 1e-9
    assert judged >= 3


@pytest.mark.parametrize("kinds", KINDS)
def test_no_deviation_in_the_largest_tube_brings_a_pair_to_its_margin(kinds: str) -> None:
    """Of single pairs that are far apart, so that the tubes are large; also for motions that are not small."""
    known, rng = cell(1, kinds), np.random.default_rng(11)
    checker, largest = known.checker, []
    moving = np.setdiff1d(np.arange(len(checker.pairs)), checker.still_pairs)
    while len(largest) < 80:
        k, curve = int(rng.choice(moving)), random_curve(kinds, rng, checker.arm.joint_names)
        on_curve = curve(np.linspace(*curve.domain, 60))
        gap = known.distances(on_curve)[:, k].min()
        alone = checker.without_pairs(np.setdiff1d(np.arange(len(checker.pairs)), k))
        margin = max(gap - float(rng.uniform(0.02, 0.5)), 0.0)
        certificate = pp.certify(curve, alone.with_margin(margin), limits=None, max_intervals=2000)
        if not certificate.free:
            continue
        tube = certificate.tube.largest_joints
        largest.append(tube)
        off = rng.uniform(-1, 1, (8, *on_curve.shape))
        off[:4] = np.sign(off[:4])
        around = (on_curve + min(tube, 10.0) * off).reshape(-1, len(kinds))
        assert known.distances(around)[:, k].min() > margin
    assert np.mean(np.array(largest) > 0.05) > 0.1


def test_the_largest_tube_of_a_pendulum_above_the_floor_keeps_it_above(arm_from_links) -> None:
    """At the top of its circle the ball does not approach the floor to first order, but a large deviation lowers it."""
    arm = arm_from_links(
        {"root": "", "arm": '<sphere radius="0.01"/>@0 0 0.5'}, [("j", "revolute", "root", "arm", "0 0 0", "0 1 0")]
    ).arm(tcp="arm")
    for swing, height in product((0.0, 0.05, 0.1, 0.15), (0.39, 0.4, 0.41, 0.45)):
        checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("floor", pp.HalfSpace(), pp.pose((0, 0, height)))]))
        certificate = pp.certify(pp.JointPath([[-swing], [swing]], arm.joint_names), checker)
        assert certificate.free
        assert 0.5 * np.cos(swing + certificate.tube.largest_joints) - 0.01 - height > 0
        assert certificate.tube.largest_joints > 0.03


@pytest.mark.parametrize("kinds", KINDS)
def test_displaced_obstacles_limit_the_clearance_even_if_they_are_far(kinds: str) -> None:
    """Links are closest to each other; obstacles may be displaced to 70 % of that distance."""
    known, rng = cell(1, kinds), np.random.default_rng(12)
    checker, judged = known.checker, 0
    obstacle = np.array([checker.bodies[j].link is None for _, j in checker.pairs])
    for q in configurations(kinds, 60, rng):
        gaps = known.distances(q[None])[0]
        own, moved = gaps[~obstacle].min(), gaps[obstacle].min() - 0.7 * gaps[~obstacle].min()
        if min(gaps.min(), moved) < 1e-3:
            continue
        judged += 1
        curve = pp.JointPath([q], checker.arm.joint_names)
        certificate = pp.certify(curve, checker, obstacle_tolerance=moved, limits=None)
        assert certificate.free
        rounded = 1e-15  # of the differences that the test and the checker compute
        assert 0.3 * own < certificate.clearance <= 0.7 * own - checker.rounding + rounded
        assert 0 < certificate.tube.largest_obstacles <= 0.7 * own - checker.rounding + rounded
        nearer = pp.certify(curve, checker, obstacle_tolerance=moved + 0.7 * own + 1e-6, limits=None)
        assert nearer.status is COLLIDING
    assert judged >= 20


def tcp_errors(known, constraint, Q: np.ndarray) -> np.ndarray:
    """(N,) the errors of a constraint at Q (N, n), by products of matrices."""
    tcp = known.frames(Q)[known.joints[Q.shape[1] - 1].child]
    turned, at = tcp[:, :3, :3], tcp[:, :3, 3]
    if isinstance(constraint, pp.Within):
        point = (tcp @ [*constraint.point_in_tcp, 1.0])[:, :3] - constraint.base_from_region.translation
        local = point @ constraint.base_from_region.rotation
        return np.linalg.norm(local - np.clip(local, constraint.low, constraint.high), axis=1)
    axis = turned @ constraint.axis_in_tcp
    view = np.broadcast_to(constraint.up, at.shape) if isinstance(constraint, pp.Upright) else constraint.point - at
    return np.arctan2(np.linalg.norm(np.cross(axis, view), axis=1), np.einsum("nx,nx->n", axis, view))


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_constraints_are_proven_up_to_their_largest_error_on_the_curve(kinds: str, seed: int) -> None:
    """A tolerance just above the largest error is proven; one just below it is violated, wherever the error is reached.

    The tolerance of the joints is covered.
    """
    known, rng = cell(seed % 2, kinds), np.random.default_rng([seed, 7])
    arm, count = known.checker.arm, len(kinds)
    checker = known.checker.without_pairs(range(len(known.checker.pairs)))
    corners = np.array(list(product([-1.0, 1.0], repeat=count)))
    judged = 0
    for _ in range(12):
        curve = random_curve(kinds, rng, arm.joint_names)
        off = float(rng.choice([0.0, 1e-4]))
        times = np.linspace(*curve.domain, 401)
        on_curve = curve(times)
        at = known.frames(on_curve[:1])[known.joints[count - 1].child][0]
        axis, point = rng.normal(size=3), rng.uniform(-0.2, 0.2, 3)
        axis /= np.linalg.norm(axis)
        kind = rng.integers(3)
        if kind == 0:
            made = pp.Upright(tolerance=1.0, axis_in_tcp=axis, up=at[:3, :3] @ axis + rng.normal(scale=0.05, size=3))
        elif kind == 1:
            place = pp.pose((at @ [*point, 1.0])[:3] + rng.normal(scale=0.05, size=3), rng.uniform(-3, 3, 3))
            made = pp.Within.box(place, rng.uniform(0, 0.05, 3), tolerance=1.0, point_in_tcp=point)
        else:
            made = pp.collision.LookAt(tolerance=1.0, axis_in_tcp=axis, point=(at @ [*axis + 0.05 * point, 1.0])[:3])
        errors = tcp_errors(known, made, on_curve)
        largest = errors.max()
        reached = tcp_errors(known, made, on_curve[errors.argmax()] + off * corners).max()
        if not 1e-3 < reached < (10.0 if kind == 1 else 1.2):
            continue
        judged += 1
        assert made.error(arm, on_curve[0]) == pytest.approx(errors[0], abs=1e-9)
        settings = {"joint_tolerance": off, "limits": None, "record": True}
        slack = 2e-3 if off else 2e-5  # tolerances of joints count by their speeds in any direction
        kept = pp.certify(curve, checker, constraints=[replace(made, tolerance=reached + slack)], **settings)
        assert kept.status is FREE
        (proof,) = kept.constraints
        assert largest - slack - 1e-5 < proof.observed <= min(proof.largest, largest + 1e-5)
        assert reached - 1e-5 < proof.largest <= reached + slack
        spans = proof.evidence[np.argsort(proof.evidence[:, 0])]
        assert spans[0, 0] == times[0]
        assert spans[-1, 1] == times[-1]
        assert (spans[1:, 0] <= spans[:-1, 1]).all()
        tight = replace(made, tolerance=reached - 2e-5)
        refused = pp.certify(curve, checker, constraints=[tight], **settings)
        assert refused.status is not FREE
        assert np.isnan(refused.constraints[0].largest)
        if off == 0.0:
            found = refused.violation
            first = times[errors > tight.tolerance][0]
            assert refused.status is pp.CertificateStatus.VIOLATED
            assert found.satisfied_until <= first + (times[-1] - times[0]) / 400
            assert found.error == pytest.approx(tcp_errors(known, tight, found.q[None])[0], abs=1e-9)
            assert found.error > tight.tolerance
    assert judged >= 4


@pytest.mark.parametrize("kind", [pp.Upright, pp.Within, pp.collision.LookAt])
def test_a_constraint_that_differs_in_any_number_is_another_one(kind) -> None:
    known = cell(0)
    curve = pp.JointPath([np.zeros(5)], known.checker.arm.joint_names)
    given = {
        pp.Upright: {"tolerance": 1.5, "axis_in_tcp": (0.0, 0.0, 1.0), "up": (0.0, 0.1, 1.0)},
        pp.collision.LookAt: {"tolerance": 1.5, "axis_in_tcp": (0.0, 0.0, 1.0), "point": (0.0, 0.0, 5.0)},
        pp.Within: {
            "tolerance": 9.0, "base_from_region": pp.pose(), "low": (-1.0, -1.0, -1.0), "high": (1.0, 1.0, 1.0),
            "point_in_tcp": (0.1, 0.2, 0.3),
        },
    }[kind]  # fmt: skip
    axis = known.frames(np.zeros((1, 5)))["link4"][0][:3, :3].T
    if "axis_in_tcp" in given:
        given["axis_in_tcp"] = tuple(axis @ [0.0, 0.0, 1.0])
    certificate = pp.certify(curve, known.checker, constraints=[kind(**given)], limits=None)
    assert certificate.constraints[0].largest < 1.5 if kind is not pp.Within else 9.0
    changes = {
        "tolerance": 1.4, "axis_in_tcp": (1.0, 0.0, 0.0), "up": (0.0, 0.1001, 1.0), "point": (0.0, 0.0, 5.0001),
        "base_from_region": pp.pose((1e-9, 0, 0)), "low": (-1.0, -1.0001, -1.0), "high": (1.0, 1.0, 1.0001),
        "point_in_tcp": (0.1, 0.2, 0.30001),
    }  # fmt: skip

    def matches(**values) -> bool:
        constraints = [kind(**{**given, **values})]
        return certificate.matches(curve, known.checker.arm, known.checker.scene, known.checker.attached, constraints)

    assert matches()
    assert not any(matches(**{key: changes[key]}) for key in given)
