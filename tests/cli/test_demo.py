"""``pinproof demo``, as a user runs it, and what its pages show."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder

from ..pages import Run, run_main
from ..viewer.browser import Browser

SMALLEST_LINK = 40
"""Pixels of 960 x 540 in which a link can still be made out."""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[int, str, str]]:
    """The folder of the demo; its exit code, stdout and stderr."""
    folder = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return folder, run_main("demo")


@pytest.mark.slow
def test_the_demo_prints_its_verdicts_and_writes_page_and_motion(demo) -> None:
    folder, (code, out, err) = demo
    assert (code, err) == (0, "")
    assert all(f"bolt_{k}" in out for k in range(1, 8))
    assert "4 of 7 picks good; failed: 2 at grasp, 1 at reach" in out
    assert re.search(r"bolt_1: FREE: collision-free: at least [\d.]+ mm", out)
    assert {path.name for path in folder.iterdir()} == {"pick.html", "pick.json"}


@pytest.mark.slow
def test_the_motion_written_is_the_one_that_was_certified(demo) -> None:
    folder, _ = demo
    arm = pp.load_robot("ur5").arm("tool0")
    motion = pp.Trajectory.load(folder / "pick.json", arm.joint_names)
    scene = pp.Scene.load(robots_folder() / "ur5" / "scene.yaml")
    picks = pp.read_picks(robots_folder() / "ur5" / "picks.yaml")
    checker = pp.CollisionChecker(arm, scene, margin=picks.margin, attached=picks.tool)
    assert pp.certify(motion, checker).status is pp.CertificateStatus.FREE
    np.testing.assert_array_equal(motion.start, arm.home)
    # Somewhere it rests with the picker's tip on the head of bolt_1.
    rests = motion.q[~motion.velocities.any(axis=1)]
    tips = [(arm.root_from_base * arm.forward_kinematics(q) * picks.tip).translation for q in rests]
    assert min(np.linalg.norm(tip - [0.46, 0.15, 0.035]) for tip in tips) < 1e-6


@pytest.mark.parametrize("option", ["html", "output"])
def test_an_output_in_a_missing_folder_is_a_usage_error(option: str, run: Run) -> None:
    code, _, err = run("demo", f"--{option}", f"no/pick.{option}")
    assert code == 2
    assert f"no/pick.{option}" in err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_page_and_motion_are_written_to_the_stated_files(run: Run) -> None:
    code, out, _ = run("demo", "--html", "shown.html", "-o", "sent.json", "--seed", "3")
    assert code == 0
    assert "wrote shown.html and sent.json" in out
    assert {path.name for path in Path().iterdir()} == {"shown.html", "sent.json"}


def check_page(browser: Browser, path: Path, *seconds: float, least: float = 0.15) -> None:
    """At each time, the robot covers ``least`` to 60 % of the canvas and all links are visible; FREE is shown."""
    page = browser.open(f"{path.as_uri()}#t={seconds[0]}")
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
    arm, scene = pp.load_robot(name).arm(), pp.Scene.load(picks.scene)
    first = pp.Picks(picks.picks[:1], tip=picks.tip, tool=picks.tool, margin=picks.margin)
    (verdict,) = pp.validate_picks(arm, scene, first).verdicts
    path = tmp_path / f"{name}.html"
    pp.write_html(path, arm, scene, verdict.trajectory, certificate=verdict.certificate, attached=picks.tool)
    check_page(browser, path, verdict.grasp_time, least=0.12)  # the picture also contains the obstacles near the tool
