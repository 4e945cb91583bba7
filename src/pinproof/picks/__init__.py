"""Picks: what to grasp, the stages of a pick, verdicts with reasons, reports, campaigns, reach maps."""

from pinproof.picks.campaign import Campaign, CampaignResult
from pinproof.picks.family import GraspSpin, GraspTolerance
from pinproof.picks.frames import NamedFrame
from pinproof.picks.grip import FingerContact, GripResult
from pinproof.picks.gripper import GripperFingers
from pinproof.picks.pick import Pick, PickProblem, Picks, PlaceTarget
from pinproof.picks.picks_file import open_picks, read_picks
from pinproof.picks.reach import (
    ReachComparison,
    ReachMap,
    ReachRegion,
    ScreenResult,
    ScreenStatus,
    approach_directions,
    reach_map,
    screen_picks,
    tool_orientations,
)
from pinproof.picks.report import PickReport, write_report_page
from pinproof.picks.settings import GripLimits, PickBudget, PickWeights
from pinproof.picks.setup import PickSetup
from pinproof.picks.source import PickGrid, PickList, PickSource
from pinproof.picks.suggestion import apply_suggestion
from pinproof.picks.table import PickTable
from pinproof.picks.validate import validate_picks
from pinproof.picks.verdict import PickMotion, PickStatus, PickVerdict, Stage, StageResult

__all__ = [
    "Campaign",
    "CampaignResult",
    "FingerContact",
    "GraspSpin",
    "GraspTolerance",
    "GripLimits",
    "GripResult",
    "GripperFingers",
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
    "PlaceTarget",
    "ReachComparison",
    "ReachMap",
    "ReachRegion",
    "ScreenResult",
    "ScreenStatus",
    "Stage",
    "StageResult",
    "apply_suggestion",
    "approach_directions",
    "open_picks",
    "reach_map",
    "read_picks",
    "screen_picks",
    "tool_orientations",
    "validate_picks",
    "write_report_page",
]
