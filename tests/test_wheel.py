"""The wheel, built from the source distribution, works in a clean environment.

In CI the core is compiled from the source distribution, and pip installs the dependencies. Elsewhere the wheel contains
the compiled core of the checkout, and the environment has links to the dependencies that are installed here, which
saves two minutes of CPU time; that the distribution has all its sources is tested without compiling them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import venv
import zipfile
from email import message_from_bytes
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

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


def required(requirements: list[str], extras: set[str], into: dict[str, Distribution]) -> None:
    """Collect the installed distributions that requirements declare, directly or through others."""
    for requirement in map(Requirement, requirements):
        if requirement.marker and not any(requirement.marker.evaluate({"extra": extra}) for extra in extras | {""}):
            continue
        key = f"{requirement.name}[{','.join(sorted(requirement.extras))}]".lower()
        if key not in into:
            into[key] = distribution(requirement.name)
            required(into[key].requires or [], requirement.extras, into)


def link_requirements(wheel: Path, site: Path) -> None:
    """Link what the wheel declares, and nothing else, into an environment, so that an undeclared import fails."""
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        declared = message_from_bytes(archive.read(metadata)).get_all("Requires-Dist") or []
    found: dict[str, Distribution] = {}
    required(declared, set(), found)
    assert len(found) > 5
    for each in found.values():
        for top in {file.parts[0] for file in each.files or []} - {"..", "__pycache__"}:
            if not (site / top).exists():
                (site / top).symlink_to(Path(str(each.locate_file(top))))


def test_wheel_runs_the_demo_in_a_clean_environment(wheel: Path, tmp_path: Path) -> None:
    home = tmp_path / "clean"
    venv.create(home)
    python = home / "bin" / "python"
    pip = sys.executable, "-m", "pip", "--python", python, "--disable-pip-version-check"
    if os.environ.get("CI"):
        run(*pip, "install", "-qq", "--no-compile", wheel, cwd=tmp_path)
    else:
        (site,) = home.glob("lib/python*/site-packages")
        link_requirements(wheel, site)
        run(*pip, "install", "-qq", "--no-compile", "--no-deps", wheel, cwd=tmp_path)
    assert wheel.name.split("-")[1] in run(python, "-I", SMOKE, cwd=tmp_path)
    run(*pip, "check", cwd=tmp_path)
    report = json.loads(run(home / "bin" / "pinproof", "demo", "--html", "pick.html", "--json", cwd=tmp_path))
    assert sum(pick["verdict"] == "good" for pick in report["picks"]) == 4
    assert report["written"] == ["pick.html", "pick.json"]
    assert (tmp_path / "pick.html").stat().st_size > 0
