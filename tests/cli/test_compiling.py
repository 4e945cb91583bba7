"""``pinproof compile``, and the compilation of kernels in separate processes before long computations."""

from __future__ import annotations

import logging
import os
import signal
import sys
from pathlib import Path

import pytest

from pinproof.cli import compiling

from ..processes import PATIENCE, RUN_CLI, started, wait_for


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[int]:
    """The requested number of processes of each run of jobs; the cache is ``tmp_path``."""
    request: list[int] = []

    def run_jobs(at_a_time: int) -> list[str]:
        request.append(at_a_time)
        return []

    monkeypatch.setattr("pinproof.kernels.compiled.CACHE", tmp_path)
    monkeypatch.setattr(compiling, "_run_jobs", run_jobs)
    monkeypatch.setattr(compiling, "_cores", lambda: 3)
    return request


def test_compilation_runs_once_and_prints_one_line(runs: list[int], capsys: pytest.CaptureFixture[str]) -> None:
    compiling.compile_ahead()
    compiling.compile_ahead()
    assert runs == [3]
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "3 processes: about 33 s" in err


def test_a_failed_job_is_run_again(runs: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    run_jobs = compiling._run_jobs
    monkeypatch.setattr(compiling, "_run_jobs", lambda at_a_time: [*run_jobs(at_a_time), "lines"])
    compiling.compile_ahead()
    compiling.compile_ahead()
    assert runs == [3, 3]


@pytest.mark.parametrize("reason", ["one core", "nothing can be kept"])
def test_compilation_ahead_is_skipped_without_a_benefit(
    runs: list[int], reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if reason == "one core":
        monkeypatch.setattr(compiling, "_cores", lambda: 1)
    else:
        monkeypatch.setattr("pinproof.kernels.compiled.CACHE", None)
    compiling.compile_ahead()
    assert runs == []


@pytest.mark.slow
def test_a_failed_job_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "JOBS", {"no such job": compiling.compile_ahead})
    assert compiling._run_jobs(1) == ["no such job"]


def test_many_kernels_are_one_line(caplog: pytest.LogCaptureFixture) -> None:
    compiling.limit_compile_messages()
    logger = logging.getLogger("pinproof")
    for one in logger.filters:
        if isinstance(one, compiling._FirstCompileMessage):
            one._logged = False
    for name in ("near", "sweep"):
        logger.warning("pinproof: compiling %s.%s for this machine, %s ...", "room", name, "once")
    logger.warning("another word")
    first, other = (record.getMessage() for record in caplog.records)
    assert "once" in first
    assert "near" not in first
    assert other == "another word"


@pytest.mark.slow
def test_ctrl_c_ends_every_process(tmp_path: Path) -> None:
    command = [sys.executable, "-c", RUN_CLI, "compile", "--processes", "2"]
    with started(command, env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}) as begun:
        wait_for(lambda: len(list((tmp_path / "pinproof").rglob("*.lock"))) >= 2, by=begun)  # both are at work
        os.killpg(begun.pid, signal.SIGINT)
        out, err = begun.communicate(timeout=PATIENCE)  # which waits for all that hold these pipes
    assert (begun.returncode, out) == (130, "")
    assert err.startswith("pinproof: interrupted")
    assert err.count("\n") == 1
