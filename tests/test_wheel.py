"""The wheel, built from the source distribution, works in a clean environment.

The wheel contains the compiled core of the checkout. That the distribution would compile to the same core is shown
without compiling it again: its files are those of the checkout, CMake accepts them, and the core states their hash. The
clean environment has links to the installed dependencies; that they can be installed is shown in test_resolution.py.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from email import message_from_bytes
from filecmp import cmp
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from pinproof import _core
from pinproof.core_import import source_hash

ROOT = Path(__file__).parents[1]

SMOKE = ROOT / "tests" / "smoke.py"

UV = sys.executable, "-m", "uv"


def run(*command: str | Path, cwd: Path) -> str:
    """Run a command without the PYTHON* variables of this environment, and return its output."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(command, cwd=cwd, env=clean, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    core = f"cmake.define.PINPROOF_COMPILED={_core.__file__}"
    run(*UV, "build", "--quiet", "--python", sys.executable, "--out-dir", out, "-C", core, ROOT, cwd=out)
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def sources(wheel: Path) -> Path:
    """The unpacked source distribution."""
    (sdist,) = wheel.parent.glob("*.tar.gz")
    shutil.unpack_archive(sdist, wheel.parent, filter="data")
    return wheel.parent / sdist.name.removesuffix(".tar.gz")


def test_the_source_distribution_has_the_files_of_the_checkout(sources: Path) -> None:
    unpacked = {str(file.relative_to(sources)) for file in sources.rglob("*") if file.is_file()}
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False).stdout.split()
    needed = set(listed) or {str(file.relative_to(ROOT)) for file in (ROOT / "src" / "core").rglob("*.[ch]*")}
    assert len(needed) > 50
    assert {name for name in needed - unpacked if not name.startswith(".ci/")} == set()
    changed = [name for name in unpacked if not (ROOT / name).exists() or not cmp(sources / name, ROOT / name, False)]
    assert changed == ["PKG-INFO"]


def test_the_source_distribution_compiles_to_the_core_of_the_checkout(sources: Path) -> None:
    build = sources.parent / "build"
    tools = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"}
    python = f"-DPython_EXECUTABLE={sys.executable}"
    configure = ["cmake", "-S", sources / "src" / "core", "-B", build, "-G", "Ninja", python]
    subprocess.run(configure, check=True, capture_output=True, env=environment)
    command = ["ninja", "-C", build, "-t", "commands", "all"]
    commands = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
    compiled = set(re.findall(r"-c (\S+)", commands))
    assert len(compiled) > 10
    assert [file for file in compiled if not (build / file).is_file()] == []
    assert "-shared" in commands.splitlines()[-1]
    assert source_hash(sources / "src" / "core").encode() in Path(_core.__file__).read_bytes()


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
    for package in found.values():
        for top in {file.parts[0] for file in package.files or []} - {"..", "__pycache__"}:
            if not (site / top).exists():
                (site / top).symlink_to(Path(str(package.locate_file(top))))


def test_wheel_runs_the_demo_in_a_clean_environment(wheel: Path, tmp_path: Path) -> None:
    home = tmp_path / "clean"
    venv.create(home)
    python = home / "bin" / "python"
    (site,) = home.glob("lib/python*/site-packages")
    link_requirements(wheel, site)
    run(*UV, "pip", "install", "--quiet", "--no-deps", "--offline", "--python", python, wheel, cwd=tmp_path)
    assert wheel.name.split("-")[1] in run(python, "-I", SMOKE, cwd=tmp_path)
    run(sys.executable, "-m", "pip", "--python", python, "check", cwd=tmp_path)  # uv does not follow the links
    report = json.loads(run(home / "bin" / "pinproof", "demo", "--html", "pick.html", "--json", cwd=tmp_path))
    assert sum(pick["verdict"] == "good" for pick in report["picks"]) == 4
    assert report["written"] == ["pick.html", "pick.json"]
    assert (tmp_path / "pick.html").stat().st_size > 0
