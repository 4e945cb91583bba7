"""Chains of six lines to look for triples in: joints that commute swapped, one of seven locked, some made up.

A prismatic joint commutes with a turning one beside it whose axis is parallel: SCARA's RRPR moves as RRRP.

An arm of fewer than six joints is completed with turning joints that are made up, all of which shall stand at zero.
Where two of its axes meet or are parallel, one more makes a triple of them; one turning axis needs two more; none,
three. The others stand at the tcp, in general position: of a few drawn at random, those that leave the Jacobian best
conditioned.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from pinproof.ik.analytic.geometry import DISTINCT, SNAP_TOLERANCE, Line, find_triples

__all__ = ["completed"]

Array = npt.NDArray[np.float64]
Order = list[Line]

DRAWS = 24


def completed(lines: Sequence[Line], tool: Array, size: float) -> Iterator[tuple[int | None, Order]]:
    """Chains of six lines; or of seven, with the index of the one that is locked."""
    if len(lines) == 7:
        for locked in range(7):
            yield locked, list(lines)
        return
    for order in _commuted(list(lines)):
        for with_triple in _with_triple(order, tool, size):
            missing = 6 - len(with_triple)
            yield None, with_triple if missing == 0 else _in_general_position(with_triple, missing, tool, size)


def _commuted(lines: Order) -> list[Order]:
    """The orders that neighbours which commute can be brought into, the arm's own first."""
    found = [lines]
    for order in found:
        for i in range(len(order) - 1):
            a, b = order[i], order[i + 1]
            if a.slides == b.slides or np.linalg.norm(np.cross(a.direction, b.direction)) > 1e-9:
                continue
            swapped = [*order[:i], b, a, *order[i + 2 :]]
            if not any([x.own for x in swapped] == [x.own for x in other] for other in found):
                found.append(swapped)
    return found


def _with_triple(lines: Order, tool: Array, size: float) -> Iterator[Order]:
    """The lines, completed until three neighbours make a triple, with as few made up as it takes."""
    missing = 6 - len(lines)
    if missing == 0 or any(find_triples(lines, size)):
        yield lines
        return
    place = tool[:3, 3]
    rng = np.random.default_rng(1)
    found = False
    for i in range(len(lines) - 1):
        a, b = lines[i], lines[i + 1]
        for made_up in _third(a, b, place, size):
            for at in (i, i + 1, i + 2):
                order = [*lines[:at], made_up, *lines[at:]]
                if any(triple.first <= at < triple.first + 3 for triple in find_triples(order, size)):
                    found = True
                    yield order
    if found:
        return
    if missing >= 2:
        for i, line in enumerate(lines):
            if line.slides:
                continue
            centre = line.point + ((place - line.point) @ line.direction) * line.direction
            two = [Line(_unit(rng), centre, False, -1) for _ in range(2)]
            found = True
            yield [*lines[: i + 1], *two, *lines[i + 1 :]]
    if missing >= 3 and not found:
        yield [*lines, *(Line(direction, place, False, -1) for direction in np.eye(3))]


def _third(a: Line, b: Line, place: Array, size: float) -> Iterator[Line]:
    """What makes a triple of two neighbours."""
    if a.slides and b.slides:
        normal = np.cross(a.direction, b.direction)
        if np.linalg.norm(normal) > DISTINCT:
            yield Line(normal / np.linalg.norm(normal), place, False, -1)
        return
    if a.slides or b.slides:
        turning = b if a.slides else a
        if abs(a.direction @ b.direction) < SNAP_TOLERANCE:
            yield _beside(turning.direction, turning, turning, place, size)
        return
    normal = np.cross(a.direction, b.direction)
    if np.linalg.norm(normal) < SNAP_TOLERANCE:
        yield _beside(a.direction, a, b, place, size)
    elif np.linalg.norm(normal) > DISTINCT:
        centre = a.nearest_to(b)
        if np.linalg.norm(centre - b.nearest_to(a)) < SNAP_TOLERANCE * size:
            yield Line(normal / np.linalg.norm(normal), centre, False, -1)


def _beside(direction: Array, a: Line, b: Line, place: Array, size: float) -> Line:
    """A parallel axis that lies on neither: through the tcp, or away from it."""
    aside = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
    for way in (0.0, 0.5, 1.1, 1.7):
        point = place + way * size * aside
        if min(np.linalg.norm(np.cross(direction, point - line.point)) for line in (a, b)) > 0.1 * size:
            return Line(direction, point, False, -1)
    return Line(direction, place, False, -1)


def _in_general_position(lines: Order, missing: int, tool: Array, size: float) -> Order:
    best, best_value = lines, -1.0
    for draw in range(DRAWS):
        rng = np.random.default_rng(draw)
        more = [Line(_unit(rng), tool[:3, 3] + rng.uniform(-0.5, 0.5, 3) * size, False, -1) for _ in range(missing)]
        order = [*lines, *more]
        value = min(_conditioning(order, np.random.default_rng(7 + k), size) for k in range(4))
        if value > best_value:
            best, best_value = order, value
    return best


def _conditioning(lines: Sequence[Line], rng: np.random.Generator, size: float) -> float:
    """The smallest singular value of the screws of the lines, at random values of the joints that are not made up."""
    moved, screws = np.eye(4), []
    for line in lines:
        h = moved[:3, :3] @ line.direction
        o = moved[:3, :3] @ line.point + moved[:3, 3]
        screws.append(np.concatenate([h, np.zeros(3)]) if line.slides else np.concatenate([np.cross(o, h) / size, h]))
        if line.own >= 0:
            moved = moved @ _motion(line, float(rng.uniform(-2.0, 2.0)), size)
    return float(np.linalg.svd(np.array(screws), compute_uv=False)[-1])


def _motion(line: Line, value: float, size: float) -> Array:
    pose = np.eye(4)
    if line.slides:
        pose[:3, 3] = value * size * line.direction
        return pose
    x, y, z = line.direction
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose[:3, :3] += np.sin(value) * skew + (1 - np.cos(value)) * skew @ skew
    pose[:3, 3] = line.point - pose[:3, :3] @ line.point
    return pose


def _unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))
