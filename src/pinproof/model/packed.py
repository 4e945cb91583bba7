"""An arm's chain as one array, for compiled loops.

Every joint is turned so that it moves about, or along, its own z: with a rotation A_k that takes z to the axis of joint
k, the chain base_from_tcp = C_1 X_1(q) C_2 X_2(q) ... C_m X_m(q) C_tool has X_k = Rz or Tz and constant C_k, into which
the A_k went. See :mod:`pinproof.kernels.chain` for the layout.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.errors import InputError

if TYPE_CHECKING:
    from pinproof.model.arm import Arm

__all__ = ["joint_axis", "pack_chain"]

Array = npt.NDArray[np.float64]


def pack_chain(arm: Arm) -> Array:
    """The (m + 1, 16) array of the m joints between base and tcp, followers included, and of the tool."""
    model = arm.model
    tcp = model.frames[model.getFrameId(arm.tcp, pin.FrameType.BODY)]
    joints = [joint for joint in model.supports[tcp.parentJoint] if joint != 0]
    rows = np.zeros((len(joints) + 1, 16))
    behind = arm.root_from_base.inverse()  # what stands before the next joint
    for row, joint in zip(rows, joints, strict=False):
        axis, slides = joint_axis(model, joint)
        aligned = _from_z(axis)
        row[:12] = (behind * model.jointPlacements[joint] * aligned).homogeneous[:3].ravel()
        leader = int(np.abs(arm.scale[joint - 1]).argmax())
        row[12:] = slides, leader, arm.scale[joint - 1, leader], arm.offset[joint - 1]
        behind = aligned.inverse()
    rows[-1, :12] = (behind * tcp.placement).homogeneous[:3].ravel()
    return rows


def joint_axis(model: pin.Model, joint: int) -> tuple[Array, bool]:
    """The unit axis (3,) of a joint in its own frame, and whether it slides."""
    kind = model.joints[joint]
    data = kind.createData()
    kind.calc(data, np.zeros(kind.nq))
    subspace = np.asarray(data.S, dtype=float).ravel()
    if kind.nq != 1 or subspace.shape != (6,):
        raise InputError(f"joint {model.names[joint]!r} is a {kind.shortname()}: a chain is made of single axes")
    slides = not subspace[3:].any()
    return (subspace[:3] if slides else subspace[3:]), slides


def _from_z(axis: Array) -> pin.SE3:
    """A rotation that takes z to the unit vector ``axis``; exact for an axis of the frame."""
    helper = np.zeros(3)
    helper[int(np.abs(axis).argmin())] = 1.0
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return pin.SE3(np.column_stack([x, np.cross(axis, x), axis]), np.zeros(3))
