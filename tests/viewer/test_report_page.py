"""The page of many picks, as a file and in a real browser: table, arrows, motions, what is carried."""

from dataclasses import dataclass, replace
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
from pinproof.picks.report.page import BYTES_A_LINK, RATE, PageMotions
from pinproof.spatial import matrix, pose
from pinproof.viewer.stage import FilmPhase, film, set_stage

from .conftest import POST, assert_quiet, certified, small_arm, swing

ARM, SCENE, SHARED = small_arm(), Scene([POST]), Picks(())
EVIL = "</script><b>evil"


def good(name, end):
    motion = swing(ARM, 0.0, end)
    place = pose(xyz=(0.5 * np.cos(end), 0.5 * np.sin(end), 0.1), rpy=(np.pi, 0, 0))
    passed = (StageResult(Stage.REACH, True, "2 configurations"), StageResult(Stage.TIMING, True, "proven free"))
    motions = (PickMotion("pick", motion, certified(ARM, SCENE, motion), (), SCENE),)
    return PickVerdict(Pick(name, place), PickStatus.GOOD, passed, 2, motion.end, motion, 2.0, motions=motions)


PART = Obstacle("part", Box(0.05, 0.05, 0.05), pose(xyz=(0.08, 0.0, 0.0)))
"""In front of the tip, as it is held."""


def root_from_part(angle):
    return matrix(ARM.root_from_base * ARM.forward_kinematics(np.array([angle, 0.0])) * PART.pose)


def standing(angle):
    """The part where the tip lets go of it at an angle (rad) of the first joint."""
    return Scene([POST, replace(PART, pose=root_from_part(angle))])


def carried(frame=""):
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


def bad(name, xyz):
    stages = (StageResult(Stage.REACH, True, "1 configuration"), StageResult(Stage.GRASP, False, f"{name} hits post"))
    return PickVerdict(Pick(name, pose(xyz=xyz, rpy=(np.pi, 0, 0))), PickStatus.NOT_FOUND, stages, 1)


def make_report(*verdicts):
    return PickReport("swing", verdicts, (PickProblem(3, "torn", "xyz holds nan"),) if verdicts else (), "the arm", ())


@pytest.fixture(scope="module")
def report():
    return make_report(bad(EVIL, (0.1, 0.4, 0.3)), good("near", 0.3), good("wide", 0.8), bad("away", (50, 0, 0)))


def save(report, path, scene=SCENE, picks=SHARED, **settings):
    """Save a page and return its text."""
    report.save(path, arm=ARM, scene=scene, picks=picks, **settings)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def opened(browser, pages, report):
    save(report, pages("report"))
    opened = browser.open(pages("report").as_uri(), 1200, 800)
    yield opened
    assert_quiet(opened)


@pytest.fixture
def page(opened):
    """The page as it was opened, with the first good pick."""
    opened.evaluate("pinproof.choose(1)")
    return opened


def turned(page):
    q = page.node("robot", "upper", attribute="quaternion.toArray()")
    return float(2 * np.arctan2(q[2], q[3]))


def test_the_first_good_pick_plays_at_once_and_is_captioned_by_its_proof(opened):
    opened.wait_for("pinproof.viewer.animator.time > 0.1")
    assert opened.evaluate("pinproof.chosen") == 1
    assert opened.text("#verdict") == "FREE"
    assert opened.evaluate("getComputedStyle(document.getElementById('verdict')).backgroundColor") == "rgb(11, 122, 67)"
    assert "Proven clearance" in opened.text("#caption dl")
    assert "resampled for display at 30 poses per second" in opened.texts("#notes")[0]


def test_a_click_on_a_row_changes_the_motion_and_plays_it_again(page):
    page.seek(2)
    assert turned(page) == pytest.approx(0.3, abs=1e-4)
    before = page.canvas()
    page.click("#rows tr:nth-child(3)")
    page.seek(2)
    assert turned(page) == pytest.approx(0.8, abs=1e-4)
    assert (np.abs(page.canvas().astype(int) - before).max(axis=2) > 30).mean() > 0.01
    for _ in range(2):
        page.click("#rows tr:nth-child(3)")
        page.seek(1)
        assert turned(page) == pytest.approx(0.4, abs=1e-4)
    page.click("#rows tr:nth-child(1)")
    assert turned(page) == pytest.approx(0.0, abs=1e-6)  # nothing to play: back at rest
    assert page.evaluate("document.getElementById('player').hidden")
    assert (page.text("#verdict"), page.text("#reason")) == ("NOT FOUND at grasp", f"{EVIL} hits post")


