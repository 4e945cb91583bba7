"""Numbers in degrees or millimetres are reported, and legitimate numbers are not."""

from __future__ import annotations

import math
import shlex
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.errors import UnitWarning


def test_a_pose_in_degrees_gives_a_warning():
    with pytest.warns(UnitWarning, match=r"rpy: 180 rad .* 180 degrees = 3.14159 rad"):
        placed = pp.pose(rpy=(180, 0, 0))
    assert placed.rotation[1, 1] == pytest.approx(math.cos(180))  # it is not converted


@pytest.mark.parametrize("rpy", [(math.pi, 0, 0), (4 * math.pi, 0, -7)])
def test_angles_up_to_two_rotations_give_none(rpy):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pp.pose(rpy=rpy)


@pytest.mark.parametrize("solver", [pp.Clik(restarts=2), pp.AnalyticIk()])
def test_a_target_in_millimetres_is_out_of_reach_with_a_hint(solver):
    arm = pp.load_robot("ur5").arm()
    found = solver.solve(arm, pp.pose((400, 100, 300), (math.pi, 0, 0)), rng=0)
    assert not found.ok
    assert "looks like millimetres" in found.message


@pytest.mark.parametrize("solver", [pp.Clik(restarts=2), pp.AnalyticIk()])
def test_a_target_a_little_out_of_reach_has_no_hint(solver):
    found = solver.solve(pp.load_robot("ur5").arm(), pp.pose((1.5, 0, 0.3), (math.pi, 0, 0)), rng=0)
    assert not found.ok
    assert "millimetres" not in found.message


def checker(*obstacles: pp.Obstacle, attached: tuple[pp.Obstacle, ...] = ()) -> pp.CollisionChecker:
    return pp.CollisionChecker(pp.load_robot("generic_6dof").arm(), pp.Scene(obstacles), attached=attached)


def test_a_box_in_millimetres_gives_a_warning():
    with pytest.warns(UnitWarning, match="'table'.* 1200 mm = 1.2 m"):
        checker(pp.Obstacle("table", pp.Box(1200, 800, 40), pp.pose((0, 0, -30))))


@pytest.fixture
def part(tmp_path: Path) -> Path:
    trimesh.creation.box((60, 40, 20)).export(tmp_path / "part.stl")
    return tmp_path / "part.stl"


def test_a_mesh_in_millimetres_gives_a_warning_with_the_scale(part):
    with pytest.warns(UnitWarning, match=r"'part' .*scale: 0.001.* 60 mm = 0.06 m"):
        checker(pp.Obstacle("part", pp.Mesh(part), pp.pose((0, 0, -30))))
    with pytest.warns(UnitWarning, match=r"'tool' .*scale 0.001"):
        checker(attached=(pp.Obstacle("tool", pp.Mesh(part)),))


def test_a_link_mesh_in_millimetres_gives_a_warning(part, tmp_path):
    (tmp_path / "r.urdf").write_text(
        '<robot name="r"><link name="a"/><link name="b"><collision><geometry><mesh filename="part.stl"/></geometry>'
        '</collision></link><link name="tip"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint><joint name="e" type="fixed">'
        '<parent link="b"/><child link="tip"/><origin xyz="0.3 0 0"/></joint></robot>'
    )
    with pytest.warns(UnitWarning, match="'b'"):
        pp.CollisionChecker(pp.load_robot(tmp_path / "r.urdf").arm())


@pytest.mark.parametrize(("size", "warned"), [(2.9, False), (4.0, True), (10.0, True)])
def test_a_link_is_compared_with_the_size_of_its_robot(size, warned):
    """The robot is 0.3 m long, so that a link of more than 3 m is too large; an obstacle may be larger."""
    robot = pp.load_robot(
        f'<robot name="r"><link name="a"/><link name="b"><collision><geometry><box size="{size} {size} {size}"/>'
        '</geometry></collision></link><link name="tip"/><joint name="j" type="revolute"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        '<joint name="e" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="0.3 0 0"/></joint></robot>'
    )
    table = pp.Obstacle("table", pp.Box(size, size, size), pp.pose((0, 0, -30)))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        pp.CollisionChecker(robot.arm(), pp.Scene([table]))
    assert ["'b'" in str(each.message) for each in found] == [True] * warned


def test_legitimate_sizes_give_no_warning(part):
    floor = pp.Obstacle("floor", pp.Box(200, 200, 0.1), pp.pose((0, 0, -0.3)))
    hall = pp.Obstacle("hall", pp.Box(60, 40, 8), pp.pose((0, 0, -10)))
    scaled = pp.Obstacle("part", pp.Mesh(part, 0.001), pp.pose((1, 0, 0)))
    below = pp.Obstacle("below", pp.HalfSpace(), pp.pose((0, 0, -0.5)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker(floor, hall, scaled, below)


@pytest.fixture
def run(monkeypatch, capsys):
    from pinproof.cli.main import main

    def call(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["pinproof", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    return call


@pytest.mark.parametrize(
    ("words", "code", "stream", "hint"),
    [
        ("ik ur5 --xyz '0.4 0.1 0.3' --rpy '180 0 0'", 2, "err", "180 degrees = 3.14159 rad"),
        ("ik ur5 --xyz '400 100 300' --rpy 'pi 0 0'", 1, "out", "looks like millimetres"),
        ("fk ur5 --q '0 -90 90 -90 -90 0'", 0, "err", "-90 degrees = -1.5708 rad"),
    ],
)
def test_the_command_line_reports_numbers_in_other_units(run, words, code, stream, hint):
    ended, out, err = run(*shlex.split(words))
    assert ended == code
    assert hint in {"out": out, "err": err}[stream]
    assert "Warning" not in out + err


def test_the_command_line_notes_a_scene_in_millimetres(run, tmp_path):
    (tmp_path / "s.yaml").write_text("obstacles: [{name: table, box: [1200, 800, 40], xyz: [0, 0, -30]}]")
    _, _, err = run("check", "generic_6dof", "--scene", str(tmp_path / "s.yaml"))
    assert "1200 mm = 1.2 m" in err


def test_continuous_joints_may_take_many_rotations(run):
    arm = pp.load_robot("kinova").arm()
    if np.isinf(arm.limits.lower).any():
        values = ["20" if np.isinf(low) else str(q) for low, q in zip(arm.limits.lower, arm.home, strict=True)]
        _, _, err = run("fk", "kinova", "--q", " ".join(values))
        assert err == ""
