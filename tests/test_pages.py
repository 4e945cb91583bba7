"""What runs the pages notices what is wrong with them."""

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
    (reader / "robots").mkdir()  # no copy of the robots is needed here
    return run_page(page, reader)


def test_blocks_share_names_and_files(tmp_path: Path) -> None:
    file = "`sub/one.txt`:\n\n```yaml\nx: 1\n```\n\n```python\nfrom pathlib import Path\n```\n\n"
    reading = "```python\nread = Path('sub/one.txt').read_text()\nprint(read)\n```\n\n```text\nx: ...\n```\n"
    names = run(file + reading, tmp_path)
    assert names["read"] == "x: 1\n"


def test_a_page_that_prints_something_else_is_noticed(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="line 5 of the page says\n3\n\nand what is printed is\n2"):
        run(PYTHON + "```text\n3\n```\n", tmp_path)


def test_output_belongs_to_the_block_before_it(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"what is printed is\n$"):
        run(PYTHON + "```python\nx = 1\n```\n\n```text\n2\n```\n", tmp_path)


def test_a_block_that_nothing_runs_is_noticed(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="line 1: nothing runs this block"):
        run("```yaml\nx: 1\n```\n", tmp_path)


def test_a_command_that_is_not_ours_is_noticed(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="nobody runs 'rm -r robots'"):
        run("```sh\nrm -r robots\n```\n", tmp_path)


@pytest.mark.parametrize(("comment", "fine"), [("", True), ("  # exit code 1", False)])
def test_the_exit_code_is_what_the_line_says(comment: str, fine: bool, tmp_path: Path) -> None:
    text = f"```sh\npinproof --version{comment}\n```\n"
    if fine:
        run(text, tmp_path)
    else:
        with pytest.raises(AssertionError, match="exit code 0"):
            run(text, tmp_path)
