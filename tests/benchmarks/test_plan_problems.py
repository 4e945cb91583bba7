"""Problems in our scenes are reproducible, have free starts and goals, and are not solved by a straight line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.planning_problems import (
    MARGIN,
    OWN_ROBOTS,
    OWN_SCENES,
    PlanProblem,
    end_faults,
    find_sets,
    own_problems,
    own_reach,
    read_problems,
    select_sets,
)
from benchmarks.tables import NotApplicableError

import pinproof as pp
from pinproof.errors import FileError, UnknownNameError
from pinproof.motion import JointPath

FEW = [("ur5", "narrow_slot"), ("panda", "cage"), ("generic_6dof", "bin")]


def same(a: PlanProblem, b: PlanProblem) -> bool:
    ends = np.array_equal(a.start, b.start) and np.array_equal(a.goals, b.goals)
    return a.name == b.name and ends and a.scene.is_close(b.scene, 0.0)


@pytest.mark.parametrize(("robot", "scene"), FEW)
@pytest.mark.slow
def test_a_problem_depends_only_on_the_seed_and_its_number(robot: str, scene: str) -> None:
    one, two = list(own_problems(robot, scene, 1)), list(own_problems(robot, scene, 2))
    assert same(one[0], two[0])
    assert not same(two[0], two[1])
    assert not same(one[0], next(own_problems(robot, scene, 1, seed=1)))


@pytest.mark.parametrize("scene", OWN_SCENES)
@pytest.mark.parametrize("robot", OWN_ROBOTS)
def test_start_and_goal_are_free_and_their_straight_connection_collides(robot: str, scene: str) -> None:
    (problem,) = own_problems(robot, scene, 1)
    hulls = pp.CollisionChecker(problem.arm, problem.scene)
    assert hulls.clearance(problem.start) >= MARGIN
    assert hulls.clearance(problem.goals[0]) >= MARGIN
    assert problem.arm.limits.violations(problem.start, problem.arm.joint_names) == []
    assert problem.arm.limits.violations(problem.goals[0], problem.arm.joint_names) == []
    straight = JointPath([problem.start, problem.goals[0]], problem.arm.joint_names)
    assert pp.certify(straight, hulls).status.name == "COLLIDING"


def test_colliding_goals_are_reported_with_the_bodies() -> None:
    (problem,) = own_problems("generic_6dof", "table_top", 1)
    checker = pp.CollisionChecker(problem.arm, problem.scene, link_meshes="surface")
    assert end_faults(problem, checker) == ()
    at = problem.arm.forward_kinematics(problem.goals[0]).translation
    blocked = problem.scene.add(pp.Obstacle("block", pp.Sphere(0.05), pp.pose(at)))
    (fault,) = end_faults(problem, checker.with_scene(blocked))
    assert fault.startswith("goal: ")
    assert "penetrates block" in fault


def test_the_reach_agrees_with_the_data_sheet() -> None:
    arm = pp.load_robot("ur5").arm()
    assert 0.7 < own_reach(arm) < 0.95  # the data sheet states 0.85 m


def test_sets_are_selected_by_any_part_of_their_name() -> None:
    sets = ["mbm/cage", "ur5/cage", "ur5/shelf"]
    assert select_sets(sets, ()) == sets
    assert select_sets(sets, ("cage",)) == ["mbm/cage", "ur5/cage"]
    assert select_sets(sets, ("ur5/cage", "mbm")) == ["mbm/cage", "ur5/cage"]
    with pytest.raises(UnknownNameError, match="shelf"):
        select_sets(sets, ("shelve",))


def test_a_plan_with_a_small_clearance_is_proven_after_timing() -> None:
    """The path keeps 13 um more than the margin; the trajectory is divided into other segments."""
    *_, problem = own_problems("generic_6dof", "cage", 4)
    checker = pp.CollisionChecker(problem.arm, problem.scene)
    plan = pp.RrtConnect().plan(checker, problem.start, problem.goals, rng=0)
    simple = pp.simplify(plan.path, plan.checker or checker, rng=0)
    samples = simple.path(np.linspace(*simple.path.domain, 20_000))
    margin = float(checker.clearance_batch(samples).min()) - 13e-6
    tight = pp.CollisionChecker(problem.arm, problem.scene, margin=margin)
    assert pp.certify(simple.path, tight).free
    trajectory = pp.time_parametrise(simple.path, problem.arm.limits)
    certificate = pp.certify(trajectory, tight)
    assert certificate.free, certificate.message
    assert 0 < certificate.observed - margin < 1e-4
    samples = trajectory(np.linspace(0, trajectory.duration, 2000))
    assert all(checker.is_free_batch(samples))


# MotionBenchMaker files are read in both layouts, and problems that do not fit the robot are refused.


URDF = """<robot name="slider"><link name="base"/><link name="tool"/>
<joint name="panda_joint1" type="prismatic"><parent link="base"/><child link="tool"/>
<axis xyz="1 0 0"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint></robot>"""


def test_both_layouts_name_the_set_and_the_robot(mbm: Path) -> None:
    (found,) = find_sets(mbm)
    assert (found.full_set, tuple(found.files), found.robot) == ("mbm/box", (1, 2), "panda")


def test_the_path_may_be_a_single_set(mbm: Path) -> None:
    (inner,) = mbm.iterdir()
    (found,) = find_sets(inner)
    assert found.name == "box"


def test_start_and_goal_are_in_the_joint_order_of_the_arm(mbm: Path, mbm_files: SimpleNamespace) -> None:
    first, second = read_problems(find_sets(mbm)[0])
    assert (first.name, second.name) == ("mbm/box/1", "mbm/box/2")
    np.testing.assert_array_equal(first.start, mbm_files.start)
    np.testing.assert_array_equal(first.goals, [mbm_files.goal])
    assert first.scene.names == ("box",)
    np.testing.assert_allclose(first.scene["box"].pose.translation, [0.45, 0.2, 0.1])


def test_only_the_first_problems_are_read(mbm: Path) -> None:
    assert [problem.number for problem in read_problems(find_sets(mbm)[0], 1)] == [1]


def test_fingers_are_held_at_the_start_state(mbm: Path) -> None:
    problem = next(read_problems(find_sets(mbm)[0]))
    assert problem.arm.held["panda_finger_joint1"] == 0.03
    assert problem.notes == ()


def test_fingers_beyond_their_limit_are_held_at_it_with_a_note(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    mbm_files.write(tmp_path / "box_panda", 1, mbm_files.request(finger=0.065), [1, 1, 1])
    (problem,) = read_problems(find_sets(tmp_path)[0])
    assert problem.arm.held["panda_finger_joint1"] == 0.04
    assert "0.04" in problem.notes[0]
    assert "0.065" in problem.notes[0]


def test_values_outside_their_limits_by_rounding_are_clipped(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    upper = float(pp.load_robot("panda").arm().limits.upper[0])
    start = [upper + 5e-5, *mbm_files.start[1:]]
    goal = [upper + 5e-3, *mbm_files.goal[1:]]
    mbm_files.write(tmp_path / "box_panda", 1, mbm_files.request(start, goal), [1, 1, 1])
    (problem,) = read_problems(find_sets(tmp_path)[0])
    assert problem.start[0] == upper
    assert problem.goals[0, 0] == goal[0]


def test_several_goals_are_all_read(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    request = mbm_files.request()
    request["goal_constraints"] += mbm_files.request(goal=mbm_files.start)["goal_constraints"]
    mbm_files.write(tmp_path / "box_panda", 1, request, [1, 1, 1])
    (problem,) = read_problems(find_sets(tmp_path)[0])
    np.testing.assert_array_equal(problem.goals, [mbm_files.goal, mbm_files.start])


def test_a_named_robot_precedes_the_urdf_beside_the_sets(mbm: Path) -> None:
    (mbm / "robot").mkdir()
    (mbm / "robot" / "slider.urdf").write_text(URDF, encoding="utf-8")
    assert find_sets(mbm)[0].robot.endswith("slider.urdf")
    assert find_sets(mbm, "panda")[0].robot == "panda"
    with pytest.raises(FileError, match=r"panda_joint2, .*'slider'"):
        next(read_problems(find_sets(mbm)[0]))


def test_without_a_known_group_the_arm_ends_at_the_last_joint_of_the_goal(mbm: Path) -> None:
    problem = next(read_problems(find_sets(mbm)[0]))  # the catalogue's SRDF calls the group "arm"
    assert problem.arm.tcp == "panda_link7"


def test_a_robot_with_other_joints_is_refused(mbm: Path) -> None:
    with pytest.raises(FileError, match=r"panda_joint1, .*'ur5'"):
        next(read_problems(find_sets(mbm, "ur5")[0]))


MOVED = {"transforms": [{"translation": [0, 0, 1], "rotation": [0, 0, 0, 1]}]}


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda request: request.update(goal_constraints=[]), "goal_constraints"),
        (lambda request: request.update(goal_constraints=[{"position_constraints": [{}]}]), "position_constraints"),
        (lambda request: request.update(goal_constraints=3), "MotionPlanRequest"),
        (lambda request: request["goal_constraints"][0]["joint_constraints"].pop(), "goal_constraints: .*panda_joint1"),
        (lambda request: request["start_state"].update(joint_state={"name": ["a"], "position": []}), "MotionPlanReq"),
        (lambda request: request["start_state"].update(multi_dof_joint_state=MOVED), "floating joint"),
    ],
)
def test_invalid_requests_are_refused(
    change: Callable[[dict], object], named: str, mbm_files: SimpleNamespace, tmp_path: Path
) -> None:
    request = mbm_files.request()
    change(request)
    mbm_files.write(tmp_path / "box_panda", 1, request, [1, 1, 1])
    with pytest.raises(FileError, match=named):
        next(read_problems(find_sets(tmp_path)[0]))


def test_folders_without_problems_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"contains no sceneNNNN\.yaml with a requestNNNN\.yaml"):
        find_sets(tmp_path)
    with pytest.raises(FileError, match="nothing: is not a folder"):
        find_sets(tmp_path / "nothing")


def test_a_set_that_names_no_robot_is_refused(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    mbm_files.write(tmp_path / "box_nobody", 1, mbm_files.request(), [1, 1, 1])
    scene = mbm_files.scene([1, 1, 1])
    del scene["robot_model_name"]
    (tmp_path / "box_nobody" / "scene0001.yaml").write_text(str(scene), encoding="utf-8")
    with pytest.raises(FileError, match="box_nobody: names no catalogue robot"):
        find_sets(tmp_path)


def test_fingers_beyond_their_limit_can_be_held_as_stated(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    mbm_files.write(tmp_path / "box_panda", 1, mbm_files.request(finger=0.065), [1, 1, 1])
    (problem,) = read_problems(find_sets(tmp_path)[0], as_stated=True)
    assert problem.arm.held["panda_finger_joint1"] == 0.065
    assert "0.065" in problem.notes[0]


def test_goal_of_two_arms_is_a_problem_of_their_group(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    group = pp.load_robot("baxter_left").arms()
    request = mbm_files.request()
    state = {"name": list(group.joint_names), "position": group.home.tolist()}
    request["start_state"]["joint_state"] = state
    goal = [
        {"joint_name": name, "position": value}
        for name, value in zip(group.joint_names, (group.home + 0.01).tolist(), strict=True)
    ]
    request["goal_constraints"] = [{"joint_constraints": goal}]
    mbm_files.write(tmp_path / "box_baxter", 1, request, [3, 3, 3])
    (problem,) = read_problems(find_sets(tmp_path, "baxter_left")[0])
    assert problem.group.joint_names == group.joint_names
    assert tuple(tcp for _, tcp in problem.group.ends.values()) == ("left_wrist", "right_wrist")
    with pytest.raises(NotApplicableError):
        _ = problem.arm
