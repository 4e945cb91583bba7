"""The front page and the tutorials of the manual run as printed, with the output they show."""

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
        DOCS / "dynamics.md",
        *(DOCS / "tutorials").glob("*.md"),
        *(DOCS / "formats").glob("*.md"),
    )
)
"""The pages that run; notebooks.md does below, and ik.md in benchmarks/test_pages.py."""


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
    sizes = {picture.name: picture.stat().st_size for picture in DOCS.rglob("*.png")}
    assert {"bisection.png", "first_page.png"} <= set(sizes)
    assert {name: size for name, size in sizes.items() if size > 200_000} == {}
