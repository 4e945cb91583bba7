"""Robots that move: models, arms, limits, forward kinematics and Jacobians (Pinocchio)."""

from pinproof.model.arm import Arm, Singularity
from pinproof.model.limits import JointLimits
from pinproof.model.robot import Robot, load_robot, load_robot_from_text

__all__ = ["Arm", "JointLimits", "Robot", "Singularity", "load_robot", "load_robot_from_text"]
