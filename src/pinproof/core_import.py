"""The import of the compiled core: one clear error if it is missing, or older than its sources in a checkout.

A finder in ``sys.meta_path`` checks ``pinproof._core`` when it is first imported. It compares the time stamps of the
sources with the core, and their hash only if a source is newer.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

__all__ = ["CoreFinder", "core_problem", "install", "lacks_avx2", "source_hash"]

CORE = "pinproof._core"
SOURCES = Path(__file__).parents[1] / "core"
"""The folder of the sources; it exists in a checkout only."""


class CoreFinder:
    """Finds the compiled core by the other finders, and raises CoreError if it cannot be used."""

    @staticmethod
    def find_spec(fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """The specification of the core; None for every other module."""
        if fullname != CORE:
            return None
        baseline = Path(__file__).parent / "baseline"
        if baseline.is_dir() and lacks_avx2():
            path = [str(baseline)]
        others = (finder for finder in sys.meta_path if finder is not CoreFinder)
        found = next((spec for finder in others if (spec := finder.find_spec(fullname, path, target))), None)
        origin = None if found is None or found.origin is None else Path(found.origin)
        if problem := core_problem(origin, SOURCES):
            from pinproof.errors import CoreError

            raise CoreError(problem)
        return found


def lacks_avx2() -> bool:
    """Whether the processor is an x86-64 without AVX2, for which a wheel has another core in its folder baseline.

    NumPy asks the processor itself; the list of the operating system is that of the host if the processor is emulated.
    """
    features = import_module("numpy._core._multiarray_umath").__cpu_features__
    return bool(features.get("SSE2")) and not (features.get("AVX2") and features.get("FMA3"))


def install() -> None:
    """Add the finder to ``sys.meta_path``, once."""
    if CoreFinder not in sys.meta_path:
        sys.meta_path.insert(0, CoreFinder)


def core_problem(core: Path | None, sources: Path) -> str:
    """Why the file of the core cannot be used, and the command that helps; empty if it can be used.

    Parameters
    ----------
    core
        The extension module; None if it does not exist for this Python.
    sources
        The folder of its sources; it does not exist in an installed wheel.
    """
    build = f"compile it: {sources.parents[1] / 'scripts' / 'build'} {sys.executable}"
    version = f"Python {sys.version_info[0]}.{sys.version_info[1]}"
    if not (sources / "source_hash.cmake").is_file():
        remedy = "pip install --force-reinstall pinproof"
        return "" if core else f"the compiled core is missing for {version}; install pinproof again: {remedy}"
    if core is None:
        return f"the compiled core is missing for {version}; {build}"
    made = core.stat().st_mtime
    if all(each.stat().st_mtime <= made for each in _files(sources)):
        return ""
    if source_hash(sources).encode() in core.read_bytes():
        return ""
    return f"the compiled core {core.name} is older than its sources in {sources}; {build}"


def source_hash(sources: Path) -> str:
    """The hash of the sources that src/core/source_hash.cmake computes, which the core contains."""
    import hashlib

    lines = (
        f"{each.relative_to(sources)} {hashlib.sha256(each.read_bytes()).hexdigest()}\n" for each in _files(sources)
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _files(sources: Path) -> list[Path]:
    return sorted((each for each in sources.rglob("*") if each.suffix in (".cpp", ".h")), key=str)
