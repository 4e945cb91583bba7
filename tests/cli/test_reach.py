"""``pinproof reach``: set-ups compared, tools of picks files, what is written."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder

from ..pages import Run, run_main

CELL = robots_folder() / "generic_6dof"
REGION = ("--region", "0.2 0.6 -0.3 0.3 0.06 0.06", "--step", "0.2", "--spins", "2")


@pytest.fixture
def run(run: Run) -> Run:
    """Run a command line in this process, in an empty folder: exit code, stdout, stderr."""
    return partial(run, "reach", "generic_6dof", *REGION)


@pytest.mark.slow
def test_the_tool_of_a_picks_file_is_a_collision_body(run: Run) -> None:
    scene = ("--scene", str(CELL / "scene.yaml"))
    assert run(*scene, "--tip", "0 0 0.105", "-o", "tip.npz")[0] == 0
    assert run(*scene, "--tool-of", str(CELL / "picks.yaml"), "-o", "tool.npz")[0] == 0
    tip, tool = pp.picks.ReachMap.load("tip.npz"), pp.picks.ReachMap.load("tool.npz")
    assert "with picker, tip (0, 0, 0.105) m from the tcp" in tool.title
    assert not (tool.free & ~tip.free).any()
    picks = pp.read_picks(CELL / "picks.yaml")
    arm, rows = pp.load_robot("generic_6dof").arm(), []
    for point in tool.region.points:
        for rotation in tool.orientations:
            rows.append(np.eye(4))
            rows[-1][:3, :3], rows[-1][:3, 3] = rotation, point
    screened = pp.screen_picks(
        arm, pp.Scene.load(CELL / "scene.yaml"), np.array(rows),
        tip=picks.tip, tool=picks.open_tool, margin=picks.margin,
    )  # fmt: skip
    np.testing.assert_array_equal(screened.free, tool.free.ravel())


@pytest.mark.slow
def test_a_new_placement_is_compared_with_the_previous_one(run: Run) -> None:
    scene = ("--scene", str(CELL / "scene.yaml"))
    assert run(*scene, "-o", "here.npz")[0] == 0
    code, out, _ = run(*scene, "--place", "-0.2 0 0 0.3", "--against", "here.npz", "-o", "c.csv", "-o", "c.html")
    assert code == 0
    assert "won" in out
    assert Path("c.csv").read_text().startswith("x,y,z,before,after,won,lost")
    assert "gained minus lost" in Path("c.html").read_text()
    arm, world = pp.load_robot("generic_6dof").arm(), pp.Scene.load(CELL / "scene.yaml")
    before = pp.picks.ReachMap.load("here.npz")
    stands = pp.pose((-0.2, 0.0, 0.0), (0.0, 0.0, 0.3))
    seen = pp.Scene(
        [pp.Obstacle(o.name, o.shape, stands.actInv(o.pose)) for o in world.obstacles], allowed=world.allowed
    )
    checker = pp.CollisionChecker(arm, seen)
    after = pp.reach_map(checker, before.region, before.orientations, world_from_root=stands)
    code, data, _ = run(*scene, "--place", "-0.2 0 0 0.3", "--against", "here.npz", "--json")
    assert json.loads(data)["won"] == (after.free & ~before.free).sum()
    assert json.loads(data)["lost"] == (before.free & ~after.free).sum()


def test_a_base_in_collision_is_reported(run: Run) -> None:
    code, out, err = run("--scene", str(CELL / "scene.yaml"), "--place", "0.4 -0.15 0")
    assert code == 1
    assert "0.0% reachable and free" in out
    assert "base_link" in err


def test_a_malformed_placement_is_refused(run: Run) -> None:
    code, _, err = run("--place", "1 2")
    assert code == 2
    assert "--place" in err


SIDEWAYS = """convention: standard
rows:
  - {name: j1, theta: 0, d: 0.3, a: 0, alpha: pi/2}
  - {name: j2, theta: 0, d: 0, a: 0.4, alpha: 0}
  - {name: j3, theta: 0, d: 0, a: 0.3, alpha: 0}
"""
"""An arm whose tool always points along a horizontal axis."""


@pytest.fixture
def any_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    """Run ``pinproof reach`` for any robot, in a folder with the arm above."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "side.yaml").write_text(SIDEWAYS)
    return lambda *words: run_main("reach", *words, *REGION)


@pytest.mark.slow
def test_orientations_that_the_arm_never_takes_are_reported(any_run: Run) -> None:
    code, out, _ = any_run("side.yaml", "-o", "map.html")
    assert code == 1
    assert "takes none of the 2 orientations" in out
    assert "--orientations all" in out
    page = Path("map.html").read_text()
    assert "NOT VALIDATED" not in page
    assert 'id="verdict">MAP<' in page
    code, out, _ = any_run("side.yaml", "--json")
    assert "takes none" in json.loads(out)["note"]


def test_a_planar_arm_is_mapped_with_the_direction_of_its_tool_at_home(any_run: Run) -> None:
    rows = "".join(f"  - {{name: j{k}, theta: 0, d: 0.02, a: {a}, alpha: 0}}\n" for k, a in enumerate((0.5, 0.4, 0.2)))
    Path("planar.yaml").write_text(f"convention: standard\nrows:\n{rows}")
    code, out, _ = any_run("planar.yaml", "--orientations", "home", "-o", "map.npz")
    assert (code, "takes none" in out) == (0, False)
    found = pp.picks.ReachMap.load("map.npz")
    assert found.reachable.mean() > 0.5
    np.testing.assert_allclose(found.orientations[:, :, 2], [[0, 0, 1]] * 2, atol=1e-12)


def test_a_region_out_of_reach_is_no_matter_of_orientations(any_run: Run) -> None:
    code, out, _ = any_run("ur5", "--place", "9 0 0")
    assert code == 1
    assert "takes none" not in out


def test_straight_down_is_one_of_all_orientations(any_run: Run) -> None:
    any_run("scara", "--orientations", "all", "-o", "map.npz")
    axes = pp.picks.ReachMap.load("map.npz").orientations[:, :, 2]
    assert len(axes) == 12 * 2
    assert (np.abs(axes - [0, 0, -1]).max(axis=1) < 1e-12).sum() == 2
