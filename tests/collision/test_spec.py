"""The specification of a checker: a value with the methods of the checker, and the hash of a set-up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision import CheckerSpec

POST = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose(xyz=(0.6, 0, 0.5)))
WALL = pp.Obstacle("wall", pp.Box(0.1, 0.1, 1.0), pp.pose(xyz=(0.6, 0.5, 0.5)))
TOOL = pp.Obstacle("tool", pp.Box(0.05, 0.05, 0.2), pp.pose(xyz=(0, 0, 0.1)))

CHANGES = {
    "scene": lambda of: of.with_scene(pp.Scene([WALL])),
    "attached": lambda of: of.with_attached(TOOL),
    "margin": lambda of: of.with_margin(0.03),
    "padded": lambda of: of.padded(0.01),
    "tolerance": lambda of: of.with_obstacle_tolerance(0.02),
    "allowed": lambda of: of.allowing(("wrist_3_link", "wall")),
}


@pytest.fixture(scope="module")
def spec() -> CheckerSpec:
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    return CheckerSpec(arm, pp.Scene([POST, WALL]), margin=0.002, margins={("forearm_link", "post"): 0.05})


@given(names=st.lists(st.sampled_from(sorted(CHANGES)), min_size=1, max_size=3))
def test_changed_checker_equals_the_checker_of_the_changed_specification(spec: CheckerSpec, names: list[str]) -> None:
    changed, checker = spec, pp.CollisionChecker.of(spec)
    for name in names:
        changed, checker = CHANGES[name](changed), CHANGES[name](checker)
    built = pp.CollisionChecker.of(changed)
    assert checker.fingerprint() == built.fingerprint()
    assert checker.spec.setup_hash() == changed.setup_hash()
    q = np.random.default_rng(0).uniform(-2, 2, (20, 6))
    assert (checker.clearance_batch(q) == built.clearance_batch(q)).all()
    assert (checker.is_free_batch(q) == built.is_free_batch(q)).all()


def test_changes_leave_the_specification_as_it_was(spec: CheckerSpec) -> None:
    before = spec.setup_hash(), dict(spec.margins), spec.margin, spec.allowed, spec.scene.names, spec.attached
    for change in CHANGES.values():
        change(spec)
    assert before == (spec.setup_hash(), dict(spec.margins), spec.margin, spec.allowed, spec.scene.names, spec.attached)


def test_hash_depends_on_the_set_up_and_not_on_margins(spec: CheckerSpec) -> None:
    moved = replace(POST, pose=pp.pose(xyz=(0.6, 0, 0.5000001)))
    others = [
        spec.with_scene(pp.Scene([moved, WALL])),
        spec.with_scene(pp.Scene([POST])),
        spec.with_attached(TOOL),
        replace(spec, arm=pp.load_robot("ur5").arm(tcp="ee_link")),
        replace(spec, arm=pp.load_robot("ur3").arm(tcp="tool0")),
    ]
    assert len({spec.setup_hash(), *(other.setup_hash() for other in others)}) == 6
    assert spec.with_margin(0.1).padded(0.1).setup_hash() == spec.setup_hash()


def test_margin_of_a_removed_obstacle_is_dropped(spec: CheckerSpec) -> None:
    assert not spec.with_scene(pp.Scene([WALL])).margins
    assert spec.with_scene(pp.Scene([POST])).margins == {frozenset(("forearm_link", "post")): 0.05}


@pytest.mark.parametrize(
    "wrong", [{"margin": -0.1}, {"margins": {"post": 0.1}}, {"housing": np.nan}, {"margin": "wide"}]
)
def test_invalid_value_is_refused(spec: CheckerSpec, wrong: dict[str, object]) -> None:
    with pytest.raises(pp.InputError) as caught:
        replace(spec, **wrong)
    assert next(iter(wrong)) in str(caught.value)


def test_pairs_that_were_left_out_are_checked_again_in_the_same_surroundings(spec: CheckerSpec) -> None:
    checker = pp.CollisionChecker.of(spec)
    partial = checker.without_pairs(range(len(checker.pairs)))
    assert partial.pairs == ()
    assert partial.with_scene(checker.scene).pairs == checker.pairs
    assert partial.with_attached().pairs == checker.pairs
