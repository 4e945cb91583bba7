"""Steps of long work are logged; nothing is printed by the library."""

import logging

import pytest

from pinproof.common.steps import LOG, step


def test_a_step_logs_its_start_and_its_end(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, LOG.name), step("decomposing bin.stl", level=logging.INFO):
        assert [record.getMessage() for record in caplog.records] == ["decomposing bin.stl"]
    begun, ended = caplog.records
    assert begun.__dict__["seconds"] is None
    assert ended.__dict__["seconds"] >= 0
    assert ended.__dict__["step"] == "decomposing bin.stl"


def test_a_step_that_fails_ends_too(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG, LOG.name), pytest.raises(ZeroDivisionError), step("dividing"):
        _ = 1 / 0
    assert [record.__dict__["seconds"] is None for record in caplog.records] == [True, False]


def test_steps_below_the_level_are_not_logged(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, LOG.name), step("reach"):
        pass
    assert not caplog.records
