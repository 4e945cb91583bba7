"""Boxes of a scene, whose bodies are made all at once, compared with bodies made one by one."""

import pickle

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.checking.spec import CheckerSpec
from pinproof.collision.geometry.bodies import box_of, shape_body

SIZES = (1e-6, 2.5e-5, 1e-4, 0.1, 1 / 3, 1.0, 12.0, 1e4)


def scene(count: int = 40) -> pp.Scene:
    """Boxes of sizes of all orders of magnitude, and cylinders between some of them."""
    rng = np.random.default_rng(1)
    things = []
    for i in range(count):
        shape = pp.Cylinder(radius=0.1, length=0.3) if i % 7 == 3 else pp.Box(*rng.choice(SIZES, 3))
        things.append(
            pp.Obstacle(f"thing '{i}' é", shape, pp.pose(xyz=rng.uniform(-9, 9, 3), rpy=rng.uniform(-2, 2, 3)))
        )
    return pp.Scene(things)


@pytest.fixture(scope="module")
def checked(ur5) -> pp.CollisionChecker:
    return pp.CollisionChecker(ur5, scene())


def test_boxes_made_together_are_those_made_one_by_one(checked: pp.CollisionChecker) -> None:
    boxes = [thing for thing in checked.scene.obstacles if isinstance(thing.shape, pp.Box)]
    assert len(boxes) > 30
    for thing in boxes:
        made, alone = box_of(thing), shape_body(thing.name, thing.name, None, thing.shape, thing.pose)
        assert made is not None
        assert made in checked.bodies
        assert made.content() == alone.content()
        assert made.extent == alone.extent
        assert (made.core_obstacle.joint_from_body == alone.core_obstacle.joint_from_body).all()
        assert made.core_obstacle.shape.ball == alone.core_obstacle.shape.ball
        assert not made.box.flags.writeable


def test_the_hash_of_a_setup_does_not_depend_on_whether_a_checker_was_made(ur5, checked: pp.CollisionChecker) -> None:
    assert checked.spec.setup_hash() == CheckerSpec(ur5, scene()).setup_hash()
    moved = checked.scene.move(checked.scene.names[0], pp.pose(xyz=(0.0, 0.0, 5.0)))
    assert checked.spec.setup_hash() != CheckerSpec(ur5, moved).setup_hash()


def test_boxes_are_pickled_without_their_bodies(ur5, checked: pp.CollisionChecker) -> None:
    again = pickle.loads(pickle.dumps(checked))
    Q = np.random.default_rng(2).uniform(-2, 2, (200, 6))
    assert again.fingerprint() == checked.fingerprint()
    assert (again.is_free_batch(Q) == checked.is_free_batch(Q)).all()
    assert all(box_of(thing) is None for thing in again.scene.obstacles)
