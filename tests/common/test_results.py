"""Results: a ``repr`` of at most ten lines, small HTML that is complete and escaped, and solutions or their failure."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from dataclasses import dataclass, replace
from html.parser import HTMLParser

import numpy as np
import pytest

import pinproof as pp
from pinproof.common.results import MOST_LINES, MOST_ROWS, Answer, Rows, Solution, html_plot, markdown, outline
from pinproof.description import robots_folder
from pinproof.errors import NoAnswer, PlanFailed
from pinproof.picks.judging.verdict import PickStatus, Stage, StageResult

HOSTILE = '<script>alert("x")</script> & <b>'


class Parsed(HTMLParser):
    """The text and the tags of a page; ``balanced`` is False if tags are not closed in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.words: list[str] = []
        self.balanced, self._open = True, []
        self.feed(html)
        self.close()
        self.balanced = self.balanced and not self._open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self._open.append(tag)

    def handle_endtag(self, tag):
        if not self._open or self._open.pop() != tag:
            self.balanced = False

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(self.words)


@pytest.fixture(scope="module")
def ur5() -> dict[str, object]:
    """Values of every kind that a first session displays."""
    folder = robots_folder() / "ur5"
    robot = pp.load_robot("ur5")
    arm, scene, picks = robot.arm(), pp.Scene.load(folder / "scene.yaml"), pp.read_picks(folder / "picks.yaml")
    checker = pp.CollisionChecker(arm, scene)
    goal = arm.home + 0.3
    path = pp.JointPath([arm.home, goal], arm.joint_names)
    trajectory = pp.time_parametrise(path, arm.limits)
    wall = pp.Obstacle("wall", pp.Sphere(0.03), arm.forward_kinematics(arm.home))
    blocked = pp.CollisionChecker(arm, pp.Scene([wall]))
    plan = pp.RrtConnect().plan(checker, arm.home, [goal], rng=0)
    line = arm.forward_kinematics_batch(path(np.linspace(0, 1, 20)))
    monitor = pp.Monitor(checker, trajectory, joint_tolerance=0.005)
    library = pp.MotionLibrary(checker).add("short", trajectory)
    return {
        "monitor": monitor,
        "tick": monitor.update(0.1, trajectory(0.1) + 0.1 * np.eye(6)[0], np.zeros(6)),
        "library": library,
        "repair": library.repair("short"),
        "stored": library["short"],
        "optimised": pp.optimise(path, checker, rng=0, budget=2),
        "linear": pp.plan_linear(checker, goal, arm.forward_kinematics(goal) * pp.pose((0, 0, -0.01))),
        "simplified": pp.simplify(path, checker, rng=0),
        "audit": pp.audit(trajectory, checker, step=0.2),
        "exported": pp.collision.export_program(trajectory, checker, "urscript")[1],
        "tracked": pp.track(arm, line, arm.home, times=np.arange(20.0)),
        "free": checker.check(arm.home),
        "colliding": blocked.check(arm.home),
        "pick": picks.picks[0],
        "plan": plan,
        "blocked": pp.RrtConnect().plan(blocked, arm.home, [goal], rng=0),
        "robot": robot,
        "arm": arm,
        "scene": scene,
        "picks": picks,
        "checker": checker,
        "info": robot.info(arm),
        "limits": arm.limits,
        "path": path,
        "trajectory": trajectory,
        "certificate": pp.certify(trajectory, checker),
        "branches": pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(goal)),
        "result": pp.Clik().solve(arm, arm.forward_kinematics(goal)),
        "batch": pp.Clik().solve_batch(arm, arm.forward_kinematics_batch(np.tile(arm.home, (50, 1)))),
        "table": pp.DhTable.load(robots_folder() / "puma560" / "dh.yaml"),
        "screened": pp.screen_picks(arm, scene, picks),
    }


@pytest.fixture(scope="module")
def hundred(ur5) -> pp.picks.PickReport:
    """A report of 100 picks that states its verdicts, one of them with a hostile name and reason."""
    pick = ur5["picks"].picks[0]
    failed = (StageResult(Stage.INPUT, True, "valid"), StageResult(Stage.REACH, False, f"out of reach {HOSTILE}"))
    verdicts = tuple(
        pp.picks.PickVerdict(replace(pick, name=f"bolt {HOSTILE if k == 7 else k}"), PickStatus.NOT_FOUND, failed)
        for k in range(100)
    )
    return pp.picks.PickReport("ur5", verdicts, (), "default: a guess")


