"""Mesh obstacles as convex pieces: a bin stays open, and the pieces contain the mesh with little excess."""

from __future__ import annotations

import json
import tracemalloc
from itertools import product

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull as Hull

from pinproof import Box, CollisionChecker, Mesh, Obstacle, Scene, certify, pose
from pinproof.collision.geometry.bodies import MOST_EXCESS, shape_bodies
from pinproof.collision.geometry.convex_pieces import convex_pieces
from pinproof.collision.geometry.hulls import Solid
from pinproof.verifier import verify

from ..examples import examples

HERE = pose()
ROUNDING = 1e-9


def rings(*squares):
    """A surface of quadrilaterals from ring to ring of four corners, closed at both ends."""
    points = np.concatenate([[[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]] for x, y, z in squares]).astype(float)
    faces = [[0, 2, 1], [0, 3, 2]]
    for k in range(len(squares) - 1):
        for i in range(4):
            a, b = 4 * k + i, 4 * k + (i + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    last = 4 * len(squares) - 4
    faces += [[last, last + 1, last + 2], [last, last + 2, last + 3]]
    return trimesh.Trimesh(points, faces, process=False)


def extruded(outline, height):
    """A polygon, whose corners turn left, pushed along z."""
    flat = np.array(outline, dtype=float)
    n = len(flat)
    points = np.concatenate([np.column_stack([flat, np.full(n, z)]) for z in (0.0, height)])
    faces = [[i, (i + 1) % n, (i + 1) % n + n] for i in range(n)] + [[i, (i + 1) % n + n, i + n] for i in range(n)]
    corners = list(range(n))
    while len(corners) > 2:  # ears are cut off
        for k in range(len(corners)):
            a, b, c = corners[k - 1], corners[k], corners[(k + 1) % len(corners)]
            sides = [(a, b), (b, c), (c, a)]
            cross = [
                [np.linalg.det([flat[j] - flat[i], flat[p] - flat[i]]) for i, j in sides]
                for p in corners
                if p not in (a, b, c)
            ]
            if np.linalg.det([flat[b] - flat[a], flat[c] - flat[a]]) > 0 and all(min(row) < 0 for row in cross):
                faces += [[c, b, a], [a + n, b + n, c + n]]
                del corners[k]
                break
    return trimesh.Trimesh(points, faces, process=False)


def bowl():
    """The lower half of a spherical shell, closed along its rim."""
    turns, rows = 24, []
    for radius, tilts in ((0.2, np.linspace(np.pi, np.pi / 2, 9)), (0.18, np.linspace(np.pi / 2, np.pi, 9))):
        rows += [(radius * np.sin(t), radius * np.cos(t)) for t in tilts]
    line = np.array([(max(r, 0.0), z) for r, z in rows])
    line[0, 0] = line[-1, 0] = 0.0
    return trimesh.creation.revolve(line, sections=turns)


STRAIGHT = rings((0.3, 0.2, -0.1), (0.3, 0.2, 0.1), (0.295, 0.195, 0.1), (0.295, 0.195, -0.095))
DRAFT = rings((0.28, 0.18, -0.1), (0.3, 0.2, 0.1), (0.297, 0.197, 0.1), (0.277, 0.177, -0.097))
FOIL = rings((0.28, 0.18, -0.1), (0.3, 0.2, 0.1), (0.2998, 0.1998, 0.1), (0.2798, 0.1798, -0.0998))
ANGLE = extruded([(0, 0), (0.3, 0), (0.3, 0.05), (0.05, 0.05), (0.05, 0.3), (0, 0.3)], 0.1)
COMB = extruded(
    [
        (0, 0),
        (0.5, 0),
        (0.5, 0.3),
        (0.45, 0.3),
        (0.4, 0.05),
        (0.3, 0.05),
        (0.27, 0.3),
        (0.2, 0.3),
        (0.2, 0.1),
        (0, 0.2),
    ],
    0.2,
)
TURNED = STRAIGHT.copy().apply_transform(trimesh.transformations.euler_matrix(0.4, 0.3, 0.5))
SHAPES = {"bin": STRAIGHT, "draft": DRAFT, "foil": FOIL, "angle": ANGLE, "comb": COMB, "turned": TURNED}


def mesh_of(mesh, **how):
    return Mesh.from_arrays(mesh.vertices, mesh.faces, **how)


def held(points, parts):
    inside = np.zeros(len(points), dtype=bool)
    for part in parts:
        faces = Hull(part).equations
        inside |= (points @ faces[:, :3].T + faces[:, 3] <= ROUNDING).all(axis=1)
    return inside


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_the_pieces_contain_every_point_within_the_stated_excess(name):
    mesh = SHAPES[name]
    assert mesh.is_watertight
    bodies = shape_bodies(name, None, mesh_of(mesh), HERE)
    assert 1 < len(bodies) <= 10
    assert {body.owner for body in bodies} == {name}
    parts = [body.support.points for body in bodies]
    rng = np.random.default_rng(0)
    assert held(trimesh.sample.sample_surface(mesh, 4000, seed=0)[0], parts).all()
    points = rng.uniform(*mesh.bounds, (3000, 3))
    inside = mesh.contains(points)
    assert held(points[inside], parts).all()
    assert mesh.volume * (1 - 1e-6) <= sum(Hull(part).volume for part in parts) <= mesh.volume * 1.001
    assert "convex pieces" in bodies[0].remark


def polycube(seed):
    """The surface of a random set of blocks of a grid, as a solid, and points within the blocks."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 4))
    full = np.zeros((n + 2,) * 3, dtype=bool)
    full[1:-1, 1:-1, 1:-1] = rng.random((n, n, n)) < rng.uniform(0.4, 0.9)
    ticks = [np.concatenate([[0], np.cumsum(rng.uniform(0.5, 1.5, n + 2))]) for _ in range(3)]
    vertices, faces, points = [], [], []
    for cell in np.argwhere(full):
        low, high = (np.array([ticks[i][cell[i] + k] for i in range(3)]) for k in (0, 1))
        points.append(low + (high - low) * rng.random((30, 3)))
        points.append([low + (high - low) * corner for corner in product((1e-4, 1 - 1e-4), repeat=3)])
        for axis, side in product(range(3), (0, 1)):
            beside = cell.copy()
            beside[axis] += 2 * side - 1
            if full[tuple(beside)]:
                continue
            a, b = (axis + 1) % 3, (axis + 2) % 3
            square = []
            for along_a, along_b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                corner = np.zeros(3)
                corner[axis] = (low, high)[side][axis]
                corner[a], corner[b] = (low, high)[along_a][a], (low, high)[along_b][b]
                square.append(corner)
            start = len(vertices)
            vertices += square if side else square[::-1]
            faces += [[start, start + 1, start + 2], [start, start + 2, start + 3]]
    if not faces:
        return None, points
    turn = np.asarray(pose(rpy=rng.uniform(-3, 3, 3)).rotation) if rng.random() < 0.5 else np.eye(3)
    return Solid(np.array(vertices) @ turn.T, np.array(faces)), np.concatenate(points) @ turn.T


@pytest.mark.slow
@given(st.integers(0, 10_000), st.sampled_from([4, 12, 64]))
@examples(15)
def test_random_blocks_are_held_however_few_the_pieces(seed, most):
    solid, points = polycube(seed)
    assume(solid is not None and solid.watertight)
    cover = convex_pieces(solid, most=most, tolerance=1e-4)
    assume(cover is not None)
    assert held(points, cover.points).all()
    assert held(solid.corners.reshape(-1, 3), cover.points).all()
    if cover.excess < 1e-3:
        volume = abs(np.linalg.det(solid.corners - solid.corners.mean(axis=(0, 1))).sum()) / 6
        assert sum(Hull(part).volume for part in cover.points) < volume * 1.01


@pytest.mark.slow
@given(st.integers(0, 10_000))
@examples(15)
def test_overlapping_boxes_of_a_mesh_are_covered_one_by_one(seed):
    """On a grid, so that boxes share corners, edges and faces too; each may be turned inside out."""
    rng = np.random.default_rng(seed)
    lows = rng.integers(0, 3, (int(rng.integers(2, 5)), 3))
    bounds = np.stack([lows, lows + rng.integers(1, 4, lows.shape)], axis=1) * 0.0625
    boxes = [trimesh.creation.box(bounds=each) for each in bounds]
    for box in boxes[1:]:
        if rng.random() < 0.5:
            box.invert()
    mesh = trimesh.util.concatenate(boxes)
    solid = Solid(np.array(mesh.vertices), np.array(mesh.faces))
    assume(solid.watertight)
    points = rng.uniform(0, 0.375, (300, 3))
    within = (bounds[:, None, 0] < points) & (points < bounds[:, None, 1])
    union = within.all(axis=2).any(axis=0)
    assert [solid.contains(point[None]) for point in points] == union.tolist()
    cover = convex_pieces(solid, most=64, tolerance=1e-4)
    assert cover is not None
    assert len(cover.points) <= len(boxes)
    assert (held(points, cover.points) == union).all()
    assert cover.excess < 1e-6


def test_a_ball_inside_an_open_bin_does_not_touch_it(slider, tmp_path):
    """The bin as an STL file; a hull of it would fill it."""
    STRAIGHT.export(tmp_path / "bin.stl")
    scene = Scene([Obstacle("bin", Mesh(tmp_path / "bin.stl"))])
    checker = CollisionChecker(slider, scene)
    for x in np.linspace(-0.25, 0.25, 11):
        assert checker.clearance([x]) == pytest.approx(min(0.295 - 0.01 - abs(x), 0.085), abs=1e-6)
    assert not checker.is_free([0.29])  # in the wall
    assert checker.is_free([0.32])
    filled = CollisionChecker(slider, Scene([Obstacle("bin", Mesh(tmp_path / "bin.stl", hull=True))]))
    assert not filled.is_free([0.0])


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SHAPES, "bowl"])
def test_bodies_that_touch_the_triangles_are_never_free(slider, name):
    mesh = bowl() if name == "bowl" else SHAPES[name]
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(60):
        at = pose(rng.uniform(-0.3, 0.3, 3), rng.uniform(-3, 3, 3))
        own, exact = (
            CollisionChecker(slider, Scene([Obstacle("thing", mesh_of(mesh, hull=hull), at)])) for hull in (None, False)
        )
        for x in rng.uniform(-0.3, 0.3, 4):
            free, truly = own.is_free([x]), exact.is_free([x])
            assert truly or not free
            if truly and not free:
                assert exact.clearance([x]) <= MOST_EXCESS
            seen.add(free)
    assert seen == {True, False}


def test_a_mesh_without_few_convex_pieces_is_used_as_triangles_with_a_note(slider, path, mesh_file):
    checker = CollisionChecker(slider, Scene([Obstacle("bowl", Mesh(mesh_file(bowl())), pose((0, 0, 0.05)))]))
    (body,) = [body for body in checker.bodies if body.owner == "bowl"]
    assert body.support is None
    certificate = certify(path(slider, [-0.1], [0.1]), checker)
    assert certificate.free
    (note,) = certificate.notes
    assert "bowl: " in note
    assert "exact triangles" in note
    assert not checker.is_free([0.18])


def test_an_open_mesh_becomes_its_hull_and_the_certificate_names_the_file(slider, path, tmp_path):
    opened = trimesh.Trimesh(STRAIGHT.vertices, STRAIGHT.faces[1:], process=False)
    opened.export(tmp_path / "opened.stl")
    checker = CollisionChecker(slider, Scene([Obstacle("bin", Mesh(tmp_path / "opened.stl"))]))
    assert not checker.is_free([0.0])
    (note,) = certify(path(slider, [1.0]), checker).notes
    assert note.startswith("bin: opened.stl is not watertight")
    assert "convex hull" in note


def test_a_hull_on_request_is_noted(slider, path):
    checker = CollisionChecker(slider, Scene([Obstacle("bin", mesh_of(STRAIGHT, hull=True))]))
    (note,) = certify(path(slider, [1.0]), checker).notes
    assert "bin: " in note
    assert "convex hull" in note


def test_a_convex_mesh_is_one_body_without_a_note(slider, path):
    checker = CollisionChecker(slider, Scene([Obstacle("box", mesh_of(trimesh.creation.box((0.1, 0.2, 0.3))))]))
    assert [body.name for body in checker.bodies if body.owner == "box"] == ["box"]
    assert certify(path(slider, [1.0]), checker).notes == ()


def test_an_attached_mesh_follows_the_same_rule(slider):
    """A bin that is carried around a post inside it."""
    post = Scene([Obstacle("post", Box(0.02, 0.02, 0.1), pose((0.1, 0, -0.7)))])
    for hull, free in ((None, True), (False, True), (True, False)):
        carried = Obstacle("bin", mesh_of(STRAIGHT, hull=hull), pose((0, 0, -0.7)))
        checker = CollisionChecker(slider, post, attached=[carried])
        assert checker.is_free([0.1]) is free
        assert not checker.is_free([-0.195])


def test_margins_and_allowed_pairs_hold_for_all_pieces(slider):
    inside = Scene([Obstacle("bin", mesh_of(STRAIGHT))])
    wide = CollisionChecker(slider, inside, margins={("ball", "bin"): 0.2})
    assert not wide.is_free([0.0])
    assert not CollisionChecker(slider, inside).is_free([0.29])
    assert CollisionChecker(slider, inside, allowed=[("ball", "bin")]).is_free([0.29])


def test_a_proof_beside_a_bin_can_be_saved_and_verified(slider, path, tmp_path):
    STRAIGHT.export(tmp_path / "bin.stl")
    checker = CollisionChecker(slider, Scene([Obstacle("bin", Mesh(tmp_path / "bin.stl"))]))
    curve = path(slider, [-0.2], [0.2])
    certify(curve, checker, record=True).save(tmp_path / "proof.json")
    assert verify(json.loads((tmp_path / "proof.json").read_text())).ok


def test_a_scene_file_keeps_the_settings_of_a_mesh(tmp_path):
    STRAIGHT.export(tmp_path / "bin.stl")
    expected = {"own": {}, "hull": {"hull": True}, "exact": {"hull": False}, "bare": {"hollow": True}}
    scene = Scene([Obstacle(name, Mesh(tmp_path / "bin.stl", **how)) for name, how in expected.items()])
    scene.save(tmp_path / "scene.yaml")
    again = Scene.load(tmp_path / "scene.yaml")
    assert [(again[n].shape.hull, again[n].shape.hollow) for n in expected] == [
        (None, False), (True, False), (False, False), (False, True),
    ]  # fmt: skip


def test_balls_next_to_each_piece_measure_the_distance_to_the_mesh(slider):
    checker = CollisionChecker(slider, Scene([Obstacle("angle", mesh_of(ANGLE), pose((0.3, -0.175, -0.05)))]))
    assert checker.clearance([0.0]) == pytest.approx(0.29, abs=1e-6)
    assert checker.clearance([0.45]) == pytest.approx(0.09, abs=1e-6)  # in the notch, where the hull is filled


def test_a_dense_cad_mesh_is_refused_in_little_memory():
    """Samples times planes of the hull, as one matrix, would take more than 2 GB for this mesh."""
    ball = trimesh.creation.icosphere(subdivisions=5)
    x, y, z = ball.vertices.T
    bumps = 1 + 0.02 * np.sin(24 * x) * np.sin(24 * y) * np.sin(24 * z)
    solid = Solid(0.1 * bumps[:, None] * ball.vertices, np.array(ball.faces))
    tracemalloc.start()
    cover = convex_pieces(solid, most=64, tolerance=1e-4)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert cover is None
    assert peak < 200e6
