"""The chapter on the installation agrees with pyproject.toml, and ``python -m pinproof`` is the command line."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import pinproof as pp

from .pages import ROOT, blocks
from .processes import PATIENCE

PAGE = ROOT / "docs" / "installation.md"


def project() -> str:
    return (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_the_page_names_the_versions_of_python_that_the_package_names() -> None:
    stated = re.findall(r"Python :: (3\.\d+)", project())
    (row,) = re.findall(r"^\| Python \| (.*) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert re.findall(r"3\.\d+", row) == stated
    assert f'requires-python = ">={stated[0]}"' in project()


def test_the_page_names_every_extra_and_no_other() -> None:
    section = project().partition("[project.optional-dependencies]")[2].partition("\n[")[0]
    named = re.findall(r"^\| `(\w+)` \| `pip install '\.\[(\w+)\]'`", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert {extra for extra, _ in named} == set(re.findall(r"^(\w+) = \[", section, re.MULTILINE))
    assert all(extra == installed for extra, installed in named)


def test_the_commands_of_the_page_exist(tmp_path: Path) -> None:
    for block in blocks(PAGE, "sh"):
        for script in re.findall(r"^\./(scripts/\w+)", block.text, re.MULTILINE):
            assert (ROOT / script).is_file()


def test_the_dockerfile_of_the_page_has_known_instructions_and_starts_the_command() -> None:
    (dockerfile,) = blocks(PAGE, "dockerfile")
    lines = dockerfile.text.replace("\\\n", " ").splitlines()
    assert [line.split()[0] for line in lines] == ["FROM", "RUN", "COPY", "RUN", "WORKDIR", "ENTRYPOINT"]
    version = re.match(r"FROM python:(3\.\d+)-slim", lines[0])
    assert version is not None
    assert f"Python :: {version[1]}" in project()
    assert re.search(r'^pinproof = "pinproof\.cli', project(), re.MULTILINE)


@pytest.mark.slow
def test_the_package_runs_as_a_module(tmp_path: Path) -> None:
    def run(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "pinproof", *words]
        return subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, timeout=PATIENCE)

    assert run("--version").stdout == f"pinproof {pp.__version__}\n"
    wrong = run("fk", "ur55")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr.startswith("pinproof: unknown robot 'ur55'")
