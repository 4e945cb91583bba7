"""Verification that a URDF and a DH table are equal, by comparing the forward kinematics of both."""

from __future__ import annotations

import numpy as np

from pinproof.description import TCP, DhTable, Srdf, read_urdf_text
from pinproof.errors import ConversionError, PinproofError
from pinproof.model.robot import Arm, Robot
from pinproof.spatial import Array

FK_TOLERANCE = 1e-12
"""Largest difference of a frame, in metres and radians: several thousand rounding errors at a reach of one metre, and
far less than the effect of a wrong digit, sign or order."""
RECOVERY_TOLERANCE = 1e-9
"""Largest difference at the tool, in metres and radians, of a table recovered from a URDF. It is larger than
:data:`FK_TOLERANCE`, because nearly parallel axes give large offsets d (rounded to 1e-11 m) or are treated as parallel;
for other arms differences of 1e-14 are usual."""
CONFIGURATIONS = 16
"""Number of random configurations compared, in addition to zero. Forward kinematics is a polynomial in q and its sines
and cosines, so two different tables differ at almost every q; several configurations exclude agreement by chance."""


def prove_urdf_equals_table(table: DhTable, urdf: str) -> None:
    """Compare a URDF with its table at dh_0 ... dh_n and the tool, through Pinocchio, at zero and random q.

    Joint names, their order, limits and velocities are compared as well. Configurations are drawn from a fixed seed:
    (-pi, pi) for angles, the limits for prismatic rows.

    Raises
    ------
    ConversionError
        If a frame or a joint differs (the message states which, and by how much), or if Pinocchio rejects the URDF.
    """
    try:
        arm = Robot(read_urdf_text(urdf, name=f"URDF of {table.name}"), Srdf()).arm(TCP)
        torque = None if arm.limits.torque is None else arm.limits.torque.tolist()
        for what, expected, actual in (
            ("joint names", list(table.joint_names), list(arm.joint_names)),
            ("lower limits", table.lower.tolist(), arm.limits.lower.tolist()),
            ("upper limits", table.upper.tolist(), arm.limits.upper.tolist()),
            ("velocity limits", table.velocity.tolist(), arm.limits.velocity.tolist()),
            ("effort limits", table.effort.tolist(), torque),
        ):
            if expected != actual:
                made = f"the URDF made from DH table {table.name!r}"
                raise ConversionError(f"{made} has the {what} {actual}, not {expected}")
        for q in _configurations(table):
            for i, expected_frame in enumerate(table.frames(q)):
                _compare(table, f"dh_{i}", expected_frame, arm.frame_placement(q, f"dh_{i}").homogeneous, q)
            _compare(table, arm.tcp, table.forward_kinematics(q), arm.forward_kinematics(q).homogeneous, q)
    except ConversionError:
        raise
    except PinproofError as error:  # the URDF is rejected or a frame is missing
        raise ConversionError(f"the URDF made from DH table {table.name!r} is not usable: {error}") from error


def prove_table_equals_arm(table: DhTable, arm: Arm) -> None:
    """Compare a table recovered from an arm with that arm at the tcp, at zero and random configurations.

    Raises
    ------
    ConversionError
        If they differ; the message states the configuration and the difference.
    """
    for q in _configurations(table):
        position, angle = _difference(table.forward_kinematics(q), arm.forward_kinematics(q).homogeneous)
        if not (position <= RECOVERY_TOLERANCE and angle <= RECOVERY_TOLERANCE):
            raise ConversionError(
                f"the DH table made from {arm} does not equal it: the tcp is off by {position:.3g} m and {angle:.3g} "
                f"rad (allowed: {RECOVERY_TOLERANCE:g}) at q = {q.tolist()}"
            )


def _configurations(table: DhTable) -> Array:
    """Zero and random q (1 + CONFIGURATIONS, n): (-pi, pi) for angles, the limits for prismatic rows."""
    prismatic = np.array([row.is_prismatic for row in table.rows])
    low = np.where(prismatic, table.lower, -np.pi)
    high = np.where(prismatic, table.upper, np.pi)
    random = np.random.default_rng(0).uniform(low, high, (CONFIGURATIONS, len(table)))
    return np.vstack([np.zeros(len(table)), random])


def _compare(table: DhTable, frame: str, expected: Array, actual: Array, q: Array) -> None:
    position, angle = _difference(expected, actual)
    if not (position <= FK_TOLERANCE and angle <= FK_TOLERANCE):  # also raises for NaN
        raise ConversionError(
            f"the URDF made from DH table {table.name!r} does not equal it: frame {frame} is off by {position:.3g} m "
            f"and {angle:.3g} rad (allowed: {FK_TOLERANCE:g}) at q = {q.tolist()}; nothing was written"
        )


def _difference(expected: Array, actual: Array) -> tuple[float, float]:
    """The distance (m) and the angle (rad) between two transforms (4, 4)."""
    # |R1 - R2| / sqrt(2) equals the angle up to third order; arccos would lose half of the digits.
    angle = float(np.linalg.norm(expected[:3, :3] - actual[:3, :3])) / np.sqrt(2)
    return float(np.linalg.norm(expected[:3, 3] - actual[:3, 3])), angle
