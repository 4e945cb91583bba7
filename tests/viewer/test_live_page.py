"""Pages that compute, in a real browser with real keys and a real mouse, against the checker in Python."""

import base64
import json
import zlib

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import Box, CollisionChecker, Obstacle, Scene
from pinproof.description import robots_folder
from pinproof.spatial import matrix, pose, xyz_rpy
from pinproof.viewer import write_html

from .conftest import certified, small_arm, swing, turn

HOSTILE = '</script><script>window.hacked=1</script>"><img src=x onerror="window.hacked=1">\n- {name: x}'

PLACE = """(() => {
  const T = pinproof.viewer.scene_tree.find(["live"]).object, at = new MeshCat.THREE.Vector3(%f, %f, %f);
  pinproof.viewer.camera.updateWorldMatrix(true, false);  // not only in the next frame
  T.updateWorldMatrix(true, false);
  const p = T.localToWorld(at).project(pinproof.viewer.camera);
  const box = document.getElementById("meshcat-pane").getBoundingClientRect();
  return [box.left + (p.x + 1) / 2 * box.width, box.top + (1 - p.y) / 2 * box.height];
})()"""
"""Where a point of the root frame is in the window."""


def opened(visit, name, *size):
    """A page that computes, with its panel unfolded."""
    page = visit(name, *size)
    page.wait_for("pinproof.model")
    page.click("#live summary")
    page.wait_for("document.querySelector('#live details').open")
    return page


def now(page):
    """The configuration shown, the lower bound of the clearance, and the contacts by their owners."""
    text = "(() => { const m = pinproof.model.now(); return { q: m.q, lower: m.checked.lower, reason: m.reason,"
    text += " contacts: m.checked.contacts.map((c) => [c.a, c.b].map((k) => pinproof.settings.web.owners[k])) }; })()"
    return page.evaluate(text)


def agrees(page, checker):
    """What the page shows is what Python computes."""
    shown = now(page)
    q = np.array(shown["q"])
    contacts = {frozenset(contact.bodies) for contact in checker.check(q).contacts}
    assert {frozenset(pair) for pair in shown["contacts"]} == contacts
    if not contacts:
        assert shown["lower"] == pytest.approx(checker.clearance(q), abs=2e-9)
    return q


@pytest.fixture(scope="module")
def checker(ur5, cell):
    return CollisionChecker(ur5, cell)


@pytest.fixture(scope="module")
def written(pages, ur5, cell, checker):
    write_html(pages("live"), ur5, cell, q=ur5.home, checker=checker)
    return "live"


def test_sliders_and_keys_move_the_joints_and_each_pose_is_checked(visit, written, ur5, checker):
    page = opened(visit, written, 1000, 700)
    assert np.allclose(agrees(page, checker), ur5.home)
    page.evaluate("document.querySelector('#live input[type=range]').focus()")
    for _ in range(3):
        page.key("ArrowRight")
    page.wait_for(f"pinproof.model.now().q[0] > {ur5.home[0]} + 0.01")
    q = agrees(page, checker)
    assert np.allclose(q[1:], ur5.home[1:])
    x = ur5.root_from_frame(q, "forearm_link").translation[0]  # where it is drawn in the next frame
    page.wait_for(
        f"Math.abs(pinproof.viewer.scene_tree.find(['robot', 'forearm_link']).object.position.x - {x}) < 1e-6"
    )
    assert "Only this pose is checked" in page.text("#live-state")
    # into the table, which is named and red
    page.evaluate("pinproof.model.tryPose([0, 0.4, 0.5, 0, 0, 0])")
    agrees(page, checker)
    assert "is in contact with table" in page.text("#live-pair")
    red, green, _ = page.evaluate(
        "(() => { let c; pinproof.viewer.scene_tree.find(['scene', 'table']).object.traverse((m) => {"
        " if (m.isMesh) c = c || m.material.color.toArray(); }); return c; })()"
    )
    assert red > 2 * green
    page.click("#live-undo")
    assert np.allclose(agrees(page, checker), ur5.home)
    page.click("#live-command")
    words = page.evaluate("document.getElementById('live-text').value")
    assert words.startswith("pinproof check ur5 --q '0 -1.570796327 1.570796327")
    assert words.endswith("' --tcp tool0 --scene SCENE.yaml")  # never without the obstacles


