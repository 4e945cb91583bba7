"""Triangle meshes from files, in metres, checked for what a collision check cannot use."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.description.packages import MeshFile
from pinproof.errors import MeshError

__all__ = ["MESH_SUFFIXES", "TriangleMesh", "collada_unit", "read_mesh", "resolved", "z_up"]

MESH_SUFFIXES = (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf")


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
        If the file is missing or unreadable, holds no triangle, or holds numbers that are not finite.
    """
    path = Path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise MeshError(path, f"is no mesh of a known kind: {', '.join(MESH_SUFFIXES)}")
    if not path.is_file():
        raise MeshError(path, "no such file")
    loaded = _load(path)
    vertices = np.array(loaded.vertices, dtype=float).reshape(-1, 3) @ z_up(path).T
    vertices *= np.asarray(scale) * collada_unit(path)
    triangles = np.array(loaded.faces, dtype=np.int64).reshape(-1, 3)
    if len(triangles) == 0:
        raise MeshError(path, "holds no triangle")
    if not np.isfinite(vertices).all():
        raise MeshError(path, "holds vertices that are not finite numbers")
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
    match = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']+)", path.read_bytes()[:100_000])
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


def _load(path: Path) -> Any:
    import trimesh

    try:
        return trimesh.load(path, force="mesh", process=False)
    except Exception as error:  # trimesh raises whatever its many readers raise
        raise MeshError(path, f"cannot be read as a mesh: {error}") from error
