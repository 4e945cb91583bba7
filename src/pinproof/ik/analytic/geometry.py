"""The joint axes of an arm at q = 0, the triples among them, and the completion of shorter chains to six axes.

A *triple* consists of three consecutive axes that meet in one point or generate motions of one plane.

A prismatic joint commutes with an adjacent revolute joint whose axis is parallel: a SCARA with the order RRPR is
equivalent to RRRP. An arm of seven joints is considered with each joint locked in turn.

An arm of fewer than six joints is completed by virtual revolute joints, whose values must be zero. If two of its axes
meet or are parallel, one virtual joint completes them to a triple; a single revolute axis needs two, and no revolute
axis three. The remaining virtual axes pass near the tcp in general position: the best conditioned of some random draws.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinproof.errors import NoClosedForm
from pinproof.model import Arm
from pinproof.spatial import Array, rotation_about_line

SNAP_TOLERANCE = 5e-3
"""Rad, and m for an arm of 1 m. Calibration moves axes by less, and Newton's method on the true arm still converges."""

EXACT = 1e-9
"""Rad, and fraction of the arm's size. Axes this close to the ideal are treated as ideal: the error of a branch is then
below the finest tolerance."""

DISTINCT = 1e-2
"""Rad, and fraction of the arm's size. Two axes closer than this act as one joint and are not used in one triple."""


@dataclass(frozen=True, eq=False)
class JointLine:
    """A joint axis: unit direction (3,), point (3,) in m, whether it is prismatic, and its index in q (-1: virtual)."""

    direction: Array
    point: Array
    prismatic: bool
    joint: int

    def nearest_to(self, other: JointLine) -> Array:
        """The point (3,) of this line that is closest to another line; for parallel lines, to the other's point."""
        gap = other.point - self.point
        cosine = float(self.direction @ other.direction)
        across = 1.0 - cosine**2
        if across < DISTINCT**2:
            return np.asarray(self.point + (gap @ self.direction) * self.direction)
        along = (gap @ self.direction - (gap @ other.direction) * cosine) / across
        return np.asarray(self.point + along * self.direction)


@dataclass(frozen=True, eq=False)
class Triple:
    """Three consecutive axes of six that meet in one point, or that generate motions of one plane.

    Parameters
    ----------
    first
        Index of the first axis.
    planar
        Whether they generate planar motions; else they are spherical.
    deviation
        Their deviation from the ideal geometry: rad, or m divided by the arm's size.
    lines
        The three axes, moved to the ideal geometry.
    """

    first: int
    planar: bool
    deviation: float
    lines: tuple[JointLine, JointLine, JointLine]

    @property
    def name(self) -> str:
        """The kind of triple, as a phrase of a message."""
        kind = "generate motions of one plane" if self.planar else "meet in one point"
        if self.planar and not any(line.prismatic for line in self.lines):
            kind = "are parallel"
        return kind


def lines_of(arm: Arm) -> tuple[list[JointLine], Array]:
    """The joint axes at q = 0, and base_from_tcp (4, 4) at q = 0.

    Raises
    ------
    NoClosedForm
        If the chain contains a mimic joint.
    """
    chain = arm.chain
    if chain.has_mimic_joints:
        raise NoClosedForm(
            f"no closed form: the chain from {arm.base!r} to {arm.tcp!r} contains a mimic joint, which couples the "
            "equations; use Clik"
        )
    pose, lines = np.eye(4), []
    for joint in chain.joints:
        pose = pose @ joint.before
        lines.append(JointLine(pose[:3, 2].copy(), pose[:3, 3].copy(), joint.prismatic, joint.index))
    return lines, pose @ chain.tool


def size_of(lines: Sequence[JointLine], tool: Array) -> float:
    """The size of the arm (m): the largest distance between its joints and the tcp."""
    points = np.array([line.point for line in lines] + [tool[:3, 3]])
    return max(float(np.linalg.norm(points[:, None] - points[None], axis=2).max()), 1e-3)


