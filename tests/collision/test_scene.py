"""Scenes as values: what changes gives a new scene, and what makes no sense is refused."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Mapping

import numpy as np
import pytest

from pinproof import Box, CollisionChecker, InputError, Obstacle, Scene, Sphere, UnknownNameError, pose


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


def test_a_scene_is_a_mapping_of_names_to_obstacles(scene):
    same = dict(zip(scene.names, scene.obstacles, strict=True))
    assert dict(scene) == dict(scene.items()) == same
    assert (list(scene), len(scene), list(scene.values())) == (list(same), 2, list(same.values()))
    assert isinstance(scene, Mapping)
    assert not Scene()
    for name in ("ball", "bal", None, 3):
        assert (name in scene, scene.get(name), scene.get(name, 5)) == (name in same, same.get(name), same.get(name, 5))
    with pytest.raises(KeyError):
        scene["bal"]
    again = pickle.loads(pickle.dumps(scene))
    assert list(again) == list(scene)
    assert again.is_close(scene)
    assert again != scene  # as of obstacles: poses are equal within a tolerance only
    assert len({scene: 1, again: 2}) == 2


class _Name(str):
    """A name that counts how often it is compared with another name."""

    compared = 0
    __hash__ = str.__hash__

    def __eq__(self, other: object) -> bool:
        _Name.compared += 1
        return str.__eq__(self, other)


def test_the_work_for_a_large_scene_grows_with_its_number_of_obstacles(generic_6dof):
    """Comparisons of names, and calls in Python, for 200 and for 800 boxes: 4 times as many, where n^2 has 16."""

    def work(count: int) -> tuple[int, int]:
        names = [_Name(f"box {i}") for i in range(count)]
        boxes = [Obstacle(name, Box(0.01, 0.01, 0.01), pose((2 + i / count, 0, 0))) for i, name in enumerate(names)]
        calls, _Name.compared = [0], 0

        def count_call(*_: object) -> None:
            calls[0] += 1

        sys.setprofile(count_call)
        try:
            scene = Scene(boxes, allowed=[(generic_6dof.base, name) for name in names])
            more = scene.add(Obstacle("ball", Sphere(0.1))).move("ball", pose((3, 0, 0)))
            left = more.remove(*names[::2])
            placed = [left[name] for name in names[1::2] if name in left and left.get(name)]
            checker = CollisionChecker(generic_6dof, scene).with_scene(left)
        finally:
            sys.setprofile(None)
        assert placed == boxes[1::2]
        assert list(checker.scene) == [*names[1::2], "ball"]
        return calls[0], _Name.compared

    work(10)  # imports and caches
    (few_calls, few_compared), (calls, compared) = work(200), work(800)
    assert calls < 6 * few_calls
    assert compared < 6 * max(few_compared, 200)


def test_a_scene_of_20_000_boxes_is_changed_and_restored(tmp_path):
    boxes = [Obstacle(f"box {i}", Box(0.01, 0.02, 0.03), pose((i / 1000, 0, 0))) for i in range(20_000)]
    scene = Scene(boxes)
    assert (len(scene), scene["box 19999"]) == (20_000, boxes[-1])
    assert list(scene.remove(*scene.names[::2]).values()) == boxes[1::2]
    few = scene.remove(*scene.names[:19_000])
    few.save(tmp_path / "scene.yaml")
    assert Scene.load(tmp_path / "scene.yaml").is_close(few)


@pytest.mark.parametrize("pair", [("base", "base"), "ab", ("a", "b", "c"), ("a", 3)])
def test_an_invalid_pair_is_refused(scene, pair):
    with pytest.raises(InputError):
        Scene(scene.obstacles, disabled=[pair])
