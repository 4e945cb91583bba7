"""What ``pinproof pick`` writes: one page for all picks, programs, and what is kept after Ctrl-C."""

from __future__ import annotations

import json
import re
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pinproof.cli.main import main
from pinproof.description import robots_folder
from pinproof.motion import MotionProgram, RobotProgram, SetOutput, Wait

from ..processes import PATIENCE, RUN_CLI, started, wait_for

Run = Callable[..., tuple[int, str, str]]
SHARED = "robot: generic_6dof\nscene: {scene}\nmargin: 0.002\ntip: {{xyz: [0, 0, 0.005]}}\n"
DEFAULTS = "defaults: {rpy: [pi, 0, 0], approach: 0.02, retreat: 0.02}\n"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """Run a command line in this process, in an empty folder: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["pinproof", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    return call


def write_picks(folder: Path, count: int) -> str:
    """A picks file with good picks of the generic arm."""
    scene = robots_folder() / "generic_6dof" / "scene.yaml"
    rows = "".join(f"  - {{name: pin_{k}, xyz: [{0.4 - 0.0005 * k}, -0.15, 0.035]}}\n" for k in range(count))
    path = folder / "picks.yaml"
    path.write_text(f"{SHARED.format(scene=scene)}{DEFAULTS}picks:\n{rows}")
    return str(path)


@pytest.mark.slow
def test_a_folder_has_one_page_with_all_motions_and_the_meshes_once(run: Run, tmp_path: Path) -> None:
    picks = write_picks(tmp_path, 3)
    assert run("pick", picks, "-o", "out")[0] == 0
    assert [path.name for path in Path("out").glob("*.html")] == ["report.html"]
    page = Path("out/report.html").read_text(encoding="utf-8")
    settings = json.loads(re.search(r'id="settings">(.*?)</script>', page)[1])
    assert re.findall(r"<tr><td>(\w+)</td>", page) == ["pin_0", "pin_1", "pin_2"]
    assert all(motion["tracks"] for motion in settings["motions"])
    commands = json.loads(re.search(r'id="commands">(.*?)</script>', page)[1])
    drawn = [each["path"] for each in commands if each["type"] == "set_object" and each["path"].startswith("/robot/")]
    assert len(drawn) == len(set(drawn)) > 5
    assert run("pick", write_picks(tmp_path, 1), "-o", "one")[0] == 0
    one = Path("one/report.html").stat().st_size
    assert Path("out/report.html").stat().st_size < 1.2 * one


@pytest.mark.slow
def test_pages_of_single_motions_are_written_on_request(run: Run, tmp_path: Path) -> None:
    assert run("pick", write_picks(tmp_path, 2), "-o", "out", "--pages")[0] == 0
    assert {path.name for path in Path("out").glob("*.html")} == {"report.html", "pin_0.html", "pin_1.html"}


@pytest.mark.parametrize(
    "words", [("--pages",), ("--grip-dwell", "1"), ("-o", "r.json", "--pages"), ("--program", "p", "-o", "r.json")]
)
def test_options_without_their_folder_are_wrong_usage(run: Run, tmp_path: Path, words: tuple[str, ...]) -> None:
    code, out, err = run("pick", write_picks(tmp_path, 1), *words)
    assert (code, out) == (2, "")
    assert "-o" in err
    assert err.count("\n") == 1


def test_programs_have_the_dwell_times_and_are_certified_again(run: Run, tmp_path: Path) -> None:
    picks = write_picks(tmp_path, 1)
    assert run("pick", picks, "-o", "out", "--grip-dwell", "0.5")[0] == 0
    path = Path("out/pin_0.program.json")
    program = MotionProgram.load(path)
    assert [(event.kind, event.dwell) for event in program.events] == [("grip", 0.5)]
    code, out, _ = run("pick", picks, "--program", str(path))
    assert (code, out.count("FREE")) == (0, 1)
    data = json.loads(path.read_text())
    data["segments"][0]["points"][-2]["positions"][0] += 1e-6
    path.write_text(json.dumps(data))
    code, out, _ = run("pick", picks, "--program", str(path))
    assert (code, out.count("differs")) == (1, 1)
    report = json.loads(run("pick", picks, "--program", str(path), "--json")[1])
    assert (report["ok"], report["motions"][0]["changed"], report["motions"][0]["status"]) == (False, True, "FREE")


def test_program_of_an_unknown_pick_is_wrong_usage(run: Run, tmp_path: Path) -> None:
    picks = write_picks(tmp_path, 1)
    assert run("pick", picks, "-o", "out")[0] == 0
    path = Path("out/pin_0.program.json")
    path.write_text(path.read_text().replace('"name": "pin_0"', '"name": "pin_00"'))
    code, _, err = run("pick", picks, "--program", str(path))
    assert code == 2
    assert "pin_00" in err
    assert "valid: pin_0" in err


def test_guessed_accelerations_are_stated_beside_the_durations(run: Run, tmp_path: Path) -> None:
    code, out, _ = run("pick", write_picks(tmp_path, 1), "-o", "report.html")
    assert code == 0
    assert "duration*" in out
    assert re.search(r"^\* .*guessed acceleration limits: .*0\.5 s", out, re.MULTILINE)
    assert "s, with guessed accelerations" in Path("report.html").read_text(encoding="utf-8")


def test_notes_appear_only_where_they_apply(run: Run, tmp_path: Path) -> None:
    out = run("pick", write_picks(tmp_path, 1))[1]
    assert "without `object:`" in out
    assert "with `object:`" not in out


def interrupted(tmp_path: Path, count: int, *words: str) -> tuple[int, str, str]:
    """Interrupt the command after some picks: exit code, stdout, stderr."""
    picks = write_picks(tmp_path, count)
    probe = (
        "import pinproof.picks.judging.setup as s, pathlib, time\njudge = s.PickSetup.judge\n"
        "def slowly(self, index, pick):\n"
        "    if index == 3: pathlib.Path('third').touch(); time.sleep(600)\n    return judge(self, index, pick)\n"
        "s.PickSetup.judge = slowly\n"
    )
    with started([sys.executable, "-c", probe + RUN_CLI, "pick", picks, *words], cwd=tmp_path) as process:
        wait_for((tmp_path / "third").exists, by=process)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err


@pytest.mark.slow
def test_ctrl_c_keeps_the_picks_that_were_judged(tmp_path: Path) -> None:
    code, out, err = interrupted(tmp_path, 6, "-o", "report.json")
    assert code == 130
    assert "Traceback" not in err
    assert "3 of 6 picks" in err
    assert "report.json has these 3" in err
    assert "--campaign" in err
    report = json.loads((tmp_path / "report.json").read_text())
    assert [pick["name"] for pick in report["picks"]] == ["pin_0", "pin_1", "pin_2"]
    assert all(pick["verdict"] == "good" for pick in report["picks"])
    assert (report["ok"], report["not_judged"]) == (False, 3)
    assert "3 of 6 picks good" in out


@pytest.mark.slow
def test_ctrl_c_with_json_prints_the_partial_report_once(tmp_path: Path) -> None:
    code, out, err = interrupted(tmp_path, 5, "--json")
    assert code == 130
    assert json.loads(out)["not_judged"] == 2
    assert "3 of 5 picks" in err


@pytest.mark.slow
def test_ctrl_c_before_the_first_pick_gives_no_result(tmp_path: Path) -> None:
    probe = (
        "import pinproof.picks.judging.setup as s, pathlib, time\n"
        "def wait(*_): pathlib.Path('first').touch(); time.sleep(600)\n"
        "s.PickSetup.judge = wait\n"
    )
    picks = write_picks(tmp_path, 2)
    with started([sys.executable, "-c", probe + RUN_CLI, "pick", picks, "-o", "r.json"], cwd=tmp_path) as process:
        wait_for((tmp_path / "first").exists, by=process)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, out) == (130, "")
    assert "0 of 2 picks" in err
    assert not (tmp_path / "r.json").exists()


@pytest.mark.slow
def test_a_robot_program_of_each_good_pick_is_written(run: Run, tmp_path: Path) -> None:
    picks = write_picks(tmp_path, 1)
    code, out, _ = run("pick", picks, "-o", "out", "--export", "krl", "--gripper-output", "7", "--grip-dwell", "0.5")
    assert code == 0
    assert "1 programs in krl" in out
    program = RobotProgram.load("out/pin_0.src")
    output, wait = (step for step in program.steps if isinstance(step, SetOutput | Wait))
    assert (output.output, output.on, wait.seconds) == ("7", True, 0.5)
    assert len(program.certificate) == 64


def test_a_language_without_outputs_is_refused_for_picks(run: Run, tmp_path: Path) -> None:
    code, _, err = run("pick", write_picks(tmp_path, 1), "-o", "out", "--export", "ros2")
    assert code == 2
    assert "urscript, rapid, krl or fanuc" in err


@pytest.mark.slow
def test_robot_programs_of_picks_are_certified_with_their_picks(run: Run, tmp_path: Path) -> None:
    picks = write_picks(tmp_path, 1)
    assert run("pick", picks, "-o", "out", "--export", "rapid")[0] == 0
    (program,) = Path("out").glob("*.mod")
    code, out, _ = run("pick", picks, "--program", str(program))
    assert (code, "FREE" in out) == (0, True)
    scene = str(robots_folder() / "generic_6dof" / "scene.yaml")
    code, out, _ = run("certify", "generic_6dof", str(program), "--scene", scene, "--json")
    assert (code, json.loads(out)["status"]) == (1, "UNDECIDED")
    raised = tmp_path / "raised.yaml"
    raised.write_text(Path(picks).read_text().replace("0.035]", "0.535]"))
    code, out, _ = run("pick", str(raised), "--program", str(program))
    assert (code, "VIOLATED" in out) == (1, True)
    assert run("pick", str(raised), "--program", "out/pin_0.program.json")[0] == 1


@pytest.mark.slow
def test_a_good_pick_whose_program_is_not_proven_is_no_success(run: Run, tmp_path: Path) -> None:
    code, _, err = run("pick", write_picks(tmp_path, 1), "-o", "out", "--export", "rapid", "--export-deviation", "0.5")
    assert (code, [*Path("out").glob("*.mod")]) == (1, [])
    assert "pin_0 is not written" in err
