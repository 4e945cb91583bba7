"""For every supported Python, all requirements are available as wheels, so that no compiler is needed."""

from __future__ import annotations

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
REQUIRED = [*PROJECT["dependencies"], *(one for extra in EXTRAS for one in PROJECT["optional-dependencies"][extra])]


def resolve(requirements: list[str], *words: str, **settings: str) -> subprocess.CompletedProcess[str]:
    """Let uv resolve requirements from wheels only, whatever is installed, and print one line for each package."""
    command = [
        sys.executable,
        "-m",
        "uv",
        "pip",
        "compile",
        "--only-binary",
        ":all:",
        "--no-header",
        "--no-annotate",
        "-",
    ]
    environment = {**os.environ, "UV_PYTHON_DOWNLOADS": "never", **settings}
    listed = "\n".join(requirements)
    return subprocess.run(
        [*command, *words], input=listed, capture_output=True, text=True, check=False, env=environment
    )


@pytest.fixture(scope="module")
def index() -> None:
    """Skip unless the package index is reachable."""
    if resolve(["typer"], "--no-deps", "--refresh", UV_HTTP_RETRIES="0", UV_HTTP_TIMEOUT="15").returncode:
        pytest.skip("the package index is not reachable")


@pytest.mark.parametrize("python", ["3.10", "3.11", "3.12", "3.13"])
def test_all_requirements_have_wheels(python: str, index: None) -> None:
    assert f"Programming Language :: Python :: {python}" in PROJECT["classifiers"]
    done = resolve(REQUIRED, "--python-version", python)
    assert done.returncode == 0, done.stderr
    assert {"pin", "coal", "numpy", "distributed"} <= {line.partition("==")[0] for line in done.stdout.splitlines()}


def test_a_requirement_without_a_wheel_is_noticed(index: None) -> None:
    done = resolve(["pin==2.6.3"], "--python-version", "3.13")
    assert done.returncode != 0
    assert "no wheels" in done.stderr


def test_each_requirement_has_a_lowest_version() -> None:
    assert [one for one in REQUIRED if ">=" not in one] == []