def find_triples(lines: Sequence[JointLine], size: float, tolerance: float = SNAP_TOLERANCE) -> Iterator[Triple]:
    """All triples of consecutive lines whose deviation is within the tolerance."""
    for first in range(len(lines) - 2):
        three = (lines[first], lines[first + 1], lines[first + 2])
        for triple in (_spherical(first, three, size), _planar(first, three, size)):
            if triple is not None and triple.deviation <= tolerance:
                yield triple


def _spherical(first: int, three: tuple[JointLine, JointLine, JointLine], size: float) -> Triple | None:
    if any(line.prismatic for line in three):
        return None
    axes = np.array([line.direction for line in three])
    if min(np.linalg.norm(np.cross(axes[i], axes[i + 1])) for i in range(2)) < DISTINCT:
        return None
    points = np.array([line.point for line in three])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centre = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, points))
    deviation = float(np.linalg.norm(np.einsum("kij,kj->ki", across, centre - points), axis=1).max()) / size
    a, b, c = (replace(line, point=centre) for line in three)
    return Triple(first, False, deviation, (a, b, c))


def _planar(first: int, three: tuple[JointLine, JointLine, JointLine], size: float) -> Triple | None:
    turning = [line for line in three if not line.prismatic]
    if not turning:
        return None
    same = np.array([np.sign(line.direction @ turning[0].direction) * line.direction for line in turning])
    normal = same.sum(axis=0)
    if np.linalg.norm(normal) < 0.5:
        return None
    normal /= np.linalg.norm(normal)
    deviation = max(
        float(abs(line.direction @ normal))
        if line.prismatic
        else float(np.linalg.norm(np.cross(line.direction, normal)))
        for line in three
    )
    level = normal @ turning[0].point
    ideal = []
    for line in three:
        if line.prismatic:
            direction = line.direction - (line.direction @ normal) * normal
            if np.linalg.norm(direction) < 0.5:
                return None
            ideal.append(replace(line, direction=direction / np.linalg.norm(direction)))
        else:
            direction = np.sign(line.direction @ normal) * normal
            ideal.append(replace(line, direction=direction, point=line.point + (level - normal @ line.point) * normal))
    for a, b in ((0, 1), (1, 2)):
        if ideal[a].prismatic == ideal[b].prismatic:
            apart = (
                np.linalg.norm(np.cross(ideal[a].direction, ideal[b].direction))
                if ideal[a].prismatic
                else np.linalg.norm(ideal[a].point - ideal[b].point) / size
            )
            if apart < (DISTINCT if ideal[a].prismatic else DISTINCT / 10):
                return None
    return Triple(first, True, deviation, (ideal[0], ideal[1], ideal[2]))


Order = list[JointLine]

DRAWS = 24
"""Number of random choices of virtual axes that are compared."""


def completed(lines: Sequence[JointLine], tool: Array, size: float) -> Iterator[tuple[int | None, Order]]:
    """Chains of six lines, or of seven with the index of the locked one."""
    if len(lines) == 7:
        for locked in range(7):
            yield locked, list(lines)
        return
    for order in _commuted(list(lines)):
        for with_triple in _with_triple(order, tool, size):
            missing = 6 - len(with_triple)
            yield None, with_triple if missing == 0 else in_general_position(with_triple, missing, tool, size)


def _commuted(lines: Order) -> list[Order]:
    """The orders that result from swapping adjacent joints that commute, the original order first."""
    found = [lines]
    for order in found:
        for i in range(len(order) - 1):
            a, b = order[i], order[i + 1]
            if a.prismatic == b.prismatic or np.linalg.norm(np.cross(a.direction, b.direction)) > 1e-9:
                continue
            swapped = [*order[:i], b, a, *order[i + 2 :]]
            if not any([x.joint for x in swapped] == [x.joint for x in other] for other in found):
                found.append(swapped)
    return found


