"""The README runs exactly as printed."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from .pages import ROOT, blocks, commands, reader_folder, run_command, run_python

README = ROOT / "README.md"


def test_every_block_is_python_or_shell() -> None:
    assert {block.language for block in blocks(README)} == {"python", "sh"}


@pytest.mark.slow
def test_python_blocks_run_in_order(tmp_path: Path) -> None:
    names: dict[str, object] = {"__name__": "readme"}
    with reader_folder(tmp_path):
        for block in blocks(README, "python"):
            run_python("\n" * block.line + block.text, README, names)
    assert (tmp_path / "pick.html").stat().st_size > 0


@pytest.mark.slow
def test_command_lines_run_in_order(tmp_path: Path) -> None:
    with reader_folder(tmp_path):
        for block in blocks(README, "sh"):
            for words, code in commands(block):
                if words == ["pip", "install", "."]:
                    assert (ROOT / "pyproject.toml").is_file()  # tests/test_wheel.py installs the package
                else:
                    run_command(words, code, f"README.md, line {block.line}")


def test_linked_files_exist() -> None:
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", README.read_text(encoding="utf-8"))
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_named_scripts_are_executable() -> None:
    named = set(re.findall(r"`\./(scripts/\w+)", README.read_text(encoding="utf-8")))
    assert {name for name in named if os.access(ROOT / name, os.X_OK)} == named != set()


def test_readme_has_at_most_120_lines() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 120
