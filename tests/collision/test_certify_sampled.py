"""Certificates against dense samples where bounds have little room: bodies of metres, followers, coarse tolerances."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof import _core
from pinproof.motion import CubicPath

STATUS = pp.CertificateStatus


def crane() -> pp.Arm:
    """Booms of 3 m; a follower turns twice as far as the joint that it follows, and another one slides half of it."""
    text = '<link name="l0"/>'
    rows = (
        ("revolute", "0 0 1", "0 0 1", ""),
        ("revolute", "3 0 0", "0 0.6 0.8", ""),
        ("revolute", "3 0 0", "0 0 1", '<mimic joint="j1" multiplier="-2"/>'),
        ("prismatic", "1 0 0", "1 0 0", '<mimic joint="j0" multiplier="0.5"/>'),
    )
    for k, (kind, xyz, axis, extra) in enumerate(rows):
        shape = '<origin xyz="1.5 0 0"/><geometry><box size="2.8 0.2 0.3"/></geometry>' if k < 2 else (
            '<geometry><sphere radius="0.2"/></geometry>' if k == 2 else
            '<origin xyz="3 0 0"/><geometry><box size="6 0.1 1.5"/></geometry>'
        )  # fmt: skip
        text += f'<link name="l{k + 1}"><collision name="c{k}">{shape}</collision></link>'
        text += f'<joint name="j{k}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="{xyz}"/>'
        text += f'<axis xyz="{axis}"/><limit lower="-9" upper="9" velocity="9" effort="1"/>{extra}</joint>'
    return pp.load_robot(f'<robot name="crane">{text}</robot>').arm(tcp="l4")


def gear() -> pp.Arm:
    """A plate of 8 m that turns four times as far as the joint that it follows."""
    text = '<link name="l0"/><link name="l1"/><link name="l2"><collision><origin xyz="4 0 0"/>'
    text += '<geometry><box size="8 0.1 0.5"/></geometry></collision></link>'
    for k, extra in enumerate(("", '<mimic joint="j0" multiplier="3"/>')):
        text += f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/><axis xyz="0 0 1"/>'
        text += f'<limit lower="-9" upper="9" velocity="9" effort="1"/>{extra}</joint>'
    return pp.load_robot(f'<robot name="gear">{text}</robot>').arm(tcp="l2")


ARM, GEAR = crane(), gear()


def random_checker(rng: np.random.Generator, count: int, arm: pp.Arm = ARM) -> pp.CollisionChecker:
    things = [
        pp.Obstacle(
            f"thing{k}",
            pp.Sphere(rng.uniform(0.1, 1.6)) if rng.integers(2) else pp.Box(*rng.uniform(0.1, 5.0, 3)),
            pp.pose(rng.uniform([-9, -9, -1], [9, 9, 4]), rng.uniform(-3, 3, 3)),
        )
        for k in range(count)
    ]
    return pp.CollisionChecker(arm, pp.Scene(things), margin=float(rng.choice([0.0, 0.05])))


@pytest.mark.filterwarnings("ignore::pinproof.errors.UnitWarning")
@pytest.mark.parametrize("arm", [ARM, GEAR], ids=["crane", "gear"])
@pytest.mark.parametrize("seed", range(3))
def test_proven_clearances_and_tubes_hold_at_dense_samples(seed: int, arm: pp.Arm) -> None:
    rng, free = np.random.default_rng(seed), 0
    corners = np.array(np.meshgrid(*[(-1.0, 1.0)] * arm.dof)).reshape(arm.dof, -1).T
    while free < 8:
        checker = random_checker(rng, 4 if arm is ARM else 14, arm)
        at = rng.uniform(-1, 1, arm.dof) + rng.uniform(0.02, 0.5) * rng.normal(size=(3, arm.dof))
        curve = CubicPath.through(at, arm.joint_names) if rng.integers(2) else pp.JointPath(at, arm.joint_names)
        if rng.integers(3) == 0:  # at one configuration a tube is limited by its growth alone
            curve = pp.JointPath(at[:1], arm.joint_names)
        tolerance = float(rng.choice([0.0, 2e-3]))
        certificate = pp.certify(curve, checker, joint_tolerance=tolerance, limits=None)
        if not certificate.free:
            if certificate.first_contact is not None:
                assert checker.check(certificate.first_contact.q).contacts
            continue
        free += 1
        q = curve(np.linspace(*curve.domain, 300))
        for corner in corners:
            assert checker.clearance_batch(q + tolerance * corner).min() >= certificate.clearance - 1e-6
            wide = certificate.tube.largest_joints * corner
            assert checker.clearance_batch(q + wide).min() >= checker.margin - 1e-6


@pytest.mark.filterwarnings("ignore::pinproof.errors.UnitWarning")
@pytest.mark.parametrize("arm", [ARM, GEAR], ids=["crane", "gear"])
def test_the_growth_of_a_bound_covers_larger_tolerances_of_followers(arm: pp.Arm) -> None:
    rng = np.random.default_rng(5)
    world = random_checker(rng, 3, arm).world
    count = len(random_checker(rng, 3, arm).pairs)
    for _ in range(200):
        q, size, larger = rng.uniform(-1, 1, arm.dof), 10.0 ** rng.uniform(-4, -1), 10.0 ** rng.uniform(-4, -1.31)
        control, extra = q + size * rng.uniform(-1, 1, (4, arm.dof)), rng.uniform(0, 1e-2, arm.dof)
        delta, u, k = np.abs(control - q).max(axis=0), rng.normal(size=3), int(rng.integers(count))
        u /= np.linalg.norm(u)
        bounds, wider = (_core.MotionBounds(world, q, delta, extra + more) for more in (0.0, larger))
        split = len(world.joints_between(k))
        tight, rough = bounds.tight(k, u, split, control), bounds.rough(k)
        assert wider.tight(k, u, split, control).distance <= tight.distance + larger * tight.growth + 1e-12
        assert wider.rough(k).distance <= rough.distance + larger * rough.growth + 1e-12


@pytest.mark.filterwarnings("ignore::pinproof.errors.UnitWarning")
def test_a_coarse_proof_is_free_only_if_every_pair_is_apart() -> None:
    """With a tolerance that ends the bisection at once, some pairs are proven with little room and others are not."""
    rng, statuses = np.random.default_rng(0), dict.fromkeys(STATUS, 0)
    for _ in range(150):
        checker = random_checker(rng, 6)
        at = rng.uniform(-1, 1, ARM.dof) + np.array([[0.0], [rng.uniform(0.05, 0.6)]]) * rng.normal(size=(2, ARM.dof))
        curve = pp.JointPath(at, ARM.joint_names)
        certificate = pp.certify(curve, checker, tolerance=100.0, limits=None)
        statuses[certificate.status] += 1
        if certificate.free:
            assert checker.clearance_batch(curve(np.linspace(0, 1, 60))).min() >= certificate.clearance - 1e-6
            assert certificate.clearance > checker.margin
    assert min(statuses[STATUS.FREE], statuses[STATUS.UNDECIDED]) > 15
