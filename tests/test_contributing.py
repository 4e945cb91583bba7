"""The page on the architecture names the packages, in the order of imports; named files exist."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

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


# Rules for the files of the repository that no linter checks.


# Written so that the pattern does not match this line.
MACHINE_PATH = re.compile(r"(?<![\w.~}$])/(?:home|Users|root|work|tmp)/[\w.]")


def tracked_files() -> list[Path]:
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("not a git checkout")
    listed = subprocess.run(["git", "-C", str(ROOT), "ls-files", "-z"], capture_output=True, text=True, check=True)
    return [ROOT / name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def text_of(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return ""  # a mesh, a picture


def test_no_file_contains_a_path_of_one_machine() -> None:
    found = [
        f"{file.relative_to(ROOT)}:{number}: {line.strip()}"
        for file in tracked_files()
        for number, line in enumerate(text_of(file).splitlines(), 1)
        if MACHINE_PATH.search(line)
    ]
    assert found == []


@pytest.mark.parametrize("owner", ["home/ada", "Users/ada", "root", "tmp"])
def test_a_path_of_one_machine_is_recognised(owner: str) -> None:
    assert MACHINE_PATH.search(f'mesh = "/{owner}/robot.stl"')


def test_the_version_is_the_same_everywhere() -> None:
    def version(name: str, pattern: str) -> str:
        found = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
        assert found, f"no version in {name}"
        return found[1]

    stated = version("pyproject.toml", r'^version = "(.+)"$')
    assert version("CITATION.cff", r"^version: (.+)$") == stated
    assert re.search(rf"^## \[{re.escape(stated)}\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("script", ["scripts/docs", "scripts/run", "scripts/test", ".ci/run"])
def test_scripts_are_executable_and_parse(script: str) -> None:
    if script.startswith(".") and not (ROOT / ".git").exists():
        pytest.skip("not part of the source distribution")
    assert (ROOT / script).stat().st_mode & 0o111
    done = subprocess.run(["bash", "-n", str(ROOT / script)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
