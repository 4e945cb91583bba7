"""``pinproof pick``: exit codes, files, and usage errors in one line."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import pinproof as pp
from pinproof.common.files import file_stems
from pinproof.description import robots_folder

from ..pages import Run

ROOT = Path(__file__).parents[2]


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., str]:
    """A picks file of the generic arm beside its scene; its path."""
    shutil.copy(robots_folder() / "generic_6dof" / "scene.yaml", tmp_path)

    def write(*rows: str, robot: str = "generic_6dof", scene: str = "scene.yaml") -> str:
        shared = f"robot: {robot}\nscene: {scene}\nmargin: 0.002\ntip: {{xyz: [0, 0, 0.005]}}\n"
        defaults = "defaults: {rpy: [pi, 0, 0], approach: 0.02, retreat: 0.02}\npicks:\n"
        path = tmp_path / "picks.yaml"
        path.write_text(shared + defaults + "".join(f"  - {row}\n" for row in rows))
        return str(path)

    return write


GOOD, FAR = "{name: pin, xyz: [0.4, -0.15, 0.035]}", "{name: far, xyz: [2, 0, 0]}"


def test_all_good_is_0(run: Run, write) -> None:
    code, out, err = run("pick", write(GOOD))
    assert (code, err) == (0, "")
    assert "1 of 1 picks good" in out
    assert "not covered: " in out


def test_one_that_is_not_good_is_1(run: Run, write) -> None:
    code, out, err = run("pick", write(GOOD, FAR))
    assert (code, err) == (1, "")
    assert "1 of 2 picks good; failed: 1 at reach" in out


def test_an_unreadable_row_is_1_and_the_others_are_judged(run: Run, write) -> None:
    code, out, _ = run("pick", write(GOOD, "{name: torn, xyz: [0, .nan, 0]}"))
    assert code == 1
    assert "1 of 2 picks good; failed: 1 at input" in out
    assert re.search(r"torn\s+UNREADABLE", out)


@pytest.mark.parametrize("columns", ["60", "80", "120"])
def test_the_table_loses_no_text_on_a_narrow_terminal(run: Run, write, monkeypatch, columns: str) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    picks = write(GOOD, FAR)
    reasons = [pick["reason"] for pick in json.loads(run("pick", picks, "--json")[1])["picks"]]
    out = run("pick", picks)[1].split()
    assert len(reasons) == 2
    for reason in reasons:
        assert [word for word in reason.split() if word not in out] == []


def test_stdout_contains_only_the_json_document(run: Run, write) -> None:
    code, out, err = run("pick", write(GOOD, FAR), "--json", "-o", "report.json")
    assert (code, err) == (1, "")
    data = json.loads(out)
    assert [pick["verdict"] for pick in data["picks"]] == ["good", "impossible"]
    assert data == json.loads(Path("report.json").read_text())


def test_a_report_in_markdown(run: Run, write) -> None:
    assert run("pick", write(GOOD), "-o", "report.md")[0] == 0
    assert Path("report.md").read_text().startswith("**generic_6dof**: 1 of 1 picks good")


@pytest.mark.slow
def test_a_folder_gets_the_report_and_every_good_motion(run: Run, write) -> None:
    rows = (GOOD.replace("pin", name) for name in ("pin", "'../out'", "report", "'[/red] a'"))
    code, out, _ = run("pick", write(*rows, FAR), "-o", "made/out")
    assert code == 1
    assert "[/red] a" in out
    names = {path.name for path in Path("made/out").iterdir()}
    stems = ("pin", "_out", "report_2", "_red_a")
    assert names == {"report.json", "report.md", "report.csv", "report.html"} | {
        f"{s}.{end}" for s in stems for end in ("json", "program.json")
    }
    arm = pp.load_robot("generic_6dof").arm()
    for stem in stems:
        motion = pp.Trajectory.load(Path("made/out") / f"{stem}.json", arm.joint_names)
        assert motion.duration > 0
    assert len(json.loads(Path("made/out/report.json").read_text())["picks"]) == 5
    assert list(Path().glob("out*")) == []


def test_file_names_differ_and_stay_in_their_folder() -> None:
    names = ["a", "A", "a/b", "a b", "..", "", "report", "Schraube_ö", "a_2", "a.program"]
    stems = ["a", "A_2", "a_b", "a_b_2", "pick", "pick_2", "report_2", "Schraube_ö", "a_2_2", "a_program"]
    assert file_stems(names) == stems


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("nowhere.yaml",), "nowhere.yaml"),
        (("{good}", "--robot", "generic_6doff"), "'generic_6doff'"),
        (("{good}", "--robot", "generic_6doff"), "valid: generic_6dof"),
        (("{good}", "--robot", "nowhere.urdf"), "nowhere.urdf"),
        (("{good}", "--tcp", "tol0"), "tool0"),
        (("{good}", "--scene", "nowhere.yaml"), "nowhere.yaml"),
        (("{good}", "-o", "report.pdf"), ".json, .md, .csv"),
        (("{good}", "-o", "no/report.json"), "no/report.json"),
        (("{typo}",), "line"),
        (("{other}",), "'ur55'"),
        (("{sceneless}",), "gone.yaml"),
    ],
)
def test_a_usage_error_is_one_line_and_exit_code_2(run: Run, write, tmp_path: Path, words, expected: str) -> None:
    typo = tmp_path / "typo.yaml"
    typo.write_text("robot: ur5\nmargn: 1\npicks: [\n")
    variants = {"{good}": {}, "{other}": {"robot": "ur55"}, "{sceneless}": {"scene": "gone.yaml"}}
    given = [write(GOOD, **variants[w]) if w in variants else str(typo) if w == "{typo}" else w for w in words]
    code, out, err = run("pick", *given)
    assert (code, out) == (2, "")
    assert expected in err
    assert err.startswith("pinproof: ")
    assert err.count("\n") == 1
    assert list(tmp_path.glob("report*")) == []


@pytest.mark.parametrize("words", [("pick",), ("pick", "x.yaml", "--sed", "1"), ("pik",), ("demo", "--seed", "-1")])
def test_wrong_usage_is_2(run: Run, words: tuple[str, ...]) -> None:
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert "Traceback" not in err
    assert err.startswith("pinproof: ")
    assert " --help'\n" in err
    assert err.count("\n") == 1


def test_an_internal_error_is_3_and_verbose_shows_its_traceback(run: Run, write, monkeypatch) -> None:
    def broken(*args: object, **settings: object) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("pinproof.validate_picks", broken)
    code, out, err = run("pick", write(GOOD))
    assert (code, out) == (3, "")
    assert "internal error: ZeroDivisionError: oops" in err
    assert "Traceback" not in err
    code, _, err = run("--verbose", "pick", write(GOOD))
    assert code == 3
    assert "Traceback" in err


def test_ctrl_c_gives_no_result(run: Run, write, monkeypatch) -> None:
    def interrupted(*args: object, **settings: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pinproof.validate_picks", interrupted)
    code, out, err = run("pick", write(GOOD))
    assert (code, out) == (130, "")
    assert "Traceback" not in err


def test_the_version_is_that_of_the_package(run: Run) -> None:
    assert run("--version") == (0, f"pinproof {pp.__version__}\n", "")


@pytest.mark.slow
def test_the_program_to_copy_runs_and_is_short(tmp_path: Path) -> None:
    program = ROOT / "scripts" / "validate_picks.py"
    assert len(program.read_text().splitlines()) < 40
    picks = robots_folder() / "generic_6dof" / "picks.yaml"
    ran = subprocess.run(
        [sys.executable, str(program), str(picks), str(tmp_path / "out"), "pin_2"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ran.returncode, ran.stderr) == (1, "")
    assert "**generic_6dof**: 2 of 4 picks good" in ran.stdout
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "report.json",
        "report.html",
        "pin_1.csv",
        "pin_2.csv",
        "pin_2_pick.html",
    }
    assert '"verdict">FREE<' in (tmp_path / "out" / "pin_2_pick.html").read_text(encoding="utf-8")


def test_screening_prints_the_counts_and_writes_a_table(run: Run) -> None:
    file = str(ROOT / "robots" / "ur5" / "picks.yaml")
    code, out, _ = run("pick", file, "--screen", "-o", "screen.csv")
    assert code == 1
    assert "4 free, 2 in contact, 1 out of reach" in out
    assert "picks per second" in out
    rows = Path("screen.csv").read_text().splitlines()
    assert len(rows) == 8
    assert rows[0].startswith("name,status,grasp,limit_margin,manipulability,clearance,shoulder_pan_joint")
    assert rows[3].startswith("bolt_3,in contact,0,,,,")
    assert json.loads(run("pick", file, "--screen", "--json")[1])["counts"]["free"] == 4


@pytest.mark.parametrize("also", [("-o", "out.json"), ("--workers", "2"), ("--campaign", "folder")])
def test_screening_refuses_options_of_other_modes(also: tuple[str, str], run: Run) -> None:
    code, _, err = run("pick", str(ROOT / "robots" / "ur5" / "picks.yaml"), "--screen", *also)
    assert code == 2
    assert "--screen" in err


def test_the_budget_of_the_motion_belongs_to_the_judgement(run) -> None:
    code, out, err = run("pick", "robots/ur5/picks.yaml", "--screen", "--optimise", "5")
    assert (code, out) == (2, "")
    assert "--optimise" in err
