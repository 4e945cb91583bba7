"""``pinproof cell place``, ``compare`` and ``tolerance``: the placement of the base, and what changes of a cell do."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import pinproof as pp
from pinproof.cli.console import (
    Interrupted,
    check_output_files,
    check_report_output,
    print_result,
    progress_bar,
    progress_status,
    written,
)
from pinproof.cli.options import Json, Seed, argument, numbers, option
from pinproof.cli.pick import CellOptions, WorkerOptions, judge_file
from pinproof.errors import RunInterrupted
from pinproof.units import refuse_degrees, warn_of_millimetres

if TYPE_CHECKING:
    from pinproof.cell import (
        CellComparison,
        PlacementBudget,
        PlacementChoice,
        PlacementRegion,
        ToleranceStudy,
    )

SUFFIXES = (".json", ".csv", ".png", ".md")


@dataclass(frozen=True)
class SearchOptions:
    """What is searched."""

    region: str = option(
        'Placements of the base in metres and radians: "x0 x1 y0 y1", and optionally "z0 z1" and the range of '
        'the rotation about z, as in "-1 1 -1 1 0 0 -pi pi".',
        MISSING,
        metavar="RANGES",
    )
    forbidden: Path | None = option(
        "A scene file (YAML) with zones that the base, and what moves with it, must not touch.", None
    )
    moves_with_base: list[str] | None = option(
        "An obstacle that moves with the base, such as its pedestal; can be given several times.",
        None,
        metavar="OBSTACLE",
    )
    mounting: list[str] | None = option(
        "How the base is mounted; if given several times, the mountings are compared. Default: floor.",
        None,
        metavar="floor|wall|ceiling",
    )
    or_robot: list[str] | None = option(
        "Another robot to compare, with its default tcp; can be given several times.", None, metavar="ROBOT"
    )
    objective: str = option(
        "What is optimised among the placements at which all picks work: cycle_time, clearance or manipulability.",
        "cycle_time",
        metavar="OBJECTIVE",
    )

    def found_region(self) -> PlacementRegion:
        """The region with its forbidden zones."""
        ends = numbers(self.region, "--region", "x0 x1 y0 y1", "x0 x1 y0 y1 z0 z1", "x0 x1 y0 y1 z0 z1 yaw0 yaw1")
        warn_of_millimetres("--region", ends[:6])
        refuse_degrees("--region", ends[6:])
        ends += [0.0] * (8 - len(ends))
        x, y, z, yaw = ((ends[k], ends[k + 1]) for k in range(0, 8, 2))
        zones = () if self.forbidden is None else pp.Scene.load(self.forbidden).obstacles
        return pp.cell.PlacementRegion(x, y, z, yaw, zones)

    def choices(self, arm: pp.Arm) -> list[PlacementChoice]:
        """The discrete alternatives; empty if there is only one."""
        robots: list[tuple[str, pp.Arm | None]] = [(arm.robot.name, None)]
        robots += [(name, pp.load_robot(name).arm()) for name in self.or_robot or ()]
        mountings = self.mounting or ["floor"]
        if len(robots) == 1 and mountings == ["floor"]:
            return []
        return [
            pp.cell.PlacementChoice(", ".join(filter(None, (name, mounting))), arm=other, mounting=mounting)
            for name, other in robots
            for mounting in mountings
        ]


@dataclass(frozen=True)
class EffortOptions:
    """The effort of the search."""

    PANEL: ClassVar = "Effort of the search"

    grid: int = option("Number of placements of the grid that is searched first.", 2000, min=1)
    runs: int = option("Number of the best placements that are then refined.", 4, min=0)
    evaluations: int = option("Number of placements that each refinement tries.", 160, min=0)
    certified: int = option("Number of the best placements at which all picks are checked completely.", 3, min=1)
    deviations: int = option(
        "Number of deviations from the best placement, in both directions along each axis, at which all picks are "
        "checked completely.",
        4,
        min=0,
    )

    def budget(self) -> PlacementBudget:
        """The options as a budget."""
        numbers_of = {name: getattr(self, name) for name in ("grid", "runs", "evaluations", "certified", "deviations")}
        return pp.cell.PlacementBudget(**numbers_of)


def cell_place(
    file: Path = argument("The picks file (.yaml or a .csv table).", MISSING, metavar="PICKS"),
    *,
    search: SearchOptions,
    effort: EffortOptions,
    output: Path | None = option(
        "The result (.json, .md), its heat map (.csv, .png), or a folder for all of them and the report on "
        "the picks at the best placement.",
        None,
        "-o",
        "--output",
        metavar="FILE|FOLDER",
    ),
    campaign: Path | None = option(
        "Keep the work in this folder; an interrupted search is resumed.", None, metavar="FOLDER"
    ),
    pool: WorkerOptions,
    seed: Seed = 0,
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Search for the placement of the robot's base at which all picks work, with the shortest cycle time.

    Exit code 1 if no placement is found at which every pick is good.

    Example: pinproof cell place robots/ur5/plate_picks.yaml --region "-0.3 0.1 -0.3 0.3" --grid 200 -o place.json
    """
    is_folder = output is not None and check_report_output(output, SUFFIXES)
    region = search.found_region()
    arm, scene, source = cell.open(file)
    try:
        with progress_bar(f"placing {arm.robot.name}") as progress, pool.settings() as settings:
            found = pp.place_base(
                arm,
                scene,
                source.load(),
                region,
                moves_with_base=search.moves_with_base or (),
                choices=search.choices(arm),
                objective=search.objective,
                rng=seed,
                placement_budget=effort.budget(),
                folder=campaign,
                progress=progress,
                **settings,
            )
    except RunInterrupted as error:
        found = error.result
        if found.map is None:
            kept = "" if campaign is None else f"; the same command resumes the search from {campaign}"
            raise Interrupted(f"{error}{kept}") from None
    # The result, its map if there is one, and the report on the picks at the best placement.
    files = [] if output is None else [output]
    if output is not None and is_folder:
        files = [output / f"placement{kind}" for kind in (SUFFIXES if found.map is not None else (".json", ".md"))]
    for path in files:
        found.save(path)
    if output is not None and is_folder and found.least_failing is not None:
        reports = [output / f"report{kind}" for kind in pp.picks.REPORT_SUFFIXES]
        for path in reports:
            found.least_failing.report.save(path)
        files += reports
    lines = [found.to_markdown().rstrip(), *written(*files)]
    print_result(found.to_dict(), lines, as_json=as_json, ok=found.ok or found.interrupted)
    if found.interrupted:
        kept = "add --campaign FOLDER to resume" if campaign is None else "the same command resumes the search"
        raise Interrupted(f"interrupted; {kept}", result_printed=True)


