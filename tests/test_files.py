"""Rules for the files of the repository that no linter checks."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
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
