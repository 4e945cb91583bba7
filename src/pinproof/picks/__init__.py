"""Picks: input, judgement stage by stage with reasons and suggestions, reports, campaigns and reach maps.

The data flows through four packages, each of which imports only from those before it: ``input`` (picks and their
files), ``judging`` (one pick, from reach to the timed and certified motion), ``report`` (tables and the HTML page) and
``batch`` (lists, campaigns, screening, reach maps). ``grasps`` proposes grasps of parts, by the hand and the grip of
``judging``.
"""

from pinproof.picks.batch.campaign import BeltSequence, Campaign, CampaignResult, pick_from_belt, validate_picks
from pinproof.picks.batch.reach_map import (
    ReachComparison,
    ReachMap,
    ReachRegion,
    approach_directions,
    attainable_orientations,
    reach_map,
    tool_orientations,
)
from pinproof.picks.batch.screening import ScreenResult, ScreenStatus, code_of, screen_picks
from pinproof.picks.grasps.proposals import ProposedGrasp, ProposedGrasps, propose_grasps
from pinproof.picks.input.parts import PartGrasp, PartType
from pinproof.picks.input.pick import GraspSpin, GraspTolerance, Member, Pick, PlaceTarget, ToolSpeed, support_names
from pinproof.picks.input.picks import (
    SETTINGS,
    CellRobot,
    NamedFrame,
    PickProblem,
    Picks,
    read_settings,
    root_from_frame,
)
from pinproof.picks.input.program import ProgramSettings
from pinproof.picks.input.settings import Conveyor, GripLimits, GripperFingers, PickBudget, PickWeights, SuctionCup
from pinproof.picks.input.sources import PickGrid, PickList, PickSource, PickTable, open_picks, read_picks
from pinproof.picks.input.tools import Hand, HandValues, Tool
from pinproof.picks.judging.configurations import TURN
from pinproof.picks.judging.grasp import GraspCandidate, PickCheck, reach, screen
from pinproof.picks.judging.grip import CupContact, FingerContact, GripResult
from pinproof.picks.judging.judge import judge
from pinproof.picks.judging.lines import Attempt, along, shifted, shortened, span, transit
from pinproof.picks.judging.place import Placer, Placing, Release, release_lines
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.suggest import LengthSuggestion, RetreatSuggestion, ShiftSuggestion, TurnSuggestion
from pinproof.picks.judging.task import (
    DOWN,
    SUPPORT_GAP,
    PickCell,
    PickTask,
    check_held_joints,
    check_windings,
    checker_of_picks,
    gripper_links,
    peaks_of,
    with_hand,
    rate_limits,
    spec_of_picks,
    torque_limits_of_tool,
)
from pinproof.picks.judging.timing import MotionPart, motion_parts, prove_part, time_part
from pinproof.picks.judging.two_hands import HandsResult, judge_hands
from pinproof.picks.judging.verdict import (
    Intercept,
    PickMotion,
    PickStatus,
    PickVerdict,
    Stage,
    StageResult,
    Suggestion,
)
from pinproof.picks.report.profile import BodyTime, PickProfile, StageTime, profile_picks
from pinproof.picks.report.program_details import check_export
from pinproof.picks.report.program_export import (
    ExportedProgram,
    PicksProgram,
    ProgramCheck,
    certify_picks_program,
    export_picks,
    recertify_program,
)
from pinproof.picks.report.report import FIGURES, REPORT_SUFFIXES, PickReport, write_motion_pages

__all__ = [
    "DOWN", "FIGURES", "REPORT_SUFFIXES", "SETTINGS", "SUPPORT_GAP", "TURN", "Attempt", "BeltSequence", "BodyTime",
    "Campaign", "CampaignResult", "CellRobot", "Conveyor", "CupContact", "ExportedProgram", "FingerContact",
    "GraspCandidate", "GraspSpin", "GraspTolerance", "GripLimits", "GripResult", "GripperFingers", "Hand",
    "HandValues", "HandsResult", "Intercept", "LengthSuggestion", "Member", "MotionPart", "NamedFrame", "PartGrasp",
    "PartType", "Pick", "PickBudget", "PickCell", "PickCheck", "PickGrid", "PickList", "PickMotion", "PickProblem",
    "PickProfile", "PickReport", "PickSetup", "PickSource", "PickStatus", "PickTable", "PickTask", "PickVerdict",
    "PickWeights", "Picks", "PicksProgram", "PlaceTarget", "Placer", "Placing", "ProgramCheck", "ProgramSettings",
    "ProposedGrasp", "ProposedGrasps", "ReachComparison", "ReachMap", "ReachRegion", "Release", "RetreatSuggestion",
    "ScreenResult", "ScreenStatus", "ShiftSuggestion", "Stage", "StageResult", "StageTime", "SuctionCup",
    "Suggestion", "Tool", "ToolSpeed", "TurnSuggestion", "along", "approach_directions", "attainable_orientations",
    "certify_picks_program", "check_export", "check_held_joints", "check_windings", "checker_of_picks", "code_of",
    "export_picks", "gripper_links", "judge", "judge_hands", "motion_parts", "open_picks", "peaks_of",
    "pick_from_belt", "profile_picks", "propose_grasps", "prove_part", "rate_limits", "reach", "reach_map",
    "read_picks", "read_settings", "recertify_program", "release_lines", "root_from_frame", "screen",
    "screen_picks", "shifted", "shortened", "span", "spec_of_picks", "support_names", "time_part",
    "tool_orientations", "torque_limits_of_tool", "transit", "validate_picks", "with_hand", "write_motion_pages",
]  # fmt: skip
