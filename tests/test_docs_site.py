"""The manual builds without a warning, documents every public name and needs no network."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from sphinx.util.inventory import InventoryFile

import pinproof as pp

from .pages import ROOT

DOCS = ROOT / "docs"


BUILD = """
import gc, logging, sys
import furo
from sphinx.builders.html import StandaloneHTMLBuilder
from sphinx.cmd.build import main
from sphinx.domains.python import PythonDomain
from sphinx.pycode.parser import Parser

def find(self, env, *sought, known={}, find=PythonDomain.find_obj):
    key = (len(self.objects), *sought)
    if key not in known:
        known[key] = find(self, env, *sought)
    return list(known[key])

PythonDomain.find_obj = find
StandaloneHTMLBuilder.search = False
furo._compute_navigation_tree = lambda context: ""
Parser.parse_definition = lambda self: None
logging.disable(logging.DEBUG)
gc.set_threshold(500_000)
sys.exit(main(sys.argv[1:]))
"""
"""The command of scripts/docs in half of the time.

Names are looked up once, pages have neither a search index nor the tree of all pages beside them, members are in the
order of their names instead of that of the source, and nothing is logged for developers of Sphinx; none of these gives
warnings. The garbage collector, which finds next to nothing in documents, runs less.
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The manual, built with the options of scripts/docs, but without two costly details that give no warnings.

    Names in the tables of contents and typographic quotes take a quarter of the time.
    """
    out = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-c", BUILD, "--quiet", "--fail-on-warning", "--keep-going", "--builder", "html"]
    plain = ["-D", "toc_object_entries=0", "-D", "smartquotes=0"]
    done = subprocess.run([*build, *plain, DOCS, out], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out


def test_every_public_name_is_in_the_reference(site: Path) -> None:
    with (site / "objects.inv").open("rb") as file:
        inventory = InventoryFile.load(file, "", lambda _, uri: uri)
    documented = {name for kind, names in inventory.items() if kind.startswith("py:") for name in names}
    top = {f"pinproof.{name}" for name in pp.__all__ if name != "__version__"}
    further = {
        f"pinproof.{package}.{name}"
        for package in pp._PACKAGES
        for name in getattr(pp, package).__all__
        if name not in pp.__all__
    }
    assert sorted((top | further) - documented) == []


def test_pages_load_nothing_from_the_network(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 20
    fetched = ("<script src=", '<script async="async" src=', 'rel="stylesheet"')
    lines = [line for page in pages for line in page.read_text(encoding="utf-8").splitlines()]
    assert [line for line in lines if "//" in line and any(tag in line for tag in fetched)] == []
