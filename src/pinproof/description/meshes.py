"""Reading triangle meshes in metres, with validation for collision checking by an independent second reading."""

from __future__ import annotations

import atexit
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common.content_hash import cached, content_digest
from pinproof.common.content_hash import folder as cache_folder
from pinproof.common.files import read_bytes, unknown_suffix, write_bytes_whole
from pinproof.description.mesh_collada import read_collada
from pinproof.description.mesh_gltf import external_files, read_gltf, with_second_root
from pinproof.description.mesh_reading import REMEDY, Reading
from pinproof.description.mesh_stl_obj_ply import read_obj, read_ply, read_stl
from pinproof.description.ros_files import MeshFile
from pinproof.errors import MeshError

LARGEST_MESH = 256 * 2**20
"""Bytes (256 MiB): five million triangles as binary STL, about a hundred times as many as a link needs."""

READERS: dict[str, Callable[[bytes, Path, Mapping[str, bytes]], Reading]] = {
    "stl": lambda data, path, _: read_stl(data, path),
    "obj": lambda data, path, _: read_obj(data, path),
    "dae": lambda data, path, _: read_collada(data, path),
    "ply": lambda data, path, _: read_ply(data, path),
    "glb": read_gltf,
    "gltf": read_gltf,
}
"""The reader of each format; the last argument has the files that a glTF file refers to."""

MESH_SUFFIXES = tuple(f".{kind}" for kind in READERS)

GLTF = (".glb", ".gltf")
"""The formats with y up."""

COLOURED_SUFFIXES = MESH_SUFFIXES[1:]
"""The formats that can state colours: all but STL."""

MESH_CODE = [str(file) for file in sorted(Path(__file__).parent.glob("mesh*.py"))]
MESH_LIBRARIES = ("coal", "lxml")
"""The source files and the distributions that read mesh files."""

FARTHEST = 1e4
"""Metres from the origin of the mesh. Larger coordinates are wrong units, and distances would lose digits."""

LARGEST_COORDINATE = 1e30
"""In the unit of the file, so that single precision can hold it."""

ROUNDING = 1e-5
"""Difference of coordinates relative to the largest. assimp computes with single precision; the largest difference in
the 776 meshes of example-robot-data is 2e-7."""

MANY = 100_000
"""Triangles. assimp takes 3 us for each; of a larger binary STL file, whose format has one layout, the bytes are
compared instead."""

REMOVED = re.compile(rb"^[ \t]*(mtllib\b[^\n]*)?", re.MULTILINE)
"""Parts of OBJ files that assimp does not see: files of materials, which it would open, and indentation, because it
ignores indented lines."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A triangle mesh: ``vertices`` (V, 3) in metres, ``triangles`` (F, 3) indices of vertices."""

    vertices: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]


