"""Robots, arms, joint limits, forward kinematics and Jacobians (Pinocchio)."""

from pinproof.model.info import JointInfo, RobotInfo
from pinproof.model.limits import JointLimits, LimitsFile
from pinproof.model.loading import load_robot
from pinproof.model.robot import Arm, Robot, Singularity, kinematic_class, load_robot_from_text

__all__ = [
    "Arm",
    "JointInfo",
    "JointLimits",
    "LimitsFile",
    "Robot",
    "RobotInfo",
    "Singularity",
    "kinematic_class",
    "load_robot",
    "load_robot_from_text",
]
