"""``pinproof cell``: the order of the picks of a cell, its cycle time and its page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import pinproof as pp
from pinproof.cli.console import print_line
from pinproof.cli.pick import CellOptions

__all__ = ["cell_sequence"]


def cell_sequence(
    file: Annotated[Path, typer.Argument(help="The picks file (.yaml or a .csv table).", metavar="PICKS")],
    *,
    cell: CellOptions,
) -> None:
    """Order the picks of a file so that the certified motions take the shortest total time.

    Example: pinproof cell sequence robots/ur5/picks.yaml
    """
    arm, scene, source = cell.open(file)
    picks = source.shared
    setup = pp.picks.PickSetup.make(arm, scene, picks, home=None, rng=0)
    print_line(str(len(pp.sequence(setup, []).names)))
