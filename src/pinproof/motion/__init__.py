"""Curves in joint space: paths, timed trajectories, and time parametrisation."""

from pinproof.common import faces
from pinproof.motion.controller_time import (
    ControllerMotion as ControllerMotion,
    ControllerMove as ControllerMove,
    Profile as Profile,
    controller_motion as controller_motion,
    fastest as fastest,
    fewest_moves as fewest_moves,
    meeting as meeting,
    stop_times as stop_times,
    with_corners as with_corners,
)
from pinproof.motion.curve import (
    MEET_TOLERANCE as MEET_TOLERANCE,
    Bezier as Bezier,
    BezierCurve as BezierCurve,
    Curve as Curve,
    CurvePart as CurvePart,
    TimedCurve as TimedCurve,
    parameter_text as parameter_text,
    read_only as read_only,
    refuse_broken as refuse_broken,
    split as split,
)
from pinproof.motion.dialects import (
    Dialect as Dialect,
    dialect_of_file as dialect_of_file,
    find_dialect as find_dialect,
    is_program_file as is_program_file,
)
from pinproof.motion.dialects.dialect import (
    Blend as Blend,
    CheckInput as CheckInput,
    JointMove as JointMove,
    LinearMove as LinearMove,
    Remark as Remark,
    SetLoad as SetLoad,
    SetOutput as SetOutput,
    Step as Step,
    StreamedPoint as StreamedPoint,
    StreamedTrajectory as StreamedTrajectory,
    ToolData as ToolData,
    UserFrame as UserFrame,
    Wait as Wait,
    external_joints as external_joints,
)
from pinproof.motion.group_motion import (
    TimedColumns as TimedColumns,
    merged as merged,
    separate as separate,
    synchronise as synchronise,
)
from pinproof.motion.hold_limits import (
    ContactPatch as ContactPatch,
    HoldLimits as HoldLimits,
    HoldPeak as HoldPeak,
)
from pinproof.motion.limits import (
    LIMIT_TOLERANCE as LIMIT_TOLERANCE,
    RATE_TOLERANCE as RATE_TOLERANCE,
    Bounds as Bounds,
    LimitCheck as LimitCheck,
    LimitViolation as LimitViolation,
    MotionLimits as MotionLimits,
    check_limits as check_limits,
    inside_position_limits as inside_position_limits,
    least_times as least_times,
    rate_excess as rate_excess,
)
from pinproof.motion.motion_program import (
    EventKind as EventKind,
    MotionProgram as MotionProgram,
    ProgramEvent as ProgramEvent,
    ProgramSegment as ProgramSegment,
    certificate_id as certificate_id,
)
from pinproof.motion.own_motion import (
    Motion as Motion,
    SampledMotion as SampledMotion,
    SpeedBound as SpeedBound,
    TimedCurvePart as TimedCurvePart,
)
from pinproof.motion.paths import (
    REVERSAL as REVERSAL,
    BlendedPath as BlendedPath,
    CubicPath as CubicPath,
    JointPath as JointPath,
    corner_distance as corner_distance,
    corner_spacing as corner_spacing,
    round_corner as round_corner,
)
from pinproof.motion.plot import Panel as Panel, panels_of as panels_of
from pinproof.motion.rate_limits import (
    RateConstraint as RateConstraint,
    ToolLimits as ToolLimits,
    TorqueLimits as TorqueLimits,
    TorquePeak as TorquePeak,
    checked_constraints as checked_constraints,
    rate_violations as rate_violations,
)
from pinproof.motion.robot_program import (
    JointMap as JointMap,
    ProgramPick as ProgramPick,
    RobotProgram as RobotProgram,
    calibration_marks as calibration_marks,
    make_program as make_program,
)
from pinproof.motion.steering import (
    Move as Move,
    MoveSequence as MoveSequence,
    State as State,
    Steering as Steering,
    rest as rest,
)
from pinproof.motion.timing import IMAGE_TOLERANCE as IMAGE_TOLERANCE, time_parametrise as time_parametrise
from pinproof.motion.trajectory import Trajectory as Trajectory
from pinproof.motion.trajectory_files import (
    MOTION as MOTION,
    NANO as NANO,
    MotionRecord as MotionRecord,
    from_message as from_message,
    seconds as seconds,
    to_message as to_message,
    whole_nanoseconds as whole_nanoseconds,
)

__all__ = faces.exported(globals())
