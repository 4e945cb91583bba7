"""Measuring picks: a pick through all stages, and screening."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.picks_problems import PickCell
from pinproof.picks import PickList, PickSetup, ScreenStatus, screen_picks
from pinproof.picks.batch.screening import Screening

__all__ = ["ScreenRow", "VerdictRow", "screen_rows", "verdict_rows"]

Array = npt.NDArray[np.float64]

WARM = 4
"""Picks judged before any is timed: they load what is compiled."""

REPEATS = 3
"""Of each measurement of screening; the quickest counts."""

CHUNK = 4096
"""Poses handed over at a time, as screen_picks does."""


@dataclass(frozen=True)
class VerdictRow:
    """The picks of a cell with one verdict (``"all"``: all of them): how many, and ms for one of them."""

    cell: str
    verdict: str
    picks: int
    mean_ms: float
    median_ms: float
    p95_ms: float
    largest_ms: float


@dataclass(frozen=True)
class ScreenRow:
    """Screening in a cell: poses a second on one core.

    Parameters
    ----------
    cell, poses, count
        Where, of which kind, how many.
    free
        The share that is free.
    rate, with_clearance
        A second; and with the clearance of what is free.
    reach_only
        A second without any look at contact.
    as_picks
        Picks a second, given as such in place of an array of poses; None where the poses are no picks.
    two_threads
        Poses a second by two threads.
    """

    cell: str
    poses: str
    count: int
    free: float
    rate: float
    with_clearance: float
    reach_only: float
    as_picks: float | None
    two_threads: float


def verdict_rows(cell: PickCell, count: int, seed: int) -> list[VerdictRow]:
    """Judge random picks one by one, each through all stages, on one core."""
    picks = cell.picks(count, seed)
    setup = PickSetup.make(cell.arm, cell.scene, picks, home=None, rng=seed)
    for index, pick in enumerate(cell.picks(WARM, seed + 1)):
        setup.judge(index, pick)
    took: dict[str, list[float]] = {"all": []}
    for index, pick in enumerate(picks):
        begun = time.perf_counter()
        verdict = setup.judge(index, pick)
        seconds = time.perf_counter() - begun
        for name in ("all", verdict.status.value):
            took.setdefault(name, []).append(1e3 * seconds)
    return [_verdict_row(cell.name, name, np.array(times)) for name, times in took.items()]


def _verdict_row(cell: str, verdict: str, times: Array) -> VerdictRow:
    middle, late = np.percentile(times, (50, 95)).tolist()
    return VerdictRow(cell, verdict, len(times), float(times.mean()), middle, late, float(times.max()))


def screen_rows(cell: PickCell, count: int, seed: int) -> Iterator[ScreenRow]:
    """Screen random poses: of picks, and of random configurations."""
    how: dict[str, Any] = {"tip": cell.shared.tip, "tool": cell.shared.open_tool, "margin": cell.shared.margin}
    picks = PickList(cell.picks(count, seed))
    setup = PickSetup.make(cell.arm, cell.scene, picks.shared, home=None, rng=seed)
    blind = Screening(_Blind(setup.checker), setup.home, why=False)  # type: ignore[arg-type]  # all that it asks for
    after = np.linalg.inv(cell.shared.tip.homogeneous)
    before = np.linalg.inv(cell.arm.root_from_base.homogeneous)
    for kind, poses in (("of picks", cell.poses(count, seed)), ("anywhere", cell.everywhere(count, seed))):
        targets = np.ascontiguousarray(before @ poses @ after)

        def screened(poses: Array = poses, **more: Any) -> Any:
            return screen_picks(cell.arm, cell.scene, poses, home=setup.home, **how, **more)

        def reached(targets: Array = targets) -> None:
            for start in range(0, count, CHUNK):
                blind.look(targets[start : start + CHUNK])

        def of_picks() -> None:
            screen_picks(cell.arm, cell.scene, picks, home=setup.home)

        yield ScreenRow(
            cell.name,
            kind,
            count,
            screened().counts[ScreenStatus.FREE] / count,
            count / _quickest(screened),
            count / _quickest(lambda call=screened: call(clearance=True)),  # type: ignore[misc]
            count / _quickest(reached),
            count / _quickest(of_picks) if kind == "of picks" else None,
            count / _quickest(lambda call=screened: call(threads=2)),  # type: ignore[misc]
        )


def _quickest(call: Callable[[], Any]) -> float:
    took = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        call()
        took.append(time.perf_counter() - begun)
    return min(took)


class _Blind:
    """In place of a checker: nothing is ever in contact."""

    def __init__(self, checker: Any) -> None:
        self.arm, self.scene = checker.arm, checker.scene

    def is_free_batch(self, Q: Array) -> npt.NDArray[np.bool_]:
        return np.ones(len(Q), dtype=bool)