def test_a_click_on_an_arrow_chooses_its_pick(page):
    page.settle()
    x, y = page.evaluate(
        "(() => { const v = new MeshCat.THREE.Vector3(), m = new MeshCat.THREE.Matrix4();"
        " pinproof.arrows.getMatrixAt(0, m); v.set(0, 0, -pinproof.settings.markers.length * 0.9).applyMatrix4(m);"
        " pinproof.arrows.localToWorld(v); v.project(pinproof.viewer.camera);"
        " const box = document.getElementById('meshcat-pane').getBoundingClientRect();"
        " return [box.left + (v.x + 1) / 2 * box.width, box.top + (1 - v.y) / 2 * box.height]; })()"
    )
    for kind in ("mousePressed", "mouseReleased"):
        page.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
    assert page.evaluate("pinproof.chosen") == 0
    assert page.texts("tr[aria-selected=true] td")[0] == EVIL


def test_the_keyboard_walks_the_table(page):
    assert len(page.texts('#rows tr[tabindex="0"]')) == 1
    page.evaluate("document.querySelector('#rows tr[tabindex=\"0\"]').focus()")
    page.key("ArrowDown")
    assert page.evaluate("pinproof.chosen") == 2
    page.key("Home")
    assert page.evaluate("[pinproof.chosen, document.activeElement.dataset.row]") == [0, "0"]
    page.key("End")
    assert page.text("#verdict") == "UNREADABLE at input"


def test_good_and_bad_grasps_have_their_colours(page):
    page.evaluate("pinproof.choose(4)")
    red, green, blue = page.canvas().astype(int).transpose(2, 0, 1)
    assert ((green > 1.4 * red) & (green > 1.2 * blue)).sum() > 40
    assert ((red > 1.5 * green) & (red > 3 * blue)).sum() > 40


def test_the_table_sorts_and_filters_and_the_arrows_follow(page):
    names = "#rows td:first-child"
    assert page.texts(names) == [EVIL, "near", "wide", "away", "torn"]
    page.click("th:nth-child(1) button")
    assert page.texts(names) == [EVIL, "away", "near", "torn", "wide"]
    assert page.evaluate("document.querySelector('th:nth-child(1)').getAttribute('aria-sort')") == "ascending"
    page.click("th:nth-child(4) button")
    page.click("th:nth-child(4) button")
    clearances = page.texts("#rows td:nth-child(4)")
    assert [text != "" for text in clearances] == [True, True, False, False, False]
    assert float(clearances[0].split()[0]) >= float(clearances[1].split()[0])
    page.click(".chip[data-value=good]")
    assert set(page.texts(names)) == {"near", "wide"}
    sizes = page.evaluate(
        "[0, 1, 2, 3].map((k) => { const m = new MeshCat.THREE.Matrix4(); pinproof.arrows.getMatrixAt(k, m);"
        " return m.determinant() > 0; })"
    )
    assert sizes == [False, True, True, False]
    page.evaluate("(() => { const f = document.getElementById('find'); f.value = 'WIDE';"
                  " f.dispatchEvent(new Event('input')); })()")  # fmt: skip
    assert page.texts(names) == ["wide"]


def test_the_chosen_row_is_brought_into_view_in_the_table_but_the_page_is_never_scrolled(visit, pages, report):
    save(report, pages("scrolled"))
    wide, narrow = visit("scrolled", 1200, 560), visit("scrolled", 390, 800)
    for page, width in ((wide, 1200), (narrow, 390)):  # content stays within the window
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.canvas().std() > 10
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


def test_an_empty_report_is_a_page_too(visit, pages):
    save(make_report(), pages("empty"))
    assert visit("empty").text("#none") == "No pick to show."


def test_a_carried_part_moves_with_the_hand_and_stays_at_its_place(visit, pages):
    frames = {"fixture": NamedFrame(pose(xyz=(0.0, -0.4, 0.1), rpy=(np.pi, 0, 0)))}
    framed = replace(bad("framed", (0.0, 0.0, 0.0)), pick=Pick("framed", pose(), frame="fixture"))
    report = PickReport("swing", (carried("fixture"), framed), (), "the arm")
    save(report, pages("carried"), standing(0.5), Picks((), frames=frames))
    page = visit("carried")
    assert page.text("#verdict") == "FREE"
    assert page.texts(".steps td:nth-child(2)") == ["transit", "retreat", "leave", "timing"]
    for moment, angle in ((0.0, 0.5), (1.5, 0.5), (3.0, 0.75), (4.0, 1.0), (5.0, 1.0), (6.0, 1.0)):
        page.seek(moment)
        assert page.node("scene", "part") == pytest.approx(root_from_part(angle)[:3, 3].tolist(), abs=1e-4)
    page.click("#rows tr:nth-child(2)")  # nothing to play: it stays where it was
    assert page.node("scene", "part") == pytest.approx(root_from_part(0.5)[:3, 3].tolist(), abs=1e-6)
    marks = np.array(page.evaluate("Array.from(pinproof.settings.markers.poses)")).reshape(2, 4, 4)
    tip = ARM.root_from_base * ARM.forward_kinematics(np.array([0.5, 0.0]))
    assert marks[0, 3, :3] == pytest.approx(tip.translation, abs=1e-6)  # where it was really taken
    assert marks[1, 3, :3] == pytest.approx([0.0, -0.4, 0.1], abs=1e-6)  # the frame it is given in


