"""Certificates against what has no end: floors, walls and ceilings."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import pinproof as pp

FREE, COLLIDING = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING

WALL = pp.Obstacle("wall", pp.HalfSpace(), pp.pose((0.5, 0, 0), (0, -np.pi / 2, 0)))
"""Solid for x >= 0.5."""


@pytest.mark.parametrize("margin", [0.0, 0.02])
@pytest.mark.parametrize("others", [0, 5])
def test_a_ball_before_a_wall_without_end(slider, path, margin, others):
    """Alone, and in a tree of obstacles with ends."""
    far = [pp.Obstacle(f"far_{i}", pp.Box(0.1, 0.1, 0.1), pp.pose((0, 3 + i, 0))) for i in range(others)]
    checker = pp.CollisionChecker(slider, pp.Scene([*far, WALL]), margin=margin)
    free = pp.certify(path(slider, [-2.0], [0.4]), checker)
    assert free.status is FREE
    assert margin < free.clearance <= 0.09
    touching = pp.certify(path(slider, [-2.0], [0.6]), checker)
    assert touching.status is COLLIDING
    assert touching.first_contact.bodies == ("ball", "wall")
    at = path(slider, [-2.0], [0.6])(touching.first_contact.proven_free_until)[0]
    assert at == pytest.approx(0.49 - margin, abs=1e-3)
    assert at <= 0.49 - margin


@pytest.mark.parametrize("depth", [0.3, 1000.0])
def test_a_body_behind_the_plane_is_in_contact(slider, path, depth):
    certificate = pp.certify(
        path(slider, [0.5 + depth], [0.5 + 2 * depth]), pp.CollisionChecker(slider, pp.Scene([WALL]))
    )
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == 0.0
    assert certificate.first_contact.distance == pytest.approx(-(depth + 0.01), rel=1e-9)


@pytest.mark.parametrize("angle", [0.3, 1.2, 2.9])
def test_contact_with_a_tilted_wall_is_found_at_its_surface(slider, path, angle):
    """Its plane passes through x = 0.5, leaning by an angle from the floor's."""
    normal = np.array([-np.sin(angle), 0, np.cos(angle)])
    leaning = pp.Obstacle("wall", pp.HalfSpace(), pp.pose((0.5, 0, 0), (0, -angle, 0)))
    checker, move = pp.CollisionChecker(slider, pp.Scene([leaning])), path(slider, [-1.0], [1.0])
    certificate = pp.certify(move, checker)
    assert certificate.status is COLLIDING
    met = 0.5 + 0.01 / normal[0]  # where the ball's centre is one radius before the plane
    assert move(certificate.first_contact.proven_free_until)[0] == pytest.approx(met, abs=1e-3)


@pytest.mark.parametrize("exact", [True, False])
def test_a_tool_that_coal_must_judge_sweeps_over_a_floor(ur5, mesh_file, path, exact):
    """The arm swings a bar towards the floor; a hull and a mesh, which has no support function, have equal results."""
    bar = mesh_file(trimesh.creation.box((0.03, 0.03, 0.3)))
    tool = pp.Obstacle("bar", pp.Mesh(bar, hull=not exact), pp.pose((0, 0, 0.16)))
    floor = pp.Scene([pp.Obstacle("floor", pp.HalfSpace())], allowed=[("base_link", "floor")])
    checker = pp.CollisionChecker(ur5, floor, attached=[tool])
    down = ur5.home + np.array([0, 0.9, 0.3, 0, 0, 0])
    certificate = pp.certify(path(ur5, ur5.home, down), checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies[1] == "floor"
    samples = path(ur5, ur5.home, down)(np.linspace(0, certificate.first_contact.proven_free_until, 50, endpoint=False))
    assert checker.is_free_batch(samples).all()
    raised = pp.certify(path(ur5, ur5.home, ur5.home + np.array([0.5, -0.1, 0, 0, 0, 0])), checker)
    assert raised.status is FREE
    for q in np.linspace(ur5.home, ur5.home + np.array([0.5, -0.1, 0, 0, 0, 0]), 30):
        assert checker.clearance(q) >= raised.clearance


def test_a_floor_may_be_displaced_by_its_tolerance(slider, path):
    floor = pp.Obstacle("floor", pp.HalfSpace(), pp.pose((0, 0, -0.06)))
    checker, move = pp.CollisionChecker(slider, pp.Scene([floor])), path(slider, [-1.0], [1.0])
    certificate = pp.certify(move, checker, obstacle_tolerance=0.04)
    assert certificate.status is FREE
    assert certificate.tube.largest_obstacles <= 0.01 + 1e-9
    assert pp.certify(move, checker, obstacle_tolerance=0.051).status is COLLIDING


def test_one_of_several_floors_is_enough(slider, path):
    """Two half-spaces make a wedge; a cylinder slid into it meets the nearer one."""
    tool = pp.Obstacle("tool", pp.Cylinder(0.02, 0.4), pp.pose())
    up, down = (
        pp.Obstacle(name, pp.HalfSpace(), pp.pose((1.0, 0, 0), (0, a, 0))) for name, a in (("up", -0.6), ("down", -2.5))
    )
    certificate = pp.certify(
        path(slider, [-1.0], [1.0]), pp.CollisionChecker(slider, pp.Scene([up, down]), attached=[tool])
    )
    assert certificate.status is COLLIDING
    # the cylinder's corner (0.02, 0.2) along the first normal (-sin 0.6, cos 0.6), and so for the second
    first = 1.0 - (0.02 * np.sin(0.6) + 0.2 * np.cos(0.6)) / np.sin(0.6)
    second = 1.0 - (0.02 * np.sin(2.5) + 0.2 * -np.cos(2.5)) / np.sin(2.5)
    met = path(slider, [-1.0], [1.0])(certificate.first_contact.proven_free_until)[0]
    assert met == pytest.approx(min(first, second), abs=1e-3)
