"""Curves in joint space: paths, timed trajectories, and time parametrisation."""

from pinproof.motion.bezier import split
from pinproof.motion.blended_path import BlendedPath
from pinproof.motion.cubic_path import CubicPath
from pinproof.motion.curve import (
    MEET_TOLERANCE,
    BezierCurve,
    Curve,
    TimedCurve,
    parameter_text,
    read_only,
    refuse_broken,
)
from pinproof.motion.dialects import dialect_of_file, find_dialect, is_program_file
from pinproof.motion.group_motion import TimedColumns, merged, separate, synchronise
from pinproof.motion.joint_path import JointPath
from pinproof.motion.limit_check import LIMIT_TOLERANCE, LimitCheck, LimitViolation, check_limits
from pinproof.motion.limits import RATE_TOLERANCE, Bounds, MotionLimits
from pinproof.motion.motion_program import EventKind, MotionProgram, ProgramEvent, ProgramSegment, certificate_id
from pinproof.motion.motion_record import MotionRecord
from pinproof.motion.plot import Panel, panels_of
from pinproof.motion.program_steps import (
    Blend,
    JointMove,
    LinearMove,
    SetOutput,
    Step,
    StreamedPoint,
    StreamedTrajectory,
    Wait,
)
from pinproof.motion.rate_constraints import RateConstraint, checked_constraints, rate_violations
from pinproof.motion.robot_program import JointMap, ProgramPick, RobotProgram, make_program, moves_along
from pinproof.motion.steering import (
    Move,
    MoveSequence,
    State,
    Steering,
    inside_position_limits,
    least_times,
    rate_excess,
    rest,
    rest_to_rest_times,
)
from pinproof.motion.timing import time_parametrise
from pinproof.motion.tool_limits import ToolLimits
from pinproof.motion.torque_limits import TorqueLimits, TorquePeak
from pinproof.motion.trajectory import Trajectory
from pinproof.motion.trajectory_files import MOTION, NANO, Reader, from_message, seconds, to_message, whole_nanoseconds

__all__ = [
    "LIMIT_TOLERANCE",
    "MEET_TOLERANCE",
    "MOTION",
    "NANO",
    "RATE_TOLERANCE",
    "BezierCurve",
    "Blend",
    "BlendedPath",
    "Bounds",
    "CubicPath",
    "Curve",
    "EventKind",
    "JointMap",
    "JointMove",
    "JointPath",
    "LimitCheck",
    "LimitViolation",
    "LinearMove",
    "MotionLimits",
    "MotionProgram",
    "MotionRecord",
    "Move",
    "MoveSequence",
    "Panel",
    "ProgramEvent",
    "ProgramPick",
    "ProgramSegment",
    "RateConstraint",
    "Reader",
    "RobotProgram",
    "SetOutput",
    "State",
    "Steering",
    "Step",
    "StreamedPoint",
    "StreamedTrajectory",
    "TimedColumns",
    "TimedCurve",
    "ToolLimits",
    "TorqueLimits",
    "TorquePeak",
    "Trajectory",
    "Wait",
    "certificate_id",
    "check_limits",
    "checked_constraints",
    "dialect_of_file",
    "find_dialect",
    "from_message",
    "inside_position_limits",
    "is_program_file",
    "least_times",
    "make_program",
    "merged",
    "moves_along",
    "panels_of",
    "parameter_text",
    "rate_excess",
    "rate_violations",
    "read_only",
    "refuse_broken",
    "rest",
    "rest_to_rest_times",
    "seconds",
    "separate",
    "split",
    "synchronise",
    "time_parametrise",
    "to_message",
    "whole_nanoseconds",
]
