"""Robots that move: models, arms, limits, forward kinematics and Jacobians (Pinocchio)."""

from pinproof.model.arm import Arm, Singularity
from pinproof.model.info import JointInfo, RobotInfo, describe
from pinproof.model.kinematic_class import kinematic_class
from pinproof.model.limits import JointLimits
from pinproof.model.limits_file import LimitsFile, load_limits
from pinproof.model.robot import Robot, load_robot, load_robot_from_text

__all__ = [
    "Arm",
    "JointInfo",
    "JointLimits",
    "LimitsFile",
    "Robot",
    "RobotInfo",
    "Singularity",
    "describe",
    "kinematic_class",
    "load_limits",
    "load_robot",
    "load_robot_from_text",
]
