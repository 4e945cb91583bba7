"""The exact wording of the messages that users meet most often, compared with docs/messages.md.

This is the only test that asserts wording; all other tests assert types of errors, statuses, names and numbers. Each
entry of :data:`MESSAGES` is a short call whose error, reason or suggestion is printed in docs/messages.md, below a
comment with the name of the entry (``<!-- unknown robot -->``). After a change of wording write the new texts into the
page with::

    python tests/test_messages.py --write

then read the difference and adapt the explanations of the page.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import textwrap
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

import pinproof as pp

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "messages.md"
BLOCK = re.compile(r"^<!-- ([\w ]+) -->\n```text\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LISTED = 3
"""Names of a list of valid choices that the page shows."""
WIDTH = 116
"""Characters of a line in the blocks of the page."""

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
POSITIONS_ONLY = """{"joint_names": ["turn"], "points": [
  {"positions": [0], "time_from_start": {"sec": 0, "nanosec": 0}},
  {"positions": [1], "time_from_start": {"sec": 1, "nanosec": 0}}]}"""
OUT_OF_REACH = pp.pose((5.0, 0.0, 0.0))


def write(name: str, text: str) -> str:
    """Write a file of that name; return the name."""
    Path(name).write_text(text, encoding="utf-8")
    return name


def load(urdf: str) -> pp.Robot:
    return pp.load_robot(write("arm.urdf", urdf))


def ur5() -> pp.Arm:
    return pp.load_robot("ur5").arm(tcp="tool0")


def checker(*obstacles: pp.Obstacle) -> pp.CollisionChecker:
    return pp.CollisionChecker(ur5(), pp.Scene(obstacles))


def motion_through_sheet() -> tuple[pp.JointPath, pp.CollisionChecker]:
    """A motion of the UR5 through a metal sheet."""
    arm = ur5()
    step = np.array([0.5, 0, 0, 0, 0, 0])
    sheet = pp.Obstacle("sheet", pp.Box(0.4, 0.01, 0.4), pp.pose(arm.forward_kinematics(arm.home).translation))
    return pp.JointPath([arm.home - step, arm.home + step], arm.joint_names), checker(sheet)


def motion_above_plate() -> tuple[pp.JointPath, pp.CollisionChecker]:
    """A motion of the UR5 so close above a plate that one interval does not prove it free."""
    path, _ = motion_through_sheet()
    below = ur5().forward_kinematics(ur5().home).translation - [0, 0, 0.12]
    return path, checker(pp.Obstacle("plate", pp.Box(0.4, 1.0, 0.1), pp.pose(below)))


def plan_to_pose(x: float) -> object:
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose((0.55, 0, 0.5)))
    start = [-1.0, -1.2, 1.2, -1.57, -1.57, 0.0]
    return pp.plan(pp.CollisionChecker(ur5(), pp.Scene([post])), start, pp.pose((x, 0, 0.3), (np.pi, 0, 0))).or_raise()


def plan_with_two_nodes() -> object:
    path, judge = motion_through_sheet()
    return pp.RrtConnect(max_nodes=2, max_samples=2).plan(judge, path.q[0], [path.q[1]]).or_raise()


def plan_from_contact() -> object:
    path, judge = motion_through_sheet()
    return pp.RrtConnect().plan(judge, (path.q[0] + path.q[1]) / 2, [path.q[1]]).or_raise()


def xacro_file_without_xacro() -> object:
    with patch.dict(sys.modules, {"xacro": None}):
        return pp.load_robot(write("arm.urdf.xacro", URDF))


def verdict(x: float, *obstacles: pp.Obstacle) -> str:
    """Judge one pick; return its status, stage, reason and suggestions."""
    pick = pp.Pick("part", pp.pose((x, 0.1, 0.2), (np.pi, 0, 0)))
    found = pp.validate_picks(ur5(), pp.Scene(obstacles), pp.Picks((pick,)), rng=0).verdicts[0]
    stage = f" at {found.failed.value}" if found.failed else ""
    lines = [f"{found.status.value}{stage}: {found.reason}", *(f"suggestion: {each}" for each in found.suggestions)]
    return "\n".join(lines)


MESSAGES: dict[str, Callable[[], object]] = {
    "unknown robot": lambda: pp.load_robot("ur55"),
    "unknown link": lambda: load(URDF.replace('child link="arm"', 'child link="arn"')),
    "several tcp frames": lambda: load(URDF).arm(),
    "unknown frame": lambda: pp.load_robot("ur5").arm(tcp="tool"),
    "no joint limits": lambda: load(URDF).arm(tcp="hand"),
    "missing mesh": lambda: pp.CollisionChecker(load(LIMITED.replace('<link name="hand"/>', MESH)).arm(tcp="hand")),
    "no convention": lambda: pp.DhTable.load(write("dh.yaml", ROWS)),
    "degrees": lambda: pp.DhTable.load(
        write("dh.yaml", "convention: standard\n" + ROWS.replace("alpha: 0", "alpha: 90"))
    ),
    "number of joints": lambda: ur5().forward_kinematics([0.0, 1.0]),
    "target not finite": lambda: pp.Clik().solve(ur5(), np.full((4, 4), np.nan)),
    "ik failed": lambda: pp.Clik().solve(ur5(), OUT_OF_REACH).or_raise(),
    "no branches": lambda: pp.AnalyticIk().solve(ur5(), OUT_OF_REACH).or_raise(),
    "no closed form": lambda: pp.AnalyticIk().solve_all(
        pp.load_robot("talos_left").arm(base="base_link"), OUT_OF_REACH
    ),
    "unknown key": lambda: pp.Scene.load(write("scene.yaml", "obstacles:\n  - {name: table, boks: [1, 1, 1]}\n")),
    "scene frame": lambda: pp.CollisionChecker(ur5(), pp.Scene.load(write("moveit.yaml", MOVEIT))),
    "motion in collision": lambda: pp.certify(*motion_through_sheet()).or_raise(),
    "motion undecided": lambda: pp.certify(*motion_above_plate(), max_intervals=1).or_raise(),
    "joints of another arm": lambda: pp.certify(pp.JointPath([[0.0], [1.0]], ("turn",)), checker()),
    "start in collision": plan_from_contact,
    "goal pose in contact": lambda: plan_to_pose(0.55),
    "goal pose out of reach": lambda: plan_to_pose(1.4),
    "no path": plan_with_two_nodes,
    "no jerk limits": lambda: pp.time_parametrise(motion_through_sheet()[0], ur5().limits, jerk="limits"),
    "positions only": lambda: pp.Trajectory.load(write("motion.json", POSITIONS_ONLY), ("turn",)),
    "unknown key of picks": lambda: pp.read_picks(write("picks.yaml", "robot: ur5\npicks: []\nscenes: cell.yaml\n")),
    "pick out of reach": lambda: verdict(1.2),
    "pick in collision": lambda: verdict(0.5, pp.Obstacle("wall", pp.Box(0.2, 0.01, 0.4), pp.pose((0.5, 0.13, 0.2)))),
    "extra not installed": xacro_file_without_xacro,
}


def message(name: str, folder: Path) -> str:
    """Make the call of an entry in ``folder``; return the message as the page shows it."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        text = str(MESSAGES[name]())
    except pp.PinproofError as error:
        text = str(error)
    finally:
        os.chdir(before)
    text = text.replace(f"{folder.resolve()}{os.sep}", ".../")
    names = rf"((?:[\w./-]+, ){{{LISTED}}})(?:[\w./-]+, )*(?:[\w./-]+|\.\.\.)(?: \(\d+ in all\))?"
    text = re.sub(rf"(valid: |joints are |\()'?{names}(?=$|\n)", r"\1\2...", text)
    return "\n".join(textwrap.fill(line, WIDTH, subsequent_indent="  ") for line in text.splitlines())


def page_messages() -> dict[str, str]:
    return {name: text.rstrip("\n") for name, text in BLOCK.findall(PAGE.read_text(encoding="utf-8"))}


def test_page_explains_exactly_the_messages_of_this_file() -> None:
    assert list(page_messages()) == list(MESSAGES)


@pytest.mark.parametrize("name", MESSAGES)
def test_message_is_worded_as_on_the_page(name: str, tmp_path: Path) -> None:
    assert message(name, tmp_path) == page_messages().get(name)


def write_page() -> None:
    """Write the current messages into the blocks of docs/messages.md."""
    with tempfile.TemporaryDirectory() as folder:
        text = BLOCK.sub(
            lambda block: f"<!-- {block[1]} -->\n```text\n{message(block[1], Path(folder))}\n```",
            PAGE.read_text(encoding="utf-8"),
        )
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit("usage: python tests/test_messages.py --write")
    write_page()
