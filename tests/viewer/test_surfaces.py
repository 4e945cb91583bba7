from dataclasses import dataclass
from typing import get_args

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from pinproof import Box, Capsule, Cylinder, HalfSpace, Mesh, Obstacle, OccupancyGrid, PointCloud, Sphere
from pinproof.collision import Cone, ConvexShape, Ellipsoid, HeightMap
from pinproof.collision.geometry.bodies import shape_body
from pinproof.collision.geometry.shapes import Shape
from pinproof.description import LinkGeometry
from pinproof.errors import ViewerError
from pinproof.spatial import matrix, pose
from pinproof.viewer.surfaces import (
    SHAPES,
    body_surfaces,
    link_surfaces,
    merge_by_colour,
    obstacle_surfaces,
    shade,
    tube,
)

GREY = (0.5, 0.5, 0.5, 1.0)
RED = (1.0, 0.0, 0.0, 1.0)


def shaded(mesh, rgba=GREY):
    return shade(np.array(mesh.vertices), np.array(mesh.faces), rgba)


def test_a_box_keeps_its_edges_sharp():
    box = shaded(trimesh.creation.box(extents=(1, 2, 3)))
    assert box.vertices.shape == (24, 3)  # three normals at each of eight corners
    assert np.allclose(np.sort(np.abs(box.normals), axis=1), [0, 0, 1])


def test_a_sphere_is_smooth_all_over():
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
    surface = shaded(ball)
    assert len(surface.vertices) == len(ball.vertices)
    outward = np.einsum("ij,ij->i", surface.normals, surface.vertices / 0.3)
    assert outward.min() > np.cos(np.deg2rad(3))
    # a mesh whose triangles share no vertex is welded
    soup = shade(ball.triangles.reshape(-1, 3), np.arange(3 * len(ball.faces)).reshape(-1, 3), GREY)
    assert len(soup.vertices) == len(ball.vertices)


def test_a_cylinder_has_a_smooth_side_and_a_sharp_rim():
    sections = 24
    surface = shaded(trimesh.creation.cylinder(radius=0.1, height=0.4, sections=sections))
    flat = np.abs(surface.normals[:, 2])
    assert np.all((flat < 1e-6) | (flat > 1 - 1e-6))
    assert (flat < 1e-6).sum() == 2 * sections


def test_shading_moves_no_triangle():
    ring = trimesh.creation.annulus(0.1, 0.2, 0.05)
    surface = shaded(ring)
    assert np.allclose(surface.vertices[surface.triangles], ring.triangles, atol=1e-5)
    cross = np.cross(*np.swapaxes(np.diff(surface.vertices[surface.triangles], axis=1), 0, 1))
    facing = np.einsum("ij,ij->i", cross, surface.normals[surface.triangles].mean(axis=1))
    assert (facing > 0).all()


def test_slivers_without_area_are_left_out():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    surface = shade(points, np.array([[0, 1, 2], [0, 1, 3]]), GREY)
    assert len(surface.triangles) == 1
    assert np.isfinite(surface.normals).all()


def test_surfaces_of_one_colour_become_one():
    parts = [
        shaded(trimesh.creation.box(), GREY),
        shaded(trimesh.creation.box(), RED),
        shaded(trimesh.creation.icosphere(), GREY),
    ]
    merged = merge_by_colour(parts)
    assert [surface.rgba for surface in merged] == [GREY, RED]
    corners = np.concatenate([p.vertices[p.triangles] for p in (parts[0], parts[2])])
    assert np.array_equal(merged[0].vertices[merged[0].triangles], corners)


