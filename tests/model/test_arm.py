"""Kinematics of arms against Pinocchio's own full model (its mimic joints and cos/sin pairs) and finite differences."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.model import load_robot


@pytest.fixture(scope="session")
def zoo(zoo_text):
    return load_robot(zoo_text)


@pytest.fixture(scope="session")
def arm(zoo):
    return zoo.arm(tcp="tool")


@pytest.fixture(scope="session")
def ur5():
    return pp.load_robot("ur5").arm()


class Oracle:
    """The same robot as Pinocchio reads it: mimic=True, continuous joints as (cos, sin)."""

    def __init__(self, text):
        self.model = pin.buildModelFromXML(text, mimic=True)
        self.data = self.model.createData()

    def place(self, frame, **q):
        configuration = pin.neutral(self.model)
        for name, value in q.items():
            joint = self.model.joints[self.model.getJointId(name)]
            configuration[joint.idx_q : joint.idx_q + joint.nq] = (
                value if joint.nq == 1 else [np.cos(value), np.sin(value)]
            )
        pin.framesForwardKinematics(self.model, self.data, configuration)
        return self.data.oMf[self.model.getFrameId(frame)].homogeneous.copy()


SEEDS = given(seed=st.integers(0, 10**6))


@SEEDS
def test_every_link_has_the_pose_of_pinocchio(zoo_text, arm, seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, 4)
    q[1] = rng.uniform(-20, 20)  # continuous: one unwrapped angle
    data = dict(zip(arm.joint_names, q, strict=True))
    oracle = Oracle(zoo_text)
    for frame in ("base", "carriage", "column", "forearm", "hand", "tool", "rod_link"):
        expected = oracle.place(frame, **data, finger=0.01)
        assert arm.frame_placement(q, frame).homogeneous == pytest.approx(expected, abs=1e-13)


@SEEDS
def test_jacobian_is_the_derivative_of_the_pose(arm, seed):
    """Followers included: each column counts what the joint's followers do to the tcp."""
    q, h = np.random.default_rng(seed).uniform(-1, 1, 4), 1e-6
    columns = []
    for step in h * np.eye(4):
        before, after = arm.forward_kinematics(q - step), arm.forward_kinematics(q + step)
        linear = (after.translation - before.translation) / (2 * h)
        angular = pin.log3(after.rotation @ before.rotation.T) / (2 * h)
        columns.append(np.concatenate([linear, angular]))
    aligned = np.transpose(columns)
    assert arm.jacobian(q) == pytest.approx(aligned, abs=1e-8)

    tcp = arm.forward_kinematics(q)
    turn = np.kron(np.eye(2), tcp.rotation)
    assert arm.jacobian(q, reference="LOCAL") == pytest.approx(turn.T @ aligned, abs=1e-8)
    spatial = aligned.copy()
    spatial[:3] += np.cross(tcp.translation, aligned[3:], axisb=0, axisc=0)  # v of the point at the base's origin
    assert arm.jacobian(q, reference="WORLD") == pytest.approx(spatial, abs=1e-8)


