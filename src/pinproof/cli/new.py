"""``pinproof new cell``: write the files of a cell for a robot and meshes of parts, and check its picks."""

from __future__ import annotations

from dataclasses import MISSING
from pathlib import Path
from typing import Any, Literal

import typer

import pinproof as pp
from pinproof.cli.console import print_json, print_line, print_report, print_result, progress_bar, progress_status
from pinproof.cli.options import Json, Robot, RobotFileOptions, Seed, argument, option
from pinproof.cli.pick import judge_file


def new_cell(
    robot: Robot,
    parts: list[Path] = argument("Closed meshes of parts, one for each type.", MISSING, metavar="PARTS"),
    output: Path = option("The folder to write.", Path("cell"), "-o", "--output", metavar="FOLDER"),
    bin: Path | None = option(  # noqa: A002  # the option is --bin
        "The mesh of a bin, open upwards (+z), in which the parts lie. Default: they lie on a table.", None
    ),
    tool: Path | None = option("A tool file (YAML). Default: the hand of the robot, or a suction lance.", None),
    tcp: str | None = option("The tcp frame. Default: that of the tool file or of the robot.", None, metavar="LINK"),
    count: int = option("Number of parts of each type.", 1, min=1),
    unit: Literal["m", "mm", "inch"] | None = option(
        "The unit of all meshes. Default: mm for parts above 1 m and bins above 3 m, otherwise m.", None
    ),
    density: float = option("Density of the parts in kg/m^3.", 2700.0, min=1.0),
    no_run: bool = option("Write the files, but do not check the picks.", False),
    *,
    files: RobotFileOptions,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Write the scene and the picks of a new cell from a robot and meshes of parts, and check them.

    Exit code 1 if not all picks are good; the files are written in any case.

    Example: pinproof new cell ur5 block.stl -o my_cell
    """
    with progress_status("laying out the cell"):
        made = pp.cell.new_cell(
            robot,
            parts,
            folder=output,
            bin=bin,
            tool=tool,
            tcp=tcp,
            count=count,
            unit=unit,
            density=density,
            srdf=files.srdf,
            package_dirs=files.package_dir or (),
            xacro_args=files.xacro_args,
            calibration=files.calibration,
            visual_bodies=files.visual_bodies,
            rng=seed,
        )
    names = ", ".join(sorted(path.name for path in output.iterdir()))
    data: dict[str, Any] = {
        "folder": str(output),
        "assumed": made.assumed,
        "home": dict(zip(made.arm.joint_names, made.home.tolist(), strict=True)),
    }
    lines = [*made.assumed, f"wrote {output} with {names}; each assumption is a comment there"]
    if no_run:
        print_result(data, lines, as_json=as_json)
        return
    for line in () if as_json else lines:
        print_line(line)
    # The picks are checked as by pinproof pick
    with progress_bar(f"checking {output / 'picks.yaml'}") as show:
        report = judge_file(output / "picks.yaml", seed=seed, progress=lambda done, total: show("picks", done, total))
    (output / "report").mkdir(exist_ok=True)
    report.save_folder(output / "report")
    if as_json:
        print_json({**data, "report": report.to_dict()})
    else:
        print_report(report)
        picks = output / "picks.yaml"
        print_line(f"open {output / 'report' / 'report.html'} in a browser (no network needed); next:")
        print_line(f"  pinproof pick {picks} -o {output / 'report'}  # after changes of the files")
        print_line(
            f"  pinproof cell sequence {picks} -o {output / 'sequence.html'}  # the best order, and the cycle time"
        )
    if not report.ok:
        raise typer.Exit(1)
