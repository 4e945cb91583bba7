"""The page of two set-ups side by side: one slider, one camera, one table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pinproof.cell import compare
from pinproof.picks import Picks, PickSetup

from .conftest import assert_quiet
from .test_page_tools import mouse, slide
from .test_report_page import ARM, EVIL, SCENE, bad, good, make_report


@pytest.fixture(scope="module")
def page(browser, pages):
    setup = PickSetup.make(ARM, SCENE, Picks(()), home=None, rng=0)
    before = make_report(good("near", 0.3), bad(EVIL, (0.1, 0.4, 0.3)), good("lost", 0.8))
    after = make_report(bad("lost", (0.3, 0.3, 0.1)), good(EVIL, 0.6), good("near", 0.4))  # in another order
    reports = [replace(report, setup=setup) for report in (before, after)]
    compare(*reports).save(pages("comparison"))
    reports[0].save(pages("one side"))
    opened = browser.open(pages("comparison").as_uri() + "#pick=near", 1200, 800)
    yield opened
    assert_quiet(opened)


def turned(page) -> list[float]:
    """The angle of the first joint on both sides."""
    page.settle()
    quaternions = page.evaluate(
        "pinproof.sides.map((side) => side.viewer.scene_tree.find(['robot', 'upper']).object.quaternion.toArray())"
    )
    return [2 * np.arctan2(z, w) for _, _, z, w in quaternions]


def test_one_slider_moves_both_sides_and_a_row_selects_its_pick_in_both(page):
    assert page.evaluate("document.querySelectorAll('iframe').length") == 2
    page.evaluate("pinproof.show(2)")
    assert turned(page) == pytest.approx([0.3, 0.4], abs=0.01)
    x, y = page.evaluate(
        "(() => { const r = document.querySelectorAll('#list tbody tr')[1].getBoundingClientRect();"
        " return [r.left + 60, r.top + r.height / 2]; })()"
    )
    mouse(page, (x, y), click=True)
    assert page.evaluate("decodeURIComponent(location.hash)") == f"#pick={EVIL}"
    page.click("#play")  # pauses
    page.evaluate("document.getElementById('scrub').focus()")
    slide(page, "End")
    assert turned(page) == pytest.approx([0.0, 0.6], abs=0.02)
    assert page.evaluate("pinproof.sides.map((side) => side.chosen)") == [1, 1]
    page.evaluate("document.querySelector('tbody tr[aria-selected=true]').focus()")
    page.key("ArrowDown")
    assert page.evaluate("pinproof.sides.map((side) => side.chosen)") == [2, 0]
    heads = page.evaluate(
        "pinproof.sides.map((side) => side.viewer.dom_element.ownerDocument.getElementById('verdict').innerText)"
    )
    assert heads == ["FREE", "NOT FOUND at grasp"]


def test_both_sides_have_the_camera_of_the_one_that_is_turned(page):
    places = "pinproof.sides.map((side) => side.viewer.camera.position.toArray())"
    page.settle()
    before = page.evaluate(places)
    assert before[0] == pytest.approx(before[1], abs=1e-6)
    for kind, x in (("mousePressed", 900), ("mouseMoved", 960), ("mouseReleased", 960)):  # in the right picture
        page.send("Input.dispatchMouseEvent", type=kind, x=x, y=200, button="left", buttons=1, clickCount=1)
    page.settle()
    page.settle()
    after = page.evaluate(places)
    assert after[0] == pytest.approx(after[1], abs=1e-6)
    assert abs(after[0][0] - before[0][0]) > 0.01


def test_a_narrow_page_has_one_side_above_the_other(page):
    page.resize(390, 800)
    tops = page.evaluate("[...document.querySelectorAll('iframe')].map((one) => one.getBoundingClientRect().top)")
    assert tops[1] > tops[0] + 100
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.resize(1200, 800)


def test_both_sides_judge_their_picks_again_and_what_is_equal_is_stored_once(page, pages):
    text = pages("comparison").read_text(encoding="utf-8")
    assert len(text) < 1.2 * len(pages("one side").read_text(encoding="utf-8"))
    for side in (0, 1):
        frame = f"document.querySelectorAll('iframe')[{side}]"
        page.evaluate(f"{frame}.contentDocument.querySelector('#live summary').click()")
        page.wait_for(f"{frame}.contentWindow.pinproof.again.now().loaded", 60)
        now = f"{frame}.contentWindow.pinproof.again.now()"
        page.wait_for(f"{now}.judged === {now}.verdicts.length", 60)
        assert "picks pass the grasp" in page.evaluate(
            f"{frame}.contentDocument.getElementById('live-count').innerText"
        )
    page.evaluate("pinproof.choose(0); pinproof.show(2)")
    assert turned(page) == pytest.approx([0.3, 0.4], abs=0.01)  # the slider still moves both
