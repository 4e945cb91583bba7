"""``pinproof pick``: judge a picks file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import pinproof as pp
from pinproof.cli.campaign import run_campaign
from pinproof.cli.compiling import compile_ahead
from pinproof.cli.console import print_json, print_report, say, working
from pinproof.cli.outputs import file_stems, make_folder, write_motion
from pinproof.cli.screen import run_screen
from pinproof.cli.workers import Dask, WorkerCount, chosen_workers
from pinproof.errors import InputError

if TYPE_CHECKING:
    from pinproof.picks import PickSource

__all__ = ["judge_file", "pick"]

PAGE = ".html"
KINDS = (".json", ".md", ".csv", PAGE)


def pick(
    file: Annotated[Path, typer.Argument(help="The picks (YAML, or a table: CSV).", metavar="PICKS")],
    robot: Annotated[str | None, typer.Option(help="A catalogue name or a URDF; by default the file's.")] = None,
    tcp: Annotated[str | None, typer.Option(help="The tcp frame; by default the file's, else the robot's.")] = None,
    scene: Annotated[Path | None, typer.Option(help="The scene (YAML); by default the file's.")] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="A report (.json, .md, .csv, .html), or a folder for all of them and the good motions.",
        ),
    ] = None,
    campaign: Annotated[
        Path | None,
        typer.Option(help="For very many picks: stream rows to this folder, or go on with what was begun there."),
    ] = None,
    screen: Annotated[
        bool, typer.Option("--screen", help="Judge the grasp alone: reach, limits, contact; -o writes a table (.csv).")
    ] = False,
    workers: WorkerCount = None,
    dask: Dask = None,
    seed: Annotated[int, typer.Option(help="Seed of every random choice.", min=0)] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Judge every pick of a file: reach, limits, grasp, grip, approach, retreat, transit, motion.

    Exit code 0 if all are good, 1 if one is not.

    Example: pinproof pick robots/ur5/picks.yaml -o report.json
    """
    if screen:
        if campaign is not None or workers is not None or dask is not None:
            raise InputError("--screen needs no workers and leaves no campaign; leave one of them out")
        arm, world, source = _read(pp.open_picks(file), file, robot, tcp, scene)
        if not run_screen(arm, world, source, file, output, seed, as_json=as_json).free.all():
            raise typer.Exit(1)
        return
    if campaign is not None:
        if output is not None:
            if output.suffix.lower() != PAGE:
                raise InputError("--campaign writes rows to its folder as they come; -o adds a page of them (.html)")
            _check_output(output)
        arm, world, source = _read(pp.open_picks(file), file, robot, tcp, scene)
        if dask is None:
            compile_ahead()
        result = run_campaign(pp.Campaign(arm, world, source, rng=seed), campaign, workers, dask, as_json=as_json)
        if output is not None:
            pp.write_report_page(output, result, arm, world, source.shared)
            if not as_json:
                say(f"wrote {output}")
        if not result.ok:
            raise typer.Exit(1)
        return
    if output is not None:
        _check_output(output)
    with working(f"judging {file}"), chosen_workers(workers, dask) as where:
        arm, world, picks, report = judge_file(file, robot, tcp, scene, seed, **where)
    if as_json:
        print_json(report.to_dict())
    else:
        print_report(report)
    if output is not None:
        written = _write(output, arm, world, picks, report)
        if not as_json:
            say(f"wrote {', '.join(str(path) for path in written)}")
    if not report.ok:
        raise typer.Exit(1)


def judge_file(
    file: Path,
    robot: str | None = None,
    tcp: str | None = None,
    scene: Path | None = None,
    seed: int = 0,
    **where: Any,
) -> tuple[pp.Arm, pp.Scene, pp.Picks, pp.PickReport]:
    """The arm, the scene, the picks and the report of a picks file; what is given goes before what the file names."""
    arm, world, source = _read(pp.open_picks(file), file, robot, tcp, scene)
    picks = source.load()
    compile_ahead()
    return arm, world, picks, pp.validate_picks(arm, world, picks, rng=seed, **where)


def _read(
    source: PickSource, file: Path, robot: str | None, tcp: str | None, scene: Path | None
) -> tuple[pp.Arm, pp.Scene, PickSource]:
    named = source.shared
    name = robot or named.robot
    if name is None:
        raise InputError(f"{file} names no robot; add 'robot: ur5' to it or give --robot")
    arm = pp.load_robot(name).arm(tcp or named.tcp, held=named.held)
    place = scene or named.scene
    return arm, pp.Scene() if place is None else pp.Scene.load(place), source


def _is_folder(output: Path) -> bool:
    return output.is_dir() or output.suffix.lower() not in KINDS


def _check_output(output: Path) -> None:
    """Refuse a place that cannot be written to before the work, not after it."""
    if _is_folder(output):
        if output.suffix and not output.is_dir():
            raise InputError(f"{output}: a report ends in {', '.join(KINDS)}; for a folder, give one that exists")
        make_folder(output)
    elif not output.parent.is_dir():
        raise InputError(f"{output}: there is no folder {output.parent}")


def _write(output: Path, arm: pp.Arm, scene: pp.Scene, picks: pp.Picks, report: pp.PickReport) -> list[Path]:
    written = [output] if not _is_folder(output) else [output / f"report{kind}" for kind in KINDS]
    for path in written:
        if path.suffix.lower() == PAGE:
            pp.write_report_page(path, report, arm, scene, picks)
        else:
            report.save(path)
    if _is_folder(output):
        for verdict, stem in zip(report.good, file_stems(v.pick.name for v in report.good), strict=True):
            written += write_motion(verdict, arm, output / f"{stem}.html", output / f"{stem}.json")
    return written
