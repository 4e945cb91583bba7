"""Meshes as convex pieces or several hulls, which contain them with little excess; cuts and parts of triangles."""

from __future__ import annotations

import json
import tracemalloc
from itertools import product

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull
from scipy.spatial import ConvexHull as Hull

import pinproof as pp
from pinproof.collision import hull_triangles
from pinproof.collision.geometry import convex_pieces as module
from pinproof.collision.geometry.bodies import MOST_EXCESS, hull_body, shape_bodies
from pinproof.collision.geometry.convex_pieces import PIECES, clusters, convex_pieces, kept_convex_pieces
from pinproof.collision.geometry.hulls import PointHull, Solid, connected_parts, cut_crossing, with_area
from pinproof.description.meshes import read_mesh
from pinproof.verifier import verify

from ..examples import examples

HERE = pp.pose()
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
    return pp.Mesh.from_arrays(mesh.vertices, mesh.faces, **how)


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
    assert held(trimesh.sample.sample_surface(mesh, 1500, seed=0)[0], parts).all()
    points = rng.uniform(*mesh.bounds, (1000, 3))
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
    turn = np.asarray(pp.pose(rpy=rng.uniform(-3, 3, 3)).rotation) if rng.random() < 0.5 else np.eye(3)
    return Solid(np.array(vertices) @ turn.T, np.array(faces)), np.concatenate(points) @ turn.T


@pytest.mark.slow
@given(st.integers(0, 10_000), st.sampled_from([4, 12, 64]))
@examples(8)
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
@examples(8)
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
    scene = pp.Scene([pp.Obstacle("bin", pp.Mesh(tmp_path / "bin.stl"))])
    checker = pp.CollisionChecker(slider, scene)
    for x in np.linspace(-0.25, 0.25, 11):
        assert checker.clearance([x]) == pytest.approx(min(0.295 - 0.01 - abs(x), 0.085), abs=1e-6)
    assert not checker.is_free([0.29])  # in the wall
    assert checker.is_free([0.32])
    filled = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("bin", pp.Mesh(tmp_path / "bin.stl", hull=True))]))
    assert not filled.is_free([0.0])


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SHAPES, "bowl"])
def test_bodies_that_touch_the_triangles_are_never_free(slider, name):
    mesh = bowl() if name == "bowl" else SHAPES[name]
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(30):
        at = pp.pose(rng.uniform(-0.3, 0.3, 3), rng.uniform(-3, 3, 3))
        own, exact = (
            pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("thing", mesh_of(mesh, hull=hull), at)]))
            for hull in (None, False)
        )
        for x in rng.uniform(-0.3, 0.3, 4):
            free, truly = own.is_free([x]), exact.is_free([x])
            assert truly or not free
            if truly and not free:
                assert exact.clearance([x]) <= MOST_EXCESS
            seen.add(free)
    assert seen == {True, False}


def test_a_mesh_without_few_convex_pieces_is_used_as_triangles_with_a_note(slider, path, mesh_file):
    checker = pp.CollisionChecker(
        slider, pp.Scene([pp.Obstacle("bowl", pp.Mesh(mesh_file(bowl())), pp.pose((0, 0, 0.05)))])
    )
    (body,) = [body for body in checker.bodies if body.owner == "bowl"]
    assert body.support is None
    certificate = pp.certify(path(slider, [-0.1], [0.1]), checker)
    assert certificate.free
    (note,) = certificate.notes
    assert "bowl: " in note
    assert "exact triangles" in note
    assert not checker.is_free([0.18])


def test_an_open_mesh_becomes_its_hull_and_the_certificate_names_the_file(slider, path, tmp_path):
    opened = trimesh.Trimesh(STRAIGHT.vertices, STRAIGHT.faces[1:], process=False)
    opened.export(tmp_path / "opened.stl")
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("bin", pp.Mesh(tmp_path / "opened.stl"))]))
    assert not checker.is_free([0.0])
    (note,) = pp.certify(path(slider, [1.0]), checker).notes
    assert note.startswith("bin: opened.stl is not watertight")
    assert "convex hull" in note


