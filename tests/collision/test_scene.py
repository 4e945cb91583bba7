"""Scenes as values: what changes gives a new scene, and what makes no sense is refused."""

from __future__ import annotations

import numpy as np
import pytest

from pinproof import Box, InputError, Obstacle, Scene, Sphere, UnknownNameError, pose


@pytest.fixture
def scene() -> Scene:
    return Scene(
        [Obstacle("table", Box(1, 1, 0.1)), Obstacle("ball", Sphere(0.1), pose((1, 0, 0)), (1, 0, 0, 1))],
        allowed=[("base", "table"), ("tool", "ball")],
        disabled=[("upper", "fore")],
    )


def test_moving_keeps_all_but_the_place_of_one(scene):
    moved = scene.move("ball", pose((0, 2, 0)))
    assert moved.names == scene.names
    assert (moved.allowed, moved.disabled) == (scene.allowed, scene.disabled)
    assert (moved["ball"].shape, moved["ball"].rgba) == (scene["ball"].shape, scene["ball"].rgba)
    np.testing.assert_array_equal(moved["ball"].pose.translation, [0, 2, 0])
    np.testing.assert_array_equal(scene["ball"].pose.translation, [1, 0, 0])
    assert moved.is_close(scene.move("ball", np.array([[1, 0, 0, 0], [0, 1, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])))
    assert not moved.is_close(scene)


def test_adding_and_removing(scene):
    more = scene.add(Obstacle("can", Sphere(0.05)))
    assert more.names == ("table", "ball", "can")
    assert more.allowed == scene.allowed
    fewer = more.remove("ball")
    assert fewer.names == ("table", "can")
    assert fewer.allowed == (("base", "table"),)
    assert fewer.disabled == scene.disabled
    assert scene.names == ("table", "ball")


def test_names_that_are_not_there_are_refused(scene):
    for change in (lambda: scene.move("bal", pose()), lambda: scene.remove("bal"), lambda: scene["bal"]):
        with pytest.raises(UnknownNameError, match="'bal'"):
            change()
    with pytest.raises(InputError, match="named 'ball'"):
        scene.add(Obstacle("ball", Sphere(1)))


@pytest.mark.parametrize("pair", [("base", "base"), "ab", ("a", "b", "c"), ("a", 3)])
def test_an_invalid_pair_is_refused(scene, pair):
    with pytest.raises(InputError):
        Scene(scene.obstacles, disabled=[pair])
