"""Random tool paths and an independent dense check of the motions that follow them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np

import pinproof as pp
from pinproof.description import with_spin
from pinproof.ik import IkTask, prove_unreachable
from pinproof.tool_paths import COSTS, FollowPlan, Obstruction, ToolPath

TOLERANCES = (("position", "deviation"), ("orientation", "rotation_deviation"))
ARMS = ("ur5", "irb120", "crx10ia", "puma560", "panda")


@cache
def arm_of(name: str) -> pp.Arm:
    """An arm of the catalogue."""
    return pp.load_robot(name).arm()


def random_problem(name: str, rng: np.random.Generator):
    """A checker, a path and settings: curves and polygons with tilting tools, among boxes, of all kinds of freedom."""
    arm = arm_of(name)
    reach = float(np.linalg.norm(arm.forward_kinematics(arm.home).translation)) + 0.1
    while True:
        low, high = np.maximum(arm.limits.lower, -2.5), np.minimum(arm.limits.upper, 2.5)
        centre = arm.forward_kinematics(rng.uniform(low, high))
        if centre.translation[2] > 0.05:
            break
    size = rng.uniform(0.05, 0.35) * reach
    count = int(rng.integers(2, 30))
    a = np.linspace(0.0, rng.uniform(1.0, 2.0 * np.pi), count)
    shape = rng.integers(3)
    if shape == 0:  # an arc
        local = np.column_stack([np.cos(a), np.sin(a), 0.2 * np.sin(2.0 * a)]) * 0.5 * size
    elif shape == 1:  # a polygon
        local = rng.uniform(-0.5, 0.5, (int(rng.integers(2, 6)), 3)) * size
    else:  # a zigzag
        local = np.column_stack([np.linspace(0.0, 1.0, count), 0.2 * (np.arange(count) % 2), np.zeros(count)]) * size
    points = centre.translation + local @ centre.rotation.T
    tilt = rng.uniform(0.0, 0.5) * np.column_stack([np.sin(np.linspace(0, 3, len(points)))] * 3) * rng.normal(size=3)
    normals = -(centre.rotation[:, 2] + tilt)
    speed = None if rng.random() < 0.2 else rng.uniform(0.02, 0.3)
    if speed is not None and rng.random() < 0.3:
        speed = rng.uniform(0.02, 0.3, len(points) - 1)
    path = ToolPath.through(points, normals, speed=speed)
    boxes = []
    while len(boxes) < 6:
        place = rng.uniform(-1.0, 1.0, 3) * reach
        if np.linalg.norm(place[:2]) > 0.25 * reach and np.linalg.norm(points - place, axis=1).min() > 0.15 * reach:
            boxes.append(pp.Obstacle(f"box {len(boxes)}", pp.Box(*rng.uniform(0.05, 0.3, 3) * reach), pp.pose(place)))
    settings = {
        "free_rotation": [True, True, False, (-0.6, 0.9)][int(rng.integers(4))],
        "rotations": 12, "redundant": 12,
        "approach": float(rng.choice([0.0, 0.0, 0.03])),
        "deviation": float(rng.choice([1e-3, 3e-4, 3e-3])),
        "rotation_deviation": float(rng.choice([0.02, 0.1])),
        "lifts": int(rng.choice([0, 3])),
    }  # fmt: skip
    return pp.CollisionChecker(arm, pp.Scene(boxes)), path, settings


def off_the_path(path: ToolPath, poses: np.ndarray, near: float, *, freedom, first: float, last: float, parts: int):
    """(N, 2) the distance (m) and angle (rad) of poses (N, 4, 4) from the path between two of its poses.

    The distance is that of the nearest point; the angle is the least to a point of the path that is at most ``near``
    (m) away. With a free rotation, the angle is that of the tool axis.
    """
    distances, angles = np.full(len(poses), np.inf), np.full(len(poses), np.inf)
    for i in range(max(int(np.floor(first)), 0), min(int(np.ceil(last)), len(path) - 1)):
        a, b = path.poses[i], path.poses[i + 1]
        step = b[:3, 3] - a[:3, 3]
        length = float(np.linalg.norm(step))
        if length > 1e-8:
            centre = (poses[:, :3, 3] - a[:3, 3]) @ step / length**2
            low, high = (np.clip(centre + offset / length, 0.0, 1.0) for offset in (-near, near))
            shares = [np.clip(centre, 0.0, 1.0), *(low + (high - low) * part for part in np.linspace(0.0, 1.0, parts))]
        else:
            shares = [np.full(len(poses), share) for share in np.linspace(0.0, 1.0, 41)]
        # The first share is that of the nearest point; where it is not near, no other point of the line is
        rows, there = np.arange(len(poses)), poses
        for k, share in enumerate(shares):
            u = share[rows]
            distance = np.linalg.norm(there[:, :3, 3] - a[:3, 3] - u[:, None] * step, axis=1)
            if freedom is True:
                chord = np.linalg.norm(there[:, :3, 2] - rotated_axis(a[:3, 2], b[:3, 2], u), axis=1)
            elif freedom is False:
                chord = np.linalg.norm(there[:, :3, :3] - rotated(a[:3, :3], b[:3, :3], u), axis=(1, 2)) / np.sqrt(2.0)
            else:
                chord = np.linalg.norm(there[:, :3, 2] - rotated(a[:3, :3], b[:3, :3], u)[:, :, 2], axis=1)
            angle = 2.0 * np.arcsin(np.clip(0.5 * chord, 0, 1))
            distances[rows] = np.minimum(distances[rows], distance)
            angles[rows] = np.where(distance <= near + 1e-9, np.minimum(angles[rows], angle), angles[rows])
            if k == 0:
                rows = rows[distance <= near + 1e-7]
                there = poses[rows]
    return np.column_stack([distances, angles])


def rotated(a, b, share):
    """(N, 3, 3) the rotations about one fixed axis from a to b at shares (N,), by Rodrigues' formula."""
    turn = a.T @ b
    angle = np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))
    if angle < 1e-9:
        return np.tile(a, (len(share), 1, 1))
    w = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (2.0 * np.sin(angle))
    k = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    part = (share * angle)[:, None, None]
    return a @ (np.eye(3) + np.sin(part) * k + (1.0 - np.cos(part)) * (k @ k))


