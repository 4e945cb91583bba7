"""The pick of the textbook, end to end.

Its other cases are in ik/test_clik.py and, the position at zero, in model/test_dh_to_urdf.py.
"""

from __future__ import annotations

import numpy as np

import pinproof as pp


def test_the_pick_succeeds_with_the_elbow_that_does_not_collide_with_the_table() -> None:
    arm = pp.load_robot("generic_6dof").arm()
    # A grasp from the side at the height of the shoulder: the elbow is either below or above it.
    grasp = pp.pose((0.45, -0.2, 0.33), (0, np.pi / 2, 0))
    found = pp.Clik().solve_many(arm, grasp, arm.home, count=16, attempts=200)
    elbow = np.array([arm.frame_placement(q, "dh_2").translation[2] for q in found.q])
    up, down = found.q[elbow > 0.33], found.q[elbow < 0.33]
    assert len(up)
    assert len(down)

    # A table whose top is just below the shoulder, with a gap around the base of the arm.
    table = pp.Obstacle("table", pp.Box(0.8, 1.6, 0.02), pp.pose((0.5, 0, 0.24)))
    scene = pp.Scene([table])
    checker = pp.CollisionChecker(arm, scene)
    for q in down:
        touched = {name for contact in checker.check(q).contacts for name in contact.bodies}
        assert "table" in touched
    assert pp.CollisionChecker(arm).is_free(down[0])  # free without the table

    home = arm.home + np.eye(6)[1] * 0.6
    pick = pp.Pick("part", grasp, approach=0.05, retreat=0.05)
    (verdict,) = pp.validate_picks(arm, scene, pp.Picks((pick,)), home=home).verdicts
    assert verdict.ok, verdict.reason
    assert arm.frame_placement(verdict.q_grasp, "dh_2").translation[2] > 0.33
    assert verdict.certificate.matches(verdict.trajectory, arm, scene)
    tip = arm.forward_kinematics(verdict.trajectory(verdict.grasp_time))
    np.testing.assert_allclose(tip.translation, grasp.translation, atol=1e-6)
