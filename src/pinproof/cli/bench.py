"""``pinproof bench``: tables of figures, measured on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pinproof.cli.complete import robot_names
from pinproof.cli.console import make_folder, print_json, print_line, progress_status
from pinproof.cli.options import Json, Seed

__all__ = ["bench_ik", "bench_plan"]

Peers = Annotated[bool, typer.Option("--peers/--no-peers", help="Other libraries join if installed.")]
Folder = Annotated[
    Path | None, typer.Option("-o", "--output", help="A folder for the table (JSON, Markdown) and its plots.")
]


def bench_ik(
    robots: Annotated[
        list[str] | None,
        typer.Argument(
            help="Catalogue names or robot files; by default ur5.", metavar="[ROBOT]...", autocompletion=robot_names
        ),
    ] = None,
    points: Annotated[int, typer.Option(help="Targets of each part of the table.", min=1)] = 10_000,
    methods: Annotated[str | None, typer.Option(help='Which methods: "clik pseudo_inverse"; by default all.')] = None,
    peers: Peers = True,
    limits_pi: Annotated[
        bool,
        typer.Option("--limits-pi/--own-limits", help="Narrow ranges of more than one turn to +-pi (as a UR5's)."),
    ] = True,
    output: Folder = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Measure the methods of inverse kinematics: latency, success and worst error on the same targets.

    Example: pinproof bench ik ur5 --points 20 --no-peers
    """
    from pinproof.benchmarks import ik_benchmark, ik_markdown, write_ik_table

    if output is not None:
        make_folder(output)
    with progress_status("running the table of inverse kinematics") as set_status:
        figures = ik_benchmark(
            robots or ["ur5"],
            points=points,
            methods=None if methods is None else methods.replace(",", " ").split(),
            peers=peers,
            limits_pi=limits_pi,
            seed=seed,
            on_progress=set_status,
        )
    written = [] if output is None else write_ik_table(figures, output)
    _show(figures.to_dict(), ik_markdown(figures), written, as_json)


def bench_plan(
    robots: Annotated[
        list[str] | None,
        typer.Argument(
            help="Catalogue names or robot files for our own scenes; by default ur5, panda and generic_6dof.",
            metavar="[ROBOT]...",
            autocompletion=robot_names,
        ),
    ] = None,
    mbm: Annotated[
        Path | None, typer.Option(help="A folder of MotionBenchMaker problems, which are run too.", metavar="PATH")
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            help="The robot of those, a catalogue name or a file; by default the URDF in a folder 'robot' beside them, "
            "else the one they name."
        ),
    ] = None,
    sets: Annotated[
        list[str] | None,
        typer.Option("--set", help="Only these problems: ur5/shelf, shelf, ur5, mbm, ...; repeatable.", metavar="NAME"),
    ] = None,
    problems: Annotated[
        int | None, typer.Option(help="The first so many of each set; by default all, and 10 of our own.", min=1)
    ] = None,
    repeats: Annotated[int, typer.Option(help="How often each is asked; the quickest counts.", min=1)] = 1,
    peers: Peers = True,
    output: Folder = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Measure planning: solved, certified, times of each step, length; every motion is audited apart from its proof.

    Our own scenes are a table top, a shelf, bins, a cage and a narrow slot. Exit code 1 if the audit finds a motion of
    ours that touches anything.

    Example: pinproof bench plan ur5 --set shelf --problems 1 --no-peers
    """
    from pinproof.benchmarks import plan_benchmark, plan_markdown, write_plan_table
    from pinproof.benchmarks.plan_own import OWN_ROBOTS

    if output is not None:
        make_folder(output)
    with progress_status("running the table of planning") as set_status:
        figures = plan_benchmark(
            OWN_ROBOTS if robots is None else robots,
            mbm=mbm,
            robot=robot,
            sets=sets or (),
            problems=problems,
            repeats=repeats,
            peers=peers,
            seed=seed,
            on_progress=set_status,
        )
    written = [] if output is None else write_plan_table(figures, output)
    _show(figures.to_dict(), plan_markdown(figures), written, as_json)
    if figures.unsafe:
        raise typer.Exit(1)


def _show(words: dict[str, Any], page: str, written: list[Path], as_json: bool) -> None:
    """A table to stdout, and which files hold it."""
    if as_json:
        print_json(words)
        return
    print_line(page)
    if written:
        print_line(f"wrote {', '.join(str(path) for path in written)}")
