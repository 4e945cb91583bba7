"""The arms in robots/: made from their tables, equal to the models others publish, and free to move."""

from __future__ import annotations

import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from pinproof.collision import CollisionChecker, Scene
from pinproof.common.files import parse_number
from pinproof.description import DhTable, find_robot
from pinproof.description.ros_files import example_robot_data
from pinproof.model import Arm, dh_to_urdf, load_robot

ROBOTS = Path(__file__).parents[2] / "robots"
HALF = math.pi / 2
UR_HOME = (0, -HALF, HALF, -HALF, -HALF, 0)
# Tool down in front of the arm, elbow up; SOURCE.md of each arm states the same.
HOMES = {
    "generic_6dof": (0, math.pi / 3, -2 * math.pi / 3, -math.pi / 6, HALF, 0),
    "puma560": (0, math.pi / 3, -5 * math.pi / 6, 0, -HALF, 0),
    "stanford": (0, HALF, 0.5, HALF, HALF, 0),
    "scara": (-math.pi / 4, HALF, 0, 0),
    "ur3": UR_HOME,
    "ur5": UR_HOME,
    "ur10": UR_HOME,
    "panda": (0, -math.pi / 4, 0, -3 * math.pi / 4, 0, HALF, math.pi / 4),
    "iiwa14": (0, math.pi / 6, 0, -HALF, 0, math.pi / 3, 0),
    "irb120": (0, 0, 0, 0, HALF, 0),
    "ur3e": UR_HOME,
    "ur5e": UR_HOME,
    "ur10e": UR_HOME,
    "ur16e": UR_HOME,
    "xarm6": (0, -math.pi / 6, -math.pi / 6, 0, math.pi / 3, 0),
    "fr3": (0, -math.pi / 4, 0, -3 * math.pi / 4, 0, HALF, math.pi / 4),
    "crx10ia": (0, 0, 0, 0, -HALF, 0),
    "m0609": (0, 0, HALF, 0, HALF, 0),
    "gen3_lite": tuple(find_robot("gen3_lite").home.values()),
    "jaco2": tuple(find_robot("jaco2").home.values()),
    "piper": tuple(find_robot("piper").home.values()),
}
EVERY_ARM = pytest.mark.parametrize("name", HOMES)


def table_of(name: str) -> DhTable:
    return DhTable.load(ROBOTS / name / "dh.yaml")


@cache
def arm_of(name: str) -> Arm:
    return load_robot(ROBOTS / name / f"{name}.urdf").arm(tcp="tool0")


def test_every_folder_with_a_table_is_on_this_list():
    assert {path.parent.name for path in ROBOTS.glob("*/dh.yaml")} == set(HOMES)


NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


@EVERY_ARM
def test_the_urdf_is_made_from_the_table(name):
    """Word for word, and number for number but for the last digits: sums round otherwise under another NumPy."""
    shipped, made = (ROBOTS / name / f"{name}.urdf").read_text(encoding="utf-8"), dh_to_urdf(table_of(name))
    assert NUMBER.sub("#", shipped) == NUMBER.sub("#", made)
    numbers = ([float(n) for n in NUMBER.findall(text)] for text in (shipped, made))
    np.testing.assert_allclose(*numbers, rtol=0, atol=1e-13)


@EVERY_ARM
def test_the_table_has_the_name_of_its_folder_every_limit_and_the_lengths_of_its_source(name):
    """Each length of the table is in SOURCE.md, so that neither can change alone."""
    assert table_of(name).name == name
    text = (ROBOTS / name / "SOURCE.md").read_text(encoding="utf-8")
    for row in yaml.safe_load((ROBOTS / name / "dh.yaml").read_text(encoding="utf-8"))["rows"]:
        assert parse_number(row["lower"]) < parse_number(row["upper"])
        assert parse_number(row["velocity"]) > 0
        for column in ("d", "a"):
            assert not row[column] or f"{abs(row[column]):.10g}" in text, f"{name}, {row['name']}, {column}"


@EVERY_ARM
def test_home_is_inside_the_limits_free_and_not_singular_and_most_configurations_are_free(name):
    arm, home = arm_of(name), np.array(HOMES[name], dtype=float)
    checker = CollisionChecker(arm, margin=0.002)
    assert arm.limits.contains(home)
    assert checker.check(home).contacts == ()
    assert arm.singularity(home).smallest > 0.1
    np.testing.assert_allclose(arm.forward_kinematics(home).rotation[:, 2], [0, 0, -1], atol=1e-12)
    random = np.random.default_rng(0).uniform(arm.limits.lower, arm.limits.upper, (200, arm.dof))
    # The limits of the FR3 include more configurations with a stretched elbow or a folded hand (SOURCE.md).
    assert checker.with_margin(0.0, {}).is_free_batch(random).mean() > (0.55 if name == "fr3" else 0.65)


# What example-robot-data has too: its file and the frame there that is our tool0. Its UR files round pi/2 to
# 1.57079632679 (5e-12 off); over four joints and a reach of 1.3 m that is all the difference there is.
COMMON = {
    "ur3": ("ur_description/urdf/ur3_robot.urdf", "tool0", 1e-11, 2e-11),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0", 1e-11, 2e-11),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "tool0", 1e-11, 2e-11),
    "panda": ("panda_description/urdf/panda.urdf", "panda_link8", 1e-14, 1e-14),
}


def published(file: str, tcp: str) -> Arm:
    share = example_robot_data()
    if share is None:
        pytest.skip("example-robot-data is not installed")
    return load_robot(share / "example-robot-data" / "robots" / file).arm(tcp=tcp)


