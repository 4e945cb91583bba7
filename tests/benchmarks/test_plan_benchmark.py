"""A small run of the planning benchmark: rows, columns, and the independent check, which finds unsafe motions."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.planning import limit_excess, motion_benchmark, motion_blocks, pose_goals
from benchmarks.planning_methods import OURS, PEERS, STEPS, PlanAnswer, PlanMethod
from benchmarks.planning_problems import OWN_SCENES, PlanProblem, own_problems
from benchmarks.planning_run import (
    curve_length,
    figures,
    introduction,
    methods_of,
    motion_faults,
    name_of,
    plan_benchmark,
    plan_tables,
    time_plot,
)
from benchmarks.tables import Results, Row
from benchmarks.worker_peers import mplib_method

import pinproof as pp
from pinproof.errors import InputError
from pinproof.motion import JointPath

OMPL = "benchmarks.ompl_adapter:OmplPlanner"


@pytest.fixture(scope="module")
def table() -> Results:
    return plan_benchmark(["generic_6dof"], problems=1, peers=False, repeats=2)


def other(row: Row, **values: Any) -> Row:
    """A row with other values."""
    return Row(**{**vars(row), **values})


@pytest.fixture(scope="module")
def problem() -> PlanProblem:
    (made,) = own_problems("generic_6dof", "narrow_slot", 1)
    return made


@pytest.fixture(scope="module")
def exact(problem: PlanProblem) -> pp.CollisionChecker:
    return pp.CollisionChecker(problem.arm, problem.scene, link_meshes="surface")


def straight(problem: PlanProblem, *through: np.ndarray) -> JointPath:
    return JointPath([problem.start, *through, problem.goals[0]], problem.arm.joint_names)


@pytest.mark.slow
def test_every_own_scene_is_solved_certified_and_safe(table: Results) -> None:
    assert [row.set_name for row in table["problems"]] == list(OWN_SCENES)
    assert [(row.solved, row.certified, row.faults) for row in table["rows"]] == [(True, True, ())] * len(OWN_SCENES)
    assert table.faults == []
    assert table["left_out"] == {}


@pytest.mark.slow
def test_rows_are_complete_and_the_same_seed_gives_the_same_motion(table: Results) -> None:
    for row in table["rows"]:
        assert set(row.ms) == set(STEPS)
        assert min(row.ms.values()) > 0
        assert row.length > 0
        assert row.duration > 0
        assert row.clearance > 0
        assert row.rejected_edges >= 0
        assert row.repeatable is True


def test_figures_summarise_the_rows(table: Results) -> None:
    cells = figures(table, "pinproof", collection="generic_6dof")
    totals = [sum(row.ms.values()) for row in table["rows"]]
    assert (cells["solved"], cells["certified"], cells["unsafe"]) == ("5 of 5", "5", "0")
    median, _, largest = map(float, cells["total"].split(" / "))
    assert median == pytest.approx(np.median(totals), rel=0.1)
    assert largest == pytest.approx(max(totals), rel=0.1)
    assert cells["clearance, mm"] == f"{1e3 * min(row.clearance for row in table['rows']):.2g}"
    assert figures(table, "pinproof", collection="generic_6dof", set_name="cage")["solved"] == "1 of 1"
    assert figures(table, "nobody") == {}


def test_lengths_are_compared_on_problems_that_both_solved(table: Results) -> None:
    theirs = [other(row, method="peer", label="peer", length=row.length / 2) for row in table["rows"]]
    theirs[0] = other(theirs[0], solved=False, length=None)
    both = Results({}, {}, {"rows": [*table["rows"], *theirs]})
    assert figures(both, "peer")["length ratio"] == "2.000"
    assert figures(both, "pinproof")["length ratio"] == ""


def test_there_is_a_section_for_each_set_with_all_columns(table: Results) -> None:
    lines = plan_tables(table)
    assert {"## generic_6dof", "### all sets", *(f"### {scene}" for scene in OWN_SCENES)} <= set(lines)
    header = next(line for line in lines if line.startswith("| method"))
    columns = figures(table, "pinproof")
    assert header == f"| {' | '.join(name for name in columns if name != 'length ratio')} |"
    page = "\n".join(lines)
    assert "| pinproof | 5 of 5 | 5 | 0 |" in page
    assert "Two open bins" in page
    assert "2 times, of which the fastest counts; equal seeds gave equal motions" in " ".join(introduction(table))
    assert time_plot(table).axes


def test_the_page_lists_failures_and_faults(table: Results) -> None:
    unsolved = other(table["rows"][0], solved=False, message="no path within a budget")
    unsafe = other(table["rows"][1], faults=["link_6 touches post at 50.0 % of the motion"])
    touching = other(
        table["problems"][2], mesh_faults=["goal: link_6 penetrates can (-2.0 mm)"], hull_faults=["goal: the same"]
    )
    by_hull = other(table["problems"][3], hull_faults=["start: link_3 is near board (0.0 mm)"])
    problems = [*table["problems"][:2], touching, by_hull]
    parts = {"rows": [unsolved, unsafe], "problems": problems, "left_out": {"x": "why"}}
    page = "\n".join(plan_tables(Results(table.settings, {}, parts)))
    assert f"- {name_of(unsolved)}: no path within a budget" in page
    assert f"- {name_of(unsafe)}: link_6 touches post at 50.0 % of the motion" in page
    assert f"- {name_of(touching)}: goal: link_6 penetrates can (-2.0 mm)" in page
    assert f"- {name_of(by_hull)}: start: link_3 is near board (0.0 mm)" in page
    prose = " ".join(page.split())
    assert "outside the limits: 1;" in prose
    assert "convex hulls only: 1." in prose
    assert "- x: why" in page


def test_problems_with_a_colliding_goal_are_listed_and_not_solved(mbm: Path) -> None:
    table = plan_benchmark([], mbm=mbm, peers=False)
    first, second = table["problems"]
    assert (first.hull_faults, first.mesh_faults) == ((), ())
    assert "penetrates box" in second.mesh_faults[0]
    assert [row.number for row in table["rows"]] == [1]
    assert table.settings["mbm"] is True


# -- the check ---------------------------------------------------------------------------------------------------------


def test_the_check_finds_a_motion_through_a_wall(problem: PlanProblem, exact: pp.CollisionChecker) -> None:
    assert any(" touches " in fault for fault in motion_faults(straight(problem), problem, exact))


def test_the_check_finds_wrong_ends_and_violated_limits(problem: PlanProblem, exact: pp.CollisionChecker) -> None:
    elsewhere = JointPath([problem.start + 1e-3, problem.start], problem.arm.joint_names)
    assert motion_faults(elsewhere, problem, exact)[:2] == (
        "does not begin at the start",
        "does not end at a goal",
    )
    far = problem.start.copy()
    far[0] = problem.arm.limits.upper[0] + 0.1
    beyond = motion_faults(straight(problem, far), problem, exact)
    assert "joint_1 is 0.1 outside its limits" in beyond


def test_the_length_of_a_timed_motion_is_that_of_its_path(problem: PlanProblem) -> None:
    path = straight(problem, problem.start + 0.3)
    timed = pp.time_parametrise(path, problem.arm.limits)
    assert curve_length(path) == path.length
    assert curve_length(straight(problem)) == pytest.approx(np.linalg.norm(problem.goals[0] - problem.start))
    assert curve_length(timed) == pytest.approx(path.length, rel=1e-9)


def test_an_unsafe_motion_of_our_planner_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    def through(problem: PlanProblem, checker: pp.CollisionChecker):
        return lambda seed: PlanAnswer(straight(problem), {"plan": 1.0}, certified=True, clearance=0.1)

    monkeypatch.setattr("benchmarks.planning_run.own_method", lambda name: PlanMethod(OURS, OURS, through))
    table = plan_benchmark(["generic_6dof"], sets=["narrow_slot"], problems=1, peers=False)
    assert all(text.startswith("generic_6dof/narrow_slot/1: ") for text in table.faults)
    assert table.faults
    assert "## Unsafe: pinproof" in plan_tables(table)


def test_another_planner_is_a_method_of_its_own() -> None:
    pytest.importorskip("ompl")
    table = plan_benchmark(["generic_6dof"], sets=["shelf"], problems=1, planners=["rrt_connect", OMPL], peers=False)
    assert [(row.method, row.certified, row.faults) for row in table["rows"]] == [
        ("pinproof", True, ()),
        (f"pinproof_{OMPL}", True, ()),
    ]


# -- peers -------------------------------------------------------------------------------------------------------------


def test_missing_peers_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("roboplan", "roboplan.core", "roboplan.rrt", "ompl"):
        monkeypatch.setitem(sys.modules, name, None)
    table = plan_benchmark(["generic_6dof"], sets=["shelf"], problems=1)
    assert methods_of(table) == ("pinproof",)
    assert set(table["left_out"]) == {peer.key for peer in PEERS}
    assert "not installed" in "\n".join(plan_tables(table))


def test_installed_peers_are_checked_too() -> None:
    pytest.importorskip("roboplan.rrt")
    table = plan_benchmark(["generic_6dof"], sets=["shelf"], problems=1)
    for peer in PEERS:
        if peer.key == "ompl":
            continue  # below
        cells = figures(table, peer.key)
        assert cells["solved"] == "1 of 1"
        assert cells["certified"] == ""
        assert float(cells["length ratio"]) > 0


def test_ompl_with_coal_solves_a_problem_from_start_to_goal(exact: pp.CollisionChecker) -> None:
    pytest.importorskip("ompl")
    (easy,) = own_problems("generic_6dof", "shelf", 1)
    (peer,) = [each for each in PEERS if each.key == "ompl"]
    answer = peer.prepare(easy, pp.CollisionChecker(easy.arm, easy.scene))(0)
    assert answer.curve is not None
    assert set(answer.ms) == {"plan", "simplify"}
    at_ends = [answer.curve(answer.curve.domain[0]), answer.curve(answer.curve.domain[1])]
    np.testing.assert_allclose(at_ends, [easy.start, easy.goals[0]], atol=1e-12)


FAKE_MPLIB = """
import numpy as np
class Pose:
    def __init__(self, matrix): assert matrix.shape == (4, 4)