def rotated_axis(a, b, share):
    """(N, 3) the axes on the great circle from a to b at shares (N,)."""
    angle = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    if angle < 1e-9:
        return np.tile(a, (len(share), 1))
    part = (share * angle)[:, None]
    return (np.sin(angle - part) * a + np.sin(part) * b) / np.sin(angle)


def wrong(plan: FollowPlan, settings: dict) -> list[str]:
    """What an independent dense check finds wrong with a plan that was found; empty if nothing."""
    checker, path, arm = plan.checker, plan.path, plan.checker.arm
    found = []
    if not pp.audit(plan.trajectory, checker, step=0.02, measure=False, exact=False).clean:
        found.append("collision")
    times = np.linspace(0.0, plan.duration, max(int(plan.duration / 1e-2), 300))
    q = plan.trajectory(times)
    if (q < arm.limits.lower - 1e-6).any() or (q > arm.limits.upper + 1e-6).any():
        found.append("limits")
    if (
        len(q) > 1
        and plan.duration
        and (np.abs(np.diff(q, axis=0)) / np.diff(times)[:, None] > arm.limits.velocity * 1.001).any()
    ):
        found.append("velocity")
    reached = np.full(len(path), np.inf)
    for piece in plan.pieces:
        if piece.trajectory is None:
            continue
        times = np.linspace(0.0, piece.trajectory.duration, max(int(piece.trajectory.duration / 8e-3), 300))
        poses = np.array([arm.forward_kinematics(x).homogeneous for x in piece.trajectory(times)])
        for parts in (3, 21, 801):  # finer comparisons only where a coarse one finds a deviation
            off = off_the_path(
                path, poses, piece.deviation, freedom=settings["free_rotation"], first=piece.first, last=piece.last,
                parts=parts,
            ).max(axis=0)  # fmt: skip
            if off[1] <= min(piece.rotation_deviation, settings["rotation_deviation"]):
                break
        if off[0] > min(piece.deviation, settings["deviation"]) + 1e-9:
            found.append(f"deviation {off[0]} above {piece.deviation}")
        if off[1] > min(piece.rotation_deviation, settings["rotation_deviation"]) + 1e-6:
            found.append(f"rotation {off[1]} above {piece.rotation_deviation}")
        for index in range(int(np.ceil(piece.first)), int(np.floor(piece.last)) + 1):
            missed = np.linalg.norm(poses[:, :3, 3] - path.poses[index, :3, 3], axis=1).min()
            reached[index] = min(reached[index], missed)
        if path.speed is not None and piece.trajectory.duration:
            speed = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1) / np.diff(times)
            if speed.max() > path.speed.max() * 1.001 + 1e-9:
                found.append(f"speed {speed.max()} above {path.speed.max()}")
            if speed.max() > piece.speed[1] * 1.001 + 1e-9:
                found.append(f"speed {speed.max()} above its bound {piece.speed[1]}")
    if plan.pieces[0].trajectory is not None and reached.max() > settings["deviation"] + 1e-3:
        found.append(f"a pose is missed by {reached.max()}")
    return found


