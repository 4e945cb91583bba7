"""Settings of the tests of the command line."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def compiled_as_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is compiled ahead in this process: what a test looks at is not whether its machine is new."""
    monkeypatch.setattr("pinproof.cli.pick.compile_ahead", lambda: None)
