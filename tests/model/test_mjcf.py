"""MJCF: frames agree with the readers of Pinocchio and MuJoCo; unsupported content is an error with its line."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.spatial import matrix

from ..examples import examples

pytestmark = pytest.mark.slow  # the import of mujoco starts processes that search libraries

ARM = """<mujoco model="arm">
  <compiler angle="degree" meshdir="assets"/>
  <default>
    <joint axis="0 1 0" range="-90 90"/>
    <geom rgba="0.5 0.5 0.5 1"/>
    <default class="wrist"><joint axis="1 0 0" range="-180 90"/>
      <default class="hand"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default></default>
  </default>
  <asset><mesh file="hand.stl" scale="0.001 0.001 0.001"/></asset>
  <worldbody>
    <body name="base" pos="0.1 0.2 0.3" euler="10 20 30">
      <geom type="box" size="0.1 0.2 0.05"/>
      <body name="upper" pos="0 0 0.2" quat="0.8 0 0.6 0">
        <joint name="shoulder" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.04"/>
        <body name="fore" pos="0.3 0 0" axisangle="0 0.6 0.8 40">
          <joint name="elbow" pos="0.02 0 -0.03"/>
          <geom type="cylinder" size="0.03 0.15" pos="0 0 0.15" group="3"/>
          <body name="slider" pos="0 0 0.3" xyaxes="0 1 0 -1 0 0.2" childclass="wrist">
            <joint name="slide" type="slide" range="-0.1 0.2"/>
            <body name="hand" pos="0 0.05 0" zaxis="1 0 1">
              <joint name="roll"/>
              <geom class="hand" mesh="hand"/><geom type="sphere" size="0.02 7 7"/>
              <site name="tcp" pos="0 0 0.1" euler="0 90 0"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="base" body2="fore"/></contact>
  <keyframe><key name="home" qpos="0.1 0.2 0.05 -0.3"/></keyframe>
  <actuator><motor joint="elbow"/></actuator>
</mujoco>"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mjcf")
    (folder / "assets").mkdir()
    trimesh.creation.box(bounds=[[0, 0, 0], [100, 200, 300]]).export(folder / "assets" / "hand.stl")
    (folder / "arm.xml").write_text(ARM)
    return folder / "arm.xml"


@pytest.fixture(scope="module")
def arm(file):
    return pp.load_robot(file).arm("tcp")


def pinocchio_placement(model, arm, q, frame):
    data, values = model.createData(), pin.neutral(model)
    for name, value in zip(arm.joint_names, q, strict=True):
        values[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, values)
    return data.oMf[model.getFrameId(frame)].homogeneous


@examples(20)
@given(seed=st.integers(0, 2**32 - 1))
def test_bodies_have_the_poses_of_pinocchio(file, arm, seed):
    model = pin.buildModelFromMJCF(str(file))
    q = np.random.default_rng(seed).uniform(arm.limits.lower, arm.limits.upper)
    # Pinocchio sets the first body on the origin, whatever its pose: compared is what stands on that body. And it does
    # not bring an axisangle's axis to length 1, which shears the robot: the file has a unit one.
    world_from_base = arm.frame_placement(q, "base")
    assert world_from_base.isApprox(pp.pose((0.1, 0.2, 0.3)) * pin.SE3(euler(10, 20, 30), np.zeros(3)), 1e-12)
    for frame in ("base", "upper", "fore", "slider", "hand"):
        ours = matrix(world_from_base.actInv(arm.frame_placement(q, frame)))
        np.testing.assert_allclose(ours, pinocchio_placement(model, arm, q, frame), atol=1e-9, err_msg=frame)


def test_joints_have_their_classes_limits_in_radians_and_metres(arm):
    assert arm.joint_names == ("shoulder", "elbow", "slide", "roll")
    np.testing.assert_allclose(arm.limits.lower, [-np.pi / 2, -np.pi / 2, -0.1, -np.pi])
    np.testing.assert_allclose(arm.limits.upper, [np.pi / 2, np.pi / 2, 0.2, np.pi / 2])
    assert np.isnan(arm.limits.velocity).all()


def test_geoms_are_full_sizes_and_visuals_do_not_collide(arm):
    urdf = arm.robot.urdf
    sizes = {(geom.link, geom.kind): geom.size for geom in urdf.collisions}
    assert sizes == {
        ("base", "box"): (0.2, 0.4, 0.1),
        ("upper", "capsule"): (0.04, 0.3),
        ("fore", "cylinder"): (0.03, 0.3),
        ("hand", "sphere"): (0.02,),
    }
    assert {(geom.link, geom.kind) for geom in urdf.visuals} == {
        ("base", "box"), ("upper", "capsule"), ("hand", "mesh"), ("hand", "sphere")
    }  # fmt: skip
    (mesh,) = [geom for geom in urdf.visuals if geom.kind == "mesh"]
    assert mesh.mesh.path.name == "hand.stl"
    assert mesh.size == (0.001, 0.001, 0.001)
    (capsule,) = [geom for geom in urdf.collisions if geom.kind == "capsule"]
    np.testing.assert_allclose(capsule.origin[:3, 3], [0.15, 0, 0])
    np.testing.assert_allclose(np.abs(capsule.origin[:3, 2]), [1, 0, 0], atol=1e-12)
    pp.CollisionChecker(arm).check(arm.home)