# -- paths without a motion --------------------------------------------------------------------------------------------

FINER = {"rotations": 36, "redundant": 36}
"""The grid on which paths without a motion are followed again: three times as many values."""


def why_not(plan: FollowPlan, settings: dict) -> str:
    """Why a path has no motion: ``proven`` out of reach, ``finer`` if one exists on a finer grid, or what blocks there.

    The proof holds for all rotations of the tool and within the allowed deviations, by intervals of the joint values.
    """
    arm = plan.checker.arm
    if settings["free_rotation"] is not False:
        limits = dict(zip(arm.joint_names, zip(arm.limits.lower, arm.limits.upper, strict=True), strict=True))
        spun = replace(arm.robot, urdf=with_spin(arm.robot.urdf, "spin", arm.tcp))
        arm = spun.arm("spin", base=arm.base, limits=limits)
    far = [own for own in plan.blocked if own.obstruction in (Obstruction.OUT_OF_REACH, Obstruction.LIMIT)]
    for own in far[:4]:
        tolerances = {f"{key}_tolerance": 1.3 * settings[name] for key, name in TOLERANCES}
        if prove_unreachable(arm, own.place, **tolerances, budget=2000, search=False).proven:
            return "proven"
    again = pp.follow(plan.checker, plan.path, **{**settings, **FINER})
    if again.ok:
        return "finer"
    return again.blocked[0].obstruction.name if again.blocked else again.status.name


# -- tries from random starts ------------------------------------------------------------------------------------------

TRIES, STEP, TURN, JUMP = 20, 0.01, 0.1, 0.5
"""The number of tries; the largest distance (m) and angle (rad) between their places; the largest step of a joint."""

MOTION, ARM_OF_AXIS = 5000, 0.1
"""Number of samples of a motion that is compared with the tries, and the metres that 1 rad of the tool axis counts."""

USUAL_SPEED, USUAL_ROTATION = 0.25, 1.0
"""m/s and rad/s: speeds of the tool for the effort along paths that state none."""

ONLY_TURNED = 5e-4, 100.0
"""The tool only rotates on lines of at most this length (m) that turn it by more than this (rad/m)."""


def best_of_tries(checker, path: ToolPath, settings: dict, plan: FollowPlan, rng: np.random.Generator):
    """Whether one of 20 tries from random starts follows the path, its least cost, and that of the plan along it.

    Each try begins at a solution for a random rotation of the tool, and solves the inverse kinematics numerically from
    place to place; its motion between them must be proven free of contact. It keeps to none of the bounds of the plan.
    """
    arm, free = checker.arm, settings["free_rotation"]
    if free is True:  # between two poses, the axis of the tool takes the shortest rotation
        path = replace(path, poses=least_turned(path.poses))
    # The places, with the lines of the approach and the departure
    at = [np.zeros(1)]
    for k, (a, b) in enumerate(zip(path.poses, path.poses[1:], strict=False)):
        turned = float(np.arccos(np.clip(0.5 * (np.trace(a[:3, :3].T @ b[:3, :3]) - 1.0), -1.0, 1.0)))
        parts = max(1, int(np.ceil(max(np.linalg.norm(b[:3, 3] - a[:3, 3]) / STEP, turned / TURN))))
        at.append(k + np.arange(1, parts + 1) / parts)
    where = np.concatenate(at)
    poses, line = path.at(where), settings["approach"]
    parts = int(np.ceil(line / STEP))
    lengths = np.linspace(line, 0.0, 1 + parts)[:-1]
    poses = np.concatenate([lifted(poses[0], lengths), poses, lifted(poses[-1], lengths[::-1])])
    on_lines = np.arange(1.0, parts + 1) / max(parts, 1)
    where = np.concatenate([on_lines - 1.0 - 1.0 / max(parts, 1), where, len(path) - 1 + on_lines])
    # The starts, at a random rotation of the tool
    low, high = (-np.pi, np.pi) if free is True else (0.0, 0.0) if free is False else free
    angles = rng.uniform(low, high, TRIES)
    cosine, sine = np.cos(angles), np.sin(angles)
    turns = np.tile(np.eye(4), (TRIES, 1, 1))
    turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1] = cosine, -sine, sine, cosine
    span = arm.limits.sampling_range()
    first = pp.Clik().solve_batch(arm, poses[0] @ turns, rng.uniform(*span, (TRIES, arm.dof)), rng=rng)
    alive, rows = first.ok & checker.is_free_batch(first.q), [first.q]
    task = IkTask(rz=False) if free is True else IkTask()
    for place in poses[1:]:
        found = pp.Clik(restarts=0).solve_batch(arm, place @ turns, rows[-1], task=task)
        alive &= found.ok & (np.abs(found.q - rows[-1]).max(axis=1) <= JUMP)
        if not alive.any():
            return False, None, None
        alive[alive] = checker.edges_free(rows[-1][alive], found.q[alive])
        rows.append(np.where(alive[:, None], found.q, rows[-1]))
    # The costs between these places, along the lines too
    rows = np.array(rows)[:, alive].swapaxes(0, 1)
    tried = min(cost(arm, path, free, where, poses, q) for q in rows) if alive.any() else None
    if tried is None or not plan.ok or len(plan.pieces) > 1:
        return bool(alive.any()), tried, None
    # The configurations after the same share of the length; where the motion rounds corners, its tool is not at these
    # poses, unlike that of the tries
    motion = plan.trajectory(np.linspace(0.0, plan.duration, MOTION))
    at, wanted = travelled(arm.forward_kinematics_batch(motion)), travelled(poses)
    own = np.column_stack([np.interp(wanted, at, column) for column in motion.T])
    task = IkTask() if free is False else IkTask(rz=False)
    own = pp.Clik(restarts=0).solve_batch(arm, poses, own, task=task).q
    return True, tried, cost(arm, path, free, where, poses, own)


