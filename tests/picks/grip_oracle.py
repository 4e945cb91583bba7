"""Random grasps around random parts, and by other means than the judge's whether they hold.

The part is a tessellation and coal's own shape. A finger is moved along its closing direction by bisection on coal's
collision test until it touches; its contact patch is measured by rays from random points of its inner face to the
triangles; the balance is that of two points of the patches whose connecting line lies in both friction cones.
"""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
import trimesh

import pinproof as pp
from pinproof.picks.judging.grip import MovingFinger, fingers_of
from pinproof.spatial import SE3

LIMITS = pp.picks.GripLimits()
RAYS = 3000
SPHERE, ROUND, CAPSULE = 3, 128, 48
"""Detail of tessellations; a chord leaves a sphere of 20 mm by 0.06 mm at most."""
STEP = 2e-4
CLOSING = {"finger_1": np.array([0.0, -1.0, 0.0]), "finger_2": np.array([0.0, 1.0, 0.0])}


@dataclass(frozen=True, eq=False)
class Grasp:
    """A part at ``pose`` in the tcp's frame, between two pads that move along y."""

    shape: pp.Shape
    mesh: trimesh.Trimesh
    pose: SE3
    pad: np.ndarray
    opening: float
    grip: float

    def fingers(self) -> pp.picks.GripperFingers:
        box = pp.Box(*self.pad.tolist())
        half = self.pad[1] / 2
        pair = (
            pp.Obstacle("finger_1", box, pp.pose((0, half, 0))),
            pp.Obstacle("finger_2", box, pp.pose((0, -half, 0))),
        )
        return pp.picks.GripperFingers(pair, opening=self.opening, grip=self.grip)

    def moving(self, arm: pp.Arm) -> tuple[MovingFinger, ...]:
        return fingers_of(arm, self.fingers(), {})


def random_shape(rng: np.random.Generator) -> tuple[pp.Shape, trimesh.Trimesh]:
    """A box, cylinder, capsule, sphere, hull, or a channel, which is not convex."""
    a, b, c = rng.uniform(0.012, 0.06, 3).tolist()
    kind = int(rng.integers(6))
    if kind == 0:
        return pp.Box(a, b, c), trimesh.creation.box((a, b, c))
    if kind == 1:
        return pp.Cylinder(a / 2, b), trimesh.creation.cylinder(a / 2, b, sections=ROUND)
    if kind == 2:
        return pp.Capsule(a / 2, b), trimesh.creation.capsule(b, a / 2, count=(CAPSULE, CAPSULE)).apply_translation(
            (0, 0, 0)
        )
    if kind == 3:
        return pp.Sphere(a / 2), trimesh.creation.icosphere(SPHERE, a / 2)
    if kind == 4:
        hull = trimesh.convex.convex_hull(rng.normal(size=(12, 3)) * [a, b, c] / 2.5)
        return pp.collision.ConvexShape(np.array(hull.vertices)), hull
    mesh = _channel(max(a, 0.025), b, max(c, 0.02), 0.25)
    return pp.Mesh.from_arrays(np.array(mesh.vertices), np.array(mesh.faces), hull=False), mesh


def _channel(x: float, y: float, z: float, wall: float) -> trimesh.Trimesh:
    """A U profile of length y, open upwards."""
    t = wall * min(x, z)
    profile = np.array([(0, 0), (x, 0), (x, z), (x - t, z), (x - t, t), (t, t), (t, z), (0, z)]) - [x / 2, z / 2]
    low, high = (np.column_stack([profile[:, 0], np.full(8, s * y / 2), profile[:, 1]]) for s in (-1, 1))
    caps = [(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4), (0, 5, 6), (0, 6, 7)]
    faces = [*caps, *((c + 8, b + 8, a + 8) for a, b, c in caps)]
    for i in range(8):
        j = (i + 1) % 8
        faces += [(i, i + 8, j), (j, i + 8, j + 8)]
    mesh = trimesh.Trimesh(np.concatenate([low, high]), np.array(faces)[:, ::-1])
    mesh.fix_normals()
    assert mesh.is_watertight
    return mesh


