"""Simplification of meshes for display."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pinproof.collision import Mesh, Obstacle, Scene
from pinproof.spatial import pose
from pinproof.viewer import page as page_module
from pinproof.viewer import stage as stage_module
from pinproof.viewer.picture import Picture
from pinproof.viewer.stage import MAX_BYTES, set_stage, simplified

from .conftest import small_arm


@pytest.fixture(scope="module")
def globe() -> Scene:
    made = trimesh.creation.icosphere(subdivisions=5, radius=0.2)  # 20,480 triangles
    mesh = Mesh.from_arrays(np.array(made.vertices), np.array(made.faces))
    return Scene([Obstacle("globe", mesh, pose(xyz=(0.8, 0, 0.2)))])


def drawn(scene: Scene, max_bytes: float):
    stage = simplified(set_stage(small_arm(), scene), max_bytes)
    return stage, stage.obstacles[0].surfaces[0]


def test_a_mesh_that_fits_is_not_simplified(globe: Scene) -> None:
    stage, surface = drawn(globe, MAX_BYTES)
    assert stage.notes == ()
    assert len(surface.triangles) == 20480


@pytest.mark.parametrize("max_bytes", [300e3, 60e3])
def test_a_mesh_that_is_too_large_is_simplified_until_it_fits_and_keeps_its_shape(
    globe: Scene, max_bytes: float
) -> None:
    stage, surface = drawn(globe, max_bytes)
    assert stage_module.size_in_bytes(stage) <= max_bytes
    cell = float(stage.notes[0].split("details of ")[1].split()[0]) * 1e-3
    assert np.abs(np.linalg.norm(surface.vertices, axis=1) - 0.2).max() < cell
    assert np.linalg.norm(surface.vertices.max(axis=0) - surface.vertices.min(axis=0)) == pytest.approx(
        0.4 * 3**0.5, abs=2 * cell
    )
    solid = trimesh.Trimesh(surface.vertices, surface.triangles, process=True)
    assert solid.volume == pytest.approx(4 / 3 * np.pi * 0.2**3, rel=0.1)  # closed, and turned outwards as before
    along = np.einsum("ij,ij->i", surface.normals, surface.vertices / 0.2)
    assert np.median(along) > 0.9


def test_the_page_of_a_large_mesh_is_small_and_notes_the_simplification(globe: Scene, monkeypatch) -> None:
    monkeypatch.setattr(stage_module.simplified, "__defaults__", (100e3,))
    page = page_module.render_page(Picture(small_arm(), globe))
    assert "Meshes are simplified" in page.text
