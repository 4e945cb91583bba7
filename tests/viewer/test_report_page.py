"""The page of many picks, as a file and in a real browser: table, arrows, motions, what is carried."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pinproof.collision import Box, CollisionChecker, Obstacle, Scene, certify
from pinproof.motion import Trajectory
from pinproof.picks import (
    CampaignResult,
    Pick,
    PickMotion,
    PickReport,
    Picks,
    PickStatus,
    PickVerdict,
    Stage,
    StageResult,
)
from pinproof.picks.input.picks import NamedFrame, PickProblem
from pinproof.picks.input.settings import GripperFingers
from pinproof.picks.report import page as page_module
from pinproof.picks.report.page import BYTES_A_LINK, MOST_BYTES, RATE, PageMotions
from pinproof.spatial import matrix, pose
from pinproof.viewer.stage import FilmPhase, film, set_stage

from .browser import Browser, Page
from .conftest import POST, certified, small_arm, swing

ARM, SCENE, SHARED = small_arm(), Scene([POST]), Picks(())
EVIL = "</script><b>evil"


def good(name: str, end: float) -> PickVerdict:
    motion = swing(ARM, 0.0, end)
    place = pose(xyz=(0.5 * np.cos(end), 0.5 * np.sin(end), 0.1), rpy=(np.pi, 0, 0))
    passed = (StageResult(Stage.REACH, True, "2 configurations"), StageResult(Stage.TIMING, True, "proven free"))
    motions = (PickMotion("pick", motion, certified(ARM, SCENE, motion), (), SCENE),)
    return PickVerdict(Pick(name, place), PickStatus.GOOD, passed, 2, motion.end, motion, 2.0, motions=motions)


PART = Obstacle("part", Box(0.05, 0.05, 0.05), pose(xyz=(0.08, 0.0, 0.0)))
"""In front of the tip, as it is held."""


def root_from_part(angle: float) -> np.ndarray:
    return matrix(ARM.root_from_base * ARM.forward_kinematics(np.array([angle, 0.0])) * PART.pose)


def standing(angle: float) -> Scene:
    """The part where the tip lets go of it at an angle (rad) of the first joint."""
    return Scene([POST, replace(PART, pose=root_from_part(angle))])


def carried(frame: str = "") -> PickVerdict:
    """The part is taken at 0.5 rad after 2 s, carried to 1.0 rad, and left there after 4 s."""
    parts = [
        ("transit", swing(ARM, 0.0, 0.5), CollisionChecker(ARM, standing(0.5))),
        ("retreat", swing(ARM, 0.5, 1.0), CollisionChecker(ARM, SCENE, attached=[PART])),
        ("leave", swing(ARM, 1.0, 0.2), CollisionChecker(ARM, standing(1.0))),
    ]
    motions = tuple(
        PickMotion(name, line, certify(line, checker), checker.attached, checker.scene) for name, line, checker in parts
    )
    complete, passed = (
        Trajectory.join(*(line for _, line, _ in parts)),
        (StageResult(Stage.TIMING, True, "proven free"),),
    )
    pick = Pick("carried", pose(), frame=frame, carried="part")
    return PickVerdict(pick, PickStatus.GOOD, passed, 1, np.array([0.5, 0.0]), complete, 2.0, motions=motions)


def bad(name: str, xyz: tuple[float, float, float]) -> PickVerdict:
    stages = (StageResult(Stage.REACH, True, "1 configuration"), StageResult(Stage.GRASP, False, f"{name} hits post"))
    return PickVerdict(Pick(name, pose(xyz=xyz, rpy=(np.pi, 0, 0))), PickStatus.NOT_FOUND, stages, 1)


def make_report(*verdicts: PickVerdict) -> PickReport:
    return PickReport("swing", verdicts, (PickProblem(3, "torn", "xyz holds nan"),) if verdicts else (), "the arm", ())


@pytest.fixture(scope="module")
def report() -> PickReport:
    return make_report(bad(EVIL, (0.1, 0.4, 0.3)), good("near", 0.3), good("wide", 0.8), bad("away", (50, 0, 0)))


@pytest.fixture
def page(browser: Browser, pages: Callable[[str], Path], report: PickReport) -> Iterator[Page]:
    path = pages("report")
    if not path.exists():
        report.save(path, arm=ARM, scene=SCENE, picks=SHARED)
    opened = browser.open(path.as_uri(), 1200, 800)
    yield opened
    assert opened.complaints == []
    assert [url for url in opened.requests if not url.startswith(("file:", "data:"))] == []
    opened.close()


def names(page: Page) -> list[str]:
    return page.evaluate("[...document.querySelectorAll('#rows td:first-child')].map((cell) => cell.textContent)")


def click(page: Page, selector: str) -> None:
    page.evaluate(f"document.querySelector({json.dumps(selector)}).click()")


def key(page: Page, name: str) -> None:
    for kind in ("keyDown", "keyUp"):
        page.send("Input.dispatchKeyEvent", type=kind, key=name, code=name)


def turned(page: Page) -> float:
    q = page.evaluate("pinproof.viewer.scene_tree.find(['robot', 'upper']).object.quaternion.toArray()")
    return float(2 * np.arctan2(q[2], q[3]))


def test_the_first_good_pick_plays_at_once_and_is_captioned_by_its_proof(page: Page) -> None:
    page.wait_for("pinproof.viewer.animator.time > 0.1")
    assert page.evaluate("pinproof.chosen") == 1
    assert page.text("#verdict") == "FREE"
    assert page.evaluate("getComputedStyle(document.getElementById('verdict')).backgroundColor") == "rgb(11, 122, 67)"
    assert "Proven clearance" in page.text("#caption dl")
    assert "resampled for display at 30 poses per second" in page.evaluate(
        "document.getElementById('notes').textContent"
    )


def test_a_click_on_a_row_changes_the_motion(page: Page) -> None:
    page.evaluate("pinproof.seek(2)")
    assert turned(page) == pytest.approx(0.3, abs=1e-4)
    before = page.canvas()
    click(page, "#rows tr:nth-child(3)")
    page.evaluate("pinproof.seek(2)")
    assert turned(page) == pytest.approx(0.8, abs=1e-4)
    assert (np.abs(page.canvas().astype(int) - before).max(axis=2) > 30).mean() > 0.01
    click(page, "#rows tr:nth-child(1)")
    assert turned(page) == pytest.approx(0.0, abs=1e-6)  # nothing to play: back at rest
    assert page.evaluate("document.getElementById('player').hidden")
    assert page.text("#verdict") == "NOT FOUND at grasp"
    assert page.text("#reason") == f"{EVIL} hits post"


def test_a_pick_that_is_chosen_again_plays_again(page: Page) -> None:
    for _ in range(3):
        click(page, "#rows tr:nth-child(3)")
        page.evaluate("pinproof.seek(1)")
        assert turned(page) == pytest.approx(0.4, abs=1e-4)


def test_a_click_on_an_arrow_chooses_its_pick(page: Page) -> None:
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")  # it is drawn
    spot = page.evaluate(
        "(() => { const v = new MeshCat.THREE.Vector3(), m = new MeshCat.THREE.Matrix4();"
        " pinproof.arrows.getMatrixAt(0, m); v.set(0, 0, -pinproof.settings.markers.length * 0.9).applyMatrix4(m);"
        " pinproof.arrows.localToWorld(v); v.project(pinproof.viewer.camera);"
        " const box = document.getElementById('meshcat-pane').getBoundingClientRect();"
        " return [box.left + (v.x + 1) / 2 * box.width, box.top + (1 - v.y) / 2 * box.height]; })()"
    )
    for kind in ("mousePressed", "mouseReleased"):
        page.send("Input.dispatchMouseEvent", type=kind, x=spot[0], y=spot[1], button="left", clickCount=1)
    assert page.evaluate("pinproof.chosen") == 0
    assert page.evaluate("document.querySelector('tr[aria-selected=true] td').textContent") == EVIL


def test_the_keyboard_walks_the_table(page: Page) -> None:
    assert page.evaluate("document.querySelectorAll('#rows tr[tabindex=\"0\"]').length") == 1
    page.evaluate("document.querySelector('#rows tr[tabindex=\"0\"]').focus()")
    key(page, "ArrowDown")
    assert page.evaluate("pinproof.chosen") == 2
    key(page, "Home")
    assert page.evaluate("[pinproof.chosen, document.activeElement.dataset.row]") == [0, "0"]
    key(page, "End")
    assert page.text("#verdict") == "UNREADABLE at input"


def test_the_table_sorts_and_filters_and_the_arrows_follow(page: Page) -> None:
    assert names(page) == [EVIL, "near", "wide", "away", "torn"]
    click(page, "th:nth-child(1) button")
    assert names(page) == [EVIL, "away", "near", "torn", "wide"]
    assert page.evaluate("document.querySelector('th:nth-child(1)').getAttribute('aria-sort')") == "ascending"
    click(page, "th:nth-child(4) button")
    click(page, "th:nth-child(4) button")
    clearances = page.evaluate("[...document.querySelectorAll('#rows td:nth-child(4)')].map((c) => c.textContent)")
    assert [text != "" for text in clearances] == [True, True, False, False, False]
    assert float(clearances[0].split()[0]) >= float(clearances[1].split()[0])
    click(page, ".chip[data-value=good]")
    assert set(names(page)) == {"near", "wide"}
    sizes = page.evaluate(
        "[0, 1, 2, 3].map((k) => { const m = new MeshCat.THREE.Matrix4(); pinproof.arrows.getMatrixAt(k, m);"
        " return m.determinant() > 0; })"
    )
    assert sizes == [False, True, True, False]
    page.evaluate("(() => { const f = document.getElementById('find'); f.value = 'WIDE';"
                  " f.dispatchEvent(new Event('input')); })()")  # fmt: skip
    assert names(page) == ["wide"]


def test_good_and_bad_grasps_have_their_colours(page: Page) -> None:
    page.evaluate("pinproof.choose(4)")
    red, green, blue = page.canvas().astype(int).transpose(2, 0, 1)
    assert ((green > 1.4 * red) & (green > 1.2 * blue)).sum() > 40
    assert ((red > 1.5 * green) & (red > 3 * blue)).sum() > 40


@pytest.mark.parametrize(("width", "height"), [(1200, 800), (390, 800)])
def test_content_stays_within_a_narrow_window(
    browser: Browser, pages: Callable[[str], Path], report: PickReport, width: int, height: int
) -> None:
    path = pages("widths")
    report.save(path, arm=ARM, scene=SCENE, picks=SHARED)
    opened = browser.open(path.as_uri(), width, height)
    assert opened.evaluate("document.documentElement.scrollWidth") <= width
    assert opened.canvas().std() > 10
    opened.close()


def test_the_chosen_row_is_brought_into_view_in_the_table_but_the_page_is_never_scrolled(
    browser: Browser, pages: Callable[[str], Path], report: PickReport
) -> None:
    path = pages("scrolled")
    report.save(path, arm=ARM, scene=SCENE, picks=SHARED)
    wide, narrow = browser.open(path.as_uri(), 1200, 560), browser.open(path.as_uri(), 390, 800)
    for chosen in (4, 0):
        wide.evaluate(f"pinproof.choose({chosen})")
        row, table = (
            wide.evaluate(
                f"(({{top, bottom}}) => [top, bottom])(document.querySelector('{part}').getBoundingClientRect())"
            )
            for part in ("#rows tr[aria-selected=true]", "#scroller")
        )
        assert table[0] <= row[0] + 1
        assert row[1] <= table[1] + 1
    assert wide.evaluate("document.querySelector('#scroller').scrollHeight") > table[1] - table[0]
    narrow.evaluate("pinproof.choose(4)")
    assert narrow.evaluate("window.scrollY") == 0
    assert narrow.evaluate("document.querySelector('#rows').getBoundingClientRect().bottom") > 800
    wide.close()
    narrow.close()


def test_an_empty_report_is_a_page_too(browser: Browser, pages: Callable[[str], Path]) -> None:
    path = pages("empty")
    make_report().save(path, arm=ARM, scene=SCENE, picks=SHARED)
    opened = browser.open(path.as_uri())
    assert opened.text("#none") == "No pick to show."
    assert opened.complaints == []
    opened.close()


def test_a_carried_part_moves_with_the_hand_and_stays_at_its_place(
    browser: Browser, pages: Callable[[str], Path]
) -> None:
    path, frames = pages("carried"), {"fixture": NamedFrame(pose(xyz=(0.0, -0.4, 0.1), rpy=(np.pi, 0, 0)))}
    verdicts = (
        carried("fixture"),
        replace(bad("framed", (0.0, 0.0, 0.0)), pick=Pick("framed", pose(), frame="fixture")),
    )
    report = PickReport("swing", verdicts, (), "the arm")
    report.save(path, arm=ARM, scene=standing(0.5), picks=Picks((), frames=frames))
    opened = browser.open(path.as_uri())
    assert opened.text("#verdict") == "FREE"
    steps = opened.evaluate("[...document.querySelectorAll('.steps td:nth-child(2)')].map((cell) => cell.textContent)")
    assert steps == ["transit", "retreat", "leave", "timing"]
    for moment, angle in ((0.0, 0.5), (1.5, 0.5), (3.0, 0.75), (4.0, 1.0), (5.0, 1.0), (6.0, 1.0)):
        opened.evaluate(f"pinproof.seek({moment})")
        at = opened.evaluate("pinproof.viewer.scene_tree.find(['scene', 'part']).object.position.toArray()")
        assert at == pytest.approx(root_from_part(angle)[:3, 3].tolist(), abs=1e-4)
    click(opened, "#rows tr:nth-child(2)")  # nothing to play: it stays where it was
    at = opened.evaluate("pinproof.viewer.scene_tree.find(['scene', 'part']).object.position.toArray()")
    assert at == pytest.approx(root_from_part(0.5)[:3, 3].tolist(), abs=1e-6)
    marks = np.array(opened.evaluate("Array.from(pinproof.settings.markers.poses)")).reshape(2, 4, 4)
    tip = ARM.root_from_base * ARM.forward_kinematics(np.array([0.5, 0.0]))
    assert marks[0, 3, :3] == pytest.approx(tip.translation, abs=1e-6)  # where it was really taken
    assert marks[1, 3, :3] == pytest.approx([0.0, -0.4, 0.1], abs=1e-6)  # the frame it is given in
    assert opened.complaints == []
    opened.close()


def test_fingers_that_never_touch_are_separated(
    browser: Browser, pages: Callable[[str], Path], report: PickReport
) -> None:
    path, thin = pages("fingers"), Box(0.02, 0.01, 0.06)
    fingers = GripperFingers((Obstacle("left", thin), Obstacle("right", thin)), opening=0.06, grip=0.04)
    report.save(path, arm=ARM, scene=SCENE, picks=Picks((), fingers=fingers))
    opened = browser.open(path.as_uri())
    assert opened.text("#verdict") == "NOT VALIDATED"  # it was proven without fingers
    hand = "pinproof.viewer.scene_tree.find(['open hand']).object.visible"
    assert opened.evaluate(hand) is False
    click(opened, "#rows tr:nth-child(1)")
    assert opened.evaluate(hand) is True
    for name, side in (("left", 0.03), ("right", -0.03)):
        at = opened.evaluate(f"pinproof.viewer.scene_tree.find(['open hand', '{name}']).object.position.toArray()")
        assert at == pytest.approx([0.5, side, 0.1], abs=1e-6)
    opened.close()


@dataclass
class Rows:
    """What the page asks of a campaign's result."""

    values: list[dict]
    summary: str = "of a campaign"
    acceleration_source: str = "the arm"
    notes: tuple[str, ...] = ()
    setup: None = None
    save = CampaignResult.save

    @property
    def total(self) -> int:
        return len(self.values)

    @property
    def verdicts(self) -> dict[str, int]:
        kinds = [row["verdict"] for row in self.values]
        return {kind: kinds.count(kind) for kind in kinds}

    def rows(self) -> Iterator[dict]:
        return iter(self.values)


