"""For every supported Python, all requirements are available as wheels, so that no compiler is needed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = ("dask", "sensor", "xacro")

only_in_ci = pytest.mark.skipif(
    not os.environ.get("CI"), reason="takes 15 s of CPU time; outside CI test_wheel.py installs for the current Python"
)


def resolve(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Let pip resolve requirements from wheels only, ignoring what is installed, and write report.json."""
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--disable-pip-version-check", "--ignore-installed"]
    command += ["--only-binary", ":all:", "--target", str(folder / "none"), "--report", str(folder / "report.json")]
    return subprocess.run([*command, *words], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Skip unless the package index is reachable."""
    if resolve(tmp_path_factory.mktemp("probe"), "--no-deps", "--retries", "0", "--timeout", "15", "typer").returncode:
        pytest.skip("the package index is not reachable")


@only_in_ci
@pytest.mark.parametrize("python", ["3.10", "3.11", "3.12", "3.13"])
def test_all_requirements_have_wheels(python: str, index: None, tmp_path: Path) -> None:
    assert f"Programming Language :: Python :: {python}" in PROJECT["classifiers"]
    wanted = [*PROJECT["dependencies"], *(one for extra in EXTRAS for one in PROJECT["optional-dependencies"][extra])]
    done = resolve(tmp_path, "--python-version", python, *wanted)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["install"]
    names = {one["metadata"]["name"].lower() for one in found}
    assert {"pin", "coal", "numpy", "distributed"} <= names
    assert [one["download_info"]["url"] for one in found if not one["download_info"]["url"].endswith(".whl")] == []


def test_each_requirement_has_a_lowest_version() -> None:
    extras = [one for extra in EXTRAS for one in PROJECT["optional-dependencies"][extra]]
    assert [one for one in (*PROJECT["dependencies"], *extras) if ">=" not in one] == []
