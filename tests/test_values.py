"""Values are equal if their contents are, also after pickling, and pickles of results leave out the checker."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import Attachments, Cone, ConvexShape, HeightMap
from pinproof.common import results
from pinproof.common.results import same_values
from pinproof.ik import IkBranches

LARGEST_RESULT = 8_000
"""Bytes; a checker has several hundred thousand."""


@cache
def parts() -> tuple[pp.Arm, pp.CollisionChecker, pp.JointPath]:
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    scene = pp.Scene([pp.Obstacle("post", pp.Box(0.1, 0.1, 0.1), pp.pose([0.6, 0.4, 0.2]), rgba=(1, 0, 0, 1))])
    return arm, pp.CollisionChecker(arm, scene), pp.JointPath([arm.home, arm.home + 0.2], arm.joint_names)


def cloud() -> pp.PointCloud:
    return pp.PointCloud([[0, 0, 0], [1, 2, 3]], resolution=0.1)


def tetrahedron() -> pp.Mesh:
    return pp.Mesh.from_arrays(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    )


def branches_of(name: str) -> IkBranches:
    arm = pp.load_robot(name).arm()
    return pp.AnalyticIk(position_tolerance=1e-8).solve_all(arm, arm.forward_kinematics(arm.home + 0.1))


VALUES: dict[str, Callable[[], Any]] = {
    "robot": lambda: pp.load_robot("ur5"),
    "arm": lambda: pp.load_robot("ur5").arm(tcp="tool0"),
    "group": lambda: pp.load_robot("baxter_left").arms(),
    "limits": lambda: pp.load_robot("ur5").arm(tcp="tool0").limits,
    "scene": lambda: pp.Scene([pp.Obstacle("post", cloud(), pp.pose([0.6, 0.4, 0.2]))], frame="world"),
    "obstacle": lambda: pp.Obstacle("post", tetrahedron(), pp.pose([0.6, 0.4, 0.2], [0.1, 0.2, 0.3])),
    "attachments": lambda: Attachments([pp.Obstacle("part", pp.Sphere(0.1))], held={"a": 1.0}),
    "box": lambda: pp.Box(1, 2, 3),
    "cone": lambda: Cone(1, 2),
    "hull": lambda: ConvexShape(np.eye(4, 3), radius=0.1),
    "mesh": tetrahedron,
    "cloud": cloud,
    "height map": lambda: HeightMap(np.zeros((3, 3)), 1.0, 1.0),
    "payload": lambda: pp.Payload(2.0, [0, 0, 0.1]),
    "path": lambda: pp.JointPath(np.eye(3), ("a", "b", "c")),
    "trajectory": lambda: pp.time_parametrise(parts()[2], parts()[0].limits),
    "IK branches": lambda: branches_of("ur5"),
    "some IK branches": lambda: branches_of("ur5").free(lambda q: q[0] > 0).free(lambda q: q[4] > 0),
    "IK branches of a redundant arm": lambda: branches_of("iiwa14"),
    "DH table": lambda: pp.urdf_to_dh(parts()[0], convention="standard"),
}

RESULTS: dict[str, Callable[[], Any]] = {
    "IK": lambda: pp.Clik().solve(parts()[0], parts()[0].forward_kinematics(parts()[0].home + 0.1), parts()[0].home),
    "check": lambda: parts()[1].check(parts()[0].home),
    "certificate": lambda: pp.certify(parts()[2], parts()[1]),
    "recorded": lambda: pp.certify(parts()[2], parts()[1], record=True),
    "path plan": lambda: pp.RrtConnect().plan(parts()[1], parts()[0].home, parts()[0].home + 0.3),
    "motion": lambda: pp.plan(parts()[1], parts()[0].home, parts()[0].home + 0.3),
    "failed motion": lambda: pp.plan(parts()[1], parts()[0].home, parts()[0].home + 100.0),
}


@pytest.fixture(params=[*VALUES, *RESULTS])
def value(request: pytest.FixtureRequest) -> Iterator[Any]:
    return {**VALUES, **RESULTS}[request.param]()


def test_a_pickle_is_an_equal_value(value):
    again = pickle.loads(pickle.dumps(value))
    assert again == value
    assert hash(again) == hash(value)
    assert repr(again) == repr(value)


@pytest.mark.parametrize("make", VALUES.values(), ids=VALUES)
def test_equal_contents_are_equal_values(make):
    one, other = make(), make()
    assert one is not other
    assert one == other
    assert len({one, other}) == 1
    assert one != "another"


@pytest.mark.parametrize("make", RESULTS.values(), ids=RESULTS)
def test_a_pickle_of_a_result_is_small(make):
    assert len(pickle.dumps(make())) < LARGEST_RESULT


def test_limits_stay_read_only_after_pickling():
    limits = pickle.loads(pickle.dumps(parts()[0])).limits
    for values in (limits.lower, limits.upper, limits.velocity):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 100.0


def test_other_contents_are_other_values():
    arm, checker, path = parts()
    post = checker.scene["post"]
    moved = checker.scene.move("post", pp.pose([0.6, 0.4, 0.2 + 1e-15]))
    assert checker.scene != moved
    assert post != replace(post, rgba=None)
    assert arm != arm.with_limits(replace(arm.limits, upper=arm.limits.upper + 1e-9))
    assert arm != pp.load_robot("ur5").arm(tcp="wrist_3_link")
    assert arm.robot != pp.load_robot("ur10")
    assert path != pp.JointPath(path.q, tuple("abcdef"))
    assert path != path.reversed()
    assert pp.certify(path, checker) != pp.certify(path, checker, record=True)
    assert tetrahedron() != pp.Mesh.from_arrays(1.5 * tetrahedron().vertices, tetrahedron().triangles)
    assert checker != pp.CollisionChecker(arm, checker.scene)  # by identity


def test_values_in_a_result_are_compared_with_their_types():
    nan, one = np.array([np.nan, 1.0]), {"a": [1, (2.0, np.nan)]}
    assert same_values(nan, nan.copy())
    assert same_values(one, {"a": [1, (2.0, np.nan)]})
    for other in ({"a": [1, [2.0, np.nan]]}, {"a": [1, (2.0, 3.0)]}, {"b": one["a"]}, {"a": [1]}, {}):
        assert not same_values(one, other)
    assert not same_values(np.zeros(2), np.zeros((2, 1)))
    assert not same_values(np.zeros(2), np.zeros(2, dtype=int))
    assert not same_values(1, 1.0)


def test_a_pickled_proof_is_saved_with_its_checker(tmp_path):
    _, checker, path = parts()
    again = pickle.loads(pickle.dumps(pp.certify(path, checker, record=True)))
    with pytest.raises(pp.InputError, match="with_checker"):
        again.save(tmp_path / "proof.json")
    again.with_checker(checker).save(tmp_path / "proof.json")
    assert pp.verify_proof(tmp_path / "proof.json").ok
    with pytest.raises(pp.InputError, match="not for"):
        again.with_checker(pp.CollisionChecker(checker.group))
    for other in (checker.with_margin(0.001), checker.allowing(("wrist_3_link", "post"))):
        with pytest.raises(pp.InputError, match="not for"):
            again.with_checker(other)


@pytest.mark.parametrize("name", ["IK branches", "some IK branches", "IK branches of a redundant arm"])
def test_pickled_branches_are_the_same_solutions(name):
    branches = VALUES[name]()
    again = pickle.loads(pickle.dumps(branches))
    assert len(branches) > 0
    assert np.array_equal(again.q, branches.q)
    assert np.array_equal(again.errors, branches.errors)
    assert (again.complete, again.outside, again.intervals) == (
        branches.complete,
        branches.outside,
        branches.intervals,
    )
    assert branches != branches.free(lambda q: False)


def test_a_pickled_plan_has_no_checker():
    _, checker, path = parts()
    again = pickle.loads(pickle.dumps(pp.RrtConnect().plan(checker, path.q[0], path.q[1])))
    assert again.path == pp.RrtConnect().plan(checker, path.q[0], path.q[1]).path
    with pytest.raises(pp.NoAnswer, match="no checker"):
        _ = again.checker


@pytest.mark.slow
def test_a_pickled_arm_is_found_in_a_dictionary_of_another_process(tmp_path):
    arm = parts()[0]
    known = {arm: "ur5"}  # which makes its hash
    (tmp_path / "arm.pickle").write_bytes(pickle.dumps(arm))
    program = (
        "import pickle, pathlib, sys, pinproof as pp\n"
        "arm = pickle.loads(pathlib.Path(sys.argv[1]).read_bytes())\n"
        "print({pp.load_robot('ur5').arm(tcp='tool0'): 'ur5'}.get(arm))"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "arm.pickle")]
    shown = subprocess.run(
        command, env=os.environ | {"PYTHONHASHSEED": "7"}, capture_output=True, text=True, check=True
    )
    assert shown.stdout.split() == [known[arm]]


def test_equal_arms_are_compared_by_hashes_that_are_made_once(monkeypatch):
    one, other = (pp.load_robot("ur5").arm(tcp="tool0") for _ in range(2))
    assert one == other
    slower = other.with_limits(replace(other.limits, velocity=other.limits.velocity / 2))
    held = pp.load_robot("panda").arm(tcp="panda_hand")
    assert held != held.with_held({"panda_finger_joint1": 0.01})
    assert one != slower
    monkeypatch.setattr(results, "_written", None)
    assert one == other
    assert {one: 1}[other] == 1
