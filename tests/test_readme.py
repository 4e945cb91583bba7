"""The README runs exactly as printed."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
RUN_CLI = "import sys; sys.argv[0] = 'pinproof'; from pinproof.cli import main; sys.exit(main())"


@dataclass(frozen=True)
class Block:
    language: str
    line: int
    text: str


def blocks(*languages: str) -> list[Block]:
    text = README.read_text(encoding="utf-8")
    found = (Block(m[1], text[: m.start(2)].count("\n"), m[2]) for m in BLOCK.finditer(text))
    return [block for block in found if block.language in languages]


def commands() -> list[list[str]]:
    """The command lines of all shell blocks, in order; comments and continued lines are read as a shell would."""
    text = "\n".join(block.text for block in blocks("sh")).replace("\\\n", " ")
    return [words for line in text.splitlines() if (words := shlex.split(line, comments=True))]


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of somebody who reads along: a copy of what the README names, so that examples may write."""
    shutil.copytree(ROOT / "robots", tmp_path / "robots")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_block_states_a_language_that_is_run() -> None:
    assert {block.language for block in blocks("", "python", "sh", "text", "console")} <= {"python", "sh", "text"}
    assert blocks("python")
    assert commands()


def test_python_blocks_run_in_order(reader: Path) -> None:
    names: dict[str, object] = {"__name__": "readme"}
    for block in blocks("python"):
        # Blank lines in front make a traceback name the README's own lines.
        exec(compile("\n" * block.line + block.text, str(README), "exec"), names)
    assert (reader / "pick.html").stat().st_size > 0


def test_command_lines_run_in_order(reader: Path) -> None:
    for words in commands():
        if words[0] == "pinproof":
            run = [sys.executable, "-c", RUN_CLI, *words[1:]]
            done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=300)
            assert done.returncode == 0, f"{shlex.join(words)}\n{done.stdout}\n{done.stderr}"
        else:
            script = ROOT / words[0]
            assert words[0].startswith("./scripts/"), f"nobody runs {shlex.join(words)!r}"
            assert os.access(script, os.X_OK)


def test_links_lead_somewhere() -> None:
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", README.read_text(encoding="utf-8"))
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_house_names_every_room() -> None:
    named = set(re.findall(r"^\| `(\w+)(?:\.py|/)` \|", README.read_text(encoding="utf-8"), re.MULTILINE))
    package = ROOT / "src" / "pinproof"
    rooms = {path.stem for path in package.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert named == {room for room in rooms if not room.startswith("__")}
