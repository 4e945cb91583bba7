"""MotionBenchMaker's files are read in both layouts, and what cannot be asked of the robot is said."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import pinproof as pp
from pinproof.benchmarks.plan_mbm import find_sets, read_problems
from pinproof.errors import FileError

URDF = """<robot name="slider"><link name="base"/><link name="tool"/>
<joint name="panda_joint1" type="prismatic"><parent link="base"/><child link="tool"/>
<axis xyz="1 0 0"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint></robot>"""


def test_both_layouts_name_the_set_and_the_robot(mbm: Path) -> None:
    (found,) = find_sets(mbm)
    assert (found.full_set, found.numbers, found.robot) == ("mbm/box", (1, 2), "panda")


def test_a_set_may_be_named_itself(mbm: Path) -> None:
    (inner,) = mbm.iterdir()
    (found,) = find_sets(inner)
    assert found.name == "box"


def test_a_problem_is_the_request_in_the_order_of_the_arm(mbm: Path, mbm_files: SimpleNamespace) -> None:
    first, second = read_problems(find_sets(mbm)[0])
    assert (first.name, second.name) == ("mbm/box/1", "mbm/box/2")
    np.testing.assert_array_equal(first.start, mbm_files.start)
    np.testing.assert_array_equal(first.goals, [mbm_files.goal])
    assert first.scene.names == ("box",)
    np.testing.assert_allclose(first.scene["box"].pose.translation, [0.45, 0.2, 0.1])


def test_only_the_first_problems_are_read(mbm: Path) -> None:
    assert [problem.number for problem in read_problems(find_sets(mbm)[0], 1)] == [1]


def test_fingers_are_held_where_the_request_starts(mbm: Path) -> None:
    problem = next(read_problems(find_sets(mbm)[0]))
    assert problem.arm.held["panda_finger_joint1"] == 0.03
    assert problem.notes == ()


def test_fingers_beyond_their_limit_are_held_at_it_and_it_is_said(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    mbm_files.write(tmp_path / "box_panda", 1, mbm_files.asked(finger=0.065), [1, 1, 1])
    (problem,) = read_problems(find_sets(tmp_path)[0])
    assert problem.arm.held["panda_finger_joint1"] == 0.04
    assert "held at 0.04, its limit, not at 0.065" in problem.notes[0]


def test_values_outside_their_limits_by_rounding_are_put_at_them(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    upper = float(pp.load_robot("panda").arm().limits.upper[0])
    start = [upper + 5e-5, *mbm_files.start[1:]]
    goal = [upper + 5e-3, *mbm_files.goal[1:]]
    mbm_files.write(tmp_path / "box_panda", 1, mbm_files.asked(start, goal), [1, 1, 1])
    (problem,) = read_problems(find_sets(tmp_path)[0])
    assert problem.start[0] == upper
    assert problem.goals[0, 0] == goal[0]


def test_several_goals_are_all_read(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    words = mbm_files.asked()
    words["goal_constraints"] += mbm_files.asked(goal=mbm_files.start)["goal_constraints"]
    mbm_files.write(tmp_path / "box_panda", 1, words, [1, 1, 1])
    (problem,) = read_problems(find_sets(tmp_path)[0])
    np.testing.assert_array_equal(problem.goals, [mbm_files.goal, mbm_files.start])


def test_the_robot_beside_the_sets_comes_first_and_a_named_one_before_it(mbm: Path) -> None:
    (mbm / "robot").mkdir()
    (mbm / "robot" / "slider.urdf").write_text(URDF, encoding="utf-8")
    assert find_sets(mbm)[0].robot.endswith("slider.urdf")
    assert find_sets(mbm, "panda")[0].robot == "panda"
    with pytest.raises(FileError, match=r"panda_joint2, .*, which 'slider' does not have"):
        next(read_problems(find_sets(mbm)[0]))


def test_without_its_group_the_arm_ends_with_the_last_joint_of_the_goal(mbm: Path) -> None:
    problem = next(read_problems(find_sets(mbm)[0]))  # the catalogue's SRDF calls the group "arm"
    assert problem.arm.tcp == "panda_link7"


def test_a_goal_that_leaves_a_joint_open_is_refused(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    words = mbm_files.asked()
    words["goal_constraints"][0]["joint_constraints"].pop()
    mbm_files.write(tmp_path / "box_panda", 1, words, [1, 1, 1])
    with pytest.raises(FileError, match="says nothing about the joints panda_joint1"):
        next(read_problems(find_sets(tmp_path)[0]))


def test_a_robot_with_other_joints_is_refused(mbm: Path) -> None:
    with pytest.raises(FileError, match=r"panda_joint1, .*, which 'ur5' does not have"):
        next(read_problems(find_sets(mbm, "ur5")[0]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"goal_constraints": []}, "has no goal"),
        ({"goal_constraints": [{"position_constraints": [{}]}]}, "position_constraints"),
        ({"goal_constraints": 3}, "not laid out"),
        ({"start_state": {"joint_state": {"name": ["a"], "position": []}}}, "not laid out"),
    ],
)
def test_requests_that_make_no_sense_are_refused(
    change: dict, said: str, mbm_files: SimpleNamespace, tmp_path: Path
) -> None:
    mbm_files.write(tmp_path / "box_panda", 1, {**mbm_files.asked(), **change}, [1, 1, 1])
    with pytest.raises(FileError, match=said):
        next(read_problems(find_sets(tmp_path)[0]))


def test_a_base_that_is_moved_is_refused(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    words = mbm_files.asked()
    moved = {"translation": [0, 0, 1], "rotation": [0, 0, 0, 1]}
    words["start_state"]["multi_dof_joint_state"] = {"transforms": [moved]}
    mbm_files.write(tmp_path / "box_panda", 1, words, [1, 1, 1])
    with pytest.raises(FileError, match="floating joint"):
        next(read_problems(find_sets(tmp_path)[0]))


def test_folders_without_problems_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"holds no sceneNNNN\.yaml"):
        find_sets(tmp_path)
    with pytest.raises(FileError, match="is no folder"):
        find_sets(tmp_path / "nothing")


def test_a_set_that_names_no_robot_is_refused(mbm_files: SimpleNamespace, tmp_path: Path) -> None:
    mbm_files.write(tmp_path / "box_nobody", 1, mbm_files.asked(), [1, 1, 1])
    scene = mbm_files.scene([1, 1, 1])
    del scene["robot_model_name"]
    (tmp_path / "box_nobody" / "scene0001.yaml").write_text(str(scene), encoding="utf-8")
    with pytest.raises(FileError, match="names no robot of the catalogue"):
        find_sets(tmp_path)
