"""Deliberate mistakes in a small project are noticed by its tests, not noticed, or accepted."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import mutants
import mutants_cpp
import mutants_python
import pytest

from .pages import ROOT

SOURCE = """
def clearance(gaps, tolerance):
    return min(gaps) - tolerance


def unused(a, b):
    return a + b
"""
TESTS = """
import area
import pytest


@pytest.mark.parametrize("gaps", [[1.0, 3.0], [4.0, 2.0]])
def test_clearance(gaps):
    assert area.clearance(gaps, 0.0) == min(gaps)
"""
ACCEPTED = """
- file: src/area.py
  diff: |
    -    return min(gaps) - tolerance
    +    return min(gaps) + tolerance
  reason: for the test
- file: src/area.py
  diff: |
    -return a * b
    +return a / b
  reason: these lines do not exist
- file: src/gone.py
  diff: |
    -return a * b
    +return a / b
  reason: this file does not exist, and is not one of the files that are tried
"""


@pytest.mark.slow
def test_mistakes_are_noticed_or_reported_and_accepted_ones_are_left_out(tmp_path: Path) -> None:
    files = {
        "src/area.py": SOURCE,
        "tests/test_area.py": TESTS,
        "tests/mutants/accepted.yaml": ACCEPTED,
        "pytest.ini": "[pytest]",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    script = [sys.executable, str(ROOT / "scripts" / "mutants.py"), "--root", str(tmp_path), "--workers", "1"]
    done = subprocess.run([*script, str(tmp_path / "src/area.py")], capture_output=True, text=True, timeout=300)
    assert done.returncode == 1, done.stdout + done.stderr
    states = json.loads((tmp_path / "build/mutants/results.json").read_text())
    state_of = {key.partition("\n+ ")[2]: state for key, state in states.items()}
    assert state_of == {
        "return max(gaps) - tolerance": "noticed",
        "return (min(gaps))": "survived",
        "return a - b": "survived",
        "return (a)": "survived",
        "return (b)": "survived",
    }
    assert "accepted.yaml names lines that do not exist: src/area.py" in done.stdout
    assert "accepted.yaml names lines that do not exist: src/gone.py" in done.stdout


def changes(source: str) -> set[str]:
    encoded = source.encode()
    found = {encoded[:start] + text + encoded[end:] for start, end, text in mutants_python.edits(encoded)}
    return {text.decode() for text in found if mutants_python.is_mistake(encoded, text)}


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("x = a < b", {"x = a >= b"}),
        ("x = len(a) < 2", {"x = len(a) <= 2", "x = len(a) >= 2", "x = len(a) < 3"}),
        ("x = a and b", {"x = ((a))", "x = ((b))"}),
        ("x = f(a, margin=b)", {"x = f(a, )"}),
        ("[f(i) for i in a]", {"[f(i) for i in list(a)[1:]]", "[f(i) for i in list(a)[:-1]]"}),
        ('x = f"{a + b}"', set()),
        ("if a < b:\n    raise F(a + b)", {"if False:\n    raise F(a + b)", "if a >= b:\n    raise F(a + b)"}),
        ("def __repr__(self):\n    return a + b", set()),
        ("x: A | B = y", set()),
    ],
)
def test_mistakes_in_python(right: str, wrong: set[str]) -> None:
    assert changes(right) == wrong


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("    return a < b;", {">="}),
        ("    x = std::max(a, 2.0 * b);", {"", "std::min(", "2 * 2.0", "/"}),
        ("    if (a && f(b, c)) return true;", {"", "false", "true"}),
        ("    std::vector<int> a;  // 1 + 2", set()),
        ("    constexpr double kTolerance = 2.0 * kRounding;", set()),
        ("    for (int i = 0; i < n; ++i) {", set()),
    ],
)
def test_mistakes_in_cpp(right: str, wrong: set[str]) -> None:
    assert {site.wrong for site in mutants_cpp.sites(f"int f() {{\n{right}\n}}\n")} == wrong


def test_accepted_mistakes_name_files_that_exist_and_reasons() -> None:
    accepted = mutants.read_accepted(ROOT / "tests" / "mutants" / "accepted.yaml")
    assert [name for name, _ in accepted if not (ROOT / name).is_file()] == []
    assert all(len(reason) > 10 for reason in accepted.values())
