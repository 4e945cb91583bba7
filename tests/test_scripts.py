"""``scripts/build`` selects a compiler, and says what to install where there is none."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.slow  # starts other processes

TOOLS = ("bash", "cat", "cut", "dirname", "grep", "mkdir", "readlink")
"""The programs that the script calls besides the compiler, CMake and Python."""


def executable(file: Path, *lines: str) -> None:
    file.write_text("\n".join(["#!/bin/bash", *lines, ""]), encoding="utf-8")
    file.chmod(0o755)


@pytest.fixture
def build(tmp_path: Path) -> Path:
    """A checkout with the script only, and a folder of programs: CMake prints its arguments, pip always fails."""
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts" / "build", tmp_path / "scripts")
    programs = tmp_path / "programs"
    programs.mkdir()
    for name in TOOLS:
        (programs / name).symlink_to(shutil.which(name) or name)
    executable(programs / "python", '[[ "$1" == -c ]] && echo test-tag')
    executable(programs / "cmake", 'printf "%s\\n" "$@"')
    return tmp_path


def run(build: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    programs = build / "programs"
    environment = {"PATH": str(programs), **variables}
    command = [programs / "bash", build / "scripts" / "build", programs / "python"]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def chosen(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 0, done.stderr
    (compiler,) = [line for line in done.stdout.splitlines() if line.startswith("-DCMAKE_CXX_COMPILER=")]
    return Path(compiler.partition("=")[2]).name


def test_a_new_enough_compiler_is_chosen_before_an_old_one(build: Path) -> None:
    executable(build / "programs" / "g++", "echo 9")
    executable(build / "programs" / "g++-12", '[[ "$1" == -dumpversion ]] && echo 12 || echo GCC')
    assert chosen(run(build)) == "g++-12"


def test_an_old_clang_is_not_chosen(build: Path) -> None:
    executable(build / "programs" / "clang++", '[[ "$1" == -dumpversion ]] && echo 13 || echo clang')
    executable(build / "programs" / "clang++-15", '[[ "$1" == -dumpversion ]] && echo 15 || echo clang')
    assert chosen(run(build)) == "clang++-15"


def test_the_variable_cxx_selects_the_compiler(build: Path) -> None:
    executable(build / "programs" / "g++", "echo 12")
    assert chosen(run(build, CXX="/opt/own-c++")) == "own-c++"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may call apt without sudo")
def test_apt_installs_a_compiler_if_it_may(build: Path) -> None:
    programs = build / "programs"
    executable(programs / "env", 'while [[ "$1" == *=* ]]; do shift; done', 'exec "$@"')
    created = f"printf '%s\\n' '#!/bin/bash' 'echo 12' >{programs}/g++; {shutil.which('chmod')} +x {programs}/g++"
    executable(programs / "apt-get", f'[[ "$1" == install ]] && {{ {created}; }} || true')
    assert chosen(run(build)) == "g++"


def test_without_apt_the_compiler_and_archiver_of_ziglang_are_used(build: Path) -> None:
    programs = build / "programs"
    (programs / "chmod").symlink_to(shutil.which("chmod") or "chmod")
    answers = ('case "$*" in', "*machine*) echo x86_64 ;;", '"-c "*) echo test-tag ;;', '"-m pip install"*) ;;')
    executable(programs / "python", *answers, '"-m ziglang"*) echo "zig $3" ;;', "*) exit 1 ;;", "esac")
    done = run(build)
    assert chosen(done) == "zig-c++"
    options = dict(line.split("=", 1) for line in done.stdout.splitlines() if line.startswith("-DCMAKE_"))
    for option, name in (("-DCMAKE_AR", "ar"), ("-DCMAKE_RANLIB", "ranlib"), ("-DCMAKE_CXX_COMPILER", "c++")):
        called = subprocess.run(
            [options[option]], env={"PATH": str(programs)}, capture_output=True, text=True, check=True
        )
        assert called.stdout == f"zig {name}\n"
    assert "-DPINPROOF_MARCH=x86_64_v3" in done.stdout.splitlines()


def test_without_any_compiler_one_line_states_what_to_install(build: Path) -> None:
    done = run(build)
    assert done.returncode != 0
    last = done.stderr.splitlines()[-1]
    assert "g++" in last
    assert "clang++" in last


# The exit status of scripts/test: 0 only if the tests, the lint, the format check and the type check pass.


# Replaces the Python of the environment: each tool it is asked to run ends with the status given for that tool.
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
