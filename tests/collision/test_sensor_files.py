"""Files of depth images and point clouds, the boxes and grids of clouds, and proofs of motions beside them."""

from __future__ import annotations

import itertools
import pickle
import sys
from pathlib import Path

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision import read_points, setup_of
from pinproof.collision.geometry.bodies import shape_bodies, shape_body
from pinproof.collision.geometry.depth_image import read_image
from pinproof.collision.geometry.occupancy import FREE, SEEN
from pinproof.collision.geometry.surfaces import Cells
from pinproof.errors import FileError, SceneError

from .depth_camera import ABOVE, BOUNDS, CAMERA, PART, TABLE, depth_image

SETTINGS = {"voxel": 0.02, "bounds": BOUNDS}
IMAGE = depth_image(CAMERA, ABOVE, [TABLE, PART])


def points_of(image: np.ndarray, in_root: bool = True) -> np.ndarray:
    """The points (N, 3) that the pixels of the camera measure."""
    v, u = np.nonzero(image > 0)
    z = image[v, u]
    points = np.column_stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z])
    return points @ ABOVE[:3, :3].T + ABOVE[:3, 3] if in_root else points


CLOUD = points_of(IMAGE)


def grid_of(points: object, **changes: object) -> pp.OccupancyGrid:
    return pp.OccupancyGrid.from_points(points, CAMERA, ABOVE, **{**SETTINGS, **changes})


def test_the_cloud_of_a_depth_image_gives_the_cells_of_the_image():
    expected = pp.OccupancyGrid.from_depth(IMAGE, CAMERA, ABOVE, **SETTINGS)
    shuffled = np.random.default_rng(0).permutation(CLOUD)
    for grid in (grid_of(shuffled), grid_of(points_of(IMAGE, in_root=False), cloud_pose=ABOVE)):
        np.testing.assert_array_equal(grid.cells, expected.cells)
    assert grid_of(CLOUD).counts[0] > 10_000


@pytest.mark.parametrize("unknown", ["occupied", "free"])
@pytest.mark.parametrize("share", [1.0, 0.2, 0.02])
def test_no_measured_point_is_in_a_free_cell(unknown, share):
    """Of dense and sparse clouds, with points of another sensor that are outside the view of the camera."""
    rng = np.random.default_rng(0)
    cloud = CLOUD[rng.random(len(CLOUD)) < share]
    cloud = np.concatenate([cloud, rng.uniform(*SETTINGS["bounds"], (500, 3))])
    grid = grid_of(cloud, unknown=unknown)
    inside = ((cloud >= SETTINGS["bounds"][0]) & (cloud < SETTINGS["bounds"][1])).all(axis=1)
    index = np.floor(cloud[inside] / grid.voxel).astype(int) - grid.low
    assert grid.occupied[tuple(index.T)].all()


def test_pixels_without_a_point_prove_nothing_free():
    beside = CLOUD[CLOUD[:, 0] > 0.5]
    grid = grid_of(beside)
    u = CAMERA.cx + CAMERA.fx * ((beside - ABOVE[:3, 3]) @ ABOVE[:3, 0]) / ((beside - ABOVE[:3, 3]) @ ABOVE[:3, 2])
    center = (np.argwhere(grid.cells == FREE) + grid.low + 0.5) * grid.voxel - ABOVE[:3, 3]
    free = CAMERA.cx + CAMERA.fx * (center @ ABOVE[:3, 0]) / (center @ ABOVE[:3, 2])
    assert len(free) > 1000
    assert free.min() > u.min()