def least_turned(poses: np.ndarray) -> np.ndarray:
    """(k, 4, 4) poses with the same tool axes, each with the smallest rotation from the one before."""
    turned = poses.copy()
    for before, after in pairwise(turned):
        a, b = before[:3, 2], after[:3, 2].copy()
        axis, cosine = np.cross(a, b), float(a @ b)
        cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
        if cosine > -0.999:  # opposite axes have no smallest rotation
            after[:3, :3] = (np.eye(3) + cross + cross @ cross / (1.0 + cosine)) @ before[:3, :3]
    return turned


def travelled(poses: np.ndarray) -> np.ndarray:
    """(k,) the share of the length travelled at each of the poses (k, 4, 4); the rotation of the axis adds length."""
    change = np.diff(poses, axis=0)
    length = np.linalg.norm(change[:, :3, 3], axis=1) + ARM_OF_AXIS * np.linalg.norm(change[:, :3, 2], axis=1)
    return np.append(0.0, np.cumsum(length)) / max(float(length.sum()), 1e-12)


def lifted(pose: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """(k, 4, 4) a pose moved back along its z axis by lengths (k,)."""
    poses = np.tile(pose, (len(lengths), 1, 1))
    poses[:, :3, 3] -= lengths[:, None] * pose[:3, 2]
    return poses


def cost(arm, path: ToolPath, free, where: np.ndarray, poses: np.ndarray, q: np.ndarray) -> float:
    """The cost ``balanced`` of configurations (k, n) at places (k,) and poses (k, 4, 4) of a path, from its formula."""
    own = COSTS["balanced"]
    columns, scale = (slice(2, 3), 1.0) if free is True else (slice(0, 3), np.sqrt(2.0))

    def moved(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        change = np.diff(poses, axis=0)
        turned = np.linalg.norm(change[:, :3, columns], axis=(1, 2)) / scale
        return np.linalg.norm(change[:, :3, 3], axis=1), turned

    length, turned = moved(poses)
    times, least = np.maximum(length / USUAL_SPEED, turned / USUAL_ROTATION), np.zeros(len(length))
    if path.speed is not None:
        middle = 0.5 * (where[1:] + where[:-1])
        index = np.clip(np.floor(middle).astype(int), 0, len(path.speed) - 1)
        lines, turns = moved(path.poses)
        # No speed is required where the tool only turns.
        timed = ((lines > ONLY_TURNED[0]) | (turns <= ONLY_TURNED[1] * lines))[index]
        timed |= (middle < 0.0) | (middle > len(path) - 1)
        times = np.where(timed, length / path.speed[index], times)
        least = np.where(timed, times, 0.0)
    shares = np.abs(np.diff(q, axis=0)) / arm.limits.velocity
    total = own.time * np.maximum(shares.max(axis=1), least) + own.travel * shares.sum(axis=1)
    return float((total + own.effort * (shares**2).sum(axis=1) / np.maximum(times, 1e-3)).sum())