def test_every_repr_has_at_most_ten_lines(ur5, hundred) -> None:
    values = {**ur5, "report": hundred, "verdict": hundred.verdicts[0]}
    assert {name: repr(value).count("\n") + 1 for name, value in values.items() if repr(value).count("\n") > 9} == {}
    assert {name: len(repr(value)) for name, value in values.items() if len(repr(value)) > 1700} == {}
    assert all(type(value).__name__ in repr(value) for value in values.values())


def test_repr_of_a_long_report_states_its_summary_and_the_picks_left_out(hundred) -> None:
    lines = repr(hundred).splitlines()
    assert len(lines) == MOST_LINES
    assert "0 of 100 picks good" in lines[0]
    assert "92 more" in lines[-1]
    assert "bolt 0" in lines[1]
    assert "reach" in lines[1]


def test_repr_of_a_good_report_states_clearance_and_duration(ur5) -> None:
    picks = replace(ur5["picks"], picks=ur5["picks"].picks[:1])
    report = pp.validate_picks(ur5["arm"], ur5["scene"], picks)
    verdict = report.good[0]
    for value in (report, verdict):
        assert f"{verdict.trajectory.duration:.2f} s" in repr(value)
        assert f"{np.floor(verdict.clearance * 1e4) / 10:.1f} mm" in repr(value)
        assert repr(value).count("\n") < MOST_LINES


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        ("trajectory", ("shoulder_pan_joint", "Trajectory", "largest velocity", "rad or m over")),
        ("path", ("wrist_3_joint", "2 waypoints")),
        ("table", ("standard", "joint_1", "alpha")),
        ("info", ("elbow_joint", "tool0", "revolute", "Acceleration limits")),
        ("branches", ("8 branches", "position error", "elbow_joint")),
        ("scene", ("bin_near", "Box", "roll")),
        ("picks", ("bolt_1", "approach")),
        ("certificate", ("FREE", "not checked")),
        ("robot", ("elbow_joint", "revolute", "tool0")),
        ("arm", ("elbow_joint", "upper", "home", "3.15")),
        ("result", ("found", "q6")),
        ("free", ("free",)),
        ("colliding", ("2 contacts", "wall", "distance [mm]")),
        ("pick", ("bolt_1", "approach", "yaw")),
        ("plan", ("FOUND", "nodes", "waypoints")),
        ("blocked", ("START_INVALID", "penetrates wall")),
        ("checker", ("base_link", "checked pairs", "excluded pair")),
        ("limits", ("velocity", "acceleration:", "3.15")),
        ("batch", ("50 targets", "elbow_joint", "position error [m]")),
        ("screened", ("screened", "bolt_1", "reason")),
        ("tracked", ("elbow_joint", "rad or m over")),
        ("optimised", ("Trajectory", "FREE")),
        ("linear", ("CubicPath", "FREE")),
        ("simplified", ("FREE",)),
        ("audit", ("samples",)),
        ("exported", ("clearance [mm]", "FREE")),
        ("monitor", ("tube of 0.005", "elbow_joint")),
        ("tick", ("outside the certified tube", "waypoint")),
        ("library", ("short", "FREE", "1 motion of ur5")),
        ("stored", ("short", "FREE", "largest velocity")),
        ("repair", ("nothing was replaced",)),
    ],
)
def test_html_of_a_value_is_complete_and_states_its_figures(ur5, name, facts) -> None:
    value = ur5[name]
    page = Parsed(value._repr_html_())
    assert page.balanced

    assert [fact for fact in facts if fact not in page.text] == []
    assert len(value._repr_html_()) < 40_000
    assert not {"script", "link", "img", "style"}.intersection(page.tags)


def test_html_of_a_table_of_joints_has_the_numbers_of_the_trajectory(ur5) -> None:
    trajectory = ur5["trajectory"]
    text = Parsed(trajectory._repr_html_()).text
    for value in (*trajectory.q[-1], *trajectory.max_velocity()):
        assert f"{value:.6g}" in text


