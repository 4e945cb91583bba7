"""The table of a tiny run: every row and column, judged apart from the methods, with its provenance."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.benchmarks import IkTable, ik_benchmark, ik_markdown, success_rates, write_ik_table
from pinproof.benchmarks.ik_markdown import COLUMNS
from pinproof.benchmarks.ik_measure import IkRow, measure
from pinproof.benchmarks.ik_methods import Asked, IkMethod, Solvers
from pinproof.benchmarks.ik_own import OWN
from pinproof.benchmarks.ik_peers import PEERS
from pinproof.benchmarks.ik_problems import narrowed, random_targets, smooth_targets
from pinproof.benchmarks.ik_table import PARTS
from pinproof.errors import FileError, InputError

POINTS = 20
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def table() -> IkTable:
    made = ik_benchmark(["ur5"], points=POINTS)
    return replace(made, success=success_rates(["ur5", "panda"], samples=50))


def test_iterative_methods_have_a_row_in_every_part(table: IkTable) -> None:
    for asked in PARTS:
        named = {row.method for row in table.part("ur5", asked)}
        assert named >= {"pseudo_inverse", "damped_least_squares", "clik"}


def test_every_method_has_a_row_or_a_reason(table: IkTable) -> None:
    for method in (*OWN, *PEERS):
        assert (method.key in {row.method for row in table.rows}) or table.left_out["ur5"][method.key]


def test_rows_are_whole_and_plausible(table: IkTable) -> None:
    for row in table.rows:
        assert row.samples == POINTS
        assert 0 < row.median_ms <= row.p999_ms
        assert 0 < row.mean_ms <= row.p999_ms
        assert 0.0 <= row.success <= 1.0
        assert (row.largest_step is not None) == (row.problem == "trajectory")
        assert (row.ratio is None) or row.rival is not None
    own = [row for row in table.rows if row.rival is None]
    assert all(row.false_yes == 0 and row.position_error <= row.tolerance for row in own)
    assert all(row.batch_ms > 0 for row in own if row.problem == "random")


def test_clik_solves_what_it_is_asked_with_restarts(table: IkTable) -> None:
    rows = [row for row in table.rows if row.method == "clik" and row.restarts]
    assert [row.success for row in rows] == [1.0] * 3


def test_the_textbook_stands_beside_ours(table: IkTable) -> None:
    cells = {row.method: (row.textbook_ms, row.textbook_success) for row in table.rows}
    assert cells["pseudo_inverse"] == (1.20, 0.85)
    assert cells["damped_least_squares"] == (1.45, 0.95)
    assert cells["clik"] == (None, None)


def test_provenance_is_complete(table: IkTable) -> None:
    origin = table.provenance
    assert set(origin) == {"versions", "cpu", "cores", "system", "load", "seed", "commit", "date"}
    assert all(origin["versions"][name] for name in ("python", "pinproof", "pin", "numba", "numpy"))
    assert origin["cpu"]
    assert origin["cores"] >= 1
    assert origin["seed"] == 0
    assert origin["date"][:2] == "20"


def test_limits_of_the_run_are_stated(table: IkTable) -> None:
    chain = table.settings["chains"]["ur5"]
    np.testing.assert_allclose(chain["upper"], np.pi, atol=1e-8)
    assert "+-pi" in ik_markdown(table)


def test_json_comes_back_as_it_was(table: IkTable, tmp_path: Path) -> None:
    table.save(tmp_path / "ik.json")
    assert IkTable.load(tmp_path / "ik.json") == table
    assert ik_markdown(IkTable.load(tmp_path / "ik.json")) == ik_markdown(table)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"rows": 1}'])
def test_what_is_no_table_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "ik.json").write_text(text)
    with pytest.raises(FileError, match="no table"):
        IkTable.load(tmp_path / "ik.json")


def test_markdown_shows_every_row_and_column(table: IkTable) -> None:
    text = ik_markdown(table)
    shown = [name for name in COLUMNS if name != "times ours" or any(row.ratio for row in table.rows)]
    assert all(f" {name} |" in text for name in shown)
    lines = text.splitlines()
    assert sum(line.startswith("| CLIK |") for line in lines) == len(PARTS)
    prose = " ".join(text.split())
    assert "the textbook's own figures" in prose
    assert f"p99.9 is of {POINTS} calls" in prose


def test_missing_peers_are_named(table: IkTable) -> None:
    text = ik_markdown(table)
    for method in PEERS:
        reason = table.left_out["ur5"].get(method.key)
        assert reason is None or f"- {method.key}: {reason}" in text


def test_without_peers_none_is_asked() -> None:
    made = ik_benchmark(["ur5"], points=1, methods=["clik"], peers=False)
    assert made.left_out == {"ur5": {}}
    assert {row.method for row in made.rows} == {"clik"}


def test_files_are_written_and_plots_are_pictures(table: IkTable, tmp_path: Path) -> None:
    written = write_ik_table(table, tmp_path)
    assert [path.name for path in written] == ["ik.json", "ik.md", "ik_latency.png", "ik_steps.png"]
    for path in written[2:]:
        assert path.read_bytes().startswith(PNG)
    assert json.loads(written[0].read_text())["settings"]["points"] == POINTS


@pytest.mark.parametrize(("words", "message"), [({"points": 0}, "at least 1"), ({"methods": ["magic"]}, "magic")])
def test_nonsense_is_refused(words: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ik_benchmark(["ur5"], **{"points": 1, **words})


def liar(arm: pp.Arm, asked: Asked) -> Solvers:
    """Claims that wherever it stands is the answer."""
    return Solvers(
        one=lambda target, q0: q0,
        read=lambda q: q[None] + 0.3,
        many=lambda targets, q0: np.tile(q0 + 0.3, (len(targets), 1, 1)),
    )


@pytest.mark.parametrize("asked", PARTS, ids=str)
def test_a_method_that_claims_wrong_answers_solves_nothing(asked: Asked) -> None:
    arm = narrowed(pp.load_robot("ur5").arm())
    make = random_targets if asked.problem == "random" else smooth_targets
    row = measure(arm, "ur5", IkMethod("liar", "liar", liar), asked, make(arm, POINTS, 0))
    assert row is not None
    assert row.success == 0.0
    assert row.false_yes == 2 * POINTS  # single calls and a batch
    assert row.position_error > 1e-3


def test_the_trajectory_starts_each_call_at_the_last_answer() -> None:
    arm = pp.load_robot("ur5").arm()
    targets, seen = smooth_targets(arm, 5, 0), []

    def prepare(arm: pp.Arm, asked: Asked) -> Solvers:
        seen.clear()
        ik = pp.Clik()
        return Solvers(
            one=lambda target, q0: (seen.append(q0), ik.solve(arm, target, q0))[1], read=lambda found: found.q[None]
        )

    row = measure(arm, "ur5", IkMethod("seen", "seen", prepare), Asked("trajectory", "pose", True), targets)
    np.testing.assert_allclose(seen, [targets.start, *targets.q[:-1]], atol=1e-5)
    assert row.largest_step == pytest.approx(np.abs(np.diff(targets.q, axis=0)).max(), abs=1e-5)


def test_a_peer_that_breaks_is_named_and_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(arm: pp.Arm, asked: Asked) -> Solvers:
        raise OSError("its library is gone")

    peer = IkMethod("broken", "broken", broken, rival="clik")
    monkeypatch.setattr("pinproof.benchmarks.ik_run.PEERS", (peer,))
    made = ik_benchmark(["ur5"], points=1, methods=["clik", "broken"])
    assert made.left_out == {"ur5": {"broken": "OSError: its library is gone"}}
    assert {row.method for row in made.rows} == {"clik"}


def test_the_ratio_is_to_the_rival_for_the_same_question(monkeypatch: pytest.MonkeyPatch) -> None:
    peer = replace(OWN[0], key="peer", rival="clik", textbook=None)
    monkeypatch.setattr("pinproof.benchmarks.ik_run.PEERS", (peer,))
    made = ik_benchmark(["ur5"], points=2, methods=["clik", "peer"])
    for asked in PARTS:
        ours, theirs = made.part("ur5", asked)
        assert theirs.ratio == pytest.approx(theirs.mean_ms / ours.mean_ms)
        assert ours.ratio is None


def test_the_big_check_counts_what_was_solved(table: IkTable) -> None:
    asked = [(row.robot, row.method) for row in table.success]
    assert asked == [("ur5", "clik"), ("ur5", "analytic"), ("panda", "clik")]
    assert all(row.samples == 50 and row.success == 1.0 and row.false_yes == 0 for row in table.success)
    assert all(row.batch_us > 0 for row in table.success)


def test_every_branch_is_claimed_and_the_configuration_behind_the_target_is_one(table: IkTable) -> None:
    again = {(row.robot, row.method): row.found_again for row in table.success}
    assert again == {("ur5", "clik"): None, ("ur5", "analytic"): 1.0, ("panda", "clik"): None}


def test_an_arm_without_a_closed_form_is_left_out_with_the_reason() -> None:
    made = ik_benchmark(["baxter_left"], points=1, methods=["analytic", "clik"], peers=False)
    assert made.left_out["baxter_left"]["analytic"].startswith("no closed form")
    assert {row.method for row in made.rows} == {"clik"}


def test_a_row_says_no_more_than_its_fields() -> None:
    """A column that a stored table does not know would make it unreadable: then run the table anew."""
    stored = Path(__file__).parents[2] / "docs" / "benchmarks" / "ik.json"
    known = {field.name for field in fields(IkRow)}
    assert all(set(row) == known for row in json.loads(stored.read_text(encoding="utf-8"))["rows"])


def test_tracking_answers_along_the_trajectory_alone(table: IkTable) -> None:
    (row,) = [row for row in table.rows if row.method == "tracking"]
    assert row.problem == "trajectory"
    assert row.batch_ms > 0
    assert row.success == 1.0
    arm = pp.load_robot("ur5").arm()
    assert row.largest_step <= 1e-3 * arm.limits.velocity.max()
