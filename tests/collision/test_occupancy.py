"""Occupancy grids of depth images: states of cells, their conservativeness, fusion, removal, bodies and proofs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

import pinproof as pp
from pinproof._core import carve
from pinproof.collision import DepthView, Intrinsics, remove_body, remove_robot
from pinproof.collision.checking.sensor_removal import ray_depths
from pinproof.collision.geometry.bodies import shape_bodies
from pinproof.collision.geometry.occupancy import CLEARED, FREE, SEEN, UNKNOWN
from pinproof.collision.geometry.surfaces import cell_faces
from pinproof.errors import FileError
from pinproof.spatial import SE3

from ..examples import examples
from .depth_camera import ABOVE, BOUNDS, CAMERA, PART, TABLE, Solid, at, depth_image, look_at, states_by_definition

BEHIND = Solid(at(0.68, 0.05, 0.025), np.array([0.03, 0.03, 0.025]))


def view(solids: list[Solid], from_: np.ndarray = ABOVE, **settings: object) -> pp.OccupancyGrid:
    image = depth_image(CAMERA, from_, solids)
    return pp.OccupancyGrid.from_depth(image, CAMERA, from_, **{"voxel": 0.02, "bounds": BOUNDS, **settings})


def view_without(body: pp.Obstacle, solids: list[Solid], from_: np.ndarray = ABOVE) -> pp.OccupancyGrid:
    image = depth_image(CAMERA, from_, solids)
    seen = remove_body(DepthView.read(image, CAMERA, from_, depth_uncertainty=0.003), body)
    return pp.OccupancyGrid.from_view(seen, voxel=0.02, bounds=BOUNDS)


def states_at(grid: pp.OccupancyGrid, points: np.ndarray) -> np.ndarray:
    """The states of the cells that contain points (N, 3) of the bounds."""
    index = np.floor(points / grid.voxel).astype(int) - grid.low
    inside = ((index >= 0) & (index < grid.cells.shape)).all(axis=1)
    return grid.cells[tuple(index[inside].T)]


vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)


def test_bounds_of_depth_are_rounded_away_from_the_surface():
    intrinsics, low = np.array([4.0, 4.0, 4.0, 4.0]), np.array([-1, -1, 1])
    for share in (0.1, 0.9):  # between two numbers of single precision, near either of them
        surface = 1.0 + share * 2.0**-23
        cells = np.empty((2, 2, 1), dtype=np.uint8)
        side = (surface + 0.02 * 2.0**-23) / 2  # the far sides of the cells are just behind the surface
        carve(cells, low, side, np.eye(4), intrinsics, np.full((9, 9), surface), np.full((9, 9), surface), 0)
        assert (cells == SEEN).all()


@given(seed=st.integers(0, 2**32), margin=st.integers(0, 2), eye=vectors, roll=st.floats(-3, 3))
@examples(12)
@pytest.mark.slow
def test_states_equal_their_definition(seed, margin, eye, roll):
    rng = np.random.default_rng(seed)
    camera = Intrinsics(31.0, 29.0, 18.3, 14.6, 37, 29)
    root_from_camera = look_at(1.2 * eye, rng.uniform(-0.1, 0.1, 3) + 1e-3, roll)
    nearest = rng.choice([0.0, 0.4, 0.8, 1.2, 1.5, 3.0], (29, 37)).astype(np.float32)
    nearest = np.where(rng.random((29, 37)) < 0.9, np.median(nearest[nearest > 0]), nearest).astype(np.float32)
    farthest = np.where(nearest > 0, nearest + np.float32(0.05), 0).astype(np.float32)
    farthest[rng.random((29, 37)) < 0.05] = 0  # removed bodies
    cells, low, side = np.empty((9, 7, 11), dtype=np.uint8), np.array([-5, -3, -6]), 0.083
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    carve(cells, low, side, np.linalg.inv(root_from_camera), intrinsics, nearest, farthest, margin)
    expected = states_by_definition(camera, root_from_camera, nearest, farthest, low, cells.shape, side, margin)
    np.testing.assert_array_equal(cells, expected)


solids = st.builds(
    lambda center, rpy, half, ball: (
        Solid(at(*(center * [0.4, 0.4, 0.25] + [0.5, 0, 0.25])), radius=float(half.min()))
        if ball
        else Solid(at(*(center * [0.4, 0.4, 0.25] + [0.5, 0, 0.25]), tuple(rpy * 3)), half)
    ),
    vectors,
    vectors,
    st.tuples(*[st.floats(0.03, 0.2)] * 3).map(np.array),
    st.booleans(),
)


@given(
    scene=st.lists(solids, min_size=1, max_size=5),
    eyes=st.lists(vectors, min_size=1, max_size=3),
    seed=st.integers(0, 1000),
)
@examples(25)
@pytest.mark.slow
def test_no_point_of_a_surface_is_in_a_free_cell(scene, eyes, seed):
    """Seen or unseen: from random cameras, also of several views together."""
    rng = np.random.default_rng(seed)
    every = [TABLE, *scene]
    grids = []
    for eye in eyes:
        place = np.array([0.5, 0, 0.8]) + eye * [0.9, 0.9, 0.6]
        if any(np.isinf(each.depth(place, np.eye(3))).all() and _contains(each, place) for each in every):
            continue  # the camera is inside a body
        camera = look_at(place, np.array([0.5, 0.0, 0.1]) + rng.uniform(-0.1, 0.1, 3), rng.uniform(-3, 3))
        try:
            grids.append(view(every, camera, depth_uncertainty=0.003))
        except pp.InputError:
            continue  # it sees nothing of the bounds
    if not grids:
        return
    grid = grids[0].fuse(*grids[1:])
    for each in every:
        assert (states_at(grid, each.surface(2000, rng)) != FREE).all()


def _contains(solid: Solid, point: np.ndarray) -> bool:
    local = solid.pose[:3, :3].T @ (point - solid.pose[:3, 3])
    return bool((np.abs(local) <= solid.half).all() if solid.half is not None else local @ local <= solid.radius**2)


def test_space_in_front_of_a_table_is_free_and_hidden_space_is_not():
    grid = view([TABLE, PART])
    assert states_at(grid, np.array([[0.3, -0.1, 0.3]])) == FREE
    assert states_at(grid, np.array([[0.5, 0.0, 0.099]])) == SEEN  # the top of the part
    assert states_at(grid, np.array([[0.5, 0.0, 0.05], [0.5, 0, -0.09]])).tolist() == [UNKNOWN] * 2  # inside, below
    assert states_at(grid, np.array([[0.57, 0.05, 0.02]])) == UNKNOWN  # in the shadow of the part
    assert states_at(grid, np.array([[0.99, 0.49, 0.59]])) == UNKNOWN  # outside the view


@pytest.mark.parametrize("axis", range(3))
def test_a_grid_of_few_cells_along_two_axes_is_the_part_of_a_large_one(axis):
    whole = view([TABLE, PART])
    low, high = np.array([0.44, -0.04, 0.08]), np.array([0.46, -0.02, 0.10])
    low[axis], high[axis] = np.array(BOUNDS)[:, axis] + [0.04, -0.04]
    column = view([TABLE, PART], bounds=[tuple(low), tuple(high)])
    first = np.array(column.low) - whole.low
    last = first + column.cells.shape
    assert max(column.cells.shape) > 20
    assert (column.cells == whole.cells[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]).all()
    assert len(np.unique(column.cells)) > 1


def test_pixels_without_a_measurement_prove_nothing():
    image = depth_image(CAMERA, ABOVE, [TABLE])
    holes = image.copy()
    holes[40:60, 50:80] = np.nan
    holes[80:90, 100:110] = np.inf
    settings = {"voxel": 0.02, "bounds": BOUNDS}
    whole = pp.OccupancyGrid.from_depth(image, CAMERA, ABOVE, **settings)
    torn = pp.OccupancyGrid.from_depth(holes, CAMERA, ABOVE, **settings)
    assert ((torn.cells == FREE) <= (whole.cells == FREE)).all()
    assert 0 < torn.counts[0] < whole.counts[0]


@pytest.mark.parametrize("mark", ["masked", 65535, 65535.0, np.int32(65535), 2**31 - 1, 1e30])
def test_marks_of_pixels_without_a_measurement_prove_nothing(mark):
    image = np.round(depth_image(CAMERA, ABOVE, [TABLE]) * 1000)
    hole = np.zeros(image.shape, dtype=bool)
    hole[50:70, 70:90] = True
    nothing, marked = np.where(hole, 0, image), np.ma.masked_array(image, mask=hole)
    if mark != "masked":
        kind = np.uint16 if isinstance(mark, int) and mark < 2**16 else np.int32
        marked = np.where(hole, mark, image).astype(float if isinstance(mark, float) else kind)
    made = [
        pp.OccupancyGrid.from_depth(each, CAMERA, ABOVE, voxel=0.02, bounds=BOUNDS, depth_scale=0.001)
        for each in (nothing, marked)
    ]
    np.testing.assert_array_equal(made[0].cells, made[1].cells)


def test_a_float_image_of_far_surfaces_is_in_metres_unless_all_depths_are_whole_numbers():
    depths = np.full((CAMERA.height, CAMERA.width), 20.25)
    depths[:60] = 20.0
    assert (DepthView.read(depths, CAMERA, ABOVE).depth == depths).all()
    with pytest.raises(pp.InputError, match=r"depth_scale=0\.001"):
        DepthView.read(np.round(depths), CAMERA, ABOVE)


def test_points_behind_the_camera_are_beside_its_image():
    rng = np.random.default_rng(0)
    front = np.column_stack([rng.uniform(-0.3, 0.3, (500, 2)), rng.uniform(0.8, 1.2, 500)])
    behind = np.array([[0.0, 0.0, -1.0], [1e-3, 0.0, -0.5], [0.0, 0.0, 0.005]])
    eye = look_at(np.array([0.2, 0.1, 0.9]), np.array([0.5, 0.0, 0.0]))
    clouds = [cloud @ eye[:3, :3].T + eye[:3, 3] for cloud in (front, np.concatenate([front, behind]))]
    one, both = (DepthView.from_points(cloud, CAMERA, eye) for cloud in clouds)
    for name in ("depth", "nearest", "farthest"):
        np.testing.assert_array_equal(getattr(one, name), getattr(both, name))
    assert len(both.beside) == len(one.beside) + 3


def test_a_grid_without_an_occupied_cell_is_no_obstacle_and_is_noted():
    grid = pp.OccupancyGrid(np.zeros((3, 3, 3), dtype=int), 0.5)
    arm = pp.load_robot("ur5").arm()
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("camera", grid)]))
    assert checker.is_free(arm.home)
    path = pp.JointPath(np.array([arm.home, arm.home + 0.01]), arm.joint_names)
    assert any("camera: occupancy grid" in note for note in pp.certify(path, checker).notes)
    assert cell_faces(grid)[0].shape == (0, 3)


def test_unseen_cells_are_free_only_if_asked_for_and_then_it_is_stated():
    occupied, free = view([TABLE, PART]), view([TABLE, PART], unknown="free")
    assert occupied.occupied.sum() == sum(occupied.counts[1:])
    assert free.occupied.sum() == free.counts[1]
    arm = pp.load_robot("ur5").arm()
    path = pp.JointPath(np.array([arm.home, arm.home]), arm.joint_names)
    for grid, stated in ((occupied, "space that was not seen is an obstacle"), (free, "was not seen is free")):
        certificate = pp.certify(
            path, pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("camera", grid, pp.pose((0, 3, 0)))]))
        )
        assert any("camera" in note and stated in note for note in certificate.notes)


def test_a_cell_is_free_if_one_of_several_views_proves_it():
    other = look_at(np.array([0.9, 0.4, 1.0]), np.array([0.5, 0.0, 0.0]))
    one, two = view([TABLE, PART]), view([TABLE, PART], other)
    both = one | two
    np.testing.assert_array_equal(both.cells == FREE, (one.cells == FREE) | (two.cells == FREE))
    assert both.counts[0] > max(one.counts[0], two.counts[0])
    assert set(both.record) == {*one.record, *two.record}
    with pytest.raises(pp.InputError, match="same voxel, bounds and unknown"):
        one | view([TABLE], voxel=0.04)
    with pytest.raises(pp.InputError, match="same voxel, bounds and unknown"):
        one | view([TABLE], unknown="free")


def test_the_robot_is_removed_with_its_padding_and_nothing_else():
    arm = pp.load_robot("ur5").arm()
    checker = pp.CollisionChecker(arm, margin=0.005)
    everything = pp.OccupancyGrid(np.full((60, 60, 60), UNKNOWN), 0.02, (-30, -30, 0))
    cleared = remove_robot(everything, checker, arm.home)
    assert checker.with_scene(pp.Scene([pp.Obstacle("camera", cleared)])).is_free(arm.home)
    assert "cells within" in cleared.record[-1]
    # Every cleared cell is within the padding of a body.
    free = np.argwhere(cleared.cells == CLEARED)
    padding = 0.005 + np.sqrt(3) * 0.02 + 1e-6
    rng = np.random.default_rng(0)
    chosen = rng.choice(free, 40)
    for cell in chosen:
        center = (cell + cleared.low + rng.random(3)) * 0.02
        ball = pp.Scene([pp.Obstacle("point", pp.Sphere(1e-6), pp.pose(center))])
        assert checker.with_scene(ball).with_margin(padding).check(arm.home).contacts
    same = remove_robot(everything, checker, arm.home, padding=0.0)
    assert 0 < same.counts[0] < cleared.counts[0]


def test_a_robot_of_cylinders_is_removed_from_cells_in_line_with_their_axes():
    """Nodes on an axis of a cylinder are a degenerate case of the distance."""
    arm = pp.load_robot("generic_6dof").arm()
    checker = pp.CollisionChecker(arm)
    grid = pp.OccupancyGrid(np.full((20, 10, 10), UNKNOWN), 0.02, (-10, -5, 0))
    grid = remove_robot(grid, checker, arm.home)
    assert checker.with_scene(pp.Scene([pp.Obstacle("camera", grid)])).is_free(arm.home)


def test_a_surface_that_another_view_shows_is_kept_where_the_robot_was_removed():
    arm = pp.load_robot("ur5").arm()
    checker = pp.CollisionChecker(arm)
    shape, low = (60, 60, 60), (-30, -30, 0)
    cleared = remove_robot(pp.OccupancyGrid(np.full(shape, UNKNOWN), 0.02, low), checker, arm.home)
    for state, expected in ((SEEN, SEEN), (UNKNOWN, CLEARED), (FREE, FREE)):
        other = pp.OccupancyGrid(np.full(shape, state), 0.02, low)
        for fused in (cleared | other, other | cleared):
            assert (fused.cells[cleared.cells == CLEARED] == expected).all()
            assert (fused.occupied == (fused.cells == SEEN) | (fused.cells == UNKNOWN)).all()


PICKED = pp.Obstacle("part", pp.Box(0.1, 0.1, 0.1), PART.pose)


def test_cells_inside_a_body_are_removed_and_shared_cells_stay():
    grid = view([TABLE, PART])
    rest = remove_body(grid, PICKED)
    cells = np.argwhere(grid.occupied & ~rest.occupied) + grid.low
    low, high = np.array([0.45, -0.05, 0.0]) - 1e-9, np.array([0.55, 0.05, 0.1]) + 1e-9
    assert len(cells) == 4 * 4 * 5  # entirely in the part: x from 0.46 to 0.54
    assert ((cells * 0.02 >= low) & ((cells + 1) * 0.02 <= high)).all()
    assert "80 cells in part" in rest.record[-1]


@given(seed=st.integers(0, 1000), eye=vectors)
@examples(12)
def test_space_behind_a_removed_body_is_not_proven_free(seed, eye):
    rng = np.random.default_rng(seed)
    camera = look_at(np.array([0.5, 0, 1.1]) + eye * [0.5, 0.5, 0.2], np.array([0.5, 0, 0.0]), rng.uniform(-3, 3))
    grid = view_without(PICKED, [TABLE, PART, BEHIND], camera)
    for each in (TABLE, BEHIND):  # also where the part is on the table, and hides the other
        assert (states_at(grid, each.surface(3000, rng)) != FREE).all()
    inside_only = remove_body(view([TABLE, PART, BEHIND], camera, depth_uncertainty=0.003), PICKED)
    assert (~inside_only.occupied <= ~grid.occupied).all()


def test_cells_at_the_visible_faces_of_a_removed_body_are_free():
    camera = look_at(np.array([1.0, -0.5, 0.9]), np.array([0.5, 0.0, 0.0]))
    grid = view_without(PICKED, [TABLE, PART, BEHIND], camera)
    faces = np.array([[0.548, -0.02, 0.07], [0.51, -0.048, 0.09]])  # in cells that the part fills by half
    assert states_at(grid, faces).tolist() == [FREE, FREE]
    assert SEEN in states_at(remove_body(view([TABLE, PART, BEHIND], camera), PICKED), faces)
    assert "part is removed" in grid.record[1]


def test_space_hidden_by_the_outline_of_a_removed_body_is_not_free():
    # A plate beside the body, entirely behind its top face and within the last pixel of its outline; small cells.
    coarse, eye = Intrinsics(57.0, 57.0, 31.5, 31.5, 64, 64), np.diag([1.0, -1.0, -1.0, 1.0])
    eye[:3, 3] = 0.5, 0.0, 0.6
    plate = Solid(at(0.5512, 0.0, 0.035), np.array([0.0012, 0.04, 0.035]))
    image = depth_image(coarse, eye, [TABLE, PART, plate])
    assert np.array_equal(image, depth_image(coarse, eye, [TABLE, PART]))
    seen = remove_body(DepthView.read(image, coarse, eye, depth_uncertainty=0.001), PICKED)
    grid = pp.OccupancyGrid.from_view(seen, voxel=0.001, bounds=[(0.54, -0.02, -0.01), (0.57, 0.02, 0.12)])
    points = plate.surface(20000, np.random.default_rng(0))
    assert (states_at(grid, points[points[:, 0] > 0.5501]) != FREE).all()
    assert grid.counts[0] > 0


def test_a_body_that_the_image_shows_elsewhere_is_refused():
    with pytest.raises(pp.InputError, match="'part' is not where it is stated to be"):
        view_without(PICKED, [TABLE])
    with pytest.raises(pp.InputError, match="camera is inside 'part'"):
        view_without(pp.Obstacle("part", pp.Box(0.5, 0.5, 0.5), pp.pose(ABOVE[:3, 3])), [TABLE])


def test_the_bodies_together_are_the_occupied_cells():
    grid = view([TABLE, PART], voxel=0.05)
    covered = np.zeros(grid.cells.shape, dtype=int)
    (body,) = shape_bodies("camera", None, grid, pp.pose())
    for box in np.round(body.solid.boxes / grid.voxel).astype(int) - grid.low:
        covered[tuple(slice(a, b) for a, b in box.T)] += 1
    np.testing.assert_array_equal(covered, grid.occupied)


def test_a_motion_in_proven_space_is_certified_and_its_proof_verified(tmp_path):
    arm = pp.load_robot("ur5").arm()
    grid = view([TABLE, PART], voxel=0.05, bounds=[(0.4, -0.5, -0.1), (1.0, 0.5, 0.6)], unknown="free")
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("camera", grid)]), margin=0.002)
    path = pp.JointPath(np.array([arm.home, arm.home + 0.2 * np.eye(6)[0]]), arm.joint_names)
    certificate = pp.certify(path, checker, record=True)
    assert certificate.free
    certificate.save(tmp_path / "proof.json.gz")
    assert pp.verify_proof(tmp_path / "proof.json.gz", checker, path).ok


def test_depth_files_are_read(tmp_path):
    from PIL import Image

    image = depth_image(CAMERA, ABOVE, [TABLE, PART])
    np.save(tmp_path / "view.npy", image)
    Image.fromarray(np.round(image * 1000).astype(np.uint16)).save(tmp_path / "view.png")
    settings = {"voxel": 0.05, "bounds": BOUNDS}
    array, npy, png = (
        pp.OccupancyGrid.from_depth(source, CAMERA, ABOVE, depth_scale=scale, **settings)
        for source, scale in ((image, None), (tmp_path / "view.npy", None), (str(tmp_path / "view.png"), 0.001))
    )
    assert array == npy
    assert (array.cells != png.cells).mean() < 0.01
    (tmp_path / "broken.png").write_bytes((tmp_path / "view.png").read_bytes()[:100])
    Image.fromarray(np.zeros((120, 160, 3), np.uint8)).save(tmp_path / "colour.png")
    (tmp_path / "view.txt").write_text("1 2")
    for name, words in (("broken.png", "cannot be read"), ("colour.png", "RGB"), ("view.txt", "npy"), ("no.npy", "no")):
        with pytest.raises(FileError, match=words):
            pp.OccupancyGrid.from_depth(tmp_path / name, CAMERA, ABOVE, depth_scale=0.001, **settings)


IMAGE = depth_image(CAMERA, ABOVE, [TABLE])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"image": IMAGE * 1000}, "depth_scale=0.001"),
        ({"image": np.round(IMAGE * 1000)}, "depth_scale=0.001"),
        ({"image": (IMAGE * 1000).astype(np.uint16)}, "depth_scale=0.001"),
        ({"image": (IMAGE * 1000).astype(np.uint16), "depth_scale": 1.0}, "depth_scale=0.001"),
        ({"depth_scale": 0.001}, "depth_scale=1 "),
        ({"image": IMAGE[::2, ::2]}, r"80 x 60 pixels, the intrinsics are for 160 x 120"),
        ({"image": IMAGE[::2, ::2], "intrinsics": [[150, 0, 79.5], [0, 150, 59.5], [0, 0, 1]]}, "another size"),
        ({"intrinsics": [[75, 0, 39.5], [0, 75, 29.5], [0, 0, 1]]}, "another size"),
        ({"intrinsics": np.eye(4)}, r"intrinsics"),
        ({"intrinsics": [[150, 1, 79.5], [0, 150, 59.5], [0, 0, 1]]}, r"\[\[fx, 0, cx\]"),
        ({"image": IMAGE * np.nan}, "no measurement"),
        ({"image": IMAGE * 0}, "no measurement"),
        ({"image": -IMAGE}, "19000 negative depths"),
        ({"image": np.zeros((120, 160, 3))}, "shape"),
        ({"image": [[1.0, 2.0], [1.0]]}, "not an array"),
        ({"image": np.full((120, 160), 0.02)}, "covered or inside an obstacle"),
        ({"camera_pose": np.diag([1.0, 1.0, 2.0, 1.0])}, "camera_pose"),
        ({"camera_pose": look_at(ABOVE[:3, 3], np.array([0.3, 0.0, 3.0]))}, "shows no cell of the bounds"),
        ({"bounds": [(0, 0, 0), (1, 0, 1)]}, "empty"),
        ({"bounds": [(0, 0, 0), (1, np.nan, 1)]}, "bounds"),
        ({"bounds": [(0, 0, 0), (1e5, 1, 1)]}, "limited"),
        ({"voxel": 0.0}, "voxel"),
        ({"voxel": 0.0005}, "use 0.00"),
        ({"unknown": "maybe"}, "'occupied', 'free'"),
        ({"depth_uncertainty": -0.1}, "depth_uncertainty"),
        ({"depth_uncertainty": np.zeros(3)}, "depth_uncertainty"),
        ({"depth_uncertainty": "5 mm"}, "depth_uncertainty"),
        ({"pixel_margin": -1}, "pixel_margin"),
        ({"pixel_margin": 10**12}, "pixel_margin"),
    ],
)
def test_each_mistake_is_refused_with_its_reason(changes, words):
    stated = {"image": IMAGE, "intrinsics": CAMERA, "camera_pose": ABOVE, "voxel": 0.05, "bounds": BOUNDS, **changes}
    with pytest.raises(pp.InputError, match=words):
        pp.OccupancyGrid.from_depth(**stated)


@pytest.mark.parametrize("error", [0.004, 0.01, 0.027, 0.05])
def test_points_outside_the_image_occupy_every_cell_that_they_may_be_in(error):
    """A point beside the view has the stated uncertainty; each cell that meets the cube about it is occupied."""
    camera, from_ = Intrinsics(100.0, 100.0, 9.5, 9.5, 20, 20), look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3))
    beside = np.array([0.213, 0.034, 0.118])
    points = np.array([[0.0, 0.0, 0.0], beside])
    bounds = [(-0.3, -0.3, -0.1), (0.3, 0.3, 0.3)]
    grid = pp.OccupancyGrid.from_points(points, camera, from_, voxel=0.01, bounds=bounds, depth_uncertainty=error)
    corners = (np.indices(grid.cells.shape).reshape(3, -1).T + grid.low) * 0.01
    near = (corners <= beside + error).all(axis=1) & (corners + 0.01 >= beside - error).all(axis=1)
    seen = grid.cells.reshape(-1) == SEEN
    assert seen[near].all()
    assert not seen[~near & (np.abs(corners[:, 0] - beside[0]) < 0.15)].any()


def test_invalid_cells_and_removals_from_something_else_are_refused():
    cells, checker = np.zeros((2, 2, 2), dtype=int), pp.CollisionChecker(pp.load_robot("ur5").arm())
    seen, home = DepthView.read(IMAGE, CAMERA, ABOVE), checker.arm.home
    for changes, words in (
        ({"cells": np.full((2, 2, 2), 4)}, "states 0 to 3"), ({"cells": [[[0, 1]], [[0]]]}, "differ in length"),
        ({"record": "one sentence"}, "record is .*not a list"), ({"record": [3]}, "record.0. is 3"),
        ({"cells": np.zeros((2, 2))}, "shape"), ({"cells": np.zeros((0, 2, 2), int)}, "shape"),
        ({"low": (0, 0.5, 0)}, "three integers"), ({"voxel": -1}, "voxel"), ({"low": (10**6, 0, 0)}, "limit"),
    ):  # fmt: skip
        with pytest.raises(pp.InputError, match=words):
            pp.OccupancyGrid(**{"cells": cells, "voxel": 0.1, **changes})
    for remove, words in (
        (lambda: remove_robot(seen, checker, home), "not DepthView"),
        (lambda: remove_robot(view([TABLE]), checker, home, padding="wide"), "padding"),
        (lambda: remove_body(seen, "part"), "and str"),
    ):
        with pytest.raises(pp.InputError, match=words):
            remove()


SMALL = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)
UNCERTAINTY = 0.003


@pytest.mark.parametrize("seed", range(6))
def test_rays_cross_a_polytope_where_dense_points_do(seed: int) -> None:
    """Some rays are parallel to faces, inside and outside of them."""
    rng = np.random.default_rng(seed)
    points = np.array(np.meshgrid(*[(-0.2, 0.2)] * 3)).reshape(3, 8).T + np.array([rng.uniform(-0.4, 0.4), 0.1, 1.0])
    if seed > 2:
        points = rng.normal(size=(12, 3)) * 0.2 + [0, 0, 1]
    hull = ConvexHull(points)
    rays = np.column_stack([rng.uniform(-0.6, 0.6, (60, 2)), np.ones(60)])
    rays[:20, 0] = 0.0
    rays[10:25, 1] = 0.0
    enter, leave = ray_depths(hull.equations, rays)
    depths = np.linspace(-1, 3, 8001)
    crossed = 0
    for ray, first, last in zip(rays, enter, leave, strict=True):
        inside = (depths[:, None] * ray @ hull.equations[:, :3].T + hull.equations[:, 3] <= 0).all(axis=1)
        if inside.sum() > 2:
            crossed += 1
            assert first == pytest.approx(depths[inside][0], abs=6e-4)
            assert last == pytest.approx(depths[inside][-1], abs=6e-4)
        elif not inside.any():
            assert first > last or last - first < 2e-3
    assert crossed > 5


@pytest.mark.parametrize("seed", range(4))
def test_pixels_that_may_show_the_removed_body_bound_nothing_else(seed: int) -> None:
    """A pixel that the body covers entirely looks through it; one that it covers in part proves no space to be free."""
    rng = np.random.default_rng(seed)
    eye = look_at(np.array([0.5, 0, 0.9]) + rng.uniform(-0.4, 0.4, 3) * [1, 1, 0.3], np.array([0.5, 0, 0.0]))
    frame, size = pp.pose((0.5, 0.0, 0.08), rng.uniform(-0.5, 0.5, 3)), np.array([0.16, 0.12, 0.16])
    if seed == 3:  # a beam past the camera, both in front of it and behind it
        beam = eye @ pp.pose((0.2, 0.02, 0.0), (0.02, -0.03, 0.3)).homogeneous
        frame, size = SE3(beam[:3, :3], beam[:3, 3]), np.array([0.1, 0.12, 1.0])
    table = Solid(pp.pose((0.5, 0.0, -0.05)).homogeneous, np.array([0.4, 0.4, 0.05]))
    part = Solid(frame.homogeneous, size / 2)
    image = depth_image(SMALL, eye, [table, part])
    image[rng.random(image.shape) < 0.02] = 0.0
    before = DepthView.read(image, SMALL, eye, depth_uncertainty=UNCERTAINTY)
    after = remove_body(before, pp.Obstacle("part", pp.Box(*size), frame))

    # Depths (2, 2, 48, 64) at which the rays through the corners of each pixel enter and leave the box, by its slabs.
    v, u = np.meshgrid(np.arange(48), np.arange(64), indexing="ij")
    at = np.array([[(u + i - SMALL.cx, v + j - SMALL.cy) for i in (-0.5, 0.5)] for j in (-0.5, 0.5)])
    rays = np.stack([at[:, :, 0] / SMALL.fx, at[:, :, 1] / SMALL.fy, np.ones(at[:, :, 0].shape)], axis=-1)
    part_from_camera = np.linalg.inv(part.pose) @ eye
    origin, rays = part_from_camera[:3, 3], rays @ part_from_camera[:3, :3].T
    slabs = np.stack([(-part.half - origin) / rays, (part.half - origin) / rays])
    enter, leave = slabs.min(axis=0).max(axis=-1), slabs.max(axis=0).min(axis=-1)
    hit = (enter <= leave) & (leave > 0)
    some, whole = hit.any(axis=(0, 1)), hit.all(axis=(0, 1))
    # A pixel measures the box if its depth is between where a ray enters and half the way to where it leaves.
    first = np.where(hit, enter, np.inf).min(axis=(0, 1))
    half = np.where(hit, (enter + leave) / 2, -np.inf).max(axis=(0, 1))
    shows = (image > 0) & some & (image + UNCERTAINTY >= first) & (image - UNCERTAINTY <= half)
    assert (shows & whole).sum() > 40
    assert (shows & ~whole).sum() > 10
    assert (some & ~shows & (image > 0)).any()
    behind = np.where(shows & whole, np.where(hit, leave, np.inf).min(axis=(0, 1)), 0.0)
    assert after.nearest == pytest.approx(np.maximum(before.nearest, behind), abs=1e-9)
    assert (after.farthest == np.where(shows, 0.0, before.farthest)).all()
    assert f"{shows.sum()} pixels" in after.record[-1]


@pytest.mark.parametrize("factor", [0.5, 1.7, 3.0])
def test_a_scaled_image_shows_each_point_at_the_same_share_of_its_sides(factor: float) -> None:
    scaled = SMALL.scaled(factor)
    assert (scaled.width, scaled.height) == (round(64 * factor), round(48 * factor))
    for x, y, z in np.random.default_rng(0).uniform([-0.4, -0.3, 0.8], [0.4, 0.3, 2.0], (20, 3)):
        pixels = [(c.fx * x / z + c.cx + 0.5, c.fy * y / z + c.cy + 0.5) for c in (SMALL, scaled)]
        assert pixels[1] == pytest.approx(factor * np.array(pixels[0]))
