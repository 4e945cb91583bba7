"""What a reader does with a page, with real mouse and keys: hover, select, measure, cut, turn, link, print."""

import base64
import json
import re
from collections.abc import Callable

import coal
import numpy as np
import pytest

from pinproof.cell.pages import CellRow, write_cell_page
from pinproof.collision import Box, Cone, Cylinder, Obstacle, PointCloud, Scene
from pinproof.picks import Pick
from pinproof.spatial import matrix, pose
from pinproof.viewer import (
    Bar,
    FilmPhase,
    choose_view,
    film,
    obstacle_surfaces,
    set_stage,
    tool_points,
    write_html,
)

from .browser import Page
from .conftest import POST, assert_quiet, small_arm, swing, turn
from .test_report_page import EVIL, bad, carried, good, make_report, save, standing

ARM = small_arm()
HOSTILE = ('<img src=x onerror="window.hit=1">', "\u202e\u05e9\u05dc\u05d5\u05dd'\"&", "long" * 200, "a/b")
CRATES = [
    Obstacle(name, Box(0.06, 0.06, 0.06), pose(xyz=(0.15 + 0.11 * k, 0.15, 0.03))) for k, name in enumerate(HOSTILE)
]


@pytest.fixture(scope="module")
def opened(browser, pages):
    write_html(pages("tools"), ARM, Scene([POST, *CRATES]), swing(ARM, duration=2.0))
    page = browser.open(pages("tools").as_uri() + "#t=0", 900, 640)
    yield page
    assert page.evaluate("window.hit ?? 0") == 0  # no name was run
    assert_quiet(page)


@pytest.fixture
def page(opened):
    """The page as it was opened, from above."""
    opened.evaluate("document.activeElement.blur()")
    opened.key("Escape")
    opened.evaluate(
        "(() => { const s = document.getElementById('section'); s.value = '';"
        " s.dispatchEvent(new Event('change')); })()"
    )
    opened.seek(0)
    press(opened, "Top")
    return opened


def on_screen(page: Page, point, frame="pinproof.viewer.scene") -> tuple[float, float]:
    """The place on the screen of a point in the frame of the root link, or of another object."""
    return all_on_screen(page, [point], frame)[0]


def all_on_screen(page: Page, points, frame="pinproof.viewer.scene") -> list[tuple[float, float]]:
    """The places on the screen of several points."""
    page.settle()
    places = page.evaluate(
        f"(() => {{ {frame}.updateWorldMatrix(true, false);"
        " const box = document.getElementById('meshcat-pane').getBoundingClientRect();"
        f" return {json.dumps([list(map(float, point)) for point in points])}.map((point) => {{"
        f" const v = {frame}.localToWorld(new MeshCat.THREE.Vector3(...point)).project(pinproof.viewer.camera);"
        " return [box.left + (v.x + 1) / 2 * box.width, box.top + (1 - v.y) / 2 * box.height]; }); })()"
    )
    return [(x, y) for x, y in places]


def mouse(page: Page, place, *, click: bool = False) -> None:
    x, y = place
    page.send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    for kind in ("mousePressed", "mouseReleased") if click else ():
        page.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
    page.settle()


def pick_option(page: Page, selector: str, text: str) -> None:
    """Choose an option of a list as the keyboard does: focus, and type its text."""
    page.evaluate(f"document.querySelector('{selector}').focus()")
    for letter in text:
        page.send("Input.dispatchKeyEvent", type="char", text=letter)
    page.settle()


def crate(k):
    """The middle of the upper face of a crate."""
    return CRATES[k].pose.translation + np.array([0, 0, 0.03])


@pytest.mark.parametrize("k", range(len(HOSTILE)))
def test_the_name_of_the_body_under_the_pointer_is_shown_as_plain_text(page, k):
    mouse(page, on_screen(page, crate(k)))
    page.wait_for("!document.getElementById('hover').hidden")
    assert page.evaluate("document.getElementById('hover').textContent") == HOSTILE[k]
    box = "document.getElementById('{}').getBoundingClientRect().toJSON()"
    shown, stage = (page.evaluate(box.format(name)) for name in ("hover", "stage"))
    assert stage["left"] <= shown["left"] < shown["right"] <= stage["right"]
    assert shown["bottom"] <= stage["bottom"]
    mouse(page, (890, 20))
    page.wait_for("document.getElementById('hover').hidden")


