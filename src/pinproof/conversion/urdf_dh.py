"""URDF -> DH table, for any serial chain of turning and sliding joints.

Everything is read off the zero configuration: an axis for each joint, its direction from Pinocchio's Jacobian, its
point from the joint's own frame; :mod:`pinproof.conversion.dh_frames` lays the DH frames along them. A chain of n
joints has n axes and a table n rows, each of which spans two axes, so one row has an axis too few: the last (standard)
or the first (modified). It follows the z axis of the tool or of the base instead, and what then is left over is the
table's tool and base.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.conversion.dh_frames import Axis, frame_on, frames_along, row_numbers
from pinproof.conversion.proof import prove_table_equals_arm
from pinproof.description.dh_row import CONVENTIONS, DhRow
from pinproof.description.dh_table import DhTable
from pinproof.errors import ConversionError, UnknownNameError
from pinproof.model import Arm
from pinproof.model.chain import link_path

__all__ = ["urdf_to_dh"]

Array = npt.NDArray[np.float64]

PLAIN_ANGLE = math.pi / 12
PLAIN_ANGLE_NOISE = 1e-14
"""Radians: an angle this near to a multiple of 15 degrees is that multiple, off by what the arithmetic added."""
PLAIN_LENGTH_NOISE = 1e-14
"""Metres: a length this near to 12 decimals has those decimals; 0.1 + 0.2 is 0.3."""


def urdf_to_dh(arm: Arm, *, convention: str = "standard", name: str | None = None) -> DhTable:
    """A DH table of an arm, proven equal to it.

    Parameters
    ----------
    arm
        Any chain of revolute, continuous and prismatic joints: skew, parallel, intersecting and coincident axes.
        The table's base is the arm's base link, its tool the arm's tcp.
    convention
        ``"standard"`` or ``"modified"``.
    name
        Name of the table; by default the robot's.

    Returns
    -------
    DhTable
        Joint names, kinds, limits and velocities are the arm's (a joint whose velocity limit is unknown gets
        :class:`~pinproof.description.DhRow`'s default, one that states no finite limits becomes continuous). Rows are
        not unique where axes are parallel or coincident, and an x axis may point either way;
        :mod:`pinproof.conversion.dh_frames` says what is chosen. A table written by
        :func:`~pinproof.conversion.dh_to_urdf` comes back row by row where it was made by the same choices.

    Raises
    ------
    ConversionError
        If a joint of the chain follows another one (mimic), if two neighbouring axes are too near parallel (they are
        named), or unless forward kinematics of the table equals the arm's to 1e-9 m and 1e-9 rad.
    InputError
        For an unknown convention (:class:`~pinproof.errors.UnknownNameError`), or a limit that no row can hold.
    """
    if convention not in CONVENTIONS:
        raise UnknownNameError("DH convention", convention, CONVENTIONS)
    path = [joint for joint in link_path(arm.robot.urdf, arm.base, arm.tcp) if joint.type != "fixed"]
    for joint in path:
        if joint.mimic is not None:
            raise ConversionError(
                f"joint {joint.name!r} follows {joint.mimic.leader!r} (mimic): a Denavit-Hartenberg row has a joint of "
                f"its own, so this chain has no table"
            )
    axes = _axes(arm, [joint.child for joint in path])
    base = np.eye(4)
    tool = np.array(arm.forward_kinematics(np.zeros(arm.dof)).homogeneous)
    if convention == "standard":
        frames = frames_along(frame_on(axes[0], base), [*axes, _own_axis("the tool", tool)], tool)
    else:
        walk = [*reversed(axes), _own_axis("the base", base)]
        frames = frames_along(frame_on(axes[-1], tool), walk, base, backwards=True)[::-1]
    numbers = (row_numbers(*pair, convention) for pair in pairwise(frames))
    table = DhTable(
        tuple(_row(arm, i, joint.type, *row) for i, (joint, row) in enumerate(zip(path, numbers, strict=True))),
        convention=convention,
        name=arm.robot.name if name is None else name,
        base=_plain_transform(frames[0]),
        tool=_plain_transform(_inverse(frames[-1]) @ tool),
    )
    prove_table_equals_arm(table, arm)
    return table


def _axes(arm: Arm, links: list[str]) -> list[Axis]:
    """The axis of each joint, whose child links are given, in the arm's base frame at q = 0."""
    zero = np.zeros(arm.dof)
    twists = arm.jacobian(zero, reference="WORLD")
    axes = []
    for name, turns, twist, link in zip(arm.joint_names, arm.angular, twists.T, links, strict=True):
        direction = twist[3:] if turns else twist[:3]
        point = np.array(arm.frame_placement(zero, link).translation)
        axes.append(Axis(f"joint {name!r}", point, direction / np.linalg.norm(direction)))
    return axes


def _own_axis(name: str, frame: Array) -> Axis:
    return Axis(name, frame[:3, 3], frame[:3, 2], is_joint=False)


def _row(arm: Arm, i: int, joint_type: str, theta: float, d: float, a: float, alpha: float) -> DhRow:
    lower, upper, velocity = (float(x[i]) for x in (arm.limits.lower, arm.limits.upper, arm.limits.velocity))
    limited = math.isfinite(lower) and math.isfinite(upper)
    if joint_type != "prismatic":
        joint_type = "revolute" if limited else "continuous"
    elif not limited:
        raise ConversionError(
            f"prismatic joint {arm.joint_names[i]!r} has no finite limits, which a Denavit-Hartenberg row must state; "
            f"pass limits= to robot.arm(...)"
        )
    return DhRow(
        arm.joint_names[i],
        _plain_angle(theta),
        _plain_length(d),
        _plain_length(a),
        _plain_angle(alpha),
        joint_type,
        **({"lower": lower, "upper": upper} if limited else {}),
        **({"velocity": velocity} if math.isfinite(velocity) else {}),
    )


def _plain_angle(angle: float) -> float:
    plain = round(angle / PLAIN_ANGLE) * PLAIN_ANGLE
    if abs(angle - plain) > PLAIN_ANGLE_NOISE:
        return angle
    return abs(plain) if abs(plain) == math.pi else plain + 0.0  # one name for the half turn, none for -0.0


def _plain_length(length: float) -> float:
    plain = round(length, 12)
    return plain + 0.0 if abs(length - plain) <= PLAIN_LENGTH_NOISE else length


def _plain_transform(transform: Array) -> Array:
    """A transform (4, 4) freed of the noise of arithmetic where a number is plain without it."""
    plain: Array = transform.copy()
    near = np.round(plain[:3, :3])
    plain[:3, :3] = np.where(np.abs(plain[:3, :3] - near) <= PLAIN_LENGTH_NOISE, near, plain[:3, :3]) + 0.0
    plain[:3, 3] = [_plain_length(float(length)) for length in plain[:3, 3]]
    return plain


def _inverse(frame: Array) -> Array:
    inverse = np.eye(4)
    inverse[:3, :3] = frame[:3, :3].T
    inverse[:3, 3] = -frame[:3, :3].T @ frame[:3, 3]
    return inverse
