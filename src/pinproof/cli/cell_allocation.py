"""``pinproof cell allocate``: the picks of several arms on a common clock."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

import pinproof as pp
from pinproof.cli.cell import OrderOptions, SelectionOptions, refuse_problems
from pinproof.cli.console import check_output_files, print_json, print_line, progress_status
from pinproof.cli.options import Json, Seed


def cell_allocate(
    file: Annotated[Path, typer.Argument(help="A picks file for several robots (key robots).", metavar="PICKS")],
    *,
    selection: SelectionOptions,
    before: Annotated[
        list[str] | None,
        typer.Option(help='A pair of picks in a fixed order: "first,second"; can be given several times.'),
    ] = None,
    grip_dwell: Annotated[float, typer.Option(help="Seconds that an arm rests at each grasp.", min=0.0)] = 0.0,
    release_dwell: Annotated[float, typer.Option(help="Seconds that an arm rests at each release.", min=0.0)] = 0.0,
    compare: Annotated[
        bool, typer.Option(help="Also compute the time that each arm alone takes for all picks.")
    ] = True,
    output: Annotated[
        list[Path] | None,
        typer.Option("-o", "--output", help="A .json, .md or .html file; can be given several times.", metavar="FILE"),
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Allocate the picks of a file to several arms that move at the same time, and certify all motions.

    Exit code 1 if a pick cannot be executed, or not everything is certified.

    Example: pinproof cell allocate robots/two_ur5/picks.yaml --only part_3_2,part_4_2
    """
    outputs = output or []
    picks = pp.read_picks(file)
    check_output_files(outputs, [file, picks.scene], pp.cell.ALLOCATION_SUFFIXES)
    refuse_problems(file, picks)
    group = picks.load_cell()
    scene = pp.Scene() if picks.scene is None else pp.Scene.load(picks.scene)
    chosen = selection.select(picks)
    with progress_status("allocation") as show:
        result = pp.cell.allocate(
            group,
            scene,
            replace(picks, picks=chosen),
            precedence=OrderOptions(before=before).pairs(),
            grip_dwell=grip_dwell,
            release_dwell=release_dwell,
            compare=compare,
            rng=seed,
            progress=lambda work, done, total: show(f"{work}: {done} of {total}"),
        )
    for path in outputs:
        pp.cell.save_allocation(result, path)
    if as_json:
        print_json(pp.cell.allocation_dict(result))
    else:
        _print(result)
        if outputs:
            print_line(f"wrote {', '.join(map(str, outputs))}")
    if not result.ok:
        raise typer.Exit(1)


def _print(result: pp.cell.AllocationResult) -> None:
    for each in result.arms:
        print_line(
            f"{each.arm}: {', '.join(each.picks) or 'no pick'}; {each.duration:.2f} s, of which it waits "
            f"{each.waiting:.2f} s"
        )
    print_line(result.message)
    for alone in result.alone:
        took = alone.reason if alone.duration is None else f"{alone.duration:.2f} s"
        print_line(f"{alone.arm} alone: {took}")
    for left in result.missing:
        print_line(f"left out: {left.name}: {left.reason}")
    for note in result.notes:
        print_line(f"not covered: {note}")
