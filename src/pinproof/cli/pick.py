"""``pinproof pick`` and ``demo``: check the picks of a file.

By default every pick is checked completely and a report is printed. ``--campaign`` streams the results of many picks to
a folder and can be interrupted and resumed. ``--screen`` checks only the grasp configuration of each pick, which is
much faster.
"""

from __future__ import annotations

import time
from dataclasses import MISSING, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import pinproof as pp
from pinproof.cli.cell_options import CellOptions, ExportOptions, WorkerOptions, has_folder, run_campaign
from pinproof.cli.console import (
    Interrupted,
    check_output_files,
    print_error,
    print_json,
    print_line,
    print_note,
    print_report,
    print_result,
    progress_bar,
    progress_status,
    until_interrupted,
    written,
)
from pinproof.cli.options import Json, Live, Seed, argument, option
from pinproof.errors import InputError, RunInterrupted

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class OutputOptions(ExportOptions):
    """Options for the files of the results."""

    output: Path | None = option(
        "A report (.json, .md, .csv, .html), or a folder for all reports, one page, and the motion and the "
        "program of each good pick.",
        None,
        "-o",
        "--output",
        metavar="FILE|FOLDER",
    )
    pages: bool = option("Also write a page for each motion to the folder of -o; these are large.", False)
    live: Live = None
    grip_dwell: float = option("Seconds that the arm rests in programs while the gripper closes.", 0.0, min=0.0)
    release_dwell: float = option("Seconds that the arm rests in programs while the gripper opens.", 0.0, min=0.0)

    gripper_output: str | None = option(
        "For --export: the digital output that closes the gripper. Default: that of the picks file, or else 1; 0 for "
        "urscript, do_gripper for rapid.",
        None,
        metavar="OUTPUT",
    )

    @property
    def for_folder(self) -> bool:
        """Whether an option is used that only applies to a folder."""
        stated = self.export or self.gripper_output or self.export_deviation is not None
        return bool(self.pages or self.grip_dwell or self.release_dwell or stated)

    def export_programs(self, report: pp.picks.PickReport) -> pp.picks.PickReport:
        """Write the programs of ``--export`` to the folder; the report with them."""
        if self.export is None or self.output is None or report.setup is None:
            return report
        self.output.mkdir(parents=True, exist_ok=True)
        report, notes = report.export_programs(
            self.output,
            self.export,
            output=self.gripper_output,
            deviation=self.export_deviation,
            grip_dwell=self.grip_dwell,
            release_dwell=self.release_dwell,
        )
        for note in notes:
            print_note(f"note: {note}")
        return report

    def write(self, report: pp.picks.PickReport, *, is_folder: bool) -> str:
        """Write the report and, to a folder, the motions of the good picks; the text names the files, if any."""
        output = self.output
        if output is None or not is_folder:
            if output is not None:
                report.save(output, live=self.live)
            return str(output or "")
        stems = report.save_folder(
            output,
            pages=self.pages,
            grip_dwell=self.grip_dwell,
            release_dwell=self.release_dwell,
            live=self.live,
        )
        names = ", ".join(str(output / f"report{kind}") for kind in pp.picks.REPORT_SUFFIXES)
        if not stems:
            return names
        more = f"{stems[0]}.json and {stems[0]}.program.json" + (", and a page of each motion" if self.pages else "")
        picks = "the good pick" if len(stems) == 1 else f"each of the {len(stems)} good picks"
        text = f"{names}; for {picks} its motion and program, such as {more}"
        count = len(report.exported)
        programs = "1 program" if count == 1 else f"{count} programs"
        return text if self.export is None else f"{text}; {programs} in {self.export}"


