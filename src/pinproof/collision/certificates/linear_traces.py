"""The joint values of an arm whose tcp moves on a straight line, with proven bounds.

The poses of the line are solved at samples. In between, the joint values are bounded as follows. Let J be the Jacobian
with lengths divided by ``UNIT``, beta the norm of its inverse, and L a bound of the change of J for a unit change of
the joint values. If the pose moves by the distance e with a constant twist t of unit length, the joint values follow
with q' = J^-1 t, so |q'| <= beta, and 1 / beta decreases by at most L |q'|. Therefore they move by at most
(1 / beta - sqrt(1 / beta^2 - 2 L e)) / L, if the root exists. Let d be the distance of the joint values at two
successive samples. On their chord 1 / beta is at least the lesser of both values less L d / 2. The velocity and the
angular velocity of the tcp on the chord change by at most L d^2, so that its pose there differs from that on the line
by at most L d^2 / 8 in place, and less than L d^2 / 4 in rotation: half of that from a rotation at the middle angular
velocity, and half because this one differs from that of the line, which ends at the same poses. From the chord to the
line, and to other interpolations of the orientation, the joint values then move as above; this solution is continuous,
and the samples are on it.

Prismatic joints before the last six, such as a rail, move in proportion to the line, as manuals document for external
axes. Then the tcp also moves on a straight line in the axes behind these joints, for which the same bounds hold.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.spatial import Array

UNIT = 0.2
"""Metres that count as much as one radian, about the size of a wrist."""

CHORD = 2e-4
"""rad: largest deviation of the joint values from the chords between samples."""

FEWEST, MOST = 8, 8192
"""Numbers of samples of a line."""

SOLVED = 1e-11
"""rad, and metres over ``UNIT``: error of a pose at which it is solved."""

SINGULAR = 1e-6
"""Ratio of the smallest to the largest singular value of the Jacobian below which the arm is singular."""

ATTEMPTS = 10
"""Newton steps for a pose."""

POSE_ON_CHORD = 0.3
"""Distance of the pose on a chord from that on the line, in L d^2: sqrt(1 / 64 + 1 / 16), and more."""

ROUNDED = 1e-9
"""rad: allowance for the errors of the poses at the samples."""

TURN_STEP = 1e-3
"""rad: sum of the rotations between two steps at which the documented interpolations of orientations are compared."""

TURN_ALLOWANCE = 1.25
"""Factor of the largest difference between the documented interpolations that is covered."""

CELLS, FIRST_CELL = 512, 0.5
"""Number of cells of two superposed moves above which a singularity is not excluded, and the size of the first ones."""


class LineTrace(NamedTuple):
    """The joint values along a line, and how far (rad) each joint may be off them; the reason if that is not known."""

    path: JointPath
    tolerance: float
    reason: str = ""


def trace_line(arm: Arm, start: Array, target: pin.SE3, external: Array | None = None) -> LineTrace:
    """Return the joint values of an arm whose tcp moves on a straight line from ``start`` to a pose.

    The last six joints, which must be revolute, follow the line; the joints before them, such as a rail, move in
    proportion to it to their values ``external`` (n - 6,) at the end, if they are prismatic, or rest.
    """
    first = arm.forward_kinematics(start)
    shift, turn = target.translation - first.translation, pin.log3(first.rotation.T @ target.rotation)
    nothing = JointPath(start[None], arm.joint_names)
    if arm.dof < 6 or not arm.angular[-6:].all() or arm.chain.has_mimic_joints:
        what = "only arms whose last six joints are revolute, without mimic joints between base and tcp, are supported"
        return LineTrace(nothing, 0.0, what)
    # In the axes behind the prismatic joints the tcp moves by the rest of the line
    travel = np.zeros(arm.dof)
    travel[:-6] = 0.0 if external is None else external - start[:-6]
    moved = arm.forward_kinematics(start + travel)
    if (
        np.abs(travel[arm.angular]).max() > ROUNDED
        or np.abs(pin.log3(first.rotation.T @ moved.rotation)).max() > ROUNDED
    ):
        return LineTrace(nothing, 0.0, "it rotates an external axis, which only joint moves may do")
    carried = moved.translation - first.translation
    length, angle = float(np.linalg.norm(shift - carried)) / UNIT, float(np.linalg.norm(turn))
    whole, between = float(np.hypot(length, angle)), interpolation_difference(turn)
    change = np.sqrt(6.0 * (1.0 + (levers(arm)[-6:] / UNIT) ** 2).sum())
    scale, known = np.array([1.0 / UNIT] * 3 + [1.0] * 3), list[Array]()
    count = max(FEWEST, int(whole / 0.04) + 1)
    while count <= MOST:
        shares = np.linspace(0.0, 1.0, count + 1)
        poses = [
            pin.SE3(first.rotation @ pin.exp3(s * turn), first.translation + s * (shift - carried)) for s in shares
        ]
        # One after the other, or between those of fewer samples
        near = None
        for rows in known[-1:]:
            grid = np.linspace(0.0, 1.0, len(rows))
            guess = np.stack([np.interp(shares, grid, column) for column in rows.T], axis=1)
            near = solve_near(arm, guess, np.array([pose.homogeneous for pose in poses]))
        q, reason = solve_poses(arm, start, poses) if near is None else (near, "")
        # The smallest singular values bound the inverse of the Jacobian; from a singular pose the next is not solved
        values = np.linalg.svd(scale[:, None] * arm.jacobian_batch(q)[:, :, -6:], compute_uv=False)
        if (values[:, -1] < SINGULAR * values[:, 0]).any():
            return LineTrace(nothing, 0.0, "the arm is singular on it")
        if reason:
            return LineTrace(nothing, 0.0, reason)
        inverse = 1.0 / values[:, -1]
        known.append(q)
        steps, norms = np.linalg.norm(np.diff(q, axis=0), axis=1), np.maximum(inverse[1:], inverse[:-1])
        chord, tube = _bounds(steps, norms, change, between)
        if chord <= CHORD and np.isfinite(tube):
            return LineTrace(JointPath(q + shares[:, None] * travel, arm.joint_names), tube + ROUNDED)
        if chord <= CHORD:
            how = (
                f"it rotates the tool by {angle:.2g} rad, and interpolations of the orientation differ by {between:.2g}"
            )
            return LineTrace(nothing, 0.0, how)
        # As many steps as the bounds need, if norms and speeds do not exceed those at the samples by much
        needed = steps * np.maximum(2.0 * change * norms, np.sqrt(change * norms / (2.0 * CHORD)))
        count = max(2 * count, int(1.2 * count * needed.max()))
    return LineTrace(nothing, 0.0, "the arm is near a singularity on it")


def interpolation_difference(turn: Array) -> float:
    """Return a bound (rad) of the difference between the documented interpolations of an orientation, and more.

    The rotation ``turn`` (3,) is executed about one axis at a constant rate, or with two angles: an axis of the tool
    moves on a great circle while the tool rotates about it, both at a constant rate. Any axis of the tool may be that
    one. Between two samples the difference changes by at most the rates of all these rotations.
    """
    largest, whole = 0.0, pin.exp3(turn)
    for axis in np.eye(3) if turn.any() else ():
        swing, cosine = np.cross(axis, whole @ axis), float(axis @ whole @ axis)
        sine = float(np.linalg.norm(swing))
        if sine < SOLVED and cosine < 0.0:  # any great circle leads there
            return float(np.pi)
        swing *= np.arctan2(sine, cosine) / max(sine, SOLVED)
        spin = axis * float(axis @ pin.log3(pin.exp3(swing).T @ whole))
        rates = float(sum(np.linalg.norm(rotation) for rotation in (turn, swing, spin)))
        count = int(rates / TURN_STEP) + 1
        for share in np.linspace(0.0, 1.0, count + 1):
            apart = pin.log3(pin.exp3(share * turn).T @ pin.exp3(share * swing) @ pin.exp3(share * spin))
            largest = max(largest, float(np.linalg.norm(apart)) + rates / (2 * count))
    return min(TURN_ALLOWANCE * largest, float(np.pi))


@lru_cache(maxsize=16)
def levers(arm: Arm) -> Array:
    """(n,) motion of the tcp for a unit of each joint: at most this, in m/rad, or 1 for a prismatic joint."""
    model, tcp = arm.model, arm.model.frames[arm.tcp_id]
    joints = [joint for joint in model.supports[tcp.parentJoint] if joint != 0]
    most = np.maximum(np.abs(arm.limits.lower), np.abs(arm.limits.upper))
    most = (np.abs(arm.scale) * np.where(arm.scale == 0.0, 0.0, most)).sum(axis=1) + np.abs(arm.offset)
    travels = {  # of prismatic joints, which move the tcp away from the axes before them
        joint: most[joint - 1] for joint in joints if model.joints[joint].shortname().startswith("JointModelP")
    }
    between = [np.linalg.norm(model.jointPlacements[joint].translation) for joint in joints]
    offsets = [gap + travels.get(joint, 0.0) for joint, gap in zip(joints[1:], between[1:], strict=True)]
    offsets.append(np.linalg.norm(tcp.placement.translation))
    each = {joint: 1.0 if joint in travels else sum(offsets[k:]) for k, joint in enumerate(joints)}
    return np.abs(arm.scale).T @ [each.get(row + 1, 0.0) for row in range(len(arm.scale))]


def solve_poses(arm: Arm, start: Array, poses: list[pin.SE3]) -> tuple[Array, str]:
    """The joint values (k, n) at poses, each solved from the previous one, and why not all could be."""
    rows, q = list[Array](), start
    for pose in poses:
        solved = solve_near(arm, q[None], pose.homogeneous[None])
        if solved is None:
            return np.array(rows).reshape(-1, len(start)), "the arm cannot follow it"
        q = solved[0]
        rows.append(q)
    return np.array(rows), ""


def solve_near(arm: Arm, q: Array, poses: Array) -> Array | None:
    """The joint values (k, n) at poses (k, 4, 4), each solved from a row of q (k, n) near it; None if one is not."""
    scale, q = np.array([1.0 / UNIT] * 3 + [1.0] * 3), q.copy()
    for _ in range(ATTEMPTS):  # Newton's method, with the sine of the rotation that is left
        here, error = arm.forward_kinematics_batch(q), np.empty((len(q), 6))
        left = poses[:, :3, :3] @ here[:, :3, :3].swapaxes(1, 2)
        error[:, :3] = poses[:, :3, 3] - here[:, :3, 3]
        error[:, 3:] = 0.5 * (left[:, [2, 0, 1], [1, 2, 0]] - left[:, [1, 2, 0], [2, 0, 1]])
        if max(np.abs(scale * error).max(), np.abs(left - np.eye(3)).max()) <= SOLVED:
            return q
        try:
            q[:, -6:] += np.linalg.solve(arm.jacobian_batch(q)[:, :, -6:], error[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            break
    return None


def superposed_regular(arm: Arm, point: Array, one: Array, other: Array) -> bool:
    """Return whether no superposition of two moves is proven to be singular, for the last six joints of an arm.

    The configurations are ``point`` (n,) plus a change of ``one`` (k, n) and one of ``other`` (m, n), whose rows are at
    equal shares of moves from 0, for shares that add up to at most 1. Let w_k bound the change of J for a unit change
    of joint k: all columns up to k change by at most its lever, and those behind it are rotated. In a cell of both
    moves, with the middle c, J is regular if its smallest singular value at c exceeds the sum of w_k |q_k - c_k|;
    other cells are divided. The first joint rotates J, and J at a point on the last axis does not depend on the last
    joint, so that neither decides whether J is singular.
    """
    scale, lever = np.array([1.0 / UNIT] * 3 + [1.0] * 3), levers(arm)[-6:] / UNIT
    behind = np.array([(1.0 + lever[k + 1 :] ** 2).sum() for k in range(6)])
    weights = np.sqrt(np.arange(1, 7) * lever**2 + behind)
    sides, lengths = list[Array](), list[Array]()
    for side in (one, other):
        changes = side[:, -6:] * [0.0, 1.0, 1.0, 1.0, 1.0, 0.0]
        sides.append(changes)
        lengths.append(np.append(0.0, np.cumsum(np.abs(np.diff(changes, axis=0)) @ weights)))
    # Lower ends and sizes of cells, in the weighted lengths of both moves
    counts = [min(int(own[-1] / FIRST_CELL) + 1, 16) for own in lengths]
    size = np.tile([own[-1] / count for own, count in zip(lengths, counts, strict=True)], (counts[0] * counts[1], 1))
    low = size * np.indices(counts).reshape(2, -1).T
    while len(low) <= CELLS:
        # Without those in which all shares add up to more than 1
        rows = [np.searchsorted(passed, at) - 1 for at, passed in zip(low.T, lengths, strict=True)]
        inside = sum(np.maximum(row, 0) / max(len(side) - 1, 1) for row, side in zip(rows, sides, strict=True)) < 1.0
        low, size = low[inside], size[inside]
        if not len(low):
            return True
        q, shares = np.tile(point, (len(low), 1)), np.zeros(len(low))
        for at, passed, changes in zip((low + size / 2.0).T, lengths, sides, strict=True):
            q[:, -6:] += np.stack([np.interp(at, passed, column) for column in changes.T], axis=1)
            shares += np.interp(at, passed, np.linspace(0.0, 1.0, len(passed)))
        jacobians = scale[:, None] * arm.jacobian_batch(q)[:, :, -6:]
        if len(set(np.sign(np.linalg.det(jacobians[shares <= 1.0])))) > 1:
            return False
        # Halves of the cells that are not proven
        values = np.linalg.svd(jacobians, compute_uv=False)
        left = values[:, -1] <= size.sum(axis=1) / 2.0 + SINGULAR * values[:, 0]
        low, size = low[left], size[left]
        half = 0.5 * size * np.eye(2)[size.argmax(axis=1)]
        low, size = np.concatenate([low, low + half]), np.concatenate([size - half, size - half])
    return False


def _bounds(steps: Array, norms: Array, change: float, turn: float) -> tuple[float, float]:
    """Bounds (rad) of the deviation from the chords of samples: on the line, and with ``turn`` of the orientation.

    Infinite if the samples are too far apart, or may be on different branches; see the top of this module.
    """
    least, apart = 1.0 / norms - change * steps / 2.0, change * steps**2 * POSE_ON_CHORD
    bounds = list[float]()
    for moved in (apart, apart + turn):
        left = least**2 - 2.0 * change * moved
        possible = (least > 0.0).all() and (left > 0.0).all()
        bounds.append(float(((least - np.sqrt(left)) / change).max()) if possible else np.inf)
    return bounds[0], bounds[1]
