"""The result of a search for a placement: certified placements, the heat map, and what is proven of the region."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placed_robot import PlacedRobot
from pinproof.cell.placement_keys import PLACEMENT_SCHEMA
from pinproof.cell.placement_region import AXES, Placement, PlacementRegion
from pinproof.collision import Scene
from pinproof.common.display import html_block, html_list, html_table, markdown_table, outline
from pinproof.common.files import (
    csv_text,
    figure,
    json_text,
    save_as,
)
from pinproof.common.validation import freeze_arrays
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.picks.input.pick import Picks
from pinproof.picks.report.report import PickReport
from pinproof.spatial import SE3, rigid, xyz_rpy
from pinproof.viewer import ColouredPoints

__all__ = [
    "CertifiedPlacement",
    "EmptyCell",
    "PlacementMap",
    "PlacementResult",
    "PlacementSensitivity",
    "SlowCell",
]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


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
            "clearance_proven": _finite(self.clearance),
            "estimate": _finite(self.estimate),
            "score": _finite(self.score),
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


@dataclass(frozen=True, eq=False)
class PlacementMap:
    """The screened grid of placements.

    Parameters
    ----------
    placements
        (N, 4) x, y, z, yaw.
    choices
        The names of the discrete choices.
    choice
        (N,) index of the choice of each placement.
    axes
        The values of x, y, z and yaw of the grid, in which yaw varies fastest.
    base
        (N,) whether the base and the arm at home are free.
    codes
        (N, P) codes of :class:`~pinproof.picks.ScreenStatus` of each pick at the grasp.
    share
        (N,) share of the picks that work, from 0 to 1.
    seconds
        (N,) estimated cycle time; NaN where a pick does not work.
    estimate
        (N,) estimated value of the objective; NaN where a pick does not work.
    """

    placements: Array
    choices: tuple[str, ...]
    choice: npt.NDArray[np.int64]
    axes: tuple[Array, Array, Array, Array]
    base: Mask
    codes: npt.NDArray[np.int8]
    share: Array
    seconds: Array
    estimate: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, "placements", "choice", "base", "codes", "share", "seconds", "estimate")

    def __len__(self) -> int:
        return len(self.placements)

    def __repr__(self) -> str:
        feasible = int(np.isfinite(self.estimate).sum())
        return f"PlacementMap({len(self):,} placements, {feasible:,} where all picks work)"

    @property
    def feasible(self) -> Mask:
        """(N,) placements at which every pick works, as far as it was screened."""
        return np.asarray(np.isfinite(self.estimate))

    def over_floor(self, values: Array, choice: int, best: Any = np.nanmax) -> Array:
        """(nx, ny) the best of values (N,) over z and yaw at each x and y; NaN where no value exists."""
        grid = values[self.choice == choice].reshape(*(len(axis) for axis in self.axes))
        flat = grid.reshape(*grid.shape[:2], -1)
        known = np.isfinite(flat).any(axis=2)
        out = np.full(known.shape, np.nan)
        out[known] = best(flat[known], axis=1)
        return out

    def floor_points(self, *, choice: int = 0, seconds: bool = False, height: float = 0.0) -> ColouredPoints:
        """The map as points on the floor of the cell, for the page of a sequence.

        Parameters
        ----------
        choice
            The index of the discrete choice.
        seconds
            Whether to show the estimated cycle time instead of the share of the picks that work.
        height
            The z of the points in the frame of the cell, in metres.
        """
        values = self.over_floor(self.seconds if seconds else self.share, choice, np.nanmin if seconds else np.nanmax)
        x, y = np.meshgrid(self.axes[0], self.axes[1], indexing="ij")
        known = np.isfinite(values)
        xyz = np.column_stack([x[known], y[known], np.full(int(known.sum()), height)])
        steps = [float(axis[1] - axis[0]) for axis in self.axes[:2] if len(axis) > 1]
        label = "estimated cycle time [s]:" if seconds else "share of picks that work:"
        shown, size = values[known], 0.4 * min(steps, default=0.05)
        low, high = (float(shown.min(initial=np.inf)), float(shown.max(initial=-np.inf))) if seconds else (0.0, 1.0)
        if not low < high:  # none or one value
            low, high = 0.0, max(high, 1.0)
        return ColouredPoints.of_values(xyz, shown, label=label, low=low, high=high, size=size)

    def to_csv(self) -> str:
        """One row per placement: its values, whether the base is free, the share of picks, and the estimates."""
        figures = np.column_stack([self.share, self.seconds, self.estimate])
        columns = (self.choice.tolist(), self.placements.tolist(), self.base.tolist(), figures.tolist())
        rows = (
            (self.choices[number], *map(figure, values), int(base), *map(figure, row))
            for number, values, base, row in zip(*columns, strict=True)
        )
        return csv_text(("choice", *AXES, "base_free", "share", "estimated_seconds", "estimate"), rows)

    def to_dict(self) -> dict[str, Any]:
        """The map over the floor for each choice, the best over z and yaw, as plain values for a page."""
        return {
            "x": self.axes[0].tolist(),
            "y": self.axes[1].tolist(),
            "choices": [
                {
                    "choice": name,
                    "share": _listed(self.over_floor(self.share, number)),
                    "seconds": _listed(self.over_floor(self.seconds, number, np.nanmin)),
                }
                for number, name in enumerate(self.choices)
            ],
        }


def _listed(values: Array) -> list[list[float | None]]:
    return [[_finite(value) for value in row] for row in values.tolist()]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


@dataclass(frozen=True, eq=False)
class EmptyCell:
    """A cell of placements, at each of which a pick is proven to be out of reach, or the base to be in contact.

    Parameters
    ----------
    choice
        The name of the discrete choice.
    lower, upper
        (4,) the ranges of x, y, z and yaw.
    pick
        The pick that is out of reach; empty if the base is in contact.
    boxes
        Number of boxes of joint values that the proof excludes; 0 if the length of the arm excludes the cell.
    contact
        The part of the base, or of what moves with it, and the obstacle or forbidden zone that overlap.
    """

    choice: str
    lower: Array
    upper: Array
    pick: str = ""
    boxes: int = 0
    contact: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze_arrays(self, "lower", "upper")

    def __repr__(self) -> str:
        why = f"{self.pick} is out of reach" if self.pick else f"{self.contact[0]} penetrates {self.contact[1]}"
        return f"EmptyCell({_ranges(self)}: {why})"

    @property
    def volume(self) -> float:
        """Product of the sides that are not 0."""
        sides = self.upper - self.lower
        return float(np.prod(sides[sides > 0]))


@dataclass(frozen=True, eq=False)
class SlowCell:
    """A cell of placements, at each of which the cycle time is proven to be larger than that of the best placement.

    Parameters
    ----------
    choice
        The name of the discrete choice.
    lower, upper
        (4,) the ranges of x, y, z and yaw.
    seconds
        A lower bound of the cycle time at all placements of the cell, for motions that rest where those of picks do.
    """

    choice: str
    lower: Array
    upper: Array
    seconds: float

    def __post_init__(self) -> None:
        freeze_arrays(self, "lower", "upper")

    def __repr__(self) -> str:
        return f"SlowCell({_ranges(self)}: at least {self.seconds:.3f} s)"


def _ranges(cell: EmptyCell | SlowCell) -> str:
    return ", ".join(f"{n} {a:.3f} to {b:.3f}" for n, a, b in zip(AXES, cell.lower, cell.upper, strict=True))


@dataclass(frozen=True)
class PlacementSensitivity:
    """How far the base may be off along one axis before a pick fails.

    Parameters
    ----------
    axis
        ``"x"``, ``"y"``, ``"z"`` or ``"yaw"``.
    below, above
        The largest deviations (m or rad) in both directions at which all picks still work at the grasp, if the robot
        plans again for its actual placement. inf if no pick fails within the searched range.
    first_below, first_above
        What fails first in either direction: a pick, or the base.
    """

    axis: str
    below: float
    above: float
    first_below: str
    first_above: str

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "axis": self.axis,
            "below": _finite(self.below),
            "above": _finite(self.above),
            "first_below": self.first_below,
            "first_above": self.first_above,
        }


@dataclass(frozen=True, eq=False)
class PlacementResult:
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
    empty
        Cells of placements that are proven to be empty.
    covered
        Share of the region (0 to 1) that these cells cover, over all choices.
    slower, slower_share
        Cells of placements that are proven to be slower than the best one, none of them in an empty cell, and the share
        of the region that they cover. No placement in them or in ``empty`` has a shorter cycle time.
    sensitivity
        How far the base may be off at the best placement, for each axis of the region.
    tolerance
        Metres: the unchanged motions of the best placement are proven to stay free if the base is displaced by no more
        than this; 0 without a good placement. Contact that is allowed, such as that of hand and part, is not covered.
    failing
        The reason for each pick that works at no placement that was screened, by name.
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
    empty: tuple[EmptyCell, ...] = ()
    covered: float = 0.0
    slower: tuple[SlowCell, ...] = ()
    slower_share: float = 0.0
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
    def best(self) -> CertifiedPlacement | None:
        """The best placement at which every pick is good; None without one."""
        return self.candidates[0] if self.ok else None

    @property
    def least_failing(self) -> CertifiedPlacement | None:
        """The judged placement with the most good picks, which is the best one if every pick is good there."""
        return self.candidates[0] if self.candidates else None

    def or_raise(self) -> PlacementResult:
        """The result itself if a placement was found.

        Raises
        ------
        InputError
            If no such placement exists; the message states which picks fail and why.
        """
        if not self.ok:
            raise InputError(self.message)
        return self

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
            "proven_empty": {
                "share": self.covered,
                "cells": [
                    {
                        "choice": c.choice,
                        "lower": c.lower.tolist(),
                        "upper": c.upper.tolist(),
                        "pick": c.pick,
                        "contact": list(c.contact),
                    }
                    for c in self.empty
                ],
            },
            "proven_slower": {
                "share": self.slower_share,
                "cells": [
                    {"choice": c.choice, "lower": c.lower.tolist(), "upper": c.upper.tolist(), "seconds": c.seconds}
                    for c in self.slower
                ],
            },
            "map": None if self.map is None else self.map.to_dict(),
        }

    def to_markdown(self) -> str:
        """The table of placements, what fails, and what is proven."""
        head = ("choice", "x [m]", "y [m]", "z [m]", "yaw [rad]", "good", "cycle time [s]", "clearance [mm]")
        rows = [[f"{cell:.4f}" if isinstance(cell, float) else cell for cell in row] for row in self._rows()]
        lines = [self.message, "", *markdown_table(head, rows)]
        if self.sensitivity:
            rows = [
                [e.axis, _length(e.axis, e.below), _length(e.axis, e.above), e.first_below, e.first_above]
                for e in self.sensitivity
            ]
            lines += ["", *markdown_table(("axis", "below", "above", "fails first below", "fails first above"), rows)]
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
            ".png": lambda: heat_map_picture(self),
            ".md": self.to_markdown,
        }
        save_as(path, formats)


_COLUMNS = ("choice", "x", "y", "z", "yaw", "good", "cycle time [s]", "clearance [mm]")


def _length(axis: str, value: float) -> str:
    if np.isinf(value):
        return "beyond the range"
    return f"{np.degrees(value):.2f} deg" if axis == "yaw" else f"{value * 1e3:.1f} mm"


def heat_map_picture(result: PlacementResult) -> bytes:
    """A PNG with the share of picks that work and the estimated cycle time over the floor, one row per choice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    grid = result.map
    if grid is None:
        raise InputError("the search was interrupted before the heat map was complete")
    names = grid.choices
    figure = Figure(figsize=(10.5, 4.2 * len(names) + 0.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(names), 2, squeeze=False)
    x, y = (
        _edges(axis, bounds) for axis, bounds in zip(grid.axes[:2], (result.region.x, result.region.y), strict=True)
    )
    for number, name in enumerate(names):
        share = grid.over_floor(grid.share, number)
        seconds = grid.over_floor(grid.seconds, number, np.nanmin)
        for panel, values, label, colours, limits in (
            (panels[number][0], share, "share of picks that work", "viridis", (0.0, 1.0)),
            (panels[number][1], seconds, "estimated cycle time [s]", "viridis_r", (None, None)),
        ):
            panel.set_facecolor("#d9d9d9")
            image = panel.pcolormesh(x, y, values.T, cmap=colours, vmin=limits[0], vmax=limits[1])
            figure.colorbar(image, ax=panel, label=label, shrink=0.85)
            for cell in result.empty:
                if cell.choice == name:
                    size = np.maximum(cell.upper - cell.lower, 1e-9)
                    panel.add_patch(
                        Rectangle(
                            (cell.lower[0], cell.lower[1]),
                            size[0],
                            size[1],
                            fill=False,
                            hatch="//",
                            edgecolor="#b3191f",
                            lw=0,
                        )
                    )
            spots = [each.placement for each in result.candidates if each.placement.choice == name]
            for rank, spot in enumerate(spots):
                best = rank == 0 and result.ok and result.candidates[0].placement is spot
                panel.plot(
                    spot.x, spot.y, "*" if best else "o", color="#b3191f" if best else "white", markeredgecolor="black",
                    markersize=15 if best else 6, clip_on=False,
                )  # fmt: skip
            panel.set_xlim(x[0], x[-1])
            panel.set_ylim(y[0], y[-1])
            panel.set_aspect("equal")
            panel.set_xlabel("x of the base [m]")
            panel.set_ylabel("y of the base [m]")
            panel.set_title(name or "best over z and yaw", fontsize=10)
    hatched = "; hatched: proven to have no placement" if result.empty else ""
    figure.suptitle(f"Placements of the base: star, best certified; grey, no placement{hatched}", fontsize=11)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()


def _edges(centres: Array, bounds: Sequence[float]) -> Array:
    """The edges of cells with these centres; a single cell without extent is drawn 1 cm wide."""
    low, high = bounds
    if high <= low:
        return np.array([low - 0.005, low + 0.005])
    return np.linspace(low, high, len(centres) + 1)
