"""``pinproof compile``: the compiled kernels of this machine, made ahead, several at a time.

A kernel compiles when it is first called, one after the other: a minute and a half for all that a pick needs. Made
ahead by processes of their own they share the cores; a kernel that two of them need is made by one, the other waits.
"""

from __future__ import annotations

import logging
import os
import platform
import sys
import time
from collections.abc import Callable
from multiprocessing import connection, get_context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import pinproof as pp
from pinproof.cli.console import print_json, remark, say
from pinproof.cli.options import Json

if TYPE_CHECKING:
    from multiprocessing.context import SpawnProcess

__all__ = ["compile_ahead", "compile_kernels", "hush"]

ALL_OF_IT = 100.0
"""Seconds that one core of 2024 takes for all jobs; for the estimate that is told, and for nothing else."""

ROBOT = "ur5"


def compile_kernels(
    processes: Annotated[
        int | None, typer.Option(help="How many work at a time; by default one for each core.", min=1)
    ] = None,
    as_json: Json = False,
) -> None:
    """Compile for this machine, ahead and on all its cores, what would else be compiled when it is first needed.

    What is compiled is kept, so that this is done once, and again after an update.

    Example: pinproof compile
    """
    begun = time.monotonic()
    failed = _run_jobs(processes or _cores())
    if failed:
        raise RuntimeError(f"could not be compiled: {', '.join(failed)}; without it, pinproof says more")
    seconds = time.monotonic() - begun
    folder = _mark()
    if as_json:
        print_json({"ok": True, "seconds": seconds, "folder": None if folder is None else str(folder)})
    else:
        kept = f"kept in {folder}" if folder is not None else "but no folder can be written to, so nothing is kept"
        say(f"compiled {', '.join(JOBS)}: {seconds:.0f} s; {kept}")


def compile_ahead() -> None:
    """Before long work: compile on all cores what is not compiled yet; what cannot be is compiled as it is needed."""
    stamp = _stamp()
    if stamp is None or stamp.exists() or _cores() < 2:
        return
    at_a_time = min(_cores(), len(JOBS))
    remark(f"compiling for this machine, once, in {at_a_time} processes: about {ALL_OF_IT / at_a_time:.0f} s ...")
    if not _run_jobs(at_a_time):
        _mark()


def hush() -> None:
    """Tell of compilation in one line, with what to expect, and not of every kernel."""
    logger = logging.getLogger("pinproof")
    if not any(isinstance(one, _OnlyTheFirst) for one in logger.filters):
        logger.addFilter(_OnlyTheFirst())


class _OnlyTheFirst(logging.Filter):
    def __init__(self) -> None:
        super().__init__()
        self._told = False

    def filter(self, record: logging.LogRecord) -> bool:
        if not str(record.msg).startswith("pinproof: compiling"):
            return True
        first, self._told = not self._told, True
        record.msg = "pinproof: compiling for this machine, %.0s%.0s%s: up to a minute and a half in all ..."
        return first


def _closed_form() -> None:
    arm = pp.load_robot(ROBOT).arm()
    target = arm.forward_kinematics(arm.home)
    solver = pp.AnalyticIk()
    solver.solve_all(arm, target)
    solver.solve_all_batch(arm, target.homogeneous[None])


def _search() -> None:
    arm = pp.load_robot(ROBOT).arm()
    pp.Clik().solve(arm, arm.forward_kinematics(arm.home), rng=0)
    arm.forward_kinematics_batch(arm.home[None])


def _lines() -> None:
    arm = pp.load_robot(ROBOT).arm()
    pp.track(arm, [arm.forward_kinematics(arm.home)] * 2, arm.home, dt=0.1)


def _proofs() -> None:
    from pinproof.picks.judging.configurations import manipulability

    arm = pp.load_robot(ROBOT).arm()
    scene = pp.Scene([pp.Obstacle("box", pp.Box(0.1, 0.1, 0.1), pp.pose((0.9, 0.0, 0.9)))])
    checker = pp.CollisionChecker(arm, scene, margin=0.001)
    goal = arm.home.copy()
    goal[0] += 1.0
    checker.check(arm.home)
    checker.is_free(arm.home)
    checker.is_free_batch(arm.home[None])
    manipulability(arm, arm.home[None])
    path = pp.RrtConnect().plan(checker, arm.home, goal, rng=0).or_raise().path
    if path is not None:
        smooth = pp.simplify(path, checker, rng=0).path
        pp.certify(pp.time_parametrise(smooth, arm.limits), checker)


JOBS: dict[str, Callable[[], None]] = {
    "the closed form": _closed_form,
    "lines": _lines,
    "the search": _search,
    "planning and proofs": _proofs,
}
"""What is compiled apart from each other, the longest first."""


def _run_jobs(at_a_time: int) -> list[str]:
    """Run every job in a process of its own, so many at a time; the names of those that failed."""
    context = get_context("spawn")  # a fork of a process with threads may hang
    waiting, failed = list(JOBS), []
    running: dict[int, tuple[str, SpawnProcess]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < at_a_time:
                name = waiting.pop(0)
                process = context.Process(target=_job, args=(name,), daemon=True)
                process.start()
                running[process.sentinel] = name, process
            for sentinel in connection.wait(list(running)):
                name, process = running.pop(int(sentinel))  # type: ignore[arg-type]  # as we gave them
                process.join()
                failed += [name] if process.exitcode else []
    except OSError:  # no more processes are allowed here
        failed += waiting
    finally:
        for _, process in running.values():
            process.terminate()
            process.join()
    return failed


def _job(name: str) -> None:
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one that started this, and that ends it
    logging.disable()
    try:
        JOBS[name]()
    except Exception:  # noqa: BLE001  # whoever needs the kernel meets it again, with a traceback of its own
        sys.exit(1)


def _cores() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on Linux
        return os.cpu_count() or 1


def _stamp() -> Path | None:
    """The file that says that all jobs were run here, by this Python and numba."""
    import numba

    from pinproof.kernels.compiled import CACHE

    made_by = f"{sys.implementation.cache_tag}-numba{numba.__version__}-{platform.machine()}"
    return None if CACHE is None else CACHE / f"ahead.{made_by}"


def _mark() -> Path | None:
    stamp = _stamp()
    if stamp is None:
        return None
    stamp.touch()
    return stamp.parent
