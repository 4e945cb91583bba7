"""``pinproof compile``: compile the numba kernels ahead of their first use, in parallel processes.

A kernel is otherwise compiled when it is first called. Compiled one after the other, all kernels that a pick needs take
about a minute and a half. If two processes need the same kernel, one compiles it and the other waits.
"""

from __future__ import annotations

import logging
import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import pinproof as pp
from pinproof.cli.console import print_json, print_line, print_note
from pinproof.cli.options import Json

if TYPE_CHECKING:
    from multiprocessing.context import SpawnProcess

__all__ = ["compile_ahead", "compile_kernels", "limit_compile_messages"]

TOTAL_SECONDS = 100.0
"""Time that one core of 2024 takes for all jobs; used only for the estimate that is printed."""

ROBOT = "ur5"


def compile_kernels(
    processes: Annotated[
        int | None, typer.Option(help="Number of parallel processes. Default: one for each core.", min=1)
    ] = None,
    as_json: Json = False,
) -> None:
    """Compile all numerical kernels for this machine now, instead of when they are first used.

    The result is cached on disk. Run it once after installation and after an update.

    Example: pinproof compile
    """
    start = time.monotonic()
    failed = _run_jobs(processes or _cores())
    if failed:
        raise RuntimeError(f"compilation failed for: {', '.join(failed)}; the command that uses it reports the cause")
    seconds = time.monotonic() - start
    folder = _mark_compiled()
    if as_json:
        print_json({"ok": True, "seconds": seconds, "folder": None if folder is None else str(folder)})
    else:
        cache = f"cached in {folder}" if folder is not None else "not cached, because no cache folder is writable"
        print_line(f"compiled the kernels of {', '.join(JOBS)} in {seconds:.0f} s; {cache}")


def compile_ahead() -> None:
    """Compile all kernels on all cores before a long computation; a job that fails is compiled when it is used."""
    stamp = _stamp()
    if stamp is None or stamp.exists() or _cores() < 2:
        return
    count = min(_cores(), len(JOBS))
    print_note(
        f"compiling the kernels for this machine (once) in {count} processes: about {TOTAL_SECONDS / count:.0f} s ..."
    )
    if not _run_jobs(count):
        _mark_compiled()


def limit_compile_messages() -> None:
    """Log one message for the compilation of all kernels instead of one for each."""
    logger = logging.getLogger("pinproof")
    if not any(isinstance(each, _FirstCompileMessage) for each in logger.filters):
        logger.addFilter(_FirstCompileMessage())


class _FirstCompileMessage(logging.Filter):
    """Passes the first message about compilation, with an estimate of the total time, and drops the others."""

    def __init__(self) -> None:
        super().__init__()
        self._logged = False

    def filter(self, record: logging.LogRecord) -> bool:
        if not str(record.msg).startswith("pinproof: compiling"):
            return True
        first, self._logged = not self._logged, True
        record.msg = "pinproof: compiling the kernels for this machine (%.0s%.0s%s): up to 90 s in total ..."
        return first


def _analytic_ik() -> None:
    arm = pp.load_robot(ROBOT).arm()
    target = arm.forward_kinematics(arm.home)
    solver = pp.AnalyticIk()
    solver.solve_all(arm, target)
    solver.solve_all_batch(arm, target.homogeneous[None])


def _iterative_ik() -> None:
    arm = pp.load_robot(ROBOT).arm()
    pp.Clik().solve(arm, arm.forward_kinematics(arm.home), rng=0)
    arm.forward_kinematics_batch(arm.home[None])


def _straight_lines() -> None:
    arm = pp.load_robot(ROBOT).arm()
    pp.track(arm, [arm.forward_kinematics(arm.home)] * 2, arm.home, dt=0.1)


def _planning() -> None:
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
    "analytic IK": _analytic_ik,
    "straight lines": _straight_lines,
    "iterative IK": _iterative_ik,
    "planning and certificates": _planning,
}
"""Functions that call all kernels of one topic; the longest compilation comes first."""


def _run_jobs(limit: int) -> list[str]:
    """Run each job in a separate process, at most ``limit`` at the same time; return the names of failed jobs."""
    from multiprocessing import connection, get_context

    context = get_context("spawn")  # a fork of a process with threads may hang
    waiting, failed = list(JOBS), []
    running: dict[int, tuple[str, SpawnProcess]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < limit:
                name = waiting.pop(0)
                process = context.Process(target=_job, args=(name,), daemon=True)
                process.start()
                running[process.sentinel] = name, process
            for sentinel in connection.wait(list(running)):
                name, process = running.pop(int(sentinel))  # type: ignore[arg-type]  # all sentinels are integers
                process.join()
                failed += [name] if process.exitcode else []
    except OSError:  # the system does not allow more processes
        failed += waiting
    finally:
        for _, process in running.values():
            process.terminate()
            process.join()
    return failed


def _job(name: str) -> None:
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles Ctrl-C and terminates this one
    logging.disable()
    try:
        JOBS[name]()
    except Exception:  # noqa: BLE001  # the error occurs again, with its traceback, when the kernel is used
        sys.exit(1)


def _cores() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on Linux
        return os.cpu_count() or 1


def _stamp() -> Path | None:
    """The file whose existence states that all jobs were run with this Python and numba; None without a cache."""
    import numba

    from pinproof.kernels.compiled import CACHE

    version = f"{sys.implementation.cache_tag}-numba{numba.__version__}-{platform.machine()}"
    return None if CACHE is None else CACHE / f"ahead.{version}"


def _mark_compiled() -> Path | None:
    """Create the stamp file; return the cache folder, or None without a cache."""
    stamp = _stamp()
    if stamp is None:
        return None
    stamp.touch()
    return stamp.parent
