r"""Check of a proof that a pose is out of reach: the bounds of ``src/core/reach``, repeated in NumPy without its code.

The arm and its target form a closed loop of links: the base, link 1 to n, and the target, which ties link n to the
base. A point on a joint axis is fixed on two links, a point where axes meet on more. The distance of two such points
depends on the joints of either of the two arcs between them, so both arcs must permit a common value.

A joint in the range :math:`[m - w, m + w]` moves a point at the distance :math:`\rho` from its axis on an arc, which
the ball about :math:`\rho \cos w` on its bisector with the radius :math:`\rho \sin w` encloses (:math:`\rho` about the
axis for :math:`w \ge \pi/2`). Balls grow from joint to joint from both ends of an arc of the loop up to one joint,
whose rotation is treated exactly: between balls with radii r_a and r_b at the distances :math:`\rho_a, \rho_b` from its
axis and the difference :math:`\Delta z` in height,

.. math:: d^2 = \Delta z^2 + \rho_a^2 + \rho_b^2 - 2 \rho_a \rho_b \cos(\varphi - q) ,\quad |D - d| \le r_a + r_b .

The same balls enclose the centre of a ball inside a body, in the frame of another link. If its signed distance from a
box inside another body, plus the radius of the enclosure, is less than its own radius, both bodies overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.spatial import Array

Integers = npt.NDArray[np.int64]

SPLIT, CUT_LOWER, CUT_UPPER, EXCLUDED = range(4)
"""The kinds of steps: the box is divided; its part below or above a value is excluded; all of it is excluded."""

ROUNDING = 1e-12
"""Fraction of the loop's length that is allowed for rounding in distances. The proof itself allows ten times more."""

SQUARE_ROUNDING = 1e-14
"""The same for squares of distances, as a fraction of the squared length."""

Balls = tuple[Array, Array]
"""The centres (k, 3) and radii (k,) of balls that enclose a point, one ball for each box of joint values."""


@dataclass(frozen=True, eq=False)
class Steps:
    """The k steps of a proof, the nodes of a tree of boxes in the order of a depth-first search.

    ``kinds`` are :data:`SPLIT`, :data:`CUT_LOWER`, :data:`CUT_UPPER` or :data:`EXCLUDED`; ``joints`` are divided or cut
    at ``values`` (rad or m). ``constraints`` are the distances by which a box or a part of it is excluded. Cuts with
    the same number in ``evaluations`` hold for the box as it was before the first of them.
    """

    kinds: Integers
    joints: Integers
    constraints: Integers
    evaluations: Integers
    values: Array

    def __post_init__(self) -> None:
        for each in fields(self):
            dtype = float if each.name == "values" else np.int64
            object.__setattr__(self, each.name, np.array(getattr(self, each.name), dtype=dtype))

    def __len__(self) -> int:
        return len(self.kinds)


@dataclass(frozen=True, eq=False)
class BodyOverlap:
    """A ball inside a body, and a box with rounded edges inside a body on another link.

    Configurations at which both share a point are in collision. Link 0 is the base of the arm, and link k is moved by
    the joints up to the k-th.

    Parameters
    ----------
    names
        The names of both bodies, that with the ball first.
    ball_link, centre, radius
        The link of the ball, its centre (3,) on it, and its radius (m).
    box_link, link_from_box, half, box_radius
        The link of the box, its pose (4, 4), its half sides (3,), and the radius (m) of a ball that is added to it.
        With half sides of zero, it is a ball.
    """

    names: tuple[str, str]
    ball_link: int
    centre: Array
    radius: float
    box_link: int
    link_from_box: Array
    half: Array
    box_radius: float


class _Arc(NamedTuple):
    """A part of the loop: from a point, through joints in ascending order, to a point."""

    start: Array
    end: Array
    joints: list[int]
    target: int | None  # the number of joints before the target; None if the arc does not contain it


