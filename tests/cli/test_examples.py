"""The help of every command has an example that runs as printed, also with --json."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pinproof.cli.main import COMMANDS

from ..pages import Run
from ..processes import RUN_CLI

ROBOTS = Path(__file__).parents[2] / "robots"

PLAN = 'plan ur5 --goal "1 -1.2 1.2 -1.57 -1.57 0" --scene robots/ur5/scene.yaml -o motion.json'
BEFORE = {"certify": PLAN, "export": PLAN}
"""Commands that must run before an example."""

NEGATIVE = {"pick": 1, "cell place": 1, "cell tolerance": 1}
"""Exit codes of examples with a negative result: some of the bolts cannot be picked."""

FEWER = {
    "cell place": ("--grid", "20", "--runs", "0", "--certified", "1"),
    "cell tolerance": ("--samples", "0"),
}
"""Options that make the second run of an example shorter."""


@pytest.fixture
def example(run: Run) -> Run:
    """Run the example of a command in a folder with the robots: exit code, stdout, stderr."""
    shutil.copytree(ROBOTS, "robots")

    def call(command: str, *more: str) -> tuple[int, str, str]:
        if command in BEFORE:
            assert run(*shlex.split(BEFORE[command]))[0] == 0
        lines = [line.strip() for line in (COMMANDS[command].__doc__ or "").splitlines()]
        (found,) = [line for line in lines if line.startswith("Example: ")]
        return run(*shlex.split(found.removeprefix("Example: pinproof ")), *more)

    return call


@pytest.mark.slow
@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_the_example_of_a_command_runs(command: str, example: Run) -> None:
    code, out, err = example(command)
    assert code == NEGATIVE.get(command, 0), out + err
    assert out.strip()


@pytest.mark.slow
@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_stdout_is_one_json_document_with_json(command: str, example: Run, capfd: pytest.CaptureFixture[str]) -> None:
    code, out, err = example(command, "--json", *FEWER.get(command, ()))
    assert code == NEGATIVE.get(command, 0), out + err
    assert isinstance(json.loads(out), dict)
    assert capfd.readouterr().out == ""  # of libraries that write to the file descriptor


def test_the_help_of_a_command_shows_its_example(run: Run) -> None:
    code, out, _ = run("fk", "--help")
    assert code == 0
    assert "Example:" in out


@pytest.mark.slow
def test_the_program_has_exit_code_and_output_of_the_command(run: Run) -> None:
    done = subprocess.run([sys.executable, "-c", RUN_CLI, "fk", "ur5"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == run("fk", "ur5")
    done = subprocess.run([sys.executable, "-c", RUN_CLI, "fk", "ur55"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == run("fk", "ur55")
