"""``_core.pyi`` declares the names, arguments and types of the compiled core, so that mypy checks the calls."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path
from typing import Any

import pytest

from pinproof import _core

ROOT = Path(__file__).parents[2]
STUB = ROOT / "src" / "pinproof" / "_core.pyi"


def declared() -> dict[str, set[str]]:
    """The public names of the stub, and the members of its classes."""
    body = ast.parse(STUB.read_text(encoding="utf-8")).body
    found: dict[str, set[str]] = {"": set(_names(body))}
    for each in body:
        if isinstance(each, ast.ClassDef):
            found[each.name] = set(_names(each.body))
    return found


def _names(body: list[ast.stmt]) -> list[str]:
    names = [each.name for each in body if isinstance(each, (ast.FunctionDef, ast.ClassDef))]
    targets = [(each.target,) if isinstance(each, ast.AnnAssign) else getattr(each, "targets", ()) for each in body]
    names += [name.id for group in targets for name in group if isinstance(name, ast.Name)]
    return [name for name in names if not name.startswith("_")]


def public(thing: Any) -> set[str]:
    return {name for name in vars(thing) if not name.startswith("_")}


def test_the_stub_declares_the_names_of_the_core_and_no_other() -> None:
    stub = declared()
    assert stub.pop("") == public(_core)
    for name, members in stub.items():
        value = getattr(_core, name)
        assert inspect.isclass(value)
        assert members == {each for each in public(value) if each not in ("name", "value")}, name


def test_the_stub_is_the_one_that_the_script_writes() -> None:
    pytest.importorskip("nanobind")
    import core_stub

    written = ast.dump(ast.parse(core_stub.stub_text()))
    assert written == ast.dump(ast.parse(STUB.read_text(encoding="utf-8"))), "run scripts/core_stub.py"
