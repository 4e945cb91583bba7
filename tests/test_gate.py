"""The exit status of scripts/test: 0 only if the tests, the lint, the format check and the type check pass."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Stands for the Python of the environment: each tool it is asked to run ends with the status given for that tool.
PYTHON = """#!/usr/bin/env bash
case "$2" in
    pytest) sleep 0.2; exit "${PYTEST:-0}" ;;
    ruff) exit "${RUFF:-0}" ;;
    mypy) exit "${MYPY:-0}" ;;
esac
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with the scripts of the project and an environment that counts as installed."""
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "src" / "core").mkdir(parents=True)
    (tmp_path / "src" / "pinproof").mkdir()
    (tmp_path / "src" / "pinproof" / "_core.test.so").touch()
    python = tmp_path / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(PYTHON)
    python.chmod(0o755)
    (tmp_path / ".venv" / ".core-compiled").touch()
    stamp = ["bash", "-c", "source scripts/environment.sh && fingerprint test >.venv/.installed-test"]
    subprocess.run(stamp, cwd=tmp_path, check=True)
    return tmp_path


@pytest.mark.parametrize(
    ("statuses", "expected"),
    [({}, 0), ({"PYTEST": "1"}, 1), ({"PYTEST": "5", "RUFF": "1"}, 5), ({"RUFF": "1"}, 1), ({"MYPY": "2"}, 1)],
)
def test_status_is_zero_only_if_everything_passes(checkout: Path, statuses: dict[str, str], expected: int) -> None:
    ended = subprocess.run(
        ["./scripts/test", "--quick"],
        cwd=checkout,
        env={"PATH": "/usr/bin:/bin", **statuses},
        capture_output=True,
        check=False,
    )
    assert ended.returncode == expected, ended.stderr.decode()
