"""``pinproof pick``: exit codes, reports, programs and campaigns, and what is kept after Ctrl-C."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.motion import MotionProgram, RobotProgram, SetOutput, Wait

from ..pages import ROOT
from ..processes import PATIENCE, RUN_CLI, WRITTEN, rows_in, started, wait_for
from .conftest import JAWS, Cli, picks_of_generic

FAR, TORN = "{name: far, xyz: [2, 0, 0]}", "{name: torn, xyz: [0, .nan, 0]}"


def test_all_good_is_0_with_the_notes_that_apply(run: Cli, tmp_path: Path) -> None:
    code, out, err = run("pick", picks_of_generic(tmp_path), "-o", "report.html")
    assert (code, err) == (0, "")
    assert "1 of 1 picks good" in out
    assert "not covered: " in out
    assert "without `object:`" in out
    assert "with `object:`" not in out
    # Guessed accelerations are stated beside the durations
    assert "duration*" in out
    assert re.search(r"^\* .*guessed acceleration limits: .*0\.5 s", out, re.MULTILINE)
    assert "s, with guessed accelerations" in Path("report.html").read_text(encoding="utf-8")
    run.prints("pick", picks_of_generic(tmp_path), "-o", "report.md")
    assert Path("report.md").read_text().startswith("**generic_6dof**: 1 of 1 picks good")


@pytest.mark.slow
def test_one_that_is_not_good_is_1_and_the_others_are_judged(
    run: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, validate = [], pp.validate_picks
    monkeypatch.setattr("pinproof.validate_picks", lambda *a, **k: made.append(validate(*a, **k)) or made[-1])
    picks = picks_of_generic(tmp_path, 1, FAR, TORN)
    code, out, err = run("pick", picks, "--json", "-o", "report.json")
    assert (code, err) == (1, "")
    data = json.loads(out)  # nothing else is on stdout
    assert [pick["verdict"] for pick in data["picks"]] == ["good", "impossible"]
    assert data == json.loads(Path("report.json").read_text())
    assert run("pick", picks, "--json", "--workers", "1")[:2] == (code, out)
    # The table loses no text on a narrow terminal
    monkeypatch.setattr("pinproof.validate_picks", lambda *a, **k: made[0])
    reasons = [pick["reason"] for pick in data["picks"]]
    for columns in ("60", "80", "120"):
        monkeypatch.setenv("COLUMNS", columns)
        code, out, err = run("pick", picks)
        assert (code, err) == (1, "")
        assert "1 of 3 picks good; failed: 1 at reach, 1 at input" in " ".join(out.split())
        assert re.search(r"torn\s+UNREADABLE", out)
        for reason in reasons:
            assert [word for word in reason.split() if word not in out.split()] == []


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the picks and the outputs of one pick, with pages and a robot program."""
    folder = tmp_path_factory.mktemp("made")
    options = ("--pages", "--grip-dwell", "0.5", "--export", "krl", "--gripper-output", "7")
    out = Cli().prints("pick", picks_of_generic(folder), "-o", str(folder / "out"), *options)
    assert "1 program in krl" in out
    assert {path.name for path in (folder / "out").glob("*.html")} == {"report.html", "pin_0.html"}
    return folder


