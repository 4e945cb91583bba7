"""Conventions of the command line: errors in one line with the remedy, also as JSON; completion; pipes; Ctrl-C."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pinproof.cli.main import COMMANDS, main
from pinproof.description import catalogue_names, robots_folder

from ..pages import Run
from ..processes import PATIENCE, RUN_CLI, started


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("fkk ur5", "(did you mean 'fk'); see 'pinproof --help'"),
        ("cell placee", "(did you mean 'place'); see 'pinproof cell --help'"),
        ("fk", "'ROBOT'; see 'pinproof fk --help'"),
        ("fk ur5 --fram tool0", "(did you mean --frame)"),
        ("fk ur5 --q 0 1 0", '--q "0 -pi/2 0"'),
        ("fk ur5 --q 0 -pi/2", '--q "0 -pi/2 0"'),
        ("fk ur5 --q 0", "--q needs a value for each joint (shoulder_pan_joint, "),
        ("ik ur5 --xyz 1,2", "--xyz must be \"x y z\"; '1,2' has 2 numbers"),
        ("ik ur5 --method klik", "unknown IK method 'klik'; valid: clik"),
        ("check ur5 --margin -1", "--margin"),
        ("fk ur55", "'ur55'"),
        ("fk ur5 --tcp tol0", "tool0"),
        ("check ur5 --scene scen.yaml", "did you mean scene.yaml?"),
        ("check ur5 --scene no/scene.yaml", "no/scene.yaml"),
    ],
)
def test_a_usage_error_is_one_line_with_its_remedy_and_one_json_document(run: Run, words: str, expected: str) -> None:
    Path("scene.yaml").write_text("obstacles: []\n")
    code, out, err = run(*words.split())
    assert (code, out) == (2, "")
    assert err.startswith("pinproof: ")
    assert err.count("\n") == 1
    assert expected in err
    code, out, err_again = run(*words.split(), "--json")
    assert (code, err_again) == (2, err)
    data = json.loads(out)["error"]
    assert (data["kind"], data["exit_code"], f"pinproof: {data['message']}\n") == ("usage", 2, err)


@pytest.mark.parametrize("words", ["", "cell"])
def test_without_a_command_the_help_is_printed(run: Run, words: str) -> None:
    code, out, err = run(*words.split())
    assert code == 2
    assert "Usage: pinproof" in out + err
    assert "internal" not in err


@pytest.mark.parametrize("words", sorted(COMMANDS))
def test_the_help_names_the_values_of_options_and_no_types_of_python(run: Run, words: str) -> None:
    code, out, _ = run(*words.split(), "--help")
    assert code == 0
    assert not {
        word for word in ("<int", "<str", "<float", "<path", "<list", "range>", "x>=", "{", "[[") if word in out
    }
    assert "--seed INTEGER>=0" in " ".join(out.split()) or "--seed" not in out
    assert not {word for word in ("json", "audit", "live", "pages", "torque", "screen") if f"--no-{word}" in out}


def test_an_internal_error_asks_for_a_report(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: object, **settings: object) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("pinproof.load_robot", broken)
    code, out, err = run("fk", "ur5", "--json")
    assert code == 3
    assert json.loads(out)["error"]["kind"] == "internal"
    assert "--verbose" in err
    assert "Traceback" not in err
    code, out, err = run("fk", "ur5", "--verbose")  # after the command too
    assert (code, out) == (3, "")
    assert err.startswith("Traceback")
    assert "pinproof 0." in err
    assert "coal" in err


def test_ctrl_c_is_130_and_gives_no_result(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*args: object, **settings: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pinproof.reach_map", interrupted)
    words = ("reach", "ur5", "--region", "0.4 0.4 0 0 0.3 0.3", "-o", "map.csv")
    code, out, err = run(*words)
    # Rich before version 14 leaves an empty line where it would have shown progress.
    assert (code, out) == (130, "")
    assert err.lstrip("\n").startswith("pinproof: interrupted")
    assert list(Path().iterdir()) == []
    code, out, _ = run(*words, "--json")
    assert (code, json.loads(out)["error"]["kind"]) == (130, "interrupted")


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
@pytest.mark.parametrize("words", ["fk ur5", "fk ur5 --json", "--help"])
def test_a_closed_stdout_is_141_without_a_message(words: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as closed:
        done = subprocess.run(
            [sys.executable, "-c", RUN_CLI, *words.split()], stdout=closed, stderr=subprocess.PIPE, check=False
        )
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.fixture
def terminal() -> Callable[..., bytes]:
    """Run a command line in a pseudo-terminal: its output."""

    def show(*words: str, **environment: str) -> bytes:
        ours, theirs = pty.openpty()
        plain = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR", "CI")}
        subprocess.run(
            [sys.executable, "-c", RUN_CLI, *words],
            stdout=theirs,
            stderr=theirs,
            env={**plain, "TERM": "xterm-256color", **environment},
            check=False,
        )
        os.close(theirs)
        shown = b""
        try:
            while part := os.read(ours, 65536):
                shown += part
        except OSError:  # how Linux says that the other end is closed
            pass
        os.close(ours)
        return shown

    return show


@pytest.mark.slow
def test_colours_are_used_only_on_terminals_that_support_them(run: Run, terminal: Callable[..., bytes]) -> None:
    assert b"\x1b[31m" in terminal("fk", "ur55")
    assert b"\x1b[3" not in terminal("fk", "ur55", NO_COLOR="1")
    assert "\x1b" not in "".join(run("fk", "ur55")[1:])


@pytest.fixture
def complete(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path):
    """What bash is offered for the last word of a line."""
    monkeypatch.chdir(tmp_path)

    def call(line: str) -> list[str]:
        words = line.split(" ")
        monkeypatch.setenv("_PINPROOF_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
        monkeypatch.setattr("sys.argv", ["pinproof"])
        with pytest.raises(SystemExit):
            main()
        return capsys.readouterr().out.split()

    return call


def test_tab_completes_commands_options_robots_files_frames_and_groups(complete: Callable[[str], list[str]]) -> None:
    assert set(complete("pinproof ")) == {name.split()[0] for name in COMMANDS}
    assert complete("pinproof fk --fra") == ["--frame"]
    assert complete("pinproof ik ur5 --method f") == ["fabrik"]
    assert complete("pinproof fk u") == [name for name in sorted(catalogue_names()) if name.startswith("u")]
    Path("mine.urdf").write_text("")
    Path("mine.yaml").write_text("")
    assert complete("pinproof view mi") == ["mine.urdf", "mine.yaml"]
    assert complete("pinproof fk ur5 --frame wrist_") == ["wrist_1_link", "wrist_2_link", "wrist_3_link"]
    assert complete(f"pinproof fk {robots_folder()}/ur5/u") == [f"{robots_folder()}/ur5/ur5.urdf"]
    assert complete("pinproof ik panda --group arm") == ["arm", "arm_and_hand"]
    assert complete("pinproof ik nobody --group arm") == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_shell_gets_its_script(run: Run, shell: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_PINPROOF_COMPLETE", f"source_{shell}")
    code, out, err = run()
    assert (code, err) == (0, "")
    assert f"_PINPROOF_COMPLETE=complete_{shell}" in out


@pytest.mark.parametrize("command", [(), ("cell",), ("check",)])
def test_the_help_shows_no_value_for_a_switch(run: Run, command: tuple[str, ...]) -> None:
    page = run(*command, "--help")[1]
    assert "--help" in page
    assert "bool" not in page
