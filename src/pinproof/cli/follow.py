"""``pinproof follow``: follow the tool paths of a file by one certified motion, or state why that is not possible."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal

import pinproof as pp
from pinproof.cli.console import (
    check_output_files,
    check_report_output,
    print_note,
    print_result,
    progress_status,
    written,
)
from pinproof.cli.options import Html, Json, Seed, argument, option, placement
from pinproof.cli.pick import CellOptions, check_signal
from pinproof.errors import InputError


@dataclass(frozen=True)
class FollowOutput:
    """Options for the files of the results."""

    PANEL: ClassVar = "Output"

    output: Path | None = option(
        "A report (.json, .md, .csv, .html), or a folder for all reports, the motion with its proof and the program.",
        None,
        "-o",
        "--output",
        metavar="FILE|FOLDER",
    )
    save: Path | None = option("Write the motion (.json, .csv), and beside it its proof (.proof.json).", None)
    colour: Literal["clearance", "speed"] = option("What the colours of the paths on a page show.", "clearance")
    export: str | None = option(
        "Also write a robot program to the folder of -o: urscript, rapid, krl or fanuc.", None, metavar="LANGUAGE"
    )
    process_output: str | None = option(
        "For --export: the digital output that switches the process. Default: that of the file, or else 1; 0 for "
        "urscript, do_process for rapid.",
        None,
        metavar="OUTPUT",
    )
    export_deviation: float | None = option(
        "For --export: assumed deviation of each joint from the moves of the program (rad). Default: 0.002.",
        None,
        min=0.0,
    )

    def folder(self, inputs: list[str | Path | None], html: Path | None) -> Path | None:
        """The folder of ``-o``, if it is one; outputs that cannot be written are refused before the work starts."""
        if self.export is None and (self.process_output is not None or self.export_deviation is not None):
            raise InputError("--process-output and --export-deviation need --export")
        check_signal("--process-output", self.export, self.process_output)
        check_output_files([self.save, html], inputs)
        kinds = pp.tool_paths.FollowReport.formats
        if self.export is not None and (self.output is None or self.output.suffix.lower() in kinds):
            raise InputError("--export belongs to -o with a folder; add -o FOLDER")
        is_folder = self.output is not None and check_report_output(self.output, kinds)
        if self.output is not None and not is_folder:
            check_output_files([self.output], inputs)
        return self.output if is_folder else None


def follow(
    file: Path = argument("The file of tool paths (.yaml, .json).", MISSING, metavar="PATHS"),
    *,
    out: FollowOutput,
    html: Html = None,
    lifts: int | None = option(
        "How often the tool may be lifted within a path. Default: that of the file.", None, min=0
    ),
    suggestions: int = option(
        "How many changed paths are followed for each stroke without a motion, to suggest a change; 0 for none.",
        12,
        min=0,
    ),
    seed: Seed = 0,
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Follow the tool paths of a file by one certified motion, or state which poses cannot be passed and why.

    Exit code 1 if a path cannot be followed, or the program of --export is not proven.

    Example: pinproof follow robots/ur5/weld_seam.yaml -o weld
    """
    job = pp.tool_paths.read_tool_paths(file)
    # Options of the command replace keys of the file; the robot may be placed in the cell
    root_from_world = placement(cell.place).inverse()
    settings = cell.replaced(job.settings).transformed(root_from_world)
    strokes = job.strokes if job.frame else tuple(each.transformed(root_from_world) for each in job.strokes)
    job = replace(job, settings=settings, strokes=strokes, lifts=job.lifts if lifts is None else lifts)
    arm = job.load_arm()
    if out.export is not None:
        pp.picks.check_export(arm, settings, out.export)
        pp.tool_paths.require_language(arm, out.export)
    folder = out.folder([file, *cell.files], html)
    checker = job.load_checker(arm, job.load_scene().transformed(root_from_world))
    for contact in checker.fixed_contacts:
        print_note(f"every configuration is in collision: {contact}")
    with progress_status(f"following {file}"):
        report = pp.tool_paths.follow_job(job, checker=checker, suggestions=suggestions, rng=seed, colour=out.colour)
    # The files before the answer, which names them; a motion that is not proven is no motion
    files = list[Path]()
    program = None
    if report.ok and out.export is not None and folder is not None:
        program = report.export_program(out.export, output=out.process_output, deviation=out.export_deviation)
        if program.ok:
            files.append(folder / f"{file.stem}{pp.motion.find_dialect(out.export).endings[0]}")
            program.program.save(files[-1])
    motion = out.save if folder is None or out.save is not None else folder / f"{file.stem}.json"
    if report.ok and motion is not None:
        files += [motion, report.motion.save(motion)]
    reports = [html, out.output] if folder is None else [html, *(folder / f"report{kind}" for kind in report.formats)]
    for path in filter(None, reports):
        report.save(path)
        files.append(path)
    data = report.to_dict() | ({} if program is None else {"program": program.to_dict()})
    lines = [report.to_text(), *(f"not covered: {note}" for note in report.notes)]
    lines += [] if program is None else [f"{out.export}: {program.message}"]
    ok = report.ok and (program is None or program.ok)
    print_result(data, [*lines, *written(*files)], as_json=as_json, ok=ok)