@pytest.mark.slow
def test_a_folder_gets_the_report_one_page_and_every_good_motion(run: Cli, tmp_path: Path, made: Path) -> None:
    names = ("'../out'", "report", "'[/red] a'")
    rows = (f"{{name: {name}, xyz: [0.4, -0.15, 0.035]}}" for name in names)
    assert "[/red] a" in run.prints("pick", picks_of_generic(tmp_path, 1, *rows, FAR), "-o", "made/out", code=1)
    stems = ("pin_0", "_out", "report_2", "_red_a")
    reports = {f"report.{kind}" for kind in ("json", "md", "csv", "html")}
    motions = {f"{stem}.{kind}" for stem in stems for kind in ("json", "program.json")}
    assert {path.name for path in Path("made/out").iterdir()} == reports | motions
    assert list(Path().glob("out*")) == []
    arm = pp.load_robot("generic_6dof").arm()
    assert all(pp.Trajectory.load(f"made/out/{stem}.json", arm.joint_names).duration > 0 for stem in stems)
    assert len(json.loads(Path("made/out/report.json").read_text())["picks"]) == 5
    # The page has all motions, and the meshes once
    page = Path("made/out/report.html").read_text(encoding="utf-8")
    settings, commands = (
        json.loads(re.search(rf'id="{name}">(.*?)</script>', page)[1]) for name in ("settings", "commands")
    )
    shown = ["pin_0", "../out", "report", "[/red] a", "far"]
    assert [name for name in re.findall(r"<tr><td>([^<]+)</td>", page) if name in shown] == shown
    assert [bool(motion and motion["tracks"]) for motion in settings["motions"]] == [True] * 4 + [False]
    drawn = [each["path"] for each in commands if each["type"] == "set_object" and each["path"].startswith("/robot/")]
    assert len(drawn) == len(set(drawn)) > 5
    one = (made / "out" / "report.html").stat().st_size
    assert Path("made/out/report.html").stat().st_size < 1.2 * one


@pytest.mark.slow
def test_programs_have_the_dwell_times_and_are_certified_again(run: Cli, made: Path) -> None:
    words, path = ("pick", str(made / "picks.yaml"), "--program"), made / "out" / "pin_0.program.json"
    assert [(event.kind, event.dwell) for event in MotionProgram.load(path).events] == [("grip", 0.5)]
    assert run.prints(*words, str(path)).count("FREE") == 1
    data = json.loads(path.read_text())
    data["segments"][0]["points"][-2]["positions"][0] += 1e-6
    Path("edited.program.json").write_text(json.dumps(data))
    assert run.prints(*words, "edited.program.json", code=1).count("differs") == 1
    report = run.json(*words, "edited.program.json", code=1)
    assert (report["ok"], report["motions"][0]["changed"], report["motions"][0]["status"]) == (False, True, "FREE")
    Path("other.program.json").write_text(path.read_text().replace('"name": "pin_0"', '"name": "pin_00"'))
    run.refuses(*words, "other.program.json", named=("pin_00", "valid: pin_0"))


@pytest.mark.slow
def test_robot_programs_of_picks_are_certified_with_their_picks(run: Cli, made: Path) -> None:
    picks, file = str(made / "picks.yaml"), str(made / "out" / "pin_0.src")
    program = RobotProgram.load(file)
    output, wait = (step for step in program.steps if isinstance(step, SetOutput | Wait))
    assert (output.output, output.on, wait.seconds) == ("7", True, 0.5)
    assert len(program.certificate) == 64
    assert "FREE" in run.prints("pick", picks, "--program", file)
    scene = str(robots_folder() / "generic_6dof" / "scene.yaml")
    assert run.json("certify", "generic_6dof", file, "--scene", scene, code=1)["status"] == "UNDECIDED"
    Path("raised.yaml").write_text(Path(picks).read_text().replace("0.035]", "0.535]"))
    assert "VIOLATED" in run.prints("pick", "raised.yaml", "--program", file, code=1)
    run.prints("pick", "raised.yaml", "--program", str(made / "out" / "pin_0.program.json"), code=1)


@pytest.mark.slow
def test_a_good_pick_whose_program_is_not_proven_is_no_success(run: Cli, tmp_path: Path) -> None:
    words = ("pick", picks_of_generic(tmp_path), "-o", "out", "--export", "rapid", "--export-deviation", "0.5")
    code, _, err = run(*words)
    assert (code, [*Path("out").glob("*.mod")]) == (1, [])
    assert "pin_0 is not written" in err