def test_a_hull_on_request_is_noted(slider, path):
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("bin", mesh_of(STRAIGHT, hull=True))]))
    (note,) = pp.certify(path(slider, [1.0]), checker).notes
    assert "bin: " in note
    assert "convex hull" in note


def test_a_convex_mesh_is_one_body_without_a_note(slider, path):
    checker = pp.CollisionChecker(
        slider, pp.Scene([pp.Obstacle("box", mesh_of(trimesh.creation.box((0.1, 0.2, 0.3))))])
    )
    assert [body.name for body in checker.bodies if body.owner == "box"] == ["box"]
    assert pp.certify(path(slider, [1.0]), checker).notes == ()


def test_an_attached_mesh_follows_the_same_rule(slider):
    """A bin that is carried around a post inside it."""
    post = pp.Scene([pp.Obstacle("post", pp.Box(0.02, 0.02, 0.1), pp.pose((0.1, 0, -0.7)))])
    for hull, free in ((None, True), (False, True), (True, False)):
        carried = pp.Obstacle("bin", mesh_of(STRAIGHT, hull=hull), pp.pose((0, 0, -0.7)))
        checker = pp.CollisionChecker(slider, post, attached=[carried])
        assert checker.is_free([0.1]) is free
        assert not checker.is_free([-0.195])


def test_margins_and_allowed_pairs_hold_for_all_pieces(slider):
    inside = pp.Scene([pp.Obstacle("bin", mesh_of(STRAIGHT))])
    wide = pp.CollisionChecker(slider, inside, margins={("ball", "bin"): 0.2})
    assert not wide.is_free([0.0])
    assert not pp.CollisionChecker(slider, inside).is_free([0.29])
    assert pp.CollisionChecker(slider, inside, allowed=[("ball", "bin")]).is_free([0.29])


def test_a_proof_beside_a_bin_can_be_saved_and_verified(slider, path, tmp_path):
    STRAIGHT.export(tmp_path / "bin.stl")
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("bin", pp.Mesh(tmp_path / "bin.stl"))]))
    curve = path(slider, [-0.2], [0.2])
    pp.certify(curve, checker, record=True).save(tmp_path / "proof.json")
    assert verify(json.loads((tmp_path / "proof.json").read_text())).ok


def test_a_scene_file_keeps_the_settings_of_a_mesh(tmp_path):
    STRAIGHT.export(tmp_path / "bin.stl")
    expected = {"own": {}, "hull": {"hull": True}, "exact": {"hull": False}, "bare": {"hollow": True}}
    scene = pp.Scene([pp.Obstacle(name, pp.Mesh(tmp_path / "bin.stl", **how)) for name, how in expected.items()])
    scene.save(tmp_path / "scene.yaml")
    again = pp.Scene.load(tmp_path / "scene.yaml")
    assert [(again[n].shape.hull, again[n].shape.hollow) for n in expected] == [
        (None, False), (True, False), (False, False), (False, True),
    ]  # fmt: skip


def test_balls_next_to_each_piece_measure_the_distance_to_the_mesh(slider):
    checker = pp.CollisionChecker(
        slider, pp.Scene([pp.Obstacle("angle", mesh_of(ANGLE), pp.pose((0.3, -0.175, -0.05)))])
    )
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


def clusters_of(mesh: trimesh.Trimesh, pieces: int = PIECES) -> list[np.ndarray]:
    """The points of the hulls that cover a mesh, as coal has them."""
    solid = Solid(np.array(mesh.vertices), np.array(mesh.faces))
    return as_bodies(clusters(np.array(mesh.triangles), solid.contains, pieces))


def as_bodies(parts) -> list[np.ndarray]:
    return [hull_body("part", "link", part, HERE).support.points for part in parts]


def balls(fineness, *places):
    return trimesh.util.concatenate(
        [trimesh.creation.icosphere(fineness, 0.1).apply_translation(place) for place in places]
    )


