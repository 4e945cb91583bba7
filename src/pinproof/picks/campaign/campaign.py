"""A campaign: any number of picks, judged by any number of workers, with the rows written to disk; and its result."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.typing as npt

from pinproof.collision import Scene
from pinproof.common.validation import require_integer
from pinproof.errors import CampaignError, FileError, InputError
from pinproof.model import Arm
from pinproof.picks.campaign.chunks import Outcome
from pinproof.picks.campaign.journal import (
    JOURNAL,
    ROWS,
    SCHEMA,
    Journal,
    LineFile,
    is_to_retry,
    read_header,
    refuse_foreign,
    row_checker,
    to_line,
)
from pinproof.picks.campaign.rows import Judge, RowTask, code_here, crashed_row, judge_row, judge_words
from pinproof.picks.campaign.worker_pool import IN_FLIGHT, Workers, do_chunks
from pinproof.picks.pick import Picks
from pinproof.picks.setup import PickSetup
from pinproof.picks.source import PickSource, as_source
from pinproof.picks.verdict import PickStatus

__all__ = [
    "TIMINGS",
    "Campaign",
    "CampaignResult",
]


@dataclass(frozen=True)
class CampaignResult:
    """The rows of a campaign, which stay on disk.

    Parameters
    ----------
    path
        The file of the rows, in the order of the picks: JSON lines after a header.
    verdicts
        How many rows have each verdict.
    failed_at
        How many fail at each stage; those that crashed at none.
    acceleration_source
        Where the acceleration limits of the timing came from.
    notes
        What no verdict covers, in sentences.
    resumed
        How many of the rows existed when the campaign was resumed; 0 if it ran without interruption.
    damaged
        How many rows were damaged or edited when the campaign was resumed; their picks were judged again.
    to_retry
        How many picks crashed because their workers died or ran out of memory; another run judges these again.
    """

    path: Path
    verdicts: dict[str, int]
    failed_at: dict[str, int]
    acceleration_source: str
    notes: tuple[str, ...]
    resumed: int = 0
    damaged: int = 0
    to_retry: int = 0

    @classmethod
    def open(cls, folder: str | Path, *, resumed: int = 0, damaged: int = 0) -> CampaignResult:
        """The result in the folder of a campaign that is done.

        Raises
        ------
        CampaignError
            If the campaign is not done, or there is none.
        FileError
            If the file cannot be read or is damaged.
        """
        path = Path(folder) / ROWS
        if not path.exists():
            begun = (Path(folder) / JOURNAL).exists()
            raise CampaignError(f"{folder}: " + ("this campaign is not done yet; run it again" if begun else "no rows"))
        header = read_header(path)
        verdicts: Counter[str] = Counter()
        failed_at: Counter[str] = Counter()
        to_retry = 0
        for row in _rows(path):
            verdicts[str(row.get("verdict"))] += 1
            if row.get("failed_at") is not None:
                failed_at[str(row["failed_at"])] += 1
            to_retry += is_to_retry(row)
        if verdicts.total() != header["picks"]:
            raise FileError(path, f"has {verdicts.total()} rows of {header['picks']}; run the campaign again")
        return cls(
            path,
            dict(verdicts),
            dict(failed_at),
            header["acceleration_source"],
            tuple(header["notes"]),
            resumed,
            damaged,
            to_retry,
        )

    def rows(self) -> Iterator[dict[str, Any]]:
        """The rows in order, each read when it is asked for."""
        return _rows(self.path)

    @property
    def total(self) -> int:
        """How many rows there are."""
        return sum(self.verdicts.values())

    @property
    def good(self) -> int:
        """How many are good."""
        return self.verdicts.get(PickStatus.GOOD.value, 0)

    @property
    def ok(self) -> bool:
        """Whether every row is good, and there is one."""
        return 0 < self.good == self.total

    @property
    def summary(self) -> str:
        """One line: how many are good, and where the others fail."""
        places = dict(self.failed_at)
        if crashed := self.total - self.good - sum(places.values()):
            places["no stage (crashed)"] = crashed
        failed = ", ".join(f"{count} at {stage}" for stage, count in places.items())
        return f"{self.good} of {self.total} picks good" + (f"; failed: {failed}" if failed else "")

    def to_dict(self) -> dict[str, Any]:
        """All but the rows, as plain values for JSON."""
        return {
            "schema": "pinproof/campaign-summary/1",
            "rows": str(self.path),
            "summary": self.summary,
            "ok": self.ok,
            "total": self.total,
            "resumed": self.resumed,
            "damaged": self.damaged,
            "to_retry": self.to_retry,
            "verdicts": self.verdicts,
            "failed_at": self.failed_at,
            "acceleration_source": self.acceleration_source,
            "notes": list(self.notes),
        }


def _rows(path: Path) -> Iterator[dict[str, Any]]:
    try:
        with path.open("rb") as file:
            read = row_checker(file.readline())
            for index, line in enumerate(file):
                row = read(line)
                if row is None or row["index"] != index:
                    said = "is damaged or was edited; run the campaign again to judge its pick again"
                    raise FileError(path, said, f"line {index + 2}")
                yield row
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error


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
        The picks: a list, or a source of which nothing is held in memory (:func:`pinproof.picks.open_picks`,
        :class:`pinproof.picks.PickGrid`). Rows that could not be read are rows of the result too.
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
        require_integer("rng", rng, 0)
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
