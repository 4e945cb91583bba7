"""The picture contains the tool, the carried part and the obstacles near them at every key frame of a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.viewer.camera import View, choose_view, fit, tool_points
from pinproof.viewer.picture import Picture
from pinproof.viewer.stage import Drawing, Film, FilmPhase, film, set_stage

ASPECTS = (0.6, 4 / 3, 980 / 750, 2.2)
"""Width by height of the canvas: a telephone, the default, the page in a window of 1280 x 800, a wide window."""

REACH = 0.05
"""Metres: obstacles this close to the tool must be visible in all tests, whatever the size of the arm."""

GRIPPER = [
    pp.Obstacle("palm", pp.Box(0.1, 0.06, 0.08), pp.pose(xyz=(0, 0, 0.04))),
    pp.Obstacle("finger", pp.Box(0.015, 0.03, 0.08), pp.pose(xyz=(0.035, 0, 0.12))),
]


def outside(view: View, points: np.ndarray, aspect: float) -> float:
    """By how much of half the picture the farthest point is outside; negative if all are inside."""
    axes, tangent, camera = fit(view.points, view.direction, aspect, view.margin)
    x = points @ axes.T - camera
    if (x[:, 2] >= 0).any():  # behind the camera
        return np.inf
    return float((np.abs(x[:, :2]) / (-x[:, 2:] * tangent)).max() - 1)


def motion(arm: pp.Arm, *points) -> pp.Trajectory:
    return pp.time_parametrise(pp.JointPath([np.asarray(q, float) for q in points], arm.joint_names), arm.limits)


def planar() -> pp.Arm:
    """A planar arm with two links of a DH table, whose joint housings reach below its base frame."""
    rows = [pp.DhRow("one", 0, 0, 0.5, 0), pp.DhRow("two", 0, 0, 0.4, 0)]
    from pinproof.model import load_robot

    return load_robot(pp.dh_to_urdf(pp.DhTable(rows, convention="standard"))).arm("tool0")


def above_and_down(arm: pp.Arm, at: tuple[float, float, float]) -> pp.Trajectory:
    """From home over a point 0.2 m above a tcp position to the position itself, with the tool down."""
    solver = pp.AnalyticIk()
    down = pp.pose(xyz=at, rpy=(np.pi, 0, 0))
    over = pp.pose(xyz=(*at[:2], at[2] + 0.2), rpy=(np.pi, 0, 0))
    q = solver.solve_all(arm, down).nearest(arm.home)
    return motion(arm, arm.home, solver.solve_all(arm, over).nearest(q), q)


CASES = {
    "planar": (planar, (), (), [[0.2, 0.6], [1.5, -1.0]]),
    "scara": (lambda: pp.load_robot("scara").arm(), (), (), [[-1.0, 1.5, 0.0, 0.0], [1.0, -1.0, 0.2, 1.0]]),
    "ur10 with gripper": (
        lambda: pp.load_robot("ur10").arm(),
        GRIPPER,
        [
            pp.Obstacle("table", pp.Box(1.6, 1.6, 0.05), pp.pose(xyz=(0.6, 0, -0.03))),
            pp.Obstacle("part", pp.Cylinder(radius=0.02, length=0.08), pp.pose(xyz=(0.7, 0.3, 0.04))),
        ],
        (0.7, 0.3, 0.2),
    ),
    "ur5 at a bin": (
        lambda: pp.load_robot("ur5").arm(),
        [pp.Obstacle("rod", pp.Cylinder(radius=0.02, length=0.16), pp.pose(xyz=(0, 0, 0.08)))],
        [
            pp.Obstacle("table", pp.Box(1.6, 1.2, 0.04), pp.pose(xyz=(0.4, 0, -0.02))),
            pp.Obstacle("near wall", pp.Box(0.4, 0.01, 0.1), pp.pose(xyz=(0.5, -0.18, 0.05))),
            pp.Obstacle("bolt", pp.Cylinder(radius=0.01, length=0.05), pp.pose(xyz=(0.5, -0.1, 0.025))),
        ],
        (0.5, -0.1, 0.22),
    ),
    "panda": (
        lambda: pp.load_robot("panda").arm(),
        (),
        (),
        [[0, -0.5, 0, -2.2, 0, 1.8, 0.8], [1.2, 0.6, 0.3, -1.4, 0, 2.2, 0]],
    ),
}


@pytest.fixture(scope="module", params=list(CASES))
def case(request) -> tuple[Drawing, Film, View]:
    make, attached, obstacles, move = CASES[request.param]
    arm = make()
    trajectory = above_and_down(arm, move) if isinstance(move, tuple) else motion(arm, *move)
    stage = set_stage(arm, pp.Scene(obstacles), attached)
    shown = film(stage, [FilmPhase(trajectory)])
    view = choose_view(stage, shown.poses, shown.tcps[:, 0], tool=tool_points(stage, shown.poses))
    return stage, shown, view


def placed(surfaces, pose: np.ndarray) -> np.ndarray:
    vertices = np.concatenate([surface.vertices for surface in surfaces])
    return vertices @ pose[:3, :3].T + pose[:3, 3]


def test_the_tool_is_in_the_picture_at_every_key_frame(case) -> None:
    stage, shown, view = case
    tool = [link for link, is_tool in zip(range(len(stage.links)), stage.tool, strict=True) if is_tool]
    assert tool
    for poses in shown.poses:
        points = np.concatenate([placed(stage.links[k].surfaces, poses[k]) for k in tool])
        assert max(outside(view, points, aspect) for aspect in ASPECTS) < 0
    assert all(outside(view, shown.tcps[:, 0], aspect) < 0 for aspect in ASPECTS)


def test_all_links_are_in_the_picture_at_every_key_frame(case) -> None:
    stage, shown, view = case
    for poses in shown.poses[::3]:
        for link, pose in zip(stage.links, poses, strict=True):
            if link.surfaces:
                assert outside(view, placed(link.surfaces, pose), 4 / 3) < 0.01, link.name


def test_obstacles_near_the_tool_are_in_the_picture(case) -> None:
    stage, shown, view = case
    tool = tool_points(stage, shown.poses)
    for obstacle in stage.obstacles:
        points = placed(obstacle.surfaces, obstacle.pose)
        near = np.array([np.linalg.norm(tool - point, axis=1).min() <= REACH for point in points])
        if near.any():
            assert all(outside(view, points[near], aspect) < 0 for aspect in ASPECTS), obstacle.name
    if "bolt" in {obstacle.name for obstacle in stage.obstacles}:
        bolt = next(each for each in stage.obstacles if each.name == "bolt")
        assert outside(view, placed(bolt.surfaces, bolt.pose), 4 / 3) < 0


def test_a_view_that_ignores_the_tool_fails_the_same_check(case) -> None:
    stage, shown, view = case
    blind = replace(view, points=placed(stage.links[0].surfaces, shown.poses[0, 0]))
    assert max(outside(blind, shown.tcps[:, 0], aspect) for aspect in ASPECTS) > 0


def test_the_robot_is_not_sunk_in_the_floor(case) -> None:
    stage, shown, _ = case
    floor = stage.floor(shown.poses)
    lowest = min(
        placed(link.surfaces, pose)[:, 2].min()
        for poses in shown.poses[:: max(1, len(shown.poses) // 20)]
        for link, pose in zip(stage.links, poses, strict=True)
        if link.surfaces
    )
    assert floor <= lowest + 1e-9
    assert floor <= 0


def test_tcp_path_of_a_small_arm_is_thin() -> None:
    from pinproof.model import load_robot

    rows = [pp.DhRow("one", 0, 0, 0.05, 0), pp.DhRow("two", 0, 0, 0.04, 0)]
    arm = load_robot(pp.dh_to_urdf(pp.DhTable(rows, convention="standard"))).arm("tool0")
    picture = Picture(arm, None, motion(arm, [0, 0.5], [1, -0.5])).render()
    balls = [each for each in picture.commands.items if each.get("path") == "/tcp path/0/start"]
    assert balls
    blob, reference = picture.commands._blob, balls[0]["object"]["geometries"][0]["data"]["attributes"]["position"]
    _, offset, count = reference["array"]["$buffer"]
    points = np.frombuffer(bytes(blob[offset : offset + 4 * count]), dtype=np.float32).reshape(-1, 3)
    assert np.ptp(points, axis=0).max() < 0.005
