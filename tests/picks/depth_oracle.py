"""Random hands and parts, and how deep points of one are in the other, by rays and distances to triangles.

A grasp holds its part apart from the depth: fingers of the right width, a cup on a flat surface, a rod on the part. How
deep the hand is in the part is measured at random points of its volume, its surface and its corners, and at those of
the part in the hand. That depth is never larger than the length of a displacement that separates them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import trimesh

import pinproof as pp
from pinproof.spatial import SE3, translated

LIMIT = pp.picks.GripLimits().depth
NEAR = 5e-5
"""Metres: depths this close to the limit are not judged, because the samples miss the deepest point."""

TIP = 0.16
DOWN = np.diag([1.0, -1.0, -1.0])
HOME = np.array([-1.8, -1.6, 1.6, -1.57, -1.57, 0.0])
GRASP = pp.pose((0.45, 0.15, 0.25), (np.pi, 0, 0.3))
"""``root_from_tip`` at the grasp; the part's z axis points to the flange."""

Mesh = trimesh.Trimesh


def box(x: float, y: float, z: float, at=(0.0, 0.0, 0.0)) -> Mesh:
    return trimesh.creation.box((x, y, z)).apply_translation(at)


def cylinder(radius: float, length: float, at=(0.0, 0.0, 0.0), sections: int = 64) -> Mesh:
    return trimesh.creation.cylinder(radius, length, sections=sections).apply_translation(at)


def union(*parts: Mesh) -> Mesh:
    return trimesh.boolean.union(list(parts), engine="manifold")


def without(one: Mesh, *holes: Mesh) -> Mesh:
    return trimesh.boolean.difference([one, *holes], engine="manifold")


def shape_of(mesh: Mesh, hull: bool | None = False) -> pp.Mesh:
    return pp.Mesh.from_arrays(np.array(mesh.vertices), np.array(mesh.faces), hull=hull)


def placed(mesh: Mesh, at: SE3) -> Mesh:
    return mesh.copy().apply_transform(at.homogeneous)


OBLIQUE = np.array(pp.pose(rpy=(0.3, 0.7, 1.1)).rotation)


