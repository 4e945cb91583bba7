"""The page of a sequence in a real browser: the animation, the chart and the table follow the same time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell import LeftOut, write_allocation_page, write_sequence_page
from pinproof.picks import PickBudget, PickSetup, PlaceTarget, SuctionCup

from .browser import Browser

pytestmark = pytest.mark.slow

BEFORE, AFTER = (0.45, 0.25, 0.02), (0.45, -0.25, 0.02)


def carried_box() -> tuple[PickSetup, list[pp.Pick]]:
    """A box that is moved from one side to the other, and a point that is only approached."""
    down = (np.pi, 0.0, 0.0)
    box = pp.Obstacle("box_1", pp.Box(0.05, 0.05, 0.05), pp.pose(BEFORE))
    place = PlaceTarget(pp.pose((*AFTER[:2], 0.045), down), approach=0.06, retreat=0.06)
    move = pp.Pick("move <b>", pp.pose((*BEFORE[:2], 0.045), down), carried=box.name, place=place)
    lance = pp.Obstacle("lance", pp.Cylinder(radius=0.01, length=0.15), pp.pose((0, 0, 0.075)))
    picks = [move, pp.Pick("look", pp.pose((0.3, 0.3, 0.3), down))]
    shared = pp.Picks(picks, tip=pp.pose((0, 0, 0.15)), tool=(lance,), cup=SuctionCup(radius=0.01))
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    return PickSetup.make(arm, pp.Scene([box]), shared, home=None, rng=0, budget=PickBudget(motion=20)), picks


def test_page_shows_the_cell_at_any_time_of_the_cycle(browser: Browser, pages: Callable[[str], Path]) -> None:
    setup, picks = carried_box()
    result = pp.sequence(setup, picks, grip_dwell=0.5, release_dwell=0.25)
    result = replace(result, left_out=(LeftOut("far <i>", "reach: too far"),))
    path = pages("sequence")
    grid = np.array([(x, y, 0.0) for x in (0.1, 0.2) for y in (0.1, 0.2)])
    table = path.with_suffix(".csv")
    table.write_text("x,y,yaw,share\n" + "".join(f"{x},{y},0,0.5\n{x},{y},1,0.75\n" for x, y, _ in grid), "utf-8")
    heat = pp.cell.read_heat_map(table)
    assert np.allclose(heat.xyz, grid)
    write_sequence_page(result, path, heat_map=heat)
    page = browser.open(path.as_uri())
    assert page.evaluate("document.querySelectorAll('#rows tr').length") == 3
    last = page.evaluate("Array.from(document.querySelector('#rows').lastChild.children, (cell) => cell.textContent)")
    assert last == ["", "far <i>", "left out", "", "", "reach: too far"]
    assert "guessed accelerations" in page.text("#figures")
    assert "FREE" in page.text("#figures")
    assert page.evaluate("pinproof.settings.duration") == pytest.approx(result.duration, abs=1e-6)
    step = next(step for step in result if step.pick.name == "move <b>")
    grip, release = (next(p.start for p in step.phases if p.name == name) for name in ("grip", "release"))
    for time, place in ((0.0, BEFORE), (grip + 0.4, BEFORE), (release + 0.2, AFTER), (result.duration, AFTER)):
        page.evaluate(f"pinproof.seek({time})")
        at = page.evaluate("pinproof.viewer.scene_tree.find(['scene', 'box_1']).object.position.toArray()")
        assert at == pytest.approx(place, abs=1e-3), time
    page.evaluate(f"pinproof.seek({grip + 0.2})")
    page.wait_for("document.querySelector('#now').textContent === 'move <b>, grip'")
    second = list(result)[1]
    page.evaluate("document.querySelectorAll('#rows tr')[2].click()")  # it has no time
    page.evaluate("document.querySelectorAll('#rows tr')[1].click()")
    page.wait_for(f"Math.abs(pinproof.viewer.animator.time - {second.start}) < 0.01")
    page.wait_for("document.querySelectorAll('#rows tr')[1].getAttribute('aria-selected') === 'true'")
    chart = page.evaluate(
        "new Set([...document.querySelectorAll('#gantt [data-start]')].filter((bar) => bar.offsetWidth > 3)"
        ".map((bar) => getComputedStyle(bar).backgroundColor)).size"
    )
    assert chart > 6  # the colours of several phases
    assert page.canvas().std() > 10
    assert page.complaints == []
    assert [url for url in page.requests if not url.startswith(("file:", "data:", "blob:"))] == []
    page.close()


def test_page_shows_two_arms_on_the_common_clock(browser: Browser, pages: Callable[[str], Path]) -> None:
    picks = pp.read_picks(Path(__file__).parents[2] / "robots" / "two_ur5" / "picks.yaml")
    few = replace(picks, picks=tuple(pick for pick in picks if pick.name in ("part_1_1", "part_6_3")))
    result = pp.cell.allocate(picks.load_cell(), pp.Scene.load(picks.scene), few, compare=False, grip_dwell=0.3)
    path = pages("allocation")
    write_allocation_page(result, path)
    page = browser.open(path.as_uri())
    assert page.evaluate("document.querySelectorAll('#rows tr').length") == 2
    part = result.parts["part_6_3"]
    for time, at in ((0.0, part.before), (part.gripped - 0.1, part.before), (part.released + 0.1, part.after)):
        page.evaluate(f"pinproof.seek({time})")
        shown = page.evaluate("pinproof.viewer.scene_tree.find(['scene', 'part_6_3']).object.position.toArray()")
        assert shown == pytest.approx(at.pose.translation.tolist(), abs=1e-3), time
    page.evaluate(f"pinproof.seek({part.gripped - 0.1})")
    page.wait_for("document.querySelector('#now').textContent.includes('right: part_6_3, grip')")
    assert page.evaluate("document.querySelector('#now').textContent").startswith("left: part_1_1")
    assert page.evaluate("document.querySelectorAll('#rows tr[aria-selected=true]').length") == 2
    assert page.canvas().std() > 10
    assert page.complaints == []
    page.close()
    narrow = browser.open(path.as_uri(), 390, 500)
    narrow.evaluate(f"pinproof.seek({part.gripped - 0.1})")
    narrow.wait_for("document.querySelectorAll('#rows tr[aria-selected=true]').length === 2")
    assert narrow.evaluate("window.scrollY") == 0
    assert narrow.evaluate("document.querySelector('#rows').getBoundingClientRect().top") > 500  # below the window
    narrow.close()
