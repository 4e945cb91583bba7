"""Measuring campaigns: what a second worker adds, and what the machinery costs beside the judging."""

from __future__ import annotations

import logging
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.benchmarks.picks_problems import PickCell
from pinproof.picks import Campaign, Pick, PickSetup

__all__ = ["CampaignRow", "campaign_rows", "machinery_row", "say_nothing"]

WARM = 64
"""Picks of a first campaign."""

SETTLED, ENDING = 0.2, 0.9
"""The steady rate is that between these shares of the picks: all workers have started, none is through."""


@dataclass(frozen=True)
class CampaignRow:
    """A campaign: who judged, how many picks, s in all from ``run`` to the ordered file, and picks a second.

    ``steady`` is the rate once all workers are at work.
    """

    cell: str
    workers: str
    picks: int
    wall_s: float
    whole: float
    steady: float


def campaign_rows(cell: PickCell, count: int, seed: int) -> Iterator[CampaignRow]:
    """The same random picks judged by one process, by two, and by two of Dask's if it is installed."""
    warm = Campaign(cell.arm, cell.scene, cell.picks(min(count, WARM), seed), rng=seed)
    _run(warm, cell.name, "", workers=2)  # not told: it fills the caches of compiled code and of files
    campaign = Campaign(cell.arm, cell.scene, cell.picks(count, seed), rng=seed)
    for workers in (1, 2):
        yield _run(campaign, cell.name, "1 process" if workers == 1 else "2 processes", workers=workers)
    with _two_of_dask() as executor:
        if executor is not None:
            yield _run(campaign, cell.name, "Dask, 2 processes", executor=executor, in_flight=4)


def machinery_row(cell: PickCell, count: int, seed: int) -> CampaignRow:
    """A campaign whose judge does nothing: what is left is what the machinery costs."""
    made = Campaign(cell.arm, cell.scene, cell.picks(count, seed), rng=seed, judge=say_nothing)
    return _run(made, cell.name, "1 process, no judging", workers=1)


def say_nothing(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    """The row of a pick that was not looked at."""
    del setup, index
    return {"name": pick.name, "verdict": "not found", "failed_at": "input"}


def _run(campaign: Campaign, cell: str, who: str, **how: Any) -> CampaignRow:
    at: list[tuple[float, int]] = []
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        campaign.run(Path(folder), progress=lambda done, _: at.append((time.perf_counter(), done)), **how)
        wall = time.perf_counter() - begun
    return CampaignRow(cell, who, len(campaign), wall, len(campaign) / wall, _steady(at, len(campaign)))


def _steady(at: list[tuple[float, int]], count: int) -> float:
    """Picks a second between the chunks that came when the shares above were done; over all of it if there are few."""
    times, done = np.array(at).T
    first, last = np.searchsorted(done, (SETTLED * count, ENDING * count)).tolist()
    if last <= first:
        first, last = 0, len(done) - 1
    return float((done[last] - done[first]) / (times[last] - times[first]))


@contextmanager
def _two_of_dask() -> Iterator[Any]:
    """An executor of two processes of one thread each; None where Dask is not installed."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        yield None
        return
    with (
        tempfile.TemporaryDirectory() as scratch,
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None,
            local_directory=scratch, silence_logs=logging.ERROR,
        ) as cluster,
        Client(cluster) as client,
    ):  # fmt: skip
        client.wait_for_workers(2, timeout=60)
        yield client.get_executor()
