"""The first page of the manual and the tutorials of the manual run as printed, with the output they show."""

from __future__ import annotations

import ast
import contextlib
import io
from pathlib import Path

import pytest

import pinproof as pp

from .pages import ROOT, blocks, reader_folder, run_page, run_python

DOCS = ROOT / "docs"
PAGES = sorted(
    str(page.relative_to(DOCS))
    for page in (
        DOCS / "index.md",
        DOCS / "calibration.md",
        DOCS / "dynamics.md",
        DOCS / "holding.md",
        DOCS / "is_it_for_me.md",
        DOCS / "libraries.md",
        DOCS / "planning.md",
        DOCS / "tool_paths.md",
        DOCS / "two_hands.md",
        *(DOCS / "tutorials").glob("*.md"),
        *(DOCS / "formats").glob("*.md"),
    )
)
"""The pages that run; notebooks.md does below, ik.md in benchmarks/test_pages.py, and extending.md in extensions/."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # Dask leaves sockets open until garbage collection
@pytest.mark.parametrize("page", PAGES)
def test_a_page_runs_as_printed(page: str, tmp_path: Path) -> None:
    run_page(DOCS / page, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("page", ["certificates.md", "timing.md"])
def test_the_fragments_of_a_page_run_with_an_arm_and_a_path(page: str, tmp_path: Path) -> None:
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    path = pp.JointPath([arm.home, arm.home + 0.2], arm.joint_names)
    names: dict[str, object] = {"pp": pp, "arm": arm, "path": path, "v": [0.1] * 6}
    names |= {"checker": pp.CollisionChecker(arm), "trajectory": pp.time_parametrise(path, arm.limits)}
    with reader_folder(tmp_path):
        for block in blocks(DOCS / page, "python"):
            run_python("\n" * block.line + block.text, DOCS / page, names)


@pytest.mark.slow
def test_the_cells_of_the_page_on_notebooks_run_as_printed_and_display_html(tmp_path: Path) -> None:
    displayed = []

    def run_cell(source: str, page: Path, names: dict[str, object]) -> str:
        *statements, last = ast.parse(source).body
        printed = run_python(ast.unparse(ast.Module(statements, [])), page, names)
        if not isinstance(last, ast.Expr):
            return printed + run_python(ast.unparse(last), page, names)
        with contextlib.redirect_stdout(io.StringIO()) as out:
            value = eval(ast.unparse(last), names)
        if value is not None:
            displayed.append(value._repr_html_())
        return printed + out.getvalue()

    run_page(DOCS / "notebooks.md", tmp_path, run=run_cell)
    assert len(displayed) == 5
    assert all(text.startswith("<") and text.endswith(">") for text in displayed)
    assert "srcdoc=" in displayed[-1]


def test_the_pictures_of_the_manual_are_small() -> None:
    sizes = {picture.name: picture.stat().st_size for kind in ("png", "webp") for picture in DOCS.rglob(f"*.{kind}")}
    assert sizes.pop("demo.webp") <= 1_500_000  # animated
    assert {"bisection.png", "first_page.png"} <= set(sizes)
    assert {name: size for name, size in sizes.items() if size > 200_000} == {}


# tests/pages.py runs pages, and fails on wrong output, exit codes and unknown blocks.


PRINTS = "```python\nprint(1 + 1)\n```\n\n"


def run_text(text: str, folder: Path) -> dict[str, object]:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    reader = folder / "reader"
    reader.mkdir()
    (reader / "robots").mkdir()  # avoids the copy of robots/
    return run_page(page, reader)


def test_blocks_share_names_and_files(tmp_path: Path) -> None:
    file = "`sub/one.txt`:\n\n```yaml\nx: 1\n```\n\n```python\nfrom pathlib import Path\n```\n\n"
    reading = "```python\nread = Path('sub/one.txt').read_text()\nprint(read)\n```\n\n```text\nx: ...\n```\n"
    names = run_text(file + reading, tmp_path)
    assert names["read"] == "x: 1\n"


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (f"{PRINTS}```text\n3\n```\n", r"line 5 (?s:.*)3\n(?s:.*)2"),
        (f"{PRINTS}```python\nx = 1\n```\n\n```text\n2\n```\n", r"line 9 (?s:.*)2\n(?s:.*)\n$"),  # the last block's
        ("```yaml\nx: 1\n```\n", "line 1: .*yaml"),  # no file name
        ("```sh\nrm -r robots\n```\n", "'rm -r robots'"),
        ("```sh\npinproof --version  # exit code 1\n```\n", "exit code 0"),
    ],
)
def test_a_page_that_does_not_run_as_printed_is_an_error(text: str, error: str, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=error):
        run_text(text, tmp_path)


def test_a_command_ends_with_exit_code_0_if_none_is_stated(tmp_path: Path) -> None:
    run_text("```sh\npinproof --version\n```\n", tmp_path)
