"""Conversion of DH tables to URDF and of arms to DH tables, for any serial chain.

The kinematics of both are compared after each conversion.

The axes of the joints are computed at q = 0: their directions from the Jacobian, their points from the joint frames. DH
frames are then placed along the axes. A chain of n joints has n axes and a table has n rows, each of which connects two
axes, so one row lacks an axis: the last (standard) or the first (modified). It uses the z axis of the tool or of the
base instead, and the remaining transform is the tool and the base of the table.

Row k transforms a frame on axis k-1 to a frame on axis k. Four parameters suffice only if the x axis of one of the two
frames is on the common normal of the two axes (Denavit and Hartenberg 1955): x_k for the standard convention, x_(k-1)
for the modified one. A modified table is the standard table of the reversed chain with all signs changed, because the
inverse of Rx(alpha) Tx(a) Rz(theta) Tz(d) is Tz(-d) Rz(-theta) Tx(-a) Rx(-alpha). One algorithm serves both.

Where the frames are not unique, rows with short and simple numbers are preferred:

- Direction of x along the normal: the smaller rotation from the previous x (abs(theta) <= pi/2); at exactly pi/2 the
  direction with a > 0, else theta = pi/2.
- Parallel axes: the normal through the previous origin, so d = 0. For the first pair the point of the second axis (the
  position of its joint in the URDF) is used, so that d is the height of the first link.
- Coincident axes: the previous x, so theta = a = 0.
- First and last frame: see :func:`frames_along`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from pinproof.common.files import write_text_whole
from pinproof.common.validation import require_type
from pinproof.description import CONVENTIONS, MAKES, TCP, DhRow, DhTable, Make, Srdf, read_urdf_text, urdf_of_table
from pinproof.errors import ConversionError, PinproofError, UnknownNameError
from pinproof.model.chain import link_path
from pinproof.model.robot import Arm, Robot
from pinproof.spatial import Array, inverse_matrix


def dh_to_urdf(table: DhTable) -> str:
    """Convert a DH table to a URDF and verify that both have the same forward kinematics.

    Parameters
    ----------
    table
        The arm. The root ``base_link`` is the frame in which ``table.base`` is given; the tcp is ``tool0``.

    Returns
    -------
    str
        URDF XML, deterministic. :mod:`pinproof.description.dh_urdf` describes the generated bodies.

    Raises
    ------
    ConversionError
        If the forward kinematics of the URDF, computed by Pinocchio, differ from the product of the DH matrices by more
        than 1e-12 m or 1e-12 rad at a frame dh_0 ... dh_n or at the tool.
    InputError
        If a row has a name that is reserved for a link or joint of the URDF.
    """
    require_type("table", table, DhTable)
    text = urdf_of_table(table)
    prove_urdf_equals_table(table, text)
    return text


def write_urdf(table: DhTable, path: str | Path) -> None:
    """Write the URDF of a DH table (:func:`dh_to_urdf`) atomically to a file.

    Raises
    ------
    ConversionError, InputError
        As :func:`dh_to_urdf`; no file is written.
    FileError
        If the file cannot be written.
    """
    write_text_whole(path, dh_to_urdf(table))


PARALLEL = 1e-10
"""Radians. Axes whose directions differ by less are treated as parallel. This moves a tool at a distance of 3 m by
3e-10 m, less than the tolerance of the table (1e-9 m). Rounding in URDF files causes such angles (Kinova: 2e-13)."""
COINCIDENT = 1e-10
"""Metres. Parallel axes closer than this are treated as coincident, for the same reason."""
FARTHEST = 1e5
"""Metres. The common normal of nearly parallel axes is at a distance of about (distance of the axes) / (angle), so d
becomes large and theta inaccurate (Hayati and Mirmirani 1985, who add a fifth parameter). At this limit the resolution
of a double is 1.5e-11 m, so several rows together still meet 1e-9 m; larger distances raise an error. Axes half a metre
apart reach the limit at 5e-6 rad; calibrated arms (1e-3 to 1e-4 rad) are well below it."""
END_TILT = 1e-2
"""Radians. A row uses the z axis of the base or tool only if that axis is parallel to the adjacent joint axis or tilted
by more than this. A smaller tilt becomes part of the base or tool transform, which represents it with small numbers."""
RIGHT, SHORTEST = 0.9, 1e-3
"""The sine of alpha above which two axes of an arm of a make are at a right angle, and the smallest length a (m) of
parallel ones: far from both, because the arms of a make have exact right angles and links of 0.1 m."""
TIE = 1e-9
"""Metres, or the cosine of an angle. Smaller values are treated as rounding errors of zero (right angle)."""


@dataclass(frozen=True, eq=False)
class DhAxis:
    """A directed line: the unit ``direction`` (3,) through ``point`` (3,), in the base frame at q = 0, in metres.

    ``is_joint`` is False for the z axis of the base or the tool frame, which may be replaced by a
    parallel to the adjacent joint axis.
    """

    name: str
    point: Array
    direction: Array
    is_joint: bool = True


def frame_on(axis: DhAxis, like: Array) -> Array:
    """A frame (4, 4) on an axis, as close as possible to the frame ``like`` (4, 4).

    Its origin is the point of the axis closest to the origin of ``like``. Its x axis is the x axis of ``like``,
    orthogonalised to the axis (or the y axis of ``like`` if the axis is nearly parallel to its x axis).
    """
    z = axis.direction
    x = like[:3, 0] if abs(z @ like[:3, 0]) < 0.9 else like[:3, 1]
    return _frame(axis.point + ((like[:3, 3] - axis.point) @ z) * z, x, z)


def frames_along(
    first: Array, axes: Sequence[DhAxis], end: Array, *, backwards: bool = False, make: Make | None = None
) -> list[Array]:
    """One frame (4, 4) on each axis of a sequence; x_k (k > 0) is on the common normal of the axes k-1 and k.

    Parameters
    ----------
    first
        The frame on the first axis.
    axes
        The axes in order. The last is the z axis of ``end``. If it is parallel to the axis before it, the last frame is
        at the origin of ``end``; if it is coincident, the frame also has the x axis of ``end``, so that the remaining
        transform is the identity. If it is tilted slightly (:data:`END_TILT`), a parallel to the joint axis is used.
    end
        The frame (4, 4) after the last joint.
    backwards
        Whether the axes are ordered from tool to base (modified convention); this changes the sign of a.
    make
        The manufacturer whose directions of x are used. ``first`` is then rotated about its axis so that theta is 0,
        and from the tool also moved along it so that d is 0.

    ConversionError if two axes are too close to parallel (:data:`FARTHEST`); the message names them.
    """
    frames, sense = [first], -1.0 if backwards else 1.0
    for k, (before, after) in enumerate(pairwise(axes)):
        last = k == len(axes) - 2
        x_if_free = end[:3, 0] if last else frames[-1][:3, 0]
        frames.append(_next(frames[-1], before, after, x_if_free, sense, at_own_point=k == 0 or last))
        if make is not None:
            sign = make.signs[len(axes) - 2 - k if backwards else k]
            if _against(sign, frames[-2], frames[-1], before, after, sense):
                frames[-1] = frames[-1] @ np.diag([-1.0, -1.0, 1.0, 1.0])
    if make is not None:
        z, place = axes[0].direction, frames[0][:3, 3]
        along = (frames[1][:3, 3] - place) @ z if backwards else 0.0
        frames[0] = _frame(place + along * z, frames[1][:3, 0], z)
    return frames


def _against(sign: str, frame: Array, next_frame: Array, before: DhAxis, after: DhAxis, sense: float) -> bool:
    """Whether the x axis of the next frame has the opposite direction of that of a make."""
    if not sign:
        return False
    x = next_frame[:3, 0]
    sine = sense * float(np.cross(before.direction, after.direction) @ x)
    length = sense * float((next_frame[:3, 3] - frame[:3, 3]) @ x)
    if (abs(sine) > RIGHT) if sign.endswith("alpha") else (abs(sine) < END_TILT and abs(length) > SHORTEST):
        return bool((sine if sign.endswith("alpha") else length) * (-1.0 if sign.startswith("-") else 1.0) < 0.0)
    how = "at a right angle" if sign.endswith("alpha") else "parallel and apart"
    first, second = (before.name, after.name) if sense > 0 else (after.name, before.name)
    raise ConversionError(f"the axes of {first} and {second} are not {how}, as those of the make are")


def row_numbers(before: Array, after: Array, convention: str) -> tuple[float, float, float, float]:
    """theta, d, a, alpha of the row that transforms one frame (4, 4) to the next."""
    step = after[:3, 3] - before[:3, 3]
    # Rz and Tz use z of the first frame (standard) or the second (modified); Rx and Tx use x of the other frame.
    turning, normal = (before, after) if convention == "standard" else (after, before)
    z, x = turning[:3, 2], normal[:3, 0]
    theta = _angle(before[:3, 0], after[:3, 0], z)
    alpha = _angle(before[:3, 2], after[:3, 2], x)
    return theta, float(step @ z), float(step @ x), alpha


def _next(frame: Array, before: DhAxis, after: DhAxis, x_if_free: Array, sense: float, *, at_own_point: bool) -> Array:
    """The frame on the axis ``after`` whose x axis is on the common normal with ``before``, the axis of ``frame``."""
    origin, z = frame[:3, 3], before.direction
    # z x z' is computed as z x (z' -+ z): the difference of nearly equal vectors is exact, their cross product is not.
    same = 1.0 if z @ after.direction >= 0 else -1.0
    normal = np.cross(z, after.direction - same * z)
    sine = float(np.linalg.norm(normal))
    if not after.is_joint and PARALLEL < sine < END_TILT:
        after, sine = replace(after, direction=same * z), 0.0

    # axes that are not parallel: the origin is at the end of their common normal
    if sine > PARALLEL:
        apart = after.point - before.point
        on_before = float(np.cross(apart, after.direction) @ normal) / sine**2
        on_after = float(np.cross(apart, z) @ normal) / sine**2
        away = max(abs(on_before), abs(on_after))
        if not away <= FARTHEST:  # also raises for NaN
            first, second = (before.name, after.name) if sense > 0 else (after.name, before.name)
            raise ConversionError(
                f"the axes of {first} and {second} are {sine:.2g} rad off parallel, too close for a Denavit-Hartenberg "
                f"row: their common normal is {away:.2g} m away (limit {FARTHEST:g} m). Make them exactly parallel in "
                "the URDF, or use the URDF instead of a table"
            )
        point = after.point + on_after * after.direction
        return _frame(point, _directed(normal / sine, frame, z, point, sense), after.direction)

    # parallel axes: any normal is common
    point = after.point
    if not at_own_point:
        point = point + ((origin - point) @ after.direction) * after.direction
    across = point - origin - ((point - origin) @ z) * z
    distance = float(np.linalg.norm(across))
    if distance > COINCIDENT:
        return _frame(point, _directed(across / distance, frame, z, point, sense), after.direction)
    return _frame(point, x_if_free, after.direction)


def _directed(normal: Array, frame: Array, z: Array, point: Array, sense: float) -> Array:
    """Return ``normal`` or its opposite, by the rule in the module docstring."""
    cosine = float(normal @ frame[:3, 0])
    length = sense * float((point - frame[:3, 3]) @ normal)
    turn = sense * float(np.cross(frame[:3, 0], normal) @ z)
    decisive = cosine if abs(cosine) > TIE else length if abs(length) > TIE else turn
    return normal if decisive >= 0 else -normal


def _frame(origin: Array, x: Array, z: Array) -> Array:
    """A right-handed frame at ``origin`` with the given z axis; x is orthogonalised to it."""
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    frame[:3, 3] = origin
    return frame


def _angle(start: Array, end: Array, about: Array) -> float:
    return float(np.arctan2(np.cross(start, end) @ about, start @ end))


PLAIN_ANGLE = math.pi / 12
PLAIN_NOISE = 1e-14
"""Radians or metres. An angle this close to a multiple of 15 degrees is rounded to it, and a length this close to its
value with 12 decimals, for example 0.1 + 0.2 to 0.3. The table of a make is exact, so PARALLEL applies to it."""


def urdf_to_dh(arm: Arm, *, convention: str = "standard", like: str | None = None, name: str | None = None) -> DhTable:
    """Convert an arm to a DH table and verify that both have the same forward kinematics.

    Parameters
    ----------
    arm
        Any chain of revolute, continuous and prismatic joints with skew, parallel, intersecting or coincident axes.
        The base of the table is the base link of the arm, its tool is the tcp.
    convention
        ``"standard"`` or ``"modified"``.
    like
        ``"ur"`` or ``"franka"``: the table has the convention, the directions of x and the zeros of theta that
        Universal Robots or Franka publish. By default they follow the rules of :mod:`pinproof.model.dh_tables`.
    name
        Name of the table; default: the name of the robot.

    Returns
    -------
    DhTable
        Joint names, types, limits and velocities are those of the arm. A joint without a velocity limit gets the
        default of :class:`~pinproof.description.DhRow`, and a joint without finite limits becomes continuous. Rows are
        not unique where axes are parallel or coincident, and an x axis may have either direction;
        :mod:`pinproof.model.dh_tables` documents the choices. The table of a URDF made by
        :func:`~pinproof.model.dh_to_urdf` equals the original table if that follows the same choices.

    Raises
    ------
    ConversionError
        If the chain contains a mimic joint, if two neighbouring axes are nearly parallel (the message names them), or
        if the forward kinematics differ by more than 1e-9 m or 1e-9 rad; with ``like``, if the axes are not those of
        an arm of the make.
    InputError
        For an unknown convention or make (:class:`~pinproof.errors.UnknownNameError`) or an invalid limit.
    """
    require_type("arm", arm, Arm)
    if convention not in CONVENTIONS:
        raise UnknownNameError("DH convention", convention, CONVENTIONS)
    make, noise = None, PLAIN_NOISE
    if like is not None:
        if like not in MAKES:
            raise UnknownNameError("make", like, MAKES)
        make, noise = MAKES[like], PARALLEL
        convention = make.convention
        if arm.dof != len(make.signs):
            raise ConversionError(f"an arm of {make.name} has {len(make.signs)} joints, and {arm} has {arm.dof}")
    # rows are independent joints
    path = [joint for joint in link_path(arm.robot.urdf, arm.base, arm.tcp) if joint.type != "fixed"]
    for joint in path:
        if joint.mimic is not None:
            raise ConversionError(
                f"joint {joint.name!r} is a mimic joint of {joint.mimic.leader!r}, and each Denavit-Hartenberg row has "
                "an independent joint; select a chain without mimic joints"
            )
    # the axis of each joint in the base frame at q = 0
    zero, axes = np.zeros(arm.dof), list[DhAxis]()
    twists = arm.jacobian(zero, reference="WORLD")
    for joint, turns, twist in zip(path, arm.angular, twists.T, strict=True):
        direction = twist[3:] if turns else twist[:3]
        point = np.array(arm.frame_placement(zero, joint.child).translation)
        axes.append(DhAxis(f"joint {joint.name!r}", point, direction / np.linalg.norm(direction)))
    # one frame on each axis; the modified convention is the standard one of the reversed chain
    base = np.eye(4)
    tool = np.array(arm.forward_kinematics(np.zeros(arm.dof)).homogeneous)
    if convention == "standard":
        last = DhAxis("the tool", tool[:3, 3], tool[:3, 2], is_joint=False)
        frames = frames_along(frame_on(axes[0], base), [*axes, last], tool, make=make)
    else:
        last = DhAxis("the base", base[:3, 3], base[:3, 2], is_joint=False)
        frames = frames_along(frame_on(axes[-1], tool), [*reversed(axes), last], base, backwards=True, make=make)[::-1]
    # the rows between the frames, with the numbers as a person would write them
    numbers = (row_numbers(*pair, convention) for pair in pairwise(frames))
    table = DhTable(
        tuple(_row(arm, i, joint.type, *row, noise) for i, (joint, row) in enumerate(zip(path, numbers, strict=True))),
        convention=convention,
        name=arm.robot.name if name is None else name,
        base=_plain_transform(frames[0], noise),
        tool=_plain_transform(inverse_matrix(frames[-1]) @ tool, noise),
    )
    if make is not None and (odd := [row for row in table.rows if abs(row.theta) > END_TILT]):
        what = f"theta of joint {odd[0].name!r} is {odd[0].theta:.3g} rad at q = 0"
        raise ConversionError(
            f"{what}; it is 0 in the table of {make.name}, which describes the nominal arm with the zero of the make"
        )
    # the table is an answer only if it is the arm
    prove_table_equals_arm(table, arm)
    return table


def _row(arm: Arm, i: int, joint_type: str, theta: float, d: float, a: float, alpha: float, noise: float) -> DhRow:
    lower, upper, velocity = (float(x[i]) for x in (arm.limits.lower, arm.limits.upper, arm.limits.velocity))
    effort = math.nan if arm.limits.torque is None else float(arm.limits.torque[i])
    limited = math.isfinite(lower) and math.isfinite(upper)
    if joint_type != "prismatic":
        joint_type = "revolute" if limited else "continuous"
    elif not limited:
        raise ConversionError(
            f"prismatic joint {arm.joint_names[i]!r} has no finite limits, which a Denavit-Hartenberg row must state; "
            "state them in the URDF, or in a file of joint limits (--limits, in Python limits=)"
        )
    return DhRow(
        arm.joint_names[i], _plain_angle(theta, noise), _plain_length(d, noise), _plain_length(a, noise),
        _plain_angle(alpha, noise), joint_type,
        **({"lower": lower, "upper": upper} if limited else {}),
        **({"velocity": velocity} if math.isfinite(velocity) else {}),
        **({"effort": effort} if math.isfinite(effort) else {}),
    )  # fmt: skip


def _plain_angle(angle: float, noise: float) -> float:
    plain = round(angle / PLAIN_ANGLE) * PLAIN_ANGLE
    if abs(angle - plain) > noise:
        return angle
    return abs(plain) if abs(plain) == math.pi else plain + 0.0  # pi instead of -pi, 0.0 instead of -0.0


def _plain_length(length: float, noise: float) -> float:
    plain = round(length, 12 if noise == PLAIN_NOISE else 9)
    return plain + 0.0 if abs(length - plain) <= noise else length


def _plain_transform(transform: Array, noise: float) -> Array:
    """Remove rounding errors from a transform (4, 4): entries close to a round number are rounded to it."""
    plain: Array = transform.copy()
    near = np.round(plain[:3, :3])
    plain[:3, :3] = np.where(np.abs(plain[:3, :3] - near) <= noise, near, plain[:3, :3]) + 0.0
    plain[:3, 3] = [_plain_length(float(length), noise) for length in plain[:3, 3]]
    return plain


# -- comparison ------------------------------------------------------------------------------------------------------


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
        # names, order and limits of the joints
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
        # every frame of the table, and its tool
        for q in _configurations(table):
            own = {f"dh_{i}": pose for i, pose in enumerate(table.frames(q))} | {arm.tcp: table.forward_kinematics(q)}
            for frame, pose in own.items():
                position, angle = _difference(pose, arm.frame_placement(q, frame).homogeneous)
                if not (position <= FK_TOLERANCE and angle <= FK_TOLERANCE):  # also raises for NaN
                    raise ConversionError(
                        f"the URDF made from DH table {table.name!r} does not equal it: frame {frame} is off by "
                        f"{position:.3g} m and {angle:.3g} rad (allowed: {FK_TOLERANCE:g}) at q = {q.tolist()}; "
                        "nothing was written"
                    )
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


def _difference(expected: Array, actual: Array) -> tuple[float, float]:
    """The distance (m) and the angle (rad) between two transforms (4, 4)."""
    # |R1 - R2| / sqrt(2) equals the angle up to third order; arccos would lose half of the digits.
    angle = float(np.linalg.norm(expected[:3, :3] - actual[:3, :3])) / np.sqrt(2)
    return float(np.linalg.norm(expected[:3, 3] - actual[:3, 3])), angle