def test_keyframes_are_states_and_excluded_contacts_disabled_pairs(arm):
    assert arm.state("home").tolist() == [0.1, 0.2, 0.05, -0.3]
    assert [pair.links for pair in arm.robot.srdf.disabled] == [("base", "fore")]


@examples(30)
@given(
    sequence=st.sampled_from(["xyz", "zyx", "XYZ", "ZYX", "xzx", "zyz"]),
    angles=st.tuples(*[st.floats(-3, 3)] * 3),
    anchors=st.lists(st.tuples(*[st.floats(-0.5, 0.5)] * 3), min_size=1, max_size=3),
    turns=st.tuples(*[st.floats(-2, 2)] * 3),
)
def test_several_joints_with_anchors_in_one_body(tmp_path_factory, sequence, angles, anchors, turns):
    joints = "".join(
        f'<joint name="j{i}" pos="{x!r} {y!r} {z!r}" axis="{(i == 0):d} {(i == 1):d} {(i == 2):d}"/>'
        for i, (x, y, z) in enumerate(anchors)
    )
    roll, pitch, yaw = angles
    path = tmp_path_factory.mktemp("m") / "m.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian" eulerseq="{sequence}"/><worldbody>'
        f'<body name="b" pos="1 2 3" euler="{roll!r} {pitch!r} {yaw!r}">{joints}<geom size="0.1"/></body>'
        "</worldbody></mujoco>"
    )
    arm = pp.load_robot(path).arm("b")
    expected = pp.pose((1, 2, 3)).homogeneous
    for letter, angle in zip(sequence, angles, strict=True):
        turn = axis_turn("xyz".index(letter.lower()), angle)
        # lower case: about the moving axes, from the right; upper case: about the fixed ones, from the left
        expected[:3, :3] = expected[:3, :3] @ turn if sequence.islower() else turn @ expected[:3, :3]
    for i, (anchor, angle) in enumerate(zip(anchors, turns, strict=False)):
        move = np.eye(4)
        move[:3, :3] = axis_turn(i, angle)
        move[:3, 3] = anchor - move[:3, :3] @ anchor
        expected = expected @ move
    found = matrix(arm.forward_kinematics(turns[: len(anchors)]))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def euler(*degrees):
    """About the moving axes x, y, z in turn."""
    return np.linalg.multi_dot([axis_turn(axis, np.deg2rad(angle)) for axis, angle in enumerate(degrees)])


def axis_turn(axis, angle):
    return pin.AngleAxis(angle, np.eye(3)[axis]).toRotationMatrix()


def test_hinge_without_range_is_continuous_and_an_equality_is_a_mimic(tmp_path):
    (tmp_path / "m.xml").write_text(
        '<mujoco><worldbody><body name="a"><joint name="j" type="hinge"/><geom size="0.1"/><body name="b" pos="1 0 0">'
        '<joint name="k" type="slide" axis="1 0 0" range="0 1"/><geom size="0.1"/></body></body></worldbody>'
        '<equality><joint joint1="k" joint2="j" polycoef="0.1 0.2 0 0 0"/><weld active="false" body1="a" body2="b"/>'
        "</equality></mujoco>"
    )
    arm = pp.load_robot(tmp_path / "m.xml").arm("b")
    assert arm.joint_names == ("j",)
    assert arm.robot.urdf.joints["j"].type == "continuous"
    np.testing.assert_allclose(arm.forward_kinematics([0.5]).translation, 1.2 * np.array([np.cos(0.5), np.sin(0.5), 0]))


PARTS = """<mujoco model="parts">
  <compiler meshdir="assets"/>
  <asset><mesh name="hand" file="hand.stl" scale="0.001 0.002 0.001"/><model name="arm" file="arm.xml"/></asset>
  <include file="base.xml"/>
  <worldbody>
    <frame pos="1 0 0" euler="0 0 90">
      <body name="post"><geom type="mesh" mesh="hand" pos="0.1 0.2 0.3" euler="20 30 40"/>
        <joint name="lift" type="slide" range="0 1"/><geom type="box" mesh="hand" pos="0 0 1"/>
        <frame pos="0 0 0.5"><attach model="arm" body="base" prefix="left_"/></frame></body></frame>
    <replicate count="2" offset="0 0.5 0" euler="0 0 30">
      <body name="pin" pos="0 2 0"><geom type="capsule" fromto="0 0 0 0.1 0.2 0.3" size="0.02"/></body>
    </replicate>
  </worldbody></mujoco>"""
BASE = """<mujoco><default><joint axis="0 0 1"/></default><worldbody><body name="turntable" pos="0 -1 0">
  <joint name="turn"/><geom type="cylinder" size="0.1 0.05"/></body></worldbody></mujoco>"""


