"""Texts that people read avoid the words listed in CONTRIBUTING.md, as scripts/check_language.py counts them."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from .pages import ROOT

CHECK = runpy.run_path(str(ROOT / "scripts" / "check_language.py"))

LIMIT = 0.5
"""Words to avoid per 1,000 words."""


def found(text: str) -> list[str]:
    return [each.word for each in CHECK["words_to_avoid"]([CHECK["Text"]("Markdown", Path("page.md"), 1, text)])]


@pytest.mark.slow
def test_few_words_to_avoid_are_left() -> None:
    rate = CHECK["rate_per_1000"]()
    assert rate < LIMIT, f"{rate:.2f} per 1,000 words; python scripts/check_language.py --list prints them"


@pytest.mark.parametrize("word", ["told", "stands", "is none", "looked at", "house", "settled"])
def test_words_to_avoid_are_counted(word: str) -> None:
    assert found(f"First line.\nThe text {word} here.") == [word]


def test_plain_text_has_no_word_to_avoid() -> None:
    assert found("The checker reports the signed distance of each pair of bodies; either way, it is in metres.") == []


def test_occurrences_have_the_line_of_the_file() -> None:
    text = CHECK["Text"]("docstrings", Path("module.py"), 10, "First line.\n\nThe checker was told.")
    assert [each.line for each in CHECK["words_to_avoid"]([text])] == [12]
