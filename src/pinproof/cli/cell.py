"""``pinproof cell``: where the robot is placed, the order of its picks, its cycle time, and what changes of it do."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import pinproof as pp
from pinproof.cli.cell_options import CellOptions, WorkerOptions, states_paths
from pinproof.cli.console import (
    Interrupted,
    check_output_files,
    check_report_output,
    print_note,
    print_result,
    progress_bar,
    progress_status,
    written,
)
from pinproof.cli.options import Json, Live, Seed, argument, numbers, option, placement
from pinproof.cli.pick import judge_file
from pinproof.errors import InputError, RunInterrupted, UnknownNameError
from pinproof.units import refuse_degrees, warn_of_millimetres

if TYPE_CHECKING:
    from pinproof.cell import CellComparison, PlacementChoice, PlacementRegion, ToleranceStudy

WORK = {"options": "grasps and lines", "motions": "certified motions", "shorten": "shorter motions"}
"""The parts of the search for a sequence, as the progress bar names them."""


@dataclass(frozen=True)
class SelectionOptions:
    """Which picks of the file are put in sequence."""

    only: str | None = option(
        'The names of the picks to use, with commas between them: "a,b,c".', None, metavar="NAMES"
    )
    without: str | None = option("The names of picks to leave out, with commas.", None, metavar="NAMES")

    def select(self, picks: pp.Picks) -> tuple[pp.Pick, ...]:
        """The selected picks in the order of the file."""
        known = [pick.name for pick in picks.picks]
        stated = {"--only": _names(self.only), "--without": _names(self.without)}
        for stated_by, names in stated.items():
            for name in names:
                if name not in known:
                    raise UnknownNameError("pick", name, known, stated_by)
        chosen = stated["--only"] if self.only is not None else known
        return tuple(pick for pick in picks.picks if pick.name in chosen and pick.name not in stated["--without"])


@dataclass(frozen=True)
class ConditionOptions:
    """The precedence of picks and the dwell times."""

    before: list[str] | None = option(
        'A pair of picks in a fixed order: "first,second"; can be given several times.', None, metavar="FIRST,SECOND"
    )
    grip_dwell: float = option("Seconds that an arm rests at each grasp.", 0.0, min=0.0)
    release_dwell: float = option("Seconds that an arm rests at each release.", 0.0, min=0.0)

    def settings(self) -> dict[str, Any]:
        """The options as settings of :func:`pinproof.sequence` and :func:`pinproof.cell.allocate`."""
        pairs = []
        for text in self.before or ():
            names = _names(text)
            if len(names) != 2:
                raise InputError(f'--before {text!r} names {len(names)} picks; state two: --before "first,second"')
            pairs.append((names[0], names[1]))
        return {"precedence": pairs, "grip_dwell": self.grip_dwell, "release_dwell": self.release_dwell}


@dataclass(frozen=True)
class OrderOptions:
    """How the order is searched."""

    free_start: bool = option("Start at the first approach instead of home.", False)
    free_end: bool = option("End after the last pick instead of at home.", False)
    file_order: bool = option("Keep the order of the file, and choose only grasps and IK branches.", False)
    options: int = option("Number of grasps and IK branches that are considered for each pick.", 4, min=1)
    windings: list[str] | None = option(
        'A budget of rotation of a joint, relative to home: "wrist_3_joint=400 deg"; can be given several times. '
        "Replaces those of the file.",
        None,
        metavar="JOINT=ANGLE",
    )

    def budgets(self) -> dict[str, Any] | None:
        """The budgets of rotation as texts, by joint; None if none is given."""
        pairs = [text.partition("=") for text in self.windings or ()]
        if wrong := next((name for name, equals, _ in pairs if not equals), None):
            raise InputError(f'--windings {wrong!r}: state a joint and an angle, such as "wrist_3_joint=400 deg"')
        budgets = {name.strip(): angle.strip() for name, _, angle in pairs}
        if len(budgets) < len(pairs):
            raise InputError(f"--windings states a joint twice: {', '.join(self.windings or ())}; state it once")
        return budgets or None


def cell_sequence(
    file: Path = argument("The picks file (.yaml or a .csv table).", MISSING, metavar="PICKS"),
    *,
    selection: SelectionOptions,
    conditions: ConditionOptions,
    ordering: OrderOptions,
    output: list[Path] | None = option(
        "The sequence as .json, .md, .csv or .html, or a folder for the programs of --export; can be given several "
        "times.",
        None,
        "-o",
        "--output",
        metavar="FILE|FOLDER",
    ),
    export: str | None = option(
        "Also write a robot program of each step to the folder of -o: urscript, rapid, krl or fanuc.",
        None,
        metavar="LANGUAGE",
    ),
    heat_map: Path | None = option(
        "Draw the heat map of a placement search (.csv with x, y, share) on the floor of the page.", None
    ),
    live: Live = None,
    seed: Seed = 0,
    workers: int | None = option("Number of parallel processes.", None, min=1),
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Order the picks of a file so that the certified motions take the shortest total time.

    Exit code 1 if a pick cannot be executed, which is then left out, or a program of --export is not proven.

    Example: pinproof cell sequence robots/ur5/picks.yaml --only bolt_1,bolt_2,bolt_5
    """
    folders = [path for path in output or () if export is not None and (path.is_dir() or not path.suffix)]
    outputs = [path for path in output or () if path not in folders]
    if export is not None and len(folders) != 1:
        raise InputError("--export writes programs to a folder; add one -o FOLDER")
    check_output_files(outputs, [file, heat_map, *cell.files], pp.cell.SequenceResult.formats)
    if heat_map is not None and not any(path.suffix.lower() == ".html" for path in outputs):
        raise InputError("--heat-map belongs to a page; add -o FILE.html")
    # Inputs that are read before the search, because it takes minutes.
    heat = None if heat_map is None else pp.cell.read_heat_map(heat_map, placement(cell.place).inverse())
    arm, scene, source = cell.open(file)
    picks = source.load()
    _refuse_problems(file, picks)
    setup = pp.picks.PickSetup.make(arm, scene, picks, home=None, rng=seed)
    chosen = selection.select(picks)
    if export is not None:
        pp.picks.check_export(arm, picks, export)
        if len(picks.tools) > 1 and isinstance(picks.tool_change, float):
            raise InputError("a robot program does not change the tool; remove --export, or use the picks of one tool")
    interrupted: RunInterrupted | None = None
    try:
        with progress_bar("sequence") as show:
            result = pp.sequence(
                setup,
                chosen,
                **conditions.settings(),
                start="free" if ordering.free_start else "home",
                end="free" if ordering.free_end else "home",
                budget=pp.cell.SequenceBudget(options=ordering.options),
                order=[pick.name for pick in chosen] if ordering.file_order else None,
                windings=ordering.budgets(),
                workers=workers,
                progress=lambda work, done, total: show(WORK.get(work, work), done, total),
            )
    except RunInterrupted as error:
        if error.result is None or not error.result.steps:
            raise Interrupted from None
        result, interrupted = error.result, error
    if export is not None:
        folders[0].mkdir(parents=True, exist_ok=True)
        with progress_status(f"programs in {export}"):
            result, notes = result.export_programs(folders[0], export)
        for note in notes:
            print_note(f"note: {note}")
    # Files, then the answer: of an interrupted search, the best sequence so far.
    for path in outputs:
        result.save(path, heat_map=heat, live=live)
    from pinproof.model import guess_note  # loads the kinematics

    if guess := guess_note(setup.checker.arm.limits.acceleration_source):
        print_note(guess)
    ok = (result.ok and (export is None or len(result.exported) == len(result.steps))) or interrupted is not None
    print_result(result.to_dict(), [result.to_text(), *written(*folders, *outputs)], as_json=as_json, ok=ok)
    if interrupted is not None:
        raise Interrupted(str(interrupted), result_printed=True)