def random_grasp(rng: np.random.Generator) -> Grasp:
    """Half of the grasps are near one that holds: square to the part, its width between the pads."""
    shape, mesh = random_shape(rng)
    if rng.random() < 0.5:
        turn = trimesh.transformations.euler_matrix(*(np.pi / 2 * rng.integers(4, size=3)))[:3, :3]
        slip = pp.pose(rpy=rng.normal(scale=[0.02, 0.02, 0.02]) * rng.integers(2, size=3)).rotation
        turn = slip @ turn
        offset = rng.normal(scale=[0.005, 0.0007, 0.01])
    else:
        turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
        offset = rng.normal(scale=[0.015, 0.003, 0.02])
    across = mesh.vertices @ turn.T
    across = across - (across.max(axis=0) + across.min(axis=0)) / 2
    middle = -((mesh.vertices @ turn.T).max(axis=0) + (mesh.vertices @ turn.T).min(axis=0)) / 2
    width = float(np.ptp(across[:, 1]))
    pad = rng.uniform([0.008, 0.006, 0.015], [0.03, 0.012, 0.05])
    grip = max(width + float(rng.choice([0.0, rng.normal(scale=0.001), -rng.uniform(0, 0.01)], p=[0.5, 0.4, 0.1])), 0)
    opening = max(grip, width) + float(rng.uniform(-0.002, 0.02))
    return Grasp(shape, mesh, SE3(turn, middle + offset), pad, max(opening, grip), grip)


@dataclass(frozen=True)
class Touch:
    """What the oracle measures of a finger: gap (m), area (m^2), overlap (m), and points of its patch (N, 3)."""

    gap: float
    area: float
    overlap: float
    points: np.ndarray


def judge(grasp: Grasp, rng: np.random.Generator) -> tuple[str, float]:
    """``"held"`` or why not, and by what share of the limits that is decided: near 0 it is a matter of rounding."""
    part, at = _coal_part(grasp.shape, grasp.mesh), coal.Transform3s(grasp.pose.rotation, grasp.pose.translation)
    pad = coal.Box(*grasp.pad.tolist())

    def hits(name: str, gap: float) -> bool:
        half = (gap + grasp.pad[1]) / 2
        there = coal.Transform3s(np.eye(3), -CLOSING[name] * half)
        found = coal.CollisionResult()
        coal.collide(pad, there, part, at, coal.CollisionRequest(), found)
        return bool(found.isCollision())

    margins: list[float] = []
    touches = {}
    for name in CLOSING:
        if hits(name, grasp.opening):
            return "the open fingers overlap", 0.0 if not hits(name, grasp.opening + 4e-5) else 1.0
        touches[name] = _touch(grasp, name, lambda gap, name=name: hits(name, gap), rng)
    for touch in touches.values():
        if not np.isfinite(touch.gap):
            return "a finger meets nothing", 1.0
        margins += [(LIMITS.gap - touch.gap) / 1e-3, (LIMITS.depth + touch.gap) / 1e-3]
        margins += [touch.area / LIMITS.area - 1, touch.overlap / LIMITS.overlap - 1]
    if min(margins) < 0:
        return "gap, area or overlap", -min(margins)
    slack = LIMITS.angle - _line_angle(*(touches[name].points for name in CLOSING), CLOSING["finger_1"])
    return ("held", min(*margins, slack * 10)) if slack >= 0 else ("not opposite", -slack * 10)


def _coal_part(shape: pp.Shape, mesh: trimesh.Trimesh) -> object:
    if isinstance(shape, pp.Box):
        return coal.Box(shape.x, shape.y, shape.z)
    if isinstance(shape, pp.Cylinder):
        return coal.Cylinder(shape.radius, shape.length)
    if isinstance(shape, pp.Capsule):
        return coal.Capsule(shape.radius, shape.length)
    if isinstance(shape, pp.Sphere):
        return coal.Sphere(shape.radius)
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    model.addVertices(np.ascontiguousarray(mesh.vertices))
    model.addTriangles(np.ascontiguousarray(mesh.faces, dtype=np.int64))
    model.endModel()
    if isinstance(shape, pp.collision.ConvexShape):
        model.buildConvexHull(True, "Qt")
        return model.convex
    return model


