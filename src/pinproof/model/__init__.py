"""Robots, arms, joint limits, forward kinematics, Jacobians and inverse dynamics (Pinocchio)."""

from pinproof.model.dynamics import Payload
from pinproof.model.info import JointInfo, RobotInfo
from pinproof.model.limits import JointLimits, LimitsFile, guess_mark, guess_note
from pinproof.model.loading import assemble, load_robot
from pinproof.model.robot import Arm, JointGroup, Robot, Singularity, kinematic_class

__all__ = [
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
    "guess_mark",
    "guess_note",
    "kinematic_class",
    "load_robot",
]
