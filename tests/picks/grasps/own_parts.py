"""Parts that nothing was tuned for, a hand, and what is true of a grasp by other means than the proposals use.

A part is a watertight mesh of trimesh with its axes turned at random. The checks use trimesh's triangles and a linear
program, neither of which the proposals or the judge of the grip use.
"""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

import pinproof as pp
from pinproof.picks import ProposedGrasp, ProposedGrasps, Tool

from .. import grip_oracle as oracle

PAD = np.array([0.016, 0.008, 0.05])
OPENING = 0.07
FRICTION = 0.5


def jaws(opening: float = OPENING, **stated) -> Tool:
    """Two flat pads that close along y, with a palm behind them; the tip is at their end."""
    box = pp.Box(*PAD.tolist())
    pads = [
        pp.Obstacle(f"finger_{number}", box, pp.pose((0, sign * PAD[1] / 2, -PAD[2] / 2)))
        for number, sign in ((1, 1), (2, -1))
    ]
    palm = pp.Obstacle("palm", pp.Box(0.06, 0.12, 0.03), pp.pose((0, 0, -PAD[2] - 0.015)))
    fingers = pp.picks.GripperFingers(tuple(pads), opening=opening, grip=0.0)
    return Tool(fingers=fingers, tool=(palm,), **stated)


def _extruded(outline: list[tuple[float, float]], height: float) -> trimesh.Trimesh:
    from shapely.geometry import Polygon

    return trimesh.creation.extrude_polygon(Polygon(outline), height)


def shapes() -> dict[str, trimesh.Trimesh]:
    """By name; all fit between the pads in some direction."""
    create = trimesh.creation
    leg, foot = (0.0, 0.0), (0.05, 0.0)
    return {
        "bracket": _extruded([leg, foot, (0.05, 0.006), (0.006, 0.006), (0.006, 0.04), (0.0, 0.04)], 0.03),
        "tube": create.annulus(r_min=0.012, r_max=0.018, height=0.06, sections=48),
        "tee": _extruded([(-0.03, 0.02), (-0.03, 0.03), (0.03, 0.03), (0.03, 0.02), (0.006, 0.02), (0.006, -0.03),
                          (-0.006, -0.03), (-0.006, 0.02)], 0.014),
        "sphere": create.icosphere(subdivisions=4, radius=0.02),
        "cone": create.cone(radius=0.02, height=0.4, sections=48),
        "bolt": create.cylinder(radius=0.006, height=0.07, sections=32),
        "block": create.box((0.03, 0.05, 0.12)),
        "capsule": create.capsule(height=0.05, radius=0.014, count=(32, 32)),
    }  # fmt: skip


def turned(mesh: trimesh.Trimesh, rng: np.random.Generator) -> trimesh.Trimesh:
    """The mesh with its axes at random directions, so that nothing is along an axis by accident."""
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))
    turn[:3, 3] = rng.uniform(-0.05, 0.05, 3)
    return mesh.copy().apply_transform(turn)


def oracle_judges(mesh: trimesh.Trimesh, proposal: ProposedGrasp, rng: np.random.Generator) -> tuple[str, float]:
    """Whether the pads hold the part by the oracle of the grip, which knows coal and trimesh only."""
    pads_from_tip = pp.pose((0, 0, -PAD[2] / 2))
    shape = pp.Mesh.from_arrays(np.array(mesh.vertices), np.array(mesh.faces), hull=False)
    part_from_pads = proposal.grasp.pose * pads_from_tip
    grip = proposal.grasp.fingers["grip"]
    return oracle.judge(oracle.Grasp(shape, mesh, part_from_pads.inverse(), PAD, OPENING, grip), rng)


def is_pair(mesh: trimesh.Trimesh, proposal: ProposedGrasp, angle: float) -> bool:
    """Whether lines of trimesh from outside find both contacts, with normals in the cones, a width apart."""
    axis = proposal.normals[0]
    hits = []
    for contact, normal in zip(proposal.contacts, proposal.normals, strict=True):
        start = contact - 2e-3 * normal
        places, _, triangles = mesh.ray.intersects_location([start], [normal])
        if not len(places):
            return False
        first = int(((places - start) @ normal).argmin())
        if abs((places[first] - contact) @ normal) > 6e-4 or mesh.face_normals[triangles[first]] @ -normal < np.cos(
            angle
        ):
            return False
        hits.append(places[first])
    apart = float((hits[1] - hits[0]) @ axis)
    return abs(apart - proposal.width) < 1e-3


