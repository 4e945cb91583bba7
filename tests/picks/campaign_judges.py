"""Judges for tests of campaigns, imported by name in the workers."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import pinproof as pp
from pinproof.picks import GraspCandidate, Pick, PickSetup, PickTask

FLAG = "CAMPAIGN_TEST_FLAG"
"""The variable that names a file by which processes know what another has done."""


def echo(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    """Every pick is good; each row has a random number from the stream of its pick."""
    draw = float(setup.rng(index).random())
    return {"name": pick.name, "verdict": "good", "failed_at": None, "place": index, "draw": draw}


def slow(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    time.sleep(0.01)
    return echo(setup, index, pick)


def no_to_thirds(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    if index % 3 == 0:
        return {"name": pick.name, "verdict": "not found", "failed_at": "reach", "reason": "no"}
    return echo(setup, index, pick)


def raises_on_7(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    return {**echo(setup, index, pick), "share": 1 / (index - 7)}


def nan_on_7(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    return {**echo(setup, index, pick), "share": float("nan") if index == 7 else 0.0}


class Died(BaseException):
    """Raised in place of dying, where the worker is a thread."""


def ends_on_7_and_100(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    if index in (7, 100):
        raise Died
    return echo(setup, index, pick)


def ends_six_times_on_7(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    """Ends the worker six times in all, as a process outside would that kills workers."""
    deaths = Path(os.environ[FLAG])
    if index == 7 and (not deaths.exists() or deaths.stat().st_size < 6):
        with deaths.open("a") as file:
            file.write("x")
        raise Died
    return echo(setup, index, pick)


def memory_error_on_7(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    """Runs out of memory on pick 7 once."""
    if index == 7 and not Path(os.environ[FLAG]).exists():
        Path(os.environ[FLAG]).touch()
        raise MemoryError
    return echo(setup, index, pick)


def ends_always(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    raise Died


def dies_on_7(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    if index == 7:
        with Path(os.environ[FLAG]).open("a") as deaths:
            deaths.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    return echo(setup, index, pick)


def dies_once_on_7(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    if index == 7 and not Path(os.environ[FLAG]).exists():
        Path(os.environ[FLAG]).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return echo(setup, index, pick)


def waits_for_flag(setup: PickSetup, index: int, pick: Pick) -> dict[str, Any]:
    """Picks of the second half wait until the file exists."""
    while index >= 60 and not Path(os.environ[FLAG]).exists():
        time.sleep(0.01)
    return slow(setup, index, pick)


def elbow_up(task: PickTask, candidate: GraspCandidate) -> str | None:
    """A check of configurations at the grasp."""
    height = task.arm.frame_placement(candidate.q, "forearm_link").translation[2]
    return None if height > 0.3 else f"the elbow is at {height:.2f} m"


def never(task: PickTask, candidate: GraspCandidate) -> str | None:
    return f"{task.pick.name} is not wanted"


class Counting:
    """RRT-Connect behind a foreign face; it counts its calls."""

    def __init__(self) -> None:
        self.calls = 0

    def plan(self, checker, start, goals, *, rng=0):
        self.calls += 1
        return pp.RrtConnect().plan(checker, start, goals, rng=rng)
