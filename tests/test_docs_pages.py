"""The pages of the manual that are to be followed run as they are printed, and what they show is what comes out."""

from __future__ import annotations

from pathlib import Path

import pytest

from .pages import ROOT, run_page

DOCS = ROOT / "docs"
PAGES = sorted(str(page.relative_to(DOCS)) for page in [DOCS / "index.md", *(DOCS / "tutorials").glob("*.md")])


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # Dask leaves sockets to the collector
@pytest.mark.parametrize("page", PAGES)
def test_a_page_runs_as_printed(page: str, tmp_path: Path) -> None:
    run_page(DOCS / page, tmp_path)


def test_the_pictures_of_the_manual_are_small() -> None:
    sizes = {picture.name: picture.stat().st_size for picture in DOCS.rglob("*.png")}
    assert {"bisection.png", "first_page.png"} <= set(sizes)
    assert {name: size for name, size in sizes.items() if size > 200_000} == {}
