"""``pinproof follow``: exit codes, reports, motions and programs, and a clear answer for paths that are special."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import pinproof as pp
from pinproof.motion import RobotProgram

from .conftest import Cli

LINE = [[0.45, -0.1, 0.25], [0.45, 0.1, 0.25]]
UP = [0, 0, 1]


def job(name: str = "job.json", *, strokes: Any = None, points: Any = LINE, normals: Any = UP, **keys: Any) -> str:
    """The name of a file of tool paths in the present folder."""
    stroke = {"name": "seam", "points": points, "normals": normals}
    stated = {"robot": "ur5", "speed": 0.1, **keys, "strokes": [stroke] if strokes is None else strokes}
    Path(name).write_text(json.dumps(stated))
    return name


def test_a_path_that_is_followed_is_0_with_all_files(run: Cli) -> None:
    out = run.prints("follow", job(approach=0.05), "-o", "out", "--export", "rapid")
    assert "seam: FOUND" in out
    assert "rapid: FREE" in out
    names = {path.name for path in Path("out").iterdir()}
    assert names == {
        "job.json",
        "job.proof.json",
        "job.mod",
        *(f"report{kind}" for kind in (".json", ".md", ".csv", ".html")),
    }
    assert pp.verify_proof("out/job.proof.json").ok
    assert len(RobotProgram.load("out/job.mod").moves) >= 4
    # The motion is certified again by the other command
    assert run.json("certify", "ur5", "out/job.json")["status"] == "FREE"


def test_the_answer_in_json_is_the_report(run: Cli) -> None:
    data = run.json("follow", job(), "-o", "report.json", "--save", "motion.json", "--html", "page.html")
    assert data == json.loads(Path("report.json").read_text())
    assert data["ok"]
    assert data["strokes"][0]["status"] == "FOUND"
    assert Path("motion.proof.json").is_file()
    page = Path("page.html").read_text(encoding="utf-8")
    assert 'id="strips"' in page
    assert "clearance [mm]" in page
    assert (
        "tool [mm/s]"
        in (run.prints("follow", job(), "-o", "p.html", "--colour", "speed"), Path("p.html").read_text())[1]
    )


def test_a_path_that_is_not_followed_is_1_with_the_reason_and_suggestions(run: Cli) -> None:
    far = job(points=[[0.7, -0.05, 0.3], [1.0, -0.05, 0.3]])
    out = run.prints("follow", far, "--save", "motion.json", code=1)
    assert "BLOCKED" in out
    assert "out of reach" in out
    assert "suggestion: move the base by 150 mm along +x" in out
    assert not Path("motion.json").exists()
    # The suggestion holds when it is applied to the command
    assert "FOUND" in run.prints("follow", far, "--place", "0.15 0 0")
    assert "suggestion" not in run.prints("follow", far, "--suggestions", "0", code=1)


def test_a_robot_and_its_calibration_replace_those_of_the_file(run: Cli) -> None:
    assert run.json("follow", job(), "--robot", "ur10")["robot"] == "ur10"
    Path("kinematics.csv").write_text("joint,dtheta,dd,da,dalpha\n")
    run.refuses("follow", job(), "--calibration", "kinematics.csv", named="kinematics.csv")


def test_a_saved_program_is_certified_again_in_the_cell_of_the_file(run: Cli) -> None:
    run("follow", job(), "-o", "out", "--export", "rapid", "--process-dwell", "0.5")
    text = Path("out/job.mod").read_text()
    assert text.index("SetDO do_process, 1") < text.index("WaitTime 0.5") < text.index("SetDO do_process, 0")
    data = run.json("follow", "job.json", "--program", "out/job.mod")
    assert (data["ok"], data["unchanged"]) == (True, True)
    # An obstacle on the path, by the scene of the command
    Path("scene.yaml").write_text("obstacles:\n  - {name: block, box: [0.05, 0.05, 0.05], xyz: [0.45, 0, 0.25]}\n")
    out = run.prints("follow", "job.json", "--program", "out/job.mod", "--scene", "scene.yaml", code=1)
    assert "block" in out


def test_a_base_is_placed_for_a_job_of_tool_paths(run: Cli) -> None:
    far = job(points=[[0.7, -0.05, 0.3], [1.0, -0.05, 0.3]])
    words = ("cell", "place", far, "--region", "0 0.4 -0.2 0.2", "--grid", "12", "--runs", "0", "--deviations", "0")
    data = run.json(*words, "-o", "place")
    assert data["ok"]
    best = data["placements"][0]
    assert "FOUND" in run.prints("follow", far, "--place", f"{best['x']} {best['y']} {best['z']} {best['yaw']}")
    assert json.loads(Path("place/report.json").read_text())["strokes"][0]["status"] == "FOUND"
    assert not run.json("cell", "place", far, *words[3:4], "3 4 3 4", *words[5:], code=1)["ok"]


def test_the_time_of_each_stage_and_of_proofs_beside_each_body_is_printed(run: Cli) -> None:
    Path("scene.yaml").write_text("obstacles:\n  - {name: block, box: [0.05, 0.05, 0.05], xyz: [0.45, 0, 0.1]}\n")
    data = run.json("follow", job(), "--scene", "scene.yaml", "--profile")
    stages = {each["stage"]: each for each in data["profile"]["stages"]}
    assert {"configurations", "optimum", "finer values", "curves", "timing", "other"} <= set(stages)
    assert stages["timing"]["calls"] == 2  # one for each direction
    assert {each["name"] for each in data["profile"]["bodies"]} == {"robot", "block"}
    # Without a motion too: what suggestions take is theirs alone
    far = job(points=[[0.7, -0.05, 0.3], [1.0, -0.05, 0.3]])
    out = run.prints("follow", far, "--scene", "scene.yaml", "--profile", code=1)
    shown = {line.split("  ")[0] for line in out.splitlines()}
    assert {"suggestions", "configurations", "block"} <= shown


@pytest.mark.slow  # it starts processes
def test_a_campaign_follows_each_path_by_itself(run: Cli) -> None:
    points = [LINE, [[1.5, 0, 0.2], [1.6, 0, 0.2]]]
    strokes = [{"name": f"seam {k}", "points": own, "normals": UP} for k, own in enumerate(points)]
    data = run.json("follow", job(strokes=strokes), "--campaign", "out", "--workers", "1", code=1)
    assert data["summary"] == "1 of 2 paths good; failed: 1 at blocked"
    assert len(Path("out/rows.jsonl").read_text().splitlines()) == 3


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("job.json", "--campaign", "out", "-o", "report.json"), ("--campaign", "-o")),
        (("job.json", "--workers", "2"), ("--campaign",)),
        (("job.json", "--program", "out.mod", "--suggestions", "3"), ("--suggestions",)),
        (("job.json", "--campaign", "out", "--profile"), ("--profile", "--campaign")),
        (("job.json", "--program", "out.mod"), ("out.mod",)),
        (("jobb.json",), ("jobb.json", "job.json")),
        (("job.json", "--export", "rapd", "-o", "out"), ("rapd", "rapid")),
        (("job.json", "--export", "rapid"), ("-o FOLDER",)),
        (("job.json", "--process-output", "2"), ("--export",)),
        (("job.json", "--process-dwell", "2"), ("--export",)),
        (("job.json", "-o", "report.txt"), (".txt", ".csv")),
        (("job.json", "--colour", "depth"), ("depth", "clearance")),
        (("job.json", "--export", "rapid", "--process-output", "2x!", "-o", "out"), ("--process-output", "names")),
        (("job.json", "--robot", "panda", "--export", "urscript", "-o", "out"), ("7",)),
        (("job.json", "--save", "job.json"), ("is also an input",)),
        (("job.json", "--liftz", "1"), ("--liftz",)),
    ],
)
def test_mistakes_in_options_end_in_one_error(run: Cli, words: tuple[str, ...], named: tuple[str, ...]) -> None:
    job()
    run.refuses("follow", *words, named=named)
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        ({"points": [[0.4, 0, float("nan")], [0.4, 0.1, 0.2]]}, "number"),
        ({"points": [[4, 0, 0.2], [400, 0.1, 0.2]], "unit": "m"}, "unit"),
        ({"normals": [0, 0, 0]}, "length 0"),
        ({"speed": 100}, "mm/s"),
        ({"strokes": []}, "strokes"),
        ({"points": []}, "points"),
        ({"frame": "prt"}, "prt"),
        ({"tiltz": 3}, "tiltz"),
        ({"deviation": 1e-9}, "deviation"),
    ],
)
def test_what_is_wrong_in_a_file_is_stated_in_one_line(run: Cli, keys: dict[str, Any], named: str) -> None:
    file = job(**keys)
    Path(file).write_text(Path(file).read_text().replace("NaN", '".nan"'))
    run.refuses("follow", file, named=named)


def test_a_placement_states_the_line_of_a_frame_that_does_not_exist(run: Cli) -> None:
    words = ("cell", "place", job(frame="prt"), "--region", "0 0.4 -0.2 0.2")
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    for named in ("job.json", "line 1", "unknown frame 'prt'"):
        assert named in err


@pytest.mark.parametrize(("key", "job"), [("stroke", True), ("Strokes", True), ("picks", False)])
def test_a_file_is_a_job_of_tool_paths_by_the_key_that_is_most_like_strokes(run: Cli, key: str, job: bool) -> None:
    Path("a.yaml").write_text(f"robot: ur5\nspeed: 0.1\nframes: {{strokes: {{xyz: [0, 0, 0]}}}}\n{key}: []\n")
    wrong = (f"unknown key '{key}'", "valid: strokes") if job else ("unknown key 'speed'",)
    run.refuses("cell", "place", "a.yaml", "--region", "0 1 0 1", named=wrong)


def test_special_paths_get_a_clear_answer(run: Cli) -> None:
    # One pose, repeated poses, and a closed path
    assert run.json("follow", job(points=LINE[:1]))["strokes"][0]["poses"] == 1
    repeated = run.json("follow", job(points=[LINE[0], LINE[0], LINE[1]]))
    assert any("repeat" in note for note in repeated["notes"])
    # Millimetres are recognised, which a note states
    large = run.json("follow", job(points=[[450, -100, 250], [450, 100, 250]]))
    assert large["ok"]
    assert any("millimetres" in note for note in large["notes"])
    square = [[0.4, -0.1, 0.25], [0.5, -0.1, 0.25], [0.5, 0.1, 0.25], [0.4, 0.1, 0.25], [0.4, -0.1, 0.25]]
    assert run.json("follow", job(points=square))["ok"]
    # Through the axis of the base, and through a singular configuration of the wrist
    through = run.json("follow", job(points=[[-0.3, 0, 0.4], [0.3, 0, 0.4]]), "--suggestions", "0", code=1)
    assert through["strokes"][0]["status"] in ("BLOCKED", "LIFTS_NEEDED")
    assert through["strokes"][0]["message"]
    crossing = {"points": [[0.5, -0.1, 0.4], [0.5, 0.1, 0.4]], "normals": [-1, 0, 0], "free_rotation": False}
    code, out, _ = run("follow", job(**crossing), "--suggestions", "0")
    assert code in (0, 1)
    assert "FOUND" in out or "singular" in out or "jump" in out or "contact" in out
