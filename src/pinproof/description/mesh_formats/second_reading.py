"""An independent second reading of a mesh file: what assimp reads, through coal, must be the same geometry."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.description.mesh_formats.gltf import with_second_root
from pinproof.description.mesh_formats.reading import REMEDY, Reading
from pinproof.errors import MeshError

ROUNDING = 1e-5
"""Difference of coordinates relative to the largest. assimp computes with single precision; the largest difference in
the 776 meshes of example-robot-data is 2e-7."""

REMOVED = re.compile(rb"^[ \t]*(mtllib\b[^\n]*)?", re.MULTILINE)
"""Parts of OBJ files that assimp does not see: files of materials, which it would open, and indentation, because it
ignores indented lines."""


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
    with TemporaryDirectory(prefix="pinproof-") as folder:
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
