"""Files of OctoMap: the leaves of an octree of occupied, free and unknown space.

A node is a cube; its child i is at the upper half along x, y and z if bit 0, 1 and 2 of i is set. The tree has 16
levels below its root, so the root has 65,536 cells of the resolution along each side and the origin is at its center.
Nodes are stored depth first:

- ``.bt``: 16 bits for each node with children, two for each child, the first child in the lowest bits: 0 unknown,
  1 a free leaf, 2 an occupied leaf, 3 a child with children.
- ``.ot``: the log-odds of each node as a float, for a ColorOcTree three bytes of colour, and a byte in which bit i is
  set if child i exists. A child that does not exist is unknown.

Source: OctoMap 1.10, ``AbstractOcTree.cpp`` (header), ``OccupancyOcTreeBase.hxx`` (``writeBinaryNode``),
``OcTreeBaseImpl.hxx`` (``readNodesRecurs``) and ``OcTreeKey.h`` (order of the children).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.common.files import read_bytes
from pinproof.errors import FileError, InputError

LARGEST_FILE = 2**28
"""Largest size of a file (bytes)."""

ROOT_CELLS = 2**16
"""Cells along one side of the root."""

THRESHOLD = 0.5
"""Default occupancy from which a leaf of a ``.ot`` file is occupied, as in OctoMap."""

HEADS = {b"# Octomap OcTree binary file": True, b"# Octomap OcTree file": False}
"""The beginning of the first line, and whether the file is a ``.bt`` file."""

COLOURS = {"OcTree": 0, "ColorOcTree": 3}
"""Bytes between the log-odds of a node and its children in ``.ot`` files, by the ``id`` of the tree."""

CORNERS = np.arange(8)[:, None] >> np.arange(3) & 1
CHILDREN = [[child for child in range(7, -1, -1) if mask >> child & 1] for mask in range(256)]
"""The children of a node in descending order by the byte of its children."""

Integers = npt.NDArray[np.int64]


@dataclass(frozen=True)
class OctomapLeaves:
    """The known leaves of a tree, each free or occupied.

    ``places`` (n, 4) are the indices of the first cell of each leaf (cell c is the cube from c to c + 1, times the
    resolution in m) and the number of cells along its side. ``threshold`` is the occupancy from which leaves are
    occupied, None if the file states only which are; ``source`` is where the tree is from.
    """

    resolution: float
    places: Integers
    occupied: npt.NDArray[np.bool_]
    threshold: float | None
    source: str

    @property
    def bounds(self) -> Integers:
        """(2, 3) first cell of the smallest box that contains all leaves, and the cell after its last one."""
        low, side = self.places[:, :3], self.places[:, 3:]
        return np.array([low.min(axis=0), (low + side).max(axis=0)])

    def fill(self, cells: npt.NDArray[np.uint8], low: npt.ArrayLike, free: int, occupied: int) -> None:
        """Write the states of the leaves into cells (nx, ny, nz), of which ``low`` (3,) is the first."""
        first = self.places[:, :3] - np.asarray(low)
        last = np.minimum(first + self.places[:, 3:], cells.shape)
        first = first.clip(min=0)
        states = np.where(self.occupied, occupied, free).astype(np.uint8)
        inside = (first < last).all(axis=1)
        single = inside & (self.places[:, 3] == 1)
        cells[tuple(first[single].T)] = states[single]
        large = inside & ~single
        for (i, j, k), (m, n, o), state in zip(
            first[large].tolist(), last[large].tolist(), states[large].tolist(), strict=True
        ):
            cells[i:m, j:n, k:o] = state


def read_octomap(path: str | Path, threshold: float = THRESHOLD) -> OctomapLeaves:
    """Return the known leaves of a ``.bt`` or ``.ot`` file; errors as :meth:`pinproof.OccupancyGrid.from_octomap`."""
    file = Path(path)
    if not 0.0 < threshold < 1.0:
        raise InputError(f"threshold = {threshold!r} is not between 0 and 1")
    content = read_bytes(file, FileError, largest=LARGEST_FILE)
    binary = next((binary for head, binary in HEADS.items() if content.startswith(head)), None)
    if binary is None:
        heads = " or ".join(repr(head.decode()) for head in HEADS)
        raise FileError(file, f"is not an OctoMap file: its first line does not begin with {heads}")
    if binary and threshold != THRESHOLD:
        raise InputError(f"threshold = {threshold:g}: {file.name} states no occupancies; only .ot files do")
    kind, size, resolution, data = _header(file, content)
    return octomap_leaves(file, data, kind, resolution, binary=binary, threshold=threshold, size=size)


def octomap_leaves(
    file: Path,
    data: bytes,
    kind: str,
    resolution: float,
    *,
    binary: bool,
    threshold: float = THRESHOLD,
    size: int | None = None,
) -> OctomapLeaves:
    """Return the known leaves of the data of a tree, as they are in files and in octomap_msgs/Octomap.

    ``file`` is named in messages; ``kind`` is the type of the tree, such as ``"OcTree"``; ``binary`` states whether the
    data are those of a ``.bt`` file; ``size`` is the number of nodes, if it is stated.
    """
    if not (0.0 < resolution < np.inf):
        raise FileError(file, f"states the resolution {resolution:g} m, which is not positive")
    if binary:  # the state of each child of a node in two bits: unknown, free, occupied, or a node with children
        words = np.frombuffer(data, dtype="<u2", count=len(data) // 2)
        states = words[:, None] >> np.arange(0, 16, 2, dtype=np.uint16) & 3
        masks = ((states == 3) << np.arange(8)).sum(axis=1)
        parents = _places(file, masks.tolist(), len(data) / 2)
        if len(parents) and parents[:, 3].min() < 2:
            raise FileError(file, "is damaged: it has more than 16 levels of nodes")
        half = parents[:, 3, None, None] // 2
        first = parents[:, None, :3] + half * CORNERS
        known = (states == 1) | (states == 2)
        places = np.concatenate([first, np.broadcast_to(half, (*states.shape, 1))], axis=2)[known]
        count, occupied = min(len(words), 1) + int(np.count_nonzero(states)), states[known] == 2
    else:
        if kind not in COLOURS:
            raise FileError(file, f"holds a tree of the type {kind!r}; valid: {', '.join(COLOURS)}")
        node = np.dtype([("odds", "<f4"), ("colour", "u1", (COLOURS[kind],)), ("children", "u1")])
        nodes = np.frombuffer(data, dtype=node, count=len(data) // node.itemsize)
        leaf, count = nodes["children"] == 0, len(nodes)
        places = _places(file, nodes["children"].tolist(), len(data) / node.itemsize)[leaf]
        odds = nodes["odds"][leaf]
        if not np.isfinite(odds).all():
            raise FileError(file, "is damaged: the occupancy of a leaf is not a number")
        occupied = odds >= np.float32(np.log(threshold / (1.0 - threshold)))
    if size not in (None, count):
        raise FileError(file, f"is damaged: it holds {count} nodes, but its header states {size}")
    if not len(places):
        raise FileError(file, "has no known leaf: all of its space is unknown")
    return OctomapLeaves(resolution, places, occupied, None if binary else threshold, f"OctoMap file {file.name}")


def _header(path: Path, content: bytes) -> tuple[str, int, float, bytes]:
    """Return the values id, size and res of the header, and the data."""
    stated: dict[str, str] = {}
    rest = content
    while True:
        line, end, rest = rest.partition(b"\n")
        key, _, value = line[:200].decode("ascii", "replace").strip().partition(" ")
        if not end or len(line) > 4096:
            raise FileError(path, "is truncated or damaged: its header has no line 'data'")
        if key == "data":
            break
        if key and not key.startswith("#"):
            stated[key] = value.strip()
    missing = [key for key in ("id", "size", "res") if key not in stated]
    if missing:
        raise FileError(path, f"does not state its {' and '.join(missing)} in the header")
    try:
        size, resolution = int(stated["size"]), float(stated["res"])
    except ValueError as error:
        raise FileError(path, f"has a header that cannot be read: {error}") from error
    return stated["id"], size, resolution, rest


def _places(path: Path, masks: list[int], available: float) -> Integers:
    """Return (n, 4) first cells and sides of nodes, depth first, by their child masks; the data hold ``available``."""
    half = ROOT_CELLS // 2
    # The root is centred at the origin; children are pushed so that the first one is read first.
    stack = [(-half, -half, -half, ROOT_CELLS)] if available else []
    places = []
    for mask in masks:
        if not stack:
            break
        x, y, z, side = stack.pop()
        places.append((x, y, z, side))
        if mask:
            half = side // 2
            if not half:
                raise FileError(path, "is damaged: it has more than 16 levels of nodes")
            stack += [(x + half * (i & 1), y + half * (i >> 1 & 1), z + half * (i >> 2), half) for i in CHILDREN[mask]]
    if stack:
        raise FileError(path, f"is truncated or damaged: its data end before {len(stack)} or more of its nodes")
    if len(places) != available:
        raise FileError(path, "is damaged: its data continue after the last node")
    return np.array(places, dtype=np.int64).reshape(-1, 4)
