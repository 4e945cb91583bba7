"""A checker as plain arrays, for compiled loops (:class:`pinproof.kernels.world.World`)."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.bodies import Body, boxes
from pinproof.kernels import world as w
from pinproof.model import Arm

__all__ = ["convex_pairs", "pack_world", "with_margins"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def pack_world(
    arm: Arm, bodies: Sequence[Body], pairs: Sequence[tuple[int, int]], rounding: float
) -> tuple[w.World, Array, Indices]:
    """The arrays without margins, the placements (B, 15) of the bodies, and the still pairs.

    Placements are filled in of the bodies that never move.

    Parameters
    ----------
    bodies, pairs
        Obstacles last; the first of a pair is the robot's.
    rounding
        Metres by which floating point may be off.
    """
    joints, aligned = _joints(arm)
    rows, vertices = _bodies(arm, bodies, aligned)
    robot = sum(body.link is not None for body in bodies)
    table = np.zeros((len(pairs), w.PAIR_COLUMNS))
    outer = np.full((robot, len(bodies) - robot), -1, dtype=np.int64)
    own, still, parted_once = [], [], []
    moved = _moved_by(joints)
    for k, (i, j) in enumerate(pairs):
        table[k, : w.BEGIN] = i, j, 0.0, j >= robot
        joint_i, joint_j = int(rows[i, w.JOINT]), int(rows[j, w.JOINT])
        if moved[joint_i] == moved[joint_j]:
            still.append(k)
        elif j >= robot:
            outer[i, j - robot] = k
        else:
            own.append(k)
            if len(set(moved[joint_i]) ^ set(moved[joint_j])) == 1:
                parted_once.append(k)
    at = np.zeros((len(bodies), w.PLACEMENT_COLUMNS))
    for body in np.flatnonzero(rows[:, w.JOINT] < 0):
        at[body, :12] = rows[body, w.PLACE : w.PLACE + 12]
        at[body, w.MIDDLE :] = at[body, :9].reshape(3, 3) @ rows[body, w.CENTRE : w.CENTRE + 3] + at[body, 9:12]
    tree = _tree(rows, at, robot)
    around = np.flatnonzero((outer >= 0).any(axis=1))[::-1]
    world = w.World(
        joints, rows, vertices, table, np.array(own, dtype=np.int64), around, outer, tree, np.array([0.0, rounding])
    )
    _begin(world, at, parted_once, arm.dof)
    return world, at, np.array(still, dtype=np.int64)


def with_margins(world: w.World, margins: Array) -> w.World:
    """The same arrays under other margins (P,)."""
    pairs = world.pairs.copy()
    pairs[:, w.MARGIN] = margins
    outside = margins[pairs[:, w.OUTSIDE] == 1.0]
    return world._replace(pairs=pairs, widest=np.array([outside.max(initial=0.0), world.widest[1]]))


def _begin(world: w.World, at: Array, pairs: Sequence[int], n: int) -> None:
    """Note in which direction bodies are apart that only one joint parts: it hardly changes, and they are always near.

    Found at q = 0 and not where the arm was last, so that no answer depends on what was asked before.
    """
    from pinproof.kernels.near import measure, place_bodies

    numbers, indices = w.flatten(world)
    placed, points, normal = at.copy(), np.empty((2, 3)), np.empty(3)
    place_bodies(numbers, indices, np.zeros(n), placed)
    for k in pairs:
        i, j = world.pairs[k, :2].astype(int)
        if world.bodies[i, w.CONVEX] and world.bodies[j, w.CONVEX]:
            measure(numbers, indices, placed, k, points, normal)
            world.pairs[k, w.BEGIN :] = placed[i, :9].reshape(3, 3).T @ normal


def convex_pairs(world: w.World) -> npt.NDArray[np.bool_]:
    """(P,) the pairs that need no coal."""
    convex = world.bodies[:, w.CONVEX] != 0.0
    return np.asarray(convex[world.pairs[:, w.A].astype(int)] & convex[world.pairs[:, w.B].astype(int)])


def _joints(arm: Arm) -> tuple[Array, list[pin.SE3]]:
    """The rows of the joints, and for each the rotation that takes z to its axis."""
    model, data = arm.model, arm.model.createData()
    columns = pin.computeJointJacobians(model, data, pin.neutral(model)).reshape(6, -1)
    rows, aligned = np.zeros((model.njoints - 1, w.JOINT_COLUMNS)), []
    for k, row in enumerate(rows):
        slides = not columns[3:, k].any()
        axis = data.oMi[k + 1].rotation.T @ (columns[:3, k] if slides else columns[3:, k])
        turned = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis), np.zeros(3))
        aligned.append(turned)
        parent = int(model.parents[k + 1]) - 1
        above = pin.SE3.Identity() if parent < 0 else aligned[parent].inverse()
        place = above * model.jointPlacements[k + 1] * turned
        row[:12] = [*place.rotation.ravel(), *place.translation]
        leader = int(np.abs(arm.scale[k]).argmax())
        row[w.SLIDES :] = slides, leader, arm.scale[k, leader], arm.offset[k], parent
    return rows, aligned


def _bodies(arm: Arm, bodies: Sequence[Body], aligned: Sequence[pin.SE3]) -> tuple[Array, Array]:
    rows, points, count = np.zeros((len(bodies), w.BODY_COLUMNS)), [np.empty((4, 0))], 0
    centres, halves = boxes(bodies)
    for row, body, centre, half in zip(rows, bodies, centres, halves, strict=True):
        joint, place = -1, body.link_from_body
        if body.link is not None:
            frame = arm.model.frames[arm.model.getFrameId(body.link, pin.FrameType.BODY)]
            joint, place = int(frame.parentJoint) - 1, frame.placement * place
        if joint >= 0:
            place = aligned[joint].inverse() * place
        row[w.JOINT] = joint
        row[w.PLACE : w.PLACE + 12] = [*place.rotation.ravel(), *place.translation]
        if not np.isfinite([centre, half]).all():  # without an end: never settled by its box
            centre, half = np.zeros(3), np.full(3, np.inf)
        row[w.CENTRE : w.CENTRE + 3], row[w.HALF : w.HALF + 3] = centre, half
        row[w.BALL] = np.linalg.norm(half)
        row[w.FIRST] = row[w.LAST] = count
        if isinstance(body.geometry, coal.Halfspace):
            row[w.CONVEX] = w.HALF_SPACE
        if body.support is None:
            continue
        s = body.support
        around = np.linalg.norm(s.points - centre, axis=1) + s.disc_radii
        row[w.BALL] = min(row[w.BALL], around.max() + s.radius + s.semi_axes.max())
        points.append(np.vstack([s.points.T, s.disc_radii]))
        count += len(s.points)
        row[w.LAST], row[w.DISCS], row[w.RADIUS], row[w.CONVEX] = count, s.disc_radii.any(), s.radius, 1.0
        row[w.SEMI : w.SEMI + 3] = s.semi_axes
    return rows, np.ascontiguousarray(np.hstack(points))


def _moved_by(joints: Array) -> list[tuple[int, ...]]:
    """For each joint, the joints with an influence that carry what hangs on it; the last entry is the root's: none."""
    carried: list[tuple[int, ...]] = []
    for k, row in enumerate(joints):
        parent = int(row[w.PARENT])
        above = carried[parent] if parent >= 0 else ()
        carried.append((*above, k) if row[w.MULTIPLIER] != 0.0 else above)
    return [*carried, ()]