@dataclass(frozen=True, eq=False)
class Loop:
    """The points and pairs of points of a loop, from their description in a proof."""

    before: Array  # (n, 4, 4) the constant transform before each joint, which rotates about or moves along z
    tool: Array  # (4, 4) the constant transform behind the last joint
    prismatic: Sequence[bool]
    first: list[int]  # the first link on which each point is fixed
    at: list[Array]  # for each point its coordinates (m, 3) on the links from that one
    pairs: list[tuple[int, int]]  # the indices of the two points of each distance

    @property
    def size(self) -> float:
        """The length of the chain in m."""
        lengths = np.linalg.norm(self.before[:, :3, 3], axis=1).sum()
        return max(float(lengths + np.linalg.norm(self.tool[:3, 3])), 1e-3)

    def last(self, point: int) -> int:
        """The last link on which a point is fixed."""
        return self.first[point] + len(self.at[point]) - 1

    def error(self, point: int) -> float:
        """A bound of the distance between the places of a point on its links, for all values of the joints between."""
        error = 0.0
        for i in range(len(self.at[point]) - 1):
            joint = self.first[point] + i
            if self.prismatic[joint]:
                return np.inf
            here, behind = self.at[point][i], self.at[point][i + 1]
            on_axis = self.before[joint] @ [0.0, 0.0, behind[2], 1.0]
            error += float(np.hypot(behind[0], behind[1]) + np.linalg.norm(on_axis[:3] - here))
        return error

    def arcs(self, number: int) -> tuple[_Arc, _Arc, float]:
        """The two arcs between the points of a pair, and the error of both points."""
        p, q = self.pairs[number]
        n = len(self.before)
        p_first, p_last, q_first, q_last = self.first[p], self.last(p), self.first[q], self.last(q)
        if q_first <= p_last:  # both are fixed on a common link
            link = max(p_first, q_first)
            inner = _Arc(self.at[p][link - p_first], self.at[q][link - q_first], [], None)
        else:
            inner = _Arc(self.at[p][-1], self.at[q][0], list(range(p_last, q_first)), None)
        around = [*range(q_last, n), *range(p_first)]
        outer = _Arc(self.at[q][-1], self.at[p][0], around, n - q_last)
        return inner, outer, self.error(p) + self.error(q)


def excluded_boxes(steps: Steps, lower: Array, upper: Array) -> tuple[Array, Integers]:
    """The excluded boxes (k, 2, n), and the pair of points (k,) whose distance excludes each.

    ValueError if the steps are not a complete tree, so that a part of the joint ranges is not excluded.
    """
    boxes, constraints = [], []
    box = np.array([lower, upper])
    root, base, evaluation, waiting, complete = box.copy(), box.copy(), -1, list[Array](), False
    for i in range(len(steps)):
        if complete:
            raise ValueError("there are steps after the last box")
        kind, joint, value = int(steps.kinds[i]), int(steps.joints[i]), float(steps.values[i])
        # a node divides its box, and the second half waits until the first is excluded
        if kind == SPLIT:
            if not box[0, joint] <= value <= box[1, joint]:
                raise ValueError("a box is divided outside its range")
            other = box.copy()
            box[1, joint] = other[0, joint] = value
            waiting.append(other)
            evaluation = -1
            continue
        # a leaf excludes its box, or cuts a part from it
        if steps.evaluations[i] != evaluation or evaluation < 0:
            base, evaluation = box.copy(), int(steps.evaluations[i])
        excluded = base.copy()
        if joint >= 0:  # the bounds of a whole box are those before the cuts of its evaluation
            excluded[:, joint] = box[:, joint]
        if kind == CUT_LOWER:
            excluded[1, joint] = box[0, joint] = value
        elif kind == CUT_UPPER:
            excluded[0, joint] = box[1, joint] = value
        elif kind == EXCLUDED:
            complete = not waiting
            box = waiting.pop() if waiting else box
            evaluation = -1
        else:
            raise ValueError(f"unknown kind of step: {kind}")
        boxes.append(excluded)
        constraints.append(int(steps.constraints[i]))
    if len(steps) and not complete:
        raise ValueError("a part of the joint ranges is not excluded")
    return np.array(boxes).reshape(-1, *root.shape), np.array(constraints, dtype=np.int64)


