"""``pinproof view``: files that it writes and options that it refuses."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

from pinproof.description import robots_folder

from ..pages import Run
from ..viewer.conftest import BASE, LINKS, UPPER, small_arm, swing


@pytest.fixture
def run(run: Run) -> Run:
    """Run ``pinproof view`` in a folder with a robot, a scene and a motion: exit code, stdout, stderr."""
    upper = UPPER.format(kind="visual") + UPPER.format(kind="collision")
    Path("arm.urdf").write_text(LINKS.format(name="swing", base=BASE, upper=upper))
    Path("scene.yaml").write_text(
        "obstacles:\n  - {name: post, cylinder: {radius: 0.05, length: 1.0}, xyz: [0, 0.4, 0.5]}\n"
    )
    swing(small_arm(), 0.0, 0.8).save("motion.json")
    return partial(run, "view")


def settings(page: str) -> dict:
    text = Path(page).read_text(encoding="utf-8")
    return json.loads(text.split('id="settings">')[1].split("</script>")[0])


def test_a_configuration_in_a_scene_is_checked_and_its_contacts_marked(run: Run) -> None:
    code, out, _ = run("arm.urdf", "--q", "pi/2 0", "--scene", "scene.yaml", "--html", "a.html", "--json")
    assert (code, json.loads(out)) == (0, {"page": "a.html"})
    assert settings("a.html")["touching"] == [["robot", "upper"], ["scene", "post"]]
    run("arm.urdf", "--q", "0 0", "--scene", "scene.yaml", "--html", "a.html")
    assert settings("a.html")["touching"] == []


def test_a_motion_is_certified_for_its_caption(run: Run) -> None:
    code, _, _ = run("arm.urdf", "motion.json", "--scene", "scene.yaml", "--html", "a.html")
    assert code == 0
    assert 'id="verdict">FREE</p>' in Path("a.html").read_text(encoding="utf-8")


def test_layers_are_shown_as_stated_and_an_unknown_one_is_refused(run: Run) -> None:
    run("arm.urdf", "--layer", "frames", "--layer", "collision", "--html", "a.html")
    shown = {layer["name"]: layer["shown"] for layer in settings("a.html")["layers"]}
    assert shown == {"robot": True, "collision": True, "frames": True}
    code, _, err = run("arm.urdf", "--layer", "frame", "--html", "b.html")
    assert code == 2
    assert "valid: frames" in err
    assert not Path("b.html").exists()


@pytest.mark.slow
def test_a_dh_table_is_shown_with_its_branches_as_ghosts(run: Run) -> None:
    table = robots_folder() / "scara" / "dh.yaml"
    code, _, err = run(str(table), "--q", "0.4 0.9 0.1 0", "--branches", "--html", "a.html")
    assert (code, err) == (0, "")
    (ghosts,) = [layer for layer in settings("a.html")["layers"] if layer["name"] == "ghosts"]
    assert ghosts["note"].startswith("2")  # the elbow to either side


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--time", "1", "--html", "a.html"), "--time"),
        (("motion.json", "--q", "home", "--html", "a.html"), "--q"),
        (("--png", "a.png", "--size", "large"), "WIDTHxHEIGHT"),
        (("--png", "a.png", "--html", "a.png"), "a.png"),
    ],
)
def test_contradicting_options_are_refused(run: Run, words: tuple[str, ...], expected: str) -> None:
    code, _, err = run("arm.urdf", *words)
    assert code == 2
    assert expected in err
    assert not Path("a.html").exists()


def test_without_a_browser_nothing_is_written(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PINPROOF_BROWSER", "gone-browser")
    code, _, err = run("arm.urdf", "--html", "a.html", "--png", "a.png")
    assert code == 2
    assert "gone-browser" in err
    assert not Path("a.html").exists()


def test_a_robot_that_cannot_be_checked_is_still_shown(run: Run) -> None:
    gone = '<collision><geometry><mesh filename="gone.stl"/></geometry></collision>'
    Path("torn.urdf").write_text(Path("arm.urdf").read_text().replace(UPPER.format(kind="collision"), gone))
    code, _, err = run("torn.urdf", "--q", "home", "--html", "a.html")
    assert code == 0
    assert "not checked for contacts" in err
    assert "gone.stl" in Path("a.html").read_text(encoding="utf-8")