def test_500_rows_of_a_campaign_play_nothing_and_claim_no_proof_of_the_page(
    browser: Browser, pages: Callable[[str], Path], report: PickReport
) -> None:
    lone = [verdict.to_dict() for verdict in report.verdicts]
    rows = [{**lone[k % 4], "name": f"p{k}", "xyz": [0.3, 0.01 * (k % 25), 0.02 * (k // 25)]} for k in range(500)]
    path = pages("campaign")
    Rows(rows).save(path, arm=ARM, scene=SCENE, picks=SHARED)
    opened = browser.open(path.as_uri())
    opened.evaluate("pinproof.choose(1)")
    assert opened.text("#verdict") == "GOOD"
    assert opened.evaluate("document.getElementById('player').hidden")
    assert opened.evaluate("document.querySelectorAll('#rows tr').length") == 500
    assert opened.text(".chip[data-value=good]") == "250 good"
    assert opened.complaints == []
    opened.close()


def test_a_page_with_too_many_rows_shows_the_first_and_states_it(tmp_path, monkeypatch, report: PickReport) -> None:
    monkeypatch.setattr(page_module, "MOST_ROWS", 3)
    report.save(tmp_path / "few.html", arm=ARM, scene=SCENE, picks=SHARED)
    text = (tmp_path / "few.html").read_text(encoding="utf-8")
    assert "the first 3 of 5 rows" in text
    assert "<td>wide</td>" in text
    assert "<td>away</td>" not in text


def test_a_page_with_very_many_rows_omits_stages_and_states_it(tmp_path, monkeypatch, report: PickReport) -> None:
    monkeypatch.setattr(page_module, "MOST_DETAILS", 0)
    report.save(tmp_path / "full.html", arm=ARM, scene=SCENE, picks=SHARED)
    text = (tmp_path / "full.html").read_text(encoding="utf-8")
    assert "stages and parts of 4 rows are omitted" in text
    assert text.count("<template>") == 5
    assert 'class="steps"' not in text


def test_a_proof_of_another_scene_is_not_accepted(tmp_path, report: PickReport) -> None:
    other = Scene([POST, Obstacle("late", Box(0.1, 0.1, 0.1), pose(xyz=(3, 0, 0)))])
    report.save(tmp_path / "other.html", arm=ARM, scene=other, picks=SHARED)
    text = (tmp_path / "other.html").read_text(encoding="utf-8")
    assert ">FREE<" not in text
    assert text.count(">NOT VALIDATED<") == 2


@pytest.mark.slow
def test_a_part_proven_with_other_obstacles_is_not_a_proof(tmp_path) -> None:
    late = Obstacle("late", Box(0.1, 0.1, 0.1), pose(xyz=(3, 0, 0)))
    done, more = carried(), standing(1.0).add(late)
    line = done.motions[2].trajectory
    doctored = PickMotion("leave", line, certify(line, CollisionChecker(ARM, more)), (), more)
    for verdict, headline in ((done, "FREE"), (replace(done, motions=(*done.motions[:2], doctored)), "NOT VALIDATED")):
        report = PickReport("swing", (verdict,), (), "the arm")
        report.save(tmp_path / "a.html", arm=ARM, scene=standing(0.5), picks=SHARED)
        assert f">{headline}</p>" in (tmp_path / "a.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_names_cannot_become_markup_and_the_same_report_gives_the_same_bytes(tmp_path, report: PickReport) -> None:
    texts = []
    for name in ("a.html", "b.html"):
        report.save(tmp_path / name, arm=ARM, scene=SCENE, picks=SHARED, title="<i>{{buffers}}")
        texts.append((tmp_path / name).read_text(encoding="utf-8"))
    assert texts[0] == texts[1]
    assert EVIL not in texts[0]
    assert "<h1>&lt;i&gt;{{buffers}}</h1>" in texts[0]


@pytest.mark.slow
def test_a_hundred_motions_stay_within_their_bytes() -> None:
    stage, swung = set_stage(ARM, SCENE), swing(ARM, duration=60.0)
    line = SimpleNamespace(trajectory=swung, attached=(), held={}, movers=())
    long = SimpleNamespace(motions=(line,))
    for count in (1, 100, 1000):
        motions = PageMotions.of(stage, SCENE, (), [long] * count)
        frames = sum(len(each.times) for each in motions.films if each is not None)
        shown = sum(each is not None for each in motions.films)
        assert (frames * 28 * 4 / 3 + shown * BYTES_A_LINK) * len(stage.links) <= 1.01 * MOST_BYTES
        assert len(motions.films[0].times) - 1 <= 60 * RATE
    assert "more good picks are omitted" in motions.notes[1]


def test_a_carried_part_rests_moves_with_the_tcp_and_rests() -> None:
    part = Obstacle("part", Box(0.05, 0.05, 0.05), pose(xyz=(0.0, 0.0, 0.06)))
    lines = [swing(ARM, 0.0, 0.5), swing(ARM, 0.5, 1.0), swing(ARM, 1.0, 0.2)]
    stage = set_stage(ARM, None)
    shown = film(stage, [FilmPhase(lines[0]), FilmPhase(lines[1], (part,)), FilmPhase(lines[2])], rate=10)
    place = shown.riders["part"]
    taken, left = (
        matrix(ARM.root_from_base * ARM.forward_kinematics(q) * part.pose) for q in (lines[1].start, lines[1].end)
    )
    for moment, at in zip(shown.times, place, strict=True):
        if moment <= 2.0:
            assert np.allclose(at, taken)
        elif moment >= 4.0:
            assert np.allclose(at, left)
        else:
            root_from_tcp = ARM.root_from_base * ARM.forward_kinematics(lines[1](moment - 2.0))
            assert np.allclose(at, matrix(root_from_tcp * part.pose))
    assert shown.times[-1] == 6.0
    assert (np.diff(shown.times) > 0).all()