def check_exclusion(
    loop: Loop,
    steps: Steps,
    ranges: tuple[Array, Array],
    target: Array,
    tolerances: tuple[float, float],
    overlaps: Sequence[BodyOverlap] = (),
) -> bool:
    """Whether the steps prove that no configuration in the ranges (n,) reaches the target within tolerances (m, rad).

    With overlaps, whether they prove that every configuration that reaches it has one of the overlaps.
    """
    if not len(steps):
        return False
    try:
        boxes, constraints = excluded_boxes(steps, *ranges)
    except ValueError:
        return False
    # all boxes that the same distance, or the same overlap, excludes at once
    for number in np.unique(constraints).tolist():
        own = boxes[constraints == number]
        motion = _LinkMotion(loop, target, tolerances, own.mean(axis=1), (own[:, 1] - own[:, 0]) / 2)
        if number < len(loop.pairs):
            inner, outer, error = loop.arcs(number)
            (low, high), (other_low, other_high) = (_distance(motion, arc, error) for arc in (inner, outer))
            excluded = (low > other_high) | (other_low > high)
        elif number - len(loop.pairs) < len(overlaps):
            overlap = overlaps[number - len(loop.pairs)]
            gap = np.minimum(*(_gap(motion, overlap, through_target) for through_target in (False, True)))
            excluded = gap < -ROUNDING * loop.size
        else:
            return False
        if not excluded.all():
            return False
    return True


@dataclass(frozen=True, eq=False)
class _LinkMotion:
    """The motion of balls from link to link over k boxes, which have middles and half widths (k, n) of joint ranges."""

    loop: Loop
    target: Array
    tolerances: tuple[float, float]
    middle: Array
    width: Array

    def balls(self, point: Array, radius: float = 0.0) -> Balls:
        """The same ball for each box."""
        return np.tile(point, (len(self.middle), 1)), np.full(len(self.middle), radius)

    def in_joint_frame(self, balls: Balls, joint: int) -> Balls:
        """Balls on the link before a joint, in the frame of the joint."""
        return _transformed(balls, np.linalg.inv(self.loop.before[joint]))

    def behind(self, balls: Balls, joint: int) -> Balls:
        """Balls in the frame of a joint, on the link behind it."""
        return self._turned(balls, joint, -self.middle[:, joint])

    def ahead(self, balls: Balls, joint: int) -> Balls:
        """Balls on the link behind a joint, on the link before it."""
        return _transformed(self._turned(balls, joint, self.middle[:, joint]), self.loop.before[joint])

    def through_target(self, balls: Balls, *, to_last: bool) -> Balls:
        """Balls on the base, on the last link, which the target and its tolerances tie to the base; or the reverse."""
        base_from_last = self.target @ np.linalg.inv(self.loop.tool)
        # The tolerances apply to the tcp, here in the frame that the balls are moved from.
        matrix, tcp = (base_from_last, self.loop.tool) if to_last else (np.linalg.inv(base_from_last), self.target)
        centre, radius = balls
        away = np.linalg.norm(centre - tcp[:3, 3], axis=1) + radius
        position, orientation = self.tolerances
        return _transformed((centre, radius + position + orientation * away), matrix)

    def _turned(self, balls: Balls, joint: int, by: Array) -> Balls:
        """The balls that enclose balls after the motion of a joint by ``by`` (k,) +- its half width."""
        (centre, radius), width = balls, self.width[:, joint]
        if self.loop.prismatic[joint]:
            return centre + np.multiply.outer(by, [0.0, 0.0, 1.0]), radius + width
        # the ball around the chord of the arc on which the centre moves
        rho = np.hypot(centre[:, 0], centre[:, 1])
        half = np.minimum(width, np.pi / 2)
        phase = np.arctan2(centre[:, 1], centre[:, 0]) + by
        inwards = rho * np.cos(half)
        moved = np.stack([inwards * np.cos(phase), inwards * np.sin(phase), centre[:, 2]], axis=1)
        return moved, radius + rho * np.sin(half)


def _transformed(balls: Balls, matrix: npt.NDArray[Any]) -> Balls:
    return balls[0] @ matrix[:3, :3].T + matrix[:3, 3], balls[1]