TABLES = (".json", ".csv", ".md")


def cell_compare(
    file: Path = argument("The picks file of the first set-up.", MISSING, metavar="PICKS"),
    against: Path | None = argument(
        "The picks file of the second set-up. Default: the same file.", None, metavar="OTHER"
    ),
    *,
    least: float = option("The smallest difference of durations (s) that is reported.", 0.01, min=0.0),
    output: Path | None = option("The comparison (.json, .csv, .md).", None, "-o", "--output"),
    pool: WorkerOptions,
    seed: Seed = 0,
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Compare two set-ups pick by pick: won, lost, faster, slower.

    The options for robot and scene apply to the second one.

    Exit code 1 if a pick is lost.

    Example: pinproof cell compare robots/ur5/picks.yaml --place "-0.05 -0.05 0"
    """
    check_output_files([output], [file, against], TABLES)
    with pool.settings() as settings:
        reports = []
        for number, (path, options) in enumerate(((file, CellOptions()), (against or file, cell)), start=1):
            with progress_status(f"set-up {number} of 2: {path}"):
                reports.append(judge_file(path, options, seed, **settings))
    found = pp.cell.compare(*reports, least=least)
    _finish(found, output, as_json)


def cell_tolerance(
    file: Path = argument("The picks file (.yaml or a .csv table).", MISSING, metavar="PICKS"),
    *,
    position: float = option("Largest error of the position of a part along each axis (m).", 0.003, min=0.0),
    rotation: str = option("Largest error of its rotation about any axis (rad).", "pi/90", metavar="ANGLE"),
    normal: bool = option("Sample a normal distribution with half of the errors as standard deviation.", False),
    samples: int = option("Number of sampled poses for each pick.", 20, min=0),
    output: Path | None = option("The study (.json, .csv, .md).", None, "-o", "--output"),
    pool: WorkerOptions,
    seed: Seed = 0,
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Prove how inaccurate the pose of each part may be, with unchanged motions and if the grasp is planned again.

    Exit code 1 unless the motions of all picks are certified for the whole tolerance.

    Example: pinproof cell tolerance robots/ur5/plate_picks.yaml --position 0.002 --samples 5
    """
    check_output_files([output], [file], TABLES)
    angles = numbers(rotation, "--rotation", "angle")
    refuse_degrees("--rotation", angles)
    with progress_bar(f"checking {file}") as progress, pool.settings() as settings:
        report = judge_file(file, cell, seed, **settings)
        found = pp.cell.tolerance_study(
            report,
            position=position,
            rotation=angles[0],
            distribution="normal" if normal else "uniform",
            samples=samples,
            rng=seed,
            progress=progress,
            **settings,
        )
    _finish(found, output, as_json)


def _finish(found: CellComparison | ToleranceStudy, output: Path | None, as_json: bool) -> None:
    """Write and print a result; exit code 1 if it is not good."""
    if output is not None:
        found.save(output)
    print_result(found.to_dict(), [found.to_markdown().rstrip()], as_json=as_json, ok=found.ok)