def test_included_attached_framed_and_replicated_bodies_have_the_poses_and_shapes_of_mujoco(file):
    import mujoco

    (file.parent / "parts.xml").write_text(PARTS)
    (file.parent / "base.xml").write_text(BASE)
    robot = pp.load_robot(file.parent / "parts.xml")
    spec = mujoco.MjSpec.from_file(str(file.parent / "parts.xml"))
    spec.body("left_slider").mass, spec.body("left_slider").inertia = 1.0, np.ones(3)  # it has no geom
    model = spec.compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    names = [model.joint(i).name for i in range(model.njnt)]
    assert {"turn", "lift", "left_elbow"} < set(names)
    for _ in range(5):
        data.qpos = rng.uniform(*np.where(model.jnt_limited, model.jnt_range.T, [[-3], [3]]))
        mujoco.mj_kinematics(model, data)
        values = dict(zip(names, data.qpos.tolist(), strict=True))
        arm = robot.arm("left_hand").with_held({"turn": values["turn"]})
        q = np.array([values[name] for name in arm.joint_names])
        for i in range(1, model.nbody):
            pose = matrix(arm.frame_placement(q, model.body(i).name or f"body_{i}"))
            np.testing.assert_allclose(pose[:3, 3], data.xpos[i], atol=1e-9)
            np.testing.assert_allclose(pose[:3, :3], data.xmat[i].reshape(3, 3), atol=1e-9)
    # The corners of the mesh: read from the file and placed by the URDF, and as MuJoCo placed them.
    (geom,) = [geom for geom in robot.urdf.collisions if geom.link == "post" and geom.kind == "mesh"]
    ours = (
        np.unique(trimesh.load(geom.mesh.path).vertices, axis=0) * geom.size @ geom.origin[:3, :3].T
        + geom.origin[:3, 3]
    )
    number = next(i for i in range(model.ngeom) if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_MESH)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[number])
    start = model.mesh_vertadr[model.geom_dataid[number]]
    theirs = model.mesh_vert[start : start + 8] @ turn.reshape(3, 3).T + model.geom_pos[number]
    assert len(ours) == 8
    assert np.abs(theirs[:, None] - ours).max(axis=2).min(axis=1).max() < 1e-6


BODY = '<mujoco>\n{top}<worldbody>\n<body name="a">\n{inside}</body></worldbody>{end}</mujoco>'


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"inside": '<joint type="ball"/>'}, "line 4.*ball joint"),
        ({"inside": "<freejoint/>"}, "line 3.*free joint"),
        ({"inside": '<joint type="free"/>'}, "line 4.*free joint"),
        ({"inside": '<joint ref="0.5"/>'}, "line 4.*ref"),
        ({"inside": '<joint axis="0 0 0"/>'}, "line 4.*axis"),
        ({"inside": '<joint range="1 -1"/>'}, "line 4.*range"),
        ({"inside": '<joint range="a b"/>'}, "line 4.*range"),
        ({"inside": '<joint class="x"/>'}, "line 4.*'x'"),
        ({"inside": '<geom type="plane" size="1 1 1"/>'}, "line 4.*plane"),
        ({"inside": '<geom type="ellipsoid" size="1 1 1"/>'}, "line 4.*ellipsoid"),
        ({"inside": '<geom type="box" size="1 1"/>'}, "line 4.*size"),
        ({"inside": '<geom type="sphere" size="-1"/>'}, "line 4.*size"),
        ({"inside": '<geom type="mesh" mesh="x"/>'}, "line 4.*'x'"),
        ({"inside": '<geom size="1" quat="0 0 0 0"/>'}, "line 4.*quaternion"),
        ({"inside": '<geom size="1" quat="1 0 0 0" euler="0 0 0"/>'}, "line 4.*orientation"),
        ({"inside": '<geom size="1" poss="0 0 1"/>'}, "line 4.*'poss'"),
        ({"inside": '<body name="b" po="0 0 1"/>'}, "line 4.*'po'"),
        ({"top": '<default><joint axs="1 0 0"/></default>'}, "line 2.*'axs'"),
        ({"inside": '<body name="a"/>'}, "line 4.*'a'"),
        ({"top": '<include file="x.xml"/>'}, "line 2.*'x.xml'"),
        ({"top": '<compiler coordinate="global"/>'}, "global coordinates"),
        ({"end": '<equality><connect body1="a" anchor="0 0 0"/></equality>'}, "line 4.*connect"),
        ({"end": '<equality><joint joint1="j"/></equality>'}, "line 4.*equality"),
        ({"end": '<keyframe><key qpos="1 2"/></keyframe>', "inside": "<joint/>"}, "qpos"),
    ],
)
def test_unsupported_content_is_refused_with_its_line(tmp_path, parts, message):
    (tmp_path / "m.xml").write_text(BODY.format(**{"top": "", "inside": "", "end": "", **parts}))
    with pytest.raises(pp.errors.UrdfError, match=message):
        pp.load_robot(tmp_path / "m.xml")