def pick(
    file: Path = argument("The picks file (.yaml or a .csv table).", MISSING, metavar="PICKS"),
    *,
    out: OutputOptions,
    program: Path | None = option(
        "Instead of checking picks, certify this program (.program.json, or a robot program of --export) again in the "
        "cell of the picks file.",
        None,
    ),
    campaign: Path | None = option(
        "For many picks: write the results to this folder one by one; an interrupted run is resumed.",
        None,
        metavar="FOLDER",
    ),
    screen: bool = option("Check only the grasp: reach, limits and collisions; -o writes a table (.csv).", False),
    optimise: int | None = option(
        "How many changes of each transit and each transfer are tried to reduce its duration. With 0, the "
        "planned paths are followed. Default: the key optimise of the picks file, otherwise 100.",
        None,
        min=0,
    ),
    profile: bool = option("Also print the time of each stage, and of each body in the proofs beside it.", False),
    pool: WorkerOptions,
    seed: Seed = 0,
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Check every pick of a file: reach, limits, grasp, grip, approach, retreat, transit, motion.

    Exit code 0 if all picks are good, and each program of --export is proven; 1 otherwise.

    Example: pinproof pick robots/ur5/picks.yaml -o report.json
    """
    path = out.output
    in_folder = has_folder(path, pp.picks.REPORT_SUFFIXES)
    if out.for_folder and (not in_folder or screen or campaign is not None):
        raise InputError(
            "--pages, --export and its options, --grip-dwell and --release-dwell belong to -o with a folder; "
            "add -o FOLDER"
        )
    if optimise is not None and (program is not None or screen or campaign is not None):
        raise InputError(
            "--optimise cannot be combined with --program, --screen or --campaign; remove it, or state optimise in "
            "the picks file"
        )
    if profile and (program is not None or screen or campaign is not None or pool.stated):
        raise InputError(
            "--profile cannot be combined with --program, --screen, --campaign, --workers or --dask; remove them"
        )
    # Other work than judging picks completely.
    if program is not None:
        if screen or campaign is not None or path is not None or pool.stated:
            raise InputError("--program checks no pick; remove --screen, --campaign, -o, --workers and --dask")
        arm, world, source = cell.open(file)
        picks = source.load()
        setup = pp.picks.PickSetup.make(arm, world, picks, home=None, rng=0)
        with progress_status(f"certifying {program}"):
            found = pp.picks.recertify_program(setup, picks.picks, program)
        print_result(found.to_dict(), [found.to_text()], as_json=as_json, ok=found.ok)
        return
    if screen:
        if campaign is not None or pool.stated:
            raise InputError("--screen cannot be combined with --campaign, --workers or --dask; remove them")
        _screen(file, cell, path, seed, as_json=as_json)
        return
    if campaign is not None:
        if path is not None and path.suffix.lower() != ".html":
            raise InputError(f"{path}: with --campaign, -o writes a page and must end in .html")
        check_output_files([path])
        arm, world, source = cell.open(file)
        run_campaign(pp.Campaign(arm, world, source, rng=seed), campaign, pool, path, live=out.live, as_json=as_json)
        return
    # Every pick is judged in all stages, unless the language has no programs of the arm.
    if out.export is not None:
        arm, _, source = cell.open(file)
        pp.picks.check_export(arm, source.load(), out.export)
    is_folder = out.check_outputs(pp.picks.REPORT_SUFFIXES, [], "--gripper-output", out.gripper_output)
    budget = None if optimise is None else pp.picks.PickBudget(motion=optimise)
    try:
        with progress_bar(f"checking {file}") as show, pool.settings() as settings:
            settings |= {"progress": partial(show, "picks"), "budget": budget}
            judge = partial(judge_file, file, cell, seed, **settings)
            profiled = pp.picks.profile_picks(judge) if profile else None
            report = profiled.report if profiled is not None else judge()
    except RunInterrupted as error:  # the picks that were judged before are reported
        report = error.result
        if not report.verdicts:
            raise Interrupted(f"{error}; there is no result") from None
    # The answer, with the programs that are written, then the files, whose names are part of it
    report = out.export_programs(report)
    if as_json:
        print_json(report.to_dict() if profiled is None else {**report.to_dict(), "profile": profiled.to_dict()})
    else:
        print_report(report)
        if profiled is not None:
            print_line(f"\n{profiled.to_text()}")
    files = out.write(report, is_folder=is_folder)
    complete = out.export is None or len(report.exported) == len(report.good)
    if files and not as_json:
        print_line(f"wrote {files}")
    # An interrupted run is neither a success nor a failure of the picks
    if report.not_judged:
        count, total = len(report.verdicts), len(report.verdicts) + report.not_judged
        kept = "" if path is None else f"; {path} has these {count:,}"
        remedy = "the same command checks all picks again; add --campaign FOLDER for a run that can be resumed"
        raise Interrupted(f"interrupted after {count:,} of {total:,} picks{kept}; {remedy}", result_printed=True)
    if not report.ok or not complete:
        raise typer.Exit(1)


def judge_file(file: Path, cell: CellOptions | None = None, seed: int = 0, **settings: Any) -> pp.picks.PickReport:
    """Check the picks of a file; ``cell`` overrides it; ``settings`` are passed to :func:`pinproof.validate_picks`."""
    arm, world, source = (cell or CellOptions()).open(file)
    return pp.validate_picks(arm, world, source.load(), rng=seed, **settings)


def _screen(file: Path, cell: CellOptions, output: Path | None, seed: int, *, as_json: bool) -> None:
    """Check the grasps of a picks file, print the number of picks of each status; exit code 1 unless all are free."""
    arm, world, source = cell.open(file)
    if output is not None:
        if output.suffix.lower() != ".csv":
            raise InputError(f"{output}: with --screen, -o writes a table and must end in .csv")
        check_output_files([output], [file, *cell.files])
    # The clearance is only computed if a table shows it
    start = time.perf_counter()
    with progress_bar("screening") as show:
        progress = partial(show, "picks")
        found = pp.screen_picks(arm, world, source, rng=seed, clearance=output is not None, progress=progress)
    seconds = time.perf_counter() - start
    ok = bool(found.free.all())
    if output is not None:
        found.save(output)
    counts = {status.value: count for status, count in found.counts.items()}
    rate = f"{seconds:.3g} s, {len(found) / max(seconds, 1e-9):,.0f} picks per second"
    lines = [found.summary, f"{rate}; approach, retreat and transit are not checked", *written(output)]
    data = {"ok": ok, "picks": len(found), "complete": found.complete, "counts": counts}
    print_result(data, lines, as_json=as_json, ok=ok)


def demo(
    html: Path = option("The HTML page to write.", Path("pick.html")),
    output: Path = option(
        "The motion file to write: .json with the structure of trajectory_msgs/JointTrajectory, or .csv.",
        Path("pick.json"),
        "-o",
        "--output",
    ),
    live: bool = option("Also open the motion in a browser; Ctrl-C ends it.", False),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Check seven bolt picks of a UR5, then write the first good motion and an HTML page that shows it.

    Example: pinproof demo --html pick.html
    """
    from pinproof.description import robots_folder

    check_output_files([html, output])
    with progress_status("checking the picks of robots/ur5/picks.yaml"):
        report = judge_file(robots_folder() / "ur5" / "picks.yaml", seed=seed)
    if not as_json:
        print_report(report)
    if not report.good:
        if as_json:
            print_json({**report.to_dict(), "written": []})
        print_error("no pick is good, so no motion is written")
        raise typer.Exit(1)
    if report.setup is None:
        raise InputError("the report has no set-up")
    # The first good pick is written and shown
    first, arm = report.good[0], report.setup.checker.arm
    with progress_status("writing the page"):
        first.save_motion(output)
        files = [*pp.picks.write_motion_pages(first, arm, html), output]
    if as_json:
        print_json({**report.to_dict(), "written": [str(path) for path in files]})
    else:
        for motion in first.motions:
            print_line(f"{first.pick.name}: {motion.certificate}")
        print_line(f"{written(*files)[0]}; open {html} in a browser (no network needed)")
    if live:
        shown = first.motions[0]
        what: dict[str, Any] = {"certificate": shown.certificate, "attached": shown.attached, "title": first.pick.name}
        seen = arm.with_held(shown.held), shown.scene, shown.trajectory
        with pp.show(*seen, **what, open_browser=True) as view, until_interrupted():
            (print_note if as_json else print_line)(f"live view at {view.url} (Ctrl-C ends it)")
            view.wait()