def _distance(motion: _LinkMotion, arc: _Arc, error: float) -> tuple[Array, Array]:
    """(k,) lower and upper bounds of the distance of the ends of an arc over k boxes, with each joint exact in turn."""
    loop, size = motion.loop, motion.loop.size
    # balls around the start on the link before each joint
    before: list[Balls] = []
    after: list[Balls] = []
    balls = motion.balls(arc.start, error)
    for i, joint in enumerate(arc.joints):
        if i == arc.target:
            balls = motion.through_target(balls, to_last=True)
        before.append(motion.in_joint_frame(balls, joint))
        balls = motion.behind(before[-1], joint)
    if arc.target == len(arc.joints):
        balls = motion.through_target(balls, to_last=True)
    if not arc.joints:
        straight = np.linalg.norm(balls[0] - arc.end, axis=1)
        return straight - balls[1] - ROUNDING * size, straight + balls[1] + ROUNDING * size
    # balls around the end on the link behind each joint
    balls = motion.balls(arc.end)
    for i, joint in reversed(list(enumerate(arc.joints))):
        if i + 1 == arc.target:
            balls = motion.through_target(balls, to_last=False)
        after.insert(0, balls)
        balls = motion.ahead(balls, joint)
    # the rotation of each joint in turn is exact, and the best bound holds
    low, high = np.full(len(motion.middle), -np.inf), np.full(len(motion.middle), np.inf)
    for joint, (a, ra), (b, rb) in zip(arc.joints, before, after, strict=True):
        least, most = _squares(loop.prismatic[joint], a, b, motion.middle[:, joint], motion.width[:, joint])
        square = SQUARE_ROUNDING * (size**2 + most)
        off = ra + rb + ROUNDING * size
        low = np.maximum(low, np.sqrt(np.maximum(least - square, 0.0)) - off)
        high = np.minimum(high, np.sqrt(np.maximum(most, 0.0) + square) + off)
    return low, high


def _gap(motion: _LinkMotion, overlap: BodyOverlap, through_target: bool) -> Array:
    """(k,) upper bounds of the signed distance of ball and box over k boxes: below 0, they overlap everywhere.

    The ball is moved to the link of the box along the joints between the links, or through the target.
    """
    # the joints between the links; None is the step through the target
    n, start, end = len(motion.loop.before), overlap.ball_link, overlap.box_link
    ascending = (start <= end) != through_target
    route: list[int | None] = [*range(start, end)] if ascending else [*range(start - 1, end - 1, -1)]
    if through_target and ascending:
        route = [*range(start, n), None, *range(end)]
    elif through_target:
        route = [*range(start - 1, -1, -1), None, *range(n - 1, end - 1, -1)]
    balls = motion.balls(overlap.centre)
    for joint in route:
        if joint is None:
            balls = motion.through_target(balls, to_last=ascending)
        elif ascending:
            balls = motion.behind(motion.in_joint_frame(balls, joint), joint)
        else:
            balls = motion.ahead(balls, joint)
    # signed distance of the enclosing balls from the box, in its axes
    centre, radius = _transformed(balls, np.linalg.inv(overlap.link_from_box))
    beyond = np.abs(centre) - overlap.half
    inside, outside = beyond.max(axis=1), np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.asarray(np.where(inside > 0, outside, inside) + radius - overlap.radius - overlap.box_radius)


def _squares(prismatic: bool, a: Array, b: Array, middle: Array, width: Array) -> tuple[Array, Array]:
    """(k,) bounds of the squared distance of a (k, 3), after a joint in its range moved it back, from b (k, 3)."""
    height = a[:, 2] - b[:, 2]
    if prismatic:
        across = ((a[:, :2] - b[:, :2]) ** 2).sum(axis=1)
        off = np.abs(height - middle)
        return across + np.maximum(off - width, 0.0) ** 2, across + (off + width) ** 2
    # the law of cosines, at the angles in the range that are nearest to 0 and to a half rotation
    rho_a, rho_b = np.hypot(a[:, 0], a[:, 1]), np.hypot(b[:, 0], b[:, 1])
    angle = np.arctan2(a[:, 1], a[:, 0]) - np.arctan2(b[:, 1], b[:, 0]) - middle
    angle = np.abs(angle - 2 * np.pi * np.round(angle / (2 * np.pi)))
    near, far = np.maximum(angle - width, 0.0), np.minimum(angle + width, np.pi)
    square = height**2 + rho_a**2 + rho_b**2
    return square - 2 * rho_a * rho_b * np.cos(near), square - 2 * rho_a * rho_b * np.cos(far)
