"""A checker that leaves more pairs out is the same, to the last byte, as one that was made to."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.errors import UnknownNameError

PICKER = pp.Obstacle("picker", pp.Cylinder(radius=0.02, length=0.1), pp.pose((0, 0, 0.05)))


@pytest.fixture(scope="module")
def cell() -> tuple[pp.Arm, pp.Scene]:
    return pp.load_robot("ur5").arm(tcp="tool0"), pp.Scene.load(robots_folder() / "ur5" / "scene.yaml")


@pytest.mark.parametrize(
    "pairs",
    [
        [("picker", "bolt_1")],
        [("bolt_3", "wrist_3_link"), ("picker", "bolt_3"), ("picker", "table")],
        [("forearm_link", "wrist_3_link")],
        [("upper_arm_link", "picker"), ("shoulder_link", "bolt_7")],
        [("bolt_1", "table")],
        [("base_link", "table"), ("base_link", "shoulder_link")],
        [("picker", "*")],
        [],
    ],
)
def test_it_is_the_same_as_one_that_was_made_so(cell, pairs) -> None:
    arm, scene = cell
    before = [("picker", "bolt_5"), ("wrist_2_link", scene.names[-1])]
    started = pp.CollisionChecker(arm, scene, margin=0.002, attached=[PICKER], allowed=before)
    derived = started.allowing(*pairs)
    made = pp.CollisionChecker(arm, scene, margin=0.002, attached=[PICKER], allowed=[*before, *pairs])
    np.testing.assert_array_equal(derived.world.first_directions, made.world.first_directions)
    np.testing.assert_array_equal(derived.margins, made.margins)
    np.testing.assert_array_equal(derived.still_pairs, made.still_pairs)
    np.testing.assert_array_equal(derived.convex, made.convex)
    assert derived.pairs == made.pairs
    assert derived.excluded == made.excluded
    assert derived.finer == made.finer
    assert derived.fingerprint() == made.fingerprint()
    # and what is derived from it goes on from there
    again, direct = (each.with_scene(scene.remove("bolt_2")) for each in (derived, made))
    assert again.fingerprint() == direct.fingerprint()


def test_names_without_a_body_are_refused(cell) -> None:
    with pytest.raises(UnknownNameError, match="screw"):
        pp.CollisionChecker(*cell).allowing(("screw", "table"))


def test_a_copy_keeps_the_bodies_it_has(cell) -> None:
    arm, scene = cell
    checker = pp.CollisionChecker(arm, scene)
    fewer = checker.with_scene(scene.remove("bolt_2"))
    kept = {id(body) for body in checker.bodies}
    assert all(id(body) in kept for body in fewer.bodies)
