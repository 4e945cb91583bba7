"""Planning: RRT-Connect, shortcuts and straight lines; every answer carries its certificate."""

from pinproof.planning.blend import blend
from pinproof.planning.linear import plan_linear
from pinproof.planning.linear_move import LinearMove, LinearStatus, PosesMove
from pinproof.planning.ompl_adapter import OmplPlanner, ompl_planners
from pinproof.planning.poses import plan_poses
from pinproof.planning.result import PlanProgress, PlanResult, PlanStatus
from pinproof.planning.rrt_connect import RrtConnect
from pinproof.planning.shortcut import shortcut
from pinproof.planning.simplify import Simplified, simplify

__all__ = [
    "LinearMove",
    "LinearStatus",
    "OmplPlanner",
    "PlanProgress",
    "PlanResult",
    "PlanStatus",
    "PosesMove",
    "RrtConnect",
    "Simplified",
    "blend",
    "ompl_planners",
    "plan_linear",
    "plan_poses",
    "shortcut",
    "simplify",
]
