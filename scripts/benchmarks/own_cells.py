"""Benchmark of a user's own cells: CAD meshes that the package has no examples of, and edges beside exact meshes.

./scripts/benchmark own_cells                              the picks of a cell that is made for it; some seconds
./scripts/benchmark own_cells --cell FOLDER                also the files of picks of a folder
./scripts/benchmark own_cells --edges 100000               also random edges among 1 to 10,000 bodies
./scripts/benchmark own_cells --cell FOLDER --edges 100000 --docs     rewrites docs/benchmarks/own_cells.*

Exit code 1 if an edge is stated to be free and coal finds a contact on it.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh
from trimesh.boolean import difference, union
from trimesh.creation import annulus, box, icosphere, torus
from trimesh.transformations import translation_matrix

import pinproof as pp
from benchmarks.tables import Benchmark, Blocks, Results, Row, page_parser, provenance, report, row_table
from benchmarks.tote_cell import write_cell
from pinproof.collision import (
    Box,
    Capsule,
    ConvexShape,
    Cylinder,
    Ellipsoid,
    Mesh,
    PointCloud,
    Sphere,
    is_proven_free,
)

Array = npt.NDArray[np.float64]

OWN = "tote"
"""The name of the cell that is made for this benchmark."""

BODIES = (1, 10, 100, 1_000, 10_000)
"""Numbers of obstacles of the scenes of random edges."""

EDGES_PER_SCENE = 500
"""Random edges that are proven in a scene of up to 1,000 bodies; half their number in larger ones."""

ROBOTS = ("ur5", "panda", "scara", "kinova")
"""Robots of the scenes, one after the other."""

SAMPLE_STEP = 0.02
"""Largest motion (rad or m) of a joint between two samples of a free edge, which coal checks."""

SHOWN = 20
"""Largest number of wrong verdicts that are kept as sentences."""


# -- picks -------------------------------------------------------------------------------------------------------------


@contextmanager
def _inside(folder: Path) -> Iterator[None]:
    """Work in a folder, because files of picks may name paths that are relative to the working folder."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def pick_row(cell: str, file: Path) -> Row:
    """Judge the picks of a file in all stages, twice: the first pass fills the caches; processor seconds of both."""
    with _inside(file.parent):
        picks = pp.read_picks(file.name)
        seconds = []
        for _ in range(2):
            start = process_time()
            arm, scene = picks.load_arm(), pp.Scene() if picks.scene is None else pp.Scene.load(picks.scene)
            judged = pp.validate_picks(arm, scene, picks)
            seconds.append(process_time() - start)
    verdicts = Counter(verdict.status.value for verdict in judged.verdicts)
    return Row(
        cell=cell, file=file.stem, picks=len(picks), verdicts=dict(verdicts), first_s=seconds[0], again_s=seconds[1]
    )


def pick_files(folder: Path) -> list[Path]:
    """The files of picks in a folder: those that state picks."""
    return [file for file in sorted(folder.glob("*.yaml")) if "\npicks:" in f"\n{file.read_text(encoding='utf-8')}"]


# -- edges beside exact meshes -----------------------------------------------------------------------------------------


@cache
def _meshes() -> list[trimesh.Trimesh]:
    """Closed meshes that are not convex, about 1 m large."""
    above, upright = translation_matrix([0, 0, 0.35]), translation_matrix([0.475, 0, 0.4])
    bowl = difference([icosphere(3, 0.5), icosphere(3, 0.46), box((1, 1, 0.5), above)])
    angle = union([box((1, 0.4, 0.05)), box((0.05, 0.4, 0.8), upright)])
    rough = icosphere(3, 0.4)
    rough.vertices *= 1 + 0.3 * np.random.default_rng(0).random((len(rough.vertices), 1))
    return [torus(0.4, 0.06), annulus(0.3, 0.33, 0.5), bowl, angle, rough]


def _random_shape(size: float, rng: np.random.Generator) -> Any:
    """A shape of about this size (m); two of five are exact meshes."""
    a, b, c = size * rng.uniform(0.2, 1.0, 3)
    kind = int(rng.integers(12))
    if kind < 5:
        mesh = _meshes()[kind]
        return Mesh.from_arrays(mesh.vertices * size, mesh.faces, hull=False)
    if kind == 5:
        return PointCloud(rng.uniform(-size / 2, size / 2, (20, 3)), size / 8)
    if kind == 6:
        return ConvexShape(rng.normal(scale=size / 3, size=(12, 3)))
    half = a / 2
    simple = (Box(a, b, c), Sphere(half), Cylinder(half, b), Capsule(half, b), Ellipsoid(half, b / 2, c / 2))
    return simple[kind - 7]


