"""Picks: input, judgement stage by stage with reasons and suggestions, reports, campaigns and reach maps.

The data flows through four packages, each of which imports only from those before it: ``input`` (picks and their
files), ``judging`` (one pick, from reach to the timed and certified motion), ``report`` (tables and the HTML page) and
``batch`` (lists, campaigns, screening, reach maps).
"""

from pinproof.picks.batch.belt_sequence import BeltSequence, pick_from_belt
from pinproof.picks.batch.campaign import Campaign, CampaignResult
from pinproof.picks.batch.reach_map import ReachComparison, ReachMap, attainable_orientations, reach_map
from pinproof.picks.batch.reach_region import ReachRegion, approach_directions, tool_orientations
from pinproof.picks.batch.screen_picks import screen_picks
from pinproof.picks.batch.screening import ScreenResult, ScreenStatus
from pinproof.picks.batch.validate import validate_picks
from pinproof.picks.input.conveyor import Conveyor
from pinproof.picks.input.pick import GraspSpin, GraspTolerance, Pick, PlaceTarget, ToolSpeed
from pinproof.picks.input.picks import CellRobot, GripperFingers, NamedFrame, PickProblem, Picks, SuctionCup
from pinproof.picks.input.picks_file import open_picks, read_picks
from pinproof.picks.input.settings import GripLimits, PickBudget, PickWeights
from pinproof.picks.input.sources import PickGrid, PickList, PickSource, PickTable
from pinproof.picks.judging.changes import apply_suggestion
from pinproof.picks.judging.grip import CupContact, FingerContact, GripResult
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.verdict import Intercept, PickMotion, PickStatus, PickVerdict, Stage, StageResult
from pinproof.picks.report.program_export import PicksProgram, certify_picks_program, export_picks
from pinproof.picks.report.report import REPORT_SUFFIXES, PickReport, write_motion_pages

__all__ = [
    "REPORT_SUFFIXES",
    "BeltSequence",
    "Campaign",
    "CampaignResult",
    "CellRobot",
    "Conveyor",
    "CupContact",
    "FingerContact",
    "GraspSpin",
    "GraspTolerance",
    "GripLimits",
    "GripResult",
    "GripperFingers",
    "Intercept",
    "NamedFrame",
    "Pick",
    "PickBudget",
    "PickGrid",
    "PickList",
    "PickMotion",
    "PickProblem",
    "PickReport",
    "PickSetup",
    "PickSource",
    "PickStatus",
    "PickTable",
    "PickVerdict",
    "PickWeights",
    "Picks",
    "PicksProgram",
    "PlaceTarget",
    "ReachComparison",
    "ReachMap",
    "ReachRegion",
    "ScreenResult",
    "ScreenStatus",
    "Stage",
    "StageResult",
    "SuctionCup",
    "ToolSpeed",
    "apply_suggestion",
    "approach_directions",
    "attainable_orientations",
    "certify_picks_program",
    "export_picks",
    "open_picks",
    "pick_from_belt",
    "reach_map",
    "read_picks",
    "screen_picks",
    "tool_orientations",
    "validate_picks",
    "write_motion_pages",
]
