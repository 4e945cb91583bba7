"""Arms on a rail, on a turntable and on a gantry: six joints in closed form at each value of the external ones."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof.errors import InputError, NoClosedForm

from .arms import TURN, arm_named

RAIL = 'prismatic"><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/><origin xyz="0 0 0.3"/>'
ACROSS = 'prismatic"><axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
TABLE = 'revolute"><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/>'
TILTED = 'revolute"><axis xyz="0 0.6 0.8"/><limit lower="-3" upper="3" velocity="1" effort="1"/><origin xyz="0.2 0 0"/>'
BEAM = 'revolute"><axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="1" effort="1"/><origin xyz="0.9 0 0.3"/>'
ASIDE = '<origin xyz="0.7 0 0.1" rpy="0 0 0.4"/>'

EXTERNAL = {"rail": (RAIL,), "turntable": (TABLE,), "gantry": (RAIL, ACROSS), "rail and turntable": (RAIL, TABLE),
            "positioner": (TILTED,), "beam": (BEAM,)}  # fmt: skip


@cache
def moved(name: str, kind: str) -> pp.Arm:
    """An arm of the catalogue on external joints, each of which carries the next one."""
    arm, parts = arm_named(name), []
    root = arm.robot.urdf.root
    for k, joint in enumerate(EXTERNAL[kind]):
        child = root if k + 1 == len(EXTERNAL[kind]) else f"e{k + 1}"
        parts.append(f'<link name="e{k}"/><joint name="external_{k}" type="{joint}<parent link="e{k}"/>')
        parts.append(f'<child link="{child}"/>{ASIDE if joint == TABLE else ""}</joint>')
    return pp.load_robot(arm.robot.urdf.text.replace("</robot>", "".join(parts) + "</robot>")).arm(tcp=arm.tcp)


def carried(arm: pp.Arm, six: pp.Arm, values: np.ndarray) -> np.ndarray:
    """The pose (4, 4) of the base of the six joints, at values of the external joints."""
    q = np.append(values, np.zeros(6))
    return arm.forward_kinematics(q).homogeneous @ np.linalg.inv(six.forward_kinematics(np.zeros(6)).homogeneous)


def missing(arm: pp.Arm, wanted: np.ndarray, found: np.ndarray) -> int:
    """How many of the configurations (k, 6) are not among the branches (b, n), modulo full rotations."""
    gaps = np.abs(wanted[:, None] - found[None, :, -6:])
    gaps = np.abs(gaps - TURN * np.round(gaps / TURN)).max(axis=2)
    return int((gaps.min(axis=1, initial=9.0) > 1e-5).sum())


ARMS = [(name, kind) for name in ("ur10e", "irb120", "crx10ia") for kind in EXTERNAL]


@pytest.mark.parametrize(("name", "kind"), ARMS)
def test_branches_at_values_of_external_joints_are_those_of_the_six_joints_there(name, kind):
    arm, six, solver = moved(name, kind), arm_named(name), pp.AnalyticIk()
    count = arm.dof - 6
    for q in np.random.default_rng(1).uniform(*arm.limits.sampling_range(), (20, arm.dof)):
        target = arm.forward_kinematics(q)
        found = solver.solve_all(arm, target, q, redundant_values=q[:count])
        assert found.redundant_joints == arm.joint_names[:count]
        assert (found.branches[:, :count] == q[:count]).all()
        local = np.linalg.inv(carried(arm, six, q[:count])) @ target.homogeneous
        own = solver.solve_all(six, local, q[count:]).branches
        assert len(own) == len(found.branches) > 0
        assert missing(six, own, found.branches) == missing(six, found.branches[:, count:], own) == 0
        reached = arm.forward_kinematics_batch(found.branches)
        np.testing.assert_allclose(reached, np.tile(target.homogeneous, (len(reached), 1, 1)), atol=1e-9)


@pytest.mark.parametrize("kind", EXTERNAL)
def test_no_solution_of_many_numerical_searches_is_missed(kind):
    arm, six = moved("ur10e", kind), arm_named("ur10e")
    count = arm.dof - 6
    for q in np.random.default_rng(2).uniform(*arm.limits.sampling_range(), (4, arm.dof)):
        target = arm.forward_kinematics(q)
        local = pin.SE3(np.linalg.inv(carried(arm, six, q[:count])) @ target.homogeneous)
        searched = pp.Clik(position_tolerance=1e-9, orientation_tolerance=1e-9).solve_many(
            six, local, q[count:], rng=3, count=16, attempts=80
        )
        assert len(searched.q) >= 4
        found = pp.AnalyticIk().solve_all(arm, target, q, redundant_values=q[:count])
        assert missing(six, searched.q, found.branches) == 0


@pytest.mark.parametrize("kind", ["rail", "turntable"])
def test_the_intervals_of_an_external_joint_end_where_the_number_of_branches_changes(kind):
    arm, solver = moved("ur10e", kind), pp.AnalyticIk()
    q = np.random.default_rng(4).uniform(-1.5, 1.5, 7)
    target = arm.forward_kinematics(q)
    found = solver.solve_all(arm, target, q)
    assert found.redundant_joints == ("external_0",)
    assert any(one.lower <= q[0] <= one.upper for one in found.intervals)

    def branches_at(value):
        return len(solver.solve_all(arm, target, q, redundant_values=value).branches)

    wide = [one for one in found.intervals if one.upper - one.lower > 1e-5]  # the ends are accurate to 1e-9
    assert wide
    for one in wide:
        assert branches_at((one.lower + one.upper) / 2) == one.branches
        for end, outwards in ((one.lower, -1e-6), (one.upper, 1e-6)):
            assert branches_at(end - outwards) == one.branches
            if abs(end + outwards) < arm.limits.upper[0]:
                assert branches_at(end + outwards) != one.branches


def test_curves_along_a_rail_hold_the_tcp():
    arm = moved("irb120", "rail")
    target = arm.forward_kinematics(np.random.default_rng(5).uniform(-1.0, 1.0, 7))
    motion = pp.AnalyticIk(redundant_steps=32).self_motion(arm, target)
    assert motion.parameter == "external_0"
    assert len(motion)
    for curve in motion:
        reached = arm.forward_kinematics_batch(curve.q)
        np.testing.assert_allclose(reached, np.tile(target.homogeneous, (len(reached), 1, 1)), atol=1e-9)


def test_a_pose_beside_the_end_of_a_rail_is_proven_out_of_reach():
    arm = moved("ur10e", "rail")
    beyond = pp.pose(xyz=(0.0, 3.6, 0.4), rpy=(np.pi, 0, 0))
    assert pp.AnalyticIk().solve(arm, beyond).status.name == "IMPOSSIBLE"
    assert pp.AnalyticIk().solve(arm, pp.pose(xyz=(0.0, 2.8, 0.4), rpy=(np.pi, 0, 0))).ok


def test_branches_of_a_gantry_are_found_by_a_sweep_of_both_joints():
    arm = moved("ur10e", "gantry")
    q = np.random.default_rng(6).uniform(-1.0, 1.0, 8)
    found = pp.AnalyticIk(redundant_steps=64).solve_all(arm, arm.forward_kinematics(q), q)
    assert found.grid.shape[1] == 2
    assert (found.grid == q[:2]).all(axis=1).any()
    assert missing(arm_named("ur10e"), q[None, 2:], found.branches) == 0
    assert {tuple(row) for row in found.branches[:, :2]} <= {tuple(row) for row in found.grid}
    batch = pp.AnalyticIk(redundant_steps=64).solve_all_batch(arm, [pp.pose(), arm.forward_kinematics(q)], q)
    assert batch.count[1] == len(found.branches)


def test_branches_at_stated_values_survive_pickling():
    arm = moved("ur10e", "rail")
    found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(arm.home), redundant_values=[0.0, 0.1])
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.branches, found.branches)
    assert again.message == found.message
    assert again.intervals == found.intervals == ()


def test_a_pair_of_values_is_stated_for_two_external_joints():
    target = pp.pose(xyz=(0.5, 0.2, 0.8))
    with pytest.raises(InputError, match="redundant_values"):
        pp.AnalyticIk().solve_all(moved("ur10e", "gantry"), target, redundant_values=[0.1, 0.2, 0.3])
    with pytest.raises(InputError, match="7 or 8 joints"):
        pp.AnalyticIk().solve_all(arm_named("ur10e"), target, redundant_values=0.0)
    with pytest.raises(InputError, match="7 joints"):
        pp.AnalyticIk().self_motion(moved("ur10e", "gantry"), target)


def test_nine_joints_have_no_closed_form():
    EXTERNAL["three"] = (RAIL, ACROSS, TABLE)
    with pytest.raises(NoClosedForm, match="9 joints"):
        pp.AnalyticIk().solve_all(moved("ur10e", "three"), pp.pose())