def random_scene(count: int, rng: np.random.Generator) -> pp.Scene:
    """Obstacles around a robot at the origin, the first an exact mesh; many are smaller, and reach farther out."""
    size, side, found = 0.6 / count**0.4, max(1.0, (count / 150) ** (1 / 3)), []
    while len(found) < count:
        if found:
            shape = _random_shape(size, rng)
        else:
            mesh = _meshes()[int(rng.integers(len(_meshes())))]
            shape = Mesh.from_arrays(mesh.vertices * max(size, 0.2), mesh.faces, hull=False)
        place = rng.uniform([-side, -side, 0.3 - side], [side, side, 0.3 + side])
        if np.linalg.norm(place) > 0.3 + size:  # the base of the robot does not move
            found.append(pp.Obstacle(f"body_{len(found)}", shape, pp.pose(place, rng.uniform(-3, 3, 3))))
    return pp.Scene(found)


def _coal_shapes(shape: Any) -> list[tuple[Any, Array]]:
    """The geometry of a shape for coal with the position (3,) of each part, not made by the package."""
    here = np.zeros(3)
    if isinstance(shape, PointCloud):
        side = shape.resolution
        return [
            (coal.Box(side, side, side), (cell + 0.5) * side)
            for cell in np.unique(np.floor(shape.points / side), axis=0)
        ]
    if isinstance(shape, Mesh | ConvexShape):
        model = coal.BVHModelOBBRSS()
        solid = trimesh.convex.convex_hull(shape.points) if isinstance(shape, ConvexShape) else None
        vertices, faces = (shape.vertices, shape.triangles) if solid is None else (solid.vertices, solid.faces)
        model.beginModel(len(faces), len(vertices))
        model.addVertices(np.asarray(vertices))
        model.addTriangles(np.asarray(faces))
        model.endModel()
        return [(model, here)]
    if isinstance(shape, Box):
        return [(coal.Box(shape.x, shape.y, shape.z), here)]
    if isinstance(shape, Ellipsoid):
        return [(coal.Ellipsoid(shape.rx, shape.ry, shape.rz), here)]
    if isinstance(shape, Sphere):
        return [(coal.Sphere(shape.radius), here)]
    made = coal.Cylinder if isinstance(shape, Cylinder) else coal.Capsule
    return [(made(shape.radius, shape.length), here)]


class _Truth:
    """Contacts of an arm with a scene by Pinocchio's kinematics and coal's broad phase, and which points are inside."""

    def __init__(self, arm: pp.Arm, scene: pp.Scene) -> None:
        # The links as a checker represents them, placed by Pinocchio
        self._arm, self._model = arm, arm.model
        self._links = pp.CollisionChecker(arm, pp.Scene()).geometry_model
        self._data, self._placed = self._model.createData(), self._links.createData()
        geometries = [each.geometry for each in self._links.geometryObjects]
        self._points = [np.array(g.points())[0] if hasattr(g, "points") else np.zeros(3) for g in geometries]
        self._moving = [coal.CollisionObject(geometry) for geometry in geometries]
        self._manager, self._solids = coal.DynamicAABBTreeCollisionManager(), []
        poses, farthest = [], []
        self._fixed = []  # the manager does not keep what is registered
        for thing in scene.obstacles:
            pose = thing.pose
            for geometry, offset in _coal_shapes(thing.shape):
                self._fixed.append(coal.CollisionObject(geometry, coal.Transform3s(pose.rotation, pose.act(offset))))
                self._manager.registerObject(self._fixed[-1])
            if isinstance(thing.shape, Mesh):
                solid = trimesh.Trimesh(np.array(thing.shape.vertices), np.array(thing.shape.triangles), process=False)
                self._solids.append(solid)
                poses.append(pose.inverse().homogeneous)
                farthest.append(np.abs(solid.bounds).max(axis=0))
        self._manager.setup()
        # Poses (S, 4, 4) of the root in the frames of the closed meshes, and half of the boxes (S, 3) around them
        self._from_root, self._half = np.array(poses).reshape(-1, 4, 4), np.array(farthest).reshape(-1, 3)

    def place(self, q: Array) -> None:
        """Place the links at a configuration."""
        configuration = self._arm.model_configuration(q)
        pin.updateGeometryPlacements(self._model, self._data, self._links, self._placed, configuration)

    def contact(self) -> bool:
        """Whether a link touches the surface of an obstacle."""
        for body, place in zip(self._moving, self._placed.oMg, strict=True):
            body.setTransform(coal.Transform3s(place.rotation, place.translation))
            body.computeAABB()
            found = coal.CollisionCallBackDefault()
            self._manager.collide(body, found)
            if found.data.result.isCollision():
                return True
        return False

    def inside(self) -> bool:
        """Whether a point of a link is in a closed mesh: on an edge without contact, one configuration decides it."""
        points = np.array([place.act(point) for place, point in zip(self._placed.oMg, self._points, strict=True)])
        own = np.einsum("sij,pj->spi", self._from_root[:, :3, :3], points) + self._from_root[:, None, :3, 3]
        near = (np.abs(own) <= self._half[:, None]).all(axis=2)
        return any(self._solids[k].contains(own[k, near[k]]).any() for k in np.flatnonzero(near.any(axis=1)))