@pytest.mark.slow
def test_the_program_to_copy_runs_and_is_short(tmp_path: Path) -> None:
    program, folder = ROOT / "scripts" / "validate_picks.py", tmp_path / "out"
    assert len(program.read_text().splitlines()) < 40
    words = [sys.executable, program, robots_folder() / "generic_6dof" / "picks.yaml", folder, "pin_2"]
    ran = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (1, "")
    assert "**generic_6dof**: 2 of 4 picks good" in ran.stdout
    motions = {"pin_1.csv", "pin_2.csv", "pin_2_pick.html"}
    assert {path.name for path in folder.iterdir()} == {"report.json", "report.html", *motions}
    assert '"verdict">FREE<' in (folder / "pin_2_pick.html").read_text(encoding="utf-8")


def test_screening_prints_the_counts_and_writes_a_table(run: Cli) -> None:
    words = ("pick", str(robots_folder() / "ur5" / "picks.yaml"), "--screen")
    out = run.prints(*words, "-o", "screen.csv", code=1)
    assert "4 free, 2 in contact, 1 out of reach" in out
    assert "picks per second" in out
    rows = Path("screen.csv").read_text().splitlines()
    assert len(rows) == 8
    assert rows[0].startswith("name,status,grasp,limit_margin,manipulability,clearance,shoulder_pan_joint")
    assert rows[3].startswith("bolt_3,in contact,0,,,,")
    assert run.json(*words, code=1)["counts"]["free"] == 4


# -- Ctrl-C -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_ctrl_c_keeps_the_picks_that_were_judged(tmp_path: Path) -> None:
    probe = (
        "import pinproof.picks.judging.setup as s, pathlib, time\njudge = s.PickSetup.judge\n"
        "def slowly(self, index, pick):\n"
        "    if index == 3: pathlib.Path('third').touch(); time.sleep(600)\n    return judge(self, index, pick)\n"
        "s.PickSetup.judge = slowly\n"
    )
    words = ["pick", picks_of_generic(tmp_path, 6), "-o", "report.json"]
    with started([sys.executable, "-c", probe + RUN_CLI, *words], cwd=tmp_path) as process:
        wait_for((tmp_path / "third").exists, by=process)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert all(words in err for words in ("3 of 6 picks", "report.json has these 3", "--campaign"))
    report = json.loads((tmp_path / "report.json").read_text())
    assert [(pick["name"], pick["verdict"]) for pick in report["picks"]] == [(f"pin_{k}", "good") for k in range(3)]
    assert (report["ok"], report["not_judged"]) == (False, 3)
    assert "3 of 6 picks good" in out


@pytest.mark.parametrize("judged", [0, 1])
def test_ctrl_c_with_json_prints_the_partial_report_once_if_there_is_one(
    run: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, judged: int
) -> None:
    judge = pp.picks.PickSetup.judge

    def interrupted(setup: pp.picks.PickSetup, index: int, pick: pp.Pick) -> pp.picks.PickVerdict:
        if index == judged:
            raise KeyboardInterrupt
        return judge(setup, index, pick)

    monkeypatch.setattr(pp.picks.PickSetup, "judge", interrupted)
    words = ("pick", picks_of_generic(tmp_path, 2), "-o", "r.json")
    code, out, err = run(*words, *(("--json",) if judged else ()))
    assert code == 130
    assert f"{judged} of 2 picks" in err
    assert Path("r.json").exists() == bool(judged)
    assert json.loads(out)["not_judged"] == 1 if judged else out == ""


# -- campaigns --------------------------------------------------------------------------------------------------------

CAMPAIGN = ("pick", "picks.yaml", "--workers", "1", "--campaign", "out")


