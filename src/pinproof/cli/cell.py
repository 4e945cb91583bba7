"""``pinproof cell``: the order of the picks of a cell and its cycle time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

import pinproof as pp
from pinproof.cli.console import (
    Interrupted,
    check_output_files,
    print_json,
    print_line,
    print_note,
    progress_status,
)
from pinproof.cli.options import Json, Seed, placement
from pinproof.cli.pick import CellOptions
from pinproof.errors import InputError, UnknownNameError

SHOWN = 20
"""Largest number of picks that are printed; -o writes all of them."""

SLOWEST = 3
"""Number of slowest picks that are printed."""


@dataclass(frozen=True)
class SelectionOptions:
    """Which picks of the file are put in sequence."""

    only: Annotated[
        str | None, typer.Option(help='The names of the picks to use, with commas between them: "a,b,c".')
    ] = None
    without: Annotated[str | None, typer.Option(help="The names of picks to leave out, with commas.")] = None

    def select(self, picks: pp.Picks) -> tuple[pp.Pick, ...]:
        """The selected picks in the order of the file."""
        known = [pick.name for pick in picks.picks]
        stated = {"--only": _names(self.only), "--without": _names(self.without)}
        for option, names in stated.items():
            for name in names:
                if name not in known:
                    raise UnknownNameError("pick", name, known, option)
        chosen = stated["--only"] if self.only is not None else known
        return tuple(pick for pick in picks.picks if pick.name in chosen and pick.name not in stated["--without"])


@dataclass(frozen=True)
class OrderOptions:
    """What the order depends on."""

    before: Annotated[
        list[str] | None,
        typer.Option(help='A pair of picks in a fixed order: "first,second"; can be given several times.'),
    ] = None
    free_start: Annotated[bool, typer.Option("--free-start", help="Start at the first approach instead of home.")] = (
        False
    )
    free_end: Annotated[bool, typer.Option("--free-end", help="End after the last pick instead of at home.")] = False
    file_order: Annotated[
        bool, typer.Option("--file-order", help="Keep the order of the file, and choose only grasps and IK branches.")
    ] = False
    grip_dwell: Annotated[float, typer.Option(help="Seconds that the arm rests at each grasp.", min=0.0)] = 0.0
    release_dwell: Annotated[float, typer.Option(help="Seconds that the arm rests at each release.", min=0.0)] = 0.0
    options: Annotated[
        int, typer.Option(help="Number of grasps and IK branches that are considered for each pick.", min=1)
    ] = 4

    def pairs(self) -> list[tuple[str, str]]:
        """The stated precedence."""
        found = []
        for text in self.before or ():
            names = _names(text)
            if len(names) != 2:
                raise InputError(f'--before {text!r} names {len(names)} picks; state two: --before "first,second"')
            found.append((names[0], names[1]))
        return found


def cell_sequence(
    file: Annotated[Path, typer.Argument(help="The picks file (.yaml or a .csv table).", metavar="PICKS")],
    *,
    selection: SelectionOptions,
    ordering: OrderOptions,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            help="The sequence as .json, .md, .csv or .html; can be given several times.",
            metavar="FILE",
        ),
    ] = None,
    heat_map: Annotated[
        Path | None,
        typer.Option(help="Draw the heat map of a placement search (.csv with x, y, share) on the floor of the page."),
    ] = None,
    seed: Seed = 0,
    workers: Annotated[int | None, typer.Option("--workers", help="Number of parallel processes.", min=1)] = None,
    cell: CellOptions,
    as_json: Json = False,
) -> None:
    """Order the picks of a file so that the certified motions take the shortest total time.

    Exit code 1 if a pick cannot be executed; it is left out.

    Example: pinproof cell sequence robots/ur5/picks.yaml --only bolt_1,bolt_2,bolt_5
    """
    outputs = output or []
    check_output_files(outputs, [file, heat_map, *cell.files], pp.cell.SEQUENCE_SUFFIXES)
    if heat_map is not None and not any(path.suffix.lower() == ".html" for path in outputs):
        raise InputError("--heat-map belongs to a page; add -o FILE.html")
    heat = None if heat_map is None else pp.cell.read_heat_map(heat_map, placement(cell.place).inverse())
    arm, scene, source = cell.open(file)
    picks = source.load()
    refuse_problems(file, picks)
    setup = pp.picks.PickSetup.make(arm, scene, picks, home=None, rng=seed)
    chosen = selection.select(picks)
    interrupted: pp.cell.SequenceInterrupted | None = None
    try:
        with _progress() as progress:
            result = pp.sequence(
                setup,
                chosen,
                precedence=ordering.pairs(),
                start="free" if ordering.free_start else "home",
                end="free" if ordering.free_end else "home",
                grip_dwell=ordering.grip_dwell,
                release_dwell=ordering.release_dwell,
                budget=pp.cell.SequenceBudget(options=ordering.options),
                order=[pick.name for pick in chosen] if ordering.file_order else None,
                workers=workers,
                progress=progress,
            )
    except pp.cell.SequenceInterrupted as error:
        if error.result is None or not error.result.steps:
            raise Interrupted from None
        result, interrupted = error.result, error
    for path in outputs:
        if heat is not None and path.suffix.lower() == ".html":
            pp.cell.write_sequence_page(result, path, heat_map=heat)
        else:
            pp.cell.save_sequence(result, path)
    if as_json:
        print_json(pp.cell.sequence_dict(result))
    else:
        _print(result)
        if outputs:
            print_line(f"wrote {', '.join(map(str, outputs))}")
    if interrupted is not None:
        raise Interrupted(str(interrupted), result_printed=True)
    if not result.ok:
        raise typer.Exit(1)


def refuse_problems(file: Path, picks: pp.Picks) -> None:
    """Raise InputError if a row of a picks file is unreadable."""
    if picks.problems:
        first = picks.problems[0]
        raise InputError(f"{file}: {first.name or f'row {first.row}'}: {first.reason}")


def _names(text: str | None) -> list[str]:
    return [] if text is None else [name.strip() for name in text.split(",") if name.strip()]


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None]]:
    words = {"options": "grasps and lines", "motions": "certified motions", "shorten": "shorter motions"}
    with progress_status("sequence") as show:
        yield lambda work, done, total: show(f"{words.get(work, work)}: {done} of {total}")


def _print(result: pp.cell.SequenceResult) -> None:
    times = pp.cell.cycle_time(result)
    for number, each in enumerate(times.picks[:SHOWN], start=1):
        print_line(f"{number:4} {each.name:20} at {each.start:8.2f} s, {each.duration:6.2f} s")
    if len(times.picks) > SHOWN:
        print_line(f"     and {len(times.picks) - SHOWN} more picks")
    print_line(result.message)
    if not result.steps:
        _print_left_out(result)
        return
    print_line(
        f"lower bound {result.lower_bound:.2f} s, motions {result.moving:.2f} s; bounds of the file order "
        f"{result.file_order:.2f} s and of the nearest neighbour {result.nearest_neighbour:.2f} s"
    )
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in times.utilisation.items())
    print_line(f"utilisation: {shares}")
    for each in times.slowest(SLOWEST):
        print_line(f"slow: {each.name}, {each.duration:.2f} s, limited by {each.limited_by}")
    from pinproof.model.limits import guess_note  # loads the kinematics

    if guess := guess_note(result.setup.checker.arm.limits.acceleration_source):
        print_note(guess)
    _print_left_out(result)


def _print_left_out(result: pp.cell.SequenceResult) -> None:
    for each in result.left_out:
        print_line(f"left out: {each.name}: {each.reason}")