def edge_row(count: int, edges: int, seed: int) -> Row:
    """Prove random edges among ``count`` obstacles, and check those that are proven free by coal at dense samples."""
    rng = np.random.default_rng([seed, count])
    free = samples = done = scenes = 0
    prove_s, wrong = 0.0, list[str]()
    in_scene = max(EDGES_PER_SCENE, count // 2)
    while done < edges:
        robot = ROBOTS[scenes % len(ROBOTS)]
        arm, scene = pp.load_robot(robot).arm(), random_scene(count, rng)
        checker, truth = pp.CollisionChecker(arm, scene), _Truth(arm, scene)
        low, high = np.maximum(arm.limits.lower, -np.pi), np.minimum(arm.limits.upper, np.pi)
        for number in range(done, min(done + in_scene, edges)):
            start = rng.uniform(low, high)
            end = np.clip(start + rng.normal(size=arm.dof) * rng.choice([0.02, 0.1, 0.4]), low, high)
            curve = pp.JointPath(np.array([start, end]), arm.joint_names)
            before = process_time()
            proven = is_proven_free(curve, checker)
            prove_s += process_time() - before
            if not proven:
                continue
            free += 1
            steps = 1 + int(np.ceil(np.abs(end - start).max() / SAMPLE_STEP))
            for share in np.linspace(0.0, 1.0, steps + 1):
                samples += 1
                truth.place(start + share * (end - start))
                if truth.contact() or (share == 0.0 and truth.inside()):
                    wrong.append(f"{robot} among {count} bodies, edge {number}: contact at {share:.3f}")
                    break
        done, scenes = done + in_scene, scenes + 1
    return Row(bodies=count, edges=edges, free=free, samples=samples, ms=1e3 * prove_s / edges, wrong=wrong[:SHOWN])


# -- the page ----------------------------------------------------------------------------------------------------------


def blocks(results: Results) -> Blocks:
    """The tables of the page."""
    picks = {
        "cell": "{.cell}",
        "picks file": "{.file}",
        "picks": "{.picks}",
        "verdicts": lambda row: ", ".join(f"{count} {name}" for name, count in row.verdicts.items()),
        "first [s]": "{.first_s:.2f}",
        "again [s]": "{.again_s:.2f}",
    }
    edges = {
        "bodies": "{.bodies:,}",
        "edges": "{.edges:,}",
        "proven free": "{.free:,}",
        "samples": "{.samples:,}",
        "per edge [ms]": "{.ms:.3f}",
        "wrong": lambda row: str(len(row.wrong)),
    }
    return {"picks": row_table(picks, results["picks"], text_columns=2), "edges": row_table(edges, results["edges"])}


def measure(options: argparse.Namespace) -> Results:
    """Judge the picks of the cells, then prove the random edges."""
    for folder in options.cell:
        if not folder.is_dir():
            raise SystemExit(f"--cell {folder}: no such folder")
        if not pick_files(folder):
            raise SystemExit(f"--cell {folder}: the folder has no picks file, which is a .yaml file with the key picks")
    settings = {"edges": options.edges}
    results = Results(settings, provenance(options.seed), {"picks": [], "edges": []})
    with tempfile.TemporaryDirectory() as made:
        cells = [
            (OWN, write_cell(Path(made), options.seed)),
            *((folder.resolve().name, folder) for folder in options.cell),
        ]
        for name, folder in cells:
            for file in pick_files(folder):
                results["picks"].append(pick_row(name, file))
                report(f"{name}: {results['picks'][-1]}")
    for count in BODIES if options.edges else ():
        results["edges"].append(edge_row(count, options.edges // len(BODIES), options.seed))
        report(f"edges: {results['edges'][-1]}")
    return results


BENCHMARK = Benchmark("own_cells", measure, blocks)


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "own_cells")
    parser.add_argument(
        "--cell", type=Path, action="append", default=[], metavar="FOLDER", help="folder of picks files"
    )
    parser.add_argument("--edges", type=int, default=0, metavar="N", help="random edges among 1 to 10,000 bodies")
    BENCHMARK.run(parser)
