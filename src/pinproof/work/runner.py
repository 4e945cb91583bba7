"""Long work in stages: each stage computes one row per item in any number of workers, and can be resumed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.errors import CampaignError, InputError
from pinproof.work.executors import IN_FLIGHT, LocalWorkers, Outcome, Workers, do_chunks
from pinproof.work.journal import Journal, ranges_missing, to_line

SCHEMA = "pinproof/work/1"

Progress = Callable[[str, int, int], object]
"""Called with the name of the stage, the number of finished items, and the number of all items."""


class Runner:
    """Runs the stages of one search; a context that ends its local processes, which serve all stages.

    Parameters
    ----------
    identity
        What the rows depend on, as texts by name.
    executor, workers, in_flight
        As for :func:`pinproof.validate_picks`; without executor and workers the work is done in this process.
    folder
        Where the rows are kept; None for memory only.
    progress
        Reports the progress.
    """

    def __init__(
        self,
        identity: Mapping[str, Any] | None = None,
        *,
        executor: Workers | None = None,
        workers: int | None = None,
        in_flight: int = IN_FLIGHT,
        folder: str | Path | None = None,
        progress: Progress | None = None,
    ) -> None:
        if workers is not None and executor is not None:
            raise InputError("workers is the number of local processes and cannot be combined with an executor")
        self._local = None if workers is None else LocalWorkers(workers)
        self._executor, self._in_flight = executor or self._local, in_flight
        self._identity, self._folder = dict(identity or {}), None if folder is None else Path(folder)
        self._progress, self._open = progress, ExitStack()
        self._journal: Journal | None = None
        self.rows: dict[str, dict[int, Any]] = {}
        """The rows of each stage that are known so far, by index."""

    def __enter__(self) -> Runner:
        if self._folder is not None:
            self._journal = self._open.enter_context(Journal(self._folder, {"schema": SCHEMA, "setup": self._identity}))
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._open.close()
        if self._local is not None:
            self._local.close(wait_for_them=kind is None)

    def run(
        self,
        stage: str,
        task: Callable[[int, Any], list[Any]],
        items: Sequence[Any],
        chunk: int | None = None,
        *,
        in_memory: bool = False,
    ) -> list[Any]:
        """The rows ``task(start, part)`` of all items, in order.

        The default ``chunk`` is one item in this process, and about one second of work for other workers.
        The rows of a stage do not depend on the division into chunks. Without a folder, or ``in_memory``, they are of
        any type. With one, they are dictionaries, which may have the key ``keep`` with a value that stays in memory.
        """
        # Rows of an earlier run are not computed again
        known = self.rows[stage] = {}
        journal = None if in_memory else self._journal
        done = np.zeros(len(items), dtype=bool)
        if journal is not None:
            known.update((index, row) for index, row in journal.rows(stage) if index < len(items))
            done[list(known)] = True
        for outcome in self._outcomes(task, items, ranges_missing(done), chunk):
            known.update(enumerate(outcome.result, outcome.start))
            if journal is not None:
                plain = [{key: value for key, value in row.items() if key != "keep"} for row in outcome.result]
                journal.append(
                    outcome.start,
                    [to_line({"index": index, **row}) for index, row in enumerate(plain, outcome.start)],
                    stage,
                )
            self.report(stage, len(known), len(items))
        return [known[index] for index in range(len(items))]

    def report(self, stage: str, done: int, total: int) -> None:
        """Report the progress of a stage."""
        if self._progress is not None:
            self._progress(stage, done, total)

    def _outcomes(
        self,
        task: Callable[[int, Any], list[Any]],
        items: Sequence[Any],
        ranges: Sequence[tuple[int, int]],
        chunk: int | None,
    ) -> Iterator[Outcome]:
        # In this process, chunk by chunk, so that progress is reported
        if self._executor is None:
            size = chunk or 1
            for start, stop in ranges:
                for first in range(start, stop, size):
                    last = min(first + size, stop)
                    yield Outcome(first, last, task(first, items[first:last]))
            return
        chunks = do_chunks(
            task,
            lambda start, stop: items[start:stop],
            ranges,
            executor=self._executor,
            in_flight=self._in_flight,
            chunk=chunk,
        )
        with closing(chunks) as outcomes:
            for outcome in outcomes:
                if outcome.crashed:
                    name = repr(getattr(items[outcome.start], "name", outcome.start))
                    raise CampaignError(f"every worker process that worked on item {name} alone died")
                yield outcome
