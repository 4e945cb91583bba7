"""The motion bound: how near bodies may come between samples, by samples and by the mathematics of the manual."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof import _core
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.motion import CubicPath
from pinproof.verifier import IntervalBounds, Proof, curve_digest

from .exact_cells import Cell, PairMotion, cell, constraint_bound, largest_error

FREE, COLLIDING = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING


class Bounds:
    """The core's bounds of a checker's pairs on a piece about q: by default straight, from -delta to delta."""

    def __init__(self, checker, q, delta, extra=None, piece=None):
        extra = np.zeros(len(q)) if extra is None else extra
        self.piece = np.array([q - delta, q + delta]) if piece is None else piece
        self._core = _core.MotionBounds(checker.world, q, np.abs(self.piece - q).max(axis=0), extra)
        self.roughly = self._core.rough

    def closely(self, k, u, split=None):
        split = self.roughly(k).split if split is None else split
        bound = self._core.tight(k, u, split, self.piece)
        return bound.distance, bound.growth


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "panda", "stanford", "planar_2r"])
@pytest.mark.parametrize("straight", [True, False])
def test_no_pair_comes_nearer_than_its_bounds_allow(request, oracle, name, straight):
    """The rough bound of distances anywhere in the box about q, tolerance and growth included. The close bound of gaps
    along the curve, off it by the tolerance, and off it by the amount for which the growth is valid, for every division
    of the joints between the two bodies; the gap is that of supports in a direction that the middle link carries.
    """
    arm = pp.load_robot("stanford").arm() if name == "stanford" else request.getfixturevalue(name)
    scene = pp.Scene([pp.Obstacle("box", pp.Box(0.2, 0.2, 0.2), pp.pose((0.5, 0.3, 0.4)))])
    tool = pp.Obstacle("tool", pp.Box(0.02, 0.02, 0.2), pp.pose((0, 0, 0.1)))
    checker = pp.CollisionChecker(arm, scene, attached=[tool])
    independent, rng, tight = oracle(checker), np.random.default_rng(4), []
    for size in (0.005, 0.05, 0.3, 0.05):
        q = rng.uniform(-2, 2, arm.dof)
        delta, extra = rng.uniform(-size, size, arm.dof), rng.uniform(0, 0.02, arm.dof) * rng.integers(2)
        start = rng.uniform(-size, size, arm.dof)
        bent = np.array([q + start, q - (start + delta) / 2, q + delta])  # a parabola whose middle is q
        bounds = Bounds(checker, q, delta, extra, None if straight else bent)
        roughly = [bounds.roughly(k) for k in range(len(checker.pairs))]
        before, more = np.maximum(independent.distances(q), 0), float(rng.choice([0.0, 0.01, 0.2]))
        allowed = np.array([bound.distance + more * bound.growth for bound in roughly])
        reach = np.abs(bounds.piece - q).max(axis=0) + extra + more
        for corner in rng.choice([-1.0, 1.0], size=(8, arm.dof)):
            assert (before - np.maximum(independent.distances(q + corner * reach), 0) <= allowed + 1e-9).all()

        more = float(rng.choice([0.0, _core.GROWTH_RANGE]))
        shares = rng.uniform(0, 1, 12)
        points = [_on(bounds.piece, s) + rng.choice([-1, 1], arm.dof) * (extra + more) for s in (0.0, 1.0, *shares)]
        for k in rng.choice(len(checker.pairs), size=min(12, len(checker.pairs)), replace=False).tolist():
            measured = checker._placed(q).measure(k)
            if measured.proven <= 0:
                continue
            least = min(checker._placed(p).measure(k).proven for p in points)
            for split in range(len(checker.world.joints_between(k)) + 1):
                near, growth = bounds.closely(k, measured.normal, split)
                assert least >= measured.proven - near - more * growth - 1e-9
            rough = roughly[k].distance
            if not extra.any() and rough > 0:
                tight.append(bounds.closely(k, measured.normal)[0] / rough)
    if name != "planar_2r" and straight:
        assert np.median(tight) < 0.7  # it is worth its name


def _on(piece, s):
    while len(piece) > 1:
        piece = piece[:-1] * (1 - s) + piece[1:] * s
    return piece[0]


def test_a_folded_planar_arm_is_not_judged_by_the_least_radius_or_by_exchanged_roles(planar_2r, path):
    """The second link is folded back onto the first, its tip at the shoulder, a peg beside it near the shoulder.

    The tip is 0 away from the first axis: a least radius, or joint 1 judged by another body than the one that is walked
    to, says that nothing can come nearer. In fact the far end of the folded link sweeps past.
    """
    folded = np.array([0.0, np.pi])
    peg = pp.Obstacle("peg", pp.Sphere(0.02), pp.pose((0.5 * np.cos(0.35), 0.5 * np.sin(0.35), 0.03)))
    checker = pp.CollisionChecker(planar_2r, pp.Scene([peg]))
    assert checker.is_free(folded)
    moving = path(planar_2r, folded, folded + np.array([0.7, 0.0]))
    assert checker.is_free(moving.end)
    certificate = pp.certify(moving, checker)
    assert certificate.status is COLLIDING
    assert "peg" in certificate.first_contact.bodies
    names = [tuple(checker.bodies[i].owner for i in pair) for pair in checker.pairs]
    bound = Bounds(checker, folded, np.array([0.35, 0.0])).roughly(names.index(("fore", "peg"))).distance
    by_hand = 2 * np.sin(0.35 / 2) * np.hypot(0.5, 0.01)  # the farthest corner of the folded link from the first axis
    assert by_hand <= bound <= 1.05 * by_hand


def test_a_folded_planar_arm_is_not_judged_with_roles_exchanged_joint_by_joint(arm_from_links, path, first_touch):
    """The tip is folded back onto the shoulder, a peg is at the elbow, both small.

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
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("peg", pp.Sphere(0.01), pp.pose((0.5, 0, 0)))]))
    folded, turn = np.array([0.0, np.pi]), np.full(2, 1.3 * np.pi / 3)
    edge = path(arm, folded - turn, folded + turn)
    for q in (edge.start, folded, edge.end):
        assert checker.clearance(q) > 0.2
    certificate = pp.certify(edge, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(checker, edge), abs=1e-3)


