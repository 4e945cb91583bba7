"""Deliberate mistakes in C++ sources that are compiled together and switched on one at a time, see mutation.h.

The sources are not parsed: binary operators are found by the spaces that clang-format puts around them.
"""

from __future__ import annotations

import random
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Site", "build", "draw", "instrument", "sites"]

OPPOSITE = {"<": ">=", ">": "<=", "<=": ">", ">=": "<", "==": "!=", "!=": "==", "+": "-", "-": "+", "*": "/", "/": "*"}
LEFT_ALONE = re.compile(
    r"^\s*(#|//|template|using|static_assert|for \(|throw|case |namespace|extern)|constexpr |operator"
)
"""Lines that are not code, must be constant, count, or report. The mistakes in bounds of loops crash."""
STATEMENT = re.compile(r"^\s+[A-Za-z_][\w.\[\]()>+*-]*(\([^;{}]*\)| [+*/|&-]?= [^;{}]*);$")
OPERAND = r"[;,?)\]}]|&&|\|\|| : "
DECLARES = re.compile(r"^(const |auto |[\w:<>]+[&*]? [&*]?\w+ = |[\w:<>]+[&*]? [&*]?\w+ : )")


@dataclass(frozen=True)
class Site:
    """A place of a mistake: the pieces that replace the source, in which N is its number, and what they do."""

    pieces: tuple[tuple[int, int, str], ...]
    start: int
    end: int
    wrong: str

    def bytes_in(self, source: str) -> tuple[int, int, bytes]:
        """The place in the encoded source, and the mistake."""
        start = len(source[: self.start].encode())
        return start, start + len(source[self.start : self.end].encode()), self.wrong.encode()


def end_of(code: str, start: int, ends: str) -> int:
    """The first place from a start on that matches an expression and is not within brackets opened since."""
    depth = 0
    for match in re.finditer(rf"[(\[{{]|{ends}|[)\]}}]", code[start:]):
        if match[0] in "([{":
            depth += 1
        elif depth == 0:
            return start + match.start()
        elif match[0] in ")]}":
            depth -= 1
    return len(code)


def sites(source: str) -> list[Site]:
    """All places of mistakes in a source."""
    code = re.sub(r"//[^\n]*|\"(?:[^\"\\\n]|\\.)*\"", lambda text: "_" * len(text[0]), source)  # same length
    found: list[Site] = []

    def add(wrong: str, start: int, end: int, *pieces: tuple[int, int, str]) -> None:
        found.append(Site(pieces, start, end, wrong))

    begin = 0
    previous = ""
    for line in code.split("\n"):
        if not LEFT_ALONE.search(line) and line.strip():
            for match in re.finditer(r"(?<= )(<=|>=|==|!=|<|>|\+|-|\*|/)(?= )", line):
                a, b, token = begin + match.start(), begin + match.end(), match[0]
                add(OPPOSITE[token], a, b, (a, b, f"{token} pinproof::mutation::Mark<N>{{}} {token}"))
            for match in re.finditer(r"std::(max|min)\((?!\{)", line):
                a, b = begin + match.start(), begin + match.end()
                other = "min" if match[1] == "max" else "max"
                add(f"std::{other}(", a, b, (a, b, f"pinproof::mutation::{match[1]}<N>("))
            for match in re.finditer(r"(?<![\w.])\d+\.\d*(e-?\d+)?(?![\w.])|(?<![\w.])\d+e-?\d+\b", line):
                if float(match[0]):
                    a, b = begin + match.start(), begin + match.end()
                    add(f"2 * {match[0]}", a, b, (a, b, f"pinproof::mutation::number<N>({match[0]})"))
            for match in re.finditer(r" (&&|\|\|) ", line):
                a, b = begin + match.start(), end_of(code, begin + match.end(), OPERAND)
                skip = "on(N) ||" if match[1] == "&&" else "!on(N) &&"
                skip = skip.replace("on", "pinproof::mutation::on")
                add("", a, b, (begin + match.end(), begin + match.end(), f"({skip} static_cast<bool>("), (b, b, "))"))
            for match in re.finditer(r"\bif \(", line):
                a = begin + match.end()
                b = end_of(code, a, r"[;)]")
                if code[b] == ")" and not DECLARES.match(code[a:b]):
                    add("false", a, b, (a, a, "pinproof::mutation::on(N) ? false : static_cast<bool>("), (b, b, ")"))
                    add("true", a, b, (a, a, "pinproof::mutation::on(N) ? true : static_cast<bool>("), (b, b, ")"))
            for match in re.finditer(r"\breturn (true|false);", line):
                a, b = begin + match.start(1), begin + match.end(1)
                right, wrong = ("!", "false") if match[1] == "true" else ("", "true")
                add(wrong, a, b, (a, b, f"{right}pinproof::mutation::on(N)"))
            if STATEMENT.match(line) and re.search(r"[;{}]$", previous) and not re.match(r"\s*(return|delete)\b", line):
                a = begin + len(line) - len(line.lstrip())
                add("", a, begin + len(line), (a, a, "if (!pinproof::mutation::on(N)) "))
        begin += len(line) + 1
        previous = line.rstrip() or previous
    return found


