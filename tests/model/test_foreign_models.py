"""Robots from objects of other libraries equal those from their URDF, and models that no file describes are loaded."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest
import yourdfpy

import pinproof as pp
from pinproof.description.catalogue import find_robot

ROBOTS = (
    "ur3", "ur5", "ur10", "ur3_gripper", "ur5_gripper", "panda", "xarm7", "z1", "kinova", "asr_twodof"
)  # fmt: skip


@cache
def models(name: str) -> tuple[Any, Any]:
    """The pinocchio.Model and the collision geometry of a robot of example-robot-data."""
    file = find_robot(name).urdf
    folders = [str(folder) for folder in file.parents]
    model = pin.buildModelFromUrdf(str(file))
    return model, pin.buildGeomFromUrdf(model, str(file), pin.GeometryType.COLLISION, package_dirs=folders)


@cache
def pair(name: str) -> tuple[pp.Arm, pp.Arm]:
    """The arm from the URDF, and that from the model alone."""
    entry = find_robot(name)
    model, geometry = models(name)
    arm = pp.load_robot(entry.urdf, srdf=entry.srdf).arm(entry.tcp, base=entry.base)
    other = pp.load_robot(model, geometry_model=geometry, srdf=entry.srdf)
    return arm, other.arm(arm.tcp, base=arm.base, held=arm.held)


@cache
def checkers(name: str) -> tuple[pp.CollisionChecker, pp.CollisionChecker]:
    scene = pp.Scene([pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose([0.35, 0.3, 0.3]))])
    arm, other = pair(name)
    return pp.CollisionChecker(arm, scene), pp.CollisionChecker(other, scene)


def samples(arm: pp.Arm, count: int) -> npt.NDArray[np.float64]:
    return np.random.default_rng(1).uniform(*arm.limits.sampling_range(), size=(count, arm.dof))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_model_has_the_kinematics_of_its_urdf(name):
    arm, other = pair(name)
    assert set(arm.robot.urdf.links) == set(other.robot.urdf.links)
    assert arm.joint_names == other.joint_names
    for limit in ("lower", "upper", "velocity", "torque"):
        np.testing.assert_array_equal(getattr(arm.limits, limit), getattr(other.limits, limit))
    q = samples(arm, 20)
    np.testing.assert_allclose(arm.forward_kinematics_batch(q), other.forward_kinematics_batch(q), atol=1e-12, rtol=0)
    np.testing.assert_allclose(arm.jacobian_batch(q), other.jacobian_batch(q), atol=1e-12, rtol=0)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_model_has_the_ik_and_the_torques_of_its_urdf(name):
    arm, other = pair(name)
    start, goal = samples(arm, 2)
    solved = [pp.Clik().solve(each, each.forward_kinematics(goal), start) for each in (arm, other)]
    assert solved[0].ok
    assert solved[1].ok
    np.testing.assert_allclose(solved[0].q, solved[1].q, atol=1e-12, rtol=0)
    np.testing.assert_allclose(arm.torques(start, 1.0, 1.0), other.torques(start, 1.0, 1.0), atol=1e-12, rtol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_model_has_the_checks_and_certificates_of_its_urdf(name):
    checker, other = checkers(name)
    assert {frozenset(pair.owners) for pair in checker.excluded} == {frozenset(pair.owners) for pair in other.excluded}
    q = samples(checker.group, 40)
    np.testing.assert_array_equal([checker.is_free(each) for each in q], [other.is_free(each) for each in q])
    np.testing.assert_allclose(
        [checker.clearance(each) for each in q], [other.clearance(each) for each in q], atol=1e-12, rtol=0
    )
    home = checker.group.home
    for goal in q[:4]:
        path = pp.JointPath([home, home + 0.5 * (goal - home)], checker.group.joint_names)
        proofs = pp.certify(path, checker), pp.certify(path, other)
        assert proofs[0].status == proofs[1].status
        np.testing.assert_allclose(proofs[0].clearance, proofs[1].clearance, atol=1e-12, rtol=0)


# -- a model that no file describes ------------------------------------------------------------------------------------

LEAN = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.4, 0.2), np.array([0.05, 0.1, 0.3]))


@pytest.fixture(scope="module")
def built() -> tuple[Any, Any]:
    """Three joints, one about an unaligned axis, one prismatic, one continuous; a base beside the universe."""
    model = pin.Model()
    model.name = "built"
    limits = [np.full(1, value) for value in (50.0, 2.0, -1.5, 1.5)]
    lift = [np.full(1, value) for value in (200.0, 0.5, 0.0, 0.4)]
    axis = np.array([1.0, 2.0, 2.0]) / 3
    turn = model.addJoint(0, pin.JointModelRevoluteUnaligned(axis), LEAN, "turn", *limits)
    slide = model.addJoint(turn, pin.JointModelPY(), LEAN, "slide", *lift)
    spin = model.addJoint(slide, pin.JointModelRUBX(), LEAN, "spin")
    model.appendBodyToJoint(turn, pin.Inertia.Random(), LEAN)
    model.appendBodyToJoint(slide, pin.Inertia.Random(), LEAN)
    model.appendBodyToJoint(spin, pin.Inertia.Random(), LEAN)
    base = model.addBodyFrame("stand", 0, LEAN, 0)
    upper = model.addBodyFrame("upper", turn, LEAN, base)
    model.addJointFrame(slide, upper)
    model.addFrame(pin.Frame("tool", spin, 0, LEAN, pin.FrameType.OP_FRAME))
    model.jointPlacements[slide] = LEAN * LEAN  # after its parts were added
    geometry = pin.GeometryModel()
    block = coal.Box(0.2, 0.1, 0.1)
    hull = coal.Convex.convexHull(points(np.random.default_rng(3).uniform(-0.06, 0.06, (30, 3))), True, "Qt")
    for name, joint, frame, shape in (
        ("stand_box", 0, base, block), ("upper_mesh", turn, upper, tetrahedron()), ("slide_hull", slide, 0, hull),
        ("capsule", spin, 0, rounded(coal.Capsule(0.03, 0.2), 0.01)), ("box", spin, 0, rounded(block, 0.02)),
        ("cylinder", spin, 0, rounded(coal.Cylinder(0.05, 0.2), 0.02)),
        ("ball", spin, 0, rounded(coal.Sphere(0.1), 0.01)),
    ):  # fmt: skip
        geometry.addGeometryObject(pin.GeometryObject(name, joint, frame, LEAN, shape))
    return model, geometry


def points(rows: npt.NDArray[np.float64]) -> Any:
    made = coal.StdVec_Vec3s()
    made.extend(list(rows))
    return made


def rounded(shape: Any, radius: float) -> Any:
    shape = shape.clone()
    shape.setSweptSphereRadius(radius)
    return shape


def tetrahedron() -> Any:
    made = coal.BVHModelOBBRSS()
    made.beginModel(4, 4)
    made.addVertices(0.15 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]))
    made.addTriangles(np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    made.endModel()
    return made


def test_a_model_built_by_a_program_has_its_own_kinematics(built):
    model, geometry = built
    arm = pp.load_robot(model, geometry_model=geometry).arm("tool")
    assert arm.joint_names == ("turn", "slide", "spin")
    assert [joint.type for joint in arm.robot.urdf.joints.values() if joint.type != "fixed"] == [
        "revolute", "prismatic", "continuous",
    ]  # fmt: skip
    np.testing.assert_array_equal(arm.limits.lower, [-1.5, 0.0, -np.inf])
    np.testing.assert_array_equal(arm.limits.velocity, [2.0, 0.5, np.nan])
    data = model.createData()
    for q in samples(arm, 20):
        own = np.array([q[0], q[1], np.cos(q[2]), np.sin(q[2])])
        pin.framesForwardKinematics(model, data, own)
        for frame in ("tool", "upper", "stand"):
            expected = data.oMf[model.getFrameId(frame)]
            assert arm.root_from_frame(q, frame).isApprox(expected, 1e-12)
        torque = pin.rnea(model, data, own, np.ones(3), np.ones(3))
        np.testing.assert_allclose(arm.torques(q, 1.0, 1.0), torque, atol=1e-10)


@pytest.mark.parametrize("thing", ["upper_mesh", "slide_hull", "capsule", "box", "cylinder", "ball"])
def test_a_body_of_a_model_built_by_a_program_contains_its_geometry(built, thing):
    model, everything = built
    geometry = pin.GeometryModel()
    geometry.addGeometryObject(everything.geometryObjects[everything.getGeometryId(thing)])
    places = np.random.default_rng(2).uniform([-0.5, -0.5, 0.0], [0.8, 0.8, 1.2], (30, 3))
    scene = pp.Scene([pp.Obstacle(f"ball {i}", pp.Sphere(0.05), pp.pose(place)) for i, place in enumerate(places)])
    checker = pp.CollisionChecker(pp.load_robot(model, geometry_model=geometry).arm("tool"), scene)
    placed, data, gaps = geometry.createData(), model.createData(), []
    for q in samples(checker.group, 40):
        pin.updateGeometryPlacements(model, data, geometry, placed, np.array([*q[:2], np.cos(q[2]), np.sin(q[2])]))
        at = coal.Transform3s(placed.oMg[0].rotation, placed.oMg[0].translation)
        by_coal = min(
            coal.distance(
                geometry.geometryObjects[0].geometry, at, coal.Sphere(0.05), coal.Transform3s(np.eye(3), place),
                coal.DistanceRequest(), coal.DistanceResult(),
            )
            for place in places
        )  # fmt: skip
        assert checker.is_free(q) <= (by_coal > 0)
        if by_coal > 0.02:
            gaps.append(by_coal - checker.clearance(q))
    assert len(gaps) > 5
    assert min(gaps) > -1e-6  # GJK
    rounding = 0.02 * (3**0.5 - 1) if thing in ("box", "cylinder") else 0.0
    assert max(gaps) < rounding + 1e-6


def test_a_changed_mesh_is_not_that_of_its_file():
    model, geometry = models("panda")
    changed = geometry.copy()
    finger = changed.geometryObjects[changed.getGeometryId("panda_leftfinger_0")]
    finger.geometry = tetrahedron()
    robot = pp.load_robot(model, geometry_model=changed)
    files = {each.link: each.mesh.path for each in robot.urdf.collisions if each.mesh is not None}
    assert files["panda_leftfinger"].suffix == ".ply"
    assert files["panda_link4"].name == "link4.stl"


def test_a_model_keeps_its_mimic_joints(zoo_text, tmp_path):
    model = pin.buildModelFromXML(zoo_text, mimic=True)
    arm, other = (pp.load_robot(source).arm("tool") for source in (zoo_text, model))
    assert {name: joint.mimic for name, joint in other.robot.urdf.joints.items()} == {
        name: joint.mimic for name, joint in arm.robot.urdf.joints.items()
    }
    for q in samples(arm, 10):
        for frame in ("tool", "rod_link"):
            assert arm.root_from_frame(q, frame).isApprox(other.root_from_frame(q, frame), 1e-12)
    other.robot.save_urdf(tmp_path / "zoo.urdf")
    again = pp.load_robot(tmp_path / "zoo.urdf").arm("tool")
    assert again.forward_kinematics(again.home).isApprox(other.forward_kinematics(again.home), 1e-12)


GEARED = """<robot name="gears"><link name="base"/><link name="wheel"/><link name="pinion"/>
<joint name="turn" type="{leader}"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="follow" type="{follower}"><parent link="wheel"/><child link="pinion"/><origin xyz="0.1 0 0.2"/>
<axis xyz="0.6 0 0.8"/><limit lower="-99" upper="99" velocity="1" effort="1"/>
<mimic joint="turn" multiplier="{factor}" offset="0.3"/></joint></robot>"""


@pytest.mark.parametrize("factor", [50.0, 10.0, 7.0, -7.0, -2.5, 0.1, 0.001])
@pytest.mark.parametrize(
    ("leader", "follower"), [("revolute", "revolute"), ("revolute", "prismatic"), ("continuous", "continuous")]
)
def test_a_mimic_joint_of_a_model_follows_by_any_factor(leader, follower, factor):
    model = pin.buildModelFromXML(GEARED.format(leader=leader, follower=follower, factor=factor), mimic=True)
    arm, data = pp.load_robot(model).arm("wheel"), model.createData()
    for angle in np.linspace(-1.0, 1.0, 9):
        q = np.array([angle] if model.nq == 1 else [np.cos(angle), np.sin(angle)])
        pin.framesForwardKinematics(model, data, q)
        expected = data.oMf[model.getFrameId("pinion")]
        assert arm.root_from_frame([angle], "pinion").isApprox(expected, 1e-9)


def test_a_mimic_joint_of_a_model_with_the_factor_0_is_refused_by_name():
    model = pin.buildModelFromXML(GEARED.format(leader="revolute", follower="revolute", factor=0), mimic=True)
    with pytest.raises(pp.InputError, match=r"'follow'.*multiplier 0"):
        pp.load_robot(model)


@pytest.mark.parametrize("kind", ["Spherical", "FreeFlyer", "HX", "Planar", "Universal"])
def test_a_joint_with_more_freedom_is_refused_by_name(kind):
    model = pin.Model()
    joint = getattr(pin, f"JointModel{kind}")
    made = joint(np.array([1.0, 0, 0]), np.array([0, 1.0, 0])) if kind == "Universal" else joint()
    model.addJoint(0, made, pin.SE3.Identity(), "shoulder")
    with pytest.raises(pp.InputError, match=f"'shoulder'.*JointModel{kind}"):
        pp.load_robot(model)


@pytest.mark.parametrize("shape", [coal.Cone(0.1, 0.2), coal.Plane(), coal.Halfspace(), coal.BVHModelOBBRSS()])
def test_geometry_that_a_link_cannot_have_is_refused_by_name(built, shape):
    model, _ = built
    geometry = pin.GeometryModel()
    geometry.addGeometryObject(pin.GeometryObject("horn", 1, LEAN, shape))
    with pytest.raises(pp.InputError, match="horn"):
        pp.load_robot(model, geometry_model=geometry)


# -- yourdfpy and robot_descriptions -----------------------------------------------------------------------------------


def test_a_changed_yourdfpy_robot_is_loaded_as_it_is():
    file = find_robot("panda").urdf
    source = yourdfpy.URDF.load(str(file), load_meshes=False, build_scene_graph=True)
    source.joint_map["panda_joint4"].origin = LEAN.homogeneous
    arm = pp.load_robot(source, package_dirs=[file.parents[4]]).arm("panda_hand_tcp")
    reference = pp.load_robot("panda").arm()
    assert [each.mesh for each in arm.robot.urdf.collisions] != []
    assert all(each.mesh.path is not None for each in arm.robot.urdf.collisions if each.mesh is not None)
    q = reference.home
    between = reference.frame_placement(q, "panda_link3").actInv(reference.frame_placement(q, "panda_link4"))
    moved = arm.frame_placement(q, "panda_link3").actInv(arm.frame_placement(q, "panda_link4"))
    assert moved.isApprox(LEAN * pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, q[3]), np.zeros(3)), 1e-12)
    assert not moved.isApprox(between, 1e-3)


def test_a_yourdfpy_robot_keeps_its_mimic_joints(tmp_path):
    file = tmp_path / "gears.urdf"
    file.write_text(GEARED.format(leader="revolute", follower="revolute", factor=-2.5))
    source = yourdfpy.URDF.load(str(file), load_meshes=False, build_scene_graph=True)
    arm, other = (pp.load_robot(each).arm("wheel") for each in (file, source))
    assert other.root_from_frame([0.7], "pinion").isApprox(arm.root_from_frame([0.7], "pinion"), 1e-12)
    source.joint_map["follow"].mimic.multiplier = 3.0
    assert pp.load_robot(source).urdf.joints["follow"].mimic.multiplier == 3.0


@pytest.fixture
def descriptions(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A module with the attributes of one of robot_descriptions, whose files are those of example-robot-data."""
    entry = find_robot("panda")
    package, module = ModuleType("robot_descriptions"), ModuleType("robot_descriptions.arm_description")
    package.DESCRIPTIONS = {"arm_description": None}  # type: ignore[attr-defined]
    files = {"URDF_PATH": entry.urdf, "SRDF_PATH": entry.srdf, "PACKAGE_PATH": entry.urdf.parents[1]}
    for name, path in {**files, "REPOSITORY_PATH": entry.urdf.parents[3]}.items():
        setattr(module, name, str(path))
    monkeypatch.setitem(sys.modules, "robot_descriptions", package)
    monkeypatch.setitem(sys.modules, "robot_descriptions.arm_description", module)
    return module


