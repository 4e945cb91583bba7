"""Planning: RRT-Connect, simplification of paths, and Cartesian moves; every path has a certificate."""

from pinproof.planning.among_movers import TimedPlanResult, plan_among_movers
from pinproof.planning.cartesian import plan_linear, plan_poses
from pinproof.planning.coordination import CoordinationResult, coordinate, plan_arms
from pinproof.planning.edges import Edges
from pinproof.planning.ends import with_turns
from pinproof.planning.follow import RouteFollower
from pinproof.planning.motion_plan import MotionPlan, plan
from pinproof.planning.moving_ends import MovingEnds
from pinproof.planning.optimisation import OptimiseResult, optimise
from pinproof.planning.planners import DEFAULT_PLANNER, Planner, make_planner, planner_of
from pinproof.planning.result import (
    LinearPlanResult,
    LinearStatus,
    PlanProgress,
    PlanResult,
    PlanStatus,
    PosesPlanResult,
)
from pinproof.planning.route import Route
from pinproof.planning.rrt_connect import RrtConnect
from pinproof.planning.simplification import SimplifyResult, blend, shortcut, simplify

__all__ = [
    "DEFAULT_PLANNER",
    "CoordinationResult",
    "Edges",
    "LinearPlanResult",
    "LinearStatus",
    "MotionPlan",
    "MovingEnds",
    "OptimiseResult",
    "PlanProgress",
    "PlanResult",
    "PlanStatus",
    "Planner",
    "PosesPlanResult",
    "Route",
    "RouteFollower",
    "RrtConnect",
    "SimplifyResult",
    "TimedPlanResult",
    "blend",
    "coordinate",
    "make_planner",
    "optimise",
    "plan",
    "plan_among_movers",
    "plan_arms",
    "plan_linear",
    "plan_poses",
    "planner_of",
    "shortcut",
    "simplify",
    "with_turns",
]
