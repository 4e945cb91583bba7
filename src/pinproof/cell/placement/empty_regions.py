r"""Proofs that a cell of placements has no placement: a pick is out of reach, or the base is in contact, everywhere.

Contact of the base is proven by :mod:`pinproof.cell.placement.base_proofs`, the reach as follows.

Let a cell of placements have the centre c with the yaw :math:`\psi`, the half diagonal r of its positions, and the half
width w of its yaw. Moving the base from the centre to any placement of the cell moves the target of the tcp, seen from
the base, by at most

.. math:: r + 2 \sin(w / 2) \, \rho

where :math:`\rho` is the distance of the target from the vertical axis through the centre, and rotates it by at most w.
:func:`pinproof.prove_unreachable` with these tolerances therefore holds for the cell. If the axis of the first joint is
the axis of the yaw, as for most arms on a floor, the yaw has the effect of that joint: the proof then uses limits that
are wider by w instead.

The grasps of a family are covered by their samples: a range of rotations by the rotations that are tried, each with
half a step as tolerance, and a tolerance of the grasp by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placement.base_proofs import BaseContacts
from pinproof.cell.placement.heat_map import EmptyCell, PlacementCell
from pinproof.cell.placement.region import PlacementRegion
from pinproof.cell.placement.screening import REACH, PlacementScreening
from pinproof.ik.reach_proof import is_provable, prove_unreachable
from pinproof.model import Arm, JointLimits
from pinproof.picks.batch.proposals import Span
from pinproof.picks.input.pick import GraspTolerance, Picks, family
from pinproof.spatial import Array, matrix, rigid

EMPTY_BUDGET = 64
"""Boxes of joint values for each grasp; on the cells of the benchmark, six times more prove no further cell."""

PICKS_TRIED = 4
"""Number of picks that are tried for one cell: those that are out of reach at its centre, the farthest first."""

SAME_AXIS = 1e-9
"""Metres, and sine of an angle: two axes that differ by less are considered equal."""

Item = tuple[int, Array, Array, tuple[int, ...]]
"""The choice, the lower and upper ends (4,) of the cell, and the picks that are out of reach at its centre; none if the
base is in contact there."""


@dataclass(frozen=True, eq=False)
class Target:
    """``cell_from_tcp`` (4, 4) of one grasp, and by how much grasps between the samples differ from it (m, rad)."""

    pose: Array
    position: float
    rotation: float


@dataclass(frozen=True, eq=False)
class EmptyTask:
    """Tries to prove that cells are empty; a row has the pick that is out of reach, or the bodies in contact."""

    screenings: tuple[PlacementScreening, ...]
    region: PlacementRegion
    budget: int
    _contacts: dict[int, BaseContacts] = field(default_factory=dict, init=False, repr=False)

    def items(self, axes: tuple[Array, Array, Array, Array], codes: npt.NDArray[np.int8]) -> list[Item]:
        """The cells of a grid that may be empty: at their centres a pick is out of reach, or the base is in contact.

        ``codes`` (N, P) are the screening results of all choices, in the order of the grid. Cells that differ only in
        yaw are one cell if the yaw has the effect of the first joint.
        """
        half = (self.region.upper - self.region.lower) / [2 * len(axis) for axis in axes]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
        turns = len(axes[3])
        items: list[Item] = []
        for choice, screening in enumerate(self.screenings):
            away = codes[choice * len(grid) : (choice + 1) * len(grid)] == REACH
            base = screening.base_free(grid)
            for k in np.flatnonzero(~base):
                items.append((choice, grid[k] - half, grid[k] + half, ()))
            if _yaw_is_first_joint(screening):
                groups = [range(k, k + turns) for k in range(0, len(grid), turns)]
            else:
                groups = [range(k, k + 1) for k in range(len(grid))]
            for group in groups:
                rows = list(group)
                usable = [k for k in rows if base[k]] or rows  # placements with a free base were screened
                never = away[usable].all(axis=0)
                if never.any():
                    lower, upper = grid[rows].min(axis=0) - half, grid[rows].max(axis=0) + half
                    items.append((choice, lower, upper, tuple(np.flatnonzero(never).tolist())))
        return items

    def __call__(self, start: int, part: Sequence[Item]) -> list[dict[str, Any]]:
        """The rows of consecutive cells."""
        del start
        rows: list[dict[str, Any]] = []
        for choice, lower, upper, picks in part:
            screening = self.screenings[choice]
            if picks:
                pick, boxes = self._prove(screening, lower, upper, picks)
                rows.append({"pick": pick, "boxes": boxes, "contact": None})
                continue
            if choice not in self._contacts:
                zones = () if screening.zones is None else (screening.zones,)
                self._contacts[choice] = BaseContacts(screening.placed, screening.checker, *zones)
            rows.append({"pick": None, "boxes": 0, "contact": self._contacts[choice].within(lower, upper)})
        return rows

    def _prove(
        self, screening: PlacementScreening, lower: Array, upper: Array, picks: Sequence[int]
    ) -> tuple[int | None, int]:
        """The pick that is proven to be out of reach in the cell, and the number of boxes of the proof."""
        centre, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        reach = CellReach(screening, half)
        away = np.linalg.norm(screening.table.nominal[list(picks), :3, 3] - centre[:3], axis=1)
        for pick in (picks[k] for k in np.argsort(-away, kind="stable")[:PICKS_TRIED]):
            targets = pick_targets(screening, pick)
            boxes = reach.excluded(screening.placed.original, centre, targets, self.budget)
            if boxes is not None:
                return pick, boxes
        return None, 0


class CellReach:
    """Proofs that targets are out of reach from all placements of cells of one size.

    Parameters
    ----------
    screening
        The robot.
    half
        (4,) half the sides of the cells.
    """

    def __init__(self, screening: PlacementScreening, half: Array) -> None:
        self._placed, arm = screening.placed, screening.placed.original
        self._span, self._provable = Span(arm), is_provable(arm)
        self._width, self._half_diagonal = float(half[3]), float(np.linalg.norm(half[:3]))
        self._turns = _yaw_is_first_joint(screening)
        self._wider: dict[int, Arm] = {}

    def excluded(self, arm: Arm, centre: Array, targets: Sequence[Target], budget: int) -> int | None:
        """The number of boxes of a proof that no target is in reach of an arm; None without a proof.

        ``arm`` has the chain of the robot, and perhaps narrower limits; ``centre`` (4,) is that of the cell.
        """
        base_from_cell = self._placed.base_from_cell(centre[None])[0]
        boxes = 0
        for target in targets:
            position, rotation = target.position + self._half_diagonal, target.rotation
            if not self._turns:
                radius = float(np.linalg.norm(target.pose[:2, 3] - centre[:2])) + target.position
                position += 2.0 * np.sin(min(self._width, np.pi) / 2.0) * radius
                rotation += self._width
            at = base_from_cell @ target.pose
            if self._span.is_beyond(at, position, rotation):
                continue
            if not self._provable:
                return None
            proof = prove_unreachable(
                self._with_width(arm),
                at,
                position_tolerance=max(position, 1e-6),
                orientation_tolerance=max(rotation, 1e-6),
                budget=budget,
                search=False,
            )
            if not proof.proven:
                return None
            boxes += proof.examined
        return boxes

    def _with_width(self, arm: Arm) -> Arm:
        """The arm with the limits of the first joint wider by the half width of the yaw, if it has the same axis."""
        if not self._turns or self._width == 0.0:
            return arm
        if id(arm) not in self._wider:
            change = np.zeros(arm.dof)
            change[0] = self._width
            limits = arm.limits
            wider = JointLimits(limits.lower - change, limits.upper + change, limits.velocity, limits.acceleration)
            self._wider[id(arm)] = arm.with_limits(wider)
        return self._wider[id(arm)]


def pick_targets(screening: PlacementScreening, number: int) -> list[Target]:
    """Targets that together cover every grasp of a pick."""
    pick = screening.picks.picks[number]
    tip = screening.picks.tip.inverse()
    lever = float(np.linalg.norm(tip.translation))
    pose = rigid("pose of a pick", screening.table.nominal[number])
    members = next(family(pick.spin, GraspTolerance(), pick.axis_in(pose)))
    half_step = 0.0
    if pick.spin.sampled and len(members) > 1:
        angles = np.sort(pick.spin.angles)
        step = float(np.diff(angles).max())
        around = 2.0 * np.pi - float(angles[-1] - angles[0])  # the step across a full rotation, if all are allowed
        half_step = 0.5 * (max(step, around) if around < 1.5 * step else step)
    rotation = half_step + np.sqrt(2.0) * pick.tolerance.tilt
    position = float(np.linalg.norm(pick.tolerance.position))
    position += 2.0 * np.sin(min(rotation, np.pi) / 2.0) * lever
    return [Target(matrix(pose * m.nominal_from_tip * tip), position, rotation) for m in members]


def _yaw_is_first_joint(screening: PlacementScreening) -> bool:
    """Whether the axis of the first joint is the vertical axis through the origin of the placement."""
    arm = screening.placed.original
    if arm.chain.prismatic[0]:
        return False
    joint = screening.placed.mounting @ matrix(arm.root_from_base) @ arm.chain.before[0]
    aligned = np.abs(joint[:2, 2]).max() < SAME_AXIS
    return bool(aligned and np.abs(joint[:2, 3]).max() < SAME_AXIS)


def empty_cells(
    items: Sequence[Item],
    rows: Sequence[dict[str, Any]],
    choices: Sequence[str],
    picks: Picks,
    region: PlacementRegion,
) -> tuple[tuple[EmptyCell, ...], float]:
    """The cells that are proven to be empty, and the share of the region that they cover over all choices."""
    cells: list[EmptyCell] = []
    for (choice, lower, upper, _), row in zip(items, rows, strict=True):
        if row["pick"] is not None:
            cells.append(EmptyCell(choices[choice], lower, upper, picks.picks[row["pick"]].name, row["boxes"]))
    reached = {(cell.choice, *_centre(cell)[:3]): cell for cell in cells}
    for (choice, lower, upper, _), row in zip(items, rows, strict=True):
        if row["contact"] is None:
            continue
        cell = EmptyCell(choices[choice], lower, upper, contact=tuple(row["contact"]))
        same = reached.get((cell.choice, *_centre(cell)[:3]))
        if same is None or not (same.lower[3] <= _centre(cell)[3] <= same.upper[3]):
            cells.append(cell)
    whole = PlacementCell("", region.lower, region.upper).volume * len(choices)
    return tuple(cells), min(sum(cell.volume for cell in cells) / whole, 1.0)


def _centre(cell: EmptyCell) -> tuple[float, ...]:
    """The centre (4,) of a cell, rounded, because cells of one position have several yaws."""
    return tuple(np.round(0.5 * (cell.lower + cell.upper), 9).tolist())