def test_fingers_that_never_touch_are_separated(visit, pages, report):
    thin = Box(0.02, 0.01, 0.06)
    fingers = GripperFingers((Obstacle("left", thin), Obstacle("right", thin)), opening=0.06, grip=0.04)
    save(report, pages("fingers"), picks=Picks((), fingers=fingers))
    page = visit("fingers")
    assert page.text("#verdict") == "NOT VALIDATED"  # it was proven without fingers
    assert page.node("open hand", attribute="visible") is False
    page.click("#rows tr:nth-child(1)")
    assert page.node("open hand", attribute="visible") is True
    for name, side in (("left", 0.03), ("right", -0.03)):
        assert page.node("open hand", name) == pytest.approx([0.5, side, 0.1], abs=1e-6)


@dataclass
class Rows:
    """What the page asks of a campaign's result."""

    values: list[dict]
    summary: str = "of a campaign"
    acceleration_source: str = "the arm"
    notes: tuple[str, ...] = ()
    setup: None = None
    items: str = "picks"
    save = CampaignResult.save

    @property
    def total(self):
        return len(self.values)

    @property
    def verdicts(self):
        kinds = [row["verdict"] for row in self.values]
        return {kind: kinds.count(kind) for kind in kinds}

    def rows(self):
        return iter(self.values)


def test_500_rows_of_a_campaign_play_nothing_and_claim_no_proof_of_the_page(visit, pages, report):
    lone = [verdict.to_dict() for verdict in report.verdicts]
    rows = [{**lone[k % 4], "name": f"p{k}", "xyz": [0.3, 0.01 * (k % 25), 0.02 * (k // 25)]} for k in range(500)]
    save(Rows(rows), pages("campaign"))
    page = visit("campaign")
    page.evaluate("pinproof.choose(1)")
    assert page.text("#verdict") == "GOOD"
    assert page.evaluate("document.getElementById('player').hidden")
    assert len(page.texts("#rows tr")) == 500
    assert page.text(".chip[data-value=good]") == "250 good"


def test_a_page_with_too_many_rows_omits_rows_or_stages_and_states_it(tmp_path, monkeypatch, report):
    with monkeypatch.context() as few:
        few.setattr(page_module, "MOST_ROWS", 3)
        text = save(report, tmp_path / "few.html")
    assert "the first 3 of 5 rows" in text
    assert ("<td>wide</td>" in text, "<td>away</td>" in text) == (True, False)
    monkeypatch.setattr(page_module, "MOST_DETAILS", 0)
    text = save(report, tmp_path / "full.html")
    assert "stages and parts of 4 rows are omitted" in text
    assert (text.count("<template>"), 'class="steps"' in text) == (5, False)


LATE = Obstacle("late", Box(0.1, 0.1, 0.1), pose(xyz=(3, 0, 0)))


@pytest.mark.slow
def test_a_proof_of_another_scene_or_of_a_part_with_other_obstacles_is_not_accepted(tmp_path, report):
    text = save(report, tmp_path / "other.html", Scene([POST, LATE]))
    assert (">FREE<" in text, text.count(">NOT VALIDATED<")) == (False, 2)
    done, more = carried(), standing(1.0).add(LATE)
    line = done.motions[2].trajectory
    doctored = PickMotion("leave", line, certify(line, CollisionChecker(ARM, more)), (), more)
    for verdict, headline in ((done, "FREE"), (replace(done, motions=(*done.motions[:2], doctored)), "NOT VALIDATED")):
        page = save(PickReport("swing", (verdict,), (), "the arm"), tmp_path / "a.html", standing(0.5))
        assert f">{headline}</p>" in page


@pytest.mark.slow
def test_names_cannot_become_markup_and_the_same_report_gives_the_same_bytes(tmp_path, report):
    one, other = (save(report, tmp_path / name, title="<i>{{buffers}}") for name in ("a.html", "b.html"))
    assert one == other
    assert (EVIL in one, "<h1>&lt;i&gt;{{buffers}}</h1>" in one) == (False, True)


def test_a_hundred_motions_stay_within_their_bytes(monkeypatch):
    monkeypatch.setattr(page_module, "MOST_BYTES", 5e5)
    stage, swung = set_stage(ARM, SCENE), swing(ARM, duration=60.0)
    line = SimpleNamespace(trajectory=swung, attached=(), held={}, movers=())
    for count in (1, 10, 100):
        motions = PageMotions.of(stage, SCENE, (), [SimpleNamespace(motions=(line,))] * count)
        frames = sum(len(each.times) for each in motions.films if each is not None)
        shown = sum(each is not None for each in motions.films)
        assert (frames * 28 * 4 / 3 + shown * BYTES_A_LINK) * len(stage.links) <= 1.01 * 5e5
        assert len(motions.films[0].times) - 1 <= 60 * RATE
    assert "more good picks are omitted" in motions.notes[1]


def test_a_carried_part_rests_moves_with_the_tcp_and_rests():
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
