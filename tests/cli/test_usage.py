"""Conventions of the command line: errors in one line with the remedy, also as JSON; examples; completion; Ctrl-C."""

from __future__ import annotations

import json
import os
import pty
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name

import pytest
import trimesh

import pinproof as pp
from pinproof.cli import cell_options
from pinproof.cli.main import COMMANDS, main
from pinproof.description import catalogue_names, robots_folder

from ..pages import ROOT
from ..processes import PATIENCE, RUN_CLI, started
from .conftest import JAWS, Cli, picks_of_generic, save_motion

UR5, TWO_UR5 = robots_folder() / "ur5", robots_folder() / "two_ur5"
PLAN = 'plan ur5 --goal "1 -1.2 1.6 -1.97 -1.57 0.5"'
SEQUENCE, ALLOCATE = f"cell sequence {UR5}/picks.yaml", f"cell allocate {TWO_UR5}/picks.yaml"
REACH = 'reach generic_6dof --region "0.2 0.6 -0.3 0.3 0.06 0.06" --step 0.2 --spins 2'

REFUSED = [
    ("fkk ur5", "(did you mean 'fk'); see 'pinproof --help'"),
    ("cell placee", "(did you mean 'place'); see 'pinproof cell --help'"),
    ("pik", " --help'\n"),
    ("fk", "'ROBOT'; see 'pinproof fk --help'"),
    ("fk ur55", "'ur55'", "valid: ur5"),
    ("fk nowhere.urdf", "nowhere.urdf"),
    ("fk ur5 --fram tool0", "(did you mean --frame)"),
    ("fk ur5 --frame tol0", "tool0"),
    ("fk ur5 --tcp tol0", "tool0"),
    ("fk ur5 --q 0 1 0", '--q "0 -pi/2 0"'),
    ("fk ur5 --q 0 -pi/2", '--q "0 -pi/2 0"'),
    ("fk ur5 --q 0", "--q needs a value for each joint (shoulder_pan_joint, "),
    ('fk ur5 --q "0 1"', "shoulder_pan_joint"),
    ('fk ur5 --q "0 0 0 0 0 x"', "--q"),
    ("ik ur5", "--xyz"),
    ("ik ur5 --xyz 1,2", "--xyz must be \"x y z\"; '1,2' has 2 numbers"),
    ("ik ur5 --method klik", "unknown IK method 'klik'; valid: clik"),
    ('ik ur5 --xyz "0.4 0.1 0.1" --task position --tool-of picks.yaml', "--task"),
    ("info --tcp tool0",),
    ("info --overlaps",),
    ("check ur5 --margin -1", "--margin"),
    ("check ur5 --scene scen.yaml", "did you mean scene.yaml?"),
    ("check ur5 --scene no/scene.yaml", "no/scene.yaml"),
    ("dh2urdf nowhere.csv -o x.urdf", "nowhere.csv"),
    ("dh2urdf dh.yaml -o dh.yaml", "pinproof: dh.yaml: "),
    (f"{PLAN} --jerk gentle", "--jerk"),
    (f'{PLAN} --upright "5 grad"', "5 grad"),
    (f"{PLAN} --upright 5", "286"),
    (f'{PLAN} --upright-axis "0 0 1"', "--upright"),
    (f'{PLAN} --upright "5 deg" --upright-axis "0 1"', 'must be "x y z"'),
    (f'{PLAN} --upright "5 deg" --upright-axis "0 0 0"', "zero"),
    ("plan arm.urdf --goal home --scene scene.yaml --html scene.yaml", "pinproof: scene.yaml: "),
    ("plan arm.urdf --goal home -o new.json --html new.json", "pinproof: new.json: "),
    ("plan arm.urdf --goal home -o new.json --html nowhere/new.html", "pinproof: nowhere/new.html: "),
    ("plan arm.urdf --goal home -o new.json --html folder", "pinproof: folder: "),
    ("certify", "ROBOT or MOTION"),
    ("certify ur5", "ROBOT or MOTION"),
    ("certify ur5 nowhere.json", "nowhere.json"),
    ("certify --verify nowhere.json", "nowhere.json"),
    ("certify --verify scene.yaml", "scene.yaml"),
    ("certify --verify motion.json --scene scene.yaml", "ROBOT"),
    ("certify --verify motion.json --attached rod.yaml", "ROBOT"),
    ("certify --verify motion.json --audit", "--verify"),
    ("certify ur5 motion.json --save-proof motion.json", "motion.json"),
    ("certify ur5 motion.json --save-proof proof.yaml", "proof.yaml"),
    ("certify ur5 motion.json --payload=-1",),
    ('certify ur5 motion.json --payload="1 2"',),
    ("certify ur5 motion.json --payload=a",),
    ("certify ur5 motion.json --tool-speed=0",),
    ("certify arm.urdf motion.json --html motion.json", "pinproof: motion.json: "),
    ("certify arm.urdf motion.json --scene scene.yaml --html scene.yaml", "pinproof: scene.yaml: "),
    ("view arm.urdf --html arm.urdf", "pinproof: arm.urdf: "),
    ("view arm.urdf --html link_to_arm", "pinproof: link_to_arm: "),
    ("view arm.urdf motion.json --html motion.json", "pinproof: motion.json: "),
    ("view arm.urdf --time 1 --html a.html", "--time"),
    ("view arm.urdf motion.json --q home --html a.html", "--q"),
    ("view arm.urdf --png a.png --size large", "WIDTHxHEIGHT"),
    ("view arm.urdf --png a.png --html a.png", "a.png"),
    ("view arm.urdf --layer frame --html a.html", "valid: frames"),
    ("demo --seed -1", " --help'\n"),
    ("demo --html no/pick.html", "no/pick.html"),
    ("demo --output no/pick.json", "no/pick.json"),
    ("demo -o new.json --html nowhere/new.html", "pinproof: nowhere/new.html: "),
    ("bench",),
    ("bench nobody", "'nobody'"),
    ("bench ur5 --points 0",),
    ("bench ur5 --methods magic --points 1", "magic"),
    (f"{REACH} --place '1 2'", "--place"),
    ("pick", " --help'\n"),
    ("pick x.yaml --sed 1", " --help'\n"),
    ("pick nowhere.yaml", "nowhere.yaml"),
    ("pick typo.yaml", "line"),
    ("pick other.yaml", "'ur55'"),
    ("pick sceneless.yaml", "gone.yaml"),
    ("pick picks.yaml --robot generic_6doff", "'generic_6doff'", "valid: generic_6dof"),
    ("pick picks.yaml --robot nowhere.urdf", "nowhere.urdf"),
    ("pick picks.yaml --tcp tol0", "tool0"),
    ("pick picks.yaml --scene nowhere.yaml", "nowhere.yaml"),
    ("pick picks.yaml -o report.pdf", ".json, .md, .csv"),
    ("pick picks.yaml -o no/report.json", "no/report.json"),
    ("pick picks.yaml --pages", "-o"),
    ("pick picks.yaml --grip-dwell 1", "-o"),
    ("pick picks.yaml -o r.json --pages", "-o"),
    ("pick picks.yaml --program p -o r.json", "-o"),
    ("pick picks.yaml -o out --export ros2", "urscript, rapid, krl or fanuc"),
    ("pick picks.yaml --workers 0", "'--workers'", "at least 1"),
    ("pick picks.yaml --screen -o out.json", "--screen"),
    ("pick picks.yaml --screen --workers 2", "--screen"),
    ("pick picks.yaml --screen --campaign out", "--screen"),
    ("pick picks.yaml --screen --optimise 5", "--optimise"),
    ("pick picks.yaml --campaign out -o report.json", ".html"),
    ("pick picks.yaml --campaign scene.yaml/out", "scene.yaml/out: cannot be created: Not a directory"),
    ("pick picks.yaml --campaign out --workers 2 --dask tcp://127.0.0.1:1", "--workers and --dask cannot be combined"),
    (f"pick {TWO_UR5}/picks.yaml", "pinproof cell allocate"),
    (f"{SEQUENCE} --workers -1", "'--workers'", "at least 1"),
    (f"{SEQUENCE} --only bolt_1,bolt_99", "bolt_99"),
    (f"{SEQUENCE} --before bolt_1", "names 1 picks"),
    (f"{SEQUENCE} --before bolt_1,bolt_0", "bolt_0"),
    (f"{SEQUENCE} --before bolt_1,bolt_2 --before bolt_2,bolt_1", "bolt_1 before bolt_2"),
    (f"{SEQUENCE} -o cell.pdf", "cell.pdf"),
    (f"{SEQUENCE} -o nowhere/cell.csv", "nowhere"),
    (f"{SEQUENCE} -o cell.html --heat-map {UR5}/scene.yaml", "column 'x'"),
    (f"{SEQUENCE} -o cell.csv --heat-map {UR5}/scene.yaml", "--heat-map"),
    (f"{ALLOCATE} --only part_9_9", "part_9_9"),
    (f"{ALLOCATE} --before part_1_1", "names 1 picks"),
    (f"{ALLOCATE} -o cell.csv", "cell.csv"),
    (f"cell allocate {UR5}/picks.yaml", "robots"),
]
"""Command lines, and what the error names."""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files of the refused command lines."""
    folder = tmp_path_factory.mktemp("refused")
    picks_of_generic(folder)
    picks_of_generic(folder, name="other.yaml", robot="ur55")
    picks_of_generic(folder, name="sceneless.yaml", scene="gone.yaml")
    (folder / "typo.yaml").write_text("robot: ur5\nmargn: 1\npicks: [\n")
    (folder / "scene.yaml").write_text("obstacles: []\n")
    (folder / "rod.yaml").write_text("attached: [{name: rod, box: [0.02, 0.02, 0.2], xyz: [0, 0, 0.1]}]\n")
    save_motion(folder / "motion.json")
    shutil.copy(robots_folder() / "generic_6dof" / "dh.yaml", folder)
    shutil.copy(robots_folder() / "generic_6dof" / "generic_6dof.urdf", folder / "arm.urdf")
    (folder / "link_to_arm").symlink_to("arm.urdf")
    (folder / "folder").mkdir()
    return folder


@pytest.mark.parametrize(("words", "named"), [(words, named) for words, *named in REFUSED])
def test_wrong_usage_is_one_line_and_one_json_document_and_writes_nothing(
    run: Cli, files: Path, monkeypatch: pytest.MonkeyPatch, words: str, named: list[str]
) -> None:
    monkeypatch.chdir(files)
    before = {path.name: path.is_dir() or path.read_bytes() for path in files.iterdir()}
    code, out, err = run(*shlex.split(words), "--json")
    assert (code, err.count("\n")) == (2, 1), err
    assert all(each in err for each in named)
    if words.startswith(("fk", "ik", "check")):
        assert run.refuses(*shlex.split(words)) == err
    data = json.loads(out)["error"]
    assert (data["kind"], data["exit_code"], f"pinproof: {data['message']}\n") == ("usage", 2, err)
    assert {path.name: path.is_dir() or path.read_bytes() for path in files.iterdir()} == before


@pytest.mark.slow
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense"])
def test_a_scheduler_that_does_not_answer_is_named(
    run: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setattr(cell_options, "CONNECT_SECONDS", 1)
    words = ("pick", picks_of_generic(tmp_path), "--campaign", "out", "--dask", address)
    run.refuses(*words, named=f"no Dask scheduler answers at {address}: ")
    assert not Path("out/rows.jsonl").exists()
    monkeypatch.setitem(sys.modules, "distributed", None)
    run.refuses(*words, named="pip install 'pinproof[dask]'")


def test_an_output_in_a_missing_folder_is_refused_with_one_reason(run: Cli) -> None:
    Path("file").write_text("")
    for folder, reason in (("missing", "does not exist"), ("file", "is not a folder")):
        assert run.refuses("plan", "ur5", "--goal", "home", "-o", f"{folder}/x.json").count(reason) == 1


@pytest.mark.parametrize("name", ["a.txt", "a"])
def test_every_reader_names_the_suffixes_in_the_same_words(name: str) -> None:
    readers = (pp.Scene.load, pp.read_picks, pp.DhTable.load, pp.Trajectory.load, pp.JointLimits.load)
    reports = []
    for read in readers:
        with pytest.raises(pp.FileError) as error:
            read(name)
        reports.append(str(error.value).partition("; valid: "))
    assert len({problem for problem, _, _ in reports}) == 1
    assert all(".yaml" in valid for _, _, valid in reports)


@pytest.mark.parametrize("words", ["", "cell"])
def test_without_a_command_the_help_is_printed(run: Cli, words: str) -> None:
    code, out, err = run(*words.split())
    assert (code, "Usage: pinproof" in out + err, "internal" in err) == (2, True, False)


@pytest.mark.parametrize("words", ["", "cell", *sorted(COMMANDS)])
def test_the_help_names_the_values_of_options_and_no_types_of_python(run: Cli, words: str) -> None:
    out = run.prints(*words.split(), "--help")
    assert "--help" in out
    assert ("Example:" in out) == (words in COMMANDS)
    types = ("<int", "<str", "<float", "<path", "<list", "range>", "x>=", "{", "[[", "bool")
    assert not {word for word in types if word in out}
    assert "--seed INTEGER>=0" in " ".join(out.split()) or "--seed" not in out
    assert not {word for word in ("json", "audit", "pages", "torque", "screen") if f"--no-{word}" in out}


# -- examples ---------------------------------------------------------------------------------------------------------

BEFORE = 'plan ur5 --goal "1 -1.2 1.2 -1.57 -1.57 0" --scene robots/ur5/scene.yaml -o motion.json'
"""The examples of ``certify`` and ``export`` use this motion."""

NEGATIVE = {"pick": 1, "cell place": 1, "cell tolerance": 1}
"""Exit codes of examples with a negative result: some of the bolts cannot be picked."""

LONG = (
    "sequence",
    "place_base",
    "validate_picks",
    "cell.allocate",
    "cell.new_cell",
    "cell.tolerance_study",
    "tool_paths.follow_job",
)
"""Functions whose results the second run of an example uses again."""

SMALLER = {
    "place_base": {
        "placement_budget": pp.cell.PlacementBudget(grid=60, runs=1, evaluations=12, certified=1, deviations=1)
    }
}
"""Budgets of these functions in place of those of the example."""


@pytest.mark.slow
@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_the_example_of_a_command_runs_and_prints_one_document_with_json(
    command: str, run: Cli, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    made: list[object] = []
    again: list[object] = []

    def kept(real: Callable[..., object], smaller: dict[str, object]) -> Callable[..., object]:
        """The function, whose results are returned again once ``again`` has them."""

        def call(*args: object, **settings: object) -> object:
            if again:
                return again.pop(0)
            made.append(real(*args, **{**settings, **smaller}))
            return made[-1]

        return call

    for name in LONG:
        monkeypatch.setattr(f"pinproof.{name}", kept(resolve_name(f"pinproof.{name}"), SMALLER.get(name, {})))
    monkeypatch.setattr("pinproof.cell.starting.new_cell.PROPOSED", 200)
    shutil.copytree(ROOT / "robots", "robots")
    if command in ("certify", "export"):
        run.prints(*shlex.split(BEFORE))
    for name in ("block.stl", "part.stl"):
        trimesh.creation.box((0.05, 0.03, 0.03)).export(name)
    Path("gripper.yaml").write_text(JAWS, encoding="utf-8")
    lines = [line.strip() for line in (COMMANDS[command].__doc__ or "").splitlines()]
    (example,) = (line.removeprefix("Example: pinproof ") for line in lines if line.startswith("Example: "))
    code = NEGATIVE.get(command, 0)
    assert run.prints(*shlex.split(example), code=code).strip()
    capfd.readouterr()
    again.extend(made)
    assert isinstance(run.json(*shlex.split(example), code=code), dict)
    assert capfd.readouterr().out == ""  # of libraries that write to the file descriptor


# -- internal errors and interruptions --------------------------------------------------------------------------------


def raising(error: BaseException) -> Callable[..., None]:
    """A function that raises an error."""

    def broken(*args: object, **settings: object) -> None:
        raise error

    return broken


@pytest.mark.parametrize(
    ("words", "function"),
    [
        ("fk ur5", "pinproof.load_robot"),
        ("pick picks.yaml", "pinproof.validate_picks"),
        ("pick picks.yaml --campaign out", "pinproof.picks.Campaign.run"),
    ],
)
def test_an_internal_error_asks_for_a_report(
    run: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, function: str
) -> None:
    picks_of_generic(tmp_path)
    monkeypatch.setattr(function, raising(ZeroDivisionError("oops")))
    code, out, err = run(*words.split())
    assert (code, out) == (3, "")
    assert "internal error: ZeroDivisionError: oops" in err
    assert "--verbose" in err
    assert "Traceback" not in err
    assert run.json(*words.split(), code=3)["error"]["kind"] == "internal"
    for verbose in ((*words.split(), "--verbose"), ("--verbose", *words.split())):
        code, out, err = run(*verbose)
        assert (code, out) == (3, "")
        assert err.startswith("Traceback")
        assert "pinproof 0." in err
        assert "coal" in err


@pytest.mark.parametrize(
    ("words", "function"),
    [
        ("reach ur5 --region '0.4 0.4 0 0 0.3 0.3' -o map.csv", "pinproof.reach_map"),
        ("pick picks.yaml", "pinproof.validate_picks"),
    ],
)
def test_ctrl_c_is_130_and_gives_no_result(
    run: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, function: str
) -> None:
    picks_of_generic(tmp_path)
    monkeypatch.setattr(function, raising(KeyboardInterrupt()))
    code, out, err = run(*shlex.split(words))
    # Rich before version 14 leaves an empty line where it would have shown progress.
    assert (code, out) == (130, "")
    assert err.lstrip("\n").startswith("pinproof: interrupted")
    assert [path.name for path in Path().iterdir()] == ["picks.yaml"]
    assert run.json(*shlex.split(words), code=130)["error"]["kind"] == "interrupted"


# -- processes and terminals ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_live_view_prints_its_url_and_ends_with_ctrl_c() -> None:
    with started([sys.executable, "-c", RUN_CLI, "view", "generic_6dof", "--no-browser", "--json"]) as view:
        assert view.stdout is not None
        text = "".join(view.stdout.readline() for _ in range(3))
        assert json.loads(text)["url"].startswith("http://127.0.0.1:")
        view.send_signal(signal.SIGINT)
        out, err = view.communicate(timeout=PATIENCE)
    assert (view.returncode, out) == (130, "")
    assert err.count("\n") == 1


@pytest.mark.slow
def test_the_program_has_exit_code_and_output_of_the_command(run: Cli) -> None:
    for words in (["info"], ["fk", "ur55"]):
        done = subprocess.run([sys.executable, "-c", RUN_CLI, *words], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout, done.stderr) == run(*words)
    assert run("--version") == (0, f"pinproof {pp.__version__}\n", "")


@pytest.mark.slow
@pytest.mark.parametrize("words", ["info", "info --json", "--help"])
def test_a_closed_stdout_is_141_without_a_message(words: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as closed:
        done = subprocess.run(
            [sys.executable, "-c", RUN_CLI, *words.split()], stdout=closed, stderr=subprocess.PIPE, check=False
        )
    assert (done.returncode, done.stderr) == (141, b"")


def shown_on_terminal(*words: str, **environment: str) -> bytes:
    """The output of a command line in a pseudo-terminal."""
    ours, theirs = pty.openpty()
    plain = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR", "CI")}
    variables = {**plain, "TERM": "xterm-256color", **environment}
    subprocess.run([sys.executable, "-c", RUN_CLI, *words], stdout=theirs, stderr=theirs, env=variables, check=False)
    os.close(theirs)
    shown = b""
    try:
        while part := os.read(ours, 65536):
            shown += part
    except OSError:  # how Linux says that the other end is closed
        pass
    os.close(ours)
    return shown


@pytest.mark.slow
def test_colours_are_used_only_on_terminals_that_support_them(run: Cli) -> None:
    assert b"\x1b[31m" in shown_on_terminal("fk", "ur55")
    assert b"\x1b[3" not in shown_on_terminal("fk", "ur55", NO_COLOR="1")
    assert "\x1b" not in "".join(run("fk", "ur55")[1:])


# -- completion -------------------------------------------------------------------------------------------------------


@pytest.fixture
def complete(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    """What bash is offered for the last word of a line."""
    monkeypatch.chdir(tmp_path)

    def call(line: str) -> list[str]:
        monkeypatch.setenv("_PINPROOF_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(line.count(" ")))
        monkeypatch.setattr("sys.argv", ["pinproof"])
        with pytest.raises(SystemExit):
            main()
        return capsys.readouterr().out.split()

    return call


def test_tab_completes_commands_options_robots_files_frames_and_groups(complete: Callable[[str], list[str]]) -> None:
    assert set(complete("pinproof ")) == {name.split()[0] for name in COMMANDS}
    for name in ("mine.urdf", "mine.yaml"):
        Path(name).touch()
    for line, offered in {
        "fk --fra": ["--frame"],
        "ik ur5 --method f": ["fabrik"],
        "fk u": [name for name in sorted(catalogue_names()) if name.startswith("u")],
        "view mi": ["mine.urdf", "mine.yaml"],
        "fk ur5 --frame wrist_": ["wrist_1_link", "wrist_2_link", "wrist_3_link"],
        f"fk {UR5}/u": [f"{UR5}/ur5.urdf"],
        "ik panda --group arm": ["arm", "arm_and_hand"],
        "ik nobody --group arm": [],
    }.items():
        assert complete(f"pinproof {line}") == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_shell_gets_its_script(run: Cli, shell: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_PINPROOF_COMPLETE", f"source_{shell}")
    code, out, err = run()
    assert (code, err) == (0, "")
    assert f"_PINPROOF_COMPLETE=complete_{shell}" in out
