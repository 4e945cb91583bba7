"""Inverse dynamics: Pinocchio on the whole robot, the balance of energy, payloads, and what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof import InputError, UnknownNameError
from pinproof.model import load_robot

from ..heavy_robot import heavy_robot_text

BAR = pp.Payload(2.5, (0.02, -0.01, 0.12), np.diag([0.02, 0.03, 0.015]))


@pytest.fixture(scope="module")
def heavy():
    return load_robot(heavy_robot_text()).arm(tcp="tool", held={"finger": 0.3})


@pytest.fixture(scope="module", params=["heavy", "panda", "scara"])
def arm(request, heavy):
    return heavy if request.param == "heavy" else pp.load_robot(request.param).arm()


def states(arm, count, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.uniform(*arm.limits.sampling_range(), size=(count, arm.dof))
    return q, rng.normal(size=q.shape), 5.0 * rng.normal(size=q.shape)


class WholeRobot:
    """All joints of the robot, independent of each other; the motion of the arm moves its mimic joints."""

    def __init__(self, arm):
        self.arm, self.model = arm, arm.robot.model
        self.data, self.joints = self.model.createData(), arm.robot.urdf.joints

    def spread(self, values, held, offset):
        """A vector of the whole robot from one of the arm."""
        found = np.zeros(self.model.nv)
        for name in self.joints:
            index = self.model.getJointId(self.arm.robot.urdf.model_joint(name))
            if index == self.model.njoints:
                continue
            mimic = self.joints[name].mimic
            leader, factor = (name, 1.0) if mimic is None else (mimic.leader, mimic.multiplier)
            at = self.model.joints[index].idx_v
            if leader in self.arm.joint_names:
                plus = mimic.offset if offset and mimic is not None else 0.0
                found[at] = factor * values[self.arm.joint_names.index(leader)] + plus
            else:
                found[at] = held.get(name, 0.0)
        return found

    def motion(self, q, v, a):
        return self.spread(q, self.arm.held, True), self.spread(v, {}, False), self.spread(a, {}, False)

    def torques(self, q, v, a):
        tau = pin.rnea(self.model, self.data, *self.motion(q, v, a))
        basis = [self.spread(row, {}, False) for row in np.eye(self.arm.dof)]
        return np.array([tau @ row for row in basis])

    def energy(self, q, v):
        whole = self.motion(q, v, v)
        return pin.computeKineticEnergy(self.model, self.data, *whole[:2]) + pin.computePotentialEnergy(
            self.model, self.data, whole[0]
        )


def test_torques_equal_those_of_the_whole_robot(arm):
    whole = WholeRobot(arm)
    for q, v, a in zip(*states(arm, 20), strict=True):
        expected = whole.torques(q, v, a)
        np.testing.assert_allclose(arm.torques(q, v, a), expected, atol=1e-11 * max(1.0, np.abs(expected).max()))


def test_the_batch_of_the_core_equals_pinocchio(arm):
    q, v, a = states(arm, 50)
    each = [arm.torques(*row, payload=BAR, gravity=(1.0, 2.0, -9.0)) for row in zip(q, v, a, strict=True)]
    np.testing.assert_allclose(arm.torques_batch(q, v, a, payload=BAR, gravity=(1.0, 2.0, -9.0)), each, atol=1e-11)
    np.testing.assert_allclose(arm.torques_batch(q), [arm.torques(row) for row in q], atol=1e-11)


def test_the_power_of_the_torques_is_the_change_of_energy(arm):
    def energy_of_payload(q, v):
        step = 1e-6
        before, after = (arm.forward_kinematics(q + s * v) for s in (-step, step))
        place = arm.root_from_base * arm.forward_kinematics(q)
        centre = np.array(BAR.center_of_mass)
        speed = (after * centre - before * centre) / (2 * step)
        spin = pin.log3(before.rotation.T @ after.rotation) / (2 * step)
        return 0.5 * BAR.mass * speed @ speed + 0.5 * spin @ BAR.inertia @ spin + 9.81 * BAR.mass * (place * centre)[2]

    whole, step = WholeRobot(arm), 1e-5
    for q, v, a in zip(*states(arm, 5), strict=True):
        ends = [(q + s * v + 0.5 * s * s * a, v + s * a) for s in (-step, step)]
        power = np.diff([whole.energy(*end) for end in ends])[0] / (2 * step)
        with_payload = np.diff([energy_of_payload(*end) for end in ends])[0] / (2 * step)
        assert arm.torques(q, v, a) @ v == pytest.approx(power, rel=1e-6, abs=1e-5)
        assert arm.torques(q, v, a, payload=BAR) @ v == pytest.approx(power + with_payload, rel=1e-4, abs=1e-3)


def test_the_mass_matrix_is_the_torque_per_acceleration(arm):
    for q, v, _ in zip(*states(arm, 5), strict=True):
        mass = arm.mass_matrix(q, payload=BAR)
        at_rest = arm.torques(q, payload=BAR, gravity=np.zeros(3))
        columns = [arm.torques(q, a=unit, payload=BAR, gravity=np.zeros(3)) - at_rest for unit in np.eye(arm.dof)]
        assert mass == pytest.approx(np.array(columns).T, abs=1e-10)
        assert mass == pytest.approx(mass.T, abs=1e-12)
        assert v @ mass @ v > 0


def test_a_payload_of_a_link_and_one_of_the_tcp_add_up(heavy):
    q, v, a = (rows[0] for rows in states(heavy, 1))
    on_arm = pp.Payload(1.0, (0.0, 0.1, 0.0), frame="arm")
    alone = heavy.torques(q, v, a)
    added = sum(heavy.torques(q, v, a, payload=each) - alone for each in (BAR, on_arm))
    np.testing.assert_allclose(heavy.torques(q, v, a, payload=[BAR, on_arm]) - alone, added, atol=1e-11)


def test_a_payload_is_frozen_and_pickles():
    again = pickle.loads(pickle.dumps(BAR))
    assert (again.mass, again.center_of_mass.tolist(), again.inertia.tolist()) == (
        BAR.mass, BAR.center_of_mass.tolist(), BAR.inertia.tolist(),
    )  # fmt: skip
    with pytest.raises(ValueError, match="read-only"):
        again.center_of_mass[0] = 1.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"mass": -1.0}, "mass"),
        ({"mass": 0.0}, "mass"),
        ({"mass": float("nan")}, "mass"),
        ({"mass": 1.0, "center_of_mass": (0.0, float("nan"), 0.0)}, "center_of_mass"),
        ({"mass": 1.0, "center_of_mass": (0.0, 0.0)}, "center_of_mass"),
        ({"mass": 1.0, "inertia": np.full((3, 3), float("nan"))}, "inertia"),
        ({"mass": 1.0, "inertia": np.diag([0.01, 0.01, -0.01])}, "positive definite"),
        ({"mass": 1.0, "inertia": [0.01, 0.01, 0.03]}, "sum of the others"),
        ({"mass": 1.0, "inertia": [[0.02, 0.0, 0.0], 0.02, 0.02]}, "shape"),
        ({"mass": 1.0, "inertia": [[0.02, 0.01, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.02]]}, "symmetric"),
        ({"mass": 1.0, "frame": 3}, "frame"),
        ({"mass": 1.0, "centre": (0.0, 0.0, 0.0)}, "center_of_mass"),
    ],
)
def test_an_impossible_payload_is_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        pp.Payload(**arguments)


def test_payloads_that_the_arm_does_not_move_are_refused(heavy):
    q = np.zeros(heavy.dof)
    with pytest.raises(UnknownNameError) as unknown:
        heavy.torques(q, payload=pp.Payload(1.0, frame="plam"))
    assert unknown.value.valid[0] == "palm"
    with pytest.raises(InputError, match="'base'"):
        heavy.torques(q, payload=pp.Payload(1.0, frame="base"))
    with pytest.raises(InputError, match="payload"):
        heavy.torques(q, payload=3.0)


def test_torques_of_a_robot_without_masses_are_refused():
    bare = heavy_robot_text().split("<joint", 1)
    links = "".join(f'<link name="{name}"/>' for name in ("base", "carriage", "column", "arm", "forearm", "hand",
                                                          "palm", "tool", "rod_link", "finger_link"))  # fmt: skip
    arm = load_robot(f'<robot name="bare">{links}<joint{bare[1]}').arm(tcp="tool")
    with pytest.raises(InputError, match="inertial"):
        arm.torques(np.zeros(arm.dof))
