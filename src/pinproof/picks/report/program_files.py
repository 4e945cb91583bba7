"""The programs of several picks of a report or a sequence, as files of the language of a robot controller."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from pinproof.common.files import write_text_whole
from pinproof.motion import MotionProgram, find_dialect
from pinproof.picks.input.pick import Pick
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.report.program_export import ExportedProgram, NoMoves, export_picks

FEW_MOVES, LONGER = 12, 1.1
"""Moves of a program, and its duration by that of the certified motion, above which a note states it."""


def write_programs(
    folder: str | Path,
    language: str,
    picks: Sequence[tuple[PickSetup, Pick, MotionProgram]],
    *,
    output: str | None = None,
    deviation: float | None = None,
    main: bool = False,
) -> tuple[tuple[ExportedProgram, ...], list[str]]:
    """Write each pick as a program of a robot controller, if what its text executes is proven.

    Parameters
    ----------
    folder
        The existing folder.
    language, output, deviation
        As for :func:`pinproof.picks.export_picks`; by default the output of the picks file, or of the language.
    picks
        The picks with their programs, each with the set-up in which it is certified.
    main
        Whether a routine ``main`` that calls the programs in this order is written too.

    Returns
    -------
    tuple[tuple[ExportedProgram, ...], list[str]]
        The programs that were written, and what is not covered or not written, in sentences.
    """
    dialect, notes = find_dialect(language), list[str]()
    written, kept = list[ExportedProgram](), list[tuple[MotionProgram, str]]()
    stems = list[str]()  # controllers find a program in the file of its name
    for _, _, program in picks:
        stems.append(dialect.identifier(program.name, stems))
    for (setup, pick, program), stem in zip(picks, stems, strict=True):
        gripper = output or setup.shared.program.output or dialect.outputs
        try:
            made = export_picks(setup, [(pick, program)], language, output=gripper, name=stem, deviation=deviation)
        except NoMoves as error:
            notes.append(f"the {language} program of {stem} is not written: {error}")
            continue
        notes += made.notes
        if not made.free:
            failed = next(proof for proof in made.certificates[0] if not proof.free)
            notes.append(
                f"the {language} program of {stem} is not written: {failed.message}; a smaller assumed deviation "
                "of the controller may help (deviation, --export-deviation)"
            )
            continue
        made.program.save(Path(folder) / f"{stem}{dialect.endings[0]}")
        kept.append((program, stem))
        moves, duration = len(made.program.moves), made.duration
        written.append(ExportedProgram(pick.name, language, moves, duration, made.motion_duration))
        if moves > FEW_MOVES or duration > LONGER * made.motion_duration:
            notes.append(f"the {language} program of {stem} is long: {written[-1]}")
    if main and kept:
        gaps = [after.name for (before, _), (after, _) in pairwise(kept) if not before.leads_to(after)]
        notes += [
            f"no main is written: the program of {name} starts elsewhere than the one before it ends" for name in gaps
        ]
        if not gaps:
            write_text_whole(Path(folder) / f"main{dialect.endings[0]}", dialect.main([stem for _, stem in kept]))
    return tuple(written), notes
