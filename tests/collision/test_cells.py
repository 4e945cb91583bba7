"""Clouds and grids of many cells, which are one body, compared with the same cells as bodies of their own."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import pinproof as pp
from pinproof.collision.certificates.certify import is_proven_free
from pinproof.collision.geometry.bodies import CellsBody, shape_bodies
from pinproof.collision.geometry.surfaces import Cells


def cloud(rng: np.random.Generator, count: int = 400) -> pp.PointCloud:
    """Points in clusters and alone, in cells of a few centimetres."""
    points = rng.uniform([-0.6, -0.9, -0.5], [1.2, 0.9, 1.3], (count, 3))
    points[: count // 2] = points[0] + 0.1 * rng.normal(size=(count // 2, 3))
    points = points[np.linalg.norm(points[:, :2], axis=1) > 0.25]
    return pp.PointCloud(points, resolution=float(rng.uniform(0.02, 0.06)))


def grid(rng: np.random.Generator) -> pp.OccupancyGrid:
    """Cells of a few blocks."""
    cells = np.zeros((30, 20, 25), dtype=np.uint8)
    for _ in range(12):
        low = rng.integers(0, 18, 3)
        cells[tuple(slice(a, a + rng.integers(1, 6)) for a in low)] = 1
    return pp.OccupancyGrid(cells, 0.05, (6, -10, -5))


TABLE = pp.Obstacle("table", pp.Box(2, 2, 0.1), pp.pose((0, 0, -0.2)))

SHAPES: dict[str, Callable[[np.random.Generator], pp.PointCloud | pp.OccupancyGrid]] = {"cloud": cloud, "grid": grid}


def both(arm: pp.Arm, shape: pp.PointCloud | pp.OccupancyGrid, pose: pin.SE3, **settings: object) -> tuple[Any, Any]:
    """Checkers of an arm beside cells, as one body and as an obstacle for each box."""
    boxes = Cells.of(shape).boxes
    parts = [
        pp.Obstacle(f"part_{i}", pp.Box(*(high - low)), pose * pp.pose(xyz=(low + high) / 2))
        for i, (low, high) in enumerate(boxes)
    ]
    assert len(parts) > 10
    one, many = (
        pp.CollisionChecker(arm, pp.Scene([*things, TABLE], allowed=[("*", "table")]), **settings)
        for things in ([pp.Obstacle("cells", shape, pose)], parts)
    )
    assert sum(isinstance(body, CellsBody) for body in one.bodies) == 1
    return one, many


def owners(found: pp.CheckResult) -> set[frozenset[str]]:
    """The owners in contact, with the boxes of cells as cells."""
    return {frozenset("cells" if "part_" in name else name for name in contact.bodies) for contact in found.contacts}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("seed", range(6))
def test_cells_as_one_body_have_the_verdicts_of_their_boxes(ur5, name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = pp.pose(xyz=rng.uniform(-0.2, 0.2, 3), rpy=rng.uniform(-1, 1, 3))
    meshes = {"wrist_2_link": "mesh"} if seed % 3 == 2 else "hull"
    one, many = both(ur5, SHAPES[name](rng), pose, margin=0.01 * (seed % 2), link_meshes=meshes)
    Q = rng.uniform(-np.pi, np.pi, (150, 6))
    free = one.is_free_batch(Q)
    assert 5 < free.sum() < 145
    assert (free == many.is_free_batch(Q)).all()
    np.testing.assert_allclose(one.clearance_batch(Q), many.clearance_batch(Q), atol=1e-9)
    for q in Q[:30]:
        assert owners(one.check(q)) == owners(many.check(q))
    # Edges, most of which graze the cells
    ends = Q + rng.normal(size=Q.shape) * 0.15
    edges = [pp.JointPath(np.array(pair), ur5.joint_names) for pair in zip(Q, ends, strict=True)]
    proven = [[is_proven_free(edge, each) for edge in edges] for each in (one, many)]
    assert proven[0] == proven[1]
    assert 0 < sum(proven[0]) < 150
    for edge in edges[:40]:
        as_one, as_many = pp.certify(edge, one), pp.certify(edge, many)
        assert as_one.status is as_many.status
        assert as_one.observed == pytest.approx(as_many.observed, abs=1e-3)
        if as_one.free:  # of a clearance, at least half is proven
            assert as_one.clearance > 0.4 * as_many.clearance
            assert as_one.clearance <= as_many.observed + 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_links_as_exact_meshes_have_the_verdicts_of_the_boxes(panda, seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, many = both(panda, cloud(rng), pp.pose(), link_meshes="mesh", margin=0.002)
    Q = rng.uniform(panda.limits.lower, panda.limits.upper, (300, 7))
    Q = Q[one.is_free_batch(Q)][:40]
    assert len(Q) > 10
    ends = np.clip(Q + 0.1 * rng.normal(size=Q.shape), panda.limits.lower, panda.limits.upper)
    for pair in zip(Q, ends, strict=True):
        edge = pp.JointPath(np.array(pair), panda.joint_names)
        assert is_proven_free(edge, one) == is_proven_free(edge, many)
        as_one, as_many = pp.certify(edge, one), pp.certify(edge, many)
        assert as_one.status is as_many.status


@pytest.mark.parametrize("name", SHAPES)
def test_the_triangles_of_cells_enclose_their_volume(name: str) -> None:
    shape = SHAPES[name](np.random.default_rng(3))
    a, b, c = np.moveaxis(Cells(shape).surface, 1, 0)
    volume = np.einsum("ij,ij->i", np.cross(a, b), c).sum() / 6
    count, side = (len(shape.cells), shape.resolution) if name == "cloud" else (shape.occupied.sum(), shape.voxel)
    assert volume == pytest.approx(count * side**3)


def test_a_proof_beside_cells_is_saved_and_verified(ur5, tmp_path) -> None:
    one, _ = both(ur5, cloud(np.random.default_rng(0), 60), pp.pose((0.2, 0.1, 0.3)))
    rng = np.random.default_rng(1)
    free = [q for q in rng.uniform(-3, 3, (300, 6)) if one.clearance(q) > 0.01]
    path = pp.JointPath(np.array([free[0], free[0] + 0.02]), ur5.joint_names)
    certificate = pp.certify(path, one, record=True)
    assert certificate.free
    certificate.save(tmp_path / "cells.proof.json")
    assert pp.verify_proof(tmp_path / "cells.proof.json").ok


def test_a_body_that_rests_on_cells_leaves_them(ur5) -> None:
    home = np.array([0.0, -1.2, 1.6, -2.0, -1.6, 0.0])
    at = ur5.forward_kinematics(home)
    part = pp.Obstacle("part", pp.Box(0.06, 0.06, 0.06), pp.pose((0, 0, 0.1)))
    below = (at * part.pose).translation - [0.0, 0.0, 0.03]
    tilt = Rotation.from_matrix((at * part.pose).rotation).as_matrix()
    low = np.abs(tilt[2]).sum() * 0.03 - 0.03  # how far the lowest corner is below the middle of its lower face
    x, y = np.meshgrid(np.arange(-0.1, 0.1, 0.02), np.arange(-0.1, 0.1, 0.02))
    apart = np.indices(x.shape).sum(axis=0) % 2 == 0  # so that no two cells have a common face
    side, cells = (
        0.02,
        np.array([(a + below[0], b + below[1], below[2] - low) for a, b in zip(x[apart], y[apart], strict=True)]),
    )
    top = (np.floor(cells[0, 2] / side) + 1) * side
    shape = pp.PointCloud(cells, resolution=side)
    lift = pp.pose((0.0, 0.0, below[2] - low - top))
    up = np.array([0.0, -0.05, 0.0, 0.0, 0.0, 0.0])
    path = pp.JointPath(np.array([home, home + up, home + 3 * up]), ur5.joint_names)
    one, many = both(ur5, shape, lift, attached=[part], margin=0.002)
    found = [
        pp.certify(path, each, parting=[("part", name) for name in each.scene.names if name != "table"])
        for each in (one, many)
    ]
    assert found[0].status is found[1].status


def test_cells_are_pickled_and_move_without_being_made_again(ur5) -> None:
    rng = np.random.default_rng(5)
    one, _ = both(ur5, cloud(rng), pp.pose())
    again, Q = pickle.loads(pickle.dumps(one)), rng.uniform(-2, 2, (100, 6))
    assert (again.is_free_batch(Q) == one.is_free_batch(Q)).all()
    assert again.fingerprint() == one.fingerprint()
    moved = one.with_scene(one.scene.move("cells", pp.pose((0, 0, 3.0))))
    assert (
        next(b for b in moved.bodies if isinstance(b, CellsBody)).solid
        is next(b for b in one.bodies if isinstance(b, CellsBody)).solid
    )
    assert moved.is_free_batch(Q).sum() > one.is_free_batch(Q).sum()


def test_no_cell_is_no_body_and_attached_cells_are_a_mesh(ur5) -> None:
    empty = pp.OccupancyGrid(np.zeros((2, 2, 2), dtype=np.uint8), 0.1)
    assert shape_bodies("empty", None, empty, pp.pose()) == []
    few = pp.PointCloud(0.1 * np.eye(3), resolution=0.02)
    carried = pp.CollisionChecker(ur5, attached=[pp.Obstacle("few", few, pp.pose((0, 0, 0.1)))])
    boxes = [
        pp.Obstacle(f"part_{i}", pp.Box(*(high - low)), pp.pose((low + high) / 2 + [0, 0, 0.1]))
        for i, (low, high) in enumerate(Cells(few).boxes)
    ]
    parts = pp.CollisionChecker(
        ur5, attached=boxes, allowed=[("part_0", "part_1"), ("part_0", "part_2"), ("part_1", "part_2")]
    )
    Q = np.random.default_rng(0).uniform(-3, 3, (300, 6))
    assert (carried.is_free_batch(Q) == parts.is_free_batch(Q)).all()
    assert 0 < carried.is_free_batch(Q).sum() < 300