@pytest.mark.parametrize("thickness", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("kind", ["box", "disc", "hull", "exact"])
def test_a_thin_plate_across_a_fast_wrist_is_never_jumped_over(
    ur5, mesh_file, thickness, kind, path, assert_free_until
):
    """A tool of 0.5 m swings through half a turn in one edge; both ends are free."""
    shape = {
        "box": lambda: pp.Box(0.3, 0.3, thickness),
        "disc": lambda: pp.Cylinder(0.15, thickness),
        "hull": lambda: pp.Mesh(mesh_file(trimesh.creation.box((0.3, 0.3, thickness)))),
        "exact": lambda: pp.Mesh(mesh_file(trimesh.creation.box((0.3, 0.3, thickness))), hull=False),
    }[kind]()
    tool = pp.Obstacle("tool", pp.Cylinder(0.003, 0.5), pp.pose((0, 0, 0.25)))
    start, end = ur5.home.copy(), ur5.home.copy()
    start[3] -= 1.2
    end[3] += 0.8
    middle = (start + end) / 2
    turned = ur5.forward_kinematics(middle) * pp.pose((0, 0, 0.45), (0, np.pi / 2, 0))  # its plane holds the tool
    across = turned * pp.pose(rpy=(0, 0, 0))
    scene = pp.Scene([pp.Obstacle("plate", shape, across)])
    checker = pp.CollisionChecker(ur5, scene, attached=[tool], allowed=[("tool", f) for f in ("wrist_2_link",)])
    swing = path(ur5, start, end)
    assert checker.is_free(start)
    assert checker.is_free(end)
    certificate = pp.certify(swing, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies == ("tool", "plate")
    assert_free_until(checker, swing, certificate.first_contact.proven_free_until, 100)


KINDS = ("rprpr", "rrrr", "ppp")


def balls_of(known: Cell) -> list[int]:
    """The pairs of two balls."""
    return [k for k, (_, b) in enumerate(known.owners) if b in known.balls or b == "thing0"]


def random_box(known: Cell, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A configuration, control points of a cubic about it, the half sides of their box, and tolerances."""
    count = known.checker.arm.dof
    q, size = rng.uniform(-1, 1, count), float(rng.choice([0.01, 0.1, 0.6, 3.0]))
    control = q + size * rng.uniform(-1, 1, (4, count)) * rng.uniform(size=count)
    return q, control, np.abs(control - q).max(axis=0), rng.uniform(0, 0.05, count) * rng.integers(2)


def rehashed(document: dict, control: np.ndarray, extra: np.ndarray) -> Proof:
    """The parts of a proof of another curve, with the hash of that."""
    document["curve"] |= {"knots": [0.0, 1.0], "control": [control.tolist()]}
    document["settings"]["joint_tolerance"], document["intervals"] = extra.tolist(), [[0.0, 1.0]]
    names = tuple(document["curve"]["joint_names"])
    document["hashes"]["curve"] = curve_digest(names, np.array([0.0, 1.0]), control[None])
    return Proof(document)


@pytest.mark.parametrize("kinds", KINDS)
def test_bounds_of_the_core_are_those_of_the_derivation(kinds: str) -> None:
    known, rng = cell(1, kinds), np.random.default_rng(5)
    for _ in range(20):
        q, control, delta, extra = random_box(known, rng)
        bounds = _core.MotionBounds(known.checker.world, q, delta, extra)
        larger = float(rng.choice([1e-3, 0.01, _core.GROWTH_RANGE]))
        wider = _core.MotionBounds(known.checker.world, q, delta, extra + larger)
        for k in rng.choice(balls_of(known), size=12, replace=False).tolist():
            motion, u = PairMotion.of(known, known.owners[k], q), rng.normal(size=3)
            u /= np.linalg.norm(u)
            count = len(motion.joints)
            assert len(known.checker.world.joints_between(k)) == count
            rough = bounds.rough(k)
            assert rough.distance >= min(motion.rough(delta + extra, s) for s in range(count + 1)) - 1e-12
            assert rough.distance == pytest.approx(motion.rough(delta + extra, rough.split), abs=1e-9)
            assert wider.rough(k).distance <= rough.distance + larger * rough.growth + 1e-12
            for split in range(count + 1) if known.owners[k][1] in known.balls else [count]:
                exact = motion.tight(control, q, delta, extra, u, split)
                tight = bounds.tight(k, u, split, control)
                assert tight.distance >= exact - 1e-12
                assert wider.tight(k, u, split, control).distance <= tight.distance + larger * tight.growth + 1e-12


def part_of(curve, start: float, end: float) -> np.ndarray | None:
    """The control points of a part of one piece of a curve, by de Casteljau's algorithm; None if it is of several."""
    knots, control = curve.bezier()
    piece = int(np.clip(np.searchsorted(knots, start, side="right") - 1, 0, len(control) - 1))
    if end > knots[piece + 1]:
        return None
    width = max(knots[piece + 1] - knots[piece], 1e-300)
    first, last = (start - knots[piece]) / width, (end - knots[piece]) / width

    def before(points: np.ndarray, share: float) -> np.ndarray:
        """The control points of the beginning of a piece."""
        found, rest = [], points
        while len(rest):
            found.append(rest[0])
            rest = rest[:-1] * (1 - share) + rest[1:] * share
        return np.array(found)

    begun = before(control[piece], last)
    return before(begun[::-1], 1.0 - first / last if last else 1.0)[::-1]


@pytest.mark.parametrize("kinds", KINDS)
def test_certificates_state_no_more_than_their_bounds(kinds: str) -> None:
    """For each pair of balls on each interval, the distance at the middle without the bound and the rounding; and for a
    constraint the largest of the bounds of all intervals.
    """
    known, rng = cell(1, kinds), np.random.default_rng(9)
    arm, rows, spans = known.checker.arm, 0, 0
    checker = known.checker
    while rows < 120 or spans < 30:
        at = rng.uniform(-1, 1, (3, arm.dof)) * np.where(np.array(list(kinds)) == "r", 1.5, 0.3)
        at[1:] = at[0] + np.array([[0.02], [0.3]]) * (at[1:] - at[0])  # slow, then fast
        curve = (CubicPath.through if rng.integers(2) else pp.JointPath)(at, arm.joint_names)
        extra = np.full(arm.dof, 1e-3) * rng.integers(2)
        constraint = random_constraint(str(rng.choice(CONSTRAINTS)), known, at[0], rng)
        certificate = pp.certify(
            curve,
            checker,
            constraints=[constraint],
            joint_tolerance=extra,
            record=True,
            limits=None,
            max_intervals=2000,
        )
        if not certificate.free:
            continue
        for start, end, pair, proven, *u in rng.permutation(certificate.evidence)[:150]:
            control, k = part_of(curve, start, end), int(pair)
            if control is None or known.owners[k][1] not in known.balls:
                continue
            q = curve((start + end) / 2)
            motion, delta = PairMotion.of(known, known.owners[k], q), np.abs(control - q).max(axis=0)
            distance, splits = known.distances(q[None])[0, k], range(len(motion.joints) + 1)
            losses = [motion.rough(delta + extra, s) for s in splits]
            if any(u):
                losses += [motion.tight(control, q, delta, extra, np.array(u), s) for s in splits]
                np.testing.assert_allclose(u, motion.direction, atol=1e-6)
            assert proven <= distance - min(losses) - checker.rounding + 1e-11
            rows += 1
        largest = []
        for start, end in certificate.constraints[0].evidence:
            control, q = part_of(curve, start, end), curve((start + end) / 2)
            if control is not None:
                delta = np.abs(control - q).max(axis=0)
                largest.append(largest_error(constraint, known, q, control, delta, extra))
        spans += len(largest)
        assert max(largest) < certificate.constraints[0].largest <= max(largest) + 0.02


@pytest.mark.parametrize("kinds", KINDS)
def test_bounds_of_the_verifier_are_those_of_the_derivation(kinds: str) -> None:
    known, rng = cell(1, kinds), np.random.default_rng(6)
    some = rng.uniform(-0.5, 0.5, (50, len(kinds)))
    curve = pp.JointPath(some[[known.distances(some).min(axis=1).argmax()]], known.checker.arm.joint_names)
    certificate = pp.certify(curve, known.checker, record=True, limits=None).or_raise()
    document = proof_document(certificate, curve, known.checker)
    assert [pair["bodies"] for pair in document["pairs"]] == [list(pair) for pair in known.checker.pairs]
    for _ in range(12):
        q, control, delta, extra = random_box(known, rng)
        proof = rehashed(document, control, extra)
        table = IntervalBounds(proof, np.array([[0.0, 1.0]]))
        q, delta = table.q[0], (control.max(axis=0) - control.min(axis=0)) / 2
        for k in rng.choice(balls_of(known), size=12, replace=False).tolist():
            motion, u = PairMotion.of(known, known.owners[k], q), rng.normal(size=3)
            u /= np.linalg.norm(u)
            count, (i, j) = len(motion.joints), known.checker.pairs[k]
            found = table.distance(np.array([i]), np.array([j]), np.array([0]), u[None])[0]
            gap = float(u @ (motion.centres[1] - motion.centres[0])) - sum(motion.radii)
            splits = range(count + 1) if known.owners[k][1] in known.balls else [count]
            losses = [motion.rough(delta + extra, s) for s in splits]
            losses += [motion.tight(control, q, delta, extra, u, s) for s in splits]
            assert found <= gap - min(losses) + 1e-12
            assert found >= gap - min(motion.rough(delta + extra, s) for s in splits) - 1e-9


CONSTRAINTS = ("upright", "within", "look_at")


def random_constraint(kind: str, known: Cell, q: np.ndarray, rng: np.random.Generator):
    """A constraint of the tcp of a kind that q (n,) satisfies with an error of some hundredths."""
    at = known.frames(q[None])[known.joints[len(q) - 1].child][0]
    axis, point = rng.normal(size=3), rng.uniform(-0.2, 0.2, 3)
    axis /= np.linalg.norm(axis)
    if kind == "upright":
        up = at[:3, :3] @ axis + rng.normal(scale=0.02, size=3)
        return pp.Upright(tolerance=0.3, axis_in_tcp=axis, up=up)
    if kind == "look_at":
        seen = (at @ [*(rng.uniform(0.3, 1.5) * axis + rng.normal(scale=0.02, size=3)), 1.0])[:3]
        return pp.collision.LookAt(tolerance=0.3, axis_in_tcp=axis, point=seen)
    near = (at @ [*point, 1.0])[:3] + rng.normal(scale=0.02, size=3)
    box = pp.pose(near, rng.uniform(-3, 3, 3))
    return pp.Within.box(box, rng.uniform(0.0, 0.05, 3), tolerance=0.1, point_in_tcp=point)


@pytest.mark.parametrize("kind", CONSTRAINTS)
@pytest.mark.parametrize("kinds", KINDS)
def test_bounds_of_constraints_are_those_of_the_derivation(kinds: str, kind: str) -> None:
    """Those of the core and of the verifier; the error at a configuration is exact."""
    known, rng = cell(1, kinds), np.random.default_rng(7)
    arm, finite = known.checker.arm, 0
    some = rng.uniform(-0.5, 0.5, (50, len(kinds)))
    start = some[known.distances(some).min(axis=1).argmax()]
    still, satisfied = pp.JointPath([start], arm.joint_names), random_constraint(kind, known, start, rng)
    certificate = pp.certify(still, known.checker, constraints=[satisfied], record=True, limits=None).or_raise()
    document = proof_document(certificate, still, known.checker)
    for _ in range(16):
        _, control, _, extra = random_box(known, rng)
        q = np.array([1, 3, 3, 1]) / 8 @ control
        delta = np.abs(control - q).max(axis=0)
        constraint = random_constraint(kind, known, q if rng.integers(2) else start, rng)
        nothing = np.zeros(arm.dof)
        error, _ = constraint_bound(arm, constraint, q[None], nothing)
        _, bound = constraint_bound(arm, constraint, control, extra)
        exact = largest_error(constraint, known, q, q[None], nothing, nothing)
        if np.isfinite(exact):
            assert error == pytest.approx(exact, abs=1e-9)
        assert constraint.error(arm, q) == pytest.approx(error, abs=1e-9)
        assert bound >= largest_error(constraint, known, q, control, delta, extra) + 1e-12
        finite += np.isfinite(bound)

        proof = rehashed(document, control, extra)
        table = IntervalBounds(proof, np.array([[0.0, 1.0]]))
        delta = (control.max(axis=0) - control.min(axis=0)) / 2
        (found,) = proof.constraints[0].errors(table, proof.joints, extra)
        expected = largest_error(satisfied, known, table.q[0], control, delta, extra)
        assert found >= expected - 1e-13
        if np.isfinite(found):
            assert found == pytest.approx(expected, abs=1e-6)
    assert finite >= 3
