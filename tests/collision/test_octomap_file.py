"""Maps of OctoMap: cells against the tree that the test writes, both formats, unknown space, bounds, damaged files."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.geometry.occupancy import FREE, SEEN, UNKNOWN
from pinproof.collision.geometry.octomap_file import read_octomap
from pinproof.errors import FileError, SceneError
from pinproof.execution import ros2

Node = float | list  # the log-odds of a leaf, or its eight children, of which some are None
LEVELS = 16


def random_node(rng: np.random.Generator, levels: int) -> Node | None:
    kind = rng.random()
    if levels and kind < 0.6:
        children = [random_node(rng, levels - 1) for _ in range(8)]
        return children if any(child is not None for child in children) else None
    return None if kind < 0.7 else float(rng.choice([-2.0, -0.4, 0.85, 3.5]))


def random_tree(seed: int, levels: int = 3) -> Node:
    """A tree whose known leaves are in the eight cubes of ``2**levels`` cells at the origin."""
    rng = np.random.default_rng(seed)
    root: list = []
    for octant in range(8):
        node = [random_node(rng, levels - 1) for _ in range(7)] + [0.85]
        for _ in range(LEVELS - 1 - levels):  # towards the origin: the opposite child of each cube
            chain: list = [None] * 8
            chain[7 - octant] = node
            node = chain
        root.append(node)
    return root


def count(node: Node | None) -> int:
    return 0 if node is None else 1 + (sum(count(child) for child in node) if isinstance(node, list) else 0)


def binary(node: list) -> bytes:
    bits = 0
    for i, child in enumerate(node):
        state = 0 if child is None else 3 if isinstance(child, list) else 2 if child >= 0 else 1
        bits |= state << (2 * i)
    return struct.pack("<H", bits) + b"".join(binary(child) for child in node if isinstance(child, list))


def full(node: Node, colour: bytes = b"") -> bytes:
    children = node if isinstance(node, list) else []
    mask = sum(1 << i for i, child in enumerate(children) if child is not None)
    value = struct.pack("<f", 0.0 if children else node)
    return value + colour + bytes([mask]) + b"".join(full(child, colour) for child in children if child is not None)


def written(folder: Path, name: str, root: list, *, kind: str = "OcTree", size: int | None = None) -> Path:
    head = "# Octomap OcTree binary file" if name.endswith(".bt") else "# Octomap OcTree file"
    data = binary(root) if name.endswith(".bt") else full(root, b"\1\2\3" if kind == "ColorOcTree" else b"")
    stated = f"{head}\n# (a comment)\n#\nid {kind}\nsize {count(root) if size is None else size}\nres 0.05\ndata\n"
    path = folder / name
    path.write_bytes(stated.encode() + data)
    return path


def state_of(root: Node, cell: tuple[int, ...], least: float = 0.0) -> int:
    """The state of a cell, by descent along the bits of its key."""
    node: Node | None = root
    for level in range(LEVELS - 1, -1, -1):
        if not isinstance(node, list):
            break
        node = node[sum(((index + 2**15) >> level & 1) << axis for axis, index in enumerate(cell))]
    return UNKNOWN if node is None else SEEN if node >= least else FREE


def assert_states(grid: pp.OccupancyGrid, root: Node, least: float = 0.0) -> None:
    for at, state in np.ndenumerate(grid.cells):
        assert state == state_of(root, tuple(np.add(at, grid.low)), least)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.slow
def test_cells_of_both_formats_equal_the_tree(tmp_path: Path, seed: int) -> None:
    root = random_tree(seed)
    grids = [
        pp.OccupancyGrid.from_octomap(written(tmp_path, name, root, kind=kind))
        for name, kind in (("a.bt", "OcTree"), ("a.ot", "OcTree"), ("b.ot", "ColorOcTree"), ("b.bt", "ColorOcTree"))
    ]
    for grid in grids:
        assert_states(grid, root)
        assert (grid.voxel, grid.low) == (0.05, grids[0].low)
    assert min(grids[0].counts) > 10
    assert (read_octomap(tmp_path / "a.bt").places[:, 3] > 1).sum() > 5  # pruned leaves
    # Nothing is known outside of the default bounds, and each of their sides has a known cell.
    wide = pp.OccupancyGrid.from_octomap(tmp_path / "a.bt", bounds=np.array([[-1.0] * 3, [1.0] * 3]))
    known = np.argwhere(wide.cells != UNKNOWN) + wide.low
    assert known.min(axis=0).tolist() == list(grids[0].low)
    assert (known.max(axis=0) + 1).tolist() == np.add(grids[0].low, grids[0].cells.shape).tolist()


def test_bounds_cut_large_leaves(tmp_path: Path) -> None:
    root = random_tree(5)
    root[3] = -2.0  # one eighth of the root, 32,768 cells on each side, is one free leaf
    path = written(tmp_path, "large.ot", root)
    with pytest.raises(pp.InputError, match=r"large\.ot.*more than 67108864; state smaller bounds"):
        pp.OccupancyGrid.from_octomap(path)
    grid = pp.OccupancyGrid.from_octomap(path, bounds=[(-0.13, -0.3, -0.4), (0.6, 0.55, 0.21)])
    assert grid.low == (-3, -6, -8)
    assert grid.cells.shape == (15, 17, 13)
    assert_states(grid, root)
    with pytest.raises(pp.InputError, match="no known leaf"):
        pp.OccupancyGrid.from_octomap(path, bounds=[(-9, -9, -9), (-8, -8, -8)])


def test_threshold_divides_the_leaves_of_full_trees(tmp_path: Path) -> None:
    root = random_tree(6)
    path = written(tmp_path, "map.ot", root)
    for occupancy, least in ((0.3, np.log(3 / 7)), (0.9, np.log(9))):
        grid = pp.OccupancyGrid.from_octomap(path, threshold=occupancy)
        assert_states(grid, root, least)
        assert f"occupancy of {occupancy:g}" in grid.remark
    with pytest.raises(pp.InputError, match="states no occupancies"):
        pp.OccupancyGrid.from_octomap(written(tmp_path, "map.bt", root), threshold=0.7)
    with pytest.raises(pp.InputError, match="threshold"):
        pp.OccupancyGrid.from_octomap(path, threshold=1.0)


def test_unknown_cells_are_obstacles_unless_stated_otherwise(tmp_path: Path) -> None:
    path = written(tmp_path, "map.bt", random_tree(7))
    solid = pp.OccupancyGrid.from_octomap(path)
    hollow = pp.OccupancyGrid.from_octomap(path, unknown="free")
    assert solid.counts == hollow.counts
    assert (solid.occupied & ~hollow.occupied).sum() == solid.counts[2] > 0
    assert "map.bt" in solid.remark
    assert "not seen is an obstacle" in solid.remark
    assert "not seen is free" in hollow.remark
    arm = pp.load_robot("ur5").arm()
    assert pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("map", solid)])).check(arm.home).contacts


def test_scene_files_name_a_map(tmp_path: Path) -> None:
    written(tmp_path, "map.ot", random_tree(11))
    file = tmp_path / "scene.yaml"

    def scene(keys: str) -> pp.Scene:
        file.write_text(f"obstacles:\n  - {{name: map, occupancy_grid: {{{keys}}}}}\n")
        return pp.Scene.load(file)

    keys = "octomap: map.ot, unknown: free, threshold: 0.9, bounds: [[-0.2, -0.2, -0.2], [0.1, 0.2, 0.3]]"
    read = scene(keys)["map"].shape
    bounds = [[-0.2, -0.2, -0.2], [0.1, 0.2, 0.3]]
    expected = pp.OccupancyGrid.from_octomap(tmp_path / "map.ot", unknown="free", threshold=0.9, bounds=bounds)
    assert read == expected
    assert scene("octomap: map.ot")["map"].shape == pp.OccupancyGrid.from_octomap(tmp_path / "map.ot")
    copy = tmp_path / "copy.yaml"
    scene(keys).save(copy)
    assert pp.Scene.load(copy)["map"].shape == expected
    for wrong, reason in (
        ("octomap: none.ot", "no file .*none.ot"),
        ("octomap: map.ot, voxel: 0.1", "voxel"),
        ("octomap: map.ot, cells: eA==", "octomap"),
        ("octomap: map.ot, treshold: 0.1", "threshold"),
        ("octomap: map.ot, threshold: high", "threshold"),
        ("voxel: 0.1", "needs one of views, octomap, cells"),
    ):
        with pytest.raises(SceneError, match=reason):
            scene(wrong)


DAMAGES = {  # of the content and the place of its first node, and words of the reason
    "half a node": (lambda content, data: content[: data + 7], "truncated"),
    "no data": (lambda content, data: content[:data], "its header states"),
    "header only": (lambda content, data: content[: data - 6], "no line 'data'"),
    "more data": (lambda content, _: content + b"\0\0\0\0\0\0", "after the last node"),
    "other file": (lambda content, _: b"PK" + content, "not an OctoMap file"),
    "no resolution": (lambda content, _: content.replace(b"res 0.05\n", b""), "does not state its res"),
    "zero resolution": (lambda content, _: content.replace(b"res 0.05", b"res 0"), "not positive"),
    "text resolution": (lambda content, _: content.replace(b"res 0.05", b"res five"), "header that cannot be read"),
    "too deep": (lambda content, data: content[:data] + b"\xff" * (len(content) - data), "16 levels"),
}


@pytest.mark.parametrize(("damage", "reason"), DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("suffix", ["bt", "ot"])
def test_damaged_files_are_refused(tmp_path: Path, damage: Callable, reason: str, suffix: str) -> None:
    path = written(tmp_path, f"map.{suffix}", random_tree(8))
    content = path.read_bytes()
    path.write_bytes(damage(content, content.index(b"data\n") + 5))
    with pytest.raises(FileError, match=reason) as caught:
        pp.OccupancyGrid.from_octomap(path)
    assert caught.value.path == str(path)


@pytest.mark.slow
def test_every_truncation_is_refused(tmp_path: Path) -> None:
    for name in ("map.bt", "map.ot"):
        path = written(tmp_path, name, random_tree(9, levels=2))
        content = path.read_bytes()
        for end in range(len(content)):
            path.write_bytes(content[:end])
            with pytest.raises(FileError):
                pp.OccupancyGrid.from_octomap(path)


def test_trees_without_usable_leaves_are_refused(tmp_path: Path) -> None:
    root = random_tree(10)
    for path, words in (
        (written(tmp_path, "count.bt", root, size=3), "header states"),
        (written(tmp_path, "kind.ot", root, kind="OcTreeStamped"), r"OcTreeStamped.*valid: OcTree"),
        (written(tmp_path, "empty.bt", [None] * 8), "no known leaf"),
        (written(tmp_path, "nan.ot", [float("nan"), *[None] * 7]), "not a number"),
        (tmp_path / "missing.bt", "missing"),
    ):
        with pytest.raises(FileError, match=words):
            pp.OccupancyGrid.from_octomap(path)


def octomap(nodes: bytes, **changes: object) -> dict[str, object]:
    """An octomap_msgs/OctomapWithPose with signed bytes, as in messages."""
    signed = np.frombuffer(nodes, dtype=np.int8).tolist()
    tree = {"header": {}, "binary": True, "id": "OcTree", "resolution": 0.05, "data": signed, **changes}
    origin = {"position": {"x": 0.5, "y": 0.0, "z": 0.1}, "orientation": {"w": 1.0}}
    return {"header": {"frame_id": "world"}, "origin": origin, "octomap": tree}


@pytest.mark.parametrize("kind", ["binary", "full", "full in colour"])
@pytest.mark.parametrize("as_message", [False, True])
def test_the_octomap_of_a_planning_scene_is_a_grid_at_its_pose(tmp_path: Path, kind: str, as_message: bool) -> None:
    root = random_tree(1)
    data = binary(root) if kind == "binary" else full(root, b"\1\2\3" if "colour" in kind else b"")
    map_ = octomap(data, binary=kind == "binary", id="ColorOcTree" if "colour" in kind else "OcTree")
    matrix = {"entry_names": ["hand", "<octomap>"], "entry_values": [[False, True], [True, False]]}
    content = {"world": {"collision_objects": [], "octomap": map_}, "allowed_collision_matrix": matrix}
    (tmp_path / "cell.yaml").write_text(json.dumps(content))
    scene = ros2.read_planning_scene(content) if as_message else pp.Scene.load(tmp_path / "cell.yaml")
    grid = scene["<octomap>"].shape
    assert_states(grid, root)
    assert grid.unknown == "occupied"
    assert any("unknown in the octomap" in note for note in scene.notes)
    assert scene["<octomap>"].pose.translation.tolist() == [0.5, 0.0, 0.1]
    assert list(scene.allowed) == [("hand", "<octomap>")]


def test_an_empty_octomap_is_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text(json.dumps({"world": {"octomap": octomap(b"")}}))
    assert pp.Scene.load(tmp_path / "cell.yaml").obstacles == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"data": [1]}, "damaged|truncated"),
        ({"data": [1.5]}, "integers of 8 bits"),
        ({"data": [300]}, "integers of 8 bits"),
        ({"data": "none"}, "integers of 8 bits"),
        ({"resolution": 0.0}, "not positive"),
        ({"resolution": "fine"}, "resolution"),
        ({"binary": 1}, "neither true nor false"),
        ({"binary": False, "id": "OcTreeStamped"}, "OcTreeStamped"),
        ({"leaves": 1}, "leaves"),
    ],
)
def test_a_damaged_octomap_of_a_planning_scene_is_refused(tmp_path: Path, changes: dict, words: str) -> None:
    map_ = octomap(binary(random_tree(1)), **changes)
    (tmp_path / "cell.yaml").write_text(json.dumps({"world": {"octomap": map_}}))
    with pytest.raises(SceneError, match=rf"cell\.yaml.*octomap.*({words})"):
        pp.Scene.load(tmp_path / "cell.yaml")
