"""Whether contacts with friction can hold each other in balance: a grasp that squeezes a part and does not move it.

Source: V.-D. Nguyen (1988), "Constructing force-closure grasps", International Journal of Robotics
Research 7(3); for several contacts with linearised cones: J. Ponce, S. Sullivan, A. Sudsang, J.-D. Boissonnat, J.-P.
Merlet (1997), "On computing four-finger equilibrium and force-closure grasps of polyhedral objects", IJRR 16(1).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

__all__ = ["balanced"]

Array = npt.NDArray[np.float64]

CONE_EDGES = 16
"""Edges of the pyramids inscribed in friction cones: what they allow, the cones allow. They are 2 % narrower."""

SMALLEST = 1e-7
"""Metres: contacts that are nearer to each other than this are in one place."""


def balanced(patches: Sequence[tuple[Array, Array]], angle: float) -> bool:
    """Whether forces within the friction cones at some points of the patches add up to no force and no torque.

    Parameters
    ----------
    patches
        Of each contact: its points (N, 3) in metres, and the unit normal (3,) in which the finger presses.
    angle
        rad: the half angle of the friction cones.
    """
    from scipy.optimize import linprog

    points, forces, normals = [], [], []
    for touched, normal in patches:
        edges = _cone(normal, angle)
        for point in _outermost(touched, normal):
            points.append(np.tile(point, (len(edges), 1)))
            forces.append(edges)
            normals.append(edges @ normal)
    at, force = np.concatenate(points), np.concatenate(forces)
    centre = at.mean(axis=0)
    size = max(float(np.linalg.norm(at - centre, axis=1).max()), SMALLEST)
    torque = np.cross((at - centre) / size, force)
    balance = np.concatenate([force.T, torque.T, np.concatenate(normals)[None]])
    answer = linprog(
        np.zeros(len(at)), A_eq=balance, b_eq=np.array([0.0] * 6 + [1.0]), bounds=(0, None), method="highs"
    )
    return bool(answer.status == 0)


def _cone(normal: Array, angle: float) -> Array:
    """(E, 3) unit vectors on the cone of half angle (rad) about a normal."""
    least = np.eye(3)[np.abs(normal).argmin()]
    u = np.cross(normal, least)
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    turns = np.arange(CONE_EDGES) * 2 * np.pi / CONE_EDGES
    across = np.cos(turns)[:, None] * u + np.sin(turns)[:, None] * v
    return np.asarray(np.cos(angle) * normal + np.sin(angle) * across)


def _outermost(points: Array, normal: Array) -> Array:
    """(P, 3) the points of a patch that are outermost in some directions across its normal."""
    axes = _cone(normal, np.pi / 2)
    return np.unique(points[(points @ axes.T).argmax(axis=0)], axis=0)