def test_robot_descriptions_are_loaded_by_module_and_by_name(descriptions):
    for source in (descriptions, "arm_description"):
        robot = pp.load_robot(source)
        assert robot.urdf.path == find_robot("panda").urdf
        assert robot.srdf.path == find_robot("panda").srdf
    with pytest.raises(pp.UnknownNameError, match="arm_description"):
        pp.load_robot("arn_description")


def test_without_robot_descriptions_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    with pytest.raises(pp.InputError, match="pip install robot_descriptions"):
        pp.load_robot("ur5_description")


# -- errors ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("source", [3, None, object(), {"robot": "ur5"}, Path])
def test_another_object_is_refused_with_what_is_accepted(source):
    with pytest.raises(pp.InputError, match=r"catalogue.*pinocchio\.Model.*yourdfpy"):
        pp.load_robot(source)


def test_a_wrapped_model_is_refused_with_the_call_to_write():
    with pytest.raises(pp.InputError, match=r"geometry_model=x\.collision_model"):
        pp.load_robot(SimpleNamespace(model=pin.Model(), collision_model=pin.GeometryModel()))


def test_a_geometry_model_belongs_to_a_model():
    with pytest.raises(pp.InputError, match="geometry_model"):
        pp.load_robot("ur5", geometry_model=pin.GeometryModel())
    with pytest.raises(pp.InputError, match="geometry_model"):
        pp.load_robot(pin.Model(), geometry_model="ur5")