def test_jacobian_equals_pinocchio_mimic(zoo_text, arm):
    q = np.array([0.3, 0.4, -0.5, 0.6])
    oracle = Oracle(zoo_text)
    configuration = np.zeros(oracle.model.nq)
    velocity_index = []
    for name, value in zip(arm.joint_names, q, strict=True):
        joint = oracle.model.joints[oracle.model.getJointId(name)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else [np.cos(value), np.sin(value)]
        velocity_index.append(joint.idx_v)
    frame = oracle.model.getFrameId("tool")
    reference = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    full = pin.computeFrameJacobian(oracle.model, oracle.data, configuration, frame, reference)
    assert arm.jacobian(q) == pytest.approx(full[:, velocity_index], abs=1e-13)


def test_limits_of_followers_are_folded_into_their_leaders(arm):
    """lift_follower = 0.3 - 0.5 lift within [-1, 1] leaves lift [-1.4, 2]; its 0.25 rad/s leave lift 0.5."""
    index = arm.joint_names.index("lift")
    assert arm.limits.lower[index] == pytest.approx(-1.4)
    assert arm.limits.upper[index] == pytest.approx(2.0)
    assert arm.limits.velocity[index] == pytest.approx(0.5)


def test_kinds_of_joints(arm):
    assert arm.joint_names == ("slide", "turn", "lift", "wrist")
    assert arm.followers == ("lift_follower", "rod")
    assert arm.angular.tolist() == [False, True, True, True]
    assert arm.periodic.tolist() == [False, True, False, True]
    assert arm.limits.lower[1] == -np.inf
    assert arm.limits.upper[1] == np.inf


def test_joint_whose_follower_rotates_half_as_far_is_not_periodic(arm):
    q = np.array([0.1, 0.2, -1.0, 0.4])
    turn = np.eye(4) * 2 * np.pi
    assert arm.forward_kinematics(q + turn[3]).isApprox(arm.forward_kinematics(q), 1e-12)
    assert not arm.forward_kinematics(q + turn[2]).isApprox(arm.forward_kinematics(q), 1e-3)


def test_a_base_may_be_any_link_on_the_chain(zoo):
    """Poses are given in the base link; joints before it are held."""
    short, long = zoo.arm(tcp="tool", base="carriage"), zoo.arm(tcp="tool")
    assert short.joint_names == ("turn", "lift", "wrist")
    q = np.array([0.0, 0.4, -0.5, 0.6])
    expected = long.frame_placement(q, "carriage").actInv(long.forward_kinematics(q))
    assert short.forward_kinematics(q[1:]).isApprox(expected, 1e-12)
    turn = np.kron(np.eye(2), long.frame_placement(q, "carriage").rotation.T)
    assert short.jacobian(q[1:]) == pytest.approx(turn @ long.jacobian(q)[:, 1:], abs=1e-12)


def test_a_held_joint_and_its_follower_have_the_stated_values(zoo, zoo_text):
    q, oracle = np.array([0.1, 0.2, 0.3, 0.4]), Oracle(zoo_text)
    for held, expected in (({"finger": 0.03}, 0.03), (None, 0.01)):  # 0 is outside its limits: the nearest bound
        arm = zoo.arm(tcp="tool", held=held)
        for link in ("finger_link", "thumb_link"):
            placement = oracle.place(link, **dict(zip(arm.joint_names, q, strict=True)), finger=expected)
            assert arm.frame_placement(q, link).homogeneous == pytest.approx(placement, abs=1e-13)


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ({"wrist": 0.0}, "'wrist' belongs to the arm"),
        ({"thumb": 0.0}, "valid: .*finger"),
        ({"nope": 0.0}, "valid: .*finger"),
        ({"finger": float("nan")}, "nan"),
        ({"finger": "open"}, "open"),
        ({"nope": None}, "valid: .*finger"),
        (0.03, "held must be of type Mapping"),
    ],
)
def test_joint_that_cannot_be_held_is_refused(zoo, held, message):
    with pytest.raises(pp.InputError, match=message):
        zoo.arm(tcp="tool", held=held)


