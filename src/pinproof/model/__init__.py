"""Robots, arms, joint limits, forward kinematics, Jacobians and inverse dynamics (Pinocchio)."""

from pinproof.model.chain import chain_of, held_values, joint_axis, link_path
from pinproof.model.dynamics import GRAVITY, Payload, checked_payloads, dynamic_tree, kinematic_tree, massless_joints
from pinproof.model.foreign import coal_shape
from pinproof.model.info import JointInfo, RobotInfo
from pinproof.model.limits import AT_LIMIT, JointLimits, LimitsFile, distinct, guess_mark, guess_note
from pinproof.model.loading import (
    ROBOT_SUFFIXES,
    assemble,
    load_robot,
    prove_table_equals_arm,
    prove_urdf_equals_table,
)
from pinproof.model.robot import PART, Arm, JointGroup, Robot, Singularity, kinematic_class

__all__ = [
    "AT_LIMIT",
    "GRAVITY",
    "PART",
    "ROBOT_SUFFIXES",
    "Arm",
    "JointGroup",
    "JointInfo",
    "JointLimits",
    "LimitsFile",
    "Payload",
    "Robot",
    "RobotInfo",
    "Singularity",
    "assemble",
    "chain_of",
    "checked_payloads",
    "coal_shape",
    "distinct",
    "dynamic_tree",
    "guess_mark",
    "guess_note",
    "held_values",
    "joint_axis",
    "kinematic_class",
    "kinematic_tree",
    "link_path",
    "load_robot",
    "massless_joints",
    "prove_table_equals_arm",
    "prove_urdf_equals_table",
]
