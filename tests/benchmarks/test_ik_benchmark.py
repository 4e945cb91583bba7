"""A small run of the IK benchmark: rows, columns, independent check, provenance."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.ik import BENCHMARK, success_rates
from benchmarks.ik_methods import OWN_METHODS, PARTS, IkMethod, Part, PreparedMethod
from benchmarks.ik_peers import PEERS
from benchmarks.ik_run import (
    COLUMNS,
    ik_benchmark,
    ik_tables,
    measured_row,
    random_targets,
    rows_of,
    smooth_targets,
    with_reduced_ranges,
)
from benchmarks.tables import Results, Row

import pinproof as pp
from pinproof.errors import FileError, InputError

POINTS = 20


@pytest.fixture(scope="module")
def table() -> Results:
    return ik_benchmark(["ur5"], points=POINTS)


@pytest.fixture(scope="module")
def success() -> list[Row]:
    return success_rates(["ur5", "panda"], samples=50)


def test_iterative_methods_have_a_row_in_every_part(table: Results) -> None:
    for part in PARTS:
        named = {row.method for row in rows_of(table, "ur5", part)}
        assert named >= {"pseudo_inverse", "damped_least_squares", "clik"}


def test_every_method_has_a_row_or_a_reason(table: Results) -> None:
    for method in (*OWN_METHODS, *PEERS):
        assert (method.key in {row.method for row in table["rows"]}) or table["left_out"]["ur5"][method.key]


def test_rows_are_complete_and_plausible(table: Results) -> None:
    for row in table["rows"]:
        assert row.samples == POINTS
        assert 0 < row.median_ms <= row.p999_ms
        assert 0 < row.mean_ms <= row.p999_ms
        assert 0.0 <= row.success <= 1.0
        assert (row.largest_step is not None) == (row.problem == "trajectory")
        assert (row.ratio is None) or row.compared_with is not None
    own = [row for row in table["rows"] if row.compared_with is None]
    assert all(row.false_positives == 0 and row.position_error <= row.tolerance for row in own)
    assert all(row.batch_ms > 0 for row in own if row.problem == "random")


def test_clik_with_restarts_solves_all_targets(table: Results) -> None:
    rows = [row for row in table["rows"] if row.method == "clik" and row.restarts]
    assert [row.success for row in rows] == [1.0] * 3


def test_rows_contain_the_figures_of_the_textbook(table: Results) -> None:
    cells = {row.method: (row.textbook_ms, row.textbook_success) for row in table["rows"]}
    assert cells["pseudo_inverse"] == (1.20, 0.85)
    assert cells["damped_least_squares"] == (1.45, 0.95)
    assert cells["clik"] == (None, None)


def test_provenance_is_complete(table: Results) -> None:
    origin = table.provenance
    assert set(origin) == {"versions", "cpu", "cores", "system", "load", "seed", "commit", "date"}
    assert all(origin["versions"][name] for name in ("python", "pinproof", "pin", "numpy"))
    assert origin["cpu"]
    assert origin["cores"] >= 1
    assert origin["seed"] == 0
    assert origin["date"][:2] == "20"


def test_the_table_states_the_limits(table: Results) -> None:
    chain = table.settings["chains"]["ur5"]
    np.testing.assert_allclose(chain["upper"], np.pi, atol=1e-8)
    assert "+-pi" in table.settings["limits"]
    assert any("-3.142 to 3.142" in line for line in ik_tables(table))


def test_a_saved_table_is_read_unchanged(table: Results, tmp_path: Path) -> None:
    table.save(tmp_path / "ik.json")
    read = Results.load(tmp_path / "ik.json")
    assert read == table
    assert BENCHMARK.all_blocks(read) == BENCHMARK.all_blocks(table)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"rows": 1}'])
def test_other_files_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "ik.json").write_text(text)
    with pytest.raises(FileError):
        Results.load(tmp_path / "ik.json")


def test_rows_of_the_same_cell_are_replaced_and_others_are_kept(table: Results) -> None:
    new = Results(table.settings, {**table.provenance, "commit": "later"}, {"rows": [Row(robot="ur5", method="mine")]})
    both = new.added_to(table, ("robot", "method"))
    assert len(both["rows"]) == len({(row.robot, row.method) for row in table["rows"]}) + 1
    assert both.settings["measured"] == {"rows": "later", "left_out": table.provenance["commit"]}
    assert new.added_to(table, ())["rows"] == new["rows"]


def test_markdown_shows_every_row_and_column(table: Results) -> None:
    text = "\n".join(ik_tables(table))
    shown = [name for name in COLUMNS if name != "relative time" or any(row.ratio for row in table["rows"])]
    assert all(f" {name} |" in text for name in shown)
    lines = text.splitlines()
    assert sum(line.startswith("| Clik |") for line in lines) == len(PARTS)


def test_missing_peers_are_named(table: Results) -> None:
    text = "\n".join(ik_tables(table))
    for method in PEERS:
        reason = table["left_out"]["ur5"].get(method.key)
        assert reason is None or f"- {method.key}: {reason}" in text


def test_without_peers_only_own_methods_run() -> None:
    made = ik_benchmark(["ur5"], points=1, methods=["clik"], peers=False)
    assert made["left_out"] == {"ur5": {}}
    assert {row.method for row in made["rows"]} == {"clik"}


@pytest.mark.slow
def test_the_page_its_data_and_its_plots_are_written(
    table: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "benchmarks" / "ik.md").read_text(encoding="utf-8")
    (tmp_path / "ik.md").write_text(page, encoding="utf-8")
    monkeypatch.setattr("benchmarks.tables.FOLDER", tmp_path)
    BENCHMARK.write(table)
    assert BENCHMARK.stored == table
    assert "\n".join(ik_tables(table)) in (tmp_path / "ik.md").read_text(encoding="utf-8")
    for name in ("ik_latency.png", "ik_steps.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


@pytest.mark.parametrize(("words", "message"), [({"points": 0}, "at least 1"), ({"methods": ["magic"]}, "magic")])
def test_invalid_settings_are_refused(words: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ik_benchmark(["ur5"], **{"points": 1, **words})


def wrong_method(arm: pp.Arm, part: Part) -> PreparedMethod:
    """Reports a configuration beside the start as the answer to every target."""
    return PreparedMethod(
        solve=lambda target, q0: q0,
        read=lambda q: q[None] + 0.3,
        solve_batch=lambda targets, q0: np.tile(q0 + 0.3, (len(targets), 1, 1)),
    )


@pytest.mark.parametrize("part", PARTS, ids=str)
def test_wrong_answers_are_false_positives(part: Part) -> None:
    arm = with_reduced_ranges(pp.load_robot("ur5").arm())
    make = random_targets if part.problem == "random" else smooth_targets
    row = measured_row(arm, "ur5", IkMethod("wrong", "wrong", wrong_method), part, make(arm, POINTS, 0))
    assert row is not None
    assert row.success == 0.0
    assert row.false_positives == 2 * POINTS  # single calls and a batch
    assert row.position_error > 1e-3


def test_the_trajectory_starts_each_call_at_the_last_answer() -> None:
    arm = pp.load_robot("ur5").arm()
    targets, seen = smooth_targets(arm, 5, 0), []

    def prepare(arm: pp.Arm, part: Part) -> PreparedMethod:
        seen.clear()
        ik = pp.Clik()
        return PreparedMethod(
            solve=lambda target, q0: (seen.append(q0), ik.solve(arm, target, q0))[1], read=lambda found: found.q[None]
        )

    row = measured_row(arm, "ur5", IkMethod("seen", "seen", prepare), Part("trajectory", "pose", True), targets)
    np.testing.assert_allclose(seen, [targets.start, *targets.q[:-1]], atol=1e-5)
    assert row.largest_step == pytest.approx(np.abs(np.diff(targets.q, axis=0)).max(), abs=1e-5)


def test_an_error_of_a_peer_is_listed_and_does_not_end_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(arm: pp.Arm, part: Part) -> PreparedMethod:
        raise OSError("its library is gone")

    peer = IkMethod("broken", "broken", broken, compared_with="clik")
    monkeypatch.setattr("benchmarks.ik_run.PEERS", (peer,))
    made = ik_benchmark(["ur5"], points=1, methods=["clik", "broken"])
    assert made["left_out"] == {"ur5": {"broken": "OSError: its library is gone"}}
    assert {row.method for row in made["rows"]} == {"clik"}


def test_the_ratio_refers_to_our_method_in_the_same_part(monkeypatch: pytest.MonkeyPatch) -> None:
    peer = replace(OWN_METHODS[0], key="peer", compared_with="clik", textbook=None)
    monkeypatch.setattr("benchmarks.ik_run.PEERS", (peer,))
    made = ik_benchmark(["ur5"], points=2, methods=["clik", "peer"])
    for part in PARTS:
        ours, theirs = rows_of(made, "ur5", part)
        assert theirs.ratio == pytest.approx(theirs.mean_ms / ours.mean_ms)
        assert ours.ratio is None


def test_success_rates_count_solved_targets(success: list[Row]) -> None:
    rows = [(row.robot, row.method) for row in success]
    assert rows == [("ur5", "clik"), ("ur5", "analytic"), ("panda", "clik")]
    assert all(row.samples == 50 and row.success == 1.0 and row.false_positives == 0 for row in success)
    assert all(row.batch_us > 0 for row in success)


def test_the_configuration_that_generated_the_target_is_among_the_branches(
    success: list[Row],
) -> None:
    recovered = {(row.robot, row.method): row.recovered for row in success}
    assert recovered == {("ur5", "clik"): None, ("ur5", "analytic"): 1.0, ("panda", "clik"): None}


def test_the_blocks_have_success_rates(table: Results, success: list[Row]) -> None:
    with_rates = deepcopy(table)
    with_rates.parts["success"] = success
    assert "| panda | Clik | 100 % | 0 |" in "\n".join(BENCHMARK.blocks(with_rates)["success"])
    assert BENCHMARK.blocks(table)["success"] == []


def test_an_arm_without_a_closed_form_is_left_out_with_the_reason(tmp_path: Path) -> None:
    rows = [
        pp.DhRow(f"j{k}", 0.3, 0.1 + 0.02 * k, 0.2, 0.7 + 0.1 * k, kind, -0.5, 0.5, 1.0)
        for k, kind in enumerate(["revolute", "prismatic", "prismatic", "prismatic", "prismatic", "revolute"])
    ]
    robot = str(tmp_path / "general.urdf")
    pp.write_urdf(pp.DhTable(rows, convention="standard", name="general"), robot)
    made = ik_benchmark([robot], points=1, methods=["analytic", "clik"], peers=False)
    assert made["left_out"][robot]["analytic"].startswith("no closed form")
    assert {row.method for row in made["rows"]} == {"clik"}


def test_stored_rows_have_the_fields_of_a_row(table: Results) -> None:
    """If this fails after a change of the fields, run the benchmark again."""
    assert all(vars(row).keys() == vars(table["rows"][0]).keys() for row in BENCHMARK.stored["rows"])


def test_tracking_has_a_row_for_the_trajectory_only(table: Results) -> None:
    (row,) = [row for row in table["rows"] if row.method == "tracking"]
    assert row.problem == "trajectory"
    assert row.batch_ms > 0
    assert row.success == 1.0
    arm = pp.load_robot("ur5").arm()
    assert row.largest_step <= 1e-3 * arm.limits.velocity.max()