def _refuse_problems(file: Path, picks: pp.Picks) -> None:
    """Raise InputError if a row of a picks file is unreadable."""
    if picks.problems:
        first = picks.problems[0]
        raise InputError(f"{file}: {first.name or f'row {first.row}'}: {first.reason}")


def _names(text: str | None) -> list[str]:
    return [] if text is None else [name.strip() for name in text.split(",") if name.strip()]


def cell_allocate(
    file: Path = argument("A picks file for several robots (key robots).", MISSING, metavar="PICKS"),
    *,
    selection: SelectionOptions,
    conditions: ConditionOptions,
    compare: bool = option("Also compute the time that each arm alone takes for all picks.", True),
    output: list[Path] | None = option(
        "A .json, .md or .html file; can be given several times.", None, "-o", "--output", metavar="FILE"
    ),
    live: Live = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Allocate the picks of a file to several arms that move at the same time, and certify all motions.

    Exit code 1 if a pick cannot be executed, or not everything is certified.

    Example: pinproof cell allocate robots/two_ur5/picks.yaml --only part_3_2,part_4_2
    """
    outputs = output or []
    picks = pp.read_picks(file)
    check_output_files(outputs, [file, picks.scene], pp.cell.AllocationResult.formats)
    _refuse_problems(file, picks)
    group = picks.load_cell()
    scene = picks.load_scene()
    chosen = selection.select(picks)
    with progress_bar("allocation") as progress:
        result = pp.cell.allocate(
            group,
            scene,
            replace(picks, picks=chosen),
            **conditions.settings(),
            compare=compare,
            rng=seed,
            progress=progress,
        )
    for path in outputs:
        result.save(path, live=live)
    print_result(result.to_dict(), [result.to_text(), *written(*outputs)], as_json=as_json, ok=result.ok)


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
        # z and yaw are fixed at 0 unless they are stated
        ends = numbers(self.region, "--region", "x0 x1 y0 y1", "x0 x1 y0 y1 z0 z1", "x0 x1 y0 y1 z0 z1 yaw0 yaw1")
        warn_of_millimetres("--region", ends[:6])
        refuse_degrees("--region", ends[6:])
        ends += [0.0] * (8 - len(ends))
        x, y, z, yaw = ((ends[k], ends[k + 1]) for k in range(0, 8, 2))
        zones = () if self.forbidden is None else pp.Scene.load(self.forbidden).obstacles
        return pp.cell.PlacementRegion(x, y, z, yaw, zones)

    def choices(self, arm: pp.Arm) -> list[PlacementChoice]:
        """The discrete alternatives; empty if there is only one."""
        # Every robot with every mounting
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


def cell_place(
    file: Path = argument("The picks file (.yaml or a .csv table), or a job of tool paths.", MISSING, metavar="FILE"),
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
    live: Live = None,
    pool: WorkerOptions,
    seed: Seed = 0,
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Search for the placement of the robot's base at which all picks work, with the shortest cycle time.

    For a job of tool paths, the whole job is followed at the best placements.

    Exit code 1 if no placement is found at which every pick is good, or the job is followed.

    Example: pinproof cell place robots/ur5/plate_picks.yaml --region "-0.3 0.1 -0.3 0.3" --grid 200 -o place.json
    """
    # A wrong name of an output or region costs no search.
    is_folder = output is not None and check_report_output(output, pp.cell.PlacementResult.formats)
    region = search.found_region()
    if states_paths(file):
        arm, scene, job = cell.open_job(file)
        place = partial(pp.tool_paths.place_job, job, region, arm=arm, scene=scene)
    else:
        arm, scene, source = cell.open(file)
        place = partial(pp.place_base, arm, scene, source.load(), region)
    try:
        with progress_bar(f"placing {arm.robot.name}") as progress, pool.settings() as settings:
            found = place(
                moves_with_base=search.moves_with_base or (),
                choices=search.choices(arm),
                objective=search.objective,
                rng=seed,
                placement_budget=pp.cell.PlacementBudget(**vars(effort)),
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
        files = [output / f"placement{kind}" for kind in (found.formats if found.map is not None else (".json", ".md"))]
    for path in files:
        found.save(path)
    if output is not None and is_folder and found.least_failing is not None:
        reports = [output / f"report{kind}" for kind in pp.picks.REPORT_SUFFIXES]
        for path in reports:
            found.least_failing.report.save(path, **({} if states_paths(file) else {"live": live}))
        files += reports
    lines = [found.to_markdown().rstrip(), *written(*files)]
    print_result(found.to_dict(), lines, as_json=as_json, ok=found.ok or found.interrupted)
    if found.interrupted:
        kept = "add --campaign FOLDER to resume" if campaign is None else "the same command resumes the search"
        raise Interrupted(f"interrupted; {kept}", result_printed=True)


def cell_compare(
    file: Path = argument("The picks file of the first set-up.", MISSING, metavar="PICKS"),
    against: Path | None = argument(
        "The picks file of the second set-up. Default: the same file.", None, metavar="OTHER"
    ),
    *,
    least: float = option("The smallest difference of durations (s) that is reported.", 0.01, min=0.0),
    output: Path | None = option(
        "The comparison (.json, .csv, .md), or both set-ups side by side (.html).", None, "-o", "--output"
    ),
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
    check_output_files([output], [file, against], pp.cell.CellComparison.formats)
    # The options replace what the second file states
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
    check_output_files([output], [file], pp.cell.ToleranceStudy.formats)
    angles = numbers(rotation, "--rotation", "angle")
    refuse_degrees("--rotation", angles)
    # The picks are judged once; the study certifies their motions again for displaced parts
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
