r"""How inaccurate the poses of parts may be.

The pose of a part is uncertain: its origin may be off by up to p along each axis, and its rotation by up to an angle
:math:`\theta`. No point of the part is then farther from where it is stated than

.. math:: \sqrt{3} \, p + 2 \sin(\theta / 2) \, r

where r is the largest distance of a point of the part from its origin. Two questions are answered for each pick.

*The motions are not changed*, because the pose of the part is not measured. The motions are certified again for a part
that is displaced by this distance, in the scene and later in the hand. This is a proof for all poses within the
tolerance, and the largest tolerance for which it succeeds is found by bisection.

*The motions are planned again*, because a camera measures the pose. Poses are sampled, and the grasp is screened at
each. This is a sample, not a proof.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pinproof.collision import LineSurface, Obstacle, outer_points
from pinproof.common.files import csv_text
from pinproof.common.results import Rows, Saved, View, Written
from pinproof.common.structs import OPTIONAL_NUMBER, TEXT, key, reported, struct
from pinproof.common.validation import require_integer, require_positive
from pinproof.errors import InputError
from pinproof.picks import Pick, PickReport, PickSetup, PickTask, PickVerdict, screen_picks
from pinproof.spatial import pose
from pinproof.work import IN_FLIGHT, Progress, Runner, Workers

Distribution = Literal["uniform", "normal"]
DISTRIBUTIONS = ("uniform", "normal")

ROUNDS = 7
"""Bisections of the largest tolerance: to 1/128 of ``largest``."""

WITHIN = 2.0
"""The stated tolerance is this multiple of the standard deviation of a normal distribution: 95 % of the values."""


@struct("pick_tolerance", written=True)
class PickTolerance:
    """How inaccurate the pose of the part of one pick may be."""

    name: str = key("name of the pick", kind=TEXT)
    good: bool = key("whether the pick is good at its stated pose; the other values are 0 if it is not")
    proven: bool = key("whether the unchanged motions are certified for the whole tolerance", default=False)
    factor: float = key(
        "the largest multiple of the tolerance that is certified, up to `largest`", default=0.0, minimum=0
    )
    displacement: float = key(
        "the displacement of any point of the part that the tolerance allows", "m", default=0.0, minimum=0
    )
    limited_by: str = key("what cannot be certified beyond the factor, and why; empty if nothing", default="")
    share: float = key(
        "share of the sampled poses at which the grasp is free, if it is planned again; null without samples",
        default=0.0,
        kind=OPTIONAL_NUMBER,
    )
    largest_position: float = key("the factor times the position tolerance", "m", default=0.0, minimum=0)
    largest_rotation: float = key("the factor times the rotation tolerance", "rad", default=0.0, minimum=0)


@struct(
    "tolerance",
    first=("ok", "summary", "position", "rotation", "distribution", "samples", "largest", "proven_share",
           "sampled_share", "notes"),
    written=True,
    version="pinproof/tolerance/1",
    eq=False,
)  # fmt: skip
class ToleranceStudy(Saved, Written):
    """A study of the tolerance of picks. Readers must accept unknown keys: they are additions of the same version."""

    position: float = key("tolerance of the position along each axis", "m", minimum=0)
    rotation: float = key("tolerance of the rotation about any axis", "rad", minimum=0)
    distribution: Distribution = key("of the sampled poses")
    samples: int = key("number of sampled poses for each pick", minimum=0)
    largest: float = key("the largest multiple of the tolerance that was tried", minimum=0)
    picks: tuple[PickTolerance, ...] = key("the picks")
    notes: tuple[str, ...] = key("what is not covered")

    @reported(minimum=0, maximum=1)
    def proven_share(self) -> float:
        """Share of the picks whose unchanged motions are certified for the whole tolerance."""
        return sum(pick.proven for pick in self.picks) / max(len(self.picks), 1)

    @reported(minimum=0, maximum=1)
    def sampled_share(self) -> float:
        """Share of the picks whose grasp is free at every sampled pose, if it is planned again."""
        return sum(pick.share == 1.0 for pick in self.picks) / max(len(self.picks), 1)

    @reported()
    def ok(self) -> bool:
        """Whether every pick is certified for the whole tolerance."""
        return bool(self.picks) and all(pick.proven for pick in self.picks)

    @reported()
    def summary(self) -> str:
        """The result in one line."""
        proven = sum(pick.proven for pick in self.picks)
        sampled = sum(pick.share == 1.0 for pick in self.picks)
        return (
            f"+-{self.position * 1e3:g} mm, +-{np.degrees(self.rotation):g} deg: {proven} of {len(self.picks)} picks "
            f"certified for the whole tolerance without a change of the motion; the grasps of {sampled} are free at "
            f"all of {self.samples} sampled poses ({self.distribution}) if they are planned again"
        )

    def _view(self) -> View:
        rows = (
            (
                pick.name,
                "proven" if pick.proven else "not proven" if pick.good else "not good",
                f"{pick.largest_position * 1e3:.2f}",
                f"{np.degrees(pick.largest_rotation):.2f}",
                f"{pick.share:.0%}",
                pick.limited_by,
            )
            for pick in self.picks
        )
        notes = [f"not covered: {note}" for note in self.notes]
        lines = (f"{pick.name}: {pick.factor:.3g} of the tolerance" for pick in self.picks)
        columns = ("pick", "whole tolerance", "largest [mm]", "largest [deg]", "free if planned again", "limited by")
        return View(self.summary, [Rows(columns, rows, len(self.picks)), notes], lines, len(self.picks))

    def to_csv(self) -> str:
        """One row for each pick."""
        rows = []
        for pick in self.picks:
            figures = (pick.largest_position, pick.largest_rotation, pick.share)
            cells = (f"{value:.9g}" for value in figures)
            rows.append((pick.name, int(pick.good), int(pick.proven), *cells, pick.limited_by))
        columns = ("name", "good", "proven", "largest_position", "largest_rotation", "share", "limited_by")
        return csv_text(columns, rows)


def tolerance_study(
    report: PickReport,
    *,
    position: float = 0.003,
    rotation: float = np.radians(2.0),
    distribution: Distribution = "uniform",
    samples: int = 20,
    largest: float = 4.0,
    part_radius: float = 0.05,
    rng: int = 0,
    executor: Workers | None = None,
    workers: int | None = None,
    in_flight: int = IN_FLIGHT,
    progress: Progress | None = None,
) -> ToleranceStudy:
    """Determine how inaccurate the poses of parts may be.

    Parameters
    ----------
    report
        The verdicts on the picks, from :func:`pinproof.validate_picks` or a placement.
    position, rotation
        The tolerance: m in both directions along each axis, and rad about any axis.
    distribution
        Of the sampled poses: ``"uniform"`` within the tolerance, or ``"normal"``, for which the tolerance is two
        standard deviations.
    samples
        Number of sampled poses for each pick.
    largest
        The largest multiple of the tolerance that is tried.
    part_radius
        Metres: the largest distance of a point of the part from the grasp, for picks that state no object. Every
        obstacle is then displaced.
    rng
        The seed of the samples.
    executor, workers, in_flight
        As for :func:`pinproof.validate_picks`.
    progress
        Called with the name of the stage, the number of finished picks, and the number of all picks.

    Raises
    ------
    InputError
        If a value is invalid, or the report has no setup.
    """
    setup = report.setup
    if setup is None:
        raise InputError("the report has no setup; make it with validate_picks or place_base")
    setup.shared.refuse_conveyor("a study of tolerances")
    # the tolerance and the samples
    for name, value in (("position", position), ("rotation", rotation), ("part_radius", part_radius)):
        require_positive(name, value, zero=True)
    if rotation > np.pi / 2:
        raise InputError(f"rotation = {rotation:g} rad is more than pi/2; angles are in radians")
    if position == rotation == 0.0:
        raise InputError("position and rotation are both 0; state a tolerance")
    require_positive("largest", largest)
    if distribution not in DISTRIBUTIONS:
        raise InputError(f"distribution = {distribution!r}; use {' or '.join(DISTRIBUTIONS)}")
    require_integer("samples", samples, 0)
    require_integer("rng", rng, 0)
    study = ToleranceStudy(position, float(rotation), distribution, samples, largest, (), ())
    task = _ToleranceTask(setup, study, part_radius, rng)
    with Runner(executor=executor, workers=workers, in_flight=in_flight, progress=progress) as runner:
        rows = runner.run("tolerance", task, report.verdicts, 4)
    # what the proofs do not cover
    notes = ["whether the hand holds the displaced part"]
    if any(verdict.pick.carried is not None for verdict in report.verdicts):
        notes.append("displaced parts that do not rest on their supports")
    if any(verdict.pick.carried is None for verdict in report.verdicts):
        notes.append(
            f"picks without an object: every obstacle is displaced, as a part with a radius of {part_radius * 1e3:g} mm"
        )
    notes.append("if the grasp is planned again, only the grasp is screened, not its approach, retreat and transit")
    return replace(study, picks=tuple(rows), notes=tuple(notes))


@dataclass(frozen=True, eq=False)
class _ToleranceTask:
    setup: PickSetup
    study: ToleranceStudy
    part_radius: float
    rng: int

    def __call__(self, start: int, part: Sequence[PickVerdict]) -> list[PickTolerance]:
        return [self._row(index, verdict) for index, verdict in enumerate(part, start)]

    def _row(self, index: int, verdict: PickVerdict) -> PickTolerance:
        name = verdict.pick.name
        if not verdict.ok:
            return PickTolerance(name, good=False, limited_by=f"the pick is {verdict.status.value}")
        # the largest distance of a point of the part from its origin
        radius, carried = self.part_radius, verdict.pick.carried
        if carried is not None:
            obstacle = self.setup.checker.scene[carried] if isinstance(carried, str) else carried
            surface = LineSurface.of_obstacle(replace(obstacle, pose=None))
            radius = float(np.linalg.norm(outer_points(surface), axis=1).max())
        # the largest multiple that is certified: the whole tolerance, the largest one, or by bisection
        proven, why = self._certified(verdict, radius, 1.0)
        largest = self.study.largest
        low, high, limited = (1.0, largest, "") if proven else (0.0, 1.0, why)
        if proven and largest > 1.0:
            beyond, why = self._certified(verdict, radius, largest)
            low, limited = (largest, "") if beyond else (1.0, why)
        if limited:
            for _ in range(ROUNDS):
                middle = 0.5 * (low + high)
                free, why = self._certified(verdict, radius, middle)
                low, high, limited = (middle, high, limited) if free else (low, middle, why)
        return PickTolerance(
            name,
            good=True,
            proven=proven,
            factor=low,
            displacement=self._displacement(radius, 1.0),
            limited_by=limited,
            share=self._sampled(index, verdict.pick),
            largest_position=low * self.study.position,
            largest_rotation=low * self.study.rotation,
        )

    def _displacement(self, radius: float, factor: float) -> float:
        """The largest displacement (m) of a point of the part for a multiple of the tolerance."""
        angle = min(factor * self.study.rotation, np.pi)
        return float(np.sqrt(3.0) * factor * self.study.position + 2.0 * np.sin(angle / 2.0) * radius)

    def _certified(self, verdict: PickVerdict, radius: float, factor: float) -> tuple[bool, str]:
        """Whether the unchanged motions are certified for a multiple of the tolerance, and otherwise why not."""
        proofs = self.setup.certify_displaced(verdict, self._displacement(radius, factor))
        last = proofs[-1]
        return last.free, "" if last.free else f"{verdict.motions[len(proofs) - 1].name}: {last.message}"

    def _sampled(self, index: int, pick: Pick) -> float:
        """Share of the sampled poses at which the grasp is free."""
        setup, study, free = self.setup, self.study, 0
        if not study.samples:
            return float("nan")
        generator = np.random.default_rng([self.rng, index])
        task = PickTask(pick, setup.cell)
        pivot = task.pick.pose
        obstacle: Obstacle | None = None
        if isinstance(pick.carried, str):
            obstacle = setup.checker.scene[pick.carried]
            pivot = obstacle.pose
        uniform = study.distribution == "uniform"
        draw, low, high = (generator.uniform, -1.0, 1.0) if uniform else (generator.normal, 0.0, 1.0 / WITHIN)
        for _ in range(study.samples):
            # a displacement about the origin of the part, in its own axes
            shift = draw(low * study.position, high * study.position, 3)
            angle = draw(low * study.rotation, high * study.rotation)
            axis = generator.normal(size=3)
            axis /= np.linalg.norm(axis)
            turn = (*(np.sin(angle / 2.0) * axis), np.cos(angle / 2.0))
            moved = pivot * pose(xyz=shift.tolist(), quat_xyzw=turn) * pivot.inverse()
            scene = setup.checker.scene
            if obstacle is not None:
                scene = scene.move(obstacle.name, moved * obstacle.pose)
            shown = replace(task.pick, pose=moved * task.pick.pose, place=None)
            picks = replace(setup.shared, picks=(shown,))
            free += bool(screen_picks(setup.checker.arm, scene, picks, home=setup.home).free[0])
        return free / study.samples
