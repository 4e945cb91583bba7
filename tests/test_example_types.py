"""The Python examples of the README, the manual and the gallery pass ``mypy --strict``."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from .pages import PROGRAM, ROOT, blocks

FRAGMENTS = {
    "docs/certificates.md": ("arm", "checker", "trajectory"),
    "docs/timing.md": ("arm", "checker", "path", "v"),
    "docs/viewing.md": ("arm", "certificate", "scene", "torques", "trajectory"),
}
"""Pages whose blocks are no complete programs, and the names that they assume."""

TYPES = {
    "arm": "pp.Arm",
    "certificate": "pp.Certificate",
    "checker": "pp.CollisionChecker",
    "path": "pp.JointPath",
    "scene": "pp.Scene",
    "torques": "pp.motion.TorqueLimits",
    "trajectory": "pp.Trajectory",
    "v": "list[float]",
}


def module_of(page: Path) -> str:
    """The blocks of a page as one module, in which errors have the line numbers of the page."""
    name = page.relative_to(ROOT).as_posix()
    assumed = "; ".join(f"{name}: {TYPES[name]}" for name in FRAGMENTS.get(name, ()))
    text = f"import pinproof as pp; {assumed}" if assumed else ""
    for block in blocks(page, "python"):
        text += "\n" * (block.line - text.count("\n")) + block.text
    return text


@pytest.mark.slow
def test_every_example_is_typed(tmp_path: Path) -> None:
    files = sorted((ROOT / "docs" / "examples").glob("*.py"))
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        if text := module_of(page):
            files.append(tmp_path / f"{'_'.join(page.relative_to(ROOT).with_suffix('').parts)}.py")
            files[-1].write_text(text, encoding="utf-8")
    assert len(files) > 40
    assert any(PROGRAM in file.read_text(encoding="utf-8") for file in files)
    # Blocks of one page are cells of a notebook: a later one may give a name to a value of another type.
    options = [
        "--strict",
        "--allow-redefinition-new",
        "--local-partial-types",
        "--config-file",
        ROOT / "pyproject.toml",
    ]
    command = [sys.executable, "-m", "mypy", *options, "--cache-dir", ROOT / ".mypy_cache" / "examples", *files]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
