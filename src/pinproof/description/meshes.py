"""Reading triangle meshes in metres, with validation for collision checking."""

from __future__ import annotations

import re
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common.disk_cache import cached, content_digest
from pinproof.common.files import read_bytes, unknown_suffix
from pinproof.description.packages import MeshFile
from pinproof.description.xml_reader import refuse_doctype
from pinproof.errors import MeshError

MESH_SUFFIXES = (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf")

COLOURED_SUFFIXES = MESH_SUFFIXES[1:]
"""The formats that can state colours: all but STL."""

LARGEST_MESH = 256 * 2**20
"""Bytes (256 MiB): five million triangles as binary STL, about a hundred times as many as a link needs."""

MESH_LIBRARIES = ("trimesh", "pycollada")
"""The distributions that parse mesh files."""

FARTHEST = 1e4
"""Metres from the origin of the mesh. Larger coordinates are wrong units, and distances would lose digits."""


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
        If the file is missing, unreadable or too large, has no triangles or undefined vertices, or has coordinates that
        are not finite or larger than :data:`FARTHEST`.
    """
    path = Path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise MeshError(path, unknown_suffix(path, MESH_SUFFIXES))
    vertices, triangles = _load(path)
    if len(triangles) == 0:
        raise MeshError(path, "has no triangles")
    if triangles.min() < 0 or triangles.max() >= len(vertices):  # coal would read beyond the end
        raise MeshError(path, f"has triangles with vertex indices outside the {len(vertices)} vertices")
    if not np.isfinite(vertices).all():
        raise MeshError(path, "has vertices that are not finite numbers")
    factor = np.asarray(scale) * collada_unit(path)
    with np.errstate(over="ignore"):
        vertices = vertices @ z_up(path).T * factor
    if not (farthest := float(np.abs(vertices).max())) <= FARTHEST:
        what = f"extends to {farthest:g} m (limit {FARTHEST:g} m) with the scale {max(scale):g}"
        raise MeshError(path, f"{what}; the scale of a mesh in millimetres is 0.001")
    return TriangleMesh(vertices, triangles[:, ::-1].copy() if np.prod(scale) < 0 else triangles)


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


def collada_unit(path: Path) -> float:
    """Return the metres per unit of a COLLADA file, and 1 for other formats; mesh readers ignore the unit."""
    if path.suffix.lower() != ".dae":
        return 1.0
    with path.open("rb") as file:
        match = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']+)", file.read(100_000))
    try:
        unit = float(match.group(1)) if match else 1.0
    except ValueError:
        unit = 0.0
    if not 0.0 < unit < float("inf"):
        raise MeshError(path, "has a unit that is not a positive number of metres")
    return unit


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


def _load(path: Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return the vertices and triangles of the file, unscaled."""
    data = read_bytes(path, MeshError, largest=LARGEST_MESH, remedy="simplify the mesh, or split it into several")
    kind = path.suffix.lower()[1:]
    if kind == "dae":
        refuse_doctype(data, path, MeshError)
    if kind == "stl" and not data.lstrip().startswith(b"solid"):
        _refuse_truncated_stl(path, data)
    if kind == "gltf":  # it refers to other files
        return _parsed(path, data, kind)

    def make() -> dict[str, npt.NDArray[Any]]:
        vertices, triangles = _parsed(path, data, kind)
        return {"vertices": vertices, "triangles": triangles}

    found = cached("mesh", content_digest(data, kind), make, code=[__file__], libraries=MESH_LIBRARIES)
    return found["vertices"], found["triangles"]


def _parsed(path: Path, data: bytes, kind: str) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    import trimesh

    try:
        loaded: Any = trimesh.load(
            BytesIO(data), file_type=kind, resolver=_beside(path), force="mesh", process=False, skip_materials=True
        )
        vertices = np.array(loaded.vertices, dtype=float).reshape(-1, 3)
        return vertices, np.array(loaded.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # trimesh raises whatever its many readers raise
        raise MeshError(path, f"cannot be read as a mesh: {error or type(error).__name__}") from error


def _refuse_truncated_stl(path: Path, data: bytes) -> None:
    """Raise MeshError if a binary STL is shorter than its header states (50 bytes for each triangle)."""
    wanted = 84 + 50 * int.from_bytes(data[80:84], "little")
    if len(data) < wanted:
        what = f"the file is truncated: its header announces {wanted:,} bytes, but it has {len(data):,}"
        raise MeshError(path, f"cannot be read as a mesh: {what}")


def _beside(path: Path) -> Any:
    """Return a resolver for files that a mesh refers to: files in the folder of a glTF file, none for other formats."""
    from trimesh.resolvers import Resolver

    class Beside(Resolver):  # type: ignore[misc]  # trimesh is not typed
        def __init__(self) -> None:
            self.folder = path.parent.resolve()

        def get(self, name: str) -> bytes:
            file = (self.folder / name).resolve()
            if path.suffix.lower() != ".gltf" or not file.is_relative_to(self.folder):
                raise FileNotFoundError(name)
            return read_bytes(file, MeshError, largest=LARGEST_MESH)

        def keys(self) -> list[str]:
            return []

        def namespaced(self, _namespace: str) -> Any:
            return self

        def write(self, name: str, _data: bytes) -> None:
            raise PermissionError(name)

    return Beside()
