"""Pictures on meshes: where they lie, and that a browser shows them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from pinproof.viewer import write_html
from pinproof.viewer.stage import set_stage
from pinproof.viewer.wire import Commands

from .browser import Browser
from .conftest import small_arm

PLATE = '<visual><geometry><mesh filename="{file}"/></geometry></visual>'


def plate(folder: Path, *, torn: bool = False) -> Path:
    """A plate of 0.5 m across x and y whose left half is red and whose right half is blue, as OBJ with a PNG."""
    picture = np.zeros((64, 64, 3), dtype=np.uint8)
    picture[:, :32, 0], picture[:, 32:, 2] = 255, 255
    corners = np.array([[0.0, -0.25, 0.2], [0.5, -0.25, 0.2], [0.5, 0.25, 0.2], [0.0, 0.25, 0.2]])
    corners = np.concatenate([corners, corners - [0, 0, 0.02]])
    uv = np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (2, 1)).astype(float)
    faces = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], [0, 4, 5], [0, 5, 1], [1, 5, 6], [1, 6, 2]]
    material = trimesh.visual.material.SimpleMaterial(image=Image.fromarray(picture))
    mesh = trimesh.Trimesh(corners, faces, visual=trimesh.visual.TextureVisuals(uv, material=material), process=False)
    mesh.export(folder / "plate.obj")
    if torn:
        (picture_file,) = (path for path in folder.iterdir() if path.suffix == ".png")
        picture_file.write_bytes(picture_file.read_bytes()[:60])
    return folder / "plate.obj"


def test_a_picture_goes_with_its_vertices(tmp_path) -> None:
    stage = set_stage(small_arm(upper=PLATE.format(file=plate(tmp_path))), None)
    (surface,) = stage.links[1].surfaces
    assert surface.image.startswith("data:image/jpeg;base64,")
    assert np.allclose(surface.uv[:, 0], surface.vertices[:, 0] / 0.5, atol=1e-3)
    assert np.allclose(surface.uv[:, 1], surface.vertices[:, 1] / 0.5 + 0.5, atol=1e-3)
    commands = Commands()
    commands.set_surface("/robot/upper/visual/0", surface)
    assert commands.pictures == {surface.image: [["robot", "upper", "visual", "0"]]}


def test_a_torn_picture_leaves_the_plain_colour(tmp_path) -> None:
    stage = set_stage(small_arm(upper=PLATE.format(file=plate(tmp_path, torn=True))), None)
    assert [surface.image for surface in stage.links[1].surfaces] == [None]


def test_the_picture_has_the_same_orientation_in_a_browser(
    browser: Browser, pages: Callable[[str], Path], tmp_path
) -> None:
    path = pages("pictured")
    write_html(path, small_arm(upper=PLATE.format(file=plate(tmp_path))))
    page = browser.open(path.as_uri(), 800, 480)
    page.evaluate("pinproof.pictured.then(() => true)")
    red, green, blue = page.canvas().astype(int).transpose(2, 0, 1)
    places = {}
    for name, mask in (("red", (red > 1.6 * green) & (red > 1.6 * blue)), ("blue", (blue > 1.6 * red) & (blue > 90))):
        assert mask.sum() > 300, name
        places[name] = np.argwhere(mask).mean(axis=0)
    ends = page.evaluate(
        "[0.1, 0.4].map((x) => { const v = new MeshCat.THREE.Vector3(x, 0.2, 0).project(pinproof.viewer.camera);"
        " const c = document.querySelector('canvas'); return [(1 - v.y) / 2 * c.height, (1 + v.x) / 2 * c.width]; })"
    )  # three.js has y up: (x, z, -y)
    direction = np.subtract(ends[1], ends[0])
    assert (places["blue"] - places["red"]) @ direction > 0
    assert page.complaints == []
    page.close()
