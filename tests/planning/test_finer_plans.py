"""Ends that touch by their hulls and not by their meshes: planned with finer bodies, with a note."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.model import load_robot

HOLE = 0.15

THREADED, BESIDE = np.array([0.0, 0.0]), np.array([0.0, 0.6])

PLANNER = pp.RrtConnect(time_limit=600.0)


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> pp.Arm:
    """A ring about x (hole of 0.15 m) that slides along x and y: its hull has no hole."""
    torus = trimesh.creation.torus(HOLE + 0.05, 0.05, 24, 12)
    torus.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    file: Path = tmp_path_factory.mktemp("ring") / "ring.stl"
    torus.export(file)
    joint = (
        '<joint name="{0}" type="prismatic"><parent link="{1}"/><child link="{2}"/><axis xyz="{3}"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
    )
    return load_robot(
        '<robot name="ring"><link name="root"/><link name="middle"/><link name="ring"><collision><geometry>'
        f'<mesh filename="{file}"/></geometry></collision></link>'
        + joint.format("x", "root", "middle", "1 0 0")
        + joint.format("y", "middle", "ring", "0 1 0")
        + "</robot>"
    ).arm(tcp="ring")


def _peg(side: float) -> pp.Scene:
    return pp.Scene([pp.Obstacle("peg", pp.Box(0.3, side, side))])


@pytest.mark.parametrize(("side", "by"), [(0.1, "several hulls"), (HOLE * np.sqrt(2) * 0.95, "exact meshes")])
def test_a_ring_is_taken_off_a_peg(ring: pp.Arm, side: float, by: str) -> None:
    checker = pp.CollisionChecker(ring, _peg(side))
    assert not checker.is_free(THREADED)
    exact = pp.CollisionChecker(ring, _peg(side), link_meshes="mesh")
    for start, goal in ((THREADED, BESIDE), (BESIDE, THREADED)):
        plan = PLANNER.plan(checker, start, goal).or_raise()
        assert [pair.by for pair in plan.checker.finer] == [by]
        assert plan.certificate.free
        assert pp.certify(plan.path, plan.checker).free
        assert np.array_equal(plan.path.q[[0, -1]], [start, goal])
        along = plan.path(np.linspace(*plan.path.domain, 400))
        assert exact.is_free_batch(along).all()
        assert np.abs(along[:, 0]).max() > 0.2  # off the end of the peg


def test_finer_bodies_are_not_checked_if_the_hulls_suffice(ring: pp.Arm) -> None:
    checker = pp.CollisionChecker(ring, _peg(0.1))
    plan = PLANNER.plan(checker, BESIDE, [THREADED, -BESIDE]).or_raise()
    assert plan.checker is checker
    assert plan.goal == 1


def test_a_real_contact_is_named_all_the_same(ring: pp.Arm) -> None:
    checker = pp.CollisionChecker(ring, _peg(0.3))
    plan = PLANNER.plan(checker, THREADED, BESIDE)
    assert plan.status is pp.planning.PlanStatus.START_INVALID
    assert [contact.bodies for contact in plan.contacts] == [("ring", "peg")]
    plan = PLANNER.plan(checker, BESIDE, [THREADED])
    assert plan.status is pp.planning.PlanStatus.GOAL_INVALID
    assert "ring penetrates peg" in plan.message