def test_the_record_states_the_number_of_points_that_are_not_finite():
    grid = grid_of(np.concatenate([CLOUD, np.full((3, 3), np.nan)]))
    assert any(str(len(CLOUD)) in line and "3 others" in line for line in grid.record)
    assert grid.cells.tobytes() == grid_of(CLOUD).cells.tobytes()


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.zeros((0, 3)), "empty"),
        ([], "empty"),
        (np.full((4, 3), np.nan), "is finite"),
        (CLOUD * 1000, "millimetres"),
        (CLOUD[:, :2], "shape"),
        ([[0.5, 0.0, "a"]], "numbers"),
        (CLOUD + np.array([0, 0, 50.0]), "in the view"),
        (ABOVE[:3, 3] + np.array([[0.0, 0.0, -0.015]]), "covered or inside an obstacle"),
    ],
)
def test_an_unusable_cloud_is_refused_with_its_reason(points, words):
    with pytest.raises(pp.InputError, match=words):
        grid_of(points)


def write_points(path: Path) -> Path:
    if path.suffix == ".npy":
        np.save(path, CLOUD)
    elif path.suffix == ".ply":
        import trimesh

        trimesh.PointCloud(CLOUD).export(path)
    else:
        pypcd4 = pytest.importorskip("pypcd4")
        pypcd4.PointCloud.from_xyz_points(CLOUD.astype(np.float32)).save(path)
    return path


