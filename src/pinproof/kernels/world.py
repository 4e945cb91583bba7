"""The data of a collision checker for compiled loops: its joints, bodies and pairs as plain arrays.

B bodies: first the R bodies of the robot (links, then attached ones), then O fixed obstacles. m joints of the model,
each after its parent. P pairs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.kernels.compiled import compiled

__all__ = ["World", "flatten", "world_of"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Columns of World.joints. Each joint rotates about, or moves along, its own z axis.
JOINT_PLACE = 0
"""parent_from_joint at 0: rotation row by row (9), translation (3)."""
SLIDES, LEADER, MULTIPLIER, OFFSET, PARENT = 12, 13, 14, 15, 16
"""Its value is multiplier * q[leader] + offset. The parent is a joint, or -1: the root."""
JOINT_COLUMNS = 17

# Columns of World.bodies.
JOINT = 0
"""The joint that carries it, or -1."""
PLACE = 1
"""joint_from_body: rotation row by row (9), translation (3)."""
CENTRE, HALF = 13, 16
"""Its box, in its own frame: centre (3) and half sides (3)."""
BALL = 19
"""The radius of the bounding ball about that centre."""
FIRST, LAST, DISCS = 20, 21, 22
"""Its points are vertices[:, FIRST:LAST]; whether any has a disc."""
RADIUS, SEMI = 23, 24
"""The ball and the ellipsoid (3) that are added to its hull, as in :class:`pinproof.collision.bodies.Support`."""
CONVEX = 27
"""1 if it has a support function, 2 for the half-space below its own z = 0, which is always the second of a pair; 0:
coal judges its pairs."""
HALF_SPACE = 2.0
BODY_COLUMNS = 28

# Columns of World.pairs.
A, B, MARGIN, OUTSIDE = 0, 1, 2, 3
"""The two bodies, the first the robot's; the margin in metres; whether the second is an obstacle."""
BEGIN = 4
"""A direction (3) in the first body's frame that probably separates them; zeros if unknown."""
PAIR_COLUMNS = 7

# Columns of World.tree.
LOW, HIGH, SKIP, LEAF = 0, 3, 6, 7
"""A box (3, 3) in the root frame; the row after all rows below this one; the body of its obstacle, or -1."""
TREE_COLUMNS = 8

# Columns of the placements of bodies.
MIDDLE = 12
"""After root_from_body, rotation row by row (9) and translation (3): the centre of its box (3) in the root frame."""
PLACEMENT_COLUMNS = 15


class World(NamedTuple):
    """The arrays, which are shared by threads and must not be changed.

    Passing nine arrays to a kernel takes longer than a complete check may, so they are passed as two (:func:`flatten`),
    and separated again inside (:func:`world_of`).
    """

    joints: Array
    """(m, 17)"""
    bodies: Array
    """(B, 28)"""
    vertices: Array
    """(4, V) x, y, z and disc radius of all points."""
    pairs: Array
    """(P, 4)"""
    own: Indices
    """The pairs of bodies of the robot between which a joint moves."""
    around: Indices
    """The bodies of the robot that are checked against obstacles, from the hand to the base, likely contacts first."""
    outer: Indices
    """(R, O) the pair of a body of the robot and an obstacle, -1 if it is not checked or no joint moves it."""
    tree: Array
    """(N, 8) boxes around boxes of the obstacles, from the root down, each before those within it."""
    widest: Array
    """(2,) the largest margin of a pair with an obstacle; the allowance for floating-point errors in metres."""


def flatten(world: World) -> tuple[Array, Indices]:
    """All numbers and all indices, concatenated; the indices begin with the sizes m, B, V, P, K, R, O, N, A."""
    sizes = [*map(len, (world.joints, world.bodies)), world.vertices.shape[1], *map(len, (world.pairs, world.own))]
    sizes += [*world.outer.shape, len(world.tree), len(world.around)]
    numbers = (world.widest, world.joints, world.bodies, world.vertices, world.pairs, world.tree)
    return (
        np.concatenate([part.ravel() for part in numbers]),
        np.concatenate([np.array(sizes, dtype=np.int64), world.own, world.around, world.outer.ravel()]),
    )


@compiled
def world_of(numbers: Any, indices: Any) -> Any:
    """The :class:`World` that was flattened."""
    m, bodies, points, pairs = indices[0], indices[1], indices[2], indices[3]
    own, robot, obstacles, nodes, around = indices[4], indices[5], indices[6], indices[7], indices[8]
    f = 9 + own
    g = f + around
    a = 2
    b = a + m * JOINT_COLUMNS
    c = b + bodies * BODY_COLUMNS
    d = c + points * 4
    e = d + pairs * PAIR_COLUMNS
    return World(
        numbers[a:b].reshape((m, JOINT_COLUMNS)),
        numbers[b:c].reshape((bodies, BODY_COLUMNS)),
        numbers[c:d].reshape((4, points)),
        numbers[d:e].reshape((pairs, PAIR_COLUMNS)),
        indices[9:f],
        indices[f:g],
        indices[g:].reshape((robot, obstacles)),
        numbers[e:].reshape((nodes, TREE_COLUMNS)),
        numbers[:2],
    )
