"""Certificates of timed motions: of the very spline that the file holds, cubic or quintic."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp

FREE, COLLIDING = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING


def bulge(arm, speed, acceleration=None):
    """One piece of 1 s from 0 to 0 that swings out to the right between its ends."""
    a = None if acceleration is None else [[acceleration], [acceleration]]
    return pp.Trajectory([0, 1], [[0.0], [0.0]], [[speed], [-speed]], arm.joint_names, accelerations=a)


@pytest.mark.parametrize(("speed", "acceleration"), [(1.0, None), (1.0, 0.5), (0.0, 8.0)])
def test_the_swing_between_two_points_is_proven_to_its_top(slider, speed, acceleration):
    """A ball of 1 cm swings to a wall that it misses, or meets, by less than a millimetre."""
    motion = bulge(slider, speed, acceleration)
    top = float(motion(np.linspace(0, 1, 10_001)).max())
    assert top > 0.02
    for gap, status in ((5e-4, FREE), (-5e-4, COLLIDING)):
        wall = pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((top + 0.01 + gap + 0.05, 0, 0)))])
        certificate = pp.certify(motion, pp.CollisionChecker(slider, wall), limits=None)
        assert certificate.status is status
        if status is FREE:
            assert 0 < certificate.clearance <= gap + 1e-9
        else:
            assert motion(certificate.first_contact.time)[0] >= top + gap - 1e-9


@pytest.mark.parametrize("ending", [".json", ".csv"])
@pytest.mark.parametrize("acceleration", [None, 0.5])
def test_a_motion_file_has_the_certificate_of_its_motion(slider, tmp_path, ending, acceleration):
    motion = bulge(slider, 1 / 3, acceleration)
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((0.4, 0, 0)))]))
    motion.save(tmp_path / f"motion{ending}")
    again = pp.Trajectory.load(tmp_path / f"motion{ending}", slider.joint_names)
    before, after = pp.certify(motion, checker), pp.certify(again, checker)
    assert before.matches(again, slider, checker.scene)
    assert (after.status, after.clearance, after.intervals) == (before.status, before.clearance, before.intervals)
    other = bulge(slider, 1 / 3, None if acceleration else 0.0)  # the same points, the other interpolant
    assert not before.matches(other, slider, checker.scene)


def test_an_undecided_interval_reports_the_distance_of_its_bodies():
    """A rod swings 0.2 mm above a plate, and the proof may not cut finely enough."""
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    rod = pp.Obstacle("rod", pp.Cylinder(radius=0.004, length=0.2), pp.pose((0, 0, 0.1)))
    tip = (arm.forward_kinematics(arm.home) * pp.pose((0, 0, 0.2))).translation
    plate = pp.Obstacle("plate", pp.Box(0.5, 0.5, 0.2), pp.pose(tip - [0, 0, 0.1002]))
    turn = np.array([0.5, 0, 0, 0, 0, 0])
    swing = pp.JointPath([arm.home - turn, arm.home + turn], arm.joint_names)
    undecided = pp.certify(swing, pp.CollisionChecker(arm, pp.Scene([plate]), attached=[rod]), tolerance=0.01).undecided
    assert undecided.bodies == ("rod", "plate")
    assert undecided.distance == pytest.approx(2e-4, abs=1e-6)
