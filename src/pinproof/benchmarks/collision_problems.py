"""What checks and proofs are measured and audited on: random scenes, boxes by number, random edges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pinproof.collision import (
    Box,
    Capsule,
    CollisionChecker,
    Cone,
    ConvexHull,
    Cylinder,
    Ellipsoid,
    Obstacle,
    Scene,
    Shape,
    Sphere,
)
from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.spatial import pose

if TYPE_CHECKING:
    import pinocchio as pin

__all__ = ["MARGINS", "boxes", "random_configurations", "random_edge", "random_scene"]

Array = npt.NDArray[np.float64]

MARGINS = (0.0, 0.0, 0.003, 0.02)
"""Metres: one of them is drawn for each random scene."""

MOST_OBSTACLES = 8

SMALLEST, LARGEST = 0.002, 0.3
"""Metres: the sides and radii of random obstacles, as many from 2 to 20 mm as from 20 to 200."""

NEAR, FAR = 0.25, 0.8
"""Metres, as shares of a reach of one: how far from the axis of the base obstacles stand, and their height at most."""

STEPS = (0.05, 0.3, 1.0)
"""Rad or m: the spread of the joints' steps along a random edge."""

TRIES = 8
"""Configurations that are drawn for a free start of an edge; if none is free it starts where it may."""

FILL = 10
"""Boxes of the largest size; where there are more they are smaller, so that all together fill as much."""


def random_scene(rng: np.random.Generator, reach: float) -> Scene:
    """From one to eight obstacles of any convex shape, in any place and attitude, about an arm of that reach (m)."""
    obstacles = []
    for i in range(int(rng.integers(1, MOST_OBSTACLES + 1))):
        at = rng.uniform(-FAR, FAR, 3) * reach
        at[2] = abs(at[2])
        if np.hypot(at[0], at[1]) < NEAR * reach:
            at[0] += 2 * NEAR * reach
        obstacles.append(Obstacle(f"thing_{i}", _shape(rng), _turned(at, rng)))
    return Scene(obstacles)


def _turned(at: Array, rng: np.random.Generator) -> pin.SE3:
    return pose(at.tolist(), rng.uniform(-np.pi, np.pi, 3).tolist())


def _shape(rng: np.random.Generator) -> Shape:
    a, b, c = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST), 3)).tolist()
    return (
        lambda: Box(a, b, c),
        lambda: Sphere(a),
        lambda: Cylinder(a, b),
        lambda: Capsule(a / 2, b),
        lambda: Cone(a, b),
        lambda: Ellipsoid(a, b, c),
        lambda: ConvexHull(rng.normal(size=(8, 3)) * LARGEST / 3),
    )[int(rng.integers(7))]()


def boxes(count: int, reach: float, seed: int) -> Scene:
    """So many boxes around an arm of that reach (m): the more, the smaller, so that they always fill as much."""
    rng = np.random.default_rng([seed, count])
    largest = LARGEST * reach * min(1.0, (FILL / count) ** (1 / 3))
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        at = rng.uniform((-1, -1, 0), (1, 1, 1)) * reach
        if np.hypot(at[0], at[1]) > NEAR * reach:
            sides = (largest * rng.uniform(0.3, 1.0, 3)).tolist()
            obstacles.append(Obstacle(f"box_{len(obstacles)}", Box(*sides), _turned(at, rng)))
    return Scene(obstacles)


def random_configurations(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """(N, n) uniform within the limits; a joint without any takes a whole turn."""
    lower, upper = arm.limits.sampling_range()
    return rng.uniform(lower, upper, (count, arm.dof))


def random_edge(checker: CollisionChecker, rng: np.random.Generator) -> JointPath:
    """A straight edge within the limits, short or long, from a free configuration where one is soon found."""
    arm = checker.arm
    tried = random_configurations(arm, TRIES, rng)
    free = np.flatnonzero(checker.is_free_batch(tried))
    start = tried[free[0] if len(free) else 0]
    end = arm.limits.clip(start + rng.normal(size=arm.dof) * rng.choice(STEPS))
    return JointPath(np.stack([start, end]), arm.joint_names)
