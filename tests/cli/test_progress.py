"""Long commands state what they do, and how long it will take, if stderr is not a terminal."""

import contextlib
import io
import logging
import threading

import pytest

from pinproof.cli import console
from pinproof.cli.console import LongSteps, progress_bar, progress_status
from pinproof.common.steps import LOG, step

Err = pytest.CaptureFixture[str]


class Lines(io.StringIO):
    """A stream that reports when a line was written."""

    def __init__(self) -> None:
        super().__init__()
        self.written = threading.Event()

    def write(self, text: str) -> int:
        count = super().write(text)
        self.written.set()
        return count


def test_a_step_that_lasts_is_printed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "SILENT", 0.0)
    err = Lines()
    monkeypatch.setattr("sys.stderr", err)
    with LongSteps().listening(), step("decomposing bin.stl (12,400 triangles)", level=logging.INFO):
        assert err.written.wait(60)
    assert err.getvalue() == "pinproof: decomposing bin.stl (12,400 triangles)\n"


def test_a_step_that_ends_in_time_is_not_printed(monkeypatch: pytest.MonkeyPatch, capsys: Err) -> None:
    monkeypatch.setattr(console, "SILENT", 1e6)
    timers = threading.active_count()
    with LongSteps().listening():
        with step("a step on a small mesh", level=logging.INFO):
            assert threading.active_count() > timers
        with step("a stage"):
            pass
    assert capsys.readouterr().err == ""


def test_the_level_of_the_logger_is_restored() -> None:
    before = LOG.level, list(LOG.handlers)
    with contextlib.suppress(KeyError), LongSteps().listening():
        assert LOG.isEnabledFor(logging.INFO)
        raise KeyError
    assert (LOG.level, LOG.handlers) == before


def test_the_time_left_is_printed_now_and_then(monkeypatch: pytest.MonkeyPatch, capsys: Err) -> None:
    clock = iter([0.0, 10.0, 40.0, 50.0, 100.0])
    monkeypatch.setattr("pinproof.cli.console.time.monotonic", lambda: next(clock))
    with progress_bar("checking picks.yaml") as show:  # starts at 0 s
        for done in (0, 2, 3, 10):
            show("picks", done, 10)
    # The stage begins at 10 s, so 2 picks took 30 s; at 50 s the last line is too recent, at 100 s the work is done
    assert capsys.readouterr().err == "pinproof: checking picks.yaml: 2 of 10 picks, about 120 s left\n"


def test_a_command_without_a_bar_is_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "SILENT", 0.0)
    err = Lines()
    monkeypatch.setattr("sys.stderr", err)
    with LongSteps().listening(), progress_status("certifying"):
        assert err.written.wait(60)
    assert err.getvalue() == "pinproof: certifying\n"
