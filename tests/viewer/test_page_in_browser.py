"""What a browser really shows; pixels are counted in a picture with one flat colour for each link."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import pinproof as pp
from pinproof.cell import LeftOut
from pinproof.collision import Scene
from pinproof.description import robots_folder
from pinproof.ik import AnalyticIk
from pinproof.model import load_robot
from pinproof.picks import PickBudget, PickSetup, PlaceTarget, SuctionCup
from pinproof.spatial import matrix, pose
from pinproof.viewer import set_stage, write_html
from pinproof.viewer.overlays import marks_of
from pinproof.viewer.wire import Commands

from .conftest import POST, assert_quiet, certified, small_arm, swing, turn

SMALLEST_LINK = 40
"""Pixels in which the smallest link, a finger of the Panda, can still be made out."""

CENTRE = (
    "['{}'].map((name) => {{ const b = new MeshCat.THREE.Box3().setFromObject("
    "pinproof.viewer.scene_tree.find(['contact', '0', name]).object);"
    " const c = b.getCenter(new MeshCat.THREE.Vector3()); return [c.x, -c.z, c.y]; }})"
)
"""The centre of the box around a part of the mark of a contact; three.js has y up."""


def check_links(page, least=0.15):
    """The robot covers 15 to 60 % of the canvas, which is not blank, and every link is there to see."""
    assert page.canvas().std() > 10 or page.evaluate("pinproof.painted")
    pixels, size = page.link_pixels(), page.canvas_size()
    page.evaluate("pinproof.painted = true")
    assert {name: count for name, count in pixels.items() if count < SMALLEST_LINK} == {}
    assert least <= sum(pixels.values()) / size <= 0.60


def changed(before, after, level=30):
    """(height, width) where two pictures differ."""
    return np.abs(before.astype(int) - after).max(axis=2) > level


@pytest.mark.parametrize("name", ["ur5", "panda", "xarm7", "scara", "stanford"])
def test_every_link_of_a_robot_is_visible(visit, pages, name):
    arm = load_robot(name).arm()
    shown = arm
    if name in ("scara", "stanford"):  # from their tables, without meshes
        shown = load_robot(pp.dh_to_urdf(pp.DhTable.load(robots_folder() / name / "dh.yaml"))).arm()
    write_html(pages(f"still_{name}"), shown, q=arm.home)
    page = visit(f"still_{name}", 900, 560)
    check_links(page)
    assert page.evaluate("document.getElementById('player').hidden")
    if name == "ur5":
        page.resize(420, 800)
        page.wait_for("document.getElementById('meshcat-pane').clientWidth === 420")
        check_links(page)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_robot_in_its_cell_is_framed_at_both_ends_of_its_motion(visit, pages, cell, name):
    arm = load_robot(name).arm()
    write_html(pages(name), arm, cell, turn(arm))
    page = visit(name, 1280, 760, at="#t=0")
    check_links(page, least=0.12)  # the picture also contains the obstacles near the tool
    page.seek(2.2)
    check_links(page, least=0.12)


def test_the_motion_plays_pauses_and_starts_at_the_time_of_the_url(visit, pages):
    arm = small_arm()
    write_html(pages("swing"), arm, None, swing(arm, duration=2.0))
    page = visit("swing", at="#t=0.5")
    assert page.evaluate("fetch('http://127.0.0.1:9/').then(() => 'sent', (e) => e.name)") == "TypeError"
    assert any("Content Security Policy" in complaint for complaint in page.complaints)  # it may not reach out
    page.complaints.clear()
    page.wait_for("document.getElementById('clock').textContent === '0.50 / 2.00 s'")
    early = page.canvas()
    page.seek(1.5)
    assert changed(early, page.canvas()).mean() > 0.01
    page.seek(0.5)
    assert np.array_equal(page.canvas(), early)
    turned = page.node("robot", "upper", attribute="quaternion.toArray()")
    assert 2 * np.arctan2(turned[2], turned[3]) == pytest.approx(float(swing(arm)(0.5)[0]), abs=1e-4)
    # the plots follow the motion, and a click seeks
    tall = page.evaluate("document.getElementById('stage').clientHeight")
    page.click("#chart summary")
    page.wait_for(f"document.getElementById('stage').clientHeight < {tall} - 50")
    page.wait_for("document.querySelector('canvas').clientHeight === document.getElementById('stage').clientHeight")
    box = "document.querySelector('#chart svg').getBoundingClientRect()"
    line = "document.querySelector('#chart .now').getBoundingClientRect()"
    page.wait_for(f"Math.abs({line}.left - {box}.left - 0.25 * {box}.width) < 1")
    place = f"{{clientX: {box}.left + 0.75 * {box}.width, clientY: {box}.top, bubbles: true}}"
    page.evaluate(f"document.querySelector('#chart svg').dispatchEvent(new MouseEvent('click', {place}))")
    page.wait_for("Math.abs(pinproof.viewer.animator.time - 1.5) < 0.02")
    playing = visit("swing")
    playing.wait_for("pinproof.viewer.animator.time > 0.1")  # without a time, it plays by itself
    playing.click("#play")
    assert not playing.evaluate("pinproof.viewer.animator.playing")


def test_the_slider_of_a_self_motion_moves_the_elbow_and_not_the_tcp(visit, pages, panda):
    motion = AnalyticIk(redundant_steps=12).self_motion(panda, panda.forward_kinematics(panda.home), panda.home)
    write_html(pages("elbow"), panda, None, elbow=motion)
    page, curve = visit("elbow", 1000, 640), motion.curves[0]
    assert page.text("#verdict") == "CONFIGURATION"
    assert page.evaluate("document.getElementById('scrub').getAttribute('aria-label')") == "panda_joint7 in rad"
    page.wait_for("document.getElementById('clock').textContent.includes('= ')")  # the first frame is drawn
    shown = float(page.text("#clock").split("= ")[1].split()[0])
    assert curve.lower - 1e-3 <= shown <= curve.upper + 1e-3
    assert not page.evaluate("pinproof.viewer.animator.playing")
    for share in (0.1, 0.35, 0.8):
        value = share * (curve.upper - curve.lower)
        page.evaluate(
            f"(() => {{ const s = document.getElementById('scrub'); s.value = {value}; "
            "s.dispatchEvent(new Event('input')); })()"
        )
        page.wait_for(f"Math.abs(pinproof.viewer.animator.time - {value}) < 2e-3")
        q = curve.at(curve.lower + page.evaluate("pinproof.viewer.animator.time"))
        for link in ("panda_link4", "panda_hand"):
            expected = (panda.root_from_base * panda.frame_placement(q, link)).translation
            assert np.abs(np.array(page.node("robot", link)) - expected).max() < 2e-3


def test_the_caption_is_green_only_with_a_proof_of_this_very_motion(visit, pages):
    arm, scene = small_arm(), Scene([POST])
    motion = swing(arm, 0.0, 0.8)
    certificate = certified(arm, scene, motion)
    for case, given, curve in (
        ("matching", certificate, motion), ("none", None, motion), ("other", certificate, swing(arm, 0.0, 0.7)),
    ):  # fmt: skip
        write_html(pages(case), arm, scene, curve, certificate=given)
        page = visit(case)
        colour = page.evaluate("getComputedStyle(document.getElementById('verdict')).backgroundColor")
        free = ("FREE", "rgb(11, 122, 67)") if case == "matching" else ("NOT VALIDATED", "rgb(169, 79, 0)")
        assert (page.text("#verdict"), colour) == free
        caption = page.text("#caption")
        assert ("Proven clearance" in caption, "clearance" in caption) == (case == "matching",) * 2
        assert case != "matching" or "2.00 s" in caption


# -- layers and controls, on one page with a contact -------------------------------------------------------------------

ARM, SCENE = small_arm(), Scene([POST])
MOTION = swing(ARM, 0.0, 1.5)
GHOSTS = [[-0.5, 0.0], [-1.0, 1.0], [-1.0, 1.0]]


@pytest.fixture(scope="module")
def certificate():
    return certified(ARM, SCENE, MOTION)


@pytest.fixture(scope="module")
def page(browser, pages, certificate):
    path, here = pages("layers"), {"camera": pose(xyz=(0.2, -0.2, 0.4))}
    write_html(path, ARM, SCENE, MOTION, certificate=certificate, ghosts=GHOSTS, frames=here, layers=["sweep"])
    opened = browser.open(path.as_uri(), 740, 400)
    yield opened
    assert_quiet(opened)


def switch(page, name):
    page.click(f"#layer-{name}")


def test_a_page_with_a_contact_opens_at_the_contact_which_is_marked_where_it_is(page, certificate):
    contact, time = certificate.first_contact, "pinproof.viewer.animator.time"
    assert page.evaluate(time) == pytest.approx(contact.time)
    assert not page.evaluate("pinproof.viewer.animator.playing")
    page.seek(0)
    page.click("#moment")
    assert page.evaluate(time) == pytest.approx(contact.time)
    assert page.text("#verdict") == "NOT VALIDATED"
    red, green, blue = page.canvas().astype(int).transpose(2, 0, 1)
    assert ((red > 150) & (green < 90) & (blue < 90)).sum() > 50  # even behind an obstacle
    (centre,) = page.evaluate(CENTRE.format("ball"))
    assert np.allclose(centre, contact.points.mean(axis=0), atol=1e-3)
    # the arrow is the separating direction of the second body
    (mark,) = marks_of(contact)
    assert np.linalg.norm(mark.normal) == pytest.approx(1.0)
    upper = matrix(ARM.root_from_base * ARM.frame_placement(contact.q, "upper"))[:3, 1]
    assert mark.normal @ upper > 0.9  # the post is on the side that the link turns to
    along = np.subtract(*page.evaluate(CENTRE.format("head', 'shaft")))
    assert along @ mark.normal / np.linalg.norm(along) > 0.99


def test_only_the_two_bodies_of_a_contact_are_red(page, certificate):
    def is_red(*node):
        red, green, blue = page.evaluate(
            f"(() => {{ let c; pinproof.viewer.scene_tree.find({list(node)}).object.traverse((m) => {{"
            " if (m.isMesh) c = c || m.material.color.toArray(); }); return c; })()"
        )
        assert red > 2 * max(green, blue) or red == pytest.approx(green, abs=0.1)
        return red > 2 * max(green, blue)

    assert set(certificate.first_contact.bodies) == {"upper", "post"}
    upper, post = ("robot", "upper", "visual"), ("scene", "post")
    assert (is_red(*upper), is_red(*post), is_red("robot", "base", "visual")) == (True, True, False)
    switch(page, "contact")
    assert not is_red(*upper)
    switch(page, "contact")
    assert is_red(*post)


def test_every_layer_can_be_switched_off_and_on_again(page):
    names, shown = (
        page.evaluate(f"pinproof.settings.layers.filter((layer) => {which}).map((layer) => layer.name)")
        for which in ("true", "layer.shown")
    )
    assert names == ["robot", "collision", "scene", "path", "sweep", "ghosts", "frames", "contact"]
    assert shown == ["robot", "scene", "path", "sweep", "ghosts", "frames", "contact"]
    page.resize(400, 300)
    page.wait_for("document.querySelector('canvas').clientWidth === 400")
    before = page.canvas()
    for name in names:
        switch(page, name)
        assert changed(before, page.canvas(), 8).sum() > 25, name
        switch(page, name)
        assert np.array_equal(page.canvas(), before), name
    page.resize(740, 400)


def test_ghosts_are_drawn_at_their_configurations_and_equal_ones_once_and_frames_move_with_their_links(page):
    stage = set_stage(ARM, SCENE)
    copies = page.evaluate("pinproof.settings.copies.map((copy) => [copy.into, copy.of[1], copy.count])")
    assert [entry for entry in copies if entry[0] == "ghosts"] == [["ghosts", "upper", 2]]  # the base stays
    columns = page.node("ghosts", "0", attribute="children.map((one) => one.matrix.elements)")
    placed = np.reshape(columns, (-1, 4, 4)).swapaxes(1, 2)
    assert np.allclose(placed, [stage.link_poses(np.array(q))[1] for q in GHOSTS[:2]], atol=1e-6)
    notes = page.evaluate("Object.fromEntries(pinproof.settings.layers.map((layer) => [layer.name, layer.note]))")
    assert notes["ghosts"] == "2 of 3"
    names = page.evaluate("pinproof.settings.frames.names.map((each) => each[1])")
    assert names == ["base", "upper", "hand", "tip", "camera"]
    page.seek(2)
    tip = (ARM.root_from_base * ARM.forward_kinematics(MOTION.end)).translation
    assert np.allclose(page.node("frames", "tip"), tip, atol=1e-6)
    assert np.allclose(page.node("frames", "camera"), (0.2, -0.2, 0.4))


def test_the_speed_is_the_readers_and_keys_play_pause_and_step(page):
    page.evaluate(
        "(() => { const speed = document.getElementById('speed'); speed.value = '0.25';"
        " speed.dispatchEvent(new Event('change')); })()"
    )
    times = page.evaluate(
        "(() => { const a = pinproof.viewer.animator; pinproof.seek(0.5); a.actions.forEach((x) => x.play());"
        " a.mixer.update(1); const t = a.actions[0].time; pinproof.seek(0.5); return t; })()"
    )
    assert times == pytest.approx(0.75)
    page.evaluate("document.activeElement.blur()")
    page.seek(1)
    for name, time in (("ArrowRight", 1 + 1 / 30), ("ArrowLeft", 1)):
        page.key(name)
        assert page.evaluate("pinproof.viewer.animator.time") == pytest.approx(time)
    for playing in (True, False):
        page.key(" ")
        assert page.evaluate("pinproof.viewer.animator.playing") is playing


@pytest.mark.parametrize("width", [360, 740])
def test_controls_neither_overlap_nor_stick_out(page, width):
    page.resize(width, 640)
    boxes = page.evaluate(
        "['stage', 'play', 'scrub', 'clock', 'speed', 'caption', 'layers'].map((id) => {"
        " const b = document.getElementById(id).getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]; })"
    )
    for k, (left, top, right, bottom) in enumerate(boxes):
        assert 0 <= left < right - 20 <= width - 20
        for low, high, far, deep in boxes[k + 1 :]:
            assert right <= low or far <= left or bottom <= high or deep <= top
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.resize(740, 400)


# -- pictures on meshes ------------------------------------------------------------------------------------------------


def pictured_arm(folder, *, torn=False):
    """An arm with a plate of 0.5 m across x and y whose left half is red and right half is blue, as OBJ with a PNG."""
    picture = np.zeros((64, 64, 3), dtype=np.uint8)
    picture[:, :32, 0], picture[:, 32:, 2] = 255, 255
    corners = np.array([[0.0, -0.25, 0.2], [0.5, -0.25, 0.2], [0.5, 0.25, 0.2], [0.0, 0.25, 0.2]])
    corners = np.concatenate([corners, corners - [0, 0, 0.02]])
    uv = np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (2, 1)).astype(float)
    faces = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], [0, 4, 5], [0, 5, 1], [1, 5, 6], [1, 6, 2]]
    material = trimesh.visual.material.SimpleMaterial(image=Image.fromarray(picture))
    mesh = trimesh.Trimesh(corners, faces, visual=trimesh.visual.TextureVisuals(uv, material=material), process=False)
    mesh.export(folder / "plate.obj")
    if torn:
        (picture_file,) = (path for path in folder.iterdir() if path.suffix == ".png")
        picture_file.write_bytes(picture_file.read_bytes()[:60])
    return small_arm(upper=f'<visual><geometry><mesh filename="{folder / "plate.obj"}"/></geometry></visual>')


def test_a_picture_goes_with_its_vertices_and_a_torn_one_leaves_the_plain_colour(tmp_path):
    (surface,) = set_stage(pictured_arm(tmp_path), None).links[1].surfaces
    assert surface.image.startswith("data:image/jpeg;base64,")
    assert np.allclose(surface.uv, surface.vertices[:, :2] / 0.5 + [0, 0.5], atol=1e-3)
    commands = Commands()
    commands.set_surface("/robot/upper/visual/0", surface)
    assert commands.pictures == {surface.image: [["robot", "upper", "visual", "0"]]}
    torn = set_stage(pictured_arm(tmp_path, torn=True), None)
    assert [surface.image for surface in torn.links[1].surfaces] == [None]


def test_the_picture_has_the_same_orientation_in_a_browser(visit, pages, tmp_path):
    write_html(pages("pictured"), pictured_arm(tmp_path))
    page = visit("pictured", 800, 480)
    page.evaluate("pinproof.pictured.then(() => true)")
    red, green, blue = page.canvas().astype(int).transpose(2, 0, 1)
    masks = (red > 1.6 * green) & (red > 1.6 * blue), (blue > 1.6 * red) & (blue > 90)
    assert all(mask.sum() > 300 for mask in masks)
    ends = page.evaluate(
        "[0.1, 0.4].map((x) => { const v = new MeshCat.THREE.Vector3(x, 0.2, 0).project(pinproof.viewer.camera);"
        " const c = document.querySelector('canvas'); return [(1 - v.y) / 2 * c.height, (1 + v.x) / 2 * c.width]; })"
    )  # three.js has y up: (x, z, -y)
    left, right = (np.argwhere(mask).mean(axis=0) for mask in masks)
    assert (right - left) @ np.subtract(ends[1], ends[0]) > 0


# -- sequences: the animation, the chart and the table follow the same time --------------------------------------------

BEFORE, AFTER, DOWN = (0.45, 0.25, 0.02), (0.45, -0.25, 0.02), (np.pi, 0.0, 0.0)
SELECTED = "#rows tr[aria-selected=true]"


def carried_box(arm):
    """A box that is moved from one side to the other, and a point that is only approached."""
    box = pp.Obstacle("box_1", pp.Box(0.05, 0.05, 0.05), pose(BEFORE))
    place = PlaceTarget(pose((*AFTER[:2], 0.045), DOWN), approach=0.06, retreat=0.06)
    move = pp.Pick("move <b>", pose((*BEFORE[:2], 0.045), DOWN), carried=box.name, place=place)
    lance = pp.Obstacle("lance", pp.Cylinder(radius=0.01, length=0.15), pose((0, 0, 0.075)))
    picks = [move, pp.Pick("look", pose((0.3, 0.3, 0.3), DOWN))]
    shared = pp.Picks(picks, tip=pose((0, 0, 0.15)), tool=(lance,), cup=SuctionCup(radius=0.01))
    return PickSetup.make(arm, pp.Scene([box]), shared, home=None, rng=0, budget=PickBudget(motion=20)), picks


@pytest.mark.slow
def test_page_shows_the_cell_at_any_time_of_the_cycle(visit, pages, ur5):
    setup, picks = carried_box(ur5)
    result = pp.sequence(setup, picks, grip_dwell=0.5, release_dwell=0.25)
    result = replace(result, left_out=(LeftOut("far <i>", "reach: too far"),))
    grid = np.array([(x, y, 0.0) for x in (0.1, 0.2) for y in (0.1, 0.2)])
    table = pages("sequence").with_suffix(".csv")
    table.write_text("x,y,yaw,share\n" + "".join(f"{x},{y},0,0.5\n{x},{y},1,0.75\n" for x, y, _ in grid), "utf-8")
    heat = pp.cell.read_heat_map(table)
    assert np.allclose(heat.xyz, grid)
    result.save(pages("sequence"), heat_map=heat)
    page = visit("sequence")
    assert page.texts("#rows tr:last-child td") == ["", "●\xa0far <i>", "left out", "", "", "reach: too far"]
    assert ("guessed accelerations" in page.text("#figures"), "FREE" in page.text("#figures")) == (True, True)
    assert page.evaluate("pinproof.settings.duration") == pytest.approx(result.duration, abs=1e-6)
    step = next(step for step in result if step.pick.name == "move <b>")
    grip, release = (next(p.start for p in step.phases if p.name == name) for name in ("grip", "release"))
    for time, place in ((0.0, BEFORE), (grip + 0.4, BEFORE), (release + 0.2, AFTER), (result.duration, AFTER)):
        page.seek(time)
        assert page.node("scene", "box_1") == pytest.approx(place, abs=1e-3), time
    page.seek(grip + 0.2)
    page.wait_for("document.querySelector('#now').textContent === 'move <b>, grip'")
    assert len(page.texts("#rows tr")) == 3
    page.click("#rows tr:nth-child(3)")  # it has no time
    page.click("#rows tr:nth-child(2)")
    page.wait_for(f"Math.abs(pinproof.viewer.animator.time - {list(result)[1].start}) < 0.01")
    page.wait_for("document.querySelectorAll('#rows tr')[1].getAttribute('aria-selected') === 'true'")
    chart = page.evaluate(
        "new Set([...document.querySelectorAll('#gantt [data-start]')].filter((bar) => bar.offsetWidth > 3)"
        ".map((bar) => getComputedStyle(bar).backgroundColor)).size"
    )
    assert chart > 6  # the colours of several phases
    assert page.canvas().std() > 10


@pytest.mark.slow
def test_page_shows_two_arms_on_the_common_clock(visit, pages):
    picks = pp.read_picks(Path(__file__).parents[2] / "robots" / "two_ur5" / "picks.yaml")
    few = replace(picks, picks=tuple(pick for pick in picks if pick.name in ("part_1_1", "part_6_3")))
    result = pp.cell.allocate(picks.load_cell(), pp.Scene.load(picks.scene), few, compare=False, grip_dwell=0.3)
    result.save(pages("allocation"))
    page, part = visit("allocation"), result.parts["part_6_3"]
    assert len(page.texts("#rows tr")) == 2
    for time, at in ((0.0, part.before), (part.gripped - 0.1, part.before), (part.released + 0.1, part.after)):
        page.seek(time)
        assert page.node("scene", "part_6_3") == pytest.approx(at.pose.translation.tolist(), abs=1e-3), time
    page.seek(part.gripped - 0.1)
    page.wait_for("document.querySelector('#now').textContent.includes('right: part_6_3, grip')")
    assert page.texts("#now")[0].startswith("left: part_1_1")
    assert len(page.texts(SELECTED)) == 2
    assert page.canvas().std() > 10
    narrow = visit("allocation", 390, 500)
    narrow.seek(part.gripped - 0.1)
    narrow.wait_for(f"document.querySelectorAll('{SELECTED}').length === 2")
    assert narrow.evaluate("window.scrollY") == 0
    assert narrow.evaluate("document.querySelector('#rows').getBoundingClientRect().top") > 500  # below the window
