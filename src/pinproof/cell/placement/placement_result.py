"""The result of a search for a placement: certified placements, the heat map, and what is proven of the region."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.cell.placement.placed_work import PlacedWork
from pinproof.cell.placement.region import AXES, PlacedRobot, Placement, PlacementRegion
from pinproof.collision import Scene
from pinproof.common import structs as st
from pinproof.common import theme
from pinproof.common.files import csv_text, figure
from pinproof.common.results import Answer, Rows, Saved, Shown, View, Written
from pinproof.common.validation import freeze_arrays, optional_module
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.spatial import SE3, Array, rigid, xyz_rpy
from pinproof.viewer import ColouredPoints

MOST_FAILING = 20
"""Largest number of failing picks that are listed in text; JSON has all of them."""


REGION = st.Kind(
    st.mapping_to(st.list_of(st.PLAIN_NUMBER, 2, 2)).schema,
    lambda _, region: region,
    write=lambda region: {axis: list(getattr(region, axis)) for axis in AXES},
)

PLACED_POSE = st.report_table(
    "placed_pose",
    "The pose of the root link of the robot in the cell.",
    st.required("xyz", st.vector(3, st.PLAIN_NUMBER), "position", "m", lambda place: xyz_rpy(place)[:3] + 0.0),
    st.required(
        "rpy",
        st.vector(3, st.PLAIN_NUMBER),
        "orientation about fixed axes: R = Rz Ry Rx",
        "rad",
        lambda place: xyz_rpy(place)[3:] + 0.0,
    ),
)


@st.struct(
    "placed",
    first=("placement", "cell_from_root", "good", "picks", "cycle_time", "clearance_proven"),
    written=True,
    eq=False,
)
class CertifiedPlacement(Shown, Written):
    """A placement at which all picks, or a job of tool paths, were judged."""

    placement: Placement = st.key("the placement", inline=st.table_of(Placement))
    report: Any = st.key(
        "the report on all picks, or on the job, in the frame of the cell, with certificates", hidden=True
    )
    estimate: float = st.key("the value of the objective that the screening estimated", kind=st.OPTIONAL_NUMBER)
    score: float = st.key("the certified value of the objective, which is minimised", kind=st.OPTIONAL_NUMBER)
    placed: PlacedRobot = st.key("the robot, its tool and the scene at any placement", hidden=True)

    @property
    def ok(self) -> bool:
        """Whether every pick is good, or the job is followed."""
        return bool(self.report.ok)

    @st.reported(minimum=0)
    def good(self) -> int:
        """Number of good picks, or of strokes that are followed."""
        return len(self.report.good)

    @st.reported(name="picks", minimum=0)
    def judged(self) -> int:
        """Number of picks, or of strokes."""
        return int(self.report.judged)

    @st.reported("s", minimum=0)
    def cycle_time(self) -> float:
        """Sum of the times of all good picks, or the time of the job."""
        return float(self.report.total_time)

    @st.reported("m", name="clearance_proven", kind=st.OPTIONAL_NUMBER)
    def clearance(self) -> float:
        """Smallest proven clearance of all motions."""
        return float(self.report.clearance)

    @property
    def arm(self) -> Arm:
        """The arm at this placement, in the frame of the cell."""
        return self.placed.arm_at(self.placement.values)

    @property
    def scene(self) -> Scene:
        """The obstacles that do not move with the base, in the frame of the cell."""
        return self.placed.scene

    @st.reported(kind=PLACED_POSE)
    def cell_from_root(self) -> SE3:
        """The pose of the root link of the original robot in the cell, with the mounting."""
        return rigid("cell_from_root", self.placed.cell_from_root(self.placement.values[None])[0])

    @property
    def root_from_cell(self) -> SE3:
        """The pose of the cell in the root link of the original robot, for :meth:`pinproof.Scene.transformed`.

        If the work is moved instead of the robot, this is the displacement of the scene and the picks.
        """
        return self.cell_from_root.inverse()

    def _view(self) -> View:
        return View(f"{self.placement}: {self.good} of {self.judged} good, {self.cycle_time:.3f} s")


@st.struct("sensitivity", written=True)
class PlacementSensitivity:
    """How far the base may be off along one axis, the others being exact, if the robot plans again.

    What is between the judged deviations is not proven.
    """

    axis: str = st.key("the axis", kind=st.choice(*AXES))
    below: float = st.key(
        "lower values up to which all picks are good at every judged deviation", "m or rad", minimum=0
    )
    above: float = st.key("the same to higher values", "m or rad", minimum=0)
    first_below: str = st.key("what fails first at lower values: a pick, or the base; empty if nothing does")
    first_above: str = st.key("what fails first at higher values")
    why_below: str = st.key("the stage that fails there, or why the screening is not passed")
    why_above: str = st.key("the same at higher values")
    searched: float = st.key("the largest deviation that was tried", "m or rad", minimum=0)
    judged_below: int = st.key("the number of lower values at which all picks were judged good", minimum=0)
    judged_above: int = st.key("the number of higher values at which all picks were judged good", minimum=0)

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


@st.struct(
    "placement",
    first=("ok", "objective", "message", "interrupted", "evaluations", "region", "forbidden", "placements",
           "sensitivity", "tolerance", "failing", "map"),
    written=True,
    version="pinproof/placement/1",
    eq=False,
)  # fmt: skip
class PlacementResult(Answer, Saved, Written):
    """The result of a search for a placement. Readers must accept unknown keys: they are additions of the same version.

    Notes
    -----
    It is returned by :func:`pinproof.place_base`.
    """

    formats = (".json", ".csv", ".png", ".md")

    candidates: tuple[CertifiedPlacement, ...] = st.key(
        "the placements that were judged completely, the best first; those with a pick that fails are last",
        name="placements",
    )
    map: PlacementMap | None = st.key("the heat map: the screened grid; null if the search was interrupted before")
    region: PlacementRegion = st.key("the ranges of x, y, z (m) and yaw (rad)", kind=REGION)
    work: PlacedWork = st.key("the picks or the job of tool paths as given", hidden=True)
    objective: str = st.key("what was optimised", kind=st.choice("cycle_time", "clearance", "manipulability"))
    sensitivity: tuple[PlacementSensitivity, ...] = st.key(
        "how far the base may be off at the best placement", default=()
    )
    tolerance: float = st.key(
        "displacement of the base for which the unchanged motions of the best placement are proven to stay free; 0 "
        "without a good placement. Contact that is allowed, such as that of hand and part, is not covered",
        "m",
        default=0.0,
        minimum=0,
    )
    failing: Mapping[str, str] = st.key(
        "the reason for each pick that is good at no placement, by name", default_factory=dict
    )
    message: str = st.key("the result in sentences", default="")
    evaluations: int = st.key("number of placements that were screened", default=0, minimum=0)
    interrupted: bool = st.key(
        "whether the search was interrupted; the result then has what was found before", default=False
    )

    @st.reported()
    def ok(self) -> bool:
        """Whether a placement was found at which every pick is good."""
        return bool(self.candidates) and self.candidates[0].ok

    @st.reported()
    def forbidden(self) -> tuple[str, ...]:
        """The names of the forbidden zones."""
        return tuple(zone.name for zone in self.region.forbidden)

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

    def _view(self) -> View:
        rows = (
            (
                candidate.placement.choice,
                *(f"{value:.4f}" for value in candidate.placement.values),
                f"{candidate.good} of {candidate.judged}",
                f"{candidate.cycle_time:.4f}",
                f"{candidate.clearance * 1e3:.4f}",
            )
            for candidate in self.candidates
        )
        columns = ("choice", "x [m]", "y [m]", "z [m]", "yaw [rad]", "good", "cycle time [s]", "clearance [mm]")
        heads = ("axis", "all good below to", "fails first", "all good above to", "fails first")
        failing = [f"{name}: {reason}" for name, reason in self.failing.items()]
        if len(failing) > MOST_FAILING:
            failing[MOST_FAILING:] = [f"and {len(failing) - MOST_FAILING} more"]
        parts = [
            Rows(columns, rows, numbers={*columns[1:5], *columns[6:]}),
            Rows(heads, [axis.row() for axis in self.sensitivity]) if self.sensitivity else None,
            failing,
        ]
        return View(self.message, parts, map(repr, self.candidates))

    def to_csv(self) -> str:
        """The heat map: one row per placement."""
        return self._whole_map().to_csv()

    def _png(self) -> bytes:
        """The share of picks that pass the screening and the estimated cycle time, one row per choice."""
        figures = optional_module("matplotlib.figure", "a PNG", "plot")
        grid, judged = self._whole_map(), [candidate.placement for candidate in self.candidates]
        figure = figures.Figure(figsize=(10.5, 4.2 * len(grid.choices) + 0.4), layout="constrained")
        panels = figure.subplots(len(grid.choices), 2, squeeze=False)
        # the edges of the cells; a single cell without extent is drawn 1 cm wide
        x, y = (
            np.linspace(low, high, len(centres) + 1) if high > low else np.array([low - 0.005, low + 0.005])
            for centres, (low, high) in zip(grid.axes[:2], (self.region.x, self.region.y), strict=True)
        )
        for number, floor in enumerate(grid.floors):
            name, share, seconds = floor.choice, floor.share, floor.seconds
            for panel, values, label, colours, limits in (
                (panels[number][0], share, f"share of {self.work.poses} that pass screening", "viridis", (0.0, 1.0)),
                (panels[number][1], seconds, "estimated cycle time [s]", "viridis_r", (None, None)),
            ):
                if np.isfinite(values).any():
                    image = panel.pcolormesh(x, y, values.T, cmap=colours, vmin=limits[0], vmax=limits[1])
                    figure.colorbar(image, ax=panel, label=label, shrink=0.85)
                else:
                    panel.text(0.5, 0.5, f"no {label.split(' [')[0]}", transform=panel.transAxes, ha="center", zorder=3,
                               bbox={"facecolor": WHITE, "edgecolor": GREY})  # fmt: skip
                for placement in judged:
                    if placement.choice == name:
                        star = self.ok and placement is judged[0]
                        panel.plot(
                            placement.x, placement.y, "*" if star else "o", color=RED if star else WHITE,
                            markeredgecolor=INK, markersize=15 if star else 6, clip_on=False, zorder=3 if star else 2,
                        )  # fmt: skip
                # The searched region, and the axes of the base at the best placement of this choice
                corners = x[[0, -1, -1, 0, 0]], y[[0, 0, -1, -1, 0]]
                panel.fill(*corners, color=GREY, zorder=0)
                panel.plot(*corners, "--", color=INK, linewidth=1)
                length = AXIS_SHARE * max(x[-1] - x[0], y[-1] - y[0])
                for placement in [own for own in judged if own.choice == name][:1]:
                    cosine, sine = np.cos(placement.yaw), np.sin(placement.yaw)
                    panel.quiver(
                        [placement.x] * 2, [placement.y] * 2, [cosine, -sine], [sine, cosine], color=theme.AXES[:2],
                        angles="xy", scale_units="xy", scale=1.0 / length, width=0.012, zorder=4, clip_on=False,
                    )  # fmt: skip
                panel.set(
                    xlim=(x[0] - length, x[-1] + length), ylim=(y[0] - length, y[-1] + length), aspect="equal",
                    xlabel="x of the base [m]", ylabel="y of the base [m]",
                )  # fmt: skip
                panel.set_title(name or "best over z and yaw", fontsize=10)
        legend = "star, best certified; " if self.ok else ""
        legend += "circle, judged; " if len(judged) > self.ok else ""
        legend += "red and green, x and y of the base there; dashed, the region; " if judged else "dashed, the region; "
        figure.suptitle(f"Placements of the base: {legend}grey, no placement", fontsize=11)
        out = io.BytesIO()
        figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
        return out.getvalue()

    def _whole_map(self) -> PlacementMap:
        if self.map is None:
            raise InputError("the search was interrupted before the heat map was complete")
        return self.map


def _length(axis: str, value: float) -> str:
    return f"{np.degrees(value):.2f} deg" if axis == "yaw" else f"{value * 1e3:.1f} mm"


AXIS_SHARE = 0.15
"""Length of the axes of the base in the heat map, as a fraction of the region, which has such a margin."""

RED, GREY, WHITE, INK = (theme.COLOURS[name] for name in ("bad", "line", "paper", "ink"))

Mask = npt.NDArray[np.bool_]


GRID = st.list_of(st.list_of(st.OPTIONAL_NUMBER))


@st.struct("floor_map", written=True, eq=False)
class FloorMap:
    """The best values over z and yaw at each x and y, for one choice; null where no value exists."""

    choice: str = st.key("name of the discrete choice")
    share: Array = st.key("share of the picks that pass the screening, for each x a list over y", kind=GRID)
    seconds: Array = st.key("estimated cycle time", "s", kind=GRID)


@st.struct("placement_map", written=True, eq=False)
class PlacementMap(Shown, Written):
    """The heat map over the floor: the screened grid of placements."""

    placements: Array = st.key("(N, 4) x, y, z, yaw", hidden=True)
    choices: tuple[str, ...] = st.key("the names of the discrete choices", hidden=True)
    choice: npt.NDArray[np.int64] = st.key("(N,) index of the choice of each placement", hidden=True)
    axes: tuple[Array, Array, Array, Array] = st.key(
        "the values of x, y, z and yaw of the grid, in which yaw varies fastest", hidden=True
    )
    base: Mask = st.key("(N,) whether the base and the arm at home are free", hidden=True)
    codes: npt.NDArray[np.int8] = st.key(
        "(N, P) codes of :class:`~pinproof.picks.ScreenStatus` of each pick at its worst pose: grasp, release, and the "
        "ends of the straight lines",
        hidden=True,
    )
    share: Array = st.key("(N,) share of the picks that pass the screening, from 0 to 1", hidden=True)
    seconds: Array = st.key("(N,) estimated cycle time; NaN where a pick does not pass", "s", hidden=True)
    estimate: Array = st.key("(N,) estimated value of the objective; NaN where a pick does not pass", hidden=True)

    def __post_init__(self) -> None:
        freeze_arrays(self, "placements", "choice", "base", "codes", "share", "seconds", "estimate")

    def __len__(self) -> int:
        return len(self.placements)

    def _view(self) -> View:
        return View(f"{len(self):,} placements, everything passes the screening at {self.feasible.sum():,}")

    @st.reported("m", kind=st.list_of(st.PLAIN_NUMBER))
    def x(self) -> Array:
        """The x of the grid."""
        return self.axes[0]

    @st.reported("m", kind=st.list_of(st.PLAIN_NUMBER))
    def y(self) -> Array:
        """The y of the grid."""
        return self.axes[1]

    @st.reported(name="choices")
    def floors(self) -> tuple[FloorMap, ...]:
        """The maps of all choices."""
        return tuple(
            FloorMap(name, self.over_floor(self.share, number), self.over_floor(self.seconds, number, np.nanmin))
            for number, name in enumerate(self.choices)
        )

    @property
    def feasible(self) -> Mask:
        """(N,) placements at which every pick passes the screening."""
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
            Whether to show the estimated cycle time instead of the share of the picks that pass.
        height
            The z of the points in the frame of the cell, in metres.
        """
        values = self.over_floor(self.seconds if seconds else self.share, choice, np.nanmin if seconds else np.nanmax)
        x, y = np.meshgrid(self.axes[0], self.axes[1], indexing="ij")
        known = np.isfinite(values)
        xyz = np.column_stack([x[known], y[known], np.full(int(known.sum()), height)])
        steps = [float(axis[1] - axis[0]) for axis in self.axes[:2] if len(axis) > 1]
        label = "estimated cycle time [s]:" if seconds else "share that passes the screening:"
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
