"""A checker as plain arrays, for compiled loops (:class:`pinproof.kernels.world.World`)."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.bodies import Body, Support, boxes
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
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    outside = second >= robot
    table = np.zeros((len(pairs), w.PAIR_COLUMNS))
    table[:, w.A], table[:, w.B], table[:, w.OUTSIDE] = first, second, outside
    moved = _moved_by(joints)[rows[:, w.JOINT].astype(int)]
    between = (moved[first] != moved[second]).sum(axis=1)  # the last row, of joint -1, is the root's
    outer = np.full((robot, len(bodies) - robot), -1, dtype=np.int64)
    around = np.flatnonzero(outside & (between > 0))
    outer[first[around], second[around] - robot] = around
    own = ~outside & (between > 0)
    at = np.zeros((len(bodies), w.PLACEMENT_COLUMNS))
    fixed = rows[:, w.JOINT] < 0
    at[fixed, :12] = rows[fixed, w.PLACE : w.PLACE + 12]
    turned = np.einsum("bij,bj->bi", at[:, :9].reshape(-1, 3, 3), rows[:, w.CENTRE : w.CENTRE + 3])
    at[:, w.MIDDLE :] = at[:, 9:12] + turned
    tree = _tree(rows, at, robot)
    inwards = np.unique(first[around])[::-1]
    widest = np.array([0.0, rounding])
    world = w.World(joints, rows, vertices, table, np.flatnonzero(own), inwards, outer, tree, widest)
    _begin(world, at, np.flatnonzero(own & (between == 1)), arm.dof)
    return world, at, np.flatnonzero(between == 0)


def with_margins(world: w.World, margins: Array) -> w.World:
    """The same arrays under other margins (P,)."""
    pairs = world.pairs.copy()
    pairs[:, w.MARGIN] = margins
    outside = margins[pairs[:, w.OUTSIDE] == 1.0]
    return world._replace(pairs=pairs, widest=np.array([outside.max(initial=0.0), world.widest[1]]))


def _begin(world: w.World, at: Array, pairs: Indices, n: int) -> None:
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
    model = arm.model
    data = model.createData()
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
    rows, model = np.zeros((len(bodies), w.BODY_COLUMNS)), arm.model
    parts = [Support(np.empty((0, 3))) if body.support is None else body.support for body in bodies]
    points = np.concatenate([np.empty((0, 3)), *(part.points for part in parts)])
    discs = np.concatenate([np.empty(0), *(part.disc_radii for part in parts)])
    counts = np.array([len(part.points) for part in parts], dtype=np.int64)
    for row, body, part in zip(rows, bodies, parts, strict=True):
        joint, place = -1, body.link_from_body
        if body.link is not None:
            frame = model.frames[model.getFrameId(body.link, pin.FrameType.BODY)]
            joint, place = int(frame.parentJoint) - 1, frame.placement * place
        if joint >= 0:
            place = aligned[joint].inverse() * place
        row[w.JOINT] = joint
        row[w.PLACE : w.PLACE + 9], row[w.PLACE + 9 : w.PLACE + 12] = place.rotation.ravel(), place.translation
        row[w.RADIUS], row[w.SEMI : w.SEMI + 3] = part.radius, part.semi_axes
        if body.support is not None:
            row[w.CONVEX] = 1.0
        elif isinstance(body.geometry, coal.Halfspace):
            row[w.CONVEX] = w.HALF_SPACE
    centres, halves = boxes(bodies)
    endless = ~(np.isfinite(centres) & np.isfinite(halves)).all(axis=1)  # never settled by its box
    centres[endless], halves[endless] = 0.0, np.inf
    rows[:, w.CENTRE : w.CENTRE + 3], rows[:, w.HALF : w.HALF + 3] = centres, halves
    rows[:, w.LAST] = np.cumsum(counts)
    rows[:, w.FIRST] = rows[:, w.LAST] - counts
    rows[:, w.BALL] = np.linalg.norm(halves, axis=1)
    some = np.flatnonzero(counts)
    if len(some):
        starts = rows[some, w.FIRST].astype(np.int64)
        reach = np.linalg.norm(points - np.repeat(centres, counts, axis=0), axis=1) + discs
        grown = rows[some, w.RADIUS] + rows[some, w.SEMI : w.SEMI + 3].max(axis=1)
        rows[some, w.BALL] = np.minimum(rows[some, w.BALL], np.maximum.reduceat(reach, starts) + grown)
        rows[some, w.DISCS] = np.logical_or.reduceat(discs != 0.0, starts)
    return rows, np.ascontiguousarray(np.column_stack([points, discs]).T)


def _moved_by(joints: Array) -> npt.NDArray[np.bool_]:
    """(m + 1, m) for each joint, which joints with an influence carry what hangs on it; the last row is the root's."""
    carried = np.zeros((len(joints) + 1, len(joints)), dtype=bool)
    for k, row in enumerate(joints):
        carried[k] = carried[int(row[w.PARENT])]  # parents come first; -1 is the root
        carried[k, k] = row[w.MULTIPLIER] != 0.0
    return carried


def _tree(rows: Array, at: Array, robot: int) -> Array:
    """Boxes around the boxes of the obstacles, halved along the longest side, level by level.

    A box around n obstacles and all within it fill 2 n - 1 rows, so it is known where each goes.
    """
    rotation = at[robot:, :9].reshape(-1, 3, 3)
    with np.errstate(invalid="ignore"):
        reach = np.einsum("bij,bj->bi", np.abs(rotation), rows[robot:, w.HALF : w.HALF + 3])
    reach = np.where(np.isnan(reach), np.inf, reach)  # 0 times a side without end
    centre = at[robot:, w.MIDDLE :]
    low, high = centre - reach, centre + reach
    tree = np.zeros((max(2 * len(low) - 1, 0), w.TREE_COLUMNS))
    members, counts, here = np.arange(len(low)), np.array([len(low)]), np.array([0])
    while len(members):
        starts, group = np.cumsum(counts) - counts, np.repeat(np.arange(len(counts)), counts)
        tree[here, w.LOW : w.LOW + 3] = np.minimum.reduceat(low[members], starts)
        tree[here, w.HIGH : w.HIGH + 3] = np.maximum.reduceat(high[members], starts)
        tree[here, w.SKIP] = here + 2 * counts - 1
        tree[here, w.LEAF] = np.where(counts == 1, robot + members[starts], -1)
        middles = centre[members]
        widths = np.maximum.reduceat(middles, starts) - np.minimum.reduceat(middles, starts)
        along = middles[np.arange(len(members)), widths.argmax(axis=1)[group]]
        members = members[np.lexsort((along, group))][counts[group] > 1]
        parted = counts > 1
        counts, here = counts[parted], here[parted]
        half = counts // 2
        here = np.stack([here + 1, here + 2 * half], axis=1).ravel()
        counts = np.stack([half, counts - half], axis=1).ravel()
    return tree
