"""Calibrations of Universal Robots arms for tests: perturbed axes, their DH table, and the files of three formats."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

NOMINAL = {  # Universal Robots, "DH parameters for calculations of kinematics and dynamics": d1, a2, a3, d4, d5, d6
    "ur3": (0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    "ur5": (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "ur10": (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
}
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
JOINT_NAMES = tuple(f"{name}_joint" for name in JOINTS)
WIDE = np.longdouble


def published(robot: str) -> np.ndarray:
    """The table of the make (6, 4): theta, d, a, alpha."""
    d1, a2, a3, d4, d5, d6 = NOMINAL[robot]
    half = math.pi / 2
    d, a, alpha = (d1, 0, 0, d4, d5, d6), (0, a2, a3, 0, 0, 0), (half, 0, 0, half, -half, 0)
    return np.array([np.zeros(6), d, a, alpha]).T


def row(theta, d, a, alpha, dtype=WIDE) -> np.ndarray:
    """Rz(theta) Tz(d) Tx(a) Rx(alpha), with the widest floats of the machine."""
    theta, d, a, alpha = (dtype(x) for x in (theta, d, a, alpha))
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]], dtype=dtype
    )


def forward(table: np.ndarray, q) -> np.ndarray:
    """base_link from tool0: `base_link` of the ROS models is rotated by pi about z from the base of the make."""
    pose = np.diag(np.array([-1, -1, 1, 1], dtype=WIDE))
    for (theta, d, a, alpha), angle in zip(table, q, strict=True):
        pose = pose @ row(WIDE(theta) + WIDE(angle), d, a, alpha)
    return pose.astype(float)


def perturbed(robot: str, seed: int) -> np.ndarray:
    """The table of an arm whose axes are moved by about a millimetre and some milliradians, as a factory measures it.

    The axes 2, 3 and 4 are then no longer parallel, and their common normals tens or hundreds of metres away.
    """
    rng = np.random.default_rng(seed)
    frames = [np.eye(4)]
    for each in published(robot):
        frames.append(frames[-1] @ row(*each, dtype=float))
    # the axis of joint 1 and the flange stay; the z axis of frame i is the axis of joint i + 1
    points, axes = [frame[:3, 3].copy() for frame in frames], [frame[:3, 2].copy() for frame in frames]
    for i in range(1, 6):
        points[i] += rng.normal(size=3) * 5e-4
        axes[i] += rng.normal(size=3) * (2e-3 if i != 2 else 5e-4)
        axes[i] /= np.linalg.norm(axes[i])
    points[6], axes[6] = points[6] + 5e-4 * axes[5], axes[5]  # row 6 has neither a nor alpha
    table, x, origin = [], np.array([1.0, 0.0, 0.0]), points[0]
    for i in range(6):
        z, w = axes[i], axes[i + 1]
        normal = np.cross(z, w)
        sine = np.linalg.norm(normal)
        if i == 5:
            foot, next_x = origin, x
            theta, d, a, alpha = 1e-5, float((points[6] - origin) @ z), 0.0, 0.0
            table.append((theta, d, a, alpha))
            break
        normal /= sine
        normal *= np.sign(normal @ frames[i + 1][:3, 0]) or 1.0
        apart = points[i + 1] - points[i]
        t = np.cross(apart, w) @ np.cross(z, w) / sine**2
        s = np.cross(apart, z) @ np.cross(z, w) / sine**2
        foot, next_origin, next_x = points[i] + t * z, points[i + 1] + s * w, normal
        theta = math.atan2(np.cross(x, next_x) @ z, x @ next_x)
        table.append(
            (theta, (foot - origin) @ z, (next_origin - foot) @ next_x, math.atan2(np.cross(z, w) @ next_x, z @ w))
        )
        x, origin = next_x, next_origin
    return np.array(table)


def conf_text(robot: str, table: np.ndarray) -> str:
    """The calibration.conf of a controller."""
    deltas = table - published(robot)
    names = ("delta_theta", "delta_d", "delta_a", "delta_alpha")
    lines = [f"{name} = [ {', '.join(repr(float(x)) for x in deltas[:, k])}]" for k, name in enumerate(names)]
    lines += [
        "joint_checksum = [ 0x6e0f7bf, 0xa32a713f, 0xf636a50, 0x9ec2338a, 0xa1afded8, 0xb29b2979]",
        "calibration_status = 2 # 0 == notInitialized / 1 == notLinearised / 2 == Linearised",
    ]
    return "[mounting]\n" + "\n".join(lines) + "\n"


def csv_text(robot: str, table: np.ndarray) -> str:
    """The differences from the table of the make."""
    rows = [
        f"{name},{','.join(repr(float(x)) for x in delta)}"
        for name, delta in zip(JOINT_NAMES, table - published(robot), strict=True)
    ]
    return "# like: ur\nname,delta_theta,delta_d,delta_a,delta_alpha\n" + "\n".join(rows) + "\n"


def kinematics_text(table: np.ndarray) -> str:
    """The origins of the joints as the ROS driver writes them: upper arm and forearm in the plane of the joint before.

    Frame i of the file is behind Rz(theta_i) Tz(d_i) of row i. A shift along the axis commutes with the joint.
    """

    def parts(theta, d, a, alpha):
        return row(theta, d, 0, 0), row(0, 0, a, alpha)

    steps, behind = [], np.eye(4, dtype=WIDE)
    for each in table:
        ahead, passive = parts(*each)
        steps.append(behind @ ahead)
        behind = passive
    shift = WIDE(0)
    for i in (1, 2):
        steps[i] = lifted(-shift) @ steps[i]
        shift = -steps[i][2, 3] / steps[i][2, 2]  # to the plane z = 0
        steps[i] = steps[i] @ lifted(shift)
    steps[3] = lifted(-shift) @ steps[3]
    lines = ["kinematics:"]
    for link, pose in zip(LINKS, steps, strict=True):
        # Rx(roll) Ry(pitch) Rz(yaw)
        roll = np.arctan2(-pose[1, 2], pose[2, 2])
        pitch = np.arcsin(pose[0, 2])
        yaw = np.arctan2(-pose[0, 1], pose[0, 0])
        values = (*pose[:3, 3], roll, pitch, yaw)
        keys = ("x", "y", "z", "roll", "pitch", "yaw")
        lines += [f"  {link}:", *(f"    {key}: {float(x)!r}" for key, x in zip(keys, values, strict=True))]
    return "\n".join([*lines, "  hash: calib_14698139022496758595", ""])


def lifted(height) -> np.ndarray:
    """Tz(height)."""
    pose = np.eye(4, dtype=WIDE)
    pose[2, 3] = height
    return pose


def write(folder: Path, robot: str, table: np.ndarray, kind: str) -> Path:
    """The file of a kind: ``conf``, ``yaml`` or ``csv``."""
    path = folder / f"calibration.{kind}"
    texts = {"conf": lambda: conf_text(robot, table), "yaml": lambda: kinematics_text(table)}
    path.write_text(texts.get(kind, lambda: csv_text(robot, table))())
    return path
