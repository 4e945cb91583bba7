"""Fixtures of the tests of the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from ..pages import Run, run_main


@pytest.fixture(autouse=True)
def compiled_as_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do not compile kernels ahead in the test process, so that the output does not depend on the machine."""
    monkeypatch.setattr("pinproof.cli.pick.compile_ahead", lambda: None)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    """Run a command line in this process, in an empty folder: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    return run_main
