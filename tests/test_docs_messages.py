"""docs/messages.md quotes what the package really says: each message there is raised by the call that stands here."""

from __future__ import annotations

import doctest
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp

from .pages import FLAGS, ROOT, blocks, standing_in

PAGE = ROOT / "docs" / "messages.md"

URDF = """<robot name="two">
  <link name="base"/><link name="arm"/><link name="hand"/><link name="eye"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit effort="1" velocity="2"/></joint>
  <joint name="a" type="fixed"><parent link="arm"/><child link="hand"/></joint>
  <joint name="b" type="fixed"><parent link="arm"/><child link="eye"/></joint>
</robot>"""
MESH = '<link name="hand"><collision><geometry><mesh filename="hand.stl"/></geometry></collision></link>'
LIMITED = URDF.replace('velocity="2"/>', 'velocity="2" lower="-1" upper="1"/>')
ROWS = "name: my_arm\nrows:\n  - {name: j, type: revolute, theta: 0, d: 0, a: 1, alpha: 0, lower: -1, upper: 1}\n"
MOVEIT = """world:
  collision_objects:
    - {id: tray, header: {frame_id: camera}, primitives: [{type: box, dimensions: [1, 1, 1]}]}
"""
BARE = """{"joint_names": ["turn"], "points": [
  {"positions": [0], "time_from_start": {"sec": 0, "nanosec": 0}},
  {"positions": [1], "time_from_start": {"sec": 1, "nanosec": 0}}]}"""
FAR = pp.pose((5.0, 0.0, 0.0))


def file(name: str, text: str) -> str:
    """The text as a file of that name; the name."""
    Path(name).write_text(text, encoding="utf-8")
    return name


def ur5() -> pp.Arm:
    return pp.load_robot("ur5").arm(tcp="tool0")


def checker(*obstacles: pp.Obstacle, **settings: float) -> pp.CollisionChecker:
    return pp.CollisionChecker(ur5(), pp.Scene(obstacles), **settings)


def sheet_on_the_way() -> tuple[pp.JointPath, pp.CollisionChecker]:
    """A swing of the UR5 through a sheet of metal."""
    arm = ur5()
    turn = np.array([0.5, 0, 0, 0, 0, 0])
    sheet = pp.Obstacle("sheet", pp.Box(0.4, 0.01, 0.4), pp.pose(arm.forward_kinematics(arm.home).translation))
    return pp.JointPath([arm.home - turn, arm.home + turn], arm.joint_names), checker(sheet)


def close_by() -> tuple[pp.JointPath, pp.CollisionChecker]:
    """A swing of the UR5 above a plate, near enough that three intervals do not prove it."""
    path, _ = sheet_on_the_way()
    low = ur5().forward_kinematics(ur5().home).translation - [0, 0, 0.12]
    return path, checker(pp.Obstacle("plate", pp.Box(0.4, 1.0, 0.1), pp.pose(low)))


def no_way() -> object:
    """Two nodes are not enough to get around the sheet."""
    path, judge = sheet_on_the_way()
    return pp.RrtConnect(max_nodes=2, max_samples=2).plan(judge, path.q[0], [path.q[1]]).or_raise()


def plan_through_nothing() -> object:
    path, judge = sheet_on_the_way()
    return pp.RrtConnect().plan(judge, (path.q[0] + path.q[1]) / 2, [path.q[1]]).or_raise()


def plan_by_ompl() -> object:
    return pp.OmplPlanner("RRTConnect").plan(checker(), np.zeros(6), [np.ones(6)])


def without(module: str, call: Callable[[], object]) -> object:
    """The call, where a module is not installed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, module, None)
        return call()


PROVOKED: dict[str, Callable[[], object]] = {
    "unknown robot": lambda: pp.load_robot("ur55"),
    "arm.urdf: line": lambda: pp.load_robot(file("arm.urdf", URDF.replace('child link="arm"', 'child link="arn"'))),
    "robot 'two' declares": lambda: pp.load_robot(file("arm.urdf", URDF)).arm(),
    "revolute joint": lambda: pp.load_robot(file("arm.urdf", URDF)).arm(tcp="hand"),
    "hand.stl: the mesh": lambda: pp.CollisionChecker(
        pp.load_robot(file("arm.urdf", LIMITED.replace('<link name="hand"/>', MESH))).arm(tcp="hand")
    ),
    "dh.yaml: states": lambda: pp.DhTable.load(file("dh.yaml", ROWS)),
    "q must have": lambda: ur5().forward_kinematics([0.0, 1.0]),
    "unknown frame": lambda: pp.load_robot("ur5").arm(tcp="tool"),
    "not found in": lambda: pp.Clik().solve(ur5(), FAR).or_raise(),
    "0 branches": lambda: pp.AnalyticIk().solve(ur5(), FAR).or_raise(),
    "no closed form": lambda: pp.AnalyticIk().solve_all(pp.load_robot("baxter_left").arm(), FAR),
    "scene.yaml": lambda: pp.Scene.load(file("scene.yaml", "obstacles:\n  - {name: table, boks: [1, 1, 1]}\n")),
    "the scene": lambda: pp.CollisionChecker(ur5(), pp.Scene.load(file("moveit.yaml", MOVEIT))),
    "wrist_1_link penetrates": lambda: pp.certify(*sheet_on_the_way()).or_raise(),
    "neither proven": lambda: pp.certify(close_by()[0], close_by()[1], max_intervals=1).or_raise(),
    "no path within": no_way,
    "the curve": lambda: pp.certify(pp.JointPath([[0.0], [1.0]], ("turn",)), checker()),
    "target holds": lambda: pp.Clik().solve(ur5(), np.full((4, 4), np.nan)),
    "the start": plan_through_nothing,
    "the limits hold no jerk": lambda: pp.time_parametrise(sheet_on_the_way()[0], ur5().limits, jerk="limits"),
    "motion.json": lambda: pp.Trajectory.load(file("motion.json", BARE), ("turn",)),
    "picks.yaml": lambda: pp.read_picks(file("picks.yaml", "robot: ur5\npicks: []\nscenes: cell.yaml\n")),
    "planners of OMPL": lambda: without(
        "ompl", lambda: pp.OmplPlanner("RRTConnect").plan(checker(), np.zeros(6), [np.ones(6)])
    ),
}


def quoted() -> dict[str, str]:
    """The page's messages by the words of PROVOKED that they begin with."""
    return {
        next((key for key in PROVOKED if block.text.startswith(key)), block.text): block.text
        for block in blocks(PAGE, "text")
    }


def test_every_message_of_the_page_is_provoked_here_and_the_other_way_round() -> None:
    assert set(quoted()) == set(PROVOKED)


@pytest.mark.parametrize("key", PROVOKED)
def test_a_message_is_what_the_package_says(key: str, tmp_path: Path) -> None:
    with standing_in(tmp_path), pytest.raises(pp.PinproofError) as raised:
        PROVOKED[key]()
    assert doctest.OutputChecker().check_output(quoted()[key], str(raised.value), FLAGS), str(raised.value)
