"""Reading triangle meshes in metres, with validation for collision checking."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common.disk_cache import cached, content_digest
from pinproof.common.files import read_bytes, unknown_suffix
from pinproof.description.mesh_formats.collada import read_collada
from pinproof.description.mesh_formats.gltf import external_files, read_gltf
from pinproof.description.mesh_formats.obj import read_obj
from pinproof.description.mesh_formats.ply import read_ply
from pinproof.description.mesh_formats.reading import Reading
from pinproof.description.mesh_formats.second_reading import compare_with_assimp
from pinproof.description.mesh_formats.stl import read_stl
from pinproof.description.packages import MeshFile
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

COLOURED_SUFFIXES = MESH_SUFFIXES[1:]
"""The formats that can state colours: all but STL."""

MESH_CODE = [str(file) for file in sorted((Path(__file__).parent / "mesh_formats").glob("*.py"))] + [__file__]
MESH_LIBRARIES = ("coal", "lxml")
"""The source files and the distributions that read mesh files."""

FARTHEST = 1e4
"""Metres from the origin of the mesh. Larger coordinates are wrong units, and distances would lose digits."""

LARGEST_COORDINATE = 1e30
"""In the unit of the file, so that single precision can hold it."""


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
        vertices = reading.vertices @ z_up(path).T * (np.asarray(scale) * reading.unit)
    if not (farthest := float(np.abs(vertices).max())) <= FARTHEST:
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
    if path.suffix.lower() in (".glb", ".gltf"):
        return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return np.eye(3)


def _load(path: Path) -> Reading:
    """Return the vertices and triangles of the file, unscaled, which two independent readers agree on."""
    data = read_bytes(path, MeshError, largest=LARGEST_MESH, remedy="simplify the mesh, or split it into several")
    kind = path.suffix.lower()[1:]
    files = external_files(data, path, LARGEST_MESH) if kind == "gltf" else {}

    def make() -> dict[str, npt.NDArray[Any]]:
        reading = READERS[kind](data, path, files)
        if len(reading.triangles) == 0:
            raise MeshError(path, "has no triangles")
        if not np.isfinite(reading.vertices).all():
            raise MeshError(path, "has vertices that are not finite numbers")
        if not (largest := float(np.abs(reading.vertices).max())) < LARGEST_COORDINATE:
            raise MeshError(path, f"extends to {largest:g} units (limit {FARTHEST:g} m)")
        compare_with_assimp(path, kind, data, files, reading)
        # Vertices that no triangle has are no part of the surface, and would enlarge its hull.
        used, triangles = np.unique(reading.triangles, return_inverse=True)
        unit = np.array(reading.unit)
        return {"vertices": reading.vertices[used], "triangles": triangles.reshape(-1, 3), "unit": unit}

    key = content_digest(data, kind, *(part for file in files.items() for part in file))
    arrays = cached("mesh", key, make, code=MESH_CODE, libraries=MESH_LIBRARIES)
    return Reading(arrays["vertices"], arrays["triangles"], float(arrays["unit"]))
