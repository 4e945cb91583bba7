"""The lines an arm's joints turn about and slide along, at q = 0, and the triples among them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof.errors import NoClosedForm
from pinproof.model import Arm

__all__ = ["Line", "Triple", "find_triples", "lines_of", "size_of"]

Array = npt.NDArray[np.float64]

SNAP_TOLERANCE = 5e-3
"""Rad, and m on an arm of 1 m. Calibration moves axes by less; Newton's iteration on the true arm still arrives."""

EXACT = 1e-9
"""Rad, and parts of the arm's size. Axes this near to the ideal are ideal: a branch is then wrong by less than the
finest tolerance, and refinement costs nothing."""

DISTINCT = 1e-2
"""Axes nearer to one line than this (rad, and parts of the arm's size) move as one joint: no triple rests on them."""


@dataclass(frozen=True, eq=False)
class Line:
    """A joint: unit direction (3,), a point (3,) in m, whether it slides, and its place in q (-1: made up)."""

    direction: Array
    point: Array
    slides: bool
    own: int

    def nearest_to(self, other: Line) -> Array:
        """The point (3,) of this line that is nearest to another; of parallel ones, nearest to its stored point."""
        gap = other.point - self.point
        cosine = float(self.direction @ other.direction)
        across = 1.0 - cosine**2
        if across < DISTINCT**2:
            return np.asarray(self.point + (gap @ self.direction) * self.direction)
        way = (gap @ self.direction - (gap @ other.direction) * cosine) / across
        return np.asarray(self.point + way * self.direction)


@dataclass(frozen=True, eq=False)
class Triple:
    """Three neighbouring lines of six that meet in a point, or that move in a plane.

    Parameters
    ----------
    first
        Index of the first.
    planar
        Whether they generate planar motions; else they are spherical.
    miss
        How far from ideal they are: rad, or m over the arm's size.
    lines
        The three, made ideal.
    """

    first: int
    planar: bool
    miss: float
    lines: tuple[Line, Line, Line]

    @property
    def name(self) -> str:
        """In words."""
        kind = "move in one plane" if self.planar else "meet in one point"
        if self.planar and not any(line.slides for line in self.lines):
            kind = "are parallel"
        return kind


def lines_of(arm: Arm) -> tuple[list[Line], Array]:
    """The lines of the joints at q = 0, and base_from_tcp (4, 4) there.

    Raises
    ------
    NoClosedForm
        If a joint on the chain follows another (mimic).
    """
    chain = arm.packed
    coupled = len(chain) - 1 != arm.dof or (chain[:-1, 14] != 1.0).any() or chain[:-1, 15].any()
    if coupled:
        raise NoClosedForm(
            f"no closed form: between {arm.base!r} and {arm.tcp!r} a joint follows another (mimic), which couples the "
            "equations; use Clik"
        )
    pose, lines = np.eye(4), []
    for row in chain:
        step = np.eye(4)
        step[:3] = row[:12].reshape(3, 4)
        pose = pose @ step
        lines.append(Line(pose[:3, 2].copy(), pose[:3, 3].copy(), bool(row[12]), int(row[13])))
    return lines[:-1], pose


def size_of(lines: Sequence[Line], tool: Array) -> float:
    """The length (m) the arm is measured in: the widest distance between its joints and the tcp."""
    points = np.array([line.point for line in lines] + [tool[:3, 3]])
    return max(float(np.linalg.norm(points[:, None] - points[None], axis=2).max()), 1e-3)


def find_triples(lines: Sequence[Line], size: float, tolerance: float = SNAP_TOLERANCE) -> Iterator[Triple]:
    """Every triple among neighbours of six lines whose miss is within the tolerance."""
    for first in range(len(lines) - 2):
        three = (lines[first], lines[first + 1], lines[first + 2])
        for triple in (_spherical(first, three, size), _planar(first, three, size)):
            if triple is not None and triple.miss <= tolerance:
                yield triple


def _spherical(first: int, three: tuple[Line, Line, Line], size: float) -> Triple | None:
    if any(line.slides for line in three):
        return None
    axes = np.array([line.direction for line in three])
    if min(np.linalg.norm(np.cross(axes[i], axes[i + 1])) for i in range(2)) < DISTINCT:
        return None
    points = np.array([line.point for line in three])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centre = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, points))
    miss = float(np.linalg.norm(np.einsum("kij,kj->ki", across, centre - points), axis=1).max()) / size
    a, b, c = (replace(line, point=centre) for line in three)
    return Triple(first, False, miss, (a, b, c))


def _planar(first: int, three: tuple[Line, Line, Line], size: float) -> Triple | None:
    turning = [line for line in three if not line.slides]
    if not turning:
        return None
    same = np.array([np.sign(line.direction @ turning[0].direction) * line.direction for line in turning])
    normal = same.sum(axis=0)
    if np.linalg.norm(normal) < 0.5:
        return None
    normal /= np.linalg.norm(normal)
    miss = max(
        float(abs(line.direction @ normal)) if line.slides else float(np.linalg.norm(np.cross(line.direction, normal)))
        for line in three
    )
    level = normal @ turning[0].point
    ideal = []
    for line in three:
        if line.slides:
            direction = line.direction - (line.direction @ normal) * normal
            if np.linalg.norm(direction) < 0.5:
                return None
            ideal.append(replace(line, direction=direction / np.linalg.norm(direction)))
        else:
            direction = np.sign(line.direction @ normal) * normal
            ideal.append(replace(line, direction=direction, point=line.point + (level - normal @ line.point) * normal))
    for a, b in ((0, 1), (1, 2)):
        if ideal[a].slides == ideal[b].slides:
            apart = (
                np.linalg.norm(np.cross(ideal[a].direction, ideal[b].direction))
                if ideal[a].slides
                else np.linalg.norm(ideal[a].point - ideal[b].point) / size
            )
            if apart < (DISTINCT if ideal[a].slides else DISTINCT / 10):
                return None
    return Triple(first, True, miss, (ideal[0], ideal[1], ideal[2]))
