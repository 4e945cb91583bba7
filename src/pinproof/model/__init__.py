"""Robots that move: models, arms, limits, forward kinematics and Jacobians (Pinocchio)."""

from pinproof.model.arm import Arm, Singularity
from pinproof.model.info import JointInfo, RobotInfo, kinematic_class
from pinproof.model.limits import JointLimits, LimitsFile
from pinproof.model.robot import Robot, load_robot, load_robot_from_text

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
