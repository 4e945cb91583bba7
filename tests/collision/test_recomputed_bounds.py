"""The bounds between samples are not smaller than those of docs/mathematics.md, computed here for balls."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof import _core
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.motion import CubicPath
from pinproof.verifier import IntervalBounds, Proof

from .exact_cells import Cell, PairMotion, cell, constraint_bound, largest_error

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
    while rows < 250 or spans < 60:
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
        document["curve"] |= {"knots": [0.0, 1.0], "control": [control.tolist()]}
        document["settings"]["joint_tolerance"], document["intervals"] = extra.tolist(), [[0.0, 1.0]]
        proof = _unhashed(document)
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
            assert proof.rounding >= 1e-9
            assert found <= gap - min(losses) - proof.rounding + 1e-12
            assert found >= gap - min(motion.rough(delta + extra, s) for s in splits) - proof.rounding - 1e-9


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

        document["curve"] |= {"knots": [0.0, 1.0], "control": [control.tolist()]}
        document["settings"]["joint_tolerance"], document["intervals"] = extra.tolist(), [[0.0, 1.0]]
        proof = _unhashed(document)
        table = IntervalBounds(proof, np.array([[0.0, 1.0]]))
        delta = (control.max(axis=0) - control.min(axis=0)) / 2
        (found,) = proof.constraints[0].errors(table, proof.joints, extra, proof.rounding)
        expected = largest_error(satisfied, known, table.q[0], control, delta, extra)
        assert found >= expected + 1e-12
        if np.isfinite(found):
            assert found == pytest.approx(expected, abs=1e-6)
    assert finite >= 3


def _unhashed(document: dict) -> Proof:
    """The parts of a proof with the hash of its changed curve."""
    from pinproof.verifier import curve_digest

    c = document["curve"]
    document["hashes"]["curve"] = curve_digest(tuple(c["joint_names"]), np.array(c["knots"]), np.array(c["control"]))
    return Proof(document)
