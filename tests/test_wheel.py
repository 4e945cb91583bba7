"""The wheel, built from the source distribution, works in a clean environment.

In CI the core is compiled from the source distribution. Elsewhere the wheel contains the compiled core of the checkout,
which saves two minutes of CPU time; that the distribution has all its sources is tested without compiling them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

from pinproof import _core

ROOT = Path(__file__).parents[1]

SMOKE = ROOT / "tests" / "smoke.py"


def run(*command: str | Path, cwd: Path) -> str:
    """Run a command without the PYTHON* variables of this environment, and return its output."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(command, cwd=cwd, env=clean, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    reused = [] if os.environ.get("CI") else [f"-Ccmake.define.PINPROOF_COMPILED={_core.__file__}"]
    run(sys.executable, "-m", "build", "--outdir", out, *reused, ROOT, cwd=out)
    (built,) = out.glob("*.whl")
    return built


def test_the_source_distribution_contains_all_sources(wheel: Path) -> None:
    (sdist,) = wheel.parent.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        there = {name.partition("/")[2] for name in archive.getnames()}
    listed = subprocess.run(["git", "ls-files", "src", "robots"], cwd=ROOT, capture_output=True, text=True, check=False)
    sources = set(listed.stdout.split()) or {str(f.relative_to(ROOT)) for f in (ROOT / "src/core").rglob("*.[ch]*")}
    assert len(sources) > 50
    assert sources - there == set()


def test_the_wheel_contains_robots_types_and_licence(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    robots = {str(file.relative_to(ROOT)) for file in (ROOT / "robots").rglob("*") if file.is_file()}
    assert robots
    assert {f"pinproof/{name}" for name in robots} <= set(names)
    assert "pinproof/py.typed" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert not [name for name in names if not name.startswith(("pinproof/", "pinproof-"))]


def test_wheel_runs_the_demo_in_a_clean_environment(wheel: Path, tmp_path: Path) -> None:
    home = tmp_path / "clean"
    venv.create(home, with_pip=True)
    python = home / "bin" / "python"
    # The dependencies come from the index, so that an undeclared import fails.
    run(python, "-m", "pip", "install", "-qq", "--disable-pip-version-check", "--no-compile", wheel, cwd=tmp_path)
    assert wheel.name.split("-")[1] in run(python, "-I", SMOKE, cwd=tmp_path)
    run(python, "-m", "pip", "check", cwd=tmp_path)
    report = json.loads(run(home / "bin" / "pinproof", "demo", "--html", "pick.html", "--json", cwd=tmp_path))
    assert sum(pick["verdict"] == "good" for pick in report["picks"]) == 4
    assert report["written"] == ["pick.html", "pick.json"]
    assert (tmp_path / "pick.html").stat().st_size > 0