def instrument(source: str, chosen: dict[int, Site]) -> str:
    """The source with switches for the chosen mistakes."""
    pieces = sorted(
        (start, end, text.replace("N>", f"{number}>").replace("(N)", f"({number})"))
        for number, site in chosen.items()
        for start, end, text in site.pieces
    )
    parts = ['#include "common/mutation.h"\n']
    place = 0
    for start, end, text in pieces:
        parts += [source[place:start], text]
        place = end
    return "".join([*parts, source[place:]])


def draw(source: str, count: int, seed: str) -> list[Site]:
    """A random sample of places that do not touch each other."""
    taken: set[int] = set()
    drawn: list[Site] = []
    candidates = sites(source)
    for site in random.Random(seed).sample(candidates, len(candidates)):
        places = {place for start, end, _ in site.pieces for place in range(start, end + 1)}
        if not places & taken and len(drawn) < count:
            taken |= places
            drawn.append(site)
    return sorted(drawn, key=lambda site: site.start)


def build(root: Path, copy: Path, chosen: dict[Path, dict[int, Site]], python: str) -> set[int]:
    """Compile a package beside the checkout's with the chosen mistakes; returns those that cannot be compiled.

    The package has links to the Python files of the checkout, and a core from changed sources.
    """
    (copy / "scripts").mkdir(parents=True, exist_ok=True)
    shutil.copy(root / "scripts" / "build", copy / "scripts")
    for name in ("robots", "tests", "pyproject.toml"):
        link(copy / name, root / name)
    for file in (root / "src" / "pinproof").iterdir():
        if not file.name.startswith("_core.") or file.suffix == ".pyi":
            link(copy / "src" / "pinproof" / file.name, file)
    refused: set[int] = set()
    core = copy / "src" / "core"
    for _ in range(8):
        numbers_of_line: dict[tuple[str, int], set[int]] = {}
        for file in (root / "src" / "core").rglob("*"):
            if not file.is_file():
                continue
            text = file.read_text(encoding="utf-8")
            mistakes = {n: site for n, site in chosen.get(file, {}).items() if n not in refused}
            for n, site in mistakes.items():
                for start, end, _ in site.pieces:
                    for line in range(text.count("\n", 0, start), text.count("\n", 0, end) + 1):
                        numbers_of_line.setdefault((file.name, line + 2), set()).add(n)
            write_if_changed(
                core / file.relative_to(root / "src" / "core"), instrument(text, mistakes) if mistakes else text
            )
        write_if_changed(core / "common" / "mutation.h", Path(__file__).with_name("mutation.h").read_text())
        done = subprocess.run([str(copy / "scripts" / "build"), python], capture_output=True, text=True)
        if done.returncode == 0:
            return refused
        # Errors name the place, or are explained by lines that do.
        named = re.findall(r"([\w.]+\.(?:cpp|h)):(\d+):\d+:", done.stdout + done.stderr)
        more = {n for name, line in named for n in numbers_of_line.get((name, int(line)), ())}
        if not more:
            raise SystemExit(f"the core with mistakes does not compile:\n{(done.stdout + done.stderr)[-4000:]}")
        refused |= more
    raise SystemExit("the core with mistakes does not compile after 8 attempts")


def link(place: Path, target: Path) -> None:
    """A symbolic link, made if it is missing."""
    place.parent.mkdir(parents=True, exist_ok=True)
    if not place.is_symlink():
        place.symlink_to(target)


def write_if_changed(file: Path, text: str) -> None:
    """Write a file, unless it holds the text, so that only what changed is compiled."""
    if not file.is_file() or file.read_text() != text:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