@given(st.tuples(*[st.floats(-3, 3)] * 6))
def test_moving_keeps_distances_and_normals(numbers):
    surface = shaded(trimesh.creation.box(extents=(1, 2, 3)))
    moved = surface.moved(matrix(pose(numbers[:3], numbers[3:])))
    assert np.allclose(np.linalg.norm(moved.normals, axis=1), 1)
    assert np.allclose(
        np.linalg.norm(np.diff(moved.vertices, axis=0), axis=1),
        np.linalg.norm(np.diff(surface.vertices, axis=0), axis=1),
    )


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=8))
def test_a_tube_keeps_its_radius_where_its_line_reverses(points):
    line = np.array(points)
    surface = tube(line, 0.01, RED)
    if surface is None:
        assert np.ptp(line, axis=0).max() <= 0.01
        return
    nearest = np.min(np.linalg.norm(surface.vertices[:, None] - line[None], axis=2), axis=1)
    assert np.allclose(nearest, 0.01, atol=1e-9) or nearest.max() <= 0.01 + 1e-9
    assert np.allclose(np.linalg.norm(surface.normals, axis=1), 1)


BALL = trimesh.creation.icosphere(2, 0.2)
EXAMPLES = {
    "box": Box(0.1, 0.2, 0.3),
    "sphere": Sphere(0.2),
    "cylinder": Cylinder(0.2, 0.6),
    "capsule": Capsule(0.1, 0.4),
    "cone": Cone(0.2, 0.6),
    "ellipsoid": Ellipsoid(0.1, 0.2, 0.3),
    "hull": ConvexShape(np.random.default_rng(0).normal(size=(20, 3))),
    "rounded": ConvexShape(np.random.default_rng(0).normal(size=(20, 3)), 0.1),
    "mesh": Mesh.from_arrays(BALL.vertices, BALL.faces, hull=False),
    "cloud": PointCloud(np.random.default_rng(1).uniform(-1, 1, (40, 3)), 0.1),
    "ground": HeightMap(np.random.default_rng(2).uniform(0, 0.2, (4, 5)), 1, 2),
    "grid": OccupancyGrid(np.random.default_rng(3).integers(0, 3, (4, 5, 6)), 0.1, (-2, 0, 1)),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_shape_is_drawn_where_it_collides_with_outward_faces(name):
    (surface,) = obstacle_surfaces(Obstacle("thing", EXAMPLES[name]))
    box = shape_body("thing", "thing", None, EXAMPLES[name], pose()).box
    assert np.allclose([surface.vertices.min(axis=0), surface.vertices.max(axis=0)], box, atol=3e-3)
    corners = surface.vertices[surface.triangles]
    assert np.linalg.det(corners).sum() > 0  # six times the volume: positive if triangles turn left seen from outside


def test_a_half_space_is_drawn_as_a_plate_under_its_plane():
    (surface,) = obstacle_surfaces(Obstacle("floor", HalfSpace(), rgba=RED))
    assert surface.vertices[:, 2].max() == pytest.approx(0, abs=1e-12)
    assert np.ptp(surface.vertices[:, :2], axis=0).min() > 1
    assert surface.rgba == RED


def test_every_shape_is_registered():
    assert set(SHAPES) == set(get_args(Shape))
    assert {type(shape) for shape in EXAMPLES.values()} | {HalfSpace} == set(SHAPES)


@dataclass(frozen=True)
class Torus:
    """A shape that the viewer does not support, with the fields of a capsule."""

    radius: float
    length: float


def test_an_unknown_shape_is_refused_and_the_known_ones_are_named():
    obstacle = Obstacle("ring", Capsule(0.1, 0.4))
    object.__setattr__(obstacle, "shape", Torus(0.1, 0.4))
    with pytest.raises(ViewerError, match=r"Torus.*Box.*Capsule"):
        obstacle_surfaces(obstacle)


@pytest.mark.parametrize("draw", [link_surfaces, body_surfaces])
def test_an_unknown_primitive_of_a_link_is_refused(draw):
    geometry = LinkGeometry("torus", "upper", "torus", (0.1, 0.4), np.eye(4))
    with pytest.raises(ViewerError, match=r"torus.*upper.*box"):
        draw(geometry)
