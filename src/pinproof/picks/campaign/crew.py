"""A task done for every pick, chunk by chunk, by any executor; workers may die."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, wait
from typing import Any

from pinproof.errors import CampaignError, InputError
from pinproof.ik.settings import whole
from pinproof.picks.campaign.chunks import Outcome, Supply
from pinproof.picks.campaign.lane import Lane, Parcel
from pinproof.picks.campaign.local import OneProcess, usable_cores
from pinproof.picks.campaign.worker import Task

__all__ = ["IN_FLIGHT", "Workers", "do_chunks"]

HOPELESS = 10
"""How many picks in a row may be blamed for dead workers while not one was judged."""

Workers = Executor | Callable[[], Executor]
"""An executor, or what makes one: then a broken one is made anew."""

IN_FLIGHT = 64
"""How many chunks are under way at a time in an executor of the caller's, which cannot be asked for its workers: enough
for 32 of them to find the next chunk waiting."""


def do_chunks(
    task: Task,
    part: Callable[[int, int], Any],
    ranges: Iterable[tuple[int, int]],
    *,
    executor: Workers | None = None,
    workers: int | None = None,
    in_flight: int = IN_FLIGHT,
    chunk: int | None = None,
) -> Generator[Outcome, None, None]:
    """Do ``task(start, part(start, stop))`` for chunks that cover the ranges, in the order in which they end.

    Parameters
    ----------
    task
        Goes to each worker once; it pickles.
    part
        Gives what goes with the picks from ``start`` up to ``stop``; it pickles too.
    ranges
        (start, stop) of what is to be done.
    executor
        Where; by default ``workers`` processes of this machine.
    workers
        How many processes, without an executor; by default one a core.
    in_flight
        How many chunks are under way at a time in ``executor``.
    chunk
        How many picks make a chunk; by default about a second of work.

    Raises
    ------
    CampaignError
        If no worker starts, if all workers die whatever they are given, or if an executor that cannot be made anew
        breaks.
    InputError
        If the task cannot be sent to a worker.
    Exception
        Whatever the task raised.
    """
    whole("in_flight", in_flight, 1)
    if chunk is not None:
        whole("chunk", chunk, 1)
    if executor is None:
        count = usable_cores() if workers is None else workers
        whole("workers", count, 1)
        lanes = [Lane(OneProcess, width=1) for _ in range(count)]
    elif workers is not None:
        raise InputError("workers counts the processes of this machine; the executor that is given has its own")
    elif isinstance(executor, Executor):
        lanes = [Lane(lambda: executor, width=in_flight, borrowed=True)]
    else:
        lanes = [Lane(executor, width=in_flight)]
    parcel = _packed(task, part)
    supply = Supply(ranges, in_flight if executor is not None else len(lanes), chunk)
    finished, blamed = False, _Blamed()
    try:
        while True:
            for lane in lanes:
                lane.feed(supply, parcel)
            flying = [future for lane in lanes for future in lane.flying]
            if not flying:
                finished = True
                yield from blamed.all()
                return
            done = wait(flying, return_when=FIRST_COMPLETED).done
            for lane in lanes:
                for future in [future for future in lane.flying if future in done]:
                    for outcome in lane.land(future, parcel):
                        if not outcome.crashed:
                            supply.learn(outcome.stop - outcome.start, outcome.seconds)
                        yield from blamed.sifted(outcome)
    finally:
        for lane in lanes:
            lane.close(wait_for_it=finished)


class _Blamed:
    """Crashed picks, kept back until some other was judged: where none is, it is not the picks that kill workers."""

    def __init__(self) -> None:
        self._kept: list[Outcome] = []
        self._some_judged = False

    def sifted(self, outcome: Outcome) -> Iterator[Outcome]:
        """What may be said now."""
        self._some_judged = self._some_judged or not outcome.crashed
        self._kept.append(outcome)
        if self._some_judged:
            yield from self.all()
        elif len(self._kept) >= HOPELESS:
            raise CampaignError(
                f"each of the first {HOPELESS} picks has killed every process that judged it, and none was judged: it "
                "will not be the picks; is there enough memory for a worker?"
            )

    def all(self) -> Iterator[Outcome]:
        """All that was kept."""
        kept, self._kept = self._kept, []
        yield from kept


def _packed(task: Task, part: Callable[[int, int], Any]) -> Parcel:
    try:
        package = pickle.dumps(task, protocol=pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"what is to be done cannot be sent to a worker ({error}); functions must be importable by name"
        ) from error
    return Parcel(hashlib.sha256(package).hexdigest(), package, part)
