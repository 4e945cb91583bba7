"""Planning: RRT-Connect, simplification of paths, and Cartesian moves; every path has a certificate."""

from pinproof.planning.among_movers import TimedPlanResult, plan_among_movers
from pinproof.planning.cartesian import plan_linear, plan_poses
from pinproof.planning.coordination import CoordinationResult, coordinate, plan_arms
from pinproof.planning.follow import Route, RouteFollower
from pinproof.planning.goals import Goal, GoalPose
from pinproof.planning.motion_plan import MotionPlan, plan
from pinproof.planning.moves import MovingEnds
from pinproof.planning.optimisation import OptimiseResult, optimise
from pinproof.planning.plan_results import (
    Barrier,
    InvalidEnd,
    LinearPlanResult,
    LinearStatus,
    OutsideLimits,
    PlanProgress,
    PlanResult,
    PlanStatus,
    PosesPlanResult,
)
from pinproof.planning.planners import DEFAULT_PLANNER, CertifiedPlanner, Planner, planner_of
from pinproof.planning.problem import Edges, Ends, find_barriers, read_ends, sampling_box, with_turns
from pinproof.planning.replanning import Replan, ReplanStatus, replan
from pinproof.planning.rrt_connect import RrtConnect
from pinproof.planning.simplification import SimplifyResult, blend, shortcut, simplify

__all__ = [
    "DEFAULT_PLANNER",
    "Barrier",
    "CertifiedPlanner",
    "CoordinationResult",
    "Edges",
    "Ends",
    "Goal",
    "GoalPose",
    "InvalidEnd",
    "LinearPlanResult",
    "LinearStatus",
    "MotionPlan",
    "MovingEnds",
    "OptimiseResult",
    "OutsideLimits",
    "PlanProgress",
    "PlanResult",
    "PlanStatus",
    "Planner",
    "PosesPlanResult",
    "Replan",
    "ReplanStatus",
    "Route",
    "RouteFollower",
    "RrtConnect",
    "SimplifyResult",
    "TimedPlanResult",
    "blend",
    "coordinate",
    "find_barriers",
    "optimise",
    "plan",
    "plan_among_movers",
    "plan_arms",
    "plan_linear",
    "plan_poses",
    "planner_of",
    "read_ends",
    "replan",
    "sampling_box",
    "shortcut",
    "simplify",
    "with_turns",
]
