#!/usr/bin/env python3
"""Count the words that CONTRIBUTING.md asks to avoid in texts that people read.

python scripts/check_language.py              the rate per 1,000 words of each kind of text, and the words found
python scripts/check_language.py --list       every occurrence with its file and line

Texts are the manual and the other Markdown files (without code), docstrings, and the string literals of the package,
which are its messages and help texts.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]

AVOIDED = {
    r"tells?|told|telling": "reports, states, shows",
    r"stands?(?! for)|stood|standing": "is, is in, exists",
    r"bears?|bore|borne": "supports, allows, carries",
    r"(?:is|are|was|were) none": "does not exist",
    r"look(?:s|ed)? at(?: again)?": "checks, checked",
    r"(?:it|they|he|is|are|as|was|were|be|been|otherwise|nothing|what|which) said|says?": "states, stated, given",
    r"goes? on with|gone on with|goes on|go on": "continues, resumes",
    r"taken at (?:its|their) word": "trusted",
    r"whole turns?": "2 pi windings, full rotations",
    r"slid(?:e|es|ing) joints?|joints? that slides?|joints? that turns?|turning joints?": "prismatic, revolute",
    r"houses?|rooms?": "package, module",
    r"(?<!by )(?<!either )(?<!this )(?<!one )(?<!other )ways?": "path, line, method",
    r"false yes(?:es)?|silent yes": "false positive",
    r'"no"|"yes"|\byes\b': "FREE / COLLIDING, solved / failed",
    r"settle[sd]?": "proven, decided",
    r"from (?:here|there|then|now|where|which|it|this|that) on": "after, beginning with",
    r"as well as may be|as far as nothing|as far as may be": "if, as far as possible",
    r"believes?|knows? of no|does not know|knows nothing": "no personification",
    r"anyhow|whatever its|not without": "plain statement",
    r"nowhere else|somebody|nobody": "the user, no",
    r"at the most|of its own|of their own": "at most, own",
}
"""Regular expressions of words to avoid, each with its replacements."""

WORD = re.compile(r"[A-Za-z][A-Za-z'-]+")
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`[^`\n]*`|\]\([^)]*\)|^\|[-: |]+\|$|(?<=\| )(?:yes|no)(?= \|)", re.MULTILINE)
PATTERNS = {re.compile(rf"(?<![\w-])(?:{words})(?![\w-])", re.IGNORECASE): words for words in AVOIDED}


class Text(NamedTuple):
    """A piece of text, its kind, its file, and the line where it begins."""

    kind: str
    file: Path
    line: int
    text: str


def blanked(text: str, pattern: re.Pattern[str]) -> str:
    """The text without what a pattern matches, with its line breaks."""
    return pattern.sub(lambda match: "\n" * match[0].count("\n"), text)


def markdown_texts() -> Iterator[Text]:
    """README, CONTRIBUTING, CHANGELOG and the manual, without code and without generated tables."""
    for file in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "robots").rglob("*.md")]:
        yield Text("Markdown", file, 1, blanked(blanked(file.read_text(encoding="utf-8"), FENCE), CODE))


def python_texts() -> Iterator[Text]:
    """Docstrings, and string literals with at least three words."""
    for file in sorted((ROOT / "src").rglob("*.py")):
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        docstrings = {
            id(node.value)
            for node in nodes
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        }
        for node in nodes:
            if not (isinstance(node, ast.Constant) and isinstance(node.value, str)):
                continue
            if id(node) in docstrings:
                yield Text("docstrings", file, node.lineno, blanked(node.value, CODE))
            elif len(WORD.findall(node.value)) >= 3:
                yield Text("messages", file, node.lineno, blanked(node.value, CODE))


class Found(NamedTuple):
    """An occurrence of a word to avoid: the text, the line in its file, the word, and the pattern that it matches."""

    text: Text
    line: int
    word: str
    pattern: str


def words_to_avoid(texts: Iterable[Text]) -> Iterator[Found]:
    """Every occurrence of a word to avoid."""
    for text in texts:
        for pattern, name in PATTERNS.items():
            for match in pattern.finditer(text.text):
                yield Found(text, text.line + text.text.count("\n", 0, match.start()), match[0], name)


def rate_per_1000() -> float:
    """Occurrences of words to avoid per 1,000 words of all texts."""
    texts = [*markdown_texts(), *python_texts()]
    return 1000 * sum(1 for _ in words_to_avoid(texts)) / sum(len(WORD.findall(text.text)) for text in texts)


def main() -> int:
    """Print the rates; with ``--list`` the occurrences too."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true", help="print every occurrence")
    options = parser.parse_args()
    words: Counter[str] = Counter()
    found: Counter[str] = Counter()
    by_pattern: Counter[str] = Counter()
    for text in (*markdown_texts(), *python_texts()):
        words[text.kind] += len(WORD.findall(text.text))
        for each in words_to_avoid([text]):
            found[text.kind] += 1
            by_pattern[each.pattern] += 1
            if options.list:
                file = text.file.relative_to(ROOT)
                print(f"{file}:{each.line}: {each.word!r}; better: {AVOIDED[each.pattern]}")
    for kind, count in words.items():
        print(f"{kind}: {found[kind]} of {count} words, {1000 * found[kind] / count:.2f} per 1,000")
    total = sum(words.values())
    print(f"all: {sum(found.values())} of {total} words, {1000 * sum(found.values()) / total:.2f} per 1,000")
    for name, count in by_pattern.most_common(12):
        print(f"  {count:5d}  {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
