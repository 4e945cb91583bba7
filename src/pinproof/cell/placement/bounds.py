r"""Lower bounds of the cycle time at all placements of a cell.

A joint with the limits v and a moves from rest to rest within the time T by at most

.. math:: d(T) = a T^2 / 4 \text{ for } T \le 2 v / a, \qquad d(T) = v T - v^2 / a \text{ otherwise.}

*From home to the grasp*: if no configuration within d(T) of home reaches this pose from any placement of the cell, the
motion takes longer than T. This is the proof that a pose is out of reach
(:mod:`pinproof.cell.placement.empty_regions`), for joint limits that are narrower. The largest such T is found by
bisection. Picks whose poses differ little share a proof with the wider tolerance.

*From the grasp to the release, and on the line after the release or, without one, the grasp*: a point that is fixed to
the last link moves by at most the sum of :math:`\rho_j d_j(T)`, where :math:`\rho_j` is the largest distance of the
point from the axis of joint j. The tip moves by the distance of the two poses. On a straight line with fixed
orientation every point moves by that distance, also a point on the last axis.

The motion of a pick with an object rests at the grasp and at the release, and may pass all other poses without a stop.
The motion of a pick without an object rests at the grasp, because the retreat does not continue in the direction of
the approach. The sum of these times over all picks is a lower bound of the cycle time of motions that are planned in
this way. Obstacles are not considered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placement.empty_regions import CellReach, Target, pick_targets
from pinproof.cell.placement.heat_map import EmptyCell, PlacementMap, SlowCell
from pinproof.cell.placement.screening import PlacementScreening
from pinproof.ik.reach_proof import is_provable
from pinproof.model import Arm, JointLimits
from pinproof.picks.input.pick import GraspTolerance
from pinproof.spatial import Array, matrix

BOXES = 12
"""Largest number of boxes of joint values in a proof; ten times more raise the bound by a few percent."""

LEVELS = 40
"""Number of times, up to twice the mean time of a pick, that are tried as the bound of the motion from home."""

FINE = 25
"""Steps between two of these times for the other motions, which need no proof."""

SHARED_DISTANCE = 1.0
"""Picks share a proof if the positions of their targets differ by less than this multiple of the half diagonal of a
cell, and their rotations by less than :data:`SHARED_ROTATION`."""

SHARED_ROTATION = 0.05
"""rad"""

GIVE_UP = 1.5
"""The bound of a cell is not computed further if it can exceed the best time only if the mean of the remaining picks is
more than this multiple of the mean so far."""

LEAST_ESTIMATE = 1.3
"""Cells are examined if the estimated time at their centre is at least this multiple of the best one, because bounds
are much lower than estimates."""

GRASP, RETREATED, RELEASE, LEFT = 1, 2, 4, 5
"""Stations of :class:`~pinproof.cell.placement.screening.GraspTable`."""

Item = tuple[int, Array, Array]
"""The choice, and the lower and upper ends (4,) of a cell."""


def travel(limits: JointLimits, seconds: npt.ArrayLike) -> Array:
    """(..., n) the largest travel of each joint (rad or m) from rest to rest within a time (...)."""
    time = np.asarray(seconds, dtype=float)[..., None]
    v, a = limits.velocity, limits.acceleration
    return np.asarray(np.where(time >= 2.0 * v / a, v * time - v * v / a, 0.25 * a * time**2))


@dataclass(frozen=True, eq=False)
class SlowTask:
    """Bounds the cycle time from below in cells; a row has the bound (s), which is not raised beyond ``best``."""

    screenings: tuple[PlacementScreening, ...]
    half: Array
    best: float
    _bounds: dict[int, _Bounds] = field(default_factory=dict, init=False, repr=False)

    def items(self, grid: PlacementMap, empty: Sequence[EmptyCell]) -> list[Item]:
        """The cells of a grid that are not proven to be empty, and may be slower than the best placement."""
        provable = np.array([is_provable(screening.placed.original) for screening in self.screenings])
        left = provable[grid.choice] & ~grid.within(empty) & ~(grid.seconds < LEAST_ESTIMATE * self.best)
        return [
            (int(grid.choice[k]), grid.placements[k] - self.half, grid.placements[k] + self.half)
            for k in np.flatnonzero(left)
        ]

    def __call__(self, start: int, part: Sequence[Item]) -> list[dict[str, Any]]:
        """The rows of consecutive cells."""
        del start
        for choice in {each[0] for each in part} - set(self._bounds):
            self._bounds[choice] = _Bounds(self.screenings[choice], self.half, self.best)
        return [{"seconds": self._bounds[choice].seconds(0.5 * (lower + upper))} for choice, lower, upper in part]


class _Bounds:
    """The bounds of one choice in cells with the same half sides (4,)."""

    def __init__(self, screening: PlacementScreening, half: Array, best: float) -> None:
        self._best, self._reach = best, CellReach(screening, half)
        arm, picks = screening.placed.original, screening.picks.picks
        self._times = np.linspace(0.0, 2.0 * best / len(picks), LEVELS + 1)
        self._arms = [_limited(arm, screening.home, by) for by in travel(arm.limits, self._times)]
        self._later = float(sum(_times_after_first_stop(screening, self._times[-1])))
        targets = [
            pick_targets(screening, number) for number in range(len(picks)) if _rests_at_grasp(screening, number)
        ]
        self._groups = _groups(targets, SHARED_DISTANCE * float(np.linalg.norm(half[:3])))
        self._picks = len(picks)
        mean = (best - self._later) / len(picks)
        self._needed = int(np.clip(np.searchsorted(self._times, mean), 1, LEVELS))

    def seconds(self, centre: Array) -> float:
        """A lower bound of the cycle time in the cell with this centre (4,)."""
        total, done = self._later, 0
        for count, targets in self._groups:
            low, high, middle = 0, len(self._times), self._needed  # the proof succeeds at low
            while high - low > 1:
                if self._reach.excluded(self._arms[middle], centre, targets, BOXES) is None:
                    high = middle
                else:
                    low = middle
                middle = (low + high) // 2
            total, done = total + count * self._times[low], done + count
            mean = (total - self._later) / done
            if total > self._best or total + GIVE_UP * mean * (self._picks - done) < self._best:
                break
        return float(total)


def _limited(arm: Arm, home: Array, by: Array) -> Arm:
    limits = arm.limits
    lower, upper = np.maximum(limits.lower, home - by), np.minimum(limits.upper, home + by)
    return arm.with_limits(JointLimits(lower, upper, limits.velocity, limits.acceleration))


def _groups(targets: Sequence[list[Target]], near: float) -> list[tuple[int, list[Target]]]:
    """Picks with almost the same targets, the largest group first: their number, and targets that cover all of them."""
    groups: list[tuple[int, list[Target]]] = []
    for own in targets:
        for k, (count, shared) in enumerate(groups):
            if len(shared) != len(own):
                continue
            apart = [_apart(a.pose, b.pose) for a, b in zip(shared, own, strict=True)]
            if all(position < near and rotation < SHARED_ROTATION for position, rotation in apart):
                groups[k] = (
                    count + 1,
                    [
                        Target(a.pose, max(a.position, b.position + position), max(a.rotation, b.rotation + rotation))
                        for a, b, (position, rotation) in zip(shared, own, apart, strict=True)
                    ],
                )
                break
        else:
            groups.append((1, own))
    return sorted(groups, key=lambda group: -group[0])


def _apart(a: Array, b: Array) -> tuple[float, float]:
    """The distance (m) and the angle (rad) between two poses (4, 4)."""
    # |R_a - R_b| = 2 sqrt(2) sin(angle / 2) in the Frobenius norm
    chord = min(float(np.linalg.norm(a[:3, :3] - b[:3, :3])) / np.sqrt(8.0), 1.0)
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])), 2.0 * float(np.arcsin(chord)) + 1e-9


def _times_after_first_stop(screening: PlacementScreening, most: float) -> list[float]:
    """The bounds (s) of the motions after the grasps of all picks, each at most ``most``."""
    arm, table = screening.placed.original, screening.table
    times = np.linspace(0.0, most, LEVELS * FINE + 1)
    moved, tip = travel(arm.limits, times), matrix(screening.picks.tip)
    by_tip = moved @ _levers(arm, (arm.chain.tool @ tip)[:3, 3])
    by_any = np.minimum(by_tip, moved @ _levers(arm, np.zeros(3)))

    def least(reached: Array, distance: float) -> float:
        return float(times[max(int(np.searchsorted(reached, distance)) - 1, 0)])

    found = []
    for number, pick in enumerate(screening.picks.picks):
        tips = (table.stations[:, table.pick == number] @ tip)[..., :3, 3]
        carry, leave, retreat = (
            np.linalg.norm(tips[b] - tips[a], axis=1).min()
            for a, b in ((GRASP, RELEASE), (RELEASE, LEFT), (GRASP, RETREATED))
        )
        if np.isfinite(carry):  # NaN without a place
            if pick.tolerance == GraspTolerance():  # otherwise, the tip is not at the same point of the object
                found.append(least(by_tip, carry))
            found.append(least(by_any, leave))
        elif _rests_at_grasp(screening, number):
            found.append(least(by_any, retreat))
    return found


def _levers(arm: Arm, point: Array) -> Array:
    """(n,) by how much a point (3,) of the last link moves at most for each radian or metre of each joint."""
    chain, limits = arm.chain, arm.limits
    levers, across, reach = np.ones(arm.dof), float(np.hypot(point[0], point[1])), float(np.linalg.norm(point))
    for joint in reversed(range(arm.dof)):
        if not chain.prismatic[joint]:
            levers[joint] = across
        else:
            reach += float(np.abs([limits.lower[joint], limits.upper[joint]]).max())
        step = chain.before[joint][:3, 3]
        across, reach = float(np.hypot(step[0], step[1])) + reach, float(np.linalg.norm(step)) + reach
    return levers


def _rests_at_grasp(screening: PlacementScreening, number: int) -> bool:
    """Whether every motion of a pick is at rest at the first of its poses that are bounded here."""
    pick = screening.picks.picks[number]
    if pick.carried is not None or pick.retreat == 0.0:
        return True
    before, grasp, after = screening.table.stations[:3, screening.table.pick == number][..., :3, 3]
    into, out = grasp - before, after - grasp
    along = (into * out).sum(axis=1)
    lengths = np.linalg.norm(into, axis=1) * np.linalg.norm(out, axis=1)
    return bool((lengths > 0).all() and (along < 0.99 * lengths).all())


def slow_cells(
    items: Sequence[Item], rows: Sequence[dict[str, Any]], choices: Sequence[str], best: float
) -> tuple[SlowCell, ...]:
    """The cells in which every placement is proven to be slower than the best one."""
    return tuple(
        SlowCell(choices[choice], lower, upper, row["seconds"])
        for (choice, lower, upper), row in zip(items, rows, strict=True)
        if row["seconds"] > best
    )