def glow(page: Page, *node: str) -> float:
    """How brightly the body glows."""
    return page.evaluate(
        f"(() => {{ let c; pinproof.viewer.scene_tree.find({list(node)}).object.traverse((m) => {{"
        " if (m.isMesh) c = c ?? m.material.emissive; }); return c.r + c.g + c.b; })()"
    )


def test_a_click_selects_a_body_and_the_list_of_bodies_does_the_same(page):
    mouse(page, on_screen(page, crate(2)), click=True)
    assert page.evaluate("document.getElementById('body').selectedOptions[0].text") == HOSTILE[2]
    assert page.text("#reading").startswith(f"{HOSTILE[2]}, at (0.370, 0.150, 0.030) m")
    assert (glow(page, "scene", HOSTILE[2]) > 0.1, glow(page, "scene", "post")) == (True, 0)
    pick_option(page, "#body", "post")
    assert (glow(page, "scene", HOSTILE[2]), glow(page, "scene", "post") > 0.1) == (0, True)
    page.key("Escape")
    assert (glow(page, "scene", "post"), page.text("#reading")) == (0, "")


def test_the_distance_of_two_points_is_measured_and_follows_the_motion(page):
    pick_option(page, "#measure", "points")
    arm_point = (0.4, 0.0, 0.09)  # on the upper face of the link, whose frame is at (0, 0, 0.1)
    link = "pinproof.viewer.scene_tree.find(['robot', 'upper']).object"
    mouse(page, on_screen(page, crate(3)), click=True)
    mouse(page, on_screen(page, arm_point, link), click=True)
    shown = float(re.match(r"([\d.]+) mm", page.text("#reading"))[1])
    assert shown == pytest.approx(1e3 * np.linalg.norm(np.add(arm_point, [0, 0, 0.1]) - crate(3)), abs=6.0)  # a pixel
    page.seek(2)
    page.settle()
    turned = matrix(ARM.root_from_base * ARM.frame_placement(swing(ARM).end, "upper")) @ [*arm_point, 1.0]
    later = float(re.match(r"([\d.]+) mm", page.text("#reading"))[1])
    assert later == pytest.approx(1e3 * np.linalg.norm(turned[:3] - crate(3)), abs=6.0)
    assert abs(later - shown) > 50


def test_the_distance_of_two_bodies_is_that_of_their_drawn_surfaces(page):
    pick_option(page, "#measure", "bodies")
    mouse(page, on_screen(page, crate(2)), click=True)
    mouse(page, on_screen(page, crate(0)), click=True)
    assert "as drawn: 160.0 mm (x, y, z: " in page.text("#reading")


def test_distances_of_drawn_bodies_are_those_of_coal(visit, pages):
    rng = np.random.default_rng(0)
    shapes = [Box(0.1, 0.2, 0.3), Cylinder(0.06, 0.3), Cone(0.1, 0.2)] * 4
    bodies = [
        Obstacle(f"b{k}", shape, pose(xyz=rng.uniform(-0.45, 0.45, 3), rpy=rng.uniform(-3, 3, 3)))
        for k, shape in enumerate(shapes)
    ]
    write_html(pages("bodies"), ARM, Scene(bodies), q=ARM.home)
    page = visit("bodies")
    found = page.evaluate(
        "(() => { const own = (k) => pinproof.viewer.scene_tree.find(['scene', 'b' + k]).object;"
        " return [...Array(12).keys()].flatMap((a) => [...Array(a).keys()].map((b) => [a, b]))"
        ".map(([a, b]) => [a, b, pinproof.closestPoints(own(a), own(b)).distance]); })()"
    )
    surfaces = [obstacle_surfaces(body)[0] for body in bodies]
    hulls = []
    for surface in surfaces:
        points = coal.StdVec_Vec3s()
        points.extend(list(surface.vertices.astype(np.float64)))
        hulls.append(coal.Convex.convexHull(points, True, "Qt"))
    places = [coal.Transform3s(matrix(body.pose)[:3, :3], matrix(body.pose)[:3, 3]) for body in bodies]
    apart = 0
    for a, b, distance in found:
        exact = coal.distance(
            hulls[int(a)], places[int(a)], hulls[int(b)], places[int(b)], coal.DistanceRequest(), coal.DistanceResult()
        )
        apart += exact > 0
        assert distance == pytest.approx(max(exact, 0.0), abs=2e-5), (a, b)
    assert 10 < apart < 66


def slide(page: Page, key: str) -> None:
    """Move the focused slider to its start or end by a key."""
    for kind in ("rawKeyDown", "keyUp"):
        page.send(
            "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode={"End": 35, "Home": 36}[key]
        )
    page.settle()