def plates(axis):
    """Two plates at an angle: the plane between them is not in the middle of the mesh."""
    sizes, places = [(0.5, 0.3, 0.04), (0.03, 0.3, 0.2)], [(0.25, 0, 0.02), (0.015, 0, 0.14)]
    both = [
        trimesh.creation.box(np.roll(s, axis)).apply_translation(np.roll(p, axis))
        for s, p in zip(sizes, places, strict=True)
    ]
    return trimesh.boolean.union(both, engine="manifold")


COVERED = {  # a mesh, the largest number of hulls, and of their volume relative to its own
    "box": (trimesh.creation.box((0.3, 0.2, 0.1)), 1, 1.0 + 1e-3),
    "ball": (trimesh.creation.icosphere(2, 0.1), 1, 1.0 + 1e-3),
    "ring": (trimesh.creation.torus(0.2, 0.05, 24, 12), PIECES, 1.2),
    "ring of few hulls": (trimesh.creation.torus(0.2, 0.05, 21, 10), 4, 9.0),  # more triangles than choose a cut
    "tray": (rings((0.3, 0.2, -0.1), (0.3, 0.2, 0.1), (0.29, 0.19, 0.1), (0.29, 0.19, -0.09)), PIECES, 1.4),
    "foil tray": (
        rings((0.3, 0.2, -0.1), (0.3, 0.2, 0.1), (0.29999, 0.19999, 0.1), (0.29999, 0.19999, 1e-5 - 0.1)), PIECES, 1e9,
    ),
    "two balls": (balls(2, (0, 0, 0), (0.5, 0.1, 0.2)), PIECES, 1.05),
    "balls far apart": (balls(1, (0, 0, 0), (1, 0, 0)), PIECES, 1.05),
    **{f"plates {axis}": (plates(axis), PIECES, 1.15) for axis in range(3)},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("mesh", "most", "volume"), COVERED.values(), ids=COVERED)
def test_hulls_cover_a_mesh_closely_and_contain_every_point_of_surface_and_inside(mesh, most, volume):
    assert mesh.is_watertight
    parts = clusters_of(mesh, max(most, 4))
    assert (len(parts) == 1) is (most == 1)
    assert len(parts) <= max(most, 1)
    surface = trimesh.sample.sample_surface(mesh, 1000, seed=0)[0]
    points = np.random.default_rng(0).uniform(*mesh.bounds, (500, 3))
    for held_points in (surface, points[mesh.contains(points)], mesh.triangles.reshape(-1, 3)):
        assert held(held_points, parts).all()
    if volume < 9.0:
        assert mesh.volume * (1 - 1e-9) <= sum(Hull(part).volume for part in parts) <= volume * mesh.volume
    if most == 1:
        inverted = mesh.copy()
        inverted.invert()
        assert len(clusters_of(inverted)) == 1


