"""A campaign: as many picks as there are, judged by any number of workers, their rows streamed to disk."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy.typing as npt

from pinproof.collision import Scene
from pinproof.errors import FileError, InputError
from pinproof.ik.settings import whole
from pinproof.model import Arm
from pinproof.picks.campaign.chunks import Outcome
from pinproof.picks.campaign.code import code_here, judge_words
from pinproof.picks.campaign.crew import IN_FLIGHT, Workers, do_chunks
from pinproof.picks.campaign.journal import JOURNAL, ROWS, SCHEMA, Journal, read_header, refuse_foreign, to_line
from pinproof.picks.campaign.line_file import LineFile
from pinproof.picks.campaign.result import CampaignResult
from pinproof.picks.campaign.rows import Judge, RowTask, crashed_row, judge_row
from pinproof.picks.pick import Picks
from pinproof.picks.setup import PickSetup
from pinproof.picks.source import PickSource, as_source

__all__ = ["TIMINGS", "Campaign"]

TIMINGS = "timings.jsonl"
"""Beside the rows: which chunk took how long, and where. Times are never part of a row, which would differ each run."""

KILLED = "every process that judged it, alone, has died of it"


class Campaign:
    """Many picks to be judged, from tens to millions.

    ``run`` may be killed at any time and called again, from another program too: it goes on where it was. The rows are
    the same, byte for byte, for any number of workers and however often it was killed.

    Parameters
    ----------
    arm
        The arm.
    scene
        What stands around it.
    picks
        The picks: a list, or a source of which nothing is held in memory (:func:`pinproof.open_picks`,
        :class:`pinproof.PickGrid`). Rows that could not be read are rows of the result too.
    home
        (n,) where each transit starts; by default the one of the picks, else the arm's.
    rng
        The seed. Each pick has a stream of its own by its place.
    judge
        What judges a pick: ``judge(setup, index, pick)`` gives a row of plain values, which has a ``verdict`` and a
        ``failed_at``; a function that can be imported by name. By default all stages.

    Raises
    ------
    InputError
        If home cannot be a start, or a joint has no velocity limit, or an argument makes no sense.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        picks: Picks | PickSource,
        *,
        home: npt.ArrayLike | None = None,
        rng: int = 0,
        judge: Judge = judge_row,
    ) -> None:
        whole("rng", rng, 0)
        self._picks = as_source(picks)
        self._setup = PickSetup.make(arm, scene, self._picks.shared, home=home, rng=rng)
        self._judge = judge

    def __len__(self) -> int:
        return len(self._picks)

    def header(self) -> dict[str, Any]:
        """The first line of the rows: what the campaign is of, and what its verdicts do not cover."""
        checker = self._setup.checker
        header = {
            "schema": SCHEMA,
            "picks": len(self),
            "setup": {
                "pinproof": code_here(),
                **self._setup.identity(),
                "picks": f"{len(self)} picks {self._picks.digest()}",
                "judge": judge_words(self._judge),
            },
            "acceleration_source": checker.arm.limits.acceleration_source,
            "notes": list(self._setup.not_covered()),
            "excluded_pairs": [[*pair.owners, pair.reason] for pair in checker.excluded],
        }
        return dict(json.loads(to_line(header)))

    def run(
        self,
        folder: str | Path,
        *,
        executor: Workers | None = None,
        workers: int | None = None,
        in_flight: int = IN_FLIGHT,
        chunk: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> CampaignResult:
        """Judge what has not been judged yet, to ``folder/rows.jsonl``.

        A chunk whose worker dies is tried again. A chunk that three workers died of is halved until the pick at fault
        is found; its row says ``crashed``. Such a pick may be innocent if the workers were killed from outside, so each
        further run judges it once more. Rows that are damaged or were edited by hand are judged again too.

        Parameters
        ----------
        folder
            Where the rows are, or shall be; made if need be. Until all are there they stand in ``journal.jsonl``, in
            the order in which they came; ``timings.jsonl`` tells how long they took.
        executor
            Any :class:`concurrent.futures.Executor`, such as ``distributed.Client(...).get_executor()``; or a function
            that makes one, which is called again when it breaks. By default processes of this machine.
        workers
            How many processes, without an executor; by default one a core.
        in_flight
            How many chunks are handed to ``executor`` at a time: twice its workers is right.
        chunk
            How many picks make a chunk; by default about a second of work. It changes no row.
        progress
            Called with (rows there, rows in all) at the start and after each chunk.

        Raises
        ------
        CampaignError
            If ``folder`` holds another campaign, or rows of other code (names the difference), or the workers cannot
            work or have other code.
        FileError
            If the folder cannot be written to; what was judged until then is kept.
        KeyboardInterrupt
            When interrupted; what was judged is kept.
        """
        folder, header = Path(folder), self.header()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            done = (folder / ROWS).exists()
        except OSError as error:
            raise FileError(folder, f"cannot be made a folder: {error.strerror or error}") from error
        if done and (finished := self._finished(folder, header)) is not None:
            return finished
        task = RowTask(self._setup, self._judge)
        with Journal(folder, header) as journal, LineFile(folder / TIMINGS) as timings:
            there = before = int(journal.done.sum())
            if progress is not None:
                progress(there, len(self))
            work = do_chunks(
                task,
                self._picks.part,
                journal.missing(),
                executor=executor,
                workers=workers,
                in_flight=in_flight,
                chunk=chunk,
            )
            with closing(work) as outcomes:
                for outcome in outcomes:
                    journal.append(outcome.start, self._lines(outcome))
                    timings.append(to_line(_timing(outcome)))
                    there += outcome.stop - outcome.start
                    if progress is not None:
                        progress(there, len(self))
            journal.finish()
        return CampaignResult.open(folder, resumed=before, damaged=journal.damaged)

    def _finished(self, folder: Path, header: dict[str, Any]) -> CampaignResult | None:
        """The result of a finished campaign; None if some rows must be judged again, after they were made a journal."""
        rows, journal = folder / ROWS, folder / JOURNAL
        refuse_foreign(rows, read_header(rows), header)
        if journal.exists():  # of a run that was killed between writing the rows and removing the journal
            with LineFile(journal):
                if rows.exists():
                    journal.unlink()
        try:
            result = CampaignResult.open(folder, resumed=len(self))
        except FileError:
            result = None
        if result is not None and not result.to_retry:
            return result
        try:
            rows.rename(journal)
        except OSError as error:
            raise FileError(rows, f"cannot be renamed to {JOURNAL}: {error.strerror or error}") from error
        return None

    def _lines(self, outcome: Outcome) -> list[bytes]:
        if outcome.crashed:
            (item,) = self._picks.part(outcome.start, outcome.stop)
            return [crashed_row(outcome.start, item.name, KILLED, retry=True)]
        lines: list[bytes] = outcome.result
        if len(lines) != outcome.stop - outcome.start:
            raise InputError(f"the source gave {len(lines)} picks for {outcome.start} to {outcome.stop - 1}")
        return lines


def _timing(outcome: Outcome) -> dict[str, Any]:
    return {
        "start": outcome.start,
        "stop": outcome.stop,
        "seconds": round(outcome.seconds, 6),
        "worker": outcome.worker,
    }
