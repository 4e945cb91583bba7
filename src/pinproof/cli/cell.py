"""``pinproof cell sequence`` and ``allocate``: the order of picks and the cycle time, of one arm or of several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import Any

import pinproof as pp
from pinproof.cli.console import Interrupted, check_output_files, print_note, print_result, progress_bar, written
from pinproof.cli.options import Json, Seed, argument, option, placement
from pinproof.cli.pick import CellOptions
from pinproof.errors import InputError, RunInterrupted, UnknownNameError

SHOWN = 20
"""Largest number of picks that are printed; -o writes all of them."""

SLOWEST = 3
"""Number of slowest picks that are printed."""


@dataclass(frozen=True)
class SelectionOptions:
    """Which picks of the file are put in sequence."""

    only: str | None = option(
        'The names of the picks to use, with commas between them: "a,b,c".', None, metavar="NAMES"
    )
    without: str | None = option("The names of picks to leave out, with commas.", None, metavar="NAMES")

    def select(self, picks: pp.Picks) -> tuple[pp.Pick, ...]:
        """The selected picks in the order of the file."""
        known = [pick.name for pick in picks.picks]
        stated = {"--only": _names(self.only), "--without": _names(self.without)}
        for stated_by, names in stated.items():
            for name in names:
                if name not in known:
                    raise UnknownNameError("pick", name, known, stated_by)
        chosen = stated["--only"] if self.only is not None else known
        return tuple(pick for pick in picks.picks if pick.name in chosen and pick.name not in stated["--without"])


@dataclass(frozen=True)
class ConditionOptions:
    """The precedence of picks and the dwell times."""

    before: list[str] | None = option(
        'A pair of picks in a fixed order: "first,second"; can be given several times.', None, metavar="FIRST,SECOND"
    )
    grip_dwell: float = option("Seconds that an arm rests at each grasp.", 0.0, min=0.0)
    release_dwell: float = option("Seconds that an arm rests at each release.", 0.0, min=0.0)

    def settings(self) -> dict[str, Any]:
        """The options as settings of :func:`pinproof.sequence` and :func:`pinproof.cell.allocate`."""
        pairs = []
        for text in self.before or ():
            names = _names(text)
            if len(names) != 2:
                raise InputError(f'--before {text!r} names {len(names)} picks; state two: --before "first,second"')
            pairs.append((names[0], names[1]))
        return {"precedence": pairs, "grip_dwell": self.grip_dwell, "release_dwell": self.release_dwell}


@dataclass(frozen=True)
class OrderOptions:
    """How the order is searched."""

    free_start: bool = option("Start at the first approach instead of home.", False)
    free_end: bool = option("End after the last pick instead of at home.", False)
    file_order: bool = option("Keep the order of the file, and choose only grasps and IK branches.", False)
    options: int = option("Number of grasps and IK branches that are considered for each pick.", 4, min=1)


def cell_sequence(
    file: Path = argument("The picks file (.yaml or a .csv table).", MISSING, metavar="PICKS"),
    *,
    selection: SelectionOptions,
    conditions: ConditionOptions,
    ordering: OrderOptions,
    output: list[Path] | None = option(
        "The sequence as .json, .md, .csv or .html; can be given several times.", None, "-o", "--output", metavar="FILE"
    ),
    heat_map: Path | None = option(
        "Draw the heat map of a placement search (.csv with x, y, share) on the floor of the page.", None
    ),
    seed: Seed = 0,
    workers: int | None = option("Number of parallel processes.", None, min=1),
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
    _refuse_problems(file, picks)
    setup = pp.picks.PickSetup.make(arm, scene, picks, home=None, rng=seed)
    chosen = selection.select(picks)
    interrupted: RunInterrupted | None = None
    try:
        with _progress() as progress:
            result = pp.sequence(
                setup,
                chosen,
                **conditions.settings(),
                start="free" if ordering.free_start else "home",
                end="free" if ordering.free_end else "home",
                budget=pp.cell.SequenceBudget(options=ordering.options),
                order=[pick.name for pick in chosen] if ordering.file_order else None,
                workers=workers,
                progress=progress,
            )
    except RunInterrupted as error:
        if error.result is None or not error.result.steps:
            raise Interrupted from None
        result, interrupted = error.result, error
    for path in outputs:
        if heat is not None and path.suffix.lower() == ".html":
            pp.cell.write_sequence_page(result, path, heat_map=heat)
        else:
            pp.cell.save_sequence(result, path)
    from pinproof.model import guess_note  # loads the kinematics

    if guess := guess_note(setup.checker.arm.limits.acceleration_source):
        print_note(guess)
    ok = result.ok or interrupted is not None
    print_result(pp.cell.sequence_dict(result), [*_lines(result), *written(*outputs)], as_json=as_json, ok=ok)
    if interrupted is not None:
        raise Interrupted(str(interrupted), result_printed=True)


def _refuse_problems(file: Path, picks: pp.Picks) -> None:
    """Raise InputError if a row of a picks file is unreadable."""
    if picks.problems:
        first = picks.problems[0]
        raise InputError(f"{file}: {first.name or f'row {first.row}'}: {first.reason}")


def _names(text: str | None) -> list[str]:
    return [] if text is None else [name.strip() for name in text.split(",") if name.strip()]


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None]]:
    words = {"options": "grasps and lines", "motions": "certified motions", "shorten": "shorter motions"}
    with progress_bar("sequence") as show:
        yield lambda work, done, total: show(words.get(work, work), done, total)


def _lines(result: pp.cell.SequenceResult) -> list[str]:
    times = pp.cell.cycle_time(result)
    lines = [
        f"{number:4} {each.name:20} at {each.start:8.2f} s, {each.duration:6.2f} s"
        for number, each in enumerate(times.picks[:SHOWN], start=1)
    ]
    if len(times.picks) > SHOWN:
        lines.append(f"     and {len(times.picks) - SHOWN} more picks")
    lines += [f"   - {pick.name:20} left out: {pick.reason}" for pick in result.left_out]
    lines.append(result.message)
    if result.steps:
        shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in times.utilisation.items())
        orders = f"{result.file_order:.2f} s and of the nearest neighbour {result.nearest_neighbour:.2f} s"
        lines += [
            f"lower bound {result.lower_bound:.2f} s, motions {result.moving:.2f} s; bounds of the file order {orders}",
            f"utilisation: {shares}",
            *(
                f"slow: {each.name}, {each.duration:.2f} s, limited by {each.limited_by}"
                for each in times.slowest(SLOWEST)
            ),
        ]
    return lines


def _left_out(picks: Iterable[pp.cell.LeftOut]) -> list[str]:
    return [f"left out: {each.name}: {each.reason}" for each in picks]


def cell_allocate(
    file: Path = argument("A picks file for several robots (key robots).", MISSING, metavar="PICKS"),
    *,
    selection: SelectionOptions,
    conditions: ConditionOptions,
    compare: bool = option("Also compute the time that each arm alone takes for all picks.", True),
    output: list[Path] | None = option(
        "A .json, .md or .html file; can be given several times.", None, "-o", "--output", metavar="FILE"
    ),
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
    _refuse_problems(file, picks)
    group = picks.load_cell()
    scene = picks.load_scene()
    chosen = selection.select(picks)
    with progress_bar("allocation") as progress:
        result = pp.cell.allocate(
            group,
            scene,
            replace(picks, picks=chosen),
            **conditions.settings(),
            compare=compare,
            rng=seed,
            progress=progress,
        )
    for path in outputs:
        pp.cell.save_allocation(result, path)
    alone = {each.arm: each.reason if each.duration is None else f"{each.duration:.2f} s" for each in result.alone}
    lines = [
        *(
            f"{each.arm}: {', '.join(each.picks) or 'no pick'}; {each.duration:.2f} s, of which it waits "
            f"{each.waiting:.2f} s"
            for each in result.arms
        ),
        result.message,
        *(f"{arm} alone: {took}" for arm, took in alone.items()),
        *_left_out(result.missing),
        *(f"not covered: {note}" for note in result.notes),
        *written(*outputs),
    ]
    print_result(result.to_dict(), lines, as_json=as_json, ok=result.ok)
