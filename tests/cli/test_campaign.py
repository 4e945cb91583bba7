"""``pinproof pick --campaign``: rows in a folder, resumed after Ctrl-C; usage errors in one line."""

from __future__ import annotations

import json
import shutil
import signal
import sys
from pathlib import Path

import pytest

from pinproof.cli import pick
from pinproof.description import robots_folder
from pinproof.picks import Campaign

from ..pages import Run
from ..processes import PATIENCE, RUN_CLI, WRITTEN, rows_in, started, wait_for

SHARED = "robot: generic_6dof\nscene: scene.yaml\nmargin: 0.002\ntip: {xyz: [0, 0, 0.005]}\n"
DEFAULTS = "defaults: {rpy: [pi, 0, 0], approach: 0.02, retreat: 0.02}\npicks: many.csv\n"


@pytest.fixture
def run(run: Run, tmp_path: Path) -> Run:
    """Run a command line in this process, in a folder with a file of picks: exit code, stdout, stderr."""
    shutil.copy(robots_folder() / "generic_6dof" / "scene.yaml", tmp_path)
    (tmp_path / "picks.yaml").write_text(SHARED + DEFAULTS)
    table(3)
    return run


def table(count: int, *more: str) -> None:
    """A table of good picks beside the picks file, followed by further rows."""
    rows = [f"pin_{k},{0.4 - 0.0005 * k},-0.15,0.035" for k in range(count)]
    Path("many.csv").write_text("\n".join(["name,x,y,z", *rows, *more]) + "\n")


@pytest.mark.slow
def test_rows_stream_to_the_folder_and_all_good_is_0(run: Run) -> None:
    code, out, err = run("pick", "picks.yaml", "--campaign", "out", "--workers", "1")
    assert (code, err) == (0, "")
    assert out.startswith("3 of 3 picks good\nnot covered: picks without `object:`")
    assert out.endswith("wrote out/rows.jsonl\n")
    header, *rows = [json.loads(line) for line in Path("out/rows.jsonl").read_text().splitlines()]
    assert header["setup"]["robot"].startswith("generic_6dof ")
    assert [row["name"] for row in rows] == ["pin_0", "pin_1", "pin_2"]


@pytest.mark.slow
def test_rows_of_a_campaign_are_written_as_a_page(run: Run) -> None:
    code, out, _ = run("pick", "picks.yaml", "--campaign", "out", "--workers", "1", "-o", "page.html")
    assert code == 0
    assert out.endswith("wrote out/rows.jsonl and page.html\n")
    page = Path("page.html").read_text(encoding="utf-8")
    assert all(f"<td>pin_{k}</td>" in page for k in range(3))
    assert '"motions":[null,null,null]' in page


@pytest.mark.slow
def test_a_failed_pick_is_1_and_another_campaign_in_the_folder_is_2(run: Run) -> None:
    table(1, "far,2,0,0", "torn,nan,0,0")
    first = run("pick", "picks.yaml", "--campaign", "out", "--workers", "1", "--json")
    again = run("pick", "picks.yaml", "--campaign", "out", "--json")
    assert (first[0], first[2]) == (again[0], again[2]) == (1, "")
    data = json.loads(again[1])
    assert data == {**json.loads(first[1]), "resumed": 3}
    assert data["summary"] == "1 of 3 picks good; failed: 1 at reach, 1 at input"
    assert data["verdicts"] == {"good": 1, "impossible": 1, "unreadable": 1}
    code, out, err = run("pick", "picks.yaml", "--campaign", "out", "--seed", "1")
    assert (code, out) == (2, "")
    assert "out/rows.jsonl: belongs to another campaign, which differs in seed (0 there, 1 here). " in err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_the_report_does_not_depend_on_workers(run: Run) -> None:
    table(2, "far,2,0,0")
    code, here, _ = run("pick", "picks.yaml", "--json")
    assert (code, here) == run("pick", "picks.yaml", "--json", "--workers", "1")[:2]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("-o", "report.json"), ".html"),
        (("--workers", "2", "--dask", "tcp://127.0.0.1:1"), "--workers and --dask cannot be combined"),
        (("--dask", "tcp://127.0.0.1:1"), "no Dask scheduler answers at tcp://127.0.0.1:1: "),
        (("--dask", "nonsense"), "no Dask scheduler answers at nonsense: "),
    ],
)
@pytest.mark.slow
def test_wrong_usage_is_2(run: Run, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], expected: str) -> None:
    monkeypatch.setattr(pick, "CONNECT_SECONDS", 1)
    code, out, err = run("pick", "picks.yaml", "--campaign", "out", *words)
    assert (code, out) == (2, "")
    assert expected in err
    assert not Path("out/rows.jsonl").exists()


def test_a_folder_that_cannot_be_created_is_2(run: Run) -> None:
    code, out, err = run("pick", "picks.yaml", "--campaign", "scene.yaml/out")
    assert (code, out) == (2, "")
    assert "scene.yaml/out: cannot be created: Not a directory" in err
    assert err.count("\n") == 1


def test_without_dask_the_extra_is_named(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    code, _, err = run("pick", "picks.yaml", "--dask", "tcp://127.0.0.1:1")
    assert code == 2
    assert "pip install 'pinproof[dask]'" in err


def test_an_internal_error_is_3(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: object, **settings: object) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(Campaign, "run", broken)
    code, out, err = run("pick", "picks.yaml", "--campaign", "out")
    assert (code, out) == (3, "")
    assert "internal error: ZeroDivisionError: oops" in err


@pytest.mark.slow
def test_a_campaign_interrupted_by_ctrl_c_is_resumed_by_the_same_command(run: Run) -> None:
    table(12)
    words = ("pick", "picks.yaml", "--workers", "1", "--campaign")
    journal = Path("out/journal.sqlite")
    log = Path("out/journal.sqlite-wal")
    with started([sys.executable, "-c", RUN_CLI, *words, "out"]) as running:
        wait_for(lambda: log.exists() and log.stat().st_size > WRITTEN, by=running)
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=PATIENCE)
    there = rows_in(journal)
    assert running.returncode == 130
    assert 1 <= there < 12
    assert f"interrupted after {there} of 12 picks" in err
    assert "Traceback" not in err
    code, out, err = run(*words, "out")
    assert code == 0, err
    assert f"resuming: {there} of 12 picks" in err
    assert out.startswith("12 of 12 picks good")
    rows = [json.loads(line) for line in Path("out/rows.jsonl").read_text().splitlines()[1:]]
    assert [row["name"] for row in rows] == [f"pin_{k}" for k in range(12)]
