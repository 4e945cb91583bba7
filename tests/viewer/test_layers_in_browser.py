"""What lies over the picture and the hands that change it, all on one page: switches, speed, keys, a narrow window."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pinproof.collision import Certificate, Scene
from pinproof.spatial import matrix, pose
from pinproof.viewer import write_html
from pinproof.viewer.overlays import swept
from pinproof.viewer.stage import FilmPhase, film, set_stage

from .browser import Browser, Page
from .conftest import POST, certified, small_arm, swing

ARM, SCENE = small_arm(), Scene([POST])
MOTION = swing(ARM, 0.0, 1.5)
GHOSTS = [[-0.5, 0.0], [-1.0, 1.0], [-1.0, 1.0]]


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    return certified(ARM, SCENE, MOTION)


@pytest.fixture(scope="module")
def page(browser: Browser, pages: Callable[[str], Path], certificate: Certificate) -> Iterator[Page]:
    path = pages("layers")
    here = {"camera": pose(xyz=(0.2, -0.2, 0.4))}
    write_html(path, ARM, SCENE, MOTION, certificate=certificate, ghosts=GHOSTS, frames=here, layers=["sweep"])
    opened = browser.open(path.as_uri(), 740, 400)
    yield opened
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith(("file:", "data:"))] == []
    opened.close()


def switch(page: Page, name: str) -> None:
    page.evaluate(f"document.getElementById('layer-{name}').click()")


def key(page: Page, name: str) -> None:
    for kind in ("keyDown", "keyUp"):
        page.send("Input.dispatchKeyEvent", type=kind, key=name)


def places(page: Page, into: str, number: int) -> np.ndarray:
    """(k, 4, 4) where the copies of a link are."""
    columns = page.evaluate(
        f"pinproof.viewer.scene_tree.find(['{into}', '{number}']).object.children.map((one) => one.matrix.elements)"
    )
    return np.reshape(columns, (-1, 4, 4)).swapaxes(1, 2)


def test_a_page_with_a_contact_opens_at_the_contact(page: Page, certificate: Certificate) -> None:
    at = certificate.first_contact.time
    assert page.evaluate("pinproof.viewer.animator.time") == pytest.approx(at)
    assert not page.evaluate("pinproof.viewer.animator.playing")
    page.evaluate("pinproof.seek(0)")
    page.evaluate("document.getElementById('moment').click()")
    assert page.evaluate("pinproof.viewer.animator.time") == pytest.approx(at)


def test_only_the_two_bodies_of_a_contact_are_red(page: Page, certificate: Certificate) -> None:
    def colour(*node: str) -> list[int]:
        return page.evaluate(
            f"(() => {{ let c; pinproof.viewer.scene_tree.find({list(node)}).object.traverse((m) => {{"
            " if (m.isMesh) c = c || m.material.color.toArray(); }); return c; })()"
        )

    assert set(certificate.first_contact.bodies) == {"upper", "post"}
    for node in (("robot", "upper", "visual"), ("scene", "post")):
        red, green, blue = colour(*node)
        assert red > 2 * max(green, blue)
    red, green, blue = colour("robot", "base", "visual")
    assert red == pytest.approx(green, abs=0.1)
    switch(page, "contact")
    red, green, blue = colour("robot", "upper", "visual")
    assert red == pytest.approx(green, abs=0.1)
    switch(page, "contact")
    assert colour("scene", "post")[0] > 2 * colour("scene", "post")[1]


def test_every_layer_can_be_switched_off_and_on_again(page: Page) -> None:
    names = page.evaluate("pinproof.settings.layers.map((layer) => layer.name)")
    assert names == ["robot", "collision", "scene", "path", "sweep", "ghosts", "frames", "contact"]
    shown = page.evaluate("pinproof.settings.layers.filter((layer) => layer.shown).map((layer) => layer.name)")
    assert shown == ["robot", "scene", "path", "sweep", "ghosts", "frames", "contact"]
    page.send("Emulation.setDeviceMetricsOverride", width=400, height=300, deviceScaleFactor=1, mobile=False)
    page.wait_for("document.querySelector('canvas').clientWidth === 400")
    before = page.canvas()
    for name in names:
        switch(page, name)
        after = page.canvas()
        assert (np.abs(after.astype(int) - before).max(axis=2) > 8).sum() > 25, name
        switch(page, name)
        assert np.array_equal(page.canvas(), before), name
    page.send("Emulation.setDeviceMetricsOverride", width=740, height=400, deviceScaleFactor=1, mobile=False)


def test_ghosts_are_drawn_at_their_configurations_and_equal_ones_once(page: Page) -> None:
    stage = set_stage(ARM, SCENE)
    copies = page.evaluate("pinproof.settings.copies.map((copy) => [copy.into, copy.of[1], copy.count])")
    assert [entry for entry in copies if entry[0] == "ghosts"] == [["ghosts", "upper", 2]]  # the base stays
    placed = places(page, "ghosts", 0)
    assert np.allclose(placed, [stage.link_poses(np.array(q))[1] for q in GHOSTS[:2]], atol=1e-6)
    notes = page.evaluate("Object.fromEntries(pinproof.settings.layers.map((layer) => [layer.name, layer.note]))")
    assert notes["ghosts"] == "2 of 3"


@pytest.mark.slow
def test_the_swept_volume_contains_bodies_attached_to_the_tcp(ur5) -> None:
    stage = set_stage(ur5, None)
    step = np.zeros(6)
    step[[0, 3]] = 1.0
    from pinproof.motion import Trajectory

    motion = Trajectory([0.0, 1.0], [ur5.home, ur5.home + step], np.zeros((2, 6)), ur5.joint_names)
    shown = film(stage, [FilmPhase(motion)])
    steps = swept(stage, shown, 0.6)
    names = [link.name for link in stage.links]
    assert [name for k, name in enumerate(names) if not np.isnan(steps[:, k]).any()] == ["wrist_3_link"]
    last = names.index("wrist_3_link")
    assert np.array_equal(steps[0, last], shown.poses[0, last])
    assert np.array_equal(steps[-1, last], shown.poses[-1, last])
    assert np.linalg.norm(np.diff(steps[:, last, :3, 3], axis=0), axis=1).max() < 0.1


def test_frames_have_their_names_and_move_with_their_links(page: Page) -> None:
    names = page.evaluate("pinproof.settings.frames.names.map((each) => each[1])")
    assert names == ["base", "upper", "hand", "tip", "camera"]
    page.evaluate("pinproof.seek(2)")
    found = page.evaluate("pinproof.viewer.scene_tree.find(['frames', 'tip']).object.position.toArray()")
    assert np.allclose(found, (ARM.root_from_base * ARM.forward_kinematics(MOTION.end)).translation, atol=1e-6)
    there = page.evaluate("pinproof.viewer.scene_tree.find(['frames', 'camera']).object.position.toArray()")
    assert np.allclose(there, (0.2, -0.2, 0.4))


def test_the_speed_is_the_readers(page: Page) -> None:
    page.evaluate(
        "(() => { const speed = document.getElementById('speed'); speed.value = '0.25';"
        " speed.dispatchEvent(new Event('change')); })()"
    )
    times = page.evaluate(
        "(() => { const a = pinproof.viewer.animator; pinproof.seek(0.5); a.actions.forEach((x) => x.play());"
        " a.mixer.update(1); const t = a.actions[0].time; pinproof.seek(0.5); return t; })()"
    )
    assert times == pytest.approx(0.75)


def test_keys_play_pause_and_step(page: Page) -> None:
    page.evaluate("document.activeElement.blur()")
    page.evaluate("pinproof.seek(1)")
    key(page, "ArrowRight")
    assert page.evaluate("pinproof.viewer.animator.time") == pytest.approx(1 + 1 / 30)
    key(page, "ArrowLeft")
    assert page.evaluate("pinproof.viewer.animator.time") == pytest.approx(1)
    key(page, " ")
    assert page.evaluate("pinproof.viewer.animator.playing")
    key(page, " ")
    assert not page.evaluate("pinproof.viewer.animator.playing")


@pytest.mark.parametrize("width", [360, 740])
def test_controls_neither_overlap_nor_stick_out(page: Page, width: int) -> None:
    page.send("Emulation.setDeviceMetricsOverride", width=width, height=640, deviceScaleFactor=1, mobile=False)
    boxes = page.evaluate(
        "['stage', 'play', 'scrub', 'clock', 'speed', 'caption', 'layers'].map((id) => {"
        " const b = document.getElementById(id).getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]; })"
    )
    for k, (left, top, right, bottom) in enumerate(boxes):
        assert left >= 0
        assert right <= width
        assert right - left > 20
        for low, high, far, deep in boxes[k + 1 :]:
            assert right <= low or far <= left or bottom <= high or deep <= top
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.send("Emulation.setDeviceMetricsOverride", width=740, height=400, deviceScaleFactor=1, mobile=False)


def test_the_normal_of_a_contact_is_the_separating_direction_of_the_second_body(
    page: Page, certificate: Certificate
) -> None:
    from pinproof.viewer.overlays import marks_of

    (mark,) = marks_of(certificate.first_contact)
    assert np.linalg.norm(mark.normal) == pytest.approx(1.0)
    upper = (matrix(ARM.root_from_base * ARM.frame_placement(certificate.first_contact.q, "upper")))[:3, 1]
    assert mark.normal @ upper > 0.9  # the post stands on the side that the link turns to
    ends = page.evaluate(
        "['shaft', 'head'].map((name) => { const b = new MeshCat.THREE.Box3().setFromObject("
        "pinproof.viewer.scene_tree.find(['contact', '0', name]).object);"
        " const c = b.getCenter(new MeshCat.THREE.Vector3()); return [c.x, -c.z, c.y]; })"
    )
    along = np.subtract(ends[1], ends[0])
    assert along @ mark.normal / np.linalg.norm(along) > 0.99
