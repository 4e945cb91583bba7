"""Arms, meshes and an independent oracle that the collision tests share."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from pinproof import Box, Capsule, CollisionChecker, Cylinder, JointPath, Mesh, Sphere, load_robot
from pinproof.description.meshes import read_mesh


@pytest.fixture(scope="session")
def ur5():
    return load_robot("ur5").arm()


@pytest.fixture(scope="session")
def panda():
    return load_robot("panda").arm()


@pytest.fixture(scope="session")
def generic_6dof():
    return load_robot("generic_6dof").arm()


LIMIT = '<limit lower="-7" upper="7" velocity="1" effort="1"/>'


def urdf_of(links: dict[str, str], joints: list[tuple[str, ...]], extra: str = "", name: str = "built") -> str:
    """A URDF of (link, geometry) and (joint, type, parent, child, origin, axis, more elements) in words.

    Geometries are separated by semicolons, each with its position after an @.
    """
    parts = []
    for link, geometry in links.items():
        shapes = "".join(
            f'<collision><origin xyz="{xyz or "0 0 0"}"/><geometry>{shape}</geometry></collision>'
            for shape, _, xyz in (line.partition("@") for line in geometry.split(";") if line)
        )
        parts.append(f'<link name="{link}">{shapes}</link>')
    for joint, kind, parent, child, xyz, axis, *more in joints:
        limit = "" if any("<limit" in each for each in more) else LIMIT
        parts.append(
            f'<joint name="{joint}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limit}{"".join(more)}</joint>'
        )
    return f'<robot name="{name}">{"".join(parts)}{extra}</robot>'


@pytest.fixture(scope="session")
def arm_from_links():
    """Builds a robot from the arguments of :func:`urdf_of`."""
    return lambda *words: load_robot(urdf_of(*words))


@pytest.fixture(scope="session")
def planar_2r(arm_from_links):
    """Two links of 0.5 m in the plane z = 0, each a thin bar from its joint; the base is a small block below."""
    bar = '<box size="0.5 0.02 0.02"/>@0.25 0 0'
    return arm_from_links(
        {"base": '<box size="0.05 0.05 0.02"/>@0 0 -0.05', "upper": bar, "fore": bar, "tip": ""},
        [
            ("q1", "continuous", "base", "upper", "0 0 0", "0 0 1"),
            ("q2", "continuous", "upper", "fore", "0.5 0 0.03", "0 0 1"),
            ("end", "fixed", "fore", "tip", "0.5 0 0", "0 0 1"),
        ],
    ).arm(tcp="tip")


@pytest.fixture(scope="session")
def slider(arm_from_links):
    """One prismatic joint along x that carries a ball of 1 cm; the root has no geometry."""
    return arm_from_links(
        {"root": "", "ball": '<sphere radius="0.01"/>', "tip": ""},
        [
            ("slide", "prismatic", "root", "ball", "0 0 0", "1 0 0"),
            ("end", "fixed", "ball", "tip", "0 0 0", "1 0 0"),
        ],
    ).arm(tcp="tip")


@pytest.fixture(scope="session")
def mesh_file(tmp_path_factory):
    """Writes vertices and triangles (or a trimesh) as a file and returns its path."""
    folder: Path = tmp_path_factory.mktemp("meshes")

    def write(mesh, triangles=None) -> Path:
        if triangles is not None:
            mesh = trimesh.Trimesh(mesh, triangles, process=False)
        path = folder / f"mesh_{len(list(folder.iterdir()))}.obj"
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
        path.write_text("\n".join(lines))
        return path

    return write


class Oracle:
    """The distances of a checker's pairs, computed independently.

    Fresh coal objects (hulls as closed meshes from SciPy's Qhull, not as coal's convex shapes), placed by forward
    kinematics of the complete robot. A body inside a mesh is not detected: the oracle is never the stricter one.
    """

    def __init__(self, checker: CollisionChecker) -> None:
        arm = self.arm = checker.arm
        self.model = pin.buildModelFromXML(arm.robot.urdf.kinematics)
        self.data = self.model.createData()
        self.pairs = checker.pairs
        shapes = [_link_shape(geometry) for geometry in arm.robot.urdf.collisions]
        local = [pin.SE3(np.array(geometry.origin)) for geometry in arm.robot.urdf.collisions]
        frames: list[str | None] = [geometry.link for geometry in arm.robot.urdf.collisions]
        for part in (body for body in checker.bodies if body.level):
            hull = trimesh.Trimesh(part.support.points).convex_hull
            shapes.append(_triangles(hull))
            local.append(part.link_from_body)
            frames.append(part.link)
        for things, frame in ((checker.attached, arm.tcp), (checker.scene.obstacles, None)):
            shapes += [_shape(thing.shape) for thing in things]
            local += [thing.pose for thing in things]
            frames += [frame] * len(things)
        self.shapes, self.local = shapes, local
        for shape in shapes:
            shape.computeLocalAABB()
        self.radii = np.array([shape.aabb_radius for shape in shapes])
        self.frames = [None if f is None else self.model.getFrameId(f, pin.FrameType.BODY) for f in frames]

    def places(self, q):
        """The poses of all shapes at q."""
        arm, model = self.arm, self.model
        values = dict(arm.held) | dict(zip(arm.joint_names, q, strict=True))
        for joint in arm.robot.urdf.joints.values():
            if joint.mimic is not None and joint.mimic.leader in arm.joint_names:
                values[joint.name] = joint.mimic.multiplier * values[joint.mimic.leader] + joint.mimic.offset
        full = pin.neutral(model)
        for name, value in values.items():
            full[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, self.data, full)
        places = []
        for frame, local in zip(self.frames, self.local, strict=True):
            placed = local if frame is None else self.data.oMf[frame] * local
            places.append(coal.Transform3s(placed.rotation, placed.translation))
        return places

    def distance(self, places, i, j) -> float:
        request = coal.DistanceRequest()
        request.gjk_tolerance, request.gjk_max_iterations = 1e-9, 2000
        return coal.distance(self.shapes[i], places[i], self.shapes[j], places[j], request, coal.DistanceResult())

    def distances(self, q):
        places = self.places(q)
        return np.array([self.distance(places, i, j) for i, j in self.pairs])

    def clearance(self, q) -> float:
        """The smallest distance. Pairs whose bounding spheres are farther apart than that are not measured."""
        places = self.places(q)
        centres = np.array([at.transform(shape.aabb_center) for at, shape in zip(places, self.shapes, strict=True)])
        first, second = np.array(self.pairs, dtype=int).reshape(-1, 2).T
        gaps = np.linalg.norm(centres[first] - centres[second], axis=1) - self.radii[first] - self.radii[second]
        least = np.inf
        for k in np.argsort(gaps):
            if gaps[k] > least:
                break
            least = min(least, self.distance(places, first[k], second[k]))
        return float(least)


def _link_shape(geometry):
    if geometry.kind == "mesh":
        return _shape(Mesh(geometry.mesh.path, geometry.size, hull=True))
    kinds = {"box": Box, "sphere": Sphere, "cylinder": Cylinder, "capsule": Capsule}
    return _shape(kinds[geometry.kind](*geometry.size))


def _shape(shape):
    if isinstance(shape, Box):
        return coal.Box(shape.x, shape.y, shape.z)
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length)
    if isinstance(shape, Capsule):
        return coal.Capsule(shape.radius, shape.length)
    return _mesh(shape.path, shape.scale, shape.hull)


@lru_cache(maxsize=256)
def _mesh(path, scale, hull):
    read = read_mesh(path, scale)
    mesh = trimesh.Trimesh(read.vertices, read.triangles, process=False)
    return _triangles(mesh.convex_hull if hull else mesh)


def _triangles(mesh):
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    model.addVertices(np.array(mesh.vertices))
    model.addTriangles(np.array(mesh.faces, dtype=np.int64))
    model.endModel()
    return model


@pytest.fixture(scope="session")
def oracle():
    return Oracle


def _path(arm, *waypoints) -> JointPath:
    return JointPath(np.array(waypoints, dtype=float), arm.joint_names)


def _first_touch(checker, curve, samples=4000) -> float:
    """The first parameter at which the clearance falls to the margin, by sampling and then by bisection."""
    times = np.linspace(*curve.domain, samples)
    touching = [checker.clearance(q) <= checker.margin for q in curve(times)]
    k = touching.index(True)
    low, high = times[k - 1], times[k]
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if checker.clearance(curve(middle)) <= checker.margin else (middle, high)
    return float(high)


def _assert_free_until(checker, curve, end, samples=400):
    start = curve.domain[0]
    assert all(checker.clearance(q) > checker.margin for q in curve(np.linspace(start, end, samples, endpoint=False)))


@pytest.fixture(scope="session")
def path():
    """A joint path of an arm through waypoints."""
    return _path


@pytest.fixture(scope="session")
def first_touch():
    """The first parameter of a curve at which a checker reports contact."""
    return _first_touch


@pytest.fixture(scope="session")
def assert_free_until():
    """Asserts that no sample of a curve before a parameter is in contact."""
    return _assert_free_until
