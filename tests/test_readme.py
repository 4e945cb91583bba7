"""The README runs as printed and says what is true; the programs of the gallery run, and have pictures and pages."""

from __future__ import annotations

import os
import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .pages import ROOT, blocks, commands, reader_folder, run_command, run_python

README = ROOT / "README.md"
GALLERY = ROOT / "docs" / "gallery.md"
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("*.py"))
LINK = re.compile(r"\]\((?!https?://|#)([^)#]+)")


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def test_every_block_is_python_or_shell() -> None:
    assert {block.language for block in blocks(README)} == {"python", "sh"}


@pytest.mark.slow
def test_python_blocks_run_in_order(tmp_path: Path) -> None:
    names: dict[str, object] = {"__name__": "readme"}
    with reader_folder(tmp_path):
        for block in blocks(README, "python"):
            run_python("\n" * block.line + block.text, README, names)
    assert (tmp_path / "motion.html").stat().st_size > 0


def test_the_first_example_has_at_most_eight_lines() -> None:
    first = next(iter(blocks(README, "python")))
    assert len([line for line in first.text.splitlines() if line.strip()]) <= 8


@pytest.mark.slow
def test_command_lines_run_in_order(tmp_path: Path) -> None:
    with reader_folder(tmp_path):
        for block in blocks(README, "sh"):
            for words, code in commands(block):
                if words != ["pip", "install", "pinproof"]:  # tests/test_packaging.py runs this one
                    run_command(words, code, f"README.md, line {block.line}")


def test_linked_files_exist() -> None:
    assert [link for link in LINK.findall(text_of(README)) if not (ROOT / link).exists()] == []


def test_named_scripts_are_executable() -> None:
    named = set(re.findall(r"`\./(scripts/\w+)", text_of(README)))
    assert {name for name in named if os.access(ROOT / name, os.X_OK)} == named != set()


def test_readme_has_at_most_120_lines() -> None:
    assert len(text_of(README).splitlines()) <= 120


def test_every_reported_problem_of_others_is_cited_by_its_number() -> None:
    cited = dict(re.findall(r"\[[^\]]*#(\d+)\]\(https://github.com/([\w/-]+)\)", text_of(README)))
    assert {f"{thread.split('/')[1]}#{number}" for number, thread in cited.items()} == {
        "moveit2#3759",
        "curobo#641",
        "moveit_task_constructor#445",
        "vamp#62",
        "moveit2#2600",
        "curobo#500",
    }
    assert all(thread.endswith(f"/{number}") for number, thread in cited.items())


# The gallery: ten programs, each with a picture and a page.


def facts_of_bolt_pick(names: dict[str, Any]) -> None:
    failed = {verdict.pick.name: verdict.failed.value for verdict in names["report"].verdicts if not verdict.ok}
    assert failed == {"bolt_3": "grasp", "bolt_4": "grasp", "bolt_6": "reach"}
    assert all(verdict.certificate.free for verdict in names["report"].good)


def facts_of_mixed_bin(names: dict[str, Any]) -> None:
    good = names["report"].good
    assert {verdict.tool for verdict in good} == {"jaws", "cup"}
    assert len(good) == 3


def facts_of_two_arms(names: dict[str, Any]) -> None:
    assert names["motion"].certificate.free
    assert names["cell"].dof == 12


def facts_of_conveyor(names: dict[str, Any]) -> None:
    (verdict,) = names["report"].good
    assert len(verdict.motions) == 8
    assert all(motion.certificate.free and motion.movers for motion in verdict.motions)


def facts_of_rail(names: dict[str, Any]) -> None:
    ends = [names["motion"].trajectory.start, names["motion"].trajectory.end]
    assert names["motion"].certificate.free
    assert abs(ends[1][0] - ends[0][0]) > 0.5  # the rail moves


def facts_of_tool_path(names: dict[str, Any]) -> None:
    assert names["seam"].ok
    assert names["seam"].deviation <= 1e-3


def facts_of_depth_image(names: dict[str, Any]) -> None:
    assert names["motion"].certificate.free
    assert any("not seen is an obstacle" in note for note in names["motion"].certificate.notes)


def facts_of_cell_placement(names: dict[str, Any]) -> None:
    assert names["found"].ok
    assert len(names["best"].report.good) == 3


def facts_of_general_arm(names: dict[str, Any]) -> None:
    arm, target, found = names["arm"], names["target"], names["found"]
    assert found.complete
    assert len(found.branches) == 10  # more than any arm with a spherical wrist has
    for q in found.branches:
        assert np.abs(arm.forward_kinematics(q).homogeneous - target.homogeneous).max() < 1e-9
    assert min(np.abs(a - b).max() for k, a in enumerate(found.branches) for b in found.branches[:k]) > 0.02


def facts_of_calibrated_ur(names: dict[str, Any]) -> None:
    assert 1e-3 < np.linalg.norm(names["missed"]) < 1e-2
    assert np.abs(names["reached"] - names["target"].translation).max() < 1e-6
    assert names["motion"].certificate.free


FACTS = {name.removeprefix("facts_of_"): check for name, check in globals().items() if name.startswith("facts_of_")}


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda file: file.stem)
def test_a_program_of_the_gallery_does_what_it_says_and_writes_its_page(
    example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = runpy.run_path(str(example))
    FACTS[example.stem](names)
    assert (tmp_path / f"{example.stem}.html").stat().st_size > 100_000


def test_ten_programs_have_at_most_thirty_lines_and_their_picture_and_page_are_linked() -> None:
    assert {file.stem for file in EXAMPLES} == set(FACTS)
    assert len(EXAMPLES) == 10
    readme, gallery = text_of(README), text_of(GALLERY)
    for file in EXAMPLES:
        assert len(text_of(file).splitlines()) <= 30, file.name
        assert file.with_suffix(".webp").stat().st_size < 60_000
        assert f"](docs/examples/{file.stem}.webp)" in readme
        cell = next(line for line in readme.splitlines() if f"docs/examples/{file.name}" in line)
        assert re.search(rf"\]\(docs/[\w/#.-]+\), \[program\]\(docs/examples/{re.escape(file.name)}\)", cell)
        assert f"](examples/{file.stem}.webp)" in gallery
        assert f"{{literalinclude}} examples/{file.name}" in gallery
    assert [link for link in LINK.findall(gallery) if not (GALLERY.parent / link).exists()] == []
