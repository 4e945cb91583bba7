r"""Bounds while the joints move within an interval of the curve: distances of bodies, and errors of constraints.

In an interval the joints stay in a box about q, joint i within delta_i. Let u be a unit vector fixed in a link L
between bodies a and b: the gap of the two supports along u is a lower bound of their distance. Consider the revolute
joints from L outward to b, about the axes w_i through p_i at q. If the joints nearest to L move first, each of them
moves all links beyond it as one rigid body, so a point y of b moves to R_1 R_2 .. R_m y, with all R_i about the axes at
q, and

.. math:: u \cdot (R_1 \cdots R_m y - y) = \sum_i (\bar R_1 \cdots \bar R_{i-1})^T u \cdot (R_i y - y) .

The rotations before joint i change u by at most the sum of their chords 2 sin(delta / 2), and

.. math:: |R_i y - y| \le 2 \rho_i \sin(\delta_i / 2), \qquad |R_i y - y - \theta_i w_i \times (y - p_i)|
    = \rho_i \sqrt{(\theta_i - \sin \theta_i)^2 + (1 - \cos \theta_i)^2} ,

where rho_i is the largest distance at q of b from axis i. The remaining term is linear in y and in theta: its minimum
over the body is a support in a slightly rotated direction, which is concave in theta and therefore smallest at a
control point of the curve. The same holds for a with the joints from L to a. The chords alone are a bound of the
approach too; the better bound is used. L is the link with the smallest sum of chords, and the root for an obstacle. A
prismatic joint has delta in place of its chord, and no second-order term.

A constraint of the tcp states that a vector y stays in a convex set. It is an axis of the tcp (``direction``; in a
cone about a direction of the root), a point of the tcp (``region``; near a box), or the position of a target relative
to the tcp (``target``; in a cone about an axis of the tcp). Another joint may be the reference in place of the root, so
that the joints between both move y relative to it. With the notation above, and the joints moving one after the other
from the set outward,

.. math:: y' = y + \sum_i \theta_i v_i + z, \qquad
    |z| \le \sum_i |v_i| \, (b_i + \chi_i \sum_{l \text{ between the set and } i} \chi_l) ,

where v_i is the velocity of y per rate of joint i at q, chi its chord and b its second-order term. Without z, y' is in
the hull of its values at the control points. The distance from a box is convex and changes by |z| at most; the angle to
the axis of a cone below 90 degrees is largest at a control point and changes by at most asin(|z| / c), with c the
smallest component of the hull along the axis. In an interval of several pieces the chords bound the whole change.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from .parts import (
    LARGEST_PARAMETER,
    UNIT_ERROR,
    Array,
    Body,
    Curve,
    Indices,
    Joint,
    Refused,
    check_fields,
    index,
    member,
    number,
    numbers,
    optional_numbers,
    placement,
    rotation_error,
    shown,
    support,
    text,
    unit_vector,
)
from .rounding import (
    ROOT_3,
    UNIT_ROUNDOFF,
    Near,
    angle_above,
    choose,
    composed,
    cross,
    dot,
    hypotenuse,
    length,
    near,
    rotated,
    rounded,
    sine_cosine,
    stacked,
    weighted,
)

AT_ONCE = 1 << 12
"""Number of bounds that are computed at once, which share the cost of the calls."""

PRODUCTS = 1 << 20
"""Products of directions and points that are computed at once: 8 MB."""

FEW = 16
"""Smallest number of rows of one body that are computed separately, with one product of matrices."""

MOST_NUMBERS = 1 << 27
"""Largest number of coordinates of control points of all intervals, 1 GB; few intervals span several pieces."""


NOTHING, ONE = (Near(np.array(number), 0.0, number) for number in (0.0, 1.0))


class Mechanism(Protocol):
    """The parts of a proof from which the bounds are computed: joints, bodies, curve and allowances."""

    joints: list[Joint]
    bodies: list[Body]
    curve: Curve
    tolerance: Array
    within: float

    def joints_between(self, a: int, b: int) -> tuple[list[int], int]:
        """Return the joints on the path from joint a to joint b, and how many of them, from the first, are up."""


class IntervalBounds:
    """The boxes of the joint values in intervals (T, 2) of a curve, and the axes and bodies at their middles.

    ``parts`` of meshes follow the bodies of the proof.
    """

    def __init__(self, proof: Mechanism, intervals: Array, parts: Sequence[Body] = ()) -> None:
        self._proof = proof
        low, high, control, self.single = _boxes(proof.curve, intervals)
        """(T,) whether an interval is in a single piece of the curve."""
        control.error += proof.curve.jump + proof.within
        self.q = (low + high) / 2
        """(T, n) a point of the boxes, about their middle; it is exact by definition."""
        self.theta = (control - self.q[:, None]).measured()
        """(T, K, n) control points relative to q, valid where :attr:`single`."""
        self.half_width = rounded(np.maximum(high - self.q, self.q - low), control.error, 1).upper
        """(T, n) half of the sides of the boxes."""
        self._bodies = _BodyTable([*proof.bodies, *parts], proof.within)
        # Rotation (T, 3, 3) and translation (T, 3) of each joint in root, and its axis (T, 3) there.
        self._at: list[tuple[Near, Near]] = []
        self._axes: list[Near] = []
        for joint in proof.joints:
            rotation, translation = self.placed(joint.parent)
            translation = rotated(rotation, joint.translation) + translation
            rotation = composed(rotation, joint.rotation)
            axis = rotated(rotation, joint.axis)
            value = Near(self.q[:, joint.leader]) * Near(np.array(joint.multiplier), proof.within)
            value = value + Near(np.array(joint.offset), proof.within)
            self._axes.append(axis)
            if joint.revolute:
                rotation = composed(rotation, _about(joint.axis, value))
            else:
                translation = translation + value[:, None] * axis
            self._at.append((rotation, translation))

    def placed(self, joint: int) -> tuple[Near, Near]:
        """Return rotation (T, 3, 3) and translation (T, 3) of a joint at q, in root; -1 is the root."""
        if joint >= 0:
            return self._at[joint]
        count = len(self.q)
        return Near(np.broadcast_to(np.eye(3), (count, 3, 3))), Near(np.zeros((count, 3)))

    def axis(self, joint: int) -> tuple[Near, Near]:
        """Return direction and a point (T, 3) each of the axis of a joint at q, in root."""
        return self._axes[joint], self._at[joint][1]

    def frames(self, which: Indices, rows: Indices) -> Array:
        """Return (R, 4, 4) the frames in root of bodies ``which`` (R,) at the middle of intervals ``rows`` (R,)."""
        table, found = self._bodies, np.tile(np.eye(4), (len(rows), 1, 1))
        for joint in np.unique(table.joint[which]):
            mine = table.joint[which] == joint
            rotation, translation = (part.value[rows[mine]] for part in self.placed(int(joint)))
            found[mine, :3, :3] = rotation @ table.rotation[which[mine]]
            found[mine, :3, 3] = translation + (rotation @ table.translation[which[mine], :, None])[..., 0]
        return found

    def balls(self, which: Indices) -> Array:
        """Return the radius (m) of the ball around each of the bodies ``which``, of any shape."""
        return np.asarray(self._bodies.ball[which])

    def distance(self, i: Indices, j: Indices, rows: Indices, u: Array) -> Array:
        """Return (R,) lower bounds (m) of the distances of bodies ``i`` and ``j`` (R,), valid in the whole interval.

        ``rows`` (R,) are the intervals. ``u`` (R, 3) are directions in root, from body i to body j, of any length; a
        half-space has its own normal instead. Pairs of bodies that move with the same two joints are bounded together.
        """
        unit = u / np.sqrt(np.einsum("rx,rx->r", u, u))[:, None]
        table, found = self._bodies, np.empty(len(rows))
        kinds = np.stack([table.joint[i], table.joint[j], table.half_space[j], table.obstacle[j]], axis=1)
        _, kind = np.unique(kinds, axis=0, return_inverse=True)
        order = np.argsort(kind.reshape(-1), kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(kind.reshape(-1)[order])) + 1):
            for begin in range(0, len(group), AT_ONCE):
                some = group[begin : begin + AT_ONCE]
                found[some] = self._distance(
                    i[some], j[some], rows[some], Near(unit[some], UNIT_ERROR, 1.0 + UNIT_ERROR)
                )
        return found

    def _distance(self, i: Indices, j: Indices, rows: Indices, u: Near) -> Array:
        """Return the bounds of pairs of bodies with the same joints; all or none are obstacles, and half-spaces."""
        proof, table = self._proof, self._bodies
        obstacle = bool(table.obstacle[j[0]])
        path, up = proof.joints_between(int(table.joint[i[0]]), int(table.joint[j[0]]))
        one, other = _Placed(self, i, rows), _Placed(self, j, rows)
        if table.half_space[j[0]]:
            u = -Near(other.rotation.value[:, :, 2], other.rotation.error)
        ahead = u[:, None]
        behind = other.reach(-ahead)
        gap = -(behind + one.reach(ahead))[:, 0]
        if not path:
            return gap.lower
        joints = [proof.joints[k] for k in path]
        revolute = np.array([[joint.revolute] for joint in joints])
        multiplier = Near(np.array([[joint.multiplier] for joint in joints]), proof.within).measured()
        share = Near(np.abs(multiplier.value), multiplier.error, multiplier.size)
        leaders = [joint.leader for joint in joints]
        deviation = share * proof.tolerance[leaders][:, None]
        delta = share * self.half_width[rows][:, leaders].T + deviation
        chord, bend = _chord_and_bend(delta, revolute)
        w = stacked([self._axes[k][rows] for k in path])
        p = stacked([self._at[k][1][rows] for k in path])
        radius = choose(revolute, one.radius(w, p), ONE)  # a point moves by as much as a prismatic joint

        # Which joints move i, seen from L: the first ``split`` of the path; the others move j. Any number is right.
        moved = (radius * chord).sums()
        if obstacle:
            rough, split = moved[-1], np.full(len(rows), len(path))
        else:
            of_other = choose(revolute, other.radius(w, p), ONE)
            moved_other = (of_other * chord)[::-1].sums()[::-1]
            both = moved + moved_other
            split = np.asarray(both.value.argmin(axis=0))
            rough = both.least(axis=0)
        of_i = np.arange(len(path))[:, None] < split
        radius = radius if obstacle else choose(of_i, radius, of_other)
        before = choose(revolute, chord, NOTHING).sums()  # the chords of the joints before each
        at_split = before[split, np.arange(len(rows))]
        turned = choose(of_i, at_split - before[1:], before[:-1] - at_split)
        rest = (radius * (bend + turned * chord)).sums()[-1]

        g = choose(revolute[..., None], cross(u, w), NOTHING)
        away = np.where(np.arange(len(path)) < up, -1.0, 1.0)  # a positive theta moves i nearer and j away
        theta = Near(np.moveaxis(self.theta.value[rows][:, :, leaders], 2, 0), self.theta.error, self.theta.size)
        theta = theta * Near(multiplier.value * away[:, None], multiplier.error, multiplier.size)[..., None]
        along = choose(revolute, -dot(g, p), dot(u, w))
        # The minimum over x in i of (slope - u) . x, and over y in j of (slope + u) . y.
        slope = weighted(choose(of_i[..., None], theta, NOTHING), g)
        linear = weighted(theta, along) - one.reach(ahead - slope)
        if not obstacle:
            slope = weighted(choose(~of_i[..., None], theta, NOTHING), g)
            behind = other.reach(-(ahead + slope))
        linear = linear - behind
        close = linear.least(axis=1) - rest
        # The joint tolerances reduce the distance by the speed of the support, to first order.
        for c, leader in enumerate(leaders):
            if proof.tolerance[leader] == 0.0:
                continue
            speed = Near(np.abs(along[c].value), along.error)
            if revolute[c, 0]:
                d = g[c][:, None]
                forth, back = (choose(of_i[c], one.reach(way)[:, 0], other.reach(way)[:, 0]) for way in (d, -d))
                forth, back = forth + along[c], back - along[c]
                speed = choose(forth.value > back.value, forth, back)
            close = close - deviation[c] * speed
        return np.maximum((gap - rough).lower, np.where(self.single[rows], close.lower, -np.inf))


def _about(axis: Near, angle: Near) -> Near:
    """Return rotations (T, 3, 3) about an axis (3,), by Rodrigues' formula I + sin K + (1 - cos) K^2.

    K and K^2 have the norm 1, and K^2 has twice the error of K. The roundings are those of K^2 (6 u in the norm of all
    entries, times at most 2), and at most 20 u of the other operations.
    """
    x, y, z = axis.value
    cross_matrix = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = sine_cosine(angle)
    turn = sine.value[:, None, None] * cross_matrix
    turn = np.eye(3) + turn + (1.0 - cosine.value)[:, None, None] * (cross_matrix @ cross_matrix)
    return rounded(turn, sine.error + cosine.error + axis.error * (5.0 + 2.0 * axis.error), 32, 1.0 + axis.error)


def _chord_and_bend(delta: Near, revolute: npt.NDArray[np.bool_]) -> tuple[Near, Near]:
    """Return, for joints that move by up to delta, the chords and the second-order terms, at a distance of 1.

    Both grow with delta, the chords up to 2, the other terms by at most twice as much as delta.
    """
    capped = Near(np.minimum(delta.value, pi), delta.error, delta.size)
    sine, cosine = sine_cosine(capped * 0.5)
    chord = sine * 2.0
    bend = hypotenuse(capped - chord * cosine, chord * sine) + (delta - capped) * 2.0
    return choose(revolute, chord, delta).measured(), choose(revolute, bend, NOTHING).measured()


class _BodyTable:
    """The bodies of a proof as arrays, in its order."""

    def __init__(self, bodies: list[Body], within: float) -> None:
        self._bodies, self.within = bodies, within
        self.joint = np.array([body.joint for body in bodies], dtype=np.int64)
        self.half_space = np.array([body.half_space for body in bodies], dtype=bool)
        self.obstacle = np.array([body.kind == "obstacle" for body in bodies], dtype=bool)
        self.rotation = np.array([body.rotation.value for body in bodies]).reshape(-1, 3, 3)
        self.translation = np.array([body.translation.value for body in bodies]).reshape(-1, 3)
        self.centre = np.array([body.centre for body in bodies]).reshape(-1, 3)
        self.ball = np.array([body.ball for body in bodies])
        self.extent = np.array([body.extent for body in bodies])
        self._points = np.array([len(body.points) if body.bounded else 0 for body in bodies], dtype=np.int64)

    def reach(self, which: Indices, directions: Array) -> Array:
        """Return (R, K) the supports of bodies ``which`` (R,) in directions (R, K, 3) in their own frames."""
        found = np.empty(directions.shape[:2])
        order = np.argsort(which, kind="stable")
        few = []
        # Many rows of one body share a product of matrices; few are computed with bodies of equal size.
        for rows in np.split(order, np.flatnonzero(np.diff(which[order])) + 1):
            body = self._bodies[which[rows[0]]]
            if len(rows) < FEW:
                few.append(rows)
                continue
            for some in _parts(rows, directions.shape[1] * int(self._points[which[rows[0]]])):
                found[some] = body.reach(directions[some])
        if few:
            rows = np.concatenate(few)
            rows = rows[np.argsort(self._points[which[rows]], kind="stable")]
            for same in np.split(rows, np.flatnonzero(np.diff(self._points[which[rows]])) + 1):
                for some in _parts(same, directions.shape[1] * int(self._points[which[same[0]]])):
                    bodies = [self._bodies[k] for k in which[some].tolist()]
                    found[some] = support(
                        directions[some],
                        np.array([body.points for body in bodies]),
                        np.array([body.discs for body in bodies])[:, None],
                        np.array([[body.radius] for body in bodies]),
                        np.array([body.semi for body in bodies])[:, None],
                    )
        return found


def _parts(rows: Indices, products: int) -> list[Indices]:
    """Divide rows into parts of at most :data:`PRODUCTS` products, or of a single row."""
    step = max(1, PRODUCTS // max(1, products))
    return [rows[begin : begin + step] for begin in range(0, len(rows), step)]


class _Placed:
    """Bodies (R,) of one joint at the middle of intervals ``rows`` (R,), in root."""

    def __init__(self, bounds: IntervalBounds, which: Indices, rows: Indices) -> None:
        self._which, self._table = which, bounds._bodies
        table = self._table
        rotation, translation = (part[rows] for part in bounds.placed(int(table.joint[which[0]])))
        self.rotation = composed(rotation, Near(table.rotation[which], rotation_error(table.within)))
        self._translation = rotated(rotation, Near(table.translation[which], ROOT_3 * table.within)) + translation
        self._half_space = bool(table.half_space[which[0]])

    def reach(self, directions: Near) -> Near:
        """Return (R, K) the supports in directions (R, K, 3) in root; of half-spaces in the direction of their normal.

        A support changes by as much as its direction, times the distance of the farthest point of the body.
        """
        origin = dot(directions, self._translation[:, None])
        if self._half_space:
            return origin
        local, table = rotated(self.rotation, directions, back=True), self._table
        far = float(table.extent[self._which].max()) + 5.0 * table.within
        error = local.error * far + 5.0 * table.within * local.size
        return rounded(table.reach(self._which, local.value), error, 16, local.size * far) + origin

    def radius(self, w: Near, p: Near) -> Near:
        """Return (c, R) upper bounds of the distance of the bodies from axes along w through p, both (c, R, 3)."""
        centre = rotated(self.rotation, Near(self._table.centre[self._which])) + self._translation
        return (length(cross(w, centre - p)) + self._table.ball[self._which] + 5.0 * self._table.within).measured()


def _boxes(curve: Curve, intervals: Array) -> tuple[Array, Array, Near, npt.NDArray[np.bool_]]:
    """Return smallest and largest joint values (T, n), control points (T, K, n), and whether these are all (T,).

    A piece of the curve is in the hull of its control points; those of a part of a piece are its blossoms (de
    Casteljau's algorithm, with u0 and u1 as the parameters). If an interval spans several pieces, only the control
    points of the first are returned. The error of all is that of the control points: on each level the averages have 4
    roundings, and 6 from those of u0 and u1, of numbers that do not grow.
    """
    # The pieces of the curve that each interval meets.
    begins, ends = curve.knots[:-1], curve.knots[1:]
    first = np.clip(np.searchsorted(begins, intervals[:, 0], side="right") - 1, 0, None)
    last = np.maximum(np.searchsorted(begins, intervals[:, 1], side="left") - 1, first)
    counts = last - first + 1
    if int(counts.sum()) * curve.control[0].size > MOST_NUMBERS:
        raise Refused("intervals: they span too many pieces of the curve, taken together")
    starts = np.cumsum(counts) - counts
    owner = np.repeat(np.arange(len(intervals)), counts)
    piece = first[owner] + np.arange(len(owner)) - starts[owner]
    # The part of a piece between the parameters u0 and u1 of the piece.
    width = np.where(curve.single, 1.0, ends - begins)[piece]
    u = [np.clip((intervals[owner, end] - begins[piece]) / width, 0.0, 1.0)[:, None, None] for end in (0, 1)]
    pieces = curve.control[piece]
    points = pieces.shape[1]
    control = np.empty_like(pieces)
    for r in range(points):
        rest = pieces
        for level in range(points - 1):
            at = u[1] if level < r else u[0]
            rest = rest[:, :-1] * (1.0 - at) + rest[:, 1:] * at
        control[:, r] = rest[:, 0]
    # The box around the control points of all pieces of an interval.
    low = np.minimum.reduceat(control.min(axis=1), starts, axis=0)
    high = np.maximum.reduceat(control.max(axis=1), starts, axis=0)
    return low, high, rounded(control[starts], 0.0, 10 * points, float(np.abs(curve.control).max())), counts == 1


def branch(joints: Sequence[Joint], joint: int) -> Iterator[int]:
    """The joints from one to the root; none for the root."""
    while joint >= 0:
        yield joint
        joint = joints[joint].parent


COMMON = ("name", "kind", "joint", "reference", "tolerance", "largest", "intervals")
FIELDS = {
    "direction": ("axis", "direction"),
    "region": ("point", "placement", "low", "high"),
    "target": ("axis", "origin", "point"),
}


class Constraint:
    """One constraint of a file; vectors of the tcp are in the frame of its joint, all others in that of the reference.

    The reference is the root, or another joint of the tree.
    """

    def __init__(self, row: Any, k: int, joints: int, within: float) -> None:
        self.where, self._within = (where := f"constraints[{k}]"), within
        self.kind = member(row, where, "kind")
        if type(self.kind) is not str or self.kind not in FIELDS:
            raise Refused(f"{where}.kind: must be {', '.join(FIELDS)}, not {shown(self.kind)}")
        check_fields(row, where, (*COMMON, *FIELDS[self.kind]))
        self.name = text(row, where, "name")
        self.joint = index(member(row, where, "joint"), -1, joints, f"{where}.joint")
        self.reference = index(row.get("reference", -1), -1, joints, f"{where}.reference")
        self.tolerance, self.largest = number(row, where, "tolerance"), number(row, where, "largest")
        self.unit = "m" if self.kind == "region" else "rad"
        if not self.tolerance > 0 or not 0 <= self.largest <= self.tolerance:
            raise Refused(f"{where}: tolerance must be above 0, and largest from 0 to the tolerance")
        if self.unit == "rad" and not self.tolerance < pi / 2:
            raise Refused(f"{where}.tolerance: must be below pi/2")
        keys = [key for key in FIELDS[self.kind] if key in ("axis", "direction", "point", "origin")]
        self.vectors = {
            key: unit_vector(row, where, key, within)
            if key in ("axis", "direction")
            else Near(numbers(row, where, key, (3,)), ROOT_3 * within)
            for key in keys
        }
        if self.kind == "region":
            self.rotation, self.translation = placement(row, where, within)
            # null is a side without an end
            self.low, self.high = (
                optional_numbers(row, where, key, 3, end) for key, end in (("low", -np.inf), ("high", np.inf))
            )
            if not (self.low <= self.high).all():
                raise Refused(f"{where}: low exceeds high")
        self.intervals = numbers(row, where, "intervals", (None, 2), LARGEST_PARAMETER)

    def errors(self, bounds: IntervalBounds, joints: list[Joint], tolerance: Array) -> Array:
        """Return (T,) upper bounds (rad or m) of the error in each interval; joints deviate by ``tolerance`` (n,)."""
        # The vector that stays in the set, at the middle of the interval.
        rotation, translation = bounds.placed(self.joint)
        axes, origin = bounds.placed(self.reference)
        cone: Near | None = None
        centre, still = near(np.zeros(3)), near(np.zeros_like(translation.value))
        if self.kind == "direction":
            moved = rotated(rotation, self.vectors["axis"])
            cone = rotated(axes, self.vectors["direction"])
        elif self.kind == "region":
            moved = rotated(rotation, self.vectors["point"]) + translation
        else:
            moved = rotated(axes, self.vectors["point"]) + origin
            centre = rotated(rotation, self.vectors["origin"]) + translation
            cone = rotated(rotation, self.vectors["axis"])
        # The joints from the frame of the set, the tcp for a target, outward to the vector: those up to the link where
        # both branches of the tree meet move the vector in reverse.
        ends = (self.joint, self.reference) if self.kind == "target" else (self.reference, self.joint)
        above, below = ([*branch(joints, end)] for end in ends)
        order = [(k, -1.0) for k in above if k not in below] + [(k, 1.0) for k in below[::-1] if k not in above]

        # The change of the vector while the joints move: linear, and the rest that is bounded.
        change = near(np.zeros((*bounds.theta.value.shape[:2], 3)))
        rest = rough = turned = near(np.zeros(len(translation.value)))
        for k, sign in order:
            each, (w, p) = joints[k], bounds.axis(k)
            if self.kind == "direction":
                velocity = cross(w, moved) if each.revolute else still
            else:
                velocity = cross(w, moved - p) if each.revolute else w
            velocity = -velocity if sign < 0.0 else velocity
            multiplier, radius = Near(np.array(each.multiplier), self._within), length(velocity)
            share = Near(np.abs(multiplier.value), self._within)
            deviation = share * tolerance[each.leader]
            delta = share * bounds.half_width[:, each.leader] + deviation
            chord, bend = _chord_and_bend(delta, np.array(each.revolute))
            rest = rest + radius * (bend + turned * chord + deviation)
            rough = rough + radius * chord
            if each.revolute:
                turned = turned + chord
            change = change + multiplier * bounds.theta[:, :, each.leader, None] * velocity[:, None]
        change = choose(bounds.single[:, None, None], change, NOTHING)
        rest = choose(bounds.single, rest, rough)
        # The error at all control points, and the rest.
        image = (moved - centre)[:, None] + change
        if cone is None:
            there = rotated(axes, image - origin[:, None], back=True)
            local = rotated(self.rotation, there - self.translation, back=True)
            out = local.value - np.clip(local.value, self.low, self.high)
            far = length(rounded(out, local.error + ROOT_3 * self._within, 1))
            return (Near(far.value.max(axis=1), far.error) + rest).upper
        along = dot(image, cone[:, None])
        angle = angle_above(length(cross(image, cone[:, None])).upper, along.lower).max(axis=1)
        shortest = along.least(axis=1)
        # asin(rest / shortest), by the third side of the triangle
        least, most = (np.maximum(part.lower, 0.0) for part in (shortest - rest, shortest + rest))
        side = np.sqrt(least * most) * (1.0 - 4 * UNIT_ROUNDOFF)
        return np.asarray(np.nextafter(angle + angle_above(rest.upper, side), np.inf))
