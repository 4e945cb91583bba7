"""The bounds between samples are not smaller than those of docs/mathematics.md, computed here for balls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import pinproof as pp
from pinproof import _core
from pinproof.collision.certificates.certificate import proven_motion
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.verifier import IntervalBounds, Proof

from .exact_cells import Cell, Joint, cell

KINDS = ("rprpr", "rrrr", "ppp")


@dataclass
class PairMotion:
    """Two balls at a configuration, and the joints between them, from the first to the second."""

    joints: list[Joint]
    up: int
    axes: np.ndarray
    points: np.ndarray
    centres: np.ndarray
    radii: tuple[float, float]

    @classmethod
    def of(cls, known: Cell, names: tuple[str, str], q: np.ndarray) -> PairMotion:
        frames, moved_by = known.frames(q[None]), {joint.child: joint for joint in known.joints}

        def to_root(link: str) -> list[Joint]:
            found = []
            while link != "base":
                found.append(moved_by[link])
                link = moved_by[link].parent
            return [joint for joint in found if joint.leader is not None]

        links = [known.balls[name][0] if name in known.balls else "base" for name in names]
        up, down = map(to_root, links)
        common = {joint.child for joint in up} & {joint.child for joint in down}
        up, down = ([joint for joint in each if joint.child not in common] for each in (up, down))
        joints = [*up, *down[::-1]]
        places = [frames[joint.parent][0] @ joint.place for joint in joints]
        axes = np.array([place[:3, :3] @ joint.axis for place, joint in zip(places, joints, strict=True)])
        points = np.array([place[:3, 3] for place in places])
        at = known.centres(q[None])
        centres = [at[name][0] if name in at else known.obstacles[name].pose.translation for name in names]
        radii = tuple(known.balls[n][2] if n in known.balls else known.obstacles[n].shape.radius for n in names)
        return cls(joints, len(up), axes.reshape(-1, 3), points.reshape(-1, 3), np.array(centres), radii)

    def of_body(self, split: int) -> list[int]:
        """Which of the two balls each joint moves, seen from the link before joint ``split``."""
        return [0 if i < split else 1 for i in range(len(self.joints))]

    def deltas(self, delta: np.ndarray) -> list[float]:
        return [abs(joint.multiplier) * delta[joint.leader] for joint in self.joints]

    def radius(self, i: int, which: int) -> float:
        """The largest distance of a point of a ball from an axis."""
        if self.joints[i].prismatic:
            return 1.0
        return float(np.linalg.norm(np.cross(self.axes[i], self.centres[which] - self.points[i]))) + self.radii[which]

    def chord(self, i: int, delta: float) -> float:
        return delta if self.joints[i].prismatic else 2 * np.sin(min(delta, np.pi) / 2)

    def rough(self, delta: np.ndarray, split: int) -> float:
        """The simple bound of the approach (m)."""
        return sum(
            self.radius(i, which) * self.chord(i, d)
            for i, (which, d) in enumerate(zip(self.of_body(split), self.deltas(delta), strict=True))
        )

    def tight(
        self, control: np.ndarray, middle: np.ndarray, delta: np.ndarray, extra: np.ndarray, u: np.ndarray, split: int
    ) -> float:
        """The bound (m) of the decrease of the gap along u: to first order, curvature, inner rotations, tolerances."""
        of_body, total = self.of_body(split), 0.0
        first = []
        for point in control:
            along, slopes = 0.0, np.zeros((2, 3))
            for i, which in enumerate(of_body):
                joint = self.joints[i]
                theta = joint.multiplier * (point[joint.leader] - middle[joint.leader])
                carried = (i < self.up) == (which == 0)  # whether the joint's child side is that of this ball
                theta *= (1 if carried else -1) * (1 if which == 0 else -1)
                if joint.prismatic:
                    along += theta * float(u @ self.axes[i])
                else:
                    slope = theta * np.cross(u, self.axes[i])
                    slopes[which] += slope
                    along += float(slope @ (self.centres[which] - self.points[i]))
            grown = [np.linalg.norm(u + slopes[0]) - 1, np.linalg.norm(u - slopes[1]) - 1]
            first.append(along + self.radii[0] * grown[0] + self.radii[1] * grown[1])
        total += max(first)
        for order in (range(split)[::-1], range(split, len(self.joints))):
            turned = 0.0
            for i in order:
                joint, which = self.joints[i], of_body[i]
                x = abs(joint.multiplier) * (delta + extra)[joint.leader]
                bend = 0.0 if joint.prismatic else np.hypot(x - np.sin(x), 1 - np.cos(min(x, np.pi)))
                total += self.radius(i, which) * (bend + turned * self.chord(i, x))
                turned += 0.0 if joint.prismatic else self.chord(i, x)
                g = np.cross(u, self.axes[i])
                speed = abs(u @ self.axes[i])
                if not joint.prismatic:
                    speed = abs(g @ (self.centres[which] - self.points[i])) + self.radii[which] * np.linalg.norm(g)
                total += speed * abs(joint.multiplier) * extra[joint.leader]
        return total


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
            assert bounds.joints_between(k) == count
            rough = bounds.rough(k)
            assert rough.distance >= min(motion.rough(delta + extra, s) for s in range(count + 1)) - 1e-12
            assert rough.distance == pytest.approx(motion.rough(delta + extra, rough.split), abs=1e-9)
            assert wider.rough(k).distance <= rough.distance + larger * rough.growth + 1e-12
            for split in range(count + 1) if known.owners[k][1] in known.balls else [count]:
                exact = motion.tight(control, q, delta, extra, u, split)
                tight = bounds.tight(k, u, split, control)
                assert tight.distance >= exact - 1e-12
                assert wider.tight(k, u, split, control).distance <= tight.distance + larger * tight.growth + 1e-12


@pytest.mark.parametrize("kinds", KINDS)
def test_bounds_of_the_verifier_are_those_of_the_derivation(kinds: str) -> None:
    known, rng = cell(1, kinds), np.random.default_rng(6)
    some = rng.uniform(-0.5, 0.5, (50, len(kinds)))
    curve = pp.JointPath(some[[known.distances(some).min(axis=1).argmax()]], known.checker.arm.joint_names)
    certificate = pp.certify(curve, known.checker, record=True, limits=None).or_raise()
    document = proof_document(proven_motion(certificate, curve, known.checker))
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


def largest_error(constraint, known: Cell, q, control, delta, extra) -> float:
    """The bound of the error of docs/mathematics.md on a piece of a curve in a box about q (n,)."""
    count = len(q)
    frames, joints = known.frames(q[None]), known.joints[:count]
    tcp = frames[joints[-1].child][0]
    places = [frames[joint.parent][0] @ joint.place for joint in joints]
    axes = np.array([place[:3, :3] @ joint.axis for place, joint in zip(places, joints, strict=True)])
    points, slides = np.array([place[:3, 3] for place in places]), np.array([joint.prismatic for joint in joints])
    order, cone = range(count), None
    if constraint.name == "upright":
        start, cone = tcp[:3, :3] @ constraint.axis_in_tcp, np.array(constraint.up)
        rates = np.where(slides[:, None], 0.0, np.cross(axes, start))
    elif constraint.name == "within":
        start = (tcp @ [*constraint.point_in_tcp, 1.0])[:3]
        rates = np.where(slides[:, None], axes, np.cross(axes, start - points))
    else:  # relative to the tcp, the point moves by the inverse of each joint
        start, cone, order = constraint.point - tcp[:3, 3], tcp[:3, :3] @ constraint.axis_in_tcp, range(count)[::-1]
        rates = -np.where(slides[:, None], axes, np.cross(axes, constraint.point - points))
    rest = turned = 0.0
    for i in order:
        x, length = (delta + extra)[i], np.linalg.norm(rates[i])
        chord = x if slides[i] else 2 * np.sin(min(x, np.pi) / 2)
        bend = 0.0 if slides[i] else np.hypot(x - np.sin(x), 1 - np.cos(min(x, np.pi)))
        rest += length * (bend + turned * chord + extra[i])
        turned += 0.0 if slides[i] else chord
    images = start + (control - q) @ rates
    if cone is None:
        place = constraint.base_from_region
        local = (images - place.translation) @ place.rotation
        return np.linalg.norm(local - np.clip(local, constraint.low, constraint.high), axis=1).max() + rest
    along = images @ cone
    if rest >= along.min():
        return np.inf
    angles = np.arctan2(np.linalg.norm(np.cross(images, cone), axis=1), along)
    return angles.max() + np.arcsin(rest / along.min())


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
    document = proof_document(proven_motion(certificate, still, known.checker))
    for _ in range(16):
        q, control, delta, extra = random_box(known, rng)
        constraint = random_constraint(kind, known, q if rng.integers(2) else start, rng)
        nothing = np.zeros(arm.dof)
        error, bound = _core.constraint_bound(arm.chain, constraint.compiled(), q, control, delta, extra)
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
