"""Pages that run as printed: their blocks in order, in a reader's folder, and what they print is what is printed there.

- ``python`` blocks share one set of names; one with ``if __name__ == "__main__"`` is a program of its own.
- ``sh`` blocks are commands of pinproof, each on a line; a comment ``# exit code 1`` says which is expected if not 0.
- a ``text`` block after either is what they write to stdout (and, where they end with 2, to stderr), ``...`` for what
  differs from run to run.
- any other language is a file, and the line above the block its name: `` `cell.yaml`: ``
- directives of the manual (``{toctree}``) are left alone.

``python tests/pages.py PAGE...`` writes what comes out into the pages' ``text`` blocks; look at the difference before
you keep it.
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

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^(?:`([\w./-]+)`:\n\n)?^```([^\s`]*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
EXIT_CODE = re.compile(r"# exit code (\d)\s*$")
PROGRAM = 'if __name__ == "__main__":'
RUN_CLI = (
    "import sys; sys.argv[0] = 'pinproof'\nfrom pinproof.cli import main\nif __name__ == '__main__': sys.exit(main())"
)
USAGE = 2
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
PATIENCE = 1800.0
"""Seconds for one command; only one that hangs takes so long, on any machine."""

Judge = Callable[["Block", str], None]


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the page's line it begins after, its text, and the file it is, if it is one."""

    language: str
    line: int
    text: str
    file: str | None = None


def blocks(page: Path, *languages: str) -> list[Block]:
    """The blocks of a page in order, or those in the given languages."""
    text = page.read_text(encoding="utf-8")
    found = (Block(m[2], text[: m.start(3)].count("\n"), m[3], m[1]) for m in BLOCK.finditer(text))
    return [block for block in found if not languages or block.language in languages]


def commands(block: Block) -> Iterator[tuple[list[str], int]]:
    """The words of each command line of a shell block, and the exit code it shall end with."""
    for line in block.text.replace("\\\n", " ").splitlines():
        if words := shlex.split(line, comments=True):
            code = EXIT_CODE.search(line)
            yield words, int(code[1]) if code else 0


def run_page(page: Path, folder: Path, judge: Judge | None = None) -> dict[str, object]:
    """Run a page's blocks; the names that its Python has made.

    ``judge`` is given every ``text`` block and what came out in front of it; by default it asserts that they agree.
    """
    judge, page = judge or same, page.resolve()
    names: dict[str, object] = {"__name__": page.stem}
    printed = ""
    with standing_in(folder):
        for block in blocks(page):
            where = f"{page.name}, line {block.line}"
            if block.language == "python":
                # Blank lines in front make a traceback name the page's own lines.
                source = "\n" * block.line + block.text
                printed = run_program(source, where) if PROGRAM in source else run_python(source, page, names)
            elif block.language == "sh":
                printed = "".join(run_command(words, code, where) for words, code in commands(block))
            elif block.language == "text":
                judge(block, printed)
            elif not block.language.startswith("{"):
                assert block.file is not None, f"{where}: nothing runs this block, and no line above it names a file"
                Path(block.file).parent.mkdir(parents=True, exist_ok=True)
                Path(block.file).write_text(block.text, encoding="utf-8")
    return names


def same(block: Block, printed: str) -> None:
    """Assert that a text block is what was printed."""
    agrees = doctest.OutputChecker().check_output(block.text, printed, FLAGS)
    assert agrees, f"line {block.line} of the page says\n{block.text}\nand what is printed is\n{printed}"


def run_python(source: str, page: Path, names: dict[str, object]) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(source, str(page), "exec"), names)
    return out.getvalue()


def run_program(source: str, where: str) -> str:
    Path("program.py").write_text(source, encoding="utf-8")
    return finished([sys.executable, "program.py"], 0, where)


def run_command(words: list[str], code: int, where: str) -> str:
    assert words[0] == "pinproof", f"{where}: nobody runs {shlex.join(words)!r}"
    return finished([sys.executable, "-c", RUN_CLI, *words[1:]], code, where)


def finished(command: list[str], code: int, where: str) -> str:
    """The stdout of a command that ends as expected."""
    env = {**os.environ, "COLUMNS": "120", "TERM": "dumb"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE, env=env)
    assert done.returncode == code, f"{where}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout + (done.stderr if code == USAGE else "")


@contextlib.contextmanager
def standing_in(folder: Path) -> Iterator[None]:
    """The folder of somebody who reads along: robots/ beside him, and free to write."""
    if not (folder / "robots").exists():
        shutil.copytree(ROOT / "robots", folder / "robots")
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def rewritten(page: Path) -> str:
    """The page with what really comes out in its text blocks."""
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
        given.write_text(rewritten(given), encoding="utf-8")
