"""Several searches of one problem, each with samples of its own; the shortest path of all is the answer."""

from __future__ import annotations

import time
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pinproof.errors import InputError
from pinproof.planning.ends import Ends
from pinproof.planning.result import PlanProgress, PlanResult, PlanStatus, Progress
from pinproof.planning.search import Search

if TYPE_CHECKING:
    from pinproof.planning.rrt_connect import RrtConnect

__all__ = ["best_of"]

TELL_EVERY = 0.1
"""Seconds between two calls of the progress callback while others search."""


def best_of(
    settings: RrtConnect,
    ends: Ends,
    count: int,
    rng: np.random.Generator,
    executor: Executor | None,
    progress: Progress | None,
) -> PlanResult:
    """The shortest path that ``count`` searches find, of equals the one of the first search.

    All of them are waited for, so that the answer depends neither on how many run at a time nor on which is quicker.
    """
    try:
        streams = rng.spawn(count)
    except TypeError as error:
        raise InputError("this Generator cannot be split; make it with numpy.random.default_rng") from error
    if executor is None:
        results = []
        for stream in streams:
            results.append(Search(settings, ends, stream, progress).run())
            if results[-1].status is PlanStatus.CANCELLED:
                break
    else:
        futures = [executor.submit(_search, settings, ends, stream) for stream in streams]
        results = _gathered(futures, progress)
    return replace(_best(results), checker=ends.checker)


def _search(settings: RrtConnect, ends: Ends, rng: np.random.Generator) -> PlanResult:
    """One search in a worker; its checker need not travel back."""
    return replace(Search(settings, ends, rng, None).run(), checker=None)


def _gathered(futures: list[Future[PlanResult]], progress: Progress | None) -> list[PlanResult]:
    """What all workers say; if somebody says to stop, what those said that were through by then.

    A search that has begun in a worker cannot be stopped from here: it ends within its budgets.
    """
    began, waiting = time.monotonic(), set(futures)
    try:
        while waiting:
            _, waiting = wait(waiting, None if progress is None else TELL_EVERY, FIRST_COMPLETED)
            if progress is not None:
                known = [future.result() for future in futures if future.done()]
                nodes, samples = sum(result.nodes for result in known), sum(result.samples for result in known)
                gap = min((result.gap for result in known), default=np.inf)
                if waiting and progress(PlanProgress(nodes, samples, time.monotonic() - began, gap)) is False:
                    message = f"cancelled with {len(known)} of {len(futures)} searches through"
                    seconds = time.monotonic() - began
                    stopped = PlanResult(
                        PlanStatus.CANCELLED,
                        None,
                        None,
                        None,
                        message,
                        nodes,
                        samples=samples,
                        seconds=seconds,
                        gap=gap,
                    )
                    return [*known, stopped]
        return [future.result() for future in futures]
    finally:
        for future in futures:
            future.cancel()


def _best(results: list[PlanResult]) -> PlanResult:
    found = [result for result in results if result.path is not None]
    if found:
        return min(found, key=lambda result: result.path.length if result.path is not None else np.inf)
    if results[-1].status is PlanStatus.CANCELLED:
        return results[-1]
    nearest = min(results, key=lambda result: result.gap)
    return replace(
        nearest, message=f"none of {len(results)} searches found a path; the one that came nearest: {nearest.message}"
    )
