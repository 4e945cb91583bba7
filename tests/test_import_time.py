"""``import pinproof`` is quick: measured by what it loads, not by a clock."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

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


def test_importing_the_package_loads_nothing_slow() -> None:
    assert loaded_by("import pinproof") == set()


def test_importing_the_packages_loads_only_their_requirements() -> None:
    packages = [
        "errors",
        "description",
        "model",
        "conversion",
        "motion",
        "ik",
        "collision",
        "planning",
        "viewer",
        "picks",
        "cell",
    ]
    assert loaded_by("; ".join(f"import pinproof.{package}" for package in packages)) <= FOUNDATION


def test_using_a_name_loads_only_what_it_needs() -> None:
    assert loaded_by("import pinproof; pinproof.PinproofError") == set()
    assert loaded_by("import pinproof; pinproof.pose()") <= FOUNDATION


def test_the_probe_detects_a_slow_library() -> None:
    assert "scipy" in loaded_by("import scipy")


def test_help_of_the_command_line_loads_no_kinematics() -> None:
    heavy = SLOW - {"typer"}
    assert loaded_by("import pinproof.cli.main") & heavy == set()
