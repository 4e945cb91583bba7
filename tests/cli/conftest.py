"""Fixtures of the tests of the command line."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def compiled_as_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do not compile kernels ahead in the test process, so that the output does not depend on the machine."""
    monkeypatch.setattr("pinproof.cli.pick.compile_ahead", lambda: None)