CARRIAGE = """<robot name="carriage"><link name="root"/><link name="lift"/><link name="base"/><link name="upper"/>
<link name="tip"/><link name="finger"/>
<joint name="up" type="prismatic"><parent link="root"/><child link="lift"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint>
<joint name="fixed" type="fixed"><parent link="lift"/><child link="base"/><origin xyz="0.1 0 0"/></joint>
<joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<origin xyz="0 0 0.2"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="wrist" type="revolute"><parent link="upper"/><child link="tip"/><axis xyz="0 1 0"/>
<origin xyz="0.4 0 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="grip" type="prismatic"><parent link="tip"/><child link="finger"/><axis xyz="0 1 0"/>
<origin xyz="0.1 0 0"/><limit lower="0" upper="0.1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("held", [{"grip": 0.03}, {"up": 0.7}, {"up": 0.2, "grip": 0.05}])
def test_an_arm_with_other_held_joints_equals_one_that_was_made_with_them(held):
    """Also if a held joint carries the base of the arm."""
    first = pp.load_robot(CARRIAGE).arm(base="base", tcp="tip")
    arm, made = first.with_held(held), pp.load_robot(CARRIAGE).arm(base="base", tcp="tip", held=held)
    q = np.array([0.4, -0.7])
    assert dict(arm.held) == dict(made.held)
    for frame in ("base", "tip", "finger"):
        assert arm.root_from_frame(q, frame) == made.root_from_frame(q, frame)
    np.testing.assert_array_equal(arm.forward_kinematics_batch([q]), made.forward_kinematics_batch([q]))
    assert arm.root_from_base == made.root_from_base
    assert arm.with_held(first.held).root_from_frame(q, "finger") == first.root_from_frame(q, "finger")


def test_with_held_refuses_unknown_joints_and_other_types(zoo):
    arm = zoo.arm(tcp="tool")
    for held, message in (({"nope": None}, "valid: .*finger"), (0.03, "held must be of type Mapping")):
        with pytest.raises(pp.InputError, match=message):
            arm.with_held(held)


def test_one_joint_arm_has_a_jacobian_of_one_column(zoo):
    arm = zoo.arm(tcp="tool", base="forearm")
    assert arm.jacobian([0.2]).shape == (6, 1)
    assert arm.jacobian([0.2])[3:, 0] == pytest.approx(arm.frame_placement([0.2], "hand").rotation[:, 0], abs=1e-12)


@pytest.mark.parametrize("name", ["a", "b", "c", "universe"])
def test_a_joint_may_have_the_name_of_a_link(name):
    text = '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
    limit = '<limit lower="-2" upper="2" velocity="1" effort="1"/>'
    for joint, parent, child in ((name, "a", "b"), ("other", "b", "c")):
        text += (
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="1 0 0"/><axis xyz="0 0 1"/>{limit}</joint>'
        )
    robot = load_robot(text + "</robot>")
    arm = robot.arm(tcp="c")
    assert arm.joint_names == (name, "other")
    assert arm.forward_kinematics([np.pi / 2, 0.3]).translation == pytest.approx([1, 1, 0])
    held = robot.arm(tcp="b", held={"other": 0.5})
    assert held.frame_placement([0.0], "c").rotation == pytest.approx(pp.pose(rpy=(0, 0, 0.5)).rotation)


def test_batch_equals_the_single_calls(arm):
    Q = np.random.default_rng(0).uniform(-1, 1, (5, 4))
    single = np.array([arm.forward_kinematics(q).homogeneous for q in Q])
    assert arm.forward_kinematics_batch(Q) == pytest.approx(single, abs=1e-15)


def test_the_batch_of_jacobians_equals_the_single_calls(arm):
    rng = np.random.default_rng(3)
    many = rng.uniform(*arm.limits.sampling_range(), size=(20, arm.dof))
    assert arm.jacobian_batch(many) == pytest.approx(np.array([arm.jacobian(q) for q in many]), abs=1e-12)
    assert arm.jacobian_batch(np.empty((0, arm.dof))).shape == (0, 6, arm.dof)


def test_manipulability_is_the_volume_of_the_ellipsoid_of_twists(arm, ur5):
    assert arm.dof < 6  # an ellipsoid with as many axes as there are joints
    for each in (arm, ur5, pp.load_robot("panda").arm()):
        many = np.random.default_rng(4).uniform(*each.limits.sampling_range(), size=(10, each.dof))
        volumes = [np.prod(np.linalg.svd(each.jacobian(q), compute_uv=False)) for q in many]
        assert each.manipulability_batch(many) == pytest.approx(np.array(volumes), abs=1e-9)
        assert each.manipulability(many[0]) == each.manipulability_batch(many)[0]


def test_results_do_not_change_with_the_next_call(ur5):
    q, other = np.full(6, 0.3), np.full(6, -0.7)
    kept = [ur5.forward_kinematics(q), ur5.frame_placement(q, "tool0"), ur5.local_jacobian(q)[0]]
    jacobians = [ur5.jacobian(q), ur5.jacobian(q, reference="LOCAL"), ur5.jacobian(q, reference="WORLD")]
    before = [t.homogeneous.copy() for t in kept] + [j.copy() for j in jacobians]
    ur5.forward_kinematics(other), ur5.jacobian(other), ur5.local_jacobian(other)
    assert all(np.array_equal(a, b) for a, b in zip([*(t.homogeneous for t in kept), *jacobians], before, strict=True))


def test_threads_compute_the_same_results(ur5):
    Q = np.random.default_rng(0).uniform(-3, 3, (2000, 6))
    expected = [ur5.local_jacobian(q)[1].tobytes() for q in Q]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda q: ur5.local_jacobian(q)[1].tobytes(), Q))
    assert found == expected


def test_arm_survives_pickling(arm):
    copy = pickle.loads(pickle.dumps(arm))
    q = np.array([0.1, 0.2, 0.3, 0.4])
    assert np.array_equal(copy.forward_kinematics(q).homogeneous, arm.forward_kinematics(q).homogeneous)
    assert copy.joint_names == arm.joint_names


def test_unknown_names_are_refused_with_the_valid_ones(zoo, arm):
    with pytest.raises(pp.UnknownNameError, match="valid: tool"):
        zoo.arm(tcp="tol")
    with pytest.raises(pp.UnknownNameError, match=r"valid: .*base"):
        zoo.arm(tcp="tool", base="nope")
    with pytest.raises(pp.UnknownNameError, match="valid: hand"):
        arm.frame_placement(np.zeros(4), "hnd")
    with pytest.raises(pp.UnknownNameError, match="LOCAL_WORLD_ALIGNED"):
        arm.jacobian(np.zeros(4), reference="local")
    with pytest.raises(pp.UnknownNameError, match="frame 'wrist'"):  # a joint is no frame
        arm.frame_placement(np.zeros(4), "wrist")


@pytest.mark.parametrize("q", [[0.0] * 3, [[0.0] * 4], [0, 0, np.nan, 0], [0, 0, np.inf, 0], "abcd", None])
def test_an_invalid_configuration_is_refused_with_the_joint_names(arm, q):
    with pytest.raises(pp.InputError, match="slide, turn, lift, wrist"):
        arm.forward_kinematics(q)


def test_singularity_of_the_stretched_ur5(ur5):
    q = np.array([0.3, -0.8, 0.0, 0.4, 0.9, 0.2])
    lost = ur5.singularity(q)
    assert lost.smallest < 1e-12
    assert np.linalg.norm(lost.direction) == pytest.approx(1.0)
    assert lost.direction @ ur5.jacobian(q) == pytest.approx(np.zeros(6), abs=1e-12)
    assert ur5.singularity(ur5.home).smallest > 0.01


def test_ur5_and_panda_have_the_published_poses():
    """UR5: reach 0.81725 + offsets of the published table at zero; Panda: the flange's height at zero."""
    ur5 = pp.load_robot("ur5").arm(tcp="tool0")
    assert ur5.forward_kinematics(np.zeros(6)).translation == pytest.approx([0.81725, 0.19145, -0.005491], abs=1e-6)
    panda = pp.load_robot("panda").arm(tcp="panda_link8")
    assert panda.forward_kinematics(np.zeros(7)).translation == pytest.approx([0.088, 0, 0.926], abs=1e-9)


def test_home_is_inside_the_limits():
    for name in ("ur5", "panda", "generic_6dof"):
        arm = pp.load_robot(name).arm()
        assert arm.limits.contains(arm.home)
        assert arm.singularity(arm.home).smallest > 1e-3


def test_several_configurations_lead_to_the_method_for_them(ur5):
    checker, Q, T = pp.CollisionChecker(ur5), np.zeros((3, 6)), np.tile(np.eye(4), (3, 1, 1))
    calls = {
        "forward_kinematics_batch": lambda: ur5.forward_kinematics(Q),
        "torques_batch": lambda: ur5.torques(Q),
        "is_free_batch": lambda: checker.is_free(Q),
        "clearance_batch": lambda: checker.clearance(Q),
        "solve_batch": lambda: pp.Clik().solve(ur5, T),
        "solve_all_batch": lambda: pp.AnalyticIk().solve_all(ur5, T),
    }
    owners = (ur5, checker, pp.AnalyticIk())
    for name, call in calls.items():
        assert any(hasattr(owner, name) for owner in owners)
        with pytest.raises(pp.InputError, match=name):
            call()
    with pytest.raises(pp.InputError) as error:
        ur5.forward_kinematics(np.zeros(5))
    assert "batch" not in str(error.value)
