"""``pinproof pick --screen``: which picks can be grasped at all, tens of thousands a second."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import Progress

import pinproof as pp
from pinproof.cli.console import print_json, say
from pinproof.cli.outputs import check_outputs
from pinproof.errors import InputError

if TYPE_CHECKING:
    from pinproof.picks import PickSource

__all__ = ["run_screen"]


def run_screen(
    arm: pp.Arm, scene: pp.Scene, source: PickSource, file: Path, output: Path | None, seed: int, *, as_json: bool
) -> pp.PickScreen:
    """Screen the picks of a file, tell how many there are of each status, and write the table that is asked for."""
    if output is not None:
        if output.suffix.lower() != ".csv":
            raise InputError(f"{output}: --screen writes a table (.csv), a row a pick")
        check_outputs([output], [file])
    begun = time.perf_counter()
    with Progress(console=Console(stderr=True), transient=True, disable=not Console(stderr=True).is_terminal) as bar:
        line = bar.add_task("screening", total=len(source))
        found = pp.screen_picks(
            arm, scene, source, rng=seed, clearance=output is not None,
            progress=lambda done, _: bar.update(line, completed=done),
        )  # fmt: skip
    seconds = time.perf_counter() - begun
    if output is not None:
        found.save(output)
    if as_json:
        counts = {status.value: count for status, count in found.counts.items()}
        print_json({"ok": bool(found.free.all()), "picks": len(found), "complete": found.complete, "counts": counts})
        return found
    say(found.summary)
    rate = len(found) / max(seconds, 1e-9)
    say(f"{seconds:.3g} s, {rate:,.0f} picks a second; the ways to and from the grasp are not judged")
    if output is not None:
        say(f"wrote {output}")
    return found
