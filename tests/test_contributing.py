"""The page on the architecture names the packages, in the order of imports; named files exist."""

from __future__ import annotations

import os
import re

import pytest

from . import test_layers
from .pages import ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PACKAGE = ROOT / "src" / "pinproof"
ROOTS = "src|tests|docs|scripts|robots"


def packages_of_the_table() -> list[str]:
    return re.findall(r"^\| `(\w+)` \| .* \| .*\|$", ARCHITECTURE, re.MULTILINE)


def test_the_table_names_every_package() -> None:
    folders = {file.parent.name for file in PACKAGE.glob("*/__init__.py")}
    modules = {file.stem for pattern in ("*.py", "*.pyi") for file in PACKAGE.glob(pattern)} - {"__init__", "__main__"}
    assert sorted(packages_of_the_table()) == sorted(folders | modules)


def test_the_table_has_the_order_of_imports() -> None:
    orders = [value for value in vars(test_layers).values() if isinstance(value, tuple) and "cli" in value]
    assert orders == [tuple(packages_of_the_table())]


def test_named_files_exist() -> None:
    named = set(re.findall(rf"(?<![\w/<])((?:{ROOTS})/[\w./-]*\w)(?![\w<])", TEXT + ARCHITECTURE))
    assert len(named) > 30
    assert sorted(name for name in named if not (ROOT / name).exists()) == []


def test_every_folder_of_modules_is_named() -> None:
    folders = {path.parent.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py")}
    inner = {f"{path.as_posix()}/" for path in folders if len(path.parts) > 1}
    core = {f"{path.name}/" for path in (ROOT / "src" / "core").iterdir() if path.is_dir()}
    named = set(re.findall(r"^\| `([\w/]+/)` \|", ARCHITECTURE, re.MULTILINE))
    assert named == inner | core


def test_named_scripts_are_executable() -> None:
    named = set(re.findall(r"\./(scripts/\w+)", TEXT))
    assert sorted(name for name in named if not os.access(ROOT / name, os.X_OK)) == []


@pytest.mark.parametrize(
    "kind", ["a shape", "an IK method", "a planner", "a report format", "a motion format", "a robot"]
)
def test_how_to_add_is_a_list_of_steps(kind: str) -> None:
    section = re.search(rf"^### \.\.\. {kind}\n(.*?)(?=^##|\Z)", TEXT, re.MULTILINE | re.DOTALL)
    assert section is not None
    assert 3 <= len(re.findall(r"^\d\. ", section[1], re.MULTILINE)) <= 8
