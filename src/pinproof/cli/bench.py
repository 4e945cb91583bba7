"""``pinproof bench``: tables of figures, measured on this machine."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from pinproof.benchmarks import ik_benchmark, ik_markdown, write_ik_table
from pinproof.cli.console import print_json, say, working
from pinproof.cli.options import Json, Seed
from pinproof.cli.outputs import make_folder

__all__ = ["bench"]


class TableName(str, Enum):
    """The tables there are."""

    IK = "ik"


def bench(
    table: Annotated[TableName, typer.Argument(help="Which table.", metavar="TABLE")],
    robots: Annotated[
        list[str] | None, typer.Argument(help="Catalogue names or robot files; by default ur5.", metavar="[ROBOT]...")
    ] = None,
    points: Annotated[int, typer.Option(help="Targets of each part of the table.", min=1)] = 10_000,
    methods: Annotated[str | None, typer.Option(help='Which methods: "clik pseudo_inverse"; by default all.')] = None,
    peers: Annotated[bool, typer.Option("--peers/--no-peers", help="Other libraries join if installed.")] = True,
    limits_pi: Annotated[
        bool,
        typer.Option("--limits-pi/--own-limits", help="Narrow ranges of more than one turn to +-pi (as a UR5's)."),
    ] = True,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A folder for the table (JSON, Markdown) and its plots.")
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Measure the methods of inverse kinematics (table ik): latency, success and worst error on the same targets.

    Example: pinproof bench ik ur5 --points 20 --no-peers
    """
    if output is not None:
        make_folder(output)
    with working(f"running the table {table.value}"):
        figures = ik_benchmark(
            robots or ["ur5"],
            points=points,
            methods=None if methods is None else methods.replace(",", " ").split(),
            peers=peers,
            limits_pi=limits_pi,
            seed=seed,
        )
    if as_json:
        print_json(figures.to_dict())
    else:
        say(ik_markdown(figures))
    if output is not None:
        written = write_ik_table(figures, output)
        if not as_json:
            say(f"wrote {', '.join(str(path) for path in written)}")