def read_mesh(path: str | Path, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> TriangleMesh:
    """Read a mesh file.

    Parameters
    ----------
    path
        STL, OBJ, DAE, PLY, GLB or glTF. The unit of a COLLADA file is applied, its up axis is not; glTF is rotated from
        y up to z up (:func:`z_up`).
    scale
        Factors for x, y, z, applied last. If their product is negative, the mesh is mirrored and the orientation of its
        triangles is reversed.

    Raises
    ------
    MeshError
        If the file is missing, too large, or holds anything that cannot be read, if it has no triangles, or coordinates
        that are not finite or larger than :data:`FARTHEST`, or if assimp reads other geometry from it.
    """
    path = Path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise MeshError(path, unknown_suffix(path, MESH_SUFFIXES))
    reading = _load(path)
    with np.errstate(over="ignore"):
        turned = reading.vertices @ z_up(path).T if path.suffix.lower() in GLTF else reading.vertices
        vertices = turned * (np.asarray(scale) * reading.unit) + 0.0  # without -0
    if not (farthest := max(-float(vertices.min()), float(vertices.max()))) <= FARTHEST:
        what = f"extends to {farthest:g} m (limit {FARTHEST:g} m) with the scale {max(scale):g}"
        raise MeshError(path, f"{what}; the scale of a mesh in millimetres is 0.001")
    return TriangleMesh(vertices, reading.triangles[:, ::-1].copy() if np.prod(scale) < 0 else reading.triangles)


def resolved(mesh: MeshFile, link: str) -> Path:
    """Return the file of a mesh of a URDF.

    Raises
    ------
    MeshError
        If it was not found; the message states the link and the paths that were tried.
    """
    if mesh.path is None:
        places = "\n  ".join(str(place) for place in mesh.searched)
        remedy = ""
        if mesh.uri.startswith("package://"):
            package = mesh.uri.removeprefix("package://").partition("/")[0]
            remedy = f"; state the folder that contains {package!r} (--package-dir or package_dirs)"
        raise MeshError(mesh.uri, f"the mesh of link {link!r} was not found{remedy}; tried:\n  {places}")
    return mesh.path


def metres_per_unit(path: Path) -> float:
    """Return the metres per unit of a COLLADA file that :func:`read_mesh` accepts, and 1 for other formats."""
    return _load(path).unit


def z_up(path: Path) -> npt.NDArray[np.float64]:
    """Return the rotation (3, 3) from the axes of a mesh file to the axes of its link.

    The standard of glTF is y up (Khronos glTF 2.0, section 3.4); Drake, Blender and RViz (ros2/rviz, pull request 1482)
    rotate it by 90 degrees about x. COLLADA files state their up axis, but RViz, MoveIt's geometric_shapes (pull
    request 52) and Gazebo (issue 1305) ignore it, because it is wrong in many robot descriptions. STL, OBJ and PLY do
    not state an up axis.
    """
    if path.suffix.lower() in GLTF:
        return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return np.eye(3)


def _load(path: Path) -> Reading:
    """Return the vertices and triangles of the file, unscaled, which two independent readers agree on."""
    data = read_bytes(path, MeshError, largest=LARGEST_MESH, remedy="simplify the mesh, or split it into several")
    kind = path.suffix.lower()[1:]
    files = external_files(data, path, LARGEST_MESH) if kind == "gltf" else {}

    large = kind == "stl" and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little") > 84 + 50 * MANY

    def make() -> dict[str, npt.NDArray[Any]]:
        reading = READERS[kind](data, path, files)
        if len(reading.triangles) == 0:
            raise MeshError(path, "has no triangles")
        if not np.isfinite(reading.vertices).all():
            raise MeshError(path, "has vertices that are not finite numbers")
        if not (largest := float(np.abs(reading.vertices).max())) < LARGEST_COORDINATE:
            raise MeshError(path, f"extends to {largest:g} units (limit {FARTHEST:g} m)")
        # a mesh that another reader reads differently is refused
        if large:
            compare_with_bytes(path, data, reading)
        else:
            compare_with_assimp(path, kind, data, files, reading)
        # Vertices that no triangle has are no part of the surface, and would enlarge its hull.
        used, triangles = np.unique(reading.triangles, return_inverse=True)
        vertices = reading.vertices[used] if len(used) < len(reading.vertices) else reading.vertices
        return {"vertices": vertices, "triangles": triangles.reshape(-1, 3), "unit": np.array(reading.unit)}

    if large:  # It is read faster than an entry of the cache.
        arrays = make()
    else:
        key = content_digest(data, kind, *(part for file in files.items() for part in file))
        arrays = dict(cached("mesh", key, make, code=MESH_CODE, libraries=MESH_LIBRARIES))
    return Reading(arrays["vertices"], arrays["triangles"], float(arrays["unit"]))


def mesh_of_file(path: str | Path, scale: tuple[float, float, float], model: Any) -> bool:
    """Whether a BVHModel of coal has the triangles of a mesh file, up to single precision."""
    try:
        mesh = read_mesh(path, scale)
        _refuse_difference(Path(path), Reading(mesh.vertices, mesh.triangles), model)
    except MeshError:
        return False
    return True


def stored_mesh(vertices: npt.NDArray[np.float64], triangles: npt.NDArray[np.int64]) -> Path:
    """Write a mesh that has no file as PLY with all digits, to the folder of the cache or a temporary one.

    The name is a hash of the content, so an equal mesh is written once.
    """
    corners = np.zeros(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    corners["count"], corners["corners"] = 3, triangles
    lines = [
        "ply\nformat binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(triangles)}",
        "property list uchar int vertex_index\nend_header\n",
    ]
    content = "\n".join(lines).encode() + vertices.astype("<f8").tobytes() + corners.tobytes()
    path = (cache_folder() or _temporary_folder()).resolve() / f"{content_digest(content)[:32]}.ply"
    if not path.is_file():
        write_bytes_whole(path, content)
    return path


@cache
def _temporary_folder() -> Path:
    """A folder that is removed when the process ends."""
    folder = tempfile.mkdtemp(prefix="pinproof-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def compare_with_bytes(path: Path, data: bytes, reading: Reading) -> None:
    """Raise MeshError unless the corners are those in the bytes of a binary STL file, or if all triangles are flat."""
    rows = np.frombuffer(data, dtype=np.uint8, offset=84).reshape(-1, 50)
    corners = np.ascontiguousarray(rows[:, 12:48]).view("<f4").reshape(-1, 3, 3)
    if not np.array_equal(reading.vertices[reading.triangles], corners):
        raise MeshError(path, f"two readers disagree: the coordinates; {REMEDY}")
    if np.any([(corners[:, i] == corners[:, i - 1]).all(axis=1) for i in range(3)], axis=0).all():
        raise MeshError(path, "is flat: every triangle has two equal corners")


def compare_with_assimp(path: Path, kind: str, data: bytes, files: Mapping[str, bytes], reading: Reading) -> None:
    """Raise MeshError unless assimp reads as many triangles with the same corners and the same volume.

    assimp rounds to single precision and drops triangles with two equal corners; coal ignores the unit and the up axis
    of COLLADA, and both leave glTF y up.

    Parameters
    ----------
    path
        The file, for messages.
    kind
        Its format: a suffix without the dot.
    data, files
        Its content, and that of the files it refers to, by URI. assimp reads copies, and no other files.
    reading
        What was read.
    """
    import coal

    corners = reading.vertices[reading.triangles]
    if (corners == np.roll(corners, 1, axis=1)).all(axis=2).any(axis=1).all():
        raise MeshError(path, "is flat: every triangle has two equal corners")
    with tempfile.TemporaryDirectory(prefix="pinproof-") as folder:
        copy = Path(folder) / f"mesh.{kind}"
        copy.write_bytes(with_second_root(data) if kind in ("glb", "gltf") else data)
        if kind == "obj":
            copy.write_bytes(REMOVED.sub(b"", data))
        for uri, content in files.items():  # assimp does not decode %20
            target = Path(folder) / uri
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
        try:
            model: Any = coal.MeshLoader(coal.BV_AABB).load(str(copy), np.ones(3))
        except (RuntimeError, ValueError) as error:
            what = " ".join(
                str(error).partition("message: ")[2].partition("Hint:")[0].replace(str(copy), path.name).split()
            )
            raise MeshError(path, f"assimp, which reads it for comparison, fails: {what or error}; {REMEDY}") from error
    _refuse_difference(path, reading, model)


def _refuse_difference(path: Path, reading: Reading, model: Any) -> None:
    """Raise MeshError unless a BVHModel of coal has as many triangles with the same corners and the same volume."""
    corners = reading.vertices[reading.triangles]

    def refused(what: str) -> MeshError:
        return MeshError(path, f"two readers disagree: {what}; {REMEDY}")

    points: npt.NDArray[np.float64] = np.array(model.vertices()).reshape(-1, 3)
    used = np.zeros(len(reading.vertices), dtype=bool)
    used[reading.triangles] = True
    own = reading.vertices[used]
    largest = float(np.abs(own).max())
    near = ROUNDING * largest
    if model.num_tris != len(corners):
        edges = np.stack([corners[:, i] - corners[:, i - 1] for i in range(3)])
        distinct = (np.abs(edges).max(axis=2) > near).all(axis=0)
        if not np.count_nonzero(distinct) <= model.num_tris <= len(corners):
            raise refused(f"{len(corners):,} triangles, but {model.num_tris:,} by assimp")
        used[:] = False
        used[reading.triangles[distinct]] = True

    # Equal bounds and integrals over the volume are the cheap proof that equally many triangles are the same.
    sixfold = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    moments = np.append(sixfold.sum() / 6, sixfold @ corners.sum(axis=1) / 24)
    by_assimp = np.append(model.computeVolume(), model.computeVolume() * model.computeCOM())
    area = _area(corners)
    bounds = np.array([(vertices.min(axis=0), vertices.max(axis=0)) for vertices in (own, points)])
    if (
        np.abs(bounds[0] - bounds[1]).max() <= near
        and (np.abs(moments - by_assimp) <= near * area * np.array([1, largest, largest, largest])).all()
    ):
        return

    # The integrals also differ where a node mirrors its mesh, because coal does not reverse the triangles, and where a
    # node has several meshes, because coal 3.0.3 adds a wrong offset to their triangles. Then the corners of each
    # reading must be corners of the other one, and the areas equal unless some vertices are left without a triangle.
    from scipy.spatial import cKDTree

    distances, nearest = cKDTree(points).query(reading.vertices[used])
    missed = np.setdiff1d(np.arange(len(points)), nearest)
    if len(missed):
        distances = np.append(distances, cKDTree(own).query(points[missed])[0])
    if not distances.max() <= near:
        raise refused(f"vertices differ by {distances.max():g}")
    triangles = np.array([(t[0], t[1], t[2]) for t in map(model.tri_indices, range(model.num_tris))])
    if len(np.unique(triangles)) == len(points) and abs(_area(points[triangles]) - area) > ROUNDING * area:
        raise refused(f"an area of {area:g}, but {_area(points[triangles]):g} by assimp")


def _area(corners: npt.NDArray[np.float64]) -> float:
    edges = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()) / 2
