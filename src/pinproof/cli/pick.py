"""``pinproof pick``: check the picks of a file.

By default every pick is checked completely and a report is printed. ``--campaign`` streams the results of many picks to
a folder and can be interrupted and resumed. ``--screen`` checks only the grasp configuration of each pick, which is
much faster.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import typer

import pinproof as pp
from pinproof.cli.certify import verdict
from pinproof.cli.console import (
    Interrupted,
    check_output_files,
    make_folder,
    print_json,
    print_line,
    print_note,
    print_report,
    print_result,
    progress_bar,
    progress_status,
    write_pages,
    written,
)
from pinproof.cli.options import Json, Limits, Place, RobotFileOptions, Seed, argument, option, placement
from pinproof.common.files import file_stems
from pinproof.errors import CampaignError, InputError, RunInterrupted, UnknownNameError

if TYPE_CHECKING:
    from pinproof.motion.dialects import Dialect
    from pinproof.picks import PickSource

CONNECT_SECONDS = 20
"""Time to wait for the Dask scheduler."""


@dataclass(frozen=True)
class CellOptions(RobotFileOptions):
    """Options that replace the robot and the scene of the picks file."""

    PANEL: ClassVar = "Robot and scene"

    robot: str | None = option(
        "A catalogue name, a robot file or a DH table. It replaces robot, srdf, package_dirs, xacro_args and "
        "limits of the picks file.",
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
        return self.robot, self.srdf, self.limits, self.scene

    def open(self, file: Path) -> tuple[pp.Arm, pp.Scene, PickSource]:
        """The arm, the scene and the picks of a picks file."""
        source = pp.picks.open_picks(file)
        world_from_root = placement(self.place)
        if not world_from_root.isIdentity():
            source = source.transformed(world_from_root.inverse())
        shared = source.shared
        if self.robot is not None:
            shared = replace(shared, robot=self.robot, srdf=None, package_dirs=(), xacro_args={}, limits=None)
        stated_here = {"robot": self.robot, "tcp": self.tcp, **{f"xacro_args.{name}": name for name in self.xacro_args}}
        arm = replace(
            shared,
            srdf=self.srdf or shared.srdf,
            package_dirs=tuple(self.package_dir or shared.package_dirs),
            xacro_args={**shared.xacro_args, **self.xacro_args},
            limits=self.limits or shared.limits,
            tcp=self.tcp or shared.tcp,
            places={key: place for key, place in shared.places.items() if not stated_here.get(key)},
        ).load_arm()
        scene_file = self.scene or shared.scene
        scene = pp.Scene() if scene_file is None else pp.Scene.load(scene_file)
        return arm, scene.transformed(world_from_root.inverse()), source


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
        "For --export: the digital output that closes the gripper. Default: 1; 0 for urscript, do_gripper for rapid.",
        None,
        metavar="OUTPUT",
    )
    export_deviation: float | None = option(
        "For --export: assumed deviation of each joint from the moves of the program (rad). Default: 0.002.",
        None,
        min=0.0,
    )

    @property
    def is_folder(self) -> bool:
        """Whether the reports are written to a folder."""
        path = self.output
        return path is not None and (path.is_dir() or path.suffix.lower() not in pp.picks.REPORT_SUFFIXES)

    @property
    def for_folder(self) -> bool:
        """Whether an option is used that only applies to a folder."""
        return bool(
            self.pages
            or self.grip_dwell
            or self.release_dwell
            or self.export
            or self.gripper_output
            or self.export_deviation is not None
        )

    def check(self, suffix: str | None = None) -> None:
        """Refuse an output that cannot be written, before the picks are checked; ``suffix``: only this file type."""
        path = self.output
        if self.export is not None and not _dialect(self.export).outputs:
            raise InputError(f"--export {self.export}: picks need digital outputs; use urscript, rapid, krl or fanuc")
        if self.gripper_output is not None and self.export is None:
            raise InputError("--gripper-output needs --export")
        if self.export_deviation is not None and self.export is None:
            raise InputError("--export-deviation needs --export")
        if path is None:
            return
        if suffix is not None and path.suffix.lower() != suffix:
            raise InputError(f"{path}: with --campaign, -o writes a page and must end in {suffix}")
        if self.is_folder:
            if path.suffix and not path.is_dir():
                known = ", ".join(pp.picks.REPORT_SUFFIXES)
                raise InputError(f"{path}: unknown report type; use {known}, or the name of an existing folder")
            make_folder(path)
        elif not path.parent.is_dir():
            raise InputError(f"{path}: the folder {path.parent} does not exist")

    def write(self, report: pp.picks.PickReport) -> tuple[str, bool]:
        """Write the report and, to a folder, the motions of the good picks.

        Returns
        -------
        tuple[str, bool]
            What was written, empty without -o, and whether it includes each robot program of ``--export``.
        """
        output = self.output
        if output is None:
            return "", True
        if not self.is_folder:
            report.save(output)
            return str(output), True
        for kind in pp.picks.REPORT_SUFFIXES:
            report.save(output / f"report{kind}")
        report.save_programs(output, grip_dwell=self.grip_dwell, release_dwell=self.release_dwell)
        stems = file_stems(verdict.pick.name for verdict in report.good)
        for found, stem in zip(report.good, stems, strict=True):
            found.save_motion(output / f"{stem}.json")
            if self.pages and report.setup is not None:
                write_pages(found, report.setup.checker.arm, output / f"{stem}.html")
        programs, complete = self._export(report, stems)
        names = ", ".join(str(output / f"report{kind}") for kind in pp.picks.REPORT_SUFFIXES)
        if not stems:
            return names, complete
        more = f"{stems[0]}.json and {stems[0]}.program.json" + (", and a page of each motion" if self.pages else "")
        picks = "the good pick" if len(stems) == 1 else f"each of the {len(stems)} good picks"
        return f"{names}; for {picks} its motion and program, such as {more}{programs}", complete

    def _export(self, report: pp.picks.PickReport, stems: Sequence[str]) -> tuple[str, bool]:
        """Write a robot program of each good pick; return what was written, and whether every program is proven."""
        if self.export is None or self.output is None or report.setup is None:
            return "", True
        dialect = _dialect(self.export)
        dwell = {"grip_dwell": self.grip_dwell, "release_dwell": self.release_dwell}
        made = zip(report.good, report.programs(**dwell), stems, strict=True)
        count = 0
        for judged, program, stem in made:
            found = pp.picks.export_picks(
                report.setup,
                [(judged.pick, program)],
                self.export,
                output=self.gripper_output or dialect.outputs,
                name=stem,
                deviation=self.export_deviation,
            )
            for note in found.notes:
                print_note(f"note: {note}")
            if found.free:
                found.program.save(self.output / f"{stem}{dialect.endings[0]}")
                count += 1
            else:
                failed = next(each for each in found.certificates[0] if not each.free)
                print_note(f"note: the {self.export} program of {stem} is not written: {failed.message}")
        return f"; {count} programs in {self.export}", count == len(stems)


def _dialect(name: str) -> Dialect:
    from pinproof.motion.dialects import find_dialect

    return find_dialect(name)


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

        Raises
        ------
        InputError
            If both options are given, or Dask is not installed.
        CampaignError
            If the scheduler does not answer.
        """
        if self.dask is None:
            yield {} if self.workers is None else {"workers": self.workers}
            return
        if self.workers is not None:
            raise InputError("--workers and --dask cannot be combined; remove one of them")
        try:
            from distributed import Client
        except ImportError as error:
            raise InputError("--dask needs the extra 'dask': pip install 'pinproof[dask]'") from error
        try:
            client = Client(self.dask, timeout=CONNECT_SECONDS, set_as_default=False)
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
    pool: WorkerOptions,
    seed: Seed = 0,
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Check every pick of a file: reach, limits, grasp, grip, approach, retreat, transit, motion.

    Exit code 0 if all picks are good, and each program of --export is proven; 1 otherwise.

    Example: pinproof pick robots/ur5/picks.yaml -o report.json
    """
    if out.for_folder and (not out.is_folder or screen or campaign is not None):
        raise InputError("--pages, --grip-dwell and --release-dwell belong to -o with a folder; add -o FOLDER")
    if optimise is not None and (program is not None or screen or campaign is not None):
        raise InputError(
            "--optimise cannot be combined with --program, --screen or --campaign; remove it, or state optimise in "
            "the picks file"
        )
    if program is not None:
        if screen or campaign is not None or out.output is not None or pool.stated:
            raise InputError("--program checks no pick; remove --screen, --campaign, -o, --workers and --dask")
        _recertify(program, file, cell, as_json=as_json)
    elif screen:
        if campaign is not None or pool.stated:
            raise InputError("--screen cannot be combined with --campaign, --workers or --dask; remove them")
        _screen(file, cell, out.output, seed, as_json=as_json)
    elif campaign is not None:
        out.check(".html")
        _run_campaign(file, cell, campaign, pool, seed, out.output, as_json=as_json)
    else:
        out.check()
        budget = None if optimise is None else pp.picks.PickBudget(motion=optimise)
        _judge(file, cell, pool, seed, out, budget, as_json=as_json)


def _judge(
    file: Path,
    cell: CellOptions,
    pool: WorkerOptions,
    seed: int,
    out: OutputOptions,
    budget: pp.picks.PickBudget | None,
    *,
    as_json: bool,
) -> None:
    """Check the picks of a file, print and write the report; exit code 1 unless all are good.

    Raises
    ------
    Interrupted
        After Ctrl-C; before, the picks that were judged are reported, if there are any.
    """
    try:
        with progress_bar(f"checking {file}") as show, pool.settings() as settings:
            judged = judge_file(file, cell, seed, progress=partial(show, "picks"), budget=budget, **settings)
            report = judged[-1]
    except RunInterrupted as error:
        report = error.result
        if not report.verdicts:
            raise Interrupted(f"{error}; there is no result") from None
    if as_json:
        print_json(report.to_dict())
    else:
        print_report(report)
    files, complete = out.write(report)
    if files and not as_json:
        print_line(f"wrote {files}")
    if report.not_judged:
        count, total = len(report.verdicts), len(report.verdicts) + report.not_judged
        kept = "" if out.output is None else f"; {out.output} has these {count:,}"
        remedy = "the same command checks all picks again; add --campaign FOLDER for a run that can be resumed"
        raise Interrupted(f"interrupted after {count:,} of {total:,} picks{kept}; {remedy}", result_printed=True)
    if not report.ok or not complete:
        raise typer.Exit(1)


def _recertify(program: Path, file: Path, cell: CellOptions, *, as_json: bool) -> None:
    """Certify a program again in the cell of a picks file; exit code 1 unless it is FREE and unchanged."""
    from pinproof.motion.dialects import is_program_file

    arm, world, source = cell.open(file)
    picks = source.load()
    if is_program_file(program):
        text = pp.motion.RobotProgram.load(program, allow_changes=True)
        with progress_status(f"certifying {program}"):
            setup = pp.picks.PickSetup.make(arm, world, picks, home=None, rng=0)
            certificates, notes = pp.picks.certify_picks_program(setup, picks, text)
        motions = [
            {"pick": pick.name, "motion": name, **verdict(proof)}
            for pick, row in zip(text.picks, certificates, strict=True)
            for name, proof in zip([name for name, _ in pick.motions] if len(row) > 1 else ["pick"], row, strict=True)
        ]
        edited = not text.certificate
        ok = all(row["status"] == "FREE" for row in motions) and not edited
        lines = [f"{row['pick']}, {row['motion']}: {row['status']}: {row['message']}" for row in motions]
        lines += ["the program was edited after it was written, or was never certified"] if edited else []
        data = {"ok": ok, "program": text.name, "edited": edited, "motions": motions, "notes": notes}
        print_result(data, [*lines, *(f"note: {note}" for note in notes)], as_json=as_json, ok=ok)
        return
    found = pp.motion.MotionProgram.load(program, allow_changes=True)
    pick = next((each for each in picks if each.name == found.name), None)
    if pick is None:
        raise UnknownNameError("pick", found.name, [each.name for each in picks], str(file))
    with progress_status(f"certifying {program}"):
        proofs = pp.picks.PickSetup.make(arm, world, picks, home=None, rng=0).recertify(found, pick)
    records = list(found.certificates.values())
    rows = [
        {"motion": record.name, "changed": record.name in found.changed, **verdict(proof)}
        for record, proof in zip(records, proofs, strict=True)
    ]
    ok = all(proof.free for proof in proofs) and not found.changed
    lines = []
    for row, proof in zip(rows, proofs, strict=True):
        note = "; differs from the motion that was certified" if row["changed"] else ""
        lines.append(f"{row['motion']}: {proof.status.name}: {proof.message}{note}")
    data = {"ok": ok, "program": found.name, "duration": found.duration, "motions": rows}
    print_result(data, lines, as_json=as_json, ok=ok)


def judge_file(
    file: Path,
    cell: CellOptions | None = None,
    seed: int = 0,
    **settings: Any,
) -> tuple[pp.Arm, pp.Scene, pp.Picks, pp.picks.PickReport]:
    """Check the picks of a file; return the arm, the scene, the picks and the report.

    ``cell`` overrides the file; ``settings`` are passed to :func:`pinproof.validate_picks`.
    """
    arm, world, source = (cell or CellOptions()).open(file)
    picks = source.load()
    return arm, world, picks, pp.validate_picks(arm, world, picks, rng=seed, **settings)


def _screen(file: Path, cell: CellOptions, output: Path | None, seed: int, *, as_json: bool) -> None:
    """Check the grasps of a picks file, print the number of picks of each status; exit code 1 unless all are free."""
    arm, world, source = cell.open(file)
    if output is not None:
        if output.suffix.lower() != ".csv":
            raise InputError(f"{output}: with --screen, -o writes a table and must end in .csv")
        check_output_files([output], [file, *cell.files])
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

    Raises
    ------
    Interrupted
        After Ctrl-C.
    """
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
