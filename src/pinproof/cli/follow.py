"""``pinproof follow``: follow the tool paths of a file by one certified motion, or state why that is not possible.

``--campaign`` follows each path by itself, in worker processes, and streams the results to a folder. ``--program``
certifies a robot program again.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import pinproof as pp
from pinproof.cli.cell_options import CellOptions, ExportOptions, WorkerOptions, run_campaign
from pinproof.cli.console import check_output_files, print_note, print_result, progress_status, written
from pinproof.cli.options import Html, Json, Seed, argument, option
from pinproof.errors import InputError


@dataclass(frozen=True)
class FollowOutput(ExportOptions):
    """Options for the files of the results."""

    output: Path | None = option(
        "A report (.json, .md, .csv, .html), or a folder for all reports, the motion with its proof and the program.",
        None,
        "-o",
        "--output",
        metavar="FILE|FOLDER",
    )
    save: Path | None = option("Write the motion (.json, .csv), and beside it its proof (.proof.json).", None)
    colour: Literal["clearance", "speed"] = option("What the colours of the paths on a page show.", "clearance")
    process_output: str | None = option(
        "For --export: the digital output that switches the process. Default: that of the file, or else 1; 0 for "
        "urscript, do_process for rapid.",
        None,
        metavar="OUTPUT",
    )
    process_dwell: float = option(
        "For --export: seconds that the arm rests after the process is switched on.", 0.0, min=0.0
    )

    @property
    def stated(self) -> bool:
        """Whether a file of results is stated."""
        return bool(self.output or self.save or self.export)


def follow(
    file: Path = argument("The file of tool paths (.yaml, .json).", MISSING, metavar="PATHS"),
    *,
    out: FollowOutput,
    html: Html = None,
    program: Path | None = option(
        "Instead of following the paths, certify this robot program of --export again in the cell of the file.", None
    ),
    campaign: Path | None = option(
        "For many paths: follow each by itself and write the results to this folder one by one; an interrupted run is "
        "resumed.",
        None,
        metavar="FOLDER",
    ),
    lifts: int | None = option(
        "How often the tool may be lifted within a path. Default: that of the file.", None, min=0
    ),
    suggestions: int | None = option(
        "How many changed paths are followed for each stroke without a motion, to suggest a change; 0 for none. "
        "Default: 12.",
        None,
        min=0,
    ),
    profile: bool = option("Also print the time of each stage, and of each body in the proofs beside it.", False),
    pool: WorkerOptions,
    seed: Seed = 0,
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Follow the tool paths of a file by one certified motion, or state which poses cannot be passed and why.

    Exit code 1 if a path cannot be followed, or the program of --export is not proven.

    Example: pinproof follow robots/ur5/weld_seam.yaml -o weld
    """
    reported = out.stated or (html is not None and campaign is None)
    if (program is not None) + (campaign is not None) + reported > 1:
        raise InputError(
            "--program and --campaign have no report; remove -o, --save, --export, and --html, which --campaign has"
        )
    if (suggestions is not None or profile) and (program is not None or campaign is not None):
        raise InputError("--suggestions and --profile cannot be combined with --program and --campaign; remove them")
    if out.process_dwell and out.export is None:
        raise InputError("--process-dwell needs --export")
    if pool.stated and campaign is None:
        raise InputError("--workers and --dask are for --campaign; add --campaign FOLDER")
    arm, scene, job = cell.open_job(file)
    job = replace(job, lifts=job.lifts if lifts is None else lifts)
    group = job.with_part(job.at_tip(arm))
    if out.export is not None:
        pp.picks.check_export(pp.tool_paths.require_language(group, out.export), job.settings, out.export)
    kinds = pp.tool_paths.FollowReport.formats
    is_folder = out.check_outputs(kinds, [file, *cell.files], "--process-output", out.process_output)
    check_output_files([out.save, html], [file, *cell.files])
    folder = out.output if is_folder else None
    checker = job.load_checker(group, scene)
    for contact in checker.fixed_contacts:
        print_note(f"every configuration is in collision: {contact}")
    # Other work than following all paths by one motion
    if campaign is not None:
        paths = pp.tool_paths.path_campaign(job, checker=checker, rng=seed)
        run_campaign(paths, campaign, pool, html, as_json=as_json)
        return
    if program is not None:
        with progress_status(f"certifying {program}"):
            text = pp.motion.RobotProgram.load(program, allow_changes=True)
            outputs = {step.output for step in text.steps if isinstance(step, pp.motion.SetOutput)}
            proof = pp.collision.certify_program(text, checker, process=outputs)
        changed = [] if text.certificate else ["the program states no certificate, or was changed since"]
        lines = [f"{program}: {proof.message}", *changed, *(f"not covered: {note}" for note in proof.notes)]
        data = {"ok": proof.free, "message": proof.message, "unchanged": bool(text.certificate), "notes": proof.notes}
        print_result(data, lines, as_json=as_json, ok=proof.free)
        return
    with progress_status(f"following {file}"):
        tried = 12 if suggestions is None else suggestions
        work = partial(pp.tool_paths.follow_job, job, checker=checker, suggestions=tried, rng=seed, colour=out.colour)
        profiled = pp.tool_paths.profile_job(work) if profile else None
        report = work() if profiled is None else profiled.report
    # The files before the answer, which names them; a motion that is not proven is no motion
    files = list[Path]()
    made = None
    if report.ok and out.export is not None and folder is not None:
        made = report.export_program(
            out.export, output=out.process_output, deviation=out.export_deviation, dwell=out.process_dwell
        )
        if made.ok:
            files.append(folder / f"{file.stem}{pp.motion.find_dialect(out.export).endings[0]}")
            made.program.save(files[-1])
    motion = out.save if folder is None or out.save is not None else folder / f"{file.stem}.json"
    if report.ok and motion is not None:
        files += [motion, report.motion.save(motion)]
    reports = [html, out.output] if folder is None else [html, *(folder / f"report{kind}" for kind in kinds)]
    for path in filter(None, reports):
        report.save(path)
        files.append(path)
    data = report.to_dict() | ({} if made is None else {"program": made.to_dict()})
    lines = [report.to_text(), *(f"not covered: {note}" for note in report.notes)]
    lines += [] if made is None else [f"{out.export}: {made.message}"]
    if profiled is not None:
        data["profile"] = profiled.to_dict()
        lines += ["", profiled.to_text()]
    ok = report.ok and (made is None or made.ok)
    print_result(data, [*lines, *written(*files)], as_json=as_json, ok=ok)
