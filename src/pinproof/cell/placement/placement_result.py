"""The result of a search for a placement: certified placements, the heat map, and what is proven of the region."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinproof.cell.placement.heat_map import PlacementMap, heat_map_picture
from pinproof.cell.placement.placed_robot import PlacedRobot
from pinproof.cell.placement.region import AXES, Placement, PlacementRegion
from pinproof.collision import Scene
from pinproof.common.results import Answer, Rows, Saved, Shown, View, Written
from pinproof.common.structs import (
    OPTIONAL_NUMBER,
    PLAIN_NUMBER,
    Kind,
    choice,
    key,
    list_of,
    mapping_to,
    report_table,
    reported,
    required,
    struct,
    table_of,
    vector,
)
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.picks import PickReport, Picks
from pinproof.spatial import SE3, rigid, xyz_rpy

MOST_FAILING = 20
"""Largest number of failing picks that are listed in text; JSON has all of them."""


REGION = Kind(
    mapping_to(list_of(PLAIN_NUMBER, 2, 2)).schema,
    lambda _, region: region,
    write=lambda region: {axis: list(getattr(region, axis)) for axis in AXES},
)

PLACED_POSE = report_table(
    "placed_pose",
    "The pose of the root link of the robot in the cell.",
    required("xyz", vector(3, PLAIN_NUMBER), "position", "m", lambda place: xyz_rpy(place)[:3] + 0.0),
    required(
        "rpy",
        vector(3, PLAIN_NUMBER),
        "orientation about fixed axes: R = Rz Ry Rx",
        "rad",
        lambda place: xyz_rpy(place)[3:] + 0.0,
    ),
)


@struct(
    "placed",
    first=("placement", "cell_from_root", "good", "picks", "cycle_time", "clearance_proven"),
    more=True,
    written=True,
    eq=False,
)
class CertifiedPlacement(Shown, Written):
    """A placement at which all picks were judged."""

    placement: Placement = key("the placement", inline=table_of(Placement))
    report: PickReport = key(
        "the verdicts on all picks, in the frame of the cell, with certificates of the good ones", hidden=True
    )
    estimate: float = key("the value of the objective that the screening estimated", kind=OPTIONAL_NUMBER)
    score: float = key("the certified value of the objective, which is minimised", kind=OPTIONAL_NUMBER)
    placed: PlacedRobot = key("the robot, its tool and the scene at any placement", hidden=True)

    @property
    def ok(self) -> bool:
        """Whether every pick is good."""
        return self.report.ok

    @property
    @reported(minimum=0)
    def good(self) -> int:
        """Number of good picks."""
        return len(self.report.good)

    @property
    @reported(name="picks", minimum=0)
    def judged(self) -> int:
        """Number of picks."""
        return len(self.report.verdicts)

    @property
    @reported("s", minimum=0)
    def cycle_time(self) -> float:
        """Sum of the times of all good picks."""
        return total_time(self.report)

    @property
    @reported("m", name="clearance_proven", kind=OPTIONAL_NUMBER)
    def clearance(self) -> float:
        """Smallest proven clearance of all motions."""
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
    @reported(kind=PLACED_POSE)
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
        return View(f"{self.placement}: {self.good} of {self.judged} picks good, {self.cycle_time:.3f} s")


def total_time(report: PickReport) -> float:
    """Seconds: the sum of the times of all good picks of a report."""
    return float(sum(verdict.trajectory.duration for verdict in report.good if verdict.trajectory is not None))


@struct("sensitivity", more=True, written=True)
class PlacementSensitivity:
    """How far the base may be off along one axis, the others being exact, if the robot plans again.

    What is between the judged deviations is not proven.
    """

    axis: str = key("the axis", kind=choice(*AXES))
    below: float = key("lower values up to which all picks are good at every judged deviation", "m or rad", minimum=0)
    above: float = key("the same to higher values", "m or rad", minimum=0)
    first_below: str = key("what fails first at lower values: a pick, or the base; empty if nothing does")
    first_above: str = key("what fails first at higher values")
    why_below: str = key("the stage that fails there, or why the screening is not passed")
    why_above: str = key("the same at higher values")
    searched: float = key("the largest deviation that was tried", "m or rad", minimum=0)
    judged_below: int = key("the number of lower values at which all picks were judged good", minimum=0)
    judged_above: int = key("the number of higher values at which all picks were judged good", minimum=0)

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


@struct(
    "placement",
    first=("ok", "objective", "message", "interrupted", "evaluations", "region", "forbidden", "placements",
           "sensitivity", "tolerance", "failing", "map"),
    more=True,
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

    candidates: tuple[CertifiedPlacement, ...] = key(
        "the placements that were judged completely, the best first; those with a pick that fails are last",
        name="placements",
    )
    map: PlacementMap | None = key("the heat map: the screened grid; null if the search was interrupted before")
    region: PlacementRegion = key("the ranges of x, y, z (m) and yaw (rad)", kind=REGION)
    picks: Picks = key("the picks as given", hidden=True)
    objective: str = key("what was optimised", kind=choice("cycle_time", "clearance", "manipulability"))
    sensitivity: tuple[PlacementSensitivity, ...] = key("how far the base may be off at the best placement", default=())
    tolerance: float = key(
        "displacement of the base for which the unchanged motions of the best placement are proven to stay free; 0 "
        "without a good placement. Contact that is allowed, such as that of hand and part, is not covered",
        "m",
        default=0.0,
        minimum=0,
    )
    failing: Mapping[str, str] = key(
        "the reason for each pick that is good at no placement, by name", default_factory=dict
    )
    message: str = key("the result in sentences", default="")
    evaluations: int = key("number of placements that were screened", default=0, minimum=0)
    interrupted: bool = key(
        "whether the search was interrupted; the result then has what was found before", default=False
    )

    @property
    @reported()
    def ok(self) -> bool:
        """Whether a placement was found at which every pick is good."""
        return bool(self.candidates) and self.candidates[0].ok

    @property
    @reported()
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
        heads = ("axis", "all picks good below to", "fails first", "all picks good above to", "fails first")
        failing = [f"{name}: {reason}" for name, reason in self.failing.items()]
        if len(failing) > MOST_FAILING:
            failing[MOST_FAILING:] = [f"and {len(failing) - MOST_FAILING} more picks"]
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
        judged = [candidate.placement for candidate in self.candidates]
        return heat_map_picture(self._whole_map(), self.region, judged, best=self.ok)

    def _whole_map(self) -> PlacementMap:
        if self.map is None:
            raise InputError("the search was interrupted before the heat map was complete")
        return self.map


def _length(axis: str, value: float) -> str:
    return f"{np.degrees(value):.2f} deg" if axis == "yaw" else f"{value * 1e3:.1f} mm"
