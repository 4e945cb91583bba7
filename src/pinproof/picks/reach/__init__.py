"""Screening of picks and poses at the grasp, and reach maps: that screening over a region."""

from pinproof.picks.reach.change import ReachComparison
from pinproof.picks.reach.mapping import reach_map
from pinproof.picks.reach.orientations import approach_directions, tool_orientations
from pinproof.picks.reach.pick_screen import ScreenResult
from pinproof.picks.reach.reach_map import ReachMap
from pinproof.picks.reach.region import ReachRegion
from pinproof.picks.reach.screen_picks import screen_picks
from pinproof.picks.reach.screening import ScreenStatus

__all__ = [
    "ReachComparison",
    "ReachMap",
    "ReachRegion",
    "ScreenResult",
    "ScreenStatus",
    "approach_directions",
    "reach_map",
    "screen_picks",
    "tool_orientations",
]
