"""Triangle meshes from files, in metres, checked for what a collision check cannot use."""

from __future__ import annotations

import re
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common.files import read_bytes
from pinproof.description.packages import MeshFile
from pinproof.description.xml_reader import refuse_doctype
from pinproof.errors import MeshError

__all__ = ["MESH_SUFFIXES", "TriangleMesh", "collada_unit", "read_mesh", "resolved", "z_up"]

MESH_SUFFIXES = (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf")


LARGEST_MESH = 256 * 2**20
"""Bytes (256 MiB): five million triangles as binary STL, a hundred times what a link needs."""

FARTHEST = 1e4
"""Metres from a mesh's own origin: beyond it is a mistake of units, and distances lose their digits."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles in space: ``vertices`` (V, 3) in metres, ``triangles`` (F, 3) indices of vertices."""

    vertices: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]


def read_mesh(path: str | Path, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> TriangleMesh:
    """Read a mesh file.

    Parameters
    ----------
    path
        STL, OBJ, DAE, PLY, GLB or glTF. A COLLADA file's unit is applied, its up axis is not; glTF is turned from its y
        up to z up (:func:`z_up`).
    scale
        Factor for x, y, z, after that. A negative product mirrors the mesh; its triangles are turned round then.

    Raises
    ------
    MeshError
        If the file is missing, unreadable or too large, holds no triangle, or holds numbers that are not finite, that
        are beyond :data:`FARTHEST`, or that name vertices which are not there.
    """
    path = Path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise MeshError(path, f"is no mesh of a known kind: {', '.join(MESH_SUFFIXES)}")
    vertices, triangles = _load(path)
    if len(triangles) == 0:
        raise MeshError(path, "holds no triangle")
    if triangles.min() < 0 or triangles.max() >= len(vertices):  # coal would read beyond the end
        raise MeshError(path, f"has triangles that name other vertices than the {len(vertices)} it holds")
    if not np.isfinite(vertices).all():
        raise MeshError(path, "holds vertices that are not finite numbers")
    factor = np.asarray(scale) * collada_unit(path)
    with np.errstate(over="ignore"):
        vertices = vertices @ z_up(path).T * factor
    if not (farthest := float(np.abs(vertices).max())) <= FARTHEST:
        what = f"reaches {farthest:g} m far, at most {FARTHEST:g} m make sense; the scale {max(scale):g} is given"
        raise MeshError(path, f"{what}, which for a mesh in millimetres is 0.001")
    return TriangleMesh(vertices, triangles[:, ::-1].copy() if np.prod(scale) < 0 else triangles)


def resolved(mesh: MeshFile, link: str) -> Path:
    """The file behind a URDF's mesh.

    Raises
    ------
    MeshError
        If it was not found; names the link and every place it was looked for.
    """
    if mesh.path is None:
        places = "\n  ".join(str(place) for place in mesh.looked_in)
        raise MeshError(mesh.uri, f"the mesh of link {link!r} was not found; it was looked for in\n  {places}")
    return mesh.path


def collada_unit(path: Path) -> float:
    """Metres per unit of a COLLADA file; 1 for every other kind; readers hand the raw numbers on."""
    if path.suffix.lower() != ".dae":
        return 1.0
    with path.open("rb") as file:
        match = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']+)", file.read(100_000))
    try:
        unit = float(match.group(1)) if match else 1.0
    except ValueError:
        unit = 0.0
    if not 0.0 < unit < float("inf"):
        raise MeshError(path, "states a unit that is no positive number of metres")
    return unit


def z_up(path: Path) -> npt.NDArray[np.float64]:
    """The rotation (3, 3) that takes the numbers of a mesh file to the axes of the link that bears it.

    glTF is y up by its standard (Khronos glTF 2.0, section 3.4), and what reads it for a z-up world turns it by a
    quarter about x: Drake, Blender, RViz (ros2/rviz, pull request 1482). COLLADA states its up axis, and there RViz,
    MoveIt's geometric_shapes (pull request 52) and Gazebo (issue 1305) take the numbers as they stand: so many robots
    state a wrong one that obeying would turn their links over. STL, OBJ and PLY state none.
    """
    if path.suffix.lower() in (".glb", ".gltf"):
        return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return np.eye(3)


def _load(path: Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Vertices and triangles as the file states them."""
    import trimesh

    data = read_bytes(path, MeshError, largest=LARGEST_MESH, remedy="make it coarser, or cut it into several")
    kind = path.suffix.lower()[1:]
    if kind == "dae":
        refuse_doctype(data, path, MeshError)
    if kind == "stl" and not data.lstrip().startswith(b"solid"):
        _refuse_cut_short(path, data)
    try:
        loaded: Any = trimesh.load(
            BytesIO(data), file_type=kind, resolver=_beside(path), force="mesh", process=False, skip_materials=True
        )
        vertices = np.array(loaded.vertices, dtype=float).reshape(-1, 3)
        return vertices, np.array(loaded.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:  # trimesh raises whatever its many readers raise
        raise MeshError(path, f"cannot be read as a mesh: {error or type(error).__name__}") from error


def _refuse_cut_short(path: Path, data: bytes) -> None:
    """A binary STL states how many triangles follow, 50 bytes each."""
    wanted = 84 + 50 * int.from_bytes(data[80:84], "little")
    if len(data) < wanted:
        what = f"by its header the STL has {wanted:,} bytes, and there are {len(data):,}"
        raise MeshError(path, f"cannot be read as a mesh: {what}")


def _beside(path: Path) -> Any:
    """What hands a reader the other files that a mesh names: of glTF those in its folder, of every other kind none."""
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
