"""Reach maps: which share of orientations an arm reaches, free of contact, all over a region."""

from pinproof.picks.reach.change import ReachChange
from pinproof.picks.reach.mapping import reach_map
from pinproof.picks.reach.orientations import approach_directions, tool_orientations
from pinproof.picks.reach.reach_map import ReachMap
from pinproof.picks.reach.region import Region

__all__ = ["ReachChange", "ReachMap", "Region", "approach_directions", "reach_map", "tool_orientations"]
