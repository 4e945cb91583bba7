"""Paths on meshes: on the surface by an independent distance, normal to it by finite differences; what is refused."""

import json

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.errors import ToolPathError
from pinproof.tool_paths import contour, raster, read_tool_paths

X, UP = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
BOX = trimesh.creation.box((0.2, 0.1, 0.05))
# A plate of 200 x 100 mm with a hole of radius 30 mm
RING = trimesh.creation.annulus(0.03, 0.08, 0.02, sections=64)


def height(x, y):
    return 0.02 * np.sin(15 * x) * np.cos(10 * y) + 0.1 * x * y


def wavy(count=41):
    """A curved open surface over a square of 200 mm."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, count), np.linspace(-0.1, 0.1, count), indexing="ij")
    number = np.arange(count**2).reshape(count, count)
    a, b, c, d = (each.ravel() for each in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    vertices = np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()])
    return trimesh.Trimesh(vertices, faces, process=False)


def points_of(stroke):
    return stroke.path.poses[:, :3, 3]


def distances(mesh, points):
    """The distances of points from the triangles, computed triangle by triangle."""
    return trimesh.proximity.closest_point_naive(mesh, points)[1]


@pytest.mark.parametrize("direction", [X, (0.3, 1.0, 0.4)])
def test_a_raster_is_on_the_curved_surface_and_normal_to_it(direction):
    mesh = wavy()
    (stroke,) = raster(mesh, direction=direction, spacing=0.02, speed=0.1)
    points = points_of(stroke)
    # Between the points too, because a line stays in its triangle
    between = points[:-1] + np.linspace(0, 1, 5)[:, None, None] * np.diff(points, axis=0)
    assert distances(mesh, between.reshape(-1, 3)[::7]).max() < 1e-6
    h = 1e-6
    x, y = points[:, 0], points[:, 1]
    slope = [(height(x + h, y) - height(x - h, y)) / (2 * h), (height(x, y + h) - height(x, y - h)) / (2 * h)]
    expected = np.column_stack([-slope[0], -slope[1], np.ones_like(x)])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    cosine = np.einsum("ki,ki->k", expected, -stroke.path.poses[:, :3, 2])
    assert np.degrees(np.arccos(cosine.clip(-1, 1))).max() < 2.0
    assert (stroke.path.speed == 0.1).all()


def profile(outline, seed):
    """A surface of 200 mm with an outline (k, 2) in x and z, whose flat facets are cut into triangles at random."""
    rng, count = np.random.default_rng(seed), len(outline)
    rows = [np.insert(outline, 1, y, axis=1) for y in (-0.1, 0.1)]
    faces = []
    for k in range(count - 1):
        a, b, c, d = k, k + 1, count + k + 1, count + k
        faces += [(a, b, c), (a, c, d)] if rng.random() < 0.5 else [(a, b, d), (b, c, d)]
    return trimesh.Trimesh(np.concatenate(rows), faces, process=False)


def test_normals_change_evenly_however_facets_are_cut_into_triangles():
    angle = np.linspace(-0.4, 0.4, 21)
    arc = 0.4 * np.column_stack([np.sin(angle), np.cos(angle)])
    for seed in range(3):
        strokes = raster(profile(arc, seed), direction=X, spacing=0.05, joined=False)
        assert len(strokes) == 4
        for stroke in strokes:
            points, out = points_of(stroke), -stroke.path.poses[:, :3, 2]
            # Those of the cylinder, except on the halves of the first and the last facet
            inner = np.abs(points[:, 0]) < arc[-2, 0]
            expected = points[inner] * [1, 0, 1] / np.linalg.norm(points[inner] * [1, 0, 1], axis=1, keepdims=True)
            assert np.abs(out[inner] - expected).max() < 1e-6


def test_the_normal_of_a_flat_face_beside_a_rounding_is_its_own():
    angle = np.linspace(0.0, 0.8, 9)
    rounding = 0.1 * np.column_stack([np.sin(angle), np.cos(angle) - 1.0])
    for seed in range(3):
        for stroke in raster(
            profile(np.vstack([[-0.15, 0.0], rounding]), seed), direction=X, spacing=0.05, joined=False
        ):
            points, out = points_of(stroke), -stroke.path.poses[:, :3, 2]
            assert np.abs(out[points[:, 0] < -0.0051] - UP).max() < 1e-9
            # The line has no points in the middle of the flat face but its first or last one
            assert (points[:, 0] < -0.0051).sum() == 1


def test_the_lines_of_a_raster_have_their_spacing_and_alternate():
    strokes = raster(wavy(), direction=X, spacing=0.02, joined=False)
    assert len(strokes) == 10
    lines = [points_of(own) for own in strokes]
    assert np.diff([line[:, 1].mean() for line in lines]) == pytest.approx(np.full(9, 0.02))
    assert max(np.ptp(line[:, 1]) for line in lines) < 1e-9
    assert [np.sign(line[-1, 0] - line[0, 0]) for line in lines] == [1, -1] * 5
    # Half of the spacing is left along the surface before both ends
    assert all(0.085 < np.abs(line[[0, -1], 0]).min() < 0.0951 for line in lines)


def test_lines_that_end_on_the_edges_are_joined_at_both_ends():
    (stroke,) = raster(BOX, direction=X, spacing=0.02, margin=0.0)
    assert np.ptp(points_of(stroke), axis=0) == pytest.approx([0.2, 0.08, 0.0])
    assert stroke.path.length == pytest.approx(5 * 0.2 + 4 * 0.02)


def test_a_raster_with_an_offset_stays_at_this_distance():
    ball = trimesh.creation.icosphere(4, 0.1)
    (stroke,) = raster(ball, direction=X, spacing=0.02, offset=0.01)
    assert distances(ball, points_of(stroke)) == pytest.approx(np.full(len(stroke.path), 0.01), abs=1e-4)
    assert points_of(stroke)[:, 2].min() > 0.0


def test_a_hole_splits_the_strokes_of_a_raster():
    strokes = raster(RING, direction=X, spacing=0.01, margin=0.005)
    assert len(strokes) > 3
    for own in strokes:
        points = points_of(own)
        between = points[:-1] + np.linspace(0, 1, 9)[:, None, None] * np.diff(points, axis=0)
        radius = np.linalg.norm(between[..., :2], axis=-1)
        assert radius.min() > 0.03
        assert radius.max() < 0.08
        assert np.abs(between[..., 2] - 0.01).max() < 1e-12


def test_what_another_part_covers_does_not_belong_to_a_raster():
    """A plate below a shorter one: its lines are those that are seen beside it; a face that is stated is seen alone."""
    upper = trimesh.creation.box((0.1, 0.1, 0.01), np.array(pp.pose((0.0, 0.0, 0.03)).homogeneous))
    stacked = trimesh.util.concatenate([trimesh.creation.box((0.2, 0.1, 0.01)), upper])
    strokes = raster(stacked, direction=X, spacing=0.02, margin=0.0, joined=False)
    ends = np.array([points_of(own)[[0, -1]] for own in strokes])
    lower = ends[np.isclose(ends[:, 0, 2], 0.005)]
    assert (len(ends), len(lower)) == (15, 10)
    assert np.sort(np.abs(lower[:, :, 0]), axis=1) == pytest.approx(np.tile([0.05, 0.1], (10, 1)))
    top = int(np.flatnonzero((stacked.face_normals[:, 2] > 0.9) & (stacked.triangles_center[:, 2] < 0.01))[0])
    assert len(raster(stacked, direction=X, spacing=0.02, margin=0.0, joined=False, face=top)) == 5


def test_the_contour_of_a_face_is_a_closed_loop_around_it():
    (stroke,) = contour(BOX, normal=UP, speed=0.05)
    points = points_of(stroke)
    assert stroke.closed
    assert stroke.path.length == pytest.approx(0.6)
    assert {tuple(np.round(point, 9)) for point in points} == {
        (x, y, 0.025) for x in (-0.1, 0.1) for y in (-0.05, 0.05)
    }
    assert stroke.path.poses[:, :3, 2] == pytest.approx(np.tile([0, 0, -1], (5, 1)))
    # The face is to the left: the area is positive about its normal
    assert 0.5 * np.cross(points[:-1], points[1:])[:, 2].sum() == pytest.approx(0.02)


@pytest.mark.parametrize("inset", [0.005, -0.004])
def test_inset_moves_outer_edges_and_holes_into_the_face(inset):
    outer, inner = contour(RING, normal=UP, inset=inset)
    for stroke, plain in zip((outer, inner), contour(RING, normal=UP), strict=True):
        edges = points_of(plain)
        a, steps = edges[:-1], np.diff(edges, axis=0)
        for point in 0.5 * (points_of(stroke)[1:] + points_of(stroke)[:-1]):
            share = (np.einsum("ki,ki->k", point - a, steps) / np.einsum("ki,ki->k", steps, steps)).clip(0, 1)
            assert np.linalg.norm(a + share[:, None] * steps - point, axis=1).min() == pytest.approx(abs(inset))
    radii = [np.linalg.norm(points_of(own)[:, :2], axis=1).mean() for own in (outer, inner)]
    assert (np.array(radii) - [0.08, 0.03] > 0).tolist() == [inset < 0, inset > 0]


def test_a_section_follows_the_surface_and_its_normals():
    pipe = trimesh.creation.cylinder(0.05, 0.2, sections=128)
    (stroke,) = contour(pipe, normal=(0.3, 0, 1), point=(0, 0, 0.01), offset=0.002)
    points = points_of(stroke)
    assert stroke.closed
    assert np.linalg.norm(points[:, :2], axis=1) == pytest.approx(np.full(len(points), 0.052), abs=1e-4)
    radial = points * [1, 1, 0] / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
    assert np.einsum("ki,ki->k", radial, -stroke.path.poses[:, :3, 2]).min() > np.cos(0.03)


def test_a_section_of_an_open_mesh_is_an_open_stroke():
    (stroke,) = contour(wavy(), normal=X, point=(0.013, 0, 0))
    assert not stroke.closed
    assert np.abs(points_of(stroke)[:, 0] - 0.013).max() < 1e-12


def test_the_edges_of_a_curved_face_need_a_bend():
    pipe = trimesh.creation.cylinder(0.05, 0.2, sections=64)
    side = int(np.flatnonzero(np.abs(pipe.face_normals[:, 2]) < 1e-6)[0])
    with pytest.raises(pp.InputError, match=r"not planar: a neighbour is inclined by 5\.6 deg; state bend"):
        contour(pipe, face=side)
    strokes = contour(pipe, face=side, bend=0.15)
    assert sorted(float(np.round(points_of(own)[0, 2], 6)) for own in strokes) == [-0.1, 0.1]
    with pytest.raises(pp.InputError, match="planar faces"):
        contour(pipe, face=side, bend=0.15, inset=0.001)


def test_meshes_in_millimetres_are_recognised_and_noted(tmp_path):
    file = tmp_path / "part.stl"
    trimesh.creation.box((200, 100, 50)).export(file)
    (stroke,) = contour(file, normal=UP)
    assert stroke.path.length == pytest.approx(0.6)
    assert "millimetres" in stroke.path.notes[0]
    (tmp_path / "job.json").write_text(json.dumps({
        "robot": "ur5", "speed": 0.1, "strokes": [
            {"file": "part.stl", "unit": "mm", "contour": {"normal": UP, "inset": 0.01}, "name": "edge"},
            {"file": "part.stl", "raster": {"direction": X, "spacing": 0.02}, "process": False, "speed": 0.2},
        ]
    }))  # fmt: skip
    edge, strips = read_tool_paths(tmp_path / "job.json").strokes
    assert (edge.name, edge.closed, edge.path.notes, edge.path.speed[0]) == ("edge", True, (), 0.1)
    assert (strips.name, strips.process, strips.path.speed[0]) == ("part", False, 0.2)


def test_a_closed_mesh_with_inner_normals_is_noted():
    inverted = BOX.copy()
    inverted.invert()
    (stroke,) = contour(inverted, normal=UP)
    assert "inwards" in stroke.path.notes[-1]
    assert points_of(stroke)[:, 2] == pytest.approx(np.full(5, -0.025))
    assert not contour(BOX, normal=UP)[0].path.notes


def test_the_number_of_a_triangle_is_that_of_the_file():
    # Triangles without an area come first, and are dropped
    faces = np.concatenate([[[0, 0, 1], [2, 2, 2]], BOX.faces])
    mesh = trimesh.Trimesh(BOX.vertices, faces, process=False)
    top = 2 + int(BOX.face_normals[:, 2].argmax())
    (stroke,) = contour(mesh, face=top)
    assert points_of(stroke)[:, 2] == pytest.approx(np.full(5, 0.025))


def doubled():
    return trimesh.util.concatenate([BOX, trimesh.creation.box((0.2, 0.1, 0.05), np.eye(4) + 0.2 * np.eye(4, k=3))])


def flipped():
    mesh = BOX.copy()
    mesh.faces[0] = mesh.faces[0][::-1]
    return mesh


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: contour(BOX), "normal of the face"),
        (lambda: contour(BOX, normal=UP, face=0), "normal of the face"),
        (lambda: contour(BOX, normal=(0, 1, 1)), "no planar face with the normal"),
        (lambda: contour(BOX, normal=(0, 0, 0)), "normal"),
        (lambda: contour(BOX, face=99), "99 does not exist"),
        (lambda: contour(BOX, point=(0, 0, 0)), "point and normal"),
        (lambda: contour(BOX, normal=UP, point=(0, 0, 9)), "does not meet"),
        (lambda: contour(BOX, normal=UP, inset=0.06), "too large"),
        (lambda: contour(RING, normal=UP, inset=0.03), "too large: the line comes closer to another edge"),
        (lambda: contour(RING, normal=UP, inset=0.06), "too large: the line comes closer to another edge"),
        (lambda: contour(trimesh.creation.icosphere(3, 0.1), face=0, bend=1.0), "closed surface"),
        (lambda: contour(BOX, normal=UP, offset=float("nan")), "offset"),
        (lambda: contour("no.stl", normal=UP), "no.stl"),
        (lambda: contour(3, normal=UP), "mesh"),
        (lambda: contour(flipped(), normal=UP), "opposite orientation"),
        (lambda: raster(doubled(), direction=X, spacing=0.02), "more than two triangles|opposite"),
        (lambda: raster(BOX, direction=X, spacing=0.2), "larger than the surface, which is 0.1 m wide"),
        (lambda: raster(BOX, direction=X, spacing=0.0), "spacing"),
        (lambda: raster(BOX, direction=X, spacing=1e-6), "100,000 lines, more than 5,000"),
        (lambda: raster(BOX, direction=X, spacing=0.02, margin=0.2), "twice the margin"),
        (lambda: raster(BOX, direction=UP, spacing=0.02), "parallel"),
        (lambda: raster(wavy(), direction=X, spacing=0.02, normal=(0, 0, -1)), "faces the direction"),
        (lambda: raster(BOX, direction=X, spacing=0.02, face=int(BOX.face_normals[:, 2].argmin())), "does not face"),
    ],
)  # fmt: skip
def test_unusable_meshes_and_settings_are_refused(make, words):
    with pytest.raises((pp.InputError, pp.FileError), match=words):
        make()


@pytest.mark.parametrize(
    ("stroke", "words"),
    [
        ({"file": "part.stl"}, "either contour or raster"),
        ({"file": "part.stl", "contour": {"normal": UP}, "raster": {"direction": X, "spacing": 0.02}}, "either"),
        ({"file": "part.stl", "raster": {"direction": X}}, "spacing"),
        ({"file": "part.stl", "contour": {"normal": UP}, "normals": X}, "own normals"),
        ({"file": "part.stl", "contour": {"norm": UP}}, "unknown key 'norm'"),
        ({"points": [[0, 0, 0], [1, 0, 0]], "normals": UP, "contour": {"normal": UP}}, "files of meshes"),
    ],
)  # fmt: skip
def test_unusable_strokes_of_meshes_are_refused(tmp_path, stroke, words):
    BOX.export(tmp_path / "part.stl")
    (tmp_path / "job.json").write_text(json.dumps({"robot": "ur5", "strokes": [stroke]}))
    with pytest.raises(ToolPathError, match=words):
        read_tool_paths(tmp_path / "job.json")