def set_global_seed(seed): assert seed == 0
class Any:
    def __getattr__(self, name): return lambda *given: None
class Planner:
    def __init__(self, urdf, srdf, move_group):
        from xml.etree import ElementTree
        limits = [j.find("limit") for j in ElementTree.parse(urdf).iter("joint") if j.find("limit") is not None]
        assert all(float(l.get("upper")) - float(l.get("lower")) < 6.29 for l in limits)
        assert move_group in open(srdf).read()
        self.user_joint_names = [f"joint_{k}" for k in (2, 1, 3, 4, 5, 6)]
        self.move_group_joint_indices = list(range(6))
        self.planning_world = self.acm = self.robot = Any()
        self.planner = self
    def plan(self, start, goals, **settings):
        print("MPlib prints to standard output")
        return "Exact solution", np.array([start, start, goals[0]])
"""


@pytest.mark.slow
def test_mplib_runs_in_the_python_that_has_it_with_joints_in_its_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mplib").mkdir()
    (tmp_path / "mplib" / "__init__.py").write_text(FAKE_MPLIB, encoding="utf-8")
    shapes = "class Box:\n    def __init__(self, *sizes): pass\nCylinder = Sphere = CollisionObject = Box\n"
    (tmp_path / "mplib" / "collision_detection.py").write_text(
        f"class fcl:\n    {shapes.replace(chr(10), chr(10) + '    ')}", encoding="utf-8"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (easy,) = own_problems("generic_6dof", "shelf", 1)
    answer = mplib_method(sys.executable).prepare(easy, pp.CollisionChecker(easy.arm, easy.scene))(0)
    assert answer.curve is not None
    np.testing.assert_array_equal(answer.curve.q, [easy.start, easy.goals[0]])


def test_an_error_of_a_peer_does_not_end_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(problem: PlanProblem, checker: pp.CollisionChecker):
        raise ZeroDivisionError("theirs")

    monkeypatch.setattr("benchmarks.planning_run.PEERS", (PlanMethod("peer", "peer", broken, "numpy"),))
    table = plan_benchmark(["generic_6dof"], sets=["shelf"], problems=1)
    assert table["left_out"] == {"peer on generic_6dof/shelf/1": "ZeroDivisionError: theirs"}


@pytest.mark.parametrize("wrong", [{"problems": 0}, {"repeats": 0}, {"sets": ["poetry"]}, {"planners": ["poetry"]}])
def test_invalid_settings_are_refused(wrong: dict) -> None:
    with pytest.raises(InputError):
        plan_benchmark(["generic_6dof"], **wrong)


def test_a_scene_without_a_problem_is_left_out_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.planning_problems.SCENES", 0)
    table = plan_benchmark(["generic_6dof"], sets=["shelf"], problems=1, peers=False)
    assert "no start and goal for 'generic_6dof'" in table["left_out"]["generic_6dof/shelf"]
    assert any("no start and goal" in line for line in plan_tables(table))


# The motion benchmark: every row is checked independently, and the page shows the stored figures.


@pytest.mark.slow
def test_motions_are_certified_checked_and_shown(mbm: Path) -> None:
    table = motion_benchmark(mbm, problems=1)
    assert {row.variant for row in table["rows"]} == {"", "3 kg"}
    free = next(row for row in table["rows"] if not row.variant)
    assert free.certified
    assert free.faults == ()
    assert free.goals > 1
    assert free.lower_bound <= free.duration <= free.before
    assert free.excess <= 1e-9
    assert set(free.ms) == {"goals", "plan", "optimise"}
    assert motion_blocks(table)["no load"][2].startswith("| all sets | 1 of 1 | 0 |")


def test_every_goal_has_the_pose_and_is_free() -> None:
    arm = pp.load_robot("panda").arm()
    checker = pp.CollisionChecker(arm)
    pose = arm.forward_kinematics(arm.home)
    goals = pose_goals(checker, pose, arm.home)
    assert len(goals) > 5
    assert checker.is_free_batch(goals).all()
    assert np.abs(arm.forward_kinematics_batch(goals) - pose.homogeneous).max() < 1e-5


def test_a_limit_that_is_exceeded_is_found() -> None:
    arm = pp.load_robot("panda").arm()
    path = pp.JointPath([arm.home, arm.home + 0.1], arm.joint_names)
    limits = replace(arm.limits, acceleration=np.full(arm.dof, 5.0))
    trajectory = pp.time_parametrise(path, limits, jerk=100.0)
    assert limit_excess(trajectory, limits, 100.0) <= 1e-9
    assert limit_excess(trajectory, limits, 50.0) == pytest.approx(1.0)
