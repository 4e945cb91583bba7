"""A failed test does not make others fail, and processes of tests react to SIGINT in the background too."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from .pages import ROOT
from .processes import PATIENCE, started, wait_for

LEAKS = """
import gc, socket, subprocess, sys, time
from pathlib import Path

def opened(path):
    return [open(path), socket.socket(), subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)]

class Cycle:
    def __init__(self, things):
        self.things, self.me = things, self  # only the garbage collector finds it

def test_fails_with_files_and_a_process_open(tmp_path):
    (tmp_path / "f").touch()
    cycle = Cycle(opened(tmp_path / "f"))
    assert False, "on purpose"

def test_passes(tmp_path):
    gc.collect()

def test_fails_again_and_replaces_the_last_error(tmp_path):
    assert False, "on purpose"

def test_passes_too(tmp_path):
    gc.collect()
"""


def run_suite(folder: Path, text: str) -> str:
    """The output of pytest for a test file, with the settings and the conftest of this suite."""
    shutil.copy(ROOT / "pyproject.toml", folder)
    (folder / "tests").mkdir()
    shutil.copy(ROOT / "tests" / "conftest.py", folder / "tests")
    (folder / "tests" / "test_made.py").write_text(text)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE)
    return done.stdout


@pytest.mark.slow
def test_open_resources_of_a_failed_test_fail_no_other_test(tmp_path: Path) -> None:
    out = run_suite(tmp_path, LEAKS)
    assert re.search(r"^2 failed, 2 passed", out, re.MULTILINE), out
    assert "::test_passes" not in out


@pytest.mark.slow
def test_open_resources_of_a_passing_test_are_an_error(tmp_path: Path) -> None:
    text = LEAKS.replace('    assert False, "on purpose"\n', "    del tmp_path\n", 1)
    out = run_suite(tmp_path, text)
    assert re.search(r"ResourceWarning", out), out
    assert not re.search(r"^1 failed, 3 passed", out, re.MULTILINE), out


@pytest.mark.slow
def test_a_process_reacts_to_sigint_if_the_suite_ignores_it(tmp_path: Path) -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        program = "import pathlib, time; pathlib.Path('ready').touch(); time.sleep(100000)"
        with started([sys.executable, "-c", program], cwd=tmp_path) as process:
            wait_for((tmp_path / "ready").exists, by=process)
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=PATIENCE)
    finally:
        signal.signal(signal.SIGINT, before)
    assert "KeyboardInterrupt" in err
    assert process.returncode == -signal.SIGINT


@pytest.mark.slow
def test_waiting_ends_if_the_process_ends_before_the_event() -> None:
    command = [sys.executable, "-c", "raise SystemExit(5)"]
    with started(command) as process, pytest.raises(AssertionError, match="ended with 5"):
        wait_for(lambda: False, by=process)