def resists_by_program(
    found: ProposedGrasps, proposal: ProposedGrasp, friction: float, forces: np.ndarray
) -> tuple[float, float]:
    """Bounds of the force at the centre of mass that two fingers exert along each of some directions, by programs.

    Each finger presses with up to 1. Friction and torsion share the force of a contact as in a soft finger: a ball, in
    which one polyhedron is, and which is in a larger one. The least over the directions is returned for both.
    """
    ball = oracle_directions(64)
    larger = 1 / -ConvexHull(ball).equations[:, 3].max()
    radius, bounds = 2 / 3 * np.sqrt(proposal.area / np.pi), []
    for scale in (1.0, larger):
        generators = []
        for point, normal in zip(proposal.contacts, proposal.normals, strict=True):
            u = np.linalg.svd(normal[None])[2][1:]
            for x, y, turn in ball * scale * friction:
                force = normal + x * u[0] + y * u[1]
                torque = np.cross(point - found.part.centre, force) + turn * radius * normal
                generators.append([*force, *torque / found.part.size])
        limits = np.kron(np.eye(2), np.ones(len(ball)))
        least = np.inf
        for force in forces:
            result = linprog(
                [*np.zeros(len(generators)), -1.0],
                A_ub=np.column_stack([limits, np.zeros(2)]),
                b_ub=np.ones(2),
                A_eq=np.column_stack([np.transpose(generators), -np.array([*force, 0, 0, 0])]),
                b_eq=np.zeros(6),
                bounds=(0, None),
            )
            least = min(least, float(result.x[-1]) if result.success else 0.0)
        bounds.append(least)
    return bounds[0], bounds[1]


def cup_resists_by_program(
    found: ProposedGrasps, proposal: ProposedGrasp, radius: float, friction: float, force: np.ndarray
) -> float:
    """An upper bound of the force along a direction that a cup resists, which pulls with 1, by a linear program."""
    (point,), (normal,) = proposal.contacts, proposal.normals
    ball, ring = oracle_directions(64), np.linspace(0, 2 * np.pi, 64, endpoint=False)
    larger, wider = 1 / -ConvexHull(ball).equations[:, 3].max(), 1 / np.cos(np.pi / 64)
    u = np.linalg.svd(normal[None])[2][1:]
    lever = point - found.part.centre
    pressing = np.array([*normal, *np.cross(lever, normal)])
    slips = [[*f, *(np.cross(lever, f) + turn * radius * normal)] for x, y, turn in ball * larger * friction
             for f in [x * u[0] + y * u[1]]]  # fmt: skip
    tilts = [[0, 0, 0, *wider * radius * (np.cos(angle) * u[0] + np.sin(angle) * u[1])] for angle in ring]
    columns = np.column_stack([pressing, np.transpose(slips), np.transpose(tilts), [-f for f in [*force, 0, 0, 0]]])
    columns[3:] /= found.part.size
    # The pressure is at most 2, of which 1 is the suction; shares of slips and of tilts are at most the pressure
    slip, tilt = np.repeat([[1.0], [0.0]], len(slips), axis=1), np.repeat([[0.0], [1.0]], len(tilts), axis=1)
    result = linprog(
        [*np.zeros(columns.shape[1] - 1), -1.0],
        A_ub=np.column_stack([[-1.0, -1.0], slip, tilt, [0.0, 0.0]]),
        b_ub=np.zeros(2),
        A_eq=columns,
        b_eq=pressing / [1, 1, 1, *[found.part.size] * 3],
        bounds=[(0, 2), *[(0, None)] * (columns.shape[1] - 1)],
    )
    return float(result.x[-1]) if result.success else 0.0


def oracle_directions(count: int) -> np.ndarray:
    """(K, 3) points spread over the unit sphere, with its axes."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - z**2)
    around = np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
    return np.concatenate([around, np.eye(3), -np.eye(3)])
