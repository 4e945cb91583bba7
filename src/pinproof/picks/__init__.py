"""Picks: what to grasp, the stages of a pick, verdicts with reasons, reports, reach maps."""

from pinproof.picks.pick import Pick, PickProblem, Picks
from pinproof.picks.picks_file import read_picks
from pinproof.picks.reach import ReachChange, ReachMap, Region, approach_directions, reach_map, tool_orientations
from pinproof.picks.report import PickReport
from pinproof.picks.validate import validate_picks
from pinproof.picks.verdict import PickStatus, PickVerdict, Stage, StageResult

__all__ = [
    "Pick",
    "PickProblem",
    "PickReport",
    "PickStatus",
    "PickVerdict",
    "Picks",
    "ReachChange",
    "ReachMap",
    "Region",
    "Stage",
    "StageResult",
    "approach_directions",
    "reach_map",
    "read_picks",
    "tool_orientations",
    "validate_picks",
]