@pytest.mark.parametrize("name", ["a.npy", "a.ply", "a.pcd"])
def test_clouds_are_read_and_damaged_files_refused(tmp_path, name):
    path = write_points(tmp_path / name)
    np.testing.assert_allclose(read_points(path), CLOUD, atol=2e-7)
    assert grid_of(path).counts[0] > 10_000
    data = path.read_bytes()
    for cut in (b"garbage", data[: len(data) // 2], data[:-5]):
        path.write_bytes(cut)
        with pytest.raises(FileError, match="point cloud"):
            read_points(path)


def test_a_depth_image_is_read_from_the_channel_of_depth_of_an_exr_file(tmp_path):
    exr = pytest.importorskip("OpenEXR")
    depth, colour = IMAGE.astype(np.float32), np.ones(IMAGE.shape, dtype=np.float32)
    head = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    expected = pp.OccupancyGrid.from_depth(depth, CAMERA, ABOVE, **SETTINGS)
    for name, channels in (("one", {"V": depth}), ("render", {"Camera.Z": depth, "R": colour, "G": colour})):
        path = tmp_path / f"{name}.exr"
        exr.File(head, channels).write(str(path))
        assert pp.OccupancyGrid.from_depth(path, CAMERA, ABOVE, **SETTINGS) == expected
    exr.File(head, {"R": colour, "G": colour}).write(str(tmp_path / "colour.exr"))
    (tmp_path / "bad.exr").write_bytes(b"garbage")
    for name, words in (("colour.exr", "channels"), ("bad.exr", "bad.exr")):
        with pytest.raises(FileError, match=words):
            pp.OccupancyGrid.from_depth(tmp_path / name, CAMERA, ABOVE, **SETTINGS)


@pytest.mark.parametrize(("name", "library"), [("a.exr", "OpenEXR"), ("a.pcd", "pypcd4")])
def test_a_missing_library_is_reported_with_its_extra(tmp_path, monkeypatch, name, library):
    (tmp_path / name).write_bytes(b"x")
    monkeypatch.setitem(sys.modules, library, None)
    read = read_image if name.endswith("exr") else read_points
    with pytest.raises(pp.InputError, match=r"pinproof\[sensor\]"):
        read(tmp_path / name)


def test_a_scene_file_names_a_cloud_as_a_view(tmp_path):
    write_points(tmp_path / "cloud.ply")
    text = """
obstacles:
  - name: camera
    occupancy_grid:
      voxel: 0.02
      bounds: [[0.0, -0.5, -0.1], [1.0, 0.5, 0.6]]
      views:
        - {source}
          intrinsics: {{fx: 150, fy: 150, cx: 79.5, cy: 59.5, width: 160, height: 120}}
          camera: {{xyz: [0.3, -0.2, 1.2], rpy: [3.141592653589793, 0, 0]}}
"""
    path = tmp_path / "scene.yaml"
    path.write_text(text.format(source="points: cloud.ply"), encoding="utf-8")
    (obstacle,) = pp.Scene.load(path).obstacles
    assert (obstacle.shape.cells == SEEN).any()
    np.save(tmp_path / "image.npy", np.round(IMAGE * 1e3).astype(np.uint16))
    source = "image: image.npy\n          depth_scale: 0.001"
    path.write_text(text.format(source=source), encoding="utf-8")
    assert (pp.Scene.load(path).obstacles[0].shape.cells == SEEN).any()
    for wrong in ("points: none.ply", "{image: cloud.ply, points: cloud.ply}", "depth_scale: 1.0"):
        source = wrong.strip("{}").replace(", ", "\n          ")
        path.write_text(text.format(source=source), encoding="utf-8")
        with pytest.raises(SceneError, match=r"points"):
            pp.Scene.load(path)
    for wrong in ("[160]", ".nan"):
        path.write_text(text.format(source="points: cloud.ply").replace("width: 160", f"width: {wrong}"), "utf-8")
        with pytest.raises(SceneError, match=r"'camera'.*width"):
            pp.Scene.load(path)


def test_half_floats_in_millimetres_are_converted_without_rounding():
    millimetres = np.round(IMAGE * 1e3).astype(np.float16)
    exact = millimetres.astype(float)
    settings = {**SETTINGS, "depth_scale": 0.001, "depth_uncertainty": 0.0}
    grid = pp.OccupancyGrid.from_depth(millimetres, CAMERA, ABOVE, **settings)
    np.testing.assert_array_equal(grid.cells, pp.OccupancyGrid.from_depth(exact, CAMERA, ABOVE, **settings).cells)


def test_masked_points_are_no_measurements():
    masked = np.ma.MaskedArray(CLOUD, mask=False)
    masked[: len(CLOUD) // 2] = np.ma.masked
    np.testing.assert_array_equal(grid_of(masked).cells, grid_of(CLOUD[len(CLOUD) // 2 :]).cells)


def test_other_files_of_points_are_refused(tmp_path):
    for columns in (2, 4):
        np.save(tmp_path / f"{columns}.npy", np.zeros((5, columns)))
    np.save(tmp_path / "flat.npy", np.zeros(3))
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    text = f"ply\nformat ascii 1.0\nelement vertex 3\n{properties}end_header\n0 0 1\n0 0 2\n"
    (tmp_path / "short.ply").write_text(text)
    for name, words in (
        ("flat.npy", "N, 3"), ("2.npy", r"points \(N, 3\)"), ("4.npy", r"points \(N, 3\)"), ("short.ply", "states"),
        ("none.ply", "none.ply"), ("cloud.txt", "npy, .ply, .pcd"),
    ):  # fmt: skip
        with pytest.raises(FileError, match=words):
            read_points(tmp_path / name)


HERE = pp.pose((0.2, -0.1, 0.3), (0.3, -0.4, 0.5))


def noisy_table(noise: float, resolution: float = 0.02) -> pp.PointCloud:
    """A table top and a wall behind it as a depth camera measures them."""
    rng = np.random.default_rng(0)
    x, y = (side.ravel() for side in np.meshgrid(np.arange(0.3, 1.0, 0.01), np.arange(-0.6, 0.6, 0.01)))
    table = np.stack([x, y, np.full_like(x, -0.05)], axis=1)
    wall = np.stack([np.full_like(x, 1.0), y, x - 0.3], axis=1)
    points = np.concatenate([table, wall])
    return pp.PointCloud(points + rng.normal(0, noise, points.shape), resolution)


cells_of_any_shape = st.lists(st.tuples(*[st.integers(-3, 3)] * 3), min_size=1, max_size=60, unique=True).map(
    lambda cells: np.array(cells, dtype=np.int64)
)


def boxes_of(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The boxes of cells of a side of 1 m: their lower and upper corners."""
    low, high = np.moveaxis(Cells(pp.PointCloud(cells + 0.5, 1.0)).boxes, 1, 0)
    return low.astype(int), high.astype(int)


@given(cells_of_any_shape)
def test_boxes_contain_each_cell_once_and_no_other_space(cells):
    low, high = boxes_of(cells)
    held = [
        cell
        for first, last in zip(low.tolist(), high.tolist(), strict=True)
        for cell in itertools.product(*(range(a, b) for a, b in zip(first, last, strict=True)))
    ]
    assert sorted(held) == sorted(map(tuple, cells.tolist()))


def test_a_plane_of_cells_is_one_box():
    low, high = boxes_of(np.array(list(itertools.product(range(20), range(30), [4]))))
    assert (low.tolist(), high.tolist()) == ([[0, 0, 4]], [[20, 30, 5]])


def test_the_boxes_are_where_the_cells_are():
    cloud = pp.PointCloud(np.random.default_rng(1).uniform(-0.2, 0.2, (200, 3)), 0.05)
    bodies = shape_bodies("cloud", None, cloud, HERE)
    assert {body.owner for body in bodies} == {"cloud"}
    (body,) = bodies
    inside = np.random.default_rng(2).uniform(-0.25, 0.25, (500, 3))
    cells = set(map(tuple, cloud.cells.tolist()))
    for point in inside:
        there = tuple(np.floor(point / 0.05).astype(int).tolist()) in cells
        place = HERE.act(point)
        local = body.link_from_body.actInv(place)
        boxed = any((low <= local).all() and (local <= high).all() for low, high in body.solid.boxes)
        assert boxed == there


def test_distances_equal_those_of_the_surface_of_the_cells():
    """The distance of a ball from the boxes is that from one mesh of the outer faces of all cells."""
    cloud, ball = noisy_table(0.005), coal.Sphere(0.02)
    bodies = [*shape_bodies("cloud", None, cloud, pp.pose()), shape_body("cloud", "cloud", None, cloud, pp.pose())]
    for center in np.random.default_rng(3).uniform([0.3, -0.6, 0.05], [0.9, 0.6, 0.5], (10, 3)):
        *boxes, surface = (
            coal.distance(
                body.geometry,
                coal.Transform3s(body.link_from_body.rotation, body.link_from_body.translation),
                ball,
                coal.Transform3s(np.eye(3), center),
                coal.DistanceRequest(),
                coal.DistanceResult(),
            )
            for body in bodies
        )
        assert min(boxes) == pytest.approx(surface, abs=2e-6)


def test_points_that_are_not_finite_are_dropped_and_counted():
    measured = [[0.1, 0.2, 0.3], [np.nan, 0, 0], [0, np.inf, 0], [0.5, 0.5, 0.5]]
    cloud = pp.PointCloud(measured, 0.01)
    assert (len(cloud.points), cloud.dropped) == (2, 2)
    assert pickle.loads(pickle.dumps(cloud)).dropped == 2
    checker = pp.CollisionChecker(pp.load_robot("ur5").arm(), pp.Scene([pp.Obstacle("seen", cloud)]))
    assert any("2 points that are not finite are dropped" in note for note in setup_of(checker).notes)


def test_a_cloud_without_a_finite_point_is_refused():
    with pytest.raises(pp.InputError, match="3 points, of which none is finite"):
        pp.PointCloud(np.full((3, 3), np.nan), 0.01)


def test_points_of_a_scene_file_may_be_not_finite(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("obstacles:\n  - {name: a, point_cloud: {points: [[0, 0, 1], [.nan, 0, 0]], resolution: 0.1}}")
    assert pp.Scene.load(path)["a"].shape.dropped == 1
    path.write_text("obstacles:\n  - {name: a, point_cloud: {points: [[.nan, 0, 0]], resolution: 0.1}}")
    with pytest.raises(SceneError, match="none is finite"):
        pp.Scene.load(path)