def test_the_target_is_dragged_by_the_mouse_and_the_arm_follows(visit, written, ur5, checker):
    page = opened(visit, written, 1000, 700)
    before = ur5.forward_kinematics(ur5.home)
    for _ in range(5):  # a press that comes while the page is laid out again turns the camera instead
        start = page.evaluate(PLACE % tuple(before.translation))
        page.drag(start, (start[0] - 60, start[1] - 40))
        if page.evaluate("pinproof.model.now().trying"):
            break
    assert page.evaluate("pinproof.model.now().trying")
    q = agrees(page, checker)
    after = ur5.forward_kinematics(q)
    assert np.linalg.norm(after.translation - before.translation) > 0.03
    assert np.allclose(after.rotation, before.rotation, atol=1e-6)
    assert np.allclose(page.evaluate(PLACE % tuple(after.translation)), (start[0] - 60, start[1] - 40), atol=8)
    # all branches of the closed form, one after the other; a wrist half a revolution away is as near in both directions
    every = pp.AnalyticIk().solve_all(ur5, after, q).branches
    assert page.text("#live-reason") == f"Solution 1 of {len(every)}."
    for _ in every:
        page.click("#live-next")
        other = np.array(now(page)["q"])
        apart = np.abs((every - other + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
        assert apart.min() < 1e-6
        assert ur5.forward_kinematics(other).isApprox(after, 1e-6)
    # out of reach: the reason is stated, and the arm does not move
    far = [1, 0, 0, 3.0, 0, 1, 0, 0, 0, 0, 1, 0.4, 0, 0, 0, 1]
    page.evaluate(f"pinproof.model.moveTo(pinproof.model.matrixOf({far}), true)")
    assert page.text("#live-reason").startswith("Unreachable: no configuration has this pose")
    assert np.array_equal(now(page)["q"], other)
    # a slider moves the joints, and the handle is at the tcp again
    page.evaluate("{ const s = document.querySelector('#live input[type=range]'); s.value = 0.3;"
                  " s.dispatchEvent(new Event('input')); }")  # fmt: skip
    tcp = ur5.forward_kinematics(agrees(page, checker))
    entered = page.evaluate("[...document.querySelectorAll('#live .place input')].map((e) => Number(e.value))")
    assert np.allclose(entered[:3], 1000 * tcp.translation, atol=0.06)


def test_a_computer_that_draws_slowly_draws_less_while_the_target_is_dragged(visit, written, ur5):
    page = opened(visit, written, 600, 400)  # pages in tests have at most twelve frames a second
    page.settle()
    page.evaluate(
        "{ const R = pinproof.viewer.renderer, set = R.setPixelRatio.bind(R); window.drawn = [];"
        " R.setPixelRatio = (ratio) => { set(ratio); drawn.push([ratio, R.domElement.width]); }; }"
    )
    sharp = page.evaluate("pinproof.viewer.renderer.domElement.width")
    start = page.evaluate(PLACE % tuple(ur5.forward_kinematics(ur5.home).translation))
    page.drag(start, (start[0] - 30, start[1] - 20), until="drawn.length")
    assert page.evaluate("drawn") == [[0.5, sharp // 2], [1, sharp]]
    assert page.evaluate("pinproof.viewer.renderer.shadowMap.autoUpdate")


def test_an_obstacle_and_the_robot_are_moved_by_numbers(visit, written, ur5, cell, checker):
    page = opened(visit, written, 1000, 700)
    choose = "const s = document.getElementById('live-thing'); s.value = '{}'; s.dispatchEvent(new Event('change'));"
    page.evaluate(choose.format("obstacle left wall"))
    enter = "const e = document.querySelectorAll('#live .place input')[{}]; e.value = {};"
    enter += " e.dispatchEvent(new Event('change'));"
    page.evaluate(f"{{ {enter.format(2, 400)} }}")
    wall = cell["left wall"]
    moved = Obstacle("left wall", wall.shape, pose(xyz=(*wall.pose.translation[:2], 0.4)))
    things = [moved if thing.name == "left wall" else thing for thing in cell.obstacles]
    agrees(page, checker.with_scene(Scene(things)))
    assert "The cell was changed" in page.text("#live-state")
    assert np.allclose(page.node("scene", "left wall")[2], 0.4)
    page.click("#live-yaml")
    yaml = page.evaluate("document.getElementById('live-text').value")
    assert '- {name: "left wall", xyz: [0.35, 0.3, 0.4]}  # obstacles' in yaml
    page.click("#live-undo")
    agrees(page, checker)
    page.evaluate("{" + choose.format("robot") + "}")
    page.evaluate(f"{{ {enter.format(5, 90)} }}")
    turned = pose(rpy=(0, 0, -np.pi / 2))
    agrees(page, checker.with_scene(Scene([Obstacle(t.name, t.shape, turned * t.pose) for t in cell.obstacles])))


def test_a_part_in_the_hand_is_checked_and_figures_are_shown_at_every_change(visit, pages, ur5, cell):
    part = Obstacle("part", Box(0.06, 0.06, 0.3), pose(xyz=(0.0, 0.0, 0.15)))
    write_html(pages("held"), ur5, cell, attached=[part])
    checker = CollisionChecker(ur5, cell, attached=[part])
    bare = CollisionChecker(ur5, cell)
    target = pose(xyz=(0.45, -0.25, 0.25), rpy=(np.pi, 0.0, 0.0))
    q = next(q for q in pp.AnalyticIk().solve_all(ur5, target, ur5.home).branches if bare.is_free(q))
    page = opened(visit, "held", 1000, 700)
    page.evaluate(f"pinproof.model.tryPose({q.tolist()})")
    agrees(page, checker)
    assert page.text("#live-pair") == "part is in contact with table"
    volume = ur5.manipulability_batch(q[None])[0]
    margins = np.minimum(q - ur5.limits.lower, ur5.limits.upper - q)
    joint = ur5.joint_names[int(margins.argmin())]
    figures = page.text("#live-figures")
    assert figures == f"Nearest limit: {joint}, {np.degrees(margins.min()):.1f}\u00b0. Manipulability: {volume:.3g}"
    page.evaluate(f"pinproof.model.tryPose({[7.0, *q[1:].tolist()]})")
    assert f"Outside its limits: {ur5.joint_names[0]}" in page.text("#live-figures")


def test_both_arms_of_a_cell_have_sliders_and_targets(visit, pages):
    picks = pp.read_picks(robots_folder() / "two_ur5" / "picks.yaml")
    group, scene = picks.load_cell(), picks.load_scene()
    checker = CollisionChecker(group, scene)
    write_html(pages("two"), group, scene, checker=checker, live=True)
    page = opened(visit, "two", 1000, 700)
    labels = page.evaluate("[...document.querySelectorAll('#live input[type=range]')].map((one) => one.ariaLabel)")
    assert tuple(labels) == group.joint_names
    first, second = group.arms
    q = agrees(page, checker)
    # The second arm's target is moved; the first arm stays
    page.evaluate(
        "{ const s = document.getElementById('live-thing'); s.value = 'arm 1'; s.dispatchEvent(new Event('change')); }"
    )
    enter = "{ const e = document.querySelectorAll('#live .place input')[2]; e.value = Number(e.value) + 50;"
    page.evaluate(enter + " e.dispatchEvent(new Event('change')); }")
    moved = agrees(page, checker)
    own = group.indices(second)
    assert np.array_equal(moved[group.indices(first)], q[group.indices(first)])
    arm = group.arms[second]
    lifted = (arm.root_from_base * arm.forward_kinematics(moved[own])).translation
    start = (arm.root_from_base * arm.forward_kinematics(q[own])).translation
    assert np.allclose(lifted - start, [0.0, 0.0, 0.05], atol=1e-4)


def test_the_target_is_turned_in_steps_and_by_numbers(visit, written, ur5, checker):
    page = opened(visit, written, 1000, 700)
    page.evaluate("document.getElementById('snap-angles').value = '15'")
    page.evaluate("document.getElementById('snap-positions').value = '5'")
    before = ur5.forward_kinematics(ur5.home)
    turned = json.dumps(matrix(pose(xyz=before.translation + 0.0123, rpy=(-1.4, 0.2, -1.5))).ravel().tolist())
    page.evaluate(f"pinproof.model.moveTo(pinproof.model.matrixOf({turned}))")
    after = ur5.forward_kinematics(agrees(page, checker))
    assert np.allclose(np.degrees(xyz_rpy(after)[3:]), [-75.0, 15.0, -90.0], atol=1e-3)
    assert np.allclose(after.translation, 0.005 * np.round((before.translation + 0.0123) / 0.005), atol=1e-6)
    enter = "{ const e = document.querySelectorAll('#live .place input')[5]; e.value = -80;"
    page.evaluate(enter + " e.dispatchEvent(new Event('change')); }")
    after = ur5.forward_kinematics(agrees(page, checker))
    assert np.allclose(np.degrees(xyz_rpy(after)[3:]), [-75.0, 15.0, -80.0], atol=1e-3)


def test_a_page_of_a_motion_states_what_is_proven_and_follows_it(visit, pages, ur5, cell):
    motion = turn(ur5)
    certificate = certified(ur5, cell, motion)
    write_html(pages("moving"), ur5, cell, motion, certificate=certificate)
    page = opened(visit, "moving", 1000, 700)
    page.seek(1.0)
    page.wait_for("!pinproof.model.now().trying && Math.abs(pinproof.viewer.animator.time - 1) < 1e-6")
    page.wait_for(f"Math.abs(pinproof.model.now().q[0] - {motion(1.0)[0]}) < 1e-3")
    agrees(page, CollisionChecker(ur5, cell))
    assert page.text("#live-state").startswith("Proven: the motion.") == certificate.free
    page.evaluate("pinproof.model.tryPose([0, -1, 1, 0, 0, 0])")
    assert "Shown is another pose" in page.text("#live-state")
    assert np.allclose(page.evaluate("pinproof.model.now().q"), [0, -1, 1, 0, 0, 0])
    page.seek(0.5)
    page.wait_for("!pinproof.model.now().trying")


def test_names_of_bodies_run_no_scripts_and_numbers_without_end_stop_nothing(visit, pages):
    arm = small_arm(upper='<visual><geometry><box size="0.5 0.08 0.08"/></geometry></visual>'
                          '<collision><geometry><box size="0.5 0.08 0.08"/></geometry></collision>')  # fmt: skip
    scene = Scene([Obstacle(HOSTILE, Box(0.1, 0.1, 0.1), pose(xyz=(0.0, 0.6, 0.1)))])
    write_html(pages("hostile"), arm, scene, q=[1.5, 0.0])
    page = opened(visit, "hostile", 900, 600)
    page.evaluate(f"{{ const s = document.getElementById('live-thing'); s.value = {json.dumps('obstacle ' + HOSTILE)};"
                  " s.dispatchEvent(new Event('change')); }")  # fmt: skip
    page.evaluate("pinproof.model.moveTo(pinproof.model.matrixOf([1,0,0,0.2,0,1,0,0,0,0,1,0.1,0,0,0,1]), true)")
    page.click("#live-yaml")
    text = page.evaluate("document.getElementById('live-text').value")
    assert len(text.splitlines()) == 2
    assert json.dumps(HOSTILE) in text
    for numbers in ("[NaN, 0]", "[Infinity, 0]", "[1e300, -1e300]"):
        page.evaluate(f"pinproof.model.tryPose({numbers})")
    page.evaluate("pinproof.model.tryPose([0.5, 0])")
    for entry in ("NaN", "1e300", "-1e300"):
        page.evaluate(f"pinproof.model.moveTo(pinproof.model.matrixOf(Array(16).fill({entry})), true)")
    assert page.evaluate("window.hacked") is None
    assert page.evaluate("document.querySelectorAll('img').length") == 0


def test_names_of_properties_of_every_object_are_names_of_bodies(visit, pages):
    names = ("__proto__", "constructor", "hasOwnProperty", "toString", "a/b")
    things = [Obstacle(name, Box(0.1, 0.1, 0.1), pose(xyz=(0.4 * k, 0.6, 0.1))) for k, name in enumerate(names)]
    write_html(pages("properties"), small_arm(), Scene(things), q=[0.1, 0.2])
    page = visit("properties", 900, 600)
    page.wait_for("pinproof.model", 60)
    page.evaluate("pinproof.model.displace('constructor', pinproof.model.matrixOf([1,0,0,2,0,1,0,0,0,0,1,3,0,0,0,1]))")
    for k, name in enumerate(names):
        place = page.node("scene", name.replace("/", "\u2215"))
        assert np.allclose(place, (2, 0, 3) if name == "constructor" else (0.4 * k, 0.6, 0.1))


def test_without_webassembly_the_page_shows_report_and_picture(visit, pages):
    arm = small_arm()
    write_html(pages("plain"), arm, None, swing(arm), live=True)
    text = pages("plain").read_text(encoding="utf-8")
    without = text.replace("<title>", "<script>delete window.WebAssembly;</script><title>", 1)
    pages("without").write_text(without, encoding="utf-8")
    page = visit("without", at="#t=0.5")
    page.evaluate("pinproof.live")
    assert page.text("#live") == "This page does not check poses: the browser has no WebAssembly"
    assert page.text("#verdict") == "NOT VALIDATED"
    assert page.canvas().std() > 5


def test_a_page_with_a_damaged_module_says_so_and_shows_the_rest(visit, pages):
    arm = small_arm()
    write_html(pages("whole"), arm, None, swing(arm), live=True)
    head, rest = pages("whole").read_text(encoding="utf-8").split('id="core">', 1)
    module, rest = rest.split("<", 1)
    other = base64.b64encode(zlib.compress(b"no module" * 1000)).decode()
    for damaged in (module[: len(module) // 8 * 4], module[:4000] + "AAAA" + module[4004:], other):
        pages("damaged").write_text(f'{head}id="core">{damaged}<{rest}', encoding="utf-8")
        page = visit("damaged", at="#t=0.5")
        page.evaluate("pinproof.live")
        assert page.text("#live").startswith("This page does not check poses: ")
        assert page.text("#verdict") == "NOT VALIDATED"
    assert page.canvas().std() > 5


def test_a_page_computes_by_default_where_it_grows_little(pages, ur5, cell):
    write_html(pages("default"), ur5, cell)
    write_html(pages("never"), ur5, cell, live=False)
    grown = pages("default").stat().st_size - pages("never").stat().st_size
    assert 1e5 < grown < 1e6
    never = pages("never").read_text(encoding="utf-8")
    assert "wasm-unsafe-eval" not in never
    assert 'id="core"' not in never
