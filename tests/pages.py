"""Run the code blocks of a Markdown page in order, in a temporary folder, and compare their output with the page.

- ``python`` blocks share one namespace. A block with ``if __name__ == "__main__"`` runs as a separate program.
- ``sh`` blocks are commands of pinproof, one per line. A comment ``# exit code 1`` states an expected exit code other
  than 0.
- A ``text`` block is the expected output of the block before it: stdout, and for exit code 2 also stderr. ``...``
  matches text that differs from run to run.
- A block in any other language is written to a file, named in the line above the block: `` `cell.yaml`: ``
- Directives of the manual (``{toctree}``) are ignored.

``python tests/pages.py PAGE...`` replaces the ``text`` blocks of pages by the actual output; review the difference
before you commit it.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^(?:`([\w./-]+)`:\n\n)?^```([^\s`]*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
EXIT_CODE = re.compile(r"# exit code (\d)\s*$")
PROGRAM = 'if __name__ == "__main__":'
USAGE = 2
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
PATIENCE = 1800.0
"""Time limit of a program in seconds; far longer than any program needs on a busy machine."""

Compare = Callable[["Block", str], None]
RunBlock = Callable[[str, Path, "dict[str, object]"], str]
Run = Callable[..., tuple[int, str, str]]
"""The type of ``run_main``."""


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the line of its fence, its text, and the name of the file to write, if any."""

    language: str
    line: int
    text: str
    file: str | None = None


def blocks(page: Path, *languages: str) -> list[Block]:
    """The blocks of a page in order, optionally only those in the given languages."""
    text = page.read_text(encoding="utf-8")
    found = (Block(m[2], text[: m.start(3)].count("\n"), m[3], m[1]) for m in BLOCK.finditer(text))
    return [block for block in found if not languages or block.language in languages]


def commands(block: Block) -> Iterator[tuple[list[str], int]]:
    """The words of each command line of a shell block, with the expected exit code."""
    for line in block.text.replace("\\\n", " ").splitlines():
        if words := shlex.split(line, comments=True):
            code = EXIT_CODE.search(line)
            yield words, int(code[1]) if code else 0


def run_page(
    page: Path, folder: Path, compare: Compare | None = None, run: RunBlock | None = None
) -> dict[str, object]:
    """Run the blocks of a page, and return the names that its Python blocks define.

    ``compare`` is called with every ``text`` block and the actual output; by default it asserts that they agree.
    ``run`` runs a Python block, and returns what it prints.
    """
    compare, run, page = compare or same, run or run_python, page.resolve()
    names: dict[str, object] = {"__name__": page.stem}
    printed = ""
    with reader_folder(folder):
        for block in blocks(page):
            where = f"{page.name}, line {block.line}"
            if block.language == "python":
                # Leading blank lines make the line numbers of a traceback those of the page.
                source = "\n" * block.line + block.text
                printed = run_program(source, where) if PROGRAM in source else run(source, page, names)
            elif block.language == "sh":
                printed = "".join(run_command(words, code, where) for words, code in commands(block))
            elif block.language == "text":
                compare(block, printed)
            elif not block.language.startswith("{"):
                assert block.file is not None, f"{where}: no line above this {block.language} block names its file"
                Path(block.file).parent.mkdir(parents=True, exist_ok=True)
                Path(block.file).write_text(block.text, encoding="utf-8")
    return names


def same(block: Block, printed: str) -> None:
    """Assert that a text block equals the output."""
    agrees = doctest.OutputChecker().check_output(block.text, printed, FLAGS)
    assert agrees, f"line {block.line} of the page has the output\n{block.text}\nbut the actual output is\n{printed}"


def run_python(source: str, page: Path, names: dict[str, object]) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(source, str(page), "exec"), names)
    return out.getvalue()


def run_program(source: str, where: str) -> str:
    Path("program.py").write_text(source, encoding="utf-8")
    done = subprocess.run([sys.executable, "program.py"], capture_output=True, text=True, check=False, timeout=PATIENCE)
    assert done.returncode == 0, f"{where}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def run_command(words: list[str], code: int, where: str) -> str:
    """The stdout of a command of pinproof; fails unless the exit code is ``code``."""
    assert words[0] == "pinproof", f"{where}: {shlex.join(words)!r} is not a command of pinproof"
    with mock.patch.dict(os.environ, {"COLUMNS": "120", "TERM": "dumb"}):
        ended, out, err = run_main(*words[1:])
    assert ended == code, f"{where}: exit code {ended}\n{out}\n{err}"
    return out + (err if code == USAGE else "")


def run_main(*words: str) -> tuple[int, str, str]:
    """Run ``pinproof WORDS`` in this process: exit code, stdout and stderr."""
    from pinproof.cli.main import main

    code = 0
    with (
        contextlib.redirect_stdout(io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as err,
        mock.patch.object(sys, "argv", ["pinproof", *words]),
        mock.patch("pinproof.cli.console.SILENT", 1e6),  # a loaded machine prints no long step
    ):
        try:
            main()
        except SystemExit as ended:
            code = int(ended.code or 0)
    return code, out.getvalue(), err.getvalue()


@contextlib.contextmanager
def reader_folder(folder: Path) -> Iterator[None]:
    """Change to a folder with a copy of robots/, as a reader of the page would have."""
    if not (folder / "robots").exists():
        shutil.copytree(ROOT / "robots", folder / "robots")
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def with_actual_output(page: Path) -> str:
    """The page with the actual output in its text blocks."""
    text = page.read_text(encoding="utf-8")

    def replace(block: Block, printed: str) -> None:
        nonlocal text
        if not doctest.OutputChecker().check_output(block.text, printed, FLAGS):
            tidy = "\n".join(line.rstrip() for line in printed.strip("\n").splitlines())
            text = text.replace(f"```text\n{block.text}```", f"```text\n{tidy}\n```", 1)

    with tempfile.TemporaryDirectory() as folder:
        run_page(page, Path(folder), replace)
    return text


if __name__ == "__main__":
    for given in map(Path, sys.argv[1:]):
        given.write_text(with_actual_output(given), encoding="utf-8")
