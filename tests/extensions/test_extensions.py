"""Programs outside the package, each with a part of its own; they are the examples of docs/extending.md."""

from __future__ import annotations

import ast
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import pinproof as pp

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "extending.md"
PROGRAMS = sorted(HERE.glob("own_*.py"))
LINES = 30


def run(name: str) -> dict[str, Any]:
    """The names of a program after it ran."""
    return runpy.run_path(str(HERE / f"{name}.py"))


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_the_page_shows_the_program_word_for_word(program: Path) -> None:
    text = program.read_text(encoding="utf-8")
    assert f"```python\n{text}```" in PAGE.read_text(encoding="utf-8")
    assert sum(bool(line.strip()) for line in text.splitlines()) <= LINES


def private_names(source: str) -> Iterator[str]:
    """The names of pinproof in a program that no package exports: the face is ``pp.NAME`` or ``pp.package.NAME``."""
    faces = {"pp": pp.__all__} | {f"pp.{name}": getattr(pp, name).__all__ for name in pp._PACKAGES}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "pinproof":
            yield f"from {node.module}"
        elif isinstance(node, ast.Import):
            yield from (one.name for one in node.names if one.name.startswith("pinproof") and one.asname != "pp")
            yield from (one.name for one in node.names if one.name.startswith("pinproof."))
        elif isinstance(node, ast.Attribute):
            owner = ast.unparse(node.value)
            inner = owner == "pp" and node.attr in pp._PACKAGES
            if (owner in faces and not inner and node.attr not in faces[owner]) or node.attr.startswith("_"):
                yield f"{owner}.{node.attr}"


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.stem)
def test_a_program_uses_public_names_only(program: Path) -> None:
    assert list(private_names(program.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    "line",
    [
        "from pinproof.motion import own_motion",
        "import pinproof.ik",
        "pp.motion.own_motion",
        "pp.nothing",
        "pp.ik.x",
        "arm._q",
    ],
)
def test_a_private_name_is_noticed(line: str) -> None:
    assert list(private_names(f"import pinproof as pp\n{line}"))


@pytest.mark.slow
def test_an_own_motion_is_certified_and_a_spline_as_it_is() -> None:
    done = run("own_motion")
    assert done["certificate"].free
    assert done["certificate"].clearance > 0.005
    assert any("trusted" in note for note in done["certificate"].notes)
    spline = pp.certify(done["spline"], done["checker"])
    assert spline.free
    assert not any("trusted" in note for note in spline.notes)