@pytest.mark.slow
@given(st.integers(0, 10_000), st.integers(1, 8))
@examples(10)
def test_random_triangles_are_inside_their_decomposition(seed, pieces):
    """Triangles that enclose nothing, thin and flat ones among them, large ones across many cells."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(12, 1, 3)) + rng.normal(size=(12, 3, 3)) * rng.choice([0.01, 0.5, 3.0], (12, 1, 1))
    corners[:4, :, 2] = 0.5
    parts = clusters(corners, lambda _: False, pieces)
    assert 1 <= len(parts) <= pieces
    shares = rng.dirichlet((1, 1, 1), (12, 50))
    points = np.einsum("fsk,fkx->fsx", shares, corners).reshape(-1, 3)
    assert held(np.concatenate([points, corners.reshape(-1, 3)]), as_bodies(parts)).all()


def test_flat_parts_are_thickened_a_little():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    body = hull_body("sheet", "link", square, HERE)
    assert (body.box[0] <= [0, 0, -4e-6]).all()
    assert (body.box[1] - [1, 1, 0] <= 1e-5).all()
    line = hull_body("line", "link", square[:2], HERE)
    assert np.ptp(line.support.points, axis=0) == pytest.approx([1, 1e-5, 1e-5], abs=1e-9)


def test_a_decomposed_robot_touches_whatever_its_meshes_touch():
    arm = pp.load_robot("ur5").arm()
    at = pp.pose((0.35, 0.15, 0.4))
    scene = pp.Scene([pp.Obstacle("ball", pp.Sphere(0.08), at)])
    bent = ("upper_arm_link", "forearm_link")  # the links that are far from convex
    hows = ("hull", "mesh", "decomposed")
    kinds = {how: pp.CollisionChecker(arm, scene, link_meshes=dict.fromkeys(bent, how)) for how in hows}
    touched = dict.fromkeys(kinds, 0)
    for q in np.random.default_rng(4).uniform(*arm.limits.sampling_range(), (80, 6)):
        expected = {how: {frozenset(c.bodies) for c in checker.check(q).contacts} for how, checker in kinds.items()}
        assert expected["mesh"] <= expected["decomposed"] <= expected["hull"]
        for how, contacts in expected.items():
            touched[how] += len(contacts)
    assert touched["mesh"] <= touched["decomposed"] < touched["hull"]


def test_a_body_inside_a_decomposed_link_collides():
    arm = pp.load_robot("ur5").arm()
    geometry = next(g for g in arm.robot.urdf.collisions if g.link == "forearm_link")
    mesh = read_mesh(geometry.mesh.path, geometry.size)
    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles)
    deep = [
        p
        for p in trimesh.sample.volume_mesh(solid, 400)
        if abs(trimesh.proximity.signed_distance(solid, [p])[0]) > 0.02
    ]
    assert len(deep) > 5
    q = np.zeros(6)
    root_from_link = arm.frame_placement(q, "forearm_link")
    for point in deep[:8]:
        where = root_from_link.act(geometry.origin[:3, :3] @ point + geometry.origin[:3, 3])
        scene = pp.Scene([pp.Obstacle("bead", pp.Sphere(1e-3), pp.pose(where))])
        checker = pp.CollisionChecker(arm, scene, link_meshes={"forearm_link": "decomposed"})
        assert ("forearm_link", "bead") in [c.bodies for c in checker.check(q).contacts]


def test_areas_and_normals_are_those_of_trimesh_without_triangles_of_no_area() -> None:
    mesh = trimesh.creation.icosphere(1, 0.3)
    flat = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    corners, normals, areas = with_area(np.concatenate([flat, mesh.triangles, flat]))
    assert corners == pytest.approx(np.array(mesh.triangles))
    assert normals == pytest.approx(np.array(mesh.face_normals))
    assert areas == pytest.approx(np.array(mesh.area_faces))


@pytest.mark.parametrize("seed", range(5))
def test_a_cut_keeps_areas_orientation_and_sides(seed: int) -> None:
    """Some corners are in the plane."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(40, 3, 3))
    corners[rng.random((40, 3)) < 0.2, 2] = 0.0
    heights = corners[:, :, 2]
    crossing = (heights.min(axis=1) < 0) & (heights.max(axis=1) > 0)
    below, above = cut_crossing(corners, heights)
    assert (below[:, :, 2] <= 1e-12).all()
    assert (above[:, :, 2] >= -1e-12).all()

    def moments(part: np.ndarray) -> np.ndarray:
        area = np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]) / 2  # with the sign of the orientation
        return np.concatenate([area.sum(axis=0), (area[:, :, None] * part.mean(axis=1)[:, None]).sum(axis=0).ravel()])

    assert moments(np.concatenate([below, above])) == pytest.approx(moments(corners[crossing]), abs=1e-9)
    expected = with_area(corners[crossing])[2].sum()
    assert with_area(below)[2].sum() + with_area(above)[2].sum() == pytest.approx(expected)


def test_parts_are_numbered_by_their_first_nodes() -> None:
    assert connected_parts(6, np.array([4, 1]), np.array([2, 5])).tolist() == [0, 1, 2, 3, 2, 1]
    assert connected_parts(0, np.empty(0, dtype=int), np.empty(0, dtype=int)).tolist() == []


