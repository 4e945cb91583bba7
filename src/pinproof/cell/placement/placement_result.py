"""The result of a search for a placement: certified placements, the heat map, and what is proven of the region."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.cell.placement.heat_map import PlacementMap, finite_or_none
from pinproof.cell.placement.placed_robot import PlacedRobot
from pinproof.cell.placement.placement_keys import PLACEMENT_SCHEMA
from pinproof.cell.placement.placement_picture import heat_map_picture
from pinproof.cell.placement.region import AXES, Placement, PlacementRegion
from pinproof.collision import Scene
from pinproof.common.answer import Answer
from pinproof.common.display import html_block, html_list, html_table, markdown_table, outline
from pinproof.common.files import json_text, save_as
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.picks.input.pick import Picks
from pinproof.picks.report.report import PickReport
from pinproof.spatial import SE3, rigid, xyz_rpy

MOST_FAILING = 20
"""Largest number of failing picks that are listed in text; JSON has all of them."""


@dataclass(frozen=True, eq=False)
class CertifiedPlacement:
    """A placement at which every pick was judged completely.

    Parameters
    ----------
    placement
        The placement.
    report
        The verdicts on all picks, in the frame of the cell, with certificates of the good ones.
    estimate
        The value of the objective that the screening estimated; NaN without an estimate.
    score
        The value of the objective, to be minimised: the cycle time (s), or minus the clearance (m) or manipulability.
    """

    placement: Placement
    report: PickReport
    estimate: float
    score: float
    placed: PlacedRobot = field(repr=False)

    @property
    def ok(self) -> bool:
        """Whether every pick is good."""
        return self.report.ok

    @property
    def cycle_time(self) -> float:
        """Seconds: the sum of the times of all good picks."""
        return total_time(self.report)

    @property
    def clearance(self) -> float:
        """Metres: the smallest proven clearance of all motions."""
        return min((verdict.clearance for verdict in self.report.good), default=float("nan"))

    @property
    def arm(self) -> Arm:
        """The arm at this placement, in the frame of the cell."""
        return self.placed.arm_at(self.placement.values)

    @property
    def scene(self) -> Scene:
        """The obstacles that do not move with the base, in the frame of the cell."""
        return self.placed.scene

    @property
    def cell_from_root(self) -> SE3:
        """The pose of the root link of the original robot in the cell."""
        return rigid("cell_from_root", self.placed.cell_from_root(self.placement.values[None])[0])

    @property
    def root_from_cell(self) -> SE3:
        """The pose of the cell in the root link of the original robot, for :meth:`pinproof.Scene.transformed`.

        If the work is moved instead of the robot, this is the displacement of the scene and the picks.
        """
        return self.cell_from_root.inverse()

    def to_dict(self) -> dict[str, Any]:
        """The placement as plain values for JSON."""
        pose = (xyz_rpy(self.cell_from_root) + 0.0).tolist()
        return {
            **placement_dict(self.placement),
            "cell_from_root": {"xyz": pose[:3], "rpy": pose[3:]},
            "good": len(self.report.good),
            "picks": len(self.report.verdicts),
            "cycle_time": self.cycle_time,
            "clearance_proven": finite_or_none(self.clearance),
            "estimate": finite_or_none(self.estimate),
            "score": finite_or_none(self.score),
        }

    def __repr__(self) -> str:
        good, total = len(self.report.good), len(self.report.verdicts)
        return f"CertifiedPlacement({self.placement}: {good} of {total} picks good, {self.cycle_time:.3f} s)"


def total_time(report: PickReport) -> float:
    """Seconds: the sum of the times of all good picks of a report."""
    return float(sum(verdict.trajectory.duration for verdict in report.good if verdict.trajectory is not None))


def placement_dict(placement: Placement) -> dict[str, Any]:
    """A placement as plain values for JSON."""
    values = {name: float(value) + 0.0 for name, value in zip(AXES, placement.values, strict=True)}
    return {**values, "choice": placement.choice}


@dataclass(frozen=True)
class PlacementSensitivity:
    """How far the base may be off along one axis, the others being exact, before a pick fails in any stage.

    Parameters
    ----------
    axis
        ``"x"``, ``"y"``, ``"z"`` or ``"yaw"``.
    below, above
        The largest judged deviations (m or rad) in both directions up to which all picks are good at every judged
        deviation, if the robot plans again for its actual placement. What is between judged deviations is not proven.
    first_below, first_above
        What fails first beyond them: a pick, or the base. Empty if nothing fails up to ``searched``.
    why_below, why_above
        The stage at which this pick fails, or ``out of reach`` or ``in contact`` if it does not pass the screening.
    searched
        The largest deviation (m or rad) that was tried in both directions.
    judged_below, judged_above
        The number of deviations up to ``below`` and ``above`` at which all picks were judged good in all stages.
    """

    axis: str
    below: float
    above: float
    first_below: str
    first_above: str
    why_below: str
    why_above: str
    searched: float
    judged_below: int
    judged_above: int

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return dict(vars(self))

    @property
    def range(self) -> str:
        """The axis and both deviations as text."""
        return f"{self.axis} -{_length(self.axis, self.below)} to {_length(self.axis, self.above)}"

    def row(self) -> tuple[str, str, str, str, str]:
        """The cells of a table: the axis, both deviations, and what fails first beyond them."""
        return self.axis, *(
            text
            for value, first, why, judged in (
                (self.below, self.first_below, self.why_below, self.judged_below),
                (self.above, self.first_above, self.why_above, self.judged_above),
            )
            for text in (
                f"{_length(self.axis, value)} ({judged} judged)",
                f"{first}: {why}" if first else f"nothing up to {_length(self.axis, self.searched)}",
            )
        )  # type: ignore[return-value]  # five


@dataclass(frozen=True, eq=False)
class PlacementResult(Answer):
    """The result of :func:`pinproof.place_base`.

    Parameters
    ----------
    candidates
        The placements that were judged completely, the best first; those with a pick that fails are last.
    map
        The screened grid.
    region
        The region that was searched.
    objective
        ``"cycle_time"``, ``"clearance"`` or ``"manipulability"``.
    sensitivity
        How far the base may be off at the best placement, for each axis of the region.
    tolerance
        Metres: the unchanged motions of the best placement are proven to stay free if the base is displaced by no more
        than this; 0 without a good placement. Contact that is allowed, such as that of hand and part, is not covered.
    failing
        The reason for each pick that is good at no placement, by name.
    message
        The result in sentences.
    interrupted
        Whether the search was interrupted; the result then has what was found before.
    """

    candidates: tuple[CertifiedPlacement, ...]
    map: PlacementMap | None
    region: PlacementRegion
    picks: Picks = field(repr=False)
    objective: str
    sensitivity: tuple[PlacementSensitivity, ...] = ()
    tolerance: float = 0.0
    failing: Mapping[str, str] = field(default_factory=dict)
    message: str = ""
    evaluations: int = 0
    interrupted: bool = False

    @property
    def ok(self) -> bool:
        """Whether a placement was found at which every pick is good."""
        return bool(self.candidates) and self.candidates[0].ok

    @property
    def best(self) -> CertifiedPlacement:
        """The best placement at which every pick is good.

        Raises
        ------
        NoAnswer
            If no such placement was found; the message states which picks fail and why.
        """
        return self.or_raise().candidates[0]

    @property
    def least_failing(self) -> CertifiedPlacement | None:
        """The judged placement with the most good picks, which is the best one if every pick is good there."""
        return self.candidates[0] if self.candidates else None

    def __repr__(self) -> str:
        return outline(f"PlacementResult({self.message})", map(repr, self.candidates))

    def _repr_html_(self) -> str:
        return html_block("Placement of the base", html_table(_COLUMNS, self._rows()), html_list([self.message]))

    def _rows(self) -> list[tuple[object, ...]]:
        return [
            (
                each.placement.choice,
                *each.placement.values.tolist(),
                f"{len(each.report.good)} of {len(each.report.verdicts)}",
                each.cycle_time,
                each.clearance * 1e3,
            )
            for each in self.candidates
        ]

    def to_dict(self) -> dict[str, Any]:
        """The result as plain values for JSON."""
        return {
            "schema": PLACEMENT_SCHEMA,
            "ok": self.ok,
            "objective": self.objective,
            "message": self.message,
            "interrupted": self.interrupted,
            "evaluations": self.evaluations,
            "region": {name: list(getattr(self.region, name)) for name in AXES},
            "forbidden": [zone.name for zone in self.region.forbidden],
            "placements": [each.to_dict() for each in self.candidates],
            "sensitivity": [each.to_dict() for each in self.sensitivity],
            "tolerance": self.tolerance,
            "failing": dict(self.failing),
            "map": None if self.map is None else self.map.to_dict(),
        }

    def to_markdown(self) -> str:
        """The tables of placements and of the sensitivity, and the picks that fail."""
        rows = [[f"{cell:.4f}" if isinstance(cell, float) else cell for cell in row] for row in self._rows()]
        lines = [self.message, "", *markdown_table(_COLUMNS, rows)]
        if self.sensitivity:
            heads = ("axis", "all picks good below to", "fails first", "all picks good above to", "fails first")
            lines += ["", *markdown_table(heads, [each.row() for each in self.sensitivity])]
        failing = [f"- {name}: {reason}" for name, reason in self.failing.items()]
        lines += failing[:MOST_FAILING]
        if len(failing) > MOST_FAILING:
            lines.append(f"- and {len(failing) - MOST_FAILING} more picks")
        return "\n".join(lines) + "\n"

    def save(self, path: str | Path) -> None:
        """Write the result as ``.json`` or ``.md``, or the heat map as ``.csv`` or ``.png``.

        The file is written completely or not at all.

        Raises
        ------
        InputError
            For another suffix, or for the heat map if the search was interrupted before it was complete.
        FileError
            If the file cannot be written.
        """
        if self.map is None and Path(path).suffix.lower() in (".csv", ".png"):
            raise InputError(f"{path}: the search was interrupted before the heat map was complete")
        grid = self.map.to_csv if self.map is not None else str
        formats: dict[str, Callable[[], str | bytes]] = {
            ".json": lambda: json_text(self.to_dict()),
            ".csv": grid,
            ".png": self._picture,
            ".md": self.to_markdown,
        }
        save_as(path, formats)

    def _picture(self) -> bytes:
        if self.map is None:
            raise InputError("the search was interrupted before the heat map was complete")
        judged = [each.placement for each in self.candidates]
        return heat_map_picture(self.map, self.region, judged, best=self.ok)


_COLUMNS = ("choice", "x [m]", "y [m]", "z [m]", "yaw [rad]", "good", "cycle time [s]", "clearance [mm]")


def _length(axis: str, value: float) -> str:
    return f"{np.degrees(value):.2f} deg" if axis == "yaw" else f"{value * 1e3:.1f} mm"