def within(points: np.ndarray, mesh: Mesh) -> np.ndarray:
    """(N,) whether points are inside a closed mesh: a ray in an oblique direction meets an odd number of triangles."""
    a, b, c = np.moveaxis(mesh.triangles @ OBLIQUE, 1, 0)
    x, y, z = (points @ OBLIQUE).T[:, :, None]

    def side(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        return (q[:, 0] - p[:, 0]) * (y - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x - p[:, 0])

    u, v, w = side(b, c), side(c, a), side(a, b)
    hit = ((u > 0) & (v > 0) & (w > 0)) | ((u < 0) & (v < 0) & (w < 0))
    ahead = np.abs(u) * (a[:, 2] - z) + np.abs(v) * (b[:, 2] - z) + np.abs(w) * (c[:, 2] - z) > 0
    return (hit & ahead).sum(axis=1) % 2 == 1


def below(points: np.ndarray, mesh: Mesh) -> float:
    """The largest distance of points inside a mesh from its surface; 0 if none is inside."""
    low, high = mesh.bounds
    points = points[((points > low) & (points < high)).all(axis=1)]
    points = points[within(points, mesh)] if len(points) else points
    if not len(points):
        return 0.0
    triangles, count = mesh.triangles, len(points)
    pairs = np.tile(triangles, (count, 1, 1)), np.repeat(points, len(triangles), axis=0)
    near = trimesh.triangles.closest_point(*pairs)
    return float(np.linalg.norm(near - pairs[1], axis=1).reshape(count, -1).min(axis=1).max())


def samples(mesh: Mesh, rng: np.random.Generator, count: int) -> np.ndarray:
    """Random points of the volume and of the surface of a mesh, and its corners."""
    inside = mesh.bounds[0] + rng.random((count, 3)) * mesh.extents
    weights = mesh.area_faces / mesh.area_faces.sum()
    shares = rng.dirichlet((1.0, 1.0, 1.0), count)
    on = np.einsum("ij,ijk->ik", shares, mesh.triangles[rng.choice(len(weights), count, p=weights)])
    return np.concatenate([inside[within(inside, mesh)], on, mesh.vertices])


def deepest(hands: list[Mesh], part: Mesh, tcp_from_part: SE3, rng: np.random.Generator, count: int = 150) -> float:
    """The largest depth (m) of points of a hand, in the tcp frame, in a part, and of points of the part in the hand."""
    there = placed(part, tcp_from_part)
    depths = [0.0]
    for hand in hands:
        low, high = np.maximum(hand.bounds[0], there.bounds[0]), np.minimum(hand.bounds[1], there.bounds[1])
        if (low >= high).any():
            continue
        common = low + rng.random((count, 3)) * (high - low)
        both = common[within(common, hand)] if len(common) else common
        depths += [
            below(np.concatenate([both, samples(hand, rng, count)]), there),
            below(samples(there, rng, count), hand),
        ]
    return max(depths)


@dataclass(frozen=True, eq=False)
class Grasp:
    """A hand and a part: the settings of the picks and of the pick, and meshes of the hand in the tcp frame."""

    kind: str
    shape: pp.Shape
    mesh: Mesh
    tcp_from_part: SE3
    hands: list[Mesh]
    settings: dict[str, Any]
    pick: dict[str, Any] = field(default_factory=dict)

    def judge(self, arm: pp.Arm, **more: Any) -> pp.picks.PickVerdict:
        pick = pp.Pick("part", GRASP, carried="part", **{"approach": 0.08, "retreat": 0.03, **self.pick, **more})
        return self.judge_pick(arm, pick, pp.Scene([self.part]))

    @property
    def part(self) -> pp.Obstacle:
        """The part where it is grasped."""
        return pp.Obstacle("part", self.shape, GRASP * pp.pose((0, 0, TIP)).actInv(self.tcp_from_part))

    @property
    def shared(self) -> dict[str, Any]:
        """The settings of the picks."""
        return {"tip": pp.pose((0, 0, TIP)), "margin": 0.0005, **self.settings}

    def judge_pick(self, arm: pp.Arm, pick: pp.Pick, scene: pp.Scene, home: np.ndarray = HOME) -> pp.picks.PickVerdict:
        budget = pp.picks.PickBudget(compared=1, remedies=0, motion=0, configurations=4)
        picks = pp.Picks((pick,), **self.shared)
        return pp.validate_picks(arm, scene, picks, home=home, budget=budget).verdicts[0]


def palm_body(rng: np.random.Generator) -> tuple[pp.Shape, Mesh, float]:
    """A body of the hand: a box, cylinder, sphere, capsule, mesh or open frame, and half its height."""
    a, kind = rng.uniform([0.006, 0.006, 0.006], [0.03, 0.03, 0.02]), rng.integers(6)
    block = box(*(2 * a))
    if kind == 0:
        return pp.Box(*(2 * a).tolist()), block, a[2]
    if kind == 1:
        return pp.Cylinder(float(a[0]), float(2 * a[2])), cylinder(a[0], 2 * a[2]), a[2]
    if kind == 2:
        return pp.Sphere(float(a[0])), trimesh.creation.icosphere(2, a[0]), a[0]
    if kind == 3:
        return pp.Capsule(float(a[0]), float(2 * a[2])), trimesh.creation.capsule(2 * a[2], a[0], (16, 16)), a[2] + a[0]
    if kind == 4:
        return shape_of(block), block, a[2]
    wall = a.min() / 3
    frame = without(block, box(2 * (a[0] - wall), 2 * (a[1] - wall), 2 * a[2], (0, 0, wall)))
    return shape_of(frame), frame, a[2]


def fingers_grasp(rng: np.random.Generator, deep: bool) -> Grasp:
    """Two pads that hold a part of the right width, and a palm above it."""
    w, d, h = rng.uniform([0.02, 0.03, 0.04], [0.045, 0.06, 0.1])
    hull, kind = (None, False)[rng.integers(2)], rng.integers(6)
    if kind == 0:
        name, shape, mesh = "box", pp.Box(d, w, h), box(d, w, h)
    elif kind == 1:
        name, shape, mesh = "cylinder", pp.Cylinder(w / 2, h), cylinder(w / 2, h)
    elif kind == 2:
        name, shape, mesh = "capsule", pp.Capsule(w / 2, h), trimesh.creation.capsule(h, w / 2, (16, 16))
    elif kind == 3:
        name, mesh = "mesh", box(d, w, h)
        shape = shape_of(mesh, hull)
    elif kind == 4:
        name, w = "bin", w + 0.02
        mesh = without(box(d, w, h), box(d - 0.01, w - 0.01, h, (0, 0, 0.005)))
        shape = shape_of(mesh, hull)
    else:
        name = "pin on block"
        mesh = union(box(d, w, h / 2, (0, 0, -h / 4)), cylinder(w / 4, h / 2 + 0.002, (0, 0, h / 4 - 0.001), 24))
        shape = shape_of(mesh, hull)
    top = mesh.bounds[1][2]
    below_top = {"capsule": top, "pin on block": top + 0.01}.get(name, rng.uniform(0.006, 0.02))
    tcp_from_part = SE3(DOWN, np.array([0, 0, TIP - below_top + top]))
    solid, own, half = palm_body(rng)
    depth = rng.uniform(0.0015, 0.03) if deep else rng.uniform(-0.003, 0.0007)
    aside = rng.normal(0, 0.006, 2)
    at = pp.pose((*aside, TIP - below_top - half + depth))
    pads = tuple(
        pp.Obstacle(f"finger_{k}", pp.Box(0.016, 0.008, 0.05), pp.pose((0, 0.004 * side, TIP - 0.025)))
        for k, side in ((1, 1), (2, -1))
    )
    hand = pp.picks.GripperFingers(pads, opening=w + rng.uniform(0.004, 0.02), grip=w - rng.uniform(0, 0.0006))
    settings = {"fingers": hand, "tool": (pp.Obstacle("palm", solid, at),)}
    return Grasp(f"fingers, {name}", shape, mesh, tcp_from_part, [placed(own, at)], settings)


def cup_grasp(rng: np.random.Generator, deep: bool) -> Grasp:
    """A cup on a flat surface; a deep one is pressed in, over a pin, or between walls into which its mount cuts."""
    r, h = rng.uniform([0.006, 0.03], [0.015, 0.08])
    w = rng.uniform(2 * r + 0.006, 2 * r + 0.03, 2)
    shapes = {
        "box": (pp.Box(*w.tolist(), h), box(*w, h)),
        "cylinder": (pp.Cylinder(float(w[0]), h), cylinder(w[0], h)),
        "mesh": (shape_of(box(*w, h)), box(*w, h)),
    }
    name = str(rng.choice(list(shapes)))
    shape, mesh = shapes[name]
    press = rng.uniform(-0.0004, 0.0007)
    bodies = {
        "bellows": (pp.Cylinder(r, 0.02), cylinder(r, 0.02), pp.pose((0, 0, TIP - 0.01))),
        "lance": (pp.Cylinder(0.005, 0.14), cylinder(0.005, 0.14), pp.pose((0, 0, 0.07))),
    }
    if deep:
        how = str(rng.choice(["pressed", "pin", "collar"]))
        name += f" {how}"
        if how == "pressed":
            press = rng.uniform(0.0015, 0.02)
        elif how == "pin":
            radius, length = rng.uniform([0.0005, 0.0017], [0.6 * r, 0.03])
            mesh = union(mesh, cylinder(radius, length + 0.002, (0, 0, (h + length) / 2 - 0.001), 24))
            shape = shape_of(mesh)
        else:
            inner, high = r + rng.uniform(0.001, 0.004), rng.uniform(0.008, 0.045)
            ring = cylinder(inner + 0.012, high + 0.02, (0, 0, (h + high) / 2 - 0.01))
            mesh = without(ring, cylinder(inner, high + 0.001, (0, 0, (h + high) / 2 + 0.0005)))
            shape = shape_of(mesh)
            mount, back = inner + rng.uniform(0.003, 0.01), rng.uniform(0.0, high - 0.004)
            bodies["mount"] = (pp.Cylinder(mount, 0.03), cylinder(mount, 0.03), pp.pose((0, 0, TIP - back - 0.015)))
    tcp_from_part = SE3(DOWN, np.array([0, 0, TIP + h / 2 - press]))
    tool = tuple(pp.Obstacle(body, solid, at) for body, (solid, _, at) in bodies.items())
    hands = [placed(own, at) for _, own, at in bodies.values()]
    return Grasp(
        f"cup, {name}", shape, mesh, tcp_from_part, hands, {"cup": pp.picks.SuctionCup(radius=r), "tool": tool}
    )


def rod_grasp(rng: np.random.Generator, deep: bool) -> Grasp:
    """A rod on a part, or in it; the closed box has walls of 1 to 4 mm."""
    h, (x, y), r = rng.uniform(0.02, 0.1), rng.uniform(0.05, 0.09, 2), rng.uniform(0.002, 0.012)
    hull = trimesh.convex.convex_hull(rng.normal(size=(20, 3)) * 0.03)
    wall = rng.uniform(0.001, 0.004)
    shell = without(box(x, y, h), box(x - 2 * wall, y - 2 * wall, h - 2 * wall))
    name, shape, mesh = [
        ("box", pp.Box(x, y, h), box(x, y, h)),
        ("sphere", pp.Sphere(h / 2), trimesh.creation.icosphere(3, h / 2)),
        ("cylinder", pp.Cylinder(x / 2, h), cylinder(x / 2, h)),
        ("mesh", shape_of(box(x, y, h)), box(x, y, h)),
        ("hull", pp.collision.ConvexShape(np.array(hull.vertices)), hull),
        ("closed box", shape_of(shell, (None, False)[rng.integers(2)]), shell),
    ][rng.integers(6)]
    solid, rod = [
        (pp.Cylinder(r, 0.15), cylinder(r, 0.15)),
        (pp.Box(2 * r, 2 * r, 0.15), box(2 * r, 2 * r, 0.15)),
        (shape_of(cylinder(r, 0.15, sections=12)), cylinder(r, 0.15, sections=12)),
    ][rng.integers(3)]
    at, top = pp.pose((0, 0, TIP - 0.075)), float(mesh.bounds[1][2])
    depth = rng.uniform(0.006, 1.1 * h) if deep else rng.uniform(-0.003, 0.0007)
    tcp_from_part = SE3(DOWN, np.array([*rng.normal(0, 0.003, 2), TIP + top - depth]))
    settings = {"tool": (pp.Obstacle("rod", solid, at),), "grip_limits": pp.picks.GripLimits(tip=0.03)}
    return Grasp(f"rod, {name}", shape, mesh, tcp_from_part, [placed(rod, at)], settings)


GRASPS = {"fingers": fingers_grasp, "cup": cup_grasp, "rod": rod_grasp}


def random_grasps(tool: str, deep: bool, count: int, seed: int) -> list[Grasp]:
    """Grasps whose depth is beyond the limit, or within it, by the samples; a rod through a thin lid is beyond it."""
    found: list[Grasp] = []
    index = 0
    while len(found) < count:
        rng = np.random.default_rng([seed, index])
        index += 1
        grasp = GRASPS[tool](rng, deep)
        depth = deepest(grasp.hands, grasp.mesh, grasp.tcp_from_part, rng)
        through = deep and depth > 0.0 and "closed box" in grasp.kind
        if through or (depth > LIMIT + NEAR if deep else depth < LIMIT - NEAR):
            found.append(grasp)
    return found


def along(grasp: Grasp, direction: np.ndarray, length: float, rng: np.random.Generator, count: int = 15) -> float:
    """The largest depth (m) while the hand moves away from the part by a length against a direction (3,) of the tcp."""
    return max(
        deepest(grasp.hands, grasp.mesh, translated(grasp.tcp_from_part, share * length * direction), rng, 60)
        for share in np.linspace(0.0, 1.0, count)
    )
