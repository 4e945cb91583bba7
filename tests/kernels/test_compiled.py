"""Compilation: not at import, logged once, cached for later processes, and possible without a cache."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import pinproof


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    clean = {key: value for key, value in os.environ.items() if key not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    done = subprocess.run(
        [sys.executable, "-B", "-c", code], env=clean | environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done


USE = """
from pinproof.kernels.trigonometry import sincos
from pinproof.kernels.compiled import CACHE
print(CACHE, sincos(0.5)[0])
"""


@pytest.mark.slow
def test_importing_kernels_compiles_nothing():
    done = run("import pinproof.kernels.search, pinproof.kernels.chain\nimport pinproof.ik")
    assert "compiling" not in done.stderr


@pytest.mark.slow
def test_only_the_first_process_compiles_and_logs_it(tmp_path):
    first, second = (run(USE, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2))
    assert "pinproof: compiling trigonometry.sincos for this machine, once" in first.stderr
    assert second.stderr == ""
    assert first.stdout == second.stdout


@pytest.mark.slow
def test_concurrent_processes_wait_for_the_one_that_compiles(tmp_path):
    with ThreadPoolExecutor(3) as pool:
        done = list(pool.map(lambda _: run(USE, NUMBA_CACHE_DIR=str(tmp_path)), range(3)))
    assert sum("compiling trigonometry.sincos" in one.stderr for one in done) == 1
    assert len({one.stdout for one in done}) == 1


@pytest.mark.slow
def test_kernels_are_cached_in_numba_cache_dir(tmp_path):
    folder = Path(run(USE, NUMBA_CACHE_DIR=str(tmp_path)).stdout.split()[0])
    assert folder.is_relative_to(tmp_path)
    assert list(folder.rglob("*.nbc"))


@pytest.mark.slow
def test_an_edit_of_any_kernel_starts_a_new_cache_folder(tmp_path):
    """Numba itself detects only edits of the file of a kernel, not of the kernels that it calls."""
    package = tmp_path / "src" / "pinproof"
    shutil.copytree(Path(pinproof.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    where = {"PYTHONPATH": str(package.parent), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    before = run(USE, **where).stdout
    with (package / "kernels" / "cholesky.py").open("a") as file:
        file.write("\n# edited\n")
    after = run(USE, **where)
    assert after.stdout.split()[0] != before.split()[0]
    assert "compiling" in after.stderr


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="a folder that cannot be made is made of a file here")
def test_kernels_run_without_a_writable_folder_and_log_it(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    code = "import tempfile; tempfile.tempdir = " + repr(str(blocked)) + USE
    done = run(code, NUMBA_CACHE_DIR=str(blocked), XDG_CACHE_HOME=str(blocked), HOME=str(blocked))
    assert done.stdout.startswith("None 0.479425538604203")
    assert "for this process only" in done.stderr


@pytest.mark.slow
def test_user_kernels_keep_their_cache_folder(tmp_path):
    code = "import numba; before = numba.config.CACHE_DIR\nimport pinproof.kernels.chain\n"
    assert run(code + "print(before == numba.config.CACHE_DIR)").stdout.strip() == "True"