def _touch(grasp: Grasp, name: str, hits, rng: np.random.Generator) -> Touch:  # type: ignore[no-untyped-def]
    """Close by steps until the pad touches, then to 1e-7 m by bisection; a pad is at half the gap from the middle."""
    gaps = np.arange(grasp.opening, -0.01, -STEP)
    first = next((gap for gap in gaps if hits(gap)), None)
    if first is None:
        return Touch(np.inf, 0.0, 0.0, np.empty((0, 3)))
    below, high = first, first + STEP
    while high - below > 1e-7:
        middle = (below + high) / 2
        below, high = (middle, high) if hits(middle) else (below, middle)
    d, size = CLOSING[name], grasp.pad[[0, 2]]
    turn, to = grasp.pose.rotation, grasp.pose.translation

    def rays(low: np.ndarray, extent: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        flat = low + rng.random((RAYS, 2)) * extent
        start = np.column_stack([flat[:, 0], np.full(RAYS, -d[1] * high / 2), flat[:, 1]])
        depth, normals = cast(grasp.mesh.triangles, (start - to) @ turn - (turn.T @ d) * 1e-4, turn.T @ d)
        return start, depth - 1e-4, np.abs(normals @ (turn.T @ d))

    # again where the first rays found the surface near, so that small patches have many rays
    start, depth, _ = rays(-size / 2, size)
    near = start[depth <= 2 * LIMITS.compliance][:, [0, 2]]
    if len(near) < 2:
        return Touch(float(grasp.grip - high) / 2, 0.0, 0.0, np.empty((0, 3)))
    low = np.maximum(near.min(axis=0) - 5e-4, -size / 2)
    extent = np.minimum(near.max(axis=0) + 5e-4, size / 2) - low
    start, depth, cosine = rays(low, extent)
    on = (depth <= LIMITS.compliance) & (cosine >= np.cos(LIMITS.angle))
    overlap = float(np.ptp(start[on, 2])) if on.any() else 0.0
    return Touch(float(grasp.grip - high) / 2, on.mean() * extent.prod(), overlap, start[on])


def cast(triangles: np.ndarray, origins: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first hit of each ray, and the normal of its triangle (Moeller and Trumbore, 1997).

    A triangle is tried with the rays inside its range of one coordinate across the rays.
    """
    e, f = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normals = np.cross(e, f)
    front = -normals @ d >= 1e-18  # not seen from behind
    triangles, e, f, normals = triangles[front], e[front], f[front], normals[front]
    coordinates = np.stack([np.cross(d, f), np.cross(e, d), normals], axis=-1) / (-normals @ d)[:, None, None]
    side = np.cross(d, np.eye(3)[np.abs(d).argmin()])
    order = np.argsort(origins @ side)
    spans = triangles @ side
    first = np.searchsorted(origins[order] @ side, spans.min(axis=1) - 1e-12)
    last = np.searchsorted(origins[order] @ side, spans.max(axis=1) + 1e-12)
    best, found = np.full(len(origins), np.inf), np.zeros((len(origins), 3))
    for k in np.flatnonzero(first < last):
        rays = order[first[k] : last[k]]
        u, v, t = ((origins[rays] - triangles[k, 0]) @ coordinates[k]).T
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t < best[rays])
        best[rays[hit]] = t[hit]
        found[rays[hit]] = normals[k] / np.linalg.norm(normals[k])
    return best, found


def _line_angle(one: np.ndarray, other: np.ndarray, d: np.ndarray) -> float:
    """The least angle between the closing direction and a line from a point of one patch to one of the other."""
    if not len(one) or not len(other):
        return np.pi
    lines = other[:, None] - one[None, ::8]
    along = lines @ d
    across = np.linalg.norm(lines - along[..., None] * d, axis=-1)
    return float(np.arctan2(across, along).min())
