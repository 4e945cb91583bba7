"""``pinproof pick`` and ``demo``: check the picks of a file.

By default every pick is checked completely and a report is printed. ``--campaign`` streams the results of many picks to
a folder and can be interrupted and resumed. ``--screen`` checks only the grasp configuration of each pick, which is
much faster.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import typer

import pinproof as pp
from pinproof.cli.console import (
    Interrupted,
    check_output_files,
    check_report_output,
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
from pinproof.cli.options import Json, Limits, Place, RobotFileOptions, Seed, argument, option, placement
from pinproof.common.validation import optional_module
from pinproof.errors import CampaignError, InputError, RunInterrupted

if TYPE_CHECKING:
    from pinproof.picks import PickSource

CONNECT_SECONDS = 20
"""Time to wait for the Dask scheduler."""


@dataclass(frozen=True)
class CellOptions(RobotFileOptions):
    """Options that replace the robot and the scene of the picks file."""

    PANEL: ClassVar = "Robot and scene"

    robot: str | None = option(
        "A catalogue name, a robot file or a DH table. It replaces robot, srdf, package_dirs, xacro_args, "
        "calibration and limits of the picks file.",
        None,
        metavar="ROBOT",
    )
    limits: Limits = None
    tcp: str | None = option(
        "The tcp frame. Default: the tcp of the picks file, otherwise of the robot.", None, metavar="LINK"
    )
    scene: Path | None = option("The scene file (YAML). Default: the scene of the picks file.", None)
    place: Place = "0 0 0 0"

    @property
    def files(self) -> tuple[str | Path | None, ...]:
        """The input files."""
        return self.robot, self.srdf, self.calibration, self.limits, self.scene

    def open(self, file: Path) -> tuple[pp.Arm, pp.Scene, PickSource]:
        """The arm, the scene and the picks of a picks file."""
        # The picks are in the world; the arm needs them, and the scene, in the frame of its root.
        source = pp.picks.open_picks(file)
        world_from_root = placement(self.place)
        if not world_from_root.isIdentity():
            source = source.transformed(world_from_root.inverse())
        shared = self.replaced(source.shared)
        return shared.load_arm(), shared.load_scene().transformed(world_from_root.inverse()), source

    def replaced(self, shared: pp.Picks) -> pp.Picks:
        """The settings of a file with those of the command, which replace keys of the file, in their place."""
        # Errors then no longer name the lines of these keys
        if self.robot is not None:
            none: dict[str, Any] = {"srdf": None, "calibration": None, "limits": None}
            shared = replace(shared, robot=self.robot, package_dirs=(), xacro_args={}, **none)
        stated_here = {"robot": self.robot, "tcp": self.tcp, **{f"xacro_args.{name}": name for name in self.xacro_args}}
        return replace(
            shared,
            srdf=self.srdf or shared.srdf,
            package_dirs=tuple(self.package_dir or shared.package_dirs),
            xacro_args={**shared.xacro_args, **self.xacro_args},
            calibration=self.calibration or shared.calibration,
            limits=self.limits or shared.limits,
            tcp=self.tcp or shared.tcp,
            scene=self.scene or shared.scene,
            places={key: place for key, place in shared.places.items() if not stated_here.get(key)},
        )


def check_signal(name: str, export: str | None, output: str | None) -> None:
    """Refuse an output, stated by an option, that a language of robot programs does not have."""
    if output is None or export is None:
        return
    language = pp.motion.find_dialect(export)
    if not re.fullmatch(language.signals, output):
        raise InputError(f"{name} {output}: {export} has digital outputs with {language.signal_kind}")


@dataclass(frozen=True)
class OutputOptions:
    """Options for the files of the results."""

    PANEL: ClassVar = "Output"

    output: Path | None = option(
        "A report (.json, .md, .csv, .html), or a folder for all reports, one page, and the motion and the "
        "program of each good pick.",
        None,
        "-o",
        "--output",
        metavar="FILE|FOLDER",
    )
    pages: bool = option("Also write a page for each motion to the folder of -o; these are large.", False)
    grip_dwell: float = option("Seconds that the arm rests in programs while the gripper closes.", 0.0, min=0.0)
    release_dwell: float = option("Seconds that the arm rests in programs while the gripper opens.", 0.0, min=0.0)

    export: str | None = option(
        "Also write a robot program of each good pick to the folder of -o: urscript, rapid, krl or fanuc.",
        None,
        metavar="LANGUAGE",
    )
    gripper_output: str | None = option(
        "For --export: the digital output that closes the gripper. Default: that of the picks file, or else 1; 0 for "
        "urscript, do_gripper for rapid.",
        None,
        metavar="OUTPUT",
    )
    export_deviation: float | None = option(
        "For --export: assumed deviation of each joint from the moves of the program (rad). Default: 0.002.",
        None,
        min=0.0,
    )

    @property
    def for_folder(self) -> bool:
        """Whether an option is used that only applies to a folder."""
        stated = self.export or self.gripper_output or self.export_deviation is not None
        return bool(self.pages or self.grip_dwell or self.release_dwell or stated)

    def check(self) -> bool:
        """Refuse an output that cannot be written, before the picks are checked; return whether it is a folder."""
        if self.gripper_output is not None and self.export is None:
            raise InputError("--gripper-output needs --export")
        check_signal("--gripper-output", self.export, self.gripper_output)
        if self.export_deviation is not None and self.export is None:
            raise InputError("--export-deviation needs --export")
        return self.output is not None and check_report_output(self.output, pp.picks.REPORT_SUFFIXES)

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
                report.save(output)
            return str(output or "")
        stems = report.save_folder(
            output, pages=self.pages, grip_dwell=self.grip_dwell, release_dwell=self.release_dwell
        )
        names = ", ".join(str(output / f"report{kind}") for kind in pp.picks.REPORT_SUFFIXES)
        if not stems:
            return names
        more = f"{stems[0]}.json and {stems[0]}.program.json" + (", and a page of each motion" if self.pages else "")
        picks = "the good pick" if len(stems) == 1 else f"each of the {len(stems)} good picks"
        text = f"{names}; for {picks} its motion and program, such as {more}"
        return text if self.export is None else f"{text}; {len(report.exported)} programs in {self.export}"


@dataclass(frozen=True)
class WorkerOptions:
    """Options for the processes that check picks."""

    PANEL: ClassVar = "Parallel work"

    workers: int | None = option("Number of parallel processes.", None, min=1)
    dask: str | None = option("Use the Dask cluster of this scheduler.", None, metavar="tcp://HOST:PORT")

    @property
    def stated(self) -> bool:
        """Whether an option is used."""
        return self.workers is not None or self.dask is not None

    @contextmanager
    def settings(self) -> Iterator[dict[str, Any]]:
        """The options as settings of :class:`pinproof.Campaign` and :func:`pinproof.validate_picks`.

        InputError if both options are given, or Dask is not installed; CampaignError if the scheduler does not answer.
        """
        # Local processes, or the threads of a cluster
        if self.dask is None:
            yield {} if self.workers is None else {"workers": self.workers}
            return
        if self.workers is not None:
            raise InputError("--workers and --dask cannot be combined; remove one of them")
        distributed = optional_module("distributed", "--dask", "dask")
        try:
            client = distributed.Client(self.dask, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise CampaignError(f"no Dask scheduler answers at {self.dask}: {error}") from error
        with client:
            threads = sum(client.nthreads().values())
            # Two chunks for each thread keep all threads busy; more workers may join later.
            yield {"executor": client.get_executor(), "in_flight": max(2 * threads, 16)}


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
    has_folder = path is not None and (path.is_dir() or path.suffix.lower() not in pp.picks.REPORT_SUFFIXES)
    if out.for_folder and (not has_folder or screen or campaign is not None):
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
        _run_campaign(file, cell, campaign, pool, seed, path, as_json=as_json)
        return
    # Every pick is judged in all stages, unless the language has no programs of the arm.
    if out.export is not None:
        arm, _, source = cell.open(file)
        pp.picks.check_export(arm, source.load(), out.export)
    is_folder = out.check()
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


def _run_campaign(
    file: Path,
    cell: CellOptions,
    folder: Path,
    pool: WorkerOptions,
    seed: int,
    page: Path | None,
    *,
    as_json: bool,
) -> None:
    """Run a campaign with a progress bar, print its summary, and write its page; exit code 1 unless all are good.

    Interrupted after Ctrl-C.
    """
    if page is not None and page.suffix.lower() != ".html":
        raise InputError(f"{page}: with --campaign, -o writes a page and must end in .html")
    check_output_files([page])
    arm, world, source = cell.open(file)
    campaign = pp.Campaign(arm, world, source, rng=seed)
    try:
        with pool.settings() as settings, progress_bar(f"checking {file}") as show:
            started = False

            def progress(done: int, total: int) -> None:
                nonlocal started
                if not started and done:
                    print_note(f"resuming: {done:,} of {total:,} picks are already checked")
                started = True
                show("picks", done, total)

            result = campaign.run(folder, progress=progress, **settings)
    except RunInterrupted as error:
        raise Interrupted(f"{error}; run the same command again to resume") from None
    lines = [result.summary]
    if result.damaged:
        lines.append(f"{result.damaged:,} damaged or edited rows were computed again")
    if result.to_retry:
        lines.append(f"{result.to_retry:,} picks crashed their workers; run the same command again to retry them")
    if page is not None:
        result.save(page)
    lines += [*(f"not covered: {note}" for note in result.notes), *written(result.path, page)]
    print_result(result.to_dict(), lines, as_json=as_json, ok=result.ok)


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
