"""Routes and how far a curve may be off them: smooth, within the rounding, and bounds that hold between samples."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof._core import RouteSegment
from pinproof.planning.routes import MIN_LENGTH, Route, RouteFollower, line_task, routes_through
from pinproof.spatial import SE3, interpolate, twist_size

from ..examples import examples

MET = MIN_LENGTH / RouteSegment.LEVER + 1e-9
"""Metres and radians: a leg of less than MIN_LENGTH is none, so its poses are met to that; the rest is rounding."""

numbers = st.floats(-1, 1)
some_pose = st.builds(lambda xyz, rpy: pp.pose(xyz, rpy), st.tuples(*[numbers] * 3), st.tuples(*[numbers] * 3))


def as_pose(matrix):
    return SE3(matrix[:3, :3], matrix[:3, 3])


def _follower(arm, mask, deviation, rotation_deviation):
    task = line_task((mask > 0).tolist())
    return RouteFollower(arm=arm, task=task, deviation=deviation, rotation_deviation=rotation_deviation)


@examples(20)
@given(some_pose, some_pose)
def test_a_leg_is_the_interpolation_of_its_ends(first, last):
    shares = np.linspace(0, 1, 7)
    for s, matrix in zip(shares, Route.straight(first, last).poses(shares), strict=True):
        assert max(twist_size(interpolate(first, last, s), as_pose(matrix))) < MET


@examples(20)
@given(st.lists(some_pose, min_size=2, max_size=5))
def test_without_rounding_every_pose_is_met_and_is_a_stop(poses):
    routes = routes_through(poses, 0.0, 0.1)
    assert len(routes) == len(poses) - 1
    for first, last, route in zip(poses[:-1], poses[1:], routes, strict=True):
        ends = route.poses(np.array([0.0, 1.0]))
        assert max(*twist_size(first, as_pose(ends[0])), *twist_size(last, as_pose(ends[1]))) < MET
        assert route.passes == (1.0,)


@examples(20)
@given(st.lists(some_pose, min_size=3, max_size=5), st.floats(1e-3, 0.2))
def test_roundings_miss_their_pose_by_no_more(poses, rounding):
    seen = 1
    for route in routes_through(poses, rounding, 0.2):
        at = route.poses(np.array(route.passes))
        for matrix, pose in zip(at, poses[seen:], strict=False):
            metres, radians = twist_size(pose, as_pose(matrix))
            assert metres <= rounding + 1e-9
            assert radians <= 0.2 + 1e-9
        seen += len(at)
    assert seen == len(poses)


@examples(20)
@given(st.lists(some_pose, min_size=3, max_size=4), st.floats(0.02, 0.2))
def test_the_route_s_derivatives_stay_below_their_bounds(poses, rounding):
    for route in routes_through(poses, rounding, 0.5):
        if route.length == 0.0:
            continue
        for piece in route.compiled.pieces:
            low, high, (pull, spin, gain) = piece.start, piece.end, piece.derivatives()
            h = (high - low) / 400
            at = route.poses(np.linspace(low, high, 401))
            second = np.linalg.norm(np.diff(at[:, :3, 3], 2, axis=0), axis=1) / h**2
            assert second.max() <= pull * (1 + 1e-6) + 1e-9 / h**2 * 1e-3
            turned = np.einsum("nij,nik->njk", at[:-1, :3, :3], at[1:, :3, :3])
            angle = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1))
            assert angle.max() / h <= spin * (1 + 1e-3) + 1e-7 / h
            coarse = at[::10, :3, :3]  # differences of neighbours would be rounding
            rates = np.array([pin.log3(b @ a.T) for a, b in pairwise(coarse)]) / (10 * h)
            largest = np.linalg.norm(np.diff(rates, axis=0), axis=1).max() / (10 * h)
            assert largest <= gain * (1 + 1e-3) + 1e-12 / h**2


@pytest.mark.parametrize("name", ["ur5", "panda", "stanford", "scara"])
@pytest.mark.parametrize("deviation", [1e-2, 1e-4])
def test_the_bound_holds_everywhere_and_is_not_far_from_the_truth(name, deviation):
    arm = pp.load_robot(name).arm()
    rng = np.random.default_rng(0)
    bound = _follower(arm, np.ones(6), deviation, 10 * deviation)
    for _ in range(3):
        q = arm.limits.clip(arm.home + np.cumsum(rng.uniform(-0.1, 0.1, (4, arm.dof)), axis=0))
        path = pp.motion.CubicPath.through(q, arm.joint_names, knots=np.linspace(0, 1, 4))
        first, last = (arm.forward_kinematics(q[k]) for k in (0, -1))
        route = Route.straight(first, last)
        off = bound.bound(path, route)
        s = np.unique(np.concatenate([np.linspace(0, 1, 601), path.knots]))
        seen = np.array(
            [twist_size(as_pose(w), arm.forward_kinematics(p)) for w, p in zip(route.poses(s), path(s), strict=True)]
        )
        for k in range(3):
            here = seen[(s >= path.knots[k]) & (s <= path.knots[k + 1])].max(axis=0)
            assert (off[k] >= here - 1e-12).all()
            assert (off[k] <= here + np.array([0.11, 1.2]) * deviation).all()


def test_a_task_that_leaves_something_free_is_not_measured_there(ur5):
    q = np.array([ur5.home, ur5.home + 0.1, ur5.home + 0.2])
    path = pp.motion.CubicPath.through(q, ur5.joint_names, knots=[0, 0.5, 1])
    here = ur5.forward_kinematics(q[0])
    route = Route.straight(here, here)
    both, place, turn = (
        _follower(ur5, np.array(request), 1e-3, 1e-2).bound(path, route)
        for request in ([1.0] * 6, [1.0, 1, 1, 0, 0, 0], [0.0, 0, 0, 1, 1, 1])
    )
    assert (place[:, 1] == 0).all()
    assert (turn[:, 0] == 0).all()
    assert np.allclose(place[:, 0], both[:, 0], rtol=1e-2)
    assert np.allclose(turn[:, 1], both[:, 1], rtol=1e-2)
    spin = _follower(ur5, np.array([1.0, 1, 1, 1, 1, 0]), 1e-3, 1e-2).bound(path, route)
    s = np.linspace(0, 1, 2001)
    axes = ur5.forward_kinematics_batch(path(s))[:, :3, 2]
    angle = np.arccos(np.clip(axes @ here.rotation[:, 2], -1, 1))
    assert angle.max() <= spin[:, 1].max() <= angle.max() + 1e-2


def test_a_curve_that_would_need_too_many_samples_is_not_waved_through(ur5):
    here = ur5.forward_kinematics(ur5.home)
    path = pp.motion.CubicPath.through([ur5.home, ur5.home, ur5.home + 3], ur5.joint_names, knots=[0, 0.5, 1])
    assert np.isinf(_follower(ur5, np.ones(6), 1e-9, 1e-9).bound(path, Route.straight(here, here))).all()


def test_roundings_and_legs_together_are_twice_differentiable():
    poses = [pp.pose((0, 0, 0)), pp.pose((1, 0, 0), (0.3, 0, 0)), pp.pose((1, 1, 0)), pp.pose((0, 1, 1), (0, 0.4, 0))]
    (route,) = routes_through(poses, 0.05, 0.3)
    s = np.linspace(0, 1, 20_001)
    second = np.diff(route.poses(s)[:, :3, :], 2, axis=0) / (s[1] - s[0]) ** 2
    jumps = np.abs(np.diff(second, axis=0)).max()
    assert jumps < 0.02 * np.abs(second).max()  # a jump of the second derivative would be of its own size


def test_a_rounding_uses_all_of_its_allowance_on_long_segments():
    corners = [pp.pose((0, 0, 0)), pp.pose((1, 0, 0)), pp.pose((1, 1, 0)), pp.pose((2, 1, 0.5))]
    for rounding in (0.005, 0.02):
        (route,) = routes_through(corners, rounding, 1.0)
        for at, corner in zip(route.passes, corners[1:-1], strict=False):
            missed = np.linalg.norm(route.poses(np.array([at]))[0][:3, 3] - corner.translation)
            assert missed == pytest.approx(rounding, rel=1e-6)