@pytest.mark.slow
def test_rows_of_a_campaign_stream_to_the_folder_and_to_a_page(run: Cli, tmp_path: Path) -> None:
    picks_of_generic(tmp_path, 3)
    code, out, err = run(*CAMPAIGN, "-o", "page.html")
    assert (code, err) == (0, "")
    assert out.startswith("3 of 3 picks good\nnot covered: picks without `object:`")
    assert out.endswith("wrote out/rows.jsonl and page.html\n")
    header, *rows = [json.loads(line) for line in Path("out/rows.jsonl").read_text().splitlines()]
    assert header["setup"]["robot"].startswith("generic_6dof ")
    assert [row["name"] for row in rows] == ["pin_0", "pin_1", "pin_2"]
    page = Path("page.html").read_text(encoding="utf-8")
    assert all(f"<td>pin_{k}</td>" in page for k in range(3))
    assert '"motions":[null,null,null]' in page


@pytest.mark.slow
def test_a_failed_pick_is_1_and_another_campaign_in_the_folder_is_2(run: Cli, tmp_path: Path) -> None:
    picks_of_generic(tmp_path, 1, FAR, TORN)
    first, again = (run(*words, "--json") for words in (CAMPAIGN, (*CAMPAIGN[:2], *CAMPAIGN[4:])))
    assert (first[0], first[2]) == (again[0], again[2]) == (1, "")
    data = json.loads(again[1])
    assert data == {**json.loads(first[1]), "resumed": 3}
    assert data["summary"] == "1 of 3 picks good; failed: 1 at reach, 1 at input"
    assert data["verdicts"] == {"good": 1, "impossible": 1, "unreadable": 1}
    differs = "out/rows.jsonl: belongs to another campaign, which differs in seed (0 there, 1 here). "
    run.refuses(*CAMPAIGN, "--seed", "1", named=differs)


@pytest.mark.slow
def test_a_campaign_interrupted_by_ctrl_c_is_resumed_by_the_same_command(run: Cli, tmp_path: Path) -> None:
    picks_of_generic(tmp_path, 12)
    journal, log = Path("out/journal.sqlite"), Path("out/journal.sqlite-wal")
    with started([sys.executable, "-c", RUN_CLI, *CAMPAIGN]) as running:
        wait_for(lambda: log.exists() and log.stat().st_size > WRITTEN, by=running)
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=PATIENCE)
    there = rows_in(journal)
    assert running.returncode == 130
    assert 1 <= there < 12
    assert f"interrupted after {there} of 12 picks" in err
    assert "Traceback" not in err
    code, out, err = run(*CAMPAIGN)
    assert code == 0, err
    assert f"resuming: {there} of 12 picks" in err
    assert out.startswith("12 of 12 picks good")
    assert out.endswith("wrote out/rows.jsonl\n")
    rows = [json.loads(line) for line in Path("out/rows.jsonl").read_text().splitlines()[1:]]
    assert [row["name"] for row in rows] == [f"pin_{k}" for k in range(12)]


# -- grasps -----------------------------------------------------------------------------------------------------------


def test_grasps_are_printed_and_written(run: Cli) -> None:
    Path("gripper.yaml").write_text(JAWS, encoding="utf-8")
    trimesh.creation.box((0.03, 0.04, 0.06)).export("part.stl")
    out = run.prints("grasps", "part.stl", "--tool", "gripper.yaml", "-n", "5", "-o", "grasps.yaml", "--html", "p.html")
    assert out.startswith("5 grasps of part\n")
    assert "proposed grasp 5: antipodal" in Path("grasps.yaml").read_text(encoding="utf-8")
    assert Path("p.html").stat().st_size > 100_000
    data = run.json("grasps", "part.stl", "--tool", "gripper.yaml", "-n", "5")
    assert [each["kind"] for each in data["grasps"]] == ["antipodal"] * 5


def test_grasps_of_a_part_that_is_too_wide_are_refused(run: Cli) -> None:
    Path("gripper.yaml").write_text(JAWS, encoding="utf-8")
    trimesh.creation.box((0.3, 0.3, 0.3)).export("part.stl")
    run.refuses("grasps", "part.stl", "--tool", "gripper.yaml", named=("300.0 mm", "70.0 mm"))