@given(st.integers(0, 2**32 - 1))
def test_parts_are_those_of_scipy(seed) -> None:
    rng = np.random.default_rng(seed)
    count, edges = rng.integers(1, 60), rng.integers(0, 60)
    one, other = rng.integers(0, count, (2, edges))
    graph = coo_array((np.ones(edges), (one, other)), shape=(count, count))
    expected = connected_components(graph, directed=False)[1]
    assert connected_parts(count, one, other).tolist() == expected.tolist()


@pytest.mark.parametrize("mesh", ["covered", "bowl"])
def test_pieces_are_equal_with_and_without_the_cache(mesh, tmp_path, monkeypatch) -> None:
    made = STRAIGHT if mesh == "covered" else bowl()
    solid = Solid(np.array(made.vertices), np.array(made.faces))
    most = 64 if mesh == "covered" else 3
    monkeypatch.setenv("PINPROOF_CACHE", str(tmp_path))
    written = kept_convex_pieces(solid, most=most, tolerance=1e-4)
    assert len(list(tmp_path.glob("*.npz"))) == 1
    with monkeypatch.context() as only:
        only.setattr(module, "convex_pieces", None)  # the entry is read, so they are not computed
        read = kept_convex_pieces(solid, most=most, tolerance=1e-4)
    computed = convex_pieces(solid, most=most, tolerance=1e-4)
    assert (written is None) == (read is None) == (computed is None) == (mesh == "bowl")
    if computed is not None:
        assert written.excess == read.excess == computed.excess
        for one, two, three in zip(written.points, read.points, computed.points, strict=True):
            assert one.dtype == two.dtype == three.dtype
            assert np.array_equal(one, two)
            assert np.array_equal(one, three)
    # other settings are other entries
    kept_convex_pieces(solid, most=most, tolerance=2e-4)
    kept_convex_pieces(solid, most=most - 1, tolerance=1e-4)
    assert len(list(tmp_path.glob("*.npz"))) == 3


def test_the_space_to_a_hull_is_the_distance_along_the_normal() -> None:
    rng = np.random.default_rng(0)
    cloud = rng.normal(size=(30, 3))
    hull, planes = PointHull(cloud), ConvexHull(cloud).equations
    assert hull.volume == pytest.approx(ConvexHull(cloud).volume)
    assert hull.box == pytest.approx(np.array([cloud.min(axis=0), cloud.max(axis=0)]))
    points, normals = rng.normal(size=(50, 3)) * 0.4, rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inside = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1) < 0
    points, normals = points[inside], normals[inside]
    expected = []
    for point, normal in zip(points, normals, strict=True):
        rates = planes[:, :3] @ normal
        ends = -(planes[:, :3] @ point + planes[:, 3])[rates > 0] / rates[rates > 0]
        expected.append(ends.min())
    space = hull.space(points, normals)
    assert len(space) > 10
    assert space == pytest.approx(expected)
    order = np.argsort(space)
    assert hull.has_space(points[order], normals[order], space.max() * 0.999)
    assert hull.has_space(points[order[::-1]], normals[order[::-1]], space.max() * 0.999)
    assert not hull.has_space(points, normals, space.max() * 1.001)


def test_flat_points_have_no_faces_and_no_space() -> None:
    hull = PointHull(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    assert (hull.volume, len(hull.planes), len(hull.triangles), len(hull.points)) == (0.0, 0, 0, 4)
    assert hull.space(np.zeros((2, 3)), np.eye(3)[:2]).tolist() == [0.0, 0.0]
    assert not hull.has_space(np.zeros((2, 3)), np.eye(3)[:2], 0.0)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 100.0])
def test_triangles_of_a_hull_are_counterclockwise_from_outside_and_enclose_its_volume(scale: float) -> None:
    rng = np.random.default_rng(1)
    points = scale * (rng.normal(size=(30, 3)) + np.array([5.0, -3.0, 1.0]))
    corners, middle = points[hull_triangles(points)], points.mean(axis=0)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights = np.einsum("ij,ij->i", normals, corners[:, 0] - middle)
    assert (heights > 0).all()
    assert heights.sum() / 6 == pytest.approx(ConvexHull(points).volume)