def test_html_of_a_report_escapes_names_and_reasons(hundred) -> None:
    page = Parsed(hundred._repr_html_())
    assert page.balanced
    assert "script" not in page.tags
    assert "b" not in page.tags
    assert page.text.count(HOSTILE) == 101
    assert "guessed acceleration limits: a guess" in page.text
    assert page.tags.count("tr") == 101
    assert len(hundred._repr_html_()) < 100_000


def test_html_of_a_verdict_has_every_stage_and_escapes_it(hundred) -> None:
    page = Parsed(hundred.verdicts[7]._repr_html_())
    assert page.balanced
    assert "script" not in page.tags
    assert all(word in page.text for word in ("NOT FOUND at reach", "passed", "failed", HOSTILE))


def test_table_states_the_rows_that_it_leaves_out() -> None:
    page = Parsed(Rows(("number",), ([k] for k in range(1000)), 1000).html())
    assert page.tags.count("tr") == MOST_ROWS + 1
    assert "900 more rows" in page.text


def test_bars_and_line_ends_in_cells_do_not_break_a_markdown_table() -> None:
    table = Rows(("pick", "time"), [("a|b", 0.25), ("two\nlines", None)], numbers={"time"})
    assert markdown("# Picks", table, [], ["a note"]) == (
        "# Picks\n\n| pick | time |\n| --- | ---: |\n| a\\|b | 0.25 |\n| two lines |  |\n\n- a note\n"
    )


def test_plot_of_a_motion_without_duration_is_finite() -> None:
    html = html_plot([0.0], {HOSTILE: [1.0]}, "rad")
    assert Parsed(html).balanced
    assert "nan" not in html
    assert HOSTILE in Parsed(html).text


def test_outline_shortens_long_lines() -> None:
    assert max(map(len, outline("x" * 1000, ["y" * 1000] * 3).splitlines())) <= 170


def test_live_view_displays_as_a_frame_of_its_page_and_its_snapshot_as_a_complete_page(ur5) -> None:
    with pp.show(ur5["arm"]) as view:
        frame = Parsed(view._repr_html_())
        assert frame.balanced
        assert "iframe" in frame.tags
        assert f'src="{view.url}"' in view._repr_html_()
        snapshot = view.snapshot()
    frames: list[dict[str, str]] = []
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, attrs: frames.append(dict(attrs)) if tag == "iframe" else None
    parser.feed(snapshot._repr_html_())
    assert frames[0]["srcdoc"] == snapshot.text
    assert "<canvas" in snapshot.text or "meshcat-pane" in snapshot.text
    assert len(repr(snapshot)) < 100
    assert "iframe" not in view._repr_html_()  # closed


@pytest.mark.slow
def test_displaying_a_value_does_not_import_ipython() -> None:
    code = (
        "import sys, pinproof as pp; a = pp.load_robot('ur5').arm(); v = pp.show(a); v._repr_html_(); "
        "print('IPython' in sys.modules); v.close()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@dataclass(frozen=True, eq=False)
class _Root(Answer):
    failure = PlanFailed
    ok: bool
    value: Solution[float] = Solution()
    bound: Solution[float] = Solution()
    message: str = ""


def test_a_solution_is_read_and_returned() -> None:
    root = _Root(True, 2.0, message="found")
    for made in (root, pickle.loads(pickle.dumps(root)), copy.copy(root)):
        assert made.or_raise() is made
        assert (made.value, made.message) == (2.0, "found")
    with pytest.raises(PlanFailed, match="no bound"):
        root.bound  # noqa: B018
    with pytest.raises(AttributeError):
        root.value = 3.0  # type: ignore[misc]


def test_a_failure_raises_its_message_where_a_solution_is_read() -> None:
    failed = _Root(False, message="no root")
    for answer in (failed.or_raise, lambda: failed.value, lambda: failed.bound):
        with pytest.raises(NoAnswer, match="no root") as caught:
            answer()
        assert type(caught.value) is PlanFailed
        assert caught.value.result is failed


def test_a_changed_answer_keeps_all_other_values() -> None:
    failed = _Root(False, message="no root")
    changed = failed.changed(message="stopped", bound=1.0)
    assert (changed.ok, changed.bound, changed.message, failed.message) == (False, 1.0, "stopped", "no root")
    with pytest.raises(PlanFailed, match="stopped"):
        changed.value  # noqa: B018
