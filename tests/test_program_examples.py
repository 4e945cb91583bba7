"""The page of printed programs is what the code writes."""

from __future__ import annotations

import re

import program_examples
import pytest


@pytest.mark.slow
def test_the_page_has_the_programs_that_are_written_now() -> None:
    page = program_examples.PAGE.read_text(encoding="utf-8")
    assert program_examples.text() == page
    rows = re.findall(r"^\| (\w+) \| (\d+) \| ([\d.]+) \| ([\d.]+) \|$", page, re.MULTILINE)
    assert [row[0] for row in rows] == ["urscript", "rapid", "krl", "fanuc"]
    for _, moves, program, motion in rows:  # few moves, nearly as fast as the certified motion
        assert int(moves) <= 12
        assert float(program) <= 1.1 * float(motion)