def _with_triple(lines: Order, tool: Array, size: float) -> Iterator[Order]:
    """The lines, completed by the fewest virtual axes such that three consecutive ones are a triple."""
    missing = 6 - len(lines)
    if missing == 0 or any(find_triples(lines, size)):
        yield lines
        return
    place = tool[:3, 3]
    rng = np.random.default_rng(1)
    found = False
    for i in range(len(lines) - 1):
        a, b = lines[i], lines[i + 1]
        for virtual in _third(a, b, place, size):
            for at in (i, i + 1, i + 2):
                order = [*lines[:at], virtual, *lines[at:]]
                if any(triple.first <= at < triple.first + 3 for triple in find_triples(order, size)):
                    found = True
                    yield order
    if found:
        return
    if missing >= 2:
        for i, line in enumerate(lines):
            if line.prismatic:
                continue
            centre = line.point + ((place - line.point) @ line.direction) * line.direction
            two = [JointLine(_unit(rng), centre, False, -1) for _ in range(2)]
            found = True
            yield [*lines[: i + 1], *two, *lines[i + 1 :]]
    if missing >= 3 and not found:
        yield [*lines, *(JointLine(direction, place, False, -1) for direction in np.eye(3))]


def _third(a: JointLine, b: JointLine, place: Array, size: float) -> Iterator[JointLine]:
    """Virtual axes that complete two adjacent axes to a triple."""
    if a.prismatic and b.prismatic:
        normal = np.cross(a.direction, b.direction)
        if np.linalg.norm(normal) > DISTINCT:
            yield JointLine(normal / np.linalg.norm(normal), place, False, -1)
        return
    if a.prismatic or b.prismatic:
        turning = b if a.prismatic else a
        if abs(a.direction @ b.direction) < SNAP_TOLERANCE:
            yield _beside(turning.direction, turning, turning, place, size)
        return
    normal = np.cross(a.direction, b.direction)
    if np.linalg.norm(normal) < SNAP_TOLERANCE:
        yield _beside(a.direction, a, b, place, size)
    elif np.linalg.norm(normal) > DISTINCT:
        centre = a.nearest_to(b)
        if np.linalg.norm(centre - b.nearest_to(a)) < SNAP_TOLERANCE * size:
            yield JointLine(normal / np.linalg.norm(normal), centre, False, -1)


def _beside(direction: Array, a: JointLine, b: JointLine, place: Array, size: float) -> JointLine:
    """A parallel axis distinct from both: through the tcp, or at a distance from it."""
    aside = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
    for offset in (0.0, 0.5, 1.1, 1.7):
        point = place + offset * size * aside
        if min(np.linalg.norm(np.cross(direction, point - line.point)) for line in (a, b)) > 0.1 * size:
            return JointLine(direction, point, False, -1)
    return JointLine(direction, place, False, -1)


def in_general_position(lines: Order, missing: int, tool: Array, size: float) -> Order:
    """The lines, followed by ``missing`` virtual axes near the tcp: the best conditioned of some random draws."""
    best, best_value = lines, -1.0
    for draw in range(DRAWS):
        rng = np.random.default_rng(draw)
        more = [
            JointLine(_unit(rng), tool[:3, 3] + rng.uniform(-0.5, 0.5, 3) * size, False, -1) for _ in range(missing)
        ]
        order = [*lines, *more]
        value = min(_conditioning(order, np.random.default_rng(7 + k), size) for k in range(4))
        if value > best_value:
            best, best_value = order, value
    return best


def _conditioning(lines: Sequence[JointLine], rng: np.random.Generator, size: float) -> float:
    """The smallest singular value of the screws of the lines, at random values of the joints that are not virtual."""
    moved, screws = np.eye(4), []
    for line in lines:
        h = moved[:3, :3] @ line.direction
        o = moved[:3, :3] @ line.point + moved[:3, 3]
        screws.append(
            np.concatenate([h, np.zeros(3)]) if line.prismatic else np.concatenate([np.cross(o, h) / size, h])
        )
        if line.joint >= 0:
            moved = moved @ _motion(line, float(rng.uniform(-2.0, 2.0)), size)
    return float(np.linalg.svd(np.array(screws), compute_uv=False)[-1])


def _motion(line: JointLine, value: float, size: float) -> Array:
    if not line.prismatic:
        return rotation_about_line(line.point, line.direction, value)
    pose = np.eye(4)
    pose[:3, 3] = value * size * line.direction
    return pose


def _unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))
