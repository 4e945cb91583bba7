"""Curves in joint space: paths, timed trajectories, and time parametrisation."""

from pinproof.motion.blended_path import BlendedPath
from pinproof.motion.cubic_path import CubicPath
from pinproof.motion.curve import Curve
from pinproof.motion.dialects import dialect_of_file, find_dialect, is_program_file
from pinproof.motion.group_motion import separate, synchronise
from pinproof.motion.joint_path import JointPath
from pinproof.motion.limit_check import LimitCheck, LimitViolation, check_limits
from pinproof.motion.limits import MotionLimits
from pinproof.motion.motion_program import MotionProgram, ProgramEvent, ProgramSegment
from pinproof.motion.motion_record import MotionRecord
from pinproof.motion.program_steps import Blend
from pinproof.motion.rate_constraints import RateConstraint, rate_violations
from pinproof.motion.robot_program import JointMap, ProgramPick, RobotProgram
from pinproof.motion.timing import time_parametrise
from pinproof.motion.tool_limits import ToolLimits
from pinproof.motion.torque_limits import TorqueLimits, TorquePeak
from pinproof.motion.trajectory import Trajectory

__all__ = [
    "Blend",
    "BlendedPath",
    "CubicPath",
    "Curve",
    "JointMap",
    "JointPath",
    "LimitCheck",
    "LimitViolation",
    "MotionLimits",
    "MotionProgram",
    "MotionRecord",
    "ProgramEvent",
    "ProgramPick",
    "ProgramSegment",
    "RateConstraint",
    "RobotProgram",
    "ToolLimits",
    "TorqueLimits",
    "TorquePeak",
    "Trajectory",
    "check_limits",
    "dialect_of_file",
    "find_dialect",
    "is_program_file",
    "rate_violations",
    "separate",
    "synchronise",
    "time_parametrise",
]
