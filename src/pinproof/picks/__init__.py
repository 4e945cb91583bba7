"""Picks: what to grasp, the stages of a pick, verdicts with reasons, reports."""

from pinproof.picks.pick import Pick, PickProblem, Picks
from pinproof.picks.picks_file import read_picks
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
    "Stage",
    "StageResult",
    "read_picks",
    "validate_picks",
]
