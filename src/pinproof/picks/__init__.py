"""Picks: input, judgement stage by stage with reasons and suggestions, reports, campaigns and reach maps.

The data flows through four packages, each of which imports only from those before it: ``input`` (picks and their
files), ``judging`` (one pick, from reach to the timed and certified motion), ``report`` (tables and the HTML page) and
``batch`` (lists, campaigns, screening, reach maps). ``grasps`` proposes grasps of parts, by the hand and the grip of
``judging``.
"""

from pinproof.common import faces
from pinproof.picks.batch.campaign import (
    BeltSequence as BeltSequence, Campaign as Campaign, CampaignResult as CampaignResult,
    ItemCampaign as ItemCampaign, pick_from_belt as pick_from_belt, validate_picks as validate_picks,
)  # fmt: skip
from pinproof.picks.batch.reach_map import (
    ReachComparison as ReachComparison, ReachMap as ReachMap, ReachRegion as ReachRegion,
    approach_directions as approach_directions, attainable_orientations as attainable_orientations,
    reach_map as reach_map, tool_orientations as tool_orientations,
)  # fmt: skip
from pinproof.picks.batch.screening import (
    ScreenResult as ScreenResult, ScreenStatus as ScreenStatus, code_of as code_of, screen_picks as screen_picks,
)  # fmt: skip
from pinproof.picks.grasps.proposals import (
    ProposedGrasp as ProposedGrasp, ProposedGrasps as ProposedGrasps, propose_grasps as propose_grasps,
)  # fmt: skip
from pinproof.picks.input.parts import PartGrasp as PartGrasp, PartType as PartType
from pinproof.picks.input.pick import (
    GraspSpin as GraspSpin, GraspTolerance as GraspTolerance, Member as Member, Pick as Pick,
    PlaceTarget as PlaceTarget, ToolSpeed as ToolSpeed, support_names as support_names,
)  # fmt: skip
from pinproof.picks.input.picks import (
    SETTINGS as SETTINGS, CellRobot as CellRobot, NamedFrame as NamedFrame, PickProblem as PickProblem, Picks as Picks,
    read_settings as read_settings, root_from_frame as root_from_frame,
)  # fmt: skip
from pinproof.picks.input.settings import (
    Conveyor as Conveyor, GripLimits as GripLimits, GripperFingers as GripperFingers, PickBudget as PickBudget,
    PickWeights as PickWeights, ProgramSettings as ProgramSettings, SuctionCup as SuctionCup,
)  # fmt: skip
from pinproof.picks.input.sources import (
    PickGrid as PickGrid, PickList as PickList, PickSource as PickSource, PickTable as PickTable,
    open_picks as open_picks, read_picks as read_picks,
)  # fmt: skip
from pinproof.picks.input.tools import Hand as Hand, HandValues as HandValues, Tool as Tool
from pinproof.picks.judging.configurations import TURN as TURN, limit_margin as limit_margin
from pinproof.picks.judging.grasp import (
    GraspCandidate as GraspCandidate, PickCheck as PickCheck, closing_words as closing_words, reach as reach,
    screen as screen,
)  # fmt: skip
from pinproof.picks.judging.grip import (
    CupContact as CupContact, FingerContact as FingerContact, GripResult as GripResult, PlacedSurface as PlacedSurface,
)  # fmt: skip
from pinproof.picks.judging.judge import HandsResult as HandsResult, judge as judge, judge_hands as judge_hands
from pinproof.picks.judging.lines import Attempt as Attempt, along as along, shortened as shortened, transit as transit
from pinproof.picks.judging.place import (
    Placer as Placer, Release as Release, release_lines as release_lines,
)  # fmt: skip
from pinproof.picks.judging.setup import PickSetup as PickSetup
from pinproof.picks.judging.suggest import (
    GripSuggestion as GripSuggestion, LengthSuggestion as LengthSuggestion, RetreatSuggestion as RetreatSuggestion,
    ShiftSuggestion as ShiftSuggestion, TurnSuggestion as TurnSuggestion,
)  # fmt: skip
from pinproof.picks.judging.task import (
    PickCell as PickCell, PickTask as PickTask,
    check_held_joints as check_held_joints, check_windings as check_windings, checker_of_picks as checker_of_picks,
    gripper_links as gripper_links, peaks_of as peaks_of, rate_limits as rate_limits,
    spec_of_picks as spec_of_picks, supports_below as supports_below,
    torque_limits_of_tool as torque_limits_of_tool,
)  # fmt: skip
from pinproof.picks.judging.timing import (
    MotionPart as MotionPart, motion_parts as motion_parts, part_of as part_of, prove_part as prove_part,
    time_part as time_part,
)  # fmt: skip
from pinproof.picks.judging.verdict import (
    Intercept as Intercept, PickMotion as PickMotion, PickStatus as PickStatus, PickVerdict as PickVerdict,
    Stage as Stage, StageResult as StageResult, Suggestion as Suggestion,
)  # fmt: skip
from pinproof.picks.report.live_picks import LivePicks as LivePicks
from pinproof.picks.report.profile import (
    BodyTime as BodyTime, Proofs as Proofs, StageTime as StageTime, WorkProfile as WorkProfile,
    profile_picks as profile_picks, profile_work as profile_work,
)  # fmt: skip
from pinproof.picks.report.program_details import (
    check_export as check_export, controller_tool as controller_tool, with_motion as with_motion,
    with_return as with_return,
)  # fmt: skip
from pinproof.picks.report.program_export import (
    ExportedProgram as ExportedProgram, PicksProgram as PicksProgram, ProgramCheck as ProgramCheck,
    certify_picks_program as certify_picks_program, export_picks as export_picks,
    recertify_program as recertify_program,
)  # fmt: skip
from pinproof.picks.report.program_files import write_programs as write_programs
from pinproof.picks.report.report import (
    FIGURES as FIGURES, REPORT_SUFFIXES as REPORT_SUFFIXES, PickReport as PickReport,
    write_motion_pages as write_motion_pages,
)  # fmt: skip

__all__ = faces.exported(globals())