@pytest.mark.parametrize("name", COMMON)
def test_our_arm_is_the_one_of_example_robot_data(name):
    """The same joint names, the same zero, the same base and tool: no offset of any kind is allowed for."""
    file, tcp, metres, radians = COMMON[name]
    theirs, ours = published(file, tcp), arm_of(name)
    assert ours.joint_names == theirs.joint_names
    np.testing.assert_allclose(ours.limits.lower, theirs.limits.lower, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.limits.upper, theirs.limits.upper, rtol=0, atol=1e-12)
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, ours.dof)):
        a, b = ours.forward_kinematics(q), theirs.forward_kinematics(q)
        assert np.linalg.norm(a.translation - b.translation) < metres
        assert np.linalg.norm(a.rotation - b.rotation) / math.sqrt(2) < radians


RELATIVES = {
    # The axes of the CB3 arm of the same size are equal; the positions differ by no more than the lengths do.
    "ur3e": ("ur_description/urdf/ur3_robot.urdf", "ur3"),
    "ur5e": ("ur_description/urdf/ur5_robot.urdf", "ur5"),
    "ur10e": ("ur_description/urdf/ur10_robot.urdf", "ur10"),
    "ur16e": ("ur_description/urdf/ur10_robot.urdf", "ur10"),
}


@pytest.mark.parametrize("name", RELATIVES)
def test_an_e_series_arm_has_the_axes_of_its_cb3_relative(name):
    file, older = RELATIVES[name]
    theirs, ours = published(file, "tool0"), arm_of(name)
    pairs = zip(table_of(name).rows, table_of(older).rows, strict=True)
    differences = sum(abs(a.d - b.d) + abs(a.a - b.a) for a, b in pairs)
    assert ours.joint_names == theirs.joint_names
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, ours.dof)):
        a, b = ours.forward_kinematics(q), theirs.forward_kinematics(q)
        assert np.linalg.norm(a.rotation - b.rotation) / math.sqrt(2) < 2e-11
        assert np.linalg.norm(a.translation - b.translation) <= differences


def test_the_fr3_has_the_kinematics_of_the_panda():
    ours, theirs = arm_of("fr3"), load_robot("panda").arm(tcp="panda_link8")
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 7)):
        assert ours.forward_kinematics(q).isApprox(theirs.forward_kinematics(q), 1e-14)


def test_the_xarm6_has_the_forearm_and_wrist_of_the_xarm7():
    """With joint 3 of the xArm 7 at 0 they differ by the place of the elbow: by 1.0 and 8.5 mm."""
    ours, theirs = arm_of("xarm6"), load_robot("xarm7").arm()
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 6)):
        a, b = ours.forward_kinematics(q), theirs.forward_kinematics([q[0], q[1], 0.0, -q[2], *q[3:]])
        assert np.linalg.norm(a.rotation - b.rotation) < 1e-4  # the xArm 7 is written with 1.5708 for pi/2
        assert np.linalg.norm(a.translation - b.translation) == pytest.approx(math.hypot(1e-3, 8.5e-3), abs=1e-5)


# Poses that follow from the makers' drawings by hand: sums of lengths along the axes.
DRAWN = {
    "puma560": ((0, 0, 0, 0, 0, 0), (0.4318 + 0.0203, -0.15005, 0.672 + 0.4318 + 0.05625)),
    "stanford": ((0, 0, 0.5, 0, 0, 0), (0, 0.154, 0.412 + 0.5 + 0.263)),
    "scara": ((0, 0, 0.1, 0), (0.325 + 0.275, 0, 0.387 - 0.1)),
    "ur5": ((0, -HALF, 0, -HALF, 0, 0), (0, 0.10915 + 0.0823, 0.089159 + 0.425 + 0.39225 + 0.09465)),
    "panda": ((0, 0, 0, 0, 0, HALF, 0), (0.107, 0, 0.333 + 0.316 + 0.384 + 0.088)),
    "iiwa14": ((0, 0, 0, 0, 0, 0, 0), (0, 0, 0.36 + 0.42 + 0.4 + 0.126)),
    "irb120": ((0, 0, 0, 0, 0, 0), (0.302 + 0.072, 0, 0.290 + 0.270 + 0.070)),
    "ur5e": ((0, -HALF, 0, -HALF, 0, 0), (0, 0.1333 + 0.0996, 0.1625 + 0.425 + 0.3922 + 0.0997)),
    "xarm6": ((0, 0, 0, 0, 0, 0), (0.0535 + 0.0775 + 0.076, 0, 0.267 + 0.2845 - 0.3425 - 0.097)),
    "fr3": ((0, 0, 0, 0, 0, HALF, 0), (0.107, 0, 0.333 + 0.316 + 0.384 + 0.088)),
}


@pytest.mark.parametrize("name", DRAWN)
def test_the_arm_is_drawn_at_its_configuration(name):
    q, point = DRAWN[name]
    np.testing.assert_allclose(arm_of(name).forward_kinematics(q).translation, point, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["generic_6dof", "panda", "ur5"])
def test_scenes_leave_the_catalogues_home_free(name):
    arm = load_robot(name).arm()
    checker = CollisionChecker(arm, Scene.load(ROBOTS / name / "scene.yaml"), margin=0.002)
    assert checker.check(arm.home).contacts == ()


@pytest.mark.parametrize(
    "name", ["puma560", "stanford", "scara", "iiwa14", "irb120", "ur3e", "ur5e", "ur10e", "ur16e", "xarm6", "fr3"]
)
def test_the_catalogue_knows_our_arms_with_this_home(name):
    arm = load_robot(name).arm()
    assert (arm.tcp, arm.robot.urdf.path) == ("tool0", ROBOTS / name / f"{name}.urdf")
    np.testing.assert_allclose(arm.home, HOMES[name], rtol=0, atol=1e-12)