def _tree(rows: Array, at: Array, robot: int) -> Array:
    """Boxes around the boxes of the obstacles, halved along the longest side."""
    rotation = at[robot:, :9].reshape(-1, 3, 3)
    with np.errstate(invalid="ignore"):
        reach = np.einsum("bij,bj->bi", np.abs(rotation), rows[robot:, w.HALF : w.HALF + 3])
    reach = np.where(np.isnan(reach), np.inf, reach)  # 0 times a side without end
    low, high = at[robot:, w.MIDDLE :] - reach, at[robot:, w.MIDDLE :] + reach
    tree: list[list[float]] = []

    def add(members: Indices) -> None:
        row = [*low[members].min(axis=0), *high[members].max(axis=0), 0.0, -1.0]
        tree.append(row)
        if len(members) == 1:
            row[w.LEAF] = float(robot + members[0])
        else:
            centre = at[robot + members, w.MIDDLE :]
            order = members[np.argsort(centre[:, int(np.ptp(centre, axis=0).argmax())], kind="stable")]
            add(order[: len(order) // 2])
            add(order[len(order) // 2 :])
        row[w.SKIP] = float(len(tree))

    if len(low):
        add(np.arange(len(low)))
    return np.array(tree).reshape(-1, w.TREE_COLUMNS)
