"""The calibrated robot: the measured axes of one arm in the place of the nominal ones.

A calibration states the chain base K_0 Rz(q_1) K_1 ... Rz(q_n) K_n, in which the z axes are the true joint axes. Where
the frames lie on these axes is no matter of the forward kinematics, and the calibrations of arms with nearly parallel
axes place them hundreds of metres away, on the common normals. The links of the robot have meshes, so each link is
placed on its true axes as close to its nominal place as possible. From the base on, for each joint i:

- The origin of joint i in link i - 1 is the point of the true axis that is closest to its nominal origin.
- The rotation of link i about axis i, at q = 0, is that for which the next true axis has its nominal direction, as seen
  along axis i; if both axes are nearly parallel, that for which the next axis passes the plane through its nominal
  origin in the nominal direction. (The ROS driver of Universal Robots intersects with a plane too: Exner, "Calibration
  correction algorithm", documentation of ur_calibration.)

What is left between the last axis and the flange moves what is attached to the last link. The forward kinematics is the
given chain up to rounding, because each of these choices enters two neighbouring transforms and cancels.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pinproof.description import JOINTS_OF_UR, MAKES, Calibration, DhTable, UrdfJoint, row_transform, with_origins
from pinproof.errors import CalibrationError, ConversionError, InputError, UnknownNameError
from pinproof.model.chain import joint_axis
from pinproof.model.dh_tables import urdf_to_dh
from pinproof.model.robot import Arm, Robot
from pinproof.spatial import Array, inverse_matrix

MOST_SHIFT, MOST_TILT = 0.015, 0.05
"""Metres and radians. An axis that a calibration moves by more belongs to another robot, or is in other units: factory
calibrations move axes by up to some millimetres and 0.015 rad, and the wrists of a UR3 and a UR3e differ by 19 mm."""

SAME_AXIS = 0.03
"""Metres between nearly parallel axes below which they are one: no direction leads from one to the other."""

ALONG = 0.1
"""Sine of the angle between two axes below which the direction of the second, seen along the first, is not used."""


def calibrated(robot: Robot, calibration: Calibration) -> Robot:
    """A robot with the origins of the joints of one of its arms as measured; all else is that of the robot.

    Raises
    ------
    CalibrationError
        If the arm is not of the make or has other joints, or an axis is moved by more than :data:`MOST_SHIFT` or
        :data:`MOST_TILT`.
    """
    arm = _arm_of(robot, calibration)
    try:
        table = urdf_to_dh(arm, convention=calibration.convention, like=calibration.like)
    except ConversionError as error:
        raise CalibrationError(calibration.path, f"is {calibration.format}, and does not fit: {error}") from error
    chain = true_chain(table, calibration)
    # the nominal places at q = 0: of the axes in the link before each, with z along the axis, and of the tcp
    joints, model = [robot.urdf.joints[name] for name in arm.joint_names], robot.model
    zero = np.zeros(arm.dof)

    def place(link: str) -> Array:
        return np.array(arm.frame_placement(zero, link).homogeneous)

    links = [np.eye(4), *(place(joint.child) for joint in joints)]
    z_from = [_z_from(joint_axis(model, model.getJointId(robot.urdf.model_joint(joint.name)))[0]) for joint in joints]
    ends = [*(link @ turned.T for link, turned in zip(links[1:], z_from, strict=True)), place(arm.tcp)]
    nominal = [inverse_matrix(link) @ end for link, end in zip(links, ends, strict=True)]
    # each link from the base on; axis_from_link is the pose of link i in the frame of its true axis
    axis_from_link, true = np.eye(4), list[Array]()
    for i, turned in enumerate(z_from):
        to_axis = inverse_matrix(axis_from_link) @ chain[i]
        slide = float((nominal[i][:3, 3] - to_axis[:3, 3]) @ to_axis[:3, 2])
        expected = _about_z(0.0, slide) @ turned @ nominal[i + 1]
        if i < len(joints) - 1:
            yaw = _yaw(chain[i + 1], expected)
        else:  # the flange
            rest = chain[i + 1] @ inverse_matrix(expected)
            yaw, slide = math.atan2(rest[1, 0] - rest[0, 1], rest[0, 0] + rest[1, 1]), slide + float(rest[2, 3])
        axis_from_link = _about_z(yaw, slide) @ turned
        true.append(to_axis @ _about_z(yaw, slide))
    flange = inverse_matrix(axis_from_link) @ chain[-1] @ inverse_matrix(nominal[-1])
    _refuse_other_robots(calibration, arm, nominal, [*true, flange @ nominal[-1]])
    # the origins in the URDF: fixed joints between a link and the next joint keep theirs
    origins = {
        joint.name: inverse_matrix(place(joint.parent)) @ link @ axis @ turned
        for joint, link, axis, turned in zip(joints, links[:-1], true, z_from, strict=True)
    }

    def moved(joint: UrdfJoint, origin: Array) -> Array:
        return flange @ origin if joint.parent == joints[-1].child else origins.get(joint.name, origin)

    what = f"the origins of its joints are calibrated by {calibration.path}"
    urdf, remarks = with_origins(robot.urdf, moved), (*robot.remarks, what)
    return replace(robot, urdf=urdf, nominal=robot, calibration=calibration, remarks=remarks)


def true_chain(table: DhTable, calibration: Calibration) -> list[Array]:
    """The transforms K_0 ... K_n (4, 4) between the true axes, from the base of the nominal table to its tool."""
    if calibration.origins is not None:
        return [table.base @ calibration.origins[0], *calibration.origins[1:], table.tool]
    if calibration.deltas is None:
        raise InputError("the calibration states neither deltas nor origins")
    rows = [
        row_transform(
            replace(row, theta=row.theta + theta, d=row.d + d, a=row.a + a, alpha=row.alpha + alpha),
            table.convention,
            0.0,
        )
        for row, (theta, d, a, alpha) in zip(table.rows, calibration.deltas.tolist(), strict=True)
    ]
    if table.convention == "standard":  # the motion is before the row, else behind it
        return [table.base, *rows[:-1], rows[-1] @ table.tool]
    return [table.base @ rows[0], *rows[1:], table.tool]


def _arm_of(robot: Robot, calibration: Calibration) -> Arm:
    """The arm that a calibration describes: from the link before its first joint to the flange."""
    own = calibration.joints
    count = len(own) or JOINTS_OF_UR
    flanges = [link for link in robot.urdf.links if link.endswith("tool0")] if calibration.like == "ur" else []
    try:
        arm = robot.arm(flanges[0] if len(flanges) == 1 else None, base=robot.urdf.root)
    except InputError as error:
        raise CalibrationError(calibration.path, f"the arm that it describes is not known: {error}") from error
    names = arm.joint_names[-count:]
    for name in own:
        if name not in arm.joint_names:
            raise CalibrationError(calibration.path, str(UnknownNameError("joint", name, arm.joint_names, str(arm))))
    described = robot.arm(arm.tcp, base=robot.urdf.joints[names[0]].parent)
    fits = len(names) == count and (not own or own == names)
    if calibration.like is not None and arm.dof != count:  # a rail or a turntable may carry the arm of the make
        try:
            urdf_to_dh(described, convention=calibration.convention, like=calibration.like)
        except ConversionError:
            fits = False
    if not fits:
        make = "" if calibration.like is None else f" of {MAKES[calibration.like].name}"
        stated = f"the joints {', '.join(own)}" if own else f"{count} joints"
        raise CalibrationError(
            calibration.path,
            f"states {stated} of an arm{make}; robot {robot.name!r} has {arm.dof}, in this order: "
            f"{', '.join(arm.joint_names)}",
        )
    return described


def _refuse_other_robots(calibration: Calibration, arm: Arm, nominal: list[Array], true: list[Array]) -> None:
    """Raise CalibrationError if an axis, or the flange, is far from its nominal place in the link before it."""
    for i, (before, after) in enumerate(zip(nominal, true, strict=True)):
        what = f"the axis of joint {arm.joint_names[i]!r}" if i < arm.dof else "the tcp"
        shift, tilt = (float(np.linalg.norm(after[:3, k] - before[:3, k])) for k in (3, 2))
        if not (shift <= MOST_SHIFT and tilt <= MOST_TILT):  # also raises for NaN
            raise CalibrationError(
                calibration.path,
                f"moves {what} of {arm.robot.name!r} by {shift * 1e3:.3g} mm and {tilt:.3g} rad in the link before it; "
                f"a calibration moves it by at most {MOST_SHIFT * 1e3:g} mm and {MOST_TILT:g} rad. It belongs to "
                "another robot, or is not in metres and radians",
            )


def _yaw(true: Array, nominal: Array) -> float:
    """The rotation about z that brings the z axis of ``nominal`` (4, 4) closest to that of ``true`` (4, 4)."""
    before, after = nominal[:3, 2], true[:3, 2]
    if math.hypot(before[0], before[1]) < ALONG:
        # nearly parallel: the points of both at the height of the nominal origin
        before = nominal[:3, 3]
        after = true[:3, 3] + (before[2] - true[2, 3]) / after[2] * after
    if math.hypot(before[0], before[1]) < SAME_AXIS:  # the same axis: the direction of x
        before, after = nominal[:3, 0], true[:3, 0]
    return math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])


def _about_z(angle: float, height: float = 0.0) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0, 0.0], [s, c, 0.0, 0.0], [0.0, 0.0, 1.0, height], [0.0, 0.0, 0.0, 1.0]])


def _z_from(axis: Array) -> Array:
    """The smallest rotation (4, 4) that turns a unit vector to z."""
    turned = np.eye(4)
    x, y, z = axis
    if z < -1.0 + 1e-9:
        turned[:3, :3] = np.diag([1.0, -1.0, -1.0])
    else:
        cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
        turned[:3, :3] += cross + cross @ cross / (1.0 + z)
    return turned
