"""Tool paths as given: what is refused, what becomes one pose, and how points and normals become poses."""

import numpy as np
import pytest

import pinproof as pp
from pinproof.tool_paths import ToolPath

LINE = np.column_stack([np.full(5, 0.4), np.linspace(-0.2, 0.2, 5), np.full(5, 0.2)])
UP = (0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ToolPath([]), "no pose"),
        (lambda: ToolPath([np.full((4, 4), np.nan)]), "pose"),
        (lambda: ToolPath.through(LINE * np.nan, UP), "nan"),
        (lambda: ToolPath.through(LINE * 1000.0, UP), "400 mm = 0.4 m"),
        (lambda: ToolPath([pp.pose((400.0, 100.0, 200.0))]), "400 mm"),
        (lambda: ToolPath.through(LINE, [UP, UP, (0, 0, 0), UP, UP]), "normal 2 has length 0"),
        (lambda: ToolPath.through(LINE, (0.0, 0.0, 0.0)), "normal 0"),
        (lambda: ToolPath.through(LINE, UP, speed=50.0), "mm/s"),
        (lambda: ToolPath.through(LINE, UP, speed=0.0), "above 0"),
        (lambda: ToolPath.through(LINE, UP, speed=[0.1, 0.1, -1.0, 0.1]), "-1"),
        (lambda: ToolPath.through(LINE, UP, speed=[0.1, 0.1]), "speed"),
        (lambda: ToolPath.through(LINE, UP, names=["a"]), "names"),
        (lambda: ToolPath([pp.pose((0.4, 0, 0.2), (0, 0, 0)).homogeneous * 2.0]), "pose"),
    ],
)
def test_unusable_paths_are_refused_by_name(make, words):
    with pytest.raises(pp.InputError, match=words):
        make()


def test_the_tool_points_against_the_normal_and_along_the_path():
    path = ToolPath.through(LINE, (0.0, 0.3, 2.0))
    normal = np.array([0.0, 0.3, 2.0]) / np.hypot(0.3, 2.0)
    assert path.poses[:, :3, 2] == pytest.approx(np.tile(-normal, (5, 1)))
    assert (path.poses[:, 1, 0] > 0.9).all()
    assert np.linalg.det(path.poses[:, :3, :3]) == pytest.approx(1.0)


def test_repeated_poses_become_one_and_a_note_states_them():
    rows = [0, 0, 1, 2, 2, 2, 3, 4]
    path = ToolPath.through(LINE[rows], UP, speed=np.arange(1.0, 8.0) / 10, names="abcdefgh")
    assert (len(path), path.names) == (5, ("a", "c", "d", "g", "h"))
    assert path.speed == pytest.approx([0.2, 0.3, 0.6, 0.7])
    assert path.poses[:, :3, 3] == pytest.approx(LINE)
    assert "3 poses repeat" in path.notes[0]


def test_closed_and_open_paths_are_told_apart():
    a = np.linspace(0, 2 * np.pi, 33)
    circle = np.column_stack([0.4 + 0.1 * np.cos(a), 0.1 * np.sin(a), np.full(33, 0.2)])
    path = ToolPath.through(circle, UP, speed=0.1)
    assert path.closed
    assert path.duration == pytest.approx(path.length / 0.1)
    # The same orientation at both ends, along the tangent
    assert path.poses[0] == pytest.approx(path.poses[-1], abs=1e-12)
    assert path.poses[0, :3, 0] == pytest.approx([0, 1, 0], abs=1e-9)
    assert not ToolPath.through(circle[:-1], UP).closed


def test_a_path_of_one_point_has_a_pose():
    path = ToolPath.through(LINE[:1], UP, speed=0.1)
    assert (len(path), path.length, path.closed) == (1, 0.0, False)
    assert path.poses[0, :3, 2] == pytest.approx([0, 0, -1])
