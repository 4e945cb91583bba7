"""The stages of a search for a placement: each computes rows in any number of workers, and can be resumed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pinproof.common.files import os_errors
from pinproof.errors import CampaignError, InputError
from pinproof.picks.batch.journal import (
    JOURNAL,
    ROWS,
    SCHEMA,
    Journal,
    read_header,
    refuse_foreign,
    row_checker,
    to_line,
)
from pinproof.picks.batch.workers import IN_FLIGHT, LocalWorkers, Outcome, Workers, do_chunks

Row = dict[str, Any]
Progress = Callable[[str, int, int], object]
"""Called with the name of the stage, the number of finished items, and the number of all items."""


@dataclass(eq=False)
class StageRunner:
    """Runs the stages of one search. As a context, it ends its local processes, which serve all stages.

    Parameters
    ----------
    identity
        What the rows depend on, as plain values.
    executor, workers, in_flight
        As for :func:`pinproof.validate_picks`; without them the work is done in this process.
    folder
        Where the rows are kept; None for memory only.
    progress
        Reports the progress.
    """

    identity: Mapping[str, Any]
    executor: Workers | None = None
    workers: int | None = None
    in_flight: int = IN_FLIGHT
    folder: Path | None = None
    progress: Progress | None = None
    rows: dict[str, dict[int, Any]] = field(default_factory=dict)
    """The rows of each stage that are known so far, by index."""
    _local: LocalWorkers | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if self.workers is not None:
            if self.executor is not None:
                raise InputError("workers is the number of local processes and cannot be combined with an executor")
            self._local = LocalWorkers(self.workers)

    def __enter__(self) -> StageRunner:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._local is not None:
            self._local.close(wait_for_them=kind is None)

    def run(
        self,
        stage: str,
        task: Callable[[int, Any], list[Any]],
        items: Sequence[Any],
        chunk: int,
        *,
        in_memory: bool = False,
    ) -> list[Any]:
        """The rows ``task(start, part)`` of all items, in order.

        The rows of a stage do not depend on the division into chunks. Without a folder, or ``in_memory``, they are of
        any type. With one, they are dictionaries, which may have the key ``keep`` with a value that stays in memory.
        """
        known = self.rows[stage] = {}
        if self.folder is None or in_memory:
            for outcome in self._work(task, items, [(0, len(items))], chunk):
                known.update(enumerate(outcome.result, outcome.start))
                self._report(stage, len(known), len(items))
            return [known[index] for index in range(len(items))]
        folder = self.folder / stage
        header = {"schema": SCHEMA, "picks": len(items), "setup": {"stage": stage, **self.identity}}
        with os_errors(folder, "cannot be created"):
            folder.mkdir(parents=True, exist_ok=True)
        rows_path, journal_path = folder / ROWS, folder / JOURNAL
        if rows_path.exists() and not journal_path.exists():
            refuse_foreign(rows_path, read_header(rows_path), header)
            rows_path.rename(journal_path)
        with Journal(folder, header) as journal:
            known.update(_read(journal_path))
            for index in [index for index in known if not journal.done[index]]:
                del known[index]
            for outcome in self._work(task, items, journal.missing(), chunk):
                plain = [{key: value for key, value in row.items() if key != "keep"} for row in outcome.result]
                journal.append(
                    outcome.start, [to_line({"index": outcome.start + k, **row}) for k, row in enumerate(plain)]
                )
                known.update(enumerate(outcome.result, outcome.start))
                self._report(stage, len(known), len(items))
            journal.finish()
        return [known[index] for index in range(len(items))]

    def _work(
        self,
        task: Callable[[int, Any], list[Any]],
        items: Sequence[Any],
        ranges: Sequence[tuple[int, int]],
        chunk: int,
    ) -> Iterator[Outcome]:
        executor = self.executor or self._local
        if executor is None:
            for start, stop in ranges:
                for at in range(start, stop, chunk):
                    end = min(at + chunk, stop)
                    yield Outcome(at, end, task(at, items[at:end]))
            return
        work = do_chunks(
            task,
            lambda start, stop: items[start:stop],
            ranges,
            executor=executor,
            in_flight=self.in_flight,
            chunk=chunk,
        )
        with closing(work) as outcomes:
            for outcome in outcomes:
                if outcome.crashed:
                    raise CampaignError(f"every worker process that worked on item {outcome.start} alone died")
                yield outcome

    def _report(self, stage: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(stage, done, total)


def _read(path: Path) -> dict[int, Row]:
    """The valid rows of a journal."""
    with os_errors(path), path.open("rb") as file:
        read = row_checker(file.readline())
        rows = [row for line in file if (row := read(line)) is not None]
    return {int(row.pop("index")): row for row in rows}
