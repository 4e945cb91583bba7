"""docs/robots.md: its tables agree with the readers, and its example runs."""

from __future__ import annotations

import re
from importlib.metadata import version
from pathlib import Path

import pytest
import robot_table

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "robots.md"


@pytest.mark.slow
def test_tables_are_what_the_script_writes():
    text = PAGE.read_text(encoding="utf-8")
    written_with = re.search(r"^example-robot-data (\S+):$", text, re.MULTILINE)
    assert written_with is not None
    if written_with.group(1) != version("example-robot-data"):
        pytest.skip(f"the tables are of example-robot-data {written_with.group(1)}")
    assert robot_table.page(text) == text, "run scripts/robot_table.py"


def test_example_runs():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(block, names)
    assert names["left"].held["right_s0"] == -1.0
    assert names["arm"].dof == 7
