"""Robots, arms, joint limits, forward kinematics, Jacobians, inverse dynamics (Pinocchio), conversion of DH tables."""

from pinproof.common import faces
from pinproof.model.chain import (
    chain_of as chain_of, held_values as held_values, joint_axis as joint_axis, link_path as link_path,
)  # fmt: skip
from pinproof.model.dh_tables import dh_to_urdf as dh_to_urdf, urdf_to_dh as urdf_to_dh, write_urdf as write_urdf
from pinproof.model.dynamics import (
    GRAVITY as GRAVITY, Payload as Payload, carried_tree as carried_tree, checked_payloads as checked_payloads,
    dynamic_tree as dynamic_tree, kinematic_tree as kinematic_tree, massless_joints as massless_joints,
)  # fmt: skip
from pinproof.model.foreign import coal_shape as coal_shape
from pinproof.model.info import CalibrationEffect as CalibrationEffect, JointInfo as JointInfo, RobotInfo as RobotInfo
from pinproof.model.limits import (
    AT_LIMIT as AT_LIMIT, JointLimits as JointLimits, LimitsFile as LimitsFile, distinct as distinct,
    guess_mark as guess_mark, guess_note as guess_note,
)  # fmt: skip
from pinproof.model.loading import ROBOT_SUFFIXES as ROBOT_SUFFIXES, assemble as assemble, load_robot as load_robot
from pinproof.model.robot import (
    PART as PART, Arm as Arm, JointGroup as JointGroup, Robot as Robot, Singularity as Singularity,
    kinematic_class as kinematic_class,
)  # fmt: skip

__all__ = faces.exported(globals())
