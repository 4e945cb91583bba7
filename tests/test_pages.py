"""tests/pages.py runs pages, and fails on wrong output, exit codes and unknown blocks."""

from __future__ import annotations

from pathlib import Path

import pytest

from .pages import run_page

PYTHON = "```python\nprint(1 + 1)\n```\n\n"


def run(text: str, folder: Path) -> dict[str, object]:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    reader = folder / "reader"
    reader.mkdir()
    (reader / "robots").mkdir()  # avoids the copy of robots/
    return run_page(page, reader)


def test_blocks_share_names_and_files(tmp_path: Path) -> None:
    file = "`sub/one.txt`:\n\n```yaml\nx: 1\n```\n\n```python\nfrom pathlib import Path\n```\n\n"
    reading = "```python\nread = Path('sub/one.txt').read_text()\nprint(read)\n```\n\n```text\nx: ...\n```\n"
    names = run(file + reading, tmp_path)
    assert names["read"] == "x: 1\n"


def test_wrong_output_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"line 5 (?s:.*)3\n(?s:.*)2"):
        run(PYTHON + "```text\n3\n```\n", tmp_path)


def test_output_is_that_of_the_block_before_it(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"line 9 (?s:.*)2\n(?s:.*)\n$"):
        run(PYTHON + "```python\nx = 1\n```\n\n```text\n2\n```\n", tmp_path)


def test_a_block_without_a_file_name_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"line 1: .*yaml"):
        run("```yaml\nx: 1\n```\n", tmp_path)


def test_a_command_of_another_program_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="'rm -r robots'"):
        run("```sh\nrm -r robots\n```\n", tmp_path)


@pytest.mark.parametrize(("comment", "passes"), [("", True), ("  # exit code 1", False)])
def test_the_exit_code_must_be_the_stated_one(comment: str, passes: bool, tmp_path: Path) -> None:
    text = f"```sh\npinproof --version{comment}\n```\n"
    if passes:
        run(text, tmp_path)
    else:
        with pytest.raises(AssertionError, match="exit code 0"):
            run(text, tmp_path)
