"""The pages show the stored results; times depend on the machine, so no test asserts them."""

from __future__ import annotations

import re
from importlib import import_module
from typing import Any

import pytest
from benchmarks.__main__ import TOPICS
from benchmarks.ik_methods import PARTS
from benchmarks.ik_run import rows_of as rows_of_arm
from benchmarks.planning import MOTION
from benchmarks.planning_problems import OWN_ROBOTS, OWN_SCENES
from benchmarks.planning_run import OWN_PROBLEMS, methods_of, rows_of
from benchmarks.tables import FOLDER, Benchmark

from ..pages import ROOT, run_page

PAGES = (
    "ik", "planning", "collision", "several_arms", "reuse", "depth", "scaling", "picks", "own_cells", "sequence",
    "cell", "replanning", "holding", "tool_paths", "programs",
)  # fmt: skip
ALL = {name: import_module(f"benchmarks.{name}").BENCHMARK for name in PAGES} | {"motion": MOTION}


@pytest.mark.parametrize("benchmark", ALL.values(), ids=ALL)
def test_the_page_shows_the_stored_results(benchmark: Benchmark) -> None:
    page = (FOLDER / f"{benchmark.page or benchmark.name}.md").read_text(encoding="utf-8")
    assert benchmark.page_text(benchmark.stored) == page, "run ./scripts/benchmark TOPIC --render"


@pytest.mark.parametrize("benchmark", ALL.values(), ids=ALL)
def test_no_stored_verdict_is_wrong(benchmark: Benchmark) -> None:
    assert benchmark.stored.faults == []


def test_every_benchmark_has_its_command_among_those_that_reproduce_the_tables() -> None:
    page = (ROOT / "docs" / "reproduce.md").read_text(encoding="utf-8")
    commands = set(re.findall(r"\./scripts/benchmark (\w+)", page)) - {"TOPIC"}
    _, _, with_topic = page.partition("./scripts/benchmark TOPIC")
    named = set(re.findall(r"`(\w+)`", with_topic.partition("\n")[0]))
    assert commands | named == set(TOPICS)


def test_the_stored_results_of_inverse_kinematics_are_complete() -> None:
    stored = ALL["ik"].stored
    assert stored.settings["points"] == 10_000
    assert all(rows_of_arm(stored, robot, part) for robot in stored.settings["robots"] for part in PARTS)
    assert {row.samples for row in stored["success"]} == {100_000}


def test_the_stored_results_of_planning_are_complete_and_the_check_finds_faults() -> None:
    stored = ALL["planning"].stored
    assert len(rows_of(stored, "problems", collection="mbm")) == 140
    for robot in OWN_ROBOTS:
        for scene in OWN_SCENES:
            assert len(rows_of(stored, "problems", collection=robot, set_name=scene)) == OWN_PROBLEMS
    assert {"roboplan", "ompl", "mplib", "tesseract_TrajOptPipeline"} <= set(methods_of(stored))
    for method in methods_of(stored):
        assert len(rows_of(stored, "rows", collection="mbm", method=method)) == 140
    assert any(row.faults for row in stored["rows"])
    motions = rows_of(MOTION.stored, "rows", variant="")
    assert len(motions) == 140
    assert all(row.certified for row in motions)


def test_the_examples_of_the_page_on_inverse_kinematics_run(tmp_path: Any) -> None:
    names: dict[str, Any] = run_page(ROOT / "docs" / "ik.md", tmp_path)
    assert names["only_there"].ok
    assert names["many"].ok.all()
