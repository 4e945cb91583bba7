"""``pinproof bench``: the textbook's table for any arm, and error messages."""

from __future__ import annotations

import json

import numpy as np
import pytest

import pinproof as pp
from pinproof.ik.methods import bench

SMALL = ("bench", "ur5", "--points", "3")


def test_the_table_is_markdown_with_the_selected_methods(run) -> None:
    code, out, _ = run(*SMALL, "--methods", "clik, fabrik")
    assert code == 0
    assert [line.split("|")[1].strip() for line in out.splitlines()[2:]] == ["clik"] * 4 + ["fabrik"] * 4
    assert "0.4 ms, 98 %" in out


def test_json_contains_every_method_and_part(run) -> None:
    code, out, _ = run(*SMALL, "--json", "--seed", "4")
    table = json.loads(out)
    assert (code, table["seed"], table["left_out"]) == (0, 4, {})
    assert [row["method"] for row in table["rows"]].count("clik") == 4
    assert [(row["task"], row["success"]) for row in table["rows"] if row["method"] == "analytic"] == [("pose", 1.0)]


def test_methods_that_do_not_apply_are_listed_with_the_reason(run) -> None:
    code, out, _ = run("bench", "talos_left", "--base", "base_link", "--points", "1", "--methods", "analytic")
    assert code == 0
    assert "not applicable: analytic: " in out


class TestCheckOfAnswers:
    """The answers are checked by forward kinematics and the limits, not by the status that a method reports."""

    def rows(self, monkeypatch: pytest.MonkeyPatch, change) -> list:
        solve = pp.Clik.solve

        def changed(self, *args, **settings):
            result = solve(self, *args, **settings)
            q = change(np.array(result.q))
            return type(result)(**{**vars(result), "q": q})

        monkeypatch.setattr(pp.Clik, "solve", changed)
        return bench(pp.load_robot("ur5").arm(), points=4, methods=["clik"])[0]

    def test_a_wrong_pose_is_a_false_positive(self, monkeypatch: pytest.MonkeyPatch) -> None:
        rows = self.rows(monkeypatch, lambda q: q + 1e-4 * np.eye(6)[0])
        assert [(row.success, row.false_positives) for row in rows if row.restarts] == [(0.0, 4)] * 2

    def test_an_answer_outside_the_limits_is_a_false_positive(self, monkeypatch: pytest.MonkeyPatch) -> None:
        rows = self.rows(monkeypatch, lambda q: q + 4 * np.pi * np.eye(6)[0])
        assert [(row.success, row.false_positives) for row in rows if row.restarts] == [(0.0, 4)] * 2


@pytest.mark.parametrize(
    ("words", "named"),
    [(("bench", "ur5", "--methods", "magic", "--points", "1"), "magic"), (("bench", "nobody"), "'nobody'")],
)
def test_unknown_names_are_reported(run, words: tuple[str, ...], named: str) -> None:
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert named in err


@pytest.mark.parametrize("words", [("bench",), ("bench", "ur5", "--points", "0")])
def test_wrong_usage_is_exit_code_2(run, words: tuple[str, ...]) -> None:
    assert run(*words)[0] == 2
