"""Every command's help holds one example, and each example runs as printed; so does its --json."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pinproof.cli.main import COMMANDS

from ..processes import PATIENCE, RUN_CLI

ROBOTS = Path(__file__).parents[2] / "robots"

BEFORE = {"certify": 'plan ur5 --goal "1 -1.2 1.2 -1.57 -1.57 0" --scene robots/ur5/scene.yaml -o motion.json'}
"""What an example needs to have been run before it."""

HONEST_NO = {"pick": 1}
"""Examples whose answer is a "no": some of the bolts cannot be picked."""


def run(words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", RUN_CLI, *shlex.split(words)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )


def example(command: str) -> str:
    lines = [line.strip() for line in (COMMANDS[command].__doc__ or "").splitlines()]
    (found,) = [line for line in lines if line.startswith("Example: ")]
    return found.removeprefix("Example: pinproof ")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder of a user who has the robots beside it."""
    shutil.copytree(ROBOTS, tmp_path / "robots")
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_the_example_of_a_command_runs(command: str, folder: Path) -> None:
    if command in BEFORE:
        assert run(BEFORE[command], folder).returncode == 0
    done = run(example(command), folder)
    assert done.returncode == HONEST_NO.get(command, 0), done.stdout + done.stderr
    assert done.stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_json_is_all_that_stands_on_stdout(command: str, folder: Path) -> None:
    if command in BEFORE:
        assert run(BEFORE[command], folder).returncode == 0
    done = run(example(command) + " --json", folder)
    assert done.returncode == HONEST_NO.get(command, 0), done.stdout + done.stderr
    assert isinstance(json.loads(done.stdout), dict)


@pytest.mark.slow
def test_the_help_of_a_command_shows_its_example(folder: Path) -> None:
    done = run("fk --help", folder)
    assert done.returncode == 0
    assert "Example:" in done.stdout
