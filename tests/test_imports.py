"""``import pinproof`` is quick: measured by what it loads, not by a clock."""

from __future__ import annotations

import importlib.machinery
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pinproof import _core, core_import
from pinproof.core_import import core_problem, source_hash

SLOW = {
    "coal",
    "distributed",
    "matplotlib",
    "meshcat",
    "pinocchio",
    "scipy",
    "toppra",
    "trimesh",
    "typer",
}
# Every package that computes kinematics or collisions requires these.
FOUNDATION = {"coal", "pinocchio"}


def loaded_by(code: str) -> set[str]:
    """The slow libraries that a fresh interpreter has loaded after running ``code``."""
    probe = f"{code}\nimport sys\nprint(*{SLOW!r}.intersection(sys.modules))"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


@pytest.mark.slow
def test_importing_the_package_loads_nothing_slow() -> None:
    assert loaded_by("import pinproof") == set()


@pytest.mark.slow
def test_importing_the_packages_loads_only_their_requirements() -> None:
    packages = [
        "errors",
        "description",
        "model",
        "motion",
        "ik",
        "collision",
        "planning",
        "viewer",
        "picks",
        "cell",
    ]
    assert loaded_by("; ".join(f"import pinproof.{package}" for package in packages)) <= FOUNDATION


@pytest.mark.slow
def test_using_a_name_loads_only_what_it_needs() -> None:
    assert loaded_by("import pinproof; pinproof.PinproofError") == set()
    assert loaded_by("import pinproof; pinproof.pose()") <= FOUNDATION


@pytest.mark.slow
def test_the_probe_detects_a_slow_library() -> None:
    assert "scipy" in loaded_by("import scipy")


@pytest.mark.slow
@pytest.mark.parametrize("before", ["enable", "disable"])
def test_imports_leave_the_garbage_collector_as_it_was(before: str) -> None:
    code = f"import gc; gc.{before}(); import pinproof; pinproof.pose; print(gc.isenabled())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(before == "enable")]


@pytest.mark.slow
def test_help_of_the_command_line_loads_no_kinematics() -> None:
    heavy = SLOW - {"typer"}
    assert loaded_by("import pinproof.cli.main") & heavy == set()


# A missing or outdated compiled core is one clear error, which names the command that provides it.


ROOT = Path(__file__).parents[1]


@pytest.fixture
def checkout(tmp_path: Path) -> tuple[Path, Path]:
    """An up-to-date core, and the folder of its sources."""
    sources = tmp_path / "src" / "core"
    (sources / "ik").mkdir(parents=True)
    (sources / "source_hash.cmake").touch()
    (sources / "ik" / "step.cpp").write_text("int step;", encoding="utf-8")
    core = tmp_path / "src" / "pinproof" / "_core.so"
    core.parent.mkdir()
    core.write_bytes(b"x" + source_hash(sources).encode() + b"y")
    return core, sources


def newer(file: Path, than: Path) -> None:
    made = than.stat().st_mtime
    os.utime(file, (made + 10, made + 10))


def test_the_hash_is_the_one_that_cmake_writes_into_the_core() -> None:
    assert source_hash(ROOT / "src" / "core") == _core.SOURCE_HASH


def test_a_core_with_unchanged_sources_is_used(checkout: tuple[Path, Path]) -> None:
    core, sources = checkout
    assert core_problem(core, sources) == ""
    newer(sources / "ik" / "step.cpp", core)
    assert core_problem(core, sources) == ""


def test_changed_sources_are_an_error_with_the_command_that_compiles_them(checkout: tuple[Path, Path]) -> None:
    core, sources = checkout
    (sources / "ik" / "step.cpp").write_text("int another;", encoding="utf-8")
    newer(sources / "ik" / "step.cpp", core)
    problem = core_problem(core, sources)
    assert f"{sources.parents[1]}/scripts/build {sys.executable}" in problem
    assert "older" in problem


@pytest.mark.parametrize("avx2", [True, False])
def test_a_processor_without_avx2_loads_the_second_core_of_a_wheel(
    avx2: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    suffix = importlib.machinery.EXTENSION_SUFFIXES[0]
    for folder in (tmp_path, tmp_path / "baseline"):
        folder.mkdir(exist_ok=True)
        (folder / f"_core{suffix}").touch()
    monkeypatch.setattr(core_import, "__file__", str(tmp_path / "core_import.py"))
    monkeypatch.setattr(core_import, "SOURCES", tmp_path / "no sources")
    features = dict.fromkeys(("SSE2", "FMA3"), True) | {"AVX2": avx2}
    monkeypatch.setattr("numpy._core._multiarray_umath.__cpu_features__", features)
    found = core_import.CoreFinder.find_spec("pinproof._core", [str(tmp_path)], None)
    assert found is not None
    assert Path(str(found.origin)).parent == (tmp_path if avx2 else tmp_path / "baseline")


def test_a_missing_core_is_an_error_with_the_remedy_of_a_checkout_or_a_wheel(
    checkout: tuple[Path, Path], tmp_path: Path
) -> None:
    core, sources = checkout
    assert "scripts/build" in core_problem(None, sources)
    in_wheel = core_problem(None, tmp_path / "site-packages" / "core")
    assert "pip install" in in_wheel
    assert "scripts/build" not in in_wheel
    assert core_problem(core, tmp_path / "site-packages" / "core") == ""


@pytest.mark.slow
def test_without_the_core_commands_end_with_one_line_and_the_verifier_works(tmp_path: Path) -> None:
    package = Path(core_import.__file__).parent
    shutil.copytree(package, tmp_path / "pinproof", ignore=shutil.ignore_patterns("_core.*", "__pycache__"))

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        # Without the module site, whose hook of an editable installation would find the core of the checkout.
        others = [entry for entry in sys.path if entry and Path(entry) != package.parent]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *others])}
        command = [sys.executable, "-S", *words]
        return subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path)

    refused = run("-m", "pinproof", "fk", "ur5", "--q", "home")
    assert refused.returncode == 2
    (line,) = refused.stderr.splitlines()
    assert "the compiled core is missing" in line
    imported = run("-c", "import pinproof.ik")
    assert "CoreError" in imported.stderr.splitlines()[-1]
    assert run("-c", "import pinproof.verifier").returncode == 0
