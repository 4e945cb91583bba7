"""Verification of conversions between URDF and DH table by comparing the forward kinematics of both."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.description.dh import DhTable
from pinproof.errors import ConversionError, PinproofError
from pinproof.model import Arm, load_robot_from_text

__all__ = [
    "CONFIGURATIONS",
    "FK_TOLERANCE",
    "RECOVERY_TOLERANCE",
    "prove_table_equals_arm",
    "prove_urdf_equals_table",
]

Array = npt.NDArray[np.float64]

FK_TOLERANCE = 1e-12
"""Metres and radians by which a frame may differ: some thousand roundings of a reach of a metre, and far below any
wrong digit, sign or order."""
RECOVERY_TOLERANCE = 1e-9
"""Metres and radians by which a table recovered from a URDF may differ at the tool. Wider than :data:`FK_TOLERANCE`,
since nearly parallel axes make long rows (rounded at 1e-11 m) or are taken as parallel; elsewhere 1e-14 is usual."""
CONFIGURATIONS = 16
"""Random configurations compared, besides zero. Both sides are products of sines and cosines of q, so two tables that
differ at all differ at almost every q; more than one only guards against chance."""


def prove_urdf_equals_table(table: DhTable, urdf: str, *, tcp: str) -> None:
    """Compare a URDF with its table at dh_0 ... dh_n and the tool, through Pinocchio, at zero and random q.

    Joint names, their order, limits and velocities are compared as well. Configurations are drawn from a fixed seed:
    the whole turn for angles, the stroke for prismatic rows.

    Raises
    ------
    ConversionError
        Naming the frame, the configuration and the difference, or that Pinocchio does not take the URDF at all.
    """
    try:
        _compare_all(table, load_robot_from_text(urdf, name=f"URDF of {table.name}").arm(tcp=tcp))
    except ConversionError:
        raise
    except PinproofError as error:  # not read, or a frame that is not there
        raise ConversionError(f"the URDF made from DH table {table.name!r} is not usable: {error}") from error


def prove_table_equals_arm(table: DhTable, arm: Arm) -> None:
    """Compare a table recovered from an arm with that arm at the tcp, at zero and random configurations.

    Raises
    ------
    ConversionError
        Naming the configuration and the difference.
    """
    for q in _configurations(table):
        position, angle = _difference(table.forward_kinematics(q), arm.forward_kinematics(q).homogeneous)
        if not (position <= RECOVERY_TOLERANCE and angle <= RECOVERY_TOLERANCE):
            raise ConversionError(
                f"the DH table made from {arm} does not equal it: the tcp is off by {position:.3g} m and {angle:.3g} "
                f"rad (allowed: {RECOVERY_TOLERANCE:g}) at q = {q.tolist()}"
            )


def _compare_all(table: DhTable, arm: Arm) -> None:
    _compare_joints(table, arm)
    for q in _configurations(table):
        for i, expected in enumerate(table.frames(q)):
            _compare(table, f"dh_{i}", expected, arm.frame_placement(q, f"dh_{i}").homogeneous, q)
        _compare(table, arm.tcp, table.forward_kinematics(q), arm.forward_kinematics(q).homogeneous, q)


def _configurations(table: DhTable) -> Array:
    """Zero and random q (1 + CONFIGURATIONS, n): the whole turn for angles, the stroke for prismatic rows."""
    prismatic = np.array([row.is_prismatic for row in table.rows])
    low = np.where(prismatic, table.lower, -np.pi)
    high = np.where(prismatic, table.upper, np.pi)
    random = np.random.default_rng(0).uniform(low, high, (CONFIGURATIONS, len(table)))
    return np.vstack([np.zeros(len(table)), random])


def _compare_joints(table: DhTable, arm: Arm) -> None:
    pairs = {
        "joint names": (list(table.joint_names), list(arm.joint_names)),
        "lower limits": (table.lower.tolist(), arm.limits.lower.tolist()),
        "upper limits": (table.upper.tolist(), arm.limits.upper.tolist()),
        "velocity limits": (table.velocity.tolist(), arm.limits.velocity.tolist()),
    }
    for what, (wanted, found) in pairs.items():
        if wanted != found:
            raise ConversionError(f"the URDF made from DH table {table.name!r} has the {what} {found}, not {wanted}")


def _compare(table: DhTable, frame: str, expected: Array, found: Array, q: Array) -> None:
    position, angle = _difference(expected, found)
    if not (position <= FK_TOLERANCE and angle <= FK_TOLERANCE):  # NaN is refused too
        raise ConversionError(
            f"the URDF made from DH table {table.name!r} does not equal it: frame {frame} is off by {position:.3g} m "
            f"and {angle:.3g} rad (allowed: {FK_TOLERANCE:g}) at q = {q.tolist()}; nothing was written"
        )


def _difference(expected: Array, found: Array) -> tuple[float, float]:
    """How far apart two transforms (4, 4) are, in metres and radians."""
    # The chord |R1 - R2| / sqrt(2) is the angle between them up to its cube; arccos would lose half of the digits.
    angle = float(np.linalg.norm(expected[:3, :3] - found[:3, :3])) / np.sqrt(2)
    return float(np.linalg.norm(expected[:3, 3] - found[:3, 3])), angle
