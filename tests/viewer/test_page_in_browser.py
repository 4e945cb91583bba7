"""What a browser really shows; pixels are counted in a picture with one flat colour for each link."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pinproof.collision import Scene
from pinproof.conversion import dh_to_urdf
from pinproof.description import DhTable, robots_folder
from pinproof.ik import AnalyticIk
from pinproof.model import Arm, load_robot
from pinproof.viewer import write_html

from .browser import Browser, Page
from .conftest import POST, certified, small_arm, swing, turn

SMALLEST_LINK = 40
"""Pixels in which the smallest link, a finger of the Panda, can still be made out."""


def check_picture(page: Page, least: float = 0.15) -> None:
    """The robot covers 15 to 60 % of the canvas and every link is there to see."""
    before = page.canvas()
    assert before.std() > 10  # not blank
    check_links(page, least)


def check_links(page: Page, least: float = 0.15) -> None:
    pixels, size = page.link_pixels(), page.canvas_size()
    assert {name: count for name, count in pixels.items() if count < SMALLEST_LINK} == {}
    assert least <= sum(pixels.values()) / size <= 0.60


def from_table(name: str) -> Arm:
    return load_robot(dh_to_urdf(DhTable.load(robots_folder() / name / "dh.yaml"))).arm()


@pytest.mark.parametrize("name", ["ur5", "panda", "xarm7", "scara", "stanford"])
def test_every_link_of_a_robot_is_visible(browser: Browser, pages: Callable[[str], Path], name: str) -> None:
    path = pages(f"still_{name}")
    arm = load_robot(name).arm()
    write_html(path, arm if name in ("ur5", "panda", "xarm7") else from_table(name), q=arm.home)
    page = browser.open(path.as_uri(), 900, 560)
    check_picture(page)
    assert page.evaluate("document.getElementById('player').hidden")
    assert page.complaints == []
    if name == "ur5":
        page.send("Emulation.setDeviceMetricsOverride", width=420, height=800, deviceScaleFactor=1, mobile=False)
        page.wait_for("document.getElementById('meshcat-pane').clientWidth === 420")
        check_links(page)
    page.close()


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_robot_in_its_cell_is_framed_at_both_ends_of_its_motion(
    browser: Browser, pages: Callable[[str], Path], cell: Scene, name: str
) -> None:
    path, arm = pages(name), load_robot(name).arm()
    write_html(path, arm, cell, turn(arm))
    page = browser.open(f"{path.as_uri()}#t=0", 1280, 720)
    check_picture(page, least=0.12)  # the picture also contains the obstacles near the tool
    page.evaluate("pinproof.seek(2.2)")
    check_links(page, least=0.12)
    assert page.complaints == []
    assert [url for url in page.requests if not url.startswith(("file:", "data:"))] == []
    page.close()


def test_the_motion_plays_pauses_and_starts_at_the_time_of_the_url(
    browser: Browser, pages: Callable[[str], Path]
) -> None:
    arm = small_arm()
    path = pages("swing")
    write_html(path, arm, None, swing(arm, duration=2.0))
    page = browser.open(path.as_uri())
    page.wait_for("pinproof.viewer.animator.time > 0.1")  # it plays by itself
    page.evaluate("document.getElementById('play').click()")
    assert page.text("#play") == "Pause" or not page.evaluate("pinproof.viewer.animator.playing")
    page.evaluate("location.hash = '#t=0.5'")
    page.wait_for("Math.abs(pinproof.viewer.animator.time - 0.5) < 1e-9")
    page.wait_for("document.getElementById('clock').textContent === '0.50 / 2.00 s'")
    early = page.canvas()
    page.evaluate("pinproof.seek(1.5)")
    late = page.canvas()
    assert (np.abs(early.astype(int) - late).max(axis=2) > 30).mean() > 0.01
    page.evaluate("pinproof.seek(0.5)")
    assert np.array_equal(page.canvas(), early)
    turned = page.evaluate("pinproof.viewer.scene_tree.find(['robot', 'upper']).object.quaternion.toArray()")
    assert 2 * np.arctan2(turned[2], turned[3]) == pytest.approx(float(swing(arm)(0.5)[0]), abs=1e-4)
    page.close()


def test_the_plots_follow_the_motion_and_a_click_seeks(browser: Browser, pages: Callable[[str], Path]) -> None:
    arm, path = small_arm(), pages("plots")
    write_html(path, arm, None, swing(arm, duration=2.0))
    page = browser.open(f"{path.as_uri()}#t=0.5")
    tall = page.evaluate("document.getElementById('stage').clientHeight")
    page.evaluate("document.querySelector('#chart summary').click()")
    page.wait_for(f"document.getElementById('stage').clientHeight < {tall} - 50")
    page.wait_for("document.querySelector('canvas').clientHeight === document.getElementById('stage').clientHeight")
    box = "document.querySelector('#chart svg').getBoundingClientRect()"
    line = "document.querySelector('#chart .now').getBoundingClientRect()"
    page.wait_for(f"Math.abs({line}.left - {box}.left - 0.25 * {box}.width) < 1")
    place = f"{{clientX: {box}.left + 0.75 * {box}.width, clientY: {box}.top, bubbles: true}}"
    page.evaluate(f"document.querySelector('#chart svg').dispatchEvent(new MouseEvent('click', {place}))")
    page.wait_for("Math.abs(pinproof.viewer.animator.time - 1.5) < 0.02")
    assert page.complaints == []
    page.close()


def test_the_slider_of_a_self_motion_moves_the_elbow_and_not_the_tcp(
    browser: Browser, pages: Callable[[str], Path]
) -> None:
    arm, path = load_robot("panda").arm(), pages("elbow")
    motion = AnalyticIk(redundant_steps=24).self_motion(arm, arm.forward_kinematics(arm.home), arm.home)
    write_html(path, arm, None, elbow=motion)
    page = browser.open(path.as_uri(), 1000, 640)
    curve = motion.curves[0]
    assert page.text("#verdict") == "NOT VALIDATED"
    assert page.evaluate("document.getElementById('scrub').getAttribute('aria-label')") == "panda_joint7 in rad"
    page.wait_for("document.getElementById('clock').textContent.includes('= ')")  # the first frame is drawn
    shown = float(page.text("#clock").split("= ")[1].split()[0])
    assert curve.lower - 1e-3 <= shown <= curve.upper + 1e-3
    assert not page.evaluate("pinproof.viewer.animator.playing")
    for share in (0.1, 0.35, 0.8):
        value = curve.lower + share * (curve.upper - curve.lower)
        page.evaluate(
            f"(() => {{ const s = document.getElementById('scrub'); s.value = {value - curve.lower}; "
            "s.dispatchEvent(new Event('input')); })()"
        )
        page.wait_for(f"Math.abs(pinproof.viewer.animator.time - {value - curve.lower}) < 2e-3")
        q = curve.at(curve.lower + page.evaluate("pinproof.viewer.animator.time"))
        for link, tolerance in (("panda_link4", 2e-3), ("panda_hand", 2e-3)):
            found = page.evaluate(f"pinproof.viewer.scene_tree.find(['robot', '{link}']).object.position.toArray()")
            expected = (arm.root_from_base * arm.frame_placement(q, link)).translation
            assert np.abs(np.array(found) - expected).max() < tolerance
    assert page.complaints == []
    page.close()


def test_the_caption_is_green_only_with_a_proof_of_this_very_motion(
    browser: Browser, pages: Callable[[str], Path]
) -> None:
    arm, scene = small_arm(), Scene([POST])
    motion, path = swing(arm, 0.0, 0.8), pages("captions")
    certificate = certified(arm, scene, motion)
    shown = {}
    for case, given, curve in (
        ("matching", certificate, motion),
        ("none", None, motion),
        ("other", certificate, swing(arm, 0.0, 0.7)),
    ):
        write_html(path, arm, scene, curve, certificate=given)
        page = browser.open(path.as_uri())
        colour = page.evaluate("getComputedStyle(document.getElementById('verdict')).backgroundColor")
        shown[case] = (page.text("#verdict"), colour, page.text("#caption"))
        page.close()
    assert shown["matching"][:2] == ("FREE", "rgb(11, 122, 67)")
    assert "Proven clearance" in shown["matching"][2]
    assert "2.00 s" in shown["matching"][2]
    for case in ("none", "other"):
        assert shown[case][:2] == ("NOT VALIDATED", "rgb(169, 79, 0)")
        assert "clearance" not in shown[case][2]


def test_a_contact_is_marked_where_it_is_even_behind_an_obstacle(
    browser: Browser, pages: Callable[[str], Path]
) -> None:
    arm, scene = small_arm(), Scene([POST])
    motion, path = swing(arm, 0.0, 1.5), pages("contact")
    certificate = certified(arm, scene, motion)
    write_html(path, arm, scene, motion, certificate=certificate)
    page = browser.open(f"{path.as_uri()}#t={certificate.first_contact.time}")
    assert page.text("#verdict") == "NOT VALIDATED"
    red, green, blue = page.canvas().astype(int).transpose(2, 0, 1)
    assert ((red > 150) & (green < 90) & (blue < 90)).sum() > 100
    centre = page.evaluate(
        "(() => { const ball = pinproof.viewer.scene_tree.find(['contact', '0', 'ball']).object;"
        " const box = new MeshCat.THREE.Box3().setFromObject(ball);"
        " const c = box.getCenter(new MeshCat.THREE.Vector3()); return [c.x, -c.z, c.y]; })()"
    )
    assert np.allclose(centre, certificate.first_contact.points.mean(axis=0), atol=1e-3)
    page.close()


def test_the_page_may_not_reach_out_even_if_something_in_it_tries(
    browser: Browser, pages: Callable[[str], Path]
) -> None:
    path = pages("sealed")
    write_html(path, small_arm())
    page = browser.open(path.as_uri())
    assert page.evaluate("fetch('http://127.0.0.1:9/').then(() => 'sent', (e) => e.name)") == "TypeError"
    assert any("Content Security Policy" in complaint for complaint in page.complaints)
    page.close()