def camera(page: Page):
    """The direction from the target to the camera, and the target, in the frame of the root link."""
    x, y, z, a, b, c = page.evaluate(
        "[...pinproof.viewer.camera.position.toArray(), ...pinproof.viewer.controls.target.toArray()]"
    )
    toward = np.array([x - a, -(z - c), y - b])
    return toward / np.linalg.norm(toward), np.array([a, -c, b])


def press(page: Page, text: str) -> None:
    """Press a button of the bar by the mouse."""
    place = page.evaluate(
        f"(() => {{ const b = [...document.querySelectorAll('#bar button')].find((one) => one.textContent === '{text}')"
        ".getBoundingClientRect(); return [b.left + b.width / 2, b.top + b.height / 2]; })()"
    )
    mouse(page, place, click=True)


@pytest.mark.parametrize(("name", "axis"), [("Top", (0, 0, 1)), ("Front", (1, 0, 0)), ("Side", (0, -1, 0))])
def test_the_views_look_along_an_axis_and_frame_the_picture(page, name, axis):
    page.click("#reset")
    page.settle()
    before, _ = camera(page)
    press(page, name)
    toward, _ = camera(page)
    assert toward @ np.array(axis) > 0.9999
    assert page.evaluate("document.querySelector('#views [aria-pressed=true]').textContent") == name
    for x, y in all_on_screen(page, page.evaluate("pinproof.settings.points")):
        assert 0 <= x <= 900
        assert 0 <= y <= 640
    page.key("r")
    page.settle()
    assert camera(page)[0] == pytest.approx(before, abs=1e-6)
    assert page.evaluate("document.querySelectorAll('#views [aria-pressed=true]').length") == 0


def test_the_view_of_the_tool_follows_it_until_the_reader_turns_the_picture(page):
    press(page, "Tool")
    for time in (0.0, 1.0, 2.0):
        page.seek(time)
        page.settle()
        tcp = (ARM.root_from_base * ARM.forward_kinematics(swing(ARM)(time))).translation
        assert camera(page)[1] == pytest.approx(tcp, abs=1e-4)
    turned = camera(page)[0]
    page.send("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft", code="ArrowLeft", modifiers=8)
    page.settle()
    assert camera(page)[0] @ turned == pytest.approx(np.cos(0.1), abs=0.01)
    there = camera(page)[1]
    page.seek(0.0)
    page.settle()
    assert camera(page)[1] == pytest.approx(there)


def test_a_section_hides_what_is_beyond_it_from_the_eye_and_the_pointer(page):
    place = on_screen(page, crate(1))
    whole = page.canvas()
    pick_option(page, "#section", "z")
    page.evaluate("document.getElementById('cut').focus()")
    slide(page, "Home")
    assert page.evaluate("Number(document.getElementById('cut').value)") == pytest.approx(0.0, abs=1e-6)
    assert (np.abs(page.canvas().astype(int) - whole).max(axis=2) > 20).mean() > 0.01
    assert page.text("#cut-at").startswith("z = ")
    mouse(page, (place[0] + 1, place[1]))
    page.wait_for("document.getElementById('hover').hidden")
    slide(page, "End")
    assert page.evaluate("Number(document.getElementById('cut').value)") == pytest.approx(1.0, abs=1e-3)
    mouse(page, place)
    page.wait_for(f"document.getElementById('hover').textContent === {HOSTILE[1]!r}".replace("\\u202e", "\u202e"))


def test_a_part_in_a_transparent_bin_has_no_stripes(visit, pages):
    glass = (0.2, 0.4, 0.8, 0.4)
    part, bin_ = Obstacle("part", Box(0.12, 0.12, 0.12), pose(xyz=(0.62, 0, 0.06))), Box(0.12, 0.12, 0.2)
    write_html(pages("bin"), ARM, Scene([part, Obstacle("bin", bin_, pose(xyz=(0.62, 0, 0.1)), glass)]), q=ARM.home)
    page = visit("bin", 800, 600)
    press(page, "Front")
    left, top = page.evaluate(
        "(({left, top}) => [left, top])(document.querySelector('canvas').getBoundingClientRect())"
    )
    grid = [(y, z) for y in np.linspace(-0.05, 0.05, 15) for z in np.linspace(0.01, 0.11, 15)]
    places = all_on_screen(page, [(0.68, y, z) for y, z in grid])  # on a face of both
    picture = page.canvas().astype(int)
    shades = [picture[int(y - top), int(x - left)] for x, y in places]
    assert np.ptp(shades, axis=0).max() < 20


