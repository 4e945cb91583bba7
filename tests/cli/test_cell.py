"""``pinproof cell`` and ``pinproof reach``: output, files and exit codes."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.picks import ReachMap

from .conftest import Cli

GENERIC = robots_folder() / "generic_6dof"
SEQUENCE = ("cell", "sequence", str(robots_folder() / "ur5" / "picks.yaml"), "--only")
SCENE = ("--scene", str(GENERIC / "scene.yaml"))
REGION = ("--region", "0.2 0.6 -0.3 0.3 0.06 0.06", "--step", "0.2", "--spins", "2")
REACH = ("reach", "generic_6dof", *REGION)


@pytest.mark.slow
def test_a_sequence_is_printed_and_written(run: Cli) -> None:
    only = (*SEQUENCE, "bolt_1,bolt_2,bolt_5")
    assert "3 picks in" in run.prints(*only, "--before", "bolt_5,bolt_1", "-o", "cell.json")
    order = [step["name"] for step in json.loads(Path("cell.json").read_text(encoding="utf-8"))["steps"]]
    assert sorted(order) == ["bolt_1", "bolt_2", "bolt_5"]
    assert order.index("bolt_5") < order.index("bolt_1")
    kept = run.json(*only, "--file-order", "--grip-dwell", "0.5")
    assert [step["name"] for step in kept["steps"]] == ["bolt_1", "bolt_2", "bolt_5"]
    assert kept["by_phase"]["grip"] == pytest.approx(1.5)


@pytest.mark.slow
def test_a_budget_of_rotation_is_stated_once_for_each_joint(run: Cli) -> None:
    twice = ("--windings", "wrist_3_joint=200 deg", "--windings", "wrist_3_joint=300 deg")
    run.refuses(*SEQUENCE, "bolt_1", *twice, named=("--windings", "wrist_3_joint", "twice"))


@pytest.mark.slow
def test_failing_picks_of_a_sequence_are_listed_and_give_exit_code_1(run: Cli) -> None:
    outputs = [f"-ocell.{kind}" for kind in ("csv", "md", "json")]
    first, second, summary, *_ = run.prints(*SEQUENCE, "bolt_1,bolt_6", *outputs, code=1).splitlines()
    assert ("bolt_1" in first, "bolt_6" in second, "left out: reach:" in second) == (True, True, True)
    assert "guessed accelerations" in summary  # beside the time of the cycle
    with Path("cell.csv").open(newline="") as file:
        rows = [(row["position"], row["pick"], row["left_out"].partition(":")[0]) for row in csv.DictReader(file)]
    assert rows == [("1", "bolt_1", ""), ("", "bolt_6", "reach")]
    assert re.search(r"^\|\s*\| bolt_6 \|.*left out: reach:", Path("cell.md").read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.slow
def test_programs_of_both_arms_are_printed_and_written(run: Cli) -> None:
    words = ("cell", "allocate", str(robots_folder() / "two_ur5" / "picks.yaml"), "--no-compare")
    outputs = [f"-ocell.{kind}" for kind in ("json", "md", "html")]
    assert "2 picks of 2 arms" in run.prints(*words, "--only", "part_1_1,part_6_3", *outputs)
    text, table, page = (Path(f"cell.{kind}").read_text(encoding="utf-8") for kind in ("json", "md", "html"))
    content = json.loads(text)
    assert content["ok"]
    assert [each["picks"] for each in content["arms"]] == [["part_1_1"], ["part_6_3"]]
    assert sum(each["duration"] for each in content["intervals"]) == pytest.approx(content["makespan"])
    assert "| part_6_3 | approach |" in table
    assert "part_6_3 (right)" in page


# -- reach ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_tool_of_a_picks_file_is_a_collision_body(run: Cli) -> None:
    run.prints(*REACH, *SCENE, "--tip", "0 0 0.105", "-o", "tip.npz")
    run.prints(*REACH, *SCENE, "--tool-of", str(GENERIC / "picks.yaml"), "-o", "tool.npz")
    tip, tool = ReachMap.load("tip.npz"), ReachMap.load("tool.npz")
    assert "with picker, tip (0, 0, 0.105) m from the tcp" in tool.title
    assert not (tool.free & ~tip.free).any()
    picks = pp.read_picks(GENERIC / "picks.yaml")
    rows = np.tile(np.eye(4), (len(tool.region.points), len(tool.orientations), 1, 1))
    rows[..., :3, :3], rows[..., :3, 3] = tool.orientations, tool.region.points[:, None]
    arm, scene = pp.load_robot("generic_6dof").arm(), pp.Scene.load(GENERIC / "scene.yaml")
    settings = {"tip": picks.tip, "tool": picks.open_tool, "margin": picks.margin}
    screened = pp.screen_picks(arm, scene, rows.reshape(-1, 4, 4), **settings)
    np.testing.assert_array_equal(screened.free, tool.free.ravel())


@pytest.mark.slow
def test_a_new_placement_is_compared_with_the_previous_one(run: Cli) -> None:
    run.prints(*REACH, *SCENE, "-o", "here.npz")
    there = (*REACH, *SCENE, "--place", "-0.2 0 0 0.3", "--against", "here.npz")
    assert "won" in run.prints(*there, "-o", "c.csv", "-o", "c.html")
    assert Path("c.csv").read_text().startswith("x,y,z,before,after,won,lost")
    assert "gained minus lost" in Path("c.html").read_text()
    before, placement = ReachMap.load("here.npz"), pp.pose((-0.2, 0.0, 0.0), (0.0, 0.0, 0.3))
    world = pp.Scene.load(GENERIC / "scene.yaml")
    seen = [pp.Obstacle(each.name, each.shape, placement.actInv(each.pose)) for each in world.obstacles]
    checker = pp.CollisionChecker(pp.load_robot("generic_6dof").arm(), pp.Scene(seen, allowed=world.allowed))
    after = pp.reach_map(checker, before.region, before.orientations, world_from_root=placement)
    found = run.json(*there)
    assert found["won"] == (after.free & ~before.free).sum()
    assert found["lost"] == (before.free & ~after.free).sum()


def test_a_base_in_collision_is_reported(run: Cli) -> None:
    code, out, err = run(*REACH, *SCENE, "--place", "0.4 -0.15 0")
    assert (code, "0.0% reachable and free" in out, "base_link" in err) == (1, True, True)


@pytest.mark.slow
def test_orientations_that_the_arm_never_takes_are_reported(run: Cli) -> None:
    """The tool of the first arm always points along a horizontal axis."""
    rows = ("d: 0.3, a: 0, alpha: pi/2", "d: 0, a: 0.4, alpha: 0", "d: 0, a: 0.3, alpha: 0")
    planar = [f"d: 0.02, a: {a}, alpha: 0" for a in (0.5, 0.4, 0.2)]
    for name, each in (("side", rows), ("planar", planar)):
        lines = "".join(f"  - {{name: j{k}, theta: 0, {row}}}\n" for k, row in enumerate(each))
        Path(f"{name}.yaml").write_text(f"convention: standard\nrows:\n{lines}")
    out = run.prints("reach", "side.yaml", *REGION, "-o", "map.html", code=1)
    assert "takes none of the 2 orientations" in out
    assert "--orientations all" in out
    page = Path("map.html").read_text()
    assert "NOT VALIDATED" not in page
    assert 'id="verdict">MAP<' in page
    assert "takes none" in run.json("reach", "side.yaml", *REGION, code=1)["note"]
    # A planar arm is mapped with the direction of its tool at home
    assert "takes none" not in run.prints("reach", "planar.yaml", *REGION, "--orientations", "home", "-o", "map.npz")
    found = ReachMap.load("map.npz")
    assert found.reachable.mean() > 0.5
    np.testing.assert_allclose(found.orientations[:, :, 2], [[0, 0, 1]] * 2, atol=1e-12)
    # A region out of reach is no matter of orientations
    assert "takes none" not in run.prints("reach", "ur5", *REGION, "--place", "9 0 0", code=1)


def test_straight_down_is_one_of_all_orientations(run: Cli) -> None:
    run("reach", "scara", *REGION, "--orientations", "all", "-o", "map.npz")
    axes = ReachMap.load("map.npz").orientations[:, :, 2]
    assert len(axes) == 12 * 2
    assert (np.abs(axes - [0, 0, -1]).max(axis=1) < 1e-12).sum() == 2
