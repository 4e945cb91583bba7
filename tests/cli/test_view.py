"""``pinproof view`` and ``pinproof demo``: the files that they write, and what their pages show."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder

from ..viewer.browser import Browser
from ..viewer.conftest import BASE, LINKS, UPPER, small_arm, swing
from .conftest import Cli

ARM = ("view", "arm.urdf", "--html", "a.html")
IN_SCENE = (*ARM, "--scene", "scene.yaml")
SMALLEST_LINK = 40
"""Pixels of 960 x 540 in which a link can still be made out."""


@pytest.fixture
def run(run: Cli) -> Cli:
    """A folder with a robot, a scene and a motion."""
    upper = UPPER.format(kind="visual") + UPPER.format(kind="collision")
    Path("arm.urdf").write_text(LINKS.format(name="swing", base=BASE, upper=upper))
    post = "{name: post, cylinder: {radius: 0.05, length: 1.0}, xyz: [0, 0.4, 0.5]}"
    Path("scene.yaml").write_text(f"obstacles: [{post}]\n")
    swing(small_arm(), 0.0, 0.8).save("motion.json")
    return run


def page() -> str:
    return Path("a.html").read_text(encoding="utf-8")


def settings() -> dict:
    return json.loads(page().split('id="settings">')[1].split("</script>")[0])


def test_a_configuration_in_a_scene_is_checked_and_its_contacts_marked(run: Cli) -> None:
    assert run.json(*IN_SCENE, "--q", "pi/2 0") == {"page": "a.html"}
    assert settings()["touching"] == [["robot", "upper"], ["scene", "post"]]
    run(*IN_SCENE, "--q", "0 0")
    assert settings()["touching"] == []


def test_a_motion_is_certified_for_its_caption(run: Cli) -> None:
    run.prints(*IN_SCENE, "motion.json")
    assert 'id="verdict">FREE</p>' in page()


def test_layers_are_shown_as_stated(run: Cli) -> None:
    run(*ARM, "--layer", "frames", "--layer", "collision")
    shown = {layer["name"]: layer["shown"] for layer in settings()["layers"]}
    assert shown == {"robot": True, "collision": True, "frames": True}


@pytest.mark.slow
def test_a_dh_table_is_shown_with_its_branches_as_ghosts(run: Cli) -> None:
    table = str(robots_folder() / "scara" / "dh.yaml")
    assert run("view", table, "--q", "0.4 0.9 0.1 0", "--branches", "--html", "a.html")[::2] == (0, "")
    (ghosts,) = [layer for layer in settings()["layers"] if layer["name"] == "ghosts"]
    assert ghosts["note"].startswith("2")  # the elbow to either side


def test_without_a_browser_nothing_is_written(run: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PINPROOF_BROWSER", "gone-browser")
    run.refuses(*ARM, "--png", "a.png", named="gone-browser")
    assert not Path("a.html").exists()


def test_a_robot_that_cannot_be_checked_is_still_shown(run: Cli) -> None:
    gone = '<collision><geometry><mesh filename="gone.stl"/></geometry></collision>'
    Path("torn.urdf").write_text(Path("arm.urdf").read_text().replace(UPPER.format(kind="collision"), gone))
    code, _, err = run("view", "torn.urdf", "--q", "home", "--html", "a.html")
    assert (code, "not checked for contacts" in err, "gone.stl" in page()) == (0, True, True)


# -- demo -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[int, str, str]]:
    """The folder of the demo; its exit code, stdout and stderr."""
    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return folder, Cli()("demo")


@pytest.mark.slow
def test_the_demo_prints_its_verdicts_and_writes_page_and_motion(demo) -> None:
    folder, (code, out, err) = demo
    assert (code, err) == (0, "")
    assert all(f"bolt_{k}" in out for k in range(1, 8))
    assert "4 of 7 picks good; failed: 2 at grasp, 1 at reach" in out
    assert re.search(r"bolt_1: FREE: collision-free: at least [\d.]+ mm", out)
    assert {path.name for path in folder.iterdir()} == {"pick.html", "pick.json"}
    # The motion is the one that was certified
    arm, picks = pp.load_robot("ur5").arm("tool0"), pp.read_picks(robots_folder() / "ur5" / "picks.yaml")
    motion = pp.Trajectory.load(folder / "pick.json", arm.joint_names)
    checker = pp.CollisionChecker(arm, pp.Scene.load(picks.scene), margin=picks.margin, attached=picks.tool)
    assert pp.certify(motion, checker).status is pp.CertificateStatus.FREE
    np.testing.assert_array_equal(motion.start, arm.home)
    # Somewhere it rests with the picker's tip on the head of bolt_1
    rests = motion.q[~motion.velocities.any(axis=1)]
    tips = [(arm.root_from_base * arm.forward_kinematics(q) * picks.tip).translation for q in rests]
    assert min(np.linalg.norm(tip - [0.46, 0.15, 0.035]) for tip in tips) < 1e-6


@pytest.mark.slow
def test_page_and_motion_are_written_to_the_stated_files(run: Cli) -> None:
    before = set(Path().iterdir())
    out = run.prints("demo", "--html", "shown.html", "-o", "sent.json", "--seed", "3")
    assert "wrote shown.html and sent.json" in out
    assert {path.name for path in set(Path().iterdir()) - before} == {"shown.html", "sent.json"}


def check_page(browser: Browser, path: Path, *seconds: float, least: float = 0.15) -> None:
    """At each time, the robot covers ``least`` to 60 % of the canvas and all links are visible; FREE is shown."""
    page = browser.open(f"{path.as_uri()}#t={seconds[0]}", 960, 620)
    try:
        assert page.text("#verdict") == "FREE"
        assert "Proven clearance" in page.text("#caption")
        picture = page.canvas()
        assert picture.std() > 10
        for time in seconds:
            page.evaluate(f"pinproof.seek({time})")
            pixels = page.link_pixels()
            assert {name: count for name, count in pixels.items() if count < SMALLEST_LINK} == {}, time
            assert least <= sum(pixels.values()) / picture[..., 0].size <= 0.60, time
        assert page.complaints == []
        assert [url for url in page.requests if not url.startswith(("file:", "data:"))] == []
    finally:
        page.close()


def test_the_page_of_the_demo_shows_the_robot_from_start_to_end(demo, browser: Browser) -> None:
    folder, _ = demo
    duration = pp.Trajectory.load(folder / "pick.json").duration
    check_page(browser, folder / "pick.html", 0.0, 0.6 * duration, duration)


@pytest.mark.parametrize("name", ["generic_6dof", "panda"])
def test_the_page_of_every_shipped_cell_shows_its_robot(name: str, browser: Browser, tmp_path: Path) -> None:
    picks = pp.read_picks(robots_folder() / name / "picks.yaml")
    arm, scene, path = pp.load_robot(name).arm(), pp.Scene.load(picks.scene), tmp_path / f"{name}.html"
    first = pp.Picks(picks.picks[:1], tip=picks.tip, tool=picks.tool, margin=picks.margin)
    (verdict,) = pp.validate_picks(arm, scene, first).verdicts
    pp.write_html(path, arm, scene, verdict.trajectory, certificate=verdict.certificate, attached=picks.tool)
    check_page(browser, path, verdict.grasp_time, least=0.12)  # the picture also contains the obstacles near the tool