def test_the_robot_is_seen_in_front_of_a_scan_of_its_cell(ur5):
    """Walls on the side from which the first direction looks; the floor and the walls are one obstacle."""
    steps = np.arange(-0.9, 1.0, 0.03)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    far = np.ones(len(a))
    walls = [
        np.column_stack(rows) for rows in ((a, b, -0.02 * far), (a, -0.9 * far, b + 0.9), (0.99 * far, a, b + 0.9))
    ]
    stage = set_stage(ur5, Scene([Obstacle("scan", PointCloud(np.concatenate(walls), 0.03))]))
    shown = film(stage, [FilmPhase(turn(ur5))])
    view = choose_view(stage, shown.poses, shown.tcps[:, 0], tool=tool_points(stage, shown.poses))
    assert view.direction[0] < 0.9
    eye = view.points.mean(axis=0) + 3.0 * view.direction
    assert eye[1] > -0.9  # not behind a wall
    assert eye[0] < 0.99


# -- picks -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def report():
    return make_report(bad(EVIL, (0.1, 0.4, 0.3)), good("near", 0.3), good("a b+c%/&", 0.8), carried())


@pytest.fixture
def picks_page(visit, pages, report) -> Callable[..., Page]:
    def open_page(*size: int, at: str = "") -> Page:
        save(report, pages("linked"), standing(0.5))
        return visit("linked", *size, at=at)

    return open_page


def test_a_link_opens_its_pick_and_choosing_a_pick_makes_the_link(picks_page):
    page = picks_page(1000, 700, at="#pick=a%20b%2Bc%25%2F%26")
    assert page.evaluate("pinproof.chosen") == 2
    page.click("#rows tr:nth-child(1)")
    assert page.evaluate("decodeURIComponent(location.hash)") == f"#pick={EVIL}"
    page.evaluate("location.hash = '#pick=near'")
    page.wait_for("pinproof.chosen === 1")
    for broken in ("#pick=%E0%A4%A", "#pick=nobody", "#pick="):
        other = picks_page(1000, 700, at=broken)
        assert other.evaluate("pinproof.chosen") == 1  # the first good one


def test_a_click_on_a_part_chooses_its_pick_and_the_row_lights_the_part(picks_page):
    page = picks_page(1000, 700)
    assert glow(page, "scene", "part") == 0
    page.seek(0)
    press(page, "Top")
    mouse(page, on_screen(page, (0, 0, 0.0), "pinproof.viewer.scene_tree.find(['scene', 'part']).object"), click=True)
    assert page.evaluate("pinproof.chosen") == 3
    assert page.evaluate("location.hash") == "#pick=carried"
    assert glow(page, "scene", "part") > 0.1
    page.click("#rows tr:nth-child(2)")
    assert page.evaluate("pinproof.bodies.length") > 2


def test_parts_have_the_colour_of_their_verdict_until_it_is_switched_off(picks_page):
    page = picks_page(1000, 700)
    colour = "pinproof.viewer.scene_tree.find(['scene', 'part', '0']).object.children[0].material.color.toArray()"
    red, green, _ = page.evaluate(colour)
    assert green > 2 * red
    page.click("#tint")
    red, green, _ = page.evaluate(colour)
    assert red >= green


def tab_stops(page: Page, count: int) -> list[str]:
    """What the Tab key reaches, in order."""
    page.evaluate("document.activeElement.blur()")
    stops = []
    for _ in range(count):
        page.send("Input.dispatchKeyEvent", type="keyDown", key="Tab", code="Tab", windowsVirtualKeyCode=9)
        page.send("Input.dispatchKeyEvent", type="keyUp", key="Tab", code="Tab", windowsVirtualKeyCode=9)
        stops.append(
            page.evaluate("document.activeElement.id || document.activeElement.textContent.trim().slice(0, 20)")
        )
    return stops


def test_everything_that_can_be_focused_has_a_name_and_the_order_is_that_of_the_page(picks_page):
    page = picks_page(1000, 700)
    tree = page.send("Accessibility.getFullAXTree")["nodes"]
    unnamed = []
    for node in tree:
        properties = {entry["name"]: entry["value"].get("value") for entry in node.get("properties", ())}
        reached = properties.get("focusable") and node["role"]["value"] not in ("RootWebArea", "row", "generic")
        if reached and not node.get("name", {}).get("value"):
            unnamed.append(node["role"]["value"])
    assert unnamed == []
    (picture,) = [node for node in tree if node.get("name", {}).get("value", "").startswith("The robot in its scene")]
    assert picture["role"]["value"] in ("image", "img")
    stops = tab_stops(page, 28)
    order = [
        stops.index(name) for name in ("reset", "Top", "section", "measure", "body", "play", "scrub", "before", "find")
    ]
    assert order == sorted(order)
    assert page.evaluate("document.querySelectorAll('[role=img] button, [role=img] select').length") == 0


@pytest.mark.parametrize("width", [320, 390])
def test_a_narrow_page_neither_scrolls_sideways_nor_by_itself(picks_page, browser, pages, width):
    page = picks_page(width, 800)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.click("#rows tr:nth-child(4)")
    assert page.evaluate("[window.scrollX, window.scrollY]") == [0, 0]
    write_html(pages("narrow"), ARM, Scene([POST, *CRATES]), swing(ARM))
    motion = browser.open(pages("narrow").as_uri() + "#t=0", width, 800)
    for k in range(len(HOSTILE)):
        motion.evaluate(
            f"pinproof.selectBody(pinproof.bodies.find((body) => body.name.startsWith({HOSTILE[k][:3]!r})))"
        )
        assert motion.evaluate("document.documentElement.scrollWidth") <= width
    assert_quiet(motion)


def printed(page: Page) -> bytes:
    with page.pixels():
        paper = page.send("Page.printToPDF", printBackground=True, paperWidth=8.27, paperHeight=11.69)
    return base64.b64decode(paper["data"])


def test_a_report_is_printed_on_one_page_with_its_picture(picks_page):
    page = picks_page(1000, 700)
    paper = printed(page)
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", paper)) == 1
    sizes = [int(size) for size in re.findall(rb"/Subtype\s*/Image\b.*?/Width (\d+)", paper, re.DOTALL)]
    assert max(sizes) > 300
    page.send("Emulation.setEmulatedMedia", media="print")
    shown = "[...document.querySelectorAll('{}')].map((one) => one.getBoundingClientRect().height > 0)"
    assert page.evaluate(shown.format("#paper, #list table, #caption dl")) == [True] * 3
    assert page.evaluate(shown.format("#bar, #player, #find")) == [False] * 3
    ink = page.evaluate(
        "(() => { const c = document.getElementById('paper');"
        " const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
        " return new Set(d).size; })()"
    )
    assert ink > 50  # it is a picture


# -- cells -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cell_page(pages):
    """Two parts of which the first is moved, and the second is left out."""
    parts = [Obstacle(f"part {k}", Box(0.1, 0.1, 0.1), pose(xyz=(0.4, 0.35 * k - 0.1, 0.05))) for k in range(2)]
    stage = set_stage(ARM, Scene(parts))
    picks = [Pick(f"pick {k}", pose(), carried=part.name) for k, part in enumerate(parts)]
    write_cell_page(
        pages("cell"), stage, film(stage, [FilmPhase(swing(ARM))]), title="Cell", summary="", figures=[],
        notes=[], duration=2.0, rows=[CellRow("pick 0", picks[0], 0.5, 1.0, 0.01, "")],
        left_out=[("pick 1", "reach: <b>too far")], parts={pick.name: pick.carried for pick in picks},
        bars=[Bar("transit", "transit", 0.5, 1.0, "pick 0, transit")], lanes=["transit"], acceleration_source="the arm",
    )  # fmt: skip
    return pages("cell")


def test_a_cell_has_links_colours_and_rows_for_what_is_left_out(visit, cell_page):
    page = visit("cell", 1000, 700, at="#pick=pick%200")
    page.wait_for("pinproof.viewer.animator.time >= 0.5 && document.querySelector('#rows [aria-selected=true]')")
    assert page.texts("#rows tr:nth-child(2) td")[-1] == "reach: <b>too far"
    colours = [page.evaluate(
        f"pinproof.viewer.scene_tree.find(['scene', 'part {k}', '0']).object.children[0].material.color.toArray()"
    ) for k in range(2)]  # fmt: skip
    assert (colours[0][1] > colours[0][0], colours[1][0] > 2 * colours[1][1]) == (True, True)
    press(page, "Top")
    mouse(page, on_screen(page, (0.4, 0.25, 0.1)), click=True)
    assert page.evaluate("location.hash") == "#pick=pick%201"
    mouse(page, on_screen(page, (0.4, -0.1, 0.1)), click=True)
    assert page.evaluate("location.hash") == "#pick=pick%200"
    page.wait_for("Math.abs(pinproof.viewer.animator.time - 0.5) < 1.2")
